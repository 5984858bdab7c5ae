"""The soak of saves, threads, processes and long use, for seconds."""

import subprocess
import sys
from pathlib import Path

SOAK_SCRIPT = """
from benchmarks.report import Report
from tests.soak import use

report = Report(True)
use.check(report, 0, 2, 0.01)
raise SystemExit(len(report.failures))
"""


def test_saves_processes_threads_and_long_use_have_no_failures() -> None:
    command, root = [sys.executable, "-c", SOAK_SCRIPT], Path(__file__).parents[1]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
