"""Queries of tiled maps: equality with the map in memory, caches and refusals."""

import itertools
import math
import pickle
import shutil
import threading
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import cspace
import cspace.tiles.cache
from cspace.errors import ConfigurationError, FileError, InputError
from cspace.store import Store
from cspace.tiles.cache import ChunkCache
from cspace.tiles.space import ONLY_IN_MEMORY
from tests.handmade import fill_boxes
from tests.laws.any_map import MAP_INPUTS
from tests.placements import draw_configurations
from tests.tiles.test_build import random_workspace


def build_both(name, folder, outside="blocked", tile=7, seed=0, two=False):
    """Build a map in memory and the same map in a store."""
    shape, robot, rotations = MAP_INPUTS[name]
    workspace, options = random_workspace(shape, seed, two), {"rotations": rotations, "outside": outside}
    space = cspace.build(workspace, robot, **options)
    return space, cspace.build(workspace, robot, store=folder / "m.zarr", tile=tile, **options)


def test_queries_with_any_cache_size_equal_the_map_in_memory(tmp_path):
    space, tiled = build_both("yaw in space", tmp_path, "free")
    rng = np.random.default_rng(1)
    q = draw_configurations(space, rng, 3000)
    near = q + rng.normal(size=q.shape) * rng.choice([0.1, 0.5, 3.0], (len(q), 1))
    assert 0.002 < space.motion_is_free(q, near).mean() < 0.99
    for limit in (1, 400, 2**29):  # holds one tile, a few tiles or all tiles
        tiled = cspace.TiledCSpace.open(tiled.path, cache_bytes=limit)
        np.testing.assert_array_equal(tiled.classify(q), space.classify(q))
        np.testing.assert_array_equal(tiled.motion_is_free(q, near), space.motion_is_free(q, near))
    assert (type(tiled.is_free(q[0])), type(tiled.classify(q[0]))) == (bool, int)


@pytest.mark.parametrize("name", MAP_INPUTS)
def test_clearance_equals_the_map_in_memory_up_to_its_maximum(name, tmp_path, monkeypatch):
    space, tiled = build_both(name, tmp_path, "free")
    q, dim, most = draw_configurations(space, np.random.default_rng(2), 60), space.grid.dim, 3 * space.grid.spacing
    monkeypatch.setattr("cspace.tiles.space.WINDOW_CELLS", {2: 48, 3: 48})
    loss = math.sqrt(dim) * space.grid.spacing
    assert (tiled.clearance(q) >= np.minimum(space.clearance(q) - loss, most)).all()
    q = q[space.grid.contains(q[:, :dim])]
    assert (tiled.clearance(q) <= np.minimum(space.clearance(q) + loss, most)).all()
    q[:, :dim] = space.grid.center_of(space.grid.cell_of(q[:, :dim]))  # where clearance is the distance
    expected = np.minimum(space.clearance(q), most)
    np.testing.assert_allclose(tiled.clearance(q), expected, atol=1e-12)
    assert 0.0 < np.mean(expected > 0.0) < 1.0
    assert tiled.clearance(q[0]) == pytest.approx(expected[0])


@pytest.mark.parametrize("limit", [1, 100, 2**29])
def test_cache_stays_within_its_memory_limit(limit):
    cache = ChunkCache((2, 40, 40), (1, 7, 7), limit, lambda number: np.full(49, number % 3, np.uint8))
    for number in np.random.default_rng(0).permutation(72).tolist():
        cache.begin()
        cache.load([number])
        assert cache.cells.packed.nbytes <= max(limit, 13) and cache.cells.places[number] >= 0


@pytest.mark.parametrize("name", ["plane", "yaw", "yaw in space"])
def test_slice_rotations_match_slice_of(name, tmp_path):
    space, tiled = build_both(name, tmp_path)
    for each in (space, tiled, pickle.loads(pickle.dumps(space))):
        assert each.slice_rotations.shape == (each.slice_of.max() + 1, space.size - space.grid.dim)
        full = np.hstack([np.zeros((len(each.slice_rotations), space.grid.dim)), each.slice_rotations])
        assert each.slice_of[each.rotations.find_cells(full)].tolist() == list(range(len(full)))
        with pytest.raises(ValueError):
            each.slice_of[0] = 7


def test_batches_split_into_pieces_equal_whole_batches(tmp_path, monkeypatch):
    space, tiled = build_both("yaw", tmp_path)
    q = draw_configurations(space, np.random.default_rng(1), 3000)
    edges = np.random.default_rng(2).integers(0, 3000, (2000, 2))
    whole = [tiled.classify(q), tiled.certify_path(q, edges), tiled.clearance(q[:300])]
    monkeypatch.setattr(cspace.tiles.cache, "ROWS_PER_PIECE", 77)
    pieces = [tiled.classify(q), tiled.certify_path(q, edges), tiled.clearance(q[:300])]
    for one, other in zip(whole, pieces, strict=True):
        np.testing.assert_array_equal(one, other)
    q[100, 0] = np.nan
    for look_up in (tiled.classify, tiled.clearance, lambda q: tiled.motion_is_free(q, q)):
        with pytest.raises(InputError, match="number 100 is"):
            look_up(q)


def test_large_roadmaps_are_copied_in_pieces(tmp_path):
    # The endpoints of two million edges take 96 MB, and a copy takes another 96 MB.
    space, tiled = build_both("yaw", tmp_path)
    vertices = draw_configurations(space, np.random.default_rng(1), 200)
    edges = np.random.default_rng(2).integers(0, 200, (2_000_000, 2))
    tiled.certify_path(vertices, edges[:10])
    tracemalloc.start()
    answers = tiled.certify_path(vertices, edges)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6
    np.testing.assert_array_equal(answers[:500], space.certify_path(vertices, edges[:500]))


def test_edge_queries_read_only_the_tiles_they_cross(tmp_path, monkeypatch):
    read, states = [], Store.states
    monkeypatch.setattr(Store, "states", lambda *what: read.append(what[1]) or states(*what))
    workspace = cspace.Workspace.from_array(np.zeros((100, 100), dtype=bool), 0.1)
    tiled = cspace.build(workspace, cspace.Robot.disc(0.1), store=tmp_path / "m", tile=10)
    assert tiled.motion_is_free([0.5, 0.5], [9.5, 9.45])
    assert len(read) == len(set(read)) <= 28
    workspace = cspace.Workspace.from_array(fill_boxes((100, 100), np.s_[15]), 0.1)
    tiled = cspace.build(workspace, cspace.Robot.disc(0.1), store=tmp_path / "w", tile=10)
    read.clear()
    assert not tiled.motion_is_free([0.5, 0.5], [9.5, 0.5])
    assert len(read) == 2  # the query stops at the wall


def test_opened_map_keeps_its_properties_and_refuses_exact_queries(tmp_path):
    space, _ = build_both("yaw", tmp_path)
    opened = cspace.open(tmp_path / "m.zarr")
    for each in (opened, pickle.loads(pickle.dumps(opened))):
        assert (each.grid, each.axes, each.outside, each.size) == (space.grid, space.axes, space.outside, space.size)
        assert (each.robot.spec, each.rotations) == (space.robot.spec, space.rotations)
    assert "tiles of 7 x 7" in repr(opened)
    for name in ("sample_free", "reachable_bounds", "cell_states"):
        with pytest.raises(ConfigurationError, match="window"):
            getattr(opened, name)
    with pytest.raises(ConfigurationError, match=r"add_obstacle needs a map in memory.*update"):
        opened.add_obstacle("cart", [(0.0, 0.0)], radius=0.1)
    q = np.zeros(3)
    for look_up in (opened.is_free, lambda q, **exact: opened.motion_is_free(q, q, **exact)):
        with pytest.raises(ConfigurationError, match=r"exact needs a map in memory.*window"):
            look_up(q, exact=True)
    with pytest.raises(AttributeError):
        opened.nothing_of_this_name  # noqa: B018


def test_methods_of_maps_in_memory_are_refused_and_documented(tmp_path):
    _, tiled = build_both("yaw", tmp_path)
    listed = {name: hint for names, hint in ONLY_IN_MEMORY.items() for name in names.split()}
    public = {name for name in dir(cspace.CSpace) if not name.startswith("_")}
    assert public - {name for name in dir(tiled) if hasattr(type(tiled), name)} == listed.keys()
    for name, hint in listed.items():
        with pytest.raises(ConfigurationError, match=f"{name} needs a map in memory") as caught:
            getattr(tiled, name)
        assert hint in str(caught.value)
    page = (Path(cspace.__file__).parents[1] / "docs" / "reference" / "stores.md").read_text(encoding="utf-8")
    assert not [name for name in listed if f"`{name}`" not in page]


@pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # robots may be larger than the map
def test_paths_of_tile_subproblems_form_a_certified_path(tmp_path):
    walls = fill_boxes((60, 40), np.s_[30:32, 7:])
    workspace = cspace.Workspace.from_array(walls, 0.1)
    space = cspace.build(workspace, cspace.Robot.disc(0.15))
    tiled = cspace.build(workspace, cspace.Robot.disc(0.15), store=tmp_path / "m", tile=15)
    start, goal, path = (0.7, 3.2), (5.3, 3.2), np.empty((0, 2))
    subproblems = tiled._tile_subproblems(start, goal)
    assert len(subproblems) > 3
    for open_part, first, last in subproblems:
        path = np.vstack([path, open_part().find_path(first, last)])
    assert path[[0, -1]].tolist() == [[*start], [*goal]] and space.certify_path(path).all()
    for q in ((3.1, 2.0), (-0.4, 1.0)):
        assert tiled.nearest_free(q) == pytest.approx(space.nearest_free(q))
    walls[30:32] = True
    workspace = cspace.Workspace.from_array(walls, 0.1)
    assert not cspace.build(workspace, cspace.Robot.disc(0.15), store=tmp_path / "o", tile=15)._tile_subproblems(
        start, goal
    )
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        cspace.build(workspace, cspace.Robot.disc(9.0), store=tmp_path / "n", tile=15).nearest_free(start)


def test_queries_reject_invalid_configurations(tmp_path):
    _, tiled = build_both("yaw", tmp_path)
    look_ups = tiled.classify, tiled.is_free, lambda q: tiled.motion_is_free(q, q), lambda q: tiled.certify_path([q, q])
    for q, look_up in itertools.product(([np.nan, 0.0, 0.0], [0.0, 0.0], [[0.0, 0.0, np.inf]]), look_ups):
        with pytest.raises(InputError):
            look_up(q)


@pytest.mark.parametrize("name", ["cell_states", "record", "zarr.json", "slice_of"])
def test_damaged_files_raise(name, tmp_path):
    space, _ = build_both("yaw", tmp_path)
    file = tmp_path / "m.zarr" / name
    file = (
        file
        if file.is_file()
        else next(iter(sorted(part for part in file.rglob("*") if part.is_file() and "c" in part.parts)))
    )
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(FileError, match="usable map"):
        opened = cspace.open(tmp_path / "m.zarr")
        opened.classify(draw_configurations(space, np.random.default_rng(0), 500))
    file.unlink()
    with pytest.raises(FileError):
        opened = cspace.open(tmp_path / "m.zarr")
        opened.classify(draw_configurations(space, np.random.default_rng(0), 500))


def test_swapped_chunks_raise(tmp_path):
    space, tiled = build_both("plane", tmp_path)
    first, last = (tmp_path / "m.zarr" / "cell_states" / "c" / "0" / part for part in ("0/0", "3/2"))
    one, two = first.read_bytes(), last.read_bytes()
    assert one != two
    first.write_bytes(two)
    with pytest.raises(FileError, match="digest"):
        tiled.classify(np.array(space.grid.lower) + 0.05)


@pytest.mark.parametrize("source", ["m.zarr", "other.zarr"])
def test_records_of_other_tiles_and_maps_raise(source, tmp_path):
    """Replace a tile and its record, so that the tile matches the digests of that record."""
    space, _ = build_both("plane", tmp_path)
    cspace.build(space.workspace, cspace.Robot.disc(0.01), store=tmp_path / "other.zarr", tile=7)
    folder = shutil.copytree(tmp_path / "m.zarr", tmp_path / "damaged.zarr")
    tile = "3/2" if source == "m.zarr" else "0/0"
    for file in ("cell_states/c/0/{}", "outer/c/{}", "record/c/{}/0"):
        shutil.copy(tmp_path / source / file.format(tile), folder / file.format("0/0"))
    with pytest.raises(FileError, match=r"its record of tile \(0, 0\) is damaged, or of another tile or map"):
        cspace.open(folder).classify(np.array(space.grid.lower) + 0.05)


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
