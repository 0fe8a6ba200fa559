"""The tape: Python may stand anywhere in a tick."""

import functools

import numpy as np

import cosim
from cosim.flight.build import build
from cosim.flight.tick import order

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
            block.rollout = functools.partial(_advance, block.rollout)
        return order(loop, lambda v: seen.append(v[loop.bus.index("clock.clock.t")])).run

    alone = _flown(build(scenario), lambda loop: order(loop).run)
    np.testing.assert_array_equal(alone, _flown(build(scenario), in_python))
    np.testing.assert_array_equal(seen, np.arange(TICKS) * 0.005)


def _advance(rollout, x, u, p, dt):
    """Advance as a compiled block does, by a call of Python."""
    rollout(x, u, p, dt)


def test_a_block_may_step_at_a_multiple_of_the_tick():
    loop = build(cosim.load_scenario("cruise", ['detectors.enabled=["position_monitor"]'])).loop
    detector = loop.detectors[0]
    detector.every, before, moved = 3, None, []
    tape = order(loop)
    for k in range(12):
        before = detector.x.copy()
        tape.run(k)
        moved.append(not np.array_equal(before, detector.x))
    assert [k for k in range(12) if moved[k]] == [0, 3, 6, 9]
