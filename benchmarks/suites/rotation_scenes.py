"""Robots that turn in space among obstacles, and FCL's answers for them, one configuration a call."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import fcl
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.planning_peers import BUILDING, DRONE, Query, far_apart, octree
from cspace import CSpace, Robot, Rotations, Workspace
from cspace.arrays import Floats, Ints
from tests.soak.solids import Blocks, Skin, matrix_of, merged_cells

TRIED = 2000
"""Configurations on which FCL's models are timed and the map is compared with FCL."""

TOP = ((-0.6, -0.4, 0.3), (0.6, 0.4, 0.35))
LEGS = [((x - 0.03, y - 0.03, -0.35), (x + 0.03, y + 0.03, 0.31)) for x in (-0.55, 0.55) for y in (-0.35, 0.35)]
TABLE = np.array([TOP, *LEGS])
"""Boxes of a table of 1.2 m x 0.8 m x 0.7 m, about its middle; metres."""

ROOMS = np.array(
    [
        ((3.9, 0.0, 0.0), (4.1, 1.6, 2.5)),  # the wall between two rooms, with a door of 0.8 m x 2 m
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
"""Of the tube that leads into the trap, ring by ring; metres."""

TUNNEL, TUNNEL_SPACING = "solids/LTunnel", 0.5
TUNNEL_ROBOTS = ("l-robot-skinny", "l-robot")


@dataclass(frozen=True)
class Scene:
    """A robot in a workspace.

    Attributes
    ----------
    name : str
    workspace : Workspace
    robot : Robot
    body : Skin
        The same robot, for FCL and an inside test that shares no code with the library.
    obstacles : Skin
    models : mapping of str to callable
        FCL's models of the obstacles.
    cuts : tuple of int
        Of quaternions: plans are made with the first, look-ups with the last; 0 for yaw.
    queries : callable
        From the map to starts and goals.
    seeds : int
        Of the searches for each of them; 0 for none.
    """

    name: str
    workspace: Workspace
    robot: Robot
    body: Skin
    obstacles: Skin
    models: Mapping[str, Callable[[], Any]]
    cuts: tuple[int, ...]
    queries: Callable[[CSpace], list[Query]]
    seeds: int

    def rotations(self, cuts: int) -> Rotations:
        """Rotation cells."""
        return Rotations.quaternions(cuts) if cuts else Rotations.of(72)


def rooms(quick: bool) -> Scene:
    """A table through the door of a flat, which it passes only when it is tipped."""
    obstacles, body = Blocks.boxes(ROOMS).skin(), Blocks.boxes(TABLE).skin()
    workspace = Workspace.from_mesh(_mesh(obstacles), 0.2 if quick else 0.1, ROOMS_BOUNDS)
    half = math.sqrt(0.5)
    query = np.array((1.2, 1.5, 0.4, 0, 0, 0, 1)), np.array((6.8, 2.5, 0.4, 0, 0, half, half))
    robot = Robot.mesh(_mesh(body), name="table")
    models = {"triangles": obstacles.model}
    cuts = (2,) if quick else (4, 12, 8)
    return Scene("a table through a door", workspace, robot, body, obstacles, models, cuts, lambda space: [query], 5)


def trap(quick: bool) -> Scene:
    """A rod with a hook in a hollow cube, whose only way out is a tube that narrows inward: a trap for trees."""
    obstacles, body = Blocks.boxes(_trap()).skin(), Blocks.boxes(HOOK).skin()
    workspace = Workspace.from_mesh(_mesh(obstacles), 0.2 if quick else 0.1, TRAP_BOUNDS)
    half = math.sqrt(0.5)
    query = np.array((-0.3, 0, 0, 0, 0, half, half)), np.array((2.8, 0, 0, 0, 0, half, half))
    robot = Robot.mesh(_mesh(body), name="hook")
    models = {"triangles": obstacles.model}
    cuts = (2,) if quick else (4,)
    return Scene("a bug trap", workspace, robot, body, obstacles, models, cuts, lambda space: [query], 6)


def _trap(half: float = 1.0, wall: float = 0.1, depth: float = 0.6, widths: Sequence[float] = TRAP_WIDTHS) -> Floats:
    """Boxes of a cube whose side at the right has a hole, from which a tube leads inward, ring by ring."""
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
    """Four boxes around a square hole along x."""
    a, b = 0.5 * inner, 0.5 * outer
    return [
        ((left, -b, -b), (right, -a, b)),
        ((left, a, -b), (right, b, b)),
        ((left, -a, -b), (right, a, -a)),
        ((left, -a, a), (right, a, b)),
    ]


def tunnels(report: Report) -> Iterator[Scene]:
    """The problem as its file states it, with both L-shaped robots.

    Its three angles leave start and goal free only if read as turns about z, y and x, each about the axis as the ones
    before have left it; the file's own quaternions take them the other way round.
    """
    import trimesh
    import yaml

    folder = (inputs.data_folder() or Path()) / TUNNEL
    if not folder.exists():
        report.note(f"{TUNNEL} skipped: not in the folder of real maps")
        return
    problem = yaml.safe_load((folder / "problem.yaml").read_text(encoding="utf-8"))
    bounds = [*problem["bounds"]["lower"], *problem["bounds"]["upper"]]
    endpoints = []
    for end in ("start", "goal"):
        angles = Rotation.from_quat(problem[end]["quaternion_xyzw"]).as_euler("xyz")
        endpoints.append(np.array([*problem[end]["position"], *Rotation.from_euler("ZYX", angles).as_quat()]))
    workspace = Workspace.from_mesh(folder / "obstacles.obj", TUNNEL_SPACING, bounds)
    skins = {}
    for name in ("obstacles", *TUNNEL_ROBOTS):
        mesh: Any = trimesh.load(folder / f"{name}.obj", force="mesh", process=True)
        skins[name] = Skin(np.asarray(mesh.triangles), _bodies(len(mesh.vertices), np.asarray(mesh.faces)))
    for name in TUNNEL_ROBOTS:
        yield Scene(
            f"{TUNNEL}, {name}",
            workspace,
            Robot.mesh(folder / f"{name}.obj"),
            skins[name],
            skins["obstacles"],
            {"triangles": skins["obstacles"].model},
            (4,),
            lambda space: [(endpoints[0], endpoints[1])],
            2 if name == TUNNEL_ROBOTS[0] else 0,  # no way finds a path of the stout one within the time
        )


def building(report: Report, rng: np.random.Generator, quick: bool) -> Scene | None:
    """A flat box that yaws among voxels."""
    path = (inputs.data_folder() or Path()) / BUILDING
    if not path.exists():
        report.note(f"{BUILDING} skipped: not in the folder of real maps")
        return None
    half, workspace = 0.5 * np.array(DRONE), Workspace.from_octomap(path)
    grid = workspace.grid
    boxes = Blocks.boxes(np.asarray(grid.lower) + grid.spacing * merged_cells(workspace.outer)).skin()
    models = {
        "triangles of merged boxes": boxes.model,
        "octree": partial(octree, workspace.outer, grid),
    }
    queries = partial(far_apart, number=1 if quick else 3, rng=rng)
    name = f"{BUILDING}, box of {' m x '.join(map(str, DRONE))} m"
    return Scene(
        name, workspace, Robot.box(DRONE), Blocks.boxes([[-half, half]]).skin(), boxes, models, (0,), queries, 1
    )


class Fcl:
    """FCL's answers for a scene, by the fastest of its models.

    Attributes
    ----------
    what : str
        The model.
    made : float
        Seconds that it takes to make it.
    seconds : float
        Of one query, at a random configuration.
    """

    def __init__(self, report: Report, scene: Scene, q: Floats) -> None:
        self.robot, self.asked = scene.body.model(), fcl.CollisionRequest()
        self.corners = np.unique(scene.body.triangles.reshape(-1, 3), axis=0)
        reach = float(np.linalg.norm(self.corners, axis=1).max())
        grid = scene.workspace.grid
        self.box = np.asarray(grid.lower), np.asarray(grid.upper)
        self.deep = self.box[0] + reach, self.box[1] - reach
        self.skins = scene.body, scene.obstacles
        candidates = []
        for what, make in scene.models.items():
            began = time.perf_counter()
            self.obstacles = make()
            made, began = time.perf_counter() - began, time.process_time()
            for each in q:
                self.meets(each)
            taken = (time.process_time() - began) / len(q)
            report.note(f"FCL, triangles against {what}: {1e6 * taken:.3g} us of CPU a query at random")
            candidates.append((taken, what, made, self.obstacles))
        self.seconds, self.what, self.made, self.obstacles = min(candidates, key=lambda each: each[0])

    def meets(self, q: Any) -> bool:
        """Whether surfaces meet, or the robot leaves the grid, at a configuration."""
        x, y, z, *turn = q
        qx, qy, qz, qw = turn if len(turn) == 4 else (0.0, 0.0, math.sin(0.5 * turn[0]), math.cos(0.5 * turn[0]))
        self.robot.setTransform(fcl.Transform((qw, qx, qy, qz), (x, y, z)))
        (left, front, low), (right, back, high) = self.deep
        if not (left < x < right and front < y < back and low < z < high):
            corners = self.corners @ np.transpose(self.robot.getRotation()) + (x, y, z)
            if (corners <= self.box[0]).any() or (corners >= self.box[1]).any():
                return True
        return bool(fcl.collide(self.robot, self.obstacles, self.asked, fcl.CollisionResult()))

    def collides(self, q: Any) -> bool:
        """The same of the solids: as well where one lies in the other."""
        if self.meets(q):
            return True
        body, obstacles = self.skins
        turn, place = matrix_of(q[3:]), q[:3]
        inside = bool(obstacles.encloses(body.spots @ turn.T + place).any())
        return inside or bool(body.encloses((obstacles.spots - place) @ turn).any())

    def is_free(self, state: Any) -> bool:
        """Whether the robot is free at one of OMPL's states."""
        if hasattr(state, "rotation"):
            turn = state.rotation()
            return not self.meets((state.getX(), state.getY(), state.getZ(), turn.x, turn.y, turn.z, turn.w))
        place = state[0]
        return not self.meets((place[0], place[1], place[2], state[1].value))

    def path_collides(self, path: Floats, each: int) -> bool:
        """Whether a path collides at some of its places, so many along each leg."""
        legs = itertools.pairwise(path)
        return any(self.meets(q) for start, end in legs for q in along(start, end, np.linspace(0.0, 1.0, each)))


def along(start: Floats, end: Floats, t: Floats) -> Floats:
    """Return configurations on the straight edge that turns the shorter way, at each of t in [0, 1]."""
    first, last = (Rotation.from_matrix(matrix_of(q[3:])) for q in (start, end))
    places = start[:3] + t[:, None] * (end - start)[:3]
    turns = first * Rotation.from_rotvec(t[:, None] * (first.inv() * last).as_rotvec())
    return np.column_stack([places, turns.as_quat()])


def _mesh(skin: Skin) -> Any:
    import trimesh

    return trimesh.Trimesh(skin.triangles.reshape(-1, 3), np.arange(3 * len(skin.triangles)).reshape(-1, 3))


def _bodies(vertices: int, faces: Ints) -> Ints:
    """The connected part that each triangle belongs to."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = faces[:, [0, 1]].T, faces[:, [1, 2]].T
    first, last = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(len(first)), (first, last)), (vertices, vertices))
    return np.asarray(connected_components(graph, directed=False)[1][faces[:, 0]], dtype=np.int64)
