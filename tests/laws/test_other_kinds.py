"""A value of another kind is taken or refused, whichever argument it is given for."""

from functools import cache, partial

import matplotlib.pyplot as plt
import numpy as np
import pytest
import shapely
import trimesh

import cspace
import planners
from cspace import Robot, Workspace, lanes, plot
from tests.helpers.urdfs import planar_arm

WORLD = Workspace.from_polygons([shapely.box(2, 2, 3, 3)], 0.1, bounds=(0, 0, 6, 6))
ROOM = Workspace.from_mesh(trimesh.creation.box((1, 1, 1)), 0.2)
POSE = {
    "position": {"x": 1, "y": 1, "z": 0},
    "orientation": {"x": 0, "y": 0, "z": 0, "w": 1},
}
LIMITS = {"max_velocity": 1.0, "max_acceleration": 1.0}


@cache
def things():
    """Make an object of each kind that calls take."""
    space = cspace.build(WORLD, Robot.disc(0.2))
    arm = planar_arm()
    plan = planners.plan(space, (1, 1), (5, 5))
    motion = plan.trajectory(**LIMITS)
    turning = cspace.build(WORLD, Robot.rectangle(0.5, 0.3), rotations=16)
    drive = planners.plan(turning, (1, 1, 0), (5, 5, 0), drive=planners.Differential())
    return {
        "space": space,
        "moved": cspace.build(WORLD, Robot.disc(0.2)),
        "turning": turning,
        "plan": plan,
        "motion": motion,
        "driven": drive.trajectory(**LIMITS, max_angular_velocity=1, max_angular_acceleration=1),
        "mover": lanes.Mover(space.robot, motion),
        "graph": lanes.RouteGraph.from_arrays([(1, 1), (5, 1), (5, 5)], [(0, 1), (1, 2)]),
        "robot": space.robot,
        "arm": arm,
        "reach": cspace.build_arm_space({}, arm),
        "axes": plt.figure().add_subplot(),
    }


PLAIN = {
    "none": None,
    "text": "abc",
    "bytes": b"x",
    "number": 3,
    "negative": -1.5,
    "true": True,
    "nan": float("nan"),
    "infinite": float("inf"),
    "complex": 1j,
    "large": 10**30,
    "mapping": {"a": 1},
    "empty": [],
    "ragged": [[1, 2], [3]],
    "set": {1, 2},
    "call": lambda *_: None,
    "array": np.zeros((2, 3)),
    "objects": np.array([None, 1], dtype=object),
    "type": object,
    "polygon": shapely.box(0, 0, 1, 1),
    "world": WORLD,
    "date": np.datetime64("2020-01-01"),
}
"""Values of other kinds, with those of :func:`things`."""

CALLS = {
    "build": lambda t: (cspace.build, WORLD, t["robot"], {"rotations": 4, "margin": 0.1}),
    "build by": lambda t: (
        *(cspace.build, WORLD, t["robot"]),
        {"outside": "free", "store": None, "workers": 1, "method": "auto", "floor": None},
    ),
    "tiles": lambda t: (cspace.build, WORLD, t["robot"], {"tile": 4096}),
    "plan": lambda t: (planners.plan, t["space"], (1, 1), (5, 5), {"objective": "length"}),
    "drive": lambda t: (
        *(planners.plan, t["turning"], (1, 1, 0), (5, 5, 0)),
        {"drive": planners.Differential(), "seed": 1, "previous": None, "keep": None},
    ),
    "arm's plan": lambda t: (planners.plan, t["reach"], (0, 0), (0.5, 0.5)),
    "trajectory": lambda t: (
        t["plan"].trajectory,
        {**LIMITS, "speed": (), "duration": None, "after": None, "at": 0.0, "max_jerk": None},
    ),
    "sample": lambda t: (t["motion"].sample, 0.5),
    "recheck": lambda t: (t["motion"].recheck, t["space"]),
    "slow": lambda t: (planners.SlowNear, t["space"], 0.3, 0.5),
    "near": lambda t: (planners.Near, (1, 1), 0.5),
    "audit": lambda t: (lanes.audit, t["turning"], t["graph"], {"max_room": 0.5}),
    "conflicts": lambda t: (
        *(lanes.conflicts, t["turning"], t["graph"]),
        {"margin": 0.0, "others": None, "name": ""},
    ),
    "mover": lambda t: (lanes.Mover, t["robot"], (1, 1), {"velocity": (0, 1), "error": 0.1}),
    "apart": lambda t: (lanes.apart, t["mover"], lanes.Mover("disc:0.1", (5, 1))),
    "wait": lambda t: (lanes.time_around, t["mover"], [], {"margin": 0.1}),
    "picture": lambda t: (plot.save_plot, t["space"], "a.png", {"path": None, "dpi": 20}),
    "film": lambda t: (plot.animate, t["space"], [(1, 1)], "a.gif", {"seconds": 0.1}),
    "state": lambda t: (t["turning"].is_free, (1, 1, 0)),
    "exact edge": lambda t: (t["turning"].exact.motion_is_free, (1, 1, 0), (1, 2, 0)),
    "apart in the map": lambda t: (t["turning"].is_disconnected, (1, 1, 0), (5, 5, 0)),
    "crate": lambda t: (t["moved"].add_obstacle, "crate", shapely.box(4, 4, 5, 5)),
    "no crate": lambda t: (t["moved"].remove_obstacle, "crate"),
    "save": lambda t: (t["space"].save, "map", {"overwrite": True}),
    "open": lambda t: (cspace.open, "map"),
    "polygons": lambda t: (Workspace.from_polygons, [shapely.box(0, 0, 1, 1)], 0.1),
    "cells": lambda t: (Workspace.from_array, np.eye(5, dtype=bool), 0.1, {"lower": (0, 0)}),
    "points": lambda t: (Workspace.from_points, np.zeros((5, 2)), 0.1, {"radius": 0.1}),
    "mesh": lambda t: (Workspace.from_mesh, trimesh.creation.box((1, 1, 1)), 0.2),
    "heights": lambda t: (Workspace.from_heights, np.ones((5, 5)), 0.2),
    "rectangle": lambda t: (Robot.rectangle, 1.0, 0.5),
    "outline": lambda t: (Robot.polygon, [(0, 0), (1, 0), (0, 1)]),
    "robot by name": lambda t: (Robot.parse, "disc:0.2"),
    "gate": lambda t: (cspace.Gate, t["turning"], {"dt": 0.05, "max_deceleration": (1.0, 1.0)}),
    "between": lambda t: (t["turning"].interpolate, (1, 1, 0), (1, 2, 0), 0.5),
    "costmap": lambda t: (t["space"].to_costmap, {"frame_id": None}),
    "grid message": lambda t: (t["space"].to_occupancy_grid, {"frame_id": "map"}),
    "path message": lambda t: (t["plan"].to_path, {"frame_id": None}),
    "motion's message": lambda t: (t["motion"].to_path, {"frame_id": None}),
    "pose message": lambda t: (
        *(cspace.ros.configuration_of, {"header": {"frame_id": "map"}, "pose": POSE}),
        *(t["turning"], {"frame_id": None}),
    ),
    "twists": lambda t: (t["driven"].to_twists, {"make": None}),
    "map's picture": lambda t: (t["space"].plot, {"ax": None, "view": None}),
    "arm's picture": lambda t: (t["reach"].plot, {"ax": None, "q": (0, 0)}),
    "motion's picture": lambda t: (t["motion"].plot, {"ax": None}),
    "region's picture": lambda t: (t["space"].free_region((1, 1)).plot, {"ax": None}),
    "layer": lambda t: (ROOM.between, 0.0, 0.5),
    "grid": lambda t: (cspace.Grid, (0, 0), 0.1, (5, 5), {"axes": None, "units": None}),
    "named outline": lambda t: (Robot.polygon, shapely.box(0, 0, 1, 1), {"name": None}),
    "footprint": lambda t: (
        *(Robot.from_footprint, "[[0, 0], [1, 0], [0, 1]]"),
        {"padding": 0.1, "name": None},
    ),
    "named mesh": lambda t: (Robot.from_mesh, trimesh.creation.box((1, 1, 1)), {"name": None}),
    "spec": lambda t: (Robot.from_spec, t["robot"].spec),
    "upright": lambda t: (planners.Upright, "fore", {"tolerance": 0.1, "angle": 0.0}),
    "balls": lambda t: (partial(t["arm"].spheres, number=1), {"kind": "outer"}),
    "joint map": lambda t: (cspace.build_joint_map, t["reach"], 1.0, {"joints": None}),
    "link": lambda t: (t["arm"].pose, (0, 0), "fore"),
    "inverse": lambda t: (t["arm"].inverse, "fore", np.eye(4)),
}
"""Calls with arguments, and those given by name, in a mapping at the end."""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", CALLS)
def test_a_value_of_another_kind_makes_no_bare_error(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, *given = CALLS[name](things())
    options = given.pop() if isinstance(given[-1], dict) and name != "spec" else {}
    for place in (*range(len(given)), *options):
        for kind, value in {**PLAIN, **things()}.items():
            values, named = list(given), dict(options)
            (values if isinstance(place, int) else named)[place] = value
            try:
                call(*values, **named)
            except cspace.CspaceError:
                pass
            except Exception as error:
                pytest.fail(f"{name}, argument {place}, {kind}: {error!r}")
