"""Maps with periodic axes: seams, updates, obstacles, files and plans."""

import copy
import itertools
import math
import pickle
from bisect import bisect_left
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib import pyplot as plt
from ompl import base as ob
from scipy.sparse.csgraph import connected_components, dijkstra

import cspace
import planners
from cspace import FREE, MIXED
from cspace.errors import InputError
from cspace.map.components import BLOCK_SHIFTS, PeriodicComponents
from cspace.map.widest import Widest
from cspace.plot import save_plot
from cspace.rotations.base import shorter
from planners.states import kind_of
from tests.handmade import joint_maps, make_joint_map, map_in
from tests.maps import proven_paths
from tests.oracles import link_cells, segment_meets_block, to_graph
from tests.refusals import refusals

PERIODIC_AXES = [(True, False), (False, True), (True, True), (True, False, False), (False, True, True)]


def label_cells(states: Any, periodic_axes: tuple[bool, ...], worst: int) -> Any:
    """Label components of cells up to a ``worst`` state; others get -1."""
    graph = to_graph(link_cells(states <= worst, periodic_axes, corners=False), states.size)
    return np.where(states <= worst, connected_components(graph, directed=False)[1].reshape(states.shape), -1)


def draw_configurations(space: cspace.CSpace, rng: np.random.Generator, n: int) -> Any:
    """Draw configurations in the grid, shifted by whole turns."""
    grid = space.grid
    inside = rng.uniform(grid.lower, grid.upper, (n, grid.dim))
    return inside + math.tau * rng.integers(-3, 4, inside.shape) * space.periodic_axes


def cell_of(space: cspace.CSpace, q: Any) -> tuple[int, ...]:
    """Return the cell of a configuration, wrapped along periodic axes."""
    cell = np.floor((q - np.asarray(space.grid.lower)) / space.grid.spacing).astype(int)
    return tuple(np.where(space.periodic_axes, cell % space.grid.shape, cell).tolist())


@pytest.mark.parametrize("periodic_axes", PERIODIC_AXES)
@settings(max_examples=6)
@given(data=st.data())
def test_paths_cross_the_seam(data: st.DataObject, periodic_axes: tuple[bool, ...]) -> None:
    space, states, rng = data.draw(joint_maps(periodic_axes))
    q = draw_configurations(space, rng, 40)
    at = [cell_of(space, each) for each in q]
    np.testing.assert_array_equal(space.classify(q), [states[each] for each in at])
    free, passable = label_cells(states, periodic_axes, FREE), label_cells(states, periodic_axes, MIXED)
    stays = space.motion_is_free(q, q)
    for one, other in itertools.pairwise(range(len(q))):
        same = free[at[one]] >= 0 and free[at[one]] == free[at[other]]
        apart = passable[at[one]] < 0 or passable[at[one]] != passable[at[other]]
        with mock.patch.dict(BLOCK_SHIFTS, {2: (0, 2, 2), 3: (1, 1, 1)}):
            assert proven_paths(space, q[one], q[other]) is (True if same else False if apart else None)
        if states[at[one]] == FREE and states[at[other]] == FREE and stays[[one, other]].all():
            path = space.find_path(q[one], q[other])
            assert (len(path) > 0) == same
            if same:
                np.testing.assert_allclose(path[0], q[one], atol=1e-9)
                turns = (path[-1] - q[other]) / math.tau
                np.testing.assert_allclose(turns, np.rint(turns) * periodic_axes, atol=1e-9)
                assert (np.abs(np.diff(path, axis=0))[:, list(periodic_axes)] < 0.5 * math.tau + 1e-9).all()
                assert space.certify_path(path).all()
        if states[at[one]] == FREE:
            lower, upper = space.reachable_bounds(q[one])
            cells = np.argwhere(free == free[at[one]])
            assert (np.rint((lower - space.grid.lower) / space.grid.spacing) <= cells.min(axis=0)).all()
            assert (np.rint((upper - space.grid.lower) / space.grid.spacing) >= cells.max(axis=0) + 1).all()


@pytest.mark.parametrize("periodic_axes", PERIODIC_AXES)
@settings(max_examples=4)
@given(data=st.data())
def test_edges_take_the_shorter_direction(data: st.DataObject, periodic_axes: tuple[bool, ...]) -> None:
    # An edge is free if and only if all cells that it touches are.
    space, states, rng = data.draw(joint_maps(periodic_axes))
    grid = space.grid
    q0, q1 = draw_configurations(space, rng, 12), draw_configurations(space, rng, 12)
    near = q0 + rng.normal(scale=0.7 * grid.spacing, size=q0.shape)
    q1[::2] = np.where(periodic_axes, near, np.clip(near, np.add(grid.lower, 1e-3), np.subtract(grid.upper, 1e-3)))[::2]
    answers = space.motion_is_free(q0, q1)
    check = space.edge_checker()
    assert [check(*a, *b) for a, b in zip(q0.tolist(), q1.tolist(), strict=True)] == answers.tolist()
    np.testing.assert_array_equal(
        space.certify_path(np.concatenate([q0, q1]), [(k, k + 12) for k in range(12)]), answers
    )
    for start, end, free in zip(q0, q1, answers, strict=True):
        step = end - start
        step -= math.tau * np.round(step / math.tau) * periodic_axes
        a, b = ((each - grid.lower) / grid.spacing for each in (start, start + step))
        first, last = np.floor(np.minimum(a, b)).astype(int), np.floor(np.maximum(a, b)).astype(int)
        touched = [
            each
            for each in itertools.product(*(range(low, high + 1) for low, high in zip(first, last, strict=True)))
            if segment_meets_block(a.tolist(), b.tolist(), each, [k + 1 for k in each])
        ]
        around = [tuple(np.where(periodic_axes, np.array(each) % grid.shape, each)) for each in touched]
        assert free == all(states[each] == FREE for each in around)


@st.composite
def near_half_turns(draw: st.DrawFn) -> float:
    """Draw angles, many at most three floats from a quarter turn."""
    angle = draw(st.integers(-160, 160)) * 0.5 * math.pi + draw(st.sampled_from([0.0, 0.0, 1.0]))
    for _ in range(draw(st.integers(0, 3))):
        angle = math.nextafter(angle, draw(st.sampled_from([-math.inf, math.inf])))
    return -angle if draw(st.booleans()) else angle


@pytest.mark.parametrize("exact", [False, True])
@settings(max_examples=12)
@given(data=st.data())
def test_half_turns_take_the_same_direction_in_every_query(data: st.DataObject, exact: bool) -> None:
    # Batches, checkers and OMPL's callbacks agree exactly, also on borders of cells.
    space, _, rng = data.draw(joint_maps((True, False)))
    q0, q1 = rng.uniform(space.grid.lower, space.grid.upper, (2, 20, 2))
    angles = data.draw(st.lists(near_half_turns(), min_size=40, max_size=40))
    q0[:, 0], q1[:, 0] = np.reshape(angles, (2, 20))
    free, edges = space.is_free(q0, exact=exact).tolist(), space.motion_is_free(q0, q1, exact=exact).tolist()
    check, edge = space.point_checker(exact=exact), space.edge_checker(exact=exact)
    clearance = space.clearance_checker()
    assert [check(*q) for q in q0.tolist()] == free
    assert [edge(*a, *b) for a, b in zip(q0.tolist(), q1.tolist(), strict=True)] == edges
    pairs = [(k, k + len(q0)) for k in range(len(q0))]
    assert space.certify_path(np.concatenate([q0, q1]), pairs, exact=exact).tolist() == edges
    assert [bool(space.certify_path([q0[k], q1[k]], exact=exact).all()) for k in range(4)] == edges[:4]
    assert [clearance(*q) for q in q0.tolist()] == space.clearance(q0).tolist()
    assert space.is_connected(q0, q0).tolist() == space.is_free(q0).tolist()
    si = ob.SpaceInformation(planners.state_space(space))
    valid, motion = (kind(si, space, exact=exact) for kind in (planners.StateValidityChecker, planners.MotionValidator))
    start, end = si.allocState(), si.allocState()
    for a, b, point, free_all_along in zip(q0.tolist(), q1.tolist(), free, edges, strict=True):
        kind_of(space).write(start, *a)
        kind_of(space).write(end, *b)
        assert valid.isValid(start) == point
        assert motion.checkMotion(start, end) == free_all_along


@given(first=near_half_turns(), last=near_half_turns())
def test_the_shorter_angle_equals_math_remainder(first: float, last: float) -> None:
    assert float(shorter(np.array([last - first]), [True])[0]) == math.remainder(last - first, math.tau)
    np.testing.assert_array_equal(shorter(np.array([math.nan, last, -0.0]), [True, False, True]), [math.nan, last, 0.0])


@pytest.mark.parametrize("periodic_axes", PERIODIC_AXES)
@settings(max_examples=5)
@given(data=st.data())
def test_distances_cross_the_seam(data: st.DataObject, periodic_axes: tuple[bool, ...]) -> None:
    space, states, rng = data.draw(joint_maps(periodic_axes))
    grid, q = space.grid, draw_configurations(space, rng, 15)
    turns = np.array(list(itertools.product(*((-1, 0, 1) if each else (0,) for each in periodic_axes))))
    position = (np.array(space.rotations._make_canonical(q)) - grid.lower) / grid.spacing

    def nearest(cells: Any, half: float) -> Any:
        """Return the distance from each configuration to the nearest of some cells."""
        copies = (cells[:, np.newaxis] + turns * grid.shape).reshape(-1, grid.dim)
        gaps = np.maximum(np.abs(position[:, np.newaxis] - copies - 0.5) - half, 0.0)
        return np.linalg.norm(gaps, axis=2).min(axis=1, initial=math.inf)

    boundary = np.where(periodic_axes, math.inf, np.minimum(position, np.array(grid.shape) - position)).min(axis=1)
    expected = grid.spacing * np.minimum(nearest(np.argwhere(states != FREE), 0.5), boundary)
    clearance = space.clearance(q)
    assert (clearance <= expected + 1e-9).all()
    assert (clearance >= np.minimum(expected, 0.5 * math.tau) - 1e-6).all()
    check = space.clearance_checker()
    np.testing.assert_allclose([check(*each) for each in q], clearance, atol=1e-12)
    if (states == FREE).any():
        least = grid.spacing * nearest(np.argwhere(states == FREE), 0.0)
        for each, distance in zip(q, least, strict=True):
            center = space.nearest_free(each)
            step = each - center
            assert space.is_free(center)
            assert np.linalg.norm(step - math.tau * np.round(step / math.tau) * periodic_axes) <= distance + 1e-9
    for distance in (0.3 * grid.spacing, 1.2 * grid.spacing):
        low, high = (
            np.floor(position - distance / grid.spacing).astype(int),
            np.floor(position + distance / grid.spacing),
        )
        for k in range(len(q)):
            box = itertools.product(*(range(a, int(b) + 1) for a, b in zip(low[k], high[k], strict=True)))
            cells = [np.where(periodic_axes, np.array(each) % grid.shape, each) for each in box]
            inside = [(each >= 0).all() and (each < grid.shape).all() for each in cells]
            free = all(ok and states[tuple(each)] == FREE for ok, each in zip(inside, cells, strict=True))
            # Boxes wider than half a turn are never proven.
            assert space.is_free_around(q[k], distance) == free or (not free or distance > 0.4 * math.tau)


def clearance_levels(states: Any, periodic_axes: tuple[bool, ...]) -> Any:
    """Return clearances of cell centers in 64ths of a cell."""
    turns = np.array(list(itertools.product(*((-1, 0, 1) if each else (0,) for each in periodic_axes))))
    shut = (np.argwhere(states != FREE)[:, np.newaxis] + turns * states.shape).reshape(-1, 1, states.ndim)
    cells = np.moveaxis(np.indices(states.shape), 0, -1)
    gaps = np.maximum(np.abs(cells.reshape(-1, states.ndim) - shut) - 0.5, 0.0)
    least = np.linalg.norm(gaps, axis=2).min(axis=0, initial=1024.0).reshape(states.shape)
    boundary = np.where(periodic_axes, math.inf, np.minimum(cells, np.array(states.shape) - 1 - cells) + 0.5).min(
        axis=-1
    )
    return np.where(states == FREE, np.floor(64.0 * np.minimum(np.minimum(least, boundary), 1023.99) + 1e-4), 0.0)


def widest_chain(levels: Any, periodic_axes: tuple[bool, ...], start: int, goal: int) -> tuple[float, float]:
    """Return the bottleneck of a widest chain and the shortest length."""

    @cache
    def length(least: float) -> float:
        return float(dijkstra(to_graph(link_cells(levels >= least, periodic_axes), levels.size), indices=start)[goal])

    # Lower levels connect all cells that higher levels connect.
    widths = np.unique(levels[(levels > 0.0) & (levels <= min(levels.flat[start], levels.flat[goal]))])[::-1].tolist()
    first = bisect_left(widths, True, key=lambda least: math.isfinite(length(least)))
    return (widths[first], length(widths[first])) if first < len(widths) else (0.0, math.inf)


@pytest.mark.parametrize("periodic_axes", PERIODIC_AXES)
@settings(max_examples=5)
@given(data=st.data())
def test_widest_paths_cross_the_seam_also_after_updates(data: st.DataObject, periodic_axes: tuple[bool, ...]) -> None:
    # The path is as wide as any chain of cells, and the shortest of that width.
    space, states, rng = data.draw(joint_maps(periodic_axes).filter(lambda each: each[1].shape[0] > 1))
    grid, states = space.grid, states.copy()
    for _ in range(2):
        levels, free = clearance_levels(states, periodic_axes), np.argwhere(states == FREE)
        whole = map_in(space.workspace, space.robot, states.copy())
        search = Widest.of(whole._kernel_map, whole._kernel_map.states, whole.rotations, periodic_axes)
        for start, goal in rng.choice(free, (2, 2)) if len(free) else []:
            turns = math.tau * rng.integers(-2, 3, (2, grid.dim)) * periodic_axes
            endpoints = grid.center_of(np.array([start, goal])) + turns
            one, other = (int(np.ravel_multi_index(tuple(each), states.shape)) for each in (start, goal))
            best, length = widest_chain(levels, periodic_axes, one, other)
            path = space.find_widest_path(*endpoints, straight=False)
            assert (len(path) > 0) == (best > 0)
            if not len(path):
                continue
            assert min(levels[cell_of(space, each)] for each in path) >= best  # the bottleneck may lie beside a corner
            for each in (path, space.find_widest_path(*endpoints)):
                np.testing.assert_allclose(each[0], endpoints[0], atol=1e-9)
                more = (each[-1] - endpoints[1]) / math.tau
                np.testing.assert_allclose(more, np.rint(more) * periodic_axes, atol=1e-9)
                assert space.certify_path(each).all()
            both = np.append(0, start), np.append(0, goal)
            join = partial(
                PeriodicComponents,
                slice_of=search.slice_of,
                neighbors=whole.rotations._neighbors,
                exterior_open=np.zeros(1, dtype=bool),
                periodic=periodic_axes,
            )
            assert search.bottleneck(*both, join, math.inf) == best
            steps = np.diff(search.shortest(*both, int(best), math.inf)[:, 1:].T)
            shape = np.array(states.shape)[:, np.newaxis]
            steps -= shape * np.rint(steps / shape).astype(int) * np.array(periodic_axes)[:, np.newaxis]
            assert np.linalg.norm(steps, axis=0).sum() == pytest.approx(length)
        box = tuple(slice(0, n // 2 + 1) for n in states.shape)
        states[box] = rng.integers(0, 2, states[box].shape) * 2
        space.update(states[box] > 0, [0] * grid.dim)


@pytest.mark.parametrize("name", ["find_path", "find_widest_path"])
@pytest.mark.parametrize("cells", [3, 5, 12, 31])
def test_paths_begin_and_end_on_the_seam_itself(name: str, cells: int) -> None:
    # Rounding decides if the seam is in the first or the last cell.
    space = make_joint_map(np.zeros((cells, 6), np.uint8), (True, False), cells)
    sides = [math.pi, math.nextafter(math.pi, 0.0), math.nextafter(math.pi, 4.0), 3.0 * math.pi, 5.0 * math.pi]
    for start, goal in itertools.permutations([*sides, *(-each for each in sides)], 2):
        path = getattr(space, name)((start, -0.9), (goal, -0.5))
        assert np.abs(np.diff(path[:, 0])).max() <= space.grid.spacing and path[0, 0] == pytest.approx(start, abs=1e-9)


@pytest.mark.parametrize("cells", [1, 2, 9])
@pytest.mark.parametrize("periodic_axes", PERIODIC_AXES)
def test_updates_reach_both_sides_of_the_seam_and_existing_checkers(
    periodic_axes: tuple[bool, ...], cells: int
) -> None:
    rng = np.random.default_rng(len(periodic_axes))
    shape = tuple(cells if turns else 5 for turns in periodic_axes)
    states = (rng.random(shape) < 0.2).astype(np.uint8) * 2
    space = make_joint_map(states, periodic_axes, cells)
    q = draw_configurations(space, rng, 200)
    checks = space.point_checker(), space.edge_checker(), space.clearance_checker()
    space.is_connected(q[0], q[1]), space.motion_is_free(q[:-1], q[1:])
    for _ in range(4):
        low = rng.integers(0, shape)
        size = np.minimum(rng.integers(1, 5, len(shape)), np.array(shape) - low)
        box = tuple(map(slice, low, low + size))
        states[box] = rng.integers(0, 2, size) * 2
        space.update(states[box] > 0, low.tolist())
        fresh = make_joint_map(states, periodic_axes, cells)
        np.testing.assert_array_equal(space.cell_states, states)
        for name in ("classify", "clearance"):
            np.testing.assert_array_equal(getattr(space, name)(q), getattr(fresh, name)(q))
        for name in ("motion_is_free", "is_connected", "is_disconnected"):
            np.testing.assert_array_equal(getattr(space, name)(q[:-1], q[1:]), getattr(fresh, name)(q[:-1], q[1:]))
        for each in q[:20] if (states == FREE).any() else ():
            np.testing.assert_array_equal(space.nearest_free(each), fresh.nearest_free(each))
        others = fresh.point_checker(), fresh.edge_checker(), fresh.clearance_checker()
        for check, other, arguments in zip(checks, others, (q, np.hstack([q[:-1], q[1:]]), q), strict=True):
            assert [check(*each) for each in arguments] == [other(*each) for each in arguments]


@pytest.mark.parametrize("periodic_axes", PERIODIC_AXES)
def test_obstacles_cross_the_seam(periodic_axes: tuple[bool, ...]) -> None:
    # Some obstacles are wider than a turn.
    rng, cells = np.random.default_rng(7), 12
    shape = tuple(cells if turns else 5 for turns in periodic_axes)
    states = (rng.random(shape) < 0.1).astype(np.uint8) * 2
    space = make_joint_map(states, periodic_axes, cells)
    q = draw_configurations(space, rng, 300)
    for radius in (0.4, 0.9, 3.5):
        centers = draw_configurations(space, rng, 3)
        centers[0] = np.where(periodic_axes, math.pi, centers[0])
        space.is_free(q)
        space.add_obstacle("balls", centers, radius=radius)
        steps = q[:, np.newaxis] - centers
        apart = np.linalg.norm(steps - math.tau * np.round(steps / math.tau) * periodic_axes, axis=2).min(axis=1)
        side = space.grid.spacing * math.sqrt(len(periodic_axes))
        assert not space.is_free(q)[apart <= radius].any()
        assert (space.clearance(q) <= np.maximum(apart - radius, 0.0) + 1e-9).all()
        alone = states[tuple(np.transpose([cell_of(space, each) for each in q]))]
        np.testing.assert_array_equal(space.classify(q)[apart > radius + side], alone[apart > radius + side])
        assert space.obstacles["balls"].bounds[0] == pytest.approx(centers.min(axis=0) - radius)
    space.remove_obstacle("balls")
    np.testing.assert_array_equal(space.cell_states, states)


def test_copies_and_files_keep_periodic_axes(tmp_path: Path) -> None:
    space, left, right = wall_map(), LEFT, (1.5, 0.2)
    for name in ("map", "map.zarr"):
        space.save(tmp_path / name)
    for again in (
        cspace.open(tmp_path / "map"),
        cspace.open(tmp_path / "map.zarr"),
        copy.deepcopy(space),
        pickle.loads(pickle.dumps(space)),
    ):
        assert repr(again) == repr(space)
        assert again.is_connected(left, right)
        assert again.periodic_axes == (True, False)
    assert space.to_xarray().attrs["periodic_axes"] == "a"
    assert space._facts["periodic_axes"] == ["a"]
    path = space.find_path(left, right)
    axes = space.plot(path=path)
    assert axes.get_xlim()[0] < -math.pi + 1e-9
    axes.figure.savefig(tmp_path / "own.png", dpi=50)
    plt.close("all")
    save_plot(space, tmp_path / "map.png", dpi=50, path=path)
    assert (tmp_path / "map.png").read_bytes() == (tmp_path / "own.png").read_bytes()


LEFT = (-1.5, 0.1)


def wall_map() -> cspace.CSpace:
    """Build a map of a continuous joint with a wall."""
    states = np.zeros((12, 6), np.uint8)
    states[4:7] = 2
    return make_joint_map(states, (True, False), 12)


@refusals(
    "call, message",
    (lambda space: space.overlap_count(LEFT), r"overlap_count is undefined on a map with periodic axes \(a\);"),
    (lambda space: space.contains_robot(LEFT), "overlap_count is undefined"),
    (lambda space: space.is_free((300.0, 0.0)), "at most 256 are wrapped exactly"),
    (lambda space: space.is_free((math.inf, 0.0)), "at most 256 are wrapped exactly"),
    (lambda space: space.is_free((math.nan, 0.0)), "nan.*must be finite"),
    (lambda space: space.is_free((0.0, math.inf)), "inf.*must be finite"),
    (lambda space: space.motion_is_free((0.0, math.inf), (0.0, math.inf)), "inf.*must be finite"),
    (lambda space: space.motion_is_free(LEFT, (math.inf, 0.0)), "at most 256 are wrapped exactly"),
)
def test_queries_reject_overlaps_and_angles_that_cannot_be_wrapped(call: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call(wall_map())


@pytest.mark.parametrize("far", [LEFT[0] + 100.0 * math.tau, 1e9, math.inf, math.nan])
def test_checkers_refute_angles_that_cannot_be_wrapped(far: float) -> None:
    space = wall_map()
    for exact in (False, True):
        assert not space.point_checker(exact=exact)(far, LEFT[1])
        assert not space.edge_checker(exact=exact)(far, *LEFT[1:], *LEFT)
        assert not space.edge_checker(exact=exact)(*LEFT, far, LEFT[1])
    assert space.clearance_checker()(far, LEFT[1]) == 0.0
    assert space.point_checker()(*LEFT) and space.edge_checker()(*LEFT, *LEFT)


def test_exact_queries_use_cells_of_joint_maps() -> None:
    space = wall_map()
    assert space.is_free(LEFT, exact=True)
    assert not space.motion_is_free(LEFT, (0.0, 0.1), exact=True)


def connected_across_the_seam() -> tuple[cspace.CSpace, tuple[float, float], tuple[float, float]]:
    """Build a map with endpoints connected only across the seam."""
    states = np.zeros((24, 10), np.uint8)
    states[8:12] = 2
    states[20, 2:] = 2
    return make_joint_map(states, (True, False), 24), (-1.4, 0.3), (0.6, 1.0)


@pytest.mark.parametrize("planner", [None, "Grid", "MaxClearance", "RRTConnect", "KPIECE1", "BITstar"])
def test_planners_cross_the_seam(planner: str | None) -> None:
    space, left, right = connected_across_the_seam()
    plan = planners.plan(space, left, right, planner=planner, seed=3, time_limit=0.3 if planner == "BITstar" else 20.0)
    assert plan.certified
    assert plan.is_connected
    assert plan.length >= math.hypot(math.tau - 2.0, 0.7) - 1e-6
    assert (np.abs(np.diff(plan.path[:, 0])) <= math.pi).all()
    assert plan.path[-1, 0] == pytest.approx(right[0] - math.tau)


def test_a_plan_with_an_objective_crosses_the_seam() -> None:
    space, left, right = connected_across_the_seam()
    plan = planners.plan(space, left, right, planner="RRTstar", objective="clearance", seed=3, time_limit=0.3)
    assert plan.certified and plan.path[-1, 0] == pytest.approx(right[0] - math.tau)
