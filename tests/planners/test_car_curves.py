"""Curves of cars: shortest words, proofs and dense paths."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
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

OMPL_SPACES = {"dubins": ob.DubinsStateSpace, "reeds-shepp": ob.ReedsSheppStateSpace}
TURNING_RADII = [0.3, 1.0, 4.0]


@pytest.fixture(scope="module")
def space() -> CSpace:
    return build_room("turning")


def curve(name: str, radius: float, space: Any = None) -> CarCurves:
    return CarCurves(space, False, name, radius)


def metres(curves: CarCurves, first: np.ndarray, last: np.ndarray) -> float:
    """Return the length of the shortest curve."""
    return float(curves.edge_lengths(first[None], last[None])[0])


def pairs(n: int, radius: float, seed: int = 0) -> np.ndarray:
    """Draw pairs of configurations at many multiples of the radius."""
    rng = np.random.default_rng(seed)
    reach = radius * rng.choice([0.01, 1.0, 4.0, 20.0], (n, 1, 1))
    q = rng.uniform(-1.0, 1.0, (n, 2, 3)) * np.concatenate(
        [reach, reach, np.full_like(reach, math.pi)], axis=-1
    )
    q[::5, 1, 2] = q[::5, 0, 2]  # parallel
    heading = np.stack([np.cos(q[::10, 0, 2]), np.sin(q[::10, 0, 2])], axis=-1)
    q[::10, 1, :2] = q[::10, 0, :2] + heading * rng.uniform(
        -3.0, 3.0, (len(heading), 1)
    )  # straight on, or back
    return q


def as_states(states: Any, a: Any, b: Any) -> tuple[Any, Any]:
    first, second = states.allocState(), states.allocState()
    for state, q in ((first, a), (second, b)):
        state.setXY(float(q[0]), float(q[1]))
        state.setYaw(float(q[2]))
    return first, second


def drive(first: Any, word: Any, radius: float, steps: int = 4000) -> np.ndarray:
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


@pytest.mark.parametrize("radius", TURNING_RADII)
@pytest.mark.parametrize("name", CURVES)
def test_curves_are_at_most_as_long_as_ompls(name: str, radius: float) -> None:
    states, curves, longer = OMPL_SPACES[name](radius), curve(name, radius), 0
    for a, b in pairs(3000, radius):
        length = metres(curves, a, b)
        theirs = states.distance(*as_states(states, a, b))
        assert length <= theirs + 2e-6 * radius
        longer += length < theirs - 2e-6 * radius
    assert (
        longer <= 3
    )  # OMPL sometimes misses the shortest curve to a goal straight ahead or behind


@pytest.mark.parametrize("name", CURVES)
def test_a_word_ends_at_the_goal(name: str) -> None:
    for a, b in pairs(300, 0.7, seed=1):
        word = shortest_word(curve(name, 0.7), a, b)
        end = drive(a, word, 0.7)
        assert np.abs(end[:2] - b[:2]).max() < 1e-5 and abs(turn_between(end[2], b[2])) < 2e-6
        assert word[2] < 2e-8
        assert name == "reeds-shepp" or min(word[1]) >= 0.0


@pytest.mark.parametrize("name", CURVES)
def test_points_on_a_curve_equal_those_of_ompl(name: str) -> None:
    states, curves = OMPL_SPACES[name](0.8), curve(name, 0.8)
    # Every fifth pair has parallel yaws, whose curves can be mirrored.
    oblique = [pair for k, pair in enumerate(pairs(500, 0.8, seed=2)) if k % 5]
    same = 0
    for a, b in oblique:
        first, second = as_states(states, a, b)
        length, between = metres(curves, a, b), states.allocState()
        shares = np.linspace(0.0, 1.0, 9)
        theirs = []
        for share in shares:
            states.interpolate(first, second, share, between)
            theirs.append((between.getX(), between.getY(), between.getYaw()))
        apart = points_along(curves, a, b, shares * length) - theirs
        apart[:, 2] = turn_between(0.0, apart[:, 2])
        same += np.abs(apart).max() < 1e-5
    # A reversing car has many equally short manoeuvres, so OMPL may choose another.
    assert same >= len(oblique) * (0.99 if name == "dubins" else 0.75)


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_between_its_points_is_no_longer_than_the_part(name: str) -> None:
    # Rounding can easily turn an arc of length zero into a whole turn.
    curves = curve(name, 0.5)
    rng = np.random.default_rng(3)
    for a, b in pairs(500, 0.5, seed=3):
        length = metres(curves, a, b)
        s, t = sorted(rng.uniform(0.0, length, 2))
        part = points_along(curves, a, b, np.array([s, t]))
        assert metres(curves, *part) <= (t - s) + 1e-6


# ---- proofs --------------------------------------------------------------------------------------


def draw_edges(space: CSpace, n: int, seed: int) -> np.ndarray:
    """Draw pairs of FREE configurations, mostly near each other."""
    rng = np.random.default_rng(seed)
    q = np.stack([space.sample_free(n, rng), space.sample_free(n, rng)], axis=1)
    near = rng.random(n) < 0.7
    q[near, 1, :2] = q[near, 0, :2] + rng.uniform(-1.0, 1.0, (near.sum(), 2))
    return q


@pytest.mark.parametrize("radius", [0.3, 1.0])
@pytest.mark.parametrize("name", CURVES)
def test_a_proven_curve_is_free_at_a_thousand_points(
    space: CSpace, name: str, radius: float
) -> None:
    local = local_planner(space, False, name, radius)
    check, kinds, curves = local.edge_checker(), set(), curve(name, radius, space)
    for a, b in draw_edges(space, 400, 0):
        kinds.add(proven := check(*a, *b))
        if proven:
            points = points_along(curves, a, b, np.linspace(0.0, metres(curves, a, b), 1000))
            assert ((points[:, :2] >= space.grid.lower) & (points[:, :2] <= space.grid.upper)).all()
            assert space.is_free(points).all()
    assert kinds == {True, False}


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_with_some_clearance_is_proven(space: CSpace, name: str) -> None:
    local, curves = local_planner(space, False, name, 0.5), curve(name, 0.5, space)
    check, counted, tied = local.edge_checker(), 0, 0
    distance = 0.1 * space.grid.spacing

    def is_clear(a: np.ndarray, b: np.ndarray, number: int) -> bool:
        points = points_along(curves, a, b, np.linspace(0.0, metres(curves, a, b), number))
        return bool(space.is_free_around(points, distance, distance / 0.5).all())

    for a, b in draw_edges(space, 800, 1):
        if is_clear(a, b, 20) and is_clear(a, b, 3000):  # 20 points refute most curves
            counted += 1
            tied += not check(*a, *b)
    # All equally short curves must be free; reversing cars sometimes have several.
    assert counted > 20 and tied <= (0.1 * counted if name == "reeds-shepp" else 0)


@pytest.mark.parametrize("name", CURVES)
def test_the_curve_that_ompl_interpolates_is_free(space: CSpace, name: str) -> None:
    # OMPL may choose another equally short curve, or a longer one.
    setup = planners.simple_setup(space, drive=name, turning_radius=0.5)
    info, states = setup.getSpaceInformation(), setup.getStateSpace()
    assert isinstance(states, OMPL_SPACES[name])
    out, curves, others, free = states.allocState(), curve(name, 0.5, space), 0, 0
    for a, b in draw_edges(space, 1500, 2):
        first, second = as_states(states, a, b)
        if not info.checkMotion(first, second):
            continue
        free += 1
        length = states.distance(first, second)
        theirs = []
        for t in np.linspace(0.0, 1.0, 60):
            states.interpolate(first, second, float(t), out)
            theirs.append((out.getX(), out.getY(), out.getYaw()))
        assert space.is_free(theirs).all()
        ours = points_along(curves, a, b, np.linspace(0.0, 1.0, 60) * length)
        others += np.abs(ours[:, :2] - np.array(theirs)[:, :2]).max() > 1e-3
    assert free > 50 and (others > 0 or name == "dubins")


def test_two_equally_short_curves_must_both_be_free() -> None:
    # Two such curves lead a car without reverse to a goal straight behind.
    clear, blocked = (
        build(
            Workspace.from_array(fill_boxes((200, 200), *boxes), 0.1),
            Robot.rectangle(0.9, 0.5),
            rotations=72,
        )
        for boxes in ((), (np.s_[80:120, 79:85],))
    )
    for a, b in (((10.0, 10.0, 0.0), (9.0, 10.0, 0.0)), ((10.0, 10.0, 0.0), (8.5, 10.0, 0.0))):
        assert local_planner(clear, False, "dubins", 1.0).edge_checker()(*a, *b)
        assert not local_planner(blocked, False, "dubins", 1.0).edge_checker()(*a, *b)


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("hair", [(0.0, 0.0, 1e-12), (0.0, 1e-7, 0.0), (5e-10, 0.0, 0.0)])
def test_a_goal_a_hair_from_the_start_is_reached(space: CSpace, name: str, hair: Any) -> None:
    start = np.array([1.05, 1.05, 0.1])
    plan = planners.plan(
        space, start, start + hair, drive=name, turning_radius=0.5, time_limit=2.0, seed=1
    )
    assert plan.solved and plan.certified and plan.clearance >= 0.0


def free_except_cell(cell: tuple[int, int, int], state: int = MIXED) -> CSpace:
    """Build a FREE map, except for one cell (rotation, x, y)."""
    stack = np.full((36, 40, 40), FREE, dtype=np.uint8)
    stack[cell] = state
    return build_from_states(stack, len(stack), spacing=0.1)


@pytest.mark.parametrize("name", CURVES)
def test_a_single_cell_on_a_curve_is_not_stepped_over(name: str) -> None:
    curves = curve(name, 0.6)
    rng = np.random.default_rng(5)
    free = free_except_cell((0, 0, 0), FREE)
    check, hits, tied = local_planner(free, False, name, 0.6).edge_checker(), 0, 0
    for a, b in draw_edges(free, 120, 2):
        length = metres(curves, a, b)
        points = points_along(curves, a, b, np.linspace(0.0, length, 500))
        if not check(*a, *b):
            # An equally short curve of a reversing car may leave the map.
            tied += bool(((points[:, :2] > 0.01) & (points[:, :2] < 3.99)).all())
            continue
        x, y, yaw = points[rng.integers(500)]
        assert len(free.rotations.names)
        cell = (int(free.rotations.cell_of(yaw)), int(x / 0.1), int(y / 0.1))
        assert not local_planner(free_except_cell(cell), False, name, 0.6).edge_checker()(*a, *b)
        # The same position at another yaw is irrelevant.
        others = free.rotations.cell_of(points[:, 2])
        far = next((k for k in range(36) if np.min(np.abs((others - k + 18) % 36 - 18)) > 1), None)
        if far is not None:
            assert local_planner(
                free_except_cell((far, *cell[1:])), False, name, 0.6
            ).edge_checker()(*a, *b)
        hits += 1
    assert hits > 40 and tied <= (3 if name == "reeds-shepp" else 0)


def test_a_curve_that_leaves_the_map_is_not_proven() -> None:
    space = free_except_cell((0, 0, 0), FREE)
    open_space = build(
        Workspace.from_array(np.zeros((40, 40), dtype=bool), 0.1),
        Robot.disc(0.01),
        rotations=4,
        outside="free",
    )
    for each in (space, open_space):
        check = local_planner(each, False, "dubins", 1.0).edge_checker()
        assert check(1.0, 2.0, 0.0, 3.0, 2.0, 0.0)
        assert not check(3.5, 2.0, 0.0, 3.5, 2.0, math.pi)  # turns around, beyond the border


def test_a_curve_with_nan_or_infinity_is_not_proven(space: CSpace) -> None:
    for name in CURVES:
        check = local_planner(space, False, name, 0.5).edge_checker()
        for k in range(6):
            for bad in (math.nan, math.inf):
                q = [1.0, 1.0, 0.0, 1.2, 1.0, 0.0]
                q[k] = bad
                assert not check(*q)


# ---- dense paths ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CURVES)
def test_a_dense_path_lies_on_the_curve_and_contains_the_waypoints(
    space: CSpace, name: str
) -> None:
    curves = curve(name, 0.5, space)
    waypoints = np.concatenate([pairs(20, 0.5, seed=6).reshape(-1, 3)])
    path = curves.resample(waypoints)
    direction = curves.find_directions(path)
    assert direction is not None and len(direction) == len(path)
    rows = [tuple(row) for row in path.tolist()]
    indices = [rows.index(tuple(q)) for q in waypoints.tolist()]
    assert indices == sorted(indices) and indices[0] == 0 and indices[-1] == len(path) - 1
    steps, turns = (
        np.hypot(*np.diff(path[:, :2], axis=0).T),
        turn_between(path[:-1, 2], path[1:, 2]),
    )
    assert (
        steps.max() <= space.grid.spacing + 1e-9 and np.abs(turns).max() <= math.radians(5) + 1e-9
    )
    for (a, b), (i, j) in zip(
        itertools.pairwise(waypoints), itertools.pairwise(indices), strict=True
    ):
        length = metres(curves, a, b)
        fine = points_along(curves, a, b, np.linspace(0.0, length, 5000))
        assert cKDTree(fine[:, :2]).query(path[i : j + 1, :2])[0].max() < length / 5000 + 1e-6
    # The direction is the sign of the motion along the heading halfway between two rows.
    halfway = path[:-1, 2] + turns / 2
    ahead = (
        np.diff(path[:, :2], axis=0) * np.stack([np.cos(halfway), np.sin(halfway)], axis=-1)
    ).sum(axis=1)
    clear = steps > 1e-6
    assert (np.sign(ahead[clear]) == direction[1:][clear]).all()
    assert (set(direction.tolist()) == {1, -1}) == (name == "reeds-shepp")


def test_a_path_of_one_configuration_stays_in_place(space: CSpace) -> None:
    q = np.array([[1.0, 1.0, 0.0]])
    assert all(metres(curve(name, 0.5), q[0], q[0]) == 0.0 for name in CURVES)
    curves = curve("dubins", 0.5, space)
    path = curves.resample(q)
    direction = curves.find_directions(path)
    assert path.tolist() == q.tolist() and direction is not None and direction.tolist() == [1]
    path = curves.resample(np.concatenate([q, q]))
    assert path[0].tolist() == path[-1].tolist() == q[0].tolist()
