"""User detectors that raise, lie, hang or answer nonsense: each is dropped with a line, and changes nothing else."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import cosim
from cosim.cli.commands import dropped
from cosim.errors import CosimError
from cosim.judge.row import rows
from cosim.log import open_log
from cosim.parts import load, with_detectors
from cosim.parts.detector import DROPPED as GONE
from cosim.parts.detector import SLOW
from cosim.replay import replay
from cosim.report import flight_report

DATA = Path(__file__).parents[1] / "data"
BAD = DATA / "user_parts" / "misbehaving.py"
BLOCK = DATA / "template_detector.py"
SHORT = ["duration_s=2", "elevator.feedback=measured", "detectors.enabled=['ofc_monitor']"]


def flown(how, tmp_path):
    """Return (result, log) of a flight with the misbehaving detector."""
    own = [f"detectors.misbehaving.{k}" for k in (f"file={BAD}", f"how={how}", "limit_s=0.1")]
    scenario = cosim.load_scenario("cruise", [*SHORT[:2], "detectors.enabled=['ofc_monitor', 'misbehaving']", *own])
    path = tmp_path / f"{how}.mcap"
    return cosim.simulate(scenario, log=path, timed=False), open_log(path)


@pytest.fixture(scope="module")
def behaved(tmp_path_factory):
    """Return the log of the same flight in which it does nothing wrong."""
    result, log = flown(0, tmp_path_factory.mktemp("behaved"))
    assert result.extra["notes"] == []
    return log


DROPPED = {
    1: (GONE, "ZeroDivisionError: on purpose (misbehaving.py:40)"),
    3: (GONE, "verdict 'gremlins'; allowed: none, ofc_liquid"),
    4: (GONE, "update returned 'an alarm'; allowed: a dict of"),
    5: (GONE, "AttributeError: can't set attribute"),
    6: (SLOW, "a step took 0."),
    7: (GONE, "SystemExit: 3"),
    8: (GONE, "alarm = 'perhaps' is no number"),
    12: (GONE, "Mute (misbehaving.py:"),
    13: (GONE, "r = ["),
    14: (GONE, "Muter (misbehaving.py:"),
}


@pytest.mark.parametrize("how", DROPPED)
def test_what_misbehaves_is_dropped_with_a_line_and_touches_nothing(how, behaved, tmp_path):
    status, said = DROPPED[how]
    result, log = flown(how, tmp_path)
    notes = result.extra["notes"]
    assert result.status == "completed" and log.complete and len(notes) == 2
    assert f"misbehaving is dropped on left_outer at 1.000 s: {said}" in notes[0]
    own = log.frame("/detectors/misbehaving/left_inner")
    assert own["status"].iloc[198] == 0.0 and own["status"].iloc[-1] == status and own["valid"].iloc[-1] == 0.0
    again = replay(tmp_path / f"{how}.mcap", user_detectors=[BAD])
    assert again.exact and bool(again.skipped) == (status == SLOW)
    assert again.notes == notes * (status != SLOW)  # a replay has no clock
    for topic in ("/detectors/ofc_monitor/left_inner", "/truth/aircraft", "/sensors/left_inner", "/law"):
        assert (behaved.array(topic).view(np.int64) == log.array(topic).view(np.int64)).all(), topic


def test_a_campaign_says_which_detector_was_dropped_in_how_many_flights(tmp_path):
    result, _ = flown(3, tmp_path)
    good = {**result.to_dict(), "notes": []}
    flights = good, result.to_dict(), result.to_dict()
    frame = pd.DataFrame([row for i, one in enumerate(flights) for row in rows(str(i), one)])
    (told,) = dropped(frame)
    assert told.startswith(f"misbehaving is dropped on left_outer at 1.000 s: {DROPPED[3][1]}")
    assert told.endswith("ambiguous; it is dropped in 2 of 3 runs")


def test_a_residual_that_is_no_number_is_told_once_and_not_valid(tmp_path):
    result, log = flown(2, tmp_path)
    assert result.extra["notes"] == ["misbehaving: r = nan at 1.000 s; it counts as not valid while so"]
    own = log.frame("/detectors/misbehaving/left_inner")
    assert np.isfinite(own.to_numpy()).all() and own["valid"].iloc[-1] == 0.0 and own["status"].iloc[-1] == 0.0


ODD = """
    x.verdict = 42.0 if x.valid > 0.5 else math.nan
    x.isolated_part = -7.0
    x.alarm = 1.0


rollout = entry"""


def test_a_compiled_block_that_answers_nonsense_ends_no_flight(tmp_path):
    (tmp_path / "own.py").write_text(BLOCK.read_text().replace("\n\nrollout = entry", ODD))
    scenario = with_detectors(cosim.load_scenario("cruise", SHORT), [tmp_path / "own.py"])
    result, log = cosim.simulate(scenario, log=tmp_path / "a.mcap", timed=False), open_log(tmp_path / "a.mcap")
    own = [d["alarm"] for d in result.to_dict()["detectors"] if d["id"] == "template"]
    assert result.status == "completed" and all(own) and own and log.complete
    assert flight_report(tmp_path / "a.mcap", tmp_path / "a.html").exists()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("class Own(BaseException): pass\nraise Own('mine')", "does not run: Own: mine (own.py:2)"),
        ("import asyncio\nraise asyncio.CancelledError", "does not run: CancelledError (own.py:2)"),
        ("raise SystemExit(3)", "does not run: SystemExit: 3 (own.py:1)"),
        ("import nothing_of_the_kind", "does not run: ModuleNotFoundError: No module named 'nothing_of_the_kind' (own"),
        ("x = 1", "holds no detector; allowed: one class"),
        (
            BLOCK.read_text().replace("x.isolated_part = x.alarm", "x.nowhere = x.alarm"),
            "does not compile: KeyError: 'nowh",
        ),
    ],
)
def test_a_file_that_gives_no_detector_is_refused(text, told, tmp_path):
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(CosimError) as refused:
        load(tmp_path / "own.py")
    assert f"{tmp_path / 'own.py'}: {told}" in str(refused.value)
    (tmp_path / "own.xml").write_text("raise SystemExit('ran')\n")
    with pytest.raises(CosimError, match=r"own\.xml: is no Python code; allowed: a file that ends in \.py"):
        load(tmp_path / "own.xml")


STUCK = """
import signal, cosim
signal.signal(signal.SIGINT, signal.default_int_handler)
keys = ["duration_s=2", "elevator.feedback=measured", "detectors.enabled=['ofc_monitor', 'misbehaving']",
        "detectors.misbehaving.file=FILE", "detectors.misbehaving.how=9"]
print("flying", flush=True)
print(cosim.simulate(cosim.load_scenario("cruise", keys), log="stuck.mcap", timed=False).status, flush=True)
"""


def test_one_that_never_returns_ends_by_ctrl_c_with_a_whole_log(tmp_path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([sys.executable, "-c", STUCK.replace("FILE", str(BAD))], cwd=tmp_path, env=environment,
                          stdout=subprocess.PIPE, text=True) as process:  # fmt: skip
        assert process.stdout.readline() == "flying\n"
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline and not any(p.stat().st_size > 10_000 for p in tmp_path.iterdir()):
            time.sleep(0.2)
        time.sleep(1.0)  # it is somewhere in its loop now
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"
    log = open_log(tmp_path / "stuck.mcap")
    assert log.complete and log.n_ticks == 200 and log.result["status"] == "interrupted"
