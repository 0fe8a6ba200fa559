"""The detectors that ship, one line each. A record is read from its module when it is first asked for."""

import functools
import importlib

SHIPPED = {  # id -> module
    "rfafe": "fdi.rfafe.rfafe",
    "rfafe_airframe": "fdi.rfafe.rfafe_airframe",
    "lpv_smo": "fdi.lpv_smo.lpv_smo",
    "control_redundancy": "fdi.control_redundancy.control_redundancy",
    "kinematic": "fdi.kinematic.kinematic",
    "iotsekf": "fdi.hydraulic.iotsekf",
    "rtsekf": "fdi.hydraulic.rtsekf",
    "rtsekf_flight": "fdi.hydraulic.rtsekf_flight",
    "ema_kalman": "fdi.ema.ema_kalman",
    "ema_kalman_flight": "fdi.ema.ema_kalman_flight",
    "position_monitor": "fdi.monitors.position_monitor",
    "ofc_monitor": "fdi.monitors.ofc_monitor",
}


@functools.cache
def module(name):
    """Return the module of detector `name`. KeyError for one that is none."""
    return importlib.import_module(SHIPPED[name])


def record(name):
    """Return the record of detector `name`. KeyError for one that is none."""
    return module(name).DETECTOR


def records():
    """Return {id: record} of all detectors, in their order."""
    return {name: record(name) for name in SHIPPED}
