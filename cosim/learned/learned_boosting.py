"""A learned detector of one hydraulic actuator: gradient-boosted trees over features of two seconds.

`cosim train learned` fits it. Needs onnxruntime (pip install 'cosim-fdi[learn]').
"""

import json
from pathlib import Path

import learned_windows as windows

import cosim

told = json.loads(Path(__file__).with_name("learned.json").read_text(encoding="utf-8"))["learned_boosting"]
Boosting = cosim.window_model(
    "learned_boosting", "learned_boosting.onnx", inputs=windows.LOCAL, technologies=("hydraulic",),
    classes=told["classes"], window_s=told["window_s"], sample_s=windows.DT, every_s=0.1, threshold=told["threshold"],
    features=windows.local, designed_for=told["designed_for"], near=__file__,
)  # fmt: skip
Boosting.blind = told["blind"]
