"""Distances and clearance against brute force over all cells, also after any stream of changes."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
import handmade
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Workspace
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


def test_a_window_too_large_is_made_anew():
    state = np.zeros((1, 1, 4096, 4096), dtype=np.uint8)
    tiles = tiles_of(state)
    for tile in (0, 3, 127):
        make_tiles(state, tiles, 0, tile, tile + 1)
    state[0, 0, 4, 5] = BLOCKED
    renew_tiles(state, tiles, np.array([[0, 4, 5, 0, 4, 5]]))
    assert not tiles.ready.any()


# ---- as a map answers ------------------------------------------------------------------------------------------------

CASES = {
    "plane": (Robot.polygon([(-0.2, -0.1), (0.3, 0.0), (0.0, 0.25)]), None, 1.5),
    "point": (Robot.disc(0.01), None, 1.5),
    "space": (Robot.box((0.2, 0.3, 0.1)), None, 1.8),
    "turning": (
        Robot.polygon([(-0.2, -0.1), (0.3, 0.0), (0.0, 0.25)]),
        [-1.0, -0.8, 0.5, 0.6, 3.0, 2 * math.pi - 1],
        1.5,
    ),
    "turning bar": (Robot.rectangle(0.4, 0.1), 6, 1.5),
}


@settings(max_examples=25)
@given(seeds, st.sampled_from(list(CASES)), st.sampled_from(["blocked", "free"]))
def test_clearance_is_a_close_lower_bound(seed, case, outside):
    robot, rotations, quality = CASES[case]
    rng, h, dim = np.random.default_rng(seed), 0.1, 3 if case == "space" else 2
    shape = (9, 8, 10) if dim == 3 else (20, 40)
    workspace = Workspace.from_array(rng.random(shape) < rng.choice([0.0, 0.01]), h, rng.uniform(-1, 1, dim))
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    size, lower = np.array(shape), np.array(space.grid.lower)
    around = np.stack(np.meshgrid(*(np.arange(-9, n + 9) for n in shape), indexing="ij"), axis=-1).reshape(-1, dim)
    q = lower + rng.uniform(-0.3, 1.3, (16, dim)) * size * h
    q[::3] = lower + np.rint((q[::3] - lower) / h) * h  # on borders of cells
    q = q if rotations is None else np.column_stack([q, rng.uniform(-9.0, 9.0, len(q))])
    check = space.clearance_checker()
    for point, bound, state in zip(q, space.clearance(q), space.classify(q), strict=True):
        slice_q = np.column_stack([space.grid.center_of(around), np.tile(point[dim:], (len(around), 1))])
        shut = around[space.classify(slice_q) != FREE] * h + lower
        assert check(*point.tolist()) == bound == space.clearance(point)
        if state != FREE:
            assert bound == 0.0
        elif len(shut):
            gap = np.maximum(np.maximum(shut - point[:dim], point[:dim] - shut - h), 0)
            distance = np.linalg.norm(gap, axis=1).min()
            assert bound <= distance + 1e-9
            if space.grid.contains(point[:dim]):
                assert bound > distance - quality * h
        elif outside == "free":
            assert bound == math.inf


@pytest.mark.parametrize("kind", handmade.KINDS)
def test_steps_within_the_clearance_stay_free(kind):
    rng = np.random.default_rng(4)
    states = (
        rng.random((3 if "turning" in kind else 1, *((20, 15, 40) if "space" in kind else (60, 80)))) < 0.003
    ) * MIXED
    space = handmade.made(states, kind)
    dim = space.grid.dim
    q = rng.uniform(-1.0, 12.0, (10_000, space.dof))
    course = rng.normal(size=(len(q), dim))
    steps = 0.999999 * np.minimum(space.clearance(q), 50.0)
    moved = q.copy()
    moved[:, :dim] += steps[:, None] * course / np.linalg.norm(course, axis=1)[:, None]
    assert (steps > 0.3).any()
    assert space.is_free(moved[steps > 0]).all()


@pytest.mark.parametrize("kind", handmade.KINDS)
def test_an_empty_map_has_no_bound(kind):
    space = handmade.made(np.zeros((2 if "turning" in kind else 1, *(3,) * (3 if "space" in kind else 2))), kind)
    q = np.full((2, space.dof), 0.1)
    q[1, 0] = 50.0
    assert space.clearance(q).tolist() == [math.inf, math.inf]


def test_far_outside_the_bound_still_holds():
    occupied = np.ones((1, 1), bool)
    space = cspace.build(Workspace.from_array(occupied, 0.1, (0.3, 0.7)), Robot.disc(0.1), outside="free")
    q = (-18660724.11262548, 27488679.34025253)
    outer, _ = space.robot.rasters(0.1)
    h, x, y = Fraction(0.1), Fraction(q[0]), Fraction(q[1])
    box_x = Fraction(0.3) - h * outer.upper[0]
    box_y = Fraction(0.7) + h * (1 - outer.lower[1])
    assert Fraction(space.clearance(q)) ** 2 <= (box_x - x) ** 2 + (y - box_y) ** 2


@pytest.mark.parametrize("dim", [2, 3])
def test_answers_far_away_and_for_no_numbers(dim):
    occupied = np.zeros((6, 5, 4)[:dim], bool)
    occupied[(2,) * dim] = True
    robot = Robot.disc(0.1) if dim == 2 else Robot.ball(0.1)
    space = cspace.build(Workspace.from_array(occupied, 1.0), robot, outside="free")
    rest = (1.5,) * (dim - 1)
    for far in (1e15, 1e18, 1e300, 1.7e308):
        assert 0.0 <= space.clearance((far, *rest)) < np.inf
        nearest = space.nearest_free((far, *rest))
        assert nearest[0] == 5.5 and space.is_free(nearest)
    for wrong in (np.nan, np.inf):
        assert space.clearance_checker()(wrong, *rest) == 0.0


def test_only_what_is_asked_for_is_made():
    """One configuration asks for one tile of one slice, and for two where it is beside the next."""
    states = np.zeros((4, 50, 200))
    states[:, 0, 0] = BLOCKED
    space = handmade.made(states, "turning", spacing=1.0)
    space.clearance((20.0, 50.5, 0.0))
    assert space._distances.tiles.ready.sum(axis=1).tolist() == [1, 0, 0, 0]
    space.clearance((20.0, 64.5, math.pi / 2))
    assert space._distances.tiles.ready.sum(axis=1).tolist() == [1, 2, 0, 0]


def test_distances_that_do_not_fit_are_refused_before_any_work(monkeypatch):
    states = np.zeros((1, 300, 200))
    states[0, 0, 0] = BLOCKED
    space = handmade.made(states, "plane")
    monkeypatch.setattr("cspace.memory.free_bytes", lambda: 30_000)
    with pytest.raises(InputError, match=r"clearance .*300 x 200 cells .*memory"):
        space.clearance((5.0, 5.0))
    assert not space._distances.tiles.ready.any()
