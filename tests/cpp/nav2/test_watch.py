"""The watch of the gate for Nav2 keeps a robot from walls and people, whatever its inputs do."""

import math
import subprocess

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation
from shapely import affinity

import cspace
from tests.helpers.cpp import SANITIZERS, why_no_compiler
from tests.helpers.watch import (
    BRAKES,
    CLOCK,
    DT,
    WALLS,
    Frame,
    People,
    Robot,
    WatchInCpp,
    build_watch,
    make_frame,
    save_room,
    send_scan,
)

pytestmark = pytest.mark.skipif(bool(why_no_compiler()), reason=why_no_compiler())

SWEEP = 100_000_000
"""Nanoseconds of a turn of a laser."""

CELLS = 0.05 * np.stack(np.meshgrid(np.arange(120), np.arange(80), indexing="ij"), axis=-1)
"""Lower corners of the cells of a room, metres."""

FREE = [math.inf] * 360
"""A scan that sees nothing."""


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """Return the program with the sanitizers, which end it at the first fault."""
    target = tmp_path_factory.mktemp("program") / "watch"
    return build_watch(target, "-O1", *SANITIZERS, "-fno-sanitize-recover=all")


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return save_room(tmp_path_factory.mktemp("room"))


# ---- drives among people -------------------------------------------------------------------------


MOUNTS = {
    "upside down": Frame(Rotation.from_euler("x", math.pi), np.array((0.1, 0.0, 0.25))),
    "tilted": Frame(Rotation.from_euler("yz", (0.08, 2.0)), np.array((-0.1, 0.05, 0.3))),
}
REACTIONS = {"sweep": 0.15, "late": 0.3, "delayed": 0.3, "stale": 0.4, "unknown": 0.4}
"""Seconds after which the robot knows of a step at the latest, for kinds where that is not at once."""

KINDS = ["random", "upside down", "tilted", *REACTIONS, "faults"]


def disturb(kind, watch, robot, people, rng, cycle, scans):
    """Send what the laser sees, or what the kind of drive makes of it; ``scans`` are on their way."""
    ranges = robot.scan(people.places)
    outage = cycle % 20 >= 10 and rng.random() < 0.9
    if kind == "late":
        robot.late = round(1e9 * rng.uniform(0.0, 0.25))
    robot.unknown = ("laser",) if kind == "unknown" and outage else ()
    if kind == "stale" and outage:
        if rng.random() < 0.5:  # of long ago, or of a time to come
            send_scan(watch, robot, FREE, robot.now + rng.choice([-2, 2]) * 10**9)
        return
    if kind == "faults" and rng.random() < 0.2:
        send_scan(watch, robot, rng.choice([math.nan, 0.0, -1.0]) * np.ones(360))
        return
    if kind == "sweep":
        ranges = robot.scan(people.places, 120, SWEEP)
        send_scan(watch, robot, ranges, robot.now - SWEEP, sweep=SWEEP)
        return
    scans.append((ranges, robot.now))
    if kind != "delayed" or len(scans) > 4:
        send_scan(watch, robot, *scans.pop(0))


def drive_among_people(watch, kind, seed):
    """Drive among people; return the way, and the numbers of cycles near people and without a way."""
    rng = np.random.default_rng(seed)
    people = People(rng, REACTIONS.get(kind, 0.0))
    robot = Robot((1.5, 2.0, rng.uniform(-3.0, 3.0)), MOUNTS.get(kind))
    watch.tell("new")
    way, near, braked, scans = 0.0, 0, 0, []
    for cycle in range(80):
        if cycle % 8 == 0:
            wanted = rng.normal((0.4, 0.0), (0.5, 1.0)) * (rng.random(2) < 0.8)
            wanted = np.clip(wanted, (-0.8, -1.5), (0.8, 1.5))
        people.step(robot.pose, robot.brake())
        before = robot.twist
        disturb(kind, watch, robot, people, rng, cycle, scans)
        silly = kind == "faults" and rng.random() < 0.1
        watch.tell("command", robot.now, *(wanted + (math.nan if silly else 0.0)).tolist())
        decided = watch.decide(robot.now, robot.now + CLOCK, robot.look_up)
        assert (np.abs(before) - np.abs(decided.twist) <= DT * BRAKES + 1e-9).all()
        bodies = robot.drive(decided.twist)
        distance = people.measure_distance(bodies)
        if decided.twist.any():
            assert shapely.distance(np.array(bodies), WALLS).min() > 0.0
            assert distance > 0.0, (kind, seed, cycle, decided)
        near += distance < 0.03
        way += DT * abs(decided.twist[0])
        braked += bool(decided.reason)
    return way, near, braked


@pytest.mark.parametrize(
    "count",
    [1, pytest.param(28, id="252 drives", marks=pytest.mark.thorough)],
)
@pytest.mark.parametrize("kind", KINDS)
def test_drives_among_people_who_step_in_touch_nothing(program, room, kind, count):
    watch = WatchInCpp(program, room)
    drives = [drive_among_people(watch, kind, seed) for seed in range(count)]
    watch.close()
    way, near, braked = np.sum(drives, axis=0)
    assert way > 0.15 * count and braked >= count
    assert kind in REACTIONS or near > 3 * count


def see(pose, wall):
    """Return the ranges of a laser in the middle of a robot, which sees only a wall."""
    yaws = pose[2] + 2.0 * math.pi / 360 * np.arange(360)
    ends = pose[:2] + 20.0 * np.stack((np.cos(yaws), np.sin(yaws)), axis=1)
    rays = shapely.linestrings(np.stack((np.broadcast_to(pose[:2], ends.shape), ends), axis=1))
    hits = shapely.intersection(rays, wall)
    ranges = shapely.distance(shapely.points(*pose[:2]), hits)
    return np.where(shapely.is_empty(hits), 9.0, ranges)


@pytest.mark.parametrize(
    "width, tilt, passes, is_seen",
    [
        (0.5, 0, True, False),
        (0.45, 0, False, False),
        (0.62, 20, True, False),
        (0.55, 20, False, False),
        (0.54, 0, True, True),
        (0.52, 0, False, True),
    ],
)
def test_the_narrowest_doors_that_it_lets_through(program, tmp_path, width, tilt, passes, is_seen):
    """A robot 0.40 m wide drives straight through the middle of a door that its map or its laser has."""
    middle, way = (
        np.array((3.0, 2.0)),
        np.array((math.cos(math.radians(tilt)), math.sin(math.radians(tilt)))),
    )
    wall = [shapely.box(2.9, -9, 3.1, 2 - width / 2), shapely.box(2.9, 2 + width / 2, 3.1, 9)]
    wall = affinity.rotate(shapely.union_all(wall), tilt, (3.0, 2.0))
    cells = shapely.box(*np.moveaxis(CELLS, -1, 0), *np.moveaxis(CELLS + 0.05, -1, 0))
    taken = (shapely.area(shapely.intersection(cells, wall)) > 1e-9) & (not is_seen)
    workspace = cspace.Workspace.from_array(taken, 0.05)
    cspace.build(workspace, cspace.Robot.rectangle(0.6, 0.4), rotations=72).save(tmp_path / "map")
    watch = WatchInCpp(program, tmp_path / "map", point_radius=0.03)
    mount = make_frame(0.0, 0.0, 0.0, 0.25)
    robot = Robot((*(middle - way), math.radians(tilt)), mount)
    for _ in range(100):
        send_scan(watch, robot, see(robot.pose, wall) if is_seen else FREE)
        watch.tell("command", robot.now, 0.5, 0.0)
        decided = watch.decide(robot.now, robot.now + CLOCK, robot.look_up)
        assert shapely.distance(np.array(robot.drive(decided.twist)), wall).min() > 0.0
    watch.close()
    assert ((robot.pose[:2] - middle) @ way > 0.5) == passes


# ---- what is missing, late or wrong --------------------------------------------------------------


def step(watch, robot, wanted=(0.6, 0.3), silent="", ranges=FREE):
    """Go on by a cycle, in which one input may be silent; return what the watch decides."""
    if silent != "scan":
        send_scan(watch, robot, ranges)
    if silent != "command":
        watch.tell("command", robot.now, *wanted)
    decided = watch.decide(robot.now, robot.now + CLOCK, robot.look_up)
    bodies = robot.drive(decided.twist)
    assert shapely.distance(np.array(bodies), WALLS).min() > 0.0
    return decided


@pytest.fixture
def watch(program, room):
    watch = WatchInCpp(program, room)
    yield watch
    watch.close()


@pytest.fixture
def robot(watch):
    """Return a robot that drives ahead."""
    robot = Robot((1.0, 1.0, 0.0))
    for _ in range(6):
        decided = step(watch, robot, (0.6, 0.0))
    assert decided.twist.tolist() == [0.6, 0.0] and not decided.reason
    return robot


def brakes_at_once(robot, decided):
    """Return whether the robot is slowed down as hard as it can be, and no harder."""
    return decided.twist[0] == pytest.approx(robot.cycles[-2][2][0] - DT * BRAKES[0])


def count_cycles(watch, robot, silent, reason):
    """Return the number of cycles that drive on; then see the robot come to rest, and why."""
    cycles = 0
    while not (decided := step(watch, robot, (0.6, 0.0), silent)).reason:
        cycles += 1
    assert reason in decided.reason and brakes_at_once(robot, decided)
    while decided.twist.any():
        decided = step(watch, robot, (0.6, 0.0), silent)
        assert reason in decided.reason
    return cycles


@pytest.mark.parametrize(
    "silent, reason",
    [
        ("scan", "no scan of 'scan' within 0.3 s"),
        ("command", "no command within 0.3 s"),
    ],
)
def test_it_brakes_one_period_after_an_input_is_too_old(watch, robot, silent, reason):
    assert count_cycles(watch, robot, silent, reason) == 6
    step(watch, robot)
    assert not step(watch, robot).reason


def test_a_robot_that_turns_round_has_no_reason_to_stand(watch, robot):
    decided = [step(watch, robot, (-0.4, 0.0)) for _ in range(24)]
    assert [each.reason for each in decided] == [""] * 24
    assert decided[-1].twist.tolist() == [-0.4, 0.0]


def test_a_scan_is_as_old_as_its_stamp(watch, robot):
    """Of 0.3 s, a scan from 0.25 s ago leaves a cycle more."""
    for _ in range(6):
        send_scan(watch, robot, FREE, robot.now - 250_000_000)
        assert not step(watch, robot, (0.6, 0.0), "scan").reason
    assert count_cycles(watch, robot, "scan", "no scan of 'scan' within 0.3 s") == 1


def test_it_brakes_after_a_cycle_that_was_late(watch, robot):
    robot.now += 310_000_000
    decided = step(watch, robot, (0.6, 0.0))
    assert decided.reason == "there was no cycle within 0.3 s" and brakes_at_once(robot, decided)
    assert not step(watch, robot, (0.6, 0.0)).reason


def test_it_brakes_without_a_map(program):
    watch, robot = WatchInCpp(program, "none"), Robot((1.0, 1.0, 0.0))
    for _ in range(3):
        decided = step(watch, robot)
        assert decided.reason == "there is no map" and not decided.twist.any()
    watch.close()


@pytest.mark.parametrize("frame", ["laser", "base_link", "odom", "map"])
def test_it_brakes_at_once_if_a_frame_is_unknown(watch, robot, frame):
    robot.unknown = (frame,)
    assert count_cycles(watch, robot, "", f"tf has no frame {frame}") == 0
    robot.unknown = ()
    step(watch, robot)
    assert not step(watch, robot).reason


@pytest.mark.parametrize("late, drives", [(0.29, True), (0.31, False)])
def test_a_late_tf_counts_by_its_stamp(watch, robot, late, drives):
    robot.late = round(late * 1e9)
    decided = step(watch, robot, (0.6, 0.0))
    assert not decided.reason if drives else "pose of base_link" in decided.reason


@pytest.mark.parametrize("late", ["tf", "scan"])
def test_scans_are_placed_at_their_stamp(watch, robot, late):
    """The robot drives on before a scan comes, or tf knows its time; a post is where it was seen."""
    post = robot.pose[:2] + np.array((0.95, 0.0))
    scans = []
    while robot.now < 2_000_000_000:
        robot.late = 150_000_000 if late == "tf" else 0
        scans.append((robot.scan([post]), robot.now))
        if late == "tf" or len(scans) > 4:
            send_scan(watch, robot, *scans.pop(0))
        decided = step(watch, robot, (0.6, 0.0), "scan")
        gap = post[0] - 0.2 - robot.pose[0] - 0.3
        assert gap > 0.0 or not decided.twist.any()
    assert not decided.twist.any() and 0.0 < gap < 0.1


def count_turning(watch, robot, post, sweep):
    """Return for how many cycles a robot turns towards a post before it is slowed down."""
    watch.tell("new")
    robot.now, robot.cycles = 0, [(0, np.array((1.0, 1.0, 0.0)), np.zeros(2))]
    cycles = -1  # the first one stands
    while cycles < 1 or robot.twist[1] == -1.5:
        ranges = robot.scan([post], 180, sweep)
        send_scan(watch, robot, ranges, robot.now - sweep, sweep=sweep)
        step(watch, robot, (0.0, -1.5), "scan")
        cycles += 1
    return cycles


def test_rays_of_a_sweep_are_placed_where_the_laser_was(watch, robot):
    """A robot that turns by 0.3 radians in a sweep is slowed down where the last rays see a post."""
    post = 1.0 + 0.6 * np.array((math.cos(2.1), -math.sin(2.1)))
    at_once = count_turning(watch, robot, post, 0)
    assert abs(count_turning(watch, robot, post, 2 * SWEEP) - at_once) <= 1 < at_once


@pytest.mark.parametrize("jump", [(0.25, 0.0, 0.0), (0.0, 0.0, 0.25)])
@pytest.mark.parametrize("correction", [True, False], ids=["map", "odom"])
def test_it_brakes_for_a_while_if_the_pose_jumps(watch, robot, jump, correction):
    if correction:
        robot.odometry = make_moved(robot.odometry, jump)
    robot.cycles.append((robot.now, robot.pose + jump, robot.twist))
    decided = [step(watch, robot, (0.6, 0.0)) for _ in range(8)]
    assert brakes_at_once(robot, decided[-1]) or not decided[-1].reason
    reasons = [each.reason for each in decided]
    assert reasons[:7] == ["the pose jumped"] * 7 and not reasons[7]


def test_a_robot_moves_on_sideways_behind_a_late_tf(program, room):
    """It drives to a wall on its right, with a cycle late in between, and stands near it."""
    watch, robot = WatchInCpp(program, room, size=3), Robot((1.5, 3.0, 0.0))
    for cycle in range(90):
        robot.now += 240_000_000 * (cycle == 20)
        robot.late = 250_000_000
        send_scan(watch, robot, FREE, robot.now - robot.late)
        decided = step(watch, robot, (0.0, 0.1, -0.8), "scan")
        assert not decided.reason or cycle == 0 or robot.pose[1] < 0.6, (cycle, decided)
    watch.close()
    assert not robot.twist.any() and robot.pose[1] < 0.5


def make_moved(frame, jump):
    """Return a frame of odometry with which the robot is elsewhere in the map."""
    moved = Frame(Rotation.from_rotvec((0.0, 0.0, jump[2])), np.array((*jump[:2], 0.0)))
    return moved.then(frame)


def test_a_correction_of_the_place_moves_the_points_with_the_robot(watch, robot):
    """The robot stands before a post; if both are farther back in the map, it stands on."""
    post = robot.pose[:2] + np.array((0.95, 0.0))
    while step(watch, robot, (0.6, 0.0), ranges=robot.scan([post])).twist.any():
        pass
    robot.odometry = make_moved(robot.odometry, (-0.15, 0.0, 0.0))
    robot.cycles = [(0, robot.pose - (0.15, 0.0, 0.0), np.zeros(2))]
    for _ in range(5):
        assert not step(watch, robot, (0.6, 0.0), "scan").twist.any()
    for _ in range(5):
        assert not step(
            watch, robot, (0.6, 0.0), ranges=robot.scan([post - (0.15, 0.0)])
        ).twist.any()


@pytest.mark.parametrize(
    "turn",
    [(0.06, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0)],
    ids=["tilted", "zero", "nan"],
)
def test_it_brakes_if_the_robot_is_tilted_or_has_no_rotation(watch, robot, turn):
    def look_up(target, frame, stamp):
        words = robot.look_up(target, frame, stamp).split(" ")
        if frame == "base_link" and target == "map":
            words[3:7] = map(repr, turn)
        return " ".join(words)

    send_scan(watch, robot, FREE)
    watch.tell("command", robot.now, 0.6, 0.0)
    decided = watch.decide(robot.now, robot.now + CLOCK, look_up)
    expected = "tilted" if turn[3] else "transform of base_link is none"
    assert (expected if turn[0] == turn[0] else "is none") in decided.reason


@pytest.mark.parametrize("source", ["scan", "cloud"])
def test_each_source_must_be_heard(program, room, source):
    watch = WatchInCpp(program, room, sources="scan,cloud")
    robot = Robot((1.0, 1.0, 0.0))
    reasons = []
    for _ in range(3):
        if source == "cloud":
            watch.tell("cloud", "cloud", "laser", robot.now + CLOCK, "9.0 0.0 0.0")
        reasons.append(step(watch, robot, silent="" if source == "scan" else "scan").reason)
    missing = {"scan": "cloud", "cloud": "scan"}[source]
    assert f"no scan of '{missing}'" in reasons[-1]
    watch.close()


# ---- what sensors send ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "ranges, reason",
    [
        pytest.param(FREE, "", id="nothing is near"),
        pytest.param([1e6] * 4, "", id="points beyond the range"),
        pytest.param([0.01] * 300 + FREE, "", id="some below the least range"),
        pytest.param([0.01] * 360, "no ray", id="all below the least range"),
        pytest.param([math.nan] * 360, "no ray", id="no number"),
        pytest.param([], "no ray", id="empty"),
        pytest.param([-math.inf] * 360, "no ray", id="all too near"),
        pytest.param([-math.inf] * 90 + FREE[90:], "too near", id="those ahead too near"),
    ],
)
def test_scans_without_a_point_in_range(watch, robot, ranges, reason):
    decided = step(watch, robot, (0.6, 0.0), ranges=ranges)
    assert reason in decided.reason and bool(decided.reason) == bool(reason)
    assert not reason or brakes_at_once(robot, decided)
    assert not step(watch, robot, (0.6, 0.0)).reason


@pytest.mark.parametrize(
    "numbers",
    [
        (math.nan, 0.1, 0.0, 9.0),
        (1e30, 0.1, 0.0, 9.0),
        (0.0, 30.0, 0.0, 9.0),
        (0.0, math.inf, 0.0, 9.0),
        (0.0, 0.0, 0.0, 9.0),
        (0.0, 0.1, math.nan, 9.0),
        (0.0, 0.1, -1.0, 9.0),
        (0.0, 0.1, 2.0, 1.0),
        (0.0, 0.1, 0.0, math.nan),
        (0.0, 0.1, 0.0, 0.0),
        (0.0, 0.1, 0.0, 9.0, -0.1),
        (0.0, 0.1, 0.0, 9.0, 2.0),
        (0.0, 0.1, 0.0, 9.0, math.nan),
    ],
)
def test_scans_that_contradict_themselves_are_refused(watch, robot, numbers):
    numbers = (*numbers, 0.0)[:5]
    watch.tell("scan", "scan", "laser", robot.now + CLOCK, *numbers, "2.0 inf")
    decided = step(watch, robot, (0.6, 0.0), "scan")
    assert "of a scan are none" in decided.reason and brakes_at_once(robot, decided)


@pytest.mark.parametrize(
    "numbers, reason",
    [
        ((1, 2, 12, 24, 24), ""),
        ((1, 2, 12, 24, 23), "shorter"),
        ((2, 2, 12, 24, 24), "shorter"),
        ((1, 3, 12, 24, 24), "shorter"),
        ((2**32 - 1, 2**32 - 1, 12, 2**32 - 1, 24), "shorter"),
        ((1, 2, 8, 24, 24), "no field z"),
        ((0, 0, 12, 0, 0), "no point"),
        ((1, 0, 12, 0, 0), "no point"),
    ],
)
def test_clouds_that_contradict_themselves_are_refused(watch, robot, numbers, reason):
    watch.tell("bytes", "scan", "laser", robot.now + CLOCK, *numbers)
    decided = step(watch, robot, (0.6, 0.0), "scan")
    # Zeros are where the camera is, inside the robot.
    assert (reason or "too near") in decided.reason


def test_points_of_the_floor_and_above_the_robot_do_not_count(watch, robot):
    for height, counts in [(-0.25, False), (0.0, True), (1.7, True), (1.8, False)]:
        watch.tell("cloud", "scan", "laser", robot.now + CLOCK, f"0.25 0.0 {height}")
        decided = step(watch, robot, (0.6, 0.0), "scan")
        assert ("too near" in decided.reason) == counts
        for _ in range(12):
            step(watch, robot, (0.0, 0.0))
        step(watch, robot, (0.6, 0.0))


# ---- footprints ----------------------------------------------------------------------------------


FLAT, UPPER = [(0, 0), (0.5, 0), (0.5, 0.2), (0, 0.2)], [(0, 0.2), (0.2, 0.2), (0.2, 0.5), (0, 0.5)]
UPRIGHT = [(0, 0), (0.2, 0), (0.2, 0.5), (0, 0.5)]


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Save a map of each robot."""
    robots = {
        "rectangle": cspace.Robot.rectangle(0.6, 0.4),
        "ell": cspace.Robot.polygon([shapely.Polygon(FLAT), shapely.Polygon(UPPER)]),
        "disc": cspace.Robot.disc(0.3),
    }
    folder = tmp_path_factory.mktemp("robots")
    workspace = cspace.Workspace.from_array(np.zeros((20, 20), dtype=bool), 0.1)
    for name, robot in robots.items():
        cspace.build(workspace, robot, rotations=4).save(folder / name)
    return folder


def write_part(part):
    return str([list(corner) for corner in part])


SIDES = [(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)]


@pytest.mark.parametrize(
    "name, parts, answer",
    [
        ("rectangle", [], "1 parts"),
        ("rectangle", [SIDES], "1 parts"),
        ("rectangle", [SIDES[::-1]], "1 parts"),
        ("rectangle", [[(1.001 * x, y) for x, y in SIDES]], "not the robot"),
        ("rectangle", [[(0.999 * x, y) for x, y in SIDES]], "not the robot"),
        ("rectangle", [[(x + 0.01, y) for x, y in SIDES]], "not the robot"),
        ("rectangle", [SIDES[:3]], "not the robot"),
        ("rectangle", [SIDES, [(1, 1), (2, 1), (2, 2)]], "not the robot"),
        ("rectangle", ["[[0.3, 0.2], [0.3, -0.2], [-0.3]]"], "no list of pairs"),
        ("rectangle", ["[[0.3, 0.2], [0.3, -0.2], [nan, 0.2]]"], "no list of pairs"),
        ("rectangle", ["[[0.3, 0.2], [0.3, -0.2]]"], "no list of pairs"),
        ("rectangle", [""], "no list of pairs"),
        ("rectangle", [SIDES[2:] + SIDES[:2]], "1 parts"),
        ("rectangle", [SIDES, SIDES], "not the robot"),
        ("ell", [], "2 parts"),
        ("ell", [FLAT, UPPER], "2 parts"),
        ("ell", [UPPER[::-1], FLAT], "2 parts"),
        ("ell", [FLAT, UPRIGHT], "not the robot"),
        ("ell", [FLAT, FLAT], "not the robot"),
        ("ell", [FLAT], "not the robot"),
        ("disc", [], "1 parts"),
        ("disc", [SIDES], "not the robot"),
    ],
)
def test_a_footprint_is_the_robot_that_the_map_was_built_for(program, maps, name, parts, answer):
    texts = [part if isinstance(part, str) else write_part(part) for part in parts]
    command = [program, maps / name, "footprint", *texts]
    done = subprocess.run(command, text=True, capture_output=True, check=True)
    assert answer in done.stdout


# ---- anything ------------------------------------------------------------------------------------


ODD = [math.nan, math.inf, -math.inf, -1.0, 0.0, 1e-30, 1e30, 3e38]
STAMPS = [0, 10**8, -(10**8), 10**9, 10**17, -CLOCK]
SIZES = [0, 1, 3, 4, 12, 16, 100, 2**16, 2**31, 2**32 - 1]


def send_anything(watch, robot, rng):
    """Send a message that may contradict itself, or be of another time or frame."""
    frame = rng.choice(["laser", "base_link", "map", "camera"])
    stamp = robot.now + CLOCK - int(rng.choice(STAMPS, p=[0.5, 0.2, 0.1, 0.1, 0.05, 0.05]))
    kind = rng.choice(["scan", "bytes", "command"])
    if kind == "command":
        watch.tell(kind, robot.now, *rng.choice(ODD, 2).tolist())
    if kind == "scan":
        numbers = np.array([0.0, 0.02, 0.02, 25.0, 0.0])
        odd = rng.random(5) < 0.3
        numbers[odd] = rng.choice(ODD, odd.sum())
        ranges = rng.uniform(0.0, 30.0, rng.choice([0, 1, 2, 360]))
        odd = rng.random(len(ranges)) < 0.2
        ranges[odd] = rng.choice(ODD, odd.sum())
        watch.tell("scan", "scan", frame, stamp, *numbers.tolist(), *ranges.tolist())
    if kind == "bytes":
        height, width, step = rng.choice(SIZES, 3) if rng.random() < 0.3 else (2, 5, 12)
        row = int(rng.choice([*SIZES, int(step) * int(width) % 2**32]))
        length = min(int(rng.choice([0, 7, 120, 1000])), 1000)
        fields = []
        for name in "xyz":
            offset = rng.choice([*SIZES, 4, 8], p=[0.04] * 10 + [0.3, 0.3])
            fields += [name, offset, rng.choice([7, 8, 6, 0, 255], p=[0.6, 0.2, 0.1, 0.05, 0.05])]
        big = int(rng.random() < 0.1)
        fields = fields[: rng.choice([0, 6, 9], p=[0.1, 0.1, 0.8])]
        watch.tell("bytes", "scan", frame, stamp, height, width, step, row, length, big, *fields)


def drive_with_anything(watch, seed):
    """Drive while messages and transforms are odd; return the numbers of cycles that brake and drive."""
    rng = np.random.default_rng(seed)
    robot = Robot((1.5, 1.0, 0.0))
    watch.tell("new")

    def look_up(target, frame, stamp):
        words = robot.look_up(target, frame, stamp).split(" ")
        if len(words) == 8 and rng.random() < 0.05:
            k = rng.integers(9)
            if k == 8:
                return "later"
            odd = repr(float(rng.choice([*ODD, 1e10, 1e19, 1e300, 0.3])))
            words[k] = odd if k < 7 else str(int(words[7]) - int(rng.choice(STAMPS)))
        return " ".join(words)

    braked = drove = 0
    for _ in range(100):
        if rng.random() < 0.3:
            send_anything(watch, robot, rng)
        else:
            send_scan(watch, robot, FREE)
            watch.tell("command", robot.now, *rng.uniform((-0.3, -0.5), (0.6, 0.5)).tolist())
        before = robot.twist
        decided = watch.decide(robot.now, robot.now + CLOCK, look_up)
        assert (np.abs(decided.twist) <= 1.0).all()  # the largest odd one that a robot can drive
        assert (np.abs(before) - np.abs(decided.twist) <= DT * BRAKES + 1e-9).all()
        bodies = robot.drive(decided.twist)
        assert shapely.distance(np.array(bodies), WALLS).min() > 0.0
        braked += bool(decided.reason)
        drove += decided.twist.any() and not decided.reason
    return braked, drove


@pytest.mark.parametrize(
    "seeds", [range(2), pytest.param(range(2, 30), marks=pytest.mark.thorough)], ids=["2", "28"]
)
def test_messages_and_transforms_of_any_kind_only_let_it_brake(program, room, seeds):
    watch = WatchInCpp(program, room)
    counts = [drive_with_anything(watch, seed) for seed in seeds]
    watch.close()
    braked, drove = np.sum(counts, axis=0)
    assert braked > 30 * len(seeds) and drove > 5 * len(seeds)


@pytest.mark.parametrize("place", [1e8, 1e10, 1e15, 1e19, -1e19, 1e300])
def test_it_stands_at_a_place_that_no_robot_is_at(watch, place):
    robot = Robot((1.0, 1.0, 0.0))

    def look_up(target, frame, stamp):
        words = robot.look_up(target, frame, stamp).split(" ")
        return " ".join([repr(place), *words[1:]]) if target == "map" else " ".join(words)

    for _ in range(3):
        send_scan(watch, robot, FREE)
        watch.tell("command", robot.now, 0.5, 0.1)
        decided = watch.decide(robot.now, robot.now + CLOCK, look_up)
        assert not decided.twist.any() and decided.reason == "the transform of base_link is none"
