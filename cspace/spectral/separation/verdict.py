"""What is known of an overlap after some of its frequencies."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Verdict(IntEnum):
    """Answer to whether two ball sets are apart; what it proves is stated where it is asked for."""

    MISS = 0
    HIT = 1
    UNDECIDED = 2


@dataclass(frozen=True, slots=True)
class Separation:
    """A verdict, and what it took.

    Attributes
    ----------
    verdict : Verdict
        MISS, HIT or UNDECIDED.
    frequencies : int
        How many were summed; 0 where the swollen obstacles alone proved the miss. A frequency and its opposite, whose
        terms are conjugate, count as one.
    total : int
        How many there are within the band limit, for the ball sets that were asked: inner balls only where the outer
        ones proved no miss.
    overlap : float
        The partial sum that was reached, square or cubic metres; of the outer balls, where there are inner ones too.
    bound : float
        By how much the ideal overlap, with all frequencies, can differ from ``overlap``, rounding included.
    """

    verdict: Verdict
    frequencies: int
    total: int
    overlap: float
    bound: float

    @property
    def share(self) -> float:
        """Part of the frequencies that was summed, 0 to 1."""
        return self.frequencies / self.total
