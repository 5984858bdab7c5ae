"""Samplers: free, evenly spread, near and repeatable samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ompl import util as ou

import planners
from planners._ompl.states import find_state_kind
from tests.helpers.planning import (
    SPACES,
    build_open_map,
    build_room,
    make_state,
    sample_edges,
)
from tests.helpers.strategies import examples, seeds


def draw_samples(space, n, **options):
    """Draw samples of a setup's sampler, shape (n, size)."""
    si = planners.simple_setup(space, **options).getSpaceInformation()
    sampler, state = si.allocValidStateSampler(), si.allocState()
    read = find_state_kind(space).read
    rows = []
    for _ in range(n):
        assert sampler.sample(state) and si.isValid(state) and si.satisfiesBounds(state)
        rows.append(read(state))
    return np.array(rows)


@pytest.mark.parametrize("name", SPACES)
def test_free_samples_repeat_with_a_generator_or_ompls_seed(name):
    space = build_room(name)
    by_rng = [draw_samples(space, 300, rng=np.random.default_rng(k)) for k in (7, 7, 8)]
    ou.setLogLevel(ou.LOG_NONE)
    by_seed = []
    for seed in (7, 7, 8):
        ou.RNG.setSeed(seed)
        by_seed.append(draw_samples(space, 300))
    ou.setLogLevel(ou.LOG_WARN)
    for first, again, other in (by_rng, by_seed):
        assert np.array_equal(first, again) and not np.array_equal(first, other)


@examples(20)
@given(seeds, st.sampled_from(SPACES), st.sampled_from([0.05, 0.4, 20.0]), st.booleans())
def test_samples_near_a_state_are_free_and_near(seed, name, distance, is_open):
    space = build_open_map(name) if is_open else build_room(name)
    dim = space.grid.dim
    rng = np.random.default_rng(seed)
    near = space.sample_free(rng=rng)
    si = planners.simple_setup(space, rng=rng).getSpaceInformation()
    sampler = si.allocValidStateSampler()
    state, center = make_state(space, si, near), make_state(space, si, near)
    points = [near]
    for _ in range(100):
        if sampler.sampleNear(state, center, distance):
            points.append(find_state_kind(space).read(state))
            assert si.isValid(state) and si.satisfiesBounds(state)
    gaps = np.abs(np.array(points) - near)[:, :dim]
    turns = sample_edges(space, np.tile(near, (len(points), 1)), np.array(points), np.zeros(1))[1]
    assert (gaps <= distance).all() and (turns <= distance + 1e-7).all()
    if is_open:
        assert len(points) == 101 and (gaps.max(axis=0) > 0.4 * min(distance, 4.0)).all()
        assert turns.max() > 0.4 * min(distance, 1.0) or space.size == dim
    far = make_state(space, si, [*[0.5] * (dim - 1), 60.0, *near[dim:]])
    assert not sampler.sampleNear(state, far, 1.0)
