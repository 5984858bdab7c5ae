"""Faults put into the product one at a time, to see which tests find them: ``python -m tests.mutants``."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
COPIED = ("benchmarks", "cspace", "planners", "tests", "pyproject.toml")
MAX_SECONDS = 900.0
"""Time that a room's tests may take for one fault."""


@dataclass(frozen=True)
class Mutant:
    """A fault: one text of one file, replaced."""

    file: str
    old: str
    new: str
    tests: str
    """Folders and files of tests that must find the fault, separated by spaces."""
    equivalent: str = ""
    """Why no test can find the fault; empty if one must."""

    @property
    def name(self) -> str:
        """Name of the fault: the file and the new text."""
        return f"{self.file}: {' '.join(self.new.split())}"


MUTANTS = (
    # Rotations.
    Mutant(
        "cspace/rotations/base.py",
        "2.0 * math.sin(min(self.covering_angle, math.pi) / 2.0) * lever",
        "1.9 * math.sin(min(self.covering_angle, math.pi) / 2.0) * lever",
        "tests/rotations tests/laws",
    ),
    # Rasters.
    # Engines.
    # Record and updates.
    Mutant(
        "cspace/record/update.py",
        "first = np.maximum(changed_cells.min(axis=0) - highest_offset, 0)",
        "first = np.maximum(changed_cells.min(axis=0) - highest_offset + 1, 0)",
        "tests/laws tests/record/test_update.py",
    ),
    Mutant(
        "cspace/record/exterior.py",
        "reached = [*(low - outer.upper), *(high - outer.lower)]",
        "reached = [*(low - outer.upper + 1), *(high - outer.lower)]",
        "tests/laws tests/record/test_exterior.py",
    ),
    Mutant(
        "cspace/record/save.py",
        'if digest.hexdigest() != attributes["digest"]:',
        "if False:",
        "tests/record/test_save.py",
    ),
    Mutant(
        "cspace/space.py",
        "derived.drop(self)\n        # Checkers",
        "# Checkers",
        "tests/laws tests/record/test_update.py",
    ),
    # Look-ups and motions.
    Mutant(
        "cspace/queries/edges.py",
        "if not inside and map_.exterior[s, 2 * map_.dim] != FREE:",
        "if not inside and map_.exterior[s, 2 * map_.dim] == FREE:",
        "tests/laws",
    ),
    Mutant(
        "cspace/rotations/lookup.py",
        "- (1 if on_boundary else 0))",
        "- (0 if on_boundary else 0))",
        "tests/laws",
    ),
    Mutant(
        "cspace/queries/edges.py",
        "return closed_cells(min(begin, end) - SLACK,",
        "return closed_cells(min(begin, end) + SLACK,",
        "tests/laws",
    ),
    Mutant(
        "cspace/queries/points.py",
        "return count - 1 if cell == count and coordinate <= upper else cell",
        "return cell",
        "tests/laws tests/queries/test_points.py",
    ),
    # Components, distances and searches.
    Mutant(
        "cspace/queries/components.py",
        "links.append(pair_nodes)  # the space",
        "pass  # the space",
        "tests/queries/test_components.py",
    ),
    Mutant(
        "cspace/queries/distance.py",
        "spread += share * (1.0 - share)",
        "spread += 0.5 * share * (1.0 - share)",
        "tests/laws",
    ),
    Mutant(
        "cspace/queries/distance.py",
        "high = last + 1.0",
        "high = last + 0.0",
        "tests/queries/test_clearance.py",
    ),
    Mutant(
        "cspace/queries/search.py",
        "if is_inside and graph.states[number, u, v, w] == FREE:",
        "if is_inside and graph.states[number, u, v, w] <= 1:",
        "tests/queries/test_free_path.py",
    ),
    Mutant(
        "cspace/queries/lower_bound.py",
        "distance * (1.0 - ROUNDING_SHARE) / STRETCH - float(to_corners)",
        "distance * (1.0 - ROUNDING_SHARE) - float(to_corners)",
        "tests/queries/test_lengths.py",
    ),
    Mutant(
        "cspace/queries/widest.py",
        "near_level = min(level, levels[slice_of[other], i, j, k])",
        "near_level = levels[slice_of[other], i, j, k]",
        "tests/queries/test_widest.py",
    ),
    # Exact geometry.
    # Shapes and bodies.
    # Arms.
    # Planners: drives, states, results.
    # Planners: trajectories.
    # Files and exports.
    # Spectral.
    # Tiles.
    # Plot, view and command line.
)


def find_stale() -> list[str]:
    """Return the faults whose old text is not in its file exactly once."""
    return [
        mutant.name
        for mutant in MUTANTS
        if (ROOT / mutant.file).read_text(encoding="utf-8").count(mutant.old) != 1
    ]


def run_tests(mutant: Mutant) -> tuple[bool, float, str]:
    """Run a fault's tests on a copy of the tree with the fault.

    Returns
    -------
    died : bool
        True if a test failed.
    seconds : float
        Time until then.
    last : str
        Name of the first test that failed, or the last line of the output.
    """
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="cspace-mutant-") as name:
        folder = Path(name)
        for part in COPIED:
            source = ROOT / part
            if source.is_dir():
                ignored = shutil.ignore_patterns("__pycache__")
                shutil.copytree(source, folder / part, ignore=ignored)
            else:
                shutil.copy(source, folder / part)
        path = folder / mutant.file
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
        # The fault changes compiled code too, so each copy has an empty cache of its own.
        environment = {**os.environ, "PYTHONPATH": name, "CSPACE_TEST_CACHE": f"{name}/cache"}
        options = ["-x", "-q", "-n", "0", "--tb=no"]
        try:
            done = subprocess.run(
                [sys.executable, "-m", "pytest", *options, *mutant.tests.split()],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=MAX_SECONDS,
            )
        except subprocess.TimeoutExpired:
            return True, time.perf_counter() - start, "out of time"
    lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    last = lines[0] if lines else (done.stdout + done.stderr).strip().rpartition("\n")[2]
    return done.returncode == 1, time.perf_counter() - start, last


def main() -> int:
    """Test all faults, or those whose name contains a given text; return 1 if one survives."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("text", nargs="?", default="", help="only faults with this in their name")
    parser.add_argument("--jobs", type=int, default=1, help="faults to test side by side")
    parser.add_argument("--check", action="store_true", help="only look for each fault's old text")
    options = parser.parse_args()
    if stale := find_stale():
        print("\n".join(f"old text is not there exactly once: {name}" for name in stale))
        return 1
    if options.check:
        return 0
    chosen = [mutant for mutant in MUTANTS if options.text in mutant.name]
    survivors = 0
    with ThreadPoolExecutor(options.jobs) as pool:
        for mutant, (died, seconds, last) in zip(chosen, pool.map(run_tests, chosen), strict=True):
            survived = not died and not mutant.equivalent
            survivors += survived
            verdict = (
                "died"
                if died
                else f"equivalent: {mutant.equivalent}"
                if mutant.equivalent
                else "SURVIVED"
            )
            print(f"{seconds:5.0f} s  {verdict:8}  {mutant.name}\n         {last}", flush=True)
    print(f"{survivors} of {len(chosen)} faults survived")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
