"""The one trainer: a reduced set of flights per detector gives every limit, what is stored is what was trained, and
every shipped file of thresholds has an entry."""

import dataclasses
import json

import numpy as np
import pytest

from cosim.training import TRAINERS, load, train_ema, train_hydraulic, trainer
from cosim.training.__main__ import main
from cosim.training.flights import manoeuvring, over_envelope
from cosim.training.trainer import FOLDER, Training, changes, store, trained
from fdi import registry

# of each training a flight that shows what its thresholds are for
SHORT = {
    "hydraulic": (over_envelope(21_000, 2)[1], 8.0), "monitors": (manoeuvring(21_000, 28)[27], 8.0),
    "ema": (train_ema.flights(number=4)[3], 12.0), "aircraft": ({"index": 18, "first_seed": 31_000}, None),
    "rfafe": (load("rfafe").flights(1000, 1)[0], 10.0),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for file in FOLDER.glob("*.json"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.setattr(trainer, "FOLDER", tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", SHORT)
def test_one_flight_is_enough_for_every_limit_that_is_stored(name):
    flight, seconds = SHORT[name]
    flight = flight | ({"duration": seconds} if seconds else {})
    made = trained(name, dataclasses.replace(load(name), flights=lambda first_seed, number: [flight]), workers=0)
    assert made and made.keys() <= set(registry.SHIPPED)
    for detector, held in made.items():
        stored = json.loads((FOLDER / f"{detector}.json").read_text(encoding="utf-8"))
        for which, fields in stored.items():
            assert which == trainer.RECORD or held[which].keys() == fields.keys(), detector
            assert which == trainer.RECORD or all(np.isfinite(v).all() for v in held[which].values()), detector


def mine(threshold):
    """Return a training without a flight, whose threshold of the position monitor is this."""
    limits = lambda found: {"position_monitor": ({"flight": {"threshold": threshold}}, {"found": found})}  # noqa: E731
    return Training(7, 2, lambda first_seed, number: [], dict, limits, {"flight_s": 60.0})


def test_what_is_trained_is_stored_beside_what_else_the_file_holds(folder):
    file = folder / "position_monitor.json"
    before = json.loads(file.read_text())
    made = trained("mine", mine(0.0123457), workers=0)
    assert list(changes(made)) == [("position_monitor", "flight threshold", before["flight"]["threshold"], 0.0123457)]
    store(made)
    record = {"command": "python -m cosim.training mine", "flight_s": 60.0, "flights": 0, "first_seed": 7}
    after = {"flight": before["flight"] | {"threshold": 0.0123457}, "training": record | {"found": []}}
    assert json.loads(file.read_text()) == before | after and not list(changes(made))


def test_the_command_stores_what_is_trained_and_check_only_compares(folder, monkeypatch, capsys):
    file = folder / "position_monitor.json"
    before = file.read_bytes()
    monkeypatch.setattr("cosim.training.__main__.load", lambda name: mine(0.0123457))
    assert main(["monitors", "--check"]) == 1 and file.read_bytes() == before
    assert "0.0123457" in capsys.readouterr().out
    assert main(["monitors"]) == 0 and json.loads(file.read_text())["flight"]["threshold"] == 0.0123457
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
    record = json.loads(file.read_text(encoding="utf-8"))["training"]
    training = load(record["command"].removeprefix("python -m cosim.training "))
    assert record == record | training.about | {"first_seed": training.first_seed}
    assert file.stem in ("joint", "rfafe_airframe") or record["flights"] == training.number  # those that count


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
