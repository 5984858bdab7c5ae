"""The widest path: as wide as any can be, then the shortest, told by graphs that share no code with it."""

import bisect
import contextlib
import copy
import itertools
import math
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components, dijkstra

from cspace import FREE, MIXED, ConfigurationError, CSpace, InputError, Robot, Workspace, build
from cspace.map import search, widest
from cspace.map.components import Components
from oracles import link_cells, to_graph
from planning import ENDPOINTS, room, turn_between, with_state
from strategies import seeds

SPACES = ("plane", "space", "turning", "yawing")
TURNS = {"turning": 5, "yawing": 4}


def random_map(name: str, rng: np.random.Generator) -> CSpace:
    """A small map with scattered cells that are not FREE."""
    cells = tuple((rng.integers(3, 9, 2) if name in ("plane", "turning") else rng.integers(2, 5, 3)).tolist())
    shape = (TURNS[name], *cells) if name in TURNS else cells
    state = np.where(rng.random(shape) < rng.uniform(0.02, 0.3), MIXED, FREE).astype(np.uint8)
    return with_state(state, TURNS.get(name), spacing=0.5)


def widest_of(space: CSpace) -> widest.Widest:
    """What widest paths derive from a map."""
    return widest.Widest.of(
        space._kernel_map, space._kernel_map.states, space.rotations, space.periodic_axes[: space.grid.dim]
    )


def middles(space: CSpace) -> np.ndarray:
    """Middles of all cells, in a row, rotation cell by rotation cell."""
    grid = space.grid
    places = grid.center_of(np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1))
    places = places.reshape(-1, grid.dim)
    turns = np.repeat(space.rotations.centers, len(places), axis=0)
    return np.column_stack([np.tile(places, (space.rotations.count, 1)), turns])


def links(space: CSpace, wide: np.ndarray, corners: bool) -> Any:
    """The cells of a map that are wide enough, link_cells where a robot can go from one to the next, with lengths."""
    turns, size = space.rotations.count, math.prod(space.grid.shape)
    straight = [False] * space.grid.dim
    parts = [link_cells(part, straight, corners) for part in wide.reshape(turns, *space.grid.shape)]
    within = [(first + k * size, last + k * size, 0.5 * metres) for k, (first, last, metres) in enumerate(parts)]
    if space.rotations.names:
        first, last, cells = link_cells(wide.reshape(turns, size), [True, False], corners=False)
        turned = first % size == last % size
        within.append((first[turned], last[turned], 0.5 * 2 * math.pi / turns * cells[turned]))
    return to_graph(np.concatenate(within, axis=1), wide.size)


def widest_of_all(space: CSpace, start: int, goal: int) -> float:
    """The largest clearance that the narrowest cell of a chain can have, by halving; 0 where there is none."""
    room = np.asarray(space.clearance(middles(space)))

    def is_too_much(least: float) -> bool:
        wide = room >= least
        labels = connected_components(links(space, wide, False))[1]
        return not (wide[start] and wide[goal] and labels[start] == labels[goal])

    levels = np.unique(room[room > 0.0]).tolist()
    return [0.0, *levels][bisect.bisect_left(levels, True, key=is_too_much)]


def length_of(space: CSpace, path: np.ndarray) -> float:
    """Metres, and half a metre for each radian of yaw."""
    dim = space.grid.dim
    turns = np.abs(turn_between(path[:-1, dim:], path[1:, dim:])).sum()
    return float(np.linalg.norm(np.diff(path[:, :dim], axis=0), axis=1).sum() + 0.5 * turns)


@pytest.mark.parametrize("name", SPACES)
@settings(max_examples=8)
@example(65537)  # the way up must not cut a corner
@given(seeds)
def test_a_path_is_as_wide_as_any_and_no_longer_than_it_must_be(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    space = random_map(name, rng)
    points, cells = middles(space), list(np.ndindex(space.rotations.count, *space.grid.shape))
    kept = widest_of(space)
    room = np.asarray(space.clearance(points))
    levels = kept.levels[kept.slice_of].ravel()
    assert np.array_equal(levels > 0, room > 0.0) and (np.abs(levels / 128 - room) <= 1 / 128 + 1e-6).all()
    free = np.flatnonzero(room > 0.0)
    if not len(free):
        return
    outside = np.zeros(len(kept.levels), dtype=bool)
    join = partial(Components, slice_of=kept.slice_of, neighbors=space.rotations.neighbors, exterior_open=outside)
    for start, goal in rng.choice(free, (2, 2)):
        best = widest_of_all(space, start, goal)
        ends = np.array(cells[start]), np.array(cells[goal])
        level = kept.bottleneck(*ends, join, math.inf)
        assert kept.bottleneck(*ends[::-1], join, math.inf) == level and len(kept.cached) <= widest.CACHED
        assert abs(level / 128 - best) <= 1 / 128 + 1e-6
        path = space.find_widest_path(points[start], points[goal], straight=False)
        assert (len(path) > 0) == (best > 0.0)
        if not len(path):
            continue
        assert np.asarray(space.clearance(path)).min() >= best - 1e-6  # a way up may cut a corner
        assert space.certify_path(path).all()
        shortest = dijkstra(links(space, levels >= level, True), indices=start)[goal]
        chain = points[[cells.index(tuple(cell)) for cell in kept.shortest(*ends, level, math.inf).tolist()]]
        assert length_of(space, chain) == pytest.approx(shortest, rel=1e-5)
        pulled = space.find_widest_path(points[start], points[goal])
        assert np.array_equal(pulled[[0, -1]], path[[0, -1]]) and space.certify_path(pulled).all()
        assert length_of(space, pulled) <= length_of(space, path) + 1e-9
        shares = np.linspace(0.0, 1.0, 30)[:, None]
        parts = [
            space.rotations.moved(np.repeat(a[None], 30, axis=0), shares * space.rotations.steps(a, b))
            for a, b in itertools.pairwise(pulled)
        ]
        along = np.concatenate([*parts, pulled])
        # Between the middles of cells there may be less room, by half a diagonal.
        assert np.asarray(space.clearance(along)).min() >= best - 0.25 * math.sqrt(space.grid.dim) - 1e-6


@settings(max_examples=30)
@given(seeds, st.booleans(), st.sampled_from([(1, 40), (7, 9), (3, 4, 5), (1, 4, 5)]))
def test_levels_are_distances_to_what_is_not_free(seed: int, open_all_around: bool, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(seed)
    state = np.where(rng.random(shape) < rng.choice([0.0, 0.02, 0.3]), MIXED, FREE).astype(np.uint8)
    space = with_state(state)
    table = np.array([[*np.repeat([0, -1], len(shape)), FREE if open_all_around else MIXED]])
    map_ = space._kernel_map._replace(exterior=table)
    levels = widest.Widest.of(map_, map_.states, space.rotations, space.periodic_axes).levels.reshape(shape)
    shut = np.argwhere(state != FREE)
    if not open_all_around:
        rim = np.argwhere(np.pad(np.zeros(shape, dtype=bool), 1, constant_values=True)) - 1
        shut = np.concatenate([shut, rim])
    for cell in np.argwhere(state == FREE):
        apart = np.maximum(np.abs(shut - cell) - 0.5, 0.0)
        least = np.linalg.norm(apart, axis=1).min(initial=1024.0)
        assert levels[tuple(cell)] == min(int(64 * least + 1e-4), 65535)


def test_start_and_goal_beside_a_wall_do_not_make_the_path_narrow() -> None:
    space = build(Workspace.from_array(np.zeros((60, 40), dtype=bool), 0.1), Robot.disc(0.2))
    path = space.find_widest_path((0.45, 0.45), (5.55, 0.45))
    assert space.certify_path(path).all() and np.asarray(space.clearance(path[1:-1])).min() > 1.4
    assert np.asarray(space.clearance(path)).min() == space.clearance((0.45, 0.45))


@pytest.mark.parametrize("name", [*SPACES, "floating"])
def test_it_finds_the_wide_way_in_every_space(name: str) -> None:
    space = room(name)
    path = space.find_widest_path(*ENDPOINTS[name])
    assert len(path) > 2 and space.certify_path(path).all()
    assert np.array_equal(path[[0, -1]], space.rotations.canonical(np.array(ENDPOINTS[name])))
    assert np.array_equal(path, space.find_widest_path(*ENDPOINTS[name]))
    back = space.find_widest_path(*ENDPOINTS[name][::-1], straight=False)
    there = space.find_widest_path(*ENDPOINTS[name], straight=False)
    assert np.asarray(space.clearance(back)).min() == pytest.approx(np.asarray(space.clearance(there)).min(), abs=2e-3)


def test_a_path_that_is_far_longer_than_the_map_is_wide_takes_no_more_memory() -> None:
    state = np.zeros((240, 200), dtype=np.uint8)
    for n, x in enumerate(range(6, 234, 8)):
        state[x, slice(0, -6) if n % 2 else slice(6, None)] = MIXED
    space, endpoints = with_state(state, spacing=1.0), ((2.5, 100.5), (237.5, 100.5))
    space.find_widest_path(*endpoints)  # compiled
    tracemalloc.start()
    path = space.find_widest_path(*endpoints)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert space.certify_path(path).all() and length_of(space, path) > 29 * 190 and peak < 100 * state.size


@pytest.mark.parametrize("error", [TimeoutError, KeyboardInterrupt])
@pytest.mark.parametrize("name", ["plane", "turning"])
def test_a_search_that_was_broken_off_leaves_nothing_half_made(
    name: str, error: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected, looks = room(name).find_widest_path(*ENDPOINTS[name]), [0]

    def look(until: float) -> None:
        looks[0] -= 1
        if not looks[0]:
            raise error

    monkeypatch.setattr(search, "ENTRIES", 64)  # it looks at the clock where it needs more room, too
    monkeypatch.setattr(search, "keep_on", look)
    monkeypatch.setattr(widest, "keep_on", look)
    for after in itertools.count(1):
        space, looks[0], path = copy.copy(room(name)), after, expected[:0]
        with contextlib.suppress(error):
            path = space.find_widest_path(*ENDPOINTS[name])
        looks[0] = 0
        assert np.array_equal(space.find_widest_path(*ENDPOINTS[name]), expected)
        if len(path):
            break
    assert after > 5 and np.array_equal(path, expected)


def test_threads_share_the_components_of_levels() -> None:
    rng = np.random.default_rng(1)
    space = build(Workspace.from_array(rng.random((90, 70)) < 0.01, 0.1), Robot.disc(0.1))
    pairs = space.sample_free(24, rng).reshape(-1, 2, 2)
    expected = [copy.copy(space).find_widest_path(*pair) for pair in pairs]
    with ThreadPoolExecutor(4) as pool:
        for paths in pool.map(lambda _: [space.find_widest_path(*pair) for pair in pairs], range(4)):
            assert all(map(np.array_equal, paths, expected))


def test_it_goes_by_the_obstacles_as_they_are_now() -> None:
    space = build(Workspace.from_array(np.zeros((60, 40), dtype=bool), 0.1), Robot.disc(0.2))
    endpoints = (1.0, 2.0), (5.0, 2.0)
    before = space.find_widest_path(*endpoints)
    space.add_obstacle("pillar", shapely.box(2.5, 1.2, 3.5, 4.0))
    after = space.find_widest_path(*endpoints)
    assert space.certify_path(after).all() and not space.certify_path(before).all()
    assert np.array_equal(after, build(space.workspace, space.robot).find_widest_path(*endpoints))
    space.remove_obstacle("pillar")
    assert np.array_equal(space.find_widest_path(*endpoints), before)


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_levels_follow_updates(name: str, outside: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    cells = rng.random((40, 30) if name in ("plane", "turning") else (12, 11, 10)) < 0.004
    robot = Robot.disc(0.1) if cells.ndim == 2 else Robot.ball(0.1)
    if name in TURNS:
        robot = Robot.rectangle(0.3, 0.1) if cells.ndim == 2 else Robot.box((0.3, 0.1, 0.1))
    space = build(Workspace.from_array(cells, 0.1), robot, rotations=TURNS.get(name), outside=outside)
    states = space._kernel_map.states
    kept, fresh = widest_of(space), widest.Widest.of
    monkeypatch.setattr(widest.Widest, "of", lambda *_: kept)  # the map has this one, and updates note themselves
    endpoints = space.sample_free(2, rng)
    space.find_widest_path(*endpoints)
    for step in range(24):
        size = rng.integers(1, 4, cells.ndim)
        lower = rng.integers(0, np.array(cells.shape) - size + 1)
        space.update(rng.random(size) < 0.5 * (step % 3), lower)
        if step % 2:
            levels = fresh(space._kernel_map, states, space.rotations, kept.periodic_axes).levels
            assert np.array_equal(kept.renewed(space._kernel_map, states).levels, levels)


def test_refuses_wrong_endpoints_and_too_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    space = room("plane")
    with pytest.raises(ConfigurationError, match="one FREE configuration in the grid"):
        space.find_widest_path((3.1, 1.0), (9.0, 5.0))
    with pytest.raises(InputError, match="q1 has shape"):
        space.find_widest_path((1.0, 1.0), (9.0, 5.0, 1.0))
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: 1000)
    with pytest.raises(InputError, match=r"to find its widest path.* needs about .* of memory.*at most 950 bytes"):
        space.find_widest_path(*ENDPOINTS["plane"])
