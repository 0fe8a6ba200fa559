"""Training of the two monitors of a hydraulic segment: the stored thresholds, the procedure, its own flights."""

import json

import numpy as np
import pytest

from cosim.training import train_ema, train_hydraulic, trainer
from cosim.training.flights import manoeuvring
from cosim.training.threshold_fit import PROBABILITY
from cosim.training.train_hydraulic import FIRST_SEED, FLIGHTS
from fdi.monitors import ofc_monitor, position_monitor


@pytest.mark.parametrize(("module", "fields"), [(position_monitor, ("threshold", "share")),
                                                (ofc_monitor, ("threshold", "share"))])  # fmt: skip
def test_what_is_stored_tells_how_it_was_found(module, fields):
    name = module.DETECTOR.id
    data = json.loads((trainer.FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    how, p = data["training"], module.params()
    assert how["probability_per_flight"] == PROBABILITY and how["first_seed"] == FIRST_SEED
    assert how["flights"] == FLIGHTS >= 300
    for field in fields:
        assert np.allclose(p[field][0], data["flight"][field])
    if name == "ofc_monitor":
        assert (p["threshold"][0] >= train_hydraulic.LEAST).all()
        assert (p["threshold"][0] >= how["found"]["largest"]).all()
    else:
        assert how["found"]["largest"] <= 1.0  # of the limit, in any flight of the training: one may set it


def test_limits_scale_with_what_the_flights_show():
    rng = np.random.default_rng(1)

    def flown(size):
        lag = rng.uniform(0.0, 0.1, (20, 1))
        y = size * (0.002 + 0.3 * lag) * rng.uniform(0.2, 1.0, (20, 1))
        found = size * rng.uniform(0.2, 1.0, (3, len(train_hydraulic.SHARES))) * 2e-3
        return {"position_monitor": np.hstack([y, np.ones_like(lag), lag]).tolist(),
                "ofc_monitor": {"threshold": found.tolist(), "motion": [1e-3] * 3,
                                "response": (0.1 * rng.standard_normal((4, ofc_monitor.N))).tolist()}}  # fmt: skip

    one, two = ([flown(size) for _ in range(60)] for size in (1.0, 2.0))
    a, b = ({t.detector: t.fields for t in train_hydraulic.monitor_limits(flights)} for flights in (one, two))
    for name in a:
        assert np.mean(b[name]["threshold"]) > 1.5 * np.mean(a[name]["threshold"])
    worst = max((np.array(f["position_monitor"]) @ [1.0, 0.0, 0.0]
                 / (np.array(f["position_monitor"])[:, 1:] @ [a["position_monitor"][k] for k in ("threshold", "share")])
                 ).max() for f in one)  # fmt: skip
    assert worst <= 1.0


def test_flights_of_training_are_nobody_elses():
    own = {f["seed"] for f in manoeuvring(FIRST_SEED, FLIGHTS)}
    assert len(own) == FLIGHTS
    assert not own & {f["seed"] for f in train_ema.flights()}
    assert max(own) < FIRST_SEED + 1000  # below the seeds of evaluation
