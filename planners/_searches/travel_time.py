"""The time of driving as fast as limits of places allow, as a cost on the cells of a map.

A metre in a cell costs the largest speed of all, divided by the largest speed in the cell. So the
cost of a path is its time in seconds, times the largest speed of all. Cells count as a whole, and
costs prove nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, cast
from warnings import catch_warnings, simplefilter
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cspace import BLOCKED, FREE, MIXED, CSpace, Robot, Workspace, build
from cspace.errors import InputError
from cspace.inside import ConfigurationMap, DistanceTable, States, kept_values, map_record
from planners._edges.integrals import CellCost, Weigh, check_costs_fit
from planners._motion.speed_limits import (
    EverywhereRule,
    NearRule,
    SlowNear,
    SpeedLike,
    SpeedZones,
    ZoneRule,
    is_number,
    place_limits,
)
from planners._searches.estimate import Costs

if TYPE_CHECKING:
    from cspace import TiledCSpace

PlaceRule = ZoneRule | NearRule


class LastCosts(NamedTuple):
    """The last costs on the cells of a map, with the limits and tables behind them."""

    limits: list[object]
    tables: list[DistanceTable]
    costs: CellCost


def read_speeds(speed: SpeedLike | Sequence[SpeedLike] | None, space: ConfigurationMap) -> Weigh:
    """Check speed limits; return a maker of costs."""
    limits = list(speed) if isinstance(speed, list | tuple) else [speed]
    if not any(is_number(limit) for limit in limits):
        problem = f"is {speed!r}, and objective is 'time'"
        raise InputError(
            "speed", problem, "one of its limits is a number, m/s, that holds everywhere"
        )
    rules = place_limits(limits, space, space.axes, space.frame_id)
    full = min(rule.speed for rule in rules if isinstance(rule, EverywhereRule))
    places = [rule for rule in rules if isinstance(rule, ZoneRule | NearRule)]
    return partial(_weigh_time, full, places)


def _weigh_time(full: float, rules: Sequence[PlaceRule], space: CSpace) -> CellCost | None:
    """Return the cost of a metre by time.

    It is None if all cells have the full speed.
    """
    limits: list[object] = [full]
    tables: list[DistanceTable] = []
    for rule in rules:
        if isinstance(rule, NearRule):
            tables.append(DistanceTable.of(_find_cells(rule.limit, space)))
            limits += [rule.limit.speed, rule.limit.distance, id(tables[-1].cells)]
        else:
            limits.append(rule.zones)
    kept = kept_values(space)
    known: LastCosts | None = kept.get("costs of time")
    if known is None or known.limits != limits:
        costs = CellCost(_find_factors(full, rules, space))
        known = kept["costs of time"] = LastCosts(limits, tables, costs)
    return known.costs if known.costs.factors.size else None


def _find_factors(full: float, rules: Sequence[PlaceRule], space: CSpace) -> Costs:
    """Compute the cost of a metre in each cell, (slices, ...).

    The array is empty if all costs are 1.
    """
    check_costs_fit(space)
    speeds = np.full((len(space.slice_rotations), *space.grid.shape), full, dtype=np.float32)
    for rule in rules:
        if isinstance(rule, NearRule):
            found = _measure_near(rule.limit, space)
        else:
            found = _measure_zones(rule, space)
        np.minimum(speeds, found, out=speeds)
    factors = np.float32(full) / speeds
    return factors if (factors > 1.0).any() else factors[:0]


def _find_cells(near: SlowNear, space: CSpace) -> CSpace:
    """Return the map of a limit's obstacles, in memory."""
    cells = near.space
    if isinstance(cells, CSpace):
        return cells
    return cast("TiledCSpace", cells).window(space.grid.lower, space.grid.upper)


def _measure_near(near: SlowNear, space: CSpace) -> Costs:
    """Return the cells' largest speeds near obstacles, (slices, ...).

    They are infinite beyond the limit's distance.
    """
    grid = space.grid
    cells = _find_cells(near, space)
    widths = DistanceTable.of(cells).cells.reshape(-1, *cells.grid.shape)
    # The limit's map may have other cells and rotations.
    last = np.array(cells.grid.shape) - 1
    places = [
        np.floor((grid.centers(axis) - cells.grid.lower[axis]) / cells.grid.spacing)
        .clip(0, last[axis])
        .astype(np.int64)
        for axis in range(grid.dim)
    ]
    rotations = np.resize(
        cells.rotations.cell_of(space.slice_rotations), len(space.slice_rotations)
    )
    is_near = widths < np.float32(near.distance / cells.grid.spacing)
    found = is_near[np.ix_(cells.slice_of[rotations], *places)]
    return np.where(found, np.float32(near.speed), np.float32(np.inf))


def _measure_zones(rule: ZoneRule, space: CSpace) -> Costs:
    """Return the cells' largest speeds in zones, cached.

    They are infinite outside zones; the array broadcasts to the cells.
    """
    kept = kept_values(space)
    known: WeakKeyDictionary[SpeedZones, Costs]
    known = kept.setdefault("speeds in zones", WeakKeyDictionary())
    if rule.zones not in known:
        known[rule.zones] = _raster_zones(rule, space)
    speeds = known[rule.zones]
    return speeds[..., np.newaxis] if space.dim == 3 else speeds


def _raster_zones(rule: ZoneRule, space: CSpace) -> Costs:
    """Compute the largest speeds in zones, shape (s, nx, ny).

    There is one slice if a disc stands for the robot. A zone counts in a cell if the robot at the
    cell's center meets the zone.
    """
    rotations = space.slice_rotations if rule.has_yaw else np.empty((1, 0))
    speeds = np.full((len(rotations), *space.grid.shape[:2]), np.inf, dtype=np.float32)
    levels = rule.levels
    for speed, area in zip(levels.speeds.tolist(), levels.areas, strict=True):
        found = _map_zone(rule, area, space)
        if found is None:
            continue
        window, states = found
        part = speeds[:, *window]
        part[states == BLOCKED] = np.minimum(part[states == BLOCKED], speed)
        undecided = np.argwhere(states == MIXED)
        cells = undecided[:, 1:] + [each.start for each in window]
        centers = np.array(space.grid.lower[:2]) + space.grid.spacing * (cells + 0.5)
        q = np.column_stack([centers, rotations[undecided[:, 0]]])
        lowest = rule.measure(q, np.zeros(len(q)))
        part[states == MIXED] = np.minimum(part[states == MIXED], lowest)
    return speeds


def _map_zone(
    rule: ZoneRule, area: BaseGeometry, space: CSpace
) -> tuple[tuple[slice, slice], States] | None:
    """Map an area; return a window of cells, and their states.

    The states, shape (s, x, y), are FREE if the robot does not meet the area, BLOCKED if it does,
    otherwise MIXED. Return None for an area off the map.
    """
    grid = space.grid
    shape = np.array(grid.shape[:2])
    lower = np.array(grid.lower[:2])
    # The map of the zone reaches beyond the map of the plan by the robot's size.
    beyond = math.ceil(rule.size / grid.spacing) + 1
    reach = lower - grid.spacing * beyond, lower + grid.spacing * (shape + beyond)
    # Coordinates far away may exceed the range of cell numbers.
    near = shapely.get_parts(shapely.intersection(area, shapely.box(*reach[0], *reach[1])))
    area = shapely.MultiPolygon([part for part in near if part.geom_type == "Polygon"])
    if area.is_empty:
        return None
    corners = np.floor((np.reshape(area.bounds, (2, 2)) - lower) / grid.spacing)
    low, high = corners.astype(np.int64)
    first, last = np.maximum(low - beyond, -beyond), np.minimum(high + beyond + 1, shape + beyond)
    bounds = lower + grid.spacing * np.stack([first, last])
    workspace = Workspace.from_polygons(area, grid.spacing, bounds)
    states = _map_area(rule, workspace, space)
    begin, end = np.maximum(first, 0), np.minimum(last, shape)
    x, y = map(slice, begin.tolist(), end.tolist())
    return (x, y), states[:, *map(slice, begin - first, end - first)]


def _map_area(rule: ZoneRule, workspace: Workspace, space: CSpace) -> States:
    """Map a robot among zones as obstacles, in a map's slices."""
    if rule.size == 0.0:
        states = np.where(workspace.inner, BLOCKED, np.where(workspace.outer, MIXED, FREE))
        return states[np.newaxis].astype(np.uint8)
    robot = Robot.disc(rule.size)
    if rule.cores is not None:
        robot = Robot.polygon(space.robot.shape.project_to_plane().outer.outline)
    rotations = space.rotations if rule.has_yaw else None
    with catch_warnings():
        simplefilter("ignore")  # a zone may cover the whole map
        zone = build(workspace, robot, rotations=rotations, outside="free")
    states = map_record(zone).states.reshape(-1, *zone.grid.shape)
    if not rule.has_yaw:
        return states
    _, cells = np.unique(space.slice_of, return_index=True)
    return states[zone.slice_of[cells]]
