"""The search on a lattice of headings: proofs, lengths, failures, parking, and the map of an
office."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import planners
from benchmarks.inputs import CAR, PARKING_BOUNDS, make_parallel_slot, make_perpendicular_slot
from cspace import FREE, Robot, Workspace, build
from planners._searches.lattice import _measure_block_side
from tests.helpers.drives import make_drive
from tests.helpers.handmade import fill_boxes
from tests.helpers.planning import (
    ENDPOINTS,
    build_room,
    draw_query,
    weighted_length,
)
from tests.helpers.strategies import examples, few, seeds

SPOT_DRIVES = [{"drive": planners.Differential()}, {"drive": planners.Differential(reverse=True)}]
CAR_DRIVES = [
    {"drive": planners.Car(turning_radius=0.3)},
    {"drive": planners.Car(turning_radius=0.3, reverse=True)},
]
EVERY_DRIVE = pytest.mark.parametrize("options", [*SPOT_DRIVES, *CAR_DRIVES], ids=str)
FOOTPRINT = [(-0.2, -0.15), (0.3, -0.15), (0.3, 0.05), (0.0, 0.05), (0.0, 0.2), (-0.2, 0.2)]


def build_world(rng):
    """Build the map of a random plane with boxes."""
    cells = np.zeros((40, 36), dtype=bool)
    for i, j, width, height in rng.integers(1, (36, 36, 12, 12), (7, 4)):
        cells[i - 1 : i + width - 1, j - 1 : j + height - 1] = True
    return build(Workspace.from_array(cells, 0.1), Robot.polygon(FOOTPRINT), rotations=24)


@EVERY_DRIVE
@examples(4)
@given(seed=seeds)
def test_paths_are_certified_from_start_to_goal(options, seed):
    rng = np.random.default_rng(seed)
    space = build_world(rng)
    for _ in range(3):
        start, goal = space.sample_free(2, rng)
        plan = planners.plan(space, start, goal, planner="Lattice", time_limit=0.1, **options)
        assert plan.certified == bool(plan)
        if plan:
            np.testing.assert_array_equal(plan.waypoints[[0, -1]], [start, goal])


def test_a_car_parks_in_a_real_lot(data):
    file = data / "polygons" / "parking1.geojson"
    car = Robot.open(data / "polygons" / "car.geojson")
    space = build(Workspace.open(file, spacing=0.15), car, rotations=72)
    ends = (4.03, -2.6, math.pi / 2.0), (9.9, -12.0, -math.pi / 2.0)
    options = {"drive": planners.Car(turning_radius=3.0, reverse=True), "time_limit": 20.0}
    plan = planners.plan(space, *ends, **options)
    assert plan.certified and plan.planner == "Lattice"


HEADINGS = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
"""Steps along the eight headings, in cells."""


def join_eight_headings(space, drive):
    """Return the graph of FREE cells of a robot that turns on the spot and drives along eight
    headings."""
    free = np.asarray(space.cell_states) == FREE
    index = np.arange(free.size).reshape(free.shape)
    edges = [
        (index[k], index[(k + 1) % len(free)], free[k] & free[(k + 1) % len(free)])
        for k in range(len(free))
    ]
    turn = math.pi / len(free)  # half a metre for each radian
    parts = [(a[m], b[m], np.full(m.sum(), turn)) for a, b, m in edges]
    parts += [(b, a, cost) for a, b, cost in parts]
    for dx, dy in HEADINGS:
        k = int(space.rotations.cell_of(math.atan2(dy, dx)))
        ahead = np.roll(np.pad(free[k], 1), (-dx, -dy), (0, 1))[1:-1, 1:-1]
        beside = [
            np.roll(np.pad(free[k], 1), (-a, -b), (0, 1))[1:-1, 1:-1] for a, b in ((dx, 0), (0, dy))
        ]
        may = free[k] & ahead & beside[0] & beside[1]
        a = index[k][may]
        b = a + dx * free.shape[2] + dy
        parts.append((a, b, np.full(len(a), space.grid.spacing * math.hypot(dx, dy))))
        parts += [(b, a, parts[-1][2])] * drive.reverse
    a, b, cost = (np.concatenate(column) for column in zip(*parts, strict=True))
    return coo_array((cost, (a, b)), shape=(free.size, free.size)).tocsr()


def shortest_length(space, graph, query):
    """Return the length of the shortest path in a graph of cells, infinite without one."""
    cells = np.column_stack(
        [space.rotations.cell_of(query[:, 2]), space.grid.cell_of(query[:, :2])]
    )
    first, last = np.ravel_multi_index(
        tuple(cells.T), (len(space.rotations), *space.grid.shape)
    ).tolist()
    return float(dijkstra(graph, indices=first)[last])


@pytest.mark.parametrize("options", few(SPOT_DRIVES), ids=str)
def test_the_lattice_solves_nearly_all_that_eight_headings_join_and_is_as_short(options):
    # No proof: the lattice misses some 3 % of such queries, so their draws are fixed.
    as_short = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        space = build_world(rng)
        graph = join_eight_headings(space, options["drive"])
        for _ in range(5):
            query = draw_query(space, rng)
            best = shortest_length(space, graph, query)
            if math.isfinite(best):
                plan = planners.plan(space, *query, planner="Lattice", time_limit=20.0, **options)
                assert plan.certified == bool(plan), plan.status
                as_short.append(bool(plan) and weighted_length(plan) <= 1.15 * best + 1e-9)
    assert len(as_short) > 20
    assert np.mean(as_short) > 0.9


@EVERY_DRIVE
def test_the_lattice_is_the_default_and_repeats_its_path(options):
    query = build_room("turning"), *ENDPOINTS["turning"]
    plan = planners.plan(*query, time_limit=20.0, **options)
    again = planners.plan(*query, planner="lattice", time_limit=20.0, **options)
    assert plan.certified and plan.planner == "Lattice"
    np.testing.assert_array_equal(plan.waypoints, again.waypoints)


# ---- failures ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def dead_end():
    """Build a room with a corridor too narrow to turn in, which ends at a wall."""
    occupied = fill_boxes((80, 40), np.s_[:50, :15], np.s_[:50, 20:])
    return build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.6, 0.3), rotations=72)


OUT = (1.0, 1.75, math.pi - 1e-3), (6.5, 1.75, 0.0)
"""A query that only robots which reverse can drive in the dead end."""


@EVERY_DRIVE
def test_the_lattice_leaves_a_dead_end_as_the_drive_may(dead_end, options):
    reverses = options["drive"].reverse
    plan = planners.plan(dead_end, *OUT, time_limit=1000.0, planner="Lattice", **options)
    assert bool(plan) == plan.certified == reverses
    if reverses:
        return
    assert "; the lattice search reached no more nodes; one exists for a robot" in plan.status
    reversing = replace(options["drive"], reverse=True)
    assert plan.hint == f"drive=planners.{reversing}, which finds a path"
    late = planners.plan(dead_end, *OUT, planner="Lattice", time_limit=1e-6, **options)
    assert "no path found within" in late.status and "nodes" not in late.status


def test_ompl_takes_over_when_the_lattice_finds_nothing(monkeypatch):
    monkeypatch.setattr(
        sys.modules["planners._searches.lattice"],
        "find_lattice_path",
        lambda *_: (np.empty((0, 3)), "the lattice gave up"),
    )
    query = build_room("turning"), *ENDPOINTS["turning"]
    plan = planners.plan(*query, drive=planners.Differential(), seed=1, time_limit=20.0)
    assert plan.certified and plan.status == "path found: by RRTConnect, as Lattice found none"
    named = planners.plan(*query, drive=planners.Differential(), planner="Lattice")
    assert not named and "the lattice gave up" in named.status


# ---- parking -------------------------------------------------------------------------------------


def test_a_search_from_the_goal_still_drives_ahead_on_a_long_way():
    obstacles, (_, goal) = make_perpendicular_slot(1.3)
    street = [*obstacles[:-1], shapely.box(7, 6, 20, 101)]
    workspace = Workspace.from_polygons(street, 0.2, (-0.5, -5.6, 18.5, 100))
    space = build(workspace, Robot.polygon(CAR), rotations=72)
    start = (2.5, 95.0, -0.5 * math.pi)
    options = {"drive": planners.Car(turning_radius=2.5, reverse=True), "time_limit": 20.0}
    plan = planners.plan(space.exact, start, goal, **options)
    steps = np.linalg.norm(np.diff(plan.path[:, :2], axis=0), axis=1)
    assert steps[plan.direction[1:] < 0].sum() < 0.1 * plan.length


@pytest.mark.parametrize("radius", few([4.0, 6.0]))
@pytest.mark.parametrize("share", few([1.18, 1.3]))
@pytest.mark.parametrize("make_slot", [make_parallel_slot, make_perpendicular_slot])
def test_cars_park_in_tight_slots_on_coarse_maps(make_slot, share, radius):
    obstacles, query = make_slot(share)
    workspace = Workspace.from_polygons(obstacles, 0.05, PARKING_BOUNDS)
    space = build(workspace, Robot.polygon(CAR), rotations=72)
    options = {"drive": planners.Car(turning_radius=radius, reverse=True), "time_limit": 20.0}
    for start, goal in (query, query[::-1]):
        plan = planners.plan(space.exact, start, goal, **options)
        assert plan.certified and plan.recheck().all() and plan.planner == "Lattice"
        np.testing.assert_array_equal(plan.waypoints[[0, -1]], [start, goal])


@pytest.mark.parametrize("drive", ["differential", "differential-reverse"])
def test_lattice_passes_a_crate_close_to_a_wall_with_the_default_work(drive):
    """Among headings far apart, none lets the robot come as close to the wall as it has to."""
    occupied = np.zeros((60, 375), dtype=bool)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    notched = shapely.Polygon([(-0.45, -0.3), (0.45, -0.3), (0.3, 0.0), (0.45, 0.3), (-0.45, 0.3)])
    space = build(Workspace.from_array(occupied, 0.04), Robot.polygon(notched), rotations=72)
    options = {"planner": "Lattice", "drive": make_drive(drive)}
    ends = (1.2, 13.5, -1.57), (1.2, 2.0, -1.0)
    space.add_obstacle("crate", shapely.box(0.86, 6.0, 1.58, 7.0))
    plan = planners.plan(space, *ends, **options)
    assert plan.certified
    assert plan.length < 12.0


@pytest.mark.parametrize(
    "center, side", [((0.0, 0.0), 5), ((0.15, 0.0), 4), ((0.35, 0.0), 2), ((0.6, 0.0), 1)]
)
def test_blocks_of_the_guide_are_as_large_as_the_robot_lets_walls_be(center, side):
    occupied = np.zeros((120, 100), dtype=bool)
    occupied[60, :70] = True  # a wall of one cell
    workspace = Workspace.from_array(occupied, 0.05)
    space = build(workspace, Robot.rectangle(0.6, 0.6, center), rotations=24)
    assert _measure_block_side(space) == side
    start, goal = (1.5, 1.5, 0.5 * math.pi), (4.5, 1.5, -0.5 * math.pi)
    plan = planners.plan(space, start, goal, drive=planners.Differential(), time_limit=30.0)
    assert plan.certified
