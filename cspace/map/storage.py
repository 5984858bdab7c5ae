"""Storage of states in bytes or two bits.

Kernels take either by its type; Python sees both slice by slice, as bytes.
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

from cspace.arrays import Bytes, Ints, frozen
from cspace.compiling import always_inline, dispatch_on_type, kernel
from cspace.errors import InputError
from cspace.kernels import load_word
from cspace.limits import MAX_MEMORY_FRACTION, bytes_text, free_bytes
from cspace.rotations import CompiledRotations

WordPair = tuple[np.uint64, np.uint64]

PADDING_BYTES: Final = 16
"""Bytes after the last cell, so that a word can be read from any cell on."""

_ONE, _ONES = np.uint64(1), np.uint64(0x0101010101010101)
_TWO, _THREE = np.uint64(2), np.uint64(3)
_LOWER = np.uint64(0xFFFFFFFF)
_UNSHUFFLE_MASKS: Final = (
    0x2222222222222222,
    0x0C0C0C0C0C0C0C0C,
    0x00F000F000F000F0,
    0x0000FF000000FF00,
    0x00000000FFFF0000,
)

zeros_below: Callable[[np.uint64], np.uint64] = trailing_zeros  # type: ignore[assignment]  # the type it has in compiled code
zeros_above: Callable[[np.uint64], np.uint64] = leading_zeros  # type: ignore[assignment]


class TwoBits(NamedTuple):
    """States in two bits a cell, for kernels.

    Attributes
    ----------
    packed : ndarray of uint8
        Cell i has the bits from ``2 * (i & 3)`` on of byte ``i >> 2``; :data:`PADDING_BYTES` bytes follow.
    shape : tuple of int
        Slices, and cells of the grid.
    """

    packed: Bytes
    shape: tuple[int, ...]


Cells = Bytes | TwoBits


def _prefetch(context: Any, cells: Any, index: Any) -> Any:
    """Prefetch memory that may lie outside an array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        octet, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [octet, whole, whole, whole])
        prefetch = declare(builder.module, kind, "llvm.prefetch.p0i8")
        # Arguments: for reading, into all caches of this core, as data.
        builder.call(prefetch, [builder.gep(data, [arguments[1]]), whole(0), whole(3), whole(1)])
        return context.get_dummy_value()

    return types.void(cells, types.int64), generate


def _compare_bytes(context: Any, cells: Any, index: Any) -> Any:
    """Compare 64 bytes to 1 and to 2.

    Bit k of the first mask is set if byte k is 1 or more, bit k of the second if it is 2 or more.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data, row = context.make_array(signature.args[0])(context, builder, arguments[0]).data, ir.VectorType(octet, 64)
        states = builder.load(builder.bitcast(builder.gep(data, [arguments[1]]), row.as_pointer()), align=1)
        halves = [builder.icmp_unsigned(">=", states, ir.Constant(row, [threshold] * 64)) for threshold in (1, 2)]
        return context.make_tuple(
            builder, signature.return_type, [builder.bitcast(each, ir.IntType(64)) for each in halves]
        )

    octet = ir.IntType(8)
    return types.UniTuple(types.uint64, 2)(cells, types.int64), generate  # type: ignore[no-untyped-call]


def _count(context: Any, word: Any) -> Any:
    """Count the set bits of a word."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), generate


declare: Any = cgutils.get_or_insert_function
prefetch: Any = intrinsic(_prefetch)
compare_bytes: Any = intrinsic(_compare_bytes)
popcount: Any = intrinsic(_count)


@always_inline
def read_pairs(packed: Bytes, index: int) -> np.uint64:
    """Read 32 pairs of bits from a cell on."""
    shift = np.uint64(2 * (index & 3))
    word: np.uint64 = load_word(packed, index >> 2) >> shift
    return word | np.uint64(packed[(index >> 2) + 8]) << _ONE << (np.uint64(63) - shift)


@always_inline
def spread_pairs(word: np.uint64) -> np.uint64:
    """Spread eight pairs of bits to bytes."""
    word = (word & np.uint64(0xFF)) | ((word & np.uint64(0xFF00)) << np.uint64(24))
    word = (word & np.uint64(0xF0000000F)) | ((word & np.uint64(0xF0000000F0)) << np.uint64(12))
    return (word & np.uint64(0x3000300030003)) | ((word & np.uint64(0xC000C000C000C)) << np.uint64(6))


@always_inline
def unshuffle(word: np.uint64) -> np.uint64:
    """Gather even bits in the low half of a word.

    Odd bits go to its high half. Source: Warren, Hacker's Delight, 2012.
    """
    for k in range(5):
        shift = np.uint64(1) << np.uint64(k)
        swap = (word ^ (word >> shift)) & np.uint64(_UNSHUFFLE_MASKS[k])
        word ^= swap ^ (swap << shift)
    return word


# ---- access from kernels ---------------------------------------------------------------------------------------------


def state_in(cells: Cells, index: int) -> int:
    """Return the state of a cell by index."""
    raise NotImplementedError


def prefetch_cell(cells: Cells, index: int) -> None:
    """Prefetch a cell, which may lie outside the map."""
    raise NotImplementedError


def row_in(cells: Cells, index: int, count: int) -> WordPair:
    """Return bit masks of the cells of a row.

    The first marks the cells that are not FREE, the second the BLOCKED cells. The ``count`` cells, at most 64, begin at
    cell ``index`` of the map. Bits from ``count`` on are set in both masks.
    """
    raise NotImplementedError  # compiled code dispatches on the storage


def _prefetch_byte(cells: Bytes, index: int) -> None:
    prefetch(cells, index)


def _prefetch_pair(cells: TwoBits, index: int) -> None:
    prefetch(cells.packed, index >> 2)


def _state_in_bytes(cells: Bytes, index: int) -> int:
    state: int = cells[np.uint64(index)]
    return state


def _state_in_pairs(cells: TwoBits, index: int) -> int:
    position = np.uint64(index)
    return int((np.uint64(cells.packed[position >> _TWO]) >> (_TWO * (position & _THREE))) & _THREE)


@always_inline
def high_bits(start: int) -> np.uint64:
    """Return a word with the bits from ``start`` on.

    ``start`` may be 64.
    """
    return ~np.uint64(0) << np.uint64(start) if start < 64 else np.uint64(0)


def _row_of_bytes(cells: Bytes, index: int, count: int) -> WordPair:
    taken, blocked = np.uint64(0), np.uint64(0)
    if index + 64 <= cells.size:
        taken, blocked = compare_bytes(cells, index)
    else:
        for k in range(count):
            state, position = np.uint64(cells[index + k]), np.uint64(k)
            taken |= ((state | (state >> _ONE)) & _ONE) << position
            blocked |= (state >> _ONE) << position
    return taken | high_bits(count), blocked | high_bits(count)


def _row_of_pairs(cells: TwoBits, index: int, count: int) -> WordPair:
    taken, blocked = np.uint64(0), np.uint64(0)
    for first in range(0, count, 32):
        word, position = unshuffle(read_pairs(cells.packed, index + first)), np.uint64(first)
        taken |= ((word | (word >> np.uint64(32))) & _LOWER) << position
        blocked |= (word >> np.uint64(32)) << position
    return taken | high_bits(count), blocked | high_bits(count)


dispatch_on_type(state_in, {np.ndarray: _state_in_bytes, TwoBits: _state_in_pairs})
dispatch_on_type(row_in, {np.ndarray: _row_of_bytes, TwoBits: _row_of_pairs})
dispatch_on_type(prefetch_cell, {np.ndarray: _prefetch_byte, TwoBits: _prefetch_pair})


# ---- packing ---------------------------------------------------------------------------------------------------------


@kernel
def pack(states: Bytes, packed: Bytes) -> None:
    """Pack four states into each byte, padded by 0."""
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
    """Unpack four states from each byte."""
    pairs, eights = packed[: len(packed) // 2 * 2].view(np.uint16), states[: len(packed) // 2 * 8].view(np.uint64)
    for k in range(len(pairs)):
        eights[k] = spread_pairs(np.uint64(pairs[k]))
    for k in range(8 * len(pairs), len(states)):
        states[k] = (packed[k >> 2] >> np.uint8(2 * (k & 3))) & np.uint8(3)


class PackedStates:
    """States in two bits, read slice by slice.

    It has the reading interface of an array of states along its first axis. All states are FREE at first.

    Parameters
    ----------
    shape : tuple of int
        Slices, and cells of the grid.
    """

    dtype: Final = np.dtype(np.uint8)

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape, self._each = tuple(map(int, shape)), prod(shape[1:])
        self._packed = np.zeros(-(-self.size // 4) + PADDING_BYTES, dtype=np.uint8)

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
        """Size in bytes."""
        return self._packed.nbytes

    @property
    def cells(self) -> TwoBits:
        """States as kernels take them; they follow writes."""
        return TwoBits(read_only(self._packed), self.shape)

    def __len__(self) -> int:
        """Return the number of slices."""
        return self.shape[0]

    def __iter__(self) -> Iterator[Bytes]:
        """Iterate over slices as bytes."""
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, index: int | slice) -> Bytes:
        """Return states of slices as a new read-only array."""
        if isinstance(index, slice):
            return np.stack([self[k] for k in range(len(self))[index]])
        index = range(len(self))[index]  # accepts negative indices, and raises IndexError
        first, last, begin = self._byte_range(index * self._each, self._each)
        states = np.empty(4 * (last - first), dtype=np.uint8)
        unpack(self._packed[first:last], states)
        return read_only(states[begin : begin + self._each].reshape(self.shape[1:]))

    def write(self, index: int, states: Bytes) -> None:
        """Replace the states of a slice.

        Call it from one thread at a time.
        """
        first, last, begin = self._byte_range(index * self._each, self._each)
        row = states.reshape(-1)
        if 4 * (last - first) != len(row):  # the first and last byte are shared with other slices
            row = np.empty(4 * (last - first), dtype=np.uint8)
            unpack(self._packed[first:last], row)
            row[begin : begin + self._each] = states.reshape(-1)
        pack(row, self._packed[first:last])

    def copy(self) -> PackedStates:
        """Return an independent copy."""
        other = PackedStates(self.shape)
        other._packed[...] = self._packed
        return other

    def counts(self) -> Ints:
        """Count the states of each slice, shape (slices, 3)."""
        counts = np.empty((len(self), 3), dtype=np.int64)
        for index, row in enumerate(counts):
            first, last, begin = self._byte_range(index * self._each, self._each)
            part = self._packed[first:last]
            if 4 * len(part) != self._each:
                part = part.copy()
                part[0] &= 255 << 2 * begin & 255
                part[-1] &= 255 >> 2 * (4 * len(part) - begin - self._each)
            row[1:] = np.bitwise_count(part & 0x55).sum(), np.bitwise_count(part & 0xAA).sum()
            row[0] = self._each - row[1] - row[2]
        return counts

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return all states as bytes.

        Raises InputError if they do not fit into memory.
        """
        check_bytes(self.size)
        return np.stack(list(self)).astype(self.dtype if dtype is None else dtype, copy=False)

    def _byte_range(self, start: int, count: int) -> tuple[int, int, int]:
        """Return the bytes of cells, and the first cell's offset."""
        return start // 4, -(-(start + count) // 4), start % 4


Stack = Bytes | PackedStates
"""States by slice, as Python stores them."""


def cells_of(states: Stack) -> Cells:
    """Return all states in a row, for kernels."""
    return states.cells if isinstance(states, PackedStates) else states.reshape(-1)


def kernel_states(states: Stack) -> Cells:
    """Return states for kernels, and their shape."""
    return states.cells if isinstance(states, PackedStates) else states


def read_only_of(states: Stack) -> Stack:
    """Return read-only states."""
    return states if isinstance(states, PackedStates) else read_only(states)


def count_states(states: Stack) -> Ints:
    """Count the states of each slice, shape (slices, 3)."""
    if isinstance(states, PackedStates):
        return states.counts()
    return np.array([np.bincount(part.reshape(-1), minlength=3) for part in states])


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a contiguous read-only view of an array."""
    return frozen(np.ascontiguousarray(array).view())


def check_bytes(states: int) -> None:
    """Raise InputError if bytes for states exceed the memory."""
    free = free_bytes()
    if states > MAX_MEMORY_FRACTION * free:
        raise InputError(
            "the state of every cell",
            f"takes {bytes_text(states)}, a byte for each",
            f"at most {bytes_text(MAX_MEMORY_FRACTION * free)} of memory may be used",
            "read one rotation at a time, with states_at",
            value=states,
        )


class Map(NamedTuple):
    """States over rotation cells and grid cells, for kernels.

    The arrays are views of the map's own arrays, so workspace updates are visible here.

    Attributes
    ----------
    states : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz), or TwoBits
        FREE, MIXED or BLOCKED; read-only, in C order. Kernels read only its shape.
    cells : ndarray of uint8, shape (slices * nx * ny,) or (slices * nx * ny * nz,), or TwoBits
        The same states in a row; kernels read them through :mod:`cspace.map.storage` only.
    rotations : NamedTuple
        Rotation cells and their slices; kernels call its methods only.
    lower, upper : tuple of float, length d
        Corners of the grid, metres.
    spacing : float
        Side of a cell, metres.
    exterior : ndarray of int64, shape (slices, 2 d + 1)
        States outside the grid: :attr:`cspace.map.exterior.Exterior.table`.
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
        """Slice of each rotation cell, shape (rotations,)."""
        return np.asarray(self.rotations.slice_of)
