"""Contents of a picture: a map, a path, marked configurations, and the robot along the path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import BLOCKED, FREE, Bools, Floats, Ints
from cspace.check import check_finite, check_positive
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.shapes.balls import Balls
from cspace.shapes.shape import Shape

if TYPE_CHECKING:
    from cspace.configuration_space import ConfigurationSpace
    from cspace.space import CSpace
    from cspace.workspace import Workspace

DEFAULT_ROBOTS_PER_PATH: Final = 12
"""Default number of robots drawn along a path, roughly."""
_MAX_ROBOT_DENSITY: Final = 50.0
"""Maximum factor by which zooming increases the number of robots per path length."""
_MAX_ROBOT_TRIANGLES: Final = 2000
"""Maximum number of triangles of a drawn robot."""


class HasPath(Protocol):
    """A plan, or another object with a path."""

    @property
    def path(self) -> Floats:
        """Configurations, shape (n, size)."""


MapLike: TypeAlias = "CSpace | Part | WorkspaceView"
"""A map in memory, a part of one, or a workspace without a robot."""

HasAxes: TypeAlias = "ConfigurationSpace | MapLike"
"""A space whose configurations have named coordinates."""


class RobotGlyph:
    """A drawable robot: outlines in the plane, triangles in space.

    Attributes
    ----------
    points : ndarray of float64, shape (n, d)
        Corners, in the robot's frame.
    rings : list of ndarray of float64, shape (n, 2)
        Closed outlines of a robot in the plane.
    nose : ndarray of float64, shape (4, 2)
        Triangle at the front of a plane robot, which shows its heading.
    triangles : ndarray of float64, shape (n, 3, d)
        Triangles of a robot in space.
    reach : float
        Distance of the farthest corner from the reference point, metres.
    size : float
        Diagonal of the box around the robot and its reference point, metres.
    shown : bool
        False if the robot is not drawn.
    """

    def __init__(self, robot: Robot, rotations: Rotations) -> None:
        self.dim, self.rotations, self.shown = robot.dim, rotations, robot.shape.shown
        self.points, self.rings, self.nose, self.triangles = _GLYPH_PARTS[robot.dim](robot.shape)
        self.reach = float(np.linalg.norm(self.points, axis=1).max())
        with_origin = np.vstack([self.points, np.zeros(self.dim)])
        self.size = float(np.linalg.norm(np.ptp(with_origin, axis=0)))
        self._silhouettes: dict[tuple[float, ...], list[Floats]] = {}  # by rotation and pair of axes

    def transform(self, points: Floats, q: Floats) -> Floats:
        """Transform points, shape (..., d), from the robot's frame to the map's."""
        return np.asarray(points @ self.rotations.rotation_matrices(q).T + q[: self.dim])

    def extent(self, q: Floats) -> Floats:
        """Return lower and upper corner of the robot and its reference point.

        The result has shape (2, d).
        """
        points = np.vstack([self.transform(self.points, q), q[: self.dim]])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def outlines(self, q: Floats, pair: Sequence[int] = (0, 1)) -> list[Floats]:
        """Return closed outlines at a configuration, projected on two axes.

        The result has shape (n, 2).
        """
        if self.rings:
            return [self.transform(ring, q) for ring in self.rings]
        position, rotation = np.split(q, [self.dim])
        key = (*rotation.tolist(), *pair)
        if key not in self._silhouettes:
            self._silhouettes[key] = self._project(np.concatenate([np.zeros_like(position), rotation]), pair)
        return [ring + position[list(pair)] for ring in self._silhouettes[key]]

    def _project(self, q: Floats, pair: Sequence[int]) -> list[Floats]:
        import shapely

        triangles = shapely.polygons(self.transform(self.triangles, q)[..., list(pair)])
        outlines = outline_rings(
            shapely.union_all(triangles[shapely.area(triangles) > 0.0], grid_size=1e-9 * self.size)
        )
        # Rounding leaves thin gaps between triangles, which would appear as dashes.
        return [ring for ring in outlines if shapely.Polygon(ring).area > 1e-6 * self.size**2]

    def noses(self, q: Floats) -> list[Floats]:
        """Return the nose at a configuration, if it has a heading."""
        return [self.transform(self.nose, q)] if len(self.nose) and self.rotations.find_yaw(q) is not None else []

    def path_lengths(self, points: Floats) -> Floats:
        """Return the length of a path up to each configuration.

        The result has shape (n,), metres. A rotation counts as the distance that the robot's farthest point moves.
        """
        steps = self.rotations.steps_between(points[:-1], points[1:])
        angles = np.linalg.norm(steps[:, self.dim :], axis=1)
        lengths = np.linalg.norm(steps[:, : self.dim], axis=1) + self.reach * angles
        return np.concatenate([[0.0], np.cumsum(lengths)])

    def interpolate(self, points: Floats, shares: Floats) -> Floats:
        """Interpolate a path at shares, 0 to 1, of its length.

        The result has shape (n, size).
        """
        lengths = self.path_lengths(points)
        index = np.interp(shares * lengths[-1], lengths, np.arange(len(points)))
        first = np.minimum(index.astype(np.int64), max(len(points) - 2, 0))
        steps = self.rotations.steps_between(points[first], points[np.minimum(first + 1, len(points) - 1)])
        return self.rotations.add_steps(points[first], (index - first)[:, np.newaxis] * steps)


class Part:
    """The cells of a map in a box around a point.

    The box is a square or a cube, clipped to the map; its side is the longest side of the map over ``zoom``.
    """

    def __init__(self, space: MapLike, point: Floats, zoom: float) -> None:
        whole: Grid = space.grid
        side = math.ceil(max(whole.shape) / zoom)
        begin = np.rint((point - whole.lower) / whole.spacing - 0.5 * side).astype(np.int64)
        first = np.clip(begin, 0, np.array(whole.shape) - 1)
        stop = np.clip(begin + side, first + 1, whole.shape)
        self._space, self._box = space, tuple(map(slice, first.tolist(), stop.tolist()))
        corner, shape = whole.lower + whole.spacing * first, (stop - first).tolist()
        self.grid: Grid = Grid(corner, whole.spacing, shape, whole.axes, whole.units)
        self.axes: tuple[str, ...] = space.axes
        self.rotations: Rotations = space.rotations
        self.robot: Robot = space.robot
        self.slice_of: Ints = space.slice_of
        self.slice_rotations: Floats = space.slice_rotations

    @property
    def workspace(self) -> Ground:
        """Cells of the workspace in the box."""
        workspace = self._space.workspace
        return Ground(workspace.outer[self._box], None if workspace.unknown is None else workspace.unknown[self._box])

    def states_at(self, rotation: ArrayLike, /) -> NDArray[np.uint8]:
        """Return the states of the cells at a rotation."""
        return self._space.states_at(rotation)[self._box]


class WorkspaceView:
    """A workspace as a map without a robot: BLOCKED in obstacles, FREE elsewhere."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace, self.grid = workspace, workspace.grid
        self.axes = ("x", "y", "z")[: self.grid.dim]
        self.rotations = Rotations.of(None)
        self.slice_of, self.slice_rotations = np.zeros(1, dtype=np.int64), self.rotations.centers
        dot = Balls(np.zeros((1, self.grid.dim)), np.ones(1))
        self.robot = Robot(Path(workspace.source).name, dot)  # not drawn; titles show the name

    def states_at(self, rotation: ArrayLike, /) -> NDArray[np.uint8]:
        """Return the states of a point robot at the cell centers."""
        return np.where(self.workspace.outer, np.uint8(BLOCKED), np.uint8(FREE))


class Ground(NamedTuple):
    """Cells of a workspace, or of a part of it."""

    outer: Bools
    unknown: Bools | None


class Look(NamedTuple):
    """Options of a picture; see :func:`cspace.plot.plot`."""

    rotation: Any = None
    ax: Any = None
    center: Any = None
    zoom: float | None = None
    surface: str | None = None
    cut: float | None = None
    camera: Any = None
    legend: bool = True
    title: str | None = None


@dataclass(frozen=True)
class Route:
    """Path, marks and robots of a picture.

    Attributes
    ----------
    points : ndarray of float64, shape (n, size)
        The path; n is 0 without a path.
    marks : dict of str to ndarray of float64, shape (size,)
        Start and goal, if given.
    stations : ndarray of float64, shape (m, size)
        Configurations of the drawn robots: along the path, then at the marks, which are drawn over the others.
    glyph : RobotGlyph
    cut : bool
        True if the picture ends at the border of the grid.
    lost : ndarray of bool, shape (n - 1,)
        Steps of the path that are no longer proven free.
    shown : ndarray of bool, shape (n - 1,), or None
        Steps of the path to draw; None draws all.
    """

    points: Floats
    marks: dict[str, Floats]
    stations: Floats
    glyph: RobotGlyph
    cut: bool = False
    lost: Bools = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    shown: Bools | None = None

    @classmethod
    def of(
        cls, space: MapLike, path: Any, start: Any, goal: Any, every: float | None = None, zoom: float | None = None
    ) -> Route:
        """Return a route from the arguments of :func:`cspace.plot.plot`.

        ``every`` is ``robot_every``. Raises InputError if an argument has the wrong shape or is not finite, or if
        ``every`` is not above zero.
        """
        points = check_path(space, path)
        marks = collect_marks(space, path, points, start, goal)
        glyph = RobotGlyph(space.robot, space.rotations)
        return cls(
            points,
            marks,
            np.concatenate([_stations(points, every, glyph, zoom or 1.0), *(q[np.newaxis] for q in marks.values())]),
            glyph,
            lost=find_lost_steps(space, path),
        )

    def clip_to(self, grid: Grid) -> Route:
        """Return the route with the marks and robots in a grid only."""
        visible = []
        for q in self.stations:
            low, high = self.glyph.extent(q)
            visible.append(bool((low < grid.upper).all() and (high > grid.lower).all()))
        marks = {name: q for name, q in self.marks.items() if grid.contains(q[: grid.dim])}
        return replace(self, marks=marks, stations=self.stations[np.array(visible, dtype=np.bool_)], cut=True)

    def box(self, space: MapLike, robots: bool = True) -> Floats:
        """Return the corners of grid, path and robots, shape (2, d)."""
        dim = space.grid.dim
        if self.cut:
            return np.array([space.grid.lower, space.grid.upper])
        shown = [self.glyph.extent(q) for q in self.stations] if robots else [self.stations[:, :dim]]
        points = np.concatenate([[space.grid.lower, space.grid.upper], self.points[:, :dim], *shown])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def interpolate(self, shares: Floats) -> Floats:
        """Interpolate the path at shares, 0 to 1, of its length.

        The result has shape (n, size).
        """
        return self.glyph.interpolate(self.points, shares)

    @property
    def drawn(self) -> Floats:
        """Points of the path, with gaps at steps not :attr:`shown`."""
        return self.points if self.shown is None else with_gaps(self.points, self.shown)

    @property
    def lost_parts(self) -> Floats:
        """Points of the :attr:`lost` steps with gaps, shape (k, size)."""
        return with_gaps(self.points, self.lost)


def outline_rings(geometry: Any) -> list[Floats]:
    """Return the closed outlines of a geometry, holes included.

    The result has shape (n, 2).
    """
    from shapely.geometry.polygon import orient

    # Holes must have the opposite orientation; otherwise they would be filled.
    parts = [orient(part) for part in getattr(geometry, "geoms", [geometry])]
    return [np.asarray(ring.coords)[:, :2] for part in parts for ring in (part.exterior, *part.interiors)]


def check_path(space: HasAxes, path: Any) -> Floats:
    """Return a path or a plan's path as an array.

    The result has shape (n, size). Raises InputError otherwise.
    """
    values = getattr(path, "path", path)
    points = np.empty(0) if values is None else check_finite(values, "path")
    if points.shape == (0,):
        return np.empty((0, len(space.axes)))
    if points.ndim != 2 or points.shape[1] != len(space.axes):
        hint = f"pass rows of ({', '.join(space.axes)})"
        raise InputError("path", f"has shape {points.shape}", f"it must be (n, {len(space.axes)})", hint, value=path)
    return points


def find_lost_steps(space: HasAxes, path: Any) -> Bools:
    """Return a mask of the path's steps no longer proven free.

    The result has shape (n - 1,). The edges are checked on the drawn map, or on the plan's own map if their grids
    differ, as for an overview. A path without a plan, or of a plan that was not certified, has no such steps.
    """
    steps = np.zeros(max(len(getattr(path, "path", ())) - 1, 0), dtype=np.bool_)
    planned = getattr(path, "space", None)
    if planned is None or not len(steps) or not getattr(path, "certified", False):
        return steps
    is_same = type(space) is type(planned) and getattr(space, "grid", None) == getattr(planned, "grid", None)
    lost = ~path.recheck(space if is_same else planned)
    # Waypoints are rows of the path; the steps between two waypoints lie on one edge.
    start = 0
    for waypoint, is_lost in zip(path.waypoints[1:], lost.tolist(), strict=False):
        stop = start + 1 + int((path.path[start + 1 :] == waypoint).all(axis=1).argmax())
        steps[start:stop] = is_lost
        start = stop
    return steps


def with_gaps(points: Floats, chosen: Bools) -> Floats:
    """Return chosen steps of a path, with NaN after each run.

    ``chosen`` has shape (n - 1,). A line through the rows has gaps at the other steps.
    """
    steps = np.flatnonzero(chosen)
    runs = np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1) if len(steps) else []
    gap = np.full((1, points.shape[1]), np.nan)
    return np.concatenate([points[:0], *(part for run in runs for part in (points[run[0] : run[-1] + 2], gap))])


def collect_marks(space: HasAxes, path: Any, points: Floats, start: Any, goal: Any) -> dict[str, Floats]:
    """Return start and goal by name.

    By default, the path or plan gives them.
    """
    marks = {}
    for name, given, end in (("start", start, 0), ("goal", goal, -1)):
        if given is None and not len(points):
            given = getattr(path, name, None)
        if given is not None:
            marks[name] = check_finite(given, name)
            if (shape := marks[name].shape) != (len(space.axes),):
                hint = f"pass ({', '.join(space.axes)})"
                raise InputError(name, f"has shape {shape}", f"it must be ({len(space.axes)},)", hint, value=given)
        elif len(points):
            marks[name] = points[end]
    return marks


def _stations(points: Floats, every: float | None, glyph: RobotGlyph, zoom: float) -> Floats:
    """Return the configurations along a path at which to draw the robot.

    The result has shape (n, size).
    """
    if every is not None and every != math.inf:
        every = check_positive(every, "robot_every")
    if len(points) < 2 or every == math.inf:
        return points[:0]
    length = float(glyph.path_lengths(points)[-1])
    if every is None:
        every = max(length / (DEFAULT_ROBOTS_PER_PATH * min(zoom, _MAX_ROBOT_DENSITY)), 0.75 * glyph.size)
    count = math.ceil(length / every)
    return glyph.interpolate(points, np.arange(1, count) / max(count, 1))


def _plane_parts(shape: Shape) -> tuple[Floats, list[Floats], Floats, Floats]:
    """Return points, rings, nose and triangles of a plane robot."""
    outlines = outline_rings(shape.outer.outline)
    points = np.concatenate(outlines)
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    center, half, back = (bottom + top) / 2, (top - bottom) / 5, right - 0.25 * (right - left)
    nose = np.array([(right, center), (back, center + half), (back, center - half), (right, center)])
    return points, outlines, nose, np.empty((0, 3, 2))


def _solid_parts(shape: Shape) -> tuple[Floats, list[Floats], Floats, Floats]:
    """Return points, rings, nose and triangles of a robot in space."""
    points, faces = simplify_surface(*shape.outer.surface)
    return points, [], np.empty((0, 2)), points[faces]


_GLYPH_PARTS: Final = {2: _plane_parts, 3: _solid_parts}


def simplify_surface(vertices: Floats, faces: Ints, max_faces: int = _MAX_ROBOT_TRIANGLES) -> tuple[Floats, Ints]:
    """Merge close vertices until at most ``max_faces`` triangles remain.

    Source: Rossignac and Borrel (1993).
    """
    steps = 64
    while len(faces) > max_faces and steps > 1:
        cells = np.floor((vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max() * steps).astype(np.int64)
        _, cluster = np.unique(cells, axis=0, return_inverse=True)
        cluster = cluster.reshape(-1)
        counts = np.bincount(cluster)
        vertices = np.stack([np.bincount(cluster, column) / counts for column in vertices.T], axis=-1)
        faces = np.unique(np.sort(cluster[faces], axis=1), axis=0)
        faces = faces[(np.diff(faces, axis=1) > 0).all(axis=1)]
        steps //= 2
    return vertices, faces


def choose_section_point(space: MapLike, center: Any, route: Route) -> Floats:
    """Return the point of the grid through which sections are cut.

    Default: half the way along the path; without a path the start, the goal, or the center of the grid. Raises
    InputError if ``center`` is not a point of the grid.
    """
    grid = space.grid
    if center is None:
        candidates = [route.interpolate(np.array([0.5]))[0]] if len(route.points) else list(route.marks.values())
        position = candidates[0][: grid.dim] if candidates else (np.add(grid.lower, grid.upper)) / 2
        return np.clip(position, grid.lower, grid.upper)
    point = check_finite(center, "center")
    if point.shape != (grid.dim,):
        hint = f"pass ({', '.join(space.axes[: grid.dim])}) in metres"
        raise InputError("center", f"has shape {point.shape}", f"it must be ({grid.dim},)", hint, value=center)
    if not grid.contains(point):
        given, low, high = (f"({', '.join(f'{v:g}' for v in corner)})" for corner in (point, grid.lower, grid.upper))
        raise InputError(
            "center", f"is {given}", f"the grid is from {low} to {high}", "pass a point in it", value=center
        )
    return point


def clip_path(points: Floats, axis: int, low: float, high: float) -> Floats:
    """Clip a path to the range ``low`` to ``high`` of an axis.

    Each part of a step is two rows followed by a row of NaN, so that a line through all rows has gaps. The result has
    shape (n, size).
    """
    first, steps = points[:-1], np.diff(points, axis=0)
    begin, rate = first[:, axis], steps[:, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.sort([(low - begin) / rate, (high - begin) / rate], axis=0)
    is_level = rate == 0.0
    inside = (low <= begin) & (begin <= high)
    start = np.where(is_level, np.where(inside, 0.0, 2.0), np.maximum(shares[0], 0.0))
    stop = np.where(is_level, 1.0, np.minimum(shares[1], 1.0))
    visible = start <= stop
    rows = [first[visible] + share[visible, np.newaxis] * steps[visible] for share in (start, stop)]
    gaps = np.full((int(visible.sum()), points.shape[1]), np.nan)
    return np.stack([*rows, gaps], axis=1).reshape(-1, points.shape[1])
