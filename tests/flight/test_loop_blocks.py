"""The loop's own blocks: bus, sensors, fault signals, manoeuvre tables."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from actuators.block import dtype, record
from cosim.errors import ScenarioError
from cosim.flight.blocks import faults, manoeuvre, sensors
from cosim.flight.loop.bus import Bus
from cosim.flight.loop.tape import Tape

PAIR = dtype([("a", "f8"), ("b", "f8", (3,))])


def test_bus_names_every_element_of_every_lane_once():
    bus = Bus([("one", PAIR, ("x", "y")), ("two", PAIR, ("z",))])
    positions = [bus.index(f"{s}.{lane}.{f}") for s, lanes in bus.lanes.items() for lane in lanes
                 for f in ("a", "b[0]", "b[1]", "b[2]")]  # fmt: skip
    assert sorted(positions) == list(range(12)) == list(range(len(bus.v)))
    bus["one"]["b"][1, 2] = 7.0
    assert bus.v[bus.index("one.y.b[2]")] == 7.0
    with pytest.raises(ScenarioError, match="no signal"):
        bus.index("one.x.c")


def test_routes_copy_and_add():
    copies, adds = (Tape(np.arange(6.0), 0.005) for _ in range(2))
    copies.copy(np.array([0, 1]), np.array([4, 5]))
    copies.run(0)
    np.testing.assert_array_equal(copies.v, [4, 5, 2, 3, 4, 5])
    adds.add(np.array([0, 2]), np.array([0, 0, 2]), np.array([3, 4, 5]))
    adds.run(0)
    np.testing.assert_array_equal(adds.v, [7, 1, 5, 3, 4, 5])


def measure(truth, noise=None, p=None, **fields):
    """Return the STATE log of one sensor over `truth`, with fault input fields given as arrays over time."""
    n = len(truth)
    p = record(sensors.PARAMS, gain=1.0, **(p or {}))
    u = np.zeros((1, n), sensors.INPUTS)
    u["truth"][0], u["noise"][0] = truth, 0.0 if noise is None else noise
    for name, values in fields.items():
        u[name][0] = values
    log = np.zeros((1, n), sensors.STATE)
    sensors.rollout(sensors.init(p), u, p, 0.005, log)
    return log[0]


T = np.arange(400) * 0.005
TRUTH = 1.0 + np.sin(2 * math.pi * T)
LATE = T >= 1.0


@pytest.mark.parametrize("delay", [0, 1, 2, 30])
def test_sensor_delays_by_whole_ticks_as_if_the_past_had_been_steady(delay):
    y = measure(TRUTH, p={"delay": delay})["y"]
    np.testing.assert_array_equal(y[delay:], TRUTH[: len(TRUTH) - delay])
    np.testing.assert_array_equal(y[:delay], TRUTH[0])


def test_sensor_errors_combine_as_documented():
    noise = np.random.default_rng(1).standard_normal(len(T))
    y = measure(TRUTH, noise, {"sigma": 0.2, "bias": 0.5, "scale": 0.1})["y"]
    np.testing.assert_allclose(y, 1.1 * TRUTH + 0.5 + 0.2 * noise, rtol=1e-14)
    coarse = measure(TRUTH, p={"quantum": 0.25})["y"]
    np.testing.assert_allclose(coarse / 0.25, np.round(coarse / 0.25), atol=1e-12)
    assert np.abs(coarse - TRUTH).max() <= 0.125 + 1e-12


times = st.floats(0.0, 5.0).map(lambda t: round(t, 3))


@settings(max_examples=60, deadline=None)
@given(
    form=st.sampled_from([0.0, 1.0, 2.0, 4.0, 5.0, 6.0]), start=times, length=st.floats(0.1, 5.0),
    ramp=st.floats(0.0, 2.0),
)  # fmt: skip
def test_a_fault_signal_is_zero_outside_its_window_and_follows_its_formula_inside(form, start, length, ramp):
    dt, n = 0.005, 1400
    p = record(faults.PARAMS, form=form, start=start, end=start + length, ramp=ramp, amplitude=2.0, omega=5, phase=0.4,
               sweep=3.0, lower=0.1, upper=8.0)  # fmt: skip
    u = np.zeros((1, n), faults.INPUTS)
    u["t"][0] = np.arange(n) * dt
    log = np.zeros((1, n), faults.STATE)
    faults.rollout(faults.init(p), u, p, dt, log)
    x, t = log[0], u["t"][0]
    since = np.maximum(t - start, 0.0)
    active = (t > start - 0.5 * dt) & (t < start + length - 0.5 * dt)
    np.testing.assert_array_equal(x["active"] > 0, active)
    g = np.where(active, np.minimum(1.0, since / ramp) if ramp > 0 else 1.0, 0.0)
    chirp = signal.chirp(since, 5.0 / math.tau, 1.0, 8.0 / math.tau, phi=math.degrees(0.4) - 90.0)
    stays = np.sin(6.5 + 8.0 * (since - 1.0) + 0.4)  # once it has come to its limit, after one second
    shape = {faults.CONSTANT: np.full(n, 2.0), faults.DRIFT: 2.0 * since, faults.SINE: 2.0 * np.sin(5.0 * since + 0.4),
             faults.SQUARE: 2.0 * signal.square(5.0 * since + 0.4),
             faults.TRIANGLE: 2.0 * signal.sawtooth(5.0 * since + 0.4 + math.pi / 2, 0.5),
             faults.CHIRP: 2.0 * np.where(since < 1.0, chirp, stays)}[form]  # fmt: skip
    np.testing.assert_allclose(x["f_inj"], g * shape, atol=1e-9)
    np.testing.assert_array_equal(x["f_neg"], -x["f_inj"])


def test_three_two_one_one_has_its_lengths_signs_and_slopes():
    p = manoeuvre.params(manoeuvre.three_two_one_one(1.0, 0.5, "nz_dem", 0.3), nz_rate=math.inf)
    u = np.zeros((1, 1400), manoeuvre.INPUTS)
    u["t"][0] = t = np.arange(1400) * 0.005
    log = np.zeros((1, 1400), manoeuvre.STATE)
    manoeuvre.rollout(manoeuvre.init(p), u, p, 0.005, log)
    wanted = np.select(
        [t < end - 1e-9 for end in (1.0, 2.5, 3.5, 4.0, 4.5)], [0.0, 0.3, -0.3, 0.3, -0.3], 0.0
    )
    np.testing.assert_allclose(log[0]["nz_dem"], wanted, atol=1e-12)
    slow = manoeuvre.params(manoeuvre.doublet(0.5, 2.0, "nz_dem", 1.0), nz_rate=2.0)
    manoeuvre.rollout(manoeuvre.init(slow), u, slow, 0.005, log)
    assert np.abs(np.diff(log[0]["nz_dem"])).max() <= 2.0 * 0.005 + 1e-12
