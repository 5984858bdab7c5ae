"""Verdicts, and the work that they may take."""

from typing import NamedTuple

FREE, PROVEN, TOUCHES, NOT_SHOWN = "free", "proven", "touches", "not shown"

TOLERANCE = 1e-9
"""Overlap, as a share of the robot's reach or of a cell, that counts as none."""

ULPS = 1e-14
"""Rounding of coordinates, as a share of the largest one."""


class Verdict(NamedTuple):
    """An answer of the checker; true in conditions if the claim holds."""

    kind: str
    text: str = ""

    def __bool__(self):
        """Return True if the claim is shown."""
        return self.kind in (FREE, PROVEN)


TOO_MUCH = Verdict(NOT_SHOWN, "more work than allowed")


class Budget:
    """Counted work: one for each piece of a motion and part of a body."""

    def __init__(self, left):
        """Allow an amount of work."""
        self.left, self.spent = left, 0

    def take(self, amount):
        """Count work; return False if it exceeds the rest, and do not count it then."""
        if amount > self.left:
            return False
        self.left, self.spent = self.left - amount, self.spent + amount
        return True
