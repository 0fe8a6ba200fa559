"""RTS-EKF of [Lu17] (38)-(48), its filter as published: m = 1 (the rod), p = 1, F = 1. It watches; it does not steer.

    time update       x, P                                   (38)-(39)
    output fault      f = N (y - H x),   N = (F' S^-1 F)^-1 F' S^-1    (40)-(43), (48)
    measurement       x + K (y - H x - F f),   P - K (S - F P^f F') K'  (45)-(47); (47) is printed without the transpose

With m = p = 1 and F = 1 the gain N is 1: all of the innovation is called fault, (46) corrects nothing, and the
state is the open-loop model: f = y - x1 is unbiased only while the load is exactly known. Load forms (`form` in a
scenario): "published" leaves the load out, "hinge model" (default) has a hinge-moment model. A fault of the rod sensor,
a jam and a runaway all show as f. The decision is ours: f beyond its threshold, or beyond what it was before, as what
the load's model lacks drifts. Its name follows from the *measured* rod: one that jumps is a sensor's, JAM_LIQUID; one
that has moved `run` away from the model without turning is RUNAWAY, until it comes back; one that has not moved since
the alarm, and rests while the model moves, is JAM_SOLID; else AMBIGUOUS: an oscillation, a rod that creeps.

| symbol | field | meaning |
|---|---|---|
| x = (q, q', dP/P_s) | x_hat | rod [m], [m/s], [1] |
| f^o | f_hat | output fault [m] |
| P, P^f | P, P_f | covariances |
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import rk4
from fdi.common.decision import clipped, confirm, held, usable
from fdi.common.linalg import congruence
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, JAM_LIQUID, JAM_SOLID, NONE, RUNAWAY
from fdi.hydraulic.two_stage_ekf import HISTORY, predict_now, remember, transition

ISOLABLE_PARTS = ("", "rod")
FORMS = {"hinge model": 1, "published": 0}  # how the load is known: load form
FASTEST = 0.5  # a rod and its model part by less: each moves at 45 deg/s of surface at most, 0.24 m/s
WILD = 2.0  # times a threshold: so far a slow error of the model is still learned, a wild sample is not [-]
ALONE = 0.4  # a rod that oscillates at 10 Hz by a foreign valve command is slower [m/s]
MOVED = 0.3e-3  # a lagged rod that has moved further has moved: eight sigma [m]
STILL = 0.15e-3  # one that has moved less in `t_rest` is at rest [m]
JUMP = 1e-3  # in one tick: a sensor's, no rod's; ten sigma of the sensor [m]
LARGEST = 10.0 * JUMP  # beyond it a jump is not remembered longer: a wild sample may be kilometres away [m]

PARAMS = dtype(
    [
        ("arm", "f8", "m"),  # rod arm
        *lu17.FIELDS,
        ("load", "f8"),  # 0: load ignored, as published; 1: hinge-moment model
        ("delay", "f8", "-"),  # age of the measurement, 0 to HISTORY
        ("q", "f8", (3,)),  # process noise densities [unit^2/s]
        ("r_rod", "f8", "m2"),  # variance of a rod sample
        ("P0", "f8", (3,)),  # initial variances
        ("tau", "f8", "s"),  # lag of fault and rates
        ("threshold", "f8", "m"),  # output fault
        ("step", "f8", "m"),  # output fault beyond what it was: a jam is sudden, what the load's model lacks drifts
        ("wash", "f8", "s"),  # how fast "what it was" follows
        ("run", "f8", "m"),  # measured rod so far away from the model without turning: a runaway
        ("t_rest", "f8", "s"),  # at rest for so long while the model moves at `rate`: a jam
        ("rate", "f8", "m/s"),
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
        ("y", "f8", "m"),  # last usable rod
        ("f_hat", "f8", "m"),  # output fault
        ("f_sigma", "f8", "m"),  # its standard deviation
        ("q_now", "f8", "m"),  # predicted rod position
        ("v_now", "f8", "m/s"),  # rod velocity
        ("x3_now", "f8", "-"),  # pressure difference
        ("f_slow", "f8", "m"),  # lagged fault
        ("f_last", "f8", "m"),  # fault at the tick before
        ("y_last", "f8", "m"),  # rod at the tick before
        ("jump", "f8", "m"),  # largest change of the fault in a tick beyond what a rod can do
        ("f_was", "f8", "m"),  # what it was: follows by `wash` while the fault is within its thresholds
        ("y_slow", "f8", "m"),  # lagged rod
        ("rest", "f8", "m"),  # where the lagged rod last moved
        ("rest_time", "f8", "s"),  # since then
        ("leave", "f8", "m"),  # where it began to move away from the model
        ("far", "f8", "m"),  # how far it came
        ("v_slow", "f8", "m/s"),  # lagged velocity of the model
        ("began", "f8", "m"),  # lagged rod when the alarm rose
        ("moved", "f8", "-"),  # 1 when it has moved since: no jam
        ("way", "f8", "-"),  # the side to which a runaway runs, +1 or -1
        ("end", "f8", "m"),  # how far it came
        ("turned", "f8", "-"),  # 1 when it came back: no runaway
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
        **dict.fromkeys(("hydraulic.jam_liquid", "hydraulic.rod"), ("jam_liquid",)),
        "hydraulic.jam_solid": ("jam_solid",),
        "hydraulic.runaway": ("runaway",),
    },
    may_see={  # an input fault integrates into the rod, and so does everything else that its model lacks
        **dict.fromkeys((
            "hydraulic.ofc_*", "hydraulic.loss_of_effectiveness", "hydraulic.free_float",
            "hydraulic.supply_pressure_drop", "hydraulic.internal_leakage", "hydraulic.air_in_oil",
        ), ()),
        "hydraulic.friction": ("jam_solid",),
        "hydraulic.backlash": (),
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
        "q": (1e-12, 2e-6, 2e-5),  # as `iotsekf`; here only the deviations depend on them
        "r_rod": 1e-8 * (0.005 / dt),  # 0.1 mm per 5 ms, sensor set `transport`
        "P0": (1e-8, 1e-6, 1e-4),
        "t_invalid": 0.2,
    }
    return record(PARAMS, **{**fields, **thresholds("rtsekf", which or f"flight_load{load:g}"), **values})


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not started: the filter begins at the first usable rod sample."""
    return np.zeros(p.shape, STATE)


@kernel
def force(x, u, p):
    """Return the external force on the rod [N]."""
    if p.load == 1.0:
        return (u.hm0_model + u.hmd_model * x.x_hat[0] / p.arm) / p.arm
    return 0.0


@kernel
def predict(x, u, v, p, dt):
    """Predict state and covariance over one tick. [Lu17] (38)-(39)"""
    a = x.x_hat
    transition(x.Phi, x.G, a, v, v, 0.0, u.hmd_model if p.load == 1.0 else 0.0, False, p, dt)
    a[0], a[1], a[2] = rk4(a[0], a[1], a[2], v, v, 0.0, force(x, u, p), p, dt)
    congruence(x.P, x.Phi, x.W)
    for i in range(3):
        x.P[i, i] += p.q[i] * dt


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
def start(x, u, p):
    """Begin at the measurement, at rest, in equilibrium with the load."""
    for i in range(4):
        x.x_hat[i] = 0.0
        for j in range(4):
            x.P[i, j] = 0.0
    for i in range(3):
        x.P[i, i] = p.P0[i]
    x.x_hat[0] = u.y_rod
    x.x_hat[2] = -force(x, u, p) / (p.A_p * p.P_s)
    x.y = x.y_last = x.y_slow = x.rest = x.leave = x.far = u.y_rod
    x.f_slow = x.f_was = x.f_last = x.jump = x.timer = x.age = 0.0
    x.started = 1.0


@kernel
def name(x, away, p):
    """Name an alarm by the motion of the measured rod since it rose; `away`: the side on which the rod is, +1 or -1."""
    if math.fabs(x.y_slow - x.began) > MOVED:
        x.moved = 1.0
    if x.verdict == RUNAWAY:
        x.end = x.way * max(x.way * x.end, x.way * x.y_slow)
        if x.way * (x.end - x.y_slow) > 0.5 * p.run:
            x.verdict, x.turned = AMBIGUOUS, 1.0
    elif x.verdict == AMBIGUOUS:
        if x.jump > JUMP:
            x.verdict = JAM_LIQUID
        elif x.turned < 0.5 and math.fabs(x.far - x.leave) > p.run:
            x.verdict, x.way, x.end = RUNAWAY, away, x.far
        elif x.moved < 0.5 and x.rest_time >= p.t_rest and math.fabs(x.v_slow) > p.rate:
            x.verdict = JAM_SOLID


@kernel
def decide(x, p, dt):
    """Confirm the fault and name it by the motion of the measured rod."""
    a = 1.0 - math.exp(-dt / p.tau)
    jump = min(math.fabs(x.f_hat - x.f_last) - FASTEST * dt, math.fabs(x.y - x.y_last) - ALONE * dt)
    x.jump = max(min(jump, LARGEST), x.jump * math.exp(-dt / (4.0 * p.t_confirm)))
    x.f_last, x.y_last = x.f_hat, x.y
    x.f_slow += clipped(a * (x.f_hat - x.f_slow), FASTEST * dt)  # a few wild samples move it little
    x.y_slow += a * (x.y - x.y_slow)
    x.v_slow += a * (x.x_hat[1] - x.v_slow)
    x.rest_time += dt
    if math.fabs(x.y_slow - x.rest) > STILL:
        x.rest, x.rest_time = x.y_slow, 0.0
    away = math.copysign(1.0, x.f_slow)
    if (x.y_slow - x.leave) * away < 0.0 or (x.far - x.y_slow) * away > MOVED:
        x.leave = x.far = x.y_slow
    elif (x.y_slow - x.far) * away > 0.0:
        x.far = x.y_slow
    x.r = max(math.fabs(x.f_slow) / p.threshold, math.fabs(x.f_slow - x.f_was) / p.step)
    if x.alarm < 0.5 and x.r < WILD:
        x.f_was += (1.0 - math.exp(-dt / p.wash)) * (x.f_slow - x.f_was)
    before = x.alarm
    x.timer, x.alarm = confirm(x.timer, x.alarm, x.r >= 1.0, dt, p.t_confirm, p.t_release)
    if x.alarm < 0.5:
        x.verdict = NONE
    else:
        if before < 0.5:
            x.verdict, x.began, x.moved, x.turned = AMBIGUOUS, x.y_slow, 0.0, 0.0
        name(x, away, p)
    x.isolated_part = 1.0 if x.verdict == JAM_LIQUID else 0.0


@kernel
def step(x, u, p, dt):
    """Run the three steps on a measurement that is `delay` ticks old, then decide."""
    remember(x, u)
    good = usable(u.y_rod, u.y_rod_valid)
    if x.started < 0.5:
        x.valid = 0.0
        if good < 0.5:
            return
        start(x, u, p)
    x.y = held(u.y_rod, u.y_rod_valid, x.y)
    x.age = 0.0 if good > 0.5 else x.age + dt
    x.valid = 1.0 if x.age <= p.t_invalid else 0.0
    d = int(p.delay)
    if d == 0:
        predict(x, u, x.u_old[0], p, dt)
    if good > 0.5:
        correct(x, u.y_rod, p)
    if d > 0:
        predict(x, u, x.u_old[d - 1], p, dt)
    predict_now(x, 0.0, force(x, u, p), p, dt)
    x.f_sigma = math.sqrt(max(x.P_f, 0.0))
    if math.isfinite(x.q_now + x.v_now + x.x3_now + x.f_hat):
        if good > 0.5:
            decide(x, p, dt)
    else:
        x.started = 0.0
        x.f_hat = x.q_now = x.v_now = x.x3_now = 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
