"""Tiled maps: builds, workers, and maps beyond memory."""

from __future__ import annotations

import resource
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import zarr

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import Timing, interleave
from cspace import Robot, Workspace
from cspace._support.arrays import Bools

TILE_CELLS = 4096
CHUNK_CELLS = 1024
"""Side of a chunk of the city, cells; reads of a tile take whole chunks."""
CITY_SPACING = 0.1
STREET_CELLS = 128
"""Distance between streets of the city, cells."""

WORKERS: Final[dict[str, Any]] = {
    "threads_per_worker": 1,
    "env": {"ZARR_THREADING__MAX_WORKERS": "1"},
    "dashboard_address": ":0",
}
"""Options of workers of one thread, also for reading the city."""

CITY_CAR = Robot.rectangle(4.5, 1.9)


def run(report: Report, seed: int) -> None:
    """Measure throughput, workers, and two large maps built on a local cluster."""
    rng = np.random.default_rng(seed)
    folder = Path(tempfile.mkdtemp(prefix="cspace-tiles-"))
    try:
        _throughput(report, rng, folder)
        _workers(report, rng, folder)
        size, turning = (8192, 4096) if report.quick else (65_536, 16_384)
        _large(report, rng, folder, size, Robot.disc(1.0), None)
        _large(report, rng, folder, turning, CITY_CAR, 16)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _throughput(report: Report, rng: np.random.Generator, folder: Path) -> None:
    size, tile = (4096, 1024) if report.quick else (16_384, TILE_CELLS)
    workspace = Workspace.from_array(inputs.boxes(size, 0.06, rng), CITY_SPACING)
    for name, robot, rotations in (
        ("disc of 2 m", Robot.disc(1.0), None),
        ("car, 8 yaws", CITY_CAR, 8),
    ):
        report.section(
            f"{size} x {size} cells, {name}: one thread, in memory and into a store of tiles of {tile}"
        )
        options: dict[str, Any] = {"rotations": rotations, "workers": 1}
        calls = {
            "build in memory": lambda options=options, robot=robot: cspace.build(
                workspace, robot, **options
            ),
            "build into a store": partial(_stored, workspace, robot, folder / "one", tile, options),
        }
        timings = interleave(calls, 3)
        for label, timing in timings.items():
            report.timing(label, timing)
        inside, stored = timings.values()
        report.ratio("throughput of the store, of that in memory", inside, stored, least=0.5)
        space = stored.value
        window, turns = space.window(space.grid.lower, space.grid.upper), space.slice_rotations
        whole = inside.value
        equal = all(np.array_equal(window.states_at(turn), whole.states_at(turn)) for turn in turns)
        report.check(equal, "states are equal")
        report.figure(
            "bytes a cell on disk", _bytes(folder / "one") / (len(turns) * space.grid.size), "B"
        )


def _stored(
    workspace: Workspace, robot: Robot, path: Path, tile: int, options: dict[str, Any]
) -> Any:
    shutil.rmtree(path, ignore_errors=True)
    return cspace.build(workspace, robot, store=path, tile=tile, **options)


def _workers(report: Report, rng: np.random.Generator, folder: Path) -> None:
    from distributed import Client, LocalCluster

    size = 4096 if report.quick else 16_384
    report.section(
        f"{size} x {size} cells, car, 8 yaws, tiles of {size // 8}: one worker of a cluster, and two"
    )
    source = _city(folder / "small.zarr", size, rng)
    timings = []
    for workers in (1, 2):
        with LocalCluster(n_workers=workers, **WORKERS) as cluster, Client(cluster) as client:
            work = partial(
                _stored,
                source,
                CITY_CAR,
                folder / "two",
                size // 8,
                {"rotations": 8, "client": client},
            )
            timing = Timing(None)
            work()  # compiles
            for _ in range(3):
                timing.take(work)
        timing.cpu.clear()
        report.timing(f"{workers} worker{'s' * (workers > 1)}", timing)
        timings.append(timing)
    report.ratio("two workers, times quicker than one", *timings, least=1.7)


def _large(
    report: Report,
    rng: np.random.Generator,
    folder: Path,
    size: int,
    robot: Robot,
    rotations: int | None,
) -> None:
    from distributed import Client, LocalCluster

    turns = f" x {rotations} yaws" if rotations else ""
    report.section(
        f"a city of {size} x {size} cells{turns}, {robot.name}, tiles of {TILE_CELLS}, two workers of 2 GB"
    )
    source, path = _city(folder / "city.zarr", size, rng), folder / "map.zarr"
    shutil.rmtree(path, ignore_errors=True)
    with (
        LocalCluster(n_workers=2, memory_limit="2GB", **WORKERS) as cluster,
        Client(cluster) as client,
        _PeakMemory() as peak,
    ):
        began = time.perf_counter()
        space = cspace.build(
            source, robot, rotations=rotations, store=path, tile=TILE_CELLS, client=client
        )
        seconds = time.perf_counter() - began
    cells = sum(space.count())
    report.figure("cells, of all rotations", cells / 1e9, "10^9")
    report.figure("seconds to build", seconds, "s")
    report.figure("cells a second", cells / seconds / 1e6, "10^6")
    report.figure("largest worker", max(peak) / 1e9, "GB", most=2.0)
    report.figure("bytes on disk", _bytes(path) / 1e6, "MB")
    upper = [size * CITY_SPACING] * 2 + [np.pi] * bool(rotations)
    q = rng.uniform(0.0, upper, (10**6, space.size))
    space.classify(q[:1])
    space.motion_is_free(q[0], q[0])
    states = _timed(report, "10^6 look-ups at random", lambda: space.classify(q))
    near = q[: 10**4] + rng.normal(size=(10**4, space.size)) * (
        [20.0, 20.0] + [0.3] * bool(rotations)
    )
    free = _timed(report, "10^4 edges of some 25 m", lambda: space.motion_is_free(q[: 10**4], near))
    report.check(
        not (free & (states[: 10**4] != cspace.FREE)).any(),
        "no free edge begins in a cell that is not FREE",
    )
    window = space.window(q[0, :2] - 20.0, q[0, :2] + 20.0)
    here = window.grid.contains(q[:, :2])
    report.check(np.array_equal(window.classify(q[here]), states[here]), "a window answers alike")
    _timed(report, "components of all tiles, labelled and joined", space.compute_components)
    free_q = q[states == cspace.FREE]
    endpoints = [
        free_q[np.argmin(np.abs(free_q[:, :2] - corner).sum(axis=1))]
        for corner in (50.0, size * CITY_SPACING - 50.0)
    ]
    report.figure(
        "cells from start to goal",
        float(np.abs(endpoints[1] - endpoints[0])[:2].max() / CITY_SPACING),
        "",
    )
    plan = _timed(
        report,
        "a plan",
        lambda: planners.plan(space, *endpoints, seed=0, time_limit=10.0),
        most=60.0,
    )
    report.note(f"{plan.status}; a path exists: {plan.is_connected}; {plan.length:.0f} m")
    report.check(plan.certified or not plan, "the path is certified, where one was found")
    report.figure("this process", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, "GB")


def _timed(report: Report, name: str, call: Callable[[], Any], most: float | None = None) -> Any:
    began = time.perf_counter()
    value = call()
    report.figure(name, time.perf_counter() - began, "s", most=most)
    return value


def _city(path: Path, size: int, rng: np.random.Generator) -> Workspace:
    """Draw buildings between streets in a Zarr array."""
    side = min(size, CHUNK_CELLS)
    array = zarr.create_array(
        str(path),
        shape=(size, size),
        chunks=(side, side),
        dtype="bool",
        overwrite=True,
        config={"write_empty_chunks": True},
    )
    for x in range(0, size, side):
        for y in range(0, size, side):
            array[x : x + side, y : y + side] = _quarter(side, rng)
    return Workspace.from_array(array, CITY_SPACING)


def _quarter(side: int, rng: np.random.Generator) -> Bools:
    cells = np.zeros((side, side), dtype=np.bool_)
    for x in range(0, side, STREET_CELLS):
        for y in range(0, side, STREET_CELLS):
            if rng.random() < 0.7:
                width, depth = rng.integers(40, 100, 2)
                cells[x + 12 : x + 12 + width, y + 12 : y + 12 + depth] = True
    return cells


def _bytes(path: Path) -> int:
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


class _PeakMemory:
    """Peak memory of the child processes in bytes."""

    def __enter__(self) -> list[int]:
        self._peak, self._stop = [0], threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self._peak

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        import psutil

        while not self._stop.wait(0.1):
            for process in psutil.Process().children(recursive=True):
                with suppress(psutil.Error):
                    self._peak.append(process.memory_info().rss)
            self._peak[:] = [max(self._peak)]
