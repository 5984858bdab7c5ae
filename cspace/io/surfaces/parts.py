"""Parts of a surface: triangles, placed by a transform and joined."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError, GeometryError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Surface = tuple[Floats, Integers]
"""Vertices, shape (V, 3), and the three vertex numbers of each triangle, shape (F, 3)."""


def placed(surface: Surface, transform: Floats) -> Surface:
    """A surface moved by an affine transform; a mirror image is turned, so that it faces as before.

    Parameters
    ----------
    surface : tuple of ndarray
    transform : ndarray of float64, shape (4, 4)

    Returns
    -------
    tuple of ndarray
    """
    points, faces = surface
    if (transform == np.eye(4)).all():
        return surface
    mirror = np.linalg.det(transform[:3, :3]) < 0.0
    return points @ transform[:3, :3].T + transform[:3, 3], faces[:, ::-1] if mirror else faces


def joined(parts: Sequence[Surface]) -> Surface:
    """Surfaces as one."""
    firsts = np.cumsum([0, *(len(points) for points, _ in parts)])
    vertices = np.concatenate([np.empty((0, 3)), *(points for points, _ in parts)])
    faces = [faces + first for (_, faces), first in zip(parts, firsts[:-1], strict=True)]
    return vertices, np.concatenate([np.empty((0, 3), dtype=np.int64), *faces])


def strip_of(corners: Integers) -> Integers:
    """Triangles of a strip: each corner after the second makes one with the two before it, every other one turned."""
    faces = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    faces[1::2] = faces[1::2, [1, 0, 2]]
    return faces


def fan_of(corners: Integers) -> Integers:
    """Triangles of a fan: each corner after the second makes one with the one before it and the first."""
    return np.stack([np.full(len(corners) - 2, corners[0]), corners[1:-1], corners[2:]], axis=1)


def check_corners(corners: Integers, vertices: int, file: Path) -> None:
    """Refuse faces that name vertices that there are not.

    Raises
    ------
    FileError
        If a number in ``corners`` is negative, or not below ``vertices``.
    """
    wrong = (corners < 0) | (corners >= vertices)
    if wrong.any():
        number = int(corners[wrong][0])
        raise damaged(file, f"has a face that names vertex {number}, counted from 0, of {vertices}")


def damaged(file: Path, what: str) -> FileError:
    """The error for a file that breaks the rules of its format."""
    return FileError(f"{file} {what}; it is malformed or truncated; copy it or write it again")


def unread(
    file: Path, what: str, mend: str = "export it again as plain triangles, for example as STL"
) -> GeometryError:
    """The error for a file with a part that is not read, and so would be lost."""
    return GeometryError(f"{file} has {what}, which is not read; it would be lost; {mend}")
