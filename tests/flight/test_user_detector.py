"""User detectors fly beside ours, are logged, replayed, judged and compared; `cosim check` asks for their contract."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cosim
from cosim.campaign.engine import run_campaign
from cosim.cli import commands as cli
from cosim.compare import compare
from cosim.errors import CosimError, ScenarioError
from cosim.flight.check import check
from cosim.judge import coverage
from cosim.log import open_log
from cosim.parts import load, with_detectors
from cosim.parts.detector import record_of
from cosim.replay import replay
from cosim.report import flight_report
from cosim.scenario.user_parts import identified
from fdi import registry

DATA = Path(__file__).parents[1] / "data"
BLOCK = DATA / "template_detector.py"
ROD = "faults.0={target='elevator.left_inner.rod', kind='bias', bias_mm=12, start_s=2.5, path='monitor'}"
SHORT = ["duration_s=5", "elevator.feedback=measured", "detectors.enabled=['ofc_monitor']"]
runner = CliRunner()


@pytest.fixture(scope="module")
def flight(parity):
    """Return the log of a flight with a class and a block of a user's, and its result; neither is known after it."""
    path = parity.parent / "flight.mcap"
    result = cosim.simulate(with_detectors(cosim.load_scenario("cruise", [*SHORT, ROD]), [parity, BLOCK]), log=path)
    registry.USER_DETECTORS.clear()
    return path, result.to_dict()


def lane(result, name):
    mine = (d for d in result["detectors"] if d["id"] == name)
    return next(d for d in mine if d["target"] in ("elevator.left_inner", "aircraft"))


def outcome(rows):
    return rows[rows["id"] == "parity"]["outcome"].unique().tolist()


def test_a_class_and_a_block_fly_and_are_judged_as_ours(flight):
    _, result = flight
    for name in ("parity", "template"):
        own = lane(result, name)
        assert own["isolated"]["class"] == "sensor" and 0.0 < own["detection_delay_s"] < 0.3 and not own["false_alarms"]
        assert 0.0 < own["step_us"] < (4.0 if name == "template" else 40.0)  # with room for a loaded machine
    assert result["notes"] == [] and len([d for d in result["detectors"] if d["id"] == "parity"]) == 2


def test_a_log_runs_no_code_and_its_other_detectors_replay(flight):
    found = replay(flight[0])
    assert found.exact and {d["id"] for d in found.detectors} == {"ofc_monitor"}
    assert any("its code is not here: give it by --detector parity.py" in note for note in found.notes)
    assert "parity" in flight_report(flight[0], flight[0].with_suffix(".html")).read_text()
    rows = compare([flight[0]]).rows
    assert outcome(rows) == ["named"] and rows[rows["id"] == "parity"]["word"].item() == "designed"
    assert "parity" not in registry.USER_DETECTORS


def test_given_their_files_they_replay_bit_for_bit_and_other_code_is_told(flight, parity, tmp_path):
    found = replay(flight[0], user_detectors=[parity, BLOCK])
    assert found.exact and {d["id"] for d in found.detectors} == {"ofc_monitor", "parity", "template"}
    other = tmp_path / "parity.py"
    other.write_text(parity.read_text().replace("abs(now[0] - now[1])", "0.5 * abs(now[0] - now[1])"))
    found = replay(flight[0], user_detectors=[other], detectors=["parity"])
    assert not found.exact and found.notes[0].startswith("parity is not the code that flew: digest ")


def test_one_is_run_on_a_flight_that_it_was_not_part_of(flight, parity, tmp_path):
    bare = tmp_path / "bare.mcap"
    cosim.simulate(cosim.load_scenario("cruise", [*SHORT, ROD]), log=bare, timed=False)
    own = lane({"detectors": replay(bare, user_detectors=[parity]).detectors}, "parity")
    assert own["logged"] is None and own["replayed"]["isolated"] == lane(flight[1], "parity")["isolated"]
    assert outcome(compare([bare], user_detectors=[parity]).rows) == ["named"]


def test_a_scenario_names_a_file_beside_it_its_digest_and_parameters(parity, tmp_path):
    own = parity.parent / "own.toml"
    cruise = (Path(cosim.__file__).parent / "scenarios" / "cruise.toml").read_text()
    own.write_text(cruise + '\n[detectors.parity]\nfile = "parity.py"\nthreshold = 0.5\n')
    scenario = cosim.load_scenario(own, ["duration_s=0.2"])
    assert "parity" in scenario.detectors.enabled
    assert "sha256" not in scenario.detectors.table("parity")  # to read a scenario is to run nothing
    scenario = identified(scenario)
    assert scenario.detectors.table("parity")["sha256"] == load(parity).sha256
    assert lane(cosim.simulate(scenario, timed=False).to_dict(), "parity")["alarm"] is False
    with pytest.raises(ScenarioError, match=r"detectors.other.file = nowhere.py: no such file"):
        cosim.load_scenario("cruise", ["detectors.other.file=nowhere.py"])
    with pytest.raises(ScenarioError, match=r"detectors.parity.thresh = 1.0: no such parameter; allowed: limit_s, arm"):
        cosim.simulate(cosim.load_scenario(own, ["duration_s=0.2", "detectors.parity.thresh=1"]))
    parity.write_text(parity.read_text() + "# changed\n")
    registry.USER_DETECTORS.clear()
    with pytest.raises(CosimError, match="its digest differs"):
        cosim.simulate(scenario, timed=False)
    parity.write_text(parity.read_text().removesuffix("# changed\n"))


def test_the_command_line_flies_replays_and_says_so(parity, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.toml").write_text(cosim.load_scenario("cruise", ["duration_s=1"]).expanded_toml())
    found = json.loads(runner.invoke(cli.app, ["run", "own.toml", "--detector", str(parity), "--json"]).stdout)
    assert lane(found, "parity")["alarm"] is False and lane(found, "lpv_smo")
    assert Path(found["log"]).name == "own+detector=parity.mcap"
    registry.USER_DETECTORS.clear()
    without = runner.invoke(cli.app, ["replay", found["log"]])
    assert without.exit_code == 0 and "its code is not here" in without.stderr and "runs code" not in without.stderr
    again = runner.invoke(cli.app, ["replay", found["log"], "--detector", str(parity), "--json"])
    assert json.loads(again.stdout)["exact"] and "parity" in {d["id"] for d in json.loads(again.stdout)["detectors"]}
    refused = runner.invoke(cli.app, ["run", "--detector", "nowhere.py"])
    assert refused.exit_code == 2 and "nowhere.py: no such file" in refused.stderr


def test_campaign_workers_fly_it_and_its_rows_are_judged_without_its_code(parity, tmp_path):
    scenario = cosim.load_scenario("cruise", [*SHORT, "duration_s=4", ROD])
    (tmp_path / "base.toml").write_text(scenario.expanded_toml())
    (tmp_path / "own.toml").write_text('base = "base.toml"\n[grid]\nseed = [1000001, 1000002]\n')
    out = tmp_path / "rows"
    done = run_campaign(tmp_path / "own.toml", workers=1, out=out, user_detectors=[parity])
    assert done.failed == 0 and done.frame[done.frame["id"] == "parity"]["alarm"].sum() == 2
    registry.USER_DETECTORS.clear()
    assert outcome(compare([out]).rows) == ["named"] and "parity" not in registry.USER_DETECTORS
    assert run_campaign(tmp_path / "own.toml", workers=1, out=out, user_detectors=[parity], resume=True).resumed == 2
    other = tmp_path / "parity.py"
    other.write_text(parity.read_text() + "\n# other code\n")
    fresh = run_campaign(tmp_path / "own.toml", workers=0, out=tmp_path / "other", user_detectors=[other])
    assert set(fresh.frame["run"]).isdisjoint(done.frame["run"])  # other code is another run


def test_a_folder_is_one_detector_and_its_modules_are_those_that_lie_there_now(parity, tmp_path):
    folder = tmp_path / "pack"
    folder.mkdir()
    text = parity.read_text().replace("arm=0.30", "arm=ARM").replace("class ", "from .gains import ARM\n\n\nclass ", 1)
    (folder / "__init__.py").write_text(text)
    digests = []
    for arm in (0.30, 0.31):
        (folder / "gains.py").write_text(f"ARM = {arm}\n")
        assert load(folder).params()["arm"][0] == arm
        digests.append(load(folder).sha256)
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=0.5"]), [folder])
    assert cosim.simulate(scenario, timed=False).extra["notes"] == [] and digests[0] != digests[1]
    assert scenario.user_parts["detectors.parity.file"] == ("pack", digests[1])


def test_a_model_over_a_window_flies_from_scikit_learn_and_from_onnx(tmp_path):
    from onnxruntime import InferenceSession
    from skl2onnx import to_onnx
    from sklearn.linear_model import LogisticRegression

    x = np.random.default_rng(1).normal(size=(200, 40)).astype(np.float32)  # two signals, twenty samples
    made = LogisticRegression().fit(x, x[:, 0] > 0.0)
    session = InferenceSession(to_onnx(made, x[:1], options={"zipmap": False}).SerializeToString())
    common = {"inputs": ("rod", "surface"), "classes": ("none", "ofc_liquid"), "technologies": ("hydraulic",),
              "window_s": 0.2, "sample_s": 0.01, "every_s": 0.05}  # fmt: skip

    def emptied(window):
        x = window.copy()
        window[:] = 0.0
        return x

    cosim.register(cosim.window_model("ours", made, features=emptied, **common))
    common["classes"] = np.array(common["classes"])  # as a fitted model has them
    cosim.register(cosim.window_model("theirs", lambda x: session.run(None, {"X": x})[-1], **common))
    keys = ["duration_s=2", "detectors.enabled=['ours', 'theirs']", "elevator.feedback=measured"]
    assert cosim.simulate(cosim.load_scenario("cruise", keys), log=tmp_path / "a.mcap").extra["notes"] == []
    ours, theirs = (open_log(tmp_path / "a.mcap").frame(f"/detectors/{n}/left_inner") for n in ("ours", "theirs"))
    assert (ours["valid"] > 0.5).sum() > 300 and 0.0 < ours["r"].max() < 2.0
    np.testing.assert_allclose(ours["r"], theirs["r"], atol=1e-5)
    with pytest.raises(CosimError, match='"none" first'):
        cosim.window_model("other", made, **{**common, "classes": ("ofc_liquid",)})


FLIGHT = "__import__('sys')._getframe(2).f_locals['given'][0]"  # of the caller's caller: every tick of the flight
NOW = "        now = (y.rod"


@pytest.mark.parametrize(
    ("code", "bad"),
    [
        (lambda parity: parity, {}),
        (lambda parity: BLOCK.read_text(), {}),
        (lambda parity: (DATA / "user_parts/counting.py").read_text(),
         {"deterministic": "two runs differ", "live as in replay": "tick by tick"}),
        (lambda parity: parity.replace(NOW, f"        1 / (t < 2.0)\n{NOW}"),
         {"runs": "at 2.000 s: ZeroDivisionError"}),
        (lambda parity: parity.replace(NOW, f"{NOW} + 1e-9 * {FLIGHT}[-1, 0]"),
         {"causal": "depends on what is measured from", "live as in replay": "tick by tick"}),
    ],
    ids=("class", "block", "random", "raises", "future"),
)  # fmt: skip
def test_check_says_for_each_question_whether_it_is_kept(parity, tmp_path, code, bad):
    (tmp_path / "own.py").write_text(code(parity.read_text()))
    found = check(tmp_path / "own.py")
    wrong = {line["question"]: line["answer"] for line in found["checks"] if line["result"] == "bad"}
    assert found["keeps"] == (not bad) and bad.keys() <= wrong.keys()
    assert all(bad[question] in answer for question, answer in wrong.items() if question in bad)
    asked = [line["question"] for line in found["checks"]]
    every = ["runs", "deterministic", "causal", "live as in replay", "lost samples"]
    assert asked == (["runs"] if "runs" in bad else every) and 15 <= len(parity.read_text().splitlines()) <= 40


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"id": "Ofc Monitor"}, "id = 'Ofc Monitor'; allowed: lower-case letters"),
        ({"level": "global"}, "level = 'global'; allowed: local, aircraft"),
        ({"technologies": ("pneumatic",)}, "allowed: hydraulic, ema, simple"),
        ({"inputs": ("rodd",)}, "'rodd' is no signal. Did you mean 'rod'?"),
        ({"inputs": ("current",)}, "'current' is of ema only"),
        ({"level": "aircraft"}, "Name the segment"),
        ({"designed_for": ("ofc_fluid",)}, "'ofc_fluid' is no kind of fault"),
        ({"every": 0}, "every = 0"),
        ({"estimates": "speed"}, "estimates = 'speed'"),
        ({"__init__": lambda self: None}, "__init__ does not take dt"),
    ],
)
def test_a_class_that_is_no_detector_is_refused_with_what_is_allowed(change, said):
    plain = {"id": "own", "level": "local", "technologies": ("hydraulic",), "inputs": ("rod",),
             "update": lambda self, t, y: None, "__init__": lambda self, dt: None}  # fmt: skip
    with pytest.raises(CosimError) as wrong:
        cosim.register(type("Own", (), {**plain, **change}))
    assert said in str(wrong.value)


def test_what_one_declares_is_expected_and_the_rest_is_not_declared():
    own = record_of(type("Own", (), {
        "id": "own", "level": "local", "technologies": ("hydraulic",), "inputs": ("rod",), "blind": ("rudder",),
        "designed_for": ("ofc_liquid",), "may_see": {"hydraulic.rod": "jam_liquid"}, "estimates": "rod",
        "update": lambda self, t, y: None, "__init__": lambda self, dt: None,
    }))  # fmt: skip
    registry.tell(own)
    cases = ("hydraulic.ofc_liquid@command", "hydraulic.rod", "rudder", "engine")
    assert [coverage.expected("own", case) for case in cases] == ["designed", "may", "blind", "undeclared"]
    assert own.designed_for["hydraulic.ofc_liquid"] == ("ofc_liquid", "ambiguous")
    assert (own.estimates[0].of, own.estimates[0].unit) == ("rod", "m")
