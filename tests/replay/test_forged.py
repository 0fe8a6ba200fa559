"""A forged log, its checksums right, is an error of one line at every door, never a traceback."""

import io
import json
import resource
import signal

import numpy as np
import pytest
from forged import forge

import cosim
from cosim.compare import compare
from cosim.errors import CosimError
from cosim.log import open_log, recover
from cosim.log.overview import log_info
from cosim.replay import replay
from cosim.report import flight_report

ARRAY = "iotsekf.params.npy"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return the open log of a short flight with one detector."""
    path = tmp_path_factory.mktemp("forged") / "whole.mcap"
    short = ["duration_s=1", "faults.0.start_s=0.5", "detectors.enabled=['iotsekf']", "elevator.feedback=measured"]
    cosim.simulate(cosim.load_scenario("liquid-ofc", short), log=path, timed=False)
    return open_log(path)


def _objects():
    out = io.BytesIO()
    np.save(out, np.array([{}], dtype=object), allow_pickle=True)
    return out.getvalue()


MANIFESTS = {  # what is changed in detectors.json, or what stands in its place
    "no JSON": b"{", "a number": b"3", "deep": b"[" * 9000, "not UTF-8": b"\xff\xfe[", "every zero": {"every": 0},
    "every other than its topic's": {"every": 7}, "lanes twice": {"lanes": ["left_inner", "left_inner"]},
    "an input that is no field": {"inputs": {"left_inner": [["y_nothing", "/sensors/left_inner", "rod"]]}},
    "an input from nowhere": {"inputs": {"left_inner": [["y_rod", "/nowhere", "rod"]]}}, "nobody": {"id": "nobody"},
}  # fmt: skip
FORGERIES = {
    **{f"scenario {text[:9]!r}": {"attachments": {"scenario.toml": text}}
       for text in (b"= 1", b"\xff", b"x = " + b"[" * 5000, b"colour = 'red'", b"")},
    **{f"array {text[:9]!r}": {"attachments": {ARRAY: text}} for text in (b"", b"\x93NUMPY\x09\x00", _objects())},
    **{f"sample {value}": {"samples": (("/detectors/iotsekf/left_inner", field, value),)}
       for field, value in (("verdict", 1e18), ("culprit", -1.0), ("r", np.inf), ("alarm", np.nan))},
    "no scenario": {"attachments": {"scenario.toml": None}}, "no detectors": {"attachments": {"detectors.json": None}},
    "tick of another rate": {"dt_ns": 4_000_000}, "gap of 1e11 ticks": {"gap": 10**11},
    "no state": {"renamed": {"/state/iotsekf/left_inner": None}},
    "achieved of the result": {"result": {"achieved": "[" * 5000}},
    "rate": {"metadata": {"run": {"rate_hz": "9" * 400, "seed": "x"}}},
}  # fmt: skip


@pytest.mark.parametrize("name", [*MANIFESTS, *FORGERIES])
def test_every_door_says_each_mistake_in_one_line(name, log, tmp_path):
    what, told = FORGERIES.get(name), MANIFESTS.get(name)
    if isinstance(told, dict):
        first, *rest = json.loads(log.attachments["detectors.json"])
        told = json.dumps([first | told, *rest]).encode()
    path = forge(log, tmp_path / "forged.mcap", **(what or {"attachments": {"detectors.json": told}}))
    assert log_info(path)["log"] == str(path)  # tells of anything
    refused = 0
    for door in (replay, lambda p: flight_report(p, tmp_path / "page.html")):
        try:
            door(path)
        except CosimError as error:
            refused += 1
            assert all(str(path) in line for line in str(error).splitlines())
    # the report needs no parameters and no states, and shows what others' detectors said
    one = any(word in name for word in ("array", "nobody", "no state"))
    assert refused >= (0 if any(w in name for w in ("sample", "result", "rate")) else 1 if one else 2), "taken as it is"


@pytest.mark.parametrize("table", ["law", "actuators.rig"])
def test_no_code_that_a_log_names_is_run(table, log, tmp_path):
    own = tmp_path / "own.py"
    own.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    text, head = log.attachments["scenario.toml"].decode(), f"[{table}]\n"
    told = (text if head in text else f"{text}\n{head}").replace(head, f"{head}file = {str(own)!r}\n").encode()
    path = forge(log, tmp_path / "forged.mcap", attachments={"scenario.toml": told})
    for door in (log_info, replay, lambda p: flight_report(p, tmp_path / "page.html"), lambda p: compare([p])):
        door(path)
    assert not (tmp_path / "ran").exists()


def test_a_result_that_cannot_be_written_leaves_what_was_there(log, tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    out = tmp_path / "mine.mcap"
    out.write_bytes(mine := open(log.path, "rb").read(500))
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        for work in (lambda: replay(log.path, output=out), lambda: recover(log.path, out)):
            with pytest.raises(CosimError, match=r"mine\.mcap.*cannot write the log") as told:
                work()
            assert "recover" not in str(told.value)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("mine.mcap", mine)]
