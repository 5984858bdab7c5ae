"""Maps in use: saves, threads, processes and growth."""

from __future__ import annotations

import gc
import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import psutil

import cspace
from cspace import FREE, CSpace, CspaceError, Robot, Workspace

if TYPE_CHECKING:
    from benchmarks.report import Report

KILLS = 50
QUERIES, UPDATES, PLANS = 100_000, 1_000, 200

BLOCK, PLACE = np.ones((12, 9), dtype=bool), (20, 14)


def build_maps() -> tuple[CSpace, CSpace]:
    """Build two maps that differ by one block."""
    cells = np.random.default_rng(0).random((60, 40)) < 0.02
    both = cells.copy()
    both[20:32, 14:23] = True
    one, two = (
        cspace.build(Workspace.from_array(each, 0.1), Robot.rectangle(0.5, 0.2), rotations=8)
        for each in (cells, both)
    )
    return one, two


def check(report: Report, seed: int, kills: int = KILLS, share: float = 1.0) -> None:
    """Run all checks, with a share of the work."""
    report.section(f"in use: {kills} killed saves, processes, threads, and growth")
    counts = kill_saves(kills, np.random.default_rng(seed))
    report.note(f"{kills} saves were killed: {format_counts(counts)}")
    torn = counts["torn"] + counts["left beside it torn"]
    report.check(not torn and counts["whole"] > 0, "no torn map opens")
    counts = save_to_one_place(3, max(2, kills // 5))
    report.note(f"three processes saved to one place, and one read: {format_counts(counts)}")
    report.check(
        not counts["torn"] and counts["left whole"] == 1,
        "every map read is whole, the last one too",
    )
    counts = query_during_updates(3.0 * share)
    report.note(f"queries while another thread updates: {format_counts(counts)}")
    report.check(
        not counts["false"] and counts["cells"] > 0,
        "no query returns FREE for a cell that never is",
    )
    for method in {"fork", "spawn"} & {*multiprocessing.get_all_start_methods()}:
        report.check(
            agrees_in_child(method), f"a map returns equal results in a child made by {method}"
        )
    for name, growth, handles in measure_growth(share):
        report.note(f"{name}: {growth / 2**20:+.1f} MiB, {handles:+d} handles")
        report.check(growth < 8 * 2**20 and handles <= 0, f"{name} leave nothing behind")


def format_counts(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))


# ---- saves ---------------------------------------------------------------------------------------


def kill_saves(kills: int, rng: np.random.Generator) -> Counter[str]:
    """Kill saving processes; count the outcomes of opening."""
    counts: Counter[str] = Counter()
    both = build_maps()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.zarr"
        both[0].save(path)  # imports before the fork
        for _ in range(kills):
            child = multiprocessing.get_context("fork").Process(
                target=_save, args=(both, path, 10**6)
            )
            child.start()
            time.sleep(rng.uniform(0.0, 0.2))
            os.kill(child.pid or 0, signal.SIGKILL)
            child.join()
            counts[_try_open(path, both)] += 1
            for left in Path(folder).glob(".cspace-*"):
                counts[f"left beside it {_try_open(left, both)}"] += 1
                shutil.rmtree(left) if left.is_dir() else left.unlink()
    return counts


def save_to_one_place(processes: int, saves: int) -> Counter[str]:
    """Save by several processes; count outcomes of opening."""
    counts: Counter[str] = Counter()
    both = build_maps()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.zarr"
        both[0].save(path)
        context = multiprocessing.get_context("fork")
        writers = [
            context.Process(target=_save, args=(both, path, saves)) for _ in range(processes)
        ]
        for writer in writers:
            writer.start()
        while any(writer.is_alive() for writer in writers):
            counts[_try_open(path, both)] += 1
        counts["torn"] += sum(writer.exitcode != 0 for writer in writers)
        counts[f"left {_try_open(path, both)}"] += 1
        counts["left beside it"] += len(list(Path(folder).iterdir())) - 1
    return counts


def _save(both: tuple[CSpace, CSpace], path: Path, times: int) -> None:
    for number in range(times):
        try:
            both[number % 2].save(path, overwrite=True)
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


def query_during_updates(seconds: float) -> Counter[str]:
    """Count false FREE results during updates."""
    counts: Counter[str] = Counter()
    one, two = build_maps()
    block, nothing = (
        two.workspace.outer[20:32, 14:23].copy(),
        one.workspace.outer[20:32, 14:23].copy(),
    )
    yaws = one.rotations.centers[:, 0]
    centers = np.stack(
        np.meshgrid(*(one.grid.centers(axis) for axis in (0, 1)), indexing="ij"), axis=-1
    )
    q = np.concatenate([np.insert(centers, 2, yaw, axis=-1) for yaw in yaws]).reshape(-1, 3)
    never, always = (
        (_classify(one, q) != FREE) & (_classify(two, q) != FREE),
        (_classify(one, q) == FREE) & (_classify(two, q) == FREE),
    )
    stop, space = threading.Event(), two
    for cells in (nothing, block):  # compiles before the threads start
        space.update(cells, PLACE)

    def look() -> None:
        while not stop.is_set():
            for free in (space.is_free(q), space.motion_is_free(q, q)):
                counts["false"] += int((free & never).sum())
                counts["lost"] += int((~free & always).sum())
                counts["cells"] += len(q)

    threads = [threading.Thread(target=look) for _ in range(2)]
    for thread in threads:
        thread.start()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for cells in (nothing, block):
            space.update(cells, PLACE)
            counts["updates"] += 1
    stop.set()
    for thread in threads:
        thread.join()
    return counts


def _classify(space: CSpace, q: Any) -> Any:
    return np.asarray(space.classify(q))


def agrees_in_child(method: str) -> bool:
    """Return True if maps agree in child processes."""
    space = build_maps()[0]
    expected = _run_queries(space)
    children = [_child(method, space) for _ in range(3 if method == "fork" else 1)]
    answers = [_receive_answers(*child) for child in children]
    return answers == [expected] * len(children)


def _child(method: str, space: CSpace) -> tuple[Any, Any]:
    """Start a process with a map; return its pipe, too."""
    context: Any = multiprocessing.get_context(method)
    here, there = context.Pipe()
    child = context.Process(target=_send_answers, args=(there, space))
    child.start()
    return child, here


def _receive_answers(child: Any, pipe: Any) -> object:
    answers = pipe.recv() if pipe.poll(240) else None
    child.kill()
    child.join()
    return answers


def _send_answers(pipe: Any, space: CSpace) -> None:
    pipe.send(_run_queries(space))


def _run_queries(space: CSpace) -> list[Any]:
    """Return results of a copy before and after an update."""
    import pickle

    q = np.random.default_rng(0).uniform((0.0, 0.0, -3.0), (6.0, 4.0, 3.0), (200, 3))
    answers, copied = [], pickle.loads(pickle.dumps(space))
    for _ in range(2):
        looks = copied.classify(q), copied.motion_is_free(q[:100], q[100:]), copied.clearance(q)
        answers += [
            np.asarray(look).tolist()
            for look in (
                *looks,
                copied.is_connected(q[:100], q[100:]),
                copied.is_disconnected(q[:100], q[100:]),
            )
        ]
        copied.update(BLOCK, PLACE)
    return answers


# ---- growth --------------------------------------------------------------------------------------


def measure_growth(share: float) -> Iterator[tuple[str, int, int]]:
    """Yield the growth of memory and handles."""
    import planners

    space, two = build_maps()
    parts = two.workspace.outer[20:32, 14:23], space.workspace.outer[20:32, 14:23].copy()
    rng = np.random.default_rng(0)
    start, *others = space.sample_free(50, rng)
    goal = next(other for other in others if space.is_connected(start, other))

    def look(number: int) -> None:
        q = rng.uniform((0.0, 0.0, -3.0), (6.0, 4.0, 3.0))
        space.is_free(q)
        if number % 10 == 0:
            space.motion_is_free(q, start)
            space.clearance(q)
            space.sample_free(1, rng)
            space.classify(np.tile(q, (50, 1)))

    def update(number: int) -> None:
        space.update(parts[number % 2], PLACE)
        space.is_connected(start, goal)

    def plan(number: int) -> None:
        planners.plan(space, start, goal, seed=number % 20, time_limit=1.0)

    for name, work, times in (
        ("queries", look, QUERIES),
        ("updates", update, UPDATES),
        ("plans", plan, PLANS),
    ):
        count = max(2, int(times * share))
        for number in range(max(2, count // 5)):
            work(number)
        before = _measure_process()
        for number in range(count):
            work(number)
        after = _measure_process()
        yield f"{count} {name}", after[0] - before[0], after[1] - before[1]


def _measure_process() -> tuple[int, int]:
    gc.collect()
    process = psutil.Process()
    return process.memory_info().rss, process.num_fds()
