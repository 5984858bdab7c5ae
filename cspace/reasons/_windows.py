"""Finer maps and windows, which decide what the cells of a map leave undecided."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from cspace import FREE, Grid, Workspace, build
from cspace.errors import InputError
from cspace.inside import Bools, Floats, Ints
from cspace.reasons._margins import Way, find_way

if TYPE_CHECKING:
    from cspace import CSpace

MAX_HALVINGS: Final = 4
"""Maximum number of times that the spacing is halved."""

Decision = Literal["open", "shut", "nothing", "untried"]
"""Result of a finer map: the way is proven open or shut, nothing is proven, or none was built."""


class Trial(NamedTuple):
    """A finer map that would decide whether a path exists.

    Attributes
    ----------
    spacing : float
        Side of a cell of the finer map, estimated or tried.
    rotations : int
        Number of yaw cells of the finer map; 1 if the robot does not rotate.
    decided : {"open", "shut", "nothing", "untried"}
        Result of the finer map, or of a window of it around the MIXED cells: the way is proven open
        or shut; "nothing" if no spacing down to a sixteenth of the map's decides.
    """

    spacing: float
    rotations: int
    decided: Decision


def has_thin_obstacle(space: CSpace, touched: Bools, position: Floats) -> bool:
    """Return True if an obstacle near a position is too thin for the finest map's cells.

    Then no cell of a finer map lies in it, which alone proves collisions. ``touched`` marks the
    cells of the workspace, padded by one, whose obstacles count.
    """
    workspace = space.workspace
    grid = workspace.grid
    near_inner = ndimage.binary_dilation(workspace.inner, np.ones((3,) * grid.dim))
    thin = np.argwhere(touched[(slice(1, -1),) * space.dim] & workspace.outer & ~near_inner)
    factor = 2**MAX_HALVINGS
    if not (len(thin) and _can_refine(grid, factor)):
        return False
    gaps = np.linalg.norm(grid.center_of(thin)[:, : space.dim] - position[: space.dim], axis=1)
    lower = grid.lower + grid.spacing * (thin[gaps.argmin()] - 1)
    fine = Grid(lower, grid.spacing / factor, (3 * factor,) * grid.dim)
    return not any(shape.cells(fine)[1].any() for shape in workspace.obstacles)


def suggest_finer(space: CSpace, way: Way, can_shut: bool) -> Trial:
    """Estimate the finer map that decides a way, which thin obstacles cannot shut.

    The estimate takes the middle of the two bounds as the true margin. The distance of the bounds
    is proportional to the spacing and the angle of the cells, and must fall below twice the true
    margin.
    """
    low, high = way.low, way.high
    # A way too narrow for the middle of a robot four cells wide is narrower than the robot.
    if not can_shut and math.isinf(low) and way.depth > 2.0 * space.grid.spacing:
        return _describe_trial(space, 2**MAX_HALVINGS, "nothing")
    halvings = 1
    if math.isfinite(low) and math.isfinite(high):
        # The lower limit keeps the logarithm finite, and gives MAX_HALVINGS halvings.
        middle = max(abs(low + high) / 2.0, (high - low) / 2.0 ** (MAX_HALVINGS + 1))
        halvings = max(1, math.ceil(math.log2((high - low) / 2.0 / middle)))
    factor = 2 ** min(halvings, MAX_HALVINGS)
    return _describe_trial(space, factor, "untried")


def refine_way(space: CSpace, points: Floats, way: Way, is_decided: bool) -> tuple[Way, Trial]:
    """Build finer maps to narrow a way's margins and decide it.

    ``points``, shape (2, size), are start and goal. Maps of the whole workspace are built while
    they are small, then windows if the way is undecided. Returns the way and the finest map tried.
    """
    decided: Decision = "nothing"
    factor = 1
    for _ in range(MAX_HALVINGS):
        finer = 2 * factor
        n_cells = finer**space.dim * space.grid.size * _count_rotations(space, finer)
        scene = space.workspace.grid
        n_cells = max(n_cells, finer**scene.dim * scene.size)
        # Maximum number of cells, over all rotations, of a finer map of the whole workspace.
        is_whole = n_cells <= 2**22 and space.outside != "unknown"
        if (is_decided and not is_whole) or not _can_refine(scene, finer):
            break
        factor = finer
        if is_whole:
            map_ = _build_finer(space, factor, np.zeros(space.dim, np.int64), space.grid.shape)
            fine_way = find_way(map_, points)
            high = min(way.high, fine_way.high) if _has_known_solids(space) else way.high
            way = way._replace(low=max(way.low, fine_way.low), high=high)
            decided = _decide(space, map_, points)
        else:
            decided = _decide_window(space, way, factor)
        if decided != "nothing" and not is_decided:
            break
    return way, _describe_trial(space, factor, decided)


def _can_refine(grid: Grid, factor: int) -> bool:
    """Return False if finer cells would lie too far from the origin for proofs."""
    with suppress(InputError):
        return Grid(grid.lower, grid.spacing / factor, [factor * n for n in grid.shape]).size > 0
    return False


def _describe_trial(space: CSpace, factor: int, decided: Decision) -> Trial:
    """Describe a finer map, and what it decided."""
    grid = space.grid
    return Trial(grid.spacing / factor, _count_rotations(space, factor), decided)


def _count_rotations(space: CSpace, factor: int) -> int:
    """Return a finer spacing's number of rotation cells."""
    count = len(space.rotations)
    return 1 if count == 1 else count * factor


def _has_known_solids(space: CSpace) -> bool:
    """Return True if a finer map's obstacles are solid.

    Without shapes, a finer map takes whole outer cells as obstacles, some of which may be free.
    """
    workspace = space.workspace
    return workspace.shapes is not None or np.array_equal(workspace.outer, workspace.inner)


def _build_finer(space: CSpace, factor: int, first: Ints, stop: ArrayLike) -> CSpace:
    """Build a finer map in a box of cells.

    The box is from cell ``first`` to before cell ``stop``. The cells are those of a finer map of
    the whole grid, because the box begins at a corner of a cell.
    """
    grid = space.workspace.grid  # that of a robot on a floor has heights, which all stay
    starts, stops = np.zeros(grid.dim, np.int64), np.array(grid.shape)
    starts[: space.dim], stops[: space.dim] = first, stop
    bounds = np.concatenate([grid.lower + grid.spacing * starts, grid.lower + grid.spacing * stops])
    fine = Workspace.from_shapes(space.workspace.obstacles, grid.spacing / factor, bounds)
    count = _count_rotations(space, factor)
    outside: Literal["free", "blocked"] = "free" if space.outside == "free" else "blocked"
    rotations = None if count == 1 else count
    return build(
        fine,
        space.robot,
        rotations=rotations,
        margin=space.margin,
        outside=outside,
        floor=space.floor,
    )


def _decide(space: CSpace, finer: CSpace, ends: ArrayLike) -> Decision:
    """Return a finer map's decision on start and goal."""
    start, goal = np.asarray(ends)
    if finer.is_connected(start, goal):
        return "open"
    return "shut" if _has_known_solids(space) and finer.is_disconnected(start, goal) else "nothing"


def _decide_window(space: CSpace, way: Way, factor: int) -> Decision:
    """Decide a finer window around a way's barrier.

    Space outside the window counts as blocked, so that an open way leads through the window.
    """
    first, last = way.barred[[0, -1]]
    between = way.cells[max(first - 1, 0) : last + 2]
    positions = between[:, 1:]
    grid = space.grid
    corners = np.abs(np.array(space.robot.shape.outer.bounds)).max(axis=0)
    reach = float(np.linalg.norm(corners)) + space.margin
    # Number of cells of the map that a window has around the cells to decide, besides the reach.
    reach_cells = math.ceil(reach / grid.spacing) + 8
    first_cell = np.maximum(positions.min(axis=0) - reach_cells, 0)
    stop_cell = np.minimum(positions.max(axis=0) + 1 + reach_cells, grid.shape)
    window = _build_finer(space, factor, first_cell, stop_cell)
    ends = []
    for rotation, *cell in between[[0, -1]].tolist():
        center = grid.center_of(np.array(cell))
        ends.append((*center.tolist(), *space.rotations.centers[rotation].tolist()))
    if any(window.classify(q) != FREE for q in ends):
        return "nothing"
    return _decide(space, window, ends)
