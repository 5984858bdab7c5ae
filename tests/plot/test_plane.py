"""Pictures: nothing is lost, nothing is turned round, no window opens."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

import cspace
from cspace import CSpace, Grid, Robot, Workspace, build
from cspace.errors import FileError, InputError
from cspace.plot import plot, save_plot
from cspace.plot.artists import CLASSES
from cspace.plot.cell_image import CellImage, coarsen
from cspace.plot.view import rings

matplotlib = pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def space() -> CSpace:
    """8 m by 5 m, walls all round, and a block that touches no symmetry: x 5 to 6.5, y 1 to 2."""
    occupied = np.zeros((80, 50), bool)
    occupied[[0, -1], :] = True
    occupied[:, [0, -1]] = True
    occupied[50:65, 10:20] = True
    return build(Workspace.from_array(occupied, 0.1), Robot.disc(0.32))


def rendered(ax: Any) -> NDArray[np.uint8]:
    """Pixels of the figure, the first row at the bottom as in display coordinates, shape (height, width, 3)."""
    ax.figure.canvas.draw()
    return np.asarray(ax.figure.canvas.buffer_rgba())[::-1, :, :3]


def pixel(ax: Any, image: NDArray[np.uint8], x: float, y: float) -> tuple[int, ...]:
    """The pixel that shows a point given in metres."""
    column, row = ax.transData.transform((x, y))
    return tuple(image[int(row), int(column)].tolist())


def color(label: str) -> tuple[int, ...]:
    from matplotlib.colors import to_rgb

    return tuple(round(255 * part) for part in to_rgb(dict(CLASSES)[label]))


def labels(ax: Any) -> list[str]:
    legends = [*ax.figure.legends, *([ax.get_legend()] if ax.get_legend() else [])]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def test_metres_and_turns(space: CSpace) -> None:
    ax = plot(space)
    image = rendered(ax)
    assert ax.get_xlim() == (0.0, 8.0)
    assert ax.get_ylim() == (0.0, 5.0)
    assert ax.get_aspect() == 1.0
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (m)", "y (m)")
    assert pixel(ax, image, 5.75, 1.5) == color("obstacle")
    for x, y in [(2.25, 1.5), (5.75, 3.5), (2.25, 3.5), (1.5, 4.25)]:
        assert pixel(ax, image, x, y) == color("free")
    assert pixel(ax, image, 4.85, 1.5) == color("C-obstacle (BLOCKED)")
    mixed = np.argwhere(space.state == cspace.MIXED)
    for x, y in space.grid.center_of(mixed[:: len(mixed) // 20]):
        assert pixel(ax, image, x, y) == color("undecided (MIXED)")


def test_legend_names_what_is_there(space: CSpace) -> None:
    assert labels(plot(space)) == ["obstacle", "C-obstacle (BLOCKED)", "undecided (MIXED)", "free"]
    ax = plot(space, path=[(1, 1), (1, 4), (7, 4)])
    assert labels(ax)[4:] == ["path", "robot", "start", "goal"]
    assert labels(plot(space, start=(1, 1)))[4:] == ["robot", "start"]
    assert labels(plot(space, legend=False)) == []


def test_legend_hides_nothing(space: CSpace) -> None:
    for shown in (space, build(Workspace.from_array(space.workspace.outer.T, 0.1), Robot.disc(0.32))):
        ax = plot(shown, path=[(1, 1), (1, 2)])
        ax.figure.canvas.draw()
        legend = ax.figure.legends[0].get_window_extent()
        assert not legend.overlaps(ax.get_window_extent())
        assert not legend.overlaps(ax.xaxis.label.get_window_extent())
        for box in (legend, ax.get_window_extent(), ax.figure._suptitle.get_window_extent()):
            assert 0 <= box.x0 < box.x1 <= ax.figure.bbox.width
            assert 0 <= box.y0 < box.y1 <= ax.figure.bbox.height


def test_path_and_marks_are_where_they_belong(space: CSpace) -> None:
    path = [(1.0, 1.0), (1.0, 4.0), (7.0, 4.0)]
    ax = plot(space, path=path)
    drawn = {line.get_label(): line.get_xydata().tolist() for line in ax.lines}
    assert drawn == {"path": [list(q) for q in path], "start": [[1.0, 1.0]], "goal": [[7.0, 4.0]]}


def test_a_plan_is_taken_for_its_path(space: CSpace) -> None:
    class Found:
        path = np.array([(1.0, 1.0), (2.0, 3.0)])

    assert plot(space, path=Found()).lines[0].get_xydata().tolist() == [[1.0, 1.0], [2.0, 3.0]]


def test_robots_along_the_path(space: CSpace) -> None:
    ax = plot(space, path=[(1, 1), (1, 4), (7, 4)], robot_every=1.0)
    boxes = [outline.get_extents() for outline in ax.collections[0].get_paths()]
    middles = np.array([[(box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2] for box in boxes])
    between = [(1, 2), (1, 3), (1, 4), (2, 4), (3, 4), (4, 4), (5, 4), (6, 4)]
    np.testing.assert_allclose(middles, [*between, (1, 1), (7, 4)], atol=1e-9)
    np.testing.assert_allclose([box.width for box in boxes], 0.64, atol=1e-9)
    assert len(plot(space, path=[(1, 1), (7, 4)], robot_every=float("inf")).collections[0].get_paths()) == 2
    assert 5 < len(plot(space, path=[(1, 1), (7, 4)]).collections[0].get_paths()) < 20


def test_holes_of_the_robot_stay_open() -> None:
    shapely = pytest.importorskip("shapely")
    ring = shapely.box(-1.0, -1.0, 1.0, 1.0) - shapely.box(-0.8, -0.8, 0.8, 0.8)
    space = build(Workspace.from_array(np.zeros((60, 60), bool), 0.1, lower=(-3.0, -3.0)), Robot.polygon(ring))
    ax = plot(space, start=(0.3, 0.2))
    image = rendered(ax)
    assert pixel(ax, image, 0.3, 0.9) == color("free")
    assert pixel(ax, image, 0.3, 1.1) != color("free")


def test_holes_run_the_other_way() -> None:
    shapely = pytest.importorskip("shapely")
    square = [(0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0)]
    hole = [(1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)]
    for inside in (hole, hole[::-1]):
        drawn = rings(shapely.Polygon(square, [inside]))
        assert [shapely.LinearRing(ring).is_ccw for ring in drawn] == [True, False]


def test_a_path_of_one_configuration(space: CSpace) -> None:
    ax = plot(space, path=[(1.0, 1.0)])
    rendered(ax)
    assert len(ax.collections[0].get_paths()) == 2


def test_the_view_reaches_what_lies_outside() -> None:
    workspace = Workspace.from_array(np.eye(20, dtype=bool), 0.1)
    space = build(workspace, Robot.disc(0.1), outside="free")
    ax = plot(space, path=[(1.5, 0.2), (-1.0, 0.2)])
    assert ax.get_xlim()[0] == pytest.approx(-1.1)
    assert ax.get_ylim() == (0.0, 2.0)
    assert pixel(ax, rendered(ax), -0.5, 1.0) == color("free")


def test_obstacles_that_the_reference_point_may_enter() -> None:
    occupied = np.zeros((60, 20), bool)
    occupied[20:24] = True
    space = build(Workspace.from_array(occupied, 0.1), Robot.disc(0.3, center=(2.0, 0.0)), outside="free")
    assert (space.state[20:24] == cspace.FREE).all()
    ax = plot(space)
    assert "obstacle, free for the reference point" in labels(ax)
    assert pixel(ax, rendered(ax), 2.2, 1.0) == color("obstacle, free for the reference point")


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (2, 3), (900, 30)])
def test_any_shape_draws(shape: tuple[int, int], tmp_path: Path) -> None:
    space = build(Workspace.from_array(np.zeros(shape, bool), 0.1), Robot.disc(0.01), outside="free")
    ax = plot(space, start=space.grid.center_of((0, 0)))
    image = rendered(ax)
    box = ax.get_window_extent()
    assert min(box.width, box.height) > 60
    words = ax.figure._suptitle.get_text()
    assert ("stretched" in words) == (max(shape) / min(shape) > 12)
    assert image.shape[0] * image.shape[1] < 2_000_000
    save_plot(space, tmp_path / "map.png")


def test_axes_of_the_caller(space: CSpace) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4))
    left, right = figure.subplots(1, 2)
    assert plot(space, ax=right) is right
    assert not left.images
    assert len(right.images) == 1
    assert "disc" in right.get_title()
    assert not figure.legends
    assert right.get_legend() is not None
    assert plot(space, ax=left, title="mine").get_title() == "mine"


def test_no_window(space: CSpace) -> None:
    from matplotlib import pyplot

    before = pyplot.get_fignums()
    plot(space)
    assert pyplot.get_fignums() == before


def test_without_a_display(tmp_path: Path) -> None:
    code = (
        "import sys, numpy as np\n"
        "from cspace import Robot, Workspace, build\n"
        "from cspace.plot import save_plot\n"
        "save_plot(build(Workspace.from_array(np.eye(9, dtype=bool), 0.1), Robot.disc(0.1)), 'map.png')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    root = str(Path(cspace.__file__).parents[1])
    environment = {"PATH": "", "PYTHONPATH": root, "MPLBACKEND": "tkagg", "HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_colors_part_in_grey_print() -> None:
    from matplotlib.colors import to_rgb

    # Perceived lightness L* of CIELAB, 0 to 100.
    lightness = []
    for _, name in CLASSES:
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in to_rgb(name)]
        lightness.append(116 * float(np.dot([0.2126, 0.7152, 0.0722], linear)) ** (1 / 3) - 16)
    assert np.diff(sorted(lightness)).min() > 7
    main = sorted(
        value
        for value, (label, _) in zip(lightness, CLASSES, strict=True)
        if "reference" not in label and "some" not in label
    )
    assert np.diff(main).min() > 15


# ----------------------------------------------------------------------------------------------- large maps


@given(st.data())
def test_coarse_cells_hold_the_largest_class(data: st.DataObject) -> None:
    shape = data.draw(st.tuples(st.integers(1, 23), st.integers(1, 23)))
    classes = data.draw(arrays(np.uint8, shape, elements=st.integers(0, 4)))
    counts = data.draw(st.tuples(*(st.integers(1, n) for n in shape)))
    coarse = coarsen(classes, counts)
    assert coarse.shape == counts
    starts = [[i * n // m for i in range(m + 1)] for n, m in zip(shape, counts, strict=True)]
    for i, j in np.ndindex(coarse.shape):
        assert coarse[i, j] == classes[starts[0][i] : starts[0][i + 1], starts[1][j] : starts[1][j + 1]].max()


def cells(classes: NDArray[np.uint8], size: tuple[int, int], view: list[float]) -> tuple[Any, NDArray[np.uint8]]:
    """Axes of a size in pixels that show nothing but cells of side 0.5 from (-3, 7), and their pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0.033, 0.071, 0.9, 0.87))
    ax.set_axis_off()
    colors = np.array([[255, 255, 255], [0, 0, 0]], np.uint8)
    ax.add_image(CellImage(ax, classes, colors, Grid((-3.0, 7.0), 0.5, classes.shape)))
    ax.set_xlim(view[0], view[1])
    ax.set_ylim(view[2], view[3])
    return ax, rendered(ax)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_no_blocked_cell_vanishes(data: st.DataObject) -> None:
    """Whatever the size of the map, of the picture and of the view: each cell in view darkens a pixel near it."""
    shape = data.draw(st.tuples(st.integers(1, 1200), st.integers(1, 1200)))
    corner = st.tuples(st.integers(0, shape[0] - 1), st.integers(0, shape[1] - 1))
    blocked = data.draw(st.lists(corner, min_size=1, max_size=5))
    size = data.draw(st.tuples(st.integers(30, 400), st.integers(30, 400)))
    a, b = data.draw(corner), data.draw(corner)
    classes = np.zeros(shape, np.uint8)
    classes[tuple(np.transpose(blocked))] = 1
    low, high = np.minimum(a, b), np.maximum(a, b) + 1
    # The view may cut the cells at its border, which then need not show.
    cut = data.draw(st.sampled_from([0.0, 0.1, 0.9]))
    view = [-3.0 + 0.5 * (low[0] - cut), -3.0 + 0.5 * high[0], 7.0 + 0.5 * low[1], 7.0 + 0.5 * (high[1] + cut)]
    ax, image = cells(classes, size, view)
    dark = (image < 128).all(axis=-1)
    for i, j in blocked:
        if (low <= (i, j)).all() and ((i, j) < high).all():
            corners = ax.transData.transform([(-3.0 + 0.5 * i, 7.0 + 0.5 * j), (-2.5 + 0.5 * i, 7.5 + 0.5 * j)])
            (x0, y0), (x1, y1) = np.floor(corners).astype(int)
            # A block is at most about two pixels wide, and is drawn at most about a pixel beside its place.
            near = dark[max(y0 - 3, 0) : y1 + 4, max(x0 - 3, 0) : x1 + 4]
            assert near.any(), (i, j)
    assert not dark.all() or classes[low[0] : high[0], low[1] : high[1]].any()


def test_zooming_in_shows_the_cells() -> None:
    classes = np.zeros((3000, 3000), np.uint8)
    classes[1700, 40] = 1
    x, y = -3.0 + 0.5 * 1700, 7.0 + 0.5 * 40
    ax, image = cells(classes, (300, 300), [-3.0, 1497.0, 7.0, 1507.0])
    assert 0 < (image[..., 0] < 128).sum() <= 4
    ax.set_xlim(x - 1.0, x + 2.0)
    ax.set_ylim(y - 0.5, y + 2.5)
    image = rendered(ax)
    assert (image[..., 0] < 128).sum() == pytest.approx(270 * 261 / 36, rel=0.05)
    assert pixel(ax, image, x + 0.25, y + 0.25) == (0, 0, 0)


@pytest.mark.parametrize("suffix", [".pdf", ".svg", ".jpg"])
def test_other_formats(space: CSpace, tmp_path: Path, suffix: str) -> None:
    file = save_plot(space, tmp_path / f"map{suffix}", path=[(1, 1), (1, 4)])
    assert 2_000 < file.stat().st_size < 200_000


def test_large_maps_draw_fast(tmp_path: Path) -> None:
    occupied = np.zeros((4096, 4096), bool)
    occupied[1000:1200, 2000:3000] = True
    space = build(Workspace.from_array(occupied, 0.05), Robot.disc(0.3))
    began = time.perf_counter()
    save_plot(space, tmp_path / "map.png", path=[(10, 10), (10, 150)])
    assert time.perf_counter() - began < 5.0


# ----------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"path": [1.0, 2.0]}, "path has shape (2,)"),
        ({"path": [(1.0, 2.0, 3.0)]}, "path has shape (1, 3)"),
        ({"path": [(1.0, float("nan"))]}, "path[0, 1] is nan"),
        ({"start": [(1.0, 2.0)]}, "start has shape (1, 2)"),
        ({"goal": (1.0, float("inf"))}, "goal[1] is inf"),
        ({"path": [(1, 1), (2, 2)], "robot_every": 0.0}, "robot_every is 0.0"),
        ({"path": [(1, 1), (2, 2)], "robot_every": -1.0}, "robot_every is -1.0"),
        ({"robot_every": float("nan")}, "robot_every is nan"),
        ({"dpi": 0}, "dpi is 0"),
        ({"ax": None}, "ax is given"),
    ],
)
def test_bad_input(space: CSpace, tmp_path: Path, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        save_plot(space, tmp_path / "map.png", **options)
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_bad_suffix(space: CSpace, tmp_path: Path) -> None:
    for name in ("map.xyz", "map"):
        with pytest.raises(InputError, match=r"must be one of \.png, \.pdf, \.svg, \.jpg; name it e\.g\. map\.png"):
            save_plot(space, tmp_path / name)


def test_existing_picture(space: CSpace, tmp_path: Path) -> None:
    file = tmp_path / "map.png"
    file.write_text("precious")
    with pytest.raises(FileError, match="exists"):
        save_plot(space, file)
    assert file.read_text() == "precious"
    save_plot(space, file, overwrite=True)
    assert file.read_bytes().startswith(b"\x89PNG")
    assert [entry.name for entry in tmp_path.iterdir()] == ["map.png"]


def test_no_folder(space: CSpace, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="folder"):
        save_plot(space, tmp_path / "absent" / "map.png")
