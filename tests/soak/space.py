"""Random maps in space with exact geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

import cspace
from cspace import Robot, Workspace
from cspace.shapes.mesh import Mesh, Solid
from cspace.support.arrays import Bools, Floats
from tests.soak.plane import Scale
from tests.soak.solids import (
    SIDES,
    Blocks,
    Pair,
    Shape,
    SolidSurface,
    Walls,
    draw_directions,
    matrix_of,
    merge_cells,
)
from tests.soak.tally import Case, Rng

SPATIAL_ROBOT_SIZES = ((0.2, 2.0), (2.0, 6.0), (2.0, 6.0), (6.0, 16.0))
"""Ranges of robot sizes in space, in cells."""

DrawnMesh = tuple[Mesh, Shape]
DrawnWorkspace = tuple[Workspace, Shape | None]
DrawnRobot = tuple[Robot, Shape]


@dataclass(frozen=True)
class SolidCase(Case):
    """A map in space.

    Attributes
    ----------
    robot : Shape
    obstacles : Shape or None
    """

    robot: Shape
    obstacles: Shape | None

    @property
    def reach(self) -> float:
        return float(np.linalg.norm(np.abs(self.robot.bounds).max(axis=0)))

    def meets(self, q: Floats, distance: float | Floats) -> Bools:
        hit, distances = np.zeros(len(q), dtype=np.bool_), np.broadcast_to(distance, len(q))
        positions = q[:, :3] - self._corner
        # Each rotated robot is another shape.
        groups = [slice(None)] if q.shape[1] == 3 else [slice(k, k + 1) for k in range(len(q))]
        for group in groups:
            fixed = q.shape[1] == 3
            pairs = (
                self._fixed_pairs
                if fixed
                else self._pairs(self.robot.rotate(matrix_of(q[group][0, 3:])))
            )
            for pair in pairs:
                hit[group] |= pair.within(positions[group], distances[group])
        return hit

    def lies_in(self, q: Floats, rng: Rng) -> Bools:
        """Test random points of the robot, grown by the margin."""
        points = self.robot.sample(40, rng)
        points += self.space.margin * draw_directions(len(points), rng)
        matrices = [matrix_of(rotation) for rotation in q[:, 3:]]
        moved = [
            position + points @ matrix.T
            for position, matrix in zip(q[:, :3], matrices, strict=True)
        ]
        inside = np.zeros(len(q) * len(points), dtype=np.bool_)
        for pair in self._pairs(Blocks.balls(np.zeros((1, 3)), np.zeros(1))):
            inside |= pair.gaps(np.concatenate(moved) - self._corner) <= 1e-9
        return np.asarray(inside.reshape(len(q), -1).all(axis=1))

    @cached_property
    def _corner(self) -> Floats:
        """Origin of computations, so that far maps lose no digits."""
        return np.asarray(self.space.grid.lower)

    @cached_property
    def _fixed_pairs(self) -> list[Pair]:
        return self._pairs(self.robot)

    def _pairs(self, robot: Shape) -> list[Pair]:
        grid = self.space.grid
        pairs: list[Pair] = []
        if self.space.outside == "blocked":
            pairs.append(Walls(robot, np.array([np.zeros(3), np.subtract(grid.upper, grid.lower)])))
        if self.obstacles is not None:
            pairs.append(Pair.of(robot, self.obstacles.translate(-self._corner)))
        return pairs


def draw_solid_case(
    seed: int, number: int, turning: bool = False, freely: bool = False
) -> SolidCase:
    """Draw a case; successive numbers use all kinds of robots.

    The robot yaws if ``turning``, rotates about all axes if ``freely``, and otherwise only
    translates.
    """
    rng = np.random.default_rng([seed, number, 9 if turning else 11 if freely else 7])
    kind = list(SPATIAL_ROBOTS)[number % len(SPATIAL_ROBOTS)]
    size, scale = Scale.draw(rng, SPATIAL_ROBOT_SIZES)
    robot, body = SPATIAL_ROBOTS[kind](rng, size, scale)
    outside = str(rng.choice(["blocked", "free"]))
    workspace_kind = str(rng.choice(list(SPATIAL_WORKSPACES)))
    workspace, obstacles = SPATIAL_WORKSPACES[workspace_kind](rng, scale, outside == "blocked")
    margin = scale.margin(rng, 2.0)
    rotations: int | cspace.Rotations | None = (
        int(rng.choice([1, 2, 5, 8, 16, 36])) if turning else None
    )
    if freely:
        rotations = cspace.Rotations.quaternions(int(rng.choice([1, 2, 3])))
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside, margin=margin)
    name = scale.describe(space, workspace_kind, f"{kind} of {size:.3g} cells")
    made_by = f"draw_solid_case({seed}, {number}{', turning=True' if turning else ', freely=True' if freely else ''})"
    return SolidCase(name, made_by, (workspace_kind, kind), space, body, obstacles)


# ---- meshes with exact solids --------------------------------------------------------------------


def _disturb(rng: Rng, triangles: Floats, flips: str, solid: Solid = "auto") -> Mesh:
    """Shuffle triangles like those of files.

    They may repeat, have no area, or any order and orientation.

    ``flips`` is "none", "all" or "some".
    """
    turned = rng.random(len(triangles)) < {"none": 0.0, "all": 1.0, "some": 0.5}[flips]
    triangles = np.where(turned[:, None, None], triangles[:, ::-1], triangles)
    if rng.random() < 0.3:
        twice = triangles[rng.integers(0, len(triangles), 2)]
        flat = triangles[rng.integers(0, len(triangles), 2)][:, [0, 0, 1]]
        triangles = np.concatenate([triangles, twice, flat])
    triangles = rng.permutation(triangles)
    corners = triangles.reshape(-1, 3)
    if rng.random() < 0.5:
        return Mesh(corners, np.arange(len(corners)).reshape(-1, 3), solid)
    vertices, faces = np.unique(corners, axis=0, return_inverse=True)
    return Mesh(vertices, faces.reshape(-1, 3), solid)


def _boxes(rng: Rng, middle: Floats, reach: float, scale: Scale) -> DrawnMesh:
    """Draw boxes, aligned or anywhere."""
    number = int(rng.integers(1, 5))
    aligned = bool(rng.random() < 0.6)
    away, sides = (
        rng.uniform(-1.0, 1.0, (number, 3)) * reach,
        rng.uniform(0.1, 1.5, (number, 3)) * reach,
    )
    if aligned:
        away, sides = scale.place(away / scale.spacing), scale.lengths(sides / scale.spacing)
    low = middle + away
    blocks = Blocks.boxes(np.stack([low, low + sides], axis=1))
    return _disturb(
        rng, blocks.to_surface().triangles, str(rng.choice(["none", "all"])) if aligned else "some"
    ), blocks


def _opposed_boxes(rng: Rng, middle: Floats, reach: float, scale: Scale) -> DrawnMesh:
    """Draw two boxes that face opposite ways.

    One inside the other is a hole.
    """
    low = middle + rng.uniform(-1.0, 0.0, (2, 3)) * reach
    corners = np.stack([low, low + rng.uniform(0.2, 2.0, (2, 3)) * reach], axis=1)
    if rng.random() < 0.5:
        t = np.sort(rng.uniform(0.02, 0.98, (2, 3)), axis=0)
        corners[1] = corners[0, 0] + t * (corners[0, 1] - corners[0, 0])
    triangles = Blocks.boxes(corners).to_surface().triangles
    flips = str(rng.choice(["none", "all"]))
    mesh = _disturb(rng, np.concatenate([triangles[:12], triangles[12:, ::-1]]), flips)
    outward, inward = corners if flips == "none" else corners[::-1]
    hollow = bool((outward[0] < inward[0]).all() and (inward[1] < outward[1]).all())
    return mesh, Blocks.boxes(np.array(_hollow_box(outward, inward)) if hollow else corners)


def _hollow_box(box: Floats, hole: Floats) -> list[Floats]:
    """Split a box with a hole into boxes."""
    pieces, left = [], box.copy()
    for axis in range(3):
        for end in (0, 1):
            piece = left.copy()
            piece[1 - end, axis] = left[end, axis] = hole[end, axis]
            pieces.append(piece)
    return pieces


def _hulls(rng: Rng, middle: Floats, reach: float, scale: Scale) -> DrawnMesh:
    """Draw convex bodies, disjoint or overlapping, some flat."""
    flat = rng.choice([1.0, 1.0, 0.1, 1e-3])
    single = bool(rng.random() < 0.4)
    bodies = [
        _hull(rng, middle + rng.uniform(-1.0, 1.0, 3) * reach * (not single), reach, scale, flat)
        for _ in range(1 if single else int(rng.integers(2, 4)))
    ]
    surface = SolidSurface.of_bodies(bodies)
    solid: Solid = "fill" if single and flat == 1.0 and rng.random() < 0.3 else "auto"
    return _disturb(
        rng, surface.triangles, str(rng.choice(["none", "all", "some"])), solid
    ), surface


def _hull(rng: Rng, middle: Floats, reach: float, scale: Scale, flat: float) -> Floats:
    points = draw_directions(int(rng.integers(4, 20)), rng) * reach * rng.uniform(0.5, 1.0)
    points[:, int(rng.integers(3))] *= flat
    if scale.snap and flat == 1.0 and reach > 3.0 * scale.spacing:
        points = scale.place(points / scale.spacing)
    points = middle + points
    hull = ConvexHull(points - middle, qhull_options="Qt QJ" if flat < 1.0 else "Qt")
    triangles = points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    outward = (normals * hull.equations[:, :3]).sum(axis=1) > 0.0
    return np.asarray(np.where(outward[:, None, None], triangles, triangles[:, ::-1]))


def draw_dented_ball(rng: Rng, max_subdivisions: int) -> Floats:
    """Draw triangles with dents and spikes, within 1 m."""
    ball = trimesh.creation.icosphere(int(rng.integers(0, max_subdivisions)), 1.0)
    return np.asarray((ball.vertices * rng.uniform(0.3, 1.0, (len(ball.vertices), 1)))[ball.faces])


def _stars(rng: Rng, middle: Floats, reach: float, scale: Scale) -> DrawnMesh:
    """Draw bodies with dents and spikes, some flat."""
    bodies = []
    for _ in range(int(rng.integers(1, 3))):
        triangles = (
            draw_dented_ball(rng, 3)
            @ (draw_directions(3, rng).T * rng.choice([1.0, 1.0, 0.1], 3))
            * reach
        )
        bodies.append(middle + rng.uniform(-0.5, 0.5, 3) * reach + triangles)
    surface = SolidSurface.of_bodies(bodies)
    return _disturb(rng, surface.triangles, str(rng.choice(["none", "all", "some"]))), surface


def _open_surface(rng: Rng, middle: Floats, reach: float, scale: Scale) -> DrawnMesh:
    """Draw triangles that enclose nothing."""
    style = rng.choice(["soup", "slivers", "sheet", "sides"])
    if style in ("soup", "slivers"):
        corners = rng.uniform(-1.0, 1.0, (int(rng.integers(1, 12)), 3, 3)) * reach
        if style == "slivers":
            t = rng.uniform(-0.2, 1.2, (len(corners), 1))
            off = (
                draw_directions(len(corners), rng)
                * reach
                * 10.0 ** rng.uniform(-16.0, -2.0, (len(corners), 1))
            )
            corners[:, 2] = corners[:, 0] + t * (corners[:, 1] - corners[:, 0]) + off
        triangles = middle + corners
    elif style == "sheet":
        n = int(rng.integers(2, 7))
        grid = np.stack(
            [
                *np.meshgrid(*[np.linspace(-1.0, 1.0, n)] * 2, indexing="ij"),
                rng.uniform(-0.3, 0.3, (n, n)),
            ],
            axis=-1,
        )
        grid = middle + reach * np.roll(grid, int(rng.integers(3)), axis=2)
        a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        triangles = np.concatenate(
            [np.stack(each, axis=2).reshape(-1, 3, 3) for each in ((a, b, c), (a, c, d))]
        )
    else:
        low = middle + scale.place(rng.uniform(-1.0, 0.0, 3) * reach / scale.spacing)
        sides = scale.lengths(rng.uniform(0.2, 2.0, 3) * reach / scale.spacing)
        box = Blocks.boxes([low, low + sides]).to_surface().triangles
        triangles = box[rng.permutation(len(SIDES))[: int(rng.integers(2, 8))]]
    surface = SolidSurface(triangles, np.full(len(triangles), -1))
    return _disturb(rng, triangles, "some", "surface"), surface


MESHES: dict[str, Callable[[Rng, Floats, float, Scale], DrawnMesh]] = {
    "boxes": _boxes,
    "opposed boxes": _opposed_boxes,
    "hulls": _hulls,
    "stars": _stars,
    "open surface": _open_surface,
}


# ---- workspaces with exact obstacles -------------------------------------------------------------


def _bounds(
    rng: Rng, shape: Shape, spacing: float, corner: Floats, extent: Floats, cut: bool
) -> Floats | None:
    """Draw bounds that cut or enclose the obstacles."""
    if cut:
        return np.concatenate([corner, corner + extent])
    if rng.random() < 0.5:
        return None
    low, high = shape.bounds
    return np.concatenate(
        [low - rng.uniform(0.1, 4.0, 3) * spacing, high + rng.uniform(0.1, 4.0, 3) * spacing]
    )


def _mesh(name: str, rng: Rng, scale: Scale, cut: bool) -> DrawnWorkspace:
    corner, extent = scale.corner(rng, 3), scale.spacing * rng.uniform(3.0, 28.0, 3)
    center = corner + scale.place(rng.uniform(0.0, 1.0, 3) * extent / scale.spacing)
    reach = scale.spacing * float(rng.choice([0.6, 3.0, 8.0])) * float(rng.uniform(0.5, 1.3))
    mesh, exact = MESHES[name](rng, center, reach, scale)
    bounds = _bounds(rng, exact, scale.spacing, corner, extent, cut)
    return Workspace.from_mesh(mesh, scale.spacing, bounds), exact


def _voxels(rng: Rng, scale: Scale, cut: bool) -> DrawnWorkspace:
    occupied = np.zeros(rng.integers(1, 25, 3), dtype=np.bool_)
    if rng.random() < 0.4:
        occupied = rng.random(rng.integers(1, 13, 3)) < rng.choice([0.01, 0.1, 0.9])
    elif rng.random() < 0.9:
        for _ in range(rng.integers(1, 6)):
            first = rng.integers(0, occupied.shape)
            occupied[
                tuple(slice(i, i + n) for i, n in zip(first, rng.integers(1, 10, 3), strict=True))
            ] = True
    workspace = Workspace.from_array(occupied, scale.spacing, scale.corner(rng, 3))
    corners = np.asarray(workspace.grid.lower) + scale.spacing * merge_cells(occupied)
    return workspace, Blocks.boxes(corners) if len(corners) else None


def _balls(rng: Rng, scale: Scale, cut: bool) -> DrawnWorkspace:
    corner, extent = scale.corner(rng, 3), scale.spacing * rng.uniform(3.0, 28.0, 3)
    number = int(rng.integers(1, 12))
    centers = corner + scale.place(rng.uniform(0.0, 1.0, (number, 3)) * extent / scale.spacing)
    radii = scale.lengths(rng.uniform(0.3, 5.0, number))
    radii *= rng.random() < 0.8  # or points
    exact = Blocks.balls(centers, radii)
    bounds = _bounds(rng, exact, scale.spacing, corner, extent, cut)
    return Workspace.from_balls(centers, radii, scale.spacing, bounds), exact


SPATIAL_WORKSPACES: dict[str, Callable[[Rng, Scale, bool], DrawnWorkspace]] = {
    **{name: partial(_mesh, name) for name in MESHES},
    "voxels": _voxels,
    "balls": _balls,
}


# ---- robots with exact shapes --------------------------------------------------------------------


def _box_robot(rng: Rng, size: float, scale: Scale) -> DrawnRobot:
    sides, middle = scale.lengths(rng.uniform(0.3, 1.2, 3) * size), scale.center(rng, size, 3)
    return Robot.box(sides, middle), Blocks.boxes([middle - sides / 2, middle + sides / 2])


def _ball_robot(rng: Rng, size: float, scale: Scale) -> DrawnRobot:
    center, radius = scale.center(rng, size, 3), scale.length(size / 2)
    return Robot.ball(radius, center), Blocks.balls(center[None], np.array([radius]))


def _balls_robot(rng: Rng, size: float, scale: Scale) -> DrawnRobot:
    number = int(rng.integers(2, 6))
    centers = scale.center(rng, size, 3) + scale.place(rng.uniform(-size, size, (number, 3)) / 2)
    radii = scale.lengths(rng.uniform(0.1, 0.5, number) * size)
    return Robot.from_balls(centers, radii), Blocks.balls(centers, radii)


def _bitmap_robot(rng: Rng, size: float, scale: Scale) -> DrawnRobot:
    bitmap = rng.random(rng.integers(1, 5, 3)) < rng.choice([0.3, 0.7, 1.0])
    bitmap[tuple(rng.integers(0, bitmap.shape))] = True
    side = scale.length(size / max(bitmap.shape))
    lower = scale.center(rng, size, 3)
    return Robot.from_bitmap(bitmap, side, lower), Blocks.boxes(lower + side * merge_cells(bitmap))


def _mesh_robot(name: str, rng: Rng, size: float, scale: Scale) -> DrawnRobot:
    mesh, exact = MESHES[name](rng, scale.center(rng, size, 3), scale.spacing * size / 2, scale)
    return Robot.from_mesh(mesh), exact


SPATIAL_ROBOTS: dict[str, Callable[[Rng, float, Scale], DrawnRobot]] = {
    "box": _box_robot,
    "ball": _ball_robot,
    "balls": _balls_robot,
    "bitmap": _bitmap_robot,
    **{f"mesh of {name}": partial(_mesh_robot, name) for name in MESHES},
}
