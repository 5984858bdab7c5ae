"""Rotations that a caller passes, as matrices."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import finite

NEAR: Final = 1e-6
"""How far a matrix may be from a rotation; the nearest one is taken."""


def rotation_matrix(rotation: Any, dim: int) -> NDArray[np.float64]:
    """The matrix of a rotation, shape (dim, dim).

    Parameters
    ----------
    rotation : float, array-like of shape (dim, dim), or scipy.spatial.transform.Rotation
        Radians, in the plane; or a matrix.
    dim : int

    Raises
    ------
    InputError
        If it is none of these.
    """
    values = finite(rotation.as_matrix() if hasattr(rotation, "as_matrix") else rotation, "rotation")
    if dim == 2 and values.ndim == 0:
        sine, cosine = math.sin(float(values)), math.cos(float(values))
        return np.array([[cosine, -sine], [sine, cosine]])
    if values.shape == (dim, dim):
        left, stretch, right = np.linalg.svd(values)
        if np.abs(stretch - 1.0).max() <= NEAR and np.linalg.det(values) > 0.0:
            return np.asarray(left @ right)
    kinds = (
        "an angle in radians, or a matrix of shape (2, 2)" if dim == 2 else "a Rotation, or a matrix of shape (3, 3)"
    )
    raise InputError(f"rotation is {rotation!r}; it must be {kinds} that turns and neither stretches nor mirrors")
