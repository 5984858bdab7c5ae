"""Conflicts of lanes on the depot, and pairs of timed motions."""

from __future__ import annotations

import itertools
import time
from collections import Counter

import numpy as np

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import once
from cspace import InputError, Robot, Workspace
from cspace._support.arrays import Floats
from cspace.lanes import RouteGraph

CASES = ((99, 100, 1.5), (400, 400, 25.0))
"""Numbers of nodes and of two-way lanes, and the target of the CPU time, seconds."""

LIMITS = {
    "max_velocity": 1.0,
    "max_acceleration": 0.5,
    "max_angular_velocity": 1.0,
    "max_angular_acceleration": 1.0,
}
"""Limits of trajectories, SI units."""

MAX_MILLISECONDS = 2.0
"""Target: median CPU time of one pair of trajectories, milliseconds."""


def run(report: Report, seed: int) -> None:
    """Time conflicts of graphs on the depot, then pairs of trajectories in an empty hall."""
    data = inputs.data_folder()
    if data is None:
        report.note(inputs.NO_DATA)
    else:
        workspace = Workspace.open(data / "maps" / "depot.yaml", unknown="free")
        space = cspace.build(workspace, Robot.rectangle(1.2, 0.8), rotations=72)
        for nodes, edges, most in CASES[:1] if report.quick else CASES:
            _time_conflicts(report, space, _draw_graph(space, nodes, edges, seed), most)
    _time_pairs(report, 8 if report.quick else 24, seed)


def _draw_graph(space: cspace.CSpace, nodes: int, edges: int, seed: int) -> RouteGraph:
    """Draw free nodes, and lanes to their nearest neighbours in both directions."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(space.grid.lower, space.grid.upper, (4 * nodes, 2))
    still = np.column_stack([places, np.zeros(len(places))])
    places = places[np.asarray(space.is_free(still))][:nodes]
    gaps = np.linalg.norm(places[:, np.newaxis] - places, axis=-1)
    near = np.argsort(gaps, axis=1)[:, 1:3]
    pairs = np.unique([sorted((a, b)) for a in range(len(places)) for b in near[a]], axis=0)
    return RouteGraph.from_arrays(places, rng.permutation(pairs)[:edges], two_way=True)


def _time_conflicts(report: Report, space: cspace.CSpace, graph: RouteGraph, most: float) -> None:
    """Time the conflicts of a graph, and count the pairs."""
    report.section(f"{graph} on the depot, a robot of 1.2 m by 0.8 m")
    for distance in (0.0, 0.1):
        timing = once(lambda gap=distance: cspace.lanes.conflicts(space, graph, margin=gap))
        report.timing(f"conflicts, distance {distance:g} m", timing)
        counts = timing.value.counts
        report.note(", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
        if not report.quick:
            report.figure("CPU time", timing.median_cpu, "s", most=most)
        share = counts["undecided"] / sum(counts.values())
        report.figure("undecided pairs", 1e6 * share, "in a million")
    timing = once(timing.value.zones)
    report.timing("zones", timing)
    report.note(f"{len(timing.value)} zones")


def _time_pairs(report: Report, count: int, seed: int) -> None:
    """Time pairs of trajectories of a differential drive."""
    report.section(f"pairs of {count} trajectories, with an error of 5 cm and 1 mm/s")
    hall = Workspace.from_array(np.zeros((160, 100), dtype=np.bool_), 0.1)
    space = cspace.build(hall, "rect:0.9x0.6", rotations=72)
    rng = np.random.default_rng(seed)
    ends: Floats = rng.uniform((1.0, 1.0, -3.0), (15.0, 9.0, 3.0), (count, 2, 3))
    plans = [planners.plan(space, *pair, drive=planners.Differential(), seed=seed) for pair in ends]
    movers = [
        cspace.lanes.Mover(
            space.robot, plan.trajectory(**LIMITS), 0.5 * k, error=0.05, growth=0.001
        )
        for k, plan in enumerate(plans)
        if plan
    ]
    verdicts: Counter[str] = Counter()
    seconds = []
    for pair in itertools.combinations(movers, 2):
        began = time.process_time()
        try:
            verdicts[cspace.lanes.apart(*pair).verdict] += 1
        except InputError:
            verdicts["touch at the start"] += 1
            continue
        seconds.append(time.process_time() - began)
    report.note(", ".join(f"{number} {verdict}" for verdict, number in verdicts.items()))
    median = 1e3 * float(np.median(seconds))
    report.figure("CPU time of a pair, median", median, "ms", most=MAX_MILLISECONDS)
    report.figure("CPU time of a pair, 95 %", 1e3 * float(np.quantile(seconds, 0.95)), "ms")
    report.figure("undecided pairs", verdicts["undecided"], "pairs")
