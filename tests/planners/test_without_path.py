"""Plans whose planner finds no path: fallback, refusal, status and hint."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ompl import geometric as og

import planners
from cspace import FREE, MIXED, CSpace, Robot, Workspace, build
from planners.catalogue import BIDIRECTIONAL_PLANNERS
from planners.local_planner import CURVES, DRIVES, local_planner
from tests.helpers.handmade import (
    MAP_KINDS,
    components,
    configurations,
    fill_boxes,
    make_map,
    random_states,
)
from tests.helpers.maps import proven_paths
from tests.helpers.planning import (
    SPACES,
    build_halves,
    build_room,
    build_three_rooms,
    check_failed,
    options_for,
)
from tests.helpers.strategies import seeds

SPACES_WITH_DRIVES = [
    *((name, "holonomic") for name in SPACES),
    *(("turning", drive) for drive in DRIVES[1:]),
]


# ---- a path is known -----------------------------------------------------------------------------

UNLUCKY = (46.88055871201929, 41.28320707718364), (12.183013811961223, 15.754237987961671)
"""Start and goal that RRTConnect does not join within a second, on a map of offices with narrow
doors."""


@pytest.fixture(scope="module")
def offices(data: Path) -> CSpace:
    return build(Workspace.open(data / "maps" / "willow-full-0.05.yaml"), Robot.disc(0.3))


def test_grid_plans_by_default_on_a_real_map(offices: CSpace) -> None:
    plan = planners.plan(offices, *UNLUCKY, time_limit=20.0)
    assert plan.solved and plan.certified and plan.planner == "Grid" and plan.times.planning < 10.0
    assert np.array_equal(plan.path, planners.plan(offices, *UNLUCKY, seed=1, time_limit=20.0).path)
    late = planners.plan(
        offices, *UNLUCKY, time_limit=1e-6
    )  # the grid search gets at least 0.1 s, if that is enough
    assert late.certified == late.solved and late.is_connected


def test_a_named_planner_is_not_replaced_and_the_hint_names_grid(offices: CSpace) -> None:
    for options in ({}, {"iterations": 1}):
        plan = planners.plan(offices, *UNLUCKY, planner="RRTConnect", time_limit=0.01, **options)
        check_failed(offices, plan)
        assert plan.status.endswith("; a path exists")
        assert plan.hint == "planner='Grid', which finds one, or more time (time_limit=0.1)"
    plan = planners.plan(
        offices, *UNLUCKY, planner="RRTstar", time_limit=0.01, objective="clearance"
    )
    assert plan.solved or plan.hint.startswith("planner='Grid', which finds one")
    assert planners.plan(offices, *UNLUCKY, planner="Grid").certified


def test_grid_plans_by_default_on_a_tiled_map(tmp_path: Path) -> None:
    for tile in (100, 20):
        store = tmp_path / f"{tile}.zarr"
        tiled = build(build_three_rooms(2), Robot.disc(0.04), store=store, tile=tile)
        plan = planners.plan(tiled, (0.35, 0.35), (3.6, 0.35), seed=0)
        assert plan.solved and plan.certified


# ---- no chain of FREE cells ----------------------------------------------------------------------


@pytest.mark.parametrize(("name", "drive"), SPACES_WITH_DRIVES)
@pytest.mark.parametrize("planner", [None, "RRT", "PRM", "BITstar"])
def test_a_plan_ends_at_once_if_no_chain_of_free_cells_joins_start_and_goal(
    name: str, drive: str, planner: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if drive == "dubins" and planner in BIDIRECTIONAL_PLANNERS:
        return
    space, start, goal = build_halves(name, MIXED)
    monkeypatch.setattr(og.SimpleSetup, "solve", lambda *_: pytest.fail("OMPL was run"))
    plan = planners.plan(space, start, goal, planner=planner, time_limit=60.0, **options_for(drive))
    check_failed(space, plan)
    assert not (plan.is_connected or plan.is_disconnected) and plan.times.planning < 60.0
    assert (
        plan.status == "no chain of FREE cells joins start and goal; undecided whether one exists"
    )
    finer = "a finer spacing" + " or more rotations" * (name in ("turning", "yawing", "floating"))
    assert plan.hint == (finer if drive in CURVES else f"exact=True, or {finer}")


def test_the_hint_fits_the_map_and_the_planner(tmp_path: Path) -> None:
    space, start, goal = build_halves("plane", MIXED)
    assert planners.plan(space, start, goal, planner="MaxClearance").hint.startswith(
        "planner='RRTConnect' with exact=True"
    )
    walls = fill_boxes((60, 40), np.s_[30:32])  # a path leads around the map
    options = {"store": tmp_path / "m", "tile": 15, "outside": "free"}
    tiled = build(Workspace.from_array(walls, 0.1), Robot.disc(0.2), **options)
    plan = planners.plan(tiled, [0.7, 3.2], [5.3, 3.2])
    where = "exact=True on space.window(lower, upper)"
    assert plan.hint == f"{where}, a finer spacing, or a workspace with wider bounds"


def test_an_exact_plan_crosses_mixed_cells() -> None:
    space, start, goal = build_halves("plane", MIXED)
    plan = planners.plan(space, start, goal, exact=True, time_limit=2.0, seed=0)
    # The robot is nearly a point, and no obstacle lies in the MIXED cells.
    check_path = space.certify_path(plan.path, exact=True)
    assert plan.solved and plan.certified and check_path.all()


def draw_edges(space: CSpace, rng: np.random.Generator, count: int) -> tuple[Any, Any]:
    """Draw short edges, many on borders of cells."""
    dim, grid = space.grid.dim, space.grid
    lower, upper = np.array(grid.lower), np.array(grid.upper)
    positions = rng.uniform(lower, upper, (2, count, dim))
    positions[1] = np.clip(
        positions[0] + rng.normal(size=(count, dim)) * grid.spacing, lower, upper
    )
    corners = lower + np.round((positions - lower) / (grid.spacing / 2.0)) * grid.spacing / 2.0
    positions = np.where(
        rng.random(positions.shape) < 0.3, np.clip(corners, lower, upper), positions
    )
    turns = rng.normal(size=(2, count, len(space.rotations.names)))
    turns[1] = np.where(rng.random((count, 1)) < 0.5, turns[0], turns[0] + 0.7 * turns[1])
    q0, q1 = configurations(space, np.concatenate([positions, turns], axis=-1))
    return q0, q1


@settings(max_examples=60)
@given(seeds, st.sampled_from(MAP_KINDS), st.sampled_from(["free", "blocked"]))
def test_an_edge_that_is_proven_free_never_leaves_a_component_of_free_cells(
    seed: int, kind: str, outside: str
) -> None:
    # Therefore a plan that ends early misses no path.
    rng = np.random.default_rng(seed)
    states = random_states(rng, kind, mixture=(FREE, FREE, FREE, FREE, MIXED))
    space = make_map(states, kind, outside)
    joined = components(states == FREE, kind)
    q0, q1 = draw_edges(space, rng, 40)
    cells = [
        tuple(
            np.insert(
                space.grid.cell_of(q[:, : space.grid.dim]), 0, space.rotations.find_cells(q), axis=1
            ).T
        )
        for q in (q0, q1)
    ]
    for drive in DRIVES if kind == "turning" else DRIVES[:1]:
        radius = 0.3 if drive in CURVES else None
        check_edge = local_planner(space, False, drive, radius).edge_checker()
        free = np.array([check_edge(*a, *b) for a, b in zip(q0.tolist(), q1.tolist(), strict=True)])
        one, other = joined[cells[0]][free], joined[cells[1]][free]
        assert (one >= 0).all() and (one == other).all()
        assert all(space.is_connected(a, b) for a, b in zip(q0[free], q1[free], strict=True))


@settings(max_examples=15)
@given(seeds, st.sampled_from(["plane", "turning"]))
def test_a_plan_is_solved_exactly_if_free_cells_connect_its_endpoints(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    states = random_states(rng, kind, mixture=(FREE, FREE, MIXED))
    space, joined = make_map(states, kind, "free"), components(states == FREE, kind)
    free = np.argwhere(joined >= 0)
    if not len(free):
        return
    first, last = free[rng.integers(len(free), size=2)]
    q = [
        np.concatenate([space.grid.center_of(cell[1:]), space.rotations.centers[cell[0]]])
        for cell in (first, last)
    ]
    plan = planners.plan(space, *q, seed=0)
    assert plan.solved == (joined[tuple(first)] == joined[tuple(last)])
    if plan.solved:
        assert plan.certified and space.certify_path(plan.path).all()
    else:
        assert plan.status.startswith("no chain of FREE cells")


def test_a_plan_ends_at_once_on_a_real_map(offices: CSpace) -> None:
    pairs = offices.sample_free(200, np.random.default_rng(0)).reshape(-1, 2, 2)
    apart = [pair for pair in pairs if proven_paths(offices, *pair) is None]
    assert len(apart) > 10
    for start, goal in apart:
        plan = planners.plan(offices, start, goal, time_limit=60.0)
        assert plan.status.startswith("no chain of FREE cells") and plan.times.planning < 60.0


# ---- free yaws -----------------------------------------------------------------------------------

FREE_YAWS = re.compile(r"at the (start|goal) only yaws (\S+) to (\S+) rad are proven free")


def free_range(space: CSpace, q: Any, step: float = 1e-3) -> tuple[float, float]:
    """Return the range of yaws reached through FREE cells, by small steps."""
    ends = []
    for direction in (-1.0, 1.0):
        yaw = q[2]
        while abs(yaw - q[2]) < math.tau and space.is_free([q[0], q[1], yaw + direction * step]):
            yaw += direction * step
        ends.append(yaw)
    return ends[0], ends[1]


@pytest.mark.parametrize("drive", DRIVES[1:])
def test_a_failed_plan_of_a_drive_names_the_yaws_that_are_free_at_start_and_goal(
    drive: str,
) -> None:
    occupied = np.ones((60, 60), dtype=bool)
    occupied[5:55, 26:34] = False  # a corridor of 0.8 m
    occupied[40:57, 15:45] = False  # and a room at its end
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(1.2, 0.4), rotations=72)
    endpoints = (2.5, 3.0, 0.0), (2.0, 2.95, -3.11)
    plan = planners.plan(space, *endpoints, planner="RRT", time_limit=1e-6, **options_for(drive))
    check_failed(space, plan)
    found = {name: (float(low), float(high)) for name, low, high in FREE_YAWS.findall(plan.status)}
    for name, q in zip(("start", "goal"), endpoints, strict=True):
        low, high = free_range(space, q)
        assert (
            found[name] == pytest.approx((low, high), abs=3e-3)
            and found[name][0] <= q[2] <= found[name][1]
        )
    assert ("too few to turn around" in plan.status) == (drive not in CURVES)


@settings(max_examples=25)
@given(seeds)
def test_the_yaws_in_the_status_equal_look_ups(seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = rng.choice(
        np.array([FREE, FREE, MIXED], dtype=np.uint8), (int(rng.integers(3, 9)), 4, 1)
    )
    states[:, 1:3] = FREE
    space, joined = make_map(states, "turning", "blocked"), components(states == FREE, "turning")
    ends = [
        np.array([*space.grid.center_of([x, 0]), rng.uniform(-math.pi, math.pi)]) for x in (0, 3)
    ]
    if not all(space.motion_is_free(q, q) for q in ends):
        return
    plan = planners.plan(space, *ends, drive="differential", planner="RRT", time_limit=1e-6)
    if plan.solved or "yaws" not in plan.status:
        assert plan.solved or plan.status.startswith("no ") or joined.size
        return
    found = {name: (float(low), float(high)) for name, low, high in FREE_YAWS.findall(plan.status)}
    for name, q in zip(("start", "goal"), ends, strict=True):
        low, high = free_range(space, q, 2e-3)
        assert (name in found) == (high - low < math.tau)
        if name in found:
            assert found[name] == pytest.approx((low, high), abs=5e-3)


def test_the_status_of_a_holonomic_plan_names_no_yaws() -> None:
    space = build_room("turning")
    plan = planners.plan(space, (0.8, 0.8, 0.0), (5.0, 3.2, 2.0), planner="RRT", time_limit=1e-6)
    assert not plan.solved and "yaws" not in plan.status
