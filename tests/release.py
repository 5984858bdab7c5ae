"""Compiled code for a wheel, and a check of an installed wheel; ``nox -s release`` runs both.

``python tests/release.py compile FOLDER`` writes code into an unpacked wheel in a folder; ``python
tests/release.py check`` fails if one of a user's first calls compiles a function.
"""

import contextlib
import re
import sys
import tempfile
import time
from pathlib import Path

import numba
from numba.core import event
from numba.core.compiler import CompileResult

from cspace._support import shipped

README = Path(__file__).parents[1] / "README.md"

MORE = """
limits = {"max_velocity": 0.8, "max_acceleration": 0.6}
turns = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}
ends = (2, 3, 0), (9, 1, 0)
for motion in (
    planners.plan(space, (2, 3, 0), (3, 4, 1)).trajectory(**limits, **turns),
    planners.plan(space, *ends, drive=planners.Differential()).trajectory(**limits, **turns, max_jerk=2.0),
    plan.trajectory(**limits),
    flight.trajectory(**limits),
    planners.plan(cell, (-0.8, 0.9, 0.8), (0.8, 0.9, 0.8), seed=2).trajectory(max_acceleration=1.0),
):
    motion.braked(0.3 * motion.duration)
gate = cspace.Gate(space, dt=0.1, max_deceleration=(1.0, 1.0))
gate.check_twists((2, 3, 0), [(0.2, 0.0)] * 4)
gate.slow_down((2, 3, 0), (0.3, 0.0))
cspace.Gate(space, dt=0.1, max_velocity=1.0).check_rows((2, 3, 0), [(2, 3, 0)] * 4)
space.is_free([(2, 3, 0), (9, 1, 0)]), space.clearance((2, 3, 0)), space.save("map.zarr", overwrite=True)
"""
"""Script after the snippets of the README: trajectories, gates, and batches of states."""


def write_code(wheel):
    """Compile what ``cspace compile`` does, for the processor of shipped code."""
    reduce_result = CompileResult._reduce

    def reduce_without_types(result):
        """Leave out the listing of types: paths and addresses of this machine, which are not used."""
        *first, _, reload_init, environments = reduce_result(result)
        return *first, "", reload_init, environments

    CompileResult._reduce = reduce_without_types
    with tempfile.TemporaryDirectory() as folder:
        numba.config.CACHE_DIR = folder
        numba.config.CPU_NAME, numba.config.CPU_FEATURES = shipped.TARGET
        from cspace._cli import app  # which imports functions that keep these settings

        app(["compile"], standalone_mode=False)
        files = sorted(Path(folder).rglob("*.nbc"))
        place = Path(wheel, "cspace", shipped.FOLDER.name, shipped.name_code())
        place.mkdir(parents=True)
        for file in files:
            place.joinpath(file.name).write_bytes(file.read_bytes())
    assert len(list(place.iterdir())) == len(files) > 300, "two files have one name"


def check():
    """Run the demo, the snippets of the README and more; fail if a function is compiled."""
    assert not shipped.find_code_misfit(), shipped.find_code_misfit()
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
        event.install_recorder("numba:compile") as recorder,
    ):
        numba.config.CACHE_DIR = folder
        from cspace._cli import app

        app(["demo"], standalone_mode=False)
        print(f"the demo takes {time.process_time():.1f} s of CPU")
        names = {"__name__": "readme"}
        text = README.read_text(encoding="utf-8")
        for snippet in [*re.findall("^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE), MORE]:
            exec(snippet, names)
    compiled = {each.data["dispatcher"].py_func for _, each in recorder.buffer}
    print(f"all takes {time.process_time():.1f} s of CPU; {len(compiled)} functions were compiled")
    assert not compiled, compiled


if __name__ == "__main__":
    check() if sys.argv[1] == "check" else write_code(sys.argv[2])
