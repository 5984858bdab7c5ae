"""Error messages: one line that names the argument."""

import numpy as np
import pytest

import cspace
import planners
from cspace import InputError, Robot, Workspace
from cspace.errors import MAX_PROBLEM_CHARACTERS
from tests.helpers.refusals import refusals

NO_OBSTACLES = np.zeros((40, 30), dtype=bool)
MANY_POINTS = np.random.default_rng(0).random((3000, 2)).tolist()


@pytest.fixture(scope="module")
def space():
    return cspace.build(Workspace.from_array(NO_OBSTACLES, 0.1), Robot.disc(0.2))


@refusals(
    "call, beginning",
    (
        lambda space: planners.plan((1, 1), (9, 1), space),
        "space is a tuple; it must be a cspace.Space, as the results of ",
    ),
    (
        lambda space: planners.plan(space.workspace, (1, 1), (9, 1)),
        "space is a Workspace; it must be a cspace.Space, as the results of ",
    ),
    (
        lambda space: planners.plan(space, space.robot, (9, 1)),
        "start is Robot(disc 0.2 m, in the plane); ",
    ),
    (
        lambda space: cspace.build(space.robot, space.workspace),
        "workspace is a Robot; it must be a Workspace; ",
    ),
    (
        lambda space: cspace.build(NO_OBSTACLES, space.robot),
        "workspace is a ndarray; it must be a Workspace; call ",
    ),
    (
        lambda space: cspace.build(space.workspace, space.workspace),
        "robot is a Workspace; it must be a Robot; call ",
    ),
    (lambda space: Workspace.from_array(0.1, NO_OBSTACLES), "spacing is "),
    (
        lambda space: Workspace.from_array(NO_OBSTACLES, (0, 0), 0.1),
        "spacing is (0, 0); it must be one number ",
    ),
    (lambda space: Workspace.from_points(0.1, MANY_POINTS), "spacing is [["),
    (lambda space: Workspace.from_mesh(0.1, "house.stl"), "spacing is 'house.stl'; "),
    (lambda space: Workspace.from_image(0.1, "map.png"), "path is 0.1; it must be a file name; "),
    (lambda space: Robot.disc((0, 0), 0.3), "radius is (0, 0); it must be one number above zero; "),
    (lambda space: Robot.ball((0, 0, 0), 0.3), "radius is (0, 0, 0); "),
    (lambda space: Robot.from_balls([0.1, 0.2], [[0, 0], [1, 1]]), "centers has shape (2,); "),
    (lambda space: space.update((3, 3), np.ones((2, 2), bool)), "cells has shape (2,); "),
    (
        lambda space: space.is_free_around(0.2, (1, 1)),
        "distance is (1, 1); it must be one number, zero or above; ",
    ),
    (lambda space: space.sample_free(np.random.default_rng(0), 3), "n is "),
    (lambda space: space.sample_free(np.random.default_rng(0)), "n is "),
    (lambda space: cspace.open(space), "path is CSpace("),
)
def test_exchanged_arguments_are_named_in_a_line(space, call, beginning):
    with pytest.raises(InputError) as caught:
        call(space)
    message = str(caught.value)
    assert message.startswith(beginning)
    assert "\n" not in message
    assert len(message) < MAX_PROBLEM_CHARACTERS + 200


HUGE_INTEGER = 10**400


@pytest.mark.parametrize(
    "call",
    [
        lambda space: space.is_free([HUGE_INTEGER, 1]),
        lambda space: space.is_free([[1, 1], [1, -HUGE_INTEGER]], exact=True),
        lambda space: space.clearance([HUGE_INTEGER, 1]),
        lambda space: space.is_connected([HUGE_INTEGER, 1], [1, 1]),
        lambda space: space.motion_is_free([1, 1], [1, HUGE_INTEGER]),
        lambda space: space.nearest_free([HUGE_INTEGER, 1]),
        lambda space: space.sample_free(HUGE_INTEGER),
        lambda space: space.update([[1]], (HUGE_INTEGER, 0)),
        lambda space: space.grid.center_of([HUGE_INTEGER, 1]),
        lambda space: planners.plan(space, (HUGE_INTEGER, 1), (1, 1)),
        lambda space: cspace.build(
            space.workspace, Robot.rectangle(0.2, 0.1), rotations=HUGE_INTEGER
        ),
        lambda space: Robot.disc(HUGE_INTEGER),
        lambda space: Workspace.from_mesh(
            ([[0, 0, HUGE_INTEGER], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), 0.1
        ),
        lambda space: Workspace.from_mesh(
            ([[0, 0, 1], [1, 0, 0], [0, 1, 0]], [[0, 1, HUGE_INTEGER]]), 0.1
        ),
    ],
)
def test_integers_beyond_floats_are_refused_in_a_line(space, call):
    with pytest.raises(InputError) as caught:
        call(space)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("call", "argument", "value"),
    [
        (lambda space: Robot.disc(-1), "radius", -1),
        (lambda space: Robot.disc(1e200), "radius", 1e200),
        (lambda space: Robot.polygon([(0, 0), (1, 0)]), "polygon", [(0, 0), (1, 0)]),
        (lambda space: Robot.from_balls([[0, 0]], [-0.5]), "radii", [-0.5]),
        (lambda space: Robot.parse("disc:-1"), "robot", "disc:-1"),
        (lambda space: cspace.build(space.workspace, space.robot, margin=-1), "margin", -1),
        (lambda space: cspace.build(space.workspace, space.robot, rotations=0), "rotations", 0),
        (lambda space: Workspace.from_array([[0, 2]], 0.1), "occupied[0, 1]", 2),
        (
            lambda space: Workspace.from_array(NO_OBSTACLES, 0.1, lower=(0, 0, 0)),
            "lower",
            (0, 0, 0),
        ),
        (
            lambda space: Workspace.from_array(NO_OBSTACLES, 0.1, lower=(0, np.inf)),
            "lower[1]",
            np.inf,
        ),
        (lambda space: space.is_free((1, "x")), "q", (1, "x")),
        (lambda space: space.is_free((1, 2, 3)), "q", (1, 2, 3)),
        (lambda space: space.certify_path([1, 1]), "path", [1, 1]),
        (lambda space: space.is_free_around((1, 1), -1), "distance", -1),
        (lambda space: planners.plan(space, (1, 1), (2, 2), time_limit=-1), "time_limit", -1),
        (lambda space: planners.plan(space, (1, 1), (2, 2), planner="A"), "planner", "A"),
    ],
)
def test_errors_carry_the_value_the_rule_and_the_hint(space, call, argument, value):
    with pytest.raises(InputError) as caught:
        call(space)
    error = caught.value
    assert (error.argument, error.value) == (argument, value)
    assert error.problem and error.rule and error.hint
