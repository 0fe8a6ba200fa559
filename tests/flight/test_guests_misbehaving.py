"""Detectors that raise, lie, hang or say nonsense: they are dropped with a line, and hurt nobody."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

import cosim
from cosim.errors import CosimError
from cosim.log import open_log
from cosim.parts import load, with_detectors
from cosim.parts.detector import NONSENSE, RAISED, SLOW
from cosim.replay import replay
from cosim.report import flight_report

DATA = Path(__file__).parents[1] / "data"
BAD = DATA / "guests" / "misbehaving.py"
BLOCK = DATA / "template_detector.py"
SHORT = ["duration_s=5", "elevator.feedback=measured", "detectors.enabled=['ofc_monitor']"]


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
        (1, RAISED, "is dropped on left_outer at 1.000 s: ZeroDivisionError: on purpose (misbehaving.py:40)"),
        (3, NONSENSE, "is dropped on left_outer at 1.000 s: verdict 'gremlins'; allowed: none, ofc_liquid"),
        (4, NONSENSE, "is dropped on left_outer at 1.000 s: update returned 'an alarm'; allowed: a dict of"),
        (5, RAISED, "is dropped on left_outer at 1.000 s: AttributeError: can't set attribute"),
        (6, SLOW, "is dropped on left_outer at 1.000 s: a step took 0."),
        (7, RAISED, "is dropped on left_outer at 1.000 s: SystemExit: 3"),
        (8, NONSENSE, "is dropped on left_outer at 1.000 s: alarm = 'perhaps' is no number"),
        (11, RAISED, "is dropped on left_outer at 1.000 s: GeneratorExit: on purpose"),
        (12, RAISED, "is dropped on left_outer at 1.000 s: Mute (misbehaving.py:"),
        (14, RAISED, "is dropped on left_outer at 1.000 s: Muter (misbehaving.py:"),
        (13, NONSENSE, "is dropped on left_outer at 1.000 s: r = ["),
    ],
)
def test_what_misbehaves_is_dropped_with_a_line_and_touches_nothing(how, status, said, behaved, tmp_path):
    result, log = flown(how, tmp_path)
    assert result.status == "completed" and len(result.extra["notes"]) == 2 and said in result.extra["notes"][0]
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


@pytest.mark.parametrize("error", ["RuntimeError", "GeneratorExit"])
def test_a_block_in_plain_python_that_raises_is_dropped(error, tmp_path):
    own, path = tmp_path / "own.py", tmp_path / "raises.mcap"
    own.write_text(BLOCK.read_text() + RAISES.replace("RuntimeError", error))
    result = cosim.simulate(with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=1"]), [own]), log=path)
    line = len(own.read_text().splitlines())
    said = f"template is dropped on left_outer at 0.000 s: {error}: on purpose (own.py:{line})"
    assert result.extra["notes"] == [said, said.replace("outer", "inner")]
    assert open_log(path).complete and not open_log(path).array("/detectors/template/left_inner").any()
    assert replay(path, guests=[own]).exact


def test_a_block_that_does_not_compile_is_refused(tmp_path):
    own = tmp_path / "own.py"
    own.write_text(BLOCK.read_text().replace("x.culprit = x.alarm", "x.nowhere = x.alarm"))
    with pytest.raises(CosimError, match=r"own\.py: does not compile: KeyError: 'nowhere'"):
        load(own)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("class Own(BaseException): pass\nraise Own('mine')", "Own: mine (own.py:2)"),
        ("import pytest\npytest.skip('no', allow_module_level=True)", "Skipped: no (own.py:2)"),
        ("import asyncio\nraise asyncio.CancelledError", "CancelledError (own.py:2)"),
        ("raise SystemExit(3)", "SystemExit: 3 (own.py:1)"),
        ("import sys\nsys.path.clear()\nraise StopIteration", "StopIteration (own.py:3)"),
    ],
)
def test_a_file_that_raises_anything_at_its_import_is_refused(text, told, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(CosimError) as refused:
        load(tmp_path / "own.py")
    assert str(refused.value) == f"{tmp_path / 'own.py'}: does not run: {told}"


def test_a_residual_that_is_no_number_is_told_once_and_not_valid(tmp_path):
    result, log = flown(2, tmp_path)
    assert result.extra["notes"] == ["misbehaving: r = nan at 1.000 s; it counts as not valid while so"]
    own = log.frame("/detectors/misbehaving/left_inner")
    assert np.isfinite(own.to_numpy()).all() and own["valid"].iloc[-1] == 0.0 and own["status"].iloc[-1] == 0.0


def test_one_that_never_returns_ends_by_ctrl_c_with_a_whole_log(tmp_path):
    text = f"""
        import cosim, tomllib
        from cosim.parts import with_detectors
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
        while time.monotonic() < deadline and not any(p.stat().st_size > 10_000 for p in tmp_path.iterdir()):
            time.sleep(0.2)
        time.sleep(1.0)  # it is somewhere in the guest's loop now
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"
    log = open_log(path)
    assert log.complete and log.n_ticks == 200 and log.result["status"] == "interrupted"
    assert len(log.frame("/detectors/misbehaving/left_inner")) == 200


NONSENSE_BLOCK = "    x.verdict = 42.0 if x.valid > 0.5 else math.nan\n    x.culprit = -7.0\n    x.alarm = 1.0\n"


def test_a_compiled_block_that_says_nonsense_ends_no_flight(tmp_path):
    text = BLOCK.read_text().replace('id="template"', 'id="odd"')
    end = text.index("\n\nrollout = entry")
    (tmp_path / "odd.py").write_text(text[:end].rstrip() + "\n" + NONSENSE_BLOCK + text[end:])
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=2"]), [tmp_path / "odd.py"])
    result = cosim.simulate(scenario, log=tmp_path / "a.mcap", timed=False).to_dict()
    own = [d["alarm"] for d in result["detectors"] if d["id"] == "odd"]
    assert result["status"] == "completed" and all(own) and own and open_log(tmp_path / "a.mcap").complete
    assert flight_report(tmp_path / "a.mcap", tmp_path / "a.html").exists()
