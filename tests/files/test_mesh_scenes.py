"""Scenes in glTF and COLLADA."""

import numpy as np
import pytest

from tests.helpers.mesh_files import (
    BOX_CORNERS,
    BOX_MESH,
    BOX_QUADS,
    BOX_SHIFT,
    PLACED,
    QUADS,
    check_boxes,
    check_refused,
    make_collada,
    read,
    write_gltf,
    write_primitives,
)
from tests.helpers.refusals import refusals

QUARTER_TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
"""Rotation about z."""

# glTF


def add_part(header, add, mode, corners):
    """Add a second primitive."""
    accessor = {"componentType": 5123, "count": len(corners), "type": "SCALAR"}
    header["accessors"].append(accessor | {"bufferView": add(np.array(corners, "<u2"))})
    part = {"attributes": {"POSITION": 0}, "indices": len(header["accessors"]) - 1, "mode": mode}
    header["meshes"][0]["primitives"].append(part)


@pytest.mark.parametrize(("name", "glb"), [("box.glb", True), ("box.gltf", False)])
def test_a_gltf_box_is_read(tmp_path, name, glb):
    check_boxes(read(tmp_path, name, write_gltf(glb=glb)))


def test_offsets_and_strides_of_gltf_are_in_bytes(tmp_path):
    def edit(header, add):
        rows = np.full((9, 5), 99.0, "<f4")
        rows[1:, 2:] = BOX_CORNERS
        view = add(rows)
        header["bufferViews"][view]["byteStride"] = 20
        header["accessors"][0].update(bufferView=view, byteOffset=28)

    check_boxes(read(tmp_path, "box.glb", write_gltf(edit)))


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
            {"mesh": 0, "translation": [20, 0, 0]},
        ]

    mesh = read(tmp_path, "nodes.glb", write_gltf(edit))
    turned = (BOX_CORNERS * [-1, 1, 3]) @ QUARTER_TURN.T + [0, 0, 50]
    shifted = BOX_CORNERS + BOX_SHIFT + [0, 5, 0]
    placed = [BOX_CORNERS, shifted, turned, BOX_CORNERS + 2 * BOX_SHIFT]
    expected = np.concatenate(placed) * [2, 1, 1]
    found = np.unique(mesh.vertices.round(4), axis=0)
    assert np.allclose(found, np.unique(expected.round(4), axis=0))
    assert mesh.volume == pytest.approx(2 * 64 * (1 + 1 + 3 + 1))


@refusals(
    "edit, message",
    (lambda h, add: add_part(h, add, 5, [0, 1, 3, 2]), "strips"),
    (lambda h, add: add_part(h, add, 4, [0, 1, 8]), "vertex 8"),
    (lambda h, add: h["meshes"][0]["primitives"][0]["attributes"].clear(), "positions"),
    (lambda h, add: h["accessors"][0].update(sparse={}), "sparse"),
    (lambda h, add: h["accessors"][0].update(componentType=5122), "quantised"),
    (lambda h, add: h["accessors"][0].update(count=9), "exceeds its view"),
    (lambda h, add: h["bufferViews"][0].update(byteOffset=-4), "exceeds its buffer"),
    (lambda h, add: h["nodes"][0].update(extensions={"EXT_instancing": {}}), "EXT_instancing"),
    (lambda h, add: h["nodes"][0].update(skin=0), "skin"),
    (lambda h, add: h["meshes"][0].update(weights=[0.0, 1.0]), "morph"),
    (lambda h, add: h["nodes"][0].update(children=[0]), "twice"),
)
def test_unsupported_features_of_gltf_are_refused(tmp_path, edit, message):
    check_refused(tmp_path, "odd.glb", write_gltf(edit), message)


# COLLADA

TRIANGLES = write_primitives("triangles", 12, BOX_MESH.faces)
POLYGONS = write_primitives("polygons", 6, *BOX_QUADS)


@pytest.mark.parametrize(
    "primitives",
    [
        QUADS,
        write_primitives("triangles", 6, BOX_MESH.faces[:6])
        + write_primitives("polygons", 6, *BOX_MESH.faces[6:]),
        write_primitives("lines", 1, [0, 1]) + POLYGONS,
        QUADS.replace('"0"', '"2"')
        .replace('"1"', '"0"')
        .replace(" 0 ", " 0 0 ")
        .replace("<p>", "<p>0 0 ")
        .replace(" 0</p>", "</p>"),
    ],
    ids=["polylist", "both", "lines", "vertex last"],
)
def test_every_surface_of_collada_is_read(tmp_path, primitives):
    check_boxes(read(tmp_path, "box.dae", make_collada(primitives)))


def test_positions_of_collada_may_stand_among_other_numbers(tmp_path):
    table = np.full((8, 5), 99.0)
    table[:, [0, 2, 3]] = BOX_CORNERS
    numbers = " ".join(map(str, [97, 97, *table.reshape(-1)]))
    text = make_collada().replace(" ".join(map(str, BOX_CORNERS.reshape(-1))), numbers)
    text = text.replace('count="24"', 'count="42"').replace('stride="3"', 'offset="2" stride="5"')
    check_boxes(
        read(tmp_path, "box.dae", text.replace('<param name="Y"', '<param/><param name="Y"'))
    )


NODES = f"""<matrix>1 0 0 2 0 1 0 0 0 0 1 0 0 0 0 1</matrix><translate>3 0 0</translate>
<rotate>0 0 2 90</rotate><scale>-1 2 3</scale>{PLACED}<instance_node url="#shared"/>
<node><translate>0 0 9</translate><instance_node url="#shared"/><instance_light url="#no"/></node>
"""


def test_nodes_of_collada_place_meshes_in_metres(tmp_path):
    content = make_collada(nodes=NODES, unit='<unit name="half" meter="0.5"/>')
    mesh = read(tmp_path, "nodes.dae", content)
    lifted = [BOX_CORNERS + np.array([0, 0, height]) for height in (0, 1, 10)]
    placed = (np.concatenate(lifted) * [-1, 2, 3]) @ QUARTER_TURN.T + [5, 0, 0]
    assert np.allclose(mesh.vertices, 0.5 * placed)
    assert mesh.volume == pytest.approx(3 * 64 * 6 / 8)


@refusals(
    "content, message",
    (make_collada(nodes='<instance_controller url="#skin"/>'), "instance_controller"),
    (make_collada(nodes='<instance_geometry url="other.dae#box"/>'), "another file"),
    (make_collada(nodes='<node id="a"><instance_node url="#a"/></node>'), "within itself"),
    (make_collada(unit='<unit meter="0"/>'), "a unit of 0 metres"),
    (make_collada(write_primitives("tristrips", 6, *BOX_QUADS)), "tristrips"),
    (make_collada(TRIANGLES.replace('"12"', '"4294967295"')), "4294967295 triangles but holds 12"),
    (make_collada(TRIANGLES.replace("0</p>", "</p>")), "numbers, 2 for a corner"),
    (make_collada(POLYGONS.replace("<p>", "<ph><h/></ph><p>", 1)), "holes"),
    (make_collada().replace('count="24"', 'count="27"'), "positions"),
)
def test_unsupported_features_of_collada_are_refused(tmp_path, content, message):
    check_refused(tmp_path, "odd.dae", content, message)
