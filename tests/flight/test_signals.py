"""`cosim.fly`: a table of signals in SI with units, and detectors run on it as they run in the loop."""

import numpy as np
import pytest

import cosim
from cosim.errors import ScenarioError
from cosim.flight.loop.signals import detect
from fdi.hydraulic import iotsekf

SHORT = ["duration_s=3", "detectors.enabled=['iotsekf']"]


@pytest.fixture(scope="module")
def flown():
    inputs = [f"iotsekf_in.left_inner.{n}" for n in iotsekf.INPUTS.names]
    own = ["iotsekf.left_inner.f_hat", "iotsekf.left_inner.r", "iotsekf.left_inner.own_ratio[0]"]
    return cosim.fly(cosim.load_scenario("liquid-ofc", SHORT), ["truth.aircraft.nz", "sensors.q.y_obs", *inputs, *own])


def test_a_flight_is_a_table_over_seconds_with_units(flown):
    assert flown.index.name == "t" and flown.index[1] == 0.005 and len(flown) == 600
    assert flown.attrs["units"]["truth.aircraft.nz"] == "g" and flown.attrs["units"]["sensors.q.y_obs"] == "rad/s"
    assert flown.attrs["dt"] == 0.005 and flown.attrs["status"] == "completed"
    assert flown["truth.aircraft.nz"].iloc[0] == pytest.approx(1.0, abs=0.01)


def test_a_detector_on_the_table_is_the_one_that_flew_bit_for_bit(flown):
    wires = {n: f"iotsekf_in.left_inner.{n}" for n in iotsekf.INPUTS.names}
    log = detect(flown, iotsekf, [wires, wires], fields=("f_hat", "r"))
    assert log.shape == (2, 600) and log.dtype.names == ("f_hat", "r")
    for field in ("f_hat", "r"):
        assert np.array_equal(log[field][1], flown[f"iotsekf.left_inner.{field}"])


@pytest.mark.parametrize(
    ("name", "told"),
    [("trut.aircraft.nz", "truth"), ("sensors.qq.y_obs", "q"), ("truth.aircraft.nzz", "nz"), ("nz", "truth")],
)
def test_a_signal_that_is_not_there_is_refused(name, told):
    with pytest.raises(ScenarioError, match=f"no signal '{name}'; allowed: .*{told}"):
        cosim.fly("cruise", [name])


def test_words_of_the_vocabulary_are_signals():
    table = cosim.fly(cosim.load_scenario("cruise", ["duration_s=1"]), ["alpha", "left_inner.rod"])
    assert table.attrs["units"] == {"alpha": "rad", "left_inner.rod": "m"}
    with pytest.raises(ScenarioError, match=r"Name one: left_inner\.rod"):
        cosim.fly("cruise", ["rod"])
