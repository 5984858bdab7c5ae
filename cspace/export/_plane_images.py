"""Plane maps as GeoTIFF images (OGC 19-008r4) and ROS maps."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from cspace import BLOCKED, FREE, MIXED, Grid
from cspace.inside import States, StrPath, replacing, warn_user

GREY_LEVELS: Final = {FREE: 254, MIXED: 205, BLOCKED: 0}
"""Grey level of each state in a ROS map, as the ROS tools write free, unknown and occupied."""

_COLOURS: Final = {FREE: (255, 255, 255), MIXED: (213, 94, 0), BLOCKED: (38, 38, 38)}
"""Red, green and blue of each state."""

_GEO_KEYS: Final = (
    (1024, 32767),  # GTModelTypeGeoKey: a user-defined frame
    (1025, 1),  # GTRasterTypeGeoKey: a pixel is an area, so the tie point is the corner of a pixel
    (3076, 9001),  # ProjLinearUnitsGeoKey: metres
)
"""GeoTIFF keys and their values."""

_SCALE = 33550
_TIE_POINT = 33922
_DIRECTORY = 34735
"""TIFF tags for the size of a pixel, the position of the upper left corner, and the keys."""

_SHORT = 3
_DOUBLE = 12
"""Codes of the data types of TIFF tags: 16-bit integers, and float64."""


def write_geotiff(state: States, grid: Grid, path: StrPath, overwrite: bool = False) -> None:
    """Write a plane map's states as a GeoTIFF.

    They have shape (nx, ny). Each cell is a pixel: 0 FREE, 1 MIXED, 2 BLOCKED. The first row is the
    top, as in every GeoTIFF. Coordinates are as in the map, in metres, without a coordinate
    reference system.

    Raises FileError as :func:`cspace._files.access.replacing`.
    """
    from PIL import Image
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    # The key directory begins with its version, revision and number of keys. An entry is the key,
    # 0 because the value is in the entry itself, the number of values, and the value.
    directory = [1, 1, 0, len(_GEO_KEYS)]
    for key, value in _GEO_KEYS:
        directory += [key, 0, 1, value]
    left, _ = grid.lower
    _, top = grid.upper
    tags = ImageFileDirectory_v2()
    for tag, kind, values in (
        (_SCALE, _DOUBLE, (grid.spacing, grid.spacing, 0.0)),
        (_TIE_POINT, _DOUBLE, (0.0, 0.0, 0.0, left, top, 0.0)),  # pixel, then its position
        (_DIRECTORY, _SHORT, directory),
    ):
        tags[tag] = values
        tags.tagtype[tag] = kind
    rows_from_top = state.T[::-1]
    image = Image.frombytes("P", state.shape, rows_from_top.tobytes())
    palette = np.array([_COLOURS[value] for value in sorted(_COLOURS)], dtype=np.uint8)
    image.putpalette(palette.tobytes())
    with replacing(path, overwrite) as temporary:
        image.save(temporary, format="TIFF", tiffinfo=tags, compression="tiff_adobe_deflate")


def write_ros_map(state: States, grid: Grid, path: StrPath, overwrite: bool = False) -> None:
    """Write the states of a plane map as a ROS map.

    They have shape (nx, ny). FREE, MIXED and BLOCKED become free, unknown and occupied. `path` is
    the YAML file, ``.yaml`` or ``.yml``; a ``.pgm`` image goes beside it. If either cannot be
    written, both stay as they were. Reading the map with ``unknown="occupied"`` returns the cells
    that are not FREE, with ``unknown="free"`` the BLOCKED cells, on exactly the same grid.

    Raises FileError as :func:`cspace._files.access.replacing`.
    """
    import yaml

    target = Path(path)
    image = target.with_suffix(".pgm")
    header = {
        "image": image.name,
        "mode": "trinary",
        "resolution": grid.spacing,
        "origin": [*grid.lower, 0.0],
        "negate": 0,
        # Readers compare shares of black, (255 - grey) / 255, with these thresholds, which separate
        # the three values of GREY_LEVELS.
        "occupied_thresh": 0.65,
        "free_thresh": 0.1,
    }
    levels = np.array([GREY_LEVELS[value] for value in sorted(GREY_LEVELS)], dtype=np.uint8)
    rows_from_top = levels[state].T[::-1]
    width, height = grid.shape
    text = yaml.safe_dump(header, sort_keys=False, default_flow_style=None)
    # The YAML refers to the image, so it is renamed last.
    with replacing(target, overwrite) as yaml_file, replacing(image, overwrite) as image_file:
        image_file.write_bytes(b"P5\n%d %d\n255\n" % (width, height) + rows_from_top.tobytes())
        yaml_file.write_text(text, encoding="utf-8")
    if grid.frame_id not in ("", "map"):
        warn_user(
            f"{target}: a ROS map names no frame, and map_server serves it in 'map', not in "
            f"{grid.frame_id!r}"
        )
