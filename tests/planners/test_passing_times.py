"""Times at which trajectories pass places, and proofs of what lies ahead of a time.

Oracles: the times of trapezoids, ``sample``, and shapely along dense samples.
"""

import copy
import math

import numpy as np
import pytest
import shapely
from hypothesis import given

import cspace
import planners
from cspace import InputError
from tests.helpers.drives import make_drive
from tests.helpers.handmade import build_empty
from tests.helpers.motions import LIMITS, build_plan, make_limits
from tests.helpers.placements import collides
from tests.helpers.strategies import examples, few, seeds
from tests.helpers.urdfs import planar

DRIVES = [
    ("differential", 36),
    ("holonomic", None),
    ("holonomic", 36),
    ("reeds-shepp", 36),
]


SLOW = {"max_velocity": 1.0, "max_acceleration": 0.5}


def time_of(metres, length, speed=1.0, gain=0.5):
    """Return when a motion from rest to rest along a line has gone some metres."""
    if 2.0 * metres > length:
        return length / speed + speed / gain - time_of(length - metres, length, speed, gain)
    ramp = 0.5 * speed**2 / gain
    return math.sqrt(2.0 * metres / gain) if metres < ramp else metres / speed + 0.5 * speed / gain


# ---- places on the way ---------------------------------------------------------------------------


def test_places_on_a_line_are_passed_at_the_times_of_the_formula():
    space = build_empty((120, 60), cspace.Robot.disc(0.3))
    via = [(2.0, 3.0), (4.5, 3.0), (10.0, 3.0), (10.0, 3.0)]
    plan = planners.plan(space, (1.0, 3.0), (11.0, 3.0), via=via)
    expected = [time_of(x - 1.0, 10.0) for x, _ in via]
    assert plan.trajectory(**SLOW).via_times == pytest.approx(expected)
    slow = plan.trajectory(**SLOW, duration=24.0)
    assert slow.via_times == pytest.approx(2.0 * np.array(expected))
    assert planners.plan(space, (1, 3), (2, 3)).trajectory(**SLOW).via_times.shape == (0,)


@pytest.mark.parametrize("stops", [False, True])
def test_places_are_taken_in_order_where_the_way_passes_them_twice(stops):
    # From 1 m to 5 m, back to 2 m, and on to 7 m; it rests at 5 m and 2 m.
    space = build_empty((120, 60), "disc:0.3")
    via = [(3.0, 3.0), (5.0, 3.0), (3.0, 3.0), (2.0, 3.0), (3.0, 3.0)]
    plan = planners.plan(space, (1.0, 3.0), (7.0, 3.0), via=via)
    times = plan.trajectory(**SLOW, stop_at_via=stops).via_times
    if stops:
        legs = [4.0, 4.0, 4.0, math.sqrt(8.0), math.sqrt(8.0)]
        assert times == pytest.approx(np.cumsum(legs))
    else:
        back, again = time_of(4.0, 4.0), time_of(4.0, 4.0) + time_of(3.0, 3.0)
        expected = [time_of(2.0, 4.0), back, back + time_of(2.0, 3.0), again]
        assert times == pytest.approx([*expected, again + time_of(1.0, 5.0)], abs=1e-3)


@pytest.mark.parametrize("drive, rotations", few(DRIVES))
@examples(20)
@given(seeds)
def test_a_robot_is_at_each_place_at_its_time(drive, rotations, seed):
    rng = np.random.default_rng(seed)
    space = build_empty((80, 80), cspace.Robot.rectangle(0.4, 0.3), rotations=rotations)
    places = rng.uniform(1.0, 7.0, (5, 2))
    rows = places if rotations is None else np.column_stack([places, rng.uniform(-3, 3, 5)])
    plan = planners.plan(space, rows[0], rows[-1], via=rows[1:-1], drive=make_drive(drive))
    for jerk in ({}, {"max_jerk": 2.0}):
        trajectory = plan.trajectory(**make_limits(rotations, drive), **jerk)
        times = trajectory.via_times
        assert (np.diff(times) > 0.0).all() and times[0] > 0.0 and times[-1] < trajectory.duration
        assert trajectory.sample(times)[0][:, :2] == pytest.approx(places[1:-1], abs=1e-4)
    assert trajectory.braked(0.4 * trajectory.duration).via_times.shape == (0,)


@pytest.mark.filterwarnings("ignore::cspace.errors.UnitWarning")
@pytest.mark.parametrize("unit", [1e-6, 1e3])
@pytest.mark.parametrize("beside", [0.001, 0.5, 1.5])
def test_places_are_passed_in_any_unit(unit, beside):
    free = cspace.Workspace.from_array(np.zeros((50, 40), dtype=bool), 0.1 * unit)
    space = cspace.build(free, cspace.Robot.disc(0.15 * unit))
    via = unit * np.array([1.0 + beside, 1.0 + beside])
    plan = planners.plan(space, (unit, unit), (4.0 * unit, unit), via=[via])
    trajectory = plan.trajectory(max_velocity=0.5 * unit, max_acceleration=0.7 * unit)
    passed = trajectory.sample(trajectory.via_times)[0]
    assert passed[0] == pytest.approx(via, rel=1e-9)


def test_a_motion_that_goes_on_passes_the_places_of_its_plan():
    space = build_empty((120, 60), cspace.Robot.disc(0.3))
    motion = planners.plan(space, (1.0, 3.0), (11.0, 3.0)).trajectory(**SLOW)
    via = [(7.0, 3.0), (9.0, 4.0)]
    for start in motion.starts_after(4.0):  # in motion, and at rest
        onward = planners.plan(space, start, (11.0, 3.0), via=via)
        trajectory = onward.trajectory(**SLOW, after=motion, at=4.0)
        assert not trajectory.stop_reason
        assert trajectory.sample(trajectory.via_times)[0] == pytest.approx(np.array(via))


def test_joints_pass_places_in_time(tmp_path):
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(planar(tmp_path)))
    via = [(0.4, 0.2), (0.2, 0.5)]
    plan = planners.plan(space, (-0.6, 0.3), (1.0, -0.2), via=via)
    trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=2.0)
    assert trajectory.sample(trajectory.via_times)[0] == pytest.approx(np.array(via), abs=1e-4)


# ---- what lies ahead -----------------------------------------------------------------------------


def put_crate(plan, place):
    """Return a copy of a plan's space with a crate of 0.1 m at a place."""
    space = copy.copy(plan.space)
    x, y = place[:2]
    crate = shapely.box(x - 0.05, y - 0.05, x + 0.05, y + 0.05)
    space.add_obstacle("crate", crate)
    return space, crate


@pytest.mark.parametrize("drive, rotations", few(DRIVES))
@pytest.mark.parametrize("blend", [True, False])
@examples(30)
@given(seeds)
def test_a_recheck_ahead_finds_what_lies_ahead_alone(drive, rotations, blend, seed):
    rng = np.random.default_rng(seed)
    plan = build_plan(1, drive, rotations)
    trajectory = plan.trajectory(**make_limits(rotations, drive), blend=blend)
    after, there = rng.uniform(0.0, trajectory.duration, 2)
    assert trajectory.recheck(plan.space, after=after).all()
    space, crate = put_crate(plan, trajectory.sample(there)[0])
    free = trajectory.recheck(space, after=after).all()
    ahead = trajectory.sample(np.linspace(after, trajectory.duration, 2000))[0]
    if free:
        assert not collides(plan.space, ahead, crate, grow=-1e-6).any()
    # Cells of 5 cm, and tubes around curves and turning robots, need room.
    elif not collides(plan.space, ahead, crate, grow=0.25).any():
        raise AssertionError("the crate is far from what lies ahead")
    if after > there and free:
        assert not trajectory.recheck(space).all()


def test_a_recheck_ahead_cuts_the_part_that_the_robot_is_on():
    space = build_empty((120, 60), "disc:0.3")
    trajectory = planners.plan(space, (1.0, 3.0), (11.0, 3.0)).trajectory(**LIMITS)
    space.add_obstacle("crate", shapely.box(4.9, 2.9, 5.1, 3.1))
    # The robot's front leaves the crate at 5.4 m, and its cells at 5.6 m.
    past, before = (time_of(x - 1.0, 10.0, 1.2, 0.8) for x in (5.65, 5.35))
    assert trajectory.recheck(space, after=past).tolist() == [True]
    assert trajectory.recheck(space, after=before).tolist() == [False]
    assert trajectory.recheck(space, after=0.0).tolist() == [False]
    space.add_obstacle("crate", shapely.box(10.9, 2.9, 11.1, 3.1))
    assert not trajectory.recheck(space, after=trajectory.duration).any()
    space.add_obstacle("crate", shapely.box(9.9, 2.9, 10.1, 3.1))
    assert trajectory.recheck(space, after=trajectory.duration).all()


@pytest.mark.parametrize("after", [-0.1, 99.0, math.nan, "now", [1.0]])
def test_times_outside_of_a_motion_are_refused(after):
    plan = build_plan(1, "holonomic", None)
    with pytest.raises(InputError, match="after"):
        plan.trajectory(**LIMITS).recheck(plan.space, after=after)


def test_a_motion_with_curves_is_cut_on_a_curve():
    plan = build_plan(1, "holonomic", None)
    trajectory = plan.trajectory(**LIMITS)
    assert trajectory._segments.is_curve.any()
    counts = [
        len(trajectory.recheck(plan.space, after=t))
        for t in np.linspace(0.0, trajectory.duration, 20)
    ]
    assert counts == sorted(counts, reverse=True) and counts[-1] == 1
