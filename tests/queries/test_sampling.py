"""Uniform samples of FREE cells, and the nearest FREE configuration."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED, Robot, Workspace
from cspace._rotations import Rotations
from cspace._rotations.base import TWO_PI
from tests.helpers import handmade
from tests.helpers.strategies import examples, rotation_cells, seeds

BORDERS = [-1.0, -0.8, 0.5, 0.6, 3.0, TWO_PI - 1]


@pytest.fixture(scope="module", params=[*handmade.MAP_KINDS, "shared"])
def space(request):
    """Build a random map, possibly with unequal rotation cells."""
    rng = np.random.default_rng(3)
    if request.param == "shared":
        workspace = Workspace.from_array(np.zeros((5, 4), bool), 0.3, (-4.0, 7.0))
        states = rng.integers(0, 3, (3, 5, 4)).astype(np.uint8)
        return handmade.map_in(workspace, Robot.rectangle(1e-6, 1e-7), states, 6, outside="free")
    shape = (5, 4, 6) if "space" in request.param else (12, 30)
    shape = (
        (108, 2, 3, 2)
        if "any way" in request.param
        else (5 if "turning" in request.param else 1, *shape)
    )
    states = rng.integers(0, 3, shape)
    return handmade.make_map(states, request.param, spacing=0.3, rotations=BORDERS)


def test_samples_are_uniform_over_the_free_volume(space):
    """Test chi-squared at six standard deviations."""
    n, dim = 200_000, space.grid.dim
    samples = space.sample_free(n, np.random.default_rng(1))
    assert space.is_free(samples).all()
    positions = space.grid.cell_of(samples[:, :dim])
    within = (samples[:, :dim] - space.grid.lower) / space.grid.spacing - positions
    rotation, widths = space.rotations._find_cells(samples), space.rotations._volumes
    if len(space.rotations.names) == 1:
        above = samples[:, dim] - np.asarray(space.rotations.borders)[rotation]
        within = np.column_stack(
            [within, (above - TWO_PI * np.floor(above / TWO_PI)) / widths[rotation]]
        )
    states = space.cell_states.reshape(len(widths), *space.grid.shape)
    parts = 2 ** within.shape[1]
    part = (within >= 0.5) @ (2 ** np.arange(within.shape[1]))
    cell = np.ravel_multi_index((rotation, *positions.T), states.shape)
    bins = np.bincount(cell * parts + part, minlength=states.size * parts)
    volume = np.where(states == FREE, widths.reshape(-1, *[1] * dim), 0.0).ravel()
    free = np.repeat(volume > 0, parts)
    assert not bins[~free].any()
    expected, freedom = n * np.repeat(volume / volume.sum() / parts, parts)[free], free.sum() - 1
    statistic = (np.square(bins[free] - expected) / expected).sum()
    assert abs(statistic - freedom) < 6 * np.sqrt(2 * freedom)


@examples(60)
@given(
    seeds,
    st.sampled_from(handmade.MAP_KINDS),
    rotation_cells(8),
    st.sampled_from([0.1, 0.5, 2.0]),
    st.booleans(),
)
def test_nearest_free_returns_the_nearest_cell(seed, kind, rotations, spacing, dense):
    """Compare with all FREE cells, from inside and outside."""
    rng = np.random.default_rng(seed)
    states = handmade.random_states(
        rng, kind, 9, (FREE, BLOCKED) if dense else (MIXED,) * 30 + (FREE,)
    )
    if "turning" in kind and "any way" not in kind:
        states = np.resize(states, (len(Rotations.of(rotations)), *states.shape[1:]))
    states[tuple(rng.integers(0, states.shape))] = FREE
    space = handmade.make_map(states, kind, spacing=spacing, rotations=rotations)
    free, dim = handmade.cell_centers(space, np.argwhere(states == FREE)), space.grid.dim
    for one in rng.uniform(-0.5, 1.5, (8, dim)) * states.shape[1:] * spacing:
        q = handmade.configurations(space, np.array([*one, *rng.uniform(-9, 9, space.size - dim)]))
        nearest = space.nearest_free(q)
        assert (np.abs(free - nearest) < 1e-12).all(axis=1).any()

        def distance(to, q=q):
            angle = np.abs((to[..., dim:] - q[dim:] + math.pi) % TWO_PI - math.pi).sum(axis=-1)
            if len(space.rotations.names) == 4:
                angle = 2.0 * np.arccos(np.minimum(np.abs(to[..., dim:] @ q[dim:]), 1.0))
            return np.linalg.norm(to[..., :dim] - q[:dim], axis=-1) + angle / 2

        assert distance(nearest) == pytest.approx(distance(free).min())
