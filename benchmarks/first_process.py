"""Run one of the first jobs of a new user, and print its CPU time and number of compilations as
JSON.

Usage: ``python -m benchmarks.first_process JOB FOLDER``; the folder has the inputs of the demo.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
from pathlib import Path

from numba.core import event

from cspace._cli import app
from cspace._cli.jobs import JOBS

DEMO = "demo"
"""The job that is a command."""


def main() -> None:
    """Run the job, and print the figures."""
    name, folder = sys.argv[1], Path(sys.argv[2])
    with (
        event.install_recorder("numba:compile") as recorder,
        contextlib.redirect_stdout(io.StringIO()),
    ):
        if name == DEMO:
            app(["demo", "--output", str(folder / "demo"), "--overwrite"], standalone_mode=False)
        else:
            print(JOBS[name](folder))
    compilations = sum(each.is_start for _, each in recorder.buffer)
    print(json.dumps({"cpu_s": time.process_time(), "compilations": compilations}))


if __name__ == "__main__":
    main()
