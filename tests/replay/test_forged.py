"""A forged log, its checksums right, is an error of one line at every door, never a traceback."""

import importlib
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


def _changed(**change):
    """Return what makes another detectors.json of a log's."""

    def made(found):
        found[0].update(change)
        return json.dumps(found).encode()

    return made


def _npy(header):
    text = header.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def _objects():
    out = io.BytesIO()
    np.save(out, np.array([{}], dtype=object), allow_pickle=True)
    return out.getvalue()


def _fields_of(kind):
    """Return an array with the names of the detector's own and fields of another kind."""
    out, module = io.BytesIO(), importlib.import_module("fdi.hydraulic.iotsekf")
    np.save(out, np.zeros(1, [(n, kind, module.PARAMS[n].shape) for n in module.PARAMS.names]))
    return out.getvalue()


MANIFESTS = {
    "no JSON": b"{",
    "null": b"null",
    "a number": b"3",
    "a list of numbers": b"[1]",
    "deep": b"[" * 9000 + b"]" * 9000,
    "not UTF-8": b"\xff\xfe[",
    "every zero": _changed(every=0),
    "every negative": _changed(every=-3),
    "every a float": _changed(every=1.5),
    "every huge": _changed(every=10**30),
    "every text": _changed(every="x"),
    "every other than its topic's": _changed(every=7),
    "no lanes": _changed(lanes=[]),
    "lanes a text": _changed(lanes="left_inner"),
    "lanes of numbers": _changed(lanes=[1]),
    "lanes twice": _changed(lanes=["left_inner", "left_inner"]),
    "inputs a list": _changed(inputs=[]),
    "inputs of another lane": _changed(inputs={"tail": []}),
    "an input of two": _changed(inputs={"left_inner": [["y_rod", "/sensors"]]}),
    "an input that is no field": _changed(inputs={"left_inner": [["y_nothing", "/sensors/left_inner", "rod"]]}),
    "an input from nowhere": _changed(inputs={"left_inner": [["y_rod", "/nowhere", "rod"]]}),
    "level": _changed(level="satellite"),
    "id a number": _changed(id=3),
    "id of nobody": _changed(id="nobody"),
    "twice": lambda found: json.dumps(found * 2).encode(),
}
SCENARIOS = {
    "no TOML": b"= 1",
    "not UTF-8": b"\xff",
    "deep": b"x = " + b"[" * 5000,
    "a date": b"title = 2020-01-01",
    "another's": b"colour = 'red'",
    "empty": b"",
}
def _reshaped(*shape):
    """Return an array with one record of the detector's own parameters, in a shape that no flight writes."""
    out, module = io.BytesIO(), importlib.import_module("fdi.hydraulic.iotsekf")
    np.save(out, np.zeros(shape, np.lib.format.drop_metadata(module.PARAMS)))
    return out.getvalue()


ARRAYS = {
    "of another shape": _reshaped(1, 1),
    "of no lane": _reshaped(0),
    "huge": _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000,), }"),
    "negative": _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }"),
    "objects": _objects(),
    "fields of text": _fields_of("S8"),
    "fields within fields": _fields_of([("x", "f8")]),
    "fields of times": _fields_of("M8[s]"),
    "odd kind": _npy("{'descr': '|V0', 'fortran_order': False, 'shape': (1,), }"),
    "code for a header": _npy("__import__('os').getpid()"),
    "empty": b"",
    "short": b"\x93NUMPY\x01\x00\xff\xff{",
    "version": b"\x93NUMPY\x09\x00" + b" " * 100,
}
SAMPLES = {
    f"{field} {value}": ((("/detectors/iotsekf/left_inner", field, value),))
    for field in ("verdict", "culprit", "alarm", "valid", "r")
    for value in (1e18, np.inf, -np.inf, np.nan, -1.0)
}
FORGERIES = {
    **{f"detectors.json {k}": {"attachments": {"detectors.json": v}} for k, v in MANIFESTS.items()},
    **{f"scenario {k}": {"attachments": {"scenario.toml": v}} for k, v in SCENARIOS.items()},
    **{f"array {k}": {"attachments": {ARRAY: v}} for k, v in ARRAYS.items()},
    **{f"sample {k}": {"samples": v} for k, v in SAMPLES.items()},
    "no scenario": {"attachments": {"scenario.toml": None}},
    "no detectors": {"attachments": {"detectors.json": None}},
    "tick of 1 ns": {"dt_ns": 1},
    "tick of 11 days": {"dt_ns": 10**15},
    "tick of another rate": {"dt_ns": 4_000_000},
    "gap of 1e11 ticks": {"gap": 10**11},
    "state of nobody": {"renamed": {"/state/iotsekf/left_inner": "/state/iotsekf/left_other"}},
    "no state": {"renamed": {"/state/iotsekf/left_inner": None}},
    "rate": {"metadata": {"run": {"rate_hz": "9" * 400, "seed": "x"}}},
    "detectors of the result": {"result": {"detectors": "null"}},
    "achieved of the result": {"result": {"achieved": "[" * 5000}},
}


@pytest.mark.parametrize("name", FORGERIES)
def test_every_door_says_each_mistake_in_one_line(name, log, tmp_path):
    what = dict(FORGERIES[name])
    told = what.get("attachments", {}).get("detectors.json")
    if callable(told):
        what["attachments"] = {"detectors.json": told(json.loads(log.attachments["detectors.json"]))}
    path = forge(log, tmp_path / "forged.mcap", **what)
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
    expected = 0 if "sample" in name or "result" in name or name == "rate" else 1 if one else 2
    assert refused >= expected, "taken as it is"


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
