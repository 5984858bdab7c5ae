"""Every real map is read, mapped and planned on."""

import numpy as np
import pytest

import cspace
from cspace import BLOCKED, FREE, Robot, Workspace
from cspace.io.movingai import read_scenarios

ROS = ["depot", "tb3_sandbox", "100by100_10", "TenByTen", "turtlebot3_world", "willow-full-0.05", "skirk"]
MOVINGAI = ["AR0011SR", "Berlin_1_1024", "arena", "brc504d", "maze512-32-0", "random512-10-0"]


@pytest.mark.parametrize("name", ROS)
@pytest.mark.parametrize("unknown", ["occupied", "free"])
def test_ros_maps_build(data, name, unknown):
    workspace = Workspace.from_ros_map(data / "maps" / f"{name}.yaml", unknown=unknown)
    space = cspace.build(workspace, Robot.disc(0.2))
    assert not (space.state[workspace.outer] == FREE).any()
    occupied = np.argwhere(workspace.outer)[:1000]
    assert (space.classify(space.grid.center_of(occupied)) != FREE).all()


@pytest.mark.parametrize("name", MOVINGAI)
def test_movingai_pairs_are_joined(data, name):
    """A point robot: the pairs of the benchmark are joined by FREE cells of a map with a tiny robot, refined twice."""
    path = data / "movingai" / f"{name}.map"
    coarse = Workspace.from_movingai(path)
    fine = Workspace.from_array(np.repeat(np.repeat(coarse.outer, 3, axis=0), 3, axis=1), 1 / 3)
    space = cspace.build(fine, Robot.disc(0.01))
    scenarios = read_scenarios(path.with_suffix(".map.scen"))
    assert scenarios
    starts = np.array([scenario.start for scenario in scenarios]) + 0.5
    goals = np.array([scenario.goal for scenario in scenarios]) + 0.5
    assert space.is_free(starts).all() and space.is_free(goals).all()
    assert all(answer is True for answer in space.path_exists(starts, goals))
    undecided = cspace.build(coarse, Robot.disc(0.01)).path_exists(starts, goals)
    assert all(answer is not False for answer in undecided)  # in a corridor one cell wide the grid cannot decide


@pytest.mark.parametrize("name", MOVINGAI)
def test_movingai_maps_build_for_a_disc(data, name):
    workspace = Workspace.from_movingai(data / "movingai" / f"{name}.map")
    space = cspace.build(workspace, Robot.disc(2.0))
    assert (space.state[workspace.outer] == BLOCKED).all()


@pytest.mark.parametrize("name", ["normal", "thin"])
def test_mazes_build(data, name):
    workspace = Workspace.from_image(data / "maps" / f"{name}.ppm", 1.0)
    assert workspace.grid.shape == (450, 450)
    space = cspace.build(workspace, Robot.disc(1.5))
    assert {0, 1, 2} == set(np.unique(space.state).tolist())


def test_the_parking_lot_builds(data):
    workspace = Workspace.from_polygons(data / "polygons" / "parking1.geojson", 0.1)
    space = cspace.build(workspace, Robot.open(data / "polygons" / "car.geojson"), outside="free")
    assert (space.state == BLOCKED).any() and (space.state == FREE).any()
