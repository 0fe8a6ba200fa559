"""The detectors that ship, one line each, and the user detectors that this process has been given.

A record is read from its module when it is first asked for. A user detector (cosim/parts) is a module, or an object
with the same names; of one that only a log tells about there is the record alone.
"""

import importlib
from typing import Any

from fdi.common.record import Detector

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
    "joint": "fdi.joint.joint",
}
ON_REQUEST = ("rfafe_airframe", "rtsekf", "ema_kalman")  # as published: fly only where a scenario enables them
DEFAULT = tuple(name for name in SHIPPED if name not in ON_REQUEST)  # fly where a scenario names no detectors
USER_DETECTORS: dict[str, Any] = {}  # id -> module, or an object with the same names
_TOLD: dict[str, Detector] = {}  # id -> record of a user detector whose code is not here


def module(name: str) -> Any:
    """Return the module of detector `name`. KeyError for an unknown one."""
    return USER_DETECTORS[name] if name in USER_DETECTORS else importlib.import_module(SHIPPED[name])


def record(name: str) -> Detector:
    """Return the record of detector `name`. KeyError for an unknown one."""
    return module(name).DETECTOR


def known(name: str) -> bool:
    """Tell whether detector `name` can run in this process."""
    return name in SHIPPED or name in USER_DETECTORS


def find(name: str) -> Detector | None:
    """Return the record of detector `name`, also of a user's that only a log tells about; None for an unknown one."""
    return record(name) if known(name) else _TOLD.get(name)


def tell(own: Detector) -> None:
    """Take the record of a user detector from a log, without its code."""
    _TOLD[own.id] = own


def records() -> dict[str, Detector]:
    """Return {id: record} of all detectors that can run, in their order."""
    return {name: record(name) for name in (*SHIPPED, *USER_DETECTORS)}
