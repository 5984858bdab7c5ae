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
    # Tiles.
    Mutant(
        "cspace/tiles/folder.py",
        "return math.ceil(metres / frame.grid.spacing) + 2",
        "return math.ceil(metres / frame.grid.spacing) - 2",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/tiles/labels.py",
        "yield last, nodes[beyond][axis][0] if beyond in nodes else outside",
        "yield last, outside",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/tiles/labels.py",
        "yield self.exterior, padded[neighbors]",
        "yield self.exterior, self.exterior",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/tiles/parts.py",
        "rows = np.flatnonzero(out & (inside == is_inside))",
        "rows = np.flatnonzero(out & inside)",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/tiles/parts.py",
        "part, rows in self.parts_near(cells, folder.halo, is_inside)",
        "part, rows in self.parts_near(cells, 1, is_inside)",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/tiles/parts.py",
        "mixed = np.reshape(mixed_cells, (2, -1)) + ONE_MORE - first",
        "mixed = np.reshape(mixed_cells, (2, -1)) - first",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/tiles/parts.py",
        "lowest[here] = np.minimum(lowest[here], ",
        "lowest[here] = np.minimum(BLOCKED, ",
        "tests/tiles/test_window.py",
    ),
    Mutant(
        "cspace/tiles/motions.py",
        "half_turns = np.flatnonzero(angles >= HALF_TURN)",
        "half_turns = np.flatnonzero(angles >= 2.0 * HALF_TURN)",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/tiles/folder.py",
        "if tile.grid != self.sub_grid(self.locate_tile(index)):",
        "if tile.grid.shape != self.sub_grid(self.locate_tile(index)).shape:",
        "tests/tiles/test_build.py",
    ),
    # Plot, view and command line.
    Mutant(
        "cspace/view/viewer.py",
        "return is_local(server.hostname) or not is_local(host)",
        "return True",
        "tests/view/test_viewer.py",
    ),
    Mutant(
        "cspace/view/scene.py",
        "is_clockwise = (up == 1) == (axis == 1)",
        "is_clockwise = up == 1",
        "tests/view/test_scene.py",
    ),
    Mutant(
        "cspace/view/map_canvas.py",
        "if never_drawn or self._drawn[name] != wanted:",
        "if never_drawn:",
        "tests/view/test_viewer.py",
    ),
    Mutant(
        "cspace/cli/options.py",
        "if not unit and math.isfinite(value) and abs(value) > 2.0 * math.pi:",
        "if not unit and math.isfinite(value) and value > 2.0 * math.pi:",
        "tests/cli/test_options.py",
    ),
    Mutant(
        "cspace/cli/files.py",
        "if names != list(axes):",
        "if len(names) != len(axes):",
        "tests/cli/test_errors.py",
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
