"""Command line of the fuzz."""

from __future__ import annotations

import argparse
import secrets
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

from benchmarks.report import Report
from tests.fuzz import (
    arms,
    contact,
    cpp,
    curves,
    drives,
    files,
    frequency,
    lanes,
    lengths,
    maps,
    use,
)

FAMILIES: dict[str, Callable[[Report, int, int], None]] = {
    "maps": lambda report, seed, checks: maps.check(report, seed, checks, checks // 100),
    "contact": lambda report, seed, checks: contact.check(report, seed, 100 * checks),
    "curves": lambda report, seed, checks: curves.check(report, seed, checks // 200),
    "cpp": lambda report, seed, _: cpp.check(report, seed),
    "drives": lambda report, seed, _: drives.check(report, seed, 1 if report.quick else 200),
    "exact": lambda report, seed, checks: maps.check_exact(report, seed, checks // 400),
    "arms": lambda report, seed, checks: arms.check(report, seed, checks // 10, checks // 500),
    "frequency": lambda report, seed, checks: frequency.check(report, seed, checks // 10),
    "lanes": lambda report, seed, checks: lanes.check(report, seed, checks // 250),
    "lengths": lambda report, seed, checks: lengths.check(report, seed, checks // 250),
    "files": lambda report, seed, checks: files.check(report, seed, checks // 250),
    "examples": lambda report, seed, _: None if report.quick else check_examples(report, seed),
    "use": lambda report, seed, _: use.check(report, seed, *((5, 0.05) if report.quick else ())),
}
"""Checks by name; they get a report, a seed and the number of checks of FREE and BLOCKED."""


def check_examples(report: Report, seed: int) -> None:
    """Run all tests of hypothesis with new examples."""
    start = time.perf_counter()
    options = ["-q", "-m", "hypothesis", f"--hypothesis-seed={seed}"]
    command = [sys.executable, "-m", "pytest", *options]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    report.section(f"tests with new examples, seed {seed}, {time.perf_counter() - start:.0f} s")
    if done.returncode:
        report.note(done.stdout + done.stderr)
    report.check(done.returncode == 0, "every test holds for new examples")


def main() -> int:
    """Run the checks; return the number of failures, at most 1."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz",
        description="Check random maps, curves, arms and pairs of shapes against exact geometry, open damaged files, "
        "and use maps in threads and processes. Each run draws new cases; --seed repeats those of an earlier run. "
        "CONTRIBUTING.md says how a failing case becomes a test.",
    )
    names = f"of {', '.join(FAMILIES)} (default all)"
    parser.add_argument("names", metavar="NAME", nargs="*", help=names)
    parser.add_argument("--quick", action="store_true", help="a few minutes instead of hours")
    parser.add_argument("--seed", type=int, help="seed of everything random (default: a new one)")
    repeat = "repeat quick rounds, each with the next seed, until this time is over"
    parser.add_argument("--minutes", type=float, default=0.0, help=repeat)
    size = "checks of FREE and BLOCKED (default 10^6, with --quick 50,000)"
    parser.add_argument("--checks", type=int, help=size)
    options = parser.parse_args()
    if unknown := sorted({*options.names} - {*FAMILIES}):
        parser.error(f"unknown {', '.join(unknown)}; choose from {', '.join(FAMILIES)}")
    report = Report(options.quick or options.minutes > 0.0)
    seed = secrets.randbits(32) if options.seed is None else options.seed
    checks = options.checks or (50_000 if report.quick else 1_000_000)
    end = time.monotonic() + 60.0 * options.minutes
    for round_seed in count(seed):
        report.note(f"--seed {round_seed} draws the same cases again")
        for name in options.names or FAMILIES:
            report.start(name)
            FAMILIES[name](report, round_seed, checks)
        if report.failures or time.monotonic() >= end:
            break
    print(*(f"\nFAILED {failure}" for failure in report.failures))
    print(f"{len(report.failures)} failed checks")
    return 1 if report.failures else 0


if __name__ == "__main__":
    sys.exit(main())
