"""Point clouds in every format, whole, truncated and damaged."""

import contextlib
import io
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from cspace import Workspace
from cspace.errors import FileError, GeometryError, InputError
from cspace.files.points import read_points
from tests.helpers.refusals import refusals

CLOUD = np.array(
    [[0.0, 1.5, -2.25], [3.0, 4.0, 5.0], [1e3, -0.125, 7.75], [3.0, 4.0, 5.0], [0.5, 0.5, 0.5]]
)
"""A cloud that single precision holds exactly."""


def make_pcd(points, data):
    """Return a PCD file with fields of several types."""
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS rgb x _ y z\nSIZE 4 4 1 8 4\nTYPE U F U F F\n"
        f"COUNT 1 1 3 1 1\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {data}\n"
    ).encode()
    rows = [(7 * n, x, 1, 2, 3, y, z) for n, (x, y, z) in enumerate(points)]
    if data == "ascii":
        return header + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    return header + b"".join(struct.pack("<If3Bdf", *row) for row in rows)


ENCODINGS = ["ascii", "binary"]


def make_ply(points, form):
    cloud = trimesh.PointCloud(points)
    return cloud.export(file_type="ply", encoding=form)


def write(tmp_path, name, content):
    path = tmp_path / name
    path.unlink(missing_ok=True)  # disks overwrite files slowly
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def check_refused(path, error=FileError):
    with pytest.raises(error) as caught:
        read_points(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_pcd_is_read_in_every_encoding(tmp_path, encoding):
    many = np.random.default_rng(1).integers(-1000, 1000, (3000, 3)) / 8
    many[1000:2000] = many[0]
    for cloud in (CLOUD, many):
        points = read_points(write(tmp_path, "cloud.pcd", make_pcd(cloud, encoding)))
        assert points.dtype == np.float64 and points.flags.c_contiguous and (points == cloud).all()


def test_pcd_may_lack_counts_and_hold_integers(tmp_path):
    text = "VERSION .7\nFIELDS z y x\nSIZE 2 4 8\nTYPE I U F\nWIDTH 2\nHEIGHT 1\nDATA binary\n"
    body = struct.pack("<hId", -3, 2, 1.5) + struct.pack("<hId", 30, 20, 0.1)
    points = read_points(write(tmp_path, "cloud.pcd", text.encode() + body))
    assert (points == [[1.5, 2, -3], [0.1, 20, 30]]).all()


def test_pcd_may_have_windows_line_ends(tmp_path):
    content = make_pcd(CLOUD, "ascii").replace(b"\n", b"\r\n")
    assert (read_points(write(tmp_path, "cloud.pcd", content)) == CLOUD).all()


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_truncated_pcd_is_refused(tmp_path, encoding):
    content = make_pcd(CLOUD, encoding)
    body = content.index(b"DATA")
    for length in range(0, len(content) - 1, 7):
        message = check_refused(write(tmp_path, "cloud.pcd", content[:length]))
        if length > body + 30 and encoding == "binary":
            record = 4 + 4 + 3 + 8 + 4
            left = (length - content.index(b"\n", body) - 1) // record
            assert f"holds {left} points but its header says 5" in message


def test_truncated_pcd_is_refused_with_the_counts(tmp_path):
    content = make_pcd(CLOUD, "ascii")
    lines = content.decode().splitlines()
    assert "holds 3 points but its header says 5" in check_refused(
        write(tmp_path, "a.pcd", "\n".join(lines[:-2]) + "\n")
    )
    assert f"line {len(lines)} is" in check_refused(write(tmp_path, "b.pcd", content[:-8]))


@refusals(
    "old, new, message",
    ("FIELDS rgb x _ y z\n", "", "lacks FIELDS"),
    ("DATA binary\n", "", "line 11"),
    ("DATA binary", "DATA zip", "DATA 'zip'"),
    ("DATA binary", "DATA binary_compressed", "pcl_convert_pcd_ascii_binary in.pcd out.pcd 1"),
    ("POINTS 5", "POINTS 6", "6 points in 5 x 1"),
    ("POINTS 5", "POINTS five", "malformed header"),
    ("POINTS 5", "POINTS", "malformed header"),
    ("POINTS 5\n", "", None),
    ("WIDTH 5\n", "", None),
    ("WIDTH 5\n", "WEITE 5\n", "line 7 is 'WEITE 5'"),
    ("rgb x _ y z", "rgb x _ y w", "fields rgb x _ y w"),
    ("rgb x _ y z", "z x _ y z", "once each"),
    ("COUNT 1 1 3 1 1", "COUNT 1 3 1 1 1", "once each"),
    ("SIZE 4 4 1 8 4", "SIZE 4 4 1 8", "types"),
    ("SIZE 4 4 1 8 4", "SIZE 4 4 1 8 3", "types"),
    ("SIZE 4 4 1 8 4", "SIZE 4 4 1 8 1", "types"),
    ("TYPE U F U F F", "TYPE U F U F X", "types"),
    ("WIDTH 5\nHEIGHT 1\n", "WIDTH -5\nHEIGHT -1\n", "do not agree"),
)
def test_pcd_headers_are_checked(tmp_path, old, new, message):
    content = make_pcd(CLOUD, "binary")
    assert old.encode() in content
    path = write(tmp_path, "cloud.pcd", content.replace(old.encode(), new.encode()))
    if message is None:
        assert (read_points(path) == CLOUD).all()
    else:
        assert message in check_refused(path)


@pytest.mark.parametrize("form", ["binary", "ascii"])
def test_ply_is_read(tmp_path, form):
    assert (read_points(write(tmp_path, "cloud.ply", make_ply(CLOUD, form))) == CLOUD).all()


def test_vertices_of_a_ply_mesh_are_read(tmp_path):
    mesh = trimesh.creation.icosphere(1)
    points = read_points(write(tmp_path, "ball.ply", mesh.export(file_type="ply")))
    assert np.allclose(points, mesh.vertices, atol=1e-6)


def make_npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


STRIPS = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element tristrips 1
property list int int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
1 1 1
4 0 1 2 3
"""

CLOUD_TEXT = "\n".join(" ".join(map(str, row)) for row in CLOUD.tolist())


@pytest.mark.parametrize("name", ["cloud.xyz", "cloud.txt", "cloud.csv", "CLOUD.XYZ"])
@pytest.mark.parametrize(
    "text",
    [
        CLOUD_TEXT,
        "# x y z\n\n" + CLOUD_TEXT + "\n\n",
        CLOUD_TEXT.replace(" ", ", "),
        CLOUD_TEXT.replace(" ", ","),
        CLOUD_TEXT.replace(" ", "\t"),
        CLOUD_TEXT.replace("\n", "\r\n") + "\r\n",
        CLOUD_TEXT.replace("\n", " 0.5 255 # noise\n") + " 1 2",
        "  " + CLOUD_TEXT.replace("\n", "\n   "),
    ],
)
def test_text_is_read_with_any_separator(tmp_path, name, text):
    assert (read_points(write(tmp_path, name, text)) == CLOUD).all()


@refusals(
    "text, message",
    (CLOUD_TEXT + "\n1 2", "line 6 is '1 2'; it must hold 3 columns"),
    (CLOUD_TEXT + "\n\n1 2 3 4", "line 7 is '1 2 3 4'; it must hold 3 columns"),
    ("x y z\n" + CLOUD_TEXT, "line 1 is 'x y z'; it must hold only numbers"),
    ("# head\n1 2 3\n1 2 abc", "line 3 is '1 2 abc'; it must hold only numbers"),
    ("1,2,3\n4 5 6", "line 2 is '4 5 6'"),
    ("1,2,3\n4,,6", "line 2 is '4,,6'"),
    ("1;2;3", "line 1 is '1;2;3'"),
    ("1 2\n3 4", "has 2 columns"),
    (CLOUD_TEXT.encode() + b"\xff", "not text"),
    ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float a\nend_header\n1\n", "x, y and z"),
    (STRIPS.replace("vertex 4", "vertex " + "9" * 5000), "no whole PLY header"),
)
def test_malformed_text_is_refused(tmp_path, text, message):
    assert message in check_refused(
        write(tmp_path, "cloud.ply" if text[:3] == "ply" else "cloud.xyz", text)
    )


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int16])
def test_npy_is_read_in_any_type_and_order(tmp_path, dtype):
    array = np.round(CLOUD).astype(dtype)
    np.save(tmp_path / "cloud.npy", np.asfortranarray(array))
    assert (read_points(tmp_path / "cloud.npy") == array).all()


@pytest.mark.parametrize(
    "array",
    [
        np.zeros(3),
        np.zeros((4, 2)),
        np.zeros((4, 4)),
        np.zeros((4, 3), bool),
        np.zeros((4, 3), complex),
    ],
)
def test_npy_of_another_shape_or_type_is_refused(tmp_path, array):
    np.save(tmp_path / "cloud.npy", array)
    assert "shape (n, 3)" in check_refused(tmp_path / "cloud.npy")


def empty_and_broken(points):
    """Yield the same cloud in every format."""
    rows = "\n".join(" ".join(map(str, row)) for row in points.tolist())
    plain = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    plain += "property float x\nproperty float y\nproperty float z\nend_header\n" + rows
    yield "cloud.xyz", "# cloud\n" + rows
    yield "cloud.ply", plain + "\n"
    for encoding in ENCODINGS:
        yield "cloud.pcd", make_pcd(points, encoding)


@pytest.mark.parametrize(("name", "content"), list(empty_and_broken(np.zeros((0, 3)))))
def test_empty_clouds_are_refused(tmp_path, name, content):
    assert "no point" in check_refused(write(tmp_path, name, content), GeometryError)


@pytest.mark.parametrize(
    ("name", "content"),
    list(empty_and_broken(np.array([[1, 2, 3], [np.nan] * 3, [1, np.inf, 2], [4, 5, 6]]))),
)
def test_points_that_are_not_finite_are_counted_and_refused(tmp_path, name, content):
    message = check_refused(write(tmp_path, name, content), GeometryError)
    assert "2 points of 4" in message
    assert "np.isfinite(points).all(axis=1)" in message


def test_other_names_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"'\.las'.*\.npy, \.xyz, \.txt, \.csv, \.ply, \.pcd"):
        read_points(tmp_path / "cloud.las")
    with pytest.raises(InputError, match="must be a file name"):
        read_points(3)
    for name in ("a.npy", "a.xyz", "a.ply", "a.pcd"):
        assert "does not exist" in check_refused(tmp_path / name)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("count", ["999999999999", "600000000", "1" + "0" * 30])
@pytest.mark.parametrize("number", [5, 0])
def test_pcd_with_absurd_counts_is_refused(tmp_path, encoding, count, number):
    content = make_pcd(CLOUD[:number], encoding).replace(
        b"COUNT 1 1 3 1 1", f"COUNT {count} 1 3 1 1".encode()
    )
    assert "malformed header" in check_refused(write(tmp_path, "cloud.pcd", content))


def make_npy_header(shape, kind="<f8", version=1):
    stream = io.BytesIO()
    writer = {1: np.lib.format.write_array_header_1_0, 2: np.lib.format.write_array_header_2_0}[
        version
    ]
    writer(stream, {"shape": shape, "fortran_order": False, "descr": kind})
    return stream.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        *[
            make_npy_header(shape, version=version) + bytes(100)
            for version in (1, 2)
            for shape in [(2**70, 3), (2**62, 3), (10**12, 3), (5, 3), (-1, 3), (0, 2**70)]
        ],
        b"",
        b"\x93NUMPY garbage",
        b"PK\x03\x04" + bytes(50),
        b"\x93NUMPY\x03\x00" + bytes(100),
        b"\x93NUMPY\x09\x00" + bytes(100),
        make_npy_header((4, 3)).replace(b"<f8", b"<q9") + bytes(96),
        make_npy_header((4, 3)).replace(b"(4, 3)", b"(4, 3 ") + bytes(96),
        make_npy_header((4, 3)).replace(b"(4, 3)", b"4, 3, ") + bytes(96),
        make_npy_header((4, 3)).replace(b"(4, 3)", b"((((((") + bytes(96),
        make_npy_header((4, 3)).replace(b"'<f8'", b"'|O' ") + bytes(96),
    ],
)
def test_npy_of_another_format_or_size_is_refused(tmp_path, content):
    path = write(tmp_path, "cloud.npy", content)
    message = check_refused(path)
    assert message.count("cannot be read") == 1
    assert "write it with numpy.save" in message
    with pytest.raises(FileError, match="cannot be read"):
        Workspace.open(path, spacing=0.1)


@given(st.integers(0, 127), st.integers(0, 255))
def test_damaged_npy_headers_are_refused(tmp_path_factory, at, byte):
    content = bytearray(make_npy_header((4, 3)) + np.arange(12.0).tobytes())
    content[at] = byte
    path = write(tmp_path_factory.mktemp("npy"), "cloud.npy", bytes(content))
    with contextlib.suppress(FileError, GeometryError):
        assert read_points(path).shape[1] == 3


def test_ply_surfaces_other_than_faces_are_refused(tmp_path):
    path = write(tmp_path, "strips.ply", STRIPS)
    assert "elements tristrips" in check_refused(path, GeometryError)
    with pytest.raises(GeometryError, match="elements tristrips with lists, which may be surfaces"):
        Workspace.open(path, spacing=0.1)


@pytest.mark.parametrize(
    "text",
    [
        STRIPS.replace("tristrips 1", "tristrips 0").replace("4 0 1 2 3\n", ""),
        STRIPS.replace("tristrips", "range_grid"),
        STRIPS.replace("tristrips 1\nproperty list int int", "camera 1\nproperty float").replace(
            "4 0 1 2 3", "7"
        ),
    ],
)
def test_other_elements_of_a_ply_are_skipped(tmp_path, text):
    path = write(tmp_path, "scan.ply", text)
    assert read_points(path).shape == (4, 3)
    assert Workspace.open(path, spacing=0.5).source == str(path)
