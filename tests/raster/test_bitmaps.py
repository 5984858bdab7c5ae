"""Properties of outlines and faces of sets of cells."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cspace.raster.bitmaps import boundary_segments, boundary_triangles
from tests.helpers.strategies import seeds

CELLS = hnp.arrays(np.bool_, st.tuples(st.integers(1, 7), st.integers(1, 7)))


def _unit_edges(cells):
    """Return the unit edges around the cells, counterclockwise; opposite edges cancel."""
    edges = set()
    for i, j in zip(*np.nonzero(cells), strict=True):
        x = int(i)
        y = int(j)
        ring = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1), (x, y)]
        for (x0, y0), (x1, y1) in pairwise(ring):
            if (x1, y1, x0, y0) in edges:
                edges.remove((x1, y1, x0, y0))
            else:
                edges.add((x0, y0, x1, y1))
    return edges


@given(cells=CELLS)
def test_segments_merge_the_unit_edges(cells):
    units = set()
    for x0, y0, x1, y1 in boundary_segments(cells, 1.0, (0.0, 0.0)).astype(int).tolist():
        steps = max(abs(x1 - x0), abs(y1 - y0))
        dx = (x1 - x0) // steps
        dy = (y1 - y0) // steps
        for k in range(steps):
            unit = (x0 + k * dx, y0 + k * dy, x0 + (k + 1) * dx, y0 + (k + 1) * dy)
            assert unit not in units, "a piece of the outline is there twice"
            units.add(unit)
    assert units == _unit_edges(cells)


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
