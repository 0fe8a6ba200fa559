"""OFC monitor: the in-service baseline, after the idea of Goupil (Control Engineering Practice 18, 2010, 1110-1119).

    q_est = the command through the servo's own third-order reference model (rod estimate of a healthy actuator)
    e     = y_rod - q_est,  split into sub-bands by second-order high- and low-pass filters
    e_band less a m + c m~,  m the reference's motion in the band, m~ in quadrature to it
    r     = largest |e_band| / (threshold + share of the reference's motion in the band)

In each sub-band the crossings of alternately +threshold and -threshold are counted over a sliding window of as
many half periods of the band's lowest frequency. An alarm needs `half_periods` of them; the frequency is that of
the counted crossings.

A servo follows its reference with a gain and a phase that depend on tolerances and, by the hinge load's stiffness, on
airspeed: at 365 kt and 5 % off in piston area, flow and supply a third of the motion at 2 Hz is missing. Both are
learned, as a and c of each sub-band, by least squares over the last LEARN seconds without an alarm, from what a nominal
servo leaves at 310 kt. An oscillation of a fault has no phase in common with the reference and is not learned; MOST
bounds what one could take along. What is left still grows with the motion, and the threshold with it.

An actuator that has lost flow, pressure or its hold swings as well, with the command or with the gusts. An oscillation
is called one when COUNT crossings came at equal times, its half waves are alike and larger than what the reference
itself does in the band; until then the alarm is AMBIGUOUS. The residual cannot tell an oscillation that adds to
the servo's signal from one that replaces it: the name is OFC_LIQUID.
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
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID

CULPRITS = ("",)
BANDS = ((0.4, 1.3), (1.3, 4.0), (4.0, 12.0))  # [Hz]; 0.5 to 10 Hz is considered
B = len(BANDS)
COUNT = 6  # crossings kept
HISTORY = 10  # reference positions kept: 5 ms at 2 kHz
LONG_AGO = 1e3  # [s]
ROOT_LEAST = servo.ROOT_LEAST
EVEN, ALIKE = 1.5, 2.5  # longest over shortest half period, largest over smallest half wave of an oscillation
MEMORY = 2.0  # of the reference's motion, in periods of the band's lower edge
LEARN = 20.0  # memory of the servo's response: some ten periods of the lowest sub-band [s]
USUAL = ((-0.07, -0.12), (-0.15, -0.03), (-0.1, 0.1))  # a and c of each band of a nominal servo, 393 t at 310 kt
PRIOR = 1e-6  # they count as much as two seconds of a motion of 1 mm [m^2 s]
MOST = (0.2, 0.3)  # from them: 5 % and 365 kt make 0.18 in a, 0.3 in c; a servo that lacks half is no healthy one
OWN = 1.5  # its half waves over the largest motion of the reference in the band

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
        ("threshold", "f8", (B,), "m"),
        ("share", "f8", (B,), "-"),  # ... plus this share of the reference's largest motion in the band
        ("half_periods", "f8", "-"),  # alternating crossings that make an alarm, at most COUNT
        ("t_release", "f8", "s"),
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
        ("y", "f8", "m"),  # last usable rod
        ("x3", "f8", "-"),  # lagged pressure difference
        ("q_est", "f8", "m"),  # rod estimate: `actuators.common.reference` by other names, r being the statistic
        ("qd_est", "f8", "m/s"),
        ("qdd_est", "f8", "m/s2"),
        ("past", "f8", (HISTORY + 1,), "m"),  # reference positions, newest first
        ("high", "f8", (B, 2)),  # filter states
        ("low", "f8", (B, 2)),
        ("e_band", "f8", (B,), "m"),  # residual by band
        ("side", "f8", (B,), "-"),  # side of the last counted crossing
        ("ages", "f8", (B, COUNT), "s"),  # time since the last crossings, newest first
        ("peaks", "f8", (B, COUNT), "m"),  # largest residual of the half waves that they began, newest first
        ("ref_high", "f8", (B, 2)),  # filter states of the reference
        ("ref_low", "f8", (B, 2)),
        ("ref_peak", "f8", (B,), "m"),  # its largest motion in the band, fading
        ("gram", "f8", (B, 3), "m2 s"),  # fading sums of m m, m m~, m~ m~
        ("cross", "f8", (B, 2), "m2 s"),  # of what the usual response leaves of the residual, with m and m~
        ("response", "f8", (B, 2), "-"),  # learned a and c
        ("timer", "f8", "s"),  # time for which the alarm is still held
        ("age", "f8", "s"),  # time since the last usable rod sample
        ("e", "f8", "m"),  # residual
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
    designed_for={  # the idea of Goupil 2010; it cannot tell liquid from solid
        **dict.fromkeys((
            "hydraulic.ofc_liquid", "hydraulic.ofc_solid", "hydraulic.ofc_liquid@command",
            "hydraulic.ofc_solid@command", "hydraulic.ofc_liquid@sensor",
        ), ("ofc_liquid",)),
    },
    may_see={  # by ringing, or in a manoeuvre that the faulty rod does not follow
        **dict.fromkeys((
            "hydraulic.jam*", "hydraulic.free_float", "hydraulic.loss_of_effectiveness*",
            "hydraulic.supply_pressure_drop", "hydraulic.internal_leakage", "hydraulic.air_in_oil",
            "hydraulic.friction", "hydraulic.backlash", "hydraulic.rod",
        ), ("ambiguous",)),
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
        "t_invalid": 0.2,
    }
    return record(PARAMS, **{**fields, **thresholds("ofc_monitor", which), **values})


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not started: the estimate starts at the first command."""
    return np.zeros(p.shape, STATE)


@kernel
def filtered(s, v, a1, g):
    """Return (low, high, band) of a second-order Butterworth state-variable filter with states `s`, and advance it."""
    k = math.sqrt(2.0)
    e = v - s[1]
    band = a1 * s[0] + g * a1 * e
    low = s[1] + g * a1 * s[0] + g * g * a1 * e
    s[0] = 2.0 * band - s[0]
    s[1] = 2.0 * low - s[1]
    return low, v - k * band - low, band


@kernel
def limit(x, p, b):
    """Return what band b's residual has to exceed [m]."""
    return p.threshold[b] + p.share[b] * x.ref_peak[b]


@kernel
def count(x, p, b, dt):
    """Count band b's alternating crossings; return whether they make an oscillation now."""
    for i in range(COUNT):
        x.ages[b, i] = min(x.ages[b, i] + dt, LONG_AGO)
    v = x.e_band[b] / limit(x, p, b)
    if math.fabs(v) >= 1.0 and v * x.side[b] <= 0.0:
        x.side[b] = 1.0 if v > 0.0 else -1.0
        for i in range(COUNT - 1, 0, -1):
            x.ages[b, i] = x.ages[b, i - 1]
            x.peaks[b, i] = x.peaks[b, i - 1]
        x.ages[b, 0] = 0.0
        x.peaks[b, 0] = 0.0
    x.peaks[b, 0] = max(x.peaks[b, 0], math.fabs(x.e_band[b]))
    n = int(p.half_periods)
    half = 0.5 / p.f_low[b]
    span = x.ages[b, n - 1] - x.ages[b, 0]
    if x.ages[b, 0] > half or span > (n - 1) * half or span <= 0.0:
        return False
    x.ofc_hz = 0.5 * (n - 1) / span
    return True


@kernel
def steady(x, b):
    """Return whether band b's crossings are those of an oscillation of its own: evenly spaced, alike, not the
    reference's.
    """
    short, long = LONG_AGO, 0.0
    low, high = LONG_AGO, 0.0
    for i in range(COUNT - 1):
        span = x.ages[b, i + 1] - x.ages[b, i]
        short, long = min(short, span), max(long, span)
        peak = x.peaks[b, i + 1]  # whole half waves
        low, high = min(low, peak), max(high, peak)
    return long < EVEN * short and high < ALIKE * low and low > OWN * x.ref_peak[b]


@kernel
def learn(x, b, e, m, c, dt):
    """Learn how band b's residual `e` goes with the reference's motion `m` and its quadrature `c` [m]."""
    keep = 1.0 - dt / LEARN
    G, w, usual = x.gram[b], x.cross[b], USUAL[b]
    left = e - usual[0] * m - usual[1] * c
    G[0] = keep * G[0] + dt * m * m
    G[1] = keep * G[1] + dt * m * c
    G[2] = keep * G[2] + dt * c * c
    w[0] = keep * w[0] + dt * m * left
    w[1] = keep * w[1] + dt * c * left
    g0, g2 = G[0] + PRIOR, G[2] + PRIOR
    det = g0 * g2 - G[1] * G[1]  # positive: PRIOR squared at least
    x.response[b, 0] = usual[0] + clipped((g2 * w[0] - G[1] * w[1]) / det, MOST[0])
    x.response[b, 1] = usual[1] + clipped((g0 * w[1] - G[1] * w[0]) / det, MOST[1])


@kernel
def predict(x, p, dt):
    """Advance the rod estimate to the next tick, with the limits of `actuators.common.reference`."""
    for i in range(HISTORY, 0, -1):
        x.past[i] = x.past[i - 1]
    away = x.target - x.q_est
    most = p.v_max * max(opening(away, x.x3), ROOT_LEAST)
    v = clipped(p.k1 * away, most)
    a = clipped(p.k2 * (v - x.qd_est), p.a_max)
    j = clipped(p.k3 * (a - x.qdd_est), p.j_max)
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
    x.y = held(u.y_rod, u.y_rod_valid, x.y)
    if x.started < 0.5:
        if good < 0.5:
            return
        x.started = 1.0
        x.q_est = x.target
        for i in range(HISTORY + 1):
            x.past[i] = x.target
        for b in range(B):
            x.high[b, 1] = x.y - x.target  # the high-pass starts in equilibrium
            x.ref_high[b, 1] = x.target
            for i in range(COUNT):
                x.ages[b, i] = LONG_AGO
    x.age = 0.0 if good > 0.5 else x.age + dt
    x.valid = 1.0 if x.age <= p.t_invalid else 0.0
    x.e = x.y - x.past[int(p.delay)]
    worst = 0.0
    found, named = False, x.verdict == OFC_LIQUID
    for b in range(B):
        _, high, _ = filtered(x.high[b], x.e, p.high_a1[b], p.high_g[b])
        e, _, _ = filtered(x.low[b], high, p.low_a1[b], p.low_g[b])
        _, high, _ = filtered(x.ref_high[b], x.past[int(p.delay)], p.high_a1[b], p.high_g[b])
        moves, _, across = filtered(x.ref_low[b], high, p.low_a1[b], p.low_g[b])
        if x.timer <= 0.0 and good > 0.5:
            learn(x, b, e, moves, across, dt)
        x.e_band[b] = e - x.response[b, 0] * moves - x.response[b, 1] * across
        x.ref_peak[b] = max(math.fabs(moves), x.ref_peak[b] * (1.0 - dt * p.f_low[b] / MEMORY))
        worst = max(worst, math.fabs(x.e_band[b]) / limit(x, p, b))
        if count(x, p, b, dt):
            found = True
            named = named or steady(x, b)
    x.timer = p.t_release if found and x.valid > 0.5 else max(x.timer - dt, 0.0)
    x.alarm = 1.0 if x.timer > 0.0 else 0.0
    x.verdict = NONE
    if x.timer > 0.0:
        x.verdict = OFC_LIQUID if named else AMBIGUOUS
    x.x3 += 0.2 * (held(u.y_dp, u.y_dp_valid, x.x3) - x.x3)
    x.r = worst
    predict(x, p, dt)


rollout = entry(step, STATE, INPUTS, PARAMS)
