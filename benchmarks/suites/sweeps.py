"""Cost of engines and fast peers over sizes of maps and robots."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
import shapely

import cspace
from benchmarks import inputs
from benchmarks.report import Report, is_here
from benchmarks.suites.outer_maps import METHODS, engine_label, ours, peers, shape_text
from benchmarks.timing import Timing, interleave
from cspace import Robot, Workspace
from cspace._engines import ENGINES, choose_engine
from cspace._support.arrays import Bools, Floats, Ints, States

Checker = Callable[[Floats, float], Bools]

SAMPLE = 4000
"""Number of cells sampled for collision checks, and of cells sampled beside another state."""

DENSITY = 0.06
"""Occupied share of a map."""

MEAN_BOX_SIDE, DENSITY_CHECKS = 52, 400
"""Mean side of a box, cells, and number of times the occupied share is computed."""

MAX_PEER_SECONDS = 20.0
"""Expected time above which a peer is skipped, seconds."""

SLOW_CALL_SECONDS = 3.0
"""Time above which a call is timed only once, seconds."""

RUNS = 3

MAX_EXPONENT = 1.1
"""Target: maximum exponent of cost over the number of cells, for a fixed robot."""

MAX_REGRET = 2.0
"""Target: maximum time of the chosen engine over that of the faster one."""

LARGEST_SIZES = 3
"""Number of largest sizes of the second fit of the exponent."""

ALL = "all sizes"

OVER_MAP, OVER_ROBOT = "over the map", "over the robot"


@dataclass(frozen=True)
class Sweep:
    """A sweep over sizes of maps or of robots.

    Attributes
    ----------
    name : str
    dim : int
    sizes : tuple of int
        Cells along each side of the map.
    robots : tuple of int
        Cells across discs or balls.
    """

    name: str
    dim: int
    sizes: tuple[int, ...]
    robots: tuple[int, ...]


SWEEPS = (
    Sweep(f"plane, {OVER_MAP}", 2, (256, 512, 1024, 2048, 4096, 8192), (65,)),
    Sweep(f"plane, {OVER_ROBOT}", 2, (2048,), (5, 9, 17, 33, 65, 129, 257, 401)),
    Sweep(f"space, {OVER_MAP}", 3, (64, 96, 128, 192, 256, 384, 512), (21,)),
    Sweep(f"space, {OVER_ROBOT}", 3, (192,), (5, 9, 13, 21, 33, 47, 65)),
)

QUICK_SWEEPS = (
    Sweep(f"plane, {OVER_MAP}", 2, (128, 256, 512), (33,)),
    Sweep(f"plane, {OVER_ROBOT}", 2, (256,), (5, 17, 65)),
    Sweep(f"space, {OVER_MAP}", 3, (32, 48, 64), (9,)),
    Sweep(f"space, {OVER_ROBOT}", 3, (48,), (5, 9, 13)),
)


def run(report: Report, rng: np.random.Generator) -> None:
    """Run all sweeps; report exponents and the choices of ``auto``."""
    for sweep in QUICK_SWEEPS if report.quick else SWEEPS:
        for name, (package, _, dims) in LIBRARIES.items():
            if sweep.dim in dims:
                report.has(package, f"{name} is left out")
        rates: dict[str, float] = {}
        medians: dict[str, dict[int, float]] = {}
        for size in sweep.sizes:
            # Draw few boxes at a time, so that small maps are as dense as large maps.
            each = max(1, (size // MEAN_BOX_SIDE) ** sweep.dim // DENSITY_CHECKS)
            workspace = Workspace.from_array(inputs.boxes(size, DENSITY, rng, sweep.dim, each), 1.0)
            for robot in sweep.robots:
                for way, timing in _point(report, sweep, workspace, robot, rates, rng).items():
                    medians.setdefault(way, {})[math.prod(workspace.grid.shape)] = timing.median
        if len(sweep.sizes) > 1:
            _exponents(report, sweep, medians)
    _choices(report)


def _point(
    report: Report,
    sweep: Sweep,
    workspace: Workspace,
    cells_across: int,
    rates: dict[str, float],
    rng: np.random.Generator,
) -> dict[str, Timing]:
    """Time all methods on a map, compare results, and report the choice.

    ``rates`` are the last seconds of each peer per unit of work.
    """
    occupied, radius = workspace.outer, cells_across / 2
    robot = Robot.disc(radius) if sweep.dim == 2 else Robot.ball(radius)
    raster = robot.shape.rasters(1.0)[0]
    report.section(
        f"{sweep.name}: {shape_text(occupied)} cells, {occupied.mean():.1%} occupied in boxes; "
        f"{'disc' if sweep.dim == 2 else 'ball'} {cells_across} cells across"
    )
    about = {"sweep": sweep.name, "dim": sweep.dim, "size": len(occupied), "across": cells_across}
    calls: dict[str, Callable[[], Bools]] = {
        engine_label(method): partial(ours, workspace, robot, method) for method in METHODS
    }
    work = {peer.name: peer.work(occupied.shape, raster) for peer in peers(sweep.dim)}
    expected = {name: rates.get(name, 0.0) * amount for name, amount in work.items()}
    calls |= {
        peer.name: peer.ready(occupied, raster)
        for peer in peers(sweep.dim)
        if expected[peer.name] <= MAX_PEER_SECONDS
    }
    timings = interleave(calls, RUNS, SLOW_CALL_SECONDS)
    for name, timing in timings.items():
        report.timing(name, timing)
        report.mark(**about, way=name)
    for name in work:
        if name in timings:
            rates[name] = timings[name].median / work[name]
        else:
            report.figure(f"{name}: left out, expected to take", expected[name], "s")
            report.mark(**about, way=name, left_out=True)
    # The direct engine shares no code with any other.
    others = [
        name
        for name, timing in timings.items()
        if not (timing.value == timings[engine_label("direct")].value).all()
    ]
    unequal = f"; different: {', '.join(others)}" if others else ""
    report.check(not others, f"{len(timings)} results are equal, cell for cell{unequal}")
    _sample(report, workspace, radius, about, rng)
    chosen = choose_engine([raster])
    engines = {method: timings[engine_label(method)].median for method in ENGINES}
    report.figure(
        f'"auto" took "{chosen}": its time / the quicker one\'s', _regret(chosen, engines)
    )
    report.mark(**about, chosen=chosen, taken=engines)
    return timings


def _exponents(report: Report, sweep: Sweep, medians: Mapping[str, Mapping[int, float]]) -> None:
    """Report logarithmic slopes of cost over the number of cells."""
    report.section(f"{sweep.name}: cost grows with the number of cells to the power of")
    for way, by_size in medians.items():
        for name, sizes in (
            (ALL, list(by_size)),
            (f"the largest {LARGEST_SIZES} sizes", list(by_size)[-LARGEST_SIZES:]),
        ):
            if len(sizes) < LARGEST_SIZES or (name != ALL and len(by_size) == LARGEST_SIZES):
                continue  # too few sizes, or the same sizes
            slope = float(
                np.polyfit(np.log(sizes), np.log([by_size[size] for size in sizes]), 1)[0]
            )
            report.figure(
                f"{way}, {name}", slope, "", most=MAX_EXPONENT if way.startswith("ours") else None
            )
            report.mark(sweep=sweep.name, exponent_of=way, over=name)


def _choices(report: Report) -> None:
    """Report the wrong choices of ``auto`` and their cost."""
    rows: list[dict[str, Any]] = [row for row in report.rows if "chosen" in row]
    slower = [row for row in rows if _regret(row["chosen"], row["taken"]) > 1.0]
    report.section(f'choices of "auto" at {len(rows)} sizes')
    for row in slower:
        report.note(
            f"{row['case']}: {row['chosen']} taken, {_regret(row['chosen'], row['taken']):.2f} x the other"
        )
    report.figure("times that it picked the slower engine", len(slower), f"of {len(rows)}")
    worst = max(_regret(row["chosen"], row["taken"]) for row in rows)
    report.figure("largest time of the engine picked / the quicker one's", worst, most=MAX_REGRET)


def _regret(chosen: str, seconds: Mapping[str, float]) -> float:
    """Return the time of the chosen engine over the least time."""
    return seconds[chosen] / min(seconds.values())


# ---- collision checks of one configuration at a time ---------------------------------------------


def _sample(
    report: Report,
    workspace: Workspace,
    radius: float,
    about: Mapping[str, Any],
    rng: np.random.Generator,
) -> None:
    """Time checkers on a sample of cells, and compare them with the map."""
    robot = Robot.disc(radius) if workspace.grid.dim == 2 else Robot.ball(radius)
    occupied = workspace.outer
    boxes = inputs.merge_cells(occupied.reshape(occupied.shape + (1,) * (3 - occupied.ndim)))
    ready = {
        name: make(boxes)
        for name, (package, make, dims) in LIBRARIES.items()
        if _is_used(package, dims, occupied)
    }
    if not ready:
        return
    state = cspace.build(workspace, robot, outside="free").cell_states
    cells = np.concatenate(
        [rng.integers(0, state.shape, (SAMPLE, state.ndim)), _beside_others(state, rng)]
    )
    q = cells + rng.random(cells.shape)
    expected = state[tuple(cells.T)]
    answers = {name: checker(q, radius) for name, checker in ready.items()}
    timings = interleave(
        {name: partial(checker, q[:SAMPLE], radius) for name, checker in ready.items()}, RUNS
    )
    for name, timing in timings.items():
        report.timing(
            f"{name}, extrapolated from {SAMPLE} cells", timing.per(SAMPLE / math.prod(state.shape))
        )
        report.mark(**about, way=name, extrapolated_from=SAMPLE)
    for name, hits in answers.items():
        wrong = int(
            ((expected == cspace.FREE) & hits).sum() + ((expected == cspace.BLOCKED) & ~hits).sum()
        )
        counts = f"{(expected == cspace.FREE).sum()} FREE and {(expected == cspace.BLOCKED).sum()} BLOCKED"
        report.check(
            not wrong, f"{name}: of {counts} cells, {wrong} are not so at a configuration in them"
        )


def _is_used(package: str, dims: tuple[int, ...], occupied: Bools) -> bool:
    return occupied.ndim in dims and is_here(package)


def _beside_others(state: States, rng: np.random.Generator) -> Ints:
    """Draw cells whose neighbour along the first axis has another state."""
    line = rng.integers(0, state.shape[1:], (64, state.ndim - 1))
    columns = np.stack([state[(slice(None), *place)] for place in line])
    number, first = np.nonzero(columns[:, 1:] != columns[:, :-1])
    cells = np.column_stack([first + rng.integers(0, 2, len(first)), line[number]])
    return np.asarray(cells[rng.permutation(len(cells))[:SAMPLE]])


def _shapely(boxes: Ints) -> Checker:
    tree = shapely.STRtree(
        shapely.box(boxes[:, 0, 0], boxes[:, 0, 1], boxes[:, 1, 0], boxes[:, 1, 1])
    )

    def check(q: Floats, radius: float) -> Bools:
        hit = np.zeros(len(q), dtype=np.bool_)
        hit[tree.query(shapely.points(q), predicate="dwithin", distance=radius)[0]] = True
        return hit

    return check


def _tree(package: str, boxes: Ints) -> Checker:
    """Return a checker of FCL or coal, whose trees have one interface."""
    library = import_module(package)
    transform = library.Transform if package == "fcl" else partial(library.Transform3s, np.eye(3))
    tree, sizes = (
        library.DynamicAABBTreeCollisionManager(),
        (boxes[:, 1] - boxes[:, 0]).astype(np.float64),
    )
    pairs = zip(sizes, boxes.mean(axis=1), strict=True)
    obstacles = [
        library.CollisionObject(library.Box(*size), transform(middle)) for size, middle in pairs
    ]
    for each in obstacles:
        tree.registerObject(each)
    tree.setup()

    def check(
        q: Floats, radius: float, kept: Any = obstacles
    ) -> Bools:  # coal's tree keeps no references to its objects
        ball, hit = (
            library.CollisionObject(library.Sphere(radius)),
            np.empty(len(q), dtype=np.bool_),
        )
        for number, position in enumerate(q):
            ball.setTranslation(position)
            if package == "fcl":
                answer = library.CollisionData()
                tree.collide(ball, answer, library.defaultCollisionCallback)
                hit[number] = answer.result.is_collision
            else:
                ball.computeAABB()
                answer = library.CollisionCallBackDefault()
                tree.collide(ball, answer)
                hit[number] = answer.data.result.isCollision()
        return hit

    return check


LIBRARIES: dict[str, tuple[str, Callable[[Ints], Checker], tuple[int, ...]]] = {
    "shapely": ("shapely", _shapely, (2,)),
    "FCL": ("fcl", partial(_tree, "fcl"), (3,)),
    "coal": ("coal", partial(_tree, "coal"), (3,)),
}
"""Package, checker and dimensions of each library."""
