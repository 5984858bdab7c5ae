"""Random workspaces and robots for the soak, each with its exact geometry."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import cspace
from benchmarks.soak.plane_geometry import Shape, frame, union_of_cells
from cspace import CSpace, Grid, Robot, Workspace
from cspace.arrays import Bools, Floats

Rng = np.random.Generator

SIZES = ((0.2, 2.0), (2.0, 8.0), (2.0, 8.0), (8.0, 40.0))
"""Cells that robots are across."""


@dataclass(frozen=True)
class Case:
    """One map and what it stands for.

    Attributes
    ----------
    name : str
        What was drawn.
    made_by : str
        The call that draws it again.
    kind : tuple of str
        Kind of workspace and kind of robot.
    space : CSpace
    shape : Shape
        The exact robot.
    obstacles : list of shapely geometries
        The exact obstacles, with what lies outside where that is blocked; prepared.
    """

    name: str
    made_by: str
    kind: tuple[str, str]
    space: CSpace
    shape: Shape
    obstacles: list[Any]

    @property
    def reach(self) -> float:
        """Largest distance of a point of the robot from its reference point."""
        return self.shape.reach()

    def meets(self, q: Floats, distance: float | Floats) -> Bools:
        """Whether the robot comes within a distance of the obstacles."""
        return self.shape.meets(self.obstacles, q, distance)

    def lies_in(self, q: Floats, rng: Rng) -> Bools:
        """Whether the robot, grown by the margin, lies in the obstacles."""
        import shapely

        whole = shapely.union_all([part for part in self.obstacles if part.area])
        shapely.prepare(whole)
        return self.shape.lies_in(whole, q, self.space.margin)


@dataclass(frozen=True)
class Scale:
    """Lengths in metres from lengths in cells.

    Half of all maps are drawn with robots and obstacles on the lattice or halfway, where they touch and just fail to,
    or a tiny length off it, where proofs are tight.

    Attributes
    ----------
    spacing : float
        Metres.
    snap : float
        Positions and lengths are rounded to multiples of this, in cells; 0 if they are not.
    nudge : float
        What rounded lengths are too long by, in cells.
    """

    spacing: float
    snap: float
    nudge: float

    @classmethod
    def draw(cls, rng: Rng, sizes: tuple[tuple[float, float], ...]) -> tuple[float, Scale]:
        """Cells that a robot is across, and the scale."""
        spacing = float(rng.choice([1.0, 0.05, 0.1, 1 / 3, rng.uniform(0.02, 2.0)]))
        size, snap = float(rng.uniform(*sizes[rng.integers(len(sizes))])), float(rng.choice([0.0, 0.5]))
        nudge = float(rng.choice([0.0, 0.0, -1.0, 1.0]) * 10.0 ** rng.uniform(-8.0, -2.0))
        return size, cls(spacing, snap, nudge)

    def margin(self, rng: Rng, most: float) -> float:
        """None, some, or up to so many cells, in metres."""
        drawn = rng.choice([0.0, 0.5, 1.0, rng.uniform(0.0, most)], p=[0.55, 0.1, 0.1, 0.25])
        return float(drawn * self.spacing)

    def corner(self, rng: Rng, dim: int) -> Floats:
        """Lower corner of a grid: the origin, on the lattice, anywhere, or far away."""
        far = self.spacing * rng.choice([10.0, 1e5])
        return np.asarray(rng.choice([0.0, 1.0]) * rng.choice([self.spacing * 7.0, 1.0]) * rng.uniform(-far, far, dim))

    def middle(self, rng: Rng, size: float, dim: int) -> Floats:
        """Where a robot's middle lies in its frame: at the reference point, near it, or far off."""
        return self.place(rng.choice([0.0, 0.5, 3.0]) * size * rng.uniform(-1.0, 1.0, dim))

    def described(self, space: CSpace, workspace: str, robot: str) -> str:
        """What was drawn."""
        grid, turns = space.grid, space.rotations
        off = f", {self.nudge:.1e} cells off the lattice" if self.snap else ""
        return (
            f"{workspace} {grid.shape} at {grid.spacing:g} m from {grid.lower}, {robot}{off}, "
            f"outside={space.outside}, margin={space.margin:.3g}{f', {turns}' if turns.dof else ''}"
        )

    def length(self, cells: float) -> float:
        """One length, above zero."""
        rounded = max(round(cells / self.snap), 1) * self.snap + self.nudge if self.snap else cells
        return self.spacing * max(rounded, 1e-3)

    def place(self, cells: Any) -> Floats:
        """Positions."""
        rounded = np.round(np.asarray(cells) / self.snap) * self.snap if self.snap else np.asarray(cells)
        return np.asarray(self.spacing * rounded)


def draw_case(seed: int, number: int, turning: bool = False) -> Case:
    """The same case for the same seed and number, of a robot that turns or not; all kinds of robots take turns."""
    import shapely

    rng = np.random.default_rng([seed, number, 3] if turning else [seed, number])
    kind = list(ROBOTS)[number % len(ROBOTS)]
    size, scale = Scale.draw(rng, SIZES)
    robot, shape = ROBOTS[kind](rng, size, scale)
    workspace_kind = str(rng.choice(list(WORKSPACES)))
    workspace, solid = WORKSPACES[workspace_kind](rng, scale)
    outside = str(rng.choice(["blocked", "free"]))
    margin = scale.margin(rng, 3.0)
    rotations = _rotations(rng) if turning else None
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside, margin=margin)
    if outside == "blocked":
        span = max(np.subtract(workspace.grid.upper, workspace.grid.lower))
        solid.append(frame(workspace.grid, 8.0 * (span + shape.reach() + margin)))
    solid = [part for part in solid if not part.is_empty]
    for part in solid:
        shapely.prepare(part)
    name = scale.described(space, workspace_kind, f"{kind} of {size:.3g} cells")
    made_by = f"draw_case({seed}, {number}{', turning=True' if turning else ''})"
    return Case(name, made_by, (workspace_kind, kind), space, shape, solid)


def _rotations(rng: Rng) -> int | Floats:
    """A number of rotation cells, or borders of unequal ones."""
    if rng.random() < 0.75:
        return int(rng.choice([1, 2, 3, 7, 8, 16, 36, 72, 90]))
    widths = rng.uniform(0.1, 1.0, int(rng.integers(2, 50)))
    return np.asarray(rng.uniform(-np.pi, np.pi) + np.append(0.0, np.cumsum(widths) / widths.sum()) * 2.0 * np.pi)


# ---- workspaces: a Workspace and its exact obstacles -----------------------------------------------------------------


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
    return workspace, [union_of_cells(occupied, workspace.grid)] if occupied.any() else []


def _polygons(rng: Rng, scale: Scale) -> tuple[Workspace, list[Any]]:
    import shapely

    spacing = scale.spacing
    corner = scale.corner(rng, 2)
    extent = spacing * rng.uniform(3.0, 60.0, 2)
    shapes: list[Any] = []
    for _ in range(rng.integers(1, 9)):
        middle = corner + rng.uniform(-0.1, 1.1, 2) * extent
        reach = spacing * rng.choice([0.3, 3.0, 15.0]) * rng.uniform(0.3, 1.5)
        style = rng.choice(["star", "box", "holed", "line", "point"], p=[0.4, 0.25, 0.2, 0.1, 0.05])
        if style in ("star", "holed"):
            shapes.append(_star(rng, middle, reach, hole=style == "holed"))
        elif style == "box":
            low = corner + scale.place((middle - corner) / spacing)
            shapes.append(shapely.box(*low, *(low + [scale.length(rng.uniform(1, 12)) for _ in range(2)])))
        elif style == "line":
            shapes.append(shapely.LineString(middle + reach * rng.uniform(-1, 1, (3, 2))))
        else:
            shapes.append(shapely.Point(middle))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # tiny obstacles, and none within the bounds, are meant here
        workspace = Workspace.from_polygons(shapes, spacing, bounds=(*corner, *(corner + extent)))
    clip = shapely.box(*workspace.grid.lower, *workspace.grid.upper)
    areas = shapely.union_all([shape for shape in shapes if shape.geom_type == "Polygon"])
    thin = [shape for shape in shapes if shape.geom_type != "Polygon"]
    clipped = [shapely.intersection(part, clip) for part in [areas, *thin]]
    return workspace, [part for whole in clipped for part in _plain(whole)]


def _plain(shape: Any) -> list[Any]:
    """A geometry, or the parts of a collection, of which shapely prepares none."""
    if shape.geom_type != "GeometryCollection":
        return [shape]
    return [part for each in shape.geoms for part in _plain(each)]


WORKSPACES: dict[str, Callable[[Rng, Scale], tuple[Workspace, list[Any]]]] = {"array": _array, "polygons": _polygons}


# ---- robots: a Robot and its exact shape -----------------------------------------------------------------------------


def _of_polygons(polygons: list[Any], robot: Robot | None = None) -> tuple[Robot, Shape]:
    return robot or Robot.polygon(polygons), Shape(polygons, np.empty((0, 2)), np.empty(0))


def _of_discs(centers: Floats, radii: Floats) -> tuple[Robot, Shape]:
    return Robot.balls(centers, radii), Shape([], centers, radii)


def _disc(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    center, radius = scale.middle(rng, size, 2), scale.length(size / 2)
    return Robot.disc(radius, center), Shape([], center[None], np.array([radius]))


def _discs(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    number = int(rng.integers(2, 6))
    centers = scale.middle(rng, size, 2) + scale.place(rng.uniform(-size, size, (number, 2)))
    return _of_discs(centers, np.array([scale.length(rng.uniform(0.1, 0.6) * size) for _ in range(number)]))


def _rectangle(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    import shapely

    length, width = (scale.length(rng.uniform(0.3, 1.2) * size) for _ in range(2))
    x, y = scale.middle(rng, size, 2)
    box = shapely.box(x - length / 2, y - width / 2, x + length / 2, y + width / 2)
    return _of_polygons([box], Robot.rectangle(length, width, (x, y)))


def _regular(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    import shapely

    turns = rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, int(rng.integers(3, 12)), endpoint=False)
    ring = size / 2 * np.column_stack([np.cos(turns), np.sin(turns)])
    return _of_polygons([shapely.Polygon(scale.spacing * ring + scale.middle(rng, size, 2))])


def _star(rng: Rng, middle: Floats, reach: float, hole: bool) -> Any:
    """A polygon that is not convex, with or without a hole."""
    import shapely

    corners = int(rng.integers(5, 12))
    turns = rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, corners, endpoint=False)
    round_it = np.column_stack([np.cos(turns), np.sin(turns)])
    outer = middle + reach * rng.uniform(0.5, 1.0, (corners, 1)) * round_it
    # 0.3 is less than 0.5 cos(pi / 5), the least distance of the outer border from the middle.
    return shapely.Polygon(outer, [middle + rng.uniform(0.05, 0.3) * reach * round_it] if hole else None)


def _holed(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    return _of_polygons([_star(rng, scale.middle(rng, size, 2), scale.spacing * size / 2, hole=True)])


def _parts(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    """Several parts, which may lie apart, overlap or touch."""
    import shapely

    middle = scale.middle(rng, size, 2)
    parts = []
    for _ in range(rng.integers(2, 5)):
        place = middle + scale.place(rng.uniform(-size, size, 2))
        if rng.random() < 0.5:
            parts.append(_star(rng, place, scale.spacing * size * rng.uniform(0.1, 0.5), hole=bool(rng.random() < 0.5)))
        else:
            sides = [scale.length(rng.uniform(0.1, 0.8) * size) for _ in range(2)]
            parts.append(shapely.box(*place, *(place + sides)))
    return _of_polygons(parts)


def _bitmap(rng: Rng, size: float, scale: Scale) -> tuple[Robot, Shape]:
    import shapely

    bitmap = rng.random(rng.integers(1, 7, 2)) < rng.choice([0.3, 0.7, 1.0])
    bitmap[tuple(rng.integers(0, bitmap.shape))] = True
    side = scale.length(size / max(bitmap.shape))
    lower = scale.middle(rng, size, 2)
    whole = union_of_cells(bitmap, Grid(lower, side, bitmap.shape))
    return _of_polygons(list(shapely.get_parts(whole)), Robot.cells(bitmap, side, lower))


ROBOTS: dict[str, Callable[[Rng, float, Scale], tuple[Robot, Shape]]] = {
    "disc": _disc,
    "discs": _discs,
    "rectangle": _rectangle,
    "regular polygon": _regular,
    "holed polygon": _holed,
    "several parts": _parts,
    "bitmap": _bitmap,
}
