"""The detectors: a folder per method, a record per detector, and one way to run them all.

    detector = fdi.module("ema_kalman_flight")     # a block: PARAMS, INPUTS, STATE, OUTPUTS, params, init, rollout
    p = detector.params()                          # its parameters; thresholds are those of its training
    x = detector.init(p)                           # its state before the first tick
    detector.rollout(x, u, p, dt, log)             # u: (lanes, ticks) of INPUTS; log: (lanes, ticks) of STATE, filled
    fdi.record("ema_kalman_flight").estimates      # what it declares: inputs, technologies, faults, units

`cosim.fly` flies the signals that a detector reads, `cosim.flight.loop.signals.detect` runs it over them. The names
below are imported when they are first used.
"""

import importlib

__all__ = ["find", "known", "module", "record", "records"]


def __getattr__(name):
    if name not in __all__:
        raise AttributeError(f"module 'fdi' has no attribute {name!r}")
    # by name: an import that the sources show would make every kernel depend on the list of all detectors
    globals()[name] = getattr(importlib.import_module("fdi.registry"), name)
    return globals()[name]


def __dir__():
    """Return the public names, too, so that help() and completion know them."""
    return sorted({*globals(), *__all__})
