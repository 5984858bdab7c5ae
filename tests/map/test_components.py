"""Components against scipy's labels, after any stream of changes; paths against graphs of cells."""

import itertools
import math
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage, sparse

import cspace
import handmade
from cspace import BLOCKED, FREE, MIXED, ConfigurationError, InputError, Robot, Workspace
from cspace.map.components import SHIFTS, Components
from cspace.map.storage import read_only
from cspace.rotations import Rotations
from maps import proven_paths
from strategies import seeds

BLOCKS = {"small": {2: (0, 2, 2), 3: (1, 2, 1)}, "rows of eight": {2: (0, 1, 3), 3: (1, 0, 3)}, "as they are": {}}

KINDS = [(2, 1, 1), (3, 1, 1), (2, 1, 4), (2, 2, 2), (2, 3, 3), (2, 2, 4), (2, 3, 6), (3, 2, 4)]
"""Axes of the grid, slices, and rotation cells in a ring."""

ALONE = np.zeros(1, dtype=np.int64)


def ring(turns):
    return (np.arange(turns)[:, None] + [-1, 1]) % turns


def components(stack, slice_of=ALONE, rim=False, blocks="as they are"):
    with mock.patch.dict(SHIFTS, BLOCKS[blocks]):
        return Components(read_only(stack), slice_of, ring(len(slice_of)), np.full(len(stack), rim))


def random_stack(rng, dim, slices):
    shape = tuple(int(n) for n in rng.integers(1, (10 if dim == 3 else 15), dim))
    return rng.choice(3, (slices, *shape), p=rng.dirichlet([1.0, 1.0, 1.0])).astype(np.uint8)


def same_partition(mine, other):
    """Fail unless two labellings, -1 for none, put the same cells together."""
    np.testing.assert_array_equal(mine < 0, other < 0)
    pairs = mine.astype(np.int64) * (int(other.max()) + 2) + other
    assert distinct(mine) == distinct(other) == distinct(pairs)


def distinct(numbers):
    """How many there are, some 20 times as soon as by ``np.unique``."""
    return np.count_nonzero(np.diff(np.sort(numbers, axis=None))) + 1


def all_cells(stack, turns, around=2):
    axes = [np.arange(turns), *(np.arange(-around, n + around) for n in stack.shape[1:])]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, stack.ndim)


def by_scipy(stack, slice_of, exterior_open, cells):
    """Numbers of the components of cells, from labels of the whole map with a rim around, its turns in a ring."""
    order = slice_of if len(stack) > 1 else [0]
    numbers = []
    for kind, member in enumerate((stack == FREE, stack != BLOCKED)):
        framed = np.zeros((len(stack), *(n + 4 for n in stack.shape[1:])), dtype=bool)
        if kind:
            framed.T[...] = exterior_open
        framed[(slice(None), *[slice(2, -2)] * (stack.ndim - 1))] = member
        labels, count = ndimage.label(framed[order])
        first, last = labels[0].ravel(), labels[-1].ravel()
        both = (first > 0) & (last > 0) & (len(order) > 1)
        links = sparse.coo_array((both[both], (first[both], last[both])), shape=(count + 1, count + 1))
        middle = np.where(labels > 0, sparse.csgraph.connected_components(links, directed=False)[1][labels] + 1, 0)
        inside = np.clip(cells[:, 1:] + 2, 0, np.array(framed.shape[1:]) - 1)
        numbers.append(middle[(np.minimum(cells[:, 0], len(middle) - 1), *inside.T)] - 1)
    return numbers


@settings(max_examples=100)
@given(seeds, st.sampled_from(KINDS), st.sampled_from(list(BLOCKS)), st.sampled_from([5, 2048]))
def test_labels_follow_a_stream_of_changes(seed, kind, blocks, task):
    """Some cells are asked for before all are, so that labels of some blocks are there, more than are kept or fewer."""
    dim, slices, turns = kind
    rng = np.random.default_rng(seed)
    stack = random_stack(rng, dim, slices)
    rim, slice_of = rng.random(slices) < 0.5, np.arange(turns) % slices
    labels, cells = components(stack, slice_of, rim, blocks), all_cells(stack, turns)
    for _ in range(4):
        with mock.patch("cspace.map.components.TASK", task):
            for mixed, count in itertools.product((False, True), (3, 9)):
                labels.of(rng.choice(cells, count), mixed)
            for mixed, other in enumerate(by_scipy(stack, slice_of, rim, cells)):
                same_partition(labels.of(cells, bool(mixed)), other)
        boxes = np.tile(np.repeat([0, -1], 3), (slices, 1))
        for s in np.flatnonzero(rng.random(slices) < 0.7):
            first = [int(rng.integers(0, n)) for n in stack.shape[1:]]
            last = [int(rng.integers(i, min(n, i + 5))) for i, n in zip(first, stack.shape[1:], strict=True)]
            window = tuple(slice(i, j + 1) for i, j in zip(first, last, strict=True))
            stack[s][window] = rng.integers(0, 3, stack[s][window].shape)
            pad = [0] * (3 - dim)
            boxes[s] = [*pad, *first, *pad, *last]
        labels.refresh(np.asarray(boxes))


@settings(max_examples=60)
@given(seeds, st.sampled_from(KINDS), st.sampled_from(list(BLOCKS)))
def test_the_box_holds_its_component(seed, kind, blocks):
    dim, slices, turns = kind
    rng = np.random.default_rng(seed)
    stack = random_stack(rng, dim, slices)
    labels = components(stack, np.arange(turns) % slices, blocks=blocks)
    cells = all_cells(stack, turns, 0)
    free = labels.of(cells)
    # One rotation cell stands for all where they share one slice.
    for cell, number in list(zip(cells[free >= 0], free[free >= 0], strict=True))[:20]:
        ours = cells[free == number][:, 1:]
        np.testing.assert_array_equal(labels.box(cell), [ours.min(axis=0), ours.max(axis=0)])


@pytest.mark.parametrize("blocks", BLOCKS)
def test_many_components_fit_in_every_block(blocks):
    state = (np.indices((150, 140)).sum(axis=0) % 2 * BLOCKED).astype(np.uint8)  # a chessboard
    labels = components(state[None], rim=True, blocks=blocks)
    cells = all_cells(state[None], 1, 0)
    free, passable = labels.of(cells), labels.of(cells, mixed=True)
    assert len(np.unique(free)) - 1 == np.count_nonzero(state == FREE)
    assert len(np.unique(passable)) - 1 < np.count_nonzero(state == FREE)  # the rim joins those at the border
    state[...] = FREE
    labels.refresh(np.array([[0, 0, 0, 0, 149, 139]]))
    assert len(np.unique(labels.of(cells))) == 1
    state[70:] = BLOCKED
    labels.refresh(np.array([[0, 70, 0, 0, 149, 139]]))
    assert set(np.unique(labels.of(cells))) == {-1, int(labels.of(cells[0]))}


@pytest.mark.parametrize("kind", [(2, 1, 1), (2, 3, 3), (3, 1, 1)])
@pytest.mark.parametrize("grain", [0.0, 1.0, 3.0])
def test_shapes_across_whole_blocks_are_labelled(kind, grain):
    """Runs of all lengths, up to the last bit of a word; what a row leaves apart, a later one joins, or none does."""
    dim, slices, turns = kind
    shape, rng = ((150, 200) if dim == 2 else (20, 30, 140)), np.random.default_rng(dim)
    for share in (0.1, 0.4, 0.7):
        noise = ndimage.gaussian_filter(rng.random((slices, *shape)), (0, *[grain] * dim))
        stack = np.digitize(noise, np.quantile(noise, [share, share + 0.1])).astype(np.uint8)
        rim, cells = np.zeros(slices, dtype=bool), all_cells(stack, turns, 1)
        labels = components(stack, np.arange(turns))
        for mixed, other in enumerate(by_scipy(stack, np.arange(turns), rim, cells)):
            same_partition(labels.of(cells, bool(mixed)), other)


def test_a_door_joins_a_wall_across_many_blocks():
    state = np.zeros((300, 200), dtype=np.uint8)
    state[150] = BLOCKED
    labels = components(state[None])
    cells = np.array([[0, x, 20] for x in (3, 290)])
    for fill, expected in ((FREE, (1, 1)), (BLOCKED, (2, 2)), (MIXED, (2, 1)), (FREE, (1, 1))):
        state[150, 77] = fill
        labels.refresh(np.array([[0, 150, 77, 0, 150, 77]]))
        assert tuple(len(np.unique(labels.of(cells, mixed))) for mixed in (False, True)) == expected


def test_a_few_slices_hint_that_a_room_is_closed():
    stack = np.zeros((16, 40, 30), dtype=np.uint8)
    stack[:, [10, 20], 10:21] = stack[:, 10:21, [10, 20]] = BLOCKED
    stack[:, 11:20, [11, 19]] = MIXED
    cells = np.array([[3, 15, 15], [5, 2, 2]])
    for outside in ([], [[5, -9, 2]]):
        for one, other in itertools.product([cells[0], cells[0] - [2, 0, 1]], [cells[1], *np.array(outside)]):
            labels = components(stack, np.arange(16), rim=True)
            assert labels.hint(np.array([one, other]))[0]
            assert labels.hint(np.array([other, one]))[0]
            assert not labels.hint(np.array([one, one]))[0]
            assert not labels.hint(np.array([other, other]))[0]
    assert not components(stack[:15], np.arange(15)).hint(cells)[0]
    stack[3, 20, 15] = MIXED  # in a slice that is not looked at
    assert labels.hint(cells)[0]
    assert len(np.unique(labels.of(cells, mixed=True))) == 1
    assert labels.hint(cells[[1, 1]])[0]  # what is made is asked first
    labels.of(cells)
    assert not labels.hint(cells)[0]
    stack[4, 20, 15] = MIXED
    assert not components(stack, np.arange(16)).hint(cells)[0]


@settings(max_examples=60)
@given(seeds, st.sampled_from(KINDS), st.sampled_from(list(BLOCKS)))
def test_what_a_few_blocks_join_is_joined(seed, kind, blocks):
    dim, slices, turns = kind
    rng = np.random.default_rng(seed)
    stack, rim, slice_of = random_stack(rng, dim, slices), rng.random(slices) < 0.5, np.arange(turns) % slices
    cells = all_cells(stack, turns)
    expected = by_scipy(stack, slice_of, rim, cells)[1]
    with mock.patch.multiple("cspace.map.components", HINTS=1, SHORT=0):
        for one, other in rng.integers(0, len(cells), (8, 2)):
            few_join = components(stack, slice_of, rim, blocks).hint(cells[[one, other]])[1]
            assert not few_join() or expected[one] == expected[other] >= 0


@pytest.mark.parametrize("short", [0, 3])
def test_a_few_blocks_show_that_mixed_cells_join(short, monkeypatch):
    """Through a door that is open at one rotation alone, or around the map; they are looked at once, and if few."""
    monkeypatch.setattr("cspace.map.components.SHORT", short)
    stack = np.zeros((16, 700, 600), dtype=np.uint8)
    stack[:, 350] = BLOCKED
    cells = np.array([[0, 20, 30], [7, 690, 500]])
    assert components(stack, np.arange(16)).hint(cells)[0]
    labels = components(stack, np.arange(16), rim=True)
    apart, few_join = labels.hint(cells)
    assert not apart and few_join() and few_join()
    assert labels.hint(cells)[0]
    for slices, joined in (([4, 5], True), ([4], True), ([], False)):
        stack[:, 350, 200] = BLOCKED
        stack[slices, 350, 200] = MIXED
        assert components(stack, np.arange(16)).hint(cells)[1]() is (joined and short == 0)
    stack[4, 350, 200], stack[8, 349, 200], stack[4, 349, 200] = MIXED, MIXED, BLOCKED
    assert not components(stack, np.arange(16)).hint(cells)[1]()  # the slices are open together, and none alone


# ---- as a map answers ------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(seeds, st.sampled_from(handmade.KINDS), st.sampled_from(["free", "blocked"]))
def test_connectivity_agrees_with_components_of_a_graph(seed, kind, outside):
    """Pairs of cells of a small map; beyond the grid all is FREE, or BLOCKED."""
    states = handmade.random_states(np.random.default_rng(seed), kind, 4, (FREE, MIXED, BLOCKED, BLOCKED))
    space, cells = handmade.made(states, kind, outside), handmade.all_cells(states)
    cells = np.random.default_rng(seed).permutation(cells)[:150]
    q = handmade.middles(space, cells)
    away = np.array(q[0])
    away[: space.grid.dim] = -99.0
    rim = space.classify(away) != BLOCKED
    framed = np.pad(states != BLOCKED, [(0, 0)] + [(1, 1)] * space.grid.dim, constant_values=rim)
    free = handmade.components(states == FREE, kind)[tuple(cells.T)]
    passable = handmade.components(framed, kind)[(cells[:, 0], *(cells[:, 1:] + 1).T)]
    joined, maybe = (np.equal.outer(one, one) & (one >= 0) for one in (free, passable))
    expected = np.where(joined, True, np.where(maybe, None, False))
    assert proven_paths(space, q[:, None], q[None]).tolist() == expected.tolist()
    with mock.patch("cspace.map.components.HINTS", 1):  # slices hint at it, rightly or wrongly
        for one, other in itertools.pairwise(range(min(len(q), 6))):
            space = handmade.made(states, kind, outside)
            assert proven_paths(space, q[one], q[other]) is expected[one, other]


@settings(max_examples=10)
@given(seeds, st.sampled_from(handmade.KINDS))
def test_free_reach_is_the_box_of_the_component(seed, kind):
    """All cells that free cells join to one lie in the box, and every side of it has one of them."""
    states = handmade.random_states(np.random.default_rng(seed), kind)
    space = handmade.made(states, kind, spacing=1.0)
    numbers = handmade.components(states == FREE, kind)
    for cell in np.argwhere(states == FREE)[:8]:
        joined = np.argwhere(numbers == numbers[tuple(cell)])[:, 1:]
        lower, upper = space.reachable_bounds(handmade.middles(space, cell[None])[0])
        assert lower.tolist() == joined.min(axis=0).tolist()
        assert upper.tolist() == (joined.max(axis=0) + 1).tolist()
    for cell in np.argwhere(states != FREE)[:1]:
        with pytest.raises(ConfigurationError, match="FREE"):
            space.reachable_bounds(handmade.middles(space, cell[None])[0])


BAR = Robot.rectangle(1e-6, 1e-7)


@pytest.mark.parametrize(
    ("robot", "turns"),
    [
        (BAR, 2),
        (BAR, 6),
        (Robot.rectangle(1e-6, 1e-6), 8),
        (Robot.disc(1e-6), 4),
        (Robot.box((1e-6, 1e-7, 1e-7)), 6),
        (Robot.box((1e-6, 1e-7, 1e-7)), Rotations.quaternions(2)),
    ],
)
def test_rotation_cells_that_share_slices_are_joined(robot, turns):
    cells, shape = Rotations.of(turns), (4, 3, 2)[: robot.dim]
    kind, slice_of = "turning any way" if len(cells.names) == 4 else "", cells.slices_for(robot.shape)
    workspace = Workspace.from_array(np.zeros(shape, dtype=bool), 0.25)
    for seed in range(6):
        stack = np.random.default_rng(seed).choice(np.array([0, 1, 2, 2], np.uint8), (slice_of.max() + 1, *shape))
        space, states = handmade.map_in(workspace, robot, stack, cells, outside="free"), stack[slice_of]
        assert len(stack) < cells.count and (space.cell_states == states).all()
        places = np.random.default_rng(seed).permutation(handmade.all_cells(states))[:150]
        q = handmade.middles(space, places)
        free = handmade.components(states == FREE, kind)[tuple(places.T)]
        answers = proven_paths(space, q[:, None], q[None])
        assert (np.equal(answers, True) == (np.equal.outer(free, free) & (free >= 0))).all()


def exterior_blocked(gap, outside="blocked"):
    """A room of 40 x 20 cells with a wall that has a gap of so many cells."""
    occupied = np.zeros((40, 20), dtype=bool)
    occupied[20, gap:] = True
    return cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.25), outside=outside)


def test_a_door_decides():
    assert exterior_blocked(12).is_connected((1.0, 1.0), (3.0, 1.0))
    assert exterior_blocked(3).is_disconnected((1.0, 1.0), (3.0, 1.0))
    assert proven_paths(exterior_blocked(5), (1.0, 1.0), (3.0, 1.0)) is None  # 0.5 m for a disc 0.5 m across


def test_a_way_around_the_map_is_no_proof_of_absence():
    assert proven_paths(exterior_blocked(0, "free"), (1.0, 1.0), (3.0, 1.0)) is None
    assert exterior_blocked(0).is_disconnected((1.0, 1.0), (3.0, 1.0))


def test_what_collides_has_no_path():
    space = exterior_blocked(12)
    assert space.is_disconnected((2.05, 1.8), (2.05, 1.8))
    assert space.is_disconnected((1.0, 1.0), (-5.0, 1.0))
    assert space.is_connected((1.0, 1.0), (1.0, 1.0))


def test_a_passage_decides():
    """A bar fits through lengthwise, and turns around behind the passage, but not in it."""
    occupied = np.zeros((160, 80), dtype=bool)
    occupied[50:110, :34] = occupied[50:110, 46:] = True  # a passage 0.6 m wide and 3 m long
    robot = Robot.rectangle(1.2, 0.2, (0.1, 0.0))
    space = cspace.build(Workspace.from_array(occupied, 0.05), robot, rotations=36)
    left, middle, right = (1.2, 2.0), (4.0, 2.0), (6.8, 2.0)
    assert space.is_connected((*left, 0.0), (*right, 0.0))
    assert space.is_connected((*left, 0.0), (*right, math.pi))
    assert space.is_connected((*middle, 0.0), (*middle, math.pi))
    assert space.is_disconnected((*left, 0.0), (*middle, math.pi / 2))
    occupied[[50, 109]] = True
    closed = cspace.build(Workspace.from_array(occupied, 0.05), robot, rotations=36)
    assert closed.is_free([(*middle, 0.0), (*middle, math.pi)]).all()
    assert closed.is_disconnected((*middle, 0.0), (*middle, math.pi))


def test_turning_on_the_spot_wraps():
    states = np.full((6, 1, 1), BLOCKED)
    states[[0, 1, 5]] = FREE
    space = handmade.made(states, "turning")
    assert space.is_connected((0.1, 0.1, 1.0), (0.1, 0.1, -1.0))
    assert space.is_connected((0.1, 0.1, 1.0), (0.1, 0.1, 2 * math.pi - 1.0))
    assert space.is_disconnected((0.1, 0.1, 0.0), (0.1, 0.1, math.pi))


def test_connectivity_broadcasts_and_names_what_it_refuses():
    space = exterior_blocked(12)
    assert proven_paths(space, np.full((2, 1, 2), 1.0), np.full((3, 2), 1.1)).tolist() == [[True] * 3] * 2
    assert proven_paths(space, np.empty((0, 2)), (0.1, 0.1)).shape == (0,)
    with pytest.raises(InputError, match=r"q0 number 0 is .*nan"):
        space.is_connected((np.nan, 1.0), (1.0, 1.0))
    with pytest.raises(InputError, match=r"q1 number 2 is .*nan"):
        space.is_disconnected(np.ones((4, 2)), [(1.0, 1.0), (0.5, 0.5), (1.0, np.nan), (1.0, 1.0)])
