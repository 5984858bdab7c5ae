"""Units of all queries: in a world of twice the size, metres double, and all else stays.

Every public name of every class of spaces stands in one of the tables below, so that a new query
cannot be forgotten. Twice the size is exact in floating point, except for the geometry of arms.
"""

import inspect
import math
import re
from typing import Any, NamedTuple

import numpy as np
import pytest

import cspace
import planners
from cspace import Robot, Workspace
from cspace._interface import ConfigurationSpace
from cspace.errors import CspaceError
from planners._catalogue import planner_names
from tests.helpers.gates import certify_chunk, certify_twists
from tests.helpers.urdfs import joint, link, posed_box, write_urdf


class Case(NamedTuple):
    """A space, the size of its world, and free configurations at one rotation.

    Attributes
    ----------
    space : Space
    size : float
        Metres of a metre in the world of size 1.
    unit : float
        The same for the coordinates before the rotation: 1 in a map of joints.
    q0, q1 : tuple of float
    """

    space: Any
    size: float
    unit: float
    q0: tuple[float, ...]
    q1: tuple[float, ...]


# ---- the worlds ----------------------------------------------------------------------------------


def build_map(size, dim, robot, rotations=None, store=None):
    """Build a map of cells of 0.125 m with one obstacle."""
    occupied = np.zeros((24, 20, 12)[:dim], dtype=bool)
    occupied[(slice(11, 13), slice(0, 9))[:dim]] = True
    workspace = Workspace.from_array(occupied, 0.125 * size)
    tiles = {"store": store, "tile": 8} if store else {}
    return cspace.build(workspace, robot, rotations=rotations, **tiles)


def add_ends(space, size):
    """Return a case of a map, with ends on both sides of the obstacle."""
    turns = space.rotations.centers[0]
    ends = (0.8125, 1.6875, 0.8125), (2.1875, 1.6875, 0.8125)
    q0, q1 = ((*(size * np.array(end[: space.dim])), *turns) for end in ends)
    return Case(space, size, size, tuple(map(float, q0)), tuple(map(float, q1)))


def build_arm_space(size, folder):
    """Build the space of two bars of 0.5 m beside a post."""
    bar = ((0.5 * size, 0.0625 * size, 0.0625 * size), (0.25 * size, 0, 0))
    parts = link("foot"), link("upper", bar), link("fore", bar)
    joints = joint("shoulder", "foot", "upper"), joint("elbow", "upper", "fore", (0.5 * size, 0, 0))
    arm = cspace.Arm.from_urdf(write_urdf(folder, *parts, *joints))
    post = posed_box((0.125 * size,) * 3, 0.75 * size, 0.5 * size)
    return cspace.build_arm_space({"post": post}, arm)


def make_case(kind, size, folder):
    """Build the space of a kind in a world of a size."""
    folder = folder / str(size)
    folder.mkdir()
    plate = Robot.rectangle(0.375 * size, 0.25 * size)
    brick = Robot.box((0.375 * size, 0.25 * size, 0.125 * size))
    if kind == "plane":
        return add_ends(build_map(size, 2, plate), size)
    if kind == "tiled":
        return add_ends(build_map(size, 2, plate, store=folder / "tiles.zarr"), size)
    if kind == "plane with a yaw":
        return add_ends(build_map(size, 2, plate, 8), size)
    if kind == "space":
        return add_ends(build_map(size, 3, brick), size)
    if kind == "space with a yaw":
        return add_ends(build_map(size, 3, brick, 6), size)
    if kind == "SE(3)":
        return add_ends(build_map(size, 3, brick, cspace.Rotations.quaternions(1)), size)
    arm_space = build_arm_space(size, folder)
    ends = (-0.75, 0.5), (-0.25, 0.25)
    if kind == "arm":
        return Case(arm_space, size, 1.0, *ends)
    joint_map = cspace.build_joint_map(arm_space, 0.125)
    if kind == "joints from a file":
        joint_map.save(folder / "joints.zarr")
        joint_map = cspace.open(folder / "joints.zarr")
    return Case(joint_map, size, 1.0, *ends)


KINDS = (
    *("plane", "tiled", "plane with a yaw", "space", "space with a yaw", "SE(3)"),
    *("joints", "joints from a file", "arm"),
)
JOINTS = {"joints", "joints from a file"}

# ---- the queries ---------------------------------------------------------------------------------

METRES = {
    *("closest", "drawn_robot", "floor", "margin", "obstacle_distance", "padding"),
    *("path_obstacle_distance", "robot", "to_costmap", "to_occupancy_grid"),
}
"""Queries in metres of the workspace, whatever the coordinates are."""

COORDINATES = {
    *("bounds", "check_configuration", "check_endpoint", "clearance", "distance", "explain"),
    *("drawn_workspace", "find_goals", "free_region", "grid", "interpolate", "min_path_length"),
    *("nearest_free", "overview", "resolution", "sample_free", "search", "steps_between"),
    *("to_xarray", "window", "workspace"),
}
"""Queries in the unit of the coordinates before the rotation; an arm's clearance is in metres."""

UNCHANGED = {
    *("allowed_collisions", "arm", "axes", "cell_states", "certify_path", "classify"),
    *("compute_components", "contains_robot", "count", "dim", "dof", "edge_checker", "facts"),
    *("frame_id", "free_regions", "free_yaws", "has_poses", "is_connected", "is_disconnected"),
    *("is_free", "is_periodic", "max_velocity", "motion_is_free", "obstacles", "outside"),
    *("overlap_count", "overlap_counts", "path_exists", "periodic_axes", "point_checker"),
    *("progress", "removals", "rotations", "searches", "size", "slice_of", "slice_rotations"),
    *("states_at", "tile", "tries_exact", "unchecked", "units"),
}
"""Queries without a length: states, counts, angles and names."""

NUMBERS = {
    "arm": lambda c: c.space.arm.joints,
    "check_configuration": lambda c: c.space.check_configuration(c.q0)[: c.space.dim],
    "check_endpoint": lambda c: c.space.check_endpoint(c.q0, "q")[: c.space.dim],
    "classify": lambda c: c.space.classify([c.q0, c.q1]),
    "closest": lambda c: c.space.closest(c.q0).distance,
    "distance": lambda c: c.space.distance(np.array(c.q0), np.array(c.q1)),
    "drawn_robot": lambda c: c.space.drawn_robot.shape.span,
    "drawn_workspace": lambda c: c.space.drawn_workspace.grid.spacing,
    "edge_checker": lambda c: c.space.edge_checker()(*c.q0, *c.q1),
    "explain": lambda c: c.space.explain(c.q0, c.q1).margin,
    "facts": lambda c: [*c.space.facts],
    "find_goals": lambda c: np.array(c.space.find_goals(c.q1, c.q0, 0))[:, : c.space.dim],
    "free_region": lambda c: ask_region(c).bounds[1][: c.space.dim],
    "free_regions": lambda c: c.space.free_regions(0.3, reach=c.unit, max_regions=2).coverage,
    "free_yaws": lambda c: c.space.free_yaws(c.q0[: c.space.dim]),
    "grid": lambda c: (c.space.grid.spacing, *c.space.grid.lower, *c.space.grid.upper),
    "interpolate": lambda c: c.space.interpolate(*map(np.array, (c.q0, c.q1)), 0.5)[: c.space.dim],
    "max_velocity": lambda c: [*c.space.max_velocity.values()],
    "nearest_free": lambda c: c.space.nearest_free(c.q0)[: c.space.dim],
    "obstacles": lambda c: list(c.space.obstacles),
    "overlap_counts": lambda c: c.space.overlap_counts is None,
    "overview": lambda c: c.space.overview(100).grid.spacing,
    "padding": lambda c: list(c.space.padding.values()),
    "point_checker": lambda c: c.space.point_checker()(*c.q0),
    "robot": lambda c: c.space.robot.shape.span,
    "rotations": lambda c: repr(c.space.rotations),
    "sample_free": lambda c: c.space.sample_free(5, np.random.default_rng(1))[:, : c.space.dim],
    "search": lambda c: run_search(c)[:, : c.space.dim],
    "states_at": lambda c: c.space.states_at(c.q0[c.space.dim :]),
    "steps_between": lambda c: c.space.steps_between(np.array(c.q0), np.array(c.q1)),
    "to_costmap": lambda c: c.space.to_costmap().metadata.resolution,
    "to_occupancy_grid": lambda c: c.space.to_occupancy_grid().info.resolution,
    "to_xarray": lambda c: [c.space.to_xarray()[axis].values for axis in c.space.grid.axes],
    "window": lambda c: c.space.window(*np.sort([c.q0, c.q1], axis=0)).bounds,
    "workspace": lambda c: c.space.workspace.grid.spacing,
}
"""Numbers of queries that answer with an object, or need more than configurations."""


def ask(case, name):
    """Return the numbers of a query, asked of the ends of a case by the names of its arguments."""
    if name in NUMBERS:
        return NUMBERS[name](case)
    query = getattr(case.space, name)
    if not callable(query):
        return query
    first = dict.fromkeys(("q", "q0", "start"), case.q0)
    given = {**first, "q1": case.q1, "goal": case.q1, "path": [case.q0, case.q1]}
    taken = given.keys() & inspect.signature(query).parameters
    return query(**{each: given[each] for each in taken})


NO_QUERIES = {
    *("add_obstacle", "allow_collisions", "attach", "detach", "forbid_collisions", "set_padding"),
    *("remove_obstacle", "update", "export", "path", "plot", "save", "view"),
    *("exact", "keep", "subproblems"),
    "follow_line",  # a motion, whose pose is given
}
"""Calls that change, write or show."""

REFUSED = {
    "closest": JOINTS,
    "contains_robot": JOINTS,
    "explain": {"SE(3)"},
    "free_region": {"SE(3)", "tiled"},
    "free_regions": {"SE(3)", "tiled"},
    "free_yaws": {*KINDS} - {"plane with a yaw", "space with a yaw"},
    "obstacle_distance": {"joints from a file"},
    "removals": {"SE(3)"},
    "to_costmap": {"space", "space with a yaw", "SE(3)"} | JOINTS,
    "to_occupancy_grid": {"space", "space with a yaw", "SE(3)"} | JOINTS,
}
"""Kinds of spaces that refuse a query, in one line."""


def ask_region(case):
    """Return a region, of the yaw alone if there is one."""
    width = {"yaw_width": 0.1} if case.space.axes[-1] == "yaw" else {}
    return case.space.free_region(case.q0, reach=case.unit, **width)


def run_search(case):
    """Return the path of the first search of ours that plans in a space."""
    name = planners.choices(case.space).planners[len(planner_names())]
    return planners.plan(case.space, case.q0, case.q1, planner=name, time_limit=5.0).waypoints


# ---- the law -------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=KINDS)
def worlds(request, tmp_path_factory):
    """Build the same world in two sizes."""
    folder = tmp_path_factory.mktemp("worlds")
    return request.param, *(make_case(request.param, size, folder) for size in (1.0, 2.0))


def list_classes():
    """Return all classes of spaces of cspace."""
    assert cspace.CSpace and cspace.TiledCSpace and cspace.build_joint_map  # loaded at first use
    classes = [ConfigurationSpace]
    for parent in classes:
        classes += [
            each for each in parent.__subclasses__() if each.__module__.startswith("cspace")
        ]
    return classes


def list_names(*classes):
    """Return the public names of classes."""
    return {name for each in classes for name in dir(each) if not name.startswith("_")}


def test_every_query_stands_in_one_table(worlds):
    tables = METRES, COORDINATES, UNCHANGED, NO_QUERIES
    assert sum(map(len, tables)) == len(set().union(*tables))
    assert set().union(*tables) == list_names(*list_classes())
    assert type(worlds[1].space) in list_classes()


def flatten(answer):
    """Return an answer as numbers, or as it is."""
    if isinstance(answer, list | tuple):
        parts = [flatten(part) for part in answer]
        if all(isinstance(part, np.ndarray) for part in parts):
            return np.concatenate([np.empty(0), *parts])
        return answer
    is_number = not isinstance(answer, str) and np.asarray(answer).dtype.kind in "iufb"
    return np.ravel(answer).astype(float) if is_number else answer


def check_answers(name, kind, factor, small, large):
    """Check that a query answers in both worlds, with numbers that differ by a factor."""
    if kind in REFUSED.get(name, ()):
        for case in (small, large):
            with pytest.raises(CspaceError) as caught:
                ask(case, name)
            assert "\n" not in str(caught.value)
        return
    first, second = flatten(ask(small, name)), flatten(ask(large, name))
    if isinstance(first, np.ndarray):
        np.testing.assert_allclose(second, factor * first, rtol=1e-5, atol=1e-9, err_msg=name)
    else:
        assert first == second, name


def test_metres_double_with_the_world_and_all_else_stays(worlds):
    kind, small, large = worlds
    for name in sorted(list_names(type(small.space)) - NO_QUERIES):
        factor = 1.0
        if name in METRES or (kind == "arm" and name.startswith("clearance")):
            factor = 2.0
        elif name in COORDINATES:
            factor = large.unit
        check_answers(name, kind, factor, small, large)


def test_gates_prove_as_much_of_a_larger_world(worlds):
    kind, small, large = worlds
    answers = []
    for case in (small, large):
        turns = [0.01] * bool(case.space.rotations.names)
        tracking = [0.01 * case.unit] * case.space.dim + turns
        proven = certify_chunk(case.space, case.q0, [case.q1], tracking).proven
        if kind == "plane with a yaw":
            proven += certify_twists(case.space, case.q0, [(0.1 * case.size, 0.1)], 0.5).proven
        answers.append(proven)
    assert answers[0] == answers[1]


LENGTHS = re.compile(r"(\d[\d.]*(?:e-?\d+)?) (m|rad)\b")
"""Numbers with units in text."""


def list_lengths(text):
    """Return the numbers of metres and of radians in a text."""
    found = LENGTHS.findall(text)
    return [np.array([float(x) for x, unit in found if unit == want]) for want in ("m", "rad")]


def test_texts_name_the_unit_of_their_numbers(worlds):
    """Lengths of sentences and plans double if they are told in metres."""
    kind, small, large = worlds
    texts = [describe(case, kind) for case in (small, large)]
    (metres, radians), (double, same) = map(list_lengths, texts)
    # Three digits are printed.
    np.testing.assert_allclose(double, 2.0 * metres, rtol=0.02, atol=2e-3)
    np.testing.assert_allclose(same, radians, rtol=0.02, atol=2e-3)
    assert len(metres) and (len(radians) or kind not in JOINTS)


def describe(case, kind):
    """Return texts of a space that have lengths, without times."""
    plan = planners.plan(case.space, case.q0, case.q1, time_limit=2.0, seed=0)
    lines = [repr(case.space), *str(plan).splitlines()[:2]]
    lines += [
        f"{plan.obstacle_distance} m",
        f"{case.space.robot.shape.span} m" if kind in JOINTS else "",
    ]
    if not math.isnan(plan.clearance):
        lines.append(f"{plan.clearance} {plan.length_unit}")
    if hasattr(case.space, "explain") and kind != "SE(3)":
        lines += case.space.explain(case.q0, case.q1).sentences
    return "\n".join(lines)
