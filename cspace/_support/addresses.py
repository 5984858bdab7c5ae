"""Calls of compiled functions by their addresses.

A function that several kernels call, and that takes more than a second to compile, is compiled once
if they call it by its address. A call costs a few nanoseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numba
from numba import types
from numba.core.errors import TypingError
from numba.core.typing.templates import Signature
from numba.extending import NativeValue, intrinsic, models, register_model, unbox


class AddressType(types.Type):
    """Type of addresses of the compiled functions with a signature."""

    bitwidth = 64

    def __init__(self, signature: Signature) -> None:
        """Name the type after the signature."""
        self.signature = signature
        super().__init__(f"AddressType({signature})")


class Address:
    """Address of a compiled function, for kernels that call it.

    It is an argument of these kernels, because it differs from process to process, but their code
    is cached. Its type has the signature, so no kernel calls a function with other arguments.

    Attributes
    ----------
    function : callable
        It keeps the code alive.
    value : int
    """

    def __init__(self, function: Any, argument_types: tuple[types.Type, ...]) -> None:
        """Compile the function, or take it from the cache."""
        function.compile(argument_types)
        compiled = function.overloads[argument_types]
        self.function = function
        self.value: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        self._numba_type_ = AddressType(compiled.signature)


_addresses: Final = dict[tuple[Any, ...], Address]()


def find_address(function: Callable[..., Any], *arguments: Any) -> Address:
    """Return the address of a kernel that returns a number, compiled for arguments like these."""
    argument_types = tuple(map(numba.typeof, arguments))
    key = function, argument_types
    if key not in _addresses:
        _addresses[key] = Address(function, argument_types)
    return _addresses[key]


def _type_call(_: Any, address: Any, arguments: Any) -> Any:
    """Return the signature of :data:`call` for types of arguments, and its code generator."""
    expected = address.signature.args
    result = address.signature.return_type
    # Arrays of another layout would be misread.
    if arguments.types != expected:
        raise TypingError(f"call: arguments are {arguments.types}; they must be {expected}")

    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        """Generate the code of the call."""
        convention = context.call_conv
        type_ = convention.get_function_type(result, expected).as_pointer()
        pointer = builder.inttoptr(values[0], type_)
        each = [builder.extract_value(values[1], k) for k in range(len(expected))]
        status, value = convention.call_function(builder, pointer, result, expected, each)
        with builder.if_then(status.is_error, likely=False):
            convention.return_status_propagate(builder, status)
        return value

    return result(address, arguments), generate


call: Final[Any] = intrinsic(_type_call)
"""``call(address, arguments)``, in kernels, calls a compiled function by its :class:`Address`.

The arguments are a tuple, of exactly the types for which the function is compiled."""


def _unbox_address(_: AddressType, instance: Any, context: Any) -> Any:
    """Generate code that reads the value of an address."""
    value = context.pyapi.object_getattr_string(instance, "value")
    native = context.pyapi.long_as_longlong(value)
    context.pyapi.decref(value)
    return NativeValue(native)  # type: ignore[no-untyped-call]


unbox(AddressType)(_unbox_address)  # type: ignore[no-untyped-call]
register_model(AddressType)(models.IntegerModel)
