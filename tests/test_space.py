"""Maps as objects: copies, sizes and pictures."""

import numpy as np
import pytest

import cspace


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
    workspace = cspace.Workspace.from_array(np.zeros((4,) * len(side), dtype=bool), 0.5)
    robot = cspace.Robot.rectangle(*side) if len(side) == 2 else cspace.Robot.box(side)
    space = cspace.build(workspace, robot, rotations=rotations)
    assert (space.dof, space.size, len(space.axes)) == (dof, size, size)
