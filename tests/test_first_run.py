"""First runs: independent of other packages' warnings, of compiling and of busy machines."""

import os
import subprocess
import sys
import warnings

import pytest

from tests.helpers.repository import ROOT


def test_warnings_fail_a_test_in_our_code_alone():
    with warnings.catch_warnings(record=True):
        warnings.warn_explicit("of others", UserWarning, "file.py", 1, module="collada.scene")
    for module in ("cspace._grid", "planners.plan", "tests.test_robot"):
        with pytest.raises(RuntimeWarning):
            warnings.warn_explicit("of ours", RuntimeWarning, "file.py", 1, module=module)


PLANS = """
import shapely, cspace, planners
from pathlib import Path
from cspace._cli.demo import write_inputs
from cspace._support.deadlines import now
write_inputs(Path())
workspace = cspace.Workspace.open("flat.geojson", spacing=0.05)
space = cspace.build(workspace, cspace.Robot.rectangle(0.7, 0.5), rotations=72)
ends = (2, 3, 0), (9, 1, 0)
plan = planners.plan(space, *ends, drive=planners.Differential())
car = planners.plan(space, *ends, drive=planners.Car(turning_radius=0.5, reverse=True))
print(plan.planner, plan.length, car.planner, car.length, now().work)
space.add_obstacle("crate", shapely.box(6, 1, 6.5, 1.5))
print(plan.recheck().all(), car.recheck().all(), end="")
"""
"""The second snippet of the README, which prints paths and their work, too."""


@pytest.mark.thorough
def test_a_cold_process_beside_busy_ones_plans_as_a_warm_one(tmp_path):
    command = [sys.executable, "-c", PLANS]
    paths = {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    options = {"cwd": tmp_path, "env": {**os.environ, **paths}, "text": True}
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
    try:
        cold = subprocess.check_output(command, **options)
    finally:
        for process in busy:
            process.kill()
            process.wait()
    assert cold == subprocess.check_output(command, **options)
    assert cold.endswith("\nFalse False")
