"""User-supplied detectors: they fly beside ours, are logged, replayed and judged, and can hurt nobody."""

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
from cosim.log import open_log
from cosim.parts import load, with_detectors
from cosim.replay import replay
from cosim.report import flight_report
from cosim.scenario.user_parts import identified
from fdi import registry

DATA = Path(__file__).parents[1] / "data"
BLOCK = DATA / "template_detector.py"
ROD = "faults.0={target='elevator.left_inner.rod', kind='bias', bias_mm=12, start_s=2.5, path='monitor'}"
SHORT = ["duration_s=5", "elevator.feedback=measured", "detectors.enabled=['ofc_monitor']"]


@pytest.fixture(scope="module")
def flight(parity):
    """Return the log of a flight with two guests, a class and a block, and its result."""
    path = parity.parent / "flight.mcap"
    result = cosim.simulate(with_detectors(cosim.load_scenario("cruise", [*SHORT, ROD]), [parity, BLOCK]), log=path)
    registry.GUESTS.clear()
    return path, result.to_dict()


def lane(result, name):
    mine = (d for d in result["detectors"] if d["id"] == name)
    return next(d for d in mine if d["target"] in ("elevator.left_inner", "aircraft"))


def test_a_class_and_a_block_fly_and_are_judged_as_ours(flight):
    _, result = flight
    for name in ("parity", "template"):
        own = lane(result, name)
        assert own["isolated"]["class"] == "sensor" and 0.0 < own["detection_delay_s"] < 0.3 and not own["false_alarms"]
    assert result["notes"] == [] and lane(result, "parity")["step_us"] > 0.0
    assert len([d for d in result["detectors"] if d["id"] == "parity"]) == 2  # a lane per hydraulic actuator


def test_a_log_runs_no_code_and_its_other_detectors_replay(flight):
    found = replay(flight[0])
    assert found.exact and {d["id"] for d in found.detectors} == {"ofc_monitor"}
    assert "parity is a guest, and its code is not here: give it by --detector parity.py" in found.notes
    page = flight_report(flight[0], flight[0].with_suffix(".html")).read_text()
    rows = compare([flight[0]]).rows
    assert "parity" in page and rows[rows["id"] == "parity"]["outcome"].item() == "named"
    assert rows[rows["id"] == "parity"]["word"].item() == "designed"
    assert "parity" not in registry.GUESTS


def test_attached_code_replays_only_where_its_file_is_given(flight, parity):
    done = CliRunner().invoke(cli.app, ["replay", str(flight[0]), "--json"])
    assert done.exit_code == 0 and "parity is a guest" in done.stderr and "runs code" not in done.stderr
    done = CliRunner().invoke(cli.app, ["replay", str(flight[0]), "--detector", str(parity), "--json"])
    found = json.loads(done.stdout)
    assert done.exit_code == 0 and found["exact"] and "parity" in {d["id"] for d in found["detectors"]}


def test_given_their_files_they_replay_bit_for_bit_and_other_code_is_told(flight, parity, tmp_path):
    found = replay(flight[0], guests=[parity, BLOCK])
    assert found.exact and {d["id"] for d in found.detectors} == {"ofc_monitor", "parity", "template"}
    other = tmp_path / "parity.py"
    other.write_text(parity.read_text().replace("threshold=0.004", "threshold=0.009"))
    found = replay(flight[0], guests=[other], detectors=["parity"])
    assert found.exact  # parameters are the log's
    assert len(found.notes) == 1 and found.notes[0].startswith("parity is not the code that flew: digest ")
    other.write_text(parity.read_text().replace("abs(now[0] - now[1])", "0.5 * abs(now[0] - now[1])"))
    assert not replay(flight[0], guests=[other], detectors=["parity"]).exact


def test_a_guest_is_run_on_a_flight_that_it_was_not_part_of(flight, parity, tmp_path):
    bare = tmp_path / "bare.mcap"
    cosim.simulate(cosim.load_scenario("cruise", [*SHORT, ROD]), log=bare, timed=False)
    found = replay(bare, guests=[parity])
    own = lane({"detectors": found.detectors}, "parity")
    assert own["logged"] is None and own["replayed"]["isolated"] == lane(flight[1], "parity")["isolated"]
    assert own["replayed"]["detected_at_s"] == lane(flight[1], "parity")["detected_at_s"]
    rows = compare([bare], guests=[parity]).rows
    assert rows[rows["id"] == "parity"]["outcome"].item() == "named"


def test_a_scenario_names_a_file_beside_it_and_sets_parameters(parity, tmp_path):
    (parity.parent / "own.toml").write_text(
        (Path(cosim.__file__).parent / "scenarios" / "cruise.toml").read_text()
        + '\n[detectors.parity]\nfile = "parity.py"\nthreshold = 0.5\n'
    )
    scenario = cosim.load_scenario(parity.parent / "own.toml", ["duration_s=1", ROD.replace("2.5", "0.2")])
    assert scenario.detectors.enabled == (*registry.DEFAULT, "parity")
    assert "sha256" not in scenario.detectors.table("parity")  # to read a scenario is to run nothing
    scenario = identified(scenario)
    assert scenario.detectors.table("parity")["sha256"] == load(parity).sha256
    result = cosim.simulate(scenario, timed=False).to_dict()
    assert lane(result, "parity")["alarm"] is False and lane(result, "parity")["r_max_after"] < 0.1
    with pytest.raises(ScenarioError, match=r"detectors.other.file = nowhere.py: no such file"):
        cosim.load_scenario("cruise", ["detectors.other.file=nowhere.py"])
    with pytest.raises(ScenarioError, match=r"detectors.parity.thresh = 1.0: no such parameter; allowed: limit_s, arm"):
        cosim.simulate(cosim.load_scenario(parity.parent / "own.toml", ["duration_s=1", "detectors.parity.thresh=1"]))
    (tmp_path / "empty.py").write_text("x = 1\n")
    with pytest.raises(CosimError, match="holds no detector; allowed: one class"):
        load(tmp_path / "empty.py")
    (tmp_path / "broken.py").write_text("import nothing_of_the_kind\n")
    with pytest.raises(CosimError, match=r"does not run: ModuleNotFoundError: .* \(broken.py:1\)"):
        load(tmp_path / "broken.py")
    assert load(parity).sha256 != (parity.write_text(parity.read_text() + "# changed\n") and load(parity).sha256)
    with pytest.raises(CosimError, match="its digest differs"):
        cosim.simulate(scenario, timed=False)
    meant = tmp_path / "meant.toml"
    meant.write_text(scenario.expanded_toml())
    with pytest.raises(ScenarioError, match=r"its digest differs. Read it, then remove or renew sha256"):
        cosim.simulate(meant)


def test_the_command_line_flies_replays_and_says_so(parity, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["run", "own.toml", "--detector", str(parity), "--json"]
    text = cosim.load_scenario("cruise", ["duration_s=2"]).expanded_toml()
    Path("own.toml").write_text(text)
    done = CliRunner().invoke(cli.app, words)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert lane(found, "parity")["alarm"] is False and lane(found, "lpv_smo")
    assert Path(found["log"]).name == "own+detector=parity.mcap"
    again = CliRunner().invoke(cli.app, ["replay", found["log"], "--detector", str(parity), "--json"])
    assert again.exit_code == 0 and json.loads(again.stdout)["exact"]
    registry.GUESTS.clear()
    without = CliRunner().invoke(cli.app, ["replay", found["log"]])
    assert without.exit_code == 0 and "note: parity is a guest" in without.stderr
    refused = CliRunner().invoke(cli.app, ["run", "--detector", "nowhere.py"])
    assert refused.exit_code == 2 and "nowhere.py: no such file" in refused.stderr


def test_a_model_over_a_window_flies_from_scikit_learn_and_from_onnx(tmp_path):
    from skl2onnx import to_onnx
    from sklearn.linear_model import LogisticRegression

    rng = np.random.default_rng(1)
    x = rng.normal(size=(200, 40)).astype(np.float32)  # two signals, twenty samples
    made = LogisticRegression().fit(x, x[:, 0] > 0.0)
    (tmp_path / "line.onnx").write_bytes(to_onnx(made, x[:1], options={"zipmap": False}).SerializeToString())
    common = {"inputs": ("rod", "surface"), "classes": ("none", "ofc_liquid"), "technologies": ("hydraulic",),
              "window_s": 0.2, "sample_s": 0.01, "every_s": 0.05}  # fmt: skip
    cosim.register(cosim.window_model("ours", made, **common))
    cosim.register(cosim.window_model("theirs", "line.onnx", near=tmp_path, **common))
    scenario = cosim.load_scenario("cruise", ["duration_s=2", "detectors.enabled=['ours', 'theirs']",
                                              "elevator.feedback=measured"])  # fmt: skip
    result = cosim.simulate(scenario, log=tmp_path / "a.mcap", timed=False)
    assert result.extra["notes"] == []
    ours, theirs = (open_log(tmp_path / "a.mcap").frame(f"/detectors/{n}/left_inner") for n in ("ours", "theirs"))
    assert (ours["valid"] > 0.5).sum() > 300 and 0.0 < ours["r"].max() < 2.0
    np.testing.assert_allclose(ours["r"], theirs["r"], atol=1e-5)
    with pytest.raises(CosimError, match="no such file"):
        cosim.window_model("none", "nowhere.onnx", near=tmp_path, **common)


def test_campaign_workers_fly_it_and_its_rows_are_judged_without_its_code(parity, tmp_path):
    scenario = cosim.load_scenario("cruise", [*SHORT, "duration_s=4", ROD])
    (tmp_path / "base.toml").write_text(scenario.expanded_toml())
    (tmp_path / "own.toml").write_text('base = "base.toml"\n[grid]\nseed = [1000001, 1000002]\n')
    out = tmp_path / "rows"
    done = run_campaign(tmp_path / "own.toml", workers=1, out=out, guests=[parity])
    own = done.frame[done.frame["id"] == "parity"]
    assert done.failed == 0 and len(own) == 4 and own["alarm"].sum() == 2
    registry.GUESTS.clear()
    rows = compare([out]).rows
    assert set(rows[rows["id"] == "parity"]["outcome"]) == {"named"} and "parity" not in registry.GUESTS
    again = run_campaign(tmp_path / "own.toml", workers=1, out=out, guests=[parity], resume=True)
    assert again.resumed == 2
    other = tmp_path / "parity.py"
    other.write_text(parity.read_text() + "\n# other code\n")
    fresh = run_campaign(tmp_path / "own.toml", workers=0, out=tmp_path / "other", guests=[other])
    assert set(fresh.frame["run"]).isdisjoint(done.frame["run"])  # other code is another run


def test_a_folder_is_one_detector_and_its_modules_are_those_that_lie_there_now(parity, tmp_path):
    folder = tmp_path / "pack"
    folder.mkdir()
    (folder / "gains.py").write_text("ARM = 0.30\n")
    text = parity.read_text().replace("arm=0.30", "arm=ARM").replace("class ", "from .gains import ARM\n\n\nclass ", 1)
    (folder / "__init__.py").write_text(text)
    first = load(folder)
    assert first.params()["arm"][0] == 0.30
    (folder / "gains.py").write_text("ARM = 0.31\n")
    second = load(folder)
    assert second.params()["arm"][0] == 0.31 and second.sha256 != first.sha256
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=0.5"]), [folder])
    assert cosim.simulate(scenario, timed=False).extra["notes"] == []
    assert scenario.user_parts["detectors.parity.file"] == ("pack", second.sha256)
