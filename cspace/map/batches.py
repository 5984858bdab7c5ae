"""Batches: one configuration or many in, one number or an array out."""

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
"""``kernel(*rows, out)`` fills ``out``, shape (n,), for rows of shape (n, d), and gives the index of the first one that
is not usable, or -1."""

Query = Callable[[Sequence[Any], NDArray[Any]], int]
"""``query(parts, out)`` does so for a batch of any size and type of numbers."""

D = TypeVar("D", bound=np.generic)
S = TypeVar("S")

Number = np.floating[Any] | np.integer[Any] | np.bool_
Configuration = Sequence[float] | np.ndarray[tuple[int], np.dtype[Number]]
"""One configuration, shape (size,), as type checkers know it."""

ConfigurationBatch = (
    NDArray[Number] | Sequence[Sequence[float]] | Sequence[NDArray[Number]] | Sequence[Sequence[Sequence[float]]]
)
"""A batch of them, shape (..., size)."""

NO_ANGLES: Final[Mapping[int, str]] = {}

MIN_EDGES_PER_THREAD: Final = 2_000
"""Edges below which a second thread costs more than it saves."""

ROWS: Final = 8_192
"""Configurations that are brought into one piece of float64 at a time, where they are not: these fit a core's cache."""


def evaluate_batch(
    q: ArrayLike,
    size: int,
    query: Query,
    dtype: type[D],
    scalar: Callable[[Any], S],
    name: str = "q",
    angles: Mapping[int, str] = NO_ANGLES,
) -> S | NDArray[D]:
    """The answer for one configuration, or an array of answers for a batch.

    Parameters
    ----------
    q : array-like, shape (d,) or (..., d)
    size : int
        The length d of a configuration.
    query : callable
        Answers for a batch; :func:`in_threaded_chunks` makes one of a kernel.
    dtype : numpy scalar type
        Of the answer to a batch.
    scalar : callable
        Makes the answer to a single configuration.
    name : str
        What error messages call the configurations.
    angles : mapping of int to str
        Numbers of a single configuration, by index and name, that are probably in degrees if beyond a whole turn.

    Raises InputError if the last axis is not d long, or a value is not a finite number.
    """
    points = check_rows(q, name, size)
    flat = points.reshape(-1, size)
    out = np.empty(len(flat), dtype=dtype)
    bad = query([flat], out)
    if bad >= 0:
        raise _not_usable(flat[bad], name, bad)
    if angles and points.ndim == 1:
        warn_of_degrees(points, angles, name)
    return out.reshape(points.shape[:-1]) if points.ndim > 1 else scalar(out[0])


def evaluate_edges(
    q0: ArrayLike,
    q1: ArrayLike,
    size: int,
    query_for: Callable[[int], Query],
    angles: Mapping[int, str] = NO_ANGLES,
) -> bool | Bools:
    """True or False for straight edges; as :func:`answer`, with two batches that broadcast.

    ``query_for(n)`` answers for n edges.
    """
    rows0, rows1 = check_rows(q0, "q0", size), check_rows(q1, "q1", size)
    given, shape = ((rows0, "q0"), (rows1, "q1")), rows0.shape
    if rows1.shape != shape:
        try:
            shape = np.broadcast_shapes(shape, rows1.shape)
        except ValueError as error:
            problem = f"has shape {rows0.shape} and q1 {rows1.shape}"
            raise InputError("q0", problem, "they must broadcast", "pass batches of equal shape", value=q0) from error
        rows0, rows1 = np.broadcast_to(rows0, shape), np.broadcast_to(rows1, shape)
    first, second = rows0.reshape(-1, size), rows1.reshape(-1, size)
    out = np.empty(len(first), dtype=np.bool_)
    bad = query_for(len(out))([first, second], out)
    if bad >= 0:
        raise _not_usable(np.concatenate([first[bad], second[bad]]), "edge", bad)
    if angles:
        for rows, name in given:
            if rows.ndim == 1:
                warn_of_degrees(rows, angles, name)
    return out.reshape(shape[:-1]) if len(shape) > 1 else bool(out[0])


def evaluate_pairs(vertices: Floats, pairs: Ints, query: Query) -> Bools:
    """Return True or False for each edge, shape (m, 2), between vertices, shape (n, d).

    Raises InputError, with the number of the edge, if a vertex is not usable.
    """
    out = np.empty(len(pairs), dtype=np.bool_)
    bad = query([_Chosen(vertices, pairs[:, 0]), _Chosen(vertices, pairs[:, 1])], out)
    if bad >= 0:
        raise _not_usable(vertices[pairs[bad]].reshape(-1), "edge", bad)
    return out


def in_spatial_order(query: Query, lower: Sequence[float], upper: Sequence[float]) -> Query:
    """A query that gets large batches in an order in which near configurations, or starts of edges, follow each other.

    Near are those in the same part of the box from ``lower`` to ``upper``; what is outside goes with what is nearest.
    """
    return partial(_fill_in_order, query, lower, upper)


def _fill_in_order(
    query: Query, lower: Sequence[float], upper: Sequence[float], parts: Sequence[NDArray[Any]], out: NDArray[Any]
) -> int:
    if len(out) < ROWS:
        return query(parts, out)
    side = int(2 ** (16 / len(lower)))
    key = np.zeros(len(out), dtype=np.uint16)  # for which numpy's sorting takes time in proportion to their number
    with np.errstate(over="ignore", invalid="ignore"):  # of what is far outside, or not usable
        for axis, (low, high) in enumerate(zip(lower, upper, strict=True)):
            shares = np.fmax((parts[0][:, axis] - low) * (side / (high - low)), 0.0)
            key = key * np.uint16(side) + np.fmin(shares, side - 1.0).astype(np.uint16)
    order = np.argsort(key, kind="stable")
    answers = np.empty_like(out)
    if query([_Chosen(part, order) for part in parts], answers) >= 0:
        return query(parts, out)  # the first one that is not usable
    out[order] = answers
    return -1


class _Chosen:
    """Rows of an array by their indices; a slice of them is copied when it is read."""

    def __init__(self, rows: Floats, numbers: Ints) -> None:
        self._rows, self._numbers = rows, numbers

    def __getitem__(self, part: slice) -> Floats:
        return np.take(self._rows, self._numbers[part], axis=0)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Floats:
        return self[:]


def as_points(q: ArrayLike, name: str, size: int) -> Floats:
    """``q`` as float64 with its last axis checked; whether it is finite is left to the kernels."""
    return np.asarray(check_rows(q, name, size), dtype=np.float64)


def in_threaded_chunks(kernel: Kernel, least: int = MIN_ITEMS_PER_THREAD) -> Query:
    """An :data:`Query` of a compiled kernel, in threads of at least ``least`` rows each."""
    return partial(_fill, kernel, least)


def _fill(kernel: Kernel, least: int, parts: Sequence[Any], out: NDArray[Any]) -> int:
    """Fill ``out`` by a kernel of parts, shape (n, d), in threads; the index of the first bad row, or -1."""
    if len(out) <= min(least, ROWS):
        return int(kernel(*(as_contiguous(part) for part in parts), out))
    ready = all(
        isinstance(part, np.ndarray) and part.dtype == np.float64 and part.flags.c_contiguous and part.flags.writeable
        for part in parts
    )
    step = max(1, len(out)) if ready else ROWS

    def work(start: int, stop: int) -> int:
        for a in range(start, stop, step):
            b = min(a + step, stop)
            bad = int(kernel(*(as_contiguous(part[a:b]) for part in parts), out[a:b]))
            if bad >= 0:
                return a + bad - start
        return -1

    return in_chunks(work, len(out), least)


def as_contiguous(rows: NDArray[Any]) -> Floats:
    """Rows in one piece of float64 that may be written to, the one sort of array that kernels are compiled for."""
    floats = np.ascontiguousarray(rows, dtype=np.float64)
    return floats if floats.flags.writeable else floats.copy()


def _not_usable(values: NDArray[Any], name: str, index: int) -> InputError:
    """The error for a configuration, or an edge, of a batch."""
    numbers = tuple(values.astype(np.float64).tolist())
    hint = "mend or drop those that are not so first"
    return InputError(name, f"number {index} is {numbers}", Rotations.all_limits(), hint, value=numbers)
