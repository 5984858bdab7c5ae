"""Read points of PCD of compressed data, XYZRGB or PTS, with open3d.

Points without a place, which are NaN, are left out.
"""

import re
from pathlib import Path

import numpy as np
import open3d

import cspace
from cspace.errors import FileError


def read_cloud(path: str, spacing: float = 0.1, radius: float = 0.05) -> cspace.Workspace:
    """Read points, in metres, as balls of a radius."""
    with Path(path).open("rb") as file:
        view = re.search(rb"^VIEWPOINT +([^\n]+)", file.read(2048), re.MULTILINE)
    if view and [float(each) for each in view[1].split()] != [0, 0, 0, 1, 0, 0, 0]:
        problem = f"has the VIEWPOINT {view[1].decode().strip()}"
        raise FileError(path, problem, "its points are not in the frame of the map", "transform it")
    scan = open3d.io.read_point_cloud(path, remove_nan_points=True)
    return cspace.Workspace.from_points(np.asarray(scan.points), spacing, radius=radius)


if __name__ == "__main__":
    import sys

    print(read_cloud(sys.argv[1]))
