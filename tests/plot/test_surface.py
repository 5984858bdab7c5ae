"""Maps in three dimensions: visible faces, paths and robots."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cspace.plot import _surface as surface
from cspace.plot._surface import find_border_faces
from tests.helpers.pictures import labels
from tests.helpers.strategies import examples

SURFACE_PATH = [(0.6, 3.2, 1.2), (2.2, 1.2, 1.0), (3.8, 1.2, 1.0), (5.5, 1.5, 0.6)]
levels_of_cells = arrays(np.uint8, st.tuples(*[st.integers(1, 5)] * 3), elements=st.integers(0, 2))
directions = st.tuples(*[st.sampled_from([-1.0, -0.4, 0.0, 0.3, 1.0])] * 3).filter(any)


def list_layers_inside(levels, axis, side):
    """Return the layers of an axis without a wall of mostly solid layers at the camera's side."""
    layers = list(range(levels.shape[axis]))
    if not side:
        return layers
    from_camera = layers[::-1] if side > 0.0 else layers
    solid = [(levels.take(layer, axis) > 0).mean() >= 0.8 for layer in from_camera]
    thickness = solid.index(False) if False in solid else len(solid)
    return from_camera[thickness:] if 2 * thickness < len(layers) else layers


@examples(100)
@given(levels_of_cells, directions, st.booleans())
def test_border_faces_face_the_camera(levels, towards, is_cut):
    """Compare with each cell and the cell before it, without walls in front."""
    faces, face_levels = find_border_faces(levels, np.array(towards), is_cut)
    inside = [list_layers_inside(levels, axis, side) for axis, side in enumerate(towards)]
    if is_cut:
        inside[2] = list(range(levels.shape[2]))
    expected = {}
    for cell, (axis, side) in itertools.product(itertools.product(*inside), enumerate(towards)):
        step = int(np.sign(side)) * np.eye(3, dtype=int)[axis]
        ahead = tuple(cell + step)
        is_hidden = ahead[axis] in inside[axis] and levels[ahead]
        if levels[cell] and side and not is_hidden:
            doubled_center = 2 * np.array(cell) + 1 + step
            expected[(*doubled_center.tolist(), axis)] = levels[cell]
    centers = np.rint(2.0 * faces.mean(axis=1)).astype(int)
    axes = np.ptp(faces, axis=1).argmin(axis=1)
    found = dict(
        zip(map(tuple, np.column_stack([centers, axes]).tolist()), face_levels, strict=True)
    )
    assert found == expected
    assert len(faces) == len(expected)
    # Successive corners differ along one axis.
    assert ((np.diff(faces, axis=1) != 0).sum(axis=2) == 1).all()


@pytest.mark.parametrize("most", [20, 200])
def test_merged_blocks_cover_all_solid_cells(monkeypatch, most):
    """Count the faces, and search for one above each solid cell."""
    monkeypatch.setattr(surface, "MAX_FACES", most)
    solid = np.zeros((23, 17, 11), np.uint8)
    solid[tuple(np.random.default_rng(most).integers(0, solid.shape, (250, 3)).T)] = 1
    corners, _ = find_border_faces(solid, np.array([0.0, 0.0, 1.0]), is_cut=True)
    assert 0 < len(corners) <= most
    assert (corners >= 0).all() and (corners <= solid.shape).all()
    low = corners.min(axis=1)
    high = corners.max(axis=1)
    for center in np.argwhere(solid) + 0.5:
        is_over = ((low <= center) & (center <= high))[:, :2].all(axis=1)
        assert (is_over & (low[:, 2] >= center[2])).any()


def collect_polygons(ax):
    """Return the corners of all polygons and their colours."""
    (collection,) = ax.collections
    return np.asarray(collection._faces), np.asarray(collection._facecolor3d)[:, :3]


def test_faces_separate_solid_cells_from_others(hall):
    """Test the cells behind and before each face."""
    corners, colors = collect_polygons(hall.plot(view="3d"))
    assert len(corners) > 500
    normal = np.argmin(np.ptp(corners, axis=1), axis=1)
    towards = surface.camera_direction(np.array(surface.DEFAULT_CAMERA))
    step = 0.05 * np.sign(towards) * np.eye(3)[normal]
    centers = corners.mean(axis=1)
    assert hall.workspace.outer[tuple(hall.grid.cell_of(centers - step).T)].all()
    # Shades of grey: the top is the brightest.
    shades = [np.unique(colors[normal == axis, 0].round(3)) for axis in range(3)]
    assert [len(shade) for shade in shades] == [1, 1, 1]
    assert 0.1 < shades[0] < shades[1] < shades[2] < 0.5


def test_robots_are_sorted_with_the_faces(hall):
    ax = hall.plot(view="3d", path=SURFACE_PATH)
    corners, colors = collect_polygons(ax)
    robots = corners[colors[:, 1] > colors[:, 0] + 0.1]
    first = robots[(np.abs(robots - SURFACE_PATH[0]) < (0.251, 0.201, 0.151)).all(axis=(1, 2))]
    np.testing.assert_allclose(np.ptp(first.reshape(-1, 3), axis=0), (0.5, 0.4, 0.3))
    lines = {line.get_label(): np.transpose(line.get_data_3d()) for line in ax.lines}
    np.testing.assert_allclose(lines["path"][::64], SURFACE_PATH)
    np.testing.assert_allclose(lines["goal"], SURFACE_PATH[-1:])
    assert labels(ax) == ["obstacle", "robot", "path", "start", "goal"]


def test_the_cut_is_above_the_path(hall):
    corners, _ = collect_polygons(hall.plot(view="3d", path=SURFACE_PATH))
    assert corners[..., 2].max() == pytest.approx(1.4)
