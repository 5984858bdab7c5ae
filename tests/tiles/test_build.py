"""Tiled builds: interruptions, damaged folders and refusals."""

import json
import multiprocessing
import os
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import shapely

import cspace
from cspace.errors import FileError, InputError
from tests.helpers.waiting import until
from tests.soak.files import reseal
from tests.tiles.worlds import (
    CAR,
    check_states,
    check_tiles,
    find_tiles,
    random_workspace,
)

# ---- interruptions -------------------------------------------------------------------------------


def start_and_kill_build(workspace, path, tiles, seconds):
    """Build in a child; kill it some time after it has more tiles, or ends."""

    def build():
        cspace.build(workspace, CAR, rotations=8, store=path, tile=64, workers=2)

    child = multiprocessing.get_context("fork").Process(target=build)
    child.start()
    until(lambda: not child.is_alive() or (path.exists() and len(find_tiles(path)) > tiles))
    time.sleep(seconds)
    os.kill(child.pid, signal.SIGKILL)
    child.join()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_killed_builds_resume_without_rebuilding_tiles(tmp_path):
    workspace = random_workspace((600, 500))
    space = cspace.build(workspace, CAR, rotations=8)
    path = tmp_path / "m"
    inodes = {}
    rng = np.random.default_rng(0)
    for _ in range(6):
        start_and_kill_build(workspace, path, len(inodes), rng.uniform(0.0, 0.03))
        tiled = cspace.open(path)
        if tiled.progress < 1.0:
            with pytest.raises(FileError, match="done"):
                tiled.classify([0.0, 0.0, 0.0])
        check_tiles(path, space)
        for name, tile in find_tiles(path).items():
            assert inodes.setdefault(name, tile.stat().st_ino) == tile.stat().st_ino
    cspace.build(workspace, CAR, rotations=8, store=path, tile=64)
    check_states(path, space)
    tiles = find_tiles(path)
    assert all(tiles[name].stat().st_ino == inode for name, inode in inodes.items())
    assert not list(path.rglob(".cspace-*"))


# ---- damaged and forged folders ------------------------------------------------------------------

IN_TILE_0_0 = (0.1, 0.1, 0.0)
IN_TILE_0_1 = (0.1, 1.2, 0.0)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build maps of a car and of a disc in the same workspace."""
    folder = tmp_path_factory.mktemp("built")
    workspace = cspace.Workspace.from_array(random_workspace((20, 33)).outer, 0.1)
    for name, robot in (("m", CAR), ("other", cspace.Robot.disc(0.01))):
        cspace.build(workspace, robot, rotations=4, store=folder / name, tile=8)
    return folder


@pytest.fixture
def path(built, tmp_path):
    return shutil.copytree(built / "m", tmp_path / "m")


def flip_bit(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def truncate(file):
    os.truncate(file, file.stat().st_size // 2)


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("frame/zarr.json", flip_bit),
        ("frame/slice_of/c/0", truncate),
        ("frame/exterior/c/0/0", Path.unlink),
    ],
)
def test_open_refuses_damaged_shared_files(path, name, damage):
    damage(path / name)
    with pytest.raises(FileError):
        cspace.open(path)


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("zarr.json", Path.unlink),
        ("cell_states/c/0/0/0", flip_bit),
        ("outer/c/0/0", truncate),
    ],
)
def test_queries_refuse_damaged_tiles(path, name, damage):
    damage(path / "0.1" / name)
    tiled = cspace.open(path)
    tiled.classify(IN_TILE_0_0)
    with pytest.raises(FileError):
        tiled.classify(IN_TILE_0_1)


@pytest.mark.parametrize("source", ["m/0.2", "other/0.1"])
def test_queries_refuse_tiles_of_other_places_and_maps(built, path, source):
    shutil.rmtree(path / "0.1")
    shutil.copytree(built / source, path / "0.1")
    with pytest.raises(FileError, match="it is a tile of another"):
        cspace.open(path).classify(IN_TILE_0_1)


def test_a_build_does_not_complete_a_map_with_a_tile_of_another_one(built, path):
    # As from a worker that still builds a map whose folder was replaced.
    workspace = cspace.Workspace.from_array(random_workspace((20, 33)).outer, 0.1)
    shutil.rmtree(path / "frame")
    shutil.rmtree(path / "0.1")
    shutil.copytree(built / "other" / "0.1", path / "0.1")
    with pytest.raises(FileError, match="tile of another map"):
        cspace.build(workspace, CAR, rotations=4, store=path, tile=8)
    shutil.rmtree(path / "0.1")
    cspace.build(workspace, CAR, rotations=4, store=path, tile=8)
    check_states(path, cspace.build(workspace, CAR, rotations=4))


@pytest.mark.parametrize(
    "tiles",
    [None, {"shape": [20]}, {"shape": [20, 0]}, {"shape": [20, "b"]}, {"side": [-8, -8]}],
    ids=str,
)
def test_open_refuses_forged_sizes(path, tiles):
    attributes = json.loads((path / "frame" / "zarr.json").read_bytes())["attributes"]
    reseal(path / "frame", tiles=tiles and {**attributes["tiles"], **tiles})
    with pytest.raises(FileError):
        cspace.open(path)


# ---- refusals ------------------------------------------------------------------------------------

BOUNDS = (0.0, 0.0, 1.0, 1.0)
SQUARE = cspace.Workspace.from_polygons([shapely.box(0.2, 0.2, 0.5, 0.5)], 0.1, BOUNDS)
LARGER = cspace.Workspace.from_polygons([shapely.box(0.2, 0.2, 0.5001, 0.5)], 0.1, BOUNDS)
TURNS = [0.0, 1.0, 3.0, 2 * np.pi]


@pytest.mark.parametrize(
    "changed",
    [
        {"workspace": LARGER},
        {"workspace": cspace.Workspace.from_array(~SQUARE.outer, 0.1)},
        {"workspace": cspace.Workspace.from_array(SQUARE.outer, 0.1, (0.1, 0.1))},
        {"robot": cspace.Robot.disc(0.1)},
        {"rotations": [0.0, 2.0, 3.0, 2 * np.pi]},
        {"margin": 0.1},
        {"tile": 3},
        {"outside": "free"},
        {"inner": False},
    ],
    ids=["shape", "cells", "place", "robot", "rotations", "margin", "tile", "outside", "inner"],
)
def test_builds_resume_only_the_same_map(tmp_path, changed):
    assert (SQUARE.outer == LARGER.outer).all()
    given = {"workspace": SQUARE, "robot": CAR, "rotations": TURNS, "tile": 4}
    cspace.build(**given, store=tmp_path / "m")
    cspace.build(**given, store=tmp_path / "m", method="fft", workers=1)
    with pytest.raises(FileError, match="holds another map"):
        cspace.build(**given | changed, store=tmp_path / "m")


@pytest.mark.parametrize("tile", [0, 2.5, (4, 4, 4), None, (3, 0)])
def test_builds_refuse_invalid_tiles(tile, tmp_path):
    with pytest.raises(InputError, match="tile"):
        cspace.build(SQUARE, CAR, store=tmp_path / "m", tile=tile)
    assert not (tmp_path / "m").exists()


def test_builds_refuse_counts_and_folders_that_hold_something_else(tmp_path):
    with pytest.raises(InputError, match="counts"):
        cspace.build(SQUARE, CAR, store=tmp_path / "m", counts=True)
    cspace.build(SQUARE, CAR).save(tmp_path / "saved.zarr")
    with pytest.raises(FileError, match="holds more"):
        cspace.build(SQUARE, CAR, store=tmp_path / "saved.zarr")
    (tmp_path / "empty").mkdir()
    assert cspace.build(SQUARE, CAR, store=tmp_path / "empty").progress == 1.0


def test_builds_refuse_tiles_that_exceed_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("cspace.tiles.work.free_bytes", lambda: 10_000)
    with pytest.raises(InputError, match="use a smaller tile"):
        cspace.build(SQUARE, CAR, store=tmp_path / "m")
