"""Proofs in the plane: the robot and the obstacles as the compiled ones take them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import row_entry
from cspace.exact import plane
from cspace.exact.boundaries import Problem, anchors_of, joined, obstacle_border
from cspace.exact.segments import Border, Outline, Scene
from cspace.map.batches import Kernel
from cspace.shapes import Pieces, Shape

Floats = NDArray[np.float64]

BIN: Final = 4
"""Side of a bin of border segments, in cells."""


class PlaneProofs:
    """Proofs for one robot among the obstacles of one workspace; what is asked is compiled when it is first asked."""

    def __init__(self, problem: Problem) -> None:
        self._world = plane.World(problem.map, _scene(problem), _outline(problem.robot.shape))
        self._dof = problem.dof

    @cached_property
    def point(self) -> Callable[..., int]:
        ask = row_entry(plane.ask_point, self._world, self._dof)
        return lambda *q: ask(q)

    @cached_property
    def edge(self) -> Callable[..., int]:
        ask = row_entry(plane.ask_edge, self._world, 2 * self._dof)
        return lambda *ends: ask(ends)

    @cached_property
    def points(self) -> Kernel:
        return partial(plane.ask_points, self._world)

    @cached_property
    def edges(self) -> Kernel:
        return partial(plane.ask_edges, self._world)

    def spare(self, points: Floats, lengths: Floats, turns: Floats) -> float:
        outline = self._world.outline
        rows = np.empty((len(outline.segments), 8))
        return float(plane.least_spare(self._world.scene.border, outline, rows, points, lengths, turns))


def _outline(shape: Shape) -> Outline:
    """The robot's border: the segments of its regions, or the middles of its discs, each grown by a radius."""
    whole, parts = shape.boundary(), shape.regions
    border, ends = joined([whole], 2, 2), np.cumsum([len(part) for part in parts], dtype=np.int64)
    rho = float(np.hypot(*border.simplices.reshape(-1, 2).T).max())
    return Outline(border.simplices.reshape(-1, 4), border.radii, anchors_of(whole)[0], ends, rho)


def _scene(problem: Problem) -> Scene:
    """The obstacles of a workspace: their border, and the polygons that they fill."""
    workspace, grid = problem.workspace, problem.workspace.grid
    obstacles = obstacle_border(workspace, walled=problem.walled)
    side = BIN * grid.spacing
    segments, radii = _cut(joined(obstacles.pieces, 2, 2), side)
    columns, rows = (-(-n // BIN) for n in grid.shape)
    middles = (segments[:, :2] + segments[:, 2:]) / 2.0
    bins = np.clip(np.floor((middles - grid.lower) / side).astype(np.int64), 0, (columns - 1, rows - 1))
    numbers = bins[:, 0] * rows + bins[:, 1]
    order = np.argsort(numbers, kind="stable")
    solids = [outline for shape in workspace.obstacles for outline in shape.regions]
    corners = [solid.reshape(-1, 2) for solid in solids]
    starts = np.concatenate([[0], np.cumsum(np.bincount(numbers, minlength=columns * rows))]).astype(np.int64)
    border = Border(
        lower=grid.lower,
        upper=grid.upper,
        segments=segments[order],
        radii=radii[order],
        widest=float(radii.max(initial=0.0)),
        starts=starts,
        columns=columns,
        rows=rows,
        side=side,
        walled=problem.walled,
        least=problem.least + obstacles.error,
        reach=side,
    )
    return Scene(
        border=border,
        spacing=grid.spacing,
        outer=workspace.outer,
        inner=workspace.inner if workspace.shapes else workspace.outer,
        solids=np.concatenate([*solids, np.empty((0, 4))]),
        ends=np.cumsum([len(solid) for solid in solids], dtype=np.int64),
        hulls=np.array([[*points.min(axis=0), *points.max(axis=0)] for points in corners]).reshape(-1, 4),
    )


def _cut(border: Pieces, longest: float) -> tuple[Floats, Floats]:
    """Segments cut into equal ones, none longer than ``longest``, shape (n, 4), and their radii."""
    starts, steps = border.simplices[:, 0], border.simplices[:, 1] - border.simplices[:, 0]
    pieces = np.maximum(np.ceil(np.hypot(steps[:, 0], steps[:, 1]) / longest).astype(np.int64), 1)
    whole = np.repeat(np.arange(len(starts)), pieces)
    number = np.arange(len(whole)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = np.stack([number, number + 1], axis=1) / pieces[whole, None]
    ends = starts[whole, None] + steps[whole, None] * share[..., None]
    return ends.reshape(-1, 4), border.radii[whole]
