"""Grids: cells, boundaries, batches and refusals."""

from hypothesis import given
from hypothesis import strategies as st

from cspace import Grid


def test_boundaries_belong_to_the_cell_above_and_the_last_to_the_last_cell():
    grid = Grid((0, 10), 1.0, (3, 2))
    assert grid.cell_of((0.0, 10.0)).tolist() == [0, 0]
    assert grid.cell_of((1.0, 11.0)).tolist() == [1, 1]
    assert grid.cell_of((3.0, 12.0)).tolist() == [2, 1]
    assert grid.cell_of((-1e-9, 12.1)).tolist() == [-1, 2]
    assert grid.contains([(0, 10), (3, 12), (3.01, 11), (1, 9.9)]).tolist() == [
        True,
        True,
        False,
        False,
    ]


@given(st.integers(0, 19), st.integers(0, 6), st.floats(0.01, 3.0), st.floats(-50, 50))
def test_a_center_lies_in_its_cell(i, j, spacing, low):
    grid = Grid((low, -low), spacing, (20, 7))
    assert grid.cell_of(grid.center_of((i, j))).tolist() == [i, j]
    assert grid.centers(0)[i] == grid.center_of((i, j))[0]


def test_far_points_do_not_wrap_around():
    grid = Grid((0, 0), 1e-3, (10, 10))
    assert (grid.cell_of((1e300, -1e300)) == (2**62, -(2**62))).all()
