"""Update: what a change of the workspace did to a map."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Update:
    """What :meth:`cspace.CSpace.update` did.

    Attributes
    ----------
    occupied : int
        Number of workspace cells that differ from what they were.
    lower, upper : tuple of int
        The box of cells of configurations, in any rotation cell, that were looked at again: its first cell, and the
        first one beyond it along each axis. Equal where nothing had to be.
    changed : int
        Number of cells of configurations, over all rotation cells, whose state is another now.
    """

    occupied: int
    lower: tuple[int, ...]
    upper: tuple[int, ...]
    changed: int
