"""Contents of a picture: a map, a path, marked configurations, and the robot along the path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from cspace._robot import Robot
from cspace._rotations import Rotations
from cspace._shapes.balls import Balls
from cspace._support.arrays import BLOCKED, FREE, Bools, Box, Floats, Surface
from cspace._support.check import check_finite, check_positive
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace._interface import ConfigurationSpace
    from cspace._space import CSpace
    from cspace._workspace import Workspace

ROBOTS_PER_PATH: Final = 12
"""Default number of robots drawn along a path, roughly."""
CLUSTERS_PER_SIDE: Final = 20
"""Vertices of a detailed surface are merged on a lattice with this many steps along its side."""
MAX_DETAILED_FACES: Final = 2000
"""Surfaces with more triangles are simplified before they are drawn."""


class HasPath(Protocol):
    """A plan, or another object with a path."""

    @property
    def path(self) -> Floats:
        """Configurations, shape (n, size)."""


class WorkspaceView:
    """A workspace as a map without a robot: BLOCKED in obstacles, FREE elsewhere."""

    def __init__(self, workspace: Workspace) -> None:
        """Give a workspace the attributes of a map that pictures need."""
        self.workspace = workspace
        self.grid = workspace.grid
        self.axes = self.grid.axes
        self.rotations = Rotations.of(None)
        self.slice_rotations = self.rotations.centers
        point = Balls(np.zeros((1, self.grid.dim)), np.ones(1))
        self.robot = Robot(Path(workspace.source).name, point)  # not drawn; the title has its name

    def states_at(self, rotation: ArrayLike, /) -> NDArray[np.uint8]:
        """Return BLOCKED in obstacles and FREE elsewhere."""
        return np.where(self.workspace.outer, np.uint8(BLOCKED), np.uint8(FREE))


MapLike: TypeAlias = "CSpace | WorkspaceView"
"""A map in memory, or a workspace without a robot."""

HasAxes: TypeAlias = "ConfigurationSpace | MapLike"
"""A space whose configurations have named coordinates."""


class Body:
    """A robot to draw: outlines in the plane, triangles in space.

    Attributes
    ----------
    points : ndarray of float64, shape (n, d)
        Corners and the reference point, in the robot's frame.
    rings : list of ndarray of float64, shape (n, 2)
        Closed outlines of a robot in the plane.
    nose : ndarray of float64, shape (4, 2)
        Closed triangle at the front of a plane robot, which shows its heading; else (0, 2).
    triangles : ndarray of float64, shape (n, 3, 3)
        Triangles of a robot in space.
    reach : float
        Largest distance of a corner from the reference point, metres.
    size : float
        Diagonal of the box around the robot and its reference point, metres.
    """

    def __init__(self, robot: Robot, rotations: Rotations) -> None:
        """Take the outlines or triangles of a robot, and measure them."""
        self.dim = robot.dim
        self.rotations = rotations
        self.rings: list[Floats] = []
        self.nose = np.empty((0, 2))
        self.triangles = np.empty((0, 3, 3))
        if robot.dim == 2:
            self.rings = outline_rings(robot.shape.outer.outline)
            corners = np.concatenate(self.rings)
            left, bottom = corners.min(axis=0)
            right, top = corners.max(axis=0)
            # The nose takes the front quarter of the robot, and two fifths of its width.
            back = right - (right - left) / 4
            middle = (bottom + top) / 2
            half = (top - bottom) / 5
            tip = (right, middle)
            self.nose = np.array([tip, (back, middle + half), (back, middle - half), tip])
        else:
            corners, faces = simplify_surface(robot.shape.outer.surface)
            self.triangles = corners[faces]
        self.points = np.vstack([corners, np.zeros(self.dim)])
        self.reach = float(np.linalg.norm(self.points, axis=1).max())
        self.size = float(np.linalg.norm(np.ptp(self.points, axis=0)))

    def transform(self, points: Floats, q: Floats) -> Floats:
        """Transform points, shape (n, d), from the robot's frame to the map's.

        For configurations of shape (..., size), the result has shape (..., n, d).
        """
        turned = points @ np.swapaxes(self.rotations._rotation_matrices(q), -1, -2)
        return np.asarray(turned + q[..., np.newaxis, : self.dim])

    def extents(self, q: Floats) -> Floats:
        """Return lower and upper corners of robot and reference point, shape (..., 2, d)."""
        points = self.transform(self.points, q)
        return np.stack([points.min(axis=-2), points.max(axis=-2)], axis=-2)

    def outlines(self, q: Floats, pair: Sequence[int] = (0, 1)) -> list[Floats]:
        """Return closed outlines at a configuration, projected on two axes."""
        if self.rings:
            return [self.transform(ring, q) for ring in self.rings]
        columns = list(pair)
        # At the origin, so that rounding does not grow with the distance from it.
        position = q[: self.dim]
        corners = self.transform(self.triangles.reshape(-1, 3), q) - position
        triangles = shapely.polygons(corners[:, columns].reshape(-1, 3, 2))
        with_area = triangles[shapely.area(triangles) > 0.0]
        rings = outline_rings(shapely.union_all(with_area, grid_size=1e-9 * self.size))
        # Rounding leaves thin gaps between triangles, which would appear as dashes.
        wide = [ring for ring in rings if shapely.Polygon(ring).area > 1e-6 * self.size**2]
        return [ring + position[columns] for ring in wide]

    def noses(self, q: Floats) -> list[Floats]:
        """Return the nose at a configuration, if it has a heading."""
        if not len(self.nose) or self.rotations._find_yaw(q) is None:
            return []
        return [self.transform(self.nose, q)]


def path_lengths(rotations: Rotations, points: Floats, reach: float = 0.0) -> Floats:
    """Return the length of a path up to each configuration, shape (n,).

    A rotation counts as the distance that a point ``reach`` metres from the reference point moves.
    """
    steps = rotations._steps_between(points[:-1], points[1:])
    dim = points.shape[1] - len(rotations.names)
    angles = np.linalg.norm(steps[:, dim:], axis=1)
    lengths = np.linalg.norm(steps[:, :dim], axis=1) + reach * angles
    return np.concatenate([[0.0], np.cumsum(lengths)])


def interpolate_path(
    rotations: Rotations, points: Floats, shares: Floats, reach: float = 0.0
) -> Floats:
    """Interpolate a path at shares, 0 to 1, of its :func:`path_lengths`; return (n, size)."""
    lengths = path_lengths(rotations, points, reach)
    # Place 1.5 is halfway from row 1 to row 2.
    places = np.interp(shares * lengths[-1], lengths, np.arange(len(points)))
    before = np.minimum(places.astype(np.int64), max(len(points) - 2, 0))
    after = np.minimum(before + 1, len(points) - 1)
    steps = rotations._steps_between(points[before], points[after])
    step_shares = (places - before)[:, np.newaxis]
    return rotations._add_steps(points[before], step_shares * steps)


@dataclass(frozen=True)
class Scene:
    """What a picture shows.

    Attributes
    ----------
    space : CSpace or WorkspaceView
    rotation : ndarray of float64, shape (k,), or None
        Rotation of the slice; None shows all rotations at once.
    window : tuple of slice
        Cells that are drawn.
    box : ndarray of float64, shape (2, d)
        Corners of the picture, metres.
    center : ndarray of float64, shape (d,)
        Point through which sections are cut.
    body : Body
    points : ndarray of float64, shape (n, size)
        The path; n is 0 without a path.
    lost : ndarray of bool, shape (n - 1,)
        Steps of the path that are no longer proven free.
    marks : dict of str to ndarray of float64, shape (size,)
        Start and goal, if given.
    stations : ndarray of float64, shape (m, size)
        Configurations at which the robot is drawn.
    """

    space: MapLike
    rotation: Floats | None
    window: Box
    box: Floats
    center: Floats
    body: Body
    points: Floats
    lost: Bools
    marks: dict[str, Floats]
    stations: Floats


def make_scene(
    space: MapLike,
    *,
    rotation: ArrayLike | None = None,
    path: ArrayLike | HasPath | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    robot_every: float | None = None,
    center: ArrayLike | None = None,
    zoom: float | None = None,
) -> Scene:
    """Check the arguments of :func:`cspace.plot.plot` and return what to draw.

    Raises InputError if an argument has the wrong shape or value.
    """
    grid = space.grid
    rotations = space.rotations
    dim = space.grid.dim
    drawn_rotation = rotations._only_rotation
    if rotation is not None:
        drawn_rotation = rotations._check_rotation(rotation)
    points = check_path(space, path)
    marks = collect_marks(space, path, points, start, goal)
    body = Body(space.robot, rotations)
    point = _choose_center(space, center, body, points, marks)
    # Robots stand along the path, at the start and at the goal.
    stations = _choose_stations(body, points, robot_every, zoom or 1.0)
    stations = np.vstack([stations, *marks.values()])
    if not space.robot.shape.shown:
        stations = np.empty((0, points.shape[1]))
    extents = body.extents(stations)
    lower = np.array(grid.lower)
    upper = np.array(grid.upper)
    first = np.zeros(dim, np.int64)
    stop = np.array(grid.shape)
    if zoom is None:
        # The whole grid, the path and the robots are in view.
        corners = np.concatenate([[lower, upper], points[:, :dim], *extents])
        box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    else:
        # A square or cube of cells around the center, as far as it is in the grid.
        side = math.ceil(max(grid.shape) / zoom)  # cells
        begin = np.rint((point - lower) / grid.spacing - 0.5 * side).astype(np.int64)
        first = np.clip(begin, 0, stop - 1)
        stop = np.clip(begin + side, first + 1, stop)
        box = lower + grid.spacing * np.stack([first, stop])
        marks = {name: q for name, q in marks.items() if (q[:dim].clip(*box) == q[:dim]).all()}
        overlaps = (extents[:, 0] < box[1]) & (extents[:, 1] > box[0])
        stations = stations[overlaps.all(axis=1)]
    window = tuple(map(slice, first.tolist(), stop.tolist()))
    lost = find_lost_steps(space, path)
    return Scene(space, drawn_rotation, window, box, point, body, points, lost, marks, stations)


def outline_rings(geometry: Any) -> list[Floats]:
    """Return the closed outlines of a geometry, holes clockwise, each of shape (n, 2)."""
    polygons = shapely.get_parts(shapely.orient_polygons(geometry))
    rings = [ring for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]
    return [shapely.get_coordinates(ring) for ring in rings]


def check_path(space: HasAxes, path: Any) -> Floats:
    """Return a path or a plan's path as an array of shape (n, size), or raise InputError."""
    values = getattr(path, "path", path)
    points = np.empty(0) if values is None else check_finite(values, "path")
    if points.shape == (0,):
        return np.empty((0, len(space.axes)))
    return _check_coordinates(points, "path", space.axes, ndim=2)


def _check_coordinates(values: Any, name: str, axes: Sequence[str], ndim: int = 1) -> Floats:
    """Return a point or rows with a coordinate for each axis; raise InputError otherwise."""
    points = check_finite(values, name)
    if points.ndim != ndim or points.shape[-1] != len(axes):
        shape = f"(n, {len(axes)})" if ndim == 2 else f"({len(axes)},)"
        raise InputError(
            name,
            f"has shape {points.shape}",
            f"it must be {shape}",
            f"pass ({', '.join(axes)})",
        )
    return points


def find_lost_steps(space: HasAxes, path: Any) -> Bools:
    """Return a mask of the path's steps no longer proven free, shape (n - 1,).

    The edges are checked on the drawn map, or on the plan's own map if their grids differ, as for
    an overview. Only certified plans have such steps.
    """
    step_count = max(len(getattr(path, "path", ())) - 1, 0)
    planned = getattr(path, "space", None)
    if planned is None or not step_count or not getattr(path, "certified", False):
        return np.zeros(step_count, dtype=np.bool_)
    same_kind = type(space) is type(planned)
    is_same = same_kind and getattr(space, "grid", None) == getattr(planned, "grid", None)
    is_lost_edge = ~path.recheck(space if is_same else planned)
    # Waypoints are rows of the path; the steps between two waypoints lie on one edge.
    equals_waypoint = (path.path[:-1, np.newaxis] == path.waypoints).all(axis=2)
    edges = np.cumsum(equals_waypoint.any(axis=1)) - 1
    return np.asarray(is_lost_edge[np.minimum(edges, len(is_lost_edge) - 1)])


def with_gaps(points: Floats, chosen: Bools) -> Floats:
    """Return the chosen steps of a path, each followed by a row of NaN.

    ``chosen`` has shape (n - 1,). A line through the rows has gaps at the other steps.
    """
    starts = points[:-1][chosen]
    ends = points[1:][chosen]
    rows = np.stack([starts, ends, np.full_like(starts, np.nan)], axis=1)
    return rows.reshape(-1, points.shape[1])


def collect_marks(
    space: HasAxes, path: Any, points: Floats, start: Any, goal: Any
) -> dict[str, Floats]:
    """Return start and goal by name, shape (size,); by default, the path or plan gives them."""
    marks = {}
    for name, q, row in (("start", start, 0), ("goal", goal, -1)):
        if q is None:
            q = points[row] if len(points) else getattr(path, name, None)
        if q is not None:
            marks[name] = _check_coordinates(q, name, space.axes)
    return marks


def _choose_stations(body: Body, points: Floats, every: float | None, zoom: float) -> Floats:
    """Choose the configurations along a path, shape (m, size), at which to draw the robot.

    They are at most ``every`` metres apart; infinity gives none. A path of one point is one.
    """
    if every is not None and every != math.inf:
        every = check_positive(every, "robot_every")
    if len(points) < 2 or every == math.inf:
        return points[:1] if every is None else points[:0]
    *_, length = path_lengths(body.rotations, points, body.reach).tolist()
    # By default, about a dozen that overlap little.
    if every is None:
        every = max(length / (ROBOTS_PER_PATH * zoom), 0.75 * body.size)
    intervals = math.ceil(length / every)
    shares = np.arange(1, intervals) / max(intervals, 1)
    return interpolate_path(body.rotations, points, shares, body.reach)


def _choose_center(
    space: MapLike, center: Any, body: Body, points: Floats, marks: dict[str, Floats]
) -> Floats:
    """Choose the point of the grid, shape (d,), through which sections are cut.

    Default: half the way along the path; without a path the start, the goal, or the center of the
    grid. Raises InputError if ``center`` is not a point of the grid.
    """
    grid = space.grid
    if center is None:
        position = np.add(grid.lower, grid.upper) / 2
        if len(points):
            (position,) = interpolate_path(body.rotations, points, np.array([0.5]), body.reach)
        elif marks:
            position, *_ = marks.values()
        return np.clip(position[: grid.dim], grid.lower, grid.upper)
    point = _check_coordinates(center, "center", space.axes[: grid.dim])
    if not grid.contains(point):
        lower, upper = (np.round(corner, 9).tolist() for corner in (grid.lower, grid.upper))
        raise InputError(
            "center",
            f"is {point.tolist()}",
            f"the grid is from {lower} to {upper}",
            "pass a point in it",
        )
    return point


def simplify_surface(surface: Surface) -> Surface:
    """Merge close vertices of a surface with many triangles.

    Source: Rossignac and Borrel (1993).
    """
    vertices, faces = surface
    if len(faces) <= MAX_DETAILED_FACES:
        return vertices, faces
    # Vertices near one node of a lattice become one, and faces that lose a corner vanish.
    spacing = np.ptp(vertices, axis=0).max() / CLUSTERS_PER_SIDE
    nodes = np.rint(vertices / spacing)  # of the lattice
    _, first, clusters = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
    merged = np.sort(clusters.reshape(-1)[faces], axis=1)
    is_triangle = (np.diff(merged, axis=1) > 0).all(axis=1)
    return vertices[first], np.unique(merged[is_triangle], axis=0)
