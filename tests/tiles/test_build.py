"""Tiled builds: interruptions, damaged folders and refusals."""

import itertools
import json
import multiprocessing
import os
import shutil
import signal
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import shapely

import cspace
from cspace.errors import FileError, InputError
from tests.fuzz.files import reseal
from tests.helpers.strategies import few
from tests.helpers.waiting import until
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


@pytest.mark.thorough
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


# ---- several builds of one folder ----------------------------------------------------------------

FORK = multiprocessing.get_context("fork")
FEW_CELLS = random_workspace((6, 4), density=0.1)
STEPS = ((os, "rename"), (os, "replace"), (os, "mkdir"), (Path, "write_bytes"), (shutil, "rmtree"))
"""Functions that change a folder."""


def build_few(path):
    return cspace.build(FEW_CELLS, cspace.Robot.disc(0.05), store=path, tile=8, workers=1)


def build_and_act(path, step, action):
    """Build a map, and call `action` before a step of its writing; return False without it."""
    steps = itertools.count()
    has_acted = False

    def stop_at_step(function, *arguments, **options):
        nonlocal has_acted
        if not has_acted and next(steps) == step:
            has_acted = True
            action()
        return function(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        for owner, name in STEPS:
            patch.setattr(owner, name, wrap_function(owner, name, stop_at_step))
        build_few(path)
    return has_acted


def wrap_function(owner, name, wrapper):
    """Return a function that calls `wrapper` with the one of that name, and its arguments."""
    function = getattr(owner, name)
    return lambda *arguments, **options: wrapper(function, *arguments, **options)


def build_in_child(path, step=-1):
    """Build a map in a child that is killed before a step; return True if it was."""

    def build():
        build_and_act(path, step, lambda: os.kill(os.getpid(), signal.SIGKILL))

    child = FORK.Process(target=build)
    child.start()
    child.join()
    assert child.exitcode in (0, -signal.SIGKILL)
    return child.exitcode != 0


def check_few(path):
    check_states(path, cspace.build(FEW_CELLS, cspace.Robot.disc(0.05)))


@pytest.mark.thorough
def test_two_builds_at_once_leave_a_whole_map_and_keep_the_tiles_of_the_other(tmp_path):
    """Run a second build within each step of the first, and compare when its tiles were written."""
    times = {}

    def build_and_note(path):
        build_few(path)
        times[path] = list_times(path)

    for step in itertools.count():
        path = tmp_path / str(step)
        has_acted = build_and_act(path, step, lambda path=path: build_and_note(path))
        check_few(path)
        assert not list(path.glob(".cspace-*"))
        if not has_acted:
            break
        assert times[path] == list_times(path)
    assert step > 25


def list_times(path):
    return {name: tile.stat().st_mtime_ns for name, tile in find_tiles(path).items()}


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_build_after_kills_at_any_steps_leaves_a_whole_map(tmp_path):
    """Kill a build at every third step, and the next one at a random step."""
    rng = np.random.default_rng(0)
    for step in itertools.count(0, 3):
        path = tmp_path / str(step)
        was_killed = build_in_child(path, step)
        build_in_child(path, int(rng.integers(step + 1)))
        build_few(path)
        check_few(path)
        if not was_killed:
            break
    assert step > 25


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_processes_that_build_one_store_at_once_all_succeed(tmp_path):
    workspace = random_workspace((200, 180))
    space = cspace.build(workspace, CAR, rotations=8)

    def build(path):
        cspace.build(workspace, CAR, rotations=8, store=path, tile=40, workers=1)

    for round_number in range(4):
        path = tmp_path / str(round_number)
        children = [FORK.Process(target=build, args=(path,)) for _ in range(3)]
        for child in children:
            child.start()
        for child in children:
            child.join()
        assert [child.exitcode for child in children] == [0, 0, 0]
        check_states(path, space)
        assert not list(path.glob(".cspace-*"))


@pytest.mark.thorough
def test_builds_at_once_of_other_maps_are_refused(tmp_path):
    other = cspace.Robot.disc(0.12)

    def build_other():
        cspace.build(FEW_CELLS, other, store=path, tile=8, workers=1)

    refused = 0
    for step in range(0, 120, 6):  # the last ones come after the build
        path = tmp_path / str(step)
        try:
            build_and_act(path, step, build_other)
            check_few(path)
        except FileError as error:
            assert "holds another map" in str(error)
            refused += 1
    assert 0 < refused < 20


# ---- damaged and forged folders ------------------------------------------------------------------

CELLS = cspace.Workspace.from_array(random_workspace((10, 20)).outer, 0.1)
IN_TILE_0_0 = (0.1, 0.1, 0.0)
IN_TILE_0_1 = (0.1, 1.2, 0.0)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build maps of a car and of a disc in the same workspace."""
    folder = tmp_path_factory.mktemp("built")
    for name, robot in (("m", CAR), ("other", cspace.Robot.disc(0.01))):
        cspace.build(CELLS, robot, rotations=4, store=folder / name, tile=8)
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
    "name, damage",
    [
        ("whole/zarr.json", flip_bit),
        ("slice_of/c.0", truncate),
        ("whole/exterior/c.0.0", Path.unlink),
    ],
)
def test_open_refuses_damaged_shared_files(path, name, damage):
    damage(path / name)
    with pytest.raises(FileError):
        cspace.open(path)


@pytest.mark.parametrize(
    "name, damage",
    [
        ("zarr.json", Path.unlink),
        ("cell_states/c.0.0.0", flip_bit),
        ("outer/c.0.0", truncate),
    ],
)
def test_queries_refuse_damaged_tiles(path, name, damage):
    damage(path / "0.1" / name)
    tiled = cspace.open(path)
    tiled.classify(IN_TILE_0_0)
    with pytest.raises(FileError):
        tiled.classify(IN_TILE_0_1)


def test_one_tile_alone_is_refused(path):
    with pytest.raises(FileError, match="it is one tile; open the folder of the whole map"):
        cspace.open(path / "0.1")


@pytest.mark.parametrize("source", ["m/0.2", "other/0.1"])
def test_queries_refuse_tiles_of_other_places_and_maps(built, path, source):
    shutil.rmtree(path / "0.1")
    shutil.copytree(built / source, path / "0.1")
    with pytest.raises(FileError, match="it is a tile of another"):
        cspace.open(path).classify(IN_TILE_0_1)


@pytest.mark.parametrize(
    "damage",
    [
        lambda tile, other: flip_bit(tile / "cell_states/c.0.0.0"),
        lambda tile, other: truncate(tile / "zarr.json"),
        lambda tile, other: shutil.rmtree(tile),
        # As from a worker that still builds a map whose folder was replaced.
        lambda tile, other: shutil.copytree(other, shutil.rmtree(tile) or tile),
    ],
    ids=["changed", "cut", "missing", "another"],
)
@pytest.mark.parametrize("is_complete", few([False, True]))
def test_a_build_mends_damaged_tiles(built, path, damage, is_complete):
    damage(path / "0.1", built / "other" / "0.1")
    if not is_complete:
        shutil.rmtree(path / "whole")
    cspace.build(CELLS, CAR, rotations=4, store=path, tile=8)
    check_states(path, cspace.build(CELLS, CAR, rotations=4))


def test_a_build_keeps_what_is_not_its_own(path):
    """The frame is written last, and what killed processes have left goes then."""
    leftovers = [".cspace-0123456789ab", ".cspace-0123456789ab.1", ".cspace-0123456789ab.png"]
    others = [".cspace-notes", ".cspace-0123456789ab-notes", "0.1/notes", "notes"]
    shutil.rmtree(path / "whole")
    for name in leftovers + others:
        (path / name).mkdir()
        (path / name / "text").write_text("years")
    (path / "0.1" / "zarr.json").unlink()
    build = partial(cspace.build, CELLS, CAR, rotations=4, store=path, tile=8)
    with pytest.raises(FileError, match=r"0\.1: holds more than a saved map"):
        build()
    (path / "0.1" / "notes").rename(path / "mine")
    build()
    others[2] = "mine"
    assert all((path / name / "text").read_text() == "years" for name in others)
    assert not any((path / name).exists() for name in leftovers)


@pytest.mark.parametrize(
    "tiles",
    [
        None,
        {"shape": [10]},
        {"shape": [10, 0]},
        {"shape": [10, "b"]},
        {"shape": [10.0, 20.0]},
        {"shape": [2**31, 20]},
        {"shape": [2**62, 2**62]},
        {"shape": [2**21, 2**21]},
        {"side": [-8, -8]},
        {"side": None},
        *({"counts": counts} for counts in (None, 7, [1, 2], [0, 0, 0], [-1, 800, 1], [1.0, 2, 3])),
        {"stamp": None},
        {"source_stamp": 7},
    ],
    ids=str,
)
def test_open_refuses_forged_sizes(path, tiles):
    attributes = json.loads((path / "whole" / "zarr.json").read_bytes())["attributes"]
    forged = tiles and {**attributes["tiles"], **tiles}
    reseal(path / "whole", tiles=forged)
    if "counts" not in (tiles or ()):
        reseal(path, tiles=forged)
    with pytest.raises(FileError):
        cspace.open(path)


@pytest.mark.parametrize("margin", [2.0**62, 1e308, -1.0], ids=str)
def test_open_refuses_forged_margins(path, margin):
    reseal(path, margin_m=margin)
    with pytest.raises(FileError):
        cspace.open(path)


def test_queries_refuse_tiles_of_another_size(path):
    """The tile and its stamp are valid, but not its grid."""
    stamp = json.loads((path / "0.1" / "zarr.json").read_bytes())["attributes"]["stamp"]
    smaller = random_workspace((5, 5))
    shutil.rmtree(path / "0.1")
    cspace.build(smaller, CAR, rotations=4).save(path / "smaller")
    (path / "smaller").rename(path / "0.1")
    reseal(path / "0.1", stamp=stamp)
    tiled = cspace.open(path)
    for query in (lambda: tiled.classify(IN_TILE_0_1), tiled.overview):
        with pytest.raises(FileError, match="the grid has"):
            query()


@pytest.mark.parametrize("counts", [None, "abc", [1, 2], [1, 2, 3], [2**70, 0, 0]], ids=str)
def test_a_build_refuses_forged_counts_of_a_tile(path, counts):
    shutil.rmtree(path / "whole")
    reseal(path / "0.1", counts=counts)
    with pytest.raises(FileError):
        cspace.build(CELLS, CAR, rotations=4, store=path, tile=8)


# ---- refusals ------------------------------------------------------------------------------------

BOUNDS = (0.0, 0.0, 1.0, 1.0)
SQUARE = cspace.Workspace.from_polygons([shapely.box(0.2, 0.2, 0.5, 0.5)], 0.1, BOUNDS)
LARGER = cspace.Workspace.from_polygons([shapely.box(0.2, 0.2, 0.5001, 0.5)], 0.1, BOUNDS)
TURNS = [0.0, 1.0, 3.0, 2 * np.pi]


@pytest.fixture(scope="module")
def square(tmp_path_factory):
    """Build a map, and return the arguments of its build."""
    store = tmp_path_factory.mktemp("square") / "m"
    given = {"workspace": SQUARE, "robot": CAR, "rotations": TURNS, "tile": 4, "store": store}
    cspace.build(**given)
    return given


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
def test_builds_resume_only_the_same_map(square, changed):
    assert (SQUARE.outer == LARGER.outer).all()
    cspace.build(**square, method="fft", workers=1)
    with pytest.raises(FileError, match="holds another map"):
        cspace.build(**square | changed)


@pytest.mark.parametrize("tile", [0, 2.5, (4, 4, 4), None, (3, 0)])
def test_builds_refuse_invalid_tiles(tile, tmp_path):
    with pytest.raises(InputError, match="tile"):
        cspace.build(SQUARE, CAR, store=tmp_path / "m", tile=tile)
    assert not (tmp_path / "m").exists()


def test_builds_refuse_folders_that_hold_something_else(tmp_path):
    cspace.build(SQUARE, CAR).save(tmp_path / "saved.zarr")
    with pytest.raises(FileError, match="holds more"):
        cspace.build(SQUARE, CAR, store=tmp_path / "saved.zarr")
    (tmp_path / "empty").mkdir()
    assert cspace.build(SQUARE, CAR, store=tmp_path / "empty").progress == 1.0


def test_builds_refuse_tiles_that_exceed_the_memory_but_not_those_of_the_hint(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("cspace._support.limits.free_bytes", lambda: 150_000_000)
    wide = cspace.Workspace.from_array(np.eye(900, 600, dtype=bool), 0.1)
    with pytest.raises(InputError, match=r"tile has .* and needs about"):
        cspace.build(wide, CAR, store=tmp_path / "m", tile=900, rotations=8)
    for tile, rotations in ((100, 8), (900, 1)):
        store = tmp_path / str(tile)
        assert cspace.build(wide, CAR, store=store, tile=tile, rotations=rotations).progress == 1.0
