"""Components after a change are those of a map that is labelled anew, and those of scipy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage, sparse

from cspace import BLOCKED, FREE, connectivity
from cspace.connectivity import components, path_exists, reach
from strategies import seeds


@pytest.fixture(autouse=True, params=["small blocks", "blocks as they are"])
def blocks(request, monkeypatch):
    """Also with blocks of few cells, so that small maps have many."""
    if request.param == "small blocks":
        monkeypatch.setattr(connectivity, "SIDES", {2: (1, 3, 4), 3: (2, 3, 2)})


def random_stack(rng, dim, slices, most):
    shape = tuple(int(n) for n in rng.integers(1, most + 1, dim))
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


@settings(max_examples=80)
@given(seeds, st.sampled_from([(2, 1, 1), (3, 1, 1), (2, 1, 4), (2, 2, 2), (2, 3, 3), (2, 2, 4), (2, 3, 6)]))
def test_a_stream_of_changes(seed, kind):
    dim, slices, turns = kind
    rng = np.random.default_rng(seed)
    stack = random_stack(rng, dim, slices, 9 if dim == 3 else 14)
    rim, slice_of = rng.random(slices) < 0.5, np.arange(turns) % slices
    labels, cells = components(stack, slice_of, rim), all_cells(stack, turns)
    for _ in range(4):
        for mine, other in zip(labels.of(cells), by_scipy(stack, slice_of, rim, cells), strict=True):
            same_partition(mine, other)
        for mine, other in zip(labels.of(cells), components(stack, slice_of, rim).of(cells), strict=True):
            same_partition(mine, other)
        boxes = np.tile(np.repeat([0, -1], 3), (slices, 1))
        for s in np.flatnonzero(rng.random(slices) < 0.7):
            first = [int(rng.integers(0, n)) for n in stack.shape[1:]]
            last = [int(rng.integers(i, min(n, i + 5))) for i, n in zip(first, stack.shape[1:], strict=True)]
            window = tuple(slice(i, j + 1) for i, j in zip(first, last, strict=True))
            stack[s][window] = rng.integers(0, 3, stack[s][window].shape)
            pad = [0] * (3 - dim)
            boxes[s] = [*pad, *first, *pad, *last]
        labels.renew(boxes)


@settings(max_examples=60)
@given(seeds, st.sampled_from([(2, 1, 1), (3, 1, 1), (2, 3, 3), (2, 2, 4)]))
def test_the_box_around_a_component(seed, kind):
    dim, slices, turns = kind
    rng = np.random.default_rng(seed)
    stack = random_stack(rng, dim, slices, 9 if dim == 3 else 14)
    labels = components(stack, np.arange(turns) % slices, np.zeros(slices, dtype=bool))
    cells = all_cells(stack, turns, 0)
    free = labels.of(cells)[0]
    for cell in cells[free >= 0][:20]:
        ours = cells[free == labels.of(cell)[0]][:, 1:]
        np.testing.assert_array_equal(reach(labels, cell), [ours.min(axis=0), ours.max(axis=0)])


def test_many_components_make_the_pool_grow():
    state = np.indices((150, 140)).sum(axis=0) % 2 * np.uint8(BLOCKED)  # a chessboard
    labels = components(state[None], np.zeros(1, dtype=np.int64), np.array([True]))
    cells = all_cells(state[None], 1, 0)
    free, passable = labels.of(cells)
    assert len(np.unique(free)) - 1 == np.count_nonzero(state == FREE)
    assert len(np.unique(passable)) - 1 < np.count_nonzero(state == FREE)  # the rim joins those at the border
    state[...] = FREE
    labels.renew(np.array([[0, 0, 0, 0, 149, 139]]))
    assert len(np.unique(labels.of(cells)[0])) == 1
    state[70:] = BLOCKED
    labels.renew(np.array([[0, 70, 0, 0, 149, 139]]))
    assert set(np.unique(labels.of(cells)[0])) == {-1, labels.of(cells[0])[0]}


def test_changes_again_and_again_do_not_fill_the_pool():
    rng = np.random.default_rng(0)
    stack = (rng.random((1, 200, 200)) < 0.4).astype(np.uint8) * np.uint8(BLOCKED)
    labels = components(stack, np.zeros(1, dtype=np.int64), np.array([False]))
    size = len(labels._pool)
    for _ in range(200):
        stack[0, 50:150, 50:150] = (rng.random((100, 100)) < 0.4) * np.uint8(BLOCKED)
        labels.renew(np.array([[0, 50, 50, 0, 149, 149]]))
    assert len(labels._pool) <= 3 * size
    cells = all_cells(stack, 1, 0)
    fresh = components(stack, np.zeros(1, dtype=np.int64), np.array([False]))
    same_partition(labels.of(cells)[0], fresh.of(cells)[0])


def test_a_door_in_a_wall_across_many_blocks():
    state = np.zeros((300, 200), dtype=np.uint8)
    state[150] = BLOCKED
    labels = components(state[None], np.zeros(1, dtype=np.int64), np.array([False]))
    ends = [(np.array([0, x, 20]), np.array(FREE, dtype=np.uint8)) for x in (3, 290)]
    for fill, expected in ((FREE, True), (BLOCKED, False), (1, None), (FREE, True)):
        state[150, 77] = fill
        labels.renew(np.array([[0, 150, 77, 0, 150, 77]]))
        assert path_exists(labels, *ends) is expected
