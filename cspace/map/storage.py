"""How a map stores its states: in a byte a cell, or in two bits where there are very many.

Compiled code takes either by its type, and Python sees both slice by slice, as bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import prod
from typing import Any, Final, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.cpython.unsafe.numbers import leading_zeros, trailing_zeros
from numba.extending import intrinsic
from numpy.typing import DTypeLike, NDArray

from cspace.arrays import FREE, Bytes, Ints, frozen
from cspace.compiling import always_inline, dispatch_on_type, kernel
from cspace.errors import InputError
from cspace.kernels import load_word
from cspace.limits import MAX_MEMORY_FRACTION, bytes_text, free_bytes
from cspace.rotations import CompiledRotations

Halves = tuple[np.uint64, np.uint64]

SPARE: Final = 16
"""Bytes behind the last cell, so that a word may be read from any cell on."""

_ONE, _ONES = np.uint64(1), np.uint64(0x0101010101010101)
_TWO, _THREE = np.uint64(2), np.uint64(3)
_LOWER = np.uint64(0xFFFFFFFF)
_SWAPPED: Final = (0x2222222222222222, 0x0C0C0C0C0C0C0C0C, 0x00F000F000F000F0, 0x0000FF000000FF00, 0x00000000FFFF0000)

zeros_below: Callable[[np.uint64], np.uint64] = trailing_zeros  # type: ignore[assignment]  # what it is when compiled
zeros_above: Callable[[np.uint64], np.uint64] = leading_zeros  # type: ignore[assignment]


class TwoBits(NamedTuple):
    """States in two bits a cell, as compiled code takes them.

    Attributes
    ----------
    packed : ndarray of uint8
        Cell i has the bits from ``2 * (i & 3)`` on of byte ``i >> 2``; :data:`SPARE` bytes follow.
    shape : tuple of int
        Slices, and cells of the grid.
    """

    packed: Bytes
    shape: tuple[int, ...]


MISSING, ASIDE = -1, -2
"""In place of where a tile is: it is not there; it was, in this look-up."""

USED = -1
"""Mark of a tile that was there and read."""


class TileCells(NamedTuple):
    """The states of a map in tiles, as compiled code takes them.

    Attributes
    ----------
    packed : ndarray of uint8
        States of the tiles that are there, four in a byte.
    places : ndarray of int64, shape (chunks,)
        Where the states of each chunk begin, or MISSING, or ASIDE.
    wanted : ndarray of int64, shape (chunks + 1,)
        Gets, for each chunk that was MISSING, which of them it was in turn, and how many they were; for others that
        were read, USED.
    shape : tuple of int
        Slices, and cells of the grid.
    sides, counts : tuple of int
        Slices and cells of a chunk, and number of chunks, along the same axes.
    """

    packed: Bytes
    places: Ints
    wanted: Ints
    shape: tuple[int, ...]
    sides: tuple[int, ...]
    counts: tuple[int, ...]


Cells = Bytes | TwoBits | TileCells


def _prefetch(context: Any, cells: Any, number: Any) -> Any:
    """Have the memory around a byte of an array come near, for it is read soon; it need not lie in the array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        octet, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [octet, whole, whole, whole])
        prefetch = declare(builder.module, kind, "llvm.prefetch.p0i8")
        # To be read, into the caches of this core, as data.
        builder.call(prefetch, [builder.gep(data, [arguments[1]]), whole(0), whole(3), whole(1)])
        return context.get_dummy_value()

    return types.void(cells, types.int64), generate


def _compare_bytes(context: Any, cells: Any, number: Any) -> Any:
    """Which of 64 bytes of an array, from one on, are 1 or more, and which 2 or more, by bits."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data, row = context.make_array(signature.args[0])(context, builder, arguments[0]).data, ir.VectorType(octet, 64)
        states = builder.load(builder.bitcast(builder.gep(data, [arguments[1]]), row.as_pointer()), align=1)
        halves = [builder.icmp_unsigned(">=", states, ir.Constant(row, [least] * 64)) for least in (1, 2)]
        return context.make_tuple(
            builder, signature.return_type, [builder.bitcast(each, ir.IntType(64)) for each in halves]
        )

    octet = ir.IntType(8)
    return types.UniTuple(types.uint64, 2)(cells, types.int64), generate  # type: ignore[no-untyped-call]


def _count(context: Any, word: Any) -> Any:
    """Number of bits of a word that are set."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), generate


declare: Any = cgutils.get_or_insert_function
prefetch: Any = intrinsic(_prefetch)
compare_bytes: Any = intrinsic(_compare_bytes)
popcount: Any = intrinsic(_count)


@always_inline
def word_at(packed: Bytes, number: int) -> np.uint64:
    """The word that begins with a cell."""
    shift = np.uint64(2 * (number & 3))
    word: np.uint64 = load_word(packed, number >> 2) >> shift
    return word | np.uint64(packed[(number >> 2) + 8]) << _ONE << (np.uint64(63) - shift)


@always_inline
def spread(word: np.uint64) -> np.uint64:
    """The eight pairs of bits that a word begins with, each in a byte of its own."""
    word = (word & np.uint64(0xFF)) | ((word & np.uint64(0xFF00)) << np.uint64(24))
    word = (word & np.uint64(0xF0000000F)) | ((word & np.uint64(0xF0000000F0)) << np.uint64(12))
    return (word & np.uint64(0x3000300030003)) | ((word & np.uint64(0xC000C000C000C)) << np.uint64(6))


@always_inline
def parted(word: np.uint64) -> np.uint64:
    """The even bits of a word, side by side, and then the odd ones (Warren, Hacker's Delight, 2012)."""
    for k in range(5):
        shift = np.uint64(1) << np.uint64(k)
        swap = (word ^ (word >> shift)) & np.uint64(_SWAPPED[k])
        word ^= swap ^ (swap << shift)
    return word


# ---- what compiled code calls ----------------------------------------------------------------------------------------


def state_in(cells: Cells, number: int) -> int:
    """State of a cell, by its number in the map."""
    raise NotImplementedError


def prefetch_cell(cells: Cells, number: int) -> None:
    """Have what surrounds a cell come near, for it is read soon; it need not be in the map."""
    raise NotImplementedError


def row_in(cells: Cells, number: int, count: int) -> Halves:
    """Which of up to 64 cells from one on are not FREE, and which are BLOCKED, by bits; the rest are set."""
    raise NotImplementedError


def _byte_soon(cells: Bytes, number: int) -> None:
    prefetch(cells, number)


def _bits_soon(cells: TwoBits, number: int) -> None:
    prefetch(cells.packed, number >> 2)


def _byte_in(cells: Bytes, number: int) -> int:
    state: int = cells[np.uint64(number)]
    return state


def _bits_in(cells: TwoBits, number: int) -> int:
    place = np.uint64(number)
    return int((np.uint64(cells.packed[place >> _TWO]) >> (_TWO * (place & _THREE))) & _THREE)


def _tiled_in(cells: TileCells, number: int) -> int:
    rest, chunk, inside = np.uint64(number), np.uint64(0), np.uint64(0)
    chunks, size = np.uint64(1), np.uint64(1)
    for k in range(len(cells.shape)):
        axis = len(cells.shape) - 1 - k
        length, side = np.uint64(cells.shape[axis]), np.uint64(cells.sides[axis])
        above = rest // length
        place = rest - above * length
        own = place // side
        chunk += own * chunks
        inside += (place - own * side) * size
        chunks *= np.uint64(cells.counts[axis])
        size *= side
        rest = above
    begin = cells.places[chunk]
    if begin >= 0:
        cells.wanted[chunk] = USED
    else:
        if begin == MISSING and cells.wanted[chunk] == 0:
            cells.wanted[-1] += 1
            cells.wanted[chunk] = cells.wanted[-1]
        return FREE
    place = np.uint64(begin) + inside
    return int((np.uint64(cells.packed[place >> _TWO]) >> (_TWO * (place & _THREE))) & _THREE)


@always_inline
def high_bits(number: int) -> np.uint64:
    """The bits of a word from a number on, which may be 64."""
    return ~np.uint64(0) << np.uint64(number) if number < 64 else np.uint64(0)


def _row_of_bytes(cells: Bytes, number: int, count: int) -> Halves:
    taken, blocked = np.uint64(0), np.uint64(0)
    if number + 64 <= cells.size:
        taken, blocked = compare_bytes(cells, number)
    else:
        for k in range(count):
            state, place = np.uint64(cells[number + k]), np.uint64(k)
            taken |= ((state | (state >> _ONE)) & _ONE) << place
            blocked |= (state >> _ONE) << place
    return taken | high_bits(count), blocked | high_bits(count)


def _row_of_bits(cells: TwoBits, number: int, count: int) -> Halves:
    taken, blocked = np.uint64(0), np.uint64(0)
    for first in range(0, count, 32):
        word, place = parted(word_at(cells.packed, number + first)), np.uint64(first)
        taken |= ((word | (word >> np.uint64(32))) & _LOWER) << place
        blocked |= (word >> np.uint64(32)) << place
    return taken | high_bits(count), blocked | high_bits(count)


dispatch_on_type(state_in, {np.ndarray: _byte_in, TwoBits: _bits_in, TileCells: _tiled_in})
dispatch_on_type(row_in, {np.ndarray: _row_of_bytes, TwoBits: _row_of_bits})
dispatch_on_type(prefetch_cell, {np.ndarray: _byte_soon, TwoBits: _bits_soon})


# ---- packing ---------------------------------------------------------------------------------------------------------


@kernel
def pack(states: Bytes, packed: Bytes) -> None:
    """Pack states into bytes, four into each; what is left of the last one is 0."""
    eights, pairs = states[: len(states) // 8 * 8].view(np.uint64), packed[: len(states) // 8 * 2].view(np.uint16)
    for k in range(len(eights)):
        word = eights[k]
        word = (word | (word >> np.uint64(6))) & np.uint64(0x000F000F000F000F)
        word = (word | (word >> np.uint64(12))) & np.uint64(0x000000FF000000FF)
        pairs[k] = word | (word >> np.uint64(24))
    for k in range(2 * len(pairs), (len(states) + 3) // 4):
        packed[k] = 0
    for k in range(8 * len(eights), len(states)):
        packed[k >> 2] |= states[k] << np.uint8(2 * (k & 3))


@kernel
def unpack(packed: Bytes, states: Bytes) -> None:
    """Write the states that bytes hold, four each."""
    pairs, eights = packed[: len(packed) // 2 * 2].view(np.uint16), states[: len(packed) // 2 * 8].view(np.uint64)
    for k in range(len(pairs)):
        eights[k] = spread(np.uint64(pairs[k]))
    for k in range(8 * len(pairs), len(states)):
        states[k] = (packed[k >> 2] >> np.uint8(2 * (k & 3))) & np.uint8(3)


class PackedStates:
    """States in two bits a cell, slice by slice as bytes: what is read of an array of states along its first axis.

    Of a shape, slices and cells of the grid, all are FREE at first, and to be written.
    """

    dtype: Final = np.dtype(np.uint8)

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape, self._each = tuple(map(int, shape)), prod(shape[1:])
        self._packed = np.zeros(-(-self.size // 4) + SPARE, dtype=np.uint8)

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.shape[0] * self._each

    @property
    def nbytes(self) -> int:
        """Bytes that the states take."""
        return self._packed.nbytes

    @property
    def cells(self) -> TwoBits:
        """What compiled code takes; it follows what is written."""
        return TwoBits(read_only(self._packed), self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[Bytes]:
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, number: int | slice) -> Bytes:
        """The states of a slice, or of several, a new array, which is not to be written."""
        if isinstance(number, slice):
            return np.stack([self[k] for k in range(len(self))[number]])
        number = range(len(self))[number]  # also from the end, and no further
        first, last, begin = self._around(number * self._each, self._each)
        states = np.empty(4 * (last - first), dtype=np.uint8)
        unpack(self._packed[first:last], states)
        return read_only(states[begin : begin + self._each].reshape(self.shape[1:]))

    def write(self, number: int, states: Bytes) -> None:
        """Replace the states of a slice; one thread at a time."""
        first, last, begin = self._around(number * self._each, self._each)
        row = states.reshape(-1)
        if 4 * (last - first) != len(row):  # the slices before and after have a part of its first and last byte
            row = np.empty(4 * (last - first), dtype=np.uint8)
            unpack(self._packed[first:last], row)
            row[begin : begin + self._each] = states.reshape(-1)
        pack(row, self._packed[first:last])

    def copy(self) -> PackedStates:
        """The same states, to be written by themselves."""
        other = PackedStates(self.shape)
        other._packed[...] = self._packed
        return other

    def counts(self) -> Ints:
        """Number of FREE, MIXED and BLOCKED cells of each slice, shape (slices, 3)."""
        counts = np.empty((len(self), 3), dtype=np.int64)
        for number, row in enumerate(counts):
            first, last, begin = self._around(number * self._each, self._each)
            part = self._packed[first:last]
            if 4 * len(part) != self._each:
                part = part.copy()
                part[0] &= 255 << 2 * begin & 255
                part[-1] &= 255 >> 2 * (4 * len(part) - begin - self._each)
            row[1:] = np.bitwise_count(part & 0x55).sum(), np.bitwise_count(part & 0xAA).sum()
            row[0] = self._each - row[1] - row[2]
        return counts

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """All states as bytes.

        Raises InputError if they do not fit into memory.
        """
        check_bytes(self.size)
        return np.stack(list(self)).astype(self.dtype if dtype is None else dtype, copy=False)

    def _around(self, start: int, count: int) -> tuple[int, int, int]:
        """First byte of some cells, the one after their last, and which cell of it is the first of them."""
        return start // 4, -(-(start + count) // 4), start % 4


Stack = Bytes | PackedStates
"""States by slice, as Python holds them."""


def cells_of(states: Stack) -> Cells:
    """All states in a row, as compiled code takes them."""
    return states.cells if isinstance(states, PackedStates) else states.reshape(-1)


def record_of(states: Stack) -> Cells:
    """All states, of which compiled code reads the shape."""
    return states.cells if isinstance(states, PackedStates) else states


def read_only_of(states: Stack) -> Stack:
    """The states, not to be written; those in two bits never are through what they give."""
    return states if isinstance(states, PackedStates) else read_only(states)


def counts_of(states: Stack) -> Ints:
    """Number of FREE, MIXED and BLOCKED cells of each slice, shape (slices, 3)."""
    if isinstance(states, PackedStates):
        return states.counts()
    return np.array([np.bincount(part.reshape(-1), minlength=3) for part in states])


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A view of the array, in one piece, that is not to be written."""
    return frozen(np.ascontiguousarray(array).view())


def check_bytes(states: int) -> None:
    """Refuse to make a byte of each of so many states where they do not fit into memory."""
    free = free_bytes()
    if states > MAX_MEMORY_FRACTION * free:
        raise InputError(
            "the state of every cell",
            f"takes {bytes_text(states)}, a byte for each",
            f"at most {bytes_text(MAX_MEMORY_FRACTION * free)} of memory may be used",
            "ask for one rotation at a time, with states_at",
            value=states,
        )


class Map(NamedTuple):
    """States over rotation cells times cells of a grid, in the plane or in space, whether the robot turns or not.

    The arrays are views of the map's own: an update of the workspace is seen through the record.

    Attributes
    ----------
    states : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz), or TwoBits
        FREE, MIXED or BLOCKED; read-only, in C order. Compiled code reads its shape alone.
    cells : ndarray of uint8, shape (slices * nx * ny,) or (slices * nx * ny * nz,), or TwoBits
        The same in a row; compiled code reads it by :mod:`cspace.map.storage` alone.
    rotations : NamedTuple
        The rotation cells, and the slice that each has; look-ups call its methods alone.
    lower, upper : tuple of float, length d
        Corners of the grid, metres.
    spacing : float
    exterior : ndarray of int64, shape (slices, 2 d + 1)
        What lies outside the grid: :attr:`cspace.map.exterior.Exterior.table`.
    """

    states: Cells
    cells: Cells
    rotations: CompiledRotations
    lower: tuple[float, ...]
    spacing: float
    upper: tuple[float, ...]
    exterior: Ints

    @property
    def slice_of(self) -> Ints:
        """The slice of each rotation cell, shape (rotations,)."""
        return np.asarray(self.rotations.slice_of)
