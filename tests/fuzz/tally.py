"""Counts of the checks of random cases."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.report import Report
from cspace._support.arrays import Bools, Floats

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
