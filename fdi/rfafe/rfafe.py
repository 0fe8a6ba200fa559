"""Robust fast adaptive fault estimator as published: y holds the elevator positions, one fault estimate per side.

    x = [V, alpha, q, theta, delta_left, delta_right],  y = x,  u = [command left, command right]      [Sun13] (37)-(41)
    f = what is added to a side's command;  a solid OFC s(t) is f = s - command

V in m/s, angles in deg, q in deg/s inside, as the paper has them; conversion stands in `step`. A side is the
mean of its two segments. The design puts its whole gain on the positions (M = [0 0 0 0 m 0]
for each side): no airframe output contributes, so this estimator is a position monitor with a model of the actuator.
That model is the first order of the paper, driven by what the servos' own limits let through of the command
(fdi/rfafe/servo.py).
`fdi.rfafe.rfafe_airframe` is the form that has to find the fault in the aircraft's motion.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from actuators.constants import RAD_PER_DEG
from fdi.common import bank
from fdi.common.decision import held, usable
from fdi.common.record import TICK, Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.rfafe import core as rfafe_core
from fdi.rfafe import segments, servo
from fdi.rfafe.core import advance, estimate, fill, learned, read_airframe
from fdi.rfafe.store import choose, lacks, read, side_kinds

ISOLABLE_PARTS = ("", "elevator_left", "elevator_right", "elevator_left and elevator_right")
# What an oscillation of the command of a side of this kind comes out as, f_hat over fault, beyond a first-order model:
# a resonance (rad/s, damping), fitted to flights with 1 deg at 0.4 to 6.1 Hz. An electromechanical side has none to
# 4.3 Hz, and at 6.1 Hz its rate limit lets half of 1 deg through
RESPONSE = {"hydraulic": (35.9, 0.327)}
FLAT = 60.0  # rad/s: with the resonance taken out f_hat is flat to there, damping 0.7
MIXED = ("hydraulic", "ema")  # segments of a side of this name

PARAMS = dtype([
    *rfafe_core.PARAMS,
    *servo.PARAMS,
    ("even", "f8", (2, 5), "-"),  # filter of each side's f_hat that takes its resonance out: b0 b1 b2 a1 a2
])
INPUTS = dtype([
    *rfafe_core.AIRFRAME_INPUTS,
    ("surface", "f8", (4,), "rad"),              # segments left_outer, left_inner, right_inner, right_outer
    ("surface_valid", "f8", (4,), "-"),
    ("command", "f8", (2,), "rad"),              # left, right, trailing edge down +
])
STATE = dtype([
    *rfafe_core.STATE,
    *servo.STATE,
    *segments.STATE,
    ("f_hat", "f8", "rad"),  # the larger of the two sides
    ("f_hat_left", "f8", "rad"),
    ("f_hat_right", "f8", "rad"),
    ("alarm_elevator_left", "f8", "-"),  # 1 while this side is declared, whatever the other is
    ("alarm_elevator_right", "f8", "-"),
    ("past", "f8", (2, 4), "rad"),  # of the filters: in, in before, out, out before
])
OUTPUTS = ("f_hat", "f_hat_left", "f_hat_right", "r", "alarm", "verdict", "isolated_part", "alarm_elevator_left",
           "alarm_elevator_right", "segment", "valid", "why")
DETECTOR = Detector(
    id="rfafe",
    level="aircraft",
    summary="robust fast adaptive fault estimator with elevator position sensors [Sun13]",
    inputs={
        "tas": "tas", "alpha": "alpha", "q": "q", "theta": "theta", "surface[0]": "left_outer.surface",
        "surface[1]": "left_inner.surface", "surface[2]": "right_inner.surface", "surface[3]": "right_outer.surface",
        "command[0]": "de_cmd", "command[1]": "de_cmd",
    },
    group="elevator positions",
    designed_for={  # [Sun13] (37)-(41): oscillatory failures; the class only where the command moved otherwise
        "*.ofc_liquid": ("ofc_liquid", "ambiguous"),
        "*.ofc_solid": ("ofc_solid", "ambiguous"),
        "*.ofc_liquid@*": ("ofc_liquid", "ambiguous"),
        "*.ofc_solid@*": ("ofc_solid", "ambiguous"),
    },
    may_see={  # anything else that moves an elevator, or its position sensor, away from the command
        **dict.fromkeys((
            "*.jam*", "*.runaway*", "*.bias@command", "*.loss_of_effectiveness*", "*.free_float",
            "*.supply_pressure_drop", "*.internal_leakage", "*.air_in_oil", "*.friction", "*.backlash",
            "*.magnet_loss", "*.winding_resistance", "*.rod", "*.position", "*.velocity", "*.surface",
        ), ("ambiguous",)),
    },
    blind="reads only the elevator positions (its whole gain stands there): no other effector and no aircraft sensor",
    estimates=(Estimate("elevator.left", "f_hat_left", "rad"), Estimate("elevator.right", "f_hat_right", "rad")),
    finer={"segment": dict(enumerate(segments.NAMES))},
    looks_back={"u_delay": "line"},
    sizes={"ns": 0, "ny": 0, "nu": 0, "nf": 0, "n_trim": 0, **bank.SIZES},
    places={"head": ("line", 0), "part_head": ("part_ring", 1), **bank.PLACES},
    design="rfafe",
    lacks=lambda technologies, own: lacks("rfafe", technologies, own),
    fit=lambda site: params(technology=side_kinds(site.technologies), dt=site.dt, response=RESPONSE,
                            own=site.own),
)


def params(
    which: str = "flight", *, stored: Any = None, technology: str = "hydraulic", dt: float = TICK, response: Any = None,
    own: Any = None,
) -> np.ndarray:  # fmt: skip
    """Return PARAMS from the stored design for `technology` of the elevators and the threshold set `which`.

    `stored` replaces `fdi/designs/rfafe.json` (same keys; without "servos": lags with a rate limit, as published).
    `response` maps the kind of a side to the resonance (rad/s, damping) that is taken out of its f_hat, None for none.
    `own` is the folder of an aircraft with designs of its own. Raises FileNotFoundError without a stored design,
    ValueError for a technology that it lacks.
    """
    stored = read("rfafe", own) if stored is None else stored
    made, chosen = choose(stored, technology, dt)
    sides = (technology.split("/") * 2)[:2]
    even = [_even((response or {}).get(kind), dt) for kind in sides]
    p = record(PARAMS, even=even, **bank.design(dt), **thresholds("rfafe", which, own))
    if "servos" in stored:
        models = [stored["servos"][kind] for name in sides for kind in side(name)]
        p["servo"] = [servo.row(model, dt) for model in models]
        p["n_forget"] = round(max(1.0 / (m["zeta"] * m["omega_rad_s"]) + m["t_lag_s"] for m in models) / dt)
        p["gain"] = chosen["actuator"]["gain"]
    return fill(p, made, chosen, dt, (1, 1, 0, 1, 1, 1))


def side(kind: str) -> tuple[str, str]:
    """Return the kinds of the two segments of a side of this kind."""
    return MIXED if kind == "mixed" else (kind, kind)


def _even(resonance, dt):
    """Return b0, b1, b2, a1, a2 of the filter that turns a resonance into a flat response to FLAT; None: of 1.

    (s^2 + 2 zeta omega s + omega^2) FLAT^2 / omega^2 / (s^2 + 1.4 FLAT s + FLAT^2) by s = 2 / dt (z - 1) / (z + 1).
    """
    if resonance is None:
        return [1.0, 0.0, 0.0, 0.0, 0.0]
    omega, zeta = resonance
    gain, c = (FLAT / omega) ** 2, 2.0 / dt
    b, a = ([c * c + one * c + two, 2.0 * (two - c * c), c * c - one * c + two]
            for one, two in ((2.0 * zeta * omega, omega**2), (1.4 * FLAT, FLAT**2)))  # fmt: skip
    return [*(gain * v / a[0] for v in b), a[1] / a[0], a[2] / a[0]]


init = zero_state(STATE)  # not yet started


@kernel
def step(x, u, p, dt):
    """Convert to the paper's units, advance the estimator, name the sides."""
    good = 1.0
    for i in range(4):
        good = min(good, usable(u.surface[i], u.surface_valid[i]))
    if good > 0.5:
        read_airframe(x, u)  # the gain on it is zero: a lost sensor of the airframe is no loss
        x.y[4] = 0.5 * (u.surface[0] + u.surface[1]) / RAD_PER_DEG
        x.y[5] = 0.5 * (u.surface[2] + u.surface[3]) / RAD_PER_DEG
    for j in range(2):
        x.u_in[j] = held(u.command[j] / RAD_PER_DEG, 1.0, x.u_in[j])
    if p.servo[0, servo.K1] == 0.0:
        advance(x, p, good, dt)
    else:
        servo.follow(x, p, dt)
        if learned(x, p, good):
            estimate(x, p, good, dt)  # its model holds beyond the rate limit, too
    if good > 0.5:
        segments.compare(x, u, p, dt)
    x.f_hat_left = _evened(x, p, 0)
    x.f_hat_right = _evened(x, p, 1)
    x.f_hat = x.f_hat_left if math.fabs(x.f_hat_left) >= math.fabs(x.f_hat_right) else x.f_hat_right
    segments.name(x, dt)
    x.alarm_elevator_left = 1.0 if x.isolated_part == 1.0 or x.isolated_part == 3.0 else 0.0
    x.alarm_elevator_right = 1.0 if x.isolated_part >= 2.0 else 0.0


@kernel
def _evened(x, p, j):
    """Return the estimate of side j through its filter."""
    b, w = p.even[j], x.past[j]
    y = b[0] * x.f[j] + b[1] * w[0] + b[2] * w[1] - b[3] * w[2] - b[4] * w[3]
    w[1], w[0], w[3], w[2] = w[0], x.f[j], w[2], y
    return y


rollout = entry(step, STATE, INPUTS, PARAMS)
