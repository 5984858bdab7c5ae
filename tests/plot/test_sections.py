"""Sections of maps in space: cells, scale, traces and robots."""

from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cspace import CSpace, Robot, Workspace, build
from cspace.errors import InputError
from cspace.plot import plot
from tests.helpers import handmade
from tests.helpers.pictures import COLORS, class_of, heading, labels, rendered

SECTION_PATH = [(0.6, 3.2, 1.8), (2.2, 1.2, 1.0), (3.8, 1.2, 1.0), (5.5, 1.5, 0.6)]


def expect_class(space: CSpace, cell: NDArray[np.int64]) -> str:
    """Return the expected class of a cell."""
    return class_of(
        space, {int(space.cell_states[tuple(cell)])}, bool(space.workspace.outer[tuple(cell)])
    )


def read_axis_pairs(figure: Any) -> list[tuple[int, int]]:
    """Return the coordinates shown in each panel."""
    plan, front, side = figure.axes
    names = [
        (plan.get_xlabel(), plan.get_ylabel()),
        (plan.get_xlabel(), front.get_ylabel()),
        (side.get_xlabel(), front.get_ylabel()),
    ]
    pairs = [("xyz".index(right[0]), "xyz".index(up[0])) for right, up in names]
    assert [len(set(pair)) for pair in pairs] == [2, 2, 2]
    return pairs


def test_a_workspace_draws_itself(hall: CSpace) -> None:
    """Test obstacles and free cells, without a robot."""
    ax = hall.workspace.plot(center=(3.0, 1.2, 1.0))
    assert labels(ax) == ["obstacle", "free"]
    assert heading(ax) == "array, cells of 0.1 m"
    with pytest.raises(InputError, match="view is 'plane'"):
        hall.workspace.plot(view="plane")


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_sections_show_the_map(order: tuple[int, ...]) -> None:
    """Test the cells of every panel, of a flat and of a high map."""
    rng = np.random.default_rng(3)
    shape = np.array([40, 30, 8])[list(order)]
    occupied = np.zeros(tuple(shape), bool)
    occupied[tuple(rng.integers(0, shape, (25, 3)).T)] = True
    lower = np.array([-3.0, 7.0, 1.0])
    space = build(Workspace.from_array(occupied, 0.5, lower), Robot.ball(0.4))
    at = lower + 0.5 * shape * (0.31, 0.62, 0.43)
    ax = plot(space, center=at)
    image, figure = rendered(ax), ax.figure
    layer = ((at - lower) / 0.5).astype(int)
    for panel, pair, across in zip(figure.axes, read_axis_pairs(figure), (2, 1, 0), strict=True):
        assert {*pair, across} == {0, 1, 2}
        assert panel.get_title(loc="left") == f"{'xyz'[across]} = {round(at[across], 2):g} m"
        for cell in product(*map(range, shape[list(pair)])):
            whole = layer.copy()
            whole[list(pair)] = cell
            middle = lower + 0.5 * (whole + 0.5)
            if np.abs(middle - at)[list(pair)].min() < 0.27:
                continue  # there the other sections are drawn
            column, row = panel.transData.transform(middle[list(pair)]).astype(int)
            assert tuple(image[row, column]) == COLORS[expect_class(space, whole)], (pair, whole)


def test_sections_are_to_scale_and_share_their_axes(hall: CSpace) -> None:
    plan = plot(hall, center=(1.0, 2.0, 0.5))
    plan.figure.draw_without_rendering()
    front, side = plan.figure.axes[1:]
    scale = plan.get_window_extent().width / 6.0
    for panel, pair in zip(plan.figure.axes, read_axis_pairs(plan.figure), strict=True):
        upper = np.array([6.0, 4.0, 2.4])[list(pair)]
        np.testing.assert_allclose(
            [panel.get_xlim(), panel.get_ylim()], [(0, upper[0]), (0, upper[1])]
        )
        np.testing.assert_allclose(panel.get_window_extent().size, scale * upper)
    assert front.get_window_extent().x0 == pytest.approx(plan.get_window_extent().x0)
    assert front.get_window_extent().y0 > plan.get_window_extent().y1
    assert side.get_window_extent().x0 > plan.get_window_extent().x1
    plan.set_xlim(1.0, 2.0)
    assert front.get_xlim() == (1.0, 2.0)


def test_sections_show_traces_of_the_others(hall: CSpace) -> None:
    at = (1.03, 2.07, 0.55)
    figure = plot(hall, center=at).figure
    for panel, (right, up) in zip(figure.axes, read_axis_pairs(figure), strict=True):
        across, along = (line for line in panel.lines if line.get_linestyle() == "-.")
        assert set(across.get_xdata()) == {at[right]}
        assert set(along.get_ydata()) == {at[up]}


def test_path_and_robots_are_drawn_where_they_meet_sections(hall: CSpace) -> None:
    """Draw the path faintly outside the robot's reach."""
    ax = plot(hall, path=SECTION_PATH, center=(3.0, 1.2, 1.0), robot_every=0.5)
    for panel, pair, across in zip(
        ax.figure.axes, read_axis_pairs(ax.figure), (2, 1, 0), strict=True
    ):
        drawn = {line.get_label(): line.get_xydata() for line in panel.lines}
        np.testing.assert_array_equal(
            drawn["path, away from the section"], np.array(SECTION_PATH)[:, pair]
        )
        np.testing.assert_array_equal(drawn["start"], [np.array(SECTION_PATH[0])[list(pair)]])
        np.testing.assert_array_equal(drawn["goal"], [np.array(SECTION_PATH[-1])[list(pair)]])
        half = np.array([0.25, 0.2, 0.15])
        at = np.array([3.0, 1.2, 1.0])
        near = drawn["path"][np.isfinite(drawn["path"]).all(axis=1)]
        q = np.array(SECTION_PATH)
        for point in near:
            # Each solid point is on the path, where the robot reaches the section.
            shares = np.linspace(0.0, 1.0, 401)[:, np.newaxis]
            steps = np.concatenate([a + shares * (b - a) for a, b in pairwise(q)])
            here = steps[np.linalg.norm(steps[:, pair] - point, axis=1) < 0.01]
            assert (np.abs(here[:, across] - at[across]) <= half[across] + 0.01).any()
        assert len(near) > 5
        boxes = [outline.get_extents() for outline in panel.collections[0].get_paths()]
        np.testing.assert_allclose(
            [(box.width, box.height) for box in boxes], [2 * half[list(pair)]] * len(boxes)
        )
    side = ax.figure.axes[2].collections[0].get_paths()
    assert 1 <= len(side) < len(ax.figure.axes[1].collections[0].get_paths())
    assert labels(ax)[-5:] == ["path", "path, away from the section", "robot", "start", "goal"]


def draw_sections(ax: Any) -> list[float]:
    return [float(panel.get_title(loc="left")[4:-2]) for panel in reversed(ax.figure.axes)]


def test_sections_run_through_the_path_or_the_middle(hall: CSpace) -> None:
    """Test paths, starts, goals and grid centers."""
    assert draw_sections(plot(hall, center=(1.0, 2.0, 0.5))) == [1.0, 2.0, 0.5]
    points = draw_sections(
        plot(hall, path=[(1.0, 1.0, 0.5), (1.0, 3.0, 0.5), (1.0, 3.0, 1.0), (1.5, 3.0, 1.0)])
    )
    assert points == [1.0, 2.5, 0.5]
    assert draw_sections(plot(hall, start=(1.0, 3.0, 2.0), goal=(5.0, 1.0, 1.0))) == [1.0, 3.0, 2.0]
    assert draw_sections(plot(hall, goal=(5.0, 1.0, 1.0))) == [5.0, 1.0, 1.0]
    assert draw_sections(plot(hall)) == [3.0, 2.0, 1.2]
    assert draw_sections(plot(hall, path=[(-9.0, 1.0, 1.0), (-8.0, 1.0, 1.0)]))[0] == 0.0


def test_sections_omit_legend_and_title(hall: CSpace) -> None:
    ax = plot(hall, legend=False, title="")
    assert labels(ax) == []
    assert heading(ax) == ""
    assert heading(plot(hall, title="mine")) == "mine"
    assert heading(plot(hall)) == "box 0.5 m x 0.4 m x 0.3 m, cells of 0.1 m"


def test_sections_show_one_rotation_or_all() -> None:
    """Draw the rotated robot from above and from the side."""
    workspace = Workspace.from_array(np.zeros((12, 10, 8), bool), 0.5)
    states = np.random.default_rng(0).integers(0, 3, (4, 12, 10, 8)).astype(np.uint8)
    robot = Robot.box((1.6, 0.4, 0.8), center=(0.2, 0.0, 0.0))
    space = handmade.map_in(workspace, robot, states, 4, outside="free")
    at = (3.1, 2.6, 1.8)
    for yaw, slices in ((None, slice(None)), (np.pi / 2, slice(1, 2))):
        ax = plot(space, center=at, rotation=yaw)
        image = rendered(ax)
        for i, j in np.ndindex(12, 10):
            if i == 6 or j == 5:
                continue  # there the other sections are drawn
            column, row = ax.transData.transform((0.5 * i + 0.25, 0.5 * j + 0.25)).astype(int)
            name = class_of(space, set(states[slices, i, j, 3].tolist()), False)
            assert tuple(image[row, column]) == COLORS[name]
    ax = plot(space, start=(3.0, 2.0, 1.8, np.pi / 2), center=at)
    spans = [panel.collections[0].get_paths()[0].get_extents() for panel in ax.figure.axes]
    np.testing.assert_allclose(
        [(box.width, box.height) for box in spans[:2]], [(0.4, 1.6), (0.4, 0.8)], atol=1e-6
    )
    assert "over all rotations" in heading(ax)
