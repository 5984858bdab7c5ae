"""Trajectories: proven edges, limits, shortest times, messages, files and pictures.

Oracles: SciPy's rotations, OMPL's curves, differences of positions, and the times of trapezoids.
"""

import csv
import itertools
import math
import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from ompl import base as ob
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace import InputError
from cspace._files import ros_maps as messages
from planners._motion.timing import LimitRates, MotionBounds, is_motion
from tests.helpers.drives import make_drive
from tests.helpers.motions import sample_evenly
from tests.helpers.planning import ENDPOINTS, build_open_map, build_room, make_poses, turn_between
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import planar

AXES_OF_KIND = {
    "plane": ("x", "y"),
    "turning": ("x", "y", "yaw"),
    "floating": ("x", "y", "z", "qx", "qy", "qz", "qw"),
    "joints": ("shoulder", "lift", "wrist"),
}
OMPL_CURVES = {"dubins": ob.DubinsStateSpace, "reeds-shepp": ob.ReedsSheppStateSpace}
RADIUS = 0.4
"""Turning radius of the cars."""

ROTATION_LIMITS = {"max_angular_velocity": 1.0, "max_angular_acceleration": 2.0}
TRANSLATION_LIMITS = {"max_velocity": 1.0, "max_acceleration": 0.5}
kinds = st.sampled_from(sorted(AXES_OF_KIND))


@cache
def template():
    """Return a plan that other plans replace in part."""
    return planners.plan(build_open_map("plane"), (1.5, 1.5), (5.5, 2.5), time_limit=5.0, seed=1)


def plan_along(kind, waypoints, drive=None, **limits):
    """Return a plan along waypoints, without a map."""
    rows = np.asarray(waypoints, dtype=float)
    axes = AXES_OF_KIND[kind]
    units = tuple({"x": "m", "y": "m", "z": "m", "lift": "m"}.get(axis, "rad") for axis in axes)
    changes = {"path": rows, "waypoints": rows, "axes": axes, "units": units, "space": None}
    return replace(template(), **changes, drive=make_drive(drive, RADIUS, **limits))


def draw_waypoints(kind, rng, count):
    """Draw configurations, some equal to their predecessor in part."""
    dim = 2 if kind in ("plane", "turning") else 3
    rows = rng.uniform(-3.0, 3.0, (count, len(AXES_OF_KIND[kind])))
    if kind == "floating":
        signs = rng.choice([-1.0, 1.0], (count, 1))
        rows[:, 3:] = Rotation.random(count, random_state=rng).as_quat() * signs
    for k in range(1, count):
        same = rng.choice([0, 0, 0, dim, rows.shape[1]])
        rows[k, :same] = rows[k - 1, :same]
    return rows


def draw_limits(kind, rng):
    """Draw limits of the whole translation or of each axis."""
    dim = 2 if kind in ("plane", "turning") else 3
    size = dim if rng.random() < 0.5 else None
    limits = {name: np.exp(rng.uniform(-2.0, 2.0, size)) for name in TRANSLATION_LIMITS}
    if kind in ("turning", "floating"):
        limits |= {name: float(np.exp(rng.uniform(-2.0, 2.0))) for name in ROTATION_LIMITS}
    return limits


def displace(kind, first, q):
    """Return translations and rotation vectors to configurations, shape (n, k)."""
    if kind == "floating":
        turns = Rotation.from_quat(first[3:]).inv() * Rotation.from_quat(q[:, 3:])
        return np.column_stack([q[:, :3] - first[:3], turns.as_rotvec()])
    if kind == "turning":
        return np.column_stack([q[:, :2] - first[:2], turn_between(first[2], q[:, 2])])
    return q - first


def measure_distances(kind, waypoints, q):
    """Return distances from straight edges, in metres and radians together."""
    distances = np.full(len(q), np.inf)
    for first, last in itertools.pairwise(waypoints):
        step = displace(kind, first, last[None])[0]
        offsets = displace(kind, first, q)
        shares = np.clip(offsets @ step / max(step @ step, 1e-30), 0.0, 1.0)
        apart = np.linalg.norm(offsets - shares[:, None] * step, axis=1)
        distances = np.minimum(distances, apart)
    return distances


def find_inner_times(trajectory, gap):
    """Return times halfway between rows more than ``gap`` apart, far from jumps."""
    first = trajectory.times[:-1]
    last = trajectory.times[1:]
    return ((first + last) / 2.0)[last - first > gap]


def check_derivatives(kind, trajectory, h):
    """Check rates by differences between rows; return samples before, at and after these times."""
    t = find_inner_times(trajectory, 4.0 * h)
    before, now, after = (trajectory.sample(t + shift) for shift in (-h, 0.0, h))
    steps = after[0] - before[0]
    if kind == "turning":
        steps[:, 2] = turn_between(before[0][:, 2], after[0][:, 2])
    np.testing.assert_allclose(steps / (2 * h), now[1], rtol=1e-4, atol=1e-4)
    changes = (after[1] - before[1]) / (2 * h)
    np.testing.assert_allclose(changes, now[2], rtol=1e-3, atol=1e-3)
    return [before, now, after]


def to_rates(kind, velocities):
    """Return velocities with the angular speed instead of a quaternion's derivative."""
    if kind == "floating":
        speeds = 2.0 * np.linalg.norm(velocities[:, 3:], axis=1)
        return np.column_stack([velocities[:, :3], speeds])
    return velocities


def find_slack(kind, rates, linear, angular):
    """Return the least ratio of the limits to rates, shape (n, k)."""
    dim = 2 if kind in ("plane", "turning") else 3
    moved = np.abs(rates[:, :dim])
    if not np.ndim(linear) and kind != "joints":
        moved = np.linalg.norm(moved, axis=1, keepdims=True)
    turned = np.linalg.norm(rates[:, dim:], axis=1)
    with np.errstate(divide="ignore"):
        return float(min((linear / moved).min(), (angular / turned).min()))


# ---- straight edges ------------------------------------------------------------------------------


@given(seeds, st.integers(1, 5), kinds)
def test_trajectories_follow_straight_edges_within_limits_from_rest_to_rest(seed, count, kind):
    rng = np.random.default_rng(seed)
    waypoints = draw_waypoints(kind, rng, count)
    limits = draw_limits(kind, rng)
    trajectory = plan_along(kind, waypoints).trajectory(**limits)
    t = np.append(trajectory.times, np.linspace(-0.1, trajectory.duration + 0.1, 400))
    positions, velocities, _ = trajectory.sample(t)
    assert measure_distances(kind, waypoints[[0, *range(count)]], positions).max() < 1e-9
    rates = to_rates(kind, velocities)
    turn_rate = limits.get("max_angular_velocity", math.inf)
    assert find_slack(kind, rates, limits["max_velocity"], turn_rate) >= 1.0 - 1e-9
    before, _, after = check_derivatives(kind, trajectory, 1e-3)
    gains = (to_rates(kind, after[1]) - to_rates(kind, before[1])) / 2e-3
    turn_gain = limits.get("max_angular_acceleration", math.inf)
    if len(gains):
        assert find_slack(kind, gains, limits["max_acceleration"], turn_gain) >= 1.0 - 1e-6
    for row in (0, -1):
        gaps = displace(kind, waypoints[row], trajectory.positions[[row]])
        np.testing.assert_allclose(gaps, 0.0, atol=1e-9)
        assert not trajectory.velocities[row].any()
    # Every waypoint is reached, at rest if the path has a corner there.
    for before, waypoint, after in zip(waypoints, waypoints[1:], waypoints[2:], strict=False):
        steps = np.stack(
            [displace(kind, before, waypoint[None])[0], displace(kind, waypoint, after[None])[0]]
        )
        lengths = np.linalg.norm(steps, axis=1, keepdims=True)
        near = np.abs(displace(kind, waypoint, trajectory.positions)).max(axis=1) < 1e-9
        assert near.any()
        if lengths.min() > 1e-9 and np.linalg.norm(np.diff(steps / lengths, axis=0)) > 1e-6:
            assert (np.abs(trajectory.velocities[near]).max(axis=1) == 0.0).any()


@given(seeds, st.lists(st.floats(0.01, 0.99), max_size=5), kinds)
def test_an_edge_takes_the_shortest_time_in_one_part_or_several(seed, cuts, kind):
    rng = np.random.default_rng(seed)
    first, last = draw_waypoints(kind, rng, 2)
    step = displace(kind, first, last[None])
    limits = draw_limits(kind, rng)
    assume(np.linalg.norm(step) > 0.1)
    shares = np.array([0.0, *sorted(set(np.round(cuts, 3))), 1.0])[:, None]
    rows = [first, last] if kind == "floating" else first + shares * step
    # The share of the edge is driven as a trapezoid, or a triangle.
    turn_rate, turn_gain = (limits.get(name, math.inf) for name in ROTATION_LIMITS)
    top = find_slack(kind, step, limits["max_velocity"], turn_rate)
    gain = find_slack(kind, step, limits["max_acceleration"], turn_gain)
    seconds = 1.0 / top + top / gain if top**2 <= gain else 2.0 / math.sqrt(gain)
    assert plan_along(kind, rows).trajectory(**limits).duration == pytest.approx(seconds, rel=1e-6)


@pytest.mark.parametrize("metres", [1e-6, 1e6])
@pytest.mark.parametrize("seconds", [1e-6, 1e6])
def test_trajectories_scale_with_their_units(metres, seconds):
    # A short edge, a sharp turn back, and a bend of the lift alone.
    rows = np.array([(0.5, 0.7, 0.1), (0.5, 0.7 + 1e-7, 0.1), (0.9, 0.2, 0.1), (0.5, 0.7, 0.1)])
    rows = np.vstack([rows, (1.0, 0.7 + 1e-5, 0.1), (1.5, 0.7, 0.1)])
    scales = np.array([1.0, metres, 1.0])
    trajectories = [
        plan_along("joints", rows * sizes).trajectory(
            max_velocity=sizes / unit,
            max_acceleration=2.0 * sizes / unit**2,
            time_step=0.0937 * unit,
        )
        for sizes, unit in ((1.0 + 0.0 * scales, 1.0), (scales, seconds))
    ]
    one, scaled = trajectories
    np.testing.assert_allclose(scaled.times, one.times * seconds, rtol=1e-7)
    np.testing.assert_allclose(scaled.positions, one.positions * scales, rtol=1e-9)
    changes = np.abs(np.diff(scaled.velocities, axis=0)) / np.diff(scaled.times)[:, None]
    assert (changes <= 2.0 * scales / seconds**2 * (1.0 + 1e-6)).all()


@pytest.mark.parametrize("gain", [1e9, 1e14, 1e30])
def test_any_acceleration_begins_and_ends_at_rest(gain):
    rows = [(0.0, 0.0), (1000.0, 0.0), (1000.0, 2.0)]
    trajectory = plan_along("plane", rows).trajectory(max_velocity=1.0, max_acceleration=gain)
    assert trajectory.duration == pytest.approx(1002.0, rel=1e-5)
    moved = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)
    assert (moved / np.diff(trajectory.times)).max() <= 1.0 + 1e-6
    corner = trajectory.positions[:, 0].searchsorted(1000.0)
    assert not trajectory.velocities[[0, corner, -1]].any()


def test_rows_that_differ_by_rounding_add_no_motion():
    rows = np.array([(3e5, 0.3), (4e5, 0.3), (4e5, 9e5)])
    repeated = np.repeat(rows, 3, axis=0)
    repeated[1::3] *= 1.0 + 2e-16
    one, other = (
        plan_along("plane", each).trajectory(max_velocity=1e4, max_acceleration=1e4)
        for each in (rows, repeated)
    )
    assert other.duration == pytest.approx(one.duration, rel=1e-12)


# ---- cars ----------------------------------------------------------------------------------------


def measure_edges(drive, rows):
    """Return the metres of OMPL's shortest curves."""
    curves = OMPL_CURVES[drive](RADIUS)
    return [curves.distance(*ends) for ends in itertools.pairwise(make_poses(curves, *rows))]


def find_speeds(rows):
    """Return speeds along the heading, negative in reverse, and across it."""
    positions, velocities, _ = rows
    yaws = positions[:, 2]
    x, y = velocities[:, 0], velocities[:, 1]
    return x * np.cos(yaws) + y * np.sin(yaws), y * np.cos(yaws) - x * np.sin(yaws)


@examples(30)
@given(
    seeds,
    st.integers(2, 4),
    st.sampled_from(sorted(OMPL_CURVES)),
    st.fixed_dictionaries({}, optional=dict.fromkeys(ROTATION_LIMITS, st.floats(0.1, 3.0))),
    st.none() | st.floats(0.1, 3.0),
)
def test_cars_follow_their_curves_at_their_limits(seed, count, drive, limits, lateral):
    rows = np.random.default_rng(seed).uniform(-3.0, 3.0, (count, 3))
    plan = plan_along("turning", rows, drive, max_lateral_acceleration=lateral)
    trajectory = plan.trajectory(max_velocity=1.5, max_acceleration=0.8, **limits)
    turn_rate, turn_gain = (limits.get(name, math.inf) for name in ROTATION_LIMITS)
    sideways = 0.8 if lateral is None else lateral
    speeds, across = find_speeds(trajectory.sample(trajectory.times))
    turns = trajectory.velocities[:, 2]
    np.testing.assert_allclose(across, 0.0, atol=1e-9)
    assert not trajectory.velocities[[0, -1]].any()
    # Speed is linear between rows, so trapezoids give the metres. The car reaches each waypoint
    # after the length of the shortest curve, so it drives such a curve.
    spans = np.diff(trajectory.times)
    metres = np.append(0.0, np.cumsum(spans * np.abs(speeds[1:] + speeds[:-1]) / 2.0))
    for length, waypoint in zip(np.cumsum(measure_edges(drive, rows)), rows[1:], strict=True):
        row = np.abs(metres - length).argmin()
        assert metres[row] == pytest.approx(length, abs=1e-8)
        gaps = displace("turning", waypoint, trajectory.positions[[row]])
        np.testing.assert_allclose(gaps, 0.0, atol=1e-6)
    # It rests where it changes between ahead and reverse and, with a limited angular acceleration,
    # where it steers.
    assert (speeds[1:] * speeds[:-1] >= 0.0).all()
    assert (np.abs(np.diff(turns)) <= turn_gain * spans + 1e-5).all()
    # At each moment it is at a limit, and at most at a limit.
    h = 1e-4
    before, now, after = check_derivatives("turning", trajectory, h)
    speed = np.abs(find_speeds(now)[0])
    gain = np.abs(find_speeds(after)[0] - find_speeds(before)[0]) / (2 * h)
    curvature = np.round(np.abs(now[1][:, 2]) / speed, 9)
    assert set(np.round(curvature * RADIUS, 6)) <= {0.0, 1.0}
    with np.errstate(divide="ignore"):
        top = np.minimum(turn_rate / curvature, np.sqrt(sideways / curvature)).clip(max=1.5)
        top_gain = np.minimum(turn_gain / curvature, 0.8)
    assert (speed <= top * (1 + 1e-6)).all() and (gain <= top_gain + 1e-4).all()
    assert ((speed >= top * (1 - 1e-6)) | (gain >= top_gain - 1e-4)).all()


@pytest.mark.parametrize("speed, gain", [(10.0, 1.0), (10.0, 1e9), (1e7, 1.0)])
def test_cars_rest_at_cusps_whatever_their_limits(speed, gain):
    plan = plan_along("turning", [(0.0, 0.0, 0.0), (0.0, 0.5, 0.0)], "reeds-shepp")
    trajectory = plan.trajectory(
        max_velocity=speed,
        max_acceleration=gain,
        max_angular_velocity=1.0,
        max_angular_acceleration=1.0,
    )
    speeds, _ = find_speeds(trajectory.sample(trajectory.times))
    is_cusp = np.diff(np.sign(speeds[np.abs(speeds) > 1e-9])) != 0.0
    assert is_cusp.any()
    assert (speeds[1:] * speeds[:-1] >= 0.0).all()


# ---- plans and arms ------------------------------------------------------------------------------


def test_trajectories_of_plans_are_free_and_need_no_map():
    room = build_room("turning")
    plan = planners.plan(
        room, *ENDPOINTS["turning"], drive=planners.Differential(), time_limit=20.0
    )
    limits = TRANSLATION_LIMITS | ROTATION_LIMITS
    trajectory = plan.trajectory(**limits)
    assert (trajectory.axes, trajectory.units) == (plan.axes, plan.units)
    assert f"{trajectory.duration:.3f} s" in repr(trajectory)
    assert room.is_free(trajectory.positions).all()
    without_map = pickle.loads(pickle.dumps(plan)).trajectory(**limits)
    on_edges = plan.trajectory(**limits, blend=False)
    np.testing.assert_array_equal(without_map.positions, on_edges.positions)
    kept = pickle.loads(pickle.dumps(trajectory))
    np.testing.assert_array_equal(kept.sample(1.0)[0], trajectory.sample(1.0)[0])


def test_arms_move_within_the_velocity_limits_of_the_urdf(tmp_path):
    path = planar(tmp_path)
    path.write_text(path.read_text().replace('velocity="1"', 'velocity="0.4"', 1))
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(path))
    plan = planners.plan(space, (-0.6, 0.3), (1.4, -0.2))
    # The shoulder turns by 2 rad, as a trapezoid.
    assert plan.trajectory(max_acceleration=0.8).duration == pytest.approx(2.0 / 0.4 + 0.4 / 0.8)
    limits = {"max_velocity": {"shoulder": 0.2}, "max_acceleration": (0.8, 0.8)}
    slower = plan.trajectory(**limits)
    assert slower.duration == pytest.approx(2.0 / 0.2 + 0.2 / 0.8)
    along = planners.Trajectory.along(space, plan.waypoints, **limits)
    np.testing.assert_array_equal(along.positions, slower.positions)


@pytest.mark.parametrize("digits", [6, 5])
def test_rounded_rows_of_a_straight_motion_are_passed_without_stops(digits, tmp_path):
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(planar(tmp_path)))
    ends = np.array([(-0.6, 0.3), (1.4, -0.2), (1.4, 0.4)])
    limits = {"max_velocity": 1.0, "max_acceleration": 3.0}
    straight = planners.Trajectory.along(space, ends, **limits)
    legs = [np.linspace(*pair, 200) for pair in itertools.pairwise(ends)]
    # It turns back on the way, which the straight motion to the end would leave out.
    legs.insert(1, np.linspace(ends[1], ends[1] + 0.2 * (ends[0] - ends[1]), 50))
    legs.insert(2, legs[1][::-1])
    rows = np.round(np.concatenate(legs), digits)
    driven = planners.Trajectory.along(space, rows, **limits)
    there_and_back = planners.Trajectory.along(space, legs[1][[0, -1]], **limits)
    expected = straight.duration + 2.0 * there_and_back.duration
    assert driven.certified and driven.duration == pytest.approx(expected, rel=1e-3)
    near = shapely.LineString(sample_evenly(driven, 9999)[0])
    assert max(near.distance(shapely.Point(row)) for row in rows) <= 1.1e-5 * 2**0.5


def test_rounded_rows_of_many_turns_are_passed_without_stops(tmp_path):
    path = planar(tmp_path, elbow={"kind": "continuous", "limits": None})
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(path))
    rows = np.round(np.linspace((0.0, 0.0), (0.7, 20.0), 500), 6)
    limits = {"max_velocity": 1.0, "max_acceleration": 1.0}
    assert planners.Trajectory.along(space, rows, **limits).duration == pytest.approx(21.0)
    with pytest.raises(InputError, match="turn"):
        planners.Trajectory.along(space, [(0.0, 0.0), (0.0, 4.0), (0.0, 4.0)], **limits)


def test_many_stops_along_rows_are_told(tmp_path):
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(planar(tmp_path)))
    angles = np.linspace(0.0, 1.0, 30)
    rows = np.column_stack([np.sin(angles), np.cos(angles)])
    with pytest.warns(UserWarning, match="the arm stops at 28 of 30 rows"):
        driven = planners.Trajectory.along(space, rows, max_acceleration=3.0)
    at_rest = np.abs(driven.velocities).max(axis=1) < 1e-9
    assert at_rest.sum() == 30


# ---- times, messages, files and pictures ---------------------------------------------------------


@given(seeds, kinds, st.floats(1.0, 9.0))
def test_a_longer_duration_slows_the_whole_motion(seed, kind, factor):
    rng = np.random.default_rng(seed)
    limits = draw_limits(kind, rng)
    plan = plan_along(kind, draw_waypoints(kind, rng, 3))
    fastest = plan.trajectory(**limits)
    assume(fastest.duration > 0.0)
    slow = plan.trajectory(**limits, duration=factor * fastest.duration)
    assert slow.duration == pytest.approx(factor * fastest.duration)
    t = find_inner_times(fastest, 0.0)  # accelerations jump at rows
    for power, fast_rows, slow_rows in zip(
        itertools.count(), fastest.sample(t), slow.sample(factor * t), strict=False
    ):
        np.testing.assert_allclose(fast_rows, factor**power * slow_rows, atol=1e-6)


def test_rows_are_at_most_a_time_step_apart(tmp_path):
    plan = plan_along("floating", draw_waypoints("floating", np.random.default_rng(3), 6))
    trajectory = plan.trajectory(**TRANSLATION_LIMITS, **ROTATION_LIMITS, time_step=0.02)
    times, positions = trajectory.times, trajectory.positions
    gaps = np.diff(times)
    assert times[0] == 0.0 and gaps.min() > 0.0 and gaps.max() <= 0.02 * (1.0 + 1e-9)
    for t in (-1.0, trajectory.duration + 1.0):  # it rests before and after
        assert not any(rows.any() for rows in trajectory.sample(t)[1:])
    np.testing.assert_array_equal(positions, trajectory.sample(times)[0])
    # No quaternion jumps to its negative.
    assert not positions.flags.writeable and (np.diff(positions[:, 3:], axis=0) ** 2).max() < 0.1
    trajectory.to_csv(tmp_path / "motion.csv")
    names, *table = csv.reader((tmp_path / "motion.csv").read_text().splitlines())
    assert names[7:9] == ["qw", "x_velocity"]
    expected = np.column_stack([times, positions, trajectory.velocities])
    np.testing.assert_array_equal(np.array(table, dtype=float), expected)
    stay = plan_along("plane", [(1.0, 2.0)] * 3).trajectory(**TRANSLATION_LIMITS)
    assert stay.duration == 0.0 and stay.positions.tolist() == [[1.0, 2.0]]


def test_cubic_polynomials_of_the_joint_message_equal_the_motion():
    plan = plan_along("joints", draw_waypoints("joints", np.random.default_rng(2), 4))
    trajectory = plan.trajectory(**TRANSLATION_LIMITS)
    message = trajectory.to_joint_trajectory(frame_id="base")
    assert (message.joint_names, message.header.frame_id) == (list(plan.axes), "base")
    stamps = [point.time_from_start for point in message.points]
    spline = CubicHermiteSpline(
        [stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps],
        [point.positions for point in message.points],
        [point.velocities for point in message.points],
    )
    t = np.linspace(0.0, trajectory.duration, 999)
    np.testing.assert_allclose(spline(t), trajectory.sample(t)[0], atol=1e-8)
    labels = [side.get_ylabel() for side in trajectory.plot().figure.axes]
    assert labels == ["velocity (rad/s)", "velocity (m/s)"]
    assert trajectory._repr_png_().startswith(b"\x89PNG")  # which a notebook shows
    with pytest.raises(InputError, match="moves the joints"):
        trajectory.to_path()


def test_poses_of_the_path_message_are_stamped():
    plan = plan_along("turning", draw_waypoints("turning", np.random.default_rng(1), 3))
    trajectory = plan.trajectory(**TRANSLATION_LIMITS, **ROTATION_LIMITS)
    message = messages.Path()
    message.header.stamp = messages.Time(7, 900_000_000)
    assert trajectory.to_path(message, frame_id="odom") is message
    for time, stamped in zip(trajectory.times, message.poses, strict=True):
        stamp = stamped.header.stamp
        assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(7.9 + time)
        assert 0 <= stamp.nanosec < 10**9


def test_limits_that_numbers_do_not_resolve_together_are_refused():
    # Beside the years of the drive, a second of turning is a rounding error.
    rows = [(0.0, 0.0, 0.0), (0.7, 0.1, 0.0), (0.7, 0.1, 0.3), (0.1, 0.7, 0.3)]
    limits = {"max_velocity": 1e-11, "max_acceleration": 1.0, **ROTATION_LIMITS}
    with pytest.raises(InputError, match="limits differ so much"):
        plan_along("turning", rows).trajectory(**limits)
    assert plan_along("turning", rows).trajectory(**limits | {"max_velocity": 1.0}).duration


def test_a_corner_at_speed_is_refused(monkeypatch):
    pass_all = lambda segments, *_: np.ones(len(segments.lengths) - 1, dtype=bool)  # noqa: E731
    monkeypatch.setattr("planners._motion.timing.find_passes", pass_all)
    with pytest.raises(InputError, match="limits differ"):
        plan_along("plane", [(0.0, 0.0), (2.0, 0.0), (2.0, 3.0)]).trajectory(**TRANSLATION_LIMITS)


def shift(column, row, by):
    """Return a function that changes one number of some phases."""

    def change(phases):
        values = getattr(phases, column).copy()
        values[row] += by
        return phases._replace(**{column: values})

    return change


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(shift("positions", 0, 1e-4), id="another start"),
        pytest.param(shift("positions", 1, 1e-4), id="a jump ahead"),
        pytest.param(shift("speeds", 0, 0.01), id="a speed at the start"),
        pytest.param(shift("speeds", 2, 0.01), id="a jump of the speed"),
        pytest.param(shift("accelerations", 1, math.nan), id="nan"),
        pytest.param(shift("times", 1, 100.0), id="times that fall"),
        pytest.param(shift("times", -1, 1e-3), id="beyond the goal"),
        pytest.param(lambda phases: type(phases)(*(column[:4] for column in phases)), id="no goal"),
    ],
)
def test_what_is_no_motion_from_start_to_goal_is_found(change):
    rows = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 3.0)])
    trajectory = plan_along("plane", rows).trajectory(**TRANSLATION_LIMITS)
    rates = (LimitRates(np.asarray(limit), None, 2) for limit in TRANSLATION_LIMITS.values())
    bounds = MotionBounds(*rates, lateral=1.0, gap=1e-9)
    path = rows, trajectory._segments, trajectory._rotations
    assert is_motion(*path, trajectory._phases, bounds)
    with np.errstate(invalid="ignore"):
        assert not is_motion(*path, change(trajectory._phases), bounds)


def test_a_car_far_away_passes_steps_that_are_rounding_errors():
    lower = (200000.0, -190000.0)
    workspace = cspace.Workspace.from_array(np.zeros((60, 40), dtype=bool), 0.1, lower=lower)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.6, 0.4), rotations=36)
    start, goal = (200001.0, -189998.0, 0.0), (200005.0, -189998.0, 0.0)
    plan = planners.plan(space, start, goal, drive=planners.Car(1.0))
    limits = {"max_velocity": 1.0, "max_acceleration": 0.5, "max_jerk": 2.0}
    fastest = plan.trajectory(**limits).duration
    near = plan.waypoints[0] + (9e-10, 1e-9, -3e-9)
    rows = np.insert(plan.waypoints, 1, near, axis=0)
    bent = replace(plan, waypoints=rows)
    assert bent.trajectory(**limits).duration == pytest.approx(fastest, rel=1e-6)
