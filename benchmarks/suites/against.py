"""Users' jobs on this tree and on another commit, in turn."""

from __future__ import annotations

import io
import json
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

from benchmarks import inputs
from benchmarks.jobs import JOBS
from benchmarks.report import Report, time_text

ROOT: Final = Path(__file__).resolve().parents[2]
MAX_RATIO: Final = 1.2
"""Target: CPU time of a job on this tree, over that on the other commit."""

RUNS: Final = 5
"""Timed runs of a job on each side, after an untimed one that compiles."""

SLOW_SECONDS: Final = 15.0
"""A job that has taken longer on both sides together is not run again."""


class Side:
    """A process that runs one job on one tree."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.cpu: list[float] = []
        self.value = ""
        self.error = ""

    def run(self, is_timed: bool) -> None:
        """Run the job once, unless it has failed before."""
        if self.error:
            return
        try:
            print(file=self._process.stdin, flush=True)
            line = self._process.stdout.readline()  # type: ignore[union-attr]
        except BrokenPipeError:
            line = ""
        answer = json.loads(line or '{"error": "the process ended"}')
        self.error = answer.get("error", "")
        self.value = answer.get("value", "")
        if is_timed and not self.error:
            self.cpu.append(answer["cpu_s"])


def run(report: Report, seed: int, revision: str = "HEAD") -> None:
    """Compare this tree with a commit, job by job; jobs have their own seeds."""
    archive = ["git", "archive", revision, "cspace", "planners"]
    done = subprocess.run(archive, cwd=ROOT, capture_output=True, check=False)
    if done.returncode:
        report.note(f"skipped: {done.stderr.decode().strip()}")
        return
    if inputs.data_folder() is None:
        report.note(inputs.NO_DATA)
    report.section(f"CPU time on {revision}, and on this tree over it; one thread")
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(done.stdout)) as files:
            files.extractall(folder, filter="data")
        for number, name in enumerate(JOBS):
            _compare(report, number, name, {"old": Path(folder).resolve(), "new": ROOT})


def _compare(report: Report, number: int, name: str, trees: Mapping[str, Path]) -> None:
    """Run a job on both trees in turn, and report the ratio of the medians."""
    size = "quick" if report.quick else "full"
    with ExitStack() as stack:
        sides = {
            key: stack.enter_context(_start_side(root, [str(number), size]))
            for key, root in trees.items()
        }
        for turn in range(1 + (1 if report.quick else RUNS)):
            # Each turn begins with the other side.
            for side in list(sides.values())[:: 1 - 2 * (turn % 2)]:
                side.run(is_timed=turn > 0)
            if sum(sum(side.cpu) for side in sides.values()) > SLOW_SECONDS:
                break
    old, new = sides["old"], sides["new"]
    if "CSPACE_TEST_DATA" in old.error + new.error:
        report.note(f"{name}: skipped, without its file")
    elif new.error:
        report.check(False, f"{name} runs on this tree: {new.error}")
    elif old.error:
        report.note(f"{name}: this tree {time_text(_median(new))}; old tree: {old.error}")
    else:
        figures: dict[str, Any] = {"old_cpu_s": _median(old), "new_cpu_s": _median(new)}
        ratio = figures["new_cpu_s"] / figures["old_cpu_s"]
        report.figure(f"{name}, {time_text(figures['old_cpu_s'])}", ratio, most=MAX_RATIO)
        report.mark(**figures, old_value=old.value, new_value=new.value, runs=len(new.cpu))
        if old.value != new.value:
            report.note(f"  {old.value} before, {new.value} now")


def _median(side: Side) -> float:
    """Return the median CPU time of a side, seconds."""
    return statistics.median(side.cpu)


@contextmanager
def _start_side(root: Path, arguments: list[str]) -> Iterator[Side]:
    """Start the process of a job on one tree, with one thread, and end it."""
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    environment = os.environ | one_thread | {"PYTHONPATH": str(root)}
    # Without -P, modules of the benchmarks would be found before packages of the same name.
    command = [sys.executable, "-P", str(ROOT / "benchmarks" / "jobs.py"), *arguments]
    with subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        try:
            yield Side(process)
        finally:
            process.kill()
