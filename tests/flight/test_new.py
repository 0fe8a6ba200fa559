"""What `cosim new` writes runs as it is, and its test passes; a name that would shadow a module is refused."""

import shlex
import subprocess
import sys

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli import commands as cli
from cosim.flight.new import KINDS, shadows
from cosim.scenario.aircraft import load_aircraft

OWN = [kind for kind in KINDS if kind != "detector"]  # test_user_detector.py has that one


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("new")
    for kind in OWN:
        more = ["--numbers", str(load_aircraft("narrowbody").folder / "numbers.toml")] if kind == "aircraft" else []
        told = CliRunner().invoke(cli.app, ["new", kind, f"own_{kind}", "-o", str(made), *more])
        assert told.exit_code == 0 and "next   cosim" in told.stdout, told.output
    return made


def test_the_tests_that_are_written_pass(folder):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", str(folder)],
        cwd=folder, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0 and f"{2 + len(OWN)} passed" in done.stdout, done.stdout + done.stderr


def test_the_next_command_of_an_actuator_is_a_scenario_that_can_be_flown(folder):
    (step,) = KINDS["actuator"]
    words = shlex.split(step.format(file=folder / "own_actuator.py", name="own_actuator").removeprefix("cosim run "))
    scenario = cosim.load_scenario(words[0], words[2::2])
    assert scenario.elevator.technology["left_inner"] == "own_actuator"


@pytest.mark.parametrize(("kind", "name"), [("aircraft", "transport"), ("actuator", "ema"), ("detector", "iotsekf")])
def test_a_name_that_ships_is_refused(kind, name, tmp_path):
    """`flight.aircraft = "transport"` is the shipped one, whatever folder stands beside it."""
    told = CliRunner().invoke(cli.app, ["new", kind, name, "-o", str(tmp_path)])
    assert told.exit_code == 2 and "that ships" in told.stderr and not any(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["numpy", "os", "test", "cosim", "json", "typing", "class", "Upper", "1st"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_name_that_shadows_a_module_or_is_none_is_refused(kind, name, tmp_path):
    told = CliRunner().invoke(cli.app, ["new", kind, name, "-o", str(tmp_path)])
    assert told.exit_code == 2 and name in told.stderr and not any(tmp_path.iterdir())


def test_what_is_there_already_stays_and_an_unknown_kind_is_told(folder):
    before = (folder / "own_law.py").read_text()
    told = CliRunner().invoke(cli.app, ["new", "law", "own_law", "-o", str(folder)])
    assert told.exit_code == 2 and "is there already" in told.stderr and (folder / "own_law.py").read_text() == before
    told = CliRunner().invoke(cli.app, ["new", "wing", "own", "-o", str(folder)])
    assert told.exit_code == 2 and "detector, law, actuator, aircraft, campaign" in told.stderr


def test_a_file_in_the_current_folder_shadows_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "mine_alone.py").write_text("")
    assert not shadows("mine_alone") and shadows("numpy")
