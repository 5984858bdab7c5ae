"""Scenes in glTF."""

import base64
import json
import struct

import numpy as np
import pytest

from tests.mesh_files import (
    BOX_CORNERS,
    BOX_MESH,
    BOX_SHIFT,
    check_boxes,
    check_refused,
    read,
)
from tests.refusals import refusals

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
            {"camera": 0, "translation": [1, 1, 1]},
        ]
        header["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]

    mesh = read(tmp_path, "nodes.glb", write_gltf(edit))
    assert len(mesh.faces) == 36
    turned = (BOX_CORNERS * [-1, 1, 3]) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [0, 0, 50]
    positions = [BOX_CORNERS, BOX_CORNERS + BOX_SHIFT + [0, 5, 0], turned]
    expected = np.concatenate(positions) * [2, 1, 1]
    assert np.allclose(
        np.unique(mesh.vertices.round(4), axis=0), np.unique(expected.round(4), axis=0)
    )
    assert mesh.volume == pytest.approx(2 * 64 * (1 + 1 + 3))


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
    (lambda h, add: h["nodes"][0].update(camera=0), "camera"),
    (
        lambda h, add: (
            h["nodes"].append({"mesh": 0}) or h["nodes"][0].update(camera=0, children=[1])
        ),
        "camera",
    ),
    (lambda h, add: h["nodes"][0].update(children=[7]), "is missing"),
    (lambda h, add: h["bufferViews"][0].update(byteOffset=-4), "exceeds"),
    (lambda h, add: add_part(h, add, 4, [0, 1, 8]), "vertex [0-9]+|out of bounds|index"),
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
    (lambda h, add: h["nodes"][0].update(rotation=[0, 0, 0, 0]), "rotation"),
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
