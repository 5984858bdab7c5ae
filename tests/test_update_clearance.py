"""Distances after a change equal those of a whole transform, cell for cell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import FREE, Robot, Workspace, build
from cspace.cells import _kernels
from cspace.clearance import clearance_field, renew_clearance
from strategies import seeds
from updates import World, worlds


def layered(array):
    """As one slice with three axes of cells."""
    return array.reshape(1, *(1,) * (3 - array.ndim), *array.shape)


def box_of(old, new):
    """The box around the cells that became FREE or stopped to be."""
    cells = np.argwhere((layered(old) == FREE)[0] != (layered(new) == FREE)[0])
    return np.concatenate([cells.min(axis=0), cells.max(axis=0)]) if len(cells) else np.repeat([0, -1], 3)


@settings(max_examples=300)
@given(seeds, st.sampled_from([2, 3]), st.sampled_from([0.0, 0.003, 0.03, 0.4, 1.0]))
def test_a_change_equals_a_whole_transform(seed, dim, density):
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(1, 45 if dim == 2 else 15, dim))
    state = ((rng.random(shape) < density) * rng.integers(1, 3, shape)).astype(np.uint8)
    squares = clearance_field(state).squares
    for _ in range(3):
        old = state.copy()
        first = [int(rng.integers(0, n)) for n in shape]
        window = tuple(slice(i, i + int(rng.integers(1, 7))) for i in first)
        state[window] = (rng.random(state[window].shape) < rng.choice([0.0, 0.5, 1.0])) * 2
        renew_clearance(layered(state), layered(squares), box_of(old, state)[None])
        np.testing.assert_array_equal(squares, clearance_field(state).squares)


@settings(max_examples=150)
@given(seeds, st.sampled_from([2, 3]))
def test_outside_the_window_nothing_changes(seed, dim):
    """The claim of the docstring, whatever changes within the box."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(4, 40 if dim == 2 else 14, dim))
    state = (rng.random(shape) < rng.choice([0.005, 0.05])).astype(np.uint8)
    first = np.array([int(rng.integers(0, n)) for n in shape])
    last = np.minimum(first + rng.integers(0, 4, dim), np.array(shape) - 1)
    inside = tuple(slice(i, j + 1) for i, j in zip(first, last, strict=True))
    pad = [0] * (3 - dim)
    old = clearance_field(state).squares
    window = _kernels.changed_window(layered(old)[0], np.array([*pad, *first, *pad, *last]))
    kept = np.ones(shape, dtype=bool)
    kept[tuple(slice(i, j + 1) for i, j in zip(window[3 - dim : 3], window[6 - dim :], strict=True))] = False
    for fill in (0, 1):
        state[inside] = fill
        np.testing.assert_array_equal(clearance_field(state).squares[kept], old[kept])


def test_the_window_is_small_among_obstacles():
    state = np.zeros((400, 400), dtype=np.uint8)
    state[::20, ::20] = 1
    window = _kernels.changed_window(layered(clearance_field(state).squares)[0], np.array([0, 200, 200, 0, 203, 203]))
    assert (window[4:] - window[1:3] < 60).all()


def test_the_first_and_the_last_closed_cell():
    state = np.zeros((30, 20), dtype=np.uint8)
    squares = clearance_field(state).squares
    assert (squares == _kernels.LIMIT).all()
    for closed in (1, 0):
        state[4, 5] = closed
        renew_clearance(layered(state), layered(squares), np.array([[0, 4, 5, 0, 4, 5]]))
        np.testing.assert_array_equal(squares, clearance_field(state).squares)


def test_an_empty_box_is_left_alone():
    squares = np.full((1, 1, 4, 4), 7, dtype=np.int32)
    renew_clearance(np.zeros((1, 1, 4, 4), dtype=np.uint8), squares, np.array([[1, 4, 4, -1, -1, -1]]))
    assert (squares == 7).all()


@settings(max_examples=40)
@given(worlds())
def test_stored_distances_are_those_of_a_rebuild(world: World):
    space = world.build()
    space.clearance(world.points(2))
    for fresh in world.stream(space, 3):
        for number, part in enumerate(fresh.stack):
            kept = space._lookups._once.made("clearance")
            squares, some = (kept.squares, kept.some) if space.rotations is None else (kept[0][number], kept[1][number])
            expected = clearance_field(part)
            np.testing.assert_array_equal(squares, expected.squares)
            assert some == expected.some


@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_a_checker_knows_where_nothing_is_left_to_hit(outside):
    space = build(Workspace.from_array(np.zeros((20, 20), dtype=bool), 0.1), Robot.disc(0.05), outside=outside)
    check, q = space.clearance_checker(), (1.0, 1.0)
    for fill in (True, False, True):
        space.update(np.full((1, 1), fill), (3, 3))
        fresh = build(space.workspace, space.robot, outside=outside)
        assert check(*q) == space.clearance(q) == fresh.clearance(q)
        assert np.isinf(check(*q)) == (outside == "free" and not fill)
