"""Scenes in glTF and COLLADA."""

import base64
import json
import struct

import numpy as np
import pytest
import trimesh

from cspace.files.meshes import read_mesh
from tests.helpers.mesh_files import (
    BOX_CORNERS,
    BOX_MESH,
    BOX_QUADS,
    BOX_SHIFT,
    check_boxes,
    check_refused,
    read,
)
from tests.helpers.refusals import refusals

# glTF


def write_gltf(edit=lambda header, add: None, glb=True):
    """Write a glTF file of a box.

    `edit` gets its header and a function that adds an array and returns its view.
    """
    blob = bytearray()
    views = []

    def add(array, **more):
        blob.extend(bytes(-len(blob) % 4))
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes, **more})
        blob.extend(array.tobytes())
        return len(views) - 1

    corners = BOX_MESH.faces.astype("<u2").reshape(-1)
    add(BOX_CORNERS.astype("<f4"))
    add(corners)
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": len(corners), "type": "SCALAR"},
        ],
        "bufferViews": views,
    }
    edit(header, add)
    header["buffers"] = [{"byteLength": len(blob)}]
    if not glb:
        header["buffers"][0]["uri"] = (
            "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        )
        return json.dumps(header).encode()
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    blob.extend(bytes(-len(blob) % 4))
    body = (
        struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", len(blob), b"BIN\0")
        + blob
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def add_part(header, add, mode, corners, points=None):
    """Add a second primitive."""
    view = add(np.array(corners, "<u2"))
    header["accessors"].append(
        {"bufferView": view, "componentType": 5123, "count": len(corners), "type": "SCALAR"}
    )
    part = {"attributes": {"POSITION": 0}, "indices": len(header["accessors"]) - 1, "mode": mode}
    if points is not None:
        view = add(points.astype("<f4"))
        header["accessors"].append(
            {"bufferView": view, "componentType": 5126, "count": len(points), "type": "VEC3"}
        )
        part["attributes"] = {"POSITION": len(header["accessors"]) - 1}
    header["meshes"][0]["primitives"].append(part)


@pytest.mark.parametrize(("name", "glb"), [("box.glb", True), ("box.gltf", False)])
def test_a_gltf_box_is_read(tmp_path, name, glb):
    check_boxes(read(tmp_path, name, write_gltf(glb=glb)))


def substitute(header, add):
    moved = np.array([1, 2, 5, 6])
    where, values = add(moved.astype("<u2")), add((BOX_CORNERS[moved] * [2, 1, 1]).astype("<f4"))
    header["accessors"][0]["sparse"] = {
        "count": 4,
        "indices": {"bufferView": where, "componentType": 5123},
        "values": {"bufferView": values},
    }


def quantise(header, add):
    view = add((BOX_CORNERS * 31).astype("<i2"))
    header["accessors"][0].update(bufferView=view, componentType=5122, normalized=True)


def test_nodes_of_gltf_place_meshes(tmp_path):
    matrix = np.eye(4)
    matrix[:3, 3] = BOX_SHIFT

    def edit(header, add):
        half = np.sqrt(0.5)
        header["nodes"] = [
            {"children": [1, 2, 4, 5], "scale": [2, 1, 1]},
            {"mesh": 0},
            {"translation": [0, 5, 0], "children": [3]},
            {"mesh": 0, "matrix": matrix.T.reshape(-1).tolist()},
            {
                "mesh": 0,
                "translation": [0, 0, 50],
                "rotation": [0, 0, half, half],
                "scale": [-1, 1, 3],
            },
            {"camera": 0, "children": [6]},
            {"camera": 0, "mesh": 0, "translation": [20, 0, 0]},
        ]
        header["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]

    mesh = read(tmp_path, "nodes.glb", write_gltf(edit))
    assert len(mesh.faces) == 48
    turned = (BOX_CORNERS * [-1, 1, 3]) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [0, 0, 50]
    positions = [
        BOX_CORNERS,
        BOX_CORNERS + BOX_SHIFT + [0, 5, 0],
        turned,
        BOX_CORNERS + 2 * BOX_SHIFT,
    ]
    expected = np.concatenate(positions) * [2, 1, 1]
    assert np.allclose(
        np.unique(mesh.vertices.round(4), axis=0), np.unique(expected.round(4), axis=0)
    )
    assert mesh.volume == pytest.approx(2 * 64 * (1 + 1 + 3 + 1))


def grow(header, **changes):
    header.update(changes)


@refusals(
    "edit, message",
    (lambda h, add: add_part(h, add, 1, [0, 1]), "mode 1"),
    (lambda h, add: add_part(h, add, 0, [0]), "mode 0"),
    (lambda h, add: add_part(h, add, 4, [0, 1, 2, 3]), "4 corners"),
    (lambda h, add: add_part(h, add, 5, [0, 1, 3, 2]), "strips"),
    (lambda h, add: add_part(h, add, 6, [0, 1, 2, 3]), "fans"),
    (substitute, "sparse"),
    (quantise, "quantised"),
    (lambda h, add: h["nodes"][0].update(children=[7]), "is missing"),
    (lambda h, add: h["bufferViews"][0].update(byteOffset=-4), "exceeds"),
    (lambda h, add: add_part(h, add, 4, [0, 1, 8]), "vertex [0-9]+|out of bounds|index"),
    (
        lambda h, add: (
            add_part(h, add, 4, [0, 1, 8], BOX_CORNERS),
            h["meshes"][0]["primitives"].reverse(),
        ),
        "vertex 8",
    ),
    (lambda h, add: h["meshes"][0]["primitives"][0].pop("indices"), "8 corners"),
    (lambda h, add: h["meshes"][0]["primitives"][0]["attributes"].pop("POSITION"), "positions"),
    (lambda h, add: grow(h, extensionsRequired=["KHR_draco_mesh_compression"]), "KHR_draco"),
    (lambda h, add: grow(h, extensionsRequired=["EXT_meshopt_compression"]), "EXT_meshopt"),
    (
        lambda h, add: h["bufferViews"][0].update(extensions={"EXT_meshopt_compression": {}}),
        "EXT_meshopt",
    ),
    (lambda h, add: h["accessors"][0].pop("bufferView"), "without data"),
    (
        lambda h, add: h["nodes"][0].update(extensions={"EXT_mesh_gpu_instancing": {}}),
        "gpu_instancing",
    ),
    (lambda h, add: h["nodes"][0].update(skin=0), "skin"),
    (lambda h, add: h["nodes"][0].update(weights=[0.5]), "morph"),
    (lambda h, add: h["meshes"][0].update(weights=[0.0, 1.0]), "morph"),
    (lambda h, add: h["nodes"][0].update(children=[0]), "twice"),
    (lambda h, add: h["nodes"][0].update(mesh=1), "meshes"),
    (lambda h, add: h["nodes"][0].update(rotation=[0, 0, 0, 0]), "zero norm"),
    (lambda h, add: (grow(h, scenes=[{"nodes": [0]}, {}]), h.pop("scene")), "scenes"),
    (lambda h, add: (h.pop("scenes"), h.pop("scene")), "no scene"),
    (lambda h, add: h["accessors"][0].update(count=9), "exceeds"),
    (lambda h, add: h["accessors"][1].update(count=39), "exceeds"),
    (lambda h, add: h["accessors"][0].update(type="VEC2"), "VEC2"),
    (lambda h, add: h["asset"].update(version="1.0"), "1.0"),
)
def test_unsupported_features_of_gltf_are_refused(tmp_path, edit, message):
    check_refused(tmp_path, "odd.glb", write_gltf(edit), message)
    check_refused(tmp_path, "odd.gltf", write_gltf(edit, glb=False), message)


# COLLADA


def make_collada(primitives=None, nodes='<instance_geometry url="#box"/>', unit="", body=""):
    """Return a COLLADA file of a box."""
    quads = " ".join(f"{corner} 0" for corner in BOX_QUADS.reshape(-1))
    primitives = primitives or make_polylist(6, "4 " * 6, quads)
    numbers = " ".join(map(str, BOX_CORNERS.reshape(-1)))
    return f"""<?xml version="1.0"?>
    <COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>{unit}</asset>
    <library_geometries><geometry id="box"><mesh>
      <source id="numbers"><float_array id="array" count="24">{numbers}</float_array>
        <technique_common><accessor source="#array" count="8" stride="3">
          <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
        </accessor></technique_common></source>
      <vertices id="points"><input semantic="POSITION" source="#numbers"/></vertices>
      {primitives}</mesh></geometry>{body}</library_geometries>
    <library_nodes><node id="shared"><translate>0 0 1</translate><instance_geometry url="#box"/></node></library_nodes>
    <library_visual_scenes><visual_scene id="scene"><node>{nodes}</node></visual_scene></library_visual_scenes>
    <scene><instance_visual_scene url="#scene"/></scene></COLLADA>"""


INPUTS = '<input semantic="VERTEX" source="#points" offset="0"/><input semantic="NORMAL" source="#numbers" offset="1"/>'


def make_polylist(count, sizes, corners):
    return f'<polylist count="{count}">{INPUTS}<vcount>{sizes}</vcount><p>{corners}</p></polylist>'


def runs(kind, count, lists):
    paths = "".join(f"<p>{' '.join(f'{corner} 0' for corner in run)}</p>" for run in lists)
    return f'<{kind} count="{count}">{INPUTS}{paths}</{kind}>'


@pytest.mark.parametrize(
    "primitives",
    [
        None,
        runs("triangles", 12, [BOX_MESH.faces.reshape(-1)]),
        runs("polygons", 6, BOX_QUADS),
        runs("triangles", 6, [BOX_MESH.faces[:6].reshape(-1)])
        + runs("polygons", 6, BOX_MESH.faces[6:]),
        runs("lines", 1, [[0, 1]]) + runs("polygons", 6, BOX_QUADS),
    ],
)
def test_every_surface_of_collada_is_read(tmp_path, primitives):
    check_boxes(read(tmp_path, "box.dae", make_collada(primitives)))


def test_collada_indices_may_alternate_with_others(tmp_path):
    table = np.insert(np.insert(BOX_CORNERS, 1, 99, axis=1), 4, 98, axis=1).reshape(-1)
    text = (
        make_collada(runs("polygons", 6, BOX_QUADS))
        .replace('count="24"', 'count="42"')
        .replace('stride="3"', 'offset="2" stride="5"')
    )
    text = text.replace(
        " ".join(map(str, BOX_CORNERS.reshape(-1))), " ".join(map(str, [97, 97, *table]))
    )
    text = text.replace('<param name="Y"', '<param type="float"/><param name="Y"')
    check_boxes(read(tmp_path, "box.dae", text))
    swapped = INPUTS.replace('offset="0"', 'offset="2"').replace('offset="1"', 'offset="0"')
    corners = " ".join(f"0 0 {corner}" for corner in BOX_QUADS.reshape(-1))
    faces = f'<polylist count="6">{swapped}<vcount>{"4 " * 6}</vcount><p>{corners}</p></polylist>'
    check_boxes(read(tmp_path, "box.dae", make_collada(faces)))


def test_the_unit_of_collada_is_converted_to_metres(tmp_path):
    mesh = read(tmp_path, "box.dae", make_collada(unit='<unit name="centimeter" meter="0.01"/>'))
    assert np.allclose(mesh.bounds, [[0, 0, 0], [0.04, 0.04, 0.04]])


NODES = """<matrix>1 0 0 2 0 1 0 0 0 0 1 0 0 0 0 1</matrix><translate>3 0 0</translate><rotate>0 0 2 90</rotate>
<scale>-1 2 3</scale><instance_geometry url="#box"/><instance_node url="#shared"/>
<node><translate>0 0 9</translate><instance_node url="#shared"/><instance_light url="#none"/></node>"""


def test_nodes_of_collada_place_meshes(tmp_path):
    mesh = read(tmp_path, "nodes.dae", make_collada(nodes=NODES, unit='<unit meter="0.5"/>'))

    def moved(points):
        return 0.5 * (
            (points * [-1, 2, 3]) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [5, 0, 0]
        )

    expected = [moved(BOX_CORNERS + np.array([0, 0, up])) for up in (0, 1, 10)]
    assert np.allclose(mesh.vertices, np.concatenate(expected))
    assert mesh.volume == pytest.approx(3 * 64 * 6 / 8)


def test_collada_agrees_with_another_reader(tmp_path):
    pytest.importorskip("collada")
    file = tmp_path / "nodes.dae"
    file.write_text(make_collada(nodes=NODES.replace("0 0 2 90", "0 0 1 90")))
    other = trimesh.load_scene(file, process=False).to_mesh()
    vertices, faces = read_mesh(file)
    ours = np.sort(vertices[faces].reshape(-1, 9), axis=0)
    assert np.allclose(ours, np.sort(other.triangles.reshape(-1, 9), axis=0), atol=1e-5)


@refusals(
    "content, message",
    (make_collada(nodes='<instance_controller url="#skin"/>'), "instance_controller"),
    (make_collada(nodes='<instance_geometry url="other.dae#box"/>'), "another file"),
    (make_collada(nodes='<instance_geometry url="#none"/>'), "#none"),
    (make_collada(nodes='<skew>0 0 0 0 0 0 0</skew><instance_geometry url="#box"/>'), "skew"),
    (make_collada(nodes='<translate>1 2</translate><instance_geometry url="#box"/>'), "2 numbers"),
    (make_collada(nodes='<node id="a"><instance_node url="#a"/></node>'), "within itself"),
    (make_collada(unit='<unit meter="0"/>'), "unit"),
    (make_collada(body='<geometry id="box"><mesh/></geometry>'), "#box.*repeated"),
    (make_collada(body='<source id="numbers"/>'), "#numbers.*repeated"),
    (make_collada(runs("trifans", 6, BOX_QUADS)), "trifans"),
    (make_collada(runs("tristrips", 6, BOX_QUADS[:, [0, 1, 3, 2]])), "tristrips"),
    (make_collada(runs("polygons", 1, [[0, 1]])), "2 corners"),
    ('<!DOCTYPE a [<!ENTITY b "c">]>' + make_collada().partition("?>")[2].strip(), "entity"),
    ("<COLLADA>" + "<a>" * 300 + "</a>" * 300 + "</COLLADA>", "nested elements"),
    (
        make_collada(runs("triangles", 11, [BOX_MESH.faces.reshape(-1)])),
        "names 36 corners in faces with 33",
    ),
    (make_collada(runs("polygons", 7, BOX_QUADS)), "declares 7"),
    (make_collada(make_polylist(6, "4 " * 5, "0 0 " * 24)), "declares 6"),
    (make_collada(make_polylist(6, "4 " * 6, "0 0 " * 23)), "23 corners in faces with 24"),
    (make_collada(runs("triangles", 1, [[0, 1, 8]])), "vertex 8"),
    (
        make_collada(
            f'<polygons count="1">{INPUTS}<ph><p>0 0 1 0 2 0</p><h>0 0 1 0 2 0</h></ph></polygons>'
        ),
        "holes",
    ),
    (make_collada(runs("surface", 6, BOX_QUADS)), "surface"),
    (
        make_collada(
            nodes='<instance_geometry url="#curved"/>',
            body='<geometry id="curved"><spline/></geometry>',
        ),
        "spline",
    ),
    (make_collada().replace('url="#scene"', 'url="#box"'), "as its scene"),
    (make_collada().replace('<scene><instance_visual_scene url="#scene"/></scene>', ""), "scene"),
    (make_collada().replace('name="X"', 'name="S"'), "columns"),
    (make_collada().replace('count="24"', 'count="27"'), "positions"),
    (make_collada()[:-20], "truncated"),
)
def test_unsupported_features_of_collada_are_refused(tmp_path, content, message):
    check_refused(tmp_path, "odd.dae", content, message)
