"""Plans in a new process: imports, seeds and memory."""

import json
import subprocess
import sys

import numpy as np
import pytest

import planners
from cspace import Robot, Workspace, build
from tests.helpers.handmade import fill_boxes

PLANS_SCRIPT = """
import gc, json, logging, sys
logging.getLogger("cspace.compiling").disabled = True  # no line about a long wait
import cspace, planners

unneeded = sorted({"scipy.optimize", "scipy.sparse", "scipy.spatial"} & set(sys.modules))

import numpy as np
import psutil

def path():
    occupied = np.zeros((40, 40), dtype=bool)
    occupied[20, :30] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.15))
    for seed in range(3):
        found = planners.plan(space, (0.5, 0.5), (3.5, 0.5), planner="RRTConnect", seed=seed, time_limit=20.0)
    return found.path.tolist()

def growth(name):
    occupied = np.zeros((60, 40, 12)[: 3 if name == "space" else 2], dtype=bool)
    occupied[30, :26] = True
    heeding = dict(objective="clearance", planner=planners.Search("RRTstar", 20), time_limit=0.002)
    ways = [dict(), dict(planner="RRT"), dict(planner="KPIECE1"), dict(planner=planners.Search("BITstar", 50)), heeding]
    robot, rotations = cspace.Robot.disc(0.15), None
    if name == "space":
        robot = cspace.Robot.box((0.3, 0.3, 0.1))
    if name == "turning":
        robot, rotations = cspace.Robot.rectangle(0.4, 0.2), 12
        ahead, both = (planners.Car(turning_radius=0.3, reverse=each) for each in (False, True))
        ways += [dict(drive=planners.Differential()),
                 dict(drive=ahead, planner="RRT"), dict(drive=both),
                 dict(drive=both, **heeding)]
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), robot, rotations=rotations)
    rest = {"plane": (), "turning": (0.0,), "space": (0.5,)}[name]

    def resident(plans):
        for k in range(plans):
            # The runs repeat, so that the largest run precedes the count.
            planners.plan(space, (0.5, 0.5, *rest), (5.5, 0.5, *rest), seed=k % 30, **ways[k % len(ways)])
        gc.collect()
        return psutil.Process().memory_info().rss

    before = resident(30)
    after = resident(90)
    return (after - before) / 2**20

if __name__ == "__main__":
    growths = {name: growth(name) for name in ("plane", "turning", "space")}
    print(json.dumps({"unneeded": unneeded, "path": path(), "growths": growths}))
"""


@pytest.fixture(scope="module")
def printed():
    # Python's warnings are ignored, because a new release of any package may deprecate something.
    command = [sys.executable, "-W", "ignore", "-c", PLANS_SCRIPT]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""  # neither OMPL nor its bindings warn
    return json.loads(run.stdout)


def test_planners_are_imported_without_rarely_used_parts_of_scipy(printed):
    assert printed["unneeded"] == []


def test_a_seed_repeats_a_run_in_another_process(printed):
    space = build(Workspace.from_array(fill_boxes((40, 40), np.s_[20, :30]), 0.1), Robot.disc(0.15))
    options = {"planner": "RRTConnect", "time_limit": 20.0}
    paths = [
        planners.plan(space, (0.5, 0.5), (3.5, 0.5), seed=seed, **options).path.tolist()
        for seed in (2, 1)
    ]
    assert printed["path"] == paths[0] != paths[1]


def test_plans_leak_no_memory(printed):
    # A setup takes 30 kB, so leaking every setup would take 2.6 MiB.
    assert len(printed["growths"]) == 3 and max(printed["growths"].values()) < 1.5
