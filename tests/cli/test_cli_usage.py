"""What typer refuses by itself is one line on standard error and exit status 2, as every other bad input."""

import subprocess
import sys

import pytest
from typer.testing import CliRunner

from cosim.cli import commands as cli


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("replay x.mcap --from -1", "cosim replay: Invalid value for '--from'"),
        ("campaign x --workers 0", "cosim campaign: Invalid value for '--workers'"),
        ("compare x --fault-rate 0", "cosim compare: Invalid value for '--fault-rate'"),
        ("info --foo", "cosim info: No such option: --foo"),
        ("--foo", "cosim: No such option: --foo"),
        ("rum", "cosim: No such command 'rum'. Did you mean 'run'? `cosim -h`"),
        ("info", "cosim info: Missing argument 'LOG'"),
        ("run -o", "Option '-o' requires an argument"),
        ("run --port 9", "--port: does nothing without --live"),
        ("campaign fault-free --scheduler host", "--scheduler host: no scheduler answers there"),
    ],
)
def test_a_mistake_in_the_call_is_one_line(words, told):
    found = CliRunner().invoke(cli.app, words.split(), prog_name="cosim")
    assert found.exit_code == 2 and found.stdout == ""
    assert found.stderr.startswith("error: ") and found.stderr.count("\n") == 1 and told in found.stderr


def test_no_command_shows_the_help():
    found = CliRunner().invoke(cli.app, [], prog_name="cosim")
    assert "Usage: cosim" in found.output and "error" not in found.output


@pytest.mark.parametrize(("words", "status"), [("--version", 0), ("rum", 2)])
def test_the_module_is_the_command(words, status):
    said = subprocess.run([sys.executable, "-m", "cosim", words], capture_output=True, text=True)
    same = CliRunner().invoke(cli.app, [words], prog_name="cosim")
    assert (said.returncode, said.stdout) == (status, same.stdout)


def test_the_help_has_13_commands_in_groups_and_a_line_for_each(monkeypatch):
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 80)
    told = CliRunner().invoke(cli.app, ["-h"], prog_name="cosim").output
    lines = told.partition("─ Start ")[2].splitlines()
    commands = [line.split()[1] for line in lines if line.startswith("│")]
    names = [command.name or command.callback.__name__ for command in cli.app.registered_commands]
    assert len(names) == 13 and commands == names
    assert all(line.rstrip(" │").endswith(".") for line in lines if line.startswith("│"))
    assert [line.split("─ ")[1].split(" ─")[0] for line in lines if line.startswith("╭")] == [
        "Yours", "Many flights", "Papers"]  # fmt: skip


@pytest.mark.parametrize("command", ["run", "linearize"])
def test_a_campaign_is_told_from_a_scenario(command, tmp_path):
    (tmp_path / "small.toml").write_text('base = "cruise"\n[set]\nduration_s = 1.0\n')
    found = CliRunner().invoke(cli.app, [command, str(tmp_path / "small.toml")])
    assert found.exit_code == 2 and "cosim campaign" in found.stderr and found.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["check", "lqr.pyy"], "lqr.pyy: no such file. Did you mean 'lqr.py'?"),
        (["replay", "fdr.csv"], "`cosim map fdr.csv` drafts the map of its columns that --map takes"),
        (["run", "cruise", "-s", "duration_s='10'"], 'duration_s = "10": must be a valid number'),
    ],
)
def test_a_mistake_points_on(words, told, tmp_path, monkeypatch):
    for name in ("lqr.py", "fdr.csv"):
        (tmp_path / name).write_text("t,alpha\n")
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(cli.app, words, prog_name="cosim")
    assert found.exit_code == 2 and told in found.stderr


def test_keys_name_the_flight_point_and_the_gains_of_the_law():
    said = CliRunner().invoke(cli.app, ["list", "keys", "--json"]).stdout
    assert all(word in said for word in ("mass_t", "cg_pct", "altitude_ft", "cas_kt", "k_nz"))
