"""Cells of the plane from images, read by Pillow, and from the grid and voxel maps of the MovingAI benchmarks.

Sturtevant, "Benchmarks for Grid-Based Pathfinding", 2012; Brewer and Sturtevant, "Benchmarks for Pathfinding in 3D
Voxel Space", 2018.
"""

from __future__ import annotations

import io
import math
import os
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, copy_transposed
from cspace.check import finite
from cspace.errors import InputError
from cspace.files.access import Fault, decoding, existing, is_count, read_bytes, read_text
from cspace.limits import check_cells

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS: Final = ("PNG", "PPM", "BMP", "JPEG", "TIFF")
"""What an image may be, by its content and whatever its name: Pillow's other plug-ins may start programs."""

COLOUR_MODES: Final = ("P", "RGB", "RGBX", "RGBA", "RGBa", "LA", "La", "PA", "CMYK", "YCbCr", "HSV")
SIDES: Final = ("occupied", "free")

ROWS_PER_BAND: Final = 64
"""Rows of an image that are read together, so that they stay in the cache."""

_BYTES_A_PIXEL: Final = 12
"""Memory while an image in colour is read."""

_PACKED: Final = ("PNG", "PPM", "BMP")
_MOST_A_BYTE: Final = 8 * 1040
"""Pixels that a byte of these formats can stand for: eight of one bit, deflated."""

_PILLOWS_LIMIT: Final = threading.Lock()
"""Held while Pillow's own limit, which belongs to the whole process, is set aside for ours."""


@dataclass(frozen=True, slots=True)
class Shades:
    """An image in the order of the coordinates: ``[x, y]``, with y up.

    Attributes
    ----------
    levels : ndarray of unsigned integers, shape (nx, ny)
    most : int
        The level of white; black is 0.
    opaque : ndarray of bool, shape (nx, ny), or True
        Whether the pixel has full alpha.
    """

    levels: NDArray[np.unsignedinteger[Any]]
    most: int
    opaque: Bools | bool

    def where(self, test: Callable[[Floats], Bools]) -> Bools:
        """Return the pixels whose shade, from 0 (black) to 1 (white), passes a test of shades.

        Levels are compared with the ends of the ranges that pass, which is much quicker than a table of all levels.
        """
        passes, passing = test(np.arange(self.most + 1) / float(self.most)), None
        for first, stop in np.flatnonzero(np.diff(passes, prepend=False, append=False)).reshape(-1, 2).tolist():
            chosen = self.levels >= first if first else self.levels < stop
            if first and stop <= self.most:
                chosen &= self.levels < stop
            passing = chosen if passing is None else passing | chosen
        return np.zeros(self.levels.shape, dtype=np.bool_) if passing is None else passing

    def among_opaque(self, pixels: Bools) -> Bools:
        """Return those of some pixels that are opaque."""
        return pixels if self.opaque is True else pixels & self.opaque


def read_image(path: str | os.PathLike[str], threshold: float = 0.5, dark: str = "occupied") -> Bools:
    """Occupied cells of an image, one cell for each pixel, shape (nx, ny).

    It is a PNG, PGM, PPM, PBM, BMP, JPEG or TIFF, told by its content. Its first row is the top of the map. Pixels
    whose shade, the mean of their colour channels from 0 (black) to 1 (white), is below ``threshold`` are dark, and
    ``dark`` says what these are, "occupied" or "free". A pixel that is not fully opaque shows no ground, and is
    occupied either way.

    Raises InputError if ``threshold`` is not above 0 and at most 1, or ``dark`` is neither word, and FileError if the
    file is missing, too large, cannot be decoded, or has pixels of an unknown kind.
    """
    level = finite(threshold, "threshold")
    if level.shape != () or not 0.0 < level <= 1.0:
        rule = "it must be one number above 0 and at most 1"
        raise InputError("threshold", f"is {threshold!r}", rule, "pass e.g. 0.5", value=threshold)
    if dark not in SIDES:
        raise InputError("dark", f"is {dark!r}", "it says what dark pixels are", f"pass one of {SIDES}", value=dark)
    image = read_shades(path, "image")
    if image.opaque is True:
        return image.where(lambda shade: (shade < level) == (dark == "occupied"))
    return ~image.among_opaque(image.where(lambda shade: (shade < level) == (dark == "free")))


def read_shades(path: str | os.PathLike[str], kind: str) -> Shades:
    """Shades of an image: the mean of the colour channels. Grey images of 16 bits keep all their levels.

    Raises FileError if the file is missing, too large, cannot be decoded, or has pixels of an unknown kind; ``kind``
    says in messages what the image is.
    """
    from PIL import Image

    file = existing(path, kind)
    data = read_bytes(file, kind)
    with decoding(file, kind, f"it is a whole file of {', '.join(FORMATS)}", "save it again"):
        with _PILLOWS_LIMIT:
            limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
            try:
                # From memory, where a chunk that claims gigabytes ends with the file.
                image = Image.open(io.BytesIO(data), formats=FORMATS)
            finally:
                Image.MAX_IMAGE_PIXELS = limit
        with image, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of metadata that cannot be read, which is not asked for
            check_cells(file, image.size, memory=_BYTES_A_PIXEL)
            if image.format in _PACKED and math.prod(image.size) > _MOST_A_BYTE * len(data):
                raise Fault(f"declares {image.width} x {image.height} pixels, more than its bytes can hold")
            image.load()
            return _shades(image)


def _shades(image: Image) -> Shades:
    is_clear, most = image.has_transparency_data, 255
    if image.mode in ("1", "L") and not is_clear:
        channels = "L"
    # Mode "I" means 16 bits in these formats, and an unknown range in others.
    elif (image.mode.startswith("I;16") or (image.mode == "I" and image.format in ("PNG", "PPM"))) and not is_clear:
        channels, most = image.mode, 65535
    elif image.mode in ("1", "L", *COLOUR_MODES):
        channels, most = "RGBA" if is_clear else "RGB", 3 * 255
    else:
        raise _unknown_pixels(image)
    levels = np.empty(image.size, dtype=np.uint8 if most == 255 else np.uint16)
    opaque = np.empty(image.size, dtype=np.bool_) if channels == "RGBA" else None
    for top in range(0, image.height, ROWS_PER_BAND):
        # Rows from the top become columns from the far end; what is between is small enough for the cache.
        low, high = image.height - min(top + ROWS_PER_BAND, image.height), image.height - top
        band = image.crop((0, top, image.width, image.height - low))
        band = band if band.mode == channels else band.convert(channels)
        if most == 3 * 255:
            red, green, blue, *alpha = (np.asarray(channel)[::-1] for channel in band.split())
            rows = np.add(red, green, dtype=np.uint16)
            rows += blue
            if opaque is not None:
                copy_transposed(alpha[0] == 255, opaque[:, low:high])
        else:
            rows = np.asarray(band)[::-1]
            if most == 65535 and (rows.min() < 0 or rows.max() > most):
                raise _unknown_pixels(image)
        copy_transposed(rows, levels[:, low:high])
    return Shades(levels, most, True if opaque is None else opaque)


def _unknown_pixels(image: Image) -> Fault:
    rule = "pixels must be grey of up to 16 bits without transparency, or colour of 8 bits"
    return Fault(f"has image mode {image.mode!r}", rule, "convert it, e.g. to an 8-bit grey PNG")


PASSABLE: Final = ".GS"
BLOCKED: Final = "@OTW"
_VOXEL_LINES: Final = frozenset("0123456789 \t\n")
_DROP_CELLS: Final = str.maketrans("", "", PASSABLE + BLOCKED)


def read_map(path: str | os.PathLike[str]) -> Bools:
    """Blocked cells of a ``.map`` file, shape (width, height).

    ``.``, ``G`` and ``S`` are passable; ``@``, ``O``, ``T`` and ``W`` are blocked. The first row is the top.

    Raises FileError if the file is missing, the header is malformed, a row has the wrong length or another character,
    or rows are missing or left over; the message names the line.
    """
    with decoding(path, "MovingAI map"):
        lines = _lines(path, "MovingAI map")
        if lines[:1] != ["type octile"]:
            raise _fault(1, lines, "'type octile'")
        sizes: dict[str, int] = {}
        for number, line in enumerate(lines[1:3], start=2):
            key, _, value = line.partition(" ")
            if key not in ("height", "width") or not is_count(value.strip()) or int(value) == 0:
                raise _fault(number, lines, "'height' or 'width' and a whole number above zero")
            sizes[key] = int(value)
        if len(sizes) != 2:
            raise _fault(min(len(lines), 2) + 1, lines, "'height' and 'width', once each, in lines 2 and 3")
        if lines[3:4] != ["map"]:
            raise _fault(4, lines, "'map'")
        rows, width, height = lines[4:], sizes["width"], sizes["height"]
        for number, row in enumerate(rows, start=5):
            if len(row) != width:
                raise Fault(f"line {number} has {len(row)} characters, and the header says width {width}")
            wrong = row.translate(_DROP_CELLS)
            if wrong:
                problem = f"line {number}, column {row.index(wrong[0]) + 1} is {wrong[0]!r}"
                rule = f"cells are one of '{PASSABLE}' (passable) or '{BLOCKED}' (blocked)"
                raise Fault(problem, rule, "replace it")
        if len(rows) != height:
            raise Fault(f"ends at line {len(lines)} with {len(rows)} rows, and the header says height {height}")
        cells = np.frombuffer("".join(rows).encode("ascii"), dtype=np.uint8).reshape(height, width)
        blocked = np.isin(cells, np.frombuffer(BLOCKED.encode("ascii"), dtype=np.uint8))
        return np.ascontiguousarray(blocked[::-1].T)


def read_3dmap(path: str | os.PathLike[str]) -> Bools:
    """Blocked voxels of a ``.3dmap`` file, shape (nx, ny, nz).

    The first line is ``voxel`` and the numbers of voxels along x, y and z; each other line is ``x y z`` of a blocked
    voxel, counted from 0.

    Raises FileError if the file is missing, declares too many voxels, or a line is malformed or has a voxel outside the
    map; the message names the line. A file that is cut between two lines cannot be told from a whole one.
    """
    first, _, body = read_text(path, "MovingAI voxel map").partition("\n")
    with decoding(path, "MovingAI voxel map"):
        kind, *counts = first.split() or [""]
        if kind != "voxel" or len(counts) != 3 or not all(is_count(count) and int(count) > 0 for count in counts):
            raise _fault(1, [first.rstrip()], "'voxel' and three whole numbers above zero")
        shape = (int(counts[0]), int(counts[1]), int(counts[2]))
        check_cells(path, shape)
        blocked = np.zeros(shape, dtype=np.bool_)
        if not body.strip():
            return blocked
        if _VOXEL_LINES.issuperset(body):
            with suppress(ValueError):
                voxels = np.loadtxt(io.StringIO(body), dtype=np.int64, comments=None, ndmin=2)
                if voxels.shape[1] == 3 and (voxels < shape).all():
                    blocked[tuple(voxels.T)] = True
                    return blocked
        raise _voxel_fault(body, shape)


def _voxel_fault(body: str, shape: tuple[int, int, int]) -> Fault:
    """What is wrong with the first line of a voxel map, below the header, that is not what it should be."""
    lines = ["", *(line.strip() for line in body.split("\n"))]
    for number, line in enumerate(lines[1:], start=2):
        tokens = line.split()
        if tokens and not (len(tokens) == 3 and all(map(is_count, tokens))):
            return _fault(number, lines, "'x y z' of a blocked voxel, whole numbers from 0 on")
        if tokens and any(int(token) >= n for token, n in zip(tokens, shape, strict=True)):
            return _fault(number, lines, f"a voxel inside {' x '.join(map(str, shape))}, counted from 0")
    return Fault("cannot be read as lines of 'x y z'")


def _lines(path: str | os.PathLike[str], kind: str) -> list[str]:
    """Lines of a text file, without blank ones at the end."""
    return [line.rstrip() for line in read_text(path, kind).rstrip().split("\n")]


def _fault(number: int, lines: list[str], rule: str) -> Fault:
    """What is wrong with a line that is not what it should be."""
    line = repr(lines[number - 1][:60]) if number <= len(lines) else "missing"
    return Fault(f"line {number} is {line}", f"it must hold {rule}", "mend it or fetch it again")
