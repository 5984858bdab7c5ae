"""Maps as VTK image data, which ParaView opens: an XML header, then the arrays as they are in memory.

The format is that of the VTK file formats (Kitware): a piece of ImageData whose arrays are appended raw, each after
its length in bytes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import Grid
from cspace.io.output import replacing

_TYPES: Final = {
    "uint8": ("UInt8", "|u1"),
    "bool": ("UInt8", "|u1"),
    "int32": ("Int32", "<i4"),
    "float64": ("Float64", "<f8"),
}
"""How VTK names a type, and how it is stored."""

_SLAB: Final = 2**24
"""Cells that are turned from [x, y, z] into VTK's order at once."""


def write_vti(
    arrays: Mapping[str, NDArray[Any]], grid: Grid, path: str | os.PathLike[str], overwrite: bool = False
) -> None:
    """Write arrays over the cells of a grid as a ``.vti`` file.

    They become cell data; the origin is the lower corner of the grid. A plane grid becomes an image at z = 0.

    Parameters
    ----------
    arrays : mapping of str to ndarray of uint8, bool, int32 or float64, shape grid.shape
        By name; the first is the one that is shown. bool is stored as uint8, 0 and 1.
    grid : Grid
    path, overwrite
        As for :func:`cspace.io.output.replacing`.

    Raises
    ------
    InputError
        If an array has another shape or type.
    FileError
        As :func:`cspace.io.output.replacing`.
    """
    for name, array in arrays.items():
        if array.shape != grid.shape or str(array.dtype) not in _TYPES:
            raise InputError(
                name,
                f"has shape {array.shape} and type {array.dtype}",
                f"it must have the grid's shape {grid.shape} and be {', '.join(_TYPES)}",
                "convert it",
            )
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        file.write(_header(arrays, grid).encode())
        for array in arrays.values():
            kind = np.dtype(_TYPES[str(array.dtype)][1])
            file.write(np.array(array.size * kind.itemsize, dtype="<u8").tobytes())
            for slab in _slabs(array, kind):
                file.write(slab.data)
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")


def _header(arrays: Mapping[str, NDArray[Any]], grid: Grid) -> str:
    """Everything before the first array."""
    missing = 3 - grid.dim
    extent = " ".join(f"0 {count}" for count in (*grid.shape, *[0] * missing))
    origin = " ".join(map(repr, (*grid.lower, *[0.0] * missing)))
    lines, offset = [], 0
    for name, array in arrays.items():
        kind, stored = _TYPES[str(array.dtype)]
        lines.append(f'        <DataArray type="{kind}" Name={quoteattr(name)} format="appended" offset="{offset}"/>\n')
        offset += 8 + array.size * np.dtype(stored).itemsize
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'  <ImageData WholeExtent="{extent}" Origin="{origin}" '
        f'Spacing="{" ".join([repr(grid.spacing)] * 3)}">\n'
        f'    <Piece Extent="{extent}">\n'
        f"      <CellData Scalars={quoteattr(next(iter(arrays)))}>\n{''.join(lines)}      </CellData>\n"
        '    </Piece>\n  </ImageData>\n  <AppendedData encoding="raw">\n   _'
    )


def _slabs(array: NDArray[Any], kind: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    """The values of an array in VTK's order, x fastest, a slab of the last axis at a time."""
    layers = array.reshape(array.shape[0], -1, array.shape[-1])
    step = max(1, _SLAB * layers.shape[-1] // layers.size)
    for start in range(0, layers.shape[-1], step):
        part = layers[..., start : start + step]
        turned = np.empty(part.shape[::-1], dtype=kind)
        for j in range(part.shape[1]):
            # Gathered first: to turn it where its rows lie far apart takes five times as long.
            turned[:, j] = np.ascontiguousarray(part[:, j]).T
        yield turned
