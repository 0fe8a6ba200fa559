"""OFC monitor: the in-service baseline, after the idea of Goupil (Control Engineering Practice 18, 2010, 1110-1119).

    m     = the command through the servo's own third-order reference model (rod estimate of a healthy actuator)
    e     = y_rod - m - sum_k theta_k L_k m,  split into sub-bands by second-order high- and low-pass filters
    r     = largest swing of e / limit, which is threshold + (share + UNKNOWN unknown) of the reference's motion there

Swings are counted by fdi/monitors/swings.py.

A servo follows its reference with a response that depends on tolerances and, by the hinge load's stiffness, on
airspeed. The error poles of the servo are at -a = -25 rad/s (`actuators.hydraulic.servo`), so that to first order what
is missing is a polynomial of s over (s + a)^3; with one order more, for what the second order makes, it is spanned by
the Laguerre functions L_k = a / (s + a) ((s - a) / (s + a))^k, k = 0 to 3. theta is learned by least squares over the
last LEARN seconds without an alarm, from what a healthy servo leaves on the mean (`usual`); in the first seconds at
once, and taken back where an oscillation is counted meanwhile. `departure` is the largest gain of what has been learned
beside that; beyond `most`, which the tolerances do not reach, the servo is not the one that the thresholds are made
for, and the monitor is not valid. `unknown` is the share of theta that is still the usual one, for want of motion to
learn from, as in the first manoeuvre after still air. A reference at its limits of rate or acceleration moves otherwise
than the servo at those of its valve, which no theta describes: for a while (`limited`) as much is unknown. Whether an
oscillation adds to the command or has taken its place is told by fdi/monitors/liquid_or_solid.py.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage, reference
from actuators.hydraulic import servo
from actuators.hydraulic.lu17 import opening
from fdi.common.decision import clipped, held, usable
from fdi.common.record import Detector
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID, OFC_SOLID
from fdi.monitors import liquid_or_solid, swings
from fdi.monitors.liquid_or_solid import EVERY, NO_SWING, SAMPLE, STEADY, VOTES, keep_sample, weigh
from fdi.monitors.swings import BANDS, B, count, filtered, limit

CULPRITS = ("",)
HISTORY = 10  # reference positions kept: 5 ms at 2 kHz
LONG_AGO = 1e3  # [s]
TAU_DP = 0.0224  # lag of the pressure [s]
HIGH_HZ = 0.4  # high-pass of what is learned and weighed [Hz]
AT_LIMIT = 0.95  # of the reference's largest rate or acceleration: from here on it moves as its limits let it
MEMORY = 2.0  # of the reference's motion, in periods of the band's lower edge
LEARN = 20.0  # memory of the servo's response: some ten periods of the lowest sub-band [s]
BLOCK = 3.0  # what is learned is one to two blocks old: an oscillation has been counted by then [s]
PRIOR = 1e-6  # the usual response counts as much as two seconds of a motion of 1 mm [m^2 s]
WILD, T_WILD = 0.02, 0.1  # a residual that steps farther [m] is not believed for so long [s]: no rod moves so
N = 4  # Laguerre functions
AT = (0.9, 2.3, 5.0)  # frequencies at which the departure is taken: the middle of the sub-bands, servo's pole [Hz]

PARAMS = dtype(
    [
        ("arm", "f8", "m"),  # rod arm
        *reference.PARAM_FIELDS,  # unit: m of rod
        ("r_lo", "f8", "m"),  # lowest rod command
        ("r_hi", "f8", "m"),  # highest rod command
        ("delay", "f8", "-"),  # age of the rod measurement, 0 to HISTORY
        ("high_a1", "f8", (B,)),  # state-variable filters: high-pass at the band's lower edge
        ("high_g", "f8", (B,)),
        ("low_a1", "f8", (B,)),  # low-pass at its upper edge
        ("low_g", "f8", (B,)),
        ("f_low", "f8", (B,), "Hz"),  # lower edges
        ("f_high", "f8", "Hz"),  # highest frequency of an oscillation
        ("threshold", "f8", (B,), "m"),
        ("share", "f8", (B,), "-"),  # ... plus this share of the reference's largest motion in the band
        ("usual", "f8", (N,), "-"),  # theta of a healthy servo on the mean
        ("most", "f8", "-"),  # largest departure from it that tolerances and airspeed make
        ("a", "f8", "-"),  # of the Laguerre functions' lag over a tick
        ("wide", "f8", (2,)),  # and g of the wide high-pass
        ("L_re", "f8", (3, N)),  # response of the Laguerre functions at AT
        ("L_im", "f8", (3, N)),
        ("even", "f8", "-"),  # ticks of a sample of the ring
        ("half_periods", "f8", "-"),  # swings that make an alarm, at most swings.COUNT
        ("t_release", "f8", "s"),
        ("a_dp", "f8", "-"),  # share of a tick in the lag of the pressure
        ("t_invalid", "f8", "s"),
    ]
)
INPUTS = dtype(
    [
        ("command", "f8", "rad"),  # surface command, trailing edge down +
        ("y_rod", "f8", "m"),
        ("y_rod_valid", "f8", "-"),
        ("y_dp", "f8", "-"),  # pressure difference over supply: the rate that is left
        ("y_dp_valid", "f8", "-"),
    ]
)
STATE = dtype(
    [
        ("started", "f8", "-"),
        ("target", "f8", "m"),  # last finite command
        ("x3", "f8", "-"),  # lagged pressure difference
        ("q_est", "f8", "m"),  # rod estimate: `actuators.common.reference` by other names, r being the statistic
        ("qd_est", "f8", "m/s"),
        ("qdd_est", "f8", "m/s2"),
        ("past", "f8", (HISTORY + 1,), "m"),  # reference positions, newest first
        *swings.STATE,
        ("ref_high", "f8", (B, 2)),  # filter states of the reference
        ("ref_low", "f8", (B, 2)),
        ("ref_peak", "f8", (B,), "m"),  # its largest motion in the band, fading
        ("wide", "f8", (2, 2)),  # filter states of the high-pass of rod less reference, reference
        ("lags", "f8", (N,), "m"),  # states of the Laguerre functions
        ("moves", "f8", (N,), "m"),  # their outputs
        ("origin", "f8", "m"),  # reference at the start
        ("lags_all", "f8", (N,), "m"),  # of the functions of the reference without the high-pass
        ("moves_all", "f8", (N,), "m"),
        ("products", "f8", (N, N + 1), "m2 s"),  # of them, and with what the usual response leaves of the residual
        ("waiting", "f8", (N, N + 1), "m2 s"),  # sums of the products over the last block
        ("block", "f8", (N, N + 1), "m2 s"),  # and over the one that is open
        ("block_age", "f8", "s"),
        ("clock", "f8", "s"),  # since the start
        ("work", "f8", (N, N + 1), "m2 s"),  # scratch
        ("response", "f8", (N,), "-"),  # learned theta
        ("unknown", "f8", "-"),  # share of it that is the usual one still
        ("limited", "f8", "-"),  # 1 where the reference moves at its limits, fading afterwards
        ("departure", "f8", "-"),  # largest gain of what it is beside the usual one
        *liquid_or_solid.STATE,
        ("timer", "f8", "s"),  # time for which the alarm is still held
        ("age", "f8", "s"),  # time since the last believed rod sample
        ("e", "f8", "m"),  # residual, held while the rod has no reading or a wild one
        ("ofc_hz", "f8", "Hz"),  # counted frequency
        ("r", "f8", "-"),  # largest band residual over its threshold
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("culprit", "f8", "-"),  # 0
        ("valid", "f8", "-"),  # 1 while the rod measurement is fresh
    ]
)
OUTPUTS = ("r", "e", "ofc_hz", "alarm", "verdict", "culprit", "valid")
DETECTOR = Detector(
    id="ofc_monitor",
    level="local",
    summary="in-service oscillation counting on a rod residual (baseline) [Goupil 2010]",
    technologies=("hydraulic",),
    inputs={"command": "de_cmd", "y_rod": "rod", "y_dp": "pressure"},
    group="monitors",
    designed_for={
        **dict.fromkeys(
            (
                "hydraulic.ofc_liquid",
                "hydraulic.ofc_liquid@command",
                "hydraulic.ofc_liquid@sensor",
            ),
            ("ofc_liquid",),
        ),
        **dict.fromkeys(("hydraulic.ofc_solid", "hydraulic.ofc_solid@command"), ("ofc_solid",)),
    },
    may_see={  # by ringing, or in a manoeuvre that the faulty rod does not follow
        **dict.fromkeys(
            (
                "hydraulic.jam*",
                "hydraulic.free_float",
                "hydraulic.loss_of_effectiveness*",
                "hydraulic.supply_pressure_drop",
                "hydraulic.internal_leakage",
                "hydraulic.air_in_oil",
                "hydraulic.friction",
                "hydraulic.backlash",
                "hydraulic.rod",
            ),
            ("ambiguous",),
        ),
    },
    blind="counts alternating crossings of one hydraulic rod's residual: what does not oscillate is not counted",
    looks_back={"delay": "past"},
    sizes={"half_periods": 1},
    fit=lambda site: params(dt=site.dt, arm=site.actuator.get("arm", linkage.ARM), travel=site.travel),
)


def params(
    which: str = "flight",
    *,
    dt: float = 0.005,
    delay_s: float = 0.005,
    arm: float = linkage.ARM,
    travel: Any = None,
    **values: Any,
) -> np.ndarray:
    """Return PARAMS for ticks of `dt` seconds, linkage `arm` [m], stops `travel` [rad]; `values` replace any field."""
    s = servo.params(dt=dt)[0]
    low, high = travel or linkage.TRAVEL
    edge, rate = math.radians(0.1), math.radians(40.0)  # of the servo's reference
    ends = {"r_lo": linkage.rod(low + edge, arm), "r_hi": linkage.rod(high - edge, arm), "v_max": arm * rate}
    edges = np.array(BANDS)
    g = np.tan(np.pi * edges * dt)
    a1 = 1.0 / (1.0 + g * (g + math.sqrt(2.0)))  # Butterworth
    wide = math.tan(math.pi * HIGH_HZ * dt)
    a = -math.expm1(-servo.POLE * dt)
    L = functions(dt)
    fields = {
        "arm": arm,
        **{name: s[name] for name, _ in reference.PARAM_FIELDS},
        **ends,
        "delay": float(round(delay_s / dt)),
        "high_a1": a1[:, 0],
        "high_g": g[:, 0],
        "low_a1": a1[:, 1],
        "low_g": g[:, 1],
        "f_low": edges[:, 0],
        "f_high": edges[-1, 1],
        "a": a,
        "wide": (1.0 / (1.0 + wide * (wide + math.sqrt(2.0))), wide),
        "L_re": L.real,
        "L_im": L.imag,
        "even": float(max(round(SAMPLE / dt), 1)),
        "a_dp": -math.expm1(-dt / TAU_DP),
        "t_invalid": 0.2,
    }
    return record(PARAMS, **{**fields, **thresholds("ofc_monitor", which), **values})


def functions(dt: float = 0.005) -> np.ndarray:
    """Return the response (3, N) of the Laguerre functions at the frequencies AT, as `laguerre` steps them."""
    a = -math.expm1(-servo.POLE * dt)
    lag = a / (1.0 - (1.0 - a) * np.exp(-2j * np.pi * np.array(AT) * dt)[:, None])
    return lag * (1.0 - 2.0 * lag) ** np.arange(N)


def departure(theta: np.ndarray) -> np.ndarray:
    """Return the largest gain of `theta` (..., N) at the frequencies AT, (...)."""
    return np.abs(theta @ functions().T).max(axis=-1)


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not started: the estimate starts at the first command."""
    return np.zeros(p.shape, STATE)


@kernel
def laguerre(x, lags, moves, v, p):
    """Take in the reference's motion `v` [m]: the outputs of the Laguerre functions, each the one before through
    (s - a) / (s + a)."""
    for k in range(N):
        lags[k] += p.a * (v - lags[k])
        if k == 0:
            v = lags[0]
        else:
            v -= 2.0 * lags[k]
        moves[k] = v


@kernel
def learn(x, e, p, dt):
    """Learn how the residual `e` [m] goes with the Laguerre functions of the reference's motion."""
    for i in range(N):
        e -= p.usual[i] * x.moves[i]
    weight = dt  # what is beyond the limit is no response: a fault, or that it has healed
    for b in range(B):
        part = limit(x, p, b) / max(x.peak[b], limit(x, p, b))
        weight = min(weight, dt * part * part * part * part)  # so that a larger residual teaches less
    for i in range(N):
        for j in range(N):
            x.block[i, j] += weight * x.moves[i] * x.moves[j]
        x.block[i, N] += weight * x.moves[i] * e
    x.block_age += dt
    at_once = x.clock < 2.0 * BLOCK
    if x.block_age < (SAMPLE if at_once else BLOCK):
        return
    keep = 1.0 - x.block_age / LEARN
    for i in range(N):
        for j in range(N + 1):
            x.products[i, j] = keep * x.products[i, j] + (x.block[i, j] if at_once else x.waiting[i, j])
            x.waiting[i, j] = 0.0 if at_once else x.block[i, j]
            x.block[i, j] = 0.0
    x.block_age = 0.0
    x.unknown = PRIOR / (PRIOR + x.products[0, 0])  # all four have the same energy: each is the one before, turned
    W = x.work
    for i in range(N):  # Gauss: the matrix is positive by PRIOR
        for j in range(N + 1):
            W[i, j] = x.products[i, j]
        W[i, i] += PRIOR
    for k in range(N):
        for i in range(k + 1, N):
            f = W[i, k] / W[k, k]
            for j in range(k, N + 1):
                W[i, j] -= f * W[k, j]
    for k in range(N - 1, -1, -1):
        for j in range(k + 1, N):
            W[k, N] -= W[k, j] * W[j, N]
        W[k, N] /= W[k, k]
    x.departure = 0.0
    for b in range(B):
        re, im = 0.0, 0.0
        for k in range(N):
            re += p.L_re[b, k] * W[k, N]
            im += p.L_im[b, k] * W[k, N]
        x.departure = max(x.departure, math.sqrt(re * re + im * im))
    for k in range(N):
        x.response[k] = p.usual[k] + W[k, N]


@kernel
def forget(x, p):
    """Take back what was learned at once: an oscillation that has been counted since the start was in it."""
    x.products[:] = 0.0
    x.block[:] = 0.0
    x.block_age, x.departure, x.unknown, x.clock = 0.0, 0.0, 1.0, 2.0 * BLOCK
    for k in range(N):
        x.response[k] = p.usual[k]


@kernel
def predict(x, p, dt):
    """Advance the rod estimate to the next tick, with the limits of `actuators.common.reference`."""
    for i in range(HISTORY, 0, -1):
        x.past[i] = x.past[i - 1]
    away = x.target - x.q_est
    most = p.v_max * max(opening(away, x.x3), servo.ROOT_LEAST)
    v = clipped(p.k1 * away, most)
    a = clipped(p.k2 * (v - x.qd_est), p.a_max)
    j = clipped(p.k3 * (a - x.qdd_est), p.j_max)
    x.limited *= 1.0 - dt * p.f_low[0] / MEMORY
    if math.fabs(x.qd_est) > AT_LIMIT * p.v_max or math.fabs(x.qdd_est) > AT_LIMIT * p.a_max:
        x.limited = 1.0
    x.q_est += dt * (x.qd_est + dt * (x.qdd_est / 2.0 + dt * j / 6.0))
    x.qd_est += dt * (x.qdd_est + dt * j / 2.0)
    x.qdd_est += dt * j
    x.past[0] = x.q_est


@kernel
def step(x, u, p, dt):
    """Estimate the rod from the command, split the residual, count."""
    if math.isfinite(u.command):
        x.target = min(max(p.arm * u.command, p.r_lo), p.r_hi)
    good = usable(u.y_rod, u.y_rod_valid)
    if x.started < 0.5:
        if good < 0.5:
            return
        x.started = x.unknown = 1.0
        x.q_est = min(max(u.y_rod, p.r_lo), p.r_hi)  # the first command, with its noise, is still to be followed
        x.past[:] = x.origin = x.q_est
        x.wide[1, 1] = x.q_est  # the high-pass starts in equilibrium
        for k in range(N):
            x.response[k] = p.usual[k]
        x.ages[:] = LONG_AGO
    reference = x.past[int(p.delay)]
    if good > 0.5 and math.fabs(u.y_rod - reference - x.e) > WILD and x.age < T_WILD:
        good = 0.0
    x.age = 0.0 if good > 0.5 else x.age + dt
    if good > 0.5:
        x.e = u.y_rod - reference
    _, e, _ = filtered(x.wide[0], x.e, p.wide[0], p.wide[1])
    _, m, _ = filtered(x.wide[1], reference, p.wide[0], p.wide[1])
    laguerre(x, x.lags, x.moves, m, p)
    laguerre(x, x.lags_all, x.moves_all, reference - x.origin, p)
    x.clock += dt
    if x.timer > 0.0:
        x.block[:] = 0.0
        x.waiting[:] = 0.0
        x.block_age = 0.0
    elif good > 0.5:
        learn(x, e, p, dt)
    learned = 0.0
    for k in range(N):
        learned += x.response[k] * x.moves[k]
    keep_sample(x, e + m, m + learned, p)
    x.off[0], x.off[1] = x.e, e - learned
    for k in range(N):
        x.off[0] -= x.response[k] * x.moves_all[k]
    worst, found = 0.0, False
    for b in range(B):
        _, high, _ = filtered(x.ref_high[b], m, p.high_a1[b], p.high_g[b])
        moves, _, _ = filtered(x.ref_low[b], high, p.low_a1[b], p.low_g[b])
        x.ref_peak[b] = max(math.fabs(moves), x.ref_peak[b] * (1.0 - dt * p.f_low[b] / MEMORY))
        oscillates = count(x, p, b, dt)
        worst = max(worst, x.swing[b] / limit(x, p, b))
        if oscillates:
            found = True
            if x.verdict == NONE:
                x.since = min(x.since, x.ages[b, int(p.half_periods) - 1] / (p.even * dt))
    if found and x.clock < 2.0 * BLOCK:
        forget(x, p)
    x.valid = 1.0 if x.age <= p.t_invalid and x.departure <= p.most else 0.0
    x.timer = p.t_release if found and x.valid > 0.5 else max(x.timer - dt, 0.0)
    x.alarm = 1.0 if x.timer > 0.0 else 0.0
    if x.alarm < 0.5:
        x.verdict = x.vote = NONE
        x.since = LONG_AGO
    elif x.verdict == NONE:
        x.verdict = AMBIGUOUS
    if x.alarm > 0.5 and x.ticks == 0.0 and int(x.since) % EVERY == 0:
        hz = x.sine_hz
        said = weigh(x, p, p.even * dt)
        same = said == x.vote and math.fabs(x.sine_hz - hz) <= STEADY * hz
        x.votes = x.votes + 1.0 if same else 1.0
        x.vote = said
        if said != AMBIGUOUS and x.votes >= VOTES:
            x.verdict = said
        elif x.residual > NO_SWING:
            x.verdict = AMBIGUOUS
    if x.verdict == OFC_LIQUID or x.verdict == OFC_SOLID:
        x.ofc_hz = x.sine_hz
    x.x3 += p.a_dp * (held(u.y_dp, u.y_dp_valid, x.x3) - x.x3)
    x.r = worst
    predict(x, p, dt)


rollout = entry(step, STATE, INPUTS, PARAMS)
