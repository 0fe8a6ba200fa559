"""Execution of a segment of the schedule: what each of its rows means. It is compiled, and the same source runs as
Python where nothing is."""

from typing import Any

from numba import carray, njit

from actuators import numba_intrinsics
from actuators.numba_intrinsics import reals, singles, wholes
from cosim.flight.loop.operations import ADD, CLOCK, COPY, GET, KEEP, NOISE, PUT, SCALE, SCATTER, STEP, TRUTH, WIDTH
from cosim.flight.plant.jsbsim_signals import to_si

enter: Any = numba_intrinsics.enter  # Numba gives them the context
ask: Any = numba_intrinsics.ask
tell: Any = numba_intrinsics.tell
store: Any = numba_intrinsics.put


@njit(error_model="numpy")
def _copy(n, to, source, v):
    for i in range(n):
        v[to[i]] = v[source[i]]


def walk(table: Any, n: int, bus: Any, first: int, stop: int) -> None:
    """Do the `n` rows at address `table` on the bus vector at address `bus` for the ticks first <= k < stop."""
    rows, v = carray(wholes(table), n * WIDTH), reals(bus)
    for k in range(first, stop):
        for i in range(n):
            row = rows[i * WIDTH : (i + 1) * WIDTH]
            operation, a = row[0], row[1]
            if operation == STEP:
                if k % row[7] == 0:
                    enter(a, row[2], row[3], row[4], reals(row[5])[0], row[6], 0)
            elif operation == COPY:
                _copy(a, wholes(row[2]), wholes(row[3]), v)
            elif operation == KEEP:
                index = wholes(row[2])
                if row[4] == 4:
                    out = singles(row[3] + 4 * a * (k % row[5]))
                    for j in range(a):
                        out[j] = v[index[j]]
                else:
                    kept = reals(row[3] + 8 * a * (k % row[5]))
                    for j in range(a):
                        kept[j] = v[index[j]]
            elif operation == NOISE:
                to, block = wholes(row[2]), reals(row[3] + 8 * a * (k % row[4]))
                vector = reals(row[5])
                for j in range(a):
                    vector[to[j]] = block[j]
            elif operation == ADD:
                clear, to, source = wholes(row[2]), wholes(row[4]), wholes(row[5])
                for j in range(a):
                    v[clear[j]] = 0.0
                for j in range(row[3]):
                    v[to[j]] += v[source[j]]
            elif operation == TRUTH:
                frame, out = reals(row[5]), carray(reals(bus + 8 * row[4]), a)
                to_si(carray(reals(row[2]), a), carray(reals(row[3]), a), out, frame[0], frame[1], frame[2])
            elif operation == GET:
                nodes, raw = wholes(row[2]), reals(row[4])
                for j in range(a):
                    raw[j] = ask(row[3], nodes[j])
            elif operation == PUT:
                nodes, values = wholes(row[2]), reals(row[4])
                for j in range(a):
                    tell(row[3], nodes[j], values[j])
            elif operation == SCALE:
                given, factors, divisors, scaled = reals(row[2]), reals(row[3]), reals(row[4]), reals(row[5])
                for j in range(a):
                    scaled[j] = given[j] * factors[j] / divisors[j]
            elif operation == SCATTER:
                wanted, at = wholes(row[2]), wholes(row[3])
                if k % row[6] == 0:
                    base = row[4] + row[5] * (k // row[6] % row[7])
                    for j in range(a):
                        store(base + at[j], v[wanted[j]])
                at[a] = k + 1
            elif operation == CLOCK:
                v[a] = k * reals(row[2])[0]
