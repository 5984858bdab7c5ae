"""First jobs of a new user in new processes, before and after their functions are compiled."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from benchmarks.first_process import DEMO
from benchmarks.report import Report
from cspace._cli.demo import write_inputs

MAX_DEMO_COMPILATIONS: Final = 67
"""Most functions that the demo compiles on an empty cache; a test counts them."""

MAX_COLD_SECONDS: Final = {
    DEMO: 8.0,
    "plan with a yaw": 9.0,
    "plan with a differential drive": 14.0,
    "plan in space": 8.0,
    "plan for an arm": 14.0,
}
"""Targets: CPU seconds of each job on an empty cache."""

WARM_RUNS: Final = 5
"""Runs of each job after its functions are compiled."""


def run(report: Report, seed: int) -> None:
    """Measure each job on an empty cache, and again."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_inputs(folder)
        # Python's own compiled modules are written when a package is installed, so they are not
        # counted.
        run_process("plan in space", folder, folder / "modules")
        for job, max_seconds in MAX_COLD_SECONDS.items():
            report.section(job)
            cache = folder / job
            cold = run_process(job, folder, cache)
            report.figure("CPU time on an empty cache", cold["cpu_s"], "s", most=max_seconds)
            most = MAX_DEMO_COMPILATIONS if job == DEMO else None
            report.figure("compilations", cold["compilations"], "", most=most)
            warm = [
                run_process(job, folder, cache) for _ in range(1 if report.quick else WARM_RUNS)
            ]
            report.figure(
                "CPU time afterwards, median",
                statistics.median(each["cpu_s"] for each in warm),
                "s",
            )
            report.check(
                not any(each["compilations"] for each in warm), "nothing is compiled again"
            )


def run_process(job: str, folder: Path, cache: Path) -> dict[str, float]:
    """Run a job in a new process; return its figures.

    ``folder`` has the inputs of the demo, and ``cache`` is the folder of compiled code.
    """
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    folders = {"NUMBA_CACHE_DIR": str(cache), "PYTHONPYCACHEPREFIX": str(folder / "modules")}
    others = {
        name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
    }
    command = [sys.executable, "-m", "benchmarks.first_process", job, str(folder)]
    root = Path(__file__).resolve().parents[2]
    environment = others | one_thread | folders
    done = subprocess.run(
        command, cwd=root, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    figures: dict[str, float] = json.loads(done.stdout)
    return figures
