"""Names that others gave are shown as they are: brackets in them are no markup."""

import io

import pytest
from rich.console import Console
from rich.text import Text
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.cli import tables
from cosim.files import beside
from cosim.table import Table


def call(*args):
    return CliRunner().invoke(cli.app, [str(a) for a in args])


@pytest.mark.parametrize("name", ["[/red]", "[red]", ":smile:", "[link=x]"])
def test_a_table_shows_cells_headings_and_title_as_they_are(name):
    t = Table(name, f"h{name}", "right>")
    t.add(f"c{name}", Text(f"t{name}"))
    console = Console(file=io.StringIO(), width=100)
    console.print(t)
    assert all(f"{part}{name}" in console.file.getvalue() for part in ("h", "c", "t", ""))


def test_a_bar_shows_a_name_as_it_is():
    console = Console(file=io.StringIO(), width=100, force_terminal=True)
    with tables.progress(console, "flying [/red]") as move:
        move(1.0, 2.0)
    assert "flying [/red]" in console.file.getvalue()


def test_a_folder_with_brackets_in_its_name_is_checked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ac[").mkdir()
    (tmp_path / "ac[" / "red]").mkdir()
    told = call("check-aircraft", "ac[/red]")
    assert told.exit_code in (1, 2) and isinstance(told.exception, SystemExit)
    assert "ac[/red]" in (told.stdout + told.stderr).replace("\n", "")


def test_a_link_to_itself_is_no_place_for_a_log(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    told = call("run", "-o", tmp_path / "loop")
    assert told.exit_code == 2 and told.stderr.count("\n") == 1 and f"{tmp_path / 'loop'}: cannot be " in told.stderr
    with beside(tmp_path / "loop") as part:
        part.write_text("whole")
    assert (tmp_path / "loop").read_text() == "whole"
