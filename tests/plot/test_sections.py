"""Sections of maps in space: cells, scale, traces and robots."""

from itertools import pairwise, product

import numpy as np
import pytest

from cspace import Robot, Workspace, build
from tests.helpers import handmade
from tests.helpers.pictures import COLORS, class_of, labels, pixel, rendered
from tests.helpers.strategies import few

SECTION_PATH = np.array([(0.6, 3.2, 1.8), (2.2, 1.2, 1.0), (3.8, 1.2, 1.0), (5.5, 1.5, 0.6)])
PAIRS = [(0, 1), (0, 2), (1, 2)]
"""Axes of the sections: from above, from the front and from the right."""


@pytest.mark.parametrize("shape", few([((40, 30, 8),), ((8, 30, 40),)]))
def test_sections_show_the_cells_of_the_map(shape):
    rng = np.random.default_rng(3)
    occupied = np.zeros(shape, bool)
    occupied[tuple(rng.integers(0, shape, (25, 3)).T)] = True
    lower = np.array([-3.0, 7.0, 1.0])
    space = build(Workspace.from_array(occupied, 0.5, lower), Robot.ball(0.4))
    center = lower + 0.5 * np.multiply(shape, (0.31, 0.62, 0.43))
    ax = space.plot(center=center)
    image = rendered(ax)
    for panel, pair in zip(ax.figure.axes, PAIRS, strict=True):
        (across,) = {0, 1, 2} - set(pair)
        assert panel.get_title(loc="left") == f"{'xyz'[across]} = {round(center[across], 2):g} m"
        right, up = pair
        traces = [line for line in panel.lines if line.get_linestyle() == "-."]
        assert set(traces[0].get_xdata()) == {center[right]}
        assert set(traces[1].get_ydata()) == {center[up]}
        for i, j in product(range(shape[right]), range(shape[up])):
            cell = space.grid.cell_of(center)
            cell[[right, up]] = i, j
            middle = space.grid.center_of(cell)
            if np.abs(middle - center)[[right, up]].min() < 0.27:
                continue  # there the traces are drawn
            state = int(space.cell_states[tuple(cell)])
            name = class_of(space, {state}, bool(occupied[tuple(cell)]))
            assert pixel(panel, image, *middle[[right, up]]) == COLORS[name]


def test_path_and_robots_are_drawn_where_they_meet_sections(hall):
    """Draw the path faintly outside the robot's reach."""
    center = np.array([3.0, 1.2, 1.0])
    half = np.array([0.25, 0.2, 0.15])
    ax = hall.plot(path=SECTION_PATH, center=center)
    shares = np.linspace(0.0, 1.0, 400)[:, None]
    steps = pairwise(SECTION_PATH)
    points = np.concatenate([start + shares * (end - start) for start, end in steps])
    for panel, pair in zip(ax.figure.axes, PAIRS, strict=True):
        columns = list(pair)
        (across,) = {0, 1, 2} - set(pair)
        lines = {line.get_label(): line.get_xydata() for line in panel.lines}
        away = lines["path, away from the section"]
        np.testing.assert_array_equal(away, SECTION_PATH[:, columns])
        np.testing.assert_array_equal(lines["start"], [SECTION_PATH[0, columns]])
        is_near = np.abs(points[:, across] - center[across]) <= half[across] + 0.01
        near = points[is_near][:, columns]
        solid = lines["path"][np.isfinite(lines["path"]).all(axis=1)]
        assert len(solid) > 5
        distances = np.linalg.norm(solid[:, None] - near, axis=2)
        assert distances.min(axis=1).max() < 0.01
    counts = [len(panel.collections[0].get_paths()) for panel in ax.figure.axes]
    assert 1 <= counts[2] < counts[1]
    assert labels(ax)[-5:] == ["path", "path, away from the section", "robot", "start", "goal"]


@pytest.mark.parametrize(
    "options, center",
    [
        ({"center": (1.0, 2.0, 0.5)}, [1.0, 2.0, 0.5]),
        ({"path": [(1.0, 1.0, 0.5), (1.0, 3.0, 0.5), (1.0, 3.0, 1.0)]}, [1.0, 2.25, 0.5]),
        ({"path": [(-9.0, 1.0, 1.0), (-8.0, 1.0, 1.0)]}, [0.0, 1.0, 1.0]),
    ],
)
def test_sections_run_through_the_path_or_the_middle(hall, options, center):
    panels = hall.plot(**options).figure.axes
    assert [float(panel.get_title(loc="left")[4:-2]) for panel in reversed(panels)] == center


@pytest.mark.parametrize("yaw, slices", [(None, slice(None)), (np.pi / 2, slice(1, 2))])
def test_sections_show_one_rotation_or_all(yaw, slices):
    workspace = Workspace.from_array(np.zeros((12, 10, 8), bool), 0.5)
    states = np.random.default_rng(0).integers(0, 3, (4, 12, 10, 8)).astype(np.uint8)
    robot = Robot.box((1.6, 0.4, 0.8), center=(0.2, 0.0, 0.0))
    space = handmade.map_in(workspace, robot, states, 4, outside="free")
    ax = space.plot(center=(3.1, 2.6, 1.8), rotation=yaw)
    image = rendered(ax)
    for i, j in np.ndindex(6, 5):
        name = class_of(space, set(states[slices, i, j, 3].tolist()), False)
        assert pixel(ax, image, 0.5 * i + 0.25, 0.5 * j + 0.25) == COLORS[name]
