"""Robust fast adaptive fault estimator on the aircraft's motion only: V, alpha, q, theta, no elevator position.

    x = [V, alpha, q, theta, delta],  y = [V, alpha, q, theta],  u = command,  F = [B_u; 0]         [Sun13] (1), (39)
    f = deviation of the mean elevator from what the command asks for; left and right are parallel columns, so the
    side is not to be had

What f_hat holds of an airframe that is not that of the design's flight point is learned in the first seconds and taken
out of what is judged (fdi/rfafe/correction.py); `f_hat` itself is as published.

A solid OFC of one side is half of s - u in the mean, so that neither f_hat nor f_hat + u is a sine: the class is not
to be had either, and the margin of the decision is set so that it is never named. The command goes through the
actuator's model, never the measured surface. V in m/s, angles in deg, q in deg/s inside.
"""

from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.constants import RAD_PER_DEG
from fdi.common import bank
from fdi.common.decision import held
from fdi.common.envelope import ALPHA, FLYING, PITCH, PITCH_RATE, box
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.common.why import BOX_ALPHA, BOX_PITCH, BOX_SPEED, VALID
from fdi.rfafe import core as rfafe_core
from fdi.rfafe.core import advance, airframe_usable, fill_stored, read_airframe
from fdi.rfafe.store import choose, lacks, read, side_kinds

CULPRITS = ("", "elevator")
DT = 0.005  # base tick [s]

PARAMS = dtype(rfafe_core.PARAMS)
INPUTS = dtype([
    *rfafe_core.AIRFRAME_INPUTS,
    ("command", "f8", "rad"),  # elevator, trailing edge down +
])
STATE = dtype([
    *rfafe_core.STATE,
    ("f_hat", "f8", "rad"),  # mean over the four segments
])
OUTPUTS = ("f_hat", "r", "alarm", "verdict", "culprit", "valid", "why")
DETECTOR = Detector(
    id="rfafe_airframe",
    level="aircraft",
    summary="fast adaptive fault estimator on airframe outputs only",
    inputs={"tas": "tas", "alpha": "alpha", "q": "q", "theta": "theta", "command": "de_cmd"},
    group="airframe motion",
    designed_for={  # [Sun13] (1), (39), the fault has to show in the aircraft's motion
        **dict.fromkeys(("*.ofc_liquid", "*.ofc_solid", "*.ofc_liquid@*", "*.ofc_solid@*"), ("ambiguous",)),
    },
    may_see={
        **dict.fromkeys((
            "*.jam*", "*.runaway*", "*.bias@command", "*.loss_of_effectiveness*", "*.free_float",
            "*.supply_pressure_drop", "*.rod", "*.position", "*.velocity", "stabiliser", "engine", "sensor.alpha",
            "sensor.q", "sensor.theta", "sensor.tas",
        ), ("ambiguous",)),
    },
    blind="reads speed, angle of attack, pitch rate and attitude: nothing lateral, nothing inside an actuator "
    "that the surface does not follow",
    estimates=(Estimate("elevator", "f_hat", "rad"),),
    looks_back={"u_delay": "line"},
    sizes={"ns": 0, "ny": 0, "nu": 0, "nf": 0, "n_trim": 0, **bank.SIZES},
    places={"head": ("line", 0), **bank.PLACES, "suspect": ("energy", 0)},
    design="rfafe_airframe",
    lacks=lambda technologies, own: lacks("rfafe_airframe", technologies, own),
    # moments are scaled by (V / V where the correction was learned)^2, and linear in the others; how far they are so in
    # the angle of attack, and how steep a turn may be, is decided on slow parts (fdi/rfafe/correction.py)
    range={"tas": FLYING, "alpha": ALPHA, "q": PITCH_RATE, "theta": PITCH},
    fit=lambda site: params(technology=side_kinds(site.technologies), dt=site.dt, own=site.own),
)


def params(
    which: str = "", *, stored: Any = None, technology: str = "hydraulic", trim: Any = None, dt: float = DT,
    own: Any = None,
) -> np.ndarray:
    """Return PARAMS from the stored design and threshold set `which`; arguments as in `fdi.rfafe.rfafe.params`.

    Default is the set "flight", with the correction of `fdi.rfafe.correction`; for a `stored` design of one's own
    "design_point", without it: what the correction starts from is known for the shipped design only.
    """
    which = which or ("flight" if stored is None else "design_point")
    design, chosen = choose(read("rfafe_airframe", own) if stored is None else stored, technology, dt)
    ratios = (design.A[2, 1] / design.F[2, 0], design.A[2, 2] / design.F[2, 0], 1.0, 0.0)
    p = record(PARAMS, **bank.design(dt), **thresholds("rfafe_airframe", which, own), own=ratios,
               omega_f=design.report.bandwidth[0])  # fmt: skip
    return fill_stored(p, design, chosen, dt, trim, (1, 1, 0, 1))


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not yet started."""
    return np.zeros(p.shape, STATE)


@kernel
def step(x, u, p, dt):
    """Convert to the paper's units and advance the estimator."""
    beyond = box(u.tas, u.tas_valid, FLYING[0], FLYING[1], BOX_SPEED, VALID)
    beyond = box(u.alpha, u.alpha_valid, ALPHA[0], ALPHA[1], BOX_ALPHA, beyond)
    beyond = box(u.q, u.q_valid, PITCH_RATE[0], PITCH_RATE[1], BOX_PITCH, beyond)
    beyond = box(u.theta, u.theta_valid, PITCH[0], PITCH[1], BOX_PITCH, beyond)
    good = airframe_usable(u) if beyond == VALID else 0.0  # out of range nothing is learned, as without a sample
    if good > 0.5:
        read_airframe(x, u, p)
    x.u_in[0] = held(u.command / RAD_PER_DEG - p.u_trim[0], 1.0, x.u_in[0])
    advance(x, p, good, dt)
    if beyond != VALID:
        x.why = beyond
    x.f_hat = x.f[0]


rollout = entry(step, STATE, INPUTS, PARAMS)
