"""Proofs of curved edges, against curves driven by circles and lines."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.report import Report
from cspace import FREE
from cspace._support.arrays import Floats
from planners._edges.drives import local_planner
from planners._ompl.states import make_states
from tests.fuzz.maps import POINTS_PER_EDGE
from tests.fuzz.scenes import Case, Rng, draw_case
from tests.fuzz.tally import Tally, draw_until, pick_close
from tests.helpers.drives import CURVES, make_drive
from tests.helpers.placements import draw_near_mixed, turn_between
from tests.helpers.planning import make_poses, points_along, shortest_word

N_CURVES, N_FOLLOWED = 300, 40
"""Edges drawn, and free edges followed, per map and kind of curve."""

RADII = (2.0, 30.0)
"""Range of turning radii, in cells."""

OFF = 1e-6
"""Maximum distance of points of equal curves, in turning radii or radians."""


def check(report: Report, seed: int, edges: int) -> None:
    """Check random maps until enough curves were followed."""

    def check_case(tally: Tally, number: int) -> None:
        case, rng = draw_case("yaw", seed, number), np.random.default_rng([seed, number, 5])
        if (case.space.cell_states == FREE).any():
            for name in CURVES:
                _check_curves(tally, case, name, rng)

    def enough(tally: Tally) -> bool:
        return min(tally.checks[name] for name in CURVES) >= edges * POINTS_PER_EDGE

    draw_until(report, f"curves at {POINTS_PER_EDGE} points each", seed, enough, check_case)


def _check_curves(tally: Tally, case: Case, name: str, rng: Rng) -> None:
    """Check all points of free curves."""
    space = case.space
    radius = space.grid.spacing * float(np.exp(rng.uniform(*np.log(RADII))))
    exact = bool(rng.integers(2))
    planner: Any = local_planner(space.exact if exact else space, make_drive(name, radius))
    starts, goals = _draw_ends(case, name, radius, rng)
    is_free, rows = planner.edge_checker(), np.concatenate([starts, goals], axis=1)
    pairs = rows[[is_free(*row) for row in rows.tolist()]].reshape(-1, 2, 3)
    if not len(pairs):
        return
    lengths = planner.edge_lengths(pairs[:, 0], pairs[:, 1])
    few = [
        points_along(planner, pair[0], pair[1], np.linspace(0.0, length, 30))
        for pair, length in zip(pairs, lengths, strict=True)
    ]
    picked = pick_close(np.asarray(space.clearance(few)).min(axis=1), N_FOLLOWED, rng)
    states = make_states(planner)
    for edge in picked:
        first, last = pairs[edge]
        along = np.linspace(0.0, lengths[edge], POINTS_PER_EDGE)
        q = _follow(planner, first, last, along)
        missed = _largest_distance(q, points_along(planner, first, last, along), radius) > OFF
        missed |= _largest_distance(q[-1:], last[None], radius) > OFF
        # OMPL's curve is sometimes longer than a shortest one, where rounding hides a straight line.
        longest = states.distance(*make_poses(states, first, last))
        missed |= lengths[edge] - longest > OFF * radius
        tally.add_free(
            name, case, q, missed | ~np.asarray((space.exact if exact else space).is_free(q))
        )


def _draw_ends(case: Case, name: str, radius: float, rng: Rng) -> tuple[Floats, Floats]:
    """Draw ends of curves, mostly short."""
    space, spacing = case.space, case.space.grid.spacing
    starts = space.sample_free(N_CURVES, rng)
    turns, shape = rng.integers(-1, 2, (N_CURVES, 3)), (N_CURVES, 3)
    lengths = spacing * rng.choice([1.0, 4.0, 15.0], (N_CURVES, 1)) * rng.exponential(size=shape)
    if name != "dubins":
        lengths *= rng.choice([-1.0, 1.0], shape)
    goals = drive(starts, turns, lengths, radius)
    goals[::5] = draw_near_mixed(space, rng, len(goals[::5]))
    return starts, goals


def drive(q: Floats, turns: Any, lengths: Floats, radius: float) -> Floats:
    """Drive cars from configurations (n, 3) along circles and lines.

    ``turns`` and ``lengths`` have shape (n, pieces): 1 (left), -1 (right) or 0 (straight), and
    metres, negative in reverse.
    """
    x, y, yaw = q.T.copy()
    for turn, length in zip(np.transpose(turns), lengths.T, strict=True):
        half = 0.5 * turn * length / radius
        chord = length * np.sinc(half / np.pi)
        x, y, yaw = x + chord * np.cos(yaw + half), y + chord * np.sin(yaw + half), yaw + 2.0 * half
    return np.column_stack([x, y, yaw])


def _follow(planner: Any, first: Floats, last: Floats, along: Floats) -> Floats:
    """Drive the pieces of a curve to distances from its start."""
    turns, lengths, _ = shortest_word(planner, first, last)
    whole = planner.radius * lengths
    begin = np.cumsum(np.abs(whole)) - np.abs(whole)
    parts = np.clip(along[:, None] - begin, 0.0, np.abs(whole)) * np.sign(whole)
    starts = np.repeat(first[None], len(along), axis=0)
    return drive(starts, np.broadcast_to(turns, parts.shape), parts, planner.radius)


def _largest_distance(a: Floats, b: Floats, radius: float) -> float:
    """Return the largest distance of paired points, in radii or radians."""
    metres = np.hypot(*(a - b)[:, :2].T).max()
    return float(max(metres / radius, np.abs(turn_between(a[:, 2], b[:, 2])).max()))
