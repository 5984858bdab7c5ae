"""The map's own search among the planners."""

import math

import numpy as np
import pytest

import cspace
import planners
from cspace import MIXED, InputError, Robot, Workspace
from handmade import map_of


@pytest.mark.parametrize("simplify", [True, False])
@pytest.mark.parametrize("dim", [2, 3])
def test_cubes_among_the_planners(dim, simplify):
    occupied = np.zeros((60, 40, 12)[:dim], dtype=bool)
    occupied[30, :30] = True
    robot = Robot.disc(0.15) if dim == 2 else Robot.box((0.3, 0.3, 0.1))
    space = cspace.build(Workspace.from_array(occupied, 0.1), robot)
    ends = (0.5, 0.5, 0.5)[:dim], (5.5, 0.5, 0.5)[:dim]
    plan = planners.plan(space, *ends, planner="cubes", simplify=simplify)
    assert plan.solved and plan.certified and plan.planner == "Cubes"
    assert plan.path.tolist() == planners.plan(space, *ends, planner="Cubes", simplify=simplify, seed=3).path.tolist()
    assert 2 * math.hypot(2.5, 2.5) < plan.length < (9.0 if simplify else 20.0)


def test_cubes_where_nothing_is_proven():
    state = np.zeros((5, 3), np.uint8)
    state[2] = MIXED
    plan = planners.plan(map_of(state, outside="blocked", spacing=1.0), (0.5, 0.5), (4.5, 0.5), planner="Cubes")
    assert not plan.solved and plan.path_exists is None and "undecided" in plan.status


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"exact": True}, "exact is True"),
        ({"iterations": 5}, "iterations is 5"),
        ({"objective": "clearance"}, "objective is 'clearance'"),
    ],
)
def test_what_cubes_cannot_do(options, message):
    with pytest.raises(InputError, match=message):
        planners.plan(
            map_of(np.zeros((3, 3)), outside="blocked", spacing=1.0), (0.5, 0.5), (2.5, 2.5), planner="Cubes", **options
        )


def test_cubes_moves_without_a_turn():
    state = np.zeros((4, 3, 3), np.uint8)
    state[1, 1] = MIXED
    space = map_of(state, 4, "blocked", spacing=1.0)
    for yaw in (0.1, 1.6):
        plan = planners.plan(space, (0.5, 0.5, yaw), (2.5, 2.5, yaw), planner="Cubes", simplify=False)
        assert plan.solved == plan.certified == (yaw == 0.1) and (plan.path[:, 2] == yaw).all()
    with pytest.raises(InputError, match="turned otherwise"):
        planners.plan(space, (0.5, 0.5, 0.0), (2.5, 2.5, 0.1), planner="Cubes")
