"""A user's Python as the rollout of a block: of a detector, a control law or an actuator."""

import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any

import numpy as np

Step = Callable[[float, np.ndarray, np.ndarray], Any]


class PythonBlock:
    """Step a user's objects, one for each lane; called as the rollout of a block is (actuators/block.py).

    Whatever an object raises, Ctrl-C apart, `failed` is asked about: it raises an error of its own, or the lane is
    dropped, and the others go on as if nothing had been.
    """

    def __init__(self, make: Callable[[Any, float], Step], failed: Callable[..., Any]):
        """`make(p, dt)` returns the `step(t, x, u)` of a lane: x (n,) and u (m,) are its state and inputs as float64.
        `failed(lane, t, error)` raises, or returns the state of a dropped lane, (n,) or a number.
        """
        self._make, self._failed = make, failed
        self._lanes: list[Step] = []
        self.steps, self.seconds = 0, 0.0
        self.notes: list[str] = []  # what is to be said about the part
        self.dropped: list[int] = []

    def __call__(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float, log: np.ndarray | None = None) -> None:
        """Step every lane through every tick; x, p: (lane,), u, log: (lane, tick)."""
        rows, given = (a.view(np.float64).reshape(*a.shape, -1) for a in (x, u))
        with redirect_stdout(sys.stderr):  # standard output is the program's own
            for k in range(u.shape[1]):
                t = self.steps * dt
                for i in range(len(x)):
                    try:
                        if len(self._lanes) == i:
                            self._lanes.append(self._make(p[i], dt))
                        self._lanes[i](t, rows[i], given[i, k])
                    except KeyboardInterrupt:
                        raise
                    except BaseException as error:  # whatever user code raises
                        self._lanes[i : i + 1] = [_quiet(self._failed(i, t, error))]
                        self.dropped.append(i)
                        self._lanes[i](t, rows[i], given[i, k])
                if log is not None:
                    log[:, k] = x
                self.steps += 1


def _quiet(state):
    """Return the step of a dropped lane."""
    return lambda t, x, u: x.__setitem__(..., state)
