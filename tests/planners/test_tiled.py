"""Plans on maps in a store: from tile to tile, certified, and refused as on a map in memory."""

from __future__ import annotations

import numpy as np
import pytest

import cspace
import planners
from cspace.errors import ConfigurationError, InputError

CAR = cspace.Robot.rectangle(0.5, 0.2)


def maze(side=90):
    """Walls with gaps at alternate ends, so that the way winds through many tiles."""
    walls = np.zeros((side, side), dtype=bool)
    for k, x in enumerate(range(15, side - 5, 15)):
        walls[x : x + 2] = True
        walls[x : x + 2, slice(3, 15) if k % 2 else slice(side - 15, side - 3)] = False
    return cspace.Workspace.from_array(walls, 0.1)


@pytest.mark.parametrize(("robot", "rotations"), [(cspace.Robot.disc(0.25), None), (CAR, 12)])
def test_a_path_through_many_tiles(robot, rotations, tmp_path):
    tiled = cspace.build(maze(), robot, rotations=rotations, store=tmp_path / "m", tile=20)
    space = cspace.build(maze(), robot, rotations=rotations)
    turn = [0.1] * (space.dof - 2)
    start, goal = [0.7, 0.7, *turn], [8.5, 8.4, *turn]
    found = planners.plan(tiled, start, goal, seed=1)
    assert found.solved
    assert found.certified
    assert "nan" not in repr(found)
    assert found.path_exists is True
    np.testing.assert_allclose(found.waypoints[[0, -1]], [start, goal])
    assert space.certify_path(found.waypoints).all()
    assert found.length > 30.0
    again = planners.plan(tiled, start, goal, seed=1)
    np.testing.assert_array_equal(found.waypoints, again.waypoints)


def test_within_one_tile_and_on_the_spot(tmp_path):
    tiled = cspace.build(maze(), cspace.Robot.disc(0.25), store=tmp_path / "m", tile=1000)
    assert planners.plan(tiled, [0.7, 0.7], [0.7, 5.0], seed=0).certified
    assert planners.plan(tiled, [0.7, 0.7], [0.7, 0.7]).certified


def test_what_is_proven_not_to_exist(tmp_path):
    walls = maze().outer.copy()
    walls[45:47] = True
    workspace = cspace.Workspace.from_array(walls, 0.1)
    tiled = cspace.build(workspace, cspace.Robot.disc(0.25), store=tmp_path / "m", tile=20)
    found = planners.plan(tiled, [0.7, 0.7], [8.5, 8.4])
    assert not found.solved
    assert found.path_exists is False
    assert "proven" in found.status


def test_what_is_refused(tmp_path):
    tiled = cspace.build(maze(), cspace.Robot.disc(0.25), store=tmp_path / "m", tile=20)
    with pytest.raises(ConfigurationError, match=r"goal .*BLOCKED.*the nearest is") as caught:
        planners.plan(tiled, [0.7, 0.7], [1.55, 4.0])
    assert tiled.is_free(caught.value.nearest)
    with pytest.raises(ConfigurationError, match="start lies outside"):
        planners.plan(tiled, [-0.7, 0.7], [0.7, 0.7])
    for option in ({"exact": True}, {"curve": "dubins", "turning_radius": 1.0}, {"objective": "clearance"}):
        with pytest.raises(InputError, match="in a store"):
            planners.plan(tiled, [0.7, 0.7], [0.7, 5.0], **option)
