"""Mesh files, read whole or refused."""

import struct
import tracemalloc

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from cspace import FileError, GeometryError, InputError
from cspace.files.meshes import read_mesh
from cspace.files.polygons import triangulate
from tests.helpers.mesh_files import (
    BOX_CORNERS,
    BOX_MESH,
    BOX_QUADS,
    BOX_SHIFT,
    FACES,
    SECOND,
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
    text = f"o a\n{VERTICES}{lines('f', BOX_QUADS - 8)}o b\n{lines('v', BOX_CORNERS + BOX_SHIFT)}{lines('f', second)}"
    check_boxes(read(tmp_path, "two.obj", text), 2)


@pytest.mark.parametrize(
    "write",
    [
        lambda text: text.replace("f ", "f\t"),
        lambda text: text.replace("f ", " f "),
        lambda text: text.replace("f ", "F "),
        lambda text: text.replace("f ", "f  ").replace("\n", "  \r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("v ", "v\t").replace("v\t", " V\t", 3),
        lambda text: text.replace("\n", " # a comment\n"),
        lambda text: text.replace("\n", " # path C:\\folder\\\n"),
        lambda text: text.replace("\nf", "\ng part\\one\nusemtl a#b\nl 1 2 3\np 1\nf"),
        lambda text: text.rstrip(),
        lambda text: text.replace(".0\n", ".0 1\n"),
        lambda text: text.replace(".0\n", ".0 0.5 0.5 0.5\n"),
    ],
)
def test_obj_is_read_in_every_layout(tmp_path, write):
    check_boxes(read(tmp_path, "laid.obj", VERTICES + FACES + write(SECOND)), 2)
    check_boxes(read(tmp_path, "laid.obj", write(VERTICES + FACES)))


def test_obj_may_begin_with_a_byte_order_mark(tmp_path):
    check_boxes(read(tmp_path, "mark.obj", b"\xef\xbb\xbf" + (VERTICES + FACES).encode()))


@pytest.mark.parametrize("corner", ["{0}", "{0}/1", "{0}//1", "{0}/1/1"])
def test_corners_of_obj_may_name_more_than_a_vertex(tmp_path, corner):
    faces = lines("f", [[corner.format(number) for number in quad] for quad in BOX_QUADS + 1])
    check_boxes(read(tmp_path, "slashes.obj", f"{VERTICES}vt 0 0\nvn 0 0 1\n{faces}"))


@refusals(
    "text, message",
    ("surf 0 1 0 1 1 2 3\n", "'surf'"),
    ("curv 0 1 1 2\n", "'curv'"),
    ("call other.obj\n", "'call'"),
    ("fo 1 2 3\n", "'fo'"),
    ("1 2 3\n", "not a statement"),
    ("ff 1 2 3\n", "not a statement"),
    ("f 1 2\n", "2 corners"),
    ("f 0 1 2\n", "vertex 0"),
    ("f 1 2 9\n", "vertex 8"),
    ("f 1 2 -9\n", "vertex -1"),
    ("f 1 2 3.5\n", "not a whole number"),
    ("f 1 2 /3\n", "not a whole number"),
    ("v 1 2\n", "2 numbers"),
    ("v 1 2 3 2\n", "weights"),
    ("mtllib C:\\\nf 1 2 3\n", "backslash"),
    ("usemtl \\\n\tF\t1 2 3\n", "backslash"),
    ("\0", "not text"),
)
def test_ambiguous_obj_files_are_refused(tmp_path, text, message):
    check_refused(tmp_path, "odd.obj", VERTICES + FACES + text, message)


def test_a_large_obj_is_read_whole(tmp_path):
    sphere = trimesh.creation.icosphere(subdivisions=6)
    file = tmp_path / "sphere.obj"
    file.write_text(lines("v", sphere.vertices.tolist()) + lines("f", sphere.faces + 1))
    vertices, faces = read_mesh(file)
    assert np.array_equal(vertices, sphere.vertices)
    assert np.array_equal(faces, sphere.faces)


# Polygons


def measure_area(points, sizes):
    faces = triangulate(np.array(points, float), np.arange(len(points)), np.array(sizes))
    return trimesh.Trimesh(points, faces, process=False).area


@given(st.integers(3, 12), st.integers(0, 2**32 - 1))
def test_flat_convex_polygons_keep_their_area(count, seed):
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    x, y = np.cos(angles), np.sin(angles)
    shoelace = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    points = np.stack([x, y, np.zeros(count)], axis=1) @ turn.T + rng.uniform(-3, 3, 3)
    assert measure_area(points, [count]) == pytest.approx(shoelace, rel=1e-9)


@pytest.mark.parametrize("first", range(6))
def test_bent_polygons_that_one_corner_sees_keep_their_area(first):
    corner = np.array([(0, 0, 1), (3, 0, 1), (3, 1, 1), (1, 1, 1), (1, 3, 1), (0, 3, 1)], float)
    assert measure_area(np.roll(corner, first, axis=0), [6]) == pytest.approx(5.0)
    dart = np.array([(0, 0, 0), (2, 1, 0), (4, 0, 0), (2, 4, 0)], float)
    assert measure_area(np.roll(dart, first, axis=0), [4]) == pytest.approx(6.0)


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
    face = f"f {' '.join(map(str, range(1, len(points) + 1)))}\n"
    check_refused(
        tmp_path, "bent.obj", lines("v", points) + "f 1 2 3\n" + face, message, GeometryError
    )


def test_degenerate_huge_and_tiny_polygons_are_read(tmp_path):
    line = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
    assert measure_area(line, [4]) == 0.0
    assert measure_area([(1, 1, 1)] * 4, [4]) == 0.0
    for scale in (1e-160, 1e90):
        face = triangulate(BOX_CORNERS * scale, BOX_QUADS.reshape(-1), np.full(6, 4))
        assert face.shape == (12, 3)
    with pytest.raises(InputError, match="is nan; it must be finite"):
        read(tmp_path, "nan.obj", "v 0 0 nan\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")


# STL


def make_binary_stl(count=12, shift=0.0):
    raw = bytearray(
        trimesh.Trimesh(BOX_CORNERS + shift, BOX_MESH.faces, process=False).export(file_type="stl")
    )
    raw[80:84] = struct.pack("<I", count)
    return bytes(raw)


def make_text_stl(shift=0.0, name=""):
    text = trimesh.Trimesh(BOX_CORNERS + shift, BOX_MESH.faces, process=False).export(
        file_type="stl_ascii"
    )
    return text.replace("solid ", f"solid {name}", 1)


@pytest.mark.parametrize(
    "write",
    [
        lambda text: text,
        str.upper,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("solid ", "solid endsolid vertex normal 1 2 3 facet ", 1),
        lambda text: text.replace("\nfacet", "\n\t facet").replace("endsolid", "\tendsolid"),
        lambda text: text.replace("solid ", "solid ünïcode ", 1),
    ],
)
def test_all_solids_of_a_text_stl_are_read(tmp_path, write):
    check_boxes(
        read(tmp_path, "two.stl", write(make_text_stl()) + "\n" + write(make_text_stl(BOX_SHIFT))),
        2,
    )


@refusals(
    "content, message",
    (make_binary_stl(6), "declares 6 triangles but has bytes for 12"),
    (make_binary_stl(13), "declares 13 triangles but has bytes for 12"),
    (make_binary_stl()[:60], "truncated"),
    (b"solid " + make_binary_stl(6)[6:], "solid"),
    (make_text_stl() + make_text_stl(BOX_SHIFT).replace("endsolid", ""), "endsolid"),
    (make_text_stl() + make_text_stl(BOX_SHIFT).replace("endsolid", "endsol"), "endsolid"),
    (make_text_stl().replace("endsolid", "") + make_text_stl(BOX_SHIFT), "endsolid"),
    (make_text_stl() + make_text_stl(BOX_SHIFT).partition("facet")[2], "endsolid"),
    (
        make_text_stl()
        + make_text_stl(BOX_SHIFT).replace(
            "solid",
            "solid "
            + make_text_stl().partition("solid")[2].partition("endsolid")[0].replace("\n", " "),
        ),
        "own",
    ),
    (make_text_stl() + make_text_stl(BOX_SHIFT).replace("vertex", "vertix", 1), "whole ones"),
    (make_text_stl() + make_text_stl(BOX_SHIFT).replace("endfacet\n", "", 1), "words"),
    (make_text_stl().replace(".0 ", ".0, "), "malformed"),
    (
        b" 4\xff0".join(make_text_stl().encode().rsplit(b" 4.0", 1)),
        "malformed",
    ),  # which is neither 4.0 nor 40
    (make_text_stl().encode().replace(b" 4.0", b" 4.0\0", 1), "not text"),
    (
        make_text_stl() + make_text_stl(BOX_SHIFT).partition("facet")[2].partition("endsolid")[0],
        "endsolid",
    ),
)
def test_inconsistent_stl_files_are_refused(tmp_path, content, message):
    check_refused(tmp_path, "odd.stl", content, message, FileError)


def test_one_long_number_takes_little_memory(tmp_path):
    long = f"0.{'0' * 100_000}1"
    path = tmp_path / "long.obj"
    path.write_text(f"v {long} 0 0\n" + "v 1 0 0\nv 0 1 0\n" * 500 + "f 1 2 3\n")
    read_mesh(path)  # import and compile first
    tracemalloc.start()
    vertices, triangles = read_mesh(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (vertices[:2] == [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]).all() and triangles.tolist() == [
        [0, 1, 2]
    ]
    assert peak < 2**24
