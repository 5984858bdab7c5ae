"""What a map hands out and also takes means the same when it goes in again."""

import numpy as np
import pytest

import cspace
from cspace import FREE, Robot, Workspace
from tests.helpers.any_map import MAP_INPUTS, build_map, reopen
from tests.helpers.gates import certify_chunk
from tests.helpers.handmade import build_empty


@pytest.fixture(scope="module", params=MAP_INPUTS)
def space(request, tmp_path_factory):
    """Build a map of each space, with a margin and a corner that is not the origin."""
    made = build_map(request.param, "memory", "free", 2, tmp_path_factory.mktemp("map")).space
    workspace = Workspace.from_array(made.workspace.outer, 0.1, np.arange(1.0, 1.0 + made.dim))
    options = {"rotations": made.rotations, "margin": 0.03, "outside": "free"}
    return cspace.build(workspace, made.robot, **options)


def take_cells(space):
    """Return a workspace of the cells that another one hands out."""
    given = space.workspace
    return Workspace.from_array(given.outer, given.grid.spacing, given.grid.lower)


PARTS = {
    "workspace": lambda space: (space.workspace, space.robot),
    "cells": lambda space: (take_cells(space), space.robot),
    "specification": lambda space: (space.workspace, Robot.from_spec(space.robot.spec)),
}


@pytest.mark.parametrize("name", PARTS)
def test_parts_of_a_map_build_it_again(space, name):
    workspace, robot = PARTS[name](space)
    options = {"rotations": space.rotations, "margin": space.margin, "outside": space.outside}
    again = cspace.build(workspace, robot, **options)
    assert again.grid == space.grid
    np.testing.assert_array_equal(again.cell_states, space.cell_states)


def test_a_saved_map_and_its_configurations_are_the_same(space, tmp_path):
    again = reopen(space, tmp_path / "map")
    q = space.sample_free(200, np.random.default_rng(0))
    assert again.is_free(q).all()
    turned = q + 2.0 * np.pi * np.array([name == "yaw" for name in space.axes])
    with pytest.warns(cspace.AngleWarning) if "yaw" in space.axes else np.errstate():
        assert again.is_free(turned).all()
    ends = np.array([again.check_endpoint(row, "start") for row in q])
    assert again.is_free(ends).all()
    np.testing.assert_allclose(space.steps_between(q, ends), 0.0, atol=1e-12)
    np.testing.assert_array_equal(space.classify(space.nearest_free(q[0])), FREE)


def test_obstacles_of_a_map_go_in_again(space):
    empty = Workspace.from_array(np.zeros_like(space.workspace.outer), 0.1, space.grid.lower)
    one, other = (cspace.build(empty, space.robot, rotations=space.rotations) for _ in range(2))
    middle = 0.5 * np.add(space.grid.lower, space.grid.upper)
    one.add_obstacle("balls", [middle, middle + 0.2], radius=0.1)
    one.add_obstacle("ball", [middle - 0.3], radius=[0.2])
    for name, shape in one.obstacles.items():
        other.add_obstacle(name, shape)
    np.testing.assert_array_equal(other.cell_states, one.cell_states)
    for name, shape in other.obstacles.items():
        assert other.add_obstacle(name, shape).changed == 0


def test_rows_and_errors_of_a_chunk_are_proven_again(space):
    tests = 0
    for q in space.sample_free(40, np.random.default_rng(1)):
        first = certify_chunk(space, q, [q, space.nearest_free(q)], 0.001)
        if first:
            again = certify_chunk(space, q, first.rows, first.max_tracking)
            assert again.is_proven and not np.isnan(again.max_tracking).any()
            tests += 1
    assert tests > 5


def test_grids_of_ros_are_read_as_the_cells_that_are_not_free():
    space = cspace.build(Workspace.from_array(np.eye(30, dtype=bool), 0.1, (3.0, -1.0)), "disc:0.3")
    read = Workspace.from_occupancy_grid(space.to_occupancy_grid())
    assert read.grid == space.grid
    np.testing.assert_array_equal(read.outer, space.cell_states != FREE)


def test_intervals_of_yaw_are_free_up_to_their_ends():
    space = build_empty((30, 9), Robot.rectangle(1.2, 0.2), rotations=36)
    intervals = space.free_yaws((1.5, 0.45))
    assert len(intervals) > 0 and np.ptp(intervals) < 2.0 * np.pi
    for low, high in intervals:
        yaws = np.linspace(low + 1e-9, high - 1e-9, 50)
        assert space.is_free([(1.5, 0.45, yaw) for yaw in yaws]).all()
