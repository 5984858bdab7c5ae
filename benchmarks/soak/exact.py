"""Points and edges that only the geometry itself proves, in every space, against exact geometry; part of the soak."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from benchmarks.report import Report
from benchmarks.soak.maps import ALONG, Rng, along, has_geometry, not_free_along, rotations_of, turned
from benchmarks.soak.plane_cases import draw_case
from benchmarks.soak.space_cases import draw_solid_case
from benchmarks.soak.tally import Case, Tally, not_free
from cspace.arrays import Floats

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
    "that turn freely in space": partial(draw_solid_case, freely=True),
}

SLOW: Final = 10
"""How many times fewer edges are followed of robots that turn freely: each turned robot is a shape of its own."""


def check(report: Report, seed: int, edges: int, points: int = 0) -> None:
    """Random maps of each space until enough points and edges were proven, and the edges followed."""
    for name, draw in SPACES.items():
        tally = Tally()
        began, number = time.perf_counter(), 0
        share = SLOW if "freely" in name else 1
        while tally.checks[EDGE] < edges * ALONG // share or tally.checks[POINT] < points // share:
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
    if not has_geometry(case):
        return
    q = _drawn(case, rng)
    known, free = np.asarray(space.is_free(q)), np.asarray(space.is_free(q, exact=True))
    proven, refused = q[free & ~known], q[~free][:CANDIDATES]
    tally.add(POINT, case, proven, *not_free(case, proven))
    if space.workspace.source != "mesh" or space.workspace.shapes:  # of what was filled, there are only cells
        clear = ~case.meets(refused, space.margin + CLEAR * space.grid.spacing)
        tally.add(LOST, case, refused, clear, np.zeros(len(refused), dtype=np.bool_))
    starts = np.concatenate([proven[:CANDIDATES], q[known][: CANDIDATES // 4]])
    goals, number = starts.copy(), len(starts)
    goals[:, :dim] += (
        space.grid.spacing * rng.choice([0.0, 0.5, 2.0, 10.0], (number, 1)) * rng.normal(size=(number, dim))
    )
    turns = rng.choice([0.0, 1e-5, 0.05, 0.5, 2.0], number) * np.abs(rng.normal(size=number))
    goals[:, dim:] = turned(starts[:, dim:], np.where(rng.random(number) < 0.05, np.pi, turns), rng)
    only = np.asarray(space.motion_is_free(starts, goals, exact=True)) & ~np.asarray(
        space.motion_is_free(starts, goals)
    )
    edges = rng.permutation(np.flatnonzero(only))
    if not len(edges):
        return
    # Half of the edges are those that come close to the obstacles, as far as there are.
    few = along(space, starts[edges], goals[edges], np.linspace(0.0, 1.0, 11), rng).reshape(-1, space.dof)
    close = case.meets(few, space.margin + CLOSE * space.grid.spacing)
    order = edges[np.argsort(~close.reshape(-1, 11).any(axis=1), kind="stable")]
    picked = np.concatenate([order[: TAKEN // 2], rng.permutation(order[TAKEN // 2 :])[: TAKEN - TAKEN // 2]])
    q = along(space, starts[picked], goals[picked], np.linspace(0.0, 1.0, ALONG), rng)
    wrong, undecided = not_free_along(case, q)
    wrong[:, ::ASKED] |= ~np.asarray(space.is_free(q[:, ::ASKED], exact=True))
    tally.add(EDGE, case, q.reshape(-1, space.dof), wrong.ravel(), undecided.ravel())


def _drawn(case: Case, rng: Rng) -> Floats:
    """Configurations in and around the grid, for the most part in MIXED cells."""
    space, grid = case.space, case.space.grid
    reach = case.reach + space.margin + grid.spacing
    low, high = np.asarray(grid.lower) - 0.5 * reach, np.asarray(grid.upper) + 0.5 * reach
    places = rng.uniform(low, high, (20 * CANDIDATES, grid.dim))
    q = np.concatenate([places, rotations_of(space, len(places), rng)], axis=1)
    known = np.asarray(space.is_free(q))
    return np.concatenate([q[~known][: 4 * CANDIDATES], q[known][:CANDIDATES]])
