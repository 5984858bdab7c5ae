"""VTK image data for ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cspace import Grid
from cspace.inside import Floats, StrPath, replacing

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
    overwrite: bool,
    about: Mapping[str, Floats] | None,
) -> None:
    """Write arrays over a grid's cells as ``.vti``.

    The arrays become cell data; viewers show the first one. The origin is the lower corner of the
    grid. A plane grid becomes an image at z = 0. Arrays are uint8, bool (stored as uint8), int32 or
    float64. The arrays of `about`, float64 with shape (n,), become field data, which describe the
    whole image.

    Raises FileError as :func:`cspace._files.access.replacing`.
    """
    fields = dict(about or {})
    missing_axes = 3 - grid.dim
    shape = (*grid.shape, *[0] * missing_axes)
    lower = (*grid.lower, *[0.0] * missing_axes)
    extent = " ".join(f"0 {count}" for count in shape)
    origin = " ".join(map(repr, lower))
    spacing = " ".join([repr(grid.spacing)] * 3)
    # The header gives the offset of each array in the data that follow it. There, each array begins
    # with its size in bytes, an integer of 8 bytes.
    elements = []
    offset = 0
    for name, array in (*fields.items(), *arrays.items()):
        vtk_type, stored_type = _VTK_TYPES[str(array.dtype)]
        elements.append(
            f'        <DataArray type="{vtk_type}" Name={quoteattr(name)} '
            f'NumberOfTuples="{array.size}" format="appended" offset="{offset}"/>\n'
        )
        offset += 8 + array.size * np.dtype(stored_type).itemsize
    header = (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'  <ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">\n'
        f"      <FieldData>\n{''.join(elements[: len(fields)])}      </FieldData>\n"
        f'    <Piece Extent="{extent}">\n'
        f"      <CellData Scalars={quoteattr(next(iter(arrays)))}>\n"
        f"{''.join(elements[len(fields) :])}      </CellData>\n"
        '    </Piece>\n  </ImageData>\n  <AppendedData encoding="raw">\n   _'
    )
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        file.write(header.encode())
        for array in (*fields.values(), *arrays.values()):
            _, stored_type = _VTK_TYPES[str(array.dtype)]
            content = array.astype(stored_type).tobytes(order="F")  # x varies fastest in VTK
            file.write(len(content).to_bytes(8, "little"))
            file.write(content)
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")
