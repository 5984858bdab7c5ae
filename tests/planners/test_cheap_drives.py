"""Plans of drives by costs: time, clearance, and costs of one's own on cells."""

import heapq
import math

import numpy as np
import pytest
import shapely
from scipy.interpolate import RegularGridInterpolator

import planners
from cspace import InputError, Robot, Workspace, build
from tests.helpers.drives import is_car, make_drive
from tests.helpers.handmade import build_empty, fill_boxes
from tests.helpers.oracles import edge_lengths, integrate_along
from tests.helpers.placements import collides, turn_between
from tests.helpers.strategies import few

DRIVES = ["differential", "differential-reverse", "dubins", "reeds-shepp"]
EVERY_DRIVE = pytest.mark.parametrize("drive", DRIVES)
ROBOT = shapely.box(-0.25, -0.15, 0.25, 0.15)
SPACING = 0.1
SIDES = 6.0, 5.0
HEADINGS = 8


def integrate(plan, cost):
    """Integrate the cost of a metre along a path.

    A radian that is turned on the spot counts as half a metre.
    """
    starts, ends = plan.path[:-1], plan.path[1:]
    costs = integrate_along(starts[:, :2], ends[:, :2], cost, 50)
    turns = np.abs(turn_between(starts[:, 2], ends[:, 2]))
    return float(costs.sum() + (0.0 if is_car(plan) else 0.5 * turns @ cost(starts[:, :2])))


class Costs:
    """Costs of a metre at the centers of cells, linear between them."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.field = np.zeros((60, 50))
        for i, j in rng.integers((5, 0), (45, 40), (3, 2)):
            self.field[i : i + rng.integers(8, 20), j : j + rng.integers(8, 25)] = 4.0
        axes = [SPACING * (np.arange(n) + 0.5) for n in self.field.shape]
        self._values = RegularGridInterpolator(axes, self.field, bounds_error=False)

    def at(self, points):
        """Return the cost of a metre at points of the plane, shape (..., 2)."""
        lowest = 0.5 * SPACING
        return 1.0 + self._values(np.clip(points, lowest, np.array(SIDES) - lowest))

    def along(self, plan):
        """Integrate the cost along a path."""
        return integrate(plan, self.at)

    def objective(self, space):
        """Return these costs on all slices of a map."""
        field = np.broadcast_to(self.field, (len(space.slice_rotations), *self.field.shape))
        return planners.WeightedLength(field)


def build_world(seed):
    """Build a map with boxes."""
    rng = np.random.default_rng([seed, 1])
    cells = np.zeros((60, 50), dtype=bool)
    for i, j in rng.integers((5, 0), (50, 45), (4, 2)):
        cells[i : i + 4, j : j + 9] = True
    return build(Workspace.from_array(cells, SPACING), Robot.polygon(ROBOT), rotations=72)


def find_least_cost(costs, space, start, goal, reverse_cost=None):
    """Return the least cost of a chain of turns and drives between centers of cells.

    The robot drives ahead to neighbouring cells, and back if that has a cost. Only its poses at the
    centers are free of obstacles.
    """
    shape = *costs.field.shape, HEADINGS
    yaws = math.tau / HEADINGS * np.arange(HEADINGS)
    i, j, k = np.indices(shape)
    poses = np.stack([SPACING * (i + 0.5), SPACING * (j + 0.5), yaws[k]], axis=-1).reshape(-1, 3)
    is_free = ~collides(space, poses).reshape(shape)
    factors = costs.at(poses[::HEADINGS, :2]).reshape(shape[:2])
    ahead = np.round(np.stack([np.cos(yaws), np.sin(yaws)], axis=1)).astype(int)
    least = np.full(shape, np.inf)
    least[start] = 0.0
    queue = [(0.0, start)]
    while queue:
        cost, (i, j, k) = heapq.heappop(queue)
        if (i, j, k) == goal:
            return cost
        if cost > least[i, j, k]:
            continue
        steps = [(i, j, (k + turn) % HEADINGS) for turn in (1, -1)]
        prices = [0.5 * math.tau / HEADINGS * factors[i, j]] * 2
        for sign, price in ((1, 1.0), (-1, reverse_cost)):
            u, v = i + sign * int(ahead[k, 0]), j + sign * int(ahead[k, 1])
            if price and 0 <= u < shape[0] and 0 <= v < shape[1]:
                length = price * SPACING * math.hypot(*ahead[k])
                steps.append((u, v, k))
                prices.append(0.5 * length * (factors[i, j] + factors[u, v]))
        for step, price in zip(steps, prices, strict=True):
            if is_free[step] and cost + price < least[step]:
                least[step] = cost + price
                heapq.heappush(queue, (cost + price, step))
    return math.inf


def draw_cell(space, rng):
    """Draw a cell and a heading at which the robot is free."""
    while True:
        node = tuple(map(int, rng.integers((60, 50, HEADINGS))))
        if space.is_free(to_pose(node)):
            return node


def to_pose(node):
    """Return the configuration of a cell and heading."""
    i, j, k = node
    yaw = math.remainder(math.tau / HEADINGS * k, math.tau)
    return SPACING * (i + 0.5), SPACING * (j + 0.5), yaw


def check_near_least(seed):
    """Check that plans cost hardly more than Dijkstra's chain, and no more than short paths."""
    rng = np.random.default_rng([seed, 2])
    costs = Costs(seed)
    space = build_world(seed)
    drive = planners.Differential()
    ratios = []
    for _ in range(3):
        nodes = draw_cell(space, rng), draw_cell(space, rng)
        ends = [to_pose(node) for node in nodes]
        least = find_least_cost(costs, space, *nodes)
        plan = planners.plan(space, *ends, drive=drive, objective=costs.objective(space))
        short = planners.plan(space, *ends, drive=drive)
        assert bool(plan) == plan.certified == bool(short)
        if plan:
            assert costs.along(plan) <= 1.02 * costs.along(short)
            ratios.append(costs.along(plan) / least)
    return ratios


def test_a_differential_drive_pays_hardly_more_than_the_cheapest_chain():
    ratios = check_near_least(1)
    assert ratios
    assert max(ratios) < 1.1


@pytest.mark.parametrize("rounds", few([1, 2]))
@EVERY_DRIVE
def test_no_plan_by_cost_costs_more_than_the_one_by_length(drive, rounds):
    options = {"drive": make_drive(drive)}
    saved = 0
    for seed in range(rounds):
        costs = Costs(seed)
        space = build_world(seed)
        rng = np.random.default_rng([seed, 3])
        for start, goal in space.sample_free(6, rng).reshape(3, 2, 3):
            short = planners.plan(space, start, goal, **options)
            plan = planners.plan(space, start, goal, **options, objective=costs.objective(space))
            assert bool(plan) == plan.certified == bool(short)
            if plan:
                # Steps of a cell integrate less exactly than those here.
                assert costs.along(plan) <= 1.02 * costs.along(short)
                saved += costs.along(plan) < 0.95 * costs.along(short)
    assert saved >= 1


@EVERY_DRIVE
def test_costs_of_one_for_each_metre_change_nothing(drive):
    space = build_world(3)
    costs = planners.WeightedLength(np.zeros((len(space.slice_rotations), 60, 50)))
    rng = np.random.default_rng(0)
    for start, goal in space.sample_free(8, rng).reshape(4, 2, 3):
        options = {"drive": make_drive(drive)}
        short = planners.plan(space, start, goal, **options)
        plan = planners.plan(space, start, goal, objective=costs, **options)
        np.testing.assert_array_equal(plan.waypoints, short.waypoints)


# ---- costs of reversing ---------------------------------------------------------------------------


def test_costs_of_one_for_each_metre_leave_costs_of_switches():
    space = build_world(0)
    costs = planners.WeightedLength(np.zeros((len(space.slice_rotations), 60, 50)))
    car = planners.Car(0.4, reverse=True, switch_cost=0.5)
    totals = np.zeros(2)
    for ends in space.sample_free(12, np.random.default_rng([0, 9])).reshape(6, 2, 3):
        for k, options in enumerate(({}, {"objective": costs})):
            totals[k] += measure_driving(
                planners.plan(space, *ends, drive=car, **options), 1.0, 0.5
            )
    assert totals[1] == pytest.approx(totals[0], rel=0.002)


def measure_driving(plan, reverse_cost, switch_cost):
    """Return the cost of a path by its rows; half a metre for each radian turned on the spot."""
    starts, ends = plan.path[:-1], plan.path[1:]
    lengths = edge_lengths(starts[:, :2], ends[:, :2])
    if not is_car(plan):
        lengths = lengths + 0.5 * np.abs(turn_between(starts[:, 2], ends[:, 2]))
    ways = plan.direction[1:]
    changes = np.count_nonzero(np.diff(ways[ways != 0]))
    return float(np.where(ways < 0, reverse_cost, 1.0) @ lengths + switch_cost * changes)


PRICES = {
    "reeds-shepp": [(2.0, 0.0), (1.0, 2.0), (8.0, 1.0)],
    "differential-reverse": [(2.0, 0.0), (8.0, 0.0)],
}


@pytest.mark.parametrize("drive", PRICES)
def test_plans_reverse_less_where_reversing_costs_more(drive):
    ratios = []
    saved = 0
    for seed in range(3):
        space = build_world(seed)
        rng = np.random.default_rng([seed, 4])
        for start, goal in space.sample_free(6, rng).reshape(3, 2, 3):
            short = planners.plan(space, start, goal, drive=make_drive(drive))
            for prices in PRICES[drive]:
                names = ("reverse_cost", "switch_cost") if prices[1] else ("reverse_cost",)
                costs = dict(zip(names, prices, strict=False))
                plan = planners.plan(space, start, goal, drive=make_drive(drive, **costs))
                assert bool(plan) == plan.certified == bool(short)
                if plan:
                    radians = 0.0 if is_car(plan) else 0.5 * plan.total_rotation
                    assert plan.length + radians >= (1.0 - 1e-9) * plan.lower_bound
                    pair = [measure_driving(each, *prices) for each in (plan, short)]
                    ratios.append(pair[0] / pair[1])
                    saved += pair[0] < 0.95 * pair[1]
    assert max(ratios) < 1.01 and saved >= 4


def test_a_loop_in_reverse_alone_is_driven_where_a_switch_costs_more():
    car = planners.Car(0.4, reverse=True, switch_cost=2.0)
    ends = (3.8, 3.7, -0.41), (4.12, 3.94, 1.55)
    space = build_empty((80, 80), Robot.polygon(ROBOT), rotations=36)
    plan = planners.plan(space, *ends, drive=car)
    assert set(plan.direction[1:]) == {-1}  # a loop ahead is 3.03 m long
    assert plan.certified and plan.length == pytest.approx(2.136, abs=0.01)


def test_a_plan_comes_although_the_shortest_path_is_not_proven_as_one_with_costs():
    space = build_world(13)
    ends = space.sample_free(12, np.random.default_rng([13, 9])).reshape(6, 2, 3)[4]
    plan = planners.plan(space, *ends, drive=planners.Car(0.4, reverse=True, switch_cost=2.0))
    assert plan.certified


def test_of_plans_for_several_costs_each_is_the_cheapest_by_its_own():
    prices = [(1.0, 2.0), (1.0, 5.0), (3.0, 0.0)]
    names = "reverse_cost", "switch_cost"
    cars = [
        planners.Car(0.4, reverse=True, **dict(zip(names, price, strict=True))) for price in prices
    ]
    ratios = []
    for seed in range(3):
        space = build_world(seed)
        rng = np.random.default_rng([seed, 9])
        for ends in space.sample_free(12, rng).reshape(6, 2, 3):
            plans = [planners.plan(space, *ends, drive=car) for car in cars]
            if all(plans):
                costs = [[measure_driving(plan, *price) for plan in plans] for price in prices]
                ratios += [row[k] / min(row) for k, row in enumerate(costs)]
    # A lattice finds no cheapest path.
    assert len(ratios) > 20 and np.mean(ratios) < 1.02


@pytest.mark.parametrize("price", few([3.0, 1.5, 6.0]))
def test_a_differential_drive_pays_hardly_more_than_the_cheapest_chain_with_reversing(price):
    even = Costs(0)
    even.at = lambda points: np.ones(points.shape[:-1])
    drive = planners.Differential(reverse=True, reverse_cost=price)
    ratios = []
    for seed in (1, 2):
        space = build_world(seed)
        rng = np.random.default_rng([seed, 5])
        for _ in range(2):
            nodes = draw_cell(space, rng), draw_cell(space, rng)
            least = find_least_cost(even, space, *nodes, price)
            plan = planners.plan(space, *map(to_pose, nodes), drive=drive)
            assert bool(plan) == plan.certified
            if plan:
                ratios.append(measure_driving(plan, price, 0.0) / least)
    assert len(ratios) >= 3 and max(ratios) < 1.1


@pytest.mark.parametrize(
    "drive", [planners.Differential, lambda **costs: planners.Car(0.5, **costs)]
)
def test_a_robot_reverses_out_of_a_dead_end_at_any_cost(drive):
    occupied = fill_boxes((80, 40), np.s_[:, :17], np.s_[:, 23:], np.s_[:10])
    space = build(Workspace.from_array(occupied, 0.1), Robot.polygon(ROBOT), rotations=72)
    costs = {"reverse": True, "reverse_cost": 20.0}
    plan = planners.plan(space, (7.0, 2.0, 0.0), (2.0, 2.0, 0.0), drive=drive(**costs))
    assert plan.certified and (plan.direction == -1).all()
    assert plan.length == pytest.approx(5.0, abs=0.1)


def test_costs_of_reversing_change_the_curve_and_count_in_costs_of_cells():
    space = build_empty((80, 80), Robot.polygon(ROBOT), rotations=72)
    start, goal = (4.0, 4.0, 0.0), (3.4, 4.0, 0.0)
    cars = [planners.Car(0.5, reverse=True, reverse_cost=price) for price in (1.0, 3.0, 9.0)]
    plans = [planners.plan(space, start, goal, drive=car) for car in cars]
    assert [bool((plan.direction < 0).any()) for plan in plans] == [True, True, False]
    assert plans[1].length == pytest.approx(0.6) and plans[2].length > 3.0
    ones = planners.WeightedLength(np.zeros((len(space.slice_rotations), 80, 80)))
    for car, plan in zip(cars, plans, strict=True):
        again = planners.plan(space, start, goal, drive=car, objective=ones)
        np.testing.assert_array_equal(again.waypoints, plan.waypoints)
    assert plans[2].recheck().all()


@pytest.mark.parametrize(
    "drive", [planners.Differential, lambda **costs: planners.Car(0.5, **costs)]
)
def test_planners_of_ompl_take_no_costs_of_reversing(drive):
    costly = drive(reverse=True, reverse_cost=2.0)
    space = build_empty((40, 40), Robot.polygon(ROBOT), rotations=8)
    for call in (
        lambda: planners.plan(space, (1, 1, 0), (2, 2, 0), drive=costly, planner="RRTConnect"),
        lambda: planners.state_space(space, drive=costly),
        lambda: planners.simple_setup(space, drive=costly),
    ):
        with pytest.raises(InputError, match="planners of OMPL drive the shortest way"):
            call()


# ---- ways around ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hall():
    """Build a hall of 8 m by 6 m, with a dead end of 0.8 m at its right side."""
    occupied = fill_boxes((80, 60), np.s_[65:, :26], np.s_[65:, 34:])
    return build(Workspace.from_array(occupied, 0.1), Robot.polygon(ROBOT), rotations=72)


ZONE = shapely.box(3.0, 1.8, 4.5, 4.0)
SPEEDS = [1.0, planners.SpeedZones([(ZONE, 0.2)], within="point")]
START = 1.0, 3.0, 0.0
GOALS = pytest.mark.parametrize("goal", [(6.0, 3.0, 0.0), (7.2, 3.0, 0.0)], ids=["open", "tight"])
"""The robot sees both goals from the start; a car that reverses is searched from the tight one."""


def touches(plan):
    """Return whether the reference point passes the zone, farther in than a cell."""
    return shapely.LineString(plan.path[:, :2]).intersects(ZONE.buffer(-SPACING))


@EVERY_DRIVE
@GOALS
def test_the_quickest_way_leads_around_a_slow_zone_in_sight_of_the_goal(hall, drive, goal):
    options = {"drive": make_drive(drive)}
    assert touches(planners.plan(hall, START, goal, **options))
    plan = planners.plan(hall, START, goal, objective="time", speed=SPEEDS, **options)
    assert plan.certified and plan.planner == "Lattice" and plan.objective == "time"
    assert not touches(plan)
    assert plan.length < 6.0 + goal[0] - 6.0


@EVERY_DRIVE
def test_a_plan_goes_on_around_the_zone_along_the_plan_before(hall, drive):
    options = {"drive": make_drive(drive), "objective": "time", "speed": SPEEDS}
    before = planners.plan(hall, START, (6.0, 3.0, 0.0), **options)
    here = before.path[len(before.path) // 8]
    plan = planners.plan(hall, here, before.goal, previous=before, **options)
    assert plan.certified and "along the previous plan" in plan.status
    assert not touches(plan)


@EVERY_DRIVE
def test_clearance_keeps_drives_in_the_middle_of_a_corridor(drive):
    occupied = fill_boxes((80, 30), np.s_[30:50, :6], np.s_[30:50, 26:])
    workspace = Workspace.from_array(occupied, 0.1)
    space = build(workspace, Robot.polygon(ROBOT), rotations=72)
    ends = (1.0, 1.0, 0.0), (7.0, 1.0, 0.0)
    short = planners.plan(space, *ends, drive=make_drive(drive))
    plan = planners.plan(space, *ends, drive=make_drive(drive), objective="clearance")
    assert plan.certified and plan.planner == "Lattice"
    assert plan.clearance > short.clearance + 0.1
    assert plan.length < 1.3 * short.length


def test_clearance_counts_obstacles_of_an_update():
    workspace = Workspace.from_array(np.zeros((80, 60), dtype=bool), 0.1)
    query = (1.0, 3.0, 0.0), (7.0, 3.0, 0.0)
    options = {"drive": planners.Differential(), "objective": "clearance"}
    paths = []
    for plans_before in (False, True):
        space = build(workspace, Robot.polygon(ROBOT), rotations=72)
        if plans_before:
            planners.plan(space, *query, **options)
        space.add_obstacle("crate", shapely.box(3.5, 1.5, 4.5, 4.0))
        paths.append(planners.plan(space, *query, **options).waypoints)
    np.testing.assert_array_equal(*paths)
