"""LPV sliding-mode observer: elevator, load-factor and angle-of-attack faults at once. Source: [Alwi14].

| symbol | here | units of the paper, inside only |
|---|---|---|
| x = [alpha, Z, theta, V, q, z_f] (39) | canonical state, unmeasured part first | deg, m, deg, m/s, deg/s, (g, deg) |
| y_m (9) | s = [Z, theta, V, q, z_f1, z_f2] | |
| rho (28), Table 4 | mass, CG, CAS, Mach | t, per cent, kt, - |
| e_y (14), nu (15), K, delta, P_o (16) | output error, injection and its constants | |
| L (21), W (22), A_f (7), A22s | gains of `fdi.lpv_smo.lpv_smo.design` | |
| f_hat (22), (25) | `f_hat_elevator`, `f_hat_n_z`, `f_hat_alpha` | converted to rad, g, rad |

The state is absolute, the dynamics are deviations from the trim maps: x_hat' = A(rho) (x_hat - x_eq(rho)) + ...
so that a change of rho in flight adds no derivative of x_eq. With w = x_hat_1 + L x_hat_2 and (20) the injection
cancels out of the unmeasured part, and with the gains G_l that decouple the error dynamics the observer (12) is exactly

    w'   = (A11 + L A21)(w - w_eq) + (A12 + L A22 - (A11 + L A21) L)(s - s_eq) + (B1 + L B2)(u - u_eq)
    e_y' = phi - s' + A22s e_y + nu,     phi = A21 (w - L s - x1_eq) + A22 (s - s_eq) + B2 (u - u_eq)

Between samples s and the forcing are linear: w is advanced exactly (first-order hold). The slope of nu is
K P_o / delta = 1.5e4 1/s, so e_y takes a backward-Euler step: (1 - h a_i + h K P_i / (m + delta)) e_i = b_i
with m = |P_o e| is one monotone scalar equation. An explicit step is stable only below 135 us, and looks plausible
while it is wrong.

u is what a healthy elevator would do: the mean of the four commands, followed at `rate_a` at most, through a lag of
`omega_a`, delayed as the measurements are; a measured surface would hide the fault. V is the speed that carries
Z' = V sin(theta - alpha); true airspeed, smoothed by `tau_v`, because 0.05 m/s of noise at 5 ms is 14 m/s2 and would
saturate K. Feed the inertial, not the barometric altitude, for the same reason.

In flight three things go beyond the paper, all off by default (`fitted` switches them on):

- Several boxes, each with a model and gains of its own whose inequalities hold at its vertices
  (`fdi.lpv_smo.boxes`); the state goes over from one to the next. `why` says what it is outside of.
- Wind and gusts. A steady wind is learned (`core.drift`); the states are those of the path over the air that drifts
  with it (over the ground in tables 2, 3), the forces those of the air. A gust of angle a turns the path by
  xi = A_11 a, which that angle shows (`core.gust`) and which no fault of n_z or of the vane moves; what a does to the
  three estimates is taken out of them, and likewise what the air's own speed does. The tail meets it later than the
  wing, which is what a rate of pitch of -a' would do. Thrust acts on pitch through the engines' arm: nu of the speed
  channel says how much.
- Each estimate is judged by itself, against a threshold that grows with the rms of a: a fault does not raise it. It is
  no less than `least` deviations of what sensor noise makes of the estimate (`fdi.lpv_smo.noise`).

(2) leaves out the feedthrough of the elevator fault into n_z: `f_hat_n_z_raw` is the printed reconstruction,
`f_hat_n_z` subtracts D51 f_hat_e. All reconstructions pass one lag `tau_f` (0.2 s in the paper): an OFC of
0.5 / 1 / 2 / 5 Hz comes out at 0.85 / 0.62 / 0.37 / 0.16 of its amplitude, and a step needs 0.46 s for 90 %.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from actuators.block import entry, kernel, record
from actuators.constants import M_S_PER_KT, RAD_PER_DEG
from fdi.common import bank as frequencies
from fdi.common import gyro
from fdi.common.decision import confirm, usable
from fdi.common.record import Detector, Estimate, Site
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID, SENSOR
from fdi.common.why import BANK, BOX_ALPHA, BOX_MACH, LOST_SENSOR, NOT_READY, VALID
from fdi.lpv_smo.boxes import load as load_boxes
from fdi.lpv_smo.core import NB, NEAR, M, N, P, R, T, bank, drift, gust, inputs, observe, outputs, reconstruct
from fdi.lpv_smo.fields import INPUTS, PARAMS, STATE
from fdi.lpv_smo.model import LpvModel, powers
from fdi.lpv_smo.noise import deviations
from fdi.lpv_smo.synthesis import Design, canonical, design, load, save, verify  # noqa: F401 (the public design functions)

LEARN = 8.0  # in flight: the paper's faults come at 10 s [s]
ADOT = 0.3  # of a transport: Cm_alphadot over Cm_q + Cm_alphadot
GRADIENT = 0.6  # of the damping in pitch: what a gust that grows along the body does, by training flights
CULPRITS = ("", "elevator", "n_z", "alpha")
STAYS = 0.7  # of its threshold: above it a fault that is declared has not ended
TREND = 3.0  # lag of alpha_eq, which follows airspeed, where its change is judged: gusts change airspeed, too [s]
HELD = 0.6  # an oscillation is held to be there for so long after the last fit that found it [s]
OUTPUTS = (
    "r", "alarm", "verdict", "culprit", "alarm_elevator", "alarm_n_z", "alarm_alpha", "valid", "why", "box",
    "f_hat_elevator", "f_hat_n_z", "f_hat_n_z_raw", "f_hat_alpha", "f_sigma", "alpha_hat", "gust_hat", "e_norm",
    "nu_norm",
)
DETECTOR = Detector(
    id="lpv_smo",
    level="aircraft",
    summary="LPV sliding-mode observer: elevator, load-factor and angle-of-attack faults [Alwi14]",
    inputs={
        **dict.fromkeys(("de_lo", "de_li", "de_ri", "de_ro"), "de_cmd"),  # a measured surface would hide its fault
        **{"stab": "stab_cmd", "h": "h_inertial", "V": "v_ground"},
        **{w: w for w in ("alpha_ground", "tas", "theta", "q", "n_z", "alpha", "mass", "cg", "cas", "mach")},
        **{w: w for w in ("beta", "phi", "p", "r")},
    },
    group="airframe motion",
    designed_for={  # [Alwi14]: steps of elevator, n_z and alpha
        **dict.fromkeys(("*.bias@command", "*.runaway*", "*.jam_liquid"), ("ambiguous",)),
        **dict.fromkeys(("*.ofc_liquid", "*.ofc_liquid@*"), ("ofc_liquid", "ambiguous")),
        **dict.fromkeys(("sensor.n_z", "sensor.alpha"), ("sensor",)),
    },
    may_see={
        **dict.fromkeys(("*.ofc_solid", "*.ofc_solid@*"), ("ofc_liquid", "ambiguous")),
        **dict.fromkeys((
            "*.jam*", "*.loss_of_effectiveness*", "*.free_float", "*.supply_pressure_drop", "*.rod", "*.position",
            "*.velocity", "stabiliser", "engine", "sensor.q", "sensor.theta", "sensor.v_ground", "sensor.alpha_ground",
            "sensor.cas", "sensor.mach", "sensor.h_inertial", "sensor.mass", "sensor.cg",
        ), ("ambiguous",)),
    },
    blind="estimates elevator, load-factor and angle-of-attack faults from longitudinal motion: nothing "
    "lateral, nothing inside an actuator that the surface does not follow",
    estimates=(
        Estimate("elevator", "f_hat_elevator", "rad"), Estimate("n_z", "f_hat_n_z", "g"),
        Estimate("alpha", "f_hat_alpha", "rad"),
    ),
    looks_back={"delay": "line"},
    sizes={"n_box": 1.0, **frequencies.SIZES},
    places={"head": ("line", 0), **frequencies.PLACES},
    design="lpv_smo_boxes",
    range={  # around all boxes, with the margin of `core`; which box holds a point is decided there
        "mass": (176e3, 428e3), "cg": (0.184, 0.436), "cas": (104.4 * M_S_PER_KT, 408.0 * M_S_PER_KT),
        "mach": (0.12, 0.9),
    },
    fit=lambda site: fitted(site),
)  # fmt: skip


def params(
    which: str = "flight", *, model: LpvModel | None = None, made: Design | None = None,
    designs: Sequence[tuple[LpvModel, Design | None]] | None = None, K: float = 30.0, delta: float = 1e-4,
    tau_f: float = 0.2, tau_g: float = 0.1, tau_v: float = 0.2, tau_rho: float = 0.5, omega_a: float = 0.0,
    rate_a: float = 0.0, delay: float = 0, bank: bool = True, gust: bool = False,
    inertia: tuple[float, float] = (0.0, 0.0), adot: float = 0.0, thrust: float = 0.0, gradient: float = 0.0,
    sigma_q: float = 0.02 * RAD_PER_DEG, t_settle: float = 2.0, t_learn: float = 0.0, dt: float = 0.005,
    own: Any = None,
) -> np.ndarray:  # fmt: skip
    """Return PARAMS of an `LpvModel` and its `Design`, by default the paper's box, stored for this aircraft.

    `designs`, a list of (model, design), gives several boxes instead: the one that holds rho is used. States, inputs
    and outputs must be those of [Alwi14] (33), (37): alpha, Z, theta, V, q; elevator, stabiliser; Z, theta, V, q, n_z,
    alpha, in deg, m, m/s, g. Fewer than four scheduling parameters leave the last ones unused. `gust` asks for the
    angle of attack over the ground as an input. Raises ValueError for another shape, or too many boxes.
    """
    if designs is None:
        designs = [load() if model is None else (model, made)]
    if not 0 < len(designs) <= NB:
        raise ValueError(f"{len(designs)} boxes; from 1 to {NB} fit")
    p = record(
        PARAMS, K=K, delta=delta, tau_f=tau_f, tau_g=tau_g, tau_v=tau_v, tau_rho=tau_rho, omega_a=omega_a,
        rate_a=rate_a, delay=delay, sigma_q=sigma_q, t_settle=t_settle, t_learn=t_learn, gust=float(gust),
        inertia=inertia, adot=adot, thrust=thrust, gradient=gradient, bank=float(bank),
        n_box=len(designs), mach_max=1.0, **frequencies.design(dt), **thresholds("lpv_smo", which, own),
    )  # fmt: skip
    for k, (one, its) in enumerate(designs):
        for name, value in _box(one, its).items():
            p[name][0, k] = value
    nr = len(designs[0][0].A) - 1
    exponents = powers(nr)
    p["powers"][0] = np.pad(exponents, ((0, T - len(exponents)), (0, R - nr)))
    return p


def _box(model, made):
    """Return the fields of one box."""
    nr = len(model.A) - 1
    if made.A.shape[1:] != (N, N) or made.B.shape[1:] != (N, M) or made.W.shape != (3, P) or nr > R:
        raise ValueError(f"the block observes 5 states, 6 outputs, 2 inputs, 1 + 2 faults; got A {made.A.shape}")
    n, m = model.B.shape[1:]
    x_eq, u_eq, y_eq = np.split(np.asarray(model.trim, float), [n, n + m])
    eq = np.vstack([made.x_from @ np.vstack([x_eq, y_eq[-2:]]), u_eq])
    return {
        "A": _pad(made.A), "B": _pad(made.B), "E": _pad(made.E)[:, 0, 0], "D51": _pad(made.D2)[:, 0, made.actuator[0]],
        "mix": made.y_from, "L": made.L[0], "W": made.W, "a22": made.A22s, "a_f": made.A_f,
        "low": np.r_[model.box[:, 0], np.zeros(R - nr)], "high": np.r_[model.box[:, 1], np.ones(R - nr)],
        "eq": np.hstack([eq, np.zeros((N + M, T - eq.shape[1]))]), "to_x": made.x_from[:, :5],
    }  # fmt: skip


def _pad(stack):
    return np.concatenate([stack, np.zeros((R + 1 - len(stack), *stack.shape[1:]))])


def fitted(site: Site, paper: bool = False) -> np.ndarray:
    """Return PARAMS for a loop: commands as late as q is, through a lag as slow as its servos; all boxes, none of them
    believed beyond the Mach number of the fastest, gusts taken out. With `paper` the paper's own box and observer.
    """
    about = site.aircraft()
    model = about.model
    xx, yy, zz, xz = model.gyration2
    (tx, _, tz), (rx, _, rz) = model.thrust_axis, np.mean(model.engine, axis=0)
    made = params(
        designs=None if paper else load_boxes(site.own), own=site.own, gust=not paper, t_learn=LEARN,
        delay=site.ticks("q"), omega_a=1.0 / about.delays[0],
        rate_a=0.0 if paper else about.rates[0] / RAD_PER_DEG,
        inertia=((zz - xx) / yy, xz / yy), adot=0.0 if paper else ADOT,
        gradient=0.0 if paper else GRADIENT, dt=site.dt,
        thrust=(rz * tx - rx * tz) / tx / yy / RAD_PER_DEG,
    )  # fmt: skip
    if not paper:
        made["mach_max"] = made["high"][0, : int(made["n_box"][0]), R - 1].max()
        made["noise"][0, : int(made["n_box"][0])] = deviations(made.tobytes(), site.dt)
    return made


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not yet started: the observer starts at the first complete set of measurements."""
    return np.zeros(p.shape, STATE)


@kernel
def _declare(x, p, i, f, most, dt):
    """Confirm estimate f of fault i against `most`; return how far it is beyond, and whether it is declared."""
    score = math.fabs(f) / most
    on = 1.0 if x.held[i] > 0.0 else 0.0
    beyond = score >= (STAYS if on > 0.5 else 1.0)
    if i == 0:
        # a half period is counted by one sample: only where noise alone does not come
        if math.fabs(f) >= max(most, p.floor * x.f_sigma) and f * x.sign <= 0.0:
            x.half = x.half + 1.0 if x.since < 1.0 else 1.0
            x.sign, x.since = math.copysign(1.0, f), 0.0
        # an oscillation is beyond its threshold for less than the confirmation time at once: it counts half periods
        beyond = beyond or (x.half >= 3.0 and x.since < 1.0) or x.swing > 0.0
    x.timer[i], on = confirm(x.timer[i], on, beyond, dt, p.t_confirm, p.t_release)
    x.held[i] = x.held[i] + dt if on > 0.5 else 0.0
    return score, on


@kernel
def _oscillation(x, p, gust, away, dt):
    """Hold an oscillation of the elevator's estimate that keeps its phase over two periods, for HELD."""
    frequencies.push(x, p, x.f_hat_elevator, 0.0)
    x.swing = max(x.swing - dt, 0.0)
    for k in range(frequencies.K):
        if x.bank_new[k] < 0.5:
            continue
        most = p.swing_threshold[k] + p.swing_gust[k] * gust + p.swing_away[k] * away
        good = frequencies.mixed(x, k, 1.0, 0.0) >= most * most
        if good:
            agreement, purity, _ = frequencies.character(x, p, k, 1.0, 0.0)
            good = agreement >= p.coherence and purity >= p.purity
        x.hit[k] = x.hit[k] + 1.0 if good else 0.0
        if x.hit[k] >= p.hits:
            x.swing = HELD


@kernel
def _decide(x, p, dt):
    """Declare each fault by its own estimate; of those declared the summary names the one that has been so longest."""
    away, gust = x.apart, x.rms
    x.since += dt
    _oscillation(x, p, gust, away, dt)
    most_e = max(p.t_elevator + p.s_elevator * away + p.g_elevator * gust, p.least[0] * x.f_sigma)
    most_n = max(p.t_n_z + p.s_n_z * away + p.g_n_z * gust, p.least[1] * x.sigma[0])
    most_a = max(p.t_alpha + p.s_alpha * away + p.g_alpha * gust, p.least[2] * x.sigma[1])
    a, x.alarm_elevator = _declare(x, p, 0, x.f_hat_elevator, most_e, dt)
    b, x.alarm_n_z = _declare(x, p, 1, x.f_hat_n_z, most_n, dt)
    c, x.alarm_alpha = _declare(x, p, 2, x.f_hat_alpha, most_a, dt)
    x.r = max(a, max(b, c))
    x.culprit, longest = 0.0, 0.0
    for i in range(3):
        if x.held[i] > longest:
            longest, x.culprit = x.held[i], i + 1.0
    x.alarm = 1.0 if longest > 0.0 else 0.0
    if x.culprit > 1.5:
        x.verdict = SENSOR
    elif x.culprit > 0.5:
        x.verdict = OFC_LIQUID if (x.half >= 3.0 and x.since < 1.0) or x.swing > 0.0 else AMBIGUOUS
    else:
        x.verdict = NONE
    if x.alarm > 0.5 and x.gyro_off > 0.0:  # all three estimates take q for true
        x.verdict, x.culprit = AMBIGUOUS, 0.0
        x.alarm_elevator, x.alarm_n_z, x.alarm_alpha = 0.0, 0.0, 0.0


@kernel
def _silent(x, why):
    """Say nothing but why."""
    x.valid, x.why = 0.0, why
    x.r, x.alarm, x.verdict, x.culprit = 0.0, 0.0, NONE, 0.0
    x.alarm_elevator, x.alarm_n_z, x.alarm_alpha = 0.0, 0.0, 0.0
    for i in range(3):
        x.held[i], x.timer[i] = 0.0, 0.0
    x.swing, x.half = 0.0, 0.0
    for j in range(frequencies.LEVELS):
        x.bank_seen[j] = 0.0
    for k in range(frequencies.K):
        x.hit[k] = 0.0


@kernel
def step(x, u, p, dt):
    """Advance the observer, reconstruct the three faults, decide."""
    good = usable(u.h, u.h_valid) * usable(u.theta, u.theta_valid) * usable(u.V, u.V_valid) * usable(u.q, u.q_valid)
    if p.gust > 0.5:
        good *= usable(u.alpha_ground, u.alpha_ground_valid)
    gyro.compare(x, u, dt)
    if x.age == 0.0:  # the first tick needs all of them; later n_z and alpha may drop out
        good *= usable(u.n_z, u.n_z_valid) * usable(u.alpha, u.alpha_valid)
    if good < 0.5:  # without a fault-free output there is no e_y: keep the estimates, start again when it is back
        x.age = 0.0
        _silent(x, LOST_SENSOR)
        return
    why = inputs(x, u, p, dt)
    if why != VALID and p.t_learn > 0.0 and x.learned < 0.5:  # what is learned at the start is learned within a box
        x.age = 0.0
        _silent(x, why)
        return
    x.speed = x.v_s
    if p.gust > 0.5:
        drift(x, u, p, dt)
    outputs(x, u, p, dt)
    bank(x, u, p)
    observe(x, p, dt)
    if p.gust > 0.5:
        gust(x, u, p, dt)
    if x.age == 0.0:
        x.gust, x.path, x.calm = max(x.gust, p.gust_0 * p.gust_0), x.alpha_hat, 0.0
        x.trim = x.eq[0] * RAD_PER_DEG
    x.age += dt
    x.path += (1.0 - math.exp(-dt / p.tau_f)) * (x.alpha_hat - x.path)
    x.away = x.path - x.eq[0] * RAD_PER_DEG
    x.trim += (1.0 - math.exp(-dt / TREND)) * (x.eq[0] * RAD_PER_DEG - x.trim)
    reconstruct(x, u, p, dt)
    if x.learned > 0.5:
        # in a dive the angle of attack may be that of slower level flight: it does not tell how far the model is off
        from_trim, learned_at = x.path - x.trim, x.alpha_0 - x.trim_0
        x.apart = math.fabs(x.trim - x.trim_0) + math.fabs(from_trim - learned_at)
    else:
        x.apart = math.fabs(x.away)
    if x.age > p.t_settle:  # also while nothing is said: what comes after is judged by it
        # gust_hat is not one of the three estimates, so that no fault of a sensor passes for weather
        more = min(math.fabs(x.gust_hat), p.gust_max) ** 2 - x.gust
        x.gust += (1.0 - math.exp(-dt / (p.tau_blow if more > 0.0 else p.tau_gust))) * more
    x.rms = math.sqrt(x.gust + x.doubt * x.doubt)
    # without the vane, whose fault is no stall; beyond a stall alpha_hat is wrong, but not the angle over the ground
    flown = max(x.path, x.path - x.slip * RAD_PER_DEG) if p.gust > 0.5 else x.path
    # where lift has bent, gust_hat is what is missing of it: level flight in the gusts that blow must not get there
    most = max(flown + max(x.gust_hat, 0.0), x.eq[0] * RAD_PER_DEG + math.sqrt(x.gust))
    steep = most > p.alpha_max or -x.A[0, 0] < p.lift_min
    blown = math.fabs(x.gust_hat) > p.gust_max or x.gust > (NEAR * p.gust_max) ** 2
    linear = math.fabs(x.away) <= p.away_max and not steep and not blown
    x.calm = x.calm + dt if linear else 0.0
    if why == VALID:
        if usable(u.n_z, u.n_z_valid) * usable(u.alpha, u.alpha_valid) < 0.5:
            why = LOST_SENSOR
        elif x.age <= p.t_settle:
            why = NOT_READY
        elif x.rho[R - 1] > p.mach_max:
            why = BOX_MACH
        elif x.learned < 0.5 and p.t_learn > 0.0:
            why = NOT_READY
        elif x.calm < min(x.age, p.t_recover) - 0.5 * dt:
            why = BOX_ALPHA
        elif p.bank_max > 0.0 and math.fabs(u.phi) > p.bank_max and usable(u.phi, u.phi_valid) > 0.5:
            why = BANK
    if why == VALID:
        x.valid, x.why = 1.0, VALID
        _decide(x, p, dt)
    else:
        _silent(x, why)


rollout = entry(step, STATE, INPUTS, PARAMS)
