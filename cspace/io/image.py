"""Images as shades over a grid, read by Pillow."""

from __future__ import annotations

import os
import struct
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError, InputError
from cspace.grid import finite
from cspace.io.input import existing

if TYPE_CHECKING:
    from PIL.Image import Image

COLOUR_MODES: Final = ("P", "RGB", "RGBX", "RGBA", "RGBa", "LA", "La", "PA", "CMYK", "YCbCr", "HSV")
SIDES: Final = ("occupied", "free")


def read_image(path: str | os.PathLike[str], threshold: float = 0.5, dark: str = "occupied") -> NDArray[np.bool_]:
    """Occupied cells of an image, one cell for each pixel.

    Parameters
    ----------
    path : path-like
        Any image that Pillow reads. Its first row is the top of the map.
    threshold : float
        Pixels whose shade, the mean of their colour channels from 0 (black) to 1 (white), is below this are dark.
    dark : {"occupied", "free"}
        What dark pixels are. A pixel that is not fully opaque shows no ground, and is occupied either way.

    Returns
    -------
    ndarray of bool, shape (nx, ny)

    Raises
    ------
    InputError
        If ``threshold`` is not above 0 and at most 1, or ``dark`` is neither word.
    FileError
        If the file is missing, cannot be decoded, or has pixels of an unknown kind.
    """
    level = finite(threshold, "threshold")
    if level.ndim or not 0.0 < level <= 1.0:
        raise InputError(f"threshold is {threshold!r}; it must be one number above 0 and at most 1; pass e.g. 0.5")
    if dark not in SIDES:
        raise InputError(f"dark is {dark!r}; it says what dark pixels are; pass one of {', '.join(map(repr, SIDES))}")
    shade, opaque = read_shades(path, "image")
    is_dark = shade < level
    return np.asarray((is_dark if dark == "occupied" else ~is_dark) | ~opaque)


def read_shades(path: str | os.PathLike[str], kind: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Shades of an image, turned into the order of the coordinates: ``[x, y]``, with y up.

    Parameters
    ----------
    path : path-like
    kind : str
        What the image is, for messages.

    Returns
    -------
    shade : ndarray of float64, shape (nx, ny)
        Mean of the colour channels, from 0 (black) to 1 (white). Grey images of 16 bits keep all their levels.
    opaque : ndarray of bool, shape (nx, ny)
        Whether the pixel has full alpha; all True for an image without alpha.

    Raises
    ------
    FileError
        If the file is missing, cannot be decoded, or has pixels of an unknown kind.
    """
    from PIL import Image

    file = existing(path, kind)
    try:
        with Image.open(file) as image:
            image.load()
    # What Pillow's decoders raise on damaged files, beside OSError.
    except (
        OSError,
        SyntaxError,
        ValueError,
        EOFError,
        IndexError,
        struct.error,
        Image.DecompressionBombError,
    ) as error:
        raise FileError(
            f"{file} cannot be decoded as an image: {error}; a {kind} is a whole PNG, PGM, PPM, JPEG or BMP file; "
            "save it again"
        ) from error
    shade, opaque = _shades(image, file)
    return np.ascontiguousarray(shade[::-1].T), np.ascontiguousarray(opaque[::-1].T)


def _shades(image: Image, file: os.PathLike[str]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Shades and opaqueness of a decoded image, ``[row, column]``."""
    opaque = np.ones((image.height, image.width), dtype=np.bool_)
    if image.mode in ("1", "L") and not image.has_transparency_data:
        return np.asarray(image.convert("L")) / 255.0, opaque
    # Mode "I" means 16 bits in these formats, and an unknown range in others.
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format in ("PNG", "PPM")):
        levels = np.asarray(image)
        if not image.has_transparency_data and levels.min() >= 0 and levels.max() <= 65535:
            return levels / 65535.0, opaque
    elif image.mode in ("1", "L", *COLOUR_MODES):
        channels = np.asarray(image.convert("RGBA" if image.has_transparency_data else "RGB"))
        if image.has_transparency_data:
            opaque = channels[:, :, 3] == 255
        return channels[:, :, :3].sum(axis=2, dtype=np.uint16) / (3 * 255.0), opaque
    raise FileError(
        f"{os.fspath(file)} has image mode {image.mode!r}; pixels must be grey of up to 16 bits without transparency, "
        "or colour of 8 bits; convert it, e.g. to an 8-bit grey PNG"
    )
