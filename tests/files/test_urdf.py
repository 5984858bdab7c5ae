"""URDF files, against formulas of primitives posed by scipy."""

from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial.transform import Rotation

from cspace import FileError, InputError, Mesh, Robot
from tests.helpers.missing import output_without
from tests.helpers.refusals import refusals

BASE = """
<link name="base">
  <collision><origin xyz="0.1 0 0.2" rpy="0.3 -0.2 0.5"/><geometry><box size="0.6 0.4 0.2"/></geometry></collision>
  <collision><origin xyz="-0.2 0 0.1" rpy="1.2 0 0"/>
    <geometry><cylinder radius="0.15" length="0.5"/></geometry></collision>
</link>
<link name="plate"/>
<link name="head"><collision><geometry><sphere radius="0.25"/></geometry></collision></link>
<link name="wheel"><collision><origin rpy="1.57079632679 0 0"/>
    <geometry><cylinder radius="0.1" length="0.05"/></geometry></collision></link>
<joint name="a" type="fixed"><parent link="base"/><child link="plate"/><origin xyz="0 0 0.3" rpy="0 0 1"/></joint>
<joint name="b" type="fixed"><parent link="plate"/><child link="head"/><origin xyz="0.2 0.1 0.1" rpy="0 0.4 0"/></joint>
<joint name="c" type="continuous"><parent link="base"/><child link="wheel"/><origin xyz="0 0.4 0"/><axis xyz="0 1 0"/>
</joint>
"""


def write_urdf(folder, body=BASE, name="robot.urdf"):
    path = folder / name
    path.write_text(f'<?xml version="1.0"?><robot name="r">{body}</robot>')
    return path


def make_pose(xyz, rpy):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
    return matrix


def in_box(size):
    return lambda p: (np.abs(p) <= np.array(size) / 2).all(axis=-1)


def in_cylinder(radius, length):
    return lambda p: (np.hypot(p[..., 0], p[..., 1]) <= radius) & (np.abs(p[..., 2]) <= length / 2)


def in_ball(radius):
    return lambda p: np.linalg.norm(p, axis=-1) <= radius


PARTS = [
    (make_pose((0.1, 0, 0.2), (0.3, -0.2, 0.5)), in_box((0.6, 0.4, 0.2))),
    (make_pose((-0.2, 0, 0.1), (1.2, 0, 0)), in_cylinder(0.15, 0.5)),
    (make_pose((0, 0, 0.3), (0, 0, 1)) @ make_pose((0.2, 0.1, 0.1), (0, 0.4, 0)), in_ball(0.25)),
]


def in_parts(points, parts):
    within = np.zeros(len(points), dtype=bool)
    for matrix, inside in parts:
        within |= inside((points - matrix[:3, 3]) @ matrix[:3, :3])
    return within


def test_the_fixed_base_agrees_with_its_primitives(tmp_path):
    with pytest.warns(
        UserWarning,
        match="wheel move against base and are omitted; to include them, name all links",
    ):
        robot = Robot.from_urdf(write_urdf(tmp_path))
    points = np.random.default_rng(0).uniform(-0.8, 0.9, (30_000, 3))
    truth, (outer, inner) = in_parts(points, PARTS), (robot.shape.outer, robot.shape.inner)
    assert truth.sum() > 800
    assert outer.contains(points[truth]).all()
    assert truth[inner.contains(points)].all()
    assert np.mean(outer.contains(points) != truth) < 0.001
    assert np.mean(inner.contains(points) != truth) < 0.001
    assert Robot.from_spec(robot.spec).spec == robot.spec


def test_links_are_placed_in_the_frame_of_the_first(tmp_path):
    path = write_urdf(tmp_path)
    wheels = Robot.from_urdf(path, ["base", "wheel"])
    assert wheels.shape.outer.bounds[1][1] == pytest.approx(0.425)
    assert Robot.open(f"{path}#base,wheel").shape.outer.bounds[1][1] == pytest.approx(0.425)
    head = Robot.from_urdf(path, "head")
    assert np.allclose(head.shape.outer.bounds, [[-0.25] * 3, [0.25] * 3], atol=0.001)
    turned = Robot.from_urdf(path, ["head", "base"]).shape.outer
    matrix = np.linalg.inv(PARTS[2][0])
    points = np.random.default_rng(1).uniform(-0.8, 0.8, (5000, 3))
    truth = in_parts(points, [(matrix @ PARTS[0][0], PARTS[0][1])])
    assert turned.contains(points[truth]).all()


def test_mesh_files_are_found_by_every_kind_of_name(tmp_path):
    (tmp_path / "my_robot" / "meshes").mkdir(parents=True)
    (tmp_path / "my_robot" / "urdf").mkdir()
    torus = trimesh.creation.torus(0.5, 0.2)
    torus.export(tmp_path / "my_robot" / "meshes" / "part.stl")
    body = '<link name="l"><collision><geometry><mesh filename="NAME" scale="1 -2 0.5"/></geometry></collision></link>'
    for name in (
        "package://my_robot/meshes/part.stl",
        "../meshes/part.stl",
        f"file://{tmp_path}/my_robot/meshes/part.stl",
    ):
        robot = Robot.from_urdf(
            write_urdf(tmp_path / "my_robot" / "urdf", body.replace("NAME", name))
        )
        assert np.allclose(
            robot.shape.outer.bounds, [[-0.7, -1.4, -0.1], [0.7, 1.4, 0.1]], atol=1e-6
        )
        assert robot.shape.outer is robot.shape.inner is robot.shape
        assert robot.shape.volume == pytest.approx(torus.volume, rel=1e-5)
    with pytest.raises(
        FileError, match=r"link 'l', collision 0: mesh package://no/part.stl: does not exist"
    ):
        Robot.from_urdf(write_urdf(tmp_path, body.replace("NAME", "package://no/part.stl")))


MESH = '<link name="l"><collision><geometry><mesh filename="NAME"/></geometry></collision></link>'


def write_box(path, side):
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box((side, 1, 1)).export(path)
    return path


def measure_side(urdf, **options):
    """Return the length of the mesh along x."""
    return Robot.from_urdf(urdf, **options).shape.outer.bounds[1][0] * 2


@pytest.fixture
def cell(tmp_path, monkeypatch):
    """Write a URDF with an ambiguous name of a mesh."""
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    folder = tmp_path / "ws" / "src" / "cell_description"
    write_box(folder / "meshes" / "link.stl", 9)
    (folder / "urdf").mkdir()
    return write_urdf(
        folder / "urdf", MESH.replace("NAME", "package://arm_description/meshes/link.stl")
    )


def test_packages_are_searched_in_the_documented_order_and_no_other_package_is_taken(
    tmp_path, monkeypatch, cell
):
    mesh, given = Path("arm_description", "meshes", "link.stl"), tmp_path / "given"
    write_box(tmp_path / "ament" / "share" / mesh, 1)
    write_box(tmp_path / "ros" / mesh, 2)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/none:{tmp_path}/ament")
    assert measure_side(cell) == 1
    monkeypatch.setenv("ROS_PACKAGE_PATH", f":{tmp_path}/none:{tmp_path}/ros")
    assert measure_side(cell) == 2
    write_box(tmp_path / mesh, 3)
    assert measure_side(cell) == 3
    write_box(tmp_path / "ws" / "src" / mesh, 4)
    assert measure_side(cell) == 4
    write_box(given / mesh, 5)
    assert (
        measure_side(cell, package_dirs=given) == measure_side(cell, package_dirs=[str(given)]) == 5
    )
    assert measure_side(cell, package_dirs=[tmp_path / "ament" / "share", given]) == 1
    assert Robot.open(cell, package_dirs=given).shape.outer.bounds[1][0] == 2.5
    assert Robot.open(cell, package_dirs=given).footprint().shape.outer.bounds[1][
        0
    ] == pytest.approx(2.5)


def test_a_mesh_of_a_missing_package_is_read_with_a_warning_if_only_one_file_could_be_meant(
    tmp_path, cell
):
    with pytest.warns(
        UserWarning,
        match=r"arm_description/meshes/link.stl from .*cell_description/meshes/link.stl",
    ) as heard:
        assert measure_side(cell) == 9
    assert [each.filename for each in heard] == [__file__]
    write_box(tmp_path / "ws" / "meshes" / "link.stl", 4)
    with pytest.raises(
        FileError, match=r"several files match .*: .*cell_desc.*/link.stl, .*/ws/meshes/link.stl"
    ):
        measure_side(cell)
    relative = write_urdf(cell.parent, MESH.replace("NAME", "meshes/link.stl"), "relative.urdf")
    with pytest.raises(FileError, match="several files match"):
        measure_side(relative)
    write_box(cell.parent / "meshes" / "link.stl", 3)
    assert measure_side(relative) == 3


@refusals(
    "value, message",
    ("none", "package_dirs names none"),
    ([__file__], "existing folder"),
    (3, "package_dirs is 3"),
    ([3], "is .3."),
)
def test_bad_package_dirs_are_refused(cell, value, message):
    with pytest.raises(InputError, match=message):
        Robot.from_urdf(cell, package_dirs=value)
    with pytest.raises(InputError, match=r"package_dirs is .*it applies to .urdf"):
        Robot.open(Path(cell).with_name("robot.stl"), package_dirs=value)


def test_urdf_files_of_other_projects_are_read(data):
    hand = ["panda_hand", "panda_leftfinger", "panda_rightfinger"]
    gripper = Robot.from_urdf(data / "arms" / "panda" / "panda.urdf", hand)
    # The hand is 0.204 m wide, and its fingers end 0.112 m above its frame (measured in the meshes
    # of the folder).
    assert np.ptp(gripper.shape.outer.bounds, axis=0).tolist() == pytest.approx(
        [0.0632, 0.2045, 0.1381], abs=2e-3
    )


@pytest.mark.parametrize(
    ("make", "area"),
    [
        (lambda: Robot.box((2, 1, 5), (3, 0, 0)), 2.0),
        (lambda: Robot.ball(0.5, (1, 2, 3)), np.pi / 4),
        (lambda: Robot.cylinder(0.5, 3), np.pi / 4),
        (lambda: Robot.from_mesh(trimesh.creation.torus(2.0, 0.5)), np.pi * (2.5**2 - 1.5**2)),
        (lambda: Robot.from_bitmap(np.ones((2, 3, 4), bool), 0.5), 1.5),
        (lambda: Robot.disc(0.5), np.pi / 4),
    ],
)
def test_a_footprint_has_the_area_of_the_shadow(make, area):
    robot = make()
    footprint = robot.footprint()
    assert footprint.dim == 2
    assert footprint.shape.outer.measure == pytest.approx(area, rel=0.02)
    lower, upper = robot.shape.outer.bounds
    assert np.allclose(footprint.shape.outer.bounds, [lower[:2], upper[:2]], atol=2e-6)
    assert Robot.from_spec(footprint.spec).spec == footprint.spec
    assert footprint.shape.symmetry == robot.shape.symmetry


def test_the_shadow_of_a_mesh_lies_between_its_bounds():
    mesh = trimesh.creation.icosphere(1).apply_translation((0.3, 0.2, 0))
    flat = Robot.from_mesh(mesh).footprint().shape
    outer, inner = flat.outer, flat.inner
    hull = shapely.convex_hull(shapely.multipoints(mesh.vertices[:, :2]))
    assert shapely.covers(outer.outline, hull)
    assert shapely.covers(hull, inner.outline)
    assert shapely.hausdorff_distance(outer.outline.boundary, inner.outline.boundary) < 1e-5


def make_chain(count, kind="fixed", extra=""):
    """Return a chain of rotated boxes."""
    box = '<collision><geometry><box size="0.5 0.4 0.3"/></geometry></collision>'
    links = "".join(f'<link name="l{k}">{box}</link>' for k in range(count))
    joints = (
        f'<joint name="j{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/>{extra}'
        '<origin xyz="1 0 0" rpy="0 0 0.01"/><axis xyz="0 0 2"/></joint>'
        for k in range(count - 1)
    )
    return links + "".join(joints)


def test_long_chains_are_placed(tmp_path):
    count = 800
    shape = Robot.from_urdf(write_urdf(tmp_path, make_chain(count))).shape
    centers = shape.vertices.reshape(count, -1, 3).mean(axis=1)
    positions = np.cumsum(np.exp(0.01j * np.arange(count))) - np.exp(0.01j * np.arange(count))
    assert np.allclose(
        centers, np.stack([positions.real, positions.imag, np.zeros(count)], axis=1), atol=1e-9
    )


@pytest.mark.parametrize(
    ("kind", "end"),
    [
        ("continuous", (1.0, 0.0)),
        ("prismatic", (1 - 0.5 * np.sin(0.01), 0.5 * np.cos(0.01))),
        ("fixed", (1.0, 0.0)),
    ],
)
def test_mimic_joints_are_at_their_offset(tmp_path, kind, end):
    mimic = '<mimic joint="j0" offset="0.5"/>'
    path = write_urdf(
        tmp_path, make_chain(3, kind, mimic).replace(mimic, "", 1).replace("0 0 2", "0 2 0")
    )
    shape = Robot.from_urdf(path, ["l1", "l2"]).shape
    center = shape.vertices[-8:].mean(axis=0)
    assert np.allclose(center[:2], end, atol=1e-12)
    matrix = Rotation.from_euler("z", 0.01) * Rotation.from_rotvec(
        (0.0, 0.5 * (kind == "continuous"), 0.0)
    )
    sides = np.abs(matrix.as_matrix() @ np.diag((0.5, 0.4, 0.3))).sum(axis=1)
    assert np.allclose(np.ptp(shape.vertices[-8:], axis=0), sides)
    assert isinstance(shape, Mesh)  # boxes need no second surface


def test_boxes_and_cylinders_of_links_cannot_be_surfaces(tmp_path):
    """Open another mesh; the box keeps its inside."""
    trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / "box.stl")
    mesh = '<collision><geometry><mesh filename="box.stl"/></geometry></collision>'
    path = write_urdf(tmp_path, make_chain(2).replace("</link>", mesh + "</link>", 1))
    with pytest.raises(
        InputError, match=r"solid is 'surface', and .* link 'l0', collision 0 is a box"
    ):
        Robot.from_urdf(path, solid="surface")
    alone = write_urdf(tmp_path, f'<link name="l">{mesh}</link>')
    assert not Robot.from_urdf(alone, solid="surface").shape.contains([[0.0, 0.0, 0.0]]).any()
    assert Robot.from_urdf(alone).shape.contains([[0.0, 0.0, 0.0]]).all()


JOINT = '<joint name="j" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
OTHER = JOINT.replace('"j"', '"k"')
GEOMETRY = '<link name="l"><collision><geometry>{}</geometry></collision></link>'


@refusals(
    "body, error, message",
    ("", FileError, "has no <link>"),
    ('<link name="l"/>', InputError, r"no such link has collision geometry; add <collision>"),
    ('<link name="l"/><link name="m"/>', FileError, "without a parent: l, m"),
    ('<link name="l"/><link name="l"/>', FileError, "more than one link 'l'"),
    ('<link name="l"/>' + JOINT.format("l", "n"), FileError, "joins 'l' to 'n' by the joint 'j'"),
    (
        '<link name="l"/><link name="m"/>' + JOINT.format("l", "m") + OTHER.format("l", "m"),
        FileError,
        "a link has one parent",
    ),
    (
        '<link name="l"/><link name="m"/>' + JOINT.format("m", "l") + OTHER.format("l", "m"),
        FileError,
        "joins 'l' in a loop of joints",
    ),
    (
        '<link name="l"/><link name="m"/><link name="n"/>'
        + JOINT.format("m", "l")
        + OTHER.format("l", "m"),
        FileError,
        "joins 'l' in a loop of joints",
    ),
    (
        '<link name="l"/><link name="m"/><link name="n"/>'
        + JOINT.format("m", "l")
        + JOINT.format("l", "n"),
        FileError,
        "more than one joint 'j'",
    ),
    (
        '<link name="l"><collision/></link>',
        FileError,
        "nothing as the geometry of link 'l', collision 0",
    ),
    (
        GEOMETRY.format("<cone/>"),
        FileError,
        "<cone> as the geometry of link 'l', collision 0; it must be one of box",
    ),
    (
        GEOMETRY.format('<cylinder radius="1"/>'),
        FileError,
        "lacks the length of the cylinder of link 'l'",
    ),
    (
        GEOMETRY.format('<cylinder radius="1" length="0"/>'),
        InputError,
        "link 'l', collision 0: cylinder: length is 0",
    ),
    (GEOMETRY.format('<sphere radius="nan"/>'), InputError, "sphere: radius is nan"),
    (
        GEOMETRY.format('<box size="1 2"/>'),
        FileError,
        r"has size='1 2' at the box of link 'l'; it must be 3",
    ),
    (GEOMETRY.format('<box size="1 2 -3"/>'), InputError, "size is -3"),
    (GEOMETRY.format('<box size="a b c"/>'), FileError, "has size='a b c' at the box of link 'l'"),
    (
        GEOMETRY.format('<mesh filename="x.stl" scale="0 1 1"/>'),
        InputError,
        "scale is .* no factor may be zero",
    ),
    (
        GEOMETRY.format('<mesh filename="no_such_mesh.stl"/>'),
        FileError,
        "mesh no_such_mesh.stl: does not exist",
    ),
    (GEOMETRY.format(f'<mesh filename="{"x" * 5000}.stl"/>'), FileError, "does not exist"),
    ('<link name="l"', FileError, "is not XML"),
    ('<x:if xmlns:x="http://www.ros.org/wiki/xacro"/><link name="l"/>', FileError, "xacro macros"),
)
def test_malformed_urdf_is_refused_in_one_line(tmp_path, body, error, message):
    (tmp_path / "x.stl").touch()
    with pytest.raises(error, match=message) as caught:
        Robot.from_urdf(write_urdf(tmp_path, body))
    assert "\n" not in str(caught.value)


@refusals(
    "text, links, error, message",
    (None, "arm", InputError, r"link is 'arm'; there are base, plate, head, wheel"),
    (
        None,
        "plate",
        InputError,
        "link is plate; no such link has collision geometry; name links that have: base",
    ),
    ("<html/>", None, FileError, "holds <html>, not <robot>"),
    (
        '<!DOCTYPE robot [<!ENTITY a "b">]><robot name="&a;"/>',
        None,
        FileError,
        "declares an XML entity",
    ),
)
def test_from_urdf_refuses_unknown_links_and_other_files(tmp_path, text, links, error, message):
    path = write_urdf(tmp_path)
    path.write_text(text or path.read_text())
    with pytest.raises(error, match=message):
        Robot.from_urdf(path, links)


def test_without_yourdfpy_the_error_names_the_extra(tmp_path):
    code = f"""
try:
    cspace.Robot.from_urdf({str(write_urdf(tmp_path))!r})
except cspace.MissingPackageError as error:
    print(error)
"""
    assert 'pip install "cspace[urdf]"' in output_without("yourdfpy", code)


def test_foreign_elements_and_the_xacro_namespace_are_ignored(tmp_path):
    """Include elements for Gazebo in old robot files."""
    path = tmp_path / "robot.urdf"
    names = 'xmlns:xacro="http://www.ros.org/wiki/xacro" xmlns:sensor="http://playerstage.sourceforge.net/gazebo"'
    ball = GEOMETRY.format('<sphere radius="1"/>')
    path.write_text(f'<robot name="r" {names}>{ball}<sensor:camera/></robot>')
    assert Robot.from_urdf(path).shape.outer.bounds[1][0] == pytest.approx(1.0, rel=0.05)
