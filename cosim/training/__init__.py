"""Designs and thresholds from the aircraft that flies: `python -m cosim.training NAME|all`."""

import importlib
from typing import Any

from cosim.errors import DesignError, did_you_mean

TRAINERS = {  # name -> (its Training, what it trains)
    "hydraulic": ("train_hydraulic.FILTERS", "iotsekf, rtsekf, rtsekf_flight; 5 min"),
    "monitors": ("train_hydraulic.MONITORS", "ofc_monitor, position_monitor; 5 min on two cores"),
    "aircraft": ("train_aircraft.TRANSPORT", "lpv_smo, control_redundancy, kinematic; 10 min"),
    "ema": ("train_ema.EMA", "ema_kalman_flight; 5 min on two cores"),
    "rfafe": ("train_rfafe.RFAFE", "rfafe, rfafe_airframe at its design point; 15 min on two cores"),
    "joint": ("train_joint.JOINT", "rates of joint; 5 min on two cores"),
}

NAMES = ("designs", *TRAINERS)  # in the order in which they depend on one another: joint counts what others say


def load(name: str) -> Any:
    """Return the `Training` of a name. Raises DesignError if unknown."""
    if name not in TRAINERS:
        raise DesignError(f"unknown training {name!r}", allowed=", ".join(("all", *NAMES)),
                          remedy=did_you_mean(name, NAMES))  # fmt: skip
    module, _, training = TRAINERS[name][0].partition(".")
    return getattr(importlib.import_module(f"cosim.training.{module}"), training)
