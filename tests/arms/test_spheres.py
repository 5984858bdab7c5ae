"""Sphere models of arms, against points sampled by trimesh and their files."""

import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from cspace import InputError, Robot
from cspace.arms import Arm
from cspace.errors import FileError, GeometryError
from tests.helpers.commands import document, run
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples
from tests.helpers.urdfs import collision, joint, link, planar, write_urdf

NO_PAIRS = '<robot name="small"/>'
"""An SRDF, without which an arm looks for links that always touch, which takes long."""

SAMPLES = 100_000
"""Points sampled on the surface of each link."""


def bare_depth(points, balls):
    """Return the largest distance of points (n, 3) from balls, negative if all lie inside."""
    gaps = [
        np.linalg.norm(points - center, axis=1) - radius
        for center, radius in zip(balls.centers, balls.radii, strict=True)
    ]
    return float(np.min(gaps, axis=0).max())


def check_outer(balls, mesh):
    """Check that balls cover a mesh, and stick out by no more than they say, also within it."""
    points = np.vstack([mesh.sample(SAMPLES, seed=0), mesh.vertices])
    assert bare_depth(points, balls) <= 0.0
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.concatenate([directions, 0.5 * directions, np.zeros((1, 3))])
    spheres = (balls.centers[:, None] + balls.radii[:, None, None] * directions).reshape(-1, 3)
    gap = cKDTree(points).query(spheres)[0] - balls.hausdorff.upper
    if mesh.is_watertight:
        gap[mesh.contains(spheres)] = -1.0
    spacing = np.sqrt(mesh.area / SAMPLES)
    assert gap.max() <= 5.0 * spacing


def check_inner(balls, mesh):
    """Check that each ball lies in a closed mesh."""
    assert mesh.contains(balls.centers).all()
    _, distances, _ = trimesh.proximity.closest_point(mesh, balls.centers)
    assert (balls.radii <= distances + 1e-12).all()


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::cspace._shapes.mesh.MeshWarning")
@pytest.mark.parametrize("kind", ["outer", "inner"])
def test_spheres_cover_or_fill_the_links_of_a_real_arm(data, kind):
    names = {"panda_link5": "link5", "panda_link6": "link6", "panda_leftfinger": "finger"}
    arm = Arm.from_urdf(data / "arms/panda/panda.urdf")
    numbers = {each.name: 1 for each in arm.links} | dict.fromkeys(names, 6)
    if kind == "inner":
        with pytest.warns(UserWarning, match="link 'panda_link6' has no inside"):
            model = arm.spheres(number=numbers, kind=kind)
        assert "panda_link6" not in model.links
        del names["panda_link6"]
    else:
        model = arm.spheres(number=numbers)
    for name, file in names.items():
        mesh = trimesh.load_mesh(data / f"arms/panda/meshes/collision/{file}.obj")
        mesh.merge_vertices()
        assert len(model.links[name]) <= 6
        (check_outer if kind == "outer" else check_inner)(model.links[name], mesh)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Return the file of a small arm."""
    return planar(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def model(source):
    """Return a few spheres for each link of the small arm."""
    return Arm.from_urdf(source).spheres(number={"foot": 2, "upper": 1, "fore": 1})


def two_parts(folder):
    """Return an arm whose last link, fixed to the fore, is a turned cylinder and a ball."""
    cylinder = collision("cylinder", (0.1, 0.4), (0.2, 0, 0), (0, 1, 0))
    tool = f'<link name="tool">{cylinder}{collision("sphere", (0.15,), (0.2, 0.3, 0))}</link>'
    fixed = joint("mount", "fore", "tool", at=(1, 0, 0), kind="fixed", rpy=(0.3, 0, 0))
    return Arm.from_urdf(planar(folder, tool, fixed))


@pytest.mark.thorough
def test_spheres_are_in_the_frame_of_their_link(tmp_path):
    balls = two_parts(tmp_path).spheres(tolerance=0.1).links["tool"]
    axis = trimesh.transformations.rotation_matrix(1.0, (0, 1, 0))
    axis[:3, 3] = (0.2, 0, 0)
    cylinder = trimesh.creation.cylinder(0.1, 0.4, sections=400, transform=axis)
    ball = trimesh.creation.icosphere(4, 0.15).apply_translation((0.2, 0.3, 0))
    for part in (cylinder, ball):
        assert bare_depth(part.sample(SAMPLES, seed=0), balls) <= 0.0
    assert balls.hausdorff.upper <= 0.1


@examples(4)
@given(
    st.tuples(*[st.floats(0.05, 1.0)] * 3),
    st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    st.sampled_from(["outer", "inner"]),
    st.integers(1, 12),
)
def test_spheres_of_boxes_are_proven(tmp_path_factory, sides, at, kind, number):
    bar = (sides, at)
    path = write_urdf(
        tmp_path_factory.mktemp("arm"), link("a", bar), link("b"), joint("hinge", "a", "b")
    )
    model = Arm.from_urdf(path).spheres(number=number, kind=kind)
    mesh = trimesh.creation.box(sides).apply_translation(at)
    for balls in model.links.values():
        assert 1 <= len(balls) <= number
        (check_outer if kind == "outer" else check_inner)(balls, mesh)


def rows(balls):
    """Return centers and radii as rows."""
    return np.column_stack([balls.centers, balls.radii]).tolist()


def test_model_is_printed_and_written_in_each_format(tmp_path, source, model):
    table = str(model).splitlines()
    assert table[0] == "small: 4 outer spheres on 3 links"
    assert [row.split()[:3] for row in table[2:]] == [
        [name, number, "proven"] for name, number in (("foot", "2"), ("upper", "1"), ("fore", "1"))
    ]
    files = {
        suffix: tmp_path / f"spheres{suffix}" for suffix in (".yaml", ".json", ".srdf", ".urdf")
    }
    for file in files.values():
        model.save(file, source if file.suffix == ".urdf" else None)
    expected = {name: rows(balls) for name, balls in model.links.items()}
    curobo = yaml.safe_load(files[".yaml"].read_text())["collision_spheres"]
    assert {
        n: [[*s["center"], s["radius"]] for s in each] for n, each in curobo.items()
    } == expected
    foam = json.loads(files[".json"].read_text())
    assert {
        n: [[*s["origin"], s["radius"]] for s in each["spheres"]] for n, each in foam.items()
    } == expected
    assert foam["foot"]["worst"] == model.links["foot"].hausdorff.upper
    srdf = ET.parse(files[".srdf"]).getroot()
    assert {
        each.get("link"): [
            [*map(float, s.get("center").split()), float(s.get("radius"))] for s in each
        ]
        for each in srdf.findall("link_sphere_approximation")
    } == expected


def surfaces(shape):
    """Return the vertices of the outer and the inner surface of a shape."""
    return [side.surface[0].tolist() for side in (shape.outer, shape.inner)]


@pytest.mark.parametrize("suffix", [".yml", ".json", ".srdf", ".urdf"])
def test_written_spheres_are_read_back(tmp_path, source, model, suffix):
    file = tmp_path / f"spheres{suffix}"
    model.save(file, source if suffix == ".urdf" else None)
    given = (file, None) if suffix == ".urdf" else (source, file)
    arm = Arm.from_urdf(given[0], NO_PAIRS, spheres=given[1])
    robot = Robot.from_urdf(given[0], "upper", spheres=given[1])
    (ball,) = arm.links[1].parts
    corners = ball.shape.outer.surface[0] + ball.pose[:3, 3]
    np.testing.assert_allclose(robot.shape.outer.surface[0], corners, atol=1e-12)
    for each in arm.links:
        centers = np.linalg.inv(arm.placements[each.name].pose) @ [p.pose for p in each.parts]
        balls = model.links[each.name]
        assert centers[:, :3, 3] == pytest.approx(balls.centers, abs=1e-12)
        sizes = [np.ptp(np.reshape(part.shape.inner.bounds, (2, 3)), axis=0) for part in each.parts]
        assert np.array(sizes) / 2.0 == pytest.approx(balls.radii[:, None] * np.ones(3), rel=0.1)


@pytest.mark.thorough
def test_spheres_of_a_description_for_curobo_are_read(data):
    file = data / "arms/spheres/curobo_franka.yml"
    with pytest.warns(UserWarning, match="are not read: self_collision_buffer"):
        arm = Arm.from_urdf(data / "arms/panda/panda.urdf", spheres=file)
    spheres = yaml.safe_load(file.read_text())["robot_cfg"]["kinematics"]["collision_spheres"]
    counts = {each.name: len(each.parts) for each in arm.links}
    assert counts == {name: len(spheres[name]) for name in counts}


def test_spheres_of_a_radius_below_zero_are_left_out_and_counted(tmp_path):
    file = tmp_path / "spheres.yml"
    file.write_text(
        "collision_spheres:\n"
        "  foot: [{center: [0, 0, 0], radius: 0.1}, {center: [1, 0, 0], radius: -0.01}]\n"
        "  upper: [{center: [0, 0, 0], radius: -10.0}]\n"
    )
    source = planar(tmp_path)
    with pytest.warns(UserWarning, match="2 spheres have a radius below zero") as heard:
        arm = Arm.from_urdf(source, spheres=file)
    assert len(heard) == 1
    assert [len(each.parts) for each in arm.links] == [1, 1, 1]
    # A link whose spheres are all disabled keeps its own geometry.
    own = Arm.from_urdf(source)
    assert surfaces(arm.links[1].parts[0].shape) == surfaces(own.links[1].parts[0].shape)
    assert surfaces(arm.links[0].parts[0].shape) != surfaces(own.links[0].parts[0].shape)


SPHERE = "{center: [0, 0, 0], radius: 0.1}"
WRAPPED = f"collision_spheres: {{foot: [{SPHERE}], upper: [{SPHERE}], fore: [{SPHERE}]}}"


@refusals(
    "wrong, hint",
    (f"collision_spheres: [{{foot: [{SPHERE}]}}]", "it must be a table of links"),
    ("robot_cfg: {kinematics: {collision_spheres: spheres/r.yml}}", "it must be a table of links"),
    (
        f"format: xrdf\ngeometry: {{g: {{spheres: {{foot: [{SPHERE}]}}}}}}",
        "file has format 'xrdf'",
    ),
    ("collision_spheres: {}", "it must have those of one link"),
    ("collision_spheres: {foot: []}", "has no spheres"),
    (f"{WRAPPED}\n---\n{WRAPPED}", "holds 2 documents"),
)
def test_other_descriptions_of_spheres_say_what_they_are(tmp_path, wrong, hint):
    file = tmp_path / "spheres.yaml"
    file.write_text(wrong)
    with pytest.raises(FileError, match=re.escape(hint)):
        Arm.from_urdf(planar(tmp_path), spheres=file)


def test_fields_of_spheres_that_are_not_read_are_named(tmp_path):
    file = tmp_path / "spheres.yaml"
    file.write_text(
        "self_collision_buffer: {foot: 0.1}\n"
        "collision_spheres: {foot: [{center: [0, 0, 0], radius: 0.1, unit: mm}]}"
    )
    message = r"are not read: self_collision_buffer, unit \(sphere\)"
    with pytest.warns(UserWarning, match=message):
        Arm.from_urdf(planar(tmp_path), spheres=file)


def test_spheres_of_unknown_links_are_skipped_with_a_warning(tmp_path):
    file = tmp_path / "spheres.json"
    file.write_text('{"tool": {"spheres": [{"origin": [0, 0, 0], "radius": 1}]}}')
    with pytest.warns(UserWarning, match="the URDF lacks, which are skipped: tool"):
        arm = Arm.from_urdf(planar(tmp_path), spheres=file)
    assert [len(each.parts) for each in arm.links] == [1, 1, 1]


@pytest.mark.parametrize(
    "name, text, message",
    [
        ("a.yaml", "collision_spheres: 3", "not a int"),
        ("a.yaml", "collision_sphere_buffer: 0.05", "has collision_sphere_buffer 0.05"),
        ("a.yaml", "collision_spheres: {foot: spheres/foot.yml}", "link 'foot' is 'spheres/foot"),
        ("a.yaml", "foot: [{center: [0, 0], radius: 1}]", "a center is three numbers"),
        ("a.yaml", "foot: [{center: [0, 0, .nan], radius: 1}]", "center nan; .* finite number"),
        ("a.yaml", "foot: [{center: [0, 0, 0], radius: .nan}]", "radius nan; .* finite number"),
        ("a.yaml", "foot: [{center: [0, 0, 0], radius: '1'}]", "without quotes"),
        ("a.yaml", "foot: [{centre: [0, 0, 0], radius: 1}]", "has no center; .* besides centre"),
        ("a.json", "[1]", "must hold fields and values, not a list"),
        ("a.json", '{"foot": {"mean": 1}}', "link 'foot' has no spheres"),
        ("a.json", '{"foot": {"spheres": [{"origin": "0 0 0", "radius": 1}]}}', "must be a list"),
        ("a.json", '{"foot": {"spheres": [{"origin": [0, 0, 0], "radius": -1}]}}', "at least 0"),
        ("a.json", '{"foot"', "JSON"),
        ("a.srdf", "<robot/>", "has no spheres"),
        (
            "a.srdf",
            '<robot><link_sphere_approximation link="foot"><sphere center="0 0 0" radius="x"/>'
            "</link_sphere_approximation></robot>",
            "radius 'x'; it must be a finite number, at least 0",
        ),
        ("a.srdf", "<robot", "XML"),
    ],
)
def test_damaged_files_of_spheres_are_refused(tmp_path, name, text, message):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(FileError, match=message):
        Arm.from_urdf(planar(tmp_path), spheres=file)


def test_spheres_need_a_known_suffix_and_are_corrected_as_the_hint_says(tmp_path):
    source = planar(tmp_path)
    with pytest.raises(InputError, match=r"spheres.*\.yaml"):
        Arm.from_urdf(source, spheres=tmp_path / "spheres.txt")
    file = tmp_path / "spheres.yaml"
    file.write_text("foot: [{center: [0, 0, 0], radius: 0}]")
    with pytest.raises(FileError, match="a radius one above zero"):
        Arm.from_urdf(source, spheres=file)
    file.write_text("foot: [{center: [0, 0, 0], radius: 1}]")
    assert len(Arm.from_urdf(source, spheres=file).links[0].parts) == 1


def test_srdf_keeps_its_content_and_gets_the_spheres_once(tmp_path, source, model):
    (tmp_path / "arm.srdf").write_text(
        '<robot name="small"><group name="g"><joint name="elbow"/></group></robot>'
    )
    model.save(tmp_path / "once.srdf", tmp_path / "arm.srdf")
    model.save(tmp_path / "twice.srdf", tmp_path / "once.srdf")
    root = ET.parse(tmp_path / "twice.srdf").getroot()
    assert [each.tag for each in root] == ["group"] + ["link_sphere_approximation"] * 3
    arm = Arm.from_urdf(source, srdf=tmp_path / "twice.srdf")
    assert arm.groups == {"g": ("elbow",)}


def test_command_writes_the_spheres(tmp_path):
    path = planar(tmp_path)
    output = tmp_path / "spheres.yaml"
    printed = document(f"spheres {path} --number 1 -o {output}")
    assert printed["links"]["fore"]["covered"]
    assert len(yaml.safe_load(output.read_text())["collision_spheres"]["fore"]) == 1
    assert "exists" in run(f"spheres {path} --number 1 -o {output}").stderr
    urdf = tmp_path / "spheres.urdf"
    table = run(f"spheres {path} --number 1 --kind inner -o {urdf}").stdout
    assert "leaves bare" in table.splitlines()[1]
    assert Arm.from_urdf(urdf).dof == 2


def write_mesh(folder, *vertices):
    """Write a URDF whose first link is one triangle with these vertices."""
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in vertices)
    (folder / "mesh.obj").write_text(f"{text}f 1 2 3\n")
    mesh = '<collision><geometry><mesh filename="mesh.obj"/></geometry></collision>'
    bar = link("b", ((1, 1, 1), (0, 0, 0)))
    return write_urdf(folder, f'<link name="a">{mesh}</link>', bar, joint("hinge", "a", "b"))


@pytest.mark.filterwarnings("ignore::cspace._shapes.mesh.MeshWarning")
@refusals(
    "call, error, message",
    (
        lambda folder: Arm.from_urdf(
            write_mesh(folder, (0, 0, 0), (0, 0, "nan"), (0, 1, 0))
        ).spheres(number=2),
        InputError,
        "is nan; it must be finite",
    ),
    (
        lambda folder: Arm.from_urdf(write_mesh(folder, *[(1, 1, 1)] * 3)).spheres(number=2),
        GeometryError,
        "link 'a' is 0 m across",
    ),
)
def test_spheres_refuse_invalid_arguments(call, error, message, tmp_path):
    with pytest.raises(error, match=message):
        call(tmp_path)


@pytest.mark.filterwarnings("ignore::cspace._shapes.mesh.MeshWarning")
def test_links_without_inside_get_no_inner_spheres(tmp_path):
    sheet = write_mesh(tmp_path, (0, 0, 0), (1, 0, 0), (0, 1, 0))
    with pytest.warns(UserWarning, match="link 'a' has no inside"):
        assert list(Arm.from_urdf(sheet).spheres(number=2, kind="inner").links) == ["b"]
    arm = Arm.from_urdf(sheet, base="a", solid="surface")
    assert len(arm.spheres(number=2).links) == 2


@pytest.mark.filterwarnings("ignore::cspace._shapes.mesh.MeshWarning")
@pytest.mark.filterwarnings("ignore:link:UserWarning")
def test_arm_of_sheets_has_outer_spheres_only(tmp_path):
    path = write_mesh(tmp_path, (0, 0, 0), (1, 0, 0), (0, 1, 0))
    path.write_text(re.sub("<box.*?/>", '<mesh filename="mesh.obj"/>', path.read_text()))
    arm = Arm.from_urdf(path)
    with pytest.raises(GeometryError, match=r"kind is 'inner', but no link has an inside.*balls"):
        arm.spheres(number=1, kind="inner")
    assert len(arm.spheres(number=1, kind="outer").links) == 2


def test_target_needs_a_known_suffix_and_a_urdf_its_template(tmp_path, model):
    with pytest.raises(InputError, match=r"\.yaml"):
        model.save(tmp_path / "spheres.txt")
