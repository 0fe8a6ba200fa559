"""control_redundancy in flight: ready after eight seconds, an accelerometer's error is no effector's."""

import math

import numpy as np
import pytest

import cosim
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.scenario import load_scenario
from cosim.training.flights import scenario
from cosim.training.train_aircraft import arguments, fitted
from fdi import registry
from fdi.common.verdict import SENSOR
from fdi.common.why import GUSTS
from fdi.control_redundancy import control_redundancy


@pytest.mark.parametrize("sensor, error", [("n_x", lambda t: 0.03 + 0 * t), ("n_z", lambda t: 0.01 * t),
                                           ("alpha", lambda t: 0.035 + 0 * t)])  # fmt: skip
def test_a_sensor_is_named_by_kinematics_and_not_an_effector(sensor, error):
    wires = sources("control_redundancy")
    given = ["duration_s=26", "flight.turbulence=light", "detectors.enabled=[]", "manoeuvre.kind=cruise"]
    flown = fly(load_scenario("cruise", given), wires.values())
    p = control_redundancy.fitted(site(flown.attrs["dt"]))
    healthy = detect(flown, control_redundancy, wires, p)
    t = flown.index.to_numpy()
    assert (healthy["valid"][t > 8.6] == 1.0).all() and not healthy["alarm"].any()
    flown[f"sensors.{sensor}.y_obs"] += np.where(t >= 12.0, error(t - 12.0), 0.0)
    log = detect(flown, control_redundancy, wires, p)
    named = log[(log["alarm"] > 0) & (log["culprit"] > 0)]  # before it is sure it names nobody
    assert {control_redundancy.CULPRITS[int(c)] for c in named["culprit"]} == {sensor}
    assert (named["verdict"] == SENSOR).all()


def test_an_error_of_the_pitch_rate_is_called_nobodys():
    wires = sources("control_redundancy")
    given = ["duration_s=20", "flight.turbulence=light", "detectors.enabled=[]", "manoeuvre.kind=cruise"]
    flown = fly(load_scenario("cruise", given), wires.values())
    flown["sensors.q.y_obs"] += math.radians(4.0) * (flown.index >= 12.0)
    log = detect(flown, control_redundancy, wires, control_redundancy.fitted(site(flown.attrs["dt"])))
    assert log["alarm"].any() and not log["culprit"].any()


def test_in_gusts_beyond_those_of_its_training_it_says_nothing_and_why():
    frame = fly(load_scenario("cruise", ["duration_s=14", "flight.turbulence=moderate", "detectors.enabled=[]"]),
                dict.fromkeys(sources("control_redundancy").values()))  # fmt: skip
    p = registry.record("control_redundancy").fit(site(0.005))
    fields = ("valid", "why", "alarm", "learned")
    log = detect(frame, control_redundancy, sources("control_redundancy"), p, fields)
    assert log["valid"][-1] == 1.0
    p["gust_max"] = 0.3
    log = detect(frame, control_redundancy, sources("control_redundancy"), p, fields)
    assert log["why"][-1] == GUSTS and not log["valid"].any() and not log["alarm"].any() and not log["learned"].any()


def test_a_vane_that_is_off_in_a_turn_in_gusts_is_never_called_an_accelerometer():
    given = arguments(49, 520_000) | {"duration": 40.0}  # kinematics had half of the forward force's residual in n_x
    frame = fly(scenario(**given), dict.fromkeys(sources("control_redundancy").values()))
    frame["sensors.alpha.y_obs"] += math.radians(2.0) * (frame.index >= 20.0)
    log = detect(frame, control_redundancy, sources("control_redundancy"), fitted("control_redundancy", 49),
                 ("alarm", "culprit"))  # fmt: skip
    named = set(log["culprit"][log["alarm"] > 0.5])
    assert control_redundancy.CULPRITS.index("alpha") in named and control_redundancy.CULPRITS.index("n_x") not in named


HEALS = {
    "an engine": "target='engine.2',kind='thrust_loss',loss_pct=80",
    "a sensor": "target='sensor.n_x',kind='bias',bias_g=0.06,path='observers'",
    "a rudder hard over": "target='rudder',kind='runaway',rate_deg_s=3,limit_deg=5",
}


@pytest.mark.parametrize("fault", HEALS.values(), ids=HEALS)
def test_what_would_show_and_does_not_is_over(fault):
    lane = _flown(f"{fault},start_s=14,end_s=30", 42.0, "flight.turbulence=light")
    assert lane["alarm_share"] > 0.95 and lane["withdrawn_after_s"] < 12.0 and lane["false_alarms"] == 0


def test_a_rudder_that_is_locked_and_asked_for_nothing_is_still_locked():
    lane = _flown("target='rudder',kind='jam',start_s=14", 45.0, "manoeuvre.kind=yaw_angle", "manoeuvre.start_s=12")
    assert lane["alarm_share"] > 0.95


def _flown(fault, seconds, *told):
    told = [f"duration_s={seconds}", "detectors.enabled=['control_redundancy']", f"faults=[{{{fault}}}]", *told]
    return cosim.simulate(load_scenario("cruise", told)).to_dict()["detectors"][0]
