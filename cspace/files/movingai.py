"""Grid maps and voxel maps of the MovingAI benchmarks.

Sturtevant, "Benchmarks for Grid-Based Pathfinding", 2012; Brewer and Sturtevant, "Benchmarks for Pathfinding in 3D
Voxel Space", 2018.
"""

from __future__ import annotations

import io
import os
from contextlib import suppress
from typing import Final

import numpy as np

from cspace.arrays import Bools
from cspace.files.access import Fault, decoding, is_count, read_text
from cspace.limits import check_cells

PASSABLE: Final = ".GS"
BLOCKED: Final = "@OTW"
_VOXEL_LINES: Final = frozenset("0123456789 \t\n")
_DROP_CELLS: Final = str.maketrans("", "", PASSABLE + BLOCKED)


def read_map(path: str | os.PathLike[str]) -> Bools:
    """Blocked cells of a ``.map`` file, shape (width, height).

    ``.``, ``G`` and ``S`` are passable; ``@``, ``O``, ``T`` and ``W`` are blocked. The first row is the top.

    Raises FileError if the file is missing, the header is malformed, a row has the wrong length or another character,
    or rows are missing or left over; the message names the line.
    """
    with decoding(path, "MovingAI map"):
        lines = _lines(path, "MovingAI map")
        if lines[:1] != ["type octile"]:
            raise _fault(1, lines, "'type octile'")
        sizes: dict[str, int] = {}
        for number, line in enumerate(lines[1:3], start=2):
            key, _, value = line.partition(" ")
            if key not in ("height", "width") or not is_count(value.strip()) or int(value) == 0:
                raise _fault(number, lines, "'height' or 'width' and a whole number above zero")
            sizes[key] = int(value)
        if len(sizes) != 2:
            raise _fault(min(len(lines), 2) + 1, lines, "'height' and 'width', once each, in lines 2 and 3")
        if lines[3:4] != ["map"]:
            raise _fault(4, lines, "'map'")
        rows, width, height = lines[4:], sizes["width"], sizes["height"]
        for number, row in enumerate(rows, start=5):
            if len(row) != width:
                raise Fault(f"line {number} has {len(row)} characters, and the header says width {width}")
            wrong = row.translate(_DROP_CELLS)
            if wrong:
                fault = f"line {number}, column {row.index(wrong[0]) + 1} is {wrong[0]!r}"
                rule = f"cells are one of '{PASSABLE}' (passable) or '{BLOCKED}' (blocked)"
                raise Fault(fault, rule, "replace it")
        if len(rows) != height:
            raise Fault(f"ends at line {len(lines)} with {len(rows)} rows, and the header says height {height}")
        cells = np.frombuffer("".join(rows).encode("ascii"), dtype=np.uint8).reshape(height, width)
        blocked = np.isin(cells, np.frombuffer(BLOCKED.encode("ascii"), dtype=np.uint8))
        return np.ascontiguousarray(blocked[::-1].T)


def read_3dmap(path: str | os.PathLike[str]) -> Bools:
    """Blocked voxels of a ``.3dmap`` file, shape (nx, ny, nz).

    The first line is ``voxel`` and the numbers of voxels along x, y and z; each other line is ``x y z`` of a blocked
    voxel, counted from 0.

    Raises FileError if the file is missing, declares too many voxels, or a line is malformed or has a voxel outside the
    map; the message names the line. A file that is cut between two lines cannot be told from a whole one.
    """
    first, _, body = read_text(path, "MovingAI voxel map").partition("\n")
    with decoding(path, "MovingAI voxel map"):
        kind, *counts = first.split() or [""]
        if kind != "voxel" or len(counts) != 3 or not all(is_count(count) and int(count) > 0 for count in counts):
            raise _fault(1, [first.rstrip()], "'voxel' and three whole numbers above zero")
        shape = (int(counts[0]), int(counts[1]), int(counts[2]))
        check_cells(path, shape)
        blocked = np.zeros(shape, dtype=np.bool_)
        if not body.strip():
            return blocked
        if _VOXEL_LINES.issuperset(body):
            with suppress(ValueError):
                voxels = np.loadtxt(io.StringIO(body), dtype=np.int64, comments=None, ndmin=2)
                if voxels.shape[1] == 3 and (voxels < shape).all():
                    blocked[tuple(voxels.T)] = True
                    return blocked
        raise _voxel_fault(body, shape)


def _voxel_fault(body: str, shape: tuple[int, int, int]) -> Fault:
    """What is wrong with the first line of a voxel map, below the header, that is not what it should be."""
    lines = ["", *(line.strip() for line in body.split("\n"))]
    for number, line in enumerate(lines[1:], start=2):
        tokens = line.split()
        if tokens and not (len(tokens) == 3 and all(map(is_count, tokens))):
            return _fault(number, lines, "'x y z' of a blocked voxel, whole numbers from 0 on")
        if tokens and any(int(token) >= n for token, n in zip(tokens, shape, strict=True)):
            return _fault(number, lines, f"a voxel inside {' x '.join(map(str, shape))}, counted from 0")
    return Fault("cannot be read as lines of 'x y z'")


def _lines(path: str | os.PathLike[str], kind: str) -> list[str]:
    """Lines of a text file, without blank ones at the end."""
    return [line.rstrip() for line in read_text(path, kind).rstrip().split("\n")]


def _fault(number: int, lines: list[str], rule: str) -> Fault:
    """What is wrong with a line that is not what it should be."""
    line = repr(lines[number - 1][:60]) if number <= len(lines) else "missing"
    return Fault(f"line {number} is {line}", f"it must hold {rule}", "mend it or fetch it again")
