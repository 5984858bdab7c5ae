"""Users' jobs, one a process: ``python benchmarks/jobs.py NUMBER SIZE``, with the tree to measure first in PYTHONPATH.

Each line of the input runs the job once; the line of the output says its CPU time and its result as JSON. This
file imports nothing of this folder, so that it runs in the tree of another commit.
"""

from __future__ import annotations

import itertools
import json
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from PIL import Image
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace import CSpace, Robot, Workspace

SPACING = 0.05
"""Side of the cells of warehouses, metres."""

WAREHOUSE, QUICK_WAREHOUSE = (1006, 1674), (240, 320)
"""Cells of warehouses."""

NOTCHED = [(-0.3, -0.25), (0.4, -0.25), (0.4, 0.0), (0.05, 0.0), (0.05, 0.35), (-0.3, 0.35)]
"""Corners of a footprint without a symmetry, metres."""

YAW_CELLS = 72
PATIENCE = {"time_limit": 60.0}
"""Time limit of plans, seconds, so that a busy machine cuts none short."""

Run = Callable[[], str]
"""One run of a job, which returns its result as a text."""


def make_warehouse(quick: bool, shape: tuple[int, int] = WAREHOUSE) -> Workspace:
    """Make racks of 10 m x 2 m with aisles of 2.4 m between them, and pallets in the aisles."""
    shape = QUICK_WAREHOUSE if quick else shape
    rng = np.random.default_rng(0)
    occupied = np.zeros(shape, dtype=np.bool_)
    for x, y in itertools.product(range(60, shape[0] - 100, 248), range(60, shape[1] - 90, 88)):
        occupied[x : x + 200, y : y + 40] = True
    for x, y in rng.integers(0, np.array(shape) - 20, (occupied.size // 8000, 2)):
        occupied[x : x + 16, y : y + 20] = True
    return Workspace.from_array(occupied, SPACING)


def make_rooms(size: int) -> Workspace:
    """Make boxes in a cube of cells."""
    rng = np.random.default_rng(0)
    occupied = np.zeros((size,) * 3, dtype=np.bool_)
    for first in rng.integers(0, size - 16, (size // 2, 3)):
        occupied[tuple(slice(i, i + 16) for i in first)] = True
    return Workspace.from_array(occupied, 0.1)


def real_file(name: str) -> Path:
    """Return a file of the folder of real inputs."""
    return Path(os.environ["CSPACE_TEST_DATA"]) / name


def draw_free(space: CSpace, count: int, yaw: bool = False) -> Any:
    """Draw FREE configurations, in the same way on all commits."""
    rng = np.random.default_rng(1)
    lower, upper = np.array(space.grid.lower), np.array(space.grid.upper)
    q = rng.uniform(lower, upper, (20 * count + 500, len(lower)))
    if yaw:
        q = np.column_stack([q, rng.uniform(-np.pi, np.pi, len(q))])
    return q[space.is_free(q)][:count]


def draw_pairs(space: CSpace, count: int, yaw: bool = False) -> list[Any]:
    """Draw FREE starts and goals that are connected, at least a third of the map apart."""
    q = draw_free(space, 20 * count, yaw).reshape(-1, 2, 3 if yaw else 2)
    least = 0.3 * float(np.hypot(*(np.array(space.grid.upper) - space.grid.lower)))
    far = (pair for pair in q if np.hypot(*(pair[1] - pair[0])[:2]) > least)
    return list(itertools.islice((pair for pair in far if space.is_connected(*pair)), count))


# Builds and components


def build_in_space(robot: Robot, quick: bool) -> Iterator[Run]:
    workspace = make_rooms(64 if quick else 256)
    while True:
        yield lambda: f"{cspace.build(workspace, robot).count()} cells"


def build_with_yaw(quick: bool) -> Iterator[Run]:
    size = 200 if quick else 1000
    occupied = np.random.default_rng(0).random((size, size)) < 0.002
    workspace = Workspace.from_array(occupied, SPACING)
    robot = Robot.rectangle(0.9, 0.6, (0.15, 0.0))
    while True:
        yield lambda: f"{cspace.build(workspace, robot, rotations=YAW_CELLS).count()} cells"


def build_warehouse(quick: bool) -> CSpace:
    return cspace.build(make_warehouse(quick), Robot.polygon(NOTCHED), rotations=YAW_CELLS)


def count_cells(quick: bool) -> Iterator[Run]:
    space = build_warehouse(quick)
    while True:
        yield lambda: f"{space.count()} cells"


def label_components(quick: bool) -> Iterator[Run]:
    q = draw_free(build_warehouse(quick), 2, yaw=True)
    while True:
        space = build_warehouse(quick)
        yield lambda space=space: f"connected: {space.is_connected(*q)}"


def label_after_update(quick: bool) -> Iterator[Run]:
    space = build_warehouse(quick)
    q = draw_free(space, 2, yaw=True)
    for step in itertools.count():
        x, y = 3.0 + 0.1 * (step % 20), 6.0
        space.add_obstacle("crate", shapely.box(x, y, x + 0.6, y + 0.6))
        yield lambda: f"connected: {space.is_connected(*q)}"


# Plans


def plan_all(space: CSpace, pairs: list[Any], options: dict[str, Any]) -> str:
    plans = [planners.plan(space, *pair, **PATIENCE, **options) for pair in pairs]
    found = [plan for plan in plans if plan.certified]
    length = sum(plan.length for plan in found)
    return f"{len(found)} of {len(pairs)} paths, {length:.1f} m"


def plan_in_plane(name: str, robot: Robot, quick: bool) -> Iterator[Run]:
    workspace = Workspace.open(real_file(name)) if name else make_warehouse(quick)
    space = cspace.build(workspace, robot)
    pairs = draw_pairs(space, 2 if quick else 10)
    while True:
        yield lambda: plan_all(space, pairs, {})


def plan_across(quick: bool) -> Iterator[Run]:
    space = cspace.build(make_warehouse(quick, (4000, 4000)), Robot.disc(0.3))
    corners = space.nearest_free((0.5, 0.5)), space.nearest_free(np.array(space.grid.upper) - 0.5)
    while True:
        yield lambda: plan_all(space, [corners], {})


def plan_with_yaw(options: dict[str, Any], quick: bool) -> Iterator[Run]:
    space = build_warehouse(quick)
    pairs = draw_pairs(space, 1 if quick else 5, yaw=True)
    while True:
        yield lambda: plan_all(space, pairs, options)


def plan_to_rooms(kind: str, quick: bool) -> Iterator[Run]:
    space = build_warehouse(quick)
    pairs = draw_pairs(space, 1 if quick else 5, yaw=True)
    others = draw_free(space, 4000, yaw=True)

    def make_goal(q: Any) -> Any:
        if kind == "near":
            return planners.Near(q, 0.25, 0.3)
        if kind == "any yaw":
            return (*q[:2].tolist(), None)
        near = np.hypot(*(others - q)[:, :2].T)
        return [q, *others[np.argsort(near)[:2]]]

    goals = [(start, make_goal(goal)) for start, goal in pairs]
    while True:
        yield lambda: plan_all(space, goals, {})


def plan_from_previous(quick: bool) -> Iterator[Run]:
    space = build_warehouse(quick)
    (pair,) = draw_pairs(space, 1, yaw=True)
    plan = planners.plan(space, *pair, **PATIENCE)
    path = np.asarray(plan.path)
    for step in itertools.count():
        # A crate beside the middle of the path, which it blocks there alone.
        k = max(np.hypot(*np.diff(path[:, :2], axis=0).T).argmax(), 1)
        x, y = 0.5 * (path[k - 1] + path[k])[:2] + 0.02 * (step % 5)
        space.add_obstacle("crate", shapely.box(x, y, x + 0.3, y + 0.3))
        yield lambda: plan_all(space, [pair], {"previous": plan})


def time_straight(quick: bool) -> Iterator[Run]:
    space = cspace.build(
        Workspace.from_array(np.zeros((220, 60), dtype=bool), 0.1), Robot.disc(0.3)
    )
    plan = planners.plan(space, (1.0, 3.0), (19.0, 3.0))
    speeds = np.linspace(0.5, 2.0, 20 if quick else 200).tolist()

    def work() -> str:
        limits = {"max_acceleration": 0.5, "max_jerk": 1.0}
        motions = [plan.trajectory(max_velocity=speed, **limits) for speed in speeds]
        return f"{sum(motion.duration for motion in motions):.6f} s"

    while True:
        yield work


def drive_at_speed(make_workspace: Callable[[bool], Workspace], quick: bool) -> Iterator[Run]:
    """Drive 26 m at 10 Hz among six movers; each run is the first cycles of the same drive."""
    robot = Robot.rectangle(0.6, 0.4)
    drive = planners.Differential()
    limits = {"max_velocity": 0.8, "max_acceleration": 0.8}
    limits |= {"max_angular_velocity": 1.5, "max_angular_acceleration": 3.0}
    space = cspace.build(make_workspace(quick), robot, rotations=YAW_CELLS)
    pairs = draw_free(space, 4000, yaw=True).reshape(-1, 2, 3)
    distances = np.hypot(*(pairs[:, 1] - pairs[:, 0])[:, :2].T)
    for start, goal in pairs[np.abs(distances - (6.0 if quick else 22.0)) < 1.0]:
        route = planners.plan(space, start, goal, drive=drive)
        if route.certified:
            break
    # Movers sway across the way, away from its ends.
    path = route.path[:, :2]
    metres = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    shares = metres[-1] * np.linspace(0.25, 0.8, 6)
    places = np.column_stack([np.interp(shares, metres, column) for column in path.T])

    def work() -> str:
        space.update({f"mover {k}": None for k in range(6) if f"mover {k}" in space.obstacles})
        plan = planners.plan(space, start, start, drive=drive)
        motion = plan.trajectory(**limits)
        at = 0.1
        for step in range(5 if quick else 40):
            sway = 0.8 * np.sin(0.05 * step + np.arange(6))[:, np.newaxis]
            corners = places + sway * [0.6, 0.8]
            space.update(
                {
                    f"mover {k}": shapely.box(x - 0.2, y - 0.2, x + 0.2, y + 0.2)
                    for k, (x, y) in enumerate(corners.tolist())
                }
            )
            for q in motion.starts_after(at):
                again = {"drive": drive, "previous": plan}
                plan = planners.plan(space, q, goal, **again, **PATIENCE)
                new = plan.trajectory(**limits, after=motion, at=at)
                if not new.stop_reason:
                    break
            motion = new
        return f"{motion.duration:.1f} s to go"

    while True:
        yield work


# Queries


def query_one(name: str, form: Callable[[Any], Any], yaw: bool, quick: bool) -> Iterator[Run]:
    space = build_warehouse(quick) if yaw else cspace.build(make_warehouse(quick), Robot.disc(0.3))
    rows = draw_free(space, 101, yaw)
    ends = 2 if name == "motion_is_free" else 1
    asked = [tuple(map(form, rows[k : k + ends])) for k in range(100)] * 20

    def ask() -> str:
        query = getattr(space, name)
        return f"sum {sum(query(*each) for each in asked):.6g}"

    while True:
        yield ask


def query_edges(robot: Robot, yaw: bool, quick: bool) -> Iterator[Run]:
    options = {"rotations": YAW_CELLS} if yaw else {}
    space = cspace.build(make_warehouse(quick), robot, **options)
    q = draw_free(space, 2000 if quick else 20000, yaw)
    steps = np.random.default_rng(2).uniform(-1.0, 1.0, q.shape)
    while True:
        yield lambda: f"{np.count_nonzero(space.motion_is_free(q, q + steps))} free edges"


def query_batch(yaw: bool, in_order: bool, quick: bool) -> Iterator[Run]:
    disc = Robot.disc(0.3)
    space = build_warehouse(quick) if yaw else cspace.build(make_warehouse(quick), disc)
    lower, upper = np.array(space.grid.lower), np.array(space.grid.upper)
    rng = np.random.default_rng(0)
    q = rng.uniform(lower, upper, (10**5 if quick else 10**6, 2))
    if in_order:
        q = q[np.lexsort((q[:, 1], np.floor(q[:, 0] / SPACING)))]
    if yaw:
        q = np.column_stack([q, rng.uniform(-np.pi, np.pi, len(q))])
    while True:
        yield lambda: f"{np.count_nonzero(space.is_free(q))} free"


def bound_lengths(quick: bool) -> Iterator[Run]:
    space = cspace.build(make_warehouse(quick), Robot.disc(0.3))
    pairs = draw_pairs(space, 2 if quick else 10)
    while True:
        yield lambda: f"{sum(space.min_path_length(*pair) for pair in pairs):.1f} m"


def build_disc(quick: bool) -> Iterator[Run]:
    workspace = make_warehouse(quick)
    while True:
        yield lambda: f"{cspace.build(workspace, Robot.disc(0.3)).count()} cells"


def build_in_tiles(quick: bool) -> Iterator[Run]:
    workspace = make_warehouse(quick)
    with tempfile.TemporaryDirectory() as folder:
        for step in itertools.count():
            store = f"{folder}/{step}.zarr"

            def work(store: str = store) -> str:
                space = cspace.build(workspace, Robot.disc(0.3), store=store, tile=512)
                return f"{space.count()} cells"

            yield work


def move_six(quick: bool) -> Iterator[Run]:
    occupied = np.zeros((120, 60) if quick else (286, 423), dtype=np.bool_)
    robot = Robot.polygon(NOTCHED)
    space = cspace.build(Workspace.from_array(occupied, SPACING), robot, rotations=YAW_CELLS)
    corners = np.random.default_rng(0).uniform(0.5, 0.7 * np.array(space.grid.upper), (6, 2))
    for step in itertools.count():
        shift = 0.05 * (step % 20)
        movers = {
            f"mover {k}": shapely.box(x + shift, y, x + shift + 0.5, y + 0.4)
            for k, (x, y) in enumerate(corners.tolist())
        }

        def work(movers: dict[str, Any] = movers) -> str:
            try:
                space.update(movers)
            except (AttributeError, TypeError, ValueError):  # on older commits, one by one
                for name, shape in movers.items():
                    space.add_obstacle(name, shape)
            return f"{len(space.obstacles)} movers"

        yield work


def make_zones(quick: bool) -> Iterator[Run]:
    from cspace.lanes import RouteGraph, conflicts

    space = cspace.build(Workspace.open(real_file("maps/depot.yaml")), "rect:1.2x0.8", rotations=72)
    places = draw_free(space, 20 if quick else 99, yaw=True)[:, :2]
    gaps = np.linalg.norm(places[:, np.newaxis] - places, axis=-1)
    near = np.argsort(gaps, axis=1)[:, 1:3]
    pairs = np.unique([sorted((a, b)) for a, row in enumerate(near) for b in row], axis=0)
    graph = RouteGraph.from_arrays(places, pairs[:100], two_way=True)
    while True:
        found = conflicts(space, graph, margin=0.1)
        yield lambda found=found: f"{len(found.zones())} zones"


def print_plan(quick: bool) -> Iterator[Run]:
    pair = None
    while True:
        # What a print derives is kept with the workspace.
        workspace = Workspace.open(real_file("voxels/geb079.bt"))
        space = cspace.build(workspace, Robot.box((0.6, 0.6, 0.2)))
        if pair is None:
            q = draw_free(space, 200)
            pair = next(p for p in itertools.combinations(q, 2) if space.is_connected(*p))
        plan = planners.plan(space, *pair, **PATIENCE)
        yield lambda plan=plan: f"{len(str(plan).splitlines())} lines"


def build_on_floor(quick: bool) -> Iterator[Run]:
    scene = Workspace.open(real_file("voxels/geb079.bt"), unknown="free")
    base = Robot.from_balls([(0.0, 0.0, 0.3), (0.2, 0.0, 0.3), (0.0, 0.0, 0.7)], [0.3, 0.3, 0.15])
    while True:
        yield lambda: f"{cspace.build(scene, base, rotations=72, floor=0.0).count()}"


def save_and_open(quick: bool) -> Iterator[Run]:
    space = build_warehouse(quick)
    with tempfile.TemporaryDirectory() as folder:
        for step in itertools.count():
            path = Path(folder) / f"{step}.zarr"

            def work(path: Path = path) -> str:
                space.save(path)
                return f"{cspace.open(path).count()} cells"

            yield work


# Arms


def read_arm(name: str = "ur5", number: int = 1) -> tuple[Any, list[Any]]:
    """Read an arm, and a number of problems of each set: obstacles, and start and goal."""
    folder = real_file(f"arms/{name}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # open meshes
        arm = cspace.Arm.from_urdf(folder / f"{name}.urdf", folder / f"{name}.srdf")
    listed = json.loads((folder / "problems.json").read_text(encoding="utf-8"))
    order = [listed["joints"].index(name) for name in arm.joints]
    problems = []
    for rows in listed["problems"].values():
        for row in rows[:number]:
            ends = np.array([row["start"], row["goals"][0]])[:, order].clip(arm.lower, arm.upper)
            problems.append((row, ends))
    return arm, problems


def make_solids(row: dict[str, Any]) -> dict[str, Any]:
    """Make the obstacles of a problem."""
    makers: dict[str, Callable[[Any], Robot]] = {
        "box": lambda each: Robot.box(2.0 * np.array(each["half_extents"])),
        "cylinder": lambda each: Robot.cylinder(each["radius"], each["length"]),
        "sphere": lambda each: Robot.ball(each["radius"]),
    }
    solids = {}
    for kind, make in makers.items():
        for each in row[kind]:
            pose = np.eye(4)
            pose[:3, 3] = each["position"]
            turn = each.get("orientation_quat_xyzw", (0, 0, 0, 1))
            pose[:3, :3] = Rotation.from_quat(turn).as_matrix()
            solids[each["name"]] = cspace.arms.PosedShape(make(each).shape, pose)
    return solids


def set_up_arm(quick: bool) -> Iterator[Run]:
    def work() -> str:
        arm, problems = read_arm()
        return f"{make_arm_space(arm, problems[0][0]).arm.dof} joints"

    while True:
        yield work


def make_arm_space(arm: Any, row: dict[str, Any]) -> Any:
    return cspace.build_arm_space(make_solids(row), arm)


def change_scenes(name: str, quick: bool) -> Iterator[Run]:
    arm, problems = read_arm(name)
    make_arm_space(arm, problems[0][0])

    def work() -> str:
        spaces = [make_arm_space(arm, row) for row, _ in problems]
        return f"{sum(len(space.obstacles) for space in spaces)} obstacles"

    while True:
        yield work


def query_arm(quick: bool) -> Iterator[Run]:
    arm, problems = read_arm()
    space = make_arm_space(arm, problems[0][0])
    rng = np.random.default_rng(0)
    q = rng.uniform(arm.lower, arm.upper, (200 if quick else 5000, arm.dof))
    ends = (q + rng.normal(0.0, 0.1, q.shape)).clip(arm.lower, arm.upper)
    count = len(q) // 10

    def work() -> str:
        free = np.count_nonzero(space.is_free(q))
        edges = np.count_nonzero(space.motion_is_free(q[:count], ends[:count]))
        return f"{free} free, {edges} edges"

    while True:
        yield work


def query_arm_singly(name: str, form: Callable[[Any], Any], quick: bool) -> Iterator[Run]:
    arm, problems = read_arm(name)
    space = make_arm_space(arm, problems[0][0])
    rng = np.random.default_rng(0)
    q = rng.uniform(arm.lower, arm.upper, (100 if quick else 2000, arm.dof))
    ends = (q + rng.normal(0.0, 0.1, q.shape)).clip(arm.lower, arm.upper)
    pairs = [(form(start), form(end)) for start, end in zip(q, ends, strict=True)]

    def work() -> str:
        free = sum(space.is_free(start) for start, _ in pairs)
        edges = sum(space.motion_is_free(*pair) for pair in pairs)
        return f"{free} free, {edges} edges"

    while True:
        yield work


def prove_row(quick: bool) -> Iterator[Run]:
    space = build_warehouse(quick)
    rows = draw_free(space, 500, yaw=True)
    step = np.array([0.01, 0.0, 0.01])
    pairs = [(q, (q + step)[np.newaxis]) for q in rows]
    gate = cspace.Gate(space)
    while True:
        yield lambda: f"{sum(gate.check_rows(*pair).chunk.proven for pair in pairs)} rows"


def plan_arm(name: str, number: int, quick: bool) -> Iterator[Run]:
    arm, problems = read_arm(name, number)
    made = [(make_arm_space(arm, row), q) for row, q in problems[: 1 if quick else None]]
    spaces = [(space, q) for space, q in made if space.is_free(q).all()]

    def work() -> str:
        plans = [planners.plan(space, *q, seed=0, **PATIENCE) for space, q in spaces]
        found = [plan for plan in plans if plan.certified]
        return f"{len(found)} paths, {sum(plan.length for plan in found):.1f} rad"

    while True:
        yield work


# Files


def read_chain(quick: bool) -> Iterator[Run]:
    count = 500 if quick else 20000
    links = [f'<link name="link{n}"/>' for n in range(count + 1)]
    links.append(
        f'<link name="link{count + 1}"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
    )
    joints = [
        f'<joint name="joint{n}" type="fixed"><parent link="link{n}"/><child link="link{n + 1}"/></joint>'
        for n in range(count)
    ]
    joints.append(
        f'<joint name="last" type="revolute"><parent link="link{count}"/><child link="link{count + 1}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.urdf"
        path.write_text(f'<robot name="chain">{"".join(links + joints)}</robot>', encoding="utf-8")
        while True:
            yield lambda: f"{cspace.Arm.from_urdf(path).dof} joints"


def open_map(quick: bool) -> Iterator[Run]:
    name = "depot" if quick else "stata_basement"
    path = real_file(f"maps/{name}.yaml")
    while True:
        yield lambda: f"{Workspace.open(path).grid.shape} cells"


def read_image(quick: bool) -> Iterator[Run]:
    size = 500 if quick else 12000
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "floor.png"
        pixels = np.random.default_rng(0).random((size // 20, size // 20)) < 0.8
        Image.fromarray(255 * np.kron(pixels, np.ones((20, 20), dtype=np.uint8))).save(path)
        while True:
            yield lambda: f"{Workspace.open(path, spacing=SPACING).grid.shape} cells"


JOBS: dict[str, Callable[[bool], Iterator[Run]]] = {
    "build, R^3, 256^3, ball": partial(build_in_space, Robot.ball(0.5)),
    "build, R^3, 256^3, box": partial(build_in_space, Robot.box((1.0, 0.8, 0.6))),
    "build, SE(2), 1000^2 x 72": build_with_yaw,
    "components, warehouse x 72": label_components,
    "components after an update": label_after_update,
    "10 plans in the plane, warehouse": partial(plan_in_plane, "", Robot.disc(0.3)),
    "10 plans in the plane, stata_basement": partial(
        plan_in_plane, "maps/stata_basement.yaml", Robot.disc(0.3)
    ),
    "10 plans in the plane, maze512-32": partial(
        plan_in_plane, "movingai/maze512-32-0.map", Robot.disc(2.0)
    ),
    "a plan across a warehouse of 4000^2 cells": plan_across,
    "5 plans in SE(2), warehouse": partial(plan_with_yaw, {}),
    "5 plans in SE(2), near a goal": partial(plan_to_rooms, "near"),
    "5 plans in SE(2), any yaw": partial(plan_to_rooms, "any yaw"),
    "5 plans in SE(2), three goals": partial(plan_to_rooms, "three"),
    "5 plans in SE(2), differential": partial(plan_with_yaw, {"drive": planners.Differential()}),
    "5 plans in SE(2), Reeds-Shepp": partial(
        plan_with_yaw, {"drive": planners.Car(turning_radius=0.5, reverse=True)}
    ),
    "plan in SE(2) from a blocked previous one": plan_from_previous,
    "200 straight motions with limited jerk": time_straight,
    "40 cycles at 10 Hz, warehouse": partial(drive_at_speed, make_warehouse),
    "40 cycles at 10 Hz, Nav2's depot": partial(
        drive_at_speed, lambda _: Workspace.open(real_file("maps/depot.yaml"))
    ),
    "is_free of a tuple, plane, 2,000 times": partial(
        query_one, "is_free", lambda q: tuple(q.tolist()), False
    ),
    "is_free of a list, plane, 2,000 times": partial(
        query_one, "is_free", lambda q: q.tolist(), False
    ),
    "is_free of a row, plane, 2,000 times": partial(query_one, "is_free", np.asarray, False),
    "is_free of a row, SE(2), 2,000 times": partial(query_one, "is_free", np.asarray, True),
    "motion_is_free of rows, SE(2), 2,000 times": partial(
        query_one, "motion_is_free", np.asarray, True
    ),
    "clearance of a row, plane, 2,000 times": partial(query_one, "clearance", np.asarray, False),
    "20,000 edges in the plane": partial(query_edges, Robot.disc(0.3), False),
    "20,000 edges in SE(2)": partial(query_edges, Robot.polygon(NOTCHED), True),
    "20,000 edges in SE(2), rectangle": partial(query_edges, Robot.rectangle(0.9, 0.6), True),
    "is_free of 10^6 random points, plane": partial(query_batch, False, False),
    "is_free of 10^6 points in order, plane": partial(query_batch, False, True),
    "is_free of 10^6 random points, SE(2)": partial(query_batch, True, False),
    "10 lower bounds of lengths, warehouse": bound_lengths,
    "build, plane, disc": build_disc,
    "build, plane, disc, in tiles of 512^2": build_in_tiles,
    "count cells, warehouse x 72": count_cells,
    "move six obstacles, 286 x 423 x 72": move_six,
    "500 chunks of one row, SE(2)": prove_row,
    "zones of 200 lanes, depot": make_zones,
    "print(plan) on an OctoMap": print_plan,
    "build on a floor, OctoMap x 72": build_on_floor,
    "save and open, warehouse x 72": save_and_open,
    "UR5: read and set up": set_up_arm,
    "UR5: 5,000 configurations and 500 edges": query_arm,
    "UR5: seven more scenes": partial(change_scenes, "ur5"),
    "Panda: seven more scenes": partial(change_scenes, "panda"),
    "UR5: 2,000 configurations and edges, one by one": partial(
        query_arm_singly, "ur5", lambda q: tuple(q.tolist())
    ),
    "UR5: the same, as rows of an array": partial(query_arm_singly, "ur5", np.asarray),
    "Panda: 2,000 configurations and edges, as rows of an array": partial(
        query_arm_singly, "panda", np.asarray
    ),
    "Panda: the same, as lists": partial(query_arm_singly, "panda", lambda q: q.tolist()),
    "UR5: default plans, one of each set": partial(plan_arm, "ur5", 1),
    "Panda: default plans, two of each set": partial(plan_arm, "panda", 2),
    "read a URDF of 20,000 links": read_chain,
    "read a PNG of 12,000^2 pixels": read_image,
    "open a ROS map": open_map,
}
"""Jobs by name. Each yields calls to time, and prepares what is not timed between them."""


def main() -> None:
    """Run a job once for each line of the input."""
    # Packages may print; the answers have a file of their own.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    root = Path(os.environ["PYTHONPATH"])
    runs = list(JOBS.values())[int(sys.argv[1])](sys.argv[2] == "quick")
    for _ in sys.stdin:
        try:
            for package in (cspace, planners):
                if not Path(str(package.__file__)).is_relative_to(root):
                    raise ImportError(f"{package.__file__} is not in {root}")
            call = next(runs)
            cpu = time.process_time()
            value = call()
            answer = {"cpu_s": time.process_time() - cpu, "value": value}
        except Exception as error:  # the API of another commit differs in any way
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
