"""Tally: what a soak checked against exact geometry, and what came of it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak.plane_geometry import ROUNDING
from cspace import BLOCKED, FREE, MIXED, CSpace
from cspace.arrays import Bools, Floats

SHOWN = 20


class Drawn(Protocol):
    """Something random that can be drawn again."""

    @property
    def name(self) -> str:
        """What was drawn."""

    @property
    def made_by(self) -> str:
        """The call that draws it again."""

    @property
    def kind(self) -> tuple[str, str]:
        """Kind of workspace and kind of robot."""


class Case(Drawn, Protocol):
    """A map and what it stands for, in the plane or in space."""

    @property
    def space(self) -> CSpace:
        """The map."""

    @property
    def reach(self) -> float:
        """No point of the robot is farther than this from its reference point."""

    def meets(self, q: Floats, distance: float | Floats) -> Bools:
        """Whether the robot comes within a distance of the obstacles."""

    def lies_in(self, q: Floats, rng: np.random.Generator) -> Bools:
        """Whether the robot, grown by the margin, lies in the obstacles."""


@dataclass
class Tally:
    """Counts of each kind of check, and words on the first that failed; of verdicts, what was true and was said."""

    checks: Counter[str] = field(default_factory=Counter)
    open: Counter[str] = field(default_factory=Counter)
    wrong: Counter[str] = field(default_factory=Counter)
    kinds: Counter[tuple[str, str]] = field(default_factory=Counter)
    mixed: Counter[str] = field(default_factory=Counter)
    verdicts: Counter[tuple[str, str]] = field(default_factory=Counter)
    false: list[str] = field(default_factory=list)

    def add(self, what: str, case: Drawn, q: Floats, wrong: Bools, undecided: Bools) -> None:
        """Count the checks of one kind on one map; the first wrong ones are listed with what makes them again."""
        self.checks[what] += len(q)
        self.open[what] += int(undecided.sum())
        self.kinds[case.kind] += len(q)
        self.wrong[what] += int(wrong.sum())
        if wrong.any() and len(self.false) < SHOWN:
            self.false.append(f"{what} at {q[wrong][0].tolist()} of {case.made_by}: {case.name}")

    def judge(self, case: Case, q: Floats, states: NDArray[np.integer]) -> None:
        """Check the states that configurations are claimed to have."""
        free, blocked, mixed = q[states == FREE], q[states == BLOCKED], q[states == MIXED]
        self.add("FREE", case, free, *not_free(case, free))
        apart = ~case.meets(blocked, 0.0)
        wrong = apart.copy()
        wrong[apart] = ~case.meets(blocked[apart], ROUNDING)
        self.add("BLOCKED", case, blocked, wrong, apart & ~wrong)
        self.mixed["all"] += len(mixed)
        self.mixed["colliding"] += int(case.meets(mixed, 0.0).sum())

    def tell(self, report: Report) -> None:
        """Report all counts; a false answer makes the run fail."""
        for what, count in self.checks.items():
            undecided = self.open[what]
            report.check(
                not self.wrong[what],
                f"{what}: {count} checks, {self.wrong[what]} false, {undecided} within {ROUNDING:g} m of the border",
            )
        for axis, label in enumerate(("obstacles", "robots")):
            counts: Counter[str] = Counter()
            for kind, count in self.kinds.items():
                counts[kind[axis]] += count
            report.note(f"{label}: " + ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items())))
        colliding, every = self.mixed["colliding"], self.mixed["all"]
        if every:
            report.note(f"of {every} configurations called MIXED, {colliding} collide: {colliding / every:.0%}")
        for truth in sorted({truth for truth, _ in self.verdicts}):
            said = {verdict: count for (kind, verdict), count in self.verdicts.items() if kind == truth}
            every = sum(said.values())
            shares = ", ".join(f"{verdict} {count} ({count / max(every, 1):.1%})" for verdict, count in said.items())
            report.note(f"{truth}, {every} placements: {shares}")
        for line in self.false:
            report.note(f"FALSE {line}")


def not_free(case: Case, q: Floats) -> tuple[Bools, Bools]:
    """Where the robot, grown by the margin, collides; and where it is too close to tell."""
    margin = case.space.margin
    near = case.meets(q, margin + ROUNDING)
    wrong = near.copy()
    wrong[near] = case.meets(q[near], max(0.0, margin - ROUNDING))
    return wrong, near & ~wrong
