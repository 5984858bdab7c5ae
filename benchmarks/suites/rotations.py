"""Rotating robots in space: builds, look-ups, edges and plans, against FCL."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy import signal

import cspace
import planners
from benchmarks.report import Report
from benchmarks.suites import planning, solid_scenes
from benchmarks.suites.lookups import edges_of, query_all, states_of
from benchmarks.suites.outer_maps import convolve_map
from benchmarks.suites.solid_scenes import FCL_CONFIGURATIONS, Fcl, Scene
from benchmarks.timing import Timing, interleave, one_core
from cspace import BLOCKED, FREE, CSpace
from cspace._engines.slices import slice_rasters
from cspace._support.arrays import Floats

CONVOLVED_SLICES = 6
"""Number of slices convolve_map by SciPy."""

CONTAINMENT_TESTS = 500
"""Number of configurations also tested for containment."""

EDGE_CELLS, MAX_ROTATION = 10.0, 0.3
"""Length of edges, cells, and largest rotation about an axis, radians."""

SEARCH_BUDGET_SECONDS = 60.0
"""Seconds of search in a scene after which a planner stops."""


def run(report: Report, seed: int) -> None:
    """Run all scenes."""
    rng = np.random.default_rng(seed)
    quick = report.quick
    table = solid_scenes.rooms(quick)
    for scene in (table, solid_scenes.trap(quick), *solid_scenes.tunnels(report)):
        for cuts in scene.cuts:
            space, built = _build(report, scene, cuts, rng)
            fcl = _fcl(report, space, scene, rng)
            _against_queries(report, space, built, fcl)
            if scene is table and cuts == scene.cuts[-1]:
                _look_ups(report, space, fcl, rng)
            if cuts == scene.cuts[0] and scene.seeds and not quick:
                _plan(report, space, scene, built, fcl)
    for drone in solid_scenes.building(report, rng, 1 if quick else 3, True, "occupied"):
        space, built = _build(report, drone, 0, rng)
        _against_maps(report, drone, built)
        fcl = _fcl(report, space, drone, rng)
        _against_queries(report, space, built, fcl)
        _look_ups(report, space, fcl, rng)
        _plan(report, space, drone, built, fcl, least=1.0)


# ---- the map -------------------------------------------------------------------------------------


def _build(
    report: Report, scene: Scene, cuts: int, rng: np.random.Generator
) -> tuple[CSpace, Timing]:
    """Build a map, compare it with a loop of convolutions, and return its timing."""
    rotations, grid = scene.rotations(cuts), scene.workspace.grid
    slice_of = rotations._assign_slices(scene.robot.shape)
    number = int(slice_of.max()) + 1
    states = number * grid.size
    name = f"quaternions({cuts})" if cuts else "72 yaw cells"
    report.section(
        f"{scene.name}: {' x '.join(map(str, grid.shape))} cells of {grid.spacing:g} m x {len(rotations)} rotation "
        f"cells, {name}, {number} slices"
    )
    build = partial(cspace.build, scene.workspace, scene.robot, rotations=rotations)
    calls: dict[str, Callable[[], Any]] = {
        "ours": build,
        "ours, outer alone": partial(build, inner=False, outside="free"),
    }
    timings = interleave(calls, 1 if report.quick else 3, slow=5.0)
    space: CSpace = timings["ours"].value
    free, mixed, blocked = np.array(space.count()) / sum(space.count())
    report.timing(f"build of {states:.3g} states", timings["ours"])
    report.figure("the same, of CPU, a state", 1e9 * timings["ours"].median_cpu / states, "ns")
    report.timing("build, outer alone", timings["ours, outer alone"])
    report.note(f"{free:.1%} FREE, {mixed:.1%} MIXED, {blocked:.1%} BLOCKED")

    occupied, loop = scene.workspace.outer.astype(np.float64), Timing(None)
    chosen, equal = (
        rng.choice(len(rotations), min(CONVOLVED_SLICES, len(rotations)), replace=False),
        True,
    )
    outer: CSpace = timings["ours, outer alone"].value
    rasters = slice_rasters(outer.robot, outer.grid.spacing, outer.margin, rotations)
    for cell in chosen.tolist():
        # Use the bitmap of the map, because a new bitmap may be a cell tighter or looser; both are
        # bounds.
        raster = rasters[slice_of[cell]][0]
        kernel = np.flip(raster.cells).astype(np.float64)
        met = loop.take(partial(convolve_map, signal.fftconvolve, occupied, kernel, raster))
        ours = outer.states_at(rotations.centers[cell]) != FREE
        equal &= bool((ours == met).all())
    report.check(equal, f"{len(chosen)} slices: equal to fftconvolve's")
    all_of = loop.per(1.0 / number)
    report.timing(
        f"a loop of fftconvolve over ready bitmaps, extrapolated from {len(chosen)} slices", all_of
    )
    report.ratio("loop of fftconvolve / ours, outer alone", all_of, timings["ours, outer alone"])
    return space, timings["ours"]


def _against_maps(report: Report, scene: Scene, built: Timing) -> None:
    """Compare with 18 maps of a robot without rotations."""
    still = interleave({"R^3": partial(cspace.build, scene.workspace, scene.robot)}, 3)["R^3"].per(
        1.0 / 18
    )
    report.timing("18 maps of R^3", still)
    report.ratio("72 yaw cells / 18 maps of R^3", built, still, most=2.0)


def _fcl(report: Report, space: CSpace, scene: Scene, rng: np.random.Generator) -> Fcl:
    """Compare the map with FCL; return FCL as a peer."""
    q = _random(space, FCL_CONFIGURATIONS, rng)
    fcl = Fcl(report, scene, q)
    states, few = space.classify(q), q[:CONTAINMENT_TESTS]
    free, blocked = q[states == FREE], few[states[:CONTAINMENT_TESTS] == BLOCKED]
    wrong = sum(fcl.meets(each) for each in free)
    report.check(not wrong, f"{wrong} of {len(free)} FREE configurations collide by FCL")
    wrong = sum(not fcl.collides(each) for each in blocked)
    report.check(
        not wrong,
        f"{wrong} of {len(blocked)} BLOCKED configurations do not collide by FCL and insides",
    )
    mixed = few[states[:CONTAINMENT_TESTS] == cspace.MIXED]
    exact = space.exact.is_free(mixed) if len(mixed) else np.zeros(0, dtype=np.bool_)
    wrong = sum(bool(ours) and fcl.meets(each) for ours, each in zip(exact, mixed, strict=True))
    report.check(
        not wrong,
        f"{wrong} of {exact.sum()} MIXED configurations that are exactly free collide by FCL",
    )
    return fcl


def _against_queries(report: Report, space: CSpace, built: Timing, fcl: Fcl) -> None:
    """Compare CPU time with an FCL query for each stored state."""
    cells = float(space.grid.size * (len(space.slice_rotations)))
    report.figure(
        f"one FCL query for each of {cells:.3g} states, extrapolated from {FCL_CONFIGURATIONS}",
        fcl.seconds * cells,
        "s",
    )
    report.figure(
        "one FCL query a state / ours, in CPU time", fcl.seconds * cells / built.median_cpu
    )


# ---- look-ups and edges --------------------------------------------------------------------------


def _look_ups(report: Report, space: CSpace, fcl: Fcl, rng: np.random.Generator) -> None:
    """Compare look-ups and edges, in batches and through OMPL."""
    number, runs = (10**5, 3) if report.quick else (10**6, 7)
    q = _random(space, number, rng)
    with one_core():
        timing = interleave({"batch": partial(space.is_free, q)}, runs)["batch"].per(number)
    report.timing("is_free in a batch on one core, one look-up", timing)
    report.figure("  the same, of CPU", 1e9 * timing.median_cpu, "ns", most=100.0)

    few = q[:1000]
    starts, goals = _edges(space, rng, 1000)
    space_informations = {
        "ours": planners.simple_setup(space).getSpaceInformation(),
        "ours, exact": planners.simple_setup(space.exact).getSpaceInformation(),
        "FCL": planning.peer_setup(space, fcl.is_free)().getSpaceInformation(),
    }
    checker = planners.StateValidityChecker(space_informations["ours"], space)
    states = states_of(space, space_informations["ours"], few)
    callback = interleave({"callback": query_all(checker.isValid, states)}, runs)["callback"].per(
        1000
    )
    report.timing("isValid of our checker, as OMPL calls it", callback)
    report.figure("  the same, of CPU", 1e6 * callback.median_cpu, "us", most=0.6)
    asks: dict[str, Callable[[], list[bool]]] = {}
    walks: dict[str, Callable[[], list[bool]]] = {}
    for name, si in space_informations.items():
        si.setup()
        asks[name] = query_all(si.isValid, states_of(space, si, few))
        walks[name] = query_all(si.checkMotion, edges_of(space, si, starts, goals))
    points, edges = interleave(asks, runs), interleave(walks, runs)
    for what, timings, target in (("si.isValid", points, None), ("si.checkMotion", edges, 20.0)):
        for name, timing in timings.items():
            each = timing.per(1000)
            report.timing(f"{what}, {name}, one call", each)
            most = target if name == "ours" else None
            report.figure("  the same, of CPU", 1e6 * each.median_cpu, "us", most=most)
        for name in ("ours", "ours, exact"):
            report.ratio(f"{what}: FCL / {name}", timings["FCL"], timings[name])
    answers = {name: np.array(timing.value) for name, timing in points.items()}
    report.check(
        bool((answers["ours"] == space.is_free(few)).all()), "isValid: equal to CSpace.is_free"
    )
    report.check(
        not (answers["ours, exact"] & ~answers["FCL"]).any(),
        "isValid: FCL refuses none that is exactly free",
    )
    walked = {name: np.array(timing.value) for name, timing in edges.items()}
    report.check(
        bool((walked["ours"] == space.motion_is_free(starts, goals)).all()),
        "checkMotion: equal to CSpace's",
    )
    report.check(
        not (walked["ours, exact"] & ~walked["FCL"]).any(),
        "checkMotion: FCL refuses none that is proven",
    )
    shares = ", ".join(f"{name} {answer.mean():.0%}" for name, answer in walked.items())
    report.note(f"edges that are free: {shares}; FCL looks at steps of half a cell")


def _random(space: CSpace, number: int, rng: np.random.Generator) -> Floats:
    """Draw uniform configurations in the grid."""
    places = rng.uniform(space.grid.lower, space.grid.upper, (number, 3))
    if len(space.rotations.names) == 1:
        return np.column_stack([places, rng.uniform(-np.pi, np.pi, number)])
    turns = rng.normal(size=(number, 4))
    return np.column_stack([places, turns / np.linalg.norm(turns, axis=1, keepdims=True)])


def _edges(space: CSpace, rng: np.random.Generator, number: int) -> tuple[Floats, Floats]:
    """Draw edges from FREE configurations."""
    starts, direction = space.sample_free(number, rng), rng.normal(size=(number, 3))
    goals = starts.copy()
    goals[:, :3] += (
        EDGE_CELLS
        * space.grid.spacing
        * direction
        / np.linalg.norm(direction, axis=1, keepdims=True)
    )
    goals[:, :3] = np.clip(goals[:, :3], space.grid.lower, space.grid.upper)
    goals[:, 3:] += rng.uniform(-MAX_ROTATION, MAX_ROTATION, goals[:, 3:].shape) / (
        2.0 if len(space.rotations.names) == 4 else 1.0
    )
    if len(space.rotations.names) == 4:
        goals[:, 3:] /= np.linalg.norm(goals[:, 3:], axis=1, keepdims=True)
    return starts, goals


# ---- plans ---------------------------------------------------------------------------------------


def _plan(
    report: Report, space: CSpace, scene: Scene, built: Timing, fcl: Fcl, least: float | None = None
) -> None:
    """Compare first solutions with those of FCL."""
    exact = bool(scene.cuts[0])
    label = ", exact" if exact else ""
    ours: dict[str, planning.Solver] = {
        f"ours, planners.plan{label}": partial(
            planning.solve_by_plan, (space.exact if exact else space), "RRTConnect"
        ),
        f"ours, simple_setup and RRTConnect{label}": partial(
            planning.solve, space, lambda: planners.simple_setup(space.exact if exact else space)
        ),
    }
    queries = scene.queries(space)
    planning.compare(
        report,
        space,
        built,
        fcl.peer(),
        ours,
        queries,
        scene.seeds,
        SEARCH_BUDGET_SECONDS,
        least_with_build=least,
    )
