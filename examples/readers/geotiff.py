"""Read a GeoTIFF of costs, with rioxarray.

The scale of the band applies, and cells without data count as occupied. A file in degrees or feet,
or in a projection that stretches lengths by more than 1 %, such as Mercator, is projected to UTM:
``max`` keeps occupied cells. A file without a reference system is in metres. The corner of the
file, which may be millions of metres away, moves to the origin, and is printed.
"""

import pyproj
import rioxarray
from rasterio.enums import Resampling

import cspace
from cspace.errors import FileError


def read_geotiff(path: str, free_below: float = 50.0, cell: float = 0.1) -> cspace.Workspace:
    """Read costs: cells below a cost are free; ``cell`` is the side of projected ones, metres."""
    costs = rioxarray.open_rasterio(path, mask_and_scale=True)
    if len(costs) != 1:
        rule = "one band is read, without colours or a mask"
        raise FileError(path, f"has {len(costs)} bands", rule, "extract it: gdal_translate -b 1")
    if costs.rio.transform().is_identity or not costs.rio.transform().is_rectilinear:
        rule = "it must say where its cells are, in rows along x"
        raise FileError(path, "is not placed, or turned", rule, "project it: gdalwarp")
    costs = costs.squeeze("band", drop=True)
    if not costs.max() >= free_below:
        problem = f"has no cost from {free_below:g} on"
        raise FileError(path, problem, "each cell would be free", "pass free_below=, e.g. 0.5")
    occupied = ~(costs < free_below)
    if costs.rio.crs and not is_in_metres(costs):
        occupied = occupied.astype("uint8").rio.write_nodata(255)
        utm = occupied.rio.estimate_utm_crs()
        occupied = occupied.rio.reproject(utm, resolution=cell, resampling=Resampling.max) != 0
    west, south, _, _ = occupied.rio.bounds()
    print(f"{path}: the corner was at {west:.3f}, {south:.3f}")
    return cspace.Workspace.from_array(occupied, abs(occupied.rio.resolution()[0]), lower=(0, 0))


def is_in_metres(array) -> bool:
    """Return True if a unit of the reference system is a metre on the ground, within 1 %."""
    system = pyproj.CRS(array.rio.crs)
    if not system.is_projected or system.axis_info[0].unit_conversion_factor != 1:
        return False
    west, south, east, north = array.rio.transform_bounds("EPSG:4326")
    scales = pyproj.Proj(system).get_factors((west + east) / 2, (south + north) / 2)
    return max(abs(scales.meridional_scale - 1), abs(scales.parallel_scale - 1)) < 0.01


if __name__ == "__main__":
    import sys

    print(read_geotiff(sys.argv[1]))
