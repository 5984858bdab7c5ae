"""Stops on a trajectory's curve, and trajectories that go on after another one at speed.

Oracles: shapely places the robot among occupied cells, the arm's own links are placed by hand, and
positions and velocities are differenced.
"""

import dataclasses
import math
from functools import cache

import numpy as np
import pytest
import shapely
import shapely.affinity
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace import InputError
from planners._motion.timing import find_stop
from tests.helpers.drives import CURVES, make_drive
from tests.helpers.handmade import build_empty
from tests.helpers.motions import (
    LIMITS,
    SLACK,
    TURNING_LIMITS,
    build_plan,
    check_goes_on,
    check_limits,
    check_stop,
    make_limits,
    replace_rows,
    sample_evenly,
)
from tests.helpers.placements import collides
from tests.helpers.planning import build_open_map
from tests.helpers.strategies import few
from tests.helpers.urdfs import planar_arm

DRIVES = [
    ("holonomic", None),
    ("holonomic", 36),
    ("differential", 36),
    ("reeds-shepp", 36),
]


def draw_times(trajectory, count):
    """Draw times of a trajectory."""
    return np.random.default_rng(0).uniform(0.0, trajectory.duration, count)


def find_curvature_jump(trajectory):
    """Return the largest change of the curvature in 1 ms, relative to the largest curvature.

    Up to the ramp to its goal, the robot may not rest.
    """
    t = np.arange(0.0, trajectory.duration - 2.5, 1e-3)
    _, velocities, gains = trajectory.sample(t)
    speeds = np.linalg.norm(velocities[:, :2], axis=1)
    assert speeds.min() > 0.1
    cross = velocities[:, 0] * gains[:, 1] - velocities[:, 1] * gains[:, 0]
    curvatures = np.abs(cross / speeds**3)
    assert curvatures.max() > 0.1
    return float(np.abs(np.diff(cross / speeds**3)).max() / curvatures.max())


def plan_ahead():
    """Plan along a line of 10 m."""
    return planners.plan(build_empty((120, 60), "disc:0.3"), (1.0, 3.0), (11.0, 3.0))


# ---- stops ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("drive, rotations", few(DRIVES, 2))
def test_a_stop_is_a_part_of_the_curve_within_limits(drive, rotations):
    plan = build_plan(1, drive, rotations)
    trajectory = plan.trajectory(**make_limits(rotations, drive))
    for t in draw_times(trajectory, 8):
        stop = check_stop(trajectory, t, plan.space)
        check_limits(stop)
        shares = np.linspace(0.0, 1.0, 400)
        rows = stop.sample(shares * stop.duration)[0][:, :2]
        later = trajectory.sample(t + shares * min(4.0 * stop.duration, trajectory.duration - t))
        gaps = np.linalg.norm(rows[:, np.newaxis] - later[0][:, :2], axis=2).min(axis=1)
        assert gaps.max() < 0.02
        assert not collides(plan.space, stop.sample(shares * stop.duration)[0], grow=-1e-6).any()


def test_a_stop_on_a_line_takes_the_time_and_the_distance_of_the_formula():
    plan = plan_ahead()
    trajectory = plan.trajectory(max_velocity=1.5, max_acceleration=0.5)
    for t, speed in ((0.0, 0.0), (2.0, 1.0), (5.0, 1.5), (trajectory.duration - 1.0, 0.5)):
        assert trajectory.braked(t).duration == pytest.approx(speed / 0.5, abs=1e-9)
        assert trajectory.stop_distance(t) == pytest.approx(speed**2 / 1.0, abs=1e-9)
    slowed = plan.trajectory(max_velocity=1.5, max_acceleration=0.5, duration=20.0)
    speed = float(np.linalg.norm(slowed.sample(10.0)[1]))
    assert slowed.braked(10.0).duration == pytest.approx(speed / 0.5, abs=1e-9)


def test_a_stop_ends_before_what_the_curve_would_meet():
    plan = plan_ahead()
    trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
    x = trajectory.sample(4.0)[0][0]
    reach = x + trajectory.stop_distance(4.0) + 0.3
    plan.space.add_obstacle("crate", shapely.box(reach + 0.3, 2.5, reach + 0.8, 3.5))
    assert not trajectory.recheck(plan.space).all()
    assert trajectory.braked(4.0).recheck(plan.space).all()
    assert not trajectory.braked(4.5).recheck(plan.space).all()


def test_a_stop_from_the_end_of_a_line_takes_the_time_of_the_formula():
    plan = plan_ahead()
    # A waypoint on the way cuts the line; the robot passes it at 1 m/s, after 1 + 2 s.
    way = np.array([(1.0, 3.0), (3.5, 3.0), (11.0, 3.0)])
    plan = replace_rows(plan, way)
    trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=1.0, blend=False)
    for t in (3.0, np.nextafter(3.0, 0.0), np.nextafter(3.0, 4.0)):
        stop = trajectory.braked(t)
        assert stop.duration == pytest.approx(1.0, abs=1e-9)
        assert stop.positions[-1] == pytest.approx((4.0, 3.0), abs=1e-9)
    # The state may lie at the end of the first line, by rounding or by a cut.
    pieces = trajectory._segments
    for begin in (pieces.lengths[0], np.nextafter(pieces.lengths[0], 0.0)):
        rest = find_stop(pieces, trajectory._rotations, trajectory._bounds, float(begin), 1.0)
        assert rest.times[-1] == pytest.approx(1.0, abs=1e-9)
        assert rest.positions[-1] == pytest.approx(0.5, abs=1e-9)


def test_a_robot_on_its_way_plans_from_a_mixed_cell_by_geometry():
    plan = plan_ahead()
    space, place = plan.space, (4.03, 3.03)
    space.add_obstacle("crate", shapely.box(4.36, 2.5, 4.8, 3.5))  # 3 cm from the robot
    assert space.classify(place) == cspace.MIXED
    with pytest.raises(cspace.ConfigurationError, match=r"space\.exact proves it free"):
        planners.plan(space, place, plan.goal)
    again = planners.plan(space, place, plan.goal, previous=plan)
    assert again.exact and again.trajectory(**LIMITS).certified
    with pytest.raises(cspace.ConfigurationError, match="BLOCKED"):
        planners.plan(space, (4.5, 3.0), plan.goal, previous=plan)


def test_stops_at_rest_and_beyond_the_ends_take_no_time():
    trajectory = build_plan(1, "differential", 36).trajectory(**LIMITS, **TURNING_LIMITS)
    for t, row in ((-3.0, 0), (0.0, 0), (trajectory.duration, -1), (1e9, -1)):
        stop = trajectory.braked(t)
        assert stop.duration == 0.0
        assert stop.positions == pytest.approx(trajectory.positions[[row]], abs=1e-9)
        assert not stop.velocities.any()
    for t in (math.nan, math.inf):
        with pytest.raises(InputError, match="finite"):
            trajectory.braked(t)
    several = (1.0, 2.0)
    with pytest.raises(InputError, match=r"t has shape \(2,\).*one time"):
        trajectory.braked(several)


# ---- going on ------------------------------------------------------------------------------------


@pytest.mark.parametrize("rounds", few([3, 6]))
@pytest.mark.parametrize("drive, rotations", few([*DRIVES, ("dubins", 36)], 3))
def test_a_motion_goes_on_at_once_or_stops(drive, rotations, rounds):
    plan = build_plan(1, drive, rotations)
    limits = make_limits(rotations, drive)
    options = {"drive": plan.drive, "previous": plan}
    trajectory = plan.trajectory(**limits)
    reached = 0
    for t in draw_times(trajectory, rounds):
        here, rest = trajectory.starts_after(t)
        assert here == pytest.approx(trajectory.sample(t)[0], abs=1e-9)
        assert rest == pytest.approx(trajectory.braked(t).positions[-1], abs=1e-9)
        for place in (here, rest):
            again = planners.plan(plan.space, place, plan.goal, **options)
            motion = again.trajectory(**limits, after=trajectory, at=t)
            check_goes_on(motion, trajectory, t, plan.space)
            check_limits(motion)
            rows, velocities, _ = sample_evenly(motion, 1000)
            if drive == "differential":
                ahead, aside = np.cos(rows[:, 2]), -np.sin(rows[:, 2])
                sideways = ahead * velocities[:, 1] + aside * velocities[:, 0]
                assert np.abs(sideways).max() < 1e-9
            is_there = motion.positions[-1] == pytest.approx(plan.goal, abs=1e-9)
            reached += is_there
            assert is_there or place is here
            if not is_there:
                assert motion.positions[-1] == pytest.approx(rest, abs=1e-9)
                assert motion.duration == trajectory.braked(t).duration
    assert reached >= 1.5 * rounds
    assert trajectory.starts_after(trajectory.duration).shape == (1, len(plan.goal))


@pytest.mark.parametrize("rotations, jerk", [(None, {}), (36, {}), (None, {"max_jerk": 2.0})])
def test_planning_anew_on_the_way_costs_hardly_any_time_and_no_curvature(rotations, jerk):
    space = build_empty((120, 60), cspace.Robot.disc(0.3), rotations=rotations)
    yaw = (0.0,) if rotations else ()
    options = {"drive": planners.Differential()} if rotations else {}
    limits = make_limits(rotations, **jerk)
    plan = planners.plan(space, (1.0, 2.0, *yaw), (11.0, 2.0, *yaw), **options)
    motion = plan.trajectory(**limits)
    duration = motion.duration
    for _ in range(20):
        place = motion.braked(0.1).positions[-1]
        plan = planners.plan(space, place, (11.0, 2.0, *yaw), previous=plan, **options)
        motion = plan.trajectory(**limits, after=motion, at=0.1)
        assert not motion.stop_reason
    assert motion.duration == pytest.approx(duration - 2.0, abs=0.3 if jerk else 0.02)
    if jerk:
        return
    # To a goal beside the way, and from bends to another one, it goes on without a stop.
    plan = planners.plan(space, motion.braked(1.0).positions[-1], (9.0, 4.5, *yaw), **options)
    turning = plan.trajectory(**limits, after=motion, at=1.0)
    assert find_curvature_jump(turning) < 0.02
    for at in (1.5, 2.0, 2.5):
        place = turning.braked(at).positions[-1]
        plan = planners.plan(space, place, (10.0, 1.0, *yaw), **options)
        assert find_curvature_jump(plan.trajectory(**limits, after=turning, at=at)) < 0.02


def test_other_limits_hold_from_the_first_instant_or_the_robot_stops():
    plan = build_plan(1, "holonomic", None)
    trajectory = plan.trajectory(**LIMITS)
    limits = {"max_velocity": 1.2, "max_acceleration": 0.5}
    for t in draw_times(trajectory, 12):
        stop = trajectory.braked(t)
        again = planners.plan(plan.space, stop.positions[-1], plan.goal, previous=plan)
        motion = again.trajectory(**limits, after=trajectory, at=t)
        if motion.duration > stop.duration:
            _, _, gains = sample_evenly(motion, 1000)
            assert np.linalg.norm(gains, axis=1).max() <= SLACK * 0.5
        else:
            np.testing.assert_array_equal(motion.positions, stop.positions)


def test_what_cannot_go_on_is_refused():
    plan = build_plan(1, "holonomic", None)
    trajectory = plan.trajectory(**LIMITS)
    nothing = "nothing"
    with pytest.raises(InputError, match=r"after is .*it must be a trajectory"):
        plan.trajectory(**LIMITS, after=nothing)
    with pytest.raises(InputError, match=r"duration is 9\.0"):
        plan.trajectory(**LIMITS, after=trajectory, duration=9.0)
    with pytest.raises(InputError, match=r"at.*starts"):
        plan.trajectory(**LIMITS, after=trajectory, at=2.0)
    with pytest.raises(InputError, match="finite"):
        plan.trajectory(**LIMITS, after=trajectory, at=math.nan)
    again = plan.trajectory(**LIMITS, after=trajectory)  # at rest
    np.testing.assert_allclose(again.positions, trajectory.positions, atol=1e-9)


@pytest.mark.parametrize("rounds", few([3, 9]))
@pytest.mark.parametrize("share", few([0.3, 0.0, 0.7, 0.95]))
def test_a_bend_of_micrometres_is_not_taken_up(share, rounds):
    cells = np.zeros((60, 60), dtype=bool)
    cells[20:24, :40] = cells[40:44, 20:] = True
    robot = cspace.Robot.rectangle(0.5, 0.3)
    space = cspace.build(cspace.Workspace.from_array(cells, 0.1), robot, rotations=36)
    limits = LIMITS | TURNING_LIMITS
    goal = (5.0, 5.0, 1.0)
    whole = planners.plan(space, (1.0, 1.0, 0.0), goal).trajectory(**limits)
    # A way to the same goal, in the last tens of microseconds, bends within micrometres.
    for at in whole.duration - np.geomspace(1e-5, 1e-4, rounds):
        plan = planners.plan(space, whole.starts_after(at)[0], goal)
        last = plan.trajectory(**limits, after=whole, at=at)
        t = share * last.duration
        for start in last.starts_after(t):
            back = planners.plan(space, start, (1.0, 1.0, 0.0))
            new = back.trajectory(**limits, after=last, at=t)
            np.testing.assert_allclose(new.sample(0.0)[1], last.sample(t)[1], atol=1e-9)


# ---- a law over all drives, spaces and arms ------------------------------------------------------

KINDS = {
    "plane": ("plane", "holonomic"),
    "floating": ("floating", "holonomic"),
    "reverse": ("turning", "differential-reverse"),
    "reeds-shepp": ("turning", "reeds-shepp"),
    "arm": ("arm", "holonomic"),
    "space": ("space", "holonomic"),
    "turning": ("turning", "holonomic"),
    "differential": ("turning", "differential"),
    "dubins": ("turning", "dubins"),
}
"""Space and drive of each kind of robot."""


@cache
def open_space(name):
    """Build a room, or the space of an arm, without obstacles."""
    if name != "arm":
        return build_open_map(name)
    return cspace.build_arm_space({}, planar_arm())


def draw_path(kind, rng, start=None):
    """Draw waypoints of a kind of robot, which begin at ``start`` if given."""
    space = open_space(KINDS[kind][0])
    rows = rng.uniform(2.0, 5.0, (5, space.size))
    if not space.has_poses:
        rows = rng.uniform(-1.5, 1.5, rows.shape)
    if kind == "floating":
        # A robot that does not rotate passes corners at speed.
        rows[:, 3:] = Rotation.random(random_state=rng).as_quat()
        rows[-1, 3:] = Rotation.random(random_state=rng).as_quat()
    if start is not None:
        rows[0] = start
        if kind == "floating":
            rows[:-1, 3:] = start[3:]
    if not KINDS[kind][1].startswith("differential"):
        return rows
    yaws = np.arctan2(*np.diff(rows[:, :2], axis=0).T[::-1])
    if kind == "reverse":
        yaws -= np.copysign(math.pi, yaws)
    # The robot turns on the spot, then drives.
    begins, ends = (np.column_stack([part, yaws]) for part in (rows[:-1, :2], rows[1:, :2]))
    return np.concatenate([rows[:1], np.stack([begins, ends], axis=1).reshape(-1, 3)])


def plan_through(kind, rows, **limits):
    """Return a plan through waypoints, with limits of the drive."""
    name, drive = KINDS[kind]
    space = open_space(name)
    q = np.zeros(space.size) + 3.0 * space.has_poses
    if name == "floating":
        q[3:] = 0.5
    plan = planners.plan(space, q, q, drive=make_drive(drive, 0.5, **limits))
    return replace_rows(plan, rows)


def draw_hard_times(motion, rng):
    """Draw times: any, at starts of phases, one ulp beside them, and where the speed is even."""
    starts = motion._phases.times
    gains = motion._phases.accelerations[:-1] * np.diff(starts)
    even = np.flatnonzero(np.abs(gains) <= 1e-6 * motion._phases.speeds[:-1])
    picked = rng.choice(even, 16)
    plateaus = starts[picked] + rng.random(16) * np.diff(starts)[picked]
    rows = rng.choice(starts[:-1], 8)
    anywhere = rng.uniform(0.0, motion.duration, 8)
    beside = np.nextafter(rows, [[-1.0], [math.inf]]).clip(0.0, motion.duration)
    return np.concatenate([anywhere, rows, *beside, plateaus])


@pytest.mark.parametrize("rounds", few([1, 2]))
@pytest.mark.parametrize("kind", few(KINDS, 5))
def test_each_motion_begins_where_the_robot_is_at_any_time(kind, rounds):
    rng = np.random.default_rng(2)
    limits = {"max_velocity": 1.0, "max_acceleration": 0.6}
    if kind in ("turning", "floating", "differential", "reverse"):
        limits |= TURNING_LIMITS
    sideways = {} if KINDS[kind][1] == "holonomic" else {"max_lateral_acceleration": 0.2}
    # The yaw rate of a car jumps between its arcs.
    dim = 2 if KINDS[kind][1] in CURVES else 7
    space = open_space(KINDS[kind][0])
    stops = 0
    for _ in range(rounds):
        plan = plan_through(kind, draw_path(kind, rng), **sideways)
        trajectory = plan.trajectory(**limits)
        for number, t in enumerate(draw_hard_times(trajectory, rng)):
            place, velocity, _ = trajectory.sample(t)
            motions = [trajectory.braked(t)]
            assert motions[0].duration <= trajectory.duration - t + 1e-9
            for start in trajectory.starts_after(t) if number % 4 == 0 else ():
                again = plan_through(kind, draw_path(kind, rng, start), **sideways)
                motions.append(again.trajectory(**limits, after=trajectory, at=t))
                stops += bool(motions[-1].stop_reason)
            for motion in motions:
                assert motion.certified
                assert motion.recheck(space).all()
                assert (np.diff(motion.times) > 0.0).all()
                # A quaternion may be the negative of the one before.
                sign = -1.0 if place[-1] * motion.positions[0][-1] < 0.0 else 1.0
                signs = np.where(np.arange(len(place)) < 3, 1.0, sign)
                first, rates, _ = motion.sample(0.0)
                np.testing.assert_allclose(signs * first, place, atol=1e-9)
                np.testing.assert_allclose((signs * rates)[:dim], velocity[:dim], atol=1e-6)
                # Soon after, it is where that velocity brings it.
                soon = motion.sample(min(1e-4, motion.duration))[0]
                apart = np.linalg.norm((signs * soon - place)[:2])
                assert apart <= 1e-4 * np.linalg.norm(velocity[:2]) + 1e-7
                assert not motion.velocities[-1].any()
                assert np.abs(np.diff(motion.positions[:, :2], axis=0)).max(initial=0.0) < 0.11
    assert stops < 20


def test_rows_lie_at_most_half_a_turn_apart():
    plan = plan_through("dubins", np.array([(3.0, 3.0, 0.0), (3.1, 3.4, -2.0)]))
    slow = plan.trajectory(max_velocity=1.0, max_acceleration=100.0, time_step=9.0)
    turned = np.abs(slow.omega[:-1]) * np.diff(slow.times)
    assert 2.0 < turned.max() <= 3.0
    assert turned.sum() > 2.0 * math.pi - 2.0
    with pytest.raises(InputError, match=r"rate is 0.1; .*half a turn.*; pass rate=1"):
        slow.sample_uniform(0.1)
    assert len(slow.sample_uniform(1.0).times) > 3


def test_a_stop_says_why_it_is_one():
    plan = build_plan(1, "holonomic", None)
    trajectory = plan.trajectory(**LIMITS)
    t = 0.4 * trajectory.duration
    assert not trajectory.stop_reason
    assert trajectory.braked(t).stop_reason == "braked() was called"
    again = planners.plan(plan.space, trajectory.starts_after(t)[1], plan.goal)
    assert not again.trajectory(**LIMITS, after=trajectory, at=t).stop_reason
    unsolved = dataclasses.replace(again, waypoints=again.waypoints[:0])
    stop = unsolved.trajectory(**LIMITS, after=trajectory, at=t)
    np.testing.assert_array_equal(stop.positions, trajectory.braked(t).positions)
    assert stop.stop_reason == "the plan has no path"
    assert "a stop: the plan has no path" in repr(stop)
    through = np.vstack([again.start, (0.0, 0.0), again.goal])
    blocked = dataclasses.replace(again, waypoints=through, path=through)
    motion = blocked.trajectory(**LIMITS, after=trajectory, at=t)
    np.testing.assert_array_equal(motion.positions, stop.positions)
    assert "proven" in motion.stop_reason


# ---- obstacles that appear ------------------------------------------------------------------------


@pytest.mark.parametrize("rounds", few([8, 25]))
@pytest.mark.parametrize("rotations", [None, 36])
def test_no_motion_goes_on_through_what_appeared(rotations, rounds):
    space = build_empty((120, 60), "rect:0.6x0.4" if rotations else "disc:0.3", rotations=rotations)
    drive = make_drive("differential-reverse" if rotations else None)
    points = [(9.0, 1.0), (3.0, 2.6), (6.0, 5.0), (10.5, 3.0)]  # it rests at each
    *via, goal = [(*point, None) for point in points] if rotations else points
    limits = make_limits(rotations, stop_at_via=True)

    def plan_from(start):
        return planners.plan(space, start, goal, via=via, drive=drive)

    old = plan_from((1.0, 1.0, 0.0) if rotations else (1.0, 1.0)).trajectory(**limits)
    again = plan_from(old.starts_after(0.5)[0])
    rng = np.random.default_rng(0)
    refused = 0
    for t in rng.uniform(3.0, old.duration, rounds):
        # The obstacle touches the robot's border, or stands in its way.
        angle, distance = rng.uniform((-math.pi, 0.0), (math.pi, 0.4))
        place = old.sample(t)[0][:2] + distance * np.array([math.cos(angle), math.sin(angle)])
        space.update({"appeared": shapely.box(*(place - 0.15), *(place + 0.15))})
        motion = again.trajectory(**limits, after=old, at=0.5)
        assert motion.certified and motion.recheck(space).all()
        refused += bool(motion.stop_reason)
        space.update({"appeared": None})
    assert refused
    assert not again.trajectory(**limits, after=old, at=0.5).stop_reason
