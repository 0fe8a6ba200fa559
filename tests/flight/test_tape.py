"""The tape: Python may stand anywhere in a tick."""


import numpy as np

import cosim
from cosim.flight.build import build
from cosim.flight.tick import tick

TICKS = 400
MONITOR = 'detectors.enabled=["position_monitor"]'
FLIGHT = ["faults.0.start_s=0.5", "duration_s=3", "elevator.right_inner=ema"]


def _flown(setup, run):
    """Return the bus after every tick (TICKS, n)."""
    loop = setup.loop
    step = run(loop)
    out = np.empty((TICKS, len(loop.v)))
    for k in range(TICKS):
        step(k)
        out[k] = loop.v
    return out


def test_python_between_the_blocks_and_between_ticks_changes_nothing_by_itself():
    scenario = cosim.load_scenario("liquid-ofc", [*FLIGHT, MONITOR])
    seen = []

    def in_python(loop):
        for block in (loop.law, *loop.detectors, loop.servos[0]):
            block.module = _Plain(block.module)
        return lambda k: tick(loop, k, lambda v: seen.append(v[loop.bus.index("clock.clock.t")]))

    alone = _flown(build(scenario), lambda loop: lambda k: tick(loop, k))
    np.testing.assert_array_equal(alone, _flown(build(scenario), in_python))
    np.testing.assert_array_equal(seen, np.arange(TICKS) * 0.005)


class _Plain:
    """A block's module whose rollout is a call of Python."""

    def __init__(self, module):
        self._module = module

    def rollout(self, x, u, p, dt, log=None):
        """Advance as the module does."""
        self._module.rollout(x, u, p, dt, log)

    def __getattr__(self, name):
        return getattr(self._module, name)


def test_a_block_may_step_at_a_multiple_of_the_tick():
    loop = build(cosim.load_scenario("cruise", ['detectors.enabled=["position_monitor"]'])).loop
    detector = loop.detectors[0]
    detector.every, before, moved = 3, None, []
    for k in range(12):
        before = detector.x.copy()
        tick(loop, k)
        moved.append(not np.array_equal(before, detector.x))
    assert [k for k in range(12) if moved[k]] == [0, 3, 6, 9]
