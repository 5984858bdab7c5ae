"""The outer map of 4096 x 4096 cells and a disc 65 cells across, against other ways to the same booleans."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.ways import NO_OPENCV, across, binary_dilation, convolved, dilation, opencv_is_here, our_map
from benchmarks.timing import Timing, interleave, memory_rise
from cspace import Robot, Workspace
from cspace.threads import cores

Bools = NDArray[np.bool_]

ACROSS = 65
SIZE = (4096, 4096)
"""Cells of the maps for which the targets are meant."""

LEAST = {"fftconvolve float64": 3.5, "oaconvolve float32": 2.0}
"""How many times slower than ours each peer should be with its default."""

REAL = ("maps/100by100_10.yaml", "maps/willow-full-0.05.yaml", "movingai/Berlin_1_1024.map")


def run(report: Report, seed: int) -> None:
    """Compare on maps of boxes, on noise, on real maps, and with dilation."""
    rng = np.random.default_rng(seed)
    size, runs = (1024, 3) if report.quick else (SIZE[0], 5)
    _compare(report, "6 % in boxes", Workspace.from_array(inputs.boxes(size, 0.06, rng), 1.0), runs)
    _compare(report, "2 % noise", Workspace.from_array(inputs.noise(size, 0.02, rng), 1.0), runs)
    for name in REAL:
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(inputs.NO_DATA)
            break
        _compare(report, name, workspace, runs)
    _dilation(report, inputs.boxes(256 if report.quick else 1024, 0.06, rng), runs)


def _compare(report: Report, name: str, workspace: Workspace, runs: int) -> None:
    robot = Robot.disc(ACROSS / 2 * workspace.grid.spacing)
    report.section(f"{name}, disc {ACROSS} cells across")
    transforms(report, workspace, robot, LEAST, runs, judged=workspace.grid.shape == SIZE)


def transforms(
    report: Report, workspace: Workspace, robot: Robot, least: Mapping[str, float], runs: int, judged: bool
) -> Timing:
    """Ours against convolutions by FFT and against the two transforms that one of them cannot do without.

    Parameters
    ----------
    report : Report
    workspace : Workspace
    robot : Robot
    least : mapping of str to float
        Names of the peers, and how many times slower than ours they should be with their defaults.
    runs : int
    judged : bool
        Whether the ratios are held against their targets.

    Returns
    -------
    Timing
        Of our correlation with its default.
    """
    from scipy import fft, signal

    occupied = workspace.outer
    raster = robot.rasters(workspace.grid.spacing)[0]
    kernel = np.flip(raster.cells)
    padded = [fft.next_fast_len(n + r - 1, real=True) for n, r in zip(occupied.shape, kernel.shape, strict=True)]
    report.note(
        f"{across(occupied)} cells, {occupied.mean():.1%} occupied; outer raster {across(raster.cells)}; transforms "
        f"{' x '.join(map(str, padded))}"
    )
    # Peers get their floating-point copies for nothing; ours starts from the booleans.
    map64, kernel64 = occupied.astype(np.float64), kernel.astype(np.float64)
    map32, kernel32 = occupied.astype(np.float32), kernel.astype(np.float32)
    whole = np.zeros(padded, np.float32)
    whole[tuple(slice(n) for n in occupied.shape)] = occupied
    peers: dict[str, Callable[[], Any]] = {
        "fftconvolve float64": partial(convolved, signal.fftconvolve, map64, kernel64, raster),
        "oaconvolve float32": partial(convolved, signal.oaconvolve, map32, kernel32, raster),
    }

    calls: dict[str, Callable[[], Any]] = {}
    for workers in sorted({1, 2, cores()} & set(range(1, cores() + 1))):
        many = f", {workers} workers"
        calls[f"ours, correlate{many}"] = partial(our_map, occupied, raster, workers)
        calls[f"ours, build{many}"] = partial(
            cspace.build, workspace, robot, inner=False, outside="free", workers=workers
        )
        for peer in least:
            calls[f"{peer}{many}"] = _with_workers(workers, peers[peer])
        calls[f"two bare float32 transforms{many}"] = partial(_two_transforms, whole, workers)
    risen = {call: memory_rise(calls[call]) for call in calls}
    timings = interleave(calls, runs)
    for call, timing in timings.items():
        rise = risen[call]
        report.timing(call, timing, **({} if rise is None else {"peak_memory": f"+{rise / 2**20:.0f} MB"}))

    default = timings[f"ours, correlate, {cores()} workers"]
    report.note(f"ratios to ours with its default, {cores()} workers (scipy's own default is 1 worker)")
    for peer, target in least.items():
        report.ratio(
            f"{peer}, its default / ours", timings[f"{peer}, 1 workers"], default, least=target if judged else None
        )
    if cores() > 1:
        report.note("ratios to ours with as many workers as the peer has")
    for workers in sorted({1, min(2, cores())}):
        many = f"{workers} workers"
        same = timings[f"ours, correlate, {many}"]
        for peer in least:
            report.ratio(f"{peer} / ours, {many} each", timings[f"{peer}, {many}"], same)
        floor = timings[f"two bare float32 transforms, {many}"]
        report.ratio(f"ours / two bare transforms, {many} each", same, floor, most=1.3 if judged else None)
    wanted = timings["fftconvolve float64, 1 workers"].value
    for call, timing in timings.items():
        if call.startswith("ours, build"):
            report.check(bool(((timing.value.state != cspace.FREE) == wanted).all()), f"{call}: equal to fftconvolve")
        elif not call.startswith("two bare"):
            report.check(bool((timing.value == wanted).all()), f"{call}: equal to fftconvolve")
    return default


def _dilation(report: Report, occupied: Bools, runs: int) -> None:
    """Ours against the morphology that people use for this, whose work grows with the robot's area."""
    raster = Robot.disc(ACROSS / 2).rasters(1.0)[0]
    report.section(f"dilation: {across(occupied)} cells in boxes, disc {ACROSS} cells across, {cores()} workers")
    calls: dict[str, Callable[[], Any]] = {"ours, correlate": partial(our_map, occupied, raster, None)}
    if opencv_is_here():
        calls["cv2.dilate"] = dilation(occupied, raster)
    else:
        report.note(NO_OPENCV)
    timings = interleave(calls, runs)
    small = occupied[:256, :256]
    timings |= interleave(
        {
            "ours, correlate, 256 x 256 cells": partial(our_map, small, raster, None),
            "scipy.ndimage.binary_dilation, 256 x 256 cells": partial(binary_dilation, small, raster),
        },
        runs=1 if report.quick else 3,
    )
    for call, timing in timings.items():
        report.timing(call, timing)
    for peer, ours in (
        ("cv2.dilate", "ours, correlate"),
        ("scipy.ndimage.binary_dilation, 256 x 256 cells", "ours, correlate, 256 x 256 cells"),
    ):
        if peer in timings:
            report.ratio(f"{peer} / ours", timings[peer], timings[ours])
            report.check(bool((timings[peer].value == timings[ours].value).all()), f"{peer}: equal to ours")


def _two_transforms(whole: NDArray[np.float32], workers: int) -> NDArray[np.float32]:
    from scipy import fft

    back: NDArray[np.float32] = fft.irfftn(fft.rfftn(whole, workers=workers), s=whole.shape, workers=workers)
    return back


def _with_workers(workers: int, call: Callable[[], Any]) -> Callable[[], Any]:
    from scipy import fft

    def run_call() -> Any:
        # Without the context, a peer's default, which is one worker.
        with fft.set_workers(workers) if workers > 1 else contextlib.nullcontext():
            return call()

    return run_call
