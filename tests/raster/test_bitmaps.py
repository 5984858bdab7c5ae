"""Properties of outlines and faces of sets of cells."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cspace.raster.bitmaps import boundary_segments, boundary_triangles
from tests.helpers.strategies import seeds

CELLS = hnp.arrays(np.bool_, st.tuples(st.integers(1, 7), st.integers(1, 7))).filter(np.any)


@given(cells=CELLS)
def test_segments_are_the_boundary_of_the_cells(cells):
    """Each piece of the boundary is there once, with the cells to its left."""
    segments = boundary_segments(cells, 1.0, (0.0, 0.0))
    i, j = np.nonzero(cells)
    boundary = shapely.union_all(shapely.box(i, j, i + 1, j + 1)).boundary
    starts, steps = segments[:, :2], segments[:, 2:] - segments[:, :2]
    assert np.linalg.norm(steps, axis=1).sum() == boundary.length
    assert boundary.equals(shapely.union_all(shapely.linestrings(segments.reshape(-1, 2, 2))))
    left = starts + 0.5 * np.sign(steps + steps[:, ::-1] * (-1.0, 1.0))
    assert cells[tuple(left.astype(int).T)].all()


@given(cells=CELLS)
def test_segments_in_metres_are_the_grid_coordinates_to_the_last_bit(cells):
    lower = np.array([0.7, -0.3, 0.7, -0.3])
    expected = lower + 0.1 * boundary_segments(cells, 1.0, (0.0, 0.0))
    assert np.array_equal(boundary_segments(cells, 0.1, (0.7, -0.3)), expected)


def test_a_large_square_has_four_segments():
    assert boundary_segments(np.ones((300, 200), dtype=bool), 0.05, (0.0, 0.0)).shape == (4, 4)


@settings(max_examples=40)
@given(seeds)
def test_faces_of_cells_are_their_boundary(seed):
    rng = np.random.default_rng(seed)
    cells = rng.random(rng.integers(1, 7, 3)) < 0.5
    triangles = boundary_triangles(cells, 1.0, (0.0, 0.0, 0.0))
    padded = np.pad(cells, 1)
    area = sum(int((np.diff(padded.astype(int), axis=axis) != 0).sum()) for axis in range(3))
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert 0.5 * np.linalg.norm(sides, axis=1).sum() == pytest.approx(area)
    for triangle in triangles:  # each face separates a set cell from another
        axis = int(np.argmin(np.ptp(triangle, axis=0)))
        point = triangle.T @ (0.52, 0.27, 0.21)
        sides = [
            padded[tuple(np.floor(point + sign * np.eye(3)[axis] / 2).astype(int) + 1)]
            for sign in (-1, 1)
        ]
        assert sides[0] != sides[1]
