"""Cost over the size of the map, and over that of the robot: every engine and every peer that is not too slow."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites import samples
from benchmarks.suites.outer_maps import METHODS, Peer, across, named, ours, peers
from benchmarks.timing import Timing, interleave
from cspace import Robot, Workspace
from cspace.arrays import Bools
from cspace.engines import ENGINES, choose
from cspace.raster import Raster

DENSITY = 0.06
"""Share of a map that boxes take up."""

BOX, LOOKS = 52, 400
"""Cells along the sides of a box, in the mean, and how often a map full of them would be looked at for its share."""

LONGEST = 20.0
"""Seconds; a peer that is expected to take longer is left out."""

SLOW = 3.0
"""Seconds; what takes longer is timed once."""

RUNS = 3

STEEPEST = 1.1
"""Target of the exponent of cost over the number of cells, at a fixed robot."""

MOST_REGRET = 2.0
"""Target of how many times longer the engine that is picked takes than the quicker one."""

LAST = 3
"""Sizes, the largest ones, for which the exponent is fitted once more."""

ALL = "all sizes"

OVER_MAP, OVER_ROBOT = "over the map", "over the robot"


@dataclass(frozen=True)
class Sweep:
    """Maps and robots of which either the maps or the robots grow.

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

QUICK = (
    Sweep(f"plane, {OVER_MAP}", 2, (128, 256, 512), (33,)),
    Sweep(f"plane, {OVER_ROBOT}", 2, (256,), (5, 17, 65)),
    Sweep(f"space, {OVER_MAP}", 3, (32, 48, 64), (9,)),
    Sweep(f"space, {OVER_ROBOT}", 3, (48,), (5, 9, 13)),
)


def run(report: Report, rng: np.random.Generator) -> None:
    """Go through all sweeps, then report exponents, and the choices of ``auto``."""
    for sweep in QUICK if report.quick else SWEEPS:
        for name, (package, _, dims) in samples.LIBRARIES.items():
            if sweep.dim in dims:
                report.has(package, f"{name} is left out")
        known: dict[str, _Known] = {}
        medians: dict[str, dict[int, float]] = {}
        for size in sweep.sizes:
            # Few enough boxes at a time that small maps are no fuller than large ones.
            each = max(1, (size // BOX) ** sweep.dim // LOOKS)
            workspace = Workspace.from_array(inputs.boxes(size, DENSITY, rng, sweep.dim, each), 1.0)
            for robot in sweep.robots:
                for way, timing in _point(report, sweep, workspace, robot, known, rng).items():
                    medians.setdefault(way, {})[math.prod(workspace.grid.shape)] = timing.median
        if len(sweep.sizes) > 1:
            _exponents(report, sweep, medians)
    _choices(report)


@dataclass
class _Known:
    """What a method took last, and the work that it had then."""

    seconds: float
    work: float


@dataclass
class _Point:
    """The calls of one map and one robot, and the peers that are left out."""

    calls: dict[str, Callable[[], Bools]] = field(default_factory=dict)
    left_out: dict[str, float] = field(default_factory=dict)

    def add(self, way: Peer, occupied: Bools, raster: Raster, known: Mapping[str, _Known]) -> None:
        """A peer, or what it is expected to take where that is too long."""
        before = known.get(way.name)
        expected = before.seconds * way.work(occupied.shape, raster) / before.work if before else 0.0
        if expected > LONGEST:
            self.left_out[way.name] = expected
        else:
            self.calls[way.name] = way.ready(occupied, raster)


def _point(
    report: Report,
    sweep: Sweep,
    workspace: Workspace,
    cells_across: int,
    known: dict[str, _Known],
    rng: np.random.Generator,
) -> dict[str, Timing]:
    """Time all methods on one map, compare their results, and report what was chosen."""
    occupied, radius = workspace.outer, cells_across / 2
    robot = Robot.disc(radius) if sweep.dim == 2 else Robot.ball(radius)
    raster = robot.rasters(1.0)[0]
    report.section(
        f"{sweep.name}: {across(occupied)} cells, {occupied.mean():.1%} occupied in boxes; "
        f"{'disc' if sweep.dim == 2 else 'ball'} {cells_across} cells across"
    )
    about = {"sweep": sweep.name, "dim": sweep.dim, "size": len(occupied), "across": cells_across}
    point = _Point({named(method): partial(ours, workspace, robot, method) for method in METHODS})
    for way in peers(sweep.dim):
        point.add(way, occupied, raster, known)
    timings = interleave(point.calls, RUNS, SLOW)
    for name, timing in timings.items():
        report.timing(name, timing)
        report.mark(**about, way=name)
    for name, expected in point.left_out.items():
        report.figure(f"{name}: left out, expected to take", expected, "s")
        report.mark(**about, way=name, left_out=True)
    for way in peers(sweep.dim):
        if way.name in timings:
            known[way.name] = _Known(timings[way.name].median, way.work(occupied.shape, raster))
    _check(report, {name: timing.value for name, timing in timings.items()})
    samples.run(report, workspace, radius, about, rng)
    chosen = choose([raster])
    engines = {method: timings[named(method)].median for method in ENGINES}
    report.figure(f'"auto" took "{chosen}": its time / the quicker one\'s', _regret(chosen, engines))
    report.mark(**about, chosen=chosen, taken=engines)
    return timings


def _check(report: Report, results: Mapping[str, Bools]) -> None:
    """All results equal, cell for cell, to the direct engine's, which shares no code with any other."""
    wanted = results[named("direct")]
    others = [name for name, result in results.items() if not (result == wanted).all()]
    unequal = f"; not so: {', '.join(others)}" if others else ""
    report.check(not others, f"{len(results)} results are equal, cell for cell{unequal}")


def _exponents(report: Report, sweep: Sweep, medians: Mapping[str, Mapping[int, float]]) -> None:
    """Slopes of cost over the number of cells, both in logarithms."""
    report.section(f"{sweep.name}: cost grows with the number of cells to the power of")
    for way, by_size in medians.items():
        for name, sizes in ((ALL, list(by_size)), (f"the largest {LAST} sizes", list(by_size)[-LAST:])):
            if len(sizes) < LAST or (name != ALL and len(by_size) == LAST):
                continue  # too few, or the same ones again
            slope = float(np.polyfit(np.log(sizes), np.log([by_size[size] for size in sizes]), 1)[0])
            report.figure(f"{way}, {name}", slope, "", most=STEEPEST if way.startswith("ours") else None)
            report.mark(sweep=sweep.name, exponent_of=way, over=name)


def _choices(report: Report) -> None:
    """How often ``auto`` picked the slower engine, and what that cost."""
    rows: list[dict[str, Any]] = [row for row in report.rows if "chosen" in row]
    slower = [row for row in rows if _regret(row["chosen"], row["taken"]) > 1.0]
    report.section(f'choices of "auto" at {len(rows)} sizes')
    for row in slower:
        report.note(f"{row['case']}: {row['chosen']} taken, {_regret(row['chosen'], row['taken']):.2f} x the other")
    report.figure("times that it picked the slower engine", len(slower), f"of {len(rows)}")
    worst = max(_regret(row["chosen"], row["taken"]) for row in rows)
    report.figure("largest time of the engine picked / the quicker one's", worst, most=MOST_REGRET)


def _regret(chosen: str, seconds: Mapping[str, float]) -> float:
    """Time of the engine that was picked over that of the quicker one."""
    return seconds[chosen] / min(seconds.values())
