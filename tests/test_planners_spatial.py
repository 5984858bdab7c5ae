"""The pieces handed to OMPL, for maps of robots that translate in space."""

from __future__ import annotations

import gc
import itertools
import math
from typing import Any

import numpy as np
import pytest
from ompl import base as ob
from ompl import util as ou

import planners
from cspace import FREE, CSpace, InputError, Robot, Workspace, build
from planners.states import PLANE, SPACE, TURNING, kind_of
from planning import (
    room,
    spatial_room,
    turning_room,
)

START, GOAL = (0.5, 0.5, 0.4), (3.5, 1.4, 1.6)


@pytest.fixture(scope="module")
def space() -> CSpace:
    return spatial_room()


@pytest.fixture(scope="module")
def open_space() -> CSpace:
    """A map that is open to all sides."""
    return build(Workspace.from_array(np.zeros((9, 8, 7), dtype=bool), 1.0), Robot.ball(0.1), outside="free")


def state_at(si: Any, q: Any) -> Any:
    state = si.allocState()
    SPACE.write(state, [float(x) for x in q])
    return state


def configurations(space: CSpace, n: int, seed: int) -> np.ndarray:
    """Points anywhere in and around the map, and corners of its cells."""
    rng = np.random.default_rng(seed)
    lower, upper = np.array(space.grid.lower), np.array(space.grid.upper)
    corners = lower + space.grid.spacing * rng.integers(0, np.array(space.grid.shape) + 1, (n // 4, 3))
    return np.concatenate([rng.uniform(lower - 0.2, upper + 0.2, (n, 3)), corners])


# ---- the pieces handed to OMPL ---------------------------------------------------------------------------------------


def test_a_map_in_space_is_not_taken_for_one_that_turns(space: CSpace) -> None:
    turning = turning_room()
    assert space.dof == turning.dof == 3
    assert [kind_of(each) for each in (room(), space, turning)] == [PLANE, SPACE, TURNING]
    assert isinstance(planners.state_space(space), ob.RealVectorStateSpace)


def test_states_are_those_of_the_map(space: CSpace) -> None:
    setup = planners.simple_setup(space)
    si, checker = setup.getSpaceInformation(), setup.getStateValidityChecker()
    q = configurations(space, 1500, 0)
    states = [state_at(si, each) for each in q]
    assert [SPACE.read(state) for state in states] == [tuple(each) for each in q.tolist()]
    assert [si.isValid(state) for state in states] == space.is_free(q).tolist()
    assert 0.1 < space.is_free(q).mean() < 0.9
    assert [checker.clearance(state) for state in states] == space.clearance(q).tolist()
    bounds = setup.getStateSpace().getBounds()
    assert [bounds.low[axis] for axis in range(3)] == list(space.grid.lower)
    assert [bounds.high[axis] for axis in range(3)] == list(space.grid.upper)
    si.setup()
    assert setup.getStateSpace().getLongestValidSegmentLength() == pytest.approx(space.grid.spacing / 2)


def test_motions_are_those_of_the_map(space: CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    rng = np.random.default_rng(1)
    a = space.sample_free(800, rng)
    b = a + rng.uniform(-1.0, 1.0, a.shape)
    asked = [si.checkMotion(state_at(si, p), state_at(si, q)) for p, q in zip(a, b, strict=True)]
    assert asked == space.motion_is_free(a, b).tolist()
    assert any(asked) and not all(asked)


@pytest.mark.parametrize("name", ["MotionValidator", "StateValidityChecker", "FreeStateSampler", "ClearanceObjective"])
def test_classes_made_for_another_kind_of_map_are_refused(space: CSpace, name: str) -> None:
    public = getattr(planners, name)
    maps = {"": room(), "Spatial": space, "Turning": turning_room()}
    infos = {prefix: planners.simple_setup(each).getSpaceInformation() for prefix, each in maps.items()}
    right = {prefix: type(public(infos[prefix], each)) for prefix, each in maps.items()}
    assert [kind.__name__ for kind in right.values()] == [prefix + name for prefix in maps]
    for (served, base), (asked, each) in itertools.product(right.items(), maps.items()):
        mine = type("Mine", (base,), {})
        if served == asked:
            assert type(mine(infos[asked], each)) is mine
            continue
        with pytest.raises(InputError, match=rf"Mine derives from {served}{name}, .*\.{asked}{name}$"):
            mine(infos[asked], each)


def test_samples_are_free_and_spread_over_the_free_volume(space: CSpace) -> None:
    si = planners.simple_setup(space, rng=np.random.default_rng(0)).getSpaceInformation()
    sampler, state, draws = si.allocValidStateSampler(), si.allocState(), []
    for _ in range(4000):
        assert sampler.sample(state) and si.isValid(state) and si.satisfiesBounds(state)
        draws.append(SPACE.read(state))
    for axis in range(3):
        half = space.grid.shape[axis] // 2
        share = (np.moveaxis(space.state, axis, 0)[:half] == FREE).sum() / (space.state == FREE).sum()
        low = np.mean(np.array(draws)[:, axis] < space.grid.lower[axis] + half * space.grid.spacing)
        assert low == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / len(draws)))


@pytest.mark.parametrize("near", [START, (1.4, 0.5, 0.5), (0.0, 0.0, 0.0), (3.9, 1.9, 1.9)])
@pytest.mark.parametrize("distance", [0.05, 0.4, 20.0])
def test_samples_near_a_state_are_free_and_near(space: CSpace, near: Any, distance: float) -> None:
    si = planners.simple_setup(space, rng=np.random.default_rng(1)).getSpaceInformation()
    sampler, state, centre = si.allocValidStateSampler(), state_at(si, (9.0, 9.0, 9.0)), state_at(si, near)
    found = []
    for _ in range(200):
        before = SPACE.read(state)
        if not sampler.sampleNear(state, centre, distance):
            assert SPACE.read(state) == before
            continue
        found.append(SPACE.read(state))
        assert si.isValid(state) and si.satisfiesBounds(state)
        assert np.abs(np.subtract(found[-1], near)).max() <= distance
    side = np.linspace(-distance, distance, 31)
    some = space.is_free(np.array(near) + np.stack(np.meshgrid(side, side, side), axis=-1)).any()
    assert (len(found) > 0) == some
    assert near != START or (np.ptp(found, axis=0) > min(distance, 1.0)).all()
    assert not sampler.sampleNear(state, state_at(si, (0.5, 0.5, 60.0)), 1.0)


def test_samples_near_a_state_stay_in_the_map_where_all_beyond_is_free(open_space: CSpace) -> None:
    si = planners.simple_setup(open_space).getSpaceInformation()
    sampler, state = si.allocValidStateSampler(), si.allocState()
    for _ in range(200):
        assert sampler.sampleNear(state, state_at(si, (0.5, 7.5, 0.5)), 2.0) and si.satisfiesBounds(state)


@pytest.mark.parametrize("reach", [0.4, 2.5])
def test_the_clearance_objective_is_an_integral_along_the_edge(space: CSpace, reach: float) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.ClearanceObjective(si, space, weight=6.0, comfort=0.4)
    rng = np.random.default_rng(2)
    starts = space.sample_free(40, rng)
    ends = starts + rng.uniform(-reach, reach, starts.shape)
    along = (np.arange(4000) + 0.5)[:, None, None] / 4000
    short = np.maximum(0.0, 1.0 - space.clearance(starts + along * (ends - starts)) / 0.4)
    lengths = np.linalg.norm(ends - starts, axis=-1)
    integral = lengths * (1.0 + 6.0 * (short**2).mean(axis=0))
    pairs = [(state_at(si, a), state_at(si, b)) for a, b in zip(starts, ends, strict=True)]
    costs = np.array([objective.motionCost(*pair).value() for pair in pairs])
    least = np.array([objective.motionCostHeuristic(*pair).value() for pair in pairs])
    np.testing.assert_allclose(least, lengths)
    np.testing.assert_allclose(costs, integral, rtol=0.05)
    np.testing.assert_allclose(costs, [objective.motionCost(b, a).value() for a, b in pairs], rtol=1e-9)
    assert (costs >= lengths * (1 - 1e-12)).all() and (costs > 1.5 * lengths).any()
    for q in starts:
        expected = 1.0 + 6.0 * max(0.0, 1.0 - space.clearance(q) / 0.4) ** 2
        assert objective.stateCost(state_at(si, q)).value() == pytest.approx(expected)
    assert objective.motionCost(pairs[0][0], pairs[0][0]).value() == 0.0


def test_nothing_of_ours_outlives_its_setup(space: CSpace) -> None:
    def count() -> int:
        gc.collect()
        ours = (planners.MotionValidator, planners.StateValidityChecker, planners.FreeStateSampler)
        return sum(isinstance(thing, (*ours, planners.ClearanceObjective)) for thing in gc.get_objects())

    before = count()
    for _ in range(5):
        setup = planners.simple_setup(space, objective=lambda si: planners.ClearanceObjective(si, space))
        sampler = setup.getSpaceInformation().allocValidStateSampler()
        assert count() > before
        del setup, sampler
    assert count() == before


def test_curves_are_refused_by_every_piece(space: CSpace) -> None:
    curve: dict[str, Any] = {"curve": "dubins", "turning_radius": 1.0}
    si = planners.simple_setup(space).getSpaceInformation()
    for make in (
        lambda: planners.state_space(space, **curve),
        lambda: planners.simple_setup(space, **curve),
        lambda: planners.MotionValidator(si, space, **curve),
        lambda: planners.ClearanceObjective(si, space, **curve),
    ):
        with pytest.raises(InputError, match=r"no rotations.*leave the curve out"):
            make()


def test_a_generator_and_ompls_seed_make_samples_repeatable(space: CSpace) -> None:
    def draws(**options: Any) -> list[tuple[float, ...]]:
        si = planners.simple_setup(space, **options).getSpaceInformation()
        sampler, state, centre, out = si.allocValidStateSampler(), si.allocState(), state_at(si, START), []
        for _ in range(300):
            sampler.sample(state)
            out.append(SPACE.read(state))
            sampler.sampleNear(state, centre, 0.5)
            out.append(SPACE.read(state))
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
