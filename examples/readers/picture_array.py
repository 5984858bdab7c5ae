"""Make cells of a picture that is an array of PIL or OpenCV.

Pictures are indexed ``[row, column]``, the first row at the top. Dark pixels are walls, and
transparent ones unknown. ``cspace.Workspace.open`` does the same with the file, also with 16 bits.
"""

import numpy as np
import PIL.Image
import PIL.ImageOps

import cspace
from cspace.errors import FileError


def read_picture(path: str, spacing: float = 0.1) -> cspace.Workspace:
    """Read a picture, with ``spacing`` metres a pixel."""
    image = PIL.ImageOps.exif_transpose(PIL.Image.open(path))
    if image.mode[0] in "IF":
        hint = f"use cspace.Workspace.open({path!r}, spacing={spacing:g})"
        raise FileError(path, "has 16 bits or more a pixel", "Pillow converts the lowest 8", hint)
    shade, alpha = np.asarray(image.convert("RGBA").convert("LA")).T
    return cspace.Workspace.from_array(((shade < 128) | (alpha < 255))[:, ::-1], spacing)


if __name__ == "__main__":
    import sys

    print(read_picture(sys.argv[1]))
