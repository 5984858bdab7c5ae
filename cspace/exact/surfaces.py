"""Surfaces in space: sets of triangles, each grown by a radius, as the distances of FCL take them.

A ball is a triangle without size, its middle, grown by its radius.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.raster.bitmaps import cell_faces, rectangle_triangles
from cspace.shapes import Balls, Box, Mesh, Shape, Voxels

if TYPE_CHECKING:
    from cspace.grid import Grid
    from cspace.workspace import Workspace

Floats = NDArray[np.float64]

GROUP: Final = 128
"""Most triangles of a group."""


@dataclass(frozen=True, slots=True)
class Surface:
    """Triangles, shape (n, 3, 3), metres, and the radius by which they are grown."""

    triangles: Floats
    radius: float = 0.0


def robot_surfaces(body: Shape) -> list[Surface]:
    """The surface of a robot, in its own frame.

    Raises
    ------
    InputError
        If the robot is a mesh whose inside depends on the spacing.
    """
    if isinstance(body, Balls):
        return list(_balls(body.centers, body.radii))
    if isinstance(body, Mesh):
        return [Surface(_asked(body, "robot").triangles)]
    if isinstance(body, Voxels):
        return [Surface(cell_faces(body.occupied, body.side, body.lower))]
    if not isinstance(body, Box):
        raise TypeError(f"a {type(body).__name__} is no body in space")
    vertices, faces = body.surface
    return [Surface(vertices[faces])]


def obstacle_surfaces(workspace: Workspace, *, walled: bool) -> list[Surface]:
    """The surface of the obstacles of a workspace: of its shapes, cut to the grid, or else of its outer cells.

    Where ``walled``, all beyond the grid is obstacle, and the border of the grid needs no surface of its own.

    Raises
    ------
    InputError
        If an obstacle is a mesh whose inside depends on the spacing.
    """
    grid = workspace.grid
    if workspace.shapes is None:
        return [Surface(cell_faces(workspace.outer, grid.spacing, grid.lower))]
    found: list[Surface] = []
    shapes: tuple[Any, ...] = workspace.shapes
    for shape in shapes:
        if isinstance(shape, Balls):
            # One that reaches beyond the grid counts as a whole.
            apart = np.maximum(np.maximum(grid.lower - shape.centers, shape.centers - grid.upper), 0.0)
            near = np.sqrt((apart**2).sum(axis=1)) <= shape.radii * (1.0 + 1e-9) + 1e-9 * grid.spacing
            found += _balls(shape.centers[near], shape.radii[near])
            continue
        mesh = _asked(shape, "obstacle")
        found.append(Surface(clipped(mesh.triangles, grid)))
        if not walled and mesh.encloses:
            found += _lids(workspace, np.stack(mesh.bounds))
    return found


def groups_of(triangles: Floats) -> Iterator[Floats]:
    """Triangles in groups of neighbours, halved along the longest side of the box round their middles."""
    middles = triangles.sum(axis=1)
    waiting = [np.arange(len(triangles))] if len(triangles) else []
    while waiting:
        some = waiting.pop()
        if len(some) <= GROUP:
            yield triangles[some]
            continue
        around, half = middles[some], len(some) // 2
        axis = int(np.argmax(around.max(axis=0) - around.min(axis=0)))
        order = np.argpartition(around[:, axis], half)
        waiting += [some[order[half:]], some[order[:half]]]


def anchors_of(surface: Surface) -> Floats:
    """One point of each part of a surface that hangs together, shape (n, 3)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    points, which = np.unique(surface.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    if not len(points):
        return points
    corners = which.reshape(-1, 3)
    start, end = corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel()
    links = coo_array((np.ones(len(start)), (start, end)), shape=(len(points), len(points)))
    labels = connected_components(links, directed=False)[1]
    return np.asarray(points[np.unique(labels, return_index=True)[1]])


def clipped(triangles: Floats, grid: Grid) -> Floats:
    """What of triangles lies in the grid's closed box, as triangles, shape (n, 3, 3)."""
    for axis, (low, high) in enumerate(zip(grid.lower, grid.upper, strict=True)):
        for border, sign in ((low, 1.0), (high, -1.0)):
            triangles = _cut(triangles, axis, border, sign)
    return triangles


def _cut(triangles: Floats, axis: int, border: float, sign: float) -> Floats:
    """What of triangles lies where ``sign * (coordinate - border)`` is zero or above."""
    height = sign * (triangles[:, :, axis] - border)
    kept = height >= 0.0
    count = kept.sum(axis=1)
    parts = [triangles[count == 3]]
    for number in (1, 2):
        chosen = np.flatnonzero(count == number)
        # The corner that is alone on its side comes first.
        alone = np.argmax(kept[chosen] == (number == 1), axis=1)
        turned = (alone[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(triangles[chosen[:, None], turned], 1, 0)
        ha, hb, hc = np.moveaxis(height[chosen[:, None], turned], 1, 0)
        ab, ac = (a + (ha / (ha - h))[:, None] * (p - a) for p, h in ((b, hb), (c, hc)))
        ab[:, axis] = ac[:, axis] = border
        if number == 1:
            parts.append(np.stack([a, ab, ac], axis=1))
        else:
            parts += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    return np.concatenate(parts)


def _lids(workspace: Workspace, bounds: Floats) -> Iterator[Surface]:
    """Sides of the outer cells on those borders of the grid that a solid crosses, where it is cut open."""
    grid, cells = workspace.grid, workspace.outer
    for axis in range(3):
        columns = np.moveaxis(cells, axis, 0)
        sides = np.zeros((columns.shape[0] + 1, *columns.shape[1:]), dtype=np.bool_)
        if bounds[0, axis] < grid.lower[axis]:
            sides[0] = columns[0]
        if bounds[1, axis] > grid.upper[axis]:
            sides[-1] = columns[-1]
        if sides.any():
            yield Surface(rectangle_triangles(sides, axis, grid.spacing, grid.lower))


def _balls(centers: Floats, radii: Floats) -> Iterator[Surface]:
    """Balls, those of the same radius together."""
    order = np.argsort(radii, kind="stable")
    different, first = np.unique(radii[order], return_index=True)
    for radius, which in zip(different.tolist(), np.split(order, first[1:]), strict=True):
        yield Surface(np.repeat(centers[which, None], 3, axis=1), radius)


def _asked(shape: Any, role: str) -> Mesh:
    """A mesh whose inside does not depend on a spacing."""
    mesh: Mesh = shape
    if mesh.solid == "fill":
        raise InputError(
            f"the {role} {mesh.source} has solid='fill', and what is filled depends on the spacing; exact answers need "
            "a shape of its own; close the mesh and pass solid='auto', or ask without exact=True"
        )
    return mesh
