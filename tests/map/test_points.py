"""Look-ups of one cell: kinds of answers, borders, the outside, overlaps, containment, threads."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
import oracles
from checks import collides, draw_configurations, obstacles_of
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Workspace
from strategies import bitmaps, robots, seeds


@pytest.fixture(scope="module")
def space():
    occupied = np.zeros((50, 40), dtype=bool)
    occupied[20:24, :30] = True
    return cspace.build(Workspace.from_array(occupied, 0.1, (-1.0, 2.0)), Robot.disc(0.3), overlap=True)


LOOKUPS = ["classify", "is_free", "clearance", "overlap", "contains_robot"]


@pytest.mark.parametrize("name", LOOKUPS)
@pytest.mark.parametrize("batch", [(0,), (1,), (7,), (2, 3), (2, 1, 3)])
def test_batches_answer_in_kind(space, name, batch):
    look_up = getattr(space, name)
    q = np.random.default_rng(0).uniform(-2, 8, (*batch, 2))
    answers = look_up(q)
    assert isinstance(answers, np.ndarray) and answers.shape == batch
    single = [look_up(point) for point in q.reshape(-1, 2)]
    assert answers.ravel().tolist() == single
    assert look_up(q.tolist()).tolist() == answers.tolist() if answers.size else True


def test_one_configuration_gets_a_python_number(space):
    q = (0.0, 3.0)
    assert type(space.classify(q)) is int
    assert type(space.is_free(q)) is bool
    assert type(space.clearance(q)) is float
    assert type(space.overlap(q)) is int
    assert type(space.contains_robot(q)) is bool
    assert type(space.motion_is_free(q, q)) is bool


@pytest.mark.parametrize("name", LOOKUPS)
@pytest.mark.parametrize(
    ("q", "words"),
    [
        ((np.nan, 0.0), "nan"),
        ([(0.0, 3.0), (0.0, np.inf)], "number 1 is"),
        ((1.0, 2.0, 3.0), "last axis must be 2"),
        (1.0, "last axis must be 2"),
        ("home", "numeric"),
    ],
)
def test_refuses(space, name, q, words):
    with pytest.raises(InputError, match=words):
        getattr(space, name)(q)


def test_classify_is_the_state_of_the_cell(space):
    rng = np.random.default_rng(1)
    q = draw_configurations(space, rng, 5000)
    q = q[space.grid.contains(q)]
    assert (space.classify(q) == space.state[tuple(space.grid.cell_of(q).T)]).all()
    check = space.point_checker()
    assert [check(x, y) for x, y in q.tolist()] == space.is_free(q).tolist()


def test_quick_checkers_agree_with_look_ups_everywhere(space):
    rng = np.random.default_rng(2)
    q0, q1 = draw_configurations(space, rng, 500), draw_configurations(space, rng, 500)
    q0[:4] = [space.grid.lower, space.grid.upper, (space.grid.lower[0], space.grid.upper[1]), (1e30, -1e30)]
    point, edge, clear = space.point_checker(), space.edge_checker(), space.clearance_checker()
    assert [point(x, y) for x, y in q0.tolist()] == space.is_free(q0).tolist()
    assert [clear(x, y) for x, y in q0.tolist()] == space.clearance(q0).tolist()
    ends = np.hstack([q0, q1]).tolist()
    assert [edge(*end) for end in ends] == space.motion_is_free(q0, q1).tolist()


def test_state_is_read_only(space):
    with pytest.raises(ValueError, match="read-only"):
        space.state[0, 0] = FREE


@settings(max_examples=25)
@given(bitmaps(10), robots(0.25), st.sampled_from(["blocked", "free"]))
def test_overlap_is_the_stored_count_and_the_sum(occupied, robot, outside):
    space = cspace.build(Workspace.from_array(occupied, 0.15), robot, outside=outside, overlap=True)
    cells = np.argwhere(np.ones_like(occupied))
    counts = space.overlap(space.grid.center_of(cells))
    assert (counts == space.overlaps[tuple(cells.T)]).all()
    offsets = oracles.raster_offsets(robot.rasters(0.15)[0])
    expected = oracles.overlap(occupied, offsets, outside == "blocked")
    assert counts.tolist() == [expected[tuple(cell)] for cell in cells.tolist()]


@settings(max_examples=25)
@given(robots(0.3), seeds, st.sampled_from(["blocked", "free"]))
def test_contains_robot_is_proven(robot, seed, outside):
    rng = np.random.default_rng(seed)
    occupied = np.zeros((30, 30), dtype=bool)
    for x, y in rng.integers(0, 18, (3, 2)):
        occupied[x : x + 12, y : y + 12] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), robot, outside=outside)
    q = draw_configurations(space, rng, 300)
    inside = space.contains_robot(q)
    room = obstacles_of(space).buffer(1e-9)
    placed = [shapely.transform(robot.geometry, lambda points, p=p: points + p) for p in q]
    assert shapely.covers(room, np.asarray(placed)[inside]).all()


def test_contains_robot_finds_the_fit():
    occupied = np.zeros((12, 12), dtype=bool)
    occupied[1:11, 1:11] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.6, 0.6), outside="free")
    assert space.contains_robot((0.65, 0.65))
    assert not space.contains_robot((0.25, 0.65))


@settings(max_examples=40)
@given(robots(0.5), seeds, st.sampled_from(["blocked", "free"]))
def test_the_outside_is_proven_too(robot, seed, outside):
    """FREE and BLOCKED hold for the geometry outside the grid too, also with the reference point off the robot."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((12, 9)) < 0.2
    space = cspace.build(Workspace.from_array(occupied, 0.2), robot, outside=outside)
    q = rng.uniform(-3, 5, (400, 2))
    q = q[~space.grid.contains(q)]
    states = space.classify(q)
    assert not (collides(space, q, -1e-9) & (states == FREE)).any()
    assert not (~collides(space, q, 1e-9) & (states == BLOCKED)).any()


def test_the_outside_follows_the_policy():
    workspace = Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    blocked = cspace.build(workspace, Robot.disc(0.3))
    free = cspace.build(workspace, Robot.disc(0.3), outside="free")
    assert blocked.classify([(-0.01, 1.0), (50.0, 50.0), (1.0, 3.01)]).tolist() == [BLOCKED] * 3
    assert free.classify([(-0.05, 0.05), (-0.5, 1.0), (50.0, 50.0)]).tolist() == [MIXED, FREE, FREE]


def test_look_ups_from_many_threads_agree():
    rng = np.random.default_rng(5)
    occupied = rng.random((300, 300)) < 0.01
    q = rng.uniform(0, 15, (40, 3000, 2))

    def ask(space, points):
        return (
            space.classify(points),
            space.clearance(points),
            space.overlap(points),
            space.motion_is_free(points[1:], points[:-1]),
            space.path_exists(points[1:], points[:-1]),
        )

    space = cspace.build(Workspace.from_array(occupied, 0.05), Robot.disc(0.2))
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda points: ask(space, points), q))
    fresh = cspace.build(Workspace.from_array(occupied, 0.05), Robot.disc(0.2))
    for points, answers in zip(q, together, strict=True):
        for mine, theirs in zip(answers, ask(fresh, points), strict=True):
            assert (mine == theirs).all()


def test_masked_configurations_are_refused(space):
    with pytest.raises(InputError, match="1 masked"):
        space.classify(np.ma.array([(0.0, 3.0)], mask=[(True, False)]))


def test_quick_edges_never_pass_nan():
    free = cspace.build(Workspace.from_array(np.zeros((3, 3), bool), 0.1), Robot.disc(0.1), outside="free")
    check = free.edge_checker()
    for hole in range(4):
        ends = [0.1, 0.1, 0.2, 0.2]
        ends[hole] = float("nan")
        assert not check(*ends)


def test_refuses_states_that_are_none(space):
    with pytest.raises(InputError, match="state holds 3"):
        cspace.CSpace(
            space.workspace, space.robot, np.full_like(space.state, 3), outside="free", margin=0.0, precision="float32"
        )


def test_refuses_a_state_that_does_not_fit(space):
    with pytest.raises(InputError, match="map's shape"):
        cspace.CSpace(space.workspace, space.robot, space.state[1:], outside="free", margin=0.0, precision="float32")


def test_squares_of_any_size_are_quick():
    free = cspace.build(Workspace.from_array(np.zeros((3, 3), bool), 0.1), Robot.disc(0.1), outside="free")
    assert free.is_free_around((0.1, 0.1), 1e6)
    assert not free.is_free_around((0.1, 0.1), 1e9)  # too far for the certificate
    walled = cspace.build(Workspace.from_array(np.zeros((9, 9), bool), 0.1), Robot.disc(0.1))
    assert not walled.is_free_around((0.45, 0.45), 1e5)
