"""Hints of builds, maps, rotations, exports and tiles: each is followed by code."""

import warnings

import numpy as np

import cspace
from cspace import Robot, Rotations, Workspace, build
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
        lambda _: build(FLOOR, FLOOR),
        "robot is a Workspace ... polygon",
    ),
    (
        lambda _: build(FLOOR, CART, workers=0),
        "workers is 0 ... whole number above zero",
    ),
    (
        lambda _: build(FLOOR, CART, method="x"),
        "method is 'x' ... 'auto', 'fft' or 'direct'",
    ),
    (
        lambda _: build(FLOOR, CART, method="direct", counts=True),
        "method is 'direct' and counts is True ... transforms",
    ),
    (
        lambda _: build(FLOOR, CART, client=object()),
        "client is given without a store ... tiles",
    ),
    (
        lambda folder: build_tiles(folder, counts=True),
        "counts is True with a store",
    ),
    (
        lambda _: cspace.suggest(FLOOR, CART, gap=0.05),
        "gap is 0.05 m and the robot is 0.1 m wide ... wider than the robot",
    ),
    # Robots.
    (
        lambda _: Robot.from_balls([(0, 0), (1, 0)], [0.1, 0.0]),
        "radii contains 0 ... above zero",
    ),
    (
        lambda _: Robot.open("disc:0.3"),
        "robot is disc:0.3 ... Robot.parse takes",
    ),
    (
        lambda _: build(Workspace.from_array(FLOOR.outer, 1e-9), Robot.disc(1.0)),
        "robot reaches 1e+09 cells from its reference point ... 4194304",
    ),
    # Rotations.
    (
        lambda _: build(FLOOR, CART, rotations=0),
        "rotations is 0 ... 1 to 65536",
    ),
    (
        lambda _: build(FLOOR, CART, rotations=[0.0, 90.0, 360.0]),
        "rotations reach from 0 to 360 rad, or do not ascend; borders",
    ),
    (
        lambda _: build(FLOOR, CART, rotations=Rotations.quaternions(2)),
        "rotations are 32 rotations in space ... turns",
    ),
    (
        lambda _: turning().explain((2.5, 0.5, 1e30), (2.5, 0.5, 0.0)),
        "start has a yaw of 1e+30 rad ... 1048576",
    ),
    (
        lambda _: Rotations.quaternions(2).check_rotation((0, 0, 0, 2), "rotation"),
        "rotation has a quaternion of norm 2 ... 1",
    ),
    (
        lambda folder: turning().export(folder / "map.tif"),
        "rotation is missing ... map.tif",
    ),
    (
        lambda folder: turning().export(folder / "map.tif", rotation=(0.1, 0.2)),
        "rotation has shape (2,) ... given",
    ),
    # Maps.
    (
        lambda _: build(FLOOR, CART).nearest_free([(1.0, 1.0), (1.0, 1.2)]),
        "q has shape (2, 2) ... one configuration of 2 numbers",
    ),
    (
        lambda _: build(FLOOR, CART).add_obstacle("box", Robot.ball(0.3)),
        "shape is in space ... plane",
    ),
    (
        lambda _: build(FLOOR, CART).explain((9.0, 9.0), (2.5, 0.5)),
        "start is [9.0, 9.0] ... grid",
    ),
    (
        lambda _: floating().explain((0.5, 0.5, 0.4, 0, 0, 0, 1), (0.6, 0.5, 0.4, 0, 0, 0, 1)),
        "space has the axes x, y, z, qx, qy, qz, qw ... reasons",
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
        "rotation is 0.5 ... slice",
    ),
    (
        lambda folder: crowded(ROOM, Robot.ball(0.6)).export(folder / "map.ply"),
        "the map has no FREE cell ... boundary",
    ),
    (
        lambda folder: cspace.open(folder / "map.npz"),
        "map.npz: does not exist ... numpy.load",
    ),
    (
        lambda folder: build(ROOM, Robot.ball(0.1)).export(folder / "map.ply", rotation=0.5),
        "rotation has shape (1,) ... turn",
    ),
    # Tiles.
    (
        lambda folder: build_tiles(folder).exact.is_free((1.0, 0.5)),
        "exact is that of a map in tiles ... space.window",
    ),
    (
        lambda folder: build_tiles(folder) and build_tiles(folder, margin=0.1),
        "tiles.zarr: holds another map, or one of other obstacles ... rotations",
    ),
    (
        lambda folder: build_tiles(folder).window((0.5, 0.5), (1.5, 1.0)).update([[True]], (0, 0)),
        "the map is a window of a larger one ... matter",
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
