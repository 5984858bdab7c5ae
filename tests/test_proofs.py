"""Proofs of random maps, compared with independent geometry."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from cspace import FREE
from tests.helpers.placements import (
    draw_configurations,
    draw_near_mixed,
    is_free_around,
    move,
    sample_edges,
)
from tests.helpers.regions import move_points
from tests.helpers.scenes import REGIONS, ROUNDING, SPACES, draw_case, expect, pick_close
from tests.helpers.strategies import examples, seeds

pytestmark = pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # tiny or distant obstacles

POINTS_PER_MAP = 1500
"""Configurations classified per map."""

CANDIDATES, FOLLOWED = 300, 30
"""Edges drawn, and free edges followed, per map."""

SHARES = np.linspace(0.0, 1.0, 250)
"""Shares of an edge at which it is checked."""

WALKS, STEPS = 30, 25
"""Walks per map, and motions attempted per walk."""

PROVABLE_CELLS = 1e-3
"""Distance from obstacles, in cells, from which a point must be proven."""

CLOSE_SHARE = 0.03
"""Distance from obstacles, in lengths of an edge, from which the edge must be proven."""


@pytest.mark.parametrize("name", SPACES)
@examples(10)
@given(seeds)
def test_proofs_of_random_maps_agree_with_independent_geometry(name, seed):
    case, rng = draw_case(name, seed), np.random.default_rng([seed, 1])
    check_states(case, rng)
    if (case.space.cell_states == FREE).any():
        check_edges(case, rng)
        check_boxes(case, rng)
        check_clearance(case, rng)
    check_containment(case, rng)
    check_walks(case, rng)


@pytest.mark.parametrize("name", SPACES)
@examples(10)
@given(seeds)
def test_what_geometry_alone_proves_agrees_with_independent_geometry(name, seed):
    check_exact(draw_case(name, seed), np.random.default_rng([seed, 6]))


# ---- checks --------------------------------------------------------------------------------------


def check_states(case, rng):
    """Check configurations anywhere, near undecided cells, and on borders of cells."""
    space, n = case.space, POINTS_PER_MAP // 3
    around = 1.5 * (case.robot.reach + space.margin)
    near = draw_near_mixed(space, rng, n, share=0.9, around=around)
    q = np.concatenate([near, draw_steps(case, near, 1.0, rng), draw_configurations(space, rng, n)])
    case.check_states(q, np.asarray(space.classify(q)))
    # A border belongs to the cells on both sides, so the states of both must be right.
    corners = np.abs([space.grid.lower, space.grid.upper])
    beside = rng.choice([-2.0, 2.0], (n, space.grid.dim)) * np.spacing(corners.max())
    turns = rng.choice([-1e-12, 1e-12], (n, 3))
    case.check_states(q[-n:], np.asarray(space.classify(move(space, q[-n:], beside, turns))))


def check_edges(case, rng):
    """Check all points of free edges."""
    space, grid = case.space, case.space.grid
    starts = space.sample_free(CANDIDATES, rng)
    goals = draw_steps(case, starts, rng.choice([0.0, 2.0, 10.0, 40.0]), rng)
    for q in (starts, goals):  # some edges lead along the lattice
        cells = np.rint((q[::3, : grid.dim] - grid.lower) / grid.spacing)
        q[::3, : grid.dim] = grid.lower + grid.spacing * cells
    goals[::6, 0] = starts[::6, 0]
    free = np.flatnonzero(space.motion_is_free(starts, goals))
    few = sample_edges(space, starts[free], goals[free], np.linspace(0.0, 1.0, 50))[0]
    picked = free[pick_close(np.asarray(space.clearance(few)).min(axis=1), FOLLOWED, rng)]
    q = sample_edges(space, starts[picked], goals[picked], SHARES)[0]
    # The other cell may prove an edge on the border of quaternion cells.
    refused = ~np.asarray(space.is_free(q)) & (space.size != 7)
    case.check_free("edge", q, refused)


def check_boxes(case, rng):
    """Check corners and insides of boxes in which chunks that stay are proven."""
    space, dim = case.space, case.space.grid.dim
    distance = space.grid.spacing * rng.choice([0.0, 0.5, 1.0, 3.0]) * rng.uniform(0.5, 1.5)
    angle = rng.choice([0.0, 0.01, 0.1, 1.0, 4.0]) * rng.uniform(0.5, 1.5)
    centers = space.sample_free(200, rng)
    centers = centers[is_free_around(space, centers, distance, angle)][:20]
    q = np.repeat(centers, 12, axis=0)
    shares = np.where(rng.random((len(q), dim + 1)) < 0.4, 1.0, rng.random((len(q), dim + 1)))
    signs = rng.choice([-1.0, 1.0], (len(q), dim))
    turns = angle * shares[:, dim:] * draw_axes(len(q), rng)
    q = move(space, q, distance * signs * shares[:, :dim], turns)
    case.check_free("box", q, ~np.asarray(space.is_free(q)))


def check_clearance(case, rng):
    """Check configurations within the clearance of others."""
    space, grid = case.space, case.space.grid
    q = space.sample_free(150, rng)
    far = np.minimum(space.clearance(q), 100.0 * grid.spacing * max(grid.shape))
    steps = rng.normal(size=(len(q), grid.dim))
    steps *= (far * rng.choice([1.0, 0.999, 0.5], len(q)) / np.linalg.norm(steps, axis=1))[:, None]
    q = move(space, q, steps, np.zeros((len(q), 3)))
    case.check_free("clearance", q, ~np.asarray(space.is_free(q)))


def check_containment(case, rng):
    """Check that the robot's boundary, grown by the margin, lies in obstacles if the robot does."""
    space, dim = case.space, case.space.grid.dim
    q = draw_near_mixed(space, rng, 2000, share=0.0, around=0.0)
    q = q[np.asarray(space.contains_robot(q))][:40]
    away = rng.normal(size=(40, dim))
    away *= space.margin / np.linalg.norm(away, axis=1, keepdims=True)
    points = move_points(case.robot.sample(40, rng) + away, q).reshape(-1, dim)
    point = replace(case, robot=REGIONS[dim].balls(np.zeros((1, dim)), np.zeros(1)))
    expect("contained", q, point.meets(points, ROUNDING).reshape(-1, 40).all(axis=1))


def check_walks(case, rng):
    """Check that no proven walk connects configurations that ``is_disconnected``."""
    space = case.space
    first = draw_near_mixed(space, rng, 10 * WALKS, share=0.0, around=0.0)
    first = first[np.asarray(space.exact.is_free(first))][:WALKS]
    last = first.copy()
    for _ in range(STEPS if len(first) else 0):
        goals = draw_steps(case, last, rng.choice([0.3, 1.0, 3.0]), rng)
        free = np.asarray(space.exact.motion_is_free(last, goals))
        last[free] = goals[free]
    expect("path", last, ~np.asarray(space.is_disconnected(first, last)))


def check_exact(case, rng):
    """Check points and edges that are free only with ``space.exact``."""
    space = case.space
    around = 0.5 * (case.robot.reach + space.margin + space.grid.spacing)
    q = draw_near_mixed(space, rng, 4 * CANDIDATES, share=0.8, around=around)
    known, free = np.asarray(space.is_free(q)), np.asarray(space.exact.is_free(q))
    case.check_free("point by geometry", q[free], ~free[free])
    refused = q[~free][:CANDIDATES]
    is_close = case.meets(refused, space.margin + PROVABLE_CELLS * space.grid.spacing)
    expect("refused point", refused, is_close & ~known[~free][:CANDIDATES])
    starts = q[free & ~known][:CANDIDATES]
    goals = draw_steps(case, starts, rng.choice([0.1, 0.5, 2.0, 10.0]), rng)
    by_geometry = np.asarray(space.exact.motion_is_free(starts, goals))
    by_map = np.asarray(space.motion_is_free(starts, goals))
    expect("edge by the map alone", starts, ~by_map | by_geometry)
    picked = np.flatnonzero(by_geometry & ~by_map)[:FOLLOWED]
    q = sample_edges(space, starts[picked], goals[picked], SHARES)[0]
    case.check_free("edge by geometry", q, ~np.asarray(space.exact.is_free(q)))
    refused = np.flatnonzero(~by_geometry)[:FOLLOWED]
    q, radians = sample_edges(space, starts[refused], goals[refused], SHARES)
    metres = np.linalg.norm((goals - starts)[refused, : space.grid.dim], axis=1)
    reach = space.margin + PROVABLE_CELLS * space.grid.spacing
    reach = reach + CLOSE_SHARE * (metres + case.robot.reach * radians)
    touches = case.meets(q.reshape(-1, space.size), np.repeat(reach, len(SHARES)))
    touches = touches.reshape(q.shape[:2]).any(axis=1) | (radians > np.pi - 1e-6)  # both arcs
    expect("refused edge", starts[refused], touches)
    check_distances(case, starts[:8], rng)


def check_distances(case, q, rng):
    """Check that ``obstacle_distance`` is a lower bound around configurations, and sharp at them."""
    space, dim = case.space, case.space.grid.dim
    length, turn = space.grid.spacing * rng.choice([0.0, 2.0]), rng.choice([0.0, 0.3])
    around = np.repeat(q, 20, axis=0)
    steps = rng.normal(size=(len(around), dim))
    steps *= 0.5 * length / np.linalg.norm(steps, axis=1, keepdims=True)
    around = move(space, around, steps, 0.5 * turn * draw_axes(len(around), rng))
    for centers, others in zip(q, np.split(around, len(q)) if len(q) else (), strict=True):
        bound = space.obstacle_distance(centers, length, turn)
        if bound > 0.0:
            others = np.append(others, centers[None], axis=0)
            expect("distance", others, ~case.meets(others, bound - ROUNDING))
        sharp = space.obstacle_distance(centers)
        if np.isfinite(sharp):
            is_reached = case.meets(centers[None], sharp + PROVABLE_CELLS * space.grid.spacing)
            expect("sharp distance", centers[None], is_reached)


# ---- configurations ------------------------------------------------------------------------------


def draw_axes(n, rng):
    """Draw unit vectors, the first half along z."""
    axes = rng.normal(size=(n, 3))
    axes[: n // 2, :2] = 0.0
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def draw_steps(case, q, cells, rng):
    """Move configurations by a few cells, and rotate them by any angle, often by half a turn."""
    n, dim = len(q), case.space.grid.dim
    steps = cells * case.space.grid.spacing * rng.normal(size=(n, dim))
    angles = rng.choice([0.0, 1e-5, 0.05, 0.5, 2.0], n) * np.abs(rng.normal(size=n))
    angles = np.where(rng.random(n) < 0.05, np.pi, angles)
    return move(case.space, q, steps, angles[:, None] * draw_axes(n, rng))
