"""Read a Shapefile, GeoPackage, KML, GML of geography or FlatGeobuf, with geopandas.

All layers are read, which folders of a KML are, also hidden ones. Degrees and feet become metres of
UTM; a file without a reference system is in metres. Heights are dropped. The corner, which may be
millions of metres away, moves to the origin, and is printed.
"""

import geopandas
import pandas

import cspace
from cspace.errors import FileError


def read_site(path: str, spacing: float = 0.1) -> cspace.Workspace:
    """Read the shapes of all layers as obstacles."""
    has_shapes = geopandas.list_layers(path).geometry_type.notna()
    numbers = [number for number, each in enumerate(has_shapes) if each]  # names may come twice
    layers = [geopandas.read_file(path, layer=number) for number in numbers]
    layers = [layer for layer in layers if len(layer)]
    if not layers:
        raise FileError(path, "has no shapes", "obstacles are shapes")
    utm = None
    for number, layer in enumerate(layers):
        if layer.crs and (layer.crs.is_geographic or layer.crs.is_projected):
            utm = utm or layer.estimate_utm_crs()
            layers[number] = layer.to_crs(utm)
    site = pandas.concat([layer[[layer.geometry.name]] for layer in layers])
    west, south, east, north = site.total_bounds
    if not site.crs and max(east - west, north - south) < 1 and abs(west) <= 180:
        problem = f"has no reference system, and is {east - west:g} wide"
        raise FileError(
            path, problem, "that looks like degrees", "set it: ogr2ogr -a_srs EPSG:4326"
        )
    print(f"{path}: the corner was at {west:.3f}, {south:.3f}")
    return cspace.Workspace.from_polygons(site.force_2d(), spacing, offset=(-west, -south))


if __name__ == "__main__":
    import sys

    print(read_site(sys.argv[1]))
