"""What plans, trajectories and spaces of arms hand out means the same when it goes in again."""

import numpy as np
import pytest

import cspace
import planners
from tests.helpers.urdfs import planar_arm, post


def limits_of(plan):
    """Return limits of all coordinates of a plan."""
    turns = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}
    limits = {"max_velocity": 1.0, "max_acceleration": 1.0}
    return limits | (turns if "yaw" in plan.axes else {})


@pytest.fixture(scope="module", params=["plane", "yaw", "arm", "joint map"])
def plan(request):
    """Plan in a space of each kind."""
    if request.param in ("plane", "yaw"):
        cells = np.zeros((60, 50), dtype=bool)
        cells[28:31, :35] = True
        workspace = cspace.Workspace.from_array(cells, 0.1, (2.0, -1.0))
        rotations = 36 if request.param == "yaw" else None
        space = cspace.build(workspace, cspace.Robot.rectangle(0.6, 0.3), rotations=rotations)
        turn = () if rotations is None else (3.0,)
        return planners.plan(space, (3.0, 0.0, *turn), (6.5, 0.0, *turn))
    pose = np.array([[0.0, -1.0, 0.0, 0.3], [1.0, 0.0, 0.0, 0.1], [0, 0, 1, 0], [0, 0, 0, 1]])
    placed = post()
    obstacles = {"post": type(placed)(placed.shape, pose @ placed.pose)}
    space = cspace.build_arm_space(obstacles, planar_arm(), base_pose=pose)
    if request.param == "joint map":
        space = cspace.build_joint_map(space, 0.1)
    return planners.plan(space, (-0.5, 0.3), (1.5, -0.4))


def test_ends_and_rows_of_a_plan_are_those_of_its_space(plan):
    assert plan and plan.recheck().all()
    assert plan.space.is_free(plan.path).all() and plan.space.certify_path(plan.path).all()
    for start, goal in ((plan.start, plan.goal), plan.path[[0, -1]], (plan.goal, plan.start)):
        again = planners.plan(plan.space, start, goal)
        np.testing.assert_array_equal([again.start, again.goal], [start, goal])
        assert abs(again.length - plan.length) <= 0.02 * plan.length


def test_a_plan_is_followed_from_any_of_its_rows(plan):
    for row in plan.path[:-1]:
        again = planners.plan(plan.space, row, plan.goal, previous=plan)
        assert again and again.length <= 1.001 * plan.length


def test_rows_of_a_trajectory_pass_the_gate_with_its_limits(plan):
    trajectory = plan.trajectory(**limits_of(plan))
    positions = trajectory.positions
    assert plan.space.certify_path(positions).all()
    sampled = trajectory.sample_uniform(50.0)
    # A row's mean velocity may lie above the velocities at its ends, but not above all of those between.
    dense = trajectory.sample_uniform(5000.0)
    limits = np.abs(dense.velocities).max(axis=0) + 1.0 / 5000.0
    gate = cspace.Gate(plan.space, dt=0.02, max_velocity=limits)
    passed = gate.check_rows(sampled.positions[0], sampled.positions[1:])
    assert passed.state == "go", passed.chunk.refusal
    stop = trajectory.braked(0.5 * trajectory.duration)
    onward = planners.plan(plan.space, stop.positions[-1], plan.goal)
    np.testing.assert_array_equal(onward.start, stop.positions[-1])


def test_messages_of_a_plan_hold_its_poses(plan):
    if plan.space.has_poses:
        poses = plan.to_path().poses
        read = [cspace.ros.configuration_of(pose, plan.space) for pose in poses]
        np.testing.assert_allclose(read, plan.path, atol=1e-12)
    else:
        points = plan.trajectory(**limits_of(plan)).to_joint_trajectory().points
        assert plan.space.certify_path([point.positions for point in points]).all()
