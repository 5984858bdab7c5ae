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
    "Open3D, triangles of tensors": (
        lambda: make_open3d().t.geometry.TriangleMesh.from_legacy(make_triangles()),
        *(read_mesh, 0.0),
    ),
    "Open3D, points": (make_cloud, read_points, 0.02),
    "Open3D, points of tensors": (
        lambda: make_open3d().t.geometry.PointCloud.from_legacy(make_cloud()),
        *(read_points, 0.02),
    ),
    "Open3D, voxels": (make_voxels, read_cells, 0.1),
    "pyvista, quads": (make_pyvista("Cube", bounds=BOUNDS), read_mesh, 0.0),
    "pyvista, quads and triangles": (make_quads_and_triangles, read_mesh, 0.0),
    "pyvista, points": (make_pyvista("PolyData", POINTS), read_points, 0.02),
    "octomap, tree": (make_tree, read_points, 0.0),
    "polars, lazy table": (make_table("polars"), read_points, 0.02),
    "duckdb, relation": (make_table("duckdb"), read_points, 0.02),
}
"""Maker of an object, the call that refuses it, and by how much the world may be larger."""


def follow(message, name, value):
    """Return what the calls of a hint make of a value, one after the other."""
    names = {"cspace": cspace, "np": np, name: value, "spacing": 0.05, "radius": 0.02}
    for statement in re.split(r"; |, or (?=\w+\.)", message.partition("; use ")[2]):
        with contextlib.suppress(InputError):  # an alternative for another kind of object
            yield eval(re.sub(" (for a cloud|reads it)$", "", statement) or "None", names)


@pytest.mark.parametrize("kind", OBJECTS)
def test_a_hint_for_an_object_leads_into_its_world(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make, read, slack = OBJECTS[kind]
    value, worlds = make(), []
    with pytest.raises(InputError) as caught:
        read(value)
    for found in follow(str(caught.value), caught.value.argument, value):
        with contextlib.suppress(InputError):  # of a cloud where a mesh is needed
            worlds.append(found if isinstance(found, Workspace) else read(found))
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
