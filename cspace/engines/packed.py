"""Compiled loops over words of 64 cells: the lowest bit of a word is the first cell, and its lowest byte the first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bytes, Ints, Words
from cspace.compiling import inner, reader
from cspace.unaligned import load, store


class Packed(NamedTuple):
    """A map in rows of bits, as many as ``octets`` bytes hold, of which a layer has ``rows``."""

    words: Words
    octets: int
    rows: int


class Scratch(NamedTuple):
    """What a block is made from, and what becomes of it."""

    now: Words
    then: Words
    result: Words
    octets: Bytes  # of the result


_REPEAT = np.uint64(0x0101010101010101)
_SELECT = np.uint64(0x8040201008040201)
_CARRY = np.uint64(0x7F7F7F7F7F7F7F7F)
_ONE, _LAST, _EVERY = np.uint64(1), np.uint64(63), ~np.uint64(0)


@inner
def dilate_block(bits: Words, start: int, runs: Ints, spare: Words, more: Words, result: Words) -> bool:
    """Whether some cell of a set lies at each place from word ``start`` on, moved by any offset of a robot's runs.

    ``runs`` has a row (length, word, shift) for each run of offsets, by ascending length; their number at each length
    is a multiple of four. ``spare`` and ``more`` are as long as ``result`` and the reach of all runs, and a word more.
    False, and nothing is written, where there is nothing in reach.
    """
    size, reach = result.size, spare.size
    any_bit = np.uint64(0)
    source = bits[start : start + reach]
    for k in range(reach):
        any_bit |= source[k]
        spare[k] = source[k]
    if any_bit == 0:
        return False
    for k in range(size):
        result[k] = 0
    length: int = np.int64(1)  # type: ignore[assignment]  # of one type for the compiler from the start
    now, then = spare, more
    for number in range(0, len(runs), 4):
        while length < runs[number, 0]:
            # A bit stands for as many cells from its own on as ``length``.
            step = min(length, runs[number, 0] - length)
            _widen(now, step, then)
            now, then = then, now
            length += step
        _unite(now, runs[number : number + 4], result)
    return True


@inner(forceinline=True)
def _shifted(words: Words, k: np.uint64, shift: np.uint64) -> np.uint64:
    """The word that begins so many bits after the beginning of word k."""
    word: np.uint64 = (words[k] >> shift) | ((words[k + _ONE] << _ONE) << (_LAST - shift))
    return word


@inner
def _widen(now: Words, step: int, then: Words) -> None:
    """``then[k] = now[k] | now[k + step]``, bit by bit; the last ``step`` bits, and a word, are left out."""
    jump, shift = np.uint64(step // 64), np.uint64(step % 64)
    for k in range(now.size - step // 64 - 1):
        then[k] = now[k] | _shifted(now, jump + np.uint64(k), shift)


@inner
def _unite(now: Words, runs: Ints, result: Words) -> None:
    """Add four runs to a result."""
    a, s = np.uint64(runs[0, 1]), np.uint64(runs[0, 2])
    b, t = np.uint64(runs[1, 1]), np.uint64(runs[1, 2])
    c, u = np.uint64(runs[2, 1]), np.uint64(runs[2, 2])
    d, v = np.uint64(runs[3, 1]), np.uint64(runs[3, 2])
    for n in range(result.size):
        k = np.uint64(n)
        result[n] |= (
            _shifted(now, a + k, s) | _shifted(now, b + k, t) | _shifted(now, c + k, u) | _shifted(now, d + k, v)
        )


@inner
def unpack(octets: Bytes, packed: Packed, part: tuple[int, int], any_set: bool, add: bool, out: Bytes) -> None:
    """Write rows of bits into ``out``, shape (layers, rows, cells), or add them.

    ``octets`` holds rows as ``packed`` has them, from the first of a part to before its last; those past the rows of
    ``out`` are left out. Unless something was ``any_set``, all are zero.
    """
    cells, old = out.shape[2], _EVERY if add else np.uint64(0)
    eights = cells // 8
    for row in range(part[1] - part[0]):
        x, y = (part[0] + row) // packed.rows, (part[0] + row) % packed.rows
        if x >= out.shape[0] or y >= out.shape[1]:
            continue
        line = out[x, y]
        if not any_set:
            for k in range(0 if add else cells):
                line[k] = 0
            continue
        first = row * packed.octets
        for k in range(eights):
            store(line, 8 * k, (load(line, 8 * k) & old) + spread(np.uint64(octets[first + k])))
        for k in range(8 * eights, cells):
            bit = (octets[first + k // 8] >> np.uint8(k % 8)) & np.uint8(1)
            line[k] = line[k] + bit if add else bit


@inner(forceinline=True)
def spread(byte: np.uint64) -> np.uint64:
    """The bits of a byte, as 0 or 1 in each byte of a word."""
    return ((((byte * _REPEAT) & _SELECT) + _CARRY) >> np.uint64(7)) & _REPEAT


@reader
def settle_block(
    packed: Packed, runs: Ints, scratch: Scratch, part: tuple[int, int], add: bool, out: NDArray[np.uint8]
) -> None:
    """Dilate the rows from the first of a part, which begins a word, to before its last; write or add them."""
    start = part[0] * packed.octets // 8
    any_set = dilate_block(packed.words, start, runs, scratch.now, scratch.then, scratch.result)
    unpack(scratch.octets, packed, part, any_set, add, out)
