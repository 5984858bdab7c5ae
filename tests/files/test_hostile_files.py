"""Damaged and malicious files, refused quickly."""

import json
import os
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from cspace import FileError, Workspace, make_mesh
from cspace._files.access import ContentError
from cspace._files.plain import parse_xml, read_yaml
from cspace._support.limits import raised_limits
from cspace.errors import CspaceError
from tests.fuzz import files as fuzz
from tests.helpers.hostile import DamagedFiles
from tests.helpers.mesh_files import PLACED, lines, make_collada, write_gltf
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples


@pytest.fixture(scope="module")
def families(tmp_path_factory):
    return fuzz.write_core_families(tmp_path_factory.mktemp("families"))


def check_refused(path, message, **options):
    """Fail unless a file is refused in one line."""
    with pytest.raises(CspaceError, match=message) as caught:
        Workspace.open(path, **options)
    assert "\n" not in str(caught.value)


class TestFilesOfTheCore(DamagedFiles):
    """Damaged files of the core."""


# ---- YAML, XML and nesting -----------------------------------------------------------------------


@refusals(
    "text, message",
    ("a: !!python/name:os foo", "tag in line 1"),
    ("a: " + "[" * 65, "more than 64 levels"),
    ("1: 2", "key '1'"),
    ("a: 0\na: 1", "is repeated"),
    ("--- 1\n--- 2\n", "holds 2 documents, .*; it must hold one"),
)
def test_yaml_holds_plain_values(tmp_path, text, message):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(FileError, match=message):
        read_yaml(tmp_path / "a.yaml", "file")


def test_a_repeated_key_of_json_is_refused(tmp_path):
    (tmp_path / "a.geojson").write_text('{"type": "Point", "a": {"b": 1, "b": 2}}')
    with pytest.raises(FileError, match="has 'b' twice in one table"):
        Workspace.from_polygons(tmp_path / "a.geojson", 1.0)


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


@examples(100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(document=DOCUMENTS)
def test_read_yaml_agrees_with_the_json_parser(tmp_path, document):
    (tmp_path / "a.yaml").write_text(json.dumps(document), encoding="utf-8")
    assert read_yaml(tmp_path / "a.yaml", "file") == document


def test_yaml_words_are_plain_values(tmp_path):
    words = {
        "": None,
        "yes": True,
        "OFF": False,
        "oN": "oN",
        "-017": "-017",
        "+17": 17,
        "1_000": "1_000",
        "0x10": "0x10",
        "-.5e-1": -0.05,
        "-.INF": -np.inf,
        "1\u0663": "1\u0663",
        "2026-11-24": "2026-11-24",
        "one\n  two": "one two",
        "|\n  1\n  2": "1\n2\n",
        "\n- 1\n- - 2\n  -": [1, [2, None]],
    }
    for text, value in words.items():
        (tmp_path / "a.yaml").write_text(f"a: {text}\n", encoding="utf-8")
        read = read_yaml(tmp_path / "a.yaml", "file")
        assert read == {"a": value}
        assert type(read["a"]) is type(value)


@refusals(
    "text, message",
    ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "declares an XML entity"),
    ("<a>" * 257 + "</a>" * 257, "more than 256 nested elements"),
)
def test_xml_is_refused_by_its_entities_and_its_depth(text, message):
    with pytest.raises(ContentError, match=message):
        parse_xml(text.encode())


@pytest.mark.parametrize("levels", [65, 200_000])
@pytest.mark.parametrize(
    "name, opening",
    [("a.wkt", "GEOMETRYCOLLECTION ("), ("a.json", '{"a": '), ("a.json", "[")],
)
def test_deep_nesting_is_refused_before_recursion(tmp_path, name, opening, levels):
    (tmp_path / name).write_text(opening * levels)
    check_refused(tmp_path / name, "nested brackets", spacing=0.1)


# ---- sizes ---------------------------------------------------------------------------------------

FAR_LEAVES = b"\x03\xc0" + b"\x03\0" * 14 + b"\2\0" + b"\0\xc0" * 14 + b"\0\x80"
"""Nodes of a binary octree with two leaves at opposite corners."""


@refusals(
    "name, content, message",
    ("a.3dmap", b"voxel 9999 9999 9999\n", "9.997e.11 in all; at most 5.369e.08"),
    (
        "a.bt",
        b"# Octomap OcTree binary file\nid OcTree\nsize 33\nres 0.1\ndata\n" + FAR_LEAVES,
        "65536 x 65536 x 65536 cells",
    ),
    ("a.pcd", b"VERSION .7\n" + b"\n" * 5_000_000, "lacks FIELDS"),
)
def test_unbelievable_declarations_are_refused(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    options = {} if name == "a.bt" else {"spacing": 0.1}
    check_refused(tmp_path / name, message, **options)


@refusals(
    "name, size, message",
    ("a.obj", 2**36, "68.7 GB; at most 4.29 GB"),
    ("a.yaml", 15_000_000, "15 MB; at most 4.19 MB .*max_description_bytes=15000000"),
)
def test_large_files_are_refused_by_the_limit_of_their_kind(tmp_path, name, size, message):
    (tmp_path / name).touch()
    os.truncate(tmp_path / name, size)
    check_refused(tmp_path / name, message, **({} if name == "a.yaml" else {"spacing": 0.1}))


def test_limits_can_be_lowered_and_raised(tmp_path, monkeypatch):
    path = tmp_path / "a.3dmap"
    path.write_text("voxel 9 9 9\n")
    with raised_limits(max_cells=728):
        check_refused(
            path,
            r"call cspace.raised_limits\(max_cells=729\) if the file may be so large",
        )
        with raised_limits(max_cells=729, max_text_bytes=1, max_description_bytes=1):
            assert Workspace.open(path).grid.size == 729
    with raised_limits(max_bytes=11):
        check_refused(path, "max_bytes=12")
    monkeypatch.setattr("cspace._support.limits.free_bytes", lambda: 10**6)
    (tmp_path / "a.wkt").write_text(f"MULTIPOINT({','.join(['1 1'] * 1000)})")
    check_refused(tmp_path / "a.wkt", "holds 1,000 points", spacing=0.1)
    path.write_text("voxel 199 199 199\n")
    check_refused(path, "needs about 15.8 MB of memory; at most 950 kB may be used")


@pytest.mark.parametrize("name", ["text.stl", "shapes.wkt", "box.obj"])
def test_long_runs_are_read_in_linear_time(families, name):
    """A quadratic algorithm would take many minutes."""
    path = families[name]
    content = path.read_text()
    for fill in " 0":
        for letter in " \n":
            path.write_text(content.replace(letter, letter + 100_000 * fill, 2))
            assert fuzz.attempt(path) in ("opened", "refused")
    path.write_text(content)


def nest_nodes(depth, repeats, shown):
    """Return a COLLADA library of nodes, each of which places the next one several times."""
    nodes = [
        f"<node id='n{level}'>" + repeats * f"<instance_node url='#n{level + 1}'/>" + "</node>"
        for level in range(depth)
    ]
    return f"<library_nodes>{''.join(nodes)}<node id='n{depth}'>{shown}</node></library_nodes>"


@pytest.mark.thorough
def test_nested_and_repeated_meshes_are_limited(tmp_path):
    text, shown = make_collada(), PLACED
    scenes = "<library_visual_scenes>"
    path = tmp_path / "a.dae"
    for depth, repeats, message in ((2, 3, ""), (12, 10, "nests nodes"), (5_000, 1, "nests nodes")):
        library = nest_nodes(depth, repeats, shown)
        placed = text.replace(shown, '<instance_node url="#n0"/>')
        path.write_text(placed.replace(scenes, library + scenes))
        if message:
            check_refused(path, message, spacing=0.1)
        else:
            assert len(make_mesh(path, up="z").faces) == 9 * 12
    path.write_text(text.replace(shown, 3_000 * shown))
    nodes = [{"mesh": 0}] * 3_000
    scene = {"scenes": [{"nodes": [*range(3_000)]}], "nodes": nodes}
    (tmp_path / "a.glb").write_bytes(write_gltf(lambda header, add: header.update(scene)))
    with raised_limits(max_bytes=2**21):
        check_refused(path, "unfolds to", spacing=0.1)
        check_refused(tmp_path / "a.glb", "unfolds to", spacing=0.1)


SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def write_face(path, vertices, corners):
    """Write an OBJ file of one face."""
    path.write_text(lines("v", vertices) + lines("f", [np.add(corners, 1)]))
    return path


def test_a_face_of_many_corners_takes_linear_time_and_memory(tmp_path):
    path = tmp_path / "a.obj"
    write_face(path, SQUARE, [0, 1, 2, 3] * 15_000)
    check_refused(path, "repeat only", spacing=0.1)
    vertices = [*SQUARE * 400, *SQUARE[::-1] * 200]
    write_face(path, vertices, [*range(len(vertices))])
    check_refused(path, "none of the tried corners sees it whole", spacing=0.1)
    count = 5_000  # of which the square is 200 MB
    write_face(path, [(0, 0, 0)] * count, [*range(count)])
    make_mesh(path, "surface")
    tracemalloc.start()
    mesh = make_mesh(path, "surface")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(mesh.faces) == count - 2
    assert peak < 20_000_000


# ---- files that start or load something ----------------------------------------------------------


def test_images_are_recognised_by_content(tmp_path, monkeypatch):
    monkeypatch.setattr("subprocess.Popen", None)
    (tmp_path / "a.png").write_bytes(
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n" + bytes(99)
    )
    check_refused(tmp_path / "a.png", "cannot be read as an image", spacing=0.1)


@pytest.mark.parametrize("uri", ["/etc/passwd", "%2e%2e/secret.bin", "link.bin"])
def test_gltf_reads_no_file_outside_its_folder(tmp_path, uri):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    (inner / "link.bin").symlink_to(tmp_path / "secret.bin")
    header = json.loads(write_gltf(glb=False))
    header["buffers"][0]["uri"] = uri
    (inner / "a.gltf").write_text(json.dumps(header))
    check_refused(inner / "a.gltf", "outside its folder", spacing=0.1)
