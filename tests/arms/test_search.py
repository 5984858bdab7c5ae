"""Paths of arms, proven and reproducible."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import scipy.sparse.csgraph

from cspace.arms import Arm, ArmSpace, build_arm_space
from cspace.arms.search import SAMPLES_PER_BATCH
from cspace.errors import ConfigurationError, InputError
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import planar, posed_box, random_arm, two_arms

START, GOAL = (-1.2, 0.4), (1.2, -0.4)
IN_WALL = (0.0, 0.0)


@pytest.fixture(scope="module", params=[0.1, 0.001], ids=["wall", "sheet"])
def space(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ArmSpace:
    """Build an arm that passes a wall only folded.

    The sheet is so thin that sampling a motion misses it.
    """
    arm = Arm.from_urdf(planar(tmp_path_factory.mktemp("arm")))
    return build_arm_space({"wall": posed_box((0.9, request.param, 1.0), 1.55, 0.0, 0.0)}, arm)


@pytest.mark.parametrize("straight", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_path_around_a_wall_is_proven_and_reproducible(
    space: ArmSpace, straight: bool, seed: int
) -> None:
    path = space.find_path(START, GOAL, seed=seed, straight=straight)
    assert not space.motion_is_free(START, GOAL)
    np.testing.assert_array_equal(path[[0, -1]], [START, GOAL])
    assert space.certify_path(path).all()
    along = np.concatenate([np.linspace(*edge, 200) for edge in pairwise(path)])
    assert np.abs(along[np.abs(along[:, 0]).argmin(), 1]) > 1.5  # it folds to pass
    np.testing.assert_array_equal(path, space.find_path(START, GOAL, seed=seed, straight=straight))


def test_find_path_reaches_any_free_goal(space: ArmSpace) -> None:
    near = (-1.0, 0.3)
    path = space.find_path(START, [IN_WALL, GOAL, near], seed=1)
    np.testing.assert_array_equal(path, [START, near])
    np.testing.assert_array_equal(space.find_path(START, [IN_WALL, GOAL], seed=1)[-1], GOAL)


@pytest.mark.parametrize("turns", [-1, 0, 2])
@pytest.mark.parametrize(("first", "last"), [(3.0, -3.0), (-3.0, 3.0)])
def test_path_of_a_continuous_joint_takes_the_shorter_way(
    tmp_path: Any, first: float, last: float, turns: int
) -> None:
    space = build_arm_space({}, Arm.from_urdf(planar(tmp_path, kind="continuous", limits=None)))
    start, goal = (first, 0.4), (last + turns * 2.0 * np.pi, 0.6)
    path = space.find_path(start, goal, seed=1)
    assert len(path) == 2
    np.testing.assert_array_equal(path[0], start)
    np.testing.assert_allclose(path[1], (first + math.remainder(last - first, 2.0 * np.pi), 0.6))
    assert space.certify_path(path).all()


def test_path_of_a_continuous_joint_goes_the_longer_way_if_only_that_is_free(tmp_path: Any) -> None:
    """Block the shorter way by a wall."""
    arm = Arm.from_urdf(planar(tmp_path, kind="continuous", limits=None))
    space = build_arm_space({"wall": posed_box((0.1, 1.0, 1.0), -0.8, 0.0, 0.0)}, arm)
    path = space.find_path((2.0, 0.0), (-2.0, 0.0), seed=1)
    assert space.certify_path(path).all()
    np.testing.assert_array_equal(path[[0, -1]], [(2.0, 0.0), (-2.0, 0.0)])
    assert np.abs(np.diff(path[:, 0])).max() <= np.pi  # otherwise the direction would be ambiguous


class CountingGenerator(np.random.Generator):
    """A generator that counts the samples drawn."""

    samples = 0

    def uniform(self, *args: Any, **options: Any) -> Any:
        drawn = super().uniform(*args, **options)
        self.samples += len(drawn)
        return drawn


@pytest.mark.parametrize("seed", [4, 13])
def test_two_arms_of_seven_joints_find_a_path_with_few_samples(tmp_path: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    sizes, positions = (
        rng.uniform(0.03, 0.1, (150, 3)),
        rng.uniform((0.35, -1.0, -0.9), (1.2, 1.0, 0.9), (150, 3)),
    )
    boxes = {
        f"box {k}": posed_box(size, *position)
        for k, (size, position) in enumerate(zip(sizes, positions, strict=True))
    }
    space = build_arm_space(boxes, Arm.from_urdf(two_arms(tmp_path)))
    q0, q1 = space.sample_free(2, rng)
    generator: Any = CountingGenerator(np.random.PCG64(1))
    path = space.find_path(q0, q1, seed=generator, time_limit=60.0)
    assert len(path) > 2 and space.certify_path(path).all()
    assert generator.samples < 25_000


def test_search_without_a_path_ends_at_its_time_limit(tmp_path: Any) -> None:
    """Block the upper link by a wall and its limits: only the time ends this search."""
    space = build_arm_space(
        {"wall": posed_box((1.0, 0.1, 1.0), 0.8, 0.0, 0.0)}, Arm.from_urdf(planar(tmp_path))
    )
    assert space.find_path(START, GOAL, seed=1, time_limit=0.2).shape == (0, 2)


@pytest.mark.parametrize("seed", range(3))
def test_find_path_supports_all_kinds_of_joints(tmp_path: Any, seed: int) -> None:
    arm = Arm.from_urdf(random_arm(tmp_path, seed))
    space = build_arm_space(
        {"post": posed_box((0.2, 0.2, 2.0), 0.8, 0.0, 0.0)},
        arm,
        allowed_collisions=[("l0", "post")],
    )
    q0, q1 = space.sample_free(2, np.random.default_rng(seed))
    path = space.find_path(q0, q1, seed=seed, time_limit=0.5)
    assert not len(path) or space.certify_path(path).all()
    assert len(path) or not space.motion_is_free(q0, q1)


@refusals(
    "endpoints, options, error, message",
    (
        (START, IN_WALL),
        {},
        ConfigurationError,
        "q1 .*is not proven free: fore is in collision with wall",
    ),
    ((IN_WALL, [START, GOAL]), {}, ConfigurationError, "q0 .*is not proven free"),
    ((START, (0.0, 9.0)), {}, ConfigurationError, "its limits are"),
    (([START, GOAL], GOAL), {}, InputError, r"q0 has shape \(2, 2\)"),
    ((START, np.empty((0, 2))), {}, InputError, r"q1 has shape \(0, 2\)"),
    ((START, GOAL), {"time_limit": 0.0}, InputError, "time_limit is 0"),
    ((START, GOAL), {"iterations": -1}, InputError, "iterations is -1"),
    ((START, GOAL), {"iterations": 1.5}, InputError, "iterations is 1.5"),
)
def test_find_path_refuses_invalid_arguments(
    space: ArmSpace, endpoints: Any, options: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        space.find_path(*endpoints, **options)


def path_length(path: Any) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def test_further_searches_find_the_shortest_way_around_a_wall(space: ArmSpace) -> None:
    """Compare with the shortest chain of proven motions on a grid of configurations."""
    path = space.find_path(START, GOAL, seed=1, iterations=40, time_limit=60.0)
    assert space.certify_path(path).all()
    np.testing.assert_array_equal(path[[0, -1]], [START, GOAL])
    shoulder, elbow = (
        np.linspace(-1.5, 1.5, 51),
        np.linspace(-2.4, 2.4, 73),
    )  # both endpoints are on the grid
    grid = np.stack(np.meshgrid(shoulder, elbow, indexing="ij"), axis=-1)
    moves = [
        (i, j) for i in range(4) for j in range(-3, 4) if math.gcd(i, j) == 1 and (i, j) != (0, -1)
    ]
    index, edges = np.arange(grid[..., 0].size).reshape(grid.shape[:2]), []
    for i, j in moves:
        starts = index[: len(shoulder) - i, max(0, -j) : len(elbow) - max(0, j)]
        edges.append(np.stack([starts, starts + i * len(elbow) + j], axis=-1).reshape(-1, 2))
    points, pairs = grid.reshape(-1, 2), np.concatenate(edges)
    pairs = pairs[np.asarray(space.motion_is_free(points[pairs[:, 0]], points[pairs[:, 1]]))]
    lengths = np.linalg.norm(points[pairs[:, 1]] - points[pairs[:, 0]], axis=1)
    graph = scipy.sparse.coo_array(
        (lengths, tuple(pairs.T)), shape=(len(points), len(points))
    ).tocsr()
    start, goal = (int(np.abs(points - q).sum(axis=1).argmin()) for q in (START, GOAL))
    np.testing.assert_allclose(points[[start, goal]], [START, GOAL], atol=1e-9)
    chain = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=start)[goal]
    assert path_length(path) <= 1.01 * chain


@pytest.mark.parametrize("seed", range(4))
def test_further_searches_never_lengthen_a_path_and_are_reproducible(
    space: ArmSpace, seed: int
) -> None:
    options: dict[str, Any] = {"seed": seed, "time_limit": 60.0}
    paths = [
        space.find_path(START, GOAL, iterations=count, **options) for count in (0, 1, 2, 3, 4, 6, 9)
    ]
    assert all(space.certify_path(path).all() for path in paths)
    lengths = [path_length(path) for path in paths]
    assert lengths == sorted(lengths, reverse=True) and lengths[-1] < lengths[0]
    np.testing.assert_array_equal(paths[-1], space.find_path(START, GOAL, iterations=9, **options))


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_short_paths_of_all_kinds_of_joints_are_proven(tmp_path: Any, seed: int) -> None:
    """Sample the paths of arms with all kinds of joints; the proof of single configurations must
    agree."""
    arm = Arm.from_urdf(random_arm(tmp_path, seed))
    posts = {
        f"post {k}": posed_box((0.2, 0.2, 2.0), *place, 0.0)
        for k, place in enumerate([(0.8, 0.0), (0.0, 0.9)])
    }
    space = build_arm_space(posts, arm, allowed_collisions=[("l0", name) for name in posts])
    q0, *goals = space.sample_free(4, np.random.default_rng(seed))
    options: dict[str, Any] = {"seed": seed, "time_limit": 60.0}
    lengths, longer = [], math.inf
    for iterations in (0, 1, 4, None):
        path = space.find_path(q0, goals, iterations=iterations, **options)
        assert space.certify_path(path).all()
        along = np.concatenate([np.linspace(*edge, 50) for edge in pairwise(path)])
        assert np.asarray(space.is_free(along)).all()
        np.testing.assert_array_equal(path[0], q0)
        assert min(np.abs(np.exp(1j * path[-1]) - np.exp(1j * goal)).max() for goal in goals) < 1e-9
        lengths.append(path_length(path))
        assert lengths[-1] <= longer
        longer = lengths[-1]
    np.testing.assert_array_equal(path, space.find_path(q0, goals, iterations=None, **options))


def test_further_searches_end_at_their_time_limit(space: ArmSpace) -> None:
    generator: Any = CountingGenerator(np.random.PCG64(1))
    assert len(space.find_path(START, GOAL, seed=generator, iterations=10**9, time_limit=0.3)) > 2
    assert generator.samples > 2 * SAMPLES_PER_BATCH


def test_further_searches_end_once_the_path_is_as_short_as_its_bound(space: ArmSpace) -> None:
    generator: Any = CountingGenerator(np.random.PCG64(1))
    assert (
        len(space.find_path(START, (-1.0, 0.3), seed=generator, iterations=10**9, time_limit=600.0))
        == 2
    )
    assert generator.samples < 3 * SAMPLES_PER_BATCH
