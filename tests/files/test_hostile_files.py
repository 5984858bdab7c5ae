"""Damaged and malicious files, refused quickly."""

import json
import os
import re
import shutil
import struct
import subprocess
import sys
import tracemalloc
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

import cspace
from cspace import FileError, InputError, Workspace
from cspace.arms import Arm
from cspace.errors import CspaceError
from cspace.files.access import ContentError
from cspace.files.plain import parse_xml, read_yaml
from cspace.files.polygons import MAX_FANS
from cspace.limits import raised_limits
from cspace.shapes import Mesh
from tests.helpers.refusals import refusals
from tests.soak import files as soak


@pytest.fixture(scope="module")
def families(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    files: dict[str, Path] = soak.write_families(tmp_path_factory.mktemp("families"))
    return files


def test_every_family_opens_and_its_mutants_open_or_are_refused(families: dict[str, Path]) -> None:
    outcomes: Counter[str] = Counter()
    for name, path in families.items():
        assert soak.attempt(path) == "opened", name
        outcomes += soak.count_outcomes(7, families, name, 0, 12)
    assert set(outcomes) == {"opened", "refused"}


WITHOUT_END = {"box.obj", "points.csv", "points.xyz", "voxels.3dmap", "robot.yaml", "map.yaml"}
"""Families whose format does not mark the end of a file, so that truncation between lines is
undetectable."""

TRAILERS = {"image.png": 30, "image.bmp": 6}
"""Number of trailing bytes without values, such as checksums; at most two in other files."""


def test_cut_files_are_refused_if_their_format_says_where_they_end(
    families: dict[str, Path],
) -> None:
    for name, path in families.items():
        if path.is_dir() or name in WITHOUT_END:
            continue
        content = path.read_bytes()
        for length in np.linspace(0, len(content) - TRAILERS.get(name, 3), 25).astype(int).tolist():
            path.write_bytes(content[:length])
            assert soak.attempt(path) == "refused", (name, length)
        path.write_bytes(content)


def check_refused(path: Path, message: str, **options: Any) -> None:
    """Fail unless a file is refused in one line."""
    with pytest.raises(CspaceError, match=message) as caught:
        Workspace.open(path, **options)
    assert "\n" not in str(caught.value)


def write_ros_map(tmp_path: Path, **changes: str) -> Path:
    Image.fromarray(np.zeros((2, 3), np.uint8)).save(tmp_path / "map.png")
    keys = {"image": "map.png", "resolution": "0.05", "origin": "[0, 0, 0]", "negate": "0"}
    keys |= {"occupied_thresh": "0.65", "free_thresh": "0.2"} | changes
    (tmp_path / "map.yaml").write_text("".join(f"{key}: {value}\n" for key, value in keys.items()))
    return tmp_path / "map.yaml"


# ---- YAML and nesting ----------------------------------------------------------------------------


@refusals(
    "changes, message",
    *[
        ({"negate": f"!!{tag} foo"}, "tag in line 4")
        for tag in ("bool", "int", "float", "timestamp", "python/name:os")
    ],
    ({"negate": "! 0"}, "tag in line 4"),
    ({"resolution": "9" * 400}, "resolution is inf"),
    ({"resolution": "[" * 65}, "more than 64 levels"),
    ({"resolution": "{a: " * 65}, "more than 64 levels"),
    # PyYAML may have a limit of its own for those.
    ({"resolution": "[" * 9_000}, "more than 64 levels|a ROS map must be YAML"),
    ({"resolution": "{a: " * 9_000}, "more than 64 levels|a ROS map must be YAML"),
    ({"resolution": "&x 0.05\nbeside: *x"}, "anchor"),
    ({"1": "2"}, "key '1'"),
    ({"? [a]": "2"}, r"key \"\['a'\]\""),
    ({"negate": "0\nnegate: 1"}, "is repeated"),
    ({"image": '"a\\0b"'}, "image is"),
    ({"origin": "[.nan, 0, 0]"}, "origin"),
    ({"resolution": "yes"}, "resolution is True"),
)
def test_yaml_holds_plain_values(tmp_path: Path, changes: dict[str, str], message: str) -> None:
    check_refused(write_ros_map(tmp_path, **changes), message)


# YAML escapes characters beyond these otherwise, and a key of it has at most 1,024 characters,
# escapes included.
YAML_TEXT = st.text(st.characters(max_codepoint=0xD7FF), max_size=100)
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(10**17), 10**17)
    | st.floats(allow_nan=False, allow_infinity=False)
    | YAML_TEXT
)
DOCUMENTS = st.recursive(
    SCALARS, lambda item: st.lists(item) | st.dictionaries(YAML_TEXT, item), max_leaves=9
)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(document=DOCUMENTS)
def test_read_yaml_agrees_with_the_json_parser(tmp_path: Path, document: object) -> None:
    (tmp_path / "a.yaml").write_text(json.dumps(document), encoding="utf-8")
    assert read_yaml(tmp_path / "a.yaml", "file") == document


YAML_WORDS = [
    ("", None),
    ("~", None),
    ("Null", None),
    ("yes", True),
    ("OFF", False),
    ("oN", "oN"),
    ("-017", "-017"),
    ("+17", 17),
    ("9" * 18, 10**18 - 1),
    ("1" + "0" * 18, 1e18),
    ("1_000", "1_000"),
    ("0x10", "0x10"),
    ("1:30", "1:30"),
    ("5.", 5.0),
    ("-.5e-1", -0.05),
    ("1e3", 1000.0),
    ("-.INF", -np.inf),
    (".inf.", ".inf."),
    ("1\u0663", "1\u0663"),
    ("2026-11-24", "2026-11-24"),
    ("<<", "<<"),
    ("=", "="),
    ("one\n  two", "one two"),
    ("'1'", "1"),
    ('"yes"', "yes"),
    ("|\n  1\n  2", "1\n2\n"),
    ("1  # one", 1),
    ("\n- 1\n- - 2\n  -", [1, [2, None]]),
    ("{b, c: [], d: {}}", {"b": None, "c": [], "d": {}}),
    ("\n  ? b\n  : c", {"b": "c"}),
]


@pytest.mark.parametrize(("text", "value"), YAML_WORDS)
def test_yaml_words_are_plain_values(tmp_path: Path, text: str, value: object) -> None:
    (tmp_path / "a.yaml").write_text(f"a: {text}\n", encoding="utf-8")
    read = read_yaml(tmp_path / "a.yaml", "file")
    assert read == {"a": value}
    assert type(read["a"]) is type(value)


def test_yaml_has_one_document_or_none(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("# nothing\n")
    assert read_yaml(tmp_path / "a.yaml", "file") is None
    (tmp_path / "a.yaml").write_text("a: .nan\n")
    assert np.isnan(read_yaml(tmp_path / "a.yaml", "file")["a"])
    (tmp_path / "a.yaml").write_text("--- 1\n--- 2\n")
    with pytest.raises(FileError, match="holds 2 documents"):
        read_yaml(tmp_path / "a.yaml", "file")


def test_xml_is_refused_by_its_entities_and_its_depth() -> None:
    for text, message in (
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "declares an XML entity"),
        (
            '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><a>&b;</a>',
            "declares an XML entity",
        ),
        ("<a>" * 257 + "</a>" * 257, "more than 256 nested elements"),
        ("<a>", "is not XML"),
    ):
        with pytest.raises(ContentError, match=message):
            parse_xml(text.encode())
    assert len(list(parse_xml(("<a>" * 256 + "</a>" * 256).encode()).iter())) == 256


def test_yaml_that_is_plain_is_read(tmp_path: Path) -> None:
    path = write_ros_map(
        tmp_path, resolution="5e-2", origin='[1, -2., "0"]', negate="no", mode="'trinary'  # quoted"
    )
    assert Workspace.open(path).grid == cspace.Grid((1.0, -2.0), 0.05, (3, 2))


@pytest.mark.parametrize("levels", [65, 5_000, 200_000])
@pytest.mark.parametrize(
    ("name", "opening", "middle", "closing"),
    [
        ("a.wkt", "GEOMETRYCOLLECTION (", "POINT (1 2)", ")"),
        ("a.wkt", "POLYGON (" + "(", "", ")"),
        (
            "a.geojson",
            '{"type": "GeometryCollection", "geometries": [',
            '{"type": "Point", "coordinates": [1, 2]}',
            "]}",
        ),
        ("a.geojson", "[", "", "]"),
        ("a.json", '{"a": ', "1", "}"),
    ],
)
def test_deep_nesting_is_refused_before_recursion(
    tmp_path: Path, name: str, opening: str, middle: str, closing: str, levels: int
) -> None:
    (tmp_path / name).write_text(opening * levels + middle + closing * levels)
    check_refused(tmp_path / name, "nested brackets", spacing=0.1)


# ---- sizes ---------------------------------------------------------------------------------------


def make_chain(depths: int) -> bytes:
    return struct.pack("<fB", 0.0, 1) * depths


@refusals(
    "name, write, message",
    ("a.obj", lambda path: os.truncate(path, 2**36), "68.7 GB; at most 4.29 GB"),
    ("a.stl", lambda path: os.truncate(path, 2**36), "at most"),
    ("a.xyz", lambda path: os.truncate(path, 2**36), "at most"),
    ("a.bt", lambda path: os.truncate(path, 2**36), "at most"),
    ("a.png", lambda path: os.truncate(path, 2**36), "at most"),
    (
        "a.3dmap",
        lambda path: path.write_text("voxel 9999 9999 9999\n"),
        "9.997e.11 in all; at most 5.369e.08",
    ),
    (
        "a.map",
        lambda path: path.write_text("type octile\nheight 99999\nwidth 99999\nmap\n.\n"),
        "99999",
    ),
    (
        "a.bt",  # two leaves at opposite corners
        lambda path: path.write_bytes(
            b"# Octomap OcTree binary file\nid OcTree\nsize 33\nres 0.1\ndata\n"
            + (b"\x03\xc0" + b"\x03\0" * 14 + b"\2\0" + b"\0\xc0" * 14 + b"\0\x80")
        ),
        "65536 x 65536 x 65536 cells",
    ),
    (
        "a.ply",
        lambda path: path.write_bytes(
            b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\n" * 1
            + b"property float x\nproperty float y\nproperty float z\nend_header\n"
        ),
        "malformed or truncated",
    ),
    (
        "a.npy",
        lambda path: path.write_bytes(
            b"\x93NUMPY\1\0v\0"
            + b"{'descr': '<f8', 'fortran_order': False, 'shape': (9999999999, 3)}".ljust(117)
            + b"\n"
        ),
        "cannot be read",
    ),
    (
        "a.pcd",
        lambda path: path.write_text(
            "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 999999999\nHEIGHT 1\nDATA binary\n"
            + "a" * 64
        ),
        "malformed or truncated",
    ),
)
def test_oversized_declarations_are_refused_with_figures(
    tmp_path: Path, name: str, write: Callable[[Path], Any], message: str
) -> None:
    path = tmp_path / name
    path.touch()
    write(path)
    check_refused(path, message, **({} if name.endswith("bt") else {"spacing": 0.1}))


def open_as_scene(path: Path) -> Workspace:
    return Workspace.from_moveit_scene(path, 0.1, bounds=(0, 0, 0, 1, 1, 1))


def open_as_srdf(path: Path) -> Arm:
    urdf = path.with_suffix(".urdf")
    urdf.write_text('<robot name="a"><link name="b"/></robot>')
    return Arm.from_urdf(urdf, path)


def open_with_spacing(path: Path) -> Workspace:
    return Workspace.open(path, spacing=0.1)


@pytest.mark.parametrize(
    ("name", "limit", "read"),
    [
        ("a.yaml", "max_description_bytes", Workspace.open),
        ("a.yaml", "max_description_bytes", open_as_scene),
        ("a.urdf", "max_description_bytes", cspace.Robot.from_urdf),
        ("a.srdf", "max_description_bytes", open_as_srdf),
        ("a.geojson", "max_text_bytes", open_with_spacing),
        ("a.wkt", "max_text_bytes", open_with_spacing),
        ("a.dae", "max_text_bytes", open_with_spacing),
        ("a.gltf", "max_text_bytes", open_with_spacing),
    ],
)
def test_text_that_is_parsed_whole_is_refused_by_its_size(
    tmp_path: Path, name: str, limit: str, read: Callable[[Path], object]
) -> None:
    size, figures = {
        "max_description_bytes": (15_000_000, "15 MB; at most 4.19 MB"),
        "max_text_bytes": (80_000_000, "80 MB; at most 67.1 MB"),
    }[limit]
    path = tmp_path / name
    path.touch()
    os.truncate(path, size)
    with pytest.raises(FileError, match=f"{figures} .*{limit}={size}") as caught:
        read(path)
    assert str(path) in str(caught.value)


def test_limits_of_text_can_be_changed(tmp_path: Path, families: dict[str, Path]) -> None:
    path = write_ros_map(tmp_path)
    size = path.stat().st_size
    with raised_limits(max_description_bytes=size - 1):
        check_refused(path, f"max_description_bytes={size}")
    with raised_limits(max_description_bytes=size, max_text_bytes=0):
        assert Workspace.open(path).grid.size == 6
    with raised_limits(max_bytes=size - 1):
        check_refused(path, f"max_bytes={size}")
    with raised_limits(max_text_bytes=9):
        check_refused(families["box.glb"], "has a header of", spacing=0.1)


def test_clouds_and_maps_of_letters_keep_to_the_limit_of_all_files(tmp_path: Path) -> None:
    (tmp_path / "a.3dmap").write_text("voxel 9 9 9\n")
    (tmp_path / "a.xyz").write_text("0 0 0\n1 1 1\n")
    with raised_limits(max_text_bytes=1, max_description_bytes=1):
        assert Workspace.open(tmp_path / "a.3dmap").grid.size == 729
        assert Workspace.open(tmp_path / "a.xyz", spacing=0.5, radius=0.1).grid.size


def test_a_picture_of_too_many_pixels_is_refused_before_it_is_read(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((1, 1), np.uint8)).save(tmp_path / "a.png")
    content = bytearray((tmp_path / "a.png").read_bytes())
    content[16:24] = struct.pack(">II", 40_000, 40_000)
    import zlib

    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "a.png").write_bytes(content)
    check_refused(tmp_path / "a.png", r"40000 x 40000 cells, 1.6e\+09 in all", spacing=0.1)


def test_limits_can_be_lowered_and_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.3dmap").write_text("voxel 9 9 9\n")
    with raised_limits(max_cells=100):
        check_refused(tmp_path / "a.3dmap", r"raised_limits\(max_cells=729\)")
        with raised_limits(max_cells=729):
            assert Workspace.open(tmp_path / "a.3dmap").grid.size == 729
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: 500)
    (tmp_path / "a.3dmap").write_text("voxel 99 99 99\n")
    check_refused(
        tmp_path / "a.3dmap", "needs about 970 kB of memory; at most 475 bytes may be used"
    )


@refusals(
    "name, content, message",
    ("a.wkt", f"MULTIPOINT({','.join(['1 1'] * 1000)})", "holds 1,000 points"),
    (
        "a.geojson",
        json.dumps({"type": "MultiPoint", "coordinates": [[1, 1]] * 1000}),
        "holds 1,001 lists",
    ),
)
def test_points_are_limited_by_their_memory_as_objects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: str, message: str
) -> None:
    """Use points of 4 bytes of text each."""
    (tmp_path / name).write_text(content)
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: 10**6)
    check_refused(tmp_path / name, message, spacing=0.1)
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: 10**7)
    assert Workspace.open(tmp_path / name, spacing=0.1, bounds=(0, 0, 2, 2)).grid.shape == (20, 20)


@pytest.mark.parametrize("fill", [" ", "\n", "0"])
@pytest.mark.parametrize("name", ["text.stl", "shapes.wkt", "text.ply", "box.obj", "map.yaml"])
def test_long_runs_are_read_in_linear_time(families: dict[str, Path], name: str, fill: str) -> None:
    """A quadratic algorithm would take many minutes."""
    path, run = families[name], 100_000 * fill
    content = path.read_text()
    positions = [position for position, letter in enumerate(content) if letter in " \n("]
    for position in (positions[0], positions[len(positions) // 2], positions[-1]):
        path.write_text(content[:position] + run + content[position:])
        assert soak.attempt(path) in ("opened", "refused")
    path.write_text(content)


def test_blanks_before_a_bracket_are_read_in_linear_time(tmp_path: Path) -> None:
    (tmp_path / "a.wkt").write_text(f"POINT{' ' * 300_000}1")
    check_refused(tmp_path / "a.wkt", "begins with", spacing=0.1)


def test_nested_instances_are_limited(tmp_path: Path, families: dict[str, Path]) -> None:
    """Test nested nodes and scenes of repeated meshes."""
    text, shown = families["box.dae"].read_text(), '<instance_geometry url="#g"/>'

    def nodes(depth: int, each: int) -> str:
        inner = "".join(
            f"<node id='n{i}'>" + each * f"<instance_node url='#n{i + 1}'/>" + "</node>"
            for i in range(depth)
        )
        library = f"<library_nodes>{inner}<node id='n{depth}'>{shown}</node></library_nodes>"
        head, tail = text.replace(shown, '<instance_node url="#n0"/>').split(
            "<library_visual_scenes>"
        )
        return f"{head}{library}<library_visual_scenes>{tail}"

    for name, content, message in (
        ("a.dae", nodes(12, 10), "nests nodes"),
        ("a.dae", nodes(5_000, 1), "nests nodes"),
        ("b.dae", text.replace(shown, 3_000 * shown), "unfolds to"),
    ):
        (tmp_path / name).write_text(content)
        with raised_limits(max_bytes=2**21):
            check_refused(tmp_path / name, message, spacing=0.1)
    (tmp_path / "a.dae").write_text(nodes(2, 3))
    assert len(Mesh.of(tmp_path / "a.dae").faces) == 9 * 12
    for children in (False, True):
        (tmp_path / "a.glb").write_bytes(write_glb(3_000, children))
        with raised_limits(max_bytes=2**21):
            check_refused(tmp_path / "a.glb", "unfolds to", spacing=0.1)


def write_glb(number: int, children: bool) -> bytes:
    """Place one triangle many times."""
    nodes = [
        {"mesh": 0, **({"children": [i + 1]} if children and i + 1 < number else {})}
        for i in range(number)
    ]
    view = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0] if children else [*range(number)]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [view],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    body = (
        struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", 36, b"BIN\0")
        + bytes(36)
    )
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def test_a_face_of_many_corners_takes_linear_time(tmp_path: Path) -> None:
    turn = np.linspace(0.0, 60.0, 8_000)
    rings = [
        np.stack([(turn + wide) * np.cos(turn), (turn + wide) * np.sin(turn)], axis=1)
        for wide in (1.0, 2.0)
    ]
    lines = [f"v {x} {y} 0" for x, y in [*rings[0].tolist(), *rings[1][::-1].tolist()]]
    (tmp_path / "a.obj").write_text(
        "\n".join([*lines, "f " + " ".join(map(str, range(1, len(lines) + 1)))])
    )
    check_refused(tmp_path / "a.obj", "bends or crosses itself", spacing=0.1)


SQUARE = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]


def write_polygon(path: Path, vertices: list[str], corners: list[int]) -> Path:
    """Write a file of one face."""
    face, count = " ".join(map(str, corners)), len(vertices)
    head = "".join(f"property float {axis}\n" for axis in "xyz")
    ply = f"ply\nformat ascii 1.0\nelement vertex {count}\n{head}element face 1\n"
    texts = {
        ".obj": [
            *(f"v {vertex}" for vertex in vertices),
            "f " + " ".join(str(corner + 1) for corner in corners),
        ],
        ".ply": [
            f"{ply}property list int int vertex_indices\nend_header",
            *vertices,
            f"{len(corners)} {face}",
        ],
    }
    path.write_text("\n".join(texts[path.suffix]) + "\n")
    return path


@pytest.mark.parametrize("name", ["a.obj", "a.ply"])
def test_a_face_of_coincident_corners_takes_linear_memory(tmp_path: Path, name: str) -> None:
    count = 5_000  # of which the square is 200 MB
    path = write_polygon(tmp_path / name, ["0 0 0"] * count, [*range(count)])
    Mesh.of(path, "surface")
    tracemalloc.start()
    mesh = Mesh.of(path, "surface")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(mesh.faces) == count - 2
    assert peak < 20_000_000


@pytest.mark.parametrize("name", ["a.obj", "a.ply"])
@pytest.mark.parametrize(
    "corners", [[0] * 60_000, [0, 1, 2, 3] * 15_000], ids=["one corner", "many rounds"]
)
def test_a_face_that_repeats_few_vertices_is_refused(
    tmp_path: Path, name: str, corners: list[int]
) -> None:
    check_refused(write_polygon(tmp_path / name, SQUARE, corners), "repeat only", spacing=0.1)


def test_fans_of_a_file_take_linear_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vertices = [*SQUARE * 400, *SQUARE[::-1] * 200]
    write_polygon(tmp_path / "a.obj", vertices, [*range(len(vertices))])
    visited: list[int] = []
    cross = np.cross
    monkeypatch.setattr(np, "cross", lambda a, b: visited.append(a.size) or cross(a, b))
    check_refused(tmp_path / "a.obj", "none of the tried corners sees it whole", spacing=0.1)
    assert len(visited) <= MAX_FANS + 1


def test_a_mesh_too_small_for_floats_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1e-310 0 0\nv 0 1e-310 0\nf 1 3 2\n")
    check_refused(tmp_path / "a.obj", "reach 1e-310; they must reach 1e-100", spacing=0.1)
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    made, exact = (
        Workspace.from_mesh(([[0, 0, 0], [1, tiny, 0], [0, 1, tiny], [tiny, 0, 1]], faces), 0.1)
        for tiny in (1e-310, 0.0)
    )
    np.testing.assert_array_equal(made.outer, exact.outer)


def test_an_octomap_without_its_data_line_is_refused_quickly(tmp_path: Path) -> None:
    (tmp_path / "a.ot").write_bytes(
        b"# Octomap OcTree file\nid OcTree\nsize 9\nres 0.1\nadta\n" + b"\n" * 5_000_000
    )
    check_refused(tmp_path / "a.ot", "no line 'data'")
    (tmp_path / "a.pcd").write_bytes(b"VERSION .7\n" + b"\n" * 5_000_000)
    check_refused(tmp_path / "a.pcd", "header", spacing=0.1)


# ---- what starts, follows or loads something -----------------------------------------------------


@pytest.mark.parametrize(
    "content", [b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", b"GIF89a", b"\0\0\0\x0cjP  "]
)
def test_images_are_recognised_by_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes
) -> None:
    monkeypatch.setattr("subprocess.Popen", None)
    (tmp_path / "a.png").write_bytes(content + bytes(99))
    check_refused(tmp_path / "a.png", "cannot be read as an image", spacing=0.1)


def test_a_link_out_of_the_folder_warns(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    path = write_ros_map(tmp_path / "inner")
    (tmp_path / "inner" / "map.png").rename(tmp_path / "map.png")
    (tmp_path / "inner" / "map.png").symlink_to(tmp_path / "map.png")
    with pytest.warns(UserWarning, match="lies outside the folder"):
        Workspace.open(path)


@pytest.mark.parametrize("uri", ["../secret.bin", "/etc/passwd", "%2e%2e/secret.bin"])
def test_gltf_reads_no_file_outside_its_folder(tmp_path: Path, uri: str) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(36))
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": uri}],
    }
    (tmp_path / "inner" / "a.gltf").write_text(json.dumps(header))
    check_refused(tmp_path / "inner" / "a.gltf", "outside its folder", spacing=0.1)


def test_codecs_are_never_imported_by_name(tmp_path: Path, families: dict[str, Path]) -> None:
    """Otherwise a file could choose which installed package runs."""
    path = tmp_path / "forged.zarr"
    shutil.copytree(families["forged.zarr"], path)
    described = json.loads((path / "cell_states" / "zarr.json").read_text())
    described["codecs"].append({"name": "of_a_plug_in"})
    soak.forge_store(
        path, soak.read_parts(path), "cell_states/zarr.json", json.dumps(described).encode()
    )
    with pytest.raises(FileError, match=r"of_a_plug_in"):
        cspace.open(path)


@pytest.mark.parametrize("kind", ["folder", "pipe"])
def test_folders_and_pipes_are_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.obj"
    path.mkdir() if kind == "folder" else os.mkfifo(path)
    with pytest.raises(FileError, match="plain file"):
        Workspace.open(path, spacing=0.1)


AUDITED = """
import sys, warnings
from pathlib import Path
from tests.soak import files as soak

names = sorted(Path(sys.argv[1]).iterdir())
assert all(soak.attempt(name) == "opened" for name in names)  # what is imported and compiled is so now
seen = []

def audit(event, arguments):
    starts = event.startswith(("socket.", "subprocess.", "os.exec", "os.fork", "os.posix_spawn", "os.system", "import"))
    changes = event in ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate")
    writes = event == "open" and (set(arguments[1] or "") & set("wax+") or (arguments[2] or 0) & 0o103)
    if starts or changes or writes:
        seen.append((event, str(arguments)[:100]))

sys.addaudithook(audit)
for name in names:
    soak.attempt(name)
print(sorted(set(seen)))
"""


def test_opening_starts_no_process_and_writes_sends_and_imports_nothing(
    families: dict[str, Path],
) -> None:
    folder = next(iter(families.values())).parent
    code = [sys.executable, "-c", AUDITED, str(folder)]
    done = subprocess.run(code, capture_output=True, text=True, check=True, timeout=300)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", ["box.dae", "robot.urdf"])
@pytest.mark.parametrize("levels", [300, 100_000])
def test_deeply_nested_elements_are_refused(
    families: dict[str, Path], tmp_path: Path, name: str, levels: int
) -> None:
    head, end = re.match(r"(<\w+[^>]*>)(.*)", families[name].read_text(), re.DOTALL).groups()  # type: ignore[union-attr]
    (tmp_path / name).write_text(f"{head}{'<extra>' * levels}{'</extra>' * levels}{end}")
    with pytest.raises(FileError, match="more than 256 nested elements"):
        Mesh.of(tmp_path / name) if name == "box.dae" else cspace.Robot.from_urdf(tmp_path / name)


def test_arrays_in_memory_keep_to_the_limit_of_cells(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((20, 20), dtype=bool))
    with raised_limits(max_cells=399):
        check_refused(tmp_path / "a.npy", "20 x 20 cells, 400 in all; at most 399", spacing=0.1)
        assert Workspace.open(tmp_path / "a.npy", spacing=0.1, lazy=True).grid.size == 400


def test_a_link_out_of_the_folder_of_a_gltf_is_refused(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(36))
    (tmp_path / "inner" / "a.bin").symlink_to(tmp_path / "secret.bin")
    content = write_glb(1, False)
    header = json.loads(content[20 : 20 + struct.unpack("<I", content[12:16])[0]])
    header["buffers"][0]["uri"] = "a.bin"
    (tmp_path / "inner" / "a.gltf").write_text(json.dumps(header))
    check_refused(tmp_path / "inner" / "a.gltf", "outside its folder", spacing=0.1)


def test_invalid_file_names_are_refused() -> None:
    for name in (None, 7, b"\xff"):
        with pytest.raises((InputError, FileError)):
            Workspace.open(name, spacing=0.1)  # type: ignore[arg-type]
