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
        "chord = 2.0 * math.sin(min(self.covering_angle, math.pi) / 2.0)",
        "chord = 1.9 * math.sin(min(self.covering_angle, math.pi) / 2.0)",
        "tests/raster/test_turns.py",
    ),
    Mutant(
        "cspace/rotations/quaternion.py",
        'cosines = np.einsum("mki,mi->mk", corners, center).min(axis=1)',
        'cosines = np.einsum("mki,mi->mk", corners, center).mean(axis=1)',
        "tests/rotations/test_quaternion.py",
    ),
    Mutant(
        "cspace/rotations/yaw.py",
        'np.searchsorted(self.borders, in_cells, side="right") - 1',
        'np.searchsorted(self.borders, in_cells, side="left") - 1',
        "tests/rotations/test_yaw.py",
    ),
    # Rasters.
    Mutant(
        "cspace/raster/boxes.py",
        "k_last = min(last_z, math.floor(high_z + half_chord - b0))",
        "k_last = min(last_z, math.floor(high_z + half_chord - b0)) - 1",
        "tests/raster/test_boxes.py",
    ),
    Mutant(
        "cspace/raster/boxes.py",
        "grown = RoundedBoxes(boxes.lows - SLACK, boxes.highs + SLACK, radii)",
        "grown = RoundedBoxes(boxes.lows + SLACK, boxes.highs - SLACK, radii)",
        "tests/raster/test_boxes.py",
    ),
    Mutant(
        "cspace/raster/segments.py",
        "mark_touched(near_boundary, segments, growth, 0.0, 0.0, SLACK)",
        "mark_touched(near_boundary, segments, 0.8 * growth, 0.0, 0.0, SLACK)",
        "tests/raster/test_turns.py",
    ),
    Mutant(
        "cspace/raster/triangles.py",
        "displacement = swept.swing * min(swept.farthest[t], max_lever)",
        "displacement = swept.swing * min(swept.nearest[t], max_lever)",
        "tests/raster/test_turns.py",
    ),
    # Engines.
    Mutant(
        "cspace/engines/fft.py",
        'ROUNDOFFS: Final = {"float32": 2.0**-24,',
        'ROUNDOFFS: Final = {"float32": 2.0**-32,',
        "tests/engines/test_fft.py",
    ),
    Mutant(
        "cspace/engines/fft.py",
        "tiling = Tiling(lower, size, size - reach, precision)",
        "tiling = Tiling(lower, size, size - reach + 1, precision)",
        "tests/engines",
    ),
    Mutant(
        "cspace/engines/dilation.py",
        "rows = round_up(shape[1] + max(rows_before, rows_after))",
        "rows = round_up(shape[1] + min(rows_before, rows_after))",
        "tests/engines",
    ),
    Mutant(
        "cspace/engines/slices.py",
        "sources = image_slices.min(axis=0).tolist()",
        "sources = image_slices.max(axis=0).tolist()",
        "tests/engines/test_slices.py",
    ),
    # Record and updates.
    # Look-ups and motions.
    # Components, distances and searches.
    # Exact geometry.
    Mutant(
        "cspace/exact/proofs.py",
        "parts[pending, 0] = center + proven",
        "parts[pending, 0] = center + 2.0 * proven",
        "tests/exact/test_plane.py",
    ),
    Mutant(
        "cspace/exact/proofs.py",
        "elif not containment.outer[i, j, m]:",
        "elif not containment.inner[i, j, m]:",
        "tests/exact/test_plane.py",
    ),
    Mutant(
        "cspace/exact/proofs.py",
        "best = min(best, distance - spans[k])",
        "best = max(best, distance - spans[k])",
        "tests/exact/test_plane.py",
    ),
    Mutant(
        "cspace/exact/boundaries.py",
        "if high[axis] > grid.upper[axis]:",
        "if high[axis] > grid.upper[axis] + 1.0:",
        "tests/exact/test_boundaries.py",
    ),
    # Shapes and bodies.
    Mutant(
        "cspace/bodies/triangles.py",
        "gap_below = min(a1, a2, 0.0) - max(b0, b1, b2)",
        "gap_below = min(a1, a2, 0.0) - max(b0, b1)",
        "tests/bodies/test_triangles.py",
    ),
    Mutant(
        "cspace/bodies/triangles.py",
        "        and _side_of_plane(p, (q, b[2], b[0]), tolerance) == turn\n",
        "",
        "tests/bodies/test_triangles.py",
    ),
    Mutant(
        "cspace/bodies/hulls.py",
        "slack = math.sqrt(squared_distance) - ball_radius - motion.required - speed",
        "slack = math.sqrt(squared_distance) - ball_radius - motion.required",
        "tests/bodies/test_hulls.py",
    ),
    Mutant(
        "cspace/shapes/bodies.py",
        "is_outside = winding.evaluate(corners) <= 0",
        "is_outside = winding.evaluate(corners) < 0",
        "tests/shapes/test_bodies.py",
    ),
    Mutant(
        "cspace/shapes/balls.py",
        "return rounded_rasters(balls, spacing, margin + growth, growth)",
        "return rounded_rasters(balls, spacing, margin + growth, 0.0 * growth)",
        "tests/raster/test_turns.py",
    ),
    Mutant(
        "cspace/shapes/balls.py",
        "first_corners = len(corners) * np.arange(len(self.radii))",
        "first_corners = len(self.radii) * np.arange(len(self.radii))",
        "tests/shapes/test_shape.py",
    ),
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
