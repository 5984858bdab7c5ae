"""VTK image data for ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cspace.files.access import replacing
from cspace.grid import Grid
from cspace.support.arrays import Floats, StrPath

_VTK_TYPES: Final = {
    "uint8": ("UInt8", "|u1"),
    "bool": ("UInt8", "|u1"),
    "int32": ("Int32", "<i4"),
    "float64": ("Float64", "<f8"),
}
"""Name in VTK, and stored type, of each NumPy type."""


def write_vti(
    arrays: Mapping[str, NDArray[Any]],
    grid: Grid,
    path: StrPath,
    overwrite: bool = False,
    about: Mapping[str, Floats] | None = None,
) -> None:
    """Write arrays over the cells of a grid as ``.vti``.

    They become cell data; viewers show the first array; the origin is the lower corner of the grid.
    A plane grid becomes an image at z = 0. Arrays are uint8, bool (stored as uint8), int32 or
    float64. The arrays of `about`, float64 with shape (n,), become field data: numbers about the
    whole.

    Raises FileError as :func:`cspace.files.access.replacing`.
    """
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        file.write(_vti_header(arrays, grid, about or {}).encode())
        for numbers in (about or {}).values():
            file.write(
                np.array(8 * numbers.size, dtype="<u8").tobytes() + numbers.astype("<f8").tobytes()
            )
        for array in arrays.values():
            kind = np.dtype(_VTK_TYPES[str(array.dtype)][1])
            file.write(np.array(array.size * kind.itemsize, dtype="<u8").tobytes())
            file.write(array.astype(kind).tobytes(order="F"))  # x is fastest in VTK
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")


def _vti_header(arrays: Mapping[str, NDArray[Any]], grid: Grid, about: Mapping[str, Floats]) -> str:
    """Return the text before the first array."""
    missing = 3 - grid.dim
    extent = " ".join(f"0 {count}" for count in (*grid.shape, *[0] * missing))
    origin = " ".join(map(repr, (*grid.lower, *[0.0] * missing)))
    offset = 0

    def declared(parts: Mapping[str, NDArray[Any]], counted: bool) -> str:
        nonlocal offset
        lines = []
        for name, array in parts.items():
            kind, stored = _VTK_TYPES[str(array.dtype)]
            count = f' NumberOfTuples="{array.size}"' * counted
            place = f'{count} format="appended" offset="{offset}"'
            lines.append(f'        <DataArray type="{kind}" Name={quoteattr(name)}{place}/>\n')
            offset += 8 + array.size * np.dtype(stored).itemsize
        return "".join(lines)

    fields = f"      <FieldData>\n{declared(about, True)}      </FieldData>\n" if about else ""
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'  <ImageData WholeExtent="{extent}" Origin="{origin}" '
        f'Spacing="{" ".join([repr(grid.spacing)] * 3)}">\n'
        f'{fields}    <Piece Extent="{extent}">\n'
        f"      <CellData Scalars={quoteattr(next(iter(arrays)))}>\n{declared(arrays, False)}     "
        " </CellData>\n"
        '    </Piece>\n  </ImageData>\n  <AppendedData encoding="raw">\n   _'
    )
