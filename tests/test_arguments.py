"""Arguments of calls: arrays of any kind, labels, names, options and states of OMPL."""

import copy
import inspect
import re
from collections import namedtuple
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import PIL.Image
import pytest
import scipy.sparse
import shapely
import xarray as xr
import zarr
from ompl import base as ob
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace import Grid, InputError, Robot, Workspace
from cspace._support.check import check_count, check_known
from tests.helpers.refusals import check_refused, refusals

CELLS = np.zeros((40, 30), dtype=bool)
WALLS = Workspace.from_array(np.eye(30, dtype=bool)[::-1], 0.1)


@cache
def turning():
    """Build the map of a robot that turns."""
    return cspace.build(WALLS, Robot.rectangle(0.3, 0.2), rotations=8, counts=True)


@cache
def flat():
    """Build the map of a disc."""
    return cspace.build(WALLS, Robot.disc(0.1))


def find_way():
    """Plan between two places on the map of a disc."""
    return planners.plan(flat(), (0.8, 0.6), (0.9, 0.6))


SHAPE = shapely.box(0.0, 0.0, 1.0, 1.0)


def utm():
    """Return a square of 10 km in survey coordinates, too large for small cells at any place."""
    return shapely.box(515e3, 4250e3, 525e3, 4260e3)


Q = (0.6, 0.6, 0.3)
P = (0.8, 0.6, 0.3)


def test_truth_values_are_no_commands():
    gate = cspace.Gate(turning(), dt=0.1)
    for twists in ([[True, False]], np.zeros((2, 2), dtype=bool)):
        with pytest.raises(InputError, match="must be numeric"):
            gate.check_twists((0.6, 0.6, 0.0), twists)


def test_one_deceleration_counts_for_both_rates():
    gate = cspace.Gate(turning(), dt=0.1, max_deceleration=0.5)
    both = cspace.Gate(turning(), dt=0.1, max_deceleration=(0.5, 0.5))
    assert gate.stop_distance((0.2, 0.1)) == both.stop_distance((0.2, 0.1))


def test_labels_of_tables_are_named_if_they_are_others():
    table = pd.DataFrame({"y": [0.6, 1.2], "x": [0.7, 0.3], "yaw": [0.1, 2.0]})
    wrong = table.rename(columns={"yaw": "theta"})
    check_refused(
        lambda: turning().is_free(wrong),
        "q has the labels y, x, theta ... x, y, yaw",
    )
    # Points of an obstacle are read as those of a workspace.
    space = cspace.build(WALLS, Robot.disc(0.1))
    space.add_obstacle("scan", table, radius=0.05)
    (scan,) = space.obstacles.values()
    assert np.allclose(scan.outer.bounds, [[0.25, 0.55], [0.75, 1.25]])


def test_labels_of_goals_and_updates_are_heard():
    goal = namedtuple("Goal", "y x yaw")(0.9, 0.6, None)
    assert planners.plan(turning(), Q, goal).goal[:2].tolist() == [0.6, 0.9]
    space = cspace.build(WALLS, Robot.disc(0.1))
    cells = np.ones((1, 2), dtype=bool)
    labelled = copy.copy(space).update(cells, pd.Series({"y": 3, "x": 7}))
    assert labelled == space.update(cells, (7, 3))
    with pytest.raises(InputError, match=r"cells is a DataFrame.*labels"):
        space.update(pd.DataFrame(np.ones((1, 2), dtype=bool), index=["b"]), (0, 0))


class Store:
    """An array that names its dimensions as those of tensorstore do."""

    def __init__(self, values, labels):
        self.domain = SimpleNamespace(labels=labels)
        self.values = values
        self.shape, self.dtype = values.shape, values.dtype

    def __array__(self, dtype=None, copy=None):
        return self.values


class Sparse:
    """An array that converts as those of the package sparse do."""

    def __init__(self, values):
        self.todense = lambda: values
        self.shape, self.dtype, self.ndim = values.shape, values.dtype, values.ndim

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("cannot convert a sparse array")

    def __array_function__(self, *_):
        return NotImplemented

    def __array_ufunc__(self, *_):
        return NotImplemented


def store_zarr(values):
    """Return a zarr array with the dimensions y and x."""
    store = zarr.storage.MemoryStore()
    array = zarr.create_array(
        store, shape=values.shape, dtype=values.dtype, dimension_names=("y", "x")
    )
    array[...] = values
    return array


OTHER_ARRAYS = {
    "labels": lambda cells: xr.DataArray(cells, dims=("y", "x")),
    "coordinates": lambda cells: xr.DataArray(cells, {"x": [0.0, 0.5, 1.5]}, dims=("x", "y")),
    "Variable": lambda cells: xr.Variable(("row", "column"), cells),
    "Dataset": lambda cells: xr.Dataset({"cells": (("x", "y"), cells)}),
    "sparse DataArray": lambda cells: xr.DataArray(Sparse(cells), dims=("x", "y")),
    "zarr": store_zarr,
    "tensorstore": lambda cells: Store(cells, ("y", "x")),
    "table": lambda cells: pd.DataFrame(cells, pd.Index(range(3), name="y")),
    "image": lambda cells: PIL.Image.fromarray(cells.astype(np.uint8)),
    "sparse": Sparse,
    "csr": scipy.sparse.csr_array,
    "dok": scipy.sparse.dok_matrix,
    "masked": lambda cells: np.ma.array(cells, mask=cells > 0),
    "ragged": lambda cells: [[0, 1, 1], [0, 1], [0, 1, 1]],
}
"""What is no array of cells indexed [x, y], made of one of shape (3, 3)."""

CELL_DOORS = {
    "occupied": lambda cells: Workspace.from_array(cells, 0.1).outer,
    "inner": lambda cells: Workspace.from_array(np.ones((3, 3), bool), 0.1, inner=cells).inner,
    "outer": lambda cells: Workspace(Grid((0, 0), 0.1, (3, 3)), cells, cells).outer,
    "bitmap": lambda cells: Robot.from_bitmap(cells, 0.1).shape.occupied,
    "cells": lambda cells: copy.copy(flat()).update(cells, (0, 0)).occupied > 0,
    "costs": lambda cells: planners.WeightedLength(cells).costs,
}
"""Calls that take an array of cells."""


@pytest.mark.parametrize("door", CELL_DOORS)
@pytest.mark.parametrize("kind", OTHER_ARRAYS)
def test_what_is_no_array_of_cells_is_refused_at_every_door(door, kind):
    dtype = np.float64 if door == "costs" else np.bool_
    cells = np.array([[0, 1, 1], [0, 0, 1], [0, 0, 0]], dtype=dtype)
    for plain in (cells, Store(cells, ("x", "y")), Store(cells, ("", ""))):
        assert np.any(CELL_DOORS[door](plain))
    check_refused(lambda: CELL_DOORS[door](OTHER_ARRAYS[kind](cells)), "; ")


class Quantity:
    """A value with its unit, as of pint."""

    def __init__(self, value, units):
        self.value = value
        self.units = units

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.value, dtype=dtype)


class Measured(np.ndarray):
    """An array with its unit, as of astropy."""

    unit = "cm"


@pytest.mark.parametrize(
    "value",
    [
        Quantity(0.3, "centimeter"),
        np.array(0.3).view(Measured),
        xr.DataArray(0.3, attrs={"units": "mm"}),
    ],
)
def test_values_in_other_units_are_refused(value):
    check_refused(
        lambda: Robot.disc(value),
        "radius has the unit ... metres",
    )


@pytest.mark.parametrize("unit", ["m", "metre", "Meters", "rad", "m/s", "rad / s ** 2", ""])
def test_values_in_our_units_are_taken(unit):
    assert Robot.disc(Quantity(0.3, unit)).shape.span == Robot.disc(0.3).shape.span


STATES = [
    ob.RealVectorStateSpace(2),
    ob.RealVectorStateSpace(4),
    ob.SE3StateSpace(),
    ob.SO2StateSpace(),
]


@pytest.mark.parametrize("number", range(len(STATES)))
@pytest.mark.parametrize(
    "make",
    [
        planners.StateValidityChecker,
        planners.MotionValidator,
        planners.FreeStateSampler,
    ],
)
def test_states_of_another_space_are_refused(make, number):
    check_refused(
        lambda: make(ob.SpaceInformation(STATES[number]), turning()),
        "si has states of ... R(2), SO2(1)",
    )


def test_costs_of_another_shape_are_refused():
    shape = len(turning().slice_rotations), *turning().grid.shape
    others = [shape[1:], (3, 3), (*shape, 1), shape[::-1], (shape[0] + 1, *shape[1:])]
    for other in others:
        check_refused(
            lambda other=other: planners.simple_setup(
                turning(), objective=planners.WeightedLength(np.ones(other))
            ),
            "costs has shape ... (4, 30, 30)",
        )
    for costs in (np.full(shape, np.nan), np.full(shape, np.inf), np.full(shape, "a"), "costs"):
        with pytest.raises(InputError):
            planners.WeightedLength(costs)  # type: ignore[arg-type]
    costs = np.random.default_rng(0).random(shape)
    found = []
    for same in (costs, np.asfortranarray(costs), costs.astype(">f8"), costs.tolist()):
        setup = planners.simple_setup(turning(), objective=planners.WeightedLength(same))
        state = setup.getSpaceInformation().allocState()
        state.setXY(0.7, 0.6)
        state.setYaw(0.3)
        found.append(setup.getOptimizationObjective().stateCost(state).value())
    assert len(set(found)) == 1 < found[0]


@refusals(
    "call, message",
    # Numbers and words.
    (lambda: Robot.disc(True), "radius is True ... numeric"),
    (lambda: Robot.disc((0, 0), 0.3), "radius is (0, 0) ... one number above zero"),
    (lambda: check_count(True, "n", 0, 10), "n is True ... 0 to 10"),
    # Grids.
    (lambda: Grid((0, 0), np.nan, (1, 1)), "spacing is nan"),
    (lambda: Grid((0, np.inf), 1.0, (1, 1)), "lower[1] is inf ... finite"),
    (lambda: Grid((0, 0), 1.0, (1.5, 2)), "shape is (1.5, 2.0)"),
    (lambda: Grid((0, 0), 1.0, (2, 2)).cell_of((1.0, 2.0, 3.0)), "points has shape (3,)"),
    (lambda: flat().grid.center_of([10**400, 1]), "cells has too large an integer"),
    # Workspaces and robots.
    (lambda: Workspace.from_array(0.1, CELLS), "spacing is a ndarray ... numeric"),
    (
        lambda: Workspace.from_array(np.zeros((0, 3), bool), 1.0),
        "occupied is a ndarray of 2 axes and 0 entries ... cell",
    ),
    (lambda: Workspace.from_array(CELLS, 0.1, (0, 0, 0)), "lower has shape (3,)"),
    (lambda: Workspace(Grid((0, 0), 1, (3, 2)), CELLS, CELLS), "outer has shape (40, 30) but the"),
    (lambda: Workspace.from_shapes([], 0.1), "shapes is empty"),
    (lambda: Workspace.from_shapes([Robot.disc(1), Robot.ball(1)], 0.1), "shapes[1] is in space"),
    (lambda: Robot.cylinder(0, 1), "radius is 0 ... one number above zero"),
    (lambda: Robot.capsule(1, -1), "length is -1"),
    (lambda: Robot.cylinder(1, 1, (0, 0)), "center has shape"),
    (
        lambda: Robot.from_bitmap(xr.DataArray(CELLS, {"x": range(40)}, dims=("x", "y")), 0.1),
        "has coordinates; they have no effect here",
    ),
    # Builds and maps.
    (
        lambda: cspace.build(WALLS, "robot.urdf"),
        "robot is 'robot.urdf' ... shorthand",
    ),
    (lambda: cspace.build(WALLS, Robot.disc(0.1), margin=np.nan), "margin is nan"),
    (
        lambda: cspace.build(WALLS, Robot.disc(0.1), progress=True),
        "progress is True ... steps",
    ),
    (lambda: cspace.open(7), "path is 7 ... file name"),
    (lambda: flat().add_obstacle("a", [(1e9, 0.0)], radius=0.1), "reaches 1e+10 cells"),
    (lambda: Workspace.from_points(np.zeros((3, 9)), 0.1), "points has shape (3, 9)"),
    (
        lambda: cspace.build(Workspace.from_array(CELLS[:3, :3], 0.1), "disc:0.1").min_path_length(
            (9.0, 9.0), (0.1, 0.1)
        ),
        "q0 is (9.0, 9.0) ... 0.3",
    ),
    (lambda: flat().is_free((1.0, np.nan)), "q is (1.0, nan) ... finite"),
    # What is ours, where numbers are meant.
    (
        lambda: flat().certify_path(find_way()),
        "path is a Plan ... numeric ... use path.path for rows",
    ),
    (lambda: cspace.Gate(find_way()), "space is a Plan ... proves"),
    # What others made, where numbers, cells, polygons or fields are meant.
    (lambda: Workspace.from_polygons(Rotation.identity(), 0.1), "polygons is a Rotation; it must"),
    (lambda: Workspace.from_occupancy_grid(SHAPE.centroid), "must hold fields and values, not a P"),
    (
        lambda: Workspace.from_points(np.zeros(2, [("X", float), ("Y", float)]), 0.1),
        "points has the labels X, Y ... x, y, z ... did you mean 'x'?",
    ),
    (
        lambda: flat().add_obstacle("a", [[[(1, 1), (2, 1), (2, 2)], [(1.2, 1.1)]]]),
        "shape is [[[(1, 1), (2, 1), (2, 2)], [(1.2, 1.1)]]] ... polygon ... use",
    ),
    (
        lambda: Workspace.from_polygons([utm()], 1e-4),
        "grid reaches 4.26e+10 cells from the origin ... invalidates",
    ),
    # Gates, plans and arms.
    (lambda: cspace.Gate(turning(), dt=0.1, max_velocity={"x": 1.0}), "lacks y, yaw"),
    (lambda: cspace.Gate(flat(), dt=0.1), "max_velocity is missing"),
    (
        lambda: planners.plan(flat(), Q[:2], P[:2]).trajectory(
            max_velocity={"x": 1.0, "y": 1.0, "X": 0.1}, max_acceleration=1.0
        ),
        "max_velocity names 'X' ... x, y ... did you mean 'x'?",
    ),
    (
        lambda: planners.plan(flat(), P[:2], (0.9, 0.6)).to_path(frame_id=5),
        "frame_id is 5 ... name",
    ),
    (lambda: cspace.build_arm_space({}, "robot.urdf"), "arm is a str"),
    (
        lambda: cspace.PoseGoal("tool0", np.eye(4), tolerance=(1e-3, 90.0)),
        "pass 1.5708 for 90 degrees",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(call, message):
    check_refused(call, message)


def test_changes_instead_of_rows_are_named():
    passed = cspace.Gate(turning()).check_rows((2.5, 2.5, 0.0), [(0.01, 0.0, 0.0)] * 3)
    assert "rows are targets, not changes" in passed.chunk.refusal.message
    for q, rows in (
        ((0.05, 0.05, 0.0), [(0.1, 0.05, 0.0)]),
        ((2.5, 2.5, 0.0), [(1.0, 1.0, 0.0)] * 3),
    ):
        refused = cspace.Gate(turning()).check_rows(q, rows)
        assert "rows are" not in refused.chunk.refusal.message


def test_an_unknown_option_names_the_most_similar_one():
    calls = [
        (cspace.build, "rotation", "rotations"),
        (cspace.Gate, "maxvelocity", "max_velocity"),
        (planners.plan, "time_limits", "time_limit"),
        (Workspace.from_points, "spacng", "spacing"),
        (Workspace.from_mesh, "resolution", "spacing"),
        (Robot.from_mesh, "Solid", "solid"),
        (turning().add_obstacle, "raduis", "radius"),
        (turning().plot, "pth", "path"),
    ]
    for call, option, similar in calls:
        with pytest.raises(TypeError, match=f"{option}'; did you mean '{similar}'"):
            call(**{option: 1})  # type: ignore[operator]
    assert "rotations" in inspect.signature(cspace.build).parameters


MISFITS = {
    "Robot.box(0.6, 0.6, 0.2)": "Robot.box() ... takes extents, center; pass (0.6, 0.6, 0.2)",
    "Robot.rectangle((0.6, 0.4))": "'width' ... takes length, width, center; pass 0.6, 0.4",
    "Robot.disc(0.0, 0.0, 0.3)": "Robot.disc() ... it takes radius, center",
    "Workspace.from_array(CELLS)": "'spacing' ... occupied, spacing, lower, and others by name",
    "cspace.build(WALLS, 'disc:0.1', 8)": "build() ... takes workspace, robot, and others by name",
    "flat().is_free(0.5, 1.0)": "CSpace.is_free() ... it takes q; pass (0.5, 1.0)",
    "flat().exact.classify(0.5, 1.0)": "classify() ... it takes q; pass (0.5, 1.0)",
    "flat().clearance(0.5, 1.0)": "clearance() ... it takes q; pass (0.5, 1.0)",
    "flat().nearest_free(0.5, 1.0)": "nearest_free() ... it takes q; pass (0.5, 1.0)",
    "flat().motion_is_free(0.8, 0.6, 0.9, 0.6)": "takes q0, q1; pass (0.8, 0.6), (0.9, 0.6)",
    "flat().motion_is_free((0.8, 0.6))": "'q1'; it takes q0, q1",
    "flat().add_obstacle(Robot.disc(0.2))": "'shape'; it takes name, shape, and others by name",
    "planners.Differential(0.5)": "Differential() ... its options are reverse",
    "planners.Search(goal_bias=0.1)": "Search() has no option 'goal_bias' ... simplify",
    "planners.Near((0.8, 0.6), tol=0.1)": "Near() has no option 'tol' ... angle, closest, distance",
    "planners.ToolSpeed(sped=0.1)": "ToolSpeed() has no option 'sped'; did you mean 'speed'?",
    "planners.plan(flat(), (0.8, 0.6), (0.9, 0.6), simplify=True)": "plan() has no option 'simplify'; did you mean 'planner'?",
    "planners.plan(flat(), (0.8, 0.6), (0.9, 0.6), goal_bias=0.1)": "plan() has no option 'goal_bias'; did you mean 'planner'?",
    "planners.plan(flat(), (0.8, 0.6), (0.9, 0.6), timeout=1)": "plan() has no option 'timeout'; did you mean 'time_limit'?",
    "planners.Car(radius=0.5)": "Car() has no option 'radius' ... turning_radius",
    "planners.Car(reverse=True)": "Car() ... 'turning_radius'; it takes turning_radius",
    "planners.Car(0.5, turning_radius=0.5)": "Car() ... 'turning_radius'",
}
"""Calls that do not fit, and their messages; a call may be given the values that one advises."""


@pytest.mark.parametrize("call", MISFITS)
def test_a_call_that_does_not_fit_names_its_parameters(call):
    with pytest.raises(TypeError) as caught:
        eval(call)
    message, parts = str(caught.value), map(re.escape, MISFITS[call].split(" ... "))
    assert re.search(".*".join(parts), message), message
    advised = re.search("pass (.*)", message)
    called, _ = re.split(r"\((?!\))", call, maxsplit=1)
    assert advised is None or eval(f"{called}({advised[1]})") is not None


def test_a_call_that_fits_keeps_its_own_error():
    with pytest.raises(TypeError, match="unsized"):
        cspace.build(WALLS, Robot.disc(0.1), progress=raise_unsized)


def raise_unsized(*_):
    raise TypeError("unsized")


@pytest.mark.parametrize(
    "owner, name, ours",
    [
        (Robot, "sphere", "ball"),
        (Robot, "Circle", "disc"),
        (Robot, "from_polygon", "polygon"),
        (Robot, "rectangel", "rectangle"),
        (Robot, "square", "rectangle"),
        (Workspace, "load", "open"),
        (Workspace, "from_numpy", "from_array"),
        (Workspace, "from_image", "open"),
        (cspace, "load", "open"),
        (cspace, "Workspaces", "Workspace"),
        (planners, "ReedsShepp", "Car"),
        (planners, "DiffDrive", "Differential"),
        (planners, "RRTConnect", "Search"),
        (planners, "SimpleSetup", "simple_setup"),
        (Workspace, "from_octomap", "open"),
    ],
)
def test_a_name_of_another_package_is_answered_with_ours(owner, name, ours):
    with pytest.raises(AttributeError, match=f"has no '{name}'; .*\\b{ours}\\b") as caught:
        getattr(owner, name)
    # Python looks for names that look alike there.
    assert not [each for each in dir(caught.value.obj) if each.startswith("_")]
    assert hasattr(owner, ours) and not hasattr(owner, "_unknown")


def test_plans_and_packages_without_plan_answer_names_of_others():
    for owner, name, ours in ((find_way(), "solved", "status"), (cspace, "plan", "planners.plan")):
        with pytest.raises(AttributeError, match=f"has no '{name}'; did you mean '{ours}'"):
            getattr(owner, name)


def test_an_unlike_name_suggests_nothing():
    with pytest.raises(TypeError, match="'resolution'; its options are"):
        cspace.build(WALLS, "disc:0.1", resolution=0.1)  # type: ignore[call-arg]
    with pytest.raises(InputError) as refused:
        planners.plan(flat(), (0.8, 0.6), (0.9, 0.6), planner="hybrid")
    assert not refused.value.hint
    for word, known in (
        ("has_position_limits", "has_velocity_limits"),
        ("weight", "maxHeight"),
        ("min_velocity", "max_velocity"),
        ("radii", "radius"),
        ("path", "pathway"),
        ("pos", "pose_of"),
        ("y", "x"),
        ("", "x"),
    ):
        with pytest.raises(InputError) as refused:
            check_known(word, "name", [known, "thickness"])
        assert not refused.value.hint, word


def test_refused_ends_are_written_without_noise():
    floor = cspace.build(Workspace.from_array(CELLS, 0.1), Robot.disc(0.1))
    with pytest.raises(InputError) as refused:
        planners.plan(floor, (0.1 + 0.2, 0.03), (1.0, 1.0))
    assert str(refused.value).startswith("start (0.3, 0.03) is in collision")
    with pytest.raises(InputError) as refused:
        planners.plan(floor, (1.0, 1.0), [(0.1 + 0.2, 0.03)])
    assert "goal[0]" not in refused.value.rule


def test_an_unlike_option_lists_those_that_can_be_given():
    with pytest.raises(TypeError, match=r"its options are max_room$"):
        cspace.lanes.audit(turning(), None, heading="any")  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"view\(\) .*options are block, frame, goal, host, path, "):
        turning().view(open_browser=False)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="its options are ax, camera, center, goal, legend, "):
        turning().plot(quiet=True)  # type: ignore[call-arg]
    with pytest.raises(
        TypeError, match=r"its options are bounds, lazy, offset, polygons, spacing$"
    ):
        Workspace.from_polygons(quiet=True)  # type: ignore[call-arg]


def test_pairs_of_arrays_with_other_dimensions_are_refused():
    rows = xr.DataArray([Q, P], dims=("time", "axis"))
    row = xr.DataArray(list(Q), dims="axis")
    for first, second in ((rows, row), (row, rows), (rows, rows)):
        plain = turning().motion_is_free(first.values, second.values)
        assert np.array_equal(turning().motion_is_free(first, second), plain)
    for other in (rows.rename(time="robot"), rows.rename(time="axis", axis="time")):
        with pytest.raises(InputError, match="numpy would pair them"):
            turning().motion_is_free(rows, other)
