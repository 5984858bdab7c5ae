"""Properties of outlines and faces of sets of cells."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cspace.raster.bitmaps import boundary_segments, boundary_triangles, cover_with_boxes
from tests.helpers.strategies import seeds

CELLS = hnp.arrays(np.bool_, st.tuples(st.integers(1, 7), st.integers(1, 7)))


def _unit_edges(cells: np.ndarray) -> set[tuple[int, int, int, int]]:
    """Return the directed unit edges of the outline.

    They run counterclockwise around each cell.

    Opposite edges of neighbouring cells cancel.
    """
    edges: set[tuple[int, int, int, int]] = set()
    for i, j in zip(*np.nonzero(cells), strict=True):
        x, y = int(i), int(j)
        ring = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1), (x, y)]
        for (x0, y0), (x1, y1) in pairwise(ring):
            if (x1, y1, x0, y0) in edges:
                edges.remove((x1, y1, x0, y0))
            else:
                edges.add((x0, y0, x1, y1))
    return edges


@given(cells=CELLS)
def test_segments_merge_the_unit_edges(cells: np.ndarray) -> None:
    units = set()
    for x0, y0, x1, y1 in boundary_segments(cells, 1.0, (0.0, 0.0)).astype(int).tolist():
        steps = max(abs(x1 - x0), abs(y1 - y0))
        dx, dy = (x1 - x0) // steps, (y1 - y0) // steps
        for k in range(steps):
            unit = (x0 + k * dx, y0 + k * dy, x0 + (k + 1) * dx, y0 + (k + 1) * dy)
            assert unit not in units, "a piece of the outline is there twice"
            units.add(unit)
    assert units == _unit_edges(cells)


@given(cells=CELLS)
def test_signed_area_equals_the_number_of_cells(cells: np.ndarray) -> None:
    x0, y0, x1, y1 = boundary_segments(cells, 0.5, (-2.0, 3.0)).T
    assert 0.5 * np.sum(x0 * y1 - x1 * y0) == pytest.approx(0.25 * cells.sum())


@given(cells=CELLS)
def test_segments_in_metres_are_the_grid_coordinates_to_the_last_bit(cells: np.ndarray) -> None:
    lower = np.array([0.7, -0.3, 0.7, -0.3])
    expected = lower + 0.1 * boundary_segments(cells, 1.0, (0.0, 0.0))
    assert np.array_equal(boundary_segments(cells, 0.1, (0.7, -0.3)), expected)


def test_one_cell_becomes_its_offsets() -> None:
    cells = np.zeros((3, 2), dtype=bool)
    cells[2, 1] = True
    expected = [
        [14.0, 24.0, 14.0, 22.0],
        [16.0, 22.0, 16.0, 24.0],
        [14.0, 22.0, 16.0, 22.0],
        [16.0, 24.0, 14.0, 24.0],
    ]
    assert boundary_segments(cells, 2.0, (10.0, 20.0)).tolist() == expected


def test_a_large_square_has_four_segments() -> None:
    assert boundary_segments(np.ones((300, 200), dtype=bool), 0.05, (0.0, 0.0)).shape == (4, 4)


def test_an_empty_bitmap_has_no_segments() -> None:
    assert boundary_segments(np.zeros((3, 4), dtype=bool), 1.0, (0.0, 0.0)).shape == (0, 4)


def test_cells_that_touch_in_a_corner_meet_to_the_last_bit() -> None:
    cells = np.eye(40, dtype=bool)
    segments = boundary_segments(cells, 0.1, (0.3, -7.7))
    corners = {tuple(point) for point in segments.reshape(-1, 2).tolist()}
    assert len(corners) == 4 * 40 - 39


@settings(max_examples=40)
@given(seeds)
def test_faces_of_cells_are_their_boundary(seed: int) -> None:
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
    rebuilt = np.zeros(cells.shape, dtype=int)
    for (x0, y0, z0), (x1, y1, z1) in zip(
        *np.asarray(cover_with_boxes(cells, 1.0, (0.0, 0.0, 0.0))).astype(int), strict=True
    ):
        rebuilt[x0:x1, y0:y1, z0:z1] += 1
    np.testing.assert_array_equal(rebuilt, cells)
