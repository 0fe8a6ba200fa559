"""The bench of [Lu17]: equation (4) under its NDI servo, one filter watching and steering, over many seeds.

The truth is (4) as `transcription` has it from the paper; servo and filters hold their own.

What the paper leaves open, and what stands here:

- Command. A 3-2-1-1 in seconds, 20 mm of rod, at 2 s and again at 13 s, so that every fault begins with the rod at null
  (section V.D: "when the position of the control surface is close to zero") and is judged in motion.
- Sampling and noise: 5 ms; rod 0.1 mm (sensor set `transport`); process noise of the truth is exactly the Q of the
  filters (`iotsekf.NOISE`), so that "unbiased" is asked of a filter whose noises match. The input fault is no random
  walk, as in the paper.
- Faults: liquid OFC 0.02 of u at 1 Hz added at the valve, solid OFC the same in place of u; liquid jamming 5 mm on the
  rod sensor; solid jamming and runaway (20 deg/s to the stop) as the paper models them, an output fault
  f_o = surface - x1 on an actuator that itself works on; and, separately, a jam as it is: the rod is held.
- Filters exactly as published: centre (17) at x_bar, sign(u), no gate, measurements without delay. The state goes to
  the servo, the fault does not (section III.B.3).
- Load: none; F_d of (4), a hinge moment of -800 N m - 20 kN m/rad delta (an elevator segment near 290 kt), known to
  filter (17) and inversion (9); the same unknown, a perturbation that the paper does not claim
  to survive ("does not require the calculation of the aerodynamic forces", section II).
- No limit on the valve but |u| <= 1, no friction.
"""

import functools
import math
from typing import Any

import numpy as np

from actuators.block import dtype, kernel
from actuators.common import linkage
from actuators.hydraulic import servo
from cosim.papers.lu17 import transcription
from fdi.hydraulic import iotsekf, rtsekf
from fdi.hydraulic import two_stage_ekf as two_stage

DT, SECONDS, ONSET = 0.005, 25.0, 12.0  # onset: [Lu17] table 1
PHASES = {"before": (2.0, 12.0), "after": (13.0, 25.0), "whole": (2.0, 25.0)}  # [s]; after: whole periods of the OFC
SEEDS = 100
AMPLITUDE = 20e-3  # of the command [m]
ROD = 1e-4  # noise of the rod sensor [m]
OFC_U, OFC_HZ = 0.02, 1.0  # [1], [Hz]
BIAS = 5e-3  # liquid jamming [m]
RATE, LIMIT = linkage.rod(np.radians(20.0)), linkage.rod(linkage.TRAVEL[1])  # runaway [m/s], to [m]
HM0, HMD = -800.0, -20e3  # hinge moment at zero [N m], slope [N m/rad]
SUBSTEPS = 5

MODEL = {"no load": 0.0, "F_d known": 1.0, "F_d unknown": 0.0}  # share known
SCENARIOS = {  # name -> (figure, filter)
    "fault-free": (2, "iotsekf"),
    "liquid OFC": (3, "iotsekf"),
    "solid OFC": (4, "iotsekf"),
    "liquid jamming": (5, "rtsekf"),
    "solid jamming": (6, "rtsekf"),
    "runaway": (7, "rtsekf"),
    "held rod": (6, "rtsekf"),  # a solid jamming as it is
    "walk": (3, "iotsekf"),  # an input fault as (14) has it: nothing but this is what the filter reckons with
}

TICK = dtype(
    [
        ("command", "f8"),  # rod [m]
        ("f_u", "f8"),  # added at the valve [1]
        ("s_u", "f8"),  # share of u replaced [1]
        ("bias", "f8"),  # added to the sensor [m]
        ("instead", "f8"),  # 1: the surface is not where the rod of (4) is
        ("ramp", "f8"),  # but so far from where that was at onset, up to LIMIT [m]
        ("held", "f8"),  # 1: the rod cannot move
    ]
)
OUT = dtype(
    [
        ("q", "f8"),  # true state of (4) [m], [m/s], [1]
        ("qd", "f8"),
        ("x3", "f8"),
        ("q_hat", "f8"),
        ("qd_hat", "f8"),
        ("x3_hat", "f8"),
        ("f", "f8"),  # fault over the last tick: input [1] or output [m]
        ("f_hat", "f8"),
        ("surface", "f8"),  # where the surface is, as rod [m]
        ("y", "f8"),  # measured [m]
        ("r", "f8"),  # reference q_ref [m]
        ("u", "f8"),  # valve command [1]
        ("nis", "f8"),  # squared innovation of the IOTSEKF over its variance [1]
        ("f_sigma", "f8"),  # deviation of its fault by its own reckoning [1]
    ]
)
SETUP = dtype(
    [
        ("watch", "f8"),  # 0 IOTSEKF, 1 RTS-EKF
        ("linear", "f8"),  # 1: the servo inverts (11) without its root
        ("measured", "f8"),  # 1: the servo closes on the measurement, through its own observer
        ("hm0", "f8"),  # truth [N m]
        ("hmd", "f8"),  # [N m/rad]
        ("known", "f8"),  # share of it that filter and servo reckon with
        ("walk", "f8", (3,)),  # process noise of the truth in a tick, 1 sigma [m, m/s, 1]
        ("walk_f", "f8"),  # of an input fault as (14) has it [1]
    ]
)


@kernel
def _advance(q, qd, x3, v, held, s, p, dt):
    """Return (q, q', x3) of the truth after one tick under the valve opening `v`."""
    h = dt / SUBSTEPS
    for _ in range(SUBSTEPS):
        F = (s.hm0 + s.hmd * (q + 0.5 * h * qd) / p.arm) / p.arm  # of the middle of the sub-step
        at = q
        q, qd, x3 = transcription.advance(q, qd, x3, v, 0.0, F, h)
        if held > 0.5:
            q, qd = at, 0.0
        if q > LIMIT:
            q, qd = LIMIT, min(qd, 0.0)
    return q, qd, x3


@kernel
def _seed(tick, noise, s, c, pi, pr, x, i, r, us, ui, ur, dt, out):
    """Fly one seed: truth, filter and servo `x` in lockstep."""
    q, qd, x3, onset, f = 0.0, 0.0, x.x3, 0.0, 0.0
    x3 = -s.hm0 / (c.arm * c.A_p * c.P_s)
    u, walked = 0.0, 0.0
    for k in range(tick.shape[0]):
        t = tick[k]
        if t.instead < 0.5 and t.held < 0.5:
            onset = q
        surface = min(onset + t.ramp, LIMIT) if t.instead > 0.5 else q
        y = surface + t.bias + ROD * noise[k, 0]
        if s.watch < 0.5:
            ui.u, ui.y_rod = u, y
            two_stage.remember(i, ui)
            two_stage.estimate(i, ui, pi, dt)
            q_hat, qd_hat, x3_hat, f_hat = i.q_now, i.v_now, i.x3_now, i.f_hat
        else:
            ur.u, ur.y_rod = u, y
            rtsekf.step(r, ur, pr, dt)
            q_hat, qd_hat, x3_hat, f_hat = r.q_now, r.v_now, r.x3_now, r.f_hat
            f = surface + t.bias - q
        us.command = t.command / c.arm
        us.q_meas = y
        us.q_fb, us.qd_fb, us.x3_fb = q_hat, qd_hat, x3_hat
        us.load_fb = s.known * (s.hm0 + s.hmd * q_hat / c.arm) / c.arm
        servo.step(x, us, c, dt)
        o = out[k]
        o.q, o.qd, o.x3, o.q_hat, o.qd_hat, o.x3_hat = q, qd, x3, q_hat, qd_hat, x3_hat
        o.f, o.f_hat, o.surface, o.y, o.r, o.u = f, f_hat, surface, y, x.r, x.u
        o.nis, o.f_sigma = i.nis_rod, i.f_sigma
        if s.linear > 0.5:
            x.u *= math.sqrt(max(0.0, 1.0 - math.copysign(x3_hat, x.u * x3_hat)))
        u = x.u
        walked += s.walk_f * noise[k, 4]
        v = min(max((1.0 - t.s_u) * u + t.f_u + walked, -1.0), 1.0)
        if s.watch < 0.5:
            f = v - u
        q, qd, x3 = _advance(q, qd, x3, v, t.held, s, c, dt)
        if t.held < 0.5:
            q += s.walk[0] * noise[k, 1]
            qd += s.walk[1] * noise[k, 2]
        x3 += s.walk[2] * noise[k, 3]


@kernel
def _fly(tick, noise, s, c, pi, pr, x, i, r, us, ui, ur, dt, out):
    for n in range(out.shape[0]):
        _seed(tick, noise[n], s, c, pi, pr, x[n], i[n], r[n], us, ui, ur, dt, out[n])


def schedule(scenario: str, rate: float = RATE) -> Any:
    """Return the TICK records of a scenario; `rate` of a runaway [m/s of rod]."""
    n = round(SECONDS / DT)
    t = np.arange(n) * DT
    tick = np.zeros(n, TICK)
    for first in (2.0, 13.0):
        for a, b, sign in ((0, 3, 1), (3, 5, -1), (5, 6, 1), (6, 7, -1)):
            tick["command"][(t > first + a - DT / 2) & (t < first + b - DT / 2)] = sign * AMPLITUDE
    late = t > ONSET - DT / 2
    tau = t[late] - ONSET
    if scenario in ("liquid OFC", "solid OFC"):
        tick["f_u"][late] = OFC_U * np.sin(2 * np.pi * OFC_HZ * tau)
        tick["s_u"][late] = scenario == "solid OFC"
    elif scenario == "liquid jamming":
        tick["bias"][late] = BIAS
    elif scenario in ("solid jamming", "runaway"):
        tick["instead"][late] = 1.0
        tick["ramp"][late] = rate * tau if scenario == "runaway" else 0.0
    elif scenario == "held rod":
        tick["held"][late] = 1.0
    elif scenario not in ("fault-free", "walk"):
        raise ValueError(f"{scenario!r} is not one of {', '.join(SCENARIOS)}")
    return tick


@functools.lru_cache(maxsize=1)
def _noise(seeds):
    n = round(SECONDS / DT)
    draws = lambda key, seed, columns: np.random.default_rng([key, seed]).standard_normal((n, columns))  # noqa: E731
    return np.stack([np.hstack([draws(17, s, 4), draws(18, s, 1)]) for s in range(seeds)])  # 18: of the walk alone


def fly(
    scenario: str,
    load: Any = "no load",
    *,
    seeds: Any = SEEDS,
    measured: Any = False,
    linear: Any = False,
    quiet: Any = False,
    hmd: Any = HMD,
    rate: float = RATE,
    **filter_values: Any,
) -> Any:
    """Return OUT records (seeds, ticks) of a scenario under a load of MODEL.

    `measured`: the servo closes on the rod sensor instead of the estimate; `linear`: it does not know the root of (11),
    the valve's flow under pressure; `quiet`: no noise at all; `hmd`: slope of
    the load [N m/rad]; `rate` of a runaway [m/s of rod]; `filter_values` replace parameters of the filter.
    """
    tick = schedule(scenario, rate)
    known = MODEL[load]
    watch = SCENARIOS[scenario][1]
    s = np.zeros(1, SETUP)
    s["watch"], s["linear"], s["measured"], s["known"] = watch == "rtsekf", linear, measured, known
    if load != "no load":
        s["hm0"], s["hmd"] = HM0, hmd
    s["walk"] = 0.0 if quiet else np.sqrt(np.array(iotsekf.NOISE["q"])[:3] * DT)
    s["walk_f"] = np.sqrt(np.array(iotsekf.NOISE["q_f"]) * DT) if scenario == "walk" else 0.0
    own: dict[str, Any] = dict(filter_values)
    form: dict[str, Any] = {"load": int(known > 0.0), "dt": DT, "delay_s": 0.0}
    as_published: dict[str, Any] = {"centre": 0.0, "total_sign": 0.0, "gate_rod": two_stage.GATE_NONE}
    pi = iotsekf.params(**form, **(as_published | own if watch == "iotsekf" else as_published))
    pr = rtsekf.params("published", **form, **(own if watch == "rtsekf" else {}))
    c = servo.params(dt=DT, delay=0.0, u_max=1.0)
    x = servo.init_at(np.repeat(c, seeds))
    us, ui, ur = (np.zeros(1, module.INPUTS) for module in (servo, iotsekf, rtsekf))
    us["q_valid"] = 1.0
    us["q_use"] = us["qd_use"] = us["x3_use"] = us["load_use"] = 0.0 if measured else 1.0
    ui["y_rod_valid"] = ur["y_rod_valid"] = 1.0
    for u in (ui, ur):
        u["hm0_model"], u["hmd_model"] = known * s["hm0"], known * s["hmd"]
    out = np.zeros((seeds, len(tick)), OUT)
    noise = np.zeros((seeds, len(tick), 5)) if quiet else _noise(seeds)
    i, r = iotsekf.init(np.repeat(pi, seeds)), rtsekf.init(np.repeat(pr, seeds))
    _fly.compiled(tick, noise, s[0], c[0], pi[0], pr[0], x, i, r, us[0], ui[0], ur[0], DT, out)
    return out
