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
    Mutant(
        "planners/local_planner.py",
        "return drive, turn_before, turn_after",
        "return drive, turn_before, turn_before",
        "tests/planners/test_local_planner.py",
    ),
    Mutant(
        "planners/local_planner.py",
        "self.cells.clearance(q) - 0.5 * pieces.lengths[rows]",
        "self.cells.clearance(q) - 0.25 * pieces.lengths[rows]",
        "tests/planners/test_result.py",
    ),
    Mutant(
        "planners/local_planner.py",
        "return exists is True",
        "return exists is not False",
        "tests/planners/test_without_path.py",
    ),
    Mutant(
        "planners/local_planner.py",
        "radians = self.rotation_weight * float(np.linalg.norm(rotation))",
        "radians = 2.0 * self.rotation_weight * float(np.linalg.norm(rotation))",
        "tests/planners/test_objectives.py",
    ),
    Mutant(
        "planners/car_curves.py",
        "turned = half if steer != 0 else 0.0",
        "turned = 0.0",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/car_curves.py",
        "return (t, -quarter, 2.0 - straight, phi - quarter - t, 0.0)",
        "return (t, -quarter, straight - 2.0, phi - quarter - t, 0.0)",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/car_curves.py",
        "if totals[row] <= shortest + tie:",
        "if totals[row] < shortest:",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/lattice.py",
        "reach_cell(estimate, progress, state, heading, 0, i - dx, j - dy, cost)",
        "reach_cell(estimate, progress, state, heading, 0, i + dx, j + dy, cost)",
        "tests/planners/test_lattice.py",
    ),
    Mutant(
        "planners/lattice.py",
        "drive_costs=np.hypot(steps[:, 0], steps[:, 1])",
        "drive_costs=np.abs(steps).sum(axis=1) ** 2.0",
        "tests/planners/test_lattice.py",
    ),
    Mutant(
        "planners/plan.py",
        "proven=len(rows) > 0 and part.are_free(rows)",
        "proven=len(rows) > 0",
        "tests/planners/test_plan.py",
    ),
    Mutant(
        "planners/plan.py",
        "task.endpoints[max(reached, 1)]",
        "task.endpoints[1]",
        "tests/planners/test_pose_goals.py",
    ),
    Mutant(
        "planners/result.py",
        "return self._edges_on(space).edges_are_free(self.waypoints)",
        "return self._edges_on(self.space or space).edges_are_free(self.waypoints)",
        "tests/planners/test_result.py",
    ),
    Mutant(
        "planners/search.py",
        "return seconds_late < 0.0",
        "return seconds_late < GRACE_SECONDS",
        "tests/planners/test_deadline.py",
    ),
    Mutant(
        "planners/integrals.py",
        "share = (step + 0.5) / steps",
        "share = (step + 1.0) / steps",
        "tests/planners/test_objectives.py",
    ),
    # Planners: trajectories.
    Mutant(
        "planners/trajectory.py",
        "phases.accelerations / factor**2",
        "phases.accelerations / factor",
        "tests/planners/test_trajectory.py",
    ),
    Mutant(
        "planners/trajectory.py",
        "(linear / moved).min(axis=1)",
        "(linear / moved).max(axis=1)",
        "tests/planners/test_trajectory.py",
    ),
    Mutant(
        "planners/trajectory.py",
        "squares[k] = min(squares[k], squares[k + 1] + gains[k])",
        "squares[k] = min(squares[k], squares[k + 1] + gains[k - 1])",
        "tests/planners/test_trajectory.py",
    ),
    Mutant(
        "planners/trajectory.py",
        "half_turns = 0.5 * curvatures * length",
        "half_turns = -0.5 * curvatures * length",
        "tests/planners/test_trajectory.py",
    ),
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
