"""Execution of a segment of the schedule: what each of its rows means. It is compiled."""

from typing import Any

from numba import carray, njit

from actuators import numba_intrinsics
from actuators.numba_intrinsics import float32_at, float64_at, int64_at
from cosim.flight.loop.operations import ADD, CLOCK, COPY, GET, KEEP, NOISE, PUT, SCALE, SCATTER, STEP, TRUTH, WIDTH
from cosim.flight.plant.jsbsim_signals import to_si

call_block: Any = numba_intrinsics.call_block  # Numba gives them the context
call_getter: Any = numba_intrinsics.call_getter
call_setter: Any = numba_intrinsics.call_setter
store: Any = numba_intrinsics.store_float64


@njit(error_model="numpy")
def _copy(n, to, source, v):
    for i in range(n):
        v[to[i]] = v[source[i]]


def walk(table: Any, n: int, bus: Any, first: int, stop: int) -> None:
    """Do the `n` rows at address `table` on the bus vector at address `bus` for the ticks first <= k < stop."""
    rows, v = carray(int64_at(table), n * WIDTH), float64_at(bus)
    for k in range(first, stop):
        for i in range(n):
            row = rows[i * WIDTH : (i + 1) * WIDTH]
            operation, a = row[0], row[1]
            if operation == STEP:
                if k % row[7] == 0:
                    call_block(a, row[2], row[3], row[4], float64_at(row[5])[0], row[6], 0)
            elif operation == COPY:
                _copy(a, int64_at(row[2]), int64_at(row[3]), v)
            elif operation == KEEP:
                index = int64_at(row[2])
                if row[4] == 4:
                    out = float32_at(row[3] + 4 * a * (k % row[5]))
                    for j in range(a):
                        out[j] = v[index[j]]
                else:
                    kept = float64_at(row[3] + 8 * a * (k % row[5]))
                    for j in range(a):
                        kept[j] = v[index[j]]
            elif operation == NOISE:
                to, block = int64_at(row[2]), float64_at(row[3] + 8 * a * (k % row[4]))
                vector = float64_at(row[5])
                for j in range(a):
                    vector[to[j]] = block[j]
            elif operation == ADD:
                clear, to, source = int64_at(row[2]), int64_at(row[4]), int64_at(row[5])
                for j in range(a):
                    v[clear[j]] = 0.0
                for j in range(row[3]):
                    v[to[j]] += v[source[j]]
            elif operation == TRUTH:
                frame, out = float64_at(row[5]), carray(float64_at(bus + 8 * row[4]), a)
                to_si(carray(float64_at(row[2]), a), carray(float64_at(row[3]), a), out, frame[0], frame[1], frame[2])
            elif operation == GET:
                nodes, raw = int64_at(row[2]), float64_at(row[4])
                for j in range(a):
                    raw[j] = call_getter(row[3], nodes[j])
            elif operation == PUT:
                nodes, values = int64_at(row[2]), float64_at(row[4])
                for j in range(a):
                    call_setter(row[3], nodes[j], values[j])
            elif operation == SCALE:
                given, factors = float64_at(row[2]), float64_at(row[3])
                divisors, scaled = float64_at(row[4]), float64_at(row[5])
                for j in range(a):
                    scaled[j] = given[j] * factors[j] / divisors[j]
            elif operation == SCATTER:
                wanted, at = int64_at(row[2]), int64_at(row[3])
                if k % row[6] == 0:
                    base = row[4] + row[5] * (k // row[6] % row[7])
                    for j in range(a):
                        store(base + at[j], v[wanted[j]])
                at[a] = k + 1
            elif operation == CLOCK:
                v[a] = k * float64_at(row[2])[0]
