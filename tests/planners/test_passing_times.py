"""Times at which trajectories pass places, and proofs of what lies ahead of a time.

Oracles: the times of trapezoids, the inverse of ``sample``, and shapely along dense samples.
"""

import copy
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
import planners
from cspace import InputError
from tests.helpers.handmade import build_empty
from tests.helpers.motions import LIMITS, build_plan, make_limits
from tests.helpers.placements import collides
from tests.helpers.strategies import examples, few, seeds
from tests.helpers.urdfs import planar
from tests.planners.test_trajectory import draw_limits, draw_waypoints, kinds, plan_along

DRIVES = [
    ("differential", 36),
    ("holonomic", None),
    ("holonomic", 36),
    ("reeds-shepp", 36),
]


def time_of(metres, length, speed=1.0, gain=0.5):
    """Return when a motion from rest to rest along a line has gone some metres."""
    if 2.0 * metres > length:
        return length / speed + speed / gain - time_of(length - metres, length, speed, gain)
    ramp = 0.5 * speed**2 / gain
    return math.sqrt(2.0 * metres / gain) if metres < ramp else metres / speed + 0.5 * speed / gain


# ---- passing times -------------------------------------------------------------------------------


@given(st.lists(st.floats(0.0, 6.0), max_size=8))
def test_places_on_a_line_are_passed_at_the_times_of_the_formula(metres):
    trajectory = plan_along("plane", [(1.0, 2.0), (7.0, 2.0)]).trajectory(
        max_velocity=1.0, max_acceleration=0.5
    )
    metres = np.sort(metres)
    places = np.column_stack([1.0 + metres, np.full(len(metres), 2.0)])
    expected = [time_of(each, 6.0) for each in metres]
    # Places within 1e-9 of the way's length from a rest count as that rest.
    assert trajectory.passing_times(places) == pytest.approx(expected, abs=2e-4)
    slow = trajectory.duration * 2.0
    slowed = plan_along("plane", [(1.0, 2.0), (7.0, 2.0)]).trajectory(
        max_velocity=1.0, max_acceleration=0.5, duration=slow
    )
    inner = (metres > 0.01) & (metres < 5.99)
    found = trajectory.passing_times(places)[inner]
    assert found == pytest.approx(np.array(expected)[inner], abs=1e-9)
    assert slowed.passing_times(places) == pytest.approx(2.0 * np.array(expected), abs=4e-4)


def test_places_are_taken_in_order_where_the_way_passes_them_twice():
    # From 0 m to 4 m, back to 1 m, and on to 6 m; rests at 4 m and 1 m.
    rows = [(0.0, 0.0), (4.0, 0.0), (1.0, 0.0), (6.0, 0.0)]
    trajectory = plan_along("plane", rows).trajectory(max_velocity=1.0, max_acceleration=0.5)
    back, again = time_of(4.0, 4.0), time_of(4.0, 4.0) + time_of(3.0, 3.0)

    def pass_at(*metres):
        return trajectory.passing_times([(each, 0.0) for each in metres]).tolist()

    ahead = [time_of(1.0, 4.0), time_of(3.0, 4.0)]
    assert pass_at(1.0, 3.0) == pytest.approx(ahead)
    assert pass_at(3.0, 1.0) == pytest.approx([ahead[1], again])
    assert pass_at(4.0, 3.0) == pytest.approx([back, back + time_of(1.0, 3.0)])
    thrice = [ahead[1], back, back + time_of(1.0, 3.0), again, again + time_of(2.0, 5.0)]
    assert pass_at(3.0, 4.0, 3.0, 1.0, 3.0) == pytest.approx(thrice)
    assert pass_at(3.0, 3.0) == pytest.approx([ahead[1]] * 2)
    with pytest.raises(InputError, match=r"q\[2\] is 1 m from the way after the one before"):
        pass_at(6.0, 6.0, 5.0)
    assert trajectory.passing_times((4.0, 0.0)) == pytest.approx(back)
    assert trajectory.passing_times(np.zeros((0, 2))).shape == (0,)
    assert trajectory.passing_times(np.zeros((2, 3, 2))).tolist() == [[0.0] * 3] * 2


def test_positions_are_passed_at_any_rotation():
    # It turns on the spot for 1 + 1 s, drives 2 m, and turns back.
    rows = [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (2.0, 0.0, 1.0), (2.0, 0.0, 0.0)]
    limits = {"max_velocity": 1.0, "max_acceleration": 1.0}
    turns = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}
    trajectory = plan_along("turning", rows).trajectory(**limits, **turns)
    expected = [0.0, 2.0 + time_of(0.5, 2.0, 1.0, 1.0), 5.0]
    places = [(0.0, 0.0), (0.5, 0.0), (2.0, 0.0)]
    assert trajectory.passing_times(places) == pytest.approx(expected)
    assert trajectory.passing_times(rows) == pytest.approx([0.0, 2.0, 5.0, 7.0])
    assert trajectory.passing_times(np.add(rows, (0.0, 0.0, math.tau))) == pytest.approx(
        trajectory.passing_times(rows)
    )


def check_inverse(trajectory, rng, count=20):
    """Check passing times of samples, up to places within the tolerance before them."""
    t = np.sort(rng.uniform(0.0, trajectory.duration, count))
    places = trajectory.sample(t)[0]
    found = trajectory.passing_times(places)
    # Within 1e-9 of a rest, with limited jerk, times differ by milliseconds.
    assert (found <= t + 5e-3).all()
    others = trajectory.sample(found)[0]
    gaps = np.abs(others - places)
    if "yaw" in trajectory.axes:
        gaps[:, 2] = np.abs(np.remainder(gaps[:, 2] + math.pi, math.tau) - math.pi)
    assert gaps.max() < 1e-4
    assert np.median(t - found) < 1e-6


@examples(60)
@given(seeds, st.integers(2, 5), kinds, st.booleans())
def test_times_of_places_are_the_inverse_of_samples(seed, count, kind, has_jerk):
    rng = np.random.default_rng(seed)
    jerk = {"max_jerk": 2.0} if has_jerk else {}
    plan = plan_along(kind, draw_waypoints(kind, rng, count))
    check_inverse(plan.trajectory(**draw_limits(kind, rng), **jerk), rng)


@pytest.mark.parametrize("drive, rotations", few(DRIVES))
def test_places_on_curves_are_passed_when_they_are_sampled(drive, rotations):
    plan = build_plan(1, drive, rotations)
    for jerk in ({}, {"max_jerk": 2.0}):
        trajectory = plan.trajectory(**make_limits(rotations, drive), **jerk)
        check_inverse(trajectory, np.random.default_rng(0), 40)
        later = trajectory.braked(0.4 * trajectory.duration)
        check_inverse(later, np.random.default_rng(0), 5)
        off = trajectory.positions[[0, 5]] + ((0.0,), (0.01,))
        with pytest.raises(InputError, match=r"q\[1\] is 0\.0"):
            trajectory.passing_times(off)


def test_rounded_rows_of_an_arm_are_on_its_way(tmp_path):
    pytest.importorskip("yourdfpy")
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(planar(tmp_path)))
    rows = np.round(np.linspace((-0.6, 0.3), (1.4, -0.2), 50), 4)
    straight = planners.Trajectory.along(space, rows[[0, -1]], max_velocity=1, max_acceleration=2)
    expected = [time_of(each, 2.0, 1.0, 2.0) for each in np.linspace(0.0, 2.0, 50)]
    assert straight.passing_times(rows) == pytest.approx(expected, abs=2e-4 + math.sqrt(1e-4))
    assert straight.passing_times(rows)[10:-10] == pytest.approx(expected[10:-10], abs=2e-4)


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
    past, before = (trajectory.passing_times((x, 3.0)) for x in (5.65, 5.35))
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
