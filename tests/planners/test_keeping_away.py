"""Plans of the map's own search that weigh clearance against length."""

import numpy as np
import pytest
import shapely

import cspace
import planners
from cspace import FREE
from tests.helpers.oracles import cheapest_chain
from tests.helpers.strategies import few

WEIGHT = 10.0
"""Extra metres that a metre of path costs without clearance, by default."""

SAMPLES_PER_EDGE = 200


def unite_blocked(states):
    """Unite the cells of side 1 that are not FREE, and the exterior."""
    sides = np.array(states.shape, dtype=float)
    cells = [shapely.box(*corner, *(corner + 1.0)) for corner in np.argwhere(states != FREE)]
    return shapely.union_all([*cells, shapely.box(-99, -99, 199, 199) - shapely.box(0, 0, *sides)])


def compute_costs(starts, ends, blocked, threshold):
    """Integrate the cost of a metre along edges in the plane; arrays have shape (n, 2), the costs
    (n,)."""
    shares = (np.arange(SAMPLES_PER_EDGE) + 0.5) / SAMPLES_PER_EDGE
    points = starts[:, None] + (ends - starts)[:, None] * shares[:, None]
    clearances = shapely.distance(blocked, shapely.points(points))
    factors = 1.0 + WEIGHT * np.maximum(0.0, 1.0 - clearances / threshold) ** 2
    return np.linalg.norm(ends - starts, axis=1) * factors.mean(axis=1)


def compute_cheapest_chain(space, blocked, threshold, ends):
    """Return the least cost of a chain of proven motions between centers of neighbouring cells."""
    centers = np.argwhere(np.asarray(space.cell_states) == FREE) + 0.5

    def measure(starts, ends):
        return compute_costs(starts, ends, blocked, threshold)

    return cheapest_chain(space, centers, 1.5, *ends, measure)


# The search weighs lengths, so it need not find the cheapest path; the seeds are fixed.
@pytest.mark.parametrize("seed", few([2, 3]))
def test_plans_cost_hardly_more_than_the_cheapest_chain_of_cells(seed):
    rng = np.random.default_rng(seed)
    occupied = np.zeros(rng.integers(15, 45, 2), dtype=np.bool_)
    for (i, j), (width, height) in zip(
        rng.integers(0, occupied.shape, (4, 2)), rng.integers(1, 12, (4, 2)), strict=True
    ):
        occupied[i : i + width, j : j + height] = True
    sides = rng.uniform(1.5, 6.0, 2)
    space = cspace.build(cspace.Workspace.from_array(occupied, 1.0), cspace.Robot.rectangle(*sides))
    free = np.asarray(space.cell_states) == FREE
    threshold = float(sides.max())
    if not free.any():
        return
    first, last = rng.choice(np.argwhere(free), 2)
    ends = first + 0.5, last + 0.5
    if (first == last).all() or not space.is_connected(*ends):
        return
    blocked = unite_blocked(space.cell_states)
    costs = []
    for objective in ("clearance", "length"):
        plan = planners.plan(space, *ends, objective=objective)
        assert plan.certified and plan.planner == "Grid" and plan.objective == objective
        rows = plan.waypoints
        costs.append(compute_costs(rows[:-1], rows[1:], blocked, threshold).sum())
    assert costs[0] <= costs[1] * 1.02
    assert costs[0] <= compute_cheapest_chain(space, blocked, threshold, ends) * 1.1
