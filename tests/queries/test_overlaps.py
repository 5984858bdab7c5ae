"""Overlap counts against counts of coinciding cells."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace.raster import Raster
from tests.helpers.handmade import map_of
from tests.helpers.strategies import seeds


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
