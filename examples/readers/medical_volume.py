"""Read voxels of MHA, NIfTI, DICOM or NRRD, with SimpleITK.

It gives ``[z, y, x]``, in millimetres. Voxels of 0 are free.
"""

import numpy as np
import SimpleITK

import cspace
from cspace.errors import FileError


def read_volume(path: str) -> cspace.Workspace:
    """Read voxels that are cubes along the axes."""
    image = SimpleITK.ReadImage(path)
    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1:
        raise FileError(path, "holds no volume of one value a voxel", "it needs x, y and z")
    image = SimpleITK.DICOMOrient(image, "LPS")
    voxels = SimpleITK.GetArrayFromImage(image).T  # from [z, y, x] to [x, y, z]
    sides = 0.001 * np.array(image.GetSpacing())  # from millimetres
    lower = 0.001 * np.array(image.GetOrigin()) - sides / 2
    is_turned = not np.allclose(image.GetDirection(), np.eye(3).ravel())
    if is_turned or not np.allclose(sides, sides[0]):
        problem = "has voxels that are turned, or no cubes"
        raise FileError(path, problem, "cells are cubes along x, y and z", "resample it")
    return cspace.Workspace.from_array(~(voxels <= 0), sides[0], lower)


if __name__ == "__main__":
    import sys

    print(read_volume(sys.argv[1]))
