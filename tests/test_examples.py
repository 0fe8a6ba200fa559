"""Every example runs as it stands, and says something."""

import json
import runpy

import pytest
from typer.testing import CliRunner

from cosim.campaign.inventory import examples
from cosim.cli import commands as cli


@pytest.mark.parametrize("name", examples())
def test_an_example_is_copied_and_runs(name, tmp_path, monkeypatch, capsys, one_process):
    copied = CliRunner().invoke(cli.app, ["new", "example", name, "-o", str(tmp_path), "--json"])
    assert copied.exit_code == 0 and json.loads(copied.stdout)["files"] == [str(tmp_path / f"{name}.py")]
    again = CliRunner().invoke(cli.app, ["new", "example", name, "-o", str(tmp_path)])
    assert again.exit_code == 2 and "is there already" in again.stderr
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(tmp_path / f"{name}.py"), run_name="__main__")
    assert capsys.readouterr().out.strip()


def test_examples_are_listed_and_one_that_is_none_is_refused():
    shown = CliRunner().invoke(cli.app, ["list", "examples"]).stdout
    assert all(name in shown for name in examples()) and len(examples()) >= 5
    refused = CliRunner().invoke(cli.app, ["new", "example", "fly_and_plott"])
    assert refused.exit_code == 2 and "Did you mean 'fly_and_plot'?" in refused.stderr
