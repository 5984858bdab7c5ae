"""Distances against brute force over all cells, also after any stream of changes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED
from cspace.map import distances
from cspace.map.distances import LIMIT, MOST, UNIT, WIDE, Tiles, make_tiles, renew_tiles, transform
from strategies import seeds


def layered(state):
    return state.reshape(*(1,) * (3 - state.ndim), *state.shape)


def whole(state):
    return np.array([0, 0, 0, *(n - 1 for n in layered(state).shape)])


def squares_of(state):
    """Squared distances in half cells, by brute force."""
    cells = np.argwhere(state != FREE)
    found = np.full(state.shape, LIMIT)
    for k in np.ndindex(state.shape):
        gaps = np.maximum(2 * np.abs(cells - k) - 1, 0)
        found[k] = np.square(gaps).sum(axis=1).min(initial=LIMIT)
    return found


def tiles_of(states):
    """Tiles of slices of three axes, none of which is made."""
    slices, nx, ny, nz = states.shape
    count = -(-nz // WIDE)
    sides = [-(-n // distances.SIDE) for n in (nx, ny)]
    return Tiles(
        np.zeros((slices, count, nx, ny, WIDE), np.uint16),
        np.zeros((slices, count), np.uint8),
        np.zeros((slices, count, *sides), np.uint16),
        np.ones(slices, bool),
        np.zeros((slices, 4, 4)),
    )


def joined(tiles, s, nz):
    """The distances of a slice in one piece, shape (nx, ny, nz)."""
    return np.concatenate(list(tiles.distances[s]), axis=-1)[..., :nz]


def made(states):
    tiles = tiles_of(states)
    for s, count in enumerate([tiles.ready.shape[1]] * len(states)):
        make_tiles(states, tiles, s, 0, count)
    return tiles


@st.composite
def maps(draw, most=14):
    """States of a plane or of space, sparse or dense, small or longer than a tile."""
    rng = np.random.default_rng(draw(seeds))
    dim = draw(st.sampled_from([2, 3]))
    shape = [int(n) for n in rng.integers(1, most if dim == 2 else 8, dim)]
    if draw(st.booleans()):
        shape[-1] = int(rng.integers(WIDE - 2, 3 * WIDE))
    density = draw(st.sampled_from([0.0, 0.003, 0.03, 0.4, 1.0]))
    return ((rng.random(shape) < density) * rng.integers(1, 3, shape)).astype(np.uint8)


@settings(max_examples=60)
@given(maps())
def test_tiles_are_exact(state):
    tiles = made(layered(state)[None])
    exact = np.minimum(np.sqrt(squares_of(layered(state))) * UNIT / 2, MOST)
    np.testing.assert_array_equal(joined(tiles, 0, state.shape[-1]), np.floor(exact))


@pytest.mark.parametrize("axis", range(3))
def test_distances_beyond_what_is_stored(axis):
    """Also those whose squares, or sums of squares, would overflow 32 bits."""
    shape = [1, 2, 2]
    shape[axis] = 70_000
    state = np.zeros(shape, dtype=np.uint8)
    state[0, 0, 0] = MIXED
    squares = transform(state, whole(state), whole(state))
    expected = np.square(np.maximum(2 * np.indices(shape) - 1, 0)).sum(axis=0)
    np.testing.assert_array_equal(np.minimum(squares, LIMIT), np.minimum(expected, LIMIT))


@pytest.mark.parametrize("shape", [(90, 80, 70), (1, 300, 280), (150, 1, 140), (160, 170, 1)])
def test_large_maps_against_scipy(shape):
    from scipy import ndimage

    state = (np.random.default_rng(0).random(shape) < 0.002).astype(np.uint8)
    thirds = [3 if n > 1 else 1 for n in shape]  # thirds of cells: the middle ones are the middles of cells
    tripled = np.kron(state == FREE, np.ones(thirds, dtype=bool))
    middles = tuple(slice(1 if n == 3 else 0, None, n) for n in thirds)
    nearest = ndimage.distance_transform_edt(tripled)[middles] / 3
    mine = joined(made(state[None]), 0, shape[-1]) / UNIT
    assert np.abs(mine - nearest).max() < 1 / np.sqrt(3) + 1 / UNIT


@settings(max_examples=120)
@given(maps(45), seeds)
def test_a_change_equals_a_whole_transform(state, seed):
    rng = np.random.default_rng(seed)
    states = layered(state)[None].copy()
    tiles = tiles_of(states)
    for s, tile in np.ndindex(tiles.ready.shape):
        if rng.random() < 0.7:
            make_tiles(states, tiles, s, tile, tile + 1)
    for _ in range(3):
        old = states.copy()
        first = [int(rng.integers(0, n)) for n in states.shape[1:]]
        window = (0, *(slice(i, i + int(rng.integers(1, 7))) for i in first))
        states[window] = (rng.random(states[window].shape) < rng.choice([0.0, 0.5, 1.0])) * 2
        cells = np.argwhere((old[0] == FREE) != (states[0] == FREE))
        box = np.concatenate([cells.min(axis=0), cells.max(axis=0)]) if len(cells) else np.repeat([0, -1], 3)
        for _ in range(2):  # to be told twice does no harm
            renew_tiles(states, tiles, box[None])
        fresh = made(states)
        for tile in np.flatnonzero(tiles.ready[0]):
            width = min(WIDE, states.shape[-1] - tile * WIDE)
            np.testing.assert_array_equal(tiles.distances[0, tile, ..., :width], fresh.distances[0, tile, ..., :width])
            np.testing.assert_array_equal(tiles.peaks[0, tile], fresh.peaks[0, tile])


def test_a_change_among_obstacles_looks_at_few_cells():
    state = np.zeros((1, 1, 400, 400), dtype=np.uint8)
    state[..., ::20, ::20] = 1
    tiles = made(state)
    window = distances.changed_window(tiles, 0, np.array([0, 200, 200, 0, 203, 203]), (1, 400, 400))
    assert (window[4:] - window[1:3] < 60).all()


def test_the_first_and_the_last_closed_cell():
    state = np.zeros((1, 1, 30, 60), dtype=np.uint8)
    tiles = made(state)
    assert (joined(tiles, 0, 60) == MOST).all()
    for closed in (BLOCKED, FREE):
        state[0, 0, 4, 5] = closed
        renew_tiles(state, tiles, np.array([[0, 4, 5, 0, 4, 5]]))
        np.testing.assert_array_equal(joined(tiles, 0, 60), joined(made(state), 0, 60))


def test_a_window_too_large_is_made_anew(monkeypatch):
    state = np.zeros((1, 1, 40, 100), dtype=np.uint8)
    tiles = made(state)
    state[0, 0, 4, 5] = BLOCKED
    renew_tiles.py_func.__globals__["LARGEST"], saved = 10, distances.LARGEST
    try:
        renew_tiles.py_func(state, tiles, np.array([[0, 4, 5, 0, 4, 5]]))
    finally:
        renew_tiles.py_func.__globals__["LARGEST"] = saved
    assert not tiles.ready.any()
