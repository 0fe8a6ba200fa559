"""The block: the one contract that everything stepped in the testbed keeps.

A block is a module with

    PARAMS, INPUTS, STATE   structured dtypes made by `dtype`, every element f8 (arrays too), unit beside each field
    OUTPUTS                 names of the STATE fields that are logged at every tick; the others are hidden state
    params(...) -> PARAMS   one record, ordinary NumPy/SciPy; design happens here
    init(p) -> STATE        records of the same shape as `p`, the state before the first tick
    step(x, u, p, dt)       kernel: advances one record `x` in place from inputs `u`
    rollout = entry(step, STATE, INPUTS, PARAMS)
                            every lane through every tick: rollout(x, u, p, dt, log), see `Entry`

`rollout` is the only entry point: live it is called with one tick, in replay with all of them, in a batch with many
lanes, so that one compiled function serves all three and they agree bit for bit.

A kernel is a deterministic function of its arguments: no global state, no I/O, no random numbers, no exceptions.

A block with the outputs of a detector (`SAYS`) is checked here once for all, in flight, in replay and in a batch: where
a value of its state is infinite or not a number after a step, it is not valid and does not alarm, and `why`, where it
has one, is NOT_FINITE; its statistic stays as it came out. It is so for as long as the state is.
"""

import ctypes
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from actuators.kernels import Native

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


def kernel(function: Callable[..., Any]) -> Any:
    """Let kernels and entries that are compiled call `function`; from Python it runs as plain Python, with the same
    bits."""
    return Kernel(function)


class Kernel:
    """A function that Numba compiles into whatever calls it: importing it costs nothing."""

    def __init__(self, function: Callable[..., Any]):
        functools.update_wrapper(self, function)
        self.py_func = function

    @functools.cached_property
    def _inner(self):
        import numba

        only: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        return numba.njit(error_model="numpy", **only)(self.py_func)

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


@kernel
def _mark_invalid(x):
    """Set alarm, verdict, isolated_part and valid to 0."""
    x.alarm, x.verdict, x.isolated_part, x.valid = 0.0, 0.0, 0.0, 0.0


@kernel
def _mark_invalid_why(x):
    """Do the same and say why."""
    _mark_invalid(x)
    x.why = NOT_FINITE


class Entry:
    """Advance every lane of a block through every tick: `rollout(x, u, p, dt, log)`.

    x, p: (lane,), u: (lane, tick), log: (lane, tick) in STATE or None; x is advanced in place. Compiled it is one
    function of pointers, `native`, whose arguments are

        x*, u*, p*, dt [s], lanes, ticks, log* (null for no log)

    over arrays without gaps. Raises TypeError for an array of another dtype, ValueError for one of another shape.
    """

    def __init__(self, step: Any, STATE: np.dtype, INPUTS: np.dtype, PARAMS: np.dtype):
        self.step, self.kinds = step, (STATE, INPUTS, PARAMS)
        names = STATE.names or ()
        invalid = _mark_invalid_why if "why" in names else _mark_invalid
        self.mark_invalid: Any = invalid if set(SAYS) <= set(names) else None
        pointer, whole = ctypes.c_void_p, ctypes.c_int64
        given = pointer, pointer, pointer, ctypes.c_double, whole, whole, pointer
        roots = filter(None, (step, self.mark_invalid, *self.kinds))
        self.native = Native(f"{step.__module__}:rollout.native", given, self._make, *roots)

    @property
    def address(self) -> int:
        """Return the address of the machine code, which `call_block` of a kernel calls."""
        return self.native.address

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
        call, given = self.native.call, (_at(x), _at(u), _at(p), dt, *u.shape, None if log is None else _at(log))
        return lambda kept=arrays: call(*given)  # the arrays behind the addresses

    def _make(self):
        """Return the function of pointers that Numba compiles, and its types."""
        from numba import carray, from_dtype, types

        from actuators.numba_intrinsics import int64_at

        step, mark_invalid, size = self.step, self.mark_invalid, self.kinds[0].itemsize
        says = mark_invalid is not None

        def rollout(x, u, p, dt, lanes, ticks, log):
            xs, ps = carray(x, lanes), carray(p, lanes)
            us, logs = carray(u, (lanes, ticks)), carray(log, (lanes, ticks))
            kept = logs.ctypes.data != 0
            for i in range(lanes):
                bits = int64_at(xs.ctypes.data + i * size)
                for k in range(ticks):
                    step(xs[i], us[i, k], ps[i], dt)
                    if says:  # known when it is compiled, and left out then
                        bad = 0
                        for j in range(size // 8):
                            bad |= (bits[j] & EXPONENT) == EXPONENT
                        if bad:
                            mark_invalid(xs[i])
                    if kept:
                        logs[i, k] = xs[i]

        state, given, fixed = (types.CPointer(from_dtype(kind)) for kind in self.kinds)
        return rollout, (state, given, fixed, types.float64, types.int64, types.int64, state)


entry = Entry  # of the block whose kernel is `step`, as modules of blocks write it


def _at(array):
    return array.ctypes.data  # an array interface would describe every field first, which takes longer than many ticks
