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
    # Look-ups and motions.
    # Components, distances and searches.
    # Exact geometry.
    # Shapes and bodies.
    # Arms.
    # Planners: drives, states, results.
    # Planners: trajectories.
    # Files and exports.
    # Spectral.
    Mutant(
        "cspace/spectral/trees.py",
        "if square > (reach + slack) * (reach + slack):",
        "if square > (reach - slack) * (reach - slack):",
        "tests/spectral/test_contacts.py",
    ),
    Mutant(
        "cspace/spectral/bands.py",
        "(np.append(remaining, 0.0) + tail + np.append(0.0, summed))",
        "(np.append(remaining, 0.0) + np.append(0.0, summed))",
        "tests/spectral/test_bands.py",
    ),
    Mutant(
        "cspace/spectral/bump.py",
        "share = (b - a) / distance",
        "share = (a - b) / distance",
        "tests/spectral/test_bump.py",
    ),
    Mutant(
        "cspace/spectral/overlap.py",
        "matrix @ self.pair.rotation",
        "self.pair.rotation @ matrix",
        "tests/spectral/test_overlap.py",
    ),
    Mutant(
        "cspace/spectral/decompose.py",
        "stop = math.floor(center + length + 0.5)",
        "stop = math.ceil(center + length + 0.5)",
        "tests/spectral/test_decompose.py",
    ),
    Mutant(
        "cspace/spectral/regions.py",
        "np.abs(points[block] - centers[nearest]) + half",
        "np.abs(points[block] - centers[nearest])",
        "tests/spectral/test_decompose.py",
    ),
    Mutant(
        "cspace/spectral/descriptors.py",
        "np.where(pairs > 0.5,",
        "np.where(pairs > 0.0,",
        "tests/spectral/test_descriptors.py",
    ),
    Mutant(
        "cspace/spectral/field.py",
        "place = min(max(place, 0.0), count - 1.0)",
        "place = min(max(place, 0.0), count - 1.5)",
        "tests/spectral/test_field.py",
    ),
    # Tiles.
    # Plot, view and command line.
    Mutant(
        "cspace/plot/surface.py",
        "if not towards[axis] or 2 * layers >= len(shares):",
        "if not towards[axis] or 2 * layers > len(shares):",
        "tests/plot/test_surface.py",
    ),
    Mutant(
        "cspace/plot/route.py",
        "np.cumsum(equals_waypoint.any(axis=1)) - 1",
        "np.cumsum(equals_waypoint.any(axis=1))",
        "tests/plot/test_picture.py",
    ),
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
