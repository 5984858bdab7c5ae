"""Hundreds of plans in one process leave nothing behind."""

import subprocess
import sys

SCRIPT = """
import gc
import numpy as np
import psutil
import cspace, planners

def growth(name):
    occupied = np.zeros((60, 40, 12)[: 3 if name == "space" else 2], dtype=bool)
    occupied[30, :26] = True
    heeding = dict(objective="clearance", planner="RRTstar", iterations=20, time_limit=0.002)
    ways = [dict(), dict(planner="RRT"), dict(planner="KPIECE1"), dict(planner="BITstar", iterations=50), heeding]
    robot, rotations = cspace.Robot.disc(0.15), None
    if name == "space":
        robot = cspace.Robot.box((0.3, 0.3, 0.1))
    if name == "turning":
        robot, rotations, car = cspace.Robot.rectangle(0.4, 0.2), 12, dict(turning_radius=0.3)
        ways += [dict(exact=True), dict(drive="differential"),
                 dict(drive="dubins", planner="RRT", **car), dict(drive="reeds-shepp", **car),
                 dict(drive="reeds-shepp", **car, **heeding)]
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), robot, rotations=rotations)
    rest = {"plane": (), "turning": (0.0,), "space": (0.5,)}[name]

    def resident(plans):
        for k in range(plans):
            # The same runs again, so that the largest of them has been before what is counted.
            planners.plan(space, (0.5, 0.5, *rest), (5.5, 0.5, *rest), seed=k % 30, **ways[k % len(ways)])
        gc.collect()
        return psutil.Process().memory_info().rss

    before = resident(30)
    after = resident(90)
    return (after - before) / 2**20

if __name__ == "__main__":
    print(*map(growth, ("plane", "turning", "space")))
"""


def test_plans_leave_nothing_behind() -> None:
    run = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=300)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    # One kept set-up is some 30 kB, so a leak of each would show as 2.6 MiB.
    growths = [float(part) for part in run.stdout.split()]
    assert len(growths) == 3 and max(growths) < 1.5
