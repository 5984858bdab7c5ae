"""Maps to plan on, and what holds of every plan."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import planners
from cspace import BLOCKED, FREE, CSpace, Robot, Workspace, build

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
