"""Chunks of commands: whole tubes are proven, against shapely and contacts placed inside them."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import FREE, Robot, Rotations, Workspace
from cspace._interface import INSTANTS_PER_TUBE
from cspace.errors import InputError
from tests.helpers.placements import move
from tests.helpers.refusals import check_followed, refusals
from tests.helpers.regions import place_polygon
from tests.helpers.strategies import seeds
from tests.laws.any_map import ALL_KINDS, WEDGE, build_map

INSTANTS = 2000
"""Instants within a tube at which shapely looks for contacts."""


@pytest.fixture(scope="module", params=ALL_KINDS, ids="-".join)
def any_map(request, tmp_path_factory):
    """Build a map that tests share and none changes."""
    space, storage = request.param
    return build_map(space, storage, "free", 5, tmp_path_factory.mktemp("any"))


def draw_tracking(any_map, rng):
    """Draw an error for each coordinate, often zero."""
    count = any_map.dim + bool(any_map.space.rotations.names)
    return rng.uniform(0.0, 0.3, count) * (rng.random(count) < 0.8) * rng.choice([0.0, 0.2, 1.0])


def stray(any_map, q, tracking, signs, axes):
    """Move configurations by errors, as far as ``signs`` say, rotated about unit ``axes``."""
    dim = any_map.dim
    turn = tracking[dim] if len(tracking) > dim else 0.0
    return move(any_map.memory, q, signs[:, :dim] * tracking[:dim], signs[:, dim:] * turn * axes)


def draw_axes(any_map, rng, n):
    """Draw unit vectors about which rotations stray: z, unless the robot rotates about any axis."""
    axes = rng.normal(size=(n, 3)) if any_map.space.size == 7 else np.tile((0.0, 0.0, 1.0), (n, 1))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


# ---- proofs of maps ------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=4)
def test_no_tube_with_a_contact_is_proven(any_map, seed):
    """A contact lies within the tracking of the motion, often in a corner of the tube."""
    rng, space = np.random.default_rng(seed), any_map.space
    contacts = any_map.draw_contacts(rng, 60)
    for contact in contacts[:, np.newaxis]:
        tracking = draw_tracking(any_map, rng)
        signs = rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], (1, any_map.dim + 1))
        near = stray(any_map, contact, (1.0 - 1e-9) * tracking, signs, draw_axes(any_map, rng, 1))
        steps, turns = any_map.draw_moves(rng, 1)
        share = rng.choice([0.0, 0.5, 1.0, rng.random()])
        start = move(any_map.memory, near, -share * steps, -share * turns)
        end = move(any_map.memory, near, (1.0 - share) * steps, (1.0 - share) * turns)
        chunk = space.certify_chunk(start[0], np.concatenate([end, end]), tracking)
        assert chunk.proven == 0
        after = space.certify_chunk(start[0], np.concatenate([start, end, start]), tracking)
        assert after.proven <= 1


@given(seeds)
@settings(max_examples=4)
def test_without_tracking_as_many_rows_are_proven_as_edges(any_map, seed):
    rng, space = np.random.default_rng(seed), any_map.space
    starts = any_map.draw_inside(rng, 40)[0]
    paths = [starts]
    for _ in range(5):
        paths.append(move(any_map.memory, paths[-1], *any_map.draw_moves(rng, 40)))
    rows = np.stack(paths[1:], axis=1)
    edges = space.certify_path(np.stack(paths, axis=1))
    expected = np.logical_and.accumulate(edges, axis=1).sum(axis=1)
    batch = space.certify_chunk(starts, rows)
    assert batch.proven.tolist() == expected.tolist()
    assert batch.is_proven.tolist() == (expected == 5).tolist()
    assert 0 < expected.sum() < expected.size * 5
    for start, chunk_rows, count in zip(starts[:5], rows, expected, strict=False):
        chunk = space.certify_chunk(start, chunk_rows)
        assert chunk.proven == count
        assert (chunk.refusal is None) == chunk.is_proven == (count == 5)


@given(seeds)
@settings(max_examples=4)
def test_all_within_a_proven_tube_is_free(any_map, seed):
    rng, space = np.random.default_rng(seed), any_map.space
    found = 0
    for start in any_map.draw_inside(rng, 60)[0]:
        tracking = 0.5 * draw_tracking(any_map, rng)
        row = move(any_map.memory, start[np.newaxis], *any_map.draw_moves(rng, 1))
        chunk = space.certify_chunk(start, row, tracking)
        if not chunk.proven:
            continue
        found += 1
        count = 200
        between = space.interpolate(start, row, rng.random((count, 1)))
        signs = rng.choice([-1.0, 0.0, 1.0, rng.random()], (count, any_map.dim + 1))
        strayed = stray(any_map, between, tracking, signs, draw_axes(any_map, rng, count))
        assert any_map.memory.is_free(strayed).all()
    assert found


def make_flat(seed, rotations=None):
    """Build a map of a wedge among random cells, with the cells as boxes."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((50, 50)) < 0.01
    space = cspace.build(
        Workspace.from_array(occupied, 0.1), Robot.polygon(WEDGE), rotations=rotations
    )
    boxes = [shapely.box(x, y, x + 0.1, y + 0.1) for x, y in 0.1 * np.argwhere(occupied)]
    return space, shapely.union_all(boxes)


@given(seeds)
@settings(max_examples=30)
def test_a_tube_in_the_plane_is_proven_exactly_if_no_cell_near_it_is_taken(seed):
    """Unions of boxes by shapely: the motion, widened by the tracking along x and y."""
    space, _ = make_flat(seed % 5)
    rng = np.random.default_rng(seed)
    taken = 0.1 * np.argwhere(space.cell_states != FREE)
    cells = shapely.box(taken[:, 0], taken[:, 1], taken[:, 0] + 0.1, taken[:, 1] + 0.1)
    tree = shapely.STRtree(cells)
    for _ in range(40):
        ends = rng.uniform(1.0, 4.0, (2, 2)) * rng.choice([1.0, 0.6])
        ends[1] = ends[0] + rng.uniform(-1.0, 1.0, 2) * (rng.random(2) < 0.8)
        tracking = rng.choice([0.0, 0.05, 0.1, rng.uniform(0.0, 0.4)], 2)
        corners = [end + tracking * (i, j) for end in ends for i in (-1, 1) for j in (-1, 1)]
        tube = shapely.MultiPoint(corners).convex_hull
        nearest = cells[tree.nearest(tube)].distance(tube)
        if 1e-9 < nearest or shapely.buffer(tube, -1e-6).intersects(cells[tree.nearest(tube)]):
            proven = space.certify_chunk(ends[0], ends[1:], tracking).proven
            assert proven == (nearest > 1e-9)


@given(seeds, st.sampled_from([0.0, 0.03, 0.1, (0.05, 0.0, 0.2)]))
@settings(max_examples=10)
def test_the_robot_meets_nothing_at_any_instant_within_proven_tubes(seed, tracking):
    space, obstacles = make_flat(seed % 3, rotations=48)
    shapely.prepare(obstacles)
    rng = np.random.default_rng(seed)
    start = space.sample_free(rng=rng)
    rows = start + np.cumsum(rng.normal(0.0, (0.05, 0.05, 0.1), (25, 3)), axis=0)
    chunk = space.certify_chunk(start, rows, tracking)
    check_instants(space, obstacles, np.vstack([start, rows[: chunk.proven]]), tracking, rng)
    largest = chunk.max_tracking
    if chunk.is_proven:
        assert np.all(np.asarray(largest) >= 0.99 * np.asarray(tracking))
    if not np.isnan(np.max(largest)):
        assert space.certify_chunk(start, rows, largest).is_proven
        more = 1.02 * np.asarray(largest) + 1e-4 * (np.asarray(tracking) > 0.0)
        assert not space.certify_chunk(start, rows, more + 1e-4 * (np.ndim(more) == 0)).is_proven
        check_instants(space, obstacles, np.vstack([start, rows]), largest, rng)


def check_instants(space, obstacles, points, tracking, rng):
    """Check that shapely finds no contact at instants within tubes through points."""
    if len(points) == 1:
        return
    first = rng.integers(0, len(points) - 1, INSTANTS)
    share = rng.random((INSTANTS, 1))
    exact = points[first] + share * (points[first + 1] - points[first])
    errors = rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], (INSTANTS, 3))
    placed = place_polygon(shapely.Polygon(WEDGE), exact + errors * tracking)
    assert not shapely.intersects(obstacles, placed).any()
