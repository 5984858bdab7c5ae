"""Images as shades over a grid, read by Pillow."""

from __future__ import annotations

import io
import math
import os
import threading
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, copy_transposed
from cspace.check import finite
from cspace.errors import InputError
from cspace.files.access import Fault, decoding, existing, read_bytes
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
        raise InputError(
            "threshold",
            f"is {threshold!r}",
            "it must be one number above 0 and at most 1",
            "pass e.g. 0.5",
            value=threshold,
        )
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
    return Fault(
        f"has image mode {image.mode!r}",
        "pixels must be grey of up to 16 bits without transparency, or colour of 8 bits",
        "convert it, e.g. to an 8-bit grey PNG",
    )
