"""Flights of the Lu17 study: one seed of some cases, and what the stored thresholds say about how they were found."""

import json

import numpy as np
import pytest

from cosim import lu17_study, train_lu17
from fdi import iotsekf, rtsekf_flight

CASES = {c.name: c for c in lu17_study.cases()}
LOCAL = {"iotsekf": (iotsekf, iotsekf.params()), "rtsekf_flight": (rtsekf_flight, rtsekf_flight.params())}


@pytest.mark.parametrize(
    "name",
    [
        "ofc_liquid 1 Hz 0.6 mm",
        "ofc_solid 5 Hz 0.6 mm",
        "runaway 20 deg/s",
        "jam_solid, step 1 deg",
        "rod bias 1 mm",
    ],
)
def test_in_flight_each_fault_has_its_name_in_time(name):
    case = CASES[name]
    found = lu17_study.outcomes(case, LOCAL, seeds=1, first_seed=1)
    row = lu17_study.summary(case, found["iotsekf"])
    assert (row["early"], row["in_time"], row["right"]) == (0, 1, 1), row
    sensor = lu17_study.summary(case, found["rtsekf_flight"])
    assert sensor["detected"] == (1 if name.startswith("rod") else 0), sensor


def test_a_healthy_flight_is_quiet_and_every_segment_is_watched():
    flight = train_lu17.draw(5, point=train_lu17.POINTS[1], manoeuvre="pitch_protection", turbulence="light")
    recorded = lu17_study.record(**{**flight, "duration": 20.0})
    assert recorded["u"].shape == (4, 4000)
    for name, (module, p) in lu17_study.default_detectors().items():
        assert not (lu17_study.estimate(module, recorded, p, ("alarm",))["alarm"] > 0.5).any(), name


@pytest.mark.parametrize("detector", ["iotsekf", "ofc_monitor", "position_monitor"])
def test_stored_thresholds_are_the_margin_times_what_training_saw(detector):
    data = json.loads((train_lu17.FOLDER / f"{detector}.json").read_text(encoding="utf-8"))
    how = data.pop("training")
    assert how["margin"] == train_lu17.MARGIN
    assert how["first_seed"] == train_lu17.TRAINING
    assert how["flights"] >= 60
    for name, largest in how["largest"].items():
        stored = data[name if name in data else "flight"]
        for key, value in largest.items():
            least = how["margin"] * np.array(value)
            assert np.all(np.array(stored[key]) >= 0.999 * least), (name, key)


def test_training_and_evaluation_share_no_seed():
    first = train_lu17.TRAINING
    train = {f["seed"] for f in [*train_lu17.flights(first), *train_lu17.harsh(first + 500)]}
    judged = {f["seed"] for f in train_lu17.flights(train_lu17.EVALUATION, draws=3)}
    assert len(train) == 132 and len(judged) == 324
    assert not train & judged
