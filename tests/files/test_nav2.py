"""Robots from Nav2 parameters."""

import pytest
import shapely

from cspace import FileError, GeometryError, InputError, Robot
from tests.helpers.refusals import refusals

FOOTPRINT = "[[0.3, .2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"

NAV2 = """
amcl:
  ros__parameters: {robot_model_type: "nav2_amcl::DifferentialMotionModel"}
local_costmap:
  local_costmap:
    ros__parameters: {LOCAL}
global_costmap:
  global_costmap:
    ros__parameters: {GLOBAL}
"""


def write_parameters(folder, local, world):
    path = folder / "nav2_params.yaml"
    path.write_text(NAV2.replace("{LOCAL}", local).replace("{GLOBAL}", world))
    return path


def get_reach(robot):
    """Return the largest x of a robot."""
    return pytest.approx(robot.geometry.bounds[2])


def test_a_footprint_is_its_polygon():
    robot = Robot.from_footprint(FOOTPRINT)
    assert robot.geometry.equals(shapely.box(-0.3, -0.2, 0.3, 0.2))
    assert Robot.parse(f"footprint:{FOOTPRINT}").geometry.equals(robot.geometry)


def test_padding_moves_each_coordinate_away_from_zero():
    corners = [(0.5, 0), (0, 0.25), (-0.5, 0), (0, -0.5)]
    padded = Robot.from_footprint(corners, padding=0.25).geometry
    assert padded.equals(shapely.Polygon([(0.75, 0), (0, 0.5), (-0.75, 0), (0, -0.75)]))


@pytest.mark.parametrize(
    ("table", "reach"),
    [
        ("{robot_radius: 0.22}", 0.23),
        ('{robot_radius: 0.22, footprint_padding: 0.0, footprint: "[]"}', 0.22),
        ('{robot_radius: 9.0, footprint: "[[-1, -1], [1, -1], [1, 1], [-1, 1]]"}', 1.01),
        ("{footprint: [[-1, -1], [1, -1], [1, 1], [-1, 1]], footprint_padding: 0.5}", 1.5),
    ],
)
def test_robots_are_read_from_both_costmaps(tmp_path, table, reach):
    path = write_parameters(tmp_path, table, table)
    for robot in (Robot.from_nav2(path), Robot.open(path), Robot.open(f"{path}#local_costmap")):
        assert get_reach(robot) == reach
    path.write_text(table)  # a file of ROS 1
    assert get_reach(Robot.open(path)) == reach


def test_costmaps_that_differ_are_both_named(tmp_path):
    path = write_parameters(tmp_path, "{robot_radius: 0.2}", f'{{footprint: "{FOOTPRINT}"}}')
    message = (
        "local_costmap has a robot_radius of 0.2 m.*; "
        r"global_costmap has a footprint of 4 corners.*; pass e.g. costmap='local_costmap'"
    )
    with pytest.raises(FileError, match=message):
        Robot.from_nav2(path)
    assert get_reach(Robot.from_nav2(path, "local_costmap")) == 0.21
    assert get_reach(Robot.open(f"{path}#global_costmap")) == 0.31
    with pytest.raises(FileError, match="no costmap 'third'; it has local_costmap, global_costmap"):
        Robot.from_nav2(path, "third")


@refusals(
    "table, error, message",
    ("{resolution: 0.05}", FileError, "neither footprint nor robot_radius"),
    ("{robot_radius: wide}", InputError, "local_costmap: robot_radius is 'wide'"),
    ('{footprint: "[[1, 1], [2, 2]]"}', GeometryError, "local_costmap: footprint is .* three"),
)
def test_bad_parameters_are_named(tmp_path, table, error, message):
    with pytest.raises(error, match=message):
        Robot.from_nav2(write_parameters(tmp_path, table, table))
