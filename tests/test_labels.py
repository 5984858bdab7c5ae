"""Each public call hears labels of its numbers, in any order and type, or refuses them."""

import inspect
from collections import namedtuple
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import cspace
import planners
from cspace import CspaceError, Robot, Workspace
from cspace.arms import ArmSpace, JointMap, build_arm_space, build_joint_map
from planners import Trajectory
from tests.helpers.urdfs import planar_arm, posed_box

ROWS = {
    **dict.fromkeys(("q", "q0", "start", "before", "around"), (0.5, 0.75, 0.25)),
    **dict.fromkeys(("q1", "goal"), (0.75, 0.5, 0.125)),
    **dict.fromkeys(("tracking", "max_velocity", "max_acceleration"), (0.5, 0.25, 0.125)),
    **dict.fromkeys(("position", "lower", "point"), (0.5, 0.75)),
    "upper": (1.0, 1.25),
    "twist": (0.125, 0.25),
    "max_deceleration": (0.5, 0.25),
}
"""One row of numbers for each name of such an argument; calls take as many as there are axes."""

TABLES = {
    **{name: [(0.5, 0.75, 0.25), (0.75, 0.5, 0.125)] for name in ("path", "rows", "via")},
    "twists": [(0.125, 0.25), (0.25, 0.125)],
    "points": [(0.5, 0.75), (1.0, 0.25)],
}
"""Rows of numbers for each name of such an argument."""

OTHERS = {
    "dt": 0.125,
    "distance": 0.0625,
    "max_acceleration": 1.0,
    "t": 0.5,
    "name": "q",
    "seed": 0,
}
"""Further arguments that calls need."""

FILES = {"export", "save", "open", "to_csv"}
"""Calls whose ``path`` is that of a file."""

ELSEWHERE = {
    "CSpace.free_regions around": "dear: tests/regions/test_cover.py",
    "CSpace.sort_goals start": "called by plan",
    "CSpace.view path": "opens a page: tests/view",
    "CSpace.view start": "opens a page: tests/view",
    "CSpace.view goal": "opens a page: tests/view",
    "ArmSpace.attach q": "changes the arm: tests/arms/test_obstacles.py",
    "ArmSpace.detach q": "changes the arm: tests/arms/test_obstacles.py",
    "ArmSpace.follow_line q0": "takes poses: tests/arms/test_lines.py",
    "ArmSpace.plot q": "draws: tests/plot",
    "ArmSpace.plot path": "draws: tests/plot",
    "CSpace.update lower": "takes cells: tests/test_arguments.py",
    "Grid.__init__ lower": "tests/test_arguments.py",
}
"""Arguments that other tests pass in all forms."""


@cache
def owners(folder):
    """Build one small object of each class, by the name of the class."""
    cells = np.zeros((12, 12), dtype=bool)
    cells[8, 8:] = True
    workspace = Workspace.from_array(cells, 0.25)
    robot = Robot.rectangle(0.25, 0.125)
    turning = cspace.build(workspace, robot, rotations=8, counts=True)
    arm = build_arm_space({"post": posed_box((0.25, 0.25, 2.0), -1.0, 0.5)}, planar_arm())
    gate = cspace.Gate(turning, dt=0.125, max_deceleration=1.0)
    return {
        "CSpace": turning,
        "TiledCSpace": cspace.build(workspace, robot, rotations=8, store=folder / "store", tile=6),
        "JointMap": build_joint_map(arm, 0.5),
        "ArmSpace": arm,
        "Gate": gate,
        "Grid": turning.grid,
        "Trajectory": Trajectory,
        "planners": SimpleNamespace(**{name: getattr(planners, name) for name in planners.__all__}),
    }


def list_calls():
    """List public calls with an argument of these names, as class, call and argument."""
    calls = []
    seen = set()
    classes = cspace.CSpace, cspace.TiledCSpace, JointMap, ArmSpace, cspace.Gate, cspace.Grid
    for owner in (*classes, Trajectory, planners):
        for name in sorted(planners.__all__ if owner is planners else dir(owner)):
            call = getattr(owner, name)
            is_made = owner is planners and isinstance(call, type)
            if is_made or not callable(call) or (name.startswith("_") and name != "__init__"):
                continue
            function = getattr(call, "__func__", call)
            if function in seen:  # inherited
                continue
            seen.add(function)
            label = f"{owner.__name__.rpartition('.')[2]}.{name}"
            for argument in inspect.signature(call).parameters:
                is_file = argument == "path" and name in FILES
                if (argument in ROWS or argument in TABLES) and not is_file:
                    calls.append((label, argument))
    return [(*label.split("."), argument) for label, argument in calls]


CALLS = [call for call in list_calls() if f"{call[0]}.{call[1]} {call[2]}" not in ELSEWHERE]


def vary(numbers, labels):
    """Yield the same numbers in other types, with their labels in another order."""
    rows = np.array(numbers, dtype=np.float64)
    back = labels[::-1]
    named = namedtuple("Named", back)
    kinds = np.dtype([(label, "<f8") for label in back])
    yield "array", rows
    yield "masked", np.ma.array(rows)
    yield "float32", rows.astype(np.float32)
    yield "Fortran order", np.asfortranarray(rows)
    yield "strided", np.repeat(rows, 2, axis=-1)[..., ::2]
    dims = ("row", "axis")[-rows.ndim :]
    yield "DataArray", xr.DataArray(rows[..., ::-1], dims=dims, coords={"axis": list(back)})
    fields = [tuple(row) for row in np.atleast_2d(rows[..., ::-1])]
    yield "structured", np.array(fields if rows.ndim > 1 else fields[0], dtype=kinds)
    if rows.ndim > 1:
        yield "DataFrame", pd.DataFrame(rows[:, ::-1], columns=back)
        yield "named tuples", [named(*row) for row in fields]
        yield "Series", [pd.Series(row, back) for row in fields]
    else:
        yield "list", list(numbers)
        yield "named tuple", named(*fields[0])
        yield "Series", pd.Series(fields[0], back)


def plain(answer):
    """Return an answer as text that is equal for equal answers."""
    if isinstance(answer, np.ndarray | np.generic):
        return str(answer.tolist())
    if isinstance(answer, tuple | list) and not hasattr(answer, "_fields"):
        return str([plain(entry) for entry in answer])
    for name in ("waypoints", "positions", "b", "chunk", "proven", "verdict", "lower"):
        if hasattr(answer, name):
            return plain(getattr(answer, name))
    return repr(answer)


def ask(call, arguments):
    """Return the answer of a call as text, or that it is refused."""
    try:
        return plain(call(**arguments))
    except CspaceError as error:
        return f"refused: {type(error).__name__}"


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    return owners(tmp_path_factory.mktemp("doors"))


@pytest.mark.parametrize("owner, name, argument", CALLS)
def test_numbers_with_labels_in_any_order_have_one_answer(objects, owner, name, argument):
    call = cspace.Gate if name == "__init__" else getattr(objects[owner], name)
    if name == "check_rows":  # a gate with dt needs speeds of all axes for rows
        call = cspace.Gate(objects["CSpace"]).check_rows
    others = {"Gate": "CSpace", "planners": "CSpace", "Trajectory": "ArmSpace"}
    space = objects[others.get(owner, owner)]
    names = dict.fromkeys(("twist", "twists", "max_deceleration"), ("v", "omega"))
    if name in ("check_twists", "certify_twists"):
        names["before"] = names["max_velocity"] = names["twist"]
    given = {**ROWS, **TABLES, **OTHERS, argument: {**ROWS, **TABLES}[argument], "space": space}
    arguments = {}
    for each, parameter in inspect.signature(call).parameters.items():
        is_timed = each == "dt" and argument == "max_velocity"
        if each == argument or is_timed or parameter.default is parameter.empty:
            values = given[each]
            size = len(names.get(each, space.axes))
            if isinstance(values, list):
                values = [row[:size] for row in values]
            elif isinstance(values, tuple):
                values = values[:size]
            arguments[each] = values
    numbers = arguments[argument]
    size = len(numbers[0]) if argument in TABLES else len(numbers)
    labels = names.get(argument, tuple(space.axes))[:size]
    expected = ask(call, arguments)
    assert not expected.startswith("refused"), expected
    for kind, values in vary(numbers, labels):
        found = ask(call, {**arguments, argument: values})
        assert found in (expected, "refused: InputError"), kind
