"""Time to a first solution in space, against the usual way: FCL in the callback, motions in steps."""

from __future__ import annotations

import itertools
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.soak.space_geometry import Blocks, merged_cells
from benchmarks.soak.space_pairs import NO_FCL, Pair, leaves_free, pair
from benchmarks.suites.planning import LIMIT, Query, check_paths, far_apart, our_setup, race, solve, tell, tell_made
from benchmarks.timing import Timing
from cspace import CSpace, Grid, Robot, Workspace

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

TUNNEL = "solids/ZTunnel"
TUNNEL_SPACING = 0.1
"""Metres."""

BUILDING = "voxels/geb079.bt"
DRONE = (0.6, 0.6, 0.2)
"""Sides of a box, metres."""

LEAST = 20.0

ALONG = 10_000
"""Places of each leg of a path that are looked at."""

NEAR = 0.5
"""Metres off a leg within which obstacles are looked at."""

TRIED = 1000
"""Configurations on which the peer's models are tried."""


def run(report: Report, seed: int) -> None:
    """RRTConnect with the same seeds and queries, the two in turns, in a tunnel and in a building."""
    try:
        import fcl  # noqa: F401 - whether it is there at all

        import planners  # noqa: F401
    except ImportError as error:
        report.note(f"skipped: {NO_FCL if error.name == 'fcl' else error}")
        return
    folder = inputs.data_folder()
    if folder is None:
        report.note(inputs.NO_DATA)
        return
    for name, problem in ((TUNNEL, _tunnel), (BUILDING, _building)):
        if (folder / name).exists():
            problem(report, folder / name, np.random.default_rng(seed))
        else:
            report.note(f"{name} skipped: not in the folder of real maps")


def _tunnel(report: Report, folder: Path, rng: np.random.Generator) -> None:
    """The problem as its file states it: boxes as a mesh, and a cube."""
    import trimesh
    import yaml

    problem = yaml.safe_load((folder / "problem.yaml").read_text(encoding="utf-8"))
    bounds = [*problem["bounds"]["lower"], *problem["bounds"]["upper"]]
    query = tuple(np.array(problem[end]["position"], dtype=np.float64) for end in ("start", "goal"))
    workspace = Workspace.from_mesh(folder / "obstacles.obj", TUNNEL_SPACING, bounds)
    mesh: Any = trimesh.load(folder / "obstacles.obj", force="mesh", process=True)
    boxes = Blocks.boxes([part.bounds for part in mesh.split()])
    cube = trimesh.load(folder / "robot.obj", force="mesh").bounds
    body = Blocks.boxes([cube])
    models = {"triangles": lambda: _triangles(np.asarray(mesh.vertices), np.asarray(mesh.faces))}
    _compare(report, TUNNEL, workspace, body, boxes, models, lambda space: [(query[0], query[1])])


def _building(report: Report, path: Path, rng: np.random.Generator) -> None:
    """A flat box among voxels; what the map does not know is occupied, or free."""
    for unknown in ("occupied",) if report.quick else ("occupied", "free"):
        _among_voxels(report, Workspace.from_octomap(path, unknown), f"{BUILDING}, unknown cells {unknown}", rng)


def _among_voxels(report: Report, workspace: Workspace, name: str, rng: np.random.Generator) -> None:
    grid = workspace.grid
    boxes = Blocks.boxes(np.asarray(grid.lower) + grid.spacing * merged_cells(workspace.outer))
    half = 0.5 * np.array(DRONE)
    skin = boxes.skin().triangles
    models: dict[str, Callable[[], Any]] = {
        "triangles of merged boxes": lambda: _triangles(skin.reshape(-1, 3), np.arange(3 * len(skin)).reshape(-1, 3))
    }
    try:
        import octomap  # noqa: F401 - whether it is there at all
    except ImportError:
        report.note("FCL's octree not tried: octomap is not installed; pip install octomap-python")
    else:
        models["octree"] = lambda: _octree(workspace.outer, grid)
    body = Blocks.boxes([[-half, half]])
    _compare(report, name, workspace, body, boxes, models, lambda space: far_apart(space, 3, rng))


def _compare(
    report: Report,
    name: str,
    workspace: Workspace,
    body: Blocks,
    boxes: Blocks,
    models: Mapping[str, Callable[[], Any]],
    choose: Callable[[CSpace], list[Query]],
) -> None:
    grid, (low, high) = workspace.grid, body.bounds
    robot = Robot.box(high - low, (low + high) / 2)
    cspace.build(workspace, robot)  # compiles
    began = time.perf_counter()
    space = cspace.build(workspace, robot)
    built = time.perf_counter() - began
    queries = choose(space)
    queries = queries[:1] if report.quick else queries
    seeds = 2 if report.quick else 10 if len(queries) > 1 else 30
    report.section(
        f"{name}: {' x '.join(map(str, grid.shape))} cells of {grid.spacing:g} m, box of "
        f"{' m x '.join(f'{side:g}' for side in high - low)} m, {len(queries)} queries, {seeds} seeds each"
    )
    what, collides, made = _fastest(report, space, body, models)
    setups = our_setup(space), _peer(space, body, collides)
    ours, sampled, plain, peer = race(
        [
            *(partial(_plan, space, planner) for planner in ("Cubes", "RRTConnect")),
            *(partial(solve, make) for make in setups),
        ],
        queries,
        seeds,
    )
    report.timing("ours, planners.plan, Cubes", ours)
    report.timing("ours, planners.plan, RRTConnect", sampled)
    report.timing("ours, planners.simple_setup and RRTConnect", plain)
    report.timing("OMPL with FCL, set-up and RRTConnect", peer)
    tell(report, "OMPL with FCL", ours, peer, queries, LEAST)
    report.ratio("OMPL with FCL / ours, RRTConnect", peer, sampled)
    report.ratio("OMPL with FCL / ours, planners.simple_setup", peer, plain)
    lengths = [_length(timing) for timing in (ours, sampled, peer)]
    report.note("median length of the paths: Cubes {:.1f} m, RRTConnect {:.1f} m, the peer {:.1f} m".format(*lengths))
    tell_made(report, ours, peer, built, made, what)
    check_paths(
        report, ours, peer, lambda path: _path_collides(body, boxes, grid, path), f"at {ALONG} places of each leg"
    )


def _length(timing: Timing) -> float:
    """Median length of the paths that were found, in metres."""
    paths = [path for path in timing.value if path is not None]
    return statistics.median(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in paths)


def _plan(space: CSpace, planner: str, query: Query, seed: int) -> tuple[float, Floats | None]:
    """Seconds until a first solution by our planning function, and the path; None where none was found."""
    import planners

    began = time.perf_counter()
    plan = planners.plan(space, *query, planner=planner, time_limit=LIMIT, simplify=False, seed=seed)
    taken = time.perf_counter() - began
    return taken, plan.path if plan.solved else None


def _triangles(vertices: Floats, faces: NDArray[np.integer]) -> Any:
    import fcl

    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    return model


def _octree(occupied: Bools, grid: Grid) -> Any:
    """Cells as an octree of FCL, whose leaves are as large as can be."""
    import fcl
    import octomap

    tree = octomap.OcTree(grid.spacing)
    tree.updateNodes(np.asarray(grid.lower) + grid.spacing * (np.argwhere(occupied) + 0.5), True, lazy_eval=True)
    tree.updateInnerOccupancy()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cells.bt"
        tree.writeBinary(str(path).encode())
        content = path.read_bytes()
    nodes = content[content.index(b"\ndata\n") + len(b"\ndata\n") :]
    return fcl.OcTree(grid.spacing, np.frombuffer(nodes, dtype=np.int8).tolist())


def _fastest(
    report: Report, space: CSpace, body: Blocks, models: Mapping[str, Callable[[], Any]]
) -> tuple[str, Callable[[Floats], bool], float]:
    """The fastest way to ask FCL, of all models of the obstacles and of the robot, and seconds to make the model.

    All must find the robot free where the map says FREE. Where triangles bound a solid that is larger than the robot,
    they do not tell that it lies within; a search that starts outside cannot get there in steps of half a cell.
    """
    import fcl

    q = space.sample_free(TRIED, np.random.default_rng(0))
    low, high = body.bounds
    middle = (low + high) / 2
    skin = body.skin().triangles
    robots = {
        "box": (fcl.Box(*(high - low)), middle),
        "triangles": (_triangles(skin.reshape(-1, 3), np.arange(3 * len(skin)).reshape(-1, 3)), np.zeros(3)),
    }
    found: list[tuple[float, str, Callable[[Floats], bool], float]] = []
    for what, make in models.items():
        began = time.perf_counter()
        obstacles = fcl.CollisionObject(make())
        made = time.perf_counter() - began
        for kind, (geometry, offset) in robots.items():
            collides = _asker(obstacles, fcl.CollisionObject(geometry), offset)
            began = time.perf_counter()
            wrong = sum(collides(place) for place in q)
            each = (time.perf_counter() - began) / len(q)
            report.note(f"FCL, {kind} against {what}: {each * 1e6:.3g} us for a FREE configuration")
            report.check(not wrong, f"{wrong} of {len(q)} FREE configurations collide by FCL, {kind} against {what}")
            found.append((each, f"{kind} against {what}", collides, made))
    _, name, collides, made = min(found, key=lambda each: each[0])
    return name, collides, made


def _asker(obstacles: Any, robot: Any, offset: Floats) -> Callable[[Floats], bool]:
    import fcl

    asked = fcl.CollisionRequest()

    def collides(place: Floats) -> bool:
        robot.setTranslation(place + offset)
        return bool(fcl.collide(robot, obstacles, asked, fcl.CollisionResult()))

    return collides


def _peer(space: CSpace, body: Blocks, collides: Callable[[Floats], bool]) -> Callable[[], Any]:
    """A plain OMPL script: FCL tells whether the robot is free, and motions are checked at half a cell."""
    from ompl import base as ob
    from ompl import geometric as og

    import planners

    low, high = body.bounds
    left, front, bottom = np.subtract(space.grid.lower, low).tolist()
    right, back, top = np.subtract(space.grid.upper, high).tolist()

    class Checker(ob.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            x, y, z = state[0], state[1], state[2]
            inside = left < x < right and front < y < back and bottom < z < top
            return inside and not collides(np.array((x, y, z)))

    def setup() -> Any:
        states = planners.state_space(space)
        made = og.SimpleSetup(states)
        si = made.getSpaceInformation()
        made.setStateValidityChecker(Checker(si))
        si.setStateValidityCheckingResolution(0.5 * space.grid.spacing / states.getMaximumExtent())
        return made

    return setup


def _path_collides(body: Blocks, boxes: Blocks, grid: Grid, path: Floats) -> bool:
    """Whether the robot meets boxes, or what lies around the grid, by exact distances along each leg."""
    low, high = body.bounds
    if (path + low <= grid.lower).any() or (path + high >= grid.upper).any():
        return True
    t = np.linspace(0.0, 1.0, ALONG)[:, None]
    for start, end in itertools.pairwise(path):
        first, last = np.minimum(start, end) + low - NEAR, np.maximum(start, end) + high + NEAR
        near = ((boxes.low <= last) & (boxes.high >= first)).all(axis=1)
        if not near.any():
            continue
        few = pair(body, Blocks.boxes(np.stack([boxes.low[near], boxes.high[near]], axis=1)))
        if not leaves_free(partial(_gaps_to_near, few), (start + t * (end - start))[None], 0.0).all():
            return True
    return False


def _gaps_to_near(few: Pair, q: Floats) -> Floats:
    """Distances from obstacles, of which those farther off than ``NEAR`` were left out."""
    return np.asarray(np.minimum(few.gaps(q), NEAR))
