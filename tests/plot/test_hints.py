"""Hints of pictures, pages and animations: each is followed by code."""

from functools import cache

import matplotlib.pyplot as plt
import numpy as np
import pytest

from cspace import Robot, Workspace, build
from cspace.errors import InputError
from cspace.plot import animate, save_plot
from tests.helpers.refusals import check_refused, refusals


@cache
def flat():
    """Build a map in the plane."""
    return build(Workspace.from_array(np.eye(9, dtype=bool), 0.1), Robot.disc(0.05))


@cache
def spatial():
    """Build a map in space."""
    return build(Workspace.from_array(np.ones((4, 4, 4), dtype=bool), 0.1), Robot.ball(0.05))


START, GOAL = (0.65, 0.15), (0.75, 0.25)
PATH = [START, GOAL]


@refusals(
    "call, hint",
    (
        lambda f: animate(flat(), np.zeros((0, 2)), f / "a.gif"),
        "path is empty ... animation",
    ),
    (
        lambda f: animate(flat(), PATH, f / "a.gif", seconds=1e4),
        "seconds is 10000.0, which makes 100001 frames ... possible",
    ),
    (
        lambda f: animate(flat(), PATH, f / "a.png"),
        "an animation is a GIF",
    ),
    (
        lambda f: flat().plot(ax=plt),
        "ax is a module ... matplotlib axes",
    ),
    (
        lambda f: spatial().plot(view="3d", ax=plt.figure().add_subplot()),
        "ax has two dimensions ... three",
    ),
    (
        lambda f: flat().plot(center=(0.1, 0.1)),
        "center is given with view plane ... sections",
    ),
    (
        lambda f: spatial().plot(center=(9, 9, 9)),
        "center is [9.0, 9.0, 9.0] ... 0.0",
    ),
    (
        lambda f: flat().plot(start=(1, 2, 3)),
        "start has shape (3,) ... (2,): x, y",
    ),
    (
        lambda f: save_plot(flat(), f / "a.png", dpi=1e6),
        "dpi is 1000000.0 ... 2,400",
    ),
    (
        lambda f: flat().plot(path=[(1.0, 2.0, 3.0)]),
        "path has shape (1, 3) ... (n, 2)",
    ),
    (lambda f: flat().plot(rotation=0.5), "rotation has shape (1,) ... turn"),
    (
        lambda f: save_plot(flat().plot(), f / "a.png"),
        "space is a Axes ... a map or a workspace",
    ),
    (
        lambda f: save_plot(flat(), f / "a.xyz"),
        "the suffix says what to write",
    ),
    (
        lambda f: spatial().plot(view="3d", camera=(30, 120, 3)),
        "camera is (30, 120, 3) ... (elevation",
    ),
    (lambda f: animate(flat(), PATH, f / "a.gif", seconds=0), "seconds is 0"),
    (
        lambda f: animate(flat(), PATH, f / "a.gif", camera=(30, 30)),
        "camera is given for a plane map",
    ),
)
def test_a_wrong_picture_is_refused(call, hint, tmp_path):
    def draw():
        try:
            call(tmp_path)
        finally:
            assert not any(tmp_path.iterdir()), "a refused picture is written"

    check_refused(draw, hint)
    plt.close("all")


def test_a_page_of_a_map_has_no_frame_to_drag():
    pytest.importorskip("viser")
    with flat().view(block=False, port=0) as viewer, pytest.raises(InputError, match="only arms"):
        viewer.page.drag(np.eye(4))
