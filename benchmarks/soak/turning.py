"""The proofs of robots that turn, against exact geometry; part of the soak."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak.plane_cases import Case, draw_case
from benchmarks.soak.tally import Tally, not_free
from cspace import BLOCKED, FREE, MIXED
from cspace.rotations import Rotations

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Rng = np.random.Generator

TURN = 2.0 * np.pi

PER_STATE = 1500
"""Configurations drawn in cells of one state, for each map."""

CANDIDATES = 300
TAKEN = 50
"""Edges drawn, and edges of those called free that are followed, for each map."""

ALONG = 1000
"""Points checked along each edge."""

GROUP = 20
"""Points of an edge that are settled together where no obstacle is near enough for any of them."""

FOLLOWED = "edge"


def check(report: Report, seed: int, wanted: int, edges: int) -> None:
    """Random maps until enough FREE and BLOCKED answers and free edges were checked."""
    tally = Tally()
    began, number = time.perf_counter(), 0
    while tally.checks["FREE"] + tally.checks["BLOCKED"] < wanted or tally.checks[FOLLOWED] < edges * ALONG:
        case = draw_case(seed, number, turning=True)
        rng = np.random.default_rng([seed, number, 4])
        _check_states(tally, case, rng)
        if (case.space.stack == FREE).any():
            _check_edges(tally, case, rng)
            _check_boxes(tally, case, rng)
            _check_clearance(tally, case, rng)
        _check_containment(tally, case, rng)
        number += 1
    followed = tally.checks[FOLLOWED] // ALONG
    report.section(
        f"robots that turn: {number} random maps, {followed} edges at {ALONG} points each, seed {seed}, "
        f"{time.perf_counter() - began:.0f} s"
    )
    tally.tell(report)


def _check_states(tally: Tally, case: Case, rng: Rng) -> None:
    """Configurations in cells of each state, on borders and corners and next to them, and anywhere, also outside."""
    space, grid = case.space, case.space.grid
    state, borders = space.state, _borders(case)
    drawn, claimed = [], []
    for claim in (FREE, MIXED, BLOCKED):
        cells = np.flatnonzero(state == claim)
        if not len(cells):
            continue
        number = PER_STATE // 5 if claim == MIXED else PER_STATE
        turn, *place = np.unravel_index(cells[rng.integers(0, len(cells), number)], state.shape)
        within = _within(rng, (number, 2))
        yaw = np.where(rng.random(number) < 0.25, borders[turn + rng.integers(0, 2, number)], np.nan)
        inside = borders[turn] + rng.random(number) * (borders[turn + 1] - borders[turn])
        yaw = np.where(np.isnan(yaw), inside, yaw) + TURN * rng.integers(-2, 3, number)
        drawn.append(np.column_stack([grid.lower + grid.spacing * (np.column_stack(place) + within), yaw]))
        claimed.append(np.full(number, claim))
    q, claims = np.concatenate(drawn), np.concatenate(claimed)
    answers = np.asarray(space.classify(q))
    # A border belongs to both cells: the cell that was drawn and the one that the look-up tells must both be right.
    tally.judge(case, q, claims)
    other = answers != claims
    tally.judge(case, q[other], answers[other])
    reach = case.shape.reach() + space.margin + grid.spacing
    low, high = np.asarray(grid.lower) - 1.5 * reach, np.asarray(grid.upper) + 1.5 * reach
    anywhere = np.column_stack([rng.uniform(low, high, (PER_STATE // 6, 2)), rng.uniform(-9.0, 9.0, PER_STATE // 6)])
    q = np.concatenate([nearly_snapped(case, rng.permutation(q)[: PER_STATE // 6], rng), anywhere])
    tally.judge(case, q, np.asarray(space.classify(q)))


def _check_edges(tally: Tally, case: Case, rng: Rng) -> None:
    """All points of edges that are called free, between random configurations and along the lattice."""
    space, grid = case.space, case.space.grid
    starts = space.sample_free(CANDIDATES, rng)
    snapped = rng.random(CANDIDATES) < 0.3
    starts[snapped] = nearly_snapped(case, starts[snapped], rng, away=0.0)
    steps = grid.spacing * rng.choice([0.0, 2.0, 10.0, 40.0], (CANDIDATES, 1)) * rng.normal(size=(CANDIDATES, 2))
    steps[snapped] = grid.spacing * rng.integers(-6, 7, (int(snapped.sum()), 2))
    turns = rng.choice([0.0, 0.05, 0.5, 2.0], CANDIDATES) * rng.normal(size=CANDIDATES)
    turns = np.where(rng.random(CANDIDATES) < 0.05, np.pi, turns)
    ends = starts + np.column_stack([steps, turns])
    free = np.flatnonzero(space.motion_is_free(starts, ends))
    # The map tells where to look: half of the edges are those that come closest.
    few = np.linspace(0.0, 1.0, 50)
    closest = np.asarray(space.clearance(along(starts[free], ends[free], few, rng))).min(axis=1)
    order = free[np.argsort(closest)]
    picked = np.concatenate([order[: TAKEN // 2], rng.permutation(order[TAKEN // 2 :])[: TAKEN - TAKEN // 2]])
    if not len(picked):
        return
    q = along(starts[picked], ends[picked], np.linspace(0.0, 1.0, ALONG), rng)
    wrong, undecided = not_free_along(case, q)
    tally.add(FOLLOWED, case, q.reshape(-1, 3), (wrong | ~np.asarray(space.is_free(q))).ravel(), undecided.ravel())


def not_free_along(case: Case, q: Floats) -> tuple[Bools, Bools]:
    """:func:`benchmarks.tally.not_free` of the points of edges, shape (edges, points, 3).

    Points are settled in groups: the robot is as far from the obstacles at the middle one as no point of it moves
    within the group. Where it is not, each point of the group is asked by itself.
    """
    groups = q.reshape(len(q), -1, GROUP, 3)
    middles = groups[:, :, GROUP // 2]
    apart = groups - middles[:, :, None]
    moved = np.hypot(apart[..., 0], apart[..., 1]) + case.shape.reach() * np.abs(apart[..., 2])
    distance = moved.max(axis=2).ravel() + case.space.margin + 1e-6
    near = case.shape.meets(case.obstacles, middles.reshape(-1, 3), distance).reshape(middles.shape[:2])
    wrong, undecided = np.zeros((2, *groups.shape[:3]), dtype=np.bool_)
    if near.any():
        close = not_free(case, groups[near].reshape(-1, 3))
        wrong[near], undecided[near] = (part.reshape(-1, GROUP) for part in close)
    return wrong.reshape(q.shape[:2]), undecided.reshape(q.shape[:2])


def _check_boxes(tally: Tally, case: Case, rng: Rng) -> None:
    """Configurations in boxes that are called free all around: in their corners and inside."""
    space, grid = case.space, case.space.grid
    for _ in range(3):
        distance = grid.spacing * float(rng.choice([0.0, 0.5, 1.0, 3.0])) * float(rng.uniform(0.5, 1.5))
        angle = float(rng.choice([0.0, 0.01, 0.1, 1.0, 4.0]) * rng.uniform(0.5, 1.5))
        centers = space.sample_free(200, rng)
        centers[::4] = nearly_snapped(case, centers[::4], rng, away=0.0)
        centers = centers[np.asarray(space.is_free_around(centers, distance, angle))][:20]
        away = np.where(rng.random((len(centers), 20, 3)) < 0.4, 1.0, rng.random((len(centers), 20, 3)))
        away *= rng.choice([-1.0, 1.0], away.shape) * np.array([distance, distance, angle])
        q = (centers[:, None] + away).reshape(-1, 3)
        wrong, undecided = not_free(case, q)
        tally.add("box", case, q, wrong | ~np.asarray(space.is_free(q)), undecided)


def _check_clearance(tally: Tally, case: Case, rng: Rng) -> None:
    """Points as far off as a clearance tells, at any yaw of the rotation cell: each must be FREE, and free."""
    space, grid, borders = case.space, case.space.grid, _borders(case)
    centers = space.sample_free(150, rng)
    far = np.minimum(space.clearance(centers), 100.0 * grid.spacing * max(grid.shape))
    course = rng.uniform(0.0, TURN, len(centers))
    steps = far * rng.choice([1.0, 0.999, 0.5], len(centers))
    turn = Rotations.of(space.rotations or 1).cell_of(centers[:, 2])
    t = np.clip(_within(rng, turn.shape), 1e-6, 1.0 - 1e-6)
    yaw = borders[turn] + t * (borders[turn + 1] - borders[turn])
    q = np.column_stack([centers[:, :2] + steps[:, None] * np.column_stack([np.cos(course), np.sin(course)]), yaw])
    wrong, undecided = not_free(case, q)
    tally.add("clearance", case, q, wrong | ~np.asarray(space.is_free(q)), undecided)


def _check_containment(tally: Tally, case: Case, rng: Rng) -> None:
    """Configurations at which the robot is called contained in the obstacles."""
    import shapely

    grid = case.space.grid
    q = np.column_stack([rng.uniform(grid.lower, grid.upper, (4000, 2)), rng.uniform(-9.0, 9.0, 4000)])
    q = q[np.asarray(case.space.contains_robot(q))][:100]
    solid = [part for part in case.obstacles if part.area]
    if not len(q):
        return
    whole = shapely.union_all(solid)
    shapely.prepare(whole)
    inside = case.shape.lies_in(whole, q, case.space.margin)
    tally.add("contained", case, q, ~inside, np.zeros(len(q), dtype=np.bool_))


def _borders(case: Case) -> Floats:
    return np.array(Rotations.of(case.space.rotations or 1).borders)


def _within(rng: Rng, shape: tuple[int, ...]) -> Floats:
    """Places in cells, from 0 to 1: on either border, and in between."""
    place = rng.choice([0.0, 1.0, np.nan], p=[0.25, 0.25, 0.5], size=shape)
    return np.where(np.isnan(place), rng.random(shape), place)


def nearly_snapped(case: Case, q: Floats, rng: Rng, away: float = 1.0) -> Floats:
    """Configurations on the nearest corner of the lattice, or next to it; many on the border of a rotation cell too."""
    grid, borders = case.space.grid, _borders(case)
    near = np.round((q[:, :2] - grid.lower) / grid.spacing)
    near += away * rng.choice([-1.0, 0.0, 1.0], near.shape) * 10.0 ** rng.uniform(-9.0, -3.0, near.shape)
    yaw = borders[rng.integers(0, len(borders), len(q))]
    yaw = yaw + away * rng.choice([-1.0, 0.0, 1.0], len(q)) * 10.0 ** rng.uniform(-12.0, -3.0, len(q))
    yaw = np.where(rng.random(len(q)) < 0.5, q[:, 2], yaw)
    return np.column_stack([grid.lower + grid.spacing * near, yaw])


def along(starts: Floats, ends: Floats, t: Floats, rng: Rng) -> Floats:
    """Points of edges, shape (edges, points, 3): linear in x, y and yaw, the shorter way round, either way at half."""
    turn = (ends[:, 2] - starts[:, 2] + np.pi) % TURN - np.pi
    half = np.pi - np.abs(turn) < 1e-9
    turn = np.where(half, np.pi * rng.choice([-1.0, 1.0], len(turn)), turn)
    steps = np.column_stack([ends[:, :2] - starts[:, :2], turn])
    q = starts[:, None] + t[:, None] * steps[:, None]
    # Rounding must not carry a point off the edge's own box, and with it out of the grid.
    low, high = np.minimum(starts, ends)[:, None, :2], np.maximum(starts, ends)[:, None, :2]
    q[..., :2] = np.clip(q[..., :2], low, high)
    return q
