"""The tape: compiled and as plain Python it does the same, and Python may stand anywhere in a tick."""

import os
import subprocess
import sys

import numpy as np

import cosim
from cosim.flight.build import build
from cosim.flight.loop.recorder import open_writer
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


def _logged(log):
    """Fly with gusts and a log, and return the bus after every tick."""
    setup = build(cosim.load_scenario("liquid-ofc", [*FLIGHT, "flight.turbulence=light", MONITOR]))
    with open_writer(setup, log) as writer:
        walked = _flown(setup, lambda loop: loop.tape(writer).run)
    return walked


def test_compiled_it_is_what_plain_python_does_bit_for_bit(tmp_path):
    walked, plain = _logged(tmp_path / "a.mcap"), tmp_path / "b.npy"
    env = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, __file__, str(plain)], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(walked, np.load(plain))
    assert (np.ptp(walked, axis=0) > 0).mean() > 0.3  # a bus that rests would prove nothing
    one, other = cosim.open_log(tmp_path / "a.mcap"), cosim.open_log(tmp_path / "b.mcap")
    assert one.n_ticks == TICKS and [c.crc for c in one.chunks] == [c.crc for c in other.chunks]


def test_python_between_the_blocks_and_between_ticks_changes_nothing_by_itself():
    scenario = cosim.load_scenario("liquid-ofc", [*FLIGHT, MONITOR])
    seen = []

    def with_guests(loop):
        for block in (loop.law, *loop.detectors, loop.servos[0]):
            block.module = _Plain(block.module)
        return lambda k: tick(loop, k, lambda v: seen.append(v[loop.bus.index("clock.clock.t")]))

    alone = _flown(build(scenario), lambda loop: lambda k: tick(loop, k))
    np.testing.assert_array_equal(alone, _flown(build(scenario), with_guests))
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


if __name__ == "__main__":
    np.save(sys.argv[1], _logged(sys.argv[1].replace(".npy", ".mcap")))
