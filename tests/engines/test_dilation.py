"""The engine by dilation of bitmaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace.engines import dilation, fft
from cspace.engines.dilation import ClippedRuns
from cspace.raster import Raster
from tests.helpers.oracles import collide, overlaps_by_shifts, raster_offsets
from tests.helpers.strategies import bitmaps, seeds


@pytest.mark.parametrize("outside", [False, True])
def test_dilation_in_threads_equals_dilation_in_one(outside):
    rng = np.random.default_rng(5)
    occupied = rng.random((1500, 1100)) < 0.0002
    raster = Raster.from_bitmap(rng.random((41, 130)) < 0.5, (-20, -71))
    (ours,) = collide(dilation, occupied, [raster], outside, workers=2)
    (theirs,) = collide(fft, occupied, [raster], outside)
    assert (ours == theirs).all()


def test_a_run_does_not_reach_into_the_next_row():
    """Put a run far beyond one end of a row."""
    occupied = np.zeros((5, 64), dtype=bool)
    occupied[1:, :9] = True
    (hit,) = collide(
        dilation, occupied, [Raster.from_bitmap(np.ones((1, 60), bool), (0, 0))], False
    )
    assert (hit == occupied).all()


@given(
    bitmaps(12),
    st.tuples(st.integers(-9, 9), st.integers(-9, 9)),
    st.integers(1, 9),
    st.integers(1, 9),
)
def test_runs_are_the_offsets_that_can_fall_on_the_map(cells, lower, nx, ny):
    raster = Raster.from_bitmap(cells, lower)
    other = Raster.from_bitmap(np.ones((2, 3), bool), (0, 0))
    _, runs, _ = ClippedRuns.of([other, raster, other], (1, nx, ny))
    covered = {(x, y + k) for _, x, y, n in runs.table.tolist() for k in range(n)}
    offsets = set(raster_offsets(raster))
    assert covered == {(x, y) for x, y in offsets if abs(x) < nx and abs(y) < ny}
    assert runs.clipped is (len(covered) < len(offsets))
    assert len(covered) == runs.table[:, 3].sum()
    assert (np.diff(runs.table[:, 3]) >= 0).all()


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
