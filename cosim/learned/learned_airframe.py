"""A learned detector of the whole aircraft: gradient-boosted trees over features of four seconds.

`cosim train learned` fits it. Needs onnxruntime (pip install 'cosim-fdi[learn]').
"""

import json
from pathlib import Path

import learned_windows as windows

import cosim

told = json.loads(Path(__file__).with_name("learned.json").read_text(encoding="utf-8"))["learned_airframe"]
Airframe = cosim.window_model(
    "learned_airframe", "learned_airframe.onnx", inputs=windows.AIRCRAFT, classes=told["classes"],
    window_s=told["window_s"], sample_s=windows.SLOW, every_s=0.2, threshold=told["threshold"],
    features=windows.aircraft, designed_for=told["designed_for"], near=__file__,
)  # fmt: skip
Airframe.blind = told["blind"]
