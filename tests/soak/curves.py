"""Proofs of curved edges, against OMPL's points."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from benchmarks.report import Report
from cspace import FREE
from cspace.support.arrays import Floats
from planners.local_planner import CURVES, CarCurves, local_planner
from tests.helpers.planning import points_along, shortest_word
from tests.soak.maps import POINTS_PER_EDGE, find_collisions_along, snap_nearly
from tests.soak.plane import draw_case
from tests.soak.tally import Case, Rng, Tally, draw_until, pick_close

N_CURVES, N_FOLLOWED = 300, 40
"""Edges drawn, and free edges followed, per map and kind of curve."""

RADII = (2.0, 30.0)
"""Range of turning radii, in cells."""

SAME = 1e-9
"""Maximum difference in length, in turning radii, of equal curves."""

OFF = 1e-6
"""Maximum distance of points of equal curves, in turning radii or radians."""


def check(report: Report, seed: int, edges: int) -> None:
    """Check random maps until enough curves were followed."""
    others = Counter[str]()

    def check_case(tally: Tally, number: int) -> None:
        case, rng = draw_case(seed, number, turning=True), np.random.default_rng([seed, number, 5])
        if (case.space._seen == FREE).any():
            for name in CURVES:
                if tally.checks[name] < edges * POINTS_PER_EDGE:
                    _check_curves(tally, others, case, name, rng)

    def enough(tally: Tally) -> bool:
        return min(tally.checks[name] for name in CURVES) >= edges * POINTS_PER_EDGE

    tally = draw_until(report, f"curves at {POINTS_PER_EDGE} points each", seed, enough, check_case)
    for name in CURVES:
        followed = tally.checks[name] // POINTS_PER_EDGE
        report.note(
            f"{others[name]} of {followed} {name} edges differ from OMPL's; their pieces were driven instead"
        )


def _check_curves(tally: Tally, others: Counter[str], case: Case, name: str, rng: Rng) -> None:
    """Check all points of free curves."""
    space = case.space
    radius = space.grid.spacing * float(np.exp(rng.uniform(*np.log(RADII))))
    if rng.random() < 0.3:
        radius = space.grid.spacing * float(rng.integers(2, 31))
    planner = local_planner(space, drive=name, turning_radius=radius)
    if not isinstance(planner, CarCurves):
        raise TypeError(f"local_planner made {planner!r} for drive={name!r}; it must make curves")
    starts, goals = _draw_ends(case, name, radius, rng)
    is_free = planner.edge_checker()
    rows = np.concatenate([starts, goals], axis=1)
    pairs = rows[[is_free(*row) for row in rows.tolist()]].reshape(-1, 2, 3)
    if not len(pairs):
        return
    lengths = planner.edge_lengths(pairs[:, 0], pairs[:, 1])
    few = np.stack(
        [
            points_along(planner, a, b, np.linspace(0.0, c, 30))
            for (a, b), c in zip(pairs, lengths, strict=True)
        ]
    )
    picked = pick_close(np.asarray(space.clearance(few)).min(axis=1), N_FOLLOWED, rng)
    oracle = _Oracle(planner)
    q, missed = (
        np.empty((len(picked), POINTS_PER_EDGE, 3)),
        np.zeros((len(picked), 1), dtype=np.bool_),
    )
    for k, edge in enumerate(picked):
        q[k], missed[k], other = oracle.follow(pairs[edge, 0], pairs[edge, 1], float(lengths[edge]))
        others[name] += other
    wrong, undecided = find_collisions_along(case, q)
    tally.add(name, case, q, wrong | missed | ~np.asarray(space.is_free(q)), undecided)


def _draw_ends(case: Case, name: str, radius: float, rng: Rng) -> tuple[Floats, Floats]:
    """Draw ends of curves, mostly short."""
    space, spacing = case.space, case.space.grid.spacing
    starts = space.sample_free(N_CURVES, rng)
    snapped = rng.random(N_CURVES) < 0.3
    starts[snapped] = snap_nearly(case.space, starts[snapped], rng, away=0.0)
    turns = rng.integers(-1, 2, (N_CURVES, 3))
    lengths = (
        spacing * rng.choice([1.0, 4.0, 15.0], (N_CURVES, 1)) * rng.exponential(size=(N_CURVES, 3))
    )
    if name != "dubins":
        lengths *= rng.choice([-1.0, 1.0], lengths.shape)
    goals = drive(starts, turns, lengths, radius)
    near = rng.random(N_CURVES) < 0.2
    goals[near, :2] = starts[near, :2] + spacing * rng.choice([1.0, 10.0]) * rng.normal(
        size=(int(near.sum()), 2)
    )
    goals[near, 2] = rng.uniform(-np.pi, np.pi, int(near.sum()))
    snapped = rng.random(N_CURVES) < 0.1
    goals[snapped] = snap_nearly(case.space, goals[snapped], rng, away=0.0)
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


class _Oracle:
    """Points of curves, by OMPL or by driving."""

    def __init__(self, way: CarCurves) -> None:
        self._way, self._states = way, way.make_states()
        self._first, self._last, self._at = (self._states.allocState() for _ in range(3))

    def follow(self, first: Floats, last: Floats, length: float) -> tuple[Floats, bool, bool]:
        """Return points (n, 3), if ours deviate, and if OMPL's curve differs."""
        ours = points_along(self._way, first, last, np.linspace(0.0, length, POINTS_PER_EDGE))
        for state, q in ((self._first, first), (self._last, last)):
            state.setXY(float(q[0]), float(q[1]))
            state.setYaw(float(q[2]))
        radius = self._way.radius
        if abs(self._states.distance(self._first, self._last) - length) <= SAME * radius:
            theirs = self._theirs(ours)
            if _largest_distance(theirs, ours, radius) <= OFF:
                return theirs, False, False
        driven = self._driven(first, last, length)
        missed = (
            max(
                _largest_distance(driven, ours, radius),
                _largest_distance(driven[-1:], last[None], radius),
            )
            > OFF
        )
        return driven, missed, True

    def _theirs(self, ours: Floats) -> Floats:
        interpolate, first, last, at = self._states.interpolate, self._first, self._last, self._at
        q = []
        for t in np.linspace(0.0, 1.0, POINTS_PER_EDGE).tolist():
            interpolate(first, last, t, at)
            q.append((at.getX(), at.getY(), at.getYaw()))
        theirs = np.array(q)
        theirs[:, 2] = np.unwrap(theirs[:, 2])
        return theirs

    def _driven(self, first: Floats, last: Floats, length: float) -> Floats:
        radius = self._way.radius
        turns, lengths, _ = shortest_word(self._way, first, last)
        whole = radius * lengths
        begin = np.cumsum(np.abs(whole)) - np.abs(whole)
        parts = np.clip(
            np.linspace(0.0, length, POINTS_PER_EDGE)[:, None] - begin, 0.0, np.abs(whole)
        ) * np.sign(whole)
        return drive(
            np.repeat(first[None], POINTS_PER_EDGE, axis=0),
            np.broadcast_to(turns, parts.shape),
            parts,
            radius,
        )


def _largest_distance(a: Floats, b: Floats, radius: float) -> float:
    """Return the largest distance of paired points."""
    turn = (a[:, 2] - b[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return float(max(np.hypot(*(a - b)[:, :2].T).max() / radius, np.abs(turn).max()))
