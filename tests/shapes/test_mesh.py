"""Meshes: reading, refusals, bodies and points inside."""

import json
import warnings

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from cspace import FileError, GeometryError, InputError, make_mesh
from cspace._shapes.mesh import Mesh, MeshWarning
from tests.helpers.mesh_files import TETRAHEDRON, join_meshes
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

SPHERE = trimesh.creation.icosphere(subdivisions=2)
TETRA_VERTICES, TETRA_FACES = TETRAHEDRON


def test_parts_of_a_scene_are_placed_and_joined():
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[0, 3] = 10.0
    scene.add_geometry(SPHERE, node_name="a")
    scene.add_geometry(
        SPHERE, node_name="b", transform=trimesh.transformations.translation_matrix((5, 0, 0))
    )
    scene.add_geometry(SPHERE, node_name="c", transform=mirror)
    mesh = make_mesh(scene)
    assert len(mesh.bodies) == 3
    assert mesh.volume == pytest.approx(3 * SPHERE.volume)
    assert mesh.contains([(0, 0, 0), (5, 0, 0), (10, 0, 0), (2.5, 0, 0)]).tolist() == [
        True,
        True,
        True,
        False,
    ]
    scene.add_geometry(trimesh.PointCloud(np.eye(3)))
    with pytest.raises(GeometryError, match="cloud of points"):
        make_mesh(scene)


@refusals(
    "shape, error, message",
    ((TETRA_VERTICES, [[0, 1, 4]]), GeometryError, "vertex 4"),
    ("none.stl", FileError, "does not exist"),
    ((TETRA_VERTICES, [[0.0, 1.0, 2.0]]), GeometryError, "whole numbers"),
    ((TETRA_VERTICES * np.nan, TETRA_FACES), InputError, "nan"),
    (
        (TETRA_VERTICES, np.ma.masked_equal(TETRA_FACES, 3)),
        InputError,
        "faces of mesh has 3 masked",
    ),
    ((TETRA_VERTICES * 1e200, TETRA_FACES), GeometryError, "they must reach"),
)
def test_invalid_meshes_are_refused(shape, error, message):
    with pytest.raises(error, match=message):
        make_mesh(shape)


def test_open_bodies_warn_once_and_only_with_auto():
    shape = (
        np.concatenate([SPHERE.vertices, TETRA_VERTICES + 5]),
        np.concatenate([SPHERE.faces, TETRA_FACES[1:] + 162]),
    )
    with pytest.warns(
        MeshWarning, match=r"1 of 2 bodies .* \(3 of 323 triangles\).*surface.*fill"
    ) as caught:
        mesh = make_mesh(shape)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    with warnings.catch_warnings(action="error"):
        assert mesh.contains([(0, 0, 0), (5.1, 5.1, 5.1)]).tolist() == [True, False]
        assert not make_mesh(shape, "surface").contains((0, 0, 0))
        assert not Mesh.from_spec(mesh.spec).is_watertight
        with pytest.raises(InputError, match="fill"):
            make_mesh(shape, "fill").contains((0, 0, 0))
    with pytest.warns(MeshWarning, match="no triangle"):
        make_mesh((TETRA_VERTICES, [[0, 1, 1]]))


def test_coincident_vertices_and_empty_triangles_do_not_open_a_body():
    separate = (TETRA_VERTICES[TETRA_FACES].reshape(-1, 3), np.arange(12).reshape(4, 3))
    assert make_mesh(separate).is_watertight
    zeros = np.where(
        separate[0] == 0.0, np.where(np.arange(12)[:, None] % 2, -0.0, 0.0), separate[0]
    )
    assert make_mesh((zeros, separate[1])).is_watertight
    for extra in ([[0, 0, 1]], [[2, 2, 2]]):
        mesh = make_mesh((TETRA_VERTICES, np.concatenate([TETRA_FACES, extra])))
        assert mesh.is_watertight
        assert len(mesh.bodies) == 1
    # A triangle without area on an edge is skipped; such a triangle that closes a gap is kept.
    vertices = np.vstack([TETRA_VERTICES, [0.5, 0, 0]])
    assert make_mesh((vertices, np.concatenate([TETRA_FACES, [[0, 4, 1]]]))).is_watertight
    halves = [[0, 4, 3], [4, 1, 3]]
    assert not make_mesh(
        (vertices, np.concatenate([TETRA_FACES[[0, 2, 3]], halves])), "surface"
    ).is_watertight
    mended = make_mesh((vertices, np.concatenate([TETRA_FACES[[0, 2, 3]], halves, [[0, 1, 4]]])))
    assert mended.is_watertight
    assert mended.volume == pytest.approx(1 / 6)
    assert mended.contains((0.2, 0.2, 0.2))
    assert not mended.contains((0.6, 0.6, 0.6))


def test_bodies_that_touch_along_an_edge_are_separate():
    cube = trimesh.creation.box((2, 2, 2))
    vertices = np.array(cube.vertices)
    faces = np.array(cube.faces)
    beside = make_mesh(join_meshes((vertices, faces), (np.add(vertices, (2, 2, 0)), faces)))
    assert len(beside.bodies) == 2
    assert beside.contains([(0, 0, 0), (2, 2, 0), (0, 2, 0)]).tolist() == [True, True, False]
    # An open part attached to a closed body leaves the body closed.
    with pytest.warns(MeshWarning, match=r"1 of 2 bodies .*\(1 of 13 triangles\)"):
        fin = make_mesh(
            (np.vstack([vertices, [3, 3, 3]]), np.vstack([faces, [faces[0, 0], faces[0, 1], 8]]))
        )
    assert fin.contains((0, 0, 0))
    # An inward body that shares an edge with the outward body around it is no cavity.
    inner = vertices * (0.5, 0.5, 1) - (0.5, 0.5, 0)
    assert make_mesh(join_meshes((vertices, faces), (inner, faces[:, ::-1]))).contains(
        [(-0.5, -0.5, 0), (0.5, 0.5, 0), (1.5, 0, 0)]
    ).tolist() == [True, True, False]


@given(seeds, st.booleans())
def test_points_in_convex_bodies_agree_with_half_spaces(seed, lattice):
    # Points on the lattice of the corners cast rays through vertices and edges.
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, 7, (12, 3)).astype(float) if lattice else rng.uniform(0, 6, (12, 3))
    hull = ConvexHull(corners)  # its triangles have any orientation
    mesh = make_mesh((hull.points, hull.simplices))
    points = np.stack(np.meshgrid(*(np.arange(-1, 8),) * 3, indexing="ij"), axis=-1).astype(float)
    height = points @ hull.equations[:, :3].T + hull.equations[:, 3]
    inside = (height < -1e-9).all(axis=-1)
    outside = (height > 1e-9).any(axis=-1)
    answers = mesh.contains(points)
    assert answers.shape == inside.shape
    assert answers[inside].all()
    assert not answers[outside].any()


def test_a_spec_restores_a_mesh_exactly():
    rng = np.random.default_rng(0)
    mesh = make_mesh((rng.normal(size=(9, 3)) * 1e-7, rng.permutation(9).reshape(3, 3)), "surface")
    back = Mesh.from_spec(json.loads(json.dumps(mesh.spec)))
    assert back.vertices.tobytes() == mesh.vertices.tobytes()
    assert back.faces.tobytes() == mesh.faces.tobytes()
    assert (back.solid, back.source) == ("surface", "mesh")
    for damage in ({"vertices": "?"}, {"faces": 3}, {"vertices": "AAAA"}):
        with pytest.raises((TypeError, ValueError)):
            Mesh.from_spec({**mesh.spec, **damage})


@given(seeds, st.integers(0, 4))
def test_a_footprint_contains_triangles_seen_edge_on(seed, count):
    rng = np.random.default_rng(seed)
    triangles = np.concatenate(
        [rng.uniform(-1, 1, (count + 1, 3, 3)), rng.uniform(-3, 3, (6, 3, 3))]
    )
    edge_on = triangles[count + 1 :]
    edge_on[:2, 2, :2] = edge_on[:2, 0, :2]
    edge_on[2:4, 2, :2] = edge_on[2:4, :2, :2].mean(axis=1)
    edge_on[4, 1:, :2] = edge_on[4, :1, :2]
    edge_on[5, 2, :2] = edge_on[5, 0, :2] + rng.uniform(-1, 1, 2) * 10.0 ** rng.uniform(-17, -5)
    mesh = make_mesh(
        (triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)), "surface"
    )
    flat = mesh.project_to_plane()
    weights = rng.dirichlet(np.ones(3), (len(triangles), 200))
    points = (weights @ triangles)[..., :2].reshape(-1, 2)
    corners = triangles[..., :2].reshape(-1, 2)
    assert flat.outer.contains(np.concatenate([points, corners])).all()
    inside = points[flat.inner.contains(points)]
    shadows = shapely.polygons(triangles[[*range(count + 1), -1], :, :2])
    assert (shapely.distance(shadows[:, None], shapely.points(inside)).min(axis=0) < 1e-12).all()
    assert len(inside) > 20
