"""States outside the grid against rasters."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED
from cspace._raster import Raster
from cspace._record.exterior import Exterior
from tests.helpers.strategies import examples, seeds

SLICES = 2


@examples(60)
@given(seeds, st.integers(2, 3), st.booleans())
def test_exterior_states_agree_with_the_rasters(seed, dim, exterior_blocked):
    """Compare with obstacles at the offsets of the rasters."""
    rng = np.random.default_rng(seed)
    shape, rasters = tuple(rng.integers(1, 5, dim).tolist()), []
    occupied = rng.random(shape) < 0.3
    for _ in range(SLICES):
        cells = rng.random(rng.integers(1, 4, dim)) < 0.7
        lower = tuple(rng.integers(-3, 3, dim).tolist())
        inner = cells & (rng.random(cells.shape) < 0.8)
        rasters.append((Raster.from_bitmap(cells, lower), Raster.from_bitmap(inner, lower)))
    exterior = Exterior.of(occupied, rasters, "blocked" if exterior_blocked else "free")
    around = np.argwhere(np.ones(np.add(shape, 12))) - 6
    around = around[((around < 0) | (around >= shape)).any(axis=1)]
    wide = np.pad(occupied, 20, constant_values=exterior_blocked)

    def hits(raster):
        points = around[:, None] + np.argwhere(raster.cells) + raster.lower + 20
        return wide[tuple(np.moveaxis(points, -1, 0))].any(axis=1)

    for (outer, inner), (*box, state) in zip(rasters, exterior.table.tolist(), strict=True):
        first, last = np.split(np.array(box), 2)
        states = np.where(((first <= around) & (around <= last)).all(axis=1), MIXED, state)
        assert not hits(outer)[states == FREE].any()
        assert hits(inner)[states == BLOCKED].all()
        far = BLOCKED if exterior_blocked and inner.count else MIXED if exterior_blocked else FREE
        assert state == far and far in states
