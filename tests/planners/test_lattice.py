"""The search on a lattice of headings: proofs, lengths, failures, parking, and the map of an
office."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
import shapely

import planners
from benchmarks.inputs import CAR, PARKING_BOUNDS, make_parallel_slot, make_perpendicular_slot
from cspace import Robot, Workspace, build
from planners._searches.lattice import _measure_block_side
from tests.helpers.drives import make_drive
from tests.helpers.handmade import fill_boxes
from tests.helpers.planning import (
    ENDPOINTS,
    build_room,
)
from tests.helpers.strategies import few

SPOT_DRIVES = [{"drive": planners.Differential()}, {"drive": planners.Differential(reverse=True)}]
CAR_DRIVES = [
    {"drive": planners.Car(turning_radius=0.3)},
    {"drive": planners.Car(turning_radius=0.3, reverse=True)},
]
EVERY_DRIVE = pytest.mark.parametrize("options", [*SPOT_DRIVES, *CAR_DRIVES], ids=str)


def test_a_car_parks_in_a_real_lot(data):
    file = data / "polygons" / "parking1.geojson"
    car = Robot.open(data / "polygons" / "car.geojson")
    space = build(Workspace.open(file, spacing=0.15), car, rotations=72)
    ends = (4.03, -2.6, math.pi / 2.0), (9.9, -12.0, -math.pi / 2.0)
    options = {"drive": planners.Car(turning_radius=3.0, reverse=True), "time_limit": 20.0}
    plan = planners.plan(space, *ends, **options)
    assert plan.certified and plan.planner == "Lattice"


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
