"""Real maps of the MovingAI benchmark, read and planned on."""

import numpy as np
import pytest

import cspace
from cspace import Robot, Workspace
from tests.helpers.maps import proven_paths

MOVINGAI = ["AR0011SR", "Berlin_1_1024", "arena", "brc504d", "maze512-32-0", "random512-10-0"]


def read_problems(path, height):
    """Read starts, goals and path lengths of problems."""
    rows = [line.split() for line in path.with_suffix(".map.scen").read_text().splitlines()[1:]]
    x0, y0, x1, y1 = np.array([row[-5:-1] for row in rows], dtype=int).T
    lengths = np.array([row[-1] for row in rows], dtype=float)
    return np.stack([x0, height - 1 - y0], axis=1), np.stack([x1, height - 1 - y1], axis=1), lengths


@pytest.mark.parametrize("name", MOVINGAI)
def test_movingai_problems_are_connected(data, name):
    """Refine the map twice, for a tiny robot."""
    path = data / "movingai" / f"{name}.map"
    workspace = Workspace.from_movingai(path)
    fine = Workspace.from_array(np.repeat(np.repeat(workspace.outer, 3, axis=0), 3, axis=1), 1 / 3)
    space = cspace.build(fine, Robot.disc(0.01))
    first, last, lengths = read_problems(path, workspace.grid.shape[1])
    assert not workspace.outer[tuple(first.T)].any() and not workspace.outer[tuple(last.T)].any()
    steps = np.abs(first - last)
    assert (lengths >= steps.max(axis=1) + (np.sqrt(2) - 1) * steps.min(axis=1) - 0.02).all()
    starts, goals = first + 0.5, last + 0.5
    assert space.is_free(starts).all() and space.is_free(goals).all()
    assert all(answer is True for answer in proven_paths(space, starts, goals))
    undecided = proven_paths(cspace.build(workspace, Robot.disc(0.01)), starts, goals)
    assert all(
        answer is not False for answer in undecided
    )  # in a corridor one cell wide the grid cannot decide
