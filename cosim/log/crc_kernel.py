"""CRC-32 by folding, compiled: shorten a text to a few bytes of the same remainder, with products without carries.

V. Gopal et al., "Fast CRC Computation for Generic Polynomials Using PCLMULQDQ Instruction", Intel, 2009: 128 bits A
that are D bits ahead of B leave the remainder that A_low (x^(D+32) mod P) + A_high (x^(D-32) mod P) + B leaves.
"""

from typing import Any

from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.core.extending import intrinsic

SUMS = 4  # registers that are folded side by side: a product takes four cycles and more
_FEATURES = binding.get_host_cpu_features()
WIDE = all(_FEATURES.get(name) for name in ("vpclmulqdq", "avx512f"))
LANES = 4 if WIDE else 1  # of 128 bits, in a register
STRIDE = 16 * LANES * SUMS  # [byte] of a turn
BLOCK = 256  # [byte], whole strides: what a caller counts in, and gets back
_POLYNOMIAL = 0xEDB88320  # of zlib, its lowest power in the highest bit
_WORD, _BYTE = ir.IntType(64), ir.IntType(8)
_REGISTER = ir.VectorType(_WORD, 2 * LANES)


def _power(n):
    """Return x^n mod P as a factor of a product without carries, which stands one bit lower than its factors."""
    left = 1 << 31
    for _ in range(n):
        left = left >> 1 ^ (_POLYNOMIAL if left & 1 else 0)
    return left << 1


@intrinsic
def _fold(context, data, blocks, state, before):
    def code(context, builder, signature, args):
        data, blocks, state, before = args
        name = "llvm.x86.pclmulqdq" + (".512" if WIDE else "")
        kind = ir.FunctionType(_REGISTER, [_REGISTER, _REGISTER, _BYTE])
        product = cgutils.get_or_insert_function(builder.module, kind, name)
        ahead = ir.Constant(_REGISTER, [_power(8 * STRIDE + 32), _power(8 * STRIDE - 32)] * LANES)
        sums = [cgutils.alloca_once(builder, _REGISTER) for _ in range(SUMS)]

        def read(at, i):
            place = builder.add(at, ir.Constant(_WORD, 16 * LANES * i))
            return builder.load(builder.inttoptr(place, _REGISTER.as_pointer()), align=1)

        for i, held in enumerate(sums):
            value = read(data, i)
            if i == 0:
                first = builder.insert_element(ir.Constant(_REGISTER, [0] * 2 * LANES), before, ir.Constant(_WORD, 0))
                value = builder.xor(value, first)
            builder.store(value, held)
        with cgutils.for_range(builder, blocks, start=ir.Constant(_WORD, 1)) as loop:
            at = builder.add(data, builder.mul(loop.index, ir.Constant(_WORD, STRIDE)))
            for i, held in enumerate(sums):
                value = builder.load(held)
                low, high = (builder.call(product, [value, ahead, ir.Constant(_BYTE, half)]) for half in (0, 0x11))
                builder.store(builder.xor(builder.xor(low, high), read(at, i)), held)
        for i, held in enumerate(sums):
            place = builder.add(state, ir.Constant(_WORD, 16 * LANES * i))
            builder.store(builder.load(held), builder.inttoptr(place, _REGISTER.as_pointer()), align=1)
        return context.get_dummy_value()

    return types.void(*(types.int64,) * 4), code


fold_registers: Any = _fold  # Numba gives it the context


def fold(data: int, blocks: int, state: int, before: int) -> None:
    """Put at address `state`, behind zeros, the BLOCK bytes that leave the remainder of `blocks` times BLOCK at address
    `data`, to whose first bits those of the register `before` (32 bits) are added."""
    fold_registers(data, blocks * (BLOCK // STRIDE), state + BLOCK - STRIDE, before)
