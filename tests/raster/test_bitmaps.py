"""Properties of outlines and faces of sets of cells."""

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cspace._raster.bitmaps import boundary_segments

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
