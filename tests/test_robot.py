"""Robots: geometry, shorthands, files and refusals."""

import pytest
import shapely

from cspace import GeometryError, InputError, Robot, make_mesh
from cspace._shapes import as_shape
from tests.helpers.mesh_files import TETRAHEDRON

UNIT_SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def test_robots_have_the_given_geometry():
    hole = shapely.box(0, 0, 4, 4).difference(shapely.box(1, 1, 2, 2))
    assert Robot.polygon(hole).geometry.equals(hole)
    assert Robot.polygon(UNIT_SQUARE).geometry.equals(shapely.box(0, 0, 1, 1))
    assert Robot.rectangle(2, 1, (3, 4)).geometry.equals(shapely.box(2, 3.5, 4, 4.5))
    assert Robot.disc(2, (1, 0)).geometry.bounds == pytest.approx((-1, -2, 3, 2))
    bitmap = Robot.from_bitmap([[True, False], [True, True]], 0.5, (-0.5, 0)).geometry
    assert bitmap.equals(
        shapely.union_all([shapely.box(-0.5, 0, 0.5, 0.5), shapely.box(0, 0, 0.5, 1)])
    )


@pytest.mark.parametrize(
    "text, robot",
    [
        ("disc:0.3", Robot.disc(0.3)),
        ("rect:0.9x0.6", Robot.rectangle(0.9, 0.6)),
        ("rect:4.5x1.9@1.3,0", Robot.rectangle(4.5, 1.9, (1.3, 0))),
        ("ellipse:0.5,0.3", Robot.ellipse(0.5, 0.3)),
        ("ellipse:0.5,0.3@2,-1", Robot.ellipse(0.5, 0.3, (2, -1))),
        ("ball:0.3", Robot.ball(0.3)),
        ("box:0.6x0.5x0.2@1,2,3", Robot.box((0.6, 0.5, 0.2), (1, 2, 3))),
        ("cylinder:0.3x1.2", Robot.cylinder(0.3, 1.2)),
        ("capsule:0.3x1.2", Robot.capsule(0.3, 1.2)),
        ("footprint:[[0,0],[1,0],[0,1]]", Robot.polygon([(0, 0), (1, 0), (0, 1)])),
        ("footprint:cylinder:0.3x1.2", Robot.cylinder(0.3, 1.2).footprint()),
    ],
)
def test_parse_reads_robots_and_shapes(text, robot):
    assert Robot.parse(text).spec == robot.spec
    assert as_shape(text).spec == as_shape(robot).spec == robot.shape.spec


def test_open_reads_polygon_files(tmp_path, data):
    (tmp_path / "robot.wkt").write_text("POLYGON ((0 0, 2 0, 0 1, 0 0))")
    assert Robot.open(tmp_path / "robot.wkt").geometry.area == 1.0
    car = Robot.open(data / "polygons" / "car.geojson").geometry
    assert car.bounds == pytest.approx((-2.1267, -1.217, 2.1267, 1.217), abs=1e-3)


def test_spec_returns_a_copy():
    robot = Robot.disc(1.0)
    robot.spec["radii"][0] = 0.1
    assert robot.spec["radii"] == [1.0]


def test_a_mesh_far_from_its_reference_point_warns_once():
    vertices, faces = TETRAHEDRON
    Robot.from_mesh((vertices + 1.0, faces))
    with pytest.warns(
        UserWarning, match=r"lies 17.3205 m from its origin.* by \(-10.5, -10.5, -10.5\) m"
    ):
        robot = Robot.from_mesh((vertices + 10.0, faces))
    again = Robot.from_spec(robot.spec)
    assert again.spec == robot.spec
    with pytest.raises(GeometryError, match=r"mesh is 1\.73205 m across and lies 346\.41 m.*100"):
        Robot.from_mesh((vertices + 200.0, faces))
    spec = {**robot.spec, **make_mesh((vertices + 200.0, faces)).spec}
    with pytest.raises(InputError, match=r"mesh is 1\.73205 m across and lies 346\.41 m.*100"):
        Robot.from_spec(spec)


def test_drawings_of_the_other_dimension_are_rejected():
    with pytest.raises(GeometryError, match="an outline needs"):
        _ = Robot.ball(0.1).geometry
    with pytest.raises(GeometryError, match="a surface needs"):
        _ = Robot.disc(0.1).surface
