"""Motions on tiled maps: cut at the borders of tiles, and proven piece by piece."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from tests.helpers.handmade import fill_boxes
from tests.helpers.placements import draw_configurations
from tests.laws.any_map import CAR, MAP_INPUTS
from tests.tiles.test_build import random_workspace
from tests.tiles.test_space import build_both


def move(space, q, rng):
    """Return other ends of motions from configurations, near and far."""
    ends = q + rng.normal(size=q.shape) * rng.choice([0.1, 0.5, 3.0], (len(q), 1))
    if "qw" in space.axes:
        ends[:, 3:] /= np.linalg.norm(ends[:, 3:], axis=1)[:, None]
    return ends


@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("name", MAP_INPUTS)
def test_motions_equal_the_map_in_memory(name, outside, tmp_path):
    space, tiled = build_both(name, tmp_path, outside)
    rng = np.random.default_rng(1)
    q = draw_configurations(space, rng, 2000)
    ends = move(space, q, rng)
    ours, theirs = tiled.motion_is_free(q, ends), space.motion_is_free(q, ends)
    # A motion that begins on the border of the grid and leaves it touches cells outside, which a
    # map in memory ignores in the part of the motion before it leaves the first rotation cell.
    dim = space.grid.dim
    from_border = (
        np.isclose(q[:, :dim], space.grid.lower) | np.isclose(q[:, :dim], space.grid.upper)
    ).any(axis=1)
    assert not (ours & ~theirs).any()
    np.testing.assert_array_equal(ours[~from_border], theirs[~from_border])
    assert theirs.any() == ours.any() and not theirs.all()


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**16),
    tile=st.integers(2, 30),
    rotations=st.sampled_from([None, 1, 3, 8]),
    outside=st.sampled_from(["blocked", "free"]),
)
def test_motions_equal_the_map_in_memory_for_any_tile(
    seed, tile, rotations, outside, tmp_path_factory
):
    rng, path = np.random.default_rng(seed), tmp_path_factory.mktemp("any") / "m"
    workspace = random_workspace(rng.integers(1, 40, 2), seed)
    options = {"rotations": rotations, "outside": outside}
    space = cspace.build(workspace, CAR, **options)
    tiled = cspace.build(workspace, CAR, store=path, tile=tile, **options)
    q, ends = rng.uniform(-6.0, 9.0, (2, 400, space.size))
    near = move(space, q, rng)
    for first, last in ((q, ends), (q, near)):
        np.testing.assert_array_equal(
            tiled.motion_is_free(first, last), space.motion_is_free(first, last)
        )


@pytest.mark.parametrize("name", ["yaw", "yaw in space", "quaternions"])
def test_a_motion_by_half_a_turn_is_free_if_both_arcs_are(name, tmp_path):
    space, tiled = build_both(name, tmp_path, "free")
    rng, dim = np.random.default_rng(0), space.grid.dim
    q = draw_configurations(space, rng, 800)
    ends = q + rng.normal(size=q.shape) * rng.choice([0.2, 2.0], (len(q), 1))
    if name == "quaternions":
        x, y, z, w = q[:, dim:].T
        ends[:, dim:] = np.stack(
            [w, z, -y, -x], axis=1
        )  # turned by half a turn about the x axis of the robot
    else:
        ends[:, dim:] = q[:, dim:] + np.pi * rng.choice([-1, 1], (len(q), 1))
    for nudge in (0.0, 1e-12, 1e-8, 1e-5):
        last = ends.copy()
        last[:, dim] += nudge
        if name == "quaternions":
            last[:, dim:] /= np.linalg.norm(last[:, dim:], axis=1)[:, None]
        ours, theirs = tiled.motion_is_free(q, last), space.motion_is_free(q, last)
        assert not (ours & ~theirs).any() and ours.any()
        assert np.mean(ours != theirs) < 0.01


def test_a_thin_wall_at_a_border_of_tiles_stops_motions(tmp_path):
    # The wall is the last layer of a tile, the first one of the next, or both.
    for number, wall in enumerate((np.s_[9], np.s_[10], np.s_[9:11])):
        workspace = cspace.Workspace.from_array(fill_boxes((30, 30), wall), 0.1)
        options = {"store": tmp_path / f"m{number}", "tile": 10, "outside": "free"}
        tiled = cspace.build(workspace, cspace.Robot.disc(0.01), **options)
        q = np.random.default_rng(0).uniform(0.0, 3.0, (300, 2))
        ends = q[::-1]
        apart = (q[:, 0] < 0.95) != (ends[:, 0] < 0.95)
        assert apart.any() and not tiled.motion_is_free(q, ends)[apart].any()


def test_motions_along_and_through_borders_and_corners_of_tiles_are_free(tmp_path):
    workspace = cspace.Workspace.from_array(np.zeros((40, 40), dtype=bool), 0.1)
    tiled = cspace.build(
        workspace, cspace.Robot.disc(0.01), store=tmp_path / "m", tile=10, outside="free"
    )
    for ends in (
        ([1.0, 0.0], [1.0, 4.0]),  # along a border
        ([0.0, 0.0], [4.0, 4.0]),  # through corners
        ([0.0, 2.0], [4.0, 2.0]),
        ([2.0, 2.0], [2.0, 2.0]),  # at a corner
        ([-50.0, -3.0], [60.0, 7.0]),  # from far outside to far outside
        ([1e9, 1.0], [-1e9, 1.0]),
    ):
        assert tiled.motion_is_free(*ends) == cspace.build(
            workspace, cspace.Robot.disc(0.01), outside="free"
        ).motion_is_free(*ends)


def test_a_motion_between_nearly_equal_quaternions_is_free_at_both_everywhere(tmp_path):
    # OMPL may keep the first rotation all along, so a motion in tiles must have both everywhere.
    occupied = fill_boxes((30, 30, 24), np.s_[13:17, 13:17, :])
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    robot, rotations = cspace.Robot.box((0.8, 0.2, 0.1)), cspace.Rotations.quaternions(4)
    space = cspace.build(workspace, robot, rotations=rotations)
    tiled = cspace.build(workspace, robot, rotations=rotations, store=tmp_path / "m", tile=10)
    border = rotations.borders[3]
    before, after = (
        np.array([0.1, 0.3, border + side, 1.0]) / np.linalg.norm([0.1, 0.3, border + side, 1.0])
        for side in (-4e-6, 4e-6)
    )
    places = np.random.default_rng(0).uniform(0.5, (2.5, 2.5, 1.9), (20_000, 3))
    starts = np.hstack([places, np.tile(before, (len(places), 1))])
    ends = np.hstack([places[::-1], np.tile(after, (len(places), 1))])
    ours, theirs = tiled.motion_is_free(starts, ends), space.motion_is_free(starts, ends)
    assert theirs.any() and not (ours & ~theirs).any()
