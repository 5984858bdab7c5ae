"""Maps of robots that turn as sets: connectivity, clearance, samples, nearest free configurations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
import oracles
from checks import draw_turned, stack_of, turned_collides
from cspace import BLOCKED, FREE, ConfigurationError, InputError, Robot, Workspace
from cspace.rotations import TURN, Rotations
from strategies import robots, rotation_cells, seeds

POINT = Robot.disc(1e-6, (1e-7, 0.0))
BAR = Robot.rectangle(1e-6, 1e-7)  # shares half of its slices
SQUARE = Robot.rectangle(1e-6, 1e-6)
SPOT = Robot.disc(1e-6)


def middles(space):
    """Every cell ``(rotation, x, y)``, and its middle."""
    count = 1 if space.rotations is None else space.rotations.count
    cells = np.argwhere(np.ones((count, *space.grid.shape), dtype=bool))
    return cells, np.column_stack([space.grid.center_of(cells[:, 1:]), space.rotations.representatives[cells[:, 0]]])


# ---- path_exists -----------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(
    seeds,
    st.tuples(st.integers(1, 4), st.integers(1, 4)),
    st.sampled_from([(POINT, 1), (POINT, 2), (POINT, 3), (POINT, 5), (BAR, 2), (BAR, 6), (SQUARE, 8), (SPOT, 4)]),
    st.sampled_from([(0, 0, 1, 2), (0, 1, 2, 2, 2)]),
)
def test_paths_against_a_flood_fill(seed, shape, turning, mixture):
    """All pairs of cells of a small stack, with shared slices and the wrap; beyond the grid all is FREE."""
    robot, count = turning
    slices = {0: 1}.get(robot.symmetry, count // max(robot.symmetry, 1))
    stack = np.random.default_rng(seed).choice(np.array(mixture, dtype=np.uint8), (slices, *shape))
    space = stack_of(stack, count, robot)
    state = stack[np.arange(count) % slices]
    assert (space.state == state).all()
    cells, q = middles(space)
    answers = space.path_exists(q[:, None], q[None])
    rim = np.pad(state != BLOCKED, ((0, 0), (1, 1), (1, 1)), constant_values=True)
    for a, start in enumerate(map(tuple, cells.tolist())):
        free = oracles.turned_component_of(state == FREE, start)
        passable = oracles.turned_component_of(rim, (start[0], start[1] + 1, start[2] + 1))
        for b, (k, i, j) in enumerate(cells.tolist()):
            expected = True if (k, i, j) in free else None if (k, i + 1, j + 1) in passable else False
            assert answers[a, b] is expected


@settings(max_examples=30)
@given(seeds, rotation_cells(6))
def test_paths_that_may_not_leave_the_grid(seed, rotations):
    robot = Robot.rectangle(1.0, 0.8, (0.1, 0.0))  # holds its reference point at every yaw: BLOCKED all around
    count = Rotations.of(rotations).count
    state = np.random.default_rng(seed).choice(np.array([0, 1, 2, 2], dtype=np.uint8), (count, 4, 3))
    space = stack_of(state, rotations, robot, outside="blocked", spacing=0.05)
    cells, q = middles(space)
    if not (space.classify(np.column_stack([q[:, :2] - 9.0, q[:, 2]])) == BLOCKED).all():
        return
    answers = space.path_exists(q[:, None], q[None])
    for a, start in enumerate(map(tuple, cells.tolist())):
        free = oracles.turned_component_of(state == FREE, start)
        passable = oracles.turned_component_of(state != BLOCKED, start)
        for b, goal in enumerate(map(tuple, cells.tolist())):
            assert answers[a, b] is (True if goal in free else None if goal in passable else False)


def test_turning_on_the_spot_wraps():
    state = np.full((6, 1, 1), BLOCKED)
    state[[0, 1, 5]] = FREE
    space = stack_of(state, 6)
    assert space.path_exists((0.1, 0.1, 1.0), (0.1, 0.1, -1.0)) is True
    assert space.path_exists((0.1, 0.1, 1.0), (0.1, 0.1, TURN - 1.0)) is True
    assert space.path_exists((0.1, 0.1, 0.0), (0.1, 0.1, math.pi)) is False


def test_a_passage_decides():
    """A bar fits through lengthwise, and turns around behind the passage, but not in it."""
    occupied = np.zeros((160, 80), dtype=bool)
    occupied[50:110, :34] = occupied[50:110, 46:] = True  # a passage 0.6 m wide and 3 m long
    robot = Robot.rectangle(1.2, 0.2, (0.1, 0.0))
    space = cspace.build(Workspace.from_array(occupied, 0.05), robot, rotations=36)
    left, middle, right = (1.2, 2.0), (4.0, 2.0), (6.8, 2.0)
    assert space.path_exists((*left, 0.0), (*right, 0.0)) is True
    assert space.path_exists((*left, 0.0), (*right, math.pi)) is True
    assert space.path_exists((*middle, 0.0), (*middle, math.pi)) is True
    assert space.path_exists((*left, 0.0), (*middle, math.pi / 2)) is False
    occupied[[50, 109]] = True
    closed = cspace.build(Workspace.from_array(occupied, 0.05), robot, rotations=36)
    assert closed.is_free([(*middle, 0.0), (*middle, math.pi)]).all()
    assert closed.path_exists((*middle, 0.0), (*middle, math.pi)) is False


def test_paths_answer_in_kind():
    space = stack_of(np.zeros((4, 2, 2)), 4)
    assert space.path_exists(np.full((2, 1, 3), 0.1), np.full((3, 3), 0.2)).tolist() == [[True] * 3] * 2
    assert space.path_exists(np.empty((0, 3)), (0.1, 0.1, 0.1)).shape == (0,)


# ---- clearance -------------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(robots(0.3), rotation_cells(8), seeds, st.sampled_from(["blocked", "free"]))
def test_clearance_is_a_close_lower_bound(robot, rotations, seed, outside):
    rng = np.random.default_rng(seed)
    h = 0.1
    workspace = Workspace.from_array(rng.random((20, 16)) < rng.choice([0.0, 0.01]), h)
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    wide = 40
    k = np.stack(np.meshgrid(*(np.arange(-wide, wide + 16),) * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    q = draw_turned(space, rng, 25)
    for point, bound, state in zip(q, space.clearance(q), space.classify(q), strict=True):
        whole_slice = np.column_stack([space.grid.center_of(k), np.full(len(k), point[2])])
        closed = k[space.classify(whole_slice) != FREE] * h
        if state != FREE:
            assert bound == 0.0
        elif len(closed):
            gap = np.maximum(np.maximum(closed - point[:2], point[:2] - closed - h), 0)
            distance = np.hypot(*gap.T).min()
            assert bound <= distance + 1e-9
            if space.grid.contains(point[:2]):
                assert bound > distance - 1.5 * h
        else:
            assert bound == math.inf


@settings(max_examples=20)
@given(robots(0.3), rotation_cells(16), seeds)
def test_clearance_holds_at_every_yaw_of_the_cell(robot, rotations, seed):
    rng = np.random.default_rng(seed)
    workspace = Workspace.from_array(rng.random((20, 16)) < 0.02, 0.2)
    space = cspace.build(workspace, robot, rotations=rotations, outside="free")
    if not (space.state == FREE).any():
        return
    q = space.sample_free(40, rng)
    borders, cells = np.asarray(space.rotations.borders), space.rotations.cell_of(q[:, 2])
    assert (space.clearance(q) > 0.0).any()
    moved = q.copy()
    course = rng.uniform(0, TURN, len(q))
    steps = 0.999999 * np.minimum(space.clearance(q), 50.0)
    moved[:, :2] += steps[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    t = rng.choice([1e-6, 0.5, 1 - 1e-6], len(q))
    moved[:, 2] = borders[cells] + t * (borders[cells + 1] - borders[cells])
    moved = moved[space.clearance(q) > 0.0]
    assert space.is_free(moved).all()
    assert not turned_collides(space, moved, 0.0).any()


# ---- samples and nearest free configurations -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def unequal():
    occupied = np.zeros((9, 8), dtype=bool)
    occupied[4, 2:] = True
    workspace = Workspace.from_array(occupied, 0.3, (-4.0, 7.0))
    return cspace.build(
        workspace, Robot.rectangle(0.6, 0.1, (0.1, 0.0)), rotations=[-1.0, -0.8, 0.5, 0.6, 3.0, TURN - 1]
    )


@pytest.mark.parametrize("case", ["unequal", "shared"])
def test_samples_are_uniform_over_the_free_volume(case, request):
    """Chi-squared over the FREE cells by volume, and over eighths of a cell; six standard deviations."""
    if case == "unequal":
        space = request.getfixturevalue("unequal")
    else:
        state = np.random.default_rng(3).choice(np.array([0, 1, 2], dtype=np.uint8), (3, 5, 4))
        space = stack_of(state, 6, BAR)
    n = 200_000
    samples = space.sample_free(n, np.random.default_rng(1))
    borders = np.asarray(space.rotations.borders)
    turn, place = space.rotations.cell_of(samples[:, 2]), space.grid.cell_of(samples[:, :2])
    assert space.is_free(samples).all()
    within = (samples[:, :2] - space.grid.lower) / space.grid.spacing - place
    above = samples[:, 2] - borders[turn]
    above = (above - TURN * np.floor(above / TURN)) / np.diff(borders)[turn]
    eighth = np.column_stack([within >= 0.5, above >= 0.5]) @ [4, 2, 1]
    cell = np.ravel_multi_index((turn, *place.T), space.state.shape)
    bins = np.bincount(cell * 8 + eighth, minlength=space.state.size * 8)
    volume = np.where(space.state == FREE, np.diff(borders)[:, None, None], 0.0).ravel()
    free = np.repeat(volume > 0, 8)
    assert not bins[~free].any()
    expected, freedom = n * np.repeat(volume / volume.sum() / 8, 8)[free], free.sum() - 1
    statistic = (np.square(bins[free] - expected) / expected).sum()
    assert abs(statistic - freedom) < 6 * np.sqrt(2 * freedom)


def test_samples_repeat_with_the_seed(unequal):
    samples = unequal.sample_free(500, np.random.default_rng(0))
    assert samples.shape == (500, 3)
    assert (samples == unequal.sample_free(500, np.random.default_rng(0))).all()
    assert (samples != unequal.sample_free(500, np.random.default_rng(1))).any()
    assert unequal.sample_free(rng=np.random.default_rng(0)).shape == (3,)
    assert unequal.sample_free(0, np.random.default_rng(0)).shape == (0, 3)
    with pytest.raises(InputError, match="rng"):
        unequal.sample_free(3)


@settings(max_examples=30)
@given(seeds, rotation_cells(8), st.sampled_from([0.1, 0.5, 2.0]))
def test_nearest_free_is_the_nearest(seed, rotations, spacing):
    rng = np.random.default_rng(seed)
    state = (rng.random((Rotations.of(rotations).count, 5, 4)) < 0.9).astype(np.uint8)
    state[tuple(rng.integers(0, state.shape))] = FREE
    space = stack_of(state, rotations, spacing=spacing)
    cells, q = middles(space)
    free = q[state[tuple(cells.T)] == FREE]
    for one in np.column_stack([rng.uniform(-1, 6, (10, 2)) * spacing, rng.uniform(-9, 9, 10)]):
        nearest = space.nearest_free(one)
        assert (np.abs(free - nearest) < 1e-12).all(axis=1).any()

        def distance(to, one=one):
            turn = np.abs((to[..., 2] - one[2] + math.pi) % TURN - math.pi)
            return np.hypot(to[..., 0] - one[0], to[..., 1] - one[1]) + turn / 2

        assert distance(nearest) == pytest.approx(distance(free).min())


def test_nothing_free_is_an_error_that_says_so():
    full = cspace.build(Workspace.from_array(np.ones((3, 3), bool), 0.1), Robot.rectangle(0.2, 0.1), rotations=8)
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        full.sample_free(1, np.random.default_rng(0))
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        full.nearest_free((0.0, 0.0, 0.0))
