"""Scenes in glTF and COLLADA."""

import warnings
from contextlib import nullcontext

import numpy as np
import pytest

from cspace import Robot, UnitWarning, Workspace, make_mesh
from tests.helpers.mesh_files import (
    BOX_CORNERS,
    BOX_MESH,
    BOX_QUADS,
    BOX_SHIFT,
    NOTES,
    PLACED,
    QUADS,
    check_boxes,
    check_refused,
    make_collada,
    measure,
    read,
    write_gltf,
    write_noted,
    write_plate,
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
    (lambda h, add: h["meshes"][0].update(extensions={"VENDOR_bend": {}}), "VENDOR_bend"),
    (lambda h, add: h["accessors"][0].update(extensions={"VENDOR_scale": {}}), "VENDOR_scale"),
    (lambda h, add: h.update(extensionsRequired=["KHR_mesh_quantization"]), "KHR_mesh_quant"),
    (lambda h, add: h.update(extensions={"VENDOR_units": {}}), "VENDOR_units"),
    (lambda h, add: h["scenes"][0].update(extensions={"VENDOR_units": {}}), "VENDOR_units"),
    (
        lambda h, add: h["nodes"][0].update(
            matrix=[1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
        ),
        r"a matrix with the last row \[0\.5",
    ),
    (lambda h, add: h["nodes"][0].update(skin=0), "skin"),
    (lambda h, add: h["meshes"][0].update(weights=[0.0, 1.0]), "morph"),
    (lambda h, add: h["nodes"][0].update(children=[0]), "twice"),
)
def test_unsupported_features_of_gltf_are_refused(tmp_path, edit, message):
    check_refused(tmp_path, "odd.glb", write_gltf(edit), message)


# COLLADA

CENTIMETRE, METRE = '<unit name="metre" meter="0.01"/>', '<unit meter="1"/>'
TRIANGLES = write_primitives("triangles", 12, BOX_MESH.faces)
POLYGONS = write_primitives("polygons", 6, *BOX_QUADS)


@pytest.mark.parametrize(
    "primitives",
    [
        QUADS,
        write_primitives("triangles", 6, BOX_MESH.faces[:6])
        + write_primitives("polygons", 6, *BOX_MESH.faces[6:]),
        QUADS.replace('"0"', '"2"')
        .replace('"1"', '"0"')
        .replace(" 0 ", " 0 0 ")
        .replace("<p>", "<p>0 0 ")
        .replace(" 0</p>", "</p>"),
    ],
    ids=["polylist", "both", "vertex last"],
)
def test_every_surface_of_collada_is_read(tmp_path, primitives):
    check_boxes(read(tmp_path, "box.dae", make_collada(primitives)))


def test_lines_of_collada_are_triangles_without_area(tmp_path):
    edges = write_primitives("lines", 2, [0, 6, 1, 7]) + write_primitives(
        "linestrips", 1, [0, 1, 6]
    )
    mesh = read(tmp_path, "box.dae", make_collada(QUADS + edges))
    assert mesh.faces[12:].tolist() == (mesh.faces[12:, [0, 2, 2]]).tolist()
    ends = mesh.vertices[mesh.faces[12:, :2]]
    expected = [(0, 6), (1, 7), (0, 1), (1, 6)]
    np.testing.assert_allclose(ends - ends[0, 0], BOX_CORNERS[expected] - BOX_CORNERS[0])


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
    (
        make_collada(unit="<up_axis>W_UP</up_axis>"),
        "the up_axis 'W_UP'; there are X_UP, Y_UP, Z_UP",
    ),
    (make_collada(unit=CENTIMETRE, body=f"<asset>{METRE}</asset>"), "has parts of another unit"),
    (
        make_collada(nodes=PLACED.join(["<matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1</matrix>", ""])),
        "a matrix with the last row",
    ),
    (make_collada(write_primitives("tristrips", 6, *BOX_QUADS)), "tristrips"),
    (make_collada(TRIANGLES.replace('"12"', '"4294967295"')), "4294967295 triangles but holds 12"),
    (make_collada(TRIANGLES.replace("0</p>", "</p>")), "numbers, 2 for a corner"),
    (make_collada(POLYGONS.replace("<p>", "<ph><h/></ph><p>", 1)), "holes"),
    (make_collada().replace('count="24"', 'count="27"'), "positions"),
)
def test_unsupported_features_of_collada_are_refused(tmp_path, content, message):
    check_refused(tmp_path, "odd.dae", content, message)


# Axes and units


@pytest.mark.parametrize("form, axis", [("glb", "y"), ("Y_UP", "y"), ("X_UP", "x")])
def test_a_file_whose_y_or_x_is_up_is_warned_of_and_turned_on_demand(tmp_path, form, axis):
    path = write_plate(tmp_path, form)
    with pytest.warns(
        UserWarning,
        match=f"{axis} points up in the file, and its axes stay as they are, as in ROS; pass up=",
    ) as heard:
        kept = make_mesh(path)
    assert len(heard) == 1 and heard[0].filename == __file__
    standing = [1.2, 0.3, 0.8] if axis == "y" else [0.3, 1.2, 0.8]
    assert measure(kept) == measure(make_mesh(path, up="z")) == standing
    # Followed, the hint gives a plate that lies on the ground, without a warning.
    lying = [1.2, 0.8, 0.3]
    for made in (
        make_mesh(path, up=axis),
        make_mesh(kept, up=axis),
        Robot.from_mesh(path, up=axis).shape,
        Robot.open(path, up=axis).shape,
        Workspace.open(path, spacing=0.1, up=axis).shapes[0],
    ):
        assert measure(made) == lying
        assert made.volume == pytest.approx(1.2 * 0.8 * 0.3)
    x0, y0, x1, y1 = Robot.open(path, up=axis).footprint().geometry.bounds
    assert (x1 - x0, y1 - y0) == pytest.approx((1.2, 0.8), abs=1e-5)


@pytest.mark.parametrize("form, axis", [("glb", "y"), ("X_UP", "x")])
def test_turning_follows_the_right_hand_rule_of_the_format(form, axis):
    """COLLADA: up, right and in are x, -y and z for X_UP, y, x and z for Y_UP, z, x and -y for Z_UP."""
    right, up, inward = {
        "y": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        "x": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    }[axis]
    points = np.array([right, up, inward, (0, 0, 0)], float)
    made = make_mesh((points, [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]), "surface", axis)
    assert made.vertices.tolist() == [[1, 0, 0], [0, 0, 1], [0, -1, 0], [0, 0, 0]]


def test_a_z_up_file_is_read_without_a_warning(tmp_path):
    assert measure(make_mesh(write_plate(tmp_path, "Z_UP"))) == [1.2, 0.3, 0.8]


@pytest.mark.parametrize(
    "form, note, warns", [(form, *row) for form, rows in NOTES.items() for row in rows]
)
def test_a_comment_that_names_another_unit_is_warned_of(tmp_path, form, note, warns):
    path = write_noted(tmp_path, form, note)
    with pytest.warns(UnitWarning, match="taken as metres") if warns else nullcontext():
        assert measure(make_mesh(path)) == [4.0] * 3


def test_bytes_of_triangles_that_read_as_a_unit_are_no_comment(tmp_path):
    data = bytearray(BOX_MESH.export(file_type="stl"))
    data[132:134] = b"mm"  # the attribute of the first triangle
    path = tmp_path / "box.stl"
    path.write_bytes(data)
    with warnings.catch_warnings(action="error"):
        assert measure(make_mesh(path)) == [4.0] * 3


def test_units_of_trimesh_other_than_the_metre_are_warned_of():
    mesh = BOX_MESH.copy()
    mesh.units = "millimeter"
    with pytest.warns(UnitWarning, match="units = millimeter"):
        make_mesh(mesh)
    mesh.convert_units("meters")
    assert measure(make_mesh(mesh)) == [0.004] * 3
