"""Paths through MIXED cells that exact geometry proves free."""

import itertools

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import Robot, Workspace
from cspace.queries.paths import path_length
from tests.helpers.placements import collides
from tests.helpers.planning import sample_edge
from tests.helpers.strategies import seeds

SIDE = 4.0
"""Side of the drawn rooms in metres."""


def build_gap(width, robot, rotations=None):
    """Build two halves of a room joined by a gap near a wall and a wide door far away; return the
    walls too."""
    walls = [shapely.box(1.9, 0.0, 2.1, 0.43), shapely.box(1.9, 0.43 + width, 2.1, 3.0)]
    workspace = Workspace.from_polygons(walls, 0.1, bounds=(0.0, 0.0, SIDE, SIDE))
    return cspace.build(workspace, robot, rotations=rotations, outside="free"), walls


@settings(max_examples=40)
@given(seeds, st.sampled_from([None, 8]))
def test_exact_paths_keep_clear_of_obstacles_and_are_no_longer(seed, rotations):
    rng = np.random.default_rng(seed)
    corners, sides = rng.uniform(0.0, SIDE, (6, 2)), rng.uniform(0.1, 1.2, (6, 2))
    obstacles = [
        shapely.box(*corner, *(corner + side)) for corner, side in zip(corners, sides, strict=True)
    ]
    robot = Robot.rectangle(*rng.uniform(0.1, 0.5, 2))
    workspace = Workspace.from_polygons(
        obstacles, rng.uniform(0.08, 0.2), bounds=(0.0, 0.0, SIDE, SIDE)
    )
    space = cspace.build(workspace, robot, rotations=rotations)
    start, goal = rng.uniform(space.grid.lower, space.grid.upper, (2, 2))
    yaw = [0.3] if rotations else []
    ends = np.array([(*start, *yaw), (*goal, *yaw)])
    if not space.is_free(ends, exact=True).all():
        return
    path = space.find_path(*ends, exact=True)
    chain = space.find_path(*ends, exact=True, straight=False)
    if space.is_free(ends).all():
        through_free = space.find_path(*ends)
        assert len(path) >= min(2, len(through_free))
        if len(through_free):
            assert path_length(path, space.rotations) <= path_length(
                through_free, space.rotations
            ) * (1.0 + 1e-9)
    for found in (path, chain):
        for first, last in itertools.pairwise(found):
            assert not collides(
                space, sample_edge(space, first, last, np.linspace(0.0, 1.0, 60))[0]
            ).any()
    if len(path):
        assert (path[[0, -1], :2] == ends[:, :2]).all()
        assert space.min_path_length(*ends) <= path_length(path, space.rotations) * (1.0 + 1e-6)
    else:
        assert not space.motion_is_free(*ends, exact=True)


def test_exact_paths_turn_where_the_gap_demands_it():
    space, walls = build_gap(0.3, Robot.rectangle(0.6, 0.22), rotations=24)
    start, goal = (1.0, 1.0, 1.5), (3.0, 1.0, 1.5)
    assert len(space.find_path(start, goal)) and space.find_path(start, goal)[:, 1].max() > 3.0
    path = space.find_path(start, goal, exact=True)
    assert path[:, 1].max() < 1.1 and space.certify_path(path, exact=True).all()
    for first, last in itertools.pairwise(path):
        assert not collides(
            space, sample_edge(space, first, last, np.linspace(0.0, 1.0, 200))[0], walls
        ).any()
