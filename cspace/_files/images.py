"""Cells of images and of MovingAI benchmark maps.

Pillow decodes the images. Sturtevant, "Benchmarks for Grid-Based Pathfinding", 2012; Brewer and
Sturtevant, "Benchmarks for Pathfinding in 3D Voxel Space", 2018.
"""

from __future__ import annotations

import io
import math
import re
import threading
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace._files.access import (
    ContentError,
    decoding,
    is_count,
    read_bytes,
    read_text,
)
from cspace._files.fields import Fields
from cspace._support.arrays import Bools, Floats, StrPath, frozen
from cspace._support.check import check_finite, check_word
from cspace._support.kinds import BRING_YOUR_FILE
from cspace._support.limits import WORKSPACE_CELL_BYTES, check_cells
from cspace._support.reporting import warn_user
from cspace.errors import InputError, UnitWarning

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageFile import ImageFile

IMAGE_FORMATS: Final = ("PNG", "PPM", "BMP", "JPEG", "TIFF")
"""Formats that Pillow may detect from the content; its other plug-ins may start programs."""

COLOUR_MODES: Final = ("P", "RGB", "RGBX", "RGBA", "RGBa", "LA", "La", "PA", "CMYK", "YCbCr", "HSV")

_BOUNDED_FORMATS: Final = ("PNG", "PPM", "BMP")
_MAX_PIXELS_PER_BYTE: Final = 8 * 1040
"""Maximum number of pixels per byte of these formats: 8 pixels of one bit, times deflate's best
ratio."""

_WHITE_8_BIT: Final = 2**8 - 1
"""Largest level of a channel of 8 bits."""

_PIXELS_PER_PART: Final = 2**18
"""Approximate number of pixels that are converted at once."""

_UNKNOWN_LEVEL: Final = 205
_ROS_LEVELS: Final = (0, _UNKNOWN_LEVEL, 254)
"""Levels that the map savers of ROS write: occupied, unknown and free."""

UNKNOWN_SHADE: Final = _UNKNOWN_LEVEL / _WHITE_8_BIT
"""Shade that the map savers of ROS write for unknown cells."""

_LOSSY_COMPRESSIONS: Final = ("jpeg", "tiff_jpeg", "webp")
"""Compressions of TIFF that change shades, by Pillow's names."""

_UNSIGNED_FORMATS: Final = frozenset({1, 4})
"""Sample formats of TIFF that are unsigned whole numbers, or not said."""

FIELDS: Final = (
    Fields(
        "`.png`, `.pgm`, `.ppm`, `.pbm`, `.pnm`, `.jpg`, `.jpeg`, `.bmp`, `.tif`, `.tiff`",
        honoured=(
            "bit depth, PGM's maximum, palette, CMYK, transparency; EXIF and TIFF orientation; "
            "TIFF: WhiteIsZero, fill order"
        ),
        refused=(
            "more numbers than the pixels of a PBM, PGM or PPM, or above its maximum; signed and "
            "real samples; GDAL's nodata"
        ),
        warned=(
            "further pages or frames; gamma other than 1/2.2; placement of a GeoTIFF; grey 205 of "
            "a ROS map; another spacing in the comment of a PGM"
        ),
    ),
    Fields(
        "`.map`, `.3dmap`",
        honoured="header",
    ),
)

_PILLOW_LIMIT_LOCK: Final = threading.Lock()
"""Held while Pillow's own pixel limit, which is global to the process, is replaced by ours."""


class Shades(NamedTuple):
    """An image indexed like coordinates, ``[x, y]`` with y up.

    Attributes
    ----------
    levels : ndarray of unsigned integers, shape (nx, ny)
    white_level : int
        Level of white; black is 0.
    opaque : ndarray of bool, shape (nx, ny), or True
        True for pixels of full alpha.
    is_lossy : bool
        True if compression changed the levels, as in a JPEG.
    """

    levels: NDArray[np.unsignedinteger[Any]]
    white_level: int
    opaque: Bools | bool
    is_lossy: bool = False

    @property
    def shades(self) -> Floats:
        """Shade of each level: 0 black, 1 white."""
        return np.arange(self.white_level + 1) / float(self.white_level)

    def select(self, levels: Bools) -> Bools:
        """Return a mask of the pixels whose level is set in `levels`."""
        selected = np.zeros(self.levels.shape, dtype=np.bool_)
        columns_at_once = max(1, _PIXELS_PER_PART // selected[0].size)
        # Comparisons with the ends of runs of levels are quicker than a look-up of each pixel.
        borders = np.flatnonzero(np.diff(levels, prepend=False, append=False))
        for column in range(0, len(selected), columns_at_once):
            part = slice(column, column + columns_at_once)
            for first, stop in borders.reshape(-1, 2).tolist():
                selected[part] |= (self.levels[part] >= first) & (self.levels[part] < stop)
        return selected

    def select_opaque(self, levels: Bools) -> Bools:
        """Return a mask of the opaque pixels whose level is set in `levels`."""
        selected = self.select(levels)
        if isinstance(self.opaque, np.ndarray):
            selected &= self.opaque
        return selected


def read_image(
    path: StrPath, spacing: float, threshold: float = 0.5, dark: str = "occupied"
) -> tuple[Bools, Bools | None]:
    """Read an image's occupied and unknown cells, shape (nx, ny) each.

    Each pixel is one cell. The content decides whether it is a PNG, PGM, PPM, PBM, BMP, JPEG or
    TIFF. The first row is the top of the map. The shade of a pixel is the mean of its colour
    channels, from 0 (black) to 1 (white). Pixels below `threshold` are dark, and `dark` says
    whether dark means "occupied" or "free". A pixel that is not fully opaque is unknown, and
    occupied.

    Raises InputError if `threshold` is not above 0 and at most 1, or `dark` is another word. Raises
    FileError if the file is missing or too large, cannot be decoded, or has pixels of an unknown
    mode.
    """
    level = check_finite(threshold, "threshold")
    if level.shape != () or not 0.0 < level <= 1.0:
        rule = "it must be one number above 0 and at most 1"
        raise InputError("threshold", f"is {threshold!r}", rule)
    check_word(dark, "dark", ("occupied", "free"))
    image = read_shades(path, "image", spacing)
    occupied_levels = image.shades < level
    safe_threshold = _find_ros_threshold(image)
    if level < safe_threshold:
        warn_user(
            f"{path}: it looks like the image of a ROS map, and its grey 205, unknown there, "
            f"counts as bright; pass threshold={safe_threshold}"
        )
    if dark == "free":
        occupied_levels = ~occupied_levels
    occupied = image.select(occupied_levels)
    unknown = None
    if isinstance(image.opaque, np.ndarray):
        unknown = frozen(np.logical_not(image.opaque, out=image.opaque))
        occupied |= unknown
    return frozen(occupied), unknown


def _find_ros_threshold(image: Shades) -> float:
    """Return a ROS image's threshold above unknown, or 0.

    Such an image has unknown cells and no other shades than ROS's map savers write, or few that are
    not near them if it was compressed or scaled.
    """
    if image.white_level != _WHITE_8_BIT:
        return 0.0
    levels = np.arange(image.white_level + 1)
    distances = np.abs(levels[:, None] - _ROS_LEVELS)
    has_unknown = (image.levels == _UNKNOWN_LEVEL).any()
    if has_unknown and not image.select(distances.min(axis=1) > 0).any():
        return 0.81
    if not (has_unknown or image.is_lossy):
        return 0.0
    # Largest change of a level by compression or scaling.
    max_blur = 24
    others = image.select(distances.min(axis=1) > max_blur).mean()
    unknown = image.select(distances[:, 1] <= max_blur).mean()
    return 0.9 if others < 0.05 and unknown > 0.1 else 0.0


def _find_world_file(path: Path) -> str:
    """Return an image's world file by name, or ""."""
    # It is named after the image, such as map.pgw, map.pngw or map.wld beside map.png.
    suffix = path.suffix
    for ending in (f"{suffix[:2]}{suffix[-1:]}w", f"{suffix}w", ".wld"):
        if path.with_suffix(ending).is_file():
            return path.with_suffix(ending).name
    return ""


def read_shades(path: StrPath, kind: str, spacing: float, *, may_turn: bool = True) -> Shades:
    """Read the shades of an image of cells, ``spacing`` metres apart.

    Grey images of 16 bits keep all their levels. An EXIF orientation is applied, or refused unless
    `may_turn`. `kind` names the image in messages.

    Raises FileError if the file is missing or too large, cannot be decoded, or has pixels of an
    unknown mode.
    """
    data = read_bytes(path, kind)
    rule = f"it must be a whole file of {', '.join(IMAGE_FORMATS)}"
    with decoding(path, kind, rule), warnings.catch_warnings():
        from PIL import ImageOps

        image = _open_image(data)
        warnings.simplefilter("ignore")  # they concern metadata, which are not used
        check_cells(path, image.size, memory=12.0)  # of colours
        pixels = math.prod(image.size)
        if image.format in _BOUNDED_FORMATS and pixels > _MAX_PIXELS_PER_BYTE * len(data):
            raise ContentError(f"declares {pixels} pixels, more than its bytes can hold")
        if image.format == "PPM":
            _check_length(image, data)
        pages = getattr(image, "n_frames", 1)
        tags: dict[int, Any] = dict(getattr(image, "tag_v2", {}))
        orientation = image.getexif().get(_ORIENTATION, 1)
        if orientation != 1 and not may_turn:
            rule = "map servers ignore it, and viewers do not"
            raise ContentError(f"has EXIF orientation {orientation}", rule)
        if _NODATA in tags:
            rule = "such pixels are neither dark nor bright"
            raise ContentError("has a value for no data", rule)
        image.load()
        ImageOps.exif_transpose(image, in_place=True)
        is_jpeg = image.format == "JPEG" or image.info.get("compression") in _LOSSY_COMPRESSIONS
        shades = _convert_image(image, tags)._replace(is_lossy=is_jpeg)
    if image.format == "PPM":
        _warn_of_spacing(path, data, spacing)
    # Gamma of PNG images that viewers show as they are.
    usual_gamma = 1.0 / 2.2
    gamma = image.info.get("gamma", usual_gamma)
    if pages > 1:
        warn_user(f"{path}: it has {pages} pages or frames, and only the first is read")
    if not math.isclose(gamma, usual_gamma, rel_tol=0.1):
        warn_user(f"{path}: its gamma of {gamma:g} is not applied, so viewers show other shades")
    world_file = _find_world_file(Path(path))
    if tags.keys() & {_PIXEL_SCALE, _TIEPOINT, _MATRIX} or world_file:
        warn_user(
            f"{path}: the placement of {world_file or 'a GeoTIFF'} is not read; {BRING_YOUR_FILE}",
            UnitWarning,
        )
    return shades


def _open_image(data: bytes) -> ImageFile:
    """Open an image with Pillow, without Pillow's own limit of its size."""
    from PIL import Image

    with _PILLOW_LIMIT_LOCK:
        limit = Image.MAX_IMAGE_PIXELS
        Image.MAX_IMAGE_PIXELS = None
        try:
            # Reading from memory bounds a chunk that claims gigabytes by the end of the file.
            return Image.open(io.BytesIO(data), formats=IMAGE_FORMATS)
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def _check_length(image: ImageFile, data: bytes) -> None:
    """Raise ContentError unless an image ends as declared.

    Converted line ends move all pixels, and show only by the length of the file. Also refuse pixels
    brighter than white, which Pillow darkens to white.
    """
    tile: Any = image.tile[0]
    decoder, _, start, arguments = tile
    maximum = int(arguments[1]) if decoder == "ppm" else 0  # of other decoders, no pixel exceeds it
    width, height = image.size
    numbers_per_row = width * len(image.getbands())
    row_size = numbers_per_row
    size = len(data) - start
    if decoder == "ppm_plain":
        words = re.sub(rb"#[^\n\r]*", b"", data[start:]).split()
        size = len(b"".join(words)) if image.mode == "1" else len(words)
    elif image.mode == "1":
        row_size = math.ceil(width / 8)
    elif image.mode == "I" or maximum > _WHITE_8_BIT:
        row_size *= 2
    excess = size - height * row_size
    if excess > 0:
        problem = f"has {excess} bytes or numbers more than its pixels"
        rule = "then its line ends were converted, or it holds several images"
        raise ContentError(problem, rule)
    if maximum:
        levels = np.frombuffer(data, ">u2" if maximum > _WHITE_8_BIT else np.uint8, offset=start)
        if levels.max() > maximum:
            problem = f"has a pixel of {levels.max()}"
            raise ContentError(problem, f"its header says that white is {maximum}")


_SPACING_NOTE: Final = re.compile(rb"#[^\n]*?(\d*\.?\d+) ?(c?)m ?(?:/|per) ?(?:pix|px|cell)")
"""A comment with the side of a cell, as the map savers of ROS write it."""


def _warn_of_spacing(path: StrPath, data: bytes, spacing: float) -> None:
    """Warn if a comment has another side of a cell, metres."""
    # Number of bytes at the start of an image in which a comment may stand.
    note = _SPACING_NOTE.search(data[:512])
    # Error, as a share, of a side that a comment gives with three digits.
    metres = float(note[1]) * (0.01 if note[2] else 1.0) if note else spacing
    if not math.isclose(metres, spacing, rel_tol=0.01, abs_tol=0.0005):
        warn_user(
            f"{path}: a comment says {metres:g} m a pixel, and {spacing:g} m is taken", UnitWarning
        )


_PHOTOMETRIC: Final = 262
_BITS_PER_SAMPLE: Final = 258
_ORIENTATION: Final = 274
_SAMPLE_FORMAT: Final = 339
_PIXEL_SCALE: Final = 33550
_TIEPOINT: Final = 33922
_MATRIX: Final = 34264
_NODATA: Final = 42113
"""Numbers of tags of TIFF, GeoTIFF and GDAL; EXIF has that of the orientation, too."""


def _convert_image(image: Image, tags: dict[int, Any]) -> Shades:
    """Convert an image of Pillow to shades.

    Raises an error if the meaning of its pixels is unknown.
    """
    # Shades of grey have one axis of pixels; colours, and an alpha channel, have a third axis.
    mode, white_level = _choose_channels(image, tags)
    width, height = image.size
    is_deep = mode.startswith("I")
    levels = np.empty(image.size, np.uint8 if white_level == _WHITE_8_BIT else np.uint16)
    opaque = np.empty(image.size, dtype=np.bool_) if mode == "RGBA" else True
    rows_at_once = max(1, _PIXELS_PER_PART // width)
    for top in range(0, height, rows_at_once):
        bottom = min(top + rows_at_once, height)
        rows = image.crop((0, top, width, bottom))
        pixels = np.asarray(rows if rows.mode == mode else rows.convert(mode))
        if is_deep and (pixels.min() < 0 or pixels.max() > white_level):
            raise _make_mode_error(image)
        colours = np.atleast_3d(pixels)[..., :3]
        total = colours[..., 0].astype(levels.dtype, copy=False)
        for channel in range(1, colours.shape[2]):
            total += colours[..., channel]
        # Rows count from the top, but y counts from the bottom.
        part = np.s_[:, height - bottom : height - top]
        levels[part] = total[::-1].T
        if isinstance(opaque, np.ndarray):
            opaque[part] = (pixels[..., 3] == _WHITE_8_BIT)[::-1].T
    if is_deep and tags.get(_PHOTOMETRIC) == 0:  # white is 0; Pillow inverts the others
        np.subtract(white_level, levels, out=levels)
    return Shades(levels, white_level, opaque)


def _choose_channels(image: Image, tags: dict[int, Any]) -> tuple[str, int]:
    """Return the Pillow mode to read an image, and its white level."""
    has_alpha = image.has_transparency_data
    if not set(tags.get(_SAMPLE_FORMAT, ())) <= _UNSIGNED_FORMATS:
        raise _make_mode_error(image)
    if image.mode in ("1", "L") and not has_alpha:
        return "L", _WHITE_8_BIT
    # Mode "I" is 16-bit grey in these two formats, but has an unknown range in the others.
    is_16_bit = image.mode == "I" and image.format in ("PNG", "PPM")
    if (is_16_bit or image.mode.startswith("I;16")) and not has_alpha:
        bits = tags.get(_BITS_PER_SAMPLE, (16,))[0]
        return image.mode, 2**bits - 1
    if image.mode in ("1", "L", *COLOUR_MODES):
        mode = "RGBA" if has_alpha else "RGB"
        return mode, 3 * _WHITE_8_BIT  # the sum of the three colours
    raise _make_mode_error(image)


def _make_mode_error(image: Image) -> ContentError:
    """Return the error for an image whose pixels have no known meaning."""
    rule = "pixels must be grey of up to 16 bits without transparency, or 8-bit colour"
    return ContentError(f"has image mode {image.mode!r}", rule)


PASSABLE_CHARACTERS: Final = ".GS"
BLOCKED_CHARACTERS: Final = "@OTW"
_DROP_CELLS: Final = str.maketrans("", "", PASSABLE_CHARACTERS + BLOCKED_CHARACTERS)


_MAP_HEADER_LINES: Final = 4
"""Number of lines of a ``.map`` file before its rows."""


def read_movingai_map(path: StrPath) -> Bools:
    """Read the blocked cells of a ``.map`` file, shape (width, height).

    ``.``, ``G`` and ``S`` are passable; ``@``, ``O``, ``T`` and ``W`` are blocked. The first row is
    the top.

    Raises FileError if the file is missing, the header is malformed, a row has the wrong length or
    another character, or the number of rows is wrong.
    """
    with decoding(path, "MovingAI map"):
        lines = _read_lines(path, "MovingAI map")
        width, height = _parse_map_header(lines)
        rows = lines[_MAP_HEADER_LINES:]
        widths = set(map(len, rows))
        if len(rows) != height or widths != {width}:
            problem = f"has {len(rows)} rows of {sorted(widths)[:5]} characters"
            raise ContentError(f"{problem} but its header says {height} rows of {width}")
        text = "".join(rows)
        wrong = text.translate(_DROP_CELLS)
        if wrong:
            row, column = divmod(text.index(wrong[0]), width)
            line = _MAP_HEADER_LINES + row + 1
            problem = f"line {line}, column {column + 1} is {wrong[0]!r}"
            rule = f"cells are '{PASSABLE_CHARACTERS}' (passable) or '{BLOCKED_CHARACTERS}'"
            raise ContentError(problem, rule)
        characters = np.frombuffer(text.encode(), dtype=np.uint8).reshape(height, width)
        blocked = np.isin(characters, list(map(ord, BLOCKED_CHARACTERS)))
        # Rows count from the top, but y counts from the bottom.
        return np.ascontiguousarray(blocked[::-1].T)


def _parse_map_header(lines: list[str]) -> tuple[int, int]:
    """Return the width and height from a map's first four lines."""
    # The two sizes may come in either order.
    sizes: dict[str, str] = {}
    for line in lines[1:3]:
        key, _, size = line.partition(" ")
        sizes[key] = size
    is_header = lines[:1] == ["type octile"] and lines[3:4] == ["map"]
    if is_header and sizes.keys() == {"height", "width"} and all(map(is_count, sizes.values())):
        width = int(sizes["width"])
        height = int(sizes["height"])
        if width and height:
            return width, height
    rule = "it must be 'type octile', 'height H', 'width W' and 'map', a line each, H and W above 0"
    raise ContentError(f"begins with {lines[:4]!r:.100}", rule)


def read_movingai_voxels(path: StrPath) -> Bools:
    """Read the blocked voxels of a ``.3dmap`` file, shape (nx, ny, nz).

    The first line is ``voxel`` and the numbers of voxels along x, y and z. Each other line is ``x y
    z`` of a blocked voxel, counted from 0. A file truncated between two lines cannot be detected.

    Raises FileError, naming the line, if the file is missing, declares too many voxels, or a line
    is malformed or names a voxel outside the map.
    """
    lines = _read_lines(path, "MovingAI voxel map", memory=100.0)
    with decoding(path, "MovingAI voxel map"):
        # The header, then a voxel in each line.
        keyword, *sizes = lines[0].split() or [""]
        shape = _parse_counts(sizes)
        if keyword != "voxel" or min(shape, default=0) < 1:
            raise _make_line_error(1, lines, "'voxel' and three whole numbers above zero")
        check_cells(path, shape, memory=WORKSPACE_CELL_BYTES)
        blocked = np.zeros(shape, dtype=np.bool_)
        for number, line in enumerate(lines[1:], start=2):
            words = line.split()
            if not words:
                continue
            voxel = _parse_counts(words)
            if not voxel or (np.array(voxel) >= shape).any():
                rule = f"'x y z' of a voxel inside {' x '.join(sizes)}, counted from 0"
                raise _make_line_error(number, lines, rule)
            blocked[voxel] = True
    return blocked


def _parse_counts(words: list[str]) -> tuple[int, ...]:
    """Parse three whole numbers; return an empty tuple for other words."""
    if len(words) != 3 or not all(map(is_count, words)):
        return ()
    return tuple(map(int, words))


def _read_lines(path: StrPath, kind: str, memory: float = 6.0) -> list[str]:
    """Read the lines of a text file without trailing blank lines."""
    text = read_text(path, kind, memory).rstrip()
    return [line.rstrip() for line in text.split("\n")]


def _make_line_error(number: int, lines: list[str], rule: str) -> ContentError:
    """Return the error for a line that breaks `rule`."""
    problem = f"line {number} is {lines[number - 1][:60]!r}"
    return ContentError(problem, f"it must hold {rule}")
