"""Curves of cars: shortest words, proofs and dense paths."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from ompl import base as ob

import planners
from cspace import Robot, Workspace, build
from planners._edges.cars import CarCurves
from planners._edges.drives import local_planner
from planners._ompl.states import make_states
from tests.helpers.drives import CURVES, drive_pieces, make_drive
from tests.helpers.handmade import build_empty
from tests.helpers.placements import is_free_around
from tests.helpers.planning import (
    build_room,
    draw_edges,
    interpolate_poses,
    make_poses,
    points_along,
    shortest_word,
    turn_between,
)
from tests.helpers.strategies import L_SHAPE, examples, few, seeds

OMPL_SPACES = {"dubins": ob.DubinsStateSpace, "reeds-shepp": ob.ReedsSheppStateSpace}
EVERY_CURVE = pytest.mark.parametrize("name", CURVES)


@pytest.fixture(scope="module")
def space():
    return build_room("turning")


def make_curves(name, radius, space=None):
    """Return the edges of a car."""
    return CarCurves(space, make_drive(name, radius))


def measure(curves, first, last):
    """Return the metres of the shortest curve."""
    return float(curves.edge_lengths(np.array([first]), np.array([last]))[0])


def draw_pairs(n, radius, seed=0):
    """Draw pairs of configurations at many multiples of the radius, shape (n, 2, 3)."""
    rng = np.random.default_rng(seed)
    reach = radius * rng.choice([0.01, 1.0, 4.0, 20.0], (n, 1))
    q = rng.uniform(-1.0, 1.0, (n, 2, 3))
    q[:, :, :2] *= reach[:, None]
    q[:, :, 2] *= math.pi
    q[::5, 1, 2] = q[::5, 0, 2]  # parallel
    yaws = q[::10, 0, 2]
    ahead = rng.uniform(-3.0, 3.0, (len(yaws), 1))  # straight on, or back
    q[::10, 1, :2] = q[::10, 0, :2] + ahead * np.column_stack([np.cos(yaws), np.sin(yaws)])
    return q


# ---- words ---------------------------------------------------------------------------------------


def measure_ompls_cost(states, ends, reverse_cost, switch_cost):
    """Return the cost of OMPL's curve by 2,000 chords."""
    rows = interpolate_poses(states, *make_poses(states, *ends), np.linspace(0.0, 1.0, 2001))
    steps = np.diff(rows[:, :2], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    ahead = (steps * np.stack([np.cos(rows[1:, 2]), np.sin(rows[1:, 2])], axis=1)).sum(axis=1)
    # A chord across a cusp is shorter than the chords beside it.
    ways = np.sign(ahead[lengths > 0.9 * np.median(lengths)])
    changes = np.count_nonzero(np.diff(ways))
    return np.where(ahead < 0.0, reverse_cost, 1.0) @ lengths + switch_cost * changes


@pytest.mark.parametrize("costs", [(2.0, 0.0), (1.0, 1.5), (12.0, 3.0)], ids=str)
def test_curves_with_costs_of_reversing_cost_no_more_than_ompls(costs):
    radius = 0.7
    kinds = [OMPL_SPACES[name](radius) for name in ("dubins", "reeds-shepp")]
    drive = planners.Car(radius, reverse=True, reverse_cost=costs[0], switch_cost=costs[1])
    curves = CarCurves(None, drive)
    fewer = 0
    for a, b in draw_pairs(200, radius, seed=1):
        cost = measure(curves, a, b)
        ahead, shortest = (measure_ompls_cost(states, (a, b), *costs) for states in kinds)
        assert cost <= min(ahead, shortest) + 2e-3 * costs[0] * (1.0 + shortest)
        # A curve in reverse is one ahead of a car that faces the other way.
        turned = make_poses(kinds[0], *(np.add(q, [0.0, 0.0, math.pi]) for q in (a, b)))
        assert cost <= costs[0] * kinds[0].distance(*turned) + 2e-6 * radius
        assert cost >= kinds[1].distance(*make_poses(kinds[1], a, b)) - 2e-6 * radius
        fewer += cost < 0.99 * shortest
        # The cost is that of the curve driven.
        steering, lengths, gap = shortest_word(curves, a, b)
        ways = np.sign(lengths[np.abs(lengths) > 1e-9])
        metres = radius * np.where(lengths < 0.0, costs[0], 1.0) @ np.abs(lengths)
        changes = np.count_nonzero(np.diff(ways))
        assert cost == pytest.approx(metres + costs[1] * changes, abs=1e-9) and gap < 1e-6
        end = drive_pieces(a[None], steering[None], radius * lengths[None], radius)[0]
        assert np.abs(end[:2] - b[:2]).max() < 1e-5
    assert fewer >= 40


@EVERY_CURVE
def test_curves_end_at_the_goal_and_are_at_most_as_long_as_ompls(name):
    radius = 0.7
    states = OMPL_SPACES[name](radius)
    curves = make_curves(name, radius)
    shorter = 0
    for k, (a, b) in enumerate(draw_pairs(3000, radius)):
        length = measure(curves, a, b)
        theirs = states.distance(*make_poses(states, a, b))
        assert length <= theirs + 2e-6 * radius
        shorter += length < theirs - 2e-6 * radius
        if k % 10 == 0:
            word = shortest_word(curves, a, b)
            end = drive_pieces(a[None], word[0][None], radius * word[1][None], radius)[0]
            assert np.abs(end[:2] - b[:2]).max() < 1e-5 and word[2] < 2e-8
            assert abs(turn_between(end[2], b[2])) < 2e-6
            assert name == "reeds-shepp" or min(word[1]) >= 0.0
    assert shorter <= 3  # OMPL sometimes misses the curve to a goal straight ahead or behind


@EVERY_CURVE
def test_a_curve_between_its_points_is_no_longer_than_the_part(name):
    # Rounding can easily turn an arc of length zero into a whole turn.
    curves = make_curves(name, 0.5)
    rng = np.random.default_rng(3)
    for a, b in draw_pairs(300, 0.5, seed=3):
        s, t = sorted(rng.uniform(0.0, measure(curves, a, b), 2))
        part = points_along(curves, a, b, np.array([s, t]))
        assert measure(curves, *part) <= (t - s) + 1e-6


# ---- proofs --------------------------------------------------------------------------------------


@pytest.mark.parametrize("rounds", few([100, 300]))
@EVERY_CURVE
def test_a_curve_is_proven_if_it_is_free_with_some_clearance(space, name, rounds):
    radius = 0.5
    curves = make_curves(name, radius, space)
    check = curves.edge_checker()
    distance = 0.1 * space.grid.spacing
    proven = tied = 0
    for a, b in zip(*draw_edges(space, rounds, 1), strict=True):
        points = points_along(curves, a, b, np.linspace(0.0, measure(curves, a, b), 400))
        is_proven = check(*a, *b)
        proven += is_proven
        if is_proven:
            assert (points[:, :2] >= space.grid.lower).all() and space.is_free(points).all()
        # 20 points refute most curves.
        elif is_free_around(space, points[::20], distance, distance / radius).all():
            tied += bool(is_free_around(space, points, distance, distance / radius).all())
    # All equally short curves must be free; reversing cars sometimes have several.
    assert proven > rounds / 20 and tied <= (0.1 * proven if name == "reeds-shepp" else 0)


@EVERY_CURVE
def test_the_curve_that_ompl_interpolates_is_free(space, name):
    # OMPL may choose another equally short curve, or a longer one.
    setup = planners.simple_setup(space, drive=make_drive(name, 0.5))
    info = setup.getSpaceInformation()
    states = setup.getStateSpace()
    assert isinstance(states, OMPL_SPACES[name])
    curves = make_curves(name, 0.5, space)
    shares = np.linspace(0.0, 1.0, 60)
    others = free = 0
    for a, b in zip(*draw_edges(space, 1000, 3), strict=True):
        ends = make_poses(states, a, b)
        if info.checkMotion(*ends):
            free += 1
            theirs = interpolate_poses(states, *ends, shares)
            assert space.is_free(theirs).all()
            ours = points_along(curves, a, b, shares * states.distance(*ends))
            others += np.abs(ours[:, :2] - theirs[:, :2]).max() > 1e-3
    assert free > 30 and (others > 0 or name == "dubins")


# ---- dense paths ---------------------------------------------------------------------------------


@pytest.mark.parametrize("exact", [False, True])
def test_a_curve_that_leaves_the_map_or_has_no_number_is_not_proven(exact):
    space = build_empty((40, 40), Robot.disc(0.01), rotations=4, outside="free")
    check = local_planner(space.exact if exact else space, make_drive("dubins", 1.0)).edge_checker()
    assert check(1.0, 2.0, 0.0, 3.0, 2.0, 0.0)
    assert not check(3.5, 2.0, 0.0, 3.5, 2.0, math.pi)  # turns around, beyond the border
    assert not check(1.0, 2.0, 0.0, 3.0, 2.0, math.nan)
    assert not check(-math.inf, 2.0, 0.0, 3.0, 2.0, 0.0)


# ---- proofs by the geometry ----------------------------------------------------------------------

FOOTPRINT = np.array(L_SHAPE)
POINTS = [(3.0, 3.0), (6.0, 2.5), (4.5, 5.0), (2.5, 6.0), (6.5, 6.5)]
"""Points that a robot can swallow, so that a step across its border would be missed."""
OBSTACLES = np.array([*map(shapely.Point, POINTS), shapely.box(4.0, 1.0, 5.0, 1.5)])


@pytest.fixture(scope="module")
def posts():
    """Build a coarse map of points and a block, whose cells prove little."""
    workspace = Workspace.from_polygons(OBSTACLES, 0.5, (-6, -6, 15, 15))
    return build(workspace, Robot.polygon(FOOTPRINT), rotations=8)


def measure_distance(curves, first, last, count=2000):
    """Return the distance of the robot from obstacles at points of OMPL's curve, metres.

    Also return the distance by which it may be smaller between the points, and the nearest points
    of robot and obstacles.
    """
    states = make_states(curves)
    shares = np.linspace(0.0, 1.0, count)
    q = interpolate_poses(states, *make_poses(states, first, last), shares)
    cos, sin = np.cos(q[:, 2]), np.sin(q[:, 2])
    turns = np.moveaxis(np.array([[cos, sin], [-sin, cos]]), 2, 0)
    corners = FOOTPRINT @ turns + q[:, None, :2]
    robots = shapely.polygons(corners)
    moved = 0.5 * np.linalg.norm(np.diff(corners, axis=0), axis=2).max()
    distances = shapely.distance(robots[:, None], OBSTACLES)
    pose, obstacle = np.unravel_index(distances.argmin(), distances.shape)
    line = shapely.shortest_line(robots[pose], OBSTACLES[obstacle])
    return distances[pose, obstacle], moved, shapely.get_coordinates(line)


def draw_curve(curves, rng):
    """Draw the ends of a curve that passes an obstacle closely, or over it."""
    first = np.append(rng.uniform(2.5, 6.5, 2), rng.uniform(-3.0, 3.0))
    last = first + np.append(rng.uniform(-1.5, 1.5, 2), rng.uniform(-1.0, 1.0))
    distance, _, (near, far) = measure_distance(curves, first, last, 100)
    if distance > 0.0:
        # Move the curve up to the obstacle, but for a small distance; half of them overlap.
        left = rng.choice([-0.2, -1e-6, 1e-4, 3e-3, 1e-2])
        shift = (far - near) * (1.0 - left / distance)
        first[:2] += shift
        last[:2] += shift
    return first, last


@EVERY_CURVE
@examples(150)
@given(seed=seeds)
def test_exact_curves_keep_the_footprint_off_obstacles(posts, name, seed):
    rng = np.random.default_rng(seed)
    curves = local_planner(posts.exact, make_drive(name, float(rng.uniform(0.4, 2.0))))
    first, last = draw_curve(curves, rng)
    if curves.edge_checker()(*first, *last):
        assert measure_distance(curves, first, last)[0] > 0.0


@pytest.mark.parametrize("rounds", few([35, 100]))
@EVERY_CURVE
def test_the_geometry_proves_curves_that_pass_obstacles_closely(posts, name, rounds):
    rng = np.random.default_rng(0)
    curves = local_planner(posts.exact, make_drive(name, 1.0))
    by_cells = local_planner(posts, make_drive(name, 1.0)).edge_checker()
    check = curves.edge_checker()
    clear = missed = cells = 0
    for _ in range(rounds):
        first, last = draw_curve(curves, rng)
        distance, moved, _ = measure_distance(curves, first, last)
        if distance > moved:
            clear += 1
            missed += not check(*first, *last)
            cells += by_cells(*first, *last)
    # Cars that reverse sometimes have several curves that are equally short.
    assert clear >= rounds / 5 and missed <= (0.1 * clear if name == "reeds-shepp" else 0)
    assert cells < 0.1 * clear


def test_exact_checkers_follow_updates_within_ten_micrometres():
    workspace = Workspace.from_polygons(OBSTACLES, 0.5, (0, 0, 9, 9))
    space = build(workspace, Robot.disc(0.2), rotations=4)
    check = local_planner(space.exact, make_drive("dubins", 1.0)).edge_checker()
    quarter_circle = (3.0, 4.0, 0.0, 4.0, 5.0, 0.5 * math.pi)
    middle = np.array([math.sin(0.7), -math.cos(0.7)])  # seen from the center of the circle
    assert check(*quarter_circle)
    space.add_obstacle("near", shapely.Point((3.0, 5.0) + (0.8 - 1e-5) * middle))
    assert check(*quarter_circle)
    space.add_obstacle("nearer", shapely.Point((3.0, 5.0) + (0.8 + 1e-5) * middle))
    assert not check(*quarter_circle)


@pytest.mark.parametrize(
    "workspace, robot",
    [
        (Workspace.from_polygons(shapely.box(1, 1, 8, 8), 0.5, (0, 0, 9, 9)), Robot.disc(0.2)),
        (Workspace.from_array(np.pad(np.ones((14, 14), bool), 2), 0.5), Robot.rectangle(0.4, 0.2)),
        (
            Workspace.from_polygons([shapely.Point(3.4, 4.2)], 0.5, (0, 0, 9, 9)),
            Robot.rectangle(4.0, 4.0),
        ),
    ],
    ids=["robot in a polygon", "robot in cells", "post in the robot"],
)
def test_a_curve_inside_an_obstacle_or_around_one_is_not_free(workspace, robot):
    space = build(workspace, robot, rotations=4, inner=False)
    check = local_planner(space.exact, make_drive("dubins", 1.0)).edge_checker()
    assert not check(3.0, 4.0, 0.0, 4.0, 5.0, 0.5 * math.pi)


@pytest.mark.parametrize(
    "footprint, obstacle, radius, turn",
    [
        (
            shapely.box(-0.01, -0.01, 0.01, 0.01),
            shapely.LineString([(-3, 0.2), (3, 0.2)]),
            1.0,
            1.95,
        ),
        (shapely.box(0.0, -0.005, 3.0, 0.005), shapely.Point(2.9, 0.565), 0.2, 0.4),
    ],
    ids=["arc that crosses a fence twice", "bar that swings past a post"],
)
def test_no_piece_steps_over_a_thin_obstacle(footprint, obstacle, radius, turn):
    workspace = Workspace.from_polygons([obstacle], 0.5, (-6, -6, 6, 6))
    space = build(workspace, Robot.polygon(footprint), rotations=8)
    check = local_planner(space.exact, make_drive("dubins", radius)).edge_checker()
    # The middle of the arc, which is one piece, lies at the origin.
    first, last = (
        (radius * math.sin(yaw), radius * (1.0 - math.cos(yaw)), yaw)
        for yaw in (-0.5 * turn, 0.5 * turn)
    )
    assert space.exact.is_free([first, (0.0, 0.0, 0.0), last]).all()
    assert not check(*first, *last)
