"""Whole flights: they hold their trim, repeat byte for byte, end honestly, and their log holds what happened."""

import math

import numpy as np
import pytest

import cosim
from cosim.flight.build import build
from cosim.flight.plant.point import SIX
from cosim.flight.plant.properties import Properties
from cosim.flight.simulate import simulate
from cosim.flight.tick import order


def scenario(name="cruise", point="sun13", **more):
    flight = {f"flight.{k}": v for k, v in SIX[point].items()}
    values = {**flight, "flight.turbulence": '"none"', **more}
    return cosim.load_scenario(name, [f"{k}={v}" for k, v in values.items()])


@pytest.mark.parametrize("point", SIX)
def test_hands_off_drift_stays_below_one_foot_in_a_minute(point):
    s = scenario(point=point, duration_s=60, **{"sensors.noise_scale": 0.0, "detectors.enabled": "[]"})
    loop = build(s).loop
    tape, h0, drift = order(loop), None, 0.0
    for k in range(s.ticks):
        tape.run(k)
        h0 = loop.truth.h if h0 is None else h0
        drift = max(drift, abs(loop.truth.h - h0))
    assert drift / 0.3048 < 1.0


def test_same_scenario_and_seed_give_the_same_bytes(tmp_path):
    s = scenario("liquid-ofc", duration_s=3, **{"faults.0.start_s": 1})
    for name in "ab":
        simulate(s, log=tmp_path / name)
    other = scenario("liquid-ofc", duration_s=3, seed=2, **{"faults.0.start_s": 1})
    simulate(other, log=tmp_path / "c")
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_log_holds_fault_truth_and_every_signal_at_every_tick(tmp_path):
    s = scenario(
        "liquid-ofc",
        duration_s=4,
        **{"faults.0.start_s": 1, "faults.0.end_s": 3, "faults.0.ramp_s": 0.5, "faults.0.frequency_hz": 2},
    )
    simulate(s, log=tmp_path / "f.mcap")
    log = cosim.open_log(tmp_path / "f.mcap")
    assert log.complete
    f = log.frame("/faults/f0_left_inner")
    t = np.arange(800) * 0.005
    assert len(f) == 800
    active = (t >= 1 - 1e-9) & (t < 3 - 1e-9)
    np.testing.assert_array_equal(f["active"].to_numpy() > 0, active)
    envelope = np.where(active, np.clip((t - 1) / 0.5, 0, 1), 0)
    np.testing.assert_allclose(f["g"], envelope, atol=1e-12)
    amplitude = np.abs(f["f_inj"]).max()
    np.testing.assert_allclose(
        f["f_inj"], envelope * amplitude * np.sin(2 * math.pi * 2 * (t - 1)), atol=amplitude * 2e-3
    )
    truth = log.frame("/truth/aircraft")
    rod = log.frame("/actuators/hydraulic/left_inner")["q_rod"].to_numpy()
    np.testing.assert_allclose(
        truth["de_li"].to_numpy()[1:], rod[1:] / 0.30, atol=1e-15
    )  # what was written is what flies
    for name in log.topics:
        assert np.isfinite(log.frame(name).to_numpy()).all() or name.startswith("/sensors"), name


def test_departure_ends_the_flight_with_a_readable_log(tmp_path):
    s = scenario(
        "runaway",
        duration_s=60,
        **{"faults.0.target": '"elevator.all"', "faults.0.at": '"command"', "faults.0.start_s": 1},
    )
    r = simulate(s, log=tmp_path / "f.mcap")
    assert r.status == "departed"
    assert "outside" in r.reason
    log = cosim.open_log(tmp_path / "f.mcap")
    assert log.complete
    assert log.result["status"] == "departed"
    assert len(log.frame("/truth/aircraft")) == round(r.sim_time_s / 0.005)


def test_a_number_that_is_none_ends_the_flight_as_diverged(tmp_path, monkeypatch):
    s = scenario("cruise", duration_s=3)
    real = Properties.schedule_read

    def broken(self, tape, out):
        real(self, tape, out)
        if len(out) > 5:  # not what the gusts meet
            tape.call(lambda k: out.__setitem__(0, np.nan) if k > 200 else None)

    monkeypatch.setattr(Properties, "schedule_read", broken)
    r = simulate(s, log=tmp_path / "f.mcap")
    assert r.status == "diverged"
    assert cosim.open_log(tmp_path / "f.mcap").complete
