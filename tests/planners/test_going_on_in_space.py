"""Stops and motions that go on at speed in (x, y, z), with a yaw, and in SE(3).

Oracles: FCL places the robot beside the pillar, scipy rotates, and positions are differenced.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cspace
import planners
from tests.helpers.solids import box, meet, rotation_of
from tests.helpers.strategies import few
from tests.planners.test_smoothing import LIMITS, SLACK, TURNING_LIMITS

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


def touches(rows):
    """Return whether the robot touches the pillar at some row, by FCL."""
    pillar = box((0.4, 0.4, 1.4), (1.0, 1.0, 0.7))
    sides = np.array(SIDES) - 1e-6
    return any(meet(box(sides, q[:3], rotation_of(q).as_matrix()), pillar) for q in rows)


def angular_velocities(rows, velocities):
    """Return the angular velocities in the robot's frame, shape (n, 3), from derivatives of rows."""
    if rows.shape[1] < 7:
        return np.pad(velocities[:, 3:], ((0, 0), (0, 7 - rows.shape[1])))
    h = 1e-6
    later = Rotation.from_quat(rows[:, 3:] + h * velocities[:, 3:])
    return np.asarray((Rotation.from_quat(rows[:, 3:]).inv() * later).as_rotvec() / h)


def check_motion(motion):
    """Check contacts, limits, and that velocities are those of the positions and never jump."""
    h = 1e-5
    t = np.linspace(h, max(motion.duration - h, h), 800)
    before, now, after = (motion.sample(t + k * h) for k in (-1, 0, 1))
    assert (after[0] - before[0])[:, :3] / (2.0 * h) == pytest.approx(now[1][:, :3], abs=1e-3)
    if now[0].shape[1] == 7:
        differences = (after[0] - before[0])[:, 3:] / (2.0 * h)
        assert differences == pytest.approx(now[1][:, 3:], abs=1e-3)
    assert np.linalg.norm(now[1][:, :3], axis=1).max() <= SLACK * 1.2
    gains = (after[1] - before[1])[:, :3] / (2.0 * h)
    assert np.linalg.norm(gains, axis=1).max() <= SLACK * 0.8
    turning = [angular_velocities(*sample[:2]) for sample in (before, now, after)]
    assert np.linalg.norm(turning[1], axis=1).max() <= SLACK * 1.0
    assert np.linalg.norm((turning[2] - turning[0]) / (2.0 * h), axis=1).max() <= SLACK * 2.0 + 1e-4
    assert not touches(now[0][::4])


@pytest.mark.parametrize("rounds", few([2, 5]))
@pytest.mark.parametrize("kind", TURNS)
def test_a_robot_in_space_stops_and_goes_on_within_limits_and_proofs(kind, rounds):
    space = build_space(kind)
    start, goal = (end + turn for end, turn in zip(ENDS, TURNS[kind], strict=True))
    limits = LIMITS | (TURNING_LIMITS if kind != "fixed" else {})
    plan = planners.plan(space, start, goal, seed=1, time_limit=5.0)
    trajectory = plan.trajectory(**limits)
    check_motion(trajectory)
    at_speed = 0
    for t in np.random.default_rng(0).uniform(0.0, trajectory.duration, rounds):
        stop = trajectory.braked(t)
        again = planners.plan(space, stop.positions[-1], goal, previous=plan, seed=1)
        on = again.trajectory(**limits, after=trajectory, at=t)
        back = planners.plan(space, stop.positions[-1], start, seed=1, time_limit=5.0)
        for made in (stop, on, back.trajectory(**limits, after=trajectory, at=t)):
            assert made.certified
            assert made.recheck(space).all()
            for before, after in zip(trajectory.sample(t)[:2], made.sample(0.0)[:2], strict=True):
                assert after == pytest.approx(before, abs=1e-9)
            check_motion(made)
        assert trajectory.braked(t).duration == stop.duration
        rows = stop.sample(np.linspace(0.0, stop.duration, 400))[0][:, :3]
        moved = np.linalg.norm(np.diff(rows, axis=0), axis=1).sum()
        assert trajectory.stop_distance(t) == pytest.approx(moved, abs=1e-3)
        assert on.positions[-1][:3] == pytest.approx(goal[:3], abs=1e-9)
        at_speed += on.duration <= trajectory.duration - t + 0.05
    assert at_speed >= rounds - 1
