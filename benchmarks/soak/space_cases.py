"""Random workspaces and robots in space for the soak, each with its exact geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import cspace
from benchmarks.soak.plane_cases import Scale
from benchmarks.soak.space_geometry import Blocks, Shape, matrix_of, merged_cells
from benchmarks.soak.space_meshes import MESHES
from benchmarks.soak.space_pairs import Pair, Walls, pair
from cspace import CSpace, Robot, Workspace
from cspace.arrays import Bools, Floats

Rng = np.random.Generator

SIZES = ((0.2, 2.0), (2.0, 6.0), (2.0, 6.0), (6.0, 16.0))
"""Cells that robots are across."""


@dataclass(frozen=True)
class SolidCase:
    """One map and what it stands for.

    Attributes
    ----------
    name, made_by : str
        What was drawn, and the call that draws it again.
    kind : tuple of str
        Kind of workspace and kind of robot.
    space : CSpace
    robot : Shape
    obstacles : Shape or None
        None where there are none.
    """

    name: str
    made_by: str
    kind: tuple[str, str]
    space: CSpace
    robot: Shape
    obstacles: Shape | None

    @property
    def reach(self) -> float:
        """Largest distance of a point of the robot from its reference point, at most."""
        return float(np.linalg.norm(np.abs(self.robot.bounds).max(axis=0)))

    def meets(self, q: Floats, distance: float | Floats) -> Bools:
        """Whether the robot comes within a distance of the obstacles."""
        hit, distances = np.zeros(len(q), dtype=np.bool_), np.broadcast_to(distance, len(q))
        places = q[:, :3] - self._corner
        # Each turned robot is a shape of its own.
        groups = [slice(None)] if q.shape[1] == 3 else [slice(k, k + 1) for k in range(len(q))]
        for group in groups:
            pairs = (
                self._pairs_of_robot if q.shape[1] == 3 else self._pairs(self.robot.turned(matrix_of(q[group][0, 3:])))
            )
            for each in pairs:
                hit[group] |= each.within(places[group], distances[group])
        return hit

    def lies_in(self, q: Floats, rng: Rng) -> Bools:
        """Whether random points of the robot, grown by the margin, lie in the obstacles."""
        points = self.robot.samples(40, rng)
        away = rng.normal(size=points.shape)
        points += self.space.margin * away / np.linalg.norm(away, axis=1, keepdims=True)
        turns = [matrix_of(rotation) for rotation in q[:, 3:]]
        placed = [place + points @ turn.T for place, turn in zip(q[:, :3], turns, strict=True)]
        held = self._holds(np.concatenate(placed)).reshape(len(q), -1)
        return np.asarray(held.all(axis=1))

    def _holds(self, points: Floats) -> Bools:
        """Whether points lie in the obstacles, or as good as."""
        held = np.zeros(len(points), dtype=np.bool_)
        for each in self._pairs(Blocks.balls(np.zeros((1, 3)), np.zeros(1))):
            held |= each.gaps(points - self._corner) <= 1e-9
        return held

    @cached_property
    def _corner(self) -> Floats:
        """All is looked at from here, so that maps far from the origin lose nothing."""
        return np.asarray(self.space.grid.lower)

    @cached_property
    def _pairs_of_robot(self) -> list[Pair]:
        return self._pairs(self.robot)

    def _pairs(self, robot: Shape) -> list[Pair]:
        grid = self.space.grid
        pairs: list[Pair] = []
        if self.space.outside == "blocked":
            pairs.append(Walls(robot.bounds, np.array([np.zeros(3), np.subtract(grid.upper, grid.lower)])))
        if self.obstacles is not None:
            pairs.append(pair(robot, self.obstacles.moved(-self._corner)))
        return pairs


def draw_solid_case(seed: int, number: int, turning: bool = False, freely: bool = False) -> SolidCase:
    """The same case for the same seed and number, of a robot that yaws, or turns freely, or not.

    All kinds of robots take turns.
    """
    rng = np.random.default_rng([seed, number, 9 if turning else 11 if freely else 7])
    kind = list(ROBOTS)[number % len(ROBOTS)]
    size, scale = Scale.draw(rng, SIZES)
    robot, body = ROBOTS[kind](rng, size, scale)
    outside = str(rng.choice(["blocked", "free"]))
    workspace_kind = str(rng.choice(list(WORKSPACES)))
    workspace, obstacles = WORKSPACES[workspace_kind](rng, scale, outside == "blocked")
    margin = scale.margin(rng, 2.0)
    rotations: int | cspace.Rotations | None = int(rng.choice([1, 2, 5, 8, 16, 36])) if turning else None
    if freely:
        rotations = cspace.Rotations.quaternions(int(rng.choice([1, 2, 3])))
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside, margin=margin)
    name = scale.described(space, workspace_kind, f"{kind} of {size:.3g} cells")
    made_by = f"draw_solid_case({seed}, {number}{', turning=True' if turning else ', freely=True' if freely else ''})"
    return SolidCase(name, made_by, (workspace_kind, kind), space, body, obstacles)


# ---- workspaces: a Workspace and its exact obstacles -----------------------------------------------------------------


def _bounds(rng: Rng, shape: Shape, spacing: float, corner: Floats, extent: Floats, cut: bool) -> Floats | None:
    """Bounds that may cut the obstacles; or those of the obstacles, or around them."""
    if cut:
        return np.concatenate([corner, corner + extent])
    if rng.random() < 0.5:
        return None
    low, high = shape.bounds
    return np.concatenate([low - rng.uniform(0.1, 4.0, 3) * spacing, high + rng.uniform(0.1, 4.0, 3) * spacing])


def _mesh(name: str) -> Callable[[Rng, Scale, bool], tuple[Workspace, Shape | None]]:
    def draw(rng: Rng, scale: Scale, cut: bool) -> tuple[Workspace, Shape | None]:
        corner, extent = scale.corner(rng, 3), scale.spacing * rng.uniform(3.0, 28.0, 3)
        middle = corner + scale.place(rng.uniform(0.0, 1.0, 3) * extent / scale.spacing)
        reach = scale.spacing * float(rng.choice([0.6, 3.0, 8.0])) * float(rng.uniform(0.5, 1.3))
        mesh, exact = MESHES[name](rng, middle, reach, scale)
        bounds = _bounds(rng, exact, scale.spacing, corner, extent, cut)
        return Workspace.from_mesh(mesh, scale.spacing, bounds), exact

    return draw


def _voxels(rng: Rng, scale: Scale, cut: bool) -> tuple[Workspace, Shape | None]:
    occupied = np.zeros(rng.integers(1, 25, 3), dtype=np.bool_)
    if rng.random() < 0.4:
        occupied = rng.random(rng.integers(1, 13, 3)) < rng.choice([0.01, 0.1, 0.9])
    elif rng.random() < 0.9:
        for _ in range(rng.integers(1, 6)):
            first = rng.integers(0, occupied.shape)
            occupied[tuple(slice(i, i + n) for i, n in zip(first, rng.integers(1, 10, 3), strict=True))] = True
    workspace = Workspace.from_array(occupied, scale.spacing, scale.corner(rng, 3))
    corners = np.asarray(workspace.grid.lower) + scale.spacing * merged_cells(occupied)
    return workspace, Blocks.boxes(corners) if len(corners) else None


def _balls(rng: Rng, scale: Scale, cut: bool) -> tuple[Workspace, Shape | None]:
    corner, extent = scale.corner(rng, 3), scale.spacing * rng.uniform(3.0, 28.0, 3)
    number = int(rng.integers(1, 12))
    centers = corner + scale.place(rng.uniform(0.0, 1.0, (number, 3)) * extent / scale.spacing)
    radii = np.array([scale.length(rng.uniform(0.3, 5.0)) for _ in range(number)])
    radii *= rng.random() < 0.8  # or points
    exact = Blocks.balls(centers, radii)
    bounds = _bounds(rng, exact, scale.spacing, corner, extent, cut)
    return Workspace.from_balls(centers, radii, scale.spacing, bounds), exact


WORKSPACES: dict[str, Callable[[Rng, Scale, bool], tuple[Workspace, Shape | None]]] = {
    **{name: _mesh(name) for name in MESHES},
    "voxels": _voxels,
    "balls": _balls,
}


# ---- robots: a Robot and its exact shape -----------------------------------------------------------------------------


def _box_robot(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    sides = np.array([scale.length(length * size) for length in rng.uniform(0.3, 1.2, 3)])
    middle = scale.middle(rng, size, 3)
    return Robot.box(sides, middle), Blocks.boxes([middle - sides / 2, middle + sides / 2])


def _ball_robot(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    center, radius = scale.middle(rng, size, 3), scale.length(size / 2)
    return Robot.ball(radius, center), Blocks.balls(center[None], np.array([radius]))


def _balls_robot(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    number = int(rng.integers(2, 6))
    centers = scale.middle(rng, size, 3) + scale.place(rng.uniform(-size, size, (number, 3)) / 2)
    radii = np.array([scale.length(rng.uniform(0.1, 0.5) * size) for _ in range(number)])
    return Robot.balls(centers, radii), Blocks.balls(centers, radii)


def _bitmap_robot(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    bitmap = rng.random(rng.integers(1, 5, 3)) < rng.choice([0.3, 0.7, 1.0])
    bitmap[tuple(rng.integers(0, bitmap.shape))] = True
    side = scale.length(size / max(bitmap.shape))
    lower = scale.middle(rng, size, 3)
    return Robot.cells(bitmap, side, lower), Blocks.boxes(lower + side * merged_cells(bitmap))


def _mesh_robot(name: str) -> Callable[[Rng, float, Scale], tuple[Robot, Shape]]:
    def draw(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
        mesh, exact = MESHES[name](rng, scale.middle(rng, size, 3), scale.spacing * size / 2, scale)
        return Robot.mesh(mesh), exact

    return draw


ROBOTS: dict[str, Callable[[Rng, float, Scale], tuple[Robot, Shape]]] = {
    "box": _box_robot,
    "ball": _ball_robot,
    "balls": _balls_robot,
    "bitmap": _bitmap_robot,
    **{f"mesh of {name}": _mesh_robot(name) for name in MESHES},
}
