"""Results of plans: distances, proofs, text, pictures and files."""

import copy
import csv
import json
import math
import pickle
import re
import time
from dataclasses import fields

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
import planners
from cspace import BLOCKED, FREE, MIXED, FileError, Robot
from cspace.errors import InputError
from planners._edges.drives import local_planner
from tests.helpers.drives import make_drive
from tests.helpers.handmade import build_empty, make_map
from tests.helpers.placements import obstacles_of, place_robots
from tests.helpers.planning import (
    ENDPOINTS,
    SPACES_WITH_CURVES,
    build_halves,
    build_room,
    min_distance,
    options_for,
    wrap_rotations,
)
from tests.helpers.strategies import seeds


def plan_in(name, curve):
    """Plan in a room."""
    options = options_for(curve)
    return planners.plan(build_room(name), *ENDPOINTS[name], seed=4, time_limit=20.0, **options)


# ---- clearance along a path ----------------------------------------------------------------------


@given(seeds, st.sampled_from(SPACES_WITH_CURVES))
def test_the_clearance_of_a_path_bounds_the_clearance_of_its_points(seed, case):
    name, curve = case
    space = build_room(name)
    dim = space.grid.dim
    edges = local_planner(space, make_drive(curve))
    rng = np.random.default_rng(seed)
    first = space.sample_free(rng=rng)
    path = wrap_rotations(space, first + rng.uniform(-0.3, 0.3, (3, len(first))))
    bound = edges.clearance(path)
    points = edges.split_path(path, 0.01, 0.01).points
    if not space.grid.contains(points[:, :dim]).all():
        assert bound == 0.0
    elif space.size == dim:
        least = min_distance(space, points)
        assert max(0.0, least - 2.3 * space.grid.spacing) <= bound <= least
    else:
        assert bound <= space.clearance(points).min() + 1.5 * space.grid.spacing


# ---- distance from obstacles ---------------------------------------------------------------------


def test_distances_follow_the_map_and_pickles_keep_the_clearance(tmp_path):
    space = build_empty((80, 80), Robot.disc(0.2), outside="free")
    plan = planners.plan(space, (1.0, 4.0), (7.0, 4.0))
    before = pickle.loads(pickle.dumps(plan))
    assert before.clearance == plan.clearance == plan.obstacle_distance == math.inf
    plan.to_json(tmp_path / "plan.json")
    assert json.loads((tmp_path / "plan.json").read_text())["clearance"] is None
    space.add_obstacle("ball", shapely.Point(4.0, 5.2).buffer(0.3))
    assert 0.4 < plan.clearance < plan.obstacle_distance < 0.7
    for again in (pickle.loads(pickle.dumps(plan)), copy.deepcopy(plan)):
        assert again.space is None and math.isnan(again.obstacle_distance)
        assert again.clearance == plan.clearance
    space.add_obstacle("ball", shapely.Point(4.0, 4.2).buffer(0.3))
    assert plan.clearance == plan.obstacle_distance == 0.0 and before.clearance == math.inf


@pytest.mark.parametrize(
    "drive",
    [planners.Car(0.5, reverse=True, max_lateral_acceleration=1.0), planners.Differential()],
)
def test_the_drive_of_a_record_can_be_passed_again(drive, tmp_path):
    space = build_empty((40, 30), Robot.rectangle(0.3, 0.2), rotations=8)
    plan = planners.plan(space, (1.0, 1.0, 0.0), (2.0, 1.0, 0.0), drive=drive)
    plan.to_json(tmp_path / "plan.json")
    written = json.loads((tmp_path / "plan.json").read_text())["drive"]
    assert getattr(planners, written.pop("type"))(**written) == drive


# ---- proofs --------------------------------------------------------------------------------------


def test_repr_tells_if_the_proof_still_holds():
    space = build_empty((40, 30), Robot.disc(0.3))
    plan = planners.plan(space, (1.0, 1.5), (3.0, 1.5))
    assert ", certified; 2.000 m\n" in repr(plan)
    assert plan.obstacle_distance == pytest.approx(0.7)
    space.add_obstacle("cart", shapely.box(1.8, 1.3, 2.2, 1.7))
    assert ", certified when planned, 1 of 1 edges no longer proven free; 2.000 m" in repr(plan)
    assert plan.obstacle_distance == 0.0
    assert plan.certified
    again = pickle.loads(pickle.dumps(plan))
    assert "certified when planned; " in repr(again) and not again.recheck(space).any()
    with pytest.raises(InputError, match="plan has no path"):
        planners.plan(*build_halves("plane", BLOCKED)).recheck()


# ---- text and files ------------------------------------------------------------------------------


@pytest.mark.parametrize("curve", [None, "reeds-shepp"])
def test_plans_are_written_exactly_and_files_are_kept(curve, tmp_path):
    plan = plan_in("turning", curve)
    table, record = tmp_path / "path.csv", tmp_path / "plan.json"
    plan.to_csv(table)
    names, *rows = csv.reader(table.read_text().splitlines())
    assert names == [*plan.axes, *(["direction"] if curve else [])]
    columns = np.array(rows, dtype=float).T
    np.testing.assert_array_equal(columns[:3].T, plan.path)
    assert curve is None or np.array_equal(columns[3], plan.direction)
    plan.to_json(record)
    written = json.loads(record.read_text())
    computed = {"clearance", "obstacle_distance", "lower_bound", "gap"}
    stored = {field.name for field in fields(plan) if not field.name.startswith("_")} - {"space"}
    assert set(written) == stored | computed
    assert planners.Times(**written.pop("times")) == plan.times
    car = {"type": "Car", "turning_radius": 0.4, "reverse": True, "max_lateral_acceleration": None}
    car |= {"reverse_cost": 1.0, "switch_cost": 0.0}
    assert written.pop("drive") == (car if curve else None)
    for key, value in written.items():
        np.testing.assert_array_equal(value, getattr(plan, key))
    for write, file in ((plan.to_csv, table), (plan.to_json, record)):
        file.write_text("mine")
        with pytest.raises(FileError, match="overwrite=True"):
            write(file)
        assert file.read_text() == "mine"
        write(file, overwrite=True)
        assert file.read_text() != "mine"
    with pytest.raises(ValueError):
        plan.path[0, 0] = 3.0


def test_a_plan_without_a_path_writes_no_table(tmp_path):
    plan = planners.plan(*build_halves("plane", BLOCKED))
    with pytest.raises(InputError, match="plan has no path"):
        plan.to_csv(tmp_path / "path.csv")
    assert not list(tmp_path.iterdir())


def test_a_notebook_shows_a_plan_as_its_picture_and_as_text_without_its_map():
    plan = planners.plan(build_empty((40, 30), Robot.disc(0.3)), (1.0, 1.5), (3.0, 1.5))
    assert plan._repr_png_() == vars(plan.plot())["_repr_png_"]()
    assert copy.copy(plan)._repr_png_() is None


def test_a_plan_is_printed_without_rounding_errors():
    space = build_empty((40, 30), cspace.Robot.disc(0.1))
    text = repr(planners.plan(space, (0.72 + 0.1, 2 / 3), (3.33, 1.62)))
    assert "from (0.82, 0.666666667) to (3.33, 1.62)" in text


@pytest.mark.parametrize("drive", ["holonomic", "differential", "dubins", "reeds-shepp"])
def test_the_obstacle_distance_is_the_minimum_along_the_path(drive):
    plan = plan_in("turning", drive)
    grid = plan.space.grid
    edges = local_planner(plan.space, plan.drive)
    dense = edges.split_path(plan.waypoints, 0.02, 0.05)
    robots = place_robots(plan.space.robot, dense.points)
    minimum = shapely.distance(robots, obstacles_of(plan.space)).min()
    # The distance changes by that much between samples.
    between = 0.5 * float((dense.lengths + 0.4 * dense.rotations).max())
    least = minimum - between - 0.25 * grid.spacing - 1e-6
    assert least <= plan.obstacle_distance <= minimum + 1e-6
    if drive in ("holonomic", "differential"):
        assert least <= plan.space.path_obstacle_distance(plan.path) <= minimum + 1e-6
    assert plan.obstacle_distance > plan.clearance or plan.clearance == 0.0


@pytest.mark.parametrize("drive", ["holonomic", "differential", "dubins", "reeds-shepp"])
def test_recheck_proves_each_edge_among_the_current_obstacles(drive):
    # Edges proven free are free at every row; the edge with an obstacle is not.
    plan = plan_in("turning", drive)
    assert plan.recheck().all() and plan.recheck().shape == (len(plan.waypoints) - 1,)
    space = copy.deepcopy(plan.space)
    rows = [plan.path.tolist().index(q) for q in plan.waypoints.tolist()]
    longest = int(np.diff(rows).argmax())
    post = plan.path[rows[longest] + 1, :2] / 2 + plan.path[rows[longest + 1] - 1, :2] / 2
    if drive != "holonomic":
        post = plan.path[(rows[longest] + rows[longest + 1]) // 2, :2]
    space.add_obstacle("post", [post], radius=0.05)
    free = plan.recheck(space)
    assert free.dtype == np.bool_ and not free[longest]
    for is_free, first, last in zip(free, rows, rows[1:], strict=False):
        assert not is_free or space.is_free(plan.path[first : last + 1]).all()
    assert plan.certified and plan.recheck().all()  # the plan's map has no post
    space.remove_obstacle("post")
    assert plan.recheck(space).all()


CONFIGURATION = re.compile(r"\(([-+.e\d]+(?:, [-+.e\d]+)+)\)")


def read_configurations(text):
    """Return the configurations in a text."""
    return [tuple(map(float, numbers.split(", "))) for numbers in CONFIGURATION.findall(text)]


@pytest.mark.parametrize("spacing", [0.01, 0.1])
def test_start_and_goal_of_a_printed_plan_are_taken_when_typed_back(spacing):
    states = np.full((1, 41, 9), FREE, dtype=np.uint8)
    states[0, 20] = MIXED
    space = make_map(states, "plane", "blocked", spacing)
    start = (20.0 * spacing - 1e-6, 4.5 * spacing)
    for goal in ((21.0 * spacing + 1e-7, 4.5 * spacing), (spacing, spacing)):
        plan = planners.plan(space, start, goal)
        first, last = read_configurations(repr(plan))[:2]  # a reason may name places after them
        assert bool(planners.plan(space, first, last)) == bool(plan)
        without_map = pickle.loads(pickle.dumps(plan))
        printed = read_configurations(repr(without_map))
        np.testing.assert_allclose(printed, [plan.start, plan.goal], rtol=0.0, atol=1e-9)


def test_times_add_up_to_the_time_that_passes():
    class SlowStart:
        def __array__(self, dtype=None, copy=None):
            time.sleep(0.3)
            return space.sample_free(rng=np.random.default_rng(1))

    space = plan_in("turning", "holonomic").space
    before = time.monotonic()
    plan = planners.plan(space, SlowStart(), space.sample_free(rng=np.random.default_rng(2)))
    total = time.monotonic() - before
    times = plan.times
    assert times.setup + times.planning + times.checking <= total
