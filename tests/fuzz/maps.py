"""Proofs of maps in every space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.report import Report
from cspace import FREE
from cspace._support.arrays import Floats
from tests.fuzz.scenes import REGIONS, SPACES, Case, Rng, draw_case
from tests.fuzz.tally import ROUNDING, Tally, draw_until, pick_close
from tests.helpers.placements import (
    draw_configurations,
    draw_near_mixed,
    is_free_around,
    move,
    sample_edges,
)
from tests.helpers.regions import move_points

SHARES = {"yaw in space": 10, "quaternions": 10}
"""Divisors of the number of checks, because the oracle is slow for rotating solids."""

POINTS_PER_MAP = 1500
"""Configurations classified per map."""

CANDIDATES, FOLLOWED = 300, 30
"""Edges drawn, and free edges followed, per map."""

POINTS_PER_EDGE = 250
"""Points checked per edge."""

WALKS, STEPS = 30, 25
"""Walks per map, and motions attempted per walk."""

PROVABLE_CELLS = 1e-3
"""Distance from obstacles, in cells, from which a point must be proven."""

CLOSE_SHARE = 0.03
"""Distance from obstacles, in lengths of an edge, from which the edge must be proven."""

EDGE, EXACT_EDGE = "edge", "edge by geometry"


def check(report: Report, seed: int, answers: int, edges: int) -> None:
    """Check random maps of each space."""
    for name in SPACES:
        share = SHARES.get(name, 1)
        check_maps(report, name, seed, answers // share, edges // share)


def check_maps(report: Report, name: str, seed: int, answers: int, edges: int) -> None:
    """Check maps of one space."""

    def enough(tally: Tally) -> bool:
        points = tally.checks["FREE"] + tally.checks["BLOCKED"]
        return points >= answers and tally.checks[EDGE] >= edges * POINTS_PER_EDGE

    def check_case(tally: Tally, number: int) -> None:
        case, rng = draw_case(name, seed, number), np.random.default_rng([seed, number, 1])
        _check_states(tally, case, rng)
        if (case.space.cell_states == FREE).any():
            _check_edges(tally, case, rng)
            _check_boxes(tally, case, rng)
            _check_clearance(tally, case, rng)
        _check_containment(tally, case, rng)
        _check_walks(tally, case, rng)

    draw_until(report, f"{name}, {POINTS_PER_EDGE} points an edge", seed, enough, check_case)


def check_exact(report: Report, seed: int, edges: int) -> None:
    """Check what only ``space.exact`` proves, in each space."""
    for name in SPACES:
        check_exact_maps(report, name, seed, edges // SHARES.get(name, 1))


def check_exact_maps(report: Report, name: str, seed: int, edges: int) -> None:
    """Check what only ``space.exact`` proves in one space."""

    def enough(tally: Tally) -> bool:
        return tally.checks[EXACT_EDGE] >= edges * POINTS_PER_EDGE

    def check_case(tally: Tally, number: int) -> None:
        case = draw_case(name, seed, number)
        _check_exact(tally, case, np.random.default_rng([seed, number, 6]))

    title = f"space.exact, {name}, {POINTS_PER_EDGE} points an edge"
    draw_until(report, title, seed, enough, check_case)


# ---- checks --------------------------------------------------------------------------------------


def _check_states(tally: Tally, case: Case, rng: Rng) -> None:
    """Check configurations anywhere, near undecided cells, and on borders of cells."""
    space, n = case.space, POINTS_PER_MAP // 3
    around = 1.5 * (case.robot.reach + space.margin)
    near = draw_near_mixed(space, rng, n, share=0.9, around=around)
    q = np.concatenate(
        [near, _draw_steps(case, near, 1.0, rng), draw_configurations(space, rng, n)]
    )
    tally.judge(case, q, np.asarray(space.classify(q)))
    # A border belongs to the cells on both sides, so the states of both must be right.
    corners = np.abs([space.grid.lower, space.grid.upper])
    beside = rng.choice([-2.0, 2.0], (n, space.grid.dim)) * np.spacing(corners.max())
    turns = rng.choice([-1e-12, 1e-12], (n, 3))
    tally.judge(case, q[-n:], np.asarray(space.classify(move(space, q[-n:], beside, turns))))


def _check_edges(tally: Tally, case: Case, rng: Rng) -> None:
    """Check all points of free edges."""
    space, grid = case.space, case.space.grid
    starts = space.sample_free(CANDIDATES, rng)
    goals = _draw_steps(case, starts, rng.choice([0.0, 2.0, 10.0, 40.0]), rng)
    for q in (starts, goals):  # some edges lead along the lattice
        cells = np.rint((q[::3, : grid.dim] - grid.lower) / grid.spacing)
        q[::3, : grid.dim] = grid.lower + grid.spacing * cells
    goals[::6, 0] = starts[::6, 0]
    free = np.flatnonzero(space.motion_is_free(starts, goals))
    few = sample_edges(space, starts[free], goals[free], np.linspace(0.0, 1.0, 50))[0]
    picked = free[pick_close(np.asarray(space.clearance(few)).min(axis=1), FOLLOWED, rng)]
    shares = np.linspace(0.0, 1.0, POINTS_PER_EDGE)
    q = sample_edges(space, starts[picked], goals[picked], shares)[0]
    # The other cell may prove an edge on the border of quaternion cells.
    refused = ~np.asarray(space.is_free(q)) & (space.size != 7)
    tally.add_free(EDGE, case, q, refused)


def _check_boxes(tally: Tally, case: Case, rng: Rng) -> None:
    """Check corners and insides of boxes in which chunks that stay are proven."""
    space, dim = case.space, case.space.grid.dim
    distance = space.grid.spacing * rng.choice([0.0, 0.5, 1.0, 3.0]) * rng.uniform(0.5, 1.5)
    angle = rng.choice([0.0, 0.01, 0.1, 1.0, 4.0]) * rng.uniform(0.5, 1.5)
    centers = space.sample_free(200, rng)
    centers = centers[is_free_around(space, centers, distance, angle)][:20]
    q = np.repeat(centers, 12, axis=0)
    shares = np.where(rng.random((len(q), dim + 1)) < 0.4, 1.0, rng.random((len(q), dim + 1)))
    signs = rng.choice([-1.0, 1.0], (len(q), dim))
    turns = angle * shares[:, dim:] * _draw_axes(len(q), rng)
    q = move(space, q, distance * signs * shares[:, :dim], turns)
    tally.add_free("box", case, q, ~np.asarray(space.is_free(q)))


def _check_clearance(tally: Tally, case: Case, rng: Rng) -> None:
    """Check configurations within the clearance of others."""
    space, grid = case.space, case.space.grid
    q = space.sample_free(150, rng)
    far = np.minimum(space.clearance(q), 100.0 * grid.spacing * max(grid.shape))
    steps = rng.normal(size=(len(q), grid.dim))
    steps *= (far * rng.choice([1.0, 0.999, 0.5], len(q)) / np.linalg.norm(steps, axis=1))[:, None]
    q = move(space, q, steps, np.zeros((len(q), 3)))
    tally.add_free("clearance", case, q, ~np.asarray(space.is_free(q)))


def _check_containment(tally: Tally, case: Case, rng: Rng) -> None:
    """Check that the robot's boundary, grown by the margin, lies in obstacles if the robot does."""
    space, dim = case.space, case.space.grid.dim
    q = draw_near_mixed(space, rng, 2000, share=0.0, around=0.0)
    q = q[np.asarray(space.contains_robot(q))][:40]
    away = rng.normal(size=(40, dim))
    away *= space.margin / np.linalg.norm(away, axis=1, keepdims=True)
    points = move_points(case.robot.sample(40, rng) + away, q).reshape(-1, dim)
    point = replace(case, robot=REGIONS[dim].balls(np.zeros((1, dim)), np.zeros(1)))
    outside = ~point.meets(points, ROUNDING).reshape(-1, 40).all(axis=1)
    tally.add("contained", case.name, q, outside)


def _check_walks(tally: Tally, case: Case, rng: Rng) -> None:
    """Check that no proven walk connects configurations that ``is_disconnected``."""
    space = case.space
    first = draw_near_mixed(space, rng, 10 * WALKS, share=0.0, around=0.0)
    first = first[np.asarray(space.exact.is_free(first))][:WALKS]
    last = first.copy()
    for _ in range(STEPS if len(first) else 0):
        goals = _draw_steps(case, last, rng.choice([0.3, 1.0, 3.0]), rng)
        free = np.asarray(space.exact.motion_is_free(last, goals))
        last[free] = goals[free]
    tally.add("path", case.name, last, np.asarray(space.is_disconnected(first, last)))


def _check_exact(tally: Tally, case: Case, rng: Rng) -> None:
    """Check points and edges that are free only with ``space.exact``."""
    space = case.space
    around = 0.5 * (case.robot.reach + space.margin + space.grid.spacing)
    q = draw_near_mixed(space, rng, 4 * CANDIDATES, share=0.8, around=around)
    known, free = np.asarray(space.is_free(q)), np.asarray(space.exact.is_free(q))
    tally.add_free("point by geometry", case, q[free], ~free[free])
    refused = q[~free][:CANDIDATES]
    lost = ~case.meets(refused, space.margin + PROVABLE_CELLS * space.grid.spacing)
    tally.add("refused point", case.name, refused, lost | known[~free][:CANDIDATES])
    starts = q[free & ~known][:CANDIDATES]
    goals = _draw_steps(case, starts, rng.choice([0.1, 0.5, 2.0, 10.0]), rng)
    by_geometry = np.asarray(space.exact.motion_is_free(starts, goals))
    by_map = np.asarray(space.motion_is_free(starts, goals))
    tally.add("edge by the map alone", case.name, starts, by_map & ~by_geometry)
    picked = np.flatnonzero(by_geometry & ~by_map)[:FOLLOWED]
    shares = np.linspace(0.0, 1.0, POINTS_PER_EDGE)
    q = sample_edges(space, starts[picked], goals[picked], shares)[0]
    tally.add_free(EXACT_EDGE, case, q, ~np.asarray(space.exact.is_free(q)))
    refused = np.flatnonzero(~by_geometry)[:FOLLOWED]
    q, radians = sample_edges(space, starts[refused], goals[refused], shares)
    metres = np.linalg.norm((goals - starts)[refused, : space.grid.dim], axis=1)
    reach = space.margin + PROVABLE_CELLS * space.grid.spacing
    reach = reach + CLOSE_SHARE * (metres + case.robot.reach * radians)
    touches = case.meets(q.reshape(-1, space.size), np.repeat(reach, POINTS_PER_EDGE))
    touches = touches.reshape(q.shape[:2]).any(axis=1) | (radians > np.pi - 1e-6)  # both arcs
    tally.add("refused edge", case.name, starts[refused], ~touches)
    _check_distances(tally, case, starts[:8], rng)


def _check_distances(tally: Tally, case: Case, q: Floats, rng: Rng) -> None:
    """Check that ``obstacle_distance`` is a lower bound around configurations, and sharp at them."""
    space, dim = case.space, case.space.grid.dim
    length, turn = space.grid.spacing * rng.choice([0.0, 2.0]), rng.choice([0.0, 0.3])
    around = np.repeat(q, 20, axis=0)
    steps = rng.normal(size=(len(around), dim))
    steps *= 0.5 * length / np.linalg.norm(steps, axis=1, keepdims=True)
    around = move(space, around, steps, 0.5 * turn * _draw_axes(len(around), rng))
    for centers, others in zip(q, np.split(around, len(q)) if len(q) else (), strict=True):
        bound = space.obstacle_distance(centers, length, turn)
        if bound > 0.0:
            others = np.append(others, centers[None], axis=0)
            tally.add("distance", case.name, others, case.meets(others, bound - ROUNDING))
        sharp = space.obstacle_distance(centers)
        if np.isfinite(sharp):
            missed = ~case.meets(centers[None], sharp + PROVABLE_CELLS * space.grid.spacing)
            tally.add("sharp distance", case.name, centers[None], missed)


# ---- configurations ------------------------------------------------------------------------------


def _draw_axes(n: int, rng: Rng) -> Floats:
    """Draw unit vectors, the first half along z."""
    axes = rng.normal(size=(n, 3))
    axes[: n // 2, :2] = 0.0
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _draw_steps(case: Case, q: Floats, cells: float, rng: Rng) -> Floats:
    """Move configurations by a few cells, and rotate them by any angle, often by half a turn."""
    n, dim = len(q), case.space.grid.dim
    steps = cells * case.space.grid.spacing * rng.normal(size=(n, dim))
    angles = rng.choice([0.0, 1e-5, 0.05, 0.5, 2.0], n) * np.abs(rng.normal(size=n))
    angles = np.where(rng.random(n) < 0.05, np.pi, angles)
    return move(case.space, q, steps, angles[:, None] * _draw_axes(n, rng))
