"""The options that a message names, with their values, make the right world."""

import ast
import re
import warnings

import numpy as np
import pytest
import xarray
from PIL import Image

import cspace
import planners
from cspace import Robot, Workspace, build

OPTION = re.compile(r"\b(\w+)=('[^']*'|True|False|-?\d[\d.e-]*)")
"""Option in a message, and its value."""

CONVERTED = re.compile(r"pass (?:seconds, e\.g\. )?([\d.]+) for [\d.]+ (?:degrees|ms)")
"""Value of the option that was refused, in our unit."""

WALL = np.zeros((30, 20), dtype=bool)
WALL[4, 2:9] = True


def read_advice(call):
    """Return the options that a refusal advises, or else a warning."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            call()
        except cspace.CspaceError as error:
            text = error.hint
        else:
            text = str(caught[-1].message)
    options = {name: ast.literal_eval(value) for name, value in OPTION.findall(text)}
    converted = CONVERTED.search(text)
    return options | ({"value": float(converted[1])} if converted else {})


def open_array(array, **options):
    return Workspace.from_array(array, **{"spacing": 0.1} | options)


def label(cells, spacing):
    """Return cells with the coordinates of their centers."""
    coordinates = {
        name: spacing * (np.arange(count) + 0.5)
        for name, count in zip("xy", cells.shape, strict=True)
    }
    return xarray.DataArray(cells, dims=("x", "y"), coords=coordinates)


def write_ros_image(folder):
    """Write the image of a ROS map, all unknown but a free and an occupied cell."""
    pixels = np.full((20, 30), 205, dtype=np.uint8)
    pixels[:, :10] = 254
    pixels[5] = 0
    Image.fromarray(pixels).save(folder / "map.pgm")
    lines = ["image: map.pgm", "resolution: 0.1", "origin: [0, 0, 0]", "negate: 0"]
    thresholds = ["occupied_thresh: 0.65", "free_thresh: 0.196"]
    (folder / "map.yaml").write_text("\n".join(lines + thresholds))
    return folder / "map.pgm"


def write_nav2(folder):
    """Write the parameters of two costmaps with robots of different radius."""
    path = folder / "nav2.yaml"
    lines = [
        "{0}:",
        "  {0}:",
        "    ros__parameters:",
        "      robot_radius: {1}",
        "      footprint_padding: 0.0",
        "",
    ]
    costmap = "\n".join(lines)
    path.write_text(costmap.format("local_costmap", 0.2) + costmap.format("global_costmap", 0.4))
    return path


def write_urdf(folder, kind):
    """Write a robot of one link whose box is drawn, or collides."""
    path = folder / kind / "robot.urdf"
    path.parent.mkdir(exist_ok=True)
    box = f'<{kind}><geometry><box size="0.4 0.2 0.1"/></geometry></{kind}>'
    path.write_text(f'<robot name="r"><link name="base">{box}</link></robot>')
    return path


def write_points(folder):
    path = folder / "scan.npy"
    np.save(path, np.array([[0.5, 0.5, 0.5], [np.nan] * 3, [1.5, 0.5, 0.5]]))
    return path


def open_points(path, **options):
    return Workspace.open(path, spacing=0.1, radius=0.1, **options)


def tilted_pose():
    pose = cspace.ros.PoseStamped()
    pose.header.frame_id = "map"
    pose.pose.orientation.x, pose.pose.orientation.w = np.sin(0.05), np.cos(0.05)
    return pose


def write_grey_map(folder):
    """Write a ROS map with a grey that map savers write for unknown cells, below free_thresh."""
    path = write_ros_image(folder).with_suffix(".yaml")
    path.write_text(path.read_text().replace("0.196", "0.25"))
    return path


def turning():
    return build(Workspace.from_array(WALL, 0.1), Robot.disc(0.05), rotations=4)


@pytest.mark.parametrize(
    "call, right",
    [
        pytest.param(
            lambda _, **options: open_array(label(WALL, 0.5), **options),
            lambda _: Workspace.from_array(WALL, 0.5),
            id="the spacing of labelled cells",
        ),
        pytest.param(
            lambda folder, **options: Workspace.from_image(write_ros_image(folder), 0.1, **options),
            lambda folder: Workspace.from_ros_map(write_ros_image(folder).with_suffix(".yaml")),
            id="the threshold of a picture with unknown cells",
        ),
        pytest.param(
            lambda folder, **options: open_points(write_points(folder), **options),
            lambda _: Workspace.from_points([(0.5, 0.5, 0.5), (1.5, 0.5, 0.5)], 0.1, radius=0.1),
            id="points without coordinates",
        ),
        pytest.param(
            lambda folder, **options: Robot.from_nav2(write_nav2(folder), **options),
            lambda _: Robot.disc(0.2),
            id="one of two costmaps",
        ),
        pytest.param(
            lambda _, **options: cspace.ros.configuration_of(tilted_pose(), turning(), **options),
            lambda _: (0.0, 0.0, 0.0),
            id="a pose that is tilted a little",
        ),
        pytest.param(
            lambda _, value=30.0: planners.Upright("hand", tolerance=value).tolerance,
            lambda _: np.radians(30.0),
            id="an angle in degrees",
        ),
        pytest.param(
            lambda _, value=100.0: cspace.Gate(turning(), dt=value, max_velocity=1.0).dt,
            lambda _: 0.1,
            id="milliseconds",
        ),
        pytest.param(
            lambda folder, **options: Workspace.from_ros_map(write_grey_map(folder), **options),
            lambda folder: Workspace.from_image(write_ros_image(folder), 0.1, threshold=0.1),
            id="unknown cells of a map as free",
        ),
        pytest.param(
            lambda folder, **options: Robot.open(write_urdf(folder, "visual"), **options),
            lambda folder: Robot.open(write_urdf(folder, "collision")),
            id="links that are only drawn",
        ),
    ],
)
def test_the_options_that_a_message_names_make_the_right_world(call, right, tmp_path):
    options = read_advice(lambda: call(tmp_path))
    assert options
    with warnings.catch_warnings(action="ignore"):
        assert describe(call(tmp_path, **options)) == describe(right(tmp_path))


def describe(world):
    """Return what tells worlds apart: cells and places, outlines, numbers."""
    if isinstance(world, Workspace):
        return world.grid.lower, world.grid.spacing, world.outer.tolist()
    if isinstance(world, Robot):
        return world.spec
    return np.round(world, 6).tolist()


def test_a_robot_in_space_is_mapped_by_its_footprint():
    plane = Workspace.from_array(WALL, 0.1)
    with pytest.raises(cspace.CspaceError) as refused:
        build(plane, Robot.box((0.4, 0.2, 0.5)))
    robot = Robot.box((0.4, 0.2, 0.5))
    advised = eval(refused.value.hint.removeprefix("use "), {"robot": robot})
    states = build(plane, advised, outside="free").cell_states
    assert (states == build(plane, Robot.rectangle(0.4, 0.2), outside="free").cell_states).all()
