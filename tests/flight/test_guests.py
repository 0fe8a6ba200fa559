"""Detectors that somebody else wrote: they fly beside ours, are logged, replayed and judged, and can hurt nobody."""

import json
import os
import runpy
import signal
import subprocess
import sys
import textwrap
import time
import timeit
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cosim
from actuators.sources import closure
from cosim.campaign.run import run_campaign
from cosim.cli import commands as cli
from cosim.compare import compare
from cosim.errors import CosimError, ScenarioError
from cosim.flight.build import build
from cosim.flight.guests import load, with_detectors
from cosim.flight.guests.check import check
from cosim.flight.guests.contract import record
from cosim.flight.guests.new import texts
from cosim.flight.guests.plain import NONSENSE, RAISED, SLOW
from cosim.judge import coverage
from cosim.judge.naming import outcome
from cosim.log import open_log
from cosim.replay import door, replay
from cosim.report import flight_report
from fdi import registry

DATA = Path(__file__).parents[1] / "data"
BAD = DATA / "guests" / "misbehaving.py"
BLOCK = DATA / "template_detector.py"
ROD = "faults.0={target='elevator.left_inner.rod', kind='bias', bias_mm=12, start_s=2.5, path='monitor'}"
SHORT = ["duration_s=5", "elevator.feedback=measured", "detectors.enabled=['ofc_monitor']"]


@pytest.fixture(scope="module")
def parity(tmp_path_factory):
    """Return the file that `cosim new detector parity` writes."""
    folder = tmp_path_factory.mktemp("guests")
    for name, text in texts("parity").items():
        (folder / name).write_text(text)
    return folder / "parity.py"


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


def test_the_log_tells_of_them_without_their_code_or_a_folder(flight, parity):
    path, _ = flight
    log = open_log(path)
    entry = next(d for d in json.loads(log.attachments["detectors.json"]) if d["id"] == "parity")
    assert entry["guest"]["file"] == "parity.py" and entry["guest"]["sha256"] == load(parity).sha256
    assert str(parity.parent).encode() not in b"".join(log.attachments.values())
    assert log.topics["/detectors/parity/left_inner"].fields[:5] == ("r", "alarm", "verdict", "culprit", "valid")


def test_a_log_runs_no_code_and_its_other_detectors_replay(flight):
    found = replay(flight[0])
    assert found.exact and {d["id"] for d in found.detectors} == {"ofc_monitor"}
    assert "parity is a guest, and its code is not here: give it by --detector parity.py" in found.notes
    page = flight_report(flight[0], flight[0].with_suffix(".html")).read_text()
    rows = compare([flight[0]]).rows
    assert "parity" in page and rows[rows["id"] == "parity"]["outcome"].item() == "named"
    assert rows[rows["id"] == "parity"]["word"].item() == "designed"
    assert "parity" not in registry.GUESTS


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sha256": "x"}, "guest.sha256"),
        ({"culprits": []}, "guest.culprits"),
        ({"record": {"summary": 1}}, "guest.record.summary"),
        ({"form": "eval"}, "guest.form"),
    ],
)
def test_what_a_log_tells_of_a_guest_is_checked_at_the_door(flight, change, said):
    log = open_log(flight[0])
    entries = json.loads(log.attachments["detectors.json"])
    guest = next(d for d in entries if d["id"] == "parity")["guest"]
    guest |= {k: {**guest[k], **v} if isinstance(v, dict) else v for k, v in change.items()}
    log.attachments["detectors.json"] = json.dumps(entries).encode()
    with pytest.raises(CosimError, match=said):
        door.detectors(log)


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


def flown(how, tmp_path):
    """Return (result, log) of a flight with the misbehaving guest."""
    own = [f"detectors.misbehaving.{k}" for k in (f"file={BAD}", f"how={how}", "limit_s=0.1")]
    chosen = "detectors.enabled=['ofc_monitor', 'misbehaving']"
    path = tmp_path / f"{how}.mcap"
    scenario = cosim.load_scenario("cruise", [*SHORT, "duration_s=2", chosen, *own])
    return cosim.simulate(scenario, log=path, timed=False), open_log(path)


@pytest.fixture(scope="module")
def behaved(tmp_path_factory):
    """Return the log of the same flight in which the guest does nothing wrong."""
    result, log = flown(0, tmp_path_factory.mktemp("behaved"))
    assert result.extra["notes"] == []
    return log


@pytest.mark.parametrize(
    ("how", "status", "said"),
    [
        (1, RAISED, "is dropped on left_outer at 1.000 s: ZeroDivisionError: on purpose (misbehaving.py:33)"),
        (3, NONSENSE, "is dropped on left_outer at 1.000 s: verdict 'gremlins'; allowed: none, ofc_liquid"),
        (4, NONSENSE, "is dropped on left_outer at 1.000 s: update returned 'an alarm'; allowed: a dict of"),
        (5, RAISED, "is dropped on left_outer at 1.000 s: AttributeError: can't set attribute"),
        (6, SLOW, "is dropped on left_outer at 1.000 s: a step took 0."),
        (7, RAISED, "is dropped on left_outer at 1.000 s: SystemExit: 3"),
        (8, NONSENSE, "is dropped on left_outer at 1.000 s: alarm = 'perhaps' is no number"),
        (11, RAISED, "is dropped on left_outer at 1.000 s: GeneratorExit: on purpose"),
        (12, RAISED, "is dropped on left_outer at 1.000 s: Mute (misbehaving.py:"),
        (13, NONSENSE, "is dropped on left_outer at 1.000 s: r = ["),
    ],
)
def test_what_misbehaves_is_dropped_with_a_line_and_touches_nothing(how, status, said, behaved, tmp_path):
    result, log = flown(how, tmp_path)
    assert result.status == "completed" and len(result.extra["notes"]) == 1 and said in result.extra["notes"][0]
    own = log.frame("/detectors/misbehaving/left_inner")
    assert log.complete and len(own) == 400
    assert own["status"].iloc[198] == 0.0 and own["status"].iloc[-1] == status and own["valid"].iloc[-1] == 0.0
    assert json.loads(log.result["notes"]) == result.extra["notes"]
    again = replay(tmp_path / f"{how}.mcap", guests=[BAD])
    assert again.exact and bool(again.skipped) == (status == SLOW)
    for topic in ("/detectors/ofc_monitor/left_inner", "/truth/aircraft", "/sensors/left_inner", "/law"):
        assert (behaved.array(topic).view(np.int64) == log.array(topic).view(np.int64)).all(), topic


RAISES = """

def rollout(x, u, p, dt, log=None):
    if u["rod"].max() > -9.0:
        raise RuntimeError("on purpose")
"""


def test_a_block_in_plain_python_that_raises_says_nothing_and_one_that_does_not_compile_is_refused(tmp_path):
    own = tmp_path / "own.py"
    own.write_text(BLOCK.read_text() + RAISES)
    path = tmp_path / "raises.mcap"
    result = cosim.simulate(with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=1"]), [own]), log=path)
    line = len(own.read_text().splitlines())
    assert result.extra["notes"] == [f"template says nothing where it raises RuntimeError: on purpose (own.py:{line})"]
    assert open_log(path).complete and not open_log(path).array("/detectors/template/left_inner").any()
    assert replay(path, guests=[own]).exact
    own.write_text(BLOCK.read_text().replace("x.culprit = x.alarm", "x.nowhere = x.alarm"))
    with pytest.raises(CosimError, match=r"own\.py: does not compile: KeyError: 'nowhere'"):
        load(own)


def test_one_lane_that_raises_leaves_the_others_alone(tmp_path):
    result, log = flown(10, tmp_path)
    assert len(result.extra["notes"]) == 1 and " on left_inner at 1.000 s: ZeroDivision" in result.extra["notes"][0]
    assert log.frame("/detectors/misbehaving/left_inner")["status"].iloc[-1] == RAISED
    assert log.frame("/detectors/misbehaving/left_outer")["valid"].iloc[-1] == 1.0
    assert replay(tmp_path / "10.mcap", guests=[BAD]).exact


def test_a_residual_that_is_no_number_is_told_once_and_not_valid(tmp_path):
    result, log = flown(2, tmp_path)
    assert result.extra["notes"] == ["misbehaving: r = nan at 1.000 s; it counts as not valid while so"]
    own = log.frame("/detectors/misbehaving/left_inner")
    assert np.isfinite(own.to_numpy()).all() and own["valid"].iloc[-1] == 0.0 and own["status"].iloc[-1] == 0.0


def test_one_that_never_returns_ends_by_ctrl_c_with_a_whole_log(tmp_path):
    text = f"""
        import cosim, tomllib
        from cosim.flight.guests import with_detectors
        from cosim.scenario import parse
        scenario = with_detectors(cosim.load_scenario("cruise", {["duration_s=2", *SHORT[1:]]!r}), [{str(BAD)!r}])
        table = tomllib.loads(scenario.expanded_toml())
        table["detectors"]["misbehaving"]["how"] = 9.0
        print("flying", flush=True)
        print(cosim.simulate(parse(table), log="stuck.mcap", timed=False).status, flush=True)
    """
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n" + textwrap.dedent(text)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, env=environment, stdout=subprocess.PIPE,
                          text=True) as process:  # fmt: skip
        assert process.stdout.readline() == "flying\n"
        path, deadline = tmp_path / "stuck.mcap", time.monotonic() + 60.0
        while time.monotonic() < deadline and not (path.exists() and path.stat().st_size > 10_000):
            time.sleep(0.2)
        time.sleep(3.0)  # it is somewhere in the guest's loop now
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"
    log = open_log(path)
    assert log.complete and log.n_ticks == 200 and log.result["status"] == "interrupted"
    assert len(log.frame("/detectors/misbehaving/left_inner")) == 200


HANGS = (
    ('("timer", "f8", "s"),', '("n", "f8", "-"), ("timer", "f8", "s"),'),
    ("x.culprit = x.alarm", "x.n = x.n + 1.0\n    while x.n > 150.0:\n        x.n = x.n + 1.0"),
)


@pytest.mark.slow
def test_compiled_code_that_never_returns_ends_by_ctrl_c_with_a_whole_log(tmp_path):
    text = BLOCK.read_text()
    for old, new in HANGS:
        text = text.replace(old, new)
    (tmp_path / "hangs.py").write_text(text)
    program = f"""
        import cosim, signal
        from cosim.flight.guests import with_detectors
        signal.signal(signal.SIGINT, signal.default_int_handler)
        scenario = with_detectors(cosim.load_scenario("cruise", {["duration_s=2", *SHORT[1:]]!r}), ["hangs.py"])
        cosim.simulate(scenario, log="stuck.mcap", timed=False)
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(program)], cwd=tmp_path, env=environment,
                          stderr=subprocess.PIPE, text=True) as process:  # fmt: skip
        path, deadline = tmp_path / "stuck.mcap", time.monotonic() + 120.0
        while time.monotonic() < deadline and not (path.exists() and path.stat().st_size > 10_000):
            time.sleep(0.2)
        time.sleep(5.0)  # it is in the guest's loop now
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=30.0) == 130
        assert "interrupted at 0.75 s by the user, in a guest that did not return" in process.stderr.read()
    log = open_log(path)
    assert log.complete and log.n_ticks == 150 and log.result["status"] == "interrupted"
    assert replay(path).exact


def test_check_detector_says_what_keeps_the_contract_and_what_does_not(parity):
    found = check(parity)
    assert found["keeps"] and {line["result"] for line in found["checks"]} == {"good"} and len(found["checks"]) == 9
    bad = check(DATA / "guests" / "counting.py")
    assert not bad["keeps"]
    failed = {line["question"] for line in bad["checks"] if line["result"] == "bad"}
    assert {"deterministic", "live as in replay"} <= failed
    assert {line["question"]: line["result"] for line in bad["checks"]}["lost samples"] == "note"
    assert check(BLOCK)["keeps"]


PEEK = """

def rollout(x, u, p, dt, log=None):
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            step(x[i], u[i, k], p[i], dt)
            x[i].r += 1e-9 * u[i, u.shape[1] - 1].rod
            if log is not None:
                log[i, k] = x[i]
"""


def test_check_detector_finds_one_that_looks_into_the_future(tmp_path):
    (tmp_path / "peek.py").write_text(BLOCK.read_text() + PEEK)
    found = {line["question"]: line for line in check(tmp_path / "peek.py")["checks"]}
    assert found["causal"]["result"] == "bad" and "depends on what is measured from" in found["causal"]["answer"]
    assert found["live as in replay"]["result"] == "bad"


def test_new_writes_a_detector_and_a_test_that_passes(parity):
    assert 15 <= len(parity.read_text().splitlines()) <= 40
    tests = runpy.run_path(str(parity.with_name("test_parity.py")))
    assert [tests[name]() for name in tests if name.startswith("test_")] == [None, None]


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
    cls = type("Own", (), {**plain, **change})
    with pytest.raises(CosimError) as wrong:
        cosim.register(cls)
    assert said in str(wrong.value)


def test_what_a_guest_declares_is_expected_and_the_rest_is_not_declared():
    own = record(type("Own", (), {
        "id": "own", "level": "local", "technologies": ("hydraulic",), "inputs": ("rod",), "blind": ("rudder",),
        "designed_for": ("ofc_liquid",), "may_see": {"hydraulic.rod": "jam_liquid"}, "estimates": "rod",
        "update": lambda self, t, y: None, "__init__": lambda self, dt: None,
    }))  # fmt: skip
    assert own.designed_for == {
        "hydraulic.ofc_liquid": ("ofc_liquid", "ambiguous"),
        "hydraulic.ofc_liquid@*": ("ofc_liquid", "ambiguous"),
    }
    registry.tell(own)
    words = {case: coverage.expected("own", case).word for case in
             ("hydraulic.ofc_liquid@command", "hydraulic.rod", "rudder", "engine")}  # fmt: skip
    assert list(words.values()) == ["designed", "may", "blind", "undeclared"]
    assert coverage.WORDS["undeclared"] == "not declared"
    assert outcome("own", "engine", seen=True, is_right=True) == "named"
    assert outcome("own", "engine", seen=False) == "quiet" and outcome("own", "rudder", seen=True) == "bonus"
    assert (own.estimates[0].of, own.estimates[0].unit) == ("rod", "m")


def test_a_scenario_names_a_file_beside_it_and_sets_parameters(parity, tmp_path):
    (parity.parent / "own.toml").write_text(
        (Path(cosim.__file__).parent / "scenarios" / "cruise.toml").read_text()
        + '\n[detectors.parity]\nfile = "parity.py"\nthreshold = 0.5\n'
    )
    scenario = cosim.load_scenario(parity.parent / "own.toml", ["duration_s=1", ROD.replace("2.5", "0.2")])
    assert scenario.detectors.enabled == (*registry.SHIPPED, "parity")
    assert len(scenario.detectors.table("parity")["sha256"]) == 64
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
        cosim.load_scenario(meant)


def test_an_installed_package_brings_one_by_entry_point(parity, tmp_path, monkeypatch):
    (tmp_path / "parity_package.py").write_text(parity.read_text().replace('"parity"', '"installed"'))
    about = tmp_path / "parity_package-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: parity-package\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[cosim.detectors]\ninstalled = parity_package:Parity\n")
    monkeypatch.syspath_prepend(tmp_path)
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=1"]), ["installed"])
    assert "installed" in {d["id"] for d in cosim.simulate(scenario, timed=False).to_dict()["detectors"]}
    with pytest.raises(CosimError, match="Did you mean 'installed'"):
        load("instaled")


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


WATCH = """
print("loading")


class Watch:
    \"\"\"pitch rate that the elevators do not ask for\"\"\"

    id, level, every = "watch", "aircraft", 4
    inputs = ("q", "de_cmd", "left_inner.surface")
    estimates = "elevator"
    may_see = ("jam_solid",)

    def __init__(self, dt, gain=1.0):
        self.dt, self.gain, self.n = dt, gain, 0

    def update(self, t, y):
        assert abs(t - self.n * 0.02) < 1e-9 and self.dt == 0.02
        self.n += 1
        print("step")
        if self.n % 3:
            return None
        return {"r": abs(y.q), "estimate": self.gain * (y.left_inner_surface - y.de_cmd), "verdict": {"none": 0.4,
                "jam_solid": 0.6}, "alarm": y.left_inner_surface != y.left_inner_surface}
"""


def test_one_at_aircraft_level_at_its_own_rate_estimates_and_prints_elsewhere(tmp_path, capsys):
    (tmp_path / "watch.py").write_text(WATCH)
    drop = "faults.0={target='elevator.left_inner.surface', kind='dropout', start_s=1.0, end_s=1.4}"
    jam = "faults.1={target='elevator.right_inner', kind='jam_solid', start_s=2.0}"
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, drop, jam]), [tmp_path / "watch.py"])
    result = cosim.simulate(scenario, log=tmp_path / "a.mcap", timed=False).to_dict()
    assert result["notes"] == [] and capsys.readouterr().out == ""
    own = lane(result, "watch")
    assert own["estimate_unit"] == "rad" and own["estimate_rmse"] is not None
    log = open_log(tmp_path / "a.mcap")
    frame = log.frame("/detectors/watch/aircraft")
    assert len(frame) == 250 and log.topics["/detectors/watch/aircraft"].units[5] == "rad"
    alarmed = frame.index[frame["alarm"] > 0.5]
    assert 0.9 < alarmed[0] < 1.2 and alarmed[-1] < 1.6  # the sample that is lost is NaN
    assert set(frame["probability"]) <= {0.0, 0.6} and set(frame["verdict"]) <= {0.0, 4.0}
    assert replay(tmp_path / "a.mcap", guests=[tmp_path / "watch.py"]).exact


NONSENSE_BLOCK = "    x.verdict = 42.0 if x.valid > 0.5 else math.nan\n    x.culprit = -7.0\n    x.alarm = 1.0\n"


def test_a_compiled_block_that_says_nonsense_ends_no_flight(tmp_path):
    text = BLOCK.read_text().replace('id="template"', 'id="odd"')
    end = text.index("\n\nrollout = entry")
    (tmp_path / "odd.py").write_text(text[:end].rstrip() + "\n" + NONSENSE_BLOCK + text[end:])
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=2"]), [tmp_path / "odd.py"])
    result = cosim.simulate(scenario, log=tmp_path / "a.mcap", timed=False).to_dict()
    assert result["status"] == "completed" and lane(result, "odd")["alarm"] and open_log(tmp_path / "a.mcap").complete
    assert flight_report(tmp_path / "a.mcap", tmp_path / "a.html").exists()


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


def test_machine_code_of_a_block_is_that_of_its_neighbours_too(tmp_path):
    (tmp_path / "own.py").write_text("import gains_of_mine\nimport numpy\nfrom actuators.block import kernel\n")
    (tmp_path / "gains_of_mine.py").write_text("GAIN = 1.0\n")
    (tmp_path / "another.py").write_text("")
    names = {file.name for file in closure((tmp_path / "own.py").resolve())}
    assert {"own.py", "gains_of_mine.py", "block.py"} <= names and "another.py" not in names


def test_a_guest_that_does_nothing_costs_little(tmp_path):
    """Targets: below 5 us per lane and tick for a class, 1 us compiled; here with room for a loaded machine."""
    (tmp_path / "idle.py").write_text(
        'class Idle:\n    id, level, technologies = "idle", "local", ("hydraulic",)\n    inputs = ("rod",)\n'
        "    def __init__(self, dt):\n        pass\n    def update(self, t, y):\n        return None\n"
    )
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=1"]), [tmp_path / "idle.py", BLOCK])
    setup = build(scenario)
    block = next(d for d in setup.loop.detectors if d.name == "idle")
    best = min(timeit.repeat(block.advance, number=2000, repeat=5)) / 2000 / len(block.x)
    assert best < 20e-6
    setup.time_detectors()
    assert setup.step_us["template"] < 4.0
