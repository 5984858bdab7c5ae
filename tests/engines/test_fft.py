"""The engine by transforms: exact sums, tiles and their proof."""

import numpy as np
import pytest
from hypothesis import given

from cspace._engines import fft
from cspace._engines.fft import choose_tiling, clip_raster
from cspace._raster import Raster
from tests.helpers.oracles import collide, overlaps_by_shifts
from tests.helpers.strategies import examples, seeds


def box_sums(occupied, raster, outside):
    """Return the overlaps of a full raster by sums over boxes, in integers."""
    pads = [
        (max(0, -low), max(0, high)) for low, high in zip(raster.lower, raster.upper, strict=True)
    ]
    sums = np.pad(occupied, pads, constant_values=outside).astype(np.int64)
    for axis, (side, low) in enumerate(zip(raster.cells.shape, raster.lower, strict=True)):
        sums = np.insert(np.cumsum(sums, axis=axis), 0, 0, axis=axis)
        first = pads[axis][0] + low + np.arange(occupied.shape[axis])
        sums = sums.take(first + side, axis) - sums.take(first, axis)
    return sums


@pytest.mark.parametrize("sides, precision", [((70, 95), "float32"), ((250, 700), "float64")])
@examples(6)
@given(seed=seeds)
def test_large_counts_are_exact(seed, sides, precision):
    """Draw counts near the limit of float32, and counts far above it."""
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(500, 800, 2)) < rng.choice([0.01, 0.5, 0.99])
    cells = np.ones(rng.integers(*sides, 2), bool)
    raster = Raster.from_bitmap(cells, tuple(rng.integers(-np.array(cells.shape), 1).tolist()))
    outside = bool(rng.integers(2))
    tiling = choose_tiling(occupied.shape, [clip_raster(raster, occupied.shape)])
    assert tiling.precision == precision
    (counts,) = collide(fft, occupied, [raster], outside, np.int32)
    assert (counts == box_sums(occupied, raster, outside)).all()


@pytest.mark.parametrize("count", [1, 40])
def test_spectra_larger_than_their_memory_are_used_in_batches(monkeypatch, count):
    monkeypatch.setattr(fft, "MAX_SPECTRA_BYTES", 2**18)
    occupied = np.random.default_rng(1).random((200, 120)) < 0.02
    rasters = [Raster.from_bitmap(np.ones((3, 4 + k), bool), (-1, -k)) for k in range(count)]
    seen = []

    def report(done, total):
        seen.append((done, total))

    hits = collide(fft, occupied, rasters, True, workers=2, progress=report)
    total = seen[-1][1]
    assert seen == [(done, total) for done in range(1, total + 1)]
    for raster, hit in zip(rasters, hits, strict=True):
        assert (hit == (overlaps_by_shifts(occupied, raster, True) > 0)).all()
