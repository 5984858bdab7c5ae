"""Random cases, and counts of their checks."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.report import Report
from cspace import BLOCKED, FREE, MIXED, CSpace
from cspace.support.arrays import Bools, Floats, Ints, States

Rng = np.random.Generator

ROUNDING = 1e-9
"""Distance from contact, in metres, within which no state counts as false."""

SHOWN = 20
"""Maximum number of false results printed."""


@dataclass(frozen=True)
class Drawn:
    """A random case.

    Attributes
    ----------
    name : str
        Description of the case.
    made_by : str
        The call that draws it again.
    kind : tuple of str
        Kind of workspace and kind of robot.
    """

    name: str
    made_by: str
    kind: tuple[str, str]


@dataclass(frozen=True)
class Case(Drawn, ABC):
    """A map, and its exact geometry."""

    space: CSpace

    @property
    @abstractmethod
    def reach(self) -> float:
        """Upper bound of the robot's extent, in metres."""

    @abstractmethod
    def meets(self, q: Floats, distance: float | Floats) -> Bools:
        """Return True where the robot comes within a distance."""

    @abstractmethod
    def lies_in(self, q: Floats, rng: Rng) -> Bools:
        """Return True where the grown robot lies in obstacles."""


@dataclass
class Tally:
    """Counts of checks, and descriptions of the first false results."""

    checks: Counter[str] = field(default_factory=Counter)
    open: Counter[str] = field(default_factory=Counter)
    wrong: Counter[str] = field(default_factory=Counter)
    kinds: Counter[tuple[str, str]] = field(default_factory=Counter)
    mixed: Counter[str] = field(default_factory=Counter)
    verdicts: Counter[tuple[str, str]] = field(default_factory=Counter)
    false: list[str] = field(default_factory=list)

    def add(
        self, claim: str, case: Drawn, q: Floats, wrong: Bools, undecided: Bools | None = None
    ) -> None:
        """Count checks at configurations (..., size)."""
        self.checks[claim] += wrong.size
        self.kinds[case.kind] += wrong.size
        self.wrong[claim] += int(wrong.sum())
        self.open[claim] += 0 if undecided is None else int(undecided.sum())
        if wrong.any() and len(self.false) < SHOWN:
            self.false.append(f"{claim} at {q[wrong][0].tolist()} of {case.made_by}: {case.name}")

    def judge(self, case: Case, q: Floats, states: States) -> None:
        """Check states of configurations; count the MIXED ones that collide."""
        free, blocked, mixed = q[states == FREE], q[states == BLOCKED], q[states == MIXED]
        self.add("FREE", case, free, *find_collisions(case, free))
        apart = ~case.meets(blocked, 0.0)
        wrong = apart.copy()
        wrong[apart] = ~case.meets(blocked[apart], ROUNDING)
        self.add("BLOCKED", case, blocked, wrong, apart & ~wrong)
        self.mixed["all"] += len(mixed)
        self.mixed["colliding"] += int(case.meets(mixed, 0.0).sum())

    def report_to(self, report: Report) -> None:
        """Report all counts; a false result fails the run."""
        for claim, count in self.checks.items():
            wrong, undecided = self.wrong[claim], self.open[claim]
            report.check(
                not wrong, f"{claim}: {count} checks, {wrong} false, {undecided} too close to tell"
            )
        for axis, label in enumerate(("obstacles", "robots")):
            counts: Counter[str] = Counter()
            for kind, count in self.kinds.items():
                counts[kind[axis]] += count
            report.note(
                f"{label}: "
                + ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items()))
            )
        colliding, total = self.mixed["colliding"], self.mixed["all"]
        if total:
            report.note(
                f"{colliding} of {total} MIXED configurations collide ({colliding / total:.0%})"
            )
        for truth in sorted({truth for truth, _ in self.verdicts}):
            counts = Counter(
                {
                    verdict: count
                    for (kind, verdict), count in self.verdicts.items()
                    if kind == truth
                }
            )
            total = counts.total()
            shares = (
                f"{verdict} {count} ({count / max(total, 1):.1%})"
                for verdict, count in counts.items()
            )
            report.note(f"{truth}, {total} placements: {', '.join(shares)}")
        for line in self.false:
            report.note(f"FALSE {line}")


def draw_until(
    report: Report,
    title: str,
    seed: int,
    is_enough: Callable[[Tally], bool],
    check: Callable[[Tally, int], None],
) -> Tally:
    """Check cases until a tally is large enough."""
    tally, start, number = Tally(), time.perf_counter(), 0
    while not is_enough(tally):
        check(tally, number)
        number += 1
    report.section(
        f"{title}: {number} random cases, seed {seed}, {time.perf_counter() - start:.0f} s"
    )
    tally.report_to(report)
    return tally


def find_collisions(case: Case, q: Floats) -> tuple[Bools, Bools]:
    """Return masks of collisions and of cases too close to tell."""
    margin = case.space.margin
    near = case.meets(q, margin + ROUNDING)
    wrong = near.copy()
    wrong[near] = case.meets(q[near], max(0.0, margin - ROUNDING))
    return wrong, near & ~wrong


def pick_close(distances: Floats, number: int, rng: Rng) -> Ints:
    """Return ``number`` indices, half by smallest distance."""
    order = np.argsort(distances, kind="stable")
    half = number // 2
    return np.concatenate([order[:half], rng.permutation(order[half:])[: number - half]])
