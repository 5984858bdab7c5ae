"""Largest speeds by places: zones and surroundings of obstacles, at every instant.

Oracles: shapely places the robot in the zones and among the occupied cells at thousands of
instants, and the times of trapezoids.
"""

import copy
import dataclasses
import pickle
import re
from functools import cache

import numpy as np
import pytest
import shapely
import trimesh
from shapely import affinity, box

import cspace
import planners
from cspace.errors import InputError, UnitWarning
from tests.helpers.handmade import build_empty
from tests.helpers.motions import FOOTPRINT, LIMITS, build_plan, make_limits, sample_evenly
from tests.helpers.placements import obstacles_of, place_robots
from tests.helpers.planning import build_open_map
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.regions import place_polygon
from tests.helpers.strategies import few

SLACK = 1.0 + 1e-6
QUICK = {"max_velocity": 2.0, "max_acceleration": 0.5}
EVERYWHERE = planners.SpeedZones([(box(0.0, 0.0, 22.0, 4.0), 0.5)])
"""A limit of speed in the whole hall."""

INSTANTS = 4001
JERK = {"max_jerk": 4.0}
DRIVES = [("holonomic", None), ("holonomic", 36), ("differential", 36), ("reeds-shepp", 36)]
EACH_MOTION = pytest.mark.parametrize(
    "drive, rotations, jerk",
    few(
        [
            *((*drive, JERK if number % 2 else {}) for number, drive in enumerate(DRIVES)),
            *((*drive, {} if number % 2 else JERK) for number, drive in enumerate(DRIVES)),
        ],
        4,
    ),
    ids=str,
)
"""Each drive, with limited jerk and without; quick tests take one of the two in turn."""


def draw_zones(plan, seed, count=6):
    """Draw turned rectangles, triangles and rings near the path of a plan, with speeds."""
    rng = np.random.default_rng(seed)
    zones = []
    for k in range(count):
        x, y = plan.path[rng.integers(len(plan.path)), :2] + rng.normal(0.0, 0.3, 2)
        area = box(x - rng.uniform(0.05, 0.8), y - 0.2, x + 0.2, y + rng.uniform(0.05, 1.0))
        if k % 3 == 1:
            area = shapely.Polygon(rng.normal((x, y), 0.6, (3, 2)))
        if k % 3 == 2:
            area = shapely.Point(x, y).buffer(0.8) - shapely.Point(x, y).buffer(0.5)
        zones.append((affinity.rotate(area, rng.uniform(0.0, 90.0)), float(rng.uniform(0.1, 0.9))))
    return zones


def sample_speeds(trajectory):
    """Return configurations and speeds of the reference point at instants."""
    q, velocities, _ = sample_evenly(trajectory, INSTANTS)
    return q, np.linalg.norm(velocities[:, :2], axis=1)


def allow_in_zones(q, zones, within="contour"):
    """Return the lowest speeds of zones at configurations."""
    robot = cspace.Robot.polygon(FOOTPRINT) if q.shape[1] == 3 else cspace.Robot.disc(0.3)
    bodies = place_robots(robot, q) if within == "contour" else shapely.points(q[:, :2])
    allowed = np.full(len(q), np.inf)
    for area, speed in zones:
        allowed[shapely.intersects(area, bodies) & (allowed > speed)] = speed
    return allowed


@pytest.mark.parametrize("rounds", few([1, 2]))
@pytest.mark.parametrize("within", ["contour", "point"])
@EACH_MOTION
def test_zones_hold_at_every_instant(drive, rotations, jerk, within, rounds):
    plan = build_plan(1, drive, rotations)
    limits = make_limits(rotations, drive, **jerk)
    free = plan.trajectory(**limits)
    for seed in range(rounds):
        zones = draw_zones(plan, seed)
        trajectory = plan.trajectory(**limits, speed=planners.SpeedZones(zones, within=within))
        q, speeds = sample_speeds(trajectory)
        allowed = allow_in_zones(q, zones, within)
        assert np.isfinite(allowed).any()
        assert (speeds <= SLACK * allowed).all()
        assert trajectory.recheck(plan.space).all() and trajectory.duration > free.duration
        # Their curve is the same, and their limits are reached.
        assert trajectory.positions[-1] == pytest.approx(free.positions[-1], abs=1e-9)
        assert (speeds / allowed).max() > 0.99


def test_a_part_that_only_sweeps_a_zone_counts():
    space = build_empty((60, 60), cspace.Robot.rectangle(2.0, 0.1), rotations=36)
    plan = planners.plan(space, (3.0, 3.0, 0.0), (3.3, 3.0, 2.0))
    bar = box(-1.0, -0.05, 1.0, 0.05)
    for angle in (0.4, 1.0, 1.6):
        tip = 3.0 + 0.15 * angle + 0.98 * np.cos(angle), 3.0 + 0.98 * np.sin(angle)
        zones = [(shapely.Point(tip).buffer(0.02), 0.01)]
        trajectory = plan.trajectory(**make_limits(36), speed=planners.SpeedZones(zones))
        q, speeds = sample_speeds(trajectory)
        touches = shapely.intersects(zones[0][0], place_polygon(bar, q))
        assert touches.any() and not touches[[0, -1]].any()
        assert speeds[touches].max() <= 0.01 * SLACK < speeds.max()


@EACH_MOTION
def test_robots_are_slow_near_obstacles(drive, rotations, jerk):
    plan = build_plan(1, drive, rotations)
    limits = make_limits(rotations, drive, **jerk)
    trajectory = plan.trajectory(**limits, speed=planners.SlowNear(plan.space, 0.3, 0.25))
    q, speeds = sample_speeds(trajectory)
    distances = shapely.distance(obstacles_of(plan.space), place_robots(plan.space.robot, q))
    assert (speeds[distances < 0.25] <= 0.3 * SLACK).all()
    assert (speeds > 0.3 * SLACK).any()


def test_a_straight_line_takes_the_times_of_trapezoids():
    plan = planners.plan(build_empty((200, 40), "disc:0.3", 0.05), (1.0, 1.0), (9.0, 1.0))
    limits = {"max_velocity": 1.0, "max_acceleration": 0.5}
    crossing = [(box(4.13, 0.5, 6.07, 1.5), 0.4)]
    for within, ends in (("point", (4.13, 6.07)), ("contour", (3.83, 6.37))):
        trajectory = plan.trajectory(**limits, speed=planners.SpeedZones(crossing, within=within))
        q, speeds = sample_speeds(trajectory)
        inside = (q[:, 0] >= ends[0]) & (q[:, 0] <= ends[1])
        assert speeds[inside] == pytest.approx(0.4, rel=1e-9)
        # 0.4 m/s within the zone, 1 m/s before and after it, and ramps of 0.5 m/s^2.
        length = ends[1] - ends[0]
        ramp = (1.0**2 - 0.4**2) / (2 * 0.5)
        outside = 8.0 - length - 2 * 1.0 - 2 * ramp
        seconds = length / 0.4 + 2 * (1.0 - 0.4) / 0.5 + outside + 2 * 1.0 / 0.5
        # At each border the limit holds at most a cell too early.
        assert seconds <= trajectory.duration <= seconds + 2 * 0.05 * (1 / 0.4 - 1 / 1.0)


@pytest.mark.parametrize("rounds", few([3, 6]))
@EACH_MOTION
def test_stops_keep_the_limits(drive, rotations, jerk, rounds):
    plan = build_plan(1, drive, rotations)
    zones = draw_zones(plan, 4)
    speed = [planners.SpeedZones(zones), planners.SlowNear(plan.space, 0.4, 0.2)]
    trajectory = plan.trajectory(**make_limits(rotations, drive, **jerk), speed=speed)
    for t in np.linspace(0.0, trajectory.duration, rounds):
        stop = trajectory.braked(t)
        assert stop.certified
        q, speeds = sample_speeds(stop)
        assert (speeds <= SLACK * allow_in_zones(q, zones)).all()


def test_a_duration_is_at_least_that_of_the_zones():
    plan = build_plan(1, "holonomic", None)
    zones = draw_zones(plan, 5)
    speed = planners.SpeedZones(zones)
    fastest = plan.trajectory(**LIMITS, speed=speed).duration
    slowed = plan.trajectory(**LIMITS, speed=speed, duration=1.5 * fastest)
    assert slowed.duration == pytest.approx(1.5 * fastest)
    q, speeds = sample_speeds(slowed)
    assert (speeds <= SLACK * allow_in_zones(q, zones)).all()
    free = plan.trajectory(**LIMITS).duration
    check_refused(lambda: plan.trajectory(**LIMITS, speed=speed, duration=free), "the limits need")


def test_limited_jerk_loses_little_between_zones():
    ways = zip((5.0, 8.0, 11.0), (1.0, 0.6, 0.3), strict=True)
    speed = planners.SpeedZones([(box(x, 0.0, x + 3.0, 4.0), top) for x, top in ways])
    plan = plan_along_hall()
    fastest = plan.trajectory(**QUICK, speed=speed).duration
    assert fastest < plan.trajectory(**QUICK, max_jerk=1.0, speed=speed).duration < 1.05 * fastest


# ---- limits that come while the robot moves ------------------------------------------------------


@cache
def plan_along_hall():
    """Plan along a hall of 20 m without obstacles."""
    space = build_empty((220, 40), cspace.Robot.disc(0.3))
    return planners.plan(space, (1.0, 2.0), (21.0, 2.0))


def go_on(limits, at, speed, later=()):
    """Return the motion after one that is driven until a time, with new limits of places."""
    plan = plan_along_hall()
    motion = plan.trajectory(**limits, speed=later)
    onward = planners.plan(plan.space, motion.starts_after(at)[0], plan.goal)
    return motion, onward.trajectory(**limits, after=motion, at=at, speed=speed)


def test_a_motion_faster_than_its_new_limit_slows_down_as_its_reason_says():
    plan = plan_along_hall()
    motion = plan.trajectory(**QUICK)
    onward = planners.plan(plan.space, motion.starts_after(6.0)[0], plan.goal)
    stop = onward.trajectory(**QUICK | {"max_velocity": 0.75}, after=motion, at=6.0)
    assert stop.stop_reason.startswith("the robot drives faster than max_velocity")
    speed = float(re.search(r"speed=([\d.]+)", stop.stop_reason)[1])  # type: ignore[index]
    slow = onward.trajectory(**QUICK, after=motion, at=6.0, speed=speed)
    assert not slow.stop_reason and np.linalg.norm(slow.velocities[-9:], axis=1).max() <= 0.7501
    by_axis = onward.trajectory(max_velocity=(0.7, 0.7), max_acceleration=0.5, after=motion, at=6.0)
    assert "faster" in by_axis.stop_reason and "speed=" not in by_axis.stop_reason


@pytest.mark.parametrize("at", [3.0, 5.0, 6.0])
def test_a_lower_limit_is_reached_by_the_quickest_braking(at):
    motion, slower = go_on(QUICK, at, EVERYWHERE)
    speed = float(np.linalg.norm(motion.sample(at)[1]))
    assert not slower.stop_reason and slower.certified
    assert slower.recheck(plan_along_hall().space).all()
    assert slower.exceeds_until == pytest.approx((speed - 0.5) / 0.5, rel=1e-6)
    t = np.linspace(0.0, slower.duration, INSTANTS)
    _, velocities, gains = slower.sample(t)
    assert np.linalg.norm(gains, axis=1).max() <= 0.5 * SLACK
    speeds = np.linalg.norm(velocities, axis=1)
    assert speeds[0] == pytest.approx(speed)
    assert (speeds[t >= slower.exceeds_until] <= 0.5 * SLACK).all()
    # It goes on at the limit, and what follows does not exceed it any more.
    assert np.median(speeds) == pytest.approx(0.5)
    assert slower.braked(slower.exceeds_until + 0.1).exceeds_until == 0.0


@pytest.mark.parametrize("at", [3.0, 5.0, 7.0])
def test_limited_jerk_brakes_nearly_as_quickly(at):
    motion, slower = go_on(QUICK | {"max_jerk": 1.0}, at, EVERYWHERE)
    _, velocity, gain = motion.sample(at)
    speed, gain = float(velocity[0]), float(gain[0])
    # The acceleration falls to zero, then braking ramps up and down.
    least = gain / 1.0
    speed += gain**2 / 2.0
    least += (speed - 0.5) / 0.5 + 0.5 / 1.0
    assert not slower.stop_reason and slower.certified
    assert 0.9 * least <= slower.exceeds_until <= 1.05 * least
    t = np.linspace(0.0, slower.duration, INSTANTS)
    _, velocities, gains = slower.sample(t)
    assert np.linalg.norm(gains, axis=1).max() <= 0.5 * SLACK
    assert np.abs(np.diff(gains[:, 0])).max() <= 1.0 * SLACK * t[1] + 1e-9
    assert (velocities[t >= slower.exceeds_until, 0] <= 0.5 * SLACK).all()


@pytest.mark.parametrize("jerk", [{}, {"max_jerk": 1.0}], ids=["", "jerk"])
def test_a_zone_too_near_to_brake_is_entered_as_slowly_as_possible(jerk):
    limits = QUICK | jerk
    at = 5.5
    x = float(plan_along_hall().trajectory(**limits).sample(at)[0][0])
    zones = [(box(x + 0.8, 0.0, x + 6.0, 4.0), 0.3)]
    _, slower = go_on(limits, at, planners.SpeedZones(zones))
    q, speeds = sample_speeds(slower)
    t = np.linspace(0.0, slower.duration, INSTANTS)
    exceeds = speeds > SLACK * allow_in_zones(q, zones)
    assert not slower.stop_reason and exceeds.any()
    assert t[exceeds].max() <= slower.exceeds_until < 6.0
    # What was to be expected is no surprise: a limit from the start on is never exceeded.
    _, same = go_on(limits, at, planners.SpeedZones(zones), planners.SpeedZones(zones))
    assert not same.stop_reason and same.exceeds_until == 0.0


@pytest.mark.parametrize("rounds", few([2, 5]))
@EACH_MOTION
def test_motions_go_on_with_new_limits_as_without(drive, rotations, jerk, rounds):
    plan = build_plan(1, drive, rotations)
    limits = make_limits(rotations, drive, **jerk)
    motion = plan.trajectory(**limits)
    zones = draw_zones(plan, 6)
    speed = planners.SpeedZones(zones)
    for at in np.linspace(0.1, 0.8, rounds) * motion.duration:
        start = motion.starts_after(at)[0]
        onward = planners.plan(plan.space, start, plan.goal, drive=plan.drive, previous=plan)
        free = onward.trajectory(**limits, after=motion, at=at)
        slower = onward.trajectory(**limits, after=motion, at=at, speed=speed)
        assert free.stop_reason or not slower.stop_reason
        q, speeds = sample_speeds(slower)
        t = np.linspace(0.0, slower.duration, INSTANTS)
        exceeds = speeds > SLACK * allow_in_zones(q, zones)
        if not slower.stop_reason:
            assert t[exceeds].max(initial=0.0) <= slower.exceeds_until
            assert slower.recheck(plan.space).all()


@pytest.mark.parametrize("jerk", [{}, {"max_jerk": 1.0}], ids=["", "jerk"])
def test_a_stop_says_until_when_it_exceeds_new_limits(jerk):
    plan = plan_along_hall()
    motion = plan.trajectory(**QUICK, **jerk)
    at = 5.5
    assert motion.braked(at).exceeds_until == 0.0
    unsolved = dataclasses.replace(plan, waypoints=plan.waypoints[:0])
    limits = QUICK | jerk | {"speed": EVERYWHERE}
    stop = unsolved.trajectory(**limits, after=motion, at=at)
    assert stop.stop_reason == "the plan has no path"
    t = np.linspace(0.0, stop.duration, INSTANTS)
    speeds = np.linalg.norm(stop.sample(t)[1], axis=1)
    slow = t[speeds <= 0.5][0]
    assert slow - t[1] <= stop.exceeds_until <= slow + t[1]
    assert stop.recheck(plan.space).all()
    assert stop.braked(stop.exceeds_until + t[1]).exceeds_until == 0.0


def test_a_recheck_asks_limits_near_obstacles_again():
    space = build_empty((80, 40), cspace.Robot.disc(0.3))
    plan = planners.plan(space, (1.0, 2.0), (7.0, 2.0))
    near = planners.SlowNear(space, 0.3, 1.0)
    trajectory = plan.trajectory(**LIMITS, speed=near)
    assert trajectory.recheck(space).all()
    space.add_obstacle("cart", box(3.5, 2.8, 4.5, 3.5))
    assert plan.recheck().all() and not trajectory.recheck(space).all()
    passed = trajectory.positions[:, 0]
    before, past = trajectory.times[[passed.searchsorted(3.6), passed.searchsorted(6.4)]]
    assert trajectory.recheck(space, after=past).all()
    assert not trajectory.recheck(space, after=before).all()
    slower = plan.trajectory(**LIMITS, speed=near)
    assert slower.recheck(space).all() and slower.duration > trajectory.duration
    # A stop brakes as quickly as before, and tells until when it is too fast.
    stop = trajectory.braked(trajectory.duration / 2)
    assert stop.certified and stop.duration == pytest.approx(1.2 / 0.8)
    assert stop.exceeds_until == pytest.approx(0.9 / 0.8, rel=1e-5)
    space.update({"cart": None})
    assert trajectory.recheck(space).all()


def test_a_recheck_ahead_asks_limits_again_from_where_they_were_kept():
    plan = plan_along_hall()
    space = copy.copy(plan.space)
    near = planners.SlowNear(space, 0.3, 0.3)
    _, slower = go_on(QUICK, 5.0, [EVERYWHERE, near])
    kept = slower.exceeds_until
    assert slower.recheck(space, after=0.9 * kept).all()
    x, y = slower.sample(1.45 * kept)[0]
    space.add_obstacle("post", box(x - 0.05, y + 0.55, x + 0.05, y + 0.65))
    # It is near the post after that time, and no more at twice that time.
    passed = slower.sample([kept, 1.9 * kept])[0][:, 0] - x
    assert passed[0] < -0.6 and passed[1] > 0.6
    assert plan.recheck(space).all() and not slower.recheck(space, after=0.9 * kept).all()
    assert slower.recheck(space, after=1.9 * kept).all()


# ---- gates ---------------------------------------------------------------------------------------


@cache
def build_hall():
    """Build a hall of 12 m by 4 m for a rectangle that turns."""
    return build_empty((120, 40), cspace.Robot.polygon(FOOTPRINT), rotations=36)


@pytest.mark.parametrize(
    "omega, exact", few([(0.5, True), (0.0, False), (0.5, False), (0.0, True)], 2)
)
def test_a_gate_slows_down_before_a_zone(omega, exact):
    space = build_hall().exact if exact else build_hall()
    zones = [(box(4.0, 0.0, 6.0, 4.0), 0.3), (shapely.Point(8.0, 2.4).buffer(0.4), 0.5)]
    options = {"dt": 0.1, "max_deceleration": (1.0, 2.0), "tracking": 0.01}
    gate = cspace.Gate(space, **options, speed=planners.SpeedZones(zones))
    pose, twist, driven = np.array([1.0, 1.5, 0.0]), np.zeros(2), []
    for _ in range(300):
        # The robot weaves.
        wanted = np.array([1.2, omega * (np.sin(2.0 * pose[0]) - 2.0 * pose[2])])
        slowed = gate.slow_down(pose, wanted, twist_now=twist)
        assert slowed.chunk.is_proven
        twist = slowed.commands[0]
        for share in np.linspace(0.0, 0.1, 9):
            yaw = pose[2] + 0.5 * share * twist[1]
            step = share * twist[0] * np.array([np.cos(yaw), np.sin(yaw)])
            driven.append([*(pose[:2] + step), pose[2] + share * twist[1], twist[0]])
        pose = np.array(driven[-1][:3])
        if pose[0] > 9.0:
            break
    rows = np.array(driven)
    assert pose[0] > 9.0
    allowed = allow_in_zones(rows[:, :3], zones)
    assert (rows[:, 3] <= allowed + 1e-9).all()
    # It passes the zone at nearly its speed, and is quick beside it.
    assert rows[np.isfinite(allowed), 3].max() > 0.25 and rows[:, 3].max() > 1.1


def test_a_gate_refuses_rows_that_are_too_quick():
    space = build_hall()
    zones = planners.SpeedZones([(box(4.0, 0.0, 6.0, 4.0), 0.4)], within="point")
    limits = {"dt": 0.5, "max_velocity": 2.0}
    gate = cspace.Gate(space, speed=[zones, planners.SlowNear(space, 0.9, 0.5)], **limits)
    start = (3.0, 2.0, 0.0)
    rows, slower = (
        [(x, 2.0, 0.0) for x in places] for places in ((3.5, 3.9, 4.2, 4.5), (3.5, 3.9, 4.09, 4.28))
    )
    passed = gate.check_rows(start, rows)
    assert passed.chunk.proven == 2 and passed.chunk.refusal.cause == "speed"
    assert passed.chunk.refusal.message == "row 2: v is 0.6, at most 0.4 is allowed"
    assert gate.check_rows(start, slower).state == "go"
    straying = cspace.Gate(space, tracking=0.2, speed=zones, **limits)
    assert straying.check_rows(start, rows).chunk.proven == 1
    assert gate.check_rows(start, [rows, slower]).chunk.proven.tolist() == [2, 4]
    twists = [(1.0, 0.0), (0.8, 0.0), (0.6, 0.0)]
    assert gate.check_twists(start, twists).chunk.proven == 2
    assert gate.check_twists((3.0, 0.6, 0.0), twists).chunk.refusal.row == 0  # near the wall
    for x in (np.nan, 1e300):
        assert not gate.check_rows(start, [(x, 2.0, 0.0)]).chunk
    assert "speed=[SpeedZones" in repr(gate)


def test_largest_speeds_hold_around_configurations():
    space = build_hall()
    zones = planners.SpeedZones([(box(4.0, 0.0, 6.0, 4.0), 0.4)])
    q = [[(2.0, 2.0, 0.0), (3.7, 2.0, 0.0)], [(3.7, 2.0, 1.571), (5.0, 2.0, 0.0)]]
    assert zones.largest_speed(space, q).tolist() == [[np.inf, 0.4], [np.inf, 0.4]]
    assert zones.largest_speed(space, q, [3.4, 0.0], 2.0).tolist() == [[0.4, 0.4], [0.4, 0.4]]
    assert zones.largest_speed(space, (2.0, 2.0, 0.0)) == np.inf
    assert zones.largest_speed(space, (3.7, 2.0, 1.571), 0.0, 2.0) == 0.4  # it turns into the zone
    near = planners.SlowNear(space, 0.4, 0.5)
    assert near.largest_speed(space, [(2.0, 1.0, 0.0)] * 2, 0.0, [0.0, 2.0]).tolist() == [
        np.inf,
        0.4,
    ]
    ahead = build_empty((80, 40), cspace.Robot.disc(0.2, (0.5, 0.0)), rotations=8)
    q = [(3.25, 2.0, 0.0), (3.35, 2.0, 0.0), (3.9, 2.0, 3.1)]
    assert zones.largest_speed(ahead, q).tolist() == [np.inf, 0.4, np.inf]
    # The ball around a robot that rotates about any axis counts.
    q = [(x, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0) for x in (3.7, 3.92)]
    assert zones.largest_speed(build_open_map("floating"), q).tolist() == [np.inf, 0.4]


def test_zones_that_reach_no_map_are_left_out_with_a_warning():
    plan = build_plan(1, "holonomic", 36)
    limits = make_limits(36)
    inner = (shapely.Point(plan.path[len(plan.path) // 2, :2]).buffer(0.5), 0.3)
    sides = shapely.MultiPolygon([box(-50, 0, -49, 1), box(90, 0, 91, 1)])
    both = planners.SpeedZones([(box(90, 0, 91, 1), 0.2), inner, (sides, 0.1)])
    with pytest.warns(
        UnitWarning, match=r"^zones\[0\] lies off the map: x 90 to 91 m.*; 2 of 3 zo"
    ):
        trajectory = plan.trajectory(**limits, speed=both)
    alone = plan.trajectory(**limits, speed=planners.SpeedZones([inner]))
    np.testing.assert_array_equal(trajectory.velocities, alone.velocities)


AREA = box(1.0, 1.0, 2.0, 2.0)


def test_a_map_near_obstacles_on_a_floor_is_of_the_robot_in_space():
    cells = np.zeros((40, 20, 20), dtype=bool)
    cells[15:25, 11:, 8:10] = True  # a table, 0.8 to 1.0 m high
    scene = cspace.Workspace.from_array(cells, 0.2)
    tall, low = (
        cspace.Robot.from_mesh(trimesh.creation.box(bounds=[(-0.3, -0.2, 0.1), (0.3, 0.2, top)]))
        for top in (1.8, 0.9)
    )
    space = cspace.build(scene, tall, floor=0.0)
    plan = planners.plan(space, (1.0, 1.5), (7.0, 1.5))
    for robot, floor, message in (
        (low, 0.0, "is of a map for another robot"),
        (tall, 0.5, r"is of a map with floor=0\.5; the plan has floor=0\.0"),
    ):
        near = planners.SlowNear(cspace.build(scene, robot, floor=floor), 0.2, 0.8)
        with pytest.raises(InputError, match=message):
            drive(plan, near)
        with pytest.raises(InputError, match=message):
            near.largest_speed(space, (1.0, 1.5))
    # The same robot made anew is the same, and obstacles in the plane meet its footprint.
    flat = cspace.Workspace.from_array(cells.any(axis=2), 0.2)
    again = cspace.Robot.from_spec(tall.spec)
    free = drive(plan, 1.0).duration
    for other in (cspace.build(scene, again, floor=0.0), cspace.build(flat, again.footprint())):
        assert drive(plan, planners.SlowNear(other, 0.2, 0.8)).duration > free + 1.0
    # In the plane, the robot has no height at which obstacles would be missed.
    below = planners.plan(cspace.build(flat, tall.footprint()), (1.0, 1.5), (7.0, 1.5))
    with pytest.raises(InputError, match="is of a map for another robot"):
        drive(below, planners.SlowNear(space, 0.2, 0.8))


@refusals(
    "call, message",
    (lambda plan: planners.SpeedZones([(AREA, 0.0)]), "speed of zones[0] is 0.0"),
    (lambda plan: planners.SpeedZones([(AREA, 1.0), (AREA, -1.0)]), "speed of zones[1] is -1.0"),
    (lambda plan: planners.SpeedZones([]), "zones is []"),
    (lambda plan: planners.SpeedZones(1, 2), "zones is 1; it must list areas"),
    (lambda plan: planners.SpeedZones((AREA, 1.0)), "zones[0] is <POLYGON"),
    (lambda plan: planners.SpeedZones({"aisle": 1.0}), "zones[0] is 'aisle' ... area"),
    (lambda plan: planners.SpeedZones([1.0]), "zones[0] is 1.0"),
    (lambda plan: planners.SpeedZones([(AREA, 1.0), (box(0, 0, 0, 1), 1.0)]), "zones[1] is not"),
    (lambda plan: planners.SpeedZones([(AREA, 1.0)], within="outline"), "within is 'outline'"),
    (lambda plan: planners.SlowNear(plan.space, 0.0, 1.0), "speed is 0.0"),
    (lambda plan: planners.SlowNear(plan.space, 1.0, np.inf), "distance"),
    (lambda plan: planners.SlowNear("map", 1.0, 1.0), "space is 'map'"),
    (lambda plan: drive(plan, "fast"), "speed is 'fast'"),
    (lambda plan: drive(plan, -0.5), "speed is -0.5"),
    (lambda plan: cspace.Gate(plan.space, dt=0.1, speed=0.5), "speed is 0.5"),
    (
        lambda plan: cspace.Gate(plan.space, speed=planners.SpeedZones([(AREA, 1.0)])),
        "dt is missing",
    ),
    (
        lambda plan: cspace.Gate(
            plan.space, dt=0.1, speed=[planners.SpeedZones([(box(90, 0, 91, 1), 1.0)])]
        ),
        "lies off the map",
    ),
    (
        lambda plan: planners.SpeedZones([(AREA, 1.0)]).largest_speed(plan.space, (1.0, np.nan)),
        "q",
    ),
    (lambda plan: drive(plan, planners.SpeedZones([(box(90, 0, 91, 1), 1.0)])), "lies off the map"),
    (
        lambda plan: drive(plan, planners.SpeedZones([(AREA, 1.0)], frame_id="odom")),
        "speed has the frame 'odom'",
    ),
    (
        lambda plan: drive(plan, planners.SlowNear(build_plan(1, "holonomic", 36).space, 1.0, 1.0)),
        "is of a map of x, y, yaw",
    ),
    (
        lambda plan: drive(
            plan, planners.SlowNear(build_empty((220, 40), cspace.Robot.disc(0.1)), 1.0, 1.0)
        ),
        "is of a map for another robot, a disc 0.1 m",
    ),
    (
        lambda plan: drive(
            pickle.loads(pickle.dumps(plan)), planners.SpeedZones([(AREA, 1.0)], within="point")
        ),
        "plan has no map",
    ),
)
def test_limits_that_mean_nothing_are_refused(call, message):
    check_refused(lambda: call(build_plan(1, "holonomic", None)), message)


def drive(plan, speed):
    """Make a trajectory with limits of places."""
    return plan.trajectory(**LIMITS, speed=speed)
