"""Costs of edges, in every space and along curves."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

import planners
from cspace import InputError
from planners.local_planner import local_planner
from planners.states import find_state_kind
from tests.helpers.planning import (
    SPACES,
    SPACES_WITH_CURVES,
    build_room,
    draw_edges,
    make_state,
    options_for,
)


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
@pytest.mark.parametrize("reach", [0.4, 2.5])
def test_the_cost_of_an_edge_is_the_integral_along_it(
    name: str, curve: str | None, reach: float
) -> None:
    space, read = build_room(name), find_state_kind(build_room(name)).read
    options = options_for(curve)
    setup = planners.simple_setup(space, **options)
    si, states = setup.getSpaceInformation(), setup.getStateSpace()
    objective = planners.ClearanceObjective(
        si, space, weight=6.0, clearance_threshold=0.4, **options
    )
    between, ratios, extra = si.allocState(), [], False
    for a, b in zip(*draw_edges(space, 25, 2, reach), strict=True):
        first, second = make_state(space, si, a), make_state(space, si, b)
        length, points = states.distance(first, second), []
        for share in ((np.arange(400) + 0.5) / 400).tolist():
            states.interpolate(first, second, share, between)
            points.append(read(between))
        short = np.maximum(0.0, 1.0 - space.clearance(np.array(points)) / 0.4)
        cost = objective.motionCost(first, second).value()
        assert (
            cost >= length * (1 - 1e-9)
            and cost >= objective.motionCostHeuristic(first, second).value() - 1e-9
        )
        ratios.append(cost / (length * (1.0 + 6.0 * (short**2).mean())))
        extra |= cost > 1.5 * length
        if curve is None:
            assert objective.motionCost(second, first).value() == pytest.approx(cost)
        at = 1.0 + 6.0 * max(0.0, 1.0 - space.clearance(read(first)) / 0.4) ** 2
        assert objective.stateCost(first).value() == pytest.approx(at)
        line = math.dist(read(first)[: space.grid.dim], read(second)[: space.grid.dim])
        assert objective.motionCostHeuristic(first, second).value() == pytest.approx(line)
    assert extra and np.median(np.abs(np.array(ratios) - 1.0)) < 0.03
    assert objective.motionCost(first, first).value() == 0.0


@pytest.mark.parametrize("name", SPACES)
def test_zero_weight_gives_the_length(name: str) -> None:
    space = build_room(name)
    setup = planners.simple_setup(space)
    si, states = setup.getSpaceInformation(), setup.getStateSpace()
    objective = planners.ClearanceObjective(si, space, weight=0)
    for a, b in zip(*draw_edges(space, 30, 3), strict=True):
        endpoints = make_state(space, si, a), make_state(space, si, b)
        assert objective.motionCost(*endpoints).value() == pytest.approx(
            states.distance(*endpoints)
        )


@pytest.mark.parametrize(
    "options",
    [
        {"weight": -1.0},
        {"weight": math.nan},
        {"weight": [1.0]},
        {"clearance_threshold": 0.0},
        {"clearance_threshold": math.inf},
    ],
)
def test_invalid_weights_are_refused(options: dict[str, Any]) -> None:
    space = build_room("plane")
    with pytest.raises(InputError, match=next(iter(options))):
        planners.ClearanceObjective(
            planners.simple_setup(space).getSpaceInformation(), space, **options
        )


@pytest.mark.parametrize("drive", ["differential", "differential-reverse"])
def test_a_differential_drive_pays_for_each_turn_and_each_straight(drive: str) -> None:
    space = build_room("turning")
    si = planners.simple_setup(space, drive=drive).getSpaceInformation()
    length = planners.WeightedLength(si, space, drive=drive)
    driven = planners.ClearanceObjective(
        si, space, weight=6.0, clearance_threshold=0.4, drive=drive
    )
    parts = planners.ClearanceObjective(
        planners.simple_setup(space).getSpaceInformation(), space, weight=6, clearance_threshold=0.4
    )
    edges = local_planner(space, drive=drive)
    for a, b in zip(*draw_edges(space, 25, 5, 1.0), strict=True):
        first, second = make_state(space, si, a), make_state(space, si, b)
        step = complex(*(b - a)[:2])
        headings = [step, -step] if drive == "differential-reverse" else [step]
        turns = [
            abs(np.angle(h / np.exp(1j * a[2]))) + abs(np.angle(np.exp(1j * b[2]) / h))
            for h in headings
        ]
        assert length.motionCost(first, second).value() == pytest.approx(
            abs(step) + 0.5 * min(turns)
        )
        rows = [make_state(space, si, q) for q in edges.insert_breakpoints(np.array([a, b]))]
        total = sum(parts.motionCost(p, q).value() for p, q in itertools.pairwise(rows))
        assert driven.motionCost(first, second).value() == pytest.approx(total) and total > abs(
            step
        )
