"""The page of an arm, tested through the server."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cspace
from cspace.errors import ConfigurationError, InputError
from cspace.plot.artists import CLASSES, COLLIDES, ROBOT_FILL_COLOR
from cspace.view import Viewer
from cspace.view.scene import rgb
from tests.helpers.pages import node
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import joint, link, planar, pose_at, write_urdf

pytest.importorskip("viser")
pytest.importorskip("yourdfpy")

START, GOAL = (-0.4, 0.3), (2.0, -0.6)


def make_post(x: float, y: float) -> cspace.arms.PosedShape:
    return cspace.arms.PosedShape(cspace.Robot.cylinder(0.1, 1.0).shape, pose_at(x, y))


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[cspace.ArmSpace, Viewer]]:
    arm = cspace.Arm.from_urdf(planar(tmp_path_factory.mktemp("arm")))
    space = cspace.build_arm_space({"post": make_post(1.2, 1.2)}, arm)
    with space.view(block=False, port=0, start=START, goal=GOAL) as viewer:
        assert viewer.page.wait(60.0)
        yield space, viewer


def place_corners(handle: Any) -> Any:
    """Return the corners of a posed mesh."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_quat(handle.wxyz, scalar_first=True)
    return turn.apply(handle.vertices) + handle.position


def test_links_follow_the_joints(shown: Any) -> None:
    _, viewer = shown
    for name, q in (("robot", (0.3, 0.7)), ("start", START), ("goal", GOAL)):
        viewer.page.move(np.array([0.3, 0.7]))
        elbow = np.array([math.cos(q[0]), math.sin(q[0]), 0.0])
        center = elbow + 0.5 * np.array([math.cos(sum(q)), math.sin(sum(q)), 0.0])
        np.testing.assert_allclose(
            place_corners(node(viewer, f"/{name}/fore")).mean(axis=0), center, atol=1e-6
        )
    assert node(viewer, "/robot/foot")
    assert not node(viewer, "/goal/foot")  # the fixed foot is drawn once
    np.testing.assert_allclose(
        np.ptp(place_corners(node(viewer, "/obstacles/post")), axis=0), (0.2, 0.2, 1.0), atol=0.01
    )


@pytest.mark.parametrize(
    ("q", "text", "color"),
    [((0.3, 0.7), "**FREE**", ROBOT_FILL_COLOR), ((0.8, 0.0), "**BLOCKED**", CLASSES[COLLIDES][1])],
)
def test_page_shows_the_state_of_the_arm(
    shown: Any, q: tuple[float, float], text: str, color: str
) -> None:
    space, viewer = shown
    viewer.page.move(np.array(q))
    assert viewer.page.wait(60.0)
    contact = space.closest(q)
    assert viewer.page.panel.state.content.startswith(text)
    assert f"{contact.link} and {contact.other}" in viewer.page.panel.state.content
    assert all(
        tuple(node(viewer, f"/robot/{name}").color) == rgb(color)
        for name in ("foot", "upper", "fore")
    )
    np.testing.assert_allclose(node(viewer, "/contact").points[0], contact.points, atol=1e-6)


def test_page_shows_plans_and_proofs(shown: Any) -> None:
    space, viewer = shown
    page = viewer.page
    assert page.panel.proof.content == "The straight motion is not proven free."
    page.panel.time_limit.value = 30.0
    page.search()
    assert page.wait(60.0)
    assert viewer.plan is not None
    assert viewer.plan.certified
    assert "certified" in page.panel.answer.content
    page.go(0.5)
    first, last = viewer.plan.path[[0, -1]]
    ahead = viewer.canvas.robot
    assert (
        min(np.linalg.norm(ahead - first), np.linalg.norm(ahead - last)) > 0.3
    )  # between the endpoints
    positions = np.asarray(node(viewer, "/path").points)
    for position, q in ((positions[0, 0], START), (positions[-1, 1], GOAL)):
        np.testing.assert_allclose(
            [math.cos(q[0]), math.sin(q[0]), 0.0], position, atol=1e-6
        )  # the frame of the fore
    page.mark("goal", np.array([-0.3, 0.4]))
    assert page.wait(60.0)
    assert page.panel.proof.content == "**The straight motion is free: proven.**"
    page.mark("goal", np.array(GOAL))
    assert space.is_free(GOAL)


def test_page_given_a_start_alone_shows_no_goal_until_one_is_set(tmp_path: Path) -> None:
    space = cspace.build_arm_space(
        {"post": make_post(1.2, 1.2)}, cspace.Arm.from_urdf(planar(tmp_path))
    )
    with space.view(block=False, port=0, start=START) as viewer:
        viewer.page.move(np.array([0.3, 0.7]))
        assert viewer.page.wait(60.0)
        shown = node(viewer, "/goal/fore"), node(viewer, "/goal/label")
        assert node(viewer, "/start/fore").visible and not any(handle.visible for handle in shown)
        np.testing.assert_allclose(viewer.page.marks["goal"], START)
        assert viewer.page.panel.proof.content == "Set a goal below, or drag the tool."
        viewer.page.mark("goal", np.array(GOAL))
        assert all(handle.visible for handle in shown)
        viewer.page.mark("goal", np.array(START))
        assert not any(handle.visible for handle in shown)


def test_refresh_draws_the_scene_as_it_is_now(tmp_path: Path) -> None:
    space = cspace.build_arm_space(
        {"post": make_post(1.2, 1.2)}, cspace.Arm.from_urdf(planar(tmp_path))
    )
    scan = np.random.default_rng(0).uniform((-2.0, -2.0, 0.3), (2.0, 2.0, 0.5), (1000, 3))
    with space.view(block=False, port=0, start=START, goal=GOAL) as viewer:
        viewer.page.move(np.array([0.3, 0.7]))
        space.remove_obstacle("post")
        space.add_obstacle("scan", scan, radius=0.02)
        space.attach("ball", cspace.Robot.ball(0.1), "fore", pose_at(1.0, 0.0))
        viewer.refresh()
        assert viewer.page.wait(60.0)
        assert not node(viewer, "/obstacles/post")
        cloud = node(
            viewer, "/obstacles/scan"
        )  # as points: meshes of many balls are slow in a browser
        np.testing.assert_allclose(cloud.points, scan, atol=1e-6)
        assert cloud.point_size == pytest.approx(0.02)
        tip = np.array([math.cos(0.3) + math.cos(1.0), math.sin(0.3) + math.sin(1.0), 0.0])
        np.testing.assert_allclose(
            place_corners(node(viewer, "/robot/ball")).mean(axis=0), tip, atol=1e-6
        )
        assert node(viewer, "/goal/ball")
        assert "and scan" in viewer.page.panel.state.content
        space.detach("ball")
        viewer.refresh()
        assert viewer.page.wait(60.0)
        assert not node(viewer, "/robot/ball") and not node(viewer, "/start/ball")


def test_the_arm_moves_while_the_scene_is_drawn_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    space = cspace.build_arm_space(
        {"post": make_post(1.2, 1.2)}, cspace.Arm.from_urdf(planar(tmp_path))
    )
    with space.view(block=False, port=0, start=START, goal=GOAL) as viewer:
        for k in range(100):
            if k % 10 == 0:
                space.attach("ball", cspace.Robot.ball(0.1), "fore", pose_at(1.0, 0.0))
            viewer.refresh()
            viewer.page.move(np.array([0.3, 0.01 * k]))
            if k % 10 == 5:
                space.detach("ball")
        assert viewer.page.wait(60.0)
    assert not caplog.records


def test_sliders_stay_within_the_limits(tmp_path: Any) -> None:
    bar = ((0.3, 0.1, 0.1), (0.15, 0, 0))
    arm = cspace.Arm.from_urdf(
        write_urdf(
            tmp_path,
            link("base", bar),
            link("lift", bar),
            link("wrist", bar),
            joint("up", "base", "lift", kind="prismatic", at=(0, 0, 1), limits=(-0.2501, 0.4)),
            joint("round", "lift", "wrist", kind="continuous", at=(0.5, 0, 0), limits=None),
        )
    )
    with cspace.build_arm_space({}, arm).view(block=False, port=0) as viewer:  # no obstacles
        assert viewer.page.wait(60.0)
        assert [tuple(dial) for dial in viewer.canvas.dials] == [
            ("up (m)", -0.25, 0.4, 0.001),
            ("round (°)", -180.0, 180.0, 0.1),
        ]
        np.testing.assert_allclose(viewer.canvas.configuration_of((0.4, 90.0)), (0.4, math.pi / 2))
        assert (viewer.canvas.configuration_of((0.4000001, 0.0)) <= arm.upper).all()


@refusals(
    "error, options, message",
    (InputError, {"path": np.zeros((3, 3))}, "path has shape"),
    (InputError, {"start": (0.0,)}, "start has shape"),
    (ConfigurationError, {"goal": (0.0, 4.0)}, "goal has elbow at 4"),
)
def test_view_of_an_arm_refuses_invalid_arguments(
    shown: Any, error: type[Exception], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(error, match=message):
        shown[0].view(block=False, port=0, **options)


def test_a_map_of_joints_is_in_radians(tmp_path: Path) -> None:
    joints = cspace.build_joint_map(
        cspace.build_arm_space(
            {"post": make_post(1.2, 1.2)}, cspace.Arm.from_urdf(planar(tmp_path))
        ),
        0.1,
    )
    with joints.view(block=False, port=0, path=[(2.0, 0.0), (2.5, 0.5)]) as viewer:
        assert viewer.page.wait(60.0)
        panel, canvas = viewer.page.panel, viewer.canvas
        assert [slider.label for slider in panel.sliders] == ["shoulder (rad)", "elbow (rad)"]
        assert canvas.about.endswith("cells of 0.1 rad")
        assert panel.state.content.strip().endswith(" rad")
