"""Updates of tiled maps: equality with new builds, atomicity and refusals."""

import multiprocessing
import os
import signal
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace.errors import InputError
from tests.laws.any_map import CAR
from tests.refusals import refusals
from tests.tiles.test_build import check_states, random_workspace


@settings(max_examples=4)
@given(seed=st.integers(0, 2**16), outside=st.sampled_from(["blocked", "free"]), two=st.booleans())
def test_update_equals_a_new_build(seed, outside, two, tmp_path_factory):
    rng, path = np.random.default_rng(seed), tmp_path_factory.mktemp("update") / "m"
    workspace = random_workspace((40, 33), seed, two)
    tiled = cspace.build(workspace, CAR, rotations=4, outside=outside, store=path, tile=8)
    space = cspace.build(workspace, CAR, rotations=4, outside=outside)
    for version in range(1, 4):
        size = rng.integers(1, 9, 2)
        lower = rng.integers(0, np.array(workspace.grid.shape) - size + 1)
        cells = rng.random(size) < rng.choice([0.0, 0.5, 1.0])
        inner = cells & (rng.random(size) < 0.5) if two else None
        ours, theirs = tiled.update(cells, lower, inner=inner), space.update(cells, lower, inner=inner)
        assert (ours.occupied, ours.changed) == (theirs.occupied, theirs.changed)
        if ours.occupied:
            assert (ours.lower, ours.upper) == (theirs.lower, theirs.upper)
        check_states(path, space)
        assert tiled.count() == space.count()
        assert tiled.version <= version
    assert not list(path.glob(".cspace-*"))


def test_update_writes_only_affected_tiles(tmp_path):
    workspace = random_workspace((200, 200))
    tiled = cspace.build(workspace, cspace.Robot.disc(0.3), store=tmp_path / "m", tile=20)
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "m" / "cell_states").rglob("*") if file.is_file()}
    tiled.update(np.ones((3, 3), bool), (108, 108))
    changed = {file for file, written in before.items() if file.stat().st_mtime_ns != written}
    assert {file.parts[-2:] for file in changed} <= {(str(i), str(j)) for i in (5,) for j in (5,)}
    assert changed


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
    assert not wrong
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
    (CELLS_2X2, (0, 0), ~CELLS_2X2, "inner"),
)
def test_update_rejects_invalid_arguments(tmp_path, cells, lower, inner, message):
    tiled = cspace.build(random_workspace((20, 20)), CAR, store=tmp_path / "m", tile=8)
    with pytest.raises(InputError, match=message):
        tiled.update(cells, lower, inner=inner)
    assert tiled.version == 0
