"""Hints of planners: each is followed by code, and gives a path or an accepted call."""

import ast
import math
import re

import numpy as np
import pytest
import shapely

import planners
from cspace import ConfigurationError, CspaceError, InputError, Robot, Workspace, build
from planners import ClearanceObjective
from tests.helpers.planning import ENDPOINTS, build_open_map, build_room
from tests.helpers.refusals import refusals


def build_walls(boxes, robot, rotations=None, **options):
    """Build the map of a robot among walls in a room of 6 m by 4 m, with cells of 0.1 m."""
    walls = [shapely.box(*box) for box in boxes]
    workspace = Workspace.from_polygons(walls, 0.1, bounds=(0.0, 0.0, 6.0, 4.0))
    return build(workspace, robot, rotations=rotations, **options)


def follow(hint, options):
    """Return the options of a plan after the first advice of its hint."""
    advice = re.split(", which finds|, or ", hint)[0]
    changes = dict(re.findall(r"(\w+)=('[^']*'|[\w.+-]+)", advice))
    options = options | {name: ast.literal_eval(text) for name, text in changes.items()}
    if "default planner" in advice:
        del options["planner"]
    if "without iterations" in advice:
        del options["iterations"]
    return options


def make_clearance(si):
    """Make the objective that keeps away from obstacles."""
    return ClearanceObjective(si, build_walls(*DISC))


CORRIDOR = (2.0, 0.0, 3.0, 1.74), (2.0, 2.26, 3.0, 4.0)
"""Walls with a gap of 0.52 m between them, which cells of 0.1 m leave undecided."""

BAY = (3.0, 0.0, 3.2, 1.6), (4.0, 0.0, 4.2, 1.6), (3.0, 0.0, 4.2, 0.1)
"""Walls of a bay, in which a robot cannot turn around."""

AHEAD = (1.0, 2.0, 0.0), (5.0, 2.0, 0.0)
KEEP_AWAY = {"objective": make_clearance, "planner": "RRTstar", "time_limit": 60.0}
OUT_OF_BAY = (1.0, 3.0, 0.0), (3.6, 0.8, math.pi / 2.0)
"""From the room into the bay, to face out."""

SQUARE = Robot.rectangle(0.5, 0.5)
DISC = BAY, Robot.disc(0.2), None
BAY_CART = BAY, Robot.rectangle(0.8, 0.3), 72


@pytest.mark.parametrize(
    ("place", "ends", "options", "hint"),
    [
        (BAY_CART, OUT_OF_BAY, {"drive": "differential"}, "drive='differential-reverse', which"),
        (
            BAY_CART,
            OUT_OF_BAY,
            {"drive": "dubins", "turning_radius": 0.5, "planner": "RRT"},
            "drive='reeds-shepp' with the default planner, which finds a path",
        ),
        ((CORRIDOR, SQUARE, None), AHEAD, {}, "exact=True, which finds a path"),
        ((CORRIDOR, SQUARE, 72), AHEAD, {}, "exact=True, which finds a path"),
        ((CORRIDOR, SQUARE, None), AHEAD, {"planner": "BITstar"}, "exact=True, which"),
        (
            (CORRIDOR, SQUARE, None),
            AHEAD,
            {"planner": "MaxClearance"},
            "exact=True with the default planner, which finds a path",
        ),
        (
            (CORRIDOR, SQUARE, 72),
            AHEAD,
            {"drive": "differential", "planner": "Lattice"},
            "exact=True with the default planner, which finds a path",
        ),
        # The robot passes sideways through FREE cells, but drives ahead only by the geometry.
        (
            (CORRIDOR, Robot.rectangle(0.3, 0.5), 72),
            AHEAD,
            {"drive": "dubins", "turning_radius": 0.5, "time_limit": 5.0},
            "exact=True, which finds a path",
        ),
        # Neither is enough without the other.
        (
            ((*BAY, (2.0, 0.0, 2.2, 2.78), (2.0, 3.22, 2.2, 4.0)), BAY_CART[1], 72),
            OUT_OF_BAY,
            {"drive": "differential", "time_limit": 5.0},
            "exact=True with drive='differential-reverse', which finds a path",
        ),
        (DISC, AHEAD, {"planner": "RRT", "iterations": 1}, "planner='Grid' without iterations, wh"),
        (DISC, AHEAD, {"planner": "RRT", "time_limit": 1e-6}, "planner='Grid', which finds one"),
        (DISC, AHEAD, {"iterations": 1}, "planner='Grid' without iterations, which finds one"),
        (DISC, AHEAD, {**KEEP_AWAY, "iterations": 1}, "more iterations (it"),
    ],
)
def test_the_advice_of_a_failed_plan_gives_a_path(place, ends, options, hint):
    space = build_walls(*place)
    start, goal = (end[: space.size] for end in ends)
    options = {"seed": 1} | options
    plan = planners.plan(space, start, goal, **options)
    assert not plan.solved and plan.hint.startswith(hint), plan
    assert f"try {plan.hint}" in str(plan)
    assert planners.plan(space, start, goal, **follow(plan.hint, options)).certified


# ---- hints that change the map -------------------------------------------------------------------


@pytest.mark.parametrize("exact", [False, True])
def test_the_smaller_robot_that_explain_names_passes_a_corridor_as_wide_as_the_robot(exact):
    walls = (2.0, 0.0, 3.0, 1.75), (2.0, 2.25, 3.0, 4.0)
    options = {"exact": exact, "time_limit": 0.2, "seed": 1}
    ends = [end[:2] for end in AHEAD]
    plan = planners.plan(build_walls(walls, SQUARE), *ends, **options)
    assert not plan.solved and plan.hint.startswith("a smaller robot (see plan.explain())")
    side = 0.5 + 2.0 * plan.explain().margin[0]
    smaller = build_walls(walls, Robot.rectangle(side, side))
    assert planners.plan(smaller, *ends, **options).certified


def test_wider_bounds_give_a_path_around_a_wall_in_an_open_map():
    ends = [end[:2] for end in AHEAD]
    wall = [shapely.box(2.0, 0.0, 3.0, 4.0)]
    for bounds, is_solved in (((0, 0, 6, 4), False), ((0, 0, 6, 6), True)):
        workspace = Workspace.from_polygons(wall, 0.1, bounds=bounds)
        plan = planners.plan(build(workspace, Robot.disc(0.2), outside="free"), *ends)
        assert plan.solved == is_solved
        assert plan.hint.startswith("a workspace with wider bounds") != is_solved


def test_a_finer_spacing_gives_a_path_of_cells_where_the_geometry_is_not_tried():
    walls = [shapely.box(*box) for box in CORRIDOR]
    ends = [end[:2] for end in AHEAD]
    for spacing, is_solved in ((0.1, False), (0.005, True)):
        workspace = Workspace.from_polygons(walls, spacing, bounds=(0.0, 0.0, 6.0, 4.0))
        plan = planners.plan(build(workspace, SQUARE), *ends, objective="clearance")
        assert plan.solved == is_solved
        assert ("a finer spacing" in plan.hint) != is_solved


def test_a_smaller_turning_radius_gives_a_path():
    space = build_walls((), Robot.rectangle(0.6, 0.3), 72)
    ends = (1.0, 2.0, 0.0), (5.0, 2.0, math.pi)
    options = {"drive": "dubins", "time_limit": 0.2, "seed": 1}
    plan = planners.plan(space, *ends, turning_radius=60.0, **options)
    assert not plan.solved and "a smaller turning_radius" in plan.hint
    assert planners.plan(space, *ends, turning_radius=0.5, **options).certified


def test_more_time_gives_a_path():
    space = build_room("plane")
    options = {"planner": "Grid", "time_limit": 1e-7}
    plan = planners.plan(space, *ENDPOINTS["plane"], **options)
    while not plan.solved and options["time_limit"] < 100.0:
        assert plan.hint == f"more time (time_limit={10 * options['time_limit']:g})"
        options = follow(plan.hint, options)
        plan = planners.plan(space, *ENDPOINTS["plane"], **options)
    assert plan.certified


# ---- start and goal ------------------------------------------------------------------------------


def test_an_end_in_an_undecided_cell_is_accepted_with_exact_if_it_is_free():
    space = build_walls(CORRIDOR, SQUARE, 72)
    for ends in ((AHEAD[0], (2.5, 2.0, 0.0)), ((2.5, 2.0, 0.0), AHEAD[0])):
        with pytest.raises(ConfigurationError, match="MIXED cell; .*; pass exact=True, which"):
            planners.plan(space, *ends)
        assert planners.plan(space, *ends, exact=True).certified


@pytest.mark.parametrize("rotations", [None, 12, 360])
def test_an_end_in_collision_is_said_to_be_and_the_nearest_is_accepted(rotations):
    # The middle of the robot lies over an obstacle too thin to fill a cell.
    space = build_walls([(2.5, 0.0, 2.52, 2.2)], SQUARE, rotations)
    ends = np.array([(2.6, 2.0, 0.1), AHEAD[1]])[:, : space.size]
    for exact in (False, True):
        with pytest.raises(ConfigurationError, match="is in collision or too close") as caught:
            planners.plan(space, *ends, exact=exact)
        hint = caught.value.hint
        assert "rotations" not in hint and "exact" not in hint
        nearest = ast.literal_eval(hint.removeprefix("the nearest is "))
        assert planners.plan(space, nearest, ends[1], exact=exact).certified
