"""Geometry of the page: borders, sections, robots and poses."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import cspace
from cspace._rotations import Rotations
from cspace.plot.scene import CellClass
from cspace.view._blocks import KINDS, Cells, extract_border, hex_to_rgb, make_robot_surface
from cspace.view._map_canvas import PoseDials
from tests.helpers.handmade import fill_boxes


def count_squares(rectangles, shape):
    """Count how often rectangles cover each unit square, by axis, side and position."""
    counts = np.zeros((3, 2, *np.add(shape, 1)), dtype=np.int64)
    for corners in rectangles:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
        (axis,) = np.flatnonzero(normal)
        stop = corners.max(axis=0)
        stop[axis] += 1
        counts[axis, int(normal[axis] > 0)][*map(slice, corners.min(axis=0), stop)] += 1
    return counts


def find_squares(solid, has_boundary):
    """Find the unit squares between solid cells and others, one cell at a time."""
    counts = np.zeros((3, 2, *np.add(solid.shape, 1)), dtype=np.int64)
    for cell, axis, up in itertools.product(np.argwhere(solid), range(3), (0, 1)):
        other = cell.copy()
        other[axis] += 2 * up - 1
        if 0 <= other[axis] < solid.shape[axis]:
            is_border = not solid[tuple(other)]
        else:
            is_border = has_boundary
        cell = cell.copy()
        cell[axis] += up
        counts[axis, up, *cell] += is_border
    return counts


@given(
    seed=st.integers(0, 2**16),
    share=st.sampled_from([0.0, 0.3, 0.8, 1.0]),
    has_boundary=st.booleans(),
)
def test_rectangles_cover_the_border_once(seed, share, has_boundary):
    solid = np.random.default_rng(seed).random((5, 3, 4)) < share
    actual = count_squares(extract_border(solid, has_boundary), solid.shape)
    np.testing.assert_array_equal(actual, find_squares(solid, has_boundary))


@pytest.mark.parametrize("cut", [0.6, 1.75, 4.5, 9.0])
def test_solids_end_at_the_cut(cut):
    """Obstacles of a robot on a floor are those in space, and its states are walls on the floor."""
    occupied = fill_boxes((12, 10, 8), np.s_[:, :, 0], np.s_[3, 4:6, :], np.s_[8, :, 6:])
    workspace = cspace.Workspace.from_array(occupied, 0.5, lower=(-1.0, 2.0, 0.5))
    ball = Cells(cspace.build(workspace, cspace.Robot.ball(0.4)), 1.0)
    box = cspace.Robot.box((0.4, 0.4, 0.6))
    on_floor = Cells(cspace.build(workspace, box, floor=1.4), 0.2)
    heights = np.clip((cut - 0.5) / 0.5 - np.arange(8), 0.0, 1.0)
    for cells in (ball, on_floor):
        mesh = trimesh.Trimesh(*cells.make_solid(None, KINDS["obstacles"], cut))
        assert mesh.bounds[1, 2] == pytest.approx(min(cut, 4.5))
        assert mesh.volume == pytest.approx(0.5**3 * (occupied * heights).sum())
    walls, _ = on_floor.make_solid(0, KINDS["border"], 9.0)
    assert np.ptp(walls, axis=0)[2] == pytest.approx(0.2)
    assert walls[:, 2].min() == pytest.approx(1.4)


def read_pixel(section, x, y):
    """Return the pixel at a position; the first row has the largest y."""
    rows, columns = section.image.shape[:2]
    across, up = (np.array([x, y]) - section.lower) / (section.upper - section.lower)
    return tuple(section.image[int((1.0 - up) * rows), int(across * columns)].tolist())


def test_sections_show_cells_at_their_positions():
    obstacle = (*hex_to_rgb(CellClass.OBSTACLE.color), 255)
    occupied = fill_boxes((9, 6, 4), np.s_[7, 1, 2])
    flat = cspace.Workspace.from_array(occupied[:, :, 2], 0.1)
    space = cspace.build(flat, cspace.Robot.disc(0.05))
    section = Cells(space, 0.2).make_section(0, 0.2)
    assert read_pixel(section, 0.75, 0.15) == obstacle
    assert read_pixel(section, 0.15, 0.45) == (255, 255, 255, 255)
    high = cspace.Workspace.from_array(occupied, 0.1)
    space = cspace.build(high, cspace.Robot.ball(0.05), outside="free")
    cells = Cells(space, 0.2)
    assert read_pixel(cells.make_section(0, 0.25), 0.75, 0.15) == obstacle
    *_, opacity = read_pixel(cells.make_section(0, 0.05), 0.75, 0.15)
    assert opacity == 0  # free cells are transparent


def test_a_plane_robot_becomes_a_slab():
    outline = shapely.box(0, 0, 2, 1) - shapely.box(0.5, 0.25, 1.0, 0.75)
    mesh = trimesh.Trimesh(*make_robot_surface(cspace.Robot.polygon(outline), 0.5))
    mesh.merge_vertices()
    assert mesh.volume == pytest.approx(0.5 * outline.area)
    assert mesh.is_watertight


@pytest.mark.parametrize(
    "dim, cells, angles",
    [
        (2, None, ()),
        (2, 8, ("yaw",)),
        (3, 8, ("yaw",)),
        (3, Rotations.quaternions(2), ("roll", "pitch", "yaw")),
    ],
    ids=["R2", "SE2", "R3xSO2", "SE3"],
)
def test_poses_and_dials_give_back_the_configuration(dim, cells, angles):
    rotations = Rotations.of(cells)
    rng = np.random.default_rng(0)
    poses = PoseDials(dim, rotations)
    assert poses.angles == angles
    for _ in range(20):
        q = np.concatenate([rng.normal(size=dim), rotations._sample(np.array([0]), 0.0, rng)[0]])
        dials = poses.dial_values(q)
        position, wxyz = poses.pose(q)
        assert position[:dim].tolist() == q[:dim].tolist()
        turn = Rotation.from_quat(wxyz, scalar_first=True)
        degrees = np.zeros(3)
        degrees[3 - len(angles) :] = dials[dim:]
        fixed_axes = Rotation.from_euler("xyz", degrees, degrees=True)
        np.testing.assert_allclose((turn.inv() * fixed_axes).magnitude(), 0.0, atol=1e-6)
        for again in (poses.configuration_of(dials), poses.nearest_configuration(position, wxyz)):
            np.testing.assert_allclose(rotations.steps_between(q, again), 0.0, atol=1e-7)
