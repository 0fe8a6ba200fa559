"""Designs that [Sun13] is compared with: without E, with E of other flights, other learning rates, other points.

They are solved here when a row asks for them (a tenth of a second each): it takes the extra `design`.
"""

import functools
from typing import Any

import numpy as np

from cosim.training import rfafe as training
from cosim.training.rfafe import RANK_E
from fdi.rfafe import rfafe

WRONG = (("Cm_alpha", 1.05), ("Cm_de", 0.95))  # coefficients of the uncertain flights
SOURCES = {  # where E comes from -> arguments of `unknown_inputs`, None for no E
    "no E": None,
    "six flights": ("none", ()),
    "six gusty flights": ("moderate", ()),
    "six flights with coefficients 5 % off": ("none", WRONG),
}


def _silent(text):
    pass


@functools.cache
def published(source: Any = "six flights", bandwidth: Any = None) -> dict[str, Any]:
    """Return the stored form of the published design, hydraulic elevators, E from one of SOURCES; `bandwidth` [rad/s]
    of the loop is proportional to the learning rate."""
    _, B, _ = training.linear()
    sides = np.stack([B[:, :2].sum(1), B[:, 2:].sum(1)], 1)
    air, position = training.sigmas()
    how = SOURCES[source]
    E = None
    if how is not None:
        E = np.vstack([rfafe.reduce_E(training.unknown_inputs(*how), RANK_E), np.zeros((2, RANK_E))])
    made = training.entry(
        "rfafe",
        "hydraulic",
        sides,
        E,
        np.eye(6),
        lambda g: g[1],
        [*air, position, position],
        _silent,
        bandwidth=bandwidth,
    )
    return {"designs": {"hydraulic": made}}


@functools.cache
def airframe(point: Any = "sun13", decoupled: Any = True) -> Any:
    """Return the stored form of the airframe design of a point; E of the design point, freed of its part along F."""
    _, B, _ = training.linear(point)
    total = B.sum(1, keepdims=True)
    air, _ = training.sigmas()
    E = None
    if decoupled:
        E = rfafe.separate(training.unknown_inputs(), total, np.eye(4), method="remove")[:, :RANK_E]
        E = np.vstack([E, np.zeros((1, E.shape[1]))])
    made = training.entry(
        "rfafe_airframe",
        "hydraulic",
        total,
        E,
        np.eye(5)[:4],
        lambda g: np.vstack([total, [[0.0]]]),
        air,
        _silent,
        point=point,
        min_ratio=0.0,
    )
    return {"designs": {"hydraulic": made}}
