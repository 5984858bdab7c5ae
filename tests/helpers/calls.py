"""Public calls that take rows of numbers by name, their arguments, and objects to call them on."""

import inspect
from functools import cache
from types import SimpleNamespace

import numpy as np

import cspace
import planners
from cspace import Robot, Workspace
from cspace.arms import ArmSpace, build_arm_space
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
def make_objects(folder):
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
        "ArmSpace": arm,
        "Gate": gate,
        "Grid": turning.grid,
        "Trajectory": Trajectory,
        "planners": SimpleNamespace(**{name: getattr(planners, name) for name in planners.__all__}),
    }


def list_calls():
    """List public calls with an argument of these names, as class, call and argument."""
    seen = set()
    classes = cspace.CSpace, cspace.TiledCSpace, ArmSpace, cspace.Gate, cspace.Grid
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
            label = owner.__name__.rpartition(".")[2]
            for argument in inspect.signature(call).parameters:
                is_file = argument == "path" and name in FILES
                is_elsewhere = f"{label}.{name} {argument}" in ELSEWHERE
                if argument in {**ROWS, **TABLES} and not (is_file or is_elsewhere):
                    yield label, name, argument


CALLS = list(list_calls())
"""Public calls with such an argument, as class, call and argument."""

UNCHECKED = {
    *("distance", "interpolate", "steps_between"),  # NaN stays NaN
    *("find_goals", "plot"),  # called by plan; without a mark by default
}
CONFIGURED = [
    call
    for call in CALLS
    if call[0] in ("CSpace", "Gate", "planners")
    and call[1] not in UNCHECKED
    and call[2] in ("q", "q0", "q1", "start", "goal", "path")
]
"""Calls that take a configuration of a map with x, y and yaw, or a path of these."""


def prepare(objects, owner, name, argument):
    """Return a call, its arguments, and the labels of the numbers of one of these."""
    call = cspace.Gate if name == "__init__" else getattr(objects[owner], name)
    if name == "check_rows":  # a gate with dt needs speeds of all axes for rows
        call = cspace.Gate(objects["CSpace"]).check_rows
    others = {"Gate": "CSpace", "planners": "CSpace", "Trajectory": "ArmSpace"}
    space = objects[others.get(owner, owner)]
    names = dict.fromkeys(("twist", "twists", "max_deceleration"), ("v", "omega"))
    if name == "check_twists":
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
    return call, arguments, labels
