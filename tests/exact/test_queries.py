"""Exact queries of every space: batches, checkers, threads and refusals."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely
import shapely.affinity
import trimesh

import cspace
from cspace import MIXED, InputError, Robot, Rotations, Workspace
from tests.helpers.handmade import configurations
from tests.helpers.placements import draw_near_mixed


def build_plane(rotations=None):
    workspace = Workspace.from_array(np.random.default_rng(5).random((40, 30)) < 0.03, 0.1)
    return cspace.build(workspace, Robot.rectangle(0.33, 0.21), rotations=rotations)


def build_spatial(robot, **options):
    rng = np.random.default_rng(5)
    workspace = Workspace.from_balls(rng.uniform(0, 2, (12, 3)), 0.05, 0.1, (0, 0, 0, 2, 2, 2))
    return cspace.build(workspace, robot, **options)


EXACT_SPACES = {
    "plane": build_plane,
    "turning": lambda: build_plane(24),
    "box with yaw": lambda: build_spatial(Robot.box((0.3, 0.1, 0.2)), rotations=6),
    "box any way": lambda: build_spatial(
        Robot.box((0.3, 0.1, 0.2)), rotations=Rotations.quaternions(2)
    ),
    "mesh": lambda: build_spatial(Robot.from_mesh(trimesh.creation.icosphere(1, 0.2))),
    "balls": lambda: build_spatial(
        Robot.from_balls([[0, 0, 0], [0.1, 0, 0]], [0.1, 0.15]), margin=0.02
    ),
}


@pytest.fixture(scope="module", params=EXACT_SPACES)
def make(request):
    return EXACT_SPACES[request.param]


def test_batches_checkers_and_threads_agree_with_single_queries(make):
    space = make()
    other = make()
    rng = np.random.default_rng(1)
    q0 = draw_near_mixed(space, rng, 300, around=0.1)
    q1 = configurations(space, q0 + rng.normal(0.0, 0.2, q0.shape))
    free = space.exact.is_free(q0)
    edges = space.exact.motion_is_free(q0, q1)
    assert 0 < free.sum() < 300 and 0 < edges.sum() < 300
    assert free.dtype == edges.dtype == np.bool_
    assert (
        free[np.asarray(space.is_free(q0))].all()
        and edges[np.asarray(space.motion_is_free(q0, q1))].all()
    )
    point = other.exact.point_checker()
    edge = other.exact.edge_checker()
    pairs = list(zip(q0.tolist(), q1.tolist(), strict=True))
    with ThreadPoolExecutor(8) as pool:
        parts = [pairs[k::8] for k in range(8)]
        answers = list(pool.map(lambda part: [(point(*a), edge(*a, *b)) for a, b in part], parts))
    for k in range(8):
        assert answers[k] == list(zip(free[k::8].tolist(), edges[k::8].tolist(), strict=True))


def test_queries_refuse_shapes_that_depend_on_the_spacing():
    space = build_spatial(Robot.from_mesh(trimesh.creation.box((0.3, 0.3, 0.3)), solid="fill"))
    with pytest.raises(InputError, match=r"mesh has solid='fill'.*depends"):
        space.exact.is_free([1.0, 1.0, 1.0])


@pytest.mark.parametrize("dim", [2, 3])
def test_obstacles_end_at_the_bounds_of_the_grid(dim):
    """Put a ball of the robot beyond a clipped obstacle."""
    bounds = [0.0] * dim + [6.0] * dim
    if dim == 2:
        workspace = Workspace.from_polygons([shapely.box(2, 2, 4, 10)], 0.25, bounds)
    else:
        mesh = trimesh.creation.box(bounds=[(2, 2, 2), (4, 10, 4)])
        workspace = Workspace.from_mesh(mesh, 0.25, bounds)
    robot = Robot.from_balls(np.array([(0.0, 0.0, 0.0), (1.07, 3.0, 0.0)])[:, :dim], [0.05, 0.05])
    near = np.array([1.93, 5.0, 3.0])[:dim]
    space = cspace.build(workspace, robot, outside="free")
    assert space.classify(near) == MIXED
    assert space.exact.is_free(near)
    assert not space.exact.is_free(near + np.eye(dim)[0] * 0.03)
    assert not cspace.build(workspace, robot, outside="blocked").exact.is_free(near)
