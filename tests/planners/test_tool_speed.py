"""Largest speeds of links of arms, at every instant.

Oracle: corners of links, placed without the library, move no farther between instants than the limit allows.
"""

import itertools
import pickle
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import cspace
import planners
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.spaces import OpenSpace
from tests.helpers.urdfs import CORNERS, place_link, space_of, write_crane
from tests.planners.test_speed_limits import AREA

INSTANTS = 4001
LIMITS = {"max_velocity": 1.0, "max_acceleration": 1.5}
JERK = {"max_jerk": 10.0}
PLACES = [(-1.2, 0.2, 0.1), (0.3, -0.5, -0.4), (1.5, 0.6, 0.3)]
TOOLS = ["hand", "tip"]
WITH_JERK = pytest.mark.parametrize("jerk", [{}, JERK], ids=["", "jerk"])
FOLDER = TemporaryDirectory()
CRANE = write_crane(Path(FOLDER.name))


@cache
def find_plan():
    """Return a plan of the crane by a place between start and goal."""
    arm = cspace.Arm.from_urdf(CRANE)
    pairs = itertools.combinations([each.name for each in arm.links], 2)
    space = cspace.build_arm_space({}, arm, allowed_collisions=pairs)
    return planners.plan(space, PLACES[0], PLACES[2], via=[PLACES[1]], seed=1)


def place_points(name, q):
    """Return points of a link at configurations, shape (n, points, 3)."""
    points = [*CORNERS, np.zeros(3)] if name == "hand" else np.zeros((1, 3))
    pose = place_link(CRANE, find_plan().space.arm, name, q)
    return points @ pose[:, :3, :3].swapaxes(1, 2) + pose[:, np.newaxis, :3, 3]


def find_fastest(trajectory, name):
    """Return the largest mean speed of points between instants, and all of these."""
    t = np.linspace(0.0, trajectory.duration, INSTANTS)
    points = place_points(name, trajectory.sample(t)[0])
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1) / t[1]
    return speeds.max(), speeds


@pytest.mark.parametrize("blend", [True, False])
@WITH_JERK
@pytest.mark.parametrize("name", TOOLS)
def test_no_point_of_a_link_is_faster(name, jerk, blend):
    plan = find_plan()
    free = plan.trajectory(**LIMITS, **jerk, blend=blend)
    top, _ = find_fastest(free, name)
    for share in (0.7, 0.3):
        tool = planners.ToolSpeed(name, share * top)
        slow = plan.trajectory(**LIMITS, **jerk, blend=blend, speed=tool)
        fastest, speeds = find_fastest(slow, name)
        assert 0.85 * tool.speed < fastest <= tool.speed
        assert slow.certified and slow.recheck(plan.space).all()
        # It is near its limit most of the time, so it takes little longer than it must.
        length = speeds.sum() * slow.duration / (INSTANTS - 1)
        assert free.duration < slow.duration < 1.25 * length / tool.speed + 2.0
        for t in np.linspace(0.0, slow.duration, 4):
            stop = slow.braked(t)
            assert stop.certified and stop.exceeds_until == 0.0
            assert stop.duration == 0.0 or find_fastest(stop, name)[0] <= tool.speed


@WITH_JERK
def test_a_limit_above_any_speed_changes_nothing(jerk):
    plan = find_plan()
    free = plan.trajectory(**LIMITS, **jerk)
    top, _ = find_fastest(free, "hand")
    same = plan.trajectory(**LIMITS, **jerk, speed=[planners.ToolSpeed("hand", 2.0 * top)])
    for name in ("times", "positions", "velocities", "accelerations"):
        np.testing.assert_array_equal(getattr(free, name), getattr(same, name))


@WITH_JERK
def test_a_lower_limit_never_shortens_a_motion(jerk):
    plan = find_plan()
    tools = [planners.ToolSpeed("hand", speed) for speed in (4.0, 1.5, 0.9, 0.5, 0.3, 0.1)]
    durations = [plan.trajectory(**LIMITS, **jerk, speed=tool).duration for tool in tools]
    assert (np.diff(durations) >= 0.0).all() and durations[-1] > 5.0 * durations[0]
    # The link that is slower by another limit counts, in any order.
    pair = [planners.ToolSpeed("tip", 0.3), tools[2]]
    for speed in (pair, pair[::-1]):
        both = plan.trajectory(**LIMITS, **jerk, speed=speed)
        assert find_fastest(both, "tip")[0] <= 0.3


@WITH_JERK
def test_a_motion_goes_on_below_a_new_limit(jerk):
    plan = planners.plan(find_plan().space, PLACES[0], PLACES[2], seed=1)
    motion = plan.trajectory(**LIMITS, **jerk)
    at = 0.3 * motion.duration
    onward = planners.plan(plan.space, motion.starts_after(at)[0], plan.goal, seed=1)
    tool = planners.ToolSpeed("hand", 0.2)
    slower = onward.trajectory(**LIMITS, **jerk, after=motion, at=at, speed=tool)
    assert not slower.stop_reason and slower.certified
    assert 0.0 < slower.exceeds_until < 2.0
    t = np.linspace(0.0, slower.duration, INSTANTS)
    _, speeds = find_fastest(slower, "hand")
    assert speeds[0] > 0.2 >= speeds[t[:-1] >= slower.exceeds_until].max()


def test_pickled_motions_brake():
    plan = find_plan()
    slow = plan.trajectory(**LIMITS, speed=planners.ToolSpeed("hand", 0.3))
    copied = pickle.loads(pickle.dumps(slow))
    assert copied.braked(1.0).duration == slow.braked(1.0).duration


@pytest.mark.parametrize("tracking", [0.0, (0.02, 0.01, 0.03), (0.1, 0.1, 0.15)])
def test_a_gate_refuses_rows_at_which_a_link_is_too_quick(tracking):
    space = find_plan().space
    top, dt = 0.4, 0.05
    tool = planners.ToolSpeed("hand", top)
    gate = cspace.Gate(space, dt=dt, max_velocity=9.0, tracking=tracking, speed=[tool])
    rng = np.random.default_rng(4)
    shares = np.linspace(0.0, 1.0, 51)[:, np.newaxis]
    refused = 0
    for start in rng.uniform(-0.3, 0.3, (60, 3)):
        step = rng.normal(size=3) * rng.uniform(0.0, 0.02)
        chunk = gate.check_rows(start, [start + step]).chunk
        corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
        errors = corners[:, np.newaxis] * tracking
        rates = [
            np.linalg.norm(
                np.diff(place_points("hand", start + error + shares * step), axis=0), axis=2
            )
            for error in errors
        ]
        fastest = 50.0 / dt * np.max(rates)
        assert fastest <= top or not chunk
        if chunk.refusal is not None:
            refused += 1
            assert chunk.refusal.cause == "speed" and chunk.refusal.names == ("hand",)
            assert fastest > (0.9 if tracking == 0.0 else 0.3) * top
    assert 10 < refused < 60


def test_a_gate_with_a_link_refuses_rows_that_are_no_configurations():
    gate = cspace.Gate(
        find_plan().space, dt=0.1, speed=planners.ToolSpeed("tip", 0.5), max_velocity=9
    )
    for row in ((np.nan, 0.0, 0.0), (1e300, 0.0, 0.0), (0.0, np.inf, 0.0)):
        assert not gate.check_rows((0.0, 0.0, 0.0), [row]).chunk
    still = [(0.0, 0.0, 0.0)] * 2
    assert gate.check_rows((0.0, 0.0, 0.0), [still, still]).chunk.proven.tolist() == [2, 2]
    assert "ToolSpeed(link='tip', speed=0.5)" in repr(gate)


def drive(speed, plan=None):
    """Make a trajectory of an arm with limits of speed."""
    return (plan or find_plan()).trajectory(**LIMITS, speed=speed)


def plan_on_map():
    """Plan on a map of positions."""
    space = build_empty((40, 30), cspace.Robot.disc(0.3))
    return planners.plan(space, (0.5, 1.5), (3.5, 1.5))


class Carrying(OpenSpace):
    """A space of one's own that has an arm, and says nothing about its links."""

    bounds = (0.0, 0.0), (4.0, 4.0)
    arm = property(lambda self: space_of().arm)


def plan_on_own_space():
    """Plan on a space of one's own."""
    return planners.plan(Carrying(), (0.5, 1.5), (3.5, 1.5))


@refusals(
    "call, message",
    (lambda: planners.ToolSpeed("tip", 0.0), "speed is 0.0"),
    (lambda: planners.ToolSpeed(3, 1.0), "link is 3"),
    (lambda: drive(planners.ToolSpeed("tipp", 1.0)), "link is 'tipp'"),
    (
        lambda: drive(planners.ToolSpeed("tip", 1.0), plan_on_map()),
        "speed is ToolSpeed(link='tip', speed=1.0), and space is ... links",
    ),
    (
        lambda: drive(planners.ToolSpeed("fore", 1.0), plan_on_own_space()),
        "speed is ToolSpeed(link='fore', speed=1.0), and space is ... links",
    ),
    (
        lambda: drive(planners.SpeedZones([(AREA, 1.0)])),
        "speed is given, and space is ArmSpace(small: 3 joints, 0 ... robots",
    ),
    (lambda: drive("tip"), "speed is 'tip'"),
    (
        lambda: drive(planners.ToolSpeed("tip", 1.0), pickle.loads(pickle.dumps(find_plan()))),
        "plan has no map",
    ),
    (
        lambda: cspace.Gate(space_of(), dt=0.1, speed=planners.ToolSpeed("four", 1.0)),
        "link is 'four'",
    ),
    (
        lambda: cspace.Gate(plan_on_map().space, dt=0.1, speed=[planners.ToolSpeed("tip", 1.0)]),
        "speed is one of the link 'tip' ... links",
    ),
    (
        lambda: cspace.Gate(space_of(), dt=0.1, speed=planners.SpeedZones([(AREA, 1.0)])),
        "speed is given, and space is ArmSpace(small: 2 joints, 1 ... robots",
    ),
)
def test_limits_that_mean_nothing_are_refused(call, message):
    check_refused(call, message)
