"""Updates of tiled maps: equality with new builds, atomicity and refusals."""

import multiprocessing
import os
import shutil
import signal
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace.errors import FileError, InputError
from tests.laws.any_map import CAR, MAP_INPUTS
from tests.refusals import refusals
from tests.tiles.test_build import check_states, random_workspace, tiles_of


@settings(max_examples=6)
@given(
    seed=st.integers(0, 2**16),
    outside=st.sampled_from(["blocked", "free"]),
    two=st.booleans(),
    name=st.sampled_from(["plane", "yaw", "space", "yaw in space"]),
)
def test_update_equals_a_new_build(seed, outside, two, name, tmp_path_factory):
    rng, path = np.random.default_rng(seed), tmp_path_factory.mktemp("update") / "m"
    shape, robot, rotations = MAP_INPUTS[name]
    workspace, options = (
        random_workspace(shape, seed, two),
        {"rotations": rotations, "outside": outside},
    )
    tiled = cspace.build(workspace, robot, store=path, tile=8, **options)
    space = cspace.build(workspace, robot, **options)
    for version in range(1, 4):
        size = rng.integers(1, 9, len(shape))
        lower = rng.integers(0, np.array(workspace.grid.shape) - size + 1)
        cells = rng.random(size) < rng.choice([0.0, 0.5, 1.0])
        inner = cells & (rng.random(size) < 0.5) if two else None
        ours, theirs = (
            tiled.update(cells, lower, inner=inner),
            space.update(cells, lower, inner=inner),
        )
        assert ours == theirs or not ours.occupied == theirs.occupied > 0
        assert (ours.occupied, ours.changed) == (theirs.occupied, theirs.changed)
        check_states(path, space)
        q = rng.uniform(-2.0, 6.0, (200, space.size))
        np.testing.assert_array_equal(tiled.classify(q), space.classify(q))
        assert tiled.version <= version
    assert not list(path.parent.glob(".cspace-*"))


def test_update_keeps_tiles_out_of_reach_and_shapes_only_before(tmp_path):
    workspace = random_workspace((200, 200))
    tiled = cspace.build(workspace, cspace.Robot.disc(0.3), store=tmp_path / "m", tile=20)
    files = {
        name: (part / "cell_states/c/0/0/0").stat().st_ino
        for name, part in tiles_of(tmp_path / "m").items()
    }
    tiled.update(np.ones((3, 3), bool), (108, 108))
    now = {
        name: (part / "cell_states/c/0/0/0").stat().st_ino
        for name, part in tiles_of(tmp_path / "m").items()
    }
    changed = {name for name in files if files[name] != now[name]}
    assert "5.5" in changed and len(changed) <= 9 and files.keys() == now.keys()


def test_a_build_does_not_resume_an_updated_map(tmp_path):
    workspace = random_workspace((30, 30))
    tiled = cspace.build(workspace, CAR, store=tmp_path / "m", tile=8)
    assert tiled.update(np.zeros((1, 1), bool), (0, 0)).occupied == 0
    cspace.build(workspace, CAR, store=tmp_path / "m", tile=8)
    tiled.update(np.ones((2, 2), bool), (9, 9))
    with pytest.raises(FileError, match="has been updated"):
        cspace.build(workspace, CAR, store=tmp_path / "m", tile=8)


def test_a_tile_of_the_map_before_an_update_is_refused(tmp_path):
    space = cspace.build(
        random_workspace((30, 30)), cspace.Robot.disc(0.2), store=tmp_path / "m", tile=8
    )
    q = np.add(space.grid.lower, 0.3)
    shutil.copytree(tmp_path / "m" / "0.0", tmp_path / "before")
    space.update(np.ones((3, 3), dtype=bool), (2, 2))
    space.classify(q)
    shutil.rmtree(tmp_path / "m" / "0.0")
    (tmp_path / "before").rename(tmp_path / "m" / "0.0")
    with pytest.raises(FileError, match="not the tile that the map was completed with"):
        cspace.open(tmp_path / "m").classify(q)


def test_readers_see_the_map_before_or_after_an_update(tmp_path):
    # A wall appears and disappears; every batch over many tiles sees one version.
    workspace = cspace.Workspace.from_array(np.zeros((120, 120), dtype=bool), 0.1)
    tiled = cspace.build(workspace, cspace.Robot.disc(0.1), store=tmp_path / "m", tile=24)
    wall = np.ones((120, 3), dtype=bool)
    q = np.stack([np.linspace(0.3, 11.7, 200), np.full(200, 6.15)], axis=1)
    stop, seen, wrong = threading.Event(), set(), []

    def read():
        other = cspace.TiledCSpace.open(tmp_path / "m", cache_bytes=300)
        while not stop.is_set():
            free = other.is_free(q)
            seen.add(int(free.sum()))
            if free.any() != free.all():
                wrong.append(free)

    threads = [threading.Thread(target=read) for _ in range(2)]
    for thread in threads:
        thread.start()
    for k in range(6):
        tiled.update(wall & (k % 2 == 0), (0, 60))
    stop.set()
    for thread in threads:
        thread.join()
    assert not wrong and seen <= {0, 200} and seen
    assert tiled.version == 6


def change(path, value):
    cspace.open(path).update(np.full((60, 60), value), (20, 30))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_killed_update_leaves_the_old_or_the_new_map(tmp_path):
    workspace = random_workspace((120, 130))
    tiled = cspace.build(workspace, CAR, rotations=4, store=tmp_path / "m", tile=16)
    before = cspace.build(workspace, CAR, rotations=4)
    after = cspace.build(workspace, CAR, rotations=4)
    after.update(np.ones((60, 60), bool), (20, 30))
    rng, context = np.random.default_rng(0), multiprocessing.get_context("fork")
    q = np.hstack([rng.uniform(-2, 14, (3000, 2)), rng.uniform(-4, 4, (3000, 1))])
    answers = [each.classify(q) for each in (before, after)]
    for _ in range(6):
        child = context.Process(target=change, args=(tmp_path / "m", True))
        child.start()
        time.sleep(rng.uniform(0.0, 0.25))
        os.kill(child.pid, signal.SIGKILL)
        child.join()
        if not (tmp_path / "m").exists():  # killed between two renames; the old map lies beside it
            [aside] = [
                each for each in tmp_path.glob(".cspace-*") if cspace.open(each).version == 0
            ]
            aside.rename(tmp_path / "m")
        states = tiled.classify(q)
        assert any(np.array_equal(states, each) for each in answers)
        np.testing.assert_array_equal(cspace.open(tmp_path / "m").classify(q), states)
    tiled.update(np.ones((60, 60), bool), (20, 30))
    check_states(tmp_path / "m", after)


CELLS_2X2 = np.ones((2, 2), bool)


@refusals(
    "cells, lower, inner, message",
    (CELLS_2X2, (19, 19), None, "must lie in the grid"),
    (np.full((2, 2), 3), (0, 0), None, "must be 0 or 1"),
    (CELLS_2X2, (0,), None, "must be 2 integers"),
    (~CELLS_2X2, (0, 0), CELLS_2X2, "inner"),
)
def test_update_rejects_invalid_arguments(tmp_path, cells, lower, inner, message):
    tiled = cspace.build(random_workspace((20, 20)), CAR, store=tmp_path / "m", tile=8)
    with pytest.raises(InputError, match=message):
        tiled.update(cells, lower, inner=inner)
    assert tiled.version == 0
