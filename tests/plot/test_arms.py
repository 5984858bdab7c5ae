"""Pictures of arms: links, obstacles and paths."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import cspace
from cspace.errors import InputError
from cspace.plot.scene import GHOST_COLOR, PATH_COLOR, ROBOT_FILL_COLOR, CellClass
from tests.helpers.urdfs import planar_arm, posed_box


@pytest.fixture(scope="module")
def space():
    """Build an arm of two links of 1 m next to a block."""
    blocks = {"block": posed_box((0.4, 0.2, 1.0), -0.4, 1.0)}
    arm = planar_arm()
    return cspace.build_arm_space(blocks, arm)


def collect_corners(ax, color):
    """Return the corners (n, 3) of all polygons in shades of a colour."""
    (collection,) = ax.collections
    shades = collection._facecolor3d[:, :3]
    hue = np.array(to_rgb(color))
    brightness = shades @ hue / (hue @ hue)
    is_shade = np.abs(shades - np.outer(brightness, hue)).max(axis=1) < 0.01
    return np.asarray(collection._faces)[is_shade].reshape(-1, 3)


def find_tip(q):
    """Return the end of the second link at a configuration."""
    angles = np.cumsum(q)
    return np.array([np.cos(angles).sum(), np.sin(angles).sum(), 0.0])


def test_links_and_obstacles_are_drawn_where_they_are(space):
    ax = space.plot(q=(0.0, np.pi / 2))
    for color, lower, upper in (
        (ROBOT_FILL_COLOR, (-0.025, -0.05, -0.225), (1.05, 1.0, 0.05)),
        (CellClass.OBSTACLE.solid_color, (-0.6, 0.9, -0.5), (-0.2, 1.1, 0.5)),
    ):
        corners = collect_corners(ax, color)
        extents = [corners.min(axis=0), corners.max(axis=0)]
        np.testing.assert_allclose(extents, [lower, upper], atol=1e-9)
    assert not len(collect_corners(ax, GHOST_COLOR))
    assert ax.get_figure().get_suptitle() == "small"


def test_faces_that_look_away_have_the_shade_of_those_before_them(space):
    (collection,) = space.plot().collections
    shades = collection._facecolor3d[:, :3]
    grey = shades[np.ptp(shades, axis=1) < 1e-9]
    assert len(np.unique(grey[:, 0].round(6))) == 3  # the six faces of the block


def test_a_path_is_drawn_as_pale_arms_and_a_line(space):
    path = [(0.0, 0.0), (0.5, 0.5), (1.5, -0.5)]
    ax = space.plot(path=path, title="on its way", legend=False)
    shown = collect_corners(ax, ROBOT_FILL_COLOR)
    pale = collect_corners(ax, GHOST_COLOR)
    assert np.linalg.norm(shown - find_tip(path[-1]), axis=1).min() < 0.08
    assert np.linalg.norm(pale - find_tip(path[0]), axis=1).min() < 0.08
    (line,) = ax.lines
    np.testing.assert_allclose(np.array(line.get_data_3d())[:, 0], [1.5, 0.0, 0.0], atol=1e-9)
    assert line.get_color() == PATH_COLOR


def test_floor_is_clipped_near_the_arm(space):
    floor = posed_box((100.0, 100.0, 0.1), 0.0, 0.0, -1.0)
    ax = cspace.build_arm_space({"floor": floor}, space.arm).plot()
    corners = collect_corners(ax, CellClass.OBSTACLE.solid_color)
    assert np.ptp(corners, axis=0).max() < 6.0
    assert corners[:, 2].max() == pytest.approx(-0.95)


def test_axes_of_the_caller_need_three_dimensions(space):
    solid = Figure().add_subplot(projection="3d")
    assert space.plot(ax=solid) is solid
    with pytest.raises(InputError, match="ax has two dimensions"):
        space.plot(ax=Figure().add_subplot())
    with pytest.raises(InputError, match="q has shape"):
        space.plot(q=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("place", [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
def test_the_camera_is_not_behind_a_shelf(place):
    shelf = posed_box((0.6, 0.6, 1.5), *place)
    ax = cspace.build_arm_space({"shelf": shelf}, planar_arm()).plot(q=(0.0, np.pi / 2))
    azimuth = np.radians(ax.azim)
    assert np.array([np.cos(azimuth), np.sin(azimuth)]) @ place < 0.0


def test_an_obstacle_far_away_is_not_drawn():
    far = {"far": posed_box((0.6, 0.6, 1.5), 9.0, -9.0)}
    ax = cspace.build_arm_space(far, planar_arm()).plot()
    assert not len(collect_corners(ax, CellClass.OBSTACLE.solid_color))
    assert ax.get_xlim()[1] < 3.0
