"""States outside the grid against rasters."""

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED
from cspace.raster import Raster
from cspace.record.exterior import Exterior
from tests.helpers.handmade import Outside
from tests.helpers.strategies import seeds

SLICES = 2


@settings(max_examples=60)
@given(seeds, st.integers(2, 3), st.booleans())
def test_exterior_states_agree_with_the_rasters(seed, dim, exterior_blocked):
    """Compare with obstacles at the offsets of the rasters."""
    rng = np.random.default_rng(seed)
    shape, rasters = tuple(rng.integers(1, 5, dim).tolist()), []
    occupied = rng.random(shape) < 0.3
    for _ in range(SLICES):
        cells, lower = (
            rng.random(rng.integers(1, 4, dim)) < 0.7,
            tuple(rng.integers(-3, 3, dim).tolist()),
        )
        inner = cells & (rng.random(cells.shape) < 0.8)
        rasters.append((Raster.from_bitmap(cells, lower), Raster.from_bitmap(inner, lower)))
    exterior = Exterior.of(occupied, rasters, "blocked" if exterior_blocked else "free")
    around = [
        k
        for k in product(*(range(-6, n + 6) for n in shape))
        if not all(0 <= c < n for c, n in zip(k, shape, strict=True))
    ]
    wide = np.pad(occupied, 20, constant_values=exterior_blocked)
    for (outer, inner), row in zip(rasters, exterior.table, strict=True):
        outside, cells = Outside(row[:-1], int(row[-1])), np.array(around)

        def hits(raster, cells=cells):
            points = cells[:, None] + np.argwhere(raster.cells) + raster.lower + 20
            return wide[tuple(np.moveaxis(points, -1, 0))].any(axis=1)

        first, last = np.split(outside.box, 2)
        states = np.where(((first <= cells) & (cells <= last)).all(axis=1), MIXED, outside.state)
        assert not hits(outer)[states == FREE].any()
        assert hits(inner)[states == BLOCKED].all()
        far = BLOCKED if exterior_blocked and inner.count else MIXED if exterior_blocked else FREE
        assert outside.state == far and far in states
