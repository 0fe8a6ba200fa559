"""Recorded commands and signals with faults of the catalogue: interpolation, the bench, a fault on a signal."""

import numpy as np
import pytest
from real_windows import DT, band_limited, broken
from recorded_bench import Ride, move

import cosim
from cosim.flight.faults import inject


def test_interpolation_adds_nothing_above_the_recorded_band():
    t = np.arange(600) / 10.0
    y = 0.05 + 0.02 * np.sin(2.0 * np.pi * 0.7 * t)
    first, found = band_limited(t, y, DT)
    at = first + np.arange(len(found)) * DT
    inside = (at > 5.0) & (at < 55.0)
    assert found[inside] == pytest.approx(0.05 + 0.02 * np.sin(2.0 * np.pi * 0.7 * at[inside]), abs=1e-4)
    spectrum = np.abs(np.fft.rfft(np.hanning(inside.sum()) * (found[inside] - 0.05)))
    hz = np.fft.rfftfreq(inside.sum(), DT)
    assert spectrum[hz > 5.0].max() < 1e-3 * spectrum.max()


def test_the_bench_follows_its_command_and_breaks_as_the_loop_does():
    n, start = 1600, 4.0
    t = np.arange(n) * DT
    ride = Ride(0.05 * np.sin(2.0 * t), 0.0 * t, 0.0 * t, 0.0 * t)
    names = ("cruise", "solid-jam", "runaway", "liquid-ofc")
    keys = ["detectors.enabled=[]", "duration_s=8"]
    begins = f"faults.0.start_s={start}"
    scenarios = [cosim.load_scenario(s, [*keys, *([begins] if s != "cruise" else [])]) for s in names]
    load = np.array([np.full((4, n), -300.0), np.full((4, n), -15000.0)])
    seen = move([ride] * 4, scenarios, load, "left_inner", 3)
    surface, late = seen["left_inner.surface"], t > start + 0.1
    healthy = (t > 1.0) & (t < start)
    assert np.abs(surface[:, healthy] - ride.command[healthy]).max() < 0.02
    assert np.ptp(surface[1, late]) < 0.005 and np.ptp(surface[0, late]) > 0.08
    assert np.abs(surface[2, -1]) > 0.25
    apart = (surface[3] - surface[0])[t > 6.0]
    assert np.abs(apart - apart.mean()).max() == pytest.approx(0.008 / 0.3, rel=0.4)


@pytest.mark.parametrize(
    ("name", "does"),
    [
        ("alpha-bias", lambda y: np.ptp(y) < 1e-12 and y[0] != 1.0),
        ("alpha-freeze", lambda y: (y == y[0]).all()),
        ("theta-dropout", lambda y: np.isnan(y).all()),
        ("q-noise", lambda y: np.std(y) > 0.0),
        ("cas-scale", lambda y: y[0] != 1.0),
    ],
)
def test_a_sensor_fault_acts_in_its_part_of_the_window(name, does):
    keys = ["faults.0.ramp_s=0"] if name == "cas-scale" else []
    scenario = cosim.load_scenario(name, ["duration_s=4", "faults.0.start_s=2", "faults.0.end_s=4", *keys])
    value, valid = np.ones(1600), np.ones(1600)
    broken(value, valid, inject.lanes(scenario)[0], 400, 800, DT, 1)
    assert (value[:800] == 1.0).all() and (value[1200:] == 1.0).all()
    assert does(value[810:1190])
    assert (valid[810:1190] == (0.0 if name == "theta-dropout" else 1.0)).all()
