"""Obstacles of arms: shapes with poses, in the frame of an arm's base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, cast

import numpy as np
from numpy.typing import ArrayLike

from cspace import Workspace
from cspace.arms._checks import check_rigid
from cspace.errors import InputError, UnitWarning
from cspace.inside import (
    Bools,
    Floats,
    Shape,
    ShapeLike,
    Voxels,
    as_shape,
    check_memory,
    frozen,
    warn_user,
)

_BYTES_PER_CELL: Final = 4
"""Memory per workspace cell while cells are converted to boxes, bytes."""


_BYTES_PER_BOX: Final = 1000
"""Peak memory per such box, including its trees, bytes; 640 to 900 were measured."""


@dataclass(frozen=True, eq=False, init=False)
class PosedShape:
    """A shape at a pose in the frame of a body.

    Parameters
    ----------
    shape : Shape, trimesh.Trimesh or path-like
        Or anything else that ``cspace._shapes.as_shape`` takes; in space, metres.
    pose : array-like, shape (4, 4)
        From the frame of the shape to the frame of the body.

    Raises
    ------
    InputError
        If it is no shape, or the pose is no rigid motion.
    """

    shape: Shape
    pose: Floats

    def __init__(self, shape: ShapeLike, pose: ArrayLike) -> None:
        """Convert the shape, by :func:`cspace._shapes.as_shape`, and the pose.

        Fields of a frozen class are set through ``object``.
        """
        object.__setattr__(self, "shape", as_shape(shape))
        object.__setattr__(self, "pose", frozen(check_rigid(pose, "pose")))


def named_obstacles(obstacles: object) -> Mapping[str, object]:
    """Return obstacles by their names.

    Raises
    ------
    InputError
        If they are neither a workspace nor a mapping.
    """
    named = {"workspace": obstacles} if isinstance(obstacles, Workspace) else obstacles
    if not isinstance(named, Mapping):
        raise InputError(
            "obstacles",
            f"is a {type(obstacles).__name__}",
            "it must be a workspace or a mapping",
        )
    return named


def place_obstacle(obstacle: object, name: str, base: Floats) -> PosedShape | None:
    """Place an obstacle in an arm's base frame.

    ``base``, shape (4, 4), leads from the frame of the obstacles to that of the base. Returns None
    for a workspace without obstacles.

    Raises
    ------
    InputError
        If it is in the plane or no obstacle, its pose is no rigid motion, or its cells do not fit
        into memory.
    """
    if isinstance(obstacle, Workspace):
        return _place_workspace(obstacle, name, base)
    if isinstance(obstacle, PosedShape):
        return place_shape(obstacle.shape, name, base @ obstacle.pose)
    if isinstance(obstacle, Mapping):
        problem = f"hold {name!r}, a {type(obstacle).__name__}"
        raise InputError("obstacles", problem, "arms are in space")
    try:
        shape = as_shape(cast(ShapeLike, obstacle))
    except InputError as error:
        raise type(error)(
            "obstacles",
            f"hold {name!r}, a {type(obstacle).__name__}: {error.argument} {error.problem}",
            error.rule,
            error.hint,
        ) from error
    return place_shape(shape, name, base)


def place_shape(shape: Shape, name: str, pose: Floats) -> PosedShape:
    """Place a shape in space by a rigid motion, shape (4, 4).

    Raises InputError, which names the obstacle ``name``, if the shape is in the plane.
    """
    if shape.dim != 3:
        raise InputError(
            "obstacles",
            f"hold {name!r}, a shape of the plane",
            "arms are in space",
        )
    placed = PosedShape(shape, pose)
    lower, upper = shape.outer.bounds
    middle = placed.pose[:3, :3] @ (0.5 * (lower + upper)) + placed.pose[:3, 3]
    gap = np.linalg.norm(middle) - 0.5 * np.linalg.norm(upper - lower)
    # Largest size, and distance from an arm, metres, of an obstacle whose unit is not suspected.
    suspected = 100.0
    problem = f"{' x '.join(f'{side:.6g} m' for side in upper - lower)} large"
    if gap > suspected:
        problem = f"{gap:.4g} m away from the base of the arm"
    if max(gap, (upper - lower).max()) > suspected:
        warn_user(
            f"the obstacle {name!r} is {problem}; units are metres",
            UnitWarning,
        )
    return placed


def _place_workspace(obstacle: Workspace, name: str, base: Floats) -> PosedShape | None:
    """Place a workspace's occupied cells or shape, or None.

    ``base``, shape (4, 4), leads from the frame of the workspace to that of the arm's base.
    """
    grid = obstacle.grid
    if grid.dim != 3:
        raise InputError(
            "obstacles",
            f"hold {name!r}, a map of the plane",
            "arms are in space",
        )
    # One shape is exact, whereas its cells are not.
    if obstacle.shapes is not None and len(obstacle.shapes) == 1:
        return place_obstacle(obstacle.shapes[0], name, base)
    outer = obstacle.outer
    # Unknown cells may be obstacles, but prove no collision.
    inner = obstacle.inner if obstacle.unknown is None else obstacle.inner & ~obstacle.unknown
    if not outer.any():
        return None
    # Refuse cells whose boxes would not fit into memory.
    runs = _count_runs(outer)
    if inner is not outer:
        runs += _count_runs(inner)
    needed = _BYTES_PER_CELL * grid.size + _BYTES_PER_BOX * runs
    check_memory(needed, name, grid)

    def make_voxels(cells: Bools) -> Voxels:
        """Return cells as a shape that no update changes."""
        return Voxels(cells.copy(), grid.spacing, np.asarray(grid.lower))

    if inner is outer:
        return PosedShape(make_voxels(outer), base)
    return PosedShape(make_voxels(outer).with_inner(make_voxels(inner)), base)


def _count_runs(cells: Bools) -> int:
    """Count runs of occupied cells along the last axis."""
    begins_later = cells[..., 1:] > cells[..., :-1]
    begins_first = cells[..., 0]
    return int(np.count_nonzero(begins_later) + np.count_nonzero(begins_first))
