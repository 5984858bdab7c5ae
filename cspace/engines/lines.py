"""Compiled loops over the lines of cells that a transform is fed with, and over the sums that it yields."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.compiling import jit

NEAREST = 1.5 * 2.0**52
"""A number below 2^50 that is added to this is rounded to the nearest whole one, which the low bits then hold."""


@jit
def count_lines(occupied: NDArray[np.uint8], first: Ints, length: int, outside: bool, counts: Ints) -> int:
    """Obstacle cells of each line along the last axis of a tile whose first cell is given, and of the whole tile.

    Arrays of cells have three axes; those of the plane are one layer. ``counts`` has a number for each line.
    """
    nx, ny, nz = occupied.shape
    begin, end = min(max(first[2], 0), nz), min(max(first[2] + length, 0), nz)
    padding = (length - (end - begin)) * outside
    total = 0
    for i in range(counts.shape[0]):
        x = first[0] + i
        for j in range(counts.shape[1]):
            y = first[1] + j
            if 0 <= x < nx and 0 <= y < ny:
                row, number = occupied[x, y, begin:end], padding
                for k in range(row.size):
                    number += row[k]
            else:
                number = length * outside
            counts[i, j] = number
            total += number
    return total


@jit
def add_lines(
    occupied: NDArray[np.uint8],
    first: Ints,
    outside: bool,
    scale: float,
    mixed: Bools,
    lines: NDArray[np.floating],
) -> None:
    """Add W - 1/2, times a scale, to those lines of a tile that are ``mixed``, not constant; in their order.

    Arrays of cells as for :func:`count_lines`.
    """
    unit = lines.dtype.type(scale)
    half = lines.dtype.type(0.5 * scale)
    nx, ny, nz = occupied.shape
    length = lines.shape[1]
    padding = outside * unit - half
    number = 0
    for i in range(mixed.shape[0]):
        x = first[0] + i
        for j in range(mixed.shape[1]):
            if not mixed[i, j]:
                continue
            y = first[1] + j
            begin = end = 0
            if 0 <= x < nx and 0 <= y < ny:
                begin, end = min(max(first[2], 0), nz), min(max(first[2] + length, 0), nz)
            line = lines[number]
            low = begin - first[2] if begin < end else length
            for k in range(low):
                line[k] += padding
            if begin < end:
                row, inside, rest = occupied[x, y, begin:end], line[low:], line[end - first[2] :]
                for k in range(row.size):
                    inside[k] += row[k] * unit - half
                for k in range(rest.size):
                    rest[k] += padding
            number += 1


@jit
def place_lines(mixed: Bools, levels: Floats, lines: NDArray[Any]) -> NDArray[Any]:
    """Spectra of all lines: those of the lines that are not constant, in order, and from the sums of the others."""
    spectrum = np.empty((*mixed.shape, lines.shape[1]), lines.dtype)
    number = 0
    for i in range(mixed.shape[0]):
        for j in range(mixed.shape[1]):
            if mixed[i, j]:
                spectrum[i, j] = lines[number]
                number += 1
            else:
                spectrum[i, j] = 0.0
                spectrum[i, j, 0] = levels[i, j]
    return spectrum


@jit
def round_sums(sums: Floats, missing: float) -> None:
    """Add to sums what they miss, and put the nearest whole numbers into the low bits of the results."""
    flat = sums.ravel()
    for k in range(flat.size):
        flat[k] = (flat[k] + missing) + NEAREST


@jit
def mark_digit(
    whole: Ints,
    mask: int,
    always: bool,
    add: bool,
    out: NDArray[np.uint8],
    corner: Ints,
    shape: Ints,
) -> None:
    """Whether bits of the first whole numbers, as many as ``shape``, are set, written or added to ``out`` at a corner.

    Arrays have three axes; those of the plane are one layer.
    """
    x, y, z = corner
    nx, ny, nz = shape
    for i in range(nx):
        for j in range(ny):
            row, numbers = out[x + i, y + j, z : z + nz], whole[i, j]
            if add:
                for k in range(nz):
                    row[k] += always or (numbers[k] & mask) != 0
            else:
                for k in range(nz):
                    row[k] = always or (numbers[k] & mask) != 0
