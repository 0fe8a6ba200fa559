"""The learned detectors of the score's table: fitted to windows of training flights, exported to ONNX.

The flights are those of the benchmark's families with other seeds, at other points, drawn over mass, CG, altitude and
speed; a point that does not trim is left out. A quarter of the flights is held out: on it a threshold is set beyond the
largest probability of a fault where there is none, and the log loss is told.

    cosim train learned --check        fit, say what would change
    cosim train learned                and write cosim/learned/*.onnx and learned.json

Needs scikit-learn, onnx and onnxruntime; a score needs the last only.
"""

import functools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np

from cosim.campaign.draw import Draw
from cosim.campaign.spec import load_campaign
from cosim.campaign.worker import run_id
from cosim.compare.score.flights import NAME, RecordedFlight, fly_into
from cosim.errors import DesignError
from cosim.files import replace as replace_file
from cosim.files import replace_text
from cosim.judge.coverage import cases, true_class
from cosim.replay.benchmark_recording import Recording

FIRST_SEED, NUMBER = 500_000, 400  # of the flights
FOLDER = Path(__file__).resolve().parents[1] / "learned"
POINTS = {"flight.mass_t": (205.0, 380.0), "flight.cg_pct": (25.5, 35.5), "flight.altitude_ft": (6000.0, 34000.0),
          "flight.cas_kt": (200.0, 320.0)}  # fmt: skip
HELD_OUT = 4  # every so many flights one is not fitted
EVERY_S = 0.3  # between windows that are fitted
HALF = 0.5  # of the room between the largest probability of a fault without one and certainty: the threshold
UNSEEN = -30.0  # logarithm of the odds of a class that no window had
KERNELS, TAPS, DILATIONS = 20, 9, (1, 2, 4, 8, 16)  # of the convolution: for each dilation, samples, and dilations


@dataclass(frozen=True)
class Learner:
    """One learned detector: what it is asked, which faults it can see, what is fitted."""

    id: str
    classes: tuple
    window_s: float
    designed_for: tuple
    blind: str
    features: str  # function of learned_windows
    words: str  # its inputs there
    step_s: str  # between samples there
    fit: Callable[..., Any]
    lanes: tuple = ("",)  # segments that it watches, "" for the aircraft
    sees: Callable[..., bool] = field(default=lambda case, target, lane: True)


def own_part(case: str, target: str, lane: str) -> bool:
    """Tell whether a fault is to be seen at the actuator `lane`: on it, and not with its command."""
    there = target.split(".")[1] if target.startswith("elevator.") else ""
    return bool(there) and (lane == there or lane.startswith(f"{there}_")) and "@command" not in case


def in_motion(case: str, target: str, lane: str) -> bool:
    """Tell whether a fault is to be seen from the aircraft's own sensors: not one of an actuator's sensor."""
    return not (target.startswith("elevator.") and true_class(case) in ("sensor", "jam_liquid"))


@functools.cache
def windows() -> Any:
    """Return the module of features, which the detectors import as a neighbour."""
    spec = util.spec_from_file_location("learned_windows", FOLDER / "learned_windows.py")
    assert spec is not None and spec.loader is not None
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def flights(folder: str | Path, first_seed: int = FIRST_SEED, number: int = NUMBER, **how: Any) -> list[RecordedFlight]:
    """Fly the training set into `folder`; return its flights. `how`: see `cosim.campaign.jobs.work`."""
    made = load_campaign(NAME)
    drawn = {key: Draw(low, high) for key, (low, high) in POINTS.items()}
    parts = tuple(replace(p, draw={**{k: v for k, v in p.draw.items() if k != "point"}, **drawn}) for p in made.parts)
    found, labels = replace(made, parts=parts, seed=first_seed, first_seed=first_seed).scenarios()
    every = [(run_id(s), label["part"], s.expanded_toml()) for s, label in zip(found, labels)]
    some = [every[i * len(every) // number] for i in range(min(number, len(every)))]
    return [f for f in fly_into(Path(folder), some, **how) if "sha256" in f.told]


def windows_of(recording: Recording, learner: Learner, every_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (features (n, m), class numbers (n,), lane of each (n,)) of the windows of one flight, as in flight."""
    own = windows()
    dt, step = recording.scenario.dt, getattr(own, learner.step_s)
    stride, samples = round(step / dt), round(learner.window_s / step)
    x: list = []
    y: list = []
    lanes: list = []
    for n, lane in enumerate(learner.lanes):
        names = [f"{lane}.{w}" if lane else w for w in getattr(own, learner.words)]
        signals = np.stack([recording.column(name)[::stride] for name in names])
        begun = _labels(recording, learner, lane)
        every = round(every_s / step)
        for j in range(-(-(samples - 1) // every) * every, signals.shape[1], every):
            window = signals[:, j - samples + 1 : j + 1]
            if np.isfinite(window).all():
                x.append(getattr(own, learner.features)(window))
                y.append(next((c for c, start in begun if j * step >= start), 0))
                lanes.append(n)
    return np.array(x, np.float32), np.array(y), np.array(lanes)


def _labels(recording, learner, lane):
    """Return [(class number, onset [s])] of the faults that the learner is to see on `lane`."""
    scenario, out = recording.scenario, []
    for fault, case in zip(scenario.faults, cases(scenario)):
        if learner.sees(case, fault.target, lane):
            word, part = true_class(case), fault.target.split(".")[-1]
            word = f"{word}.{part}" if word == "sensor" else word
            if word in learner.classes:
                out.append((learner.classes.index(word), fault.start_s + 0.05))
    return out


def boosted(x: np.ndarray, y: np.ndarray, classes: int) -> Any:
    """Return the ONNX model of gradient-boosted trees fitted to features x (n, m) of classes y (n,)."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    model = HistGradientBoostingClassifier(
        max_iter=50, max_leaf_nodes=12, learning_rate=0.15, l2_regularization=1.0, min_samples_leaf=40, random_state=1
    )
    model.fit(x, y)
    return of_trees(model, x.shape[1], classes)


def of_trees(model: Any, features: int, classes: int) -> Any:
    """Return the ONNX model of a fitted HistGradientBoostingClassifier (skl2onnx 1.20 fails on it with onnx 1.23)."""
    from onnx import TensorProto, helper

    trees = [(int(c), p.nodes) for row in model._predictors for c, p in zip(model.classes_, row)]
    every, leaves = [], []
    for tree, (c, nodes) in enumerate(trees):
        for i, n in enumerate(nodes):
            leaf = bool(n["is_leaf"])
            asked = (0, 0.0, "LEAF") if leaf else (int(n["feature_idx"]), float(n["num_threshold"]), "BRANCH_LEQ")
            every.append((tree, i, *asked, int(n["left"]), int(n["right"])))
            leaves += [(tree, i, c, float(n["value"]))] * leaf
    names = "treeids nodeids featureids values modes truenodeids falsenodeids".split()
    at: dict[str, Any] = {f"nodes_{name}": list(column) for name, column in zip(names, zip(*every))}
    names = "treeids nodeids ids weights".split()
    at |= {f"class_{name}": list(column) for name, column in zip(names, zip(*leaves))}
    base = np.full(classes, UNSEEN)
    base[model.classes_] = model._baseline_prediction.ravel()
    node = helper.make_node("TreeEnsembleClassifier", ["x"], ["label", "probability"], domain="ai.onnx.ml",
                            classlabels_int64s=list(range(classes)), base_values=[float(b) for b in base],
                            post_transform="SOFTMAX", **at)  # fmt: skip
    label = helper.make_tensor_value_info("label", TensorProto.INT64, [None])
    return _graph([node], features, "probability", classes, first=[label], more=[helper.make_opsetid("ai.onnx.ml", 3)])


def _graph(nodes, inputs, output, size, held=(), first=(), more=()):
    """Return an ONNX model from `x` (None, inputs) to `output` (None, size)."""
    from onnx import TensorProto, helper

    x, y = (helper.make_tensor_value_info(n, TensorProto.FLOAT, [None, k]) for n, k in (("x", inputs), (output, size)))
    graph = helper.make_graph(nodes, "learned", [x], [*first, y], list(held))
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17), *more], ir_version=9)


def convolved(x: np.ndarray, y: np.ndarray, classes: int, channels: int = 5) -> Any:
    """Return the ONNX model of random convolutions, pooled, under a perceptron with one hidden layer [ROCKET,
    Dempster 2020]; x (n, channels samples)."""
    import onnxruntime
    from onnx import helper, numpy_helper
    from sklearn.neural_network import MLPClassifier

    rng = np.random.default_rng(1)
    samples, pooled, nodes = x.shape[1] // channels, [], []
    weights: dict[str, np.ndarray] = {"shape": np.array([-1, channels, samples])}

    def add(operator, read, write, **how):
        nodes.append(helper.make_node(operator, read.split(), [write], **how))

    def model(output, size):
        held = [numpy_helper.from_array(value, name) for name, value in weights.items()]
        return _graph(nodes, channels * samples, output, size, held)

    add("Reshape", "x shape", "c")
    for d in DILATIONS:
        w = rng.standard_normal((KERNELS, channels, TAPS)) * (rng.random((KERNELS, channels, 1)) < 0.5)
        weights[f"w{d}"] = (w - w.mean(axis=2, keepdims=True)).astype(np.float32)
        weights[f"b{d}"] = rng.uniform(-1.0, 1.0, KERNELS).astype(np.float32)
        add("Conv", f"c w{d} b{d}", f"v{d}", dilations=[d], kernel_shape=[TAPS])
        add("Relu", f"v{d}", f"r{d}")
        add("ReduceMax", f"r{d}", f"m{d}", axes=[2], keepdims=0)
        add("ReduceMean", f"r{d}", f"a{d}", axes=[2], keepdims=0)
        pooled += [f"m{d}", f"a{d}"]
    weights["one"] = np.array(1.0, np.float32)
    add("Concat", " ".join(pooled), "p", axis=1)
    add("Add", "p one", "p1")
    add("Log", "p1", "f")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    run = onnxruntime.InferenceSession(model("f", 2 * KERNELS * len(DILATIONS)).SerializeToString(), options).run
    z = np.concatenate([run(None, {"x": x[i : i + 2000]})[0] for i in range(0, len(x), 2000)])
    mean, spread = z.mean(axis=0), z.std(axis=0) + 1e-6
    net = MLPClassifier((48,), alpha=1e-3, early_stopping=True, max_iter=40, batch_size=512, random_state=1)
    net.fit((z - mean) / spread, y)
    full = np.zeros((48, classes), np.float32)
    bias = np.full(classes, UNSEEN, np.float32)
    bias[net.classes_] = 0.0
    said = net.classes_[-net.n_outputs_ :]  # of two classes the net has one output, for the second
    full[:, said], bias[said] = net.coefs_[1], net.intercepts_[1]
    weights |= {"mean": mean, "spread": spread, "hidden": net.coefs_[0].astype(np.float32), "last": full,
                "hidden_0": net.intercepts_[0].astype(np.float32), "last_0": bias}  # fmt: skip
    add("Sub", "f mean", "f0")
    add("Div", "f0 spread", "f1")
    add("Gemm", "f1 hidden hidden_0", "h")
    add("Relu", "h", "h1")
    add("Gemm", "h1 last last_0", "o")
    add("Softmax", "o", "probability", axis=1)
    return model("probability", classes)


HYDRAULIC = ("none", "ofc_liquid", "ofc_solid", "jam_solid", "jam_liquid", "runaway", "effectiveness", "sensor.rod",
             "sensor.surface", "sensor.pressure")  # fmt: skip
KINDS = tuple(f"hydraulic.{k}" for k in ("ofc_liquid", "ofc_solid", "jam_solid", "jam_liquid", "runaway", "rod",
                                        "surface", "pressure", "loss_of_effectiveness"))  # fmt: skip
ACTUATOR: dict[str, Any] = {
    "classes": HYDRAULIC, "window_s": 2.0, "designed_for": KINDS, "words": "LOCAL", "step_s": "DT", "sees": own_part,
    "blind": "what comes with the command is no fault of the actuator", "lanes": ("left_outer", "left_inner"),
}  # fmt: skip
LEARNERS = (
    Learner(id="learned_boosting", features="local", fit=boosted, **ACTUATOR),
    Learner(id="learned_convolution", features="raw", fit=convolved, **ACTUATOR),
    Learner(
        id="learned_airframe", features="aircraft", fit=boosted, words="AIRCRAFT", step_s="SLOW", window_s=4.0,
        classes=("none", "ofc_liquid", "ofc_solid", "jam_solid", "runaway", "effectiveness", "thrust", "sensor.alpha",
                 "sensor.n_z", "sensor.q", "sensor.cas"),
        designed_for=("sensor.alpha", "sensor.n_z", "sensor.q", "sensor.cas", "engine", "*.ofc_liquid*", "*.ofc_solid*",
                      "*.jam_solid", "*.runaway*", "*.loss_of_effectiveness*"),
        blind="a sensor of an actuator moves nothing", sees=in_motion,
    ),
)  # fmt: skip


def train(*, first_seed: int = FIRST_SEED, number: int = NUMBER, folder: str | Path, **how: Any) -> dict:
    """Fly the training set into `folder` and fit every learner; return {id: {told, model}}, `told` as in learned.json.

    Raises DesignError without scikit-learn, onnx or onnxruntime.
    """
    if not all(util.find_spec(name) for name in ("sklearn", "onnx", "onnxruntime")):
        raise DesignError("scikit-learn, onnx or onnxruntime is not installed", place="cosim train learned",
                          remedy="pip install 'cosim-fdi[learn]' onnx")  # fmt: skip
    flown = flights(folder, first_seed, number, **how)
    return {learner.id: fitted(learner, flown, first_seed) for learner in LEARNERS}


def fitted(learner: Learner, flown: list[RecordedFlight], first_seed: int) -> dict:
    """Return {told, model} of one learner: fitted to three quarters of the flights, its threshold from the others."""
    import onnxruntime

    fit, held = ([f for i, f in enumerate(flown) if (i % HELD_OUT == 0) == out] for out in (False, True))
    parts = [windows_of(Recording(f.path, f.told["sha256"]), learner, EVERY_S) for f in fit]
    x, y = (np.concatenate([p[k] for p in parts]) for k in (0, 1))
    model = learner.fit(x, y, len(learner.classes)).SerializeToString()
    session = onnxruntime.InferenceSession(model)
    ask = partial(session.run, None)
    most, loss, windows_held = [0.0], 0.0, 0
    for f in held:
        u, c, lanes = windows_of(Recording(f.path, f.told["sha256"]), learner, EVERY_S)
        p = ask({session.get_inputs()[0].name: u})[-1]
        loss += float(-np.log(np.clip(p[np.arange(len(c)), c], 1e-6, 1.0)).sum())
        windows_held += len(c)
        most += [float(1.0 - p[(lanes == n) & (c == 0), 0].min(initial=1.0)) for n in range(len(learner.lanes))]
    told = {
        "classes": list(learner.classes), "window_s": learner.window_s, "designed_for": list(learner.designed_for),
        "blind": learner.blind, "threshold": round(1.0 - HALF * (1.0 - max(most)), 6),
        "training": {"flights": len(fit), "windows": len(x), "first_seed": first_seed, "held_out": len(held),
                     "log_loss": round(loss / max(1, windows_held), 4), "largest_without_fault": round(max(most), 6)},
    }  # fmt: skip
    return {"told": told, "model": model}


def changes(found: dict) -> list[tuple]:
    """Return (file, what, of what, stored, trained) rows."""
    path = FOLDER / "learned.json"
    stored = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    none = {"threshold": math.nan, "training": {"log_loss": math.nan}}
    both = {f"{name}.onnx": (stored.get(name, none), made["told"]) for name, made in found.items()}
    return [(file, "held out", what, *values) for file, told in both.items()
            for what, values in (("log loss", (d["training"]["log_loss"] for d in told)),
                                 ("threshold", (d["threshold"] for d in told)))]  # fmt: skip


def store(found: dict) -> None:
    """Write the models and what is told of them beside the detectors."""
    for name, made in found.items():
        replace_file(FOLDER / f"{name}.onnx", lambda part, made=made: part.write_bytes(made["model"]))
    replace_text(FOLDER / "learned.json", json.dumps({n: made["told"] for n, made in found.items()}, indent=1) + "\n")
