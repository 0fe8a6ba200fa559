"""The command line: `cosim` and its commands."""

from cosim.cli.commands import app, main

__all__ = ["app", "main"]
