"""Boundaries of the robot and of the obstacles, as triangles, segments and points."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple, Protocol

import numpy as np

from cspace._bodies import DISTANCE_ROUNDING
from cspace._grid import SLACK, Grid
from cspace._raster.bitmaps import rectangle_triangles
from cspace._record.cells import Map
from cspace._robot import Robot
from cspace._rotations import Rotations
from cspace._shapes import ExactShape, RoundedSimplices
from cspace._shapes.shape import clip_to_half_space
from cspace._support.arrays import Bools, Floats
from cspace._workspace import Workspace


class Proofs(Protocol):
    """Proofs, by geometry, for configurations and edges that cells leave undecided."""

    @property
    def edge(self) -> Callable[..., bool]:
        """Function ``edge(*q0, *q1)`` that returns True for proven free edges.

        An edge with equal endpoints is a point.
        """

    def are_free(self, q0: Floats, q1: Floats) -> Bools:
        """Return whether edges, shapes (n, size), are proven free."""

    def slack(self, points: Floats, lengths: Floats, angles: Floats) -> float:
        """Return a lower bound of (distance - required distance), at least zero.

        The bound, in metres, holds along a free path. The path is given in pieces: their midpoints,
        shape (n, size), their lengths and their rotation angles, shape (n,).
        """


class OwnProofs(Proofs, Protocol):
    """Proofs of a map by other geometry than that of its robot and workspace."""

    def name_nearest(self, q: Floats) -> tuple[str, ...]:
        """Name what is nearest to touching at a configuration, shape (size,)."""


class Problem(NamedTuple):
    """A robot among obstacles, and its map.

    Attributes
    ----------
    map : Map
    rotations : Rotations
    workspace : Workspace
    robot : Robot
    margin : float
        Metres.
    exterior_blocked : bool
        True if everything outside the grid is an obstacle.
    floor : float or None
        Height of the reference point in a workspace in space, metres, if the map is plane.
    """

    map: Map
    rotations: Rotations
    workspace: Workspace
    robot: Robot
    margin: float
    exterior_blocked: bool
    floor: float | None = None

    @property
    def size(self) -> int:
        """Length of a configuration."""
        return self.map.dim + len(self.rotations.names)

    @property
    def lift(self) -> Floats:
        """Vector from the reference point in the plane at z = 0 to that on the floor, metres."""
        return np.array([0.0, 0.0, self.floor or 0.0])

    @property
    def max_coordinate(self) -> float:
        """Largest coordinate of a placed robot point in the grid, metres."""
        grid = self.workspace.grid
        height = float(np.abs(self.lift).max())
        return float(np.abs([*grid.lower, *grid.upper]).max()) + self.robot.shape.span + height

    @property
    def sure_distance(self) -> float:
        """Distance that each free configuration has, metres.

        On a floor, cells keep the margin sideways, and above and below nothing.
        """
        return self.margin if self.floor is None else 0.0

    @property
    def required_distance(self) -> float:
        """Distance that proves a configuration free, metres.

        Callers add the rounding of the configuration.
        """
        rotation_error = self.rotations._slack * self.robot.shape.span
        rounding = DISTANCE_ROUNDING * (self.max_coordinate + self.margin)
        return self.margin + rotation_error + rounding


class ObstacleBoundary(NamedTuple):
    """Boundaries of obstacles.

    Attributes
    ----------
    pieces : list of RoundedSimplices
    are_whole : list of bool
        Whether each boundary is not clipped.
    error : float
        Rounding error of clipping, metres.
    """

    pieces: list[RoundedSimplices]
    are_whole: list[bool]
    error: float


def obstacle_boundary(
    workspace: Workspace, *, exterior_blocked: bool, on_floor: bool = False
) -> ObstacleBoundary:
    """Return boundaries of all obstacles, clipped to the grid.

    Clipped solids get caps on the faces of the grid, unless the exterior is blocked anyway. A robot
    ``on_floor`` may end at ground and ceiling, which get caps, too.

    Raises InputError if an obstacle is a mesh whose inside depends on the spacing.
    """
    pieces_of_obstacles = []
    are_whole = []
    error = 0.0
    first_axis = 0
    if exterior_blocked:
        first_axis = 2 if on_floor else workspace.grid.dim
    capped_axes = range(first_axis, workspace.grid.dim)
    for obstacle in workspace.obstacles:
        shape = obstacle.outer
        boundary = shape.boundary()
        pieces = clip_to_grid(boundary, workspace.grid)
        is_clipped = pieces is not boundary
        if is_clipped and len(pieces.radii):
            # Rounding of a clipped boundary, relative to its largest coordinate.
            error = max(error, 2.0**-48 * float(np.abs(boundary.simplices).max()))
        # Balls and cylinders stay whole, so only faces leave a hole.
        has_inside = shape.encloses and boundary.simplices.shape[1] == workspace.grid.dim
        if is_clipped and has_inside and capped_axes:
            caps = _make_caps(shape, workspace, capped_axes)
            pieces = _make_boundary(np.concatenate([pieces.simplices, *caps]))
        pieces_of_obstacles.append(pieces)
        are_whole.append(not is_clipped)
    return ObstacleBoundary(pieces_of_obstacles, are_whole, error)


def clip_to_grid(border: RoundedSimplices, grid: Grid) -> RoundedSimplices:
    """Clip a boundary to the grid's closed box.

    Balls that reach the box stay whole. A boundary inside the box is returned unchanged.
    """
    simplices = border.simplices
    # A grid that is made to cover a shape may lack a sliver of it, and a wall would be lost there.
    slack = SLACK * grid.spacing  # of outer rasters, too
    lower = np.asarray(grid.lower)
    upper = np.asarray(grid.upper)
    low = simplices.min(axis=1)
    high = simplices.max(axis=1)
    if ((low >= lower - slack) & (high <= upper + slack)).all():
        return border
    if simplices.shape[1] == 1 or border.radii.any():
        # Farther pieces do not reach the grid. Without the cap, the squares of large distances
        # would overflow.
        outside = np.clip(np.maximum(lower - high, low - upper), 0.0, 1e100)
        distances = np.linalg.norm(outside, axis=1)
        # The shares cover the rounding of the distances, so that no piece is missing.
        is_near = distances <= border.radii * (1.0 + 1e-9) + 1e-9 * grid.spacing
        return RoundedSimplices(simplices[is_near], border.radii[is_near])
    for axis in range(grid.dim):
        for wall, sign in ((lower[axis], 1.0), (upper[axis], -1.0)):
            simplices = clip_to_half_space(simplices, axis, wall, sign, slack)
    return _make_boundary(simplices)


def _make_caps(shape: ExactShape, workspace: Workspace, axes: Iterable[int]) -> Iterator[Floats]:
    """Yield a shape's caps on the crossed sides of the grid across some axes.

    They are triangles in space, shape (n, 3, 3), and segments in the plane, shape (n, 2, 2).
    """
    grid = workspace.grid
    low, high = shape.bounds
    for axis in axes:
        sides = []
        if low[axis] < grid.lower[axis]:
            sides.append(_Side(axis, is_upper=False))
        if high[axis] > grid.upper[axis]:
            sides.append(_Side(axis, is_upper=True))
        for side in sides:
            if axis == 2:
                yield _cap_section(shape, grid, side)
            elif grid.dim == 3:
                yield _cap_cells(workspace, side)
            else:
                yield from (_cap_region(region, grid, side) for region in shape.filled_boundaries)


class _Side(NamedTuple):
    """Lower or upper side of the grid across an axis."""

    axis: int
    is_upper: bool


def _cap_cells(workspace: Workspace, side: _Side) -> Floats:
    """Triangulate the faces of outer cells on a side of the grid.

    The result has shape (n, 3, 3).
    """
    layers = np.moveaxis(workspace.outer, side.axis, 0)
    # One layer of faces before each layer of cells, and one after the last.
    faces = np.zeros((layers.shape[0] + 1, *layers.shape[1:]), dtype=np.bool_)
    outermost = -1 if side.is_upper else 0
    faces[outermost] = layers[outermost]
    grid = workspace.grid
    return rectangle_triangles(faces, side.axis, grid.spacing, grid.lower)


def _cap_section(shape: ExactShape, grid: Grid, side: _Side) -> Floats:
    """Triangulate a shape's section at the ground or ceiling of the grid.

    The result has shape (n, 3, 3).
    """
    import shapely

    wall = grid.upper[2] if side.is_upper else grid.lower[2]
    room = SLACK * grid.spacing
    section, _ = shape.slab(wall - room, wall + room, room / 4.0)
    if section is None:
        return np.empty((0, 3, 3))
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(section.outline))
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    return np.insert(corners, 2, wall, axis=2)


def _cap_region(region: Floats, grid: Grid, side: _Side) -> Floats:
    """Return the segments of a grid's side inside a plane region.

    They have shape (m, 2, 2). ``region`` has the ends of the edges around it, shape (n, 4) or (n,
    2, 2).
    """
    axis = side.axis
    along = 1 - axis
    wall = grid.upper[axis] if side.is_upper else grid.lower[axis]
    begin, end = np.moveaxis(region.reshape(-1, 2, 2), 1, 0)
    # A closed curve crosses a line an even number of times if a corner on the line counts as below.
    # So sorted crossings, taken in pairs, bound the intervals inside.
    crosses = (begin[:, axis] <= wall) != (end[:, axis] <= wall)
    begin = begin[crosses]
    end = end[crosses]
    fraction = (wall - begin[:, axis]) / (end[:, axis] - begin[:, axis])
    crossings = np.sort(begin[:, along] + fraction * (end[:, along] - begin[:, along]))
    intervals = np.clip(crossings.reshape(-1, 2), grid.lower[along], grid.upper[along])
    starts, stops = intervals.T
    intervals = intervals[starts < stops]
    segments = np.full((len(intervals), 2, 2), wall)
    segments[:, :, along] = intervals
    return segments


def _make_boundary(simplices: Floats) -> RoundedSimplices:
    """Make a boundary of simplices (n, corners, d)."""
    return RoundedSimplices(simplices, np.zeros(len(simplices)))
