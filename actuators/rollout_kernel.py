"""One lane of a block through many ticks, compiled: what `Entry.sweep` calls, cosim/flight/loop/schedule_kernel.py for
a lane alone."""

from typing import Any

from actuators import numba_intrinsics
from actuators.numba_intrinsics import reals, wholes

enter: Any = numba_intrinsics.enter  # Numba gives it the context


def sweep(about: int) -> None:
    """Do what the 14 whole numbers at address `about` say.

    They are: the entry of the block, x, u, bytes of u from tick to tick, p, dt, ticks; the positions in x that are kept
    at every tick, how many, and where; the ticks at which other positions are kept, these, how many, and where.
    """
    a = wholes(about)
    u, x, step = a[2], reals(a[1]), reals(a[5])[0]
    index, n, out = wholes(a[7]), a[8], a[9]
    marks, others, m, held = wholes(a[10]), wholes(a[11]), a[12], a[13]
    mark = 0
    for k in range(a[6]):
        enter(a[0], a[1], u, a[4], step, 1, 0)
        row = reals(out)
        for j in range(n):
            row[j] = x[index[j]]
        if marks[mark] == k:
            whole = reals(held)
            for j in range(m):
                whole[j] = x[others[j]]
            held += 8 * m
            mark += 1
        u += a[3]
        out += 8 * n
