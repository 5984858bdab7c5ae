"""The page of an arm: its links, its tool dragged by a browser's messages, plans and proofs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cspace
from cspace.errors import ConfigurationError, InputError
from cspace.plot.scene import ROBOT_FILL_COLOR, CellClass
from cspace.view._arm_canvas import GHOST_COUNT
from cspace.view._blocks import hex_to_rgb
from tests.helpers.pages import connected, drag, node
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import (
    joint,
    link,
    planar,
    planar_arm,
    pose_at,
    posed_box,
    random_chain,
)
from tests.helpers.waiting import until

pytest.importorskip("viser")

START = np.array([-0.6, 0.9])
GOAL = np.array([2.0, -0.6])


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    mount = joint("mount", "fore", "tool0", at=(1, 0, 0), kind="fixed", limits=None)
    elbow = {"kind": "continuous", "limits": None}
    folder = tmp_path_factory.mktemp("arm")
    return cspace.Arm.from_urdf(planar(folder, link("tool0"), mount, elbow=elbow))


@pytest.fixture
def space(arm):
    return cspace.build_arm_space({"post": posed_box((0.2, 0.2, 1.0), 1.55, 0.6)}, arm)


@pytest.fixture
def viewer(space):
    with space.view(block=False, port=0, start=START, goal=GOAL) as viewer:
        viewer.page.panel.time_limit.value = 30.0
        assert viewer.page.wait(600.0)
        yield viewer


def elbow_at(q):
    return np.array([math.cos(q[0]), math.sin(q[0]), 0.0])


def tip_at(q):
    return elbow_at(q) + elbow_at([sum(q)])


def find_center(handle):
    """Return the mean corner of a posed mesh."""
    turn = Rotation.from_quat(handle.wxyz, scalar_first=True)
    return np.asarray(turn.apply(handle.vertices).mean(axis=0) + handle.position)


def plan_to(viewer, pose):
    """Drag the tool to a pose and release it."""
    viewer.page.drag(pose)
    viewer.page.release()
    assert viewer.page.wait(600.0)


# ---- the scene -----------------------------------------------------------------------------------


def test_links_follow_the_joints(viewer):
    moved = np.array([0.3, 0.7])
    viewer.page.move(moved)
    for name, q in (("robot", moved), ("start", START), ("goal", GOAL)):
        center = (elbow_at(q) + tip_at(q)) / 2
        np.testing.assert_allclose(find_center(node(viewer, f"/{name}/fore")), center, atol=1e-6)
    assert node(viewer, "/robot/foot") and not node(viewer, "/goal/foot")
    post = node(viewer, "/obstacles/post")
    np.testing.assert_allclose(find_center(post), (1.55, 0.6, 0.0), atol=1e-6)


@pytest.mark.parametrize(
    "q, text, color",
    [
        (START, "**FREE**", ROBOT_FILL_COLOR),
        ((0.35, 0.0), "**BLOCKED**", CellClass.COLLIDES.color),
    ],
)
def test_the_page_shows_state_and_closest_pair(space, viewer, q, text, color):
    viewer.page.move(np.array(q))
    assert viewer.page.wait(600.0)
    content = viewer.page.panel.state.content
    contact = space.closest(q)
    assert content.startswith(text) and "closest pair: fore and post" in content
    if contact.distance:
        assert content.endswith(f"at least {contact.distance:.3f} m apart: proven")
    assert tuple(node(viewer, "/robot/fore").color) == hex_to_rgb(color)
    np.testing.assert_allclose(node(viewer, "/contact").points[0], contact.points, atol=1e-6)


def test_a_page_given_a_start_alone_shows_no_goal_until_one_is_set(space):
    with space.view(block=False, port=0, start=START) as viewer:
        page = viewer.page
        page.move(np.array([0.3, 0.7]))
        assert page.wait(600.0)
        goal = [node(viewer, "/goal/fore"), node(viewer, "/goal/label")]
        assert node(viewer, "/start/fore").visible and not any(part.visible for part in goal)
        assert page.panel.proof.content == "Set a goal below, or drag the tool."
        page.set_endpoint("goal", START + 0.1)
        assert page.wait(600.0)
        assert all(part.visible for part in goal)
        assert page.panel.proof.content == "**The straight motion is free: proven.**"


def test_refresh_draws_the_scene_as_it_is_now(space, viewer, caplog):
    scan = np.random.default_rng(0).uniform((-2.0, -2.0, 0.3), (2.0, 2.0, 0.5), (1000, 3))
    q = np.array([0.3, 0.7])
    viewer.page.move(q)
    space.remove_obstacle("post")
    space.add_obstacle("scan", scan, radius=0.02)
    space.attach("ball", cspace.Robot.ball(0.1), "fore", pose_at(1.0, 0.0))
    viewer.refresh()
    assert viewer.page.wait(600.0)
    assert not node(viewer, "/obstacles/post")
    cloud = node(viewer, "/obstacles/scan")
    np.testing.assert_allclose(cloud.points, scan, atol=1e-6)
    assert cloud.point_size == pytest.approx(0.02)
    np.testing.assert_allclose(find_center(node(viewer, "/robot/ball")), tip_at(q), atol=1e-6)
    assert "and scan" in viewer.page.panel.state.content
    space.detach("ball")
    for shoulder in np.linspace(0.0, 0.4, 20):  # the arm moves while it is drawn again
        viewer.refresh()
        viewer.page.move(np.array([shoulder, 0.7]))
    assert viewer.page.wait(600.0)
    assert not node(viewer, "/robot/ball") and not node(viewer, "/start/ball")
    assert not caplog.records


def test_sliders_stay_within_the_limits():
    arm = planar_arm(kind="prismatic", limits=(-0.2501, 0.4))
    with cspace.build_arm_space({}, arm).view(block=False, port=0) as viewer:
        canvas = viewer.canvas
        slide, turn = canvas.dials
        assert tuple(slide) == ("shoulder (m)", -0.25, 0.4, 0.001)
        assert -np.degrees(3.0) <= turn.low < turn.high <= np.degrees(3.0)
        np.testing.assert_allclose(canvas.configuration_of((0.4, 90.0)), (0.4, math.pi / 2))
        assert (canvas.configuration_of((0.4000001, 0.0)) <= arm.upper).all()


# ---- plans and the tool --------------------------------------------------------------------------


def test_a_plan_is_drawn_as_the_path_of_the_tool_and_pale_arms(viewer):
    page = viewer.page
    page.search()
    assert page.wait(600.0)
    assert viewer.plan is not None and viewer.plan.certified
    assert "certified" in page.panel.answer.content
    path = viewer.plan.path
    points = np.asarray(node(viewer, "/path").points)
    ends = points[[0, -1], [0, 1]]
    np.testing.assert_allclose(ends, [tip_at(START), tip_at(GOAL)], atol=1e-6)
    lengths = np.insert(np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum(), 0, 0.0)
    ghosts = node(viewer, "/ghosts/fore").batched_positions
    assert len(ghosts) == GHOST_COUNT
    for number, position in enumerate(ghosts, start=1):
        length = lengths[-1] * number / (GHOST_COUNT + 1)
        q = [np.interp(length, lengths, column) for column in path.T]
        np.testing.assert_allclose(position, elbow_at(q), atol=1e-6)
    page.drag(pose_at(0.0, 1.5))  # a drag removes the old plan
    assert not node(viewer, "/ghosts/fore") and not node(viewer, "/path")
    assert page.wait(600.0)


def test_a_tool_dragged_in_a_browser_is_followed_and_planned_to(viewer):
    page = viewer.page
    tool = viewer.canvas.tool
    assert (tool.name, tool.position_only) == ("tool0", True)  # two joints reach a position alone
    np.testing.assert_allclose(node(viewer, "/tool").position, tip_at(START), atol=1e-9)
    target = (0.2, 1.5, 0.0)
    *moves, release = drag("/tool", [pose_at(1.4, 0.0), pose_at(*target, (0.0, 0.0, 2.0))])
    with connected(viewer) as send:
        for message in moves:
            send(message)
        until(lambda: np.allclose(tip_at(viewer.canvas.robot), target, atol=2e-4))
        assert page.wait(600.0)
        assert page.panel.tool.content == "**Reached**, proven free."
        assert page.plan is None
        send(release)
        until(lambda: page.plan is not None)
    assert page.wait(600.0)
    plan = page.plan
    assert plan.certified and not tool.is_held
    np.testing.assert_allclose(plan.path[0], START)
    np.testing.assert_allclose(tip_at(plan.path[-1]), target, atol=2e-4)
    np.testing.assert_allclose(viewer.canvas.robot, plan.path[-1], atol=1e-9)
    np.testing.assert_allclose(node(viewer, "/tool").position, target, atol=2e-4)
    np.testing.assert_allclose(page.endpoints["goal"], plan.goal)
    plan_to(viewer, pose_at(1.4, -0.6))  # begins where the last plan ended
    assert page.plan is not plan and page.plan is not None
    np.testing.assert_allclose(page.plan.path[0], plan.path[-1], atol=1e-9)


def test_poses_that_cannot_be_planned_to_are_shown_with_the_reason(viewer):
    page = viewer.page
    for y in (-2.5, -3.0):
        plan_to(viewer, pose_at(0.0, y))
        np.testing.assert_allclose(tip_at(viewer.canvas.robot), (0.0, -2.0, 0.0), atol=1e-3)
        assert page.panel.tool.content.startswith("**Not reached**")
        assert f"reached is {-2.0 - y:.3g} m away" in page.panel.tool.content
        assert "**Not done:** goal is out of reach" in page.panel.answer.content
        np.testing.assert_array_equal(page.endpoints["start"], START)  # no plan has moved the arm
    plan_to(viewer, pose_at(1.55, 0.6))
    assert page.panel.tool.content == "**Reached**, but not proven free."
    assert "fore is in collision with post" in page.panel.answer.content
    plan_to(viewer, pose_at(0.2, 1.5))
    assert page.plan is not None and page.plan.certified
    np.testing.assert_allclose(page.plan.path[0], START)


def test_a_free_configuration_at_the_pose_is_preferred(arm):
    # The block holds the elbow of the nearer of the two configurations.
    blocked = cspace.build_arm_space({"block": posed_box((0.2, 0.2, 0.2), 0.6, -0.8)}, arm)
    with blocked.view(block=False, port=0, start=START) as viewer:
        viewer.page.drag(pose_at(1.2, 0.0))
        assert viewer.page.wait(600.0)
        assert viewer.page.panel.tool.content == "**Reached**, proven free."
        np.testing.assert_allclose(elbow_at(viewer.canvas.robot), (0.6, 0.8, 0.0), atol=1e-3)


def test_users_choose_the_frame_and_six_joints_follow_its_rotation(tmp_path):
    arm = cspace.Arm.from_urdf(random_chain(tmp_path, 1, 6))
    with cspace.build_arm_space({}, arm).view(block=False, port=0, frame="l6") as viewer:
        page = viewer.page
        assert (viewer.canvas.tool.name, viewer.canvas.tool.position_only) == ("l6", False)
        assert not node(viewer, "/tool").disable_rotations
        pose = arm.pose(page.endpoints["goal"], "l6")
        page.drag(pose)
        assert page.wait(600.0)
        assert page.panel.tool.content.startswith("**Reached**")
        np.testing.assert_allclose(arm.pose(viewer.canvas.robot, "l6"), pose, atol=1e-3)


@refusals(
    "error, options, message",
    (ConfigurationError, {"goal": (4.0, 0.0)}, "goal has shoulder at 4"),
    (InputError, {"frame": "hand"}, "frame is 'hand'"),
    (InputError, {"frame": "foot"}, "frame is 'foot'"),
)
def test_view_of_an_arm_refuses_invalid_arguments(space, error, options, message):
    with pytest.raises(error, match=message):
        space.view(block=False, port=0, **options)
