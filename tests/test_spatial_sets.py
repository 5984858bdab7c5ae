"""Maps of space as sets: what lies outside, connectivity against flood fills, chains, samples."""

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED
from cspace.raster.raster import Raster
from handmade import Outside, cells_around, outsides, state_of
from strategies import seeds

ALONE = np.zeros(1, dtype=np.int64)

# ---- outside ---------------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(seeds, st.tuples(*[st.integers(1, 4)] * 3), st.tuples(*[st.integers(1, 3)] * 3), st.booleans())
def test_what_is_said_of_the_outside_follows_from_the_rasters(seed, shape, size, walled):
    """Outside the grid, FREE where no outer offset meets an obstacle and BLOCKED only where an inner one leaves."""
    rng = np.random.default_rng(seed)
    occupied, cells = rng.random(shape) < 0.3, rng.random(size) < 0.7
    lower = tuple(rng.integers(-3, 3, 3).tolist())
    outer, inner = Raster.trimmed(cells, lower), Raster.trimmed(cells & (rng.random(size) < 0.8), lower)
    outside = Outside.of(occupied, outer, inner, "blocked" if walled else "free")

    def hits(raster, k, beyond):
        spots = (np.argwhere(raster.cells) + raster.lower + k).tolist()
        inside = [all(0 <= c < n for c, n in zip(m, shape, strict=True)) for m in spots]
        return any(occupied[tuple(m)] if within else beyond for m, within in zip(spots, inside, strict=True))

    said = set()
    for k in product(*(range(-8, n + 8) for n in shape)):
        if all(0 <= c < n for c, n in zip(k, shape, strict=True)):
            continue
        found = state_of(np.zeros(shape), outside, k)
        assert found != FREE or not hits(outer, k, walled)
        assert found != BLOCKED or hits(inner, k, walled)
        said.add(found)
    far = BLOCKED if walled and inner.count else MIXED if walled else FREE
    assert outside.state == far and far in said


@settings(max_examples=100)
@given(outsides(), st.tuples(*[st.integers(1, 4)] * 3))
def test_walls_are_what_is_not_free(outside, shape):
    state = np.zeros(shape, dtype=np.uint8)
    walls = outside.walls(shape)
    assert walls.shape == (len(walls), 6)
    blocked = True
    for cell in cells_around(state, outside):
        if all(0 <= c < n for c, n in zip(cell, shape, strict=True)):
            continue
        own = state_of(state, outside, cell)
        middle = np.array(cell) + 0.5
        assert ((walls[:, :3] < middle) & (middle < walls[:, 3:])).all(axis=1).any() == (own != FREE)
        blocked &= own == BLOCKED
    assert outside.is_all_blocked(shape) == blocked
    overlap = np.minimum(walls[:, 3:], shape) - np.maximum(walls[:, :3], 0)
    assert (overlap <= 0).any(axis=1).all()  # none reaches into the grid
