"""The map as an object: copies and pictures."""

import copy
import pickle

import numpy as np
import pytest

import cspace


def made(rotations=None):
    occupied = np.random.default_rng(0).random((30, 20)) < 0.05
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    return cspace.build(workspace, cspace.Robot.rectangle(0.3, 0.1), rotations=rotations, overlap=True)


@pytest.mark.parametrize("rotations", [None, 8])
@pytest.mark.parametrize("twin", [copy.copy, copy.deepcopy, lambda space: pickle.loads(pickle.dumps(space))])
def test_copies_are_maps_of_their_own(rotations, twin):
    space = made(rotations)
    space.path_exists(np.ones(space.dof), np.ones(space.dof))
    space.update(np.ones((2, 2), dtype=bool), (3, 4))
    other = twin(space)
    assert (other.state == space.state).all() and (other.overlaps == space.overlaps).all()
    before = space.state.copy()
    other.update(np.ones((9, 9), dtype=bool), (10, 5))
    assert (space.state == before).all() and (other.state != before).any()
    fresh = cspace.build(
        cspace.Workspace.from_array(other.workspace.outer, 0.1), other.robot, rotations=rotations, overlap=True
    )
    assert (other.state == fresh.state).all() and (other.overlaps == fresh.overlaps).all()


def test_notebooks_get_a_picture():
    assert made()._repr_html_().count("data:image/png;base64,") == 1
