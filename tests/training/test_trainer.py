"""The one trainer: a reduced set of flights per detector gives every limit, what is stored is what was trained, and
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
    train_rfafe,
    trainer,
)
from cosim.training.__main__ import main
from cosim.training.flights import MODULES, fly_aircraft, manoeuvring, over_envelope
from cosim.training.trainer import FOLDER, Trained
from fdi import registry
from fdi.common import bank
from fdi.rfafe.store import side_kinds


def reduced(name):
    """Return what is trained on one flight."""
    if name == "hydraulic":
        found = train_hydraulic.surveyed(**over_envelope(21_000, 2)[1] | {"duration": 8.0})
        return train_hydraulic.limits([found])
    if name == "monitors":
        found = train_hydraulic.monitored(**manoeuvring(21_000, 28)[27] | {"duration": 8.0})
        return train_hydraulic.monitor_limits([found])
    if name == "ema":
        return train_ema.limits([train_ema.surveyed(**train_ema.flights(number=4)[3] | {"duration": 12.0})])
    if name == "aircraft":
        flight = train_aircraft.arguments(18)
        p = {name: train_aircraft.fitted(name, 18) for name in train_aircraft.SURVEYS}
        found = train_aircraft.surveys(train_aircraft.flown(flight), "light", p.__getitem__, tuple(p))
        return train_aircraft.limits([found])
    flight = train_rfafe.flight(1000, 0) | {"duration": 10.0}
    kinds = side_kinds(dict(zip(train_rfafe.SEGMENTS, flight["technology"], strict=True)))
    frame = fly_aircraft(**flight)
    found = {n: train_rfafe.survey(frame, n, m.params(technology=kinds)) for n, m in MODULES.items()}
    return [Trained(n, "", train_rfafe.fields([found[n]], np.full(bank.K, 0.3))[0]) for n in MODULES]


@pytest.mark.parametrize("name", ["hydraulic", "monitors", "ema", "aircraft", "rfafe"])
def test_one_flight_is_enough_for_every_limit_that_is_stored(name):
    made = reduced(name)
    assert made and {t.detector for t in made} <= set(registry.SHIPPED)
    for t in made:
        data = json.loads((FOLDER / f"{t.detector}.json").read_text())
        assert t.fields.keys() <= data[t.which or "flight"].keys(), t.detector
        assert all(np.isfinite(v).all() for v in t.fields.values()), t.detector


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
    record = {"command": "python -m cosim.training mine", "flights": 2, "first_seed": 7}
    assert after["training"] == {**record, "found": [7, 2], "ema": {**record, "found": "other"}}
    assert after["flight"] == before["flight"] | {"threshold": 0.0123457}
    mine.store(made[:1])  # the record of the other set stays
    assert json.loads((tmp_path / "position_monitor.json").read_text()) == after


def test_the_command_stores_what_is_trained_and_check_only_compares(tmp_path, monkeypatch, capsys):
    for file in FOLDER.glob("*.json"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.setattr(trainer, "FOLDER", tmp_path)
    monkeypatch.chdir(tmp_path)
    stored = tmp_path / "position_monitor.json"
    before = stored.read_bytes()
    mine = trainer.Training("monitors", 5, 2, lambda seed, n, run: None, lambda found: [
        Trained("position_monitor", "flight", {"threshold": 0.0123456789}),
    ])  # fmt: skip
    monkeypatch.setattr("cosim.training.__main__.load", lambda name: mine)
    assert main(["monitors", "--check"]) == 1 and stored.read_bytes() == before
    assert "0.0123457" in capsys.readouterr().out
    assert main(["monitors"]) == 0 and json.loads(stored.read_text())["flight"]["threshold"] == 0.0123457
    assert main(["monitors", "--check"]) == 0


@pytest.mark.parametrize(("words", "says"), [
    (["monitor"], "unknown training 'monitor'; allowed: all, designs, hydraulic"),
    (["ema", "--aircraft", "narrowbody"], "'ema' with --aircraft; allowed: all"),
    (["all", "--aircraft", "transport"], "its designs are those of fdi/"),
])  # fmt: skip
def test_what_cannot_be_made_is_refused_in_one_line(words, says, capsys):
    assert main(words) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ") and says in told and told.count("\n") == 1


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.json")), ids=lambda file: file.stem)
def test_what_is_stored_tells_how_its_training_found_it(file):
    data = json.loads(file.read_text(encoding="utf-8"))
    own = data.pop("training")
    records = [r for r in (own, *own.values()) if isinstance(r, dict) and "command" in r]
    for record in records:
        name = record["command"].removeprefix("python -m cosim.training ")
        training = load(name)
        if name != "joint":
            few = file.stem == "rfafe_airframe"  # those at Sun13's point
            number = record["flights"] if few else training.number
            assert record == record | training.about | {"flights": number, "first_seed": training.first_seed}
    assert records


@pytest.mark.parametrize(("name", "least", "largest", "field"), [
    ("position_monitor", train_hydraulic.LEAST_POSITION, "largest_share", "share"),
    ("ofc_monitor", train_hydraulic.LEAST, "largest", "threshold")])  # fmt: skip
def test_a_monitor_flies_with_what_is_stored_beyond_what_the_training_saw(name, least, largest, field):
    data, p = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8")), registry.module(name).params()
    assert (p["threshold"][0] >= least - 1e-6).all()
    assert (np.array(data["training"]["found"][largest]) <= p[field][0]).all()


def test_flights_of_training_are_nobody_elses():
    first, number = train_hydraulic.FIRST_SEED, train_hydraulic.FLIGHTS
    others = {f["seed"] for f in train_ema.flights()}
    for drawn in (over_envelope, manoeuvring):
        own = {f["seed"] for f in drawn(first, number)}
        assert len(own) == number >= 300 and not own & others
    for flight in over_envelope(first, 64):
        own, heavy = flight["manoeuvre"], flight["flight"]["mass_t"] > 300.0
        if own["kind"] in ("nose_up", "pitch_protection"):
            assert own.get("amplitude_g") == (0.15 if heavy else None)
        elif own["kind"] == "three_two_one_one":
            assert (own["amplitude_deg"], own["unit_s"]) == (2.0, 0.5)


def test_every_shipped_file_of_thresholds_has_an_entry_in_a_training():
    named = " ".join(about for _, about in TRAINERS.values())
    assert all(file.stem in named for file in FOLDER.glob("*.json"))
    trained = {*train_hydraulic.TESTS, *train_aircraft.SURVEYS, *MODULES, "ofc_monitor", "position_monitor",
               "ema_kalman_flight", "joint"}  # fmt: skip
    assert trained == {file.stem for file in FOLDER.glob("*.json")}
