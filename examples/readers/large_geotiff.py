"""Open a GeoTIFF larger than memory, with rioxarray and dask.

Dark cells and cells without data are occupied. Its corner, which may be millions of metres away,
moves to the origin.
"""

import rioxarray

import cspace
from cspace.errors import FileError


def open_large_geotiff(path: str, spacing: float = 0.1, light: float = 127.0) -> cspace.Workspace:
    """Open shades: those above ``light`` are free; they are read when needed."""
    shades = rioxarray.open_rasterio(path, chunks=4096, mask_and_scale=True)
    crs = shades.rio.crs
    is_mercator = crs and "mercator" in crs.to_wkt().lower().replace("transverse_mercator", "")
    if len(shades) != 1 or (crs and crs.units_factor[1] != 1) or is_mercator:
        problem = "has several bands, or is in degrees, feet or Mercator"
        raise FileError(path, problem, "one band in metres is read", "project it: gdalwarp -t_srs")
    occupied = ~(shades.squeeze("band", drop=True) > light)
    return cspace.Workspace.from_array(occupied, spacing, lower=(0, 0))


if __name__ == "__main__":
    import sys

    print(open_large_geotiff(sys.argv[1]))
