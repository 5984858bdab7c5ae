"""Corridors along plans, against their rows, the curves of cars and linear programs."""

import math
import pickle

import numpy as np
import pytest
from scipy.optimize import linprog

import cspace
import planners
from cspace import Robot, Workspace
from cspace.errors import InputError
from tests.helpers.drives import make_drive
from tests.helpers.handmade import build_empty
from tests.helpers.planning import points_along
from tests.helpers.refusals import check_refused
from tests.helpers.spaces import Disc
from tests.regions.test_free_region import build_yard, check_proof

ENDS = (0.6, 0.5, 0.3), (5.4, 5.3, 2.0)


def plan_in_yard(rotations, drive=None, radius=None, seed=3):
    """Plan across a yard, from one free place to another."""
    space = build_yard(rotations, seed=seed)
    size = space.size
    start, goal = (space.nearest_free(end[:size]) for end in ENDS)
    plan = planners.plan(space, start, goal, time_limit=10, drive=make_drive(drive, radius))
    assert plan.certified
    return plan


def check_corridor(plan, corridor):
    """Check that each edge lies in one region, and neighbours meet in their junction."""
    path = corridor.path
    regions = corridor.regions
    number = 0  # of the region
    for edge in range(len(path) - 1):
        ends = path[edge : edge + 2]
        number += bool((corridor.junctions[number : number + 1] == ends[0]).all(axis=1).any())
        assert (ends @ regions[number].A.T <= regions[number].b).all()
    assert number == len(regions) - 1
    assert len(corridor.junctions) == len(regions) - 1
    for k, junction in enumerate(corridor.junctions):
        assert regions[k].contains(junction) and regions[k + 1].contains(junction)
        # The overlap is more than a point: a linear program finds a ball of positions in both.
        dim = plan.space.dim
        rows = np.vstack([regions[k].A[:, :dim], regions[k + 1].A[:, :dim]])
        offsets = np.concatenate([regions[k].b, regions[k + 1].b])
        lengths = np.linalg.norm(rows, axis=1)
        is_position = lengths > 0.0
        constraints = np.column_stack([rows, lengths])[is_position]
        cost = np.append(np.zeros(dim), -1.0)
        assert linprog(cost, constraints, offsets[is_position], bounds=(None, None)).x[-1] > 1e-5
    np.testing.assert_allclose(path[0], plan.start)
    steps = plan.space.steps_between(path[-1], plan.goal)
    np.testing.assert_allclose(steps, 0.0, atol=1e-9)
    for waypoint in plan.waypoints:
        distances = np.abs(plan.space.steps_between(path, waypoint[np.newaxis])).max(axis=1)
        assert distances.min() < 1e-9, "the corridor leaves out a waypoint"


@pytest.mark.parametrize("rotations, drive", [(None, None), (36, None), (36, "differential")])
def test_each_edge_lies_in_a_region_that_overlaps_the_next(rotations, drive):
    plan = plan_in_yard(rotations, drive)
    corridor = plan.corridor(reach=2.0)
    check_corridor(plan, corridor)
    for region in corridor.regions:
        check_proof(plan.space, region)
    assert plan.space.certify_path(corridor.path).all()


@pytest.mark.parametrize(
    "drive", [pytest.param("dubins", marks=pytest.mark.thorough), "reeds-shepp"]
)
def test_the_curves_of_cars_lie_in_the_regions(drive):
    plan = plan_in_yard(36, drive, {"dubins": 0.3, "reeds-shepp": 0.6}[drive], seed=5)
    corridor = plan.corridor(reach=2.0)
    check_corridor(plan, corridor)
    edges = plan._edges
    for first, last in zip(plan.waypoints[:-1], plan.waypoints[1:], strict=True):
        length = edges.edge_length(*first, *last)
        points = points_along(edges, first, last, np.linspace(0.0, length, 500))
        inside = np.any([region.contains(points) for region in corridor.regions], axis=0)
        assert inside.all()


def test_a_straight_way_has_one_region():
    space = build_empty((400, 30), Robot.disc(0.3))
    plan = planners.plan(space, (1.0, 1.0), (39.0, 2.0))
    corridor = plan.corridor()
    assert len(corridor.regions) == 1 and corridor.junctions.shape == (0, 2)
    assert repr(corridor) == "Corridor(1 regions along 1 edges)"
    still = planners.plan(space, (1.0, 1.0), (1.0, 1.0)).corridor()
    assert len(still.regions) == 1 and still.regions[0].contains((1.0, 1.0))


def test_few_regions_lead_around_corners():
    """A comb of walls needs a region for each gap; a ball would need one every half metre."""
    occupied = np.zeros((200, 60), dtype=bool)
    for k in range(4):
        occupied[40 * (k + 1) : 40 * (k + 1) + 3, slice(None, 45) if k % 2 else slice(15, None)] = 1
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.3))
    plan = planners.plan(space, (1.0, 3.0), (19.0, 3.0))
    corridor = plan.corridor()
    check_corridor(plan, corridor)
    assert len(corridor.regions) <= len(plan.waypoints) - 1
    assert plan.corridor(margin=1e-4).regions[0].volume < corridor.regions[0].volume


def test_a_corridor_in_space_with_a_yaw():
    occupied = np.zeros((40, 30, 16), dtype=bool)
    occupied[18:20, :20] = True
    workspace = Workspace.from_array(occupied, 0.1)
    space = cspace.build(workspace, Robot.box((0.5, 0.3, 0.2)), rotations=12)
    plan = planners.plan(space, (0.6, 0.6, 0.5, 0.2), (3.2, 0.6, 1.0, 3.0), time_limit=10)
    corridor = plan.corridor(reach=1.0)
    check_corridor(plan, corridor)
    assert corridor.plot().name == "3d"


@pytest.mark.parametrize(
    "dim, count", [(2, 8), (3, 6), pytest.param(3, 60, marks=pytest.mark.thorough)]
)
def test_edges_past_edges_and_corners_of_cells_lie_in_regions(dim, count):
    """Shortest paths come within 2^-8 cells of corners, which leaves little room for planes."""
    rng = np.random.default_rng(7)
    shape = {2: (200, 90), 3: (60, 50, 40)}[dim]
    occupied = np.zeros(shape, dtype=bool)
    for _ in range(14):
        first = rng.integers(0, np.array(shape) - 9)
        sides = rng.integers(2, {2: 30, 3: 20}[dim], dim)
        occupied[tuple(map(slice, first, first + sides))] = True
    robot = Robot.rectangle(0.3, 0.2) if dim == 2 else Robot.ball(0.12)
    space = cspace.build(Workspace.from_array(occupied, 0.1), robot)
    for _ in range(count):
        plan = planners.plan(space, *space.sample_free(2, rng=rng), time_limit=2)
        if plan:
            check_corridor(plan, plan.corridor(reach=2.0))


def test_corridors_are_drawn():
    plan = plan_in_yard(None)
    corridor = plan.corridor()
    axes = corridor.plot(plan.plot())
    assert len(axes.collections[-1].get_paths()) == len(corridor.regions)


# ---- refusals ------------------------------------------------------------------------------------


def build_gap(spacing):
    """Build a room whose gap is free by the geometry, and by the cells of a finer map."""
    wall = np.zeros((120, 80), dtype=bool)
    wall[60, :38] = wall[60, 42:] = True
    factor = round(0.1 / spacing)
    cells = np.kron(wall, np.ones((factor, factor), dtype=bool))
    return cspace.build(Workspace.from_array(cells, spacing), Robot.disc(0.17))


def test_edges_outside_free_cells_are_named():
    space = build_gap(0.1)
    ends = (1.0, 4.0), (11.0, 4.0)
    plan = planners.plan(space.exact, *ends)
    assert plan.certified and not space.certify_path(plan.waypoints).all()
    wrong = np.flatnonzero(~space.certify_path(plan.waypoints))
    with pytest.raises(InputError, match=f"on edges {wrong[0]}"):
        plan.corridor()
    check_refused(
        plan.corridor,
        "plan leaves the FREE cells on edges 0, counted from 0 ... consist",
    )


def test_a_margin_that_is_too_large_is_refused():
    plan = plan_in_yard(None)
    check_refused(lambda: plan.corridor(margin=0.5), "margin is 0.5, and cells that are not FREE")


@pytest.mark.parametrize("yaw", [0.0, 0.3, 3.0])
def test_a_margin_that_an_end_does_not_keep_is_refused(yaw):
    """An edge into the margin is halved no more than it has yaws; the message has its two ends."""
    occupied = np.zeros((60, 40), dtype=bool)
    occupied[50] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.3), rotations=8)
    plan = planners.plan(space, (1.0, 1.0, 0.0), (4.57, 2.13, yaw))
    assert space.clearance(plan.goal) <= 0.03
    with pytest.raises(InputError, match=rf"from \(1, 1, 0\) to \(4.57, 2.13, {yaw:g}\)"):
        plan.corridor(margin=0.15)


def test_a_small_margin_at_a_turn_in_a_narrow_place_is_refused():
    occupied = np.zeros((80, 60), dtype=bool)
    occupied[38:42, :40] = True
    space = cspace.build(
        Workspace.from_array(occupied, 0.1), Robot.rectangle(0.7, 0.4), rotations=36
    )
    ends = (1.0, 1.0, 2.5), (7.0, 1.0, 0.0)
    check_refused(
        lambda: planners.plan(space, *ends).corridor(margin=1e-6),
        "margin is 1e-06, and cells that are not FREE are nearer to ... keeps",
    )


def test_edges_near_other_cells_are_refused():
    occupied = np.zeros((40, 20), dtype=bool)
    occupied[:, :2] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.01))
    y = float(space.nearest_free((2.0, 0.0))[1]) - 0.05 + 0.1 * 1.5 * 2.0**-26
    near = planners.plan(space, (1.0, y), (3.0, y))
    assert near.certified
    check_refused(
        near.corridor,
        "plan is too near to cells that are not FREE from (1, 0.3) ... lies",
    )


def test_plans_without_proof_path_or_map_are_refused():
    import dataclasses

    plan = plan_in_yard(None)
    unproven = dataclasses.replace(plan, certified=False)
    check_refused(unproven.corridor, "plan is not certified ... contain")
    packed = pickle.loads(pickle.dumps(plan))
    check_refused(packed.corridor, "plan has no map ... pickling")
    walled = np.zeros((40, 30), dtype=bool)
    walled[20] = True
    space = cspace.build(Workspace.from_array(walled, 0.1), Robot.disc(0.2))
    none = planners.plan(space, (1.0, 1.0), (3.0, 1.0))
    check_refused(none.corridor, "plan has no path: no path exists: proven ... corridor")
    with pytest.raises(InputError, match="reach is 0"):
        plan.corridor(reach=0)


def test_plans_in_other_spaces_are_refused():
    plan = planners.plan(Disc("x", "y"), (-1.5, 0.0), (-1.5, 1.0), time_limit=1)
    with pytest.raises(InputError, match=r"space is Disc\(x, y\); it must be a map in memory"):
        plan.corridor()
    assert math.isnan(plan.clearance)
