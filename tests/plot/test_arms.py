"""Pictures of arms: links, obstacles and paths."""

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import cspace
import planners
from cspace.errors import ConfigurationError, InputError
from cspace.plot.arms import GHOST_COLOR, GHOST_COUNT
from cspace.plot.artists import LOST_COLOR, PATH_COLOR, ROBOT_FILL_COLOR
from cspace.plot.route import interpolate_path
from cspace.plot.surface import SURFACES
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import planar, posed_box

pytest.importorskip("yourdfpy")
PATH_OF_JOINTS = [(0.0, 0.0), (0.5, 0.5), (1.5, -0.5)]


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> cspace.ArmSpace:
    blocks = {"block": posed_box((0.4, 0.2, 1.0), -0.4, 1.0)}
    return cspace.build_arm_space(
        blocks, cspace.Arm.from_urdf(planar(tmp_path_factory.mktemp("arm")))
    )


def test_axes_of_a_joint_map_are_in_radians(space: cspace.ArmSpace) -> None:
    ax = cspace.build_joint_map(space, 0.2).plot(path=[(0.0, 0.0), (0.5, 0.5)])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("shoulder (rad)", "elbow (rad)")


def collect_polygons(ax: Any, color: str) -> Any:
    """Return polygons (n, 4, 3) in shades of a colour."""
    (collection,) = ax.collections
    shades, hue = collection._facecolor3d[:, :3], np.array(to_rgb(color))
    bright = shades @ hue / (hue @ hue)
    return np.asarray(collection._faces)[
        np.abs(shades - bright[:, np.newaxis] * hue).max(axis=1) < 0.01
    ]


def test_links_and_obstacles_are_drawn_where_they_are(space: cspace.ArmSpace) -> None:
    ax = space.plot(q=(0.0, np.pi / 2))
    arm = collect_polygons(ax, ROBOT_FILL_COLOR).reshape(-1, 3)
    np.testing.assert_allclose(
        [arm.min(axis=0), arm.max(axis=0)], [(-0.025, -0.05, -0.225), (1.05, 1.0, 0.05)], atol=1e-9
    )
    block = collect_polygons(ax, SURFACES["obstacles"][1]).reshape(-1, 3)
    np.testing.assert_allclose(
        [block.min(axis=0), block.max(axis=0)], [(-0.6, 0.9, -0.5), (-0.2, 1.1, 0.5)], atol=1e-9
    )
    assert not len(collect_polygons(ax, GHOST_COLOR))
    assert ax.get_figure().get_suptitle() == "small"


def test_a_path_is_drawn_as_pale_arms_and_a_line(space: cspace.ArmSpace) -> None:
    ax = space.plot(path=PATH_OF_JOINTS, title="on its way", legend=False)
    shown, pale = (
        collect_polygons(ax, ROBOT_FILL_COLOR).reshape(-1, 3),
        collect_polygons(ax, GHOST_COLOR).reshape(-1, 3),
    )
    tip_positions = [
        np.array([np.cos(a) + np.cos(a + b), np.sin(a) + np.sin(a + b), 0.0])
        for a, b in PATH_OF_JOINTS
    ]
    assert np.linalg.norm(shown[:, np.newaxis] - tip_positions[2], axis=-1).min() < 0.08
    for q in interpolate_path(
        space.rotations, np.array(PATH_OF_JOINTS), np.arange(GHOST_COUNT) / GHOST_COUNT
    ):
        tip = [np.cos(q[0]) + np.cos(q.sum()), np.sin(q[0]) + np.sin(q.sum()), 0.0]
        assert np.linalg.norm(pale - tip, axis=-1).min() < 0.08
    (line,) = ax.lines
    center = np.array([np.cos(0.0) + 0.5, 0.0, 0.0])
    np.testing.assert_allclose(np.array(line.get_data_3d())[:, 0], center, atol=1e-9)
    assert line.get_color() == PATH_COLOR
    assert ax.get_figure().get_suptitle() == "on its way"


def test_edges_blocked_by_another_scene_have_their_own_colour(space: cspace.ArmSpace) -> None:
    plan = planners.plan(space, (0.0, 0.0), (1.2, 0.0), seed=1)
    assert plan.certified and LOST_COLOR not in [
        line.get_color() for line in space.plot(path=plan).lines
    ]
    block = posed_box((0.1, 0.1, 0.1), 1.9 * np.cos(0.6), 1.9 * np.sin(0.6))
    again = cspace.build_arm_space({"box": block}, space.arm)
    assert not plan.recheck(again).all()
    ax = again.plot(path=plan)
    assert LOST_COLOR in [line.get_color() for line in ax.lines]
    assert "path, no longer proven free" in [
        text.get_text() for text in ax.get_figure().legends[0].get_texts()
    ]


def test_floor_is_clipped_near_the_arm(space: cspace.ArmSpace) -> None:
    floor = posed_box((100.0, 100.0, 0.1), 0.0, 0.0, -1.0)
    drawn = collect_polygons(
        cspace.build_arm_space({"floor": floor}, space.arm).plot(), SURFACES["obstacles"][1]
    ).reshape(-1, 3)
    assert np.ptp(drawn, axis=0).max() < 6.0
    assert drawn[:, 2].max() == pytest.approx(-0.95)


def test_plans_draw_themselves(space: cspace.ArmSpace) -> None:
    planners = pytest.importorskip("planners")
    plan = planners.plan(space, (0.0, 0.0), (0.5, 0.5), time_limit=30.0)
    figure = Figure()
    ax = figure.add_subplot(projection="3d")
    assert plan.plot(ax=ax) is ax
    assert len(collect_polygons(ax, GHOST_COLOR))


@refusals(
    "error, options, message",
    (InputError, {"path": np.zeros((3, 3))}, "path has shape"),
    (InputError, {"q": (0.0,)}, "q has shape"),
    (InputError, {"ax": Figure().add_subplot()}, "ax has two dimensions"),
    (InputError, {"camera": (95.0, 0.0)}, "camera is"),
    (ConfigurationError, {"q": (0.0, 4.0)}, "q has elbow at 4"),
)
def test_plot_of_an_arm_refuses_invalid_options(
    space: cspace.ArmSpace, error: type[Exception], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(error, match=message):
        space.plot(**options)
