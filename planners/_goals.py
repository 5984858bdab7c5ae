"""Places with room: sets of poses; a path may end at any.

A room is a ball or a region of positions, with all rotations within an angle of its middle
rotation. Some of its free configurations become goals of searches. Then the path ends where it
first enters a room, or at the nearest configuration of a room that a free edge joins to a waypoint.

No path exists if no component of FREE and MIXED cells meets the start, each place on the way and
the goal.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Final, NamedTuple, cast

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry import MultiPolygon, Polygon

from cspace import CSpace, Goal, Grid, Space
from cspace.errors import ConfigurationError, InputError
from cspace.inside import (
    ANGLE_SLACK,
    METRES_PER_RADIAN,
    NEVER,
    Bools,
    ConfigurationMap,
    Endpoint,
    Floats,
    Ints,
    PlaceLike,
    as_shape,
    check_not_negative,
    check_point,
    find_components,
    gather_goals,
    list_alternatives,
    map_record,
    names_options,
    suggest_radians,
    turn_near,
    wrap_angles,
)
from planners._edges.local_planner import Endpoints, LocalPlanner
from planners._space_kinds import (
    ANY_ROTATION,
    NEAR,
    NEAR_START,
    REGION,
    check_support,
)

REGIONS: Final = (Polygon, MultiPolygon)
"""Types of regions."""

MAX_TRIED_GOALS: Final = 8
"""Largest number of configurations of one room to which paths are searched."""

MAX_PLACES_WITHOUT_FREE: Final = 24
"""Largest number of positions, and of rotations, from which an error finds the nearest FREE
cell."""

INSET: Final = 1e-6
"""Distance in cells, and share of a radius or an angle, by which ends stay inside their room: an
end on its border may touch cells that are not FREE."""

TINY: Final = 1e-300
"""Smallest divisor, in place of zero."""

SLACK_CELLS: Final = 1e-6
SLACKS: Final = np.array([[-SLACK_CELLS], [SLACK_CELLS]])
"""Distances in cells by which rooms grow, for rounding, when cells that meet them are listed; also
as a column, for both corners of a box."""

MAX_NEAR_POSITIONS: Final = 2**10
"""Number of a room's nearest positions that are tested first, and largest number of others."""

MAX_ROWS_PER_BATCH: Final = 2**16
"""Largest number of configurations that are tested together, if rotations are fewer."""

MAX_POSITIONS_WITHOUT_BLOCKS: Final = 2**16
"""Largest number of cells of a slice whose distances from the start are measured without blocks."""

BLOCK_SIDE: Final = 4
"""Cells along each side of blocks on larger maps."""

MAX_SPAN_WITHOUT_BLOCKS: Final = 16
"""Largest extent of a room, in cells, at which straight distances from the start suffice."""

NEAREST_FIRST: Final = 1e-9
"""Weight of the estimate in a search that reaches the nearest blocks first."""

STEPS_PER_CELL: Final = 8
"""Number of places for each cell along a path at which it may end in a room."""

RADIANS_PER_STEP: Final = math.radians(1.0)
"""Largest turn between places at which a path may end in a room, radians."""


@names_options
@dataclass(frozen=True, slots=True, eq=False)
class Near(Goal):
    """All configurations within a distance and an angle of one configuration, as a place of a plan.

    As the goal or a place on the way of :func:`planners.plan`, the path ends where it first comes
    so near. As a start with a yaw, the robot stands at the configuration: the path begins there, or
    if it is not proven free, at nearly the nearest free configuration, and :attr:`Plan.status` says
    so. The robot's motion to the latter is not proven. As a start of any yaw, the path may begin at
    each of these configurations, as it may end at each of a goal.

    Attributes
    ----------
    configuration : array-like
        Pose on a map, with a yaw of None for any; or a region of shapely with a yaw.
    distance : float
        Largest distance from its position, metres, or infinite; 0 for a region, which has its own
        extent.
    angle : float
        Largest angle from its rotation, radians, at most pi. A range of yaws is an angle around its
        middle.
    closest : bool
        Whether the path ends as near as possible: at a position nearest to that of the
        configuration in FREE cells that are joined to all other places, to a millionth of a cell;
        there, at the nearest yaw, or nearly the nearest rotation in space. :attr:`Plan.status` says
        how far that is. For goals and places on the way. A drive may be unable to get there.

    Raises
    ------
    InputError
        If the distance or the angle is negative or NaN, the angle above pi, or
        ``closest`` neither True nor False.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
    >>> round(planners.plan(space, (1.0, 1.5), planners.Near((3.5, 1.5), 0.5)).length, 3)
    2.0
    """

    configuration: PlaceLike
    distance: float = 0.0
    angle: float = 0.0
    closest: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        """Check the numbers, and replace them by floats."""
        if not isinstance(self.closest, bool | np.bool_):
            raise InputError("closest", f"is {self.closest!r}", "it must be True or False")
        if not (isinstance(self.distance, float) and self.distance == math.inf):
            object.__setattr__(self, "distance", check_not_negative(self.distance, "distance"))
        angle = check_not_negative(self.angle, "angle", "radians")
        if angle > math.pi:
            rule = "an angle is at most pi radians"
            raise InputError("angle", f"is {self.angle!r}", rule, suggest_radians(angle))
        object.__setattr__(self, "angle", angle)


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A set of configurations on a map.

    Attributes
    ----------
    name : str
        The argument that it comes from.
    middle : ndarray of float64, shape (size,)
        Its middle position, or a position in the region, and its middle rotation.
    region : Polygon, MultiPolygon or None
        Positions, metres; None if they are a ball.
    radius : float
        Of the ball, metres.
    angle : float
        Largest angle from the middle rotation, radians; pi for any rotation.
    """

    name: str
    middle: Floats
    region: Polygon | MultiPolygon | None = None
    radius: float = 0.0
    angle: float = 0.0

    @property
    def is_point(self) -> bool:
        """Whether it is a single configuration."""
        return self.region is None and not self.radius and not self.angle

    def contains(self, space: Space, rows: Floats) -> Bools:
        """Return whether configurations, shape (n, size), lie in the room."""
        dim = space.dim
        steps = space.steps_between(np.broadcast_to(self.middle, rows.shape), rows)
        if self.region is None:
            inside = np.linalg.norm(steps[:, :dim], axis=1) <= self.radius
        else:
            inside = shapely.intersects_xy(self.region, rows[:, 0], rows[:, 1])
        turns = np.linalg.norm(steps[:, dim:], axis=1)
        return np.asarray(inside & ((turns <= self.angle) | (self.angle >= math.pi)))

    def pull(self, space: ConfigurationMap, rows: Floats) -> Floats:
        """Move configurations, (n, size), into the room by nearly shortest ways."""
        dim = space.dim
        middles = np.broadcast_to(self.middle, rows.shape)
        steps = space.steps_between(middles, rows)
        angle = self.angle if self.angle < math.pi else math.inf
        for part, limit in ((slice(None, dim), self.radius), (slice(dim, None), angle)):
            sizes = np.linalg.norm(steps[:, part], axis=1, keepdims=True)
            steps[:, part] *= np.minimum((1.0 - INSET) * limit / np.maximum(sizes, TINY), 1.0)
        pulled = space.rotations.make_canonical(space.rotations.add_steps(middles, steps))
        if self.region is not None:
            inner_region = self.region.buffer(-INSET * space.grid.spacing)
            region = self.region if inner_region.is_empty else inner_region
            ways = shapely.shortest_line(region, shapely.points(rows[:, :2]))
            nearest = shapely.get_coordinates(ways)[::2]
            is_inside = shapely.contains_xy(region, rows[:, 0], rows[:, 1])
            pulled[:, :2] = np.where(is_inside[:, np.newaxis], rows[:, :2], nearest)
        return pulled

    def find_box(self, space: ConfigurationMap) -> Floats:
        """Return the corners of the box around its positions near the grid, (2, dim)."""
        position = self.middle[: space.dim]
        box = np.array([position - self.radius, position + self.radius])
        if self.region is not None:
            box = np.reshape(self.region.bounds, (2, 2))
        grid = space.grid
        return box.clip(np.subtract(grid.lower, grid.spacing), np.add(grid.upper, grid.spacing))

    def list_positions(self, space: ConfigurationMap) -> Iterator[tuple[Ints, Bools]]:
        """Yield cells of positions that meet the room, shape (n, dim), batch by batch.

        Their order is that of the grid. Each batch has a mask of cells proven to lie in a region.
        """
        grid = space.grid
        spacing = grid.spacing
        low, high = np.floor((self.find_box(space) - np.array(grid.lower)) / spacing + SLACKS)
        last = np.array(grid.shape) - 1
        first, stop = np.clip(low, 0, last + 1), np.clip(high, -1, last) + 1
        shape = tuple((stop - first).astype(int).tolist())
        if min(shape) <= 0:
            return
        outer: Bools = np.broadcast_to(np.True_, shape)
        inner: Bools = np.broadcast_to(np.False_, shape)
        if self.region is not None:
            window = Grid(grid.lower + spacing * first, spacing, shape)
            box = shapely.box(*np.subtract(window.lower, spacing), *np.add(window.upper, spacing))
            near = self.region.intersection(box)  # far corners would be refused
            if near.is_empty:
                return
            grown = near.buffer(2.0 * SLACK_CELLS * spacing)
            outer, inner = as_shape(grown).cells(window)[0], as_shape(near).cells(window)[1]
        side = max(MAX_ROWS_PER_BATCH // math.prod(shape[1:]), 1)
        for begin in range(0, shape[0], side):
            batch = np.argwhere(outer[begin : begin + side])
            is_inner = inner[begin : begin + side][tuple(batch.T)]
            cells = batch + first.astype(np.int64)
            cells[:, 0] += begin
            is_met = is_inner.copy()
            is_met[~is_inner] = self._meets(space, cells[~is_inner])
            yield cells[is_met], is_inner[is_met]

    def _meets(self, space: ConfigurationMap, cells: Ints) -> Bools:
        """Return whether cells of positions, shape (n, dim), meet the room."""
        spacing = space.grid.spacing
        slack = SLACK_CELLS * spacing
        corners = np.array(space.grid.lower) + spacing * cells - slack
        ends = corners + spacing + 2.0 * slack
        if self.region is not None:
            is_met = shapely.contains_xy(self.region, *_find_centers(space, cells).T)
            boxes = shapely.box(*corners[~is_met].T, *ends[~is_met].T)
            is_met[~is_met] = shapely.intersects(self.region, boxes)
            return np.asarray(is_met)
        position = self.middle[: space.dim]
        gaps = np.clip(position, corners, ends) - position
        return np.asarray(np.linalg.norm(gaps, axis=1) <= self.radius + slack)

    def find_positions(self, space: ConfigurationMap) -> Floats:
        """Find a position of the room in each cell that meets it, shape (n, dim).

        The first one is the middle. The others keep off the borders of their cells, as far as the
        room reaches into these.
        """
        middle = self.middle[np.newaxis, : space.dim]
        if self.region is None and not self.radius:
            return middle
        found = [middle]
        for cells, is_inner in self.list_positions(space):
            centers = _find_centers(space, cells)
            if self.region is None:
                found.append(self._place_in_ball(space, centers))
            else:
                found.append(self._place_in_region(self.region, space, centers, is_inner))
        return np.concatenate(found)

    def _place_in_ball(self, space: ConfigurationMap, centers: Floats) -> Floats:
        """Return positions of a ball in cells with these centers, shape (n, dim)."""
        half = 0.5 * space.grid.spacing
        position = self.middle[: space.dim]
        nearest = position.clip(centers - half, centers + half)
        inset = (1.0 - 2.0 * INSET) * half
        steps = position.clip(centers - inset, centers + inset) - nearest
        depths = self.radius - np.linalg.norm(nearest - position, axis=1)
        sizes = np.linalg.norm(steps, axis=1)
        shares = np.minimum((1.0 - INSET) * depths.clip(0.0) / np.maximum(sizes, TINY), 1.0)
        return np.asarray(nearest + shares[:, np.newaxis] * steps)

    def _place_in_region(
        self,
        region: Polygon | MultiPolygon,
        space: ConfigurationMap,
        centers: Floats,
        is_inner: Bools,
    ) -> Floats:
        """Return positions of a region in cells with these centers, shape (n, 2).

        The region contains the cells that ``is_inner`` marks, and may barely touch others, which
        get none.
        """
        half = 0.5 * space.grid.spacing
        border = np.flatnonzero(~is_inner)
        cut = border[~shapely.contains_xy(region, *centers[border].T)]
        boxes = shapely.box(*(centers[cut] - half).T, *(centers[cut] + half).T)
        points = shapely.point_on_surface(shapely.intersection(region, boxes))
        is_met = ~shapely.is_empty(points)
        centers[cut[is_met]] = shapely.get_coordinates(points[is_met])
        return np.delete(centers, cut[~is_met], axis=0)

    def list_rotations(self, space: ConfigurationMap) -> Ints:
        """List the rotation cells that meet the room."""
        angles = np.array([self.angle + 2.0 * ANGLE_SLACK])
        return space.rotations.find_cells_within(self.middle[np.newaxis], angles)[1]

    def find_components(self, space: ConfigurationMap, mixed: bool) -> Ints:
        """Find the components of FREE cells with proven configurations of the room.

        With ``mixed``, find those of FREE and MIXED cells with any cell that meets the room.
        """
        labels = np.array([-1])
        if not mixed:
            turned = self._turn_to_cells(space, INSET)
            for rows, _ in self.list_members(space, self.find_positions(space), turned):
                new = rows[~np.isin(find_components(space, rows), labels)]
                proven = new[space.is_connected(new, new)]
                labels = np.union1d(labels, find_components(space, proven))
            return labels[1:]
        rotations = space.rotations.centers[self.list_rotations(space)]
        batches: Iterator[Floats]
        batches = (_find_centers(space, cells) for cells, _ in self.list_positions(space))
        if not space.grid.contains(self.find_box(space)).all():
            # All cells outside the grid are alike.
            outside = np.array(space.grid.lower) - space.grid.spacing
            batches = itertools.chain(batches, [outside[np.newaxis]])
        for centers, rotation in itertools.product(batches, rotations):
            turned = np.broadcast_to(rotation, (len(centers), len(rotation)))
            rows = np.column_stack([centers, turned])
            labels = np.union1d(labels, find_components(space, rows, mixed))
        return labels[1:]

    def find_goals(
        self, edges: LocalPlanner, start: Endpoint, joined: Ints | None = None
    ) -> list[Endpoint]:
        """Find free configurations of the room, the most promising first.

        If some lie in the components ``joined``, by default that of the start, return only these.
        Raises ConfigurationError if no configuration is proven free.
        """
        space = edges.cells
        origin = np.array([start])
        is_here = self.contains(space, origin) & space.grid.contains(origin[:, : space.dim])
        if is_here[0] and edges.are_free(origin):
            return [start]
        if self.is_point:
            return [edges.space.check_endpoint(self.middle, self.name)]
        if joined is None:
            here = find_components(space, wrap_angles(origin, space.is_periodic), edges.exact)
            joined = here[here >= 0]
        pool = self._find_candidates(edges, start, joined)
        if not len(pool.rows):
            raise self._make_error(space)
        goals = [tuple(q) for q in pool.spread(space).rows.tolist()]
        if self.region is None and self.angle < math.pi:
            # With room around the middle, a path is no longer than to the middle alone.
            with suppress(ConfigurationError):
                goals.insert(0, edges.space.check_endpoint(self.middle, self.name))
        return list(dict.fromkeys(goals))

    def list_members(
        self, space: ConfigurationMap, positions: Floats, turned: Floats
    ) -> Iterator[tuple[Floats, Ints]]:
        """Yield batches of configurations in the room, with the numbers of their positions.

        They have all ``positions``, shape (n, dim), each at the middle's rotation and those of
        configurations ``turned``, shape (m, size).
        """
        rotations = np.vstack([self.middle, turned])[:, space.dim :]
        size = max(MAX_ROWS_PER_BATCH // len(rotations), 1)
        for first in range(0, len(positions), size):
            part = positions[first : first + size]
            numbers = np.tile(np.arange(first, first + len(part)), len(rotations))
            rows = np.hstack([positions[numbers], np.repeat(rotations, len(part), axis=0)])
            kept = self.contains(space, rows) & space.grid.contains(positions[numbers])
            yield rows[kept], numbers[kept]

    def find_closest(self, space: ConfigurationMap, joined: Ints) -> Endpoint:
        """Find the configuration nearest to the middle in components of FREE cells.

        The distance of positions decides, then the angle. Raises ConfigurationError if there is
        none in the components ``joined``.
        """
        dim = space.dim
        positions = self.find_positions(space)
        gaps = np.linalg.norm(positions - self.middle[:dim], axis=1)
        order = np.argsort(gaps, kind="stable")
        turned = self._turn_to_cells(space, INSET)
        for members, numbers in self.list_members(space, positions[order], turned):
            is_joined = np.isin(find_components(space, members), joined)
            is_joined[is_joined] = space.is_connected(members[is_joined], members[is_joined])
            rows = members[is_joined]
            if len(rows):
                turns = _measure_turns(space, tuple(self.middle.tolist()), rows)
                nearest_first = np.lexsort((turns, gaps[order[numbers[is_joined]]]))
                return tuple(rows[nearest_first[0]].tolist())
        problem = f"has no configuration within {self.radius:g} m that FREE cells join to the start"
        hint, nearest = "", None
        if math.isfinite(self.radius):
            with suppress(ConfigurationError):
                nearest = replace(self, radius=math.inf).find_closest(space, joined)
                metres = math.dist(nearest[:dim], self.middle[:dim])
                problem += f", but one within {1.0051 * metres:.3g} m"  # rounded up
                hint = f"the nearest is {nearest}"
        rule = "closest=True ends in the nearest of these"
        raise ConfigurationError(self.name, problem, rule, hint, nearest=nearest)

    def _turn_to_cells(self, space: ConfigurationMap, depth: float = 1.0) -> Floats:
        """Return the middle turned to each rotation cell that meets the room, shape (n, size).

        It is turned straight towards the cell's center, by a share ``depth`` of the way within it.
        """
        rotations = space.rotations
        cells = self.list_rotations(space)
        middles = np.tile(self.middle, (len(cells), 1))
        turned = middles.copy()
        turned[:, space.dim :] = rotations.centers[cells]
        if depth < 1.0 and rotations.names:
            steps = space.steps_between(middles, turned)
            before, within = np.zeros((len(cells), 1)), np.ones((len(cells), 1))
            for _ in range(40):
                share = 0.5 * (before + within)
                rows = rotations.add_steps(middles, share * steps)[:, space.dim :]
                is_within = rotations.cell_of(rows).reshape(-1, 1) == cells[:, np.newaxis]
                before = np.where(is_within, before, share)
                within = np.where(is_within, share, within)
            sizes = np.linalg.norm(steps, axis=1, keepdims=True).clip(TINY)
            within += depth * (1.0 - within) + 4.0 * ANGLE_SLACK / sizes
            turned = rotations.add_steps(middles, within.clip(None, 1.0) * steps)
        return self.pull(space, turned)

    def _find_candidates(self, edges: LocalPlanner, start: Endpoint, joined: Ints) -> Candidates:
        """Find free configurations in components, or if there are none, others."""
        space = edges.cells
        positions = self.find_positions(space)
        lengths = _measure_lengths(edges, start, positions)
        turned = np.vstack([self.pull(space, np.array([start])), self._turn_to_cells(space)])
        # In a large room, some positions mostly suffice: the nearest, and some of the others.
        order = np.argsort(lengths, kind="stable")
        step = (len(order) - 1) // MAX_NEAR_POSITIONS or 1
        few = np.concatenate([order[:MAX_NEAR_POSITIONS], order[MAX_NEAR_POSITIONS::step]])
        candidates = Candidates(np.empty((0, space.size)), np.empty(0))
        for labels, numbers in itertools.product((joined, None), (few, np.s_[:])):
            places = Candidates(positions[numbers], lengths[numbers])
            candidates = self._choose_free(edges, start, places, turned, labels)
            if len(candidates.rows):
                break
        return candidates

    def _choose_free(
        self,
        edges: LocalPlanner,
        start: Endpoint,
        places: Candidates,
        turned: Floats,
        labels: Ints | None,
    ) -> Candidates:
        """Choose free configurations at positions ``places``, only in some components if given.

        See :meth:`list_members`.
        """
        space = edges.cells
        chosen: list[Candidates] = []
        for rows, numbers in self.list_members(space, places.rows, turned):
            kept = np.ones(len(rows), dtype=np.bool_)
            if labels is not None:
                kept = np.isin(find_components(space, rows, edges.exact), labels)
            kept[kept] = edges.space.motion_is_free(rows[kept], rows[kept])
            costs = places.costs[numbers] + METRES_PER_RADIAN * _measure_turns(space, start, rows)
            chosen.append(Candidates(rows, costs).select(kept).spread(space))
        return Candidates(*map(np.concatenate, zip(*chosen, strict=True)))

    def _make_error(self, space: ConfigurationMap) -> ConfigurationError:
        """Make the error for a room without a free configuration."""
        position, rotation = np.split(self.middle, [space.dim])
        where = "in the region"
        if self.region is None:
            where = f"within {self.radius:g} m of " if self.radius else "at "
            where += str(tuple(position.tolist()))
        if self.angle >= math.pi:
            where += ", at any rotation"
        elif len(rotation):
            where += f", within {self.angle:g} rad of {', '.join(f'{x:g}' for x in rotation)}"
        nearest = tuple(space.nearest_free(self._find_nearest_to_free(space)).tolist())
        return ConfigurationError(
            self.name,
            f"has no configuration that is proven free {where}",
            "a path must begin and end in FREE",
            f"the nearest is {tuple(float(f'{x:.12g}') for x in nearest)}",
            nearest=nearest,
        )

    def _find_nearest_to_free(self, space: ConfigurationMap) -> Endpoint:
        """Return nearly the configuration of the room that is nearest to a FREE cell."""
        best = self.middle
        positions = self.find_positions(space)
        positions = positions[:: len(positions) // MAX_PLACES_WITHOUT_FREE + 1]
        rotations = space.rotations.centers[self.list_rotations(space)]
        rotations = rotations[:: len(rotations) // MAX_PLACES_WITHOUT_FREE + 1]
        for part, few in ((slice(space.dim), positions), (slice(space.dim, None), rotations)):
            rows = np.tile(best, (len(few) + 1, 1))
            rows[1:, part] = few
            free = np.array([space.nearest_free(row) for row in self.pull(space, rows)])
            rows = self.pull(space, free)
            best = rows[int(space.distance(rows, free).argmin())]
        return tuple(best.tolist())


class Candidates(NamedTuple):
    """Configurations to which a path may lead."""

    rows: Floats  # (n, size), or (n, dim) if they are positions
    costs: Floats  # (n,), estimated lengths of paths with weighted rotations, metres

    def select(self, index: Ints | Bools) -> Candidates:
        """Return some of the candidates."""
        return Candidates(self.rows[index], self.costs[index])

    def spread(self, space: Space) -> Candidates:
        """Choose a few cheap candidates far apart, the cheapest first."""
        order = np.argsort(self.costs, kind="stable")
        left = self.rows[order]
        chosen: list[int] = []
        min_gap = 0.0
        while len(order) and len(chosen) < MAX_TRIED_GOALS:
            chosen.append(int(order[0]))
            gaps = space.distance(np.broadcast_to(left[0], left.shape), left)
            min_gap = min_gap or 2.0 * float(gaps.max()) / MAX_TRIED_GOALS
            order, left = order[gaps > min_gap], left[gaps > min_gap]
        return self.select(np.array(chosen, dtype=np.int64))


def _find_centers(space: ConfigurationMap, cells: Ints) -> Floats:
    """Return the centers of position cells, shape (n, dim)."""
    return np.asarray(np.array(space.grid.lower) + space.grid.spacing * (cells + 0.5))


def find_joined(space: ConfigurationMap, places: Sequence[Sequence[Room]], mixed: bool) -> Ints:
    """Return the components of cells that meet all places.

    A component meets a place if it meets any of its rooms: in a proven configuration, if components
    consist of FREE cells; or with ``mixed``, of FREE and MIXED cells, in any cell. If there is none
    with ``mixed``, no path leads through all places.
    """
    return reduce(np.intersect1d, (_find_components_met(space, rooms, mixed) for rooms in places))


def _find_components_met(space: ConfigurationMap, rooms: Sequence[Room], mixed: bool) -> Ints:
    """Return the components of cells that meet rooms; all single configurations together."""
    points = np.array([room.middle for room in rooms if room.is_point]).reshape(-1, space.size)
    points = wrap_angles(points, space.is_periodic)
    if not mixed:  # one by one, because a batch compiles other code
        points = points[np.array([space.is_connected(q, q) for q in points.tolist()], np.bool_)]
    wide = [room for room in rooms if not room.is_point]
    met = [find_components(space, points, mixed)]
    met += [room.find_components(space, mixed) for room in wide]
    labels = np.unique(np.concatenate(met))
    return labels[labels >= 0]


def _measure_turns(space: Space, start: Endpoint, rows: Floats) -> Floats:
    """Measure the angles from a start's rotation to rows', (n,)."""
    steps = space.steps_between(np.broadcast_to(start, rows.shape), rows)
    return np.asarray(np.linalg.norm(steps[:, space.dim :], axis=1))


def _measure_lengths(edges: LocalPlanner, start: Endpoint, positions: Floats) -> Floats:
    """Estimate the lengths of paths to positions, metres, shape (n,).

    They are those of chains of blocks of cells in which the robot passes at some rotation.
    """
    from planners._searches.guide import Guide, any_direction

    space = edges.cells
    dim = space.dim
    origin = np.array(start)[:dim]
    parts = np.array_split(positions, len(positions) // MAX_ROWS_PER_BATCH + 1)
    lengths = np.concatenate([np.linalg.norm(part - origin, axis=1) for part in parts])
    span = np.ptp(positions, axis=0).max()
    if span <= MAX_SPAN_WITHOUT_BLOCKS * space.grid.spacing or not isinstance(space, CSpace):
        return lengths
    states = map_record(space).states
    last = np.array(space.grid.shape) - 1

    def find_cells(rows: Floats) -> Ints:
        """Return the cells of positions as the guide takes them, shape (n, 3)."""
        cells = np.zeros((len(rows), 3), dtype=np.int64)
        cells[:, 3 - dim :] = np.clip(space.grid.cell_of(rows), 0, last)
        return cells

    begin, end = map(tuple, find_cells(np.array([origin, positions[lengths.argmin()]])).tolist())
    guide = Guide(
        states,
        any_direction(states),
        (0, end),
        (0, begin),
        1 if math.prod(states.shape[1:]) <= MAX_POSITIONS_WITHOUT_BLOCKS else BLOCK_SIDE,
        narrow_cost=0.0,
        weight=NEAREST_FIRST,
        worst_state=edges.worst_state,
    )
    # By then, all blocks that are nearer are measured, too.
    with suppress(TimeoutError):  # the caller ends the search
        guide.reach(0, end, NEVER)
    measured = np.concatenate([guide.measure(find_cells(part)) for part in parts])
    measured *= space.grid.spacing
    is_known = np.isfinite(measured)
    np.maximum(measured, lengths, out=lengths, where=is_known)
    lengths[~is_known] += measured.max(where=is_known, initial=0.0)
    return lengths


# ---- ends of paths ------------------------------------------------------------------------------


def end_in_rooms(edges: LocalPlanner, path: Floats, rooms: Sequence[Room]) -> Floats:
    """End a path where it first enters the rooms.

    Candidates are the path itself, and paths that leave it at a waypoint for the nearest
    configuration of a room. Each ends where it first enters a room. Return the cheapest proven one.
    ``path`` has shape (n, size).
    """
    if all(room.is_point for room in rooms):
        return path
    space = edges.cells
    done = np.append(0.0, np.cumsum(edges.edge_costs(path[:-1], path[1:])))
    starts = np.tile(path[:-1], (len(rooms), 1))
    ends = np.concatenate([room.pull(space, path[:-1]) for room in rooms])
    totals = np.tile(done[:-1], len(rooms)) + edges.edge_costs(starts, ends)
    totals[~space.grid.contains(ends[:, : space.dim])] = np.inf
    is_free = edges.edge_checker()
    ways = [path]
    for k in np.argsort(totals, kind="stable").tolist():
        if totals[k] > done[-1]:
            break
        if is_free(*starts[k].tolist(), *ends[k].tolist()):
            ways.insert(0, np.vstack([path[: k % (len(path) - 1) + 1], ends[k]]))
            break
    for way in ways:
        cut = _end_at_first_room(edges, edges.insert_breakpoints(way), rooms)
        if any(room.contains(space, cut[-1:])[0] for room in rooms) and edges.are_free(cut):
            return cut
    return path


def _end_at_first_room(edges: LocalPlanner, path: Floats, rooms: Sequence[Room]) -> Floats:
    """Cut a path at the first sampled place in a room."""
    space = edges.cells
    step = 2.0 * space.resolution / STEPS_PER_CELL
    for number, (first, last) in enumerate(itertools.pairwise(path)):
        places = edges.split_edge(first, last, step, RADIANS_PER_STEP, 1.0).points
        places = np.vstack([first, space.rotations.make_canonical(places[:-1]), last])
        inside = np.any([room.contains(space, places) for room in rooms], axis=0)
        if inside[0]:
            return path[: number + 1]
        if inside.any():
            return np.vstack([path[: number + 1], places[int(inside.argmax())]])
    return path


def begin_in_rooms(edges: LocalPlanner, path: Floats, rooms: Sequence[Room]) -> Floats:
    """Begin a path where it leaves the rooms.

    Without a drive, it may begin anywhere in the rooms, as :func:`end_in_rooms` lets it end; with a
    drive, at the last waypoint in a room. ``path``, shape (n, size), and the result are proven.
    """
    if all(room.is_point for room in rooms):
        return path
    if not edges.has_heading:
        cut = end_in_rooms(edges, path[::-1], rooms)[::-1]
        return cut if edges.are_free(cut) else path
    inside = np.any([room.contains(edges.space, path) for room in rooms], axis=0)
    return path[inside.nonzero()[0].max(initial=0) :]


# ---- places as users give them -------------------------------------------------------------------


def list_rooms(edges: LocalPlanner, places: Sequence[PlaceParts]) -> tuple[Room, ...]:
    """Return the rooms of places; none in a space without cells."""
    return tuple(_make_room(edges.cells, each) for each in places) if edges.has_cells else ()


def find_closest(
    edges: LocalPlanner, name: str, places: Sequence[PlaceParts], others: Sequence[Sequence[Room]]
) -> tuple[Sequence[PlaceParts], list[str]]:
    """Replace alternatives of a place that ask for it by their closest configurations.

    FREE cells join these to all ``others``, or if none do, to the first of them, the start. Return
    also their distances in words. Raises ConfigurationError if no alternative is left.
    """
    texts: list[str] = []
    if not any(place.is_closest for place in places):
        return places, texts
    joined = find_joined(edges.cells, others, mixed=False)
    if not len(joined):  # no path leads through FREE cells, as will be told
        joined = find_joined(edges.cells, others[:1], mixed=False)

    def choose(place: PlaceParts, _: str) -> list[PlaceParts]:
        """Return a place, or its closest configuration."""
        if not place.is_closest:
            return [place]
        (room,) = list_rooms(edges, [place])
        q = room.find_closest(edges.cells, joined)
        steps = edges.space.steps_between(room.middle, np.array(q))
        metres, *radians = (
            float(np.linalg.norm(part)) for part in np.split(steps, [edges.space.dim]) if len(part)
        )
        is_any = place.is_any or not radians
        turned = "" if is_any else f" and {radians[0]:.3g} rad"
        texts.append(
            f"FREE cells lead no nearer to {place.name} than {q}, {metres:.3g} m{turned} away"
        )
        return [PlaceParts(place.name, q)]

    return gather_goals(name, places, choose), texts


def list_all_rooms(
    edges: LocalPlanner,
    places: Sequence[PlaceParts],
    rooms: tuple[Room, ...],
    found: Sequence[Endpoint],
) -> tuple[Room, ...]:
    """Return the rooms of all configurations of places, free or not.

    Return no rooms if not all configurations can be listed; ``rooms`` are those of places on a map,
    and ``found`` the free configurations.
    """
    if rooms:
        return rooms if edges.space.has_poses or all(place.is_plain for place in places) else ()
    points = tuple(Room("", np.array(q)) for q in found)
    return points if len(found) == len(places) else ()


def sort_goals(space: Space, goals: Sequence[Endpoint], start: Endpoint) -> list[Endpoint]:
    """Return goals, nearest first, within half a turn of the start."""
    rows, here = np.array(goals), np.array(start)
    if len(rows) > 1:
        rows = rows[np.argsort(space.distance(here, rows), kind="stable")]
    return [tuple(q) for q in turn_near(rows, here, space.is_periodic).tolist()]


def find_room_goals(
    edges: LocalPlanner, rooms: Sequence[Room], name: str, start: Endpoint
) -> tuple[tuple[Room, ...], list[Endpoint]]:
    """Find the rooms that have free configurations, and some of these from a start.

    The most promising of each room come first. Raises ConfigurationError if no configuration of any
    room is proven free.
    """
    found = gather_goals(name, rooms, lambda room, _: [(room, room.find_goals(edges, start))])
    usable, goals = zip(*found, strict=True)
    rows = turn_near(np.concatenate(goals), np.array(start), edges.space.is_periodic)
    return usable, [tuple(q) for q in rows.tolist()]


def find_routes(
    edges: LocalPlanner, starts: Sequence[Room], goals: Sequence[Room], joined: Iterable[int] = ()
) -> list[Endpoints]:
    """Find pairs of free configurations of starts and goals.

    Two rooms with more than one configuration have pairs in each of the components ``joined``.
    Raises ConfigurationError if no start is proven free.
    """
    parts: list[Ints | None] = [np.array([label]) for label in joined] or [None]

    def find_from(start: Room, _: str) -> list[Endpoints]:
        """Return pairs of a configuration of one room and a goal."""
        pairs: list[Endpoints] = []
        middle = tuple(start.middle.tolist())
        for goal in goals:
            for part in [None] if start.is_point or goal.is_point else parts:
                ends = goal.find_goals(edges, middle, part)
                begins = [middle] if start.is_point else start.find_goals(edges, ends[0], part)
                pairs += itertools.product(begins, ends)
        return pairs

    is_periodic = edges.space.is_periodic
    return [
        (q, tuple(turn_near(np.array(goal), np.array(q), is_periodic).tolist()))
        for q, goal in dict.fromkeys(gather_goals("start", starts, find_from))
    ]


class PlaceParts(NamedTuple):
    """A place in parts."""

    name: str  # in messages
    configuration: object  # as given, if there is no other part
    region: Polygon | MultiPolygon | None = None
    rotation: object = None  # of a region; None for any
    is_any: bool = False  # whether it is a position with any rotation
    near: Near | None = None

    def check(self, space: Space) -> PlaceParts:
        """Return it with its configuration in canonical form; warn of degrees."""
        if not self.is_one or isinstance(self.configuration, Goal) or not space.has_poses:
            return self
        q = space.check_configuration(cast("ArrayLike", self.configuration), self.name)
        return self._replace(configuration=q)

    @property
    def is_closest(self) -> bool:
        """Whether it asks for the closest configuration."""
        return self.near is not None and self.near.closest

    @property
    def is_plain(self) -> bool:
        """Whether it is a configuration alone."""
        return self.is_one and self.near is None

    @property
    def is_one(self) -> bool:
        """Whether it is one configuration, or Near one."""
        return self.region is None and not self.is_any


def split_places(
    space: Space, place: PlaceLike, name: str, near_option: str = NEAR
) -> list[PlaceParts]:
    """Split the alternatives of a place into their parts.

    Raises InputError if the space does not take an alternative; ``near_option`` is the kind of
    Near.
    """
    places = list_alternatives(place, name, space.axes)
    names = [f"{name}[{k}]" if len(places) > 1 else name for k in range(len(places))]
    parts = [_split_place(space, *each, near_option) for each in zip(places, names, strict=True)]
    if len(parts) == 1 and parts[0].is_plain:
        return parts  # which the space checks as it finds goals
    return [each.check(space) for each in parts]


def _split_place(space: Space, place: PlaceLike, name: str, near_option: str) -> PlaceParts:
    """Split a place into parts, or raise InputError."""
    near = None
    inner: object = place
    if isinstance(place, Near):
        check_support(near_option, name, place, space)
        near = place
        inner, *others = list_alternatives(place.configuration, name, space.axes)
        if others or isinstance(inner, Goal):
            raise InputError(name, f"is {place!r}", "Near has one configuration")
        if near.closest and near_option == NEAR_START:
            raise InputError(name, f"is {place!r}", "closest is for goals and places on the way")
    items = inner if isinstance(inner, (list, tuple)) and len(inner) else (inner,)
    if isinstance(items[0], REGIONS):
        check_support(REGION, name, place, space)
        if near is not None and near.closest:
            raise InputError(name, f"is {place!r}", "closest is for a configuration")
        return PlaceParts(name, inner, items[0], (*items, None)[1], near=near)
    if isinstance(items[0], shapely.Geometry):
        rule = "a region is a Polygon or a MultiPolygon"
        raise InputError(name, f"is a {items[0].geom_type}", rule)
    is_any = len(items) > 1 and items[-1] is None
    if is_any:
        check_support(ANY_ROTATION, name, place, space)
    return PlaceParts(name, items[:-1] if is_any else inner, is_any=is_any, near=near)


def _make_room(space: ConfigurationMap, parts: PlaceParts) -> Room:
    """Make the room of one place."""
    name = parts.name
    metres = parts.near.distance if parts.near else 0.0
    radians = parts.near.angle if parts.near and space.rotations.names else 0.0
    if parts.region is None and not parts.is_any:
        if isinstance(parts.configuration, Goal):
            space.find_goals(parts.configuration, (0.0,) * space.size, None, name=name)  # raises
        middle = Space.check_configuration(space, cast("ArrayLike", parts.configuration), name)
        return Room(name, middle, None, metres, radians)
    if parts.region is None:
        position = check_point(cast("ArrayLike", parts.configuration), name, space.dim)
    else:
        _check_region(parts.region, name, metres)
        shapely.prepare(parts.region)
        position = np.array(parts.region.representative_point().coords[0])
    rotation, angle = _find_rotation(space, parts.rotation, name)
    middle = space.rotations.make_canonical(np.concatenate([position, rotation]), name)
    return Room(name, middle, parts.region, metres, min(angle + radians, math.pi))


def _check_region(region: Polygon | MultiPolygon, name: str, metres: float) -> None:
    """Raise InputError for an invalid region, or one with a distance."""
    if region.is_empty or not region.is_valid:
        problem = "is an empty region" if region.is_empty else "is no valid region of shapely"
        raise InputError(name, problem, "a region holds positions, metres")
    if metres:
        rule = "a region has its own room"
        raise InputError(name, f"is Near a region, with the distance {metres:g} m", rule)


def _find_rotation(space: ConfigurationMap, rotation: object, name: str) -> tuple[Floats, float]:
    """Return the rotation of a region, and the largest angle from it."""
    rotations = space.rotations
    if rotation is None:
        return rotations.centers[0], math.pi if rotations.names else 0.0
    return rotations.check_rotation(cast("ArrayLike", rotation), name), 0.0
