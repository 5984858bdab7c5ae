"""Alternatives, places with room, moved starts, and places on the way.

Oracles: shapely and plain distances for rooms, labels of scipy for what is apart, plans to single
configurations for lengths.
"""

import ast
import math
import re
import tracemalloc
from contextlib import suppress
from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import ndimage

import cspace
import planners
from cspace import BLOCKED, FREE, MIXED, ConfigurationError
from cspace.inside import now
from tests.checker.no_path import holds
from tests.helpers.any_plan import draw_place
from tests.helpers.drives import is_car
from tests.helpers.handmade import build_empty, components, map_of
from tests.helpers.motions import pass_near
from tests.helpers.plain import places_of
from tests.helpers.planning import (
    ENDPOINTS,
    build_from_states,
    build_halves,
    build_open_map,
    build_room,
    check,
    check_support,
    options_for,
)
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.spaces import OpenSpace
from tests.helpers.strategies import examples, few, seeds

DRIVES = (None, "differential", "differential-reverse", "dubins", "reeds-shepp")
LIMITS = {"max_velocity": 1.0, "max_acceleration": 0.5}
TURN_LIMITS = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}


def measure(plan):
    """Return the length of a plan with weighted rotations, along curves without."""
    return plan.length + (0.0 if is_car(plan) else 0.5 * plan.total_rotation)


# ---- several goals -------------------------------------------------------------------------------


def test_a_goal_behind_a_wall_is_not_taken_for_near():
    space = build_room("plane")
    start, behind, around = (2.6, 1.0), (3.75, 1.05), (2.0, 4.0)
    assert planners.plan(space, start, behind).length > 2.0 * math.dist(start, around)
    goals = [behind, around]
    assert planners.plan(space, start, goals).goal.tolist() == list(around)
    for planner in ("Grid", "RRTConnect", "FMT"):
        plan = planners.plan(space, start, goals, planner=planner, seed=1, time_limit=4.0)
        assert plan.certified and plan.goal.tolist() == list(around)


def test_a_car_takes_the_goal_ahead_if_one_behind_needs_a_loop():
    space = build_field()
    behind, ahead = (4.5, 7.0, 0.0), (8.5, 7.0, 0.0)
    goals = [behind, ahead]
    plan = planners.plan(space, (5.5, 7.0, 0.0), goals, time_limit=20.0, **options_for("dubins"))
    assert plan.certified and plan.goal.tolist() == list(ahead)
    plan = planners.plan(space, (5.5, 7.0, 0.0), goals, **options_for("reeds-shepp"))
    assert plan.certified and plan.goal.tolist() == list(behind)


# ---- goals with room -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, drive",
    few(
        [
            ("turning", None),
            ("plane", None),
            *(("turning", drive) for drive in DRIVES[1:]),
            ("yawing", None),
        ],
        3,
    ),
)
@examples(16)
@given(seeds)
def test_a_path_ends_where_it_enters_a_room_and_nowhere_dearer_than_in_its_middle(
    name, drive, seed
):
    """Without a drive, the way back is about as long; no search finds the very shortest."""
    space = build_room(name)
    rng = np.random.default_rng(seed)
    start = tuple(space.sample_free(rng=rng).tolist())
    goal = draw_place(rng, space, starts=True)
    places = places_of(space, goal, "goal")
    plan = None
    with suppress(ConfigurationError):
        plan = planners.plan(space, start, goal, time_limit=5.0, **options_for(drive))
    assume(plan)
    check(space, plan, start, plan.goal)
    # A path that went on through the room would be too long.
    assert not any(holds(places, row, 1e-9) for row in plan.waypoints[:-1])
    if drive is None:
        inside = [q for q in space.sample_free(2_000, rng) if holds(places, q)][:8]
        each = [planners.plan(space, start, q, time_limit=5.0) for q in inside]
        assert measure(plan) <= min(map(measure, each), default=math.inf) * 1.03 + 0.1
    if drive is None and not isinstance(goal, planners.Near):
        back = planners.plan(space, goal, start, time_limit=5.0)
        assert measure(plan) == pytest.approx(measure(back), rel=0.1, abs=0.15)
        assert not any(holds(places, row, 1e-9) for row in back.waypoints[1:])


def test_a_room_is_entered_at_its_nearest_point_and_yaw():
    space = build_open_map("plane")
    plan = planners.plan(space, (1.5, 1.5), shapely.box(4.0, 0.5, 7.0, 7.5))
    assert plan.length == pytest.approx(2.5, abs=2e-3)
    plan = planners.plan(space, (1.5, 1.5), planners.Near((7.5, 5.5), 2.0))
    assert plan.length == pytest.approx(math.hypot(6.0, 4.0) - 2.0, abs=5e-3)
    plan = planners.plan(space, (4.5, 1.5), shapely.box(4.0, 0.5, 7.0, 7.5))
    assert plan.length == 0.0 and "the start is the goal" in plan.status
    turning = build_open_map("turning")
    for place in ((4.0, 4.0, 1.0), (shapely.box(3.0, 3.0, 5.0, 5.0), 1.0)):
        plan = planners.plan(turning, (4.0, 4.0, 0.0), planners.Near(place, 0.0, 0.4))
        assert plan.goal[2] == pytest.approx(0.6, abs=0.02) and plan.goal[2] >= 0.6


@examples(40)
@given(seeds, st.sampled_from([None, 4]))
def test_a_wider_wish_gets_no_less_than_a_narrower_one(seed, turns):
    """Middles lie on borders and corners of cells, in position and yaw, or anywhere."""
    rng = np.random.default_rng(seed)
    states = rng.choice([FREE, BLOCKED], (turns or 1, 5, 5), p=[0.8, 0.2]).astype(np.uint8)
    space = map_of(states[0] if turns is None else states, turns, "blocked", 1.0)
    start, q = space.sample_free(2, rng)
    on_border = rng.random(len(q)) < 0.6
    q[:2] = np.where(on_border[:2], np.round(2.0 * q[:2]) / 2.0, q[:2])
    q[2:] = np.where(on_border[2:], np.round(q[2:] / (math.pi / 4.0)) * (math.pi / 4.0), q[2:])
    metres, radians, wider = 10.0 ** rng.uniform([-16.0, -16.0, 0.0], [0.3, 0.4, 3.0])
    x, y, *yaw = q.tolist()
    box = shapely.box(x - metres, y - metres, x + metres, y + metres)
    wishes = [
        (q, planners.Near(q, metres)),
        (q, planners.Near(q, 0.0, radians)),
        (q, planners.Near(q, metres, radians)),
        (planners.Near(q, metres, radians), planners.Near(q, wider * metres, radians)),
        (planners.Near(q, metres), [planners.Near(q, metres), (-9.0, -9.0, *yaw)]),
    ]
    if metres > 1e-12:  # less is no area
        wishes.append((q, (box, *yaw) if yaw else box))
    if yaw:
        wishes.append((q, (x, y, None)))
    for narrow, wide in wishes:
        try:
            found = bool(planners.plan(space, start, narrow))
        except ConfigurationError:
            continue
        assert not found or planners.plan(space, start, wide), (narrow, wide)
        assert not found or planners.plan(space, wide, start), (narrow, wide)


@pytest.mark.parametrize("drive, factor", [(None, 2.0), ("differential", 3.0)])
def test_room_around_a_goal_costs_little_more_work_and_never_a_longer_path(drive, factor):
    space = build_room("turning")
    start, goal = ENDPOINTS["turning"]

    def search(place):
        """Return a plan's length, and the counted work of its searches."""
        began = now()
        plan = planners.plan(space, start, place, **options_for(drive))
        return measure(plan), (now() - began).work

    length, work = search(goal)
    for place in (planners.Near(goal, 0.2, 0.3), planners.Near(goal, 1e-3), (*goal[:2], None)):
        shorter, more = search(place)
        assert shorter <= length and more <= factor * work


def test_any_yaw_needs_no_turn_at_the_goal():
    space = build_room("turning")
    start, (x, y, yaw) = ENDPOINTS["turning"]
    for drive in (None, "differential"):
        turned = planners.plan(space, start, (x, y, yaw), **options_for(drive))
        plan = planners.plan(space, start, (x, y, None), **options_for(drive))
        assert plan.certified and plan.goal[:2].tolist() == [x, y]
        assert measure(plan) < measure(turned)
    assert plan.drive == planners.Differential() and plan.direction[-1] == 1


def test_a_room_around_a_blocked_goal_is_reached_and_without_one_the_nearest_is_named():
    space = build_room("plane")
    blocked = (3.15, 1.0)
    plan = planners.plan(space, (1.0, 1.0), planners.Near(blocked, 0.6))
    assert plan.certified and math.dist(plan.goal, blocked) <= 0.6
    with pytest.raises(ConfigurationError, match=r"within 0.1 m of .*; the nearest is") as caught:
        planners.plan(space, (1.0, 1.0), planners.Near(blocked, 0.1))
    nearest = ast.literal_eval(re.search(r"the nearest is (\(.*\))", caught.value.hint)[1])
    metres = math.dist(nearest, blocked)
    assert planners.plan(space, (1.0, 1.0), planners.Near(blocked, metres)).certified
    inside = shapely.box(3.14, 0.5, 3.16, 4.49)  # of a wall, and nearest to FREE cells at its top
    with pytest.raises(ConfigurationError, match=r"no configuration .* in the region") as caught:
        planners.plan(space, (1.0, 1.0), inside)
    free = shapely.points(space.grid.center_of(np.argwhere(space.cell_states == FREE)))
    named = shapely.Point(caught.value.nearest).distance(inside)
    assert named <= shapely.distance(free, inside).min() + 0.05
    turning = build_room("turning")
    with pytest.raises(ConfigurationError, match="free in the region, at any rotation"):
        planners.plan(turning, ENDPOINTS["turning"][0], shapely.box(1.85, 0.5, 1.95, 1.0))


@examples(40)
@given(seeds, st.sampled_from([None, 4]), st.sampled_from([0.0, math.pi]))
def test_the_closest_goal_is_in_the_nearest_free_cell_joined_to_the_start(seed, turns, angle):
    rng = np.random.default_rng(seed)
    shape = (turns or 1, 12, 9)
    states = rng.choice([FREE, MIXED, BLOCKED], shape, p=[0.62, 0.19, 0.19]).astype(np.uint8)
    states[0, 0, 0] = FREE
    space = build_from_states(states if turns else states[0], turns)
    yaw = [float(rng.uniform(-math.pi, math.pi))] if turns else []
    goal = (*rng.uniform((-1.0, -1.0), (13.0, 10.0)).tolist(), *yaw)
    start = (0.5, 0.5, *space.rotations.centers[0].tolist())
    labels = components(states == FREE, "turning")
    # Cells that touch at a corner may be joined, too.
    corners = ndimage.label(states == FREE, np.ones((3, 3, 3)))[0] if not turns else states == FREE
    position = np.array(goal[:2])
    cells = np.stack(np.indices(shape[1:]), axis=-1)
    gaps = np.linalg.norm(position.clip(cells, cells + 1.0) - position, axis=-1)
    rows = slice(None) if angle else space.rotations.cell_of(goal[2:])
    most, least = (
        np.where(each[rows] == each[0, 0, 0], gaps, np.inf).min() for each in (labels, corners)
    )
    place = planners.Near(goal, 30.0, angle, closest=True)
    if math.isinf(least):
        with pytest.raises(ConfigurationError, match="that FREE cells join to the start"):
            planners.plan(space, start, place)
        return
    assume(least == most)
    plan = planners.plan(space, start, place)
    assert most - 1e-9 <= math.dist(plan.goal[:2], position) <= most + 1e-5
    assert space.is_connected(start, plan.goal)
    assert f"no nearer to goal than {tuple(plan.goal.tolist())}, {most:.3g} m" in plan.status
    assert plan.certified or turns


def test_the_closest_goal_is_the_goal_itself_if_a_path_leads_there():
    space = build_room("turning")
    start, goal = ENDPOINTS["turning"]
    plan = planners.plan(space, start, planners.Near(goal, 0.5, closest=True))
    assert plan.goal.tolist() == list(goal) and plan.status.endswith("0 m and 0 rad away")
    np.testing.assert_array_equal(plan.waypoints, planners.plan(space, start, goal).waypoints)


def test_the_closest_of_alternatives_and_places_on_the_way_are_told():
    space = build_room("plane")
    blocked, beyond = (3.15, 1.0), (30.0, 1.0)
    near = planners.Near(blocked, 1.0, closest=True)
    plan = planners.plan(space, (1.0, 1.0), (2.0, 4.0), via=[near])
    assert plan.certified and "no nearer to via[0] than (" in plan.status
    assert math.dist(plan.path[plan.via_rows[0]], blocked) < 0.46
    plan = planners.plan(
        space, (1.0, 1.0), [near, planners.Near(beyond, 50.0, closest=True)], drive=None
    )
    assert plan.certified and "nearer to goal[0]" in plan.status and "goal[1]" in plan.status
    assert math.dist(plan.goal, blocked) < 0.46
    with pytest.raises(
        ConfigurationError, match=r"within 0.1 m .* start, but one within 0.452 m"
    ) as caught:
        planners.plan(space, (1.0, 1.0), planners.Near(blocked, 0.1, closest=True))
    plan = planners.plan(space, (1.0, 1.0), planners.Near(blocked, math.inf, closest=True))
    assert plan.certified and tuple(plan.goal.tolist()) == caught.value.nearest


@pytest.mark.parametrize("place", ["near", "region", "start"])
def test_paths_to_places_that_leave_the_map_stay_in_it(place):
    free = np.full((18, 18), FREE, dtype=np.uint8)
    space = map_of(free, outside="free", spacing=0.25)
    inside, beyond = (2.25, 4.4999), (0.5625, 4.501)
    room = planners.Near(beyond, 0.53)
    if place == "region":
        room = shapely.Polygon([(0.2, 4.3), (1.0, 4.6), (0.2, 4.6)])
    ends = (room, inside) if place == "start" else (inside, room)
    plan = planners.plan(space, *ends)
    assert space.grid.contains(plan.path).all()
    assert 0.0 <= plan.gap < 1e-3


@pytest.mark.parametrize(
    "is_apart, role", few([(True, "goal"), (False, "goal"), (True, "via"), (False, "start")], 2)
)
def test_a_region_as_large_as_the_map_is_no_list_of_its_cells(is_apart, role):
    """The start lies beside the region, behind a wall with or without a door."""
    side = 1000
    occupied = np.zeros((side, side), dtype=bool)
    occupied[20] = True
    occupied[20, 300 : 300 if is_apart else 340] = False
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.3))
    start, far = (1.0, 50.0), (90.0, 50.0)
    region = shapely.box(4.0, 0.0, 100.0, 100.0).union(shapely.Point(60.0, 50.0).buffer(50.0))
    places = {
        "goal": (start, region, ()),
        "via": (start, far, [region]),
        "start": (region, start, ()),
    }
    origin, goal, via = places[role]
    planners.plan(space, origin, goal, via=via)  # labels and compiles
    tracemalloc.start()
    plan = planners.plan(space, origin, goal, via=via)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert plan.is_disconnected == is_apart and bool(plan) != is_apart
    assert peak < 40 * side**2


def test_an_open_exterior_may_lead_to_a_region_that_leaves_the_map():
    states = np.full((9, 9), FREE, dtype=np.uint8)
    states[4:] = BLOCKED
    states[6, 1] = FREE  # a pocket
    for outside, is_apart in (("free", False), ("blocked", True)):
        space = map_of(states, None, outside, 1.0)
        pocket, beyond = shapely.box(6.0, 1.0, 7.0, 2.0), shapely.box(6.0, 1.0, 20.0, 2.0)
        assert planners.plan(space, (1.5, 1.5), pocket).is_disconnected
        assert planners.plan(space, (1.5, 1.5), beyond).is_disconnected == is_apart


# ---- starts with alternatives and room ----------------------------------------------------------


@pytest.mark.parametrize("name", few(["plane", "turning", "space", "yawing", "floating"], 2))
@examples(14)
@given(seeds, st.sampled_from([(1, 1), (1, 4), (2, 2), (3, 2)]))
def test_of_several_starts_and_goals_those_with_the_shortest_path_are_taken(name, seed, counts):
    space = build_room(name)
    rng = np.random.default_rng(seed)
    starts, goals = (list(map(tuple, space.sample_free(number, rng).tolist())) for number in counts)
    blocked = (*space.grid.lower, *goals[0][space.dim :])
    assume(not space.is_free(blocked))
    begins = starts[0] if counts[0] == 1 else [blocked, *starts]
    plan = planners.plan(space, begins, [blocked, *goals], time_limit=20.0)
    each = [
        planners.plan(space, start, goal, time_limit=20.0) for start in starts for goal in goals
    ]
    lengths = [measure(single) for single in each]
    assert measure(plan) == min(lengths)
    best = each[int(np.argmin(lengths))]
    np.testing.assert_allclose(plan.start, best.start, atol=1e-12)
    np.testing.assert_allclose(plan.goal, best.goal, atol=1e-12)
    check(space, plan, plan.start, plan.goal)
    with_region = planners.plan(space, begins, goals[0], via=[goals[-1]])
    check(space, with_region, with_region.start, with_region.goal)


def test_a_path_between_regions_is_as_long_as_their_distance():
    space = build_open_map("plane")
    boxes = shapely.box(0.5, 0.5, 2.5, 4.5), shapely.box(5.5, 3.5, 8.5, 7.5)
    triangle = shapely.Polygon([(1.0, 7.0), (3.0, 7.5), (1.5, 5.5)])
    for ends in (boxes, boxes[::-1], (triangle, boxes[1]), (boxes[1], triangle)):
        plan = planners.plan(space, *ends)
        assert plan.length == pytest.approx(ends[0].distance(ends[1]), rel=0.02, abs=5e-3)
    beside = (2.8, 5.8)  # in the triangle's envelope
    plan = planners.plan(space, beside, triangle)
    assert plan.length == pytest.approx(triangle.distance(shapely.Point(beside)), abs=2e-2)
    both = planners.plan(space, [boxes[0], triangle], boxes[1])
    nearest = min(place.distance(boxes[1]) for place in (boxes[0], triangle))
    assert both.length == pytest.approx(nearest, rel=0.02, abs=5e-3)
    turning = build_open_map("turning")
    plan = planners.plan(turning, (1.5, 1.5, None), (6.5, 1.5, 2.0))
    assert plan.length == pytest.approx(5.0) and plan.total_rotation == pytest.approx(0.0, abs=1e-9)


def test_no_path_is_never_proven_for_the_cell_alone_that_a_start_is_moved_to():
    states = np.full((7, 7), BLOCKED, dtype=np.uint8)
    states[1, 3] = FREE  # a pocket
    states[3, 3] = MIXED
    states[4:6, 3] = FREE
    space = map_of(states, None, "blocked", 1.0)
    start = planners.Near((3.2, 3.5), 2.0)
    moved = planners.plan(space, planners.Near((2.9, 3.5), 1.0), (5.5, 3.5))
    assert moved.start[0] < 2.0 and not moved.certified and not moved.is_disconnected
    assert planners.plan(space, (1.5, 3.5), (5.5, 3.5)).is_disconnected
    assert not planners.plan(space, [(1.5, 3.5), (3.5, 3.5)], (5.5, 3.5)).is_disconnected
    assert planners.plan(space, start, (5.5, 3.5)).certified


def test_places_are_tried_on_tiled_maps(tmp_path):
    tiled = build_empty((60, 40), cspace.Robot.disc(0.2), store=tmp_path / "m", tile=20)
    corner = (1.0, 1.0)
    for place, length in (([(5.0, 3.0), (1.0, 3.5)], 2.5), (shapely.box(4.0, 0.5, 5.0, 1.5), 3.0)):
        for ends in ((corner, place), (place, corner)):
            plan = planners.plan(tiled, *ends)
            assert plan.certified and plan.length == pytest.approx(length, abs=1e-3)


# ---- a start that is not free --------------------------------------------------------------------


def test_a_start_is_moved_within_its_tolerance_and_the_status_says_so():
    """All FREE cells at the start's yaw are measured one by one."""
    space = build_room("turning")
    stands, goal = ENDPOINTS["turning"]
    blocked = (1.7, 1.0, 0.5)
    centers = space.grid.center_of(np.argwhere(np.ones(space.grid.shape)))
    is_free = space.is_free(np.column_stack([centers, np.full(len(centers), blocked[2])]))
    gaps = np.abs(centers[is_free] - blocked[:2]) - 0.5 * space.grid.spacing
    away = np.linalg.norm(gaps.clip(0.0), axis=1).min()
    plan = planners.plan(space, planners.Near(blocked, away * 1.1), goal)
    assert plan.certified and plan.start[2] == blocked[2]
    moved = re.search(r"; start moved by (\S+) m to ", plan.status)
    assert float(moved[1]) == pytest.approx(math.dist(plan.start[:2], blocked[:2]), rel=0.01)
    assert float(moved[1]) == pytest.approx(away, rel=0.02)
    for start in (blocked, planners.Near(blocked, away * 0.99)):
        with pytest.raises(ConfigurationError, match=r"start .*nearest is"):
            planners.plan(space, start, goal)
    free = planners.plan(space, planners.Near(stands, 1.0), goal)
    assert "moved" not in free.status and tuple(free.start) == stands
    turned = planners.plan(space, planners.Near(blocked, away * 0.99, math.pi), goal)
    assert turned.certified and turned.start[2] != blocked[2]


# ---- places on the way ---------------------------------------------------------------------------


@cache
def build_field():
    """Build a field with a few posts, for a robot that turns."""
    posts = np.zeros((120, 80), dtype=bool)
    posts[40:44, 20:40] = posts[75:80, 50:54] = True
    workspace = cspace.Workspace.from_array(posts, 0.1)
    return cspace.build(workspace, cspace.Robot.rectangle(0.6, 0.4), rotations=24)


@pytest.mark.parametrize("drive", DRIVES)
def test_path_and_trajectory_go_through_places_on_the_way(drive):
    space = build_field()
    start, goal = (1.5, 1.5, 0.0), (10.5, 2.0, None)
    via = [(3.0, 5.0, None), shapely.box(6.0, 6.0, 7.0, 7.0), (9.5, 5.5, -1.0)]
    plan = planners.plan(space, start, goal, via=via, time_limit=20.0, **options_for(drive))
    check(space, plan, start, plan.goal)
    rows = plan.path[list(plan.via_rows)]
    straight = np.linalg.norm(np.diff(np.vstack([start, rows, plan.goal])[:, :2], axis=0), axis=1)
    assert straight.sum() * (1.0 - 1e-9) <= plan.lower_bound <= measure(plan) * (1.0 + 1e-9)
    limits = LIMITS | ({} if is_car(plan) else TURN_LIMITS)
    flowing, halting = (plan.trajectory(**limits, stop_at_via=stop) for stop in (False, True))
    # A curve around a sharp corner may take longer than a turn on the spot.
    turns = drive in ("differential", "differential-reverse")
    assert flowing.duration < halting.duration or turns
    for number, row in enumerate(rows):
        size = 3 if number == 2 or not turns else 2
        gap, speed = pass_near(flowing, row, size)
        assert gap < 7e-7
        assert speed > 0.05 or number == 1 or (turns and number == 2), (number, speed)
        gap, speed = pass_near(halting, row, size)
        assert gap < 7e-7 and speed < 0.02


@pytest.mark.parametrize("speed, gain", [(3.0, 0.1), (100.0, 0.01)])
@pytest.mark.parametrize("drive", [None, "differential"])
def test_places_are_passed_exactly_however_slowly_the_robot_accelerates(drive, speed, gain):
    """Curves are the wider, the longer the robot takes to reach its full speed."""
    cells = np.zeros((100, 60), dtype=bool)
    space = cspace.build(
        cspace.Workspace.from_array(cells, 0.2), cspace.Robot.rectangle(0.6, 0.4), rotations=8
    )
    close = [(6.0 + 0.001 * k, 9.0 + 0.001 * (k % 2), None) for k in range(6)]
    for via in ([(5.0, 9.0, None), (9.0, 9.0, 0.0), (13.0, 9.0, 0.0), (16.0, 3.0, None)], close):
        plan = planners.plan(space, (2, 2, 0), (18, 6, None), via=via, **options_for(drive))
        trajectory = plan.trajectory(max_velocity=speed, max_acceleration=gain, **TURN_LIMITS)
        for row, place in zip(plan.path[list(plan.via_rows)], via, strict=True):
            size = 3 if place[2] is not None or drive is None else 2
            assert pass_near(trajectory, row, size)[0] < 7e-7


@pytest.mark.parametrize("drive", ["differential", "differential-reverse"])
def test_a_robot_turns_to_the_yaw_of_the_alternative_that_it_passes(drive):
    space = build_open_map("turning")
    via = [[(4.5, 4.5, 2.0), (0.5, 7.5, None)]]
    plan = planners.plan(space, (1.5, 1.5, 0.0), (7.5, 1.5, None), via=via, **options_for(drive))
    row = plan.path[plan.via_rows[0]]
    assert row.tolist() == [4.5, 4.5, 2.0]
    assert pass_near(plan.trajectory(**LIMITS, **TURN_LIMITS), row)[0] < 7e-7


@pytest.mark.parametrize("drive", DRIVES)
def test_start_and_goal_may_be_places_on_the_way(drive):
    space = build_field()
    start, goal = (1.5, 1.5, 0.0), (10.5, 2.0, 1.0)
    limits = LIMITS | (TURN_LIMITS if drive not in ("dubins", "reeds-shepp") else {})
    for via, first, last in [
        ([start], 0, 0),
        ([goal], None, None),
        ([start, start, goal], 0, None),
    ]:
        plan = planners.plan(space, start, goal, via=via, time_limit=9.0, **options_for(drive))
        assert plan.certified and len(plan.via_rows) == len(via)
        end = len(plan.path) - 1
        assert plan.via_rows[0] == (end if first is None else 0)
        assert plan.via_rows[-1] == (end if last is None else 0)
        assert plan.trajectory(**limits, stop_at_via=True).certified


@pytest.mark.parametrize("drive", DRIVES)
def test_of_several_places_the_one_on_the_shorter_way_is_passed(drive):
    """A place near the start may lie off the way on; without obstacles all lengths are known."""
    space = build_open_map("turning")
    start, near, far, goal = (1.5, 1.5, 0.0), (0.6, 2.8, 0.5), (4.5, 2.5, 0.0), (7.5, 1.5, 0.0)
    options = {"time_limit": 20.0, **options_for(drive)}
    lengths = [
        measure(planners.plan(space, start, goal, via=[each], **options)) for each in (near, far)
    ]
    for places in ((near, far), (far, near)):
        plan = planners.plan(space, start, goal, via=[places], **options)
        assert plan.path[plan.via_rows[0]].tolist() == list(far)
        assert measure(plan) == pytest.approx(min(lengths), rel=1e-6) and lengths[1] < lengths[0]


def build_corridor():
    walls = [shapely.box(0, 3.0, 20, 3.5), shapely.box(0, 6.5, 20, 7.0)]
    workspace = cspace.Workspace.from_polygons(walls, spacing=0.1, bounds=(0, 0, 20, 10))
    return cspace.build(workspace, cspace.Robot.rectangle(0.8, 0.5), rotations=36)


def test_passing_a_place_beside_a_wall_takes_no_longer_than_a_stop():
    ends = (2.0, 5.0, 0.0), (18.0, 4.0, 0.0)
    options = {"via": [(6.0, 6.0, None)], "drive": planners.Differential()}
    plan = planners.plan(build_corridor(), *ends, **options)
    metres = np.linalg.norm(np.diff(plan.waypoints[:, :2], axis=0), axis=1)
    assert ((metres == 0.0) | (metres > 0.009)).all()
    flowing, halting = (
        plan.trajectory(**LIMITS, **TURN_LIMITS, stop_at_via=stop) for stop in (False, True)
    )
    assert flowing.duration < halting.duration


@pytest.mark.thorough
def test_a_car_goes_to_and_fro_through_many_places_by_default():
    via = [(2.0 + 16.0 * (k % 2), 4.2 + 0.035 * k, None) for k in range(40)]
    ends = (3.0, 5.0, 0.0), (17.0, 5.0, 0.0)
    assert planners.plan(build_corridor(), *ends, via=via, drive=planners.Car(0.5)).certified


def test_a_place_that_cannot_be_reached_is_named():
    space, near, far = build_halves("turning", BLOCKED)
    plan = planners.plan(space, near, near, via=[(3.5, *near[1:]), far])
    assert not plan and plan.is_disconnected and plan.via_rows == ()
    assert plan.status.startswith("via[1] is not reached: no path exists: proven")
    assert plan.start.tolist() == list(near) and plan.goal.tolist() == list(far)
    with pytest.raises(ConfigurationError, match=r"^via\[0\] .* lies in a BLOCKED cell"):
        planners.plan(space, near, near, via=[(9.5, *near[1:])])


# ---- refused goals and options -------------------------------------------------------------------

START = ENDPOINTS["turning"][0]
BOX = shapely.box(4.5, 0.5, 5.5, 1.5)


@refusals(
    "name, wrong, message",
    (
        "turning",
        {"goal": planners.Near((BOX, 0.0), 0.3)},
        "goal is Near a region, with the distance 0.3 m ... room",
    ),
    (
        "turning",
        {"goal": planners.Near([START, START], 0.3)},
        "goal is Near(configuration=[(0.8, ... one configuration",
    ),
    (
        "turning",
        {"start": planners.Near(START, 0.3, closest=True)},
        "closest is for goals and places on the way",
    ),
    ("turning", {"goal": planners.Near(BOX, closest=True)}, "closest is for a configuration"),
    (
        "turning",
        {"goal": shapely.Polygon()},
        "goal is an empty region ... positions",
    ),
    *(
        (
            "turning",
            {"goal": mixed},
            "numbers and places ... alternatives",
        )
        for mixed in ((5.0, 3.2, (3.0, 3.4)), [(5.0, 3.2, 2.0), 3], [0.3, BOX])
    ),
    ("turning", {"goal": [(5.0, 3.2, 2.0), (5.0, 3.2)]}, "goal[1] has shape (2,)"),
    (
        "plane",
        {"goal": (2.0, 4.0, None)},
        "goal is (2.0, 4.0, None) and the axes are (x, y) ... turn",
    ),
    (
        "plane",
        {"goal": (BOX, 0.3)},
        "goal has shape (1,) ... turn",
    ),
    ("turning", {"goal": [[BOX, (5.0, 3.2, 2.0)]]}, "goal has shape (3,) ... given by yaw"),
    (
        "space",
        {"goal": shapely.box(3, 1, 3.5, 1.5)},
        "a region is for maps of the plane",
    ),
    *(
        (
            "turning",
            {"goal": (line, 1.0) if is_pair else line},
            "goal is a LineString ... MultiPolygon",
        )
        for is_pair, line in enumerate([shapely.LineString([(4.5, 0.5), (5.5, 1.5)])] * 2)
    ),
    (
        "turning",
        {"goal": [cspace.PoseGoal("tool", np.eye(4))]},
        "goal is a PoseGoal ... needed",
    ),
    ("turning", {"via": (1.0, 1.0, 0.0)}, "via is (1.0, 1.0, 0.0) ... lists"),
    ("turning", {"start": None}, "start"),
    ("turning", {"start": [START, (1.0, 1.0)]}, "start[1] has shape (2,) ... configuration"),
    (
        "turning",
        {"start": np.zeros((2, 3))},
        "start has 2 alternatives, none of them proven free ... begin",
    ),
)
def test_wrong_goals_and_options_are_refused_in_one_line(name, wrong, message):
    start, goal = ENDPOINTS[name]
    options = {"start": start, "goal": goal} | wrong
    check_refused(lambda: planners.plan(build_room(name), **options), message)


@refusals(
    "options, message",
    ({"closest": 1}, "closest is 1; it must be True or False"),
    ({"angle": 10.0}, "angle is 10.0 ... radians ... pass 0.174533 for 10 degrees"),
    ({"angle": -0.1}, "angle is -0.1 ... radians"),
    ({"distance": -0.3}, "distance is -0.3 ... zero"),
    ({"distance": math.nan}, "distance"),
    ({"distance": (0.3, 0.1)}, "distance is (0.3, 0.1) ... one number"),
)
def test_near_refuses_wrong_options_when_it_is_made(options, message):
    check_refused(lambda: planners.Near(START, **options), message)


def test_every_list_of_places_is_alternatives_and_a_list_of_numbers_is_one():
    space = build_open_map("turning")
    start, near, far = (1.5, 1.5, 0.0), (2.5, 1.5, 0.0), (6.5, 1.5, 0.0)
    beside = shapely.box(2.5, 1.0, 3.5, 2.0)
    for goal in (
        [near, far],
        (list(far), list(near)),
        np.array([far, near]),
        np.array(near),
        list(near),
        [near],
        [far, planners.Near((2.7, 1.5, 0.0), 0.2)],
        [far, (2.5, 1.5, None)],
        [far, beside],
        [far, (beside, 0.0)],
        (beside, 0.0),
        [beside],
        [beside, beside],
    ):
        plan = planners.plan(space, start, goal)
        np.testing.assert_allclose(plan.goal, near, atol=2e-3)


def test_a_previous_plan_leads_to_no_place_on_the_way():
    space = build_room("plane")
    start, goal = ENDPOINTS["plane"]
    plan = planners.plan(space, start, goal)
    options = {"via": [(2.0, 4.0)], "previous": plan}
    check_refused(
        lambda: planners.plan(space, start, goal, **options),
        "via has 1 places, and previous is given ... followed",
    )


def test_the_table_says_what_a_space_of_your_own_takes():
    start, goal = (0.1, 0.1), (0.9, 0.9)
    given = {
        "a list of alternatives": {"goal": [goal, (0.2, 0.3)]},
        "`cspace.PoseGoal`": {"goal": cspace.PoseGoal("tool", np.eye(4))},
        "a place with any rotation": {"goal": (0.9, 0.9, None)},
        "a place that is a region": {"goal": shapely.box(0.5, 0.5, 0.8, 0.8)},
        "`planners.Near`": {"goal": planners.Near(goal, 0.1)},
        "`planners.Near` as the start": {"start": planners.Near(start, 0.1)},
        "`via`": {"via": [(0.5, 0.1)]},
        "`keep`": {"keep": planners.Upright("tip", tolerance=math.pi)},
    }
    check_support("your own spaces", OpenSpace(), given, start=start, goal=goal, seed=1)
    assert planners.plan(
        OpenSpace(), start, given["a list of alternatives"]["goal"]
    ).goal.tolist() == [
        0.2,
        0.3,
    ]


@pytest.mark.parametrize("flipped", [False, True])
def test_states_that_touch_a_room_only_at_a_corner_count(flipped):
    states = np.full((4, 4), BLOCKED, dtype=np.uint8)
    states[0, 0] = states[0, 1] = FREE
    states[2, 2] = states[3, 3] = FREE
    start, touching, apart = (0.5, 0.5), (1.0, 2.0, 3.0, 3.0), (1.1, 2.0, 3.0, 3.0)
    if flipped:
        states = np.ascontiguousarray(states[::-1, ::-1])
        start, touching, apart = (3.5, 3.5), (1.0, 1.0, 3.0, 2.0), (1.0, 1.0, 2.9, 2.0)
    space = build_from_states(states)
    # The room touches the start's cells in one corner.
    assert not planners.plan(space, start, shapely.box(*touching)).is_disconnected
    assert planners.plan(space, start, shapely.box(*apart)).is_disconnected
