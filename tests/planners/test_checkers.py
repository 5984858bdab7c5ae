"""Checkers for OMPL: states, motions, subclasses and overrides."""

from typing import Any

import numpy as np
import pytest
from ompl import base as ob

import planners
from cspace import CSpace, InputError, Robot, Workspace, build
from tests.helpers.handmade import fill_boxes
from tests.helpers.planning import (
    CAR_OPTIONS,
    SPACES,
    bounds_of,
    build_room,
    draw_around,
    draw_edges,
    make_state,
)


@pytest.fixture(params=SPACES)
def space(request: pytest.FixtureRequest) -> CSpace:
    return build_room(request.param)


def test_state_checks_equal_map_queries(space: CSpace) -> None:
    setup = planners.simple_setup(space)
    si, checker = setup.getSpaceInformation(), setup.getStateValidityChecker()
    q = draw_around(space, 1500, 0)
    states = [make_state(space, si, each) for each in q]
    assert [si.isValid(state) for state in states] == space.is_free(q).tolist()
    assert 0.1 < space.is_free(q).mean() < 0.9
    assert [checker.clearance(state) for state in states] == space.clearance(q).tolist()
    assert bounds_of(setup.getStateSpace()) == [*space.grid.lower, *space.grid.upper]
    si.setup()
    if space.size == space.grid.dim:
        assert setup.getStateSpace().getLongestValidSegmentLength() == pytest.approx(
            space.grid.spacing / 2
        )


def test_motion_checks_equal_map_queries(space: CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    starts, ends = draw_edges(space, 800, 1)
    pairs = zip(starts, ends, strict=True)
    queried = [si.checkMotion(make_state(space, si, a), make_state(space, si, b)) for a, b in pairs]
    assert queried == space.motion_is_free(starts, ends).tolist()
    assert any(queried) and not all(queried)


def test_a_valid_motion_is_free_along_its_length(space: CSpace) -> None:
    si, states = (
        (setup := planners.simple_setup(space)).getSpaceInformation(),
        setup.getStateSpace(),
    )
    between, read, kinds = si.allocState(), planners.states.find_state_kind(space).read, set()
    for a, b in zip(*draw_edges(space, 150, 5), strict=True):
        first, second = make_state(space, si, a), make_state(space, si, b)
        valid = si.checkMotion(first, second)
        along = []
        for share in np.linspace(0.0, 1.0, 101).tolist():
            states.interpolate(first, second, share, between)
            along.append(read(between))
        assert not valid or space.is_free(along).all()
        kinds.add(valid)
    assert kinds == {True, False}


def test_checkers_can_be_subclassed(space: CSpace) -> None:
    queried = []

    class Mine(planners.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            queried.append(state)
            return super().isValid(state)

    setup = planners.simple_setup(space)
    si = setup.getSpaceInformation()
    setup.setStateValidityChecker(Mine(si, space))
    q = draw_around(space, 100, 2)
    assert [si.isValid(make_state(space, si, each)) for each in q] == space.is_free(q).tolist()
    assert len(queried) == len(q)


def test_a_thin_wall_is_not_stepped_over_as_by_ompl_alone() -> None:
    thin = build(Workspace.from_array(fill_boxes((400, 8), np.s_[200]), 0.1), Robot.disc(0.01))
    si = planners.simple_setup(thin).getSpaceInformation()
    bare = ob.SpaceInformation(planners.state_space(thin))
    bare.setStateValidityChecker(planners.StateValidityChecker(bare, thin))
    bare.setup()
    crossings = [
        ((20.05 - a, 0.4), (20.05 + b, 0.4))
        for a in np.arange(0.3, 2, 0.13)
        for b in np.arange(0.3, 2, 0.13)
    ]

    def crosses(info: Any) -> bool:
        return any(
            info.checkMotion(make_state(thin, info, a), make_state(thin, info, b))
            for a, b in crossings
        )

    assert crosses(bare) and not crosses(si)


def test_answers_can_be_replaced(space: CSpace) -> None:
    # A plan ends a search in this way at its time limit.
    setup = planners.simple_setup(space)
    si, checker = setup.getSpaceInformation(), setup.getStateValidityChecker()
    validator = si.getMotionValidator()
    free = make_state(space, si, space.sample_free(rng=np.random.default_rng(0)))
    for queried, answerer in (
        (lambda: si.isValid(free), checker),
        (lambda: si.checkMotion(free, free), validator),
    ):
        before, is_free = queried(), answerer.is_free
        answerer.is_free = lambda *_: False
        assert queried() is False
        answerer.is_free = is_free
        assert queried() == before is True


def test_curves_require_a_robot_that_rotates_in_the_plane() -> None:
    for name, message in (
        ("plane", "are .x, y.;.*rotations=72"),
        ("floating", "qx.*leave drive out"),
    ):
        space = build_room(name)
        si = planners.simple_setup(space).getSpaceInformation()
        options: dict[str, Any] = {"drive": "dubins", **CAR_OPTIONS}
        for make in (
            lambda space=space, options=options: planners.state_space(space, **options),
            lambda space=space, options=options: planners.simple_setup(space, **options),
            lambda space=space, options=options, si=si: planners.MotionValidator(
                si, space, **options
            ),
            lambda space=space, options=options, si=si: planners.ClearanceObjective(
                si, space, **options
            ),
        ):
            with pytest.raises(InputError, match=message):
                make()
