"""Scenarios: what flies, and what goes wrong. A TOML file in, a frozen tree of numbers out, SI by property."""

from cosim.scenario.fault import Fault, Injection
from cosim.scenario.flight import Flight
from cosim.scenario.load import DEFAULT, builtin_names, load_scenario, parse
from cosim.scenario.model import Scenario

__all__ = ["DEFAULT", "Fault", "Flight", "Injection", "Scenario", "builtin_names", "load_scenario", "parse"]
