"""Slices: rasters of the rotated robot, and symmetry."""

import math

import numpy as np
import pytest

import cspace
from cspace import Robot, Workspace
from cspace.engines.slices import slice_rasters
from cspace.rotations import Rotations
from cspace.shapes import Shape
from tests.helpers import oracles

# ---- quarter turns and symmetry ------------------------------------------------------------------


L_BITMAP = np.array([[[1], [1]], [[1], [0]], [[1], [0]]], dtype=bool)


@pytest.mark.parametrize(
    ("robot", "rotations", "fresh"),
    [
        (Robot.box((0.83, 0.41, 0.27)), Rotations.quaternions(2), 2),
        (Robot.box((0.5, 0.5, 0.5), (0.1, 0.1, 0.1)), Rotations.quaternions(3), 7),
        (Robot.from_bitmap(L_BITMAP, 0.23, (-0.31, -0.17, -0.115)), Rotations.quaternions(3), 15),
        (Robot.box((0.5, 0.3, 0.2), (0.1, 0.0, 0.0)), Rotations.of(12), 2),
        (Robot.polygon([(0.3, 0.0), (-0.2, 0.25), (-0.2, -0.25)]), Rotations.of(16), 3),
    ],
    ids=["box", "cube", "mirrored cells", "drone", "triangle"],
)
def test_rasters_by_world_symmetry_equal_fresh_rasters(robot, rotations, fresh, monkeypatch):
    """Count the rasters; symmetries of the grid give others."""
    made, rasterise = [], Robot.rasters
    with monkeypatch.context() as patched:
        patched.setattr(Robot, "rasters", lambda *args: made.append(args) or rasterise(*args))
        rasters = slice_rasters(robot, 0.17, 0.02, rotations)
    assert len(made) == fresh
    cells = rotations.make_shape_cells(robot.dim)
    for number, cell in zip(
        *np.unique(rotations.assign_slices(robot.shape), return_index=True), strict=True
    ):
        for one, other in zip(rasters[number], robot.rasters(0.17, 0.02, cells[cell]), strict=True):
            # A piece of the boundary with two equally long sides may be cut across either.
            assert (
                len(oracles.raster_offsets(one) ^ oracles.raster_offsets(other)) <= 0.02 * one.count
            )


@pytest.mark.parametrize(
    ("robot", "rotations", "slices"),
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
    monkeypatch.setattr(type(shared.rotations), "find_images", Rotations.find_images)
    alone = cspace.build(workspace, robot, rotations=rotations, counts=True)
    assert len(shared.overlap_counts) == slices
    assert len(alone.overlap_counts) == len(alone.rotations)
    assert (shared.cell_states == alone.cell_states).all() and shared.count() == alone.count()
    assert (shared.overlap_counts[shared.slice_of] == alone.overlap_counts).all()
