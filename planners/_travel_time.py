"""The time of driving as fast as limits of places allow, as a cost on the cells of a map.

A metre costs the largest speed of all by the largest speed there, so the cost of a path is its time
in seconds, times the largest speed. It counts cells, each as a whole, and proves nothing: a zone
counts in each cell in which the robot may meet it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Final, cast
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cspace import FREE, CSpace, Robot, Workspace, build
from cspace.errors import InputError
from cspace.inside import ConfigurationMap, DistanceTable, States, map_record
from planners._catalogue import TIME
from planners._estimate import Costs
from planners._integrals import CellCost, CostDensity, Weigh, check_costs_fit
from planners._speed_limits import (
    EverywhereRule,
    NearRule,
    SlowNear,
    SpeedLike,
    SpeedZones,
    ZoneRule,
    is_number,
    place_limits,
)

if TYPE_CHECKING:
    from cspace import TiledCSpace

PlaceRule = ZoneRule | NearRule

ZONE_SPEEDS: Final[WeakKeyDictionary[CSpace, WeakKeyDictionary[SpeedZones, Costs]]] = (
    WeakKeyDictionary()
)
"""Largest speeds in zones of maps, as long as map and zones live."""


def read_speeds(speed: SpeedLike | Sequence[SpeedLike] | None, space: ConfigurationMap) -> Weigh:
    """Check largest speeds, and return the maker of costs by them."""
    limits = list(speed) if isinstance(speed, list | tuple) else [speed]
    if not any(is_number(limit) for limit in limits):
        problem = f"is {speed!r}, and objective is {TIME!r}"
        raise InputError(
            "speed", problem, "one of its limits is a number, m/s, that holds everywhere"
        )
    rules = place_limits(limits, space, space.axes, space.frame_id)
    full = min(rule.speed for rule in rules if isinstance(rule, EverywhereRule))
    places = [rule for rule in rules if isinstance(rule, ZoneRule | NearRule)]
    return partial(_weigh_time, full, places)


def _weigh_time(full: float, rules: Sequence[PlaceRule], space: CSpace) -> CellCost | None:
    """Return what a metre costs by its time; None if all cells have the full speed."""
    check_costs_fit(space)
    shape = len(space.slice_rotations), *space.grid.shape
    speeds = np.full(shape, full, dtype=np.float32)
    for rule in rules:
        if isinstance(rule, NearRule):
            found = _measure_near(rule.limit, space)
        else:
            found = _measure_zones(rule, space)
        np.minimum(speeds, found, out=speeds)
    factors = np.float32(full) / speeds
    if not (factors > 1.0).any():
        return None
    return CellCost(factors, np.sqrt(factors - np.float32(1.0)), CostDensity(0.0, 1.0, 1.0))


def _measure_near(near: SlowNear, space: CSpace) -> Costs:
    """Return the largest speeds near obstacles in each cell of each slice, infinite elsewhere."""
    grid = space.grid
    cells = near.space
    if not isinstance(cells, CSpace):
        cells = cast("TiledCSpace", cells).window(grid.lower, grid.upper)
    widths = DistanceTable.of(cells).cells.reshape(-1, *cells.grid.shape)
    # The map may be another one, with other cells and rotations.
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
    """Return the largest speeds in zones, infinite elsewhere, in an array that fits the cells."""
    known = ZONE_SPEEDS.setdefault(space, WeakKeyDictionary())
    if rule.zones not in known:
        known[rule.zones] = _raster_zones(rule, space)
    speeds = known[rule.zones]
    return speeds[..., np.newaxis] if space.dim == 3 else speeds


def _raster_zones(rule: ZoneRule, space: CSpace) -> Costs:
    """Return the largest speeds in zones for each slice and cell of the plane, shape (s, nx, ny).

    There is one slice if a disc stands for the robot.
    """
    count = len(space.slice_rotations) if rule.has_yaw else 1
    speeds = np.full((count, *space.grid.shape[:2]), np.inf, dtype=np.float32)
    levels = rule.levels
    pairs = zip(levels.speeds.tolist(), levels.areas, strict=True)
    for speed, area in reversed(list(pairs)):  # the lowest last
        _mark_zone(rule, area, space, speeds, speed)
    return speeds


def _mark_zone(
    rule: ZoneRule, area: BaseGeometry, space: CSpace, speeds: Costs, speed: float
) -> None:
    """Enter a speed in all cells in which the robot may meet an area."""
    grid = space.grid
    shape = np.array(grid.shape[:2])
    lower = np.array(grid.lower[:2])
    # Cells of the window, which reaches beyond the map as far as the robot.
    beyond = math.ceil(rule.size / grid.spacing) + 1
    reach = lower - grid.spacing * beyond, lower + grid.spacing * (shape + beyond)
    if not shapely.intersects(area, shapely.box(*reach[0], *reach[1])):
        return
    corners = np.floor((np.reshape(area.bounds, (2, 2)) - lower) / grid.spacing)
    low, high = corners.astype(np.int64)
    first, last = np.maximum(low - beyond, -beyond), np.minimum(high + beyond + 1, shape + beyond)
    bounds = lower + grid.spacing * np.stack([first, last])
    workspace = Workspace.from_polygons(area, grid.spacing, bounds)
    states = _map_zone(rule, workspace, space)
    begin, end = np.maximum(first, 0), np.minimum(last, shape)
    inner = states[:, *map(slice, begin - first, end - first)] != FREE
    part = speeds[:, *map(slice, begin, end)]
    part[inner] = speed


def _map_zone(rule: ZoneRule, workspace: Workspace, space: CSpace) -> States:
    """Return states of cells that are FREE where the robot does not meet an area, by slice."""
    if rule.size == 0.0:
        return workspace.outer.view(np.uint8)[np.newaxis]  # False is FREE
    robot = Robot.disc(rule.size)
    if rule.cores is not None:
        robot = Robot.polygon(space.robot.shape.project_to_plane().outer.outline)
    rotations = space.rotations if rule.has_yaw else None
    zone = build(workspace, robot, rotations=rotations, inner=False, outside="free")
    states = map_record(zone).states.reshape(-1, *zone.grid.shape)
    if not rule.has_yaw:
        return states
    _, cells = np.unique(space.slice_of, return_index=True)
    return states[zone.slice_of[cells]]
