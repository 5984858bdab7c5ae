"""Motions of arms along straight lines, against other forward kinematics and collisions."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from cspace import Arm, ConfigurationError, InputError, Robot, build_arm_space
from cspace.arms import LineMotion, PosedShape
from cspace.arms._inverse import make_pose_problem, make_pose_scratch
from cspace.arms._paths.lines import LineProblem, bound_deviation, make_lines
from tests.helpers.arm_oracle import ArmOracle
from tests.helpers.solids import box
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import (
    draw_chain,
    joint,
    link,
    place_link,
    pose_at,
    posed_box,
    write_slider,
    write_urdf,
)

Poses = Callable[[np.ndarray], np.ndarray]
"""Poses of a frame, shape (..., 4, 4), at configurations, shape (..., dof), by other code."""

ROUNDING = 1e-11
"""Metres and radians by which two libraries may differ."""


def sample_motion(waypoints, times):
    """Return configurations on the motions between waypoints, shape (n - 1, times, dof)."""
    return waypoints[:-1, None] + times[:, None] * np.diff(waypoints, axis=0)[:, None]


def sample_deviation(motion, poses, samples=33):
    """Return the largest distance and angle between the frame and its target, at samples."""
    times = np.linspace(0.0, 1.0, samples)
    distances = [0.0]
    angles = [0.0]
    rows = sample_motion(motion.path, times)
    for number, row in enumerate(rows):
        first, last = motion.parameters[number : number + 2]
        line = min(int(first), len(motion.poses) - 2)
        shares = (first + times * (last - first) - line).clip(0.0, 1.0)
        start, stop = motion.poses[line : line + 2]
        targets = start[:3, 3] + shares[:, None] * (stop - start)[:3, 3]
        turns = Slerp([0.0, 1.0], Rotation.from_matrix([start[:3, :3], stop[:3, :3]]))(shares)
        reached = poses(row)
        distances.append(np.linalg.norm(reached[:, :3, 3] - targets, axis=-1).max())
        apart = Rotation.from_matrix(reached[:, :3, :3]).inv() * turns
        angles.append(apart.magnitude().max())
    return float(max(distances)), float(max(angles))


def check_motion(motion, arm, poses, tolerance):
    """Assert that a motion keeps its promises, except those on collisions."""
    deviation, angle = sample_deviation(motion, poses)
    assert deviation - ROUNDING <= motion.deviation <= tolerance[0]
    assert angle - ROUNDING <= motion.angle <= tolerance[1]
    assert ((motion.path >= arm.lower) & (motion.path <= arm.upper)).all()
    parameters = motion.parameters
    assert parameters[0] == 0.0 and (np.diff(parameters) > 0.0).all()
    # Each pose that it reaches is a waypoint.
    assert set(range(int(parameters[-1]) + 1)) <= set(parameters.tolist())
    ends = parameters[-1] == len(motion.poses) - 1
    assert motion.certified == ends == (motion.fraction == 1.0) == (not motion.stopped_by)
    if not motion.certified:
        assert motion.stopped_by in {"collision", "limit", "reach", "jump"}
        assert f"before poses[{int(parameters[-1])}]" in motion.status


@examples(20)
@given(
    seed=seeds,
    count=st.integers(2, 7),
    tolerance=st.sampled_from(
        [(1e-3, 1e-2), (1e-4, 1e-3), (0.03, 0.3), (1e-3, math.inf), (math.inf, 1e-2)]
    ),
)
def test_motions_stay_within_their_bounds_and_free(tmp_path_factory, seed, count, tolerance):
    rng, path, arm = draw_chain(tmp_path_factory, seed, count)
    poses = partial(place_link, path, arm, "tool0")
    shapes = {}
    still = {}
    for name in ("block 0", "block 1", "block 2"):
        sides = rng.uniform(0.05, 0.2, 3)
        pose = pose_at(*rng.uniform(-0.8, 0.8, 3), rng.normal(size=3))
        shapes[name] = PosedShape(Robot.box(sides).shape, pose)
        still[name] = [box(sides, pose[:3, 3], pose[:3, :3])]
    try:
        space = build_arm_space(shapes, arm)
        start = space.sample_free(rng=rng)
    except ConfigurationError:
        assume(False)
    steps = rng.choice([0.1, 0.4]) * rng.normal(size=(rng.integers(1, 4), arm.dof))
    corners = poses((start + np.cumsum(steps, axis=0)).clip(arm.lower, arm.upper))
    if rng.random() < 0.5:
        corners[:, :3, 3] += rng.normal(scale=0.15, size=(len(corners), 3))
    motion = space.follow_line(start, "tool0", corners, tolerance=tolerance)
    np.testing.assert_array_equal(motion.path[0], start)
    np.testing.assert_allclose(motion.poses, [poses(start), *corners], atol=1e-6)
    check_motion(motion, arm, poses, tolerance)
    oracle = ArmOracle(path, arm, still, arm.allowed_collisions)
    rows = sample_motion(motion.path, np.linspace(0.0, 1.0, 8)).reshape(-1, arm.dof)
    assert all(oracle.apart(row) > 0.0 for row in rows[:: 1 + len(rows) // 100])
    assert np.asarray(space.certify_path(motion.path)).all()


@examples(25)
@given(seed=seeds, count=st.integers(1, 7), size=st.sampled_from([0.01, 0.1, 0.4]))
def test_bounds_hold_for_lines_tangent_to_the_motion(tmp_path_factory, seed, count, size):
    """Halfway, frame and target coincide and move alike, so that accelerations alone are left."""
    rng, path, arm = draw_chain(tmp_path_factory, seed, count)
    poses = partial(place_link, path, arm, "tool0")
    center = rng.uniform(*arm._ranges())
    step = size * rng.uniform(-1.0, 1.0, arm.dof)
    before, middle, after = poses(center + 1e-5 * step * np.array([[-1.0], [0.0], [1.0]]))
    velocity = (after - before)[:3, 3] / 2e-5
    spin = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec() / 2e-5
    assume(np.linalg.norm(spin) < 3.1)
    corners = np.array([middle, middle])
    for corner, time in zip(corners, (-0.5, 0.5), strict=True):
        corner[:3, 3] += time * velocity
        corner[:3, :3] = Rotation.from_rotvec(time * spin).as_matrix() @ corner[:3, :3]
    waypoints = center + step * np.array([[-0.5], [0.5]])
    branch, tool = arm._branch_to("tool0")
    pose = make_pose_problem(branch, tool, np.eye(4), np.ones(2), (arm.lower, arm.upper))
    (line,) = make_lines(corners)
    problem = LineProblem(line, pose, make_pose_scratch(branch), branch.joints, np.ones(2), 10.0)
    bounds, _ = bound_deviation(problem, (waypoints[0], waypoints[1]), 0.0, 1.0, 1)
    motion = LineMotion("tool0", corners, waypoints, np.arange(2.0), False, 0.0, *bounds, "", "")
    # Differences give the velocities up to 1e-9.
    assert (np.array(sample_deviation(motion, poses)) <= bounds + 1e-8).all()


def polar(folder, **shapes):
    """Build a bar that turns about the origin and slides out by up to 1 m, with the frame hand."""
    path = write_urdf(
        folder,
        link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.5))),
        link("arm"),
        link("hand", ((0.02, 0.02, 0.02), (0, 0, 0))),
        joint("turn", "foot", "arm"),
        joint("slide", "arm", "hand", axis=(1, 0, 0), kind="prismatic", limits=(0.0, 1.0)),
    )
    return build_arm_space(shapes, Arm.from_urdf(path))


@pytest.fixture(scope="module")
def open_polar(tmp_path_factory):
    return polar(tmp_path_factory.mktemp("polar"))


SQUARE_ROOT = math.sqrt(0.96)
"""Distance that the hand reaches along x, 0.2 m beside the axis."""


@pytest.mark.parametrize(
    "poses, tolerance, stopped_by, fraction, status",
    [
        (
            [pose_at(0.5, 0.2), pose_at(1.5, 0.2)],
            (1e-3, math.inf),
            "limit",
            (0.2 + SQUARE_ROOT - 0.5) / 1.2,
            "m and 0 rad before poses[1]: slide is at its limit of 1 m",
        ),
        # Beside the axis, the bar would have to turn by half a turn within a hair's breadth.
        (
            [pose_at(0.5, 1e-4), pose_at(-0.5, 1e-4)],
            (1e-6, math.inf),
            "jump",
            0.5,
            "as at a singularity",
        ),
    ],
)
def test_stops_are_explained(tmp_path, poses, tolerance, stopped_by, fraction, status):
    block = posed_box((0.1, 0.1, 0.1), 0.5, 0.3)
    motion = polar(tmp_path, block=block).follow_line(
        (0.0, 0.5), "hand", poses, tolerance=tolerance
    )
    assert motion.stopped_by == stopped_by and status in motion.status
    assert motion.fraction == pytest.approx(fraction, abs=0.02)


@pytest.fixture(scope="module")
def gantry(tmp_path_factory):
    """Return a hand that slides along x and y."""
    hand = ((0.02, 0.02, 0.02), (0, 0, 0))
    return Arm.from_urdf(write_slider(tmp_path_factory.mktemp("gantry"), hand, limits=(-1, 1)))


@examples(25)
@given(seed=seeds, thickness=st.sampled_from([0.002, 0.05]))
def test_a_gantry_stops_where_it_hits_the_first_box(gantry, seed, thickness):
    rng = np.random.default_rng(seed)
    centers = rng.uniform(-0.6, 0.6, (3, 2))
    sides = rng.permuted([[thickness, 0.3, 0.1]] * 3, axis=1)
    start, goal = rng.uniform(-0.9, 0.9, (2, 2))
    boxes = {f"box {k}": posed_box(sides[k], *centers[k]) for k in range(3)}
    space = build_arm_space(boxes, gantry)
    assume(space.is_free(start))
    motion = space.follow_line(start, "hand", pose_at(*goal))
    # The line enters a box, grown by half a hand, where it has crossed the nearer side on both axes.
    half = 0.5 * (sides[:, :2] + 0.02)
    crossings = (np.array([centers - half, centers + half]) - start) / (goal - start)
    enters = crossings.min(axis=0).max(axis=1)
    leaves = crossings.max(axis=0).min(axis=1)
    hits = enters[(enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0)]
    assert motion.stopped_by == ("collision" if len(hits) else "")
    assert motion.fraction == pytest.approx(hits.min(initial=1.0), abs=2e-4)


SIZES = st.sampled_from([0.0, 1e-320, 1e-15, 1e-9, 0.1, 1e8, 1e80, 1e154, 1e300, math.inf])
"""Metres and radians from rounding errors to overflow."""


@example(steps=[(0.0, 0.0), (0.0, 0.0)], tolerance=(4.2e-12, 4.2e-12))
@example(steps=[(1e300, 0.0), (-1e300, 0.0)], tolerance=(math.inf, 3.0))
@given(
    steps=st.lists(st.tuples(SIZES, SIZES | st.floats(-1.0, 1.0)), min_size=1, max_size=3),
    tolerance=st.tuples(SIZES | st.floats(1e-13, 1e-9), SIZES | st.floats(1e-13, 1e-9)),
)
@examples(60)
def test_extreme_lines_are_refused_or_followed_in_part(open_polar, steps, tolerance):
    arm = open_polar.arm
    corners = np.array([arm.pose((0.3, 0.4), "hand")] * len(steps))
    with np.errstate(all="ignore"):
        corners[:, :2, 3] += np.cumsum(steps, axis=0)
    try:
        motion = open_polar.follow_line((0.3, 0.4), "hand", corners, tolerance=tolerance)
    except InputError:
        size = 1.0 + float(np.abs(corners[:, :3, 3]).max())
        too_small = min(tolerance) <= 0.0 or tolerance[0] < 1e-11 * size or tolerance[1] < 1e-11
        too_wide = math.pi < tolerance[1] < math.inf  # as in degrees
        assert too_small or too_wide or math.isinf(min(tolerance)) or not size < 1e100
        return
    if max(tolerance) < 1e9:
        check_motion(motion, arm, lambda q: arm.pose(q, "hand"), tolerance)
