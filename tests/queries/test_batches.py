"""Queries of batches, paths and roadmaps: types, layouts, threads and refusals."""

from functools import cache

import numpy as np
import pytest

import cspace
from cspace import ConfigurationError, InputError, Robot, Workspace
from cspace._support.threads import MIN_ITEMS_PER_THREAD
from tests.helpers import handmade
from tests.helpers.handmade import map_of
from tests.helpers.placements import draw_configurations
from tests.helpers.refusals import refusals
from tests.helpers.strategies import L_SHAPE

QUERIES = {
    "classify": int,
    "is_free": bool,
    "clearance": float,
    "overlap_count": int,
    "contains_robot": bool,
}
"""Queries of one configuration, with the type of their answer."""

Q = (1.45, 1.95, 0.5)


@cache
def build_turning():
    """Build the map of a turning robot among random cells."""
    occupied = np.random.default_rng(3).random((29, 40)) < 0.02
    robot = Robot.polygon(0.5 * np.array(L_SHAPE))
    return cspace.build(Workspace.from_array(occupied, 0.1), robot, rotations=7, outside="free")


def test_one_configuration_returns_a_python_value_and_an_array_a_numpy_value():
    space = build_turning()
    for name, kind in QUERIES.items():
        assert type(getattr(space, name)(Q)) is type(getattr(space, name)(list(Q))) is kind
        assert isinstance(getattr(space, name)(np.array(Q)), np.generic | kind)
    assert type(space.motion_is_free(Q, Q)) is bool


@pytest.mark.parametrize("dtype", ["float32", "int8", ">f8", "longdouble"])
def test_queries_accept_numbers_of_any_type_and_layout(dtype):
    space = build_turning()
    q = np.random.default_rng(0).uniform(0.0, 3.0, (2000, 3)).astype(dtype)
    wide = np.ascontiguousarray(q, dtype=np.float64)
    for other in (q, np.asfortranarray(q), np.repeat(q, 2, axis=0)[::2]):
        for name in QUERIES:
            query = getattr(space, name)
            np.testing.assert_array_equal(query(other), query(wide), name)
        edges = space.motion_is_free(wide[1:], wide[:-1])
        np.testing.assert_array_equal(space.motion_is_free(other[1:], other[:-1]), edges)


def test_threads_answer_large_batches_and_name_the_first_unusable_row(monkeypatch):
    monkeypatch.setattr("cspace._support.threads.count_cores", lambda: 3)
    space = build_turning()
    q = draw_configurations(space, np.random.default_rng(1), 3 * MIN_ITEMS_PER_THREAD, far=True)
    parts = [space.classify(part) for part in np.array_split(q, 7)]
    np.testing.assert_array_equal(space.classify(q), np.concatenate(parts))
    near = q + np.random.default_rng(2).normal(0.0, 0.2, q.shape)
    few = space.motion_is_free(q[-500:], near[-500:])
    np.testing.assert_array_equal(space.motion_is_free(q, near)[-500:], few)
    for value in (np.nan, -np.inf):
        for first in (0, MIN_ITEMS_PER_THREAD - 1, MIN_ITEMS_PER_THREAD + 1):
            wrong = q.copy()
            wrong[[first, first + 1, first + 2], [0, 1, 2]] = value
            with pytest.raises(InputError, match=f"q number {first} is .*(nan|inf)"):
                space.classify(wrong)
            with pytest.raises(InputError, match=f"edge number {first} is .*(nan|inf)"):
                space.motion_is_free(q, wrong)


@pytest.mark.parametrize("exact", [False, True])
def test_certify_path_returns_the_result_of_each_edge(exact):
    rng = np.random.default_rng(6)
    space = build_turning().exact if exact else build_turning()
    steps = rng.uniform(-0.3, 0.3, (60, 3))
    path = np.array([1.5, 2.0, 0.0]) + np.cumsum(steps, axis=0)
    steps = space.motion_is_free(path[:-1], path[1:])
    assert steps.any() and not steps.all()
    np.testing.assert_array_equal(space.certify_path(path), steps)
    several = space.certify_path(path.reshape(2, 3, 10, 3))
    assert several.shape == (2, 3, 9)
    np.testing.assert_array_equal(several[1, 2], steps[50:])
    edges = rng.integers(0, len(path), (200, 2))
    expected = space.motion_is_free(*path[edges.T])
    np.testing.assert_array_equal(space.certify_path(path, edges), expected)
    assert space.certify_path(path, []).shape == (0,)
    # A path of one configuration is an edge from it to itself, so that none passes unchecked.
    alone = space.certify_path(path[:, None])[:, 0]
    np.testing.assert_array_equal(alone, space.is_free(path))
    assert not alone.all()


# ---- refusals ------------------------------------------------------------------------------------


@refusals(
    "q, message",
    ((0.4, np.nan, 0.5), "nan"),
    (np.ma.array(Q, mask=[True, False, False]), "1 masked"),
    (Q[:2], "last axis must be 3|one configuration of 3 numbers"),
    ((0.4, 0.7, 2.0**21), "yaw.* at most"),
)
def test_queries_refuse_invalid_configurations(q, message):
    space = build_turning()
    for name in (*QUERIES, "nearest_free"):
        with pytest.raises(InputError, match=message):
            getattr(space, name)(q)
    for query in (space.motion_is_free, space.is_connected, space.is_disconnected):
        for endpoints in ((Q, q), (q, Q)):
            with pytest.raises(InputError, match=message):
                query(*endpoints)


def test_clearances_beyond_memory_are_refused_and_answered_later(monkeypatch):
    space = map_of(np.zeros((300, 300)), outside="blocked")
    with monkeypatch.context() as patch:
        patch.setattr("cspace._support.limits.free_bytes", lambda: 1000)
        with pytest.raises(InputError, match=r"needs about .* of memory.*at most 950 bytes"):
            space.clearance((1.0, 1.0))
    assert space.clearance((1.0, 1.0)) > 0.0


@pytest.mark.parametrize("kind", ["plane", "turning in space any way"])
def test_a_map_without_free_cells_has_no_sample_and_no_nearest(kind):
    space = handmade.make_map(handmade.full_states(kind, 3, cspace.BLOCKED), kind)
    q = handmade.configurations(space, np.full(space.size, 0.1))
    for call in (space.sample_free, lambda: space.nearest_free(q)):
        with pytest.raises(ConfigurationError, match="no FREE cell"):
            call()
