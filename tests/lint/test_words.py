"""Words that arguments take: type checkers and the library accept the same ones.

``mypy`` checks this file, and fails on an ignored line that has no error, that is on a wrong word
that it accepts.
"""

import ast
from collections.abc import Iterator
from typing import get_args

import pytest

import cspace
import planners
from cspace._cli.planning import DriveName
from cspace._engines import ENGINES, METHODS
from cspace._record.exterior import OUTSIDES
from cspace._support.words import Method, Outside
from planners._catalogue import MODULES, PlannerName
from tests.helpers.drives import WORDS
from tests.helpers.handmade import build_empty
from tests.helpers.repository import SOURCES

TYPES = {"drive": "DriveName", "planner": "PlannerName", "method": "Method", "outside": "Outside"}
"""Types of arguments, by name."""

START, GOAL = (0.5, 0.5, 0.0), (1.5, 0.5, 0.0)


@pytest.fixture(scope="module")
def space() -> cspace.CSpace:
    return build_empty((20, 10), cspace.Robot.rectangle(0.2, 0.1), rotations=8)


def test_the_types_list_the_words_that_the_library_accepts() -> None:
    assert set(get_args(Method)) == {*ENGINES, "auto"} == set(METHODS)
    assert get_args(Outside) == OUTSIDES
    assert get_args(DriveName) == WORDS
    assert set(get_args(PlannerName)) == {*MODULES, *cspace.ArmSpace.searches}


def list_text_arguments(module: str) -> Iterator[str]:
    """Yield arguments with a name in ``TYPES`` that accept any text."""
    for node in ast.walk(ast.parse(SOURCES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.arg | ast.AnnAssign) and node.annotation is not None:
            name = node.arg if isinstance(node, ast.arg) else ast.unparse(node.target)
            if name in TYPES and "str" in ast.unparse(node.annotation).split(" | "):
                yield f"{module}: {name}"


def test_no_signature_takes_any_text_for_such_a_word() -> None:
    modules = [
        name
        for name in SOURCES
        if name.startswith(("planners.", "cspace._builder", "cspace._cli.maps"))
    ]
    assert len(modules) > 10
    assert [found for module in modules for found in list_text_arguments(module)] == []


def test_wrong_words_of_a_build_are_refused(space: cspace.CSpace) -> None:
    with pytest.raises(cspace.InputError, match="method is 'fastest'"):
        cspace.build(space.workspace, space.robot, method="fastest")  # type: ignore[call-overload]
    with pytest.raises(cspace.InputError, match="outside is 'unknown'"):
        cspace.build(space.workspace, space.robot, outside="unknown")  # type: ignore[call-overload]


def test_wrong_words_of_a_plan_are_refused(space: cspace.CSpace) -> None:
    with pytest.raises(cspace.InputError, match="planner is 'RRT Connect'"):
        planners.plan(space, START, GOAL, planner="RRT Connect")  # type: ignore[arg-type]
    with pytest.raises(cspace.InputError, match="drive is 'sideways'"):
        planners.plan(space, START, GOAL, drive="sideways")  # type: ignore[arg-type]


def test_wrong_drives_of_parts_for_ompl_are_refused(space: cspace.CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    for make in (
        lambda: planners.state_space(space, drive="sideways"),  # type: ignore[arg-type]
        lambda: planners.simple_setup(space, drive="sideways"),  # type: ignore[arg-type]
        lambda: planners.MotionValidator(si, space, drive="sideways"),  # type: ignore[arg-type]
    ):
        with pytest.raises(cspace.InputError, match="drive is 'sideways'"):
            make()


def test_names_of_the_library_pass_type_checks(space: cspace.CSpace) -> None:
    options = planners.choices(space)
    plan = planners.plan(
        space, START, GOAL, planner=options.planners[-1], drive=planners.Differential()
    )
    assert planners.plan(space, START, GOAL, planner=plan.planner, drive=plan.drive).certified
