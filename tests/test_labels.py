"""Each public call hears labels of its numbers, in any order and type, or refuses them."""

import inspect
import math
from collections import namedtuple

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import cspace
import planners
from cspace import CspaceError, Robot
from cspace.arms import PosedShape
from cspace.lanes import Mover, RouteGraph
from cspace.spectral import Bump
from tests.helpers.calls import (
    CALLS,
    CONFIGURED,
    ELSEWHERE,
    FILES,
    ROWS,
    make_objects,
    prepare,
)
from tests.helpers.tables import Table, iterate_tables, make_row
from tests.helpers.urdfs import planar_arm
from tests.test_flags import list_functions

ROW = ROWS["q"]
WRONG = {
    "short": ROW[:2],
    "long": (*ROW, 0.0),
    "number": 0.6,
    "empty": (),
    "text": "0.6,0.6,0.3",
    "texts": tuple(map(str, ROW)),
    "None": None,
    "NaN": (0.6, np.nan, 0.3),
    "infinite": (np.inf, 0.6, 0.3),
    "NaN yaw": (0.6, 0.6, np.nan),
    "ragged": [ROW, ROW[:2]],
    "complex": (0.6 + 0j, 0.6, 0.3),
    "masked": np.ma.array(ROW, mask=(0, 1, 0)),
    "objects": (object(), 0.6, 0.3),
    "set": set(ROW),
    "column": np.array(ROW)[:, np.newaxis],
    "dates": np.array(["2020-01-01"] * 3, dtype="M8[D]"),
    "other labels": pd.Series(ROW, ["a", "b", "c"]),
    "large": (10**400, 0, 0),
}
"""What is no configuration of a map with x, y and yaw."""


def vary(numbers, labels):
    """Yield the same numbers in other types, with their labels in another order."""
    rows = np.array(numbers, dtype=np.float64)
    back = labels[::-1]
    named = namedtuple("Named", back)
    kinds = np.dtype([(label, "<f8") for label in back])
    yield "array", rows
    yield "masked", np.ma.array(rows)
    yield "objects", np.array(numbers, dtype=object)
    yield "big endian", rows.astype(">f8")
    yield "read-only", np.frombuffer(rows.tobytes()).reshape(rows.shape)
    yield "float32", rows.astype(np.float32)
    yield "Fortran order", np.asfortranarray(rows)
    yield "strided", np.repeat(rows, 2, axis=-1)[..., ::2]
    dims = ("row", "axis")[-rows.ndim :]
    yield "DataArray", xr.DataArray(rows[..., ::-1], dims=dims, coords={"axis": list(back)})
    fields = [tuple(row) for row in np.atleast_2d(rows[..., ::-1])]
    yield "structured", np.array(fields if rows.ndim > 1 else fields[0], dtype=kinds)
    if rows.ndim > 1:
        yield from iterate_tables(dict(zip(back, rows.T[::-1], strict=True)))
        yield "named tuples", [named(*row) for row in fields]
        yield "Series", [pd.Series(row, back) for row in fields]
    else:
        yield "list", list(numbers)
        yield "named tuple", named(*fields[0])
        yield "Series", pd.Series(fields[0], back)
        yield "row", make_row(dict(zip(back, rows[::-1, np.newaxis], strict=True)))


def plain(answer):
    """Return an answer as text that is equal for equal answers."""
    if isinstance(answer, np.ndarray | np.generic):
        return str(answer.tolist())
    if isinstance(answer, tuple | list) and not hasattr(answer, "_fields"):
        return str([plain(entry) for entry in answer])
    if isinstance(answer, str):
        return answer
    names = (
        *("waypoints", "positions", "yaws", "lanes", "b", "chunk", "commands", "proven", "verdict"),
        *("spec", "grid", "outer", "centers"),
    )
    return str([plain(getattr(answer, name)) for name in names if hasattr(answer, name)] or answer)


def ask(call, arguments):
    """Return the answer of a call as text, or that it is refused."""
    try:
        return plain(call(**arguments))
    except CspaceError as error:
        return f"refused: {type(error).__name__}"


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    return make_objects(tmp_path_factory.mktemp("doors"))


@pytest.mark.parametrize("owner, name, argument", CALLS)
def test_numbers_with_labels_in_any_order_have_one_answer(objects, owner, name, argument):
    call, arguments, labels = prepare(objects, owner, name, argument)
    expected = ask(call, arguments)
    assert not expected.startswith("refused"), expected
    for kind, values in vary(arguments[argument], labels):
        found = ask(call, {**arguments, argument: values})
        # Only arrays, and tables that convert to rows, list places on the way.
        may_be_refused = argument == "via" and kind == "astropy"
        assert found == expected or (may_be_refused and found.startswith("refused")), kind


@pytest.mark.parametrize("owner, name, argument", CONFIGURED)
def test_what_is_no_configuration_is_refused(objects, owner, name, argument):
    call, arguments, _ = prepare(objects, owner, name, argument)
    for kind, values in WRONG.items():
        wrong = [values, ROW] if argument == "path" else values
        with pytest.raises(CspaceError):
            print(kind, call(**{**arguments, argument: wrong}))


class Lengths(np.ndarray):
    """A column of a table that knows its unit, as of astropy."""

    unit = "mm"


@pytest.mark.parametrize("seed", range(4))
def test_tables_of_other_columns_or_units_are_refused(objects, seed):
    rng = np.random.default_rng(seed)
    space = objects["CSpace"]
    right = {axis: rng.uniform(0.25, 0.75, 2) for axis in rng.permutation(space.axes).tolist()}
    (kept, first), (_, second), (_, third) = right.items()
    wrong = [
        {"lon": first, "lat": second, "yaw": third},
        {**right, "speed": first},
        {kept: first, "b": second, "c": third},
    ]
    for columns in wrong:
        for kind, table in iterate_tables(columns):
            with pytest.raises(CspaceError):
                print(kind, space.is_free(table))
    in_millimetres = Table({**right, "x": first.view(Lengths)}, columns=list(right))
    # A table that lists no names, but finds columns by them, may have any order and others.
    for table in (in_millimetres, Table(right), Table(right, columns=["yaw"])):
        with pytest.raises(CspaceError):
            print(space.is_free(table))


# ---- what is made --------------------------------------------------------------------------------

Q = (0.5, 0.75, 0.25)
PLANE = ("x", "y")
SPACE = ("x", "y", "z")
YAW = ("yaw",)
JOINTS = ("shoulder", "elbow")
PLACE = (0.125, 0.25)
TRIANGLE = [(0.0, 0.0), (1.0, 0.0), (0.5, 2.0)]
POINTS = [(0.0, 0.5), (1.0, 0.25)]
RADII = (0.5, 0.25)
CELLS = np.eye(3, dtype=bool)[:2]
POSE = [tuple(row) for row in np.eye(4).tolist()]
COLUMNS = ("right", "up", "out", "place")  # of a matrix, which has no names
BALL = Robot.ball(0.125, (0.0, 0.0, 8.0)).shape


def measure(motion, velocity=None):
    """Return the distance of a thing that moves from one that stands."""
    still = Mover(Robot.disc(0.1), (3.0, 1.0))
    moving = Mover(Robot.disc(0.1), motion, velocity=velocity)
    return cspace.lanes.apart(moving, still, until=1.0).distance


GIVEN = {
    "Robot.disc": {"radius": 0.25},
    "Robot.ball": {"radius": 0.25},
    "Robot.rectangle": {"length": 0.5, "width": 0.25},
    "Robot.ellipse": {"radius_x": 0.5, "radius_y": 0.25},
    "Robot.capsule": {"length": 0.5, "radius": 0.25},
    "Robot.cylinder": {"radius": 0.25, "height": 0.5},
    "Robot.box": {"extents": (1.0, 1.0, 1.0)},
    "Robot.from_balls": {"centers": POINTS, "radii": 0.5},
    "Robot.from_bitmap": {"occupied": CELLS, "spacing": 0.125},
    "Grid": {"lower": (0, 0), "spacing": 0.5, "shape": (3, 4)},
    "Workspace.from_array": {"occupied": CELLS, "spacing": 0.5},
    "Workspace.from_balls": {"centers": POINTS, "radii": 0.25, "spacing": 0.125},
    "Workspace.from_points": {"points": POINTS, "spacing": 0.125, "radius": 0.25},
    "Workspace.from_shapes": {"shapes": [Robot.disc(0.25).shape], "spacing": 0.125},
    "Gate.slow_down": {"q": Q, "twist": (0.25, 0.125)},
    "Near": {"configuration": (1.5, 1.5, 0.5), "distance": 0.25},
    "measure": {"motion": (0.5, 0.75)},
    "Upright": {"frame": "tool"},
    "PoseGoal": {"frame": "tool", "pose": POSE},
    "PosedShape": {"shape": BALL},
    "build_arm_space": {"obstacles": {"ball": PosedShape(BALL, POSE)}, "arm": planar_arm()},
    "Arm.pose": {"frame": "fore"},
    "Arm.link_speed": {"link": "fore", "q": (0.5, 0.75)},
    "Arm.configuration": {"values": {}},
    "Arm.inverse": {"frame": "upper", "pose": np.eye(4), "seed": 0},
    "RouteGraph.from_arrays": {"positions": POINTS, "edges": [(0, 1)]},
    "HeadingRule": {"frame": "map"},
    "ball_spectrum": {
        "centers": POINTS,
        "radii": 0.5,
        "bump": Bump(),
        "lengths": (2.0, 2.0),
        "counts": (8, 8),
    },
}
"""What else a call takes."""

MAKERS = {
    **{f"Robot.{name} center": (PLACE, PLANE) for name in ("disc", "rectangle", "ellipse")},
    **{f"Robot.{name} center": (Q, SPACE) for name in ("ball", "capsule", "cylinder", "box")},
    "Robot.box extents": (Q, SPACE),
    "Robot.polygon shape": (TRIANGLE, PLANE),
    "Robot.from_footprint footprint": (TRIANGLE, PLANE),
    "Robot.from_balls centers": (POINTS, PLANE),
    "Robot.from_balls radii": (RADII, PLANE),
    "Robot.from_bitmap lower": (PLACE, PLANE),
    "Grid lower": (PLACE, PLANE),
    "Grid shape": ((3, 4), PLANE),
    "grid.center_of cells": ((3, 4), PLANE),
    "Workspace.from_array lower": (PLACE, PLANE),
    "Workspace.from_balls centers": (POINTS, PLANE),
    "Workspace.from_balls radii": (RADII, PLANE),
    "Workspace.from_points points": (POINTS, PLANE),
    "Workspace.from_points bounds": ([(0.0, -0.5), (1.0, 0.5)], PLANE),
    "Workspace.from_shapes bounds": ((-1.0, -0.5, 2.0, 1.0), ("xmin", "ymin", "xmax", "ymax")),
    "Workspace.from_points offset": ((0.0, -0.5), PLANE),
    "Rotations.of value": ((0.0, 0.5, 1.0, 2.0 * math.pi), YAW),
    "rotations.cell_of yaw": ((0.5,), YAW),
    "CSpace.states_at rotation": ((0.5,), YAW),
    "CSpace.to_costmap rotation": ((0.5,), YAW),
    "Gate.slow_down twist_now": (PLACE, ("v", "omega")),
    "Near configuration": ((1.5, 1.25, 0.5), (*PLANE, *YAW)),
    "measure motion": ((0.5, 0.75), PLANE),
    "measure velocity": ((0.25, 0.125), PLANE),
    "Upright axis": ((0.0, 0.5, 1.0), SPACE),
    "Upright direction": ((0.0, 0.5, 1.0), SPACE),
    "PoseGoal pose": (POSE, COLUMNS),
    "PoseGoal tolerance": ((0.25, 0.125), ("metres", "radians")),
    "PosedShape pose": (POSE, COLUMNS),
    "build_arm_space base_pose": (POSE, COLUMNS),
    "Arm.pose q": ((0.5, 0.75), JOINTS),
    "Arm.link_speed velocity": (RADII, JOINTS),
    "Arm.poses q": ((0.5, 0.75), JOINTS),
    "Arm.configuration base": ((0.5, 0.75), JOINTS),
    "Arm.inverse near": ((0.5, 0.75), JOINTS),
    "region.contains q": (Q, (*PLANE, *YAW)),
    "RouteGraph.from_arrays positions": (POINTS, PLANE),
    "RouteGraph.from_arrays edges": ([(0, 1), (1, 0)], ("start", "end")),
    "RouteGraph.from_arrays yaws": (RADII, ("a", "b")),
    "HeadingRule yaws": (RADII, ("a", "b")),
    "ball_spectrum centers": (POINTS, PLANE),
    "ball_spectrum radii": (RADII, PLANE),
    "ball_spectrum lengths": ((2.0, 3.0), PLANE),
}
"""Calls and arguments: what is made of numbers, or asked of it, with numbers and their labels."""


def find_call(objects, name):
    """Return a call by its name, of an object, of what one has, or of this module."""
    owner, _, method = name.rpartition(".")
    space = objects["CSpace"]
    modules = cspace, cspace.arms, cspace.lanes, cspace.spectral, planners
    given = {key: each for module in modules for key, each in vars(module).items()} | objects
    given |= {
        "Grid": cspace.Grid,
        "grid": space.grid,
        "rotations": space.rotations,
        "Arm": objects["ArmSpace"].arm,
    }
    given |= {"region": space.free_region(Q, reach=0.25), "measure": measure}
    return getattr(given[owner], method) if owner else given[method]


@pytest.mark.parametrize("maker", MAKERS)
def test_what_is_made_of_numbers_with_labels_is_one_thing(objects, maker):
    numbers, labels = MAKERS[maker]
    name, argument = maker.split()
    make = find_call(objects, name)

    def call(value):
        made = make(**{**GIVEN.get(name, {}), argument: value})
        if name == "Near":
            return planners.plan(objects["CSpace"], Q, made, seed=0)
        if name == "HeadingRule":
            return RouteGraph.from_arrays(POINTS, [(0, 1)], headings=made)
        return str(made.data) if name == "CSpace.to_costmap" else made

    expected = ask(call, {"value": numbers})
    assert not expected.startswith("refused"), expected
    size = len(numbers[0]) if isinstance(numbers, list) else len(numbers)
    names = labels if len(labels) == size else tuple(f"{labels[0]}{k}" for k in range(size))
    for kind, values in vary(numbers, names):
        assert ask(call, {"value": values}) in (expected, "refused: InputError"), kind


NAMELESS = {
    *("cells", "occupied", "inner", "heights"),  # arrays of cells: tests/test_arguments.py
    *("radius", "rotations", "lengths", "turns", "within", "deviation", "held_joints", "max_jerk"),
    *("camera", "center", "t", "distance", "frequency", "counts", "chosen", "step"),
    *("starts", "ends", "poses", "pose", "base_pose", "tolerance", "near", "edges"),
}
"""Arguments whose numbers have no axes with names, or which one call of the tables shows for all."""


def test_all_arguments_that_are_arrays_are_in_a_table():
    shown = {argument for _, _, argument in CALLS} | NAMELESS | FILES
    shown |= {label.split()[1] for label in (*MAKERS, *ELSEWHERE)}
    missing = {
        f"{name} {argument}"
        for name, call in list_functions()
        if inspect.isroutine(call)
        for argument, kind in getattr(call, "__annotations__", {}).items()
        if "ArrayLike" in str(kind) and argument != "return" and argument not in shown
    }
    assert not missing
