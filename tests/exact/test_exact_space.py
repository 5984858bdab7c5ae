"""The map whose MIXED cells the geometry decides: a view of the map itself."""

import copy
import pickle

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given

import cspace
from cspace import FREE, MIXED, Robot, Workspace
from tests.helpers.gates import certify_chunk
from tests.helpers.handmade import build_empty
from tests.helpers.regions import place_polygon
from tests.helpers.slits import SLIT, build_slit, draw_only_exact, draw_rows
from tests.helpers.strategies import examples, seeds

BAR = shapely.box(-0.3, -0.2, 0.3, 0.2)
"""The robot as drawn by shapely."""


def answer(space, q, near):
    """Return what a map says of configurations and motions, by batches."""
    return np.stack(
        [
            space.classify(q) == FREE,
            space.is_free(q),
            space.motion_is_free(q, near),
            space.certify_path(np.stack([q, near], axis=1))[:, 0],
        ]
    )


def test_the_exact_map_is_a_view_of_the_map():
    space = build_slit()
    exact = space.exact
    assert isinstance(exact, cspace.CSpace) and exact is space.exact and exact.exact is exact
    assert exact is not space
    assert repr(exact) == f"Exact{space!r}"
    assert np.shares_memory(exact.states_at(0.0), space.states_at(0.0))
    assert exact.count() == space.count() and exact.facts == space.facts


@examples(4)
@given(seed=seeds)
def test_the_geometry_decides_mixed_cells_alone(seed):
    space = build_slit()
    q, near = draw_rows(space, seed)
    states, exact_states = np.asarray(space.classify(q)), np.asarray(space.exact.classify(q))
    decided = states != MIXED
    assert (states[decided] == exact_states[decided]).all()
    assert np.isin(exact_states[~decided], [FREE, MIXED]).all()
    found = answer(space.exact, q, near)
    # Neither is a configuration free that touches the walls, by shapely, nor one of a free motion.
    walls = shapely.union_all(SLIT)
    at = np.linspace(0.0, 1.0, 20)[:, np.newaxis, np.newaxis]
    touches = shapely.intersects(place_polygon(BAR, q), walls)
    assert not found[:2, touches].any() and found[:2].any(axis=1).all()
    between = space.interpolate(q, near, at).reshape(-1, 3)
    touches = shapely.intersects(place_polygon(BAR, between), walls).reshape(20, -1).any(axis=0)
    assert not found[2:, touches].any() and found[2:].any(axis=1).all()
    # One configuration and the checkers answer as batches do.
    is_free, moves = space.exact.point_checker(), space.exact.edge_checker()
    rows = list(zip(q.tolist(), near.tolist(), strict=True))
    assert [space.exact.is_free(a) for a, _ in rows] == found[1].tolist()
    assert [space.exact.motion_is_free(a, b) for a, b in rows] == found[2].tolist()
    assert [is_free(*a) for a, _ in rows] == found[1].tolist()
    assert [moves(*a, *b) for a, b in rows] == found[2].tolist()


@pytest.mark.parametrize("is_asked_first", [True, False])
@pytest.mark.parametrize("changes", ["map", "view"])
def test_both_follow_each_update(changes, is_asked_first):
    space = build_slit()
    q, near = draw_rows(space, 3)
    check = space.exact.edge_checker()
    if is_asked_first:
        answer(space, q, near), answer(space.exact, q, near)
        space.exact.is_connected(q, near)
    changed = space if changes == "map" else space.exact
    changed.add_obstacle("crate", shapely.box(1.6, 0.8, 1.9, 1.3))
    changed.update(np.ones((3, 2), dtype=bool), (4, 9))
    changed.add_obstacle("cone", shapely.box(0.2, 1.9, 0.3, 2.0))
    changed.update({"cone": None, "crate": shapely.box(1.6, 0.9, 1.9, 1.4)})
    fresh = build_slit()
    fresh.update(np.ones((3, 2), dtype=bool), (4, 9))
    fresh.add_obstacle("crate", shapely.box(1.6, 0.9, 1.9, 1.4))
    for found, expected in ((space, fresh), (space.exact, fresh.exact)):
        np.testing.assert_array_equal(answer(found, q, near), answer(expected, q, near))
        np.testing.assert_array_equal(found.is_connected(q, near), expected.is_connected(q, near))
        np.testing.assert_array_equal(found.clearance(q), expected.clearance(q))
        assert list(found.obstacles) == ["crate"]
    moves = fresh.exact.motion_is_free(q, near).tolist()
    assert [check(*a, *b) for a, b in zip(q.tolist(), near.tolist(), strict=True)] == moves


def test_what_holds_in_whole_cells_is_that_of_the_cells():
    """A configuration that is free in a MIXED cell says nothing about the rest of the cell."""
    space = build_slit()
    only_exact = draw_only_exact(space)
    assert len(only_exact) > 20
    goal = (1.9, 1.2, 0.0)
    for view in (space.exact, pickle.loads(pickle.dumps(space.exact))):
        for q in only_exact[:20]:
            np.testing.assert_array_equal(view.free_yaws(q[:2]), space.free_yaws(q[:2]))
            assert not view.is_connected(q, goal)
            assert certify_chunk(space, q, [q]).proven == 0


def test_copies_and_files_of_the_exact_map_are_maps_of_their_own(tmp_path):
    space = build_slit()
    q, near = draw_rows(space, 4)
    expected = answer(space.exact, q, near)
    copies = copy.copy(space.exact), copy.deepcopy(space.exact), copy.copy(space).exact
    for other in (*copies, pickle.loads(pickle.dumps(space.exact))):
        np.testing.assert_array_equal(answer(other, q, near), expected)
        other.add_obstacle("crate", shapely.box(1.6, 0.8, 1.9, 1.3))
        assert other.exact is other
        assert not space.obstacles
    np.testing.assert_array_equal(answer(space.exact, q, near), expected)
    space.exact.save(tmp_path / "slit.zarr")
    opened = cspace.open(tmp_path / "slit.zarr")
    assert opened.exact is not opened
    np.testing.assert_array_equal(opened.cell_states, space.cell_states)


@given(seeds)
@examples(12)
def test_gates_of_the_exact_map_prove_more_tubes_and_none_with_a_contact(seed):
    space = build_slit(outside=("free", "blocked")[seed % 2])
    rng = np.random.default_rng(seed)
    walls = shapely.union_all(SLIT)
    shapely.prepare(walls)
    q, _ = draw_rows(space, seed, 30)
    tracking = rng.choice([0.0, 0.01, 0.03], 3)
    steps = rng.normal(0.0, 0.02, (30, 4, 3))
    rows = q[:, np.newaxis] + np.cumsum(steps, axis=1)
    by_cells = certify_chunk(space, q, rows, tracking).proven
    proven = certify_chunk(space.exact, q, rows, tracking).proven
    assert (proven >= by_cells).all()
    for start, chunk, count in zip(q, rows, proven.tolist(), strict=True):
        points = np.vstack([start, chunk[:count]])
        if count:
            k = rng.integers(0, count, 200)
            instants = points[k] + rng.random((200, 1)) * (points[k + 1] - points[k])
            instants += tracking * rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], (200, 3))
            assert not shapely.intersects(walls, place_polygon(BAR, instants)).any()
        if not tracking.any():
            free = space.exact.certify_path(np.vstack([start, chunk]))
            assert count == np.logical_and.accumulate(free).sum()


def test_a_gate_of_the_exact_map_passes_a_slit_that_cells_leave_undecided():
    space = build_slit()
    start, rows = (0.5, 1.19, 0.0), np.linspace((0.55, 1.19, 0.0), (1.9, 1.19, 0.0), 20)
    for tracking, state in ((0.0, "go"), ((0.05, 0.005, 0.0), "shortened"), (0.3, "hold")):
        gate = cspace.Gate(space, tracking=tracking)
        exact_gate = cspace.Gate(space.exact, tracking=tracking)
        assert gate.check_rows(start, rows).state != "go"
        assert exact_gate.check_rows(start, rows).state == state
    gate = cspace.Gate(space.exact, tracking=(0.005, 0.005, 0.001))
    passed = gate.check_rows(start, rows)
    assert passed.state == "go" and 0.005 <= passed.chunk.max_tracking[1] <= 0.02
    gate = cspace.Gate(space.exact, dt=0.1, max_deceleration=(1.0, 1.0))
    assert gate.slow_down(start, (0.5, 0.0)).share == 1.0
    space.add_obstacle("cork", shapely.box(1.1, 1.1, 1.2, 1.2))
    refused = gate.check_twists(start, [(1.0, 0.0)] * 10).chunk.refusal
    assert refused.cause == "collision" and "cork" in refused.names


@pytest.mark.parametrize("outside", ["free", "blocked"])
def test_tubes_beyond_the_grid_are_proven_by_the_geometry_only_if_all_outside_is_free(outside):
    workspace = Workspace.from_polygons([shapely.box(1, 1, 1.1, 1.1)], 0.1, (0, 0, 3, 3))
    space = cspace.build(workspace, Robot.disc(0.1), outside=outside).exact
    inside, near, beyond = (2.0, 2.0), (2.0, 2.895), (2.0, 3.5)
    assert certify_chunk(space, inside, [near]).is_proven
    for q in (near, beyond):
        assert certify_chunk(space, q, [q], 0.01).is_proven == (outside == "free")
    assert not certify_chunk(space, inside, [inside], 1e300).is_proven


@pytest.mark.parametrize("kind", [None, 8, "quaternions"])
def test_tubes_of_the_exact_map_in_space_end_where_the_grown_robot_touches(kind):
    """The robot ends 0.2 m before the block; motions lead to it, and away from it."""
    rotations = cspace.Rotations.quaternions(1) if kind == "quaternions" else kind
    space = build_empty(
        (20, 18, 10), Robot.box((0.4, 0.2, 0.1)), rotations=rotations, outside="free"
    )
    place = trimesh.transformations.translation_matrix((1.5, 0.9, 0.5))
    space.add_obstacle("block", trimesh.creation.box(extents=(0.2, 0.2, 0.2), transform=place))
    turn = {None: (), 8: (0.0,), "quaternions": (0.0, 0.0, 0.0, 1.0)}[kind]
    near, far = np.array([(1.0, 0.9, 0.5, *turn), (0.9, 0.9, 0.5, *turn)])
    for start, end in ((near, near), (near, far), (far, near)):
        for tracking, is_proven in ((0.19, True), (0.21, False)):
            errors = [tracking, 0.0, 0.0, *turn[:1]]
            chunk = certify_chunk(space.exact, start, [end], errors)
            assert chunk.is_proven == is_proven
