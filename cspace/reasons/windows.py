"""Finer windows of a map, which decide passages that its own cells leave undecided."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import numpy as np

from cspace.builder import build
from cspace.reasons.margins import Way
from cspace.support.arrays import FREE
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from cspace.space import CSpace

MAX_HALVINGS: Final = 4
"""Number of times that the spacing is halved at most."""

MARGIN_CELLS: Final = 8
"""Width of a window around the cells to decide, in cells of the map."""


Decision = Literal["open", "shut", "nothing", "untried"]
"""Result of a finer window."""


class Trial(NamedTuple):
    """A finer map that would decide whether a path exists.

    Attributes
    ----------
    spacing : float
        Side of its cells, metres: estimated, or tried.
    rotations : int
        Number of its yaw cells; 1 if the robot does not rotate.
    decided : {"open", "shut", "nothing", "untried"}
        Proof of a window of such cells around the MIXED cells: the way is open there, or shut;
        "nothing" if no window down to a sixteenth of the map's spacing decides.
    """

    spacing: float
    rotations: int
    decided: Decision

    def __str__(self) -> str:
        """Return a sentence."""
        turns = f" and {self.rotations} rotations" if self.rotations > 1 else ""
        settings = f"a spacing of {self.spacing:.3g} m{turns}"
        if self.decided == "untried":
            return f"Perhaps {settings} would decide."
        if self.decided == "nothing":
            return f"Even {settings} would not decide."
        return f"With {settings}, the way there is proven {self.decided}."


def try_finer(space: CSpace, way: Way, margin: tuple[float, float], refine: bool) -> Trial:
    """Estimate the spacing that decides a way, or with ``refine`` try finer windows.

    The true margin is taken to be the middle of its two bounds: their distance is proportional to
    spacing and angle of the cells, and must fall below twice the true margin.
    """
    count = len(space.rotations)
    low, high = margin
    halvings = 1
    if math.isfinite(low) and math.isfinite(high):
        middle = max(abs(low + high) / 2.0, (high - low) / 2.0 ** (MAX_HALVINGS + 1))
        halvings = max(1, math.ceil(math.log2((high - low) / 2.0 / middle)))
    halvings = min(halvings, MAX_HALVINGS)
    if not refine:
        factor = 2**halvings
        return Trial(space.grid.spacing / factor, _count_rotations(count, factor), "untried")
    for halving in range(1, MAX_HALVINGS + 1):
        factor = 2**halving
        decided = _decide_window(space, way, factor)
        trial = Trial(space.grid.spacing / factor, _count_rotations(count, factor), decided)
        if decided != "nothing":
            break
    return trial


def _count_rotations(count: int, factor: int) -> int:
    """Return the number of rotation cells at a finer spacing."""
    return 1 if count == 1 else count * factor


def _decide_window(space: CSpace, way: Way, factor: int) -> Decision:
    """Decide a way in a window around its barrier, at a finer spacing.

    Space outside the window counts as blocked, so that an open way leads through the window.
    """
    is_barred = (way.cells[:, np.newaxis] == way.barrier).all(axis=2).any(axis=1)
    is_barred[np.abs(way.cells - way.bottleneck).sum(axis=1).argmin()] = True
    on_barrier = np.flatnonzero(is_barred)
    first = max(int(on_barrier[0]) - 1, 0)
    last = min(int(on_barrier[-1]) + 1, len(way.cells) - 1)
    positions = way.cells[first : last + 1, 1:]
    grid = space.grid
    corners = np.abs(np.array(space.robot.shape.outer.bounds)).max(axis=0)
    reach = float(np.linalg.norm(corners)) + space.margin
    reach_cells = math.ceil(reach / grid.spacing) + MARGIN_CELLS
    # The window begins with a cell of the map, so that its cells are those of a whole finer map.
    first_cell = np.maximum(positions.min(axis=0) - reach_cells, 0)
    stop_cell = np.minimum(positions.max(axis=0) + 1 + reach_cells, grid.shape)
    lower = grid.lower + grid.spacing * first_cell
    upper = grid.lower + grid.spacing * stop_cell
    shapes = space.workspace.obstacles
    fine = Workspace.from_shapes(shapes, grid.spacing / factor, np.concatenate([lower, upper]))
    rotations = None if len(space.rotations) == 1 else len(space.rotations) * factor
    window = build(fine, space.robot, rotations=rotations, margin=space.margin)
    ends = []
    for rotation, *cell in way.cells[[first, last]].tolist():
        center = grid.center_of(np.array(cell))
        ends.append((*center.tolist(), *space.rotations.centers[rotation].tolist()))
    if any(window.classify(q) != FREE for q in ends):
        return "nothing"
    if window.is_connected(*ends):
        return "open"
    # Occupied cells without shapes, such as unknown ones, may be free inside.
    workspace = space.workspace
    is_solid = workspace.shapes is not None or np.array_equal(workspace.outer, workspace.inner)
    return "shut" if is_solid and window.is_disconnected(*ends) else "nothing"
