"""The learned detectors: an exported model says what the fitted one said, of the windows that it was fitted to."""

import json

import numpy as np
import pytest

from cosim.compare.score import LEARNED, learned
from cosim.replay import benchmark_recording
from cosim.scenario import load_scenario
from cosim.training import learned as training

onnxruntime = pytest.importorskip("onnxruntime", reason="an extra")
pytest.importorskip("onnx", reason="of training only")


def asked(model, x):
    session = onnxruntime.InferenceSession(model if isinstance(model, bytes) else model.SerializeToString())
    return session.run(None, {session.get_inputs()[0].name: x})[-1]


def test_exported_trees_say_what_the_fitted_ones_said():
    from sklearn.ensemble import HistGradientBoostingClassifier

    rng = np.random.default_rng(0)
    x = rng.standard_normal((2000, 6)).astype(np.float32)
    y = np.where(x[:, 0] > 0, 1, 0) + np.where(x[:, 1] * x[:, 2] > 0.5, 3, 0)  # class 2 never comes
    model = HistGradientBoostingClassifier(max_iter=10, max_leaf_nodes=12).fit(x, y)
    found = asked(training.of_trees(model, 6, 5), x)
    assert np.abs(found[:, model.classes_] - model.predict_proba(x)).max() < 1e-5
    assert found[:, 2].max() < 1e-6 and np.allclose(found.sum(axis=1), 1.0, atol=1e-5)


def test_the_convolution_learns_an_oscillation():
    rng = np.random.default_rng(1)
    t, n = 0.01 * np.arange(200), 4000
    x = rng.standard_normal((n, 5, 200))
    y = rng.integers(0, 2, n)
    x[:, 1] += 3.0 * y[:, None] * np.sin(2 * np.pi * rng.uniform(2, 5, n)[:, None] * t)
    x = x.reshape(n, -1).astype(np.float32)
    found = asked(training.convolved(x[:3000], y[:3000], 3), x[3000:])
    assert np.mean(found.argmax(axis=1) == y[3000:]) > 0.9 and found[:, 2].max() < 1e-6


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return a recording of ten seconds; its fault begins when the longest window, of 4 s, has long been full."""
    path = tmp_path_factory.mktemp("learned") / "x.parquet"
    given = ["duration_s=10", "faults.0.start_s=6", "elevator.feedback='measured'"]
    benchmark_recording.record(load_scenario("liquid-ofc", given), path)
    return benchmark_recording.Recording(path)


@pytest.mark.parametrize("learner", training.LEARNERS, ids=lambda x: x.id)
def test_in_flight_a_model_is_asked_what_it_was_fitted_to(learner, recording):
    file = learned()[learner.id]
    model = (LEARNED / f"{learner.id}.onnx").read_bytes()
    assert len(model) <= 1e6
    told = json.loads((LEARNED / "learned.json").read_text(encoding="utf-8"))[learner.id]
    assert tuple(told["classes"]) == learner.classes
    lanes = list(benchmark_recording.judgement(recording, benchmark_recording.flown_with(recording, (), [file])))
    step = 0.1 if learner.window_s == 2.0 else 0.2
    x, y, lane = training.windows_of(recording, learner, step)
    p = asked(model, x)
    for n, each in enumerate(lanes):
        said = [k for _, k in each.told]
        own = p[lane == n]
        assert len(said) == len(own) > 10
        assert np.abs(np.array([k["none"] for k in said]) - own[:, 0]).max() < 1e-4
    assert set(learner.classes[c] for c in y) == {"none", "ofc_liquid"}
