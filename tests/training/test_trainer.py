"""The one trainer: a reduced set of flights per detector gives frozen limits, what is stored is what was trained, and
every shipped file of thresholds has an entry."""

import json

import numpy as np
import pytest

from cosim.training import (
    TRAINERS,
    load,
    train_aircraft,
    train_ema,
    train_hydraulic,
    train_monitors,
    train_rfafe,
    trainer,
)
from cosim.training.flights import MODULES, over_envelope
from cosim.training.trainer import FOLDER, Trained
from fdi.common import bank
from fdi.rfafe.store import side_kinds

# the largest number of each field, of one flight per training; frozen, computed before the trainers were made one
FROZEN: dict[str, dict[str, dict[str, float]]] = {
    "hydraulic": {
        "iotsekf flight_load0": {
            "bank_threshold": 0.00362691, "slow_threshold": 0.0160594, "run_threshold": 0.0549503,
            "sum_threshold": 0.0030224,
        },
        "iotsekf flight_load1": {
            "bank_threshold": 0.00362691, "slow_threshold": 0.0025695, "run_threshold": 0.00824249,
            "sum_threshold": 0.0030224,
        },
        "iotsekf flight_load2": {
            "bank_threshold": 0.00598626, "slow_threshold": 0.000642376, "run_threshold": 0.00511357,
            "sum_threshold": 0.0049886, "limit": 2.63752,
        },
        "rtsekf flight_load0": {
            "threshold": 0.0267695, "step": 0.00657689,
        },
        "rtsekf flight_load1": {
            "threshold": 0.00328096, "step": 0.00108676,
        },
        "rtsekf_flight flight": {
            "pair_threshold": 0.000148748,
        },
    },
    "monitors": {
        "position_monitor flight": {
            "threshold": 0.00147263, "share": 0.0,
        },
        "ofc_monitor flight": {
            "threshold": 0.0005, "share": 0.0, "usual": 0.010061, "most": 0.00580017,
        },
    },
    "ema": {
        "ema_kalman_flight flight": {
            "pair_threshold": 0.00027, "th_speed": 0.00027, "rho_speed": 0.0, "th_f": 0.285,
            "rho_f": 0.00112, "th_vel": 1.49531, "rho_vel": 0.164975, "rho_rate": 0.024084,
            "th_jump": 0.000296349, "th_R1": 0.000564525, "z_gain": 2.0, "th_rough": 10.3687,
        },
        "position_monitor flight_ema": {
            "threshold": 0.00872665,
        },
    },
    "aircraft": {
        "lpv_smo flight": {
            "t_elevator": 0.00350669, "g_elevator": 0.0, "s_elevator": 0.0, "t_n_z": 0.0015481,
            "g_n_z": 1.08214, "s_n_z": 0.0307026, "t_alpha": 0.00158077, "g_alpha": 0.0140427, "s_alpha":
            0.0, "floor": 0.0, "swing_threshold": 0.00122688, "swing_gust": 0.0136927, "swing_away": 0.0,
        },
        "kinematic flight": {
            "threshold": 0.468345, "gust": 0.000145311, "side": 0.0182681, "side_gust": 0.244957,
            "jump": 4.65399, "noise_ratio": 1.81795,
        },
        "control_redundancy flight": {
            "gust_max": 2.70396, "t_x": 1e-06, "t_y": 0.0013024, "t_z": 0.0060684,
        },
        "rfafe_airframe flight": {
            "bank_threshold": 0.00301063, "bank_doubt": 11.6168, "bank_stir": 0.120036, "th_static":
            0.012178, "static_away": 0.0379551, "bank_share": 1.17038, "noise": 1e-07,
        },
    },
    "rfafe": {
        "rfafe ": {
            "bank_threshold": 0.000872665, "bank_share": 0.0, "th_static": 0.000712537,
        },
        "rfafe_airframe ": {
            "bank_threshold": 0.00107993, "bank_share": 0.0, "th_static": 0.000716669,
        },
    },
}  # fmt: skip


def reduced(name):
    """Return what is trained on one flight."""
    if name == "hydraulic":
        found = train_hydraulic.surveyed(**over_envelope(21_000, 2)[1] | {"duration": 8.0})
        return train_hydraulic.limits([found])
    if name == "monitors":
        found = train_monitors.surveyed(**train_monitors.flights(number=28)[27] | {"duration": 8.0})
        return train_monitors.limits([found])
    if name == "ema":
        return train_ema.limits([train_ema.surveyed(**train_ema.flights(number=4)[3] | {"duration": 12.0})])
    if name == "aircraft":
        flight = train_aircraft.arguments(18)
        p = {name: train_aircraft.fitted(name, 18) for name in train_aircraft.SURVEYS}
        found = train_aircraft.surveys(train_aircraft.flown(flight), "light", p.__getitem__, None, tuple(p))
        return train_aircraft.limits([found], {"noise": 1e-7})
    flight = train_rfafe.flight(1000, 0) | {"duration": 10.0}
    kinds = side_kinds(dict(zip(train_rfafe.SEGMENTS, flight["technology"], strict=True)))
    frame = train_rfafe.fly_aircraft(**flight)
    found = {n: train_rfafe.survey(frame, n, m.params(technology=kinds)) for n, m in MODULES.items()}
    return [Trained(n, "", train_rfafe.fields(n, [({}, found)], np.full(bank.K, 0.3))[0]) for n in MODULES]


@pytest.mark.parametrize("name", ["hydraulic", "monitors", "ema", "aircraft", "rfafe"])
def test_one_flight_gives_the_limits_that_it_gave_before_the_trainers_were_one(name):
    got = {f"{t.detector} {t.which}": {k: float(np.max(v)) for k, v in t.fields.items()} for t in reduced(name)}
    for key, fields in FROZEN[name].items():
        assert got[key] == pytest.approx(fields, rel=1e-3, abs=1e-12), key
    assert got.keys() == FROZEN[name].keys()


def test_what_is_trained_is_stored_beside_what_else_the_file_holds(tmp_path, monkeypatch):
    for file in FOLDER.glob("*.json"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.setattr(trainer, "FOLDER", tmp_path)
    before = json.loads((tmp_path / "position_monitor.json").read_text())
    mine = trainer.Training("mine", 5, 2, lambda seed, n, run: (seed, n), lambda found: [
        Trained("position_monitor", "flight", {"threshold": 0.0123456789}, {"found": list(found)}),
        Trained("position_monitor", "flight_ema", {"threshold": 0.5}, {"found": "other"}, "ema"),
    ])  # fmt: skip
    made = mine.train(first_seed=7)
    stored = before["flight"]["threshold"]
    assert mine.changes(made)[0] == ("position_monitor", "flight", "threshold", stored, 0.0123457)
    mine.store(made)
    after = json.loads((tmp_path / "position_monitor.json").read_text())
    record = {"command": "cosim train mine", "flights": 2, "first_seed": 7}
    assert after["training"] == {**record, "found": [7, 2], "ema": {**record, "found": "other"}}
    assert after["flight"] == before["flight"] | {"threshold": 0.0123457}
    mine.store(made[:1])  # the record of the other set stays
    assert json.loads((tmp_path / "position_monitor.json").read_text()) == after


@pytest.mark.parametrize("name", TRAINERS)
def test_every_training_trains_tells_what_changes_and_stores(name):
    found = load(name)
    assert all(callable(getattr(found, part)) for part in ("train", "changes", "store"))


def test_every_shipped_file_of_thresholds_has_an_entry_in_a_training():
    named = " ".join(about for _, about in TRAINERS.values())
    assert all(file.stem in named for file in FOLDER.glob("*.json"))
    trained = {*train_hydraulic.TESTS, *train_aircraft.SURVEYS, *MODULES, "ofc_monitor", "position_monitor",
               "ema_kalman_flight", "pitch_moment_glr", "joint"}  # fmt: skip
    assert trained == {file.stem for file in FOLDER.glob("*.json")}
