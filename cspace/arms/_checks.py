"""Checks of the names and numbers that calls and files of arms give."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.inside import ContentError, Floats, check_finite, check_known


def check_distinct(
    names: Iterable[str],
    place: str = "",
    rule: str = "names must differ",
) -> None:
    """Raise ContentError if two names are equal."""
    for name, times in Counter(names).items():
        if times > 1:
            raise ContentError(f"has {name[:40]!r} twice{place}", rule)


def check_mapping(values: Any, name: str, known: Collection[str]) -> dict[str, Any]:
    """Return a mapping, or a Series, of known names as dictionary.

    Raises InputError, with the most similar name, if a name is unknown.
    """
    if not (isinstance(values, Mapping) or hasattr(values, "to_dict")):
        raise InputError(name, f"is {values!r}", "it must map names to numbers")
    return {check_known(key, name, known, "names"): value for key, value in values.items()}


def check_rigid(pose: ArrayLike, name: str) -> Floats:
    """Return a rigid motion, shape (4, 4), with its rotation orthonormalised.

    Raises
    ------
    InputError
        If it is no rigid motion.
    """
    matrix = check_finite(pose, name)
    problem, hint = f"has shape {matrix.shape}", ""
    if matrix.shape == (4, 4):
        rigid, is_rigid = _make_rigid(matrix)
        if is_rigid:
            return rigid
        problem = f"has R = {np.round(matrix[:3, :3], 6).tolist()}"
        if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            problem = f"has the last row {np.round(matrix[3], 6).tolist()}"
        if _make_rigid(matrix.T)[1]:
            hint = f"use numpy.transpose({name})"
    raise InputError(
        name,
        problem,
        "it must be [[R, t], [0, 0, 0, 1]], shape (4, 4), with a rotation matrix R",
        hint,
    )


def _make_rigid(matrix: Floats) -> tuple[Floats, bool]:
    """Return the rigid motion nearest to a matrix, and whether the matrix is it but for rounding.

    A singular value decomposition finds the rotation.
    """
    left, _, right = np.linalg.svd(matrix[:3, :3])
    rigid = np.eye(4)
    rigid[:3, :3] = left @ right
    rigid[:3, 3] = matrix[:3, 3]
    # Largest error of an entry of a rotation matrix, because files round them to five digits.
    is_near = np.abs(rigid - matrix).max() < 1e-5
    return rigid, bool(is_near and np.linalg.det(rigid) > 0.0)


def check_names(values: Iterable[str], name: str) -> list[str]:
    """Return names as a list, also a single string.

    Raises InputError if the values are no list of strings.
    """
    if isinstance(values, str):
        return [values]
    names = list(values) if isinstance(values, Iterable) else [None]
    if not all(isinstance(each, str) for each in names):
        raise InputError(name, f"is {values!r:.100}", "it must be a list of names")
    return names
