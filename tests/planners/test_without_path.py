"""Plans whose planner finds no path: fallback, refusal, status and hint."""

import math
import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from ompl import geometric as og

import planners
from cspace import BLOCKED, FREE, MIXED
from planners._edges.drives import local_planner
from tests.helpers.drives import WORDS, make_drive
from tests.helpers.handmade import (
    MAP_KINDS,
    components,
    configurations,
    make_map,
    random_states,
)
from tests.helpers.placements import draw_configurations
from tests.helpers.planning import (
    build_from_states,
    build_halves,
    check_failed,
    options_for,
)
from tests.helpers.strategies import examples, seeds

NO_CHAIN = "no chain of FREE cells joins start and goal"


# ---- no chain of FREE cells ----------------------------------------------------------------------


@pytest.mark.parametrize("between", [BLOCKED, MIXED], ids=["blocked", "mixed"])
@pytest.mark.parametrize(
    "name, drive, planner",
    [
        ("plane", "holonomic", None),
        ("turning", "differential", None),
        ("turning", "dubins", "RRT"),
        ("floating", "holonomic", "BITstar"),
    ],
)
def test_a_plan_ends_at_once_if_no_chain_of_free_cells_joins_start_and_goal(
    name, drive, planner, between, monkeypatch
):
    space, start, goal = build_halves(name, between)
    solve = og.SimpleSetup.solve
    runs = []
    monkeypatch.setattr(og.SimpleSetup, "solve", lambda *args: runs.append(1) or solve(*args))
    plan = planners.plan(space, start, goal, planner=planner, time_limit=60.0, **options_for(drive))
    check_failed(space, plan)
    # A search of OMPL ends soon, and of default plans only the quick one runs.
    assert len(runs) <= 1 and plan.times.planning < 30.0
    assert plan.is_disconnected == (between == BLOCKED) and not plan.is_connected
    # Once components are known, no search is run.
    runs.clear()
    again = planners.plan(space, start, goal, planner=planner, **options_for(drive))
    assert again.status == plan.status and not runs
    if between == BLOCKED:
        assert (plan.status, plan.hint) == ("no path exists: proven", "")
        return
    assert plan.status == f"{NO_CHAIN}; undecided whether one exists"
    # No obstacle lies in the MIXED cells.
    assert plan.hint.startswith("space.exact")


@pytest.mark.parametrize(
    "planner, exact",
    [(None, False), (None, True), ("Grid", False), ("RRTConnect", False), ("RRTConnect", True)],
)
def test_a_path_proves_that_one_exists_without_components(planner, exact, monkeypatch):
    states = np.full((8, 20, 9), FREE, dtype=np.uint8)
    states[:, 9, :6] = BLOCKED
    space = build_from_states(states, 8)
    monkeypatch.setattr(type(space), "path_exists", lambda *_: pytest.fail("asked for components"))
    ends = (2.5, 1.5, 0.0), (16.5, 1.5, 1.0)
    plan = planners.plan(
        (space.exact if exact else space), *ends, planner=planner, seed=1, time_limit=60.0
    )
    assert plan.certified and plan.is_connected and not plan.is_disconnected


def draw_edges(space, rng, count):
    """Draw edges of a few cells in the grid, many on borders of cells."""
    dim = space.grid.dim
    q0 = draw_configurations(space, rng, count)
    q0[:, :dim] = q0[:, :dim].clip(space.grid.lower, space.grid.upper)
    steps = rng.normal(size=q0.shape) * space.grid.spacing
    steps[: count // 2, dim:] = 0.0
    q1 = q0 + steps
    q1[:, :dim] = q1[:, :dim].clip(space.grid.lower, space.grid.upper)
    return q0, configurations(space, q1)


def find_labels(space, labels, q):
    """Return the components of configurations' cells."""
    cells = space.grid.cell_of(q[:, : space.grid.dim])
    return labels[space.rotations._find_cells(q), *cells.T]


@examples(40)
@given(seeds, st.sampled_from(MAP_KINDS), st.sampled_from(["free", "blocked"]))
def test_an_edge_that_is_proven_free_never_leaves_a_component_of_free_cells(seed, kind, outside):
    # Therefore a plan that ends early misses no path.
    rng = np.random.default_rng(seed)
    states = random_states(rng, kind, mixture=(FREE, FREE, FREE, FREE, MIXED))
    space = make_map(states, kind, outside)
    labels = components(states == FREE, kind)
    q0, q1 = draw_edges(space, rng, 40)
    for word in WORDS if kind == "turning" else WORDS[:1]:
        check_edge = local_planner(space, make_drive(word, 0.3)).edge_checker()
        free = np.array([check_edge(*a, *b) for a, b in zip(q0.tolist(), q1.tolist(), strict=True)])
        first = find_labels(space, labels, q0)[free]
        assert (first >= 0).all() and (first == find_labels(space, labels, q1)[free]).all()


# ---- free yaws -----------------------------------------------------------------------------------

FREE_YAWS = re.compile(r"at the (start|goal) only yaws (\S+) to (\S+) rad are proven free")


def find_range(space, q, step=4e-3):
    """Return the range of yaws reached through FREE cells, by small steps."""
    ends = []
    for direction in (-step, step):
        yaw = q[2]
        while abs(yaw - q[2]) < math.tau and space.is_free([q[0], q[1], yaw + direction]):
            yaw += direction
        ends.append(yaw)
    return ends[0], ends[1]


@examples(10)
@given(seeds)
def test_the_yaws_in_the_status_equal_look_ups(seed):
    rng = np.random.default_rng(seed)
    mixture = np.array([FREE, FREE, MIXED], dtype=np.uint8)
    states = rng.choice(mixture, (int(rng.integers(3, 9)), 4, 1))
    states[:, 1:3] = FREE
    space = make_map(states, "turning", "blocked")
    ends = [[*space.grid.center_of([x, 0]), rng.uniform(-math.pi, math.pi)] for x in (0, 3)]
    assume(all(space.motion_is_free(q, q) for q in ends))
    plan = planners.plan(
        space, *ends, drive=planners.Differential(), planner="RRT", time_limit=1e-6
    )
    assume(not plan)
    named = {name: (float(low), float(high)) for name, low, high in FREE_YAWS.findall(plan.status)}
    for name, q in zip(("start", "goal"), ends, strict=True):
        low, high = find_range(space, q)
        assert (name in named) == (high - low < math.tau)
        if name in named:
            assert named[name] == pytest.approx((low, high), abs=9e-3)
