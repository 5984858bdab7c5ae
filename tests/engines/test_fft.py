"""The engine by transforms: tilings and exact sums."""

import numpy as np
import pytest
import scipy.fft
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace.engines import fft
from cspace.engines.fft import (
    MAX_ERROR,
    SECONDS_PER_POINT,
    TIMED_SIZES,
    UNIT_ROUNDOFF,
    choose_tiling,
    error_bound,
    fast_length,
    growth,
    transform_seconds,
)
from cspace.raster import Raster
from tests.oracles import collide, overlaps_by_shifts
from tests.strategies import seeds


def check(occupied, rasters, outside):
    """Check counts, hits and added hits against the sum."""
    counts, _ = collide(fft, occupied, rasters, outside, np.int32, workers=1)
    hits, _ = collide(fft, occupied, rasters, outside, workers=2)
    marks, _ = collide(fft, occupied, rasters, outside, np.uint8, add=True, workers=2)
    for raster, count, hit, mark in zip(rasters, counts, hits, marks, strict=True):
        expected = overlaps_by_shifts(occupied, raster, outside)
        assert (count == expected).all()
        assert (hit == (expected > 0)).all()
        assert (mark == 7 + (expected > 0)).all()


@pytest.mark.parametrize(("axis", "outside"), [(0, True), (1, False), (2, True)])
def test_tiles_with_constant_lines_are_exact(axis, outside):
    """Fill all lines of inner tiles, or none."""
    occupied = np.zeros((200, 200, 200), dtype=bool)
    np.moveaxis(occupied, axis, 0)[[3, 70, 71, 72, 90, 149, 197]] = True
    raster = Raster.from_bitmap(np.indices((3, 4, 5)).prod(axis=0) == 4, (-1, -2, 1))
    assert max(choose_tiling(occupied.shape, raster.cells.shape, raster.count).step) < 80
    check(occupied, [raster], outside)


@settings(max_examples=20)
@given(seeds)
def test_correlation_is_exact_for_slabs_bars_and_boxes(seed):
    """Fill some lines and layers with obstacles, or with none."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros(rng.integers(30, 110, 3), dtype=bool)
    for _ in range(rng.integers(1, 4)):
        cuts = [np.sort(rng.integers(0, n + 1, 2)) if rng.random() < 0.5 else (0, n) for n in occupied.shape]
        occupied[tuple(slice(*cut) for cut in cuts)] ^= True
    cells, lower = rng.random(rng.integers(1, 5, 3)) < 0.7, rng.integers(-6, 3, 3)
    raster = Raster.from_bitmap(cells, tuple(lower.tolist()))
    check(occupied, [raster], bool(rng.integers(2)))


@settings(max_examples=12)
@given(seeds)
def test_tiles_that_share_a_transform_are_exact(seed):
    """Encode overlaps of tiles as digits of one sum."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros(rng.integers(300, 500, 2), dtype=bool)
    for _ in range(rng.integers(1, 6)):
        low = rng.integers(0, occupied.shape)
        high = low + rng.integers(1, 300, 2)
        occupied[tuple(slice(*span) for span in zip(low, high, strict=True))] ^= rng.random() < 0.9
    occupied[tuple(rng.integers(0, occupied.shape, (9, 2)).T)] = True
    rasters = [
        Raster.from_bitmap(rng.random((30, 25)) < share, tuple(rng.integers(-20, 5, 2).tolist()))
        for share in rng.choice([0.3, 1.0], rng.integers(1, 3))
    ]
    outside = bool(rng.integers(2))
    count = max(raster.count for raster in rasters)
    assert choose_tiling(occupied.shape, (60, 55), count, 2, len(rasters)).stack > 1
    check(occupied, rasters, outside)


@settings(max_examples=8)
@given(seeds)
def test_rasters_that_share_a_transform_are_exact(seed):
    """Encode overlaps of rasters as digits of one sum."""
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(150, 300, 2)) < rng.choice([0.001, 0.05, 1.0])
    shares = rng.choice([0.1, 1.0], rng.integers(9, 14))
    rasters = [
        Raster.from_bitmap(rng.random(rng.integers(1, 16, 2)) < share, tuple(rng.integers(-20, 5, 2).tolist()))
        for share in shares
    ]
    rasters[3] = Raster.from_bitmap(np.arange(501)[None, :] % 500 == 0, (0, 0))  # one offset never falls on the map
    rasters[5] = Raster.from_bitmap(np.zeros((2, 2), bool), (0, 0))
    outside = bool(rng.integers(2))
    extent, count = (40, 40), max(raster.count for raster in rasters)
    assert choose_tiling(occupied.shape, extent, count, 2, len(rasters)).digits > 1
    check(occupied, rasters, outside)


def test_float64_is_used_if_float32_is_not_proven():
    disc = np.hypot(*np.mgrid[-250:251, -250:251]) <= 250
    raster = Raster.from_bitmap(disc, (-250, -250))
    occupied = np.zeros((700, 600), dtype=bool)
    occupied[350, 300] = occupied[10, 10] = True
    (counts,), precision = collide(fft, occupied, [raster], False, np.int32)
    assert precision == "float64"
    assert (
        error_bound(choose_tiling(occupied.shape, disc.shape, raster.count).tile, raster.count, "float32") > MAX_ERROR
    )
    expected = np.zeros((1200, 1100), dtype=int)
    for i, j in np.argwhere(occupied):
        expected[i : i + 501, j : j + 501] += disc[::-1, ::-1]
    assert (counts == expected[250:950, 250:850]).all()
    small = Raster.from_bitmap(disc[240:261, 240:261], (-10, -10))
    assert collide(fft, occupied[:50, :50], [small], False)[1] == "float32"


@settings(max_examples=20)
@given(seeds, st.sampled_from([64, 90, 128, 240, 256]))
def test_the_error_stays_below_its_bound(seed, length):
    """Try random and aligned inputs."""
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
def test_transforms_have_fast_lengths(least):
    length = fast_length(least)
    assert least <= length < 2 * least + 1
    growth(length)  # raises for other prime factors


def test_tiles_fit_the_cache_and_the_robot():
    """Test small and large robots on a map."""
    small = choose_tiling((4096, 4096), (65, 65), 3000)
    assert all(4 * 65 <= length <= 1024 for length in small.tile)
    assert choose_tiling((100, 100), (100, 100), 7000).step >= (100, 100)


@pytest.mark.parametrize("size", [1, 2**18])
def test_robot_spectra_larger_than_their_memory_are_transformed_in_rounds(monkeypatch, size):
    monkeypatch.setattr(fft, "MAX_SPECTRA_BYTES", size)
    occupied = np.random.default_rng(1).random((200, 120)) < 0.02
    rasters = [Raster.from_bitmap(np.ones((3, 4 + k), bool), (-1, -k)) for k in range(40)]
    for used in (rasters[:1], rasters):
        seen = []
        hits, _ = collide(
            fft, occupied, used, True, workers=2, progress=lambda done, total, seen=seen: seen.append((done, total))
        )
        assert seen[-1][0] == seen[-1][1]
        for raster, hit in zip(used, hits, strict=True):
            assert (hit == (overlaps_by_shifts(occupied, raster, True) > 0)).all()


def test_transforms_cost_more_if_they_are_larger():
    for precision, known in SECONDS_PER_POINT.items():
        seconds = [transform_seconds(2**k, precision) for k in range(8, 35)]
        assert (np.diff(seconds) > 0).all()
        assert transform_seconds(TIMED_SIZES[2], precision) == pytest.approx(TIMED_SIZES[2] * known[2], rel=0.3)
