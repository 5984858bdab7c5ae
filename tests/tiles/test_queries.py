"""Queries of tiled maps: equality with the map in memory, caches and refusals."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace._rotations.lookup import OMPL_EQUALITY_SLACK
from cspace._tiles.motions import TINY_ARC_SLACK
from tests.helpers.handmade import build_empty, fill_boxes
from tests.helpers.maps import proven_paths
from tests.helpers.placements import draw_configurations, is_free_around
from tests.helpers.strategies import examples, few
from tests.tiles.worlds import CAR, KINDS, build_kind, build_pair, check_states, random_workspace


def check_lookups(pair, rng, n):
    """Compare states, and proofs of boxes within the halo and beyond it."""
    q = draw_configurations(pair.space, rng, n, far=True)
    np.testing.assert_array_equal(pair.tiled.classify(q), pair.space.classify(q))
    np.testing.assert_array_equal(pair.tiled.is_free(q), pair.space.is_free(q))
    # Points on the border of the grid are FREE in memory by the cells inside alone.
    for distance, angle in ((1e-6, 0.0), (0.13, 0.2), (0.6, 1.0)):
        expected = is_free_around(pair.space, q[:300], distance, angle)
        actual = is_free_around(pair.tiled, q[:300], distance, angle)
        np.testing.assert_array_equal(actual, expected)
    # One at a time, a tile is asked without arrays.
    few = q[:300].tolist()
    states = pair.space.classify(q[:300])
    assert [pair.tiled.classify(tuple(one)) for one in few] == states.tolist()
    check = pair.tiled.point_checker()
    assert [check(*one) for one in few] == (states == cspace.FREE).tolist()


def draw_motions(space, rng, n):
    """Draw short and long motions."""
    starts = draw_configurations(space, rng, n, far=True)
    steps = rng.normal(size=starts.shape) * rng.choice([0.1, 0.5, 3.0], (n, 1))
    ends = starts + steps
    if "qw" in space.axes:
        ends[:, 3:] /= np.linalg.norm(ends[:, 3:], axis=1, keepdims=True)
    return starts, ends


def check_motions(pair, starts, ends):
    """Compare proofs of motions.

    A motion that begins on the border of the grid and leaves it touches cells outside, which a map
    in memory ignores in the part of the motion before it leaves the first rotation cell.
    """
    grid = pair.space.grid
    positions = starts[:, : grid.dim]
    on_border = np.isclose(positions, grid.lower) | np.isclose(positions, grid.upper)
    inner = ~on_border.any(axis=1)
    actual = pair.tiled.motion_is_free(starts, ends)
    expected = pair.space.motion_is_free(starts, ends)
    assert not (actual & ~expected).any()
    np.testing.assert_array_equal(actual[inner], expected[inner])


def check_connectivity(pair, rng, n):
    """Compare proofs that paths exist, and that none exist."""
    q0, q1 = draw_configurations(pair.space, rng, 2 * n).reshape(2, n, -1)
    expected = proven_paths(pair.space, q0, q1)
    np.testing.assert_array_equal(proven_paths(pair.tiled, q0, q1), expected)
    assert proven_paths(pair.tiled, q0[0], q1[0]) is expected[0]


@pytest.fixture(
    scope="module",
    params=few(
        [(each,) for each in zip(2 * list(KINDS), itertools.cycle(["blocked", "free"]))],
        len(KINDS),
    ),
    ids="-".join,
)
def pair(request, tmp_path_factory):
    kind, outside = request.param
    return build_kind(kind, tmp_path_factory.mktemp("pair") / "m", outside)


def test_answers_equal_the_map_in_memory(pair):
    rng = np.random.default_rng(0)
    check_states(Path(pair.tiled.path), pair.space)
    check_lookups(pair, rng, 300)
    check_motions(pair, *draw_motions(pair.space, rng, 500))
    check_connectivity(pair, rng, 200)


def test_a_robot_may_turn_outside_the_map(tmp_path):
    # It fits into either slot lengthwise, and leaves one at the left and the other at the top.
    slots = np.s_[:8, 5:9], np.s_[11:15, 6:]
    occupied = fill_boxes((18, 14), np.s_[:, :], but=slots)
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    robot = cspace.Robot.rectangle(0.9, 0.3)
    pair = build_pair(workspace, robot, tmp_path / "m", rotations=36, outside="free")
    for space in pair:
        assert not space.is_disconnected((0.3, 0.7, 0.0), (1.3, 1.1, np.pi / 2))


def test_clearances_equal_the_map_in_memory_up_to_the_halo(pair):
    space, tiled = pair
    grid = space.grid
    q = draw_configurations(space, np.random.default_rng(3), 300)
    q = q[grid.contains(q[:, : grid.dim])]
    most = (min(64, max(4, min(tiled.tile) // 16)) - 2) * grid.spacing
    loss = np.sqrt(grid.dim) * grid.spacing
    actual = tiled.clearance(q)
    exact = space.clearance(q)
    assert (actual >= np.minimum(exact - loss, most)).all()
    assert (actual <= np.minimum(exact + loss, most)).all()
    # At the center of a cell, the clearance is the distance.
    q[:, : grid.dim] = grid.center_of(grid.cell_of(q[:, : grid.dim]))
    expected = np.minimum(space.clearance(q), most)
    np.testing.assert_allclose(tiled.clearance(q), expected, atol=1e-12)


@examples(20)
@given(
    seed=st.integers(0, 2**16),
    shape=st.tuples(st.integers(1, 24), st.integers(1, 24)),
    tile=st.tuples(st.integers(2, 30), st.integers(2, 30)),
    robot=st.sampled_from([CAR, cspace.Robot.rectangle(0.16, 0.02)]),
    density=st.sampled_from([0.01, 0.3, 0.5]),
    two=st.booleans(),
    options=st.fixed_dictionaries(
        {
            "rotations": st.sampled_from([None, 1, 6]),
            "outside": st.sampled_from(["blocked", "free"]),
            "margin": st.sampled_from([0.0, 0.43]),
            "inner": st.booleans(),
            "method": st.sampled_from(["fft", "direct"]),
        }
    ),
)
@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
def test_any_plane_map_in_any_tiles_equals_the_map_in_memory(
    seed, shape, tile, robot, density, two, options, tmp_path_factory
):
    rng = np.random.default_rng(seed)
    workspace = random_workspace(shape, seed, two, density)
    store = tmp_path_factory.mktemp("any") / "m"
    pair = build_pair(workspace, robot, store, tile, **options)
    check_states(store, pair.space)
    check_lookups(pair, rng, 200)
    check_motions(pair, *draw_motions(pair.space, rng, 300))
    check_connectivity(pair, rng, 200)


@pytest.mark.parametrize("kind", ["yaw", "yaw in space", "quaternions"])
def test_a_motion_by_half_a_turn_is_free_if_both_arcs_are(kind, tmp_path):
    space, tiled = build_kind(kind, tmp_path / "m", "free")
    dim = space.grid.dim
    rng = np.random.default_rng(0)
    starts = draw_configurations(space, rng, 300)
    ends = starts + rng.normal(size=starts.shape) * rng.choice([0.2, 2.0], (300, 1))
    if kind == "quaternions":
        x, y, z, w = starts[:, dim:].T
        ends[:, dim:] = np.stack([w, z, -y, -x], axis=1)  # turned about the robot's x axis
    else:
        ends[:, dim:] = starts[:, dim:] + np.pi * rng.choice([-1, 1], (300, 1))
    for nudge in (0.0, 1e-12, 1e-8, 1e-5):
        last = ends.copy()
        last[:, dim] += nudge
        if kind == "quaternions":
            last[:, dim:] /= np.linalg.norm(last[:, dim:], axis=1, keepdims=True)
        actual = tiled.motion_is_free(starts, last)
        expected = space.motion_is_free(starts, last)
        assert not (actual & ~expected).any()
        assert np.mean(actual != expected) < 0.01


@pytest.mark.thorough
def test_a_motion_between_nearly_equal_quaternions_is_free_at_both_everywhere(tmp_path):
    # OMPL may keep the first rotation all along, so a motion in tiles must have both everywhere.
    occupied = fill_boxes((30, 30, 24), np.s_[13:17, 13:17, :])
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    rotations = cspace.Rotations.quaternions(4)
    robot = cspace.Robot.box((0.8, 0.2, 0.1))
    space, tiled = build_pair(workspace, robot, tmp_path / "m", tile=10, rotations=rotations)
    positions = np.random.default_rng(0).uniform(0.5, (2.5, 2.5, 1.9), (2000, 3))
    q = np.zeros((2, len(positions), 7))
    for end, side in enumerate((-4e-6, 4e-6)):
        quaternion = np.array([0.1, 0.3, rotations.borders[3] + side, 1.0])
        q[end, :, :3] = positions[:: 1 - 2 * end]
        q[end, :, 3:] = quaternion / np.linalg.norm(quaternion)
    expected = space.motion_is_free(*q)
    assert expected.any() and not (tiled.motion_is_free(*q) & ~expected).any()


def test_tiles_take_quaternions_as_equal_if_ompl_does_and_only_if_the_look_up_does():
    # OMPL's 1e-9 is 3e-9 between unit quaternions, because the norms of its own are off by 1e-9.
    rounding = 1e-14
    assert 3e-9 + rounding < TINY_ARC_SLACK < OMPL_EQUALITY_SLACK - rounding


def test_motions_read_only_the_tiles_they_cross(tmp_path):
    tiled = build_empty((100, 100), cspace.Robot.disc(0.1), store=tmp_path / "m", tile=10)
    for x, y in itertools.product(range(10), repeat=2):
        if y not in (4, 5):
            (tmp_path / "m" / f"{x}.{y}" / "zarr.json").unlink()
    assert tiled.motion_is_free([0.5, 4.5], [9.5, 5.5])


@pytest.mark.parametrize("cache_bytes", [1, 20_000], ids=["one tile", "some tiles"])
def test_threads_with_a_small_cache_equal_the_map_in_memory(tmp_path, cache_bytes):
    space, _ = build_kind("yaw", tmp_path / "m")
    tiled = cspace.open(tmp_path / "m", cache_bytes=cache_bytes)
    q = draw_configurations(space, np.random.default_rng(0), 100)
    with ThreadPoolExecutor(4) as threads:
        answers = list(threads.map(tiled.classify, np.split(q, 4)))
    np.testing.assert_array_equal(np.concatenate(answers), space.classify(q))


@pytest.fixture(scope="module")
def walled(tmp_path_factory):
    """Build two rooms with a door."""
    workspace = cspace.Workspace.from_array(fill_boxes((60, 40), np.s_[30:32, 7:]), 0.1)
    store = tmp_path_factory.mktemp("walled") / "m"
    return build_pair(workspace, cspace.Robot.disc(0.15), store, tile=15)


def test_the_nearest_free_configuration_is_that_of_the_map_in_memory(walled):
    for q in ((3.1, 2.0), (-0.4, 1.0)):
        nearest = walled.tiled.nearest_free(q)
        distance = np.linalg.norm(walled.space.nearest_free(q) - q)
        assert np.linalg.norm(nearest - q) == pytest.approx(distance)
        assert walled.space.is_free(nearest)
