"""Checks of spaces, and of the answers of a user's space."""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np
from numpy.typing import ArrayLike

from cspace import Space
from cspace.errors import InputError
from cspace.inside import AXES, ConfigurationSpace, Floats, check_finite

POSE_AXES: Final = frozenset({*AXES, "yaw", "qx", "qy", "qz", "qw"})
"""Names of the coordinates of a rigid body's pose."""


def check_space(space: object) -> None:
    """Raise InputError unless ``space`` is a well-described :class:`cspace.Space`."""
    # Proxies claim another object's class, and give other answers.
    if not issubclass(type(space), Space):
        raise InputError(
            "space",
            f"is a {type(space).__name__}",
            "it must be a cspace.Space, as the results of cspace.build and cspace.open are",
        )
    if not isinstance(space, ConfigurationSpace):
        _check_own_space(cast(Space, space))


def _check_own_space(space: Space) -> None:
    """Raise InputError unless a user's space describes itself consistently.

    Otherwise searches and trajectories would silently assume another space.
    """
    _check_axes(space)
    _check_rotation(space)
    _check_searches(space)
    read_bounds(space)
    count = np.shape(space.units)
    if count != (space.size,):
        rule = f"there is one text for each of {', '.join(space.axes)}"
        raise InputError("units", f"are {space.units!r}", rule)


def read_bounds(space: Space) -> tuple[Floats, Floats]:
    """Return the bounds of a space, or raise InputError."""
    bounds: Any = space.bounds
    rows = check_finite(bounds, "bounds")
    if rows.shape != (2, space.dim) or (rows[0] > rows[1]).any():
        rule = f"they must be two rows of {space.dim} numbers, the lower ones first"
        raise InputError("bounds", f"are {space.bounds!r}", rule)
    return rows[0], rows[1]


def check_found_path(space: Space, path: ArrayLike) -> Floats:
    """Return a path that a space's search found, shape (n, size).

    An empty path has shape (0, size). Raises InputError unless all rows are configurations within
    the bounds, which tests of motions may rely on.
    """
    rows = check_finite(path, "search")
    if not rows.size:
        return np.empty((0, space.size))
    if rows.ndim != 2 or rows.shape[1] != space.size:
        rule = f"it returns rows of {', '.join(space.axes)}"
        raise InputError("search", f"returned the shape {rows.shape}", rule)
    lower, upper = read_bounds(space)
    positions = rows[:, : space.dim]
    is_bounded = ~np.array(space.is_periodic)[: space.dim]
    # Rounding may lead a path out of the bounds.
    slack = 1e-9 * (upper - lower)
    is_beyond = (positions < lower - slack) | (positions > upper + slack)
    is_outside = (is_bounded & is_beyond).any(axis=1)
    for row in rows[is_outside][:1].tolist():
        problem = f"returned the row {tuple(row)}"
        raise InputError("search", problem, f"a path stays within the bounds {space.bounds!r}")
    return rows


def _check_axes(space: Space) -> None:
    """Raise InputError unless the axes are different names."""
    axes: object = space.axes
    are_names = isinstance(axes, list | tuple) and all(isinstance(name, str) for name in axes)
    if not (isinstance(axes, tuple) and are_names and axes and len(set(axes)) == len(axes)):
        raise InputError("axes", f"are {axes!r}", "they must be a tuple of different names")


def _check_rotation(space: Space) -> None:
    """Raise InputError for names of rotations outside a pose."""
    if space.has_poses:
        return
    for axis, is_periodic in zip(space.axes, space.is_periodic, strict=True):
        is_rotation = axis in POSE_AXES and axis not in AXES
        if not is_rotation or (axis == "yaw" and is_periodic):
            continue
        problem = f"are {space.axes!r}"
        rule = f"only a pose, without other axes, has {axis!r} as its rotation"
        raise InputError("axes", problem, rule)


def _check_searches(space: Space) -> None:
    """Raise InputError if a space names its searches badly."""
    names: object = space.searches
    if not (isinstance(names, tuple) and all(isinstance(name, str) for name in names)):
        rule = "they must be a tuple of names"
        raise InputError("searches", f"are {names!r}", rule)
