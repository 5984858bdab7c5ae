"""The gate in C++ answers as Python's does, and keeps robots from what they see."""

import math
import subprocess

import numpy as np
import pytest
import shapely
import trimesh
from shapely import affinity

import cspace
from tests.helpers import watch
from tests.helpers.cpp import (
    GateInCpp,
    build_space,
    read_slowed,
    slow_in_cpp,
    why_no_compiler,
)
from tests.helpers.handmade import build_empty
from tests.helpers.leaving import bound_distances, place_along
from tests.helpers.messages import make_grid
from tests.helpers.watch import BODY, POINT_RADIUS, TRACKING, save_room
from tests.queries.test_leaving import ON_FLOORS, build_on_floor

pytestmark = pytest.mark.skipif(bool(why_no_compiler()), reason=why_no_compiler())

ROBOTS = {
    "SE2 uneven": "0 0 0 0.4 0 0 0.2",
    "SE2 shared": "0 0.25 0.1 -0.25 0.1 -0.25 -0.1 0.25 -0.1",
    "SE2 one cell": "0.1 0 0",
}
"""The robot of each map, as the program reads it: a radius and the corners of a core."""

DT, BRAKES = 0.1, (1.0, 3.0)
"""Seconds of a command, and the brakes, m/s^2 and rad/s^2."""


def draw_situations(space, count, rng):
    """Draw poses, half of them near obstacles and some lost, with wanted and present twists."""
    poses = space.sample_free(count, rng)
    poses[::2, :2] += rng.normal(0.0, 0.1, poses[::2, :2].shape)
    poses[::7, :2] += rng.normal(0.0, 3.0, poses[::7, :2].shape)
    rows = np.hstack([poses, rng.normal(0.0, (0.6, 1.5, 0.4, 1.0), (count, 4))])
    rows[::3, 5:] = 0.0
    rows[::5, 4] = 0.0
    return rows


def compare_slowed(program, space, folder, rows, robot, tracking, leaving):
    """Slow twists down in C++ and in Python, which must agree; return what C++ says."""
    gate = cspace.Gate(space, dt=DT, tracking=tracking, max_deceleration=BRAKES)
    numbers = (DT, *BRAKES, *tracking, 0.0)
    answers = slow_in_cpp(program, folder / "map", rows, robot, *numbers, leaving=leaving)
    slowed = list(map(read_slowed, answers))
    for row, found in zip(rows, slowed, strict=True):
        expected = gate.slow_down(row[:3], row[3:5], twist_now=row[5:], leaving=leaving)
        assert found[:3] == (expected.share, bool(expected.chunk), expected.leaves), row.tolist()
        np.testing.assert_allclose(found.commands, expected.commands, rtol=1e-12, atol=1e-12)
    return slowed


@pytest.mark.parametrize(
    "count", [60, pytest.param(2000, marks=pytest.mark.thorough)], ids=["few", "many"]
)
@pytest.mark.parametrize("tracking", [(0.0, 0.0, 0.0), (0.05, 0.02, 0.1)], ids=["exact", "stray"])
@pytest.mark.parametrize("name", ROBOTS)
def test_slowed_twists_equal_those_of_python(tmp_path, program, name, tracking, count):
    space = build_space(name, "blocked")
    space.save(tmp_path / "map")
    rows = draw_situations(space, count, np.random.default_rng(6))
    left = 0
    for leaving in (False, True):
        found = compare_slowed(program, space, tmp_path, rows, ROBOTS[name], tracking, leaving)
        assert len({each.share for each in found}) > 2
        left += sum(each.leaves and each.share > 0.0 for each in found)
    assert left > count / 100


SQUARE = shapely.box(-0.2, -0.1, 0.3, 0.1)
PARTS = shapely.MultiPolygon([SQUARE, shapely.box(0.5, 0.0, 0.6, 0.4)])
ELL = [(0, 0), (0.5, 0), (0.5, 0.2), (0.2, 0.2), (0.2, 0.5), (0, 0.5)]
NAME = 'a "kind": "balls", "outer": {"wkb": [ \\\u00e9'


def read_parts(program, path):
    """Return the frame of a map, and a part of its robot or the text of an error a line."""
    done = subprocess.run([program, "robot", path], text=True, capture_output=True, check=True)
    frame, *lines = done.stdout.splitlines()
    return frame, lines


@pytest.mark.parametrize(
    "robot",
    [
        pytest.param(cspace.Robot.rectangle(0.5, 0.2, center=(0.1, 0.0)), id="rectangle"),
        pytest.param(cspace.Robot(NAME, SQUARE.reverse()), id="clockwise, with a name"),
        pytest.param(cspace.Robot("parts", PARTS), id="parts"),
        pytest.param(cspace.Robot.polygon(ELL), id="not convex"),
        pytest.param(cspace.Robot.disc(0.3, center=(0.05, -1e-7)), id="disc"),
        pytest.param(cspace.Robot.from_balls([(0.1, 0.0), (-0.1, 0.0)], [0.2, 0.1]), id="discs"),
        pytest.param(cspace.Robot.ellipse(0.4, 0.2), id="bounds"),
    ],
)
def test_the_robot_of_a_map_is_the_one_that_it_was_built_for(tmp_path, program, robot):
    workspace = cspace.Workspace.from_occupancy_grid(make_grid("hall"))
    cspace.build(workspace, robot, rotations=4).save(tmp_path / "map")
    frame, lines = read_parts(program, tmp_path / "map")
    assert frame == "hall"
    shapes = []
    for line in lines:
        radius, *numbers = map(float, line.split())
        corners = np.reshape(numbers, (-1, 2))
        if len(corners) > 1:
            assert radius == 0.0 and shapely.LinearRing(corners).is_ccw
            shapes.append(shapely.Polygon(corners))
        else:
            shapes.append(shapely.Point(*corners).buffer(radius, quad_segs=64))
    found = shapely.union_all(shapes)
    assert shapely.symmetric_difference(found, robot.geometry).area < 1e-3 * found.area
    if "ellipse" in robot.name:
        assert found.contains(robot.geometry.buffer(-1e-9))


@pytest.mark.parametrize(
    "robot, problem",
    [
        (cspace.Robot("ring", SQUARE.difference(SQUARE.buffer(-0.05))), "has holes"),
        (
            cspace.Robot.from_bitmap(np.ones((2, 3), dtype=bool), 0.1),
            "not made of discs or polygons",
        ),
    ],
)
def test_a_robot_of_other_shapes_has_no_parts(tmp_path, program, robot, problem):
    build_empty((20, 20), robot, rotations=4).save(tmp_path / "map")
    frame, (line,) = read_parts(program, tmp_path / "map")
    assert frame == "" and problem in line


GOOD = (0.1, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
"""Seconds of a command, brakes, tracking, and the radius of points."""


def change(place, value):
    """Return good numbers with one that is not."""
    return (*GOOD[:place], value, *GOOD[place + 1 :])


@pytest.mark.parametrize(
    "name, robot, numbers, message",
    [
        ("SE2 uneven", "0 0 0", change(0, 0.0), "finite and above zero"),
        ("SE2 uneven", "0 0 0", change(1, -1.0), "finite and above zero"),
        ("SE2 uneven", "0 0 0", change(2, math.inf), "finite and above zero"),
        ("SE2 uneven", "0 0 0", change(3, -0.1), "zero or above"),
        ("SE2 uneven", "0 0 0", change(5, math.nan), "zero or above"),
        ("SE2 uneven", "0 0 0", change(6, math.inf), "zero or above"),
        ("SE2 uneven", "", GOOD, "at least one part"),
        ("SE2 uneven", "0 0 0 1 0", GOOD, "a convex polygon"),
        ("SE2 uneven", "0 0 0 0 1 1 0", GOOD, "counterclockwise"),
        ("SE2 uneven", "0 0 0 1 0 1 1 0.5 0.2", GOOD, "a convex polygon"),
        ("SE2 uneven", "0 0 0 1 0 1 0 0 1", GOOD, "once each"),
        ("SE2 uneven", "0 1 0 -0.8 0.6 0.3 -1 0.3 1 -0.8 -0.6", GOOD, "a convex polygon"),
        ("SE2 uneven", "-1 0 0", GOOD, "a convex polygon"),
        ("R2", "0 0 0", GOOD, "a map of x, y and yaw"),
    ],
)
def test_wrong_options_are_refused(tmp_path, program, name, robot, numbers, message):
    build_space(name, "blocked").save(tmp_path / "map")
    (answer,) = slow_in_cpp(program, tmp_path / "map", np.zeros(7), robot, *numbers)
    assert message in answer


def test_wrong_twists_are_refused(tmp_path, program):
    space = build_space("SE2 uneven", "blocked")
    space.save(tmp_path / "map")
    row = np.append(space.sample_free(rng=np.random.default_rng(0)), (0.5, 0.1, 0.0, 0.0))
    for place in range(7):
        broken = row.copy()
        broken[place] = np.nan
        (answer,) = slow_in_cpp(program, tmp_path / "map", broken, "0 0 0", *GOOD)
        assert "must be finite" in answer
    for place in (3, 5):  # the wanted twist, and the one now
        fast = row.copy()
        fast[place] = 1e5
        (answer,) = slow_in_cpp(program, tmp_path / "map", fast, "0 0 0", 1e-3, *GOOD[1:])
        assert "at most 100000 commands" in answer


# ---- points that the robot sees ------------------------------------------------------------------


BOX = "0 0.3 0.2 -0.3 0.2 -0.3 -0.2 0.3 -0.2"


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return save_room(tmp_path_factory.mktemp("room"))


def open_gate(program, room, leaving=True):
    """Start a gate in the room."""
    numbers = (watch.DT, *watch.BRAKES, *(TRACKING,) * 3, POINT_RADIUS)
    return GateInCpp(program, room, BOX, *numbers, leaving=leaving)


def test_a_robot_at_a_place_that_rounding_swallows_leaves_nowhere(program, room):
    gate = open_gate(program, room)
    for x in (1e9, 1e12, 1e17, 1e19, -1e19, 1e300):
        assert gate.slow_down((x, 1.0, 0.0), (0.4, 0.0), (0.0, 0.0)).share == 0.0
    gate.close()


@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("name", ON_FLOORS)
@pytest.mark.parametrize(
    "count", [60, pytest.param(2500, marks=pytest.mark.thorough)], ids=["few", "many"]
)
def test_a_robot_on_a_floor_leaves_part_by_part_as_in_python(
    tmp_path, program, name, outside, count
):
    occupied = np.random.default_rng(6).random((40, 30, 13)) < 0.005
    space = build_on_floor(name, occupied, outside=outside, margin=0.03 * (outside == "free"))
    space.save(tmp_path / "map")
    rows = draw_situations(space, count, np.random.default_rng(7))
    found = compare_slowed(program, space, tmp_path, rows, "map", (0.02, 0.02, 0.02), True)
    assert sum(each.leaves and each.share > 0.0 for each in found) > count / 20


def test_a_robot_on_a_floor_leaves_a_touch_under_a_beam_in_cpp(program, tmp_path):
    occupied = np.zeros((40, 30, 13), dtype=bool)
    occupied[23, 15, 1:4] = True  # a post before the base, which ends at 2.3 m
    occupied[8:19, :, 5] = occupied[8:19, :, 9:] = True  # between the parts, and above them
    build_on_floor("boxes", occupied).save(tmp_path / "map")
    numbers = (DT, *BRAKES, 0.0, 0.0, 0.0, 0.0)
    pose, back, rest = (2.03, 1.55, 0.0), (-0.5, 0.0), (0.0, 0.0)
    for robot, share in (("map", 1.0), ("0 0.45 0.35 -0.3 0.35 -0.3 -0.35 0.45 -0.35", 0.0)):
        gate = GateInCpp(program, tmp_path / "map", robot, *numbers, leaving=True)
        slowed = gate.slow_down(pose, back, rest)
        assert (slowed.share, slowed.leaves) == (share, True)
        # Points have no height.
        assert gate.slow_down(pose, back, rest, [(1.729, 1.55)]).share == 0.0
        gate.close()


def test_a_robot_that_is_not_convex_on_a_floor_has_no_parts(program, tmp_path):
    workspace = cspace.Workspace.from_array(np.zeros((20, 20, 6), dtype=bool), 0.1)
    ell = trimesh.creation.extrude_polygon(shapely.Polygon(ELL), 0.2)
    space = cspace.build(workspace, cspace.Robot.from_mesh(ell), rotations=4, floor=0.1)
    space.save(tmp_path / "map")
    _, (line,) = read_parts(program, tmp_path / "map")
    assert "no convex parts at the heights of its layers" in line


def find_margin():
    """Return the margin of the gate's distances from the centers of points, metres."""
    return math.hypot(TRACKING, TRACKING) + math.hypot(0.3, 0.2) * TRACKING + POINT_RADIUS


@pytest.mark.parametrize(
    "count", [60, pytest.param(3000, marks=pytest.mark.thorough)], ids=["few", "many"]
)
def test_points_stay_beyond_the_margin_and_near_ones_come_no_nearer(program, room, count):
    rng = np.random.default_rng(count)
    gates = [open_gate(program, room, leaving) for leaving in (False, True)]
    free = left = 0
    for _ in range(count):
        pose = (*rng.uniform((3.5, 0.5), (5.5, 2.0)), rng.uniform(-math.pi, math.pi))
        twist = rng.normal(0.0, (0.5, 1.0)) * (rng.random(2) < 0.7)
        points = pose[:2] + rng.normal(0.0, 0.6, (rng.integers(1, 6), 2))
        for gate in gates:
            slowed = gate.slow_down(pose, twist, (0.0, 0.0), points)
            if not (slowed.is_proven or slowed.leaves):
                continue
            poses = place_along(pose, slowed.commands, watch.DT)
            distances = bound_distances([BODY], poses, points)
            if slowed.is_proven:
                assert distances.min() >= find_margin() - 1e-9
                free += slowed.share > 0.0
            else:
                smallest = np.minimum(distances.min(axis=1), find_margin())
                assert (smallest >= smallest[0] - 1e-9).all()
                left += slowed.share > 0.0
    assert min(free, left) > count / 10
    for gate in gates:
        gate.close()


@pytest.mark.parametrize(
    "count", [200, pytest.param(4000, marks=pytest.mark.thorough)], ids=["few", "many"]
)
@pytest.mark.parametrize("degrees, dt", [(90, watch.DT), (130, 10 * watch.DT)])
def test_a_way_to_the_side_is_one_ahead_of_a_robot_turned_in_its_frame(
    tmp_path, program, room, degrees, dt, count
):
    angle, turned = math.radians(degrees), affinity.rotate(BODY, -degrees, (0.0, 0.0))
    cells = cspace.open(room).workspace
    cspace.build(cells, cspace.Robot.polygon(turned), rotations=72).save(tmp_path / "turned")
    numbers = (dt, *watch.BRAKES, *(TRACKING,) * 3, POINT_RADIUS)
    rng, found = np.random.default_rng(count), []
    for leaving in (False, True):
        gate, other = (
            GateInCpp(program, path, "map", *numbers, leaving=leaving)
            for path in (room, tmp_path / "turned")
        )
        for _ in range(count):
            x, y, yaw = rng.uniform((0.3, 0.3, -3.0), (5.7, 3.7, 3.0))
            ways = np.outer(
                (1.0, rng.random()), rng.normal(0.0, (0.5, 1.0)) * (rng.random(2) < 0.8)
            )
            ways[1] += rng.normal(0.0, 0.05, 2)
            points = rng.normal((x, y), 0.8, (rng.integers(3), 2))
            twists = np.outer(ways[:, 0], (math.cos(angle), 0.0, math.sin(angle)))
            twists[:, 1] = ways[:, 1]
            slowed = gate.slow_down((x, y, yaw), *twists, points)
            expected = other.slow_down((x, y, yaw + angle), *ways, points)
            assert slowed[:3] == expected[:3], (x, y, yaw, ways, points)
            along = slowed.commands[:, ::2] @ (math.cos(angle), math.sin(angle))
            np.testing.assert_allclose(along, expected.commands[:, 0], atol=1e-12)
            found.append(slowed[:3])
        gate.close()
        other.close()
    shares, proven, leaves = np.transpose(found)
    assert len(np.unique(shares)) > 4 and min(proven.sum(), leaves.sum()) > count / 10
