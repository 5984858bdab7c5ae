"""Motions around others, which the checker replays, against brute force over timed graphs."""

import math
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

import cspace
import planners
from cspace.errors import InputError
from cspace.lanes import Mover, apart, time_around
from tests.helpers.drives import make_drive
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.regions import place_polygon
from tests.helpers.strategies import examples, seeds

BOX = shapely.box(-0.35, -0.25, 0.35, 0.25)
LIMITS = {"max_velocity": 1.0, "max_acceleration": 0.5}
TURNS = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.5}


@pytest.fixture(scope="module")
def straight():
    """Return a disc of 0.3 m and its motion along 8 m."""
    space = build_empty((100, 60), "disc:0.3")
    return space, planners.plan(space, (1.0, 3.0), (9.0, 3.0)).trajectory(**LIMITS)


@pytest.fixture(scope="module")
def turning():
    """Return a rectangle and its motions with several drives and curves."""
    space = build_empty((120, 100), "rect:0.7x0.5", rotations=36)
    rng = np.random.default_rng(3)
    motions = []
    for kind in ("holonomic", "differential", "reeds-shepp", "holonomic", "differential"):
        start = (*rng.uniform((1, 1), (3, 9)), rng.uniform(-3, 3))
        goal = (*rng.uniform((8, 1), (11, 9)), rng.uniform(-3, 3))
        more = {} if kind == "reeds-shepp" else TURNS
        more = more | {"max_jerk": 1.0} if len(motions) == 3 else more
        plan = planners.plan(space, start, goal, drive=make_drive(kind, 0.5), seed=1)
        motions.append(plan.trajectory(**LIMITS, **more))
    return space, motions


def draw_others(rng, trajectory, count):
    """Return discs of 0.3 m that cross the path while the robot drives."""
    others = []
    for _ in range(count):
        when = rng.uniform(0.1, 0.9) * trajectory.duration
        ahead = rng.uniform(0.3, 1.2) * np.array([1.0, 0.0])
        angle = rng.uniform(-math.pi, math.pi)
        ahead = np.linalg.norm(ahead) * np.array([math.cos(angle), math.sin(angle)])
        spot = trajectory.sample(when)[0][:2]
        at = when + rng.uniform(-2.0, 2.0)
        others.append(Mover("disc:0.3", spot, at=at, velocity=ahead, error=0.02))
    return others


def measure_moved(trajectory):
    """Return how far a robot has moved and turned at 8,000 instants, and its speeds."""
    t = np.linspace(0.0, trajectory.duration, 8000)
    rates = trajectory.sample(t)[1]
    steps = np.linalg.norm(0.5 * (rates[1:] + rates[:-1]), axis=1) * (t[1] - t[0])
    return np.append(0.0, np.cumsum(steps)), np.linalg.norm(rates[:, :2], axis=1)


def check_follows(timed, free, is_car):
    """Check that a motion keeps the path of another one, and the limits."""
    t = np.linspace(0.0, timed.duration, 4000)
    p, v, _ = timed.sample(t)
    assert np.linalg.norm(v[:, :2], axis=1).max() <= 1.0 + 1e-6
    # A car accelerates across its way, too.
    most = 0.5 * (math.sqrt(2.0) if is_car else 1.0) * (1.0 + 1e-4) * (t[1] - t[0])
    assert np.linalg.norm(np.diff(v[:, :2], axis=0), axis=1).max() <= most + 1e-9
    if not is_car and p.shape[1] > 2:
        assert np.abs(v[:, 2]).max() <= 1.0 + 1e-6
        assert np.abs(np.diff(v[:, 2])).max() <= 1.5 * (1.0 + 1e-4) * (t[1] - t[0]) + 1e-9
    rows = free.sample(np.linspace(0.0, free.duration, 8000))[0][:, :2]
    away = shapely.distance(shapely.points(p[:, :2]), shapely.LineString(rows))
    assert away.max() < 1e-4
    # It is nowhere faster, by how far both have moved and turned.
    own, own_speeds = measure_moved(free)
    moved, speeds = measure_moved(timed)
    assert moved[-1] == pytest.approx(own[-1], abs=0.01)
    assert (speeds <= np.interp(moved, own, own_speeds) + 0.1).all()
    assert p[[0, -1]] == pytest.approx(free.sample([0.0, free.duration])[0], abs=1e-9)


@pytest.fixture(scope="module")
def various(turning):
    """Return a rectangle and motions with corners, short parts, rests, and slow parts."""
    space, motions = turning
    flat = build_empty((120, 100), "rect:0.7x0.5")
    corner = planners.plan(flat, (1.0, 2.0), (9.0, 7.0), via=[(8.0, 2.0)])
    steps = planners.plan(flat, (1.0, 6.0), (10.0, 6.05), via=[(5.0, 6.0), (5.0, 6.05)])
    zones = planners.SpeedZones([(shapely.box(4, 0, 6, 10), 0.35)])
    turn = planners.plan(space, (1, 6, -0.1), (10, 6, 0.0), drive=planners.Differential())
    cusp = planners.plan(space, (1, 3, 0), (10, 3, 1.2), drive=planners.Car(0.5, reverse=True))
    return space, [
        *motions,
        corner.trajectory(**LIMITS),
        corner.trajectory(**LIMITS, stop_at_via=True),
        corner.trajectory(**LIMITS, duration=30.0),
        corner.trajectory(**LIMITS, speed=zones),
        steps.trajectory(**LIMITS, blend=False),
        turn.trajectory(**LIMITS, **TURNS),
        cusp.trajectory(**LIMITS),
    ]


def search_by_own_time(free, others, until, spare):
    """Return the arrival, seconds, of a robot that changes its speed at once, or infinity.

    At each instant it goes on in its own motion, or rests, with a distance to spare.
    """
    count = math.ceil(free.duration / 0.1)
    places = np.linspace(0.0, free.duration, count + 1)
    robots = place_polygon(BOX, free.sample(places)[0])
    is_there, arrival = np.arange(count + 1) == 0, math.inf
    for t in np.arange(0.0, until, places[1]):
        for other in others:
            spot = shapely.Point(np.asarray(other.motion) + (t - other.at) * other.velocity)
            is_there &= shapely.distance(robots, spot) > 0.3 + other.error + spare
        if not is_there.any():
            return math.inf
        arrival = min(arrival, t) if is_there[-1] else math.inf
        is_there[1:] |= is_there[:-1].copy()
    return arrival


@examples(80)
@given(
    seed=seeds,
    number=st.integers(0, 11),
    count=st.integers(0, 3),
    begin=st.sampled_from([0.0, 50.0, 1.7e9, 1.7e12]),
)
@example(seed=3, number=6, count=1, begin=0.0)
@example(seed=1, number=7, count=1, begin=0.0)
@example(seed=1, number=10, count=2, begin=0.0)
@example(seed=1, number=11, count=2, begin=0.0)
def test_drawn_motions_keep_all_laws(various, seed, number, count, begin):
    space, motions = various
    free = motions[number]
    others = draw_others(np.random.default_rng(seed), free, count)
    shifted = [replace(other, at=begin + other.at) for other in others]
    robot = Mover(space.robot, free, at=begin)
    until = begin + 60.0 if others else None
    timing = time_around(robot, shifted, margin=0.1, until=until)
    assert others or timing.trajectory is free
    if timing:
        assert timing.arrival_bound <= timing.trajectory.duration
        check_follows(timing.trajectory, free, number in (2, 11))
        if number == 6:
            place = timing.trajectory.via_times
            assert timing.trajectory.sample(place)[1] == pytest.approx(np.zeros((1, 2)), abs=1e-3)
    # In 0.1 s, robot and others come nearer by at most 0.3 m.
    found = search_by_own_time(free, others, 60.0, 0.1 + 0.15)
    assert timing.arrival_bound <= found + 0.1


@pytest.mark.parametrize("gap", [-0.05, -1e-3, 1e-3, 0.05])
@pytest.mark.parametrize("margin", [0.0, 0.2])
def test_things_beside_the_path_are_decided_near_contact(straight, gap, margin):
    space, free = straight
    post = Mover("disc:0.2", (5.0, 3.0 + 0.5 + margin + gap), error=0.01)
    timing = time_around(Mover(space.robot, free, error=0.01), [post], margin=margin)
    if gap > 0.02:
        assert timing.trajectory.duration == free.duration
        assert timing.arrival_bound == pytest.approx(free.duration, abs=0.05)
    elif gap < -0.02:
        assert timing.reason.startswith("impossible: others[0] is in the way at 3")
    else:
        assert not timing


def test_a_robot_of_two_rectangles_is_blocked_as_its_distances_say():
    # Polygons overlap, and are blocked by the depth of what they share.
    space = build_empty((120, 100), "rect:0.7x0.5", rotations=36)
    plan = planners.plan(space, (1.0, 5.0, 0.0), (11.0, 5.0, 1.0))
    free = plan.trajectory(**LIMITS, **TURNS)
    crate = Mover("rect:0.4x0.4", (6.0, 5.1))
    timing = time_around(Mover(space.robot, free), [crate])
    assert timing.reason.startswith("impossible: others[0] is in the way at 4.") and not timing
    assert time_around(Mover(space.robot, free), [Mover("rect:0.4x0.4", (6.0, 6.0))])


def check_reason(timing, text, *numbers):
    """Check the words of a reason, and its numbers within the size of a cell."""
    assert timing.trajectory is None and math.isinf(timing.arrival_bound)
    found = re.findall(r"\d+\.\d", timing.reason)
    assert re.sub(r"\d+\.\d", "#", timing.reason) == text
    assert [float(each) for each in found] == pytest.approx(numbers, abs=0.16)


def test_reasons_say_who_is_in_the_way_where_and_when(straight):
    space, free = straight
    robot = Mover(space.robot, free, at=100.0)
    across = planners.plan(space, (6.0, 1.0), (6.0, 3.0)).trajectory(**LIMITS)
    far = Mover("disc:0.3", (5.0, 5.5))
    stops = time_around(robot, [far, Mover(space.robot, across, at=101.0)], margin=0.1)
    ends = "the robot gets there at # s at the earliest"
    text = f"impossible: others[1] is in the way at # m of the path from # s on; {ends}"
    check_reason(stops, text, 4.3, 105.0, 105.3)
    late = time_around(robot, [far], until=105.0)
    check_reason(late, "impossible: the path takes until 110 s at the least, longer than until=105")
    # One stands at the start, one passes the start, and one comes to the end.
    stands = time_around(robot, [Mover("disc:0.3", (1.2, 3.0))])
    text = f"impossible: others[0] is in the way at # m of the path from # s on; {ends}"
    check_reason(stands, text, 0.0, 100.0, 100.0)
    follows = Mover("disc:0.3", (-2.0, 3.0), at=100.0, velocity=(2.0, 0.0))
    caught = time_around(robot, [follows], until=150.0)
    text = f"impossible: others[0] is in the way at # m of the path from # s until # s; {ends}"
    check_reason(caught, text, 0.54, 101.47, 102.07, 101.47)
    passing = Mover("disc:0.3", (9.0, 1.0), at=130.0, velocity=(0.0, 0.5))
    comes = time_around(robot, [passing], until=134.0)
    check_reason(comes, text.replace("until # s", "on"), 8.0, 132.8, 110.0)
    timing = time_around(robot, [passing], until=160.0)
    assert 34.0 < timing.arrival_bound < timing.trajectory.duration < 37.5


def test_narrow_gaps_are_not_found_and_not_excluded(straight):
    space, free = straight
    walls = [Mover("disc:0.3", (5.0, 3.0 + side * 0.6000001)) for side in (-1, 1)]
    timing = time_around(Mover(space.robot, free), walls)
    assert timing.reason == "not found with cells of 2.5 cm; none is excluded"
    assert timing.arrival_bound == pytest.approx(free.duration, abs=0.05)


def test_times_are_stamps_and_errors_grow(straight):
    space, free = straight
    for begin in (0.0, 1.7e9, 1.7e12):
        person = Mover(
            "disc:0.3", (5.0, 1.0), at=begin + 2.0, velocity=(0.0, 0.6), error=0.05, growth=0.02
        )
        robot = Mover(space.robot, free, at=begin, error=0.03)
        timing = time_around(robot, [person], margin=0.1, until=begin + 40.0)
        late = timing.trajectory.duration - free.duration
        assert late == pytest.approx(2.1, abs=0.6)
        assert 0.9 * free.duration < timing.arrival_bound <= timing.trajectory.duration
        # It beside one that passed long ago needs no wait, by a sum of times that rounds.
        for end in (None, begin + free.duration):
            assert time_around(robot, [Mover("disc:0.3", (5.0, 5.0))], until=end).trajectory is free
    # Errors that have grown since before the start.
    post = Mover("disc:0.3", (5.0, 4.2), at=-10.0, growth=0.05)
    assert not time_around(Mover(space.robot, free), [post], until=10.0)
    assert time_around(Mover(space.robot, free), [replace(post, at=0.0)], until=10.0)
    # Errors that grow until the robot cannot stay at its end.
    person = Mover("disc:0.3", (9.0, 5.0), growth=0.1)
    timing = time_around(Mover(space.robot, free), [person], until=20.0)
    assert timing.reason.startswith("impossible: others[0] is in the way at")


def test_a_robot_waits_between_two_roads():
    # Others come one after the other, so that no early start lets the robot through at once.
    space = build_empty((120, 100), "rect:0.7x0.5")
    plan = planners.plan(space, (1.0, 5.0), (11.0, 5.0))
    free = plan.trajectory(**LIMITS)
    others = [
        Mover("disc:0.3", (x, 5.0), at=at, velocity=(0.0, sign), error=0.02)
        for x, sign in ((4.0, 1.0), (8.0, -1.0))
        for at in np.arange(0.0, 22.0, 3.2)
    ]
    timing = time_around(Mover(space.robot, free), others, margin=0.1, until=40.0)
    timed = timing.trajectory
    check_follows(timed, free, is_car=False)
    assert timing.arrival_bound <= timed.duration < free.duration + 3.5
    places, velocities, _ = timed.sample(np.linspace(0.0, timed.duration, 2000))
    is_between = (places[:, 0] > 4.0) & (places[:, 0] < 8.0)
    assert velocities[is_between, 0].min() < 0.01
    # Limited jerk leaves waits at the start alone.
    smooth = Mover(space.robot, plan.trajectory(**LIMITS, max_jerk=5.0))
    late = time_around(smooth, others, margin=0.1, until=40.0)
    assert late.trajectory.duration > free.duration + 10.0
    assert late.arrival_bound < free.duration + 3.5


def test_the_bound_of_a_car_alone_is_its_quickest_motion(turning):
    # It drives straight and on arcs, and stops where it changes its direction.
    space, motions = turning
    timing = time_around(Mover(space.robot, motions[2]), [])
    assert timing.trajectory.duration == motions[2].duration
    assert 0.999 * motions[2].duration <= timing.arrival_bound <= motions[2].duration


def test_robots_in_space_wait(straight):
    space = build_empty((40, 30, 20), cspace.Robot.ball(0.3), 0.2)
    plan = planners.plan(space, (1.0, 3.0, 2.0), (7.0, 3.0, 2.0))
    free = plan.trajectory(**LIMITS)
    other = Mover("ball:0.3", (4.0, 1.0, 2.0), velocity=(0.0, 0.5, 0.0), error=0.02)
    timing = time_around(Mover(space.robot, free), [other], margin=0.1, until=25.0)
    assert apart(Mover(space.robot, timing.trajectory), other, margin=0.1, until=25.0)
    t = np.linspace(0.0, 25.0, 3000)
    spots = np.array(other.motion) + np.outer(t, other.velocity)
    gaps = np.linalg.norm(timing.trajectory.sample(t)[0] - spots, axis=1)
    assert gaps.min() > 0.72
    post = Mover("ball:0.3", (4.0, 3.0, 2.0))
    timing = time_around(Mover(space.robot, free), [post], margin=0.1)
    assert timing.reason.startswith("impossible: others[0] is in the way at 2.")


@pytest.mark.parametrize("max_jerk", [None, 1.0])
def test_motions_with_waits_are_trajectories_as_others(straight, max_jerk):
    space, _ = straight
    plan = planners.plan(space, (1.0, 3.0), (9.0, 3.0))
    free = plan.trajectory(**LIMITS, max_jerk=max_jerk)
    person = Mover("disc:0.3", (4.0, 1.0), velocity=(0.0, 0.4))
    timing = time_around(Mover(space.robot, free), [person], margin=0.1, until=60.0)
    timed = timing.trajectory
    assert timed.duration > free.duration + 0.5
    assert timed.certified and timed.recheck(space).all()
    assert np.diff(timed.times).min() > 0.0 and timed.stop_reason == ""
    copy = pickle.loads(pickle.dumps(timed))
    t = np.linspace(0.0, timed.duration, 50)
    assert np.array_equal(copy.sample(t)[0], timed.sample(t)[0])
    assert timed.braked(0.1).duration == 0.0 and len(timed.starts_after(0.1)) == 1
    driving = timed.duration - 3.0
    stop = timed.braked(driving)
    assert stop.recheck(space).all() and 0.0 < stop.duration <= 3.0 + 1e-6
    onward = planners.plan(space, stop.positions[-1], (9.0, 1.0))
    assert onward.trajectory(**LIMITS, max_jerk=max_jerk, after=timed, at=driving).certified
    again = time_around(Mover(space.robot, timed), [person], margin=0.1, until=60.0)
    assert again.trajectory.duration == pytest.approx(timed.duration)


def test_a_robot_that_stands_needs_no_time(straight):
    space, _ = straight
    still = planners.plan(space, (1.0, 3.0), (1.0, 3.0)).trajectory(**LIMITS)
    passing = Mover("disc:0.3", (1.0, 5.0), velocity=(1.0, 0.0))
    timing = time_around(Mover(space.robot, still), [passing], until=5.0)
    assert timing.trajectory.duration == 0.0
    assert timing.arrival_bound == pytest.approx(0.0)
    nearing = Mover("disc:0.3", (1.0, 5.0), velocity=(0.0, -1.0))
    assert not time_around(Mover(space.robot, still), [nearing], until=5.0)


@refusals(
    "mover, others, options, message",
    (None, 3, {}, "others is a int; it must be a list of movers"),
    (None, [3], {}, "others[0] is a int; it must be a Mover"),
    (Mover("disc:0.3", (1.0, 2.0)), [], {}, "mover.motion has no times"),
    (None, [Mover("ball:0.3", (1.0, 2.0, 0.5))], {}, "others[0] moves in space, but mover in"),
    (None, [Mover("disc:0.3", (9, 9), velocity=(1, 0))], {}, "until is missing"),
    (None, [Mover("disc:0.3", (9, 9), growth=0.1)], {}, "until is missing"),
    (Mover("disc:0.3", (1.0, 2.0), at=1.7e18), [], {}, "mover.at is 1.7e+18 ... seconds ... 256 s"),
    (
        None,
        [Mover("disc:0.3", (9, 9), at=-1e13)],
        {},
        "others[0].at is -10000000000000.0 ... 0.001",
    ),
    (None, [], {"until": -1.0}, "until is -1; the motions begin at 0 s"),
    (None, [], {"margin": -1.0}, "margin is -1.0"),
)
def test_wrong_arguments_are_refused_in_one_line(straight, mover, others, options, message):
    space, free = straight
    robot = mover or Mover(space.robot, free)
    check_refused(lambda: time_around(robot, others, **options), message)


def test_a_robot_in_motion_cannot_wait(straight):
    space, free = straight
    with pytest.raises(InputError, match="begins in motion; a robot that waits begins at rest"):
        time_around(Mover(space.robot, free.braked(2.0)), [])
