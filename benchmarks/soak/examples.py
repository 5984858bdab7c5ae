"""The tests that draw examples, with new examples."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchmarks.report import Report

ROOT = Path(__file__).parents[2]


def check(report: Report, seed: int) -> None:
    """Run all tests with hypothesis, whose README run draws the same examples each time, with new ones."""
    began = time.perf_counter()
    options = ["-q", "-m", "hypothesis", "--hypothesis-profile=new", f"--hypothesis-seed={seed}"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options], cwd=ROOT, capture_output=True, text=True, check=False
    )
    report.section(f"tests with new examples, seed {seed}, {time.perf_counter() - began:.0f} s")
    if done.returncode:
        report.note(done.stdout + done.stderr)
    report.check(done.returncode == 0, "every test holds for new examples")
