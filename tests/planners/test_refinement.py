"""Rotations that errors of plans name, against builds with them."""

import math
import re

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
    """Return the rotations that the error of a plan names, or an empty text."""
    with pytest.raises(ConfigurationError) as caught:
        planners.plan(space, q, q)
    found = re.search(r"build the map with rotations=([^;]+);", caught.value.hint)
    return found[1] if found else ""


def list_counts(robot: Robot, rotations: int, distance: float) -> list[int]:
    """Return doubled numbers of yaw cells.

    Within one of the last ones, the robot moves by at most a distance.
    """
    lower, upper = robot.shape.outer.bounds
    reach = math.hypot(*np.maximum(-lower, upper))
    counts = [rotations]
    while 2.0 * reach * math.sin(math.pi / counts[-1] / 2.0) > distance:
        counts.append(2 * counts[-1])
    return counts[1:]


@pytest.mark.parametrize("rotations", [1, 2])
def test_too_few_rotations_in_a_corridor_name_how_many_are_needed(rotations: int) -> None:
    robot = Robot.rectangle(0.9, 0.3)
    space = build_corridor(robot, rotations)
    assert space.count()[0] == 0
    needed = int(find_hint(space, CORRIDOR[0]))
    assert planners.plan(build_corridor(robot, needed), *CORRIDOR).certified


def test_too_few_rotations_in_space_name_how_many_are_needed() -> None:
    robot, q = Robot.box((0.9, 0.3, 0.2)), (0.8, 0.5, 0.5)
    needed = int(find_hint(build_corridor(robot, 2, dim=3), (*q, 0.0)))
    assert build_corridor(robot, needed, dim=3).is_free((*q, 0.0))
    robot, q = Robot.box((0.5, 0.15, 0.1)), (*q, 0.0, 0.0, 0.0, 1.0)
    hint = find_hint(build_corridor(robot, Rotations.quaternions(2), 3), q)
    found = re.fullmatch(r"Rotations.quaternions\((\d+)\)", hint)
    assert found and build_corridor(robot, Rotations.quaternions(int(found[1])), 3).is_free(q)


def test_no_rotations_are_named_for_a_round_robot() -> None:
    assert find_hint(build_corridor(Robot.disc(0.29), 2), CORRIDOR[0]) == ""


def test_a_map_without_free_cells_names_rotations_in_which_the_robot_hardly_moves() -> None:
    space = build_corridor(Robot.rectangle(0.9, 0.3), 2)
    with pytest.raises(ConfigurationError) as caught:
        space.nearest_free(CORRIDOR[0])
    count = list_counts(space.robot, 2, space.grid.spacing)[-1]
    assert f"a finer spacing, rotations={count}, or" in caught.value.hint
    with pytest.raises(ConfigurationError) as plain:
        build_corridor(Robot.disc(0.5), 2).nearest_free(CORRIDOR[0])
    assert "rotations" not in plain.value.hint
