"""Paths in the plane that are pulled taut, against visibility graphs."""

import numpy as np
import pytest

from cspace import BLOCKED, FREE
from cspace.inside import find_crossed_runs
from planners._searches.taut import MARGIN, pull_taut
from tests.helpers.handmade import map_of
from tests.helpers.oracles import path_length
from tests.helpers.strategies import few
from tests.planners.test_lengths import find_shortest_length


def carve_maze(rng, count, cell):
    """Return True for the walls of a maze without loops, with corridors of some cells."""
    size = 1 + count * (cell + 1)
    walls = np.ones((size, size), dtype=bool)

    def carve(rooms):
        """Open a row or column of rooms, and the walls between them."""
        (i, j), (u, v) = min(rooms), max(rooms)
        step = cell + 1
        walls[1 + step * i : step * (u + 1), 1 + step * j : step * (v + 1)] = False

    seen = {(0, 0)}
    stack = [(0, 0)]
    carve([(0, 0)])
    while stack:
        i, j = stack[-1]
        near = {(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)} - seen
        near = sorted(room for room in near if min(room) >= 0 and max(room) < count)
        if not near:
            stack.pop()
            continue
        room = near[rng.integers(len(near))]
        carve([(i, j), room])
        seen.add(room)
        stack.append(room)
    return walls


def find_taut_path(states, start, goal):
    """Return the shortest path that keeps the margin, in cells."""
    runs = find_crossed_runs(map_of(states, spacing=1.0), start, goal)
    return pull_taut(runs, start, goal)


@pytest.mark.parametrize("seed", few([1, 0, 2, 3, 4, 5]))
def test_paths_in_mazes_are_the_shortest(seed):
    """Find paths in mazes, in which all paths pass obstacles on the same sides."""
    rng = np.random.default_rng(seed)
    walls = carve_maze(rng, 5, int(rng.integers(1, 4)))
    states = np.where(walls, BLOCKED, FREE).astype(np.uint8)
    rooms = np.argwhere(~walls)
    start, goal = rooms[rng.choice(len(rooms), 2, replace=False)] + rng.uniform(0.1, 0.9, (2, 2))
    taut = find_taut_path(states, start, goal)
    assert taut[0] == pytest.approx(start)
    assert taut[-1] == pytest.approx(goal)
    assert path_length(taut) == pytest.approx(
        find_shortest_length(walls, start, goal, MARGIN), rel=1e-9
    )
    # The map proves the path, even rounded to 32 bits.
    assert map_of(states, spacing=1.0).certify_path(taut.astype(np.float32)).all()


@pytest.mark.parametrize("seed", few(range(25, 50), 3))
def test_ends_near_borders_of_cells_do_not_lengthen_paths(seed):
    """Begin and end nearer to walls than the margin that the path keeps elsewhere."""
    rng = np.random.default_rng(seed)
    walls = carve_maze(rng, 4, int(rng.integers(1, 4)))
    states = np.where(walls, BLOCKED, FREE).astype(np.uint8)
    cells = np.argwhere(~walls)
    cells = cells[rng.choice(len(cells), 2, replace=False)]
    start, goal = cells + rng.choice([0.001, 0.5, 0.999], (2, 2))
    inner = np.clip([start, goal], cells + MARGIN, cells + 1.0 - MARGIN)
    expected = find_shortest_length(walls, *inner, MARGIN)
    for ends in ((start, goal), (goal, start)):
        taut = find_taut_path(states, *ends)
        assert path_length(taut) == pytest.approx(expected, abs=4.0 * MARGIN)
        assert map_of(states, spacing=1.0).certify_path(taut).all()
