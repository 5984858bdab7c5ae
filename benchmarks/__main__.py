"""Command line of the benchmarks."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.report import Report, write_whole

BENCHMARKS = {
    "against": "users' jobs on another commit and on this tree in turn: against REV, by default HEAD",
    "peers": "engines against all peers: promises, bare transforms, memory; cost over sizes; table and plot",
    "update": "a map after a box of its workspace changed, against a build of the whole",
    "classify": "10^7 look-ups against the same look-up as a numpy expression",
    "edges": "10^6 edges of 50 cells in one call, against OMPL's discrete validator; turns and solids too",
    "callbacks": "OMPL's isValid and checkMotion on our checkers, against an empty checker and the discrete validator",
    "cpp": "the C++ header on a saved map: states and motions, equal to Python's",
    "nav2": "the plugin for Nav2 in a room with crates, against the planner of the node: solved, touches, length, CPU",
    "planning": "time to a first solution on real maps, against OMPL with a callback of prepared shapely or of FCL",
    "paths": "lengths of default paths, against OMPL on equal collision checks; drives",
    "replanning": "plans anew among moving obstacles: the rate of each planner; plans on large maps",
    "trajectories": "durations on real maps and of arms, against the least conceivable; CPU times",
    "rotations": "SE(3) and R^3 x yaw: builds, look-ups, edges and plans, against FCL and a loop of fftconvolve",
    "arms": "poses, changing scenes and paths of arms, to 14 joints, upright too, against OMPL with coal and VAMP; false frees",
    "gates": "chunks of commands: roll-outs on a map, rows of a Panda, and checks of poses at a step beside them",
    "mesh": "100,000 triangles into 256^3 cells, beside trimesh's voxelizer: time, and cells that it misses",
    "frequency": "spectra of 10,000 balls, Minkowski sums, 10^5 overlaps, placements, each against another way; misses",
    "first_use": "CPU time and compilations of the demo and of first plans, in new processes, with and without a cache",
    "lanes": "audits of 10,000 lanes of 5 m on 4,000^2 x 72 cells, in memory and in tiles: CPU time, equal verdicts",
    "regions": "convex regions, corridors and covers; volumes, coverage and collisions beside Drake's Iris and IrisZo",
    "conflicts": "pairs of lanes and nodes on the depot, and pairs of trajectories: CPU time, undecided ones",
    "tiles": "maps in tiles: builds against memory, one and two workers, 65,536^2 cells and 16,384^2 x 16 yaws",
}

AGAINST = "against"
"""The benchmark whose name a commit may follow."""

SHARED_MODULES = {"classify": "lookups", "edges": "lookups", "callbacks": "lookups"}
"""Modules of benchmarks that are functions; other benchmarks are ``run`` of their module."""


def main(arguments: list[str] | None = None) -> int:
    """Run benchmarks; return 1 if a result was wrong, else 0."""
    listed = "\n".join(f"  {name:<10} {text}" for name, text in BENCHMARKS.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Peers and ours run alternately in one process. Different results fail the run; times are\n"
        "printed beside their targets and fail nothing.",
        epilog=f"benchmarks:\n{listed}\n  {'all':<10} all benchmarks",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "names", metavar="NAME", nargs="+", help="a benchmark, or all; a commit after against"
    )
    parser.add_argument(
        "--quick", action="store_true", help="smaller sizes and fewer runs, as a test"
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="also write the figures to FILE")
    parser.add_argument("--seed", type=int, default=0, help="seed of all random inputs (default 0)")
    parser.add_argument(
        "--output",
        metavar="FOLDER",
        type=Path,
        help="peers: write benchmarks.md and benchmarks.png into FOLDER if all results are right; "
        "replanning: pictures of the slowest plans",
    )
    parser.add_argument(
        "--from",
        dest="file",
        metavar="FILE",
        type=Path,
        help="peers: run nothing, use the figures that --json wrote",
    )
    options = parser.parse_args(arguments)
    names, revision = split_revision(options.names)
    for name in names:
        if name not in [*BENCHMARKS, "all"]:
            parser.error(f"{name} is no benchmark; they are {', '.join(BENCHMARKS)}, and all")
    folder = options.output
    if options.file is not None:
        whole = json.loads(options.file.read_text(encoding="utf-8"))
        if whole["failures"] or not any("sweep" in row for row in whole["rows"]):
            parser.error(f"{options.file} is not a correct run of peers; make one with --json")
        write_page(whole, folder or Path.cwd())
        return 0

    arguments = [*options.names, *(["--quick"] if options.quick else [])]
    report = Report(options.quick, f"python -m benchmarks {shlex.join(arguments)}", folder)
    if "all" in names:
        names = list(BENCHMARKS)
    for name in names:
        report.start(name)
        module = import_module(f"benchmarks.suites.{SHARED_MODULES.get(name, name)}")
        function = getattr(module, name if name in SHARED_MODULES else "run")
        function(report, options.seed, *(revision if name == AGAINST else []))
    if options.json is not None:
        report.write(options.json)
    if "peers" in names and folder is not None and not report.failures:
        write_page(report.whole(), folder)
    print()
    for failure in report.failures:
        print(f"FAILED {failure}")
    missed = sum(row.get("met") is False for row in report.rows)
    print(f"{len(report.failures)} failed checks, {missed} missed targets")
    return 1 if report.failures else 0


def split_revision(names: list[str]) -> tuple[list[str], list[str]]:
    """Split off the commit that may follow ``against``."""
    after = names.index(AGAINST) + 1 if AGAINST in names else len(names)
    revision = [name for name in names[after : after + 1] if name not in [*BENCHMARKS, "all"]]
    return names[:after] + names[after + len(revision) :], revision


def write_page(whole: Mapping[str, Any], folder: Path) -> None:
    """Write the table and the plot of a run that includes ``peers``."""
    from benchmarks.suites import page

    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "benchmarks.png", page.draw(whole["rows"]))
    write_whole(folder / "benchmarks.md", page.write(whole, "benchmarks.png").encode())
    print(f"\nwritten: {folder / 'benchmarks.md'}, {folder / 'benchmarks.png'}")


if __name__ == "__main__":
    sys.exit(main())
