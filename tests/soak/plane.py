"""Random maps in the plane with exact geometry in shapely."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

import cspace
from cspace import CSpace, Grid, Robot, Workspace
from cspace.support.arrays import Bools, Floats
from tests.soak.tally import ROUNDING, Case, Rng

PLANE_ROBOT_SIZES = ((0.2, 2.0), (2.0, 8.0), (2.0, 8.0), (8.0, 40.0))
"""Ranges of robot sizes in the plane, in cells."""


# ---- exact geometry ------------------------------------------------------------------------------


def unite_cells(occupied: Bools, grid: Grid) -> Any:
    """Unite closed occupied cells in one shapely geometry."""
    steps = np.diff(np.pad(occupied.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    (x, first), stop = np.nonzero(steps > 0), np.nonzero(steps < 0)[1]
    lower, spacing = grid.lower, grid.spacing
    left, right = lower[0] + spacing * x, lower[0] + spacing * (x + 1)
    return shapely.union_all(
        shapely.box(left, lower[1] + spacing * first, right, lower[1] + spacing * stop)
    )


def surround_grid(grid: Grid, width: float) -> Any:
    """Return the surroundings of a grid, for shapely."""
    inside = shapely.box(*grid.lower, *grid.upper)
    around = shapely.box(*np.subtract(grid.lower, width), *np.add(grid.upper, width))
    return shapely.Polygon(around.exterior, [inside.exterior])


def place_polygon(polygon: Any, q: Floats) -> Any:
    """Copy a polygon to configurations (n, 2 or 3)."""

    def rings(ring: Any) -> Any:
        return shapely.linearrings(move_points(np.asarray(ring.coords)[:, :2], q))

    if not polygon.interiors:
        return shapely.polygons(rings(polygon.exterior))
    holes = np.stack([rings(ring) for ring in polygon.interiors], axis=1)
    return shapely.polygons(rings(polygon.exterior), holes=holes)


def move_points(points: Floats, q: Floats) -> Floats:
    """Move points (m, 2) to configurations: shape (n, m, 2)."""
    if q.shape[1] == 2:
        return np.asarray(points[None] + q[:, None])
    cosine, sine = np.cos(q[:, 2])[:, None], np.sin(q[:, 2])[:, None]
    x, y = points[:, 0], points[:, 1]
    return np.stack([cosine * x - sine * y + q[:, :1], sine * x + cosine * y + q[:, 1:2]], axis=-1)


@dataclass(frozen=True)
class Shape:
    """An exact robot: polygons and discs.

    Configurations are ``(x, y)``, shape (n, 2), or ``(x, y, yaw)``, shape (n, 3).

    Attributes
    ----------
    polygons : sequence of shapely Polygon
    centers, radii : ndarray, shape (n, 2) and (n,)
        Of discs.
    """

    polygons: Sequence[Any]
    centers: Floats = field(default_factory=lambda: np.empty((0, 2)))
    radii: Floats = field(default_factory=lambda: np.empty(0))

    def meets(self, obstacles: Sequence[Any], q: Floats, distance: float | Floats) -> Bools:
        """Return True where the robot comes within a distance."""
        hit = np.zeros(len(q), dtype=np.bool_)
        for points, radius in self._discs(q):
            for obstacle in obstacles:
                hit |= shapely.dwithin(obstacle, points, radius + distance)
        for polygon in self.polygons:
            turned = place_polygon(polygon, q)
            for obstacle in obstacles:
                # dwithin of a prepared polygon misses some polygons crossing it (GEOS 3.14).
                hit |= shapely.intersects(obstacle, turned)
                if np.any(np.asarray(distance) > 0.0):
                    hit |= shapely.dwithin(obstacle, turned, distance)
        return hit

    def lies_in(self, whole: Any, q: Floats, distance: float) -> Bools:
        """Return True where the grown robot lies in a region."""
        inside, border = np.ones(len(q), dtype=np.bool_), whole.boundary
        for points, radius in self._discs(q):
            inside &= shapely.intersects(whole, points)
            inside &= shapely.distance(border, points) >= radius + distance - ROUNDING
        for polygon in self.polygons:
            turned = place_polygon(polygon, q)
            inside &= shapely.covers(whole, turned) & (
                shapely.distance(border, turned) >= distance - ROUNDING
            )
        return inside

    @property
    def reach(self) -> float:
        """Largest distance from the reference point to the robot."""
        far = [np.hypot(*shapely.get_coordinates(polygon).T).max() for polygon in self.polygons]
        return float(max([*far, *(np.hypot(*self.centers.T) + self.radii)]))

    def _discs(self, q: Floats) -> list[tuple[Any, float]]:
        """Return centers of each disc at configurations, and its radius."""
        discs = zip(self.centers, self.radii, strict=True)
        return [
            (shapely.points(move_points(center[None], q)[:, 0]), radius) for center, radius in discs
        ]


# ---- cases ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PlaneCase(Case):
    """A map in the plane.

    Attributes
    ----------
    shape : Shape
    obstacles : list of shapely geometries
        Prepared; with the surroundings of the grid if these are blocked.
    """

    shape: Shape
    obstacles: list[Any]

    @property
    def reach(self) -> float:
        return self.shape.reach

    def meets(self, q: Floats, distance: float | Floats) -> Bools:
        return self.shape.meets(self.obstacles, q, distance)

    def lies_in(self, q: Floats, rng: Rng) -> Bools:
        whole = shapely.union_all([part for part in self.obstacles if part.area])
        shapely.prepare(whole)
        return self.shape.lies_in(whole, q, self.space.margin)


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

    @classmethod
    def draw(cls, rng: Rng, sizes: tuple[tuple[float, float], ...]) -> tuple[float, Scale]:
        """Draw a robot size in cells, and a scale."""
        spacing = float(rng.choice([1.0, 0.05, 0.1, 1 / 3, rng.uniform(0.02, 2.0)]))
        size, snap = (
            float(rng.uniform(*sizes[rng.integers(len(sizes))])),
            float(rng.choice([0.0, 0.5])),
        )
        nudge = float(rng.choice([0.0, 0.0, -1.0, 1.0]) * 10.0 ** rng.uniform(-8.0, -2.0))
        return size, cls(spacing, snap, nudge)

    def margin(self, rng: Rng, max_cells: float) -> float:
        """Draw a margin in metres, often zero."""
        drawn = rng.choice([0.0, 0.5, 1.0, rng.uniform(0.0, max_cells)], p=[0.55, 0.1, 0.1, 0.25])
        return float(drawn * self.spacing)

    def corner(self, rng: Rng, dim: int) -> Floats:
        """Draw the lower corner of a grid."""
        far = self.spacing * rng.choice([10.0, 1e5])
        return np.asarray(
            rng.choice([0.0, 1.0])
            * rng.choice([self.spacing * 7.0, 1.0])
            * rng.uniform(-far, far, dim)
        )

    def center(self, rng: Rng, size: float, dim: int) -> Floats:
        """Draw the center of a robot."""
        return self.place(rng.choice([0.0, 0.5, 3.0]) * size * rng.uniform(-1.0, 1.0, dim))

    def describe(self, space: CSpace, workspace: str, robot: str) -> str:
        """Describe a map of this scale."""
        grid, turns = space.grid, space.rotations
        off = f", {self.nudge:.1e} cells off the lattice" if self.snap else ""
        return (
            f"{workspace} {grid.shape} at {grid.spacing:g} m from {grid.lower}, {robot}{off}, "
            f"outside={space.outside}, margin={space.margin:.3g}{f', {turns}' if turns.names else ''}"
        )

    def length(self, cells: float) -> float:
        """Convert one length; the result is positive."""
        rounded = max(round(cells / self.snap), 1) * self.snap + self.nudge if self.snap else cells
        return self.spacing * max(rounded, 1e-3)

    def lengths(self, cells: Any) -> Floats:
        """Convert an array of lengths."""
        return np.vectorize(self.length, otypes=[np.float64])(cells)

    def place(self, cells: Any) -> Floats:
        """Convert positions."""
        rounded = (
            np.round(np.asarray(cells) / self.snap) * self.snap if self.snap else np.asarray(cells)
        )
        return np.asarray(self.spacing * rounded)


def draw_case(seed: int, number: int, turning: bool = False) -> PlaneCase:
    """Draw a case; successive numbers use all kinds of robots."""
    rng = np.random.default_rng([seed, number, 3] if turning else [seed, number])
    kind = list(PLANE_ROBOTS)[number % len(PLANE_ROBOTS)]
    size, scale = Scale.draw(rng, PLANE_ROBOT_SIZES)
    robot, shape = PLANE_ROBOTS[kind](rng, size, scale)
    workspace_kind = str(rng.choice(list(PLANE_WORKSPACES)))
    workspace, solid = PLANE_WORKSPACES[workspace_kind](rng, scale)
    outside = str(rng.choice(["blocked", "free"]))
    margin = scale.margin(rng, 3.0)
    rotations = _rotations(rng) if turning else None
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside, margin=margin)
    if outside == "blocked":
        span = max(np.subtract(workspace.grid.upper, workspace.grid.lower))
        solid.append(surround_grid(workspace.grid, 8.0 * (span + shape.reach + margin)))
    solid = [part for part in solid if not part.is_empty]
    for part in solid:
        shapely.prepare(part)
    name = scale.describe(space, workspace_kind, f"{kind} of {size:.3g} cells")
    made_by = f"draw_case({seed}, {number}{', turning=True' if turning else ''})"
    return PlaneCase(name, made_by, (workspace_kind, kind), space, shape, solid)


def _rotations(rng: Rng) -> int | Floats:
    """Draw a number of rotation cells, or unequal borders."""
    if rng.random() < 0.75:
        return int(rng.choice([1, 2, 3, 7, 8, 16, 36, 72, 90]))
    widths = rng.uniform(0.1, 1.0, int(rng.integers(2, 50)))
    return np.asarray(
        rng.uniform(-np.pi, np.pi) + np.append(0.0, np.cumsum(widths) / widths.sum()) * 2.0 * np.pi
    )


# ---- workspaces with exact obstacles -------------------------------------------------------------


def _array(rng: Rng, scale: Scale) -> tuple[Workspace, list[Any]]:
    shape = tuple(rng.integers(1, 60, 2)) if rng.random() < 0.8 else (1, int(rng.integers(1, 200)))
    occupied = np.zeros(shape, dtype=np.bool_)
    style = rng.choice(["noise", "boxes", "empty", "full"], p=[0.35, 0.55, 0.05, 0.05])
    if style == "noise":
        occupied = rng.random(shape) < rng.choice([0.002, 0.02, 0.3, 0.9])
    elif style == "full":
        occupied[:] = True
    elif style == "boxes":
        for _ in range(rng.integers(1, 8)):
            x, y = rng.integers(0, shape)
            a, b = rng.integers(1, 20, 2)
            occupied[x : x + a, y : y + b] = True
    workspace = Workspace.from_array(occupied, scale.spacing, scale.corner(rng, 2))
    return workspace, [unite_cells(occupied, workspace.grid)] if occupied.any() else []


def _polygons(rng: Rng, scale: Scale) -> tuple[Workspace, list[Any]]:
    spacing = scale.spacing
    corner = scale.corner(rng, 2)
    extent = spacing * rng.uniform(3.0, 60.0, 2)
    shapes: list[Any] = []
    for _ in range(rng.integers(1, 9)):
        center = corner + rng.uniform(-0.1, 1.1, 2) * extent
        reach = spacing * rng.choice([0.3, 3.0, 15.0]) * rng.uniform(0.3, 1.5)
        style = rng.choice(["star", "box", "holed", "line", "point"], p=[0.4, 0.25, 0.2, 0.1, 0.05])
        if style in ("star", "holed"):
            shapes.append(draw_star(rng, center, reach, hole=style == "holed"))
        elif style == "box":
            low = corner + scale.place((center - corner) / spacing)
            shapes.append(shapely.box(*low, *(low + scale.lengths(rng.uniform(1, 12, 2)))))
        elif style == "line":
            shapes.append(shapely.LineString(center + reach * rng.uniform(-1, 1, (3, 2))))
        else:
            shapes.append(shapely.Point(center))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # obstacles may be tiny, or outside the bounds
        workspace = Workspace.from_polygons(shapes, spacing, bounds=(*corner, *(corner + extent)))
    clip = shapely.box(*workspace.grid.lower, *workspace.grid.upper)
    areas = shapely.union_all([shape for shape in shapes if shape.geom_type == "Polygon"])
    thin = [shape for shape in shapes if shape.geom_type != "Polygon"]
    clipped = shapely.intersection([areas, *thin], clip)
    # Split collections of different types, which shapely cannot prepare.
    return workspace, [
        part
        for each in clipped
        for part in (each.geoms if each.geom_type == "GeometryCollection" else [each])
    ]


PLANE_WORKSPACES: dict[str, Callable[[Rng, Scale], tuple[Workspace, list[Any]]]] = {
    "array": _array,
    "polygons": _polygons,
}


# ---- robots with exact shapes --------------------------------------------------------------------


def draw_star(rng: Rng, middle: Floats, reach: float, hole: bool) -> Any:
    """Draw a non-convex polygon, with or without a hole."""
    corners = int(rng.integers(5, 12))
    turns = rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, corners, endpoint=False)
    around = np.column_stack([np.cos(turns), np.sin(turns)])
    outer = middle + reach * rng.uniform(0.5, 1.0, (corners, 1)) * around
    # 0.3 is less than 0.5 cos(pi / 5), the smallest distance of the outer border from the middle.
    return shapely.Polygon(
        outer, [middle + rng.uniform(0.05, 0.3) * reach * around] if hole else None
    )


def _disc(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    center, radius = scale.center(rng, size, 2), scale.length(size / 2)
    return Robot.disc(radius, center), Shape([], center[None], np.array([radius]))


def _discs(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    number = int(rng.integers(2, 6))
    centers = scale.center(rng, size, 2) + scale.place(rng.uniform(-size, size, (number, 2)))
    radii = scale.lengths(rng.uniform(0.1, 0.6, number) * size)
    return Robot.from_balls(centers, radii), Shape([], centers, radii)


def _rectangle(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    sides, middle = scale.lengths(rng.uniform(0.3, 1.2, 2) * size), scale.center(rng, size, 2)
    region = shapely.box(*(middle - sides / 2), *(middle + sides / 2))
    return Robot.rectangle(sides[0], sides[1], middle), Shape([region])


def _regular(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    turns = rng.uniform(0, 2 * np.pi) + np.linspace(
        0, 2 * np.pi, int(rng.integers(3, 12)), endpoint=False
    )
    ring = size / 2 * np.column_stack([np.cos(turns), np.sin(turns)])
    return _of_polygons([shapely.Polygon(scale.spacing * ring + scale.center(rng, size, 2))])


def _holed(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    return _of_polygons(
        [draw_star(rng, scale.center(rng, size, 2), scale.spacing * size / 2, hole=True)]
    )


def _parts(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    """Draw several parts, disjoint, overlapping or touching."""
    middle = scale.center(rng, size, 2)
    parts = []
    for _ in range(rng.integers(2, 5)):
        position = middle + scale.place(rng.uniform(-size, size, 2))
        if rng.random() < 0.5:
            parts.append(
                draw_star(
                    rng,
                    position,
                    scale.spacing * size * rng.uniform(0.1, 0.5),
                    hole=bool(rng.random() < 0.5),
                )
            )
        else:
            parts.append(
                shapely.box(*position, *(position + scale.lengths(rng.uniform(0.1, 0.8, 2) * size)))
            )
    return _of_polygons(parts)


def _of_polygons(polygons: list[Any]) -> tuple[Robot, Shape]:
    return Robot.polygon(polygons), Shape(polygons)


def _bitmap(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    bitmap = rng.random(rng.integers(1, 7, 2)) < rng.choice([0.3, 0.7, 1.0])
    bitmap[tuple(rng.integers(0, bitmap.shape))] = True
    side = scale.length(size / max(bitmap.shape))
    lower = scale.center(rng, size, 2)
    whole = unite_cells(bitmap, Grid(lower, side, bitmap.shape))
    return Robot.from_bitmap(bitmap, side, lower), Shape(list(shapely.get_parts(whole)))


PLANE_ROBOTS: dict[str, Callable[[Rng, float, Scale], tuple[Robot, Shape]]] = {
    "disc": _disc,
    "discs": _discs,
    "rectangle": _rectangle,
    "regular polygon": _regular,
    "holed polygon": _holed,
    "several parts": _parts,
    "bitmap": _bitmap,
}
