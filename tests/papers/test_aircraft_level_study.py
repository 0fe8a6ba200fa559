"""The quick parts of the study of the aircraft level; the whole is `python -m cosim.papers.studies.aircraft_level
PART`.
"""

import json
import math
import operator

import numpy as np
import pandas as pd
import pytest

from cosim.campaign import jobs, run_many
from cosim.papers.studies.aircraft_level import PARTS, corners, lpv, ofc, redundancy, run, smallest, uncertain
from cosim.papers.studies.aircraft_level.table import Table
from cosim.training import train_rfafe
from fdi.common import bank


def test_a_table_prints_and_holds_what_json_can():
    table = Table("title", ("name", "value"), [("a", 1.23456), ("b", math.nan), ("c", None)])
    assert table.text().splitlines()[-3:] == ["a      1.23", "b         -", "c         -"]
    assert json.loads(json.dumps(table.plain(), allow_nan=False))["rows"][1] == {"name": "b", "value": None}
    with pytest.raises(KeyError, match="is no part"):
        run("nothing")
    assert {"ofc", "corners", "redundancy", "lpv", "noise", "uncertain", "smallest", "thresholds"} == set(PARTS)


def test_jobs_that_are_done_are_not_done_again(tmp_path):
    counted, file = [], tmp_path / "jobs.jsonl"

    def add(a, b):
        counted.append((a, b))
        return operator.add(a, b)

    assert jobs.many(add, [(1, 2), (3, 4)], out=file, workers=0) == {(1, 2): 3, (3, 4): 7}
    with file.open("a", encoding="utf-8") as held:
        held.write('[[5, 6], 1')  # killed while it wrote
    assert jobs.many(add, [(1, 2), (5, 6)], out=file, workers=0) == {(1, 2): 3, (5, 6): 11}
    assert counted == [(1, 2), (3, 4), (5, 6)]
    file.write_text('"another code"\n[[1, 2], 99]\n')
    assert jobs.many(add, [(1, 2)], out=file, workers=0) == {(1, 2): 3}


def test_the_least_error_of_an_affine_function_is_that_of_tchebyshev():
    """x^2 on [-1, 1]: the nearest straight line is 1/2, off by 1/2; what is affine is met exactly."""
    low, high = np.array(lpv.design_lpv.BOX).T
    z = np.linspace(-1, 1, 41)
    rho = np.column_stack([0.5 * (low[0] + high[0]) + 0.5 * (high[0] - low[0]) * z, *(np.full(41, x) for x in low[1:])])
    assert lpv.least(rho, z**2) == pytest.approx(0.5, abs=1e-9)
    assert lpv.least(rho, 3.0 - z) == pytest.approx(0.0, abs=1e-9)


def test_only_the_two_control_powers_come_out_as_an_elevator_fault():
    """Cm_de and Cm_ds add and take the stabiliser's share of their 5 %, pitch stiffness next to nothing."""
    nominal = uncertain.errors("E")
    of = {n: uncertain.errors("E", n)[0] - nominal[0] for n in ("Cm_de", "Cm_ds", "Cm_alpha")}
    assert 3.0 < of["Cm_de"] < 5.0 and -5.0 < of["Cm_ds"] < -3.0
    assert abs(of["Cm_alpha"]) < 0.3
    assert abs(nominal[0]) < 5.0 and abs(nominal[1]) < 5.0 and abs(nominal[2]) < 5.0


def _cells(frame):
    found = {row[:3]: dict(zip(ofc.DETECTORS, row[4:8])) for row in ofc.summary(frame)}
    return found


def test_the_least_amplitude_seen_is_the_one_from_which_on_all_are_seen():
    rows = []
    for nominal, delays in ((0.3, (2.0, None)), (0.6, (2.5, 2.9)), (1.2, (3.2, 2.0)), (2.4, (1.0, 1.0))):
        for d in delays:
            rows.append({"label.point": "sun13", "flight.turbulence": "none", "faults.0.frequency_hz": 1.0,
                         "label.nominal_deg": nominal, "id": "rfafe", "delay_periods": d,
                         "amplitude_deg": 1.1 * nominal})  # fmt: skip
    frame = pd.DataFrame(rows)
    got = _cells(frame)["sun13", "none", 1.0]
    assert got["rfafe"] == pytest.approx(2.64)  # 1.2 deg came too late once
    assert got["rfafe_airframe"] is None


def test_a_segment_that_oscillates_is_seen_by_position_and_far_above_the_bound():
    flights, labels = ofc.scenarios(hz=(2.0,), seeds=1)
    chosen = [i for i, label in enumerate(labels) if label == {"point": "sun13", "nominal_deg": 2.4}][:1]
    found = run_many([flights[i] for i in chosen], workers=0, labels=[labels[i] for i in chosen])
    got = _cells(found.frame)["sun13", "none", 2.0]
    bound = ofc.bound("sun13", 2.0)
    assert 0.05 < bound < 0.2
    assert got["rfafe"] > 10 * bound and got["rfafe_airframe"] > 10 * bound
    assert got["control_redundancy"] is None  # half a second of mean


def test_a_corner_is_flown_and_the_lpv_observer_is_at_home_there_not_at_sun13():
    far = corners.measure("sun13", corners.ANGLE, "none", 1)
    home = corners.measure("D", corners.ANGLE, "none", 1)
    assert far["lpv_smo"][3] == 0.0 and far["lpv_smo"][0] is None  # 200 t: it does not believe itself
    assert home["lpv_smo"][0] < 1.0 and home["lpv_smo"][1] == pytest.approx(1.0, abs=0.05)


def test_the_judgement_of_declarations():
    truth = [[21.0, "engine"], [25.0, "elevator"], [37.0, "rudder"]]
    right, extra, early, said = redundancy.judged(3, truth)
    assert right and not extra and not early and set(said.values()) == {"engine", "elevator", "rudder"}
    right, extra, early, said = redundancy.judged(3, [[5.0, "rudder"], *truth[:2], [40.0, "aileron"]])
    assert not right and extra == 1 and early == 1 and said["rudder", 36.0] == "aileron"
    right, extra, _, said = redundancy.judged(2, [[24.5, "elevator"], [30.0, "elevator"], [38.0, "ambiguous"]])
    assert not right and extra == 1 and said["engine", 36.0] == "ambiguous"
    assert redundancy.judged(1, [])[3] == {("engine", 24.0): "none"}


def test_a_scenario_of_the_talk_is_declared_in_order():
    force, *_ = redundancy.declarations(3, 0)
    right, extra, early, _ = redundancy.judged(3, force)
    assert right and not extra and not early


def test_moments_see_the_aileron_that_forces_do_not():
    came = [smallest.outcome("aileron.both", d)[0] for d in smallest.declared("level", "aileron.both", 6.0, 0)]
    assert came == ["missed", "right"]
    came = [smallest.outcome("engine.all", d)[0] for d in smallest.declared("level", "engine.all", 35.0, 0)]
    assert came[0] == "right"


def test_thresholds_stand_above_what_lasts_and_weigh_what_the_law_answers(monkeypatch):
    shares = len(train_rfafe.SHARES)
    runs, whatever = np.zeros((shares, bank.K)), np.zeros((shares, bank.K))
    runs[:, 0], whatever[:, 1] = np.radians(np.linspace(1.0, 0.1, shares)), np.radians(1.0)
    fits = [({}, {"rfafe": [runs.tolist(), whatever.tolist(), 0.01, 0]})]
    monkeypatch.setattr(train_rfafe, "answers", lambda: {"rfafe": np.full(bank.K, 0.25)})
    made, _ = train_rfafe.train("rfafe", fits)
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
        runs, whatever, _ = train_rfafe.survey(train_rfafe.record(duration=9.0, faults=faults), "rfafe", p)
        assert low <= np.degrees(runs[0, k]) <= high and whatever[0, k] >= runs[0, k]
