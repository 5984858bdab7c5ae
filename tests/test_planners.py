"""The pieces handed to OMPL answer as the map does, and OMPL's traps are kept shut."""

from __future__ import annotations

import gc
import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

import planners
from cspace import ConfigurationError, CSpace, InputError, Robot, Workspace, build
from planners.registry import find_planner

SPACING = 0.1


@pytest.fixture(scope="module")
def space() -> CSpace:
    """A room of 6 m by 4 m off the origin, with a wall of one cell and a block, for a disc of 0.15 m."""
    occupied = np.zeros((60, 40), dtype=bool)
    occupied[25, :30] = True
    occupied[42:48, 10:20] = True
    return build(Workspace.from_array(occupied, SPACING, lower=(-1.0, 2.0)), Robot.disc(0.15))


@pytest.fixture(scope="module")
def full() -> CSpace:
    return build(Workspace.from_array(np.ones((5, 4), dtype=bool), SPACING), Robot.disc(0.15))


def points_around(space: CSpace, n: int) -> np.ndarray:
    """Random points in and around the map, and all corners of its cells."""
    lower, upper = np.array(space.grid.lower), np.array(space.grid.upper)
    random = np.random.default_rng(3).uniform(lower - 0.5, upper + 0.5, (n, 2))
    i, j = np.indices(np.array(space.grid.shape) + 1)
    return np.concatenate([random, lower + SPACING * np.stack([i.ravel(), j.ravel()], axis=-1)])


def state_at(si: Any, point: Any) -> Any:
    state = si.allocState()
    state[0], state[1] = map(float, point)
    return state


# ---- states and motions ----------------------------------------------------------------------------------------------


def test_valid_means_free(space: CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    points = points_around(space, 2000)
    assert [si.isValid(state_at(si, q)) for q in points] == space.is_free(points).tolist()
    assert 0.2 < space.is_free(points).mean() < 0.8


def test_the_checkers_clearance_is_the_maps(space: CSpace) -> None:
    setup = planners.simple_setup(space)
    si = setup.getSpaceInformation()
    checker = setup.getStateValidityChecker()
    points = points_around(space, 300)
    assert [checker.clearance(state_at(si, q)) for q in points] == space.clearance(points).tolist()


def test_a_motion_is_valid_where_the_map_proves_it(space: CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    points = points_around(space, 1500)
    starts, ends = points[:-1], points[1:]
    proven = space.motion_is_free(starts, ends)
    asked = [si.checkMotion(state_at(si, a), state_at(si, b)) for a, b in zip(starts, ends, strict=True)]
    assert asked == proven.tolist()
    assert proven.any() and not proven.all()


def test_a_motion_called_valid_is_free_all_along(space: CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    rng = np.random.default_rng(5)
    free = space.sample_free(400, rng)
    along = np.linspace(0.0, 1.0, 301)[:, None]
    kinds = set()
    for a, b in zip(free[::2], free[1::2], strict=True):
        valid = si.checkMotion(state_at(si, a), state_at(si, b))
        everywhere = bool(space.is_free(a + along * (b - a)).all())
        assert everywhere or not valid
        kinds.add(valid)
    assert kinds == {True, False}


def test_a_thin_wall_is_not_stepped_over_where_ompl_by_itself_does() -> None:
    occupied = np.zeros((400, 8), dtype=bool)
    occupied[200] = True
    thin = build(Workspace.from_array(occupied, 0.1), Robot.disc(0.01))
    setup = planners.simple_setup(thin)
    si = setup.getSpaceInformation()
    bare = ob.SpaceInformation(planners.state_space(thin))
    bare.setStateValidityChecker(planners.StateValidityChecker(bare, thin))
    bare.setup()
    crossings = [((20.05 - a, 0.4), (20.05 + b, 0.4)) for a in np.arange(0.3, 2, 0.13) for b in np.arange(0.3, 2, 0.13)]
    assert any(bare.checkMotion(state_at(bare, a), state_at(bare, b)) for a, b in crossings)
    assert not any(si.checkMotion(state_at(si, a), state_at(si, b)) for a, b in crossings)


def test_the_state_space_is_the_grids_box(space: CSpace) -> None:
    states = planners.state_space(space)
    bounds = states.getBounds()
    assert states.getDimension() == 2
    assert [bounds.low[axis] for axis in range(2)] == list(space.grid.lower)
    assert [bounds.high[axis] for axis in range(2)] == list(space.grid.upper)


def test_ompls_own_steps_are_half_a_cell(space: CSpace) -> None:
    setup = planners.simple_setup(space)
    setup.getSpaceInformation().setup()
    assert setup.getStateSpace().getLongestValidSegmentLength() == pytest.approx(SPACING / 2)


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


# ---- samples ---------------------------------------------------------------------------------------------------------


def test_samples_are_free_and_spread_over_the_free_area(space: CSpace) -> None:
    si = planners.simple_setup(space, rng=np.random.default_rng(0)).getSpaceInformation()
    sampler, state, draws = si.allocValidStateSampler(), si.allocState(), []
    for _ in range(4000):
        assert sampler.sample(state) and si.isValid(state)
        draws.append((state[0], state[1]))
    share = (space.state[:25] == 0).sum() / (space.state == 0).sum()
    left = np.mean(np.array(draws)[:, 0] < space.grid.lower[0] + 25 * SPACING)
    assert left == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / len(draws)))


@pytest.mark.parametrize("near", [(0.0, 3.0), (1.5, 2.9), (-1.0, 2.0), (4.9, 5.9)])
@pytest.mark.parametrize("distance", [0.05, 0.3, 20.0])
def test_samples_near_a_state_are_free_and_near(space: CSpace, near: tuple[float, float], distance: float) -> None:
    si = planners.simple_setup(space, rng=np.random.default_rng(1)).getSpaceInformation()
    sampler, state = si.allocValidStateSampler(), state_at(si, (9.0, 9.0))
    centre, found = state_at(si, near), 0
    for _ in range(200):
        before = state[0], state[1]
        if sampler.sampleNear(state, centre, distance):
            found += 1
            assert si.isValid(state) and si.satisfiesBounds(state)
            assert max(abs(state[0] - near[0]), abs(state[1] - near[1])) <= distance
        else:
            assert (state[0], state[1]) == before
    box = np.linspace(-distance, distance, 41)
    some = space.is_free(np.array(near) + np.stack(np.meshgrid(box, box), axis=-1)).any()
    assert (found > 0) == some


def test_no_sample_lies_near_what_is_far_outside(space: CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    state = state_at(si, (0.0, 3.0))
    assert not si.allocValidStateSampler().sampleNear(state, state_at(si, (50.0, 3.0)), 1.0)


def test_samples_near_a_state_stay_in_the_map_where_all_beyond_is_free() -> None:
    space = build(Workspace.from_array(np.zeros((9, 9), dtype=bool), 1.0), Robot.disc(0.1), outside="free")
    si = planners.simple_setup(space).getSpaceInformation()
    sampler, state = si.allocValidStateSampler(), si.allocState()
    for _ in range(200):
        assert sampler.sampleNear(state, state_at(si, (0.5, 8.5)), 2.0) and si.satisfiesBounds(state)
    assert not sampler.sampleNear(state, state_at(si, (20.0, 4.0)), 2.0)


def draws(space: CSpace, **options: Any) -> list[float]:
    si = planners.simple_setup(space, **options).getSpaceInformation()
    sampler, state, centre, out = si.allocValidStateSampler(), si.allocState(), state_at(si, (0.0, 3.0)), []
    for _ in range(300):
        sampler.sample(state)
        out += [state[0], state[1]]
        sampler.sampleNear(state, centre, 0.5)
        out += [state[0], state[1]]
    return out


def test_a_generator_makes_samples_repeatable(space: CSpace) -> None:
    first, again, other = (draws(space, rng=np.random.default_rng(seed)) for seed in (7, 7, 8))
    assert first == again != other


def test_ompls_seed_makes_samples_repeatable(space: CSpace) -> None:
    ou.setLogLevel(ou.LOG_NONE)
    outcomes = []
    for seed in (7, 7, 8):
        ou.RNG.setSeed(seed)
        outcomes.append(draws(space))
    ou.setLogLevel(ou.LOG_WARN)
    assert outcomes[0] == outcomes[1] != outcomes[2]


def test_a_map_without_free_cells_has_no_samples(full: CSpace) -> None:
    si = planners.simple_setup(full).getSpaceInformation()
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        si.allocValidStateSampler().sample(si.allocState())


@pytest.mark.parametrize("wrong", [3, "seed", np.random.RandomState(0)])
def test_an_rng_of_another_type_is_refused(space: CSpace, wrong: Any) -> None:
    with pytest.raises(InputError, match="numpy"):
        planners.simple_setup(space, rng=wrong)
    with pytest.raises(InputError, match="numpy"):
        planners.FreeStateSampler(planners.simple_setup(space).getSpaceInformation(), space, wrong)


def test_the_sampler_that_needs_the_last_valid_state_is_refused(space: CSpace) -> None:
    for make in (ob.ObstacleBasedValidStateSampler, lambda si: ob.ObstacleBasedValidStateSampler(si)):
        with pytest.raises(InputError, match=r"ObstacleBasedValidStateSampler.*last valid state.*leave it out"):
            planners.simple_setup(space, valid_state_sampler=make)


def test_another_sampler_may_be_given(space: CSpace) -> None:
    si = planners.simple_setup(space, valid_state_sampler=ob.UniformValidStateSampler).getSpaceInformation()
    sampler, state = si.allocValidStateSampler(), si.allocState()
    assert isinstance(sampler, ob.UniformValidStateSampler)
    assert all(sampler.sample(state) and si.isValid(state) for _ in range(50))


def test_what_is_no_sampler_or_objective_is_refused(space: CSpace) -> None:
    with pytest.raises(InputError, match=r"must return an ompl.base.ValidStateSampler"):
        planners.simple_setup(space, valid_state_sampler=lambda si: 3)
    with pytest.raises(InputError, match=r"must return an ompl.base.OptimizationObjective"):
        planners.simple_setup(space, objective=lambda si: 3)
    with pytest.raises(InputError, match="both given"):
        planners.simple_setup(
            space, rng=np.random.default_rng(0), valid_state_sampler=lambda si: ob.UniformValidStateSampler(si)
        )


# ---- objective -------------------------------------------------------------------------------------------------------


def costs(space: CSpace, starts: np.ndarray, ends: np.ndarray, **options: Any) -> np.ndarray:
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.ClearanceObjective(si, space, **options)
    pairs = zip(starts, ends, strict=True)
    return np.array([objective.motionCost(state_at(si, a), state_at(si, b)).value() for a, b in pairs])


@pytest.mark.parametrize("reach", [0.5, 5.0])
def test_the_cost_of_an_edge_is_the_integral_along_it(space: CSpace, reach: float) -> None:
    starts = space.sample_free(40, np.random.default_rng(2))
    ends = starts + np.random.default_rng(3).uniform(-reach, reach, starts.shape)
    along = (np.arange(4000) + 0.5)[:, None, None] / 4000
    short = np.maximum(0.0, 1.0 - space.clearance(starts + along * (ends - starts)) / 0.4)
    lengths = np.linalg.norm(ends - starts, axis=-1)
    integral = lengths * (1.0 + 6.0 * (short**2).mean(axis=0))
    found = costs(space, starts, ends, weight=6.0, comfort=0.4)
    assert (found >= lengths * (1 - 1e-12)).all() and (found > 1.5 * lengths).any()
    np.testing.assert_allclose(found, integral, rtol=0.03)


def test_the_cost_is_the_same_both_ways_and_no_weight_leaves_the_length(space: CSpace) -> None:
    starts, ends = space.sample_free(50, np.random.default_rng(4)), space.sample_free(50, np.random.default_rng(5))
    np.testing.assert_allclose(costs(space, starts, ends), costs(space, ends, starts), rtol=1e-9)
    np.testing.assert_allclose(costs(space, starts, ends, weight=0), np.linalg.norm(ends - starts, axis=-1))
    assert costs(space, starts, starts).tolist() == [0.0] * 50


def test_the_cost_of_a_state_is_the_cost_of_a_metre_there(space: CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.ClearanceObjective(si, space, weight=3.0, comfort=0.5)
    for q in space.sample_free(50, np.random.default_rng(6)):
        expected = 1.0 + 3.0 * max(0.0, 1.0 - space.clearance(q) / 0.5) ** 2
        assert objective.stateCost(state_at(si, q)).value() == pytest.approx(expected)
        assert objective.motionCostHeuristic(state_at(si, q), state_at(si, (0.0, 3.0))).value() == pytest.approx(
            math.dist(q, (0.0, 3.0))
        )


@pytest.mark.parametrize(
    "options", [{"weight": -1.0}, {"weight": math.nan}, {"weight": [1.0]}, {"comfort": 0.0}, {"comfort": math.inf}]
)
def test_wrong_weights_are_refused(space: CSpace, options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(options))):
        planners.ClearanceObjective(planners.simple_setup(space).getSpaceInformation(), space, **options)


# ---- names, and OMPL itself ------------------------------------------------------------------------------------------


def test_every_geometric_planner_that_can_be_made_is_listed(space: CSpace) -> None:
    setup, made = planners.simple_setup(space), set()
    for name in dir(og):
        try:
            thing = getattr(og, name)(setup.getSpaceInformation())
        except TypeError:
            continue
        if isinstance(thing, ob.Planner):
            made.add(name)
            thing.setProblemDefinition(setup.getProblemDefinition())
            thing.setup()  # an AORRTC that was never set up crashes the process when it is freed
    assert set(planners.planner_names()) == made
    assert len(made) >= 14 and {"RRTConnect", "PRMstar", "BITstar", "KPIECE1", "AORRTC"} <= made


@pytest.mark.parametrize("name", planners.planner_names())
def test_names_may_be_written_in_any_case(name: str) -> None:
    assert find_planner(name) is find_planner(name.lower()) is find_planner(name.upper()) is getattr(og, name)


@pytest.mark.parametrize(
    ("wrong", "meant"), [("RRTConect", "RRTConnect"), ("bit*", "BITstar"), ("prm-star", "PRMstar")]
)
def test_a_wrong_name_lists_the_right_ones_and_the_likely_one(wrong: str, meant: str) -> None:
    with pytest.raises(InputError) as caught:
        find_planner(wrong)
    assert f"did you mean {meant}?" in str(caught.value) and repr(wrong) in str(caught.value)
    assert all(name in str(caught.value) for name in planners.planner_names())


@pytest.mark.parametrize("wrong", ["", "Planner", "SimpleSetup", 3, None])
def test_what_is_no_planner_is_refused(wrong: Any) -> None:
    with pytest.raises(InputError, match="RRTConnect"):
        find_planner(wrong)


def test_without_ompl_only_planners_is_missing() -> None:
    script = """
import sys

class NoOmpl:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "ompl":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, NoOmpl())
import numpy as np
import cspace
space = cspace.build(cspace.Workspace.from_array(np.zeros((9, 9), dtype=bool), 0.1), cspace.Robot.disc(0.05))
assert space.is_free((0.45, 0.45))
try:
    import planners
except cspace.MissingPackageError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "pip install ompl" in run.stdout
