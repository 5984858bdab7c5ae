"""Point clouds, by the suffix of the file."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Final

import numpy as np

from cspace.arrays import Floats
from cspace.errors import GeometryError
from cspace.io.formats import read_npy
from cspace.io.input import Fault, decoding, read_columns, read_text, suffix_of
from cspace.io.pcd import read_pcd
from cspace.io.ply import read_ply

Named = str | os.PathLike[str]


def read_points(path: Named) -> Floats:
    """Points of a cloud, shape (n, 3), in the file's unit, metres; its suffix says how it is read.

    ``.npy``: an array of shape (n, 3). ``.xyz``, ``.txt``, ``.csv``: lines of x, y and z, separated by blanks or
    commas, with ``#`` before comments. ``.ply``: its vertices. ``.pcd``: the format of the Point Cloud Library.
    Colours, normals and other columns are left. Nothing counts the lines of a text: one that is cut between two
    lines, or within its very last number, reads as a smaller cloud.

    Raises GeometryError if there is no point, or a point is not finite: many sensors write NaN where they saw
    nothing, which is neither free nor occupied. Or if a ``.ply`` has surfaces that are no faces.
    """
    read = READERS[suffix_of(path, READERS, "the suffix says how a cloud is written", "points")]
    with decoding(path, "point cloud"):
        points = read(path)
        if not len(points):
            mend = "check how it was written"
            raise Fault("holds no point", "a cloud needs one at least", mend, kind=GeometryError)
        broken = int((~np.isfinite(points).all(axis=1)).sum())
        if broken:
            raise Fault(
                f"holds {broken} points of {len(points)} that are not finite",
                "where the sensor saw nothing is neither free nor occupied",
                "drop them before the file is written: points[np.isfinite(points).all(axis=1)]",
                kind=GeometryError,
            )
    return points


def _read_npy(path: Named) -> Floats:
    array = read_npy(path)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        rule = "a cloud is one array of numbers of shape (n, 3)"
        raise Fault(f"holds shape {array.shape} and type {array.dtype}", rule, "save such a one")
    return np.array(array, dtype=np.float64)


def _read_text(path: Named) -> Floats:
    rows = read_columns(read_text(path, "point cloud", memory=12.0))
    if len(rows) and rows.shape[1] < 3:
        raise Fault(f"has {rows.shape[1]} columns", "points have x, y and z", "write three for each")
    return np.ascontiguousarray(rows[:, :3]) if len(rows) else np.zeros((0, 3))


READERS: Final[dict[str, Callable[[Named], Floats]]] = {
    ".npy": _read_npy,
    ".xyz": _read_text,
    ".txt": _read_text,
    ".csv": _read_text,
    ".ply": lambda path: read_ply(path)[0],
    ".pcd": read_pcd,
}
"""Which function reads a cloud, by suffix."""
