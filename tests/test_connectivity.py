"""path_exists against a flood fill, and proofs of absence that a person can check."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
import oracles
from cspace import BLOCKED, FREE, CSpace, InputError, Robot, Workspace
from strategies import seeds


@settings(max_examples=60)
@given(seeds, st.integers(1, 8), st.integers(1, 8))
def test_against_a_flood_fill(seed, nx, ny):
    rng = np.random.default_rng(seed)
    state = rng.choice(np.array([0, 0, 1, 2], dtype=np.uint8), (nx, ny))
    workspace = Workspace.from_array(np.zeros((nx, ny), bool), 1.0)
    space = CSpace(workspace, Robot.disc(0.1), state, outside="blocked", margin=0.0, precision="float32")
    cells = np.argwhere(np.ones((nx, ny)))
    centers = space.grid.center_of(cells)
    answers = space.path_exists(centers[:, None], centers[None])
    for a, start in enumerate(map(tuple, cells.tolist())):
        free, passable = oracles.component_of(state == FREE, start), oracles.component_of(state != BLOCKED, start)
        for b, goal in enumerate(map(tuple, cells.tolist())):
            assert answers[a, b] is (True if goal in free else None if goal in passable else False)


def walled(gap, outside="blocked"):
    """A room of 40 x 20 cells with a wall that has a gap of so many cells."""
    occupied = np.zeros((40, 20), dtype=bool)
    occupied[20, gap:] = True
    return cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.25), outside=outside)


def test_a_door_decides():
    assert walled(12).path_exists((1.0, 1.0), (3.0, 1.0)) is True
    assert walled(3).path_exists((1.0, 1.0), (3.0, 1.0)) is False
    assert walled(5).path_exists((1.0, 1.0), (3.0, 1.0)) is None  # 0.5 m for a disc 0.5 m across


def test_a_way_around_the_map_is_no_proof_of_absence():
    assert walled(0, "free").path_exists((1.0, 1.0), (3.0, 1.0)) is None
    assert walled(0).path_exists((1.0, 1.0), (3.0, 1.0)) is False


def test_what_collides_has_no_path():
    space = walled(12)
    assert space.path_exists((2.05, 1.8), (2.05, 1.8)) is False
    assert space.path_exists((1.0, 1.0), (-5.0, 1.0)) is False
    assert space.path_exists((1.0, 1.0), (1.0, 1.0)) is True


def test_kinds_of_answers():
    space = walled(12)
    assert space.path_exists(np.full((2, 1, 2), 1.0), np.full((3, 2), 1.1)).tolist() == [[True] * 3] * 2
    with pytest.raises(InputError, match="nan"):
        space.path_exists((np.nan, 1.0), (1.0, 1.0))
