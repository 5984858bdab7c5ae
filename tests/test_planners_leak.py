"""A thousand plans in one process leave nothing behind."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("psutil", reason="psutil is not installed; run: pip install psutil")

SCRIPT = """
import gc
import sys
import numpy as np
import psutil
import cspace, planners

def main():
    dim = int(sys.argv[1])
    occupied = np.zeros((60, 40, 12)[:dim], dtype=bool)
    occupied[30, :30] = True
    robot = cspace.Robot.disc(0.15) if dim == 2 else cspace.Robot.box((0.3, 0.3, 0.1))
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), robot)
    start, goal = (0.5, 0.5, 0.5)[:dim], (5.5, 0.5, 0.5)[:dim]
    heeding = dict(objective="clearance", planner="RRTstar", iterations=20)
    ways = [dict(), dict(planner="RRT"), dict(planner="KPIECE1"), dict(planner="BITstar", iterations=50), heeding]

    def resident(plans):
        for k in range(plans):
            # The same runs again, so that the largest of them has been before what is counted.
            planners.plan(space, start, goal, seed=k % 200, **ways[k % len(ways)])
        gc.collect()
        return psutil.Process().memory_info().rss

    before = resident(200)
    after = resident(1000)
    print((after - before) / 2**20)

main()
"""


@pytest.mark.parametrize("dim", ["2", "3"])
def test_a_thousand_plans_leave_nothing_behind(dim: str) -> None:
    run = subprocess.run([sys.executable, "-c", SCRIPT, dim], capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    # One kept set-up is some 30 kB, so a leak of each would show as 30 MiB.
    assert float(run.stdout) < 4.0
