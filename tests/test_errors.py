"""Refused arguments: each rule once, in one line that names the argument, with its value and hint."""

import math
from functools import cache

import numpy as np
import pytest
import shapely

import cspace
import planners
from cspace import Grid, Robot, Workspace
from cspace._support.check import check_count
from cspace.errors import CspaceError, InputError
from tests.helpers.refusals import refusals

CELLS = np.zeros((40, 30), dtype=bool)
BOW = shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])


@cache
def build_space():
    """Build the map of an empty room with one obstacle."""
    space = cspace.build(Workspace.from_array(CELLS, 0.1), Robot.disc(0.2))
    space.add_obstacle("cart", shapely.box(1.83, 1.33, 2.21, 1.72))
    return space


def build(**changes):
    """Build a small map, with some arguments replaced."""
    given = {"workspace": Workspace.from_array(np.eye(4) > 0, 0.1), "robot": Robot.disc(0.1)}
    arguments = given | changes
    return cspace.build(arguments.pop("workspace"), arguments.pop("robot"), **arguments)


def add(shape, radius=None, name="cart"):
    """Add an obstacle to the map."""
    return build_space().add_obstacle(name, shape, radius=radius)


@refusals(
    "call, message",
    # Numbers and words.
    (lambda: check_count(True, "n", 0, 10), "n is True; it must be a whole number from 0 to 10"),
    (lambda: build_space().grid.center_of([10**400, 1]), "cells has too large an integer"),
    # Grids.
    (lambda: Grid((0, 0), math.nan, (1, 1)), "spacing is nan"),
    (lambda: Grid((0, 0), "wide", (1, 1)), "spacing is 'wide'; it must be numeric"),
    (lambda: Grid((0, np.inf), 1.0, (1, 1)), "lower[1] is inf; it must be finite"),
    (lambda: Grid((0, 0), 1.0, (1.5, 2)), "shape is (1.5, 2.0)"),
    (lambda: Grid((1e9, 0), 1e-3, (4, 4)), "cells from the origin"),
    (lambda: Grid((0, 0), 1.0, (2, 2)).cell_of((1.0, 2.0, 3.0)), "points has shape (3,)"),
    # Workspaces.
    (lambda: Workspace.from_array(0.1, CELLS), "spacing is array([[False"),
    (lambda: Workspace.from_array([[0, -1], [100, 0]], 0.1), "unknown cells of ROS"),
    (lambda: Workspace.from_array(np.zeros((0, 3), bool), 1.0), "shape (0, 3)"),
    (lambda: Workspace.from_array(CELLS, 0.1, (0, 0, 0)), "lower has shape (3,)"),
    (lambda: Workspace(Grid((0, 0), 1, (3, 2)), CELLS, CELLS), "outer has shape (40, 30) but the"),
    (lambda: Workspace.open("map.step", spacing=0.1), "with suffix '.step'"),
    (lambda: Workspace.from_shapes([], 0.1), "shapes is empty"),
    (lambda: Workspace.from_shapes([Robot.disc(1), Robot.ball(1)], 0.1), "shapes[1] is in space"),
    # Robots.
    (lambda: Robot.disc((0, 0), 0.3), "radius is (0, 0); it must be one number above zero"),
    (lambda: Robot.polygon(shapely.Polygon()), "empty"),
    (lambda: Robot.polygon(BOW), "not valid"),
    (lambda: Robot.parse("disc:wide"), "RADIUS"),
    # Builds.
    (lambda: build(robot="robot.urdf"), "Robot.open"),
    (lambda: build(rotations=10**7), "rotations is 10000000; "),
    (lambda: build(margin=math.nan), "margin is nan"),
    # Maps.
    (lambda: cspace.open(7), "path is 7; it must be a file name"),
    # Obstacles.
    (lambda: add(shapely.box(0, 0, 1, 1), name=""), "name is ''; it must be a non-empty string"),
    (lambda: add(Robot.ball(0.3)), "shape is in space; it must be in the plane"),
    (lambda: add([(0.0, 0.0)], -0.1), "below zero"),
    (lambda: add([(1e9, 0.0)], 0.1), "reaches 1e+10 cells"),
    (lambda: build_space().remove_obstacle("dog"), "name is 'dog'; there are cart"),
)
def test_invalid_arguments_are_refused_in_one_line_and_change_nothing(call, message):
    states = build_space().cell_states.copy()
    shape = build_space().obstacles["cart"]
    with pytest.raises(CspaceError) as caught:
        call()
    assert message.strip() in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 240 + 250
    assert (build_space().cell_states == states).all()
    assert build_space().obstacles == {"cart": shape}


def test_errors_name_the_value_the_rule_and_the_hint():
    with pytest.raises(InputError) as caught:
        planners.plan(build_space(), (1, 1), (2, 2), planner="A")
    error = caught.value
    assert error.argument == "planner" and "'A'" in error.problem
    assert error.rule and error.hint
