"""A search for a chain examines cells along its chain, not all that are nearer to the goal."""

import numpy as np
import pytest

import cspace
import planners
import planners._searches.chains


def make_trap(side, dim):
    """Make a map with thin walls around the start that are open only away from the goal."""
    occupied = np.zeros((side,) * dim, dtype=np.bool_)
    low, high = side // 8, side - side // 8
    occupied[(slice(low, high),) * dim] = True
    occupied[(slice(low, high - 1), *(slice(low + 1, high - 1),) * (dim - 1))] = False
    start = np.full(dim, side / 2 + 0.5)
    start[0] = high - 5.5
    goal = start.copy()
    goal[0] = high + 2.5
    return occupied, start, goal


def count_cells(side, dim, monkeypatch):
    """Count the cells that a search out of a trap examines, and those on its chain."""
    examined = []
    search = planners._searches.chains._search_guided

    def run(*arguments):
        progress = search(*arguments)
        examined.append(np.count_nonzero(progress.closed))
        return progress

    occupied, start, goal = make_trap(side, dim)
    robot = cspace.Robot.disc(0.1) if dim == 2 else cspace.Robot.ball(0.1)
    space = cspace.build(cspace.Workspace.from_array(occupied, 1.0), robot)
    monkeypatch.setattr(planners._searches.chains, "_search_guided", run)
    path = planners.plan(space, start, goal, planner=planners.Search(simplify=False)).waypoints
    monkeypatch.undo()
    assert all(space.motion_is_free(path[:-1], path[1:]))
    (count,) = examined
    return count, len(path)


@pytest.mark.parametrize("dim, sides", [(2, (100, 400)), (3, (32, 64))], ids=["plane", "space"])
def test_a_search_out_of_a_trap_examines_few_cells(dim, sides, monkeypatch):
    for side in sides:
        count, on_chain = count_cells(side, dim, monkeypatch)
        assert count <= 8 * on_chain
