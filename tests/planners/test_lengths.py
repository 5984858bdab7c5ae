"""Lengths of paths in the plane and their lower bounds, against visibility graphs."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

import planners
from cspace import BLOCKED, FREE, Robot, Workspace, build
from planners._searches.taut import MARGIN
from tests.helpers.handmade import map_of
from tests.helpers.maps import MOVINGAI_MAPS, read_problems
from tests.helpers.oracles import path_length, shortest_length
from tests.helpers.regions import Flat, cell_boxes
from tests.helpers.strategies import examples, seeds

NARROW = 1e-6
"""Growth of blocked cells in the oracle, in cells, so that two of them close a common corner."""

SLACK = 1e-7
"""Error of lengths, relative and in metres."""

HEIGHT = 0.4
"""Height of the box among columns, in metres; the columns are 2 m high."""


def find_shortest_length(blocked, start, goal, grow=NARROW):
    """Return the length of the shortest path among grown cells; infinity if none exists."""
    framed = cell_boxes(np.pad(blocked, 1, constant_values=True), -1.0)
    walls = shapely.union_all(Flat.boxes(framed).polygons)
    return shortest_length(walls.buffer(grow, join_style="mitre"), start, goal)


BESIDE_BORDERS = (0.0, 1e-12, 1e-3, MARGIN / 2.0, MARGIN, 0.25)
"""Distances in cells of starts and goals from the borders of their cells."""


@examples(150)
@example(seed=24, share=0.25, spacing=0.1, block=1)  # on the border, where 3 * 0.1 / 0.1 > 3
@given(seeds, st.floats(0.0, 0.5), st.sampled_from([1.0, 0.25, 0.1, 0.05]), st.sampled_from([1, 3]))
def test_paths_and_bounds_are_near_the_shortest_length(seed, share, spacing, block):
    """Ends lie beside borders of their cells; blocks of several cells hide shorter ways."""
    rng = np.random.default_rng(seed)
    blocked = rng.random(rng.integers(1, 9, 2)) < share
    blocked = np.kron(blocked, np.ones((block, block), dtype=bool))
    cells = np.argwhere(~blocked)
    if not len(cells):
        return
    cells = cells[rng.integers(len(cells), size=2)]
    places = np.abs(rng.integers(2, size=(2, 2)) - rng.choice(BESIDE_BORDERS, (2, 2)))
    states = np.where(blocked, BLOCKED, FREE).astype(np.uint8)
    space = map_of(states, outside="blocked", spacing=spacing)
    start, goal = spacing * (cells + places)
    if not space.motion_is_free([start, goal], [start, goal]).all():
        return  # they touch a blocked cell
    # The oracle's walls are wider.
    expected = find_shortest_length(blocked, *(cells + places.clip(3e-6, 1.0 - 3e-6)))
    for ends in ((start, goal), (goal, start)):
        path = planners.plan(space, *ends).waypoints / spacing
        bound = space.min_path_length(*ends) / spacing
        assert math.isinf(expected) == math.isinf(bound) == (len(path) == 0)
        if len(path):
            assert expected - 1e-3 <= bound <= expected + 2e-5
            assert path_length(path) <= expected + 2.0 * MARGIN * len(path) + 2e-5


HALL = ("#..#.", ".....", "..#..", ".....", "...#.", ".....", "..#..")
SHELF = ("###......", "######...", ".........", "###......")
"""Blocked cells, the uppermost row first."""


@pytest.mark.parametrize(
    "rows, start, goal",
    [(HALL, (2.0 - 1e-12, 6.001), (4.0, 1e-6)), (SHELF, (6.0, 4.0), (3.25, 1.998))],
)
def test_a_path_past_a_corner_beside_its_end_takes_no_detour(rows, start, goal):
    """One end is nearer to the border than the margin, beside an obstacle behind the border."""
    blocked = np.array([list(row) for row in rows[::-1]]).T == "#"
    states = np.where(blocked, BLOCKED, FREE).astype(np.uint8)
    space = map_of(states, outside="blocked", spacing=1.0)
    shortest = find_shortest_length(blocked, *np.clip((start, goal), 3e-6, 6.9))
    for ends in ((start, goal), (goal, start)):
        path = planners.plan(space, *ends).waypoints
        assert path_length(path) <= shortest + 2.0 * MARGIN * len(path)


def test_rays_that_graze_two_corners_meet_both():
    """A corner of each cell and the start are on one line, which rounding bends."""
    start, goal = np.array([28.7, 21.3]), np.array([44.0, 5.0]) + 1.0 / 3.0
    blocked = np.zeros((46, 22), dtype=bool)
    blocked[36, 12] = blocked[41, 7] = True
    space = map_of(
        np.where(blocked, BLOCKED, FREE).astype(np.uint8), outside="blocked", spacing=1.0
    )
    expected = find_shortest_length(blocked, start, goal)
    assert space.min_path_length(start, goal) <= expected * (1.0 + 1e-9)
    path = planners.plan(space, start, goal).waypoints
    assert path_length(path) <= expected + 4.0 * MARGIN


def draw_world(rng, kind):
    """Draw the map of a rectangle among blocks of side 1, and the blocks grown by the rectangle.

    The blocks may be columns from floor to ceiling. If the rectangle rotates, a disc around it grows
    them.
    """
    cells = rng.random(rng.integers(3, 8, 2)) < rng.uniform(0.1, 0.4)
    half, parts = rng.uniform(0.05, 0.6, 2), int(rng.integers(4, 10))
    outside = "blocked" if kind == "columns in space" else str(rng.choice(["blocked", "free"]))
    occupied = np.kron(cells, np.ones((parts, parts), dtype=np.bool_))
    robot, rotations = Robot.rectangle(2.0 * half[0], 2.0 * half[1]), None
    if kind == "columns in space":
        occupied = np.repeat(occupied[..., None], 2 * parts, axis=2)
        robot = Robot.box((*(2.0 * half), HEIGHT))
    if kind == "plane with rotations":
        half = half / 2.0
        robot, rotations = Robot.rectangle(2.0 * half[0], 2.0 * half[1]), int(rng.integers(4, 9))
    workspace = Workspace.from_array(occupied, 1.0 / parts)
    space = build(workspace, robot, rotations=rotations, outside=outside)
    corners = np.argwhere(cells)
    if rotations is None:
        grown = [shapely.box(*(corner - half), *(corner + 1.0 + half)) for corner in corners]
    else:  # the buffer's circle of 8 corners a quarter contains a circle of 0.5025
        half = np.full(2, 1.02 * math.hypot(*half))
        blocks = [shapely.box(*corner, *(corner + 1.0)) for corner in corners]
        grown = [block.buffer(half[0], quad_segs=8) for block in blocks]
    if outside == "blocked":
        inner = shapely.box(*half, *np.maximum(np.array(cells.shape) - half, half))
        grown.append(shapely.box(-9, -9, 99, 99) - inner)
    return space, shapely.union_all(grown)


@pytest.mark.parametrize("kind", ["plane", "columns in space", "plane with rotations"])
@examples(20)
@given(seeds)
def test_bounds_lie_between_the_distance_and_the_shortest_path(kind, seed):
    rng = np.random.default_rng(seed)
    space, obstacles = draw_world(rng, kind)
    inner = shapely.box(*space.grid.lower[:2], *space.grid.upper[:2]) - obstacles
    points = rng.uniform(space.grid.lower, space.grid.upper, (20, space.grid.dim))
    points = points[shapely.contains_xy(inner, *points[:, :2].T)][:3]
    # Clear of floor and ceiling.
    points[:, 2:] = points[:, 2:].clip(0.5 * HEIGHT, 2.0 - 0.5 * HEIGHT)
    yaw = [0.0] * (space.size - space.grid.dim)
    for start, goal in itertools.pairwise(points):
        length = math.hypot(shortest_length(obstacles, start[:2], goal[:2]), *(goal - start)[2:])
        bound = space.min_path_length((*start, *yaw), (*goal, *yaw))
        assert np.linalg.norm(goal - start) * (1.0 - SLACK) - SLACK <= bound
        assert bound <= length * (1.0 + SLACK)


@pytest.mark.parametrize("name", MOVINGAI_MAPS)
def test_paths_on_real_maps_have_the_published_length(data, name):
    space, starts, goals, optimal = read_problems(data / "movingai" / f"{name}.map")
    # The published lengths are of paths along eight directions, at most 1.0824 of the shortest.
    for problem in np.linspace(0, len(starts) // 2, 3, dtype=int):
        path = planners.plan(space, starts[problem], goals[problem]).waypoints
        assert optimal[problem] / 1.0824 <= path_length(path) <= optimal[problem] + 1e-6
