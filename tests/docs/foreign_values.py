"""Hints for objects of other packages, made by these packages; `nox -s formats` runs them.

A hint is followed as it stands, on the object that was refused, into the same world.
"""

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

import cspace
from cspace import InputError, Workspace
from tests.helpers.refusals import list_calls

# What packages warn of as their objects are made, or read, fails no hint.
pytestmark = pytest.mark.filterwarnings("default")

PAGE = (Path(__file__).parents[2] / "docs/howto/bring_your_file.md").read_text(encoding="utf-8")

LOWER, UPPER = (1.0, 2.0, 0.0), (1.5, 2.75, 0.5)
"""The box that objects hold, metres."""

BOX = trimesh.creation.box(bounds=(LOWER, UPPER))
BOUNDS = np.transpose([LOWER, UPPER]).reshape(-1)

POINTS = np.array([LOWER, UPPER, (1.0, 2.75, 0.0)])


def make_open3d():
    return pytest.importorskip("open3d")


def make_triangles():
    kinds = make_open3d()
    return kinds.geometry.TriangleMesh(
        kinds.utility.Vector3dVector(BOX.vertices), kinds.utility.Vector3iVector(BOX.faces)
    )


def make_cloud():
    kinds = make_open3d()
    return kinds.geometry.PointCloud(kinds.utility.Vector3dVector(POINTS))


def make_voxels():
    kinds = make_open3d().geometry
    return kinds.VoxelGrid.create_from_triangle_mesh(make_triangles(), 0.05)


def make_pyvista(name, *arguments, **options):
    """Return a maker of an object of pyvista."""
    return lambda: getattr(pytest.importorskip("pyvista"), name)(*arguments, **options)


def make_quads_and_triangles():
    """Merge a box with a smaller one of triangles."""
    pyvista = pytest.importorskip("pyvista")
    inner = pyvista.Cube(bounds=(1.1, 1.2, 2.1, 2.2, 0.1, 0.2)).triangulate()
    return pyvista.merge([pyvista.Cube(bounds=BOUNDS), inner]).extract_surface()


def make_lines():
    """Return the edges of the box."""
    return make_open3d().geometry.LineSet.create_from_triangle_mesh(make_triangles())


def make_box(kind):
    """Return a maker of a bounding box of the box."""
    return lambda: getattr(make_triangles(), f"get_{kind}_bounding_box")()


def make_tensors(name, make):
    """Return a maker of an object in tensors."""
    return lambda: getattr(make_open3d().t.geometry, name).from_legacy(make())


def make_cells(name):
    """Return a maker of a grid of cells of 0.25 m, of which the last ones hold the box."""
    sides = [np.arange(0.0, upper + 0.01, 0.25) for upper in UPPER]

    def make():
        pyvista = pytest.importorskip("pyvista")
        if name == "ImageData":
            grid = pyvista.ImageData(dimensions=[len(side) for side in sides], spacing=(0.25,) * 3)
        else:
            grid = pyvista.RectilinearGrid(*sides)
        grid.cell_data["cost"] = (grid.cell_centers().points > LOWER).all(axis=1)
        return grid

    return make


def make_curves():
    """Return the box as one cell of curved coordinates."""
    sides = np.meshgrid(*np.transpose([LOWER, UPPER]), indexing="ij")
    return pytest.importorskip("pyvista").StructuredGrid(*sides)


def make_blocks():
    pyvista = pytest.importorskip("pyvista")
    return pyvista.MultiBlock([pyvista.Cube(bounds=BOUNDS)])


def make_tree():
    tree = pytest.importorskip("octomap").OcTree(0.25)
    for point in np.ndindex(2, 3, 2):
        tree.updateNode(np.add(LOWER, 0.25 * np.array(point) + 0.125), True)
    return tree


def make_table(name):
    """Return a maker of a lazy table of points, its columns in another order."""
    columns = {axis: POINTS[:, k] for k, axis in enumerate("xyz")}

    def make():
        if name == "duckdb":
            frame = pytest.importorskip("pandas").DataFrame(columns)[["z", "y", "x"]]
            return pytest.importorskip("duckdb").from_df(frame)
        return pytest.importorskip("polars").LazyFrame(columns).select("z", "y", "x")

    return make


def read_mesh(value):
    return Workspace.from_mesh(value, 0.05)


def read_points(value):
    return Workspace.from_points(value, 0.05, radius=0.02)


def read_cells(value):
    return Workspace.from_array(value, 0.05)


def read_shapes(value):
    return Workspace.from_polygons(value, 0.05)


OBJECTS = {
    "Open3D, triangles": (make_triangles, read_mesh, 0.0),
    "Open3D, lines": (make_lines, read_mesh, 0.0),
    "Open3D, box": (make_box("axis_aligned"), read_mesh, 0.0),
    "Open3D, turned box": (make_box("oriented"), read_mesh, 1e-3),
    "Open3D, tensor": (lambda: make_open3d().core.Tensor(POINTS), read_points, 0.02),
    "Open3D, triangles of tensors": (
        make_tensors("TriangleMesh", make_triangles),
        *(read_mesh, 0.0),
    ),
    "Open3D, lines of tensors": (make_tensors("LineSet", make_lines), read_mesh, 0.0),
    "Open3D, box of tensors": (
        make_tensors("AxisAlignedBoundingBox", make_box("axis_aligned")),
        *(read_mesh, 0.0),
    ),
    "Open3D, points": (make_cloud, read_points, 0.02),
    "Open3D, points of tensors": (make_tensors("PointCloud", make_cloud), read_points, 0.02),
    "Open3D, voxels": (make_voxels, read_cells, 0.1),
    "pyvista, quads": (make_pyvista("Cube", bounds=BOUNDS), read_mesh, 0.0),
    "pyvista, quads and triangles": (make_quads_and_triangles, read_mesh, 0.0),
    "pyvista, points": (make_pyvista("PolyData", POINTS), read_points, 0.02),
    "pyvista, cells": (make_cells("ImageData"), read_mesh, 0.0),
    "pyvista, cells of several sizes": (make_cells("RectilinearGrid"), read_mesh, 0.0),
    "pyvista, cells of curves": (make_curves, read_mesh, 0.0),
    "pyvista, blocks": (make_blocks, read_mesh, 0.0),
    "octomap, tree": (make_tree, read_points, 0.0),
    "polars, lazy table": (make_table("polars"), read_points, 0.02),
    "duckdb, relation": (make_table("duckdb"), read_points, 0.02),
}
"""Maker of an object, the call that refuses it, and by how much the world may be larger."""


def follow(value, read):
    """Yield the worlds that a call makes of a value, or of what its hint makes of it."""
    if isinstance(value, Workspace):
        yield value
        return
    try:
        yield read(value)
    except InputError as error:
        names = {"cspace": cspace, "trimesh": trimesh, error.argument: value}
        names |= {"spacing": 0.05, "lowest": 0.5}
        for part in error.hint.split("; "):
            for call in list_calls(part):
                with contextlib.suppress(InputError):  # an alternative for another kind of object
                    yield from follow(eval(call, names), read)


@pytest.mark.parametrize("kind", OBJECTS)
def test_a_hint_for_an_object_leads_into_its_world(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make, read, slack = OBJECTS[kind]
    value = make()
    with pytest.raises(InputError):
        read(value)
    worlds = list(follow(value, read))
    assert worlds
    for world in worlds:
        places = np.argwhere(world.outer) * world.grid.spacing + world.grid.lower
        dim = world.grid.dim
        assert (np.abs(places.min(axis=0) - LOWER[:dim]) <= slack + 1e-6).all()
        assert (np.abs(places.max(axis=0) + world.grid.spacing - UPPER[:dim]) <= slack + 0.05).all()


ON_THE_PAGE = {
    "SimpleITK": (
        lambda package: package.GetImageFromArray(np.zeros((4, 4, 4), np.uint8)),
        *(read_cells, "SimpleITK"),
    ),
    "laspy": (lambda package: package.create(), read_points, "LAS"),
    "ezdxf": (lambda package: package.new(), read_shapes, "DXF"),
    "PIL.Image": (lambda package: package.new("L", (4, 4)), read_cells, "picture"),
}
"""Maker of an object, the call that refuses it, and a word of the part of the page that reads it."""


@pytest.mark.parametrize("package", ON_THE_PAGE)
def test_the_page_says_how(package):
    make, read, word = ON_THE_PAGE[package]
    with pytest.raises(InputError, match='the page "Bring your file" says how'):
        read(make(pytest.importorskip(package)))
    titles = re.findall(
        r"^\*\*(.*?)\*\*.*?^(?:import|from) ([\w.]+)", PAGE, re.MULTILINE | re.DOTALL
    )
    scripts = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert any(f"import {package}" in script for script in scripts)
    assert any(word in title for title, _ in titles) or word in PAGE
