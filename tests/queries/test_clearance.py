"""Clearance against brute force over all cells."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Rotations, Workspace
from tests.helpers import handmade, oracles
from tests.helpers.strategies import seeds
from tests.helpers.waiting import write_while_querying


def measure_distances(points, cells):
    """Return distances from points (n, d) to cells (m, d)."""
    return oracles.box_gaps(points[:, None], points[:, None], cells, cells + 1).min(
        axis=1, initial=math.inf
    )


def measure_slice_distances(states, points, slices):
    """Return distances from points to cells of their slices."""
    blocked = [np.argwhere(part != FREE) for part in states]
    pairs = zip(
        points[:, None], slices % len(states), strict=True
    )  # a map of all rotations repeats its slices
    return np.concatenate([measure_distances(point, blocked[s]) for point, s in pairs])


@st.composite
def sparse_states(draw, kind):
    """Draw few cells that are not FREE in possibly long grids."""
    rng = np.random.default_rng(draw(seeds))
    shape = rng.integers(1, 20, 3 if "space" in kind else 2)
    shape[rng.integers(len(shape))] = draw(st.sampled_from([1, 8, 63, 64, 65, 200]))
    states = np.zeros((4 if "turning" in kind else 1, *shape), dtype=np.uint8)
    for s in range(len(states)):
        for _ in range(draw(st.sampled_from([0, 1, 2, 30]))):
            states[(s, *(int(rng.integers(n)) for n in shape))] = rng.choice([MIXED, BLOCKED])
    return states


def check_bounds(space, q, distances):
    """Fail unless clearances are close lower bounds of distances, both in cells."""
    dim, bounds = space.grid.dim, np.asarray(space.clearance(q)) / space.grid.spacing
    distances = np.where(space.classify(q) == FREE, distances, 0.0)
    assert (bounds <= distances).all()
    inside = space.grid.contains(q[:, :dim])
    near = inside & np.isfinite(distances)
    assert (bounds[near] >= distances[near] * (1.0 - 1e-5) - math.sqrt(dim) - 1e-6).all()
    assert np.isinf(bounds[inside & np.isinf(distances)]).all()
    centers = near & (
        np.abs((q[:, :dim] - space.grid.lower) / space.grid.spacing % 1.0 - 0.5) < 1e-9
    ).all(axis=1)
    np.testing.assert_allclose(bounds[centers], distances[centers], rtol=1e-5, atol=1e-6)


def draw_near_borders(rng, q, dim):
    """Move configurations to borders of cells of size 1, beside them, or to centers."""
    moves = rng.integers(0, 4, len(q))
    q[moves == 1, :dim] = np.rint(q[moves == 1, :dim])
    q[moves == 2, :dim] = np.rint(q[moves == 2, :dim]) + rng.choice(
        [-1e-9, 1e-9, -1e-15], ((moves == 2).sum(), dim)
    )
    q[moves == 3, :dim] = np.floor(q[moves == 3, :dim]) + 0.5
    return q


@pytest.mark.parametrize("kind", handmade.MAP_KINDS)
@settings(max_examples=40)
@given(st.data(), seeds)
def test_clearance_is_a_close_lower_bound_of_the_distance_to_cells(kind, data, seed):
    states, rng = data.draw(sparse_states(kind)), np.random.default_rng(seed)
    space, dim = handmade.make_map(states, kind, spacing=1.0), states.ndim - 1
    scale = [*states.shape[1:], *[9.0] * (space.size - dim)]
    q = handmade.configurations(space, rng.uniform(-0.3, 1.3, (60, space.size)) * scale)
    draw_near_borders(rng, q, dim)
    check_bounds(
        space, q, measure_slice_distances(states, q[:, :dim], space.rotations.find_cells(q))
    )
    check = space.clearance_checker()
    assert (
        space.clearance(q).tolist()
        == [check(*one) for one in q.tolist()]
        == [space.clearance(one) for one in q]
    )


@settings(max_examples=80)
@given(st.data(), seeds)
def test_clearance_counts_cells_outside_the_grid(data, seed):
    state = data.draw(handmade.states(side=4, mixture=(FREE, FREE, FREE, FREE, MIXED)))
    outside = data.draw(handmade.outsides(state.ndim))
    space = handmade.map_of(state, outside=outside, spacing=1.0)
    around = [
        cell
        for cell in handmade.cells_around(state, outside)
        if handmade.state_of(state, outside, cell) != FREE
    ]
    cells, rng = np.array(around).reshape(-1, state.ndim), np.random.default_rng(seed)
    q = np.concatenate(
        [rng.uniform(-8.0, 16.0, (30, state.ndim)), rng.uniform(0.0, state.shape, (30, state.ndim))]
    )
    draw_near_borders(rng, q, state.ndim)
    check_bounds(space, q, measure_distances(q, cells))
    if outside.state == FREE and len(cells):
        low, high = np.minimum(cells.min(axis=0), 0), np.maximum(cells.max(axis=0) + 1, state.shape)
        assert (space.clearance(q) >= oracles.box_gaps(q, q, low, high) * (1.0 - 1e-5) - 1e-6).all()


# ---- maps that were built ------------------------------------------------------------------------

BUILDS = {
    "plane": (Robot.polygon([(-0.2, -0.1), (0.3, 0.0), (0.0, 0.25)]), None),
    "point": (Robot.disc(0.01), None),
    "space": (Robot.box((0.2, 0.3, 0.1)), None),
    "turning": (
        Robot.polygon([(-0.2, -0.1), (0.3, 0.0), (0.0, 0.25)]),
        [-1.0, -0.8, 0.5, 0.6, 3.0, 2 * math.pi - 1],
    ),
    "turning bar": (Robot.rectangle(0.4, 0.1), 6),
    "turning in space": (Robot.box((0.3, 0.1, 0.2), (0.1, 0.0, 0.0)), 5),
    "turning in space any way": (Robot.box((0.3, 0.1, 0.2)), Rotations.quaternions(2)),
}


@settings(max_examples=25)
@given(seeds, st.sampled_from(list(BUILDS)), st.sampled_from(["blocked", "free"]))
def test_clearance_is_a_close_lower_bound(seed, case, outside):
    robot, rotations = BUILDS[case]
    rng, h, dim = np.random.default_rng(seed), 0.1, 3 if "space" in case else 2
    shape = (9, 8, 10) if dim == 3 else (20, 40)
    workspace = Workspace.from_array(
        rng.random(shape) < rng.choice([0.0, 0.01]), h, rng.uniform(-1, 1, dim)
    )
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    size, lower = np.array(shape), np.array(space.grid.lower)
    around = np.stack(
        np.meshgrid(*(np.arange(-9, n + 9) for n in shape), indexing="ij"), axis=-1
    ).reshape(-1, dim)
    q = lower + rng.uniform(-0.3, 1.3, (16, dim)) * size * h
    q[::3] = lower + np.rint((q[::3] - lower) / h) * h  # on borders of cells
    q = handmade.configurations(
        space, np.column_stack([q, rng.uniform(-9.0, 9.0, (len(q), space.size - dim))])
    )
    check = space.clearance_checker()
    for point, bound, state in zip(q, space.clearance(q), space.classify(q), strict=True):
        slice_q = np.column_stack(
            [space.grid.center_of(around), np.tile(point[dim:], (len(around), 1))]
        )
        blocked = around[space.classify(slice_q) != FREE] * h + lower
        assert check(*point.tolist()) == bound == space.clearance(point)
        if state != FREE:
            assert bound == 0.0
        elif len(blocked):
            distance = oracles.box_gaps(point[:dim], point[:dim], blocked, blocked + h).min()
            assert bound <= distance + 1e-9
            if space.grid.contains(point[:dim]):
                assert bound > distance - (math.sqrt(dim) + 1e-4) * h
        elif outside == "free":
            assert bound == math.inf


@pytest.mark.parametrize("kind", handmade.MAP_KINDS)
def test_steps_within_the_clearance_stay_free(kind):
    rng = np.random.default_rng(4)
    states = (
        rng.random(
            (4 if "turning" in kind else 1, *((20, 15, 40) if "space" in kind else (60, 80)))
        )
        < 0.003
    ) * MIXED
    space = handmade.make_map(states, kind)
    dim = space.grid.dim
    q = handmade.configurations(space, rng.uniform(-1.0, 12.0, (10_000, space.size)))
    course = rng.normal(size=(len(q), dim))
    steps = 0.999999 * np.minimum(space.clearance(q), 50.0)
    moved = q.copy()
    moved[:, :dim] += steps[:, None] * course / np.linalg.norm(course, axis=1)[:, None]
    assert (steps > 0.3).any()
    assert space.is_free(moved[steps > 0]).all()


@pytest.mark.parametrize("kind", handmade.MAP_KINDS)
def test_clearance_of_an_empty_map_is_infinite(kind):
    space = handmade.make_map(handmade.full_states(kind, 3), kind)
    q = handmade.configurations(space, np.full((2, space.size), 0.1))
    q[1, 0] = 50.0
    assert space.clearance(q).tolist() == [math.inf, math.inf]


def test_clearance_is_a_lower_bound_far_outside():
    occupied = np.ones((1, 1), bool)
    space = cspace.build(
        Workspace.from_array(occupied, 0.1, (0.3, 0.7)), Robot.disc(0.1), outside="free"
    )
    q = (-18660724.11262548, 27488679.34025253)
    outer, _ = space.robot.rasters(0.1)
    h, x, y = Fraction(0.1), Fraction(q[0]), Fraction(q[1])
    box_x = Fraction(0.3) - h * outer.upper[0]
    box_y = Fraction(0.7) + h * (1 - outer.lower[1])
    assert Fraction(space.clearance(q)) ** 2 <= (box_x - x) ** 2 + (y - box_y) ** 2


@pytest.mark.parametrize("dim", [2, 3])
def test_clearance_is_finite_far_away_and_zero_for_nan(dim):
    occupied = np.zeros((6, 5, 4)[:dim], bool)
    occupied[(2,) * dim] = True
    robot = Robot.disc(0.1) if dim == 2 else Robot.ball(0.1)
    space = cspace.build(Workspace.from_array(occupied, 1.0), robot, outside="free")
    rest = (1.5,) * (dim - 1)
    for far in (1e15, 1e18, 1e300, 1.7e308):
        assert 0.0 <= space.clearance((far, *rest)) < np.inf
        nearest = space.nearest_free((far, *rest))
        assert nearest[0] == 5.5 and space.is_free(nearest)
    far = np.array([(1e308, *rest), (-1e308, *rest), (1e200, *rest)])
    assert space.clearance(far).tolist() == [space.clearance(q) for q in far]
    for wrong in (np.nan, np.inf):
        assert space.clearance_checker()(wrong, *rest) == 0.0


def test_clearance_finds_a_single_cell_of_a_large_map():
    states = np.zeros((1, 3000, 2500), dtype=np.uint8)
    states[0, 2990, 3] = MIXED
    space = handmade.make_map(states, "plane", spacing=1.0)
    q = np.random.default_rng(0).uniform(0.0, 2500.0, (50, 2))
    distances = measure_distances(q, np.array([(2990, 3)]))
    check_bounds(space, q, distances)
    far = distances > 20.0
    assert far.sum() > 30 and (space.clearance(q)[far] > distances[far] - 0.02).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_clearance_during_updates_is_that_of_some_state(dim):
    """Compare with clearances with and without the changing obstacle."""
    cells = np.zeros((40, 300) if dim == 2 else (40, 70, 20), dtype=bool)
    cells[(5,) * dim] = True
    space = cspace.build(
        Workspace.from_array(cells, 1.0), Robot.disc(0.1) if dim == 2 else Robot.ball(0.1)
    )
    q = np.random.default_rng(0).uniform(6.5, 18.0, (400, dim))
    position, on, off = (
        (19,) * dim,
        np.ones((1,) * dim, dtype=bool),
        np.zeros((1,) * dim, dtype=bool),
    )
    far = space.clearance(q)
    space.update(on, position)
    near = space.clearance(q)
    assert (near < far).any()
    wrong, check = [], space.clearance_checker()

    def query_map():
        answers = np.array([space.clearance(q), [check(*one) for one in q.tolist()]])
        wrong.append(((answers < near) | (answers > far)).sum())

    def change():
        for _ in range(200):
            space.update(off, position)
            space.update(on, position)

    write_while_querying(query_map, [change])
    assert wrong and not any(wrong)
    assert (space.clearance(q) == near).all()
    space.update(off, position)
    assert [check(*one) for one in q.tolist()] == far.tolist() == space.clearance(q).tolist()


def test_clearance_refuses_too_little_memory(monkeypatch):
    space = handmade.make_map(handmade.full_states("turning", 30), "turning")
    q = handmade.configurations(space, np.full((1, space.size), 0.1))
    with monkeypatch.context() as patch:
        patch.setattr("cspace.limits.free_bytes", lambda: 1000)
        with pytest.raises(
            InputError, match=r"with the clearance of its cells.* needs about .* of memory"
        ):
            space.clearance(q)
    assert space.clearance(q).tolist() == [math.inf]


def test_the_clearance_of_a_callback_is_zero_for_nan_beside_the_grid():
    workspace = Workspace.from_array(np.eye(8, dtype=bool), 0.1)
    check = cspace.build(workspace, Robot.disc(0.1), outside="free").clearance_checker()
    assert check(-5.0, 0.4) > 0.0
    assert check(-5.0, np.nan) == check(np.nan, -5.0) == 0.0


@pytest.mark.parametrize("rotation", [(np.nan, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0)])
def test_a_callback_finds_no_clearance_at_what_is_no_rotation(rotation: tuple[float, ...]) -> None:
    workspace = Workspace.from_array(np.pad(np.ones((1, 1, 1), dtype=bool), 3), 0.1)
    rotations = cspace.Rotations.quaternions(4)
    space = cspace.build(workspace, Robot.ball(0.05), rotations=rotations, outside="free")
    check = space.clearance_checker()
    assert check(5.0, 5.0, 5.0, 0.0, 0.0, 0.0, 1.0) > 1.0
    assert check(5.0, 5.0, 5.0, *rotation) == check(0.01, 0.01, 0.01, *rotation) == 0.0
