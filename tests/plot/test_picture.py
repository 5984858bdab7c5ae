"""Pictures of plane maps: pixels, colours, text, paths and robots."""

import io
import itertools
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from PIL import Image

import cspace
from cspace import FREE, CSpace, Robot, Workspace, build
from cspace.plot import artists, plot
from cspace.plot.artists import CLASSES
from cspace.plot.route import outline_rings
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

# ----------------------------------------------------------------------------------------------- cells


@pytest.mark.parametrize("yaw", ["none", None, 0.0, 1.2, -2.0, 7.0])
def test_each_pixel_shows_the_state_of_its_cell(flat: CSpace, turning: CSpace, yaw: Any) -> None:
    """Compare pictures of slices with single queries."""
    shown = flat if yaw == "none" else turning
    ax = plot(shown, rotation=None if yaw == "none" else yaw)
    yaws = (
        [()]
        if yaw == "none"
        else [(yaw,)]
        if yaw is not None
        else [(q,) for q in turning.rotations.centers[:, 0]]
    )
    cells = np.random.default_rng(2).integers(0, shown.grid.shape, (400, 2))
    assert len(check_cells(shown, ax, rendered(ax), cells, yaws)) == (5 if yaw is None else 4)


def test_axes_are_in_metres_and_named(flat: CSpace) -> None:
    ax = plot(flat)
    assert (ax.get_xlim(), ax.get_ylim(), ax.get_aspect()) == ((0.0, 8.0), (0.0, 5.0), 1.0)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (m)", "y (m)")
    assert heading(ax) == "disc 0.32 m, cells of 0.1 m"


def test_the_title_tells_yaw_and_width(turning: CSpace) -> None:
    assert "yaw 90°, in a rotation cell of 15°" in heading(plot(turning, rotation=math.pi / 2))
    assert "yaw -90°" in heading(plot(turning, rotation=1.5 * math.pi))
    assert "over all rotations, 24 rotation cells of 15°" in heading(plot(turning))
    assert heading(plot(turning, rotation=0.0, title="mine")) == "mine"
    boundaries = np.radians([0.0, 90.0, 100.0, 360.0])
    uneven = build(
        Workspace.from_array(np.eye(9, dtype=bool), 0.1),
        Robot.rectangle(0.2, 0.1),
        rotations=boundaries,
    )
    assert "3 rotation cells of 10° to 260°" in heading(plot(uneven))


def test_the_legend_names_what_is_there(flat: CSpace, turning: CSpace) -> None:
    assert labels(plot(flat)) == ["obstacle", "C-obstacle (BLOCKED)", "undecided (MIXED)", "free"]
    assert labels(plot(flat, path=[(1, 1), (1, 4), (7, 4)]))[4:] == [
        "path",
        "robot",
        "start",
        "goal",
    ]
    assert labels(plot(flat, legend=False)) == []
    assert labels(plot(turning)) == [
        *(
            "obstacle",
            "C-obstacle at every rotation",
            "undecided (MIXED)",
            "free at some rotations",
            "free at every rotation",
        )
    ]


@pytest.mark.parametrize("outside", ["free", "blocked"])
def test_exterior_of_the_grid_is_hatched(outside: str) -> None:
    """Compare the hatching with colours of classes."""
    space = build(
        Workspace.from_array(np.eye(20, dtype=bool), 0.1), Robot.disc(0.1), outside=outside
    )
    ax = plot(space, path=[(1.5, 0.2), (-1.0, 0.2)])
    assert ax.get_xlim()[0] == pytest.approx(-1.1)
    image = rendered(ax)
    shown = {
        pixel(ax, image, x, y)
        for x in np.linspace(-1.0, -0.1, 40)
        for y in np.linspace(0.6, 1.9, 40)
    }
    assert len(shown) > 1
    assert not shown & set(COLORS.values())
    assert "outside the grid" in labels(ax)
    assert "outside the grid" not in labels(plot(space))
    high = build(
        Workspace.from_array(np.zeros((5, 5, 5), bool), 0.1), Robot.ball(0.1), outside=outside
    )
    assert "outside the grid" in labels(plot(high, start=(-1.0, 0.2, 0.2)))


def test_obstacles_free_for_the_reference_point_have_their_own_colour() -> None:
    occupied = np.zeros((60, 20), bool)
    occupied[20:24] = True
    space = build(
        Workspace.from_array(occupied, 0.1), Robot.disc(0.3, center=(2.0, 0.0)), outside="free"
    )
    assert (space.cell_states[20:24] == FREE).all()
    ax = plot(space)
    assert pixel(ax, rendered(ax), 2.2, 1.0) == COLORS["obstacle, free for the reference point"]


def test_colors_differ_even_in_grey() -> None:
    # Perceived lightness L* of CIELAB, 0 to 100.
    lightness = {}
    for label, name in CLASSES:
        linear = [
            part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4
            for part in to_rgb(name)
        ]
        lightness[label] = 116 * float(np.dot([0.2126, 0.7152, 0.0722], linear)) ** (1 / 3) - 16
    assert np.diff(sorted(lightness.values())).min() > 7
    rare = ("reference", "some", "taken as free")
    main = sorted(
        value for label, value in lightness.items() if not any(word in label for word in rare)
    )
    assert np.diff(main).min() > 15
    colors = [color for _, color in CLASSES] + [
        artists.PATH_COLOR,
        artists.ROBOT_FILL_COLOR,
        artists.GOAL_COLOR,
        artists.OUTSIDE_STYLE["facecolor"],
    ]
    apart = [
        np.abs(np.subtract(to_rgb(one), to_rgb(two))).max()
        for i, one in enumerate(colors)
        for two in colors[:i]
    ]
    assert min(apart) > 0.04


def to_lab(color: Any) -> Any:
    """Convert sRGB to CIELAB; 2 is just noticeable."""
    given = np.array(to_rgb(color))
    linear = np.where(given <= 0.04045, given / 12.92, ((given + 0.055) / 1.055) ** 2.4)
    xyz = (
        np.array([(0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)])
        @ linear
    )
    x, y, z = np.cbrt(xyz / (0.9505, 1.0, 1.089))
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def test_obstacle_unknown_and_free_cells_have_distinct_colors() -> None:
    colors = dict(CLASSES)
    for word in ("free", "obstacle"):
        three = [to_lab(colors[name]) for name in ("free", "obstacle", f"unknown, taken as {word}")]
        apart = [np.linalg.norm(three[i] - three[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
        assert min(apart) > 35.0


def test_path_colors_differ_from_map_colors() -> None:
    """Include the faint path, 45 % over white."""
    faint = 0.45 * np.array(to_rgb(artists.PATH_COLOR)) + 0.55
    for color in (artists.PATH_COLOR, artists.LOST_COLOR, faint):
        assert min(np.linalg.norm(to_lab(color) - to_lab(other)) for _, other in CLASSES) > 30.0


def test_repr_tells_shares_of_occupied_and_unknown_cells(data: Path) -> None:
    sandbox = data / "maps/tb3_sandbox.yaml"
    image = np.asarray(Image.open(sandbox.with_suffix(".pgm")))
    occupied, unknown = (
        100.0 * np.count_nonzero(image == value) / image.size for value in (0, 205)
    )
    shares = f"{occupied:.3g} % occupied, {unknown:.3g} % unknown"
    assert f" m, {shares}, taken as occupied)" in repr(Workspace.from_ros_map(sandbox))
    assert f" m, {shares}, taken as free)" in repr(Workspace.from_ros_map(sandbox, "free"))
    assert repr(Workspace.from_array(np.eye(2, dtype=bool), 0.1)).endswith(
        "2 x 2 cells of 0.1 m, 50 % occupied)"
    )


@pytest.mark.parametrize("taken", ["free", "occupied"])
def test_unknown_cells_have_their_own_colours(taken: str) -> None:
    """Test colours of unknown cells, and the legend."""
    rng = np.random.default_rng(5)
    outer, unknown = rng.random((2, 30, 20)) < 0.06
    outer = outer | unknown if taken == "occupied" else outer & ~unknown
    workspace = Workspace(cspace.Grid((0.0, 0.0), 0.1, (30, 20)), outer, outer, unknown=unknown)
    space = build(workspace, Robot.disc(0.11))
    word = {"free": "unknown, taken as free", "occupied": "unknown, taken as obstacle"}[taken]
    for ax, mapped in ((workspace.plot(), False), (space.plot(), True)):
        image, count = rendered(ax), 0
        for cell in np.ndindex(30, 20):
            state = int(space.cell_states[cell]) if mapped else FREE
            plain = (
                class_of(space, {state}, bool(outer[cell]))
                if mapped
                else ["free", "obstacle"][int(outer[cell])]
            )
            apart = bool(unknown[cell]) and plain in ("free", "obstacle")
            assert pixel(ax, image, *space.grid.center_of(cell)) == COLORS[word if apart else plain]
            count += apart
        assert count
        assert word in labels(ax)


# ----------------------------------------------------------------------------------------------- a part, and notebooks


def test_a_notebook_shows_the_figure(flat: CSpace) -> None:
    """Represent only axes of new figures as a picture."""
    png = vars(flat.plot())["_repr_png_"]()
    assert Image.open(io.BytesIO(png)).size[0] > 400
    assert not hasattr(flat.plot(ax=Figure().add_subplot()), "_repr_png_")


# ----------------------------------------------------------------------------------------------- path, robots, marks


def collect_drawn(ax: Any) -> dict[str, list[list[float]]]:
    return {
        line.get_label(): line.get_xydata().tolist()
        for line in ax.lines
        if line.get_label()[0] != "_"
    }


def collect_boxes(ax: Any, number: int = 0) -> list[Any]:
    return [outline.get_extents() for outline in ax.collections[number].get_paths()]


def test_path_and_marks_have_their_coordinates(flat: CSpace) -> None:
    class WithPath:
        path = np.array([(1.0, 1.0), (1.0, 4.0), (7.0, 4.0)])

    for path in (WithPath(), WithPath.path.tolist()):
        assert collect_drawn(plot(flat, path=path)) == {
            "path": WithPath.path.tolist(),
            "start": [[1.0, 1.0]],
            "goal": [[7.0, 4.0]],
        }
    assert collect_drawn(plot(flat, start=(1, 2))) == {"start": [[1.0, 2.0]]}


def test_robots_are_drawn_along_the_path_and_turned(flat: CSpace, turning: CSpace) -> None:
    drawn = collect_boxes(plot(flat, path=[(1, 1), (1, 4), (7, 4)], robot_every=1.0))
    centers = np.array([[(box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2] for box in drawn])
    between = [(1, 2), (1, 3), (1, 4), (2, 4), (3, 4), (4, 4), (5, 4), (6, 4)]
    np.testing.assert_allclose(centers, [*between, (1, 1), (7, 4)], atol=1e-9)
    np.testing.assert_allclose([box.width for box in drawn], 0.64, atol=1e-9)
    assert len(collect_boxes(plot(flat, path=[(1, 1), (7, 4)], robot_every=float("inf")))) == 2
    assert 5 < len(collect_boxes(plot(flat, path=[(1, 1), (7, 4)]))) < 20
    assert len(collect_boxes(plot(flat, path=[(1.0, 1.0)]))) == 2
    # The reference point is 0.3 m behind the center; the robots at the endpoints come last.
    drawn = collect_boxes(
        plot(turning, path=[(2, 1, math.pi / 2), (2, 4, math.pi / 2)], robot_every=1.0)
    )
    expected = [(1.8, 2.2, y - 0.3, y + 0.9) for y in (2.0, 3.0, 1.0, 4.0)]
    np.testing.assert_allclose(
        [(box.x0, box.x1, box.y0, box.y1) for box in drawn], expected, atol=1e-9
    )
    assert (
        4 <= len(collect_boxes(plot(turning, path=[(3, 3, 0), (3, 3, 3.0)]))) < 20
    )  # a rotation in place
    center = collect_boxes(plot(turning, path=[(2, 2, 3.0), (5, 2, -3.0)], robot_every=2.0))[
        0
    ]  # the shorter way round
    np.testing.assert_allclose(
        (center.x0, center.x1, center.height), (3.5 - 0.9, 3.5 + 0.3, 0.4), atol=1e-9
    )


@pytest.mark.parametrize("yaw", [0.0, 2.0, -2.5])
def test_noses_and_arrows_show_the_yaw(turning: CSpace, yaw: float) -> None:
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    ax = plot(turning, goal=(3.0, 3.0, yaw), rotation=0.0)
    points = ax.collections[1].get_paths()[0].vertices - (3.0, 3.0)
    np.testing.assert_allclose(points[(points @ ahead).argmax()], 0.9 * ahead)
    assert (points @ ahead).min() > 0.4
    (arrow,) = (each for each in ax.collections if isinstance(each, Quiver))
    np.testing.assert_allclose([arrow.U, arrow.V], ahead[:, np.newaxis])
    assert arrow.get_offsets().tolist() == [[3.0, 3.0]]


@pytest.mark.parametrize("shape", [(3000, 2000), (5000, 7)])
def test_no_obstacle_vanishes_from_a_picture_of_a_large_map(shape: tuple[int, int]) -> None:
    occupied = np.zeros(shape, bool)
    cell = shape[0] // 3, shape[1] // 2
    occupied[cell] = True
    ax = Workspace.from_array(occupied, 0.1).plot()
    image = ax.images[0]
    dark = np.argwhere((np.asarray(image.get_array()) == COLORS["obstacle"]).all(axis=-1))
    assert len(dark) == 1
    left, right, bottom, top = image.get_extent()
    rows, columns = np.asarray(image.get_array()).shape[:2]
    size = np.array([(right - left) / columns, (top - bottom) / rows])
    corner = np.array([left, bottom]) + dark[0][::-1] * size
    center = (np.array(cell) + 0.5) * 0.1
    assert ((corner <= center) & (center <= corner + size)).all()
    assert (rows < ax.bbox.height and columns < ax.bbox.width) or min(shape) == 7


def test_holes_of_the_robot_stay_open() -> None:
    ring = shapely.box(-1.0, -1.0, 1.0, 1.0) - shapely.box(-0.8, -0.8, 0.8, 0.8)
    space = build(
        Workspace.from_array(np.zeros((60, 60), bool), 0.1, lower=(-3.0, -3.0)), Robot.polygon(ring)
    )
    ax = plot(space, start=(0.3, 0.2))
    image = rendered(ax)
    assert pixel(ax, image, 0.3, 0.9) == COLORS["free"]
    assert pixel(ax, image, 0.3, 1.1) != COLORS["free"]
    square, hole = (
        shapely.box(0, 0, 3, 3).exterior,
        [(1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)],
    )
    for inside in (hole, hole[::-1]):
        turns = [
            shapely.LinearRing(each).is_ccw
            for each in outline_rings(shapely.Polygon(square, [inside]))
        ]
        assert turns == [True, False]


# ----------------------------------------------------------------------------------------------- figures


@pytest.mark.parametrize(
    "shape", [(1, 1), (1, 300), (2, 3), (300, 10), (60, 24, 5), (8, 8, 60), (1, 1, 300)]
)
def test_text_and_panels_fit_the_figure_without_overlap(shape: tuple[int, ...]) -> None:
    robot = Robot.ball(0.01) if len(shape) == 3 else Robot.rectangle(0.2, 0.1, center=(0.03, 0.0))
    space = build(Workspace.from_array(np.zeros(shape, bool), 0.1), robot, outside="free")
    figure: Any = plot(space, path=[space.grid.lower, space.grid.upper]).figure
    assert max(figure.get_size_inches()) < 20
    figure.draw_without_rendering()
    words = [figure.legends[0].get_window_extent(), heading_box(figure)]
    panels = [panel.get_tightbbox() for panel in figure.axes]
    check_within(figure, *words)
    assert not any(one.overlaps(other) for one, other in itertools.product(words, panels))
    assert min(side for panel in figure.axes for side in panel.get_window_extent().size) > 15


def test_zoom_shows_a_part_of_each_view(flat: CSpace, turning: CSpace, hall: CSpace) -> None:
    path = [(1.0, 3.0, 0.0), (4.0, 3.0, 0.0), (7.0, 4.0, 1.0)]
    ax = plot(turning, rotation=0.0, zoom=4.0, center=(4.5, 2.5), path=path)
    assert (*ax.get_xlim(), *ax.get_ylim()) == pytest.approx((3.5, 5.5, 1.5, 3.5))
    check_cells(
        turning,
        ax,
        rendered(ax),
        np.random.default_rng(2).integers((36, 16), (54, 27), (100, 2)),
        [(0.0,)],
    )
    assert not {"start", "outside the grid"} & set(labels(ax)) and {"path", "robot"} <= set(
        labels(ax)
    )
    # By default it is at the middle of the path, and ends at the map's border.
    assert np.mean(
        plot(turning, zoom=4.0, path=[(2, 1, 0), (2, 4, 0)]).get_xlim()
    ) == pytest.approx(2.0)
    assert plot(turning, zoom=4.0, center=(0.2, 0.1)).get_xlim() == pytest.approx((0.0, 1.2))
    assert len(plot(turning, zoom=1e9, center=(4.51, 2.51)).images[0].get_extent()) == 4
    path = [(0.6, 3.2, 1.2), (2.2, 1.2, 1.0), (3.8, 1.2, 1.0), (5.5, 1.5, 0.6)]
    sides = [(2.0, 4.0), (0.2, 2.2), (0.0, 2.0)]
    panels = plot(hall, zoom=3.0, center=(3.0, 1.2, 1.0), path=path).figure.axes
    for panel, (right, up) in zip(panels, [(0, 1), (0, 2), (1, 2)], strict=True):
        limits = sorted([panel.get_xlim(), panel.get_ylim()])
        np.testing.assert_allclose(limits, sorted([sides[right], sides[up]]))
    solid = plot(hall, view="3d", path=path, zoom=3.0, center=(3.0, 1.2, 1.0))
    np.testing.assert_allclose([solid.get_xlim(), solid.get_ylim(), solid.get_zlim()], sides)
    line = next(
        np.transpose(one.get_data_3d()) for one in solid.lines if one.get_label().startswith("path")
    )
    np.testing.assert_allclose(
        [np.nanmin(line, axis=0)[0], np.nanmax(line, axis=0)[0]], sides[0], atol=0.02
    )
    assert "goal" not in labels(solid)


def test_axes_of_the_caller_are_used(flat: CSpace) -> None:
    figure = Figure(figsize=(9, 4))
    left, right = figure.subplots(1, 2)
    assert plot(flat, ax=right) is right
    assert (len(left.images), len(right.images)) == (0, 1)
    assert "disc" in right.get_title()
    assert not figure.legends
    assert right.get_legend() is not None
    assert plot(flat, ax=left, title="mine").get_title() == "mine"


def test_pictures_need_no_window_and_no_display(tmp_path: Path) -> None:
    code = (
        "import sys, numpy as np\n"
        "from cspace import Robot, Workspace, build\n"
        "from cspace.plot import save_plot\n"
        "save_plot(build(Workspace.from_array(np.eye(9, dtype=bool), 0.1), Robot.disc(0.1)), 'map.png')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    root = str(Path(cspace.__file__).parents[1])
    environment = {"PATH": "", "PYTHONPATH": root, "MPLBACKEND": "tkagg", "HOME": str(tmp_path)}
    environment |= {name: value for name, value in os.environ.items() if name.startswith("NUMBA_")}
    environment["MPLCONFIGDIR"] = matplotlib.get_cachedir()  # which knows the fonts
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
