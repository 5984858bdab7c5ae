"""Points and edges that only the geometry itself proves, in every space, against exact geometry; part of the soak."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak.maps import ALONG, Rng, along, not_free_along
from benchmarks.soak.plane_cases import draw_case
from benchmarks.soak.space_cases import draw_solid_case
from benchmarks.soak.tally import Case, Tally, not_free

Floats = NDArray[np.float64]

CANDIDATES = 400
TAKEN = 40
"""Edges drawn, and edges that only the geometry proves that are followed, for each map."""

CLOSE = 0.05
"""Cells off the obstacles that are close."""

CLEAR = 1e-3
"""Cells off the obstacles from which a point is to be proven."""

ASKED = 20
"""Every so many points of an edge, the map is asked for the exact answer there too."""

POINT, EDGE, LOST = "exact point", "exact edge", "exact point that is not proven"

SPACES: dict[str, Callable[[int, int], Case]] = {
    "in the plane": draw_case,
    "that turn": partial(draw_case, turning=True),
    "in space": draw_solid_case,
}


def check(report: Report, seed: int, edges: int, points: int = 0) -> None:
    """Random maps of each space until enough points and edges were proven, and the edges followed."""
    for name, draw in SPACES.items():
        tally = Tally()
        began, number = time.perf_counter(), 0
        while tally.checks[EDGE] < edges * ALONG or tally.checks[POINT] < points:
            case = draw(seed, number)
            _check(tally, case, np.random.default_rng([seed, number, 6]))
            number += 1
        report.section(
            f"exact=True, robots {name}: {number} random maps, {tally.checks[EDGE] // ALONG} edges that only the "
            f"geometry proves, at {ALONG} points each, seed {seed}, {time.perf_counter() - began:.0f} s"
        )
        tally.tell(report)


def _check(tally: Tally, case: Case, rng: Rng) -> None:
    """Points in MIXED cells, and all points of edges, that are called free with ``exact`` and are not without."""
    space, dim = case.space, case.space.grid.dim
    if getattr(space.robot.shape, "solid", "") == "fill":  # which has no shape of its own
        return
    q = _drawn(case, rng)
    known, free = np.asarray(space.is_free(q)), np.asarray(space.is_free(q, exact=True))
    proven, refused = q[free & ~known], q[~free][:CANDIDATES]
    tally.add(POINT, case, proven, *not_free(case, proven))
    clear = ~case.meets(refused, space.margin + CLEAR * space.grid.spacing)
    tally.add(LOST, case, refused, clear, np.zeros(len(refused), dtype=np.bool_))
    starts = np.concatenate([proven[:CANDIDATES], q[known][: CANDIDATES // 4]])
    steps = rng.choice([0.0, 0.5, 2.0, 10.0], (len(starts), 1)) * rng.normal(size=(len(starts), dim))
    turns = rng.choice([0.0, 0.05, 0.5, 2.0], (len(starts), 1)) * rng.normal(size=(len(starts), space.dof - dim))
    ends = starts + np.concatenate([space.grid.spacing * steps, turns], axis=1)
    only = np.asarray(space.motion_is_free(starts, ends, exact=True)) & ~np.asarray(space.motion_is_free(starts, ends))
    found = rng.permutation(np.flatnonzero(only))
    if not len(found):
        return
    # Half of the edges are those that come close to the obstacles, as far as there are.
    few = along(space, starts[found], ends[found], np.linspace(0.0, 1.0, 11), rng).reshape(-1, space.dof)
    close = case.meets(few, space.margin + CLOSE * space.grid.spacing)
    order = found[np.argsort(~close.reshape(-1, 11).any(axis=1), kind="stable")]
    picked = np.concatenate([order[: TAKEN // 2], rng.permutation(order[TAKEN // 2 :])[: TAKEN - TAKEN // 2]])
    q = along(space, starts[picked], ends[picked], np.linspace(0.0, 1.0, ALONG), rng)
    wrong, undecided = not_free_along(case, q)
    wrong[:, ::ASKED] |= ~np.asarray(space.is_free(q[:, ::ASKED], exact=True))
    tally.add(EDGE, case, q.reshape(-1, space.dof), wrong.ravel(), undecided.ravel())


def _drawn(case: Case, rng: Rng) -> Floats:
    """Configurations in and around the grid, for the most part in MIXED cells."""
    space, grid = case.space, case.space.grid
    reach = case.reach + space.margin + grid.spacing
    low, high = np.asarray(grid.lower) - 0.5 * reach, np.asarray(grid.upper) + 0.5 * reach
    places, turns = rng.uniform(low, high, (20 * CANDIDATES, grid.dim)), space.dof - grid.dim
    q = np.concatenate([places, rng.uniform(-9.0, 9.0, (20 * CANDIDATES, turns))], axis=1)
    known = np.asarray(space.is_free(q))
    return np.concatenate([q[~known][: 4 * CANDIDATES], q[known][:CANDIDATES]])
