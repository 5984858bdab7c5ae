"""Components of maps against graphs of their cells."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED, Robot, Workspace
from cspace._rotations import Rotations
from tests.helpers import handmade
from tests.helpers.maps import proven_paths
from tests.helpers.strategies import examples, seeds


def test_maps_may_have_more_components_than_two_bytes_can_count():
    chessboard = (np.indices((400, 400)).sum(axis=0) % 2 * BLOCKED).astype(np.uint8)
    states = np.stack([chessboard, np.full_like(chessboard, BLOCKED)])
    states[1, 3, :5] = FREE
    space = handmade.make_map(states, "turning", outside="blocked")
    cells = np.argwhere(states == FREE)[[0, 1, 40_000, 79_999]]
    q = handmade.cell_centers(space, cells)
    assert (proven_paths(space, q[:, None], q[None]) == np.eye(4, dtype=bool)).all()
    assert space.is_disconnected(q[0], q[1:]).all()
    assert not space.is_connected(q[0], q[1:]).any()


@examples(60)
@given(
    seeds,
    st.sampled_from(handmade.MAP_KINDS),
    st.sampled_from(["free", "blocked"]),
    st.sampled_from([(FREE, MIXED, BLOCKED, BLOCKED), (MIXED, *(BLOCKED,) * 5)]),
)
def test_connectivity_agrees_with_components_of_a_graph(seed, kind, outside, mixture):
    """Query pairs of cells of a small map; many are joined only around the grid."""
    states = handmade.random_states(np.random.default_rng(seed), kind, 4, mixture)
    space, cells = handmade.make_map(states, kind, outside), handmade.all_cells(states)
    cells = np.random.default_rng(seed).permutation(cells)[:150]
    q = handmade.cell_centers(space, cells)
    away = np.array(q[0])
    away[: space.grid.dim] = -99.0
    exterior_open = space.classify(away) != BLOCKED
    framed = np.pad(
        states != BLOCKED, [(0, 0)] + [(1, 1)] * space.grid.dim, constant_values=exterior_open
    )
    free = handmade.components(states == FREE, kind)[tuple(cells.T)]
    passable = handmade.components(framed, kind)[(cells[:, 0], *(cells[:, 1:] + 1).T)]
    joined, maybe = (np.equal.outer(one, one) & (one >= 0) for one in (free, passable))
    expected = np.where(joined, True, np.where(maybe, None, False))
    assert proven_paths(space, q[:, None], q[None]).tolist() == expected.tolist()
    for one, other in itertools.pairwise(range(min(len(q), 6))):
        assert proven_paths(space, q[one], q[other]) is expected[one, other]


@pytest.mark.parametrize("outside", ["free", "blocked"])
@pytest.mark.parametrize("kind", handmade.MAP_KINDS)
def test_rooms_that_are_open_through_any_two_borders_are_joined_outside(kind, outside):
    """Each room is one cell, at one border of each axis in turn."""
    walls = handmade.full_states(kind, 7, BLOCKED)
    dim = walls.ndim - 1
    borders = [(axis, end) for axis in range(dim) for end in (0, 6)]
    for one, other in itertools.combinations_with_replacement(borders, 2):
        cells = np.array([[0] + [2] * dim, [0] + [4] * dim])
        for cell, (axis, end) in zip(cells, (one, other), strict=True):
            cell[1 + axis] = end
        states = walls.copy()
        states[(slice(None), *cells[:, 1:].T)] = FREE
        space = handmade.make_map(states, kind, outside)
        answer = proven_paths(space, *handmade.cell_centers(space, cells))
        assert answer is (None if outside == "free" else False), (one, other)


TINY_BAR = Robot.rectangle(1e-6, 1e-7)


@pytest.mark.parametrize(
    "robot, rotations",
    [
        (TINY_BAR, 6),
        (Robot.rectangle(1e-6, 1e-6), 8),
        (Robot.box((1e-6, 1e-7, 1e-7)), 6),
        (Robot.box((1e-6, 1e-7, 1e-7)), Rotations.quaternions(2)),
    ],
)
def test_rotation_cells_that_share_slices_are_joined(robot, rotations):
    cells, shape = Rotations.of(rotations), (4, 3, 2)[: robot.dim]
    kind, slice_of = (
        "turning any way" if len(cells.names) == 4 else "",
        cells._assign_slices(robot.shape),
    )
    workspace = Workspace.from_array(np.zeros(shape, dtype=bool), 0.25)
    for seed in range(6):
        stack = np.random.default_rng(seed).choice(
            np.array([0, 1, 2, 2], np.uint8), (slice_of.max() + 1, *shape)
        )
        space, states = (
            handmade.map_in(workspace, robot, stack, cells, outside="free"),
            stack[slice_of],
        )
        assert len(stack) < len(cells) and (space.cell_states == states).all()
        positions = np.random.default_rng(seed).permutation(handmade.all_cells(states))[:150]
        q = handmade.cell_centers(space, positions)
        free = handmade.components(states == FREE, kind)[tuple(positions.T)]
        answers = proven_paths(space, q[:, None], q[None])
        assert (np.equal(answers, True) == (np.equal.outer(free, free) & (free >= 0))).all()
