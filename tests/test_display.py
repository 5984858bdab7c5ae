"""How public objects show themselves: in a notebook, printed, and in Python's help."""

import inspect
import re

import numpy as np
import pytest
import shapely
import trimesh

import cspace
import planners
from cspace import Robot, Workspace, arms, lanes, reasons, regions, spectral
from cspace.lanes import Mover, RouteGraph, time_around

MODULES = cspace, planners, arms, lanes, reasons, regions, spectral
BARE = {"Goal", "FreeStateSampler", "MotionValidator", "StateValidityChecker"}
"""A class that others extend, and objects of OMPL, whose repr is OMPL's."""

WORKSPACE = Workspace.from_array(np.zeros((90, 60), dtype=bool), 0.1)
GRAPH = RouteGraph.from_arrays([(1, 2), (7, 2), (7, 5)], [(0, 1), (1, 2), (0, 2)])


def list_classes():
    """Return the public classes by name."""
    pairs = [(name, getattr(module, name)) for module in MODULES for name in module.__all__]
    return {name: kind for name, kind in pairs if inspect.isclass(kind)}


def time_motion():
    """Time a motion around nobody."""
    space = cspace.build(WORKSPACE, Robot.disc(0.2))
    plan = planners.plan(space, (1.0, 1.0), (3.0, 1.0))
    motion = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
    return time_around(Mover(space.robot, motion), [Mover("disc:0.2", (6.0, 4.0))], until=60.0)


@pytest.fixture(scope="module")
def space():
    return cspace.build(WORKSPACE, Robot.rectangle(0.6, 0.4), rotations=24)


@pytest.mark.parametrize("name", sorted(set(list_classes()) - BARE))
def test_a_public_class_has_a_repr_and_its_plot_is_shown_in_notebooks(name):
    kind = list_classes()[name]
    assert kind.__repr__ is not object.__repr__
    assert hasattr(kind, "_repr_png_") or not hasattr(kind, "plot")


BALLS = np.zeros((1, 2)), np.array([0.3])
BOX = trimesh.creation.box((1.0, 2.0, 0.5))
SHOWN = {
    "contact": (lambda: spectral.ContactTest(BALLS, BALLS), "in 2 dimensions"),
    "early": (lambda: spectral.EarlyTest(spectral.FourierOverlap(BALLS, BALLS), 0.01), "0.01"),
    "penetration": (lambda: spectral.BallPenetration([0.2, 0.1], BALLS), "2 balls among 1"),
    "posed": (lambda: arms.PosedShape(BOX, np.eye(4)), "shape=Mesh(1 m x 2 m x 0.5 m)"),
    "disc": (lambda: Robot.disc(0.3).shape, "Balls(0.6 m x 0.6 m)"),
    "polygon": (lambda: Robot.polygon(shapely.box(0, 0, 2, 1)).shape, "Polygons(2 m x 1 m)"),
    "box": (lambda: Robot.box((1.0, 2.0, 3.0)).shape, "1 m x 2 m x 3 m"),
    "cylinder": (lambda: Robot.cylinder(0.5, 2.0).shape, "x 2 m"),
    "bitmap": (lambda: Robot.from_bitmap([[True]], 0.5).shape, "Voxels(0.5 m x 0.5 m)"),
}
"""Objects, and a part of their repr."""


@pytest.mark.parametrize("name", SHOWN)
def test_a_repr_says_what_an_object_is(name):
    make, part = SHOWN[name]
    assert part in repr(make()) and " object at 0x" not in repr(make())


@pytest.mark.parametrize("kind", ["workspace", "audit", "conflicts", "timing", "region"])
def test_a_notebook_shows_a_picture(kind, space):
    make = {
        "workspace": lambda: WORKSPACE,
        "audit": lambda: lanes.audit(space, GRAPH),
        "conflicts": lambda: lanes.conflicts(space, GRAPH),
        "timing": time_motion,
        "region": lambda: space.free_region((4.0, 3.0, 0.0)),
    }
    assert make[kind]()._repr_png_().startswith(b"\x89PNG")


def test_a_notebook_shows_text_if_there_is_no_picture():
    assert lanes.Timing(None, np.inf, "impossible: it is")._repr_png_() is None


def test_rows_of_conflicts_fit_a_terminal(space):
    lines = str(lanes.conflicts(space, GRAPH)).splitlines()
    assert len(lines) > 5 and max(map(len, lines)) <= 80
    assert "groups" not in lines[1]  # no file has any


@pytest.mark.parametrize("module, name", [(cspace, "build"), (planners, "plan"), (arms, "Arm")])
def test_help_of_a_package_opens_with_what_it_does(module, name):
    text = inspect.getdoc(module)
    assert re.search(rf"\b{name}\b", text) and not re.search(r"`_|__init__|[Rr]ooms", text)
