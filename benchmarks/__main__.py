"""Command line of the benchmarks."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

from benchmarks.report import Report

BENCHMARKS = {
    "map": "outer map of 4096 x 4096 cells against fftconvolve, oaconvolve, the bare transforms, dilation; memory",
    "classify": "10^7 look-ups against the same look-up as a numpy expression",
    "callbacks": "OMPL's isValid and checkMotion on our checkers, against an empty checker and the discrete validator",
    "planning": "time to a first solution on real maps, against OMPL with a prepared-shapely callback",
    "turning": "robots that turn: fftconvolve for each yaw, bare transforms, memory, stamping, planning",
    "solid_map": "outer map of 256^3 cells against fftconvolve, the bare transforms, dilation; memory of 512^3 cells",
    "mesh": "100,000 triangles into 256^3 cells, beside trimesh's voxelizer: time, and cells that it misses",
    "solid_planning": "time to a first solution in space, against OMPL with an FCL callback",
    "startup": "seconds that `cspace --help` and `import cspace` add to Python and numpy",
    "raster": "robot rasters up to 500 cells across: cost against boundary, results against shapely",
    "soak": "every FREE, BLOCKED and free edge or curve against exact geometry, in plane and space; the band",
}


def main(arguments: list[str] | None = None) -> int:
    """Run benchmarks; 0 where all results were right, whatever they took, and 1 otherwise."""
    listed = "\n".join(f"  {name:<15} {text}" for name, text in BENCHMARKS.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Peers and ours in one process, taken in turns. Results must be equal or the run fails; times are\n"
        "printed beside their targets and fail nothing.",
        epilog=f"benchmarks:\n{listed}\n  {'all':<15} every one of them",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", metavar="NAME", choices=[*BENCHMARKS, "all"], help="which benchmark, or all")
    parser.add_argument("--quick", action="store_true", help="smaller sizes and fewer runs, to see that all works")
    parser.add_argument("--json", metavar="FILE", type=Path, help="also write the figures to FILE")
    parser.add_argument("--seed", type=int, default=0, help="seed of everything random (default 0)")
    parser.add_argument("--checks", type=int, default=None, help="soak: checks of FREE and BLOCKED (default 10^6)")
    options = parser.parse_args(arguments)

    report = Report(options.quick)
    for name in BENCHMARKS if options.name == "all" else [options.name]:
        report.start(name)
        run = import_module(f"benchmarks.{name}").run
        if name == "soak":
            run(report, options.seed, options.checks)
        else:
            run(report, options.seed)
    if options.json is not None:
        report.write(options.json)
    print()
    for failure in report.failures:
        print(f"FAILED {failure}")
    missed = sum(row.get("met") is False for row in report.rows)
    print(f"{len(report.failures)} failed checks, {missed} missed targets")
    return 1 if report.failures else 0


if __name__ == "__main__":
    sys.exit(main())
