"""GeoTIFF: the states of a plane map as an image with its place in metres (OGC 19-008r4)."""

from __future__ import annotations

import os
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.grid import Grid
from cspace.io.files import replacing
from cspace.states import BLOCKED, FREE, MIXED

_COLORS: Final = {FREE: (255, 255, 255), MIXED: (213, 94, 0), BLOCKED: (38, 38, 38)}
"""Red, green and blue of each state."""

_KEYS: Final = (
    (1024, 32767),  # GTModelTypeGeoKey: a frame of the user's own
    (1025, 1),  # GTRasterTypeGeoKey: a pixel is an area, so that the tie point is the corner of a pixel
    (3076, 9001),  # ProjLinearUnitsGeoKey: metres
)
"""GeoTIFF keys and their values."""

_SCALE, _TIE_POINT, _DIRECTORY = 33550, 33922, 34735
"""Tags of TIFF that hold the size of a pixel, the place of the upper left corner, and the keys."""

_SHORT, _DOUBLE = 3, 12
"""Types of tags."""


def write_geotiff(state: NDArray[np.uint8], grid: Grid, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write the states of a plane map, shape (nx, ny), as a GeoTIFF: 0 FREE, 1 MIXED, 2 BLOCKED, a pixel a cell.

    The first row is the top, as in every GeoTIFF. Coordinates are those of the map, in metres, without a coordinate
    reference system of the earth. Raises FileError as :func:`cspace.io.files.replacing`.
    """
    from PIL import Image
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    header = (1, 1, 0, len(_KEYS))
    directory = (*header, *(number for key, value in _KEYS for number in (key, 0, 1, value)))
    tags = ImageFileDirectory_v2()
    for tag, kind, values in (
        (_SCALE, _DOUBLE, (grid.spacing, grid.spacing, 0.0)),
        (_TIE_POINT, _DOUBLE, (0.0, 0.0, 0.0, grid.lower[0], grid.upper[1], 0.0)),
        (_DIRECTORY, _SHORT, directory),
    ):
        tags[tag], tags.tagtype[tag] = values, kind
    image = Image.frombytes("P", state.shape, np.ascontiguousarray(state.T[::-1]).tobytes())
    image.putpalette([value for number in sorted(_COLORS) for value in _COLORS[number]])
    with replacing(path, overwrite) as temporary:
        image.save(temporary, format="TIFF", tiffinfo=tags, compression="tiff_adobe_deflate")
