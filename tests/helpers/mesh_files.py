"""Meshes to build, write to files and read again, and an octree."""

import base64
import json
import struct

import numpy as np
import pytest
import trimesh

from cspace import FileError, GeometryError
from cspace._files.meshes import read_mesh

BOX_CORNERS = np.array(
    [(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0), (0, 0, 4), (4, 0, 4), (4, 4, 4), (0, 4, 4)], float
)
BOX_QUADS = (
    np.array([(4, 3, 2, 1), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8)])
    - 1
)
BOX_MESH = trimesh.Trimesh(
    BOX_CORNERS, np.concatenate([BOX_QUADS[:, :3], BOX_QUADS[:, [0, 2, 3]]]), process=False
)
BOX_SHIFT = np.array([10.0, 0.0, 0.0])
TETRAHEDRON = np.eye(4, 3, -1), np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
"""Vertices and faces."""


def make_box(low, high, inward=False):
    """Return vertices and faces of an axis-aligned box."""
    box = trimesh.creation.box()
    vertices, faces = np.where(box.vertices > 0, high, low).astype(float), np.array(box.faces)
    return vertices, faces[:, ::-1] if inward else faces


def join_meshes(*parts):
    """Join meshes, each given as vertices and faces."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)]),
    )


def lines(keyword, rows, ending="\n"):
    return "".join(f"{keyword} {' '.join(map(str, row))}{ending}" for row in rows)


VERTICES = lines("v", BOX_CORNERS)
FACES = lines("f", BOX_QUADS + 1)


def read(tmp_path, name, content):
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    vertices, faces = read_mesh(file)
    return trimesh.Trimesh(vertices, faces, process=False)


def check_boxes(mesh, count=1):
    """Fail unless ``mesh`` is a row of outward boxes of side 4."""
    assert len(mesh.faces) == 12 * count
    assert mesh.volume == pytest.approx(64.0 * count)
    assert mesh.area == pytest.approx(96.0 * count)
    assert np.allclose(mesh.bounds, [[0, 0, 0], BOX_CORNERS[6] + BOX_SHIFT * (count - 1)])


def check_refused(tmp_path, name, content, message, error=(FileError, GeometryError)):
    with pytest.raises(error, match=message) as caught:
        read(tmp_path, name, content)
    assert name in str(caught.value)
    assert caught.value.rule in str(caught.value)


def write_gltf(edit=lambda header, add: None, glb=True):
    """Return a glTF file of a box, as GLB or as text with its data.

    `edit` gets its header and a function that adds an array and returns its view.
    """
    data = bytearray()
    views = []

    def add(array):
        data.extend(bytes(-len(data) % 4))
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data.extend(array.tobytes())
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
    header["buffers"] = [{"byteLength": len(data)}]
    if not glb:
        encoded = base64.b64encode(data).decode()
        header["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{encoded}"
        return json.dumps(header).encode()
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    data.extend(bytes(-len(data) % 4))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


INPUTS = (
    '<input semantic="VERTEX" source="#points" offset="0"/>'
    '<input semantic="NORMAL" source="#numbers" offset="1"/>'
)
PLACED = '<instance_geometry url="#box"/>'


def write_primitives(kind, count, *runs, sizes=""):
    """Return a COLLADA primitive; each run is a list of vertices, each beside a normal."""
    paths = [" ".join(f"{corner} 0" for corner in np.ravel(run)) for run in runs]
    lists = "".join(f"<p>{path}</p>" for path in paths)
    return f'<{kind} count="{count}">{INPUTS}{sizes}{lists}</{kind}>'


QUADS = write_primitives("polylist", 6, BOX_QUADS, sizes="<vcount>4 4 4 4 4 4</vcount>")


def make_collada(primitives=QUADS, nodes=PLACED, unit="", body=""):
    """Return a COLLADA file of a box."""
    numbers = " ".join(map(str, BOX_CORNERS.reshape(-1)))
    return f"""<?xml version="1.0"?>
    <COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
    <asset>{unit}</asset><library_geometries><geometry id="box"><mesh>
      <source id="numbers"><float_array id="array" count="24">{numbers}</float_array>
        <technique_common><accessor source="#array" count="8" stride="3">
          <param name="X"/><param name="Y"/><param name="Z"/>
        </accessor></technique_common></source>
      <vertices id="points"><input semantic="POSITION" source="#numbers"/></vertices>
      {primitives}</mesh></geometry>{body}</library_geometries>
    <library_nodes><node id="shared"><translate>0 0 1</translate>{PLACED}</node></library_nodes>
    <library_visual_scenes>
      <visual_scene id="scene"><node>{nodes}</node></visual_scene>
    </library_visual_scenes>
    <scene><instance_visual_scene url="#scene"/></scene></COLLADA>"""


PLATE = trimesh.creation.box((1.2, 0.3, 0.8))
"""A plate that lies flat where y points up."""


def write_plate(folder, form):
    """Write the plate as glTF, or as COLLADA whose axis ``form`` points up."""
    if form == "glb":
        path = folder / "plate.glb"
        PLATE.export(path)
        return path
    path = folder / "plate.dae"
    scale = "<scale>0.3 0.075 0.2</scale>" if form != "X_UP" else "<scale>0.075 0.3 0.2</scale>"
    path.write_text(make_collada(nodes=scale + PLACED, unit=f"<up_axis>{form}</up_axis>"))
    return path


def measure(mesh):
    lower, upper = mesh.bounds
    return (upper - lower).round(6).tolist()


NOTES = {
    "obj": [
        ("# File units = millimeters\n", True),
        ("# units: mm\n", True),
        ("o inches\n", False),
        ("# Units: foot\n", True),
        ("# kilometers\n", True),
        ("# unit: m\n", False),
        ("# units are metres\n", False),
        ("# unit normals\n", False),
    ],
    "ply": [("comment exported in inches\n", True), ("comment unit: metre\n", False)],
    "stl": [
        ("units=mm", True),
        ("part (mm)", True),
        ("made in min", False),
        ("within 2 mm", False),
    ],
}


def write_noted(folder, form, note):
    """Write a box of 4 m as a mesh file with a comment."""
    path = folder / f"box.{form}"
    data = BOX_MESH.export(file_type=form)
    data = data if isinstance(data, bytes) else data.encode()
    mark = note.encode()
    start = data.index(b"element") if form == "ply" else 0
    path.write_bytes(data[:start] + mark + data[start + (len(mark) if form == "stl" else 0) :])
    return path


BINARY = "# Octomap OcTree binary file\n# a comment\nid OcTree\nsize {}\nres 0.1\ndata\n"

CHAIN = b"\x03\x00" * 15 + b"\x02\x00"
"""Nodes of a binary octree with one occupied cell, at its lowest corner."""
