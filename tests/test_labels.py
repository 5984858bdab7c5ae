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
from cspace import CspaceError, Grid, Robot, Rotations, Workspace
from cspace.arms import PosedShape, PoseGoal, build_arm_space
from cspace.lanes import HeadingRule, Mover, RouteGraph
from cspace.spectral import Bump, ball_spectrum
from planners import Near, Upright
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
TURNING = ("x", "y", "yaw")
JOINTS = ("shoulder", "elbow")
TOLERANCE = ("metres", "radians")
TRIANGLE = [(0.0, 0.0), (1.0, 0.0), (0.5, 2.0)]
POINTS = [(0.0, 0.5), (1.0, 0.25)]
CELLS = np.eye(3, dtype=bool)[:2]
CORNERS = ("xmin", "ymin", "xmax", "ymax")
POSE = [tuple(row) for row in np.eye(4).tolist()]
COLUMNS = ("right", "up", "out", "place")  # of a matrix, which has no names
BALL = Robot.ball(0.125, (0.0, 0.0, 8.0)).shape


def make_graph(positions=POINTS, edges=((0, 1),), yaws=None, heading="forward"):
    """Make a graph; return its nodes and the headings of its lanes."""
    graph = RouteGraph.from_arrays(positions, edges, headings=heading, yaws=yaws)
    lanes = [(lane.start, lane.end, sorted(lane.heading.yaws)) for lane in graph.lanes]
    return [graph.positions, graph.yaws, str(lanes)]


def measure(motion=(0.5, 0.75), velocity=None):
    """Return the distance of a thing that moves from one that stands."""
    still = Mover(Robot.disc(0.1), (3.0, 1.0))
    moving = Mover(Robot.disc(0.1), motion, velocity=velocity)
    return cspace.lanes.apart(moving, still, until=1.0).distance


def arm_of(objects):
    """Return the arm of the objects."""
    return objects["ArmSpace"].arm


CENTERED = {
    "disc": (0.25,),
    "rectangle": (0.5, 0.25),
    "ellipse": (0.5, 0.25),
    "ball": (0.5,),
    "capsule": (0.5, 0.25),
    "cylinder": (0.5, 0.25),
    "box": ((1.0, 1.0, 1.0),),
}
"""Sizes of robots that are made at a center."""


def make_centered(name, *sizes):
    """Return how to make a robot at a center, numbers of one, and their labels."""
    dim = getattr(Robot, name)(*sizes).shape.dim
    return lambda _, v: getattr(Robot, name)(*sizes, v).spec, Q[:dim], SPACE[:dim]


MAKERS = {
    **{f"Robot.{name} center": make_centered(name, *sizes) for name, sizes in CENTERED.items()},
    "Robot.box extents": (lambda _, v: Robot.box(v).spec, Q, SPACE),
    "Robot.polygon shape": (lambda _, v: Robot.polygon(v).spec, TRIANGLE, PLANE),
    "Robot.from_footprint footprint": (
        lambda _, v: Robot.from_footprint(v).spec,
        TRIANGLE,
        PLANE,
    ),
    "Robot.from_balls centers": (lambda _, v: Robot.from_balls(v, 0.5).spec, POINTS, PLANE),
    "Robot.from_balls radii": (lambda _, v: Robot.from_balls(POINTS, v).spec, (0.5, 0.25), PLANE),
    "Robot.from_bitmap lower": (
        lambda _, v: Robot.from_bitmap(CELLS, 0.125, v).spec,
        (0.125, 0.25),
        PLANE,
    ),
    "Grid.__init__ lower": (lambda _, v: Grid(v, 0.5, (3, 4)).lower, (0.125, 0.25), PLANE),
    "Grid.__init__ shape": (lambda _, v: Grid((0, 0), 0.5, v).shape, (3, 4), PLANE),
    "Grid.center_of cells": (lambda made, v: made["Grid"].center_of(v), (3, 4), PLANE),
    "Workspace.from_array lower": (
        lambda _, v: Workspace.from_array(CELLS, 0.5, v).grid.lower,
        (0.125, 0.25),
        PLANE,
    ),
    "Workspace.from_balls centers": (
        lambda _, v: Workspace.from_balls(v, 0.25, 0.125).outer,
        POINTS,
        PLANE,
    ),
    "Workspace.from_balls radii": (
        lambda _, v: Workspace.from_balls(POINTS, v, 0.125).outer,
        (0.5, 0.25),
        PLANE,
    ),
    "Workspace.from_points points": (
        lambda _, v: Workspace.from_points(v, 0.125, radius=0.25).outer,
        POINTS,
        PLANE,
    ),
    "Workspace.from_points bounds": (
        lambda _, v: Workspace.from_points(POINTS, 0.125, bounds=v).grid.shape,
        [(0.0, -0.5), (1.0, 0.5)],
        PLANE,
    ),
    "Workspace.from_shapes bounds": (
        lambda _, v: Workspace.from_shapes([Robot.disc(0.25).shape], 0.125, v).grid.shape,
        (-1.0, -0.5, 2.0, 1.0),
        CORNERS,
    ),
    "Workspace.from_points offset": (
        lambda _, v: Workspace.from_points(POINTS, 0.125, radius=0.25, offset=v).grid.lower,
        (0.0, -0.5),
        PLANE,
    ),
    "Rotations.of value": (
        lambda _, v: Rotations.of(v).centers,
        (0.0, 0.5, 1.0, 2.0 * math.pi),
        ("yaw",),
    ),
    "Rotations.cell_of rotation": (
        lambda made, v: str(made["CSpace"].rotations.cell_of(v)),
        (0.5,),
        ("yaw",),
    ),
    "CSpace.states_at rotation": (lambda made, v: made["CSpace"].states_at(v), (0.5,), ("yaw",)),
    "CSpace.to_costmap rotation": (
        lambda made, v: str(made["CSpace"].to_costmap(rotation=v).data),
        (0.5,),
        ("yaw",),
    ),
    "Gate.slow_down twist_now": (
        lambda made, v: made["Gate"].slow_down(Q, (0.25, 0.125), twist_now=v).commands,
        (0.125, 0.25),
        ("v", "omega"),
    ),
    "Near configuration": (
        lambda made, v: planners.plan(made["CSpace"], Q, Near(v, 0.25), seed=0).path,
        (1.5, 1.5, 0.5),
        TURNING,
    ),
    "Mover motion": (lambda _, v: measure(v), (0.5, 0.75), PLANE),
    "Mover velocity": (lambda _, v: measure(velocity=v), (0.25, 0.125), PLANE),
    "Upright axis": (lambda _, v: Upright("tool", v).axis, (0.0, 0.5, 1.0), SPACE),
    "Upright direction": (
        lambda _, v: Upright("tool", direction=v).direction,
        (0.0, 0.5, 1.0),
        SPACE,
    ),
    "PoseGoal pose": (lambda _, v: PoseGoal("tool", v).pose, POSE, COLUMNS),
    "PoseGoal tolerance": (
        lambda _, v: PoseGoal("tool", POSE, v).tolerance,
        (0.25, 0.125),
        TOLERANCE,
    ),
    "PosedShape pose": (
        lambda _, v: PosedShape(BALL, v).pose,
        POSE,
        COLUMNS,
    ),
    "build_arm_space base_pose": (
        lambda _, v: build_arm_space(
            {"ball": PosedShape(BALL, POSE)}, planar_arm(), base_pose=v
        ).obstacle_distance((0.5, 0.75)),
        POSE,
        COLUMNS,
    ),
    "Arm.pose q": (lambda made, v: arm_of(made).pose(v, "fore"), (0.5, 0.75), JOINTS),
    "Arm.link_speed velocity": (
        lambda made, v: arm_of(made).link_speed("fore", (0.5, 0.75), v),
        (0.5, 0.25),
        JOINTS,
    ),
    "Arm.poses q": (lambda made, v: str(arm_of(made).poses(v)), (0.5, 0.75), JOINTS),
    "Arm.configuration base": (
        lambda made, v: arm_of(made).configuration({}, base=v),
        (0.5, 0.75),
        JOINTS,
    ),
    "Arm.inverse near": (
        lambda made, v: arm_of(made).inverse("upper", np.eye(4), near=v, seed=0),
        (0.5, 0.75),
        JOINTS,
    ),
    "ConvexRegion.contains q": (
        lambda made, v: made["CSpace"].free_region(Q, reach=0.25).contains(v),
        Q,
        TURNING,
    ),
    "RouteGraph.from_arrays positions": (lambda _, v: make_graph(v), POINTS, PLANE),
    "RouteGraph.from_arrays edges": (
        lambda _, v: make_graph(edges=v),
        [(0, 1), (1, 0)],
        ("start", "end"),
    ),
    "RouteGraph.from_arrays yaws": (lambda _, v: make_graph(yaws=v), (0.5, 0.25), ("a", "b")),
    "HeadingRule yaws": (
        lambda _, v: make_graph(heading=HeadingRule("map", v)),
        (0.5, 0.25),
        ("a", "b"),
    ),
    "ball_spectrum centers": (
        lambda _, v: ball_spectrum(v, 0.5, Bump(), (2.0, 2.0), (8, 8)),
        POINTS,
        PLANE,
    ),
    "ball_spectrum radii": (
        lambda _, v: ball_spectrum(POINTS, v, Bump(), (2.0, 2.0), (8, 8)),
        (0.5, 0.25),
        PLANE,
    ),
    "ball_spectrum lengths": (
        lambda _, v: ball_spectrum(POINTS, 0.5, Bump(), v, (8, 8)),
        (2.0, 3.0),
        PLANE,
    ),
}
"""What is made of numbers, or asked of what was made, with numbers and their labels."""


@pytest.mark.parametrize("maker", MAKERS)
def test_what_is_made_of_numbers_with_labels_is_one_thing(objects, maker):
    make, numbers, labels = MAKERS[maker]

    def call(value):
        """Make the thing of a value."""
        made = make(objects, value)
        return str(made) if isinstance(made, str | dict) else made

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
