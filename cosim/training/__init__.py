"""Designs and thresholds from the aircraft that flies: `python -m cosim.training NAME|all`."""

import importlib
from typing import Any

from cosim.errors import DesignError, did_you_mean

TRAINERS = {  # name -> (module, what it trains)
    "hydraulic": ("cosim.training.train_hydraulic", "iotsekf, rtsekf, rtsekf_flight; 5 min"),
    "monitors": ("cosim.training.train_hydraulic", "ofc_monitor, position_monitor; 5 min on two cores"),
    "aircraft": ("cosim.training.train_aircraft", "lpv_smo, control_redundancy, kinematic; 10 min"),
    "ema": ("cosim.training.train_ema", "ema_kalman_flight, position_monitor on EMAs; 5 min on two cores"),
    "rfafe": ("cosim.training.train_rfafe", "rfafe, rfafe_airframe at its design point; 15 min on two cores"),
    "joint": ("cosim.training.train_joint", "rates of joint; 5 min on two cores"),
}

NAMES = ("designs", *TRAINERS)  # in the order in which they depend on one another: joint counts what others say


def load(name: str) -> Any:
    """Return the `Training` of a name. Raises DesignError if unknown."""
    if name not in TRAINERS:
        raise DesignError(f"unknown training {name!r}", allowed=", ".join(("all", *NAMES)),
                          remedy=did_you_mean(name, NAMES))  # fmt: skip
    return importlib.import_module(TRAINERS[name][0]).TRAININGS[name]
