"""Every tick that a scenario may have: all detectors run within their arrays, and replay repeats their numbers."""

import numpy as np
import pytest

from cosim import load_scenario, simulate
from cosim.airframe_wires import control_redundancy_params
from cosim.detector_table import TABLE, module
from cosim.indices import wrong_parameter
from cosim.replay import replay
from cosim.scenario.catalog import SEGMENTS
from fdi import control_redundancy
from fdi.control_redundancy_core import NC

RATES = (50, 100, 200, 333, 400, 500, 1000, 2000)


@pytest.mark.parametrize("rate", RATES)
def test_the_delays_of_every_detector_fit_its_arrays(rate):
    scenario = load_scenario("cruise", [f"rate_hz={rate}"])
    for name, spec in TABLE.items():
        lanes = [s for s in SEGMENTS if scenario.elevator.technology[s] in spec.technologies] or ["aircraft"]
        for lane in lanes:
            p = spec.params(module(name), scenario, lane, scenario.dt)
            assert wrong_parameter(module(name), name, p, scenario.dt) is None, name


@pytest.mark.parametrize("rate", (50, 333, 2000))
def test_a_flight_at_any_rate_replays_bit_for_bit(rate, tmp_path):
    log = tmp_path / "flight.mcap"
    flown = simulate(load_scenario("cruise", ["duration_s=0.6", f"rate_hz={rate}"]), log=log, timed=False)
    assert flown.status == "completed"
    found = replay(log)
    assert found.exact and {d["id"] for d in found.detectors} == set(TABLE)


@pytest.mark.parametrize("rate", (50, 200, 333, 500, 1000, 2000))
def test_control_redundancy_follows_a_command_as_late_at_every_rate(rate):
    dt = 1.0 / rate
    p = control_redundancy_params(control_redundancy, None, "aircraft", dt)
    p["rate"] = 0.0
    x, u = control_redundancy.init(p), np.zeros((1, 1), control_redundancy.INPUTS)
    log = np.zeros((1, 1), control_redundancy.STATE)
    begun, moved = round(0.5 * rate), {}
    for k in range(begun + round(0.3 * rate)):
        if k == begun:
            for name in ("de_lo", "da_l", "dr", "stab"):
                u[name] = 1.0
        control_redundancy.rollout(x, u, p, dt, log)
        for j in range(NC):
            if log["cmd"][0, 0, j] > 0.5:
                moved.setdefault(j, (k - begun) * dt)
    wanted = {0: 0.07, 4: 0.06, 6: 0.09, 7: 0.0}  # of elevator, aileron, rudder, stabiliser, and a tick and 5 ms more
    assert moved.keys() == wanted.keys()
    for j, lag in wanted.items():
        assert moved[j] == pytest.approx(lag + dt + max(0.005, dt), abs=max(dt, 0.005) / 2 + dt)


def test_another_rate_than_that_of_the_training_is_noted():
    assert load_scenario("cruise").warnings() == []
    (line,) = load_scenario("cruise", ["rate_hz=1000"]).warnings()
    assert line.startswith("rate_hz = 1000: detectors are made for 200; ema_kalman_flight")
    no_ema = [f"elevator.{s}=hydraulic" for s in SEGMENTS]
    assert load_scenario("cruise", ["rate_hz=1000", *no_ema]).warnings() == []
