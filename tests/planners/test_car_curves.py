"""Curves of cars: shortest words, proofs and dense paths."""

import math

import numpy as np
import pytest
from ompl import base as ob

import planners
from cspace import Robot, Workspace, build
from planners.local_planner import CURVES, CarCurves, local_planner
from tests.helpers.planning import (
    build_room,
    interpolate_poses,
    make_poses,
    points_along,
    shortest_word,
    turn_between,
)

OMPL_SPACES = {"dubins": ob.DubinsStateSpace, "reeds-shepp": ob.ReedsSheppStateSpace}
EVERY_CURVE = pytest.mark.parametrize("name", CURVES)


@pytest.fixture(scope="module")
def space():
    return build_room("turning")


def make_curves(name, radius, space=None):
    """Return the edges of a car."""
    return CarCurves(space, False, name, radius)


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


def drive_word(first, word, radius, steps=4000):
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
            end = drive_word(a, word, radius)
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


def draw_edges(space, n, seed):
    """Draw pairs of FREE configurations, mostly near each other."""
    rng = np.random.default_rng(seed)
    q = np.stack([space.sample_free(n, rng), space.sample_free(n, rng)], axis=1)
    near = rng.random(n) < 0.7
    q[near, 1, :2] = q[near, 0, :2] + rng.uniform(-1.0, 1.0, (near.sum(), 2))
    return q


@EVERY_CURVE
def test_a_curve_is_proven_if_it_is_free_with_some_clearance(space, name):
    radius = 0.5
    curves = make_curves(name, radius, space)
    check = curves.edge_checker()
    distance = 0.1 * space.grid.spacing
    proven = tied = 0
    for a, b in draw_edges(space, 300, 1):
        points = points_along(curves, a, b, np.linspace(0.0, measure(curves, a, b), 400))
        is_proven = check(*a, *b)
        proven += is_proven
        if is_proven:
            assert (points[:, :2] >= space.grid.lower).all() and space.is_free(points).all()
        # 20 points refute most curves.
        elif space.is_free_around(points[::20], distance, distance / radius).all():
            tied += bool(space.is_free_around(points, distance, distance / radius).all())
    # All equally short curves must be free; reversing cars sometimes have several.
    assert proven > 20 and tied <= (0.1 * proven if name == "reeds-shepp" else 0)


@EVERY_CURVE
def test_the_curve_that_ompl_interpolates_is_free(space, name):
    # OMPL may choose another equally short curve, or a longer one.
    setup = planners.simple_setup(space, drive=name, turning_radius=0.5)
    info = setup.getSpaceInformation()
    states = setup.getStateSpace()
    assert isinstance(states, OMPL_SPACES[name])
    curves = make_curves(name, 0.5, space)
    shares = np.linspace(0.0, 1.0, 60)
    others = free = 0
    for a, b in draw_edges(space, 1000, 2):
        ends = make_poses(states, a, b)
        if info.checkMotion(*ends):
            free += 1
            theirs = interpolate_poses(states, *ends, shares)
            assert space.is_free(theirs).all()
            ours = points_along(curves, a, b, shares * states.distance(*ends))
            others += np.abs(ours[:, :2] - theirs[:, :2]).max() > 1e-3
    assert free > 30 and (others > 0 or name == "dubins")


# ---- dense paths ---------------------------------------------------------------------------------


def test_a_curve_that_leaves_the_map_or_has_no_number_is_not_proven():
    workspace = Workspace.from_array(np.zeros((40, 40), dtype=bool), 0.1)
    space = build(workspace, Robot.disc(0.01), rotations=4, outside="free")
    check = local_planner(space, False, "dubins", 1.0).edge_checker()
    assert check(1.0, 2.0, 0.0, 3.0, 2.0, 0.0)
    assert not check(3.5, 2.0, 0.0, 3.5, 2.0, math.pi)  # turns around, beyond the border
    assert not check(1.0, 2.0, 0.0, 3.0, 2.0, math.nan)
    assert not check(-math.inf, 2.0, 0.0, 3.0, 2.0, 0.0)
