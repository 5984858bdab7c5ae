"""Batches of configurations, and single ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.check import check_rows
from cspace.errors import InputError
from cspace.rotations import Rotations
from cspace.rotations.base import warn_of_degrees
from cspace.threads import MIN_ITEMS_PER_THREAD, in_chunks

Kernel = Callable[..., int]
"""``kernel(*rows, out)`` fills ``out``, shape (n,), from rows of shape (n, d). It returns the first
unusable row's index, or -1."""

Query = Callable[[Sequence[Any], NDArray[Any]], int]
"""``query(parts, out)`` does the same as a kernel for a batch of any size and numeric type."""

ScalarType = TypeVar("ScalarType", bound=np.generic)
ReturnType = TypeVar("ReturnType")

Number = np.floating[Any] | np.integer[Any] | np.bool_
Configuration = Sequence[float] | np.ndarray[tuple[int], np.dtype[Number]]
"""Type of one configuration, shape (size,), for type checkers."""

ConfigurationBatch = (
    NDArray[Number]
    | Sequence[Sequence[float]]
    | Sequence[NDArray[Number]]
    | Sequence[Sequence[Sequence[float]]]
)
"""Type of a batch of configurations, shape (..., size), for type checkers."""

NO_ANGLES: Final[Mapping[int, str]] = {}

MIN_EDGES_PER_THREAD: Final = 2_000
"""Edges below which a second thread costs more than it saves."""

ROWS_PER_COPY: Final = 8_192
"""Configurations copied to contiguous float64 at a time, so that they fit a core's cache."""


def evaluate_batch(
    q: ArrayLike,
    size: int,
    query: Query,
    dtype: type[ScalarType],
    scalar: Callable[[Any], ReturnType],
    name: str = "q",
    angles: Mapping[int, str] = NO_ANGLES,
) -> ReturnType | NDArray[ScalarType]:
    """Evaluate a query on one configuration or many.

    Parameters
    ----------
    q : array-like, shape (d,) or (..., d)
        One configuration, or a batch.
    size : int
        Length d of a configuration.
    query : callable
        Query of a batch, as :func:`in_threaded_chunks` makes from a kernel.
    dtype : numpy scalar type
        Type of the result for a batch.
    scalar : callable
        Converts the result for a single configuration.
    name : str
        Name of the configurations in error messages.
    angles : mapping of int to str
        Coordinates, by index and name, that are probably in degrees if beyond a whole turn; only a
        single configuration is checked.

    Raises
    ------
    InputError
        If the last axis is not d long, or a value is not finite.
    """
    points = check_rows(q, name, size)
    flat = points.reshape(-1, size)
    out = np.empty(len(flat), dtype=dtype)
    bad = query([flat], out)
    if bad >= 0:
        raise _unusable_error(flat[bad], name, bad)
    if angles and points.ndim == 1:
        warn_of_degrees(points, angles, name)
    return out.reshape(points.shape[:-1]) if points.ndim > 1 else scalar(out[0])


def evaluate_edges(
    q0: ArrayLike,
    q1: ArrayLike,
    size: int,
    query: Query,
    angles: Mapping[int, str] = NO_ANGLES,
) -> bool | Bools:
    """Evaluate a query on straight edges between two batches.

    Raises InputError as :func:`evaluate_batch` does.
    """
    rows0, rows1 = check_rows(q0, "q0", size), check_rows(q1, "q1", size)
    given, shape = ((rows0, "q0"), (rows1, "q1")), rows0.shape
    if rows1.shape != shape:
        try:
            shape = np.broadcast_shapes(shape, rows1.shape)
        except ValueError as error:
            problem = f"has shape {rows0.shape} and q1 {rows1.shape}"
            raise InputError(
                "q0", problem, "they must broadcast", "pass batches of equal shape", value=q0
            ) from error
        rows0, rows1 = np.broadcast_to(rows0, shape), np.broadcast_to(rows1, shape)
    first, second = rows0.reshape(-1, size), rows1.reshape(-1, size)
    out = np.empty(len(first), dtype=np.bool_)
    bad = query([first, second], out)
    if bad >= 0:
        raise _unusable_error(np.concatenate([first[bad], second[bad]]), "edge", bad)
    if angles:
        for rows, name in given:
            if rows.ndim == 1:
                warn_of_degrees(rows, angles, name)
    return out.reshape(shape[:-1]) if len(shape) > 1 else bool(out[0])


def evaluate_pairs(vertices: Floats, pairs: Ints, query: Query) -> Bools:
    """Evaluate a query on edges (m, 2) of vertices (n, d).

    Raises InputError, with the index of the edge, if a vertex is not usable.
    """
    out = np.empty(len(pairs), dtype=np.bool_)
    bad = query([_SelectedRows(vertices, pairs[:, 0]), _SelectedRows(vertices, pairs[:, 1])], out)
    if bad >= 0:
        raise _unusable_error(vertices[pairs[bad]].reshape(-1), "edge", bad)
    return out


class _SelectedRows:
    """Rows of an array by index, copied slice by slice."""

    def __init__(self, rows: Floats, indices: Ints) -> None:
        self._rows, self._indices = rows, indices

    def __getitem__(self, part: slice) -> Floats:
        return np.take(self._rows, self._indices[part], axis=0)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Floats:
        return self[:]


def as_points(q: ArrayLike, name: str, size: int) -> Floats:
    """Return ``q`` as float64 with a checked last axis.

    Kernels check for finite values.
    """
    return np.asarray(check_rows(q, name, size), dtype=np.float64)


def in_threaded_chunks(kernel: Kernel, min_items: int = MIN_ITEMS_PER_THREAD) -> Query:
    """Return the query of a kernel, run in threads.

    Each thread gets at least ``min_items`` rows.
    """
    return partial(_fill_in_chunks, kernel, min_items)


def _fill_in_chunks(kernel: Kernel, min_items: int, parts: Sequence[Any], out: NDArray[Any]) -> int:
    """Fill ``out`` in threads; return the first unusable row, or -1."""
    if len(out) <= min(min_items, ROWS_PER_COPY):
        return int(kernel(*(as_contiguous(part) for part in parts), out))
    ready = all(
        isinstance(part, np.ndarray)
        and part.dtype == np.float64
        and part.flags.c_contiguous
        and part.flags.writeable
        for part in parts
    )
    step = max(1, len(out)) if ready else ROWS_PER_COPY

    def fill_rows(start: int, stop: int) -> int:
        for a in range(start, stop, step):
            b = min(a + step, stop)
            bad = int(kernel(*(as_contiguous(part[a:b]) for part in parts), out[a:b]))
            if bad >= 0:
                return a + bad - start
        return -1

    return in_chunks(fill_rows, len(out), min_items)


def as_contiguous(rows: NDArray[Any]) -> Floats:
    """Return rows as a contiguous, writeable float64 array.

    Kernels accept no other type.
    """
    floats = np.ascontiguousarray(rows, dtype=np.float64)
    return floats if floats.flags.writeable else floats.copy()


def _unusable_error(values: NDArray[Any], name: str, index: int) -> InputError:
    """Return the error for an unusable row of a batch."""
    numbers = tuple(values.astype(np.float64).tolist())
    hint = "correct or remove such configurations first"
    return InputError(
        name, f"number {index} is {numbers}", Rotations.all_limits(), hint, value=numbers
    )
