"""Maps in use: killed saves, threads, processes and growth."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import shutil
import signal
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil

import cspace
from benchmarks.report import Report
from cspace import CSpace, CspaceError, Robot, Workspace

BLOCK, PLACE = np.ones((12, 9), dtype=bool), (20, 14)
"""Cells that updates write and clear, and their corner."""

BYTES_OF_GROWTH = 8 * 2**20
"""Memory that repeated work may keep."""


def build_map(with_block: bool) -> CSpace:
    """Build a map with or without a block of obstacle cells."""
    cells = np.random.default_rng(0).random((60, 40)) < 0.02
    cells[20:32, 14:23] = with_block
    return cspace.build(Workspace.from_array(cells, 0.1), Robot.rectangle(0.5, 0.2), rotations=8)


def check(report: Report, seed: int, kills: int = 50, share: float = 1.0) -> None:
    """Run all checks, with a share of the work."""
    rng = np.random.default_rng(seed)
    report.section(f"in use: {kills} killed saves, processes, threads, and growth")
    counts = kill_saves(kills, rng)
    report.check(not counts["torn"] and counts["whole"] > 0, f"no torn map opens: {dict(counts)}")
    counts = query_during_updates(3.0 * share, rng)
    safe = not counts["false"] and counts["cells"] > 0
    report.check(safe, f"no query returns FREE for a cell that never is: {dict(counts)}")
    for method in multiprocessing.get_all_start_methods():
        report.check(agrees_in_child(method), f"a map answers alike in a child made by {method}")
    for name, growth, handles in measure_growth(share):
        kept = f"{growth / 2**20:+.1f} MiB, {handles:+d} handles"
        report.check(growth < BYTES_OF_GROWTH and handles <= 0, f"{name} leave nothing: {kept}")


# ---- saves ---------------------------------------------------------------------------------------


def kill_saves(kills: int, rng: np.random.Generator) -> Counter[str]:
    """Kill two processes that save to one place; count the outcomes of opening it."""
    counts: Counter[str] = Counter()
    both = build_map(False), build_map(True)
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.zarr"
        both[0].save(path)  # imports before the fork
        for _ in range(kills):
            writers = [context.Process(target=_save, args=(both, path)) for _ in range(2)]
            for writer in writers:
                writer.start()
            end = time.monotonic() + rng.uniform(0.0, 0.2)
            while time.monotonic() < end:
                counts[_try_open(path, both)] += 1
            for writer in writers:
                os.kill(writer.pid or 0, signal.SIGKILL)
                writer.join()
            for left in (path, *Path(folder).glob(".cspace-*")):
                counts[_try_open(left, both)] += 1
                if left != path:
                    shutil.rmtree(left) if left.is_dir() else left.unlink()
    return counts


def _save(both: tuple[CSpace, CSpace], path: Path) -> None:
    """Save two maps in turns until the process is killed."""
    while True:
        for space in both:
            try:
                space.save(path, overwrite=True)
            except CspaceError:  # another process was faster
                continue


def _try_open(path: Path, both: tuple[CSpace, CSpace]) -> str:
    try:
        space: Any = cspace.open(path)
    except CspaceError:
        return "refused" if path.exists() else "absent"
    whole = any(
        np.array_equal(space.cell_states, each.cell_states)
        and np.array_equal(space.workspace.outer, each.workspace.outer)
        for each in both
    )
    return "whole" if whole else "torn"


# ---- threads and processes -----------------------------------------------------------------------


def query_during_updates(seconds: float, rng: np.random.Generator) -> Counter[str]:
    """Count false FREE results during updates."""
    counts: Counter[str] = Counter()
    space, with_block = build_map(False), build_map(True)
    cells = [each.workspace.outer[20:32, 14:23].copy() for each in (space, with_block)]
    q = rng.uniform((0.0, 0.0, -3.0), (6.0, 4.0, 3.0), (5000, 3))
    never = ~(np.asarray(space.is_free(q)) | np.asarray(with_block.is_free(q)))
    stop = threading.Event()
    for each in cells:  # compiles before the threads start
        space.update(each, PLACE)

    def look() -> None:
        while not stop.is_set():
            for free in (space.is_free(q), space.motion_is_free(q, q)):
                counts["false"] += int((free & never).sum())
                counts["cells"] += len(q)

    threads = [threading.Thread(target=look) for _ in range(2)]
    for thread in threads:
        thread.start()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for each in cells:
            space.update(each, PLACE)
            counts["updates"] += 1
    stop.set()
    for thread in threads:
        thread.join()
    return counts


def agrees_in_child(method: str) -> bool:
    """Return True if a map gives equal answers in a child process."""
    space, context = build_map(False), multiprocessing.get_context(method)
    with context.Pool(1) as pool:
        return pool.apply_async(_run_queries, (space,)).get(240) == _run_queries(space)


def _run_queries(space: CSpace) -> list[Any]:
    """Return results of a copy before and after an update."""
    q = np.random.default_rng(0).uniform((0.0, 0.0, -3.0), (6.0, 4.0, 3.0), (200, 3))
    answers, copied, pair = [], pickle.loads(pickle.dumps(space)), (q[:100], q[100:])
    for _ in range(2):
        answers += [copied.classify(q), copied.clearance(q), copied.motion_is_free(*pair)]
        answers += [copied.is_connected(*pair), copied.is_disconnected(*pair)]
        copied.update(BLOCK, PLACE)
    return [np.asarray(each).tolist() for each in answers]


# ---- growth --------------------------------------------------------------------------------------


def measure_growth(share: float) -> Iterator[tuple[str, int, int]]:
    """Yield the growth of memory and handles."""
    space, rng = build_map(False), np.random.default_rng(0)
    start, goal = space.sample_free(2, rng)

    def look(number: int) -> None:
        q = rng.uniform((0.0, 0.0, -3.0), (6.0, 4.0, 3.0), (50, 3))
        for query in (space.is_free, space.classify, space.clearance):
            query(q)
        space.motion_is_free(q, start)
        space.sample_free(1, rng)

    def update(number: int) -> None:
        space.update(BLOCK & (number % 2 == 0), PLACE)
        space.is_connected(start, goal)

    for work, times in ((look, 10_000), (update, 1000)):
        count = max(2, int(times * share))
        for number in range(max(2, count // 5)):
            work(number)
        before = _measure_process()
        for number in range(count):
            work(number)
        after = _measure_process()
        yield f"{count} calls of {work.__name__}", after[0] - before[0], after[1] - before[1]


def _measure_process() -> tuple[int, int]:
    gc.collect()
    process = psutil.Process()
    return process.memory_info().rss, process.num_fds()
