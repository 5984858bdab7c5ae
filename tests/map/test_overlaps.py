"""Overlap counts against counts of coinciding cells."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import Workspace
from cspace.map.overlaps import Runs, Sums
from cspace.raster import Raster
from tests import oracles
from tests.handmade import map_of
from tests.strategies import bitmaps, robots, seeds


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
@settings(max_examples=25)
@given(bitmaps(10), robots(0.25), st.sampled_from(["blocked", "free"]))
def test_overlap_count_equals_the_stored_count_and_the_sum(occupied, robot, outside):
    space = cspace.build(Workspace.from_array(occupied, 0.15), robot, outside=outside, counts=True)
    cells = np.argwhere(np.ones_like(occupied))
    counts = space.overlap_count(space.grid.center_of(cells))
    assert (counts == space.overlap_counts[tuple(cells.T)]).all()
    offsets = oracles.raster_offsets(robot.rasters(0.15)[0])
    expected = oracles.overlap(occupied, offsets, outside == "blocked")
    assert counts.tolist() == [expected[tuple(cell)] for cell in cells.tolist()]


@settings(max_examples=50)
@given(seeds, st.integers(2, 3), st.sampled_from(["free", "blocked"]))
def test_overlap_count_counts_the_pairs_of_cells(seed, dim, outside):
    """Use any raster, in the grid and around it."""
    rng = np.random.default_rng(seed)
    shape, size = (tuple(rng.integers(1, stop, dim).tolist()) for stop in (6, 5))
    occupied, cells = rng.random(shape) < 0.4, rng.random(size) < 0.6
    cells[tuple(rng.integers(0, size))] = True
    raster = Raster.from_bitmap(cells, tuple(rng.integers(-4, 3, dim).tolist()))
    space = map_of(np.zeros(shape), outside=outside, rasters=[(raster, raster)], occupied=occupied)
    points = np.array(list(itertools.product(*(range(-3, n + 3) for n in shape))))
    wide = np.pad(occupied, 12, constant_values=outside == "blocked")
    offsets = np.argwhere(raster.cells) + raster.lower
    expected = wide[tuple(np.moveaxis(points[:, None] + offsets + 12, -1, 0))].sum(axis=1)
    q = 0.25 * points + 0.125
    assert space.overlap_count(q).tolist() == expected.tolist()
    assert space.contains_robot(q).tolist() == (expected == len(offsets)).tolist()


def test_runs_cover_the_cells_of_a_raster():
    cells = np.random.default_rng(0).random((3, 4, 5)) < 0.5
    raster = Raster.from_bitmap(cells, (-2, 7, 1))
    runs = Runs.of([raster]).rows
    inside = {(dx, dy, first + k) for dx, dy, first, length in runs.tolist() for k in range(length)}
    assert inside == {tuple(cell) for cell in (np.argwhere(raster.cells) + raster.lower).tolist()}
    assert Runs.of([Raster.from_bitmap(np.zeros((2, 2, 2), bool), (0, 0, 0))]).rows.shape == (0, 4)


@pytest.mark.parametrize(("count", "dtype"), [(300, np.int16), (32_767, np.int16), (32_768, np.int32)])
def test_sums_of_long_columns_use_wide_enough_integers(count, dtype):
    sums = Sums(np.ones((1, 2, count), bool)).counts
    assert sums.dtype == dtype
    assert (sums == np.arange(count + 1)).all()
