"""Plans of arms on a public benchmark, against OMPL with coal and VAMP.

All paths are checked in small steps with the meshes.
"""

from __future__ import annotations

import statistics
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks import inputs
from benchmarks.report import Report, is_here
from benchmarks.suites.arm_joints import run_joints
from benchmarks.suites.arm_peers import (
    ArmProblem,
    Folder,
    Vamp,
    check_discrete,
    solve_by_ompl,
)
from benchmarks.suites.arm_poses import run_poses
from benchmarks.suites.arm_scenes import run_scenes
from benchmarks.suites.arm_upright import run_upright
from benchmarks.timing import Timing
from cspace._support.arrays import Floats
from cspace.arms import Arm, ArmSpace
from cspace.errors import ConfigurationError
from planners import Search, plan

MIN_SOLVED_SHARE = {"panda": 0.95, "ur5": 0.9}
"""Target share of solved problems, for each arm in the data folder."""

ARM_SEARCH_SECONDS = 5.0
"""Time limit of a search, seconds."""

MIN_OMPL_RATIO = 20.0
"""Target: minimum time of OMPL over ours."""

CLOSE_CHECK_STEP = 0.005
"""Largest step of a joint between close checks of a motion, radians."""

MOTIONS_PER_PROBLEM = 20
"""Number of motions tested for each problem."""

MAX_LENGTH_RATIO = 1.05
"""Target: median length of plans over the best known length."""

REFERENCE_SEARCHES = 300
"""Further searches of the runs that find the best known length."""

OURS, SEARCH = "ours, shortened", "ours, its first path"
OMPL, VAMP = "RRTConnect of OMPL, coal in the callback", "RRTConnect of VAMP"


def run(report: Report, seed: int) -> None:
    """Reach poses, change scenes, plan with 8 and 14 joints and with an upright tool; then compare
    paths and motions of each arm."""
    run_poses(report, seed)
    run_scenes(report, seed)
    run_joints(report, seed)
    run_upright(report, seed)
    folder = inputs.data_folder()
    if folder is None or not (folder / "arms").is_dir():
        report.note(inputs.NO_DATA)
        return
    if not (report.has("ompl") and report.has("pinocchio")):
        return
    report.has("vamp", "VAMP skipped")
    for robot, least in MIN_SOLVED_SHARE.items():
        files = Folder(folder / "arms" / robot)
        if not files.path.is_dir():
            report.note(f"{robot} skipped: not in the folder of data")
            continue
        problems = list(files.problems(1 if report.quick else 10))
        report.section(
            f"{robot}, {files.arm.dof} joints: {len(problems)} problems of MotionBenchMaker, "
            f"{ARM_SEARCH_SECONDS:g} s each"
        )
        _plan(report, problems, least, seed)
        _shorten(report, problems, seed)
        _judge(report, problems[:: 1 if report.quick else 5], np.random.default_rng(seed))


def _plan(report: Report, problems: list[ArmProblem], least: float, seed: int) -> None:
    """Compare solved problems, times and colliding paths."""
    timings: dict[str, Timing] = {}
    solved, colliding, sets = Counter[str](), Counter[str](), list[str]()
    made, own, proven = list[float](), list[float](), True
    for problem in problems:
        began = time.perf_counter()
        space = problem.space()
        made.append(time.perf_counter() - began)
        meshes = problem.meshes()
        goals = problem.goals[[not meshes.collides(goal) for goal in problem.goals]]
        if meshes.collides(problem.start) or not len(goals):
            continue
        sets.append(problem.name)
        solvers: dict[str, Callable[[], Floats | None]] = {
            OURS: partial(_solve, space, problem.start, goals, seed, True),
            SEARCH: partial(_solve, space, problem.start, goals, seed, False),
            OMPL: partial(
                solve_by_ompl,
                meshes,
                problem.folder.arm,
                problem.start,
                goals,
                seed,
                ARM_SEARCH_SECONDS,
            ),
        }
        if is_here("vamp"):
            vamp = Vamp(problem)
            solvers[VAMP] = partial(vamp.solve, problem.start, goals)
        for name, solve in solvers.items():
            timing = timings.setdefault(name, Timing(None))
            if not timing.seconds:
                solve()  # compiles and loads
            path = timing.take(solve)
            if path is None or not len(path):
                continue
            solved[name] += 1
            colliding[name] += any(
                meshes.first_collision(*edge, CLOSE_CHECK_STEP) is not None
                for edge in pairwise(path)
            )
            if name in (OURS, SEARCH):
                proven &= bool(space.certify_path(path).all()) and bool(
                    (path[0] == problem.start).all()
                )
            elif name == VAMP:
                own.append(vamp.own_seconds)
    report.note(
        f"{len(sets)} of {len(problems)} have a start and a goal that are free by the meshes"
    )
    for name, timing in timings.items():
        report.timing(
            name, timing, solved=f"{solved[name]} of {len(sets)}", colliding=colliding[name]
        )
    if own:
        report.note(
            f"VAMP by its own clock, without the passing of arguments: {statistics.median(own) * 1e3:.3g} ms"
        )
    report.figure(
        "share of the problems that ours solves", solved[OURS] / len(sets), "", least=least
    )
    report.check(proven, f"ours: all {solved[OURS]} paths are proven, from the start on")
    summary = f"ours: {colliding[OURS]} of {solved[OURS]} paths collide, tested every {CLOSE_CHECK_STEP:g} rad"
    report.check(not colliding[OURS], summary)
    # Only VAMP's path is shortened.
    report.ratio(f"{OMPL} / {SEARCH}", timings[OMPL], timings[SEARCH], least=MIN_OMPL_RATIO)
    for name in [name for name in (OMPL, VAMP) if name in timings]:
        report.ratio(f"{name} / {OURS}", timings[name], timings[OURS])
    for each in dict.fromkeys(sets):
        of_set = [number for number, name in enumerate(sets) if name == each]
        medians = (
            statistics.median(timing.seconds[number] for number in of_set)
            for timing in timings.values()
        )
        report.note(f"{each}: {', '.join(f'{median * 1e3:.3g} ms' for median in medians)}")
    report.note(
        f"made once for each scene and not in these times: ours {statistics.median(made) * 1e3:.3g} ms"
    )


def _solve(
    space: ArmSpace, start: Floats, goals: Floats, seed: int, simplify: bool
) -> Floats | None:
    search = Search(iterations=1, simplify=simplify)
    options = {"seed": seed, "time_limit": ARM_SEARCH_SECONDS}
    try:
        return plan(space, start, goals, planner=search, **options).waypoints
    except ConfigurationError:  # the start or all goals are not proven free
        return None


def _shorten(report: Report, problems: list[ArmProblem], seed: int) -> None:
    """Compare the lengths of default plans with the best of two long searches, and the first path."""
    timing, ratios, first_ratios, certified = Timing(None), list[float](), list[float](), True
    for problem in problems:
        space = problem.space()
        goals = problem.goals[np.asarray(space.is_free(problem.goals))]
        if not (len(goals) and space.is_free(problem.start)) or space.motion_is_free(
            problem.start, goals[0]
        ):
            continue
        endpoints = problem.start, goals[0]
        if not timing.seconds:
            plan(space, *endpoints, planner=Search(iterations=2))  # compiles and loads
        short, first = (
            timing.take(partial(plan, space, *endpoints, seed=seed)),
            plan(
                space,
                *endpoints,
                seed=seed,
                planner=Search(simplify=False),
                time_limit=ARM_SEARCH_SECONDS,
            ),
        )
        if not (short and first):
            continue
        seconds, certified = 2.0 if report.quick else 20.0, certified and short.certified
        options: dict[str, Any] = {
            "planner": Search(iterations=REFERENCE_SEARCHES),
            "time_limit": seconds,
        }
        others = [plan(space, *endpoints, seed=seed + k, **options) for k in (1, 2)]
        best = min(short.length, *(other.length for other in others if other))
        ratios.append(short.length / best)
        first_ratios.append(first.length / best)
    if not ratios:
        return
    report.timing("plan, default time limit of 1 s", timing)
    for name, values in (("plan", ratios), ("its first path", first_ratios)):
        most = MAX_LENGTH_RATIO if values is ratios else None
        report.figure(
            f"{name}: length over best known, median", statistics.median(values), most=most
        )
        report.figure(
            f"{name}: length over best known, 95th percentile", float(np.quantile(values, 0.95))
        )
    report.check(certified, f"all {len(ratios)} plans that needed a search are proven")


def _judge(report: Report, problems: list[ArmProblem], rng: np.random.Generator) -> None:
    """Count colliding motions near starts and goals that each peer calls free."""
    count, free, colliding, lost = 0, Counter[str](), Counter[str](), 0
    for problem in problems:
        space, meshes, arm = problem.space(), problem.meshes(), problem.folder.arm
        checks: dict[str, Callable[[Floats, Floats], bool]] = {
            "ours": lambda a, b, space=space: bool(space.motion_is_free(a, b)),
            "OMPL, coal at its usual resolution": partial(check_discrete, meshes, arm),
        }
        if is_here("vamp"):
            checks["VAMP"] = Vamp(problem).motion_is_free
        endpoints = np.vstack([problem.start, problem.goals])
        for _ in range(MOTIONS_PER_PROBLEM):
            q0 = _near(endpoints[rng.integers(len(endpoints))], rng.choice([0.05, 0.2]), arm, rng)
            q1 = _near(q0, rng.choice([0.1, 0.3, 1.0]), arm, rng)
            count += 1
            answers = {name: check(q0, q1) for name, check in checks.items()}
            collides = meshes.first_collision(q0, q1, CLOSE_CHECK_STEP) is not None
            lost += not collides and not answers["ours"]
            for name, answer in answers.items():
                free[name] += answer
                colliding[name] += answer and collides
    report.note(f"{count} motions near starts and goals, tested every {CLOSE_CHECK_STEP:g} rad:")
    for name in free:
        share = f"{colliding[name] / max(free[name], 1):.1%}"
        claim = f"{name}: {free[name]} motions called free, of which {colliding[name]} collide ({share})"
        report.check(not colliding[name], claim) if name == "ours" else report.note(claim)
    report.note(f"ours proves {free['ours']} of {free['ours'] + lost} that do not collide")


def _near(q: Floats, size: float, arm: Arm, rng: np.random.Generator) -> Floats:
    return np.clip(q + rng.normal(scale=size, size=len(q)), arm.lower, arm.upper)
