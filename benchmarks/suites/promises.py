"""What is promised against peers: one comparison for each line, all of them with targets."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.outer_maps import across, convolved, named, ours, peers
from benchmarks.suites.stamping import border_cells, stamp
from benchmarks.timing import interleave, memory_rise
from cspace import Robot, Workspace
from cspace.arrays import Bools
from cspace.engines import ENGINES
from cspace.raster import Raster
from cspace.rotations import Rotations
from cspace.threads import cores

Goals = Mapping[str, Mapping[str, float]]

SIZES = {"plane": 4096, "turning": 1024, "space": 256}
QUICK = {"plane": 512, "turning": 192, "space": 64}
"""Cells along each side, for which the targets are meant, and with ``--quick``."""

DISC, LARGE, BALL = 65, 401, 21
"""Cells that robots are across."""

ROTATIONS, LENGTH, WIDTH = 72, 33, 21
"""Yaw cells, and cells that the robot which turns is long and wide."""

REAL = {"maps/depot.yaml": (18, 12), "maps/100by100_10.yaml": (18, 12), "movingai/Berlin_1_1024.map": (LENGTH, WIDTH)}
"""Real maps, and how long and wide the robot is there, in cells; on the first two 0.9 m x 0.6 m."""

LARGE_MAP, LARGE_BALL = 512, 33
"""Cells along each side of the map whose memory is measured, and cells that its robot is across."""

RUNS, QUICK_RUNS = 5, 2
SLOW = 6.0
"""Seconds; a peer that takes longer is timed once."""

IN_PLANE: Goals = {"fft": {"fftconvolve float64": 6.0}, "auto": {"fftconvolve float64": 20.0}}
NOT_CONVEX: Goals = {"fft": {"cv2.dilate": 20.0, "fftconvolve float64": 6.0}, "auto": {}}
TURNING = {"fft": 15.0, "auto": 60.0}
IN_SPACE: Goals = {
    "fft": {"fftconvolve float64": 4.0, "ndimage.binary_dilation": 300.0},
    "auto": {"fftconvolve float64": 12.0},
}
STAMPING, STAMPING_MEDIAN = 1.0, 2.0
"""How many times slower than ours, by engine, each peer should be with its defaults."""

FLOOR = 1.3
"""How many times longer our transforms may take than the two that one convolution of the whole cannot do without."""

MOST_MEMORY = 8.0
"""GiB, for the large map with both sides of the certificate."""


def run(report: Report, rng: np.random.Generator) -> None:
    """Make every comparison; targets are held against full sizes only."""
    sizes = QUICK if report.quick else SIZES
    # First, while the process is small: what others have given back could hide what is taken here.
    _memory(report, 128 if report.quick else LARGE_MAP, rng)
    boxes = Workspace.from_array(inputs.boxes(sizes["plane"], 0.06, rng), 1.0)
    _translating(report, boxes, Robot.disc(DISC / 2), f"disc {DISC} cells across", IN_PLANE)
    _translating(report, boxes, horseshoe(LARGE), f"horseshoe {LARGE} cells across, not convex", NOT_CONVEX)
    solid = Workspace.from_array(inputs.boxes(sizes["space"], 0.06, rng, dim=3), 1.0)
    _translating(report, solid, Robot.ball(BALL / 2), f"ball {BALL} cells across", IN_SPACE)
    for workspace, robot in ((boxes, Robot.disc(DISC / 2)), (solid, Robot.ball(BALL / 2))):
        _floor(report, workspace, robot)
    _turning(report, inputs.boxes(sizes["turning"], 0.06, rng))
    _stamping(report)


def horseshoe(across: int) -> Robot:
    """Five sixths of a ring; nothing of it lies at its reference point, and it is far from convex."""
    turns = np.linspace(np.pi / 6.0, 11.0 * np.pi / 6.0, 120)
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    radius = across / 2 - 1.0  # what a robot touches reaches up to a cell further
    return Robot.polygon(np.concatenate([radius * circle, 0.65 * radius * circle[::-1]]))


def asymmetric(length: float = LENGTH, width: float = WIDTH) -> Robot:
    """A rectangle with a small piece cut off one corner: no turn maps it to itself."""
    a, b, cut = length / 2, width / 2, min(length, width) / 20
    return Robot.polygon([(-a, -b), (a, -b), (a, b - cut), (a - cut, b), (-a, b)])


def rasters_of(robot: Robot, spacing: float, rotations: int) -> list[Raster]:
    """Outer raster of each yaw cell."""
    return [robot.rasters(spacing, turn=turn)[0] for turn in Rotations.of(rotations).turns(2)]


def _memory(report: Report, size: int, rng: np.random.Generator) -> None:
    """Peak memory of a large map in space, both sides of the certificate, workspace included."""
    occupied, robot = inputs.boxes(size, 0.06, rng, dim=3), Robot.ball(LARGE_BALL / 2)
    report.section(f"{across(occupied)} cells, ball {LARGE_BALL} cells across, outer and inner map")
    for method in ENGINES:
        rise = memory_rise(
            lambda method=method: cspace.build(Workspace.from_array(occupied, 1.0), robot, method=method)
        )
        report.figure(f"{named(method)}: peak memory, above what there was", rise / 2**30, "GiB", most=MOST_MEMORY)


def _floor(report: Report, workspace: Workspace, robot: Robot) -> None:
    """Our transforms against the two that a convolution of the whole map cannot do without, by as many workers."""
    from scipy import fft

    occupied, raster = workspace.outer, robot.rasters(1.0)[0]
    pairs = zip(occupied.shape, raster.cells.shape, strict=True)
    whole = np.zeros([fft.next_fast_len(n + r - 1, real=True) for n, r in pairs], np.float32)
    whole[tuple(slice(n) for n in occupied.shape)] = occupied
    report.section(f"{across(occupied)} cells against bare float32 transforms of {across(whole)}")

    def bare(workers: int) -> NDArray[np.float32]:
        back: NDArray[np.float32] = fft.irfftn(fft.rfftn(whole, workers=workers), s=whole.shape, workers=workers)
        return back

    def correlated(workers: int) -> Bools:
        hits = np.empty(occupied.shape, np.bool_)
        ENGINES["fft"].collide(occupied, [raster], [hits], outside=False, workers=workers)
        return hits

    calls: dict[str, Callable[[], Any]] = {}
    for workers in sorted({1, min(2, cores())}):
        calls |= {f"ours, {workers}": partial(correlated, workers), f"bare, {workers}": partial(bare, workers)}
    timings = interleave(calls, _runs(report))
    for workers in sorted({1, min(2, cores())}):
        name = f"our transforms / two bare ones, workers each: {workers}"
        report.ratio(name, timings[f"ours, {workers}"], timings[f"bare, {workers}"], most=FLOOR)


def _translating(report: Report, workspace: Workspace, robot: Robot, name: str, goals: Goals) -> None:
    """Engines, from the robot's shape on, against peers that are given the robot's cells."""
    occupied = workspace.outer
    raster = robot.rasters(workspace.grid.spacing)[0]
    report.section(f"{across(occupied)} cells, {occupied.mean():.1%} occupied in boxes; {name}")
    report.note(f"the robot's outer raster has {across(raster.cells)} cells, {raster.count} of them the robot's")
    asked = {peer for of_engine in goals.values() for peer in of_engine}
    chosen = {way.name: way for way in peers(occupied.ndim) if way.name in asked}
    calls: dict[str, Callable[[], Bools]] = {named(method): partial(ours, workspace, robot, method) for method in goals}
    calls |= {peer: way.ready(occupied, raster) for peer, way in chosen.items()}
    timings = interleave(calls, _runs(report), SLOW)
    for call, timing in timings.items():
        report.timing(call, timing)
    for method, of_engine in goals.items():
        for peer in chosen:
            report.ratio(f"{peer} / {named(method)}", timings[peer], timings[named(method)], least=of_engine.get(peer))
    wanted = timings["fftconvolve float64"].value
    for call in timings:
        report.check(bool((timings[call].value == wanted).all()), f"{call}: equal to fftconvolve, cell for cell")


def _turning(report: Report, occupied: Bools) -> None:
    """A robot that turns: engines, from its shape on, against convolutions with the bitmap of each yaw, ready-made."""
    from scipy import signal

    rotations = 12 if report.quick else ROTATIONS
    workspace, robot = Workspace.from_array(occupied, 1.0), asymmetric()
    rasters = rasters_of(robot, 1.0, rotations)
    floats, kernels = occupied.astype(np.float64), [np.flip(raster.cells).astype(np.float64) for raster in rasters]
    report.section(
        f"{across(occupied)} cells x {rotations} yaw cells, {occupied.mean():.1%} occupied in boxes; robot {LENGTH} x "
        f"{WIDTH} cells without symmetry"
    )

    def convolutions() -> list[Bools]:
        pairs = zip(kernels, rasters, strict=True)
        return [convolved(signal.fftconvolve, floats, kernel, raster) for kernel, raster in pairs]

    peer = "loop of fftconvolve float64"
    options: dict[str, Any] = {"rotations": rotations, "outside": "free", "inner": False}
    calls: dict[str, Callable[[], Any]] = {peer: convolutions}
    for method in TURNING:
        calls[named(method)] = partial(cspace.build, workspace, robot, method=method, **options)
    timings = interleave(calls, _runs(report))
    for call, timing in timings.items():
        report.timing(call, timing)
    for method, least in TURNING.items():
        ratio = f"{peer} / {named(method)}"
        report.ratio(ratio, timings[peer], timings[named(method)], least=least)
        _check_slices(report, named(method), timings[named(method)].value, timings[peer].value)


def _stamping(report: Report) -> None:
    """Real maps, and a robot that turns, against stamping from the obstacles' borders."""
    peer, slower = "stamping, compiled", []
    # Small enough for --quick as they are.
    rotations = 12 if report.quick else ROTATIONS
    for name, (length, width) in REAL.items():
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(inputs.NO_DATA)
            return
        spacing = workspace.grid.spacing
        robot = asymmetric(length * spacing, width * spacing)
        rasters = rasters_of(robot, spacing, rotations)
        border = len(border_cells(workspace.outer))
        report.section(
            f"{name}, {across(workspace.outer)} cells x {rotations} yaw cells; robot {length} x {width} cells"
        )
        report.note(f"{border} obstacle cells on a border; the peer is given the outer rasters, and {cores()} workers")
        options: dict[str, Any] = {"rotations": rotations, "outside": "free", "inner": False}
        timings = interleave(
            {
                named("auto"): partial(cspace.build, workspace, robot, method="auto", **options),
                peer: partial(stamp, workspace.outer, rasters),
            },
            3 * _runs(report),
        )
        for call, timing in timings.items():
            report.timing(call, timing)
        report.ratio(f"{peer} / {named('auto')}", timings[peer], timings[named("auto")], least=STAMPING)
        slower.append(timings[peer].median / timings[named("auto")].median)
        _check_slices(report, named("auto"), timings[named("auto")].value, timings[peer].value)
    report.section(f"{len(slower)} real maps x {rotations} yaw cells")
    report.figure(f"{peer} / {named('auto')}, median", statistics.median(slower), least=STAMPING_MEDIAN)


def _check_slices(report: Report, call: str, space: cspace.CSpace, wanted: list[Bools]) -> None:
    state = space.state != cspace.FREE
    equal = all((states == hits).all() for states, hits in zip(state, wanted, strict=True))
    report.check(equal, f"{call}: equal to the peer, cell for cell")


def _runs(report: Report) -> int:
    return QUICK_RUNS if report.quick else RUNS
