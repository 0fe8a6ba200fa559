"""Numbers of a detector that its compiled code uses as indices: what comes from outside must fit its arrays.

Compiled code trusts an index; a wrong one reads or writes other memory, or ends the process. Parameters can come from a
scenario, a command line or a log, states from a log.
"""

import functools
import importlib

import numpy as np

from cosim.flight.detector_table import TABLE

LINES = ("u_old", "past", "line")  # state arrays that hold the past, newest first or as a ring
DELAYS = {"delay", "lag_ticks", "u_delay", "late"}  # parameters: how far to look back in them
STRUCTURE = {  # parameters: sizes and positions of the design; no more than what the design itself has
    *("bank_level", "bank_n", "bank_stride", "half_periods"),  # of the bank and of the oscillation monitor
    *("n_sub", "n_window", "n_lag", "n_mean"),  # of the windows of ema_kalman_flight
    *("n_families", "n_hypotheses", "n_k", "n_ka", "n_rows", "n_q", "n_a", "n_m", "n_tm", "n_tp"),  # of the force model
    *("axis", "variable", "effector", "base_row", "n_pivots", "pivot_row", "pivot_input"),
    *("ns", "ny", "nu", "nf", "n_trim"),  # of the airframe estimators
}
INDICES = DELAYS | STRUCTURE
RINGS = (  # states: where in a ring, which array that is, along which axis
    ("head", "window", 0),
    ("head", "line", 0),
    ("tail", "drifts", 0),
    ("bank_head", "bank_ring", 2),
    ("block", "n_block", 0),
)
AT_LEAST_ONE = {"bank_stride", "bank_n", "half_periods", "n_sub", "n_window", "n_lag", "n_mean"}


def parameter_range(name, module, detector, dt):
    """Return (lowest, highest) that parameter `name` of `detector` may be, both whole; None for any number."""
    if name in DELAYS:
        lines = [line for line in LINES if line in module.STATE.names]
        if not lines:
            return 0.0, np.inf
        return 0.0, module.STATE[lines[0]].shape[0] - 1.0
    if name in STRUCTURE:
        least, largest = _ends(detector, dt)[name]
        return min(float(name in AT_LEAST_ONE), least), largest
    return None


def wrong_parameter(module, detector, p, dt):
    """Return (name, value, lowest, highest) of the first index in PARAMS `p` that does not fit; None when all do."""
    for name in module.PARAMS.names:
        span = parameter_range(name, module, detector, dt)
        if span is not None and not _whole(p[name], *span):
            return name, _first(p[name], *span), *span
    return None


def wrong_state(module, x):
    """Return (name, value, lowest, highest) of the first index in STATE `x` that does not fit; None when all do."""
    names = module.STATE.names
    spans = {"culprit": len(module.CULPRITS) - 1.0}
    spans |= {name: module.STATE[ring].shape[axis] - 1.0 for name, ring, axis in RINGS if ring in names}
    if "energy" in names:  # of several estimates
        spans["suspect"] = module.STATE["energy"].shape[0] - 1.0
    for name, high in spans.items():
        if name in names and not _whole(x[name], 0.0, high):
            return name, _first(x[name], 0.0, high), 0.0, high
    return None


def _whole(values, low, high):
    values = np.asarray(values)
    return bool(np.all((values >= low) & (values <= high) & ((values == np.round(values)) | np.isinf(high))))


def _first(values, low, high):
    values = np.ravel(values)
    return float(next(v for v in values if not _whole(v, low, high)))


@functools.cache
def _ends(detector, dt):
    """Return {structure parameter: (least, largest)} over the designs of every choice a scenario has."""
    from cosim.scenario import load_scenario
    from cosim.scenario.load import DEFAULT

    scenario = load_scenario(DEFAULT)
    spec = TABLE[detector]
    module = importlib.import_module(spec.module)
    lane = next((n for n, t in scenario.elevator.technology.items() if t in spec.technologies), "aircraft")
    words = [{}] + [{name: word} for name, allowed in spec.options for word in allowed]
    made = [spec.params(module, scenario, lane, dt, **w) for w in words]
    names = STRUCTURE & set(module.PARAMS.names)
    return {n: (float(min(p[n].min() for p in made)), float(max(p[n].max() for p in made))) for n in names}
