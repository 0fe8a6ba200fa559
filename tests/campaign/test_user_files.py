"""Files of a user's in campaign, data set and score: a row is never of another file than the one that is there."""

import shutil
import textwrap

import fmu_of_hydraulic as rig
import numpy as np
import pytest
import technologies

import cosim
from cosim.campaign.dataset import make
from cosim.campaign.run import run_campaign
from cosim.errors import CampaignError, OutputError
from cosim.scenario.aircraft import load_aircraft
from cosim.scenario.override import apply
from cosim.scenario.toml import dumps, inline
from cosim.scenario.user_parts import identified
from cosim.texts import from_json


@pytest.fixture(autouse=True)
def forget():
    yield
    technologies.forget()


DETECTOR = """
from .threshold import LIMIT
import numpy as np
from pathlib import Path
weights = np.load(Path(__file__).with_name("weights.npy"))

class Own:
    id, level, technologies, inputs = "own", "local", ("hydraulic",), ("rod",)
    designed_for = ("ofc_liquid",)

    def __init__(self, dt):
        pass

    def update(self, t, y):
        r = abs(y.rod) * float(weights[0]) / LIMIT
        return {"r": r, "alarm": r > 1.0}
"""
LAW = """
import json
from pathlib import Path
from .gain_of_mine import GAIN
table = json.loads(Path(__file__).with_name("table.json").read_text())

class Law:
    def __init__(self, dt, start):
        self.start = start

    def update(self, t, y, ask):
        return {"elevator": self.start.elevator + GAIN * table["share"] * min(t, 0.1)}
"""
ACTUATOR = """
import numpy as np
from actuators.block import dtype
from .lag_of_mine import TAU

PARAMS = dtype([("tau", "f8", "s")])
INPUTS = dtype([(name, "f8") for name in ("command", "hm0", "hmd", "f_cmd", "s_cmd")])
STATE = dtype([("delta", "f8", "rad")])
OUTPUTS = ("delta",)

def params(tau=TAU):
    return np.full(1, tau).view(PARAMS)

def init_at(p, delta, hm0, hmd):
    return np.array(delta, float).reshape(-1).view(STATE)

def rollout(x, u, p, dt):
    for i, own in enumerate(u[:, 0]):
        x[i].delta += dt / p[i].tau * (own.command - x[i].delta)
"""
MODEL = """
import cosim
Own = cosim.window_model("own", "line.onnx", near=__file__, inputs=("rod", "surface"), classes=("none", "ofc_liquid"),
                         technologies=("hydraulic",), window_s=0.02, sample_s=0.01, every_s=0.02)
"""


def text(path, body):
    path.parent.mkdir(exist_ok=True)
    path.write_text(textwrap.dedent(body))
    return path


def detector(folder):
    """Write a detector; return (keys of a scenario, what can be edited: path and new content)."""
    text(folder / "own/__init__.py", DETECTOR)
    text(folder / "own/threshold.py", "LIMIT = 0.01\n")
    np.save(folder / "own/weights.npy", [1.0])
    keys = {"detectors.own.file": "own", "detectors.enabled": ["own"]}
    edits = {"__init__.py": DETECTOR + "\n# another", "threshold.py": "LIMIT = 0.02\n", "weights.npy": np.array([2.0])}
    return keys, {f"own/{name}": new for name, new in edits.items()}


def law(folder):
    text(folder / "law/__init__.py", LAW)
    text(folder / "law/gain_of_mine.py", "GAIN = 0.1\n")
    text(folder / "law/table.json", '{"share": 0.5}')
    edits = {"__init__.py": LAW.replace("0.1)", "0.2)"), "gain_of_mine.py": "GAIN = 0.2\n"}
    edits["table.json"] = '{"share": 0.7}'
    return {"law.file": "law", "detectors.enabled": []}, {f"law/{name}": new for name, new in edits.items()}


def actuator(folder):
    text(folder / "lag/__init__.py", ACTUATOR)
    text(folder / "lag/lag_of_mine.py", "TAU = 0.1\n")
    keys = {"actuators.lag.file": "lag", "elevator.left_inner": "lag", "detectors.enabled": []}
    return keys, {"lag/__init__.py": ACTUATOR + "\n# another", "lag/lag_of_mine.py": "TAU = 0.2\n"}


def fmu(folder):
    if rig.COMPILER is None:
        pytest.skip("no C compiler on this machine")
    path = rig.build(folder, 2)
    keys = {f"actuators.rig.{key}": value for key, value in {"fmu": path.name, **rig.MAP}.items()}
    return {**keys, "elevator.left_inner": "rig", "detectors.enabled": []}, {path.name: path.read_bytes() + b"\0"}


def model(folder):
    from skl2onnx import to_onnx
    from sklearn.linear_model import LogisticRegression

    x = np.random.default_rng(1).normal(size=(50, 4)).astype(np.float32)

    def made(y):
        fitted = LogisticRegression().fit(x, y)
        return to_onnx(fitted, x[:1], options={"zipmap": False}).SerializeToString()

    text(folder / "own/__init__.py", MODEL)
    (folder / "own/line.onnx").write_bytes(made(x[:, 0] > 0.0))
    return {"detectors.own.file": "own", "detectors.enabled": ["own"]}, {"own/line.onnx": made(x[:, 1] > 0.0)}


def aircraft(folder):
    shutil.copytree(load_aircraft().folder, folder / "mine")
    (folder / "mine" / "transport.xml").rename(folder / "mine" / "mine.xml")
    record = (folder / "mine" / "aircraft.toml").read_text()
    xml = (folder / "mine" / "mine.xml").read_text()
    keys = {"flight.aircraft": "mine", "detectors.enabled": []}
    return keys, {"mine/aircraft.toml": record + "\n# another", "mine/mine.xml": xml + "<!-- another -->"}


def table(folder):
    text(folder / "stick.csv", "time_s,stick\n0,0\n1,0.1\n")
    keys = {"manoeuvre.kind": "inputs", "manoeuvre.file": "stick.csv", "detectors.enabled": []}
    return keys, {"stick.csv": "time_s,stick\n0,0\n1,0.2\n"}


KINDS = (detector, law, actuator, fmu, model, aircraft, table)


def edit(path, new):
    if isinstance(new, np.ndarray):
        np.save(path, new)
    else:
        path.write_bytes(new if isinstance(new, bytes) else textwrap.dedent(new).encode())


def campaign(folder, keys):
    """Write a base scenario with the keys, and a campaign of one flight of it."""
    said = {"duration_s": 0.05, "elevator.feedback": "measured", **keys}
    named = {k: v for k, v in said.items() if k != "manoeuvre.file"}
    base = cosim.load_scenario("cruise", ["duration_s=0.05"]).model_dump(mode="python", exclude_none=True)
    base = {k: v for k, v in base.items() if k in ("title", "flight", "manoeuvre")}
    tables = apply(base, [f"{k}={inline(v)}" for k, v in named.items()])
    if "manoeuvre.file" in said:
        tables["manoeuvre"]["file"] = said["manoeuvre.file"]
    (folder / "base.toml").write_text(dumps(tables))
    return text(folder / "own.toml", 'base = "base.toml"\n[grid]\nseed = [1000001]\n')


def told(out):
    return from_json((out / "manifest.json").read_bytes(), place="manifest")["user_files"]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_an_edited_file_never_keeps_an_old_row_of_a_campaign(kind, tmp_path):
    keys, edits = kind(tmp_path)
    path, out = campaign(tmp_path, keys), tmp_path / "rows"
    done = run_campaign(path, workers=0, out=out)
    assert done.failed == 0, done.frame["error"].tolist()
    assert run_campaign(path, workers=0, out=out, resume=True).resumed == 1
    runs = {done.frame["run"][0]}
    for name, new in edits.items():
        edit(tmp_path / name, new)
        if kind is not table:  # its numbers stand in the scenario: it is another scenario
            with pytest.raises(CampaignError, match=r"is not the file that flew: digest \w{12} here, \w{12} there"):
                run_campaign(path, workers=0, out=out, resume=True)
        again = run_campaign(path, workers=0, out=out, anew=True)
        assert again.resumed == 0 and again.failed == 0 and not runs & set(again.frame["run"])
        runs |= set(again.frame["run"])
        assert str(tmp_path) not in str(told(out)) and len(told(out)) == (kind is not table)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_an_edited_file_never_keeps_an_old_flight_of_a_data_set(kind, tmp_path):
    keys, edits = kind(tmp_path)
    path, out = campaign(tmp_path, keys), tmp_path / "set"
    make(path, out, workers=0, signals=["q"])
    make(path, out, workers=0, signals=["q"])
    old = {p.name for p in (out / "flights").iterdir()}
    name, new = list(edits.items())[-1]
    edit(tmp_path / name, new)
    with pytest.raises(OutputError, match=r"is not the file that flew|holds something else"):
        make(path, out, workers=0, signals=["q"])
    if kind is table:
        return
    make(path, out, workers=0, signals=["q"], anew=True)
    left = {p.name for p in (out / "flights").iterdir()}
    assert len(left) == 1 and not left & old
    make(path, out, workers=0, signals=["q"])


def test_a_detector_in_set_has_its_digest_in_the_run(tmp_path):
    detector(tmp_path)
    path = text(tmp_path / "c.toml", """
        base = "cruise"
        set = { duration_s = 0.05, "detectors.own.file" = "own", "elevator.feedback" = "measured" }
        """)  # fmt: skip
    first = run_campaign(path, workers=0, out=tmp_path / "rows").frame["run"][0]
    edit(tmp_path / "own/threshold.py", "LIMIT = 0.5\n")
    assert run_campaign(path, workers=0, out=tmp_path / "rows", anew=True).frame["run"][0] != first


def test_a_scenario_says_which_file_it_means_on_every_machine(tmp_path):
    (tmp_path / "x").mkdir()
    law(tmp_path / "x")
    shutil.copytree(tmp_path / "x", tmp_path / "y")
    here, there = (
        identified(cosim.load_scenario("cruise", ["duration_s=0.05", f"law.file={tmp_path / name / 'law'}"]))
        for name in "xy"
    )
    assert here.portable_toml() == there.portable_toml() and str(tmp_path) not in here.portable_toml()
    assert here.user_parts["law.file"].name == "law" and len(here.law.sha256) == 64
