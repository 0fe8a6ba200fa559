"""A fitted model over a window of signals as a detector: scikit-learn, ONNX, or any function.

    Forest = window_model("forest", forest, inputs=("rod", "valve_command"), technologies=("hydraulic",),
                          window_s=1.0, every_s=0.1, classes=("none", "ofc_liquid"))

The model sees the last `window_s` seconds of each input, a sample every `sample_s`; it is asked every `every_s`, and
never about a window with a lost sample in it. What it is asked is `features(window)`, with window an array
(inputs, samples), oldest first; by default all samples in a row. What it answers is a probability per class.
"""

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim.parts.detector import PartError


def window_model(
    id: str, model: Any, *, inputs: Sequence[str], classes: Sequence[str], technologies: Sequence[str] = (),
    window_s: float = 1.0, every_s: float = 0.1, sample_s: float = 0.01, threshold: float = 0.5,
    features: Callable[[np.ndarray], np.ndarray] = np.ravel, designed_for: Sequence[str] = (),
) -> type:  # fmt: skip
    """Return the class of a detector (cosim/parts/detector.py) that asks `model` about a window.

    `model` has predict_proba, or is a function of (1, features) that returns (1, classes), such as
    `lambda x: session.run(None, {"X": x})[-1]` of an ONNX session. `classes` are its outputs in order, words of
    verdicts; the first is "none". r is the probability of anything else over `threshold`. Local with `technologies`,
    else at aircraft level.
    """
    inputs, classes = tuple(inputs), tuple(classes)  # those of a fitted model are an array
    if classes[:1] != ("none",):
        raise PartError(f"classes = {classes!r}", place=id, allowed='"none" first, then classes of verdicts')
    ask = getattr(model, "predict_proba", model)

    class WindowModel:
        """a fitted model over a window of signals"""

        def __init__(self, dt: float, threshold: float = threshold):
            self._threshold, self._k = threshold, 0
            self._stride, self._between = (max(1, round(s / dt)) for s in (sample_s, every_s))
            self._window = np.full((len(inputs), max(1, round(window_s / (self._stride * dt)))), np.nan)

        def update(self, t: float, y: Any) -> dict | None:
            k, self._k = self._k, self._k + 1
            if k % self._stride == 0:
                self._window = np.column_stack([self._window[:, 1:], y])
            if k % self._between:
                return None
            if not np.isfinite(self._window).all():
                return {"valid": False}
            x = np.asarray(features(self._window.copy()), np.float32).reshape(1, -1)
            verdict = dict(zip(classes, np.ravel(ask(x)).tolist(), strict=True))
            r = (1.0 - verdict["none"]) / self._threshold
            return {"r": r, "alarm": r >= 1.0, "verdict": verdict}

    own: Any = WindowModel
    own.id, own.inputs, own.designed_for = id, inputs, tuple(designed_for)
    own.level, own.technologies = ("local" if technologies else "aircraft"), tuple(technologies)
    own.__module__ = sys._getframe(1).f_globals["__name__"]  # the class is that of the module that calls
    return own
