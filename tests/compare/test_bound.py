"""The bound of physics: a matched filter reaches it, no counted detector may exceed it, and what exceeds it is told."""

import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from cosim.compare import bound
from cosim.scenario import load_scenario
from fdi.common import physics_bound as physics

OFC = ("duration_s=34", "faults.0.start_s=22", "faults.0.frequency_hz=1")


def test_a_matched_filter_on_two_outputs_reaches_the_probability_and_none_exceeds_it():
    rng, dt, hz, seconds, a = np.random.default_rng(3), 0.02, 1.0, 6.0, 0.08
    t = np.arange(round(seconds / dt)) * dt
    gain, sigma = np.array([1.0, 0.5j]), np.array([0.5, 0.2])
    told = physics.information(gain[None], np.diag(sigma**2 * dt)[None].astype(complex))
    basis = np.exp(2j * np.pi * hz * t)
    shape = (gain[:, None] * basis).real / sigma[:, None]
    quad = (1j * gain[:, None] * basis).real / sigma[:, None]
    templates = np.stack([x.ravel() / np.linalg.norm(x) for x in (shape, quad)])

    def statistic(size):
        phase = rng.uniform(0, 2 * np.pi, 4000)
        y = size * (gain[None, :, None] * basis * np.exp(1j * phase)[:, None, None]).real / sigma[:, None]
        y += rng.normal(size=y.shape)
        return np.sum((y.reshape(len(y), -1) @ templates.T) ** 2, axis=1)

    limit = np.quantile(statistic(0.0), 0.95)
    best = float(physics.probability(a, told, seconds, 0.05)[0])
    assert np.mean(statistic(a) > limit) == pytest.approx(best, abs=0.03) and 0.3 < best < 0.99
    least = physics.least_amplitude(told, seconds)
    assert physics.probability(least, told, seconds, 0.05) == pytest.approx(0.9)


def of(name, *changes):
    s = load_scenario("liquid-ofc", [*OFC, *changes])
    told, seconds = bound._of(s, 0, name)
    return None if told is None else float(physics.least_amplitude(told, seconds))


def test_what_may_be_read_orders_the_levels_and_gusts_cost_the_airframe_only():
    airframe, surfaces = of("airframe motion"), of("elevator positions")
    assert 0.001 < surfaces < airframe < 1.0  # mm of rod
    assert of("airframe motion", "flight.turbulence=light") > 1.02 * airframe
    assert of("monitors", "flight.turbulence=moderate") == of("monitors")
    assert of("airframe motion", "faults.0.target=elevator.all", "faults.0.at=command") < 0.5 * airframe
    assert of("actuator filters") is None


def test_information_is_the_energy_over_the_noise_of_a_sample_and_gusts_have_their_rms():
    t = np.arange(round(1.0 / bound.DT)) * bound.DT
    assert bound._white(2.0, 0.5) == pytest.approx(np.sum((2.0 * np.sin(2 * np.pi * t)) ** 2) / 0.5**2)
    model, w = SimpleNamespace(states=("tas",), x0=[200.0]), np.linspace(0.0, 2000.0, 2_000_001)
    for state, _, density in bound._gusts(model, "moderate", w):
        power = 2.0 * np.trapezoid(density, w / (2 * np.pi))
        assert power == pytest.approx(bound.INTENSITY["moderate"] ** 2, rel=1e-3), state


def test_longer_and_slower_servo_help():
    assert bound._of(load_scenario("liquid-ofc", [*OFC, "faults.0.end_s=25"]), 0, "monitors")[1] == 3.0
    assert of("monitors", "duration_s=70") == pytest.approx(of("monitors") / 2.0, rel=1e-6)  # four times as long


def counted(detected):
    n = len(detected)
    return pd.DataFrame({"id": "x", "bound_mm": 1.0, "amplitude_mm": 0.1, "not_valid": False, "best": 0.1,
                         "detected": detected}, index=range(n))  # fmt: skip


def test_a_detector_that_sees_more_than_physics_allows_is_named():
    assert bound.beyond(counted([True] * 4 + [False] * 36)) == []  # four of an expected four
    assert bound.beyond(counted([True] * 20 + [False] * 20)) == ["x"]
    few = counted([True, True, False, False]).assign(best=0.05)  # by hand: (2 - 0.5 - 0.2) / 0.436 = 2.98, of 3.09
    assert bound.beyond(few) == []
    above = counted([True] * 40)
    above["amplitude_mm"] = 2.0
    assert bound.beyond(above) == []  # above its bound everything may be seen
    none = counted([True] * 40)
    none["bound_mm"] = math.nan
    assert bound.beyond(none) == []
