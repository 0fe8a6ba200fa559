"""Help: whole paragraphs, no names of Python's types, nothing that only the repository has."""

import itertools
import re

import pytest
import typer
from typer.testing import CliRunner

from cosim.cli import commands as cli

COMMANDS = sorted(typer.main.get_command(cli.app).commands)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_whole_paragraphs_without_names_of_python_and_has_json(command):
    said = CliRunner().invoke(cli.app, [command, "-h"], env={"COLUMNS": "80"}).stdout
    assert not re.search(r"[{}]|<(bool|str|path|list|int|float)|\(README\)|…", said), said
    assert "--json" in said
    lines = [line.strip() for line in said.partition("╭")[0].splitlines()]
    for line, after in itertools.pairwise(lines):  # paragraphs are filled
        assert not (line and after) or len(line) + 1 + len(after.split()[0]) > 76, line
