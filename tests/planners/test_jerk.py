"""Motions with limited jerk: limits at every instant, shortest times, stops and going on.

Oracles: Ruckig, whose motions of a single joint are the fastest ones, and differences of positions
and accelerations. If the acceleration changes by at most the jerk times h in each time h, then it is
continuous and the jerk is within its limit.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cspace
import planners
from cspace import InputError
from planners._motion.timing import keeps_jerk
from tests.helpers.handmade import build_empty
from tests.helpers.motions import (
    build_plan,
    check_goes_on,
    check_limits,
    check_stop,
    make_limits,
)
from tests.helpers.refusals import refusals
from tests.helpers.strategies import few, seeds
from tests.helpers.urdfs import planar, post
from tests.planners.test_trajectory import draw_waypoints, plan_along

SLACK = 1.0 + 1e-6
JERK, TURN_JERK = 4.0, 10.0
STEPS = 4000


def measure_fastest(first, last, limits):
    """Return the seconds of Ruckig's motion from rest to rest, not along a line."""
    ruckig = pytest.importorskip("ruckig", reason="it has no wheel for each machine")
    joints = len(first)
    motion = ruckig.InputParameter(joints)
    motion.current_position, motion.target_position = first, last
    motion.max_velocity, motion.max_acceleration, motion.max_jerk = limits
    fastest = ruckig.Trajectory(joints)
    assert ruckig.Ruckig(joints).calculate(motion, fastest) == ruckig.Result.Working
    return fastest.duration


def find_steps(trajectory):
    """Return changes of the acceleration over a short time, per second."""
    h = trajectory.duration / STEPS
    t = h * np.arange(STEPS + 1)
    return np.diff(trajectory.sample(t)[2], axis=0) / h


def check_joints(trajectory, velocity, gain, jerk):
    """Check the limits of each joint, from rest or motion to rest."""
    t = np.linspace(0.0, trajectory.duration, STEPS)
    _, velocities, gains = trajectory.sample(t)
    assert (np.abs(velocities) <= SLACK * np.asarray(velocity)).all()
    assert (np.abs(gains) <= SLACK * np.asarray(gain)).all()
    assert (np.abs(find_steps(trajectory)) <= SLACK * np.asarray(jerk) + 1e-6).all()
    assert np.abs(trajectory.velocities[-1]).max() < 1e-9
    before_rest = trajectory.sample(np.nextafter(trajectory.duration, 0.0))[2]
    np.testing.assert_allclose(before_rest, 0.0, atol=1e-5)


def check_plane(trajectory, turn_jerk=math.inf):
    """Check the limits of a robot in the plane."""
    check_limits(trajectory, SLACK)
    steps = find_steps(trajectory)
    assert np.linalg.norm(steps[:, :2], axis=1).max() <= SLACK * JERK
    assert np.abs(steps[:, 2:]).max(initial=0.0) <= SLACK * turn_jerk


# ---- straight edges ------------------------------------------------------------------------------


@given(seeds, st.integers(1, 7), *[st.floats(-2.0, 2.5)] * 3)
def test_a_straight_motion_takes_the_shortest_time(seed, joints, speed, gain, jerk):
    rng = np.random.default_rng(seed)
    rows = rng.uniform(-3.0, 3.0, (2, joints))
    # Joints whose limits differ by far more gain time off the line, where Ruckig drives.
    limits = [math.exp(each) * rng.uniform(0.7, 1.4, joints) for each in (speed, gain, jerk)]
    names = "max_velocity", "max_acceleration", "max_jerk"
    axes, units = tuple(f"joint{k}" for k in range(joints)), ("rad",) * joints
    plan = replace(
        plan_along("joints", rows[:, :1]), axes=axes, units=units, path=rows, waypoints=rows
    )
    motion = plan.trajectory(**dict(zip(names, limits, strict=True)))
    assert motion.duration <= 1.15 * measure_fastest(*rows, limits)
    # A single joint that is limited as the line.
    shares = [[float((each / np.abs(rows[1] - rows[0])).min())] for each in limits]
    assert motion.duration == pytest.approx(measure_fastest([0.0], [1.0], shares), rel=1e-6)
    check_joints(motion, *limits)
    np.testing.assert_allclose(motion.positions[[0, -1]], rows, atol=1e-9)


@given(seeds, st.integers(2, 5), st.sampled_from(["plane", "turning", "floating", "joints"]))
def test_motions_stop_at_corners_within_the_limit(seed, count, kind):
    rng = np.random.default_rng(seed)
    rows = draw_waypoints(kind, rng, count)
    limits = {"max_velocity": 1.0, "max_acceleration": 0.7, "max_jerk": 3.0}
    if kind in ("turning", "floating"):
        limits |= {"max_angular_velocity": 1.0, "max_angular_acceleration": 2.0}
        limits |= {"max_angular_jerk": 5.0}
    trajectory = plan_along(kind, rows).trajectory(**limits)
    if not trajectory.duration:
        return
    dim = 2 if kind in ("plane", "turning") else 3
    steps = find_steps(trajectory)[:, :dim]
    sizes = np.abs(steps) if kind == "joints" else np.linalg.norm(steps, axis=1)
    assert sizes.max() <= 3.0 * SLACK + 1e-6
    if kind == "turning":
        assert np.abs(find_steps(trajectory)[:, 2]).max() <= 5.0 * SLACK + 1e-6
    unlimited = {name: limit for name, limit in limits.items() if not name.endswith("jerk")}
    assert trajectory.duration > plan_along(kind, rows).trajectory(**unlimited).duration


@given(seeds, st.floats(-9.0, -5.0))
def test_a_tiny_edge_is_driven_as_any_other(seed, tiny):
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(rng.integers(2, 6), 3))
    steps[rng.integers(len(steps))] *= 10.0**tiny
    rows = np.cumsum(np.concatenate([rng.uniform(-2.0, 2.0, (1, 3)), steps]), axis=0)
    trajectory = plan_along("joints", rows).trajectory(
        max_velocity=2.0, max_acceleration=5.0, max_jerk=50.0
    )
    check_joints(trajectory, 2.0, 5.0, 50.0)
    np.testing.assert_allclose(trajectory.positions[-1], rows[-1], atol=1e-9)


def test_a_car_drives_its_curves_with_limited_jerk_along_them():
    rows = [(0.0, 0.0, 0.0), (2.0, 1.0, 1.0), (0.0, 0.5, 0.0)]
    plan = plan_along("turning", rows, "reeds-shepp")
    motion = plan.trajectory(max_velocity=1.5, max_acceleration=0.8, max_jerk=2.0)
    h = motion.duration / STEPS
    positions, velocities, _ = motion.sample(h * np.arange(STEPS + 1))
    yaws = positions[:, 2]
    speeds = np.cos(yaws) * velocities[:, 0] + np.sin(yaws) * velocities[:, 1]
    assert np.abs(np.diff(speeds)).max() <= SLACK * 0.8 * h
    assert np.abs(np.diff(speeds, 2)).max() <= SLACK * 2.0 * h**2


# ---- curves --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "drive, rotations", [("holonomic", None), ("holonomic", 36), ("differential", 36)]
)
def test_limits_hold_at_every_instant_of_blended_motions(drive, rotations):
    plan = build_plan(1, drive, rotations)
    limits = make_limits(rotations)
    unlimited = plan.trajectory(**limits)
    limits["max_jerk"] = JERK
    if rotations and drive == "holonomic":
        limits["max_angular_jerk"] = TURN_JERK
    trajectory = plan.trajectory(**limits)
    assert trajectory.certified
    assert trajectory.recheck(plan.space).all()
    check_plane(trajectory, TURN_JERK if "max_angular_jerk" in limits else math.inf)
    assert unlimited.duration < trajectory.duration <= 1.3 * unlimited.duration
    # The curve is the same one.
    np.testing.assert_array_equal(trajectory._segments.starts, unlimited._segments.starts)
    lower = trajectory._bounds.jerk._replace(linear=np.array(0.9 * JERK))
    made = trajectory._segments, trajectory._phases, trajectory._bounds
    assert keeps_jerk(*made, trajectory._bounds.jerk)
    assert not keeps_jerk(*made, lower)


def test_a_differential_drive_with_an_angular_limit_stops_at_corners():
    plan = build_plan(1, "differential", 36)
    limits = make_limits(36, max_jerk=JERK)
    trajectory = plan.trajectory(**limits, max_angular_jerk=TURN_JERK)
    check_plane(trajectory, TURN_JERK)
    assert trajectory.duration > plan.trajectory(**limits).duration


# ---- stops and going on --------------------------------------------------------------------------


@pytest.mark.parametrize("drive", ["dubins", "reeds-shepp"])
def test_a_car_with_hardly_limited_jerk_is_as_fast_between_its_arcs_as_without(drive):
    rows = [(0.0, 0.0, 0.0), (4.0, 1.0, 0.5), (8.0, 0.0, 0.0), (12.0, 1.0, 0.0)]
    plan = plan_along("turning", rows, drive)
    limits = {"max_velocity": 1.5, "max_acceleration": 0.8}
    limited = plan.trajectory(**limits, max_jerk=1e4).duration
    assert limited <= 1.01 * plan.trajectory(**limits).duration


@pytest.mark.parametrize("rounds", few([3, 8]))
@pytest.mark.parametrize("drive, rotations", [("holonomic", None), ("differential", 36)])
def test_stops_and_going_on_keep_the_limit(drive, rotations, rounds):
    plan = build_plan(1, drive, rotations)
    limits = make_limits(rotations, max_jerk=JERK)
    trajectory = plan.trajectory(**limits)
    reached = 0
    for t in np.random.default_rng(0).uniform(0.05, trajectory.duration - 0.05, rounds):
        made = [check_stop(trajectory, t, plan.space)]
        for place in trajectory.starts_after(t):
            again = planners.plan(plan.space, place, plan.goal, drive=plan.drive, previous=plan)
            made.append(again.trajectory(**limits, after=trajectory, at=t))
            check_goes_on(made[-1], trajectory, t, plan.space)
            reached += not made[-1].stop_reason
        for motion in made:
            check_plane(motion)
            gains = trajectory.sample(t)[2], motion.sample(0.0)[2]
            np.testing.assert_allclose(*gains, atol=1e-6)
    assert reached >= 0.7 * rounds


def test_a_stop_on_a_line_is_a_ramp():
    space = build_empty((120, 60), cspace.Robot.disc(0.3))
    plan = planners.plan(space, (1.0, 3.0), (11.0, 3.0))
    trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=0.5, max_jerk=1.0)
    # At full speed: 1 / 0.5 + 0.5 / 1 seconds, half as many metres.
    assert trajectory.braked(5.0).duration == pytest.approx(2.5, rel=1e-6)
    assert trajectory.stop_distance(5.0) == pytest.approx(1.25, rel=1e-6)
    # At the largest acceleration, after 1 s at 0.375 m/s, the speed rises by 0.125 m/s first.
    stop = trajectory.braked(1.0)
    check_joints(stop, 1.0, 0.5, 1.0)
    assert stop.duration == pytest.approx(0.5 + 2.0 * math.sqrt(0.5), abs=0.1)
    # On the way to rest, the stop is the motion itself.
    late = trajectory.duration - 0.2
    assert trajectory.braked(late).duration == pytest.approx(0.2, rel=1e-4)


@pytest.mark.parametrize("metres", [100.0, 1e3, 1e5])
def test_ramps_and_stops_are_as_short_on_a_long_way(metres):
    plan = plan_along("plane", [(0.0, 0.0), (metres, 0.0)])
    trajectory = plan.trajectory(max_velocity=10.0, max_acceleration=10.0, max_jerk=100.0)
    # Full speed over the acceleration, and the acceleration over the jerk.
    shortest = 1.0 + 0.1
    assert trajectory.duration == pytest.approx(metres / 10.0 + shortest, abs=1e-2)
    assert trajectory.braked(3.0).duration == pytest.approx(shortest, rel=1e-6)
    assert trajectory.stop_distance(3.0) == pytest.approx(5.0 * shortest, rel=1e-6)


@pytest.mark.filterwarnings("ignore:path. the arm stops")  # at corners of the plan
def test_an_arm_keeps_the_limit_of_each_joint(tmp_path):
    space = cspace.build_arm_space({"post": post()}, cspace.Arm.from_urdf(planar(tmp_path)))
    plan = planners.plan(space, (-0.6, 0.3), (1.4, -0.2), seed=1, time_limit=5.0)
    first, second = space.axes
    limits = {"max_velocity": 1.0, "max_acceleration": 2.0}
    trajectory = plan.trajectory(**limits, max_jerk={first: 10.0, second: 25.0})
    assert trajectory.certified
    check_joints(trajectory, 1.0, 2.0, (10.0, 25.0))
    along = planners.Trajectory.along(space, plan.waypoints, **limits, max_jerk=(10.0, 25.0))
    check_joints(along, 1.0, 2.0, (10.0, 25.0))
    for t in np.linspace(0.1, trajectory.duration - 0.1, 4):
        check_joints(trajectory.braked(t), 1.0, 2.0, (10.0, 25.0))


# ---- bad input -----------------------------------------------------------------------------------


@refusals(
    "options, expected",
    ({"max_jerk": 0.0}, "max_jerk is 0"),
    ({"max_jerk": {"shoulder": 1.0, "elbo": 2.0}}, "elbo"),
    ({"max_jerk": math.nan}, "max_jerk"),
    ({"max_jerk": 1.0, "max_angular_jerk": 1.0}, "the robot does not turn so"),
)
def test_limits_of_jerk_are_checked(options, expected):
    plan = plan_along("joints", draw_waypoints("joints", np.random.default_rng(0), 3))
    with pytest.raises(InputError, match=expected):
        plan.trajectory(max_velocity=1.0, max_acceleration=1.0, **options)


def test_an_angular_limit_alone_is_refused():
    plan = plan_along("turning", draw_waypoints("turning", np.random.default_rng(0), 3))
    options = make_limits(36, max_angular_jerk=3.0)
    with pytest.raises(InputError, match="max_jerk is missing"):
        plan.trajectory(**options)
    plan.trajectory(**options, max_jerk=1.0)
