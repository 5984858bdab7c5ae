"""The map as an object: copies, pictures; and look-ups of a space whose positions and rotations come from elsewhere."""

import copy
import pickle

import numpy as np
import pytest

import cspace
from cspace import FREE
from cspace.rotations import Rotations
from handmade import Lookups, Outside


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


def test_positions_in_space_with_a_yaw():
    """R^3 x SO(2): points, boxes and edges of states made by hand, against the cells that they touch."""
    rng = np.random.default_rng(0)
    states = np.where(rng.random((6, 5, 4, 3)) < 0.1, 1, FREE).astype(np.uint8)
    cells = Rotations.of(6)
    look = Lookups(states, Outside(np.array([0, 0, 0, -1, -1, -1]), 2), 0.25, (0.0, 0.0, 0.0), cells)
    upper = 0.25 * np.array(states.shape[1:])
    q = np.column_stack([rng.uniform(-0.1, upper + 0.1, (3000, 3)), rng.uniform(-9, 9, 3000)])
    index = np.floor(q[:, :3] / 0.25).astype(int)
    inside = ((index >= 0) & (index < states.shape[1:])).all(axis=1)
    turn = cells.cell_of(q[:, 3])
    expected = np.full(len(q), 2)
    expected[inside] = states[(turn[inside], *index[inside].T)]
    out = np.empty(len(q), np.uint8)
    assert look.classify()(q, out) == -1
    assert (out == expected).all()
    check = look.point_checker()
    assert [check(*one) for one in q[:300].tolist()] == (out[:300] == FREE).tolist()

    ends = q + np.column_stack([rng.normal(size=(3000, 3)) * 0.2, rng.uniform(-3, 3, 3000)])
    free = np.empty(len(q), np.bool_)
    assert look.edges()(q, ends, free) == -1
    told = free.copy()
    assert look.edges(1)(q, ends, free) == -1 and (told == free).all()  # with the help of a coarse map
    edge = look.edge_checker()
    assert [edge(*a, *b) for a, b in zip(q.tolist(), ends.tolist(), strict=True)] == told.tolist()
    samples = np.linspace(0.0, 1.0, 101)[:, None, None]
    between = (q + samples * (ends - q)).reshape(-1, 4)
    states_between = np.empty(len(between), np.uint8)
    assert look.classify()(between, states_between) == -1
    clear = (states_between.reshape(101, -1) == FREE).all(axis=0)
    assert not (told & ~clear).any()  # no sample of a free edge is anything but FREE
    assert told.any() and (told == clear).mean() > 0.9
