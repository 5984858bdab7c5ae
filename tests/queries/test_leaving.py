"""A gate lets a robot out of a touch, against distances by shapely."""

import math

import numpy as np
import pytest
import shapely
import trimesh

import cspace
from cspace import Robot, Workspace
from tests.helpers.floors import cut_ball, cut_prism
from tests.helpers.handmade import build_empty
from tests.helpers.leaving import CELL, bound_distances, place_along
from tests.helpers.refusals import check_refused, refusals

DT, BRAKES = 0.1, (1.0, 2.0)
"""Seconds of a command, and the brakes, m/s^2 and rad/s^2."""

BODIES = {
    "rectangle": ([shapely.box(-0.3, -0.2, 0.3, 0.2)], Robot.rectangle(0.6, 0.4)),
    "wedge": (
        [shapely.Polygon([(-0.1, -0.2), (0.5, 0.0), (-0.1, 0.2)])],
        Robot.polygon([(-0.1, -0.2), (0.5, 0.0), (-0.1, 0.2)]),
    ),
    "disc": ([shapely.Point(0.1, 0.0)], Robot.disc(0.25, (0.1, 0.0))),
    "tee": (
        [shapely.box(-0.1, -0.3, 0.1, 0.3), shapely.box(0.1, -0.05, 0.4, 0.05)],
        Robot.polygon([shapely.box(-0.1, -0.3, 0.1, 0.3), shapely.box(0.1, -0.05, 0.4, 0.05)]),
    ),
}
"""Convex cores of each robot, and the robot; the core of the disc is grown by 0.25 m."""


def build(name, occupied, **options):
    """Build a map of occupied cells for a robot."""
    workspace = Workspace.from_array(occupied, CELL)
    return cspace.build(workspace, BODIES[name][1], rotations=36, **options)


def make_gate(space, tracking=0.0):
    """Return a gate that knows the brakes."""
    return cspace.Gate(space, dt=DT, tracking=tracking, max_deceleration=BRAKES)


def draw_twist(rng):
    """Draw a pose in the room, and a twist."""
    pose = (*rng.uniform((0.0, 0.0), (4.0, 3.0)), rng.uniform(-math.pi, math.pi))
    return pose, rng.normal(0.0, (0.5, 1.0)) * (rng.random(2) < 0.7)


# ---- robots on a floor ---------------------------------------------------------------------------

BOXES = (((-0.3, -0.2, 0.05), (0.3, 0.2, 0.35)), ((-0.1, -0.35, 0.55), (0.45, 0.35, 0.75)))
"""Corners of the base and of the top of a robot on a floor; layers are 0.1 m high."""

BALLS = ((0.0, 0.1, 0.35), (0.25, 0.0, 0.8))
"""Centers of the balls of a robot on a floor, 0.3 m in radius."""

FLOOR = 0.1


ON_FLOORS = {
    "boxes": (
        [cut_prism(shapely.box(*low[:2], *high[:2]), low[2], high[2]) for low, high in BOXES],
        Robot.from_mesh(
            trimesh.util.concatenate([trimesh.creation.box(bounds=box) for box in BOXES])
        ),
    ),
    "balls": ([cut_ball(center, 0.3) for center in BALLS], Robot.from_balls(BALLS, 0.3)),
}
"""Parts of each robot on a floor between two heights, and the robot."""


def build_on_floor(name, occupied, **options):
    """Build a map with a floor for a robot."""
    workspace = Workspace.from_array(occupied, CELL)
    return cspace.build(workspace, ON_FLOORS[name][1], rotations=36, floor=FLOOR, **options)


def list_solids(name, space):
    """Return solids that a robot keeps away from: centers of cells, a core, and its radius.

    Those around the grid count if it is closed.
    """
    taken = space.workspace.outer
    padding = ((12, 12), (12, 12), (0, 0))[: taken.ndim]
    padded = np.pad(taken, padding, constant_values=space.outside == "blocked")
    if name in BODIES:
        centers = (np.argwhere(padded) - 11.5) * CELL
        return [(centers, core, 0.25 * (name == "disc")) for core in BODIES[name][0]]
    solids = []
    for layer in range(padded.shape[2]):
        centers = (np.argwhere(padded[:, :, layer]) - 11.5) * CELL
        low = CELL * layer - FLOOR
        parts = [part for cut in ON_FLOORS[name][0] for part in cut(low, low + CELL)]
        solids += [(centers, *part) for part in parts]
    return solids


@pytest.fixture(
    scope="module", params=[(n, o) for n in (*BODIES, *ON_FLOORS) for o in ("blocked", "free")]
)
def crowded(request):
    """Return the name of a robot, and a map with cells taken at random."""
    name, outside = request.param
    options = {"outside": outside, "margin": 0.03 * (outside == "free")}
    if name in BODIES:
        occupied = np.random.default_rng(5).random((40, 30)) < 0.02
        return name, build(name, occupied, **options)
    occupied = np.random.default_rng(6).random((40, 30, 13)) < 0.005
    return name, build_on_floor(name, occupied, **options)


@pytest.mark.parametrize("tracking", [0.0, (0.03, 0.02, 0.05)], ids=["exact", "straying"])
@pytest.mark.parametrize(
    "count", [25, pytest.param(2000, marks=pytest.mark.thorough)], ids=["few", "many"]
)
def test_what_leaves_comes_no_nearer_to_what_is_near(crowded, count, tracking):
    name, space = crowded
    rng = np.random.default_rng(count)
    gate, solids = make_gate(space, tracking), list_solids(name, space)
    errors = np.broadcast_to(tracking, 3)
    farthest = max(
        float(np.hypot(*shapely.get_coordinates(core).T).max()) + radius
        for _, core, radius in solids
    )
    margin = space.margin + math.hypot(*errors[:2]) + farthest * errors[2]
    is_round = name in ("disc", "balls")
    rounding = 1e-9 if name in BODIES else 1e-5  # a mesh from above is grown by a micrometre
    left = 0
    for _ in range(count):
        pose, twist = draw_twist(rng)
        slowed = gate.slow_down(pose, twist, leaving=True)
        assert not (slowed.leaves and slowed.chunk)
        if not slowed.leaves or not slowed.share or not slowed.commands.any():
            continue
        left += 1
        poses = place_along(pose, slowed.commands, DT, instants=9)
        smallest = np.full(len(poses), margin)
        for centers, core, radius in solids:
            near = centers[np.hypot(*(centers - pose[:2]).T) < 1.2]
            if not len(near):
                continue
            distances = bound_distances([core], poses, near) - radius - 0.7072 * CELL
            proven = np.minimum(distances, margin)
            smallest = np.minimum(smallest, proven.min(axis=1))
            assert not (twist[1] or is_round) or (proven >= proven[0] - rounding).all()
        assert (smallest >= smallest[0] - rounding).all()
    assert left > count / 20


def test_a_robot_on_a_floor_leaves_a_touch_under_a_beam():
    occupied = np.zeros((40, 30, 13), dtype=bool)
    occupied[23, 15, 1:4] = True  # a post before the base, which ends at 2.3 m
    occupied[8:19, :, 6] = True  # a beam behind the top, above the base
    pose = (2.03, 1.55, 0.0)
    gate = make_gate(build_on_floor("boxes", occupied))
    assert not gate.slow_down(pose, (0.2, 0.0), leaving=True).share
    assert gate.slow_down(pose, (-0.2, 0.0), leaving=True).share < 1.0
    occupied[8:19, :, 6] = False
    occupied[8:19, :, 5] = occupied[8:19, :, 9:] = True  # between the parts, and above them
    gate = make_gate(build_on_floor("boxes", occupied))
    assert not gate.slow_down(pose, (-0.5, 0.0)).share
    slowed = gate.slow_down(pose, (-0.5, 0.0), leaving=True)
    assert (slowed.share, slowed.leaves) == (1.0, True)


def test_a_robot_among_prisms_leaves_as_in_the_plane():
    rng = np.random.default_rng(8)
    ground = rng.random((40, 30)) < 0.02
    plane = make_gate(build("rectangle", ground))
    prisms = Workspace.from_array(np.repeat(ground[:, :, None], 6, axis=2), CELL)
    box = Robot.box((0.6, 0.4, 0.31), (0.0, 0.0, 0.2))
    gate = make_gate(cspace.build(prisms, box, rotations=36, floor=0.03))
    for _ in range(25):
        pose, twist = draw_twist(rng)
        one, other = (each.slow_down(pose, twist, leaving=True) for each in (plane, gate))
        assert (one.share, one.leaves) == (other.share, other.leaves)
        assert (one.commands == other.commands).all()


# ---- a wall in front -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def walls():
    """Return a room whose wall begins at x = 3.0 m, for each robot."""
    occupied = np.zeros((40, 30), dtype=bool)
    occupied[30:] = True
    return {name: build(name, occupied) for name in BODIES}


@pytest.mark.parametrize("depth", [-0.03, 0.0, 0.04])
@pytest.mark.parametrize("name", BODIES)
def test_a_robot_that_touches_a_wall_may_back_away_from_it_and_not_press_on(walls, name, depth):
    gate = make_gate(walls[name], 0.02)
    front = max(float(core.bounds[2]) for core in BODIES[name][0]) + 0.25 * (name == "disc")
    pose = (3.0 + depth - front, 1.5, 0.0)
    assert not gate.slow_down(pose, (-0.4, 0.0)).share
    backwards = gate.slow_down(pose, (-0.4, 0.0), leaving=True)
    assert (backwards.share, backwards.leaves) == (1.0, True)
    assert not gate.slow_down(pose, (0.1, 0.0), leaving=True).share
    turning = gate.slow_down(pose, (0.1, 1.0), leaving=True)
    assert not turning.share
    braking = gate.slow_down(pose, (-0.4, 0.0), twist_now=(0.4, 0.0), leaving=True)
    assert (braking.share, braking.leaves) == (0.0, False)


@pytest.mark.parametrize("name", BODIES)
def test_a_robot_that_is_lost_leaves_nowhere(walls, name):
    gate = make_gate(walls[name], 0.02)
    in_the_wall, outside = (3.5, 1.5), (14.0, 1.5)
    for place in (in_the_wall, outside):
        for yaw in (0.0, 1.0, math.pi):
            slowed = gate.slow_down((*place, yaw), (0.4, 0.0), leaving=True)
            assert slowed.share == 0.0 and not slowed.chunk


def test_a_robot_with_a_corner_on_the_center_of_a_taken_cell_does_not_press_on():
    occupied = np.zeros((40, 40), dtype=np.bool_)
    occupied[20, 20] = True
    corners = np.array([(2, -12), (28, -9), (-1, 25), (-23, 14)]) / 64.0
    space = cspace.build(Workspace.from_array(occupied, 0.125), Robot.polygon(corners), rotations=4)
    center = 20.5 * 0.125
    gate = make_gate(space)
    for pose in np.column_stack([center - corners, np.zeros(len(corners))]):
        shares = [gate.slow_down(pose, (v, 0.0), leaving=True).share for v in (0.4, -0.4)]
        # A convex robot leaves a corner in one of two opposite directions at most.
        assert min(shares) == 0.0


@pytest.mark.parametrize("outside", ["free", "blocked"])
def test_a_robot_at_a_place_that_rounding_swallows_leaves_nowhere(outside):
    occupied = np.zeros((20, 20), dtype=np.bool_)
    space = build("rectangle", occupied, outside=outside)
    gate = make_gate(space)
    for x in (1e9, 1e12, 1e17, 1e19, -1e19, 1e300):
        assert gate.slow_down((x, 1.0, 0.0), (0.4, 0.0), leaving=True).share == 0.0


def test_a_robot_may_drive_along_a_wall_that_is_nearer_than_its_margin(walls):
    gate = make_gate(walls["rectangle"], 0.02)
    for turn in (0.0, 0.05, 0.4):
        # Its rear corner is 5 mm from the wall.
        reach = 0.2 * math.cos(turn) + 0.3 * math.sin(turn)
        pose = (3.0 - reach - 0.005, 1.5, math.pi / 2.0 + turn)
        assert not gate.slow_down(pose, (0.4, 0.0)).share
        assert gate.slow_down(pose, (0.4, 0.0), leaving=True).share == 1.0
    pose = (2.795, 1.5, math.pi / 2.0)
    assert not gate.slow_down(pose, (0.4, -0.5), leaving=True).share


@pytest.mark.parametrize("place", [(2.5, 2.05), (2.35, 1.5), (2.9, 2.0)])
def test_a_robot_beside_a_wall_comes_to_others_no_nearer_than_its_margin(place):
    occupied = np.zeros((40, 30), dtype=bool)
    occupied[30:] = True
    space = build("rectangle", occupied)
    gate = make_gate(space, 0.02)
    pose = (2.79, 1.4, math.pi / 2.0)
    assert gate.slow_down(pose, (0.8, 0.0), leaving=True).share == 1.0
    space.add_obstacle("post", [place], radius=0.01)
    now = np.zeros(2)
    margin = math.hypot(0.02, 0.02) + math.hypot(0.3, 0.2) * 0.02
    before = shapely.Point(place).distance(shapely.box(2.59, 1.1, 2.99, 1.7))
    for _ in range(15):
        now = gate.slow_down(pose, (0.8, 0.0), twist_now=now, leaving=True).commands[0]
        pose = (pose[0], pose[1] + DT * now[0], pose[2])
        body = shapely.box(2.59, pose[1] - 0.3, 2.99, pose[1] + 0.3)
        assert shapely.Point(place).distance(body) - 0.01 >= min(before - 0.01, margin) - 1e-9
    assert pose[1] > 1.4 or before < 0.4


def test_a_disc_may_turn_about_its_center_in_a_touch():
    occupied = np.zeros((40, 30), dtype=bool)
    occupied[30:] = True
    space = cspace.build(Workspace.from_array(occupied, CELL), Robot.disc(0.25), rotations=8)
    gate = make_gate(space)
    assert not gate.slow_down((2.76, 1.5, 0.3), (0.0, 1.0)).share
    assert gate.slow_down((2.76, 1.5, 0.3), (0.0, 1.0), leaving=True).share == 1.0


def test_a_person_who_steps_up_behind_does_not_stop_a_robot_that_drives_away():
    space = build("rectangle", np.zeros((60, 30), dtype=bool))
    gate = make_gate(space, 0.02)
    pose, now = (2.0, 1.5, 0.0), (0.5, 0.0)
    space.add_obstacle("person", [(1.5, 1.5)], radius=0.18)
    stopped = gate.slow_down(pose, now, twist_now=now)
    assert not stopped.share and not stopped.chunk and not stopped.leaves
    slowed = gate.slow_down(pose, now, twist_now=now, leaving=True)
    assert (slowed.share, slowed.leaves) == (1.0, True)
    space.add_obstacle("other", [(2.45, 1.5)], radius=0.1)
    slowed = gate.slow_down(pose, now, twist_now=now, leaving=True)
    assert slowed.share == 0.0 and not slowed.leaves


def test_limits_of_the_gate_hold_while_a_robot_leaves(walls):
    import planners

    options = {"dt": DT, "max_deceleration": BRAKES}
    pose = (2.75, 1.5, 0.0)
    forward = cspace.Gate(walls["rectangle"], drive=planners.Car(turning_radius=0.5), **options)
    assert not forward.slow_down(pose, (-0.4, 0.0), leaving=True).share
    slow = cspace.Gate(walls["rectangle"], max_velocity=(0.1, 1.0), **options)
    assert slow.slow_down(pose, (-0.4, 0.0), leaving=True).share == 0.25


@refusals(
    "robot, message",
    (Robot.polygon([(0, 0), (1, 0), (1, 1), (0.5, 0.2)]), "has a part that is not convex"),
    (
        Robot.polygon(shapely.Point(0, 0).buffer(0.5).difference(shapely.Point(0, 0).buffer(0.3))),
        "has a part that is not convex",
    ),
)
def test_robots_that_are_not_convex_are_refused(robot, message):
    gate = make_gate(build_empty((30, 30), robot, rotations=8, spacing=CELL))
    check_refused(lambda: gate.slow_down((1.5, 1.5, 0.0), (0.1, 0.0), leaving=True), message)


def test_maps_in_tiles_are_refused(tmp_path):
    space = build_empty(
        (30, 30), Robot.disc(0.2), rotations=8, store=tmp_path / "map", spacing=CELL
    )
    gate = make_gate(space)
    assert gate.slow_down((1.5, 1.5, 0.0), (0.1, 0.0)).share == 1.0
    message = "distances that never fall are proven on maps in memory"
    check_refused(lambda: gate.slow_down((1.5, 1.5, 0.0), (0.1, 0.0), leaving=True), message)
