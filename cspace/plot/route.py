"""What a picture shows: a map, the path, the configurations that are marked, and the robot along it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import BLOCKED, FREE, Bools, Floats, Ints
from cspace.check import finite, positive
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

MANY: Final = 12
"""About how many robots are drawn along a path when the caller does not say."""
_CLOSEST: Final = 50.0
"""How many times more of them are drawn at most, where a part of the map is seen."""
_FACES: Final = 2000
"""Triangles of a robot that are drawn at most."""


class HasPath(Protocol):
    """A plan, or anything else with a path."""

    @property
    def path(self) -> Floats: ...


MapLike: TypeAlias = "CSpace | Part | WorkspaceView"
"""What pictures show: a map in memory, a part of one, or a workspace without a robot."""

HasAxes: TypeAlias = "ConfigurationSpace | MapLike"
"""A space whose configurations have named numbers."""


class RobotGlyph:
    """A robot as pictures show it: by its outlines in the plane, and in space by its triangles.

    Attributes
    ----------
    points : ndarray of float64, shape (n, d)
        Corners, in the robot's frame.
    rings : list of ndarray of float64, shape (n, 2)
        Closed outlines of a robot in the plane.
    nose : ndarray of float64, shape (4, 2)
        A triangle at the front of a robot in the plane, which shows where it looks.
    triangles : ndarray of float64, shape (n, 3, d)
        Those of a robot in space.
    reach : float
        Distance of the farthest corner from the reference point, metres.
    size : float
        Diagonal of the box around the robot and its reference point, metres.
    shown : bool
    """

    def __init__(self, robot: Robot, rotations: Rotations) -> None:
        self.dim, self.rotations, self.shown = robot.dim, rotations, robot.shape.shown
        self.points, self.rings, self.nose, self.triangles = _DRAWN[robot.dim](robot.shape)
        self.reach = float(np.linalg.norm(self.points, axis=1).max())
        whole = np.vstack([self.points, np.zeros(self.dim)])
        self.size = float(np.linalg.norm(np.ptp(whole, axis=0)))
        self._silhouettes: dict[tuple[float, ...], list[Floats]] = {}  # of rotations and pairs of axes

    def placed(self, points: Floats, q: Floats) -> Floats:
        """Points of the robot's frame, shape (..., d), where a configuration brings them."""
        return np.asarray(points @ self.rotations.matrices(q).T + q[: self.dim])

    def extent(self, q: Floats) -> Floats:
        """Lower and upper corner of the robot and its reference point at a configuration, shape (2, d)."""
        points = np.vstack([self.placed(self.points, q), q[: self.dim]])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def outlines(self, q: Floats, pair: Sequence[int] = (0, 1)) -> list[Floats]:
        """Closed outlines at a configuration as seen in two axes, each of shape (n, 2)."""
        if self.rings:
            return [self.placed(ring, q) for ring in self.rings]
        place, turn = np.split(q, [self.dim])
        key = (*turn.tolist(), *pair)
        if key not in self._silhouettes:
            self._silhouettes[key] = self._silhouette(np.concatenate([np.zeros_like(place), turn]), pair)
        return [ring + place[list(pair)] for ring in self._silhouettes[key]]

    def _silhouette(self, q: Floats, pair: Sequence[int]) -> list[Floats]:
        import shapely

        triangles = shapely.polygons(self.placed(self.triangles, q)[..., list(pair)])
        outlines = rings(shapely.union_all(triangles[shapely.area(triangles) > 0.0], grid_size=1e-9 * self.size))
        # Rounding leaves gaps between triangles, which would be drawn as dashes.
        return [ring for ring in outlines if shapely.Polygon(ring).area > 1e-6 * self.size**2]

    def noses(self, q: Floats) -> list[Floats]:
        """The nose at a configuration that has a heading; none of a robot without one."""
        return [self.placed(self.nose, q)] if len(self.nose) and self.rotations.heading(q) is not None else []

    def travelled(self, points: Floats) -> Floats:
        """Length of a path from its first configuration to each, metres, shape (n,).

        A turn counts as the distance that the robot's farthest point moves.
        """
        steps = self.rotations.steps(points[:-1], points[1:])
        turns = np.linalg.norm(steps[:, self.dim :], axis=1)
        lengths = np.linalg.norm(steps[:, : self.dim], axis=1) + self.reach * turns
        return np.concatenate([[0.0], np.cumsum(lengths)])

    def along(self, points: Floats, shares: Floats) -> Floats:
        """Configurations at shares, from 0 to 1, of the length of a path, shape (n, size)."""
        place = np.interp(shares * (lengths := self.travelled(points))[-1], lengths, np.arange(len(points)))
        first = np.minimum(place.astype(np.int64), max(len(points) - 2, 0))
        steps = self.rotations.steps(points[first], points[np.minimum(first + 1, len(points) - 1)])
        return self.rotations.moved(points[first], (place - first)[:, np.newaxis] * steps)


class Part:
    """A part of a map, as pictures see it: the cells of a box around a point.

    The point is in its grid, metres. ``zoom`` is the longest side of the whole over that of the box, a square or a
    cube, which is cut off where the map ends.
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
        """Its cells."""
        workspace = self._space.workspace
        return Ground(workspace.outer[self._box], None if workspace.unknown is None else workspace.unknown[self._box])

    def states_at(self, rotation: ArrayLike, /) -> NDArray[np.uint8]:
        """States of its cells at a rotation."""
        return self._space.states_at(rotation)[self._box]


class WorkspaceView:
    """A workspace as pictures of maps see it: without a robot, FREE where it is open and BLOCKED in obstacles."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace, self.grid = workspace, workspace.grid
        self.axes = ("x", "y", "z")[: self.grid.dim]
        self.rotations = Rotations.of(None)
        self.slice_of, self.slice_rotations = np.zeros(1, dtype=np.int64), self.rotations.centers
        dot = Balls(np.zeros((1, self.grid.dim)), np.ones(1))
        self.robot = Robot(Path(workspace.source).name, dot)  # not drawn, and named after the obstacles

    def states_at(self, rotation: ArrayLike, /) -> NDArray[np.uint8]:
        """States of a robot that is a point, at the middle of a cell."""
        return np.where(self.workspace.outer, np.uint8(BLOCKED), np.uint8(FREE))


class Ground(NamedTuple):
    """Cells of a workspace, or of a part of one."""

    outer: Bools
    unknown: Bools | None


class Look(NamedTuple):
    """How a picture is drawn: options of :func:`cspace.plot.plot`."""

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
    """What a picture shows besides the map.

    Attributes
    ----------
    points : ndarray of float64, shape (n, size)
        The path; n is 0 where there is none.
    marks : dict of str to ndarray of float64, shape (size,)
        Start and goal, those that there are.
    stations : ndarray of float64, shape (m, size)
        Where the robot is drawn: along the path, then at the marks, which lie over the others.
    figurine : Figurine
    cut : bool
        Whether what leaves the grid is not shown.
    lost : ndarray of bool, shape (n - 1,)
        Which steps of the path are drawn as no longer proven free.
    shown : ndarray of bool, shape (n - 1,), or None
        Which steps of the path are drawn; all of them if None.
    """

    points: Floats
    marks: dict[str, Floats]
    stations: Floats
    figurine: RobotGlyph
    cut: bool = False
    lost: Bools = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    shown: Bools | None = None

    @classmethod
    def of(
        cls, space: MapLike, path: Any, start: Any, goal: Any, every: float | None = None, zoom: float | None = None
    ) -> Route:
        """Check what the caller gave; ``every`` as ``robot_every`` and ``zoom`` of :func:`cspace.plot.plot`.

        Raises InputError if something has the wrong shape or is not finite, or ``every`` is not above zero.
        """
        points = polyline(space, path)
        marks = marked(space, path, points, start, goal)
        figurine = RobotGlyph(space.robot, space.rotations)
        return cls(
            points,
            marks,
            np.concatenate([_stations(points, every, figurine, zoom or 1.0), *(q[np.newaxis] for q in marks.values())]),
            figurine,
            lost=lost_steps(space, path),
        )

    def within(self, grid: Grid) -> Route:
        """The route in a picture of that grid only: marks that lie in it, and robots that reach into it."""
        seen = []
        for q in self.stations:
            low, high = self.figurine.extent(q)
            seen.append(bool((low < grid.upper).all() and (high > grid.lower).all()))
        marks = {name: q for name, q in self.marks.items() if grid.contains(q[: grid.dim])}
        return replace(self, marks=marks, stations=self.stations[np.array(seen, dtype=np.bool_)], cut=True)

    def box(self, space: MapLike, robots: bool = True) -> Floats:
        """Lower and upper corner of what is in view, shape (2, d): the grid, and what is drawn beyond it."""
        dim = space.grid.dim
        if self.cut:
            return np.array([space.grid.lower, space.grid.upper])
        shown = [self.figurine.extent(q) for q in self.stations] if robots else [self.stations[:, :dim]]
        points = np.concatenate([[space.grid.lower, space.grid.upper], self.points[:, :dim], *shown])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def along(self, shares: Floats) -> Floats:
        """Configurations at shares, from 0 to 1, of the path's length, shape (n, size)."""
        return self.figurine.along(self.points, shares)

    @property
    def drawn(self) -> Floats:
        """The points of the path that are drawn, with gaps where it is not :attr:`shown`."""
        return self.points if self.shown is None else with_gaps(self.points, self.shown)

    @property
    def lost_parts(self) -> Floats:
        """The :attr:`lost` steps, as :func:`with_gaps` returns them, shape (k, size)."""
        return with_gaps(self.points, self.lost)


def rings(geometry: Any) -> list[Floats]:
    """Closed outlines of a geometry, holes included, each of shape (n, 2)."""
    from shapely.geometry.polygon import orient

    # Holes run the other way round than outlines, or they would be filled.
    parts = [orient(part) for part in getattr(geometry, "geoms", [geometry])]
    return [np.asarray(ring.coords)[:, :2] for part in parts for ring in (part.exterior, *part.interiors)]


def polyline(space: HasAxes, path: Any) -> Floats:
    """A path, or that of a plan, as an array, shape (n, size)."""
    values = getattr(path, "path", path)
    points = np.empty(0) if values is None else finite(values, "path")
    if points.shape == (0,):
        return np.empty((0, len(space.axes)))
    if points.ndim != 2 or points.shape[1] != len(space.axes):
        hint = f"pass one configuration ({', '.join(space.axes)}) in a row"
        raise InputError("path", f"has shape {points.shape}", f"it must be (n, {len(space.axes)})", hint, value=path)
    return points


def lost_steps(space: HasAxes, path: Any) -> Bools:
    """Return which steps of a plan's path lie on edges that are no longer proven free, shape (n - 1,).

    The edges are proven on the map that is drawn, or, if that is another view of the plan's map, such as an overview,
    on the plan's map itself. None are lost of a path that is no plan, or was not certified.
    """
    steps = np.zeros(max(len(getattr(path, "path", ())) - 1, 0), dtype=np.bool_)
    planned = getattr(path, "space", None)
    if planned is None or not len(steps) or not getattr(path, "certified", False):
        return steps
    is_same = type(space) is type(planned) and getattr(space, "grid", None) == getattr(planned, "grid", None)
    lost = ~path.recheck(space if is_same else planned)
    # Waypoints are rows of the path; the steps from one to the next lie on one edge.
    first = 0
    for waypoint, is_lost in zip(path.waypoints[1:], lost.tolist(), strict=False):
        last = first + 1 + int((path.path[first + 1 :] == waypoint).all(axis=1).argmax())
        steps[first:last] = is_lost
        first = last
    return steps


def with_gaps(points: Floats, chosen: Bools) -> Floats:
    """Return the rows of the chosen steps of a path, and a row of NaN after each run of them.

    A line through all rows has gaps where no step is chosen, shape (n - 1,).
    """
    steps = np.flatnonzero(chosen)
    runs = np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1) if len(steps) else []
    gap = np.full((1, points.shape[1]), np.nan)
    return np.concatenate([points[:0], *(part for run in runs for part in (points[run[0] : run[-1] + 2], gap))])


def marked(space: HasAxes, path: Any, points: Floats, start: Any, goal: Any) -> dict[str, Floats]:
    """Start and goal by name, those that there are.

    By default they are the first and the last of the path's points, or, where a plan found none, what was asked of it.
    """
    marks = {}
    for name, given, end in (("start", start, 0), ("goal", goal, -1)):
        if given is None and not len(points):
            given = getattr(path, name, None)
        if given is not None:
            marks[name] = finite(given, name)
            if (shape := marks[name].shape) != (len(space.axes),):
                hint = f"pass one configuration ({', '.join(space.axes)})"
                raise InputError(name, f"has shape {shape}", f"it must be ({len(space.axes)},)", hint, value=given)
        elif len(points):
            marks[name] = points[end]
    return marks


def _stations(points: Floats, every: float | None, figurine: RobotGlyph, zoom: float) -> Floats:
    """Configurations along the path at which the robot is drawn, the ends left out, shape (n, size)."""
    if every is not None and every != math.inf:
        every = positive(every, "robot_every")
    if len(points) < 2 or every == math.inf:
        return points[:0]
    length = float(figurine.travelled(points)[-1])
    if every is None:
        every = max(length / (MANY * min(zoom, _CLOSEST)), 0.75 * figurine.size)
    count = math.ceil(length / every)
    return figurine.along(points, np.arange(1, count) / max(count, 1))


def _plane_parts(shape: Shape) -> tuple[Floats, list[Floats], Floats, Floats]:
    """Points, rings, nose and triangles of a robot in the plane."""
    outlines = rings(shape.outer.outline)
    points = np.concatenate(outlines)
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    middle, half, back = (bottom + top) / 2, (top - bottom) / 5, right - 0.25 * (right - left)
    nose = np.array([(right, middle), (back, middle + half), (back, middle - half), (right, middle)])
    return points, outlines, nose, np.empty((0, 3, 2))


def _solid_parts(shape: Shape) -> tuple[Floats, list[Floats], Floats, Floats]:
    """The same of a robot in space."""
    points, faces = simplified(*shape.outer.surface)
    return points, [], np.empty((0, 2)), points[faces]


_DRAWN: Final = {2: _plane_parts, 3: _solid_parts}


def simplified(vertices: Floats, faces: Ints, most: int = _FACES) -> tuple[Floats, Ints]:
    """A surface of at most so many triangles: corners that lie close are joined (Rossignac and Borrel, 1993)."""
    steps = 64
    while len(faces) > most and steps > 1:
        cells = np.floor((vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max() * steps).astype(np.int64)
        _, number = np.unique(cells, axis=0, return_inverse=True)
        number = number.reshape(-1)
        counts = np.bincount(number)
        vertices = np.stack([np.bincount(number, column) / counts for column in vertices.T], axis=-1)
        faces = np.unique(np.sort(number[faces], axis=1), axis=0)
        faces = faces[(np.diff(faces, axis=1) > 0).all(axis=1)]
        steps //= 2
    return vertices, faces


def section_point(space: MapLike, center: Any, route: Route) -> Floats:
    """The point, in the grid, that sections go through, shape (d,).

    Where the caller does not say: half the way along the path; without one, the start, the goal, or the middle.

    Raises InputError if it is not one point of the grid.
    """
    grid = space.grid
    if center is None:
        middle = [route.along(np.array([0.5]))[0]] if len(route.points) else list(route.marks.values())
        place = middle[0][: grid.dim] if middle else (np.add(grid.lower, grid.upper)) / 2
        return np.clip(place, grid.lower, grid.upper)
    point = finite(center, "center")
    if point.shape != (grid.dim,):
        hint = f"pass one point ({', '.join(space.axes[: grid.dim])}) in metres"
        raise InputError("center", f"has shape {point.shape}", f"it must be ({grid.dim},)", hint, value=center)
    if not grid.contains(point):
        given, low, high = (f"({', '.join(f'{v:g}' for v in corner)})" for corner in (point, grid.lower, grid.upper))
        rule = f"it must lie in the grid, from {low} to {high}"
        raise InputError("center", f"is {given}", rule, "pass a point in there", value=center)
    return point


def within(points: Floats, axis: int, low: float, high: float) -> Floats:
    """The parts of a path whose coordinate along an axis lies between two numbers, shape (n, size).

    Each part is two rows, and a row of NaN follows it, so that a line through all rows has gaps.
    """
    first, steps = points[:-1], np.diff(points, axis=0)
    begin, rate = first[:, axis], steps[:, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.sort([(low - begin) / rate, (high - begin) / rate], axis=0)
    level = rate == 0.0
    inside = (low <= begin) & (begin <= high)
    start = np.where(level, np.where(inside, 0.0, 2.0), np.maximum(shares[0], 0.0))
    stop = np.where(level, 1.0, np.minimum(shares[1], 1.0))
    visible = start <= stop
    rows = [first[visible] + share[visible, np.newaxis] * steps[visible] for share in (start, stop)]
    gaps = np.full((int(visible.sum()), points.shape[1]), np.nan)
    return np.stack([*rows, gaps], axis=1).reshape(-1, points.shape[1])
