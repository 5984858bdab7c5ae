"""Overlap counts against counts of coinciding cells."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import Workspace
from cspace.raster import Raster
from tests.helpers import oracles
from tests.helpers.handmade import map_of
from tests.helpers.strategies import bitmaps, robots, seeds


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


def test_overlap_count_counts_columns_of_more_cells_than_int16_holds():
    cells = np.ones((1, 40_000), bool)
    raster = Raster.from_bitmap(cells, (0, 0))
    space = map_of(np.zeros(cells.shape), rasters=[(raster, raster)], occupied=cells)
    assert space.overlap_count([(0.125, 0.125), (0.125, 0.375)]).tolist() == [40_000, 39_999]
