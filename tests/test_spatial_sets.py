"""Maps of space as sets: what lies outside, connectivity against flood fills, chains, samples."""

import heapq
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from checks import map_of
from cspace import BLOCKED, FREE, MIXED, Grid, InputError, Robot, Workspace
from cspace.connectivity import chain, components, path_exists
from cspace.outside import Outside
from cspace.raster.raster import Raster
from cspace.sampling import nearest_center, sample_cells
from spatial import EMPTY, cells_around, component_of, outsides, sides_of, state_of, states
from strategies import seeds

ALONE = np.zeros(1, dtype=np.int64)

# ---- outside ---------------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(seeds, st.tuples(*[st.integers(1, 4)] * 3), st.tuples(*[st.integers(1, 3)] * 3), st.booleans())
def test_what_is_said_of_the_outside_follows_from_the_rasters(seed, shape, size, walled):
    """Outside the grid, FREE where no outer offset meets an obstacle and BLOCKED only where an inner one leaves."""
    rng = np.random.default_rng(seed)
    occupied, cells = rng.random(shape) < 0.3, rng.random(size) < 0.7
    lower = tuple(rng.integers(-3, 3, 3).tolist())
    outer, inner = Raster.trimmed(cells, lower), Raster.trimmed(cells & (rng.random(size) < 0.8), lower)
    outside = Outside.of(occupied, outer, inner, "blocked" if walled else "free")

    def hits(raster, k, beyond):
        spots = (np.argwhere(raster.cells) + raster.lower + k).tolist()
        inside = [all(0 <= c < n for c, n in zip(m, shape, strict=True)) for m in spots]
        return any(occupied[tuple(m)] if within else beyond for m, within in zip(spots, inside, strict=True))

    said = set()
    for k in product(*(range(-8, n + 8) for n in shape)):
        if all(0 <= c < n for c, n in zip(k, shape, strict=True)):
            continue
        found = state_of(np.zeros(shape), outside, k)
        assert found != FREE or not hits(outer, k, walled)
        assert found != BLOCKED or hits(inner, k, walled)
        said.add(found)
    far = BLOCKED if walled and inner.count else MIXED if walled else FREE
    assert outside.state == far and far in said


@settings(max_examples=100)
@given(outsides(), st.tuples(*[st.integers(1, 4)] * 3))
def test_walls_are_what_is_not_free(outside, shape):
    state = np.zeros(shape, dtype=np.uint8)
    walls = outside.walls(shape)
    assert walls.shape == (len(walls), 6)
    blocked = True
    for cell in cells_around(state, outside):
        if all(0 <= c < n for c, n in zip(cell, shape, strict=True)):
            continue
        own = state_of(state, outside, cell)
        middle = np.array(cell) + 0.5
        assert ((walls[:, :3] < middle) & (middle < walls[:, 3:])).all(axis=1).any() == (own != FREE)
        blocked &= own == BLOCKED
    assert outside.is_all_blocked(shape) == blocked
    overlap = np.minimum(walls[:, 3:], shape) - np.maximum(walls[:, :3], 0)
    assert (overlap <= 0).any(axis=1).all()  # none reaches into the grid


# ---- connectivity ----------------------------------------------------------------------------------------------------


def answers_of(state, rim):
    """Whether paths join the cells of a map and of a rim of one cell around it, every one with every one."""
    labels = components(state[np.newaxis], ALONE, np.array([rim]))
    cells = np.argwhere(np.ones([n + 2 for n in state.shape])) - 1
    framed = np.pad(state, 1, constant_values=FREE if rim else BLOCKED)
    ends = np.column_stack([np.zeros(len(cells), dtype=np.int64), cells])
    own = framed[tuple((cells + 1).T)]
    return cells, path_exists(labels, (ends[:, None], own[:, None]), (ends[None], own[None]))


@settings(max_examples=40, deadline=None)
@given(states(4, (FREE, FREE, MIXED, BLOCKED, BLOCKED)), st.booleans())
def test_paths_against_a_flood_fill(state, rim):
    cells, answers = answers_of(state, rim)
    passable = np.pad(state != BLOCKED, 1, constant_values=rim)
    for a, start in enumerate(map(tuple, cells.tolist())):
        inside = all(0 <= c < n for c, n in zip(start, state.shape, strict=True))
        free = component_of(state == FREE, start) if inside else set()
        joined = component_of(passable, tuple(c + 1 for c in start))
        for b, goal in enumerate(map(tuple, cells.tolist())):
            expected = True if goal in free else None if tuple(c + 1 for c in goal) in joined else False
            assert answers[a, b] is expected


def test_a_wall_with_a_hole_decides():
    state = np.zeros((9, 7, 8), dtype=np.uint8)
    state[4] = BLOCKED
    ends = [(np.array([0, i, 3, 3]), np.array(FREE, dtype=np.uint8)) for i in (1, 7)]
    for hole, expected in ((BLOCKED, False), (MIXED, None), (FREE, True)):
        state[4, 6, 7] = hole
        labels = components(state[np.newaxis], ALONE, np.array([False]))
        assert path_exists(labels, *ends) is expected
    state[4] = BLOCKED
    assert path_exists(components(state[np.newaxis], ALONE, np.array([True])), *ends) is None


# ---- chains ----------------------------------------------------------------------------------------------------------


def fewest_mixed(state, closed, start, goal, wraps):
    """Fewest MIXED cells of a chain, after its start; None where there is no chain (Dijkstra)."""
    best, todo = {start: 0}, [(0, start)]
    while todo:
        cost, here = heapq.heappop(todo)
        if here == goal:
            return cost
        for near in sides_of(here, state.shape, wraps):
            if state[near] == BLOCKED or closed[near]:
                continue
            total = cost + int(state[near] == MIXED)
            if total < best.get(near, 10**9):
                best[near] = total
                heapq.heappush(todo, (total, near))
    return None


@settings(max_examples=120, deadline=None)
@given(
    seeds,
    st.sampled_from([(1, 3, 4, 5), (1, 1, 6, 4), (1, 5, 1, 1), (5, 4, 3), (2, 5, 4), (1, 6, 7), (3, 3, 2, 4)]),
    st.booleans(),
)
def test_chains_have_the_fewest_mixed_cells(seed, shape, shuts):
    rng = np.random.default_rng(seed)
    stack = rng.choice(np.array([FREE, FREE, MIXED, MIXED, BLOCKED], dtype=np.uint8), shape)
    slice_of = rng.permutation(shape[0] * 2) % shape[0] if len(shape) == 3 else ALONE
    state = stack[slice_of]
    closed = rng.random(state.shape) < (0.15 if shuts else 0.0)
    start, goal = (tuple(rng.integers(0, state.shape).tolist()) for _ in range(2))
    found = chain(stack, slice_of, closed if shuts else None, np.array(start), np.array(goal))
    expected = fewest_mixed(state, closed, start, goal, wraps=True)
    if expected is None:
        assert found.shape == (0, len(shape))
        return
    cells = list(map(tuple, found.tolist()))
    assert cells[0] == start and cells[-1] == goal and len(set(cells)) == len(cells)
    for here, near in pairwise(cells):
        assert near in set(sides_of(here, state.shape, wraps=True))
        assert state[near] != BLOCKED and not closed[near]
    assert sum(int(state[cell] == MIXED) for cell in cells[1:]) == expected


def test_chains_keep_the_path_that_is_closed_out_of_use():
    state = np.zeros((1, 3, 3, 3), dtype=np.uint8)
    closed = np.zeros(state.shape, dtype=bool)
    start, goal = np.array([0, 0, 0, 0]), np.array([0, 2, 0, 0])
    assert len(chain(state, ALONE, closed, start, goal)) == 3
    closed[0, 1] = True
    assert chain(state, ALONE, closed, start, goal).shape == (0, 4)
    closed[0, 1, 2, 2] = False
    assert len(chain(state, ALONE, closed, start, goal)) == 11


# ---- samples ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(5, 4, 3), (1, 1, 1), (1, 9, 2)])
def test_samples_are_uniform_over_the_cells(shape):
    """Chi-squared over the cells and their eighths; six standard deviations."""
    rng = np.random.default_rng(0)
    grid = Grid((-1.0, 2.0, 0.5), 0.1, shape)
    cells = np.flatnonzero(rng.random(grid.size) < 0.6) if grid.size > 1 else ALONE
    n = 50_000
    samples = sample_cells(cells, grid, n, rng)
    place = grid.cell_of(samples)
    within = (samples - grid.lower) / grid.spacing - place
    part = np.ravel_multi_index(tuple(place.T), shape) * 8 + (within >= 0.5) @ [4, 2, 1]
    bins = np.bincount(part, minlength=grid.size * 8).reshape(-1, 8)
    assert bins[cells].sum() == n
    expected, freedom = n / len(cells) / 8, len(cells) * 8 - 1
    statistic = np.square(bins[cells] - expected).sum() / expected
    assert abs(statistic - freedom) < 6 * np.sqrt(2 * freedom)


@settings(max_examples=40)
@given(seeds, st.tuples(*[st.integers(1, 6)] * 3))
def test_the_nearest_middle_is_the_nearest(seed, shape):
    rng = np.random.default_rng(seed)
    grid = Grid((-1.0, 2.0, 0.5), 0.25, shape)
    cells = np.unique(rng.integers(0, grid.size, 5))
    middles = grid.center_of(np.stack(np.unravel_index(cells, shape), axis=-1))
    for point in rng.uniform(-2, 5, (5, 3)):
        nearest = nearest_center(cells, grid, point)
        assert (middles == nearest).all(axis=1).any()
        distances = np.linalg.norm(middles - point, axis=1)
        assert np.linalg.norm(nearest - point) == pytest.approx(distances.min())


def test_an_empty_outside_is_all_of_one_state():
    assert Outside(EMPTY, BLOCKED).is_all_blocked((2, 2, 2))
    assert not Outside(EMPTY, MIXED).is_all_blocked((2, 2, 2))
    assert Outside(EMPTY, FREE).walls((2, 2, 2)).shape == (0, 6)
    assert Outside(EMPTY, BLOCKED).walls((2, 3, 4)).shape == (6, 6)


# ---- absurd inputs ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_answers_far_away_and_for_no_numbers(dim):
    occupied = np.zeros((6, 5, 4)[:dim], bool)
    occupied[(2,) * dim] = True
    robot = Robot.disc(0.1) if dim == 2 else Robot.ball(0.1)
    space = cspace.build(Workspace.from_array(occupied, 1.0), robot, outside="free")
    rest = (1.5,) * (dim - 1)
    for far in (1e15, 1e18, 1e300, 1.7e308):
        nearest = space.nearest_free((far, *rest))
        assert nearest[0] == 5.5 and space.is_free(nearest)
        assert 0.0 <= space.clearance((far, *rest)) < np.inf
    for wrong in (np.nan, np.inf):
        assert not space.point_checker()(wrong, *rest)
        assert not space.point_checker()(0.5, *rest[1:], wrong)
        assert not space.edge_checker()(wrong, *rest, 0.5, *rest)
        assert space.clearance_checker()(wrong, *rest) == 0.0


def test_chains_begin_and_end_where_the_map_is_not_blocked():
    state = np.zeros((5, 4, 3), np.uint8)
    state[2, 1, 1] = BLOCKED
    space = map_of(state)
    inside, free = space.grid.center_of((2, 1, 1)), space.grid.center_of((0, 0, 0))
    assert [len(space.open_chain(*ends)) for ends in ((inside, free), (free, inside), (inside, inside))] == [0, 0, 0]
    assert len(space.open_chain(free, free)) == 1
    for closed in (np.zeros(state.shape, bool), np.zeros((1, 5, 4, 3), int), [[True]]):
        with pytest.raises(InputError, match="closed is a"):
            space.open_chain(free, free, closed)
