"""Queries of one configuration or many, by one route over rows of an array."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._rotations import Rotations
from cspace._support.arrays import Bools, Floats
from cspace._support.check import check_rows
from cspace._support.column_names import list_dimensions
from cspace._support.threads import MIN_ITEMS_PER_THREAD, run_in_chunks
from cspace._support.units import warn_of_large
from cspace.errors import InputError

Write = Callable[..., int]
"""``write(*rows, out)`` fills ``out``, shape (n,), from rows of shape (n, size).

It returns the index of the first unusable row, or -1.
"""

Entry = TypeVar("Entry", bound=np.generic)

Configuration = tuple[float, ...] | list[float]
"""Type of one configuration, shape (size,); a query of it returns a Python value.

A query of an array, also of one of shape (size,), returns what numpy has for it.
"""

NO_ANGLES: Final[Mapping[int, str]] = {}

MIN_EDGES_PER_THREAD: Final = 2_000
"""Edges below which a second thread costs more than it saves."""


def evaluate(
    q: ArrayLike,
    axes: Sequence[str],
    write: Write,
    dtype: type[Entry],
    angles: Mapping[int, str] = NO_ANGLES,
    name: str = "q",
) -> Any:
    """Evaluate a query on one configuration or many.

    Parameters
    ----------
    q : array-like, shape (d,) or (..., d)
        One configuration, or a batch.
    axes : sequence of str
        Names of the d coordinates.
    write : callable
        Writes the answers of rows.
    dtype : numpy scalar type
        Type of an answer.
    angles : mapping of int to str
        Coordinates, by index and name, that are probably in degrees if beyond a whole turn.
    name : str
        Name of the configurations in error messages.

    Returns
    -------
    number or ndarray, shape (...)

    Raises
    ------
    InputError
        If the last axis is not d long, or a value is not finite.
    """
    is_array = isinstance(q, np.ndarray)
    points = check_rows(q, name, axes)
    rows = as_contiguous(points.reshape(-1, len(axes)))
    out = np.empty(len(rows), dtype=dtype)
    bad = write(rows, out)  # index of the first unusable row, or -1
    if bad >= 0:
        number = f"number {bad} " if points.ndim > 1 else ""
        raise _make_unusable_error(rows[bad], name, number)
    warn_of_large(rows, "rad", name, angles)
    return _shape_answers(out, points.shape[:-1], is_array)


def evaluate_edges(
    q0: ArrayLike,
    q1: ArrayLike,
    axes: Sequence[str],
    write: Write,
    angles: Mapping[int, str],
) -> Any:
    """Evaluate a query on one straight edge or many.

    Both have shape (d,) or (..., d) and broadcast. ``write`` writes True or False for each edge;
    other parameters, results and errors are those of :func:`evaluate`.
    """
    size = len(axes)
    has_array = isinstance(q0, np.ndarray) or isinstance(q1, np.ndarray)
    first_dims, second_dims = list_dimensions(q0), list_dimensions(q1)
    common = min(len(first_dims), len(second_dims))
    if common and first_dims[-common:] != second_dims[-common:]:
        problem = f"has the dimensions {first_dims} and q1 {second_dims}"
        raise InputError("q0", problem, "numpy would pair them by their places")
    starts = check_rows(q0, "q0", axes)
    ends = check_rows(q1, "q1", axes)
    if starts.shape != ends.shape:
        try:
            shape = np.broadcast_shapes(starts.shape, ends.shape)
        except ValueError as error:
            raise InputError(
                "q0",
                f"has shape {starts.shape} and q1 {ends.shape}",
                "they must broadcast",
            ) from error
        starts = np.broadcast_to(starts, shape)
        ends = np.broadcast_to(ends, shape)
    out = evaluate_rows(starts.reshape(-1, size), ends.reshape(-1, size), write)
    warn_of_large(np.atleast_2d(starts), "rad", "q0", angles)
    warn_of_large(np.atleast_2d(ends), "rad", "q1", angles)
    return _shape_answers(out, starts.shape[:-1], has_array)


def evaluate_rows(starts: Floats, ends: Floats, write: Write) -> Bools:
    """Evaluate a query on edges between the rows of two arrays.

    Raises InputError, with the index of the edge, if a row is not usable.
    """
    out = np.empty(len(starts), dtype=np.bool_)
    bad = write(as_contiguous(starts), as_contiguous(ends), out)
    if bad >= 0:
        raise _make_unusable_error(
            np.concatenate([starts[bad], ends[bad]]), "edge", f"number {bad} "
        )
    return out


def write_in_threads(
    kernel: Write, *arrays: NDArray[Any], min_items: int = MIN_ITEMS_PER_THREAD
) -> int:
    """Call ``kernel(*arrays)`` on slices of the arrays in threads.

    Returns what the kernel does. Each thread gets at least ``min_items``.
    """
    if len(arrays[0]) < 2 * min_items:  # at once, because most queries are small
        return int(kernel(*arrays))

    def write_chunk(start: int, stop: int) -> int:
        """Run the kernel on rows [start, stop).

        Returns the first unusable row, counted from ``start``, or -1.
        """
        chunks = [array[start:stop] for array in arrays]
        return int(kernel(*chunks))

    return run_in_chunks(write_chunk, len(arrays[0]), min_items)


def as_contiguous(rows: NDArray[Any]) -> Floats:
    """Return rows as a contiguous, writeable float64 array.

    Kernels accept no other type.
    """
    floats = np.ascontiguousarray(rows, dtype=np.float64)
    return floats if floats.flags.writeable else floats.copy()


def _shape_answers(answers: NDArray[Any], shape: tuple[int, ...], is_array: bool) -> Any:
    """Return answers in the shape of the query.

    That is a Python value for one configuration that is not an array.
    """
    if shape or is_array:
        return answers.reshape(shape)[()]  # a numpy scalar if the shape is ()
    return answers.item()


def _make_unusable_error(values: NDArray[Any], name: str, number: str) -> InputError:
    """Make the error for an unusable row, with its number in a batch."""
    numbers = tuple(values.astype(np.float64).tolist())
    return InputError(name, f"{number}is {numbers}", Rotations._all_limits())
