"""Results of plans: distances, proofs, text, pictures and files."""

import copy
import csv
import json
import math
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import fcl
import numpy as np
import pytest
import shapely
from matplotlib import pyplot as plt
from matplotlib.text import Text

import planners
from cspace import BLOCKED, FileError, Robot, Workspace, build
from cspace.errors import InputError
from cspace.plot.route import collect_marks
from planners.local_planner import HOLONOMIC, local_planner
from tests.helpers import solids
from tests.helpers.handmade import fill_boxes
from tests.helpers.planning import (
    ENDPOINTS,
    SPACES,
    SPACES_WITH_CURVES,
    build_halves,
    build_open_map,
    build_room,
    min_distance,
    options_for,
    wrap_rotations,
)
from tests.soak.plane import move_points


@pytest.fixture(scope="module", params=SPACES_WITH_CURVES, ids=lambda case: case[1] or case[0])
def plan(request: pytest.FixtureRequest) -> planners.Plan:
    name, curve = request.param
    return planners.plan(
        build_room(name), *ENDPOINTS[name], seed=4, time_limit=20.0, **options_for(curve)
    )


# ---- clearance along a path ----------------------------------------------------------------------


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
def test_the_clearance_of_a_path_bounds_the_clearance_of_its_points(
    name: str, curve: str | None
) -> None:
    space, dim = build_room(name), build_room(name).grid.dim
    edges = local_planner(space, False, curve or HOLONOMIC, 0.4 if curve else None)
    rng, positive = np.random.default_rng(0), 0
    for a in space.sample_free(40, rng):
        path = wrap_rotations(space, np.array([a, *(a + rng.uniform(-0.3, 0.3, (2, len(a))))]))
        bound = edges.clearance(path)
        points = edges.split_path(path, 0.01, 0.01).points
        if not space.grid.contains(points[:, :dim]).all():
            assert bound == 0.0
            continue
        if space.size == dim:
            minimum = min_distance(space, points)
            assert max(0.0, minimum - 2.3 * space.grid.spacing) <= bound <= minimum
        else:
            assert bound <= space.clearance(points).min() + 1.5 * space.grid.spacing + 1e-9
        positive += bound > 0.0
    assert positive > 4 or curve == "dubins"  # its short curves are loops


def test_the_clearance_of_a_path_is_the_minimum_over_its_pieces() -> None:
    space, start, _ = build_halves("space", BLOCKED)
    path = np.array([start, (8.0, 4.7, 4.5)])
    length = float(np.linalg.norm(path[1] - path[0]))
    count = math.ceil(length / 0.5)
    middles = path[0] + (np.arange(count) + 0.5)[:, None] / count * (path[1] - path[0])
    expected = space.clearance(middles).min() - 0.5 * length / count
    assert (
        local_planner(space).clearance(path) == pytest.approx(expected, abs=1e-12)
        and expected > 0.0
    )


def test_clearance_is_infinite_if_every_configuration_is_free(tmp_path: Path) -> None:
    for name in SPACES:
        space = build_open_map(name)
        endpoints = wrap_rotations(
            space,
            np.array(
                [[1.5] * space.size, [6.5] * space.grid.dim + [1.0] * len(space.rotations.names)]
            ),
        )
        plan = planners.plan(space, *endpoints)
        assert plan.solved and plan.clearance == math.inf
        plan.to_json(tmp_path / "plan.json", overwrite=True)
        assert json.loads((tmp_path / "plan.json").read_text())["clearance"] is None


# ---- distance from obstacles ---------------------------------------------------------------------

BOX_SIDES = {"space": (0.3, 0.3, 0.1), "yawing": (0.4, 0.2, 0.1), "floating": (0.3, 0.1, 0.2)}
"""Sides of the robots in space, in metres."""


def apart_in_the_plane(
    obstacles: shapely.Geometry, robot: shapely.Geometry, radius: float, q: np.ndarray
) -> float:
    """Return the distance of a robot from obstacles, less a radius."""
    return (
        float(
            shapely.transform(robot, lambda points: move_points(points, q[None])[0]).distance(
                obstacles
            )
        )
        - radius
    )


def oracle(name: str) -> Callable[[np.ndarray], float]:
    """Return the oracle for the obstacle distance in a room."""
    space, h = build_room(name), build_room(name).grid.spacing
    cells = space.grid.lower + h * np.argwhere(space.workspace.outer)
    if space.grid.dim == 2:
        sides = shapely.box(*space.grid.lower, *space.grid.upper).exterior
        everything = shapely.union_all([shapely.box(*low, *(low + h)) for low in cells] + [sides])
        robot, radius = {
            "plane": (shapely.Point(0, 0), 0.2),
            "turning": (shapely.box(-0.3, -0.15, 0.3, 0.15), 0.0),
        }[name]
        return lambda q: apart_in_the_plane(everything, robot, radius, q)
    boxes = fcl.DynamicAABBTreeCollisionManager()
    objects = [solids.box((h, h, h), low + 0.5 * h) for low in cells]
    boxes.registerObjects(objects)
    boxes.setup()

    def apart_in_space(q: np.ndarray) -> float:
        turn, data = solids.rotation_of(q).as_matrix(), fcl.DistanceData()
        boxes.distance(solids.box(BOX_SIDES[name], q[:3], turn), data, fcl.defaultDistanceCallback)
        walls = solids.within(space.grid.lower, space.grid.upper, BOX_SIDES[name], q[:3], turn)
        return min(float(data.result.min_distance), walls)

    return apart_in_space


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
def test_the_obstacle_distance_is_the_minimum_along_the_path(name: str, curve: str | None) -> None:
    space = build_room(name)
    plan = planners.plan(space, *ENDPOINTS[name], seed=4, time_limit=20.0, **options_for(curve))
    edges = local_planner(space, False, plan.drive, plan.turning_radius)
    dense = edges.split_path(plan.waypoints, 0.02, 0.05)
    minimum = min(map(oracle(name), dense.points))
    between = 0.5 * float(
        (dense.lengths + 0.4 * dense.rotations).max()
    )  # bound of the change between samples
    assert (
        minimum - between - 0.25 * space.grid.spacing - 1e-6
        <= plan.obstacle_distance
        <= minimum + 1e-6
    )
    assert plan.obstacle_distance > plan.clearance or plan.clearance == 0.0


def test_the_obstacle_distance_follows_shapes_that_change() -> None:
    pillar = shapely.Point(4.03, 2.51).buffer(0.5)
    workspace = Workspace.from_polygons([pillar], 0.1, bounds=(0, 0, 8, 8))
    space = build(
        workspace, Robot.polygon(shapely.box(-0.5, -0.2, 0.5, 0.2)), outside="free", margin=0.05
    )
    plan = planners.plan(space, (1.0, 3.6), (7.0, 3.6))
    minimum = float(shapely.box(0.5, 3.4, 7.5, 3.8).distance(pillar))
    assert minimum - 0.025 - 1e-6 <= plan.obstacle_distance <= minimum
    assert plan.shown_distance == ("obstacle_distance", plan.obstacle_distance)
    assert f" m, obstacle distance {plan.obstacle_distance:.3f} m\n" in repr(plan)
    assert planners.plan(space, (1.0, 3.6), (1.0, 3.6)).obstacle_distance > 2.0
    position = (4.0, 3.6, 0.0)[: space.size]
    apart = float(shapely.box(3.5, 3.4, 4.5, 3.8).distance(pillar))
    assert space.obstacle_distance(position) == pytest.approx(apart, abs=1e-9)
    assert space.obstacle_distance([position, (1.0, 1.0)], [0.1, 0.0]) == pytest.approx(
        apart - 0.05, abs=1e-9
    )
    assert space.obstacle_distance(position, turns=0.2) == pytest.approx(
        apart - 0.1 * math.hypot(0.5, 0.2), abs=1e-9
    )
    assert (
        space.obstacle_distance((4.0, 2.5)) == 0.0
    )  # inside the pillar, so boundaries do not intersect
    for wrong in ({"lengths": -0.1}, {"turns": [0.1, 0.2]}):
        with pytest.raises(InputError, match=f"{next(iter(wrong))} is .*it must be zero or above"):
            space.obstacle_distance(position, **wrong)
    space.add_obstacle("ball", shapely.Point(4.0, 4.35).buffer(0.2))
    assert plan.obstacle_distance == pytest.approx(0.35, abs=0.03)
    space.add_obstacle("ball", shapely.Point(4.0, 3.9).buffer(0.08))
    assert plan.obstacle_distance == 0.0
    space.remove_obstacle("ball")
    assert plan.obstacle_distance == pytest.approx(minimum, abs=0.03)
    assert planners.plan(build_open_map("plane"), (2, 2), (5, 5)).obstacle_distance == math.inf


def test_distances_follow_the_map_and_pickles_keep_the_clearance() -> None:
    space = build(
        Workspace.from_array(np.zeros((80, 80), dtype=bool), 0.1), Robot.disc(0.2), outside="free"
    )
    plan = planners.plan(space, (1.0, 4.0), (7.0, 4.0))
    before = pickle.loads(pickle.dumps(plan))
    assert before.clearance == math.inf
    space.add_obstacle("ball", shapely.Point(4.0, 5.2).buffer(0.3))
    assert 0.4 < plan.clearance < plan.obstacle_distance < 0.7
    for again in (
        pickle.loads(pickle.dumps(plan)),
        copy.deepcopy(plan),
        pickle.loads(pickle.dumps(copy.copy(plan))),
    ):
        assert again.space is None and math.isnan(again.obstacle_distance)
        assert again.shown_distance == ("clearance", plan.clearance)
    space.add_obstacle("ball", shapely.Point(4.0, 4.2).buffer(0.3))
    assert plan.clearance == plan.obstacle_distance == 0.0 and before.clearance == math.inf


def test_tiled_maps_show_the_clearance_instead_of_the_obstacle_distance(tmp_path: Path) -> None:
    occupied = fill_boxes((60, 60), np.s_[:20, 30])
    tiled = build(
        Workspace.from_array(occupied, 0.1), Robot.disc(0.2), store=tmp_path / "map", tile=30
    )
    plan = planners.plan(tiled, (1.0, 1.0), (1.0, 5.0))
    assert math.isnan(plan.obstacle_distance) and plan.shown_distance == (
        "clearance",
        plan.clearance,
    )
    assert plan.clearance == 0.0 and " m, clearance not proven to be more than 0\n" in repr(plan)


# ---- proofs --------------------------------------------------------------------------------------


def edge_center(plan: planners.Plan, edge: int) -> np.ndarray:
    """Return the position halfway along an edge."""
    first, last = (
        int((plan.path == q).all(axis=1).argmax()) for q in plan.waypoints[edge : edge + 2]
    )
    return plan.path[(first + last) // 2, : plan.space.grid.dim]


def test_recheck_proves_each_edge_among_the_current_obstacles(plan: planners.Plan) -> None:
    # Edges proven free are free at every row; the edge with an obstacle is not.
    assert plan.recheck().all() and plan.recheck().shape == (len(plan.waypoints) - 1,)
    space = copy.deepcopy(plan.space)
    longest = int(
        np.linalg.norm(np.diff(plan.waypoints[:, : space.grid.dim], axis=0), axis=1).argmax()
    )
    space.add_obstacle("post", [edge_center(plan, longest)], radius=0.05)
    free = plan.recheck(space)
    assert free.dtype == np.bool_ and not free[longest]
    rows = [int((plan.path == q).all(axis=1).argmax()) for q in plan.waypoints]
    for is_free, first, last in zip(free, rows, rows[1:], strict=False):
        if is_free and last > first:
            assert np.asarray(space.is_free(plan.path[first : last + 1])).all()
    assert plan.certified and plan.recheck().all()  # the plan's map has no post
    space.remove_obstacle("post")
    assert plan.recheck(space).all()


def test_repr_tells_if_the_proof_still_holds() -> None:
    space = build(Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1), Robot.disc(0.3))
    plan = planners.plan(space, (1.0, 1.5), (3.0, 1.5))
    assert ", certified; 2.000 m, obstacle distance 0.700 m" in repr(plan)
    space.add_obstacle("cart", shapely.box(1.8, 1.3, 2.2, 1.7))
    assert (
        ", certified when planned, 1 of 1 edges no longer proven free; 2.000 m" in repr(plan)
        and plan.certified
    )
    assert ", obstacle distance not proven to be more than 0\n" in repr(plan)
    again = pickle.loads(pickle.dumps(plan))
    assert "certified when planned; " in repr(again)
    assert not again.recheck(space).any()
    with pytest.raises(InputError, match=r"plan has no map; .* plan.recheck\(space\)"):
        again.recheck()
    with pytest.raises(InputError, match="space has the axes x, y, yaw; the plan has x, y"):
        plan.recheck(build_room("turning"))
    with pytest.raises(InputError, match="plan has no path"):
        planners.plan(*build_halves("plane", BLOCKED)).recheck()
    there = planners.plan(space, (1.0, 0.7), (1.0, 0.7))
    assert there.recheck().tolist() == [True]


def test_plot_marks_edges_that_are_no_longer_proven_free() -> None:
    wall = shapely.box(1.9, 0.0, 2.1, 1.6)
    space = build(Workspace.from_polygons([wall], 0.05, (0.0, 0.0, 4.0, 3.0)), Robot.disc(0.2))
    plan = planners.plan(space, (0.5, 0.5), (3.5, 0.5), planner="Grid")
    name = "path, no longer proven free"
    assert name not in [text.get_text() for text in plan.plot().figure.legends[0].get_texts()]
    space.add_obstacle("cart", shapely.box(0.9, 0.7, 1.4, 1.2))
    free = plan.recheck()
    assert free.any() and not free.all()
    for ax in (plan.plot(), space.plot(path=plan), plan.plot(zoom=1.5)):
        (line,) = (line for line in ax.lines if line.get_label() == name)
        drawn = np.asarray(line.get_xydata())
        rows = np.flatnonzero(~free)
        assert np.array_equal(
            drawn[np.isfinite(drawn).all(axis=1)], plan.path[rows[0] : rows[-1] + 2]
        )
        assert line.get_linestyle() == "--"
        assert name in [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert not any(
        line.get_label() == name for line in space.plot(path=plan.path).lines
    )  # rows carry no proofs


# ---- text and pictures ---------------------------------------------------------------------------


def test_repr_describes_a_plan_in_three_lines(plan: planners.Plan) -> None:
    lines = repr(plan).splitlines()
    assert len(lines) == 3 and all(len(line) < 160 for line in lines)
    assert f"{plan.planner}: path found, certified; {plan.length:.3f} m" in lines[0]
    assert f"{len(plan.waypoints)} waypoints ({', '.join(plan.axes)})" in lines[1]
    assert ("straight edges" if plan.drive == "holonomic" else plan.drive) in lines[1]


def test_repr_of_a_failed_plan_gives_a_hint() -> None:
    space, start, goal = build_halves("plane", BLOCKED)
    between = "from ({!r}, {!r}) to ({!r}, {!r}) (x, y)"
    lines = repr(planners.plan(space, start, goal)).splitlines()
    assert lines == ["Plan(Grid: no path exists: proven", f"     {between.format(*start, *goal)})"]
    start, goal = ENDPOINTS["plane"]
    plan = planners.plan(build_room("plane"), start, goal, planner="RRT", time_limit=1e-6)
    lines = [f"RRT: {plan.status}", between.format(*start, *goal), f"try {plan.hint}"]
    assert repr(plan).splitlines() == [f"Plan({lines[0]}", f"     {lines[1]}", f"     {lines[2]})"]


@pytest.mark.parametrize("name", SPACES)
def test_a_failed_plan_shows_and_writes_start_and_goal(name: str, tmp_path: Path) -> None:
    space, start, goal = build_halves(name, BLOCKED)
    plan = planners.plan(space, start, goal)
    assert not plan.solved and not plan.start.flags.writeable
    np.testing.assert_allclose([plan.start, plan.goal], [start, goal])
    assert list(collect_marks(space, plan, plan.path, None, None)) == ["start", "goal"]
    labels = [text.get_text() for text in plan.plot().figure.findobj(Text)]
    assert "start" in labels and "goal" in labels
    plt.close("all")
    plan.to_json(tmp_path / "plan.json")
    written = json.loads((tmp_path / "plan.json").read_text())
    assert [written["start"], written["goal"]] == [plan.start.tolist(), plan.goal.tolist()]
    assert (
        written["path"] == [] and written["length"] is None and written["is_disconnected"] is True
    )
    plan.to_csv(tmp_path / "path.csv")
    assert (tmp_path / "path.csv").read_text() == ",".join(space.axes) + "\n"
    units = {
        axis: "rad" if axis == "yaw" else "1" if axis[0] == "q" else "m" for axis in space.axes
    }
    assert dict(zip(plan.axes, plan.units, strict=True)) == units
    assert plan.units == space.units and (plan.length_unit, plan.distance_unit) == ("m", "m")
    again = pickle.loads(pickle.dumps(plan))
    np.testing.assert_array_equal([again.start, again.goal], [plan.start, plan.goal])


# ---- files ---------------------------------------------------------------------------------------


def test_a_path_is_read_back_exactly_from_csv(plan: planners.Plan, tmp_path: Path) -> None:
    plan.to_csv(tmp_path / "path.csv")
    with (tmp_path / "path.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    assert names == [*plan.axes, *(["direction"] if plan.direction is not None else [])]
    table = np.array(rows, dtype=float)
    assert np.array_equal(table[:, : len(plan.axes)], plan.path)
    assert plan.direction is None or np.array_equal(table[:, -1], plan.direction)


def test_a_plan_is_read_back_from_json(plan: planners.Plan, tmp_path: Path) -> None:
    plan.to_json(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    names = {field.name for field in fields(planners.Plan) if not field.name.startswith("_")}
    computed = ("clearance", "obstacle_distance", "lower_bound", "gap")
    assert set(record) == names - {"space"} | set(computed)
    assert [record.pop(name) for name in computed] == [getattr(plan, name) for name in computed]
    times = planners.Times(**record.pop("times"))
    arrays = {name: np.array(record.pop(name)) for name in ("path", "waypoints", "start", "goal")}
    direction, axes, units = (
        record.pop("direction"),
        tuple(record.pop("axes")),
        tuple(record.pop("units")),
    )
    again = planners.Plan(
        **arrays, axes=axes, units=units, direction=direction, times=times, **record
    )
    for name in arrays:
        np.testing.assert_array_equal(getattr(again, name), getattr(plan, name))
    assert times == plan.times and axes == plan.axes and units == plan.units
    assert len(units) == len(axes)
    assert direction == (None if plan.direction is None else plan.direction.tolist())
    for name in record:
        assert getattr(again, name) == getattr(plan, name)


@pytest.mark.parametrize("write", ["to_csv", "to_json"])
def test_an_existing_file_is_kept_unless_overwritten(
    plan: planners.Plan, tmp_path: Path, write: str
) -> None:
    file = tmp_path / "plan"
    file.write_text("mine")
    with pytest.raises(FileError, match="overwrite=True"):
        getattr(plan, write)(file)
    assert file.read_text() == "mine"
    getattr(plan, write)(file, overwrite=True)
    assert file.read_text() != "mine"
    with pytest.raises(FileError, match="not a folder"):
        getattr(plan, write)(tmp_path / "missing" / "plan")
    assert [each.name for each in tmp_path.iterdir()] == ["plan"]


def test_a_plan_draws_its_path_unless_it_has_lost_its_map(plan: planners.Plan) -> None:
    # Pickles keep no map.
    lines = {line.get_label(): line for line in plan.plot().lines}
    assert {"path", "start", "goal"} <= set(lines)
    np.testing.assert_array_equal(np.transpose(lines["start"].get_data())[0], plan.path[0, :2])
    again = pickle.loads(pickle.dumps(plan))
    np.testing.assert_array_equal(again.path, plan.path)
    assert (again.times, again.space) == (plan.times, None)
    with pytest.raises(InputError, match=r"plan has no map.*space.plot\(path=plan\)"):
        again.plot()


def test_a_plan_is_immutable(plan: planners.Plan) -> None:
    with pytest.raises(FrozenInstanceError):
        plan.solved = False  # type: ignore[misc]
    with pytest.raises(ValueError):
        plan.path[0, 0] = 3.0
