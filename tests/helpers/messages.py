"""Messages and map files of ROS, without ROS."""

import json
import math
from array import array
from types import SimpleNamespace

import numpy as np
import yaml
from PIL import Image

import cspace
from cspace import Robot, Workspace
from tests.helpers.handmade import fill_boxes


def make_message(values, resolution=0.05, origin=(0.0, 0.0), yaw=0.0):
    """Make a ROS message; values start at the lowest y."""
    height, width = np.shape(values)
    turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    corner = SimpleNamespace(x=origin[0], y=origin[1], z=0.0)
    place = SimpleNamespace(position=corner, orientation=turn)
    info = SimpleNamespace(resolution=resolution, width=width, height=height, origin=place)
    return SimpleNamespace(info=info, data=array("b", np.ravel(values).tolist()))


def make_grid(frame_id="odom", values=None):
    """Make a grid message of cells of 0.1 m, shape (height, width); by default all are free."""
    values = np.zeros((20, 30), int) if values is None else values
    grid = cspace.ros.OccupancyGrid()
    grid.header.frame_id = frame_id
    grid.info.height, grid.info.width = np.shape(values)
    grid.info.resolution = 0.1
    grid.data.extend(np.ravel(values).tolist())
    return grid


def as_mapping(message):
    """Return a message as rosbridge sends it."""
    return json.loads(json.dumps(message, default=lambda x: getattr(x, "__dict__", None) or [*x]))


def build_spaces():
    """Build the maps of a disc and of a car that turns, in a room."""
    cells = fill_boxes((40, 30), np.s_[20, :18], np.s_[5:8, 22:26])
    workspace = Workspace.from_array(cells, 0.1, (-1.0, 2.0))
    car = Robot.rectangle(0.5, 0.3)
    return {
        "disc": cspace.build(workspace, Robot.disc(0.23)),
        "car": cspace.build(workspace, car, rotations=6),
    }


MAP_HEADER = {
    "image": "map.png",
    "resolution": 0.5,
    "origin": [-1.0, 2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def write_map(folder, pixels, **changes):
    """Write a ROS map; a change to None removes a key."""
    header = {key: value for key, value in (MAP_HEADER | changes).items() if value is not None}
    Image.fromarray(pixels).save(folder / "map.png")
    (folder / "map.yaml").write_text(yaml.safe_dump(header))
    return folder / "map.yaml"
