"""OBJ of Wavefront: vertices and polygons."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from cspace.errors import FileError
from cspace.io.input import damaged, read_bytes
from cspace.io.polygons import Floats, Integers, Surface, triangulated, unread

_LEFT: Final = frozenset(
    b"vt vn vp g o s mg l p usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj trace_obj deg bmat step "
    b"cstype parm trim hole scrv sp end con ctech stech curv2".split()
)
"""Statements that say nothing of a surface of their own."""

_SURFACES: Final = frozenset(b"surf curv fo bsp bzp cdc cdp res call csh".split())
"""Statements of surfaces that are no polygons, of former versions, or in other files."""


def read_obj(file: Path) -> Surface:
    """Triangles of an OBJ file, all its objects together; lines and points are left.

    Parameters
    ----------
    file : Path

    Returns
    -------
    vertices : ndarray of float64, shape (V, 3)
    faces : ndarray of int64, shape (F, 3)

    Raises
    ------
    FileError
        If a line cannot be understood, or names a vertex that there is not.
    GeometryError
        If there are free-form surfaces or other files, or a polygon can be cut in several ways.
    """
    points: list[list[bytes]] = []
    corners: list[bytes] = []
    sizes: list[int] = []
    before: list[int] = []
    for line in _statements(file):
        words = line.split()
        if not words:
            continue
        name = words[0]
        if name not in (b"v", b"f"):
            name = name.lower()
        if name == b"f":
            corners += words[1:]
            sizes.append(len(words) - 1)
            before.append(len(points))
        elif name == b"v":
            points.append(words[1:])
        elif name in _SURFACES:
            raise unread(file, f"a statement {name.decode()!r}")
        elif name not in _LEFT:
            raise damaged(file, f"has a line {line[:60].decode('latin-1')!r}, which is no statement of OBJ")
    vertices = _vertices(points, file)
    counts = np.array(sizes, dtype=np.int64)
    numbers = _numbers(corners, np.repeat(np.array(before, dtype=np.int64), counts), file)
    return vertices, triangulated(vertices, numbers, counts, file)


def _statements(file: Path) -> list[bytes]:
    """Lines without comments, those that are continued joined."""
    data = read_bytes(file, "mesh", memory=20.0).removeprefix(b"\xef\xbb\xbf")
    if b"\0" in data:
        raise damaged(file, "is not text")
    if b"\\" in data:
        data = re.sub(rb"#[^\r\n]*", b"", data)
        lost = re.search(rb"\\[ \t]*(?:\r\n|\r|\n)[ \t]*(?:v[tnp]?|f)[ \t][^\r\n]*", data, re.IGNORECASE)
        if lost:
            line = lost[0].split(maxsplit=1)[-1][:60].decode("latin-1")
            raise FileError(
                str(file),
                f"has a backslash at the end of the line before {line!r}, which would make that part of another",
                "a backslash continues a line",
                "remove it",
            )
        data = re.sub(rb"\\[ \t]*(?:\r\n|\r|\n)", b" ", data)
    return [line.partition(b"#")[0] for line in data.splitlines()] if b"#" in data else data.splitlines()


def _vertices(points: list[list[bytes]], file: Path) -> Floats:
    """x, y and z; a fourth number is a weight, which must be 1, and six or more are a colour besides."""
    widths = set(map(len, points))
    if widths & {0, 1, 2, 5}:
        raise damaged(file, f"has a vertex with {min(widths & {0, 1, 2, 5})} numbers; a vertex has x, y and z")
    weights = [point[3] for point in points if len(point) == 4] if 4 in widths else []
    if any(float(weight) != 1.0 for weight in weights):
        raise unread(file, "vertices with weights other than 1")
    return np.array([point[:3] for point in points], dtype=np.bytes_).astype(np.float64).reshape(-1, 3)


def _numbers(corners: list[bytes], before: Integers, file: Path) -> Integers:
    """Vertex numbers, counted from 0: in the file from 1, or, where negative, back from the last one before."""
    if not corners:
        return np.empty(0, dtype=np.int64)
    first = [corner.partition(b"/")[0] for corner in corners]
    try:
        numbers = np.array(first, dtype=np.bytes_).astype(np.int64)
    except ValueError as error:
        raise damaged(file, f"has a corner of a face that is no whole number ({error})") from error
    if (numbers == 0).any():
        raise damaged(file, "has a face that names vertex 0; they are numbered from 1")
    return np.where(numbers > 0, numbers - 1, before + numbers)
