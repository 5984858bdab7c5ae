"""Plans on tiled maps."""

import numpy as np
import pytest

import cspace
import planners
from cspace.errors import ConfigurationError, InputError
from planners._edges.drives import local_planner
from tests.helpers.refusals import refusals

SMALL_CAR = cspace.Robot.rectangle(0.5, 0.2)


def build_maze(side=60, extra=()):
    """Build walls with gaps at alternate ends."""
    walls = np.zeros((side, side), dtype=bool)
    for k, x in enumerate(range(15, side - 5, 15)):
        walls[x : x + 2] = True
        walls[x : x + 2, slice(3, 15) if k % 2 else slice(side - 15, side - 3)] = False
    walls[list(extra)] = True
    return cspace.Workspace.from_array(walls, 0.1)


@pytest.fixture(scope="module")
def tiled_maze(tmp_path_factory):
    store = tmp_path_factory.mktemp("maze") / "m"
    return cspace.build(build_maze(), cspace.Robot.disc(0.25), store=store, tile=20)


@pytest.fixture(scope="module")
def car_maps(tmp_path_factory):
    """Build a tiled map, and the same map in memory."""
    store = tmp_path_factory.mktemp("car") / "m"
    tiled = cspace.build(build_maze(), SMALL_CAR, rotations=16, store=store, tile=30)
    return tiled, cspace.build(build_maze(), SMALL_CAR, rotations=16)


@pytest.mark.parametrize("low, spacing", [(0.0, 0.3), (0.3, 0.1), (-1.2, 0.07), (33333.1, 0.05)])
def test_paths_end_on_the_upper_border_of_a_tiled_map(low, spacing, tmp_path):
    walls = np.zeros((19, 19), dtype=bool)
    walls[8:10, 3:16] = True
    workspace = cspace.Workspace.from_array(walls, spacing, (low, low))
    disc = cspace.Robot.disc(1.83 * spacing)
    space = cspace.build(workspace, disc, outside="free", store=tmp_path / "m", tile=8)
    lower, upper = np.array(space.bounds)
    for ends in ((lower, upper), (upper, lower), ((upper[0], lower[1]), (lower[0], upper[1]))):
        plan = planners.plan(space, *ends, planner="Grid")
        assert plan.certified
        assert np.array_equal(plan.waypoints[[0, -1]], ends)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"drive": planners.Car(turning_radius=0.3, reverse=True)},
        {"drive": planners.Differential()},
        {"objective": "clearance", "planner": "RRTstar", "time_limit": 0.05},
        {"planner": "RRTConnect"},
    ],
    ids=str,
)
def test_paths_through_tiles_are_certified_and_repeatable(options, car_maps):
    # Tiles are planned in memory; the path is also proven on the whole map in memory.
    tiled, space = car_maps
    ends = [0.7, 0.9, 0.1], [5.3, 4.9, 0.1]
    options = {"time_limit": 3.0, "seed": 1, **options}
    plan = planners.plan(tiled, *ends, **options)
    assert plan.certified and plan.is_connected and "through" in plan.status
    assert plan.recheck().all() and plan.length > 10.0
    np.testing.assert_allclose(plan.waypoints[[0, -1]], ends)
    edges = local_planner(space, options.get("drive"))
    assert edges.are_free(plan.waypoints)
    # The clearance of a map in tiles ends at the width of its halo, less two cells.
    clearance = edges.clearance(plan.waypoints)
    farthest = (
        min(64, max(4, min(tiled.tile) // 16)) - 2
    ) * tiled.grid.spacing - 0.5 * space.resolution
    assert min(clearance, farthest) - 1e-9 <= plan.clearance <= clearance + 1e-9
    assert any(line.get_label() == "path" for line in plan.plot().lines)  # over an overview
    if "objective" not in options:
        again = planners.plan(tiled, *ends, **options)
        np.testing.assert_array_equal(plan.waypoints, again.waypoints)


@refusals(
    "options, message",
    ({"start": [-0.7, 0.7]}, r"start .* lies outside"),
    ({"goal": [1.55, 2.0]}, r"goal .*BLOCKED.*the nearest is"),
)
def test_plans_on_tiled_maps_reject_invalid_arguments(tiled_maze, options, message):
    with pytest.raises((InputError, ConfigurationError), match=message) as caught:
        planners.plan(tiled_maze, **{"start": [0.7, 0.7], "goal": [0.7, 5.0], **options})
    assert "start" in options or tiled_maze.is_free(caught.value.nearest)
