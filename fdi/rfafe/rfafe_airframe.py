"""Robust fast adaptive fault estimator on the aircraft's motion only: V, alpha, q, theta, no elevator position.

    x = [V, alpha, q, theta, delta],  y = [V, alpha, q, theta],  u = command,  F = [B_u; 0]         [Sun13] (1), (39)
    f = deviation of the mean elevator from what the command asks for; left and right are parallel columns, so the
    side is not to be had

Design and thresholds are for one flight point. Elsewhere, in gusts and manoeuvres f_hat holds the difference of the
pitching moment as well, about 1 deg in moderate turbulence.

A solid OFC of one side is half of s - u in the mean, so that neither f_hat nor f_hat + u is a sine: the class is not
to be had either, and the margin of the decision is set so that it is never named. The command goes through the
actuator's model, never the measured surface. V in m/s, angles in deg, q in deg/s inside.
"""


import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from actuators.constants import RAD_PER_DEG
from fdi.common import bank
from fdi.common.decision import held, usable
from fdi.common.record import TICK, Detector, Estimate
from fdi.common.tuning import Folder, thresholds
from fdi.rfafe import core as rfafe_core
from fdi.rfafe.core import advance, fill, read_airframe
from fdi.rfafe.store import choose, lacks, read, side_kinds

ISOLABLE_PARTS = ("", "elevator")

PARAMS = dtype(rfafe_core.PARAMS)
INPUTS = dtype([
    *rfafe_core.AIRFRAME_INPUTS,
    ("command", "f8", "rad"),  # elevator, trailing edge down +
])
STATE = dtype([
    *rfafe_core.STATE,
    ("f_hat", "f8", "rad"),  # mean over the four segments
])
OUTPUTS = ("f_hat", "r", "alarm", "verdict", "isolated_part", "valid", "why")
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
    places={"head": ("line", 0), **bank.PLACES},
    design="rfafe_airframe",
    lacks=lambda technologies, own: lacks("rfafe_airframe", technologies, own),
    fit=lambda site: params(technology=side_kinds(site.technologies), dt=site.dt, own=site.own),
)


def params(
    which: str = "flight", *, stored: dict | None = None, technology: str = "hydraulic", dt: float = TICK,
    own: Folder = None,
) -> np.ndarray:  # fmt: skip
    """Return PARAMS from the stored design and threshold set `which`; arguments as in `fdi.rfafe.rfafe.params`."""
    design, chosen = choose(read("rfafe_airframe", own) if stored is None else stored, technology, dt)
    p = record(PARAMS, **bank.design(dt), **thresholds("rfafe_airframe", which, own))
    return fill(p, design, chosen, dt, (1, 1, 0, 1))


init = zero_state(STATE)  # not yet started


@kernel
def step(x, u, p, dt):
    """Convert to the paper's units and advance the estimator."""
    good = min(min(usable(u.tas, u.tas_valid), usable(u.alpha, u.alpha_valid)),
               min(usable(u.q, u.q_valid), usable(u.theta, u.theta_valid)))  # fmt: skip
    if good > 0.5:
        read_airframe(x, u)
    x.u_in[0] = held(u.command / RAD_PER_DEG, 1.0, x.u_in[0])
    advance(x, p, good, dt)
    x.f_hat = x.f[0]


rollout = entry(step, STATE, INPUTS, PARAMS)
