"""Clearance in space against brute force over all cells."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings

from cspace import BLOCKED, FREE, MIXED
from cspace.map.batches import answer
from cspace.clearance import clearance_field
from cspace.outside import Outside
from spatial import EMPTY, lookups_of, outsides, state_of, states
from strategies import seeds

LIMIT = 2**31 - 1


@settings(max_examples=80)
@given(states(6, (FREE,) * 9 + (MIXED, BLOCKED)))
def test_the_transform_is_exact(state):
    field = clearance_field(state)
    assert field.some == state.any()
    cells = np.argwhere(state)
    for k in np.ndindex(state.shape):
        gaps = np.maximum(2 * np.abs(cells - k) - 1, 0)
        assert field.squares[k] == np.square(gaps).sum(axis=1).min(initial=LIMIT)


def test_the_transform_is_written_in_place():
    state = np.zeros((2, 3, 4, 5), dtype=np.uint8)
    state[1, 2, 3, 4] = BLOCKED
    out = np.zeros(state.shape, dtype=np.int32)
    assert [clearance_field(part, into).some for part, into in zip(state, out, strict=True)] == [False, True]
    assert (out[0] == LIMIT).all()
    assert out[1, 0, 3, 4] == 3**2 and out[1, 2, 0, 0] == 5**2 + 7**2


@pytest.mark.parametrize("axis", range(3))
def test_distances_beyond_the_limit_are_the_limit(axis):
    """Also those whose squares, or sums of squares, would overflow 32 bits, and 64."""
    shape = [1, 2, 2]
    shape[axis] = 70_000
    state = np.zeros(shape, dtype=np.uint8)
    state[0, 0, 0] = MIXED
    squares = clearance_field(state).squares
    steps = np.indices(shape)
    expected = np.square(np.maximum(2 * steps - 1, 0)).sum(axis=0)
    assert (squares == np.minimum(expected, LIMIT)).all()


@pytest.mark.parametrize("shape", [(90, 80, 70), (1, 200, 180), (150, 1, 140), (160, 170, 1)])
def test_a_large_map_runs_in_threads(shape):
    from scipy import ndimage

    state = (np.random.default_rng(0).random(shape) < 0.002).astype(np.uint8)
    tripled = np.kron(state == FREE, np.ones((3, 3, 3), dtype=bool))  # thirds of cells: their middles are cells
    at = ndimage.distance_transform_edt(tripled, return_distances=False, return_indices=True)[:, 1::3, 1::3, 1::3]
    owner = at // 3  # the closed cell that holds the nearest third; nearly the nearest closed cell
    gaps = np.maximum(2 * np.abs(owner - np.indices(shape)) - 1, 0)
    bound = np.square(gaps).sum(axis=0)
    squares = clearance_field(state).squares
    assert (squares <= bound).all()
    assert (np.sqrt(bound) - np.sqrt(squares)).max() < 2 * math.sqrt(3) / 3


@settings(max_examples=40)
@given(states(6, (FREE,) * 25 + (MIXED,)), outsides(), seeds)
@example(np.zeros((4, 4, 4), np.uint8), Outside(np.array([-3, 1, 1, -2, 2, 2]), FREE), 0)
@example(np.zeros((4, 4, 4), np.uint8), Outside(np.array([1, 1, 6, 2, 2, 7]), FREE), 0)
@example(np.zeros((4, 4, 4), np.uint8), Outside(EMPTY, BLOCKED), 0)
def test_clearance_is_a_close_lower_bound(state, outside, seed):
    rng = np.random.default_rng(seed)
    h, lower = 0.1, np.array([0.3, -0.2, 1.0])
    look = lookups_of(state, outside, h, tuple(lower))
    size = np.array(state.shape)
    wide = np.stack(np.meshgrid(*(np.arange(-6, n + 8) for n in size), indexing="ij"), axis=-1).reshape(-1, 3)
    shut = np.array([state_of(state, outside, tuple(cell)) != FREE for cell in wide.tolist()])
    closed = wide[shut] * h + lower
    q = lower + rng.uniform(-4, 10, (25, 3)) * h
    q[::2] = lower + rng.uniform(0, 1, (13, 3)) * size * h
    q[::3] = lower + np.rint((q[::3] - lower) / h) * h
    found = answer(q, 3, look.classify(), np.uint8, int)
    for point, bound, own in zip(q, answer(q, 3, look.clearances(), np.float64, float), found, strict=True):
        if own != FREE:
            assert bound == 0.0
        elif len(closed):
            gap = np.maximum(np.maximum(closed - point, point - closed - h), 0)
            distance = np.linalg.norm(gap, axis=1).min()
            assert bound <= distance + 1e-9
            if ((point >= lower) & (point <= lower + size * h)).all():
                assert bound > distance - 1.75 * h
        else:
            assert bound == math.inf


def test_steps_within_the_clearance_stay_free():
    rng = np.random.default_rng(4)
    state = (rng.random((30, 20, 25)) < 0.003).astype(np.uint8)
    look = lookups_of(state, Outside(np.array([-3, -3, -3, 32, 22, 27]), FREE))
    q = rng.uniform(-1.0, 8.0, (20_000, 3))
    course = rng.normal(size=q.shape)
    steps = 0.999999 * answer(q, 3, look.clearances(), np.float64, float)
    moved = q + steps[:, None] * course / np.linalg.norm(course, axis=1)[:, None]
    assert (steps > 0.3).any()
    assert (answer(moved[steps > 0], 3, look.classify(), np.uint8, int) == FREE).all()


def test_an_empty_space_has_no_bound():
    look = lookups_of(np.zeros((3, 3, 3)))
    q = [(0.1, 0.1, 0.1), (50.0, 2.0, 0.1)]
    assert answer(q, 3, look.clearances(), np.float64, float).tolist() == [math.inf, math.inf]
