"""Samplers: free, evenly spread, near and repeatable samples."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ompl import util as ou

import planners
from cspace import MIXED, Arm, ConfigurationError, CSpace, InputError, Robot, build_arm_space
from planners.states import find_state_kind
from tests.helpers.planning import (
    ENDPOINTS,
    SPACES,
    build_from_states,
    build_open_map,
    build_room,
    make_state,
    sample_edges,
)
from tests.helpers.urdfs import planar

SAMPLING_CENTERS = {
    "plane": [ENDPOINTS["plane"][0], (0.0, 3.0), (3.1, 2.0), (9.9, 5.9)],
    "turning": [ENDPOINTS["turning"][0], (3.0, 2.0, 3.1), (0.4, 0.4, -3.1)],
    "yawing": [ENDPOINTS["yawing"][0], (1.4, 1.2, 0.5, -3.1)],
    "floating": [ENDPOINTS["floating"][0], (1.2, 1.3, 0.5, 0.5, -0.5, 0.5, -0.5)],
    "space": [ENDPOINTS["space"][0], (1.4, 0.5, 0.5), (0.0, 0.0, 0.0), (3.9, 1.9, 1.9)],
}


@pytest.fixture(params=SPACES)
def space(request: pytest.FixtureRequest) -> CSpace:
    return build_room(request.param)


def test_samples_are_free_and_spread_over_the_free_cells(space: CSpace) -> None:
    si = planners.simple_setup(space, rng=np.random.default_rng(0)).getSpaceInformation()
    sampler, state, read, drawn = (
        si.allocValidStateSampler(),
        si.allocState(),
        find_state_kind(space).read,
        [],
    )
    for _ in range(3000):
        assert sampler.sample(state) and si.isValid(state) and si.satisfiesBounds(state)
        drawn.append(read(state))
    draws, dim = np.array(drawn), space.grid.dim
    centers = np.stack(
        np.meshgrid(*(space.grid.centers(axis) for axis in range(dim)), indexing="ij"), axis=-1
    )
    turns, shares = (
        space.rotations.centers.tolist(),
        space.rotations.volumes / space.rotations.volumes.sum(),
    )
    free = [space.is_free(_with(centers, turn)) for turn in turns]
    weights = np.tensordot(shares, np.array(free, dtype=float), 1)
    for axis in range(dim):
        half = space.grid.lower[axis] + space.grid.spacing * (space.grid.shape[axis] // 2)
        share = np.average(centers[..., axis] < half, weights=weights)
        error = 4 * math.sqrt(share * (1 - share) / len(draws))
        assert (draws[:, axis] < half).mean() == pytest.approx(share, abs=error)
    if "yaw" in space.axes:
        assert np.histogram(draws[:, dim], bins=12, range=(-math.pi, math.pi))[0].min() > 100


def _turn(space: CSpace) -> list[float]:
    return space.rotations.centers[0].tolist()


def _with(points: np.ndarray, turn: Sequence[float]) -> np.ndarray:
    return np.concatenate([points, np.broadcast_to(turn, (*points.shape[:-1], len(turn)))], axis=-1)


@pytest.mark.parametrize(
    ("name", "near"), [(name, near) for name in SPACES for near in SAMPLING_CENTERS[name]]
)
@pytest.mark.parametrize("distance", [0.05, 0.4, 20.0])
def test_samples_near_a_state_are_free_and_near(name: str, near: Any, distance: float) -> None:
    space, dim = build_room(name), build_room(name).grid.dim
    si, read = (
        planners.simple_setup(space, rng=np.random.default_rng(1)).getSpaceInformation(),
        find_state_kind(space).read,
    )
    state, centre = make_state(space, si, [9.0] * dim + _turn(space)), make_state(space, si, near)
    sampler, drawn = si.allocValidStateSampler(), []
    for _ in range(200):
        before = read(state)
        if not sampler.sampleNear(state, centre, distance):
            assert read(state) == before
            continue
        drawn.append(read(state))
        assert si.isValid(state) and si.satisfiesBounds(state)
        assert np.abs(np.subtract(drawn[-1], near)[:dim]).max() <= distance
    side = np.linspace(-distance, distance, 31)
    around = np.stack(np.meshgrid(*[side] * dim), axis=-1)
    assert len(drawn) > 0 or space.size > dim or not space.is_free(np.array(near) + around).any()
    points = np.array(drawn).reshape(-1, space.size)
    turned = sample_edges(space, np.tile(near, (len(points), 1)), points, np.zeros(1))[1]
    assert (turned <= distance + 1e-7).all()
    if near == ENDPOINTS[name][0]:
        assert len(drawn) > 100 and (np.ptp(drawn, axis=0)[:dim] > 0.8 * min(distance, 0.7)).all()
        assert turned.max() > 0.4 * min(distance, 0.7) or not space.rotations.names
    far = make_state(space, si, [0.5] * (dim - 1) + [60.0] + _turn(space))
    assert not sampler.sampleNear(state, far, 1.0)


def test_samples_near_a_state_stay_in_a_map_with_free_exterior() -> None:
    for name in SPACES:
        space = build_open_map(name)
        si = planners.simple_setup(space).getSpaceInformation()
        sampler, state = si.allocValidStateSampler(), si.allocState()
        corner = make_state(space, si, [0.5] * space.grid.dim + _turn(space))
        for _ in range(100):
            assert sampler.sampleNear(state, corner, 2.0) and si.satisfiesBounds(state)


def test_samples_repeat_with_a_generator_or_ompls_seed(space: CSpace) -> None:
    def draws(**options: Any) -> list[tuple[float, ...]]:
        si = planners.simple_setup(space, **options).getSpaceInformation()
        sampler, state, read, out = (
            si.allocValidStateSampler(),
            si.allocState(),
            find_state_kind(space).read,
            [],
        )
        centre = make_state(space, si, space.sample_free(rng=np.random.default_rng(0)))
        for _ in range(300):
            sampler.sample(state)
            out.append(read(state))
            sampler.sampleNear(state, centre, 0.5)
            out.append(read(state))
        return out

    first, again, other = (draws(rng=np.random.default_rng(seed)) for seed in (7, 7, 8))
    assert first == again != other
    ou.setLogLevel(ou.LOG_NONE)
    outcomes = []
    for seed in (7, 7, 8):
        ou.RNG.setSeed(seed)
        outcomes.append(draws())
    ou.setLogLevel(ou.LOG_WARN)
    assert outcomes[0] == outcomes[1] != outcomes[2]


def test_a_map_without_free_cells_has_no_samples() -> None:
    si = planners.simple_setup(
        build_from_states(np.full((3, 3), MIXED, dtype=np.uint8))
    ).getSpaceInformation()
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        si.allocValidStateSampler().sample(si.allocState())


def test_the_sampler_of_maps_refuses_the_space_of_an_arm(tmp_path: Path) -> None:
    space = build_arm_space(
        {"box": Robot.box((0.2, 0.2, 0.2), (1.5, 1.0, 0.0)).shape}, Arm.from_urdf(planar(tmp_path))
    )
    with pytest.raises(
        InputError, match=r"space is a ArmSpace; it must be a CSpace; use ompl.base.Uniform"
    ):
        planners.FreeStateSampler(planners.simple_setup(space).getSpaceInformation(), space)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [3, "seed", np.random.RandomState(0)])
def test_an_rng_of_another_type_is_refused(wrong: Any) -> None:
    space = build_room("plane")
    with pytest.raises(InputError, match="numpy"):
        planners.simple_setup(space, rng=wrong)
    with pytest.raises(InputError, match="numpy"):
        planners.FreeStateSampler(planners.simple_setup(space).getSpaceInformation(), space, wrong)
