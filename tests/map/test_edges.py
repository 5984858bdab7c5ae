"""Edges against exact clipping, against shapely, and against points along them."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import cspace
import oracles
from checks import draw_configurations
from cspace import FREE, MIXED, CSpace, InputError, Robot, Workspace
from strategies import seeds


def map_of(free, outside="free", spacing=0.25):
    """A map with given FREE cells, of a robot that is a point to speak of."""
    free = np.asarray(free, dtype=bool)
    workspace = Workspace.from_array(np.zeros(free.shape, dtype=bool), spacing)
    state = np.where(free, FREE, MIXED).astype(np.uint8)
    return CSpace(workspace, Robot.disc(1e-6), state, outside=outside, margin=0.0, precision="float32")


coordinates = st.one_of(
    st.integers(0, 8).map(lambda k: k / 4), st.floats(0, 2), st.integers(0, 16).map(lambda k: k / 8)
)
points = st.tuples(coordinates, coordinates)


@settings(max_examples=300)
@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=12), points, points)
@example([(1, 2)], (0.25, 0.25), (0.75, 0.75))  # through a corner that a closed cell shares
@example([(2, 1)], (0.25, 0.25), (0.75, 0.75))
@example([(3, 3)], (0.0, 1.0), (2.0, 1.0))  # along a border, above a closed cell
@example([(3, 4)], (0.0, 1.0), (2.0, 1.0))  # and below one
@example([], (0.0, 0.0), (2.0, 2.0))
@example([(0, 0)], (0.0, 0.0), (5e-324, 0.25))  # upright but for a denormal number
@example([(0, 1)], (0.0, 2.0), (1e-300, 0.0))
def test_free_means_that_every_touched_cell_is_free(closed, start, end):
    free = np.ones((8, 8), dtype=bool)
    for cell in closed:
        free[cell] = False
    space = map_of(free)
    touched = oracles.touched_cells(start, end, 0.25, (0, 0), (8, 8))
    expected = all(free[cell] for cell in touched)
    if space.motion_is_free(start, end) != expected:
        # Allowed only towards refusal, where a closed cell is within the slack of the edge.
        assert expected
        segment = (oracles.exact(start), oracles.exact(end))
        boxes = [tuple(oracles.Fraction(k, 4) for k in (i, j, i + 1, j + 1)) for i, j in np.argwhere(~free).tolist()]
        assert min(oracles.square_distance_to_box(segment, box) for box in boxes) < 1e-12


@settings(max_examples=60)
@given(seeds, st.sampled_from(["blocked", "free"]))
def test_points_of_a_free_edge_are_free(seed, outside):
    rng = np.random.default_rng(seed)
    occupied = rng.random((40, 30)) < 0.02
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.12, (0.3, 0.0)), outside=outside)
    q0 = draw_configurations(space, rng, 200)
    q1 = np.where(
        rng.random((200, 1)) < 0.5, q0 + rng.uniform(-0.5, 0.5, (200, 2)), draw_configurations(space, rng, 200)
    )
    free = space.motion_is_free(q0, q1)
    assert (free == space.motion_is_free(q1, q0)).all()
    along = q0[free, None] + np.linspace(0, 1, 101)[:, None] * (q1 - q0)[free, None]
    # Rounding may put a sample that lies on the border of the grid outside of it.
    along = np.where(np.abs(along - space.grid.upper) < 1e-12, space.grid.upper, along)
    along = np.where(np.abs(along - space.grid.lower) < 1e-12, space.grid.lower, along)
    assert space.is_free(along).all()
    assert free.any()


def test_long_edges_beyond_the_grid():
    space = map_of(np.ones((4, 4)))
    assert space.motion_is_free((-100.0, 0.5), (100.0, 0.6))  # no obstacle at all
    assert not space.motion_is_free((-1e9, 0.5), (1e9, 0.6))  # too far for the certificate
    blocked = map_of(np.ones((4, 4)), outside="blocked")
    assert not blocked.motion_is_free((-0.1, 0.5), (0.5, 0.5))
    assert blocked.motion_is_free((0.0, 0.0), (1.0, 1.0))


def test_edges_outside_keep_off_what_is_undecided():
    occupied = np.zeros((10, 10), dtype=bool)
    occupied[0, 5] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.2), outside="free")
    assert space.motion_is_free((-1.0, -1.0), (-1.0, 2.0))
    assert not space.motion_is_free((-0.15, -1.0), (-0.15, 2.0))
    assert space.motion_is_free((-1.0, 0.05), (0.05, 0.05))


def test_batches_broadcast():
    space = map_of(np.ones((4, 4)))
    assert space.motion_is_free((0.1, 0.1), np.full((3, 5, 2), 0.9)).shape == (3, 5)
    assert space.motion_is_free(np.full((3, 1, 2), 0.2), np.full((5, 2), 0.9)).shape == (3, 5)
    assert space.motion_is_free(np.empty((0, 2)), (0.1, 0.1)).shape == (0,)
    with pytest.raises(InputError, match="broadcast"):
        space.motion_is_free(np.zeros((3, 2)), np.zeros((4, 2)))
    with pytest.raises(InputError, match="edge number 0"):
        space.motion_is_free((0.1, np.nan), (0.1, 0.1))
