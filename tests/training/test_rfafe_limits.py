"""Limits of the aircraft-level estimators: from what lasts, and what the law answers."""

import numpy as np
import pytest

from cosim.training import flights, train_rfafe
from fdi.common import bank


def test_thresholds_stand_above_what_lasts_and_weigh_what_the_law_answers():
    shares = len(train_rfafe.SHARES)
    runs, whatever = np.zeros((shares, bank.K)), np.zeros((shares, bank.K))
    runs[:, 0], whatever[:, 1] = np.radians(np.linspace(1.0, 0.1, shares)), np.radians(1.0)
    fits = [[runs.tolist(), whatever.tolist(), 0.01]]
    made, _ = train_rfafe.fields(fits, np.full(bank.K, 0.25))
    threshold, share = np.degrees(made["bank_threshold"]), made["bank_share"]
    assert threshold[0] == pytest.approx(1.25 * 0.1) and share[0] == 2.0  # 0.125 / (1 - 2 / 4) beats 1.25
    assert threshold[1] == pytest.approx(0.3) and share[1] == 0.0  # not on the shape alone
    assert threshold[2] == pytest.approx(0.05) and made["th_static"] == pytest.approx(0.0125)


def test_a_survey_finds_an_oscillation_and_little_in_health():
    fault = {"target": "elevator.left", "kind": "ofc_liquid", "at": "command", "start_s": 4.0, "amplitude_deg": 1.0,
             "frequency_hz": 2.0}  # fmt: skip
    p = train_rfafe.MODULES["rfafe"].params()
    k = int(np.argmin(abs(bank.frequencies() - 2.0)))
    for faults, low, high in (([fault], 0.8, 1.2), ([], 0.0, 0.06)):
        runs, whatever, _ = train_rfafe.survey(flights.fly_aircraft(duration=9.0, faults=faults), "rfafe", p)
        assert low <= np.degrees(runs[0][k]) <= high and whatever[0][k] >= runs[0][k]
