"""Sets of balls: conversion, rounding of radii, and rotations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.inside import Balls, Floats, check_finite, warn_of_large
from cspace.spectral._decompose import BallDecomposition

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from cspace import Robot

BallsLike: TypeAlias = "BallDecomposition | Balls | Robot | tuple[ArrayLike, ArrayLike]"
"""Types that give balls: a decomposition, a shape or robot of balls, or centers and radii."""

Rotates: TypeAlias = "ArrayLike | Rotation"
"""Types of a rotation: an angle in the plane, radians, a matrix (d, d), or a scipy Rotation."""

PLACEMENT_ROUNDING: Final = 2.0**-50
"""Upper bound of the relative error of rotating and translating a coordinate."""


def as_balls(source: BallsLike, name: str, dim: int | None = None) -> Balls:
    """Convert a source to balls with volume, in ``dim`` dimensions.

    Raises InputError, which names the argument ``name``, for anything else.
    """
    pair: Any = source
    if not isinstance(source, tuple):
        for balls in (source, getattr(source, "shape", None)):  # a robot's shape has its balls
            if isinstance(balls, BallDecomposition | Balls):
                pair = (balls.centers, balls.radii)
                break
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(
            name,
            f"is a {type(source).__name__}",
            "it must have centers and radii, or be a pair of them",
        )
    balls = Balls.of(*pair)
    if (balls.radii <= 0.0).any():
        raise InputError(
            name,
            f"has a radius of {balls.radii.min():g}",
            "each must be above zero",
        )
    if dim and balls.dim != dim:
        raise InputError(
            name,
            f"has {balls.dim} dimensions, its counterpart has {dim}",
            "they must agree",
        )
    return balls


def find_center(balls: Balls) -> Floats:
    """Return the center of the bounding box of the centers, metres."""
    return np.asarray((balls.centers.min(axis=0) + balls.centers.max(axis=0)) / 2)


def round_radii(balls: Balls, number: int, *, grow: bool = True) -> Balls:
    """Round radii to ``number`` sizes of equally many balls.

    Radii grow to the largest one of their size, or become the mean that keeps the summed volume.
    """
    if len(np.unique(balls.radii)) <= number:
        return balls
    shares = 1.0 - np.arange(number) / number
    largest = np.unique(np.quantile(balls.radii, shares, method="higher"))
    size = np.searchsorted(largest, balls.radii)
    if grow:
        return Balls(balls.centers, largest[size])
    volumes = np.bincount(size, balls.radii**balls.dim) / np.bincount(size)
    return Balls(balls.centers, volumes[size] ** (1.0 / balls.dim))


def as_matrices(rotations: Rotates) -> ArrayLike:
    """Convert a scipy Rotation to matrices; return anything else unchanged."""
    converted: ArrayLike = rotations.as_matrix() if hasattr(rotations, "as_matrix") else rotations
    return converted


def rotation_matrix(rotation: Rotates, dim: int) -> Floats:
    """Return the rotation matrix nearest to an angle, matrix or Rotation.

    Raises InputError for anything else.
    """
    values = check_finite(as_matrices(rotation), "rotation")
    if dim == 2 and values.ndim == 0:
        warn_of_large(values[np.newaxis], "rad", "rotation")  # once, though there are many
        sine = math.sin(float(values))
        cosine = math.cos(float(values))
        return np.array([[cosine, -sine], [sine, cosine]])
    if values.shape == (dim, dim):
        # By a singular value decomposition, whose singular values are 1 for a rotation.
        left, stretch, right = np.linalg.svd(values)
        if np.abs(stretch - 1.0).max() <= 1e-6 and np.linalg.det(values) > 0.0:
            return np.asarray(left @ right)
    form = "an angle in radians" if dim == 2 else "a Rotation"
    raise InputError(
        "rotation",
        f"is {rotation!r}",
        f"it must be {form} or a rotation matrix of shape {dim, dim}",
    )
