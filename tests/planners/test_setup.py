"""Setups: planner names, choices, refused options and memory."""

import gc
from typing import Any

import numpy as np
import pytest
from ompl import base as ob
from ompl import geometric as og

import planners
from cspace import BLOCKED, FREE, CSpace, InputError, Robot, Workspace, build
from planners.catalogue import BIDIRECTIONAL_PLANNERS, make_planner, planner_named
from planners.local_planner import CURVES, DRIVES
from tests.helpers.handmade import fill_boxes
from tests.helpers.missing import output_without
from tests.helpers.planning import CAR_OPTIONS, SPACES, build_from_states, build_room
from tests.helpers.refusals import refusals


def test_the_sampler_that_needs_the_last_valid_state_is_refused() -> None:
    for make in (
        ob.ObstacleBasedValidStateSampler,
        lambda si: ob.ObstacleBasedValidStateSampler(si),
    ):
        with pytest.raises(
            InputError, match=r"ObstacleBasedValidStateSampler.*last valid state.*leave it out"
        ):
            planners.simple_setup(build_room("plane"), valid_state_sampler=make)


def test_another_sampler_is_used() -> None:
    si = planners.simple_setup(
        build_room("plane"), valid_state_sampler=ob.UniformValidStateSampler
    ).getSpaceInformation()
    sampler, state = si.allocValidStateSampler(), si.allocState()
    assert isinstance(sampler, ob.UniformValidStateSampler)
    assert all(sampler.sample(state) and si.isValid(state) for _ in range(50))


@refusals(
    "wrong, message",
    ({"valid_state_sampler": lambda si: 3}, "must return an ompl.base.ValidStateSampler"),
    ({"objective": lambda si: 3}, "must return an ompl.base.OptimizationObjective"),
    (
        {"rng": np.random.default_rng(0), "valid_state_sampler": ob.UniformValidStateSampler},
        "rng is given and valid_state_sampler is given",
    ),
    ({"rng": np.random.default_rng(0), "exact": True}, "rng is given and exact is True"),
)
def test_incompatible_options_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        planners.simple_setup(build_room("plane"), **wrong)


@pytest.mark.parametrize("name", SPACES)
def test_a_setup_prints_itself(name: str) -> None:
    # OMPL alone crashes if a space is compound.
    assert str(planners.simple_setup(build_room(name)))


def test_no_object_of_ours_outlives_its_setup() -> None:
    ours: set[type] = set()
    kinds: list[type] = [
        planners.MotionValidator,
        planners.StateValidityChecker,
        planners.FreeStateSampler,
    ]
    kinds.append(planners.WeightedLength)
    while kinds:
        ours.add(kind := kinds.pop())
        kinds += kind.__subclasses__()

    def count() -> int:
        gc.collect()
        return sum(type(thing) in ours for thing in gc.get_objects())

    def setups() -> list[Any]:
        made = []
        for space in map(build_room, SPACES):
            setup = planners.simple_setup(
                space, objective=lambda si, space=space: planners.ClearanceObjective(si, space)
            )
            made.append((setup, setup.getSpaceInformation().allocValidStateSampler()))
        return made

    gc.freeze()  # skips objects of other tests
    alive = setups()
    assert count() >= 4 * len(SPACES)
    setups()
    del alive
    assert count() == 0


def test_every_constructible_geometric_planner_is_listed() -> None:
    setup, made = planners.simple_setup(build_room("plane")), set()
    for name in dir(og):
        try:
            thing = getattr(og, name)(setup.getSpaceInformation())
        except TypeError:
            continue
        if isinstance(thing, ob.Planner):
            made.add(name)
            thing.setProblemDefinition(setup.getProblemDefinition())
            thing.setup()  # freeing an AORRTC without a setup crashes the process
    assert set(planners.planner_names()) == made - {"AORRTC"}
    assert len(made) >= 14 and {"RRTConnect", "PRMstar", "BITstar", "KPIECE1"} <= made


@pytest.mark.parametrize("name", SPACES)
def test_choices_lists_planners_and_drives_of_a_map(name: str) -> None:
    space = build_room(name)
    choices = planners.choices(space)
    searches = ("Grid", "MaxClearance", *["Lattice"] * (name == "turning"))
    assert choices.planners == (*planners.planner_names(), *searches)
    assert choices.drives == (DRIVES if name == "turning" else ("holonomic",))
    for drive in choices.drives:
        radius = 0.4 if drive in choices.curves else None
        assert planners.state_space(space, drive=drive, turning_radius=radius) is not None
    with pytest.raises(InputError, match=r"space is a Grid; it must be a cspace\.Space"):
        planners.choices(space.grid)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", [*planners.planner_names(), "Grid"])
def test_planner_names_ignore_case(name: str) -> None:
    assert planner_named(name) == planner_named(name.lower()) == planner_named(name.upper()) == name
    if name != "Grid":
        setup = planners.simple_setup(build_room("plane"))
        planner = make_planner(name, setup.getSpaceInformation())
        assert type(planner) is getattr(og, name)
        planner.setProblemDefinition(setup.getProblemDefinition())
        planner.setup()


@pytest.mark.parametrize("drive", DRIVES)
def test_fmt_starts_with_fewer_samples_along_curves(drive: str) -> None:
    # A step of FMT computes distances between most samples without a check of the time.
    car = CAR_OPTIONS if drive in CURVES else {}
    si = planners.simple_setup(build_room("turning"), drive=drive, **car).getSpaceInformation()
    for name in ("FMT", "BFMT"):
        assert make_planner(name, si).getNumSamples() == (1000 if drive == "holonomic" else 300)


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        *[
            ("RRTConect", "RRTConnect"),
            ("bit*", "BITstar"),
            ("prm-star", "PRMstar"),
            ("gri", "Grid"),
        ],
        *[(wrong, None) for wrong in ("", "Planner", "SimpleSetup", 3)],
    ],
)
def test_an_unknown_planner_lists_the_names_and_suggests_one(wrong: Any, meant: str | None) -> None:
    with pytest.raises(InputError) as caught:
        planner_named(wrong)
    assert (meant is None or f"did you mean {meant}?" in str(caught.value)) and repr(wrong) in str(
        caught.value
    )
    assert all(name in str(caught.value) for name in planners.planner_names())
    assert (caught.value.argument, caught.value.value) == ("planner", wrong)


@refusals(
    "drive, name, message",
    # OMPL's AORRTC reads beyond a list if paths are long, which is unpredictable.
    *[(drive, "AORRTC", "planner is 'AORRTC'; AORRTC of OMPL .*ends the") for drive in DRIVES],
    *[
        ("dubins", name, rf"planner is '{name}' and drive is 'dubins'.*RRT")
        for name in sorted(BIDIRECTIONAL_PLANNERS)
    ],
)
def test_planners_unfit_for_a_drive_are_refused(drive: str, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        planner_named(name.lower(), drive)


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


def build_tiny_room(metres: float) -> tuple[CSpace, Any, Any]:
    """Build 60 x 40 cells of a side with a wall, for a robot that turns, and return start and goal."""
    workspace = Workspace.from_array(fill_boxes((60, 40), np.s_[28:31, :26]), metres)
    space = build(workspace, Robot.rectangle(6 * metres, 3 * metres), rotations=24)
    return space, (8 * metres, 8 * metres, 0.0), (50 * metres, 8 * metres, 2.0)


@pytest.mark.parametrize("drive", ["holonomic", "differential", "reeds-shepp"])
@pytest.mark.parametrize("planner", ["RRTConnect", "KPIECE1", "BITstar"])
def test_planners_of_ompl_plan_in_nanometres(planner: str, drive: str) -> None:
    space, *query = build_tiny_room(1e-9)
    radius = {"turning_radius": 4e-9} if drive == "reeds-shepp" else {}
    for limit in (
        0.2,
        20.0,
    ):  # anytime planners use all of it; a busy machine needs the longer limit
        plan = planners.plan(
            space, *query, planner=planner, drive=drive, time_limit=limit, seed=1, **radius
        )
        if plan.solved:
            break
    assert plan.certified and plan.planner == planner


def test_ompl_takes_over_in_nanometres() -> None:
    states = np.full((8, 20, 20), BLOCKED, dtype=np.uint8)
    states[0, 3:17, 3:17] = FREE  # Lattice finds no path, as the robot cannot turn
    space = build_from_states(states, 8, 1e-9)
    plan = planners.plan(
        space, (10.5e-9, 5.5e-9, 0.0), (10.5e-9, 14.5e-9, 0.0), drive="differential", time_limit=0.1
    )
    assert not plan.solved and plan.status.startswith(
        "no path found within 0.1 s; the lattice of 16 headings"
    )


def test_spaces_too_small_for_ompl_are_left_to_built_in_searches() -> None:
    space, *query = build_tiny_room(1e-12)
    message = r"space spans 7.21e-11 m; OMPL's planners need at least 2.2e-10 m; use a larger unit"
    for refuse in (
        lambda: planners.plan(space, *query, planner="RRTConnect"),
        lambda: planners.plan(space, *query, iterations=100),
        lambda: planners.state_space(space),
        lambda: planners.simple_setup(space),
    ):
        with pytest.raises(InputError, match=message):
            refuse()
    for planner in (None, "Grid", "MaxClearance"):
        assert planners.plan(space, *query, planner=planner, time_limit=20.0).certified
    # A robot too long to turn cannot drive to its side, so Lattice fails, and OMPL cannot take
    # over.
    hall = build(
        Workspace.from_array(fill_boxes((60, 16)), 1e-12),
        Robot.rectangle(40e-12, 3e-12),
        rotations=24,
    )
    plan = planners.plan(
        hall, (30e-12, 6e-12, 0.0), (30e-12, 10e-12, 0.0), drive="differential", time_limit=20.0
    )
    assert not plan.solved and plan.is_connected and plan.planner == "Lattice"
    assert "the lattice of 16 headings has no path; " in plan.status
