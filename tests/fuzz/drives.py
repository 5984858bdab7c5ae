"""Paths by every planner of OMPL in random worlds, and of the lattice in an office, against
shortest paths along eight headings."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from cspace import FREE, CSpace, Robot, Workspace
from cspace._support.arrays import Floats
from planners._catalogue import find_planner, planner_names
from tests.fuzz.scenes import Rng
from tests.helpers.drives import WORDS, make_drive

OFFICE = "maps/willow-full-0.05.yaml"
"""Map of an office in the folder of real maps."""

FOOTPRINT = [(-0.3, -0.25), (0.4, -0.25), (0.4, 0.0), (0.05, 0.0), (0.05, 0.35), (-0.3, 0.35)]

HEADINGS = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
"""Steps along the eight headings, in cells."""

RADIUS = 0.5
"""Turning radius of cars, metres."""


LIMIT = 0.2
"""Time limit of a plan in a random world, seconds."""

MANY_WORLDS = 10
"""Number of random worlds in which every planner finds at least one path."""


def check(report: Report, seed: int, queries: int) -> None:
    """Plan in random worlds, and random queries in the office with each drive."""
    check_planners(report, np.random.default_rng([seed, 7]), max(2, queries // 5))
    workspace = inputs.real_map(OFFICE)
    if workspace is None:
        report.note(inputs.NO_DATA)
        return
    report.section(f"paths of the lattice in an office: {queries} queries, seed {seed}")
    space = cspace.build(workspace, Robot.polygon(FOOTPRINT), rotations=72)
    rng = np.random.default_rng([seed, 6])
    drawn = [draw_query(space, rng) for _ in range(2 * queries)]
    pairs = [pair for pair in drawn if space.is_connected(*pair)]
    for drive in WORDS[1:]:
        options = {"drive": make_drive(drive, RADIUS), "time_limit": 20.0}
        plans = [planners.plan(space, *pair, planner="Lattice", **options) for pair in pairs]
        wrong = sum(plan.certified != bool(plan) for plan in plans)
        report.check(not wrong, f"{drive}: {wrong} of {len(plans)} paths are not certified")


def build_world(rng: Rng) -> CSpace:
    """Build the map of random boxes in the plane or in space, for a box that may turn."""
    dim = int(rng.integers(2, 4))
    occupied = np.zeros((36, 30, 12)[:dim], dtype=bool)
    for _ in range(6):
        corner = rng.integers(0, occupied.shape)
        sides = rng.integers(1, 10, dim)
        box = [slice(low, low + side) for low, side in zip(corner, sides, strict=True)]
        occupied[tuple(box)] = True
    robot = Robot.rectangle(0.5, 0.3) if dim == 2 else Robot.box((0.4, 0.2, 0.1))
    rotations = 24 if rng.random() < 0.7 else None
    return cspace.build(Workspace.from_array(occupied, 0.1), robot, rotations=rotations)


def check_planners(report: Report, rng: Rng, worlds: int) -> None:
    """Plan by every planner of OMPL in random worlds, with random drives and objectives."""
    report.section(f"plans by every planner of OMPL in {worlds} random worlds")
    names = planner_names()
    solved: Counter[str] = Counter()
    plans = late = wrong = 0
    while plans < worlds * len(names):
        space = build_world(rng)
        start, goal = space.sample_free(2, rng)
        if not space.is_connected(start, goal):
            continue
        drive = str(rng.choice(WORDS)) if planners.choices(space).drives else "holonomic"
        for name in names:
            plans += 1
            if drive == "dubins" and name in ("BKPIECE1", "LBKPIECE1"):
                continue
            plan = planners.plan(
                space,
                start,
                goal,
                planner=name,
                objective="clearance"
                if find_planner(name).optimises and rng.random() < 0.5
                else "length",
                drive=make_drive(drive, RADIUS),
                time_limit=LIMIT,
                seed=int(rng.integers(1000)),
            )
            solved[name] += bool(plan)
            late += plan.times.planning > LIMIT + 0.25
            free = plan.certified and bool(np.all(space.is_free(plan.path)))
            wrong += free != bool(plan)
    report.check(not wrong, f"{wrong} of {plans} paths are not certified or not free")
    report.check(late <= plans // 50, f"{late} of {plans} plans end more than 0.25 s late")
    # In few worlds, one may find none in its short time.
    finds_all = worlds < MANY_WORLDS or all(solved[name] for name in names)
    report.check(finds_all, f"every planner finds paths in {MANY_WORLDS} worlds or more: {solved}")


def draw_query(space: CSpace, rng: Rng) -> Floats:
    """Draw two FREE configurations at the centers of cells."""
    q = space.sample_free(2, rng)
    q[:, :2] = space.grid.center_of(space.grid.cell_of(q[:, :2]))
    q[:, 2] = space.rotations.centers[space.rotations.cell_of(q[:, 2]), 0]
    return q


def join_eight_headings(space: CSpace, drive: planners.Differential) -> csr_array:
    """Return the graph of FREE cells of a robot that turns on the spot and drives along eight
    headings."""
    free = np.asarray(space.cell_states) == FREE
    index = np.arange(free.size).reshape(free.shape)
    edges = [
        (index[k], index[(k + 1) % len(free)], free[k] & free[(k + 1) % len(free)])
        for k in range(len(free))
    ]
    turn = math.pi / len(free)  # half a metre for each radian
    parts = [(a[m], b[m], np.full(m.sum(), turn)) for a, b, m in edges]
    parts += [(b, a, cost) for a, b, cost in parts]
    for dx, dy in HEADINGS:
        k = int(space.rotations.cell_of(math.atan2(dy, dx)))
        ahead = np.roll(np.pad(free[k], 1), (-dx, -dy), (0, 1))[1:-1, 1:-1]
        beside = [
            np.roll(np.pad(free[k], 1), (-a, -b), (0, 1))[1:-1, 1:-1] for a, b in ((dx, 0), (0, dy))
        ]
        may = free[k] & ahead & beside[0] & beside[1]
        a = index[k][may]
        b = a + dx * free.shape[2] + dy
        parts.append((a, b, np.full(len(a), space.grid.spacing * math.hypot(dx, dy))))
        parts += [(b, a, parts[-1][2])] * drive.reverse
    a, b, cost = (np.concatenate(column) for column in zip(*parts, strict=True))
    return coo_array((cost, (a, b)), shape=(free.size, free.size)).tocsr()


def shortest_length(space: CSpace, graph: csr_array, query: Floats) -> float:
    """Return the length of the shortest path in a graph of cells, infinite without one."""
    cells = np.column_stack(
        [space.rotations.cell_of(query[:, 2]), space.grid.cell_of(query[:, :2])]
    )
    first, last = np.ravel_multi_index(
        tuple(cells.T), (len(space.rotations), *space.grid.shape)
    ).tolist()
    return float(dijkstra(graph, indices=first)[last])


def weighted_length(plan: planners.Plan) -> float:
    """Return the length of a plan in metres, with half a metre for each radian."""
    return plan.length + 0.5 * plan.total_rotation
