"""Random maps of every space with exact geometry."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
import trimesh

import cspace
from cspace import BLOCKED, FREE, CSpace, Robot, Rotations, Workspace
from cspace._shapes.mesh import Mesh
from cspace._support.arrays import Bools, Floats, Ints, States
from tests.helpers.regions import SIDES, Body, Flat, cell_boxes

Rng = np.random.Generator

SPACES = {
    "plane": (2, ()),
    "yaw": (2, (1, 2, 7, 16, 72)),
    "space": (3, ()),
    "yaw in space": (3, (1, 2, 5, 16)),
    "quaternions": (3, tuple(Rotations.quaternions(n) for n in (1, 2, 3))),
}
"""Dimension of the workspace, and rotation cells to draw from."""

REGIONS: dict[int, Any] = {2: Flat, 3: Body}
ROBOT_SIZES = {2: ((0.2, 2.0), (2.0, 8.0), (8.0, 40.0)), 3: ((0.2, 2.0), (2.0, 6.0), (6.0, 16.0))}
"""Ranges of robot sizes, in cells."""

MESHES = ("boxes", "hull", "stars", "open surface")
ROBOTS = {2: ("balls", "box", "bitmap", "polygons"), 3: ("balls", "box", "bitmap", *MESHES)}
WORKSPACES = {2: ("array", "polygons"), 3: ("array", "balls", *MESHES)}
"""Kinds of robots and workspaces, by dimension."""

ROUNDING = 1e-9
"""Distance from contact, in metres, within which no state counts as false."""


@dataclass(frozen=True)
class Case:
    """A map and its exact geometry.

    Attributes
    ----------
    robot, obstacles : Flat or Body
        Obstacles are None without any; coordinates begin at the lower corner of the grid, so that
        far maps lose no digits.
    """

    space: CSpace
    robot: Any
    obstacles: Any

    def meets(self, q: Floats, distance: Any) -> Bools:
        """Return True where the robot comes within a distance of what is not free."""
        grid, hit = self.space.grid, np.zeros(len(q), dtype=np.bool_)
        distances = np.broadcast_to(distance, len(q))
        q = q.copy()
        q[:, : grid.dim] -= grid.lower
        if self.obstacles is not None:
            hit |= self.robot.within(self.obstacles, q, distances)
        if self.space.outside == "blocked":
            high = np.subtract(grid.upper, grid.lower)
            hit |= self.robot.leaves(q, np.zeros(grid.dim), high, distances)
        return hit

    def check_free(self, claim: str, q: Floats, refused: Any = False) -> None:
        """Fail if the robot, grown by the margin, collides at configurations (..., size).

        Fail, too, where the map refuses what it claims.
        """
        rows = q.reshape(-1, self.space.size)
        touches = self.meets(rows, max(0.0, self.space.margin - ROUNDING))
        expect(claim, q, ~touches.reshape(q.shape[:-1]) & ~np.asarray(refused))

    def check_states(self, q: Floats, states: States) -> None:
        """Fail if the state of a configuration is false."""
        self.check_free("FREE", q[states == FREE])
        blocked = q[states == BLOCKED]
        expect("BLOCKED", blocked, self.meets(blocked, ROUNDING))


def expect(claim: str, q: Floats, holds: Bools) -> None:
    """Fail unless a claim about configurations (..., size) holds at each."""
    assert np.all(holds), f"{claim} at {q[~holds][0].tolist()}"


def pick_close(distances: Floats, number: int, rng: Rng) -> Ints:
    """Return ``number`` indices, half by smallest distance."""
    order = np.argsort(distances, kind="stable")
    half = number // 2
    return np.concatenate([order[:half], rng.permutation(order[half:])[: number - half]])


@dataclass(frozen=True)
class Scale:
    """Conversion of random lengths from cells to metres.

    In half of all maps, robots and obstacles lie on the lattice, halfway between its lines, or a
    tiny length off, because proofs are tight there.

    Attributes
    ----------
    spacing : float
        Metres.
    snap : float
        Unit of positions and lengths, in cells; 0 rounds nothing.
    nudge : float
        Added to rounded lengths, in cells.
    """

    spacing: float
    snap: float
    nudge: float

    def lengths(self, cells: Any) -> Any:
        """Convert lengths; the results are positive."""
        if not self.snap:
            return self.spacing * np.maximum(cells, 1e-3)
        steps = np.maximum(np.round(np.divide(cells, self.snap)), 1)
        return self.spacing * np.maximum(steps * self.snap + self.nudge, 1e-3)

    def place(self, cells: Any) -> Floats:
        """Convert positions."""
        return self.spacing * (
            np.round(np.divide(cells, self.snap)) * self.snap if self.snap else np.asarray(cells)
        )


def draw_case(name: str, seed: int) -> Case:
    """Draw a map of a space."""
    dim, rotations = SPACES[name]
    rng = np.random.default_rng(seed)
    scale = Scale(
        float(rng.choice([1.0, 0.05, 1 / 3, rng.uniform(0.02, 2.0)])),
        float(rng.choice([0.0, 0.5])),
        float(rng.choice([0.0, -1.0, 1.0]) * 10.0 ** rng.uniform(-8.0, -2.0)),
    )
    size = rng.uniform(*rng.choice(ROBOT_SIZES[dim]))
    robot_kind, workspace_kind = str(rng.choice(ROBOTS[dim])), str(rng.choice(WORKSPACES[dim]))
    outside = str(rng.choice(["blocked", "free"]))
    with warnings.catch_warnings(action="ignore"):  # obstacles may be tiny, or outside the bounds
        robot, body = draw_robot(rng, robot_kind, size, scale, dim)
        workspace, obstacles = draw_workspace(rng, workspace_kind, scale, dim, outside)
        space = cspace.build(
            workspace,
            robot,
            rotations=draw_rotations(rng, rotations),
            outside=outside,
            inner=bool(rng.random() < 0.7),
            margin=float(rng.choice([0.0, 0.0, 0.5, rng.uniform(0.0, 3.0)]) * scale.spacing),
        )
    if obstacles is not None:
        obstacles = obstacles.translate(-np.asarray(space.grid.lower))
    return Case(space, body, obstacles)


def draw_rotations(rng: Rng, choices: tuple[Any, ...]) -> Any:
    """Draw rotation cells, or the borders of unequal cells instead of many equal ones."""
    drawn = choices[rng.integers(len(choices))] if choices else None
    if drawn != 16:
        return drawn
    widths = np.cumsum(rng.uniform(0.1, 1.0, int(rng.integers(2, 50))))
    return rng.uniform(-np.pi, np.pi) + 2.0 * np.pi * np.append(0.0, widths / widths[-1])


def draw_cells(rng: Rng, most: int, dim: int) -> Bools:
    """Draw cells at random, and boxes of cells."""
    cells = rng.random(rng.integers(1, most, dim)) < rng.choice([0.0, 0.0, 0.02, 0.3, 0.9, 1.0])
    for _ in range(rng.integers(0, 6)):
        low = rng.integers(0, cells.shape)
        cells[tuple(map(slice, low, low + rng.integers(1, most // 3 + 2, dim)))] = True
    return cells


# ---- workspaces and robots -----------------------------------------------------------------------


def draw_workspace(
    rng: Rng, kind: str, scale: Scale, dim: int, outside: str
) -> tuple[Workspace, Any]:
    """Draw a workspace and its obstacles."""
    spacing, far = scale.spacing, scale.spacing * rng.choice([0.0, 10.0, 1e5])
    corner = rng.choice([1.0, 7.0]) * rng.uniform(-far, far, dim)
    if kind == "array":
        cells = draw_cells(rng, 60 if dim == 2 else 16, dim)
        exact = REGIONS[dim].boxes(cell_boxes(cells, corner, spacing)) if cells.any() else None
        return Workspace.from_array(cells, spacing, corner), exact
    extent = spacing * rng.uniform(3.0, 60.0 if dim == 2 else 28.0, dim)
    bounds = np.append(corner, corner + extent)
    if kind == "polygons":
        shapes = []
        for _ in range(rng.integers(1, 9)):
            center = rng.uniform(-0.1, 1.1, 2) * extent / spacing
            shapes.append(draw_polygon(rng, center, float(rng.choice([0.3, 3.0, 15.0])), scale))
        lines = rng.uniform(-0.1, 1.1, (2, 2)) * extent
        shapes += [shapely.LineString(lines), shapely.Point(lines[0])][: rng.integers(3)]
        shapes = [shapely.transform(shape, lambda points: points + corner) for shape in shapes]
        workspace = Workspace.from_polygons(shapes, spacing, bounds)
        box = shapely.box(*workspace.grid.lower, *workspace.grid.upper)
        clipped = shapely.intersection(shapes, box)
        return workspace, Flat(list(shapely.get_parts(clipped[~shapely.is_empty(clipped)])))
    given = bounds if outside == "blocked" else None
    if kind == "balls":
        number = int(rng.integers(1, 12))
        centers = corner + scale.place(rng.uniform(size=(number, 3)) * extent / spacing)
        radii = scale.lengths(rng.uniform(0.3, 5.0, number)) * (rng.random() < 0.8)  # or points
        return Workspace.from_balls(centers, radii, spacing, given), Body.balls(centers, radii)
    middle = corner + scale.place(rng.uniform(size=3) * extent / spacing)
    mesh, exact = draw_mesh(rng, kind, middle, float(rng.choice([0.6, 3.0, 8.0])), scale)
    return Workspace.from_mesh(mesh, spacing, given), exact


def draw_robot(rng: Rng, kind: str, size: float, scale: Scale, dim: int) -> tuple[Robot, Any]:
    """Draw a robot of ``size`` cells and its exact region."""
    middle = rng.choice([0.0, 0.5, 3.0]) * size * rng.uniform(-1.0, 1.0, dim)
    center, exact = scale.place(middle), REGIONS[dim]
    if kind == "balls":
        number = int(rng.choice([1, 1, 2, 5]))
        away = scale.place(rng.uniform(-size, size, (number, dim)) / 2 * (number > 1))
        radii = scale.lengths(rng.uniform(0.1, 0.6, number) * size)
        return Robot.from_balls(center + away, radii), exact.balls(center + away, radii)
    if kind == "box":
        sides = scale.lengths(rng.uniform(0.3, 1.2, dim) * size)
        make: Any = (
            Robot.box if dim == 3 else lambda sides, at: Robot.rectangle(sides[0], sides[1], at)
        )
        robot = make(sides, center)
        return robot, exact.boxes([center - sides / 2, center + sides / 2])
    if kind == "bitmap":
        cells = draw_cells(rng, 6, dim)
        cells[tuple(rng.integers(0, cells.shape))] = True
        side = float(scale.lengths(size / max(cells.shape)))
        region = exact.boxes(cell_boxes(cells, center, side))
        return Robot.from_bitmap(cells, side, center), region
    if kind == "polygons":
        away = rng.uniform(-size, size, (int(rng.integers(1, 4)), 2)) / 2
        polygons = [draw_polygon(rng, middle + each, size / 2, scale) for each in away]
        return Robot.polygon(polygons), Flat(polygons)
    mesh, region = draw_mesh(rng, kind, center, size / 2, scale)
    return Robot.from_mesh(mesh), region


# ---- polygons and meshes -------------------------------------------------------------------------


def draw_polygon(rng: Rng, middle: Floats, reach: float, scale: Scale) -> Any:
    """Draw a rectangle, or a star, often with a hole; lengths in cells."""
    if rng.random() < 0.3:
        low = scale.place(middle)
        return shapely.box(*low, *(low + scale.lengths(rng.uniform(0.2, 1.5, 2) * reach)))
    corners = int(rng.integers(5, 12))
    angles = rng.uniform(0.0, 2.0 * np.pi) + 2.0 * np.pi * np.arange(corners) / corners
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    outer = middle + reach * rng.uniform(0.5, 1.0, (corners, 1)) * around
    # 0.3 is less than 0.5 cos(pi / 5), the smallest distance of the outer border from the middle.
    hole = middle + rng.uniform(0.05, 0.3) * reach * around
    return shapely.Polygon(
        scale.spacing * outer, [scale.spacing * hole] if rng.random() < 0.5 else None
    )


def draw_mesh(rng: Rng, kind: str, middle: Floats, reach: float, scale: Scale) -> tuple[Mesh, Body]:
    """Draw a mesh like those of files, and its exact region; the reach is in cells.

    Triangles have any order, and each solid any orientation. Some repeat, and some have no area.
    """
    drawn = [
        middle + draw_solid(rng, kind, reach, scale)
        for _ in range(1 if kind == "hull" else int(rng.integers(1, 4)))
    ]
    exact = Body.join(drawn)
    triangles = np.concatenate([part[:, ::-1] if rng.random() < 0.5 else part for part in drawn])
    if kind == "open surface":
        exact = Body(triangles, np.full(len(triangles), -1))
    twice, flat = triangles[rng.integers(0, len(triangles), (2, 2))]
    if rng.random() < 0.3:
        triangles = np.concatenate([triangles, twice, flat[:, [0, 0, 1]]])
    corners = rng.permutation(triangles).reshape(-1, 3)
    solid = "surface" if kind == "open surface" else "auto"
    if rng.random() < 0.5:
        return Mesh(corners, np.arange(len(corners)).reshape(-1, 3), solid), exact
    vertices, faces = np.unique(corners, axis=0, return_inverse=True)
    return Mesh(vertices, faces.reshape(-1, 3), solid), exact


def draw_solid(rng: Rng, kind: str, reach: float, scale: Scale) -> Floats:
    """Draw the outward triangles of a solid, or the triangles of an open surface."""
    away = rng.uniform(-1.0, 1.0, 3) * reach * (kind != "hull")
    if kind == "boxes":
        low = scale.place(away)
        return Body.boxes([low, low + scale.lengths(rng.uniform(0.1, 1.5, 3) * reach)]).triangles
    if kind == "open surface":
        if rng.random() < 0.5:
            box = Body.boxes([scale.place(away), scale.place(away + rng.integers(1, 9, 3))])
            return box.triangles[rng.permutation(len(SIDES))[: int(rng.integers(2, 8))]]
        corners = rng.uniform(-1.0, 1.0, (int(rng.integers(1, 8)), 3, 3))
        if rng.random() < 0.5:  # slivers
            ends, share = corners[:, :2], rng.uniform(-0.2, 1.2, (len(corners), 1))
            beside = corners[:, 2] * 10.0 ** rng.uniform(-16.0, -2.0, (len(corners), 1))
            corners[:, 2] = ends[:, 0] + share * (ends[:, 1] - ends[:, 0]) + beside
        return scale.spacing * reach * corners
    if kind == "hull":
        points = rng.normal(size=(int(rng.integers(5, 20)), 3)) * reach / 2
        points = scale.place(points) if reach > 3.0 else scale.spacing * points
        return np.asarray(trimesh.convex.convex_hull(points).triangles)
    ball = trimesh.creation.icosphere(int(rng.integers(0, 3)), 1.0)
    corners = (ball.vertices * rng.uniform(0.3, 1.0, (len(ball.vertices), 1)))[ball.faces]
    matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.choice([1.0, 1.0, 0.1], 3)
    matrix[0] *= np.sign(np.linalg.det(matrix))
    return scale.spacing * (away + reach * corners @ matrix.T)
