"""Collisions on lanes: the first configurations that are not free, and what the robot touches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import shapely

from cspace import BLOCKED, FREE, Rotations
from cspace.inside import (
    Bools,
    Floats,
    Ints,
    Raster,
    States,
    contents_of,
    number_parts,
    rasters_of,
)
from cspace.lanes._lane_motions import LaneMotions, find_shares_near_map

if TYPE_CHECKING:
    from cspace import CSpace
    from cspace.inside import ConfigurationMap

MAX_SAMPLES: Final = 2**20
"""Approximate number of configurations that are classified at once."""

MIN_DEPTH: Final = 1e-7
"""Depth of a point of the robot, metres, which proves a collision in spite of rounding."""

BORDER: Final = "the border of the map"
"""Name of the space outside the map as an obstacle."""


class Hit(NamedTuple):
    """The configuration for which a lane is not free; the least of several counts.

    Attributes
    ----------
    is_open : bool
        False if it is proven in collision.
    along : float
        See :class:`Samples`.
    point : tuple of float
    obstacle : str
        What the robot touches; empty if nothing is proven.
    """

    is_open: bool
    along: float
    point: tuple[float, ...]
    obstacle: str = ""


class Samples(NamedTuple):
    """Configurations on lanes that are not FREE, in the order of lanes and along these.

    Attributes
    ----------
    points : ndarray of float64, shape (n, size)
    lanes : ndarray of int64, shape (n,)
    along : ndarray of float64, shape (n,)
        Place along the lane: the place of the motion, and the share of the motion.
    states : ndarray of uint8, shape (n,)
    """

    points: Floats
    lanes: Ints
    along: Floats
    states: States

    def take(self, rows: Ints | Bools) -> Samples:
        """Return some of the samples."""
        return Samples._make(column[rows] for column in self)

    def hit(self, row: int, obstacle: str) -> Hit:
        """Return a hit at a sample."""
        point = tuple(self.points[row].tolist())
        return Hit(not obstacle, float(self.along[row]), point, obstacle)


def sample_motions(space: CSpace, motions: LaneMotions) -> Samples:
    """Return the configurations on motions that are not FREE.

    They are a fraction of a cell apart around the map. Beyond, all are in one state, that of the
    ends of motions.
    """
    steps = space.steps_between(motions.starts, motions.ends)
    enter, leave = find_shares_near_map(space, motions.starts, steps)
    # Number of configurations for each cell of a lane among which the first collision is searched.
    parts = (leave - enter) * np.hypot(*steps[:, :2].T) * 4.0 / space.grid.spacing
    if space.rotations.names:
        # Largest rotation between two sampled configurations.
        parts = np.maximum(parts, np.abs(steps[:, 2]) / 0.035)
    counts = np.where(motions.on_lane, np.maximum(np.ceil(parts), 1.0), 1.0).astype(np.int64) + 3
    found = [Samples(steps[:0], motions.lanes[:0], steps[:0, 0], np.zeros(0, np.uint8))]
    batches = np.cumsum(counts) // MAX_SAMPLES
    for batch in np.unique(batches):
        chosen = np.flatnonzero(batches == batch)
        owners, numbers = number_parts(counts[chosen])
        rows = chosen[owners]
        # The first and the last configuration are the ends, the others are around the map.
        shares = enter[rows] + (leave - enter)[rows] * (numbers - 1) / (counts[rows] - 3)
        shares[numbers == 0] = 0.0
        shares[numbers == counts[rows] - 1] = 1.0
        points = motions.starts[rows] + shares[:, np.newaxis] * steps[rows]
        points[shares == 1.0] = motions.ends[rows[shares == 1.0]]
        states = np.asarray(space.classify(points))
        along = motions.order[rows] + shares
        samples = Samples(points, motions.lanes[rows], along, states)
        found.append(samples.take(states != FREE))
    joined = Samples._make(map(np.concatenate, zip(*found, strict=True)))
    return joined.take(np.lexsort((joined.along, joined.lanes)))


def find_hits(space: ConfigurationMap, part: CSpace, samples: Samples) -> dict[int, Hit]:
    """Find each sampled lane's hit in a part of a map.

    Cells prove some; on the other lanes, the robot is laid over the obstacles.
    """
    if part.floor is not None:
        return _find_floor_hits(part, samples)
    obstacles = Obstacles(space, part)
    blocked = samples.take(samples.states == BLOCKED)
    blocked = blocked.take(np.unique(blocked.lanes, return_index=True)[1])
    hits = {}
    for number, text in enumerate(obstacles.name_cells(blocked.points)):
        name = text or obstacles.find_overlap(blocked.points[number : number + 1])[1]
        hits[int(blocked.lanes[number])] = blocked.hit(number, name or "an obstacle")
    rest = samples.take(~np.isin(samples.lanes, blocked.lanes))
    lanes, begins = np.unique(rest.lanes, return_index=True)
    stops = np.append(begins, len(rest.lanes))[1:]
    for lane, begin, stop in zip(lanes.tolist(), begins.tolist(), stops.tolist(), strict=True):
        number, name = obstacles.find_overlap(rest.points[begin:stop])
        hits[lane] = rest.hit(begin + number, name)
    return hits


def _find_floor_hits(space: CSpace, samples: Samples) -> dict[int, Hit]:
    """Find each sampled lane's hit for a robot on a floor, which may pass under obstacles.

    Cells prove some; on the other lanes, the shapes in space.
    """
    in_cells = np.isin(samples.lanes, samples.lanes[samples.states == BLOCKED])
    states = samples.states.copy()
    states[~in_cells] = space.exact.classify(samples.points[~in_cells])
    # The first collision of each lane, or else its first configuration that is undecided.
    order = np.lexsort((samples.along, -states.astype(np.int64), samples.lanes))
    lanes, begins = np.unique(samples.lanes[order], return_index=True)
    rasters = rasters_of(contents_of(space), 0.0)
    hits = {}
    for lane, row in zip(lanes.tolist(), order[begins].tolist(), strict=True):
        is_blocked = states[row] == BLOCKED
        text = _name_touched(space, rasters, samples.points[row]) if is_blocked else ""
        hits[lane] = samples.hit(row, text)
    return hits


def _name_touched(space: CSpace, rasters: Sequence[tuple[Raster, Raster]], point: Floats) -> str:
    """Name an obstacle that a robot on a floor touches from everywhere in a cell."""
    scene = space.workspace
    cell = space.rotations.cell_of(point[2:]).item() if space.rotations.names else 0
    _, inner = rasters[space.slice_of[cell]]
    touched = np.argwhere(inner.cells) + inner.lower
    touched[:, :2] += space.grid.cell_of(point[:2])
    in_grid = ((touched >= 0) & (touched < scene.grid.shape)).all(axis=1)
    hits = touched[in_grid]
    hits = hits[scene.inner[tuple(hits.T)]]
    for name, shape in space.obstacles.items():
        _, cells = shape.cells(scene.grid)
        if cells[tuple(hits.T)].any():
            return repr(name)
    if len(hits):
        place = ", ".join(f"{x:.2f}" for x in scene.grid.center_of(hits[0]).tolist())
        return f"the obstacle at ({place})"
    is_border = space.outside == "blocked" and not in_grid.all()
    return BORDER if is_border else "an obstacle"


class Obstacles:
    """The proven insides of obstacles, over which the robot is laid."""

    def __init__(self, space: ConfigurationMap, part: CSpace) -> None:
        """Collect obstacles in a part of a map, named ones first."""
        self.grid, self.inner = part.grid, part.workspace.inner
        self.outline = space.robot.shape.inner.outline
        self.robot = self.outline.buffer(-MIN_DEPTH, join_style="mitre")
        self.outside_blocked = space.outside == "blocked"
        # A part ends where the map goes on.
        self.frame = shapely.box(*space.grid.lower, *space.grid.upper)
        named = part.obstacles
        self.names = list(map(repr, named))
        shapes = [*named.values(), *(part.workspace.shapes or ())]
        outlines = [shape.inner.outline for shape in shapes]
        self.shapes = shapely.intersection(np.array(outlines, dtype=object), self.frame)

    def name_cells(self, points: Floats) -> list[str]:
        """Name a colliding inner cell for each configuration.

        A text is empty if some points of the robot find none, or if obstacles have names.
        """
        lower, upper = np.array(self.outline.bounds).reshape(2, 2)
        # Number of points along each side of the robot that look for the cell that it touches.
        sides = [np.linspace(a, b, 16) for a, b in zip(lower, upper, strict=True)]
        inside = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
        inside = inside[shapely.contains_xy(self.outline, inside)]
        if self.names or not len(inside):
            return [""] * len(points)
        cells = self.grid.cell_of(place_points(inside, points))
        in_grid = ((cells >= 0) & (cells < self.grid.shape)).all(axis=-1)
        hits = np.zeros(in_grid.shape, dtype=np.bool_)
        hits[in_grid] = self.inner[tuple(cells[in_grid].T)]
        firsts = np.arange(len(points)), hits.argmax(axis=1)
        centers = self.grid.center_of(cells[firsts]).tolist()
        texts = [f"the obstacle at ({x:.2f}, {y:.2f})" for x, y in centers]
        return [text if hit else "" for text, hit in zip(texts, hits[firsts], strict=True)]

    def find_overlap(self, points: Floats) -> tuple[int, str]:
        """Return the first configuration that is proven in collision, with the obstacle.

        The text is empty if none is.
        """
        if self.robot.is_empty:  # a point or a line
            return 0, ""
        # Number of configurations of a lane at which the robot is laid over the obstacles at once.
        max_placed_robots = 64
        for begin in range(0, len(points), max_placed_robots):
            number, text = self._find_overlap(points[begin : begin + max_placed_robots])
            if text:
                return begin + number, text
        return 0, ""

    def _find_overlap(self, points: Floats) -> tuple[int, str]:
        """Return as :meth:`find_overlap` for a few configurations."""
        corners = place_points(shapely.get_coordinates(self.robot), points)
        robots = shapely.set_coordinates(np.repeat(self.robot, len(points)), corners.reshape(-1, 2))
        first = np.clip(self.grid.cell_of(corners.min(axis=(0, 1))), 0, None)
        stop = np.clip(self.grid.cell_of(corners.max(axis=(0, 1))) + 1, 0, None)
        cells = np.argwhere(self.inner[tuple(map(slice, first, stop))]) + first
        lower = np.asarray(self.grid.lower) + self.grid.spacing * cells
        boxes = shapely.box(*lower.T, *(lower + self.grid.spacing).T)
        obstacles = np.concatenate([self.shapes, boxes])
        pairs = shapely.STRtree(obstacles).query(robots, predicate="intersects")
        leaving = np.flatnonzero(self.outside_blocked & ~shapely.covers(self.frame, robots))
        number, met = min(map(tuple, pairs.T.tolist()), default=(len(points), 0))
        if len(leaving) and leaving[0] < number:
            return int(leaving[0]), BORDER
        if number == len(points):
            return 0, ""
        if met < len(self.names):
            return number, self.names[met]
        point = shapely.intersection(robots[number], obstacles[met]).representative_point()
        return number, f"the obstacle at ({point.x:.2f}, {point.y:.2f})"


def place_points(offsets: Floats, points: Floats) -> Floats:
    """Return the robot's points (k, 2) at configurations, shape (n, k, 2)."""
    rotations = Rotations.of(1 if points.shape[1] > 2 else None)
    turns = rotations.make_matrices(points[:, 2:], 2)
    return np.asarray(offsets @ turns.swapaxes(1, 2) + points[:, np.newaxis, :2])
