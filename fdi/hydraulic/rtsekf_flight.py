"""RTS-EKF fit for flight: [Lu17] (38)-(48) with m = 2, rod and surface position, p = 1, and the load as a random walk.

    x = (q, q', dP/P_s, F),   y = (rod, arm surface + rigging),   H = [[1 0 0 0], [1 0 0 0]],   F_k = (1, 0)' or (0, 1)'

The three steps are those of `rtsekf`, with a second sensor that is not called fault: (46) corrects the state by
what the fault leaves over, so that the estimate does not drift whatever the load. F_k names the rod until the
surface sensor is blamed, then the surface. The differential pressure, where valid, is a third measurement without
a fault (it does not replace the second position: 1 % of bias drifts 8 mm). A jam or a runaway moves both position
sensors alike, and this detector stays quiet.

Alarm and isolated_part come from `decision.pair_test`: rod against surface, and each against the motion that valve and
pressure imply. The rigging of the surface sensor is learned over the first second and slowly after it, the length of
its lever while rod and surface move; a fault that is there from the start is taken for rigging.

The threshold is that of the noise that flights are trained with. Where the second difference of rod less surface, in
which no motion is, shows more, the threshold is larger in proportion to the noise's standard deviation.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from actuators.common import linkage
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import opening, stiffness
from fdi.common import decision
from fdi.common.decision import usable
from fdi.common.linalg import joseph
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, NONE, SENSOR
from fdi.hydraulic.rtsekf import at_rest, predict
from fdi.hydraulic.two_stage_ekf import HISTORY, predict_now, remember

ISOLABLE_PARTS = ("", "rod", "surface")
TRAINED = 1.2 * 1.2  # variance of the noise in training flights over the specified one (`noise_scale` of the trainer)
MOVES = 0.04  # rod velocity from which on the lag is learned: six deviations of its estimate [m/s]
NOISE_LAG = 10.0  # lag of the noise that is seen [s]: longer than a fault takes to be found
NOISE_MOST = 50.0  # of the specified variance that one sample counts for: the square of 3.5 sigma at noise x 2

PARAMS = dtype(
    [
        ("arm", "f8", "m"),  # rod arm
        *lu17.FIELDS,
        ("delay", "f8", "-"),  # age of the measurements, 0 to HISTORY
        ("q", "f8", (4,)),  # process noise densities [unit^2/s]
        ("r_rod", "f8", "m2"),  # variance of a rod sample
        ("r_surface", "f8", "m2"),  # of a surface sample, as rod
        ("r_dp", "f8", "-"),  # of a pressure sample
        ("P0", "f8", (4,)),  # initial variances
        ("gate", "f8"),  # innovation of surface or pressure beyond so many sigma is refused
        ("t_invalid", "f8", "s"),
        *decision.PAIR_PARAMS,
    ]
)
INPUTS = dtype(
    [
        ("u", "f8", "-"),  # valve command held over the last tick
        ("y_rod", "f8", "m"),
        ("y_rod_valid", "f8", "-"),
        ("y_surface", "f8", "rad"),
        ("y_surface_valid", "f8", "-"),
        ("y_dp", "f8", "-"),  # pressure difference over supply
        ("y_dp_valid", "f8", "-"),
    ]
)
STATE = dtype(
    [
        ("started", "f8", "-"),
        ("x_hat", "f8", (4,), "m, m/s, -, -"),  # rod [m], [m/s], [1], external force over stall force [1]
        ("P", "f8", (4, 4)),
        ("Phi", "f8", (4, 4)),
        ("W", "f8", (4, 4)),  # scratch
        ("G", "f8", (4,)),
        ("K", "f8", (4,)),  # scratch
        ("N", "f8", (2,), "-"),  # gain of the fault (48)
        ("P_f", "f8", "m2"),  # variance of the fault
        ("u_old", "f8", (HISTORY + 1,), "-"),  # newest first
        *decision.PAIR_STATE,
        *decision.LEVER_STATE,
        ("apart_last", "f8", (2,), "m"),  # rod less surface of the last two ticks, newest first
        ("apart_run", "f8", "-"),  # ticks in a row that had both, at most 3
        ("noise_seen", "f8", "-"),  # variance of its noise over the specified one
        ("noise_time", "f8", "s"),  # that it was learned over, at most NOISE_LAG
        ("f_hat", "f8", "m"),  # fault of the suspected position sensor, rod or surface, as rod
        ("f_sigma", "f8", "m"),  # its standard deviation
        ("q_now", "f8", "m"),  # predicted rod position
        ("v_now", "f8", "m/s"),  # rod velocity
        ("x3_now", "f8", "-"),  # pressure difference
        ("refused", "f8", "-"),  # samples refused in a row
        ("age", "f8", "s"),  # since a healthy position sample
        ("r", "f8", "-"),  # disagreement of both sensors over its threshold
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("isolated_part", "f8", "-"),  # index into ISOLABLE_PARTS
        ("valid", "f8", "-"),  # 1 while the estimate can be trusted
    ]
)
OUTPUTS = (
    *("r", "alarm", "verdict", "isolated_part", "valid", "f_hat", "f_sigma", "q_now", "v_now", "x3_now"),
    *("pair_d", "rigging", "e_rod", "e_surface"),
)
DETECTOR = Detector(
    id="rtsekf_flight",
    level="local",
    summary="three-step EKF fit for flight: rod against surface position",
    technologies=("hydraulic",),
    inputs={"u": "valve_command", "y_rod": "rod", "y_surface": "surface", "y_dp": "pressure"},
    group="actuator filters",
    designed_for={
        **dict.fromkeys((
            "hydraulic.jam_liquid", "hydraulic.rod", "hydraulic.surface", "hydraulic.ofc_liquid@sensor",
        ), ("sensor",)),
    },
    may_see={
        "hydraulic.backlash": ("sensor", "ambiguous"),
    },
    blind="compares rod with surface: a jam or a runaway moves both alike, and it must stay quiet",
    estimates=(Estimate("rod", "f_hat", "m"), Estimate("surface", "f_hat", "m")),
    looks_back={"delay": "u_old"},
    fit=lambda site: params(dt=site.dt, **site.known(PARAMS.names)),
)


def params(
    which: str = "flight", *, dt: float = 0.005, delay_s: float = 0.005, arm: float = linkage.ARM, **values: Any
) -> np.ndarray:
    """Return PARAMS for ticks of `dt` seconds and measurements `delay_s` old; `values` replace any field."""
    share = 0.005 / dt  # the sensors' noise density is that of samples of 5 ms at every rate
    fields = {
        **lu17.NOMINAL,
        "arm": arm,
        "delay": float(round(delay_s / dt)),
        "q": (1e-12, 2e-5, 2e-3, 0.5),  # wider than `iotsekf`: here no fault state takes up what the valve does wrong
        "r_rod": 1e-8 * share,  # 0.1 mm, sensor set `transport`
        "r_surface": 1.1e-8 * share * (arm / linkage.ARM) * (arm / linkage.ARM),  # 0.02 deg, 0.1 mm on 0.30 m
        "r_dp": 2.5e-5 * share,  # 0.5 % of supply
        "P0": (1e-8, 1e-6, 1e-4, 1e-2),
        "gate": 12.0,
        "t_invalid": 0.2,
    }
    return record(PARAMS, **{**fields, **thresholds("rtsekf_flight", which), **values})


init = zero_state(STATE)  # not started: the filter begins at the first usable rod sample


@kernel
def three_steps(x, y_rod, y_surface, p):
    """Estimate the fault and update, from two positions. [Lu17] (40)-(48), H = [[1 0 0 0], [1 0 0 0]]"""
    c = x.P[0, 0]
    a, b = c + p.r_rod, c + p.r_surface  # (40): S = [[a, c], [c, b]]
    det = a * b - c * c
    i00, i01, i11 = b / det, -c / det, a / det  # S^-1
    g0, g1 = y_rod - x.x_hat[0], y_surface - x.x_hat[0]  # (41)
    on_rod = x.blame != 2.0
    x.P_f = 1.0 / i00 if on_rod else 1.0 / i11  # (43)
    x.N[0] = x.P_f * (i00 if on_rod else i01)  # (48)
    x.N[1] = x.P_f * (i01 if on_rod else i11)
    x.f_hat = x.N[0] * g0 + x.N[1] * g1  # (42)
    if on_rod:
        g0 -= x.f_hat
        a -= x.P_f
    else:
        g1 -= x.f_hat
        b -= x.P_f
    s0, s1 = i00 + i01, i01 + i11  # H' S^-1
    m = s0 * (a * s0 + c * s1) + s1 * (c * s0 + b * s1)  # H' S^-1 (S - F P^f F') S^-1 H
    e = s0 * g0 + s1 * g1
    for i in range(4):
        x.K[i] = x.P[i, 0]
    for i in range(4):
        x.x_hat[i] += x.K[i] * e  # (45)-(46)
        for j in range(4):
            x.P[i, j] -= x.K[i] * m * x.K[j]  # (47)


@kernel
def one(x, j, y, r, p):
    """Update with one healthy measurement y of x[j]; return 1.0 when it was used, 0.0 when it is a spike."""
    s = x.P[j, j] + r
    e = y - x.x_hat[j]
    if e * e > p.gate * p.gate * s:
        return 0.0
    for i in range(4):
        x.K[i] = x.P[i, j] / s
    for i in range(4):
        x.x_hat[i] += x.K[i] * e
    joseph(x.P, x.K, j, r)
    return 1.0


@kernel
def correct(x, u, rod, surface, p, dt):
    """Use what is usable: both positions in three steps, or the healthy one alone; then the pressure."""
    y_surface = p.arm * u.y_surface + decision.lever_at(x, x.x_hat[0], dt * x.x_hat[1])
    learned, used = x.pair_time > 0.0, 0.0
    plausible = math.fabs(y_surface - x.x_hat[0]) < p.gate * math.sqrt(x.P[0, 0] + p.r_surface)
    x.age += dt
    if rod > 0.5 and surface > 0.5 and learned and (plausible or x.blame == 2.0):
        three_steps(x, u.y_rod, y_surface, p)
        used = 1.0
    elif rod > 0.5 and x.blame != 1.0:
        used = one(x, 0, u.y_rod, p.r_rod, p)
    elif surface > 0.5 and learned and x.blame != 2.0:
        used = one(x, 0, y_surface, p.r_surface, p)
    if used > 0.5:
        x.refused = x.age = 0.0
    elif rod > 0.5 or surface > 0.5:
        x.refused += 1.0
        if x.refused > 4.0:  # several agree: the estimate is what is wrong
            x.P[0, 0] += p.P0[0] * p.gate * p.gate * x.refused
    if usable(u.y_dp, u.y_dp_valid) > 0.5:
        one(x, 2, u.y_dp, p.r_dp, p)


@kernel
def learn_noise(x, apart, both, healthy, p, dt):
    """Learn the variance of the noise in rod less surface, `apart` [m], over the specified one, while `healthy`."""
    x.apart_run = min(x.apart_run + 1.0, 3.0) if both else 0.0
    if not both:
        return
    if x.apart_run > 2.5 and healthy:
        d = apart - 2.0 * x.apart_last[0] + x.apart_last[1]
        x.noise_time = min(x.noise_time + dt, NOISE_LAG)
        seen = min(d * d / (6.0 * (p.r_rod + p.r_surface)), NOISE_MOST)  # 1 + 4 + 1: of white samples
        x.noise_seen += (seen - x.noise_seen) * dt / x.noise_time
    x.apart_last[1], x.apart_last[0] = x.apart_last[0], apart


@kernel
def decide(x, u, rod, surface, q, step, p, dt):
    """Test rod against surface, and both against the model; `q` and `step` [m] are the rod and what it moves in a tick
    as predicted, free of this tick's noise."""
    v = x.u_old[int(p.delay)]
    x3 = x.x_hat[2]
    motion = p.phi_n / p.A_p * opening(v, x3) * v - p.L * x3
    bulk = x3 / stiffness(x.x_hat[0], p)  # rod motion that only compresses oil
    y_surface = p.arm * u.y_surface
    x.rigging, slack = decision.lever_at(x, q, step), decision.lever_slack(x, q, step)
    slack += (math.sqrt(max(x.noise_seen / TRAINED, 1.0)) - 1.0) * p.pair_threshold
    decision.pair_test(x, u.y_rod + bulk, rod, y_surface + bulk, surface, motion, x.x_hat[3], slack, True, p, dt)
    x.r = math.fabs(x.pair_d) / x.pair_limit
    both, healthy = rod > 0.5 and surface > 0.5, x.r < 0.7 and x.sensor < 0.5
    learn_noise(x, u.y_rod - y_surface, both, healthy, p, dt)
    if both and healthy:
        moves = step if math.fabs(step) > MOVES * dt else 0.0
        decision.learn_lever(x, u.y_rod - y_surface, q, moves, p.r_rod + p.r_surface, dt)
    x.alarm = x.sensor
    x.isolated_part = 0.0 if x.blame == 2.0 and x.backlash_suspected > 0.5 else x.blame
    x.verdict = NONE
    if x.sensor > 0.5:
        x.verdict = SENSOR if x.blame == 1.0 or (x.blame == 2.0 and x.backlash_suspected < 0.5) else AMBIGUOUS
    x.valid = 1.0 if x.age <= p.t_invalid and not (x.sensor > 0.5 and x.blame < 0.5) else 0.0


@kernel
def step(x, u, p, dt):
    """Run the three steps on measurements that are `delay` ticks old, then decide."""
    remember(x, u)
    rod, surface = usable(u.y_rod, u.y_rod_valid), usable(u.y_surface, u.y_surface_valid)
    if x.started < 0.5:
        x.valid = 0.0
        if rod < 0.5:
            return
        dp = u.y_dp if usable(u.y_dp, u.y_dp_valid) > 0.5 else 0.0
        at_rest(x, u.y_rod, dp, -dp, p)
        x.refused = 0.0
    d = int(p.delay)
    if d == 0:
        predict(x, x.u_old[0], p.A_p * p.P_s * x.x_hat[3], 0.0, True, p, dt)
    q, step_of_rod = x.x_hat[0], dt * x.x_hat[1]
    correct(x, u, rod, surface, p, dt)
    decide(x, u, rod, surface, q, step_of_rod, p, dt)
    if d > 0:
        predict(x, x.u_old[d - 1], p.A_p * p.P_s * x.x_hat[3], 0.0, True, p, dt)
    predict_now(x, 0.0, p.A_p * p.P_s * x.x_hat[3], p, dt)
    x.f_sigma = math.sqrt(max(x.P_f, 0.0))
    if not math.isfinite(x.q_now + x.v_now + x.x3_now + x.f_hat + x.x_hat[3]):
        x.started = x.valid = 0.0
        x.f_hat = x.q_now = x.v_now = x.x3_now = 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
