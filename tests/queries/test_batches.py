"""Queries of batches, whole paths and roadmaps."""

import itertools
from functools import cache, partial

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import cspace
from cspace import InputError, Robot, Workspace
from cspace.queries.batches import MIN_EDGES_PER_THREAD
from cspace.rotations import Rotations
from cspace.support.threads import MIN_ITEMS_PER_THREAD
from tests.helpers.handmade import configurations, map_of
from tests.helpers.placements import draw_configurations
from tests.helpers.refusals import refusals
from tests.helpers.strategies import rotation_cells, seeds

RANDOM_MAPS = {
    "plane": ((57, 43), 0.02, Robot.disc(0.15), None),
    "turning": ((29, 40), 0.02, Robot.rectangle(0.5, 0.2), 7),
    "space": ((17, 23, 30), 0.003, Robot.ball(0.15), None),
    "yawing": ((13, 12, 11), 0.003, Robot.box((0.3, 0.2, 0.1)), 5),
    "floating": ((9, 8, 7), 0.01, Robot.box((0.2, 0.1, 0.1)), Rotations.quaternions(2)),
}
"""Shape of the grid, share of occupied cells, robot and rotations in each space."""

MANY_ROWS = 8_192

EVERY_SPACE = pytest.mark.parametrize("name", RANDOM_MAPS)


def build_random(name, rng, outside="free"):
    """Build a random map of a space."""
    shape, share, robot, rotations = RANDOM_MAPS[name]
    occupied = rng.random(shape) < share
    if name == "floating":
        occupied[6, 2:] = True
    return cspace.build(
        Workspace.from_array(occupied, 0.1), robot, rotations=rotations, outside=outside
    )


@cache
def build_cached(name, seed):
    """Build a random map that tests share."""
    return build_random(name, np.random.default_rng(seed))


def draw_targets(space, q, rng):
    """Draw ends of edges, mostly a few cells away."""
    reach = 12.0 * space.grid.spacing
    targets = np.where(
        rng.random((len(q), 1)) < 0.8,
        q + rng.uniform(-reach, reach, q.shape),
        q[rng.permutation(len(q))],
    )
    return configurations(space, np.where(rng.random(q.shape) < 0.1, q, targets))


# ---- one cell ------------------------------------------------------------------------------------


@EVERY_SPACE
@settings(max_examples=8)
@given(
    seeds,
    st.sampled_from(["free", "blocked"]),
    st.sampled_from([1, 1023, 1024, 1025, 2 * MIN_ITEMS_PER_THREAD + 1]),
)
def test_batches_equal_single_queries(name, seed, outside, number):
    rng = np.random.default_rng(seed)
    space = build_random(name, rng, outside=outside)
    q = draw_configurations(space, rng, number, far=True)
    chosen = rng.integers(0, number, 500)
    assert space.classify(q)[chosen].tolist() == [space.classify(one) for one in q[chosen]]
    assert space.clearance(q)[chosen[:100]].tolist() == [
        space.clearance(one) for one in q[chosen[:100]]
    ]
    inside = space.grid.contains(q[:, : space.grid.dim])
    cells = space.grid.cell_of(q[inside, : space.grid.dim])
    slices = space.slice_of[space.rotations.find_cells(q[inside])]
    assert (space.classify(q)[inside] == space._seen[(slices, *cells.T)]).all()


@EVERY_SPACE
def test_queries_accept_numbers_of_any_type(name):
    rng = np.random.default_rng(3)
    space = build_cached(name, 3)
    for dtype in ("float64", "float32", "float16", "int64", "int8", "uint16", "bool", "longdouble"):
        q = rng.uniform(0, 3, (MANY_ROWS + 7, space.size)).astype(dtype)
        if len(space.rotations.names) == 4:
            q[:, 3:] = np.eye(4)[rng.integers(0, 4, len(q))]
        wide = q.astype(np.float64)
        for query in (space.classify, space.clearance, space.overlap_count):
            np.testing.assert_array_equal(query(q), query(wide), dtype)
        assert (
            space.motion_is_free(q[1:], q[:-1]) == space.motion_is_free(wide[1:], wide[:-1])
        ).all(), dtype
        assert space.classify(q[5]) == space.classify(wide[5]), dtype


@EVERY_SPACE
def test_queries_accept_arrays_of_any_layout(name):
    rng = np.random.default_rng(4)
    space = build_random(name, rng)
    q = draw_configurations(space, rng, 3 * MANY_ROWS, far=True).reshape(3, MANY_ROWS, space.size)
    states, free = space.classify(q), space.motion_is_free(q, q[::-1])
    layouts = [
        np.asfortranarray(q),
        np.repeat(q, 2, axis=1)[:, ::2],
        np.dstack([q, q])[..., : space.size],
        q[::-1][::-1],
        q.astype(">f8"),
    ]
    for other in layouts:
        assert (space.classify(other) == states).all()
        assert (space.classify(other[1]) == states[1]).all()
        assert (space.motion_is_free(other, q[::-1]) == free).all()
    chosen = rng.integers(0, MANY_ROWS, 50)
    one_by_one = [[space.motion_is_free(q[0, 0], p) for p in row] for row in q[:, chosen]]
    assert space.motion_is_free(q[0, 0], q)[:, chosen].tolist() == one_by_one


@EVERY_SPACE
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_queries_name_the_first_invalid_number(name, dtype, value):
    rng = np.random.default_rng(5)
    space = build_cached(name, 5)
    half = {"q": MIN_ITEMS_PER_THREAD + 2, "edge": max(MANY_ROWS, MIN_EDGES_PER_THREAD) + 2}
    ask = {"q": space.classify, "edge": partial(space.motion_is_free, np.full(space.size, 0.5))}
    for subject, split in half.items():
        last = 2 * split
        for first, second in (
            (0, 1),
            (1023, 1024),
            (MANY_ROWS + 1, MANY_ROWS),
            (last, split + 1),
            (last, 7),
        ):
            q = np.full((last + 1, space.size), 0.5, dtype)
            q[first, rng.integers(space.size)] = q[second, rng.integers(space.size)] = value
            with pytest.raises(
                InputError, match=f"{subject} number {min(first, second)} is .*(nan|inf)"
            ):
                ask[subject](q)
    outside = configurations(space, np.full((MANY_ROWS + 100, space.size), -7.0))
    outside[[MANY_ROWS, 70], [0, 1]] = value
    for query in (space.classify, space.clearance):
        with pytest.raises(InputError, match="q number 70 is"):
            query(outside)


@settings(max_examples=60)
@given(rotation_cells(40), seeds)
@example([0.0, 1e-9, 6.0, 2 * np.pi], 0)
def test_classify_finds_the_rotation_cell_of_each_yaw(rotations, seed):
    rng = np.random.default_rng(seed)
    cells = Rotations.of(rotations)
    states = (np.arange(len(cells)) % 3).astype(np.uint8)
    space = map_of(np.tile(states[:, None, None], (1, 2, 2)), rotations)
    boundaries = np.asarray(cells.borders)
    yaws = np.concatenate(
        [rng.uniform(-9, 9, 500), boundaries, boundaries - 2 * np.pi, np.nextafter(boundaries, -9)]
    )
    q = np.column_stack([np.full((len(yaws), 2), 0.5 * space.grid.spacing), yaws])
    assert (space.classify(q) == states[cells.cell_of(yaws)]).all()


@pytest.mark.parametrize("yaw", [2.0**20 + 1.0, -(2.0**40), 1e300])
def test_batches_refuse_yaws_too_large_to_wrap(yaw):
    space = build_random("turning", np.random.default_rng(8))
    q = np.full((3000, 3), 0.5)
    q[[2000, 2500], 2] = yaw
    for ask in (
        space.classify,
        space.clearance,
        space.overlap_count,
        lambda q: space.motion_is_free(q[0], q),
    ):
        with pytest.raises(InputError, match="number 2000 is"):
            ask(q)
    q[:, 2] = np.sign(yaw) * 2.0**20
    assert (space.classify(q) == space.classify(q[0])).all()


# ---- edges ---------------------------------------------------------------------------------------


@EVERY_SPACE
@settings(max_examples=10)
@given(seeds, st.sampled_from(["free", "blocked"]))
def test_batches_of_edges_equal_single_edges(name, seed, outside):
    rng = np.random.default_rng(seed)
    space = build_random(name, rng, outside=outside)
    q0 = draw_configurations(space, rng, 2 * MIN_EDGES_PER_THREAD + 3, far=True)
    q1 = draw_targets(space, q0, rng)
    many = space.motion_is_free(q0, q1)
    check = space.edge_checker()
    assert many.tolist() == [check(*edge) for edge in np.hstack([q0, q1]).tolist()]
    assert many.any() or outside == "blocked"


# ---- paths and roadmaps --------------------------------------------------------------------------


@EVERY_SPACE
@pytest.mark.parametrize("exact", [False, True])
def test_certify_path_returns_the_result_of_each_edge(name, exact):
    rng = np.random.default_rng(6)
    space = build_random(name, rng)
    path = np.cumsum(rng.uniform(-0.3, 0.3, (60, space.size)), axis=0)
    center = np.array([*np.divide(space.grid.upper, 2), *space.rotations.centers[0]])
    path = configurations(space, path + center)
    one = [space.motion_is_free(a, b, exact=exact) for a, b in itertools.pairwise(path)]
    free = space.certify_path(path, exact=exact)
    assert free.dtype == bool and free.tolist() == one and 0 < sum(one) < len(one)
    paths = path.reshape(2, 3, 10, space.size)
    assert space.certify_path(paths, exact=exact).shape == (2, 3, 9)
    assert space.certify_path(paths, exact=exact)[1, 2].tolist() == one[50:]
    assert space.certify_path(path[:1]).shape == (0,)

    edges = rng.integers(0, len(path), (200, 2))
    one = [space.motion_is_free(path[a], path[b], exact=exact) for a, b in edges]
    assert space.certify_path(path, edges, exact=exact).tolist() == one
    assert (
        space.certify_path(path.tolist(), edges.astype(np.uint8).tolist(), exact=exact).tolist()
        == one
    )
    assert space.certify_path(path, [], exact=exact).shape == (0,)
    assert space.certify_path(np.empty((0, space.size)), np.empty((0, 2), int)).shape == (0,)


@EVERY_SPACE
def test_certify_path_checks_large_roadmaps(name):
    rng = np.random.default_rng(7)
    space = build_random(name, rng)
    vertices = space.sample_free(5000, rng)
    edges = rng.integers(0, len(vertices), (3 * MANY_ROWS + 1, 2))
    free = space.certify_path(vertices, edges)
    assert (free == space.motion_is_free(vertices[edges[:, 0]], vertices[edges[:, 1]])).all()
    assert (free == space.certify_path(vertices[:, ::-1][:, ::-1], edges.astype(np.uint16))).all()


@refusals(
    "path, edges, message",
    ([(0.1, 0.1), (np.nan, 0.2)], None, "path number 1 is"),
    ([(0.1, 0.1), (np.nan, 0.2)], [(0, 0)], "path number 1 is"),
    ([(np.inf, 0.1)], None, "path number 0 is"),
    ([(0.1, 0.1, 0.1)], None, "last axis must be 2"),
    ((0.1, 0.1), None, "at least one configuration"),
    (np.empty((0, 2)), None, "at least one configuration"),
    ([(0.1, 0.1)], [(0, 1)], r"edge number 0 is \(0, 1\)"),
    ([(0.1, 0.1)] * 3, [(0, 1), (-1, 0)], r"edge number 1 is \(-1, 0\)"),
    ([(0.1, 0.1)], [(0.0, 0.0)], "whole numbers"),
    ([(0.1, 0.1)] * 3, [(True, False)], "whole numbers"),
    ([(0.1, 0.1)] * 3, [0, 1], "whole numbers"),
    ([(0.1, 0.1)] * 3, [(0, 1, 2)], "whole numbers"),
    ([[(0.1, 0.1)] * 3], [(0, 0)], "list of configurations"),
    ([(0.1, 0.1)] * 3, [(0, 1), (2,)], r"edges is \[\(0, 1\), \(2,\)\]"),
    (np.empty((0, 2)), [(0, 0)], "there are 0 vertices"),
)
def test_certify_path_refuses(path, edges, message):
    space = build_random("plane", np.random.default_rng(0))
    with pytest.raises(InputError, match=message):
        space.certify_path(path, edges)


def test_invalid_edges_are_named_by_number():
    space = build_random("plane", np.random.default_rng(0))
    vertices = np.array([(0.1, 0.1), (0.2, 0.2), (np.nan, 0.3)])
    with pytest.raises(InputError, match=r"edge number 2 is \(0.1, 0.1, nan, 0.3\)"):
        space.motion_is_free(vertices[[0, 1, 0]], vertices[[1, 0, 2]])
