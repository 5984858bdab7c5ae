"""Maps read while they are replaced."""

import multiprocessing
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cspace
from cspace import FileError, Robot, Workspace

CELLS = np.eye(12, dtype=bool)
READS = 150
SECONDS = 20.0


def build_map(number: int) -> cspace.CSpace:
    workspace = Workspace.from_array(np.roll(CELLS, number, axis=0), 0.1)
    return cspace.build(workspace, Robot.rectangle(0.2, 0.1), rotations=4 + 4 * number)


def save_again_and_again(path: Path, stop: Any) -> None:
    spaces = build_map(0), build_map(1)
    number = 0
    while not stop.is_set():
        number += 1
        spaces[number % 2].save(path, overwrite=True)


def update_again_and_again(path: Path, stop: Any) -> None:
    tiled = cspace.open(path)
    number = 0
    while not stop.is_set():
        number += 1
        tiled.update(np.full((12, 12), number % 2 == 0), (0, 0))


def read_beside(writer: Any, path: Path, read: Any) -> set[Any]:
    """Collect maps opened while another process writes."""
    context = multiprocessing.get_context("fork")
    stop = context.Event()
    process = context.Process(target=writer, args=(path, stop))
    process.start()
    found, began = set(), time.monotonic()
    try:
        for number in range(READS):
            found.add(read())
            if time.monotonic() - began > SECONDS or (number > READS // 2 and len(found) > 1):
                break
    finally:
        stop.set()
        process.join()
    return found


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_saved_map_that_is_replaced_opens_as_the_old_or_the_new_one(tmp_path: Path) -> None:
    path, spaces = tmp_path / "map.zarr", (build_map(0), build_map(1))
    spaces[0].save(path)

    def read() -> tuple[Any, ...]:
        space = cspace.open(path)
        assert isinstance(space, cspace.CSpace)
        return (*space.count(), space.workspace.outer.tobytes())

    found = read_beside(save_again_and_again, path, read)
    known = [(*space.count(), space.workspace.outer.tobytes()) for space in spaces]
    assert found <= {*known}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_store_of_tiles_that_is_updated_opens_as_the_old_or_the_new_one(tmp_path: Path) -> None:
    path = tmp_path / "m"
    empty = Workspace.from_array(np.zeros((12, 12), dtype=bool), 0.1)
    cspace.build(empty, Robot.disc(0.1), store=path, tile=5, outside="free")
    q = np.random.default_rng(0).uniform(0.0, 1.2, (50, 2))
    found = read_beside(
        update_again_and_again, path, lambda: cspace.open(path).is_free(q).tobytes()
    )
    assert found <= {bytes(50), b"\1" * 50}


def test_a_map_that_is_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="does not exist"):
        cspace.open(tmp_path / "map.zarr")


def test_a_reader_waits_while_a_map_is_between_two_names(tmp_path: Path) -> None:
    space = build_map(0)
    space.save(tmp_path / ".cspace-0.zarr")
    context = multiprocessing.get_context("fork")
    process = context.Process(
        target=rename_late, args=(tmp_path / ".cspace-0.zarr", tmp_path / "map.zarr")
    )
    process.start()
    try:
        assert cspace.open(tmp_path / "map.zarr").count() == space.count()
    finally:
        process.join()


def rename_late(old: Path, new: Path) -> None:
    time.sleep(0.1)
    old.rename(new)
