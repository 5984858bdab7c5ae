"""Smooth paths of trajectories: proofs, limits, continuity, commands and refusals.

Oracles: shapely places the robot among the occupied cells, positions are differenced, and an arm's
configurations are tested one by one.
"""

import dataclasses
import math

import numpy as np
import pytest
import shapely

import cspace
import planners
from planners._motion.segments import (
    MAX_PIECES,
    Segments,
    bound_derivatives,
    place_along,
    prove_segments,
)
from tests.helpers.drives import make_drive
from tests.helpers.handmade import build_empty
from tests.helpers.motions import (
    LIMITS,
    SLACK,
    TURNING_LIMITS,
    build_plan,
    check_limits,
    make_limits,
    replace_rows,
    sample_evenly,
)
from tests.helpers.urdfs import (
    planar,
    planar_arm_meets,
    posed_box,
    space_of,
    write_slider,
)

SPACING = 0.05
POST = 1.55, 0.6, 0.2
"""Center and side of the post that the arm passes, metres."""


@pytest.mark.parametrize(
    "drive, rotations",
    [("holonomic", None), ("holonomic", 36), ("differential", 36), ("differential-reverse", 36)],
)
def test_blended_motion_is_free_smooth_and_within_limits(drive, rotations):
    plan = build_plan(1, drive, rotations)
    limits = make_limits(rotations)
    trajectory = plan.trajectory(**limits)
    assert trajectory.certified
    assert plan.space is not None
    assert trajectory.recheck(plan.space).all()
    assert trajectory.positions[[0, -1]] == pytest.approx(plan.path[[0, -1]], abs=1e-9)
    assert trajectory.duration <= plan.trajectory(**limits, blend=False).duration
    check_limits(trajectory)
    positions, velocities, _ = sample_evenly(trajectory, 2001)
    if drive != "holonomic":
        yaw = positions[:, 2]
        sideways = np.cos(yaw) * velocities[:, 1] - np.sin(yaw) * velocities[:, 0]
        assert np.abs(sideways).max() < 1e-9


def test_per_axis_limits_hold_on_curves():
    plan = build_plan(1, "holonomic", None)
    trajectory = plan.trajectory(max_velocity=(1.0, 0.4), max_acceleration=(0.3, 0.9))
    _, velocities, accelerations = sample_evenly(trajectory, 2001)
    assert (np.abs(velocities).max(axis=0) <= [SLACK, SLACK * 0.4]).all()
    assert (np.abs(accelerations).max(axis=0) <= [SLACK * 0.3, SLACK * 0.9]).all()


@pytest.mark.parametrize(
    "rows, velocity, limits",
    [
        (
            [
                (19.42, 20.296),
                (19.977, 20.139),
                (19.827, 20.523),
                (20.057, 20.129),
                (19.792, 20.003),
                (20.234, 19.725),
            ],
            (1.358, 1.632),
            (1.464, 0.4),
        ),
        # At 18 instants of each interval, these limits seem to hold.
        (
            [
                (19.211, 19.68),
                (19.229, 20.015),
                (19.44, 20.338),
                (19.536, 19.781),
                (19.358, 19.548),
            ],
            (0.407, 1.652),
            (1.193, 0.824),
        ),
    ],
)
def test_limits_hold_between_the_knots_of_curves(rows, velocity, limits):
    space = build_empty((80, 80), cspace.Robot.disc(0.2), spacing=0.5)
    plan = planners.plan(space, (3.0, 3.0), (5.0, 5.0))
    plan = replace_rows(plan, rows)
    trajectory = plan.trajectory(max_velocity=velocity, max_acceleration=np.array(limits))
    _, _, accelerations = sample_evenly(trajectory, 4000)
    assert (np.abs(accelerations) / limits).max() <= 1.0 + 1e-6


def test_yaw_rates_hold_between_the_knots_of_driven_curves():
    space = build_empty((80, 80), cspace.Robot.disc(0.2), spacing=0.5, rotations=12)
    plan = planners.plan(space, (3.0, 3.0, 0.0), (5.0, 5.0, 0.0), drive=planners.Differential())
    places = np.array([(19.179, 19.592), (18.473, 19.924), (18.563, 19.89), (18.935, 19.723)])
    places = np.vstack([places, (18.411, 19.777)])
    yaws = np.arctan2(*np.diff(places, axis=0).T[::-1])
    begins = np.column_stack([places[:-1], yaws])
    ends = np.column_stack([places[1:], yaws])
    rows = np.stack([begins, ends], axis=1).reshape(-1, 3)
    plan = replace_rows(plan, rows)
    trajectory = plan.trajectory(
        max_velocity=0.819,
        max_acceleration=1.495,
        max_angular_velocity=0.483,
        max_angular_acceleration=1.935,
    )
    _, velocities, _ = sample_evenly(trajectory, 4000)
    assert 0.4 < np.abs(velocities[:, 2]).max() <= 0.483 * (1.0 + 1e-6)


def test_robot_passes_a_corner_in_the_open_at_speed_unless_told_to_stop():
    plan = build_plan(1, "differential", 36)
    limits = LIMITS | TURNING_LIMITS
    blended = plan.trajectory(**limits)
    stopping = plan.trajectory(**limits, blend=False)
    assert blended.duration < 0.95 * stopping.duration
    corners = np.linalg.norm(stopping.velocities, axis=1) == 0.0
    on_edges = stopping.positions[corners]
    for waypoint in plan.waypoints:
        assert np.abs(on_edges[:, :2] - waypoint[:2]).max(axis=1).min() < 1e-9


def test_unproven_curve_that_is_not_pulled_back_becomes_its_edges():
    # The curve lies on the path, and only exact geometry proves the path.
    occupied = np.ones((32, 20), dtype=bool)
    occupied[:, 8:12] = False
    workspace = cspace.Workspace.from_array(occupied, 0.25)
    space = cspace.build(workspace, cspace.Robot.disc(0.4375))
    plan = planners.plan(space.exact, (2.0, 2.5), (6.0, 2.5))
    rows = np.array([(2.0, 2.5), (4.0, 2.5), (6.0, 2.5)])
    plan = replace_rows(plan, rows)
    trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=1.0)
    assert trajectory.certified
    assert trajectory.duration == pytest.approx(5.0)


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # feet of 100 m
@pytest.mark.parametrize(
    "rows",
    [
        [(0.6959, 1.5547), (0.2031, 3.9956), (0.0415, 3.7576), (0.0996, 3.8322), (0.222, 2.2031)],
        [(0.9169, 0.0642), (0.265, 3.9861), (0.028, 3.7906), (3.4604, 2.7875)],
        [(0.4925, 3.894), (3.9789, 3.7473), (3.7037, 3.9514), (3.8058, 3.3724)],
    ],
)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_curves_that_bounds_stop_at_a_corner_are_motions(tmp_path, rows, scale):
    hand = ((0.1 * scale,) * 3, (0, 0, 0))
    path = write_slider(tmp_path, hand, limits=(0.0, 4.0 * scale))
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(path))
    waypoints = scale * np.array(rows)
    plan = planners.plan(space, waypoints[0], waypoints[-1])
    plan = replace_rows(plan, waypoints)
    trajectory = plan.trajectory(max_velocity=scale, max_acceleration=scale)
    assert trajectory.positions[[0, -1]] == pytest.approx(waypoints[[0, -1]], rel=1e-9)
    assert (np.diff(trajectory.times) > 0.0).all()
    t = np.linspace(-0.01, trajectory.duration + 0.01, 4000)
    velocities = np.diff(trajectory.sample(t)[0], axis=0) / (t[1] - t[0]) / scale
    assert 0.5 < np.abs(velocities).max() < 1.0 + 1e-6
    assert np.abs(np.diff(velocities, axis=0)).max() < (1.0 + 1e-6) * (t[1] - t[0])


def test_curves_without_a_proof_become_stops(monkeypatch):
    plan = build_plan(1, "holonomic", None)
    stopping = plan.trajectory(**LIMITS, blend=False)
    monkeypatch.setattr(
        cspace.CSpace, "_count_free_tubes", lambda *arguments: arguments[-1].fill(0)
    )
    trajectory = plan.trajectory(**LIMITS)
    assert trajectory.certified
    np.testing.assert_array_equal(trajectory.positions, stopping.positions)


def test_curve_passes_outside_a_corner_that_touches_an_obstacle():
    block = shapely.box(2.0, 0.0, 4.0, 4.0)
    workspace = cspace.Workspace.from_shapes([block], SPACING, (0.0, 0.0, 10.0, 10.0))
    space = cspace.build(workspace, cspace.Robot.disc(0.3))
    corner = np.array([1.65, 4.35])
    rows = np.array([(1.0, 1.0), corner, (8.0, 5.0)])
    plan = planners.plan(space, rows[0], rows[-1])
    plan = replace_rows(plan, rows)
    trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
    positions, velocities, _ = sample_evenly(trajectory, 2001)
    nearest = np.linalg.norm(positions - corner, axis=1).argmin()
    assert 0.0 < (positions[nearest] - corner) @ (-1.0, 1.0) < 0.05
    assert np.linalg.norm(velocities[nearest]) > 0.3


def test_small_lateral_limit_slows_a_differential_drive():
    plan = build_plan(1, "differential", 36)
    limits = LIMITS | TURNING_LIMITS
    slow = make_drive("differential", max_lateral_acceleration=0.1)
    trajectory = dataclasses.replace(plan, drive=slow).trajectory(**limits)
    _, velocities, _ = sample_evenly(trajectory, 2001)
    lateral = np.linalg.norm(velocities[:, :2], axis=1) * np.abs(velocities[:, 2])
    assert lateral.max() <= SLACK * 0.1


def make_curves(starts, rates, bends, twists, signs=0, lengths=1.0):
    """Return cubic curves, with a free yaw or, if a sign is given, with that of driving."""
    count = len(starts)
    signs, lengths = np.full(count, signs, dtype=np.int64), np.broadcast_to(lengths, count) + 0.0
    return Segments(starts, rates, bends, twists, np.zeros(count), signs, lengths, starts)


def draw_curves(rng, count, drives):
    """Draw cubic curves in the plane from the origin."""
    yaws = rng.uniform(-math.pi, math.pi, count)
    rates = np.column_stack([np.cos(yaws), np.sin(yaws), rng.uniform(-1.0, 1.0, count)])
    bends = rng.uniform(-1.5, 1.5, (count, 3))
    twists = rng.uniform(-2.0, 2.0, (count, 3))
    if drives:
        for coefficients in (rates, bends, twists):
            coefficients[:, 2] = 0.0
    return make_curves(np.zeros((count, 3)), rates, bends, twists, drives)


@pytest.mark.parametrize("drives", [0, 1, -1], ids=["free yaw", "ahead", "reverse"])
def test_bounds_of_derivatives_contain_all_derivatives(drives):
    rng = np.random.default_rng(3)
    curves = draw_curves(rng, 3000, drives)
    rotations = cspace.Rotations.of(1)
    begins = rng.uniform(0.0, 1.0, 3000)
    widths = rng.choice([0.01, 0.1, 0.5], 3000)
    rates, bends = bound_derivatives(curves, begins, widths)
    most_rates = np.zeros_like(rates)
    most_bends = np.zeros_like(bends)
    for share in np.linspace(0.0, 1.0, 201):
        _, rate, bend = place_along(curves, rotations, begins + share * widths)
        most_rates = np.maximum(most_rates, np.abs(rate))
        most_bends = np.maximum(most_bends, np.abs(bend))
    assert (most_rates <= rates * (1.0 + 1e-9)).all()
    assert (most_bends <= bends * (1.0 + 1e-9)).all()
    narrow = widths == 0.01
    assert np.median(rates[narrow] / most_rates[narrow]) < 1.001
    assert np.median(bends[narrow] / most_bends[narrow]) < 1.1


def test_direction_of_a_curve_that_turns_back_has_no_bounds():
    # Its derivative passes zero in the middle, where the yaw jumps by half a turn.
    rates = np.array([[1.0, 0.0, 0.0]])
    curve = make_curves(np.zeros((1, 3)), rates, -2.0 * rates, 0.0 * rates, 1)
    bounds, _ = bound_derivatives(curve, np.zeros(1), np.ones(1))
    assert bounds[0, 2] > 1e50


def check_proofs(space, curves, least_share, by_edges=False):
    """Check that proven curves are free at 300 places, and that a share of the free ones is proven."""
    shares = np.linspace(0.0, 1.0, 300)
    places = [place_along(curves, space.rotations, share * curves.lengths)[0] for share in shares]
    are_free = np.asarray(space.is_free(np.stack(places, axis=1))).all(axis=1)
    proven = prove_segments(space.exact if by_edges else space, curves)
    assert not (proven & ~are_free).any()
    assert np.count_nonzero(proven) > least_share * np.count_nonzero(are_free)
    assert np.count_nonzero(~are_free) > 20
    return proven, places


@pytest.mark.parametrize("drives", [0, 1, -1], ids=["free yaw", "ahead", "reverse"])
def test_proven_curves_pass_free_cells_only(drives):
    rng = np.random.default_rng(5)
    occupied = rng.random((200, 200)) < 0.002
    workspace = cspace.Workspace.from_array(occupied, SPACING)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.9, 0.02), rotations=36)
    count = 1000
    starts = space.sample_free(count, rng=rng)
    yaws = starts[:, 2] + (math.pi if drives < 0 else 0.0)
    rates = np.column_stack([np.cos(yaws), np.sin(yaws), np.zeros(count)])
    lengths = rng.uniform(0.1, 0.4, count)
    bends = rng.uniform(-1.5, 1.5, (count, 3))
    twists = rng.uniform(-2.0, 2.0, (count, 3))
    check_proofs(space, make_curves(starts, rates, bends, twists, drives, lengths), 0.65)


def test_proven_curves_of_a_body_that_turns_about_any_axis_pass_free_cells_only():
    rng = np.random.default_rng(5)
    workspace = cspace.Workspace.from_array(rng.random((30, 30, 30)) < 0.002, 0.1)
    robot = cspace.Robot.box((0.6, 0.2, 0.1))
    space = cspace.build(workspace, robot, rotations=cspace.Rotations.quaternions(4))
    count = 1000
    starts = space.sample_free(count, rng=rng)
    rates, bends, twists = rng.uniform(-1.0, 1.0, (3, count, 6))
    rates[:, :3] *= 0.1
    rates[:, 3:] *= 2.0
    check_proofs(space, make_curves(starts, rates, bends, twists, 0, 0.5), 0.5)


def test_a_curve_that_turns_on_and_on_is_proven_the_way_it_turns():
    space = cspace.build(
        cspace.Workspace.from_array(np.zeros((40, 8), dtype=bool), SPACING),
        cspace.Robot.rectangle(0.9, 0.02),
        rotations=36,
    )
    starts = np.array([[1.0, 0.2, 0.0]])
    bends = np.array([[1e-9, 0.0, 0.0]])
    # At the ends of the first pieces the robot is parallel to the walls, which it does not fit across.
    pieces = MAX_PIECES + 1
    for turn, is_free in ((0.0, True), (2.0 * math.pi * pieces, False)):
        rates = np.array([[0.0, 0.0, turn]])
        curve = make_curves(starts, rates, bends, 0.0 * bends)
        assert prove_segments(space, curve)[0] == is_free


def test_proven_curves_that_gain_speed_pass_free_cells_only():
    rng = np.random.default_rng(1)
    occupied = rng.random((200, 200)) < 0.1
    workspace = cspace.Workspace.from_array(occupied, SPACING)
    space = cspace.build(workspace, cspace.Robot.disc(0.01))
    count = 20_000
    starts = space.sample_free(count, rng=rng)
    # Along the axes, where pieces fill the boxes that prove them.
    directions = np.eye(2)[rng.integers(0, 2, count)]
    rates = directions * rng.uniform(-1.0, 1.0, (count, 1))
    bends = rates * rng.uniform(-10.0, 10.0, (count, 1))
    lengths = rng.uniform(0.05, 0.4, count)
    check_proofs(space, make_curves(starts, rates, bends, 0.0 * bends, 0, lengths), 0.4)


def test_curves_of_an_arm_are_proven_only_if_all_their_points_are_free():
    space = space_of()
    rng = np.random.default_rng(0)
    count = 300
    starts = space.sample_free(count, rng=rng)
    starts *= 0.5
    rates = rng.uniform(-0.8, 0.8, (count, 2))
    bends = rng.uniform(-2.0, 2.0, (count, 2))
    curves = make_curves(starts, rates, bends, -bends)
    proven, places = check_proofs(space, curves, 0.8, True)
    meets = planar_arm_meets(np.concatenate(places[::6]), [POST]).reshape(-1, count).any(axis=0)
    assert not (proven & meets).any()
    assert 20 < np.count_nonzero(meets) < 280


def test_curves_of_an_arm_are_proven_again_where_nothing_changed(tmp_path):
    endless = {"kind": "continuous", "limits": None}
    arm = cspace.Arm.from_urdf(planar(tmp_path, elbow=endless, **endless))
    space = cspace.build_arm_space(
        {"post": posed_box((0.2394, 0.2394, 0.3), -1.1169, -0.4193)}, arm
    )
    rows = np.array(
        [
            (-2.8236, -2.1832),
            (-2.8223, -2.1859),
            (-2.8187, -2.1876),
            (-1.8202, -2.0983),
            (-1.7254, -2.0456),
            (-1.6928, -2.0175),
            (-1.6533, -1.9469),
            (-2.1724, -0.072),
            (-2.1836, -0.0337),
            (-2.2802, 0.2984),
        ]
    )
    plan = planners.plan(space, rows[0], rows[-1])
    plan = replace_rows(plan, rows)
    trajectory = plan.trajectory(max_velocity=1.47, max_acceleration=0.56)
    assert trajectory.recheck(space).all()


def test_differential_drive_stops_before_it_turns_on_the_spot():
    # Blends that shrank to nothing had curvatures of 1e11 per metre, next to which every jump of
    # the velocity seemed to be rounding.
    trajectory = build_plan(18, "differential", 36).trajectory(**LIMITS, **TURNING_LIMITS)
    t = np.linspace(0.0, trajectory.duration, 20001)
    velocities = trajectory.sample(t)[1]
    largest = np.linalg.norm(np.diff(velocities[:, :2], axis=0), axis=1).max() / t[1]
    assert largest <= SLACK * 0.8


def test_quaternions_beside_blends_never_jump_to_their_negative():
    occupied = np.zeros((20, 20, 20), dtype=bool)
    occupied[8:12, 8:12, :14] = True
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    rotations = cspace.Rotations.quaternions(2)
    space = cspace.build(workspace, cspace.Robot.box((0.3, 0.2, 0.1)), rotations=rotations)
    ends = (0.5, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0), (1.5, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0)
    plan = planners.plan(space, *ends, seed=1, time_limit=5.0)
    waypoints = plan.waypoints.copy()
    waypoints[1::2, 3:] *= -1.0  # the same rotations
    plan = dataclasses.replace(plan, waypoints=waypoints)
    trajectory = plan.trajectory(**LIMITS, **TURNING_LIMITS)
    assert np.abs(np.diff(trajectory.positions[:, 3:], axis=0)).max() < 0.1


@pytest.mark.parametrize("drive", ["differential-reverse", "reeds-shepp"])
def test_commands_replayed_by_a_unicycle_stay_near_the_path(drive):
    plan = build_plan(1, drive, 36)
    limits = make_limits(36, drive)
    trajectory = plan.trajectory(**limits)
    uniform = trajectory.sample_uniform(1000.0)
    assert np.diff(uniform.times) == pytest.approx(1e-3)
    assert uniform.duration - trajectory.duration < 1e-3
    assert uniform.positions[-1] == pytest.approx(trajectory.positions[-1], abs=1e-9)
    x, y, yaw = uniform.positions[0]
    errors = []
    for row, v, omega in zip(uniform.positions, uniform.v, uniform.omega, strict=True):
        errors.append(math.hypot(x - row[0], y - row[1]))
        x += 1e-3 * v * math.cos(yaw + 5e-4 * omega)
        y += 1e-3 * v * math.sin(yaw + 5e-4 * omega)
        yaw += 1e-3 * omega
    assert max(errors) < 0.05
    assert (uniform.v < -0.1).any()


def test_steering_angles_are_those_of_the_turning_radius(tmp_path):
    plan = build_plan(1, "reeds-shepp", 36)
    trajectory = plan.trajectory(**LIMITS)
    steering = trajectory.steering(0.4)
    turned = np.unique(np.round(np.abs(steering), 9))
    assert turned == pytest.approx([0.0, math.atan(0.8)], abs=1e-9)
    moving = np.abs(trajectory.v) > 1e-6
    curvatures = trajectory.omega[moving] / trajectory.v[moving]
    assert steering[moving] == pytest.approx(np.arctan(0.4 * curvatures), abs=1e-6)
    file = tmp_path / "drive.csv"
    trajectory.to_csv(file, wheelbase=0.4)
    rows = np.genfromtxt(file, delimiter=",", names=True)
    assert rows["steering"] == pytest.approx(steering)
    assert rows["v"] == pytest.approx(trajectory.v)
    twists = trajectory.to_twists()
    assert [twist.angular.z for twist in twists] == trajectory.omega.tolist()
    assert [twist.linear.x for twist in twists] == trajectory.v.tolist()
