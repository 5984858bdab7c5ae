"""Every answer that is called a proof, against exact geometry, a million times."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak import band
from benchmarks.soak import curves as curved_soak
from benchmarks.soak import exact as exact_soak
from benchmarks.soak import frequency as frequency_soak
from benchmarks.soak import space as solid_soak
from benchmarks.soak import turning as turning_soak
from benchmarks.soak.plane_cases import Case, draw_case
from benchmarks.soak.tally import Tally, not_free
from cspace import BLOCKED, FREE, MIXED

Floats = NDArray[np.float64]

PER_STATE = 450
"""Configurations drawn in cells of one state, for each map."""

EDGES = 10_000
ALONG = 40
"""Points checked along each edge."""

PLACEMENTS = 100_000
"""Placements of pairs for which frequencies tell whether they collide, in the plane and in space each."""


def run(report: Report, seed: int, checks: int | None = None) -> None:
    """Random maps until enough FREE and BLOCKED answers and free edges were checked; then the MIXED band."""
    wanted = checks if checks is not None else 50_000 if report.quick else 1_000_000
    edges = min(EDGES, max(100, wanted // 100))
    tally = Tally()
    began, number = time.perf_counter(), 0
    while tally.checks["FREE"] + tally.checks["BLOCKED"] < wanted or tally.checks["edge"] < edges * ALONG:
        case = draw_case(seed, number)
        rng = np.random.default_rng([seed, number, 1])
        _check_states(tally, case, rng)
        _check_edges(tally, case, rng)
        _check_clearance(tally, case, rng)
        _check_containment(tally, case, rng)
        number += 1
    report.section(f"{number} random maps and robots, seed {seed}, {time.perf_counter() - began:.0f} s")
    tally.tell(report)
    turning_soak.check(report, seed, wanted, edges)
    curves = edges // 5 if report.quick else edges
    curved_soak.check(report, seed, curves)
    exact_soak.check(report, seed, curves)
    solid_soak.check(report, seed, wanted, edges)
    frequency_soak.check(report, seed, PLACEMENTS // 50 if report.quick else PLACEMENTS)
    band.measure(report, seed, 20 if report.quick else 200)


def _check_states(tally: Tally, case: Case, rng: np.random.Generator) -> None:
    """Configurations in cells of each state, on borders and corners and next to them, and anywhere, also outside."""
    space, grid = case.space, case.space.grid
    drawn, claimed = [], []
    for state in (FREE, MIXED, BLOCKED):
        cells = np.argwhere(space.state == state)
        if not len(cells):
            continue
        cells = cells[rng.integers(0, len(cells), PER_STATE)]
        within = rng.choice([0.0, 1.0, np.nan], p=[0.25, 0.25, 0.5], size=cells.shape)
        within = np.where(np.isnan(within), rng.random(cells.shape), within)
        drawn.append(grid.lower + grid.spacing * (cells + within))
        claimed.append(np.full(len(cells), state))
    q, claims = np.concatenate(drawn), np.concatenate(claimed)
    answers = np.asarray(space.classify(q))
    # A border belongs to both cells: the cell that was drawn and the one that the look-up tells must both be right.
    tally.judge(case, q, claims)
    other = answers != claims
    tally.judge(case, q[other], answers[other])
    near = np.round((q - grid.lower) / grid.spacing)
    near += rng.choice([-1.0, 0.0, 1.0], near.shape) * 10.0 ** rng.uniform(-9.0, -3.0, near.shape)
    q = rng.permutation(grid.lower + grid.spacing * near)[: PER_STATE // 3]
    tally.judge(case, q, np.asarray(space.classify(q)))
    reach = case.shape.reach() + space.margin + grid.spacing
    low, high = np.asarray(grid.lower) - 1.5 * reach, np.asarray(grid.upper) + 1.5 * reach
    q = rng.uniform(low, high, (PER_STATE // 3, 2))
    tally.judge(case, q, np.asarray(space.classify(q)))


def _check_edges(tally: Tally, case: Case, rng: np.random.Generator) -> None:
    """Points on edges that are called free, between random configurations and along the lattice: FREE, and free."""
    space, grid = case.space, case.space.grid
    if not (space.state == FREE).any():
        return
    starts = space.sample_free(80, rng)
    ends = starts + grid.spacing * rng.choice([2.0, 10.0, 40.0], (80, 1)) * rng.normal(size=(80, 2))
    corners = np.round((starts - grid.lower) / grid.spacing)
    steps = rng.integers(-12, 13, (80, 1)) * np.array([(1, 0), (0, 1), (1, 1), (1, -1)])[rng.integers(0, 4, 80)]
    starts = np.concatenate([starts, grid.lower + grid.spacing * corners])
    ends = np.concatenate([ends, grid.lower + grid.spacing * (corners + steps)])
    free = np.flatnonzero(space.motion_is_free(starts, ends))
    along = np.linspace(0.0, 1.0, 10 * ALONG)[None, :, None]
    starts, ends = starts[free, None], ends[free, None]
    # Rounding must not carry a point off the edge's own box, and with it out of the grid.
    q = np.clip(starts + along * (ends - starts), np.minimum(starts, ends), np.maximum(starts, ends))
    # The map tells where to look: the edges that come closest, and some others; on each the points that are closest.
    clearance = space.clearance(q)
    order = np.argsort(clearance.min(axis=1))
    picked = np.concatenate([order[:10], rng.permutation(order[10:])[:10]])
    points = np.argsort(clearance[picked], axis=1)[:, :ALONG]
    q = q[picked[:, None], points].reshape(-1, 2)
    wrong, undecided = not_free(case, q)
    tally.add("edge", case, q, wrong | ~space.is_free(q), undecided)


def _check_clearance(tally: Tally, case: Case, rng: np.random.Generator) -> None:
    """Points as far from a configuration as its clearance tells: each must be FREE, and free."""
    space, grid = case.space, case.space.grid
    if not (space.state == FREE).any():
        return
    centers = space.sample_free(60, rng)
    far = np.minimum(space.clearance(centers), 100.0 * grid.spacing * max(grid.shape))
    turns = rng.uniform(0, 2 * np.pi, len(centers))
    q = centers + (far * rng.choice([1.0, 0.999, 0.5], len(centers)))[:, None] * np.column_stack(
        [np.cos(turns), np.sin(turns)]
    )
    wrong, undecided = not_free(case, q)
    tally.add("clearance", case, q, wrong | ~space.is_free(q), undecided)


def _check_containment(tally: Tally, case: Case, rng: np.random.Generator) -> None:
    """Configurations at which the robot is called contained in the obstacles."""
    import shapely

    space, grid = case.space, case.space.grid
    q = rng.uniform(grid.lower, grid.upper, (2000, 2))
    q = q[np.asarray(space.contains_robot(q))][:60]
    if not len(q):
        return
    whole = shapely.union_all([part for part in case.obstacles if part.area])
    shapely.prepare(whole)
    inside = case.shape.lies_in(whole, q, space.margin)
    tally.add("contained", case, q, ~inside, np.zeros(len(q), dtype=np.bool_))
