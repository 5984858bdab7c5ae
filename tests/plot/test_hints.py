"""Hints of pictures, pages and animations: each is followed by code."""

import socket
from functools import cache

import matplotlib.pyplot as plt
import numpy as np
import pytest

import planners
from cspace import Robot, Workspace, build
from cspace.errors import InputError
from cspace.plot import animate, save_plot
from tests.helpers.refusals import check_followed, refusals


@cache
def flat():
    """Build a map in the plane."""
    return build(Workspace.from_array(np.eye(9, dtype=bool), 0.1), Robot.disc(0.05))


@cache
def turning():
    """Build a map in the plane with a yaw."""
    return build(flat().workspace, Robot.disc(0.05), rotations=2)


@cache
def spatial():
    """Build a map in space."""
    return build(Workspace.from_array(np.ones((4, 4, 4), dtype=bool), 0.1), Robot.ball(0.05))


START, GOAL = (0.65, 0.15), (0.75, 0.25)
PATH = [START, GOAL]


@refusals(
    "call, advised, hint",
    (
        lambda f: animate(flat(), np.zeros((0, 2)), f / "a.gif"),
        lambda f: animate(flat(), planners.plan(flat(), START, GOAL), f / "a.gif", seconds=0.1),
        "pass one that was found",
    ),
    (
        lambda f: animate(flat(), PATH, f / "a.gif", rate=90),
        lambda f: animate(flat(), PATH, f / "a.gif", rate=50, seconds=0.1),
        "lower it",
    ),
    (
        lambda f: animate(flat(), PATH, f / "a.gif", seconds=1e4),
        lambda f: [
            animate(flat(), PATH, f / "a.gif", seconds=0.1),
            animate(flat(), PATH, f / "b.gif", seconds=10, rate=0.2),
        ],
        "lower it or the rate",
    ),
    (
        lambda f: animate(flat(), PATH, f / "a.png"),
        lambda f: animate(flat(), PATH, f / "a.gif", seconds=0.1),
        "use one of .gif",
    ),
    (
        lambda f: flat().plot(ax=plt),
        lambda f: flat().plot(ax=plt.figure().add_subplot()),
        "pass figure.add_subplot()",
    ),
    (
        lambda f: spatial().plot(view="3d", ax=plt.figure().add_subplot()),
        lambda f: spatial().plot(view="3d", ax=plt.figure().add_subplot(projection="3d")),
        'use figure.add_subplot(projection="3d")',
    ),
    (lambda f: flat().plot(zoom=0.5), lambda f: flat().plot(zoom=8), "pass e.g. 8"),
    (
        lambda f: flat().plot(center=(0.1, 0.1)),
        lambda f: [flat().plot(center=(0.1, 0.1), zoom=8), flat().plot()],
        "add e.g. zoom=8, or omit it",
    ),
    (
        lambda f: flat().plot(zoom=8, center=(9, 9)),
        lambda f: flat().plot(zoom=8, center=flat().grid.lower),
        "pass a point in it",
    ),
    (
        lambda f: flat().plot(start=(1, 2, 3)),
        lambda f: flat().plot(start=START),
        "pass (x, y)",
    ),
    (
        lambda f: save_plot(flat(), f / "a.png", dpi=1e6),
        lambda f: save_plot(flat(), f / "a.png", dpi=300),
        "pass e.g. 300",
    ),
    (
        lambda f: flat().plot(path=[(1.0, 2.0, 3.0)]),
        "path has shape (1, 3); it must be (n, 2); pass (x, y)",
    ),
    (lambda f: flat().plot(rotation=0.5), "rotation has shape (1,); the robot does not turn"),
    (lambda f: flat().plot(cut=1.0), "cut is given with view plane; it needs view 3d"),
    (lambda f: save_plot(flat(), f / "a.xyz"), "use one of .png, .pdf, .svg, .jpg"),
    (
        lambda f: turning().plot(rotation=[0.0, 1.0]),
        "rotation has shape (2,); a rotation is given by yaw",
    ),
    (
        lambda f: spatial().plot(view="3d", camera=(30, 120, 3)),
        "camera is (30, 120, 3); it must be (elevation",
    ),
    (
        lambda f: animate(turning(), [(1, 1)], f / "a.gif"),
        "path has shape (1, 2); it must be (n, 3)",
    ),
    (lambda f: animate(flat(), PATH, f / "a.gif", seconds=0), "seconds is 0"),
    (
        lambda f: animate(flat(), PATH, f / "a.gif", camera=(30, 30)),
        "camera is given for a plane map",
    ),
)
def test_a_picture_as_the_hint_says_is_drawn(call, advised, hint, tmp_path):
    def draw():
        try:
            call(tmp_path)
        finally:
            assert not any(tmp_path.iterdir()), "a refused picture is written"

    check_followed(draw, advised and (lambda: advised(tmp_path)), hint)
    plt.close("all")


def test_another_view_of_a_map_that_turns_is_drawn_as_advised():
    with pytest.raises(InputError, match=r"or omit it; loop over plot\(rotation=\) for several"):
        turning().plot(view="slices")
    turning().plot()
    for yaw in (0.1, 2.0):
        turning().plot(rotation=yaw)
    plt.close("all")


def test_a_page_at_the_port_or_the_host_that_the_hint_names_is_shown():
    pytest.importorskip("viser")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        for options, advised, hint in (
            ({"port": 10**6}, {"port": 0}, "pass 0 for any free port, or omit it"),
            ({"port": number}, {"port": 0}, "pass another port from 1024 on, or 0 for any"),
            (
                {"host": "203.0.113.1", "port": 0},
                {"host": "127.0.0.1", "port": 0},
                'pass "127.0.0.1", or "0.0.0.0" for all addresses',
            ),
        ):
            check_followed(
                lambda options=options: flat().view(block=False, **options),
                lambda advised=advised: flat().view(block=False, **advised).close(),
                hint,
            )


def test_a_page_of_a_map_is_moved_as_advised():
    pytest.importorskip("viser")
    viewer = flat().view(block=False, port=0)
    with viewer, pytest.raises(InputError, match=r"use move\(q\)"):
        viewer.page.drag(np.eye(4))
    viewer.page.move(np.array(START))
