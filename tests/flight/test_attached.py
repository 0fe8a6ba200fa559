"""A log holds the sources of a user's files: written out, it flies from any folder; nothing of it runs unasked."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli.commands import app
from cosim.errors import LogError, OutputError, ScenarioError
from cosim.log import open_log
from cosim.replay import log_schema, replay
from cosim.scenario import user_parts
from cosim.scenario.aircraft import load_aircraft

LAW = """
import json
from pathlib import Path
from .gain_of_mine import GAIN
share = json.loads(Path(__file__).with_name("data").joinpath("table.json").read_text())["share"]
Path(__file__).with_name(".ran").touch()

class Law:
    def __init__(self, dt, start):
        self.start = start

    def update(self, t, y, ask):
        return {"elevator": self.start.elevator + GAIN * share * min(t, 0.1)}
"""
runner = CliRunner()


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Return the log of a flight with a law of a user's, on an aircraft of a user's, whose files are gone."""
    home = tmp_path_factory.mktemp("theirs")
    (home / "law" / "data").mkdir(parents=True)
    (home / "law" / "__init__.py").write_text(LAW)
    (home / "law" / "gain_of_mine.py").write_text("GAIN = 0.1\n")
    (home / "law" / "data" / "table.json").write_text('{"share": 0.5}')
    shutil.copytree(load_aircraft().folder, home / "mine")
    (home / "mine" / "transport.xml").rename(home / "mine" / "mine.xml")
    keys = ["duration_s=0.5", f"law.file={home / 'law'}", f"flight.aircraft={home / 'mine'}", "detectors.enabled=[]"]
    log = tmp_path_factory.mktemp("logs") / "flight.mcap"
    cosim.simulate(cosim.load_scenario("cruise", keys), log=log, timed=False)
    assert str(home).encode() not in b"".join(open_log(log).attachments.values())
    shutil.rmtree(home)
    return log


def test_a_log_flies_again_from_another_folder(flown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = runner.invoke(app, ["info", str(flown), "--scenario", "-o", "again"])
    assert done.exit_code == 0 and "cosim run again/scenario.toml" in done.stdout, done.output
    assert not list(Path().rglob(".ran"))
    os.makedirs("elsewhere")
    monkeypatch.chdir("elsewhere")
    cosim.simulate("../again/scenario.toml", log="same.mcap", timed=False)
    one, other = open_log(flown), open_log("same.mcap")
    assert one.attachments.keys() == other.attachments.keys()
    assert all(one.attachments[name] == other.attachments[name] for name in one.attachments)
    np.testing.assert_array_equal(one.array("/truth/aircraft"), other.array("/truth/aircraft"))
    np.testing.assert_array_equal(one.array("/law"), other.array("/law"))
    assert Path("same.mcap").read_bytes() == flown.read_bytes()


def test_to_look_at_a_log_runs_nothing_of_it(flown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "law.py").write_text("raise SystemExit('ran')")
    for words in (["info"], ["info", "--scenario"], ["replay"], ["report", "-o", "x.html"], ["compare"]):
        done = runner.invoke(app, [words[0], str(flown), *words[1:]])
        assert "ran" not in done.output.split() and "runs code" not in done.output, done.output
    assert replay(flown).exact


def test_a_changed_source_is_not_the_flight_that_was(flown, tmp_path):
    log = open_log(flown)
    user_parts.write(log_schema.scenario_tables(log), log.attachments, tmp_path / "x")
    (tmp_path / "x" / "law" / "law" / "gain_of_mine.py").write_text("GAIN = 0.2\n")
    with pytest.raises(ScenarioError, match="is not the file that the scenario means: its digest differs"):
        cosim.simulate(tmp_path / "x" / "scenario.toml")


def test_a_folder_that_holds_something_is_left_alone(flown, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    done = runner.invoke(app, ["info", str(flown), "--scenario", "-o", str(tmp_path)])
    assert done.exit_code == 2 and "holds something" in done.stderr and os.listdir(tmp_path) == ["mine.txt"]


OUT = ("../x", "law/../../x", "/etc/x", "law/", "x", "law//x", "law/.x", "law/__pycache__/x", "C:/x/y", "a\\b/c")


@pytest.mark.parametrize("name", OUT)
def test_no_attachment_leads_out_of_the_folder(flown, tmp_path, name):
    log = open_log(flown)
    held = {**log.attachments, f"user_files/{name}": b""}
    with pytest.raises((LogError, OutputError), match="is damaged: attachment"):
        user_parts.write(log_schema.scenario_tables(log), held, tmp_path / "x")
    assert not os.path.exists(tmp_path / "law.py")


def test_an_aircraft_that_is_not_the_one_that_flew_is_refused(flown):
    log = open_log(flown)
    tables = log_schema.scenario_tables(log)
    tables["flight"]["aircraft_sha256"] = "0" * 64
    with pytest.raises(LogError, match="its aircraft is not the one that flew"):
        user_parts.bring_aircraft(tables, log.attachments, "log")


def test_what_is_attached_ends_at_a_size(tmp_path, monkeypatch):
    (tmp_path / "law.py").write_text(LAW.replace("from .gain_of_mine import GAIN", "GAIN = 0.1"))
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "table.json").write_text('{"share": 0.5}' + " " * 5000)
    monkeypatch.setattr(user_parts, "MOST", 4000)
    scenario = cosim.load_scenario("cruise", [f"law.file={tmp_path / 'law.py'}"])
    assert list(user_parts.sources(scenario)) == ["user_files/law/law.py"]
