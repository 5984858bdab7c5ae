"""Curves of cars: shortest words, proofs and dense paths."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from ompl import base as ob
from scipy.spatial import cKDTree

import planners
from cspace import FREE, MIXED, CSpace, Robot, Workspace, build
from planners.local_planner import CURVES, CarCurves, local_planner
from tests.helpers.handmade import fill_boxes
from tests.helpers.planning import (
    build_from_states,
    build_room,
    points_along,
    shortest_word,
    turn_between,
)
from tests.helpers.strategies import seeds

OMPL_SPACES = {"dubins": ob.DubinsStateSpace, "reeds-shepp": ob.ReedsSheppStateSpace}
EVERY_CURVE = pytest.mark.parametrize("name", CURVES)


@pytest.fixture(scope="module")
def space() -> CSpace:
    return build_room("turning")


def make_curves(name: str, radius: float, space: Any = None) -> CarCurves:
    """Return the edges of a car."""
    return CarCurves(space, False, name, radius)


def measure(curves: CarCurves, first: Any, last: Any) -> float:
    """Return the metres of the shortest curve."""
    return float(curves.edge_lengths(np.array([first]), np.array([last]))[0])


def draw_pairs(n: int, radius: float, seed: int = 0) -> np.ndarray:
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


def make_states(states: Any, *rows: Any) -> list[Any]:
    """Return OMPL's states of configurations."""
    made = [states.allocState() for _ in rows]
    for state, (x, y, yaw) in zip(made, rows, strict=True):
        state.setXY(float(x), float(y))
        state.setYaw(float(yaw))
    return made


def interpolate(states: Any, first: Any, last: Any, shares: np.ndarray) -> np.ndarray:
    """Return the configurations at shares of OMPL's curve."""
    between = states.allocState()
    rows = []
    for share in shares.tolist():
        states.interpolate(first, last, share, between)
        rows.append((between.getX(), between.getY(), between.getYaw()))
    return np.array(rows)


def drive_word(first: Any, word: Any, radius: float, steps: int = 4000) -> np.ndarray:
    """Drive a word in small steps; return its end."""
    turns, lengths, _ = word
    x, y, yaw = first
    for turn, length in zip(turns, lengths, strict=True):
        step = length / steps
        centers = yaw + turn * step * (np.arange(steps) + 0.5)
        x += radius * step * np.cos(centers).sum()
        y += radius * step * np.sin(centers).sum()
        yaw += turn * length
    return np.array([x, y, yaw])


# ---- words ---------------------------------------------------------------------------------------


@EVERY_CURVE
def test_curves_end_at_the_goal_and_are_at_most_as_long_as_ompls(name: str) -> None:
    radius = 0.7
    states = OMPL_SPACES[name](radius)
    curves = make_curves(name, radius)
    shorter = 0
    for k, (a, b) in enumerate(draw_pairs(3000, radius)):
        length = measure(curves, a, b)
        theirs = states.distance(*make_states(states, a, b))
        assert length <= theirs + 2e-6 * radius
        shorter += length < theirs - 2e-6 * radius
        if k % 10 == 0:
            word = shortest_word(curves, a, b)
            end = drive_word(a, word, radius)
            assert np.abs(end[:2] - b[:2]).max() < 1e-5 and word[2] < 2e-8
            assert abs(turn_between(end[2], b[2])) < 2e-6
            assert name == "reeds-shepp" or min(word[1]) >= 0.0
    assert shorter <= 3  # OMPL sometimes misses the curve to a goal straight ahead or behind


@EVERY_CURVE
def test_points_on_a_curve_equal_those_of_ompl(name: str) -> None:
    states = OMPL_SPACES[name](0.8)
    curves = make_curves(name, 0.8)
    # Every fifth pair has parallel yaws, whose curves can be mirrored.
    oblique = [pair for k, pair in enumerate(draw_pairs(500, 0.8, seed=2)) if k % 5]
    shares = np.linspace(0.0, 1.0, 9)
    equal = 0
    for a, b in oblique:
        theirs = interpolate(states, *make_states(states, a, b), shares)
        gaps = points_along(curves, a, b, shares * measure(curves, a, b)) - theirs
        gaps[:, 2] = turn_between(0.0, gaps[:, 2])
        equal += np.abs(gaps).max() < 1e-5
    # A reversing car has many equally short manoeuvres, so OMPL may choose another.
    assert equal >= len(oblique) * (0.99 if name == "dubins" else 0.75)


@EVERY_CURVE
def test_a_curve_between_its_points_is_no_longer_than_the_part(name: str) -> None:
    # Rounding can easily turn an arc of length zero into a whole turn.
    curves = make_curves(name, 0.5)
    rng = np.random.default_rng(3)
    for a, b in draw_pairs(300, 0.5, seed=3):
        s, t = sorted(rng.uniform(0.0, measure(curves, a, b), 2))
        part = points_along(curves, a, b, np.array([s, t]))
        assert measure(curves, *part) <= (t - s) + 1e-6


# ---- proofs --------------------------------------------------------------------------------------


def draw_edges(space: CSpace, n: int, seed: int) -> np.ndarray:
    """Draw pairs of FREE configurations, mostly near each other."""
    rng = np.random.default_rng(seed)
    q = np.stack([space.sample_free(n, rng), space.sample_free(n, rng)], axis=1)
    near = rng.random(n) < 0.7
    q[near, 1, :2] = q[near, 0, :2] + rng.uniform(-1.0, 1.0, (near.sum(), 2))
    return q


@EVERY_CURVE
def test_a_curve_is_proven_if_it_is_free_with_some_clearance(space: CSpace, name: str) -> None:
    radius = 0.5
    curves = make_curves(name, radius, space)
    check = curves.edge_checker()
    distance = 0.1 * space.grid.spacing
    proven = clear = tied = 0
    for a, b in draw_edges(space, 800, 1):
        points = points_along(curves, a, b, np.linspace(0.0, measure(curves, a, b), 2000))
        is_proven = check(*a, *b)
        proven += is_proven
        if is_proven:
            assert (points[:, :2] >= space.grid.lower).all() and space.is_free(points).all()
        # 20 points refute most curves.
        elif space.is_free_around(points[::100], distance, distance / radius).all():
            tied += bool(space.is_free_around(points, distance, distance / radius).all())
    clear = proven + tied
    # All equally short curves must be free; reversing cars sometimes have several.
    assert proven > 20 and tied <= (0.1 * clear if name == "reeds-shepp" else 0)


@EVERY_CURVE
def test_the_curve_that_ompl_interpolates_is_free(space: CSpace, name: str) -> None:
    # OMPL may choose another equally short curve, or a longer one.
    setup = planners.simple_setup(space, drive=name, turning_radius=0.5)
    info = setup.getSpaceInformation()
    states = setup.getStateSpace()
    assert isinstance(states, OMPL_SPACES[name])
    curves = make_curves(name, 0.5, space)
    shares = np.linspace(0.0, 1.0, 60)
    others = free = 0
    for a, b in draw_edges(space, 1000, 2):
        ends = make_states(states, a, b)
        if info.checkMotion(*ends):
            free += 1
            theirs = interpolate(states, *ends, shares)
            assert space.is_free(theirs).all()
            ours = points_along(curves, a, b, shares * states.distance(*ends))
            others += np.abs(ours[:, :2] - theirs[:, :2]).max() > 1e-3
    assert free > 30 and (others > 0 or name == "dubins")


def test_two_equally_short_curves_must_both_be_free() -> None:
    # Two such curves lead a car without reverse to a goal straight behind.
    for boxes, is_free in (((), True), ((np.s_[40:60, 39:43],), False)):
        workspace = Workspace.from_array(fill_boxes((100, 100), *boxes), 0.2)
        room = build(workspace, Robot.rectangle(0.9, 0.5), rotations=72)
        check = local_planner(room, False, "dubins", 1.0).edge_checker()
        assert check(10.0, 10.0, 0.0, 8.5, 10.0, 0.0) == is_free


def free_except_cell(cell: tuple[int, int, int], state: int = MIXED) -> CSpace:
    """Build a FREE map, except for one cell (rotation, x, y)."""
    states = np.full((36, 40, 40), FREE, dtype=np.uint8)
    states[cell] = state
    return build_from_states(states, 36, spacing=0.1)


@EVERY_CURVE
@settings(max_examples=60)
@given(seeds)
def test_a_single_cell_on_a_curve_is_not_stepped_over(name: str, seed: int) -> None:
    curves = make_curves(name, 0.6)
    rng = np.random.default_rng(seed)
    free = free_except_cell((0, 0, 0), FREE)
    a, b = draw_edges(free, 1, seed)[0]
    points = points_along(curves, a, b, np.linspace(0.0, measure(curves, a, b), 500))
    if not local_planner(free, False, name, 0.6).edge_checker()(*a, *b):
        return
    x, y, yaw = points[rng.integers(500)]
    rotation = int(free.rotations.cell_of(yaw))
    place = int(x / 0.1), int(y / 0.1)
    blocked = free_except_cell((rotation, *place))
    assert not local_planner(blocked, False, name, 0.6).edge_checker()(*a, *b)
    # The same position at another yaw is irrelevant.
    touched = free.rotations.cell_of(points[:, 2])
    far = [k for k in range(36) if np.abs((touched - k + 18) % 36 - 18).min() > 1]
    if far and name == "dubins":  # an equally short curve of the other car may touch the cell
        elsewhere = free_except_cell((far[0], *place))
        assert local_planner(elsewhere, False, name, 0.6).edge_checker()(*a, *b)


def test_a_curve_that_leaves_the_map_or_has_no_number_is_not_proven() -> None:
    workspace = Workspace.from_array(np.zeros((40, 40), dtype=bool), 0.1)
    space = build(workspace, Robot.disc(0.01), rotations=4, outside="free")
    check = local_planner(space, False, "dubins", 1.0).edge_checker()
    good = [1.0, 2.0, 0.0, 3.0, 2.0, 0.0]
    assert check(*good)
    assert not check(3.5, 2.0, 0.0, 3.5, 2.0, math.pi)  # turns around, beyond the border
    for k, bad in itertools.product(range(6), (math.nan, math.inf)):
        assert not check(*good[:k], bad, *good[k + 1 :])


# ---- dense paths ---------------------------------------------------------------------------------


@EVERY_CURVE
def test_a_dense_path_lies_on_the_curve_and_contains_the_waypoints(
    space: CSpace, name: str
) -> None:
    curves = make_curves(name, 0.5, space)
    waypoints = draw_pairs(20, 0.5, seed=6).reshape(-1, 3)
    path = curves.resample(waypoints)
    direction = curves.find_directions(path)
    rows = path.tolist()
    indices = [rows.index(q) for q in waypoints.tolist()]
    assert indices == sorted(indices) and (indices[0], indices[-1]) == (0, len(path) - 1)
    steps = np.diff(path[:, :2], axis=0)
    turns = turn_between(path[:-1, 2], path[1:, 2])
    metres = np.linalg.norm(steps, axis=1)
    assert metres.max() <= space.grid.spacing + 1e-9
    assert np.abs(turns).max() <= math.radians(5) + 1e-9
    edges = zip(itertools.pairwise(waypoints), itertools.pairwise(indices), strict=True)
    for (a, b), (i, j) in edges:
        length = measure(curves, a, b)
        fine = points_along(curves, a, b, np.linspace(0.0, length, 5000))
        distances = cKDTree(fine[:, :2]).query(path[i : j + 1, :2])[0]
        assert distances.max() < length / 5000 + 1e-6
    # The direction is the sign of the motion along the heading halfway between two rows.
    halfway = path[:-1, 2] + turns / 2
    ahead = steps[:, 0] * np.cos(halfway) + steps[:, 1] * np.sin(halfway)
    moves = metres > 1e-6
    assert (np.sign(ahead) == direction[1:])[moves].all() and len(direction) == len(path)
    assert (set(direction.tolist()) == {1, -1}) == (name == "reeds-shepp")


@EVERY_CURVE
@pytest.mark.parametrize("hair", [(0.0, 0.0, 1e-12), (0.0, 1e-7, 0.0)], ids=["turn", "side"])
def test_a_goal_a_hair_from_the_start_is_reached(space: CSpace, name: str, hair: Any) -> None:
    start = np.array([1.05, 1.05, 0.1])
    options = {"drive": name, "turning_radius": 0.5, "time_limit": 2.0, "seed": 1}
    assert planners.plan(space, start, start + hair, **options).certified
    still = make_curves(name, 0.5, space).resample(start[None])
    assert measure(make_curves(name, 0.5), start, start) == 0.0
    assert still.tolist() == [start.tolist()]
