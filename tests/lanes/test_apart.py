"""Two timed motions, against poses at every millisecond and against closed forms."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
import planners
from cspace.errors import InputError
from cspace.lanes import Mover, apart
from tests.helpers.drives import make_drive
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.regions import place_polygon
from tests.helpers.strategies import examples, few

NOTCHED = [(-0.4, -0.3), (0.4, -0.3), (0.4, -0.1), (-0.1, 0.0), (0.4, 0.1), (0.4, 0.3), (-0.4, 0.3)]

LIMITS = {"max_velocity": 1.0, "max_acceleration": 1.0}


def build(robot, rotations=36):
    """Return an empty map of 10 m by 8 m."""
    return build_empty((100, 80), robot, rotations=rotations)


@pytest.fixture(scope="module")
def driven():
    """Return a robot with a notch, and trajectories of several drives."""
    robot = cspace.Robot.polygon(NOTCHED)
    space = build(robot)
    rng = np.random.default_rng(1)
    trajectories = []
    limits = {"max_velocity": 1.0, "max_acceleration": 0.5}
    turns = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}
    for k, drive in enumerate(("differential", "holonomic", "reeds-shepp") * 3):
        start, goal = rng.uniform((1, 1, -3), (9, 7, 3), (2, 3))
        plan = planners.plan(space, start, goal, drive=make_drive(drive, 0.5), seed=1)
        more = {} if drive == "reeds-shepp" else turns
        more = more | {"max_jerk": 1.0} if k % 2 else more
        trajectories.append(plan.trajectory(**limits, **more))
    return robot, trajectories


def oracle(polygon, trajectory, at, t):
    """Return the robot at times: at rest before and after its trajectory."""
    rows = trajectory.sample(np.clip(t - at, 0.0, trajectory.duration))[0]
    return place_polygon(polygon, rows)


@pytest.mark.parametrize("count", few([6, 36]))
def test_trajectories_agree_with_every_millisecond(driven, count):
    robot, trajectories = driven
    polygon = shapely.Polygon(NOTCHED)
    seen = {"apart": 0, "touch": 0}
    pairs = list(itertools.combinations(range(len(trajectories)), 2))
    for k, j in pairs[:: len(pairs) // count]:
        at, distance = 0.7 * (k - j), 0.1 * (k % 2)
        movers = Mover(robot, trajectories[k], at=at), Mover(robot, trajectories[j])
        begin = min(at, 0.0)
        end = max(at + trajectories[k].duration, trajectories[j].duration)
        t = np.linspace(begin, end, int(1000 * (end - begin)))
        gaps = shapely.distance(
            oracle(polygon, trajectories[k], at, t), oracle(polygon, trajectories[j], 0.0, t)
        )
        if gaps[0] <= distance:
            with pytest.raises(InputError, match="touches second at the start"):
                apart(*movers, margin=distance)
            continue
        found = apart(*movers, margin=distance)
        assert found.interval == pytest.approx((begin, end))
        assert found.verdict != "undecided"
        seen[found.verdict] += 1
        if found:
            assert distance < found.distance <= gaps.min() + 1e-9
            assert found.distance >= distance + 0.7 * (gaps.min() - distance) - 1e-6
        else:
            first, second = (place_polygon(polygon, pose[np.newaxis])[0] for pose in found.poses)
            assert first.distance(second) <= distance + 1e-9
            assert found.poses[0] == pytest.approx(
                trajectories[k].sample(found.time - at)[0], abs=1e-9
            )
            touching = t[gaps <= distance]
            if len(touching):
                assert found.time <= touching[0] + 2e-3
    assert min(seen.values()) > 0


def test_the_ends_of_a_bar_that_turns_are_seen():
    space = build("rect:2.0x0.1")
    plan = planners.plan(space, (5.0, 4.0, 0.0), (5.0, 4.0, 2.8), drive=planners.Differential())
    trajectory = plan.trajectory(
        **LIMITS,
        max_angular_velocity=1.0,
        max_angular_acceleration=1.0,
    )
    bar = Mover(space.robot, trajectory)
    reach = math.hypot(1.0, 0.05)
    for angle in np.linspace(0.4, 2.4, 12):
        ahead = np.array([math.cos(angle), math.sin(angle)])
        for gap, verdict in ((-0.01, "touch"), (0.01, "apart")):
            post = Mover("disc:0.02", (5.0, 4.0) + (reach + 0.02 + gap) * ahead)
            found = apart(bar, post)
            assert found.verdict == verdict, angle
            assert found.distance <= max(gap, 0.0) + 1e-9


def closest(step, velocity, duration):
    """Return the least distance of two points that move evenly."""
    share = np.clip(-(step @ velocity) / max(velocity @ velocity, 1e-300), 0.0, duration)
    return float(np.linalg.norm(step + share * velocity))


@examples(150)
@given(
    angle=st.floats(-math.pi, math.pi),
    speed=st.floats(0.1, 3.0),
    gap=st.sampled_from([-0.01, -1e-5, 1e-5, 0.01, 0.4]),
    dims=st.sampled_from([2, 3]),
    stamp=st.sampled_from([0.0, 1.7e9, 1.7e12]),
)
def test_discs_and_balls_that_pass_are_decided(angle, speed, gap, dims, stamp):
    # They pass at a distance of 0.7 m and the gap.
    ahead = np.array([math.cos(angle), math.sin(angle), 0.0])[:dims]
    side = np.array([-math.sin(angle), math.cos(angle), 0.0])[:dims]
    start = -3.0 * ahead + (0.7 + gap) * side
    make = cspace.Robot.disc if dims == 2 else cspace.Robot.ball
    moving = Mover(make(0.3), start, velocity=speed * ahead, at=stamp)
    still = Mover(make(0.4), np.zeros(dims), at=stamp)
    found = apart(moving, still, until=stamp + 6.0 / speed)
    assert found.verdict == ("apart" if gap > 0 else "touch")
    if found:
        assert 0.7 * gap < found.distance <= closest(start, speed * ahead, 6.0 / speed) - 0.7 + 1e-9
    else:
        reach = math.sqrt(max(0.49 - (0.7 + gap) ** 2, 0.0))
        assert found.time - stamp == pytest.approx((3.0 - reach) / speed, abs=0.01)


def test_errors_grow_until_robots_may_touch():
    still = Mover("disc:0.5", (0.0, 0.0))
    # The gap is 1 m, and the error 0.1 m and 0.1 m/s from 2 s on.
    drifting = Mover("disc:0.5", (2.0, 0.0), at=2.0, error=0.1, growth=0.1)
    assert 0.0 < apart(still, drifting, until=10.9).distance <= 0.01 + 1e-9
    found = apart(still, drifting, until=12.0)
    assert found.verdict == "touch"
    assert found.time == pytest.approx(11.0, abs=0.01)
    assert found.poses[1][0] == pytest.approx(1.0, abs=0.01)
    assert found.poses[0].tolist() == [0.0, 0.0, 0.0]
    assert apart(still, drifting, until=6.9, margin=0.4)
    assert apart(still, drifting, until=7.1, margin=0.4).verdict == "touch"


def test_a_robot_stays_where_it_starts_and_where_it_ends():
    space = build("disc:0.3", rotations=None)
    plan = planners.plan(space, (1.0, 4.0), (9.0, 4.0))
    trajectory = plan.trajectory(**LIMITS)
    robot = Mover(space.robot, trajectory, at=5.0)
    assert apart(robot, Mover("disc:0.2", (9.0, 30.0))).interval == (5.0, 5.0 + trajectory.duration)
    # Another robot passes its start before it leaves.
    across = planners.plan(space, (1.0, 1.0), (1.0, 7.0))
    other = across.trajectory(**LIMITS)
    assert apart(robot, Mover(space.robot, other)).time < 5.0
    # Another one passes the end long after the robot came there.
    later = Mover("disc:0.2", (9.0, 30.0), velocity=(0.0, -1.0))
    found = apart(robot, later, until=40.0)
    assert found.verdict == "touch"
    assert found.time == pytest.approx(26.0 - 0.5, abs=0.01)


def test_time_begins_when_the_first_of_both_moves():
    space = build("disc:0.3", rotations=None)
    plan = planners.plan(space, (1.0, 4.0), (9.0, 4.0))
    trajectory = plan.trajectory(**LIMITS)
    robot = Mover(space.robot, trajectory, at=12.0)
    end = 12.0 + trajectory.duration
    for thing, interval in (
        (Mover("disc:0.2", (5.0, 30.0), velocity=(0.0, 1.0)), (0.0, end)),
        (Mover("disc:0.2", (5.0, 30.0), velocity=(0.0, 1.0), at=50.0), (12.0, 50.0)),
        (Mover("disc:0.2", (5.0, 30.0), growth=0.1), (0.0, end)),
        (Mover("disc:0.2", (5.0, 30.0), velocity=(0.0, 0.0)), (12.0, end)),
        (Mover("disc:0.2", (5.0, 30.0), at=50.0, error=0.1), (12.0, end)),
    ):
        assert apart(robot, thing).interval == interval
        assert apart(thing, robot).interval == interval


@pytest.mark.parametrize("count", few([6, 40]))
def test_boxes_in_space_agree_with_their_outlines(count):
    rng = np.random.default_rng(4)
    sizes = rng.uniform(0.3, 1.5, (count, 2, 3))
    seen = {"apart": 0, "touch": 0, "undecided": 0}
    for (first, second), yaws in zip(sizes, rng.uniform(-3, 3, (count, 2)), strict=True):
        start = rng.uniform((-4, -1, -1), (-3, 1, 1))
        velocity = np.array([1.0, *rng.uniform(-0.2, 0.2, 2)])
        movers = (
            Mover(cspace.Robot.box(first), (*start, yaws[0]), velocity=velocity),
            Mover(cspace.Robot.box(second), (0.0, 0.0, 0.0, yaws[1])),
        )
        t = np.linspace(0.0, 7.0, 2000)
        shapes = [shapely.box(*(-size[:2] / 2), *(size[:2] / 2)) for size in (first, second)]
        places = start + t[:, None] * velocity
        flat = shapely.distance(
            place_polygon(shapes[0], np.insert(places[:, :2], 2, yaws[0], axis=1)),
            place_polygon(shapes[1], np.array([(0.0, 0.0, yaws[1])])),
        )
        gaps = np.hypot(flat, np.maximum(np.abs(places[:, 2]) - (first + second)[2] / 2, 0.0))
        found = apart(*movers, until=7.0)
        seen[found.verdict] += 1
        if found:
            assert 0.0 < found.distance <= gaps.min() + 1e-9
        elif found.verdict == "touch":
            assert gaps.min() < 1e-3
        else:
            assert gaps.min() < 1e-3
    assert seen["apart"] > 0
    assert seen["touch"] > 0
    assert seen["undecided"] <= 0.2 * count


def test_meshes_that_nest_touch():
    large = cspace.Robot.box((2.0, 2.0, 2.0))
    small = Mover(cspace.Robot.box((0.1, 0.1, 0.1)), (-3.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
    found = apart(small, Mover(large, (0.0, 0.0, 0.0)), until=3.0)
    assert found.verdict == "touch"
    tall = Mover(cspace.Robot.cylinder(0.3, 1.0), (-3.0, 2.0, 0.0), velocity=(1.0, 0.0, 0.0))
    assert apart(tall, Mover(large, (0.0, 0.0, 0.0)), until=6.0).distance > 0.5


def test_verdicts_are_symmetric_and_larger_robots_touch_too(driven):
    robot, trajectories = driven
    for k, j in itertools.combinations(range(4), 2):
        movers = [Mover(robot, trajectories[n], at=0.5 * n) for n in (k, j)]
        verdicts = []
        for distance in (0.0, 0.2, 0.5):
            try:
                found = apart(*movers, margin=distance)
                back = apart(*movers[::-1], margin=distance)
            except InputError:
                break
            assert found.verdict == back.verdict
            verdicts.append(found.verdict)
        assert verdicts == sorted(verdicts)  # "apart" comes before "touch"


def test_an_ellipse_is_apart_by_its_outer_and_touches_by_its_inner_bound():
    wide = cspace.Robot.ellipse(0.5, 0.2)
    for gap, verdict in ((0.01, "apart"), (-0.01, "touch")):
        moving = Mover(wide, (-3.0, 0.4 + gap), velocity=(1.0, 0.0))
        assert apart(moving, Mover(wide, (0.0, 0.0)), until=6.0).verdict == verdict


@pytest.mark.parametrize("robot", ["disc:0.3", "ball:0.3"])
def test_things_that_move_alike_keep_their_distance(robot):
    dims = 2 if robot == "disc:0.3" else 3
    velocity = np.array([1.0, -0.5, 0.25])[:dims]
    ahead = 0.7 * np.eye(dims)[0]
    first = Mover(robot, ahead, velocity=velocity)
    second = Mover(robot, 2.0 * ahead - 2.0 * velocity, velocity=velocity, at=-2.0)
    found = apart(first, second, until=1e6)
    assert 0.08 < found.distance <= 0.1
    slower = Mover(robot, 2.0 * ahead, velocity=(1.0 - 1e-5) * velocity)
    found = apart(first, slower, until=1e6)
    assert found.verdict == "touch"
    assert found.time == pytest.approx(1e4, rel=0.05)


@pytest.mark.parametrize("max_jerk", [None, 1.0])
def test_a_convoy_keeps_its_distance_for_a_kilometre(max_jerk):
    space = build_empty((2200, 20), "disc:0.3", 0.5)
    limits = {**LIMITS, "max_jerk": max_jerk}
    front, rear = (
        planners.plan(space, (x, 5.0), (x + 1000.0, 5.0)).trajectory(**limits) for x in (2.8, 2.0)
    )
    for late, gap in ((0.0, 0.2), (0.3, 0.2), (-0.1, 0.1)):
        found = apart(Mover("disc:0.3", front), Mover("disc:0.3", rear, at=late))
        assert 0.7 * gap < found.distance <= gap + 1e-9
    found = apart(Mover("disc:0.3", front), Mover("disc:0.3", rear, at=-0.3))
    assert found.verdict == "touch"
    assert found.time < 3.0


def test_equal_speeds_in_the_middle_prove_nothing_of_one_that_brakes():
    space = build_empty((200, 20), "disc:0.3", 0.1)
    drive = planners.plan(space, (2.0, 1.0), (12.0, 1.0)).trajectory(**LIMITS)
    stop = drive.braked(3.0)
    # After half a second both drive at about 0.5 m/s, an eighth of a metre farther apart.
    front = Mover("disc:0.3", stop)
    for speed, gap in ((0.52, -0.015), (0.5, 0.005)):
        rear = Mover("disc:0.3", stop.path[0] - (0.605, 0.0), velocity=(speed, 0.0))
        found = apart(front, rear, until=1.0)
        assert (found.verdict == "touch") == (gap < 0.0)
        assert found.distance <= 0.005 + 1e-9


def test_things_on_the_tangent_of_an_arc_are_met():
    # In the middle of its way the car moves alike, so that its turning alone brings it nearer.
    space = build("disc:0.05")
    rng = np.random.default_rng(0)
    for _ in range(20):
        radius, angle, share = rng.uniform((1.5, 2.0, 0.2), (2.5, 3.0, 0.8))
        goal = 4.0 + radius * math.sin(angle), 2.0 + radius * (1.0 - math.cos(angle)), angle
        plan = planners.plan(space, (4.0, 2.0, 0.0), goal, drive=planners.Car(radius))
        arc = plan.trajectory(max_velocity=0.6, max_acceleration=0.5)
        met, velocity = share * arc.duration, arc.sample(0.5 * arc.duration)[1][:2]
        thing = Mover("disc:0.05", arc.sample(met)[0][:2], at=met, velocity=velocity)
        assert apart(Mover(space.robot, arc), thing, until=500.0).verdict == "touch"


@pytest.mark.parametrize(
    "speed, robot",
    few(
        itertools.chain(
            zip((1e80, 1e40, 1.0, 1e-40), 2 * ("disc", "ball"), strict=True),
            zip((1e80, 1e40, 1.0, 1e-40), 2 * ("ball", "disc"), strict=True),
        )
    ),
)
def test_bounds_that_overflow_prove_nothing(speed, robot):
    dim = 2 if robot == "disc" else 3
    still = Mover(f"{robot}:0.3", 5.0 * np.eye(dim)[0])
    moving = Mover(f"{robot}:0.3", np.zeros(dim), velocity=speed * np.eye(dim)[0])
    assert apart(moving, still, until=1e100).verdict != "apart"


@pytest.mark.parametrize("seconds", few([1e13, 1e9]))
def test_rounding_of_far_places_and_times_proves_nothing(seconds):
    rng = np.random.default_rng(9)
    still = Mover("disc:0.4", (0.0, 0.0))
    reach = Fraction(0.3) + Fraction(0.4)
    touching = 0
    for _ in range(40):
        speed, end = rng.uniform((0.2, seconds), (3.0, 2.0 * seconds))
        start = -speed * end - 0.7
        # Exactly, where the disc comes within the reach of the other one at the end, or not.
        touches = -(Fraction(start) + Fraction(speed) * Fraction(end)) <= reach
        found = apart(Mover("disc:0.3", (start, 0.0), velocity=(speed, 0.0)), still, until=end)
        assert not (touches and found)
        touching += touches
    assert touching > 10


STILL = Mover("disc:0.3", (0.0, 0.0))
PERSON = Mover("disc:0.3", (3.0, 0.0), velocity=(1.0, 0.0))


@refusals(
    "second, options, message",
    (3, {}, "second is a int ... Mover"),
    (Mover("disc:0.3", (0.1, 0.0)), {}, "first touches second at the start, at 0 s"),
    (
        Mover("disc:0.3", (0.7, 0.0)),
        {"margin": 0.2},
        "first touches second at the start, at 0 s ... 0.2",
    ),
    (Mover("disc:0.3", (0.7, 0.0), error=0.2), {}, "touches second at the start"),
    (
        Mover("disc:0.3", (1.0,)),
        {},
        "second.motion has shape (1,) ... 0.3",
    ),
    (
        Mover("ball:0.3", (1.0, 2.0, 0.5)),
        {},
        "second moves in space, but first in the plane",
    ),
    (Mover("disc:0.3", (3.0, 0.0), at="now"), {}, "second.at is 'now'"),
    (
        Mover("disc:0.3", (3.0, 0.0), at=(2.0, 3.0)),
        {},
        "second.at is (2.0, 3.0) ... one number",
    ),
    (Mover("disc:0.3", (3.0, 0.0), at=1.7e18), {}, "second.at is 1.7e+18 ... seconds ... 256 s"),
    (Mover("disc:0.3", (3.0, 0.0), error=-1.0), {}, "second.error is -1.0"),
    (Mover("disc:0.3", (3.0, 0.0), growth=math.nan), {}, "second.growth is nan"),
    (Mover("disc:0.3", (3.0, 0.0), velocity=(1.0,)), {}, "second.velocity"),
    (PERSON, {}, "until is missing ... thing"),
    (PERSON, {"until": [1.0, 2.0]}, "until is [1.0, 2.0] ... one number"),
    (PERSON, {"until": 1.1e100}, "until is 1.1e+100 ... -1e+100 to 1e+100"),
    (Mover("disc:0.3", (3.0, 0.0), velocity=(-1e101, 0.0)), {}, "velocity[0] is -1e+101"),
    (Mover("disc:0.3", (3.0, 1e101)), {}, "second.motion[1] is 1e+101"),
    (Mover("disc:0.3", (3.0, 0.0, 2e6)), {}, "second.motion has a yaw of 2e+06 rad ... 1048576"),
    (PERSON, {"until": -1.0}, "until is -1 ... motions"),
    (PERSON, {"until": 10.0, "margin": -1.0}, "margin is -1.0"),
)
def test_wrong_arguments_are_refused_in_one_line(second, options, message):
    check_refused(lambda: apart(**{"first": STILL, "second": second} | options), message)


def test_a_shape_moves_like_the_robot_of_it():
    square = shapely.box(-0.5, -0.5, 0.5, 0.5)
    shape, robot = (apart(Mover(each, (9.0, 9.0)), STILL) for each in (square, "rect:1x1"))
    assert shape.verdict == "apart" and shape.distance == pytest.approx(robot.distance)


def test_wrong_trajectories(driven, tmp_path):
    robot, trajectories = driven
    solid = cspace.Robot.ball(0.3)
    with pytest.raises(InputError, match="and perhaps yaw"):
        apart(Mover(solid, trajectories[0]), Mover(solid, (9.0, 9.0, 9.0)))
    box = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
    slide = '<joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/>'
    slide += '<limit lower="0" upper="2" effort="1" velocity="0.5"/></joint>'
    (tmp_path / "slide.urdf").write_text(
        f'<robot name="s"><link name="base"/><link name="cart">{box}</link>{slide}</robot>'
    )
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(tmp_path / "slide.urdf"))
    moved = planners.Trajectory.along(space, [(0.0,), (1.0,)], max_acceleration=1.0)
    with pytest.raises(InputError, match=r"has the axes slide; that of disc 0\.3 m has x, y"):
        apart(Mover("disc:0.3", moved), STILL)
    with pytest.raises(InputError, match=r"first\.velocity is given.*trajectory"):
        apart(Mover(robot, trajectories[0], velocity=(1.0, 0.0)), STILL)


def test_frames_must_agree():
    plans = []
    cells = np.zeros((60, 60), dtype=np.bool_)
    for frame in ("map", "hall"):
        grid = cspace.Grid((0.0, 0.0), 0.1, cells.shape, frame_id=frame)
        space = cspace.build(cspace.Workspace(grid, cells, cells), "disc:0.2")
        plan = planners.plan(space, (1.0, 1.0), (5.0, 5.0))
        plans.append(plan.trajectory(**LIMITS))
    with pytest.raises(InputError, match="has the frame 'hall', but first has 'map'"):
        apart(Mover("disc:0.2", plans[0]), Mover("disc:0.2", plans[1], at=20.0))


def test_motions_of_two_clocks_are_told_and_things_that_stand_have_none():
    seen = Mover("disc:0.2", (0.0, 0.0), at=1.7e9, velocity=(1.0, 0.0))
    with pytest.warns(UserWarning, match="days apart"):
        apart(seen, Mover("disc:0.2", (5.0, 5.0), velocity=(0.0, 1.0)), until=1.7e9 + 5.0)
    assert apart(seen, Mover("disc:0.2", (5.0, 5.0)), until=1.7e9 + 5.0).verdict == "apart"
