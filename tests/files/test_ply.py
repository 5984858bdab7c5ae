"""PLY meshes: faces in every byte order, and refusals."""

import numpy as np
import pytest

from cspace import GeometryError
from tests.helpers.mesh_files import (
    BOX_CORNERS,
    BOX_MESH,
    BOX_QUADS,
    check_boxes,
    check_refused,
    read,
)
from tests.helpers.refusals import refusals

# PLY


def make_ply(
    order,
    faces=BOX_QUADS,
    types=("float", "uchar", "int"),
    before="",
    after="",
    name="vertex_indices",
    tail=b"",
):
    """Return a PLY file of a box.

    `before` and `after` are one-byte properties around the lists of corners.
    """
    codes = {
        "float": "f4",
        "double": "f8",
        "uchar": "u1",
        "int": "i4",
        "ushort": "u2",
        "uint8": "u1",
        "uint32": "u4",
    }
    head = f"ply\nformat {order} 1.0\ncomment made by hand\nelement vertex {len(BOX_CORNERS)}\n"
    head += "".join(f"property {types[0]} {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\n"
    head += f"{before}property list {types[1]} {types[2]} {name}\n{after}"
    rows = [(types[0], list(point)) for point in BOX_CORNERS]
    for face in faces:
        rows += [("uchar", [7])] if before else []
        rows += [(types[1], [len(face)]), (types[2], list(face))]
        rows += [("uchar", [7])] if after else []
    if order == "ascii":
        tokens = [str(value) for _, row in rows for value in row]
        lines, each = [" ".join(tokens[3 * i : 3 * i + 3]) for i in range(8)], iter(tokens[24:])
        lines += [
            " ".join(next(each) for _ in range(1 + len(f) + bool(before) + bool(after)))
            for f in faces
        ]
        body = "\n".join(lines).encode()
    else:
        mark = "<" if "little" in order else ">"
        body = b"".join(np.array(row, dtype=mark + codes[kind]).tobytes() for kind, row in rows)
    return f"{head}end_header\n".encode() + body + tail


MIXED = [BOX_QUADS[0, :3], BOX_QUADS[0, [0, 2, 3]], *BOX_QUADS[1:]]
ORDERS = ["ascii", "binary_little_endian", "binary_big_endian"]
RED = "property uchar red\n"


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    "faces",
    [BOX_QUADS, MIXED, MIXED[::-1], BOX_MESH.faces],
    ids=["quads", "mixed", "turned", "triangles"],
)
@pytest.mark.parametrize(
    "types", [("float", "uchar", "int"), ("double", "ushort", "uint32")], ids=str
)
@pytest.mark.parametrize(
    ("before", "after"), [("", ""), (RED, ""), ("", RED)], ids=["plain", "before", "after"]
)
def test_faces_of_ply_are_read_in_every_order_of_bytes(
    tmp_path, order, faces, types, before, after
):
    content = make_ply(order, faces, types, before, after)
    if (
        order != "ascii" and len(set(map(len, faces))) > 1
    ):  # trimesh gives all lists the length of the first
        check_refused(tmp_path, "box.ply", content, "equally many corners|different numbers")
    else:
        check_boxes(read(tmp_path, "box.ply", content))


@pytest.mark.parametrize("order", ORDERS)
def test_faces_of_ply_may_have_other_properties_besides(tmp_path, order):
    texture = b"property list uchar uchar texcoord\n"
    data = make_ply(
        order,
        BOX_QUADS,
        before="property uchar red\n",
        after="property uchar blue\n",
        name="vertex_index",
    )
    check_boxes(read(tmp_path, "box.ply", data))
    check_refused(tmp_path, "box.ply", data.replace(b"property uchar blue\n", texture), "truncated")


def test_binary_lists_of_changing_length_are_refused(tmp_path):
    data = bytearray(make_ply("binary_little_endian", [(0, 1, 2), (0, 2, 3)]))
    data[-13] = 2
    check_refused(tmp_path, "odd.ply", bytes(data), "different numbers")


@refusals(
    "content, message",
    (make_ply("ascii", tail=b"\n0 1 2"), "15 lines"),
    (make_ply("ascii", tail=b" 7"), "6 words"),
    (make_ply("binary_little_endian", tail=b"abc"), "faces of equally many corners"),
    (make_ply("ascii", name="corners"), "one list named vertex_indices"),
    (make_ply("ascii", types=("float", "uchar", "float"), faces=[(0, 1, 2.5)]), "not as declared"),
    (make_ply("ascii", faces=[(0, 1, 8)]), "vertex 8"),
    (make_ply("ascii", faces=[(0, 1, -1)]), "vertex -1"),
    (make_ply("ascii", faces=[(0, 1)]), "2 corners"),
    (make_ply("ascii").replace(b"format ascii", b"header"), "header"),
    (make_ply("ascii").replace(b"float z", b"float w"), "x, y and z"),
    (make_ply("ascii").replace(b"face 6", b"face 99999999999999"), "truncated"),
    (make_ply("binary_big_endian").replace(b"face 6", b"face 99999999999999"), "truncated"),
    (make_ply("binary_big_endian").replace(b"vertex 8", b"vertex 99999999999999"), "truncated"),
)
def test_inconsistent_ply_files_are_refused(tmp_path, content, message):
    check_refused(tmp_path, "odd.ply", content, message)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("part", [0.97, 0.999])
@pytest.mark.parametrize("faces", [BOX_QUADS, MIXED], ids=["quads", "mixed"])
def test_truncated_ply_files_are_refused(tmp_path, order, part, faces):
    data = make_ply(order, faces)
    check_refused(tmp_path, "cut.ply", data[: int(part * len(data)) - 1], "truncated")


def test_strips_of_ply_are_refused_and_edges_skipped(tmp_path):
    data = make_ply("ascii").decode()
    strips = data.replace(
        "end_header", "element tristrips 1\nproperty list int int vertex_indices\nend_header"
    )
    check_refused(tmp_path, "strips.ply", strips + "\n4 0 1 2 3", "tristrips", GeometryError)
    edges = data.replace(
        "end_header", "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header"
    )
    check_boxes(read(tmp_path, "edges.ply", edges + "\n0 1\n"))
