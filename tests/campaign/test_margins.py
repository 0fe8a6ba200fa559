"""`cosim margins`: ladders of error until a detector alarms without a fault or loses one."""

import pandas as pd
import pytest

from cosim.campaign import margins as m
from cosim.campaign.worker import run_id
from cosim.errors import CampaignError


@pytest.mark.parametrize("detector", ["iotsekf", "ema_kalman_flight", "kinematic", "lpv_smo", "control_redundancy"])
def test_every_rung_is_a_scenario_and_the_fault_one_that_it_is_designed_for(detector):
    broken = m.fault(detector)
    for axis in m.axes(detector):
        for value in (axis.rungs[0], axis.rungs[-1]):
            scenario = m._scenario(detector, axis.keys(value, 1), 1, broken)
            assert scenario.faults[0].target == broken["target"] and detector in scenario.running


def test_an_axis_goes_on_until_it_alarmed_and_lost_and_shows_the_last_good_rung(monkeypatch):
    """A made-up detector alarms without a fault where the arm is 10 % too long, and loses one from 20 % on."""
    flown = []

    def fly(scenarios, **_):
        rows = []
        for s in scenarios:
            off = s.tolerances.hydraulic.get("arm", 1.0) - 1.0
            flown.append(round(100 * off))
            seen = bool(s.faults) and off < 0.199
            rows.append({"run": run_id(s), "id": "iotsekf", "false_alarms": int(off > 0.099),
                         "delay_s": 0.1 if seen else None})  # fmt: skip
        return type("Done", (), {"frame": pd.DataFrame(rows)})

    monkeypatch.setattr(m, "run_many", fly)
    monkeypatch.setattr(m, "axes", lambda name: [a for a in axes if a.name == "hydraulic arm"])
    axes = [a for a in _axes("iotsekf")]
    nothing, longer, shorter = m.margins("iotsekf", flights=1, workers=0)
    assert (nothing.silent_to, nothing.alarms_from) == (0, None)
    assert [longer.silent_to, longer.alarms_from, longer.sees_to, longer.loses_from] == pytest.approx([5, 10, 15, 20])
    assert (shorter.silent_to, shorter.alarms_from, shorter.loses_from) == (-30.0, None, None)
    assert 30 not in flown  # both had happened
    text = m.table([nothing, longer, shorter]).markdown()
    assert "| hydraulic arm, % | +5 | +10 | +15 | +20 |" in text


_axes = m.axes


def test_an_unknown_detector_is_refused_with_what_it_might_be():
    with pytest.raises(CampaignError, match="iotsekf"):
        m.margins("iotsekff")
