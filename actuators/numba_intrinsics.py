"""Numba intrinsics for values and functions at addresses; only compilation imports them."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.extending import intrinsic


def taken_as(kind: Any) -> Any:
    """Return the function of kernels that takes an address as a value of a Numba type: as a pointer or a record."""

    @intrinsic
    def at(context, address):
        def code(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return kind(types.int64), code

    return at


def calling(result: Any) -> Any:
    """Return the function of kernels that calls the C function at an address with a tuple of whole numbers and doubles;
    `result` is the Numba type of what it returns, void where nobody wants it."""

    @intrinsic
    def call(context, address, given):
        def code(context, builder, signature, args):
            values = cgutils.unpack_tuple(builder, args[1])
            kind = ir.FunctionType(context.get_value_type(result), [value.type for value in values])
            return builder.call(builder.inttoptr(args[0], kind.as_pointer()), values)

        return result(types.int64, given), code

    return call


float64_at, int64_at = (taken_as(types.CPointer(kind)) for kind in (types.float64, types.int64))
call, call_float64 = calling(types.void), calling(types.float64)


@intrinsic
def store_float64(context: Any, address: Any, value: Any) -> Any:
    """Store a double at any address, aligned or not."""

    def code(context, builder, signature, args):
        builder.store(args[1], builder.inttoptr(args[0], args[1].type.as_pointer()), align=1)
        return context.get_dummy_value()

    return types.void(types.int64, types.float64), code
