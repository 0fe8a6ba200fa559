"""OFC monitor: the in-service baseline, after the idea of Goupil (Control Engineering Practice 18, 2010, 1110-1119).

    m  = the command through the servo's own third-order reference model (rod estimate of a healthy actuator)
    e  = y_rod - m, split into sub-bands by second-order high- and low-pass filters
    r  = largest e of a sub-band / limit, which is threshold + share of the reference's motion there

A swing is a sub-band's e beyond its limit. Swings of alternating sign are counted over a sliding window of as many half
periods of the sub-band's lowest frequency; an alarm needs `half_periods` of them.

A servo follows its reference with a response that depends on tolerances and, by the hinge load's stiffness, on
airspeed: the share of the motion that it may miss. Whether an oscillation adds to the command or has taken its place
is told by fdi/monitors/liquid_or_solid.py.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from actuators.common import linkage, reference
from actuators.hydraulic import servo
from actuators.hydraulic.lu17 import opening
from fdi.common.decision import held, shift, usable
from fdi.common.record import Detector
from fdi.common.reference import chase
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, NONE
from fdi.monitors import liquid_or_solid
from fdi.monitors.liquid_or_solid import SAMPLE, keep_sample, name

ISOLABLE_PARTS = ("",)
BANDS = ((0.4, 1.3), (1.3, 4.0), (4.0, 12.0))  # [Hz]; 0.5 to 10 Hz is considered
B = len(BANDS)
COUNT = 4  # swings kept
HISTORY = 10  # reference positions kept: 5 ms at 2 kHz
LONG_AGO = 1e3  # [s]
TAU_DP = 0.0224  # lag of the pressure [s]
HIGH_HZ = 0.4  # high-pass of what is weighed [Hz]
MEMORY = 2.0  # of the reference's motion, in periods of the band's lower edge
WILD, T_WILD = 0.02, 0.1  # a residual that steps farther [m] is not believed for so long [s]: no rod moves so

PARAMS = dtype(
    [
        ("arm", "f8", "m"),  # rod arm
        *reference.PARAM_FIELDS,  # unit: m of rod
        ("r_lo", "f8", "m"),  # lowest rod command
        ("r_hi", "f8", "m"),  # highest rod command
        ("delay", "f8", "-"),  # age of the rod measurement, 0 to HISTORY
        ("high", "f8", (B, 2)),  # a1 and g of the state-variable filters: high-pass at the band's lower edge
        ("low", "f8", (B, 2)),  # low-pass at its upper edge
        ("wide", "f8", (2,)),  # high-pass of what is weighed
        ("f_low", "f8", (B,), "Hz"),  # lower edges
        ("f_high", "f8", "Hz"),  # highest frequency of an oscillation
        ("threshold", "f8", (B,), "m"),
        ("share", "f8", (B,), "-"),  # ... plus this share of the reference's largest motion in the band
        ("even", "f8", "-"),  # ticks of a sample of the ring
        ("half_periods", "f8", "-"),  # swings that make an alarm, at most COUNT
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
        ("est", "f8", (3,)),  # rod estimate [m], its rate and acceleration
        ("past", "f8", (HISTORY + 1,), "m"),  # reference positions, newest first
        ("high", "f8", (B, 2)),  # filter states of the residual
        ("low", "f8", (B, 2)),
        ("ref_high", "f8", (B, 2)),  # filter states of the reference
        ("ref_low", "f8", (B, 2)),
        ("ref_peak", "f8", (B,), "m"),  # its largest motion in the band, fading
        ("wide", "f8", (2, 2)),  # filter states of the high-pass of residual, reference
        ("side", "f8", (B,), "-"),  # sign of the last swing that counts, 0 for none in the window
        ("ages", "f8", (B, COUNT), "s"),  # time since the last swings that count, newest first
        ("counts", "f8", (B,), "-"),  # 1 where the band's swings make an oscillation
        *liquid_or_solid.STATE,
        ("timer", "f8", "s"),  # time for which the alarm is still held
        ("age", "f8", "s"),  # time since the last believed rod sample
        ("e", "f8", "m"),  # residual, held while the rod has no reading or a wild one
        ("ofc_hz", "f8", "Hz"),  # counted frequency
        ("r", "f8", "-"),  # largest band residual over its threshold
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("isolated_part", "f8", "-"),  # 0
        ("valid", "f8", "-"),  # 1 while the rod measurement is fresh
    ]
)
OUTPUTS = ("r", "e", "ofc_hz", "alarm", "verdict", "isolated_part", "valid")
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
    fields = {
        "arm": arm,
        **{name: s[name] for name, _ in reference.PARAM_FIELDS},
        "r_lo": linkage.rod(low + edge, arm),
        "r_hi": linkage.rod(high - edge, arm),
        "v_max": arm * rate,
        "delay": float(round(delay_s / dt)),
        "high": [_butterworth(hz, dt) for hz, _ in BANDS],
        "low": [_butterworth(hz, dt) for _, hz in BANDS],
        "wide": _butterworth(HIGH_HZ, dt),
        "f_low": [hz for hz, _ in BANDS],
        "f_high": BANDS[-1][1],
        "even": float(max(round(SAMPLE / dt), 1)),
        "a_dp": -math.expm1(-dt / TAU_DP),
        "t_invalid": 0.2,
    }
    return record(PARAMS, **{**fields, **thresholds("ofc_monitor", which), **values})


def _butterworth(hz, dt):
    """Return a1 and g of a second-order Butterworth state-variable filter."""
    g = math.tan(math.pi * hz * dt)
    return 1.0 / (1.0 + g * (g + math.sqrt(2.0))), g


init = zero_state(STATE)  # not started: the estimate starts at the first command


@kernel
def _filtered(s, v, c):
    """Return (low, high) of a second-order state-variable filter c = (a1, g) with states `s`, and advance it."""
    a1, g = c[0], c[1]
    e = v - s[1]
    band = a1 * s[0] + g * a1 * e
    low = s[1] + g * a1 * s[0] + g * g * a1 * e
    s[0] = 2.0 * band - s[0]
    s[1] = 2.0 * low - s[1]
    return low, v - math.sqrt(2.0) * band - low


@kernel
def _predict(x, p, dt):
    """Advance the rod estimate to the next tick, with the limits of `actuators.common.reference`."""
    away = x.target - x.est[0]
    most = p.v_max * max(opening(away, x.x3), servo.ROOT_LEAST)
    chase(x.est, away, most, p.k1, p.k2, p.k3, p.a_max, p.j_max, dt)
    shift(x.past, x.est[0])


@kernel
def _count(x, p, b, off, dt):
    """Split band b off the residual `off` [m] and count its swings; return it over its limit."""
    for i in range(COUNT):
        x.ages[b, i] += dt
    _, high = _filtered(x.high[b], off, p.high[b])
    v, _ = _filtered(x.low[b], high, p.low[b])
    limit = p.threshold[b] + p.share[b] * x.ref_peak[b]
    n, half, side = int(p.half_periods), 0.5 / p.f_low[b], 1.0 if v > 0.0 else -1.0
    if side != x.side[b] and math.fabs(v) >= limit:
        x.side[b] = side
        shift(x.ages[b], 0.0)
    span = x.ages[b, n - 1] - x.ages[b, 0]
    if x.ages[b, 0] > (n - 1) * half:
        x.side[b] = 0.0
    x.counts[b] = 1.0 if x.ages[b, 0] <= half and 0.0 < span <= (n - 1) * half else 0.0
    if x.counts[b] > 0.5:
        x.ofc_hz = 0.5 * (n - 1) / span
    return math.fabs(v) / limit


@kernel
def _start(x, u, p):
    """Let the estimate begin at the first reading: the first command, with its noise, is still to be followed."""
    x.started = 1.0
    x.est[0] = min(max(u.y_rod, p.r_lo), p.r_hi)
    x.past[:] = x.est[0]
    x.wide[1, 1] = x.est[0]  # the high-pass starts in equilibrium
    x.ages[:] = LONG_AGO


@kernel
def _read(x, u, p, dt):
    """Take the rod's reading into the residual; return whether there has been one."""
    good = usable(u.y_rod, u.y_rod_valid)
    if x.started < 0.5 and good > 0.5:
        _start(x, u, p)
    if x.started < 0.5:
        return False
    e = u.y_rod - x.past[int(p.delay)]
    if good > 0.5 and math.fabs(e - x.e) > WILD and x.age < T_WILD:
        good = 0.0
    x.age = 0.0 if good > 0.5 else x.age + dt
    if good > 0.5:
        x.e = e
    return True


@kernel
def _oscillates(x, p, off, m, dt):
    """Split residual `off` and reference `m` [m] into bands; return whether the swings of one are an oscillation."""
    x.r, found = 0.0, False
    for b in range(B):
        _, high = _filtered(x.ref_high[b], m, p.high[b])
        moves, _ = _filtered(x.ref_low[b], high, p.low[b])
        x.ref_peak[b] = max(math.fabs(moves), x.ref_peak[b] * (1.0 - dt * p.f_low[b] / MEMORY))
        x.r = max(x.r, _count(x, p, b, x.e if b == 0 else off, dt))
        if x.counts[b] > 0.5:
            found = True
            if x.verdict == NONE:
                x.since = min(x.since, x.ages[b, int(p.half_periods) - 1] / (p.even * dt))
    return found


@kernel
def step(x, u, p, dt):
    """Estimate the rod from the command, split the residual, count, name."""
    if math.isfinite(u.command):
        x.target = min(max(p.arm * u.command, p.r_lo), p.r_hi)
    if not _read(x, u, p, dt):
        return
    _, off = _filtered(x.wide[0], x.e, p.wide)
    _, m = _filtered(x.wide[1], x.past[int(p.delay)], p.wide)
    keep_sample(x, off + m, m, p)
    found = _oscillates(x, p, off, m, dt)
    x.valid = 1.0 if x.age <= p.t_invalid else 0.0
    x.timer = p.t_release if found and x.valid > 0.5 else max(x.timer - dt, 0.0)
    x.alarm = 1.0 if x.timer > 0.0 else 0.0
    if x.alarm < 0.5:
        x.verdict = NONE
        x.since = LONG_AGO
    elif x.verdict == NONE:
        x.verdict = AMBIGUOUS
    name(x, p, dt)
    x.x3 += p.a_dp * (held(u.y_dp, u.y_dp_valid, x.x3) - x.x3)
    _predict(x, p, dt)


rollout = entry(step, STATE, INPUTS, PARAMS)
