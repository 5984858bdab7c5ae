"""Paths by every planner of OMPL in random worlds, and of the lattice in an office."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from cspace import Robot
from planners._catalogue import find_planner, planner_names
from tests.helpers.any_map import MAP_INPUTS, build_map
from tests.helpers.drives import WORDS, make_drive
from tests.helpers.planning import draw_query

OFFICE = "maps/willow-full-0.05.yaml"
"""Map of an office in the folder of real maps."""

FOOTPRINT = [(-0.3, -0.25), (0.4, -0.25), (0.4, 0.0), (0.05, 0.0), (0.05, 0.35), (-0.3, 0.35)]

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


def check_planners(report: Report, rng: np.random.Generator, worlds: int) -> None:
    """Plan by every planner of OMPL in random worlds, with random drives and objectives."""
    report.section(f"plans by every planner of OMPL in {worlds} random worlds")
    names = planner_names()
    solved: Counter[str] = Counter()
    plans = late = wrong = 0
    while plans < worlds * len(names):
        kind, outside = str(rng.choice(list(MAP_INPUTS))), str(rng.choice(["blocked", "free"]))
        space = build_map(kind, "memory", outside, int(rng.integers(2**32)), Path()).memory
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
