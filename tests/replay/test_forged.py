"""What our log format holds without our texts is an error of one line, and a log never has code run."""

import pytest
from forged import forge

import cosim
from cosim.compare import compare
from cosim.errors import CosimError
from cosim.log import log_info, open_log
from cosim.replay import replay
from cosim.report import flight_report


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return the open log of a short flight with one detector."""
    path = tmp_path_factory.mktemp("forged") / "whole.mcap"
    short = ["duration_s=1", "faults.0.start_s=0.5", "detectors.enabled=['iotsekf']", "elevator.feedback=measured"]
    cosim.simulate(cosim.load_scenario("liquid-ofc", short), log=path, timed=False)
    return open_log(path)


STRANGE = {  # what stands in the place of an attachment of our own: what is said
    "detectors.json": {b"{": "not valid JSON", b"3": "no list of detectors", None: "describes no detectors",
                       b'[{"id": "nobody"}]': "no list of detectors"},
    "scenario.toml": {b"= 1": "scenario.toml", b"\xff": "scenario.toml", b"colour = 'red'": "colour",
                      None: "holds no scenario"},
    "iotsekf.params.npy": {b"": "no array", b"\x93NUMPY\x09\x00": "no array", None: "lacks iotsekf.params"},
}  # fmt: skip


@pytest.mark.parametrize(("name", "text"), [(name, text) for name, own in STRANGE.items() for text in own])
def test_a_log_of_another_writer_is_refused_in_one_line(name, text, log, tmp_path):
    path = forge(log, tmp_path / "forged.mcap", attachments={name: text})
    assert log_info(path)["log"] == str(path)  # tells of anything
    with pytest.raises(CosimError, match=STRANGE[name][text]) as told:
        replay(path)
    assert all(str(path) in line for line in str(told.value).splitlines())


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
