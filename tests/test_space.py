"""Maps as objects: copies, sizes and pictures."""

import copy
import pickle

import numpy as np
import pytest

import cspace


def build_map(rotations=None):
    occupied = np.random.default_rng(0).random((30, 20)) < 0.05
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    return cspace.build(
        workspace, cspace.Robot.rectangle(0.3, 0.1), rotations=rotations, counts=True
    )


@pytest.mark.parametrize("rotations", [None, 8])
@pytest.mark.parametrize(
    "twin", [copy.copy, copy.deepcopy, lambda space: pickle.loads(pickle.dumps(space))]
)
def test_copies_change_independently(rotations, twin):
    space = build_map(rotations)
    space.is_connected(np.ones(space.size), np.ones(space.size))
    space.update(np.ones((2, 2), dtype=bool), (3, 4))
    other = twin(space)
    assert (other.cell_states == space.cell_states).all() and other.overlap_counts is None
    before = space.cell_states.copy()
    other.update(np.ones((9, 9), dtype=bool), (10, 5))
    assert (space.cell_states == before).all() and (other.cell_states != before).any()
    fresh = cspace.build(
        cspace.Workspace.from_array(other.workspace.outer, 0.1),
        other.robot,
        rotations=rotations,
        counts=True,
    )
    assert (other.cell_states == fresh.cell_states).all()


@pytest.mark.parametrize(
    ("side", "rotations", "dof", "size"),
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
