"""Records of arrays that kernels read by their address.

A call of a compiled function takes time with each array of its arguments. A kept record is one
argument, whatever it holds. Kernels read its fields by their names, as those of a named tuple; a
field that is a record itself is an address again. Entries of its arrays may change, numbers not.
"""

from __future__ import annotations

import struct
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba._dispatcher import compute_fingerprint
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import NativeValue, models, register_model, unbox
from numba.np.arrayobj import make_array, populate_array

R = TypeVar("R", bound=tuple[Any, ...])

# Numba has no hints for these.
_Tuple: Final[Any] = types.BaseTuple
_typeof: Final[Any] = numba.typeof
_make_array: Final[Any] = make_array
_populate_array: Final[Any] = populate_array

WORD_BYTES: Final = 8
"""Bytes of a number in the memory of a kept record."""


class RecordType(types.Type):
    """Type of the addresses of records with some fields."""

    bitwidth = 64

    def __init__(self, fields: types.NamedTuple) -> None:
        """Name the type after the named tuple."""
        self.fields = fields
        super().__init__(f"RecordType({fields})")

    @property
    def key(self) -> types.NamedTuple:
        """Type of the named tuple, which tells its fields."""
        return self.fields


class _Kept:
    """A record with its memory, which kernels read.

    Attributes
    ----------
    record : NamedTuple
        It keeps the arrays alive. Its attributes are those of this object, too.
    address : int
    """

    def __init__(self, record: tuple[Any, ...]) -> None:
        """Write the record to memory of its own."""
        self.record = record = _release(record)
        words = list[float]()
        _add_words(record, words)
        layout = "".join("d" if isinstance(word, float) else "q" for word in words)
        self._memory = np.frombuffer(struct.pack(layout, *words), dtype=np.int64)
        self.address = self._memory.ctypes.data
        # Numba's own key of types is a hundred times as fast as the types.
        key = compute_fingerprint(record)
        if key not in _types:
            _types[key] = RecordType(_typeof(record))
        self._numba_type_ = _types[key]

    def __getattr__(self, name: str) -> Any:
        """Return a field of the record."""
        return getattr(self.record, name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the record, because memory is elsewhere in other processes."""
        return keep, (self.record,)


_types: Final = dict[bytes, RecordType]()


def keep(record: R) -> R:
    """Keep a record of arrays, records and numbers for kernels, which get its address."""
    return record if isinstance(record, _Kept) else cast("R", _Kept(record))


def _release(value: Any) -> Any:
    """Return a record without kept records in it, so that all of its kind have one type."""
    if isinstance(value, _Kept):
        return value.record
    return value._make(map(_release, value)) if hasattr(value, "_make") else value


def _add_words(value: Any, words: list[float]) -> None:
    """Append the numbers of a value: of an array, where it lies, its shape and its strides."""
    if isinstance(value, np.ndarray):
        words += (value.ctypes.data, *value.shape, *value.strides)
    elif isinstance(value, tuple):
        for each in value:
            _add_words(each, words)
    else:
        words.append(value)


def _count_words(type_: Any) -> int:
    """Return the number of words of a field."""
    if isinstance(type_, _Tuple):
        return sum(map(_count_words, type_))
    return 1 + 2 * type_.ndim if isinstance(type_, types.Array) else 1


@infer_getattr
class _FieldTypes(AttributeTemplate):
    """Types of the fields of records."""

    key = RecordType

    def generic_resolve(self, record: Any, name: str) -> Any:  # type: ignore[override]
        """Return the type of a field; None if there is none."""
        if name not in record.fields.fields:
            return None
        found = record.fields.types[record.fields.fields.index(name)]
        return RecordType(found) if isinstance(found, types.NamedTuple) else found


def _read_field(context: Any, builder: Any, record: Any, address: Any, name: str) -> Any:
    """Generate code that reads a field of a record."""
    index = record.fields.fields.index(name)
    first = sum(map(_count_words, record.fields.types[:index]))
    type_ = record.fields.types[index]
    start = builder.add(address, address.type(WORD_BYTES * first))
    if isinstance(type_, types.NamedTuple):
        return start

    def load(word: int, llvm_type: Any) -> Any:
        """Load a word, which never changes."""
        place = builder.add(start, address.type(WORD_BYTES * word))
        loaded = builder.load(builder.inttoptr(place, llvm_type.as_pointer()))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    if isinstance(type_, _Tuple):
        parts = [load(k, context.get_value_type(each)) for k, each in enumerate(type_)]
        return context.make_tuple(builder, type_, parts)
    if not isinstance(type_, types.Array):
        return load(0, context.get_value_type(type_))
    array = _make_array(type_)(context, builder)
    size = context.get_abi_sizeof(context.get_data_type(type_.dtype))
    lengths = [load(1 + k, ir.IntType(64)) for k in range(2 * type_.ndim)]
    _populate_array(
        array,
        data=load(0, array.data.type),
        shape=lengths[: type_.ndim],
        strides=lengths[type_.ndim :],
        itemsize=context.get_constant(types.intp, size),
        meminfo=None,
    )
    return array._getvalue()


def _unbox_address(_: RecordType, instance: Any, context: Any) -> Any:
    """Generate code that reads the address of a record."""
    value = context.pyapi.object_getattr_string(instance, "address")
    native = context.pyapi.long_as_longlong(value)
    context.pyapi.decref(value)
    return NativeValue(native)  # type: ignore[no-untyped-call]


lower_getattr_generic(RecordType)(_read_field)  # type: ignore[no-untyped-call]
unbox(RecordType)(_unbox_address)  # type: ignore[no-untyped-call]
register_model(RecordType)(models.IntegerModel)
