"""Queries of tiled maps: equality with the map in memory, caches and refusals."""

import itertools
import pickle
import threading

import numpy as np
import pytest

import cspace
from cspace.errors import ConfigurationError, InputError
from tests.helpers.handmade import fill_boxes
from tests.helpers.placements import draw_configurations
from tests.laws.any_map import MAP_INPUTS
from tests.tiles.test_build import random_workspace

FOREIGN = {
    *("workspace", "overlap_counts", "cell_states"),
    *("states_at", "overlap_count", "contains_robot", "obstacle_distance"),
    *("reachable_bounds", "find_path", "find_widest_path"),
    *("sample_free", "save", "export"),
    *("to_xarray", "to_occupancy_grid", "to_costmap", "add_obstacle"),
    *("kernel_map", "distances", "find_cheap_path"),
    *("obstacles", "remove_obstacle", "update"),
}
"""Names of maps in memory that tiled maps lack."""


def build_both(name, folder, outside="blocked", tile=7, seed=0, two=False):
    """Build a map in memory and the same map in tiles."""
    shape, robot, rotations = MAP_INPUTS[name]
    workspace, options = (
        random_workspace(shape, seed, two),
        {"rotations": rotations, "outside": outside},
    )
    space = cspace.build(workspace, robot, **options)
    return space, cspace.build(workspace, robot, store=folder / "m.zarr", tile=tile, **options)


@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("name", MAP_INPUTS)
def test_queries_equal_the_map_in_memory(name, outside, tmp_path):
    space, tiled = build_both(name, tmp_path, outside)
    rng = np.random.default_rng(1)
    q = draw_configurations(space, rng, 1500)
    np.testing.assert_array_equal(tiled.classify(q), space.classify(q))
    np.testing.assert_array_equal(tiled.is_free(q), space.is_free(q))
    for distance, angle in (
        (0.0, 0.0),
        (0.05, 0.2),
        (0.13, 0.0),
        (0.6, 1.0),
    ):  # also beyond the halo
        around = space.is_free_around(q[:300], distance, angle)
        np.testing.assert_array_equal(tiled.is_free_around(q[:300], distance, angle), around)


@pytest.mark.parametrize("name", MAP_INPUTS)
def test_clearance_equals_the_map_in_memory_up_to_the_halo(name, tmp_path):
    space, tiled = build_both(name, tmp_path, "free")
    q, dim = draw_configurations(space, np.random.default_rng(2), 300), space.grid.dim
    most, loss = (tiled.halo - 2) * space.grid.spacing, np.sqrt(dim) * space.grid.spacing
    assert (tiled.clearance(q) >= np.minimum(space.clearance(q) - loss, most)).all()
    q = q[space.grid.contains(q[:, :dim])]
    assert (tiled.clearance(q) <= np.minimum(space.clearance(q) + loss, most)).all()
    q[:, :dim] = space.grid.center_of(
        space.grid.cell_of(q[:, :dim])
    )  # where clearance is the distance
    expected = np.minimum(space.clearance(q), most)
    np.testing.assert_allclose(tiled.clearance(q), expected, atol=1e-12)
    assert 0.0 < np.mean(expected > 0.0) < 1.0
    assert tiled.clearance(q[0]) == pytest.approx(expected[0])


def test_queries_with_any_cache_size_equal_the_map_in_memory(tmp_path):
    space, tiled = build_both("yaw in space", tmp_path, "free")
    q = draw_configurations(space, np.random.default_rng(1), 1000)
    for limit in (1, 20_000, 2**29):  # holds one tile, a few tiles or all tiles
        opened = cspace.TiledCSpace.open(tiled.path, cache_bytes=limit)
        np.testing.assert_array_equal(opened.classify(q), space.classify(q))
    one = q[0].tolist()
    assert (type(tiled.is_free(one)), type(tiled.classify(one))) == (bool, int)
    assert (type(tiled.is_free(q[0])), type(tiled.classify(q[0]))) == (np.bool_, np.uint8)


@pytest.mark.parametrize("name", ["plane", "yaw", "yaw in space"])
def test_slice_rotations_match_slice_of(name, tmp_path):
    space, tiled = build_both(name, tmp_path)
    for each in (space, tiled, pickle.loads(pickle.dumps(space))):
        assert each.slice_rotations.shape == (each.slice_of.max() + 1, space.size - space.grid.dim)
        full = np.hstack(
            [np.zeros((len(each.slice_rotations), space.grid.dim)), each.slice_rotations]
        )
        assert each.slice_of[each.rotations.find_cells(full)].tolist() == list(range(len(full)))
        with pytest.raises(ValueError, match="read-only"):
            each.slice_of[0] = 7


def test_errors_name_the_first_unusable_row(tmp_path):
    space, tiled = build_both("yaw", tmp_path)
    q = draw_configurations(space, np.random.default_rng(1), 3000)
    q[100, 0] = np.nan
    for look_up in (tiled.classify, tiled.clearance, lambda q: tiled.motion_is_free(q, q)):
        with pytest.raises(InputError, match="number 100 is"):
            look_up(q)


def test_motions_read_only_the_tiles_they_cross(tmp_path):
    # All other tiles are gone.
    workspace = cspace.Workspace.from_array(np.zeros((100, 100), dtype=bool), 0.1)
    tiled = cspace.build(workspace, cspace.Robot.disc(0.1), store=tmp_path / "m", tile=10)
    for x, y in itertools.product(range(10), repeat=2):
        if y not in (4, 5):
            (tmp_path / "m" / f"{x}.{y}" / "zarr.json").unlink()
    assert tiled.motion_is_free([0.5, 4.5], [9.5, 5.5])


def test_opened_map_keeps_its_properties_and_lacks_names_of_maps_in_memory(tmp_path):
    space, _ = build_both("yaw", tmp_path)
    opened = cspace.open(tmp_path / "m.zarr")
    for each in (opened, pickle.loads(pickle.dumps(opened))):
        assert (each.grid, each.axes, each.outside, each.size) == (
            space.grid,
            space.axes,
            space.outside,
            space.size,
        )
        assert (each.robot.spec, each.rotations, each.margin) == (
            space.robot.spec,
            space.rotations,
            space.margin,
        )
    assert "tiles of 7 x 7" in repr(opened)
    public = {name for name in dir(cspace.CSpace) if not name.startswith("_")}
    assert public - set(dir(opened)) == FOREIGN
    assert not [
        name for name in dir(opened) if not name.startswith("_") and not hasattr(opened, name)
    ]
    for look_up in (opened.is_free, lambda q, **exact: opened.motion_is_free(q, q, **exact)):
        with pytest.raises(ConfigurationError, match=r"exact needs a map in memory.*window"):
            look_up(np.zeros(3), exact=True)


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # one robot is larger than the map
def test_paths_of_tile_subproblems_form_a_certified_path(tmp_path):
    walls = fill_boxes((60, 40), np.s_[30:32, 7:])
    workspace = cspace.Workspace.from_array(walls, 0.1)
    space = cspace.build(workspace, cspace.Robot.disc(0.15))
    tiled = cspace.build(workspace, cspace.Robot.disc(0.15), store=tmp_path / "m", tile=15)
    start, goal, path = (0.7, 3.2), (5.3, 3.2), np.empty((0, 2))
    subproblems = tiled.subproblems(start, goal)
    assert len(subproblems) > 3
    for open_part, first, last in subproblems:
        path = np.vstack([path, open_part().find_path(first, last)])
    assert path[[0, -1]].tolist() == [[*start], [*goal]] and space.certify_path(path).all()
    for q in ((3.1, 2.0), (-0.4, 1.0)):
        ours, theirs = tiled.nearest_free(q), space.nearest_free(q)
        assert np.linalg.norm(ours - q) == pytest.approx(
            np.linalg.norm(theirs - q)
        ) and space.is_free(ours)
    walls[30:32] = True
    workspace = cspace.Workspace.from_array(walls, 0.1)
    assert not cspace.build(
        workspace, cspace.Robot.disc(0.15), store=tmp_path / "o", tile=15
    ).subproblems(start, goal)
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        cspace.build(workspace, cspace.Robot.disc(9.0), store=tmp_path / "n", tile=15).nearest_free(
            start
        )


@pytest.mark.parametrize(
    "q", [[np.nan, 0.0, 0.0], [0.0, 0.0], [[0.0, 0.0, np.inf]], [0.0, 0.0, 1e9]], ids=str
)
def test_queries_reject_invalid_configurations(tmp_path, q):
    _, tiled = build_both("yaw", tmp_path)
    for look_up in (
        tiled.classify,
        tiled.is_free,
        tiled.clearance,
        lambda q: tiled.motion_is_free(q, q),
        lambda q: tiled.certify_path([q, q]),
        lambda q: tiled.is_connected(q, q),
        lambda q: tiled.is_free_around(q, 0.1),
    ):
        with pytest.raises(InputError):
            look_up(q)


def test_concurrent_queries_equal_serial_ones(tmp_path):
    space, _ = build_both("plane", tmp_path)
    tiled = cspace.TiledCSpace.open(tmp_path / "m.zarr", cache_bytes=60)
    q = draw_configurations(space, np.random.default_rng(0), 400)
    expected, wrong = space.classify(q), []

    def query_part(k):
        part = slice(100 * k, 100 * k + 100)
        if not np.array_equal(tiled.classify(q[part]), expected[part]):
            wrong.append(k)

    threads = [threading.Thread(target=query_part, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
