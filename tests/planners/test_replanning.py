"""Plans that go on from a previous one, and the quick search with which default plans begin."""

import importlib
import math
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import given
from ompl import base as ob
from ompl import util as ou
from shapely.geometry import box

import cspace
import planners
from cspace import InputError, Robot, Workspace, build
from tests.helpers.drives import is_car
from tests.helpers.handmade import fill_boxes
from tests.helpers.planning import ENDPOINTS, build_room, check, options_for, weighted_length
from tests.helpers.refusals import check_refused
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import planar_arm, posed_box

ROTATING = [
    ("turning", "holonomic", False),
    ("turning", "holonomic", True),
    ("turning", "differential", False),
    ("turning", "reeds-shepp", False),
    ("turning", "reeds-shepp", True),
    ("yawing", "holonomic", False),
]


# ---- never worse than a quick plan ---------------------------------------------------------------


@pytest.mark.parametrize("name, drive, exact", ROTATING)
@examples(4)
@given(seeds)
def test_a_default_plan_is_no_longer_than_a_quick_one(name, drive, exact, seed):
    space = build_room(name)
    rng = np.random.default_rng(seed)
    start, goal = space.sample_free(2, rng)
    if space.is_disconnected(start, goal):
        return
    space = space.exact if exact else space
    options = options_for(drive) | {"seed": seed % 1000, "time_limit": 30.0}
    quick = planners.plan(
        space, start, goal, planner=planners.Search("RRTConnect", iterations=500), **options
    )
    plan = planners.plan(space, start, goal, **options)
    if quick.certified:
        check(space, plan, start, goal)
        # A car turns as it moves, so that its ways are compared by their metres alone.
        measure = attrgetter("length") if is_car(plan) else weighted_length
        assert measure(plan) <= measure(quick) + 1e-9


def test_default_plans_without_a_seed_are_repeatable_and_leave_ompl_its_own_seeds():
    space = build_room("turning")
    ends = space.sample_free(24, np.random.default_rng(1)).reshape(12, 2, 3)
    chosen = 0
    left = set()
    for start, goal in ends:
        ou.RNG.setSeed(len(left) + 1)
        plans = [planners.plan(space, start, goal, time_limit=30.0) for _ in range(2)]
        assert plans[0].path.tolist() == plans[1].path.tolist()
        chosen += plans[0].status.startswith("path found: by RRTConnect")
        left.add(ou.RNG().getLocalSeed())
    assert chosen and len(left) == len(ends)
    # Seeds that the user sets for OMPL still decide all that follows a plan.
    following = []
    for _ in range(2):
        ou.RNG.setSeed(7)
        planners.plan(space, *ends[0])
        following.append(ou.RNG().getLocalSeed())
    assert following[0] == following[1]


# ---- previous plans ------------------------------------------------------------------------------


EACH_DRIVE = pytest.mark.parametrize("drive", ["holonomic", "differential", "reeds-shepp"])


def build_walls(length, *walls):
    """Build a room of some cells times 60 with walls."""
    workspace = Workspace.from_array(fill_boxes((length, 60), *walls), 0.1)
    return build(workspace, Robot.rectangle(0.5, 0.3), rotations=24)


def go_on(space, start, goal, before, **options):
    """Plan along a previous plan, and check the plan."""
    plan = planners.plan(space, start, goal, previous=before, **options)
    check(space, plan, start, goal)
    return plan


@EACH_DRIVE
def test_a_plan_goes_on_along_the_previous_one(drive):
    space = build_walls(100, np.s_[48:52, 15:45])  # open at both ends
    start, goal = (1.0, 2.0, 0.0), (9.0, 2.0, 0.0)
    options = options_for(drive)
    before = planners.plan(space, start, goal, **options)
    halfway = before.path[len(before.path) // 3]
    plan = go_on(space, halfway, (9.0, 2.5, 0.1), before, **options)
    assert plan.status == "path found: along the previous plan"
    assert weighted_length(plan) < weighted_length(before)
    plain = planners.Search(simplify=False)
    joined = go_on(space, halfway, goal, before, planner=plain, **options)
    assert weighted_length(joined) < weighted_length(before)
    # An obstacle across the previous path is gone around, on the other side of the wall.
    space.add_obstacle("crate", box(4.5, 0.0, 5.5, 1.5))
    again = go_on(space, start, goal, before, **options)
    assert again.status.endswith("previous plan") and again.path[:, 1].max() > 4.5
    fresh = planners.plan(space, start, goal, **options)
    assert weighted_length(again) < 1.05 * weighted_length(fresh)
    # An obstacle that the robot is past changes nothing.
    space.remove_obstacle("crate")
    space.add_obstacle("crate", box(0.6, 1.6, 1.0, 2.4))
    again = go_on(space, before.path[-2], goal, before, **options)
    assert again.status.endswith("previous plan")


def test_a_path_that_cannot_be_shortened_is_tried_once(monkeypatch):
    space = build_walls(100, np.s_[48:52, :40])
    start, goal = (1.0, 2.0, 0.0), (9.0, 2.0, 0.0)
    options = options_for("differential")
    plan = planners.plan(space, start, goal, **options)
    for _ in range(10):
        before, plan = plan, go_on(space, start, goal, plan, **options)
    assert weighted_length(plan) == pytest.approx(weighted_length(before), rel=1e-9)
    lattice = importlib.import_module("planners._searches.lattice")
    shorten_once = lattice._shorten_once
    rounds = []

    def count(*arguments):
        rounds.append(arguments)
        return shorten_once(*arguments)

    monkeypatch.setattr(lattice, "_shorten_once", count)
    go_on(space, start, goal, plan, **options)
    assert len(rounds) == 1


def build_corridor():
    """Build a corridor with bends, 40 m long and 3 m wide."""
    return build_walls(400, np.s_[80:83, :25], np.s_[320:323, 35:])


@EACH_DRIVE
def test_only_the_blocked_part_of_a_previous_plan_changes(drive, monkeypatch):
    space = build_corridor()
    start, goal = (1.0, 1.0, 0.0), (39.0, 5.0, 0.0)
    options = options_for(drive)
    before = planners.plan(space, start, goal, **options)
    x, y = np.median(before.path[:, :2], axis=0)
    space.add_obstacle("crate", box(x - 0.4, y - 0.4, x + 0.4, y + 0.4))
    again = go_on(space, start, goal, before, **options)
    assert again.status.endswith("previous plan")
    fresh = planners.plan(space, start, goal, **options)
    assert weighted_length(again) < 1.05 * weighted_length(fresh)
    # A smaller crate is passed beside without a search.
    space.remove_obstacle("crate")
    space.add_obstacle("crate", box(x - 0.2, y - 0.2, x + 0.2, y + 0.2))
    monkeypatch.setattr("planners._searches.built_in.BuiltInSearch.find", None)
    again = go_on(space, start, goal, before, **options)
    assert weighted_length(again) < 1.02 * weighted_length(before)


@pytest.mark.parametrize("blocked", [1.0, 39.0], ids=["at the start", "at the goal"])
def test_a_previous_plan_that_is_blocked_at_an_end_is_left_or_joined_there(blocked):
    space = build_corridor()
    before = planners.plan(space, (1.0, 1.0, 0.0), (39.0, 5.0, 0.0))
    start, goal = (2.5, 2.5, 0.0), (37.5, 3.5, 0.0)
    space.add_obstacle("crate", box(blocked - 0.6, 0.0, blocked + 0.6, 6.0))
    plan = go_on(space, start, goal, before)
    fresh = planners.plan(space, start, goal)
    assert weighted_length(plan) < 1.05 * weighted_length(fresh)


def test_a_previous_plan_without_a_path_counts_as_none():
    space = build_room("plane")
    start, goal = ENDPOINTS["plane"]
    none = planners.plan(space, start, goal, planner=planners.Search("RRTConnect", iterations=1))
    assert not none
    plan = planners.plan(space, start, goal, previous=none)
    assert plan.certified and plan.status == "path found"


@pytest.mark.parametrize(
    "options, message",
    [
        (
            {"planner": "RRTstar", "objective": ob.PathLengthOptimizationObjective},
            "is short, or cheap by the cost of cells",
        ),
        ({"objective": "clearance"}, "is a plan by 'length', and the objective is 'clearance'"),
        ({"objective": "time", "speed": 1.0}, "a plan by 'length', and the objective is 'time'"),
    ],
)
def test_plans_by_another_quantity_do_not_go_on_along_a_previous_plan(options, message):
    space = build_room("plane")
    before = planners.plan(space, *ENDPOINTS["plane"])
    check_refused(
        lambda: planners.plan(space, *ENDPOINTS["plane"], previous=before, **options), message
    )


def test_the_angles_of_an_arm_are_not_wrapped_along_a_previous_plan():
    arm = planar_arm(kind="continuous", limits=None)
    obstacles = {"post": posed_box((0.3, 0.3, 0.3), -1.7, 0.0)}
    space = cspace.build_arm_space(obstacles, arm)
    goal = (-2.5, 0.2)
    before = planners.plan(space, (2.5, -0.2), goal, seed=1)
    angles = before.path[:, 0]
    assert angles[0] < math.pi < angles[-1] and len(before.waypoints) > 2
    beyond = before.path[np.searchsorted(angles, math.pi)]  # of 2.5 to 3.8 rad, beyond pi
    start = (beyond[0] - 2.0 * math.pi, beyond[1])
    plan = planners.plan(space, start, goal, previous=before)
    assert plan.certified and plan.status.endswith("previous plan")
    assert np.abs(np.diff(plan.waypoints, axis=0)).max() < math.pi


def test_a_previous_plan_of_another_space_is_refused():
    previous = planners.plan(build_room("space"), *ENDPOINTS["space"])
    with pytest.raises(InputError, match=r"previous has the axes \(x, y, z\) and space is.*plan"):
        planners.plan(build_room("plane"), *ENDPOINTS["plane"], previous=previous)
