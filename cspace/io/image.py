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

from cspace.arrays import Bools, Floats
from cspace.errors import InputError
from cspace.grid import finite
from cspace.io.files import Fault, decoding, existing, read_bytes
from cspace.io.limits import check_cells

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS: Final = ("PNG", "PPM", "BMP", "JPEG", "TIFF")
"""What an image may be, by its content and whatever its name: Pillow's other plug-ins may start programs."""

COLOUR_MODES: Final = ("P", "RGB", "RGBX", "RGBA", "RGBa", "LA", "La", "PA", "CMYK", "YCbCr", "HSV")
SIDES: Final = ("occupied", "free")

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
        """Pixels whose shade, from 0 (black) to 1 (white), passes a test of shades."""
        return np.asarray(test(np.arange(self.most + 1) / float(self.most))[self.levels])


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
    occupied = image.where(lambda shade: (shade < level) == (dark == "occupied"))
    return occupied if image.opaque is True else occupied | ~np.asarray(image.opaque)


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
    opaque: Bools | bool = True
    levels: NDArray[Any] | None = None
    most = 255
    if image.mode in ("1", "L") and not image.has_transparency_data:
        levels = np.asarray(image.convert("L"))
    # Mode "I" means 16 bits in these formats, and an unknown range in others.
    elif image.mode.startswith("I;16") or (image.mode == "I" and image.format in ("PNG", "PPM")):
        wide = np.asarray(image)
        if not image.has_transparency_data and wide.min() >= 0 and wide.max() <= 65535:
            levels, most = wide.astype(np.uint16), 65535
    elif image.mode in ("1", "L", *COLOUR_MODES):
        channels = np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
        if image.has_transparency_data:
            opaque = np.ascontiguousarray((channels[:, :, 3] == 255)[::-1].T)
        levels, most = channels[:, :, 0].astype(np.uint16), 3 * 255
        levels += channels[:, :, 1]
        levels += channels[:, :, 2]
    if levels is None:
        raise Fault(
            f"has image mode {image.mode!r}",
            "pixels must be grey of up to 16 bits without transparency, or colour of 8 bits",
            "convert it, e.g. to an 8-bit grey PNG",
        )
    return Shades(np.ascontiguousarray(levels[::-1].T), most, opaque)
