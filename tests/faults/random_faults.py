"""Random faults of a room, each in turn: do its quick tests find them?

``python -m tests.mutants random cspace/lanes`` changes one operator, constant, comparison or branch at a
time, outside compiled functions, which would be compiled anew.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests.faults.sites import Site, build_faults

ROOT = Path(__file__).parents[2]


def list_files(room: str) -> list[Path]:
    """List the modules of a room: a folder, or the files at the root of a package."""
    folder = ROOT / room
    is_package = folder.parent == ROOT
    return sorted(folder.glob("*.py") if is_package else folder.rglob("*.py"))


def list_tests(room: str) -> list[str]:
    """List the folder of a room's tests, or the files of a package's root."""
    package, *parts = Path(room).parts
    if package == "planners":
        return ["tests/planners"]
    if parts:
        return [f"tests/{parts[0].strip('_')}"]
    return [str(file.relative_to(ROOT)) for file in sorted((ROOT / "tests").glob("test_*.py"))]


def main(words: Sequence[str]) -> int:
    """Print each fault, with the test that finds it; return 1 if fewer than two thirds are."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants random", description=__doc__)
    parser.add_argument("room", help="folder of the product, such as cspace/lanes or planners")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", nargs="*", help="in place of the room's own")
    options = parser.parse_args(words)
    sites: list[tuple[Path, int, Site]] = []
    for file in list_files(options.room):
        found = build_faults(file.read_text(encoding="utf-8"), {})[1]
        sites += [(file, k, site) for k, site in enumerate(found)]
    chosen = random.Random(options.seed).sample(sites, min(options.count, len(sites)))
    chosen.sort(key=lambda each: (each[0], each[1]))
    plan: dict[str, dict[int, int]] = {}
    for number, (file, k, _) in enumerate(chosen):
        plan.setdefault(str(file), {})[k] = number
    results = run_tests(plan, options.tests or list_tests(options.room))
    found_count = 0
    for number, (file, _, site) in enumerate(chosen):
        count, first = results[str(number)]
        found_count += bool(first)
        verdict = first or f"SURVIVED, reached by {count} tests"
        print(f"{file.relative_to(ROOT)}:{site.line}: {site.before:.60} => {site.after:.60}")
        print(f"    {verdict}")
    print(
        f"{options.room}: {found_count} of {len(chosen)} found, seed {options.seed}, of {len(sites)} sites"
    )
    return int(3 * found_count < 2 * len(chosen))


def run_tests(plan: dict[str, dict[int, int]], tests: list[str]) -> dict[str, tuple[int, str]]:
    """Run quick tests with planned faults.

    Returns, by the fault's number, how many tests reach it, and the first that fails or nothing.
    """
    with tempfile.TemporaryDirectory(prefix="cspace-faults-") as folder:
        plan_file, results = Path(folder, "plan.json"), Path(folder, "results.json")
        plan_file.write_text(json.dumps(plan), encoding="utf-8")
        startup = Path(__file__).parent / "startup"
        names = {"CSPACE_FAULTS": plan_file, "CSPACE_FAULTS_RESULTS": results}
        names |= {"CSPACE_FAULTS_REACHED": Path(folder, "reached")}
        environment = {**os.environ, **{name: str(value) for name, value in names.items()}}
        environment["PYTHONPATH"] = os.pathsep.join([str(startup), str(ROOT)])
        environment["PYTHONDONTWRITEBYTECODE"] = "1"
        command = [sys.executable, "-m", "pytest", "-q", "-n0", "-p", "tests.faults.plugin"]
        options = ["-p", "no:cacheprovider", "-s", *tests]
        done = subprocess.run([*command, *options], cwd=ROOT, env=environment, check=False)
        if not results.exists():
            raise SystemExit(done.returncode or 1)
        return dict(json.loads(results.read_text(encoding="utf-8")))
