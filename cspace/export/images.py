"""Plane maps as images: GeoTIFF (OGC 19-008r4), with its place in metres, and ROS maps, a YAML file beside an image."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import BLOCKED, FREE, MIXED
from cspace.errors import InputError
from cspace.files.access import check_suffix, replacing
from cspace.files.ros import ROS_MAP_SUFFIXES
from cspace.grid import Grid

LEVELS: Final = {FREE: 254, MIXED: 205, BLOCKED: 0}
"""Grey of each state in a written map, as the ROS tools write free, unknown and occupied."""

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
    reference system of the earth. Raises FileError as :func:`cspace.files.access.replacing`.
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


def write_ros_map(state: ArrayLike, grid: Grid, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map of the states FREE, MIXED and BLOCKED, shape (nx, ny), as a ROS map: free, unknown and occupied.

    The path is that of the YAML file, ending in ``.yaml`` or ``.yml``; the image goes beside it, ending in ``.pgm``.
    Where one cannot be written, neither is changed. Reading it back with ``unknown="occupied"`` gives the cells that
    are not FREE, with ``unknown="free"`` those that are BLOCKED, on the same grid to the last bit.
    """
    import yaml

    check_suffix(path, ROS_MAP_SUFFIXES, "a ROS map ends in .yaml")
    target = Path(path)
    cells = np.asarray(state)
    if cells.shape != grid.shape[:2]:
        problem = f"has shape {cells.shape} on a grid of {grid.shape}, and {target} names a ROS map"
        raise InputError(
            "state",
            problem,
            "it is that of a grid in the plane",
            "pass CSpace.cell_states, or one slice of it",
            value=state,
        )
    if cells.dtype.kind not in "iu" or cells.min() < FREE or cells.max() > BLOCKED:
        raise InputError(
            "state",
            "holds other values than FREE, MIXED and BLOCKED",
            "it is a state",
            "pass CSpace.cell_states",
            value=state,
        )
    image = target.with_suffix(".pgm")
    header = {
        "image": image.name,
        "mode": "trinary",
        "resolution": grid.spacing,
        "origin": [*grid.lower, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.1,
    }
    levels = np.array([LEVELS[value] for value in sorted(LEVELS)], dtype=np.uint8)
    pixels = levels[cells].T[::-1]
    # The YAML refers to the image, so that it gets its name last.
    with replacing(target, overwrite) as yaml_file, replacing(image, overwrite) as image_file:
        image_file.write_bytes(b"P5\n%d %d\n255\n" % (grid.shape[0], grid.shape[1]) + pixels.tobytes())
        yaml_file.write_text(yaml.safe_dump(header, sort_keys=False, default_flow_style=None), encoding="utf-8")
