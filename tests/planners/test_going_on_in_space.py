"""Stops and motions that go on at speed in (x, y, z), with a yaw, and in SE(3).

Oracles: FCL places the robot beside the pillar, scipy rotates, and positions are differenced.
"""

import numpy as np
import pytest

import cspace
import planners
from tests.helpers.motions import (
    LIMITS,
    TURNING_LIMITS,
    check_goes_on,
    check_limits,
    check_stop,
)
from tests.helpers.strategies import few

SIDES = 0.3, 0.2, 0.1
"""Sides of the robot, metres."""

ENDS = (0.5, 1.0, 0.5), (1.5, 1.0, 0.5)
TURNS = {
    "fixed": ((), ()),
    "yaw": ((0.0,), (1.0,)),
    "quaternion": ((0.0, 0.0, 0.0, 1.0), (0.0, 0.6, 0.0, 0.8)),
}
"""Rotations at both ends."""


def build_space(kind):
    """Build a room with a pillar."""
    occupied = np.zeros((20, 20, 20), dtype=bool)
    occupied[8:12, 8:12, :14] = True
    rotations = {"fixed": None, "yaw": 24, "quaternion": cspace.Rotations.quaternions(4)}[kind]
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    return cspace.build(workspace, cspace.Robot.box(SIDES), rotations=rotations)


@pytest.mark.parametrize("rounds", few([2, 5]))
@pytest.mark.parametrize("kind", TURNS)
def test_a_robot_in_space_stops_and_goes_on_within_limits_and_proofs(kind, rounds):
    space = build_space(kind)
    start, goal = (end + turn for end, turn in zip(ENDS, TURNS[kind], strict=True))
    limits = LIMITS | (TURNING_LIMITS if kind != "fixed" else {})
    plan = planners.plan(space, start, goal, seed=1, time_limit=5.0)
    trajectory = plan.trajectory(**limits)
    check_limits(trajectory)
    at_speed = 0
    for t in np.random.default_rng(0).uniform(0.0, trajectory.duration, rounds):
        stop = check_stop(trajectory, t, space)
        again = planners.plan(space, stop.positions[-1], goal, previous=plan, seed=1)
        on = again.trajectory(**limits, after=trajectory, at=t)
        back = planners.plan(space, stop.positions[-1], start, seed=1, time_limit=5.0)
        for made in (stop, on, back.trajectory(**limits, after=trajectory, at=t)):
            check_goes_on(made, trajectory, t, space)
            check_limits(made)
        assert on.positions[-1][:3] == pytest.approx(goal[:3], abs=1e-9)
        at_speed += on.duration <= trajectory.duration - t + 0.05
    assert at_speed >= rounds - 1
