"""The command line: `cosim` and its commands."""

import sys


def main():
    """Run the command line; Ctrl-C ends it with 130, while its modules load as well."""
    try:
        from cosim.cli.commands import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    run()
