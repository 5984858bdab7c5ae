"""The direct engine against sums taken one by one, and against the transforms, with which it shares no code."""

import threading

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import oracles
from cspace.bits import dilate
from cspace.bits.dilation import dilation_bytes
from cspace.bits.runs import Runs
from cspace.fourier import correlate
from cspace.raster import Raster
from strategies import bitmaps, seeds


def by_sets(occupied, raster, outside):
    """Whether each cell overlaps, one offset after the other."""
    wide = np.pad(occupied, [(n + 1, n + 1) for n in occupied.shape], constant_values=outside)
    hit = np.zeros(occupied.shape, dtype=bool)
    for offset in np.argwhere(raster.cells) + raster.lower:
        # Beyond the pads all is like the pads.
        near = [int(np.clip(m, -n - 1, n + 1)) + n + 1 for m, n in zip(offset, occupied.shape, strict=True)]
        hit |= wide[tuple(slice(m, m + n) for m, n in zip(near, occupied.shape, strict=True))]
    return hit


@given(bitmaps(9), bitmaps(7), st.tuples(st.integers(-12, 6), st.integers(-12, 6)), st.booleans())
@example(np.ones((1, 1), bool), np.ones((1, 1), bool), (0, 0), False)
@example(np.zeros((4, 4), bool), np.ones((20, 20), bool), (-9, -9), True)
@example(np.ones((4, 4), bool), np.zeros((2, 2), bool), (0, 0), True)
def test_equal_to_the_sum(occupied, cells, lower, outside):
    raster = Raster.trimmed(cells, lower)
    hits = dilate(occupied, [raster], outside=outside)[0]
    expected = oracles.overlap(occupied, oracles.raster_offsets(raster), outside)
    assert {k: hits[k] for k in np.ndindex(hits.shape)} == {k: count > 0 for k, count in expected.items()}


@settings(max_examples=60)
@given(seeds, st.integers(2, 3))
def test_equal_to_the_transforms(seed, dim):
    """Words, their borders, runs longer than words, many rasters of one call, and threads."""
    rng = np.random.default_rng(seed)
    largest, across = {2: (300, 60), 3: (60, 14)}[dim]
    occupied = rng.random(rng.integers(1, largest, dim)) < rng.choice([0.0005, 0.05, 0.5, 1.0])
    rasters = []
    for _ in range(rng.integers(1, 4)):
        size = rng.integers(1, across, dim)
        size[-1] = rng.integers(1, 200)
        cells = rng.random(size) < rng.choice([0.01, 0.7, 1.0])
        rasters.append(Raster.trimmed(cells, tuple((rng.integers(-size, 10)).tolist())))
    outside = bool(rng.integers(2))
    expected = correlate(occupied, rasters, outside=outside, workers=1).results
    hits = dilate(occupied, rasters, outside=outside, workers=2)
    marks = [np.full(occupied.shape, 7, dtype=np.uint8) for _ in rasters]
    dilate(occupied, rasters, outside=outside, out=marks, add=True, workers=1)
    for wanted, hit, mark, raster in zip(expected, hits, marks, rasters, strict=True):
        assert (hit == wanted).all()
        assert (mark == 7 + wanted.astype(int)).all()
        if raster.count * occupied.size < 2e7:
            assert (hit == by_sets(occupied, raster, outside)).all()


@pytest.mark.parametrize("outside", [False, True])
def test_many_blocks_in_threads(outside):
    rng = np.random.default_rng(5)
    occupied = rng.random((1500, 1100)) < 0.0002
    cells = rng.random((41, 130)) < 0.5
    raster = Raster.trimmed(cells, (-20, -71))
    steps = []
    hits = dilate(
        occupied, [raster], outside=outside, workers=2, progress=lambda done, total: steps.append((done, total))
    )
    assert (hits[0] == correlate(occupied, [raster], outside=outside).results[0]).all()
    assert len(steps) > 1
    assert [done for done, _ in steps] == list(range(1, steps[-1][1] + 1))


def test_one_worker_stays_in_the_calling_thread(monkeypatch):
    def refuse(self):
        raise AssertionError("a thread was started")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    occupied = np.zeros((900, 900), dtype=bool)
    occupied[450, 450] = True
    hits = dilate(occupied, [Raster.trimmed(np.ones((301, 301), bool), (-150, -150))], outside=False, workers=1)[0]
    assert hits.sum() == 301**2


def test_a_run_does_not_see_the_next_row():
    """It reaches far beyond the end of a row on one side, and not at all on the other."""
    occupied = np.zeros((5, 64), dtype=bool)
    occupied[1:, :9] = True
    raster = Raster.trimmed(np.ones((1, 60), bool), (0, 0))
    assert (dilate(occupied, [raster], outside=False)[0] == occupied).all()


def test_a_map_that_is_not_in_one_piece():
    rng = np.random.default_rng(0)
    wide = rng.random((80, 200)) < 0.1
    raster = Raster.trimmed(np.ones((3, 5), bool), (-1, -2))
    assert (dilate(wide.T, [raster], outside=True)[0] == dilate(wide.T.copy(), [raster], outside=True)[0]).all()
    assert (dilate(wide[:, ::3], [raster], outside=True)[0] == by_sets(wide[:, ::3], raster, True)).all()


@given(bitmaps(12), st.tuples(st.integers(-9, 9), st.integers(-9, 9)), st.integers(1, 9), st.integers(1, 9))
def test_runs_are_the_offsets_that_can_fall_on_the_map(cells, lower, nx, ny):
    raster = Raster.trimmed(cells, lower)
    runs = Runs.of(raster, (1, nx, ny))
    told = {(x, y + k) for _, x, y, n in runs.table.tolist() for k in range(n)}
    offsets = set(oracles.raster_offsets(raster))
    assert told == {(x, y) for x, y in offsets if abs(x) < nx and abs(y) < ny}
    assert runs.beyond is (len(told) < len(offsets))
    assert len(told) == runs.table[:, 3].sum()
    assert (np.diff(runs.table[:, 3]) >= 0).all()
    assert runs.lengths == len(set(runs.table[:, 3].tolist())) or not len(runs)


def test_memory_is_that_of_the_map_with_what_is_around_it():
    raster = Raster.trimmed(np.ones((21, 65), bool), (-10, -32))
    assert dilation_bytes((1000, 640), [Runs.of(raster, (1000, 640))]) == 1020 * 11 * 8  # 640 + 64 cells are 11 words
    assert dilation_bytes((1000, 640), [Runs.of(Raster.trimmed(np.ones((1, 1), bool), (2000, 0)), (1000, 640))]) == 0
