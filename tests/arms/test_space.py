"""Arms among obstacles: FREE, BLOCKED and motions, against FCL."""

import copy
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import planners
from cspace import BLOCKED, FREE, MIXED, Robot
from cspace.arms import Arm, ArmSpace, PosedShape, build_arm_space
from cspace.errors import ConfigurationError, InputError
from tests.helpers.refusals import refusals
from tests.helpers.solids import ArmOracle, box, sample_configurations
from tests.helpers.urdfs import joint, link, planar, pose_at, posed_box, random_arm, write_urdf


def draw_scene(tmp_path: Path, seed: int) -> tuple[ArmSpace, ArmOracle, np.random.Generator]:
    rng = np.random.default_rng(seed)
    path = random_arm(tmp_path, seed)
    arm = Arm.from_urdf(path)
    blocks = {
        f"block{n}": (
            rng.uniform(0.05, 0.4, 3),
            pose_at(*(rng.choice([-1, 1], 3) * rng.uniform(0.35, 1.0, 3)), rng.normal(size=3)),
        )
        for n in range(4)
    }
    shapes = {
        name: PosedShape(Robot.box(size).shape, pose) for name, (size, pose) in blocks.items()
    }
    ground = [("l0", name) for name in shapes]
    space = build_arm_space(shapes, arm, allowed_collisions=ground)
    still = {name: [box(size, pose[:3, 3], pose[:3, :3])] for name, (size, pose) in blocks.items()}
    return space, ArmOracle(path, arm, still, [*arm.allowed_collisions, *ground]), rng


@pytest.mark.parametrize("seed", range(3))
def test_states_agree_with_fcl(tmp_path: Path, seed: int) -> None:
    space, oracle, rng = draw_scene(tmp_path, seed)
    points = sample_configurations(space.arm, rng, 60)
    apart = np.array([oracle.apart(q) for q in points])
    states = np.asarray(space.classify(points))
    assert (apart[states == FREE] > 0.0).all()
    assert (apart[states == BLOCKED] < 1e-6).all()
    assert (states[apart > 1e-6] == FREE).all()
    near = np.asarray(space.obstacle_distance(points))
    np.testing.assert_allclose(near[apart > 1e-3], apart[apart > 1e-3], rtol=1e-3, atol=1e-5)
    assert (near[apart > 0.0] <= apart[apart > 0.0] + 1e-6).all()


@pytest.mark.parametrize("seed", range(3))
def test_motions_agree_with_fcl(tmp_path: Path, seed: int) -> None:
    """Sample motions; those not proven collide or nearly touch."""
    space, oracle, rng = draw_scene(tmp_path, seed)
    free = space.sample_free(24, rng)
    goals = np.clip(free + rng.normal(scale=0.5, size=free.shape), space.arm.lower, space.arm.upper)
    proven = np.asarray(space.motion_is_free(free, goals))
    for q0, q1, is_free in zip(free, goals, proven, strict=True):
        distances = (oracle.apart(q0 + t * (q1 - q0)) for t in np.linspace(0.0, 1.0, 60))
        assert (
            all(value > 0.0 for value in distances)
            if is_free
            else any(value < 0.02 for value in distances)
        )
    assert 0 < proven.sum() < len(proven)
    np.testing.assert_array_equal(proven, space.motion_is_free(goals, free))


def test_path_obstacle_distance_is_a_lower_bound(tmp_path: Path) -> None:
    space, oracle, rng = draw_scene(tmp_path, 0)
    free = space.sample_free(24, rng)
    goals = np.clip(free + rng.normal(scale=0.3, size=free.shape), space.arm.lower, space.arm.upper)
    distances = [space.path_obstacle_distance([q0, q1]) for q0, q1 in zip(free, goals, strict=True)]
    assert sum(distance > 0.0 for distance in distances) > 8
    for q0, q1, distance in zip(free, goals, distances, strict=True):
        assert (
            min(oracle.apart(q0 + t * (q1 - q0)) for t in np.linspace(0.0, 1.0, 40))
            >= distance - 1e-6
        )
    assert space.path_obstacle_distance(free[:1]) == space.obstacle_distance(free[0])
    blocked = np.flatnonzero(~np.asarray(space.motion_is_free(free, goals)))
    assert len(blocked) and not any(distances[k] for k in blocked)


def test_small_arms_agree_with_hand_calculations(tmp_path: Path) -> None:
    """Move an arm beside a post, into it, and over it."""
    arm = Arm.from_urdf(planar(tmp_path))
    post = {"post": posed_box((0.1, 0.1, 1.0), 1.5, 1.0, 0.0)}
    space = build_arm_space(post, arm)
    assert space.classify((0.0, 0.0)) == FREE
    assert space.obstacle_distance((0.0, 0.0)) == pytest.approx(0.9, abs=1e-6)
    assert space.classify((0.0, np.pi / 2 - 0.3)) == FREE
    angle = np.arctan2(1.0, 1.5)
    assert space.classify((angle, 0.0)) == BLOCKED
    assert space.motion_is_free((0.0, 0.0), (0.4, 0.0))
    assert not space.motion_is_free((0.0, 0.0), (1.2, 0.0))
    assert space.is_free((1.2, 0.0))
    contact = space.closest((0.4, 0.0))
    assert (contact.link, contact.other) == ("fore", "post")
    np.testing.assert_allclose(
        contact.points[1][:2], (1.55, 0.95), atol=1e-9
    )  # a corner of the post
    ball = build_arm_space({"ball": PosedShape(Robot.ball(0.2).shape, pose_at(1.5, 1.0, 0.0))}, arm)
    np.testing.assert_allclose(
        ball.closest((0.0, 0.0)).points, [(1.5, 0.05, 0.0), (1.5, 0.8, 0.0)], atol=1e-9
    )
    # FREE respects the margin.
    close = build_arm_space(post, arm, margin=0.95)
    assert not close.is_free((0.0, 0.0))
    assert close.is_free((-1.0, 0.0))


@pytest.mark.parametrize("seed", range(3))
def test_closest_returns_the_nearest_points(tmp_path: Path, seed: int) -> None:
    """Compare the points' distance with the pair's."""
    space, oracle, rng = draw_scene(tmp_path, seed)
    for q in space.sample_free(5, rng):
        contact = space.closest(q)
        assert np.linalg.norm(np.subtract(*contact.points)) == pytest.approx(
            oracle.apart(q), rel=1e-3, abs=1e-5
        )


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[ArmSpace, ArmOracle]]:
    return [draw_scene(tmp_path_factory.mktemp("scene"), seed)[:2] for seed in range(4)]


@given(number=st.integers(0, 3), shares=st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4))
@settings(max_examples=200)
def test_closest_names_the_nearest_pair_and_bounds_its_distance(
    scenes: list[tuple[ArmSpace, ArmOracle]], number: int, shares: list[float]
) -> None:
    space, oracle = scenes[number]
    lower, upper = np.maximum(space.arm.lower, -np.pi), np.minimum(space.arm.upper, np.pi)
    q = lower + np.array(shares[: space.arm.dof]) * (upper - lower)
    contact = space.closest(q)
    least = oracle.apart(q)
    assert oracle.apart(q, contact[:2]) <= least * (1.0 + 1e-3) + 1e-5
    assert contact.distance <= least + 1e-6
    assert contact.distance >= least * (1.0 - 1e-3) - 1e-5


@pytest.fixture(scope="module")
def planar_arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """Read the planar arm."""
    return Arm.from_urdf(planar(tmp_path_factory.mktemp("planar")))


def planar_distances(q: Any, boxes: dict[str, tuple[float, ...]]) -> dict[tuple[str, str], float]:
    """Compute the distances of cubes from the bars of the planar arm, by shapely.

    The cubes are given by side and center.
    """
    start, found = np.zeros(2), {}
    for bar, angle in (("upper", q[0]), ("fore", q[0] + q[1])):
        along = np.array([np.cos(angle), np.sin(angle)])
        across = 0.05 * np.array([-along[1], along[0]])
        outline = shapely.Polygon(
            [start - across, start + along - across, start + along + across, start + across]
        )
        for name, (side, x, y, z) in boxes.items():
            apart = outline.distance(
                shapely.box(x - side / 2, y - side / 2, x + side / 2, y + side / 2)
            )
            found[bar, name] = float(np.hypot(apart, max(abs(z) - side / 2 - 0.05, 0.0)))
        start = start + along
    return found


angles, paddings = st.floats(-3.0, 3.0), st.sampled_from([0.0, 0.1, 0.2, 0.3]) | st.floats(0.0, 0.3)


@example(
    q=(0.9880535424199686, 0.5623810041527564),
    y=1.5,
    side=0.3,
    padding=(0.0, 0.1, 0.0, 0.0),
    margin=0.0,
)
@example(q=(0.4, 0.4), y=1.5, side=0.3, padding=(0.0, 0.0, 0.3, 0.0), margin=0.1)
@given(
    q=st.tuples(angles, angles),
    y=st.floats(1.0, 2.5),
    side=st.floats(0.05, 0.5),
    padding=st.tuples(paddings, paddings, paddings, paddings),
    margin=paddings,
)
@settings(max_examples=300)
def test_closest_names_the_nearest_pair_with_padding(
    planar_arm: Arm,
    q: tuple[float, float],
    y: float,
    side: float,
    padding: tuple[float, ...],
    margin: float,
) -> None:
    boxes = {
        "near": (side, 0.0, y, 0.4),
        "far": (side, 0.0, -9.0, 0.0),
        "beside": (side, 2.3, 0.5, 0.0),
    }
    shapes = {name: posed_box((size,) * 3, *center) for name, (size, *center) in boxes.items()}
    extra = dict(zip([*boxes, "fore"], padding, strict=True))
    allowed = [("foot", name) for name in (*boxes, "fore")]
    space = build_arm_space(
        shapes, planar_arm, padding=extra, margin=margin, allowed_collisions=allowed
    )
    apart = planar_distances(q, boxes)
    excess = {
        pair: apart[pair] - margin - sum(extra.get(name, 0.0) for name in pair) for pair in apart
    }
    contact = space.closest(q)
    assert space.obstacle_distance(q) == contact.distance
    assume(abs(min(excess.values())) > 1e-9)
    if min(excess.values()) > 0.0:
        assert space.is_free(q) and apart[contact[:2]] == pytest.approx(
            min(apart.values()), abs=1e-9
        )
        assert contact.distance == pytest.approx(min(apart.values()), abs=1e-9)
        assert np.linalg.norm(np.subtract(*contact.points)) == pytest.approx(
            min(apart.values()), abs=1e-6
        )
    else:
        assert not space.is_free(q) and contact.distance == 0.0
        assert excess[contact[:2]] < 1e-9


def test_folding_links_collide(tmp_path: Path) -> None:
    """Fold three links until the first and the last touch."""
    bar = ((0.8, 0.1, 0.1), (0.5, 0, 0))
    path = write_urdf(
        tmp_path,
        *(link(name, bar) for name in ("a", "b", "c")),
        joint("one", "a", "b", at=(1, 0, 0)),
        joint("two", "b", "c", at=(1, 0, 0)),
    )
    space = build_arm_space({}, Arm.from_urdf(path))
    assert space.is_free((0.0, 0.0))
    assert space.is_free((2.0, -1.0))
    assert not space.is_free((2.2, 2.2))
    assert space.closest((2.0, 1.0))[:2] == ("c", "a")


@pytest.mark.parametrize("swapped", [False, True])
def test_containment_is_never_free(tmp_path: Path, swapped: bool) -> None:
    """Put an obstacle into a link, and a link into an obstacle."""
    size = 0.1 if swapped else 2.0
    path = write_urdf(
        tmp_path,
        link("base"),
        link("tip", ((size, size, size), (5, 0, 0))),
        joint("turn", "base", "tip"),
    )
    other = 2.1 - size
    space = build_arm_space({"thing": posed_box((other,) * 3, 5, 0, 0)}, Arm.from_urdf(path))
    assert space.classify((0.0,)) == BLOCKED
    assert space.obstacle_distance((0.0,)) == 0.0
    assert space.is_free((1.5,))
    assert not space.motion_is_free((0.0,), (1e-3,))


def test_ball_obstacles_and_attached_objects_collide(tmp_path: Path) -> None:
    arm = Arm.from_urdf(planar(tmp_path))
    solids = {
        "ball": PosedShape(Robot.ball(0.3).shape, pose_at(2.5, 0.0, 0.0)),
        "can": PosedShape(Robot.cylinder(0.2, 1.0).shape, pose_at(0.0, 2.5, 0.0)),
    }
    space = build_arm_space(solids, arm)
    assert space.obstacle_distance((0.0, 0.0)) == pytest.approx(0.2, abs=1e-6)
    assert space.obstacle_distance((np.pi / 2, 0.0)) == pytest.approx(0.3, abs=2e-3)
    longer = arm.attach("tool", Robot.box((0.3, 0.02, 0.02)).shape, "fore", pose_at(1.1, 0.0, 0.0))
    held = build_arm_space(solids, longer)
    assert held.obstacle_distance((np.pi / 2, 0.0)) == pytest.approx(0.05, abs=2e-3)
    assert not held.is_free((0.0, 0.0))
    careful = build_arm_space(solids, arm, margin=0.1)  # distances exclude the margin
    assert careful.obstacle_distance((0.0, 0.0)) == pytest.approx(0.2, abs=1e-6)
    assert careful.path_obstacle_distance([(0.0, 0.0), (0.05, 0.0)]) > 0.1
    assert build_arm_space(solids, arm, margin=0.25).obstacle_distance((0.0, 0.0)) == 0.0


def test_obstacles_at_fixed_links_are_refused_unless_allowed(tmp_path: Path) -> None:
    arm = Arm.from_urdf(planar(tmp_path))
    floor = {"floor": posed_box((4.0, 4.0, 0.1), 0, 0, -0.25)}
    with pytest.raises(
        ConfigurationError, match=r"foot touches obstacle 'floor'.*allowed_collisions="
    ):
        build_arm_space(floor, arm)
    assert build_arm_space(floor, arm, allowed_collisions=[("foot", "floor")]).is_free((0.0, 0.0))


@refusals(
    "call, message",
    (lambda s: s.is_free((0.0, 9.0)), "has elbow at 9; its limits are -3 and 3"),
    (lambda s: s.is_free((0.0, np.nan)), "is nan"),
    (lambda s: s.is_free((0.0,)), r"has shape \(1,\)"),
    (lambda s: s.certify_path(np.empty((0, 2))), "path has shape"),
    (lambda s: s.sample_free(-1, np.random.default_rng(1)), "n is -1"),
    (lambda s: s.closest([(0.0, 0.0)]), "it must be one configuration"),
    (
        lambda s: build_arm_space({}, s.arm, allowed_collisions=[("fore", "foot")]).closest(
            (0.0, 0.0)
        ),
        "there is nothing to touch",
    ),
    (lambda s: build_arm_space({}, s.arm, allowed_collisions=[("foot", "sky")]), "names 'sky'"),
    (lambda s: build_arm_space({}, s.arm, margin=-1.0), "margin is -1.0"),
)
def test_arm_space_refuses_invalid_arguments(tmp_path: Path, call: Any, message: str) -> None:
    space = build_arm_space(
        {"post": PosedShape(Robot.ball(0.1).shape, pose_at(3, 3, 0))},
        Arm.from_urdf(planar(tmp_path)),
    )
    with pytest.raises(InputError, match=message):
        call(space)


def test_build_arm_space_accepts_shapes_and_paths(tmp_path: Path) -> None:
    space = build_arm_space(
        {"post": PosedShape(Robot.ball(0.1).shape, pose_at(1.5, 1.0, 0))},
        Arm.from_urdf(planar(tmp_path)),
    )
    points = np.zeros((2, 3, 2))
    assert np.shape(space.is_free(points)) == np.shape(space.classify(points)) == (2, 3)
    assert np.shape(space.obstacle_distance(points)) == (2, 3)
    assert space.certify_path([(0.0, 0.0), (0.2, 0.0), (-1.0, 0.5)]).all()
    assert not space.certify_path([(0.0, 0.0), (1.2, 0.0)]).any()
    assert space.certify_path([(0.0, 0.0)]).shape == (0,)
    assert (
        space.sample_free(None, np.random.default_rng(1)).shape == space.sample_free().shape == (2,)
    )
    assert np.asarray(space.is_free(space.sample_free(20))).all()
    assert MIXED not in {space.classify((0.0, 0.0))}


@pytest.mark.parametrize("seed", range(3))
def test_motions_never_miss_a_thin_obstacle(tmp_path: Path, seed: int) -> None:
    """Place a small ball on the course of a link."""
    path = random_arm(tmp_path, seed)
    arm = Arm.from_urdf(path)
    touch = [
        ("l0", "seed"),
        *((a.name, b.name) for a in arm.links for b in arm.links if a.name < b.name),
    ]
    away = {"seed": PosedShape(Robot.ball(1e-3).shape, pose_at(20.0, 0.0, 0.0))}
    empty, rng = build_arm_space(away, arm, allowed_collisions=touch), np.random.default_rng(seed)
    for each in arm.links[1:]:
        for _ in range(12):
            q0, q1 = sample_configurations(arm, rng, 2)
            part = each.parts[int(rng.integers(len(each.parts)))]
            low, high = part.shape.outer.bounds
            point = part.pose[:3, :3] @ rng.uniform(low, high) + part.pose[:3, 3]
            pose = arm.poses(q0 + rng.uniform() * (q1 - q0))[each.name]
            there = pose[:3, :3] @ point + pose[:3, 3]
            assert not build_arm_space(
                {"seed": PosedShape(Robot.ball(1e-3).shape, pose_at(*there))},
                arm,
                allowed_collisions=touch,
            ).motion_is_free(q0, q1)
            assert empty.motion_is_free(q0, q1)


def test_checkers_never_pass_nan_nor_joints_beyond_a_limit(tmp_path: Path) -> None:
    space = build_arm_space(
        {"box": Robot.box((0.2, 0.2, 0.2), (1.5, 1.0, 0.0)).shape}, Arm.from_urdf(planar(tmp_path))
    )
    check, q = space.edge_checker(), (0.0, 0.1)
    assert check(*q, *q) and space.point_checker()(*q)
    beyond = float(space.arm.upper[0]) + 2e-5
    for bad in ((np.nan, 0.1), (0.0, np.nan), (beyond, 0.1), (-beyond, 0.1)):
        assert not (check(*bad, *q) or check(*q, *bad) or space.point_checker()(*bad))


HAIR = 4e-6
"""Radians or metres; within the accepted excess over a limit."""


def test_plans_clamp_endpoints_slightly_beyond_limits(tmp_path: Path) -> None:
    space = build_arm_space({}, Arm.from_urdf(planar(tmp_path, limits=(-1.123456, 2.0))))
    for planner in (None, "RRTConnect"):
        plan = planners.plan(
            space, (-1.123456 - HAIR, 0.3), (2.0 + HAIR, 0.5), planner=planner, seed=1
        )
        assert plan.certified
        assert plan.path[0].tolist() == plan.start.tolist() == [-1.123456, 0.3]
        assert plan.path[-1].tolist() == [2.0, 0.5]
        assert plan.status.startswith("path found")
    path = space.find_path((-1.123456 - HAIR, 0.3), (2.0, 3.0 + HAIR), seed=1)
    assert path[[0, -1]].tolist() == [[-1.123456, 0.3], [2.0, 3.0]]
    for call in (
        space.is_free,
        lambda q: planners.plan(space, q, (0, 0)),
        lambda q: space.find_path(q, (0, 0)),
    ):
        with pytest.raises(
            ConfigurationError, match=r"shoulder at -1.1234761.*limits are -1.123456 and 2; .*1e-05"
        ):
            call((-1.123456 - 2.01e-5, 0.3))


def test_queries_beyond_a_limit_hold_for_the_given_configuration(tmp_path: Path) -> None:
    """Extend a rod to 1e-6 m before a wall."""
    rod = link("rod", ((1.0, 0.1, 0.1), (0, 0, 0)))
    slide = joint("slide", "foot", "rod", axis=(1, 0, 0), kind="prismatic", limits=(-0.5, 0.5))
    path = write_urdf(tmp_path, link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.2))), rod, slide)
    wall = posed_box((1.0, 1.0, 1.0), 1.5 + 1e-6, 0, 0)
    space = build_arm_space({"wall": wall}, Arm.from_urdf(path))
    assert space.is_free((0.5,))
    assert space.classify((0.5 + HAIR,)) == BLOCKED
    assert not space.motion_is_free((0.0,), (0.5 + HAIR,))
    assert not space.certify_path([(0.0,), (0.5 + HAIR,)]).any()
    assert space.is_free((-0.5 - HAIR,))
    assert planners.plan(space, (0.0,), (0.5 + HAIR,)).certified


def measure_distances_to_bars(q: Any, point: Any) -> Any:
    """Return distances (n,) from a point to the bars."""
    shoulder, elbow = np.asarray(q).T
    angles, origins = (shoulder, shoulder + elbow), (np.zeros_like(shoulder), np.exp(1j * shoulder))
    gaps = []
    for angle, origin in zip(angles, origins, strict=True):
        local = (complex(*point) - origin) * np.exp(-1j * angle)
        beyond = [
            np.maximum(np.abs(local.real - 0.5) - 0.5, 0.0),
            np.maximum(np.abs(local.imag) - 0.05, 0.0),
        ]
        gaps.append(np.hypot(*beyond))
    return np.minimum(*gaps)


ANGLE = st.floats(-8.0, 8.0)


@pytest.fixture(scope="module")
def turning_arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """Return a planar arm whose joints turn without limits."""
    return Arm.from_urdf(planar(tmp_path_factory.mktemp("arm"), kind="continuous", limits=None))


@given(
    q0=st.tuples(ANGLE, st.floats(-2.5, 2.5)),
    turn=st.floats(-np.pi, np.pi),
    elbow=st.floats(-2.5, 2.5),
    radius=st.floats(0.3, 2.1),
    direction=st.floats(-np.pi, np.pi),
)
@settings(max_examples=150)
def test_certified_motions_turn_continuous_joints_the_shorter_way(
    turning_arm: Arm, q0: Any, turn: float, elbow: float, radius: float, direction: float
) -> None:
    """Place a small ball on or beside the shorter motion."""
    point = radius * np.cos(direction), radius * np.sin(direction)
    ball = {"ball": PosedShape(Robot.ball(0.1).shape, pose_at(*point, 0.0))}
    space = build_arm_space(ball, turning_arm, allowed_collisions=[("foot", "ball")])
    q1 = (q0[0] + turn, elbow)
    near = measure_distances_to_bars(np.linspace(q0, q1, 2000), point).min()
    certified = space.certify_path([q0, q1])[0]
    assert near > 0.1 if certified else near < 0.12
    assert certified == space.motion_is_free(q0, q1) == space.certify_path([q1, q0], [(1, 0)])[0]
    if abs(turn) < 3.1:
        for whole in (-2.0 * np.pi, 2.0 * np.pi):
            with pytest.raises(
                InputError,
                match=r"path turns shoulder by .* rad from row 0 to row 1; .*numpy.unwrap",
            ):
                space.certify_path([q0, (q1[0] + whole, elbow)])


def test_paths_and_roadmaps_refuse_long_turns_of_continuous_joints(tmp_path: Path) -> None:
    space = build_arm_space({}, Arm.from_urdf(planar(tmp_path, kind="continuous", limits=None)))
    rows = [(0.0, 0.0), (np.pi, 1.0), (4.0, 0.0), (-2.0, 0.0)]
    assert space.certify_path(rows[:3]).all()
    for call in (
        space.certify_path,
        space.path_obstacle_distance,
        lambda path: space.certify_path([[path[0]] * 4, path]),
    ):
        with pytest.raises(InputError, match="path turns shoulder by 6 rad from row 2 to row 3"):
            call(rows)
    with pytest.raises(InputError, match="path turns shoulder by 4 rad from row 2 to row 0"):
        space.certify_path(rows, [(0, 1), (2, 0)])
    assert space.certify_path(rows, [(0, 1), (1, 2), (0, 3)]).all()
    limited = build_arm_space({}, Arm.from_urdf(planar(tmp_path)))
    assert limited.certify_path([(-3.0, 0.0), (3.0, 0.0)]).all()


def test_a_tuple_is_answered_and_refused_as_an_array(tmp_path: Path) -> None:
    arm, rng = Arm.from_urdf(planar(tmp_path)), np.random.default_rng(4)
    space = build_arm_space({"post": PosedShape(Robot.ball(0.4).shape, pose_at(1.5, 1.0, 0))}, arm)
    points = rng.uniform(-2.0, 2.0, (60, 2))
    states = [space.is_free(tuple(q)) for q in points.tolist()]
    assert 0 < sum(states) < len(states)
    assert states == space.is_free(points).tolist()
    motions = [
        space.motion_is_free(tuple(a), tuple(b)) for a, b in itertools.pairwise(points.tolist())
    ]
    assert motions == space.motion_is_free(points[:-1], points[1:]).tolist()
    q = tuple(points[states.index(False)].tolist())
    bare = copy.copy(space)
    bare.remove_obstacle("post")
    assert bare.is_free(q) and not space.is_free(q)
    for wrong in ((0.0,), (0.0, "a"), (0.0, math.nan), (0.0, 0.0, 0.0)):
        messages = []
        for form in (tuple, list):
            with pytest.raises(InputError) as caught:
                space.is_free(form(wrong))  # type: ignore[arg-type]
            messages.append(caught.value.rule)
        assert messages[0] == messages[1]
    with pytest.raises(InputError):
        space.motion_is_free((0.0,), (0.0, 0.0, 0.0))
