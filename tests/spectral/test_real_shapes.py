"""Decompositions of real and bundled shapes: outer balls miss no point of a dense sample, inner ones stay inside."""

import json

import numpy as np
import pytest
import shapely

from cspace.demo import floor_plan
from cspace.shapes.mesh import Mesh
from cspace.spectral import decompose
from oracles import distance_to_triangles, sample_surface, winds_around

CARS = 13
MESHES = [
    "ZTunnel/robot.obj",
    "ZTunnel/obstacles.obj",
    "LTunnel/l-robot.obj",
]
KINDS = ["outer", "inner"]


def gaps(points, spheres):
    """Distances from points to a union of balls; below zero inside."""
    found = np.full(len(points), np.inf)
    for center, radius in zip(spheres.centers, spheres.radii, strict=True):
        found = np.minimum(found, np.linalg.norm(points - center, axis=1) - radius)
    return found


def check_flat(shape, kind, number):
    spheres = decompose(shape, kind=kind, number=number)
    if kind == "inner":
        centers = shapely.points(spheres.centers)
        assert shapely.covers(shape, centers).all()
        size = float(np.hypot(*np.ptp(np.array(shape.bounds).reshape(2, 2), axis=0)))
        assert (spheres.radii <= shapely.distance(centers, shapely.boundary(shape)) + 1e-15 * size).all()
        return
    low, high = np.array(shape.bounds).reshape(2, 2)
    points = np.random.default_rng(0).uniform(low, high, (20_000, 2))
    border = shapely.get_parts(shapely.boundary(shape))[:, None]
    along = shapely.line_interpolate_point(border, np.linspace(0.0, 1.0, 2001), normalized=True)
    inside = points[shapely.contains_xy(shape, *points.T)]
    assert len(inside) > 1000
    for sample in (inside, shapely.get_coordinates(along), shapely.get_coordinates(shape)):
        assert gaps(sample, spheres).max() <= 0.0


def check_solid(mesh, kind, number):
    spheres = decompose(mesh, kind=kind, number=number)
    triangles, vertices = np.asarray(mesh.triangles), np.asarray(mesh.vertices)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if kind == "inner":
        assert winds_around(spheres.centers, triangles).all()
        assert (spheres.radii <= distance_to_triangles(spheres.centers, triangles) + 1e-12 * size).all()
        return
    rng = np.random.default_rng(0)
    surface = sample_surface(triangles, 20_000, rng)
    # Points of the solid, by small steps from its surface and between points of it.
    within = np.vstack([surface[:4000] + rng.normal(size=(4000, 3)) * 0.02 * size, rng.permutation(surface)[:4000]])
    within[4000:] = 0.5 * (within[4000:] + surface[:4000])
    within = within[winds_around(within, triangles)]
    assert len(within) > 500
    for sample in (surface, vertices, within):
        assert gaps(sample, spheres).max() <= 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_real_polygons(data, kind):
    folder = data / "polygons"
    cars = json.loads((folder / "parking1.geojson").read_text())["features"]
    assert len(cars) == CARS
    for shape in (
        shapely.from_geojson((folder / "car.geojson").read_text()),
        *(shapely.geometry.shape(car["geometry"]) for car in cars[::4]),
    ):
        check_flat(shape, kind, 40)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", MESHES)
def test_real_meshes(data, name, kind):
    check_solid(Mesh.of(data / "solids" / name), kind, 80)


@pytest.mark.parametrize("kind", KINDS)
def test_the_bundled_floor_plan(kind):
    check_flat(shapely.union_all(floor_plan()), kind, 200)
