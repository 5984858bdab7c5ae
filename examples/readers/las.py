"""Read a LAS or LAZ file, with laspy.

Degrees and feet become metres of UTM if the file names its reference system; without one, it is in
metres. The lowest corner, which may be millions of metres away, moves to the origin, and is
printed. Points that the file has as withheld are left out.
"""

import geopandas
import laspy
import numpy as np
import pyproj

import cspace
from cspace.errors import FileError


def read_las(path: str, spacing: float = 0.1, radius: float = 0.05) -> cspace.Workspace:
    """Read points as balls of a radius, metres."""
    scan = laspy.read(path)
    points = np.array(scan.xyz)[np.asarray(scan.withheld) == 0]
    crs = scan.header.parse_crs()
    is_on_earth = crs and (crs.is_geographic or crs.is_projected) and not crs.is_geocentric
    if crs and not is_on_earth and (crs.is_geocentric or crs.axis_info[0].unit_name != "metre"):
        hint = "project it: pdal translate --filters.reprojection.out_srs=EPSG:32632"
        raise FileError(path, f"is in {crs.name}", "x and y lie in the ground, in metres", hint)
    if is_on_earth:
        first = geopandas.GeoSeries.from_xy(*points[:1, :2].T, crs=crs)
        to_utm = pyproj.Transformer.from_crs(crs, first.estimate_utm_crs(), always_xy=True)
        points[:, :2] = np.transpose(to_utm.transform(*points[:, :2].T))
        height = crs.axis_info[-1]  # that of the plan, if heights have none
        points[:, 2] *= 1 if height.unit_name == "degree" else height.unit_conversion_factor
    lower = points.min(axis=0)
    print(f"{path}: the corner was at {', '.join(f'{each:.3f}' for each in lower)}")
    return cspace.Workspace.from_points(points, spacing, radius=radius, offset=-lower)


if __name__ == "__main__":
    import sys

    print(read_las(sys.argv[1]))
