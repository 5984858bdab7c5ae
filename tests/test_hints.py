"""Hints of builds, maps, rotations, exports and tiles: each is followed by code."""

import ast
import re
import warnings

import numpy as np
import pytest

import cspace
from cspace import Robot, Rotations, Workspace, build
from cspace.errors import UnitWarning
from tests.helpers.refusals import check_refused, refusals

FLOOR = Workspace.from_array(np.eye(30, 20, dtype=bool), 0.1)
ROOM = Workspace.from_array(np.zeros((12, 10, 8), dtype=bool), 0.1)
CART = Robot.rectangle(0.2, 0.1)


def build_tiles(folder, **options):
    """Build the map of the floor in tiles."""
    return build(FLOOR, CART, store=folder / "tiles.zarr", tile=8, **options)


@refusals(
    "call, hint",
    # Builds.
    (
        lambda _: build("floor.npy", CART),
        "it must be a Workspace",
    ),
    (
        lambda _: build(CART, FLOOR),
        "workspace is a Robot; it must be a Workspace",
    ),
    (
        lambda _: build(FLOOR, FLOOR),
        "robot is a Workspace; a polygon or a mesh is needed",
    ),
    (
        lambda _: build(FLOOR, Robot.ball(0.1)),
        "robot has 3 dimensions but the workspace has 2; they must agree; use robot.footprint()",
    ),
    (lambda _: build(ROOM, CART), "they must agree"),
    (
        lambda _: build(FLOOR, CART, workers=0),
        "it must be a whole number above zero",
    ),
    (
        lambda _: build(FLOOR, CART, method="x"),
        "it must be 'auto', 'fft' or 'direct'",
    ),
    (
        lambda _: build(FLOOR, CART, method="direct", counts=True),
        "method is 'direct' and counts is True; only transforms give counts",
    ),
    (
        lambda _: build(FLOOR, CART, client=object()),
        "only a store has tiles",
    ),
    (
        lambda folder: build_tiles(folder, counts=True),
        "a store has no counts",
    ),
    (
        lambda _: cspace.suggest(FLOOR, CART, gap=0.05),
        "it must be wider than the robot",
    ),
    # Robots.
    (
        lambda _: Robot.from_balls([(0, 0), (1, 0)], [0.1, 0.0]),
        "radii contains 0; each must be above zero",
    ),
    (
        lambda _: Robot.parse("robot"),
        "robot is 'robot'",
    ),
    (
        lambda _: Robot.open("disc:0.3"),
        'the page "Bring your file" says how',
    ),
    (
        lambda _: build(Workspace.from_array(FLOOR.outer, 1e-9), Robot.disc(1.0)),
        "beyond 4194304 cells rounding invalidates proofs",
    ),
    # Rotations.
    (
        lambda _: build(FLOOR, CART, rotations=0),
        "it must be a whole number from 1 to 65536",
    ),
    (
        lambda _: build(FLOOR, CART, rotations=[[0.0]]),
        "it must be a count, or from 2 to 65537 borders in radians",
    ),
    (
        lambda _: build(FLOOR, CART, rotations=[0.0, 90.0, 360.0]),
        "rotations reach from 0 to 360 rad, or do not ascend; borders",
    ),
    (
        lambda _: build(FLOOR, CART, rotations=Rotations.quaternions(2)),
        "rotations are 32 rotations in space; a robot in the plane turns by its yaw",
    ),
    (
        lambda _: Rotations.quaternions(0),
        "it must be a whole number from 1 to 64",
    ),
    (
        lambda _: turning().explain((2.5, 0.5, 1e30), (2.5, 0.5, 0.0)),
        "at most 1048576 can be wrapped exactly",
    ),
    (
        lambda _: Rotations.quaternions(2).check_rotation((0, 0, 0, 2), "rotation"),
        "it must be 1",
    ),
    (
        lambda folder: turning().export(folder / "map.tif"),
        "map.tif holds one slice, and this map has 8 rotation cells",
    ),
    (
        lambda folder: turning().export(folder / "map.tif", rotation=(0.1, 0.2)),
        "a rotation is given by yaw",
    ),
    # Maps.
    (
        lambda _: crowded().sample_free(),
        "no configuration can be drawn",
    ),
    (
        lambda _: crowded().nearest_free((1.0, 1.0)),
        "no configuration can be drawn",
    ),
    (
        lambda _: build(FLOOR, CART).nearest_free([(1.0, 1.0), (1.0, 1.2)]),
        "it must be one configuration, shape (2,)",
    ),
    (
        lambda _: build(FLOOR, CART).add_obstacle("box", Robot.ball(0.3)),
        "it must be in the plane, as the robot is",
    ),
    (
        lambda _: build(FLOOR, CART).explain((9.0, 9.0), (2.5, 0.5)),
        "it must be one configuration in the grid",
    ),
    (
        lambda _: build(FLOOR, CART).update(np.ones((2, 2), dtype=bool), (0.5, 0.5)),
        "it must be 2 integers, the index of the first cell",
    ),
    (
        lambda _: build(FLOOR, CART).update(np.ones((2, 2), dtype=bool), (29, 19)),
        "the box must lie in the grid",
    ),
    (
        lambda _: floating().explain((0.5, 0.5, 0.4, 0, 0, 0, 1), (0.6, 0.5, 0.4, 0, 0, 0, 1)),
        "reasons are for maps of positions, with or without a yaw",
    ),
    # Exports.
    (
        lambda folder: build(FLOOR, CART).export(folder / "map.ply"),
        ".ply holds maps in space only",
    ),
    (
        lambda folder: build(ROOM, Robot.ball(0.1)).export(folder / "map.tif"),
        ".tif holds maps of the plane only",
    ),
    (
        lambda folder: turning().export(folder / "map.npz", rotation=0.5),
        "rotation is 0.5; a .npz map holds every slice",
    ),
    (
        lambda folder: crowded(ROOM, Robot.ball(0.6)).export(folder / "map.ply"),
        "the map has no FREE cell; a boundary needs at least one",
    ),
    (
        lambda folder: cspace.open(folder / "map.npz"),
        ".npz is an export, for numpy.load",
    ),
    (
        lambda folder: build(ROOM, Robot.ball(0.1)).export(folder / "map.ply", rotation=0.5),
        "the robot does not turn",
    ),
    # Tiles.
    (
        lambda folder: build(FLOOR, CART, store=folder / "map.zarr", tile=0),
        "it must be a positive integer, or one for each axis",
    ),
    (
        lambda folder: build_tiles(folder).exact.is_free((1.0, 0.5)),
        "maps in memory, such as space.window",
    ),
    (
        lambda folder: build_tiles(folder) and build_tiles(folder, margin=0.1),
        "a build resumes only with the same robot, rotations, options and obstacles",
    ),
    (
        lambda folder: build_tiles(folder).window((0.5, 0.5), (1.5, 1.0)).update([[True]], (0, 0)),
        "the cells around it matter too",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(call, hint, tmp_path):
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        check_refused(lambda: call(tmp_path), hint)


def turning():
    """Build a map of a cart that turns."""
    return build(FLOOR, CART, rotations=8)


def floating():
    """Build a map of a box that turns in space."""
    return build(ROOM, Robot.box((0.2, 0.2, 0.1)), rotations=Rotations.quaternions(2))


def crowded(workspace=FLOOR, robot=None):
    """Build a map without a FREE cell."""
    return build(workspace, robot or Robot.disc(1.2))


def test_a_robot_moved_as_the_warning_says_has_its_middle_at_the_reference_point():
    corners = np.array([(5.0, 5.0), (5.4, 5.0), (5.4, 5.2), (5.0, 5.2)])
    with pytest.warns(UnitWarning, match="move its center there, by") as caught:
        build(FLOOR, Robot.polygon(corners), outside="free")
    move = ast.literal_eval(re.search(r"by (\(.*?\)) m", str(caught[0].message))[1])
    with warnings.catch_warnings(action="error"):
        space = build(FLOOR, Robot.polygon(corners + move), outside="free")
    assert space.is_free((2.5, 0.5))
