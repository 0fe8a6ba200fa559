"""RTS-EKF of [Lu17] (38)-(48), its filter as published: m = 1 (the rod), p = 1, F = 1. It watches; it does not steer.

    time update       x, P                                   (38)-(39)
    output fault      f = N (y - H x),   N = (F' S^-1 F)^-1 F' S^-1    (40)-(43), (48)
    measurement       x + K (y - H x - F f),   P - K (S - F P^f F') K'  (45)-(47); (47) is printed without the transpose

With m = p = 1 and F = 1 the gain N is 1: all of the innovation is called fault, (46) corrects nothing, and the
state is the open-loop model: f = y - x1 is unbiased only while the load is exactly known. Load forms (`form` in a
scenario): "published" leaves the load out, "hinge model" (default) has a hinge-moment model. A fault of the rod sensor,
a jam and a runaway all show as f, and it does not tell them apart. The alarm is ours: f beyond its threshold, or beyond
what it was before, as what the load's model lacks drifts.

| symbol | field | meaning |
|---|---|---|
| x = (q, q', dP/P_s) | x_hat | rod [m], [m/s], [1] |
| f^o | f_hat | output fault [m] |
| P, P^f | P, P_f | covariances |
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from actuators.common import linkage
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import rk4
from fdi.common.decision import clipped, confirm, usable
from fdi.common.linalg import congruence, diagonal
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, NONE
from fdi.hydraulic.two_stage_ekf import HISTORY, force, predict_now, remember, transition

ISOLABLE_PARTS = ("",)
FORMS = {"hinge model": 1, "published": 0}  # how the load is known: load form
FASTEST = 0.5  # a rod and its model part by less: each moves at 45 deg/s of surface at most, 0.24 m/s
WILD = 2.0  # times a threshold: so far a slow error of the model is still learned, a wild sample is not [-]

PARAMS = dtype(
    [
        ("arm", "f8", "m"),  # rod arm
        *lu17.FIELDS,
        ("load", "f8"),  # 0: load ignored, as published; 1: hinge-moment model
        ("delay", "f8", "-"),  # age of the measurement, 0 to HISTORY
        ("q", "f8", (4,)),  # process noise densities [unit^2/s]
        ("r_rod", "f8", "m2"),  # variance of a rod sample
        ("P0", "f8", (4,)),  # initial variances
        ("tau", "f8", "s"),  # lag of fault and rates
        ("threshold", "f8", "m"),  # output fault
        ("step", "f8", "m"),  # output fault beyond what it was: a jam is sudden, what the load's model lacks drifts
        ("wash", "f8", "s"),  # how fast "what it was" follows
        ("t_confirm", "f8", "s"),
        ("t_release", "f8", "s"),
        ("t_invalid", "f8", "s"),
    ]
)
INPUTS = dtype(
    [
        ("u", "f8", "-"),  # valve command held over the last tick
        ("y_rod", "f8", "m"),
        ("y_rod_valid", "f8", "-"),
        ("hm0_model", "f8", "N m"),  # hinge moment at zero deflection, by the model
        ("hmd_model", "f8", "N m/rad"),  # its slope
    ]
)
STATE = dtype(
    [
        ("started", "f8", "-"),
        ("x_hat", "f8", (4,), "m, m/s, -, -"),  # the fourth is not used
        ("P", "f8", (4, 4)),
        ("Phi", "f8", (4, 4)),
        ("W", "f8", (4, 4)),  # scratch
        ("G", "f8", (4,)),
        ("K", "f8", (4,)),
        ("N", "f8", "-"),  # gain of the fault (48): 1
        ("P_f", "f8", "m2"),  # variance of the fault
        ("u_old", "f8", (HISTORY + 1,), "-"),  # newest first
        ("f_hat", "f8", "m"),  # output fault
        ("f_sigma", "f8", "m"),  # its standard deviation
        ("q_now", "f8", "m"),  # predicted rod position
        ("v_now", "f8", "m/s"),  # rod velocity
        ("x3_now", "f8", "-"),  # pressure difference
        ("f_slow", "f8", "m"),  # lagged fault
        ("f_was", "f8", "m"),  # what it was: follows by `wash` while the fault is within its thresholds
        ("timer", "f8", "s"),
        ("age", "f8", "s"),
        ("r", "f8", "-"),  # fault over its threshold
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("isolated_part", "f8", "-"),  # index into ISOLABLE_PARTS
        ("valid", "f8", "-"),  # 1 while the rod measurement is fresh
    ]
)
OUTPUTS = ("r", "alarm", "verdict", "isolated_part", "valid", "f_hat", "f_sigma", "q_now", "v_now", "x3_now")
DETECTOR = Detector(
    id="rtsekf",
    level="local",
    summary="robust three-step EKF as published: output fault of a hydraulic actuator [Lu17]",
    technologies=("hydraulic",),
    inputs={"u": "valve_command", "y_rod": "rod", "hm0_model": "hm0", "hmd_model": "hmd"},
    group="actuator filters",
    designed_for={  # [Lu17] (38)-(48): output faults
        **dict.fromkeys(
            ("hydraulic.jam_liquid", "hydraulic.rod", "hydraulic.jam_solid", "hydraulic.runaway"), ("ambiguous",)
        ),
    },
    may_see={  # an input fault integrates into the rod, and so does everything else that its model lacks
        **dict.fromkeys((
            "hydraulic.ofc_*", "hydraulic.loss_of_effectiveness", "hydraulic.free_float",
            "hydraulic.supply_pressure_drop", "hydraulic.internal_leakage", "hydraulic.air_in_oil",
            "hydraulic.friction", "hydraulic.backlash",
        ), ("ambiguous",)),
    },
    blind="compares one hydraulic rod with the open-loop model of its own valve command",
    estimates=(Estimate("rod", "f_hat", "m"),),
    looks_back={"delay": "u_old"},
    options={"form": tuple(FORMS)},  # the first is the default
    belongs={"load": "form"},
    fit=lambda site, form="hinge model": params(load=FORMS[form], dt=site.dt, **site.known(PARAMS.names)),
)


def params(
    which: str = "",
    *,
    load: float = 1,
    dt: float = 0.005,
    delay_s: float = 0.005,
    arm: float = linkage.ARM,
    **values: Any,
) -> np.ndarray:
    """Return PARAMS for load form 0 (as published) or 1; `which` names the threshold set, by default that of the load
    form; `values` replace any field.
    """
    fields = {
        **lu17.NOMINAL,
        "arm": arm,
        "load": float(load),
        "delay": float(round(delay_s / dt)),
        "q": (1e-12, 2e-6, 2e-5, 0.0),  # as `iotsekf`; here only the deviations depend on them
        "r_rod": 1e-8 * (0.005 / dt),  # 0.1 mm per 5 ms, sensor set `transport`
        "P0": (1e-8, 1e-6, 1e-4, 0.0),
        "t_invalid": 0.2,
    }
    return record(PARAMS, **{**fields, **thresholds("rtsekf", which or f"flight_load{load:g}"), **values})


init = zero_state(STATE)  # not started: the filter begins at the first usable rod sample


@kernel
def predict(x, v, F, stiffness, load_state, p, dt):
    """Predict state and covariance over one tick under valve command `v` and force `F` [N], whose own slope is
    `stiffness` [N m/rad]; `load_state`: it is that of x[3]. [Lu17] (38)-(39)"""
    a = x.x_hat
    transition(x.Phi, x.G, a, v, v, 0.0, stiffness, load_state, p, dt)
    a[0], a[1], a[2] = rk4(a[0], a[1], a[2], v, v, 0.0, F, p, dt)
    congruence(x.P, x.Phi, x.W)
    for i in range(4):
        x.P[i, i] += p.q[i] * dt


@kernel
def at_rest(x, q, z, load, p):
    """Begin at rest with rod `q`, pressure `z` and `load`."""
    a = x.x_hat
    a[0], a[1], a[2], a[3] = q, 0.0, z, load
    diagonal(x.P, p.P0)
    x.age = 0.0
    x.started = 1.0


@kernel
def correct(x, y, p):
    """Estimate the fault and update. [Lu17] (40)-(48) with H = (1, 0, 0), F = 1"""
    F = 1.0
    S = x.P[0, 0] + p.r_rod  # (40)
    gamma = y - x.x_hat[0]  # (41)
    x.P_f = 1.0 / (F / S * F)  # (43)
    x.N = x.P_f * F / S  # (48)
    x.f_hat = x.N * gamma  # (42)
    for i in range(3):
        x.K[i] = x.P[i, 0] / S  # (45)
        x.x_hat[i] += x.K[i] * (gamma - F * x.f_hat)  # (46)
    for i in range(3):
        for j in range(3):
            x.P[i, j] -= x.K[i] * (S - F * x.P_f * F) * x.K[j]  # (47)


@kernel
def decide(x, p, dt):
    """Confirm the fault."""
    x.f_slow += clipped((1.0 - math.exp(-dt / p.tau)) * (x.f_hat - x.f_slow), FASTEST * dt)
    x.r = max(math.fabs(x.f_slow) / p.threshold, math.fabs(x.f_slow - x.f_was) / p.step)
    if x.alarm < 0.5 and x.r < WILD:
        x.f_was += (1.0 - math.exp(-dt / p.wash)) * (x.f_slow - x.f_was)
    x.timer, x.alarm = confirm(x.timer, x.alarm, x.r >= 1.0, dt, p.t_confirm, p.t_release)
    x.verdict = AMBIGUOUS if x.alarm > 0.5 else NONE


@kernel
def step(x, u, p, dt):
    """Run the three steps on a measurement that is `delay` ticks old, then decide."""
    remember(x, u)
    good = usable(u.y_rod, u.y_rod_valid)
    if x.started < 0.5:
        x.valid = 0.0
        if good < 0.5:
            return
        x.x_hat[0] = u.y_rod
        at_rest(x, u.y_rod, -force(x, u, p) / (p.A_p * p.P_s), 0.0, p)
        x.f_slow = x.f_was = x.timer = 0.0
    x.age = 0.0 if good > 0.5 else x.age + dt
    x.valid = 1.0 if x.age <= p.t_invalid else 0.0
    d, slope = int(p.delay), u.hmd_model if p.load == 1.0 else 0.0
    if d == 0:
        predict(x, x.u_old[0], force(x, u, p), slope, False, p, dt)
    if good > 0.5:
        correct(x, u.y_rod, p)
    if d > 0:
        predict(x, x.u_old[d - 1], force(x, u, p), slope, False, p, dt)
    predict_now(x, 0.0, force(x, u, p), p, dt)
    x.f_sigma = math.sqrt(max(x.P_f, 0.0))
    if math.isfinite(x.q_now + x.v_now + x.x3_now + x.f_hat):
        if good > 0.5:
            decide(x, p, dt)
    else:
        x.started = 0.0
        x.f_hat = x.q_now = x.v_now = x.x3_now = 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
