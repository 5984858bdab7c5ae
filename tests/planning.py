"""Maps to plan on, and what holds of every plan."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import planners
from cspace import BLOCKED, FREE, CSpace, Robot, Workspace, build
from cspace.shapes import Box
from cspace.rotations import Rotations

START, GOAL = (1.0, 1.0), (9.0, 5.0)


def room() -> CSpace:
    """A room of 10 m by 6 m with two walls across it, for a disc of 0.2 m."""
    occupied = np.zeros((100, 60), dtype=bool)
    occupied[30:33, :45] = True
    occupied[65:68, 20:] = True
    return build(Workspace.from_array(occupied, 0.1), Robot.disc(0.2))


def with_state(state: np.ndarray) -> CSpace:
    """A map whose cells, of 1 m, have the given states."""
    workspace = Workspace.from_array(state == BLOCKED, 1.0)
    return CSpace(workspace, Robot.disc(0.1), state, outside="blocked", margin=0.0, precision="float64")


def halves(between: int) -> CSpace:
    """Two free halves of 9 m by 9 m with a wall of another state between them."""
    state = np.full((19, 9), FREE, dtype=np.uint8)
    state[9] = between
    return with_state(state)


def distances(space: CSpace, points: np.ndarray) -> np.ndarray:
    """Distances of points in the grid to the nearest configuration that is not FREE, by trying every cell."""
    lower, upper = np.array(space.grid.lower), np.array(space.grid.upper)
    corners = lower + space.grid.spacing * np.argwhere(space.state != FREE)
    rim = np.minimum(points - lower, upper - points).min(axis=-1)
    if not len(corners):
        return rim
    apart = np.maximum(np.maximum(corners - points[:, None], points[:, None] - corners - space.grid.spacing), 0.0)
    return np.minimum(rim, np.linalg.norm(apart, axis=-1).min(axis=-1))


def check(space: CSpace, found: planners.Plan, start: Any = START, goal: Any = GOAL) -> None:
    """What holds of every solved plan, told by look-ups of single configurations."""
    path = found.path
    assert found.solved and found.certified and found.path_exists is True
    assert path.dtype == np.float64 and path.ndim == 2 and not path.flags.writeable
    assert tuple(path[0]) == tuple(start) and tuple(path[-1]) == tuple(goal)
    assert found.length == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum())
    assert found.length >= math.dist(start, goal) * (1 - 1e-12)
    along = np.linspace(0.0, 1.0, 100)[:, None, None]
    dense = path[:-1] + along * (path[1:] - path[:-1]) if len(path) > 1 else path
    assert space.is_free(dense).all()
    least = distances(space, dense.reshape(-1, 2)).min()
    assert max(0.0, least - 2 * space.grid.spacing) <= found.clearance <= least
    assert all(seconds >= 0.0 for seconds in dataclasses.astuple(found.times))


def turning_room() -> CSpace:
    """A room of 6 m by 4 m with two walls across it, for a robot of 0.6 m by 0.3 m that turns."""
    occupied = np.zeros((60, 40), dtype=bool)
    occupied[18:20, :26] = True
    occupied[40:42, 14:] = True
    return build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.6, 0.3), rotations=24)


def turning_halves(between: int) -> CSpace:
    """Two free halves of 9 m by 9 m with a wall of another state between them, at every yaw."""
    state = np.full((12, 19, 9), FREE, dtype=np.uint8)
    state[:, 9] = between
    workspace = Workspace.from_array(state[0] == BLOCKED, 1.0)
    robot = Robot.polygon(np.array([(0.1, 0.0), (-0.1, 0.1), (-0.1, -0.1)]))
    options: dict[str, Any] = {"outside": "blocked", "margin": 0.0, "precision": "float64"}
    return CSpace(workspace, robot, state, rotations=Rotations.of(12), **options)


def turn_between(first: Any, second: Any) -> Any:
    """Signed angle from one yaw to another along the shorter arc."""
    return (np.asarray(second) - first + math.pi) % (2 * math.pi) - math.pi


def check_turning(space: CSpace, found: planners.Plan, start: Any, goal: Any) -> None:
    """What holds of every solved plan of a robot that turns, told by look-ups of single configurations."""
    path, waypoints = found.path, found.waypoints
    assert found.solved and found.certified
    assert path.dtype == waypoints.dtype == np.float64 and not path.flags.writeable and not waypoints.flags.writeable
    assert path.shape[1:] == waypoints.shape[1:] == (3,)
    for end, row in ((start, path[0]), (goal, path[-1]), (start, waypoints[0]), (goal, waypoints[-1])):
        assert tuple(row) == (*end[:2], row[2]) and abs(turn_between(row[2], end[2])) < 1e-12
    assert (path[:, 2] >= -math.pi).all() and (path[:, 2] < math.pi).all()
    rows = {tuple(row) for row in path.tolist()}
    assert all(tuple(row) in rows for row in waypoints.tolist())
    steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
    turns = turn_between(path[:-1, 2], path[1:, 2])
    assert (steps <= space.grid.spacing * (1 + 1e-9)).all() and (np.abs(turns) <= math.radians(5) + 1e-9).all()
    along = np.linspace(0.0, 1.0, 20)[:, None]
    if found.curve is None:
        assert found.direction is None
        assert found.length == pytest.approx(steps.sum())
        dense = [a + along * np.array([*(b - a)[:2], turn]) for a, b, turn in zip(path, path[1:], turns, strict=False)]
    else:
        assert found.turning_radius is not None and found.direction is not None
        assert len(found.direction) == len(path) and set(found.direction.tolist()) <= {1, -1}
        assert steps.sum() * (1 - 1e-9) <= found.length <= steps.sum() * 1.01 + 1e-9
        dense = [
            on_arc(a, step, turn, way, along[:, 0])
            for a, step, turn, way in zip(path, steps, turns, found.direction[1:], strict=False)
        ]
        # No turn is tighter than the radius, and the robot moves the way it points.
        assert (np.abs(turns) <= 1.02 * steps / found.turning_radius + 1e-6).all()
        for b, points in zip(path[1:], dense, strict=True):
            assert np.abs(points[-1, :2] - b[:2]).max() < 1e-5
    if dense and not found.exact:
        assert space.is_free(np.concatenate(dense)).all()
    assert (
        0.0
        <= found.clearance
        <= (space.clearance(np.concatenate(dense)).min() if dense else math.inf) + 1e-9 + (1.5 * space.grid.spacing)
    )
    assert all(seconds >= 0.0 for seconds in dataclasses.astuple(found.times))


def on_arc(first: np.ndarray, chord: float, turn: float, way: int, along: np.ndarray) -> np.ndarray:
    """Configurations of the arc on which a car drives a chord and turns by an angle."""
    angles = turn * along
    yaw = first[2] + angles
    if abs(turn) < 1e-9:
        ahead = way * chord * along
        offsets = np.stack([ahead * math.cos(first[2]), ahead * math.sin(first[2])], axis=-1)
    else:
        radius = way * chord / (2.0 * math.sin(abs(turn) / 2.0)) * math.copysign(1.0, turn)
        offsets = radius * np.stack([np.sin(yaw) - math.sin(first[2]), math.cos(first[2]) - np.cos(yaw)], axis=-1)
    return np.column_stack([first[:2] + offsets, yaw])


def spatial_room() -> CSpace:
    """A room of 4 m by 2 m by 2 m with two walls across it, for a box-shaped drone of 0.3 m by 0.3 m by 0.1 m."""
    occupied = np.zeros((40, 20, 20), dtype=bool)
    occupied[13:15, :, :13] = True
    occupied[26:28, :11] = True
    return build(Workspace.from_array(occupied, 0.1), Robot.box((0.3, 0.3, 0.1)))


def spatial_with_state(state: np.ndarray) -> CSpace:
    """A map in space whose cells, of 1 m, have the given states."""
    workspace = Workspace.from_array(state == BLOCKED, 1.0)
    return CSpace(workspace, Robot.ball(0.1), state, outside="blocked", margin=0.0, precision="float64")


def spatial_halves(between: int) -> CSpace:
    """Two free halves of 9 m by 9 m by 9 m with a floor of another state between them."""
    state = np.full((9, 9, 19), FREE, dtype=np.uint8)
    state[:, :, 9] = between
    return spatial_with_state(state)


def spatial_distances(space: CSpace, points: np.ndarray) -> np.ndarray:
    """:func:`distances` in space."""
    return np.concatenate([distances(space, part) for part in np.array_split(points, len(points) // 100 + 1)])


def voxels_meet_box(space: CSpace, points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Whether a box from ``low`` to ``high``, placed at points, meets an obstacle cell, or sticks out of the grid."""
    lower, h = np.array(space.grid.lower), space.grid.spacing
    corners = lower + h * np.argwhere(space.workspace.outer)
    out = []
    for part in np.array_split(points, len(points) // 500 + 1):
        first, last = (part + low)[:, None], (part + high)[:, None]
        meets = ((first <= corners + h) & (last >= corners)).all(axis=-1).any(axis=-1)
        sticks = ((first < lower) | (last > np.array(space.grid.upper))).any(axis=-1)[:, 0]
        out.append(meets | sticks)
    return np.concatenate(out)


def check_spatial(space: CSpace, found: planners.Plan, start: Any, goal: Any) -> None:
    """What holds of every solved plan in space; a thousand points of every edge against every obstacle cell."""
    path = found.path
    assert found.solved and found.certified and found.axes == ("x", "y", "z") and found.direction is None
    assert found.path_exists is True
    assert path.dtype == np.float64 and path.shape[1:] == (3,) and not path.flags.writeable
    assert found.waypoints is path or np.array_equal(found.waypoints, path)
    assert tuple(path[0]) == tuple(start) and tuple(path[-1]) == tuple(goal)
    assert found.length == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum())
    along = np.linspace(0.0, 1.0, 1000)[:, None, None]
    dense = path[:-1] + along * (path[1:] - path[:-1]) if len(path) > 1 else path[None]
    assert space.is_free(dense).all()
    if isinstance(space.robot.body, Box):
        assert not voxels_meet_box(space, dense.reshape(-1, 3), *space.robot.body.bounds).any()
    least = spatial_distances(space, dense[::10].reshape(-1, 3)).min()
    assert max(0.0, least - 2.3 * space.grid.spacing) <= found.clearance <= least
    assert all(seconds >= 0.0 for seconds in dataclasses.astuple(found.times))
