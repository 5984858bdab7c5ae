"""Blends of trajectories: proofs, limits, continuity and refusals.

Oracles: shapely places the robot among the occupied cells, positions are differenced, and an arm's
configurations are tested one by one.
"""

import dataclasses
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import affinity

import cspace
import planners
from cspace import InputError
from cspace.arms import Arm, build_arm_space
from cspace.interface import rotations_of
from planners.blends import (
    DrivingTurns,
    LimitRates,
    MotionBounds,
    Segments,
    place_along,
    prove_blends,
    round_corners,
)
from tests.helpers.urdfs import planar, post

FOOTPRINT = [(-0.4, -0.2), (0.4, -0.2), (0.4, 0.2), (-0.4, 0.2)]
LIMITS: dict[str, Any] = {"max_velocity": 1.2, "max_acceleration": 0.8}
TURNING_LIMITS: dict[str, Any] = {"max_angular_velocity": 1.0, "max_angular_acceleration": 2.0}
SPACING = 0.05
SLACK = 1.01


def draw_occupied(seed: int) -> np.ndarray:
    """Draw a plane with rectangles of occupied cells."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros((140, 120), dtype=bool)
    for _ in range(14):
        i = rng.integers(0, 130)
        j = rng.integers(0, 110)
        width, height = rng.integers(3, 20, 2)
        occupied[i : i + width, j : j + height] = True
    return occupied


def build_plan(seed: int, drive: str, rotations: int | None) -> planners.Plan:
    """Plan between the two farthest of some free configurations that a path joins."""
    workspace = cspace.Workspace.from_array(draw_occupied(seed), SPACING)
    robot = cspace.Robot.polygon(FOOTPRINT) if rotations else cspace.Robot.disc(0.3)
    space = cspace.build(workspace, robot, rotations=rotations)
    free = space.sample_free(200, rng=np.random.default_rng(seed))
    free = free[np.argsort(free[:, 0])]
    for start, goal in zip(free, free[::-1], strict=True):
        try:
            plan = planners.plan(space, start, goal, drive=drive, time_limit=10.0)
        except cspace.ConfigurationError:  # on the border of a cell
            continue
        if plan.solved:
            return plan
    raise AssertionError("no path found")


def count_collisions(seed: int, rows: np.ndarray) -> int:
    """Count the rows at which the robot overlaps an occupied cell."""
    cells = np.argwhere(draw_occupied(seed)) * SPACING
    tree = shapely.STRtree([shapely.box(x, y, x + SPACING, y + SPACING) for x, y in cells])
    collisions = 0
    for row in rows:
        robot = shapely.Point(0.0, 0.0).buffer(0.299)
        if len(row) == 3:
            turned = affinity.rotate(
                shapely.Polygon(FOOTPRINT), row[2], origin=(0.0, 0.0), use_radians=True
            )
            robot = turned.buffer(-1e-6)
        placed = affinity.translate(robot, row[0], row[1])
        collisions += len(tree.query(placed, predicate="intersects")) > 0
    return collisions


def difference(trajectory: planners.Trajectory, t: np.ndarray, h: float) -> np.ndarray:
    """Return central differences of positions, yaw the shorter way."""
    steps = trajectory.sample(t + h)[0] - trajectory.sample(t - h)[0]
    if steps.shape[1] == 3:
        steps[:, 2] = (steps[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
    return steps / (2.0 * h)


@pytest.mark.parametrize(
    ("drive", "rotations"),
    [("holonomic", None), ("holonomic", 36), ("differential", 36), ("differential-reverse", 36)],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_blended_motion_is_free_smooth_and_within_limits(
    seed: int, drive: str, rotations: int | None
) -> None:
    plan = build_plan(seed, drive, rotations)
    limits = LIMITS | (TURNING_LIMITS if rotations else {})
    trajectory = plan.trajectory(**limits)
    assert trajectory.certified
    assert plan.space is not None
    assert trajectory.recheck(plan.space).all()
    assert trajectory.positions[[0, -1]] == pytest.approx(plan.path[[0, -1]], abs=1e-9)
    assert trajectory.duration <= plan.trajectory(**limits, blend=False).duration
    t = np.linspace(0.0, trajectory.duration, 2001)
    positions, velocities, _ = trajectory.sample(t)
    assert count_collisions(seed, positions[::4]) == 0
    assert difference(trajectory, t, 1e-6) == pytest.approx(velocities, abs=1e-4)
    jumps = trajectory.sample(t + 1e-4)[1] - trajectory.sample(t - 1e-4)[1]
    accelerations = np.abs(jumps) / 2e-4
    assert np.linalg.norm(velocities[:, :2], axis=1).max() <= SLACK * 1.2
    assert np.linalg.norm(accelerations[:, :2], axis=1).max() <= SLACK * 0.8
    if rotations:
        assert np.abs(velocities[:, 2]).max() <= SLACK * 1.0
        assert accelerations[:, 2].max() <= SLACK * 2.0
    if drive != "holonomic":
        yaw = positions[:, 2]
        sideways = np.cos(yaw) * velocities[:, 1] - np.sin(yaw) * velocities[:, 0]
        assert np.abs(sideways).max() < 1e-9


def test_per_axis_limits_hold_on_parabolas() -> None:
    plan = build_plan(1, "holonomic", None)
    trajectory = plan.trajectory(max_velocity=(1.0, 0.4), max_acceleration=(0.3, 0.9))
    t = np.linspace(0.0, trajectory.duration, 2001)
    _, velocities, accelerations = trajectory.sample(t)
    assert (np.abs(velocities).max(axis=0) <= [SLACK, SLACK * 0.4]).all()
    assert (np.abs(accelerations).max(axis=0) <= [SLACK * 0.3, SLACK * 0.9]).all()


def test_robot_passes_a_corner_in_the_open_at_speed_unless_told_to_stop() -> None:
    plan = build_plan(1, "differential", 36)
    limits = LIMITS | TURNING_LIMITS
    blended = plan.trajectory(**limits)
    stopping = plan.trajectory(**limits, blend=False)
    assert blended.duration < 0.95 * stopping.duration
    corners = np.linalg.norm(stopping.velocities, axis=1) == 0.0
    on_edges = stopping.positions[corners]
    for waypoint in plan.waypoints:
        assert np.abs(on_edges[:, :2] - waypoint[:2]).max(axis=1).min() < 1e-9


def test_small_lateral_limit_slows_a_differential_drive() -> None:
    plan = build_plan(1, "differential", 36)
    limits = LIMITS | TURNING_LIMITS
    trajectory = plan.trajectory(**limits, max_lateral_acceleration=0.1)
    t = np.linspace(0.0, trajectory.duration, 2001)
    _, velocities, _ = trajectory.sample(t)
    lateral = np.linalg.norm(velocities[:, :2], axis=1) * np.abs(velocities[:, 2])
    assert lateral.max() <= SLACK * 0.1


def test_obstacle_on_the_curve_is_found_by_recheck() -> None:
    plan = build_plan(1, "holonomic", None)
    trajectory = plan.trajectory(**LIMITS)
    assert plan.space is not None
    space: Any = plan.space
    x, y = trajectory.sample(0.5 * trajectory.duration)[0]
    space.add_obstacle("cart", shapely.box(x - 0.1, y - 0.1, x + 0.1, y + 0.1))
    free = trajectory.recheck(space)
    assert not free.all()
    assert free[0]
    assert not plan.trajectory(**LIMITS).certified


def test_plan_without_map_stops_at_corners() -> None:
    plan = build_plan(1, "holonomic", None)
    pickled = pickle.loads(pickle.dumps(plan))
    stopping = plan.trajectory(**LIMITS, blend=False)
    without_map = pickled.trajectory(**LIMITS)
    assert without_map.certified
    assert without_map.duration == stopping.duration
    assert plan.space is not None
    assert without_map.recheck(plan.space).all()


@pytest.mark.parametrize("seed", range(3))
def test_arm_blends_are_free_and_within_limits(tmp_path: Path, seed: int) -> None:
    space = build_arm_space({"post": post()}, Arm.from_urdf(planar(tmp_path)))
    plan = planners.plan(space, (-0.6, 0.3), (1.4, -0.2), seed=seed, time_limit=5.0)
    trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=2.0)
    t = np.linspace(0.0, trajectory.duration, 2001)
    positions, velocities, accelerations = trajectory.sample(t)
    assert trajectory.certified
    assert np.asarray(space.is_free(positions)).all()
    assert np.abs(velocities).max() <= SLACK
    assert np.abs(accelerations).max() <= SLACK * 2.0
    stopping = plan.trajectory(max_velocity=1.0, max_acceleration=2.0, blend=False)
    assert trajectory.duration <= stopping.duration


def test_parabolas_of_an_arm_are_proven_only_if_all_their_points_are_free(tmp_path: Path) -> None:
    space = build_arm_space({"post": post()}, Arm.from_urdf(planar(tmp_path)))
    rng = np.random.default_rng(0)
    ends = space.sample_free(200, rng=rng).reshape(100, 2, -1)
    starts = ends[:, 0]
    lasts = starts + 0.4 * (ends[:, 1] - starts)
    controls = 0.5 * (starts + lasts) + rng.uniform(-0.4, 0.4, starts.shape)
    controls = controls.clip(-3.0, 3.0)
    proven = space.parabolas_are_free(starts, controls, lasts)
    t = np.linspace(0.0, 1.0, 400)[:, np.newaxis, np.newaxis]
    curves = (1.0 - t) ** 2 * starts + 2.0 * t * (1.0 - t) * controls + t**2 * lasts
    are_free = np.asarray(space.is_free(curves)).all(axis=0)
    assert not (proven & ~are_free).any()
    assert np.count_nonzero(proven) >= 0.8 * np.count_nonzero(are_free)
    assert 10 < np.count_nonzero(are_free) < 95


def test_invalid_arguments_are_refused() -> None:
    plan = build_plan(1, "holonomic", None)
    trajectory = plan.trajectory(**LIMITS)
    workspace = cspace.Workspace.from_array(draw_occupied(1), SPACING)
    space = cspace.build(workspace, cspace.Robot.polygon(FOOTPRINT), rotations=4)
    with pytest.raises(InputError, match="axes"):
        trajectory.recheck(space)
    flag: Any = "yes"
    with pytest.raises(InputError, match="blend"):
        plan.trajectory(**LIMITS, blend=flag)
    for value in (0.0, math.nan, -1.0):
        with pytest.raises(InputError, match="max_acceleration"):
            plan.trajectory(max_velocity=1.0, max_acceleration=value)


@pytest.mark.parametrize("turns", [False, True], ids=["parabolas", "clothoids"])
def test_curves_through_cells_are_proven_only_if_the_robot_stays_free(turns: bool) -> None:
    workspace = cspace.Workspace.from_array(draw_occupied(3), SPACING)
    space = cspace.build(workspace, cspace.Robot.polygon(FOOTPRINT), rotations=36)
    rng = np.random.default_rng(3)
    starts = space.sample_free(150, rng=rng)
    yaws = starts[:, 2]
    rates = np.column_stack([np.cos(yaws), np.sin(yaws), np.zeros(150)])
    none = np.zeros(150)
    lengths = rng.uniform(0.1, 1.2, 150)
    bends = rng.uniform(-1.5, 1.5, (150, 3))
    sharpness = none
    if turns:
        sharpness = bends[:, 2]
        bends[:, :2] = 0.0
    segments = Segments(starts, rates, bends, none, sharpness, lengths, starts)
    proven = prove_blends(space, segments)
    shares = np.linspace(0.0, 1.0, 400)
    places = [place_along(segments, space.rotations, share * lengths)[0] for share in shares]
    curves = np.stack(places, axis=1)
    assert count_collisions(3, curves[proven, ::10].reshape(-1, 3)) == 0
    assert np.asarray(space.is_free(curves[proven])).all()
    assert 20 < np.count_nonzero(proven) < 130
    collides = [count_collisions(3, curve[::10]) > 0 for curve in curves[~proven]]
    assert np.mean(collides) > 0.3


def test_differential_drive_stops_before_it_turns_on_the_spot() -> None:
    # Blends that shrank to nothing had curvatures of 1e11 per metre, next to which every jump of
    # the velocity seemed to be rounding.
    trajectory = build_plan(18, "differential", 36).trajectory(**LIMITS, **TURNING_LIMITS)
    t = np.linspace(0.0, trajectory.duration, 20001)
    velocities = trajectory.sample(t)[1]
    largest = np.linalg.norm(np.diff(velocities[:, :2], axis=0), axis=1).max() / t[1]
    assert largest <= SLACK * 0.8


@pytest.mark.parametrize("count", [8, 10])
def test_corners_without_a_proven_blend_stay_where_they_were(count: int) -> None:
    # A corner that moved stayed there although its blend no longer fitted, and the turns at the
    # last place but one had a corner that does not exist.
    places = [(1.64, 3.82), (2.69, 4.158), (2.892, 4.228), (2.789, 4.229), (3.325, 3.5)]
    yaws = [(0.35, 0.309), (0.309, 0.341), (0.341, -2.319, 3.133), (3.133, 2.206), (2.206, 2.0)]
    rows = [(*xy, yaw) for xy, turns in zip(places, yaws, strict=True) for yaw in turns]
    velocity = LimitRates(np.array(1.2), 0.5, 2)
    acceleration = LimitRates(np.array(5.0), 30.0, 2)
    far = np.full(2, 99.0)
    bounds = MotionBounds(velocity, acceleration, 0.5, -far, far, 0.02, 0.001)
    corners = DrivingTurns(np.array(rows[:count]), rotations_of(("x", "y", "yaw")), bounds)

    def prove(segments: Segments) -> np.ndarray:
        """Prove straight lines between the given places only."""
        curved = segments.bends.any(axis=1) | (segments.curvatures != 0.0)
        ends = np.stack([segments.starts, segments.ends])[:, :, np.newaxis, :2]
        given = (np.abs(ends - np.array(places)) < 1e-9).all(axis=-1).any(axis=-1)
        return ~curved & given.all(axis=0)

    layout, proven = round_corners(corners, prove)
    assert not layout.sizes.any()
    assert proven.all()


def test_quaternions_beside_blends_never_jump_to_their_negative() -> None:
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
