"""Snippets of the page "Bring your file", run with the packages that they name.

The packages are large, so `nox -s formats` installs them apart, and other sessions skip this file.
Each input is written by a package of its own, in each form that people have, and shapely compares
each world with the one written.
"""

import contextlib
import io
import json
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity

import cspace
from cspace import CspaceError

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/howto/bring_your_file.md").read_text(encoding="utf-8")
SNIPPETS = re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)

WALLS = (1.0, 0.5, 2.0, 1.0), (5.0, 3.0, 5.5, 3.5)
"""Two walls: lower and upper x and y, metres; those in space are 3 m high."""

CELLS = np.zeros((60, 40), dtype=bool)
"""The walls in cells of 0.1 m, indexed [x, y]."""
CELLS[10:20, 5:10] = CELLS[50:55, 30:35] = True

X, Y = (0.1 * np.arange(number) + 0.05 for number in CELLS.shape)
"""Centers of the cells, metres."""

PLAN = shapely.union_all([shapely.box(*wall) for wall in WALLS])
"""The walls seen from above."""

VOXELS = np.repeat(CELLS[:, :, None], 30, axis=2).astype(np.uint8)


FEET = "+proj=utm +zone=32 +datum=WGS84 +units=us-ft +type=crs"
"""A reference system in feet."""


def write_raster(crs, x, y):
    """Write costs and unknown cells, the first row at the top, at centers in a reference system."""
    import rioxarray  # noqa: F401  # adds .rio to arrays
    import xarray

    costs = np.where(CELLS, 100.0, 0.0).astype(np.float32)
    costs[55:, :5] = -9999.0  # unknown
    array = xarray.DataArray(costs.T[::-1], dims=("y", "x"), coords={"x": x, "y": y[::-1]})
    array.rio.write_crs(crs).rio.write_nodata(-9999.0).rio.to_raster("costs.tif")


UNKNOWN = shapely.box(5.5, 0.0, 6.0, 0.5)
"""Unknown cells of the costs."""


def write_geotiff():
    """Write costs in Gauss-Krueger coordinates near the origin of a zone."""
    write_raster("EPSG:32632", X, Y)
    return PLAN | UNKNOWN


def write_geotiff_of_utm():
    """Write costs far north of the equator."""
    write_raster("EPSG:32632", X + 500_000.0, Y + 5_300_000.0)
    return PLAN | UNKNOWN


def write_geotiff_in(crs, origin, step, utm):
    """Write costs of another unit or projection, whose cells are below 10 cm, in a zone of UTM."""
    import pyproj

    write_raster(crs, origin[0] + 10 * step * X, origin[1] + 10 * step * Y)
    project = pyproj.Transformer.from_crs(crs, utm, always_xy=True)

    def move(points):
        """Bring points from the plan to the zone."""
        return np.transpose(project.transform(*(origin + 10 * step * points).T))

    plan = shapely.transform(PLAN | UNKNOWN, move)
    raster = shapely.transform(shapely.box(0.0, 0.0, 6.0, 4.0), move)
    # Nobody saw what lies beyond the raster, whose border some cells cross.
    plan |= shapely.box(*raster.buffer(1.0).bounds) - raster.buffer(0.1)

    def place(values):
        """Move the plan to the frame of the grid, whose origin is the corner of the raster."""
        west, south = re.findall(r"-?[\d.]+", values["printed"].partition("corner was at")[2])
        return shapely.affinity.translate(plan, -float(west), -float(south))

    return place


def write_geotiff_of_degrees():
    return write_geotiff_in("EPSG:4326", np.array([9.01, 47.0]), 1e-6, "EPSG:32632")


def write_geotiff_of_mercator():
    return write_geotiff_in("EPSG:3857", np.array([1.003e6, 5.942e6]), 0.1, "EPSG:32632")


def write_geotiff_of_feet():
    return write_geotiff_in(FEET, np.array([1.6404e6, 1.7e7]), 0.3, "EPSG:32632")


def change_geotiff(**profile):
    """Write costs in whole numbers, which a profile of rasterio changes."""
    import rasterio
    from rasterio.transform import from_origin

    scale, (wall, free) = profile.pop("scale", 1.0), profile.pop("values", (100, 0))
    costs = np.where(CELLS, wall / scale, free).T
    costs = costs if profile.pop("upside_down", False) else costs[::-1]
    settings = {
        "driver": "GTiff",
        "dtype": "uint8",
        "count": 1,
        "height": 40,
        "width": 60,
        "crs": "EPSG:32632",
        "transform": from_origin(0.0, 4.0, 0.1, 0.1),
        **profile,
    }
    with rasterio.open("costs.tif", "w", **settings) as file:
        for band in range(settings["count"]):
            file.write(costs.astype(settings["dtype"]), band + 1)
        if scale != 1.0:
            file.scales = [scale]


def write_geotiff_with_a_scale():
    change_geotiff(scale=10.0)


def write_geotiff_of_local_metres():
    change_geotiff(crs=None)


def write_geotiff_of_two_bands():
    change_geotiff(count=2)


def write_turned_geotiff():
    from rasterio.transform import Affine

    change_geotiff(transform=Affine.rotation(30.0) * Affine.scale(0.1, -0.1))


def write_geotiff_of_plate_carree():
    """Write a projection that stretches the x axis by 1.46."""
    return write_geotiff_in("EPSG:4087", np.array([1.003e6, 5.232e6]), 0.1463, "EPSG:32632")


def write_geotiff_from_the_south():
    from rasterio.transform import Affine

    change_geotiff(transform=Affine(0.1, 0.0, 0.0, 0.0, 0.1, 0.0), upside_down=True)


def write_geotiff_of_shares():
    import rioxarray

    change_geotiff(dtype="float32")
    shares = rioxarray.open_rasterio("costs.tif").load() / 100.0
    shares.rio.to_raster("costs.tif")


def write_geotiff_without_a_place():
    change_geotiff(transform=None, crs=None)


def write_map_of_ours():
    """Write a map in which 0 is free, 1 is undecided and 2 is in collision."""
    workspace = cspace.Workspace.from_array(CELLS, 0.1)
    cspace.build(workspace, cspace.Robot.disc(0.1)).export("costs.tif")


def write_netcdf():
    import xarray

    costs = np.where(CELLS, 100, 0).astype(np.int16)
    costs[55:, :5] = -1  # unknown
    variable = ("y", "x"), costs.T, {"_FillValue": np.int16(-1)}
    xarray.Dataset({"cost": variable}, coords={"x": X, "y": Y}).to_netcdf("costs.nc")
    return PLAN | UNKNOWN


def write_netcdf_with_a_scale():
    """Write a tenth of the costs less 1, and a factor and an offset."""
    import xarray

    costs = np.where(CELLS, 9, -1).astype(np.int16)
    codes = {"scale_factor": 10.0, "add_offset": 10.0}
    xarray.Dataset({"cost": (("y", "x"), costs.T, codes)}, {"x": X, "y": Y}).to_netcdf("costs.nc")


def write_netcdf_of_kilometres():
    import xarray

    axes = {"x": ("x", X / 1000.0, {"units": "km"}), "y": ("y", Y / 1000.0, {"units": "km"})}
    costs = ("y", "x"), np.where(CELLS, 100, 0).T
    xarray.Dataset({"cost": costs}, axes).to_netcdf("costs.nc")


def write_netcdf_of_valid_costs():
    """Write unknown cells as -1, below the least valid cost."""
    import xarray

    costs = np.where(CELLS, 100, 0).astype(np.int16)
    costs[55:, :5] = -1
    variable = ("time", "y", "x"), costs.T[None], {"valid_min": np.int16(0)}
    xarray.Dataset({"cost": variable}, {"x": X, "y": Y}).to_netcdf("costs.nc")
    return PLAN | UNKNOWN


def write_netcdf_from_the_north():
    import xarray

    costs = ("y", "x"), np.where(CELLS, 100, 0).T[::-1]
    xarray.Dataset({"cost": costs}, {"x": X, "y": Y[::-1]}).to_netcdf("costs.nc")


def write_netcdf_of_degrees():
    import xarray

    costs = ("lat", "lon"), np.where(CELLS, 100, 0).T
    xarray.Dataset({"cost": costs}, {"lon": X, "lat": Y}).to_netcdf("costs.nc")


def write_netcdf_of_shares():
    import xarray

    costs = ("y", "x"), np.where(CELLS, 1.0, 0.0).T
    xarray.Dataset({"cost": costs}, {"x": X, "y": Y}).to_netcdf("costs.nc")


def write_nrrd(directions=np.eye(3), **fields):  # noqa: B008  # read alone
    import nrrd

    header = {"space dimension": 3, "space directions": 100.0 * directions, **fields}
    nrrd.write("rack.nrrd", VOXELS, {**header, "space origin": [50.0] * 3})


def write_turned_nrrd():
    write_nrrd(np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]))


def write_nrrd_of(unit, side):
    """Write voxels in a unit, with sides that numbers beside the axes tell."""
    import nrrd

    header = {"spacings": [side] * 3, "units": [unit] * 3}
    voxels = np.where(VOXELS, np.float32(np.nan), np.float32(0))
    nrrd.write("rack.nrrd", voxels, header)
    return shapely.affinity.translate(PLAN, -0.05, -0.05)


def write_nrrd_of_metres():
    return write_nrrd_of("m", 0.1)


def write_nrrd_of_centimetres():
    return write_nrrd_of("cm", 10.0)


def write_nrrd_of_inches():
    write_nrrd_of("in", 4.0)


def write_nrrd_of_colours():
    import nrrd

    nrrd.write("rack.nrrd", np.zeros((3, 4, 4, 4), dtype=np.uint8))


def write_mha_of_colours():
    import SimpleITK

    image = SimpleITK.GetImageFromArray(np.zeros((4, 4, 4, 3), np.uint8), isVector=True)
    SimpleITK.WriteImage(image, "rack.mha")


def write_flat_mha():
    import SimpleITK

    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(np.ones((4, 4), np.uint8)), "rack.mha")


def write_turned_mha():
    write_mha((0.8, -0.6, 0.0, 0.6, 0.8, 0.0, 0.0, 0.0, 1.0))


def write_mha(direction=(1, 0, 0, 0, 1, 0, 0, 0, 1)):
    import SimpleITK

    image = SimpleITK.GetImageFromArray(VOXELS.T)
    image.SetDirection(direction)
    image.SetSpacing((100.0,) * 3)
    image.SetOrigin((50.0,) * 3)
    SimpleITK.WriteImage(image, "rack.mha")


def write_picture():
    from PIL import Image

    shade = np.where(CELLS, 0, 255)
    alpha = np.full(CELLS.shape, 255)
    alpha[55:, :5] = 0
    pixels = np.stack([shade, shade, shade, alpha], axis=-1).astype(np.uint8)
    Image.fromarray(pixels.transpose(1, 0, 2)[::-1]).save("plan.png")
    return PLAN | UNKNOWN


def write_turned_picture():
    """Write the plan on its side, and how it is to be turned."""
    from PIL import Image

    exif = Image.Exif()
    exif[274] = 6  # a quarter turn to the right
    shades = np.where(CELLS, 0, 255).astype(np.uint8).T[::-1]
    Image.fromarray(np.rot90(shades)).save("plan.png", exif=exif)


def write_deep_picture():
    from PIL import Image

    Image.fromarray(np.where(CELLS, 3000, 60000).astype(np.uint16).T[::-1].copy()).save("plan.png")


def save_picture(mode, **options):
    """Write the plan in a mode of Pillow."""
    from PIL import Image

    shades = np.where(CELLS, 0, 255).astype(np.uint8).T[::-1]
    Image.fromarray(shades).convert(mode).save("plan.png", **options)


def write_picture_of_a_bit():
    save_picture("1")


def write_picture_of_a_palette():
    """Write walls in one colour of a palette, and unknown cells in a transparent one."""
    from PIL import Image

    numbers = np.where(CELLS, 2, 1).astype(np.uint8)
    numbers[55:, :5] = 0
    image = Image.fromarray(numbers.T[::-1])
    image.putpalette([255, 255, 255, 255, 255, 255, 0, 0, 128])
    image.save("plan.png", transparency=0)
    return PLAN | UNKNOWN


def write_picture_for_print():
    save_picture("CMYK", format="TIFF")


def write_picture_with_a_key():
    """Write a colour that stands for transparent pixels."""
    from PIL import Image

    pixels = np.where(CELLS, 0, 255).astype(np.uint8)[..., None].repeat(3, axis=-1)
    pixels[55:, :5] = 254, 1, 254
    image = Image.fromarray(np.ascontiguousarray(pixels.transpose(1, 0, 2)[::-1]))
    image.save("plan.png", transparency=(254, 1, 254))
    return PLAN | UNKNOWN


def write_kml():
    """Write a folder for each wall, in degrees, as Google Earth does."""
    import geopandas

    frame = geopandas.GeoSeries([shapely.box(*wall) for wall in WALLS], crs="EPSG:32632")
    shapes = frame.translate(500_000.0, 5_400_000.0).to_crs("EPSG:4326")
    rings = [" ".join(f"{x:.9f},{y:.9f}" for x, y in shape.exterior.coords) for shape in shapes]
    folders = "".join(
        f"<Folder><name>{k}</name><Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Folder>"
        for k, ring in enumerate(rings)
    )
    space = 'xmlns="http://www.opengis.net/kml/2.2"'
    Path("site.gpkg").write_text(
        f"<?xml version='1.0'?><kml {space}><Document>{folders}</Document></kml>"
    )
    return shapely.affinity.translate(PLAN, -1.0, -0.5)


def write_layers():
    """Write a layer for each wall, in feet, and a table of attributes."""
    import geopandas
    import pandas as pd
    import pyogrio

    for k, wall in enumerate(WALLS):
        shape = geopandas.GeoSeries([shapely.box(*wall)], crs="EPSG:32632")
        shape = shape.translate(500_000.0, 5_400_000.0).to_crs("EPSG:32632")
        feet = shape.to_crs(FEET)
        feet.to_file("site.gpkg", layer=f"wall {k}")
    pyogrio.write_dataframe(pd.DataFrame({"a": [1]}), "site.gpkg", layer="notes")
    return shapely.affinity.translate(PLAN, -1.0, -0.5)


def write_site_of_metres(crs=None):
    """Write the walls in metres of the site, without a reference system or in one of its own."""
    import geopandas

    geopandas.GeoSeries([shapely.box(*wall) for wall in WALLS], crs=crs).to_file("site.gpkg")
    return shapely.affinity.translate(PLAN, -1.0, -0.5)


def write_site_of_named_metres():
    return write_site_of_metres('LOCAL_CS["site",UNIT["metre",1]]')


def write_site_of_feet():
    write_site_of_metres('LOCAL_CS["site",UNIT["foot",0.3048]]')


def write_geopackage():
    """Write the walls with heights, and a mark at (0, 0), in degrees."""
    import geopandas

    shapes = [shapely.box(*wall) for wall in WALLS] + [shapely.Point(0.0, 0.0)]
    solids = shapely.force_3d(shapes, 410.0)
    frame = geopandas.GeoDataFrame(geometry=solids).translate(500_000.0, 5_400_000.0)
    frame.set_crs("EPSG:32632").to_crs("EPSG:4326").to_file("site.gpkg")
    return shapely.union_all(shapes)


def write_geojson_of_degrees():
    """Write the walls in longitude and latitude."""
    import geopandas

    frame = geopandas.GeoSeries([shapely.box(*wall) for wall in WALLS], crs="EPSG:32632")
    frame = frame.translate(500_000.0, 5_400_000.0).to_crs("EPSG:4326")
    frame.to_file("site.gpkg", driver="GeoJSON", COORDINATE_PRECISION=9)
    return shapely.affinity.translate(PLAN, -1.0, -0.5)


def write_site(names=("A", "A"), systems=("EPSG:32632", "EPSG:32632"), shift=(5e5, 5.4e6)):
    """Write a layer of a name for each wall."""
    import geopandas

    for wall, name, system in zip(WALLS, names, systems, strict=True):
        shape = geopandas.GeoSeries([shapely.box(*wall)], crs="EPSG:32632").translate(*shift)
        shape.to_crs(system).to_file("site.gpkg", layer=name)
    return shapely.affinity.translate(PLAN, -1.0, -0.5)


def write_layers_of_two_systems():
    return write_site(("A", "B"), ("EPSG:32632", "EPSG:4326"))


def write_folders_of_one_name():
    """Write two folders of KML with one name, of which one is hidden."""
    plan = write_kml()
    text = Path("site.gpkg").read_text().replace("<name>1</name>", "<name>0</name>")
    Path("site.gpkg").write_text(text.replace("<Folder>", "<Folder><visibility>0</visibility>", 1))
    return plan


def write_site_of_unnamed_degrees():
    import geopandas

    shape = geopandas.GeoSeries([shapely.box(9.0, 48.0, 9.0001, 48.0001)])
    shape.to_file("site.gpkg", driver="FlatGeobuf")


def write_site_without_shapes():
    import geopandas
    import pyogrio

    frame = geopandas.GeoDataFrame(geometry=[shapely.Point(0.0, 0.0)], crs="EPSG:4326")
    pyogrio.write_dataframe(frame[:0], "site.gpkg", geometry_type="Point", layer="doors")


def write_site_of_lines():
    """Write the diagonals of the walls, and an empty layer."""
    import geopandas

    lines = geopandas.GeoSeries(
        [shapely.LineString([wall[:2], wall[2:]]) for wall in WALLS], crs="EPSG:32632"
    )
    lines.translate(500_000.0, 5_400_000.0).to_file("site.gpkg", layer="walls")
    write_site_without_shapes()
    return shapely.affinity.translate(shapely.MultiLineString(list(lines)), -1.0, -0.5)


def write_dxf_of_outlines():
    """Write a room and a column as closed polylines in millimetres, with notes, and what is lost."""
    import ezdxf.xref
    from ezdxf.units import MM

    drawing = ezdxf.new("R2010", setup=True)
    drawing.units = MM
    space = drawing.modelspace()
    outlines = shapely.box(0, 0, 8, 6).exterior, shapely.box(3, 2, 3.5, 2.5).exterior
    for outline in outlines:
        space.add_lwpolyline((1000.0 * np.array(outline.coords)[:-1]).tolist(), close=True)
    space.add_text("hall", height=300).set_placement((5000, 3000))
    space.add_linear_dim(base=(0, 5500), p1=(0, 6000), p2=(8000, 6000)).render()
    space.add_xline((0, 3000), (1, 0))
    ezdxf.xref.attach(drawing, block_name="SITE", filename="site.dxf")
    drawing.saveas("plan.dxf")
    return shapely.union_all(outlines)


def write_dxf_of_blocks():
    """Write columns in blocks, wide walls, hatches, faces and curves in metres."""
    import ezdxf
    from ezdxf.units import M

    drawing = ezdxf.new("R2010")
    drawing.units = M
    space = drawing.modelspace()
    drawing.blocks.new("COLUMN").add_circle((0, 0), 0.25)
    pair = drawing.blocks.new("PAIR")
    pair.add_blockref("COLUMN", (0, 0))
    pair.add_blockref("COLUMN", (1, 0), dxfattribs={"xscale": 2, "yscale": 2})
    space.add_blockref("PAIR", (2, 2), dxfattribs={"rotation": 90})
    space.add_blockref("COLUMN", (1, 0.6), dxfattribs={"column_count": 2, "column_spacing": 1})
    holed = shapely.box(4, 1, 5, 2) - shapely.box(4.3, 1.3, 4.7, 1.7)
    hatch = space.add_hatch()
    for ring in (holed.exterior, *holed.interiors):
        hatch.paths.add_polyline_path(list(ring.coords)[:-1], is_closed=True)
    space.add_hatch().paths.add_edge_path().add_arc((6.5, 1.5), 0.4, 0, 360)
    space.add_solid([(6, 3), (6.6, 3), (6, 3.4), (6.6, 3.4)])
    space.add_3dface([(7, 3), (7.5, 3), (7.5, 3.4), (7, 3.4)])
    space.add_lwpolyline([(2, 5), (3, 5), (3, 5.5)], dxfattribs={"const_width": 0.2})
    widths = {"default_start_width": 0.3, "default_end_width": 0.3}
    space.add_polyline2d([(3.2, 3.6), (3.8, 3.6)], dxfattribs=widths)
    space.add_lwpolyline([(6.5, 5, 0, 0, 1), (7.5, 5, 0, 0, 0)], format="xyseb")
    space.add_spline().control_points = [(4, 4, 0), (4, 5, 0), (5, 5, 0), (5, 4, 0)]
    space.add_ellipse((1, 4.5), (0.5, 0), 0.5)
    space.add_arc((5.5, 5), 0.5, 0, 180)
    space.add_line((0, 0), (8, 0))
    drawing.saveas("plan.dxf")
    circle = shapely.Point(0, 0).buffer(1, 64).exterior
    half = draw_curve(lambda t: (np.cos(np.pi * t), np.sin(np.pi * t)))
    return shapely.union_all(
        [
            shapely.affinity.translate(shapely.affinity.scale(curve, a, b, origin=(0, 0)), x, y)
            for curve, a, b, x, y in (
                *((circle, 0.25, 0.25, x, y) for x, y in ((2, 2), (1, 0.6), (2, 0.6))),
                *((circle, 0.5, 0.5, 2, 3), (circle, 0.5, 0.25, 1, 4.5)),
                (shapely.Polygon(circle), 0.4, 0.4, 6.5, 1.5),
                *((half, 0.5, 0.5, 5.5, 5), (half, 0.5, -0.5, 7, 5)),
            )
        ]
        + [
            *(holed, shapely.box(6, 3, 6.6, 3.4), shapely.box(7, 3, 7.5, 3.4)),
            *(shapely.box(2, 4.9, 3.1, 5.1), shapely.box(2.9, 4.9, 3.1, 5.5)),
            *(shapely.box(3.2, 3.45, 3.8, 3.75), shapely.LineString([(0, 0), (8, 0)])),
            # A cubic curve of Bezier.
            draw_curve(lambda t: (4 + 3 * t**2 - 2 * t**3, 4 + 3 * t * (1 - t))),
        ]
    )


def write_dxf_of_hidden_parts():
    """Write two walls, and what a drawing hides: layers, blocks, and a line by itself."""
    import ezdxf

    drawing = ezdxf.new("R2010", units=6)
    space = drawing.modelspace()
    drawing.layers.add("OLD").off()
    drawing.layers.add("Frozen").freeze()
    drawing.blocks.new("CHAIR").add_line((0, 0), (1, 1))
    for y, extra in ((0, {}), (6, {}), (2, {"layer": "old"}), (4, {"layer": "FROZEN"})):
        space.add_line((0, y), (8, y), dxfattribs=extra)
    space.add_line((0, 5), (8, 5), dxfattribs={"invisible": 1})
    space.add_blockref("CHAIR", (3, 3), dxfattribs={"layer": "Frozen"})
    drawing.saveas("plan.dxf")
    return shapely.MultiLineString([[(0, y), (8, y)] for y in (0, 6)])


def write_dxf_of_blocks_on_hidden_layers():
    """Write a block whose parts have the layer of its insertion, which is off, and inches."""
    import ezdxf

    drawing = ezdxf.new("R2010", units=1)
    space = drawing.modelspace()
    drawing.layers.add("OLD").off()
    drawing.blocks.new("CHAIR").add_line((0, 0), (99, 99))
    space.add_blockref("CHAIR", (3, 3), dxfattribs={"layer": "OLD"})
    space.add_line((0, 0), (300, 0))
    space.add_lwpolyline([(300, 0), (300, 200)], dxfattribs={"extrusion": (0, 0, -1)})
    drawing.saveas("plan.dxf")
    lines = shapely.MultiLineString([[(0, 0), (300, 0)], [(-300, 0), (-300, 200)]])
    return shapely.affinity.scale(lines, 0.0254, 0.0254, origin=(0, 0))


def write_dxf_without_a_unit():
    import ezdxf

    drawing = ezdxf.new("R2010", units=0)
    drawing.modelspace().add_line((0, 0), (8, 0))
    drawing.saveas("plan.dxf")


def draw_curve(curve):
    """Return a line through many points of a curve."""
    return shapely.LineString(np.transpose(curve(np.linspace(0.0, 1.0, 400))))


def write_svg_of_shapes():
    """Write the walls with y down, 100 units to a metre, as a program for drawings does."""
    shapes = "".join(
        f'<rect x="{100 * x0}" y="{-100 * y1}" width="{100 * (x1 - x0)}" height="{100 * (y1 - y0)}"/>'
        for x0, y0, x1, y1 in WALLS
    )
    text = f"""<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">
        <defs><circle id="column" r="25"/></defs>
        <style>.wall {{fill: none; stroke: #333; stroke-width: 20; stroke-linecap: square}}</style>
        <rect y="-600" width="800" height="600" fill="white"/>{shapes}
        <g transform="translate(300,-200) scale(2)"><polyline class="wall" points="0,0 50,0 50,-50"/>
        <use xlink:href="#column" x="10" y="-50"/></g>
        <g style="display: none"><rect width="700" height="700"/></g><text x="9">hall</text></svg>"""
    Path("plan.svg").write_text(text)
    corner = shapely.LineString([(3, 2), (4, 2), (4, 3)])
    strokes = corner.buffer(0.2, cap_style="square", join_style="mitre")
    return shapely.union_all([PLAN, strokes, shapely.Point(3.2, 3).buffer(0.5)])


def write_svg_of_strokes():
    """Write a plan of open paths with widths, and a filled column, by matplotlib."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Arc, Circle, PathPatch
    from matplotlib.path import Path as Curve

    width = 0.15 / 0.01 * 72 / 96  # points, for 15 cm
    figure = plt.figure(figsize=(800 / 96, 600 / 96))  # inches, at 96 units
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, 8), ylim=(0, 6))
    axes.axis("off")
    style = {"color": "black", "linewidth": width, "solid_capstyle": "projecting"}
    axes.plot([1, 5, 5], [1, 1, 4], solid_joinstyle="miter", **style)
    axes.add_patch(Arc((6, 4), 2, 2, theta1=0, theta2=180, linewidth=width, capstyle="projecting"))
    corners = [(1, 3), (1, 5), (3, 5), (3, 3)]
    codes = [Curve.MOVETO, *[Curve.CURVE4] * 3]
    axes.add_patch(
        PathPatch(Curve(corners, codes), fill=False, linewidth=width, capstyle="projecting")
    )
    axes.add_patch(Circle((3, 2), 0.3, color="grey", linewidth=0))
    figure.savefig("plan.svg")
    plt.close(figure)
    wall = shapely.LineString([(1, 1), (5, 1), (5, 4)])
    arc = draw_curve(lambda t: (6 + np.cos(np.pi * t), 4 + np.sin(np.pi * t)))
    curve = draw_curve(lambda t: (1 + 6 * t**2 - 4 * t**3, 3 + 6 * t * (1 - t)))
    lines = [
        line.buffer(0.075, cap_style="square", join_style="mitre") for line in (wall, arc, curve)
    ]
    plan = shapely.union_all([*lines, shapely.Point(3, 2).buffer(0.3)])
    return shapely.affinity.translate(plan, 0.0, -6.0)  # the page's origin is at the top


def write_svg(body):
    """Write a drawing of 8 m x 6 m."""
    names = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    Path("plan.svg").write_text(f"<svg {names}>{body}</svg>")


def write_svg_of_rules():
    """Write rings in rings: by the nonzero rule in one direction and in two, and by even-odd."""
    outer = "M0,0 L200,0 L200,200 L0,200 Z"
    alike, against = "M50,50 h100 v100 h-100 Z", "M50,50 v100 h100 v-100 Z"
    write_svg(
        f'<path d="{outer} {alike}"/>'
        f'<path transform="translate(300,0)" d="{outer} {against}"/>'
        f'<path transform="translate(0,300)" fill-rule="evenodd" d="{outer} {alike}"/>'
        f'<g style="fill-rule: evenodd"><path transform="translate(300,300)" d="{outer} {alike}"/></g>'
    )
    holed = shapely.box(0, -2, 2, 0) - shapely.box(0.5, -1.5, 1.5, -0.5)
    plan = [shapely.box(0, -2, 2, 0)]
    plan += [shapely.affinity.translate(holed, *by) for by in ((3, 0), (0, -3), (3, -3))]
    return shapely.union_all(plan)


def write_svg_of_colours():
    """Write a gradient, and areas that nobody sees."""
    rect = '<rect width="100" height="100" '
    write_svg(
        '<defs><linearGradient id="g"><stop offset="0" stop-color="#000"/></linearGradient></defs>'
        f'{rect} fill="url(#g)"/>{rect} x="200" fill="currentColor"/>'
        f'{rect} y="300" fill="#000" fill-opacity="0"/>{rect} x="200" y="300" fill="transparent"/>'
        f'{rect} x="400" y="300" visibility="hidden"/>{rect} x="600" y="300" fill="#ffffff80"/>'
        f'{rect} x="600" opacity="0"/>'
    )
    return shapely.box(0, -1, 1, 0) | shapely.box(2, -1, 3, 0)


def write_svg_of_a_picture():
    write_svg('<rect width="9" height="9"/><image width="8" height="8" xlink:href="a.png"/>')


def write_gml():
    import networkx

    graph = networkx.DiGraph()
    graph.add_node("a", pos=[1.0, 2.0])
    graph.add_node("b", pos=[3.0, 1.0])
    graph.add_edge("a", "b")
    networkx.write_gml(graph, "lanes.gml")


def make_rack():
    """Return both walls as boxes, in millimetres."""
    import trimesh

    bounds = [[(x0, y0, 0.0), (x1, y1, 3.0)] for x0, y0, x1, y1 in WALLS]
    boxes = [trimesh.creation.box(bounds=1000.0 * np.array(each)) for each in bounds]
    scene = trimesh.Scene(boxes)
    scene.units = "mm"
    return scene


def write_3mf():
    make_rack().export("rack.3mf")


def write_3mf_of(unit, metres):
    """Write a box in a unit, which the build moves by 1 m along x."""
    import zipfile

    box = shapely.box(0, 0, 0.5, 0.5)
    corners = [(x, y, z) for z in (0, 3) for x, y in box.exterior.coords[:-1]]
    faces = [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)]
    faces += [(k, (k + 1) % 4 + 4, (k + 1) % 4) for k in range(4)]
    faces += [(k, k + 4, (k + 1) % 4 + 4) for k in range(4)]
    named = [
        "".join(
            f'<vertex x="{x / metres}" y="{y / metres}" z="{z / metres}"/>' for x, y, z in corners
        ),
        "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces),
    ]
    place = f"1 0 0 0 1 0 0 0 1 {1 / metres} 0 0"
    model = (
        f'<model {unit} xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f'<resources><object id="1" type="model"><mesh><vertices>{named[0]}</vertices>'
        f"<triangles>{named[1]}</triangles></mesh></object></resources>"
        f'<build><item objectid="1" transform="{place}"/></build></model>'
    )
    with zipfile.ZipFile("rack.3mf", "w") as file:
        file.writestr("3D/3dmodel.model", f"<?xml version='1.0'?>{model}")
    return shapely.affinity.translate(box, 1.0, 0.0)


def write_3mf_of_inches():
    return write_3mf_of('unit="inch"', 0.0254)


def write_3mf_without_a_unit():
    return write_3mf_of("", 0.001)


def write_off():
    make_rack().to_mesh().export("rack.off")


def write_drawing():
    """Write the walls as characters, the first line at the top."""
    rows = np.where(CELLS.T[::-1], "#", ".")
    Path("plan.txt").write_text("\n".join(map("".join, rows)))


def write_ragged_drawing():
    """Write free cells as blanks, without those at the end of a line."""
    rows = np.where(CELLS.T[::-1], "@", " ")
    rows[:, -1] = "#"
    rows[3, 1:59:2] = "."
    rows[4] = " "
    lines = ["".join(row).rstrip() for row in rows]
    Path("plan.txt").write_text("\n".join(lines) + "\n")
    return PLAN | shapely.box(5.9, 0, 6, 4) | shapely.box(0, 3.5, 6, 3.6)


def write_text(name, text):
    """Return a writer of a text."""
    return pytest.param(
        name, lambda: Path(name).write_text(text, encoding="utf-8"), id=f"{text:.9}"
    )


def write_drawing_with(separator, start=""):
    rows = np.where(CELLS.T[::-1], "#", ".")
    text = "\n".join(map(separator.join, rows))
    Path("plan.txt").write_text(start + text, encoding="utf-8")


def write_drawing_of_blanks_apart():
    rows = np.where(CELLS.T[::-1], "#", " ")
    Path("plan.txt").write_text("\n".join(map(" ".join, rows)))


def write_drawing_with_a_mark():
    write_drawing_with("", "\ufeff")


def write_drawing_with_commas():
    write_drawing_with(",")


def write_rows():
    Path("plan.json").write_text(json.dumps(CELLS.T[::-1].astype(int).tolist()))


def write_scan(nothing=".inf", farthest=9.0):
    """Write beams that end where they meet a wall, and return these points."""
    angles = 1e-4 * np.arange(15_000)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    ranges = np.full(len(angles), np.inf)
    for x0, y0, x1, y1 in WALLS:
        with np.errstate(divide="ignore"):
            meets = np.max((x0, y0) / rays, axis=1)
            leaves = np.min((x1, y1) / rays, axis=1)
        ranges = np.where(meets < leaves, np.minimum(ranges, meets), ranges)
    listed = "\n".join(f"- {each}".replace("inf", nothing) for each in ranges.tolist())
    limits = f"range_min: 0.12\nrange_max: {farthest}\n"
    text = f"angle_min: 0.0\nangle_increment: 0.0001\n{limits}ranges:\n{listed}\n---\n"
    Path("scan.yaml").write_text(text)
    hits = ranges <= farthest
    return shapely.MultiPoint(ranges[hits, np.newaxis] * rays[hits])


def write_scan_of_zeros():
    """Write 0.0 for beams that met nothing, and a range that ends before the second wall."""
    return write_scan("0.0", farthest=4.0)


def write_scan_of_ros_1():
    """Write beams in one line, from the left to the right."""
    plan = write_scan()
    import yaml

    scan = yaml.safe_load(Path("scan.yaml").read_text().partition("---")[0])
    number = len(scan["ranges"])
    Path("scan.yaml").write_text(
        f"angle_min: {1e-4 * (number - 1)}\nangle_increment: -0.0001\nrange_min: 0.12\n"
        f"range_max: 9.0\nranges: [{', '.join(map(str, scan['ranges'][::-1]))}]\n---\n"
    )
    return plan


def write_short_scan():
    write_scan()
    text = Path("scan.yaml").read_text()
    Path("scan.yaml").write_text(text.replace("---", "- '...'\n---"))


def make_points():
    """Return points in the walls, 1 cm from their borders."""
    clouds = []
    for x0, y0, x1, y1 in WALLS:
        x = np.linspace(x0 + 0.01, x1 - 0.01, 20)
        y = np.linspace(y0 + 0.01, y1 - 0.01, 20)
        grid = np.meshgrid(x, y, np.linspace(0.01, 2.99, 40), indexing="ij")
        clouds.append(np.stack(grid, axis=-1).reshape(-1, 3))
    return np.concatenate(clouds)


def write_pcd():
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(make_points()))
    open3d.io.write_point_cloud("scan.pcd", cloud, compressed=True)


def write_pcd_with_gaps():
    """Write points of which some are missing."""
    import open3d

    points = make_points()
    points[::7] = np.nan
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    open3d.io.write_point_cloud("scan.pcd", cloud, compressed=True)
    return PLAN


def write_pcd_seen_from_a_place():
    write_pcd()
    data = Path("scan.pcd").read_bytes()
    assert b"VIEWPOINT 0 0 0 1 0 0 0" in data
    Path("scan.pcd").write_bytes(data.replace(b"VIEWPOINT 0 0 0", b"VIEWPOINT 3 0 0"))


def write_las():
    """Write the points, and a mark at (0, 0, 0), in the coordinates of a survey."""
    import laspy

    cloud = laspy.create()
    cloud.header.offsets = [400_000.0, 5_400_000.0, 0.0]
    cloud.header.scales = [0.001] * 3
    cloud.xyz = np.concatenate([make_points(), np.zeros((1, 3))]) + cloud.header.offsets
    cloud.write("scan.las")


def write_las_in(crs, scale_of_heights=1.0):
    """Write the points, and a mark at (0, 0, 0), in another reference system near 9 E, 48 N."""
    import laspy
    import pyproj

    system = pyproj.CRS(crs)
    points = np.concatenate([make_points(), np.zeros((1, 3))])
    points += (500_000.0, 5_316_000.0, 0.0)
    project = pyproj.Transformer.from_crs("EPSG:32632", system, always_xy=True)
    x, y = project.transform(*points[:, :2].T)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [1e-9 if system.is_geographic else 1e-4] * 2 + [0.001]
    header.offsets = [x.min(), y.min(), 0.0]
    header.add_crs(system)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = x, y, points[:, 2] / scale_of_heights
    cloud.write("scan.las")


def write_las_of_degrees():
    write_las_in("EPSG:4326")


def write_las_of_feet():
    """Write a plan in feet, and heights in the same unit."""
    write_las_in(FEET, 1200 / 3937)


def write_las_of_local_metres():
    """Write metres of a site, and a point that was struck out."""
    import laspy
    import pyproj

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [0.001] * 3
    header.add_crs(pyproj.CRS('LOCAL_CS["site",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]'))
    cloud = laspy.LasData(header)
    cloud.xyz = np.concatenate([make_points(), [(0.0, 0.0, 0.0), (3.0, 3.0, 1.5)]])
    cloud.withheld = np.arange(len(cloud.x)) == len(cloud.x) - 1
    cloud.write("scan.las")


def write_las_of_the_globe():
    write_las_in("EPSG:4978")


def write_las_of_two_units():
    """Write a plan in metres, and heights in feet."""
    write_las_in("EPSG:32632+6360", 1200 / 3937)


FORMS = {
    "costs.tif": (
        *(write_geotiff, write_geotiff_of_utm, write_geotiff_of_degrees),
        *(write_geotiff_of_feet, write_geotiff_of_mercator, write_geotiff_with_a_scale),
        *(write_geotiff_of_local_metres, write_geotiff_of_plate_carree),
        *(write_geotiff_from_the_south,),
    ),
    "costs.nc": (
        *(write_netcdf, write_netcdf_with_a_scale, write_netcdf_of_valid_costs),
        *(write_netcdf_from_the_north,),
    ),
    "rack.nrrd": (write_nrrd, write_nrrd_of_metres, write_nrrd_of_centimetres),
    "rack.mha": (write_mha,),
    "plan.png": (
        *(write_picture, write_turned_picture, write_picture_of_a_bit),
        *(write_picture_of_a_palette, write_picture_for_print, write_picture_with_a_key),
    ),
    "plan.txt": (
        *(write_drawing, write_ragged_drawing, write_drawing_with_a_mark),
        *(write_drawing_with_commas, write_drawing_of_blanks_apart),
    ),
    "plan.json": (write_rows,),
    "site.gpkg": (
        *(write_geopackage, write_kml, write_layers, write_folders_of_one_name),
        *(write_site_of_metres, write_site_of_named_metres, write_layers_of_two_systems),
        *(write_site_of_lines, write_geojson_of_degrees),
    ),
    "plan.dxf": (
        *(write_dxf_of_outlines, write_dxf_of_blocks, write_dxf_of_hidden_parts),
        *(write_dxf_of_blocks_on_hidden_layers,),
    ),
    "plan.svg": (
        *(write_svg_of_shapes, write_svg_of_strokes, write_svg_of_rules, write_svg_of_colours),
    ),
    "lanes.gml": (write_gml,),
    "rack.3mf": (write_3mf, write_3mf_of_inches, write_3mf_without_a_unit),
    "rack.off": (write_off,),
    "scan.pcd": (write_pcd, write_pcd_with_gaps),
    "scan.las": (
        *(write_las, write_las_of_degrees, write_las_of_feet, write_las_of_two_units),
        *(write_las_of_local_metres,),
    ),
    "scan.yaml": (write_scan, write_scan_of_zeros, write_scan_of_ros_1),
}
"""Writers of each file of the page; a plan that they return is that of the obstacles."""

SNIPPET_OF = {
    next(name for name in FORMS if f'"{name}"' in snippet): snippet for snippet in SNIPPETS
}
"""Snippet that reads each file."""

REFUSED = {
    "costs.tif": (
        *(write_geotiff_of_two_bands, write_turned_geotiff, write_geotiff_of_shares),
        *(write_geotiff_without_a_place, write_map_of_ours),
    ),
    "costs.nc": (write_netcdf_of_kilometres, write_netcdf_of_degrees, write_netcdf_of_shares),
    "rack.nrrd": (write_turned_nrrd, write_nrrd_of_inches, write_nrrd_of_colours),
    "rack.mha": (write_turned_mha, write_mha_of_colours, write_flat_mha),
    "plan.png": (write_deep_picture,),
    "site.gpkg": (*(write_site_of_feet, write_site_of_unnamed_degrees, write_site_without_shapes),),
    "plan.dxf": (write_dxf_without_a_unit,),
    "plan.svg": (write_svg_of_a_picture,),
    "scan.pcd": (write_pcd_seen_from_a_place,),
    "scan.las": (write_las_of_the_globe,),
    "scan.yaml": (write_short_scan,),
}
"""Writers of what a snippet refuses."""

REFUSED_TEXTS = [
    write_text("plan.txt", "0110\n0010\n"),
    write_text("plan.txt", "#\t#\n#..\n"),
    write_text("plan.json", "[[0, 1], [0]]"),
    write_text("plan.json", "[[0, 255], [254, 0]]"),
    write_text("plan.json", "[[0, NaN]]"),
    write_text("plan.json", '{"rows": [[0, 1]]}'),
    write_text("plan.json", '[["0", "1"]]'),
]
"""Texts that a snippet refuses."""

CASES = [(name, write) for name in FORMS for write in FORMS[name]]


def run_snippet(name, write, folder, monkeypatch):
    """Write a file, run its snippet beside it, and return the plan and the snippet's variables."""
    monkeypatch.chdir(folder)
    plan = write()
    values = {"__name__": "examples"}
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(SNIPPET_OF[name], name, "exec"), values)
    values["printed"] = printed.getvalue()
    return plan(values) if callable(plan) else plan or PLAN, values


@pytest.mark.parametrize("name, write", CASES)
def test_a_snippet_ends_in_the_right_world(name, write, tmp_path, monkeypatch):
    plan, values = run_snippet(name, write, tmp_path, monkeypatch)
    if name == "lanes.gml":
        assert values["graph"].positions.tolist() == [[1.0, 2.0], [3.0, 1.0]]
        return
    workspace = values["workspace"]
    grid = workspace.grid
    outer = workspace.outer
    if grid.dim == 3:
        height = round((1.5 - grid.lower[2]) / grid.spacing)
        assert not outer[:, :, round((3.3 - grid.lower[2]) / grid.spacing) :].any()
        outer = outer[:, :, height]
    x, y = (
        lower + grid.spacing * np.arange(n)
        for lower, n in zip(grid.lower, outer.shape, strict=False)
    )
    x, y = np.meshgrid(x, y, indexing="ij")
    cells = shapely.box(x, y, x + grid.spacing, y + grid.spacing)
    # Rounding may move an obstacle across the border of a cell, and a cloud has gaps.
    inside = shapely.intersects(shapely.buffer(cells, -0.001, join_style="mitre"), plan)
    assert inside.any() and not (inside & ~outer).any()
    assert not (outer & (shapely.distance(cells, plan) > SLACKS.get(name, 0.02))).any()


@pytest.mark.parametrize(
    "name, write",
    [(name, write) for name in REFUSED for write in REFUSED[name]] + REFUSED_TEXTS,
)
def test_what_a_snippet_cannot_place_is_refused(name, write, tmp_path, monkeypatch):
    with pytest.raises(CspaceError, match=r"\w"):
        run_snippet(name, write, tmp_path, monkeypatch)


SLACKS = {"costs.tif": 0.15, "scan.pcd": 0.06, "scan.las": 0.06, "scan.yaml": 0.06}
"""Distance, metres, from the plan at which no cell is occupied; cells in degrees are other ones."""


@pytest.mark.parametrize(
    "write, names",
    [
        (write_dxf_of_outlines, ["SITE", "XLINE"]),
        (write_dxf_of_blocks, []),
        (write_dxf_of_hidden_parts, ["frozen", "old"]),
    ],
)
def test_what_a_drawing_loses_is_printed(write, names, tmp_path, monkeypatch):
    _, values = run_snippet("plan.dxf", write, tmp_path, monkeypatch)
    assert values["printed"] == f"left out: {names}\n"


def run_block(page, word, values):
    """Run the block of another page that holds a word, and return its variables."""
    text = (ROOT / "docs/howto" / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```py(?:thon)?\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    values["__name__"] = "examples"
    exec(next(block for block in blocks if word in block), values)
    return values


MERCATOR = {"crs": "EPSG:3857"}


@pytest.mark.parametrize("profile", [{}, {"crs": None}, {"nodata": 255}, {"upside_down": True}])
def test_a_large_geotiff_is_read_in_metres(profile, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    change_geotiff(values=(20, 200), **profile)
    Path("costs.tif").rename("site.tif")
    site = run_block("large_maps.md", "open_rasterio", {})["site"]
    cells = site.cells.outer.compute() if hasattr(site.cells, "outer") else site.outer
    assert np.array_equal(cells, CELLS[:, ::-1] if profile.get("upside_down") else CELLS)


@pytest.mark.parametrize("profile", [{"crs": "EPSG:4326"}, {"crs": FEET}, MERCATOR, {"count": 2}])
def test_a_large_geotiff_in_other_units_is_refused(profile, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    change_geotiff(values=(20, 200), **profile)
    Path("costs.tif").rename("site.tif")
    with pytest.raises(CspaceError, match="project it: gdalwarp"):
        run_block("large_maps.md", "open_rasterio", {})


@pytest.mark.parametrize(
    "write",
    [write_picture, write_turned_picture, write_picture_of_a_bit, write_picture_of_a_palette],
)
def test_a_drawing_is_dark_where_the_page_says(write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = write() or PLAN
    Path("plan.png").rename("drawing.png")
    dark = run_block("clean_drawing.md", "open_drawing", {})["dark"]
    x, y = np.meshgrid(X, Y, indexing="ij")
    assert np.array_equal(dark, shapely.contains_xy(plan, x, y))


def test_a_drawing_of_16_bits_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_deep_picture()
    Path("plan.png").rename("drawing.png")
    with pytest.raises(CspaceError, match="Pillow converts the lowest 8"):
        run_block("clean_drawing.md", "open_drawing", {})


def test_a_reader_runs_as_a_program(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_drawing()
    monkeypatch.setattr("sys.argv", ["text_map", "plan.txt"])
    runpy.run_module("examples.readers.text_map", run_name="__main__")
    assert "60 x 40 cells of 0.1 m" in capsys.readouterr().out
