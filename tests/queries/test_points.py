"""Queries of single configurations and of boxes of configurations."""

import itertools
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cspace import FREE, MIXED
from cspace._raster import Raster
from cspace._rotations import Rotations
from cspace._rotations.base import TWO_PI
from tests.helpers.handmade import (
    map_of,
    outsides,
    state_of,
    states,
)
from tests.helpers.placements import is_free_around
from tests.helpers.strategies import (
    boundary_yaws,
    examples,
    resolve_yaw,
    rotation_cells,
    seeds,
    uniform,
)

# ---- the state of a cell -------------------------------------------------------------------------


@examples(100)
@given(states(), outsides(3), seeds)
def test_boundary_belongs_to_the_cell_above(state, outside, seed):
    """Use numbers exact in binary."""
    rng, dim = np.random.default_rng(seed), state.ndim
    outside, lower = outside.project(dim), np.array([-1.0, 0.5, 2.0])[:dim]
    space = map_of(state, None, outside, 0.25, tuple(lower.tolist()))
    upper = lower + 0.25 * np.array(state.shape)
    q = lower + rng.uniform(-5, 12, (200, dim)) * 0.25
    q = np.where(rng.random(q.shape) < 0.3, np.rint(q * 4) / 4, q)
    q = np.where(rng.random(q.shape) < 0.1, upper, q)
    cells = np.floor((q - lower) / 0.25).astype(int)
    cells -= q == upper
    assert space.classify(q).tolist() == [
        state_of(state, outside, tuple(cell)) for cell in cells.tolist()
    ]


@examples(50)
@given(rotation_cells(), seeds)
def test_batches_find_the_cell_of_each_yaw(cells, seed):
    """Ask at borders and on both sides of them, also beyond a turn."""
    rng, rotations = np.random.default_rng(seed), Rotations.of(cells)
    state = rng.integers(0, 3, (len(rotations), 1, 1))
    borders = rng.choice(rotations.borders, 300) + TWO_PI * rng.integers(-2, 3, 300)
    sides = np.nextafter(borders, rng.choice([-math.inf, math.inf], 300))
    yaws = np.concatenate([borders, sides, rng.uniform(-9.0, 9.0, 300)])
    q = np.column_stack([np.full((len(yaws), 2), 0.1), yaws])
    np.testing.assert_array_equal(
        map_of(state, cells).classify(q), state[rotations.cell_of(yaws), 0, 0]
    )


# ---- boxes of configurations ---------------------------------------------------------------------

coordinates = st.one_of(
    st.integers(-2, 7).map(lambda k: k / 4), st.integers(-6, 21).map(lambda k: k / 12)
)
points = st.tuples(*[coordinates | st.floats(-0.5, 1.75)] * 3)


H, SIDE = 0.25, 4


def meets_box(cell, borders, q, distance, angle, slack=0.0):
    """Return True if a cell meets the box around q."""
    if not all(
        H * n - distance - slack <= v <= H * (n + 1) + distance + slack
        for n, v in zip(cell[1:], q, strict=False)
    ):
        return False
    low, high = borders[cell[0]] - angle - slack, borders[cell[0] + 1] + angle + slack
    return any(low <= q[-1] + wraps * TWO_PI <= high for wraps in range(-5, 6))


@examples(60)
@given(
    rotation_cells(8),
    st.tuples(
        uniform(0, 1),
        uniform(0, 1) | st.integers(0, 8).map(lambda k: k / 8),
        uniform(-7, 7) | boundary_yaws,
    ),
    st.sampled_from([0.0, 0.05, 0.125, 0.25, 0.6]),
    st.one_of(uniform(0, 3), st.sampled_from([0.0, 0.1, 2.0, math.pi, 9.0])),
    st.sampled_from([(SIDE, SIDE), (2, 3, 3)]),
)
def test_a_chunk_that_stays_tests_exactly_the_cells_of_a_box(
    rotations, end, distance, angle, shape
):
    """Block all cells outside the box, then each inside."""
    boundaries = Rotations.of(rotations).borders
    x, y, yaw = end
    yaw = resolve_yaw(yaw, boundaries)
    q = (x, y, yaw) if len(shape) == 2 else (0.5 * x, 0.75 * y, 0.3, yaw)
    state = np.full((len(boundaries) - 1, *shape), MIXED, dtype=np.uint8)
    cells = list(np.ndindex(state.shape))
    for cell in cells:
        if meets_box(cell, boundaries, q, distance, angle, slack=1e-8):
            state[cell] = FREE
    assert is_free_around(map_of(state, rotations, spacing=H), [q], distance, angle).all()
    inside = [cell for cell in cells if meets_box(cell, boundaries, q, distance, angle)]
    for cell in {inside[0], inside[-1], *inside[:: 1 + len(inside) // 8]} if inside else ():
        one = np.full_like(state, FREE)
        one[cell] = MIXED
        assert not is_free_around(map_of(one, rotations, spacing=H), [q], distance, angle).any()


@given(seeds, st.integers(2, 3), st.sampled_from(["free", "blocked"]))
def test_overlap_count_counts_the_pairs_of_cells(seed, dim, outside):
    """Use any raster, in the grid and around it."""
    rng = np.random.default_rng(seed)
    shape, size = (tuple(rng.integers(1, stop, dim).tolist()) for stop in (6, 5))
    occupied, cells = rng.random(shape) < 0.4, rng.random(size) < 0.6
    cells[tuple(rng.integers(0, size))] = True
    raster = Raster.from_bitmap(cells, tuple(rng.integers(-4, 3, dim).tolist()))
    space = map_of(np.zeros(shape), outside=outside, rasters=[(raster, raster)], occupied=occupied)
    points = np.array(list(itertools.product(*(range(-3, n + 3) for n in shape))))
    wide = np.pad(occupied, 12, constant_values=outside == "blocked")
    offsets = np.argwhere(raster.cells) + raster.lower
    expected = wide[tuple(np.moveaxis(points[:, None] + offsets + 12, -1, 0))].sum(axis=1)
    q = 0.25 * points + 0.125
    assert space.overlap_count(q).tolist() == expected.tolist()
    assert space.contains_robot(q).tolist() == (expected == len(offsets)).tolist()
