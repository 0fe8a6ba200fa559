"""A fitted model over a window of signals as a detector: scikit-learn, ONNX, or any function.

    Forest = window_model("forest", "forest.onnx", inputs=("rod", "valve_command"), technologies=("hydraulic",),
                          window_s=1.0, every_s=0.1, classes=("none", "ofc_liquid"))

The model sees the last `window_s` seconds of each input, a sample every `sample_s`; it is asked every `every_s`, and
never about a window with a lost sample in it. What it is asked is `features(window)`, with window an array
(inputs, samples), oldest first; by default all samples in a row. What it answers is a probability per class.
"""

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.parts.detector import PartError


def window_model(
    id: str, model: Any, *, inputs: Sequence[str], classes: Sequence[str], technologies: Sequence[str] = (),
    window_s: float = 1.0, every_s: float = 0.1, sample_s: float = 0.01, threshold: float = 0.5,
    features: Callable[[np.ndarray], np.ndarray] = np.ravel, designed_for: Sequence[str] = (), near: str | Path = ".",
) -> type:  # fmt: skip
    """Return the class of a detector (cosim/parts/detector.py) that asks `model` about a window.

    `model` is a fitted object with predict_proba or predict, a function of (1, features) that returns (1, classes), or
    a file of one (.onnx, by onnxruntime) in the folder of `near`: pass __file__. `classes` are the model's outputs in
    order, words of verdicts; the first is "none", and "sensor.rod" names the part as well. r is the probability of
    anything else over `threshold`. Local with `technologies`, else at aircraft level.
    """
    words = tuple(classes)
    if not words or words[0] != "none":
        raise PartError(f"classes = {words!r}", place=id, allowed='"none" first, then classes of verdicts')
    kinds, parts = zip(*((kind, part) for kind, _, part in (word.partition(".") for word in words)))
    ask = _asked(model, Path(near).parent if Path(near).is_file() else Path(near), id)
    names = tuple(name.replace(".", "_") for name in inputs)

    class WindowModel:
        """a fitted model over a window of signals"""

        def __init__(self, dt: float, threshold: float = threshold):
            self._threshold = threshold
            self._stride = max(1, round(sample_s / dt))
            self._between = max(1, round(every_s / dt))
            self._samples = max(1, round(window_s / (self._stride * dt)))
            self._ring = np.full((len(names), self._samples), np.nan)
            self._k = 0

        def update(self, t: float, y: Any) -> dict | None:
            k, self._k = self._k, self._k + 1
            if k % self._stride == 0:
                self._ring[:, :-1] = self._ring[:, 1:]
                self._ring[:, -1] = y
            if k % self._between or not math.isfinite(self._ring.sum()):
                return {"valid": False} if k % self._between == 0 else None
            p = ask(np.asarray(features(self._ring.copy()), np.float32).reshape(1, -1), len(words))
            other = 1.0 - float(p[0])
            said = dict.fromkeys(kinds, 0.0)
            for kind, value in zip(kinds, p):
                said[kind] += float(value)
            best = max(said, key=lambda kind: said[kind])
            part = max((float(v), name) for v, kind, name in zip(p, kinds, parts) if kind == best)[1]
            alarm = other >= self._threshold
            return {"r": other / self._threshold, "alarm": alarm, "verdict": said, "isolated_part": part}

    own: Any = WindowModel
    own.id, own.inputs, own.designed_for = id, tuple(inputs), tuple(designed_for)
    own.level, own.technologies = ("local" if technologies else "aircraft"), tuple(technologies)
    own.isolable_parts = tuple(dict.fromkeys(part for part in parts if part))
    own.__module__ = sys._getframe(1).f_globals["__name__"]  # the class is that of the module that calls
    return own


def _asked(model, folder, place):
    """Return ask(x (1, n), classes) -> probabilities (classes,)."""
    if isinstance(model, str | Path):
        model = _onnx(folder / model, place)
    if hasattr(model, "predict_proba"):
        return lambda x, n: _checked(model.predict_proba(x)[0], n, place)
    if hasattr(model, "predict"):
        return lambda x, n: np.eye(n)[int(np.ravel(model.predict(x))[0])]
    return lambda x, n: _checked(np.ravel(model(x)), n, place)


def _checked(p, n, place):
    if len(p) != n:
        raise PartError(f"the model gives {len(p)} classes", place=place, allowed=f"{n}")
    return p


def _onnx(path, place):
    if path.suffix != ".onnx" or not path.is_file():
        raise PartError("no such file" if path.suffix == ".onnx" else "is no model", place=f"{place}: {path}",
                         allowed="a file that ends in .onnx")  # fmt: skip
    try:
        import onnxruntime
    except ImportError:
        remedy = "Install the extra: pip install 'cosim-fdi[learn]'"
        raise PartError("onnxruntime is not installed", place=str(path), remedy=remedy) from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # a window is small, and one thread has one result
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    entry = session.get_inputs()[0].name

    def ask(x):
        found = session.run(None, {entry: x})[-1]
        if isinstance(found, list):  # of scikit-learn by skl2onnx: a mapping per sample
            found = np.array(list(found[0].values()))
        return found

    return ask
