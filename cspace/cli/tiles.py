"""Maps in tiles, for commands: the folder of a store, a cluster, and a window of a map that is too large."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cspace.cli.files import check_outputs
from cspace.errors import InputError, optional

if TYPE_CHECKING:
    from cspace.space import CSpace
    from cspace.tiles.space import TiledCSpace


def make_room(output: Path, overwrite: bool) -> None:
    """Check that a store can be made at a path, or gone on with; an old one is removed if it may be replaced.

    Raises InputError if the suffix is not that of a store, and FileError if there is something else, or nothing can be
    written.
    """
    from cspace.store.tiled import is_tiled

    there = is_tiled(output)
    check_outputs([output], (".zarr",), overwrite=there)
    if there and overwrite:
        shutil.rmtree(output)


@contextmanager
def resumable(output: Path, overwrite: bool) -> Iterator[None]:
    """Say of an interruption in the block, if a store has been begun, that the same command resumes."""
    from cspace.store.tiled import is_tiled

    try:
        yield
    except KeyboardInterrupt as interrupt:
        if not is_tiled(output):
            raise
        command = "the same command without --overwrite" if overwrite else "the same command"
        raise KeyboardInterrupt(f"{command} resumes with {output}") from interrupt


def lazily(workspace: Path, options: dict[str, Any]) -> dict[str, Any]:
    """The option that makes the reader of a workspace leave the cells in their file, if it has it."""
    from cspace.workspace import reader_of

    try:
        reader_of(workspace, [*options, "lazy"])
    except InputError:
        return {}
    return {} if options.get("solid") == "fill" else {"lazy": True}


@contextmanager
def cluster(address: str | None) -> Iterator[Any]:
    """The client of a cluster at an address; None without one.

    Raises MissingPackageError if dask is not installed, and InputError if nothing answers there.
    """
    if address is None:
        yield None
        return
    from cspace.tiles.work import CLUSTER

    try:
        client = optional("distributed", CLUSTER, "distributed").Client(address, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        fault, rule = f"is {address!r}, where nothing answers ({error})", "it must be the address of a dask scheduler"
        raise InputError("--scheduler", fault, rule, "start one, with dask scheduler", value=address) from error
    with client:
        yield client


def part_of(space: CSpace | TiledCSpace, box: Sequence[float] | None) -> CSpace:
    """The map itself; of one in tiles, the window in a box.

    Raises InputError if a map in tiles lacks a box, or another one has it.
    """
    from cspace.tiles.space import TiledCSpace

    if isinstance(space, TiledCSpace):
        if box is None:
            rule = "what is written is made in memory"
            raise InputError("MAP", "is in tiles", rule, "add --window, a box in metres, for a part of it")
        return space.window(box[: len(box) // 2], box[len(box) // 2 :])
    if box is not None:
        raise InputError("--window", "is given", "it is for maps in tiles", "leave it out", value=box)
    return space
