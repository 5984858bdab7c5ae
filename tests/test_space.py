"""Maps as objects: copies, sizes and pictures."""

import pytest

import cspace
from tests.helpers.handmade import build_empty


@pytest.mark.parametrize(
    "side, rotations, dof, size",
    [
        ((0.3, 0.1), None, 2, 2),
        ((0.3, 0.1), 4, 3, 3),
        ((0.3, 0.1, 0.1), 4, 4, 4),
        ((0.3, 0.1, 0.1), cspace.Rotations.quaternions(1), 6, 7),
    ],
    ids=["R2", "SE2", "R3xSO2", "SE3"],
)
def test_dof_counts_degrees_of_freedom_and_size_coordinates(side, rotations, dof, size):
    robot = cspace.Robot.rectangle(*side) if len(side) == 2 else cspace.Robot.box(side)
    space = build_empty((4,) * len(side), robot, 0.5, rotations=rotations)
    assert (space.dof, space.size, len(space.axes)) == (dof, size, size)
