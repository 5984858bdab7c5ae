"""Costs and lower bounds of edges and paths, in every space and along curves."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ompl import base as ob
from scipy.interpolate import RegularGridInterpolator

import planners
from cspace import InputError
from planners._edges.drives import local_planner
from planners._ompl.states import find_state_kind
from tests.helpers.drives import make_drive
from tests.helpers.planning import (
    ENDPOINTS,
    SPACES_WITH_CURVES,
    build_room,
    draw_edges,
    make_state,
    options_for,
)
from tests.helpers.strategies import examples, seeds

PENALTIES = {"weight": 6.0, "clearance_threshold": 0.4}


@pytest.mark.parametrize("name, curve", SPACES_WITH_CURVES)
def test_the_cost_of_an_edge_is_the_integral_along_it(name, curve):
    space = build_room(name)
    dim = space.grid.dim
    read = find_state_kind(space).read
    options = options_for(curve)
    by_clearance = planners.ClearanceObjective(**PENALTIES)
    setup = planners.simple_setup(space, objective=by_clearance, **options)
    si, states = setup.getSpaceInformation(), setup.getStateSpace()
    objective = setup.getOptimizationObjective()
    no_costs = planners.WeightedLength(np.zeros((len(space.slice_rotations), *space.grid.shape)))
    plain_setup = planners.simple_setup(space, objective=no_costs, **options)
    plain = plain_setup.getOptimizationObjective()
    between = si.allocState()

    def find_costs(q):
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
            assert plain.motionCost(first, last).value() == pytest.approx(length)
            if curve is None:
                assert objective.motionCost(last, first).value() == pytest.approx(cost)
    assert np.median(np.abs(np.array(ratios) - 1.0)) < 0.03
    assert objective.motionCost(first, first).value() == 0.0


@pytest.mark.parametrize("name", ["plane", "turning", "space"])
def test_costs_on_cells_are_linear_between_cell_centers(name):
    """Draw values, some of them below zero, and positions that reach the border of the grid."""
    space = build_room(name)
    grid = space.grid
    rng = np.random.default_rng(1)
    costs = rng.uniform(-0.2, 1.0, (len(space.slice_rotations), *grid.shape))
    positions = rng.uniform(grid.lower, grid.upper, (100, grid.dim))
    border = rng.random(positions.shape) < 0.1
    positions[border] = np.broadcast_to(grid.lower, positions.shape)[border] + 0.01 * grid.spacing
    turns = rng.uniform(-3.0, 3.0, (100, space.size - grid.dim))
    configurations = np.column_stack([positions, turns])
    axes = [grid.centers(axis) for axis in range(grid.dim)]
    inside = positions.clip([axis[0] for axis in axes], [axis[-1] for axis in axes])
    slices = space.slice_of[space.rotations._find_cells(configurations)]
    factors = 1.0 + np.maximum(costs, 0.0)
    expected = [
        RegularGridInterpolator(axes, factors[number])(position)[0]
        for number, position in zip(slices, inside, strict=True)
    ]
    weighted = planners.WeightedLength(costs)
    setup = planners.simple_setup(space, objective=weighted)
    si, objective = setup.getSpaceInformation(), setup.getOptimizationObjective()
    short = 1e-4 * grid.spacing
    found = []
    for q in configurations:
        ends = q.copy(), q.copy()
        ends[0][0] -= short
        ends[1][0] += short
        cost = objective.motionCost(*(make_state(space, si, end) for end in ends)).value()
        found.append(cost / (2.0 * short))
    assert found == pytest.approx(np.array(expected), rel=1e-5)


# ---- lower bounds --------------------------------------------------------------------------------


@examples(15)
@given(seeds, st.sampled_from(sorted(ENDPOINTS)))
def test_no_certified_path_is_shorter_than_the_bound(seed, name):
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


@pytest.mark.parametrize("drive", ["differential", "differential-reverse"])
def test_a_differential_drive_pays_for_each_turn_and_each_straight(drive):
    space = build_room("turning")
    no_costs = planners.WeightedLength(np.zeros((len(space.slice_rotations), *space.grid.shape)))
    by_clearance = planners.ClearanceObjective(**PENALTIES)
    setups = [
        planners.simple_setup(space, objective=no_costs, **options_for(drive)),
        planners.simple_setup(space, objective=by_clearance, **options_for(drive)),
        planners.simple_setup(space, objective=by_clearance),
    ]
    si = setups[0].getSpaceInformation()
    length, driven, straight = (setup.getOptimizationObjective() for setup in setups)
    edges = local_planner(space, drive=make_drive(drive))
    for a, b in zip(*draw_edges(space, 25, 5, 1.0), strict=True):
        ends = make_state(space, si, a), make_state(space, si, b)
        metres = edges.edge_lengths(a[None], b[None])[0]
        assert length.motionCost(*ends).value() == pytest.approx(metres)
        rows = [make_state(space, si, q) for q in edges.insert_breakpoints(np.array([a, b]))]
        parts = [straight.motionCost(p, q).value() for p, q in itertools.pairwise(rows)]
        assert driven.motionCost(*ends).value() == pytest.approx(sum(parts))
    with pytest.raises(InputError, match="weight"):
        planners.ClearanceObjective(weight=math.nan)


def test_an_objective_may_be_a_callable_without_items():
    class Lengths(list):
        """An empty list, which is false, and a maker of objectives."""

        def __call__(self, si):
            return ob.PathLengthOptimizationObjective(si)

    space = build_room("turning")
    ends = (0.8, 0.8, 0.0), (1.2, 1.0, 0.5)
    plan = planners.plan(space, *ends, objective=Lengths(), planner="RRTstar", time_limit=0.5)
    assert plan.objective == "custom"
