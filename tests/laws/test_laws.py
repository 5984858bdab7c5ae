"""Laws that hold for maps of every space, however they are kept."""

import itertools

import numpy as np
import pytest
from hypothesis import given

import cspace
from cspace import FREE, MIXED
from tests.helpers.any_map import (
    ALL_KINDS,
    LONG_INPUTS,
    build_kind,
    build_map,
    build_of,
    draw_free_pairs,
)
from tests.helpers.handmade import components
from tests.helpers.maps import proven_paths
from tests.helpers.placements import draw_configurations, is_free_around, move
from tests.helpers.strategies import examples, few, seeds

BATCH_QUERIES = {
    "classify": (1, ()),
    "is_free": (1, ()),
    "clearance": (1, ()),
    "obstacle_distance": (1, ()),
    "overlap_count": (1, ()),
    "contains_robot": (1, ()),
    "motion_is_free": (2, ()),
    "is_connected": (2, ()),
    "is_disconnected": (2, ()),
}
"""Queries of configurations: their number of configurations and further arguments."""

IN_MEMORY = [kind for kind in ALL_KINDS if kind[1] != "tiled"]
NUDGE = 1e-10
"""Distance in metres and radians within the slack of motions."""


@pytest.fixture(scope="module", params=[*ALL_KINDS, ("floor", "saved")], ids="-".join)
def any_map(request, tmp_path_factory):
    """Build a map that tests share and none changes."""
    return build_kind(request.param, tmp_path_factory.mktemp("any"))


def queries_of(any_map):
    """Yield the queries of a map: name, number of configurations, further arguments."""
    for name, (count, options) in BATCH_QUERIES.items():
        counts = name in ("overlap_count", "contains_robot")
        if hasattr(type(any_map.space), name) and not (counts and any_map.on_floor):
            yield name, count, options


def draw_near(any_map, q, rng):
    """Draw configurations a few cells away, rotated by up to a radian."""
    return move(any_map.memory, q, *any_map.draw_moves(rng, len(q)))


def label(any_map, worst):
    """Label the components of cells whose state is at most ``worst``, by scipy."""
    kind = "any way" if len(any_map.space.rotations.names) == 4 else ""
    return components(any_map.states <= worst, kind)


# ---- proofs --------------------------------------------------------------------------------------


@examples(3)
@given(seeds)
def test_no_query_proves_free_what_touches_an_obstacle(any_map, seed):
    rng, space = np.random.default_rng(seed), any_map.space
    q = any_map.draw_contacts(rng, 400)
    assert not space.is_free(q).any()
    assert not space.clearance(q[:50]).any()
    near = draw_near(any_map, q, rng)
    assert not space.motion_is_free(q, near).any() and not space.motion_is_free(near, q).any()
    assert not space.is_connected(q[:50], near[:50]).any()
    # The contact is halfway along a motion.
    steps, turns = any_map.draw_moves(rng, len(q))
    start = move(any_map.memory, q, -steps, -turns)
    assert not space.motion_is_free(start, move(any_map.memory, q, steps, turns)).any()
    # The contact is in the corner of a box.
    around = move(
        any_map.memory, q, np.where(rng.random(steps.shape) < 0.5, -0.03, 0.03), 0.0 * turns
    )
    assert not is_free_around(space, around, 0.03 + NUDGE).any()


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # the ball is far from its origin
@pytest.mark.parametrize("inputs", LONG_INPUTS.values(), ids=LONG_INPUTS)
def test_no_turn_of_a_long_robot_in_a_free_cell_touches_an_obstacle(inputs, tmp_path):
    long_map = build_of(inputs, "memory", "free", 0, tmp_path)
    occupied = np.zeros_like(long_map.occupied)
    occupied[tuple(n // 2 for n in occupied.shape)] = True
    space = long_map.rebuild(occupied)
    q = long_map._replace(occupied=occupied).draw_contacts(np.random.default_rng(0), 20_000)
    assert space.grid.contains(q[:, : long_map.dim]).mean() > 0.9
    assert not space.is_free(q).any()


@examples(3)
@given(seeds)
def test_everything_within_the_slack_of_a_free_motion_is_free(any_map, seed):
    # Many motions lead along borders of cells, or leave the grid.
    rng, space = np.random.default_rng(seed), any_map.space
    q = draw_configurations(any_map.memory, rng, 500)
    steps, turns = any_map.draw_moves(rng, len(q))
    is_free = space.motion_is_free(q, move(any_map.memory, q, steps, turns))
    assert is_free.any() and not is_free.all()
    q, steps, turns = q[is_free], steps[is_free], turns[is_free]
    grid, dim = space.grid, any_map.dim
    stays = grid.contains(q[:, :dim]) & grid.contains(
        move(any_map.memory, q, steps, turns)[:, :dim]
    )
    for share in np.linspace(0.0, 1.0, 15):
        nudges = rng.choice([-NUDGE, 0.0, NUDGE], (2, len(q), 3))
        if space.size == 7:  # borders of quaternion cells belong to one of them
            nudges[1] = 0.0
        nudged_steps = share * steps + nudges[0][:, :dim]
        between = move(any_map.memory, q, nudged_steps, share * turns + nudges[1])
        # A motion on the border of the grid touches no cell outside.
        between[stays, :dim] = np.clip(between[stays, :dim], grid.lower, grid.upper)
        assert space.is_free(between).all()


@examples(3)
@given(seeds)
def test_everything_within_the_clearance_is_free(any_map, seed):
    rng, space = np.random.default_rng(seed), any_map.space
    q = draw_configurations(any_map.memory, rng, 400)
    clearance = np.minimum(space.clearance(q), 3.0)
    assert (clearance > 0.0).any()
    course = rng.normal(size=(len(q), any_map.dim))
    course /= np.linalg.norm(course, axis=1, keepdims=True)
    moved = move(
        any_map.memory, q, 0.999999 * clearance[:, np.newaxis] * course, np.zeros((len(q), 3))
    )
    assert space.is_free(moved[clearance > 0.0]).all()


# ---- storages ------------------------------------------------------------------------------------


def test_classify_and_count_return_the_states_of_the_cells(any_map):
    q, cells = any_map.draw_inside(np.random.default_rng(0), 400)
    np.testing.assert_array_equal(any_map.space.classify(q), any_map.states[tuple(cells.T)])
    assert any_map.space.count() == tuple(np.bincount(any_map.states.ravel(), minlength=3).tolist())
    assert not any_map.memory.cell_states.flags.writeable


def test_equal_rotations_get_equal_states(any_map):
    rng = np.random.default_rng(16)
    q = draw_configurations(any_map.memory, rng, 300)
    same = q.copy()
    if len(any_map.space.rotations.names) == 4:
        same[:, 3:] *= -1.0
    else:
        q[:, any_map.dim :] = rng.uniform(-3.0, 3.0, (300, q.shape[1] - any_map.dim))
        same = q.copy()
        same[:, any_map.dim :] += 2.0 * np.pi * rng.choice([-1000, -1, 1, 1000])
    np.testing.assert_array_equal(any_map.space.classify(same), any_map.space.classify(q))


@pytest.mark.parametrize(
    "space, outside",
    few([("plane", "free"), ("quaternions", "free"), ("yaw in space", "blocked")], 2),
)
def test_queries_of_a_window_equal_those_of_the_whole_map(space, outside, tmp_path):
    # Configurations outside of a window are MIXED, and fewer connections are decided.
    whole = build_map(space, "tiled", outside, 8, tmp_path, thin=outside == "free")
    tiled, memory, grid, rng = whole.space, whole.memory, whole.space.grid, np.random.default_rng(9)
    dim, size = whole.dim, np.subtract(grid.upper, grid.lower)
    for low, high in ((0.2, 0.7), (0.0, 1.3)):
        lower, upper = grid.lower + low * size, grid.lower + high * size
        window = tiled.window(lower, upper)
        is_whole = window.grid.contains([grid.lower, grid.upper]).all()
        assert window.outside == (outside if is_whole else "unknown")
        # A motion on the border of the map touches cells beyond it, which only the window has.
        lower, upper = lower + 0.0137, np.minimum(upper, grid.upper) - 0.0137
        q, _ = whole.draw_inside(rng, 300)
        q[:, :dim] = rng.uniform(lower, upper, (300, dim))
        near = draw_near(whole, q, rng)
        near[:, :dim] = np.clip(near[:, :dim], lower, upper)
        for name in ("classify", "overlap_count", "contains_robot"):
            np.testing.assert_array_equal(getattr(window, name)(q), getattr(memory, name)(q), name)
        np.testing.assert_array_equal(window.motion_is_free(q, near), tiled.motion_is_free(q, near))
        mine = proven_paths(window, q[:40], near[:40])
        theirs = proven_paths(tiled, q[:40], near[:40])
        assert all(a is None or a == b for a, b in zip(mine, theirs, strict=True))
        q[:, :dim] = rng.uniform(grid.lower - 9 * size, grid.upper + 9 * size, (300, dim))
        q = q[~window.grid.contains(q[:, :dim])]
        assert is_whole or (window.classify(q) == MIXED).all()
        assert is_whole or not window.motion_is_free(q, near[: len(q)]).any()


def label_configurations(any_map, q):
    """Return the component of the FREE cell of each configuration, by scipy."""
    space = any_map.space
    positions, rotations = np.split(q, [any_map.dim], axis=1)
    turns = space.rotations.cell_of(rotations if rotations.shape[1] > 1 else rotations.ravel())
    turns = np.broadcast_to(turns, len(q)) if space.rotations.names else np.zeros(len(q), int)
    return label(any_map, FREE)[turns, *space.grid.cell_of(positions).T]


@examples(3)
@given(seeds)
def test_configurations_that_only_free_cells_touch_are_connected_by_them(any_map, seed):
    rng, space = np.random.default_rng(seed), any_map.space
    firsts, lasts = draw_free_pairs(any_map, rng)
    touch_only_free = space.motion_is_free(firsts, firsts) & space.motion_is_free(lasts, lasts)
    numbers = label_configurations(any_map, np.concatenate([firsts, lasts])).reshape(2, -1)
    connected = space.is_connected(firsts, lasts)
    np.testing.assert_array_equal(connected, touch_only_free & (numbers[0] == numbers[1]))
    for first, last, is_connected in zip(firsts, lasts, connected, strict=True):
        assert space.is_connected(tuple(first), tuple(last)) == is_connected


@pytest.mark.parametrize("name", few(["plane", "quaternions"]))
def test_tile_subproblems_are_connected_within_their_tiles(name, tmp_path):
    whole = build_map(name, "tiled", "free", 8, tmp_path)
    space = whole.space
    space.compute_components()
    q, _ = whole.draw_inside(np.random.default_rng(13), 40)
    joined = [pair for pair in itertools.pairwise(q) if space.is_connected(*pair)][:4]
    assert joined
    for q0, q1 in joined:
        subproblems = space.subproblems(q0, q1)
        np.testing.assert_allclose(subproblems[0][1][: whole.dim], q0[: whole.dim])
        np.testing.assert_allclose(subproblems[-1][2][: whole.dim], q1[: whole.dim])
        for open_tile, start, goal in subproblems:
            assert open_tile().is_connected(start, goal)
        for before, after in itertools.pairwise(subproblems):
            np.testing.assert_array_equal(before[2], after[1])


@pytest.mark.parametrize(
    "any_map", [kind for kind in ALL_KINDS if "yaw" in kind[0]], indirect=True, ids="-".join
)
def test_returned_yaws_lie_from_minus_pi_to_below_pi(any_map):
    # OMPL's bounds require this range. Endpoints are turned further by whole turns.
    rng, space, memory = np.random.default_rng(17), any_map.space, any_map.memory
    samples = memory.sample_free(60, rng)
    ends = samples + 2.0 * np.pi * rng.integers(-3, 4, (60, 1)) * (
        np.arange(memory.size) >= any_map.dim
    )
    yaws = [samples, space.rotations.centers, memory.slice_rotations]
    yaws += [space.nearest_free(q)[np.newaxis] for q in ends[:20]]
    for q0, q1 in itertools.pairwise(ends):
        if isinstance(space, cspace.TiledCSpace) and space.is_connected(q0, q1):
            yaws += [np.array(part[1:]) for part in space.subproblems(q0, q1)]
    returned = np.concatenate([rows[..., -1].ravel() for rows in yaws if len(rows)])
    assert (returned >= -np.pi).all() and (returned < np.pi).all()


# ---- batches -------------------------------------------------------------------------------------


def test_a_batch_equals_single_queries(any_map):
    rng = np.random.default_rng(10)
    q = draw_configurations(any_map.memory, rng, 24)
    near = draw_near(any_map, q, rng)
    for name, count, options in queries_of(any_map):
        query, given = getattr(any_map.space, name), [q, near][:count]
        answers = query(*given, *options)
        # A batch may read another window than one of its rows, whose distances round differently.
        is_rounded = name == "clearance" and isinstance(any_map.space, cspace.TiledCSpace)
        rounding = 1e-12 if is_rounded else 0.0
        for rows in (given, [part.tolist() for part in given]):
            singles = [query(*map(tuple, row), *options) for row in zip(*rows, strict=True)]
            np.testing.assert_allclose(answers, singles, rtol=0.0, atol=rounding, err_msg=name)
        shaped = query(*(part.reshape(2, 3, 4, -1) for part in given), *options)
        assert shaped.shape == (2, 3, 4)
        np.testing.assert_array_equal(shaped.ravel(), answers, name)
        assert query(*(part[:0] for part in given), *options).shape == (0,)
