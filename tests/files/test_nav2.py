"""Robots from Nav2 parameters."""

import numpy as np
import pytest
import shapely

from cspace import FileError, GeometryError, InputError, Robot
from tests.helpers.refusals import refusals

FOOTPRINT_TEXT = "[[0.3, .2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"

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


def test_a_footprint_is_its_polygon():
    robot = Robot.from_footprint(FOOTPRINT_TEXT)
    assert robot.geometry.equals(shapely.box(-0.3, -0.2, 0.3, 0.2))
    assert Robot.parse(f"footprint:{FOOTPRINT_TEXT}").geometry.equals(robot.geometry)
    assert Robot.from_footprint([(0, 0), (1, 0), (0, 1)]).geometry.area == 0.5


def test_padding_moves_each_coordinate_away_from_zero():
    """Keep zeros; move other corners along both axes."""
    padded = Robot.from_footprint(
        [(0.5, 0), (0, 0.25), (-0.5, 0), (0, -0.5)], padding=0.25
    ).geometry
    assert padded.equals(shapely.Polygon([(0.75, 0), (0, 0.5), (-0.75, 0), (0, -0.75)]))


@pytest.mark.parametrize(
    ("table", "bounds"),
    [
        ("{robot_radius: 0.22}", 0.23),
        ("{robot_radius: 0.22, footprint_padding: 0.0}", 0.22),
        ('{robot_radius: 0.22, footprint: "[]"}', 0.23),
        ('{robot_radius: 0.22, footprint: ""}', 0.23),
        ('{robot_radius: 9.0, footprint: "[[-1, -1], [1, -1], [1, 1], [-1, 1]]"}', 1.01),
        ("{footprint: [[-1, -1], [1, -1], [1, 1], [-1, 1]], footprint_padding: 0.5}", 1.5),
    ],
)
def test_read_nav2_reads_both_costmaps(tmp_path, table, bounds):
    path = write_parameters(tmp_path, table, table)
    for robot in (Robot.from_nav2(path), Robot.open(path), Robot.open(f"{path}#local_costmap")):
        assert robot.geometry.bounds == pytest.approx((-bounds, -bounds, bounds, bounds))


def test_read_nav2_reads_ros_1_files_and_several_robots(tmp_path):
    (tmp_path / "costmap_common_params.yaml").write_text(
        "robot_radius: 0.4\nfootprint_padding: 0.1\n"
    )
    assert Robot.open(tmp_path / "costmap_common_params.yaml").geometry.bounds[2] == pytest.approx(
        0.5
    )
    path = tmp_path / "two.yaml"
    path.write_text(
        "".join(
            f"r{n}:\n  local_costmap:\n    ros__parameters:\n      robot_radius: {n}\n"
            for n in (1, 2)
        )
    )
    assert Robot.from_nav2(path, "r2/local_costmap").geometry.bounds[2] == pytest.approx(2.01)


def test_costmaps_that_differ_are_both_named(tmp_path):
    path = write_parameters(tmp_path, "{robot_radius: 0.2}", f'{{footprint: "{FOOTPRINT_TEXT}"}}')
    with pytest.raises(FileError) as caught:
        Robot.from_nav2(path)
    for message in (
        "local_costmap has a robot_radius of 0.2 m",
        "global_costmap has a footprint of 4 corners",
        "costmap='",
    ):
        assert message in str(caught.value)
    assert Robot.from_nav2(path, "local_costmap").geometry.bounds[2] == pytest.approx(0.21)
    assert Robot.open(f"{path}#global_costmap").geometry.bounds[2] == pytest.approx(0.31)
    with pytest.raises(FileError, match="no costmap 'third'; it has local_costmap, global_costmap"):
        Robot.from_nav2(path, "third")


@refusals(
    "table, error, message",
    ("{resolution: 0.05}", FileError, "neither footprint nor robot_radius"),
    ("{robot_radius: -1}", InputError, "local_costmap: robot_radius is -1"),
    ("{robot_radius: wide}", InputError, "robot_radius is 'wide'"),
    ("{robot_radius: 0.2, footprint_padding: -0.1}", InputError, "footprint_padding is -0.1"),
    ("{robot_radius: 0.2, footprint_padding: [1]}", InputError, "footprint_padding is"),
    (
        '{footprint: "[[1, 1], [2, 2]]"}',
        GeometryError,
        "local_costmap: footprint is .* three points",
    ),
    ('{footprint: "[[1, 1], [2"}', GeometryError, "three points"),
    ('{footprint: "[[0, 0], [1, 1], [1, 0], [0, 1]]"}', GeometryError, "is not valid"),
    ("{footprint: {x: 1}}", GeometryError, "three points"),
)
def test_bad_parameters_are_named(tmp_path, table, error, message):
    with pytest.raises(error, match=message):
        Robot.from_nav2(write_parameters(tmp_path, table, table))


@pytest.mark.parametrize(
    "footprint",
    [
        "",
        "[]",
        "0.3",
        "[[" * 200,
        "__import__('os')",
        "[[1, 2, 3]] * 3",
        None,
        [[1, 2], [3]],
        [[np.nan] * 2] * 3,
    ],
)
def test_invalid_footprints_are_refused(footprint):
    with pytest.raises(GeometryError, match="at least three points"):
        Robot.from_footprint(footprint)
    with pytest.raises(InputError, match="padding is -1"):
        Robot.from_footprint(FOOTPRINT_TEXT, padding=-1)
