"""Checkers of single points and edges, for callbacks of planners."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import FREE, MIXED
from cspace._rotations.base import MAX_ANGLE
from tests.helpers import handmade
from tests.helpers.handmade import outsides
from tests.helpers.placements import draw_configurations
from tests.helpers.strategies import examples, seeds


@examples(40)
@given(seeds, st.sampled_from(handmade.MAP_KINDS), outsides(3))
def test_checkers_agree_with_queries_everywhere(seed, kind, outside):
    rng = np.random.default_rng(seed)
    states = handmade.random_states(rng, kind)
    dim = states.ndim - 1
    outside = outside.project(dim)
    space = handmade.make_map(states, kind, outside, 0.1, lower=(-1.0, 0.0, 0.3)[:dim])
    q0 = draw_configurations(space, rng, 200, far=True)
    q1 = draw_configurations(space, rng, 200, far=True)
    nudged = rng.integers(0, 200, 20)
    beside = np.nextafter(space.grid.upper, rng.choice([-9.0, 9.0], (20, dim)))
    q0[nudged, :dim] = beside
    point, edge = space.point_checker(), space.edge_checker()
    assert [point(*q) for q in q0.tolist()] == space.is_free(q0).tolist()
    assert [edge(*both) for both in np.hstack([q0, q1]).tolist()] == space.motion_is_free(
        q0, q1
    ).tolist()


@pytest.mark.parametrize("kind", handmade.MAP_KINDS)
@pytest.mark.parametrize("exact", [False, True])
def test_checkers_return_false_for_invalid_configurations(kind, exact):
    # FREE cells prove the configuration. In MIXED cells the exact geometry does, because there are
    # no obstacles.
    space = handmade.make_map(handmade.full_states(kind, 4, MIXED if exact else FREE), kind)
    dim, point, edge = (
        space.grid.dim,
        (space.exact if exact else space).point_checker(),
        (space.exact if exact else space).edge_checker(),
    )
    both = handmade.configurations(space, np.full((2, space.size), 0.3)).ravel().tolist()
    assert point(*both[: space.size]) and edge(*both)
    wrong = [(hole, np.nan) for hole in range(len(both))]
    wrong += [
        (hole, far)
        for hole in range(len(both))
        if hole % space.size >= dim
        for far in (np.inf, 2.0 * MAX_ANGLE)
    ]
    for hole, number in wrong:
        bad = [*both[:hole], number, *both[hole + 1 :]]
        assert not edge(*bad)
        assert hole >= space.size or not point(*bad[: space.size])
