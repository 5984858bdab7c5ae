"""Edges that only the geometry itself proves, against exact geometry; part of the soak."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.soak.maps import ALONG, Rng, along, not_free_along
from benchmarks.soak.plane_cases import Case, draw_case
from benchmarks.soak.tally import Tally

Floats = NDArray[np.float64]

CANDIDATES = 400
TAKEN = 40
"""Edges drawn, and edges that only the geometry proves that are followed, for each map."""

CLOSE = 0.05
"""Cells off the obstacles that are close."""

ASKED = 20
"""Every so many points of an edge, the map is asked for the exact answer there too."""

EDGE = "exact edge"


def check(report: Report, seed: int, edges: int) -> None:
    """Random maps, of robots that turn and some that do not, until enough edges were proven and followed."""
    tally = Tally()
    began, number = time.perf_counter(), 0
    while tally.checks[EDGE] < edges * ALONG:
        case = draw_case(seed, number, turning=number % 4 != 3)
        _check_edges(tally, case, np.random.default_rng([seed, number, 6]))
        number += 1
    report.section(
        f"exact=True: {number} random maps, {tally.checks[EDGE] // ALONG} edges that only the geometry proves, at "
        f"{ALONG} points each, seed {seed}, {time.perf_counter() - began:.0f} s"
    )
    tally.tell(report)


def _check_edges(tally: Tally, case: Case, rng: Rng) -> None:
    """All points of edges that are called free with ``exact``, and are not without."""
    space, grid = case.space, case.space.grid
    starts = _free(case, rng)
    if not len(starts):
        return
    steps = grid.spacing * rng.choice([0.0, 0.5, 2.0, 10.0], (len(starts), 1)) * rng.normal(size=(len(starts), 2))
    turns = rng.choice([0.0, 0.05, 0.5, 2.0], len(starts)) * rng.normal(size=len(starts)) * (space.dof == 3)
    ends = starts + np.column_stack([steps, turns])
    pair = starts[:, : space.dof], ends[:, : space.dof]
    only = np.asarray(space.motion_is_free(*pair, exact=True)) & ~np.asarray(space.motion_is_free(*pair))
    found = rng.permutation(np.flatnonzero(only))
    if not len(found):
        return
    # Half of the edges are those that come close to the obstacles, as far as there are.
    few = along(case.space, starts[found], ends[found], np.linspace(0.0, 1.0, 11), rng)
    close = case.shape.meets(case.obstacles, few.reshape(-1, 3), space.margin + CLOSE * grid.spacing)
    order = found[np.argsort(~close.reshape(-1, 11).any(axis=1), kind="stable")]
    picked = np.concatenate([order[: TAKEN // 2], rng.permutation(order[TAKEN // 2 :])[: TAKEN - TAKEN // 2]])
    q = along(case.space, starts[picked], ends[picked], np.linspace(0.0, 1.0, ALONG), rng)
    wrong, undecided = not_free_along(case, q)
    wrong[:, ::ASKED] |= ~np.asarray(space.is_free(q[:, ::ASKED, : space.dof], exact=True))
    tally.add(EDGE, case, q.reshape(-1, 3), wrong.ravel(), undecided.ravel())


def _free(case: Case, rng: Rng) -> Floats:
    """Free configurations, shape (n, 3), for the most part in MIXED cells; yaw is 0 where the robot does not turn."""
    space, grid = case.space, case.space.grid
    reach = case.shape.reach() + space.margin + grid.spacing
    low, high = np.asarray(grid.lower) - 0.5 * reach, np.asarray(grid.upper) + 0.5 * reach
    q = np.column_stack([rng.uniform(low, high, (20 * CANDIDATES, 2)), rng.uniform(-9.0, 9.0, 20 * CANDIDATES)])
    q[:, 2] *= space.dof == 3
    known = np.asarray(space.is_free(q[:, : space.dof]))
    mixed = q[~known][: 4 * CANDIDATES]
    mixed = mixed[np.asarray(space.is_free(mixed[:, : space.dof], exact=True))]
    return np.concatenate([mixed[:CANDIDATES], q[known][: CANDIDATES // 4]])
