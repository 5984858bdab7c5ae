"""Maps in three dimensions: visible faces, paths and robots."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cspace import FREE, CSpace, Grid, Robot, Workspace, build
from cspace.plot import artists, plot, surface
from cspace.plot.surface import border_faces
from tests.pictures import check_within, heading, heading_box, labels, rendered

GRID = Grid((-1.0, 2.0, 0.5), 0.5, (5, 4, 3))
TOWARDS = np.array([0.6, -0.5, 0.7])
SURFACE_PATH = [(0.6, 3.2, 1.2), (2.2, 1.2, 1.0), (3.8, 1.2, 1.0), (5.5, 1.5, 0.6)]


def locate_faces(corners: NDArray[np.float64]) -> set[tuple[int, ...]]:
    """Return centers and normal axes of faces.

    Centers are in half cells.
    """
    centers = np.rint((corners.mean(axis=1) - GRID.lower) / 0.5 * 2).astype(int)
    axes = np.ptp(corners, axis=1).argmin(axis=1)
    return {(*center.tolist(), int(axis)) for center, axis in zip(centers, axes, strict=True)}


cells = arrays(np.bool_, st.tuples(*[st.integers(1, 5)] * 3))
directions = st.tuples(*[st.sampled_from([-1.0, -0.4, 0.0, 0.3, 1.0])] * 3).filter(any)


@settings(max_examples=100, deadline=None)
@given(cells, directions)
def test_border_faces_face_the_camera(solid: NDArray[np.bool_], towards: tuple[float, ...]) -> None:
    """Compare with borders of cells, without front walls."""
    grid = Grid(GRID.lower, 0.5, solid.shape)
    faces, _ = border_faces(grid, solid, np.array(towards))
    left = solid.copy()
    inside = [list(range(n)) for n in solid.shape]
    for axis, side in enumerate(towards):
        layers = list(inside[axis])
        while side and layers:
            layer = left[np.ix_(*(layers if k == axis else inside[k] for k in range(3)))]
            end = layer.take(-1 if side > 0.0 else 0, axis)
            if end.mean() < 0.8:
                break
            layers = layers[:-1] if side > 0.0 else layers[1:]
        if 2 * (len(inside[axis]) - len(layers)) < len(inside[axis]):
            inside[axis] = layers
    expected = set()
    for cell in product(*inside):
        for axis, side in enumerate(towards):
            step = int(np.sign(side))
            ahead = tuple(c + step * (k == axis) for k, c in enumerate(cell))
            if left[cell] and step and not (ahead[axis] in inside[axis] and left[ahead]):
                expected.add((*(2 * np.array(cell) + 1 + step * (np.arange(3) == axis)).tolist(), axis))
    assert locate_faces(faces) == expected
    assert len(faces) == len(expected)
    # Successive corners differ along one axis.
    assert ((np.diff(faces, axis=1) != 0.0).sum(axis=2) == 1).all()


@pytest.mark.parametrize("most", [20, 60, 200])
def test_merged_blocks_cover_all_solid_cells(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """Count the faces, and search for solid cells below."""
    monkeypatch.setattr(surface, "MAX_FACES", most)
    solid = np.zeros((23, 17, 11), bool)
    solid[tuple(np.random.default_rng(most).integers(0, solid.shape, (250, 3)).T)] = True
    grid = Grid(GRID.lower, 0.5, solid.shape)
    corners, _ = border_faces(grid, solid, np.array([0.0, 0.0, 1.0]))
    assert 0 < len(corners) <= most
    assert (corners >= grid.lower).all()
    assert (corners <= grid.upper).all()
    low, high = corners.min(axis=1), corners.max(axis=1)
    for center in grid.center_of(np.argwhere(solid)):
        assert (((low <= center) & (center <= high))[:, :2].all(axis=1) & (low[:, 2] >= center[2])).any()


def test_cut_omits_cells_above_it() -> None:
    solid = np.zeros((5, 4, 3), bool)
    solid[1:3] = True
    faces, _ = border_faces(GRID, solid, TOWARDS, 1.4)
    # Cells are from 0.5 to 1 and from 1 to 1.5; the cut is in the second, which stays.
    assert faces[..., 2].max() == 1.5
    assert border_faces(GRID, solid, TOWARDS, 0.4)[0][..., 2].max() == 1.0  # at least one layer remains


def collect_polygons(ax: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of all polygons and their colours."""
    (collection,) = ax.collections
    return np.asarray(collection._faces), np.asarray(collection._facecolor3d)[:, :3]


@pytest.mark.parametrize("shown", ["obstacles", "free"])
def test_faces_separate_solid_cells_from_others(hall: CSpace, shown: str) -> None:
    """Test the cells behind and before each face."""
    ax = plot(hall, view="3d", surface=shown)
    corners, colors = collect_polygons(ax)
    assert len(corners) > 500
    solid = hall.workspace.outer if shown == "obstacles" else hall.cell_states != FREE
    normal = np.argmin(np.ptp(corners, axis=1), axis=1)
    towards = surface.camera_direction(np.array(surface.DEFAULT_CAMERA))
    step = 0.05 * np.sign(towards[normal])[:, np.newaxis] * (np.arange(3) == normal[:, np.newaxis])
    centers = corners.mean(axis=1)
    assert solid[tuple(hall.grid.cell_of(centers - step).T)].all()
    ahead = centers + step
    inside = hall.grid.contains(ahead)
    faced = solid[tuple(hall.grid.cell_of(ahead[inside]).T)]
    assert not faced.any() or shown == "free"  # part of a removed wall may remain in front
    full = to_rgb(surface.SURFACES[shown][1])
    assert (colors <= np.array(full) + 1e-9).all()
    assert len(np.unique(colors.round(3), axis=0)) > 3


def test_path_and_robots_are_sorted_with_the_faces(hall: CSpace) -> None:
    ax = plot(hall, view="3d", path=SURFACE_PATH, robot_every=1.0)
    corners, colors = collect_polygons(ax)
    blue = np.abs(colors - to_rgb(artists.PATH_COLOR)).max(axis=1) < 1e-6
    ribbon = corners[blue].mean(axis=1)
    assert len(ribbon) > 100
    # Each piece of the ribbon is on the path, and each waypoint is near one.
    a, b = np.array(SURFACE_PATH[:-1]), np.array(SURFACE_PATH[1:])
    share = np.clip(((ribbon[:, None] - a) * (b - a)).sum(axis=2) / ((b - a) ** 2).sum(axis=1), 0.0, 1.0)
    assert np.linalg.norm(ribbon[:, None] - a - share[..., None] * (b - a), axis=2).min(axis=1).max() < 1e-9
    assert np.linalg.norm(ribbon[:, None] - np.array(SURFACE_PATH), axis=2).min(axis=0).max() < 0.05
    green = colors[:, 1] > colors[:, 0] + 0.1
    near = np.abs(corners[green & ~blue] - SURFACE_PATH[0]).max(axis=(1, 2)) < 0.26
    np.testing.assert_allclose(np.ptp(corners[green & ~blue][near].reshape(-1, 3), axis=0), (0.5, 0.4, 0.3))
    lines = {line.get_label(): np.transpose(line.get_data_3d()) for line in ax.lines}
    np.testing.assert_allclose(lines["start"], SURFACE_PATH[:1])
    np.testing.assert_allclose(lines["goal"], SURFACE_PATH[-1:])
    assert labels(ax) == ["obstacle", "robot", "path, dotted behind something", "start", "goal"]


def test_unknown_cells_have_their_own_colour_in_3d() -> None:
    """Colour blocks brown if all their cells are unknown."""
    outer = np.zeros((12, 12, 6), bool)
    outer[2:5, 2:5, :3] = outer[7:10, 7:10, :3] = True
    unknown = np.zeros_like(outer)
    unknown[:6] = True
    grid = Grid((0.0, 0.0, 0.0), 0.5, outer.shape)
    ax = Workspace(grid, outer, outer, unknown=unknown).plot(view="3d")
    corners, colors = collect_polygons(ax)
    brown = colors[:, 0] > colors[:, 2] + 0.1
    assert brown.any()
    assert (corners.mean(axis=1)[:, 0] < 3.0).tolist() == brown.tolist()
    assert labels(ax) == ["obstacle", "unknown, taken as obstacle"]


def test_the_cut_is_above_the_path(hall: CSpace) -> None:
    assert "cut at z = 1.35 m" in heading(plot(hall, view="3d", path=SURFACE_PATH))
    corners, _ = collect_polygons(plot(hall, view="3d", path=SURFACE_PATH))
    assert corners[..., 2].max() == pytest.approx(1.4)
    assert collect_polygons(plot(hall, view="3d", path=SURFACE_PATH, cut=2.4))[0][..., 2].max() == pytest.approx(2.4)
    assert collect_polygons(plot(hall, view="3d"))[0][..., 2].max() == pytest.approx(2.4)


@pytest.mark.parametrize("camera", [None, (90.0, 0.0), (10.0, 80.0)])
def test_surface_fits_the_figure(hall: CSpace, camera: Any) -> None:
    ax = plot(hall, view="3d", path=SURFACE_PATH, camera=camera)
    rendered(ax)
    figure = ax.figure
    texts = [figure.legends[0].get_window_extent(), heading_box(figure)]
    check_within(figure, *texts)
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    corners = np.stack(np.meshgrid((0.0, 6.0), (0.0, 4.0), (0.0, 2.4)), axis=-1).reshape(-1, 3)
    shown = ax.transData.transform(np.transpose(proj_transform(*corners.T, ax.get_proj())[:2]))
    assert (shown > 0).all()
    assert (shown < (figure.bbox.width, figure.bbox.height)).all()
    assert shown[:, 1].min() > texts[0].y1
    assert shown[:, 1].max() < texts[1].y0
    assert np.ptp(shown, axis=0).max() > 0.5 * min(figure.bbox.width, figure.bbox.height)


def test_surface_uses_given_axes_and_draws_empty_maps(hall: CSpace) -> None:
    ax = Figure().add_subplot(projection="3d")
    assert plot(hall, view="3d", ax=ax) is ax
    assert ax.get_title() == "box 0.5 m x 0.4 m x 0.3 m, cells of 0.1 m"
    empty = build(Workspace.from_array(np.zeros((4, 4, 4), bool), 0.1), Robot.ball(0.01), outside="free")
    rendered(plot(empty, view="3d"))
    assert labels(plot(empty, view="3d", start=(0.2, 0.2, 0.2))) == ["robot", "start"]
