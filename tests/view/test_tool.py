"""The tool frame of an arm on its page: dragged by a browser's messages, planned to, and played."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import cspace
import planners
from cspace.errors import InputError
from cspace.plot.arms import GHOST_COUNT
from cspace.view import Viewer
from tests.helpers.pages import connected, drag, node
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import planar_with_tool, pose_at, pose_of, posed_box, random_chain
from tests.helpers.waiting import until

pytest.importorskip("viser")
pytest.importorskip("yourdfpy")

START = np.array([-0.6, 0.9])


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return planar_with_tool(tmp_path_factory.mktemp("tool"))


@pytest.fixture(scope="module")
def space(path: Path) -> cspace.ArmSpace:
    return cspace.build_arm_space(
        {"post": posed_box((0.2, 0.2, 1.0), 1.55, 0.6)}, cspace.Arm.from_urdf(path)
    )


@pytest.fixture
def viewer(space: cspace.ArmSpace) -> Iterator[Viewer]:
    with space.view(block=False, port=0, start=START, goal=(2.0, -0.6)) as viewer:
        viewer.page.panel.time_limit.value = 30.0
        assert viewer.page.wait(60.0)
        yield viewer


def tool_at(path: Path, q: Any) -> np.ndarray:
    """Return the pose of the tool, computed without the library."""
    return pose_of(path, "tool0", dict(zip(("shoulder", "elbow"), q, strict=True)))


def test_a_dragged_tool_is_followed_and_planned_to(
    path: Path, space: cspace.ArmSpace, viewer: Viewer
) -> None:
    page, tool = viewer.page, viewer.canvas.tool
    assert tool is not None
    assert (tool.name, tool.position_only) == ("tool0", True)  # two joints reach a position alone
    np.testing.assert_allclose(
        node(viewer, "/tool").position, tool_at(path, START)[:3, 3], atol=1e-9
    )
    *moved, release = drag("/tool", [pose_at(1.4, 0.0), pose_at(0.2, 1.5, 0.0, (0.0, 0.0, 2.0))])
    with connected(viewer) as send:
        for message in moved:
            send(message)
        until(
            lambda: np.allclose(
                tool_at(path, viewer.canvas.robot)[:3, 3], (0.2, 1.5, 0.0), atol=2e-4
            )
        )
        assert page.wait(60.0)
        assert page.panel.tool.content == "**Reached**, proven free."
        assert page.plan is None
        np.testing.assert_array_equal(page.marks["start"], START)
        send(release)
        until(lambda: page.plan is not None)
    assert page.wait(60.0)
    plan = page.plan
    assert plan is not None and plan.certified
    assert space.certify_path(plan.path).all()
    np.testing.assert_allclose(plan.path[0], START)
    np.testing.assert_allclose(tool_at(path, plan.path[-1])[:3, 3], (0.2, 1.5, 0.0), atol=2e-4)
    np.testing.assert_allclose(
        viewer.canvas.robot, plan.path[-1], atol=1e-9
    )  # the arm is where it was released
    np.testing.assert_allclose(
        node(viewer, "/tool").position, tool_at(path, plan.path[-1])[:3, 3], atol=1e-6
    )
    np.testing.assert_allclose(page.marks["goal"], plan.goal)
    assert "certified" in page.panel.answer.content and page.panel.share.value == 100.0
    assert not tool.is_held
    page.drag(pose_at(1.4, -0.6))  # the next plan begins where this one ended
    page.release()
    assert page.wait(60.0)
    assert page.plan is not None and page.plan is not plan
    np.testing.assert_allclose(page.plan.path[0], plan.path[-1], atol=1e-9)


def test_a_plan_is_drawn_as_the_path_of_the_tool_and_pale_arms(path: Path, viewer: Viewer) -> None:
    page = viewer.page
    assert not node(viewer, "/ghosts/fore")
    page.drag(pose_at(0.2, 1.5))
    page.release()
    assert page.wait(60.0)
    assert page.plan is not None
    drawn = np.asarray(node(viewer, "/path").points)
    np.testing.assert_allclose(drawn[0, 0], tool_at(path, START)[:3, 3], atol=1e-6)
    np.testing.assert_allclose(drawn[-1, 1], tool_at(path, page.plan.path[-1])[:3, 3], atol=1e-6)
    lengths = np.concatenate(
        [[0.0], np.linalg.norm(np.diff(page.plan.path, axis=0), axis=1).cumsum()]
    )
    ghosts = node(viewer, "/ghosts/fore")
    assert len(ghosts.batched_positions) == GHOST_COUNT
    for n, position in enumerate(ghosts.batched_positions):
        along = lengths[-1] * (n + 1) / (GHOST_COUNT + 1)
        q = [np.interp(along, lengths, column) for column in page.plan.path.T]
        elbow = pose_of(path, "fore", dict(zip(("shoulder", "elbow"), q, strict=True)))
        np.testing.assert_allclose(position, elbow[:3, 3], atol=1e-6)
    page.drag(pose_at(0.0, 1.5))  # another drag removes the old plan
    assert not node(viewer, "/ghosts/fore") and not node(viewer, "/path")
    assert page.wait(60.0)


def test_the_nearest_pose_is_shown_if_one_is_out_of_reach(path: Path, viewer: Viewer) -> None:
    page = viewer.page
    for y in (-2.5, -3.0):  # a second drag begins where the first one left the tool
        page.drag(pose_at(0.0, y))
        assert page.wait(60.0)
        np.testing.assert_allclose(
            tool_at(path, viewer.canvas.robot)[:3, 3], (0.0, -2.0, 0.0), atol=1e-3
        )
        np.testing.assert_allclose(
            node(viewer, "/gap").points, [[(0.0, -2.0, 0.0), (0.0, y, 0.0)]], atol=1e-3
        )
        assert page.panel.tool.content.startswith(
            "**Not reached**; the arm shows the nearest pose."
        )
        assert (
            f"the nearest pose that it reached is {-2.0 - y:.3g} m away" in page.panel.tool.content
        )
        page.release()
        assert page.wait(60.0)
        assert "**Not done:** goal is out of reach of tool0" in page.panel.answer.content
        assert page.plan is None
        np.testing.assert_allclose(node(viewer, "/tool").position, (0.0, y, 0.0))
        np.testing.assert_array_equal(page.marks["start"], START)  # no plan has moved the arm
    page.drag(pose_at(0.2, 1.5))
    page.release()
    assert page.wait(60.0)
    assert page.plan is not None and page.plan.certified
    np.testing.assert_allclose(page.plan.path[0], START)
    assert not node(viewer, "/gap")


def test_a_pose_in_collision_is_reached_but_not_free(
    space: cspace.ArmSpace, viewer: Viewer
) -> None:
    page = viewer.page
    page.drag(pose_at(1.55, 0.6))
    page.release()
    assert page.wait(60.0)
    assert page.panel.tool.content == "**Reached**, but not proven free."
    assert page.panel.state.content.startswith("**BLOCKED**")
    assert (
        "and post" in page.panel.state.content
        and node(viewer, "/contact/label").text == "fore and post"
    )
    assert "none is proven free: fore is in collision with post" in page.panel.answer.content
    page.move(START)
    assert page.wait(60.0)
    distance = space.closest(START).distance
    assert page.panel.state.content.endswith(
        f"closest pair: fore and post, at least {distance:.3f} m apart: proven"
    )
    assert node(viewer, "/contact/label").text == f"{distance:.3f} m"


def test_a_free_configuration_at_the_pose_is_preferred(path: Path) -> None:
    """Block the nearer of the two configurations at a position."""
    block = {
        "block": posed_box((0.2, 0.2, 0.2), 0.6, -0.8)
    }  # the elbow on the near side is at its center
    with cspace.build_arm_space(block, cspace.Arm.from_urdf(path)).view(
        block=False, port=0, start=START
    ) as viewer:
        viewer.page.drag(pose_at(1.2, 0.0))
        assert viewer.page.wait(60.0)
        assert viewer.page.panel.tool.content == "**Reached**, proven free."
        shoulder = viewer.canvas.robot[0]
        np.testing.assert_allclose((math.cos(shoulder), math.sin(shoulder)), (0.6, 0.8), atol=1e-3)


def test_a_plan_is_played_at_true_speed(
    space: cspace.ArmSpace, viewer: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Replace the clock, so that each frame has an exact time."""
    page, now = viewer.page, [100.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    page.drag(pose_at(0.2, 1.5))
    page.release()
    assert page.wait(60.0)
    trajectory = page.trajectory
    assert trajectory is not None and page.plan is not None
    np.testing.assert_allclose(trajectory.positions[[0, -1]], page.plan.path[[0, -1]], atol=1e-9)
    assert (
        np.abs(trajectory.velocities[:, 0]).max() <= 1.0 + 1e-9
    )  # the URDF's limit of the shoulder
    frames: list[tuple[float, Any]] = []
    place = viewer.canvas.place
    monkeypatch.setattr(
        "cspace.view.page.time", SimpleNamespace(perf_counter=lambda: now[0], sleep=sleep)
    )
    monkeypatch.setattr(
        viewer.canvas, "place", lambda q: (frames.append((now[0] - 100.0, q)), place(q))
    )
    page.play()
    until(
        lambda: page.panel.play.label == "Play" and frames and frames[-1][0] >= trajectory.times[-1]
    )
    assert len(frames) > 10
    for elapsed, q in frames:
        np.testing.assert_allclose(q, trajectory.sample(elapsed)[0], atol=1e-9)
    np.testing.assert_allclose(frames[-1][1], page.plan.path[-1], atol=1e-9)


def test_a_page_opens_with_a_plan_or_a_trajectory_of_an_arm(space: cspace.ArmSpace) -> None:
    plan = planners.plan(space, START, (2.0, -0.6), time_limit=30.0, seed=1)
    given = plan.trajectory(max_velocity={"elbow": 0.7}, max_acceleration=0.2)
    for shown in (plan, given, plan.path):
        with space.view(block=False, port=0, path=shown) as viewer:
            trajectory = viewer.page.trajectory
            assert (trajectory is given) == (shown is given)
            assert (trajectory is None) == (shown is plan.path)
            viewer.page.go(0.4)
            assert viewer.page.wait(60.0)
            if trajectory is not None:
                np.testing.assert_allclose(
                    viewer.canvas.robot, trajectory.sample(0.4 * trajectory.duration)[0]
                )


def test_users_choose_the_frame_and_whether_its_rotation_matters(tmp_path: Path) -> None:
    arm = cspace.Arm.from_urdf(random_chain(tmp_path, 1, 6))
    with cspace.build_arm_space({}, arm).view(block=False, port=0, frame="l6") as viewer:
        page, tool = viewer.page, viewer.canvas.tool
        assert tool is not None
        assert (tool.name, tool.position_only) == ("l6", False)
        assert "l0" not in tool.frames and "tool0" in tool.frames
        page.panel.tool_frame.value = "tool0"
        until(lambda: tool.name == "tool0")
        pose = arm.pose(page.marks["goal"], "tool0")
        page.drag(pose)
        assert page.wait(60.0)
        assert page.panel.tool.content.startswith("**Reached**")
        np.testing.assert_allclose(arm.pose(viewer.canvas.robot, "tool0"), pose, atol=1e-3)
        page.panel.position_only.value = True
        until(
            lambda: math.isinf(tool.goal.tolerance[1]) and node(viewer, "/tool").disable_rotations
        )


@refusals(
    "options, message",
    ({"frame": "hand"}, "frame is 'hand'"),
    ({"frame": "foot"}, "frame is 'foot'"),
)
def test_view_refuses_frames_that_no_joint_moves(
    space: cspace.ArmSpace, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        space.view(block=False, port=0, **options)


def test_maps_have_no_frames() -> None:
    room = cspace.build(
        cspace.Workspace.from_array(np.zeros((9, 9), dtype=bool), 0.1), cspace.Robot.disc(0.1)
    )
    with pytest.raises(InputError, match="a map has no frames"):
        room.view(block=False, port=0, frame="tool0")
    with (
        room.view(block=False, port=0) as viewer,
        pytest.raises(InputError, match="only arms have frames"),
    ):
        viewer.page.drag(np.eye(4))
