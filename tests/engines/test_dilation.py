"""The engine by dilation of bitmaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace.engines import dilation, fft
from cspace.raster import Raster
from tests.helpers.oracles import collide, overlaps_by_shifts
from tests.helpers.strategies import seeds


@pytest.mark.parametrize("outside", [False, True])
def test_dilation_in_threads_equals_dilation_in_one(outside):
    rng = np.random.default_rng(5)
    occupied = rng.random((1500, 1100)) < 0.0002
    raster = Raster.from_bitmap(rng.random((41, 130)) < 0.5, (-20, -71))
    (ours,) = collide(dilation, occupied, [raster], outside, workers=2)
    (theirs,) = collide(fft, occupied, [raster], outside)
    assert (ours == theirs).all()


@settings(max_examples=100)
@given(seeds, st.integers(2, 3), st.booleans())
def test_dilation_equals_shifted_copies_of_the_map(seed, dim, outside):
    """Cross words, bytes and layers, by runs of up to five words; read a corner of the results."""
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(1, {2: (90, 400), 3: (7, 12, 90)}[dim])) < rng.choice(
        [0.002, 0.1]
    )
    size = rng.integers(1, {2: (6, 320), 3: (3, 4, 80)}[dim])
    raster = Raster.from_bitmap(
        rng.random(size) < rng.choice([0.3, 1.0]), tuple(rng.integers(-size, 3).tolist())
    )
    expected = overlaps_by_shifts(occupied, raster, outside) > 0
    corner = tuple(slice(n) for n in rng.integers(1, np.add(occupied.shape, 1)))
    hits = np.empty_like(expected[corner])
    dilation.collide(occupied, [raster], [hits], outside=outside)
    assert (hits == expected[corner]).all()
