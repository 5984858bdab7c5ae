"""Maps of robots that turn: proofs against geometry, counts against the definition, look-ups in kind."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
import oracles
from checks import draw_turned, obstacles_of, stack_of, turned, turned_collides
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Workspace
from cspace.rotations import MAX_YAW, STILL, TURN, Rotations
from strategies import robots, rotation_cells, seeds

policies = st.sampled_from(["blocked", "free"])
L_SHAPE = [(-0.1, -0.1), (0.6, -0.1), (0.6, 0.1), (0.1, 0.1), (0.1, 0.4), (-0.1, 0.4)]


@pytest.fixture(scope="module")
def space():
    occupied = np.zeros((40, 30), dtype=bool)
    occupied[18:22, :18] = True
    return cspace.build(
        Workspace.from_array(occupied, 0.1, (-1.0, 2.0)), Robot.polygon(L_SHAPE), rotations=12, overlap=True
    )


def prove(space, q, obstacles=None):
    """FREE keeps the margin, BLOCKED collides."""
    states = space.classify(q)
    free, blocked = q[states == FREE], q[states == BLOCKED]
    assert not turned_collides(space, free, space.margin - 1e-9 if space.margin else 0.0, obstacles).any()
    assert turned_collides(space, blocked, 1e-9, obstacles).all()
    return states


# ---- the certificate -------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(robots(0.5), rotation_cells(16), seeds, policies, st.sampled_from([0.0, 0.0, 0.06]))
def test_free_and_blocked_are_proven_in_and_beyond_the_grid(robot, rotations, seed, outside, margin):
    rng = np.random.default_rng(seed)
    occupied = rng.random((14, 11)) < rng.choice([0.02, 0.15])
    workspace = Workspace.from_array(occupied, 0.2, rng.uniform(-1, 1, 2))
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside, margin=margin)
    q = draw_turned(space, rng, 100)
    q[70:, :2] = rng.uniform(-4, 6, (30, 2))
    prove(space, q)


@settings(max_examples=30)
@given(robots(0.5), rotation_cells(16), seeds)
def test_corners_and_borders_belong_to_every_cell_that_touches_them(robot, rotations, seed):
    """Claims of the cells themselves, whatever the look-up says on a border that two of them share."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((14, 11)) < 0.1
    space = cspace.build(Workspace.from_array(occupied, 0.2), robot, rotations=rotations, outside="free")
    borders, obstacles = np.asarray(space.rotations.borders), obstacles_of(space)
    for state, tolerance in ((FREE, 0.0), (BLOCKED, 1e-9)):
        cells = np.argwhere(space.state == state)
        if not len(cells):
            continue
        cells = cells[rng.integers(0, len(cells), 60)]
        ends = rng.integers(0, 2, cells.shape)
        q = np.column_stack([0.2 * (cells + ends)[:, 1:], borders[cells[:, 0] + ends[:, 0]]])
        assert (turned_collides(space, q, tolerance, obstacles) == (state == BLOCKED)).all()


@settings(max_examples=20)
@given(robots(0.4), st.sampled_from([1, 5, 8, 16]), seeds)
def test_polygons_are_proven_as_they_are(robot, rotations, seed):
    rng = np.random.default_rng(seed)
    shapes = [shapely.Point(*rng.uniform(0, 3, 2)).buffer(rng.uniform(0.02, 0.5), quad_segs=2) for _ in range(4)]
    line, frame = shapely.LineString(rng.uniform(0, 3, (2, 2))), shapely.box(0, 0, 3, 3)
    workspace = Workspace.from_polygons([*shapes, line], 0.1, (0, 0, 3, 3))
    assert (workspace.inner != workspace.outer).any()
    space = cspace.build(workspace, robot, rotations=rotations, outside="free")
    prove(space, draw_turned(space, rng, 150), shapely.union_all([*shapes, line]).intersection(frame))


@settings(max_examples=15)
@given(robots(0.4), st.sampled_from([1, 3, 4, 6]), seeds, policies, st.booleans())
def test_states_and_overlaps_are_those_of_the_definition(robot, count, seed, outside, inner):
    """Every slice against a sum in pure Python over the rasters of its yaw."""
    occupied = np.random.default_rng(seed).random((9, 7)) < 0.15
    options = {"outside": outside, "margin": 0.03, "inner": inner, "overlap": True}
    space = cspace.build(Workspace.from_array(occupied, 0.2), robot, rotations=count, **options)
    cells = np.argwhere(np.ones_like(occupied))
    for k, turn in enumerate(space.rotations.turns(2)):
        turn = STILL if robot.symmetry == 0 else turn
        rasters = [oracles.raster_offsets(one) for one in robot.rasters(0.2, 0.03, turn)]
        meets, lies = (oracles.overlap(occupied, offsets, outside == "blocked") for offsets in rasters)
        for cell in map(tuple, cells.tolist()):
            expected = FREE if not meets[cell] else BLOCKED if inner and lies[cell] else MIXED
            assert space.state[(k, *cell)] == expected
            assert space.overlaps[(space._map.slice_of[k], *cell)] == meets[cell]
        q = np.column_stack([space.grid.center_of(cells), np.full(len(cells), space.rotations.representatives[k])])
        assert space.overlap(q).tolist() == [meets[tuple(cell)] for cell in cells.tolist()]


def test_polygon_workspaces_take_either_path_of_the_engine():
    shapes = [shapely.box(1.03, 0.51, 1.48, 1.52), shapely.Point(0.6, 1.4).buffer(0.21)]
    workspace = Workspace.from_polygons(shapes, 0.1, (0, 0, 2, 2))
    robot = Robot.rectangle(0.4, 0.2, (0.1, 0.0))
    plain = cspace.build(workspace, robot, rotations=11)
    counted = cspace.build(workspace, robot, rotations=11, overlap=True)
    outer = cspace.build(workspace, robot, rotations=11, inner=False)
    assert (plain.state == counted.state).all()
    assert {FREE, MIXED, BLOCKED} == set(np.unique(plain.state).tolist())
    assert ((outer.state == FREE) == (plain.state == FREE)).all() and not (outer.state == BLOCKED).any()
    assert ((counted.overlaps == 0) == (counted.state == FREE)).all()


# ---- laws ------------------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(robots(0.4), st.sampled_from([4, 8, 12]), seeds)
def test_a_quarter_turn_of_the_world_is_a_quarter_turn_of_the_map(robot, count, seed):
    occupied = np.random.default_rng(seed).random((9, 12)) < 0.1
    state = cspace.build(Workspace.from_array(occupied, 0.2), robot, rotations=count).state
    # (x, y) goes to (-y, x): entry [x, y] of the turned bitmap is entry [y, -x] of the bitmap.
    world = Workspace.from_array(np.ascontiguousarray(occupied.T[::-1]), 0.2)
    assert (cspace.build(world, robot, rotations=count).state == np.roll(state, count // 4, 0).mT[:, ::-1]).all()


@settings(max_examples=20)
@given(robots(0.4), seeds, policies)
def test_obstacles_together_leave_free_what_each_leaves_free(robot, seed, outside):
    first, second = np.random.default_rng(seed).random((2, 12, 9)) < 0.05
    parts = [
        cspace.build(Workspace.from_array(part, 0.2), robot, rotations=5, outside=outside).state
        for part in (first, second, first | second)
    ]
    assert ((parts[2] == FREE) == ((parts[0] == FREE) & (parts[1] == FREE))).all()
    assert ((parts[2] == BLOCKED) == ((parts[0] == BLOCKED) | (parts[1] == BLOCKED))).all()


@pytest.mark.parametrize("count", [2, 3, 5, 9, 17, 34])
@pytest.mark.parametrize("size", [0.3, 1.0, 4.0])
def test_slices_made_together_are_each_their_own(count, size):
    """However many share a transform: counts against sums of the rasters' rows, states against a map of each alone."""
    occupied = np.random.default_rng(4).random((60, 50)) < 0.02
    workspace, robot = Workspace.from_array(occupied, 0.1), Robot.polygon(size * np.array(L_SHAPE))
    space = cspace.build(workspace, robot, rotations=count, method="fft")
    counted = cspace.build(workspace, robot, rotations=count, overlap=True)
    assert {space.precision, counted.precision} <= {"float32", "float64"}
    assert len(space._map.states) == count and (counted.state == space.state).all()
    cells = np.argwhere(np.ones(occupied.shape, dtype=bool))
    borders = np.asarray(space.rotations.borders)
    for k in {0, 1, count // 2, count - 1}:
        yaw = np.full(len(cells), space.rotations.representatives[k])
        q = np.column_stack([space.grid.center_of(cells), yaw])
        assert (counted.overlap(q) == counted.overlaps[k].ravel()).all()
        others = np.append(borders[k : k + 2], borders[k] + TURN)  # this cell, and all others as one
        assert (cspace.build(workspace, robot, rotations=others).state[0] == space.state[k]).all()


@pytest.mark.parametrize("count", [2, 5, 17])
@pytest.mark.parametrize("overlap", [False, True])
def test_progress_ends_with_all_steps_done(count, overlap):
    workspace = Workspace.from_array(np.random.default_rng(4).random((60, 50)) < 0.02, 0.1)
    told = []
    options = {"overlap": overlap, "progress": lambda *step: told.append(step)}
    cspace.build(workspace, Robot.polygon(L_SHAPE), rotations=count, **options)
    done, steps = np.array(told).T
    assert (np.diff(done) >= 0).all() and done[-1] == steps[-1] and len(set(steps.tolist())) == 1


def test_a_build_can_be_broken_off():
    workspace = Workspace.from_array(np.zeros((40, 40), dtype=bool), 0.1)

    def stop(done, steps):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cspace.build(workspace, Robot.polygon(L_SHAPE), rotations=36, progress=stop)


# ---- look-ups --------------------------------------------------------------------------------------------------------

LOOKUPS = ["classify", "is_free", "clearance", "overlap", "contains_robot"]


@pytest.mark.parametrize("name", LOOKUPS)
@pytest.mark.parametrize("batch", [(0,), (1,), (7,), (2, 3), (2, 1, 3)])
def test_batches_answer_in_kind(space, name, batch):
    look_up = getattr(space, name)
    q = np.random.default_rng(0).uniform(-4, 6, (*batch, 3))
    answers = look_up(q)
    assert isinstance(answers, np.ndarray) and answers.shape == batch
    assert answers.ravel().tolist() == [look_up(point) for point in q.reshape(-1, 3)]


def test_one_configuration_gets_a_python_number(space):
    q = (0.0, 3.0, 1.0)
    kinds = {"classify": int, "is_free": bool, "clearance": float, "overlap": int, "contains_robot": bool}
    assert {name: type(getattr(space, name)(q)) for name in LOOKUPS} == kinds
    assert type(space.motion_is_free(q, q)) is bool
    assert type(space.is_free_around(q, 0.1, 0.1)) is bool
    assert space.dof == 3


@pytest.mark.parametrize("name", [*LOOKUPS, "nearest_free"])
@pytest.mark.parametrize(
    ("q", "words"),
    [
        ((0.0, 3.0, np.nan), "nan"),
        ((0.0, np.inf, 0.0), "inf"),
        ((0.0, 3.0, 1.01 * MAX_YAW), "yaw beyond"),
        ((0.0, 3.0), "last axis must be 3"),
        ((0.0, 3.0, 0.0, 0.0), "last axis must be 3"),
        (1.0, "last axis must be 3"),
        ("home", "numeric"),
    ],
)
def test_refuses(space, name, q, words):
    with pytest.raises(InputError, match=words):
        getattr(space, name)(q)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -2 * MAX_YAW])
def test_edges_and_paths_refuse_bad_ends(space, bad):
    for ask in (space.motion_is_free, space.path_exists):
        with pytest.raises(InputError, match=r"nan|inf|yaw beyond"):
            ask((0.0, 3.0, 0.0), (0.0, 3.0, bad))
    with pytest.raises(InputError, match=r"nan|inf|yaw beyond"):
        space.is_free_around((0.0, 3.0, bad), 0.1, 0.1)


def test_classify_is_the_state_of_the_cell_whatever_the_turns(space):
    rng = np.random.default_rng(1)
    cells = np.argwhere(np.ones(space.state.shape, dtype=bool))[rng.permutation(space.state.size)[:2000]]
    yaw = space.rotations.representatives[cells[:, 0]]
    for wraps in (-1000, -1, 0, 1, 1000):
        q = np.column_stack([space.grid.center_of(cells[:, 1:]), yaw + wraps * TURN])
        assert (space.classify(q) == space.state[tuple(cells.T)]).all()
    assert (space.slice_at(0.5 + TURN) == space.state[int(space.rotations.cell_of(0.5))]).all()
    with pytest.raises(ValueError, match="read-only"):
        space.state[0, 0, 0] = FREE


def test_quick_checkers_agree_with_look_ups_everywhere(space):
    rng = np.random.default_rng(2)
    q0, q1 = draw_turned(space, rng, 800), draw_turned(space, rng, 800)
    q0[:3, :2] = [space.grid.lower, space.grid.upper, (1e30, -1e30)]
    point, edge, clear = space.point_checker(), space.edge_checker(), space.clearance_checker()
    assert [point(*q) for q in q0.tolist()] == space.is_free(q0).tolist()
    assert [clear(*q) for q in q0.tolist()] == space.clearance(q0).tolist()
    assert [edge(*ends) for ends in np.hstack([q0, q1]).tolist()] == space.motion_is_free(q0, q1).tolist()


def test_every_look_up_takes_the_same_rotation_cell_on_far_borders():
    """Wrapping by many turns rounds; all look-ups must round alike, or a label is read from another cell's slice."""
    cells = Rotations.of(72)
    states = np.arange(72) % 3
    space = stack_of(np.broadcast_to(states[:, None, None], (72, 3, 3)), 72)
    borders = np.asarray(cells.borders)[:-1]
    for wraps in (-3, 0, 2, 100, 1000, 150_000):
        q = np.column_stack([np.full((72, 2), 0.3), borders + wraps * TURN])
        expected = space.classify(q)
        assert (states[cells.cell_of(q[:, 2])] == expected).all()
        assert space.path_exists(q, q).tolist() == [[True, None, False][state] for state in expected]
        assert [space.point_checker()(*one) for one in q.tolist()] == (expected == FREE).tolist()


@settings(max_examples=25)
@given(robots(0.3), rotation_cells(16), seeds, policies)
def test_contains_robot_is_proven(robot, rotations, seed, outside):
    rng = np.random.default_rng(seed)
    occupied = np.zeros((30, 30), dtype=bool)
    for x, y in rng.integers(0, 14, (3, 2)):
        occupied[x : x + 16, y : y + 16] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), robot, rotations=rotations, outside=outside)
    q = draw_turned(space, rng, 300)
    q = q[space.contains_robot(q)]
    room = obstacles_of(space).buffer(1e-9)
    placed = [shapely.transform(robot.geometry, lambda points, one=one: turned(points, one[None])[0]) for one in q]
    assert shapely.covers(room, np.asarray(placed)).all()


def test_contains_robot_follows_the_yaw():
    occupied = np.zeros((12, 6), dtype=bool)
    occupied[1:11, 1:5] = True
    robot = Robot.rectangle(0.6, 0.1)
    space = cspace.build(Workspace.from_array(occupied, 0.1), robot, rotations=36, outside="free")
    assert space.contains_robot([(0.6, 0.3, 0.0), (0.6, 0.3, np.pi), (0.6, 0.3, np.pi / 2)]).tolist() == [1, 1, 0]


def test_look_ups_from_many_threads_agree():
    rng = np.random.default_rng(5)
    occupied = rng.random((80, 80)) < 0.01
    q = np.dstack([rng.uniform(0, 4, (24, 1000, 2)), rng.uniform(-4, 4, (24, 1000, 1))])

    def build():
        return cspace.build(Workspace.from_array(occupied, 0.05), Robot.polygon(L_SHAPE), rotations=10)

    def ask(space, points):
        a, b = points[1:], points[:-1]
        one = space.classify(points), space.clearance(points), space.overlap(points), space.contains_robot(points)
        return *one, space.motion_is_free(a, b), space.path_exists(a, b), space.is_free_around(a, 0.1, 0.2)

    space, fresh = build(), build()
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda points: ask(space, points), q))
    for points, answers in zip(q, together, strict=True):
        assert all((mine == theirs).all() for mine, theirs in zip(answers, ask(fresh, points), strict=True))


def test_refuses_a_state_that_does_not_fit():
    workspace, robot = Workspace.from_array(np.zeros((3, 4), bool), 0.1), Robot.rectangle(0.2, 0.1)
    options = {"outside": "free", "margin": 0.0, "precision": "float32", "rotations": Rotations.of(8)}
    assert cspace.CSpace(workspace, robot, np.zeros((4, 3, 4), np.uint8), **options).state.shape == (8, 3, 4)
    for shape in ((3, 4), (8, 3, 4), (4, 4, 3)):
        with pytest.raises(InputError, match="map's shape"):
            cspace.CSpace(workspace, robot, np.zeros(shape, np.uint8), **options)
