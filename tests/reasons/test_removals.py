"""The fewest obstacles to remove, against maps of all subsets."""

import itertools
import time

import numpy as np
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import cspace
from tests.helpers.strategies import examples, seeds


def build_scene(boxes, base, rotations=None, robot=None, **options):
    """Build a map with named boxes, or those of some numbers, over the cells of a base."""
    robot = robot or cspace.Robot.rectangle(0.3, 0.2)
    workspace = cspace.Workspace.from_array(base, 0.1)
    space = cspace.build(workspace, robot, rotations=rotations, **options)
    for number, box in boxes.items() if isinstance(boxes, dict) else enumerate(boxes):
        space.add_obstacle(f"box {number}", box)
    return space


def check_fewest(boxes, rotations, *scene, **options):
    """Check which boxes are removed between two places, against maps of all subsets."""
    boxes = dict(enumerate(boxes))
    angles = () if rotations is None else (0.0,)
    ends = (0.2, 0.8, *angles), (2.2, 0.8, *angles)

    def joins(removed):
        rest = {number: box for number, box in boxes.items() if number not in removed}
        return build_scene(rest, *scene, rotations, **options).is_connected(*ends)

    space = build_scene(boxes, *scene, rotations, **options)
    removals = space.removals(*ends)
    assert list(space.obstacles) == [f"box {number}" for number in boxes]
    subsets = itertools.chain(*(itertools.combinations(boxes, n) for n in range(len(boxes) + 1)))
    fewest = next((removed for removed in subsets if joins(removed)), None)
    if removals is None:
        assert fewest is None
        return []
    assert len(removals) == removals.at_least == len(fewest) and removals.is_fewest
    assert joins([number for number in boxes if f"box {number}" in removals])
    return removals


@examples(10)
@given(seed=seeds, rotations=st.sampled_from([None, 6]))
def test_removals_are_the_fewest_of_all_subsets(seed, rotations):
    rng = np.random.default_rng(seed)
    base = rng.random((24, 16)) < 0.02
    corners = rng.uniform((0.3, 0.0), (2.0, 1.5), (4, 2))
    sizes = rng.uniform(0.1, (0.5, 1.4), (4, 2))
    check_fewest(shapely.box(*corners.T, *(corners + sizes).T), rotations, base)


def test_many_obstacles_get_bounds_from_both_sides():
    # Fourteen walls, one behind the other: all of them must leave.
    boxes = [shapely.box(0.5 + 0.2 * n, 0.0, 0.55 + 0.2 * n, 1.6) for n in range(14)]
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
@given(seed=seeds, rotations=st.sampled_from([None, 6]))
def test_removals_on_a_floor_leave_what_the_robot_passes_under(seed, rotations):
    rng = np.random.default_rng(seed)
    base = rng.random((24, 16, 8)) < 0.004
    corners = rng.uniform((0.3, 0.0, 0.0), (2.0, 1.5, 0.6), (4, 3))
    sizes = rng.uniform(0.1, (0.5, 1.4, 0.2), (4, 3))
    boxes = [
        trimesh.creation.box(bounds=bounds) for bounds in np.stack([corners, corners + sizes], 1)
    ]
    robot = cspace.Robot.box((0.3, 0.2, 0.3), (0.0, 0.0, 0.15))
    removals = check_fewest(boxes, rotations, base, robot=robot, floor=0.1)
    # Solids above the robot never need to leave.
    assert not any(corners[int(name[4:]), 2] > 0.45 for name in removals)


def test_removals_among_many_regions_take_seconds():
    cells = np.random.default_rng(0).random((300, 200)) < 0.004
    robot = cspace.Robot.rectangle(0.7, 0.5)
    space = cspace.build(cspace.Workspace.from_array(cells, 0.05), robot, rotations=36)
    space.removals((1.0, 1.0, 0.0), (1.2, 1.0, 0.0))
    start = time.process_time()
    space.removals((1.0, 1.0, 0.0), (1.2, 1.0, 0.0))
    assert time.process_time() - start < 1.5  # rows as numbers take 0.2 s, rows as pairs 2.7 s
