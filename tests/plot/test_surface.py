"""Maps in three dimensions: visible faces, paths and robots."""

import itertools
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
from cspace.plot import plot, surface
from cspace.plot.surface import border_faces
from tests.helpers.pictures import check_within, heading_box, labels, rendered

TOWARDS = np.array([0.6, -0.5, 0.7])
SURFACE_PATH = [(0.6, 3.2, 1.2), (2.2, 1.2, 1.0), (3.8, 1.2, 1.0), (5.5, 1.5, 0.6)]
levels_of_cells = arrays(np.uint8, st.tuples(*[st.integers(1, 5)] * 3), elements=st.integers(0, 2))
directions = st.tuples(*[st.sampled_from([-1.0, -0.4, 0.0, 0.3, 1.0])] * 3).filter(any)


@settings(max_examples=100, deadline=None)
@given(levels_of_cells, directions, st.booleans())
def test_border_faces_face_the_camera(
    levels: NDArray[np.uint8], towards: tuple[float, ...], is_cut: bool
) -> None:
    """Compare with each cell and the cell before it, without walls in front."""
    faces, kinds = border_faces(levels, np.array(towards), is_cut)
    inside = [list(range(n)) for n in levels.shape]
    for axis in range(2 if is_cut else 3):
        order = inside[axis][:: -1 if towards[axis] > 0.0 else 1]
        wall = list(
            itertools.takewhile(
                lambda k, axis=axis: (levels.take(k, axis) > 0).mean() >= 0.8, order
            )
        )
        if towards[axis] and 2 * len(wall) < len(order):
            inside[axis] = [k for k in inside[axis] if k not in wall]
    expected = {}
    for cell in itertools.product(*inside):
        for axis, side in enumerate(towards):
            step = int(np.sign(side))
            ahead = tuple(c + step * (k == axis) for k, c in enumerate(cell))
            if levels[cell] and step and not (ahead[axis] in inside[axis] and levels[ahead]):
                center = 2 * np.array(cell) + 1 + step * (np.arange(3) == axis)
                expected[(*center.tolist(), axis)] = levels[cell]
    centers = np.rint(2.0 * faces.mean(axis=1)).astype(int)
    axes = np.ptp(faces, axis=1).argmin(axis=1)
    found = {
        (*center.tolist(), int(axis)): kind
        for center, axis, kind in zip(centers, axes, kinds, strict=True)
    }
    assert found == expected and len(faces) == len(expected)
    # Successive corners differ along one axis.
    assert ((np.diff(faces, axis=1) != 0).sum(axis=2) == 1).all()


@pytest.mark.parametrize("most", [20, 60, 200])
def test_merged_blocks_cover_all_solid_cells(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """Count the faces, and search for solid cells below."""
    monkeypatch.setattr(surface, "MAX_FACES", most)
    solid = np.zeros((23, 17, 11), np.uint8)
    solid[tuple(np.random.default_rng(most).integers(0, solid.shape, (250, 3)).T)] = 1
    corners, _ = border_faces(solid, np.array([0.0, 0.0, 1.0]), is_cut=True)
    assert 0 < len(corners) <= most
    assert (corners >= 0).all() and (corners <= solid.shape).all()
    low, high = corners.min(axis=1), corners.max(axis=1)
    for center in np.argwhere(solid) + 0.5:
        assert (
            ((low <= center) & (center <= high))[:, :2].all(axis=1) & (low[:, 2] >= center[2])
        ).any()


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
    assert len(np.unique(colors.round(3), axis=0)) == 3


def test_robots_are_sorted_with_the_faces(hall: CSpace) -> None:
    ax = plot(hall, view="3d", path=SURFACE_PATH, robot_every=1.0)
    corners, colors = collect_polygons(ax)
    green = colors[:, 1] > colors[:, 0] + 0.1
    near = np.abs(corners[green] - SURFACE_PATH[0]).max(axis=(1, 2)) < 0.26
    np.testing.assert_allclose(np.ptp(corners[green][near].reshape(-1, 3), axis=0), (0.5, 0.4, 0.3))
    lines = {line.get_label(): np.transpose(line.get_data_3d()) for line in ax.lines}
    np.testing.assert_allclose(lines["path"][::64], SURFACE_PATH)
    np.testing.assert_allclose(lines["start"], SURFACE_PATH[:1])
    np.testing.assert_allclose(lines["goal"], SURFACE_PATH[-1:])
    assert labels(ax) == ["obstacle", "robot", "path", "start", "goal"]


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
    corners, _ = collect_polygons(plot(hall, view="3d", path=SURFACE_PATH))
    assert corners[..., 2].max() == pytest.approx(1.4)
    assert collect_polygons(plot(hall, view="3d", path=SURFACE_PATH, cut=2.4))[0][
        ..., 2
    ].max() == pytest.approx(2.4)
    assert collect_polygons(plot(hall, view="3d"))[0][..., 2].max() == pytest.approx(2.4)


@pytest.mark.parametrize(("cut", "height"), [(0.0, 0.1), (9.0, 2.4)])
def test_a_cut_beyond_the_map_is_at_its_first_or_last_layer(
    hall: CSpace, cut: float, height: float
) -> None:
    corners, _ = collect_polygons(plot(hall, view="3d", cut=cut))
    assert corners[..., 2].max() == pytest.approx(height)


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
    empty = build(
        Workspace.from_array(np.zeros((4, 4, 4), bool), 0.1), Robot.ball(0.01), outside="free"
    )
    rendered(plot(empty, view="3d"))
    assert labels(plot(empty, view="3d", start=(0.2, 0.2, 0.2))) == ["robot", "start"]
