"""Widest paths: largest bottleneck clearance, then shortest length."""

import bisect
import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

import planners
from cspace import FREE, MIXED
from planners._searches.chains import find_cells
from tests.helpers import handmade
from tests.helpers.oracles import link_cells, path_length
from tests.helpers.planning import build_from_states, turn_between
from tests.helpers.strategies import examples, seeds

WIDEST_SPACES = ("plane", "space", "turning", "yawing")
WIDEST_TURNS = {"turning": 5, "yawing": 4}


def draw_map(name, rng):
    """Draw a small map with some MIXED cells."""
    cells = tuple(
        (rng.integers(3, 9, 2) if name in ("plane", "turning") else rng.integers(2, 5, 3)).tolist()
    )
    shape = (WIDEST_TURNS[name], *cells) if name in WIDEST_TURNS else cells
    state = np.where(rng.random(shape) < rng.uniform(0.02, 0.3), MIXED, FREE).astype(np.uint8)
    return build_from_states(state, WIDEST_TURNS.get(name), spacing=0.5)


def list_cell_centers(space):
    """Return the centers of all cells."""
    cells = np.ones((len(space.rotations), *space.grid.shape), dtype=bool)
    return np.asarray(handmade.cell_centers(space, handmade.all_cells(cells)))


def number_cells(space):
    """Return the number of each cell, shape (rotations, ...)."""
    return np.arange(len(space.rotations) * space.grid.size).reshape(-1, *space.grid.shape)


def link_wide_cells(space, wide, corners):
    """Return the graph of wide cells, weighted by length."""
    turns, size = len(space.rotations), math.prod(space.grid.shape)
    layers = wide.reshape(turns, *space.grid.shape)
    links = [
        [[k * size], [k * size], [0.0]] + link_cells(layer, corners) * [[1], [1], [0.5]]
        for k, layer in enumerate(layers)
    ]
    if space.rotations.names:
        here = np.flatnonzero(wide)
        ahead = (here + size) % wide.size
        turned = np.stack([here, ahead, np.full(len(here), math.pi / turns)])[:, wide[ahead]]
        links += [turned, turned[[1, 0, 2]]]
    first, last, metres = np.concatenate(links, axis=1)
    ends = first.astype(int), last.astype(int)
    return sparse.csr_array((metres, ends), shape=(wide.size, wide.size))


def find_bottleneck(space, clearances, start, goal):
    """Return the largest minimum clearance of a chain, or 0."""

    def is_too_wide(min_clearance):
        wide = clearances >= min_clearance
        labels = connected_components(link_wide_cells(space, wide, False))[1]
        return not (wide[start] and wide[goal] and labels[start] == labels[goal])

    levels = np.unique(clearances[clearances > 0.0]).tolist()
    return [0.0, *levels][bisect.bisect_left(levels, True, key=is_too_wide)]


def compute_length(space, path):
    """Return metres plus half a metre per radian."""
    dim = space.grid.dim
    turns = np.abs(turn_between(path[:-1, dim:], path[1:, dim:])).sum()
    return path_length(path[:, :dim]) + 0.5 * float(turns)


def find_widest_path(space, start, goal, simplify=True, **options):
    """Return the waypoints of a plan by MaxClearance."""
    search = planners.Search("MaxClearance", simplify=simplify)
    return planners.plan(space, start, goal, planner=search, **options).waypoints


@pytest.mark.parametrize("name", WIDEST_SPACES)
@examples(8)
@example(65537)  # the climb must not cut a corner
@given(seeds)
def test_path_is_widest_then_shortest(name, seed):
    rng = np.random.default_rng(seed)
    space = draw_map(name, rng)
    points, numbers = list_cell_centers(space), number_cells(space)
    clearances = np.asarray(space.clearance(points)) / space.grid.spacing  # exact at centers
    free = np.flatnonzero(clearances > 0.0)
    for start, goal in rng.choice(free, (2, 2)) if len(free) else []:
        best = find_bottleneck(space, clearances, start, goal)
        path = find_widest_path(space, points[start], points[goal], simplify=False)
        assert (len(path) > 0) == (best > 0.0)
        if not len(path):
            continue
        assert space.certify_path(path).all()
        narrowest = clearances[numbers[tuple(find_cells(space, path).T)]].min()
        assert narrowest == pytest.approx(best, abs=1 / 64 + 1e-5)
        if narrowest < min(clearances[start], clearances[goal]):  # without climbs
            wide = clearances >= narrowest - 1e-5
            shortest = dijkstra(link_wide_cells(space, wide, True), indices=start)[goal]
            assert compute_length(space, path) == pytest.approx(shortest, rel=1e-5)
        pulled = find_widest_path(space, points[start], points[goal])
        assert np.array_equal(pulled[[0, -1]], path[[0, -1]]) and space.certify_path(pulled).all()
        assert compute_length(space, pulled) <= compute_length(space, path) + 1e-9
        shares = np.linspace(0.0, 1.0, 30)[:, None]
        parts = [
            space.rotations.add_steps(
                np.repeat(a[None], 30, axis=0), shares * space.rotations.steps_between(a, b)
            )
            for a, b in itertools.pairwise(pulled)
        ]
        passed = numbers[tuple(find_cells(space, np.concatenate([*parts, pulled])).T)]
        assert clearances[passed].min() >= best - 1 / 64 - 1e-5
