"""Paths of drives, against a lattice of eight headings on the same map, and tight parking."""

from __future__ import annotations

import itertools
import math
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import Timing
from cspace import FREE, ConfigurationError, CSpace, Robot, Workspace
from cspace._rotations.base import METRES_PER_RADIAN
from cspace._support.arrays import Floats, Ints

TURNING_RADIUS = 0.5
"""Turning radius of the car, metres."""

MAX_RATIO, MAX_MEDIAN_SECONDS, MAX_SECONDS = 1.15, 0.5, 2.0
"""Largest allowed ratio of our length to the lattice's, and targets of our time."""

TIME_LIMIT = 5.0
"""Time limit of a plan, seconds."""

PARKING_SPACING, PARKING_RADII = 0.05, (4.0, 5.0, 6.0)
"""Spacing of the maps and turning radii of the cars that park, metres."""

BENCH_MR_QUERY = (4.03, -2.6, 0.5 * math.pi), (9.9, -12.0, -0.5 * math.pi)
"""Start and goal of the first parking scene of bench-mr (Heiden and others, 2021)."""

HEADINGS = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
"""Cells along x and y of a drive along each heading."""


def compare(report: Report, name: str, space: CSpace, number: int, seed: int) -> None:
    """Plan between random configurations, and compare with the lattice's shortest paths."""
    rng, queries = np.random.default_rng(seed), list[Floats]()
    while len(queries) < number:
        query = draw_query(space, rng)
        if space.is_connected(*query):
            queries.append(query)
    graph, number_of = eight_headings(space)
    lengths = [shortest_length(graph, number_of, space, query) for query in queries]
    joined = np.isfinite(lengths)
    report.section(
        f"{name}, drives: {number} queries that FREE cells join, {joined.sum()} of them on eight headings"
    )
    for drive in (
        planners.Differential(),
        planners.Car(turning_radius=TURNING_RADIUS, reverse=True),
    ):
        planners.plan(space, *queries[0], drive=drive, time_limit=TIME_LIMIT)  # compiles
        timing, plans = Timing(None), list[planners.Plan]()
        for query in queries:
            find = partial(
                planners.plan,
                space,
                *query,
                drive=drive,
                time_limit=TIME_LIMIT,
                seed=seed,
            )
            plans.append(timing.take(find))
        solved = np.array([plan.certified for plan in plans])
        report.timing(
            f"drive={drive}",
            timing,
            solved=f"{solved.sum()} of {number}",
            worst_cpu_s=round(max(timing.cpu), 2),
        )
        report.mark(method=str(drive))
        report.check(
            all(plan.certified == bool(plan) for plan in plans),
            f"{drive}: every path found is certified",
        )
        report.check(
            solved.sum() >= joined.sum(), f"{drive}: solves at least as many as the lattice"
        )
        seconds = np.array(timing.cpu)[
            joined
        ]  # others take the time limit, because OMPL's planner has no proof
        if len(seconds):
            median, largest = float(np.median(seconds)), float(seconds.max())
            report.figure(
                "  median CPU time of queries that the lattice joins",
                median,
                "s",
                most=MAX_MEDIAN_SECONDS,
            )
            report.figure(
                "  largest CPU time of queries that the lattice joins",
                largest,
                "s",
                most=MAX_SECONDS,
            )
        if drive == planners.Differential():
            report.check(
                bool(solved[joined].all()), f"{drive}: solves every query that the lattice joins"
            )
            _check_lengths(report, plans, lengths)


def park(report: Report) -> None:
    """Park cars in tight slots on coarse maps, by FREE cells and by the geometry."""
    cases = list[tuple[CSpace, Any]]()
    for make_slot, share in itertools.product(
        (inputs.make_parallel_slot, inputs.make_perpendicular_slot), (1.18, 1.3)
    ):
        obstacles, query = make_slot(share)
        workspace = Workspace.from_polygons(obstacles, PARKING_SPACING, inputs.PARKING_BOUNDS)
        cases.append((cspace.build(workspace, Robot.polygon(inputs.CAR), rotations=72), query))
    folder = inputs.data_folder()
    if folder is not None:
        workspace = Workspace.open(
            folder / "polygons" / "parking1.geojson",
            spacing=PARKING_SPACING,
            bounds=(-1, -16, 20, 2),
        )
        car = Robot.open(folder / "polygons" / "car.geojson")
        cases.append((cspace.build(workspace, car, rotations=72), BENCH_MR_QUERY))
    report.section(f"parking: {len(cases)} scenes at {PARKING_SPACING:g} m, by turning radius")
    for radius, exact in itertools.product(PARKING_RADII, (False, True)):
        timing, solved = Timing(None), 0
        _park(*cases[-1], radius, exact)  # compiles
        for space, query in cases:
            plan = timing.take(partial(_park, space, query, radius, exact))
            solved += plan is not None and plan.certified
        name = f"radius {radius:g} m, exact={exact}"
        worst_cpu_s = round(max(timing.cpu), 2)
        report.timing(name, timing, solved=f"{solved} of {len(cases)}", worst_cpu_s=worst_cpu_s)
        if exact:
            report.check(solved == len(cases), f"{name}: parks in every scene")


def _park(space: CSpace, query: Any, radius: float, exact: bool) -> planners.Plan | None:
    """Plan for a car; None if FREE cells do not hold its start or goal."""
    options: Any = {
        "drive": planners.Car(turning_radius=radius, reverse=True),
        "time_limit": TIME_LIMIT,
    }
    try:
        return planners.plan(
            (space.exact if exact else space), *query, planner="Lattice", **options
        )
    except ConfigurationError:
        return None


def _check_lengths(report: Report, plans: list[planners.Plan], lengths: list[float]) -> None:
    """Report lengths over the lattice's, a radian counting as half a metre."""
    ratios = [
        (plan.length + METRES_PER_RADIAN * plan.total_rotation) / length
        for plan, length in zip(plans, lengths, strict=True)
        if plan and math.isfinite(length) and length > 0.0
    ]
    if not ratios:
        return
    for title, share in (("least", 0), ("median", 50), ("largest", 100)):
        report.figure(f"  {title} length over the lattice's", float(np.percentile(ratios, share)))
    report.check(max(ratios) <= MAX_RATIO, f"at most {MAX_RATIO:g} times the lattice's length")


def draw_query(space: CSpace, rng: np.random.Generator) -> Floats:
    """Draw two FREE states of the lattice, shape (2, 3)."""
    drawn = list[Floats]()
    while len(drawn) < 2:
        q = space.sample_free(rng=rng)
        q[:2] = space.grid.center_of(space.grid.cell_of(q[:2]))
        q[2] = np.arctan2(*HEADINGS[rng.integers(len(HEADINGS))][::-1])
        if space.is_free(q):
            drawn.append(q)
    return np.stack(drawn)


def eight_headings(space: CSpace) -> tuple[Any, Ints]:
    """Return the graph of a robot that drives from cell to cell and turns on the spot, and the
    number of each state.

    A drive needs the cells that it touches FREE at its heading. A turn by 45 degrees needs its cell
    FREE at all yaw cells between. Numbers have the shape (8, nx, ny), and are -1 where the state is
    not FREE.
    """
    yaws = [math.atan2(y, x) for x, y in HEADINGS]
    free = np.stack([space.states_at(yaw) == FREE for yaw in yaws])
    numbers = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
    starts, ends, costs = list[Ints](), list[Ints](), list[Floats]()
    for k, (dx, dy) in enumerate(HEADINGS):
        padded = np.pad(numbers[k], 1, constant_values=-1)
        ahead, along, beside = (
            padded[1 + x : 1 + x + free.shape[1], 1 + y : 1 + y + free.shape[2]]
            for x, y in ((dx, dy), (dx, 0), (0, dy))
        )
        drives = (np.minimum(numbers[k], ahead) >= 0) & (np.minimum(along, beside) >= 0)
        following = (k + 1) % len(HEADINGS)
        count = len(space.rotations) // len(HEADINGS)
        between = yaws[k] + np.arange(count + 1) * 2.0 * math.pi / len(space.rotations)
        turns = np.all([space.states_at(yaw) == FREE for yaw in between], axis=0)
        first, last = numbers[k][turns], numbers[following][turns]
        starts += [numbers[k][drives], first, last]
        ends += [ahead[drives], last, first]
        turn = METRES_PER_RADIAN * 2.0 * math.pi / len(HEADINGS)
        costs += [
            np.full(drives.sum(), space.grid.spacing * math.hypot(dx, dy)),
            *[np.full(len(first), turn)] * 2,
        ]
    entries = np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))
    return scipy.sparse.coo_array(entries, shape=(free.sum(),) * 2).tocsr(), numbers


def shortest_length(graph: Any, numbers: Ints, space: CSpace, query: Floats) -> float:
    """Return the weighted length of the lattice's shortest path in metres; infinite if it has none."""
    heading = np.rint(query[:, 2] / (math.pi / 4)).astype(np.int64) % len(HEADINGS)
    first, last = numbers[(heading, *space.grid.cell_of(query[:, :2]).T)]
    return float(scipy.sparse.csgraph.dijkstra(graph, indices=first)[last])
