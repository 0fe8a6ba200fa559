"""The READMEs: every code block and every command line in them does what it says; every room has one."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
import structure
from typer.main import get_command
from typer.testing import CliRunner

from cosim.campaign.spec import load_campaign
from cosim.cli import commands as cli
from cosim.replay.map_file import load_map
from cosim.scenario import parse

ROOT = structure.ROOT
PAGES = sorted([ROOT / "README.md", *(p for d in structure.PACKAGES for p in (ROOT / d).rglob("README.md"))])
LONG = ("cosim campaign", "cosim reproduce", "cosim compare")


def blocks(kind):
    """Return (page, text) of every fenced block of a language."""
    fence = re.compile(rf"```{kind}\n(.*?)```", re.S)
    return [(page, text) for page in PAGES for text in fence.findall(page.read_text(encoding="utf-8"))]


def commands():
    """Return (page, words) of every `cosim ...` command line, indented or in backticks."""
    out = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8").partition("<!-- reproduce: begin -->")[0]
        found = re.findall(r"^    (cosim .*)$|`(cosim\s[^`]+)`", text, re.M)
        out += [(page, " ".join(re.split(r"   +", one or other)[0].split())) for one, other in found]
    return out


def shown(page):
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page, text", blocks("toml"), ids=lambda v: shown(v) if isinstance(v, Path) else "")
def test_toml_of_a_page_loads(page, text, tmp_path):
    (tmp_path / "file.toml").write_text(text, encoding="utf-8")
    table = tomllib.loads(text)
    if "signals" in table:
        assert {"de_cmd", "alpha", "left_inner.rod"} <= set(load_map(tmp_path / "file.toml")[0].signals)
    elif "base" in table:
        assert len(load_campaign(tmp_path / "file.toml").scenarios()[0]) > 1
    else:
        assert parse(table).warnings() == []


@pytest.mark.parametrize("page, text", [b for b in blocks("python") if "rfafe" not in b[1]])
def test_python_of_a_page_runs(page, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(text, shown(page), "exec"), {})


def test_command_lines_of_the_pages_parse():
    assert len(commands()) > 25
    group = get_command(cli.app)
    for page, line in commands():
        name, *words = shlex.split(line)[1:]
        if name in ("…", "NAME", "-h"):
            continue
        command = group.commands.get(name)
        assert command is not None, f"{shown(page)}: {line}"
        options = {o for p in command.params for o in (*p.opts, *p.secondary_opts)}
        assert {w for w in words if w.startswith("-")} <= options | {"-h"}, f"{shown(page)}: {line}"


def test_the_first_commands_of_the_readme_run_as_they_stand(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [line for page, line in commands() if page == ROOT / "README.md"]
    flown = [
        line for line in dict.fromkeys(lines) if not line.startswith(LONG) and not re.search("[A-Z]{3}|bench", line)
    ]
    assert len(flown) >= 8
    for line in flown:
        quick = ["--speed", "1000", "--port", "0"] * ("--live" in line)  # by the clock it would take half a minute
        result = CliRunner().invoke(cli.app, shlex.split(line)[1:] + quick)
        assert result.exit_code == 0, f"{line}: {result.output}"


def masked(text):
    """Return `text` on one line with every number as #: what a better detector or another machine may change."""
    return re.sub(r"\d[\d.,]*(?<![.,])", "#", " ".join(text.split()))


def test_the_first_run_looks_as_the_readme_explains_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    screen = masked(CliRunner().invoke(cli.app, ["run"]).stdout)
    text = (ROOT / "README.md").read_text(encoding="utf-8").partition("## What the first run says")[2]
    quoted = masked(re.search(r"^( {4}.+\n)+", text, re.M)[0])
    assert len(quoted.split()) > 20 and quoted in screen


def test_links_and_pictures_of_the_pages_are_there():
    for page in [*PAGES, ROOT / "aircraft" / "README.md", ROOT / "tests" / "README.md"]:
        text = page.read_text(encoding="utf-8")
        for link in re.findall(r"\]\(([^)#\s]+)\)", text):
            if "://" not in link:
                assert (page.parent / link).exists(), f"{shown(page)}: {link}"


def test_every_room_has_a_page_and_the_front_door_is_short():
    folders = [p.parent for d in structure.PACKAGES for p in (ROOT / d).glob("*/__init__.py")]
    assert [str(f) for f in folders if not (f / "README.md").is_file()] == []
    assert (ROOT / "README.md").stat().st_size <= 11_000
    assert (ROOT / "cosim" / "report" / "report.png").stat().st_size < 300_000
