"""Numba intrinsics for arrays and calls at addresses; only compilation imports them."""

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.extending import intrinsic

_WORD, _REAL, _INT = ir.IntType(64), ir.DoubleType(), ir.IntType(32)


def _pointer(kind):
    @intrinsic
    def at(context, address):
        def code(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.int64), code

    return at


float64_at, int64_at = _pointer(types.float64), _pointer(types.int64)


@intrinsic
def call_block(context: Any, entry: Any, x: Any, u: Any, p: Any, dt: float, lanes: Sequence[Any], log: Any) -> Any:
    """Call the entry of a block at address `entry` for one tick; the others as in actuators/block.py, addresses."""

    def code(context, builder, signature, args):
        address, *given = args
        nothing = cgutils.alloca_once(builder, _WORD)
        x, u, p, dt, lanes, log = given
        kind = ir.FunctionType(_INT, [_WORD.as_pointer()] * 2 + [_WORD] * 3 + [_REAL, _WORD, _WORD, _WORD])
        function = builder.inttoptr(address, kind.as_pointer())
        builder.call(function, [nothing, nothing, x, u, p, dt, lanes, ir.Constant(_WORD, 1), log])
        return context.get_dummy_value()

    whole, real = types.int64, types.float64
    return types.void(whole, whole, whole, whole, real, whole, whole), code


@intrinsic
def store_float64(context: Any, address: Any, value: Any) -> Any:
    """Store a double at any address, aligned or not."""

    def code(context, builder, signature, args):
        builder.store(args[1], builder.inttoptr(args[0], _REAL.as_pointer()), align=1)
        return context.get_dummy_value()

    return types.void(types.int64, types.float64), code


@intrinsic
def call_getter(context: Any, function: Callable[..., Any], this: Any) -> Any:
    """Call a getter of C++ at an address, double f(this)."""

    def code(context, builder, signature, args):
        kind = ir.FunctionType(_REAL, [_WORD])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1]])

    return types.float64(types.int64, types.int64), code


@intrinsic
def call_setter(context: Any, function: Callable[..., Any], this: Any, value: Any) -> Any:
    """Call a setter of C++ at an address, bool f(this, double)."""

    def code(context, builder, signature, args):
        kind = ir.FunctionType(ir.IntType(8), [_WORD, _REAL])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), code
