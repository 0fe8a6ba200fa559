"""control_redundancy in flight: ready after eight seconds, an accelerometer's error is no effector's."""

import numpy as np
import pytest

from cosim.flight.detectors import sources
from cosim.flight.signals import detect, fly
from cosim.flight.site import site
from cosim.scenario import load_scenario
from fdi.common.verdict import SENSOR
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
