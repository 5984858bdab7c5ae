"""OFF, in text."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cspace.io.input import damaged, read_bytes
from cspace.io.polygons import Surface, triangulated, unread


def read_off(file: Path) -> Surface:
    """Triangles of an OFF file; normals, colours and texture coordinates are left.

    Raises
    ------
    FileError
        If the file is truncated, or its lines are not as many as it says.
    GeometryError
        If it is binary, its vertices have other than three coordinates, or a polygon can be cut in several ways.
    """
    text = re.sub(rb"#[^\r\n]*", b"", read_bytes(file, "mesh", memory=20.0))
    found = re.match(rb"\s*((?:ST)?C?N?)(4?n?)OFF\b([ \t]+BINARY)?", text)
    if not found:
        raise damaged(file, "does not begin with OFF")
    if found[2] or found[3]:
        what = "binary data" if found[3] else "vertices of another number of coordinates than three"
        raise unread(file, f"{what} ({found[0].decode().strip()})")
    rows = [words for line in text[found.end() :].splitlines() if (words := line.split())]
    if not rows or len(rows[0]) not in (2, 3):
        raise damaged(file, "does not tell the numbers of vertices and faces after OFF")
    count, polygons = int(rows[0][0]), int(rows[0][1])
    if len(rows) != 1 + count + polygons:
        raise damaged(file, f"declares {count} vertices and {polygons} faces, and has {len(rows) - 1} lines of them")
    points, faces = rows[1 : count + 1], rows[count + 1 :]
    if points and (min(map(len, points)) < 3 or len(set(map(len, points))) > 1):
        raise damaged(
            file, "has lines of vertices that are not alike; each has x, y and z, and as many words as others"
        )
    sizes = np.array([row[0] for row in faces], dtype=np.bytes_).astype(np.int64) if faces else np.empty(0, np.int64)
    if any(len(row) <= size for row, size in zip(faces, sizes.tolist(), strict=True)):
        raise damaged(file, "has a face with fewer corners than it says")
    corners = [word for row, size in zip(faces, sizes.tolist(), strict=True) for word in row[1 : size + 1]]
    vertices = np.array([row[:3] for row in points], dtype=np.bytes_).astype(np.float64).reshape(-1, 3)
    numbers = np.array(corners, dtype=np.bytes_).astype(np.int64) if corners else np.empty(0, np.int64)
    return vertices, triangulated(vertices, numbers, sizes, file)
