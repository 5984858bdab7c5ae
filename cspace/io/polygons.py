"""Surfaces of triangles: placed, joined, and cut from polygons where that can be done in one way only."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import GeometryError
from cspace.io.input import damaged

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Surface = tuple[Floats, Integers]
"""Vertices, shape (V, 3), and the three vertex numbers of each triangle, shape (F, 3)."""

FLAT: Final = 1e-4
"""How far the corners of a flat polygon may be out of its plane, as a part of its size."""

ROUNDED: Final = 1e-6
"""What the corners may be out besides, as a part of the largest coordinate: files keep seven digits."""


TRIED: Final = 500
"""Corners of a polygon that a fan may go around, at most: to try them all takes the square of their number."""


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


def unfolded(points: int, faces: int) -> int:
    """Bytes that a surface takes wherever it is placed; files name one, and so few bytes may unfold into any number."""
    return 24 * (points + faces) + 1000


def joined(parts: Sequence[Surface]) -> Surface:
    """Surfaces as one."""
    firsts = np.cumsum([0, *(len(points) for points, _ in parts)])
    vertices = np.concatenate([np.empty((0, 3)), *(points for points, _ in parts)])
    faces = [faces + first for (_, faces), first in zip(parts, firsts[:-1], strict=True)]
    return vertices, np.concatenate([np.empty((0, 3), dtype=np.int64), *faces])


def triangulated(vertices: Floats, corners: Integers, sizes: Integers, file: Path) -> Integers:
    """Triangles of polygons.

    Each polygon becomes a fan around one of its corners, the first one if that does. A polygon that is not flat has no
    surface of its own: each way to cut it gives another. It is refused, and so is one that no fan around one of its
    first :data:`TRIED` corners covers exactly.

    Parameters
    ----------
    vertices : ndarray of float64, shape (V, 3)
    corners : ndarray of int64, shape (sum of sizes,)
        Vertex numbers, polygon after polygon.
    sizes : ndarray of int64, shape (P,)
        Corners of each polygon.
    file : Path
        For messages.

    Returns
    -------
    ndarray of int64, shape (sum of (sizes - 2), 3)

    Raises
    ------
    FileError
        If a polygon has fewer than three corners, or names a vertex that there is not.
    GeometryError
        If a polygon is not flat, or crosses itself or is so bent that no fan covers it.
    """
    if len(sizes) and int(sizes.min()) < 3:
        raise damaged(file, f"has a face with {int(sizes.min())} corners; a face has three or more")
    if int(sizes.sum()) != len(corners):
        raise damaged(file, f"has faces with {int(sizes.sum())} corners, and names {len(corners)}")
    wrong = corners[(corners < 0) | (corners >= len(vertices))]
    if len(wrong):
        raise damaged(file, f"has a face that names vertex {wrong[0]}, counted from 0, of {len(vertices)}")
    firsts = np.cumsum(sizes) - sizes
    faces = [np.empty((0, 3), dtype=np.int64)]
    for size in np.unique(sizes):
        polygons = corners[firsts[sizes == size, None] + np.arange(size)]
        faces.append(polygons if size == 3 else _fans(vertices, polygons, file))
    return np.concatenate(faces)


def _fans(vertices: Floats, polygons: Integers, file: Path) -> Integers:
    """Triangles of polygons with as many corners each, shape (P, n), n > 3."""
    points = vertices[polygons]
    # A value that is not finite is refused later, by name.
    points = np.where(np.isfinite(points).all(axis=(1, 2), keepdims=True), points, 0.0)
    largest = np.abs(points).max(axis=(1, 2), keepdims=True)
    points = points / np.where(largest > 0.0, largest, 1.0)
    points -= points.mean(axis=1, keepdims=True)
    size = np.asarray(np.linalg.norm(points, axis=2).max(axis=1))
    slack = np.asarray(ROUNDED + FLAT * size)
    normal, flat = _planes(points, size, slack)
    if not flat.all():
        raise _refused(file, polygons[np.argmin(flat)], "do not lie in one plane, or go around no area there")
    count = polygons.shape[1]
    apex = np.full(len(polygons), -1, dtype=np.int64)
    for first in range(min(count, TRIED)):
        left = np.flatnonzero(apex < 0)
        around = np.roll(points[left], -first, axis=1)
        spokes = around[:, 1:] - around[:, :1]
        areas = np.einsum("pij,pj->pi", np.cross(spokes[:, :-1], spokes[:, 1:]), normal[left])
        apex[left[(areas >= -(slack * size)[left, None]).all(axis=1)]] = first
    if (apex < 0).any():
        raise _refused(
            file,
            polygons[np.argmin(apex)],
            f"go around a shape that bends or crosses itself; none of its first {TRIED} corners sees it whole",
        )
    order = (apex[:, None] + np.arange(count)) % count
    turned = polygons[np.arange(len(polygons))[:, None], order]
    fans = np.stack([np.broadcast_to(turned[:, :1], (len(turned), count - 2)), turned[:, 1:-1], turned[:, 2:]], axis=2)
    return np.asarray(fans.reshape(-1, 3))


def _planes(points: Floats, size: Floats, slack: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Unit normals of polygons around their centres, and which are flat; those without an area need lie on a line."""
    total = np.cross(points, np.roll(points, -1, axis=1)).sum(axis=1)
    length = np.linalg.norm(total, axis=1)
    thin = length <= slack * size
    normal = total / np.where(length > 0.0, length, 1.0)[:, None]
    flat = np.abs(np.einsum("pij,pj->pi", points, normal)).max(axis=1) <= slack
    if thin.any():
        _, _, axes = np.linalg.svd(points[thin])
        off = np.abs(points[thin] @ axes[:, 1:].transpose(0, 2, 1)).max(axis=(1, 2))
        flat[thin] = off <= slack[thin]
        normal[thin] = 0.0
    return normal, flat


def _refused(file: Path, polygon: Integers, what: str) -> GeometryError:
    shown = ", ".join(map(str, polygon[:8].tolist())) + (", ..." if len(polygon) > 8 else "")
    return GeometryError(
        str(file),
        f"has a face of {len(polygon)} corners (vertices {shown}, counted from 0) that {what}",
        "more than three corners must lie flat, and one of them must see the whole face",
        "triangulate the faces where the file is written",
    )


def unread(file: Path, what: str, mend: str = "export it as plain triangles, e.g. as STL") -> GeometryError:
    """The error for a file with a part that is not read, and so would be lost."""
    return GeometryError(str(file), f"has {what}, which is not read", "it would be lost", mend)
