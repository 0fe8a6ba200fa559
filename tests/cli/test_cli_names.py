"""Names that others gave are shown as they are: brackets in them are no markup."""

import io

import pytest
from rich.console import Console
from rich.text import Text
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.progress import Compiling, Progress
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


def test_a_plain_file_gets_a_line_of_progress_now_and_then(monkeypatch):
    clock = iter(range(0, 1000, 4))  # 4 s from call to call
    monkeypatch.setattr("cosim.progress.time.monotonic", lambda: float(next(clock)))
    console = Console(file=io.StringIO(), width=100)
    with Progress("flying [/red]", "runs", console=console) as tell:
        for done in range(13):
            tell(done, 12)
    lines = console.file.getvalue().splitlines()
    assert lines[0].startswith("flying [/red]: 2 of 12") and 2 <= len(lines) <= 4  # after 10 s, then every 30 s
    console = Console(file=io.StringIO(), width=100)
    with Compiling(console) as tell:
        tell(0, 30)
    assert console.file.getvalue() == "compiling: 0 of 30 kernels, once on a machine\n"


def test_a_folder_with_brackets_in_its_name_is_checked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ac[").mkdir()
    (tmp_path / "ac[" / "red]").mkdir()
    told = call("check", "ac[/red]")
    assert told.exit_code in (1, 2) and isinstance(told.exception, SystemExit)
    assert "ac[/red]" in (told.stdout + told.stderr).replace("\n", "")


def test_a_message_is_one_line_as_it_was_written_and_not_endless(tmp_path, monkeypatch):
    (tmp_path / "passwd").write_text("root:x:0:0:secret\n")
    given = ["-s", "manoeuvre.kind=inputs", "-s", f"manoeuvre.file={tmp_path / 'passwd'}"]
    said = call("run", "cruise", *given)
    assert said.exit_code == 2 and "secret" not in said.stderr and said.stderr.count("\n") == 1
    for name in ("root:x:0:0", "a" * 5000, "a\nb"):
        said = call("run", "cruise", "-s", f"title={name}", "-s", f"manoeuvre.kind={name}")
        assert said.exit_code == 2 and said.stderr.count("\n") == 1 and len(said.stderr) < 1100
    assert "root:x:0:0" in call("info", "root:x:0:0").stderr
    assert call("info", "a\nb.mcap").stderr.count("\n") == 1
