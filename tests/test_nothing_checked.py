"""Functions that say yes about a sequence, asked with none and one."""

import numpy as np
import pytest

import cspace
import planners
from tests.helpers.gates import certify_chunk
from tests.helpers.urdfs import planar_arm, post

WALL = (2.0, 1.5)
POST = (0.37, 0.0)
YES = {
    "certify_path": lambda space, rows: space.certify_path(rows).all(),
    "paths": lambda space, rows: space.certify_path(rows[:, np.newaxis]).all(),
    "certify_chunk": lambda space, rows: certify_chunk(space, rows[:1].sum(0), rows),
    "chunks": lambda space, rows: certify_chunk(space, rows, rows[:, np.newaxis]).is_proven.all(),
    "Gate": lambda space, rows: cspace.Gate(space).check_rows(rows[:1].sum(0), rows).state == "go",
    "distance": lambda space, rows: space.path_obstacle_distance(rows) > 0.0,
}

BATCHES = ("paths", "chunks")


@pytest.fixture(scope="module")
def spaces():
    """Build a map with a wall and an arm at a post, each with a configuration that touches."""
    occupied = np.zeros((40, 30), dtype=np.bool_)
    occupied[18:22] = True
    arm = planar_arm()
    return {
        "map": (cspace.build(cspace.Workspace.from_array(occupied, 0.1), "disc:0.2"), WALL),
        "arm": (cspace.build_arm_space({"post": post()}, arm), POST),
    }


@pytest.mark.parametrize("kind", ["map", "arm"])
@pytest.mark.parametrize("name", YES)
def test_neither_none_nor_one_in_collision_passes(spaces, kind, name):
    space, q = spaces[kind]
    assert not space.is_free(q)
    assert not YES[name](space, np.array([q]))
    assert YES[name](space, space.sample_free(1, np.random.default_rng(0)))
    if name not in BATCHES:
        with pytest.raises(cspace.InputError, match=r"has shape \(0, "):
            YES[name](space, np.empty((0, 2)))


@pytest.mark.parametrize("kind", ["map", "arm"])
@pytest.mark.parametrize("batches", [0, 3])
def test_batches_have_an_answer_for_each_row_and_none_without_rows(spaces, kind, batches):
    space, q = spaces[kind]
    starts, rows = np.full((batches, 2), q), np.full((batches, 2, 2), q)
    assert space.certify_path(rows).shape == (batches, 1)
    assert certify_chunk(space, starts, rows).proven.tolist() == [0] * batches
    with pytest.raises(cspace.InputError, match=rf"has shape \({batches}, 0, 2\)"):
        space.certify_path(rows[:, :0])
    with pytest.raises(cspace.InputError, match=rf"has shape \({batches}, 0, 2\)"):
        certify_chunk(space, starts, rows[:, :0])


def test_a_plan_without_a_path_is_false(spaces):
    space, _ = spaces["map"]
    assert not planners.plan(space, (1.0, 1.5), (3.0, 1.5))
    assert planners.plan(space, (1.0, 1.5), (1.0, 1.5))


def test_a_line_that_stops_early_is_false(spaces):
    space, _ = spaces["arm"]
    there = space.arm.pose((1.5, 0.3), "fore")
    assert space.follow_line((1.4, 0.3), "fore", there, tolerance=(0.1, np.inf))
    there[:2, 3] = 9.0
    assert not space.follow_line((1.4, 0.3), "fore", there, tolerance=(0.1, np.inf))
