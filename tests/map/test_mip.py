"""Occupancy pyramids against brute force, also after changes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import FREE, Robot, Workspace
from cspace.map.derived import Lock
from cspace.map.mip import BLOCK_SIDE, MAX_DIRTY_BOXES, ROWS_PER_BLOCK_ROW, OccupancyPyramid
from cspace.map.storage import PackedStates
from tests.strategies import seeds
from tests.waiting import write_while_querying


def unpack(words):
    """Unpack words to bits, shape (slices, x, y, z)."""
    slices, a, b, c, layers = words.shape
    bits = words[..., None] >> np.arange(BLOCK_SIDE * BLOCK_SIDE, dtype=np.uint64) & np.uint64(1)
    bits = bits.reshape(slices, a, b, c, layers, BLOCK_SIDE, BLOCK_SIDE)  # the last are z and y
    return bits.transpose(0, 1, 4, 2, 6, 3, 5).reshape(slices, a * layers, b * BLOCK_SIDE, c * BLOCK_SIDE)


def unpack_rows(words, which):
    """Unpack the rows ``which`` of each nine plane rows."""
    slices, rows, count = words.shape
    assert not words[..., [0, -1]].any()
    part = np.ascontiguousarray(words[..., 1:-1]).reshape(
        slices, rows // ROWS_PER_BLOCK_ROW, ROWS_PER_BLOCK_ROW, count - 2
    )[:, :, which]
    bits = np.unpackbits(part.view(np.uint8), axis=-1, bitorder="little")
    return bits.reshape(slices, 1, -1, bits.shape[-1])


def collect_indices(bits):
    """Return indices of non-zero elements as tuples."""
    return set(map(tuple, np.argwhere(bits).tolist()))


def check(pyramid, stack, cells):
    """Fail unless all levels agree with the states."""
    expected = collect_indices(stack.reshape(len(stack), *(1,) * (4 - stack.ndim), *stack.shape[1:]) != FREE)
    assert bool(pyramid.cells.size) == cells
    if cells:
        plane = pyramid.blocks.shape[-1] == 1
        bits = unpack_rows(pyramid.cells, slice(0, BLOCK_SIDE)) if plane else unpack(pyramid.cells)
        assert collect_indices(bits) == expected
    nodes = pyramid.nodes.view(np.uint8)
    for bits in (unpack(pyramid.blocks), nodes):
        expected = {(s, *(n // BLOCK_SIDE for n in position)) for s, *position in expected}
        assert collect_indices(bits) == expected
        if cells and plane and bits is not nodes:
            assert collect_indices(unpack_rows(pyramid.cells, slice(BLOCK_SIDE, ROWS_PER_BLOCK_ROW))) == expected


def draw_box(part, rng):
    """Draw a window of a slice, possibly empty, and its corners."""
    corners = np.sort(rng.integers(0, part.shape, (2, part.ndim)), axis=0)
    if rng.random() < 0.2:
        corners[1, rng.integers(part.ndim)] = -1
    axes = [0] * (3 - part.ndim)
    return tuple(slice(a, b + 1) for a, b in corners.T), [*axes, *corners[0], *axes, *corners[1]]


@settings(max_examples=60)
@given(st.integers(2, 3), seeds, st.sampled_from([1, 3, MAX_DIRTY_BOXES + 2]), st.booleans(), st.booleans())
def test_pyramid_marks_cells_that_are_not_free_after_changes(dim, seed, changes, eager, packed):
    rng = np.random.default_rng(seed)
    side = int(rng.choice([9, 20, 70] if dim == 2 else [9, 20]))
    shape = (int(rng.integers(1, 4)), *rng.integers(1, side, dim).tolist())
    shape = (*shape[:-1], int(rng.choice([shape[-1], 530]))) if dim == 2 else shape
    stack = np.where(rng.random(shape) < rng.choice([0.0, 0.01, 0.2]), rng.integers(1, 3, shape), 0).astype(np.uint8)
    states = PackedStates(shape) if packed else stack

    def write():
        if packed:
            for number, part in enumerate(stack):
                states.write(number, part)

    write()
    pyramid = OccupancyPyramid(states, Lock())
    check(pyramid.marks(cells=False), stack, False)
    for cells in (False, True):
        marks = pyramid.marks(cells, eager)
        check(marks, stack, cells)
        for _ in range(changes):
            boxes = []
            for part in stack:
                where, box = draw_box(part, rng)
                part[where] = rng.choice([0, 0, 0, 2], part[where].shape)
                boxes.append(box)
            write()
            pyramid.refresh(np.array(boxes))
        if eager:  # marks returned earlier were refreshed
            check(marks, stack, cells)
        check(pyramid.marks(cells), stack, cells)


@pytest.mark.parametrize("dim", [2, 3])
def test_clearance_during_updates_is_that_of_some_state(dim):
    """Compare with clearances with and without the changing obstacle."""
    cells = np.zeros((40, 300) if dim == 2 else (40, 70, 20), dtype=bool)
    cells[(5,) * dim] = True
    space = cspace.build(Workspace.from_array(cells, 1.0), Robot.disc(0.1) if dim == 2 else Robot.ball(0.1))
    q = np.random.default_rng(0).uniform(6.5, 18.0, (400, dim))
    position, on, off = (19,) * dim, np.ones((1,) * dim, dtype=bool), np.zeros((1,) * dim, dtype=bool)
    far = space.clearance(q)
    space.update(on, position)
    near = space.clearance(q)
    assert (near < far).any()
    wrong, check = [], space.clearance_checker()

    def query_map():
        answers = np.array([space.clearance(q), [check(*one) for one in q.tolist()]])
        wrong.append(((answers < near) | (answers > far)).sum())

    def change():
        for _ in range(200):
            space.update(off, position)
            space.update(on, position)

    write_while_querying(query_map, [change])
    assert wrong and not any(wrong)
    assert (space.clearance(q) == near).all()
    space.update(off, position)
    assert [check(*one) for one in q.tolist()] == far.tolist() == space.clearance(q).tolist()
