"""The same maps in tiles and in memory."""

import re
from typing import NamedTuple

import numpy as np
import zarr

import cspace
from cspace import Robot, Rotations

CAR = Robot.polygon([(-0.2, -0.1), (0.3, -0.1), (0.3, 0.1), (-0.2, 0.1)])
CRATE = Robot.box((0.3, 0.2, 0.1), (0.1, 0.0, 0.0))
KINDS = {
    "plane": ((40, 33), Robot.disc(0.25), None),
    "space": ((12, 14, 13), Robot.ball(0.12), None),
    "yaw": ((30, 27), CAR, 8),
    "yaw in space": ((10, 12, 9), CRATE, 6),
    "quaternions": ((9, 8, 7), CRATE, Rotations.quaternions(1)),
}
"""Shape of the workspace, robot and rotation cells in each space."""


class Pair(NamedTuple):
    """A map in memory, and the same map in tiles."""

    space: cspace.CSpace
    tiled: cspace.TiledCSpace


def random_workspace(shape, seed=0, two=False, density=None):
    """Draw obstacles, 1 % of the cells by default; with ``two``, only half of them are inner."""
    rng = np.random.default_rng(seed)
    if density is None:
        density = 0.01 if len(shape) == 2 else 0.003
    outer = rng.random(shape) < density
    inner = outer & (rng.random(shape) < 0.5) if two else None
    lower = rng.uniform(-1.0, 1.0, len(shape))
    return cspace.Workspace.from_array(outer, 0.1, lower, inner=inner)


def build_pair(workspace, robot, store, tile=7, **options):
    """Build a map in memory and in tiles."""
    space = cspace.build(workspace, robot, **options)
    return Pair(space, cspace.build(workspace, robot, store=store, tile=tile, **options))


def build_kind(kind, store, outside="blocked"):
    """Build a map of a kind in memory and in tiles; inner cells differ if the exterior is free."""
    shape, robot, rotations = KINDS[kind]
    workspace = random_workspace(shape, two=outside == "free")
    return build_pair(workspace, robot, store, rotations=rotations, outside=outside)


def find_tiles(path):
    """Return the folders of finished tiles by name."""
    return {
        entry.name: entry for entry in path.iterdir() if re.fullmatch(r"\d+(\.\d+)+", entry.name)
    }


def check_states(path, space):
    """Fail unless a tiled map has the states and obstacles of a map in memory."""
    tiled = cspace.open(path)
    whole = tiled.window(space.grid.lower, space.grid.upper)
    np.testing.assert_array_equal(whole.cell_states, space.cell_states)
    np.testing.assert_array_equal(whole.workspace.outer, space.workspace.outer)
    np.testing.assert_array_equal(whole.workspace.inner, space.workspace.inner)
    assert (whole.outside, whole.grid) == (space.outside, space.grid)
    assert (tiled.count(), tiled.progress) == (space.count(), 1.0)
    check_tiles(path, space)


def check_tiles(path, space):
    """Fail unless each finished tile has the states of a part of a map in memory."""
    for folder in find_tiles(path).values():
        tile = zarr.open_group(folder, mode="r")
        offset = np.subtract(tile.attrs["lower"], space.grid.lower) / space.grid.spacing
        first = np.rint(offset).astype(int)
        box = tuple(map(slice, first, first + tile.attrs["shape"]))
        states = space._map_contents.states[:, *box]
        np.testing.assert_array_equal(tile["cell_states"][:], states)
        np.testing.assert_array_equal(tile["outer"][:], space.workspace.outer[box])
