"""Rasters of rotating shapes, in the plane and in space."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import Robot, make_mesh
from cspace._rotations import NO_ROTATION, RotationCell
from cspace._shapes import Box, Voxels
from tests.helpers.mesh_files import make_box
from tests.helpers.strategies import examples, robots, seeds


def yaw_turn(yaw, covering_angle=0.0, dim=2):
    return RotationCell(
        Rotation.from_rotvec([0, 0, yaw]).as_matrix()[:dim, :dim], covering_angle, about_z=True
    )


def list_positions(raster):
    return set(map(tuple, (np.argwhere(raster.cells) + raster.lower).tolist()))


def make_rasters(robot, spacing, margin=0.0, turn=NO_ROTATION):
    return [list_positions(raster) for raster in robot.shape.rasters(spacing, margin, turn)]


# ---- the plane -----------------------------------------------------------------------------------


bars = st.tuples(st.floats(0.3, 4.0), st.floats(0.2, 0.6), st.floats(-1.0, 1.0)).map(
    lambda sizes: Robot.rectangle(sizes[0], sizes[1], (sizes[2], 0.0))
)


@examples(60)
@given(
    robots() | bars,
    st.floats(-7, 7),
    st.floats(0, 0.3) | st.floats(0, 3.2),
    st.sampled_from([0.0, 0.1]),
)
def test_rasters_of_a_rotation_cell_hold_for_every_yaw_in_it(robot, yaw, angle, margin):
    """Draw robots many cells large, whose ends move farther than a cell."""
    outer, inner = make_rasters(robot, 0.04, margin, yaw_turn(yaw, angle))
    for share in (-1.0, -0.3, 0.0, 0.6, 1.0):
        there = make_rasters(robot, 0.04, margin, yaw_turn(yaw + share * angle))
        assert there[0] <= outer
        assert inner <= there[1]


# ---- space ---------------------------------------------------------------------------------------

TORUS = trimesh.creation.torus(0.4, 0.15, major_sections=16, minor_sections=8)
CAVITY = trimesh.util.concatenate(
    [trimesh.creation.box((1.0, 0.8, 0.6)), trimesh.creation.box((0.6, 0.5, 0.3))]
)
CAVITY.faces[12:] = CAVITY.faces[12:, ::-1]
BITMAP = np.array([[[1, 1], [1, 0]], [[1, 0], [0, 0]], [[1, 0], [0, 1]]], dtype=bool)

SOLID = {
    "box": lambda: Robot.box((0.7, 0.4, 0.2), (0.2, 0.1, 0.0)),
    "balls": lambda: Robot.from_balls([(0.2, 0.0, 0.1), (-0.3, 0.1, 0.0)], [0.2, 0.15]),
    "cells": lambda: Robot.from_bitmap(BITMAP, 0.17, (-0.2, -0.1, -0.1)),
    "torus": lambda: Robot.from_mesh((TORUS.vertices, TORUS.faces)),
    "cavity": lambda: Robot.from_mesh((CAVITY.vertices, CAVITY.faces)),
    "surface": lambda: Robot.from_mesh((TORUS.vertices, TORUS.faces), solid="surface"),
}


def draw_rotation(rng, about_z, angle=0.0):
    rotation = (
        Rotation.from_rotvec([0, 0, rng.uniform(-4, 4)]) if about_z else Rotation.random(rng=rng)
    )
    return RotationCell(rotation.as_matrix(), angle, about_z)


def draw_within(rng, turn):
    """Draw a rotation of a cell, often on its boundary."""
    way = np.array([0.0, 0.0, rng.choice([-1.0, 1.0])]) if turn.about_z else rng.normal(size=3)
    angle = turn.covering_angle * min(1.0, rng.uniform(0.0, 1.3))
    matrix = Rotation.from_rotvec(way / np.linalg.norm(way) * angle).as_matrix() @ turn.matrix
    return RotationCell(matrix, 0.0, turn.about_z)


@pytest.mark.parametrize("name", SOLID)
@pytest.mark.parametrize("about_z", [False, True])
def test_rasters_in_space_hold_for_every_rotation_of_the_cell(name, about_z):
    robot = SOLID[name]()
    rng = np.random.default_rng(len(name))
    for angle, margin in ((0.03, 0.0), (0.2, 0.07), (2.0, 0.0)):
        rotation = draw_rotation(rng, about_z, angle)
        outer, inner = make_rasters(robot, 0.12, margin, rotation)
        for _ in range(4):
            outer_there, inner_there = make_rasters(robot, 0.12, margin, draw_within(rng, rotation))
            assert outer_there <= outer
            assert inner <= inner_there
        if angle == 0.03 and name != "surface":
            assert inner


@examples(25)
@given(seeds, st.booleans(), st.sampled_from([0.1, 0.25]), st.sampled_from([0.0, 0.3]))
def test_a_rotated_box_is_the_mesh_of_its_faces_and_the_union_of_its_cells(
    seed, about_z, spacing, margin
):
    rng = np.random.default_rng(seed)
    side, counts = rng.uniform(0.05, 0.4), rng.integers(1, 4, 3)
    box = Box(side * counts, rng.uniform(-0.5, 0.5, 3))
    rotation = draw_rotation(rng, about_z)
    mesh, cells = (
        make_mesh(make_box(box.lower, box.upper)),
        Voxels.of(np.ones(counts, bool), side, box.lower),
    )
    for mine, *others in zip(
        *(shape.rasters(spacing, margin, rotation) for shape in (box, mesh, cells)), strict=True
    ):
        assert all(list_positions(mine) == list_positions(there) for there in others)


@examples(15)
@given(
    seeds, st.booleans(), st.sampled_from(["auto", "surface", "fill"]), st.sampled_from([0.0, 0.1])
)
def test_a_rotated_mesh_is_the_mesh_of_rotated_vertices(seed, about_z, solid, margin):
    rng = np.random.default_rng(seed)
    vertices = np.asarray(CAVITY.vertices) + rng.uniform(-0.3, 0.3, 3)
    rotation = draw_rotation(rng, about_z)
    turned = make_mesh((vertices @ rotation.matrix.T, CAVITY.faces), solid).rasters(0.08, margin)
    for mine, there in zip(
        make_mesh((vertices, CAVITY.faces), solid).rasters(0.08, margin, rotation),
        turned,
        strict=True,
    ):
        assert list_positions(mine) == list_positions(there)
