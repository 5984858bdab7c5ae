"""Hints of planners: each is followed by code, and gives a path or an accepted call."""

import ast
import copy
import math
import re
from functools import cache

import numpy as np
import pytest
import shapely
from ompl import base as ob

import cspace
import planners
from cspace import ConfigurationError, InputError, Robot, Workspace, build
from cspace.inside import Drive
from tests.helpers.planning import ENDPOINTS, build_room
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.spaces import Disc
from tests.helpers.strategies import few
from tests.helpers.urdfs import planar_arm, pose_at
from tests.planners.test_own_space import START


def build_walls(boxes, robot, rotations=None, **options):
    """Build the map of a robot among walls in a room of 6 m by 4 m, with cells of 0.1 m."""
    walls = [shapely.box(*box) for box in boxes]
    workspace = Workspace.from_polygons(walls, 0.1, bounds=(0.0, 0.0, 6.0, 4.0))
    return build(workspace, robot, rotations=rotations, **options)


def follow(space, hint, options):
    """Return the space and the options of a plan after the first advice of its hint."""
    advice = re.split(", which finds|, or ", hint)[0]
    changes = dict(re.findall(r"(?<!\()\b(\w+)=(planners\.\w+\([^)]*\)|'[^']*'|[\w.+-]+)", advice))
    options = options | {name: eval(text) for name, text in changes.items()}
    if "default planner" in advice:
        del options["planner"]
    return space.exact if advice.startswith("space.exact") else space, options


CORRIDOR = (2.0, 0.0, 3.0, 1.74), (2.0, 2.26, 3.0, 4.0)
"""Walls with a gap of 0.52 m between them, which cells of 0.1 m leave undecided."""

BAY = (3.0, 0.0, 3.2, 1.6), (4.0, 0.0, 4.2, 1.6), (3.0, 0.0, 4.2, 0.1)
"""Walls of a bay, in which a robot cannot turn around."""


class HoverDrive(Drive):
    """A drive without edges."""


AHEAD = (1.0, 2.0, 0.0), (5.0, 2.0, 0.0)
OUT_OF_BAY = (1.0, 3.0, 0.0), (3.6, 0.8, math.pi / 2.0)
"""From the room into the bay, to face out."""

SQUARE = Robot.rectangle(0.5, 0.5)
DISC = BAY, Robot.disc(0.2), None
BAY_CART = BAY, Robot.rectangle(0.8, 0.3), 72


@pytest.mark.parametrize(
    "place, ends, options, hint",
    few(
        [
            (
                BAY_CART,
                OUT_OF_BAY,
                {"drive": planners.Differential()},
                "drive=planners.Differential(reverse=True), which",
            ),
            (
                BAY_CART,
                OUT_OF_BAY,
                {"drive": planners.Car(turning_radius=0.5), "planner": "RRT", "time_limit": 0.3},
                "drive=planners.Car(turning_radius=0.5, reverse=True) with the default planner, which finds a path",
            ),
            ((CORRIDOR, SQUARE, None), AHEAD, {}, "space.exact, which finds a path"),
            ((CORRIDOR, SQUARE, 72), AHEAD, {}, "space.exact, which finds a path"),
            ((CORRIDOR, SQUARE, None), AHEAD, {"planner": "BITstar"}, "space.exact, which"),
            (
                (CORRIDOR, SQUARE, None),
                AHEAD,
                {"planner": "Grid"},
                "space.exact with the default planner, which finds a path",
            ),
            (
                (CORRIDOR, SQUARE, 72),
                AHEAD,
                {"drive": planners.Differential(), "planner": "Lattice"},
                "space.exact, which finds a path",
            ),
            # The robot passes sideways through FREE cells, but drives ahead only by the geometry.
            (
                (CORRIDOR, Robot.rectangle(0.3, 0.5), 72),
                AHEAD,
                {"drive": planners.Car(turning_radius=0.5), "time_limit": 5.0},
                "space.exact, which finds a path",
            ),
            # Neither is enough without the other.
            (
                ((*BAY, (2.0, 0.0, 2.2, 2.78), (2.0, 3.22, 2.2, 4.0)), BAY_CART[1], 72),
                OUT_OF_BAY,
                {"drive": planners.Differential(), "time_limit": 5.0},
                "space.exact with drive=planners.Differential(reverse=True), which finds a path",
            ),
            (
                DISC,
                AHEAD,
                {"planner": planners.Search("RRT", iterations=1)},
                "planner='Grid', which finds one",
            ),
            (
                DISC,
                AHEAD,
                {"planner": "RRT", "time_limit": 1e-6},
                "planner='Grid', which finds one",
            ),
            (
                DISC,
                AHEAD,
                {"planner": planners.Search(iterations=1)},
                "planner='Grid', which finds one",
            ),
        ],
        3,
    ),
)
def test_the_advice_of_a_failed_plan_gives_a_path(place, ends, options, hint):
    space = build_walls(*place)
    start, goal = (end[: space.size] for end in ends)
    options = {"seed": 1} | options
    plan = planners.plan(space, start, goal, **options)
    assert not plan and plan.hint.startswith(hint), plan
    assert f"try {plan.hint}" in str(plan)
    space, options = follow(space, plan.hint, options)
    assert planners.plan(space, start, goal, **options).certified


@pytest.mark.parametrize("rotations", [None, 72])
@pytest.mark.parametrize("options", [{"planner": "Grid"}, {"objective": "clearance"}])
def test_the_geometry_proves_a_path_where_no_free_cells_are_clear(rotations, options):
    space = build_walls(CORRIDOR, SQUARE, rotations)
    for ends in (AHEAD, ((2.5, 2.0, 0.0), AHEAD[1]), (AHEAD[0], (2.5, 2.0, 0.0))):
        ends = [end[: space.size] for end in ends]
        assert planners.plan(space.exact, *ends, **options).certified
    beside = [(1.5, y, 0.0)[: space.size] for y in (1.0, 3.0)]
    plans = [planners.plan(each, *beside, **options) for each in (space, space.exact)]
    assert plans[0].waypoints.tolist() == plans[1].waypoints.tolist()
    assert all(plan.certified for plan in plans)


# ---- hints that change the map -------------------------------------------------------------------


@pytest.mark.parametrize("exact", [False, True])
def test_the_smaller_robot_that_explain_names_passes_a_corridor_as_wide_as_the_robot(exact):
    walls = (2.0, 0.0, 3.0, 1.75), (2.0, 2.25, 3.0, 4.0)
    options = {"time_limit": 0.2, "seed": 1}
    ends = [end[:2] for end in AHEAD]
    space = build_walls(walls, SQUARE)
    plan = planners.plan(space.exact if exact else space, *ends, **options)
    assert not plan and plan.hint.startswith("what plan.explain() names")
    side = 0.5 + 2.0 * plan.explain().margin[0]
    smaller = build_walls(walls, Robot.rectangle(side, side))
    assert planners.plan(smaller, *ends, **options).certified


@pytest.mark.parametrize("rotations", few([None, 36]))
def test_no_smaller_robot_is_advised_in_a_room_that_walls_of_a_cell_close(rotations):
    walls = [shapely.box(1.0, 1.0, 4.5, 3.0).exterior.buffer(0.06, join_style="mitre")]
    workspace = Workspace.from_polygons(walls, 0.1, bounds=(0.0, 0.0, 6.0, 4.0))
    ends = (2.75, 2.05, 0.0), (5.25, 2.05, 0.0)
    ends = [end[: 3 if rotations else 2] for end in ends]
    for side in (0.6, 0.02):
        space = build(workspace, Robot.rectangle(side, side), rotations=rotations)
        plan = planners.plan(space, *ends)
        assert not plan and not plan.is_disconnected
        assert "plan.explain()" in plan.hint and "smaller" not in plan.hint
    assert "No shrinking" in str(plan.explain())


def test_wider_bounds_give_a_path_around_a_wall_in_an_open_map():
    ends = [end[:2] for end in AHEAD]
    wall = [shapely.box(2.0, 0.0, 3.0, 4.0)]
    for bounds, is_solved in (((0, 0, 6, 4), False), ((0, 0, 6, 6), True)):
        workspace = Workspace.from_polygons(wall, 0.1, bounds=bounds)
        plan = planners.plan(build(workspace, Robot.disc(0.2), outside="free"), *ends)
        assert bool(plan) == is_solved
        assert plan.hint.startswith("a workspace with wider bounds") != is_solved


def test_a_finer_spacing_gives_a_path_of_cells_where_the_geometry_is_not_tried(tmp_path):
    walls = [shapely.box(2.0, 0.0, 3.0, 1.7), shapely.box(2.0, 2.3, 3.0, 4.0)]
    ends = [end[:2] for end in AHEAD]
    for spacing, is_solved in ((0.1, False), (0.02, True)):
        workspace = Workspace.from_polygons(walls, spacing, bounds=(0.0, 0.0, 6.0, 4.0))
        tiled = build(workspace, SQUARE, store=tmp_path / f"{spacing}.zarr")
        plan = planners.plan(tiled, *ends, objective="clearance")
        assert bool(plan) == is_solved
        assert ("a finer spacing" in plan.hint) != is_solved


def test_a_window_of_a_tiled_map_is_planned_on_with_exact(tmp_path):
    tiled = build_walls(CORRIDOR, SQUARE, store=tmp_path / "tiles.zarr", tile=16)
    ends = [end[:2] for end in AHEAD]
    plan = planners.plan(tiled, *ends, planner="RRTConnect")
    assert plan.hint.startswith(
        "space.exact with the default planner on space.window(lower, upper)"
    )
    window = tiled.window((0.5, 0.5), (5.5, 3.5))
    assert planners.plan(window.exact, *ends).certified
    with pytest.raises(ConfigurationError, match=r"MIXED cell; .*proven collision-free; the near"):
        planners.plan(tiled, ends[0], (2.5, 2.0))


def test_a_smaller_turning_radius_gives_a_path():
    space = build_walls([(0.0, 0.0, 0.1, 0.1)], Robot.rectangle(0.6, 0.3), 72)
    ends = (1.0, 2.0, 0.0), (5.0, 2.0, math.pi)
    options = {"time_limit": 0.2, "seed": 1}
    plan = planners.plan(space, *ends, drive=planners.Car(turning_radius=100.0), **options)
    assert not plan and "a smaller turning_radius" in plan.hint
    smaller = planners.Car(turning_radius=0.5)
    assert planners.plan(space, *ends, drive=smaller, **options).certified


def test_more_iterations_give_a_path():
    space = build_room("turning")
    options = {
        "planner": planners.Search("RRT", iterations=1),
        "drive": planners.Differential(),
        "seed": 1,
    }
    plan = planners.plan(space, *ENDPOINTS["turning"], **options)
    assert plan.hint.startswith("more iterations by planner=planners.Search(")
    for _ in range(6):
        if not plan:
            _, options = follow(space, plan.hint, options)
            plan = planners.plan(space, *ENDPOINTS["turning"], **options)
    assert plan.certified


# ---- start and goal ------------------------------------------------------------------------------


@pytest.mark.parametrize("rotations", [None, 12, 360])
def test_an_end_in_collision_is_said_to_be_and_the_nearest_is_accepted(rotations):
    # The middle of the robot lies over an obstacle too thin to fill a cell.
    space = build_walls([(2.5, 0.0, 2.52, 2.2)], SQUARE, rotations)
    ends = np.array([(2.6, 2.0, 0.1), AHEAD[1]])[:, : space.size]
    for exact in (False, True):
        with pytest.raises(ConfigurationError, match="is in collision or too close") as caught:
            planners.plan((space.exact if exact else space), *ends)
        hint = caught.value.hint
        assert "rotations" not in hint and "exact" not in hint
        nearest = ast.literal_eval(hint.removeprefix("the nearest is "))
        assert planners.plan((space.exact if exact else space), nearest, ends[1]).certified


# ---- refused arguments ---------------------------------------------------------------------------

CAR = {"drive": planners.Car(turning_radius=0.4)}


def penalize(name, weight):
    """Make an objective that penalizes small clearances on a map."""
    objective = planners.ClearanceObjective(weight, 0.5)
    return planners.simple_setup(build_room(name), objective=objective)


def make_objective(si):
    """Make an objective of OMPL."""
    return ob.PathLengthOptimizationObjective(si)


@refusals(
    "name, options, hint",
    (
        "plane",
        {"objective": make_objective},
        "objective is a function and no planner is named ... take",
    ),
    ("plane", {"planner": "lattice"}, "planner is 'Lattice' ... Grid"),
    (
        "turning",
        {"planner": "Lattice"},
        "drive is None and planner is 'Lattice' ... Differential, Car(reverse=True)",
    ),
    (
        "plane",
        {"objective": "overlap"},
        "objective is 'overlap' ... function",
    ),
    (
        "plane",
        {"planner": "RRTConect"},
        "planner is 'RRTConect' ... BiRRT ... did you mean 'RRTConnect'?",
    ),
    ("plane", {"planner": "A"}, "planner is 'A' ... Lattice, BiRRT"),
    ("turning", CAR | {"planner": "BKPIECE1"}, "planner is 'BKPIECE1' ... Car(reverse=True)"),
    ("turning", CAR | {"planner": "LBKPIECE1"}, "planner is 'LBKPIECE1' ... Car(reverse=True)"),
    # Options that the planner refuses.
    (
        "plane",
        {"objective": "clearance", "planner": "RRT"},
        "objective is 'clearance' and planner is 'RRT' ... objective: length",
    ),
    (
        "plane",
        {"objective": make_objective, "planner": "Grid"},
        "planner is 'Grid' ... length, clearance",
    ),
    (
        "plane",
        {"objective": "clearance", "planner": planners.Search(iterations=5)},
        "iterations is 5 and objective is 'clearance' ... counts",
    ),
    ("turning", CAR | {"planner": "Grid"}, "planner is 'Grid' ... drive: None"),
    (
        "turning",
        {"drive": planners.Differential(), "planner": "Lattice", "objective": make_objective},
        "planner is 'Lattice' ... time, WeightedLength",
    ),
    # Drives.
    (
        "yawing",
        {"drive": planners.Differential()},
        "drive is Differential(reverse=False) and the axes are (x, y, z, yaw) ... (x, y, yaw)",
    ),
    (
        "turning",
        {"drive": "dubins"},
        "drive is 'dubins' ... planners.Car",
    ),
    (
        "turning",
        {"drive": HoverDrive()},
        "drive is HoverDrive(reverse=False) ... Differential, Car",
    ),
    (
        "turning",
        {"drive": planners.Car(turning_radius=1e-9)},
        "turning_radius is 1e-09 ... rounding",
    ),
    ("turning", {"drive": planners.Car(turning_radius=400.0)}, "turning_radius is 400"),
    ("plane", {"seed": -1}, "seed is -1"),
    (
        "plane",
        {"previous": 3},
        "previous is 3 ... planners.plan",
    ),
    ("floating", {"start": (0.5, 0.5, 0.5, 0, 0, 0, 2)}, "start has a quaternion of norm 2 ... 1"),
)
def test_options_that_do_not_go_together_are_refused(name, options, hint):
    given = {"seed": 1} | dict(zip(("start", "goal"), ENDPOINTS[name], strict=True)) | options
    given = {"space": build_room(name)} | given
    if given.pop("exact", False):
        given["space"] = given["space"].exact
    check_refused(lambda: planners.plan(**given), hint)


def test_goals_of_an_arm_are_for_some_planners():
    space = cspace.build_arm_space({}, planar_arm())
    goals = [(0.5, 0.5), (0.4, 0.3)]
    assert planners.plan(space, (0.0, 0.0), goals, planner="BKPIECE1", seed=1)
    assert planners.plan(space, (0.0, 0.0), goals)
    with pytest.raises(InputError, match=r"planner is 'Grid' and space is.*built-in"):
        planners.plan(space, (0.0, 0.0), goals[0], planner="Grid")
    with pytest.raises(InputError, match="objective"):
        planners.plan(space, (0.0, 0.0), goals[0], objective="clearance")
    with pytest.raises(InputError, match=r"lacks shoulder, elbow; "):
        planners.plan(space, (0.0, 0.0), goals[0]).trajectory(max_acceleration=None)


# ---- plans and trajectories ----------------------------------------------------------------------

LIMITS = {"max_velocity": 1.0, "max_acceleration": 1.0}
TURN_LIMITS = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}


@cache
def plan_in(name, **options):
    """Plan in a room."""
    return planners.plan(build_room(name), *ENDPOINTS[name], seed=1, time_limit=60.0, **options)


@refusals(
    "make, hint",
    (
        lambda: plan_in("plane").trajectory(max_velocity=1.0, max_acceleration=None),
        "max_acceleration lacks x, y ... number",
    ),
    (
        lambda: plan_in("turning").trajectory(**LIMITS),
        "max_angular_velocity is missing ... turns",
    ),
    (
        lambda: plan_in("plane").trajectory(**LIMITS, max_angular_velocity=1.0),
        "max_angular_velocity is 1.0 ... turn",
    ),
    (
        lambda: plan_in("plane").trajectory(**LIMITS, duration=0.1),
        "duration is 0.1 ... 15.1423",
    ),
    (
        lambda: plan_in("plane").trajectory(**LIMITS, time_step=1e-9),
        "time_step is 1e-09 ... 1000000",
    ),
    (
        lambda: plan_in("plane").trajectory(**LIMITS).sample_uniform(1e9),
        "rate is 1e+09 ... 15142322656",
    ),
    (
        lambda: plan_in("plane").trajectory(**LIMITS).v,
        "trajectory is of a robot without a drive ... drives",
    ),
    (
        lambda: plan_in("turning").trajectory(**LIMITS, **TURN_LIMITS).steering(1.0),
        "trajectory is of a robot with drive None ... steers",
    ),
    (
        lambda: plan_in("turning").trajectory(**LIMITS, **TURN_LIMITS).to_joint_trajectory(),
        "trajectory moves x, y, yaw ... joint",
    ),
    (
        lambda: plan_in("turning").trajectory(**LIMITS, **TURN_LIMITS, max_angular_jerk=3.0),
        "max_jerk is missing ... max_angular_jerk",
    ),
    (
        lambda: plan_in("plane").trajectory(**LIMITS, at=1.0),
        "at is 1.0 ... motion",
    ),
    (
        lambda: planners.Trajectory.along(build_room("plane"), [(1, 1)], max_acceleration=1.0),
        "space is CSpace(100 x 60 cells of 0.1 m, disc 0.2 m: ... space of an arm",
    ),
    (
        lambda: plan_in("plane").recheck(build_room("turning")),
        "space has the axes x, y, yaw ... plan",
    ),
    *(
        (
            lambda name=name: getattr(copy.copy(plan_in("plane")), name)(),
            "plan has no map ... pickling",
        )
        for name in ("recheck", "explain", "plot")
    ),
    (
        lambda: penalize("plane", -1.0),
        "weight is -1.0 ... zero",
    ),
    (
        lambda: plan_in("plane").trajectory(max_velocity={"x": 1.0}, max_acceleration=1.0),
        "max_velocity lacks y ... one",
    ),
    (
        lambda: plan_in("turning", **CAR).trajectory(max_velocity=(1.0, 2.0), max_acceleration=1.0),
        "max_velocity has shape (2,) ... car",
    ),
    (
        lambda: plan_in("plane").trajectory(max_velocity=1.0, max_acceleration=math.nan),
        "max_acceleration is nan",
    ),
    (
        lambda: plan_in("plane").trajectory(**LIMITS).recheck(build_room("turning")),
        "space has the axes x, y, yaw",
    ),
    (
        lambda: plan_in("plane").trajectory(**LIMITS).recheck(build_room("plane"), after=99.0),
        "after is 99 ... to 15.1423",
    ),
    (lambda: plan_in("plane").trajectory(**LIMITS).sample_uniform(math.nan), "rate is nan"),
    (lambda: plan_in("plane").trajectory(**LIMITS).sample(math.nan), "t is nan"),
)
def test_wrong_calls_are_refused_in_one_line(make, hint):
    check_refused(make, hint)


def test_a_copied_plan_is_drawn_on_its_map(tmp_path):
    plan = copy.copy(plan_in("plane"))
    cspace.plot.animate(build_room("plane"), plan, tmp_path / "a.gif", seconds=0.1)


def test_ompl_parts_that_are_refused_have_a_replacement():
    setup = planners.simple_setup(build_room("plane"))
    si = setup.getSpaceInformation()
    with pytest.raises(InputError, match=r"it must be an ompl\.base\.SpaceInformation"):
        planners.StateValidityChecker(setup, build_room("plane"))
    planners.StateValidityChecker(si, build_room("plane"))
    with pytest.raises(InputError, match="rng is given and space is ExactCSpace"):
        planners.simple_setup(build_room("plane").exact, rng=np.random.default_rng(0))
    planners.simple_setup(build_room("plane").exact)


def test_a_tiny_map_is_planned_on_without_a_named_planner():
    tiny = Workspace.from_array(np.eye(9, dtype=bool), 1e-17)
    space = build(tiny, Robot.disc(1e-18))
    start, goal = space.grid.center_of([(1, 4), (1, 6)])
    with pytest.raises(InputError, match=r"space spans 1\.27e-16 m.*OMPL's"):
        planners.plan(space, start, goal, planner="RRT")
    assert planners.plan(space, start, goal).certified


# ---- own spaces, rows and messages ---------------------------------------------------------------


def test_a_gate_refuses_a_space_of_your_own():
    space = Disc("x", "y")
    with pytest.raises(InputError, match=r"space is a Disc.*proves"):
        cspace.Gate(space)
    assert space.motion_is_free(START, (-1.5, 1.0))


def plan_own(*axes, start=START, goal=(-1.5, 1.0)):
    """Plan in a space of one's own, beside a disc."""
    return planners.plan(Disc(*axes), start, goal, time_limit=0.2, seed=1)


@cache
def plan_none():
    """Plan to a place that cannot be reached."""
    walls = [(2.0, 0.0, 3.0, 4.0)]
    return planners.plan(build_walls(walls, SQUARE), *[end[:2] for end in AHEAD])


def read_arm_space(folder):
    """Build the space of an arm among nothing."""
    return cspace.build_arm_space({}, planar_arm())


ARM_LIMITS = {"max_velocity": 1.0, "max_acceleration": 1.0}


def along(space, rows):
    """Make the trajectory of rows."""
    return planners.Trajectory.along(space, rows, **ARM_LIMITS)


def line(space, *poses):
    """Follow a line of the forearm."""
    start = (0.3, 0.5)
    return space.follow_line(start, "fore", [space.arm.pose(q, "fore") for q in (start, *poses)])


def blocked(space, rows):
    """Put a box in the way of rows."""
    space.add_obstacle(
        "box", cspace.arms.PosedShape(Robot.box((0.3, 0.3, 0.3)).shape, pose_at(0.3, 1.2))
    )
    return rows


@refusals(
    "call, hint",
    (
        lambda _: plan_own("y", "x"),
        "space has the axes y x ... planners",
    ),
    (
        lambda _: plan_own("a", "b").plot(),
        "plan is in Disc(a, b) ... drawn",
    ),
    (
        lambda _: plan_none().trajectory(**LIMITS),
        "plan has no path: no path exists: proven ... follows",
    ),
    (
        lambda _: planners.plan((1.0, 1.0), build_room("plane"), (2.0, 1.0)),
        "space is a tuple ... cspace.Space",
    ),
    (
        lambda _: planners.plan(
            build_room("plane"), *ENDPOINTS["plane"], drive=planners.Differential()
        ),
        "drive is Differential(reverse=False) and the axes are (x, y)",
    ),
    (
        lambda _: planners.plan(
            build_room("plane"), *ENDPOINTS["plane"], planner="RRTstar", objective=lambda si: 3
        ),
        "objective returned 3 ... ompl.base",
    ),
    (
        lambda _: plan_in("plane").trajectory(max_velocity=(1, 2, 3), max_acceleration=1.0),
        "max_velocity has shape (3,) ... number",
    ),
    (
        lambda f: along(space := read_arm_space(f), line(space, (0.3, 0.5), (9.0, 0.5))),
        "a trajectory follows the whole line",
    ),
    (
        lambda f: along(read_arm_space(f), (0.3, 0.5)),
        "path has shape (2,) ... rows of configurations",
    ),
    (
        lambda f: along(space := read_arm_space(f), blocked(space, [(0.3, 0.5), (1.6, 0.5)])),
        "path has 1 of 1 motions that are not proven free ... follows",
    ),
    (
        lambda f: planners.plan(read_arm_space(f), (0.3, 0.5), (0.4, 0.5)).to_path(),
        "plan moves the joints shoulder, elbow ... poses",
    ),
    (lambda _: plan_own("x", "y", start=(0.0, 0.0)), "start (0.0, 0.0) is not free ... starts"),
    (lambda _: plan_own("x", "y", goal=(3.0, 0.0)), "goal (3.0, 0.0) lies outside the bounds"),
    (lambda _: plan_own("x", "y", goal=cspace.PoseGoal("tip", np.eye(4))), "goal is a PoseGoal"),
)
def test_wrong_spaces_and_rows_are_refused_in_one_line(call, hint, tmp_path):
    check_refused(lambda: call(tmp_path), hint)


def test_a_plan_on_tiles_is_explained_in_a_window(tmp_path):
    plane = build_room("plane")
    tiled = build(plane.workspace, plane.robot, store=tmp_path / "a.zarr", tile=16)
    start, goal = ENDPOINTS["plane"]
    plan = planners.plan(tiled, start, goal, planner="Grid")
    with pytest.raises(
        InputError, match=r"plan is in TiledCSpace\(100 x 60 cells of 0\.1.*explain"
    ):
        plan.explain()
    window = tiled.window(plane.grid.lower, plane.grid.upper)
    planners.plan(window, start, goal, planner="Grid").explain()
