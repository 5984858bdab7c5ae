"""Laws of the search of cells, "Grid", on maps of every space in memory."""

import itertools
from contextlib import nullcontext, suppress

import numpy as np
import pytest
from hypothesis import given

import planners
from cspace.errors import ConfigurationError
from tests.helpers.any_map import ALL_KINDS, build_kind, draw_free_pairs
from tests.helpers.strategies import examples, seeds

IN_MEMORY = [kind for kind in ALL_KINDS if kind[1] == "memory"]


@pytest.fixture(scope="module", params=IN_MEMORY, ids="-".join)
def any_map(request, tmp_path_factory):
    """Build a map that tests share and none changes."""
    return build_kind(request.param, tmp_path_factory.mktemp("any"))


def test_paths_are_certified_and_no_shorter_than_the_bound(any_map):
    space, rng, dim = any_map.space, np.random.default_rng(11), any_map.dim
    found = 0
    for start, goal in space.sample_free(16, rng).reshape(8, 2, -1):
        path = planners.plan(space, start, goal, planner="Grid").waypoints
        if not len(path):
            continue
        found += 1
        assert space.certify_path(path).all()
        np.testing.assert_allclose(path[[0, -1]], [start, goal], atol=1e-9)
        metres = np.linalg.norm(np.diff(path[:, :dim], axis=0), axis=1).sum()
        assert space.min_path_length(start, goal) <= metres * (1.0 + 1e-9)
    assert found


@examples(3)
@given(seeds)
def test_a_path_joins_exactly_the_connected_configurations(any_map, seed):
    rng, space = np.random.default_rng(seed), any_map.space
    firsts, lasts = draw_free_pairs(any_map, rng)
    connected = space.is_connected(firsts, lasts)
    for first, last, is_connected in zip(firsts, lasts, connected, strict=True):
        for simplify in (True, False):
            # A plan refuses ends that another cell touches.
            with nullcontext() if is_connected else suppress(ConfigurationError):
                options = {"planner": planners.Search("Grid", simplify=simplify)}
                path = planners.plan(space, first, last, **options).waypoints
                assert (len(path) > 0) == is_connected
                assert not len(path) or space.certify_path(path).all()


def test_returned_yaws_lie_from_minus_pi_to_below_pi(any_map):
    space, rng = any_map.space, np.random.default_rng(17)
    if space.rotations.names != ("yaw",):
        return
    # Endpoints are turned further by whole turns.
    ends = space.sample_free(12, rng)
    ends[:, -1] += 2.0 * np.pi * rng.integers(-3, 4, 12)
    for q0, q1 in itertools.pairwise(ends):
        for simplify in (True, False):
            plan = planners.plan(space, q0, q1, planner=planners.Search("Grid", simplify=simplify))
            yaws = plan.waypoints[:, -1]
            assert (yaws >= -np.pi).all() and (yaws < np.pi).all()
