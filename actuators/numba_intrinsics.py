"""Numba intrinsics for arrays and calls at addresses; only compilation imports them, or kernels that run as Python."""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.extending import intrinsic

from actuators.object_cache import PLAIN

_WORD, _REAL, _INT = ir.IntType(64), ir.DoubleType(), ir.IntType(32)


def _pointer(kind):
    @intrinsic
    def at(context, address):
        def code(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.int64), code

    return at


reals, singles, wholes = _pointer(types.float64), _pointer(types.float32), _pointer(types.int64)


@intrinsic
def enter(context: Any, entry: Any, x: Any, u: Any, p: Any, dt: float, lanes: Sequence[Any], log: Any) -> Any:
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


def _reader(kind, made):
    @intrinsic
    def at(context, address):
        def code(context, builder, signature, args):
            value = builder.load(builder.inttoptr(args[0], made.as_pointer()), align=1)
            return value if made == _REAL else builder.zext(value, _WORD) if made != _WORD else value

        return kind(types.int64), code

    return at


def _layer(kind, made):
    @intrinsic
    def lay(context, address, value):
        def code(context, builder, signature, args):
            value = args[1] if made in (_REAL, _WORD) else builder.trunc(args[1], made)
            builder.store(value, builder.inttoptr(args[0], made.as_pointer()), align=1)
            return context.get_dummy_value()

        return types.void(types.int64, kind), code

    return lay


# read and store at any address, aligned or not: a double, or the lower 1, 2, 4 and 8 bytes of a whole number, no sign
_KINDS = ((types.float64, _REAL), *((types.int64, ir.IntType(bits)) for bits in (8, 16, 32, 64)))
real, byte, pair, quad, word = (_reader(*kind) for kind in _KINDS)
put, lay_byte, lay_pair, lay_quad, lay_word = (_layer(*kind) for kind in _KINDS)


@intrinsic
def leading_zeros(context: Any, value: Any) -> Any:
    """Return how many of the upper bits of a whole number, not 0, are 0."""

    def code(context, builder, signature, args):
        return builder.ctlz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), code


@intrinsic
def ask(context: Any, function: Callable[..., Any], this: Any) -> Any:
    """Call a getter of C++ at an address, double f(this)."""

    def code(context, builder, signature, args):
        kind = ir.FunctionType(_REAL, [_WORD])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1]])

    return types.float64(types.int64, types.int64), code


@intrinsic
def tell(context: Any, function: Callable[..., Any], this: Any, value: Any) -> Any:
    """Call a setter of C++ at an address, bool f(this, double)."""

    def code(context, builder, signature, args):
        kind = ir.FunctionType(ir.IntType(8), [_WORD, _REAL])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), code


def _plain_pointer(kind):
    return lambda address: ctypes.cast(int(address), ctypes.POINTER(kind))


def _plain_layer(kind):
    def lay(address, value):
        kind.from_address(int(address)).value = value

    return lay


def _plain_enter(entry, x, u, p, dt, lanes, log):
    def records(address, kind):
        return np.ndarray((lanes,), kind, (ctypes.c_char * (kind.itemsize * lanes)).from_address(int(address)))

    block = ctypes.cast(int(entry), ctypes.py_object).value  # an `Entry`, by its `address`
    x, u, p = map(records, (x, u, p), block.kinds)
    block(x, u.reshape(-1, 1), p, dt)


if PLAIN:  # what the kernels of schedule, log and sweep call; JSBSim is not called by address then
    enter = _plain_enter  # type: ignore[assignment]
    reals, singles, wholes = map(_plain_pointer, (ctypes.c_double, ctypes.c_float, ctypes.c_int64))
    put, lay_quad, lay_word = map(_plain_layer, (ctypes.c_double, ctypes.c_uint32, ctypes.c_uint64))
