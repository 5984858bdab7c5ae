"""Samplers: free, evenly spread, near and repeatable samples."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ompl import util as ou

import planners
from cspace import MIXED, Arm, ConfigurationError, CSpace, InputError, Robot, build_arm_space
from planners.states import find_state_kind
from tests.helpers.planning import (
    SPACES,
    build_from_states,
    build_open_map,
    build_room,
    make_state,
    sample_edges,
)
from tests.helpers.strategies import seeds
from tests.helpers.urdfs import planar


def draw_samples(space: CSpace, n: int, **options: Any) -> np.ndarray:
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
def test_samples_are_free_and_spread_over_the_free_cells(name: str) -> None:
    space = build_room(name)
    grid = space.grid
    draws = draw_samples(space, 3000, rng=np.random.default_rng(0))
    states = np.asarray(space.cell_states).reshape(-1, *grid.shape)
    volumes = space.rotations.volumes / space.rotations.volumes.sum()
    weights = np.tensordot(volumes, (states == 0).astype(float), 1)
    for axis in range(grid.dim):
        middle = grid.shape[axis] // 2
        share = np.take(weights, range(middle), axis).sum() / weights.sum()
        error = 4 * math.sqrt(share * (1 - share) / len(draws))
        lower_half = draws[:, axis] < grid.lower[axis] + grid.spacing * middle
        assert lower_half.mean() == pytest.approx(share, abs=error)
    if "yaw" in space.axes:
        counts, _ = np.histogram(draws[:, grid.dim], bins=12, range=(-math.pi, math.pi))
        assert counts.min() > 100


@settings(max_examples=30)
@given(seeds, st.sampled_from(SPACES), st.sampled_from([0.05, 0.4, 20.0]), st.booleans())
def test_samples_near_a_state_are_free_and_near(
    seed: int, name: str, distance: float, is_open: bool
) -> None:
    space = build_open_map(name) if is_open else build_room(name)
    dim = space.grid.dim
    rng = np.random.default_rng(seed)
    si = planners.simple_setup(space, rng=rng).getSpaceInformation()
    read = find_state_kind(space).read
    near = space.sample_free(rng=rng)
    state, center = make_state(space, si, near), make_state(space, si, near)
    sampler = si.allocValidStateSampler()
    drawn = []
    for _ in range(100):
        before = read(state)
        if sampler.sampleNear(state, center, distance):
            drawn.append(read(state))
            assert si.isValid(state) and si.satisfiesBounds(state)
        else:
            assert read(state) == before
    points = np.array(drawn).reshape(-1, space.size)
    assert (np.abs(points - near)[:, :dim] <= distance).all()
    turns = sample_edges(space, np.tile(near, (len(points), 1)), points, np.zeros(1))[1]
    assert (turns <= distance + 1e-7).all() and (len(points) > 50 or not is_open)
    if is_open:
        assert (np.ptp(points, axis=0)[:dim] > 0.4 * min(distance, 6.0)).all()
        assert turns.max() > 0.4 * min(distance, 1.0) or space.size == dim
    far = make_state(space, si, [*[0.5] * (dim - 1), 60.0, *near[dim:]])
    assert not sampler.sampleNear(state, far, 1.0)


def test_samples_repeat_with_a_generator_or_ompls_seed() -> None:
    space = build_room("yawing")
    by_rng = [draw_samples(space, 300, rng=np.random.default_rng(k)) for k in (7, 7, 8)]
    ou.setLogLevel(ou.LOG_NONE)
    by_seed = []
    for seed in (7, 7, 8):
        ou.RNG.setSeed(seed)
        by_seed.append(draw_samples(space, 300))
    ou.setLogLevel(ou.LOG_WARN)
    for first, again, other in (by_rng, by_seed):
        assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_spaces_without_free_cells_are_refused(tmp_path: Path) -> None:
    shut = build_from_states(np.full((3, 3), MIXED, dtype=np.uint8))
    si = planners.simple_setup(shut).getSpaceInformation()
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        si.allocValidStateSampler().sample(si.allocState())
    box = Robot.box((0.2, 0.2, 0.2), (1.5, 1.0, 0.0)).shape
    arm = build_arm_space({"box": box}, Arm.from_urdf(planar(tmp_path)))
    si = planners.simple_setup(arm).getSpaceInformation()
    with pytest.raises(InputError, match=r"is a ArmSpace; it must be a CSpace; .*Uniform"):
        planners.FreeStateSampler(si, arm)
