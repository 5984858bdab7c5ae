"""Audits of route graphs on large maps, in memory and in tiles."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import cspace
from benchmarks.report import Report
from benchmarks.timing import Timing, once
from cspace import Robot, Workspace
from cspace._support.arrays import Bools, Floats
from cspace.lanes import RouteGraph

SPACING = 0.05
"""Side of a cell, metres."""

PITCH, LANE_LENGTH = 2.5, 5.0
"""Distances of neighbouring nodes and of nodes that lanes join, metres."""

MAX_SECONDS = 2.0
"""Target: maximum CPU time of the audit of 10,000 lanes, seconds."""


def run(report: Report, seed: int) -> None:
    """Audit 10,000 lanes of 5 m on 4,000 x 4,000 x 72 cells, all free, and a third blocked."""
    rng = np.random.default_rng(seed)
    size, count = (800, 400) if report.quick else (4_000, 10_000)
    graph = _draw_graph(size, count, rng)
    for share, name in ((0.0, "all free"), (1.0 / 3.0, "about a third blocked")):
        report.section(f"{count} lanes of 5 m on {size} x {size} x 72 cells, {name}")
        workspace = Workspace.from_array(_draw_posts(graph, size, share, rng), SPACING)
        with tempfile.TemporaryDirectory(prefix="cspace-lanes-") as folder:
            robot, store = Robot.rectangle(0.93, 0.61), Path(folder) / "map.zarr"
            maps = {
                "memory": cspace.build(workspace, robot, rotations=72),
                "tiles": cspace.build(workspace, robot, rotations=72, store=store),
            }
            audits = {}
            for place, space in maps.items():
                timing = _time(partial(cspace.lanes.audit, space, graph))
                report.timing(place, timing)
                if place == "memory" and not report.quick:
                    most = MAX_SECONDS
                    report.figure(f"CPU time, {place}", timing.median_cpu, "s", most=most)
                audits[place] = [row[3] for row in timing.value.lanes]
        equal = audits["memory"] == audits["tiles"]
        report.check(equal, "tiles and memory give the same verdicts")
        blocked = audits["memory"].count("blocked") / count
        report.figure("share of blocked lanes", blocked, "")


def _time(audit: Any) -> Timing:
    """Return the time of an audit, after one that compiles."""
    audit()
    return once(audit)


def _draw_graph(size: int, count: int, rng: np.random.Generator) -> RouteGraph:
    """Draw lanes along the axes of a grid of nodes."""
    sides = np.arange(PITCH, size * SPACING - PITCH, PITCH)
    nodes = np.stack(np.meshgrid(sides, sides, indexing="ij"), axis=-1).reshape(-1, 2)
    numbers = np.arange(len(nodes)).reshape(len(sides), -1)
    step = round(LANE_LENGTH / PITCH)
    pairs = (numbers[:-step], numbers[step:]), (numbers[:, :-step], numbers[:, step:])
    edges = np.concatenate([np.column_stack([a.ravel(), b.ravel()]) for a, b in pairs])
    edges = np.concatenate([edges, edges[:, ::-1]])
    return RouteGraph.from_arrays(nodes, rng.permutation(edges)[:count])


def _draw_posts(graph: RouteGraph, size: int, share: float, rng: np.random.Generator) -> Bools:
    """Draw posts of 0.35 m beside so many lanes that about a share of all is blocked."""
    occupied = np.zeros((size, size), dtype=np.bool_)
    # Each post is near four lanes, two in each direction.
    for number in rng.permutation(len(graph.lanes))[: round(0.35 * share * len(graph.lanes))]:
        lane = graph.lanes[number]
        first, last = graph.positions[[lane.start, lane.end]]
        place: Floats = first + rng.uniform(0.2, 0.8) * (last - first) + rng.uniform(-0.6, 0.6, 2)
        i, j = (place / SPACING).astype(np.int64)
        occupied[i - 3 : i + 4, j - 3 : j + 4] = True
    return occupied
