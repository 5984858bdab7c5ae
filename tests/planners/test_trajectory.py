"""Trajectories: proven edges, limits, shortest times, messages, files and pictures.

Oracles: SciPy's rotations, OMPL's curves, differences of positions, a linear program, and steps in
the phase plane.
"""

import csv
import itertools
import math
import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from ompl import base as ob
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

import planners
from cspace import InputError
from cspace.arms import Arm, build_arm_space
from cspace.files import ros as messages
from tests.helpers.planning import (
    CAR_OPTIONS,
    ENDPOINTS,
    SPACES,
    build_open_map,
    build_room,
    turn_between,
)
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds
from tests.helpers.urdfs import joint, link, planar, planar_with_tip, pose_at, post, write_urdf

AXES_OF_KIND: dict[str, tuple[str, ...]] = {
    "plane": ("x", "y"),
    "turning": ("x", "y", "yaw"),
    "space": ("x", "y", "z"),
    "yawing": ("x", "y", "z", "yaw"),
    "floating": ("x", "y", "z", "qx", "qy", "qz", "qw"),
    "joints": ("shoulder", "lift", "wrist"),
}
AXIS_UNITS = {
    "yaw": "rad",
    "shoulder": "rad",
    "wrist": "rad",
    **dict.fromkeys(("qx", "qy", "qz", "qw"), "1"),
}
OMPL_CURVES = {"dubins": ob.DubinsStateSpace, "reeds-shepp": ob.ReedsSheppStateSpace}
ROTATION_LIMITS = {"max_angular_velocity": 1.0, "max_angular_acceleration": 2.0}
TRANSLATION_LIMITS: dict[str, Any] = {"max_velocity": 1.0, "max_acceleration": 0.5}


@cache
def template() -> planners.Plan:
    """Return a plan that other plans replace in part."""
    return planners.plan(build_open_map("plane"), (1.5, 1.5), (5.5, 2.5), time_limit=5.0, seed=1)


def plan_along(
    kind: str, waypoints: Any, drive: str = "holonomic", radius: float | None = None
) -> planners.Plan:
    """Return a plan along waypoints, without a map."""
    rows, axes = np.asarray(waypoints, dtype=float), AXES_OF_KIND[kind]
    units = tuple(AXIS_UNITS.get(axis, "m") for axis in axes)
    changes: dict[str, Any] = {
        "path": rows,
        "waypoints": rows,
        "axes": axes,
        "units": units,
        "space": None,
    }
    return replace(template(), **changes, drive=drive, turning_radius=radius)


def draw_waypoints(kind: str, rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw configurations, some equal to their predecessor in part."""
    dim = 3 if kind in ("space", "yawing", "floating", "joints") else 2
    places = rng.uniform(-3.0, 3.0, (count, dim))
    turns = rng.uniform(-math.pi, math.pi, (count, len(AXES_OF_KIND[kind]) - dim))
    if kind == "floating":
        turns = Rotation.random(count, random_state=rng).as_quat() * rng.choice(
            [-1.0, 1.0], (count, 1)
        )
    rows = np.column_stack([places, turns])
    for k in range(1, count):
        same = rng.choice([0, 0, 0, dim, rows.shape[1]])
        rows[k, :same] = rows[k - 1, :same]
    return rows


def draw_limits(kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """Draw limits of the whole translation or of each axis."""
    dim = 2 if kind in ("plane", "turning") else 3
    each = rng.random() < 0.5
    names = ["max_velocity", "max_acceleration"]
    drawn: dict[str, Any] = {
        name: np.exp(rng.uniform(-2.0, 2.0, dim if each else None)) for name in names
    }
    if kind in ("turning", "yawing", "floating"):
        drawn |= {name: float(np.exp(rng.uniform(-2.0, 2.0))) for name in ROTATION_LIMITS}
    return drawn


def displacement(kind: str, first: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return translations and rotation vectors to configurations, shape (n, k)."""
    if kind == "floating":
        turns = (Rotation.from_quat(first[3:]).inv() * Rotation.from_quat(q[:, 3:])).as_rotvec()
        return np.column_stack([q[:, :3] - first[:3], turns])
    if kind in ("turning", "yawing"):
        return np.column_stack([q[:, :-1] - first[:-1], turn_between(first[-1], q[:, -1])])
    return q - first


def distances_to_edges(kind: str, waypoints: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return distances from straight edges, in metres and radians together."""
    found = np.full(len(q), np.inf)
    for first, last in itertools.pairwise(waypoints):
        step, offsets = displacement(kind, first, last[None])[0], displacement(kind, first, q)
        shares = np.clip(offsets @ step / max(step @ step, 1e-30), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(offsets - shares[:, None] * step, axis=1))
    return found


def differences(kind: str, rows: Any, t: np.ndarray, h: float) -> np.ndarray:
    """Return central differences of sampled positions, shape (n, size)."""
    before, after = (rows.sample(t + sign * h)[0] for sign in (-1.0, 1.0))
    steps = after - before
    if kind in ("turning", "yawing"):
        steps[:, -1] = turn_between(before[:, -1], after[:, -1])
    return steps / (2.0 * h)


def inner_times(trajectory: planners.Trajectory, gap: float) -> np.ndarray:
    """Return times halfway between rows more than ``gap`` apart, far from jumps."""
    first, last = trajectory.times[:-1], trajectory.times[1:]
    return ((first + last) / 2.0)[last - first > gap]


def rates_of(kind: str, velocities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities of translation or joints, and angular speeds."""
    if kind == "floating":
        return velocities[:, :3], 2.0 * np.linalg.norm(velocities[:, 3:], axis=1)
    if kind in ("turning", "yawing"):
        return velocities[:, :-1], np.abs(velocities[:, -1])
    return velocities, np.zeros(len(velocities))


def excess(kind: str, rates: np.ndarray, limit: Any) -> float:
    """Return the largest ratio of rates to their limit."""
    parts = (
        rates
        if np.ndim(limit) or kind == "joints"
        else np.linalg.norm(rates, axis=1, keepdims=True)
    )
    return float((np.abs(parts) / limit).max())


@settings(deadline=None)
@given(seed=seeds, count=st.integers(1, 5), kind=st.sampled_from(sorted(AXES_OF_KIND)))
def test_trajectories_follow_straight_edges_within_limits_from_rest_to_rest(
    seed: int, count: int, kind: str
) -> None:
    rng = np.random.default_rng(seed)
    waypoints, limits = draw_waypoints(kind, rng, count), draw_limits(kind, rng)
    trajectory = plan_along(kind, waypoints).trajectory(**limits)
    dense = np.linspace(-0.1, trajectory.duration + 0.1, 400)
    for t in (trajectory.times, dense):
        positions, velocities, _ = trajectory.sample(t)
        if count > 1:
            assert distances_to_edges(kind, waypoints, positions).max() < 1e-9
        if kind in ("turning", "yawing"):
            assert (np.abs(positions[:, -1]) <= math.pi).all()
        translation, rotation = rates_of(kind, velocities)
        assert excess(kind, translation, limits["max_velocity"]) <= 1.0 + 1e-9
        assert rotation.max() <= limits.get("max_angular_velocity", 0.0) * (1.0 + 1e-9)
    for row, waypoint in ((0, waypoints[0]), (-1, waypoints[-1])):
        np.testing.assert_allclose(
            displacement(kind, waypoint, trajectory.positions[row : row + 1 or None]),
            0.0,
            atol=1e-9,
        )
        assert not trajectory.velocities[row].any()
    # Every waypoint is reached, at rest if the path has a corner there.
    for before, waypoint, after in zip(waypoints, waypoints[1:], waypoints[2:], strict=False):
        steps = [
            displacement(kind, a, b[None])[0] for a, b in ((before, waypoint), (waypoint, after))
        ]
        lengths = [float(np.linalg.norm(step)) for step in steps]
        near = np.abs(displacement(kind, waypoint, trajectory.positions)).max(axis=1) < 1e-9
        assert near.any()
        if (
            min(lengths) > 1e-9
            and np.linalg.norm(steps[0] / lengths[0] - steps[1] / lengths[1]) > 1e-6
        ):
            assert (np.abs(trajectory.velocities[near]).max(axis=1) == 0.0).any()


@settings(deadline=None)
@given(seed=seeds, kind=st.sampled_from(sorted(AXES_OF_KIND)))
def test_velocities_and_accelerations_equal_differences(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    limits = draw_limits(kind, rng)
    trajectory = plan_along(kind, draw_waypoints(kind, rng, 4)).trajectory(**limits)
    t, h = inner_times(trajectory, 4e-3), 1e-3
    assume(len(t))
    _, velocities, accelerations = trajectory.sample(t)
    np.testing.assert_allclose(
        differences(kind, trajectory, t, h), velocities, rtol=1e-4, atol=1e-4
    )
    before, after = (rates_of(kind, trajectory.sample(t + sign * h)[1]) for sign in (-1.0, 1.0))
    np.testing.assert_allclose(
        (trajectory.sample(t + h)[1] - trajectory.sample(t - h)[1]) / (2.0 * h),
        accelerations,
        rtol=1e-3,
        atol=1e-3,
    )
    assert (
        excess(kind, (after[0] - before[0]) / (2.0 * h), limits["max_acceleration"]) <= 1.0 + 1e-6
    )
    if kind in ("turning", "yawing", "floating"):
        assert np.abs(after[1] - before[1]).max() / (2.0 * h) <= limits[
            "max_angular_acceleration"
        ] * (1.0 + 1e-6)


def covered_share(
    step: np.ndarray, velocity: Any, acceleration: Any, duration: float, count: int = 200
) -> float:
    """Return the largest share of a step covered in a duration, by a linear program."""
    dt = duration / count
    top = (velocity / np.abs(step)).min()
    gain = (acceleration / np.abs(step)).min() * dt
    changes = np.eye(count + 1, k=1)[:-1] - np.eye(count + 1)[:-1]
    bounds = [(0.0, 0.0), *[(0.0, top)] * (count - 1), (0.0, 0.0)]
    solved = linprog(
        -np.full(count + 1, dt),
        A_ub=np.vstack([changes, -changes]),
        b_ub=np.full(2 * count, gain),
        bounds=bounds,
    )
    assert solved.success
    return float(-solved.fun)


@settings(deadline=None, max_examples=20)
@given(seed=seeds)
def test_no_motion_along_an_edge_is_faster(seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits, step = draw_limits("joints", rng), rng.uniform(-3.0, 3.0, 3)
    trajectory = plan_along("joints", [np.zeros(3), step]).trajectory(**limits)
    share = covered_share(
        step, limits["max_velocity"], limits["max_acceleration"], trajectory.duration
    )
    assert 0.995 < share <= 1.0 + 1e-9  # the program's acceleration changes at 200 times only


@settings(deadline=None)
@given(
    seed=seeds,
    cuts=st.lists(st.floats(0.01, 0.99), min_size=1, max_size=5),
    kind=st.sampled_from(sorted(AXES_OF_KIND)),
)
def test_waypoints_on_a_straight_edge_cost_no_time(seed: int, cuts: list[float], kind: str) -> None:
    rng = np.random.default_rng(seed)
    first, last = draw_waypoints(kind, rng, 2)
    step, limits = displacement(kind, first, last[None])[0], draw_limits(kind, rng)
    assume(np.linalg.norm(step) > 0.1)
    whole = plan_along(kind, [first, last]).trajectory(**limits)
    shares = np.array([0.0, *sorted(set(np.round(cuts, 3))), 1.0])
    if kind == "floating":
        turns = Rotation.from_quat(first[3:]) * Rotation.from_rotvec(shares[:, None] * step[3:])
        rows = np.column_stack([first[:3] + shares[:, None] * step[:3], turns.as_quat()])
    else:
        rows = first + shares[:, None] * step
    cut = plan_along(kind, rows).trajectory(**limits)
    assert cut.duration == pytest.approx(whole.duration, rel=1e-9)
    t = np.linspace(0.0, whole.duration, 50)
    np.testing.assert_allclose(
        displacement(kind, first, cut.sample(t)[0]),
        displacement(kind, first, whole.sample(t)[0]),
        atol=1e-7,
    )


# ---- cars ----------------------------------------------------------------------------------------


def car_plan(drive: str, rng: np.random.Generator, count: int) -> planners.Plan:
    places = rng.uniform(-3.0, 3.0, (count, 2))
    return plan_along(
        "turning", np.column_stack([places, rng.uniform(-math.pi, math.pi, count)]), drive, 0.4
    )


def measure_edges(plan: planners.Plan) -> np.ndarray:
    """Return the metres of OMPL's shortest curves."""
    path, waypoints = OMPL_CURVES[plan.drive](0.4), plan.waypoints.tolist()
    return np.array(
        [path.distance(*states) for states in itertools.pairwise(pose_states(path, waypoints))]
    )


def pose_states(path: Any, rows: Any) -> list[Any]:
    states = [path.allocState() for _ in rows]
    for state, (x, y, yaw) in zip(states, rows, strict=True):
        state.setXY(x, y)
        state.setYaw(yaw)
    return states


def interpolate_curve(plan: planners.Plan, shares: np.ndarray) -> np.ndarray:
    """Return the configurations at shares of OMPL's curve between two waypoints."""
    path, rows = OMPL_CURVES[plan.drive](0.4), []
    first, last, between = pose_states(path, [*plan.waypoints, (0.0, 0.0, 0.0)])
    for share in shares.tolist():
        path.interpolate(first, last, share, between)
        rows.append((between.getX(), between.getY(), between.getYaw()))
    return np.array(rows)


@settings(deadline=None, max_examples=40)
@given(
    seed=seeds,
    count=st.integers(2, 4),
    drive=st.sampled_from(sorted(OMPL_CURVES)),
    options=st.fixed_dictionaries(
        {},
        optional={
            name: st.floats(0.1, 3.0) for name in (*ROTATION_LIMITS, "max_lateral_acceleration")
        },
    ),
)
def test_cars_follow_their_curves_within_limits(
    seed: int, count: int, drive: str, options: dict[str, float]
) -> None:
    plan = car_plan(drive, np.random.default_rng(seed), count)
    trajectory = plan.trajectory(max_velocity=1.5, max_acceleration=0.8, **options)
    velocities = trajectory.velocities
    speeds = np.linalg.norm(velocities[:, :2], axis=1)
    # Speed is linear between rows, so trapezoids give the metres.
    metres = np.concatenate(
        [[0.0], np.cumsum(np.diff(trajectory.times) * (speeds[1:] + speeds[:-1]) / 2.0)]
    )
    # The car reaches each waypoint after the length of the shortest curve, so it drives such a
    # curve.
    for length, waypoint in zip(np.cumsum(measure_edges(plan)), plan.waypoints[1:], strict=True):
        row = np.abs(metres - length).argmin()
        np.testing.assert_allclose(metres[row], length, atol=1e-8)
        np.testing.assert_allclose(
            displacement("turning", waypoint, trajectory.positions[[row]]), 0.0, atol=1e-6
        )
    if (
        count == 2 and drive == "dubins"
    ):  # OMPL may choose another of equally short curves of Reeds and Shepp
        expected = interpolate_curve(plan, np.clip(metres / metres[-1], 0.0, 1.0))
        np.testing.assert_allclose(trajectory.positions[:, :2], expected[:, :2], atol=1e-6)
        np.testing.assert_allclose(
            turn_between(trajectory.positions[:, 2], expected[:, 2]), 0.0, atol=1e-6
        )
    assert speeds.max() <= 1.5 * (1.0 + 1e-9) and not velocities[[0, -1]].any()
    t, h = inner_times(trajectory, 4e-4), 1e-4
    found = differences("turning", trajectory, t, h)
    np.testing.assert_allclose(found, trajectory.sample(t)[1], atol=1e-5)
    before, now, after = (trajectory.sample(t + shift)[1] for shift in (-h, 0.0, h))
    change, speed = (after - before) / (2.0 * h), np.linalg.norm(now[:, :2], axis=1)
    np.testing.assert_allclose(change, trajectory.sample(t)[2], atol=1e-4)
    forward, sideways = (
        (change[:, :2] * now[:, :2]).sum(axis=1),
        change[:, 1] * now[:, 0] - change[:, 0] * now[:, 1],
    )
    assert np.abs(forward / speed).max() <= 0.8 + 1e-4
    assert np.abs(sideways / speed).max() <= options.get("max_lateral_acceleration", 0.8) + 1e-4
    assert np.abs(velocities[:, 2]).max() <= options.get("max_angular_velocity", np.inf) * (
        1.0 + 1e-9
    )
    headings = trajectory.sample(t)[0][:, 2]
    np.testing.assert_allclose(
        now[:, 1] * np.cos(headings), now[:, 0] * np.sin(headings), atol=1e-9
    )
    assert (np.abs(now[:, 2]) <= speed / 0.4 + 1e-9).all()
    # A car rests where it changes between ahead and reverse, and, with a limited angular
    # acceleration, where it steers.
    ahead = velocities[:, 0] * np.cos(trajectory.positions[:, 2]) + velocities[:, 1] * np.sin(
        trajectory.positions[:, 2]
    )
    moving = speeds > 0.0
    both = moving[1:] & moving[:-1]
    assert (np.sign(ahead[1:]) == np.sign(ahead[:-1]))[both].all()
    if "max_angular_acceleration" in options:
        assert np.abs(change[:, 2]).max() <= options["max_angular_acceleration"] + 1e-4
        jumps = np.abs(np.diff(velocities[:, 2]))
        assert (
            jumps <= options["max_angular_acceleration"] * np.diff(trajectory.times) + 1e-5
        ).all()


def phase_plane_seconds(tops: np.ndarray, acceleration: float, ds: float) -> float:
    """Return the shortest time from rest to rest along steps ``ds`` with speed limits."""
    speeds = [0.0, *np.minimum(tops[1:], tops[:-1]).tolist(), 0.0]
    for _ in range(2):
        for k in range(1, len(speeds)):
            speeds[k] = min(speeds[k], math.sqrt(speeds[k - 1] ** 2 + 2.0 * acceleration * ds))
        speeds.reverse()
    return sum(2.0 * ds / (a + b) for a, b in itertools.pairwise(speeds))


@settings(deadline=None, max_examples=10)
@given(seed=seeds)
def test_no_motion_along_a_curve_is_faster(seed: int) -> None:
    # A Dubins curve has no cusp; the lateral acceleration limits the speed on arcs.
    plan, count = car_plan("dubins", np.random.default_rng(seed), 2), 10_000
    trajectory = plan.trajectory(
        max_velocity=1.5, max_acceleration=0.5, max_lateral_acceleration=0.6
    )
    length, rows = measure_edges(plan)[0], interpolate_curve(plan, np.linspace(0.0, 1.0, count + 1))
    steers = np.abs(turn_between(rows[:-1, 2], rows[1:, 2])) > 0.5 * length / count / 0.4
    tops = np.where(steers, math.sqrt(0.6 * 0.4), 1.5)
    assert trajectory.duration == pytest.approx(
        phase_plane_seconds(tops, 0.5, length / count), rel=1e-3
    )


# ---- plans ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, drive",
    [
        *((name, "holonomic") for name in SPACES),
        *(("turning", each) for each in planners.choices(build_room("turning")).drives[1:]),
    ],
)
def test_plans_in_every_space_and_of_every_drive_have_trajectories(name: str, drive: str) -> None:
    options = CAR_OPTIONS if drive in OMPL_CURVES else {}
    plan = planners.plan(
        build_room(name), *ENDPOINTS[name], drive=drive, time_limit=20.0, seed=1, **options
    )
    turns = ROTATION_LIMITS if name in ("turning", "yawing", "floating") and not options else {}
    trajectory = plan.trajectory(**TRANSLATION_LIMITS, **turns)
    assert (
        trajectory.axes == plan.axes
        and trajectory.units == plan.units
        and f"{trajectory.duration:.3f} s" in repr(trajectory)
    )
    assert build_room(name).is_free(trajectory.positions).all()
    if not options:  # waypoints of differential drives are also joined by straight edges
        assert distances_to_edges(name, plan.waypoints, trajectory.positions).max() < 1e-9
    left = pickle.loads(pickle.dumps(plan)).trajectory(**TRANSLATION_LIMITS, **turns)
    np.testing.assert_array_equal(left.positions, trajectory.positions)
    kept = pickle.loads(pickle.dumps(trajectory))
    np.testing.assert_array_equal(kept.sample(1.0)[0], trajectory.sample(1.0)[0])


def test_a_differential_drive_never_drives_and_turns_at_once() -> None:
    plan = planners.plan(
        build_room("turning"), *ENDPOINTS["turning"], drive="differential", time_limit=20.0, seed=1
    )
    _, velocities, _ = plan.trajectory(**TRANSLATION_LIMITS, **ROTATION_LIMITS).sample(
        np.linspace(0.0, 60.0, 5000)
    )
    assert (np.linalg.norm(velocities[:, :2], axis=1) * np.abs(velocities[:, 2]) < 1e-12).all()


# ---- arms ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def arm_plan(tmp_path_factory: pytest.TempPathFactory) -> planners.Plan:
    """Plan for an arm with velocity limits of 0.4 rad/s, due to a mimic joint, and 1 rad/s."""
    pytest.importorskip("yourdfpy")
    mimic = '<mimic joint="shoulder" multiplier="-2.5"/>'
    parts = [
        link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.2))),
        *(link(name, ((1.0, 0.1, 0.1), (0.5, 0, 0))) for name in "ab"),
    ]
    parts += [joint("shoulder", "foot", "a"), joint("elbow", "a", "b", at=(1, 0, 0))]
    parts += [
        link("cam", ((0.1, 0.1, 0.1), (0, 0, 2))),
        joint("cam", "foot", "cam", extra=mimic, limits=(-9, 9)),
    ]
    space = build_arm_space({}, Arm.from_urdf(write_urdf(tmp_path_factory.mktemp("arm"), *parts)))
    return planners.plan(space, (-0.6, 0.3), (1.4, -0.2), time_limit=20.0, seed=1)


def test_arms_move_within_the_velocity_limits_of_the_urdf(arm_plan: planners.Plan) -> None:
    space: Any = arm_plan.space
    np.testing.assert_array_equal(space.arm.max_velocity, [0.4, 1.0])
    trajectory = arm_plan.trajectory(max_acceleration=0.8)
    assert np.abs(trajectory.velocities).max(axis=0)[0] == pytest.approx(0.4)
    assert trajectory.duration == pytest.approx(
        2.0 / 0.4 + 0.4 / 0.8
    )  # a trapezoid of the shoulder
    slower = arm_plan.trajectory(max_velocity={"shoulder": 0.2}, max_acceleration=(0.8, 0.8))
    assert slower.duration == pytest.approx(2.0 / 0.2 + 0.2 / 0.8)
    assert arm_plan.trajectory(max_velocity=9.0, max_acceleration=8.0).duration == pytest.approx(
        2.0 * math.sqrt(2.0 / 8.0)
    )


def test_arms_without_velocity_limits_require_them(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    path = planar(tmp_path)
    path.write_text(path.read_text().replace('velocity="1"', 'velocity="0"', 1))
    arm = Arm.from_urdf(path)
    np.testing.assert_array_equal(arm.max_velocity, [np.inf, 1.0])
    plan = planners.plan(build_arm_space({}, arm), (0.0, 0.5), (0.5, 0.5), time_limit=20.0)
    with pytest.raises(
        InputError,
        match="max_velocity lacks shoulder; it must be one number, or one for each of shoulder",
    ):
        plan.trajectory(max_acceleration=1.0)
    assert plan.trajectory(
        max_velocity={"shoulder": 1.0}, max_acceleration=4.0
    ).duration == pytest.approx(0.75, abs=1e-6)


def test_cubic_polynomials_of_the_joint_message_equal_the_motion() -> None:
    trajectory = plan_along(
        "joints", draw_waypoints("joints", np.random.default_rng(2), 4)
    ).trajectory(**TRANSLATION_LIMITS)
    msg = trajectory.to_joint_trajectory(frame_id="base")
    assert isinstance(msg, messages.JointTrajectory)
    assert (msg.joint_names, msg.header.frame_id) == (list(AXES_OF_KIND["joints"]), "base")
    times = [
        point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in msg.points
    ]
    spline = CubicHermiteSpline(
        times, *([getattr(p, name) for p in msg.points] for name in ("positions", "velocities"))
    )
    t = np.linspace(0.0, trajectory.duration, 999)
    np.testing.assert_allclose(spline(t), trajectory.sample(t)[0], atol=1e-8)


# ---- times, messages, files and pictures ---------------------------------------------------------


def test_a_longer_duration_slows_the_whole_motion() -> None:
    plan = plan_along("turning", draw_waypoints("turning", np.random.default_rng(1), 4))
    fastest = plan.trajectory(**TRANSLATION_LIMITS, **ROTATION_LIMITS)
    slow = plan.trajectory(**TRANSLATION_LIMITS, **ROTATION_LIMITS, duration=3.0 * fastest.duration)
    assert slow.duration == pytest.approx(3.0 * fastest.duration)
    t = np.linspace(0.0, fastest.duration, 99)
    for factor, one, other in zip(
        (1.0, 3.0, 9.0), fastest.sample(t), slow.sample(3.0 * t), strict=True
    ):
        np.testing.assert_allclose(one[::2], factor * other[::2], atol=1e-6)
    with pytest.raises(InputError, match=r"duration is 1\.0; the limits need"):
        plan.trajectory(**TRANSLATION_LIMITS, **ROTATION_LIMITS, duration=1.0)


def test_rows_are_at_most_a_time_step_apart() -> None:
    plan = plan_along("floating", draw_waypoints("floating", np.random.default_rng(3), 6))
    trajectory = plan.trajectory(**TRANSLATION_LIMITS, **ROTATION_LIMITS, time_step=0.02)
    gaps = np.diff(trajectory.times)
    assert trajectory.times[0] == 0.0 and gaps.min() > 0.0 and gaps.max() <= 0.02 * (1.0 + 1e-9)
    for t in (-1.0, trajectory.duration + 1.0):  # it rests before and after
        assert not any(each.any() for each in trajectory.sample(t)[1:])
    for rows, sampled in zip(
        (trajectory.positions, trajectory.velocities, trajectory.accelerations),
        trajectory.sample(trajectory.times),
        strict=True,
    ):
        np.testing.assert_array_equal(rows, sampled)
        assert not rows.flags.writeable
    assert (np.diff(trajectory.positions[:, 3:], axis=0) ** 2).sum(
        axis=1
    ).max() < 0.1  # no quaternion jumps to its negative
    np.testing.assert_allclose(np.linalg.norm(trajectory.positions[:, 3:], axis=1), 1.0)


def test_a_plan_that_stays_takes_no_time() -> None:
    for rows in ([(1.0, 2.0)], [(1.0, 2.0)] * 3):
        trajectory = plan_along("plane", rows).trajectory(**TRANSLATION_LIMITS)
        assert trajectory.duration == 0.0 and trajectory.positions.tolist() == [[1.0, 2.0]]
        assert not any(each.any() for each in trajectory.sample((-1.0, 0.0, 1.0))[1:])
        trajectory.plot()


def test_poses_of_the_path_message_are_stamped() -> None:
    plan = plan_along("turning", draw_waypoints("turning", np.random.default_rng(1), 3))
    trajectory = plan.trajectory(**TRANSLATION_LIMITS, **ROTATION_LIMITS)
    msg = messages.Path()
    msg.header.stamp = messages.Time(7, 900_000_000)
    assert trajectory.to_path(msg, frame_id="odom") is msg and msg.header.stamp == messages.Time(
        7, 900_000_000
    )
    for k, stamped in enumerate(msg.poses):
        stamp = stamped.header.stamp
        assert (
            stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(7.9 + trajectory.times[k])
            and 0 <= stamp.nanosec < 10**9
        )
        pose = stamped.pose
        assert (pose.position.x, pose.position.y, pose.position.z) == (
            *trajectory.positions[k, :2],
            0.0,
        )
        assert 2.0 * math.atan2(pose.orientation.z, pose.orientation.w) == pytest.approx(
            trajectory.positions[k, 2]
        )
    assert trajectory.to_path().header.frame_id == "map"


def test_csv_holds_times_positions_and_velocities(tmp_path: Path) -> None:
    trajectory = plan_along("plane", [(0, 0), (1, 2), (3, 1)]).trajectory(**TRANSLATION_LIMITS)
    trajectory.to_csv(tmp_path / "motion.csv")
    with (tmp_path / "motion.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    assert names == ["time", "x", "y", "x_velocity", "y_velocity"]
    expected = np.column_stack([trajectory.times, trajectory.positions, trajectory.velocities])
    np.testing.assert_array_equal(np.array(rows, dtype=float), expected)


@pytest.mark.parametrize(
    "kind, labels",
    [
        ("plane", ["speed (m/s)"]),
        ("turning", ["speed (m/s)", "angular speed (rad/s)"]),
        ("joints", ["velocity (rad/s)", "velocity (m/s)"]),
    ],
)
def test_the_picture_shows_speed_over_time(kind: str, labels: list[str]) -> None:
    plan = plan_along(kind, draw_waypoints(kind, np.random.default_rng(4), 4))
    trajectory = plan.trajectory(
        **TRANSLATION_LIMITS, **(ROTATION_LIMITS if kind == "turning" else {})
    )
    ax = trajectory.plot()
    sides = ax.figure.axes
    assert [side.get_ylabel() for side in sides] == labels and ax.get_xlabel() == "time (s)"
    lines = [line for side in sides for line in side.lines]
    t = inner_times(trajectory, 1e-6)
    translation, rotation = rates_of(kind, trajectory.sample(t)[1])
    curves = (
        [*translation.T] if kind == "joints" else [np.linalg.norm(translation, axis=1), rotation]
    )
    named = {line.get_label(): line for line in lines}
    for name, curve in zip(
        AXES_OF_KIND["joints"] if kind == "joints" else ("speed", "angular speed"),
        curves,
        strict=True,
    ):
        if name in named:
            np.testing.assert_allclose(np.interp(t, *named[name].get_data()), curve, atol=1e-9)
    assert len(named) == len(lines) == (3 if kind == "joints" else len(labels))


def test_a_path_of_an_arm_has_the_trajectory_of_its_plan(arm_plan: planners.Plan) -> None:
    expected = arm_plan.trajectory(max_acceleration=2.0, time_step=0.05)
    space: Any = arm_plan.space
    found = planners.Trajectory.along(
        space, arm_plan.waypoints, max_acceleration=2.0, time_step=0.05
    )
    for name in ("times", "positions", "velocities", "accelerations"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.axes == expected.axes and found.units == expected.units


def test_a_line_of_an_arm_has_a_trajectory_near_the_line(tmp_path: Path) -> None:
    arm = planar_with_tip(tmp_path)
    space = build_arm_space({}, arm)
    motion = space.follow_line((-0.9, 1.6), "tip", pose_at(1.2, 0.9), tolerance=(1e-3, math.inf))
    trajectory = planners.Trajectory.along(
        space, motion, max_velocity=1.0, max_acceleration=2.0, duration=9.0
    )
    assert trajectory.duration == pytest.approx(9.0)
    q = trajectory.sample(np.linspace(0.0, 9.0, 500))[0]
    tips = np.column_stack(
        [np.cos(q[:, 0]) + np.cos(q.sum(axis=1)), np.sin(q[:, 0]) + np.sin(q.sum(axis=1))]
    )
    first, last = motion.poses[:, :2, 3]
    along = (last - first) / np.linalg.norm(last - first)
    distances = np.abs((tips - first) @ (-along[1], along[0]))
    assert distances.max() <= motion.deviation + 1e-9 and distances.max() > 1e-5
    np.testing.assert_allclose(trajectory.positions[[0, -1]], motion.waypoints[[0, -1]], atol=1e-12)
    message = trajectory.to_joint_trajectory()
    assert message.joint_names == list(arm.joints)


def test_trajectories_along_unproven_paths_are_refused(tmp_path: Path) -> None:
    arm = planar_with_tip(tmp_path)
    space = build_arm_space({"post": post()}, arm)
    far = space.follow_line((-0.9, 1.6), "tip", pose_at(9.0, 0.9), tolerance=(1e-3, math.inf))
    refused: Any = (
        (
            space,
            far,
            "path is not certified: stopped after .* %.*a trajectory follows the whole line",
        ),
        (space, [(-0.6, 0.3), (1.4, -0.2)], "path has 1 of 1 motions that are not proven free"),
        (space, (-0.6, 0.3), r"path has shape \(2,\); it must be rows of configurations"),
        (
            build_open_map("plane"),
            [(1.0, 1.0), (2.0, 1.0)],
            "space is CSpace.*; it must be the space of an arm",
        ),
    )
    for given_space, path, message in refused:
        with pytest.raises(InputError, match=message):
            planners.Trajectory.along(given_space, path, max_velocity=1.0, max_acceleration=1.0)


@refusals(
    "kind, drive, options, expected",
    (
        "plane",
        "holonomic",
        {"max_velocity": None},
        "max_velocity lacks x, y; it must be one number, or one for each of x, y",
    ),
    ("plane", "holonomic", {"max_velocity": {"x": 1.0}}, "max_velocity lacks y"),
    (
        "plane",
        "holonomic",
        {"max_velocity": 0.0},
        "max_velocity is 0.0; it must be one number above zero",
    ),
    ("plane", "holonomic", {"max_velocity": (1.0, -1.0)}, "max_velocity is -1.0"),
    (
        "plane",
        "holonomic",
        {"max_acceleration": (1.0, 2.0, 3.0)},
        r"max_acceleration has shape \(3,\)",
    ),
    ("plane", "holonomic", {"max_acceleration": math.nan}, "max_acceleration is nan"),
    (
        "plane",
        "holonomic",
        {"max_angular_velocity": 1.0},
        "max_angular_velocity is 1.0; the robot does not turn so",
    ),
    ("plane", "holonomic", {"time_step": 1e-9}, "time_step is 1e-09; it makes .* rows"),
    ("plane", "holonomic", {"time_step": 0.0}, "time_step is 0.0"),
    ("turning", "holonomic", {}, "max_angular_velocity is missing; the robot turns"),
    ("turning", "holonomic", {"max_angular_velocity": 1.0}, "max_angular_acceleration is missing"),
    (
        "turning",
        "holonomic",
        {**ROTATION_LIMITS, "max_lateral_acceleration": 1.0},
        "max_lateral_acceleration is 1.0",
    ),
    (
        "turning",
        "dubins",
        {"max_velocity": (1.0, 2.0)},
        "max_velocity differs by axis; a car turns",
    ),
    ("turning", "dubins", {"max_lateral_acceleration": -1.0}, "max_lateral_acceleration is -1.0"),
    ("joints", "holonomic", {"max_angular_velocity": 1.0}, "max_angular_velocity is 1.0"),
)
def test_trajectories_reject_invalid_arguments(
    kind: str, drive: str, options: dict[str, Any], expected: str
) -> None:
    rows = draw_waypoints(kind, np.random.default_rng(0), 3)
    plan = plan_along(kind, rows, drive, 0.4 if drive == "dubins" else None)
    with pytest.raises(InputError, match=expected):
        plan.trajectory(**(TRANSLATION_LIMITS | options))


def test_messages_of_the_other_kind_and_plans_without_a_path_are_refused() -> None:
    plane = plan_along("plane", [(0, 0), (1, 1)]).trajectory(**TRANSLATION_LIMITS)
    with pytest.raises(InputError, match=r"trajectory moves x, y; .*use to_path\(\)"):
        plane.to_joint_trajectory()
    with pytest.raises(
        InputError, match=r"trajectory moves the joints .*use to_joint_trajectory\(\)"
    ):
        plan_along("joints", [(0, 0, 0), (1, 1, 1)]).trajectory(**TRANSLATION_LIMITS).to_path()
    with pytest.raises(InputError, match="t is nan"):
        plane.sample(math.nan)
    with pytest.raises(InputError, match=r"plan has no path: .*a trajectory follows a path"):
        replace(template(), solved=False).trajectory(**TRANSLATION_LIMITS)
