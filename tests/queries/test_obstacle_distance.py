"""Distances of the robot from obstacles, against shapely."""

import numpy as np
import pytest
import shapely
from shapely import affinity

import cspace


def test_each_configuration_of_a_batch_has_its_distance():
    boxes = [shapely.box(1.0, 0.4, 1.4, 1.1), shapely.box(2.1, 1.2, 2.6, 1.9)]
    workspace = cspace.Workspace.from_polygons(boxes, 0.1, (0.0, 0.0, 3.0, 2.0))
    space = cspace.build(workspace, cspace.Robot.rectangle(0.4, 0.2), rotations=24)
    robot = shapely.box(-0.2, -0.1, 0.2, 0.1)
    obstacles = shapely.union_all([*boxes, shapely.box(0.0, 0.0, 3.0, 2.0).exterior])
    q = space.sample_free(12, np.random.default_rng(3)).reshape(3, 4, 3)
    distances = space.obstacle_distance(q)
    assert distances.shape == (3, 4)
    for (x, y, yaw), distance in zip(q.reshape(-1, 3), distances.ravel(), strict=True):
        placed = affinity.rotate(robot, yaw, origin=(0.0, 0.0), use_radians=True)
        expected = affinity.translate(placed, x, y).distance(obstacles)
        assert distance == pytest.approx(expected, abs=1e-6)
        assert space.obstacle_distance((x, y, yaw)) == distance
    assert space.obstacle_distance((1.2, 0.7, 0.0)) == 0.0
