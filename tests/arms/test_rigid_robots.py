"""URDF files, against formulas of primitives posed by scipy."""

import warnings
import xml.etree.ElementTree as ElementTree
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import cspace
from cspace import AngleWarning, FileError, InputError, Robot
from cspace._shapes.mesh import Mesh
from tests.helpers.mesh_files import NOTES, measure, write_noted, write_plate
from tests.helpers.refusals import check_refused, refusals

BASE = """
<link name="base">
  <collision><origin xyz="0.1 0 0.2" rpy="0.3 -0.2 0.5"/>
    <geometry><box size="0.6 0.4 0.2"/></geometry></collision>
  <collision><origin xyz="-0.2 0 0.1" rpy="1.2 0 0"/>
    <geometry><cylinder radius="0.15" length="0.5"/></geometry></collision>
</link>
<link name="plate"/>
<link name="head"><collision><geometry><sphere radius="0.25"/></geometry></collision></link>
<link name="wheel"><collision><origin rpy="1.57079632679 0 0"/>
    <geometry><cylinder radius="0.1" length="0.05"/></geometry></collision></link>
<joint name="a" type="fixed"><parent link="base"/><child link="plate"/>
  <origin xyz="0 0 0.3" rpy="0 0 1"/></joint>
<joint name="b" type="fixed"><parent link="plate"/><child link="head"/>
  <origin xyz="0.2 0.1 0.1" rpy="0 0.4 0"/></joint>
<joint name="c" type="continuous"><parent link="base"/><child link="wheel"/>
  <origin xyz="0 0.4 0"/><axis xyz="0 1 0"/></joint>
"""


def write_urdf(folder, body=BASE, name="robot.urdf"):
    path = folder / name
    path.write_text(f'<?xml version="1.0"?><robot name="r">{body}</robot>')
    return path


def make_pose(xyz, rpy):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    matrix[:3, 3] = xyz
    return matrix


BOX_POSE = make_pose((0.1, 0, 0.2), (0.3, -0.2, 0.5))
HEAD_POSE = make_pose((0, 0, 0.3), (0, 0, 1)) @ make_pose((0.2, 0.1, 0.1), (0, 0.4, 0))


def lie_in_base(points):
    """Return True for points in the box, the cylinder or the ball of the fixed base."""

    def move(matrix):
        return (points - matrix[:3, 3]) @ matrix[:3, :3]

    in_box = (np.abs(move(BOX_POSE)) <= (0.3, 0.2, 0.1)).all(axis=1)
    x, y, z = move(make_pose((-0.2, 0, 0.1), (1.2, 0, 0))).T
    in_cylinder = (np.hypot(x, y) <= 0.15) & (np.abs(z) <= 0.25)
    return in_box | in_cylinder | (np.linalg.norm(move(HEAD_POSE), axis=1) <= 0.25)


def test_the_fixed_base_agrees_with_its_primitives(tmp_path):
    path = write_urdf(tmp_path)
    with pytest.warns(UserWarning, match="wheel move against base and are omitted"):
        robot = Robot.from_urdf(path)
    turned = Robot.from_urdf(path, ["head", "base"])  # in the frame of the head
    points = np.random.default_rng(0).uniform(-0.8, 0.9, (30_000, 3))
    local = (points - HEAD_POSE[:3, 3]) @ HEAD_POSE[:3, :3]
    truth = lie_in_base(points)
    assert truth.sum() > 800
    for shape, placed in ((robot.shape, points), (turned.shape, local)):
        assert shape.outer.contains(placed[truth]).all()
        assert truth[shape.inner.contains(placed)].all()
        assert np.mean(shape.outer.contains(placed) != truth) < 0.001
        assert np.mean(shape.inner.contains(placed) != truth) < 0.001
    assert Robot.from_spec(robot.spec).spec == robot.spec
    wheels = Robot.open(f"{path}#base,wheel")
    assert wheels.shape.outer.bounds[1][1] == pytest.approx(0.425)


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


def test_mesh_files_are_found_by_every_kind_of_name(cell):
    mesh = cell.parents[1] / "meshes" / "link.stl"
    for name in (
        "package://cell_description/meshes/link.stl",
        "../meshes/link.stl",
        f"file://{mesh}",
        "package://cell%5Fdescription/meshes/link.stl",
        f"file://{mesh}".replace("link", "l%69nk"),
    ):
        scaled = MESH.replace('NAME"', f'{name}" scale="1 -2 0.5"')
        shape = Robot.from_urdf(write_urdf(cell.parent, scaled)).shape
        assert np.allclose(shape.bounds, [[-4.5, -1.0, -0.25], [4.5, 1.0, 0.25]])
        assert shape.volume == pytest.approx(9.0)  # faces of a mirror image are turned


def test_packages_are_searched_in_the_documented_order(tmp_path, monkeypatch, cell):
    mesh = Path("arm_description", "meshes", "link.stl")
    given = tmp_path / "given"
    ament = tmp_path / "ament" / "share"
    write_box(ament / mesh, 1)
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
    assert measure_side(cell, package_dirs=given) == 5
    assert measure_side(cell, package_dirs=[str(ament), given]) == 1
    assert Robot.open(cell, package_dirs=given).shape.outer.bounds[1][0] == 2.5


def write_package(folder, side, name="arm_description"):
    """Write a package with a mesh, and the end of a crawl for packages."""
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(f"<package><name> {name} </name></package>")
    write_box(folder / "meshes" / "link.stl", side)


def test_packages_are_found_at_any_depth_by_their_names(tmp_path, monkeypatch, cell):
    source = tmp_path / "other" / "src"
    write_box(tmp_path / "ament" / "share" / "arm_description" / "meshes" / "link.stl", 1)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}/ament")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path}/none:{source}")
    # Folders that ROS does not enter: hidden ones, ignored ones, and those of packages.
    write_package(source / ".git" / "arm_description", 2)
    write_package(source / "old" / "arm_description", 3)
    (source / "old" / "COLCON_IGNORE").touch()
    write_package(source / "simulator", 4, "simulator")
    write_package(source / "simulator" / "test" / "arm_description", 5)
    (source / "broken").mkdir()
    (source / "broken" / "package.xml").write_text("<package>")
    (source / "loop").symlink_to(source)
    assert measure_side(cell) == 1
    # The name of a package counts, not that of its folder.
    write_package(source / "vendor" / "drivers" / "arm_description", 6, "arm_drivers")
    assert measure_side(cell) == 1
    write_package(source / "vendor" / "arm-ros" / "description", 7)
    assert measure_side(cell) == 7
    given = tmp_path / "given"
    write_package(given / "stack" / "description", 8)
    assert measure_side(cell, package_dirs=given) == 8
    write_box(source / "arm_description" / "meshes" / "link.stl", 10)
    assert measure_side(cell) == 10


def test_a_mesh_of_a_missing_package_is_guessed_with_a_warning(tmp_path, cell):
    message = r"arm_description/meshes/link.stl from .*cell_description/meshes/link.stl"
    with pytest.warns(UserWarning, match=message) as heard:
        assert measure_side(cell) == 9
    assert [warning.filename for warning in heard] == [__file__]
    write_box(tmp_path / "ws" / "meshes" / "link.stl", 4)
    relative = write_urdf(cell.parent, MESH.replace("NAME", "meshes/link.stl"), "relative.urdf")
    for path in (cell, relative):
        with pytest.raises(FileError, match=r"several files match .*/link.stl, .*/ws/meshes/link"):
            measure_side(path)
    write_box(cell.parent / "meshes" / "link.stl", 3)
    assert measure_side(relative) == 3


def test_names_with_blanks_are_found_escaped_and_plain(tmp_path):
    write_box(tmp_path / "my arm" / "base link.stl", 7)
    for name in ("package://my%20arm/base%20link.stl", "my arm/base%20link.stl"):
        assert measure_side(write_urdf(tmp_path, MESH.replace("NAME", name))) == 7
    write_box(tmp_path / "my arm" / "base%20link.stl", 3)  # the name itself comes first
    assert measure_side(write_urdf(tmp_path, MESH.replace("NAME", name))) == 3


def make_chain(count, kind="fixed", extra=""):
    """Return a chain of boxes, each turned by 0.01 against the one before."""
    box = '<collision><geometry><box size="0.5 0.4 0.3"/></geometry></collision>'
    links = [f'<link name="l{k}">{box}</link>' for k in range(count)]
    joints = [
        f'<joint name="j{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'{extra if k else ""}<origin xyz="1 0 0" rpy="0 0 0.01"/><axis xyz="0 2 0"/></joint>'
        for k in range(count - 1)
    ]
    return "".join(links + joints)


def test_long_chains_are_placed(tmp_path):
    shape = Robot.from_urdf(write_urdf(tmp_path, make_chain(800))).shape
    assert isinstance(shape, Mesh)  # boxes need no second surface
    x, y, _ = shape.vertices.reshape(800, -1, 3).mean(axis=1).T
    steps = np.exp(0.01j * np.arange(800))
    assert np.allclose(x + 1j * y, np.cumsum(steps) - steps, atol=1e-9)


@pytest.mark.parametrize("kind, angle, slide", [("continuous", 0.5, 0.0), ("prismatic", 0.0, 0.5)])
def test_mimic_joints_are_at_their_offset(tmp_path, kind, angle, slide):
    path = write_urdf(tmp_path, make_chain(3, kind, '<mimic joint="j0" offset="0.5"/>'))
    corners = Robot.from_urdf(path, ["l1", "l2"]).shape.vertices[-8:]
    turn = Rotation.from_euler("z", 0.01)
    assert np.allclose(corners.mean(axis=0), turn.apply((0, slide, 0)) + np.eye(3)[0], atol=1e-12)
    turn *= Rotation.from_rotvec((0.0, angle, 0.0))
    sides = np.abs(turn.as_matrix() @ np.diag((0.5, 0.4, 0.3))).sum(axis=1)
    assert np.allclose(np.ptp(corners, axis=0), sides)


def test_a_chain_of_mimicking_joints_ends_at_the_offset_of_all(tmp_path):
    chain = make_chain(4, "prismatic", '<mimic joint="j0" multiplier="3" offset="0.5"/>')
    first, _, rest = chain.partition('<joint name="j2"')
    path = write_urdf(tmp_path, f'{first}<joint name="j2"{rest.replace("j0", "j1")}')
    corners = Robot.from_urdf(path, ["l1", "l3"]).shape.vertices[-8:]
    x, y = np.eye(3)[:2]
    turn = Rotation.from_euler("z", 0.01)
    # From frame to frame: 1 along x, a turn, and the slide along y, of j2 by 3 * 0.5 + 0.5.
    expected = x + turn.apply(0.5 * y + x + turn.apply(2.0 * y))
    np.testing.assert_allclose(corners.mean(axis=0), expected, atol=1e-9)


DRAWN = '<visual><origin xyz="0 0 1"/><geometry><box size="0.2 0.9 0.1"/></geometry></visual>'
BOX = '<collision><geometry><box size="0.6 0.4 0.2"/></geometry></collision>'
MAST = (
    f'<link name="base">{BOX}{DRAWN}</link><link name="mast">{DRAWN}</link><link name="frame"/>'
    f'<link name="fan">{DRAWN}</link><link name="mass"/>'
    '<joint name="a" type="fixed"><parent link="base"/><child link="mast"/></joint>'
    '<joint name="b" type="fixed"><parent link="mast"/><child link="frame"/></joint>'
    '<joint name="c" type="continuous"><parent link="base"/><child link="fan"/></joint>'
    '<joint name="d" type="fixed"><parent link="frame"/><child link="mass"/></joint>'
)


@pytest.mark.parametrize(
    "read, named",
    [
        (Robot.from_urdf, "mast, fan;"),
        (lambda path: Robot.from_urdf(path, ["base", "mast"]), "mast;"),
        (lambda path: cspace.Arm.from_urdf(path), "(mast, fan|fan, mast);"),
    ],
    ids=["base", "links", "arm"],
)
def test_links_that_are_only_drawn_are_named_once(tmp_path, read, named):
    path = write_urdf(tmp_path, MAST)
    with pytest.warns(UserWarning, match=f"<visual> but no <collision> at {named}") as heard:
        read(path)
    assert len(heard) == 1 and heard[0].filename == __file__


@pytest.mark.filterwarnings("ignore:.*fan move against base")
def test_visuals_stand_for_collision_geometry_that_is_missing(tmp_path):
    path = write_urdf(tmp_path, MAST)
    for robot in (Robot.from_urdf(path, visuals=True), Robot.open(path, visuals=True)):
        lower, upper = robot.shape.bounds
        assert (lower.tolist(), upper.tolist()) == ([-0.3, -0.45, -0.1], [0.3, 0.45, 1.05])
    arm = cspace.Arm.from_urdf(path, visuals=True)
    assert {link.name for link in arm.links} == {"base", "mast", "fan"}


def test_what_is_drawn_may_be_of_any_kind_if_it_is_not_read(tmp_path):
    odd = '<visual><geometry><capsule radius="1" length="1"/></geometry></visual>'
    path = write_urdf(tmp_path, f'<link name="l">{BOX}{odd}</link>')
    assert Robot.from_urdf(path).shape.bounds[1][0] == 0.3
    bare = write_urdf(tmp_path, f'<link name="l">{odd}</link>')
    for visuals, error in ((False, InputError), (True, FileError)):
        with pytest.raises(error), pytest.warns(UserWarning) if not visuals else nullcontext():
            Robot.from_urdf(bare, visuals=visuals)


TURN = '<link name="l">{}</link><link name="m"/><joint name="j" type="{}"><parent link="l"/><child link="m"/>{}</joint>'


@pytest.mark.parametrize(
    "kind, part, count",
    [
        ("fixed", '<origin rpy="0 0 180"/>', 1),
        ("revolute", '<limit lower="-180" upper="180"/>', 2),
        ("revolute", '<limit lower="-1" upper="90"/><origin rpy="90 -90 0"/>', 2),
        ("continuous", '<mimic joint="k" offset="45"/>', 1),
        ("revolute", '<limit lower="-3" upper="3"/><safety_controller soft_upper_limit="170"/>', 1),
        ("revolute", '<limit lower="-6.2832" upper="6.2832"/><origin rpy="0 0 -6.2832"/>', 0),
        ("prismatic", '<limit lower="-180" upper="180"/>', 0),
        ("continuous", '<limit lower="-1e16" upper="1e16"/>', 0),
    ],
)
def test_angles_in_degrees_are_warned_of_once(tmp_path, kind, part, count):
    path = write_urdf(tmp_path, TURN.format(BOX, kind, part))
    with warnings.catch_warnings(record=True, action="always") as heard:
        Robot.from_urdf(path)
    assert [each.category for each in heard] == [AngleWarning] * (count > 0)
    assert not count or f"the first of {count}, is beyond" in str(heard[0].message)


def test_a_robot_without_a_name_has_the_name_of_its_file(tmp_path):
    path = tmp_path / "cart.urdf"
    path.write_text(f'<robot><link name="l">{BOX}</link></robot>')
    assert Robot.from_urdf(path).shape.bounds[1][0] == 0.3


LINKS = '<link name="l"/><link name="m"/>'


def make_link(geometry):
    """Return a link of one geometry."""
    return f'<link name="l"><collision><geometry>{geometry}</geometry></collision></link>'


@refusals(
    "body, error, message",
    (make_link("<cone/>"), FileError, "<cone> as the geometry .*; it must be one of box"),
    (make_link('<box size="1 1 nan"/>'), FileError, "it must be 3 finite numbers"),
    (make_link('<mesh filename="$(find p)/x.stl"/>'), FileError, "xacro macros.*"),
    ('<x:if xmlns:x="http://www.ros.org/wiki/xacro"/>' + LINKS, FileError, "xacro macros"),
)
def test_malformed_urdf_is_refused_in_one_line(tmp_path, body, error, message):
    (tmp_path / "x.stl").touch()
    with pytest.raises(error, match=message) as caught:
        Robot.from_urdf(write_urdf(tmp_path, body))
    assert "\n" not in str(caught.value)


def test_unknown_links_and_other_files_are_refused(tmp_path):
    path = write_urdf(tmp_path)
    with pytest.raises(InputError, match=r"link is 'arm'; there are base, plate, head, wheel"):
        Robot.from_urdf(path, "arm")
    ball = make_link('<sphere radius="1"/>')
    xacro = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'  # as xacro leaves it
    path.write_text(f'<robot name="r" {xacro}>{ball}<gazebo/></robot>')
    assert Robot.from_urdf(path).shape.outer.bounds[1][0] == pytest.approx(1.0, rel=0.05)


def test_an_origin_with_other_attributes_is_refused_and_the_hint_followed(tmp_path):
    turned = BASE.replace('rpy="0.3 -0.2 0.5"', 'quat_xyzw="0 0 1 0"')
    with pytest.raises(FileError, match="only xyz and rpy are read"):
        Robot.from_urdf(write_urdf(tmp_path, turned), "base")
    roll, pitch, yaw = Rotation.from_quat((0, 0, 1, 0)).as_euler("xyz")
    written = turned.replace('quat_xyzw="0 0 1 0"', f'rpy="{roll} {pitch} {yaw}"')
    assert Robot.from_urdf(write_urdf(tmp_path, written), "base").dim == 3


def test_limits_of_a_continuous_joint_warn(tmp_path):
    limit = '<axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/>'
    body = BASE.replace('<axis xyz="0 1 0"/>', limit)
    with pytest.warns(UserWarning, match="a continuous joint has no limits"):
        arm = cspace.Arm.from_urdf(write_urdf(tmp_path, body))
    assert (arm.lower[0], arm.upper[0]) == (-np.inf, np.inf)
    with warnings.catch_warnings(action="error"):
        arm = cspace.Arm.from_urdf(write_urdf(tmp_path, body.replace("continuous", "revolute")))
        cspace.Arm.from_urdf(write_urdf(tmp_path))
    assert (arm.lower[0], arm.upper[0]) == (-1.0, 2.0)
    soft = '<axis xyz="0 1 0"/><safety_controller soft_lower_limit="-1" soft_upper_limit="1" k_velocity="1"/>'
    with pytest.warns(UserWarning, match="-1.0 and 1.0 do not count"):
        cspace.Arm.from_urdf(write_urdf(tmp_path, BASE.replace('<axis xyz="0 1 0"/>', soft)))


def test_limits_of_acceleration_in_a_urdf_are_named_as_not_read(tmp_path):
    rates = 'velocity="1" acceleration="0.5" deceleration="0.4" jerk="2"'
    limit = f'<axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="1" {rates}/>'
    body = BASE.replace("continuous", "revolute").replace('<axis xyz="0 1 0"/>', limit)
    named = r"not read: acceleration \(limit\), deceleration \(limit\), jerk \(limit\)"
    with pytest.warns(UserWarning, match=named):
        cspace.Arm.from_urdf(write_urdf(tmp_path, body))


@pytest.mark.parametrize("read", [cspace.Arm.from_urdf, Robot.from_urdf])
@pytest.mark.parametrize("value", [ElementTree.ElementTree(), object(), 5, b"<robot/>", None])
def test_a_robot_that_another_package_has_loaded_is_refused_by_its_kind(read, value):
    message = f"path is a {type(value).__name__} ... file name, or the text"
    check_refused(lambda: read(value), message)


UNIT_BOX = '<geometry><box size="1 1 1"/></geometry>'


@pytest.mark.parametrize(
    ("collision", "named"),
    [
        (f'<originn xyz="1 0 0"/>{UNIT_BOX}', r"originn \(collision\); did you mean 'origin'\?"),
        (f'{UNIT_BOX}<padding size="0.1"/>', r"padding \(collision\)"),
        ('<geometry><box size="1 1 1" unit="mm"/></geometry>', r"unit \(box\)"),
        (
            '<geometry><mesh filename="m.stl" sclae="1 1 1"/></geometry>',
            r"sclae \(mesh\); did .* 'scale'",
        ),
    ],
)
def test_parts_of_a_urdf_that_nobody_reads_are_named(tmp_path, collision, named):
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "m.stl")
    path = tmp_path / "robot.urdf"
    path.write_text(
        f'<robot name="r"><link name="l"><collision>{collision}</collision></link></robot>'
    )
    with pytest.warns(UserWarning, match=rf"robot\.urdf: these fields are not read: {named}"):
        cspace.Robot.from_urdf(path)


@pytest.mark.parametrize(
    "twice", [f"{UNIT_BOX}{UNIT_BOX}", f'<origin xyz="1 0 0"/><origin/>{UNIT_BOX}']
)
def test_a_second_geometry_or_origin_is_refused(tmp_path, twice):
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r"><link name="l"><collision>{twice}</collision></link></robot>')
    with pytest.raises(
        FileError, match=r"has 2 <(geometry|origin)> in a <collision>; only one would"
    ):
        cspace.Robot.from_urdf(path)


@pytest.mark.parametrize("attributes, warns", [("", True), ('scale="0.001 0.001 0.001"', False)])
def test_a_link_in_millimetres_is_warned_of(tmp_path, attributes, warns):
    trimesh.creation.box((300, 200, 100)).export(tmp_path / "box.stl")
    mesh = f'<mesh filename="box.stl" {attributes}/>'
    path = write_urdf(
        tmp_path, f'<link name="a"><collision><geometry>{mesh}</geometry></collision></link>'
    )
    match = "link .a., collision 0: mesh is 300 m x 200 m x 100 m large"
    with pytest.warns(cspace.UnitWarning, match=match) if warns else nullcontext():
        Robot.from_urdf(path)


def test_gltf_meshes_of_urdf_are_turned_upright_with_a_warning(tmp_path):
    write_plate(tmp_path, "glb")
    path = tmp_path / "robot.urdf"
    geometry = '<collision><geometry><mesh filename="plate.glb"/></geometry></collision>'
    path.write_text(f'<robot name="r"><link name="l">{geometry}</link></robot>')
    with pytest.warns(UserWarning, match=r"y points up in the glTF file plate\.glb; it is turned"):
        robot = Robot.from_urdf(path)
    assert measure(robot.shape) == [1.2, 0.8, 0.3]
    # Files of other formats keep their axes, whichever they call up.
    write_plate(tmp_path, "Y_UP")
    path.write_text(path.read_text().replace("plate.glb", "plate.dae"))
    assert measure(Robot.from_urdf(path).shape) == [1.2, 0.3, 0.8]


@pytest.mark.parametrize(
    "form, note", [(form, note) for form, rows in NOTES.items() for note, _ in rows]
)
def test_the_scale_of_a_mesh_answers_in_which_unit_it_is(tmp_path, form, note):
    write_noted(tmp_path, form, note)
    mesh = f'<mesh filename="box.{form}" scale="0.001 0.001 0.001"/>'
    body = f'<link name="l"><collision><geometry>{mesh}</geometry></collision></link>'
    with warnings.catch_warnings(action="error"):
        assert measure(Robot.from_urdf(write_urdf(tmp_path, body)).shape) == [0.004] * 3
