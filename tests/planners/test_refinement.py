"""Errors that ask for more rotations."""

import numpy as np
import pytest

import cspace
import planners
from cspace import ConfigurationError, CSpace, Robot, Rotations, Workspace

CORRIDOR = (0.8, 0.5, 0.0), (3.2, 0.5, 0.0)
"""Start and goal in the middle of a corridor along x."""


def build_corridor(robot: Robot, rotations: int | Rotations, dim: int = 2) -> CSpace:
    """Build a map of a corridor of 4 m, 0.6 m wide and, in space, 0.6 m high."""
    occupied = np.ones((80, 20, 20)[:dim], dtype=bool)
    occupied[(slice(2, 78), slice(4, 16), slice(4, 16))[:dim]] = False
    return cspace.build(Workspace.from_array(occupied, 0.05), robot, rotations=rotations)


def find_hint(space: CSpace, q: tuple[float, ...]) -> str:
    """Return the hint of the error of a plan."""
    with pytest.raises(ConfigurationError) as caught:
        planners.plan(space, q, q)
    return caught.value.hint or ""


@pytest.mark.parametrize("rotations", [1, 2])
def test_too_few_rotations_in_a_corridor_ask_for_more(rotations: int) -> None:
    robot = Robot.rectangle(0.9, 0.3)
    space = build_corridor(robot, rotations)
    assert space.count()[0] == 0
    assert "more rotations" in find_hint(space, CORRIDOR[0])
    assert planners.plan(build_corridor(robot, 48), *CORRIDOR).certified
    with pytest.raises(ConfigurationError) as caught:
        space.nearest_free(CORRIDOR[0])
    assert "a finer spacing, more rotations, or" in caught.value.hint


def test_too_few_rotations_in_space_ask_for_more() -> None:
    robot, q = Robot.box((0.5, 0.15, 0.1)), (0.8, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0)
    space = build_corridor(robot, Rotations.quaternions(2), 3)
    assert "more rotations" in find_hint(space, q)


def test_a_round_robot_needs_no_more_rotations() -> None:
    assert "rotations" not in find_hint(build_corridor(Robot.disc(0.29), 2), CORRIDOR[0])
    with pytest.raises(ConfigurationError) as caught:
        build_corridor(Robot.disc(0.5), 2).nearest_free(CORRIDOR[0])
    assert "rotations" not in caught.value.hint
