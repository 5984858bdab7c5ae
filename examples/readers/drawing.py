"""Open a scanned floor plan, and remove what is thinner than its walls, with scipy."""

import numpy as np
from PIL import Image, ImageOps
from scipy import ndimage

from cspace.errors import FileError


def open_drawing(path: str, spacing: float, thickest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the dark cells, indexed ``[x, y]``, and those of parts thicker than ``thickest``, metres.

    ``spacing`` are metres a pixel. Transparent pixels are unknown, and count as dark.
    """
    image = ImageOps.exif_transpose(Image.open(path))
    if image.mode[0] in "IF":
        raise FileError(
            path, "has 16 bits or more a pixel", "Pillow converts the lowest 8", "save 8"
        )
    shade, alpha = np.asarray(image.convert("RGBA").convert("LA")).T
    dark = ((shade < 128) | (alpha < 255))[:, ::-1]  # y points up
    size = round(thickest / spacing)
    return dark, ndimage.binary_opening(dark, np.ones((size, size)))


if __name__ == "__main__":
    import sys

    dark, walls = open_drawing(sys.argv[1], spacing=0.01, thickest=0.05)
    print(f"{dark.sum()} cells are dark, {walls.sum()} of them thick")
