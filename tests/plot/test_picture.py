"""Pictures of plane maps: pixels, colours, text, paths and robots."""

import io
import itertools
import math
import os
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image

import cspace
import planners
from cspace import FREE, FileError, Robot, Workspace, build
from cspace.plot import extend_legend, save_plot
from cspace.plot.scene import CellClass
from tests.helpers.handmade import build_empty
from tests.helpers.pictures import (
    COLORS,
    check_cells,
    check_within,
    class_of,
    heading,
    heading_box,
    labels,
    pixel,
    rendered,
)
from tests.helpers.strategies import few


@pytest.mark.parametrize("yaw", ["no rotations", "all rotations", 1.2])
def test_each_pixel_shows_the_state_of_its_cell(flat, turning, yaw):
    """Compare pictures of slices with single queries."""
    space = flat if yaw == "no rotations" else turning
    rotations = {
        "no rotations": [()],
        "all rotations": [(center,) for center in turning.rotations.centers[:, 0]],
    }.get(yaw, [(yaw,)])
    ax = space.plot(rotation=yaw if yaw == 1.2 else None)
    cells = np.random.default_rng(2).integers(0, space.grid.shape, (300, 2))
    seen = check_cells(space, ax, rendered(ax), cells, rotations)
    assert len(seen) == (5 if yaw == "all rotations" else 4)


def test_texts_name_axes_rotations_and_colours(flat, turning):
    ax = flat.plot(path=[(1, 1), (1, 4), (7, 4)])
    assert (ax.get_xlim(), ax.get_ylim(), ax.get_aspect()) == ((0.0, 8.0), (0.0, 5.0), 1.0)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (m)", "y (m)")
    assert {"obstacle", "undecided (MIXED)", "path", "goal"} < set(labels(ax))
    assert {"C-obstacle at every rotation", "free at every rotation"} < set(labels(turning.plot()))
    assert "yaw -90°" in heading(turning.plot(rotation=1.5 * math.pi))


@pytest.mark.parametrize("taken", ["free", "obstacle"])
def test_unknown_cells_have_their_own_colours(taken):
    rng = np.random.default_rng(5)
    outer, unknown = rng.random((2, 30, 20)) < 0.06
    outer = outer | unknown if taken == "obstacle" else outer & ~unknown
    grid = cspace.Grid((0.0, 0.0), 0.1, (30, 20))
    workspace = Workspace(grid, outer, outer, unknown=unknown)
    space = build(workspace, Robot.disc(0.11))
    name = f"unknown, taken as {taken}"
    states = np.where(outer, 2, FREE)
    for ax, shown in ((workspace.plot(), states), (space.plot(), space.cell_states)):
        image = rendered(ax)
        assert name in labels(ax)
        for cell in np.ndindex(30, 20):
            known = class_of(space, {int(shown[cell])}, bool(outer[cell]))
            is_brown = unknown[cell] and known in ("free", "obstacle")
            expected = COLORS[name if is_brown else known]
            assert pixel(ax, image, *grid.center_of(cell)) == expected


def test_a_notebook_shows_the_figure(flat):
    """Represent only axes of new figures as a picture."""
    png = vars(flat.plot())["_repr_png_"]()
    assert flat._repr_png_() == png
    assert Image.open(io.BytesIO(png)).size[0] > 400
    assert not hasattr(flat.plot(ax=Figure().add_subplot()), "_repr_png_")


def collect_lines(ax):
    """Return the points of all lines with a label."""
    return {line.get_label(): line.get_xydata().tolist() for line in ax.lines}


def test_a_path_that_an_update_blocks_is_dashed():
    wall = shapely.box(1.9, 0.0, 2.1, 1.6)
    workspace = Workspace.from_polygons([wall], 0.05, (0.0, 0.0, 4.0, 3.0))
    space = build(workspace, Robot.disc(0.2))
    plan = planners.plan(space, (0.5, 0.5), (3.5, 0.5), planner="Grid")
    assert {"path", "start", "goal"} == set(collect_lines(space.plot(path=plan)))
    other = build(workspace, Robot.disc(0.2))
    space.add_obstacle("cart", shapely.box(0.9, 0.7, 1.4, 1.2))
    lost = collect_lines(space.plot(path=plan))["path, no longer proven free"]
    np.testing.assert_array_equal(lost, plan.path)
    assert "path" in collect_lines(other.plot(path=plan))  # which has no cart


def collect_boxes(ax):
    """Return the boxes around the drawn robots, rows of x0, y0, x1, y1."""
    paths = ax.collections[0].get_paths()
    return np.array([outline.get_extents().extents for outline in paths])


def test_robots_are_drawn_along_the_path_and_turned(flat, turning):
    boxes = collect_boxes(flat.plot(path=[(1, 1), (1, 4), (7, 4)]))
    upwards = [(1.0, 1.0 + 0.9 * k) for k in range(1, 4)]
    between = [*upwards, *((1.6 + 0.9 * k, 4.0) for k in range(6))]
    expected = np.array([*between, (1, 1), (7, 4)])
    np.testing.assert_allclose(boxes, np.hstack([expected - 0.32, expected + 0.32]), atol=1e-9)
    # The reference point is 0.3 m behind the center; the robots at the endpoints come last.
    ax = turning.plot(path=[(2, 1, math.pi / 2), (2, 4, math.pi / 2)])
    rows = [(1.8, y - 0.3, 2.2, y + 0.9) for y in (2.0, 3.0, 1.0, 4.0)]
    np.testing.assert_allclose(collect_boxes(ax), rows, atol=1e-9)
    # Arrows show the yaw.
    arrows = ax.collections[1]
    np.testing.assert_allclose(arrows.U, 0.0, atol=1e-9)
    assert (arrows.V > 0.3).all()


def test_a_robot_on_a_floor_is_drawn_with_the_outlines_of_its_heights():
    balls = cspace.Robot.from_balls([(0.0, 0.0, 0.3), (0.2, 0.0, 0.7)], [0.3, 0.1])
    space = build_empty((20, 20, 10), balls, rotations=8, floor=0.01)
    axes = space.plot(path=[(1.0, 1.0, 0.5)])
    _, levels, *_ = axes.collections
    boxes = [path.get_extents() for path in levels.get_paths()]
    place = np.array([1.0, 1.0]) + 0.2 * np.array([np.cos(0.5), np.sin(0.5)])
    centers = np.array([(box.x0 + box.x1, box.y0 + box.y1) for box in boxes]) / 2.0
    at_ball = np.hypot(*(centers - (1.0, 1.0)).T) < 1e-3
    at_top = np.hypot(*(centers - place).T) < 1e-3
    widths = np.array([box.width for box in boxes])
    assert (at_ball | at_top).all() and at_top.any()
    assert len(np.unique(widths[at_ball].round(3))) > 2
    assert widths[at_ball].max() == pytest.approx(0.6, abs=0.01)
    assert widths[at_top].max() == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("shape", [(3000, 2000), (5000, 7)])
def test_no_obstacle_vanishes_from_a_picture_of_a_large_map(shape):
    occupied = np.zeros(shape, bool)
    cell = np.array([shape[0] // 3, shape[1] // 2])
    occupied[tuple(cell)] = True
    ax = Workspace.from_array(occupied, 0.1).plot()
    (image,) = ax.images
    pixels = np.asarray(image.get_array())
    assert len(pixels) < ax.bbox.height + 7 and len(pixels[0]) < ax.bbox.width
    (dark,) = np.argwhere(pixels == CellClass.OBSTACLE)
    left, right, bottom, top = image.get_extent()
    size = np.array([right - left, top - bottom]) / pixels.shape[1::-1]
    corner = np.array([left, bottom]) + dark[::-1] * size
    center = (cell + 0.5) * 0.1
    assert ((corner <= center) & (center <= corner + size)).all()


@pytest.mark.parametrize("shape", few([((1, 300),), ((1, 1, 300),), ((2, 3),), ((60, 24, 5),)], 2))
def test_text_and_panels_fit_the_figure_without_overlap(shape):
    robot = Robot.ball(0.01) if len(shape) == 3 else Robot.rectangle(0.2, 0.1, center=(0.03, 0.0))
    space = build_empty(shape, robot, outside="free")
    figure = space.plot(path=[space.grid.lower, space.grid.upper]).figure
    assert max(figure.get_size_inches()) < 20
    figure.draw_without_rendering()
    words = [figure.legends[0].get_window_extent(), heading_box(figure)]
    panels = [panel.get_tightbbox() for panel in figure.axes]
    check_within(figure, *words)
    assert not any(one.overlaps(other) for one, other in itertools.product(words, panels))
    assert min(side for panel in figure.axes for side in panel.get_window_extent().size) > 15


def test_a_legend_of_long_labels_fits_a_narrow_figure():
    occupied = np.zeros((100, 160), dtype=bool)
    occupied[30:32, 40:100] = True
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.9, 0.6), rotations=8)
    ax = space.plot()
    extend_legend(ax, [Patch(label=f"{n} undecided, with a common node") for n in (100, 200, 300)])
    ax.figure.draw_without_rendering()
    check_within(ax.figure, ax.figure.legends[0].get_window_extent())


def test_pictures_need_no_window_and_no_display(tmp_path):
    code = (
        "import sys, numpy, cspace\n"
        "ax = cspace.Workspace.from_array(numpy.eye(9, dtype=bool), 0.1).plot()\n"
        "ax.figure.savefig('map.png')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    environment = {
        "PATH": "",
        "PYTHONPATH": str(Path(cspace.__file__).parents[1]),
        "MPLBACKEND": "tkagg",
        "HOME": str(tmp_path),
        "MPLCONFIGDIR": matplotlib.get_cachedir(),  # which knows the fonts
        "XDG_CACHE_HOME": os.environ["XDG_CACHE_HOME"],
    }
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)


@pytest.mark.parametrize(
    "suffix, begin",
    [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml"), (".jpg", b"\xff\xd8")],
)
def test_pictures_replace_no_file_unasked_and_make_no_folder(flat, tmp_path, suffix, begin):
    file = tmp_path / f"map{suffix}"
    file.write_text("precious")
    with pytest.raises(FileError, match="exists"):
        save_plot(flat, file)
    assert file.read_text() == "precious"
    save_plot(flat, file, overwrite=True)
    assert file.read_bytes().startswith(begin)
    assert [entry.name for entry in tmp_path.iterdir()] == [file.name]
    with pytest.raises(FileError, match="folder"):
        save_plot(flat, tmp_path / "absent" / file.name)
