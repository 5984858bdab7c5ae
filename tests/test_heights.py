"""Workspaces of heights, and workspaces in the plane between two heights."""

import numpy as np
import pytest
import trimesh

import cspace
from cspace import InputError, Robot, Workspace

HEIGHTS = np.array([[0.02, 0.25, 1.0], [0.11, -0.3, 0.55]])


def test_columns_are_filled_from_below_in_part_and_in_full():
    space = Workspace.from_heights(HEIGHTS, 0.1, bottom=-0.3, top=1.2)
    assert space.grid.shape == (2, 3, 15) and space.grid.lower == (0.0, 0.0, -0.3)
    lower = -0.3 + 0.1 * np.arange(15)
    for x, y in np.ndindex(HEIGHTS.shape):
        filled = HEIGHTS[x, y] - lower
        assert (space.outer[x, y] == (filled > 1e-9)).all()
        assert (space.inner[x, y] == (filled > 0.1 - 1e-9)).all()
    assert Workspace.from_heights(HEIGHTS, 0.1).grid.shape == (2, 3, 13)
    assert Workspace.from_heights(np.zeros((4, 3)), 0.1).outer.sum() == 0


def test_a_drone_and_a_cart_meet_the_terrain():
    heights = np.zeros((40, 30))
    heights[20:22] = 0.47
    heights[20:22, :4] = 1.5
    terrain = Workspace.from_heights(heights, 0.1, top=2.0)
    drone = cspace.build(terrain, Robot.ball(0.1))
    assert drone.is_free((2.1, 1.5, 0.75)) and not drone.is_free((2.1, 0.2, 0.75))
    cart = cspace.build(
        terrain, Robot.box((0.3, 0.3, 0.2), (0.0, 0.0, 0.2)), rotations=4, floor=0.0
    )
    assert cart.is_free((1.0, 1.5, 0.0)) and cart.is_disconnected((1.0, 1.5, 0.0), (3.0, 1.5, 0.0))


def test_coordinates_of_an_array_place_it():
    xarray = pytest.importorskip("xarray")
    rows = xarray.DataArray(
        HEIGHTS.T[::-1],
        dims=("y", "x"),
        coords={"x": [5.05, 5.15], "y": [7.25, 7.15, 7.05]},
        attrs={"units": "m"},
    )
    space = Workspace.from_heights(rows, 0.1)
    assert np.allclose(space.grid.lower, (5.0, 7.0, -0.3))
    assert (space.outer == Workspace.from_heights(HEIGHTS, 0.1).outer).all()
    far = rows.assign_coords(x=rows.x + 300_000.1, y=rows.y + 400_000.3)
    assert Workspace.from_heights(far, 0.1).grid.shape == space.grid.shape
    with pytest.raises(InputError, match="unit feet"):
        Workspace.from_heights(rows.assign_attrs(units="feet"), 0.1)
    with pytest.raises(InputError, match="'y', 'x'"):
        Workspace.from_heights(rows.drop_vars(["x", "y"]), 0.1)


@pytest.mark.parametrize("nothing", [np.nan, -9999.0, -32768.0, 3.4e38, np.inf])
def test_columns_without_data_are_refused_or_told(nothing):
    heights = HEIGHTS.copy()
    heights[0, 0] = nothing
    with pytest.raises(InputError, match=r"1 columns without data.*unknown='occupied'"):
        Workspace.from_heights(heights, 0.1)
    occupied = Workspace.from_heights(heights, 0.1, unknown="occupied")
    free = Workspace.from_heights(heights, 0.1, unknown="free")
    assert occupied.outer[0, 0].all() and not free.outer[0, 0].any()
    assert not occupied.inner[0, 0].any() and occupied.unknown[0, 0].all()
    assert (occupied.outer[1] == free.outer[1]).all() and occupied.grid.shape == (2, 3, 13)


@pytest.mark.parametrize(
    "heights, message",
    [
        (np.zeros(4), "shape \\(4,\\) and 4 heights"),
        (np.full((2, 2), np.nan), "0 heights"),
        (np.ma.masked_less(HEIGHTS, 0.0), "masked"),
        (1000.0 * HEIGHTS.repeat(4000, 0).repeat(4000, 1), "cells of .* m fit"),
    ],
    ids=["a row", "no data", "masked", "millimetres"],
)
def test_heights_that_make_no_map_are_refused(heights, message):
    with pytest.raises(InputError, match=message):
        Workspace.from_heights(heights, 0.01)
    with pytest.raises(InputError, match="bottom and top"):
        Workspace.from_heights(HEIGHTS, 0.1, top=np.nan)


def test_a_map_between_heights_is_that_of_the_obstacles_there():
    table = trimesh.creation.box(bounds=[(1.0, 1.0, 0.7), (2.0, 2.0, 0.8)])
    wall = trimesh.creation.box(bounds=[(3.0, 0.0, 0.0), (3.2, 3.0, 2.0)])
    room = Workspace.from_mesh(trimesh.util.concatenate([table, wall]), 0.1)
    below, above = room.between(0.1, 0.55), room.between(0.1, 1.8)
    assert above.grid.lower == room.grid.lower[:2] and above.grid.shape == room.grid.shape[:2]
    space = cspace.build(below, Robot.disc(0.2))
    assert space.is_free((1.5, 1.5)) and not space.is_free((3.1, 1.5))
    assert not cspace.build(above, Robot.disc(0.2)).is_free((1.5, 1.5))
    assert (above.outer == room.outer.any(axis=2)).all() and (above.inner <= above.outer).all()
    with pytest.raises(InputError, match=r"workspace\.between\(bottom, top\)"):
        cspace.build(room, Robot.disc(0.2))
    cloud = Workspace.from_points([(0.0, 0.0, 0.05), (1.0, 1.0, 0.5)], 0.1, radius=0.02)
    assert cloud.between(0.2, 1.0).outer.sum() < cloud.between(0.0, 1.0).outer.sum()


@pytest.mark.parametrize("heights", [(1.0, 0.5), (5.0, 6.0), (-2.0, -1.0)])
def test_heights_beyond_the_map_are_refused(heights):
    with pytest.raises(InputError, match="bottom and top are"):
        Workspace.from_heights(HEIGHTS, 0.1).between(*heights)
    with pytest.raises(InputError, match="is in the plane"):
        Workspace.from_array(np.eye(3, dtype=bool), 0.1).between(0.0, 1.0)
