"""The proofs of robots that translate in space, against exact geometry; part of the soak."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak.plane_geometry import ROUNDING
from benchmarks.soak.space_cases import SolidCase, draw_solid_case
from benchmarks.soak.space_pairs import NO_FCL, leaves_free
from benchmarks.soak.tally import Tally, not_free
from cspace import BLOCKED, FREE, MIXED

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Rng = np.random.Generator

PER_STATE = 900
"""Configurations drawn in cells of FREE and of BLOCKED, for each map; half of them where the state changes."""

CANDIDATES = 150
TAKEN = 24
"""Edges drawn, and edges of those called free that are followed, for each map."""

ALONG = 1000
"""Points checked along each edge."""

EDGE = "edge"


def check(report: Report, seed: int, wanted: int, edges: int) -> None:
    """Random maps until enough FREE and BLOCKED answers and free edges were checked."""
    try:
        import fcl  # noqa: F401 - whether it is there at all
    except ImportError:
        report.note(f"robots in space skipped: {NO_FCL}")
        return
    tally = Tally()
    began, number = time.perf_counter(), 0
    while tally.checks["FREE"] + tally.checks["BLOCKED"] < wanted or tally.checks[EDGE] < edges * ALONG:
        case = draw_solid_case(seed, number)
        rng = np.random.default_rng([seed, number, 8])
        _check_states(tally, case, rng)
        if (case.space.state == FREE).any():
            _check_edges(tally, case, rng)
            _check_boxes(tally, case, rng)
            _check_clearance(tally, case, rng)
        _check_containment(tally, case, rng)
        number += 1
    report.section(
        f"robots in space: {number} random maps, {tally.checks[EDGE] // ALONG} edges at {ALONG} points each, seed "
        f"{seed}, {time.perf_counter() - began:.0f} s"
    )
    tally.tell(report)


def _check_states(tally: Tally, case: SolidCase, rng: Rng) -> None:
    """Configurations in cells of each state, on borders and corners and next to them, and anywhere, also outside."""
    space, grid = case.space, case.space.grid
    border = _changes(space.state)
    drawn, claimed = [], []
    for claim in (FREE, MIXED, BLOCKED):
        number = PER_STATE // 9 if claim == MIXED else PER_STATE // 2
        alike = space.state == claim
        for cells in (np.argwhere(alike), np.argwhere(alike & border)):
            if len(cells):
                within = rng.choice([0.0, 1.0, np.nan], p=[0.25, 0.25, 0.5], size=(number, 3))
                within = np.where(np.isnan(within), rng.random(within.shape), within)
                cells = cells[rng.integers(0, len(cells), number)]
                drawn.append(grid.lower + grid.spacing * (cells + within))
                claimed.append(np.full(number, claim))
    q, claims = np.concatenate(drawn), np.concatenate(claimed)
    answers = np.asarray(space.classify(q))
    # A border belongs to both cells: the cell that was drawn and the one that the look-up tells must both be right.
    tally.judge(case, q, claims)
    other = answers != claims
    tally.judge(case, q[other], answers[other])
    reach = np.abs(case.robot.most.bounds).max() + space.margin + grid.spacing
    low, high = np.asarray(grid.lower) - 1.5 * reach, np.asarray(grid.upper) + 1.5 * reach
    anywhere = rng.uniform(low, high, (PER_STATE // 6, 3))
    q = np.concatenate([_nearly_snapped(case, rng.permutation(q)[: PER_STATE // 6], rng), anywhere])
    tally.judge(case, q, np.asarray(space.classify(q)))


def _changes(state: NDArray[np.uint8]) -> Bools:
    """Cells with another state in a cell next to them, across a side, an edge or a corner."""
    from scipy import ndimage

    return np.asarray(ndimage.maximum_filter(state, 3) != ndimage.minimum_filter(state, 3))


def _nearly_snapped(case: SolidCase, q: Floats, rng: Rng, away: float = 1.0) -> Floats:
    """Configurations on the nearest corner of the lattice, or next to it."""
    grid = case.space.grid
    near = np.round((q - grid.lower) / grid.spacing)
    near += away * rng.choice([-1.0, 0.0, 1.0], near.shape) * 10.0 ** rng.uniform(-9.0, -3.0, near.shape)
    return np.asarray(grid.lower + grid.spacing * near)


def _check_edges(tally: Tally, case: SolidCase, rng: Rng) -> None:
    """All points of edges that are called free, between random configurations and along the lattice."""
    space, grid = case.space, case.space.grid
    starts = space.sample_free(CANDIDATES, rng)
    snapped = rng.random(CANDIDATES) < 0.3
    starts[snapped] = _nearly_snapped(case, starts[snapped], rng, away=0.0)
    steps = grid.spacing * rng.choice([2.0, 8.0, 25.0], (CANDIDATES, 1)) * rng.normal(size=(CANDIDATES, 3))
    lattice = rng.integers(-8, 9, (CANDIDATES, 1)) * rng.integers(-1, 2, (CANDIDATES, 3))
    ends = starts + np.where(snapped[:, None], grid.spacing * lattice, steps)
    free = np.flatnonzero(space.motion_is_free(starts, ends))
    t = np.linspace(0.0, 1.0, ALONG)[None, :, None]
    # The map tells where to look: half of the edges are those that come closest.
    few = starts[free, None] + t[:, :: ALONG // 50] * (ends - starts)[free, None]
    order = free[np.argsort(np.asarray(space.clearance(few)).min(axis=1))]
    picked = np.concatenate([order[: TAKEN // 2], rng.permutation(order[TAKEN // 2 :])[: TAKEN - TAKEN // 2]])
    if not len(picked):
        return
    first, last = starts[picked, None], ends[picked, None]
    # Rounding must not carry a point off the edge's own box, and with it out of the grid.
    q = np.clip(first + t * (last - first), np.minimum(first, last), np.maximum(first, last))
    wrong = ~leaves_free(case.gaps, q, max(0.0, space.margin - ROUNDING)) | ~np.asarray(space.is_free(q))
    tally.add(EDGE, case, q.reshape(-1, 3), wrong.ravel(), np.zeros(wrong.size, dtype=np.bool_))


def _check_boxes(tally: Tally, case: SolidCase, rng: Rng) -> None:
    """Configurations in cubes that are called free all around: in their corners and inside."""
    space, grid = case.space, case.space.grid
    distance = grid.spacing * float(rng.choice([0.0, 0.5, 1.0, 3.0])) * float(rng.uniform(0.5, 1.5))
    centers = space.sample_free(200, rng)
    centers[::4] = _nearly_snapped(case, centers[::4], rng, away=0.0)
    centers = centers[np.asarray(space.is_free_around(centers, distance))][:20]
    away = np.where(rng.random((len(centers), 10, 3)) < 0.5, 1.0, rng.random((len(centers), 10, 3)))
    q = (centers[:, None] + distance * away * rng.choice([-1.0, 1.0], away.shape)).reshape(-1, 3)
    wrong, undecided = not_free(case, q)
    tally.add("cube", case, q, wrong | ~np.asarray(space.is_free(q)), undecided)


def _check_clearance(tally: Tally, case: SolidCase, rng: Rng) -> None:
    """Points as far off as a clearance tells: each must be FREE, and free."""
    space, grid = case.space, case.space.grid
    centers = space.sample_free(150, rng)
    far = np.minimum(space.clearance(centers), 100.0 * grid.spacing * max(grid.shape))
    away = rng.normal(size=centers.shape)
    away *= (far * rng.choice([1.0, 0.999, 0.5], len(far)) / np.linalg.norm(away, axis=1))[:, None]
    q = centers + away
    wrong, undecided = not_free(case, q)
    tally.add("clearance", case, q, wrong | ~np.asarray(space.is_free(q)), undecided)


def _check_containment(tally: Tally, case: SolidCase, rng: Rng) -> None:
    """Points of the robot, grown by the margin, where it is called contained in the obstacles."""
    space, grid = case.space, case.space.grid
    q = rng.uniform(grid.lower, grid.upper, (2000, 3))
    q = q[np.asarray(space.contains_robot(q))][:20]
    if not len(q):
        return
    points = case.robot.most.samples(40, rng)
    away = rng.normal(size=points.shape)
    points += space.margin * away / np.linalg.norm(away, axis=1, keepdims=True)
    held = case.holds((q[:, None] + points).reshape(-1, 3)).reshape(len(q), -1)
    tally.add("contained", case, q, np.asarray(~held.all(axis=1)), np.zeros(len(q), dtype=np.bool_))
