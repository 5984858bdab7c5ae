"""Pictures of maps in space: every drawn cell is the map's, what is hidden is behind something, no window opens."""

from __future__ import annotations

import math
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

import cspace
from cspace import BLOCKED, FREE, CSpace, Grid, Robot, Workspace, build
from cspace.errors import FileError, InputError
from cspace.plot import animate, blocks, plot, plot_strip, save_plot
from cspace.plot.artists import CLASSES
from cspace.plot.blocks import Solid
from cspace.plot.spatial import triangles_of, within

matplotlib = pytest.importorskip("matplotlib")

PATH = [(0.6, 3.2, 1.8), (2.2, 1.2, 1.0), (3.8, 1.2, 1.0), (5.5, 1.5, 0.6)]
COLORS = {label: tuple(round(255 * part) for part in matplotlib.colors.to_rgb(color)) for label, color in CLASSES}


@pytest.fixture(scope="module")
def space() -> CSpace:
    """6 m x 4 m x 2.4 m; a wall with a window at x 2.8 to 3.2, a block and a pillar: nothing is symmetric."""
    occupied = np.zeros((60, 40, 24), bool)
    occupied[28:32] = True
    occupied[28:32, 6:18, 4:16] = False
    occupied[45:52, 20:30, :14] = True
    occupied[10:16, 22:28] = True
    return build(Workspace.from_array(occupied, 0.1), Robot.box((0.5, 0.4, 0.3)))


@pytest.fixture(scope="module")
def flat() -> CSpace:
    return build(Workspace.from_array(np.eye(9, dtype=bool), 0.1), Robot.disc(0.1))


def rendered(ax: Any) -> NDArray[np.uint8]:
    """Pixels of the figure, the first row at the bottom, shape (height, width, 3)."""
    ax.figure.canvas.draw()
    return np.asarray(ax.figure.canvas.buffer_rgba())[::-1, :, :3]


def labels(ax: Any) -> list[str]:
    legends = [*ax.figure.legends, *([ax.get_legend()] if ax.get_legend() else [])]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def class_of(space: CSpace, cell: NDArray[np.int64]) -> str:
    """What a cell should show, in words."""
    state, occupied = int(space.state[tuple(cell)]), bool(space.workspace.outer[tuple(cell)])
    if occupied:
        return "obstacle, free for the reference point" if state == FREE else "obstacle"
    return {FREE: "free", BLOCKED: "C-obstacle (BLOCKED)"}.get(state, "undecided (MIXED)")


def pairs(figure: Any) -> list[tuple[int, int]]:
    """Which coordinate each panel shows to the right and up, told by the names of the axes and what they share."""
    plan, front, side = figure.axes
    names = [
        (plan.get_xlabel(), plan.get_ylabel()),
        (plan.get_xlabel(), front.get_ylabel()),
        (side.get_xlabel(), (front if "y" in side.get_xlabel() else plan).get_ylabel()),
    ]
    found = [("xyz".index(right[0]), "xyz".index(up[0])) for right, up in names]
    assert [len(set(pair)) for pair in found] == [2, 2, 2]
    return found


# --------------------------------------------------------------------------------------------------- sections


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_sections_show_the_map(order: tuple[int, ...]) -> None:
    """Every panel, in both arrangements, shows the cells of the layer that its section runs through."""
    rng = np.random.default_rng(3)
    shape = np.array([40, 30, 8])[list(order)]
    occupied = np.zeros(tuple(shape), bool)
    occupied[tuple(rng.integers(0, shape, (25, 3)).T)] = True
    lower = np.array([-3.0, 7.0, 1.0])
    space = build(Workspace.from_array(occupied, 0.5, lower), Robot.ball(0.4))
    at = lower + 0.5 * shape * (0.31, 0.62, 0.43)
    ax = plot(space, at=at)
    image, figure = rendered(ax), ax.figure
    layer = ((at - lower) / 0.5).astype(int)
    for panel, pair, across in zip(figure.axes, pairs(figure), (2, 1, 0), strict=True):
        assert {*pair, across} == {0, 1, 2}
        assert panel.get_title(loc="left") == f"{'xyz'[across]} = {round(at[across], 2):g} m"
        for cell in product(*map(range, shape[list(pair)])):
            whole = layer.copy()
            whole[list(pair)] = cell
            middle = lower + 0.5 * (whole + 0.5)
            if np.abs(middle - at)[list(pair)].min() < 0.27:
                continue  # there the other sections are drawn
            column, row = panel.transData.transform(middle[list(pair)]).astype(int)
            assert tuple(image[row, column]) == COLORS[class_of(space, whole)], (pair, whole)


def test_sections_are_to_scale_and_share_their_axes(space: CSpace) -> None:
    plan = plot(space, at=(1.0, 2.0, 0.5))
    plan.figure.canvas.draw()
    side_by_side = plan.figure.axes
    assert plan is side_by_side[0]
    for panel, pair in zip(side_by_side, pairs(plan.figure), strict=True):
        upper = np.array([6.0, 4.0, 2.4])[list(pair)]
        np.testing.assert_allclose([panel.get_xlim(), panel.get_ylim()], [(0, upper[0]), (0, upper[1])])
        box = panel.get_window_extent()
        assert (box.width / upper[0]) == pytest.approx(plan.get_window_extent().width / 6.0)
        assert (box.height / upper[1]) == pytest.approx(plan.get_window_extent().width / 6.0)
    front, side = side_by_side[1:]
    assert front.get_window_extent().x0 == pytest.approx(plan.get_window_extent().x0)
    assert front.get_window_extent().y0 > plan.get_window_extent().y1
    assert side.get_window_extent().x0 > plan.get_window_extent().x1
    plan.set_xlim(1.0, 2.0)
    assert front.get_xlim() == (1.0, 2.0)


def test_the_other_sections_are_drawn(space: CSpace) -> None:
    at = (1.03, 2.07, 0.55)
    figure = plot(space, at=at).figure
    for panel, (right, up) in zip(figure.axes, pairs(figure), strict=True):
        across, along = panel.lines[:2]
        assert set(across.get_xdata()) == {at[right]}
        assert set(along.get_ydata()) == {at[up]}


@pytest.mark.parametrize("shape", [(60, 24, 5), (8, 8, 60), (20, 20, 20), (300, 2, 1), (1, 1, 300), (1, 1, 1)])
def test_nothing_overlaps(shape: tuple[int, ...], tmp_path: Path) -> None:
    occupied = np.zeros(shape, bool)
    occupied[0, 0, 0] = True
    space = build(Workspace.from_array(occupied, 0.1), Robot.ball(0.01), outside="free")
    ax = plot(space, path=[space.grid.lower, space.grid.upper])
    figure = ax.figure
    figure.canvas.draw()
    parts = [panel.get_window_extent() for panel in figure.axes]
    assert min(min(box.width, box.height) for box in parts) > 25
    parts += [figure.legends[0].get_window_extent(), figure._suptitle.get_window_extent()]
    parts += [panel._left_title.get_window_extent() for panel in figure.axes]
    for i, one in enumerate(parts):
        assert -1 <= one.x0 < one.x1 <= figure.bbox.width + 1
        assert -1 <= one.y0 < one.y1 <= figure.bbox.height + 1
        for other in parts[:i]:
            assert not one.overlaps(other), (i, one, other)
    assert ("stretched" in figure._suptitle.get_text()) == (max(shape) / min(shape) > 24)
    assert figure.bbox.width * figure.bbox.height < 2_500_000
    save_plot(space, tmp_path / "map.png")


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_parts_of_a_path(data: st.DataObject) -> None:
    """A point of the path is on a drawn part where its coordinate lies between the two, and only there."""
    points = data.draw(arrays(np.float64, st.tuples(st.integers(2, 6), st.just(3)), elements=st.integers(-4, 4)))
    axis = data.draw(st.integers(0, 2))
    low, high = sorted(data.draw(st.tuples(st.integers(-5, 5), st.integers(-5, 5))))
    parts = within(points, axis, low, high).reshape(-1, 3, 3)
    assert np.isnan(parts[:, 2]).all()
    assert not np.isnan(parts[:, :2]).any()
    assert (parts[:, :2, axis] >= low - 1e-9).all()
    assert (parts[:, :2, axis] <= high + 1e-9).all()
    lengths = np.linalg.norm(parts[:, 1] - parts[:, 0], axis=1)
    whole = 0.0
    for a, b in pairwise(points):
        steps = a[axis] + (np.arange(4000) + 0.5) / 4000 * (b[axis] - a[axis])
        whole += np.linalg.norm(b - a) * ((low <= steps) & (steps <= high)).mean()
    assert lengths.sum() == pytest.approx(whole, abs=0.02 * len(points))


def test_path_and_robots_in_sections(space: CSpace) -> None:
    """Solid, with the robot, where the robot reaches the section; faint elsewhere."""
    ax = plot(space, path=PATH, at=(3.0, 1.2, 1.0), robot_every=0.5)
    for panel, pair, across in zip(ax.figure.axes, pairs(ax.figure), (2, 1, 0), strict=True):
        drawn = {line.get_label(): line.get_xydata() for line in panel.lines}
        np.testing.assert_array_equal(drawn["path, away from the section"], np.array(PATH)[:, pair])
        np.testing.assert_array_equal(drawn["start"], [np.array(PATH[0])[list(pair)]])
        np.testing.assert_array_equal(drawn["goal"], [np.array(PATH[-1])[list(pair)]])
        half = np.array([0.25, 0.2, 0.15])
        at = np.array([3.0, 1.2, 1.0])
        expected = within(np.array(PATH), across, at[across] - half[across], at[across] + half[across])
        np.testing.assert_allclose(drawn["path"], expected[:, pair])
        boxes = [outline.get_extents() for outline in panel.collections[0].get_paths()]
        np.testing.assert_allclose([(box.width, box.height) for box in boxes], [2 * half[list(pair)]] * len(boxes))
    side = ax.figure.axes[2].collections[0].get_paths()
    assert 1 <= len(side) < len(ax.figure.axes[1].collections[0].get_paths())
    assert labels(ax)[-5:] == ["path", "path, away from the section", "robot", "start", "goal"]


def sections_of(ax: Any) -> list[float]:
    return [float(panel.get_title(loc="left")[4:-2]) for panel in reversed(ax.figure.axes)]


def test_where_sections_run(space: CSpace) -> None:
    """Through what the caller names; else where most of the path is, the start, the goal, or a FREE cell."""
    assert sections_of(plot(space, at=(1.0, 2.0, 0.5))) == [1.0, 2.0, 0.5]
    found = sections_of(plot(space, path=[(1.0, 1.0, 0.5), (1.0, 3.0, 0.5), (1.0, 3.0, 1.0), (2.0, 3.0, 1.0)]))
    assert found[0] == pytest.approx(1.0, abs=0.26)
    assert found[1] == pytest.approx(3.0, abs=0.21)
    assert found[2] == pytest.approx(0.5, abs=0.16)
    assert sections_of(plot(space, start=(1.0, 3.0, 2.0), goal=(5.0, 1.0, 1.0))) == [1.0, 3.0, 2.0]
    assert sections_of(plot(space, goal=(5.0, 1.0, 1.0))) == [5.0, 1.0, 1.0]
    assert space.is_free(sections_of(plot(space)))
    full = build(Workspace.from_array(np.ones((4, 4, 4), bool), 1.0), Robot.ball(0.1))
    assert sections_of(plot(full)) == [2.5, 2.5, 2.5]
    assert sections_of(plot(space, path=[(-9.0, 1.0, 1.0), (-8.0, 1.0, 1.0)]))[0] == 0.0


def test_sections_without_words(space: CSpace) -> None:
    ax = plot(space, legend=False, title="")
    assert labels(ax) == []
    assert ax.figure._suptitle.get_text() == ""
    assert plot(space, title="mine").figure._suptitle.get_text() == "mine"
    assert plot(space).figure._suptitle.get_text() == "box 0.5 m x 0.4 m x 0.3 m, cells of 0.1 m"


# --------------------------------------------------------------------------------------------------- faces

GRID = Grid((-1.0, 2.0, 0.5), 0.5, (5, 4, 3))
TOWARDS = np.array([0.6, -0.5, 0.7])


def solid_of(classes: NDArray[np.uint8], towards: Any = TOWARDS, cut: dict[int, float] | None = None) -> Solid:
    return Solid(Grid(GRID.lower, 0.5, classes.shape), classes, 2, np.asarray(towards, float), cut or {})


cells = arrays(np.uint8, st.tuples(*[st.integers(1, 5)] * 3), elements=st.integers(0, 3))
directions = st.tuples(*[st.sampled_from([-1.0, -0.4, 0.0, 0.3, 1.0])] * 3).filter(any)


@settings(max_examples=100, deadline=None)
@given(cells, directions)
def test_faces_are_those_that_the_camera_sees(classes: NDArray[np.uint8], towards: tuple[float, ...]) -> None:
    faces = solid_of(classes, towards).faces()
    expected = set()
    for cell in product(*map(range, classes.shape)):
        for axis, side in enumerate(towards):
            if classes[cell] < 2 or side == 0.0:
                continue
            step = 1 if side > 0.0 else -1
            next_cell = tuple(c + step * (k == axis) for k, c in enumerate(cell))
            place = 2 * np.array(cell) + 1 + step * (np.arange(3) == axis)
            face = (*place.tolist(), axis, int(classes[cell]))
            if not 0 <= next_cell[axis] < classes.shape[axis]:
                if (classes.take(cell[axis], axis) >= 2).mean() < 0.5:
                    expected.add((*face, True))
            elif classes[next_cell] < 2:
                expected.add((*face, False))
    middles = (faces.corners.mean(axis=1) - GRID.lower) / 0.5 * 2
    found = {
        (*np.rint(middle).astype(int).tolist(), int(axis), int(kind), bool(cut))
        for middle, axis, kind, cut in zip(middles, faces.axes, faces.classes, faces.cut, strict=True)
    }
    assert found == expected
    assert len(faces.corners) == len(expected)
    spans = np.ptp(faces.corners, axis=1)
    np.testing.assert_allclose(spans, np.where(np.arange(3) == faces.axes[:, None], 0.0, 0.5))
    # The corners go round: neighbours differ along one axis.
    assert ((np.diff(faces.corners, axis=1) != 0.0).sum(axis=2) == 1).all()


@settings(max_examples=100, deadline=None)
@given(cells, directions, st.integers(0, 2**32 - 1))
def test_what_is_hidden_is_behind_a_face(classes: NDArray[np.uint8], towards: tuple[float, ...], seed: int) -> None:
    """The walk from cell to cell agrees with rays that are cut with every face."""
    solid = solid_of(classes, towards)
    faces, rng = solid.faces(), np.random.default_rng(seed)
    low, high = np.array(GRID.lower), np.array(GRID.lower) + 0.5 * np.array(classes.shape)
    points = rng.uniform(low - 0.7, high + 0.7, (40, 3))
    direction = np.array(towards)
    expected = np.zeros(len(points), bool)
    for corners, axis in zip(faces.corners, faces.axes, strict=True):
        share = (corners[0, axis] - points[:, axis]) / direction[axis]
        meets = points + share[:, None] * direction
        others = [k for k in range(3) if k != axis]
        on = (meets[:, others] > corners[:, others].min(axis=0)) & (meets[:, others] < corners[:, others].max(axis=0))
        expected |= (share > 0.0) & on.all(axis=1)
    np.testing.assert_array_equal(solid.hides(points), expected)


@pytest.mark.parametrize("most", [10, 40, 200])
def test_blocks_lose_nothing(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """Few enough faces, and every cell that is solid lies in a block that is, with a class as large."""
    monkeypatch.setattr(blocks, "MOST", most)
    classes = np.zeros((23, 17, 11), np.uint8)
    rng = np.random.default_rng(most)
    classes[tuple(rng.integers(0, classes.shape, (250, 3)).T)] = rng.integers(1, 4, 250)
    faces = solid_of(classes, (0.3, 0.4, 0.8)).faces()
    assert 0 < len(faces.corners) <= most
    assert faces.side > 1
    upper = np.array(GRID.lower) + 0.5 * np.array(classes.shape)
    assert (faces.corners >= GRID.lower).all()
    assert (faces.corners <= upper).all()
    # The face on top of a solid cell's column of blocks hides the cell from above.
    above = solid_of(classes, (0.0, 0.0, 1.0))
    tops = above.faces()
    for cell in np.argwhere(classes >= 2):
        middle = np.array(GRID.lower) + 0.5 * (cell + 0.5)
        low, high = tops.corners.min(axis=1), tops.corners.max(axis=1)
        over = ((low <= middle) & (middle <= high))[:, :2].all(axis=1) & (low[:, 2] >= middle[2])
        assert over.any()


def test_cuts() -> None:
    classes = np.full((5, 4, 3), 3, np.uint8)
    faces = solid_of(classes, TOWARDS, {2: 1.4}).faces()
    # Cells from 0.5 to 1 and from 1 to 1.5: the plane runs through the second, which stays.
    assert set(faces.corners[:, :, 2].ravel()) == {1.5}
    assert faces.cut.all()
    faces = solid_of(classes, TOWARDS, {2: 1.0, 1: 3.0}).faces()
    top, front = faces.corners[faces.axes == 2], faces.corners[faces.axes == 1]
    assert set(top[..., 2].ravel()) == {1.0}
    assert set(front[..., 1].ravel()) == {3.0}
    assert top[..., 1].min() == 3.0  # the camera is on the side of small y
    assert len(solid_of(classes, TOWARDS, {2: 0.5}).faces().corners) == 20  # one layer is left at least


# --------------------------------------------------------------------------------------------------- three dimensions


def polygons(ax: Any) -> list[NDArray[np.float64]]:
    return [np.asarray(collection._faces) for collection in ax.collections]


@pytest.mark.parametrize("surface", ["obstacles", "free"])
def test_the_scene_is_the_map(space: CSpace, surface: str) -> None:
    """Cells before and behind each face, on the side of the camera, are as they should be."""
    ax = plot(space, view="3d", surface=surface, cut={"z": 1.75}, camera=(30.0, -60.0))
    assert (ax.name, ax.elev, ax.azim) == ("3d", 30.0, -60.0)
    solid = space.workspace.outer if surface == "obstacles" else space.state != FREE
    faces = polygons(ax)[0]
    assert faces.shape[1:] == (4, 3)
    assert faces[..., 2].max() == pytest.approx(1.8)
    towards = np.array([1, -1, 1])
    seen = cut = 0
    for corners, color in zip(faces, ax.collections[0]._facecolor3d, strict=True):
        axis = int(np.ptp(corners, axis=0).argmin())
        push = 0.05 * towards * (np.arange(3) == axis)
        behind, before = (space.grid.cell_of(corners.mean(axis=0) + push * sign) for sign in (-1, 1))
        assert solid[tuple(behind)]
        at_end = corners[0, axis] == pytest.approx([6.0, 0.0, 1.8][axis])
        cut += at_end
        seen += not at_end
        shown = tuple(np.rint(255 * color[:3]).astype(int).tolist())
        assert (shown == COLORS[class_of(space, behind)]) == at_end
        assert at_end or not solid[tuple(before)]
    kept = solid[:, :, :18]
    assert seen == sum(
        np.count_nonzero(a & ~b)
        for a, b in [
            (kept[:-1], kept[1:]),
            (kept[:, 1:], kept[:, :-1]),
            (kept[:, :, :-1], kept[:, :, 1:]),
        ]
    )
    assert cut >= np.count_nonzero(kept[:, :, -1])


def test_faces_are_drawn_in_the_right_order() -> None:
    """A face of which the middle is not behind another shows in its own colour there."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    rng = np.random.default_rng(1)
    workspace = Workspace.from_array(rng.random((9, 6, 4)) < 0.25, 1.0)
    ax = plot(build(workspace, Robot.ball(0.1)), view="3d", cut={}, camera=(35.0, -50.0))
    image = rendered(ax)
    collection = ax.collections[0]
    classes = np.where(workspace.outer, 5, 0).astype(np.uint8)
    camera = np.radians([35.0, -50.0])
    across = np.cos(camera[0])
    towards = np.array([across * np.cos(camera[1]), across * np.sin(camera[1]), np.sin(camera[0])])
    solid = Solid(workspace.grid, classes, 5, towards, {})
    middles = np.asarray(collection._faces).mean(axis=1)
    hidden = solid.hides(middles + 1e-6 * towards)
    assert np.count_nonzero(~hidden) > 20
    assert np.count_nonzero(hidden) > 20
    colors = {tuple(np.round(middle, 6)): color for middle, color in zip(middles, collection._facecolor3d, strict=True)}
    for middle in middles[~hidden]:
        column, row = ax.transData.transform(proj_transform(*middle, ax.get_proj())[:2]).astype(int)
        expected = np.rint(255 * np.asarray(colors[tuple(np.round(middle, 6))])[:3])
        np.testing.assert_allclose(image[row, column], expected, atol=2)


def test_the_path_in_the_scene(space: CSpace) -> None:
    """Solid where nothing stands before it; the robots are at the stations."""
    ax = plot(space, view="3d", path=PATH, robot_every=1.0, cut={}, camera=(20.0, -90.0 + 28.0))
    drawn = {line.get_label(): np.transpose(line.get_data_3d()) for line in ax.lines}
    assert list(drawn) == ["path, behind something", "path", "start", "goal"]
    whole, seen = drawn["path, behind something"], drawn["path"]
    for corner in PATH:
        assert np.isclose(whole, corner).all(axis=1).any()
    np.testing.assert_array_equal(drawn["start"], [PATH[0]])
    np.testing.assert_array_equal(drawn["goal"], [PATH[-1]])
    assert len(whole) == len(seen)
    hidden = np.isnan(seen).any(axis=1)
    assert 0 < hidden.sum() < len(seen)
    np.testing.assert_array_equal(seen[~hidden], whole[~hidden])
    robots = polygons(ax)[1]
    lengths = np.linalg.norm(np.diff(PATH, axis=0), axis=1)
    count = math.ceil(lengths.sum() / 1.0) - 1 + 2
    each = len(robots) // count
    assert len(robots) == count * each
    centers = robots.reshape(count, -1, 3)
    np.testing.assert_allclose(np.ptp(centers, axis=1), [[0.5, 0.4, 0.3]] * count, atol=1e-9)
    middles = (centers.min(axis=1) + centers.max(axis=1)) / 2
    np.testing.assert_allclose(middles[-2:], [PATH[0], PATH[-1]], atol=1e-9)
    assert labels(ax)[-4:] == ["path, behind something", "robot", "start", "goal"]
    alone = plot(space, view="3d", path=PATH, surface="free")
    assert len(alone.collections) == 1
    assert "robot" not in labels(alone)


def test_the_camera_finds_the_path() -> None:
    """Beside a wall the camera stands where it sees the path; under a roof the roof is cut away."""
    occupied = np.zeros((30, 30, 12), bool)
    occupied[:, 8:10] = True
    space = build(Workspace.from_array(occupied, 0.1), Robot.box((0.2, 0.2, 0.2)), outside="free")
    for y, side in ((0.4, -1.0), (1.2, 1.0)):
        ax = plot(space, view="3d", path=[(0.4, y, 0.3), (2.6, y, 0.3)])
        assert math.sin(math.radians(ax.azim)) * side > 0.0
        assert "path, behind something" not in labels(ax)
    occupied[:, :, 10:] = True
    under = build(Workspace.from_array(occupied, 0.1), Robot.box((0.2, 0.2, 0.2)))
    ax = plot(under, view="3d", path=[(0.4, 0.4, 0.3), (2.6, 0.4, 0.3)], camera=(60.0, -62.0))
    assert "path, behind something" not in labels(ax)
    lidded = np.pad(occupied, ((0, 0), (0, 0), (0, 6)))
    roofed = build(Workspace.from_array(lidded, 0.1), Robot.box((0.2, 0.2, 0.2)))
    options: dict[str, Any] = {"view": "3d", "path": [(0.4, 0.4, 0.3), (2.6, 0.4, 0.3)], "camera": (60.0, -62.0)}
    assert "path, behind something" not in labels(plot(roofed, **options))
    assert "path, behind something" in labels(plot(roofed, cut={}, **options))


def test_the_picture_fits(space: CSpace) -> None:
    """The box, as drawn, fills the width, and legend and title lie beside it."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    for shown in (space, build(Workspace.from_array(np.eye(40, dtype=bool)[:, :8, None], 0.1), Robot.ball(0.1))):
        ax = plot(shown, view="3d")
        ax.figure.canvas.draw()
        corners = np.stack(np.meshgrid(*zip(shown.grid.lower, shown.grid.upper, strict=True)), axis=-1).reshape(-1, 3)
        pixels = ax.transData.transform(np.transpose(proj_transform(*corners.T, ax.get_proj())[:2]))
        width, height = ax.figure.bbox.width, ax.figure.bbox.height
        assert 0.0 < pixels.min() < pixels[:, 0].max() < width
        assert np.ptp(pixels[:, 0]) > 0.6 * width
        legend, title = ax.figure.legends[0].get_window_extent(), ax.figure._suptitle.get_window_extent()
        assert legend.y1 < pixels[:, 1].min()
        assert pixels[:, 1].max() < title.y0
        for box in (legend, title, *(axis.label.get_window_extent() for axis in (ax.xaxis, ax.yaxis, ax.zaxis))):
            assert -1 <= box.x0 < box.x1 <= width + 1
            assert -1 <= box.y0 < box.y1 <= height + 1


def test_axes_of_the_caller(space: CSpace) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4))
    left, right = (figure.add_subplot(1, 2, n, projection="3d") for n in (1, 2))
    assert plot(space, view="3d", ax=right) is right
    assert not left.collections
    assert len(right.collections) == 1
    assert "box" in right.get_title()
    assert not figure.legends
    assert labels(right)
    assert plot(space, view="3d", ax=left, title="mine", legend=False).get_title() == "mine"
    assert labels(left) == []


def test_triangles_of_robots() -> None:
    for robot in (Robot.box((0.5, 0.4, 0.3)), Robot.ball(0.3), Robot.balls(np.eye(3), [0.2, 0.1, 0.3])):
        found = triangles_of(robot)
        lower, upper = robot.body.bounds
        assert 400 < len(found) < 5000
        np.testing.assert_allclose(found.min(axis=(0, 1)), lower, atol=0.02)
        np.testing.assert_allclose(found.max(axis=(0, 1)), upper, atol=0.02)
    fine = Robot.balls(np.random.default_rng(0).uniform(-1, 1, (60, 3)), np.full(60, 0.3))
    assert len(fine.surface[1]) > 50_000
    found = triangles_of(fine)
    assert 400 < len(found) <= 2000
    lower, upper = fine.body.bounds
    assert np.abs(found.min(axis=(0, 1)) - lower).max() < 0.5
    assert np.abs(found.max(axis=(0, 1)) - upper).max() < 0.5
    ax = plot(build(Workspace.from_array(np.zeros((9, 9, 9), bool), 1.0), fine), start=(4.5, 4.5, 4.5))
    for panel in ax.figure.axes:
        box = panel.collections[0].get_paths()[0].get_extents()
        assert (box.width, box.height) == pytest.approx((upper - lower)[[0, 1]], abs=0.3)


def test_empty_scenes() -> None:
    for occupied in (np.zeros((4, 4, 4), bool), np.ones((4, 4, 4), bool)):
        space = build(Workspace.from_array(occupied, 1.0), Robot.ball(0.1), outside="free")
        for surface in ("obstacles", "free"):
            rendered(plot(space, view="3d", surface=surface))
            rendered(plot(space, view="3d", surface=surface, path=[(1.0, 1.0, 1.0)], camera=(90.0, 0.0)))


# --------------------------------------------------------------------------------------------------- files and input


@pytest.mark.parametrize("view", ["sections", "3d"])
def test_files(space: CSpace, tmp_path: Path, view: str) -> None:
    from matplotlib import pyplot

    before = pyplot.get_fignums()
    for suffix in (".png", ".pdf", ".svg"):
        file = save_plot(space, tmp_path / f"map{suffix}", view=view, path=PATH)
        assert 5_000 < file.stat().st_size < 1_000_000
    with pytest.raises(FileError, match="exists"):
        save_plot(space, tmp_path / "map.png", view=view)
    save_plot(space, tmp_path / "map.png", True, view=view)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["map.pdf", "map.png", "map.svg"]
    assert pyplot.get_fignums() == before


def test_large_maps_are_drawn_with_few_faces(tmp_path: Path) -> None:
    occupied = np.zeros((160, 160, 160), bool)
    rng = np.random.default_rng(0)
    for low in rng.integers(0, 130, (60, 3)):
        occupied[tuple(map(slice, low, low + rng.integers(5, 26, 3)))] = True
    space = build(Workspace.from_array(occupied, 0.02), Robot.ball(0.1))
    path = space.sample_free(5, np.random.default_rng(1))
    for number, options in enumerate([{}, {"view": "3d"}, {"view": "3d", "surface": "free"}]):
        file = save_plot(space, tmp_path / f"{number}.png", path=path, **options)
        assert file.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"path": [(1.0, 2.0)]}, "path has shape (1, 2); it must be (n, 3); pass one configuration (x, y, z)"),
        ({"start": (1.0, 2.0)}, "start has shape (2,)"),
        ({"yaw": 0.5}, "yaw is given; the map is one of space"),
        ({"view": "top"}, "view is 'top'; it must be one of 'sections', '3d'"),
        ({"at": (1.0, 2.0)}, "at has shape (2,)"),
        ({"at": (1.0, 2.0, float("nan"))}, "at[2] is nan"),
        ({"at": (1.0, 2.0, 3.0)}, "at is (1, 2, 3) m; it must lie in the grid"),
        ({"cut": {"z": 1.0}}, 'cut is given; it goes with view="3d"'),
        ({"camera": (30, 40)}, 'camera is given; it goes with view="3d"'),
        ({"surface": "free"}, 'surface is given; it goes with view="3d"'),
        ({"view": "3d", "at": (1.0, 1.0, 1.0)}, 'at is given; it goes with view="sections"'),
        ({"view": "3d", "surface": "walls"}, "surface is 'walls'; it must be one of 'obstacles', 'free'"),
        ({"view": "3d", "cut": {"w": 1.0}}, "it must be a mapping from 'x', 'y' or 'z'"),
        ({"view": "3d", "cut": 1.0}, "it must be a mapping from 'x', 'y' or 'z'"),
        ({"view": "3d", "cut": {"z": 3.0}}, "cut['z'] is 3.0; it must be one number from 0 to 2.4"),
        ({"view": "3d", "cut": {"z": float("nan")}}, "cut['z'] is nan"),
        ({"view": "3d", "camera": 30.0}, "camera is 30.0; it must be (elevation, azimuth)"),
        ({"view": "3d", "camera": (91.0, 0.0)}, "the elevation from -90 to 90"),
        ({"view": "3d", "robot_every": 0.0, "path": PATH}, "robot_every is 0.0"),
    ],
)
def test_bad_input(space: CSpace, tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        save_plot(space, tmp_path / "map.png", **options)
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"view": "3d"}, "the map is one of the plane"),
        ({"at": (1.0, 1.0, 1.0)}, "the map is one of the plane"),
        ({"cut": {}}, "the map is one of the plane"),
        ({"surface": "free"}, "the map is one of the plane"),
        ({"camera": (1.0, 1.0)}, "the map is one of the plane"),
    ],
)
def test_options_for_space_in_the_plane(flat: CSpace, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        plot(flat, **options)


def test_axes_that_do_not_fit(space: CSpace, flat: CSpace) -> None:
    ax = plot(flat)
    with pytest.raises(InputError, match="figure of their own"):
        plot(space, ax=ax)
    with pytest.raises(InputError, match="two dimensions"):
        plot(space, view="3d", ax=ax)


def test_only_in_the_plane(space: CSpace, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="60 x 40 x 24 cells in space; a strip"):
        plot_strip(space)
    with pytest.raises(InputError, match="in space; an animation"):
        animate(space, PATH, tmp_path / "path.gif")
    assert list(tmp_path.iterdir()) == []


def test_by_the_map_itself(space: CSpace) -> None:
    assert isinstance(space, cspace.CSpace)
    assert space.plot(view="3d", cut={"z": 1.0}).name == "3d"
    assert len(space.plot(at=(1.0, 1.0, 1.0)).figure.axes) == 3
