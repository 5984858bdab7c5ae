"""Components against labels by scipy, also after random changes."""

import itertools
import math
from unittest import mock

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage, sparse

import cspace
from cspace import BLOCKED, FREE, MIXED, ConfigurationError, InputError, Robot, Workspace
from cspace.map.components import BLOCK_SHIFTS, Components
from cspace.map.storage import read_only
from cspace.rotations import Rotations
from tests import handmade
from tests.maps import proven_paths
from tests.strategies import seeds

BLOCKS = {"small": {2: (0, 2, 2), 3: (1, 2, 1)}, "rows of eight": {2: (0, 1, 3), 3: (1, 0, 3)}, "as they are": {}}

RINGS = [(2, 1, 1), (3, 1, 1), (2, 1, 4), (2, 2, 2), (2, 3, 3), (2, 2, 4), (2, 3, 6), (3, 2, 4)]
"""Axes of the grid, slices, and rotation cells in a ring."""

ONE_SLICE = np.zeros(1, dtype=np.int64)


def make_ring(rotations):
    return (np.arange(rotations)[:, None] + [-1, 1]) % rotations


def make_components(stack, slice_of=ONE_SLICE, exterior_open=False, blocks="as they are"):
    with mock.patch.dict(BLOCK_SHIFTS, BLOCKS[blocks]):
        return Components(read_only(stack), slice_of, make_ring(len(slice_of)), np.full(len(stack), exterior_open))


def draw_stack(rng, dim, slices):
    shape = tuple(int(n) for n in rng.integers(1, (10 if dim == 3 else 15), dim))
    return rng.choice(3, (slices, *shape), p=rng.dirichlet([1.0, 1.0, 1.0])).astype(np.uint8)


def assert_same_partition(labels, expected):
    """Fail unless two labellings group the cells equally."""
    np.testing.assert_array_equal(labels < 0, expected < 0)
    pairs = labels.astype(np.int64) * (int(expected.max()) + 2) + expected
    assert count_distinct(labels) == count_distinct(expected) == count_distinct(pairs)


def count_distinct(numbers):
    """Count distinct values, some 20 times faster than ``np.unique``."""
    return np.count_nonzero(np.diff(np.sort(numbers, axis=None))) + 1


def list_cells_around(stack, rotations, around=2):
    axes = [np.arange(rotations), *(np.arange(-around, n + around) for n in stack.shape[1:])]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, stack.ndim)


def label_with_scipy(stack, slice_of, exterior_open, cells):
    """Label cells by scipy, with a rim as the exterior."""
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
        merged = np.where(labels > 0, sparse.csgraph.connected_components(links, directed=False)[1][labels] + 1, 0)
        inside = np.clip(cells[:, 1:] + 2, 0, np.array(framed.shape[1:]) - 1)
        numbers.append(merged[(np.minimum(cells[:, 0], len(merged) - 1), *inside.T)] - 1)
    return numbers


@settings(max_examples=100)
@given(seeds, st.sampled_from(RINGS), st.sampled_from(list(BLOCKS)), st.sampled_from([5, 2048]))
def test_labels_follow_a_stream_of_changes(seed, kind, blocks, task):
    """Query few cells first, so that caches hold few labels."""
    dim, slices, rotations = kind
    rng = np.random.default_rng(seed)
    stack = draw_stack(rng, dim, slices)
    exterior_open, slice_of = rng.random(slices) < 0.5, np.arange(rotations) % slices
    labels, cells = make_components(stack, slice_of, exterior_open, blocks), list_cells_around(stack, rotations)
    for _ in range(4):
        with mock.patch("cspace.map.components.BLOCKS_PER_TASK", task):
            for mixed, count in itertools.product((False, True), (3, 9)):
                labels.of(rng.choice(cells, count), mixed)
            for mixed, other in enumerate(label_with_scipy(stack, slice_of, exterior_open, cells)):
                assert_same_partition(labels.of(cells, bool(mixed)), other)
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
@given(seeds, st.sampled_from(RINGS), st.sampled_from(list(BLOCKS)))
def test_box_encloses_its_component(seed, kind, blocks):
    dim, slices, rotations = kind
    rng = np.random.default_rng(seed)
    stack = draw_stack(rng, dim, slices)
    labels = make_components(stack, np.arange(rotations) % slices, blocks=blocks)
    cells = list_cells_around(stack, rotations, 0)
    free = labels.of(cells)
    # Rotation cells that share a slice have the same components.
    for cell, component in list(zip(cells[free >= 0], free[free >= 0], strict=True))[:20]:
        ours = cells[free == component][:, 1:]
        np.testing.assert_array_equal(labels.box(cell), [ours.min(axis=0), ours.max(axis=0)])


@pytest.mark.parametrize("blocks", BLOCKS)
def test_chessboard_has_a_component_per_free_cell(blocks):
    state = (np.indices((150, 140)).sum(axis=0) % 2 * BLOCKED).astype(np.uint8)  # a chessboard
    labels = make_components(state[None], exterior_open=True, blocks=blocks)
    cells = list_cells_around(state[None], 1, 0)
    free, passable = labels.of(cells), labels.of(cells, mixed=True)
    assert len(np.unique(free)) - 1 == np.count_nonzero(state == FREE)
    assert len(np.unique(passable)) - 1 < np.count_nonzero(state == FREE)  # the exterior joins the cells at the border
    state[...] = FREE
    labels.refresh(np.array([[0, 0, 0, 0, 149, 139]]))
    assert len(np.unique(labels.of(cells))) == 1
    state[70:] = BLOCKED
    labels.refresh(np.array([[0, 70, 0, 0, 149, 139]]))
    assert set(np.unique(labels.of(cells))) == {-1, int(labels.of(cells[0]))}


@pytest.mark.parametrize("kind", [(2, 1, 1), (2, 3, 3), (3, 1, 1)])
@pytest.mark.parametrize("grain", [0.0, 1.0, 3.0])
def test_labels_of_large_shapes_equal_those_of_scipy(kind, grain):
    """Draw runs of all lengths up to a whole word."""
    dim, slices, rotations = kind
    shape, rng = ((150, 200) if dim == 2 else (20, 30, 140)), np.random.default_rng(dim)
    for share in (0.1, 0.4, 0.7):
        noise = ndimage.gaussian_filter(rng.random((slices, *shape)), (0, *[grain] * dim))
        stack = np.digitize(noise, np.quantile(noise, [share, share + 0.1])).astype(np.uint8)
        exterior_open, cells = np.zeros(slices, dtype=bool), list_cells_around(stack, rotations, 1)
        labels = make_components(stack, np.arange(rotations))
        for mixed, other in enumerate(label_with_scipy(stack, np.arange(rotations), exterior_open, cells)):
            assert_same_partition(labels.of(cells, bool(mixed)), other)


def test_one_cell_opens_and_closes_a_wall():
    state = np.zeros((300, 200), dtype=np.uint8)
    state[150] = BLOCKED
    labels = make_components(state[None])
    cells = np.array([[0, x, 20] for x in (3, 290)])
    for fill, expected in ((FREE, (1, 1)), (BLOCKED, (2, 2)), (MIXED, (2, 1)), (FREE, (1, 1))):
        state[150, 77] = fill
        labels.refresh(np.array([[0, 150, 77, 0, 150, 77]]))
        assert tuple(len(np.unique(labels.of(cells, mixed))) for mixed in (False, True)) == expected


def test_hint_guesses_that_a_room_is_closed():
    stack = np.zeros((16, 40, 30), dtype=np.uint8)
    stack[:, [10, 20], 10:21] = stack[:, 10:21, [10, 20]] = BLOCKED
    stack[:, 11:20, [11, 19]] = MIXED
    cells = np.array([[3, 15, 15], [5, 2, 2]])
    for outside in ([], [[5, -9, 2]]):
        for one, other in itertools.product([cells[0], cells[0] - [2, 0, 1]], [cells[1], *np.array(outside)]):
            labels = make_components(stack, np.arange(16), exterior_open=True)
            assert labels.hint(np.array([one, other]))[0]
            assert labels.hint(np.array([other, one]))[0]
            assert not labels.hint(np.array([one, one]))[0]
            assert not labels.hint(np.array([other, other]))[0]
    assert not make_components(stack[:15], np.arange(15)).hint(cells)[0]
    stack[3, 20, 15] = MIXED  # in a slice that the hint skips
    assert labels.hint(cells)[0]
    assert len(np.unique(labels.of(cells, mixed=True))) == 1
    assert labels.hint(cells[[1, 1]])[0]  # existing components are tested first
    labels.of(cells)
    assert not labels.hint(cells)[0]
    stack[4, 20, 15] = MIXED
    assert not make_components(stack, np.arange(16)).hint(cells)[0]


@settings(max_examples=60)
@given(seeds, st.sampled_from(RINGS), st.sampled_from(list(BLOCKS)))
def test_block_path_joins_only_joined_cells(seed, kind, blocks):
    dim, slices, rotations = kind
    rng = np.random.default_rng(seed)
    stack, exterior_open, slice_of = (
        draw_stack(rng, dim, slices),
        rng.random(slices) < 0.5,
        np.arange(rotations) % slices,
    )
    cells = list_cells_around(stack, rotations)
    expected = label_with_scipy(stack, slice_of, exterior_open, cells)[1]
    with mock.patch.multiple("cspace.map.components", HINT_SLICES=1, MIN_BLOCKS_PER_PATH_BLOCK=0):
        for one, other in rng.integers(0, len(cells), (8, 2)):
            joined_along_path = make_components(stack, slice_of, exterior_open, blocks).hint(cells[[one, other]])[1]
            assert not joined_along_path() or expected[one] == expected[other] >= 0


@pytest.mark.parametrize("min_blocks", [0, 3])
def test_block_path_proves_that_mixed_cells_join(min_blocks, monkeypatch):
    """Open a door at some rotations only, or the exterior."""
    monkeypatch.setattr("cspace.map.components.MIN_BLOCKS_PER_PATH_BLOCK", min_blocks)
    stack = np.zeros((16, 700, 600), dtype=np.uint8)
    stack[:, 350] = BLOCKED
    cells = np.array([[0, 20, 30], [7, 690, 500]])
    assert make_components(stack, np.arange(16)).hint(cells)[0]
    labels = make_components(stack, np.arange(16), exterior_open=True)
    apart, joined_along_path = labels.hint(cells)
    assert not apart and joined_along_path() and joined_along_path()
    assert labels.hint(cells)[0]
    for slices, joined in (([4, 5], True), ([4], True), ([], False)):
        stack[:, 350, 200] = BLOCKED
        stack[slices, 350, 200] = MIXED
        assert make_components(stack, np.arange(16)).hint(cells)[1]() is (joined and min_blocks == 0)
    stack[4, 350, 200], stack[8, 349, 200], stack[4, 349, 200] = MIXED, MIXED, BLOCKED
    assert not make_components(stack, np.arange(16)).hint(cells)[1]()  # merged slices are open, but no single one is


# ---- queries of maps -------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(seeds, st.sampled_from(handmade.MAP_KINDS), st.sampled_from(["free", "blocked"]))
def test_connectivity_agrees_with_components_of_a_graph(seed, kind, outside):
    """Query all pairs of cells of a small map."""
    states = handmade.random_states(np.random.default_rng(seed), kind, 4, (FREE, MIXED, BLOCKED, BLOCKED))
    space, cells = handmade.make_map(states, kind, outside), handmade.all_cells(states)
    cells = np.random.default_rng(seed).permutation(cells)[:150]
    q = handmade.cell_centers(space, cells)
    away = np.array(q[0])
    away[: space.grid.dim] = -99.0
    exterior_open = space.classify(away) != BLOCKED
    framed = np.pad(states != BLOCKED, [(0, 0)] + [(1, 1)] * space.grid.dim, constant_values=exterior_open)
    free = handmade.components(states == FREE, kind)[tuple(cells.T)]
    passable = handmade.components(framed, kind)[(cells[:, 0], *(cells[:, 1:] + 1).T)]
    joined, maybe = (np.equal.outer(one, one) & (one >= 0) for one in (free, passable))
    expected = np.where(joined, True, np.where(maybe, None, False))
    assert proven_paths(space, q[:, None], q[None]).tolist() == expected.tolist()
    with mock.patch("cspace.map.components.HINT_SLICES", 1):  # the hint may be right or wrong
        for one, other in itertools.pairwise(range(min(len(q), 6))):
            space = handmade.make_map(states, kind, outside)
            assert proven_paths(space, q[one], q[other]) is expected[one, other]


@settings(max_examples=10)
@given(seeds, st.sampled_from(handmade.MAP_KINDS))
def test_reachable_bounds_are_the_box_of_the_component(seed, kind):
    """Compare with the box of all connected cells."""
    states = handmade.random_states(np.random.default_rng(seed), kind)
    space = handmade.make_map(states, kind, spacing=1.0)
    numbers = handmade.components(states == FREE, kind)
    for cell in np.argwhere(states == FREE)[:8]:
        joined = np.argwhere(numbers == numbers[tuple(cell)])[:, 1:]
        lower, upper = space.reachable_bounds(handmade.cell_centers(space, cell[None])[0])
        assert lower.tolist() == joined.min(axis=0).tolist()
        assert upper.tolist() == (joined.max(axis=0) + 1).tolist()
    for cell in np.argwhere(states != FREE)[:1]:
        with pytest.raises(ConfigurationError, match="FREE"):
            space.reachable_bounds(handmade.cell_centers(space, cell[None])[0])


TINY_BAR = Robot.rectangle(1e-6, 1e-7)


@pytest.mark.parametrize(
    ("robot", "rotations"),
    [
        (TINY_BAR, 2),
        (TINY_BAR, 6),
        (Robot.rectangle(1e-6, 1e-6), 8),
        (Robot.disc(1e-6), 4),
        (Robot.box((1e-6, 1e-7, 1e-7)), 6),
        (Robot.box((1e-6, 1e-7, 1e-7)), Rotations.quaternions(2)),
    ],
)
def test_rotation_cells_that_share_slices_are_joined(robot, rotations):
    cells, shape = Rotations.of(rotations), (4, 3, 2)[: robot.dim]
    kind, slice_of = "turning any way" if len(cells.names) == 4 else "", cells._slices_for(robot.shape)
    workspace = Workspace.from_array(np.zeros(shape, dtype=bool), 0.25)
    for seed in range(6):
        stack = np.random.default_rng(seed).choice(np.array([0, 1, 2, 2], np.uint8), (slice_of.max() + 1, *shape))
        space, states = handmade.map_in(workspace, robot, stack, cells, outside="free"), stack[slice_of]
        assert len(stack) < len(cells) and (space.cell_states == states).all()
        positions = np.random.default_rng(seed).permutation(handmade.all_cells(states))[:150]
        q = handmade.cell_centers(space, positions)
        free = handmade.components(states == FREE, kind)[tuple(positions.T)]
        answers = proven_paths(space, q[:, None], q[None])
        assert (np.equal(answers, True) == (np.equal.outer(free, free) & (free >= 0))).all()


def build_wall(gap, outside="blocked"):
    """Build a room with a wall and a gap."""
    occupied = np.zeros((40, 20), dtype=bool)
    occupied[20, gap:] = True
    return cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.25), outside=outside)


def test_door_width_decides_connectivity():
    assert build_wall(12).is_connected((1.0, 1.0), (3.0, 1.0))
    assert build_wall(3).is_disconnected((1.0, 1.0), (3.0, 1.0))
    assert proven_paths(build_wall(5), (1.0, 1.0), (3.0, 1.0)) is None  # 0.5 m for a disc 0.5 m across


def test_free_exterior_leaves_connectivity_undecided():
    assert proven_paths(build_wall(0, "free"), (1.0, 1.0), (3.0, 1.0)) is None
    assert build_wall(0).is_disconnected((1.0, 1.0), (3.0, 1.0))


@pytest.mark.parametrize("robot", [Robot.disc(0.1), Robot.rectangle(0.2, 0.2)], ids=["disc", "square"])
@pytest.mark.parametrize(
    ("spacing", "beyond", "proven"),
    [(0.1, 0.0, False), (0.1, 1e-3, True), (0.05, 0.0, True)],
    ids=["to the bounds", "beyond the bounds", "finer cells"],
)
def test_walls_disconnect_small_robots_as_the_page_of_limits_says(robot, spacing, beyond, proven):
    wall = shapely.box(2.0, -beyond, 2.4, 3.0 + beyond)
    workspace = Workspace.from_polygons([wall], spacing, bounds=(0.0, 0.0, 4.0, 3.0))
    assert cspace.build(workspace, robot).is_disconnected((0.5, 1.5), (3.5, 1.5)) == proven


def test_blocked_configurations_are_disconnected():
    space = build_wall(12)
    assert space.is_disconnected((2.05, 1.8), (2.05, 1.8))
    assert space.is_disconnected((1.0, 1.0), (-5.0, 1.0))
    assert space.is_connected((1.0, 1.0), (1.0, 1.0))


def test_bar_passes_only_lengthwise():
    """Put a bar into a narrow passage."""
    occupied = np.zeros((160, 80), dtype=bool)
    occupied[50:110, :34] = occupied[50:110, 46:] = True  # a passage 0.6 m wide and 3 m long
    robot = Robot.rectangle(1.2, 0.2, (0.1, 0.0))
    space = cspace.build(Workspace.from_array(occupied, 0.05), robot, rotations=36)
    left, center, right = (1.2, 2.0), (4.0, 2.0), (6.8, 2.0)
    assert space.is_connected((*left, 0.0), (*right, 0.0))
    assert space.is_connected((*left, 0.0), (*right, math.pi))
    assert space.is_connected((*center, 0.0), (*center, math.pi))
    assert space.is_disconnected((*left, 0.0), (*center, math.pi / 2))
    occupied[[50, 109]] = True
    closed = cspace.build(Workspace.from_array(occupied, 0.05), robot, rotations=36)
    assert closed.is_free([(*center, 0.0), (*center, math.pi)]).all()
    assert closed.is_disconnected((*center, 0.0), (*center, math.pi))


def test_rotations_in_place_wrap_around():
    states = np.full((6, 1, 1), BLOCKED)
    states[[0, 1, 5]] = FREE
    space = handmade.make_map(states, "turning")
    assert space.is_connected((0.1, 0.1, 1.0), (0.1, 0.1, -1.0))
    assert space.is_connected((0.1, 0.1, 1.0), (0.1, 0.1, 2 * math.pi - 1.0))
    assert space.is_disconnected((0.1, 0.1, 0.0), (0.1, 0.1, math.pi))


def test_connectivity_broadcasts_and_refuses_nan():
    space = build_wall(12)
    assert proven_paths(space, np.full((2, 1, 2), 1.0), np.full((3, 2), 1.1)).tolist() == [[True] * 3] * 2
    assert proven_paths(space, np.empty((0, 2)), (0.1, 0.1)).shape == (0,)
    with pytest.raises(InputError, match=r"q0 number 0 is .*nan"):
        space.is_connected((np.nan, 1.0), (1.0, 1.0))
    with pytest.raises(InputError, match=r"q1 number 2 is .*nan"):
        space.is_disconnected(np.ones((4, 2)), [(1.0, 1.0), (0.5, 0.5), (1.0, np.nan), (1.0, 1.0)])
