"""Plans of the map's own search that weigh clearance against length."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import cspace
import planners
from cspace import FREE
from cspace.support.arrays import Bools, Floats, Ints
from tests.helpers.planning import ENDPOINTS, SPACES, build_from_states, build_room
from tests.helpers.strategies import seeds

WEIGHT = 10.0
"""Extra metres that a metre of path costs without clearance, by default."""

SAMPLES_PER_EDGE = 200


def unite_blocked(states: np.ndarray) -> shapely.Geometry:
    """Unite the cells of side 1 that are not FREE, and the exterior."""
    sides = np.array(states.shape, dtype=float)
    cells = [shapely.box(*corner, *(corner + 1.0)) for corner in np.argwhere(states != FREE)]
    return shapely.union_all([*cells, shapely.box(-99, -99, 199, 199) - shapely.box(0, 0, *sides)])


def compute_costs(
    starts: Floats, ends: Floats, blocked: shapely.Geometry, threshold: float
) -> Floats:
    """Integrate the cost of a metre along edges in the plane; arrays have shape (n, 2), the costs
    (n,)."""
    shares = (np.arange(SAMPLES_PER_EDGE) + 0.5) / SAMPLES_PER_EDGE
    points = starts[:, None] + (ends - starts)[:, None] * shares[:, None]
    clearances = shapely.distance(blocked, shapely.points(points))
    factors = 1.0 + WEIGHT * np.maximum(0.0, 1.0 - clearances / threshold) ** 2
    return np.linalg.norm(ends - starts, axis=1) * factors.mean(axis=1)


def compute_cheapest_chain(
    free: Bools, blocked: shapely.Geometry, threshold: float, first: Ints, last: Ints
) -> float:
    """Return the least cost of a chain of free cells joined through sides and corners, infinity if
    none exists."""
    cells = np.argwhere(free)
    number = np.full(np.add(free.shape, 2), -1)  # with a frame that is not free
    number[1:-1, 1:-1][free] = np.arange(len(cells))
    pairs = []
    for step in ((1, 0), (0, 1), (1, 1), (1, -1)):
        touched = [cells + 1 + part for part in ((step[0], 0), (0, step[1]), step)]
        joined = np.all([number[tuple(each.T)] >= 0 for each in touched], axis=0)
        pairs.append(
            np.column_stack([np.flatnonzero(joined), number[tuple(touched[-1][joined].T)]])
        )
    rows, columns = np.concatenate(pairs).T
    costs = compute_costs(cells[rows] + 0.5, cells[columns] + 0.5, blocked, threshold)
    graph = coo_array((costs, (rows, columns)), shape=(len(cells),) * 2).tocsr()
    costs_from_first = dijkstra(graph, directed=False, indices=number[tuple(first + 1)])
    return float(costs_from_first[number[tuple(last + 1)]])


@settings(max_examples=25)
@given(seeds)
def test_plans_cost_hardly_more_than_the_cheapest_chain_of_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    occupied = np.zeros(rng.integers(15, 45, 2), dtype=np.bool_)
    for corner in rng.integers(0, occupied.shape, (4, 2)):
        occupied[
            tuple(
                slice(c, c + side) for c, side in zip(corner, rng.integers(1, 12, 2), strict=True)
            )
        ] = True
    sides = rng.uniform(1.5, 6.0, 2)
    space = cspace.build(cspace.Workspace.from_array(occupied, 1.0), cspace.Robot.rectangle(*sides))
    states, threshold = space.cell_states, float(sides.max())
    if not (states == FREE).any():
        return
    first, last = rng.choice(np.argwhere(states == FREE), 2)
    if (first == last).all() or not space.is_connected(first + 0.5, last + 0.5):
        return
    blocked = unite_blocked(states)
    plan = planners.plan(space, first + 0.5, last + 0.5, objective="clearance")
    assert plan.certified and plan.planner == "Grid"
    cost = compute_costs(plan.waypoints[:-1], plan.waypoints[1:], blocked, threshold).sum()
    short = planners.plan(space, first + 0.5, last + 0.5)
    assert (
        cost
        <= compute_costs(short.waypoints[:-1], short.waypoints[1:], blocked, threshold).sum() * 1.02
    )
    assert cost <= compute_cheapest_chain(states == FREE, blocked, threshold, first, last) * 1.1


def test_the_path_keeps_to_the_middle_of_a_corridor() -> None:
    walls = [shapely.box(2.0, 0.0, 8.0, 1.0), shapely.box(2.0, 3.0, 8.0, 4.0)]
    workspace = cspace.Workspace.from_polygons(walls, 0.05, bounds=(0.0, 0.0, 10.0, 4.0))
    space = cspace.build(workspace, cspace.Robot.disc(0.5))
    plan = planners.plan(space, (1.0, 0.6), (9.0, 0.6), objective="clearance")
    inside = shapely.LineString(plan.waypoints).intersection(shapely.box(3.0, 0.0, 7.0, 4.0))
    short = planners.plan(space, (1.0, 0.6), (9.0, 0.6))
    assert inside.within(shapely.box(2.9, 1.92, 7.1, 2.08)) and plan.length < 1.2 * short.length
    assert plan.clearance > 2.0 * short.clearance


@pytest.mark.parametrize("name", SPACES)
def test_plans_in_every_space_are_certified_and_clearer(name: str) -> None:
    space, ends = build_room(name), ENDPOINTS[name]
    plan, short = planners.plan(space, *ends, objective="clearance"), planners.plan(space, *ends)
    assert plan.certified and plan.planner == "Grid" and plan.objective == "clearance"
    assert (
        planners.plan(space, *ends, objective="clearance").waypoints.tolist()
        == plan.waypoints.tolist()
    )
    assert space.clearance(plan.path).mean() > space.clearance(short.path).mean()
    assert (
        short.length + 0.5 * short.total_rotation
        <= (plan.length + 0.5 * plan.total_rotation) * 1.05
    )
    assert planners.plan(space, *ends, objective="clearance", simplify=False).certified


def test_plans_follow_changes_of_the_map() -> None:
    states = np.full((20, 9), FREE, dtype=np.uint8)
    space = build_from_states(states)
    before = planners.plan(space, (1.5, 4.5), (18.5, 4.5), objective="clearance")
    space.update(np.ones((2, 7), dtype=np.bool_), (9, 0))
    after = planners.plan(space, (1.5, 4.5), (18.5, 4.5), objective="clearance")
    assert before.length == pytest.approx(17.0) and after.certified and after.path[:, 1].max() > 7.0
