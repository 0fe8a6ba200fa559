"""Run the command line: python -m cosim.cli."""

from cosim.cli import main

main()
