"""Proofs of maps in every space."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from benchmarks.report import Report
from cspace import BLOCKED, FREE, MIXED, CSpace
from cspace.support.arrays import Bools, Floats, States
from tests.soak.plane import draw_case
from tests.soak.space import draw_solid_case
from tests.soak.tally import Case, Rng, Tally, draw_until, find_collisions, pick_close

TWO_PI = 2.0 * np.pi

POINTS_PER_STATE = 900
"""Configurations drawn in FREE and in BLOCKED cells per map, half beside other states."""

CANDIDATES, FOLLOWED = 200, 30
"""Edges drawn, and free edges followed, per map."""

POINTS_PER_EDGE = 1000
"""Points checked per edge."""

GROUP_SIZES = (200, 20)
"""Consecutive points of an edge that one distance may prove free, coarse then fine."""

WALKS, STEPS = 30, 25
"""Walks per map, and motions attempted per walk."""

EDGE = "edge"

EXACT_CANDIDATES, EXACT_FOLLOWED = 400, 40
"""Edges drawn, and edges proven only by geometry and followed, per map."""

CLOSE_CELLS = 0.05
"""Distance from obstacles, in cells, at which an edge is close."""

PROVABLE_CELLS = 1e-3
"""Distance from obstacles, in cells, from which a point must be proven."""

QUERY_STEP = 20
"""Step between points of an edge that the map must prove, too."""

EXACT_POINT, EXACT_EDGE, LOST = "exact point", "exact edge", "exact point that is not proven"

Draw = Callable[[int, int], Case]
SPACE_CASES: dict[str, tuple[Draw, int]] = {
    "robots in the plane": (draw_case, 1),
    "robots that turn": (partial(draw_case, turning=True), 1),
    "robots in space": (draw_solid_case, 1),
    "robots that turn in space": (partial(draw_solid_case, turning=True), 10),
    "robots that turn freely in space": (partial(draw_solid_case, freely=True), 10),
}
"""How to draw cases, and the divisor of their number, because the oracle is slow for rotating
solids."""


def check(report: Report, seed: int, answers: int, edges: int) -> None:
    """Check random maps of each space."""
    for name, (draw, share) in SPACE_CASES.items():
        check_maps(report, name, draw, seed, answers // share, edges // share)


def check_maps(report: Report, name: str, draw: Draw, seed: int, answers: int, edges: int) -> None:
    """Check maps of one space."""

    def enough(tally: Tally) -> bool:
        return (
            tally.checks["FREE"] + tally.checks["BLOCKED"] >= answers
            and tally.checks[EDGE] >= edges * POINTS_PER_EDGE
        )

    def check_case(tally: Tally, number: int) -> None:
        case, rng = draw(seed, number), np.random.default_rng([seed, number, 1])
        _check_states(tally, case, rng)
        if (case.space.cell_states == FREE).any():
            _check_edges(tally, case, rng)
            _check_boxes(tally, case, rng)
            _check_clearance(tally, case, rng)
        _check_containment(tally, case, rng)
        _check_walks(tally, case, rng)

    draw_until(report, f"{name}, edges at {POINTS_PER_EDGE} points each", seed, enough, check_case)


def check_exact(report: Report, seed: int, edges: int) -> None:
    """Check what only ``exact=True`` proves, in each space."""
    for name, (draw, share) in SPACE_CASES.items():

        def check_case(tally: Tally, number: int, draw: Draw = draw) -> None:
            _check_exact(tally, draw(seed, number), np.random.default_rng([seed, number, 6]))

        wanted = edges * POINTS_PER_EDGE // share
        title = f"exact=True, {name}, edges at {POINTS_PER_EDGE} points each"
        draw_until(
            report,
            title,
            seed,
            lambda tally, wanted=wanted: tally.checks[EXACT_EDGE] >= wanted,
            check_case,
        )


# ---- checks --------------------------------------------------------------------------------------


def _check_states(tally: Tally, case: Case, rng: Rng) -> None:
    """Check configurations in cells of each state, and anywhere."""
    space = case.space
    state, boundary = space.cell_states, _mark_state_changes(space.cell_states, space.grid.dim)
    drawn, claimed = [], []
    for claim in (FREE, MIXED, BLOCKED):
        number = POINTS_PER_STATE // 9 if claim == MIXED else POINTS_PER_STATE // 2
        for chosen in (state == claim, (state == claim) & boundary):
            cells = np.flatnonzero(chosen)
            if len(cells):
                positions = np.stack(
                    np.unravel_index(cells[rng.integers(0, len(cells), number)], state.shape),
                    axis=1,
                )
                drawn.append(_draw_in_cells(space, positions, rng))
                claimed.append(np.full(number, claim))
    q, claims = np.concatenate(drawn), np.concatenate(claimed)
    answers = np.asarray(space.classify(q))
    # A border belongs to both cells, so the states of the drawn cell and of the query must both be
    # right.
    tally.judge(case, q, claims)
    other = answers != claims
    tally.judge(case, q[other], answers[other])
    few = POINTS_PER_STATE // 6
    anywhere = _draw_anywhere(case, few, 1.5, rng)
    q = np.concatenate([snap_nearly(space, rng.permutation(q)[:few], rng), anywhere])
    tally.judge(case, q, np.asarray(space.classify(q)))


def _check_edges(tally: Tally, case: Case, rng: Rng) -> None:
    """Check all points of free edges."""
    space, dim = case.space, case.space.grid.dim
    starts = space.sample_free(CANDIDATES, rng)
    snapped = rng.random(CANDIDATES) < 0.3
    starts[snapped] = snap_nearly(space, starts[snapped], rng, away=0.0)
    steps = rng.choice([0.0, 2.0, 10.0, 40.0], (CANDIDATES, 1)) * rng.normal(size=(CANDIDATES, dim))
    lattice = rng.integers(-9, 10, (CANDIDATES, 1)) * rng.integers(-1, 2, (CANDIDATES, dim))
    goals = _move(
        space, starts, np.where(snapped[:, None], lattice, steps), (0.0, 0.05, 0.5, 2.0), rng
    )
    free = np.flatnonzero(space.motion_is_free(starts, goals))
    few = interpolate_edges(space, starts[free], goals[free], np.linspace(0.0, 1.0, 50), rng)
    picked = free[pick_close(np.asarray(space.clearance(few)).min(axis=1), FOLLOWED, rng)]
    if not len(picked):
        return
    q = interpolate_edges(
        space, starts[picked], goals[picked], np.linspace(0.0, 1.0, POINTS_PER_EDGE), rng
    )
    wrong, undecided = find_collisions_along(case, q)
    if (
        len(space.rotations.names) < 4
    ):  # the other cell may prove an edge on the border of quaternion cells
        wrong |= ~np.asarray(space.is_free(q))
    tally.add(EDGE, case, q, wrong, undecided)


def _check_boxes(tally: Tally, case: Case, rng: Rng) -> None:
    """Check corners and insides of boxes proven free by ``is_free_around``."""
    space, dim = case.space, case.space.grid.dim
    distance = (
        space.grid.spacing * float(rng.choice([0.0, 0.5, 1.0, 3.0])) * float(rng.uniform(0.5, 1.5))
    )
    angle = float(rng.choice([0.0, 0.01, 0.1, 1.0, 4.0]) * rng.uniform(0.5, 1.5))
    centers = space.sample_free(200, rng)
    centers[::4] = snap_nearly(space, centers[::4], rng, away=0.0)
    centers = centers[np.asarray(space.is_free_around(centers, distance, angle))][:20]
    shape = (len(centers), 12, space.size)
    away = np.where(rng.random(shape) < 0.4, 1.0, rng.random(shape)) * rng.choice(
        [-1.0, 1.0], shape
    )
    q = np.repeat(centers[:, None], shape[1], axis=1)
    q[..., :dim] += distance * away[..., :dim]
    q = q.reshape(-1, space.size)
    q[:, dim:] = rotate_by(q[:, dim:], angle * np.abs(away[..., -1]).ravel(), rng)
    wrong, undecided = find_collisions(case, q)
    tally.add("box", case, q, wrong | ~np.asarray(space.is_free(q)), undecided)


def _check_clearance(tally: Tally, case: Case, rng: Rng) -> None:
    """Check configurations within the clearance of others."""
    space, dim = case.space, case.space.grid.dim
    centers = space.sample_free(150, rng)
    far = np.minimum(space.clearance(centers), 100.0 * space.grid.spacing * max(space.grid.shape))
    direction = rng.normal(size=(len(far), dim))
    direction *= (
        far * rng.choice([1.0, 0.999, 0.5], len(far)) / np.linalg.norm(direction, axis=1)
    )[:, None]
    q = centers.copy()
    q[:, :dim] += direction
    if space.rotations.names:
        turn = space.rotations.find_cells(centers)
        q[:, dim:] = _rotations_in_cells(
            space, turn, np.clip(_draw_within(rng, (len(turn), 3)), 1e-6, 1.0 - 1e-6)
        )
    wrong, undecided = find_collisions(case, q)
    tally.add("clearance", case, q, wrong | ~np.asarray(space.is_free(q)), undecided)


def _check_containment(tally: Tally, case: Case, rng: Rng) -> None:
    """Check that ``contains_robot`` is True only inside obstacles."""
    space, grid = case.space, case.space.grid
    turns = draw_rotations(space, 2000, rng)
    q = np.concatenate([rng.uniform(grid.lower, grid.upper, (2000, grid.dim)), turns], axis=1)
    q = q[np.asarray(space.contains_robot(q))][:40]
    if len(q):
        tally.add("contained", case, q, ~case.lies_in(q, rng))


def _check_walks(tally: Tally, case: Case, rng: Rng) -> None:
    """Check that no proven walk connects configurations that ``is_disconnected``."""
    space, dim = case.space, case.space.grid.dim
    if not _has_geometry(case):
        return
    positions = rng.uniform(space.grid.lower, space.grid.upper, (10 * WALKS, dim))
    first = np.concatenate([positions, draw_rotations(space, len(positions), rng)], axis=1)
    first = first[np.asarray(space.is_free(first, exact=True))][:WALKS]
    last = first.copy()
    for _ in range(STEPS if len(first) else 0):
        size, goals = rng.choice([0.0, 0.3, 1.0, 3.0], (len(last), 2)), last.copy()
        goals[:, :dim] += space.grid.spacing * size[:, :1] * rng.normal(size=(len(last), dim))
        goals[:, dim:] = rotate_by(
            last[:, dim:], size[:, 1] * np.abs(rng.normal(0.0, 0.5, len(last))), rng
        )
        free = np.asarray(space.motion_is_free(last, goals, exact=True))
        last[free] = goals[free]
    tally.add("path", case, last, np.asarray(space.is_disconnected(first, last)))


def _check_exact(tally: Tally, case: Case, rng: Rng) -> None:
    """Check points and edges that are free only with ``exact=True``."""
    space, dim = case.space, case.space.grid.dim
    if not _has_geometry(case):
        return
    q = _draw_anywhere(case, 20 * EXACT_CANDIDATES, 0.5, rng)
    known = np.asarray(space.is_free(q))
    q = np.concatenate([q[~known][: 4 * EXACT_CANDIDATES], q[known][:EXACT_CANDIDATES]])
    known, free = np.asarray(space.is_free(q)), np.asarray(space.is_free(q, exact=True))
    proven, refused = q[free & ~known], q[~free][:EXACT_CANDIDATES]
    tally.add(EXACT_POINT, case, proven, *find_collisions(case, proven))
    if space.workspace.source != "mesh" or space.workspace.shapes:  # a filled mesh has only cells
        tally.add(
            LOST,
            case,
            refused,
            ~case.meets(refused, space.margin + PROVABLE_CELLS * space.grid.spacing),
        )
    starts = np.concatenate([proven[:EXACT_CANDIDATES], q[known][: EXACT_CANDIDATES // 4]])
    steps = rng.choice([0.0, 0.5, 2.0, 10.0], (len(starts), 1)) * rng.normal(
        size=(len(starts), dim)
    )
    goals = _move(space, starts, steps, (0.0, 1e-5, 0.05, 0.5, 2.0), rng)
    by_geometry = np.asarray(space.motion_is_free(starts, goals, exact=True))
    edges = rng.permutation(
        np.flatnonzero(by_geometry & ~np.asarray(space.motion_is_free(starts, goals)))
    )
    if not len(edges):
        return
    few = interpolate_edges(
        space, starts[edges], goals[edges], np.linspace(0.0, 1.0, 11), rng
    ).reshape(-1, space.size)
    close = (
        case.meets(few, space.margin + CLOSE_CELLS * space.grid.spacing).reshape(-1, 11).any(axis=1)
    )
    picked = edges[pick_close((~close).astype(np.float64), EXACT_FOLLOWED, rng)]
    q = interpolate_edges(
        space, starts[picked], goals[picked], np.linspace(0.0, 1.0, POINTS_PER_EDGE), rng
    )
    wrong, undecided = find_collisions_along(case, q)
    wrong[:, ::QUERY_STEP] |= ~np.asarray(space.is_free(q[:, ::QUERY_STEP], exact=True))
    tally.add(EXACT_EDGE, case, q, wrong, undecided)


def _has_geometry(case: Case) -> bool:
    """Return False if the robot consists of cells."""
    return getattr(case.space.robot.shape, "solid", "") != "fill"


def find_collisions_along(case: Case, q: Floats) -> tuple[Bools, Bools]:
    """Apply :func:`tests.soak.tally.find_collisions` to points of edges, shape (edges, points,
    size).

    A group of points is free if the robot at its middle is farther from the obstacles than any of
    its points moves within the group. Other groups are split, at last into single points.
    """
    wrong, undecided = np.zeros((2, *q.shape[:2]), dtype=np.bool_)
    open_ = np.ones(q.shape[:2], dtype=np.bool_)
    dim = case.space.grid.dim
    for size in GROUP_SIZES:
        groups = q.reshape(len(q), -1, size, q.shape[2])
        near = open_.reshape(groups.shape[:3]).any(axis=2)
        members, centers = groups[near], groups[near][:, size // 2]
        apart = members - centers[:, None]
        # A point moves at most by twice its radius times the length of the quaternion's path.
        moved = np.linalg.norm(apart[..., :dim], axis=-1) + 2.0 * case.reach * np.abs(
            apart[..., dim:]
        ).sum(axis=-1)
        near[near] = case.meets(centers, moved.max(axis=1) + case.space.margin + 1e-6)
        open_ = np.repeat(near, size, axis=1)
    wrong[open_], undecided[open_] = find_collisions(case, q[open_])
    return wrong, undecided


# ---- configurations ------------------------------------------------------------------------------


def _draw_anywhere(case: Case, number: int, share: float, rng: Rng) -> Floats:
    """Draw configurations in and around the grid."""
    space, grid = case.space, case.space.grid
    reach = share * (case.reach + space.margin + grid.spacing)
    positions = rng.uniform(
        np.subtract(grid.lower, reach), np.add(grid.upper, reach), (number, grid.dim)
    )
    return np.concatenate([positions, draw_rotations(space, number, rng)], axis=1)


def _move(space: CSpace, q: Floats, steps: Floats, sizes: tuple[float, ...], rng: Rng) -> Floats:
    """Move configurations by steps and random angles."""
    dim, goals = space.grid.dim, q.copy()
    goals[:, :dim] += space.grid.spacing * steps
    angles = rng.choice(sizes, len(q)) * np.abs(rng.normal(size=len(q)))
    goals[:, dim:] = rotate_by(q[:, dim:], np.where(rng.random(len(q)) < 0.05, np.pi, angles), rng)
    return goals


def snap_nearly(space: CSpace, q: Floats, rng: Rng, away: float = 1.0) -> Floats:
    """Move configurations onto or near the lattice."""
    grid = space.grid
    near = np.round((q[:, : grid.dim] - grid.lower) / grid.spacing)
    near += (
        away
        * rng.choice([-1.0, 0.0, 1.0], near.shape)
        * 10.0 ** rng.uniform(-9.0, -3.0, near.shape)
    )
    snapped = np.concatenate([grid.lower + grid.spacing * near, q[:, grid.dim :]], axis=1)
    if space.rotations.names:
        boundaries = _borders(space.rotations)
        boundary = rng.choice(boundaries, (len(q), 3 if len(space.rotations.names) == 4 else 1))
        boundary += (
            away
            * rng.choice([-1.0, 0.0, 1.0], boundary.shape)
            * 10.0 ** rng.uniform(-12.0, -3.0, boundary.shape)
        )
        if len(space.rotations.names) == 4:  # some of the quotients are on a border
            quotients = np.where(
                rng.random(boundary.shape) < 0.5, rng.uniform(-1.0, 1.0, boundary.shape), boundary
            )
            boundary = _unit(rng.permuted(np.column_stack([quotients, np.ones(len(q))]), axis=1))
        snapped[:, grid.dim :] = np.where(rng.random((len(q), 1)) < 0.5, q[:, grid.dim :], boundary)
    return snapped


def interpolate_edges(space: CSpace, starts: Floats, goals: Floats, t: Floats, rng: Rng) -> Floats:
    """Interpolate edges, shape (edges, points, size)."""
    dim = space.grid.dim
    steps = goals - starts
    if len(space.rotations.names) == 1:
        turns = (steps[:, dim:] + np.pi) % TWO_PI - np.pi
        steps[:, dim:] = np.where(
            np.pi - np.abs(turns) < 1e-9, np.pi * rng.choice([-1.0, 1.0], turns.shape), turns
        )
    q = starts[:, None] + t[:, None] * steps[:, None]
    if len(space.rotations.names) == 4:
        q[..., dim:] = _slerp(starts[:, dim:], goals[:, dim:], t, rng)
    # Rounding must not move a point out of the edge's bounding box, which may end at the grid.
    low, high = np.minimum(starts, goals)[:, None, :dim], np.maximum(starts, goals)[:, None, :dim]
    q[..., :dim] = np.clip(q[..., :dim], low, high)
    return q


def _draw_in_cells(space: CSpace, cells: NDArray[np.integer], rng: Rng) -> Floats:
    """Draw a configuration in each cell, many on borders."""
    grid, dim = space.grid, space.grid.dim
    points = grid.lower + grid.spacing * (cells[:, -dim:] + _draw_within(rng, (len(cells), dim)))
    if not space.rotations.names:
        return np.asarray(points)
    turns = _rotations_in_cells(space, cells[:, 0], _draw_within(rng, (len(cells), 3)))
    if len(space.rotations.names) == 4:
        return np.column_stack([points, turns * rng.choice([-1.0, 1.0], (len(turns), 1))])
    return np.column_stack([points, turns + TWO_PI * rng.integers(-2, 3, turns.shape)])


def _borders(rotations: Any) -> Floats:
    """Return the borders of rotation cells, of any kind."""
    return np.asarray(rotations.borders)


def _rotations_in_cells(space: CSpace, cells: NDArray[np.integer], part: Floats) -> Floats:
    """Return a rotation in each cell, at parts (n, 3)."""
    boundaries = _borders(space.rotations)
    if len(space.rotations.names) == 1:
        return np.asarray(
            boundaries[cells] + part[:, 0] * (boundaries[cells + 1] - boundaries[cells])
        )[:, None]
    n = len(boundaries) - 1
    chart, *parts = np.unravel_index(cells, (4, n, n, n))
    first = np.stack(parts, axis=1)
    quotients = boundaries[first] + part * (boundaries[first + 1] - boundaries[first])
    q = np.ones((len(cells), 4))
    q[np.arange(4) != chart[:, None]] = quotients.ravel()
    return _unit(q)


def draw_rotations(space: CSpace, number: int, rng: Rng) -> Floats:
    """Draw rotations of configurations: no numbers, yaws, or quaternions."""
    if len(space.rotations.names) == 4:
        return _unit(rng.normal(size=(number, 4)))
    return rng.uniform(-9.0, 9.0, (number, len(space.rotations.names)))


def rotate_by(turns: Floats, angles: Floats, rng: Rng) -> Floats:
    """Rotate each rotation by an angle."""
    if turns.shape[1] < 4:
        return turns + (angles * rng.choice([-1.0, 1.0], len(turns)))[:, None]
    axes = rng.normal(size=(len(turns), 3))
    axes *= (angles / np.linalg.norm(axes, axis=1))[:, None]
    return np.asarray((Rotation.from_rotvec(axes) * Rotation.from_quat(turns)).as_quat())


def _slerp(first: Floats, second: Floats, t: Floats, rng: Rng) -> Floats:
    """Interpolate quaternions on the shorter arcs, shape (edges, points, 4)."""
    dot = (first * second).sum(axis=1)
    either = rng.choice([-1.0, 1.0], len(dot))
    second = second * np.where(np.abs(dot) < 1e-9, either, np.copysign(1.0, dot))[:, None]
    angle = (
        2.0
        * np.arctan2(
            np.linalg.norm(second - first, axis=1), np.linalg.norm(second + first, axis=1)
        )[:, None]
    )
    shares = np.stack([np.sin((1.0 - t) * angle), np.sin(t * angle)])
    shares = np.where(angle < 1e-7, np.stack(np.broadcast_arrays(1.0 - t, t, angle)[:2]), shares)[
        ..., None
    ]
    return _unit(shares[0] * first[:, None] + shares[1] * second[:, None])


def _unit(q: Floats) -> Floats:
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def _draw_within(rng: Rng, shape: tuple[int, ...]) -> Floats:
    """Draw positions in cells, half on borders."""
    position = rng.choice([0.0, 1.0, np.nan], p=[0.25, 0.25, 0.5], size=shape)
    return np.where(np.isnan(position), rng.random(shape), position)


def _mark_state_changes(state: States, dim: int) -> Bools:
    """Mark cells that touch a cell of another state."""
    size = (1,) * (state.ndim - dim) + (3,) * dim
    return np.asarray(ndimage.maximum_filter(state, size) != ndimage.minimum_filter(state, size))
