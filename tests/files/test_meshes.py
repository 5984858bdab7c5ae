"""OBJ, STL and PLY meshes, read whole or refused."""

import itertools
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace import FileError, GeometryError, InputError
from cspace._files.polygons import triangulate
from tests.helpers.mesh_files import (
    BOX_CORNERS,
    BOX_MESH,
    BOX_QUADS,
    BOX_SHIFT,
    FACES,
    VERTICES,
    check_boxes,
    check_refused,
    lines,
    read,
)
from tests.helpers.refusals import refusals

# OBJ


@pytest.mark.parametrize("second", [BOX_QUADS - 8, BOX_QUADS + 9], ids=["relative", "absolute"])
def test_negative_corners_of_obj_count_back(tmp_path, second):
    first = VERTICES + lines("f", BOX_QUADS - 8)
    text = f"o a\n{first}o b\n{lines('v', BOX_CORNERS + BOX_SHIFT)}{lines('f', second)}"
    check_boxes(read(tmp_path, "two.obj", text), 2)


@pytest.mark.parametrize(
    "write",
    [
        lambda text: "\ufeff" + text.replace("f ", " F\t").rstrip(),
        lambda text: text.replace("\n", "  \r\n").replace("v ", " V\t", 3),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("\n", " # path C:\\folder\\\n"),
        lambda text: text.replace("\nf", "\ng part\\one\nusemtl a#b\nf"),
        lambda text: text.replace(".0\n", ".0 0.5 0.5 0.5\n"),
        lambda text: text.replace("f ", "vt 0 0\nf ").replace("1 ", "1/1 ").replace("2 ", "2//1 "),
    ],
    ids=["mark", "Windows", "old Mac", "comments", "groups", "colours", "texture"],
)
def test_obj_is_read_in_every_layout(tmp_path, write):
    check_boxes(read(tmp_path, "laid.obj", write(VERTICES + FACES)))


LINES_OF_OBJ = ("l 9 10 11\n", "l 9 10\nl -2 -1\n", "l 9/1 10/1 11/1\n")


@pytest.mark.parametrize("text", LINES_OF_OBJ)
def test_lines_and_points_of_obj_are_obstacles(tmp_path, text):
    corners = [(4.5, 1.1, 1.1), (6.6, 1.4, 1.4), (6.6, 2.9, 1.2)]
    box = VERTICES + FACES
    (tmp_path / "box.obj").write_text(box)
    (tmp_path / "lines.obj").write_text(box + lines("v", corners) + text + "p 1\n")
    bounds = (-1, -1, -1, 8, 6, 6)
    plain, lined = (
        cspace.Workspace.open(tmp_path / f"{name}.obj", spacing=0.25, bounds=bounds)
        for name in ("box", "lines")
    )
    # All points on the lines lie in outer cells, and no inside appears or goes, except on them.
    shares = np.linspace(0.0, 1.0, 500)[:, np.newaxis]
    on_lines = np.concatenate(
        [a + shares * np.subtract(b, a) for a, b in itertools.pairwise(corners)]
    )
    assert lined.outer[tuple(lined.grid.cell_of(on_lines).T)].all()
    assert (lined.outer >= plain.outer).all() and 15 < (lined.outer ^ plain.outer).sum() < 120
    np.testing.assert_array_equal(lined.inner, plain.inner)


@refusals(
    "text, message",
    ("ff 1 2 3\n", "not a statement"),
    ("f 1 2 9\n", "vertex 8"),
    ("f 1 2 3.5\n", "not a whole number"),
    ("v 1 2 3 2\n", "weights"),
    ("usemtl \\\nf 1 2 3\n", "backslash"),
)
def test_ambiguous_obj_files_are_refused(tmp_path, text, message):
    check_refused(tmp_path, "odd.obj", VERTICES + FACES + text, message)


# Polygons


def measure_area(points):
    """Return the area of the triangles of one polygon."""
    count = len(points)
    faces = triangulate(np.array(points, float), np.arange(count), np.array([count]))
    assert len(faces) == count - 2
    return trimesh.Trimesh(points, faces, process=False).area


@given(
    count=st.integers(3, 12),
    dented=st.booleans(),
    scale=st.sampled_from([1e-160, 1e-3, 1.0, 1e90]),
    seed=st.integers(0, 2**32 - 1),
)
def test_flat_polygons_that_one_corner_sees_keep_their_area(count, dented, scale, seed):
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    corners = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    if dented and count > 4:
        corners[rng.integers(count)] *= 0.3  # this corner sees the whole polygon
    x, y, _ = corners.T
    shoelace = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    points = corners @ turn.T + rng.uniform(-3, 3, 3)
    faces = triangulate(points * scale, np.arange(count), np.array([count]))
    assert len(faces) == count - 2
    assert trimesh.Trimesh(points, faces, process=False).area == pytest.approx(shoelace, rel=1e-9)


@refusals(
    "points, message",
    ([(0, 0, 0), (1, 0, 0.01), (1, 1, 0), (0, 1, 0.01)], "one plane"),
    ([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)], "no area"),
    ([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 2, 0)], "crosses itself"),
    (
        [(0, 0, 0), (4, 0, 0), (4, 3, 0), (3, 3, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0), (0, 3, 0)],
        "bends",
    ),
)
def test_ambiguous_polygons_are_refused(tmp_path, points, message):
    face = lines("f", [range(1, len(points) + 1)])
    text = lines("v", points) + "f 1 2 3\n" + face
    check_refused(tmp_path, "bent.obj", text, message, GeometryError)


def test_degenerate_polygons_are_read_and_nan_is_refused(tmp_path):
    for points in ([(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)], [(1, 1, 1)] * 4):
        assert measure_area(points) == 0.0
    with pytest.raises(InputError, match="is nan; it must be finite"):
        read(tmp_path, "nan.obj", "v 0 0 nan\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")


# STL

SHIFTED = trimesh.Trimesh(BOX_CORNERS + BOX_SHIFT, BOX_MESH.faces, process=False)
BINARY = BOX_MESH.export(file_type="stl")
TEXT = BOX_MESH.export(file_type="stl_ascii") + "\n"
OTHER = SHIFTED.export(file_type="stl_ascii")


def test_a_binary_stl_is_read(tmp_path):
    check_boxes(read(tmp_path, "box.stl", b"solid".ljust(80) + BINARY[80:]))


@pytest.mark.parametrize(
    "write",
    [
        str.upper,
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("solid ", "solid endsolid vertex normal ünïcode facet ", 1),
        lambda text: text.replace("\nfacet", "\n\t facet").replace("endsolid", "\tendsolid"),
    ],
    ids=["upper case", "old Mac", "names", "blanks"],
)
def test_all_solids_of_a_text_stl_are_read(tmp_path, write):
    check_boxes(read(tmp_path, "two.stl", write(TEXT) + write(OTHER)), 2)


@refusals(
    "content, message",
    (
        BINARY[:80] + struct.pack("<I", 13) + BINARY[84:],
        "declares 13 triangles but has bytes for 12",
    ),
    (TEXT.replace("endsolid", "") + OTHER, "from solid to endsolid"),
    (TEXT.replace("solid ", "solid endfacet ", 1), "lines of their own"),
    (TEXT + OTHER.replace("vertex", "vertix", 1), "stray words"),
    (TEXT.encode().replace(b" 4.0", b" 4\xff0", 1), "malformed"),  # neither 4.0 nor 40
)
def test_inconsistent_stl_files_are_refused(tmp_path, content, message):
    check_refused(tmp_path, "odd.stl", content, message, FileError)


# PLY

ORDERS = ["ascii", "binary_little_endian", "binary_big_endian"]
MIXED = [BOX_QUADS[0, :3], BOX_QUADS[0, [0, 2, 3]], *BOX_QUADS[1:]]


def make_ply(order, faces=BOX_QUADS, point="f4", corner="i4"):
    """Return a PLY file of a box; each face has one byte before and one after its corners."""
    names = {"f4": "float", "f8": "double", "i4": "int", "u4": "uint32"}
    head = f"ply\nformat {order} 1.0\ncomment made by hand\nelement vertex {len(BOX_CORNERS)}\n"
    head += "".join(f"property {names[point]} {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty uchar red\n"
    head += f"property list uchar {names[corner]} vertex_indices\nproperty uchar blue\nend_header\n"
    if order == "ascii":
        body = lines("", BOX_CORNERS) + lines("", [[7, len(face), *face, 7] for face in faces])
        return (head + body).encode()
    mark = "<" if "little" in order else ">"
    body = BOX_CORNERS.astype(mark + point).tobytes()
    for face in faces:
        body += bytes([7, len(face)]) + np.asarray(face, mark + corner).tobytes() + bytes([7])
    return head.encode() + body


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("point, corner", [("f4", "i4"), ("f8", "u4")])
def test_faces_of_ply_are_read_in_every_order_of_bytes(tmp_path, order, point, corner):
    check_boxes(read(tmp_path, "box.ply", make_ply(order, BOX_MESH.faces, point, corner)))
    check_boxes(read(tmp_path, "box.ply", make_ply(order, BOX_QUADS, point, corner)))


def test_faces_of_unequal_sizes_are_read_from_text_only(tmp_path):
    check_boxes(read(tmp_path, "box.ply", make_ply("ascii", MIXED)))
    for order in ORDERS[1:]:
        message = "equally many corners|different numbers"
        check_refused(tmp_path, "box.ply", make_ply(order, MIXED), message)


ASCII = make_ply("ascii")
ENDED = "end_header\n"


@refusals(
    "content, message",
    (ASCII[:-3], "declares"),
    (make_ply("binary_little_endian") + b"abc", "faces of equally many corners"),
    (ASCII.replace(b"vertex_indices", b"corners"), "one list named vertex_indices"),
    (make_ply("ascii", [(0, 1, 2.5)]), "not as declared"),
    (ASCII.replace(b"float z", b"float w"), "x, y and z"),
)
def test_inconsistent_ply_files_are_refused(tmp_path, content, message):
    check_refused(tmp_path, "odd.ply", content, message)


def test_strips_and_edges_of_ply_are_refused(tmp_path):
    text = ASCII.decode()
    strips = "element tristrips 1\nproperty list int int vertex_indices\n" + ENDED
    content = text.replace(ENDED, strips) + "4 0 1 2 3\n"
    check_refused(tmp_path, "strips.ply", content, "elements tristrips", GeometryError)
    edges = "element edge 1\nproperty int vertex1\nproperty int vertex2\n" + ENDED
    content = text.replace(ENDED, edges) + "0 1\n"
    check_refused(tmp_path, "edges.ply", content, "has edges beside", GeometryError)
