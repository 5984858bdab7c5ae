"""The package for Nav2 answers as Nav2 expects, over stubs of Jazzy's classes and of those of the main branch."""

import itertools
import math
import re
import time
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml

import cspace
from tests.helpers.cpp import SANITIZERS, why_no_compiler
from tests.helpers.drives import CURVES
from tests.helpers.nav2 import (
    DRIVES,
    HALF_SIDES,
    PACKAGE,
    WALLS,
    Nav2,
    build_room,
    build_server,
    make_room,
    outline_cells,
    place_body,
)
from tests.helpers.repository import ROOT
from tests.helpers.strategies import few
from tests.helpers.waiting import until

pytestmark = pytest.mark.skipif(bool(why_no_compiler()), reason=why_no_compiler())

START, GOAL, ABOVE = (1.0, 1.0, 0.0), (5.0, 1.0, 3.0), (1.0, 3.0, 0.0)
UNKNOWN = 255
GENTLE_RADIUS = 4.0


@pytest.fixture(scope="module")
def version(request):
    return getattr(request, "param", "jazzy")


@pytest.fixture(scope="module")
def program(version, tmp_path_factory):
    flags = ("-O0", *SANITIZERS, "-fno-sanitize-recover=all")
    return build_server(tmp_path_factory.mktemp(version) / "answers", version, *flags)


@pytest.fixture
def nav2(program, tmp_path):
    session = Nav2(program, tmp_path / "log")
    yield session
    assert session.close() == ""


@pytest.fixture(scope="module")
def space():
    return build_room(cspace.Robot.rectangle(0.6, 0.4), 16)


@pytest.fixture(scope="module")
def room(space, tmp_path_factory):
    path = tmp_path_factory.mktemp("room") / "map"
    space.save(path)
    return path


def place_outline(path):
    """Return points of the robot's outline, 1 mm apart, shape (poses, points, 2)."""
    x, y = HALF_SIDES
    s = np.arange(-1.0, 1.0, 0.002)[:, None]
    sides = [s * (x, 0) + (0, y), s * (x, 0) - (0, y), s * (0, y) + (x, 0), s * (0, y) - (x, 0)]
    outline = np.concatenate(sides)
    cosine, sine = np.cos(path[:, 2:]), np.sin(path[:, 2:])
    world_x = path[:, :1] + cosine * outline[:, 0] - sine * outline[:, 1]
    world_y = path[:, 1:2] + sine * outline[:, 0] + cosine * outline[:, 1]
    return np.stack([world_x, world_y], axis=2)


def touches(path, low, high):
    """Return whether the robot's outline is in a box at a pose of a path."""
    points = place_outline(path)
    return bool(((low < points) & (points < high)).all(axis=2).any())


def longest_step(path):
    """Return how far a point of the robot moves at most between two poses."""
    return float(np.linalg.norm(np.diff(place_outline(path), axis=0), axis=2).max())


def test_python_certifies_the_path_that_follows_at_the_step(nav2, space, room):
    nav2.configure(room, step=0.02)
    path = nav2.find_path(START, GOAL)
    np.testing.assert_allclose(path[[0, -1]], [START, GOAL], atol=1e-9)
    assert np.all(space.certify_path(path))
    assert longest_step(path) < 0.0201
    assert longest_step(nav2.find_path(START, (1.0, 1.0, 3.0))) < 0.0201
    assert nav2.read_log() == ""


def test_a_car_finds_narrow_doors_in_few_steps_whatever_the_yaw_of_its_start(nav2, tmp_path):
    cells = np.zeros((120, 80), dtype=bool)
    for wall, door in ((34, 14), (80, 52)):
        cells[wall : wall + 3] = True
        cells[wall : wall + 3, door : door + 11] = False  # 0.55 m, for a robot 0.4 m wide
    workspace = cspace.Workspace.from_array(cells, 0.05)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.6, 0.4), rotations=72)
    space.save(tmp_path / "hall")
    # 25,000 steps; on a lattice whose yaws were that of the start and the turns of tightest arcs, 140,000 were needed.
    nav2.configure(tmp_path / "hall", drive="dubins", turning_radius=0.4, time_limit=0.1)
    for yaw in (-0.1, 0.7):
        nav2.find_path((0.8, 2.0, yaw), (5.2, 2.5 + 0.1 * yaw, 0.3))


@pytest.mark.parametrize("drive, floor", [("differential", 0.04), ("holonomic", 0.06)])
def test_a_robot_on_a_floor_passes_under_a_beam(nav2, tmp_path, drive, floor):
    cells = np.zeros((70, 38, 8), dtype=bool)
    cells[28:32, :, 4:] = True  # a beam at 0.4 m, all across
    box = cspace.Robot.box((0.6, 0.4, 0.35), (0.0, 0.0, 0.175))
    workspace = cspace.Workspace.from_array(cells, 0.1)
    space = cspace.build(workspace, box, rotations=36, floor=floor)
    space.save(tmp_path / "hall")
    nav2.configure(tmp_path / "hall", drive=drive)
    answer = nav2.plan(START, GOAL)
    if floor > 0.05:
        assert answer["code"] == 208  # there is no path
        return
    assert answer["code"] == 0
    assert np.all(space.certify_path(np.array(answer["path"])))


# ---- the live costmap ----------------------------------------------------------------------------


@pytest.mark.parametrize("drive", few(["holonomic", *DRIVES], 2))
def test_paths_avoid_crates_that_only_the_costmap_knows(nav2, space, room, drive):
    """Cells of the robot's outline are those by which Nav2 itself calls a path valid."""
    rng = np.random.default_rng(3)
    nav2.configure(room, drive=drive, turning_radius=DRIVES.get(drive, 0), cost_penalty=0)
    found = 0
    for _ in range(15):
        low = rng.uniform((1.5, 2.6), (4.0, 3.3)).round(1)
        sides = rng.integers(3, 6, 2)
        high = (low + sides / 10).round(1)
        nav2.add_cost(low, high)
        answer = nav2.plan(START, GOAL)
        nav2.add_cost(low, high, 0)
        assert answer["code"] in (0, 207, 208)  # within the time limit, or there is none
        if answer["code"] == 0:
            path = np.array(answer["path"])
            assert np.all(space.certify_path(path)) and not touches(path, low, high)
            cells = np.rint(low * 10).astype(int) + list(np.ndindex(*sides))
            crate = set(map(tuple, cells.tolist()))
            assert not any(crate & outline_cells(pose, 0.1) for pose in answer["path"])
            if drive in DRIVES:
                check_drive(path, drive)
            found += 1
    assert found >= 8


def test_cells_of_the_costmap_are_refused_if_the_body_meets_them(nav2, room):
    rng = np.random.default_rng(1)
    nav2.configure(room, step=1)
    codes = []
    for _ in range(300):
        goal = (*rng.uniform((4.6, 0.7), (5.4, 1.3)), rng.uniform(-math.pi, math.pi))
        cell = np.floor(rng.uniform((4.2, 0.3), (5.8, 1.7)) * 10) / 10
        nav2.add_cost(cell, cell + 0.1)
        codes.append(nav2.plan(goal, goal)["code"])
        nav2.add_cost(cell, cell + 0.1, 0)
        meets = place_body(goal).intersects(shapely.box(*cell, *(cell + 0.1)))
        meets |= tuple(np.rint(cell * 10).astype(int)) in outline_cells(goal, 0.1)
        assert codes[-1] == (205 if meets else 0)
    assert 50 < codes.count(205) < 250


def test_a_disc_keeps_its_center_out_of_inscribed_cells(nav2, room):
    nav2.configure(room)
    nav2.add_cost((4.9, 0.9), (5.1, 1.1), 253)
    assert nav2.plan(START, GOAL)["code"] == 0
    nav2.tell("round")
    assert nav2.plan(START, GOAL)["code"] == 206


@pytest.mark.parametrize("drive", ["holonomic", "differential"])
@pytest.mark.parametrize("penalty, least, most", [(0, 0.0, 0.01), (6, 0.4, 1.0)])
def test_costs_below_lethal_count(nav2, room, drive, penalty, least, most):
    nav2.add_cost((1.0, 1.0), (1.8, 2.6), 200)
    nav2.configure(room, drive=drive, cost_penalty=penalty)
    path = nav2.find_path((1.4, 0.7, math.pi / 2), (1.4, 2.9, math.pi / 2))
    assert least <= np.abs(path[:, 0] - 1.4).max() <= most


@pytest.mark.parametrize("drive", ["holonomic", "reeds-shepp"])
def test_a_path_keeps_away_from_what_is_near_where_that_costs_little(nav2, room, drive):
    nav2.add_cost((2.6, 2.5), (3.4, 3.1), 30)
    nav2.configure(room, drive=drive, turning_radius=DRIVES.get(drive, 0))
    path = nav2.find_path((1.0, 3.08, 0.0), (5.5, 3.08, 0.0))
    beside = path[(path[:, 0] > 2.7) & (path[:, 0] < 3.3)]
    assert np.all(beside[:, 1] > 3.1)


def test_unknown_cells_count_by_the_parameter(nav2, room):
    nav2.configure(room, time_limit=0.03)
    nav2.add_cost((2.7, 0.0), (3.3, 4.0), UNKNOWN)
    assert nav2.plan(START, GOAL)["code"] in (207, 208)


def test_unknown_cells_do_not_hide_lethal_ones(nav2, room):
    nav2.configure(room, allow_unknown="true")
    goal = (5.0, 1.0, 0.0)
    nav2.add_cost((4.65, 0.7), (4.75, 1.3), UNKNOWN)
    nav2.add_cost((5.25, 0.7), (5.35, 1.3), UNKNOWN)
    assert nav2.plan(START, goal)["code"] == 0
    for side in (4.65, 5.25):
        nav2.add_cost((side, 0.9), (side + 0.1, 1.1))
        assert nav2.plan(START, goal)["code"] == 206
        nav2.add_cost((side, 0.9), (side + 0.1, 1.1), UNKNOWN)


def test_a_robot_without_yaw_is_tested_as_the_circle_around_it(nav2, tmp_path):
    space = build_room(cspace.Robot.disc(0.42), None)
    space.save(tmp_path / "map")
    nav2.tell("footprint 0.4 0.1")
    nav2.configure(tmp_path / "map")
    path = nav2.find_path(START, GOAL)
    assert np.all(space.certify_path(path[:, :2]))
    nav2.add_cost((4.9, 1.3), (5.1, 1.5))
    assert nav2.plan(START, GOAL)["code"] == 206


# ---- errors --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "start, goal, code",
    [
        pytest.param((6.5, 1.0, 0.0), GOAL, 203, id="start outside the costmap"),
        pytest.param((1.0, 3.9, 0.0), GOAL, 203, id="start outside the map"),
        pytest.param(START, (6.5, 1.0, 0.0), 204, id="goal outside the costmap"),
        pytest.param(START, (1.0, 3.9, 0.0), 204, id="goal outside the map"),
        pytest.param((3.0, 1.0, 0.0), GOAL, 205, id="start in the wall"),
        pytest.param(START, (3.0, 1.0, 0.0), 206, id="goal in the wall"),
        pytest.param((5.0, 3.0, 0.0), GOAL, 205, id="start at a crate"),
        pytest.param(START, (5.0, 3.0, 0.0), 206, id="goal at a crate"),
        pytest.param((1.0, 1.0, 0.3, 0.1), GOAL, 200, id="start tilted"),
        pytest.param(START, (5.0, 1.0, 0.3, -0.1), 200, id="goal tilted"),
        pytest.param(START, (5.0, 1.0, 0.0, math.pi), 200, id="goal upside down"),
        pytest.param(START, (5.0, 1.0, math.nan), 200, id="goal without a number"),
        pytest.param(START, (math.inf, 1.0, 0.0), 200, id="goal infinitely far"),
    ],
)
def test_impossible_requests_are_refused_before_any_search(nav2, room, start, goal, code):
    nav2.configure(room)
    nav2.add_cost((5.2, 2.8), (5.4, 3.2))
    answer = nav2.plan(start, goal)
    assert (answer["code"], answer["calls"]) == (code, 0)


def test_poses_in_another_frame_or_without_a_rotation_are_refused(nav2, room):
    nav2.configure(room)
    for rotation in ("0 0 0 0", "0 0 0 0.5", "nan 0 0 1"):
        answer = nav2.ask(f"plan 1 1 0 0 0 1 5 1 {rotation}")
        assert answer["code"] == 200 and f"({rotation.replace(' ', ', ')})" in answer["text"]
    for frame in ("odom", ""):
        nav2.tell(f'frame "{frame}"')
        answer = nav2.plan(START, GOAL)
        assert (
            answer["code"] == 202 and f"the start is in '{frame}', not in 'map'" in answer["text"]
        )
    nav2.tell("frame map")
    assert nav2.plan(START, GOAL)["code"] == 0


def test_a_search_ends_at_its_limit_or_when_cancelled(nav2, room):
    nav2.configure(room, time_limit=0.02)
    nav2.add_cost((2.0, 0.0), (2.2, 4.0))
    answer = nav2.plan(START, GOAL)
    assert answer["code"] == 207 and nav2.plan(START, GOAL) == answer
    nav2.tell("cancel 20")
    answer = nav2.plan(START, GOAL)
    assert (answer["code"], answer["calls"]) == (-1, 20)


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({"map": "/no/map"}, "/no/map"),
        ({"step": 0}, "'plan.step' is not in its range"),
        ({"time_limit": -1}, "'plan.time_limit' is not in its range"),
        ({"tolerance": -0.1}, "'plan.tolerance' is not in its range"),
        ({"start_tolerance": 0.6}, "'plan.start_tolerance' is not in its range"),
        ({"rotations": 0}, "'rotations' is 0; it must be from 1 to 1000"),
        ({"drive": "tank"}, "'drive' is 'tank'; it must be holonomic, differential"),
        ({"drive": "dubins"}, "'turning_radius' is 0.000000; it must be positive for dubins"),
        ({"turning_radius": 0.4}, "'turning_radius' is 0.400000; it must be positive for dubins"),
    ],
)
def test_wrong_parameters_are_logged_and_thrown(nav2, parameters, message):
    nav2.set(**{"drive": "holonomic", **parameters})
    answer = nav2.ask("configure")
    assert answer["code"] == 200 and message in answer["text"]
    log = nav2.read_log()
    assert log.startswith("[ERROR] [planner_server]: plan: ") and message in log


def test_the_drive_has_no_default(nav2, room):
    nav2.set(map=room)
    answer = nav2.ask("configure")
    assert "the parameter 'drive' is missing; it must be holonomic, differential" in answer["text"]


def test_a_drive_needs_a_map_with_yaw(nav2, tmp_path):
    build_room(cspace.Robot.disc(0.2), None).save(tmp_path / "map")
    nav2.set(map=tmp_path / "map", drive="differential")
    answer = nav2.ask("configure")
    assert answer["code"] == 200
    assert "'drive' is 'differential', which needs a map with yaw" in answer["text"]


@pytest.mark.parametrize(
    "half_sides, frame, messages",
    [
        ((0.31, 0.2), "map", ("robot of the map, [[0.3, ", "footprint, [[0.31, 0.2], ")),
        ((0.3, 0.2), "hall", ("the map is in 'hall', the costmap in 'map'",)),
    ],
)
def test_a_saved_map_of_another_robot_or_frame_is_refused(
    nav2, tmp_path, half_sides, frame, messages
):
    grid = cspace.ros.OccupancyGrid(data=(100 * make_room().T).ravel().tolist())
    grid.header.frame_id = frame
    grid.info.width, grid.info.height, grid.info.resolution = 70, 38, 0.1
    workspace = cspace.Workspace.from_occupancy_grid(grid)
    robot = cspace.Robot.rectangle(0.6, 0.4)
    cspace.build(workspace, robot, rotations=4).save(tmp_path / "map")
    nav2.tell("footprint", *half_sides)
    nav2.set(map=tmp_path / "map", drive="differential")
    answer = nav2.ask("configure")
    assert answer["code"] == 200 and all(message in answer["text"] for message in messages)


def test_what_needs_no_new_map_may_change_while_the_node_runs(nav2, room):
    nav2.set(drive="tank", map=room, tolerance=0)
    assert nav2.ask("configure")["code"] == 200
    assert nav2.ask("param plan.drive holonomic") == ""
    assert nav2.ask("configure") == {"code": 0}
    refused = nav2.ask("param plan.drive differential")
    assert (
        refused
        == "the parameter 'plan.drive' is read when the node is configured; clean it up first"
    )
    goal = (3.55, 1.0, 0.0)
    assert nav2.plan(START, goal)["code"] == 206
    assert nav2.ask("param plan.tolerance 0.4") == ""
    assert nav2.plan(START, goal)["code"] == 0
    nav2.tell("cleanup")
    assert nav2.ask("param plan.drive differential") == ""


def test_a_search_leaves_the_costmap_to_others(nav2, room):
    nav2.configure(room)
    assert nav2.plan(START, GOAL)["locked"] == 0


# ---- the goal, and the time ----------------------------------------------------------------------


def test_a_goal_that_is_not_free_is_moved_within_the_tolerance(nav2, space, room):
    nav2.configure(room, tolerance=0.4)
    goal = (3.55, 1.0, 0.0)
    assert not space.is_free(goal)
    path = nav2.find_path(START, goal)
    assert path[0].tolist() == pytest.approx(START)
    assert space.is_free(path[-1]) and path[-1, 2] == goal[2]
    away = float(np.linalg.norm(path[-1, :2] - goal[:2]))
    near = np.linspace(0.0, away - 0.15, 10)[:, None] * [[1.0, 0.0]] + goal[:2]
    assert 0.0 < away <= 0.4 and not space.is_free(np.column_stack([near, np.zeros(10)])).any()
    assert nav2.plan(START, (3.1, 1.0, 0.0))["code"] == 206
    assert nav2.plan((3.55, 1.0, 0.0), START)["code"] == 205


def test_a_start_that_is_not_free_is_moved_a_little_and_said(nav2, space, room):
    start = (2.5 - 0.03, 1.0, 0.0)
    assert not space.is_free(start) and not place_body(start).intersects(WALLS)
    nav2.configure(room, start_tolerance=0.2)
    path = nav2.find_path(start, ABOVE)
    away = math.dist(path[0, :2], start[:2])
    assert 0.0 < away <= 0.2 and space.is_free(path[0]) and path[0, 2] == 0.0
    assert "the start is not proven free; the path begins" in nav2.read_log()
    assert nav2.plan((2.75, 1.0, 0.0), ABOVE)["code"] == 205


def test_paths_and_their_poses_are_stamped_with_the_present(nav2, room):
    nav2.configure(room)
    nav2.tell("seconds 1234")
    assert nav2.plan(START, GOAL)["stamps"] == [1234, 1234]
    nav2.tell("seconds 1235")
    assert nav2.plan(START, GOAL)["stamps"] == [1235, 1235]


# ---- drives --------------------------------------------------------------------------------------


def drive_between(first, last):
    """Return the poses along the arc between two poses, its length and angle, and where it ends."""
    angle = math.remainder(last[2] - first[2], 2 * math.pi)
    middle = first[2] + angle / 2
    chord = (last[0] - first[0]) * math.cos(middle) + (last[1] - first[1]) * math.sin(middle)
    length = chord * (angle / 2) / math.sin(angle / 2) if angle else chord
    poses = [first]
    for k in range(10):
        yaw = first[2] + (k + 0.5) / 10 * angle
        piece = length / 10 * (math.sin(angle / 20) / (angle / 20) if angle else 1)
        x, y, _ = poses[-1]
        poses.append((x + piece * math.cos(yaw), y + piece * math.sin(yaw), yaw + angle / 20))
    return poses, length, angle


def check_drive(path, drive, obstacles=WALLS):
    """Drive a path; check that the robot can, that it is there in time, and touches nothing."""
    radius, backs_out = DRIVES[drive], True
    for first, last in itertools.pairwise(path.tolist()):
        poses, length, angle = drive_between(first, last)
        assert math.dist(poses[-1][:2], last[:2]) < 1e-4
        if "reverse" not in drive and drive != "reeds-shepp":
            backs_out &= length < 1e-9
            assert length >= -1e-9 or backs_out
        if radius:
            assert abs(length) >= radius * abs(angle) - 1e-5
        else:
            is_gentle = abs(length) >= GENTLE_RADIUS * abs(angle)  # by a robot that backs out
            assert is_gentle or length == pytest.approx(0.0, abs=1e-9)
        for pose in poses:
            assert not place_body(pose).intersects(obstacles)


@pytest.mark.parametrize("drive", DRIVES)
def test_paths_are_free_as_they_are_driven(nav2, room, drive):
    nav2.configure(room, drive=drive, turning_radius=DRIVES[drive])
    for start, goal in [(START, GOAL), (GOAL, ABOVE), (START, (1.2, 1.5, 0.0)), (START, START)]:
        path = nav2.find_path(start, goal)
        np.testing.assert_allclose(path[[0, -1]], [start, goal], atol=1e-9)
        assert longest_step(path) < 0.0501
        check_drive(path, drive)


def test_a_car_drives_a_loop_if_it_does_not_reverse(nav2, room):
    nav2.configure(room, drive="dubins", turning_radius=0.2)
    assert len(nav2.find_path(START, (0.7, 1.0, 0.0))) > 40


def test_a_reversing_car_stops_at_cusps(nav2, room):
    nav2.configure(room, drive="reeds-shepp", turning_radius=0.4)
    assert len(nav2.find_path(START, (0.7, 1.0, 0.0))) < 10
    path = nav2.find_path(START, (1.0, 1.0, math.pi - 0.5))
    lengths = [drive_between(*ends)[1] for ends in itertools.pairwise(path)]
    lengths = [length for length in lengths if abs(length) > 1e-6]
    assert min(lengths) < 0.0 < max(lengths)
    # Controllers find a cusp where the direction of travel turns back at a pose.
    steps = np.diff(path[:, :2], axis=0)
    steps = steps[np.linalg.norm(steps, axis=1) > 1e-6]
    turns = (steps[1:] * steps[:-1]).sum(axis=1) < 0.0
    assert turns.sum() == np.count_nonzero(np.diff(np.sign(lengths))) >= 1


@pytest.mark.parametrize("drive", CURVES)
@pytest.mark.parametrize("radius", [1e-9, 30.0, 1000.0])
def test_no_radius_or_goal_ends_the_planner_server(nav2, room, drive, radius):
    nav2.configure(room, drive=drive, turning_radius=radius, time_limit=0.02)
    x, y, yaw = START
    ahead = [(x + 0.9, y, yaw), (x + 0.9, y, yaw + 1e-7), (x + 0.9, y, 2 * math.pi)]
    turned = [(x, y, yaw + math.pi), (x, y + 1e-9, yaw - math.pi / 2), (x - 0.2, y, yaw)]
    for goal in [START, *ahead, *turned]:
        assert nav2.plan(START, goal)["code"] in (0, 207, 208)
    assert nav2.plan(START, (x, y, math.nan))["code"] == 200
    assert nav2.plan(START, (1e300, y, yaw))["code"] == 204


@pytest.mark.parametrize(
    "drive, is_in_corner",
    [
        *((drive, False) for drive in ("differential", "dubins")),
        *((drive, True) for drive in ("differential", "dubins", "reeds-shepp")),
    ],
)
@pytest.mark.parametrize("gap", [0.001, 0.05, 0.1])
def test_a_robot_square_to_a_wall_or_two_first_backs_out(
    nav2, space, room, drive, is_in_corner, gap
):
    nav2.configure(room, drive=drive, turning_radius=DRIVES[drive], start_tolerance=0.2)
    start = (2.8 - 0.3 - gap, 0.2 + gap if is_in_corner else 1.0, 0.0)
    path = nav2.find_path(start, ABOVE)
    assert math.dist(path[0, :2], (2.5, 0.2 if is_in_corner else 1.0)) < 0.3
    assert np.all(space.certify_path(path))
    check_drive(path, drive)
    lengths = np.array([drive_between(*ends)[1] for ends in itertools.pairwise(path.tolist())])
    assert lengths[np.abs(lengths) > 1e-9][0] < 0.0
    if not is_in_corner:
        back = lengths < -1e-9
        assert back[0] and np.all(back[:-1] >= back[1:])
        assert np.ptp(path[:-1][back][:, 1:], axis=0).max() == 0.0  # straight
        assert -lengths[back].sum() < 1.0


@pytest.fixture(scope="module")
def shipped(tmp_path_factory):
    """Return the parameters of the plugin in the shipped file, its padding, a map for both, and the map's folder."""
    params = yaml.safe_load((PACKAGE / "params/navigation.yaml").read_text(encoding="utf-8"))
    costmap = params["global_costmap"]["global_costmap"]["ros__parameters"]
    options = params["planner_server"]["ros__parameters"]["GridBased"]
    cells = np.zeros((100, 80), dtype=bool)
    cells[[0, -1]] = cells[:, [0, -1]] = True
    workspace = cspace.Workspace.from_array(cells, costmap["resolution"])
    padding = costmap["footprint_padding"]
    robot = cspace.Robot.from_footprint(costmap["footprint"], padding=padding)
    space = cspace.build(workspace, robot, rotations=options["rotations"])
    folder = tmp_path_factory.mktemp("shipped") / "map"
    space.save(folder)
    return options, padding, space, folder


@pytest.mark.parametrize("is_in_corner", [True, False], ids=["corner", "wall"])
@pytest.mark.parametrize("gap", [0.0, 0.03, 0.05, 0.08])
def test_the_shipped_file_leads_out_of_corners_and_along_walls(
    nav2, shipped, tmp_path, is_in_corner, gap
):
    options, padding, space, folder = shipped
    x, y = HALF_SIDES
    nav2.tell("footprint", x + padding, y + padding)
    nav2.send_grid(space.workspace.outer, tmp_path / "grid", space.grid.spacing)
    nav2.tell("static")
    kept = {name: options[name] for name in ("drive", "tolerance", "start_tolerance")}
    nav2.configure(folder, **kept)
    start = (4.95 - x - gap if is_in_corner else 2.2, 3.95 - y - gap, 0.0)
    path = nav2.find_path(start, (2.5, 2.0, 0.0))
    assert math.dist(path[0, :2], start[:2]) <= kept["start_tolerance"]
    assert np.all(space.certify_path(path))
    check_drive(path, kept["drive"], shapely.box(0.05, 0.05, 4.95, 3.95).boundary)
    lengths = np.array([drive_between(*ends)[1] for ends in itertools.pairwise(path.tolist())])
    assert (lengths.min() < -1e-9) == is_in_corner


def test_a_robot_turns_on_the_spot_at_equal_positions(nav2, room):
    nav2.configure(room, drive="differential")
    path = nav2.find_path(START, (1.0, 1.0, 2.0))
    assert np.ptp(path[:, :2], axis=0).max() == 0.0 and len(path) > 10


@pytest.mark.parametrize("drive", DRIVES)
def test_a_robot_on_its_way_joins_the_last_route(nav2, room, drive):
    nav2.configure(room, drive=drive, turning_radius=DRIVES[drive])
    path = nav2.find_path(START, GOAL)
    for k in range(5, len(path) - 60, 15):
        start = path[k] + (0.004, -0.006, 0.01)
        answer = nav2.plan(tuple(start), GOAL)
        assert answer["code"] == 0
        rest = np.array(answer["path"])
        check_drive(rest, drive)
        if np.array_equal(rest[-20:], path[-20:]):
            break
    else:
        pytest.fail("no route was kept")


# ---- the last route ------------------------------------------------------------------------------


@pytest.mark.parametrize("drive", ["holonomic", *DRIVES])
def test_a_planner_that_is_configured_anew_finds_the_same_paths(nav2, room, drive):
    answers = []
    for _ in range(2):
        nav2.configure(room, drive=drive, turning_radius=DRIVES.get(drive, 0))
        answers.append([nav2.plan(START, GOAL), nav2.plan(GOAL, ABOVE)])
        nav2.tell("cleanup")
    assert answers[0] == answers[1] and answers[0][0]["calls"] > 0


def test_a_robot_on_its_way_keeps_the_rest_of_its_route(nav2, space, room):
    nav2.configure(room)
    path = nav2.find_path(START, GOAL)
    kept = 0
    for k in range(1, len(path) - 2, 5):
        start = path[k] + (0.002, -0.002, 0.01)
        if np.all(space.motion_is_free([path[k - 1], start], [start, path[k + 1]])):
            rest = nav2.find_path(tuple(start), GOAL)
            np.testing.assert_allclose(rest[0, :2], start[:2], atol=1e-9)
            later = path[k + 2 :]
            np.testing.assert_array_equal(rest[-len(later) :], later)
            assert len(rest) <= len(later) + 4
            kept += 1
    assert kept > 5


def test_a_start_far_from_the_last_route_gets_another(nav2, room):
    nav2.configure(room)
    path = nav2.find_path(START, GOAL)
    away = np.linalg.norm(path[:, :2] - ABOVE[:2], axis=1).min()
    assert away > 0.4 or pytest.skip("the route passes the other start")
    assert not np.array_equal(nav2.find_path(ABOVE, GOAL)[-len(path) :], path)
    np.testing.assert_array_equal(nav2.find_path(START, GOAL), path)


def test_a_route_is_left_when_a_crate_blocks_it(nav2, room):
    nav2.configure(room)
    path = nav2.find_path(START, ABOVE)
    middle = path[len(path) // 2, :2].round(1)
    nav2.add_cost(middle - 0.2, middle + 0.2)
    assert touches(path, middle - 0.1, middle + 0.1)
    assert not touches(nav2.find_path(START, ABOVE), middle - 0.1, middle + 0.1)


@pytest.mark.parametrize("drive", ["holonomic", "differential"])
def test_a_kept_route_is_left_for_one_through_a_gap_that_opened(nav2, room, drive):
    """Both ends of the detour are far from the gap, so that no motion between two poses of it leads through."""
    nav2.configure(room, drive=drive)
    start, goal = (0.6, 0.5, math.pi / 2), (0.6, 3.3, math.pi / 2)
    nav2.add_cost((0.0, 1.8), (2.0, 2.0))
    nav2.add_cost((1.2, 0.9), (1.3, 1.8))
    nav2.add_cost((1.2, 2.0), (1.3, 2.9))
    detour = nav2.find_path(start, goal)
    nav2.add_cost((0.0, 1.8), (1.2, 2.0), 0)
    way = nav2.find_path(start, goal)
    lengths = [np.hypot(*np.diff(path[:, :2], axis=0).T).sum() for path in (detour, way)]
    assert lengths[0] > 1.2 * lengths[1]
    np.testing.assert_array_equal(nav2.find_path(start, goal), way)


# ---- the map of the topic --------------------------------------------------------------------------


def follow_topic(nav2, folder, builder, **parameters):
    usual = {"drive": "differential", "rotations": 16, "start_tolerance": 0}
    nav2.set(map_folder=folder, builder=builder, **{**usual, **parameters})
    assert nav2.ask("configure") == {"code": 0}


def plan_when_built(nav2, start=START, goal=GOAL):
    while True:
        answer = nav2.plan(start, goal)
        if "is being built" not in answer.get("text", ""):
            return answer
        time.sleep(0.05)


def test_a_map_is_made_of_the_topic_once_and_kept(nav2, builder, tmp_path):
    follow_topic(nav2, tmp_path / "maps", builder)
    assert "no map has come" in nav2.plan(START, GOAL)["text"]
    nav2.send_grid(make_room(), tmp_path / "grid")
    answer = plan_when_built(nav2)
    (kept,) = (tmp_path / "maps").glob("*/map.zarr")
    assert np.all(cspace.open(kept).certify_path(answer["path"]))
    assert len(cspace.open(kept).rotations) == 16
    nav2.send_grid(make_room(), tmp_path / "grid")
    assert nav2.plan(START, GOAL)["code"] == 0
    nav2.tell("cleanup")
    follow_topic(nav2, tmp_path / "maps", builder)
    nav2.send_grid(make_room(), tmp_path / "grid")
    assert plan_when_built(nav2)["code"] == 0
    assert len((tmp_path / "calls").read_text()) == 1


def test_the_request_of_the_page_gets_a_path_on_depot(nav2, builder, data, tmp_path):
    page = (ROOT / "docs/howto/nav2.md").read_text(encoding="utf-8")
    goal = re.search(r"position: {x: ([-\d.]+), y: ([-\d.]+)}", page)
    start = (0.0, 0.0, 0.0)  # of /initialpose
    params = yaml.safe_load((PACKAGE / "params/navigation.yaml").read_text(encoding="utf-8"))
    options = params["planner_server"]["ros__parameters"]["GridBased"]
    del options["plugin"]
    nav2.tell("footprint 0.325 0.225")  # padded
    follow_topic(
        nav2, tmp_path / "maps", builder, **{**options, "allow_unknown": "false", "time_limit": 60}
    )
    workspace = cspace.Workspace.open(data / "maps/depot.yaml", unknown="free")
    nav2.send_grid(workspace.outer, tmp_path / "grid", 0.05, origin=(-7.14, -7.83))
    nav2.tell("static")
    answer = plan_when_built(nav2, start, (float(goal[1]), float(goal[2]), 0.0))
    assert answer["code"] == 0 and len(answer["path"]) > 300


def test_a_new_map_or_footprint_is_built_before_the_next_plan(nav2, builder, tmp_path):
    follow_topic(nav2, tmp_path / "maps", builder)
    nav2.send_grid(make_room(), tmp_path / "grid")
    assert plan_when_built(nav2)["code"] == 0
    cells = make_room()
    cells[28:32] = True
    nav2.send_grid(cells, tmp_path / "grid")
    assert plan_when_built(nav2)["code"] == 208
    assert "a new map came and is being built" in nav2.read_log()
    nav2.send_grid(make_room(), tmp_path / "grid")
    assert plan_when_built(nav2)["code"] == 0
    nav2.tell("footprint 1.2 0.2")
    assert plan_when_built(nav2)["code"] in (205, 206)
    assert len((tmp_path / "calls").read_text()) == 3


@pytest.mark.parametrize(
    "problem, message",
    [
        ("cells", "the map has 0 x 38 cells"),
        ("failing", "build' failed: it is broken"),
    ],
)
def test_a_map_that_cannot_be_made_is_said(nav2, write_script, tmp_path, problem, message):
    follow_topic(nav2, tmp_path / "maps", write_script("echo it is broken\nexit 3"))
    cells = np.zeros((0, 38)) if problem == "cells" else make_room()
    nav2.send_grid(cells, tmp_path / "grid")
    answer = plan_when_built(nav2)
    assert answer["code"] == 200 and message in answer["text"]
    assert message in nav2.read_log()


def test_a_build_that_runs_ends_with_the_planner_and_for_another_footprint(
    nav2, write_script, tmp_path
):
    script = write_script(f"echo $$ >> {tmp_path}/pids\nexec sleep 600")
    follow_topic(nav2, tmp_path / "maps", script)
    nav2.send_grid(make_room(), tmp_path / "grid")
    until((tmp_path / "pids").exists)
    nav2.tell("footprint 1.2 0.2")
    assert nav2.plan(START, GOAL)["code"] == 200
    until(lambda: len((tmp_path / "pids").read_text().split()) == 2)
    pids = (tmp_path / "pids").read_text().split()
    nav2.tell("cleanup")
    assert nav2.ask("param plan.rotations 8") == ""  # it has ended
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


# ---- stops on the way ----------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["main"], indirect=True)  # Jazzy's planners have none
def test_paths_pass_all_viapoints_in_order(nav2, space, room):
    nav2.configure(room)
    stops = [START, (5.0, 3.0, 1.0), ABOVE, GOAL]
    path = nav2.find_path(*stops)
    assert np.all(space.certify_path(path))
    at = [int(np.argmin(np.abs(path - stop).max(axis=1))) for stop in stops]
    np.testing.assert_allclose(path[at], stops, atol=1e-9)
    assert at == sorted(at) and len(set(map(tuple, path.tolist()))) == len(path)
    np.testing.assert_array_equal(nav2.find_path(*stops), path)
    # Near the goal, but before the first viapoint.
    near_goal = (4.9, 1.0, 3.0)
    again = nav2.find_path(near_goal, *stops[1:])
    assert np.abs(again - ABOVE).max(axis=1).min() < 1e-9
    blocked = nav2.plan(START, ABOVE, (3.0, 1.0, 0.0), GOAL)
    assert (blocked["code"], blocked["calls"]) == (206, 0) and "viapoint 2" in blocked["text"]
