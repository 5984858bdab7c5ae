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
def test_a_saved_map_that_is_replaced_opens_whole_or_not_at_all(tmp_path: Path) -> None:
    path, spaces = tmp_path / "map.zarr", (build_map(0), build_map(1))
    spaces[0].save(path)

    def read() -> tuple[Any, ...]:
        try:
            space = cspace.open(path)
        except FileError:
            return ()
        assert isinstance(space, cspace.CSpace)
        return (*space.count(), space.workspace.outer.tobytes())

    found = read_beside(save_again_and_again, path, read)
    known = [(*space.count(), space.workspace.outer.tobytes()) for space in spaces]
    assert found <= {(), *known}
