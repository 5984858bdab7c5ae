"""Obstacles of an arm: shapes that are placed, and workspaces of cells."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch

import numpy as np

from cspace.arms.model import rigid
from cspace.arms.solids import Placed
from cspace.errors import InputError
from cspace.memory import check_memory
from cspace.shapes import Bracketed, Shape, Voxels
from cspace.workspace import Workspace

_CELL_BYTES = 4
"""For each cell of a workspace, while its cells become boxes."""


def named_obstacles(obstacles: object) -> Mapping[str, object]:
    """Obstacles by their names.

    Raises
    ------
    InputError
        If they are neither a workspace nor named.
    """
    named = {"workspace": obstacles} if isinstance(obstacles, Workspace) else obstacles
    if not isinstance(named, Mapping):
        rule = "it must be a workspace, or name each obstacle"
        raise InputError("obstacles", f"is a {type(obstacles).__name__}", rule, "pass e.g. {'table': shape}")
    return named


@singledispatch
def placed_obstacle(obstacle: object, name: str) -> Placed | None:
    """An obstacle in the frame of the arm's base; None for a workspace without any.

    Raises
    ------
    InputError
        If it is in the plane, or something else, its pose is no rigid motion, or its cells do not fit into memory.
    """
    rule = "obstacles are workspaces, shapes, or shapes that are placed"
    raise InputError("obstacles", f"hold {name!r}, a {type(obstacle).__name__}", rule, "pass e.g. Robot.box(...).shape")


@placed_obstacle.register
def _(obstacle: Shape, name: str) -> Placed | None:
    return placed_obstacle(Placed(obstacle, np.eye(4)), name)


@placed_obstacle.register
def _(obstacle: Placed, name: str) -> Placed:
    if obstacle.shape.dim != 3:
        raise InputError("obstacles", f"hold {name!r}, a shape of the plane", "arms are in space", "pass a solid")
    return Placed(obstacle.shape, rigid(obstacle.pose, f"pose of {name}"))


@placed_obstacle.register
def _(obstacle: Workspace, name: str) -> Placed | None:
    grid = obstacle.grid
    if grid.dim != 3:
        raise InputError("obstacles", f"hold {name!r}, a map of the plane", "arms are in space", "pass one in space")
    if obstacle.shapes is not None and len(obstacle.shapes) == 1:
        return placed_obstacle(obstacle.shapes[0], name)
    check_memory(_CELL_BYTES * grid.size, name, grid.shape, grid.spacing, mend="cut it to what the arm reaches")
    outer, lower = obstacle.outer, np.asarray(grid.lower)
    if not outer.any():
        return None
    known = obstacle.inner if obstacle.unknown is None else obstacle.inner & ~obstacle.unknown
    inner = known if obstacle.unknown is not None or obstacle.inner is not outer else outer
    if obstacle.live:
        outer = outer.copy()
    cells = Voxels(outer, grid.spacing, lower)
    within = cells if inner is obstacle.outer else Voxels(inner.copy(), grid.spacing, lower)
    return Placed(cells if within is cells else Bracketed(cells, within), np.eye(4))
