"""Problems of planning in every space, and the usual way to decide each: shapely, or FCL, one configuration a call."""

from __future__ import annotations

import itertools
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import fcl
import numpy as np
import shapely

from benchmarks import inputs
from benchmarks.report import Report
from cspace import CSpace, Grid, Robot, Workspace
from cspace.arrays import Bools, Floats
from tests import solids
from tests.soak.plane import placed, union_of_cells
from tests.soak.solids import Blocks, Pair, merged_cells

Query = tuple[Floats, Floats]

LIMIT = 60.0
"""Seconds that a search may take."""

RADII = {"maps/depot.yaml": 0.3, "movingai/Berlin_1_1024.map": 2.0}
"""Of discs, metres."""

LENGTH, WIDTH, ROTATIONS = 0.6, 0.4, 72
"""Sides of the rectangle that turns, metres, and its yaw cells."""

TUNNEL, TUNNEL_SPACING = "solids/ZTunnel", 0.1
BUILDING, DRONE = "voxels/geb079.bt", (0.6, 0.6, 0.2)
"""Cells of the tunnel and sides of the box that flies through the building, metres."""

ALONG = 10_000
"""Places of each leg of a path in space that are looked at."""

ASKED = fcl.CollisionRequest()
TRIED = 1000
"""Configurations on which FCL's models are tried."""


@dataclass(frozen=True)
class Peer:
    """Another library's answers.

    Attributes
    ----------
    name : str
    is_free : callable
        Whether the robot is free at one of OMPL's states.
    collides : callable
        Whether a path collides, found out as ``how`` says.
    how : str
    made : float
        Seconds that it takes to make ``what`` it needs of the map.
    what : str
    """

    name: str
    is_free: Callable[[Any], bool]
    collides: Callable[[Floats], bool]
    how: str
    made: float
    what: str


@dataclass(frozen=True)
class Problem:
    """A robot in a workspace, and start and goal of each search.

    Attributes
    ----------
    name : str
    workspace : Workspace
    robot : Robot
    rotations : int or None
    peer : callable
        Makes the peer.
    queries : callable
        From the map to starts and goals.
    least : float
        Target of how many times longer the peer takes.
    """

    name: str
    workspace: Workspace
    robot: Robot
    rotations: int | None
    peer: Callable[[Report, CSpace], Peer]
    queries: Callable[[CSpace], list[Query]]
    least: float


def problems(report: Report, rng: np.random.Generator) -> Iterator[Problem]:
    """Those whose maps and peers are there; what is missing is noted."""
    far = partial(far_apart, number=3, rng=rng)
    for name, radius in RADII.items():
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(f"{name} skipped: not in the folder of real maps")
            continue
        disc = partial(_disc, radius=radius)
        queries = far if name.endswith("yaml") else _from_scenarios
        yield Problem(f"{name}, disc of {radius:g} m", workspace, Robot.disc(radius), None, disc, queries, 10.0)
        if name.endswith("yaml"):
            title = f"{name}, rectangle of {LENGTH:g} m x {WIDTH:g} m"
            yield Problem(title, workspace, Robot.rectangle(LENGTH, WIDTH), ROTATIONS, _rectangle, far, 10.0)
    folder = inputs.data_folder() or Path()
    for name, problem in ((TUNNEL, _tunnel), (BUILDING, partial(_building, queries=far, quick=report.quick))):
        if (folder / name).exists():
            yield from problem(folder / name)
        else:
            report.note(f"{name} skipped: not in the folder of real maps")


# ---- start and goal --------------------------------------------------------------------------------------------------


def far_apart(space: CSpace, number: int, rng: np.random.Generator) -> list[Query]:
    """Random FREE pairs that a path joins, no straight edge does, and half the map's diagonal lies between."""
    least = 0.5 * np.linalg.norm(np.subtract(space.grid.upper, space.grid.lower))
    draws = 5_000 if space.rotations.dof else 20_000
    starts, goals = space.sample_free(draws, rng), space.sample_free(draws, rng)
    fit = np.linalg.norm((starts - goals)[:, : space.grid.dim], axis=1) >= least
    fit &= (space.path_exists(starts, goals) == True) & ~space.motion_is_free(starts, goals)  # noqa: E712 - of objects
    if fit.sum() < number:
        raise RuntimeError(f"only {fit.sum()} of {draws} random pairs are far apart, joined and out of sight")
    return list(zip(starts[fit][:number], goals[fit][:number], strict=True))


def _from_scenarios(space: CSpace, number: int = 3) -> list[Query]:
    """The longest problems of the map's scenario file that the disc can solve."""
    rows = np.loadtxt(space.workspace.source + ".scen", skiprows=1, usecols=(4, 5, 6, 7, 8))
    queries: list[Query] = []
    for x0, y0, x1, y1, _ in rows[np.argsort(-rows[:, 4], kind="stable")]:
        # Rows are counted from the top of the map.
        start, goal = (np.array([x + 0.5, space.grid.shape[1] - y - 0.5]) for x, y in ((x0, y0), (x1, y1)))
        if space.path_exists(start, goal) is True and not space.motion_is_free(start, goal):
            queries.append((start, goal))
            if len(queries) == number:
                break
    return queries


# ---- the plane: shapely ----------------------------------------------------------------------------------------------


def _polygons(workspace: Workspace) -> tuple[Any, float]:
    """The obstacles, prepared, and the seconds that it took."""
    began = time.perf_counter()
    obstacles = union_of_cells(workspace.outer, workspace.grid)
    shapely.prepare(obstacles)
    return obstacles, time.perf_counter() - began


def _disc(report: Report, space: CSpace, radius: float) -> Peer:
    (left, low), (right, high) = space.grid.lower, space.grid.upper
    obstacles, made = _polygons(space.workspace)

    def is_free(state: Any) -> bool:
        x, y = state[0], state[1]
        inside = left + radius < x < right - radius and low + radius < y < high - radius
        return inside and not shapely.dwithin(obstacles, shapely.Point(x, y), radius)

    def collides(path: Floats) -> bool:
        return bool(shapely.dwithin(obstacles, shapely.LineString(path), radius))

    how = "by the whole path's exact distance"
    return Peer("OMPL with prepared shapely", is_free, collides, how, made, "polygons")


def _rectangle(report: Report, space: CSpace) -> Peer:
    (left, low), (right, high) = space.grid.lower, space.grid.upper
    obstacles, made = _polygons(space.workspace)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [LENGTH / 2, WIDTH / 2]
    outline, footprint = corners.tolist(), shapely.Polygon(corners)

    def is_free(state: Any) -> bool:
        cosine, sine = math.cos(state.getYaw()), math.sin(state.getYaw())
        x, y = state.getX(), state.getY()
        points = [(x + cosine * a - sine * b, y + sine * a + cosine * b) for a, b in outline]
        if not all(left < px < right and low < py < high for px, py in points):
            return False
        return not obstacles.intersects(shapely.Polygon(points))

    def collides(path: Floats) -> bool:
        for start, goal in itertools.pairwise(path):
            change = goal - start
            change[2] = (change[2] + np.pi) % (2 * np.pi) - np.pi  # the shorter way round
            moved = np.hypot(*change[:2]) + abs(change[2]) * np.hypot(*corners[0])
            q = start + np.linspace(0, 1, 2 + int(moved / 0.002))[:, None] * change
            if shapely.intersects(obstacles, placed(footprint, q)).any():
                return True
        return False

    return Peer("OMPL with prepared shapely", is_free, collides, "looked at every 2 mm", made, "polygons")


# ---- space: FCL ------------------------------------------------------------------------------------------------------


def _tunnel(folder: Path) -> Iterator[Problem]:
    """The problem as its file states it: boxes as a mesh, and a cube."""
    import trimesh
    import yaml

    problem = yaml.safe_load((folder / "problem.yaml").read_text(encoding="utf-8"))
    bounds = [*problem["bounds"]["lower"], *problem["bounds"]["upper"]]
    query = tuple(np.array(problem[end]["position"], dtype=np.float64) for end in ("start", "goal"))
    workspace = Workspace.from_mesh(folder / "obstacles.obj", TUNNEL_SPACING, bounds)
    mesh: Any = trimesh.load(folder / "obstacles.obj", force="mesh", process=True)
    boxes = Blocks.boxes([part.bounds for part in mesh.split()])
    body = Blocks.boxes([trimesh.load(folder / "robot.obj", force="mesh").bounds])
    models = {"triangles": lambda: solids.surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))}
    yield _flight(TUNNEL, workspace, body, boxes, models, lambda space: [(query[0], query[1])])


def _building(path: Path, queries: Callable[[CSpace], list[Query]], quick: bool) -> Iterator[Problem]:
    """A flat box among voxels; what the map does not know is occupied, or free."""
    half = 0.5 * np.array(DRONE)
    for unknown in ("occupied",) if quick else ("occupied", "free"):
        workspace = Workspace.from_octomap(path, unknown)
        grid = workspace.grid
        boxes = Blocks.boxes(np.asarray(grid.lower) + grid.spacing * merged_cells(workspace.outer))
        models = {
            "triangles of merged boxes": boxes.skin().model,
            "octree": partial(octree, workspace.outer, grid),
        }
        name = f"{BUILDING}, unknown cells {unknown}"
        yield _flight(name, workspace, Blocks.boxes([[-half, half]]), boxes, models, queries)


def _flight(
    name: str,
    workspace: Workspace,
    body: Blocks,
    boxes: Blocks,
    models: Mapping[str, Callable[[], Any]],
    queries: Callable[[CSpace], list[Query]],
) -> Problem:
    """A box in space, whose obstacles are boxes too, so that paths are checked by exact distances."""
    low, high = body.bounds
    title = f"{name}, box of {' m x '.join(f'{side:g}' for side in high - low)} m"
    peer = partial(_fcl, body=body, boxes=boxes, models=models)
    return Problem(title, workspace, Robot.box(high - low, (low + high) / 2), None, peer, queries, 20.0)


def _fcl(report: Report, space: CSpace, body: Blocks, boxes: Blocks, models: Mapping[str, Callable[[], Any]]) -> Peer:
    """The fastest way to ask FCL, of all models of the obstacles and of the robot.

    All must find the robot free where the map says FREE. Where triangles bound a solid that is larger than the robot,
    they do not tell that it lies within; a search that starts outside cannot get there in steps of half a cell.
    """
    q = space.sample_free(TRIED, np.random.default_rng(0))
    low, high = body.bounds
    robots = {
        "box": (fcl.CollisionObject(fcl.Box(*(high - low))), (low + high) / 2),
        "triangles": (body.skin().model(), np.zeros(3)),
    }
    candidates: list[tuple[float, str, Callable[[Floats], bool], float]] = []
    for what, make in models.items():
        began = time.perf_counter()
        try:
            obstacles = make()
        except ImportError as error:
            report.note(f"FCL's {what} not tried: {error}")
            continue
        made = time.perf_counter() - began
        for kind, (robot, offset) in robots.items():
            meets = partial(_meets, obstacles, robot, offset)
            began = time.perf_counter()
            wrong = sum(meets(place) for place in q)
            each = (time.perf_counter() - began) / len(q)
            report.note(f"FCL, {kind} against {what}: {each * 1e6:.3g} us for a FREE configuration")
            report.check(not wrong, f"{wrong} of {len(q)} FREE configurations collide by FCL, {kind} against {what}")
            candidates.append((each, f"{kind} against {what}", meets, made))
    _, name, meets, made = min(candidates, key=lambda each: each[0])
    left, front, bottom = np.subtract(space.grid.lower, low).tolist()
    right, back, top = np.subtract(space.grid.upper, high).tolist()

    def is_free(state: Any) -> bool:
        x, y, z = state[0], state[1], state[2]
        inside = left < x < right and front < y < back and bottom < z < top
        return inside and not meets(np.array((x, y, z)))

    collides = partial(_path_collides, body, boxes, space.grid)
    return Peer("OMPL with FCL", is_free, collides, f"at {ALONG} places of each leg", made, name)


def octree(occupied: Bools, grid: Grid) -> Any:
    """Return cells as an octree of FCL with the largest possible leaves."""
    import octomap

    tree = octomap.OcTree(grid.spacing)
    tree.updateNodes(np.asarray(grid.lower) + grid.spacing * (np.argwhere(occupied) + 0.5), True, lazy_eval=True)
    tree.updateInnerOccupancy()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cells.bt"
        tree.writeBinary(str(path).encode())
        content = path.read_bytes()
    nodes = content[content.index(b"\ndata\n") + len(b"\ndata\n") :]
    return fcl.CollisionObject(fcl.OcTree(grid.spacing, np.frombuffer(nodes, dtype=np.int8).tolist()))


def _meets(obstacles: Any, robot: Any, offset: Floats, place: Floats) -> bool:
    robot.setTranslation(place + offset)
    return bool(fcl.collide(robot, obstacles, ASKED, fcl.CollisionResult()))


def _path_collides(body: Blocks, boxes: Blocks, grid: Grid, path: Floats) -> bool:
    """Whether the robot meets boxes, or what lies around the grid, by exact distances along each leg."""
    low, high = body.bounds
    if (path + low <= grid.lower).any() or (path + high >= grid.upper).any():
        return True
    t = np.linspace(0.0, 1.0, ALONG)[:, None]
    for start, end in itertools.pairwise(path):
        first, last = np.minimum(start, end) + low, np.maximum(start, end) + high
        near = ((boxes.low <= last) & (boxes.high >= first)).all(axis=1)
        few = Blocks.boxes(np.stack([boxes.low[near], boxes.high[near]], axis=1))
        if near.any() and (Pair.of(body, few).gaps(start + t * (end - start)) <= 0.0).any():
            return True
    return False
