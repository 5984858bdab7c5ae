"""Arms among obstacles: FREE, BLOCKED, distances and motions, against FCL and shapely."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

import planners
from cspace import BLOCKED, FREE, Robot
from cspace.arms import Arm, PosedShape, build_arm_space
from cspace.errors import ConfigurationError, InputError
from cspace.inside import tubes_are_free
from tests.helpers.arm_oracle import approach_contact, draw_scene, sample_configurations
from tests.helpers.gates import certify_chunk
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import (
    joint,
    link,
    place_link,
    planar_arm,
    planar_arm_gaps,
    planar_arm_meets,
    pose_at,
    posed_box,
    random_chain,
    write_urdf,
)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    return [draw_scene(tmp_path_factory.mktemp("scene"), seed)[:2] for seed in range(6)]


@given(number=st.integers(0, 5), seed=seeds)
@examples(60)
def test_states_and_contacts_agree_with_fcl(scenes, number, seed):
    space, oracle = scenes[number]
    ends = sample_configurations(space.arm, np.random.default_rng(seed), 2)
    for q in (*ends, *approach_contact(oracle, *ends)):
        least = oracle.apart(q)
        state = space.classify(q)
        assert state != FREE or least > 0.0
        assert state != BLOCKED or least < 1e-6
        assert state == FREE or least < 1e-6
        contact = space.closest(q)
        assert contact.distance == space.obstacle_distance(q)
        assert contact.distance == pytest.approx(least, rel=1e-3, abs=1e-5)
        assert contact.distance <= least + 1e-6
        assert oracle.apart(q, contact[:2]) <= least * (1.0 + 1e-3) + 1e-5
        if least > 0.0:
            between = np.linalg.norm(np.subtract(*contact.points))
            assert between == pytest.approx(least, rel=1e-3, abs=1e-5)


@given(number=st.integers(0, 5), seed=seeds, size=st.sampled_from([0.1, 0.5, 2.0]))
@examples(40)
def test_motions_agree_with_fcl(scenes, number, seed, size):
    """Motions that are not proven collide, or nearly so."""
    space, oracle = scenes[number]
    rng = np.random.default_rng(seed)
    q0 = space.sample_free(rng=rng)
    turns = np.clip(size * rng.normal(size=q0.shape), -3.0, 3.0)  # at most half a turn
    q1 = np.clip(q0 + turns, space.arm.lower, space.arm.upper)
    q1 = approach_contact(oracle, q0, q1)[0]
    apart = [oracle.apart(q0 + t * (q1 - q0)) for t in np.linspace(0.0, 1.0, 60)]
    proven = space.motion_is_free(q0, q1)
    assert min(apart) > 0.0 if proven else min(apart) < 0.02
    assert space.motion_is_free(q1, q0) == proven
    bound = space.path_obstacle_distance([q0, q1])
    assert bound <= min(apart) + 1e-6
    assert (bound > 0.0) == proven
    assert space.path_obstacle_distance([q0]) == space.obstacle_distance(q0)


@given(seed=seeds, count=st.integers(1, 6), stretched=st.booleans())
@example(seed=75361, count=4, stretched=False)
@examples(40)
def test_a_pin_at_the_tip_never_passes_a_pin_on_its_way(tmp_path_factory, seed, count, stretched):
    """The tip of a stretched arm accelerates as much as its bound allows."""
    rng = np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp("chain")
    if stretched:
        names = [f"l{k}" for k in range(count + 1)]
        parts = [link("l0", ((0.01,) * 3, (0, 0, -1)))]
        parts += [link(name) for name in [*names[1:], "tool0"]]
        for k in range(count):
            parts.append(joint(f"j{k}", names[k], names[k + 1], at=(0.5 * (k > 0), 0, 0)))
        path = write_urdf(
            folder, *parts, joint("mount", names[-1], "tool0", (0.5, 0, 0), kind="fixed")
        )
    else:
        path = random_chain(folder, seed, count)
    arm = Arm.from_urdf(path).attach("pin", Robot.ball(1e-4).shape, "tool0")
    lower, upper = arm._ranges()
    center = np.zeros(arm.dof) if stretched else rng.uniform(lower, upper)
    step = rng.choice([0.2, 1.0]) * rng.uniform(-1.0, 1.0, arm.dof)
    if rng.random() < 0.5:
        step = np.abs(step)
    q0 = (center - step).clip(lower, upper)
    q1 = (center + step).clip(lower, upper)
    q = q0 + rng.uniform() * (q1 - q0)
    place = place_link(path, arm, "tool0", q)
    names = [each.name for each in arm.links]
    may_touch = [(a, b) for a in names for b in [*names, "post"] if a < b and b != "post"]
    may_touch += [(name, "post") for name in names if name != "pin"]
    obstacle = {"post": PosedShape(Robot.ball(1e-4).shape, place)}
    try:
        space = build_arm_space(obstacle, arm, allowed_collisions=may_touch)
    except ConfigurationError:
        assume(False)
    assert not space.motion_is_free(q0, q1)
    assert not space.is_free(q)
    far = {"post": PosedShape(Robot.ball(1e-4).shape, pose_at(20.0, 0.0))}
    assert build_arm_space(far, arm, allowed_collisions=may_touch).motion_is_free(q0, q1)


@pytest.fixture(scope="module")
def turning_arm():
    """Return a planar arm whose shoulder turns without limits."""
    return planar_arm(kind="continuous", limits=None)


def measure_distances(q, boxes):
    """Compute the distances of cubes, by side and center, from the bars of the planar arm."""
    gaps = planar_arm_gaps([q], [(x, y, side) for side, x, y, _ in boxes.values()])[:, 0]
    above = [max(abs(z) - 0.5 * side - 0.05, 0.0) for side, *_, z in boxes.values()]
    pairs = itertools.product(("upper", "fore"), boxes)
    return dict(zip(pairs, np.hypot(gaps, above).ravel().tolist(), strict=True))


ANGLE = st.floats(-3.0, 3.0)
PADDING = st.sampled_from([0.0, 0.1, 0.2, 0.3]) | st.floats(0.0, 0.3)


@given(
    q=st.tuples(ANGLE, ANGLE),
    y=st.floats(1.0, 2.5),
    side=st.floats(0.05, 0.5),
    padding=st.tuples(PADDING, PADDING, PADDING, PADDING),
    margin=PADDING,
)
@examples(60)
def test_margin_and_padding_are_kept_and_do_not_count_as_distance(q, y, side, padding, margin):
    boxes = {
        "near": (side, 0.0, y, 0.4),
        "far": (side, 0.0, -9.0, 0.0),
        "beside": (side, 2.3, 0.5, 0.0),
    }
    shapes = {name: posed_box((size,) * 3, *center) for name, (size, *center) in boxes.items()}
    extra = dict(zip([*boxes, "fore"], padding, strict=True))
    may_touch = [("foot", name) for name in (*boxes, "fore")]
    space = build_arm_space(
        shapes, planar_arm(), padding=extra, margin=margin, allowed_collisions=may_touch
    )
    apart = measure_distances(q, boxes)
    excess = {
        pair: apart[pair] - margin - sum(extra.get(name, 0.0) for name in pair) for pair in apart
    }
    least = min(excess.values())
    assume(abs(least) > 1e-9)
    contact = space.closest(q)
    pair = contact.link, contact.other
    assert space.is_free(q) == (least > 0.0)
    assert space.obstacle_distance(q) == contact.distance
    if least > 0.0:
        nearest = min(apart.values())
        assert apart[pair] == pytest.approx(nearest, abs=1e-9)
        assert contact.distance == pytest.approx(nearest, abs=1e-9)
        assert np.linalg.norm(np.subtract(*contact.points)) == pytest.approx(nearest, abs=1e-6)
        assert space.path_obstacle_distance([q, q]) >= margin
    else:
        assert contact.distance == 0.0
        assert excess[pair] < 1e-9


def test_checkers_never_pass_nan_nor_joints_beyond_a_limit():
    space = build_arm_space({"post": posed_box((0.2,) * 3, 1.5, 1.0)}, planar_arm())
    walk = space.edge_checker()
    check = space.point_checker()
    q = 0.0, 0.1
    assert walk(*q, *q) and check(*q)
    beyond = float(planar_arm().upper[0]) + 2e-5
    for bad in ((np.nan, 0.1), (0.0, np.nan), (beyond, 0.1), (-beyond, 0.1)):
        assert not (walk(*bad, *q) or walk(*q, *bad) or check(*bad))


HAIR = 4e-6
"""Radians or metres; within the accepted excess over a limit."""


def test_paths_clamp_endpoints_slightly_beyond_limits():
    space = build_arm_space({}, planar_arm(limits=(-1.123456, 2.0)))
    plan = planners.plan(space, (-1.123456 - HAIR, 0.3), (2.0 + HAIR, 0.5), seed=1)
    assert plan.certified
    assert plan.path[[0, -1]].tolist() == [[-1.123456, 0.3], [2.0, 0.5]]
    plan = planners.plan(space, (-1.123456 - HAIR, 0.3), (2.0, 3.0 + HAIR), seed=1)
    assert plan.path[[0, -1]].tolist() == [[-1.123456, 0.3], [2.0, 3.0]]
    for call in (space.is_free, lambda q: planners.plan(space, q, (0, 0))):
        with pytest.raises(ConfigurationError, match=r"shoulder at -1.1234761; its limits are"):
            call((-1.123456 - 2.01e-5, 0.3))


def test_queries_beyond_a_limit_hold_for_the_given_configuration(tmp_path):
    """Extend a rod to 1e-6 m before a wall."""
    rod = link("rod", ((1.0, 0.1, 0.1), (0, 0, 0)))
    slide = joint("slide", "foot", "rod", axis=(1, 0, 0), kind="prismatic", limits=(-0.5, 0.5))
    path = write_urdf(tmp_path, link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.2))), rod, slide)
    wall = posed_box((1.0, 1.0, 1.0), 1.5 + 1e-6, 0, 0)
    space = build_arm_space({"wall": wall}, Arm.from_urdf(path))
    assert space.is_free((0.5,)) and space.is_free((-0.5 - HAIR,))
    assert space.classify((0.5 + HAIR,)) == BLOCKED
    assert not space.motion_is_free((0.0,), (0.5 + HAIR,))
    assert planners.plan(space, (0.0,), (0.5 + HAIR,)).certified


@given(
    q0=st.tuples(st.floats(-8.0, 8.0), st.floats(-2.5, 2.5)),
    turn=st.floats(-np.pi, np.pi),
    elbow=st.floats(-2.5, 2.5),
    radius=st.floats(0.3, 2.1),
    direction=st.floats(-np.pi, np.pi),
)
@examples(30)
def test_certified_motions_turn_continuous_joints_the_shorter_way(
    turning_arm, q0, turn, elbow, radius, direction
):
    """Place a small cube on or beside the shorter motion."""
    center = radius * math.cos(direction), radius * math.sin(direction)
    cube = {"cube": posed_box((0.2,) * 3, *center)}
    space = build_arm_space(cube, turning_arm, allowed_collisions=[("foot", "cube")])
    q1 = q0[0] + turn, elbow
    motion = np.linspace(q0, q1, 200)
    certified = space.certify_path([q0, q1])[0]
    if certified:
        assert not planar_arm_meets(motion, [(*center, 0.2)]).any()
    else:  # it collides, or nearly so
        assert planar_arm_meets(motion, [(*center, 0.26)]).any()
    assert certified == space.motion_is_free(q0, q1) == space.certify_path([q1, q0], [(1, 0)])[0]
    if abs(turn) < 3.1:
        for whole in (-2.0 * np.pi, 2.0 * np.pi):
            with pytest.raises(InputError, match="path turns shoulder"):
                space.certify_path([q0, (q1[0] + whole, elbow)])


@given(seed=seeds, center=st.tuples(st.floats(0.3, 2.1), st.floats(-2.0, 2.0)))
@examples(30)
def test_each_motion_is_free_with_its_own_deviation(seed, center):
    cube = {"cube": posed_box((0.2,) * 3, *center)}
    space = build_arm_space(cube, planar_arm(), allowed_collisions=[("foot", "cube")])
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-2.5, 2.5, (12, 2))
    ends = starts + rng.uniform(-0.3, 0.3, (12, 2))
    deviations = rng.choice([0.0, 0.01, 0.1, 0.4], (12, 2))
    free = tubes_are_free(space, starts, ends, deviations)
    for first, last, reach, is_free in zip(starts, ends, deviations, free, strict=True):
        assert certify_chunk(space, first, [last], reach).is_proven == is_free
        near = np.linspace(first, last, 60) + reach * rng.choice([-1.0, 0.0, 1.0], (60, 2))
        if is_free:
            assert not planar_arm_meets(near, [(*center, 0.2)]).any()
        elif not reach.any():  # it collides, or nearly so
            assert planar_arm_meets(near, [(*center, 0.26)]).any()


def test_long_turns_of_continuous_joints_are_refused(turning_arm):
    space = build_arm_space({}, turning_arm)
    rows = [(0.0, 0.0), (np.pi, 1.0), (4.0, 0.0), (-2.0, 0.0)]
    assert space.certify_path(rows[:3]).all()
    assert space.certify_path(rows, [(0, 1), (1, 2), (0, 3)]).all()
    with pytest.raises(InputError, match="path turns shoulder by 6 rad from row 2 to row 3"):
        space.path_obstacle_distance(rows)
    with pytest.raises(InputError, match="path turns shoulder by 4 rad from row 2 to row 0"):
        space.certify_path(rows, [(0, 1), (2, 0)])
    assert build_arm_space({}, planar_arm()).certify_path([(-3.0, 0.0), (3.0, 0.0)]).all()


def test_a_tuple_is_answered_and_refused_as_an_array():
    space = build_arm_space({"post": posed_box((0.6,) * 3, 1.5, 1.0)}, planar_arm())
    points = np.random.default_rng(4).uniform(-2.0, 2.0, (60, 2))
    states = [space.is_free(tuple(q)) for q in points.tolist()]
    assert states == space.is_free(points).tolist()
    pairs = zip(points[:-1].tolist(), points[1:].tolist(), strict=True)
    motions = [space.motion_is_free(tuple(a), tuple(b)) for a, b in pairs]
    assert motions == space.motion_is_free(points[:-1], points[1:]).tolist()
    for wrong in ((0.0,), (0.0, "a"), (0.0, math.nan), (0.0, 0.0, 0.0)):
        with pytest.raises(InputError):
            space.is_free(wrong)
