"""Obstacles of an arm: shapes that are placed, and workspaces of cells."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from typing import Final

import numpy as np

from cspace.arms.model import rigid
from cspace.arms.solids import Placed
from cspace.arrays import Floats
from cspace.errors import InputError
from cspace.memory import check_memory
from cspace.shapes import Bracketed, Shape, Voxels
from cspace.workspace import Workspace

_CELL_BYTES: Final = 4
"""For each cell of a workspace, while its cells become boxes."""

_BOX_BYTES: Final = 1000
"""For each of these, with the trees that hold them, at the peak: 640 to 900 were measured."""


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
def placed_obstacle(obstacle: object, name: str, base: Floats) -> Placed | None:
    """An obstacle, placed by a pose, shape (4, 4); None for a workspace without any.

    Raises
    ------
    InputError
        If it is in the plane, or something else, its pose is no rigid motion, or its cells do not fit into memory.
    """
    rule = "obstacles are workspaces, shapes, or shapes that are placed"
    raise InputError("obstacles", f"hold {name!r}, a {type(obstacle).__name__}", rule, "pass e.g. Robot.box(...).shape")


@placed_obstacle.register
def _(obstacle: Shape, name: str, base: Floats) -> Placed | None:
    return placed_obstacle(Placed(obstacle, np.eye(4)), name, base)


@placed_obstacle.register
def _(obstacle: Placed, name: str, base: Floats) -> Placed:
    if obstacle.shape.dim != 3:
        raise InputError("obstacles", f"hold {name!r}, a shape of the plane", "arms are in space", "pass a solid")
    return Placed(obstacle.shape, rigid(base @ rigid(obstacle.pose, f"pose of {name}"), name))


@placed_obstacle.register
def _(obstacle: Workspace, name: str, base: Floats) -> Placed | None:
    grid = obstacle.grid
    if grid.dim != 3:
        raise InputError("obstacles", f"hold {name!r}, a map of the plane", "arms are in space", "pass one in space")
    if obstacle.shapes is not None and len(obstacle.shapes) == 1:
        return placed_obstacle(obstacle.shapes[0], name, base)
    check_memory(_CELL_BYTES * grid.size, name, grid, mend="cut it to what the arm reaches")
    held = obstacle.in_memory()
    if not held.outer.any():
        return None
    sides = held.outer, held.inner if held.unknown is None else held.inner & ~held.unknown
    # Cells in a row become one box, or less.
    rows = sum(int(np.count_nonzero(side[..., 1:] > side[..., :-1]) + side[..., 0].sum()) for side in sides)
    rows //= 1 + (sides[0] is sides[1])
    needed = _CELL_BYTES * grid.size + _BOX_BYTES * rows
    check_memory(needed, name, grid, mend=f"cut it to what the arm reaches: its cells are {rows} boxes")
    outer, inner = (Voxels(side.copy() if held.live else side, grid.spacing, np.asarray(grid.lower)) for side in sides)
    return Placed(outer if sides[0] is sides[1] else Bracketed(outer, inner), base)
