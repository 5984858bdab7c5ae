"""Robots from Nav2 parameters."""

import math
import warnings

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from cspace import FileError, GeometryError, InputError, Robot
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples

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


FORK = [
    (1, 0.3),
    (1, 0.2),
    (0.2, 0.2),
    (0.2, -0.2),
    (1, -0.2),
    (1, -0.3),
    (-0.5, -0.3),
    (-0.5, 0.3),
]


def pad_as_nav2(corners, padding):
    """Move each coordinate away from zero, as ``padFootprint`` in Nav2's footprint.cpp."""
    moved = [[c + math.copysign(padding, c) * (c != 0.0) for c in corner] for corner in corners]
    return shapely.make_valid(shapely.Polygon(moved))


@examples(60)
@given(
    radii=st.lists(st.floats(0.05, 1.0), min_size=3, max_size=9),
    shift=st.sampled_from([(0.0, 0.0), (0.8, 0.0), (2.0, -3.0)]),
    padding=st.floats(0.001, 0.5),
)
def test_a_padded_footprint_covers_the_footprint_grown_and_nav2s(radii, shift, padding):
    angles = 2 * np.pi * np.arange(len(radii)) / len(radii)
    corners = np.column_stack([np.cos(angles), np.sin(angles)]) * np.array(radii)[:, None] + shift
    footprint = shapely.Polygon(corners)
    with warnings.catch_warnings(action="ignore"):
        padded = Robot.from_footprint(corners, padding=padding).geometry
    rounded = padded.buffer(1e-9)
    assert rounded.covers(footprint.buffer(padding))
    assert rounded.covers(pad_as_nav2(corners, padding))
    assert footprint.buffer(np.sqrt(2) * padding * 1.001, quad_segs=64).covers(padded)


def test_a_fork_keeps_its_material_and_a_warning_says_what_nav2_would_lose():
    lost = shapely.Polygon(FORK).difference(pad_as_nav2(FORK, 0.05)).area
    with pytest.warns(UserWarning, match=f"{lost:.3g} m2 of these lie in the footprint") as heard:
        padded = Robot.from_footprint(FORK, padding=0.05)
    (warning,) = heard
    assert warning.filename == __file__ and lost > 0.05
    assert padded.geometry.buffer(1e-9).covers(shapely.Polygon(FORK).buffer(0.05))
    # The corners that the warning names are Nav2's polygon, without a warning.
    corners = np.array(FORK)
    same = Robot.from_footprint(corners + 0.05 * np.sign(corners)).geometry
    assert same.equals(pad_as_nav2(FORK, 0.05))


def test_a_rectangle_around_the_origin_is_padded_as_in_nav2():
    padded = Robot.from_footprint(FOOTPRINT, padding=0.05).geometry
    assert padded.equals(shapely.box(-0.35, -0.25, 0.35, 0.25))
    assert len(padded.exterior.coords) == 5


@pytest.mark.parametrize(
    "table, reach",
    [
        ("{robot_radius: 0.22}", 0.23),
        ('{robot_radius: 0.22, footprint_padding: 0.0, footprint: "[]"}', 0.22),
        ('{robot_radius: 9.0, footprint: "[[-1, -1], [1, -1], [1, 1], [-1, 1]]"}', 1.01),
        ("{footprint: [[-1, -1], [1, -1], [1, 1], [-1, 1]], footprint_padding: 0.5}", 1.5),
    ],
)
def test_robots_are_read_from_both_costmaps(tmp_path, table, reach):
    path = write_parameters(tmp_path, table, table)
    for robot in (Robot.open(path), Robot.open(f"{path}#local_costmap")):
        assert get_reach(robot) == reach
    path.write_text(table)  # a file of ROS 1
    assert get_reach(Robot.open(path)) == reach


def test_costmaps_that_differ_are_both_named(tmp_path):
    path = write_parameters(tmp_path, "{robot_radius: 0.2}", f'{{footprint: "{FOOTPRINT}"}}')
    message = (
        "local_costmap has a robot_radius of 0.2 m.*; "
        r"global_costmap has a footprint of 4 corners.*; pass e.g. path='.*#local_costmap'"
    )
    with pytest.raises(FileError, match=message):
        Robot.open(path)
    assert get_reach(Robot.open(f"{path}#local_costmap")) == 0.21
    assert get_reach(Robot.open(f"{path}#global_costmap")) == 0.31
    with pytest.raises(FileError, match="no costmap 'third'; it has local_costmap, global_costmap"):
        Robot.open(f"{path}#third")


@refusals(
    "table, error, message",
    ("{robot_radius: wide}", InputError, "local_costmap: robot_radius is 'wide'"),
    ("{robot_radius: 0}", InputError, "robot_radius is 0; it must be one number above zero"),
    ("{robot_radius: '0.22'}", InputError, "robot_radius is '0.22'; it must be numeric"),
    (
        "{robot_radius: 1, footprint_padding: '1'}",
        InputError,
        "footprint_padding is '1'; it must be numeric",
    ),
    ("{robot_radius: 1, footprint_padding: -1}", InputError, "footprint_padding is -1; .*zero or"),
    ("{footprint: [1, 1, -1, 1, 0, 0]}", GeometryError, "footprint is .*"),
    ('{footprint: "[[1, 1], [-1, -1], [1, -1], [-1, 1]]"}', GeometryError, "cross|intersect"),
)
def test_bad_parameters_are_named(tmp_path, table, error, message):
    with pytest.raises(error, match=message):
        Robot.open(write_parameters(tmp_path, table, table))


@pytest.mark.parametrize(
    ("corner", "padding"), [(1e308, 0.0), (1e308, 0.02), (1e150, 0.02), (0.3, 1e308)]
)
def test_lengths_whose_squares_overflow_are_refused(corner: float, padding: float) -> None:
    # GEOS looped forever over the padded polygon of the first corner.
    corners = [(0.3, 0.2), (0.3, -0.2), (corner, -0.2), (-0.3, -1.0)]
    with pytest.raises((GeometryError, InputError), match=r"(at most|to) 1e\+100"):
        Robot.from_footprint(corners, padding=padding)
