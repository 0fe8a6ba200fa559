"""A transport aircraft in JSBSim, its elevator actuators and their fault detectors in lockstep, in one replayable log.

    scenario = cosim.load_scenario("liquid-ofc", ["faults.0.frequency_hz=3"])
    result = cosim.simulate(scenario, log="flight.mcap")
    frame = cosim.open_log("flight.mcap").frame("/truth/aircraft")
    table = cosim.fly(scenario, ["truth.aircraft.nz", "hydraulic.left_inner.q_rod"])

The names below are imported when they are first used, so that `import cosim` costs nothing.
"""

import importlib
import os

# Matrices here are small: BLAS threads cost each call of a design 6 ms of waiting for one another, half a second per
# flight, and give other last digits on other machines. Read when NumPy is imported; what the user has set stands.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_PUBLIC = {  # name -> module that defines it
    "load_scenario": "cosim.scenario",
    "Scenario": "cosim.scenario",
    "simulate": "cosim.flight.simulate",
    "fly": "cosim.flight.loop.signals",
    "Flight": "cosim.flight.interactive.stepping",
    "open_log": "cosim.log",
    "register": "cosim.parts",
    "window_model": "cosim.parts.window",
    "linearize": "cosim.flight.plant.linearize",
    "CosimError": "cosim.errors",
    "Progress": "cosim.progress",
}
__all__ = [*_PUBLIC]


def __getattr__(name):
    if name == "__version__":
        value = importlib.import_module("importlib.metadata").version("cosim-fdi")
    elif name in _PUBLIC:
        value = getattr(importlib.import_module(_PUBLIC[name]), name)
    else:
        raise AttributeError(f"module 'cosim' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__():
    """Return the public names, too, so that help() and completion know them."""
    return sorted({*globals(), *__all__})
