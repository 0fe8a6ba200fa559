"""Fit a classifier to windows of signals, and fly it as a detector: scikit-learn here; of ONNX a session's function.

Needs scikit-learn (pip install 'cosim-fdi[learn]').
"""

import numpy as np
from sklearn.ensemble import RandomForestClassifier

import cosim

SIGNALS = {"rod": "sensors.left_inner_rod.y_obs", "valve_command": "hydraulic_in.left_inner.u"}
BASE = ["duration_s=10", "detectors.enabled=[]", "elevator.feedback=measured"]
FAULT = "{target='elevator.left_inner', kind='ofc_liquid', at='valve', start_s=4, frequency_hz=%g, amplitude_mm=6}"
SAMPLES, STEP = 100, 2  # a window of one second, every second tick of 5 ms


def features(window):
    """Return what the model is asked: of each signal its swing and its roughness, without its mean."""
    moved = window - window.mean(axis=1, keepdims=True)
    return np.concatenate([np.ptp(moved, axis=1), np.abs(np.diff(moved, axis=1)).mean(axis=1)])


def windows(overrides):
    """Return the features of every window of a flight."""
    table = cosim.fly(cosim.load_scenario("cruise", [*BASE, *overrides]), list(SIGNALS.values()))
    y = table.to_numpy()[::STEP].T
    return np.array([features(y[:, k - SAMPLES : k]) for k in range(SAMPLES, y.shape[1], 10)]), y.shape[1]


rows: list = []
labels: list = []
for seed, hz in enumerate((None, 1.0, 2.0, None, 3.0)):
    x, n = windows([f"seed={seed}", *([] if hz is None else [f"faults.0={FAULT % hz}"])])
    begun = (np.arange(SAMPLES, n, 10) * STEP * 0.005 > 5.0) & (hz is not None)
    rows, labels = [*rows, x], [*labels, begun.astype(int)]
forest = RandomForestClassifier(30, random_state=1).fit(np.concatenate(rows), np.concatenate(labels))

cosim.register(
    cosim.window_model(
        "forest", forest, inputs=tuple(SIGNALS), technologies=("hydraulic",), classes=("none", "ofc_liquid"),
        window_s=1.0, sample_s=0.01, every_s=0.1, features=features, designed_for=("ofc_liquid",),
    )
)  # fmt: skip
unseen = ["seed=9", "detectors.enabled=['forest', 'ofc_monitor']", f"faults.0={FAULT % 1.5}"]
for lane in cosim.simulate(cosim.load_scenario("cruise", [*BASE, *unseen])).to_dict()["detectors"]:
    if lane["target"] == "elevator.left_inner":
        print(lane["id"], lane["detection_delay_s"], lane["isolated"], f"{lane['false_alarms']} false alarms")
