"""The engine against sums taken one by one."""

import threading

import numpy as np
import pytest
import scipy.fft
from hypothesis import example, given, settings
from hypothesis import strategies as st

import oracles
from cspace.fourier import correlate, correlation
from cspace.fourier.precision import MARGIN, UNIT_ROUNDOFF, error_bound, growth
from cspace.fourier.tiles import choose_tiling, fast_length
from cspace.raster import Raster
from strategies import bitmaps, seeds


def by_shifts(occupied, raster, outside, pad=300):
    """Overlaps by adding up shifted copies of the map."""
    wide = np.pad(occupied, pad, constant_values=outside)
    total = np.zeros(occupied.shape, dtype=np.int64)
    for offset in np.argwhere(raster.cells) + raster.lower:
        total += wide[tuple(slice(pad + m, pad + m + n) for m, n in zip(offset, occupied.shape, strict=True))]
    return total


@given(bitmaps(9), bitmaps(7), st.tuples(st.integers(-12, 6), st.integers(-12, 6)), st.booleans())
@example(np.ones((1, 9), bool), np.ones((5, 1), bool), (-2, 0), True)
@example(np.zeros((4, 4), bool), np.ones((20, 20), bool), (-9, -9), False)
@example(np.ones((4, 4), bool), np.ones((20, 20), bool), (-9, -9), True)
@example(np.zeros((3, 3), bool), np.zeros((2, 2), bool), (0, 0), True)
def test_overlaps_equal_the_sum(occupied, cells, lower, outside):
    raster = Raster.trimmed(cells, lower)
    counts = correlate(occupied, [raster], outside=outside, counts=True).results[0]
    expected = oracles.overlap(occupied, oracles.raster_offsets(raster), outside)
    assert {k: counts[k] for k in np.ndindex(counts.shape)} == expected


@settings(max_examples=25)
@given(seeds)
def test_many_tiles_and_many_rasters(seed):
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(100, 400, 2)) < rng.choice([0.001, 0.05, 0.5])
    occupied[: rng.integers(0, 90)] = rng.random() < 0.5
    rasters = [
        Raster.trimmed(rng.random(rng.integers(1, 60, 2)) < 0.7, tuple(rng.integers(-40, 10, 2).tolist()))
        for _ in range(rng.integers(1, 4))
    ]
    outside = bool(rng.integers(2))
    counts = correlate(occupied, rasters, outside=outside, counts=True, workers=2)
    hits = correlate(occupied, rasters, outside=outside, workers=1)
    for raster, count, hit in zip(rasters, counts.results, hits.results, strict=True):
        expected = by_shifts(occupied, raster, outside)
        assert (count == expected).all()
        assert (hit == (expected > 0)).all()


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("outside", [False, True])
def test_tiles_of_constant_lines(axis, outside):
    """Inner tiles in space, all of whose lines along two axes are wholly obstacle or wholly free."""
    occupied = np.zeros((220, 220, 220), dtype=bool)
    np.moveaxis(occupied, axis, 0)[[3, 70, 71, 72, 90, 149, 217]] = True
    raster = Raster.trimmed(np.indices((3, 4, 5)).prod(axis=0) == 4, (-1, -2, 1))
    assert max(choose_tiling(occupied.shape, raster.cells.shape, raster.count).step) < 80
    counts = correlate(occupied, [raster], outside=outside, counts=True).results[0]
    assert (counts == by_shifts(occupied, raster, outside, 8)).all()


@settings(max_examples=20)
@given(seeds)
def test_slabs_bars_and_boxes(seed):
    """Some of the lines and layers are wholly obstacle or wholly free."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros(rng.integers(30, 110, 3), dtype=bool)
    for _ in range(rng.integers(1, 4)):
        cuts = [np.sort(rng.integers(0, n + 1, 2)) if rng.random() < 0.5 else (0, n) for n in occupied.shape]
        occupied[tuple(slice(*cut) for cut in cuts)] ^= True
    cells, lower = rng.random(rng.integers(1, 5, 3)) < 0.7, rng.integers(-6, 3, 3)
    raster = Raster.trimmed(cells, tuple(lower.tolist()))
    outside = bool(rng.integers(2))
    counts = correlate(occupied, [raster], outside=outside, counts=True).results[0]
    assert (counts == by_shifts(occupied, raster, outside, 12)).all()


@settings(max_examples=12)
@given(seeds)
def test_tiles_that_share_a_transform(seed):
    """Several overlaps as digits of one sum, of tiles some of which are wholly obstacle or wholly free."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros(rng.integers(300, 500, 2), dtype=bool)
    for _ in range(rng.integers(1, 6)):
        low = rng.integers(0, occupied.shape)
        high = low + rng.integers(1, 300, 2)
        occupied[tuple(slice(*ends) for ends in zip(low, high, strict=True))] ^= rng.random() < 0.9
    occupied[tuple(rng.integers(0, occupied.shape, (9, 2)).T)] = True
    rasters = [
        Raster.trimmed(rng.random((30, 25)) < share, tuple(rng.integers(-20, 5, 2).tolist()))
        for share in rng.choice([0.3, 1.0], rng.integers(1, 3))
    ]
    outside = bool(rng.integers(2))
    count = max(raster.count for raster in rasters)
    assert choose_tiling(occupied.shape, (60, 55), count, 2, len(rasters)).stack > 1
    counts = correlate(occupied, rasters, outside=outside, counts=True, workers=1)
    hits = correlate(occupied, rasters, outside=outside, workers=2)
    marks = [np.full(occupied.shape, 7, dtype=np.uint8) for _ in rasters]
    correlate(occupied, rasters, outside=outside, out=marks, add=True, workers=2)
    for raster, number, hit, mark in zip(rasters, counts.results, hits.results, marks, strict=True):
        expected = by_shifts(occupied, raster, outside)
        assert (number == expected).all()
        assert (hit == (expected > 0)).all()
        assert (mark == 7 + (expected > 0)).all()


@settings(max_examples=8)
@given(seeds)
def test_rasters_that_share_a_transform(seed):
    """Several overlaps as digits of one sum, over many tiles, for counts, hits and hits that are added."""
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(150, 300, 2)) < rng.choice([0.001, 0.05, 1.0])
    shares = rng.choice([0.1, 1.0], rng.integers(9, 14))
    rasters = [
        Raster.trimmed(rng.random(rng.integers(1, 16, 2)) < share, tuple(rng.integers(-20, 5, 2).tolist()))
        for share in shares
    ]
    rasters[3] = Raster.trimmed(np.arange(501)[None, :] % 500 == 0, (0, 0))  # one of its offsets is never on the map
    rasters[5] = Raster.trimmed(np.zeros((2, 2), bool), (0, 0))
    outside = bool(rng.integers(2))
    extent, count = (40, 40), max(raster.count for raster in rasters)
    assert choose_tiling(occupied.shape, extent, count, 2, len(rasters)).digits > 1
    counts = correlate(occupied, rasters, outside=outside, counts=True, workers=2)
    hits = correlate(occupied, rasters, outside=outside, workers=2)
    marks = [np.full(occupied.shape, 7, dtype=np.uint8) for _ in rasters]
    correlate(occupied, rasters, outside=outside, out=marks, add=True, workers=2)
    for raster, number, hit, mark in zip(rasters, counts.results, hits.results, marks, strict=True):
        expected = by_shifts(occupied, raster, outside, 501)
        assert (number == expected).all()
        assert (hit == (expected > 0)).all()
        assert (mark == 7 + (expected > 0)).all()


def test_float64_where_float32_is_not_proven():
    disc = np.hypot(*np.mgrid[-250:251, -250:251]) <= 250
    raster = Raster.trimmed(disc, (-250, -250))
    occupied = np.zeros((700, 600), dtype=bool)
    occupied[350, 300] = occupied[10, 10] = True
    result = correlate(occupied, [raster], outside=False, counts=True)
    assert result.precision == "float64"
    assert error_bound(choose_tiling(occupied.shape, disc.shape, raster.count).tile, raster.count, "float32") > MARGIN
    expected = np.zeros((1200, 1100), dtype=int)
    for i, j in np.argwhere(occupied):
        expected[i : i + 501, j : j + 501] += disc[::-1, ::-1]
    assert (result.results[0] == expected[250:950, 250:850]).all()
    small = Raster.trimmed(disc[240:261, 240:261], (-10, -10))
    assert correlate(occupied[:50, :50], [small], outside=False).precision == "float32"


@settings(max_examples=20)
@given(seeds, st.sampled_from([64, 90, 128, 240, 256]))
def test_the_error_stays_below_its_bound(seed, length):
    """Worst of random and of aligned inputs; transforms as the engine runs them."""
    rng = np.random.default_rng(seed)
    robot = rng.random((length // 3, length // 3)) < rng.choice([0.1, 1.0])
    tile = (rng.random((length, length)) < 0.5) - np.float32(0.5)
    if rng.integers(2):
        tile[: robot.shape[0], : robot.shape[1]] = robot - 0.5
    wide = scipy.fft.rfft2(robot.astype(np.float64), s=tile.shape)
    spectrum = scipy.fft.rfft2(tile.astype(np.float32)) * np.conj(wide).astype(np.complex64)
    got = scipy.fft.irfft2(spectrum, s=tile.shape)
    assert got.dtype == np.float32
    exact = scipy.fft.irfft2(scipy.fft.rfft2(tile.astype(np.float64)) * np.conj(wide), s=tile.shape)
    assert np.abs(got - exact).max() < error_bound(tile.shape, int(robot.sum()), "float32")


def test_bounds_grow_with_size_and_know_their_lengths():
    assert growth(8) < growth(16) < growth(48)
    with pytest.raises(ValueError, match="7"):
        growth(14)
    ratio = error_bound((64, 64), 9, "float64") / error_bound((64, 64), 9, "float32")
    assert 1.0 < ratio / (UNIT_ROUNDOFF["float64"] / UNIT_ROUNDOFF["float32"]) < 1.6


@given(st.integers(1, 5000))
def test_fast_lengths(least):
    length = fast_length(least)
    assert least <= length < 2 * least + 1
    growth(length)  # knows its prime factors


def test_tiles_fit_the_cache_and_the_robot():
    """A small robot on a large map gets tiles well below the map; a robot as large as the map a single tile."""
    small = choose_tiling((4096, 4096), (65, 65), 3000)
    assert all(4 * 65 <= length <= 1024 for length in small.tile)
    assert choose_tiling((100, 100), (100, 100), 7000).step >= (100, 100)


def test_progress_runs_to_the_end():
    seen = []
    occupied = np.random.default_rng(0).random((2000, 300)) < 0.1
    raster = Raster.trimmed(np.ones((5, 5), bool), (-2, -2))
    correlate(occupied, [raster], outside=True, workers=2, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1] == len(seen)


@pytest.mark.parametrize("size", [1, 2**18])
def test_robot_spectra_beyond_their_memory_are_taken_in_turns(monkeypatch, size):
    monkeypatch.setattr(correlation, "SPECTRA_BYTES", size)
    occupied = np.random.default_rng(1).random((200, 120)) < 0.02
    rasters = [Raster.trimmed(np.ones((3, 4 + k), bool), (-1, -k)) for k in range(40)]
    seen = []
    for used in (rasters[:1], rasters):
        results = correlate(
            occupied, used, outside=True, workers=2, progress=lambda done, total: seen.append((done, total))
        ).results
        assert seen[-1][0] == seen[-1][1]
        for raster, hit in zip(used, results, strict=True):
            assert (hit == (by_shifts(occupied, raster, True) > 0)).all()


def test_an_error_in_the_progress_callback_stops_the_run():
    def stop(done, total):
        raise KeyboardInterrupt

    before = threading.active_count()
    raster = Raster.trimmed(np.ones((5, 5), bool), (-2, -2))
    occupied = np.random.default_rng(0).random((4000, 300)) < 0.1
    with pytest.raises(KeyboardInterrupt):
        correlate(occupied, [raster], outside=True, workers=2, progress=stop)
    assert threading.active_count() == before
