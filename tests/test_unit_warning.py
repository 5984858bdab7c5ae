"""Warnings about robots whose size suggests another unit or origin."""

import warnings

import numpy as np
import pytest

import cspace
from cspace import Robot, UnitWarning, Workspace
from cspace._shapes import OriginPoint

PLANE = Workspace.from_array(np.zeros((100, 80), dtype=bool), 0.1)
SHELF = Workspace.from_array(np.zeros((20, 20, 4), dtype=bool), 0.1)


def find_warnings(call):
    """Return the unit warnings of a call."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        call()
    return [each for each in caught if each.category is UnitWarning]


SUSPECT_ROBOTS = {
    "in millimetres": (
        PLANE,
        Robot.rectangle(600, 400),
        {},
        ["600 m x 400 m", "10 m x 8 m", "units are metres"],
    ),
    "longer than the diagonal": (
        PLANE,
        Robot.rectangle(13, 0.4),
        {"rotations": 8},
        ["13 m x 0.4 m", "no cell is FREE"],
    ),
    "margin in millimetres": (
        PLANE,
        Robot.disc(0.2),
        {"margin": 50},
        ["0.4 m x 0.4 m", "50 m", "10 m x 8 m", "no cell is FREE"],
    ),
    "tiny": (
        PLANE,
        Robot.rectangle(0.0006, 0.0004),
        {},
        ["0.0006 m x 0.0004 m", "0.1 m", "metres"],
    ),
    "on a plan in centimetres": (
        Workspace.from_array(np.zeros((400, 300), dtype=bool), 1.98),
        Robot.disc(0.3),
        {},
        ["0.6 m x 0.6 m", "1.98 m", "metres"],
    ),
    "far from its origin": (
        PLANE,
        Robot.rectangle(0.6, 0.4, (14, 0)),
        {},
        ["0.6 m x 0.4 m", "13.7 m", "(-14, 0)"],
    ),
    "higher than the shelf": (
        SHELF,
        Robot.box((0.2, 0.2, 0.5)),
        {"rotations": 4},
        ["0.5 m", "2 m x 2 m x 0.4 m", "no cell is FREE"],
    ),
}


@pytest.mark.parametrize("case", SUSPECT_ROBOTS)
def test_a_build_warns_once_of_a_suspect_robot_with_measures_and_cause(case):
    workspace, robot, options, parts = SUSPECT_ROBOTS[case]
    (warning,) = find_warnings(lambda: cspace.build(workspace, robot, **options))
    assert all(part in str(warning.message) for part in parts)
    assert warning.filename == __file__ and issubclass(UnitWarning, UserWarning)


USUAL_ROBOTS = {
    "point": (PLANE, Robot("point", OriginPoint.at_origin(2)), {}),
    "as long, but for rounding": (PLANE, Robot.rectangle(10 + 2e-15, 0.4), {}),
    "a car on its axle": (PLANE, Robot.rectangle(4.5, 1.8, (1.3, 0)), {"rotations": 4}),
}


@pytest.mark.parametrize("case", USUAL_ROBOTS)
def test_a_build_with_a_usual_robot_does_not_warn(case):
    workspace, robot, options = USUAL_ROBOTS[case]
    assert not find_warnings(lambda: cspace.build(workspace, robot, **options))


@pytest.mark.parametrize(
    "workspace, robot, near, far",
    [
        (PLANE, Robot.disc(0.3), [(1.0, 1.0)], [(3000.0, 2000.0)]),
        (PLANE, Robot.disc(0.3), [(-0.2, 4.0)], [(-0.4, 4.0)]),  # a ball of 0.3 m at the border
        (SHELF, Robot.box((0.2, 0.2, 0.1)), [(1.0, 1.0, 0.2)], [(1.0, 1.0, 200.0)]),
    ],
)
def test_an_obstacle_wholly_outside_of_the_map_is_named(workspace, robot, near, far):
    space = cspace.build(workspace, robot)
    assert not find_warnings(lambda: space.add_obstacle("cart", near, radius=0.3))
    (warning,) = find_warnings(lambda: space.add_obstacle("cart", far, radius=0.3))
    assert "obstacle 'cart' lies outside the map, from (0, 0" in str(warning.message)
    assert list(space.obstacles) == ["cart"] and warning.filename == __file__
    assert not find_warnings(lambda: space.remove_obstacle("cart"))
