"""Counts of the checks of random cases."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.report import Report
from cspace import BLOCKED, FREE, MIXED
from cspace._support.arrays import Bools, Floats, Ints, States
from tests.fuzz.scenes import Case, Rng

ROUNDING = 1e-9
"""Distance from contact, in metres, within which no state counts as false."""

SHOWN = 20
"""Maximum number of false results printed."""


@dataclass
class Tally:
    """Counts of checks, and descriptions of the first false results."""

    checks: Counter[str] = field(default_factory=Counter)
    open: Counter[str] = field(default_factory=Counter)
    wrong: Counter[str] = field(default_factory=Counter)
    false: list[str] = field(default_factory=list)

    def add(self, claim: str, name: str, q: Floats, wrong: Bools, undecided: Any = False) -> None:
        """Count checks at configurations (..., size) of a named case."""
        self.checks[claim] += wrong.size
        self.wrong[claim] += int(wrong.sum())
        self.open[claim] += int(np.sum(undecided))
        if wrong.any():
            self.false.append(f"{claim} at {q[wrong][0].tolist()} of {name}")

    def add_free(self, claim: str, case: Case, q: Floats, refused: Any = False) -> None:
        """Count configurations that must not collide, nor be refused by the map."""
        wrong, undecided = find_collisions(case, q.reshape(-1, q.shape[-1]))
        self.add(claim, case.name, q, wrong.reshape(q.shape[:-1]) | refused, undecided)

    def judge(self, case: Case, q: Floats, states: States) -> None:
        """Check states of configurations; count the MIXED ones that collide."""
        self.add_free("FREE", case, q[states == FREE])
        blocked, mixed = q[states == BLOCKED], q[states == MIXED]
        apart = ~case.meets(blocked, 0.0)
        wrong = ~case.meets(blocked, ROUNDING)
        self.add("BLOCKED", case.name, blocked, wrong, apart & ~wrong)
        apart = ~case.meets(mixed, 0.0)
        self.add("MIXED that is free", case.name, mixed, np.zeros(len(mixed), dtype=bool), apart)

    def report_to(self, report: Report) -> None:
        """Report all counts; a false result fails the run."""
        for claim, count in self.checks.items():
            wrong, undecided = self.wrong[claim], self.open[claim]
            report.check(
                not wrong, f"{claim}: {count} checks, {wrong} false, {undecided} undecided"
            )
        for line in self.false[:SHOWN]:
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
    seconds = time.perf_counter() - start
    report.section(f"{title}: {number} random cases, seed {seed}, {seconds:.0f} s")
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
