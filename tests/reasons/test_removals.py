"""The fewest obstacles to remove, against maps of all subsets."""

import itertools
import time

import numpy as np
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import cspace
from tests.helpers.strategies import examples


def build_scene(boxes, base, rotations=None):
    """Build a map with named boxes over the cells of a base."""
    robot = cspace.Robot.rectangle(0.3, 0.2)
    space = cspace.build(cspace.Workspace.from_array(base, 0.1), robot, rotations=rotations)
    for number, box in enumerate(boxes):
        space.add_obstacle(f"box {number}", shapely.box(*box))
    return space


def fewest_by_maps(base, boxes, ends, rotations):
    """Return the size of the smallest set of boxes without which a new map proves a path."""
    for size in range(len(boxes) + 1):
        for removed in itertools.combinations(range(len(boxes)), size):
            rest = [box for number, box in enumerate(boxes) if number not in removed]
            if build_scene(rest, base, rotations).is_connected(*ends):
                return size
    return None


@examples(10)
@given(seed=st.integers(0, 2**32 - 1), rotations=st.sampled_from([None, 6]))
def test_removals_are_the_fewest_of_all_subsets(seed, rotations):
    rng = np.random.default_rng(seed)
    base = rng.random((24, 16)) < 0.02
    corners = rng.uniform((0.3, 0.0), (2.0, 1.5), (4, 2))
    sizes = rng.uniform(0.1, (0.5, 1.4), (4, 2))
    boxes = np.column_stack([corners, corners + sizes]).tolist()
    angles = () if rotations is None else (0.0,)
    ends = (0.2, 0.8, *angles), (2.2, 0.8, *angles)
    space = build_scene(boxes, base, rotations)
    removals = space.removals(*ends)
    fewest = fewest_by_maps(base, boxes, ends, rotations)
    if removals is None:
        assert fewest is None
        return
    assert len(removals) == removals.at_least == fewest
    assert removals.is_fewest
    rest = [box for number, box in enumerate(boxes) if f"box {number}" not in removals]
    assert build_scene(rest, base, rotations).is_connected(*ends)
    assert list(space.obstacles) == [f"box {number}" for number in range(4)]


def test_many_obstacles_get_bounds_from_both_sides():
    # Fourteen walls, one behind the other: all of them must leave.
    boxes = [(0.5 + 0.2 * n, 0.0, 0.55 + 0.2 * n, 1.6) for n in range(14)]
    space = build_scene(boxes, np.zeros((40, 16), dtype=bool))
    removals = space.removals((0.25, 0.8), (3.8, 0.8))
    assert sorted(removals) == sorted(f"box {number}" for number in range(14))
    assert 4 <= removals.at_least < 14
    assert not removals.is_fewest


def test_nothing_is_removed_if_a_path_exists():
    space = build_scene([], np.zeros((20, 16), dtype=bool))
    removals = space.removals((0.3, 0.8), (1.6, 0.8))
    assert removals == []
    assert removals.is_fewest


@examples(5)
@given(seed=st.integers(0, 2**32 - 1), rotations=st.sampled_from([None, 6]))
def test_removals_on_a_floor_leave_what_the_robot_passes_under(seed, rotations):
    rng = np.random.default_rng(seed)
    base = rng.random((24, 16, 8)) < 0.004
    corners = rng.uniform((0.3, 0.0, 0.0), (2.0, 1.5, 0.6), (4, 3))
    sizes = rng.uniform(0.1, (0.5, 1.4, 0.2), (4, 3))
    robot = cspace.Robot.box((0.3, 0.2, 0.3), (0.0, 0.0, 0.15))

    def build(numbers):
        space = cspace.build(
            cspace.Workspace.from_array(base, 0.1), robot, rotations=rotations, floor=0.1
        )
        for number in numbers:
            box = trimesh.creation.box(bounds=[corners[number], corners[number] + sizes[number]])
            space.add_obstacle(f"box {number}", box)
        return space

    angles = () if rotations is None else (0.0,)
    ends = (0.2, 0.8, *angles), (2.2, 0.8, *angles)
    removals = build(range(4)).removals(*ends)
    # Solids above the robot never need to leave.
    high = [number for number in range(4) if corners[number, 2] > 0.45]
    sizes_that_give = [
        size
        for size in range(5)
        for removed in itertools.combinations(range(4), size)
        if build(set(range(4)) - set(removed)).is_connected(*ends)
    ]
    if removals is None:
        assert not sizes_that_give
        return
    assert removals.is_fewest and len(removals) == min(sizes_that_give)
    assert not set(removals) & {f"box {number}" for number in high}
    rest = [number for number in range(4) if f"box {number}" not in removals]
    assert build(rest).is_connected(*ends)


def test_removals_among_many_regions_take_seconds():
    cells = np.random.default_rng(0).random((300, 200)) < 0.004
    robot = cspace.Robot.rectangle(0.7, 0.5)
    space = cspace.build(cspace.Workspace.from_array(cells, 0.05), robot, rotations=36)
    space.removals((1.0, 1.0, 0.0), (1.2, 1.0, 0.0))
    start = time.process_time()
    space.removals((1.0, 1.0, 0.0), (1.2, 1.0, 0.0))
    assert time.process_time() - start < 1.5  # rows as numbers take 0.2 s, rows as pairs 2.7 s
