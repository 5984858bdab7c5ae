"""Proofs in the plane, of configurations and of motions, where the map cannot decide."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats
from cspace.compiling import inner, jit, reader, row_entry
from cspace.exact import ADVANCE, MOST_DISTANCES, ROUNDING, SHORTEST
from cspace.exact.boundaries import Problem, anchors_of, joined, obstacle_border
from cspace.exact.segments import Border, Outline, Scene, gap, is_nested, place
from cspace.grid import MAX_COORDINATE
from cspace.map.edges import along, edge_is_free
from cspace.map.points import Numbers, configuration, halves, state_at
from cspace.map.record import Map
from cspace.shapes import Pieces, Shape
from cspace.states import BLOCKED, FREE

BIN: Final = 4
"""Side of a bin of border segments, in cells."""

SLIDE: Final = 4.0
"""Length of a motion whose swept border is measured at once, in shortest walks: a longer one meets many segments, of
which few come near."""


class World(NamedTuple):
    """What every proof needs: the map, the obstacles and the robot."""

    map: Map
    scene: Scene
    outline: Outline


class PlaneProofs:
    """Proofs for one robot among the obstacles of one workspace; each kernel is compiled at its first call."""

    def __init__(self, problem: Problem) -> None:
        self._world = World(problem.map, _scene(problem), _outline(problem.robot.shape))
        self._dof = problem.dof

    @cached_property
    def edge(self) -> Callable[..., bool]:
        kernel = row_entry(prove_edge, self._world, 2 * self._dof)
        return lambda *both: kernel(both)

    def are_free(self, q0: Floats, q1: Floats) -> Bools:
        out = np.empty(len(q0), dtype=np.bool_)
        prove_edges(self._world, q0, q1, out)
        return out

    def spare(self, points: Floats, lengths: Floats, turns: Floats) -> float:
        scene, outline = self._world.scene, self._world.outline
        rows = np.empty((len(outline.segments), 8))
        return float(least_spare(scene.border, outline, rows, points, lengths, turns))


@inner(forceinline=True)
def yaw_of(q: Numbers) -> float:
    """The yaw of a configuration, zero where the robot does not turn."""
    yaw = 0.0
    for axis in range(2, len(q)):
        yaw = q[axis]
    return yaw


@inner(_nrt=True)
def room_for(outline: Outline) -> Floats:
    """Room for the segments of the placed robot; threads that shared it would spoil each other's."""
    return np.empty((len(outline.segments), 8))


@inner
def arc_is_clear(world: World, rows: Floats, q0: Numbers, q1: Numbers, arc: int) -> bool:
    """Whether all configurations of an edge are free, where the rotation goes along one of the shortest arcs.

    FREE cells are walked without measuring distances. Elsewhere, an edge without a turn is proven by distances from
    what the border sweeps; one with a turn by conservative advancement: a point of the robot moves by at most ``speed``
    times the part of the edge, so that a distance proves the configurations before and after it.
    """
    space, scene, border, outline = world.map, world.scene, world.scene.border, world.outline
    dx, dy, angle = q1[0] - q0[0], q1[1] - q0[1], space.rotations.turn_of(q0, q1, arc)[0]
    size = abs(q0[0]) + abs(q0[1]) + abs(q1[0]) + abs(q1[1])
    if not size <= 2.0 * MAX_COORDINATE * space.spacing:
        return False
    least = border.least + ROUNDING * size
    speed = math.hypot(dx, dy) + outline.rho * angle
    walk = shortest_walk = 4.0 * space.spacing / speed if speed > 0.0 else 1.0
    slides = outline.rho * angle == 0.0
    proven, leap, measured = 0.0, 0.0, 0
    while True:
        # All before `proven` is free. A distance a leap ahead may reach back to there, and proves twice as much.
        at = min(proven + leap, 1.0)
        q = along(space, q0, q1, arc, at)
        state = state_at(space, q)
        if state == BLOCKED:
            return False
        if state == FREE:
            # Walks grow as long as they succeed, so that a long edge through FREE cells is few calls.
            stop = min(max(at, proven + walk), 1.0)
            if edge_is_free(space, None, along(space, q0, q1, arc, proven), along(space, q0, q1, arc, stop)):
                if stop == 1.0:
                    return True
                proven, leap, walk = stop, 0.0, 2.0 * walk
                continue
            walk = max(0.5 * walk, shortest_walk)
        if measured == MOST_DISTANCES:
            return False
        measured += 1
        stop = min(at + SLIDE * shortest_walk, 1.0) if slides else at
        placed = place(outline, rows, q[0], q[1], yaw_of(q), ((stop - at) * dx, (stop - at) * dy))
        spare = gap(border, outline, placed, least, border.reach) - least
        if spare <= 0.0:
            return False
        # As long as no borders meet, whether one lies within the other stays as it is.
        if measured == 1 and is_nested(scene, outline, placed):
            return False
        if slides:
            if stop == 1.0:
                return True
            proven = stop
            continue
        part = ADVANCE * spare / speed
        if at - part > proven:  # too far ahead: the distance does not reach back
            leap = 0.0
            continue
        if at + part >= 1.0:
            return True
        if part < SHORTEST:
            return False
        proven, leap = at + part, 0.9 * part


@inner
def edge_is_clear(world: World, rows: Floats, q0: Numbers, q1: Numbers) -> bool:
    """Whether all configurations of an edge are free; where two arcs are equally long, those of both."""
    clear = True
    for arc in range(world.map.rotations.arc_count(q0, q1)):
        clear = clear and arc_is_clear(world, rows, q0, q1, arc)
    return clear


@jit
def prove_edge(world: World, both: Numbers) -> bool:
    """Whether an edge, given by its endpoints in a row, is free."""
    q0, q1 = halves(world.map, both)
    return bool(edge_is_clear(world, room_for(world.outline), q0, q1))


@jit
def prove_edges(world: World, first: Floats, second: Floats, out: Bools) -> None:
    """Whether edges, shapes (n, dof), are free."""
    rows = room_for(world.outline)
    for k in range(first.shape[0]):
        q0, q1 = configuration(world.map, first, k), configuration(world.map, second, k)
        out[k] = edge_is_clear(world, rows, q0, q1)


@reader
def least_spare(
    border: Border, outline: Outline, rows: Floats, points: Floats, lengths: Floats, turns: Floats
) -> float:
    """By how much the least distance on pieces of a path exceeds what it has to, metres; zero if not proven to.

    The pieces are given by their middles, shape (n, 2) or (n, 3), metres and radians; no borders may lie nested there.
    ``rows`` is room for the segments of the placed robot.
    """
    best = math.inf
    for k in range(len(points)):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2] if points.shape[1] == 3 else 0.0
        least, half = border.least + ROUNDING * (abs(x) + abs(y)), 0.5 * (lengths[k] + outline.rho * turns[k])
        # What is farther away than elsewhere on the path does not matter.
        apart = gap(border, outline, place(outline, rows, x, y, yaw, (0.0, 0.0)), least, best + half)
        best = min(best, apart - least - half)
        if best <= 0.0:
            return 0.0
    return best


def _outline(shape: Shape) -> Outline:
    """The robot's border: the segments of its regions, or the middles of its discs, each grown by a radius."""
    whole, parts = shape.boundary(), shape.regions
    border, stops = joined([whole], 2, 2), np.cumsum([len(part) for part in parts], dtype=np.int64)
    rho = float(np.hypot(*border.simplices.reshape(-1, 2).T).max())
    return Outline(border.simplices.reshape(-1, 4), border.radii, anchors_of(whole)[0], stops, rho)


def _scene(problem: Problem) -> Scene:
    """The obstacles of a workspace: their border, and the polygons that they fill."""
    workspace, grid = problem.workspace, problem.workspace.grid
    obstacles = obstacle_border(workspace, walled=problem.walled)
    side = BIN * grid.spacing
    segments, radii = _cut(joined(obstacles.pieces, 2, 2), side)
    columns, rows = (-(-n // BIN) for n in grid.shape)
    middles = (segments[:, :2] + segments[:, 2:]) / 2.0
    bins = np.clip(np.floor((middles - grid.lower) / side).astype(np.int64), 0, (columns - 1, rows - 1))
    numbers = bins[:, 0] * rows + bins[:, 1]
    order = np.argsort(numbers, kind="stable")
    solids = [outline for shape in workspace.obstacles for outline in shape.regions]
    corners = [solid.reshape(-1, 2) for solid in solids]
    starts = np.concatenate([[0], np.cumsum(np.bincount(numbers, minlength=columns * rows))]).astype(np.int64)
    border = Border(
        lower=grid.lower,
        upper=grid.upper,
        segments=segments[order],
        radii=radii[order],
        widest=float(radii.max(initial=0.0)),
        starts=starts,
        columns=columns,
        rows=rows,
        side=side,
        walled=problem.walled,
        least=problem.least + obstacles.error,
        reach=side,
    )
    return Scene(
        border=border,
        spacing=grid.spacing,
        outer=workspace.outer,
        inner=workspace.inner if workspace.shapes else workspace.outer,
        solids=np.concatenate([*solids, np.empty((0, 4))]),
        stops=np.cumsum([len(solid) for solid in solids], dtype=np.int64),
        hulls=np.array([[*points.min(axis=0), *points.max(axis=0)] for points in corners]).reshape(-1, 4),
    )


def _cut(border: Pieces, longest: float) -> tuple[Floats, Floats]:
    """Segments cut into equal ones, none longer than ``longest``, shape (n, 4), and their radii."""
    starts, steps = border.simplices[:, 0], border.simplices[:, 1] - border.simplices[:, 0]
    pieces = np.maximum(np.ceil(np.hypot(steps[:, 0], steps[:, 1]) / longest).astype(np.int64), 1)
    whole = np.repeat(np.arange(len(starts)), pieces)
    number = np.arange(len(whole)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = np.stack([number, number + 1], axis=1) / pieces[whole, None]
    endpoints = starts[whole, None] + steps[whole, None] * share[..., None]
    return endpoints.reshape(-1, 4), border.radii[whole]
