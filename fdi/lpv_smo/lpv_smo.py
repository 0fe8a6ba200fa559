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

u is what a healthy elevator would do: the mean of the four commands through a lag of `omega_a`, delayed as the
measurements are; a measured surface would hide the fault. V is the speed that carries Z' = V sin(theta - alpha); true
airspeed, smoothed by `tau_v`, because 0.05 m/s of noise at 5 ms is 14 m/s2 and would saturate K. Feed the inertial,
not the barometric altitude, for the same reason.

(2) leaves out the feedthrough of the elevator fault into n_z: `f_hat_n_z_raw` is the printed reconstruction,
`f_hat_n_z` subtracts D51 f_hat_e. All reconstructions pass one lag `tau_f` (0.2 s in the paper): an OFC of
0.5 / 1 / 2 / 5 Hz comes out at 0.85 / 0.62 / 0.37 / 0.16 of its amplitude, and a step needs 0.46 s for 90 %.
"""

import math

import numpy as np

from actuators.block import dtype, entry, kernel, record
from fdi.common.decision import confirm, usable
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID, SENSOR
from fdi.lpv_smo.core import DEG, DELAY, M, N, P, R, T, bank, inputs, observe, outputs, reconstruct
from fdi.lpv_smo.model import powers
from fdi.lpv_smo.synthesis import Design, canonical, design, load, save, verify  # noqa: F401 (the public design functions)

LEARN = 8.0  # in flight: the paper's faults come at 10 s [s]
CULPRITS = ("", "elevator", "n_z", "alpha")
# By so much another fault must be larger than the one that is named, chosen: without it three steps at once had 194
# names in 20 s at point A, with it one
CLEARLY = 1.25

PARAMS = dtype(
    [
        ("A", "f8", (R + 1, N, N)),  # A(rho) of (8), canonical coordinates, affine stack
        ("B", "f8", (R + 1, N, M)),  # B(rho) of (8)
        ("E", "f8", (R + 1,), "deg/s2 per deg"),  # E_p(rho) = B51 of (35)
        ("D51", "f8", (R + 1,), "g/deg"),  # elevator feedthrough into n_z
        ("eq", "f8", (N + M, T)),  # trim maps of canonical state and inputs, cubic in normalised rho
        ("powers", "f8", (T, R)),  # exponents of their monomials
        ("low", "f8", (R,)),  # box of rho: t, %, kt, -
        ("high", "f8", (R,)),
        ("mix", "f8", (P, P)),  # s = mix @ [Z theta V q z_f1 z_f2], the identity for the paper's outputs
        ("L", "f8", (P,)),  # (21)
        ("W", "f8", (3, P)),  # (22)
        ("a22", "f8", (P,), "rad/s"),  # diagonal of A22s, negative
        ("a_f", "f8", (2,), "rad/s"),  # diagonal of A_f
        ("K", "f8", "-"),  # modulation gain of (15)
        ("delta", "f8"),  # smoothing of (15)
        ("tau_f", "f8", "s"),  # lag of the reconstruction
        ("tau_v", "f8", "s"),  # smoothing of V, 0 for none
        ("tau_rho", "f8", "s"),  # smoothing of rho, 0 for none
        ("omega_a", "f8", "rad/s"),  # healthy elevator as a lag of its command, 0 for none
        ("delay", "f8", "-"),  # of the commands, as long as that of q
        ("sigma_q", "f8", "rad/s"),  # noise of q per sample, for f_sigma
        ("bank", "f8", "-"),  # 1: bank and lateral rates are taken into account
        ("inertia", "f8", (2,)),  # (Izz - Ixx) / Iyy, Ixz / Iyy
        ("to_x", "f8", (N, 5)),  # state of the paper to canonical state
        ("t_elevator", "f8", "rad"),  # thresholds of what no gust can do [rad], [g], [rad]
        ("t_n_z", "f8", "g"),
        ("t_alpha", "f8", "rad"),
        ("w_elevator", "f8", "rad"),  # thresholds of the slow means, gusts included [rad], [g], [rad]
        ("w_n_z", "f8", "g"),
        ("w_alpha", "f8", "rad"),
        ("s_elevator", "f8", "-"),  # growth of all with |alpha - alpha_eq|: the affine model's error [-], [g/rad], [-]
        ("s_n_z", "f8", "g/rad"),
        ("s_alpha", "f8", "-"),
        ("g_elevator", "f8", "-"),  # and with the rms of gusts, as f_hat_alpha shows them [-], [g/rad], [-]
        ("g_n_z", "f8", "g/rad"),
        ("g_alpha", "f8", "-"),
        ("away_max", "f8", "rad"),  # beyond this |alpha - alpha_eq| the affine model is not believed
        ("t_recover", "f8", "s"),  # nor for so long after it was
        ("gust_0", "f8", "rad"),  # rms of gusts assumed at the start
        ("tau_gust", "f8", "s"),  # memory of that rms
        ("tau_slow", "f8", "s"),  # of the slow means
        ("t_confirm", "f8", "s"),
        ("t_release", "f8", "s"),
        ("t_learn", "f8", "s"),  # an offset of elevator and n_z is learned up to this time, 0 for none
        ("t_settle", "f8", "s"),  # no decision for so long after a (re)start
    ]
)
INPUTS = dtype(
    [
        ("de_lo", "f8", "rad"),  # elevator commands, trailing edge down +
        ("de_li", "f8", "rad"),
        ("de_ri", "f8", "rad"),
        ("de_ro", "f8", "rad"),
        ("stab", "f8", "rad"),  # stabiliser position, trailing edge down +
        ("h", "f8", "m"),  # inertial altitude
        ("h_valid", "f8", "-"),
        ("theta", "f8", "rad"),
        ("theta_valid", "f8", "-"),
        ("V", "f8", "m/s"),  # true airspeed
        ("V_valid", "f8", "-"),
        ("q", "f8", "rad/s"),
        ("q_valid", "f8", "-"),
        ("n_z", "f8", "g"),  # +1 in level flight
        ("n_z_valid", "f8", "-"),
        ("alpha", "f8", "rad"),
        ("alpha_valid", "f8", "-"),
        ("phi", "f8", "rad"),
        ("phi_valid", "f8", "-"),
        ("p", "f8", "rad/s"),
        ("p_valid", "f8", "-"),
        ("r", "f8", "-"),
        ("r_valid", "f8", "-"),
        ("mass", "f8", "kg"),
        ("mass_valid", "f8", "-"),
        ("cg", "f8", "-"),  # fraction of the mean chord
        ("cg_valid", "f8", "-"),
        ("cas", "f8", "m/s"),
        ("cas_valid", "f8", "-"),
        ("mach", "f8", "-"),
        ("mach_valid", "f8", "-"),
    ]
)
STATE = dtype(
    [
        ("r", "f8", "-"),  # largest of the three estimates over its threshold
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # SENSOR; OFC_LIQUID or AMBIGUOUS for the elevator (side unknown)
        ("culprit", "f8", "-"),  # index into CULPRITS
        ("valid", "f8", "-"),  # 1 while settled, inside the box and all inputs usable
        ("f_hat_elevator", "f8", "rad"),  # mean of the four segments, trailing edge down +
        ("f_hat_n_z", "f8", "g"),  # with the feedthrough correction
        ("f_hat_n_z_raw", "f8", "g"),  # as printed
        ("f_hat_alpha", "f8", "rad"),
        ("f_sigma", "f8", "rad"),  # one sigma of f_hat_elevator from the noise of q
        ("alpha_hat", "f8", "rad"),  # estimate of the unmeasured state
        ("free_elevator", "f8", "rad"),  # f_hat_elevator less what a gust of f_hat_alpha would do
        ("free_n_z", "f8", "g"),  # f_hat_n_z likewise
        ("e_norm", "f8", "deg, m, m/s, deg/s"),  # |e_y|, paper's units
        ("nu_norm", "f8", "-"),  # |nu| / K
        ("e", "f8", (P,)),  # e_y
        ("nu", "f8", (P,)),
        ("s", "f8", (P,)),  # outputs at the last tick
        ("phi", "f8", (P,)),
        ("y2", "f8", (2,)),  # n_z [g], alpha [deg] at the last tick
        ("z", "f8", (2,)),  # z_f
        ("w", "f8"),  # x_hat_1 + L x_hat_2
        ("f", "f8", (3,)),  # lagged W nu / E: deg, g, deg
        ("d", "f8", (N,)),  # what bank adds to x'
        ("k_e", "f8", "-"),  # elevator and n_z estimates per angle of gust [-], [g/rad]
        ("k_n", "f8", "g/rad"),
        ("slow", "f8", (3,)),  # slow means of f_hat_elevator, f_hat_n_z, f_hat_alpha
        ("learned", "f8", "-"),  # 1 when the offset holds
        ("n_learn", "f8", "-"),
        ("sums", "f8", (2,)),  # running means of the offset: deg, g
        ("offset", "f8", (2,)),
        ("away", "f8", "rad"),  # alpha_hat - alpha_eq through a lag of tau_f
        ("calm", "f8", "s"),  # time since it was beyond away_max
        ("gust", "f8", "rad"),  # rms of gusts
        ("rho", "f8", (R,)),  # t, %, kt, -
        ("line", "f8", (DELAY, M), "deg"),  # commands of the last ticks
        ("head", "f8", "-"),
        ("u_0", "f8", "deg"),  # healthy elevator at the start and the end of the tick that ends now
        ("u_e", "f8", "deg"),
        ("u_s", "f8", "deg"),  # stabiliser
        ("v_s", "f8", "m/s"),  # smoothed V
        ("age", "f8", "s"),  # time since the (re)start; 0: not started
        ("timer", "f8", (3,), "s"),  # confirmation
        ("on", "f8", (3,), "-"),  # declared: elevator, n_z, alpha
        ("sign", "f8"),  # of the last threshold crossing of f_hat_elevator
        ("half", "f8"),  # alternating crossings, each within a second of the one before
        ("since", "f8", "s"),  # time since the last of them
        ("A", "f8", (N, N)),  # scratch: A(rho), B(rho), trim maps, powers of rho, right side of the implicit step
        ("B", "f8", (N, M)),
        ("eq", "f8", (N + M,)),
        ("power", "f8", (R, 4)),
        ("b", "f8", (P,)),
    ]
)
OUTPUTS = (
    "r", "alarm", "verdict", "culprit", "valid", "f_hat_elevator", "f_hat_n_z", "f_hat_n_z_raw", "f_hat_alpha",
    "f_sigma", "alpha_hat", "free_elevator", "free_n_z", "e_norm", "nu_norm",
)
DETECTOR = Detector(
    id="lpv_smo",
    level="aircraft",
    summary="LPV sliding-mode observer: elevator, load-factor and angle-of-attack faults [Alwi14]",
    inputs={
        **dict.fromkeys(("de_lo", "de_li", "de_ri", "de_ro"), "de_cmd"),  # a measured surface would hide its fault
        **{"stab": "stab_cmd", "h": "h_inertial", "V": "tas"},
        **{w: w for w in ("theta", "q", "n_z", "alpha", "mass", "cg", "cas", "mach", "phi", "p", "r")},
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
            "*.velocity", "stabiliser", "engine", "sensor.q", "sensor.theta", "sensor.tas", "sensor.cas",
            "sensor.mach", "sensor.h_inertial", "sensor.mass", "sensor.cg",
        ), ("ambiguous",)),
    },
    blind="estimates elevator, load-factor and angle-of-attack faults from longitudinal motion: nothing "
    "lateral, nothing inside an actuator that the surface does not follow",
    estimates=(
        Estimate("elevator", "f_hat_elevator", "rad"), Estimate("n_z", "f_hat_n_z", "g"),
        Estimate("alpha", "f_hat_alpha", "rad"),
    ),
    looks_back={"delay": "line"},
    places={"head": ("line", 0)},
    fit=lambda site: fitted(site),
)  # fmt: skip


def params(which="flight", *, model=None, made=None, K=30.0, delta=1e-4, tau_f=0.2, tau_v=0.2, tau_rho=0.5,
           omega_a=0.0, delay=0, bank=True, inertia=(0.0, 0.0), sigma_q=0.02 * DEG,
           t_settle=2.0, t_learn=0.0):  # fmt: skip
    """Return PARAMS of an `LpvModel` and its `Design`, by default the stored ones of this aircraft.

    States, inputs and outputs must be those of [Alwi14] (33), (37): alpha, Z, theta, V, q; elevator, stabiliser;
    Z, theta, V, q, n_z, alpha, in deg, m, m/s, g. Fewer than four scheduling parameters leave the last ones unused.
    Raises ValueError for another shape.
    """
    if model is None:
        model, made = load()
    nr = len(model.A) - 1
    if made.A.shape[1:] != (N, N) or made.B.shape[1:] != (N, M) or made.W.shape != (3, P) or nr > R:
        raise ValueError(f"the block observes 5 states, 6 outputs, 2 inputs, 1 + 2 faults; got A {made.A.shape}")
    n, m = model.B.shape[1:]
    x_eq, u_eq, y_eq = np.split(np.asarray(model.trim, float), [n, n + m])
    eq = np.vstack([made.x_from @ np.vstack([x_eq, y_eq[-2:]]), u_eq])
    own = powers(nr)
    fields = {
        "A": _pad(made.A), "B": _pad(made.B), "E": _pad(made.E)[:, 0, 0], "D51": _pad(made.D2)[:, 0, made.actuator[0]],
        "mix": made.y_from, "L": made.L[0], "W": made.W, "a22": made.A22s, "a_f": made.A_f,
        "low": np.r_[model.box[:, 0], np.zeros(R - nr)], "high": np.r_[model.box[:, 1], np.ones(R - nr)],
        "eq": np.hstack([eq, np.zeros((N + M, T - len(own)))]),
        "to_x": made.x_from[:, :5], "inertia": inertia, "bank": float(bank),
        "powers": np.pad(own, ((0, T - len(own)), (0, R - nr))),
    }  # fmt: skip
    return record(
        PARAMS, K=K, delta=delta, tau_f=tau_f, tau_v=tau_v, tau_rho=tau_rho, omega_a=omega_a, delay=delay,
        sigma_q=sigma_q, t_settle=t_settle, t_learn=t_learn, **fields, **thresholds("lpv_smo", which),
    )  # fmt: skip


def _pad(stack):
    return np.concatenate([stack, np.zeros((R + 1 - len(stack), *stack.shape[1:]))])


def fitted(site):
    """Return PARAMS for a loop: commands as late as q is, through a lag as slow as its servos."""
    about = site.aircraft()
    xx, yy, zz, xz = about.model.gyration2
    inertia = ((zz - xx) / yy, xz / yy)
    return params(delay=site.ticks("q"), omega_a=1.0 / about.delays[0], inertia=inertia, t_learn=LEARN)


def init(p):
    """Return STATE of p's shape, not yet started: the observer starts at the first complete set of measurements."""
    return np.zeros(p.shape, STATE)


@kernel
def _scores(x, p):
    """Return how far each fault is beyond its threshold: elevator, n_z, alpha.

    Gusts move the three estimates along one line, so faults are judged by what is left across it, (a, b): an elevator
    fault leaves (f, 0), n_z (0, f), alpha (-k_e f, -k_n f). What no single fault explains counts for elevator and n_z.
    """
    away = math.fabs(x.away)
    more_a, more_b = p.s_elevator * away + p.g_elevator * x.gust, p.s_n_z * away + p.g_n_z * x.gust
    more_c = p.s_alpha * away + p.g_alpha * x.gust
    t_a, t_b = p.t_elevator + more_a, p.t_n_z + more_b
    a, b = x.free_elevator, x.free_n_z
    u, v = x.k_e / t_a, x.k_n / t_b
    f = -(a / t_a * u + b / t_b * v) / max(u * u + v * v, 1e-12)
    left_a, left_b = math.fabs(a + x.k_e * f) / t_a, math.fabs(b + x.k_n * f) / t_b
    size_a, size_b = math.fabs(a) / t_a, math.fabs(b) / t_b
    elevator = min(size_a, math.fabs(x.f_hat_elevator) / t_a)
    n_z = min(size_b, math.fabs(x.f_hat_n_z) / t_b)
    alpha = min(math.fabs(f), math.fabs(x.f_hat_alpha)) / (p.t_alpha + more_c)
    if max(left_a, left_b) >= 1.0 or max(size_a, size_b) < 1.0:
        alpha = 0.0
    elif elevator < 1.0 or size_b >= 1.0:  # alpha alone explains both
        elevator, n_z = min(elevator, 0.99), min(n_z, 0.99)
    if size_b < 1.0 and elevator >= 1.0 and alpha >= 1.0:  # either would do: the elevator moves one estimate only
        alpha = 0.99
    return (
        max(elevator, math.fabs(x.slow[0]) / (p.w_elevator + more_a)),
        max(n_z, math.fabs(x.slow[1]) / (p.w_n_z + more_b)),
        max(alpha, math.fabs(x.slow[2]) / (p.w_alpha + more_c)),
    )


@kernel
def _decide(x, p, dt):
    """Confirm each fault against its threshold; name the largest that is declared, another only when clearly larger."""
    c = 1.0 - math.exp(-dt / p.tau_slow)
    x.slow[0] += c * (x.f_hat_elevator - x.slow[0])
    x.slow[1] += c * (x.f_hat_n_z - x.slow[1])
    x.slow[2] += c * (x.f_hat_alpha - x.slow[2])
    # the rms grows by clipped steps, so that a fault's own step does not pass for weather
    swing = min(math.fabs(x.f_hat_alpha - x.slow[2]), 2.5 * x.gust + 0.15 * DEG)
    x.gust = math.sqrt(x.gust * x.gust + (1.0 - math.exp(-dt / p.tau_gust)) * (swing * swing - x.gust * x.gust))
    scores = _scores(x, p)
    named, largest = int(x.culprit) - 1, 0.0
    x.alarm, x.culprit, x.verdict = 0.0, 0.0, NONE
    x.r = max(scores[0], max(scores[1], scores[2]))
    x.since += dt
    for i in range(3):
        beyond = scores[i] >= 1.0
        if i == 0 and beyond and x.free_elevator * x.sign <= 0.0:
            x.half = x.half + 1.0 if x.since < 1.0 else 1.0
            x.sign, x.since = math.copysign(1.0, x.free_elevator), 0.0
        # an oscillation is beyond its threshold for less than the confirmation time at once: it counts half periods
        beyond = beyond or (i == 0 and x.half >= 3.0 and x.since < 1.0)
        x.timer[i], x.on[i] = confirm(x.timer[i], x.on[i], beyond, dt, p.t_confirm, p.t_release)
        if x.on[i] > 0.5:
            x.alarm = 1.0
            score = scores[i] * (CLEARLY if i == named else 1.0)
            if score > largest:
                largest, x.culprit = score, i + 1.0
    if x.culprit > 1.5:
        x.verdict = SENSOR
    elif x.culprit > 0.5:
        x.verdict = OFC_LIQUID if x.half >= 3.0 and x.since < 1.0 else AMBIGUOUS


@kernel
def step(x, u, p, dt):
    """Advance the observer, reconstruct the three faults, decide."""
    good = usable(u.h, u.h_valid) * usable(u.theta, u.theta_valid) * usable(u.V, u.V_valid) * usable(u.q, u.q_valid)
    if x.age == 0.0:  # the first tick needs all of them; later n_z and alpha may drop out
        good *= usable(u.n_z, u.n_z_valid) * usable(u.alpha, u.alpha_valid)
    if good < 0.5:  # without a fault-free output there is no e_y: keep the estimates, start again when it is back
        x.valid = 0.0
        x.age = 0.0
        return
    inside = inputs(x, u, p, dt)
    outputs(x, u, p, dt)
    bank(x, u, p)
    observe(x, p, dt)
    if x.age == 0.0:
        x.gust, x.away, x.calm = max(x.gust, p.gust_0), 0.0, 0.0
    x.age += dt
    x.away += (1.0 - math.exp(-dt / p.tau_f)) * (x.alpha_hat - x.eq[0] * DEG - x.away)
    reconstruct(x, u, p, dt)
    both = usable(u.n_z, u.n_z_valid) * usable(u.alpha, u.alpha_valid)
    x.calm = x.calm + dt if math.fabs(x.away) <= p.away_max else 0.0
    ready = x.age > p.t_settle and (x.learned > 0.5 or p.t_learn <= 0.0)
    x.valid = inside * both if ready and x.calm >= min(x.age, p.t_recover) - 0.5 * dt else 0.0
    if x.valid > 0.5:
        _decide(x, p, dt)
    else:
        x.r, x.alarm, x.verdict, x.culprit = 0.0, 0.0, NONE, 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
