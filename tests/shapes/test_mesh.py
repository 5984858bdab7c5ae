"""Meshes: reading, refusals, bodies and points inside."""

import json
import warnings

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from cspace import FileError, GeometryError, InputError, Robot, Workspace
from cspace.files.meshes import read_mesh
from cspace.shapes.mesh import Mesh, MeshWarning
from tests.helpers.mesh_files import TETRAHEDRON, join_meshes
from tests.helpers.oracles import winding_numbers
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

SPHERE = trimesh.creation.icosphere(subdivisions=2)
TETRA_VERTICES, TETRA_FACES = TETRAHEDRON

EXPORT_OPTIONS = {
    "binary.stl": {"file_type": "stl"},
    "text.stl": {"file_type": "stl_ascii"},
    "mesh.obj": {"file_type": "obj"},
    "binary.ply": {"file_type": "ply"},
    "text.ply": {"file_type": "ply", "encoding": "ascii"},
    "mesh.glb": {"file_type": "glb"},
}


def write(folder, name, mesh=SPHERE):
    data = mesh.export(**EXPORT_OPTIONS[name])
    file = folder / name
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    return file


@pytest.mark.parametrize("name", EXPORT_OPTIONS)
def test_every_format_restores_the_mesh(tmp_path, name):
    mesh = Mesh.of(write(tmp_path, name))
    assert mesh.source == name
    assert len(mesh.faces) == len(SPHERE.faces)
    assert np.allclose(
        np.sort(mesh.triangles, axis=None), np.sort(SPHERE.triangles, axis=None), atol=1e-6
    )
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(SPHERE.volume, rel=1e-5)


def test_a_gltf_file_is_read_with_its_buffer(tmp_path):
    for name, data in SPHERE.export(file_type="gltf").items():
        (tmp_path / name).write_bytes(data)
    assert Mesh.of(tmp_path / "model.gltf").is_watertight
    next(tmp_path.glob("*.bin")).unlink()
    with pytest.raises(FileError, match="buffer"):
        read_mesh(tmp_path / "model.gltf")


@refusals(
    "name, text, error, message",
    ("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", InputError, "nan"),
    ("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", GeometryError, "cloud of points"),
    ("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", FileError, "malformed"),
    ("empty.obj", "", GeometryError, "empty"),
    ("noise.ply", "\0\1\2" * 100, FileError, "noise.ply"),
    ("mesh.xyz", "0 0 0\n", InputError, "suffix"),
    ("mesh.dae", "<COLLADA/>", GeometryError, "scene"),
)
def test_files_without_a_mesh_are_refused(tmp_path, name, text, error, message):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(error, match=message):
        Mesh.of(file)


def test_a_cloud_of_points_and_a_missing_file_are_refused(tmp_path):
    cloud = tmp_path / "cloud.ply"
    cloud.write_bytes(trimesh.PointCloud(np.eye(3)).export(file_type="ply"))
    with pytest.raises(GeometryError, match="from_points"):
        Mesh.of(cloud)
    for path, message in ((tmp_path / "none.stl", "does not exist"), (tmp_path, "suffix")):
        with pytest.raises((FileError, InputError), match=message):
            Mesh.of(path)


def test_parts_of_a_scene_are_placed_and_joined():
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[0, 3] = 10.0
    scene.add_geometry(SPHERE, node_name="a")
    scene.add_geometry(
        SPHERE, node_name="b", transform=trimesh.transformations.translation_matrix((5, 0, 0))
    )
    scene.add_geometry(SPHERE, node_name="c", transform=mirror)
    mesh = Mesh.of(scene)
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
        Mesh.of(scene)


@refusals(
    "shape, error, message",
    ((TETRA_VERTICES, np.empty((0, 3), dtype=int)), GeometryError, "no triangles"),
    ((TETRA_VERTICES, [[0, 1, 4]]), GeometryError, "vertex 4"),
    ((TETRA_VERTICES, [[0, 1, -1]]), GeometryError, "vertex -1"),
    ((TETRA_VERTICES, [[0.0, 1.0, 2.0]]), GeometryError, "whole numbers"),
    ((TETRA_VERTICES, [[0, 1, 2, 3]]), GeometryError, r"\(F, 3\)"),
    ((TETRA_VERTICES[:, :2], TETRA_FACES), GeometryError, r"\(V, 3\)"),
    ((TETRA_VERTICES * np.nan, TETRA_FACES), InputError, "nan"),
    ((TETRA_VERTICES * (1 + 1j), TETRA_FACES), InputError, "complex"),
    (
        (TETRA_VERTICES, np.ma.masked_equal(TETRA_FACES, 3)),
        InputError,
        "faces of mesh has 3 masked",
    ),
    ((TETRA_VERTICES * 1e200, TETRA_FACES), GeometryError, "units"),
    (42, InputError, "int"),
    (trimesh.PointCloud(np.eye(3)), GeometryError, "cloud of points"),
)
def test_invalid_meshes_are_refused(shape, error, message):
    with pytest.raises(error, match=message):
        Mesh.of(shape)


def test_an_unknown_policy_is_refused():
    with pytest.raises(InputError, match="'surface'"):
        Mesh.of((TETRA_VERTICES, TETRA_FACES), "hollow")


def test_open_bodies_warn_once_and_only_with_auto():
    shape = (
        np.concatenate([SPHERE.vertices, TETRA_VERTICES + 5]),
        np.concatenate([SPHERE.faces, TETRA_FACES[1:] + 162]),
    )
    with pytest.warns(
        MeshWarning, match=r"1 of 2 bodies .* \(3 of 323 triangles\).*surface.*fill"
    ) as caught:
        mesh = Mesh.of(shape)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert mesh.contains([(0, 0, 0), (5.1, 5.1, 5.1)]).tolist() == [True, False]
        assert not Mesh.of(shape, "surface").contains((0, 0, 0))
        assert not Mesh.from_spec(mesh.spec).is_watertight
        with pytest.raises(InputError, match="fill"):
            Mesh.of(shape, "fill").contains((0, 0, 0))
    with pytest.warns(MeshWarning, match="no triangle"):
        Mesh.of((TETRA_VERTICES, [[0, 1, 1]]))


def test_a_mesh_warns_once_when_it_is_used():
    mesh, again = (Mesh(TETRA_VERTICES, TETRA_FACES[1:]) for _ in range(2))
    with pytest.warns(MeshWarning, match="1 of 1 bodies") as caught:
        workspace = Workspace.from_mesh(mesh, 0.5)
        robot = Robot.from_mesh(mesh)
        Mesh.of(mesh)
    assert len(caught) == 1
    with pytest.warns(MeshWarning, match="1 of 1 bodies"):
        Robot.from_mesh(again)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Robot.from_spec(robot.spec)
        Workspace.from_mesh(workspace.shapes[0], 0.25)
        Mesh.of(Mesh(TETRA_VERTICES, TETRA_FACES))
        Mesh.of(Mesh(TETRA_VERTICES, TETRA_FACES[1:], "surface"))
        Mesh.of(Mesh(TETRA_VERTICES, TETRA_FACES[1:]), "surface")


def test_coincident_vertices_and_empty_triangles_do_not_open_a_body():
    separate = (TETRA_VERTICES[TETRA_FACES].reshape(-1, 3), np.arange(12).reshape(4, 3))
    assert Mesh.of(separate).is_watertight
    zeros = np.where(
        separate[0] == 0.0, np.where(np.arange(12)[:, None] % 2, -0.0, 0.0), separate[0]
    )
    assert Mesh.of((zeros, separate[1])).is_watertight
    for extra in ([[0, 0, 1]], [[2, 2, 2]]):
        mesh = Mesh.of((TETRA_VERTICES, np.concatenate([TETRA_FACES, extra])))
        assert mesh.is_watertight
        assert len(mesh.bodies) == 1
    # A triangle without area on an edge is skipped; such a triangle that closes a gap is kept.
    vertices = np.vstack([TETRA_VERTICES, [0.5, 0, 0]])
    assert Mesh.of((vertices, np.concatenate([TETRA_FACES, [[0, 4, 1]]]))).is_watertight
    halves = [[0, 4, 3], [4, 1, 3]]
    assert not Mesh.of(
        (vertices, np.concatenate([TETRA_FACES[[0, 2, 3]], halves])), "surface"
    ).is_watertight
    mended = Mesh.of((vertices, np.concatenate([TETRA_FACES[[0, 2, 3]], halves, [[0, 1, 4]]])))
    assert mended.is_watertight
    assert mended.volume == pytest.approx(1 / 6)
    assert mended.contains((0.2, 0.2, 0.2))
    assert not mended.contains((0.6, 0.6, 0.6))


def test_bodies_that_touch_along_an_edge_are_separate():
    cube = trimesh.creation.box((2, 2, 2))
    vertices, faces = np.array(cube.vertices), np.array(cube.faces)
    beside = Mesh.of(join_meshes((vertices, faces), (np.add(vertices, (2, 2, 0)), faces)))
    assert len(beside.bodies) == 2
    assert beside.contains([(0, 0, 0), (2, 2, 0), (0, 2, 0)]).tolist() == [True, True, False]
    # An open part attached to a closed body leaves the body closed.
    with pytest.warns(MeshWarning, match=r"1 of 2 bodies .*\(1 of 13 triangles\)"):
        fin = Mesh.of(
            (np.vstack([vertices, [3, 3, 3]]), np.vstack([faces, [faces[0, 0], faces[0, 1], 8]]))
        )
    assert fin.contains((0, 0, 0))
    # An inward body that shares an edge with the outward body around it is no cavity.
    inner = vertices * (0.5, 0.5, 1) - (0.5, 0.5, 0)
    assert Mesh.of(join_meshes((vertices, faces), (inner, faces[:, ::-1]))).contains(
        [(-0.5, -0.5, 0), (0.5, 0.5, 0), (1.5, 0, 0)]
    ).tolist() == [True, True, False]


def test_a_mesh_is_returned_unchanged():
    filled = Mesh.of((TETRA_VERTICES, TETRA_FACES[1:]), "fill")
    assert Mesh.of(filled) is filled
    assert Mesh.of(filled, "fill") is filled
    assert Mesh.of(filled, "surface").solid == "surface"


def test_triangles_of_a_body_get_one_direction():
    mixed = TETRA_FACES.copy()
    mixed[0] = mixed[0, ::-1]
    for faces in (TETRA_FACES, TETRA_FACES[:, ::-1], mixed):
        (body,) = Mesh.of((TETRA_VERTICES, faces)).bodies
        assert body.closed
        assert body.volume == pytest.approx(1 / 6)
        assert Mesh.of((TETRA_VERTICES, faces)).contains(
            [(0.1, 0.1, 0.1), (0.9, 0.9, 0.9)]
        ).tolist() == [True, False]


def test_a_body_that_overlaps_itself_is_solid_throughout():
    # Two boxes are joined by a doubled edge; their overlap has winding number 2.
    first, second = trimesh.creation.box((2, 2, 2)), trimesh.creation.box((2, 2, 2))
    second.vertices[:] = second.vertices * (1.0, 1.0, 0.5)
    vertices, faces = join_meshes((first.vertices, first.faces), (second.vertices, second.faces))
    # Two opposite triangles join the boxes without adding a volume.
    pair = [[0, 1, 8], [8, 1, 0]]
    mesh = Mesh.of((vertices, np.concatenate([faces, pair])))
    assert mesh.contains([(0, 0, 0), (0, 0, 0.7), (0, 0, 1.2)]).tolist() == [True, True, False]


@given(seeds, st.booleans())
def test_points_in_convex_bodies_agree_with_half_spaces(seed, lattice):
    # Points on the lattice of the corners cast rays through vertices and edges.
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, 7, (12, 3)).astype(float) if lattice else rng.uniform(0, 6, (12, 3))
    try:
        hull = trimesh.convex.convex_hull(corners)
    except Exception:
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        mesh = Mesh.of((hull.vertices, hull.faces))
    if not mesh.is_watertight or hull.volume < 1e-3:
        return
    points = np.stack(np.meshgrid(*(np.arange(-1, 8),) * 3, indexing="ij"), axis=-1).astype(float)
    triangles = mesh.triangles
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    proper = np.linalg.norm(normals, axis=1) > 1e-9
    normals, starts = (
        normals[proper] / np.linalg.norm(normals[proper], axis=1)[:, None],
        triangles[proper, 0],
    )
    outward = np.sign(((starts - triangles.mean(axis=(0, 1))) * normals).sum(axis=1))
    height = ((points[..., None, :] - starts) * normals).sum(axis=-1) * outward
    inside, outside = (height < -1e-9).all(axis=-1), (height > 1e-9).any(axis=-1)
    answers = mesh.contains(points)
    assert answers.shape == inside.shape
    assert answers[inside].all()
    assert not answers[outside].any()


@given(seeds)
def test_points_in_crumpled_bodies_agree_with_solid_angles(seed):
    # The bodies intersect themselves.
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=1)
    vertices = np.array(ball.vertices) + rng.normal(size=ball.vertices.shape) * 0.5
    points = rng.uniform(-1.5, 1.5, (300, 3))
    solid = winding_numbers(points, vertices[ball.faces]) != 0
    assert (Mesh.of((vertices, ball.faces)).contains(points) == solid).all()
    # Reversed triangles are corrected.
    mixed = np.array(ball.faces)
    mixed[::3] = mixed[::3, ::-1]
    assert (Mesh.of((vertices, mixed)).contains(points) == solid).all()


def test_a_spec_restores_a_mesh_exactly():
    rng = np.random.default_rng(0)
    mesh = Mesh.of((rng.normal(size=(9, 3)) * 1e-7, rng.permutation(9).reshape(3, 3)), "surface")
    back = Mesh.from_spec(json.loads(json.dumps(mesh.spec)))
    assert back.vertices.tobytes() == mesh.vertices.tobytes()
    assert back.faces.tobytes() == mesh.faces.tobytes()
    assert (back.solid, back.source) == ("surface", "mesh")
    for damage in ({"vertices": "?"}, {"faces": 3}, {"vertices": "AAAA"}):
        with pytest.raises((TypeError, ValueError)):
            Mesh.from_spec({**mesh.spec, **damage})


def test_a_mesh_copies_its_arrays():
    vertices = TETRA_VERTICES.copy()
    mesh = Mesh.of((vertices, TETRA_FACES))
    vertices[:] = 7.0
    assert np.stack(mesh.bounds).tolist() == [[0, 0, 0], [1, 1, 1]]
    with pytest.raises(ValueError):
        mesh.vertices[0, 0] = 1.0


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
    mesh = Mesh.of(
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


@pytest.mark.parametrize("make", [Robot.capsule, Robot.cylinder])
def test_a_footprint_has_no_cracks(make):
    flat = make(1.0, 1.0).footprint().shape
    assert [
        len(ring.interiors) for side in (flat.outer, flat.inner) for ring in side.geometries
    ] == [0, 0]


@pytest.mark.parametrize("folder", ["ZTunnel", "LTunnel"])
def test_real_solids_are_closed(data, folder):
    for file in sorted((data / "solids" / folder).glob("*.obj")):
        mesh = Mesh.of(file)
        assert mesh.is_watertight
        assert all((body.turns == 1).all() for body in mesh.bodies)
