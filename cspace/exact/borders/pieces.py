"""Border pieces of robots and of workspaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace.raster.bitmaps import boundary_segments, point_segments, polygon_outline

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.exact.borders._kernels import Body, Scene
    from cspace.grid import Grid
    from cspace.robot import Robot
    from cspace.workspace import Workspace

Floats = NDArray[np.float64]

BIN = 4
"""Side of a bin of border pieces, in cells."""


def body_of(robot: Robot) -> Body:
    """The robot's border: the segments of its regions, or the middles of its discs, each grown by a radius."""
    from cspace.exact.borders._kernels import Body

    if len(robot.radii):
        pieces, anchors = np.hstack([robot.centers, robot.centers]), np.array(robot.centers)
    else:
        pieces = np.concatenate(robot.outlines)
        anchors = np.concatenate([_anchors(outline) for outline in robot.outlines])
    radii = np.array(robot.radii) if len(robot.radii) else np.zeros(len(pieces))
    ends = np.cumsum([len(outline) for outline in robot.outlines], dtype=np.int64)
    rho = float(np.hypot(pieces[:, [0, 2]], pieces[:, [1, 3]]).max())
    return Body(np.ascontiguousarray(pieces), radii, np.ascontiguousarray(anchors), ends, rho)


def scene_of(workspace: Workspace, *, walled: bool, least: float) -> Scene:
    """The obstacles of a workspace.

    They are its shapes, clipped to the grid, where it has kept them, and else the union of its outer cells.

    Parameters
    ----------
    workspace : Workspace
    walled : bool
        Whether all beyond the grid is obstacle.
    least : float
        A distance counts above this, metres.
    """
    from cspace.exact.borders._kernels import Scene

    grid = workspace.grid
    solids: list[Floats] = []
    if workspace.shapes is None:
        borders, inner = [boundary_segments(workspace.outer, grid.spacing, grid.lower)], workspace.outer
    else:
        solids, lines = _segments(_clipped([part for shape in workspace.shapes for part in shape.geometries], grid))
        borders, inner = [*solids, *lines], workspace.inner
    side = BIN * grid.spacing
    pieces = _cut(np.concatenate([*borders, np.empty((0, 4))]), side)
    columns, rows = (-(-n // BIN) for n in grid.shape)
    middles = (pieces[:, :2] + pieces[:, 2:]) / 2.0
    bins = np.clip(np.floor((middles - grid.lower) / side).astype(np.int64), 0, (columns - 1, rows - 1))
    numbers = bins[:, 0] * rows + bins[:, 1]
    corners = [solid.reshape(-1, 2) for solid in solids]
    return Scene(
        pieces=np.ascontiguousarray(pieces[np.argsort(numbers, kind="stable")]),
        starts=np.concatenate([[0], np.cumsum(np.bincount(numbers, minlength=columns * rows))]).astype(np.int64),
        columns=columns,
        rows=rows,
        side=side,
        outer=workspace.outer,
        inner=inner,
        solids=np.concatenate([*solids, np.empty((0, 4))]),
        ends=np.cumsum([len(solid) for solid in solids], dtype=np.int64),
        hulls=np.array([[*points.min(axis=0), *points.max(axis=0)] for points in corners]).reshape(-1, 4),
        walled=walled,
        least=least,
        reach=side,
    )


def _clipped(shapes: Sequence[BaseGeometry], grid: Grid) -> list[Any]:
    """What of shapes lies in the grid's closed box."""
    import shapely

    box = shapely.box(*grid.lower, *grid.upper)
    bounds = shapely.bounds(list(shapes)).reshape(-1, 4)
    inside = (bounds[:, :2] >= grid.lower).all(axis=1) & (bounds[:, 2:] <= grid.upper).all(axis=1)
    return [shape if kept else shape.intersection(box) for shape, kept in zip(shapes, inside.tolist(), strict=True)]


def _segments(shapes: Sequence[Any]) -> tuple[list[Floats], list[Floats]]:
    """Border segments of each polygon, and those of each line and point, of shapes and collections of them."""
    solids: list[Floats] = []
    lines: list[Floats] = []
    for shape in shapes:
        if hasattr(shape, "geoms"):
            parts = _segments(list(shape.geoms))
            solids += parts[0]
            lines += parts[1]
        elif shape.is_empty:
            continue
        elif shape.geom_type == "Polygon":
            solids.append(polygon_outline(shape))
        else:
            lines.append(point_segments(np.asarray(shape.coords)[:, :2]))
    return solids, lines


def _cut(segments: Floats, longest: float) -> Floats:
    """Segments cut into equal pieces, none longer than ``longest``, shape (n, 4)."""
    starts, steps = segments[:, :2], segments[:, 2:] - segments[:, :2]
    pieces = np.maximum(np.ceil(np.hypot(steps[:, 0], steps[:, 1]) / longest).astype(np.int64), 1)
    whole = np.repeat(np.arange(len(segments)), pieces)
    number = np.arange(len(whole)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = np.stack([number, number + 1], axis=1) / pieces[whole, None]
    ends = starts[whole, None] + steps[whole, None] * share[..., None]
    return np.asarray(ends.reshape(-1, 4))


def _anchors(outline: Floats) -> Floats:
    """One point of each connected part of a border, shape (n, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    points, which = np.unique(outline.reshape(-1, 2), axis=0, return_inverse=True)
    first, last = which.reshape(-1, 2).T
    links = coo_array((np.ones(len(first)), (first, last)), shape=(len(points), len(points)))
    labels = connected_components(links, directed=False)[1]
    return np.asarray(points[np.unique(labels, return_index=True)[1]])
