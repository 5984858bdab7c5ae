"""Chunks of commands: whole tubes are proven, against shapely and contacts placed inside them."""

import math

import numpy as np
import pandas as pd
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

import cspace
from cspace import FREE, MIXED, Robot, Workspace
from cspace.errors import InputError
from cspace.inside import tubes_are_free
from tests.helpers.any_map import ALL_KINDS, WEDGE, build_map
from tests.helpers.gates import certify_chunk, certify_twists
from tests.helpers.handmade import (
    MAP_KINDS,
    build_empty,
    configurations,
    full_states,
    make_map,
    random_states,
)
from tests.helpers.leaving import drive
from tests.helpers.placements import collides, move, obstacles_of
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.strategies import examples, few, seeds

INSTANTS = 2000
"""Instants within a tube at which shapely looks for contacts."""


@pytest.fixture(scope="module", params=ALL_KINDS, ids="-".join)
def any_map(request, tmp_path_factory):
    """Build a map that tests share and none changes."""
    space, storage = request.param
    return build_map(space, storage, "free", 5, tmp_path_factory.mktemp("any"))


# ---- proofs of maps ------------------------------------------------------------------------------


@given(seeds)
@examples(4)
def test_without_tracking_as_many_rows_are_proven_as_edges(any_map, seed):
    rng, space = np.random.default_rng(seed), any_map.space
    starts = any_map.draw_inside(rng, 40)[0]
    paths = [starts]
    for _ in range(5):
        paths.append(move(any_map.memory, paths[-1], *any_map.draw_moves(rng, 40)))
    rows = np.stack(paths[1:], axis=1)
    edges = space.certify_path(np.stack(paths, axis=1))
    expected = np.logical_and.accumulate(edges, axis=1).sum(axis=1)
    batch = certify_chunk(space, starts, rows)
    assert batch.proven.tolist() == expected.tolist()
    assert batch.is_proven.tolist() == (expected == 5).tolist()
    tubes = [certify_chunk(each, starts, rows, 0.05) for each in (space, any_map.memory)]
    assert tubes[0].proven.tolist() == tubes[1].proven.tolist() and tubes[0].proven.any()
    assert 0 < expected.sum() < expected.size * 5
    for start, chunk_rows, count in zip(starts[:5], rows, expected, strict=False):
        chunk = certify_chunk(space, start, chunk_rows)
        assert chunk.proven == count
        assert (chunk.refusal is None) == chunk.is_proven == (count == 5)


@pytest.mark.parametrize("rounds", few([25, 60]))
@pytest.mark.parametrize("kind", MAP_KINDS)
def test_no_tube_is_proven_from_the_first_that_meets_a_taken_cell_on(kind, rounds):
    """Draw a configuration in a tube, often in a corner, and take its cell alone.

    Rows may be so near that a box of cells proves several.
    """
    rng = np.random.default_rng(7)
    stopped_by_tracking = proven_before = 0
    for _ in range(rounds):
        cells = random_states(rng, kind, max_side=12, mixture=(FREE,))
        space = make_map(cells, kind, "free")
        dim, turns, count = space.dim, bool(space.rotations.names), int(rng.choice([1, 12]))
        places = rng.uniform(space.grid.lower, space.grid.upper, (count + 1, dim))
        draws = np.column_stack([places, rng.uniform(-4.0, 4.0, (count + 1, space.size - dim))])
        sizes = np.repeat(rng.choice([0.02, 0.1, 1.0], 2), (dim, space.size - dim))
        rows = configurations(space, draws[0] + sizes * (draws - draws[0]))
        tracking = rng.choice([0.0, 0.1, 0.5, 1.0], dim + turns) * (rng.random(dim + turns) < 0.7)
        assert certify_chunk(space, rows[0], rows[1:], tracking).is_proven
        for row in rng.integers(count, size=6):
            share = rng.choice([0.0, 0.5, 1.0, rng.random()])
            exact = space.interpolate(rows[[row]], rows[[row + 1]], [[share]])
            signs = (1.0 - 1e-9) * rng.choice([-1.0, 0.0, 1.0, rng.random()], (1, dim + 1))
            axis = rng.normal(size=(1, 3)) if space.size == 7 else np.array([[0.0, 0.0, 1.0]])
            angle = signs[:, dim:] * (tracking[-1] if turns else 0.0)
            offset = signs[:, :dim] * tracking[:dim]
            inside = move(space, exact, offset, angle * axis / np.linalg.norm(axis))
            if not space.grid.contains(inside[0, :dim]):
                continue
            taken = cells.copy()
            taken[tuple(space._cells_of(inside)[0].tolist())] = MIXED
            one_taken = make_map(taken, kind, "free")
            proven = certify_chunk(one_taken, rows[0], rows[1:], tracking).proven
            assert proven <= row
            stopped_by_tracking += proven < certify_chunk(one_taken, rows[0], rows[1:]).proven
            proven_before += proven > 0
    assert min(stopped_by_tracking, proven_before) > rounds / 5


@pytest.mark.parametrize("kind", MAP_KINDS)
def test_a_tube_that_leaves_the_grid_is_proven_only_if_all_outside_is_free(kind):
    states = full_states(kind, 8)
    for outside in ("free", "blocked"):
        space = make_map(states, kind, outside)
        middle = 0.5 * np.array(space.grid.upper)
        q = np.array([*middle, *space.rotations.centers[0]])
        tracking = np.zeros(space.dim + bool(space.rotations.names))
        for axis in range(space.dim):
            for radius in (0.9, 1.1):
                tracking[:] = 0.0
                tracking[axis] = radius * middle[axis]
                proven = certify_chunk(space, q, [q], tracking).proven
                assert proven == (radius < 1.0 or outside == "free")


def make_flat(seed, rotations=None):
    """Build a map of a wedge among random cells."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((50, 50)) < 0.01
    workspace = Workspace.from_array(occupied, 0.1)
    return cspace.build(workspace, Robot.polygon(WEDGE), rotations=rotations)


@given(seeds)
@examples(30)
def test_a_tube_in_the_plane_is_proven_exactly_if_no_cell_near_it_is_taken(seed):
    """Unions of boxes by shapely: the motion, widened by the tracking along x and y."""
    space = make_flat(seed % 5)
    rng = np.random.default_rng(seed)
    taken = 0.1 * np.argwhere(space.cell_states != FREE)
    cells = shapely.box(taken[:, 0], taken[:, 1], taken[:, 0] + 0.1, taken[:, 1] + 0.1)
    tree = shapely.STRtree(cells)
    for _ in range(40):
        ends = rng.uniform(1.0, 4.0, (2, 2)) * rng.choice([1.0, 0.6])
        ends[1] = ends[0] + rng.uniform(-1.0, 1.0, 2) * (rng.random(2) < 0.8)
        tracking = rng.choice([0.0, 0.05, 0.1, rng.uniform(0.0, 0.4)], 2)
        corners = [end + tracking * (i, j) for end in ends for i in (-1, 1) for j in (-1, 1)]
        tube = shapely.MultiPoint(corners).convex_hull
        nearest = cells[tree.nearest(tube)].distance(tube)
        if nearest > 1e-9 or shapely.buffer(tube, -1e-6).intersects(cells[tree.nearest(tube)]):
            proven = certify_chunk(space, ends[0], ends[1:], tracking).proven
            assert proven == (nearest > 1e-9)


@given(seeds, st.sampled_from([0.0, 0.03, 0.1, (0.05, 0.0, 0.2)]))
@examples(10)
def test_the_largest_tracking_is_proven_and_a_larger_one_is_not(seed, tracking):
    space = make_flat(seed % 3, rotations=48)
    rng = np.random.default_rng(seed)
    start = space.sample_free(rng=rng)
    rows = start + np.cumsum(rng.normal(0.0, (0.05, 0.05, 0.1), (25, 3)), axis=0)
    chunk = certify_chunk(space, start, rows, tracking)
    largest = chunk.max_tracking
    if chunk.is_proven:
        assert np.all(np.asarray(largest) >= 0.99 * np.asarray(tracking))
    if not np.isnan(np.max(largest)):
        assert certify_chunk(space, start, rows, largest).is_proven
        more = 1.02 * np.asarray(largest) + 1e-4 * (np.asarray(tracking) > 0.0)
        assert not certify_chunk(space, start, rows, more + 1e-4 * (np.ndim(more) == 0)).is_proven


# ---- twists --------------------------------------------------------------------------------------


@given(
    seeds,
    st.sampled_from([0.0, 0.05, (0.0, 0.1, 0.2)]),
    st.sampled_from([(0.05, 1.0), (0.5, 1.0), (1.0, 4.0)]),
)
@examples(20)
def test_the_robot_meets_nothing_on_proven_arcs(seed, tracking, scale):
    space = make_flat(seed % 3, rotations=48)
    obstacles = obstacles_of(space)
    rng = np.random.default_rng(seed)
    dt, turn = scale
    start = space.sample_free(rng=rng)
    twists = rng.normal(0.0, (0.5, turn), (8, 2)) * (rng.random((8, 2)) < 0.8)
    chunk = certify_twists(space, start, twists, dt, tracking)
    pose = start
    for row in range(chunk.proven):
        exact = drive(pose, twists[row], dt * rng.random(INSTANTS // 8))
        errors = rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], exact.shape)
        assert not collides(space, exact + errors * tracking, obstacles).any()
        pose = drive(pose, twists[row], np.array([dt]))[0]
        np.testing.assert_allclose(chunk.rows[row], pose, atol=1e-9)


def test_a_gate_brakes_for_an_obstacle_that_comes_too_late(room):
    gate = cspace.Gate(room, dt=0.1, max_deceleration=(1.0, 1.0), tracking=0.01)
    assert gate.stop_distance((1.0, 0.5)) == pytest.approx(0.1 * 11 / 2)
    assert gate.stop_distance((0.0, 0.0)) == 0.0
    slowed = gate.slow_down((2.3, 2.5, 0.0), (1.0, 0.0), twist_now=(1.0, 0.0))
    assert (slowed.share, bool(slowed.chunk)) == (0.0, False)
    assert "pallet" in slowed.chunk.refusal.names
    assert repr(slowed.chunk).endswith(f"proven={slowed.chunk.proven})")
    np.testing.assert_allclose(slowed.commands[:, 0], np.arange(9, 0, -1) / 10)


def test_an_arc_is_not_proven_if_any_cell_on_it_is_taken():
    rng = np.random.default_rng(3)
    cells = np.full((5, 16, 16), FREE, dtype=np.uint8)
    space = make_map(cells, "turning", "free")
    missed_by_chords = 0
    for _ in range(60):
        start = np.array([*rng.uniform(1.0, 3.0, 2), rng.uniform(-3.0, 3.0)])
        twist = rng.uniform(-1.0, 1.0), rng.uniform(-3.0, 3.0)  # cut into several arcs
        assert certify_twists(space, start, [twist], 1.0).is_proven
        poses = drive(start, twist, np.linspace(0.0, 1.0, 400))
        poses = poses[space.grid.contains(poses[:, :2])]
        for cell in np.unique(space._cells_of(poses), axis=0).tolist():
            taken = cells.copy()
            taken[tuple(cell)] = MIXED
            one_taken = make_map(taken, "turning", "free")
            chunk = certify_twists(one_taken, start, [twist], 1.0)
            assert chunk.proven == 0
            points = np.vstack([chunk._tubes.starts, chunk._tubes.ends[0]])
            missed_by_chords += bool(one_taken.certify_path(points).all())
    assert missed_by_chords > 0


@pytest.fixture(scope="module")
def room():
    """Build a room with a pallet and a post, for a robot that turns."""
    space = build_empty((100, 100), Robot.rectangle(0.4, 0.25), spacing=0.05, rotations=36)
    space.add_obstacle("pallet", [(3.0, 2.5)], radius=0.3)
    space.add_obstacle("post", [(1.0, 4.0)], radius=0.3)
    return space


START = (1.0, 2.5, 0.0)


def test_twists_that_exceed_limits_are_refused(room):
    import planners  # the core's tests run without it

    twists = [(0.5, 0.2), (0.5, 1.1), (0.2, 0.0)]
    assert certify_twists(room, START, twists, 0.1).is_proven
    car = planners.Car(turning_radius=0.5, reverse=True)
    tight = certify_twists(room, START, twists, 0.1, drive=car)
    assert tight.refusal[:3] == (1, "limit", ("omega",))
    assert certify_twists(room, START, [(-0.5, 1.0)], 0.1, drive=car).is_proven
    fast = certify_twists(room, START, twists, 0.1, max_velocity=(0.4, 9.0))
    assert fast.refusal[:3] == (0, "speed", ("v",))
    for bad in (math.nan, math.inf, 1e200):
        chunk = certify_twists(room, START, [(0.5, 0.2), (0.5, bad), (0.1, 0.0)], 0.1)
        assert (chunk.proven, chunk.refusal.cause) == (1, "number")
    for bad in ((1e9, 1.0), (0.0, 1e3)):
        chunk = certify_twists(room, START, [(0.5, 0.2), bad], 0.1)
        assert chunk.refusal[:3] == (1, "limit", ("twist",))


# ---- answers -------------------------------------------------------------------------------------


def test_a_refusal_names_the_obstacles_of_a_map(room):
    chunk = certify_chunk(room, START, [(1.5, 2.5, 0.0), (2.0, 2.5, 0.0), (2.6, 2.5, 0.3)], 0.05)
    assert chunk.proven == 2
    assert chunk.refusal[:3] == (2, "collision", ("pallet",))
    assert "near pallet" in chunk.refusal.message
    assert math.isnan(chunk.max_tracking)
    # A robot that is in collision holds.
    stuck = certify_chunk(room, (1.0, 4.0, 0.0), [(1.0, 4.0, 0.0), START])
    assert stuck.refusal[:3] == (0, "collision", ("post",))
    # At the edge of the map, there is no obstacle to name.
    assert certify_chunk(room, (0.6, 0.6, 0.0), [(0.1, 0.6, 0.0)]).refusal.names == ()
    # An error that is larger than any clearance is never proven.
    assert certify_chunk(room, START, [START], 50.0).proven == 0
    assert 0.2 < certify_chunk(room, START, [START], 50.0).max_tracking < 1.0


@pytest.mark.parametrize("far", [4.0, 1e6, 1e300])
def test_an_error_of_half_a_turn_is_that_of_all_turns(any_map, far):
    space = any_map.space
    rows = any_map.memory.sample_free(60, np.random.default_rng(1)).reshape(20, 3, space.size)
    turns = bool(space.rotations.names)
    for metres in (0.0, 0.1):
        errors = np.array([metres] * space.dim + [far] * turns)
        half_a_turn = np.minimum(errors, math.pi)
        expected = certify_chunk(space, rows[:, 0], rows[:, 1:], half_a_turn).proven
        found = certify_chunk(space, rows[:, 0], rows[:, 1:], errors).proven
        assert found.tolist() == expected.tolist()
    assert not certify_chunk(space, rows[:, 0], rows[:, 1:], 1e300).proven.any()


def test_rows_that_are_no_configurations_are_refused(room, any_map):
    for bad in (math.nan, -math.inf):
        chunk = certify_chunk(
            room, START, [START, (1.0, bad, 0.0), START], 0.01, dt=1.0, max_velocity=1.0
        )
        assert (chunk.proven, chunk.refusal.cause) == (1, "number")
    for far in (1e9, 1e300):
        chunk = certify_chunk(room, START, [START, (far, 2.5, 0.0)])
        assert (chunk.proven, chunk.refusal.cause) == (1, "collision")
    if any_map.space.size == 7:
        q = any_map.draw_inside(np.random.default_rng(0), 300)[0]
        q = q[certify_chunk(any_map.space, q, q[:, np.newaxis]).is_proven][0]
        assert certify_chunk(any_map.space, q, [q, 1.1 * q]).refusal.cause == "number"
        with pytest.raises(InputError, match=r"q.*where the robot is"):
            certify_chunk(any_map.space, 1.1 * q, [q])


def test_each_tube_has_radii_of_its_own(any_map):
    rng, space = np.random.default_rng(3), any_map.space
    starts = any_map.draw_inside(rng, 200)[0]
    radii = rng.choice([0.0, 0.01, 0.1, 0.5], (200, any_map.dim + bool(space.rotations.names)))
    ends = move(any_map.memory, starts, *any_map.draw_moves(rng, 200))
    rows = zip(starts, ends, radii, strict=True)
    alone = [certify_chunk(space, start, [end], row).is_proven for start, end, row in rows]
    assert tubes_are_free(space, starts, ends, radii).tolist() == alone
    assert 0.02 < np.mean(alone) < 0.98


def test_a_map_in_tiles_opens_no_part_for_refused_rows(tmp_path, monkeypatch):
    tiled = build_map("yaw", "tiled", "free", 5, tmp_path)
    tiles = type(tiled.space._tiles)
    find_parts = tiles.parts_near
    reaches = []

    def record_reach(self, cells, reach, *options):
        reaches.append(reach)
        return find_parts(self, cells, reach, *options)

    monkeypatch.setattr(tiles, "parts_near", record_reach)
    q = np.array([*(np.array(tiled.space.grid.lower) + 0.5), 0.0])
    for far in (2.0, 1e300):
        rows = q + np.array([(0.0, 0.0, 0.0), (far, 0.0, 0.0)])
        certify_chunk(tiled.space, q, rows, 0.01, dt=1.0, max_velocity=1.0)
    assert max(reaches) < 0.5 / tiled.space.grid.spacing
    certify_chunk(tiled.space, q, q + np.array([(2.0, 0.0, 0.0)]), 0.01)
    assert reaches[-1] > 2.0 / tiled.space.grid.spacing


def test_speeds_of_rows_are_limited(room):
    rows = [(1.1, 2.5, 0.0), (1.2, 2.5, 0.1), (1.3, 2.5, 0.4)]
    chunk = certify_chunk(room, START, rows, dt=0.1, max_velocity=(1.0, 1.0, 2.0))
    assert chunk.refusal[:3] == (2, "speed", ("yaw",))
    assert chunk.refusal.message == "row 2: yaw changes per second by 3, at most 2 is allowed"
    assert certify_chunk(room, START, rows, dt=0.1, max_velocity=3.0).is_proven
    assert certify_chunk(room, START, [START] * 2, dt=0.1, max_velocity=0.0).is_proven


def find_jerk(known, limits, dt):
    """Return the first row and column at which weighted sums of rows exceed limits."""
    weights = (1, -2, 1) if known.shape[1] == 2 else (-1, 3, -3, 1)
    order = len(weights) - 1
    for row in range(order, len(known)):
        for column, limit in enumerate(limits):
            last = known[row - order : row + 1, column]
            jerk = sum(w * x for w, x in zip(weights, last, strict=True)) / dt**order
            if abs(jerk) > limit * (1.0 + 1e-6):
                return row, column
    return len(known), None


@example(3, 2)
@given(seeds, st.integers(0, 3))
@examples(30)
def test_a_gate_refuses_the_first_row_with_too_much_jerk(seed, earlier):
    space = build_empty((60, 60), Robot.disc(0.2), rotations=8)
    rng = np.random.default_rng(seed)
    eighths = rng.integers(-1, 2, (12, 3)) / 8.0
    points = np.array([3.0, 3.0, 3.1]) + np.cumsum(eighths, axis=0)  # the yaw passes pi
    limits = np.array([3.0, 4.0, 8.0]) * rng.choice([0.5, 1.0, 2.0])
    gate = cspace.Gate(space, dt=0.5, max_velocity=9.0, max_jerk=tuple(limits))
    chunk = gate.check_rows(points[earlier], points[earlier + 1 :], before=points[:earlier]).chunk
    row, column = find_jerk(points, limits, 0.5)
    if row <= earlier:  # it was driven before
        return
    assert chunk.proven == row - earlier - 1
    if column is not None:
        assert chunk.refusal[:3] == (row - earlier - 1, "jerk", (space.axes[column],))
    twists = eighths[:, :2]
    limits = limits[:2] / 4.0
    gate = cspace.Gate(space, dt=0.5, max_jerk=limits)
    chunk = gate.check_twists((3.0, 3.0, 0.0), twists[earlier:], before=twists[:earlier]).chunk
    row, column = find_jerk(twists, limits, 0.5)
    assert row < earlier or chunk.proven == row - earlier


def test_a_gate_limits_the_jerk_of_rotations_as_one():
    space = build_empty(
        (20, 20, 20), Robot.box((0.2, 0.1, 0.1)), rotations=cspace.Rotations.quaternions(1)
    )
    angles = [0.0, 0.0, 0.1, 0.1]
    rows = np.array([(1.0, 1.0, 1.0, 0.0, math.sin(a / 2), 0.0, math.cos(a / 2)) for a in angles])
    limits = {"dt": 0.1, "max_velocity": 9.0}
    refusal = cspace.Gate(space, **limits, max_jerk=150.0).check_rows(rows[0], rows).chunk.refusal
    assert refusal.message == "row 3: rotation has a jerk of 200, at most 150 is allowed"


def braking(space):
    """Return a gate that knows the brakes."""
    return cspace.Gate(space, dt=0.1, max_deceleration=(1.0, 1.0))


def gentle(space):
    """Return a gate that limits the jerk of each coordinate."""
    return cspace.Gate(space, dt=0.1, max_velocity=1.0, max_jerk=(9.0, 9.0, 9.0))


def test_degrees_of_rows_before_are_noticed(room):
    with pytest.warns(cspace.errors.AngleWarning, match="before: yaw is beyond a whole turn"):
        gentle(room).check_rows(START, [START], before=[(1.0, 1.0, 90.0), START])


def test_a_gate_passes_the_proven_part_then_holds(room):
    gate = cspace.Gate(room, tracking=0.02, dt=0.2, max_velocity=(1.0, 2.0))
    passed = gate.check_twists(START, [(0.5, 0.2)] * 3 + [(2.0, 0.0), (0.5, 0.0)])
    assert passed.state == "shortened"
    assert passed.commands.tolist() == [[0.5, 0.2]] * 3 + [[0.0, 0.0]] * 2
    assert passed.chunk.refusal.cause == "speed"
    assert gate.check_twists(START, [(0.5, 0.2)]).state == "go"
    careful, near, pallet = cspace.Gate(room, tracking=0.05), (1.2, 2.6, 0.1), (3.0, 2.5, 0.0)
    rows = careful.check_rows(START, [near, pallet, START])
    assert rows.state == "shortened"
    assert rows.commands.tolist() == [list(near)] * 3
    rows = careful.check_rows(START, [pallet, START])
    assert rows.state == "hold"
    assert rows.commands.tolist() == [list(START)] * 2


def test_a_gate_passes_a_batch_as_it_passes_each_chunk(room):
    rng = np.random.default_rng(1)
    q = room.sample_free(30, rng)
    twists = rng.normal(0.0, (0.8, 0.5), (30, 6, 2))
    gate = cspace.Gate(room, tracking=0.01, dt=0.5, max_velocity=(1.5, 2.0))
    rows = q[:, np.newaxis] + np.cumsum(rng.normal(0.0, 0.2, (30, 6, 3)), axis=1)
    for check, each in ((cspace.Gate(room).check_rows, rows), (gate.check_twists, twists)):
        batch = check(q, each)
        single = [check(*pair) for pair in zip(q, each, strict=True)]
        counts = [one.chunk.proven for one in single]
        assert batch.chunk.proven.tolist() == counts and {0, 6} < set(counts)
        assert batch.commands.tolist() == [one.commands.tolist() for one in single]
        assert batch.state == "shortened"
    assert cspace.Gate(room).check_rows(q, q[:, np.newaxis]).state == "go"
    with pytest.raises(InputError, match=r"max_jerk is that of a batch.*checked"):
        gentle(room).check_rows(q, rows)


def test_a_gate_returns_the_commands_that_it_proved_whatever_their_labels(room):
    gate = cspace.Gate(room, dt=0.2, max_velocity=(1.0, 1.0))
    table = pd.DataFrame({"omega": [0.5] * 3, "v": [0.0] * 3})
    passed = gate.check_twists(START, table)
    assert passed.state == "go" and passed.commands.tolist() == [[0.0, 0.5]] * 3
    rows = cspace.Gate(room, dt=0.2, max_velocity=9.0)
    q = pd.Series({"yaw": START[2], "y": START[1], "x": START[0]})
    held = rows.check_rows(q, pd.DataFrame([(0.0, 2.5, 90.0)], columns=["yaw", "y", "x"]))
    assert held.state == "hold" and held.commands.tolist() == [list(START)]


def test_a_refusal_shows_digits_that_tell_value_and_limit_apart(room):
    gate = cspace.Gate(room, dt=0.1, max_velocity=(1.0, 1.0))
    message = gate.check_twists(START, [(1.00000002, 0.0)]).chunk.refusal.message
    assert message == "row 0: v is 1.00000002, at most 1 is allowed"


def test_the_repr_of_a_gate_has_its_limits(room):
    assert repr(cspace.Gate(room)) == f"Gate({room!r}, tracking=0.0)"
    gate = cspace.Gate(room, dt=0.1, max_deceleration=(1.0, 0.5), max_velocity={"v": 1, "omega": 2})
    limits = "tracking=0.0, dt=0.1, max_velocity=[1.0, 2.0], max_deceleration=[1.0, 0.5]"
    assert repr(gate) == f"Gate({room!r}, {limits})"


FLAT = (1.0, 2.5)


@refusals(
    "call, message",
    (
        lambda s: certify_chunk(s, START, np.empty((0, 3))),
        "rows has shape (0, 3) ... batch",
    ),
    (lambda s: certify_chunk(s, START, [(1.0, 2.0)]), "rows has shape (1, 2) ... long"),
    (lambda s: certify_chunk(s, (1.0, math.nan, 0.0), [START]), "q[1] is nan"),
    (lambda s: certify_chunk(s, START, [START], -0.1), "tracking is -0.1 ... zero"),
    (lambda s: certify_chunk(s, START, [START], (0.1, 0.1)), "tracking has shape (2,) ... yaw"),
    (lambda s: certify_chunk(s, START, [START], math.nan), "tracking is nan"),
    (lambda s: certify_chunk(s, START, [START], dt=0.0, max_velocity=1.0), "above zero"),
    (lambda s: certify_twists(s, START, [(0.1, 0.1)], 0.1, max_velocity=(1, 1, 1)), "v, omega"),
    (lambda s: cspace.Gate(s, max_deceleration=(1.0, 0.0)), "max_deceleration of omega is 0"),
    (
        lambda s: cspace.Gate(s, max_deceleration=(1, 1, 1)),
        "max_deceleration has shape (3,) ... omega",
    ),
    (lambda s: cspace.Gate(s, dt=0.1, max_jerk=0.0), "max_jerk of x is 0.0"),
    (lambda s: cspace.Gate(s, dt=0.1, max_jerk=(1.0, 0.0)), "max_jerk of omega is 0.0"),
    (lambda s: cspace.Gate(s, dt=0.1, max_jerk={"x": 1.0, "y": 1.0, "jaw": 1.0}), "'yaw'?"),
    (lambda s: gentle(s).check_twists(START, [(0.1, 0.1)]), "max_jerk has shape (3,) ... omega"),
    (lambda s: gentle(s).check_rows(START, [START], before=[(1.0, math.inf, 0.0)]), "before[0, 1]"),
    (lambda s: braking(s).slow_down(START, (0.1, math.nan)), "twist[1] is nan"),
    (lambda s: braking(s).slow_down(START, (1, 0), twist_now=(1, 0, 0)), "shape (3,)"),
    (lambda s: braking(s).slow_down((1.0, 2.0), (1.0, 0.0)), "q has shape (2,) ... long"),
    (lambda s: braking(s).slow_down(START, (1, 0), twist_now=(1e16, 0)), "twist_now is"),
    (
        lambda s: braking(s).slow_down(START, (1e300, 0), twist_now=(1e300, 0)),
        "twist is [1e+300, 0.0] ... 100000",
    ),
    (lambda s: braking(s).stop_distance((0, -1e16)), "twist is [0.0, -1e+16] ... 100000"),
    (
        lambda s: certify_chunk(s, START, [START], max_velocity=1.0),
        "dt is missing ... speeds",
    ),
    (
        lambda s: certify_chunk(s, START, START),
        "rows has shape (3,) ... batch",
    ),
    (
        lambda s: certify_chunk(s, [START] * 2, [START]),
        "q has shape (2, 3) ... begins",
    ),
    (
        lambda s: certify_chunk(s, START, [[START]] * 2).refusal,
        "chunk is a batch of 2 ... tracking",
    ),
    (
        lambda s: cspace.Gate(s).check_twists(START, [(0.1, 0.1)]),
        "dt is missing ... driven",
    ),
    (
        lambda s: cspace.Gate(s, dt=0.1).slow_down(START, (0.1, 0.1)),
        "max_deceleration is missing ... able",
    ),
    (
        lambda s: cspace.Gate(s, dt=0.1, max_jerk=1.0, max_deceleration=(0.5, 1)),
        "max_jerk is 1.0, and max_deceleration (0.5, 1) ... acceleration",
    ),
    (
        lambda s: gentle(s).check_rows(START, [START], before=START),
        "before has shape (3,) ... latest",
    ),
    (
        lambda s: braking(s).stop_distance([(0.5, 0.0)]),
        "twist has shape (1, 2) ... rate",
    ),
    (
        lambda s: certify_twists(make_flat(0), FLAT, [(0.1, 0.1)], 0.1, max_velocity=1.0),
        "space has the axes x, y ... twists",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(room, call, message):
    check_refused(lambda: call(room), message)
