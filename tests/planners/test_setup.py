"""Setups of OMPL: states, checkers, planner names, choices, refused options and memory."""

from typing import get_args

import numpy as np
import pytest
from ompl import base as ob
from ompl import geometric as og

import planners
from cspace import InputError
from planners._catalogue import PlannerName, find_planner, planner_named, planner_names
from planners._ompl.search import make_planner
from planners._ompl.states import find_state_kind
from tests.helpers.drives import WORDS, make_drive
from tests.helpers.missing import output_without
from tests.helpers.planning import (
    ENDPOINTS,
    SPACES,
    bounds_of,
    build_room,
    draw_around,
    draw_edges,
    make_state,
)
from tests.helpers.refusals import check_refused, refusals

STATE_SPACES = {
    "plane": ob.RealVectorStateSpace,
    "turning": ob.SE2StateSpace,
    "space": ob.RealVectorStateSpace,
    "yawing": ob.CompoundStateSpace,
    "floating": ob.SE3StateSpace,
}


@pytest.mark.parametrize("name", SPACES)
def test_states_and_motions_are_checked_as_by_the_map(name):
    space = build_room(name)
    queried = []

    class Mine(planners.StateValidityChecker):
        def isValid(self, state):  # noqa: N802 - OMPL's name
            queried.append(1)  # a class that holds states would never be freed
            return super().isValid(state)

    setup = planners.simple_setup(space)
    si = setup.getSpaceInformation()
    checker = Mine(si, space)
    setup.setStateValidityChecker(checker)
    q = draw_around(space, 1000, 0)
    states = [make_state(space, si, row) for row in q]
    assert [si.isValid(state) for state in states] == space.is_free(q).tolist()
    assert len(queried) == len(q) and 0.1 < space.is_free(q).mean() < 0.9
    assert [checker.clearance(state) for state in states] == space.clearance(q).tolist()
    starts, ends = draw_edges(space, 500, 1)
    edges = zip(starts, ends, strict=True)
    valid = [si.checkMotion(make_state(space, si, a), make_state(space, si, b)) for a, b in edges]
    assert valid == space.motion_is_free(starts, ends).tolist() and 0 < sum(valid) < 500
    # A plan replaces the answers at its time limit.
    free = make_state(space, si, starts[0])
    assert si.isValid(free) and si.checkMotion(free, free)
    checker.is_free = si.getMotionValidator().is_free = lambda *_: False
    assert not si.isValid(free) and not si.checkMotion(free, free)


# ---- names and choices ---------------------------------------------------------------------------


def test_every_constructible_geometric_planner_is_listed_in_any_case():
    setup = planners.simple_setup(build_room("plane"))
    si = setup.getSpaceInformation()
    listed = planner_names()
    made = set()
    for name in dir(og):
        try:
            thing = getattr(og, name)(si)
        except TypeError:
            continue
        if isinstance(thing, ob.Planner):
            made.add(name)
            thing.setProblemDefinition(setup.getProblemDefinition())
            thing.setup()  # freeing an AORRTC without a setup crashes the process
    assert set(listed) == made - {"AORRTC", "BFMT", "PRM", "PRMstar"} and len(made) >= 14
    for name in listed:
        assert planner_named(name.lower()) == planner_named(name.upper()) == name
        assert type(make_planner(name, si)) is getattr(og, name)


@pytest.mark.parametrize("name", SPACES)
def test_choices_lists_planners_and_drives_of_a_map(name):
    space = build_room(name)
    choices = planners.choices(space)
    searches = ("Grid", "Lattice")[: 2 if name == "turning" else 1]
    assert choices.planners == (*planner_names(), *searches)
    assert choices.drives == ((planners.Differential, planners.Car) if name == "turning" else ())
    for word in WORDS if choices.drives else ():
        assert planners.state_space(space, drive=make_drive(word)) is not None


@pytest.mark.parametrize("name", get_args(PlannerName))
def test_a_planner_refuses_options_outside_its_skills(name):
    if name not in planners.choices(space := build_room("turning")).planners:
        pytest.skip("for arms")
    words = {
        "None": "holonomic",
        "Differential": "differential",
        "Car": "dubins",
        "Car(reverse=True)": "reeds-shepp",
    }
    for drive, word in words.items():
        for objective in ("length", "clearance", len):
            options = {"drive": make_drive(word), "objective": objective, "planner": name}
            taken = find_planner(name).list_taken()
            kind = "a function" if callable(objective) else objective
            if drive in taken["drive"] and kind in taken["objective"]:
                continue
            with pytest.raises(InputError, match=f"planner is '{name}'; {name} takes") as caught:
                planners.plan(space, *ENDPOINTS["turning"], **options)
            assert caught.value.argument == ("objective" if drive in taken["drive"] else "drive")


@pytest.mark.thorough
def test_only_planners_of_ompl_require_it():
    output = output_without(
        "ompl",
        """
workspace = cspace.Workspace.from_array(np.zeros((9, 9), dtype=bool), 0.1)
space = cspace.build(workspace, cspace.Robot.disc(0.05))
assert space.explain((0.3, 0.3), (0.6, 0.6)).verdict == "connected"
import planners
assert planners.plan(space, (0.3, 0.3), (0.6, 0.6), seed=1).certified
turning = cspace.build(workspace, cspace.Robot.rectangle(0.1, 0.05), rotations=8)
for drive in (None, planners.Differential(), planners.Car(0.1, reverse=True)):
    assert planners.plan(turning, (0.3, 0.3, 0.0), (0.6, 0.6, 0.0), drive=drive).certified
try:
    planners.plan(space, (0.3, 0.3), (0.6, 0.6), planner="RRTConnect")
except cspace.MissingPackageError as error:
    print(error)
""",
    )
    assert output.startswith("ompl cannot be imported (")
    assert "wheels for Python 3.11 to 3.13 on Linux and macOS" in output


# ---- states --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPACES)
def test_states_hold_configurations_and_a_radian_counts_as_half_a_metre(name):
    space = build_room(name)
    setup = planners.simple_setup(space)
    states = setup.getStateSpace()
    si = setup.getSpaceInformation()
    assert isinstance(states, STATE_SPACES[name]) and str(setup)  # OMPL alone crashes here
    assert bounds_of(states) == [*space.grid.lower, *space.grid.upper]
    rows = draw_around(space, 100, 0)
    made = [make_state(space, si, q) for q in rows]
    for q, state in zip(rows, made, strict=True):
        assert find_state_kind(space).read(state) == tuple(q)
        assert states.satisfiesBounds(state) == space.grid.contains(q[: space.grid.dim])
        assert states.distance(made[0], state) == pytest.approx(space.distance(rows[0], q))


@refusals(
    "settings, message",
    (
        {"name": "Grid", "iterations": 9},
        "iterations is 9 and name is 'Grid'",
    ),
    ({"name": "lattice", "iterations": 9}, "iterations is 9 and name is 'Lattice'"),
    ({"iterations": 0}, "iterations is 0"),
    ({"simplify": "no"}, "simplify is 'no' ... True or False"),
    ({"name": "RTT*"}, "BiRRT; did you mean 'RRTstar'?"),
    ({"name": "PRM"}, "planner is 'PRM' ... BITstar, "),
    ({"name": "BITstar", "range": 1.0}, "range is 1.0 and name is 'BITstar'"),
    ({"name": "Grid", "range": 1.0}, "range is 1.0 and name is 'Grid'"),
    ({"range": 1.0}, "range is 1.0 and name is None ... planner"),
    ({"name": "RRT", "range": -1.0}, "range is -1.0"),
)
def test_wrong_settings_of_a_search_are_refused_when_it_is_made(settings, message):
    check_refused(lambda: planners.Search(**settings), message)


@pytest.mark.parametrize("name", ["RRT", "rrtconnect"])
def test_no_edge_of_a_tree_is_longer_than_its_range(name):
    space = build_room("plane")
    search = planners.Search(name, simplify=False, range=0.2)
    plan = planners.plan(space, *ENDPOINTS["plane"], planner=search, seed=1)
    steps = np.linalg.norm(np.diff(plan.waypoints, axis=0), axis=1)
    assert plan.certified and len(steps) > 5 and steps.max() <= 0.2 + 1e-9
