"""Robots in space among obstacles, and FCL as a peer."""

from __future__ import annotations

import itertools
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import fcl
import numpy as np
import octomap
import trimesh
import yaml
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.planning_peers import PlanningPeer, Query, far_apart
from cspace import CSpace, Grid, Robot, Rotations, Workspace
from cspace._support.arrays import Bools, Floats, Ints
from tests.helpers.oracles import box_gaps
from tests.helpers.regions import Body
from tests.helpers.solids import rotation_of

FCL_CONFIGURATIONS = 2000
"""Number of configurations on which FCL's models are timed and the map is compared with FCL."""

POSITIONS_PER_LEG, EXACT_POSITIONS_PER_LEG = 200, 10_000
"""Number of positions on each leg of a path tested by FCL and by exact distances."""

TOP = ((-0.6, -0.4, 0.3), (0.6, 0.4, 0.35))
LEGS = [
    ((x - 0.03, y - 0.03, -0.35), (x + 0.03, y + 0.03, 0.31))
    for x in (-0.55, 0.55)
    for y in (-0.35, 0.35)
]
TABLE = np.array([TOP, *LEGS])
"""Boxes of a table of 1.2 m x 0.8 m x 0.7 m around its center, metres."""

ROOM_BOXES = np.array(
    [
        (
            (3.9, 0.0, 0.0),
            (4.1, 1.6, 2.5),
        ),  # the wall between two rooms, with a door of 0.8 m x 2 m
        ((3.9, 2.4, 0.0), (4.1, 4.0, 2.5)),
        ((3.9, 1.6, 2.0), (4.1, 2.4, 2.5)),
        ((1.5, 2.5, 0.0), (2.5, 3.5, 0.5)),  # a bench and a cupboard
        ((5.5, 0.0, 0.0), (6.5, 1.0, 1.8)),
    ]
)
ROOMS_BOUNDS = (0.0, 0.0, 0.0, 8.0, 4.0, 2.5)

HOOK = np.array([((-0.6, -0.1, -0.1), (0.6, 0.1, 0.1)), ((0.4, -0.1, 0.1), (0.6, 0.1, 0.3))])
"""Boxes of a rod of 1.2 m with a hook; metres."""

TRAP_BOUNDS = (-2.0, -2.0, -2.0, 4.0, 2.0, 2.0)
TRAP_WIDTHS = (0.9, 0.8, 0.7, 0.6, 0.5)
"""Widths of the rings of the tube that leads into the trap, metres."""

CUBE_TUNNEL, CUBE_SPACING = "solids/ZTunnel", 0.1
TUNNEL, TUNNEL_SPACING = "solids/LTunnel", 0.5
TUNNEL_ROBOTS = ("l-robot-skinny", "l-robot")
BUILDING, DRONE = "voxels/geb079.bt", (0.6, 0.6, 0.2)
"""Cells of the tunnels, and sides of the box that flies through the building, metres."""


@dataclass(frozen=True)
class Scene:
    """A robot in a workspace.

    Attributes
    ----------
    name : str
    workspace : Workspace
    robot : Robot
    body : Body
        The same robot, for FCL and an independent inside test.
    obstacles : Body
    models : mapping of str to callable
        Builders of FCL's models of the obstacles.
    queries : callable
        Draws starts and goals on the map.
    cuts : tuple of int
        Cells per axis of quaternions, for plans first and look-ups last; 0 for yaw; empty without
        rotation.
    seeds : int
        Number of searches for each query.
    boxes : tuple of ndarray, shape (n, 2, 3), optional
        Robot and obstacles, if both are boxes and the robot does not rotate.
    """

    name: str
    workspace: Workspace
    robot: Robot
    body: Body
    obstacles: Body
    models: Mapping[str, Callable[[], Any]]
    queries: Callable[[CSpace], list[Query]]
    cuts: tuple[int, ...] = ()
    seeds: int = 0
    boxes: tuple[Floats, Floats] | None = None

    @classmethod
    def of_boxes(
        cls,
        name: str,
        workspace: Workspace,
        robot: Floats,
        obstacles: Floats,
        models: Mapping[str, Callable[[], Any]],
        queries: Callable[[CSpace], list[Query]],
    ) -> Scene:
        """Return the scene of a translating box among boxes."""
        low, high = robot[0]
        title = f"{name}, box of {' m x '.join(f'{side:g}' for side in high - low)} m"
        skins = Body.boxes(robot), Body.boxes(obstacles)
        shape = Robot.box(high - low, (low + high) / 2)
        return cls(title, workspace, shape, *skins, models, queries, boxes=(robot, obstacles))

    def rotations(self, cuts: int) -> Rotations:
        """Return the rotation cells."""
        return Rotations.quaternions(cuts) if cuts else Rotations.of(72)


def rooms(quick: bool) -> Scene:
    """Return the scene of a table that passes a door only if tilted."""
    obstacles, body = Body.boxes(ROOM_BOXES), Body.boxes(TABLE)
    workspace = Workspace.from_mesh(_mesh(obstacles), 0.2 if quick else 0.1, ROOMS_BOUNDS)
    half = math.sqrt(0.5)
    query = np.array((1.2, 1.5, 0.4, 0, 0, 0, 1)), np.array((6.8, 2.5, 0.4, 0, 0, half, half))
    robot = Robot.from_mesh(_mesh(body), name="table")
    models = {"triangles": lambda: obstacles.model}
    cuts = (2,) if quick else (4, 12, 8)
    return Scene(
        "a table through a door",
        workspace,
        robot,
        body,
        obstacles,
        models,
        lambda space: [query],
        cuts,
        5,
    )


def trap(quick: bool) -> Scene:
    """Return the scene of a hook in a cube with a narrowing tube as exit."""
    obstacles, body = Body.boxes(_trap()), Body.boxes(HOOK)
    workspace = Workspace.from_mesh(_mesh(obstacles), 0.2 if quick else 0.1, TRAP_BOUNDS)
    half = math.sqrt(0.5)
    query = np.array((-0.3, 0, 0, 0, 0, half, half)), np.array((2.8, 0, 0, 0, 0, half, half))
    robot = Robot.from_mesh(_mesh(body), name="hook")
    models = {"triangles": lambda: obstacles.model}
    cuts = (2,) if quick else (4,)
    return Scene(
        "a bug trap", workspace, robot, body, obstacles, models, lambda space: [query], cuts, 6
    )


def _trap(
    half: float = 1.0, wall: float = 0.1, depth: float = 0.6, widths: Sequence[float] = TRAP_WIDTHS
) -> Floats:
    """Return boxes of a hollow cube with a tube of rings that leads inward."""
    far = half + wall
    boxes = [
        ((-far, -far, -far), (-half, far, far)),
        ((-half, -far, -far), (half, -half, far)),
        ((-half, half, -far), (half, far, far)),
        ((-half, -half, -far), (half, half, -half)),
        ((-half, -half, half), (half, half, far)),
        *_ring(half, far, widths[0], 2.0 * far),
    ]
    places = np.linspace(half, half - depth, len(widths) + 1)
    for (right, left), width in zip(itertools.pairwise(places), widths, strict=True):
        boxes += _ring(left, right, width, width + 2.0 * wall)
    return np.array(boxes)


def _ring(left: float, right: float, inner: float, outer: float) -> list[Any]:
    """Return four boxes around a square hole along x."""
    a, b = 0.5 * inner, 0.5 * outer
    return [
        ((left, -b, -b), (right, -a, b)),
        ((left, a, -b), (right, b, b)),
        ((left, -a, -b), (right, a, -a)),
        ((left, -a, a), (right, a, b)),
    ]


def cube_tunnel(report: Report) -> Iterator[Scene]:
    """Yield the scene of a cube in a tunnel of boxes."""
    folder = _data(report, CUBE_TUNNEL)
    if folder is None:
        return
    problem, bounds = _read_problem(folder)
    query = tuple(np.array(problem[end]["position"], dtype=np.float64) for end in ("start", "goal"))
    workspace = Workspace.from_mesh(folder / "obstacles.obj", CUBE_SPACING, bounds)
    mesh: Any = trimesh.load(folder / "obstacles.obj", force="mesh", process=True)
    boxes = np.array([part.bounds for part in mesh.split()])
    body = np.array([trimesh.load(folder / "robot.obj", force="mesh").bounds])
    surface = Body(np.asarray(mesh.triangles), np.full(len(mesh.faces), -1))
    models = {"triangles": lambda: surface.model}
    yield Scene.of_boxes(
        CUBE_TUNNEL, workspace, body, boxes, models, lambda space: [(query[0], query[1])]
    )


def tunnels(report: Report) -> Iterator[Scene]:
    """Yield the scenes of both L-shaped robots in a tunnel.

    Start and goal are free only if their three angles are intrinsic rotations about z, y and x; the
    quaternions of the file take them in the reverse order.
    """
    folder = _data(report, TUNNEL)
    if folder is None:
        return
    problem, bounds = _read_problem(folder)
    endpoints = []
    for end in ("start", "goal"):
        angles = Rotation.from_quat(problem[end]["quaternion_xyzw"]).as_euler("xyz")
        endpoints.append(
            np.array([*problem[end]["position"], *Rotation.from_euler("ZYX", angles).as_quat()])
        )
    workspace = Workspace.from_mesh(folder / "obstacles.obj", TUNNEL_SPACING, bounds)
    skins = {}
    for name in ("obstacles", *TUNNEL_ROBOTS):
        mesh: Any = trimesh.load(folder / f"{name}.obj", force="mesh", process=True)
        skins[name] = Body(
            np.asarray(mesh.triangles), _bodies(len(mesh.vertices), np.asarray(mesh.faces))
        )
    for name in TUNNEL_ROBOTS:
        yield Scene(
            f"{TUNNEL}, {name}",
            workspace,
            Robot.from_mesh(folder / f"{name}.obj"),
            skins[name],
            skins["obstacles"],
            {"triangles": lambda: skins["obstacles"].model},
            lambda space: [(endpoints[0], endpoints[1])],
            (4,),
            2
            if name == TUNNEL_ROBOTS[0]
            else 0,  # no planner finds a path of the thick robot in time
        )


def building(
    report: Report, rng: np.random.Generator, number: int, turns: bool, unknown: str
) -> Iterator[Scene]:
    """Yield the scene of a flat box among voxels, yawing if ``turns``."""
    path = _data(report, BUILDING)
    if path is None:
        return
    half, workspace = 0.5 * np.array(DRONE), Workspace.open(path, unknown=unknown)
    grid, body = workspace.grid, np.array([[-half, half]])
    boxes = np.asarray(grid.lower) + grid.spacing * inputs.merge_cells(workspace.outer)
    models = {
        "triangles of merged boxes": lambda: Body.boxes(boxes).model,
        "octree": partial(octree, workspace.outer, grid),
    }
    queries = partial(far_apart, number=number, rng=rng)
    name = f"{BUILDING}, unknown cells {unknown}"
    scene = Scene.of_boxes(name, workspace, body, boxes, models, queries)
    yield replace(scene, cuts=(0,), seeds=1, boxes=None) if turns else scene


def _data(report: Report, name: str) -> Path | None:
    """Return a path in the data folder, or None with a note."""
    path = (inputs.data_folder() or Path()) / name
    if path.exists():
        return path
    report.note(f"{name} skipped: not in the folder of real maps")
    return None


def _read_problem(folder: Path) -> tuple[Any, list[float]]:
    """Return a problem and its bounds."""
    problem = yaml.safe_load((folder / "problem.yaml").read_text(encoding="utf-8"))
    return problem, [*problem["bounds"]["lower"], *problem["bounds"]["upper"]]


class Fcl:
    """FCL as a peer of a scene, with the fastest of its models.

    Attributes
    ----------
    what : str
        Name of the model.
    made : float
        Seconds to build the model.
    seconds : float
        CPU time of one query.
    """

    def __init__(self, report: Report, scene: Scene, q: Floats) -> None:
        self.scene, self.asked = scene, fcl.CollisionRequest()
        self.corners = np.unique(scene.body.triangles.reshape(-1, 3), axis=0)
        reach = float(np.linalg.norm(self.corners, axis=1).max())
        grid = scene.workspace.grid
        self.box = np.asarray(grid.lower), np.asarray(grid.upper)
        self.deep = self.box[0] + reach, self.box[1] - reach
        robots = {"triangles": scene.body.model}
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        if scene.boxes is not None and np.allclose(low, -high):
            robots["box"] = fcl.CollisionObject(fcl.Box(*(high - low)))
        candidates = []
        for what, make in scene.models.items():
            began = time.perf_counter()
            self.obstacles = make()
            made = time.perf_counter() - began
            for kind, self.robot in robots.items():
                began = time.process_time()
                for each in q:
                    self.meets(each)
                taken = (time.process_time() - began) / len(q)
                report.note(f"FCL, {kind} against {what}: {1e6 * taken:.3g} us of CPU a query")
                candidates.append(
                    (taken, f"{kind} against {what}", made, self.robot, self.obstacles)
                )
        best = min(candidates, key=lambda each: each[0])
        self.seconds, self.what, self.made, self.robot, self.obstacles = best

    def peer(self) -> PlanningPeer:
        """Return FCL as a peer of planning."""
        boxed = self.scene.boxes is not None
        how = (
            f"by distances at {EXACT_POSITIONS_PER_LEG} places a leg"
            if boxed
            else f"at {POSITIONS_PER_LEG} places a leg"
        )
        collides = self._boxes_collide if boxed else self._path_collides
        return PlanningPeer("OMPL with FCL", self.is_free, collides, how, self.made, self.what)

    def meets(self, q: Any) -> bool:
        """Return True if surfaces meet or the robot leaves the grid."""
        x, y, z, *turn = q
        if turn:
            qx, qy, qz, qw = (
                turn
                if len(turn) == 4
                else (0.0, 0.0, math.sin(0.5 * turn[0]), math.cos(0.5 * turn[0]))
            )
            self.robot.setTransform(fcl.Transform((qw, qx, qy, qz), (x, y, z)))
        else:
            self.robot.setTranslation(np.array((x, y, z)))
        (left, front, low), (right, back, high) = self.deep
        if not (left < x < right and front < y < back and low < z < high):
            corners = self.corners @ np.transpose(self.robot.getRotation()) + (x, y, z)
            if (corners <= self.box[0]).any() or (corners >= self.box[1]).any():
                return True
        return bool(fcl.collide(self.robot, self.obstacles, self.asked, fcl.CollisionResult()))

    def collides(self, q: Any) -> bool:
        """Return True if surfaces meet or one solid contains the other."""
        if self.meets(q):
            return True
        body, obstacles = self.scene.body, self.scene.obstacles
        turn, place = rotation_of(q).as_matrix(), np.asarray(q[:3])
        inside = bool(obstacles.encloses(body.spots @ turn.T + place).any())
        return inside or bool(body.encloses((obstacles.spots - place) @ turn).any())

    def is_free(self, state: Any) -> bool:
        """Return True if the robot is free at a state of OMPL."""
        if not self.scene.cuts:
            return not self.meets((state[0], state[1], state[2]))
        if hasattr(state, "rotation"):
            turn = state.rotation()
            return not self.meets(
                (state.getX(), state.getY(), state.getZ(), turn.x, turn.y, turn.z, turn.w)
            )
        place = state[0]
        return not self.meets((place[0], place[1], place[2], state[1].value))

    def _path_collides(self, path: Floats) -> bool:
        legs = itertools.pairwise(path)
        return any(
            self.meets(q)
            for start, end in legs
            for q in along(start, end, np.linspace(0.0, 1.0, POSITIONS_PER_LEG))
        )

    def _boxes_collide(self, path: Floats) -> bool:
        """Return True if a path meets boxes or leaves the grid, by exact distances."""
        body, boxes = self.scene.boxes or ()
        low, high = body[0]
        if (path + low <= self.box[0]).any() or (path + high >= self.box[1]).any():
            return True
        t = np.linspace(0.0, 1.0, EXACT_POSITIONS_PER_LEG)[:, None]
        for start, end in itertools.pairwise(path):
            first, last = np.minimum(start, end) + low, np.maximum(start, end) + high
            near = boxes[((boxes[:, 0] <= last) & (boxes[:, 1] >= first)).all(axis=1)]
            at = start + t * (end - start)
            if any((box_gaps(at + low, at + high, *box) <= 0.0).any() for box in near):
                return True
        return False


def along(start: Floats, end: Floats, t: Floats) -> Floats:
    """Return configurations on a straight edge, at each t in [0, 1]."""
    first, last = rotation_of(start), rotation_of(end)
    places = start[:3] + t[:, None] * (end - start)[:3]
    turns = first * Rotation.from_rotvec(t[:, None] * (first.inv() * last).as_rotvec())
    return np.column_stack([places, turns.as_quat()])


def octree(occupied: Bools, grid: Grid) -> Any:
    """Convert cells to an octree of FCL with the largest possible leaves."""
    tree = octomap.OcTree(grid.spacing)
    tree.updateNodes(
        np.asarray(grid.lower) + grid.spacing * (np.argwhere(occupied) + 0.5), True, lazy_eval=True
    )
    tree.updateInnerOccupancy()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cells.bt"
        tree.writeBinary(str(path).encode())
        content = path.read_bytes()
    nodes = content[content.index(b"\ndata\n") + len(b"\ndata\n") :]
    return fcl.CollisionObject(
        fcl.OcTree(grid.spacing, np.frombuffer(nodes, dtype=np.int8).tolist())
    )


def _mesh(skin: Body) -> Any:
    return trimesh.Trimesh(
        skin.triangles.reshape(-1, 3), np.arange(3 * len(skin.triangles)).reshape(-1, 3)
    )


def _bodies(vertices: int, faces: Ints) -> Ints:
    """Label the connected part of each triangle."""
    edges = faces[:, [0, 1]].T, faces[:, [1, 2]].T
    first, last = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(len(first)), (first, last)), (vertices, vertices))
    return np.asarray(connected_components(graph, directed=False)[1][faces[:, 0]], dtype=np.int64)
