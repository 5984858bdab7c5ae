"""Look-ups in space: cells, edges against exact clipping, cubes, overlaps, quick checkers."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED, InputError, Workspace
from cspace.map.batches import answer, answer_edges
from cspace.map.overlaps import Runs, Sums
from cspace.raster.raster import Raster
from handmade import EMPTY, Outside, cells_around, frame_of, lookups_of, outsides, state_of, states, touches
from strategies import seeds

FREE_BEYOND = Outside(EMPTY, FREE)


def classify(look, q):
    return answer(q, 3, look.classify(), np.uint8, int)


def edges(look, q0, q1):
    return answer_edges(q0, q1, 3, look.edges)


def boxes(look, q, distance):
    return answer(q, 3, look.boxes(distance, 0.0), np.bool_, bool)


# ---- one cell --------------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(states(), outsides(), seeds)
def test_classify_is_the_state_of_the_cell(state, outside, seed):
    """Of the cell above a border, but for the grid's own upper border; spacing and corner are powers of two."""
    rng = np.random.default_rng(seed)
    look = lookups_of(state, outside, 0.25, (-1.0, 0.5, 2.0))
    upper = np.array([-1.0, 0.5, 2.0]) + 0.25 * np.array(state.shape)
    q = np.array([-1.0, 0.5, 2.0]) + rng.uniform(-3, 8, (200, 3)) * 0.25
    q = np.where(rng.random(q.shape) < 0.3, np.rint(q * 4) / 4, q)
    q = np.where(rng.random(q.shape) < 0.1, upper, q)
    cells = np.floor((q - (-1.0, 0.5, 2.0)) / 0.25).astype(int)
    cells -= q == upper
    assert classify(look, q).tolist() == [state_of(state, outside, tuple(cell)) for cell in cells.tolist()]


@pytest.mark.parametrize("batch", [(0,), (1,), (7,), (2, 3), (2, 1, 3)])
def test_batches_answer_in_kind(batch):
    look = lookups_of(np.random.default_rng(1).integers(0, 3, (4, 5, 6)))
    q = np.random.default_rng(0).uniform(-0.5, 2, (*batch, 3))
    states = classify(look, q)
    assert states.shape == batch and states.dtype == np.uint8
    assert states.ravel().tolist() == [classify(look, one) for one in q.reshape(-1, 3)]
    assert edges(look, q, q[..., ::-1]).shape == batch
    assert boxes(look, q, 0.1).shape == batch
    assert answer(q, 3, look.clearances(), np.float64, float).shape == batch
    assert type(classify(look, (0.1, 0.1, 0.1))) is int


@pytest.mark.parametrize("hole", range(3))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_refuses_what_is_not_finite(hole, value):
    look = lookups_of(np.zeros((2, 2, 2)))
    q = np.full((600, 3), 0.1)
    q[513, hole] = value
    last = look.clearances()
    for kernel in (look.classify(), look.boxes(0.1, 0.0), last):
        with pytest.raises(InputError, match="number 513"):
            answer(q, 3, kernel, np.float64 if kernel == last else np.uint8, float)
    for ends in ((q, q[:1]), (q[:1], q)):
        with pytest.raises(InputError, match="edge number 513"):
            edges(look, *ends)


def test_far_away_is_outside():
    look = lookups_of(np.zeros((2, 2, 2)), Outside(EMPTY, BLOCKED))
    assert classify(look, np.diag([1e300, -1e300, 1e30])).tolist() == [BLOCKED] * 3


# ---- edges -----------------------------------------------------------------------------------------------------------

coordinates = st.one_of(
    st.integers(-2, 7).map(lambda k: k / 4),
    st.integers(0, 4).map(lambda k: k / 4),
    st.floats(-0.5, 1.75),
    st.integers(-6, 21).map(lambda k: k / 12),
    st.sampled_from([5e-324, 1e-300, 1e-12, 0.25 + 2.0**-54]),
)
points = st.tuples(coordinates, coordinates, coordinates)


def ones_at(*cells, shape=(4, 4, 4)):
    state = np.zeros(shape, dtype=np.uint8)
    for cell in cells:
        state[cell] = MIXED
    return state


@settings(max_examples=300)
@given(states(4, (FREE,) * 12 + (MIXED,)), outsides(), points, points)
@example(ones_at((1, 1, 2)), FREE_BEYOND, (0.25, 0.25, 0.25), (0.75, 0.75, 0.75))  # through a lattice point
@example(ones_at((2, 1, 1)), FREE_BEYOND, (0.25, 0.25, 0.25), (0.75, 0.75, 0.75))
@example(ones_at((1, 2, 0)), FREE_BEYOND, (0.25, 0.25, 0.1), (0.75, 0.75, 0.1))  # through a line of the lattice
@example(ones_at((0, 2, 2)), FREE_BEYOND, (0.1, 0.25, 0.25), (0.1, 0.75, 0.75))
@example(ones_at((2, 2, 2)), FREE_BEYOND, (0.0, 0.5, 0.5), (1.0, 0.5, 0.5))  # along a line that four cells share
@example(ones_at((2, 1, 1)), FREE_BEYOND, (0.0, 0.5, 0.5), (1.0, 0.5, 0.5))
@example(ones_at((1, 2, 1)), FREE_BEYOND, (0.5, 0.0, 0.5), (0.5, 1.0, 0.5))
@example(ones_at((1, 2, 3)), FREE_BEYOND, (0.5, 0.5, 0.0), (0.5, 0.5, 1.0))
@example(ones_at((1, 1, 1)), FREE_BEYOND, (0.5, 0.5, 0.5), (0.5, 0.5, 0.5))  # a point that eight cells share
@example(ones_at((0, 0, 2)), FREE_BEYOND, (0.0, 0.0, 0.0), (5e-324, 1e-300, 1.0))  # upright but for tiny numbers
@example(ones_at((0, 0, 2)), FREE_BEYOND, (0.0, 0.1, 0.0), (5e-324, 0.1, 1.0))
@example(ones_at((1, 3, 0)), FREE_BEYOND, (0.25, 1.0, 0.25), (0.25 + 2.0**-54, 0.75, 0.0))
@example(ones_at(), FREE_BEYOND, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
@example(ones_at(), Outside(EMPTY, BLOCKED), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
@example(ones_at(), Outside(np.array([-1, 2, 2, 5, 5, 2]), FREE), (-0.5, 0.6, 0.6), (-0.3, 0.6, 0.6))
@example(ones_at(), Outside(np.array([1, 1, 4, 2, 2, 5]), FREE), (0.3, 0.3, 0.9), (0.3, 0.3, 1.0 + 2.0**-20))
@example(ones_at(), Outside(np.array([1, 1, -2, 2, 2, -1]), FREE), (0.3, 0.3, 0.9), (0.3, 0.3, -(2.0**-20)))
def test_free_means_that_every_touched_cell_is_free(state, outside, start, end):
    h, lower, upper = 0.25, (0.0, 0.0, 0.0), 0.25 * np.array(state.shape)
    stays = all(0.0 <= value <= top for q in (start, end) for value, top in zip(q, upper, strict=True))
    shut = [
        cell
        for cell in cells_around(state, outside)
        if state_of(state, outside, cell) != FREE
        and not (stays and any(c < 0 or c >= n for c, n in zip(cell, state.shape, strict=True)))
    ]
    touched = any(touches(start, end, cell, h, lower) for cell in shut) or not (stays or outside.state == FREE)
    look = lookups_of(state, outside)
    found = edges(look, start, end)
    assert found == edges(look, end, start) == look.edge_checker()(*start, *end)
    if found == touched:
        # Allowed only towards refusal, where a closed cell is within the slack of the edge.
        assert not found
        assert any(touches(start, end, cell, h, lower, Fraction(2.0**-26)) for cell in shut)


@settings(max_examples=60)
@given(seeds, st.sampled_from([0.0, 0.3, 3000.1]))
def test_no_touched_cell_is_missed_where_numbers_are_rounded(seed, away):
    """Edges along borders, between lattice points and cell middles, as rounded as they come, against exact clipping."""
    rng = np.random.default_rng(seed)
    h = float(rng.choice([0.1, 1 / 3, rng.uniform(0.01, 3.0)]))
    lower = np.rint(rng.uniform(-5, 1, 3)) * h + away  # the origin lies in the grid, where differences are rounded
    shape = (4, 3, 5)
    state = np.zeros(shape, dtype=np.uint8)
    shut = tuple(rng.integers(0, shape).tolist())
    state[shut] = MIXED
    look = lookups_of(state, spacing=h, lower=tuple(lower.tolist()))
    q0, q1 = (lower + h * (rng.integers(0, 2 * np.array(shape) + 1, (150, 3)) / 2) for _ in range(2))
    q1 = np.where(rng.random(q0.shape) < 0.5, q0, q1)
    near = rng.choice([0.0, 0.0, -3e-16, 3e-16], (2, *q0.shape))
    q0, q1 = q0 * (1.0 + near[0]), q1 * (1.0 + near[1])
    for start, end, free in zip(q0, q1, edges(look, q0, q1).tolist(), strict=True):
        assert not (free and touches(start, end, shut, h, lower))


@settings(max_examples=40)
@given(seeds, st.integers(0, 2))
def test_edges_along_a_border_touch_both_sides(seed, axis):
    """The last number below a border touches the cell below it, and the first above it the cell above, exactly."""
    rng = np.random.default_rng(seed)
    for _ in range(40):
        h, k = float(rng.uniform(0.01, 3.0)), int(rng.integers(1, 6))
        lower = -h * k  # the border lies close to zero, where the difference to the corner is rounded the most
        border = Fraction(lower) + Fraction(h) * k
        below = float(border) if Fraction(float(border)) <= border else np.nextafter(float(border), -9.0)
        above = float(border) if Fraction(float(border)) >= border else np.nextafter(float(border), 9.0)
        for value, cell in ((below, k - 1), (above, k), (below - 1e-17, k - 1), (above + 1e-17, k)):
            state = np.zeros((7, 7, 7), dtype=np.uint8)
            state[(slice(None),) * axis + (cell,)] = MIXED
            q0, q1 = lower + h * rng.uniform(0, 7, (2, 3))
            q0[axis] = q1[axis] = value
            assert not edges(lookups_of(state, spacing=h, lower=(lower,) * 3), q0, q1)


@settings(max_examples=30)
@given(states(5, (FREE,) * 20 + (MIXED,)), outsides(), seeds)
def test_points_of_a_free_edge_are_free(state, outside, seed):
    rng = np.random.default_rng(seed)
    look = lookups_of(state, outside)
    q0, q1 = rng.uniform(-0.6, 1.8, (2, 100, 3))
    free = edges(look, q0, q1)
    along = q0[free, None] + np.linspace(0, 1, 101)[:, None] * (q1 - q0)[free, None]
    assert (classify(look, along) == FREE).all()


def test_long_edges_beyond_the_grid():
    look = lookups_of(np.zeros((4, 4, 4)))
    assert edges(look, (-100.0, 0.5, 0.5), (100.0, 0.6, 0.4))
    assert not edges(look, (-1e9, 0.5, 0.5), (1e9, 0.6, 0.4))  # too far for the certificate
    walled = lookups_of(np.zeros((4, 4, 4)), Outside(EMPTY, BLOCKED))
    assert edges(walled, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    for axis, value in product(range(3), (-0.01, 1.01)):
        q = np.full(3, 0.5)
        q[axis] = value
        assert not edges(walled, (0.5, 0.5, 0.5), q)


def test_quick_edges_never_pass_nan():
    check = lookups_of(np.zeros((4, 4, 4))).edge_checker()
    assert check(*[0.3] * 6)
    for hole in range(6):
        ends = [0.3] * 6
        ends[hole] = float("nan")
        assert not check(*ends)


# ---- cubes -----------------------------------------------------------------------------------------------------------


@settings(max_examples=100)
@given(states(4, (FREE,) * 15 + (BLOCKED,)), outsides(), points, st.sampled_from([0.0, 0.125, 0.25, 0.3, 0.5]))
@example(ones_at(), FREE_BEYOND, (0.5, 0.5, 0.5), 0.5)
@example(ones_at(), Outside(EMPTY, BLOCKED), (0.5, 0.5, 0.5), 0.5)
@example(ones_at((3, 3, 3)), FREE_BEYOND, (0.5, 0.5, 0.5), 0.25)  # a corner that a closed cell shares
@example(ones_at((0, 1, 1)), FREE_BEYOND, (0.5, 0.5, 0.5), 0.25)
def test_a_cube_is_free_where_all_its_cells_are(state, outside, q, distance):
    look = lookups_of(state, outside)
    low = [Fraction(value) - Fraction(distance) for value in q]
    high = [Fraction(value) + Fraction(distance) for value in q]

    def meets(cell, slack):
        return all(
            a <= Fraction(i + 1, 4) + slack and b >= Fraction(i, 4) - slack
            for a, b, i in zip(low, high, cell, strict=True)
        )

    near = [cell for cell in product(range(-6, 12), repeat=3) if meets(cell, Fraction(2.0**-26))]
    shut = [cell for cell in near if state_of(state, outside, cell) != FREE]
    found = boxes(look, q, distance)
    if found == any(meets(cell, 0) for cell in shut):
        assert not found and shut


def test_cubes_of_any_size_are_quick():
    look = lookups_of(np.zeros((4, 4, 4)), Outside(np.array([-9, -9, -9, -5, -5, -5]), FREE))
    assert boxes(look, (0.5, 0.5, 0.5), 1.0)
    assert not boxes(look, (0.5, 0.5, 0.5), 1e5)
    assert boxes(lookups_of(np.zeros((4, 4, 4))), (0.5, 0.5, 0.5), 1e6)
    assert not boxes(lookups_of(np.zeros((4, 4, 4))), (0.5, 0.5, 0.5), 1e9)  # too far for the certificate


# ---- overlaps --------------------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(seeds, st.tuples(*[st.integers(1, 5)] * 3), st.tuples(*[st.integers(1, 4)] * 3), st.sampled_from([0, 1]))
def test_overlaps_are_the_pairs(seed, shape, size, beyond):
    rng = np.random.default_rng(seed)
    occupied, cells = rng.random(shape) < 0.4, rng.random(size) < 0.6
    cells[tuple(rng.integers(0, size))] = True
    raster = Raster.trimmed(cells, tuple(rng.integers(-4, 3, 3).tolist()))
    look = lookups_of(np.zeros(shape))
    spots = list(product(*(range(-3, n + 3) for n in shape)))
    kernel = look.overlaps(sums_of(occupied), [raster], beyond)
    counts = answer(0.25 * np.array(spots) + 0.125, 3, kernel, np.int64, int)
    offsets = (np.argwhere(raster.cells) + raster.lower).tolist()

    def filled(*cell):
        return int(occupied[cell]) if all(0 <= c < n for c, n in zip(cell, shape, strict=True)) else beyond

    expected = [sum(filled(i + a, j + b, k + c) for a, b, c in offsets) for i, j, k in spots]
    assert counts.tolist() == expected


def sums_of(cells):
    return Sums(Workspace.from_array(cells, 1.0), "outer").counts


def test_runs_are_the_cells_of_a_raster():
    cells = np.random.default_rng(0).random((3, 4, 5)) < 0.5
    raster = Raster.trimmed(cells, (-2, 7, 1))
    runs = Runs.of([raster]).rows
    inside = {(dx, dy, dz) for dx, dy, first, last in runs.tolist() for dz in range(first, last + 1)}
    assert inside == {tuple(cell) for cell in (np.argwhere(raster.cells) + raster.lower).tolist()}
    assert Runs.of([Raster.trimmed(np.zeros((2, 2, 2), bool), (0, 0, 0))]).rows.shape == (0, 4)


@pytest.mark.parametrize(("count", "dtype"), [(300, np.int16), (32_767, np.int16), (32_768, np.int32)])
def test_sums_of_long_columns_do_not_overflow(count, dtype):
    sums = sums_of(np.ones((1, 2, count), bool))
    assert sums.dtype == dtype
    assert (sums == np.arange(count + 1)).all()


# ---- for callbacks ---------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(states(), outsides(), seeds)
def test_quick_checkers_agree_with_look_ups_everywhere(state, outside, seed):
    rng = np.random.default_rng(seed)
    look = lookups_of(state, outside, 0.1, (-1.0, 0.0, 0.3))
    frame = frame_of(state.shape, 0.1, (-1.0, 0.0, 0.3))
    q = rng.uniform(frame[:3] - 0.4, frame[4:] + 0.4, (150, 3))
    q = np.where(rng.random(q.shape) < 0.2, frame[4:], q)
    q = np.where(rng.random(q.shape) < 0.1, np.nextafter(frame[4:], rng.choice([-9, 9])), q)
    q = np.where(rng.random(q.shape) < 0.2, frame[:3], q)
    point, clear = look.point_checker(), look.clearance_checker()
    assert [point(*one) for one in q.tolist()] == (classify(look, q) == FREE).tolist()
    assert type(point(*q[0].tolist())) is bool
    assert [clear(*one) for one in q.tolist()] == answer(q, 3, look.clearances(), np.float64, float).tolist()
