"""Many look-ups in one call: blocks, threads, coarse maps, numbers of any kind; and whole paths and roadmaps."""

import itertools
from functools import cache, partial

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import cspace
from cspace import InputError, Robot, Workspace
from cspace.map import mip
from cspace.map.batches import MIN_EDGES_PER_THREAD, ROWS_PER_COPY, evaluate_pairs
from cspace.map.mip import MAX_CELLS_PER_EDGE
from cspace.rotations import Rotations
from cspace.threads import MIN_ITEMS_PER_THREAD
from handmade import configurations, map_of
from placements import draw_configurations
from refusals import refusals
from strategies import rotation_cells, seeds


def plane(rng, shape=(57, 43), outside="free"):
    return cspace.build(Workspace.from_array(rng.random(shape) < 0.02, 0.1), Robot.disc(0.15), outside=outside)


def turning(rng, rotations=7, shape=(29, 40), outside="free"):
    workspace = Workspace.from_array(rng.random(shape) < 0.02, 0.1)
    return cspace.build(workspace, Robot.rectangle(0.5, 0.2), rotations=rotations, outside=outside)


def solid(rng, shape=(17, 23, 30), outside="free"):
    return cspace.build(Workspace.from_array(rng.random(shape) < 0.003, 0.1), Robot.ball(0.15), outside=outside)


def yawing(rng, shape=(13, 12, 11), outside="free"):
    workspace = Workspace.from_array(rng.random(shape) < 0.003, 0.1)
    return cspace.build(workspace, Robot.box((0.3, 0.2, 0.1)), rotations=5, outside=outside)


def floating(rng, shape=(9, 8, 7), outside="free"):
    occupied = rng.random(shape) < 0.01
    occupied[6, 2:] = True
    workspace = Workspace.from_array(occupied, 0.1)
    return cspace.build(workspace, Robot.box((0.2, 0.1, 0.1)), rotations=Rotations.quaternions(2), outside=outside)


KINDS = [plane, turning, solid, yawing, floating]


@cache
def made(make, seed):
    """A map that tests share."""
    return make(np.random.default_rng(seed))


def near(space, q, rng):
    """Ends of edges from configurations: most of them a few cells away."""
    reach = 12.0 * space.grid.spacing
    targets = np.where(
        rng.random((len(q), 1)) < 0.8, q + rng.uniform(-reach, reach, q.shape), q[rng.permutation(len(q))]
    )
    return configurations(space, np.where(rng.random(q.shape) < 0.1, q, targets))


# ---- one cell --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", KINDS)
@settings(max_examples=8)
@given(
    seeds, st.sampled_from(["free", "blocked"]), st.sampled_from([1, 1023, 1024, 1025, 2 * MIN_ITEMS_PER_THREAD + 1])
)
def test_states_and_clearances_of_many_are_those_of_each(make, seed, outside, number):
    rng = np.random.default_rng(seed)
    space = make(rng, outside=outside)
    q = draw_configurations(space, rng, number, far=True)
    chosen = rng.integers(0, number, 500)
    assert space.classify(q)[chosen].tolist() == [space.classify(one) for one in q[chosen]]
    assert space.clearance(q)[chosen[:100]].tolist() == [space.clearance(one) for one in q[chosen[:100]]]
    inside = space.grid.contains(q[:, : space.grid.dim])
    cells = space.grid.cell_of(q[inside, : space.grid.dim])
    slices = space._kernel_map.slice_of[space.rotations._cells_of(q[inside])]
    assert (space.classify(q)[inside] == space._kernel_map.states[(slices, *cells.T)]).all()


@pytest.mark.parametrize("make", KINDS)
def test_numbers_of_any_type_get_the_same_answers(make):
    rng = np.random.default_rng(3)
    space = made(make, 3)
    for dtype in ("float64", "float32", "float16", "int64", "int8", "uint16", "bool", "longdouble"):
        q = rng.uniform(0, 3, (ROWS_PER_COPY + 7, space.size)).astype(dtype)
        if len(space.rotations.names) == 4:
            q[:, 3:] = np.eye(4)[rng.integers(0, 4, len(q))]
        wide = q.astype(np.float64)
        for name in ("classify", "clearance", "overlap_count"):
            np.testing.assert_array_equal(getattr(space, name)(q), getattr(space, name)(wide), dtype)
        assert (space.motion_is_free(q[1:], q[:-1]) == space.motion_is_free(wide[1:], wide[:-1])).all(), dtype
        assert space.classify(q[5]) == space.classify(wide[5]), dtype


@pytest.mark.parametrize("make", KINDS)
def test_arrays_of_any_layout_get_the_same_answers(make):
    rng = np.random.default_rng(4)
    space = make(rng)
    q = draw_configurations(space, rng, 3 * ROWS_PER_COPY, far=True).reshape(3, ROWS_PER_COPY, space.size)
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
    chosen = rng.integers(0, ROWS_PER_COPY, 50)
    one_by_one = [[space.motion_is_free(q[0, 0], p) for p in row] for row in q[:, chosen]]
    assert space.motion_is_free(q[0, 0], q)[:, chosen].tolist() == one_by_one


@pytest.mark.parametrize("make", KINDS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_the_first_bad_number_is_named(make, dtype, value):
    rng = np.random.default_rng(5)
    space = made(make, 5)
    half = {"q": MIN_ITEMS_PER_THREAD + 2, "edge": max(ROWS_PER_COPY, MIN_EDGES_PER_THREAD) + 2}
    ask = {"q": space.classify, "edge": partial(space.motion_is_free, np.full(space.size, 0.5))}
    for name, middle in half.items():
        last = 2 * middle
        for first, second in ((0, 1), (1023, 1024), (ROWS_PER_COPY + 1, ROWS_PER_COPY), (last, middle + 1), (last, 7)):
            q = np.full((last + 1, space.size), 0.5, dtype)
            q[first, rng.integers(space.size)] = q[second, rng.integers(space.size)] = value
            with pytest.raises(InputError, match=f"{name} number {min(first, second)} is .*(nan|inf)"):
                ask[name](q)
    outside = configurations(space, np.full((ROWS_PER_COPY + 100, space.size), -7.0))
    outside[[ROWS_PER_COPY, 70], [0, 1]] = value
    for query in (space.classify, space.clearance):
        with pytest.raises(InputError, match="q number 70 is"):
            query(outside)


@settings(max_examples=60)
@given(rotation_cells(40), seeds)
@example([0.0, 1e-9, 6.0, 2 * np.pi], 0)
def test_rotation_cells_of_many_yaws(rotations, seed):
    rng = np.random.default_rng(seed)
    cells = Rotations.of(rotations)
    states = (np.arange(len(cells)) % 3).astype(np.uint8)
    space = map_of(np.tile(states[:, None, None], (1, 2, 2)), rotations)
    borders = np.asarray(cells.borders)
    yaws = np.concatenate([rng.uniform(-9, 9, 500), borders, borders - 2 * np.pi, np.nextafter(borders, -9)])
    q = np.column_stack([np.full((len(yaws), 2), 0.5 * space.grid.spacing), yaws])
    assert (space.classify(q) == states[cells.cell_of(yaws)]).all()


@pytest.mark.parametrize("yaw", [2.0**20 + 1.0, -(2.0**40), 1e300])
def test_a_yaw_that_cannot_be_wrapped_is_refused_in_a_batch(yaw):
    space = turning(np.random.default_rng(8))
    q = np.full((3000, 3), 0.5)
    q[[2000, 2500], 2] = yaw
    for ask in (space.classify, space.clearance, space.overlap_count, lambda q: space.motion_is_free(q[0], q)):
        with pytest.raises(InputError, match="number 2000 is"):
            ask(q)
    q[:, 2] = np.sign(yaw) * 2.0**20
    assert (space.classify(q) == space.classify(q[0])).all()


# ---- marks of blocks ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", KINDS)
@settings(max_examples=10)
@given(seeds, st.sampled_from(["free", "blocked"]))
def test_edges_of_many_are_those_of_each(make, seed, outside):
    """A checker of single edges walks cell by cell; a large batch looks at the marks of blocks first."""
    rng = np.random.default_rng(seed)
    space = make(rng, outside=outside)
    q0 = draw_configurations(space, rng, 2 * MIN_EDGES_PER_THREAD + 3, far=True)
    q1 = near(space, q0, rng)
    assert space._kernel_map.states.size <= len(q0) * MAX_CELLS_PER_EDGE
    many = space.motion_is_free(q0, q1)
    check = space.edge_checker()
    assert many.tolist() == [check(*edge) for edge in np.hstack([q0, q1]).tolist()]
    assert many.any() or outside == "blocked"


def test_blocks_are_marked_only_where_that_pays(monkeypatch):
    space = cspace.build(cspace.Workspace.from_array(np.zeros((200, 200), dtype=bool), 0.1), cspace.Robot.disc(0.2))
    marked, mark = [], mip.OccupancyPyramid.marks
    monkeypatch.setattr(mip.OccupancyPyramid, "marks", lambda *how: marked.append(mark(*how)) or marked[-1])
    space.motion_is_free((1.0, 1.0), (2.0, 2.0))
    assert not marked
    space.motion_is_free(np.full((10, 2), 1.0), np.full((10, 2), 2.0))
    assert [marks.blocks.shape for marks in marked] == [(1, 1, 4, 4, 1)]


# ---- paths and roadmaps ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", KINDS)
@pytest.mark.parametrize("exact", [False, True])
def test_a_path_is_certified_edge_by_edge(make, exact):
    rng = np.random.default_rng(6)
    space = make(rng)
    path = np.cumsum(rng.uniform(-0.3, 0.3, (60, space.size)), axis=0)
    middle = np.array([*np.divide(space.grid.upper, 2), *space.rotations.centers[0]])
    path = configurations(space, path + middle)
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
    assert space.certify_path(path.tolist(), edges.astype(np.uint8).tolist(), exact=exact).tolist() == one
    assert space.certify_path(path, [], exact=exact).shape == (0,)
    assert space.certify_path(np.empty((0, space.size)), np.empty((0, 2), int)).shape == (0,)


@pytest.mark.parametrize("make", KINDS)
def test_a_large_roadmap_in_threads(make):
    rng = np.random.default_rng(7)
    space = make(rng)
    vertices = space.sample_free(5000, rng)
    edges = rng.integers(0, len(vertices), (3 * ROWS_PER_COPY + 1, 2))
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
    ([(0.1, 0.1)] * 3, [(0, 1), (2,)], "pairs"),
    (np.empty((0, 2)), [(0, 0)], "there are 0 vertices"),
)
def test_refuses_what_is_no_path_and_no_roadmap(path, edges, message):
    space = plane(np.random.default_rng(0))
    with pytest.raises(InputError, match=message):
        space.certify_path(path, edges)


def test_an_edge_between_unusable_vertices_is_named_by_its_number():
    space = plane(np.random.default_rng(0))
    vertices = np.array([(0.1, 0.1), (0.2, 0.2), (np.nan, 0.3)])
    with pytest.raises(InputError, match=r"edge number 2 is \(0.1, 0.1, nan, 0.3\)"):
        evaluate_pairs(vertices, np.array([(0, 1), (1, 0), (0, 2)]), space._edges(3, exact=False))
