"""What the command line and the import add to starting Python."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

from benchmarks.report import Report
from benchmarks.timing import interleave

ROOT = Path(__file__).resolve().parents[2]


def run(report: Report, seed: int) -> None:
    """Medians of fresh processes, one after the other."""
    report.section("fresh processes, files in the system's cache")
    commands = {
        "python": ["-c", "pass"],
        "cspace --help": ["-m", "cspace", "--help"],
        "import numpy, scipy": ["-c", "import numpy, scipy"],
        "import numpy, scipy, cspace": ["-c", "import numpy, scipy, cspace"],
        "... and every public name of cspace": [
            "-c",
            "import numpy, scipy, cspace\nfor name in cspace.__all__: getattr(cspace, name)",
        ],
    }
    timings = interleave({name: partial(_start, rest) for name, rest in commands.items()}, 3 if report.quick else 11)
    for name, timing in timings.items():
        report.timing(name, timing)
    medians = {name: timing.median for name, timing in timings.items()}
    report.figure("cspace --help, beyond python", medians["cspace --help"] - medians["python"], "s", most=0.3)
    numpy = medians["import numpy, scipy"]
    report.figure("import cspace, beyond numpy, scipy", medians["import numpy, scipy, cspace"] - numpy, "s", most=0.5)
    report.figure("with every public name", medians["... and every public name of cspace"] - numpy, "s")
    report.check("Usage" in timings["cspace --help"].value, "cspace --help tells its usage")


def _start(arguments: list[str]) -> str:
    """Run Python in a process of its own; what it prints."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": path}
    )
    return done.stdout
