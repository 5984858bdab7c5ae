"""OctoMaps (Hornung et al., "OctoMap", 2013): octrees of occupied and free space, ``.bt`` and ``.ot``."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError, InputError
from cspace.grid import Grid
from cspace.io.input import existing, unreadable
from cspace.memory import FIXED_CELLS, check_memory

KIND: Final = "OctoMap"
UNKNOWN: Final = ("occupied", "free")

_FIRST_LINES: Final = {b"# Octomap OcTree binary file": True, b"# Octomap OcTree file": False}
_COLOURS: Final = {"OcTree": 0, "ColorOcTree": 3}
"""Bytes of colour in a node of a full tree, by the tree's type."""

_HALF: Final = 2**15
"""Cell of the octree at the origin, along each axis."""


@dataclass(frozen=True, slots=True)
class _Header:
    """What the text before the nodes says."""

    binary: bool
    tree: str
    size: int
    resolution: float


def read_octomap(path: str | os.PathLike[str], unknown: str = "occupied") -> tuple[Grid, NDArray[np.bool_]]:
    """Occupied cells of an OctoMap, over the box of its known space.

    Coarse leaves are expanded to the finest cells. A leaf of a full tree (``.ot``) is occupied from a probability of
    one half on, as in OctoMap; the file holds no other threshold.

    Parameters
    ----------
    path : path-like
        A binary (``.bt``) or full (``.ot``) tree of type OcTree or ColorOcTree; the first line says which.
    unknown : {"occupied", "free"}
        What cells without a leaf are.

    Returns
    -------
    grid : Grid
        Of the tree's resolution; its corner lies a whole number of cells from the origin.
    occupied : ndarray of bool, shape grid.shape

    Raises
    ------
    InputError
        If ``unknown`` is neither word, or the known space does not fit into memory.
    FileError
        If the file is missing, is no OctoMap, is of another type, is truncated or damaged, or knows no cell.
    """
    from cspace.io import _kernels

    if unknown not in UNKNOWN:
        raise InputError(
            f"unknown is {unknown!r}; it says what unknown cells are; pass one of {', '.join(map(repr, UNKNOWN))}"
        )
    file = existing(path, KIND)
    try:
        content = file.read_bytes()
    except OSError as error:
        raise unreadable(file, KIND, error) from error
    header, nodes = _split(str(file), content)
    leaves = _leaves(str(file), header, nodes)
    first = leaves[:, :3].min(axis=0)
    shape = (leaves[:, :3] + leaves[:, 3:4]).max(axis=0) - first
    across = tuple(int(n) for n in shape)
    check_memory(math.prod(across), f"the known space of {file}", across, header.resolution, mend=FIXED_CELLS)
    grid = Grid((first - _HALF) * header.resolution, header.resolution, across)
    leaves[:, :3] -= first
    is_occupied = leaves[:, 4] == 1
    # Only what differs from the unknown is painted.
    occupied = np.full(across, unknown == "occupied", dtype=np.bool_)
    painted = ~is_occupied if unknown == "occupied" else is_occupied
    _kernels.paint_cubes(occupied, np.ascontiguousarray(leaves[painted, :4]), unknown == "free")
    return grid, occupied


def _split(file: str, content: bytes) -> tuple[_Header, bytes]:
    """The header and the bytes of the nodes."""
    line, _, rest = content.partition(b"\n")
    if line.strip() not in _FIRST_LINES:
        raise FileError(
            f"{file} begins with {line[:40]!r}; an OctoMap begins with "
            f"{' or '.join(repr(name.decode()) for name in _FIRST_LINES)}; pass the right file"
        )
    words: dict[str, str] = {}
    while rest:
        raw, _, rest = rest.partition(b"\n")
        text = raw.decode("latin-1").strip()
        if text == "data":
            break
        if text and not text.startswith("#"):
            key, _, value = text.partition(" ")
            words[key] = value.strip()
    else:
        raise FileError(f"{file} has no line 'data' after its header; the file is truncated, fetch it again")
    return _header(file, words, _FIRST_LINES[line.strip()]), rest


def _header(file: str, words: dict[str, str], binary: bool) -> _Header:
    """The header, checked."""
    tree, size, resolution = words.get("id", ""), words.get("size", ""), words.get("res", "")
    if tree not in _COLOURS:
        raise FileError(
            f"{file} holds a tree of type {tree!r}; this reads {' and '.join(_COLOURS)}; convert it with OctoMap"
        )
    try:
        count, side = int(size), float(resolution)
    except ValueError:
        count, side = -1, math.nan
    if count < 0 or not 0.0 < side < math.inf:
        raise FileError(
            f"{file} says size {size[:40]!r} and res {resolution[:40]!r}; an OctoMap tells the number of its nodes and "
            "the side of its cells in metres; the file is damaged, fetch it again"
        )
    if count == 0:
        raise FileError(f"{file} knows no cell; a map needs some known space; insert a scan before it is written")
    return _Header(binary, tree, count, side)


def _leaves(file: str, header: _Header, nodes: bytes) -> NDArray[np.int64]:
    """First cell, side in cells, and whether occupied, of each leaf, shape (n, 5)."""
    from cspace.io import _kernels

    if header.binary:
        records = np.frombuffer(nodes, dtype=np.uint8, count=len(nodes) // 2 * 2).reshape(-1, 2)
        leaves = np.empty((min(header.size, 8 * len(records)), 5), dtype=np.int64)
        found, count, fault = _kernels.leaves_of_binary(records, leaves)
    else:
        record = np.dtype([("value", "<f4"), ("colour", "V", _COLOURS[header.tree]), ("children", "u1")])
        full = np.frombuffer(nodes, dtype=record, count=len(nodes) // record.itemsize)
        leaves = np.empty((min(header.size, len(full)), 5), dtype=np.int64)
        values = full["value"]
        found, count, fault = _kernels.leaves_of_full(np.ascontiguousarray(full["children"]), values >= 0.0, leaves)
        broken = int(np.isnan(values[:found]).sum())
        if broken:
            raise FileError(f"{file} has {broken} nodes without a value (NaN); the file is damaged, fetch it again")
    if fault == 1:
        raise FileError(
            f"{file} ends after {found} nodes; its header says {header.size}; the file is truncated, fetch it again"
        )
    if fault or found != header.size:
        reason = {
            2: f"an inner node below level {_kernels.DEPTH}",
            3: "an inner node without children",
        }.get(fault, f"{'more' if fault else found} nodes, where its header says {header.size}")
        raise FileError(f"{file} holds {reason}; that is no octree of OctoMap; the file is damaged, fetch it again")
    return leaves[:count]
