"""Plans that take the quickest way by largest speeds of places, or the cheapest by costs of cells."""

import gc
import weakref

import numpy as np
import pytest
import shapely
from shapely.geometry import box

import cspace
import planners
from cspace import FREE
from planners._searches.travel_time import read_speeds
from tests.helpers.handmade import build_empty
from tests.helpers.oracles import cheapest_chain, integrate_along
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.strategies import few

FULL = 1.2
"""Largest speed everywhere, m/s."""

RADIUS = 0.3


def hall(*walls, rotations=None, robot=None, spacing=0.1, bounds=(0, 0, 8, 6)):
    workspace = cspace.Workspace.from_polygons([box(-1, -1, 0, 0), *walls], spacing, bounds=bounds)
    robot = cspace.Robot.disc(RADIUS) if robot is None else robot
    return cspace.build(workspace, robot, rotations=rotations)


def measure_time(starts, ends, zones, radius, samples=8):
    """Return the times of straight edges of a disc, shape (n,); zones are pairs of area, speed."""

    def slowness(points):
        speeds = np.full(points.shape[:2], FULL)
        for area, speed in zones:
            is_in = shapely.distance(area, shapely.points(points)) <= radius
            speeds[is_in] = np.minimum(speeds[is_in], speed)
        return 1.0 / speeds

    return integrate_along(starts, ends, slowness, samples)


def time_of(plan, zones, radius=RADIUS):
    rows = plan.waypoints[:, :2]
    return measure_time(rows[:-1], rows[1:], zones, radius, 2000).sum()


def find_least_time(space, zones, start, goal):
    """Return the least time of a way along centers of FREE cells, by Dijkstra."""
    centers = space.grid.lower + space.grid.spacing * (0.5 + np.argwhere(space.cell_states == FREE))

    def measure(starts, ends):
        return measure_time(starts, ends, zones, RADIUS)

    return cheapest_chain(space, centers, 2.3 * space.grid.spacing, start, goal, measure)


def draw_world(rng):
    """Draw a hall with walls and zones, and two FREE centers of cells that are connected."""
    walls = [box(*low, *(low + rng.uniform(0.2, 2.5, 2))) for low in rng.uniform(0, 6, (4, 2))]
    zones = [
        (box(*low, *(low + rng.uniform(0.5, 3.0, 2))), float(speed))
        for low, speed in zip(rng.uniform(0, 6, (3, 2)), rng.uniform(0.2, 0.6, 3), strict=True)
    ]
    zones = [zone for zone in zones if zone[0].intersects(box(0, 0, 8, 6))]
    space = hall(*walls)
    centers = np.argwhere(np.asarray(space.cell_states) == FREE) * 0.1 + 0.05
    pairs = [rng.choice(centers, 2) for _ in range(20)]
    far = [p for p in pairs if np.linalg.norm(p[1] - p[0]) > 2.0 and space.is_connected(*p)]
    return space, zones, far[:2]


@pytest.mark.parametrize("seed, number", few([(4, 1), (4, 9), (3, 9)]))
def test_the_time_is_hardly_above_the_least_along_cells(seed, number):
    space, zones, pairs = draw_world(np.random.default_rng(seed))
    for start, goal in pairs[:number]:
        speed = [FULL, planners.SpeedZones(zones)]
        plan = planners.plan(space, start, goal, objective="time", speed=speed)
        assert plan.certified and plan.objective == "time" and plan.planner == "Grid"
        took = time_of(plan, zones)
        assert took <= 1.05 * find_least_time(space, zones, start, goal)
        assert took <= 1.001 * time_of(planners.plan(space, start, goal), zones)


def test_zones_of_the_full_speed_change_nothing():
    wall = box(3.9, 0, 4.1, 4)
    for space, start, goal in (
        (hall(wall), (1.0, 1.0), (7.0, 1.0)),
        (
            hall(wall, robot=cspace.Robot.rectangle(0.8, 0.5), rotations=16),
            (1.0, 1.0, 0.0),
            (7.0, 1.0, 0.5),
        ),
    ):
        shortest = planners.plan(space, start, goal)
        for speed in (FULL, [FULL, planners.SpeedZones([(box(2, 2, 6, 6), FULL)])], [3.0, FULL]):
            plan = planners.plan(space, start, goal, objective="time", speed=speed)
            assert plan.waypoints.tolist() == shortest.waypoints.tolist()


# ---- kinds of limits, robots and maps ------------------------------------------------------------

DOORS = [box(3.9, 1.5, 4.1, 4.5)]
"""A wall with a way below it and one above it."""

LOWER_WAY = [(box(3.0, 0.0, 5.0, 1.6), 0.2)]


def plan_around(space, *limits, start=(1.0, 2.0), goal=(7.0, 2.0), **options):
    """Plan from one side of the wall to the other; the way below it is shorter."""
    rest = (0.0,) * (space.size - 2)
    if space.dim == 3:
        rest = (1.0, *rest[1:])
    if space.size == 7:
        rest = (1.0, 0.0, 0.0, 0.0, 1.0)
    ends = ((*q, *rest) if isinstance(q, tuple) else q for q in (start, goal))
    plan = planners.plan(space, *ends, objective="time", speed=[FULL, *limits], **options)
    assert plan.certified
    return plan


def goes_above(plan):
    middle = plan._edges_on(plan.space).resample(plan.waypoints, 0.05)
    return bool(middle[np.abs(middle[:, 0] - 4.0).argmin(), 1] > 4.0)


@pytest.mark.parametrize("within", ["contour", "point"])
@pytest.mark.parametrize(
    "robot, rotations",
    [
        (cspace.Robot.disc(0.3), None),
        (cspace.Robot.rectangle(0.8, 0.4), None),
        (cspace.Robot.rectangle(0.8, 0.4), 24),
        (cspace.Robot.polygon([(-0.2, -0.2), (0.5, -0.2), (0.5, 0.2), (0.0, 0.4)]), 12),
    ],
)
def test_the_way_around_a_zone_is_taken(robot, rotations, within):
    space = hall(*DOORS, robot=robot, rotations=rotations)
    assert not goes_above(plan_around(space))
    assert goes_above(plan_around(space, planners.SpeedZones(LOWER_WAY, within)))
    # A zone of both ways leaves the shorter one.
    both = planners.SpeedZones([(box(3, 0, 5, 6), 0.2)], within)
    assert not goes_above(plan_around(space, both))


QUATERNIONS = pytest.param(cspace.Rotations.quaternions(1), marks=pytest.mark.thorough)


@pytest.mark.parametrize("rotations", [None, 8, QUATERNIONS])
def test_in_space_a_zone_reaches_from_the_ground_to_the_sky(rotations):
    walls = np.zeros((40, 30, 10), dtype=np.bool_)
    walls[19:21, 7:23] = True
    workspace = cspace.Workspace.from_array(walls, 0.2)
    space = cspace.build(workspace, cspace.Robot.box((0.4, 0.3, 0.2)), rotations=rotations)
    assert not goes_above(plan_around(space))
    assert goes_above(plan_around(space, planners.SpeedZones(LOWER_WAY)))


def test_a_robot_slows_down_near_obstacles_of_another_map():
    space = hall(*DOORS)
    people = hall(box(3.5, 0.2, 4.5, 0.4), spacing=0.07, bounds=(-1, -1, 9, 7))
    assert goes_above(plan_around(space, planners.SlowNear(people, 0.2, 1.0)))
    assert not goes_above(plan_around(space, planners.SlowNear(people, 0.2, 0.05)))


def test_updates_of_a_map_are_heeded():
    space = hall(*DOORS)
    people = hall(bounds=(0, 0, 8, 6))
    near = planners.SlowNear(people, 0.2, 0.6)
    assert not goes_above(plan_around(space, near))
    people.add_obstacle("person", box(3.8, 0.5, 4.2, 0.9))
    assert goes_above(plan_around(space, near))
    people.remove_obstacle("person")
    assert not goes_above(plan_around(space, near))


def test_a_map_in_tiles_and_the_geometry_take_the_way_around(tmp_path):
    workspace = cspace.Workspace.from_polygons(DOORS, 0.1, bounds=(0, 0, 8, 6))
    tiled = cspace.build(workspace, cspace.Robot.disc(0.3), store=tmp_path / "tiles.zarr", tile=64)
    zones = planners.SpeedZones([(box(3.0, 0.0, 5.0, 1.6), 0.05)])
    plan = planners.plan(tiled, (1.0, 2.0), (6.0, 2.0), objective="time", speed=[FULL, zones])
    assert plan.certified
    space = hall(*DOORS)
    assert goes_above(plan_around(space.exact, zones))


def test_a_zone_off_the_map_changes_nothing():
    space = hall(*DOORS)
    both = planners.SpeedZones([*LOWER_WAY, (box(90, 90, 99, 99), 0.1)])
    with pytest.warns(UserWarning, match="off the map"):
        assert goes_above(plan_around(space, both))


@pytest.mark.parametrize("within", ["contour", "point"])
def test_a_zone_counts_in_the_cells_at_whose_center_the_robot_meets_it(within):
    outline = np.array([(-0.4, -0.2), (0.5, -0.2), (0.3, 0.3), (-0.4, 0.2)])
    space = hall(robot=cspace.Robot.polygon(outline), rotations=24)
    area = shapely.Polygon([(2.013, 1.0), (5.0, 1.31), (4.0, 4.02), (3.0, 2.027)])
    costs = read_speeds([FULL, planners.SpeedZones([(area, 0.3)], within)], space)(space)
    rng = np.random.default_rng(0)
    for number in rng.integers(len(space.slice_rotations), size=400):
        cell = rng.integers(0, space.grid.shape)
        yaw = space.slice_rotations[number][0]
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        center = np.array(space.grid.lower) + space.grid.spacing * (cell + 0.5)
        body = shapely.Polygon(outline @ turn.T + center)
        met = body if within == "contour" else shapely.Point(center)
        factor = FULL / 0.3 if met.intersects(area) else 1.0
        assert costs.factors[number][tuple(cell)] == pytest.approx(factor)


def test_planners_of_ompl_take_costs_of_cells():
    search = planners.Search("RRTstar", iterations=300)
    zones = planners.SpeedZones(LOWER_WAY)
    plan = plan_around(hall(*DOORS), zones, planner=search, seed=1)
    assert goes_above(plan) and plan.planner == "RRTstar"


# ---- goals, places on the way, previous plans ----------------------------------------------------


@pytest.mark.parametrize("rotations", [None, 16])
def test_the_goal_of_the_least_time_is_taken(rotations):
    space = hall(rotations=rotations, robot=cspace.Robot.rectangle(0.6, 0.4))
    zones = planners.SpeedZones([(box(2.0, 0.0, 8.0, 2.0), 0.2)])
    rest = (0.0,) * (space.size - 2)
    goals = [(4.0, 1.0, *rest), (1.0, 5.0, *rest)]
    start = (1.0, 1.0, *rest)
    assert planners.plan(space, start, goals).goal[0] == 4.0
    plan = planners.plan(space, start, goals, objective="time", speed=[FULL, zones])
    assert plan.goal[0] == 1.0
    # Rooms in a zone and beyond it.
    rooms = [box(3.5, 0.5, 4.5, 1.5), box(0.5, 4.5, 1.5, 5.5)]
    if rotations is not None:
        rooms = [(room, 0.0) for room in rooms]
    plan = planners.plan(space, start, rooms, objective="time", speed=[FULL, zones])
    assert plan.certified and plan.goal[1] > 4.0


def test_a_previous_plan_is_joined_at_the_least_time():
    space = hall(*DOORS)
    zones = planners.SpeedZones(LOWER_WAY)
    before = plan_around(space, zones)
    again = plan_around(space, zones, start=(1.2, 2.2), previous=before)
    assert goes_above(again) and again.status == "path found: along the previous plan"
    assert time_of(again, LOWER_WAY) <= time_of(before, LOWER_WAY) + 0.1
    # Without shortening by cost, the path would be pulled through the zone.
    space.add_obstacle("box", box(2.0, 5.0, 2.4, 5.4))
    around = plan_around(space, zones, previous=before)
    assert goes_above(around)
    by_length = planners.plan(space, (1.0, 2.0), (7.0, 2.0))
    check_refused(lambda: plan_around(space, zones, previous=by_length), "is a plan by 'length'")


# ---- costs of cells ------------------------------------------------------------------------------


@pytest.mark.parametrize("rotations", [None, 12])
def test_costs_of_cells_are_avoided(rotations):
    space = hall(*DOORS, robot=cspace.Robot.rectangle(0.6, 0.4), rotations=rotations)
    costs = np.zeros((len(space.slice_rotations), *space.grid.shape))
    costs[:, 30:50, :16] = 1.0
    rest = (0.0,) * (space.size - 2)
    ends = (1.0, 2.0, *rest), (7.0, 2.0, *rest)
    for cost, is_above in ((10.0, True), (0.0, False)):
        objective = planners.WeightedLength(cost * costs)
        plan = planners.plan(space, *ends, objective=objective)
        assert plan.certified and goes_above(plan) == is_above
        assert plan.objective == "WeightedLength"


def test_a_clearance_of_ones_own_is_kept():
    space = hall(*DOORS)
    ends = (1.0, 2.0), (7.0, 2.0)
    clearances = [
        planners.plan(
            space, *ends, objective=planners.ClearanceObjective(clearance_threshold=threshold)
        ).clearance
        for threshold in (0.1, 0.3, 0.6)
    ]
    assert clearances[0] < clearances[1] < clearances[2]


# ---- memory, and refused arguments ---------------------------------------------------------------


def test_costs_live_as_long_as_map_and_zones():
    gc.freeze()  # what others have made is not looked through
    space = hall(*DOORS)
    zones = planners.SpeedZones(LOWER_WAY)
    near = planners.SlowNear(space, 0.3, 0.2)
    plan_around(space, zones, near)
    of_space, of_zones = weakref.ref(space), weakref.ref(zones)
    del space, near
    gc.collect()
    assert of_space() is None
    del zones
    gc.collect()
    assert of_zones() is None


@refusals(
    "options, message",
    ({"speed": 1.0}, "speed is 1.0, and objective is 'length' ... for objective='time'"),
    ({"objective": "time"}, "speed is None, and objective is 'time' ... everywhere"),
    ({"objective": "time", "speed": []}, "speed is [], and objective is 'time' ... limits"),
    ({"objective": "time", "speed": planners.SpeedZones(LOWER_WAY)}, "one of its limits is a num"),
    ({"objective": "time", "speed": 0.0}, "speed is 0.0"),
    ({"objective": "time", "speed": [1.0, -1.0]}, "speed is -1.0"),
    ({"objective": "time", "speed": float("nan")}, "speed is nan"),
    ({"objective": "time", "speed": True}, "speed is True, and objective is 'time' ... limits"),
    ({"objective": "time", "speed": [1.0, "slow"]}, "speed is 'slow'"),
    (
        {"objective": "time", "speed": [1.0, planners.ToolSpeed("tool0", 0.2)]},
        "speed is ToolSpeed(link='tool0', speed=0.2), and space is ... links",
    ),
    (
        {"objective": "time", "speed": [1.0, planners.SpeedZones([(box(90, 90, 99, 99), 1.0)])]},
        "zones[0] lies off the map",
    ),
    (
        {"objective": "time", "speed": [1.0, planners.SpeedZones(LOWER_WAY, frame_id="odom")]},
        "has the frame 'odom'",
    ),
    ({"objective": "times", "speed": None}, "objective is 'times' ... 'length', "),
    ({"objective": planners.WeightedLength(np.zeros((3, 3)))}, "costs has shape (3, 3); "),
    (
        {"objective": "time", "speed": 1.0, "planner": "RRTConnect"},
        "objective is 'time' and planner is 'RRTConnect'; RRTConnect takes objective: length",
    ),
)
def test_objectives_and_speeds_that_do_not_go_together_are_refused(options, message):
    check_refused(lambda: planners.plan(hall(), (1.0, 1.0), (3.0, 1.0), **options), message)


def test_a_number_is_a_largest_speed_of_a_trajectory():
    plan = planners.plan(hall(), (1.0, 1.0), (7.0, 1.0))
    limits = {"max_velocity": 1.0, "max_acceleration": 0.5}
    slow = plan.trajectory(**limits, speed=0.4)
    expected = plan.trajectory(max_velocity=0.4, max_acceleration=0.5)
    assert slow.duration == pytest.approx(expected.duration, rel=1e-6)
    assert slow.recheck(plan.space)


def test_zones_that_reach_far_beyond_the_map_count_on_it():
    space = build_empty((60, 40), cspace.Robot.rectangle(0.4, 0.2), rotations=8)
    paths = [
        planners.plan(
            space,
            (1.0, 1.0, 0.0),
            (5.0, 3.0, 0.0),
            objective="time",
            speed=[1.0, planners.SpeedZones([(shapely.box(2.0, -far, 3.0, far), 0.3)])],
        ).waypoints
        for far in (50.0, 1e9)
    ]
    assert len(paths[0]) > 1 and (paths[0] == paths[1]).all()
