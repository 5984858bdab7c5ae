"""Costs and lower bounds of edges and paths, in every space and along curves."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import planners
from cspace import BLOCKED, MIXED, ConfigurationError, InputError
from planners.local_planner import local_planner
from planners.states import find_state_kind
from tests.helpers.planning import (
    ENDPOINTS,
    SPACES_WITH_CURVES,
    build_from_states,
    build_room,
    draw_edges,
    make_state,
    options_for,
)
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds
from tests.soak import lengths

PENALTIES: dict[str, Any] = {"weight": 6.0, "clearance_threshold": 0.4}


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
def test_the_cost_of_an_edge_is_the_integral_along_it(name: str, curve: str | None) -> None:
    space = build_room(name)
    dim = space.grid.dim
    read = find_state_kind(space).read
    options = options_for(curve)
    setup = planners.simple_setup(space, **options)
    si, states = setup.getSpaceInformation(), setup.getStateSpace()
    objective = planners.ClearanceObjective(si, space, **PENALTIES, **options)
    plain = planners.WeightedLength(si, space, **options)
    between = si.allocState()

    def find_costs(q: Any) -> np.ndarray:
        """Return the cost of a metre at configurations."""
        shortfall = np.maximum(0.0, 1.0 - space.clearance(np.array(q)) / 0.4)
        return 1.0 + 6.0 * shortfall**2

    ratios = []
    for reach in (0.4, 2.5):
        for a, b in zip(*draw_edges(space, 20, 2, reach), strict=True):
            first, last = make_state(space, si, a), make_state(space, si, b)
            length = states.distance(first, last)
            points = []
            for share in ((np.arange(400) + 0.5) / 400).tolist():
                states.interpolate(first, last, share, between)
                points.append(read(between))
            cost = objective.motionCost(first, last).value()
            least = objective.motionCostHeuristic(first, last).value()
            assert least == pytest.approx(math.dist(read(first)[:dim], read(last)[:dim]))
            assert cost >= length * (1 - 1e-9) and cost >= least - 1e-9
            ratios.append(cost / (length * find_costs(points).mean()))
            assert objective.stateCost(first).value() == pytest.approx(find_costs([a])[0])
            assert plain.motionCost(first, last).value() == pytest.approx(length)
            if curve is None:
                assert objective.motionCost(last, first).value() == pytest.approx(cost)
    assert np.median(np.abs(np.array(ratios) - 1.0)) < 0.03
    assert objective.motionCost(first, first).value() == 0.0


@pytest.mark.parametrize("drive", ["differential", "differential-reverse"])
def test_a_differential_drive_pays_for_each_turn_and_each_straight(drive: str) -> None:
    space = build_room("turning")
    si = planners.simple_setup(space, drive=drive).getSpaceInformation()
    length = planners.WeightedLength(si, space, drive=drive)
    driven = planners.ClearanceObjective(si, space, **PENALTIES, drive=drive)
    straight = planners.ClearanceObjective(si, space, **PENALTIES)
    edges = local_planner(space, drive=drive)
    for a, b in zip(*draw_edges(space, 25, 5, 1.0), strict=True):
        ends = make_state(space, si, a), make_state(space, si, b)
        step = complex(*(b - a)[:2])
        headings = [step, -step] if drive == "differential-reverse" else [step]
        turns = [
            abs(np.angle(h / np.exp(1j * a[2]))) + abs(np.angle(np.exp(1j * b[2]) / h))
            for h in headings
        ]
        metres = abs(step) + 0.5 * min(turns)
        assert length.motionCost(*ends).value() == pytest.approx(metres)
        rows = [make_state(space, si, q) for q in edges.insert_breakpoints(np.array([a, b]))]
        parts = [straight.motionCost(p, q).value() for p, q in itertools.pairwise(rows)]
        assert driven.motionCost(*ends).value() == pytest.approx(sum(parts))
        assert sum(parts) > abs(step)


@refusals(
    "options, message",
    ({"weight": math.nan}, "weight is nan"),
    ({"clearance_threshold": 0.0}, "clearance_threshold is 0.0"),
)
def test_invalid_weights_are_refused(options: dict[str, Any], message: str) -> None:
    space = build_room("plane")
    si = planners.simple_setup(space).getSpaceInformation()
    with pytest.raises(InputError, match=message):
        planners.ClearanceObjective(si, space, **options)


# ---- lower bounds --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", lengths.WORLDS)
@settings(max_examples=25)
@given(seeds)
def test_no_path_is_shorter_than_the_bound(kind: str, seed: int) -> None:
    outcomes = lengths.WORLDS[kind](np.random.default_rng(seed))
    assert lengths.is_between(*np.reshape(outcomes, (-1, 3)).T)


@settings(max_examples=15)
@given(seeds, st.sampled_from(sorted(ENDPOINTS)))
def test_no_certified_path_is_shorter_than_the_bound(seed: int, name: str) -> None:
    space = build_room(name)
    dim = space.grid.dim
    start, goal = space.sample_free(2, np.random.default_rng(seed))
    goal[:dim] = start[:dim] if seed % 3 == 0 else goal[:dim]
    if not space.is_free(goal):
        return
    for options in ({}, {"planner": "RRTConnect", "seed": seed % 1000}):
        plan = planners.plan(space, start, goal, time_limit=1.0, **options)
        if plan.certified:
            straight = math.dist(start[:dim], goal[:dim])
            length = plan.length + 0.5 * plan.total_rotation
            assert straight * (1.0 - 1e-6) <= plan.lower_bound <= length
            assert plan.gap >= 0.0
            if len(plan.waypoints) == 2:  # a single edge is a shortest path
                assert plan.gap < 1e-6


def test_the_bound_is_near_the_length_if_no_cell_is_mixed() -> None:
    states = np.zeros((20, 20), dtype=np.uint8)
    states[10, 2:] = BLOCKED
    ends = (5.5, 15.5), (15.5, 15.5)
    around = math.dist(ends[0], (10, 2)) + 1.0 + math.dist((11, 2), ends[1])
    plan = planners.plan(build_from_states(states), *ends)
    assert around / 1.03 - 2.0 <= plan.lower_bound <= around and 0.0 <= plan.gap < 0.1
    hall = build_from_states(np.stack([states] * 4, axis=-1))
    bound = hall.min_path_length((*ends[0], 0.5), (*ends[1], 3.5))
    assert math.hypot(around, 3.0) / 1.03 - 2.0 <= bound <= math.hypot(around, 3.0)
    states[10] = BLOCKED
    assert build_from_states(states).min_path_length(*ends) == math.inf
    # Paths may pass MIXED cells, but not the corner between two BLOCKED ones.
    states = np.array([[0, 0, 0], [BLOCKED, MIXED, BLOCKED], [0, 0, 0]], dtype=np.uint8)
    door = build_from_states(states)
    assert door.min_path_length((0.5, 1.5), (2.5, 1.5)) == pytest.approx(2.0, abs=1e-3)
    corner = build_from_states(np.array([[0, BLOCKED], [BLOCKED, 0]], dtype=np.uint8))
    assert corner.min_path_length((0.5, 0.5), (1.5, 1.5)) == math.inf
    with pytest.raises(ConfigurationError, match="in the grid"):
        corner.min_path_length((-100.0, 0.0), (1.0, 1.0))
