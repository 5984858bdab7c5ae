"""Laws that hold for maps of every space, however they are kept."""

import inspect
import itertools
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cspace
from cspace import BLOCKED, FREE, MIXED
from tests.helpers.handmade import components
from tests.helpers.maps import proven_paths
from tests.helpers.placements import draw_configurations
from tests.laws.any_map import (
    ALL_KINDS,
    MAP_INPUTS,
    AnyMap,
    build_map,
    random_obstacles,
    reopen,
)

EXTERIORS = ("blocked", "free")
BATCH_QUERIES: dict[str, tuple[int, tuple[float, ...]]] = {
    "classify": (1, ()),
    "is_free": (1, ()),
    "is_free_around": (1, (0.1, 0.05)),
    "clearance": (1, ()),
    "overlap_count": (1, ()),
    "contains_robot": (1, ()),
    "motion_is_free": (2, ()),
    "is_connected": (2, ()),
    "is_disconnected": (2, ()),
}
"""Queries of configurations: their number of configurations and further arguments."""

IN_MEMORY = [kind for kind in ALL_KINDS if kind[1] != "tiled"]


def build_kind(kind: tuple[str, str], folder: Path) -> AnyMap:
    space, storage = kind
    return build_map(space, storage, EXTERIORS[len(space) % 2], 5, folder)


@pytest.fixture(scope="module", params=ALL_KINDS, ids="-".join)
def any_map(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> AnyMap:
    """Build a map that tests share and none changes."""
    return build_kind(request.param, tmp_path_factory.mktemp("any"))


def queries_of(any_map: AnyMap) -> Iterator[tuple[str, int, tuple[float, ...]]]:
    """Yield the queries of a map: name, number of configurations, further arguments."""
    for name, (count, options) in BATCH_QUERIES.items():
        if hasattr(type(any_map.space), name):
            yield name, count, options


def draw_near(any_map: AnyMap, q: Any, rng: np.random.Generator) -> Any:
    """Draw configurations a few cells away, rotated by up to 0.4 radians."""
    dim, spacing = any_map.space.grid.dim, any_map.space.grid.spacing
    near = q + rng.normal(size=q.shape) * np.where(np.arange(q.shape[1]) < dim, 1.5 * spacing, 0.2)
    if len(any_map.space.rotations.names) == 4:
        near[:, dim:] /= np.linalg.norm(near[:, dim:], axis=1, keepdims=True)
    return near


def labels(any_map: AnyMap, worst: int) -> Any:
    """Label the components of cells whose state is at most ``worst``, by scipy."""
    cells = any_map.states <= worst
    return components(cells, "any way" if len(any_map.space.rotations.names) == 4 else "")


def test_classify_returns_the_state_of_the_cell(any_map: AnyMap) -> None:
    q, cells = any_map.draw(np.random.default_rng(0), 400)
    expected = any_map.states[tuple(cells.T)]
    np.testing.assert_array_equal(any_map.space.classify(q), expected)
    np.testing.assert_array_equal(any_map.space.is_free(q), expected == FREE)
    assert any_map.space.classify(q[0]) == expected[0]


def test_count_counts_the_states_of_all_cells(any_map: AnyMap) -> None:
    assert any_map.space.count() == tuple(np.bincount(any_map.states.ravel(), minlength=3).tolist())


def test_a_free_motion_has_only_free_points(any_map: AnyMap) -> None:
    rng = np.random.default_rng(1)
    q0, _ = any_map.draw(rng, 600)
    q1 = draw_near(any_map, q0, rng)
    free = any_map.space.motion_is_free(q0, q1)
    assert 0.01 < free.mean() < 0.999
    if len(any_map.space.rotations.names) == 4:
        return  # tests of rotations check points along rotations about any axis
    for share in np.linspace(0.0, 1.0, 23):
        between = q0[free] + share * (q1[free] - q0[free])
        assert any_map.space.is_free(between).all()


def test_connectivity_agrees_with_labels_by_scipy(any_map: AnyMap) -> None:
    rng = np.random.default_rng(2)
    (q0, cells0), (q1, cells1) = any_map.draw(rng, 150), any_map.draw(rng, 150)
    free, passable = labels(any_map, FREE), labels(any_map, BLOCKED - 1)
    answers = proven_paths(any_map.space, q0, q1)
    for answer, one, other in zip(answers, map(tuple, cells0), map(tuple, cells1), strict=True):
        if free[one] >= 0 and free[one] == free[other]:
            assert answer is True
        if answer is False:
            blocked = passable[one] < 0 or passable[other] < 0
            assert blocked or passable[one] != passable[other]


@pytest.mark.parametrize("any_map", ALL_KINDS, indirect=True, ids="-".join)
def test_clearance_is_at_most_the_distance_to_any_cell_that_is_not_free(any_map: AnyMap) -> None:
    q, cells = any_map.draw(np.random.default_rng(3), 60)
    grid = any_map.space.grid
    clearance = any_map.space.clearance(q)
    for position, cell, distance in zip(q[:, : grid.dim], cells, clearance, strict=True):
        others = np.argwhere(any_map.states[cell[0]] != FREE)
        low = np.array(grid.lower) + grid.spacing * others
        gaps = np.maximum(0.0, np.maximum(low - position, position - low - grid.spacing))
        nearest = np.sqrt((gaps**2).sum(axis=1)).min(initial=np.inf)
        assert distance <= nearest + 1e-9


@pytest.mark.parametrize("kind", IN_MEMORY, ids="-".join)
def test_an_updated_map_equals_a_rebuilt_one(kind: tuple[str, str], tmp_path: Path) -> None:
    obstacle_map, rng = build_kind(kind, tmp_path), np.random.default_rng(4)
    space, shape = obstacle_map.space, obstacle_map.states.shape[1:]
    occupied = obstacle_map.occupied.copy()
    for _ in range(2):
        size = rng.integers(1, 6, len(shape))
        lower = rng.integers(0, np.array(shape) - size + 1)
        cells = (
            random_obstacles(tuple(size), rng) if rng.random() < 0.5 else np.ones(size, dtype=bool)
        )
        occupied[tuple(slice(low, low + n) for low, n in zip(lower, size, strict=True))] = cells
        space.update(cells, lower)
    fresh = obstacle_map.rebuild(occupied)
    q, _ = obstacle_map.draw(rng, 300)
    near = draw_near(obstacle_map, q, rng)
    assert space.count() == fresh.count()
    np.testing.assert_array_equal(space.classify(q), fresh.classify(q))
    np.testing.assert_array_equal(space.motion_is_free(q, near), fresh.motion_is_free(q, near))
    np.testing.assert_array_equal(
        proven_paths(space, q[:40], near[:40]), proven_paths(fresh, q[:40], near[:40])
    )


def test_opening_a_saved_map_gives_an_equal_map(any_map: AnyMap, tmp_path: Path) -> None:
    space: Any = any_map.space
    tiled = isinstance(space, cspace.TiledCSpace)
    opened = cspace.open(space.path) if tiled else reopen(space, tmp_path / "again.zarr")
    assert type(opened) is type(space)
    assert (opened.grid, opened.axes, opened.outside, opened.margin) == (
        space.grid,
        space.axes,
        space.outside,
        space.margin,
    )
    assert opened.count() == space.count()
    q, _ = any_map.draw(np.random.default_rng(6), 300)
    q = np.vstack([q, draw_near(any_map, q, np.random.default_rng(7))])
    np.testing.assert_array_equal(opened.classify(q), space.classify(q))
    np.testing.assert_array_equal(
        opened.motion_is_free(q[:300], q[300:]), space.motion_is_free(q[:300], q[300:])
    )


@pytest.mark.parametrize("space", MAP_INPUTS)
@pytest.mark.parametrize("outside", EXTERIORS)
def test_queries_of_a_window_equal_those_of_the_whole_map(
    space: str, outside: str, tmp_path: Path
) -> None:
    # Configurations outside of a window are MIXED, and fewer connections are decided.
    whole = build_map(space, "tiled", outside, 8, tmp_path, thin=outside == "free")
    tiled, memory, grid, rng = whole.space, whole.memory, whole.space.grid, np.random.default_rng(9)
    size = np.subtract(grid.upper, grid.lower)
    for low, high in ((0.2, 0.7), (0.0, 0.4), (0.6, 1.3)):
        lower, upper = grid.lower + low * size, grid.lower + high * size
        window = tiled.window(lower, upper)
        is_whole = window.grid.contains([grid.lower, grid.upper]).all()
        assert window.outside == (outside if is_whole else "unknown")
        # A motion on the border of the map touches cells beyond it, which only the window has.
        lower, upper = lower + 0.0137, np.minimum(upper, grid.upper) - 0.0137
        q, _ = whole.draw(rng, 300)
        q[:, : grid.dim] = rng.uniform(lower, upper, (300, grid.dim))
        near = draw_near(whole, q, rng)
        near[:, : grid.dim] = np.clip(near[:, : grid.dim], lower, upper)
        for name in ("classify", "overlap_count", "contains_robot"):
            np.testing.assert_array_equal(getattr(window, name)(q), getattr(memory, name)(q), name)
        np.testing.assert_array_equal(
            window.is_free(q[:60], exact=True), memory.is_free(q[:60], exact=True)
        )
        np.testing.assert_array_equal(window.motion_is_free(q, near), tiled.motion_is_free(q, near))
        # Both are lower bounds, by less than a cell's diagonal.
        assert (window.clearance(q) <= memory.clearance(q) + np.sqrt(grid.dim) * grid.spacing).all()
        answers = zip(
            proven_paths(window, q[:40], near[:40]),
            proven_paths(tiled, q[:40], near[:40]),
            strict=True,
        )
        assert all(mine is None or mine == theirs for mine, theirs in answers)
        q[:, : grid.dim] = rng.uniform(
            grid.lower - 9 * size, grid.upper + 9 * size, (300, grid.dim)
        )
        q = q[~window.grid.contains(q[:, : grid.dim])]
        for copied in (window, pickle.loads(pickle.dumps(window))):
            assert is_whole or (copied.classify(q) == MIXED).all()


def public_queries(kind: type) -> set[str]:
    """Return the names of methods that take configurations or paths."""
    names = [name for name in dir(kind) if not name.startswith("_")]
    methods = {name: getattr(kind, name, None) for name in names}  # None for refused methods
    parameters = {
        name: {*inspect.signature(f).parameters}
        for name, f in methods.items()
        if inspect.isfunction(f)
    }
    return {name for name, given in parameters.items() if {"q", "q0", "edges"} & given}


@pytest.mark.parametrize("kind", [cspace.CSpace, cspace.TiledCSpace])
def test_this_module_tests_every_query(kind: type) -> None:
    here = Path(__file__).read_text(encoding="utf-8")
    assert "classify" in public_queries(kind)
    # What every space has for planners is tested with these.
    queries = public_queries(kind) - public_queries(cspace.Space) - set(BATCH_QUERIES)
    assert {name for name in queries if f"space.{name}(" not in here} == set()


def test_a_batch_equals_single_queries(any_map: AnyMap) -> None:
    rng = np.random.default_rng(10)
    q, _ = any_map.draw(rng, 24)
    near = draw_near(any_map, q, rng)
    for name, count, options in queries_of(any_map):
        query, given = getattr(any_map.space, name), [q, near][:count]
        answers = query(*given, *options)
        singles = [query(*row, *options) for row in zip(*given, strict=True)]
        # A batch may ask a tile and one of its rows a smaller window, whose distances round
        # differently.
        rounding = (
            1e-12 if name == "clearance" and isinstance(any_map.space, cspace.TiledCSpace) else 0.0
        )
        np.testing.assert_allclose(answers, singles, rtol=0.0, atol=rounding, err_msg=name)
        shaped = query(*(part.reshape(2, 3, 4, -1) for part in given), *options)
        assert shaped.shape == (2, 3, 4)
        np.testing.assert_array_equal(shaped.ravel(), answers, name)
        few = query(*(part[:3].tolist() for part in given), *options)
        np.testing.assert_allclose(few, answers[:3], rtol=0.0, atol=rounding, err_msg=name)
        assert query(*(part[:0] for part in given), *options).shape == (0,)


@pytest.mark.parametrize(
    "any_map", [kind for kind in ALL_KINDS if kind[1] != "memory"], indirect=True, ids="-".join
)
def test_every_storage_gives_the_same_answers(any_map: AnyMap) -> None:
    # Many configurations lie on borders of cells.
    space, memory = any_map.space, any_map.memory
    rng = np.random.default_rng(15)
    q = draw_configurations(memory, rng, 1000)
    near = draw_near(any_map, q, rng)
    for name, count, options in queries_of(any_map):
        if name == "clearance" and isinstance(space, cspace.TiledCSpace):
            continue  # tiled maps search obstacles only a few tiles away
        given = [q[:300], near[:300]] if name.endswith("connected") else [q, near][:count]
        np.testing.assert_array_equal(
            getattr(space, name)(*given, *options), getattr(memory, name)(*given, *options)
        )
    edges = rng.integers(0, 50, (40, 2))
    for roadmap in ((near[:50],), (q[:50], edges)):
        np.testing.assert_array_equal(space.certify_path(*roadmap), memory.certify_path(*roadmap))


@pytest.mark.parametrize("any_map", IN_MEMORY, indirect=True, ids="-".join)
def test_paths_found_by_the_map_are_certified(any_map: AnyMap) -> None:
    space: Any = any_map.space
    rng = np.random.default_rng(11)
    q0, q1 = space.sample_free(12, rng), space.sample_free(12, rng)
    found = 0
    for start, goal in zip(q0, q1, strict=True):
        for path in (space.find_path(start, goal), space.find_widest_path(start, goal)):
            if len(path):
                found += 1
                assert space.certify_path(path).all()
                np.testing.assert_allclose(path[0], start, atol=1e-9)
                metres = np.linalg.norm(np.diff(path[:, : space.grid.dim], axis=0), axis=1).sum()
                assert space.min_path_length(start, goal) <= metres * (1.0 + 1e-9)
        lower, upper = space.reachable_bounds(start)
        dim = space.grid.dim
        assert (lower <= start[:dim] + 1e-9).all() and (start[:dim] <= upper + 1e-9).all()
    assert found


def test_the_nearest_free_configuration_is_free(any_map: AnyMap) -> None:
    q, _ = any_map.draw(np.random.default_rng(12), 20)
    for configuration in q:
        assert any_map.space.is_free(any_map.space.nearest_free(configuration))


@pytest.mark.parametrize("any_map", IN_MEMORY, indirect=True, ids="-".join)
def test_the_obstacle_distance_of_a_batch_is_its_minimum(any_map: AnyMap) -> None:
    space: Any = any_map.space
    q = space.sample_free(12, np.random.default_rng(14))
    singles = [space.obstacle_distance(configuration[np.newaxis]) for configuration in q]
    assert space.obstacle_distance(q) == pytest.approx(min(singles))


@pytest.mark.parametrize("name", MAP_INPUTS)
def test_tile_subproblems_are_connected_within_their_tiles(name: str, tmp_path: Path) -> None:
    whole = build_map(name, "tiled", "free", 8, tmp_path)
    space: Any = whole.space
    space.compute_components()
    q, _ = whole.draw(np.random.default_rng(13), 40)
    joined = [pair for pair in itertools.pairwise(q) if space.is_connected(*pair)][:4]
    assert joined
    for q0, q1 in joined:
        subproblems = space.subproblems(q0, q1)
        np.testing.assert_allclose(subproblems[0][1][: space.grid.dim], q0[: space.grid.dim])
        np.testing.assert_allclose(subproblems[-1][2][: space.grid.dim], q1[: space.grid.dim])
        for open_tile, start, goal in subproblems:
            assert open_tile().is_connected(start, goal)
        for before, after in itertools.pairwise(subproblems):
            np.testing.assert_array_equal(before[2], after[1])
