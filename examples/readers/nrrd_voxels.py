"""Read voxels of an NRRD file, with pynrrd.

Its array is indexed ``[x, y, z]``; the origin is the center of the first voxel. Its unit is the
millimetre unless it names one. Voxels of 0 are free.
"""

import nrrd
import numpy as np

import cspace
from cspace.errors import FileError

METRES = {"mm": 0.001, "millimeter": 0.001, "cm": 0.01, "m": 1.0, "meter": 1.0}


def read_nrrd(path: str) -> cspace.Workspace:
    """Read voxels that are cubes along the axes."""
    voxels, header = nrrd.read(path)
    units = set(header.get("space units", header.get("units", ["mm"])))
    if len(units) != 1 or not units <= METRES.keys():
        raise FileError(path, f"has the units {sorted(units)}", f"known are {', '.join(METRES)}")
    spacings = header.get("spacings", np.full(3, np.nan))
    sides = header.get("space directions", np.diag(spacings))
    if np.shape(sides) != (3, 3) or not np.allclose(sides, sides[0, 0] * np.eye(3)):
        problem = "has voxels that are turned, or no cubes, or more than one value each"
        raise FileError(path, problem, "cells are cubes along x, y and z", "resample it")
    side = METRES[units.pop()] * sides[0, 0]
    origin = side / sides[0, 0] * header.get("space origin", np.zeros(3))
    return cspace.Workspace.from_array(~(voxels <= 0), side, origin - side / 2)


if __name__ == "__main__":
    import sys

    print(read_nrrd(sys.argv[1]))
