"""Setups of OMPL: states, checkers, planner names, choices, refused options and memory."""

import gc
import math
from typing import Any

import numpy as np
import pytest
from ompl import base as ob
from ompl import geometric as og

import planners
from cspace import CSpace, InputError, Robot, Workspace, build
from planners.catalogue import BIDIRECTIONAL_PLANNERS, make_planner, planner_named
from planners.local_planner import CURVES, DRIVES
from planners.states import find_state_kind
from tests.helpers.handmade import fill_boxes
from tests.helpers.missing import output_without
from tests.helpers.planning import (
    SPACES,
    bounds_of,
    build_room,
    draw_around,
    draw_edges,
    make_state,
    options_for,
)
from tests.helpers.refusals import refusals

STATE_SPACES = {
    "plane": ob.RealVectorStateSpace,
    "turning": ob.SE2StateSpace,
    "space": ob.RealVectorStateSpace,
    "yawing": ob.CompoundStateSpace,
    "floating": ob.SE3StateSpace,
}


@pytest.mark.parametrize("name", SPACES)
def test_states_hold_configurations_and_a_radian_counts_as_half_a_metre(name: str) -> None:
    space = build_room(name)
    setup = planners.simple_setup(space)
    states = setup.getStateSpace()
    si = setup.getSpaceInformation()
    assert isinstance(states, STATE_SPACES[name]) and str(setup)  # OMPL alone crashes here
    assert bounds_of(states) == [*space.grid.lower, *space.grid.upper]
    for q in draw_around(space, 100, 0):
        state = make_state(space, si, q)
        assert find_state_kind(space).read(state) == tuple(q)
        assert states.satisfiesBounds(state) == space.grid.contains(q[: space.grid.dim])
    turns = {1: ((0.0,), (0.4,)), 4: ((0, 0, 0, 1), (0, math.sin(0.2), 0, math.cos(0.2)))}
    first, last = turns.get(space.size - space.grid.dim, ((), ()))
    ends = [[1.0] * space.grid.dim, [1.5] + [1.0] * (space.grid.dim - 1)]
    distance = states.distance(
        make_state(space, si, [*ends[0], *first]), make_state(space, si, [*ends[1], *last])
    )
    assert distance == pytest.approx(0.5 + (0.2 if last else 0.0))


@pytest.mark.parametrize("name", SPACES)
def test_states_and_motions_are_checked_as_by_the_map(name: str) -> None:
    space = build_room(name)
    queried = []

    class Mine(planners.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            queried.append(state)
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


def test_a_thin_wall_is_not_stepped_over_as_by_ompl_alone() -> None:
    space = build(Workspace.from_array(fill_boxes((400, 8), np.s_[200]), 0.1), Robot.disc(0.01))
    ours = planners.simple_setup(space).getSpaceInformation()
    ours.setup()
    assert ours.getStateSpace().getLongestValidSegmentLength() == pytest.approx(0.05)
    bare = ob.SpaceInformation(planners.state_space(space))
    bare.setStateValidityChecker(planners.StateValidityChecker(bare, space))
    bare.setup()
    crossings = np.arange(0.3, 2.0, 0.13)
    for info, may_cross in ((bare, True), (ours, False)):
        crosses = [
            info.checkMotion(
                make_state(space, info, (20.05 - before, 0.4)),
                make_state(space, info, (20.05 + after, 0.4)),
            )
            for before in crossings
            for after in crossings
        ]
        assert any(crosses) == may_cross


@refusals(
    "wrong, message",
    ({"valid_state_sampler": lambda si: 3}, "must return an ompl.base.ValidStateSampler"),
    ({"valid_state_sampler": ob.ObstacleBasedValidStateSampler}, "last valid state.*leave it out"),
    ({"objective": lambda si: 3}, "must return an ompl.base.OptimizationObjective"),
    ({"rng": np.random.RandomState(0)}, "rng is .*numpy"),
    (
        {"rng": np.random.default_rng(0), "valid_state_sampler": ob.UniformValidStateSampler},
        "rng is given and valid_state_sampler is given",
    ),
    ({"rng": np.random.default_rng(0), "exact": True}, "rng is given and exact is True"),
    ({"drive": "dubins", "turning_radius": 1.0}, "are .x, y.;.*rotations=72"),
)
def test_incompatible_options_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        planners.simple_setup(build_room("plane"), **wrong)


def test_no_object_of_ours_outlives_its_setup() -> None:
    ours: set[type] = set()
    kinds: list[type] = [
        planners.MotionValidator,
        planners.StateValidityChecker,
        planners.FreeStateSampler,
        planners.WeightedLength,
    ]
    while kinds:
        ours.add(kind := kinds.pop())
        kinds += kind.__subclasses__()

    def count() -> int:
        gc.collect()
        return sum(type(thing) in ours for thing in gc.get_objects())

    def make_setups() -> list[Any]:
        made = []
        for space in map(build_room, SPACES):
            setup = planners.simple_setup(
                space, objective=lambda si, space=space: planners.ClearanceObjective(si, space)
            )
            made.append((setup, setup.getSpaceInformation().allocValidStateSampler()))
        return made

    gc.freeze()  # skips objects of other tests
    alive = make_setups()
    assert count() >= 4 * len(SPACES)
    make_setups()
    del alive
    assert count() == 0


# ---- names and choices ---------------------------------------------------------------------------


def test_every_constructible_geometric_planner_is_listed_in_any_case() -> None:
    setup = planners.simple_setup(build_room("plane"))
    si = setup.getSpaceInformation()
    listed = planners.planner_names()
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
    assert set(listed) == made - {"AORRTC"} and len(made) >= 14
    for name in listed:
        assert planner_named(name.lower()) == planner_named(name.upper()) == name
        assert type(make_planner(name, si)) is getattr(og, name)


@pytest.mark.parametrize("name", SPACES)
def test_choices_lists_planners_and_drives_of_a_map(name: str) -> None:
    space = build_room(name)
    choices = planners.choices(space)
    searches = ("Grid", "MaxClearance", "Lattice")[: 3 if name == "turning" else 2]
    assert choices.planners == (*planners.planner_names(), *searches)
    assert choices.drives == (DRIVES if name == "turning" else ("holonomic",))
    for drive in choices.drives:
        radius = 0.4 if drive in choices.curves else None
        assert planners.state_space(space, drive=drive, turning_radius=radius) is not None


def test_fmt_starts_with_fewer_samples_along_curves() -> None:
    # A step of FMT computes distances between most samples without a check of the time.
    for drive in DRIVES:
        setup = planners.simple_setup(
            build_room("turning"), **{"drive": drive, **options_for(drive)}
        )
        planner = make_planner("FMT", setup.getSpaceInformation())
        assert planner.getNumSamples() == (1000 if drive == "holonomic" else 300)


@refusals(
    "drive, name, message",
    ("holonomic", "RRTConect", "did you mean RRTConnect.*KPIECE1"),
    ("holonomic", "bit*", "did you mean BITstar"),
    ("holonomic", 3, "planner is 3; it must be a geometric planner .*Grid, MaxClearance"),
    # OMPL's AORRTC reads beyond a list if paths are long, which is unpredictable.
    ("holonomic", "aorrtc", "planner is 'AORRTC'; AORRTC of OMPL .*ends the"),
    *[
        ("dubins", name, f"planner is '{name}' and drive is 'dubins'.*RRT")
        for name in sorted(BIDIRECTIONAL_PLANNERS)
    ],
)
def test_planners_unfit_for_a_drive_are_refused(drive: str, name: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        planner_named(name, drive)


def test_only_planners_requires_ompl() -> None:
    output = output_without(
        "ompl",
        """
space = cspace.build(cspace.Workspace.from_array(np.zeros((9, 9), dtype=bool), 0.1), cspace.Robot.disc(0.05))
assert space.is_free((0.45, 0.45))
try:
    import planners
except cspace.MissingPackageError as error:
    print(error)
""",
    )
    assert "pip install ompl" in output


# ---- tiny spaces ---------------------------------------------------------------------------------


def build_tiny_room(metres: float) -> tuple[CSpace, Any, Any]:
    """Build 60 x 40 cells with a wall, for a robot that turns; return start and goal, too."""
    workspace = Workspace.from_array(fill_boxes((60, 40), np.s_[28:31, :26]), metres)
    space = build(workspace, Robot.rectangle(6 * metres, 3 * metres), rotations=24)
    return space, (8 * metres, 8 * metres, 0.0), (50 * metres, 8 * metres, 2.0)


def test_planners_of_ompl_plan_in_nanometres_but_not_in_picometres() -> None:
    space, *query = build_tiny_room(1e-9)
    for drive in ("holonomic", "reeds-shepp"):
        radius = {"turning_radius": 4e-9} if drive in CURVES else {}
        options = {"planner": "RRTConnect", "time_limit": 20.0, "seed": 1, "drive": drive}
        assert planners.plan(space, *query, **options, **radius).certified
    space, *query = build_tiny_room(1e-12)
    message = r"space spans 7.21e-11 m; OMPL's planners need at least 2.2e-10 m; use a larger unit"
    for refuse in (
        lambda: planners.plan(space, *query, planner="RRTConnect"),
        lambda: planners.simple_setup(space),
    ):
        with pytest.raises(InputError, match=message):
            refuse()
    assert planners.plan(space, *query, time_limit=20.0).certified


@pytest.mark.parametrize(("metres", "takes_over"), [(1e-9, True), (1e-12, False)])
def test_ompl_takes_over_from_the_lattice_unless_the_space_is_too_small(
    metres: float, takes_over: bool
) -> None:
    # A robot too long to turn cannot drive to its side, so Lattice fails.
    hall = Workspace.from_array(fill_boxes((60, 16)), metres)
    space = build(hall, Robot.rectangle(40 * metres, 3 * metres), rotations=24)
    ends = (30 * metres, 6 * metres, 0.0), (30 * metres, 10 * metres, 0.0)
    plan = planners.plan(space, *ends, drive="differential", time_limit=0.5)
    assert not plan.solved and "; the lattice of 16 headings has no path; " in plan.status
    assert plan.status.startswith("no path found within 0.5 s") == takes_over
