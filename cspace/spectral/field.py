"""A smooth field on a map: how much descriptors overlap at each configuration, and which way that grows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import FIELD_NAMES, Floats, Numbers
from cspace.compiling import compilable, kernel
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.limits import check_memory
from cspace.map.batches import Many, One, answer, in_pieces
from cspace.map.callbacks import callback
from cspace.map.contents import checked_fields
from cspace.map.points import configuration, is_usable, replaced
from cspace.map.storage import Map
from cspace.rotations import Rotations
from cspace.spectral.descriptors import check_dims
from cspace.spectral.overlap import FourierOverlap

BATCH: Final = 2**20  # cells whose values are computed together


class Space(Protocol):
    """What a field needs of a map; :class:`cspace.CSpace` has it all."""

    @property
    def grid(self) -> Grid: ...
    @property
    def rotations(self) -> Rotations: ...
    @property
    def record(self) -> Map: ...


@dataclass(frozen=True, eq=False, slots=True)
class OverlapField:
    """The overlap of a robot's descriptor with that of the obstacles at the middles of a map's cells, and its gradient.

    A measure of penetration that is as smooth as the descriptors: above zero where balls meet, and growing with the
    depth. It is no certificate; the states of the map are.

    Attributes
    ----------
    space : CSpace
    arrays : mapping of str to ndarray of float64, shape (nx, ny(, nz)), or (slices, ...) of a robot that turns
        By the names in ``cspace.arrays.FIELD_NAMES``: the overlap, metres to the power of the dimension, and its
        derivatives along the axes, one power less.

    Raises InputError if arrays are missing or superfluous, or one has not the shape and type of the map's, or is not
    finite.
    """

    space: Space
    arrays: Mapping[str, Floats]

    def __post_init__(self) -> None:
        grid = self.space.grid
        object.__setattr__(self, "arrays", checked_fields(self.arrays, grid.dim, _shape(self.space)))

    @classmethod
    def of(cls, space: Space, overlap: FourierOverlap) -> OverlapField:
        """The field of a map.

        Of a robot that turns, the values of a slice are those at the representative of the first rotation cell that it
        serves.

        ``overlap`` is that of the robot's balls, in the robot's frame, with the obstacles', in the map's. Grown balls,
        such as those of :meth:`FourierOverlap.of_shapes`, overlap before the shapes do.

        Raises InputError if it is none, has another dimension than the map, or memory is too small, and
        MissingPackageError if finufft is not installed.
        """
        given: object = overlap
        if not isinstance(given, FourierOverlap):
            rule, mend = "it must be a FourierOverlap", "make it with e.g. FourierOverlap.of_shapes"
            raise InputError("overlap", f"is a {type(given).__name__}", rule, mend, value=given)
        grid, map_ = space.grid, space.record
        check_dims("overlap", overlap.dim, grid.dim)
        shape, count = map_.states.shape, 1 + grid.dim
        check_memory(8.0 * count * math.prod(shape), "the overlap field", grid)
        arrays = {name: np.empty(shape) for name in FIELD_NAMES[:count]}
        turns = space.rotations.turns(grid.dim)
        for number in range(shape[0]):
            matrix = turns[int(np.argmax(map_.slice_of == number))].matrix
            placed = overlap if matrix is None else overlap.rotated(matrix)
            for rows in np.array_split(np.arange(shape[1]), -(-grid.size // BATCH)):
                cells = np.stack(np.meshgrid(rows, *map(np.arange, shape[2:]), indexing="ij"), axis=-1)
                places = grid.center_of(cells)
                value, gradient = placed.value_and_gradient(places)
                for name, array in zip(arrays, (value, *np.moveaxis(gradient, -1, 0)), strict=True):
                    arrays[name][number, rows] = array
        return cls(space, {name: array.reshape(_shape(space)) for name, array in arrays.items()})

    @property
    def values(self) -> Floats:
        """The overlap at the middle of each cell, shape (nx, ny(, nz)), or (slices, ...) of a robot that turns."""
        return self.arrays[FIELD_NAMES[0]]

    @property
    def cells(self) -> Floats:
        """The same by slice, shape (slices, nx, ny(, nz)), as ``field_at`` takes it."""
        return np.ascontiguousarray(self.values).reshape(self.space.record.states.shape)

    @overload
    def at(self, q: One) -> float: ...  # type: ignore[overload-overlap]
    @overload
    def at(self, q: Many) -> Floats: ...
    @overload
    def at(self, q: ArrayLike) -> float | Floats: ...
    def at(self, q: ArrayLike) -> float | Floats:
        """The overlap at configurations (..., dof), linear between the middles of cells, and not below zero: shape
        (...).

        Metres, and radians. Outside the grid the nearest value in it is taken; of a rotation, that of its cell.

        Raises InputError if the last axis is not dof long, or a value is NaN or infinite.
        """
        overlaps: float | Floats = answer(
            q, self._dof, in_pieces(partial(fields_at, *self._fixed())), np.float64, float
        )
        return overlaps

    def checker(self) -> Callable[..., float]:
        """A quick :meth:`at` of floats: ``check(*q) -> float``; they must be finite, and are not checked."""
        check: Callable[..., float] = callback(Field(*self._fixed()), self._dof)
        return check

    @property
    def _dof(self) -> int:
        return self.space.grid.dim + self.space.rotations.dof

    def _fixed(self) -> tuple[Any, ...]:
        return self.space.record, self.cells


def _shape(space: Space) -> tuple[int, ...]:
    return (*space.rotations.leading(space.record.states.shape[0]), *space.grid.shape)


@kernel
def field_at(map_: Map, values: Floats, q: tuple[float, ...]) -> float:
    """A field, linear between the middles of cells, at a configuration."""
    dim = len(map_.lower)
    cell, shares = replaced(map_.states.shape, 0, map_.rotations.slice_at(q)), map_.lower
    for axis in range(dim):
        n = map_.states.shape[axis + 1]
        place = min(max((q[axis] - map_.lower[axis]) / map_.spacing - 0.5, 0.0), n - 1.0)
        first = min(int(place), max(n - 2, 0))
        cell, shares = replaced(cell, axis + 1, first), replaced(shares, axis, place - first)
    total = 0.0
    for corner in range(1 << dim):
        share, other = 1.0, cell
        for axis in range(dim):
            upper = (corner >> axis) & 1
            share *= shares[axis] if upper else 1.0 - shares[axis]
            other = replaced(other, axis + 1, cell[axis + 1] + upper)
        if share > 0.0:
            total += share * float(values[other])
    return max(total, 0.0)


@compilable
class Field(NamedTuple):
    """The value of a field at a configuration."""

    map_: Map
    values: Floats

    def answer(self, q: Numbers) -> float:
        return field_at(self.map_, self.values, q)


@kernel
def fields_at(map_: Map, values: Floats, points: Floats, out: Floats) -> int:
    """``field_at`` for many configurations; the index of the first that is not usable, or -1."""
    for k in range(len(points)):
        q = configuration(map_, points, k)
        if not is_usable(map_, q):
            return k
        out[k] = field_at(map_, values, q)
    return -1
