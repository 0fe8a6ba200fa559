"""The block: the one contract that everything stepped in the testbed keeps.

A block is a module with

    PARAMS, INPUTS, STATE   structured dtypes made by `dtype`, every element f8 (arrays too), unit beside each field
    OUTPUTS                 names of the STATE fields that are logged at every tick; the others are hidden state
    params(...) -> PARAMS   one record, ordinary NumPy/SciPy; design happens here
    init(p) -> STATE        records of the same shape as `p`, the state before the first tick, `zero_state(STATE)` where
                            all of it is zero; of what moves a surface init_at(p, where, load ...), at rest
    step(x, u, p, dt)       kernel: advances one record `x` in place from inputs `u`
    rollout = entry(step, STATE, INPUTS, PARAMS)
                            every lane through every tick: rollout(x, u, p, dt, log), see `Entry`

`rollout` is the only entry point: live it is called with one tick, in replay with all of them, in a batch with many
lanes, so that one compiled function serves all three and they agree bit for bit.

A kernel is a deterministic function of its arguments: no global state, no I/O, no random numbers, no exceptions, and no
arrays of its own, which Numba refuses here.

A block with the outputs of a detector (`SAYS`) is checked here once for all, in flight, in replay and in a batch: where
a value of its state is infinite or not a number after a step, it is not valid and does not alarm, and `why`, where it
has one, is NOT_FINITE; its statistic stays as it came out. It is so for as long as the state is.
"""

import ctypes
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from actuators.kernels import JIT, Native

SAYS = ("r", "alarm", "verdict", "isolated_part", "valid")  # outputs of every detector
NOT_FINITE = 11.0  # among the codes of fdi/common/why.py
EXPONENT = 0x7FF0000000000000  # all ones in the exponent: infinite or not a number


def dtype(fields: Any) -> Any:
    """Return a structured dtype whose scalars have attribute access, in plain Python as in a kernel.

    `fields` is a list of (name, "f8"), (name, "f8", unit), (name, "f8", shape) or (name, "f8", shape, unit); a number
    without a unit has "-", and `unit` finds it again. Raises ValueError for any other element type: one float64 vector
    holds a whole tick, and the log and the replay rely on that.
    """
    units = {f[0]: f[-1] for f in fields if len(f) > 2 and isinstance(f[-1], str)}
    made = np.dtype((np.record, [f[:-1] if f[0] in units else f for f in fields]))
    for name in made.names or ():
        base = made[name].base
        if base != np.float64:
            raise ValueError(f"field {name!r} is {base}; every field of a block is f8")
        if hasattr(np.record, name):
            raise ValueError(f"field {name!r} shadows an attribute of np.record; choose another name")
    return np.dtype(made, metadata={"units": units})


def unit(kind: Any, field: str) -> str:
    """Return the unit of `field`, or of an element `field[i]`, of dtype `kind`; "" where its declaration has none."""
    return ((kind.metadata or {}).get("units") or {}).get(field.partition("[")[0], "")


def record(kind: Any, **values: Any) -> np.ndarray:
    """Return a 0-d-like array of shape (1,) of dtype `kind`, zero but for `values`; unknown names raise ValueError."""
    out = np.zeros(1, kind)
    for name, value in values.items():
        out[name][0] = value
    return out


def zero_state(kind: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Return the `init` of a block whose state is zero before the first tick; `kind` is its STATE."""
    return lambda p: np.zeros(p.shape, kind)


class Kernel:
    """A function that Numba compiles into the kernels and entries that call it, at no cost when it is imported; from
    Python it runs as plain Python, with the same bits."""

    def __init__(self, function: Callable[..., Any]):
        functools.update_wrapper(self, function)
        self.py_func = function

    @functools.cached_property
    def _inner(self):
        import numba

        return numba.njit(**JIT)(self.py_func)

    @functools.cached_property
    def compiled(self) -> Callable[..., Any]:
        """The same for a caller in Python that passes many ticks at once; compiling it takes each process seconds."""
        import numba

        return numba.njit(error_model="numpy")(self.py_func)

    @property
    def _numba_type_(self):  # by which a kernel that calls this one knows it
        return self._inner._numba_type_

    def __call__(self, *args: Any) -> Any:
        """Run it as plain Python."""
        return self.py_func(*args)


kernel: Any = Kernel  # the decorator


class Entry:
    """Advance every lane of a block through every tick: `rollout(x, u, p, dt, log)`.

    x, p: (lane,), u: (lane, tick), log: (lane, tick) in STATE or None; x is advanced in place. Compiled it is one
    function of addresses, `native`, whose arguments are

        x, u, p, dt [s], lanes, ticks, log (0 for no log)

    over arrays without gaps. Raises TypeError for an array of another dtype, ValueError for one of another shape.
    """

    def __init__(self, step: Any, STATE: np.dtype, INPUTS: np.dtype, PARAMS: np.dtype):
        self.step, self.kinds = step, (STATE, INPUTS, PARAMS)
        given = (*[ctypes.c_int64] * 3, ctypes.c_double, *[ctypes.c_int64] * 3)
        self.native = Native(f"{step.__module__}:rollout.native", given, self._make, step, *self.kinds)

    def __call__(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float, log: np.ndarray | None = None) -> None:
        """Advance every lane of x (lane,) by the inputs u (lane, tick), into log (lane, tick) where there is one."""
        u, p = np.ascontiguousarray(u), np.ascontiguousarray(p)
        states = np.empty(log.shape, log.dtype) if log is not None and not log.flags.c_contiguous else log
        self.bound(x, u, p, dt, states)()
        if log is not None and states is not log:  # a part of a longer array
            log[:] = states

    def bound(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float, log: np.ndarray | None = None) -> Callable:
        """Return a call without arguments on these arrays: a live tick pays only for its work."""
        arrays = [array for array in (x, u, p, log) if array is not None]
        for array, kind in zip(arrays, (*self.kinds, self.kinds[0])):
            if array.dtype is not kind and array.dtype != kind:
                raise TypeError(f"a block's array is {array.dtype}; it takes {kind}")
        if u.ndim != 2 or x.shape != u.shape[:1] or p.shape != x.shape or (log is not None and log.shape != u.shape):
            shapes = [array.shape for array in arrays]
            raise ValueError(f"x, u, p, log of a block have shapes {shapes}; (lane,), (lane, tick), (lane,), u's")
        if not all(array.flags.c_contiguous for array in arrays):
            raise ValueError("the arrays of a block stand without gaps")
        # by `ctypes`: an array interface would describe every field first, which takes longer than many ticks
        states = 0 if log is None else log.ctypes.data
        call, given = self.native.call, (x.ctypes.data, u.ctypes.data, p.ctypes.data, dt, *u.shape, states)
        return lambda kept=arrays: call(*given)  # the arrays behind the addresses

    def _make(self):
        """Return the function of addresses that Numba compiles."""
        from numba import from_dtype

        from actuators.numba_intrinsics import int64_at, taken_as

        step, names = self.step, set(self.kinds[0].names or ())
        says, why = names.issuperset(SAYS), "why" in names  # known when it is compiled: what is not so is left out
        state_at, inputs_at, params_at = (taken_as(from_dtype(kind)) for kind in self.kinds)
        x_size, u_size, p_size = (kind.itemsize for kind in self.kinds)

        def rollout(x, u, p, dt, lanes, ticks, log):
            for i in range(lanes):
                state, bits, fixed = state_at(x + i * x_size), int64_at(x + i * x_size), params_at(p + i * p_size)
                for k in range(i * ticks, (i + 1) * ticks):
                    step(state, inputs_at(u + k * u_size), fixed, dt)
                    if says:
                        bad = 0
                        for j in range(x_size // 8):
                            bad |= (bits[j] & EXPONENT) == EXPONENT
                        if bad:
                            state.alarm, state.verdict, state.isolated_part, state.valid = 0.0, 0.0, 0.0, 0.0
                            if why:
                                state.why = NOT_FINITE
                    if log:
                        logged = int64_at(log + k * x_size)
                        for j in range(x_size // 8):
                            logged[j] = bits[j]

        return rollout


entry = Entry  # of the block whose kernel is `step`, as modules of blocks write it
