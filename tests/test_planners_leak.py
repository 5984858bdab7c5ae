"""A thousand plans in one process leave nothing behind."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("psutil", reason="psutil is not installed; run: pip install psutil")

SCRIPT = """
import gc
import numpy as np
import psutil
import cspace, planners

def main():
    occupied = np.zeros((60, 40), dtype=bool)
    occupied[30, :30] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.15))
    heeding = dict(objective="clearance", planner="RRTstar", iterations=20)
    ways = [dict(), dict(planner="RRT"), dict(planner="KPIECE1"), dict(planner="BITstar", iterations=50), heeding]

    def resident(plans):
        for k in range(plans):
            planners.plan(space, (0.5, 0.5), (5.5, 0.5), seed=k, **ways[k % len(ways)])
        gc.collect()
        return psutil.Process().memory_info().rss

    before = resident(200)
    after = resident(1000)
    print((after - before) / 2**20)

main()
"""


def test_a_thousand_plans_leave_nothing_behind() -> None:
    run = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    # One kept set-up is some 30 kB, so a leak of each would show as 30 MiB.
    assert float(run.stdout) < 4.0
