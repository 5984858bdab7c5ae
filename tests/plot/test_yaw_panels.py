"""Pictures of maps with rotations: the slice that was asked for, all yaws at once, robots that are turned."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cspace import BLOCKED, FREE, MIXED, CSpace, Robot, Workspace, build
from cspace.errors import FileError, InputError
from cspace.plot import plot, plot_strip, save_plot, save_strip
from cspace.plot.artists import CLASSES
from cspace.plot.view import along, degrees, shorter, travelled

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def space() -> CSpace:
    """8 m by 5 m with walls all round and a block; the robot is long, and its reference point off its middle."""
    occupied = np.zeros((80, 50), bool)
    occupied[[0, -1], :] = True
    occupied[:, [0, -1]] = True
    occupied[50:65, 10:20] = True
    return build(Workspace.from_array(occupied, 0.1), Robot.rectangle(1.2, 0.4, center=(0.3, 0.0)), rotations=24)


@pytest.fixture(scope="module")
def flat() -> CSpace:
    return build(Workspace.from_array(np.eye(20, dtype=bool), 0.1), Robot.disc(0.1))


def rendered(figure: Any) -> NDArray[np.uint8]:
    """Pixels of a figure, the first row at the bottom as in display coordinates, shape (height, width, 3)."""
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[::-1, :, :3]


def pixel(ax: Any, image: NDArray[np.uint8], x: float, y: float) -> tuple[int, ...]:
    column, row = ax.transData.transform((x, y))
    return tuple(image[int(row), int(column)].tolist())


def color(label: str) -> tuple[int, ...]:
    from matplotlib.colors import to_rgb

    return tuple(round(255 * part) for part in to_rgb(dict(CLASSES)[label]))


def labels(figure: Any) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


NAMES = {FREE: "free", MIXED: "undecided (MIXED)", BLOCKED: "C-obstacle (BLOCKED)"}


def shows_slice(space: CSpace, ax: Any, image: NDArray[np.uint8], yaw: float) -> None:
    """Fail unless axes show the states at a yaw, asked of the map one by one."""
    rng = np.random.default_rng(1)
    seen = set()
    for cell in rng.integers(0, space.grid.shape, (400, 2)):
        x, y = space.grid.center_of(cell)
        state = space.classify((x, y, yaw))
        seen.add(state)
        name = "obstacle" if space.workspace.outer[tuple(cell)] else NAMES[state]
        assert pixel(ax, image, x, y) == color(name), (x, y)
    assert seen == {FREE, MIXED, BLOCKED}


# ----------------------------------------------------------------------------------------------- one yaw, all yaws


@pytest.mark.parametrize("yaw", [0.0, 1.2, math.pi / 2, -2.0, 7.0])
def test_the_slice_of_a_yaw(space: CSpace, yaw: float) -> None:
    ax = plot(space, yaw=yaw)
    shows_slice(space, ax, rendered(ax.figure), yaw)


def test_the_title_tells_yaw_and_width(space: CSpace) -> None:
    assert "yaw 90°, in a rotation cell 15° wide" in plot(space, yaw=math.pi / 2).figure._suptitle.get_text()
    assert "yaw -90°" in plot(space, yaw=1.5 * math.pi).figure._suptitle.get_text()
    assert "over all yaws, 24 rotation cells of 15°" in plot(space).figure._suptitle.get_text()
    assert plot(space, yaw=0.0, title="mine").figure._suptitle.get_text() == "mine"
    borders = np.radians([0.0, 90.0, 100.0, 360.0])
    uneven = build(Workspace.from_array(np.eye(9, dtype=bool), 0.1), Robot.rectangle(0.2, 0.1), rotations=borders)
    assert "3 rotation cells of 10° to 260°" in plot(uneven).figure._suptitle.get_text()
    assert "10° wide" in plot(uneven, yaw=math.radians(95)).figure._suptitle.get_text()


def test_all_yaws_at_once(space: CSpace) -> None:
    ax = plot(space)
    image = rendered(ax.figure)
    yaws = space.rotations.representatives
    seen = set()
    for cell in np.random.default_rng(2).integers(0, space.grid.shape, (500, 2)):
        x, y = space.grid.center_of(cell)
        states = {space.classify((x, y, yaw)) for yaw in yaws}
        name = NAMES[min(states)]
        if states != {FREE} and FREE in states:
            name = "free at some yaws"
        if space.workspace.outer[tuple(cell)]:
            name = "obstacle"
        seen.add(name)
        assert pixel(ax, image, x, y) == color(name), (x, y)
    assert seen == {"obstacle", "free", "free at some yaws", "undecided (MIXED)", "C-obstacle (BLOCKED)"}


def test_legend_names_what_is_there(space: CSpace) -> None:
    assert labels(plot(space).figure) == [
        *("obstacle", "C-obstacle at every yaw", "undecided (MIXED)", "free at some yaws", "free at every yaw")
    ]
    assert labels(plot(space, yaw=0.0).figure) == ["obstacle", "C-obstacle (BLOCKED)", "undecided (MIXED)", "free"]
    path = [(1, 1, 0), (1, 4, 1), (7, 4, 0)]
    assert labels(plot(space, path=path).figure)[5:] == ["path", "robot", "start", "goal"]


def test_all_in_the_figure(space: CSpace) -> None:
    for figure in (plot(space, path=[(1, 1, 0), (7, 4, 1)]).figure, plot_strip(space), plot_strip(space, [0.3])):
        rendered(figure)
        boxes = [figure.legends[0].get_window_extent(), figure._suptitle.get_window_extent()]
        inside = [ax.get_tightbbox() for ax in figure.axes]
        for box in [*boxes, *inside]:
            assert 0 <= box.x0 < box.x1 <= figure.bbox.width
            assert 0 <= box.y0 < box.y1 <= figure.bbox.height
        assert not any(box.overlaps(panel) for box in boxes for panel in inside)


# ----------------------------------------------------------------------------------------------- robots that are turned


def collection(ax: Any, number: int) -> list[Any]:
    return [outline.get_extents() for outline in ax.collections[number].get_paths()]


def test_footprints_are_turned(space: CSpace) -> None:
    ax = plot(space, path=[(2, 1, math.pi / 2), (2, 4, math.pi / 2)], robot_every=1.0)
    boxes = collection(ax, 0)
    np.testing.assert_allclose([(box.x0, box.x1) for box in boxes], [(1.8, 2.2)] * 4, atol=1e-9)
    # The reference point is 0.3 m behind the middle, and the ends come last.
    np.testing.assert_allclose([box.y0 for box in boxes], np.array([2.0, 3.0, 1.0, 4.0]) - 0.3, atol=1e-9)
    np.testing.assert_allclose([box.height for box in boxes], 1.2, atol=1e-9)


def test_noses_look_ahead(space: CSpace) -> None:
    for yaw in (0.0, 2.0, -2.5):
        ax = plot(space, start=(3.0, 3.0, yaw))
        points = ax.collections[1].get_paths()[0].vertices - (3.0, 3.0)
        ahead = points @ (math.cos(yaw), math.sin(yaw))
        assert ahead.max() == pytest.approx(0.9)
        assert ahead.min() > 0.4
        np.testing.assert_allclose(points[ahead.argmax()], 0.9 * np.array([math.cos(yaw), math.sin(yaw)]))


def test_arrows_show_the_yaw(space: CSpace) -> None:
    for yaw in (0.0, 0.9, math.pi / 2, -2.5):
        ax = plot(space, goal=(3.0, 3.0, yaw), yaw=0.0)
        image = rendered(ax.figure)
        way = 0.24 * np.array([math.cos(yaw), math.sin(yaw)])
        yellow = (240, 228, 66)
        assert pixel(ax, image, *(np.array([3.0, 3.0]) + way)) == yellow
        assert pixel(ax, image, *(np.array([3.0, 3.0]) - way)) != yellow


def test_the_robot_turns_the_shorter_way(space: CSpace) -> None:
    way = along(np.array([(0.0, 0.0, 3.0), (0.0, 0.0, -3.0), (0.0, 0.0, 3.0)]), np.linspace(0, 1, 9), 1.0)
    assert (np.cos(way[:, 2]) <= np.cos(3.0) + 1e-12).all()
    np.testing.assert_allclose(np.exp(1j * way[[0, 4, 8], 2]), np.exp([3j, -3j, 3j]))
    ax = plot(space, path=[(2, 2, 3.0), (5, 2, -3.0)], robot_every=2.0)
    middle = collection(ax, 0)[0]
    np.testing.assert_allclose((middle.x0, middle.x1, middle.height), (3.5 - 0.9, 3.5 + 0.3, 0.4), atol=1e-9)


def test_a_turn_on_the_spot_is_drawn(space: CSpace) -> None:
    assert 4 <= len(collection(plot(space, path=[(3, 3, 0), (3, 3, 3.0)]), 0)) < 20
    assert len(collection(plot(space, path=[(3, 3, 0), (3, 3, 0)]), 0)) == 2


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-20, 20)), min_size=1, max_size=6))
def test_along_is_on_the_path(points: list[tuple[float, float, float]]) -> None:
    path = np.array(points)
    way = travelled(path, 0.7)
    assert (np.diff(way) >= 0).all()
    shares = np.linspace(0.0, 1.0, 7)
    found = along(path, shares, 0.7)
    np.testing.assert_allclose(found[[0, -1], :2], path[[0, -1], :2], atol=1e-9)
    np.testing.assert_allclose(shorter(found[[0, -1], 2] - path[[0, -1], 2]), 0.0, atol=1e-9)
    # An even speed: as much way lies between any two.
    np.testing.assert_allclose(np.diff(travelled(found, 0.7)) <= way[-1] / 6 + 1e-9, True)


@given(st.floats(-50, 50))
def test_degrees_are_wrapped(yaw: float) -> None:
    value = float(degrees(yaw).removesuffix("°"))
    assert -180.0 <= value <= 180.0
    assert math.cos(math.radians(value) - yaw) > 1 - 1e-5
    assert degrees(-1e-9) == "0°"
    assert degrees(-math.pi) == degrees(math.pi) == "180°"


# ----------------------------------------------------------------------------------------------- strips


def test_each_panel_shows_its_slice(space: CSpace) -> None:
    yaws = [0.0, 0.7, math.pi / 2, -2.0]
    figure = plot_strip(space, yaws)
    image = rendered(figure)
    assert len(figure.axes) == 4
    assert len(figure.legends) == 1
    for ax, yaw in zip(figure.axes, yaws, strict=True):
        assert (ax.get_xlim(), ax.get_ylim(), ax.get_aspect()) == ((0.0, 8.0), (0.0, 5.0), 1.0)
        shows_slice(space, ax, image, yaw)


def heads(figure: Any) -> list[str]:
    from matplotlib.offsetbox import AnnotationBbox, TextArea

    found = [child for ax in figure.axes for child in ax.get_children() if isinstance(child, AnnotationBbox)]
    return [text.get_text() for head in found for text in head.findobj(TextArea)]


def test_the_yaws_of_a_strip(space: CSpace) -> None:
    assert heads(plot_strip(space)) == ["0°", "60°", "120°", "180°", "-120°", "-60°"]
    assert heads(plot_strip(space, np.radians([10, 350]))) == ["10°", "-10°"]
    workspace = space.workspace
    # Half of the slices of a rectangle around its middle differ, and one of a disc's.
    assert heads(plot_strip(build(workspace, Robot.rectangle(1.0, 0.4), rotations=24))) == [
        *("0°", "30°", "60°", "90°", "120°", "150°")
    ]
    assert heads(plot_strip(build(workspace, Robot.disc(0.3), rotations=24))) == ["0°"]
    assert len(heads(plot_strip(build(workspace, Robot.rectangle(1.0, 0.4), rotations=4)))) == 2


def test_path_and_marks_in_every_panel(space: CSpace) -> None:
    figure = plot_strip(space, [0.0, 1.0], path=[(1, 1, 0), (2, 3, 1)])
    for ax in figure.axes:
        drawn = {line.get_label(): line.get_xydata().tolist() for line in ax.lines if line.get_label()[0] != "_"}
        assert drawn == {"path": [[1, 1], [2, 3]], "start": [[1, 1]], "goal": [[2, 3]]}
    assert labels(figure)[4:] == ["path", "start", "goal"]


@pytest.mark.parametrize("count", [1, 2, 3, 5, 7, 12, 64])
@pytest.mark.parametrize("shape", [(90, 20), (20, 90), (1, 200)])
def test_any_number_of_panels_of_any_shape(count: int, shape: tuple[int, int]) -> None:
    workspace = Workspace.from_array(np.zeros(shape, bool), 0.1)
    space = build(workspace, Robot.rectangle(0.2, 0.1, center=(0.03, 0.0)), rotations=8, outside="free")
    figure = plot_strip(space, np.linspace(0, 6, count))
    assert len(figure.axes) == count
    assert max(figure.get_size_inches()) < 20
    if count < 8:
        rendered(figure)
        assert all(min(ax.get_window_extent().width, ax.get_window_extent().height) > 15 for ax in figure.axes)


def test_strips_into_files(space: CSpace, tmp_path: Path) -> None:
    file = save_strip(space, tmp_path / "strip.png", dpi=60)
    assert file.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(FileError, match="exists"):
        save_strip(space, file)
    assert save_strip(space, file, overwrite=True, yaws=[0.0]) == file
    assert [entry.name for entry in tmp_path.iterdir()] == ["strip.png"]


def test_no_window(space: CSpace) -> None:
    from matplotlib import pyplot

    before = pyplot.get_fignums()
    plot_strip(space)
    assert pyplot.get_fignums() == before


# ----------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"path": [(1.0, 2.0)]}, "path has shape (1, 2); it must be (n, 3)"),
        ({"path": [1.0, 2.0, 3.0]}, "path has shape (3,)"),
        ({"path": [(1.0, 2.0, float("nan"))]}, "path[0, 2] is nan"),
        ({"start": (1.0, 2.0)}, "start has shape (2,); it must be (3,); pass one configuration (x, y, yaw)"),
        ({"goal": (1.0, 2.0, float("inf"))}, "goal[2] is inf"),
        ({"yaw": float("nan")}, "yaw is nan"),
        ({"yaw": [0.0, 1.0]}, "yaw has shape (2,)"),
        ({"yaw": 1e9}, "yaw is 1e+09"),
        ({"yaw": "north"}, "yaw is 'north'"),
    ],
)
def test_bad_input(space: CSpace, tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        save_plot(space, tmp_path / "map.png", **options)
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("yaws", "words"),
    [
        (0.0, "yaws has shape ()"),
        ([], "yaws has shape (0,)"),
        ([[0.0]], "yaws has shape (1, 1)"),
        (np.zeros(65), "n from 1 to 64"),
        ([float("nan")], "yaws[0] is nan"),
        ([1e9], "yaw is 1e+09"),
    ],
)
def test_bad_yaws(space: CSpace, tmp_path: Path, yaws: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        save_strip(space, tmp_path / "strip.png", yaws=yaws)
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_map_that_does_not_turn(flat: CSpace) -> None:
    with pytest.raises(InputError, match=r"yaw is 0\.5; the map has no rotations"):
        plot(flat, yaw=0.5)
    with pytest.raises(InputError, match="the map has no rotations"):
        plot_strip(flat)
