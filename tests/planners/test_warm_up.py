"""Compilation ahead of the first plan."""

import os
import subprocess
import sys

import pytest

import planners
from tests.helpers.repository import ROOT

SCRIPT = """
import numpy as np, cspace, planners
from numba.core import event

class Recorder(event.Listener):
    names = []
    def on_start(self, event):
        self.names.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

drive = planners.{drive!r}
cells = np.zeros((80, 60), dtype=bool)
cells[40:42, :45] = True
workspace = cspace.Workspace.from_array(cells, 0.1)
space = cspace.build(workspace, cspace.Robot.rectangle(0.4, 0.2), rotations=8)
planners.warm_up(space, drive)
event.register("numba:compile", Recorder())
ends = (1.0, 1.0, 0.0), (7.0, 1.0, 0.0)
plan = planners.plan(space, *ends, drive=drive, time_limit=20.0)
cells[30:33, 50:] = True
space.update(cspace.Workspace.from_array(cells, 0.1))
planners.plan(space, *ends, drive=drive, time_limit=20.0, previous=plan)
print(bool(plan), Recorder.names)
"""


@pytest.mark.thorough
@pytest.mark.parametrize("drive", [planners.Differential()], ids=repr)
def test_the_first_plan_compiles_nothing(tmp_path, drive):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(drive=drive)],
        env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "True []"
