"""Engines against peers: targets, memory and cost over sizes."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites import sweeps
from benchmarks.suites.outer_maps import (
    METHODS,
    border_cells,
    convolve_map,
    engine_label,
    ours,
    peers,
    shape_text,
    stamp,
)
from benchmarks.timing import Timing, interleave, memory_rise
from cspace import Robot, Workspace
from cspace._engines import ENGINES
from cspace._raster import Raster
from cspace._rotations import Rotations
from cspace._support.arrays import Bools
from cspace._support.threads import count_cores

Goals = Mapping[str, Mapping[str, float]]

FULL_SIZES = {"plane": 4096, "turning": 1024, "space": 256}
QUICK_SIZES = {"plane": 512, "turning": 192, "space": 64}
"""Cells along each side: full sizes, to which the targets apply, and sizes of ``--quick``."""

DISC, LARGE, BALL = 65, 401, 21
"""Diameters of robots, cells."""

ROTATIONS, LENGTH, WIDTH = 72, 33, 21
"""Number of yaw cells, and length and width of the rotating robot, cells."""

REAL_MAP_ROBOTS = {
    "maps/depot.yaml": (18, 12),
    "maps/100by100_10.yaml": (18, 12),
    "movingai/Berlin_1_1024.map": (LENGTH, WIDTH),
}
"""Length and width of the robot on each real map, cells; 0.9 m x 0.6 m on the first two."""

LARGE_MAP, LARGE_BALL = 512, 33
"""Side of the map whose memory is measured, and diameter of its robot, cells."""

SLOW_PEER_SECONDS = 6.0
"""Time above which a peer is timed only once, seconds."""

IN_PLANE: Goals = {"fft": {"fftconvolve float64": 2.0}, "auto": {"fftconvolve float64": 20.0}}
NOT_CONVEX: Goals = {"fft": {"cv2.dilate": 10.0, "fftconvolve float64": 1.0}, "auto": {}}
TURNING = {"fft": 4.0, "auto": 60.0}
IN_SPACE: Goals = {
    "fft": {"fftconvolve float64": 2.0, "ndimage.binary_dilation": 100.0},
    "auto": {"fftconvolve float64": 12.0},
}
STAMPING, STAMPING_MEDIAN = 1.0, 2.0
"""Targets: time of each peer, with its defaults, over that of our engines."""

MAX_TRANSFORM_RATIO = 1.3
"""Target: maximum time of our transforms over two transforms of the whole map."""

MAX_MEMORY_GIB = 8.0
"""Target: maximum memory of the large map with both sides of the certificate, GiB."""


def run(report: Report, seed: int) -> None:
    """Run every comparison; results must be equal."""
    rng, sizes = np.random.default_rng(seed), QUICK_SIZES if report.quick else FULL_SIZES
    report.has("cv2", "OpenCV's functions are left out")
    _warm_up(rng)
    # Measure memory first, because memory freed earlier could hide a rise.
    _memory(report, 128 if report.quick else LARGE_MAP, rng)
    boxes = Workspace.from_array(inputs.boxes(sizes["plane"], 0.06, rng), 1.0)
    _translating(report, boxes, Robot.disc(DISC / 2), f"disc {DISC} cells across", IN_PLANE)
    _translating(
        report, boxes, _horseshoe(LARGE), f"horseshoe {LARGE} cells across, not convex", NOT_CONVEX
    )
    solid = Workspace.from_array(inputs.boxes(sizes["space"], 0.06, rng, dim=3), 1.0)
    _translating(report, solid, Robot.ball(BALL / 2), f"ball {BALL} cells across", IN_SPACE)
    for workspace, robot in ((boxes, Robot.disc(DISC / 2)), (solid, Robot.ball(BALL / 2))):
        _floor(report, workspace, robot)
    _turning(report, inputs.boxes(sizes["turning"], 0.06, rng))
    _stamping(report)
    sweeps.run(report, rng)


def _warm_up(rng: np.random.Generator) -> None:
    """Call every method once, to compile and load."""
    for dim, robot in ((2, Robot.disc(3.0)), (3, Robot.ball(3.0))):
        workspace = Workspace.from_array(inputs.boxes(32, 0.06, rng, dim), 1.0)
        raster = robot.shape.rasters(1.0)[0]
        for method in METHODS:
            ours(workspace, robot, method)
        for peer in peers(dim):
            peer.ready(workspace.outer, raster)()


def _horseshoe(across: int) -> Robot:
    """Return five sixths of a ring, with its reference point outside."""
    turns = np.linspace(np.pi / 6.0, 11.0 * np.pi / 6.0, 120)
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    radius = across / 2 - 1.0  # touched cells reach up to one cell beyond the robot
    return Robot.polygon(np.concatenate([radius * circle, 0.65 * radius * circle[::-1]]))


def _asymmetric(length: float = LENGTH, width: float = WIDTH) -> Robot:
    """Return an asymmetric rectangle with a small piece cut off one corner."""
    a, b, cut = length / 2, width / 2, min(length, width) / 20
    return Robot.polygon([(-a, -b), (a, -b), (a, b - cut), (a - cut, b), (-a, b)])


def _rasters_of(robot: Robot, spacing: float, rotations: int) -> list[Raster]:
    """Return the outer raster of each yaw cell."""
    return [
        robot.shape.rasters(spacing, rotation=turn)[0]
        for turn in Rotations.of(rotations)._make_shape_cells(2)
    ]


def _memory(report: Report, size: int, rng: np.random.Generator) -> None:
    """Measure peak memory of a large map in space, workspace included."""
    occupied, robot = inputs.boxes(size, 0.06, rng, dim=3), Robot.ball(LARGE_BALL / 2)
    report.section(
        f"{shape_text(occupied)} cells, ball {LARGE_BALL} cells across, outer and inner map"
    )
    for method in ENGINES:
        rise = memory_rise(
            lambda method=method: cspace.build(
                Workspace.from_array(occupied, 1.0), robot, method=method
            )
        )
        report.figure(
            f"{engine_label(method)}: peak memory, above what there was",
            rise / 2**30,
            "GiB",
            most=MAX_MEMORY_GIB,
        )


def _floor(report: Report, workspace: Workspace, robot: Robot) -> None:
    """Compare our transforms with bare transforms of the whole map."""
    occupied, raster = workspace.outer, robot.shape.rasters(1.0)[0]
    pairs = zip(occupied.shape, raster.cells.shape, strict=True)
    whole = np.zeros([fft.next_fast_len(n + r - 1, real=True) for n, r in pairs], np.float32)
    whole[tuple(slice(n) for n in occupied.shape)] = occupied
    report.section(
        f"{shape_text(occupied)} cells against bare float32 transforms of {shape_text(whole)}"
    )

    def bare(workers: int) -> NDArray[np.float32]:
        back: NDArray[np.float32] = fft.irfftn(
            fft.rfftn(whole, workers=workers), s=whole.shape, workers=workers
        )
        return back

    def correlated(workers: int) -> Bools:
        hits = np.empty(occupied.shape, np.bool_)
        ENGINES["fft"].write_overlaps(occupied, [raster], [hits], outside=False, workers=workers)
        return hits

    calls: dict[str, Callable[[], Any]] = {}
    for workers in sorted({1, min(2, count_cores())}):
        calls |= {
            f"ours, {workers}": partial(correlated, workers),
            f"bare, {workers}": partial(bare, workers),
        }
    timings = interleave(calls, _runs(report))
    for workers in sorted({1, min(2, count_cores())}):
        name = f"our transforms / two bare ones, workers each: {workers}"
        report.ratio(
            name, timings[f"ours, {workers}"], timings[f"bare, {workers}"], most=MAX_TRANSFORM_RATIO
        )


def _translating(
    report: Report, workspace: Workspace, robot: Robot, name: str, goals: Goals
) -> None:
    """Compare engines, rasterization included, with peers that get the robot's cells."""
    occupied = workspace.outer
    raster = robot.shape.rasters(workspace.grid.spacing)[0]
    report.section(f"{shape_text(occupied)} cells, {occupied.mean():.1%} occupied in boxes; {name}")
    report.note(
        f"the robot's outer raster has {shape_text(raster.cells)} cells, {raster.count} of them the robot's"
    )
    compared = {peer for of_engine in goals.values() for peer in of_engine}
    calls: dict[str, Callable[[], Bools]] = {
        engine_label(method): partial(ours, workspace, robot, method) for method in goals
    }
    calls |= {
        peer.name: peer.ready(occupied, raster)
        for peer in peers(occupied.ndim)
        if peer.name in compared
    }
    timings = interleave(calls, _runs(report), SLOW_PEER_SECONDS)
    report.timings(timings)
    for method, of_engine in goals.items():
        for peer in [peer for peer in timings if peer in compared]:
            report.ratio(
                f"{peer} / {engine_label(method)}",
                timings[peer],
                timings[engine_label(method)],
                least=of_engine.get(peer),
            )
    expected = timings["fftconvolve float64"].value
    for call, timing in timings.items():
        report.check(
            bool((timing.value == expected).all()), f"{call}: equal to fftconvolve, cell for cell"
        )


def _turning(report: Report, occupied: Bools) -> None:
    """Compare engines, rasterization included, with convolutions for each yaw."""
    workspace, robot, rotations = (
        Workspace.from_array(occupied, 1.0),
        _asymmetric(),
        _rotations(report),
    )
    rasters = _rasters_of(robot, 1.0, rotations)
    floats, kernels = (
        occupied.astype(np.float64),
        [np.flip(raster.cells).astype(np.float64) for raster in rasters],
    )
    report.section(
        f"{shape_text(occupied)} cells x {rotations} yaw cells, {occupied.mean():.1%} occupied in boxes; robot "
        f"{LENGTH} x {WIDTH} cells without symmetry"
    )

    def convolutions() -> list[Bools]:
        pairs = zip(kernels, rasters, strict=True)
        return [
            convolve_map(signal.fftconvolve, floats, kernel, raster) for kernel, raster in pairs
        ]

    _against(
        report,
        workspace,
        robot,
        "loop of fftconvolve float64",
        convolutions,
        TURNING,
        _runs(report),
    )


def _stamping(report: Report) -> None:
    """Compare with stamping at obstacle borders on real maps."""
    slower, rotations = [], _rotations(report)
    for name, (length, width) in REAL_MAP_ROBOTS.items():
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(inputs.NO_DATA)
            return
        spacing = workspace.grid.spacing
        robot = _asymmetric(length * spacing, width * spacing)
        report.section(
            f"{name}, {shape_text(workspace.outer)} cells x {rotations} yaw cells; robot {length} x {width} cells"
        )
        border = len(border_cells(workspace.outer))
        report.note(
            f"{border} obstacle cells on a border; the peer is given the outer rasters, and {count_cores()} workers"
        )
        call = partial(stamp, workspace.outer, _rasters_of(robot, spacing, rotations))
        goals = {"auto": STAMPING}
        theirs, own = _against(
            report, workspace, robot, "stamping, compiled", call, goals, 3 * _runs(report)
        ).values()
        slower.append(theirs.median / own.median)
    report.section(f"{len(slower)} real maps x {rotations} yaw cells")
    name = f"stamping, compiled / {engine_label('auto')}, median"
    report.figure(name, statistics.median(slower), least=STAMPING_MEDIAN)


def _against(
    report: Report,
    workspace: Workspace,
    robot: Robot,
    peer: str,
    call: Callable[[], list[Bools]],
    goals: Mapping[str, float],
    runs: int,
) -> dict[str, Timing]:
    """Compare builds of a rotating robot with a peer's maps; return the timings."""
    options: dict[str, Any] = {"rotations": _rotations(report), "outside": "free", "inner": False}
    calls: dict[str, Callable[[], Any]] = {peer: call}
    calls |= {
        engine_label(method): partial(cspace.build, workspace, robot, method=method, **options)
        for method in goals
    }
    timings = interleave(calls, runs)
    report.timings(timings)
    for method, least in goals.items():
        own = timings[engine_label(method)]
        report.ratio(f"{peer} / {engine_label(method)}", timings[peer], own, least=least)
        slices = zip(own.value.cell_states != cspace.FREE, timings[peer].value, strict=True)
        report.check(
            all((a == b).all() for a, b in slices),
            f"{engine_label(method)}: equal to the peer, cell for cell",
        )
    return timings


def _rotations(report: Report) -> int:
    return 12 if report.quick else ROTATIONS


def _runs(report: Report) -> int:
    return 2 if report.quick else 5
