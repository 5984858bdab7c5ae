"""Queries of single configurations and of boxes of configurations."""

import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import cspace
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Workspace
from cspace.rotations import Rotations
from cspace.rotations.base import ANGLE_SLACK, MAX_ANGLE, TWO_PI
from tests.helpers import handmade
from tests.helpers.handmade import (
    ALL_FREE,
    Outside,
    free_except,
    map_of,
    outsides,
    state_of,
    states,
)
from tests.helpers.refusals import refusals
from tests.helpers.strategies import (
    L_SHAPE,
    boundary_yaws,
    resolve_yaw,
    rotation_cells,
    seeds,
    uniform,
)

POLICIES = st.sampled_from(["blocked", "free"])


@pytest.fixture(scope="module", params=handmade.MAP_KINDS)
def space(request):
    """Build a wall with a gap, in every space."""
    dim = 3 if "space" in request.param else 2
    occupied = np.zeros((40, 30, 12)[:dim], dtype=bool)
    occupied[18:22, :18] = True
    turns = {
        "turning": 12,
        "turning in space": 12,
        "turning in space any way": Rotations.quaternions(1),
    }
    robot = {
        "plane": Robot.disc(0.3),
        "turning": Robot.polygon(L_SHAPE),
        "space": Robot.box((0.4, 0.3, 0.2)),
        "turning in space": Robot.box((0.6, 0.2, 0.2), (0.1, 0.0, 0.0)),
        "turning in space any way": Robot.box((0.3, 0.2, 0.1)),
    }[request.param]
    workspace = Workspace.from_array(occupied, 0.1, (-1.0, 2.0, -0.5)[:dim])
    return cspace.build(workspace, robot, rotations=turns.get(request.param), counts=True)


def make_configuration(space):
    """Return a configuration in the grid."""
    return [0.0, 3.0, 0.1][: space.grid.dim] + {0: [], 1: [0.7], 4: [0.0, 0.6, 0.0, -0.8]}[
        len(space.rotations.names)
    ]


# ---- types of results ----------------------------------------------------------------------------

QUERIES = ["classify", "is_free", "clearance", "overlap_count", "contains_robot"]


def test_one_configuration_returns_a_python_number(space):
    q = make_configuration(space)
    types = {
        "classify": int,
        "is_free": bool,
        "clearance": float,
        "overlap_count": int,
        "contains_robot": bool,
    }
    assert {name: type(getattr(space, name)(q)) for name in QUERIES} == types
    assert type(space.motion_is_free(q, q)) is bool
    assert type(space.is_free_around(q, 0.1, 0.1)) is bool
    assert type(space.point_checker()(*q)) is bool
    assert type(space.edge_checker()(*q, *q)) is bool


def replace_value(q, axis, value):
    return [*q[:axis], value, *q[axis + 1 :]]


@refusals(
    "change, message",
    (lambda q: replace_value(q, 0, np.nan), "nan"),
    (lambda q: replace_value(q, 1, np.inf), "inf"),
    (lambda q: replace_value(q, len(q) - 1, -np.inf), "-inf"),
    (lambda q: np.ma.array(q, mask=np.arange(len(q)) == 0), "1 masked"),
    (lambda q: q[:-1], "axis must be|shape"),
    (lambda q: [*q, 0.0], "axis must be|shape "),
    (lambda q: 1.0, "axis must be| shape"),
    (lambda q: "home", "numeric|number"),
)
def test_queries_refuse_invalid_configurations(space, change, message):
    q = make_configuration(space)
    wrong = change(q)
    for name in (*QUERIES, "nearest_free"):
        with pytest.raises(InputError, match=message):
            getattr(space, name)(wrong)
    for query in (space.motion_is_free, space.is_connected, space.is_disconnected):
        for endpoints in ((q, wrong), (wrong, q)):
            with pytest.raises(InputError, match=message):
                query(*endpoints)
    with pytest.raises(InputError, match=message):
        space.is_free_around(wrong, 0.1, 0.1)


@pytest.mark.parametrize("far", [1.01 * MAX_ANGLE, -2 * MAX_ANGLE])
def test_queries_refuse_huge_rotations_and_accept_any_position(space, far):
    q = make_configuration(space)
    wrong = replace_value(q, len(q) - 1, far)
    queries = [getattr(space, name) for name in QUERIES]
    queries += [
        lambda q: space.is_free_around(q, 0.1, 0.1),
        lambda wrong: space.motion_is_free(q, wrong),
    ]
    queries += [lambda wrong: space.is_connected(wrong, q)]
    for query in queries:
        if space.rotations.names:
            with pytest.raises(InputError, match=r"yaw at most|norm"):
                query(wrong)
        else:
            query(wrong)


@pytest.mark.parametrize(
    ("distance", "angle"), [(-0.1, 0.0), (0.1, -1e-9), (math.nan, 0.0), (0.0, math.inf)]
)
def test_is_free_around_refuses_invalid_distances_and_angles(space, distance, angle):
    with pytest.raises(InputError):
        space.is_free_around(make_configuration(space), distance, angle)


def test_queries_name_the_invalid_configuration_of_a_batch(space):
    for hole, value in itertools.product(range(space.size), (np.nan, np.inf, -np.inf)):
        q = handmade.configurations(space, np.full((600, space.size), 0.1))
        q[513, hole] = value
        for ask in (space.classify, space.clearance, lambda many: space.is_free_around(many, 0.1)):
            with pytest.raises(InputError, match="number 513"):
                ask(q)
        for endpoints in ((q, q[:1]), (q[:1], q)):
            with pytest.raises(InputError, match="edge number 513"):
                space.motion_is_free(*endpoints)


def test_cell_states_are_read_only(space):
    with pytest.raises(ValueError):
        space.cell_states[(0,) * space.cell_states.ndim] = FREE


def test_states_of_another_shape_are_refused(space):
    states = space._seen
    for other in (
        states[1:],
        states[..., 1:],
        states[None],
        np.concatenate([states, states]),
        states.astype(int),
    ):
        with pytest.raises(InputError, match="map's shape"):
            handmade.map_in(space.workspace, space.robot, other, space.rotations)


def test_states_have_one_slice_for_symmetric_rotation_cells():
    workspace, robot = Workspace.from_array(np.zeros((3, 4), bool), 0.1), Robot.rectangle(0.2, 0.1)
    assert handmade.map_in(
        workspace, robot, np.zeros((4, 3, 4), np.uint8), 8
    ).cell_states.shape == (8, 3, 4)
    for shape in ((3, 4), (8, 3, 4), (4, 4, 3)):
        with pytest.raises(InputError, match="map's shape"):
            handmade.map_in(workspace, robot, np.zeros(shape, np.uint8), 8)


# ---- the state of a cell -------------------------------------------------------------------------


def test_equal_rotations_get_equal_states(space):
    """Add whole turns to yaws; negate quaternions."""
    states = space.cell_states.reshape(-1, *space.grid.shape)
    cells, number = handmade.all_cells(states)[::97], 1 % len(states)
    for wraps in {0: (0,), 1: (-1000, -1, 0, 1, 1000), 4: (1, -1)}[len(space.rotations.names)]:
        q, rotation = handmade.cell_centers(space, cells), space.rotations.centers[number]
        if len(space.rotations.names) == 4:
            q[:, 3:] *= wraps
            rotation = rotation * wraps
        else:
            q[:, space.grid.dim :] += wraps * TWO_PI
            rotation = rotation + wraps * TWO_PI
        assert (space.classify(q) == states[tuple(cells.T)]).all()
        assert (space.states_at(rotation) == states[number]).all()


@settings(max_examples=100)
@given(states(), outsides(3), seeds)
def test_boundary_belongs_to_the_cell_above(state, outside, seed):
    """Use numbers exact in binary."""
    rng, dim = np.random.default_rng(seed), state.ndim
    outside, lower = outside.project(dim), np.array([-1.0, 0.5, 2.0])[:dim]
    space = map_of(state, None, outside, 0.25, tuple(lower.tolist()))
    upper = lower + 0.25 * np.array(state.shape)
    q = lower + rng.uniform(-5, 12, (200, dim)) * 0.25
    q = np.where(rng.random(q.shape) < 0.3, np.rint(q * 4) / 4, q)
    q = np.where(rng.random(q.shape) < 0.1, upper, q)
    cells = np.floor((q - lower) / 0.25).astype(int)
    cells -= q == upper
    assert space.classify(q).tolist() == [
        state_of(state, outside, tuple(cell)) for cell in cells.tolist()
    ]


def test_queries_agree_on_the_rotation_cell_at_far_boundaries():
    """Wrap by many turns, which rounds."""
    cells = Rotations.of(72)
    states = np.arange(72) % 3
    space = map_of(np.broadcast_to(states[:, None, None], (72, 3, 3)), 72)
    boundaries = np.asarray(cells.borders)[:-1]
    for wraps in (-3, 0, 2, 100, 1000, 150_000):
        q = np.column_stack([np.full((72, 2), 0.3), boundaries + wraps * TWO_PI])
        expected = space.classify(q)
        assert (states[cells.cell_of(q[:, 2])] == expected).all()
        assert space.is_connected(q, q).tolist() == [state == FREE for state in expected]
        assert space.is_disconnected(q, q).tolist() == [state == BLOCKED for state in expected]
        assert [space.point_checker()(*one) for one in q.tolist()] == (expected == FREE).tolist()


# ---- the exterior --------------------------------------------------------------------------------


def test_exterior_states_follow_the_policy():
    workspace = Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    blocked = cspace.build(workspace, Robot.disc(0.3))
    free = cspace.build(workspace, Robot.disc(0.3), outside="free")
    assert blocked.classify([(-0.01, 1.0), (50.0, 50.0), (1.0, 3.01)]).tolist() == [BLOCKED] * 3
    assert free.classify([(-0.05, 0.05), (-0.5, 1.0), (50.0, 50.0)]).tolist() == [MIXED, FREE, FREE]


@pytest.mark.parametrize("state", [FREE, MIXED, BLOCKED])
@pytest.mark.parametrize("dim", [2, 3])
def test_far_configurations_have_the_exterior_state(dim, state):
    space = map_of(np.zeros((2,) * dim), outside=Outside.all_of(state, dim))
    assert space.classify(np.diag([1e300, -1e300, 1e30][:dim])).tolist() == [state] * dim


# ---- boxes of configurations ---------------------------------------------------------------------

coordinates = st.one_of(
    st.integers(-2, 7).map(lambda k: k / 4), st.integers(-6, 21).map(lambda k: k / 12)
)
points = st.tuples(*[coordinates | st.floats(-0.5, 1.75)] * 3)


@settings(max_examples=100)
@given(
    states(4, (FREE,) * 15 + (BLOCKED,)),
    outsides(3),
    points,
    st.sampled_from([0.0, 0.125, 0.25, 0.3, 0.5]),
)
@example(free_except(), ALL_FREE, (0.5, 0.5, 0.5), 0.5)
@example(free_except(), Outside.all_of(BLOCKED), (0.5, 0.5, 0.5), 0.5)
@example(free_except((3, 3, 3)), ALL_FREE, (0.5, 0.5, 0.5), 0.25)  # a MIXED cell shares a corner
@example(free_except((0, 1, 1)), ALL_FREE, (0.5, 0.5, 0.5), 0.25)
@example(free_except((3, 3), dim=2), ALL_FREE, (0.5, 0.5, 0.5), 0.25)
def test_is_free_around_tests_all_cells_of_a_cube(state, outside, q, distance):
    q, outside = q[: state.ndim], outside.project(state.ndim)
    low = [4 * (Fraction(value) - Fraction(distance)) for value in q]
    high = [4 * (Fraction(value) + Fraction(distance)) for value in q]

    def meets_cells(slack):
        """Return True if the shrunk cube meets other cells."""
        ranges = [
            range(math.ceil(a - slack) - 1, math.floor(b + slack) + 1)
            for a, b in zip(low, high, strict=True)
        ]
        return any(state_of(state, outside, cell) != FREE for cell in itertools.product(*ranges))

    if map_of(state, outside=outside).is_free_around(q, distance):
        assert not meets_cells(0)
    else:  # the query may refuse a cell within its slack
        assert meets_cells(Fraction(2.0**-24))


def test_is_free_around_accepts_cubes_of_any_size():
    space = map_of(np.zeros((4, 4, 4)), outside=Outside(np.array([-9, -9, -9, -5, -5, -5]), FREE))
    assert space.is_free_around((0.5, 0.5, 0.5), 1.0)
    assert not space.is_free_around((0.5, 0.5, 0.5), 1e5)
    for dim in (2, 3):
        q, state = (0.45,) * dim, np.zeros((4,) * dim)
        assert map_of(state).is_free_around(q, 1e6)
        assert not map_of(state).is_free_around(q, 1e9)  # too far for the certificate
        assert not map_of(state, outside="blocked").is_free_around(q, 1e5)


H, SIDE = 0.25, 4


def meets_box(cell, borders, q, distance, angle, slack=0.0):
    """Return True if a cell meets the box around q."""
    if not all(
        H * n - distance - slack <= v <= H * (n + 1) + distance + slack
        for n, v in zip(cell[1:], q, strict=False)
    ):
        return False
    low, high = borders[cell[0]] - angle - slack, borders[cell[0] + 1] + angle + slack
    return any(low <= q[-1] + wraps * TWO_PI <= high for wraps in range(-5, 6))


@settings(max_examples=60)
@given(
    rotation_cells(8),
    st.tuples(
        uniform(0, 1),
        uniform(0, 1) | st.integers(0, 8).map(lambda k: k / 8),
        uniform(-7, 7) | boundary_yaws,
    ),
    st.sampled_from([0.0, 0.05, 0.125, 0.25, 0.6]),
    st.one_of(uniform(0, 3), st.sampled_from([0.0, 0.1, 2.0, math.pi, 9.0])),
    st.sampled_from([(SIDE, SIDE), (2, 3, 3)]),
)
def test_is_free_around_tests_exactly_the_cells_of_a_box(rotations, end, distance, angle, shape):
    """Block all cells outside the box, then each inside."""
    boundaries = Rotations.of(rotations).borders
    x, y, yaw = end
    yaw = resolve_yaw(yaw, boundaries)
    q = (x, y, yaw) if len(shape) == 2 else (0.5 * x, 0.75 * y, 0.3, yaw)
    state = np.full((len(boundaries) - 1, *shape), MIXED, dtype=np.uint8)
    cells = list(np.ndindex(state.shape))
    for cell in cells:
        if meets_box(cell, boundaries, q, distance, angle, slack=1e-8):
            state[cell] = FREE
    assert map_of(state, rotations, spacing=H).is_free_around(q, distance, angle)
    inside = [cell for cell in cells if meets_box(cell, boundaries, q, distance, angle)]
    for cell in {inside[0], inside[-1], *inside[:: 1 + len(inside) // 8]} if inside else ():
        one = np.full_like(state, FREE)
        one[cell] = MIXED
        assert not map_of(one, rotations, spacing=H).is_free_around(q, distance, angle)


def test_is_free_around_is_safe_at_far_boundaries():
    space = map_of(
        np.where(np.arange(63) == 40, MIXED, FREE)[:, None, None] * np.ones((1, 3, 3)), 63
    )
    boundaries, closed = np.asarray(space.rotations.borders), space.rotations.centers[:, 0][40]
    angle = 1.0
    for wraps in (2, 10, 1000):
        yaw = boundaries + wraps * TWO_PI + angle + ANGLE_SLACK
        for nudged in (yaw, np.nextafter(yaw, 0.0), np.nextafter(yaw, 1e9)):
            near = np.abs((nudged - closed + math.pi) % TWO_PI - math.pi) < angle
            q = np.column_stack([np.full((64, 2), 0.3), nudged])
            assert not space.is_free_around(q, 0.0, angle)[near].any()


# ---- robots inside obstacles ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "robot", "rotations", "answers"),
    [
        ((12, 12), Robot.rectangle(0.6, 0.6), None, {(0.65, 0.65): True, (0.25, 0.65): False}),
        (
            (12, 6),
            Robot.rectangle(0.6, 0.1),
            36,
            {(0.6, 0.3, 0.0): True, (0.6, 0.3, math.pi): True, (0.6, 0.3, math.pi / 2): False},
        ),
    ],
)
def test_contains_robot_is_true_where_the_robot_fits(shape, robot, rotations, answers):
    occupied = np.pad(np.ones(np.subtract(shape, 2), dtype=bool), 1)
    space = cspace.build(
        Workspace.from_array(occupied, 0.1), robot, rotations=rotations, outside="free"
    )
    assert space.contains_robot(list(answers)).tolist() == list(answers.values())


# ---- threads -------------------------------------------------------------------------------------


@pytest.mark.parametrize("rotations", [None, 10])
def test_queries_from_many_threads_agree(rotations):
    rng = np.random.default_rng(5)
    occupied = rng.random((300, 300) if rotations is None else (80, 80)) < 0.01
    q = rng.uniform(-1, 16 if rotations is None else 5, (24, 1000, 2 if rotations is None else 3))

    def build():
        return cspace.build(
            Workspace.from_array(occupied, 0.05), Robot.polygon(L_SHAPE), rotations=rotations
        )

    def ask(space, points):
        a, b = points[1:], points[:-1]
        one = (
            space.classify(points),
            space.clearance(points),
            space.overlap_count(points),
            space.contains_robot(points),
        )
        return (
            *one,
            space.motion_is_free(a, b),
            space.is_connected(a, b),
            space.is_free_around(a, 0.1, 0.2),
        )

    space, fresh = build(), build()
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda points: ask(space, points), q))
    for points, answers in zip(q, together, strict=True):
        assert all(
            (mine == theirs).all() for mine, theirs in zip(answers, ask(fresh, points), strict=True)
        )
