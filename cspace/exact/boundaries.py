"""Borders of the robot and of the obstacles, as the pieces between which exact answers measure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np

from cspace.arrays import Bools, Floats, Ints
from cspace.exact import ROUNDING
from cspace.grid import Grid
from cspace.map.storage import Map
from cspace.raster.bitmaps import rectangle_triangles
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.shapes import ExactShape, Pieces
from cspace.shapes.bodies import component_labels
from cspace.workspace import Workspace

CUT_ERROR: Final = 2.0**-48
"""Rounding of a border that is cut, relative to its coordinates."""


class Proofs(Protocol):
    """Proofs for one robot among the obstacles of one workspace, of what the cells of the map leave open.

    ``edge(*q0, *q1)`` is whether all of an edge is free, and ``are_free(q0, q1)`` whether each of many is, for shapes
    (n, dof); an edge that ends where it starts is a point.
    ``excess(points, lengths, turns)``: by how much the robot is farther from obstacles than it has to be, metres, on
    pieces of a path that is free, by their middles, shape (n, dof), how far they lead and how much they turn; or zero.
    """

    @property
    def edge(self) -> Callable[..., bool]: ...
    def are_free(self, q0: Floats, q1: Floats) -> Bools: ...
    def excess(self, points: Floats, lengths: Floats, turns: Floats) -> float: ...


class Problem(NamedTuple):
    """A robot among obstacles, and the map of it.

    Attributes
    ----------
    map : Map
    rotations : Rotations
    workspace : Workspace
    robot : Robot
    margin : float
        Metres.
    walled : bool
        Whether all outside the grid is obstacle.
    prove : callable or None
        Makes the proofs, of a map of joints by the space of their arm; None where robot and obstacles are all there is.
    """

    map: Map
    rotations: Rotations
    workspace: Workspace
    robot: Robot
    margin: float
    exterior_blocked: bool
    prove: Callable[[Problem], Proofs] | None = None

    @property
    def dof(self) -> int:
        """Length of a configuration."""
        return self.workspace.grid.dim + self.rotations.dof

    @property
    def far(self) -> float:
        """The largest coordinate of the grid and of the robot in its own frame, together, metres."""
        grid = self.workspace.grid
        return float(np.abs([*grid.lower, *grid.upper]).max()) + self.robot.span

    @property
    def least(self) -> float:
        """What a distance has to exceed, but for what grows with the configuration, metres."""
        return self.margin + self.rotations.slack * self.robot.span + ROUNDING * (self.far + self.margin)


class Obstacles(NamedTuple):
    """The border of obstacles, shape by shape, and by how much cutting it to the grid may have moved it, metres."""

    pieces: list[Pieces]
    error: float


def obstacle_border(workspace: Workspace, *, exterior_blocked: bool) -> Obstacles:
    """The border of the obstacles of a workspace, cut to the grid, whose own border needs no pieces where
    ``exterior_blocked``.

    Raises InputError if an obstacle is a mesh whose inside depends on the spacing.
    """
    borders, error = [], 0.0
    for shape in (each.outer for each in workspace.obstacles):
        whole = shape.boundary()
        pieces = clipped(whole, workspace.grid)
        if pieces is not whole:
            if len(pieces.radii):
                error = max(error, CUT_ERROR * float(np.abs(whole.simplices).max()))
            if not exterior_blocked and shape.encloses and whole.simplices.shape[1] > 1:
                pieces = _bare(np.concatenate([pieces.simplices, *_lids(shape, workspace)]))
        borders.append(pieces)
    return Obstacles(borders, error)


def in_space(parts: Sequence[Pieces]) -> Pieces:
    """Pieces together, as triangles: those of fewer corners have their last one again; the plane is at z = 0."""
    simplices, radii = [np.empty((0, 3, 3))], [np.empty(0)]
    for part in parts:
        _, corners, dim = part.simplices.shape
        triangles = part.simplices[:, np.minimum(range(3), corners - 1)]
        simplices.append(np.pad(triangles, ((0, 0), (0, 0), (0, 3 - dim))))
        radii.append(part.radii)
    return Pieces(np.concatenate(simplices), np.concatenate(radii))


def clipped(border: Pieces, grid: Grid) -> Pieces:
    """What of a border lies in the grid's closed box; what is round and reaches it stays whole."""
    simplices, lower, upper = border.simplices, np.asarray(grid.lower), np.asarray(grid.upper)
    low, high = simplices.min(axis=1), simplices.max(axis=1)
    if ((low >= lower) & (high <= upper)).all():
        return border
    if simplices.shape[1] == 1 or border.radii.any():
        # What is that far does not reach the grid, and its square would overflow.
        apart = np.sqrt((np.clip(np.maximum(lower - high, low - upper), 0.0, 1e100) ** 2).sum(axis=1))
        near = apart <= border.radii * (1.0 + 1e-9) + 1e-9 * grid.spacing
        return Pieces(simplices[near], border.radii[near])
    for axis in range(grid.dim):
        for wall, sign in ((lower[axis], 1.0), (upper[axis], -1.0)):
            simplices = _cut(simplices, axis, wall, sign)
    return _bare(simplices)


def parts_of(border: Pieces) -> tuple[Floats, Ints]:
    """Corners of a border, shape (n, d), connected part by connected part, and where each part begins."""
    corners, dim = border.simplices.shape[1:]
    points, which = np.unique(border.simplices.reshape(-1, dim), axis=0, return_inverse=True)
    rows = which.reshape(-1, corners)
    start, end = rows[:, :-1].ravel(), rows[:, 1:].ravel()
    labels = component_labels(start, end, len(points))
    order = np.argsort(labels, kind="stable")
    return np.ascontiguousarray(points[order]), np.flatnonzero(np.diff(labels[order], prepend=-1))


def anchors_of(border: Pieces) -> tuple[Floats, Floats]:
    """One point of each connected part of a border, shape (n, d), and how large the part is, metres, shape (n,)."""
    points, starts = parts_of(border)
    if not len(points):
        return points, np.empty(0)
    low, high = np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)
    return points[starts], (high - low).max(axis=1)


def _cut(simplices: Floats, axis: int, wall: float, sign: float) -> Floats:
    """What of segments or triangles lies where ``sign * (coordinate - wall)`` is zero or above."""
    corners = simplices.shape[1]
    height = sign * (simplices[:, :, axis] - wall)
    inside = height >= 0.0
    count = inside.sum(axis=1)
    parts = [simplices[count == corners]]
    for number in range(1, corners):
        chosen = np.flatnonzero(count == number)
        # The corner that is alone on its side comes first.
        alone = np.argmax(inside[chosen] == (number == 1), axis=1)
        turned = (alone[:, None] + np.arange(corners)) % corners
        first, *others = np.moveaxis(simplices[chosen[:, None], turned], 1, 0)
        h, *heights = np.moveaxis(height[chosen[:, None], turned], 1, 0)
        crossings = [first + (h / (h - g))[:, None] * (p - first) for p, g in zip(others, heights, strict=True)]
        for crossing in crossings:
            crossing[:, axis] = wall
        if number == 1:
            parts.append(np.stack([first, *crossings], axis=1))
        else:
            (ab, ac), (b, c) = crossings, others
            parts += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    return np.concatenate(parts)


def _lids(shape: ExactShape, workspace: Workspace) -> Iterator[Floats]:
    """Where a shape is cut open on the border of the grid."""
    grid, (low, high) = workspace.grid, shape.bounds
    for axis in range(grid.dim):
        for upper, crosses in ((0, low[axis] < grid.lower[axis]), (1, high[axis] > grid.upper[axis])):
            if crosses:
                yield from _LIDS[grid.dim](shape, workspace, axis, upper)


def _cells_on(shape: ExactShape, workspace: Workspace, axis: int, upper: int) -> Iterator[Floats]:
    """In space: the outer cells on a side of the grid, across an axis."""
    columns = np.moveaxis(workspace.outer, axis, 0)
    sides = np.zeros((columns.shape[0] + 1, *columns.shape[1:]), dtype=np.bool_)
    sides[-upper] = columns[-upper]
    yield rectangle_triangles(sides, axis, workspace.grid.spacing, workspace.grid.lower)


def _filled_on(shape: ExactShape, workspace: Workspace, axis: int, upper: int) -> Iterator[Floats]:
    """In the plane: what of a side of the grid, across an axis, lies in the shape."""
    return (_lid(region, workspace.grid, axis, upper) for region in shape.regions)


_LIDS: Final = {2: _filled_on, 3: _cells_on}


def _lid(region: Floats, grid: Grid, axis: int, upper: int) -> Floats:
    """Segments of a side of the grid, across an axis, that lie in a region; shape (n, 2, 2)."""
    wall, along = (grid.lower, grid.upper)[upper][axis], 1 - axis
    first, last = np.moveaxis(region.reshape(-1, 2, 2), 1, 0)
    # Closed curves cross a line an even number of times, if a corner on it counts as below: between, one is inside.
    crosses = (first[:, axis] <= wall) != (last[:, axis] <= wall)
    first, last = first[crosses], last[crosses]
    share = (wall - first[:, axis]) / (last[:, axis] - first[:, axis])
    at = np.sort(first[:, along] + share * (last[:, along] - first[:, along]))
    endpoints = np.full((len(at) // 2, 2, 2), wall)
    endpoints[:, :, along] = np.clip(at.reshape(-1, 2), grid.lower[along], grid.upper[along])
    return endpoints[endpoints[:, 0, along] < endpoints[:, 1, along]]


def _bare(simplices: Floats) -> Pieces:
    return Pieces(simplices, np.zeros(len(simplices)))
