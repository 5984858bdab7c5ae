"""Both engines, against plain sums and each other."""

import threading
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cspace._engines import ENGINES, choose_engine
from cspace._raster import Raster
from tests.helpers.oracles import collide, overlaps_by_shifts
from tests.helpers.strategies import examples, seeds

both = pytest.mark.parametrize("engine", list(ENGINES.values()), ids=list(ENGINES))


@st.composite
def problems(draw, dim=None, side=9, across=7):
    """Draw a bitmap, a raster and the exterior.

    Some offsets reach beyond the map.
    """
    dim = dim or draw(st.integers(2, 3))
    occupied = draw(hnp.arrays(np.bool_, st.tuples(*[st.integers(1, side)] * dim)))
    cells = draw(hnp.arrays(np.bool_, st.tuples(*[st.integers(1, across)] * dim)))
    return (
        occupied,
        Raster.from_bitmap(cells, draw(st.tuples(*[st.integers(-12, 6)] * dim))),
        draw(st.booleans()),
    )


@both
@examples(60)
@given(problem=problems())
@example(
    problem=(np.ones((4, 4), bool), Raster.from_bitmap(np.ones((20, 20), bool), (-9, -9)), True)
)
@example(problem=(np.ones((4, 4), bool), Raster.from_bitmap(np.zeros((2, 2), bool), (0, 0)), True))
def test_engines_count_what_the_sum_counts(engine, problem):
    occupied, raster, outside = problem
    expected = overlaps_by_shifts(occupied, raster, outside)
    (hits,) = collide(engine, occupied, [raster], outside)
    assert (hits == (expected > 0)).all()
    if engine.COUNTS:
        (counts,) = collide(engine, occupied, [raster], outside, np.int32)
        assert (counts == expected).all()


@examples(40)
@given(seeds, st.integers(2, 3))
def test_engines_agree_with_each_other(seed, dim):
    """Cross words and tiles, by many rasters and threads."""
    rng = np.random.default_rng(seed)
    largest, across = {2: (300, 60), 3: (60, 14)}[dim]
    occupied = rng.random(rng.integers(1, largest, dim)) < rng.choice([0.0005, 0.05, 0.5, 1.0])
    occupied[: rng.integers(0, 90)] ^= rng.random() < 0.3
    occupied.setflags(write=False)  # like the cells of a workspace
    rasters = []
    for _ in range(rng.integers(1, 5)):
        size = rng.integers(1, across, dim)
        size[-1] = rng.integers(1, 200 if dim == 2 else 80)
        cells = rng.random(size) < rng.choice([0.01, 0.7, 1.0])
        rasters.append(Raster.from_bitmap(cells, tuple((rng.integers(-size, 10)).tolist())))
    outside = bool(rng.integers(2))
    corner = tuple(slice(n) for n in rng.integers(1, np.add(occupied.shape, 1)))
    expected = collide(ENGINES["fft"], occupied, rasters, outside, workers=2)
    small = {"MIN_WORD_RUNS_FOR_THREADS": 1, "BLOCK_TASKS_PER_THREAD": 1}
    with patch.multiple("cspace._engines.dilation", **small):
        hits = collide(ENGINES["direct"], occupied, rasters, outside, workers=2)
    for engine in ENGINES.values():
        marks = collide(engine, occupied, rasters, outside, np.uint8, add=True, workers=1)
        parts = [np.empty_like(each[corner]) for each in expected]
        engine.write_overlaps(occupied, rasters, parts, outside=outside, workers=2)
        for each, hit, mark, part in zip(expected, hits, marks, parts, strict=True):
            assert (hit == each).all() and (mark == 7 + each.astype(int)).all()
            assert (part == each[corner]).all()


@both
def test_one_worker_stays_in_the_calling_thread(engine, monkeypatch):
    def refuse(self):
        raise AssertionError("a thread was started")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    occupied = np.zeros((900, 900), dtype=bool)
    occupied[450, 450] = True
    raster = Raster.from_bitmap(np.ones((301, 301), bool), (-150, -150))
    assert collide(engine, occupied, [raster], False, workers=1)[0].sum() == 301**2


@both
def test_an_error_in_the_progress_callback_stops_the_run(engine):
    def stop(done, total):
        raise KeyboardInterrupt

    before = threading.active_count()
    occupied = np.random.default_rng(0).random((4000, 300)) < 0.1
    with pytest.raises(KeyboardInterrupt):
        collide(
            engine,
            occupied,
            [Raster.from_bitmap(np.ones((25, 5), bool), (-2, -2))],
            True,
            workers=2,
            progress=stop,
        )
    assert threading.active_count() == before


def test_auto_chooses_dilation_except_for_counts_and_very_many_rows():
    block = Raster.from_bitmap(np.ones((300, 300), bool), (0, 0))
    sieve = Raster.from_bitmap(np.indices((301, 301))[1] % 4 == 0, (0, 0))
    assert choose_engine([block]) == "direct"
    assert choose_engine([block], counts=True) == "fft"
    assert choose_engine([sieve]) == "fft"
    assert choose_engine([block] * 30 + [sieve]) == "direct"
