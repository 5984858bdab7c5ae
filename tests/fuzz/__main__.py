"""Command line of the fuzz."""

from __future__ import annotations

import argparse
import os
import secrets
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from itertools import count
from pathlib import Path

from benchmarks.report import Report
from tests.fuzz import arms, contact, cpp, files, use

PROOFS = "tests/test_proofs.py::test_"

LAWS = {
    "maps": (f"{PROOFS}proofs_of_random_maps_agree_with_independent_geometry", "tests/laws"),
    "exact": (f"{PROOFS}what_geometry_alone_proves_agrees_with_independent_geometry",),
    "curves": ("tests/planners/test_car_curves.py",),
    "frequency": ("tests/spectral/test_contacts.py",),
    "lanes": ("tests/lanes/test_random_graphs.py",),
    "lengths": ("tests/planners/test_lengths.py",),
    "plans": ("tests/laws/test_any_plan.py",),
    "examples": ("tests",),
}
"""Tests of hypothesis that draw new examples, by name."""

FAMILIES: dict[str, Callable[[Report, int, int], None]] = {
    "contact": lambda report, seed, checks: contact.check(report, seed, 100 * checks),
    "cpp": lambda report, seed, _: cpp.check(report, seed),
    "arms": lambda report, seed, checks: arms.check(report, seed, checks // 10, checks // 500),
    "files": lambda report, seed, checks: files.check(report, seed, checks // 250),
    "use": lambda report, seed, _: use.check(report, seed, *((5, 0.05) if report.quick else ())),
}
"""Checks of fuzzing alone by name; they get a report, a seed and a number of checks."""


def check_laws(report: Report, seed: int, names: Iterable[str]) -> None:
    """Run tests of hypothesis with new examples."""
    start = time.perf_counter()
    profile = "fuzz" if report.quick else "soak"
    options = (*("-q", "-n0", "-m", "hypothesis"), f"--hypothesis-profile={profile}")
    tests = [test for name in names for test in LAWS[name]]
    command = [sys.executable, "-m", "pytest", *options, f"--hypothesis-seed={seed}", *tests]
    # The tests use the compiled code of this process.
    cache = os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))
    done = subprocess.run(
        command,
        cwd=Path(__file__).parents[2],
        env={"CSPACE_TEST_CACHE": cache} | os.environ,
        capture_output=True,
        text=True,
        check=False,
    )
    report.section(f"laws with new examples, seed {seed}, {time.perf_counter() - start:.0f} s")
    if done.returncode:
        report.note(done.stdout + done.stderr)
    report.check(done.returncode == 0, f"each law of {', '.join(names)} holds")


def main() -> int:
    """Run the checks; return the number of failures, at most 1."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz",
        description="Draw new examples for the laws of the tests, check random arms and pairs of boxes against exact "
        "geometry, open damaged files, and use maps in threads and processes. Each run draws new cases; --seed repeats those of an earlier run. "
        "CONTRIBUTING.md says how a failing case becomes a test.",
    )
    names = f"of {', '.join((*LAWS, *FAMILIES))} (default all; with --quick, all but examples)"
    parser.add_argument("names", metavar="NAME", nargs="*", help=names)
    parser.add_argument("--quick", action="store_true", help="a few minutes instead of hours")
    parser.add_argument("--seed", type=int, help="seed of everything random (default: a new one)")
    repeat = "repeat quick rounds, each with the next seed, until this time is over"
    parser.add_argument("--minutes", type=float, default=0.0, help=repeat)
    size = "checks of FREE and BLOCKED beside the laws (default 10^6, with --quick 50,000)"
    parser.add_argument("--checks", type=int, help=size)
    options = parser.parse_args()
    if unknown := sorted({*options.names} - {*LAWS, *FAMILIES}):
        parser.error(f"unknown {', '.join(unknown)}; choose from {', '.join((*LAWS, *FAMILIES))}")
    report = Report(options.quick or options.minutes > 0.0)
    names = options.names or [*LAWS, *FAMILIES]
    laws = [name for name in LAWS if name in names and not (report.quick and name == "examples")]
    seed = secrets.randbits(32) if options.seed is None else options.seed
    checks = options.checks or (50_000 if report.quick else 1_000_000)
    end = time.monotonic() + 60.0 * options.minutes
    for round_seed in count(seed):
        report.note(f"--seed {round_seed} draws the same cases again")
        if laws:
            report.start("laws")
            check_laws(report, round_seed, laws)
        for name in (name for name in FAMILIES if name in names):
            report.start(name)
            FAMILIES[name](report, round_seed, checks)
        if report.failures or time.monotonic() >= end:
            break
    print(*(f"\nFAILED {failure}" for failure in report.failures))
    print(f"{len(report.failures)} failed checks")
    return 1 if report.failures else 0


if __name__ == "__main__":
    sys.exit(main())
