"""A user's Python as the rollout of a block: of a detector, a control law or an actuator."""

from collections.abc import Callable
from typing import Any

import numpy as np

Step = Callable[[float, np.ndarray, np.ndarray], Any]


class PythonBlock:
    """Step a user's objects, one for each lane; called as the rollout of a block is (actuators/block.py).

    Whatever an object raises, Ctrl-C apart, `failed` is asked about: it raises an error of its own, or the lane is
    dropped, and the others go on as if nothing had been.
    """

    def __init__(self, make: Callable[[Any, float], Step], failed: Callable[..., Any], *, each: bool = True):
        """`make(p, dt)` returns the `step(t, x, u)` of a lane: x (n,) and u (m,) are its state and inputs as float64;
        unless `each` one step is that of all lanes: p (lanes,), x (lanes, n), u (lanes, m). `failed(lane, t, error)`
        raises, or returns the state of a dropped lane, (n,) or a number.
        """
        self._make, self._failed, self._each = make, failed, each
        self._lanes: list[tuple[Any, Step]] = []
        self.steps, self.seconds = 0, 0.0
        self.notes: list[str] = []  # what is to be said about the part
        self.dropped: list[int] = []

    def __call__(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float, log: np.ndarray | None = None) -> None:
        """Step every lane through every tick; x, p: (lane,), u, log: (lane, tick)."""
        rows, given = (a.view(np.float64).reshape(*a.shape, -1) for a in (x, u))
        if not self._lanes:
            self._begin(p, dt)
        for k in range(u.shape[1]):
            t = self.steps * dt
            for i, (at, step) in enumerate(self._lanes):
                try:
                    step(t, rows[at], given[at, k])
                except KeyboardInterrupt:
                    raise
                except BaseException as error:  # whatever user code raises
                    self._lanes[i] = at, self._drop(i, t, error)
                    self._lanes[i][1](t, rows[at], given[at, k])
            if log is not None:
                log[:, k] = x
            self.steps += 1

    def _begin(self, p, dt):
        for i, at in enumerate(range(len(p)) if self._each else [slice(None)]):
            try:
                self._lanes.append((at, self._make(p[at], dt)))
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # whatever user code raises
                self._lanes.append((at, self._drop(i, 0.0, error)))

    def _drop(self, i, t, error):
        quiet = self._failed(i, t, error)
        self.dropped.append(i)
        return lambda t, x, u: x.__setitem__(..., quiet)


def of_rollout(
    rollout: Callable[..., Any], STATE: Any, INPUTS: Any, failed: Callable[..., Any], *, each: bool = True
) -> PythonBlock:
    """Return a `rollout` in plain Python as a PythonBlock: called lane by lane, or unless `each` with all at once."""

    def make(p, dt):
        def step(t, x, u):
            rollout(x.view(STATE).reshape(-1), u.copy().view(INPUTS).reshape(-1, 1), np.atleast_1d(p), dt)

        return step

    return PythonBlock(make, failed, each=each)
