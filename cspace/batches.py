"""Batches: one configuration or many in, one number or an array out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import unmasked
from cspace.rotations import MAX_YAW
from cspace.threads import in_chunks

Floats = NDArray[np.float64]

EDGES_A_THREAD = 2_000
"""Edges below which a second thread costs more than it saves."""


def answer(q: ArrayLike, dof: int, kernel: Callable[..., int], dtype: type[Any], scalar: Callable[[Any], Any]) -> Any:
    """What a kernel gives for configurations.

    Parameters
    ----------
    q : array-like, shape (d,) or (..., d)
    dof : int
        The length d of a configuration.
    kernel : callable
        ``kernel(points, out)`` fills ``out``, shape (n,), for points of shape (n, d); it gives the index of the first
        point that is not finite, or -1.
    dtype : numpy scalar type
        Of the answer to a batch.
    scalar : callable
        Makes the answer to a single configuration.

    Raises
    ------
    InputError
        If the last axis is not d long, or a value is not a finite number.
    """
    points = as_points(q, "q", dof)
    flat = np.ascontiguousarray(points.reshape(-1, points.shape[-1]))
    out = np.empty(len(flat), dtype=dtype)
    bad = in_chunks(lambda start, stop: int(kernel(flat[start:stop], out[start:stop])), len(flat))
    if bad >= 0:
        raise _not_finite(flat[bad], "q", bad)
    return out.reshape(points.shape[:-1]) if points.ndim > 1 else scalar(out[0])


def answer_edges(q0: ArrayLike, q1: ArrayLike, dof: int, kernel: Callable[..., int]) -> Any:
    """What a kernel tells, True or False, of straight edges; as :func:`answer`, with two batches that broadcast."""
    starts, ends = as_points(q0, "q0", dof), as_points(q1, "q1", dof)
    try:
        starts, ends = np.broadcast_arrays(starts, ends)
    except ValueError as error:
        raise InputError(
            f"q0 has shape {starts.shape} and q1 {ends.shape}; they must broadcast; pass batches of equal shape"
        ) from error
    first, second = (np.ascontiguousarray(part.reshape(-1, part.shape[-1])) for part in (starts, ends))
    out = np.empty(len(first), dtype=np.bool_)
    bad = in_chunks(
        lambda start, stop: int(kernel(first[start:stop], second[start:stop], out[start:stop])),
        len(out),
        least=EDGES_A_THREAD,
    )
    if bad >= 0:
        raise _not_finite(np.concatenate([first[bad], second[bad]]), "edge", bad)
    return out.reshape(starts.shape[:-1]) if starts.ndim > 1 else bool(out[0])


def as_points(q: ArrayLike, name: str, dof: int) -> Floats:
    """``q`` as float64 with its last axis checked; whether it is finite is left to the kernels."""
    unmasked(q, name)
    try:
        points = np.asarray(q, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is {q!r}; it must be numeric; pass coordinates in metres, yaw in radians") from error
    if points.ndim == 0 or points.shape[-1] != dof:
        raise InputError(
            f"{name} has shape {points.shape}; its last axis must be {dof} long, one entry for each coordinate; "
            "pass one configuration or a batch of them"
        )
    return points


def _not_finite(values: Floats, name: str, index: int) -> InputError:
    return InputError(
        f"{name} number {index} is {tuple(values.tolist())}; NaN, infinities and a yaw beyond {MAX_YAW:.0f} rad are "
        "refused; drop or replace them first"
    )
