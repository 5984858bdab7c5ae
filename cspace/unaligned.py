"""Unaligned words: eight bytes that compiled code reads from arrays of bytes, or writes, wherever they begin."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _load(context: Any, octets: Any, number: Any) -> Any:
    """The word that begins with a byte of an array, wherever that lies; seven more must follow it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_place(context, builder, signature, arguments), align=1)

    return types.uint64(octets, types.int64), generate


def _store(context: Any, octets: Any, number: Any, word: Any) -> Any:
    """Write a word over the byte of an array and the seven that follow it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _place(context, builder, signature, arguments), align=1)
        return context.get_dummy_value()

    return types.void(octets, types.int64, types.uint64), generate


def _place(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
    return builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(64).as_pointer())


# A view of bytes as words takes a quarter of a second to compile.
load: Any = intrinsic(_load)
store: Any = intrinsic(_store)
