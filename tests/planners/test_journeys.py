"""Journeys: several starts, alternatives on the way, and goals, proven and planned as a whole.

Oracles: components of cells by scipy, over all choices; plans between single configurations.
"""

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
import planners
from cspace import BLOCKED, FREE, MIXED, ConfigurationError
from tests.helpers.handmade import components, map_of
from tests.helpers.placements import turn_between
from tests.helpers.planning import options_for
from tests.helpers.strategies import examples, few, seeds

PROVEN = "no path exists: proven"
LOW, HIGH, LOW_END, HIGH_END, GOAL = (1.0, 1.0), (1.0, 3.0), (4.0, 1.0), (4.0, 3.0), (5.0, 2.6)
"""Places in two halls, below and above y = 2."""


class Choice(NamedTuple):
    """One alternative of a stage."""

    place: Any
    cells: dict  # gaps in metres and radians of cells (rotation, x, y) that it meets
    contains: Callable

    @property
    def is_closest(self):
        return isinstance(self.place, planners.Near) and self.place.closest


# ---- all choices on small maps -------------------------------------------------------------------


def draw_halls(rng, turns):
    """Draw states of cells of 1 m, with walls and doors, which may be open at one yaw alone."""
    shape = (turns or 1, *rng.integers(6, 13, 2))
    states = rng.choice([FREE, MIXED, BLOCKED], shape, p=[0.6, 0.1, 0.3]).astype(np.uint8)
    if rng.random() < 0.7:
        states[:] = FREE
    for axis in rng.integers(1, 3, rng.integers(1, 3)).tolist():
        wall: list[Any] = [slice(None)] * 3
        wall[axis] = rng.integers(1, shape[axis] - 1)
        states[tuple(wall)] = BLOCKED
        if rng.random() < 0.6:
            wall[3 - axis] = rng.integers(shape[3 - axis])
            wall[0] = rng.integers(shape[0]) if rng.random() < 0.3 else slice(None)
            states[tuple(wall)] = rng.choice([FREE, MIXED])
    return states


def draw_choice(rng, states, centers, kinds):
    """Draw the middle of a cell, mostly of a FREE one, or a place with room around it."""
    free = np.argwhere(states == FREE)
    is_any_cell = not len(free) or rng.random() < 0.15
    cell = rng.integers(states.shape) if is_any_cell else free[rng.integers(len(free))]
    middle = cell[1:] + 0.5
    yaw = centers[cell[0]].tolist()
    corners = np.indices(states.shape[1:]).reshape(2, -1).T
    kind = rng.choice(kinds)
    angle = radius = 0.0
    low = high = middle
    q = (*middle.tolist(), *yaw)
    place = q
    if kind in ("near", "closest"):
        radius = float(rng.uniform(0.1, 2.5))
        angle = float(rng.uniform(0.05, 3.0)) if yaw and rng.random() < 0.5 else 0.0
        if kind == "closest":  # no two cells are equally near
            radius = float(rng.choice([radius, math.inf]))
            low = high = middle = middle + rng.uniform(-0.49, 0.49, 2)
            yaw = [x + rng.uniform(-0.49, 0.49) * math.tau / len(centers) for x in yaw]
        q = (*middle.tolist(), *yaw)
        place = planners.Near(q, radius, angle, closest=kind == "closest")
    elif kind == "region":
        low, high = middle - rng.uniform(0.05, 3, 2), middle + rng.uniform(0.05, 3, 2)
        angle = math.pi if yaw and rng.random() < 0.5 else 0.0
        place = shapely.box(*low, *high)
        place = (place, *yaw) if yaw and not angle else place
    elif kind == "any" and yaw:
        angle, place = math.pi, (*middle.tolist(), None)

    def gap(first, last):
        """Return the distances of boxes (n, 2) from the positions of the place."""
        return np.linalg.norm(np.maximum(low - last, first - high).clip(0.0), axis=1)

    turns = np.abs(turn_between(yaw[0], centers[:, 0])) if yaw else np.zeros(1)
    turns = (turns - math.pi / len(centers)).clip(0.0)
    gaps = gap(corners, corners + 1.0) if radius or kind == "region" else np.full(len(corners), 9.0)
    gaps[(corners == cell[1:]).all(axis=1)] = 0.0
    met = itertools.product(
        np.flatnonzero(turns <= angle + 1e-9).tolist(), np.flatnonzero(gaps <= radius).tolist()
    )
    cells = {(k, *corners[n].tolist()): (float(gaps[n]), float(turns[k])) for k, n in met}

    def contains(row):
        """Return whether a configuration lies in the place, up to rounding."""
        turn = abs(turn_between(yaw[0], row[2])) if yaw else 0.0
        return (
            gap(row[np.newaxis, :2], row[np.newaxis, :2])[0] <= radius + 1e-9
            and turn <= angle + 1e-9
        )

    return Choice(place, cells, contains)


def draw_journey(rng, turns, kinds):
    """Draw a map, its states, and the alternatives of a start, 0 to 2 places and a goal."""
    states = draw_halls(rng, turns)
    space = map_of(states if turns else states[0], turns, "blocked", 1.0)
    counts = rng.integers(1, 4, rng.integers(2, 5)).tolist()
    centers = space.rotations.centers
    stages = [[draw_choice(rng, states, centers, kinds) for _ in range(n)] for n in counts]
    return states, space, stages


def plan_journey(space, stages, **options):
    """Plan through the places of stages."""
    start, *via, goal = [[choice.place for choice in stage] for stage in stages]
    return planners.plan(space, start, goal, via=via, **options)


def find_common(labels, stages):
    """Return, for each number of stages, the components that all these stages meet."""
    met = [{int(labels[cell]) for each in stage for cell in each.cells} - {-1} for stage in stages]
    return list(itertools.accumulate(met, set.intersection))


def choose_closest(labels, stages):
    """Replace the choices of stages that end as near as possible by their nearest cells."""
    chosen = list(stages)
    for k, stage in enumerate(stages):
        others = [*chosen[:k], *chosen[k + 1 :]]
        joined = find_common(labels, others)[-1] or find_common(labels, stages[:1])[-1]
        chosen[k] = [narrow_choice(each, labels, joined) for each in stage]
    return chosen


def narrow_choice(choice, labels, joined):
    """Return a choice of its nearest cell alone that lies in joined components."""
    if not choice.is_closest:
        return choice
    x, y, *yaw = choice.place.configuration
    gaps = {cell: gap for cell, gap in choice.cells.items() if labels[cell] in joined}
    least = min(gaps.values(), default=None)

    def contains(row):
        turn = abs(turn_between(yaw[0], row[2])) if yaw else 0.0
        return least and math.dist(row[:2], (x, y)) <= least[0] + 1e-5 and turn <= least[1] + 1e-5

    return Choice(choice.place, {cell: gap for cell, gap in gaps.items() if gap == least}, contains)


def check_journey(plan, states, stages, is_holonomic):
    """Check a plan by the labels of cells."""
    labels = components(states == FREE, "turning")
    connected = find_common(labels, stages)
    passable = find_common(components(states != BLOCKED, "turning"), stages)
    assert plan.is_disconnected == (not passable[-1])
    assert plan.is_connected == bool(connected[-1])
    assert bool(plan) == plan.certified == bool(connected[-1]) or not (is_holonomic or plan)
    if plan.is_disconnected:
        number = next(k for k, each in enumerate(passable) if not each)
        name = "" if number == len(stages) - 1 else f"via[{number - 1}] is not reached: "
        assert plan.status.split("; ")[0] == name + PROVEN
    if plan:
        rows = plan.path[[0, *plan.via_rows, -1]]
        for row, stage in zip(rows, choose_closest(labels, stages), strict=True):
            assert any(choice.contains(row) for choice in stage)


@examples(240)
@given(seeds, st.sampled_from([None, 1, 4, 6]))
def test_a_journey_is_found_or_disproven_as_labels_of_cells_say(seed, turns):
    rng = np.random.default_rng(seed)
    kinds = ("point", "region", "any", "near", "closest")
    states, space, (_, *others) = draw_journey(rng, turns, kinds)
    # Near one configuration, a start is this one.
    starts = [draw_choice(rng, states, space.rotations.centers, kinds[:3]) for _ in range(2)]
    stages = [starts[: rng.integers(1, 3)], *others]
    labels = components(states == FREE, "turning")
    try:
        plan = plan_journey(space, stages)
    except ConfigurationError:
        stages = choose_closest(labels, stages)
        free = np.where(states == FREE, 0, -1)
        assert any(not find_common(free, [stage])[0] for stage in stages)
        return
    check_journey(plan, states, stages, is_holonomic=True)


@pytest.mark.parametrize("drive", ["differential", "dubins", "reeds-shepp"])
@examples(12)
@given(seeds)
def test_a_journey_is_found_if_plans_join_one_of_its_choices(drive, seed):
    rng = np.random.default_rng(seed)
    options = options_for(drive)
    states, space, stages = draw_journey(rng, 6, ("point",))
    stages = [[each for each in stage if states[min(each.cells)] == FREE] for stage in stages]
    if not all(stages):
        return
    plan = plan_journey(space, stages, **options)
    check_journey(plan, states, stages, is_holonomic=False)
    reached = stages[0]
    for stage in stages[1:]:
        ways = itertools.product(stage, reached)
        reached = [q for q, p in ways if planners.plan(space, p.place, q.place, **options)]
        if plan:
            break
    # Each of those plans had as much time as the whole journey.
    assert plan or not reached or plan_journey(space, stages, time_limit=20.0, **options)


# ---- other spaces --------------------------------------------------------------------------------


def build_wall():
    """Return the cells of two halls, 6 m long, apart by a wall."""
    cells = np.zeros((60, 40), dtype=bool)
    cells[:, 20] = True
    return cspace.Workspace.from_array(cells, 0.1)


def build_gap():
    """Build the map of halls whose wall has a gap little narrower than the robot, by geometry."""
    walls = [shapely.box(0, 1.9, 2.805, 2.1), shapely.box(3.195, 1.9, 6, 2.1)]
    workspace = cspace.Workspace.from_polygons(walls, spacing=0.1, bounds=(0, 0, 6, 4))
    return cspace.build(workspace, cspace.Robot.disc(0.2), outside="blocked").exact


class Halls(cspace.Space):
    """Two halls, of which a space knows only motions."""

    axes = ("a", "b")
    bounds = ((0.0, 0.0), (6.0, 4.0))

    def is_free(self, q):
        return bool(q[1] != 2.0)

    def motion_is_free(self, q0, q1):
        return self.is_free(q0) and (q0[1] > 2.0) == (q1[1] > 2.0)


class KnownHalls(Halls):
    """Two halls that know themselves apart."""

    def path_exists(self, q0, q1):
        return bool((q0[1] > 2.0) == (q1[1] > 2.0))


SPACES = {
    "map": lambda folder: cspace.build(build_wall(), cspace.Robot.disc(0.2)),
    "tiles": lambda folder: cspace.build(
        build_wall(), cspace.Robot.disc(0.2), store=folder / "map", tile=20
    ),
    "known": lambda folder: KnownHalls(),
    "own": lambda folder: Halls(),
    "exact": lambda folder: build_gap(),
}


@pytest.mark.parametrize("name", few(SPACES, 3))
def test_a_start_and_a_place_that_lead_no_further_give_way_to_others(name, tmp_path):
    space = SPACES[name](tmp_path)
    both, near = [LOW_END, HIGH_END], (3.8, 1.0)
    for starts, via in (
        ([near, HIGH], [both]),
        ([HIGH, near], [both[::-1], both]),
        ([near, LOW, HIGH], [both, [(2.0, 1.0), (2.0, 3.0)], both]),
        (HIGH, [both]),
    ):
        plan = planners.plan(space, starts, GOAL, via=via)
        assert plan.certified and not plan.is_disconnected
        assert plan.start.tolist() == list(HIGH)
        assert (plan.path[list(plan.via_rows), 1] == 3.0).all()
    assert plan.is_connected == (name != "own")
    plan = planners.plan(space, [LOW, HIGH], GOAL, via=[LOW_END], time_limit=0.1)
    assert not plan and not plan.is_connected
    assert plan.is_disconnected == (plan.status == PROVEN) == (name in ("map", "tiles", "known"))


@pytest.mark.parametrize("drive", [None, "dubins"])
def test_a_goal_out_of_reach_is_told_of_the_plan_though_a_place_before_is_joined(drive):
    space = cspace.build(build_wall(), cspace.Robot.disc(0.2), rotations=8)
    start, behind, beyond = (3.0, 1.0, 0.0), (1.5, 1.0, 0.0), (3.0, 3.0, 0.0)
    drive = drive and planners.Car(turning_radius=5.0)
    options = {"via": [behind], "drive": drive, "time_limit": 0.5}
    plan = planners.plan(space, start, beyond, **options)
    assert plan.status == PROVEN and plan.is_disconnected and not plan.is_connected
    assert plan.start.tolist() == list(start) and plan.goal.tolist() == list(beyond)
    plan = planners.plan(space, start, (3.0, 1.5, 0.0), **options)
    assert plan.is_connected and not plan.is_disconnected and bool(plan) == (drive is None)


def test_a_car_leaves_out_a_place_that_it_cannot_leave():
    cells = np.zeros((80, 60), dtype=bool)
    cells[30:50, 20:22] = cells[30:50, 34:36] = cells[50:52, 20:36] = True  # open to the left
    workspace = cspace.Workspace.from_array(cells, 0.1)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.5, 0.3), rotations=24)
    inside, beside = (4.5, 2.8, 0.0), (4.5, 5.0, 0.0)
    ends = (1.0, 2.8, 0.0), (7.0, 2.8, 0.0)
    forward, reversing = (planners.Car(0.6, reverse=reverse) for reverse in (False, True))
    for via, drive, passed in (
        ([[inside, beside]], forward, beside),
        ([[beside, inside], [inside, beside]], forward, beside),
        ([[inside, beside]], reversing, inside),
    ):
        plan = planners.plan(space, *ends, via=via, drive=drive, time_limit=3.0)
        assert plan.certified and plan.path[plan.via_rows[0]].tolist() == list(passed)
