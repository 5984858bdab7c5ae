"""The watch over answers refuses what a map of another robot says, and the drives of other cars."""

import dataclasses

import numpy as np
import pytest

import cspace
import planners
from cspace import CSpace, Robot, Workspace
from cspace.lanes import Mover, Timing
from tests.helpers import answers
from tests.helpers.drives import make_drive
from tests.helpers.handmade import build_empty

SIDES = np.array([0.62, 0.42])


def build_false(occupied, built, told):
    """Build the map of a rectangle, and tell it that the robot is another one."""
    rotations = 16 if occupied.ndim == 2 else None
    space = cspace.build(Workspace.from_array(occupied, 0.1), built, rotations=rotations)
    return CSpace(dataclasses.replace(space._contents, robot=told), space._rasters)


def make_hall():
    """Return cells with a door of 8 cells in a wall."""
    cells = np.zeros((60, 40), bool)
    cells[28:32] = True
    cells[28:32, 16:24] = False
    return cells


@pytest.mark.parametrize("word", ["holonomic", "differential", "dubins", "reeds-shepp"])
def test_paths_of_a_smaller_robot_are_refused(word):
    larger = Robot.rectangle(*(SIDES + 0.45))
    space = build_false(make_hall(), Robot.rectangle(*SIDES), larger)
    options = {"drive": make_drive(word, 0.4), "time_limit": 1.0, "seed": 1}
    with pytest.raises(AssertionError, match="refuses this path: touches"):
        planners.plan(space, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), **options)
    answers.tally.is_on = False  # the curve, of a plan that nothing checked
    plan = planners.plan(space, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), **options)
    answers.tally.is_on = True
    limits = {"max_velocity": 1.0, "max_acceleration": 1.0}
    if word in ("holonomic", "differential"):
        limits |= {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}
    with pytest.raises(AssertionError, match="refuses this curve: touches"):
        plan.trajectory(**limits)


def test_absent_paths_of_a_larger_robot_are_refused():
    ends = (1.0, 2.0, 0.0), (5.0, 2.0, 0.0)
    space = build_false(make_hall(), Robot.rectangle(1.4, 1.2), Robot.rectangle(*SIDES))
    with pytest.raises(AssertionError, match="refuses this no path"):
        planners.plan(space, *ends)
    with pytest.raises(AssertionError, match="refuses this no path"):
        space.is_disconnected(*ends)
    true = build_false(make_hall(), Robot.rectangle(1.4, 1.2), Robot.rectangle(1.4, 1.2))
    assert planners.plan(true, *ends).is_disconnected
    assert answers.tally.seen["no path: proven"] == 1


def test_timings_that_touch_or_could_be_found_are_refused():
    space = build_empty((100, 60), "disc:0.3")
    plan = planners.plan(space, (1.0, 3.0), (9.0, 3.0))
    motion = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
    robot = Mover(space.robot, motion, at=1.7e9)
    person = Mover("disc:0.3", (5.0, 1.0), at=1.7e9 + 4.0, velocity=(0.0, 1.6))
    options = {"until": 1.7e9 + 60.0}
    with pytest.raises(AssertionError, match="refuses this timing: touches"):
        answers.check_timing(Timing(motion, 0.0), robot, [person], **options)
    with pytest.raises(AssertionError, match="not impossible"):
        answers.check_timing(Timing(None, np.inf, "impossible: ..."), robot, [person], **options)


def test_places_of_another_plan_are_refused():
    space = build_empty((40, 30), "disc:0.3")
    plan = planners.plan(space, (1.0, 1.5), (3.0, 1.5))
    with pytest.raises(AssertionError, match="is not in"):
        answers.check_plan(plan, space, (1.0, 1.5), planners.Near((3.0, 2.0), 0.4))
    with pytest.raises(AssertionError, match="FREE cells lead to"):
        answers.check_closest(plan, space, (1.0, 1.5), planners.Near((3.2, 1.5), 0.5, closest=True))
