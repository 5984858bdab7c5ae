"""Components against scipy's labels, after any stream of changes; paths against flood fills."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage, sparse

from cspace import BLOCKED, FREE, MIXED
from cspace.map import components as module
from cspace.map.components import Components
from cspace.map.kept import Change
from strategies import seeds

BLOCKS = {
    "small": {2: (1, 3, 4), 3: (2, 3, 2)},
    "rows of eight": {2: (1, 2, 8), 3: (2, 1, 8)},
    "as they are": module.SIDES,
}

KINDS = [(2, 1, 1), (3, 1, 1), (2, 1, 4), (2, 2, 2), (2, 3, 3), (2, 2, 4), (2, 3, 6), (3, 2, 4)]
"""Axes of the grid, slices, and rotation cells in a ring."""

ALONE = np.zeros(1, dtype=np.int64)


@pytest.fixture(autouse=True, params=BLOCKS)
def blocks(request, monkeypatch):
    """Also with blocks of few cells, so that small maps have many."""
    monkeypatch.setattr(module, "SIDES", BLOCKS[request.param])


def ring(turns):
    return (np.arange(turns)[:, None] + [-1, 1]) % turns


def components(stack, slice_of=ALONE, rim=False):
    rims = np.broadcast_to(rim, len(stack))
    return Components(stack, slice_of, ring(len(slice_of)), rims)


def changed(boxes):
    none = np.zeros(0, dtype=np.int64)
    return Change(None, none, none, np.asarray(boxes, dtype=np.int64), none, none, 1, False)


def random_stack(rng, dim, slices):
    shape = tuple(int(n) for n in rng.integers(1, (10 if dim == 3 else 15), dim))
    return rng.choice(3, (slices, *shape), p=rng.dirichlet([1.0, 1.0, 1.0])).astype(np.uint8)


def same_partition(mine, other):
    """Fail unless two labellings, -1 for none, put the same cells together."""
    np.testing.assert_array_equal(mine < 0, other < 0)
    pairs = np.unique(np.stack([mine.ravel(), other.ravel()]), axis=1)
    assert len(np.unique(pairs[0])) == len(np.unique(pairs[1])) == pairs.shape[1]


def all_cells(stack, turns, around=2):
    axes = [np.arange(turns), *(np.arange(-around, n + around) for n in stack.shape[1:])]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, stack.ndim)


def by_scipy(stack, slice_of, rim_is_open, cells):
    """Numbers of the components of cells, from labels of the whole map with a rim around, its turns in a ring."""
    order = slice_of if len(stack) > 1 else [0]
    found = []
    for kind, member in enumerate((stack == FREE, stack != BLOCKED)):
        framed = np.zeros((len(stack), *(n + 4 for n in stack.shape[1:])), dtype=bool)
        if kind:
            framed.T[...] = rim_is_open
        framed[(slice(None), *[slice(2, -2)] * (stack.ndim - 1))] = member
        labels, count = ndimage.label(framed[order])
        first, last = labels[0].ravel(), labels[-1].ravel()
        both = (first > 0) & (last > 0) & (len(order) > 1)
        links = sparse.coo_array((both[both], (first[both], last[both])), shape=(count + 1, count + 1))
        middle = np.where(labels > 0, sparse.csgraph.connected_components(links, directed=False)[1][labels] + 1, 0)
        inside = np.clip(cells[:, 1:] + 2, 0, np.array(framed.shape[1:]) - 1)
        found.append(middle[(np.minimum(cells[:, 0], len(middle) - 1), *inside.T)] - 1)
    return found


@settings(max_examples=40)
@given(seeds, st.sampled_from(KINDS))
def test_a_stream_of_changes(seed, kind):
    dim, slices, turns = kind
    rng = np.random.default_rng(seed)
    stack = random_stack(rng, dim, slices)
    rim, slice_of = rng.random(slices) < 0.5, np.arange(turns) % slices
    labels, cells = components(stack, slice_of, rim), all_cells(stack, turns)
    for _ in range(4):
        for mine, other in zip(labels.of(cells), by_scipy(stack, slice_of, rim, cells), strict=True):
            same_partition(mine, other)
        boxes = np.tile(np.repeat([0, -1], 3), (slices, 1))
        for s in np.flatnonzero(rng.random(slices) < 0.7):
            first = [int(rng.integers(0, n)) for n in stack.shape[1:]]
            last = [int(rng.integers(i, min(n, i + 5))) for i, n in zip(first, stack.shape[1:], strict=True)]
            window = tuple(slice(i, j + 1) for i, j in zip(first, last, strict=True))
            stack[s][window] = rng.integers(0, 3, stack[s][window].shape)
            pad = [0] * (3 - dim)
            boxes[s] = [*pad, *first, *pad, *last]
        labels.renew(changed(boxes))


@settings(max_examples=30)
@given(seeds, st.sampled_from(KINDS))
def test_the_box_around_a_component(seed, kind):
    dim, slices, turns = kind
    rng = np.random.default_rng(seed)
    stack = random_stack(rng, dim, slices)
    labels = components(stack, np.arange(turns) % slices)
    cells = all_cells(stack, turns, 0)
    free = labels.of(cells)[0]
    # One rotation cell stands for all where they share one slice.
    for cell, number in list(zip(cells[free >= 0], free[free >= 0], strict=True))[:20]:
        ours = cells[free == number][:, 1:]
        np.testing.assert_array_equal(labels.box(cell), [ours.min(axis=0), ours.max(axis=0)])


def test_many_components_in_every_block():
    state = (np.indices((150, 140)).sum(axis=0) % 2 * BLOCKED).astype(np.uint8)  # a chessboard
    labels = components(state[None], rim=True)
    cells = all_cells(state[None], 1, 0)
    free, passable = labels.of(cells)
    assert len(np.unique(free)) - 1 == np.count_nonzero(state == FREE)
    assert len(np.unique(passable)) - 1 < np.count_nonzero(state == FREE)  # the rim joins those at the border
    state[...] = FREE
    labels.renew(changed([[0, 0, 0, 0, 149, 139]]))
    assert len(np.unique(labels.of(cells)[0])) == 1
    state[70:] = BLOCKED
    labels.renew(changed([[0, 70, 0, 0, 149, 139]]))
    assert set(np.unique(labels.of(cells)[0])) == {-1, labels.of(cells[0])[0]}


def test_neighbours_may_be_any_graph():
    """Rotation cells of a kind that is to come: each has the neighbours that it is told."""
    rng = np.random.default_rng(5)
    stack = rng.choice(3, (5, 6, 7), p=[0.4, 0.2, 0.4]).astype(np.uint8)
    neighbors = np.array([[1, 2, 3], [0, 4, -1], [0, 3, -1], [0, 2, -1], [1, -1, -1]])
    labels = Components(stack, np.arange(5), neighbors, np.zeros(5, dtype=bool))
    cells = all_cells(stack, 5, 0)
    for kind, member in enumerate((stack == FREE, stack != BLOCKED)):
        number = np.arange(stack.size).reshape(stack.shape)
        rows = [number[:, 1:][j].ravel() for j in ()]
        joined = [(member[:, 1:] & member[:, :-1], number[:, 1:], number[:, :-1])]
        joined += [(member[:, :, 1:] & member[:, :, :-1], number[:, :, 1:], number[:, :, :-1])]
        joined += [
            (member[r] & member[o], number[r], number[o]) for r, row in enumerate(neighbors) for o in row if o >= 0
        ]
        a, b = (np.concatenate([one[k][one[0]] for one in joined] + rows) for k in (1, 2))
        graph = sparse.coo_array((np.ones(len(a)), (a, b)), shape=(stack.size, stack.size))
        expected = sparse.csgraph.connected_components(graph, directed=False)[1].reshape(stack.shape)
        same_partition(labels.of(cells)[kind], np.where(member, expected, -1)[tuple(cells.T)])


def test_a_door_in_a_wall_across_many_blocks():
    state = np.zeros((300, 200), dtype=np.uint8)
    state[150] = BLOCKED
    labels = components(state[None])
    ends = [(np.array([0, x, 20]), np.array(FREE, dtype=np.uint8)) for x in (3, 290)]
    for fill, expected in ((FREE, True), (BLOCKED, False), (MIXED, None), (FREE, True)):
        state[150, 77] = fill
        labels.renew(changed([[0, 150, 77, 0, 150, 77]]))
        assert labels.joins(*ends)[()] is expected
