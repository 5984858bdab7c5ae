"""The search on a lattice of headings: proofs, lengths, failures, parking, and the map of an
office."""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from ompl import base as ob

import planners
from cspace import BLOCKED, FREE, CSpace, InputError, Robot, Workspace, build
from tests.helpers.handmade import fill_boxes
from tests.helpers.planning import build_from_states, build_room
from tests.soak.drives import (
    OFFICE,
    build_office,
    draw_joined,
    draw_query,
    join_eight_headings,
    shortest_length,
    weighted_length,
)

DRIVES: list[dict[str, Any]] = [
    {"drive": "differential"},
    {"drive": "differential-reverse"},
    {"drive": "dubins", "turning_radius": 0.3},
    {"drive": "reeds-shepp", "turning_radius": 0.3},
]
IDS = [options["drive"] for options in DRIVES]

FOOTPRINT = [(-0.2, -0.15), (0.3, -0.15), (0.3, 0.05), (0.0, 0.05), (0.0, 0.2), (-0.2, 0.2)]


def world(seed: int) -> CSpace:
    """Build the map of a random plane with boxes."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((40, 36), dtype=bool)
    for _ in range(7):
        (i, j), (m, n) = rng.integers(0, 36, 2), rng.integers(1, 12, 2)
        cells[i : i + m, j : j + n] = True
    return build(Workspace.from_array(cells, 0.1), Robot.polygon(FOOTPRINT), rotations=24)


def sample_motion(plan: planners.Plan, drive: str, radius: float | None) -> np.ndarray:
    """Return configurations 1 cm or 1 degree apart along a path, for cars by OMPL's own curves."""
    rows = []
    for a, b in zip(plan.waypoints[:-1], plan.waypoints[1:], strict=True):
        share = np.linspace(0.0, 1.0, 2 + int(max(math.dist(a[:2], b[:2]) * 100, 60)))[:, None]
        if radius is None:
            angle = (b[2] - a[2] + math.pi) % (2 * math.pi) - math.pi
            assert not (a[:2] != b[:2]).any() or abs(angle) < 1e-9  # it turns or drives
            rows.append(a + share * [*(b[:2] - a[:2]), angle])
            continue
        states = (ob.DubinsStateSpace if drive == "dubins" else ob.ReedsSheppStateSpace)(radius)
        first, last, state = (states.allocState() for _ in range(3))
        for each, q in ((first, a), (last, b)):
            each.setXY(float(q[0]), float(q[1]))
            each.setYaw(float(q[2]))
        for t in np.linspace(0.0, 1.0, 2 + int(100 * states.distance(first, last))):
            states.interpolate(first, last, float(t), state)
            rows.append([[state.getX(), state.getY(), state.getYaw()]])
    return np.concatenate(rows)


@pytest.mark.parametrize("options", DRIVES, ids=IDS)
@settings(max_examples=12)
@given(seed=st.integers(0, 10_000))
def test_paths_of_the_lattice_are_certified_and_keep_exact_footprints_off_obstacles(
    options: dict[str, Any], seed: int
) -> None:
    space, rng = world(seed), np.random.default_rng(seed)
    boxes = [shapely.box(i, j, i + 1, j + 1) for i, j in np.argwhere(space.workspace.outer)]
    obstacles = shapely.affinity.scale(shapely.union_all(boxes), 0.1, 0.1, origin=(0, 0))
    shapely.prepare(obstacles)
    for _ in range(3):
        start, goal = space.sample_free(2, rng)
        if not space.is_connected(start, goal):
            continue
        plan = planners.plan(space, start, goal, planner="Lattice", time_limit=20.0, **options)
        assert plan.certified == plan.solved
        if plan.solved:
            assert (
                plan.waypoints[0].tolist() == start.tolist()
                and plan.waypoints[-1].tolist() == goal.tolist()
            )
            for x, y, yaw in sample_motion(plan, options["drive"], options.get("turning_radius")):
                c, s = math.cos(yaw), math.sin(yaw)
                shape = shapely.affinity.affine_transform(
                    shapely.Polygon(FOOTPRINT), (c, -s, s, c, x, y)
                )
                assert not obstacles.intersects(shape)


@pytest.mark.parametrize("options", DRIVES[:2], ids=IDS[:2])
@pytest.mark.parametrize("seed", range(8))
def test_the_lattice_solves_what_eight_headings_join_and_is_as_short(
    options: dict[str, Any], seed: int
) -> None:
    space, rng = world(seed), np.random.default_rng(seed)
    graph, joined = join_eight_headings(space, options["drive"]), 0
    for _ in range(6):
        query = draw_query(space, rng)
        best = shortest_length(space, graph, query)
        if math.isfinite(best):
            plan = planners.plan(space, *query, planner="Lattice", time_limit=20.0, **options)
            assert plan.certified, plan.status
            assert weighted_length(plan) <= 1.15 * best + 1e-9
            joined += 1
    assert joined


@pytest.mark.parametrize("options", DRIVES, ids=IDS)
def test_the_lattice_repeats_its_path(options: dict[str, Any]) -> None:
    space, (start, goal) = build_room("turning"), ((0.8, 0.8, 0.0), (5.0, 3.2, 2.0))
    plans = [planners.plan(space, start, goal, time_limit=20.0, **options) for _ in range(2)]
    assert plans[0].certified and plans[0].planner == "Lattice"
    assert plans[0].waypoints.tolist() == plans[1].waypoints.tolist()
    rough = planners.plan(
        space, start, goal, planner="lattice", simplify=False, time_limit=20.0, **options
    )
    assert rough.certified and len(rough.waypoints) >= len(plans[0].waypoints)


RESOLVE = "a finer spacing or more rotations"
"""Hint of a plan that fails with a drive."""


def sideways() -> tuple[CSpace, tuple[float, ...], tuple[float, ...]]:
    """Return a map that is FREE at one yaw alone, and a query that only a robot which moves
    sideways can drive."""
    states = np.full((8, 20, 20), BLOCKED, dtype=np.uint8)
    states[0, 3:17, 3:17] = FREE
    return build_from_states(states, 8), (10.5, 5.5, 0.0), (10.5, 14.5, 0.0)


@pytest.mark.parametrize("options", DRIVES[:2], ids=IDS[:2])
def test_the_status_says_that_the_lattice_has_no_path(options: dict[str, Any]) -> None:
    space, start, goal = sideways()
    for planner in (None, "Lattice"):
        plan = planners.plan(space, start, goal, planner=planner, time_limit=0.5, **options)
        assert not plan.solved and not plan.is_disconnected
        assert (
            "the lattice of 16 headings has no path; one exists for a robot that also moves"
            in plan.status
        )
    ahead = planners.plan(space, start, (14.5, 5.5, 0.0), planner="Lattice", **options)
    assert ahead.certified and "no search needed" in ahead.status


def dead_end() -> CSpace:
    """Return a map of a room with a corridor too narrow to turn in, which ends at a wall."""
    occupied = fill_boxes((80, 40), np.s_[:50, :15], np.s_[:50, 20:])
    return build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.6, 0.3), rotations=72)


def test_a_search_that_ends_at_its_limit_of_nodes_does_not_ask_for_more_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("planners.lattice.MAX_NODES", (10, 10, 2000))
    # A robot that turns on the spot finds its way around a long wall late.
    occupied = fill_boxes((600, 60), np.s_[:570, 28:31])
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.5, 0.3), rotations=24)
    plan = planners.plan(
        space,
        (0.7, 0.7, 0.0),
        (1.0, 5.0, 3.1),
        planner="Lattice",
        time_limit=1000.0,
        drive="differential",
    )
    decide = "planner='RRTConnect' with exact=True"
    assert not plan.solved and plan.hint == f"{RESOLVE}, {decide}, or planner='RRTConnect'"
    assert (
        "the lattice search ended at its limit of 10 nodes; one exists for a robot that"
        in plan.status
    )
    # A car that cannot enter the corridor in reverse searches the whole room.
    car: dict[str, Any] = {
        "drive": "dubins",
        "turning_radius": 0.3,
        "planner": "Lattice",
        "time_limit": 1000.0,
    }
    plan = planners.plan(dead_end(), (6.5, 1.75, 0.0), (1.0, 1.75, 1e-3), **car)
    assert not plan.solved and plan.hint == f"{RESOLVE}, a smaller turning_radius, or planner='RRT'"
    assert (
        "the lattice search ended at its limit of 2,000 nodes; one exists for a robot that"
        in plan.status
    )


@pytest.mark.parametrize("options", [DRIVES[0], DRIVES[2]], ids=[IDS[0], IDS[2]])
def test_a_search_without_nodes_left_does_not_ask_for_more_time(options: dict[str, Any]) -> None:
    query = ((1.0, 1.75, math.pi - 1e-3), (6.5, 1.75, 0.0))
    plan = planners.plan(dead_end(), *query, planner="Lattice", time_limit=1000.0, **options)
    assert not plan.solved
    if options["drive"] == "dubins":
        assert (
            "; the lattice search reached no more nodes; one exists for a robot that" in plan.status
        )
        assert plan.hint == f"{RESOLVE}, a smaller turning_radius, or planner='RRT'"
    else:
        assert (
            "; the lattice of 17 headings has no path; one exists for a robot that" in plan.status
        )
        decide = "planner='RRTConnect' with exact=True"
        assert plan.hint == f"{RESOLVE}, {decide}, or planner='RRTConnect'"
    late = planners.plan(dead_end(), *query, planner="Lattice", time_limit=1e-6, **options)
    assert "no path found within" in late.status and "nodes" not in late.status
    assert "more time (time_limit=1e-05), " in late.hint


def test_a_slot_too_tight_for_the_cells_asks_for_finer_cells() -> None:
    # A car of 0.9 m beside a slot of 1.2 m; its motions into the slot touch MIXED cells.
    occupied = fill_boxes((80, 40), np.s_[:30, :10], np.s_[42:, :10])
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.9, 0.36), rotations=72)
    query, car = ((5.5, 1.5, 0.0), (3.6, 0.5, 0.0)), {"drive": "reeds-shepp", "turning_radius": 1.0}
    assert space.is_connected(*query)
    for planner in (None, "Lattice", "RRTConnect"):
        plan = planners.plan(space, *query, planner=planner, time_limit=1e-6, **car)
        assert not plan.solved
        assert plan.hint.startswith(f"more time (time_limit=1e-05), {RESOLVE}, ")
    differential = {"drive": "differential", "planner": "RRT", "iterations": 1}
    plan = planners.plan(space, *query, time_limit=1e-6, **differential)
    assert f"{RESOLVE}, exact=True, or " in plan.hint


def test_ompl_takes_over_when_the_lattice_finds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        sys.modules["planners.plan"],
        "find_lattice_path",
        lambda *_: (np.empty((0, 3)), "the lattice gave up"),
    )
    space, (start, goal) = build_room("turning"), ((0.8, 0.8, 0.0), (5.0, 3.2, 2.0))
    plan = planners.plan(space, start, goal, drive="differential", seed=1, time_limit=20.0)
    assert plan.certified and plan.status == "path found: by RRTConnect, as Lattice found none"
    named = planners.plan(space, start, goal, drive="differential", planner="Lattice")
    assert not named.solved and "the lattice gave up" in named.status


def test_a_search_that_runs_out_of_time_finds_nothing() -> None:
    space, (start, goal) = build_room("turning"), ((0.8, 0.8, 0.0), (5.0, 3.2, 2.0))
    plan = planners.plan(
        space, start, goal, planner="Lattice", drive="differential", time_limit=1e-6
    )
    assert not plan.solved and "no path found within" in plan.status


def test_a_car_parks_parallel_to_the_road_in_reverse() -> None:
    """The gap is 1.6 times as long as the car."""
    cars = [shapely.box(x, 0.4, x + 4.2, 2.1) for x in (0.5, 11.4, 16.3)]
    workspace = Workspace.from_polygons(cars, 0.1, bounds=(0, 0, 21, 6.5))
    space = build(workspace, Robot.rectangle(4.2, 1.7), rotations=144)
    parked = (8.0, 1.25, 0.0)
    options: dict[str, Any] = {"drive": "reeds-shepp", "turning_radius": 4.0, "time_limit": 60.0}
    plan = planners.plan(space, (3.5, 4.2, 0.0), parked, **options)
    assert plan.certified and plan.direction is not None and -1 in plan.direction
    out = planners.plan(space, parked, (16.5, 4.2, 0.0), **options)
    assert out.certified and out.length < 40.0


@pytest.mark.parametrize("options", DRIVES, ids=IDS)
def test_cars_leave_a_bug_trap(options: dict[str, Any]) -> None:
    """The trap, the car and the query of OMPL.app's problem BugTrap_dcar, whose car turns within
    1.73 m."""
    outer, inner, gap = (
        shapely.box(-20, -20, 20, 20),
        shapely.box(-17, -17, 17, 17),
        shapely.box(3, -3, 20, 3),
    )
    walls = outer.difference(inner).union(shapely.box(3, -6, 20, 6)).difference(gap)
    workspace = Workspace.from_polygons([walls], 0.5, bounds=(-55, -55, 55, 55))
    space = build(workspace, Robot.rectangle(5.0, 2.5), rotations=72)
    if "turning_radius" in options:
        options = options | {"turning_radius": 3.0**0.5}
    plan = planners.plan(space, (6.0, 12.0, 0.0), (-39.0, 0.0, 0.0), time_limit=20.0, **options)
    assert plan.certified and plan.planner == "Lattice"
    assert plan.lower_bound < plan.length < 140.0
    if options["drive"] == "reeds-shepp":  # it turns round before it drives far
        assert plan.direction is not None
        assert (
            np.linalg.norm(np.diff(plan.path[:, :2], axis=0), axis=1)[plan.direction[1:] < 0].sum()
            < 20.0
        )


@pytest.mark.parametrize("radius", [2.5, 4.0])
def test_a_car_leaves_one_gap_of_a_full_parking_lot_for_another(data: Path, radius: float) -> None:
    lot, car = (data / "polygons" / f"{name}.geojson" for name in ("parking1", "car"))
    space = build(
        Workspace.open(lot, spacing=0.1, bounds=(-5, -18, 25, 4)), Robot.open(car), rotations=72
    )
    query, options = (
        ((4.03, -2.6, 1.5708), (9.9, -12.0, -1.5708)),
        {"turning_radius": radius, "time_limit": 20.0},
    )
    plan = planners.plan(space, *query, drive="reeds-shepp", **options)
    assert (
        plan.certified
        and plan.planner == "Lattice"
        and plan.direction is not None
        and -1 in plan.direction
    )
    assert plan.length < 20.0
    assert not planners.plan(
        space, *query, drive="dubins", planner="Lattice", **options
    ).solved  # it starts at a wall


@pytest.mark.parametrize("options", DRIVES, ids=IDS)
def test_the_lattice_leaves_a_dead_end_as_the_drive_may(options: dict[str, Any]) -> None:
    """In a corridor too narrow to turn, only robots that reverse leave in the other direction."""
    query = ((1.0, 1.75, math.pi - 1e-3), (6.5, 1.75, 0.0))
    plan = planners.plan(dead_end(), *query, time_limit=2.0, planner="Lattice", **options)
    assert (
        plan.solved
        == plan.certified
        == (options["drive"] in ("differential-reverse", "reeds-shepp"))
    )


def test_the_lattice_is_refused_for_robots_that_move_sideways() -> None:
    with pytest.raises(
        InputError,
        match=r"planner is 'Lattice' and drive is 'holonomic'.*for all other drives.*'Grid'",
    ):
        planners.plan(build_room("turning"), (0.8, 0.8, 0.0), (5.0, 3.2, 2.0), planner="Lattice")


def test_the_office_is_solved_wherever_eight_headings_join_it(data: Path) -> None:
    # The soak compares the lengths of new queries with Dijkstra's.
    space, rng, solved = build_office(Workspace.open(data / OFFICE)), np.random.default_rng(0), 0
    for _ in range(7):
        query = draw_joined(space, rng)
        plan = planners.plan(
            space, *query, planner="Lattice", drive="differential", time_limit=20.0
        )
        assert plan.certified == plan.solved
        straight = plan.lower_bound
        assert (
            not plan.solved
            or straight * (1.0 - 1e-9) <= weighted_length(plan) <= 3.0 * straight + 10.0
        )
        car = planners.plan(
            space,
            *query,
            planner="Lattice",
            drive="reeds-shepp",
            turning_radius=0.5,
            time_limit=20.0,
        )
        solved += car.certified
    assert solved >= 5
