"""What a picture of a map in space shows: the path, the robot along it, and how lengths are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.plot import view
from cspace.plot.view import Floats
from cspace.states import FREE

if TYPE_CHECKING:
    from cspace.robot import Robot
    from cspace.space import CSpace

AXES: Final = "xyz"
THIN: Final = 24.0
"""The largest ratio of the sides that is drawn to scale; beyond it short sides are stretched, as the title says."""
_SAMPLES: Final = 257
"""Configurations along a path among which the best sections are sought."""
_FACES: Final = 2000
"""Triangles of a robot that are drawn at most; its outline is then that of its convex hull."""


@dataclass(frozen=True)
class Journey:
    """A path, its ends and the configurations at which the robot is drawn.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Metres; n is 0 where there is no path.
    marks : dict of str to ndarray, shape (3,)
    stations : ndarray, shape (m, 3)
        The ends come last: they are drawn over the robots on the way.
    """

    points: Floats
    marks: dict[str, Floats]
    stations: Floats

    @classmethod
    def of(cls, space: CSpace, path: Any, start: Any, goal: Any, robot_every: float | None) -> Journey:
        """Check what the caller gave.

        Raises
        ------
        InputError
            As for :func:`cspace.plot.plot`.
        """
        points = view.polyline(space, path)
        marks = view.marks(space, points, start, goal)
        size = float(np.linalg.norm(np.ptp(extent(space.robot), axis=0)))
        stations = view.stations(points, robot_every, size, None)
        return cls(points, marks, np.concatenate([stations, *(q[np.newaxis] for q in marks.values())]))

    def box(self, space: CSpace) -> Floats:
        """Lower and upper corner of what is in view, shape (2, 3): the grid, and what is drawn beyond it."""
        return view.box(space, [self.points, *(q + extent(space.robot) for q in self.stations)])

    def samples(self) -> Floats:
        """Configurations at even steps along the path, or the marks where there is none, shape (n, 3)."""
        if len(self.points):
            return view.along(self.points, np.linspace(0.0, 1.0, _SAMPLES), None)
        return np.array(list(self.marks.values())).reshape(-1, 3)


def extent(robot: Robot) -> Floats:
    """Lower and upper corner of the robot and its reference point, in its frame, shape (2, 3)."""
    lower, upper = robot.body.bounds
    return np.stack([np.minimum(lower, 0.0), np.maximum(upper, 0.0)])


def busiest(samples: Floats, robot: Robot) -> Floats:
    """For each axis, where a section meets the robot at most of the samples of a path, shape (3,)."""
    low, high = extent(robot)
    found = []
    for axis, values in enumerate(samples.T):
        away = values[:, np.newaxis] - values
        counts = ((away >= low[axis]) & (away <= high[axis])).sum(axis=1)
        best = np.flatnonzero(counts == counts.max())
        found.append(values[best[np.abs(best - len(values) // 2).argmin()]])
    return np.array(found)


def near_middle(space: CSpace) -> Floats:
    """Middle of a FREE cell near the middle of the grid; of the grid's middle cell where there is none."""
    shape = np.array(space.grid.shape)
    state, half = space.stack[0], 1
    while True:
        first, stop = np.maximum(shape // 2 - half, 0), np.minimum(shape // 2 + half, shape)
        cells = first + np.argwhere(state[tuple(map(slice, first, stop))] == FREE)
        if len(cells):
            return space.grid.center_of(cells[np.abs(cells - shape // 2).sum(axis=1).argmin()])
        if (stop - first == shape).all():
            return space.grid.center_of(shape // 2)
        half *= 2


def within(points: Floats, axis: int, low: float, high: float) -> Floats:
    """The parts of a path whose coordinate along an axis lies between two numbers, shape (n, 3).

    Each part is two rows, and a row of NaN follows it, so that a line through all rows has gaps.
    """
    first, way = points[:-1], np.diff(points, axis=0)
    begin, rate = first[:, axis], way[:, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(low - begin) / rate, (high - begin) / rate], axis=0)
    level = rate == 0.0
    inside = (low <= begin) & (begin <= high)
    start = np.where(level, np.where(inside, 0.0, 2.0), np.maximum(ends[0], 0.0))
    stop = np.where(level, 1.0, np.minimum(ends[1], 1.0))
    kept = start <= stop
    rows = [first[kept] + share[kept, np.newaxis] * way[kept] for share in (start, stop)]
    gaps = np.full((int(kept.sum()), 3), np.nan)
    return np.stack([*rows, gaps], axis=1).reshape(-1, 3)


def silhouette(robot: Robot, pair: Sequence[int]) -> view.Outline:
    """Outline of the robot as seen along an axis, drawn in two others."""
    import shapely

    vertices, faces = robot.surface
    flat = vertices[:, list(pair)]
    if len(faces) > _FACES:
        return view.Outline(shapely.convex_hull(shapely.multipoints(flat)))
    triangles = shapely.polygons(flat[faces])
    return view.Outline(shapely.union_all(triangles[shapely.area(triangles) > 0.0]))


def triangles_of(robot: Robot) -> Floats:
    """Triangles of the robot, shape (n, 3, 3), metres, in its frame; some hundreds, or a few thousands.

    Corners that lie close together are joined where there are more (Rossignac and Borrel, 1993), and triangles are
    divided where there are fewer, since each is seen or not as a whole.
    """
    vertices, faces = robot.surface
    steps = 64
    while len(faces) > _FACES and steps > 1:
        cells = np.floor((vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max() * steps).astype(np.int64)
        _, number = np.unique(cells, axis=0, return_inverse=True)
        number = number.reshape(-1)
        counts = np.bincount(number)
        vertices = np.stack([np.bincount(number, column) / counts for column in vertices.T], axis=-1)
        faces = np.unique(np.sort(number[faces], axis=1), axis=0)
        faces = faces[(np.diff(faces, axis=1) > 0).all(axis=1)]
        steps //= 2
    triangles = vertices[faces]
    while len(triangles) < _FACES // 4:
        triangles = _quartered(triangles)
    return triangles


def _quartered(triangles: Floats) -> Floats:
    """Triangles, each divided in four, shape (4 n, 3, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def stretches(box: Floats) -> Floats:
    """How much longer a metre along each axis is drawn, shape (3,): 1, but along the short sides of long, thin maps."""
    lengths = box[1] - box[0]
    stretch: Floats = np.maximum(1.0, lengths.max() / THIN / lengths)
    return stretch


def spatial_title(space: CSpace, stretch: Floats, words: str | None) -> str:
    """The given title, or what is shown; where an axis is stretched, it says so."""
    notes = [f"{AXES[axis]} stretched {stretch[axis]:.3g} times" for axis in range(3) if stretch[axis] != 1.0]
    words = view.about(space) if words is None else words
    return f"{words}\n({', '.join(notes)})".strip() if notes else words
