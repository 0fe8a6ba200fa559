"""A command writes over no input of its own, and a log takes the place of a log alone."""

import pytest
from typer.testing import CliRunner

from cosim.cli.commands import app

OWN = """
class Mine:
    id, level, technologies, inputs = "mine", "local", ("hydraulic",), ("rod",)
    designed_for = ("rod",)

    def __init__(self, dt):
        pass

    def update(self, t, y):
        return {"r": 0.0, "alarm": False, "verdict": "none"}
"""
SHORT = ["-s", "duration_s=0.5", "-s", "detectors.enabled=['iotsekf']"]


def cosim(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    log = tmp_path_factory.mktemp("flown") / "a.mcap"
    assert cosim("run", "cruise", *SHORT, "-o", log).exit_code == 0
    return log


@pytest.mark.parametrize("words", [["run", "cruise", *SHORT], ["replay", "LOG"]])
def test_a_detector_of_ones_own_is_not_written_over(words, flown, tmp_path):
    own = tmp_path / "own.py"
    own.write_text(OWN)
    (tmp_path / "link.mcap").symlink_to(own)
    words = [flown if word == "LOG" else word for word in words]
    for out in (own, tmp_path / "link.mcap"):
        done = cosim(*words, "--detector", own, "-o", out)
        assert done.exit_code == 2 and "is a detector itself, it would be overwritten" in done.stderr
        assert own.read_text() == OWN


@pytest.mark.parametrize("words", [["run", "cruise", *SHORT], ["replay", "LOG"], ["recover", "LOG"]])
def test_a_log_takes_the_place_of_a_log_alone(words, flown, tmp_path):
    words = [flown if word == "LOG" else word for word in words]
    mine = tmp_path / "mine.mcap"
    mine.write_text("mine")
    done = cosim(*words, "-o", mine)
    assert done.exit_code == 2 and "is no log, it would be overwritten" in done.stderr and "remove it" in done.stderr
    assert mine.read_text() == "mine"
    mine.write_bytes(b"")
    assert cosim(*words, "-o", mine).exit_code == 0
    again = cosim(*words, "-o", mine)
    assert again.exit_code == 0 and (words[0] == "recover" or "what the file held is overwritten" in again.stdout)


def test_a_map_is_not_written_over(flown, tmp_path):
    (tmp_path / "map.toml").write_text("mine = 1")
    done = cosim("replay", flown, "--map", tmp_path / "map.toml", "-o", tmp_path / "map.toml")
    assert done.exit_code == 2 and "is the map itself" in done.stderr
    assert (tmp_path / "map.toml").read_text() == "mine = 1"
