"""The outer map of 4096 x 4096 cells and a disc 65 cells across, against other ways to the same booleans."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import interleave, memory_rise
from cspace import Robot, Workspace
from cspace.fourier import correlate
from cspace.raster import Raster
from cspace.threads import cores

Bools = NDArray[np.bool_]

ACROSS = 65
SIZE = (4096, 4096)
"""Cells of the maps for which the targets are meant."""

REAL = ("maps/100by100_10.yaml", "maps/willow-full-0.05.yaml", "movingai/Berlin_1_1024.map")


def run(report: Report, seed: int) -> None:
    """Compare on maps of boxes, on noise, on real maps, and with dilation."""
    rng = np.random.default_rng(seed)
    size, runs = (1024, 3) if report.quick else (SIZE[0], 5)
    _transforms(report, "6 % in boxes", inputs.boxes(size, 0.06, rng), 1.0, runs)
    _transforms(report, "2 % noise", inputs.noise(size, 0.02, rng), 1.0, runs)
    for name in REAL:
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(inputs.NO_DATA)
            break
        _transforms(report, name, workspace.outer, workspace.grid.spacing, runs)
    _dilation(report, inputs.boxes(256 if report.quick else 1024, 0.06, rng), runs)


def _transforms(report: Report, name: str, occupied: Bools, spacing: float, runs: int) -> None:
    """Ours against convolutions by FFT and against the two transforms that one of them cannot do without."""
    judged = occupied.shape == SIZE
    from scipy import fft, signal

    workspace = Workspace.from_array(occupied, spacing)
    robot = Robot.disc(ACROSS / 2 * spacing)
    raster = robot.rasters(spacing)[0]
    kernel = raster.cells[::-1, ::-1]
    padded = [fft.next_fast_len(n + r - 1, real=True) for n, r in zip(occupied.shape, kernel.shape, strict=True)]
    report.section(
        f"{name}: {_across(occupied)} cells, {occupied.mean():.1%} occupied; disc {ACROSS} cells across, outer raster "
        f"{_across(raster.cells)}; transforms {padded[0]} x {padded[1]}"
    )
    # Peers get their floating-point copies for nothing; ours starts from the booleans.
    map64, kernel64 = occupied.astype(np.float64), kernel.astype(np.float64)
    map32, kernel32 = occupied.astype(np.float32), kernel.astype(np.float32)
    plane = np.zeros(padded, np.float32)
    plane[: occupied.shape[0], : occupied.shape[1]] = occupied
    window = _window(raster, occupied.shape)

    calls: dict[str, Callable[[], Any]] = {}
    for workers in sorted({1, 2, cores()} & set(range(1, cores() + 1))):
        many = f", {workers} workers"
        calls[f"ours, correlate{many}"] = partial(_ours, occupied, raster, workers)
        calls[f"ours, build{many}"] = partial(
            cspace.build, workspace, robot, inner=False, outside="free", workers=workers
        )
        calls[f"fftconvolve float64{many}"] = _with_workers(
            workers, lambda: signal.fftconvolve(map64, kernel64, mode="full")[window] > 0.5
        )
        calls[f"oaconvolve float32{many}"] = _with_workers(
            workers, lambda: signal.oaconvolve(map32, kernel32, mode="full")[window] > 0.5
        )
        calls[f"two bare float32 transforms{many}"] = partial(_two_transforms, plane, workers)
    risen = {call: memory_rise(calls[call]) for call in calls}
    timings = interleave(calls, runs)
    for call, timing in timings.items():
        rise = risen[call]
        report.timing(call, timing, **({} if rise is None else {"peak_memory": f"+{rise / 2**20:.0f} MB"}))

    ours = timings[f"ours, correlate, {cores()} workers"]
    report.note(f"ratios to ours with its default, {cores()} workers (scipy's own default is 1 worker)")
    for peer, least in (("fftconvolve float64", 3.5), ("oaconvolve float32", 2.0)):
        report.ratio(
            f"{peer}, its default / ours", timings[f"{peer}, 1 workers"], ours, least=least if judged else None
        )
    if cores() > 1:
        report.note("ratios to ours with as many workers as the peer has")
    for workers in sorted({1, min(2, cores())}):
        many = f"{workers} workers"
        same = timings[f"ours, correlate, {many}"]
        for peer in ("fftconvolve float64", "oaconvolve float32"):
            report.ratio(f"{peer} / ours, {many} each", timings[f"{peer}, {many}"], same)
        floor = timings[f"two bare float32 transforms, {many}"]
        report.ratio(f"ours / two bare transforms, {many} each", same, floor, most=1.3 if judged else None)
    wanted = timings["fftconvolve float64, 1 workers"].value
    for call, timing in timings.items():
        if call.startswith("ours, build"):
            report.check(bool(((timing.value.state != cspace.FREE) == wanted).all()), f"{call}: equal to fftconvolve")
        elif not call.startswith("two bare"):
            report.check(bool((timing.value == wanted).all()), f"{call}: equal to fftconvolve")


def _dilation(report: Report, occupied: Bools, runs: int) -> None:
    """Ours against the morphology that people use for this, whose work grows with the robot's area."""
    raster = Robot.disc(ACROSS / 2).rasters(1.0)[0]
    report.section(f"dilation: {_across(occupied)} cells in boxes, disc {ACROSS} cells across, {cores()} workers")
    calls: dict[str, Callable[[], Any]] = {"ours, correlate": partial(_ours, occupied, raster, None)}
    try:
        import cv2
    except ImportError:
        report.note("cv2.dilate skipped: OpenCV is not installed; pip install opencv-python-headless")
    else:
        image, kernel = occupied.astype(np.uint8), raster.cells.astype(np.uint8)
        anchor = (-raster.lower[1], -raster.lower[0])
        calls["cv2.dilate"] = lambda: cv2.dilate(image, kernel, anchor=anchor).astype(np.bool_)
    timings = interleave(calls, runs)
    small = occupied[:256, :256]
    timings |= interleave(
        {
            "ours, correlate, 256 x 256 cells": partial(_ours, small, raster, None),
            "scipy.ndimage.binary_dilation, 256 x 256 cells": partial(_binary_dilation, small, raster),
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


def _ours(occupied: Bools, raster: Raster, workers: int | None) -> Bools:
    overlaps: Bools = correlate(occupied, [raster], outside=False, workers=workers).results[0]
    return overlaps


def _two_transforms(plane: NDArray[np.float32], workers: int) -> NDArray[np.float32]:
    from scipy import fft

    back: NDArray[np.float32] = fft.irfft2(fft.rfft2(plane, workers=workers), s=plane.shape, workers=workers)
    return back


def _binary_dilation(occupied: Bools, raster: Raster) -> Bools:
    from scipy import ndimage

    # Centred by SciPy on shape // 2, which is where a disc around the reference point has its own centre.
    dilated: Bools = ndimage.binary_dilation(occupied, raster.cells[::-1, ::-1])
    return dilated


def _window(raster: Raster, shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Where the map lies in a full convolution with the flipped raster."""
    return tuple(slice(high, high + n) for high, n in zip(raster.upper, shape, strict=True))


def _with_workers(workers: int, call: Callable[[], Any]) -> Callable[[], Any]:
    from scipy import fft

    def run_call() -> Any:
        # Without the context, a peer's default, which is one worker.
        with fft.set_workers(workers) if workers > 1 else contextlib.nullcontext():
            return call()

    return run_call


def _across(cells: NDArray[Any]) -> str:
    return " x ".join(map(str, cells.shape))
