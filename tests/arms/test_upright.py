"""Motions of arms that keep an axis upright, against forward kinematics by other code."""

import copy
import itertools
import json
import math
import pickle

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import cspace
import planners
from cspace import Arm, ConfigurationError, InputError, PoseGoal, Robot, build_arm_space
from planners import Upright
from tests.helpers.gates import certify_chunk
from tests.helpers.handmade import build_empty
from tests.helpers.motions import sample_evenly
from tests.helpers.refusals import refusals
from tests.helpers.spaces import OpenSpace
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import (
    draw_chain,
    joint,
    link,
    pose_at,
    pose_of,
    posed_box,
    write_urdf,
)


def measure_deviations(path, joints, upright, rows):
    """Return how far the angle of an axis is from the one to keep, at rows of configurations."""
    values = dict(zip(joints, np.moveaxis(rows, -1, 0), strict=True))
    axes = pose_of(path, upright.frame, values)[..., :3, :3] @ np.asarray(upright.axis)
    across = np.linalg.norm(np.cross(axes, upright.direction), axis=-1)
    return np.abs(np.arctan2(across, axes @ np.asarray(upright.direction)) - upright.angle)


def sample_path(rows, count=101):
    """Return configurations on the motions between rows, shape (n, dof)."""
    shares = np.linspace(0.0, 1.0, count)[:, np.newaxis]
    return np.concatenate([a + shares * (b - a) for a, b in itertools.pairwise(rows)])


# ---- proofs --------------------------------------------------------------------------------------


@examples(60)
@given(
    seed=seeds,
    count=st.integers(1, 7),
    size=st.sampled_from([0.0, 0.02, 0.3, 2.0]),
    angle=st.sampled_from([0.0, 0.5 * math.pi, 1.0]),
    near=st.sampled_from([0.5, 0.9, 0.999, 1.0 - 1e-9, 1.0 + 1e-6, 1.001, 1.1]),
)
def test_a_motion_is_proven_if_it_stays_within_the_tolerance(
    tmp_path_factory, seed, count, size, angle, near
):
    rng, path, arm = draw_chain(tmp_path_factory, seed, count)
    middle = rng.uniform(*arm._ranges())
    step = size * rng.uniform(-1.0, 1.0, arm.dof)
    ends = np.clip([middle - step, middle + step], arm.lower, arm.upper)
    axis = rng.normal(size=3)
    direction = rng.normal(size=3)
    if angle == 0.0:
        # The direction is that of the axis at some instant.
        direction = arm.pose(ends[0] + rng.random() * (ends[1] - ends[0]), "tool0")[:3, :3] @ axis
    wide = Upright("tool0", axis, direction, math.pi, angle)
    worst = measure_deviations(path, arm.joints, wide, sample_path(ends, 20001)).max()
    assume(1e-6 < near * worst < math.pi)
    upright = Upright("tool0", axis, direction, near * worst, angle)
    space = build_arm_space({}, arm, allowed_collisions=_all_pairs(arm))
    proven = space.keep([upright]).motion_is_free(*map(tuple, ends.tolist()))
    if near < 1.0:
        # Between samples the angle may be larger still.
        assert not proven
    if near > 1.0005 or size == 0.0:
        assert proven == (near > 1.0)


def _all_pairs(arm):
    """Return all pairs of links, which may then touch."""
    names = [each.name for each in arm.links]
    return [(a, b) for a in names for b in names if a < b]


@pytest.mark.parametrize("near", [0.999, 1.001])
@pytest.mark.parametrize("size", [0.1, 1.0])
def test_an_axis_that_rests_halfway_is_bounded_by_its_acceleration(tmp_path, size, near):
    """Halfway the arm turns about the axis itself, so that the axis has no velocity there."""
    bar = ((0.1, 0.1, 0.1), (0, 0, 0))
    path = write_urdf(
        tmp_path,
        *(link(name, bar) for name in ("foot", "middle", "tool0")),
        joint("one", "foot", "middle", axis=(0, 0, 1)),
        joint("two", "middle", "tool0", axis=(1, 0, 0)),
    )
    arm = Arm.from_urdf(path)
    ends = np.array([(-size, -size), (size, size)])
    wide = Upright("tool0", (1, 0, 1), (1, 0, 1), math.pi)
    worst = measure_deviations(path, arm.joints, wide, sample_path(ends)).max()
    upright = Upright("tool0", (1, 0, 1), (1, 0, 1), near * worst)
    space = build_arm_space({}, arm, allowed_collisions=_all_pairs(arm)).keep([upright])
    assert space.motion_is_free(*map(tuple, ends.tolist())) == (near > 1.0)


@examples(30)
@given(seed=seeds, count=st.integers(1, 7), size=st.sampled_from([0.0, 0.1, 1.0]))
def test_all_motions_near_a_proven_one_are_upright(tmp_path_factory, seed, count, size):
    rng, path, arm = draw_chain(tmp_path_factory, seed, count)
    middle = rng.uniform(*arm._ranges())
    ends = np.clip(
        middle + size * rng.uniform(-1.0, 1.0, (2, arm.dof)), arm.lower + 0.1, arm.upper - 0.1
    )
    deviation = rng.uniform(0.0, 0.1, arm.dof)
    upright = Upright("tool0", (0, 0, 1), arm.pose(middle, "tool0")[:3, 2], rng.uniform(0.1, 1.0))
    space = build_arm_space({}, arm, allowed_collisions=_all_pairs(arm)).keep([upright])
    proven = certify_chunk(space, ends[0], ends[1:], deviation).is_proven
    signs = rng.choice([-1.0, 1.0], (30, 1, arm.dof))
    worst = measure_deviations(
        path, arm.joints, upright, sample_path(ends) + signs * deviation
    ).max()
    if proven:
        assert worst <= upright.tolerance
        assert space.motion_is_free(*map(tuple, ends.tolist()))
    else:
        # The bound counts that all joints turn the link alike.
        turns = 2.0 * (deviation.sum() + np.abs(ends[1] - ends[0]).sum())
        assert worst + turns > upright.tolerance


# ---- plans ---------------------------------------------------------------------------------------

GLASS = Upright("tool0", tolerance=0.1)
"""What the waiter keeps."""

START = (-1.2, 0.5, -1.0, 0.5, 0.0)
GOAL = (1.2, 0.4, -0.8, 0.4, 1.0)


@pytest.fixture(scope="module")
def waiter(tmp_path_factory):
    """Write an arm that can turn, bend three times and turn its tool0, which is level at zero."""
    bar = ((0.4, 0.06, 0.06), (0.2, 0, 0))
    bends = {"axis": (0, 1, 0), "limits": (-2.5, 2.5)}
    return write_urdf(
        tmp_path_factory.mktemp("waiter"),
        link("foot", ((0.1, 0.1, 0.1), (0, 0, -0.2))),
        link("mast"),
        *(link(name, bar) for name in ("upper", "fore")),
        link("wrist", ((0.1, 0.05, 0.05), (0.05, 0, 0))),
        link("tool0", ((0.04, 0.04, 0.1), (0, 0, 0.05))),
        joint("turn", "foot", "mast"),
        joint("shoulder", "mast", "upper", **bends),
        joint("elbow", "upper", "fore", at=(0.4, 0, 0), **bends),
        joint("bow", "fore", "wrist", at=(0.4, 0, 0), **bends),
        joint("spin", "wrist", "tool0", at=(0.1, 0, 0.04), kind="continuous", limits=None),
    )


@pytest.fixture(scope="module")
def arm(waiter):
    return Arm.from_urdf(waiter)


@pytest.fixture
def space(arm):
    """Put the waiter beside a wall with a board above it, between which the glass fits."""
    wall = posed_box((0.6, 0.1, 0.3), 0.7, 0.0, -0.05)
    board = posed_box((0.6, 0.1, 0.05), 0.7, 0.0, 0.5)
    return build_arm_space({"wall": wall, "board": board}, arm)


def check_kept(waiter, arm, space, rows, upright=GLASS):
    """Assert that configurations are upright and free."""
    assert measure_deviations(waiter, arm.joints, upright, rows).max() <= upright.tolerance
    assert np.asarray(space.is_free(rows)).all()


def test_a_plan_and_its_trajectory_stay_upright(waiter, arm, space):
    free = planners.plan(space, START, GOAL, seed=1)
    assert measure_deviations(waiter, arm.joints, GLASS, sample_path(free.path)).max() > 0.3
    plan = planners.plan(
        space,
        START,
        GOAL,
        keep=GLASS,
        seed=1,
        time_limit=20.0,
        planner=planners.Search(iterations=8),
    )
    assert plan.certified and plan.keep == (GLASS,) and plan.space is space
    np.testing.assert_array_equal(plan.path[[0, -1], :4], np.array([START, GOAL])[:, :4])
    check_kept(waiter, arm, space, sample_path(plan.path))
    assert plan.recheck().all() and free.length <= plan.length < 3.0 * free.length
    # Curves are proven too, and save most stops.
    limits = {"max_velocity": 1.0, "max_acceleration": 2.0}
    trajectory = plan.trajectory(**limits)
    instants = np.linspace(0.0, trajectory.duration, 2001)
    check_kept(waiter, arm, space, trajectory.sample(instants)[0])
    assert trajectory.certified and trajectory.recheck(space).all()
    assert trajectory.duration < 0.8 * plan.trajectory(blend=False, **limits).duration


def test_recheck_asks_for_the_axis_and_for_present_obstacles(space):
    free = planners.plan(space, START, GOAL, seed=1)
    plan = planners.plan(space, START, GOAL, keep=GLASS, seed=1, time_limit=20.0)
    # The rows of the other path are no longer upright.
    tilted = copy.copy(plan)
    object.__setattr__(tilted, "waypoints", free.waypoints)
    assert free.recheck(space).all() and not tilted.recheck(space).all()
    assert not tilted.trajectory(max_velocity=1.0, max_acceleration=1.0).recheck(space).all()
    again = pickle.loads(pickle.dumps(plan))
    assert again.keep == plan.keep and again.recheck(space).all()
    assert copy.copy(space.keep([GLASS])).is_free(GOAL)
    assert not copy.copy(space.keep([GLASS])).is_free((*GOAL[:3], 0.6, 0.0))
    space.add_obstacle("bar", Robot.box((0.05, 0.05, 2.0)), pose_at(0.5, -0.3))
    assert not plan.recheck().all()
    space.remove_obstacle("bar")
    # The previous plan may have kept nothing.
    for previous in (plan, free):
        after = planners.plan(space, START, GOAL, keep=GLASS, previous=previous, time_limit=20.0)
        assert after.certified and after.recheck().all()


@pytest.mark.parametrize("max_jerk", [None, 10.0])
def test_places_several_goals_and_motions_that_go_on_stay_upright(waiter, arm, space, max_jerk):
    high = (0.0, -0.6, 0.58, 0.0, 0.0)
    side = arm.pose((0.9, -0.3, 0.4, -0.06, 1.0), "tool0")
    via = [high, PoseGoal("tool0", side, (1e-3, math.inf))]
    far = PoseGoal("tool0", arm.pose((-2.5, 0.5, -1.0, 0.5, 0.0), "tool0"))
    options = {"keep": GLASS, "seed": 1, "time_limit": 20.0}
    goal = PoseGoal("tool0", pose_at(0.3, 0.6, 0.1, (0, 0, 1.0)), (1e-3, 0.01))
    plan = planners.plan(space, START, [far, goal], via=via, **options)
    assert plan.certified and plan.recheck().all()
    assert np.linalg.norm(arm.pose(plan.goal, "tool0")[:3, 3] - (0.3, 0.6, 0.1)) <= 1e-3
    places = plan.path[list(plan.via_rows)]
    assert places[0, :4].tolist() == list(high[:4])
    assert np.linalg.norm(arm.pose(places[1], "tool0")[:3, 3] - side[:3, 3]) <= 1e-3
    check_kept(waiter, arm, space, sample_path(plan.path))
    limits = {"max_velocity": 1.0, "max_acceleration": 2.0, "max_jerk": max_jerk}
    durations = []
    for stop_at_via in (False, True):
        trajectory = plan.trajectory(**limits, stop_at_via=stop_at_via)
        durations.append(trajectory.duration)
        assert trajectory.certified
        at = 0.4 * trajectory.duration
        back = planners.plan(space, trajectory.starts_after(at)[-1], START, via=[high], **options)
        onward = back.trajectory(after=trajectory, at=at, **limits)
        assert not onward.stop_reason
        for motion in (trajectory, trajectory.braked(at), onward):
            assert motion.certified and motion.recheck(space).all()
            rows = sample_evenly(motion, 2001)[0]
            check_kept(waiter, arm, space, rows)
    assert durations[0] < durations[1]


def test_a_plane_and_two_axes_are_kept(waiter, arm):
    """The wrist may turn about the fixed direction x, or the tool may do neither."""
    space = build_arm_space({}, arm)
    level = Upright("tool0", (1, 0, 0), (0, 0, 1), 0.05, 0.5 * math.pi)
    for keep in (level, [GLASS, level]):
        plan = planners.plan(space, START, GOAL, keep=keep, seed=1, time_limit=20.0)
        assert plan.certified
        for upright in plan.keep:
            check_kept(waiter, arm, space, sample_path(plan.path), upright)


def test_a_cup_in_the_hand_is_kept_upright(waiter, arm, space):
    space.attach("cup", Robot.cylinder(0.02, 0.1).shape, "tool0", pose_at(0, 0, 0.16))
    keep = Upright("cup", tolerance=0.2)
    plan = planners.plan(space, START, GOAL, keep=keep, seed=1, time_limit=20.0)
    rows = sample_path(plan.path)
    tilts = measure_deviations(waiter, arm.joints, Upright("tool0"), rows)
    assert plan.certified and tilts.max() <= 0.2


def test_json_has_what_is_kept(space, tmp_path):
    plan = planners.plan(space, START, START, keep=GLASS)
    plan.to_json(tmp_path / "plan.json")
    (kept,) = json.loads((tmp_path / "plan.json").read_text())["keep"]
    assert Upright(**kept) == GLASS


def test_without_a_path_the_hint_is_a_larger_tolerance(space, monkeypatch):
    with monkeypatch.context() as hasty:
        hasty.setattr("planners._plan.DEFAULT_SECONDS", 1e-3)  # of counted work
        hasty.setattr("cspace._support.deadlines.PATIENCE", math.inf)  # and no clock
        plan = planners.plan(space, START, GOAL, keep=Upright("tool0", tolerance=1e-4))
    assert not plan and "a larger tolerance" in plan.hint
    wider = planners.plan(space, START, GOAL, keep=Upright("tool0", tolerance=1.0))
    assert wider.certified


@refusals(
    "options, message",
    ({"axis": (0, 0, 0)}, r"axis is \(0, 0, 0\); its length is 0"),
    ({"direction": (0, 1)}, r"direction is \(0, 1\); a direction has three numbers"),
    ({"axis": (0, math.nan, 1)}, "axis"),
    ({"tolerance": 0.0}, "tolerance is 0.0"),
    ({"tolerance": 5.7}, "tolerance is 5.7; .*from 0 to pi.*pass 0.0994838 for 5.7 degrees"),
    ({"angle": 90}, "angle is 90.0; .*pass 1.5708 for 90 degrees"),
    ({"angle": -30.0}, "angle is -30.0; .*from 0 to pi radians"),
    ({"angle": 270.0}, "angle is 270.0; .*from 0 to pi radians"),
    ({"frame": 3}, "frame"),
)
def test_constraints_reject_invalid_fields(options, message):
    with pytest.raises(InputError, match=message):
        Upright(**{"frame": "tool0", **options})


@refusals(
    "options, message",
    ({"keep": 0.1}, "keep is 0.1; it must be an Upright"),
    ({"keep": [GLASS, 0.1]}, "keep is .*it must be an Upright, or a list"),
    ({"keep": Upright("tool1")}, "frame is 'tool1'; .*did you mean 'tool0'"),
    ({"planner": "RRTConnect"}, "RRTConnect takes keep: None"),
    (
        {"start": (*START[:3], 1.0, 0.0)},
        "start .* is not upright: the axis of tool0 is 0.5 rad from the direction .*0 rad, within",
    ),
    ({"goal": (*GOAL[:3], 1.0, 0.0)}, "goal .* is not upright"),
    # Rounding takes a little of the tolerance.
    ({"goal": (*GOAL[:3], 0.5, 0.0)}, "goal .* is not upright: .* is 0.1 rad"),
    (
        {"pose": (*GOAL[:3], 1.0, 0.0)},
        "goal has .* configurations that reach the pose, none is upright",
    ),
)
def test_plans_reject_what_is_not_upright(arm, space, options, message):
    given = {"start": START, "goal": GOAL, "keep": GLASS, **options}
    if "pose" in given:
        given["goal"] = PoseGoal("tool0", arm.pose(given.pop("pose"), "tool0"))
    with pytest.raises((InputError, ConfigurationError), match=message):
        planners.plan(space, given.pop("start"), given.pop("goal"), **given)


class Anything(OpenSpace):
    """The waiter's joints without links."""

    axes = ("turn", "shoulder", "elbow", "bow", "spin")
    bounds = ((-4.0,) * 5, (4.0,) * 5)


def test_a_space_without_links_proves_nothing_that_is_kept(space):
    plan = planners.plan(space, START, START, keep=GLASS)
    with pytest.raises(InputError, match=r"keep is given and space is Anything\(turn,.*links"):
        plan.recheck(Anything())
    assert plan.recheck(space).all()


def test_maps_keep_nothing():
    space = build_empty((30, 30), cspace.Robot.disc(0.2))
    with pytest.raises(InputError, match=r"^keep is Upright\(.*; it is for arms"):
        planners.plan(space, (1, 1), (2, 2), keep=GLASS)
    assert planners.plan(space, (1, 1), (2, 2), keep=[]).certified
