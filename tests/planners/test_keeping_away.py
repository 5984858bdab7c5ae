"""Plans of the map's own search that weigh clearance against length."""

import numpy as np
import pytest
import shapely

import cspace
import planners
from cspace import FREE
from tests.helpers.oracles import cheapest_chain, integrate_along
from tests.helpers.regions import Flat, cell_boxes
from tests.helpers.strategies import few

WEIGHT = 10.0
"""Extra metres that a metre of path costs without clearance, by default."""


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
    # Cells from 9 on around the grid count as those outside.
    walls = cell_boxes(np.pad(~free, 9, constant_values=True), -9.0)
    blocked = shapely.union_all(Flat.boxes(walls).polygons)

    def measure(starts, ends):
        return integrate_along(starts, ends, price)

    def price(points):
        clearances = shapely.distance(blocked, shapely.points(points))
        return 1.0 + WEIGHT * np.maximum(0.0, 1.0 - clearances / threshold) ** 2

    costs = []
    for objective in ("clearance", "length"):
        plan = planners.plan(space, *ends, objective=objective)
        assert plan.certified and plan.planner == "Grid" and plan.objective == objective
        rows = plan.waypoints
        costs.append(measure(rows[:-1], rows[1:]).sum())
    assert costs[0] <= costs[1] * 1.02
    centers = np.argwhere(free) + 0.5
    assert costs[0] <= cheapest_chain(space, centers, 1.5, *ends, measure) * 1.1
