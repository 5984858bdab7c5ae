"""Compiled kernels of the border of a set of cells in space."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Cells = NDArray[np.uint8]
Ints = NDArray[np.int64]


@njit(cache=True, nogil=True)
def count_squares(cells: Cells, value: int) -> int:
    """Number of cell faces between the cells of a value and all others, the outside included."""
    nx, ny, nz = cells.shape
    count = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if cells[i, j, k] == value:
                    count += i == 0 or cells[i - 1, j, k] != value
                    count += i == nx - 1 or cells[i + 1, j, k] != value
                    count += j == 0 or cells[i, j - 1, k] != value
                    count += j == ny - 1 or cells[i, j + 1, k] != value
                    count += k == 0 or cells[i, j, k - 1] != value
                    count += k == nz - 1 or cells[i, j, k + 1] != value
    return count


@njit(cache=True, nogil=True)
def fill_triangles(cells: Cells, value: int, corners: NDArray[np.int32], triangles: Ints) -> int:
    """Write the squares of :func:`count_squares` as triangles, each counterclockwise where seen from the other cells.

    The lattice points in use are numbered as they are met. A layer of cells lies between two planes of them, and no
    other numbers are held.

    Parameters
    ----------
    cells : ndarray of uint8, shape (nx, ny, nz)
    value : int
    corners : ndarray of int32, shape (at least the lattice points in use, 3)
        Written: their indices.
    triangles : ndarray of int64, shape (twice the squares, 3)
        Written: rows of ``corners``.

    Returns
    -------
    int
        Number of lattice points in use.
    """
    nx, ny, nz = cells.shape
    below = np.full((ny + 1, nz + 1), -1, dtype=np.int64)
    above = np.full((ny + 1, nz + 1), -1, dtype=np.int64)
    points, square = 0, 0
    for i in range(nx + 1):
        for j in range(ny):
            for k in range(nz):
                inner = i > 0 and cells[i - 1, j, k] == value
                if inner != (i < nx and cells[i, j, k] == value):
                    points, a = _point(below, i, j, k, corners, points)
                    points, b = _point(below, i, j + 1, k, corners, points)
                    points, c = _point(below, i, j + 1, k + 1, corners, points)
                    points, d = _point(below, i, j, k + 1, corners, points)
                    square = _square(a, b, c, d, inner, triangles, square)
        if i == nx:
            break
        for j in range(ny + 1):
            for k in range(nz):
                inner = j > 0 and cells[i, j - 1, k] == value
                if inner != (j < ny and cells[i, j, k] == value):
                    points, a = _point(below, i, j, k, corners, points)
                    points, b = _point(below, i, j, k + 1, corners, points)
                    points, c = _point(above, i + 1, j, k + 1, corners, points)
                    points, d = _point(above, i + 1, j, k, corners, points)
                    square = _square(a, b, c, d, inner, triangles, square)
        for j in range(ny):
            for k in range(nz + 1):
                inner = k > 0 and cells[i, j, k - 1] == value
                if inner != (k < nz and cells[i, j, k] == value):
                    points, a = _point(below, i, j, k, corners, points)
                    points, b = _point(above, i + 1, j, k, corners, points)
                    points, c = _point(above, i + 1, j + 1, k, corners, points)
                    points, d = _point(below, i, j + 1, k, corners, points)
                    square = _square(a, b, c, d, inner, triangles, square)
        below, above = above, below
        above[:] = -1
    return points


@njit(cache=True, nogil=True, inline="always")
def _point(plane: Ints, i: int, j: int, k: int, corners: NDArray[np.int32], points: int) -> tuple[int, int]:
    """How many lattice points are numbered once this one is, and its number."""
    if plane[j, k] < 0:
        plane[j, k] = points
        corners[points, 0], corners[points, 1], corners[points, 2] = i, j, k
        points += 1
    return points, plane[j, k]


@njit(cache=True, nogil=True, inline="always")
def _square(a: int, b: int, c: int, d: int, up: bool, triangles: Ints, square: int) -> int:
    """Write one square, whose corners turn counterclockwise where seen from above its axis; give the next one."""
    if not up:
        b, d = d, b
    first = 2 * square
    triangles[first, 0], triangles[first, 1], triangles[first, 2] = a, b, c
    triangles[first + 1, 0], triangles[first + 1, 1], triangles[first + 1, 2] = a, c, d
    return square + 1
