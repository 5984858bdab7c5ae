"""The proofs of a map against exact geometry, in every space alike.

States, edges, boxes, clearance, containment; and the proof that there is no path, against walks.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.report import Report
from benchmarks.soak.tally import Case, Tally, not_free
from cspace import BLOCKED, FREE, MIXED, CSpace
from cspace.arrays import Bools, Floats

Rng = np.random.Generator

TURN = 2.0 * np.pi

PER_STATE = 900
"""Configurations drawn in cells of FREE and of BLOCKED, for each map; half of them where the state changes."""

CANDIDATES, TAKEN = 200, 30
"""Edges drawn, and edges of those called free that are followed, for each map."""

ALONG = 1000
"""Points checked along each edge."""

GROUPS = (200, 20)
"""Points of an edge that are settled together where no obstacle is near enough for any of them, from coarse to fine."""

WALKS, STEPS = 30, 25
"""Walks from configurations anywhere, for each map, and motions of each that are tried."""

EDGE = "edge"


def check(report: Report, name: str, draw: Callable[[int, int], Case], seed: int, wanted: int, edges: int) -> None:
    """Random maps until enough FREE and BLOCKED answers and free edges were checked.

    Parameters
    ----------
    report : Report
    name : str
        What is drawn: ``"robots that turn"``.
    draw : callable
        From a seed and a number to a case, the same one each time.
    seed, wanted, edges : int
    """
    tally = Tally()
    began, number = time.perf_counter(), 0
    while tally.checks["FREE"] + tally.checks["BLOCKED"] < wanted or tally.checks[EDGE] < edges * ALONG:
        case = draw(seed, number)
        rng = np.random.default_rng([seed, number, 1])
        _check_states(tally, case, rng)
        if (case.space.state == FREE).any():
            _check_edges(tally, case, rng)
            _check_boxes(tally, case, rng)
            _check_clearance(tally, case, rng)
        _check_containment(tally, case, rng)
        _check_walks(tally, case, rng)
        number += 1
    report.section(
        f"{name}: {number} random maps, {tally.checks[EDGE] // ALONG} edges at {ALONG} points each, seed {seed}, "
        f"{time.perf_counter() - began:.0f} s"
    )
    tally.tell(report)


# ---- what is checked -------------------------------------------------------------------------------------------------


def _check_states(tally: Tally, case: Case, rng: Rng) -> None:
    """Configurations in cells of each state, on borders and corners and next to them, and anywhere, also outside."""
    space = case.space
    state, border = space.state, _changes(space.state, space.grid.dim)
    drawn, claimed = [], []
    for claim in (FREE, MIXED, BLOCKED):
        number = PER_STATE // 9 if claim == MIXED else PER_STATE // 2
        for chosen in (state == claim, (state == claim) & border):
            cells = np.flatnonzero(chosen)
            if len(cells):
                places = np.stack(np.unravel_index(cells[rng.integers(0, len(cells), number)], state.shape), axis=1)
                drawn.append(_in_cells(space, places, rng))
                claimed.append(np.full(number, claim))
    q, claims = np.concatenate(drawn), np.concatenate(claimed)
    answers = np.asarray(space.classify(q))
    # A border belongs to both cells: the cell that was drawn and the one that the look-up tells must both be right.
    tally.judge(case, q, claims)
    other = answers != claims
    tally.judge(case, q[other], answers[other])
    few = PER_STATE // 6
    reach = 1.5 * (case.reach + space.margin + space.grid.spacing)
    low, high = np.asarray(space.grid.lower) - reach, np.asarray(space.grid.upper) + reach
    turns = rotations_of(space, few, rng)
    anywhere = np.concatenate([rng.uniform(low, high, (few, space.grid.dim)), turns], axis=1)
    q = np.concatenate([nearly_snapped(space, rng.permutation(q)[:few], rng), anywhere])
    tally.judge(case, q, np.asarray(space.classify(q)))


def _check_edges(tally: Tally, case: Case, rng: Rng) -> None:
    """All points of edges that are called free, between random configurations and along the lattice."""
    space, dim = case.space, case.space.grid.dim
    starts = space.sample_free(CANDIDATES, rng)
    snapped = rng.random(CANDIDATES) < 0.3
    starts[snapped] = nearly_snapped(space, starts[snapped], rng, away=0.0)
    steps = rng.choice([0.0, 2.0, 10.0, 40.0], (CANDIDATES, 1)) * rng.normal(size=(CANDIDATES, dim))
    lattice = rng.integers(-9, 10, (CANDIDATES, 1)) * rng.integers(-1, 2, (CANDIDATES, dim))
    goals = starts.copy()
    goals[:, :dim] += space.grid.spacing * np.where(snapped[:, None], lattice, steps)
    turns = rng.choice([0.0, 0.05, 0.5, 2.0], CANDIDATES) * np.abs(rng.normal(size=CANDIDATES))
    goals[:, dim:] = turned(goals[:, dim:], np.where(rng.random(CANDIDATES) < 0.05, np.pi, turns), rng)
    free = np.flatnonzero(space.motion_is_free(starts, goals))
    # The map tells where to look: half of the edges are those that come closest.
    few = along(space, starts[free], goals[free], np.linspace(0.0, 1.0, 50), rng)
    order = free[np.argsort(np.asarray(space.clearance(few)).min(axis=1))]
    picked = np.concatenate([order[: TAKEN // 2], rng.permutation(order[TAKEN // 2 :])[: TAKEN - TAKEN // 2]])
    if not len(picked):
        return
    q = along(space, starts[picked], goals[picked], np.linspace(0.0, 1.0, ALONG), rng)
    wrong, undecided = not_free_along(case, q)
    if space.rotations.dof < 4:  # of an edge along the border of cells of quaternions, one side is enough
        wrong |= ~np.asarray(space.is_free(q))
    tally.add(EDGE, case, q.reshape(-1, space.dof), wrong.ravel(), undecided.ravel())


def _check_boxes(tally: Tally, case: Case, rng: Rng) -> None:
    """Configurations in boxes that are called free all around: in their corners and inside."""
    space, dim = case.space, case.space.grid.dim
    distance = space.grid.spacing * float(rng.choice([0.0, 0.5, 1.0, 3.0])) * float(rng.uniform(0.5, 1.5))
    angle = float(rng.choice([0.0, 0.01, 0.1, 1.0, 4.0]) * rng.uniform(0.5, 1.5))
    centers = space.sample_free(200, rng)
    centers[::4] = nearly_snapped(space, centers[::4], rng, away=0.0)
    centers = centers[np.asarray(space.is_free_around(centers, distance, angle))][:20]
    shape = (len(centers), 12, space.dof)
    away = np.where(rng.random(shape) < 0.4, 1.0, rng.random(shape)) * rng.choice([-1.0, 1.0], shape)
    q = np.repeat(centers[:, None], shape[1], axis=1)
    q[..., :dim] += distance * away[..., :dim]
    q = q.reshape(-1, space.dof)
    q[:, dim:] = turned(q[:, dim:], angle * np.abs(away[..., -1]).ravel(), rng)
    wrong, undecided = not_free(case, q)
    tally.add("box", case, q, wrong | ~np.asarray(space.is_free(q)), undecided)


def _check_clearance(tally: Tally, case: Case, rng: Rng) -> None:
    """Points as far off as a clearance tells, at any rotation of the rotation cell: each must be FREE, and free."""
    space, dim = case.space, case.space.grid.dim
    centers = space.sample_free(150, rng)
    far = np.minimum(space.clearance(centers), 100.0 * space.grid.spacing * max(space.grid.shape))
    way = rng.normal(size=(len(far), dim))
    way *= (far * rng.choice([1.0, 0.999, 0.5], len(far)) / np.linalg.norm(way, axis=1))[:, None]
    q = centers.copy()
    q[:, :dim] += way
    if space.rotations.dof:
        turn = space.rotations.cells_of(centers)
        q[:, dim:] = _in_rotation_cells(space, turn, np.clip(_within(rng, (len(turn), 3)), 1e-6, 1.0 - 1e-6))
    wrong, undecided = not_free(case, q)
    tally.add("clearance", case, q, wrong | ~np.asarray(space.is_free(q)), undecided)


def _check_containment(tally: Tally, case: Case, rng: Rng) -> None:
    """Configurations at which the robot is called contained in the obstacles."""
    space, grid = case.space, case.space.grid
    turns = rotations_of(space, 2000, rng)
    q = np.concatenate([rng.uniform(grid.lower, grid.upper, (2000, grid.dim)), turns], axis=1)
    q = q[np.asarray(space.contains_robot(q))][:40]
    if len(q):
        tally.add("contained", case, q, ~case.lies_in(q, rng), np.zeros(len(q), dtype=np.bool_))


def _check_walks(tally: Tally, case: Case, rng: Rng) -> None:
    """Where walks lead that the geometry itself proves: none of it is cut off from where they began."""
    space, dim = case.space, case.space.grid.dim
    if not has_geometry(case):
        return
    places = rng.uniform(space.grid.lower, space.grid.upper, (10 * WALKS, dim))
    first = np.concatenate([places, rotations_of(space, len(places), rng)], axis=1)
    first = first[np.asarray(space.is_free(first, exact=True))][:WALKS]
    last = first.copy()
    for _ in range(STEPS if len(first) else 0):
        size, goals = rng.choice([0.0, 0.3, 1.0, 3.0], (len(last), 2)), last.copy()
        goals[:, :dim] += space.grid.spacing * size[:, :1] * rng.normal(size=(len(last), dim))
        goals[:, dim:] = turned(last[:, dim:], size[:, 1] * np.abs(rng.normal(0.0, 0.5, len(last))), rng)
        free = np.asarray(space.motion_is_free(last, goals, exact=True))
        last[free] = goals[free]
    wrong = np.array([answer is False for answer in space.path_exists(first, last)], dtype=np.bool_)
    tally.add("path", case, last, wrong, np.zeros(len(last), dtype=np.bool_))


def has_geometry(case: Case) -> bool:
    """Whether the robot has a shape that exact answers can ask, and not only cells that fill it."""
    return getattr(case.space.robot.shape, "solid", "") != "fill"


def not_free_along(case: Case, q: Floats) -> tuple[Bools, Bools]:
    """:func:`benchmarks.soak.tally.not_free` of the points of edges, shape (edges, points, dof).

    Points are settled in groups: the robot is as far from the obstacles at the middle one as no point of it moves
    within the group. Where it is not, smaller groups are asked, and at last each point by itself.
    """
    wrong, undecided = np.zeros((2, *q.shape[:2]), dtype=np.bool_)
    open_ = np.ones(q.shape[:2], dtype=np.bool_)
    dim = case.space.grid.dim
    for size in GROUPS:
        groups = q.reshape(len(q), -1, size, q.shape[2])
        near = open_.reshape(groups.shape[:3]).any(axis=2)
        members, middles = groups[near], groups[near][:, size // 2]
        apart = members - middles[:, None]
        # A point moves by no more than twice its radius times the way of a quaternion.
        moved = np.linalg.norm(apart[..., :dim], axis=-1) + 2.0 * case.reach * np.abs(apart[..., dim:]).sum(axis=-1)
        near[near] = case.meets(middles, moved.max(axis=1) + case.space.margin + 1e-6)
        open_ = np.repeat(near, size, axis=1)
    wrong[open_], undecided[open_] = not_free(case, q[open_])
    return wrong, undecided


# ---- configurations --------------------------------------------------------------------------------------------------


def nearly_snapped(space: CSpace, q: Floats, rng: Rng, away: float = 1.0) -> Floats:
    """Configurations on the nearest corner of the lattice, or next to it; many on the border of a rotation cell too."""
    grid = space.grid
    near = np.round((q[:, : grid.dim] - grid.lower) / grid.spacing)
    near += away * rng.choice([-1.0, 0.0, 1.0], near.shape) * 10.0 ** rng.uniform(-9.0, -3.0, near.shape)
    snapped = np.concatenate([grid.lower + grid.spacing * near, q[:, grid.dim :]], axis=1)
    if space.rotations.dof:
        borders = np.asarray(space.rotations.borders)
        border = rng.choice(borders, (len(q), 3 if space.rotations.dof == 4 else 1))
        border += away * rng.choice([-1.0, 0.0, 1.0], border.shape) * 10.0 ** rng.uniform(-12.0, -3.0, border.shape)
        if space.rotations.dof == 4:  # some of the quotients are on a border
            quotients = np.where(rng.random(border.shape) < 0.5, rng.uniform(-1.0, 1.0, border.shape), border)
            border = _unit(rng.permuted(np.column_stack([quotients, np.ones(len(q))]), axis=1))
        snapped[:, grid.dim :] = np.where(rng.random((len(q), 1)) < 0.5, q[:, grid.dim :], border)
    return snapped


def along(space: CSpace, starts: Floats, goals: Floats, t: Floats, rng: Rng) -> Floats:
    """Points of edges, shape (edges, points, dof): linear, and turned the shorter way, either way at half a turn."""
    dim = space.grid.dim
    steps = goals - starts
    if space.rotations.dof == 4:
        q = starts[:, None] + t[:, None] * steps[:, None]
        q[..., dim:] = _slerp(starts[:, dim:], goals[:, dim:], t, rng)
        low, high = np.minimum(starts, goals)[:, None, :dim], np.maximum(starts, goals)[:, None, :dim]
        q[..., :dim] = np.clip(q[..., :dim], low, high)
        return q
    turns = (steps[:, dim:] + np.pi) % TURN - np.pi
    steps[:, dim:] = np.where(np.pi - np.abs(turns) < 1e-9, np.pi * rng.choice([-1.0, 1.0], turns.shape), turns)
    q = starts[:, None] + t[:, None] * steps[:, None]
    # Rounding must not carry a point off the edge's own box, and with it out of the grid.
    low, high = np.minimum(starts, goals)[:, None, :dim], np.maximum(starts, goals)[:, None, :dim]
    q[..., :dim] = np.clip(q[..., :dim], low, high)
    return q


def _in_cells(space: CSpace, cells: NDArray[np.integer], rng: Rng) -> Floats:
    """A configuration of each cell, ``(rotation, x, y)``, ``(x, y)`` or ``(x, y, z)``, many on its border."""
    grid, dim = space.grid, space.grid.dim
    points = grid.lower + grid.spacing * (cells[:, -dim:] + _within(rng, (len(cells), dim)))
    if not space.rotations.dof:
        return np.asarray(points)
    turns = _in_rotation_cells(space, cells[:, 0], _within(rng, (len(cells), 3)))
    if space.rotations.dof == 4:
        return np.column_stack([points, turns * rng.choice([-1.0, 1.0], (len(turns), 1))])
    return np.column_stack([points, turns + TURN * rng.integers(-2, 3, turns.shape)])


def _in_rotation_cells(space: CSpace, cells: NDArray[np.integer], part: Floats) -> Floats:
    """A rotation of each of some cells, at parts, shape (n, 3), of the way from border to border."""
    borders = np.asarray(space.rotations.borders)
    if space.rotations.dof == 1:
        return np.asarray(borders[cells] + part[:, 0] * (borders[cells + 1] - borders[cells]))[:, None]
    n = len(borders) - 1
    chart, *parts = np.unravel_index(cells, (4, n, n, n))
    first = np.stack(parts, axis=1)
    quotients = borders[first] + part * (borders[first + 1] - borders[first])
    made = np.ones((len(cells), 4))
    made[np.arange(4) != chart[:, None]] = quotients.ravel()
    return _unit(made)


def rotations_of(space: CSpace, number: int, rng: Rng) -> Floats:
    """Rotations as configurations of a map tell them."""
    if space.rotations.dof == 4:
        return _unit(rng.normal(size=(number, 4)))
    return rng.uniform(-9.0, 9.0, (number, space.rotations.dof))


def turned(turns: Floats, angles: Floats, rng: Rng) -> Floats:
    """Rotations, each turned by an angle, about any axis that it may turn about."""
    if turns.shape[1] < 4:
        return turns + (angles * rng.choice([-1.0, 1.0], len(turns)))[:, None]
    axes = rng.normal(size=(len(turns), 3))
    axes *= (angles / np.linalg.norm(axes, axis=1))[:, None]
    return np.asarray((Rotation.from_rotvec(axes) * Rotation.from_quat(turns)).as_quat())


def _slerp(first: Floats, second: Floats, t: Floats, rng: Rng) -> Floats:
    """Quaternions on the shorter arcs, shape (edges, points, 4)."""
    dot = (first * second).sum(axis=1)
    either = rng.choice([-1.0, 1.0], len(dot))
    second = second * np.where(np.abs(dot) < 1e-9, either, np.copysign(1.0, dot))[:, None]
    angle = 2.0 * np.arctan2(np.linalg.norm(second - first, axis=1), np.linalg.norm(second + first, axis=1))[:, None]
    shares = np.stack([np.sin((1.0 - t) * angle), np.sin(t * angle)])
    shares = np.where(angle < 1e-7, np.stack(np.broadcast_arrays(1.0 - t, t, angle)[:2]), shares)[..., None]
    return _unit(shares[0] * first[:, None] + shares[1] * second[:, None])


def _unit(q: Floats) -> Floats:
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def _within(rng: Rng, shape: tuple[int, ...]) -> Floats:
    """Places in cells, from 0 to 1: on either border, and in between."""
    place = rng.choice([0.0, 1.0, np.nan], p=[0.25, 0.25, 0.5], size=shape)
    return np.where(np.isnan(place), rng.random(shape), place)


def _changes(state: NDArray[np.uint8], dim: int) -> Bools:
    """Cells with another state in a cell next to them, across a side, an edge or a corner, at the same rotation."""
    from scipy import ndimage

    size = (1,) * (state.ndim - dim) + (3,) * dim
    return np.asarray(ndimage.maximum_filter(state, size) != ndimage.minimum_filter(state, size))
