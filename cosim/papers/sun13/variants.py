"""Designs that [Sun13] is compared with: without E, with E of other flights, other learning rates, other points, a fit.

They are solved here when a row asks for them (a tenth of a second each): it takes the extra `design`.
"""

import dataclasses
import functools
from typing import Any

import numpy as np

from cosim.training import rfafe as training
from cosim.training.rfafe import RANK_E
from fdi.rfafe import rfafe
from fdi.rfafe.discrete import discretise
from fdi.rfafe.store import from_plain, to_plain
from fdi.rfafe.synthesis import G_SHARE

WRONG = (("Cm_alpha", 1.05), ("Cm_de", 0.95))  # coefficients of the uncertain flights
SOURCES = {  # where E comes from -> arguments of `unknown_inputs`, None for no E
    "no E": None,
    "six flights": ("none", ()),
    "six gusty flights": ("moderate", ()),
    "six flights with coefficients 5 % off": ("none", WRONG),
}


@functools.cache
def published(source: Any = "six flights", bandwidth: Any = None) -> dict[str, Any]:
    """Return the stored form of the published design, hydraulic elevators, E from one of SOURCES; `bandwidth` [rad/s]
    of the loop is proportional to the learning rate."""
    E = _unknown(source)
    if E is not None:
        E = np.vstack([rfafe.reduce_E(E, RANK_E), np.zeros((2, RANK_E))])
    made = training.entry("rfafe", "hydraulic", E, bandwidth=bandwidth)
    return {"designs": {"hydraulic": made}}


@functools.cache
def coupled(source: str = "six flights", cross: float = 0.7) -> dict[str, Any]:
    """Return the stored form of the published design with N = -20 I and a P that couples q and the actuator states.

    P = 2 I with `cross` between q and both: any P that meets (15), (16) is the paper's, our solver's is block-diagonal.
    """
    held = published(source)["designs"]["hydraulic"]
    d = from_plain(held["design"])
    P, N, TF = 2.0 * np.eye(6), -20.0 * np.eye(6), d.T @ d.F
    P[2, 4:] = P[4:, 2] = cross
    K1, X = d.T @ d.A - N, TF.T @ P @ TF  # (7) with C = I
    made = {"N": N, "K1": K1, "K2": N @ d.H, "K": K1 + N @ d.H, "P": P, "Y": P @ K1, "M": TF.T @ P}  # (4), (6), (16)
    made |= {"G": G_SHARE * d.theta * X, "Gamma": training.BANDWIDTH["rfafe"] * np.linalg.inv(X)}
    discrete = discretise(N=N, T=d.T, K=made["K"], H=d.H, C=d.C, B=d.B, D=d.D, TF=TF, gain=made["Gamma"] @ made["M"],
                          alpha=d.alpha, dt=d.dt)  # fmt: skip
    return {"designs": {"hydraulic": held | {"design": to_plain(dataclasses.replace(d, **made, discrete=discrete))}}}


def _unknown(source):
    """Return E of one of SOURCES, or None."""
    how = SOURCES[source]
    return None if how is None else training.unknown_inputs(*how)


@functools.cache
def airframe(point: str = "sun13", source: str = "six flights") -> Any:
    """Return the stored form of the airframe design of a point; E of the design point, freed of its part along F."""
    A, B, _ = training.linear(point)
    return _airframe(A, B, _unknown(source))


def _airframe(A, B, E):
    E = None if E is None else training.freed(E, B)
    made = training.entry("rfafe_airframe", "hydraulic", E, A=A, B=B, min_ratio=0.0)
    return {"designs": {"hydraulic": made}}
