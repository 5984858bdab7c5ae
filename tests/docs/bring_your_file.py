"""Snippets of the page "Bring your file", run with the packages that they name.

The packages are large, so `nox -s formats` installs them apart, and other sessions skip this file.
Each input is written by a package of its own, and each world is compared with the one written.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import shapely

import cspace

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

VOXELS = np.repeat(CELLS[:, :, None], 30, axis=2).astype(np.uint8)


def write_geotiff():
    """Write costs in the projected coordinates of a zone, the first row at the top."""
    import rioxarray  # noqa: F401  # adds .rio to arrays
    import xarray

    costs = np.where(CELLS, 100.0, 0.0).astype(np.float32)
    costs[55:, :5] = -9999.0  # unknown
    array = xarray.DataArray(costs.T[::-1], dims=("y", "x"), coords={"x": X, "y": Y[::-1]})
    array.rio.write_crs("EPSG:32632").rio.write_nodata(-9999.0).rio.to_raster("costs.tif")


def write_netcdf():
    import xarray

    costs = np.where(CELLS, 100, 0).astype(np.int16)
    costs[55:, :5] = -1  # unknown
    variable = ("y", "x"), costs.T, {"_FillValue": np.int16(-1)}
    xarray.Dataset({"cost": variable}, coords={"x": X, "y": Y}).to_netcdf("costs.nc")


def write_nrrd():
    import nrrd

    header = {"space dimension": 3, "space directions": np.diag([100.0] * 3)}
    nrrd.write("rack.nrrd", VOXELS, {**header, "space origin": [50.0] * 3})


def write_mha():
    import SimpleITK

    image = SimpleITK.GetImageFromArray(VOXELS.T)
    image.SetSpacing((100.0,) * 3)
    image.SetOrigin((50.0,) * 3)
    SimpleITK.WriteImage(image, "rack.mha")


def write_picture():
    from PIL import Image

    Image.fromarray(np.where(CELLS.T[::-1], 0, 255).astype(np.uint8)).save("plan.png")


def write_geopackage():
    """Write the walls, and a mark at (0, 0), in degrees."""
    import geopandas

    shapes = [shapely.box(*wall) for wall in WALLS] + [shapely.Point(0.0, 0.0)]
    frame = geopandas.GeoDataFrame(geometry=shapes).translate(500_000.0, 5_400_000.0)
    frame.set_crs("EPSG:32632").to_crs("EPSG:4326").to_file("site.gpkg")


def write_dxf():
    import ezdxf
    from ezdxf.units import MM

    drawing = ezdxf.new("R2010")
    drawing.units = MM
    for wall in WALLS:
        corners = 1000.0 * np.array(shapely.box(*wall).exterior.coords)
        drawing.modelspace().add_lwpolyline(corners.tolist(), close=True)
    drawing.saveas("plan.dxf")


def write_svg():
    """Write the walls with y down, 100 units to a metre."""
    shapes = "".join(
        f'<rect x="{100 * x0}" y="{-100 * y1}" width="{100 * (x1 - x0)}" height="{100 * (y1 - y0)}"/>'
        for x0, y0, x1, y1 in WALLS
    )
    Path("plan.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{shapes}</svg>')


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


def write_off():
    make_rack().to_mesh().export("rack.off")


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


def write_las():
    """Write the points, and a mark at (0, 0, 0), in the coordinates of a survey."""
    import laspy

    cloud = laspy.create()
    cloud.header.offsets = [400_000.0, 5_400_000.0, 0.0]
    cloud.header.scales = [0.001] * 3
    cloud.xyz = np.concatenate([make_points(), np.zeros((1, 3))]) + cloud.header.offsets
    cloud.write("scan.las")


INPUTS = {
    "costs.tif": write_geotiff,
    "costs.nc": write_netcdf,
    "rack.nrrd": write_nrrd,
    "rack.mha": write_mha,
    "plan.png": write_picture,
    "site.gpkg": write_geopackage,
    "plan.dxf": write_dxf,
    "plan.svg": write_svg,
    "lanes.gml": write_gml,
    "rack.3mf": write_3mf,
    "rack.off": write_off,
    "scan.pcd": write_pcd,
    "scan.las": write_las,
}


def find_input(snippet):
    return next(name for name in INPUTS if f'"{name}"' in snippet)


@pytest.mark.parametrize("snippet", SNIPPETS, ids=find_input)
def test_a_snippet_ends_in_the_right_world(snippet, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = find_input(snippet)
    INPUTS[name]()
    values = {}
    exec(compile(snippet, name, "exec"), values)
    if name == "lanes.gml":
        assert values["graph"].positions.tolist() == [[1.0, 2.0], [3.0, 1.0]]
        return
    workspace = values["workspace"]
    height = (1.5,) * (workspace.grid.dim - 2)
    robot = cspace.Robot.ball(0.02) if height else cspace.Robot.disc(0.02)
    space = cspace.build(workspace, robot, outside="free")
    for x0, y0, x1, y1 in WALLS:
        # Surfaces and thin walls have no inside, so a wall is not FREE, and all around it is.
        assert not space.is_free((x0 + 0.03, y0 + 0.03, *height))
        assert not space.is_free((x1 - 0.03, y1 - 0.03, *height))
        assert space.is_free((x0 - 0.3, y0 - 0.3, *height))
        assert space.is_free((x1 + 0.3, y1 + 0.3, *height))
    if name.startswith("costs"):
        assert not space.is_free((5.75, 0.25))  # unknown
    if height:
        assert space.is_free((1.5, 0.75, 3.3))
