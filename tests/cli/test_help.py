"""Help: whole paragraphs, no names of Python's types, nothing that only the repository has."""

import itertools
import re

import pytest
import typer
from typer.testing import CliRunner

from cosim.cli import commands as cli

COMMANDS = sorted(typer.main.get_command(cli.app).commands)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_speaks_of_no_python_and_no_repository(command):
    said = CliRunner().invoke(cli.app, [command, "-h"], env={"COLUMNS": "80"}).stdout
    assert not re.search(r"[{}]|<(bool|str|path|list|int|float)|\(README\)|…", said), said


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_takes_json_as_the_front_page_says(command):
    assert "--json" in CliRunner().invoke(cli.app, [command, "-h"], env={"COLUMNS": "80"}).stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_paragraphs_of_help_are_filled(command):
    said = CliRunner().invoke(cli.app, [command, "-h"], env={"COLUMNS": "80"}).stdout
    lines = [line.strip() for line in said.partition("╭")[0].splitlines()]
    for line, after in itertools.pairwise(lines):
        assert not (line and after) or len(line) + 1 + len(after.split()[0]) > 76, line
