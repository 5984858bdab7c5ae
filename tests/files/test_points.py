"""Point clouds in every format, whole, truncated and damaged."""

import io
import struct
import warnings

import numpy as np
import pandas as pd
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from cspace import Workspace
from cspace._files.point_clouds import read_points
from cspace.errors import FileError, GeometryError, InputError, UnitWarning
from tests.helpers.refusals import refusals, write
from tests.helpers.strategies import seeds

CLOUD = np.array([[0.0, 1.5, -2.25], [3.0, 4.0, 5.0], [1e3, -0.125, 7.75], [3.0, 4.0, 5.0]])
"""A cloud that single precision holds exactly."""


def make_pcd(points, data):
    """Return a PCD file with fields of several types."""
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS rgb x _ y z\n"
        "SIZE 4 4 1 8 4\nTYPE U F U F F\nCOUNT 1 1 3 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\n"
        f"DATA {data}\n"
    )
    rows = [(7, x, 1, 2, 3, y, z) for x, y, z in points]
    if data == "ascii":
        return (header + "".join(" ".join(map(str, row)) + "\n" for row in rows)).encode()
    return header.encode() + b"".join(struct.pack("<If3Bdf", *row) for row in rows)


def make_ply(points, data):
    return trimesh.PointCloud(points).export(file_type="ply", encoding=data)


def make_npy(points, _):
    stream = io.BytesIO()
    np.save(stream, np.asfortranarray(points))
    return stream.getvalue()


def make_text(points, separator):
    lines = [separator.join(map(str, row)) for row in points.tolist()]
    return "\n".join(["# x y z", "", *lines, ""]).encode()


FORMATS = [
    *(
        (f"cloud.{suffix}", make_text, separator)
        for suffix in ("XYZ", "txt")
        for separator in " \t"
    ),
    *(("cloud.csv", make_text, separator) for separator in (",", ", ")),
    *(("cloud.ply", make_ply, data) for data in ("ascii", "binary")),
    *(("cloud.pcd", make_pcd, data) for data in ("ascii", "binary")),
    ("cloud.npy", make_npy, ""),
]


@given(form=st.sampled_from(FORMATS), count=st.integers(1, 40), seed=seeds)
def test_clouds_are_read_from_every_format(tmp_path_factory, form, count, seed):
    name, make, option = form
    points = np.random.default_rng(seed).integers(-1000, 1000, (count, 3)) / 8
    read = read_points(write(tmp_path_factory.getbasetemp(), name, make(points, option)))
    assert read.dtype == np.float64
    assert read.flags.c_contiguous
    assert (read == points).all()


def check_refused(path, message, error=FileError):
    """Fail unless a cloud is refused with its name and a message."""
    with pytest.raises(error) as caught:
        read_points(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize("form", FORMATS)
def test_points_that_are_missing_or_not_finite_are_refused_or_dropped(tmp_path, form):
    name, make, option = form
    points = np.array([[1, 2, 3], [np.nan] * 3, [1, np.inf, 2], [4, 5, 6]])
    path = write(tmp_path, name, make(points, option))
    check_refused(path, "2 points of 4", GeometryError)
    for source in (path, points):
        workspace = Workspace.from_points(source, 1.0, (0, 0, 0, 6, 6, 7), drop_missing=True)
        assert np.argwhere(workspace.inner | workspace.outer)[:1].tolist() == [[0, 1, 2]]
        assert len(workspace.shapes[0].centers) == 2
    if make is not make_ply:
        path = write(tmp_path, name, make(np.zeros((0, 3)), option))
        check_refused(path, "no point", GeometryError)


# PCD


def test_pcd_may_lack_counts_and_hold_integers(tmp_path):
    text = "VERSION .7\r\nFIELDS z y x\r\nSIZE 2 4 8\nTYPE I U F\nWIDTH 2\nHEIGHT 1\nDATA binary\n"
    body = struct.pack("<hId", -3, 2, 1.5) + struct.pack("<hId", 30, 20, 0.1)
    points = read_points(write(tmp_path, "cloud.pcd", text.encode() + body))
    assert (points == [[1.5, 2, -3], [0.1, 20, 30]]).all()


def test_truncated_pcd_is_refused(tmp_path):
    for data in ("ascii", "binary"):
        content = make_pcd(CLOUD, data)
        for length in range(0, len(content) - 1, 7):
            check_refused(write(tmp_path, "cloud.pcd", content[:length]), "")
    check_refused(tmp_path / "cloud.pcd", "holds 3 points but its header says 4")


@refusals(
    "old, new, message",
    ("DATA binary", "DATA zip", "DATA 'zip'; it must be ascii or binary"),
    ("DATA binary", "DATA binary_compressed", "only ascii and binary are read"),
    ("WIDTH 4\n", "WEITE 4\n", "line 7 is 'WEITE 4'"),
    ("TYPE U F U F F", "TYPE U F U F X", "types"),
)
def test_pcd_headers_are_checked(tmp_path, old, new, message):
    content = make_pcd(CLOUD, "binary").replace(old.encode(), new.encode())
    check_refused(write(tmp_path, "cloud.pcd", content), message)


# texts


def test_further_columns_and_comments_of_a_text_are_skipped(tmp_path):
    rows = [" ".join(map(str, row)) + " 0.5 255 # noise" for row in CLOUD]
    path = write(tmp_path, "cloud.xyz", "\r\n  ".join(rows).encode())
    assert (read_points(path) == CLOUD).all()


@refusals(
    "text, message",
    ("1 2 3\n\n1 2 3 4", "line 3 is '1 2 3 4'; it must hold 3 columns"),
    ("1 2 3\nx y z", "line 2 is 'x y z'; it must hold only numbers, with decimal points"),
    ("x_mm y_mm z_mm\n1 2 3", "3 columns under the heading x_mm y_mm z_mm"),
    (
        "x,y,z,x\n1,2,3,4",
        "4 columns under the heading x y z x; it must name every column, and x, y and z once each",
    ),
    ("x [mm],y [mm],z [mm]\n1,2,3", "3 columns under the heading x [mm] y [mm] z [mm]"),
    ("# x_cm y_cm z_cm\n1 2 3", "3 columns under the heading x_cm y_cm z_cm"),
    ("1,2,3\n4,,6", "line 2 is '4,,6'"),
    ("1 2 3 \xff", "not text"),
)
def test_malformed_text_is_refused(tmp_path, text, message):
    check_refused(write(tmp_path, "cloud.xyz", text.encode("latin-1")), message)


HEADINGS = [
    ("id,x,y,z", "0,1,2,3"),
    ("# id,x,y,z", "0,1,2,3"),
    (",x,y,z", "0,1,2,3"),
    ('"";"z";"y";"x"', "0;3;2;1"),
    ("#id x y z", "0 1 2 3"),
    ("//Z Y X Intensity", "3 2 1 9"),
    ("# made by hand\n\n# Z,X,Y", "3,1,2"),
    ('"label";"z";"y";"x"', "9 3 2 1"),
    ("X, Y, Z, R, G, B", "1, 2, 3, 7, 7, 7"),
    ("# a plain remark", "1 2 3 9"),
    ("// a plain remark\n// and another", "1 2 3"),
    ("# exported by Foo, x forward, y left, z up", "1 2 3"),
    ("z;y;x", "3;2;1"),
]


@pytest.mark.parametrize("heading, row", HEADINGS)
def test_a_heading_names_the_columns(tmp_path, heading, row):
    path = write(tmp_path, "cloud.csv", f"{heading}\n{row}\n{row}\n".encode())
    assert read_points(path).tolist() == [[1, 2, 3]] * 2


FAR = np.array([(400000.0, 5400002.2, 0.5), (400005.0, 5400003.4, 1.5)])


def write_far(folder, form, dtype):
    """Write points in a coordinate system of a country."""
    path = folder / f"far.{form}"
    points = FAR.astype(dtype)
    if form == "npy":
        np.save(path, points)
    elif form == "ply":
        path.write_bytes(trimesh.PointCloud(points).export(file_type="ply", encoding="binary"))
    elif form == "pcd":
        size = points.itemsize
        head = f"FIELDS x y z\nSIZE {size} {size} {size}\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\n"
        path.write_bytes((head + "HEIGHT 1\nPOINTS 2\nDATA binary\n").encode() + points.tobytes())
    else:
        np.savetxt(path, points, fmt="%.9g")
    return path


@pytest.mark.parametrize("form", ["npy", "pcd", "xyz", "array"])
@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_coordinates_that_round_by_more_than_a_tenth_of_a_cell_are_named(tmp_path, form, dtype):
    source = FAR.astype(dtype) if form == "array" else write_far(tmp_path, form, dtype)
    with warnings.catch_warnings(record=True, action="always") as caught:
        workspace = Workspace.from_points(source, 0.1, offset=(-400000, -5400000, 0), radius=0.02)
    assert bool(caught) == (dtype == "f4" and form != "xyz")
    for warning in caught:
        text = "32 bits, which round coordinates near 5400004 m by up to 0.25 m"
        assert text in str(warning.message)
    if dtype == "f8":
        assert workspace.grid.lower[1] == pytest.approx(2.18, abs=0.01)


def test_long_comments_come_before_the_points(tmp_path):
    text = "".join(f"# remark {number} of many\n" for number in range(5000))
    path = write(tmp_path, "cloud.xyz", f"{text}1 2 3\n4 5 6".encode())
    assert read_points(path).tolist() == [[1, 2, 3], [4, 5, 6]]


# missing points, other frames and other arrays


def test_a_far_frame_is_refused_and_its_hint_followed(tmp_path):
    far = CLOUD[:2] + np.array([500_000, 5_200_000, 0])
    path = write(tmp_path, "utm.npy", make_npy(far.astype(np.float64), ""))
    with pytest.raises(InputError, match="cells from the origin"):
        Workspace.open(path, spacing=0.5)
    offset = (-500_000, -5_200_000, 3)
    workspace = Workspace.open(path, spacing=0.5, offset=offset)
    moved = workspace.shapes[0].centers - (far + offset)
    assert np.abs(moved).max() == 0
    assert (
        Workspace.open(path, spacing=0.5, offset=offset, bounds=(0, 0, 0, 2, 2, 2)).grid.size == 64
    )


def test_a_viewpoint_and_bytes_after_the_points_warn(tmp_path):
    content = make_pcd(CLOUD, "binary")
    path = write(tmp_path, "cloud.pcd", content.replace(b"0 0 0 1 0 0 0", b"0 0 1 1 0 0 0"))
    with pytest.warns(UserWarning, match="VIEWPOINT is not applied"):
        assert (read_points(path) == CLOUD).all()
    path = write(tmp_path, "cloud.pcd", content + b"\r\n")
    with pytest.warns(UserWarning, match="2 bytes after its 4 points"):
        assert (read_points(path) == CLOUD).all()


# NumPy arrays


NPY = make_npy(CLOUD, "")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        NPY[:-1],
        NPY.replace(b"(4, 3), }" + b" " * 5, b"(2**62, 3), }"),
        NPY.replace(b"'<f8'", b"'|O' "),
    ],
)
def test_npy_of_another_format_or_size_is_refused(tmp_path, content):
    path = write(tmp_path, "cloud.npy", content)
    check_refused(path, "it must hold one array")
    with pytest.raises(FileError, match="cannot be read"):
        Workspace.open(path, spacing=0.1)


@pytest.mark.parametrize("form", ["x.pcd", "x.csv", "x.xyz", "x.ply"])
def test_a_comment_that_names_another_unit_is_warned_of(tmp_path, form):
    content = {
        "x.pcd": b"# units: mm\n" + make_pcd(CLOUD, "ascii"),
        "x.csv": b"# in millimetres\nx,y,z\n1000,2000,3000\n",
        "x.xyz": b"// [mm]\n#mm\n1000 2000 3000\n",
        "x.ply": make_ply(CLOUD, "ascii").replace(b"element", b"comment (mm)\nelement", 1),
    }[form]
    path = write(tmp_path, form, content)
    with pytest.warns(UnitWarning, match="are taken as metres"):
        read_points(path)


SIZED = {
    "a.csv": b"x,y,z,radius\n1,2,3,0.5\n5,6,7,0.5\n",
    "a.pcd": b"FIELDS x y z Radius\nSIZE 4 4 4 4\nTYPE F F F F\nPOINTS 1\nWIDTH 1\nHEIGHT 1\n"
    b"DATA ascii\n1 2 3 4\n",
    "a.ply": b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    b"property float z\nproperty float scale_0\nend_header\n0 0 0 5\n",
    "b.csv": b"x,y,z,r\n1,2,3,0.5\n",
    "c.csv": b"x,y,z,crown_diameter\n1,2,3,0.5\n",
}


@pytest.mark.parametrize("name", SIZED)
def test_sizes_of_points_that_nobody_reads_are_named(tmp_path, name):
    (tmp_path / name).write_bytes(SIZED[name])
    with pytest.warns(
        UserWarning, match=r"these fields are not read: (radius|Radius|scale_0|r|crown_diameter)$"
    ):
        read_points(tmp_path / name)


def test_a_size_in_a_table_of_points_is_named():
    table = pd.DataFrame({"y": [0.0, 2.0], "x": [0.0, 2.0], "radius": [0.5, 0.5]})
    with pytest.warns(UserWarning, match="points: these fields are not read: radius"):
        Workspace.from_points(table, 0.1)
    colours = table.rename(columns={"radius": "r"}).assign(g=1.0, b=1.0)
    with warnings.catch_warnings(action="error"):
        Workspace.from_points(colours, 0.1)


def test_faces_of_a_cloud_are_named(tmp_path):
    trimesh.creation.box().export(tmp_path / "wall.ply")
    with pytest.warns(UserWarning, match="only the points of its 12 faces are read"):
        Workspace.from_points(tmp_path / "wall.ply", 0.1)


@pytest.mark.parametrize("dtype, far", [(np.float32, 5e6), (np.float16, 1e3)])
@pytest.mark.parametrize("kind", [np.asarray, list, pd.DataFrame])
def test_coordinates_of_few_bits_are_warned_of_in_any_container(kind, dtype, far):
    points = kind(np.array([[far + 0.3, 2.0], [far, 3.0]], dtype))
    with pytest.warns(UserWarning, match=f"have {8 * np.dtype(dtype).itemsize} bits"):
        Workspace.from_points(points, 0.1, offset=(-far, 0.0))


@pytest.mark.parametrize("name", ["sphere", "triangle"])
def test_elements_of_ply_that_may_be_surfaces_are_refused(tmp_path, name):
    text = make_ply(CLOUD, "ascii").replace(
        b"end_header", f"element {name} 1\nproperty int v1\nend_header".encode()
    )
    path = write(tmp_path, "a.ply", text + b"0\n")
    with pytest.raises(GeometryError, match=f"elements {name}, which may be surfaces"):
        Workspace.open(path, spacing=0.1)
