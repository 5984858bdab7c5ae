"""Slices: their rasters, and rotation cells that share one."""

import math

import numpy as np
import pytest

import cspace
from cspace import Robot, Workspace
from cspace._engines.slices import slice_rasters
from cspace._rotations import RotationCell, Rotations
from cspace._shapes import Shape
from tests.helpers.oracles import raster_offsets
from tests.helpers.strategies import few
from tests.raster.test_turns import BITMAP

ROBOTS = {
    "rectangle": Robot.rectangle(0.93, 0.41),
    "triangle": Robot.polygon([(0.9, 0.1), (-0.3, 0.35), (-0.2, -0.45)]),
    "kite": Robot.polygon([(0.9, 0.0), (0.1, 0.35), (-0.4, 0.0), (0.1, -0.35)]),
    "box": Robot.box((0.93, 0.41, 0.27)),
    "box beside its axis": Robot.box((0.93, 0.41, 0.27), (0.1, 0.0, 0.2)),
    "cells": Robot.from_bitmap(BITMAP, 0.17, (-0.2, -0.1, -0.1)),
}


@pytest.mark.parametrize("rounds", few([1, 3]))
@pytest.mark.parametrize(
    "name, rotations",
    [
        *((name, Rotations.of(count)) for count in (8, 12) for name in ROBOTS),
        *((name, Rotations.quaternions(2)) for name in ("box", "box beside its axis", "cells")),
    ],
)
def test_rasters_hold_at_every_rotation_of_their_slice(name, rotations, rounds):
    """Include slices made as images of others under quarter turns and mirrors."""
    robot = ROBOTS[name]
    rng = np.random.default_rng(0)
    pairs = slice_rasters(robot, 0.083, 0.02, rotations)
    slice_of = rotations._assign_slices(robot.shape)
    cells = np.repeat(np.arange(len(rotations)), rounds)
    matrices = rotations.make_matrices(rotations._sample(cells, 0.0, rng), robot.dim)
    for cell, matrix in zip(cells, matrices, strict=True):
        turn = RotationCell(matrix, 0.0, rotations._about_z)
        outer, inner = map(raster_offsets, pairs[slice_of[cell]])
        outer_there, inner_there = map(raster_offsets, robot.shape.rasters(0.083, 0.02, turn))
        assert outer_there <= outer
        assert inner <= inner_there


@pytest.mark.parametrize(
    "robot, rotations, slices",
    [
        (Robot.box((0.33, 0.21, 0.13)), Rotations.quaternions(2), 8),
        (Robot.rectangle(0.7, 0.3), 8, 4),
        (Robot.from_balls([(0.3, 0.1), (-0.1, 0.3), (-0.3, -0.1), (0.1, -0.3)], 0.15), 12, 3),
        (Robot.disc(0.25, (1e-9, 0.0)), 7, 7),
        (Robot.rectangle(0.7, 0.3), [0.0, 1.0, math.pi, math.pi + 1.0, 2.0 * math.pi], 4),
    ],
    ids=["box", "bar", "four discs", "disc off its center", "unequal cells"],
)
def test_sharing_slices_changes_no_state(robot, rotations, slices, monkeypatch):
    cells = np.random.default_rng(0).random((25, 20) if robot.dim == 2 else (8, 7, 6)) < 0.03
    workspace = Workspace.from_array(cells, 0.1)
    shared = cspace.build(workspace, robot, rotations=rotations, counts=True)
    monkeypatch.setattr(Shape, "symmetry", property(lambda self: 1))
    monkeypatch.setattr(Shape, "symmetries", property(lambda self: [np.eye(3)]))
    monkeypatch.setattr(type(shared.rotations), "_find_images", Rotations._find_images)
    alone = cspace.build(
        workspace, Robot(robot.name, robot.shape), rotations=rotations, counts=True
    )
    assert len(shared.overlap_counts) == slices
    assert len(alone.overlap_counts) == len(alone.rotations)
    assert (shared.cell_states == alone.cell_states).all() and shared.count() == alone.count()
    assert (shared.overlap_counts[shared.slice_of] == alone.overlap_counts).all()


def test_a_robot_that_has_a_map_gets_the_next_one_as_a_new_robot_would():
    rng = np.random.default_rng(1)
    robot = ROBOTS["box"]
    cells = rng.random((20, 18, 9)) < 0.02
    asked = [
        {"spacing": spacing, "margin": margin, "rotations": rotations, "floor": floor}
        for spacing in (0.1, 0.13)
        for margin in (0.0, 0.05)
        for rotations in (None, 5, 6)
        for floor in (None, 0.2, 0.3)
    ]
    for options in [asked[k] for k in rng.integers(0, len(asked), 40)] * 2:
        workspace = Workspace.from_array(cells, options.pop("spacing", 0.1))
        maps = [
            cspace.build(workspace, each, outside="free", **options)
            for each in (robot, robot, Robot(robot.name, robot.shape))
        ]
        assert all((each.cell_states == maps[2].cell_states).all() for each in maps)
