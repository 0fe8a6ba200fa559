"""LPV sliding-mode observer: elevator, load-factor and angle-of-attack faults at once. Source: [Alwi14].

| symbol | here | units of the paper, inside only |
|---|---|---|
| x = [alpha, Z, theta, V, q, z_f] (39) | canonical state, unmeasured part first | deg, m, deg, m/s, deg/s, (g, deg) |
| y_m (9) | s = [Z, theta, V, q, z_f1, z_f2] | |
| rho (28), Table 4 | mass, CG, CAS, Mach | t, per cent, kt, - |
| e_y (14), nu (15), K, delta, P_o (16) | output error, injection and its constants | |
| L (21), W (22), A_f (7), A22s | gains of `fdi.lpv_smo.design` | |
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

- Several boxes, each with a model and gains of its own whose inequalities hold at its vertices; the state goes over
  from one to the next. `why` says what it is outside of.
- Wind and gusts. A steady wind is learned (`core.drift`); the states are those of the path over the air that drifts
  with it (over the ground in tables 2, 3), the forces those of the air. A gust of angle a turns the path by
  xi = A_11 a, which that angle shows (`core.gust`) and which no fault of n_z or of the vane moves; what a does to the
  three estimates is taken out of them, and likewise what the air's own speed does. The tail meets it later than the
  wing, which is what a rate of pitch of -a' would do. Thrust acts on pitch through the engines' arm: nu of the speed
  channel says how much.
- Each estimate is judged by itself, against a threshold that grows with the rms of a: a fault does not raise it. An
  oscillation of the elevator's estimate is found by a frequency bank, too, against one that grows with the amplitude of
  a at its frequency.

(2) leaves out the feedthrough of the elevator fault into n_z: `f_hat_n_z_raw` is the printed reconstruction,
`f_hat_n_z` subtracts D51 f_hat_e. All reconstructions pass one lag `tau_f` (0.2 s in the paper): an OFC of
0.5 / 1 / 2 / 5 Hz comes out at 0.85 / 0.62 / 0.37 / 0.16 of its amplitude, and a step needs 0.46 s for 90 %.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from actuators.constants import M_S_PER_KT, RAD_PER_DEG
from fdi.common import bank
from fdi.common.decision import confirm, usable
from fdi.common.record import LEARN_S, TICK, Detector, Estimate, Site
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID, SENSOR
from fdi.common.why import BOX_ALPHA, BOX_MACH, LOST_SENSOR, NOT_READY, VALID
from fdi.lpv_smo import gyro
from fdi.lpv_smo.core import (
    DELAY,
    NB,
    M,
    N,
    P,
    R,
    T,
    drift,
    gust,
    inputs,
    lateral,
    observe,
    outputs,
    reconstruct,
)
from fdi.lpv_smo.model import LpvModel, powers
from fdi.lpv_smo.synthesis import Design, load, load_boxes

GRADIENT = 0.6  # of the damping in pitch: what a gust that grows along the body does, by training flights
ISOLABLE_PARTS = ("", "elevator", "n_z", "alpha")
RELEASED_AT = 0.7  # of its threshold: above it a fault that is declared has not ended
TREND = 3.0  # lag of alpha_eq, which follows airspeed, where its change is judged: gusts change airspeed, too [s]
GUST_SHARE = 0.9  # of the largest rms of gusts: beyond it nothing is judged
LEFT = 0.2  # of the amplitude of gusts at a frequency may be left in the elevator's estimate
HELD = 0.6  # an oscillation is held to be there for so long after the last fit that found it [s]

PARAMS = dtype(
    [
        ("n_box", "f8", "-"),  # boxes in use; each has its own model and design
        ("A", "f8", (NB, R + 1, N, N)),  # A(rho) of (8), canonical coordinates, affine stack
        ("B", "f8", (NB, R + 1, N, M)),  # B(rho) of (8)
        ("eq", "f8", (NB, N + M, T)),  # trim maps of canonical state and inputs, cubic in normalised rho
        ("powers", "f8", (T, R)),  # exponents of their monomials
        ("low", "f8", (NB, R)),  # boxes of rho: t, %, kt, -
        ("high", "f8", (NB, R)),
        ("mix", "f8", (NB, P, P)),  # s = mix @ [Z theta V q z_f1 z_f2], the identity for the paper's outputs
        ("L", "f8", (NB, P)),  # (21)
        ("W", "f8", (NB, 3, P)),  # (22)
        ("a22", "f8", (NB, P), "rad/s"),  # diagonal of A22s, negative
        ("a_f", "f8", (NB, 2), "rad/s"),  # diagonal of A_f
        ("gust", "f8", "-"),  # 1: gusts are reconstructed from the angle of attack over the ground and taken out
        ("K", "f8", "-"),  # modulation gain of (15)
        ("delta", "f8"),  # smoothing of (15)
        ("tau_f", "f8", "s"),  # lag of the reconstruction
        ("tau_g", "f8", "s"),  # a second lag of what is free of gusts: the first leaves differentiated white noise
        ("tau_v", "f8", "s"),  # smoothing of V, 0 for none
        ("tau_rho", "f8", "s"),  # smoothing of rho, 0 for none
        ("omega_a", "f8", "rad/s"),  # healthy elevator as a lag of its command, 0 for none
        ("rate_a", "f8", "deg/s"),  # at most so fast is the command followed, 0 for no limit
        ("delay", "f8", "-"),  # of the commands, as long as that of q
        ("gradient", "f8", "-"),  # share of the damping in pitch that answers to a gust's rate along the body
        ("thrust", "f8", "deg/s2 per m/s2"),  # what thrust does to pitch, over what it does to speed
        ("inertia", "f8", (2,)),  # (Izz - Ixx) / Iyy, Ixz / Iyy
        ("to_x", "f8", (NB, N, 5)),  # state of the paper to canonical state
        ("limit", "f8", (3,), "rad, g, rad"),  # of elevator, n_z and alpha in still air at trim
        # growth with the distance of trim, and of the angle of attack from trim, from where offsets were learned: what
        # the coefficients and the affine model have wrong
        ("limit_away", "f8", (3,), "-, g/rad, -"),
        ("limit_gust", "f8", (3,), "-, g/rad, -"),  # and with the rms of gusts
        ("away_max", "f8", "rad"),  # beyond this |alpha - alpha_eq| the affine model is not believed
        ("alpha_max", "f8", "rad"),  # nor beyond this angle of attack, flown or of trim, where lift is no longer linear
        ("mach_max", "f8", "-"),  # nor beyond this Mach number, where coefficients turn faster than a box follows
        ("t_recover", "f8", "s"),  # nor for so long after it was
        ("gust_0", "f8", "rad"),  # rms of gusts assumed at the start
        ("tau_gust", "f8", "s"),  # memory of that rms
        ("gust_max", "f8", "rad"),  # it is counted up to here; near it nothing is said: the model is wrong, not the air
        ("t_confirm", "f8", "s"),
        ("t_release", "f8", "s"),
        ("t_learn", "f8", "s"),  # offsets are learned up to this time, 0 for none
        *bank.PARAMS,
        ("swing_limit", "f8", "rad"),  # amplitude of an oscillation of the elevator's estimate
        ("swing_away", "f8", "-"),
        ("swing_gust", "f8", "-"),
        ("coherence", "f8", "-"),  # least agreement of its two periods
        ("purity", "f8", "-"),  # least share of the window's power that it explains
        ("hits", "f8", "-"),  # fits in a row that must pass
        ("t_settle", "f8", "s"),  # no decision for so long after a (re)start
    ]
)
_COMMANDS = ("de_lo", "de_li", "de_ri", "de_ro", "stab")  # trailing edge down + [rad]
_MEASURED = {  # field -> unit; it comes with a field <name>_valid
    "h": "m", "theta": "rad", "V": "m/s", "q": "rad/s", "n_z": "g", "alpha": "rad",  # inertial h, V over the ground
    "alpha_ground": "rad",  # read where `gust` is 1, as are the next: without tas the air's own speed counts as steady
    "tas": "m/s", "beta": "rad", "phi": "rad", "p": "rad/s", "r": "rad/s", "mass": "kg", "cg": "-", "cas": "m/s",
    "mach": "-",  # cg as a fraction of the mean chord
}  # fmt: skip
INPUTS = dtype(
    [(name, "f8", "rad") for name in _COMMANDS]
    + [(name + flag, "f8", "-" if flag else unit) for name, unit in _MEASURED.items() for flag in ("", "_valid")]
)
STATE = dtype(
    [
        ("r", "f8", "-"),  # largest of the three estimates over its threshold
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # of the isolated_part: SENSOR; OFC_LIQUID or AMBIGUOUS for the elevator (side unknown)
        ("isolated_part", "f8", "-"),  # index into ISOLABLE_PARTS: of what is declared, what has been so longest
        ("alarm_elevator", "f8", "-"),  # 1 while this part is declared, whatever else is
        ("alarm_n_z", "f8", "-"),
        ("alarm_alpha", "f8", "-"),
        ("valid", "f8", "-"),  # 1 while settled, inside a box and all inputs usable
        ("why", "f8", "-"),  # code of fdi.common.why, 0 while valid
        ("box", "f8", "-"),  # which of the boxes
        ("f_hat_elevator", "f8", "rad"),  # mean of the four segments, trailing edge down +
        ("f_hat_n_z", "f8", "g"),  # with the feedthrough correction
        ("f_hat_n_z_raw", "f8", "g"),  # as printed
        ("f_hat_alpha", "f8", "rad"),
        ("f_sigma", "f8", "rad"),  # one sigma of the paper's f_hat_elevator from noise of q
        ("alpha_hat", "f8", "rad"),  # estimate of the unmeasured state
        ("gust_hat", "f8", "rad"),  # angle of the gust that was taken out
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
        ("free", "f8", (3,)),  # the same without gusts, through the lag tau_g
        ("d", "f8", (N,)),  # what bank adds to x'
        ("ground", "f8", "deg"),  # model of alpha_ground, its rate without the gust, what of it is missing
        ("rate", "f8", "deg/s"),
        ("xi", "f8", "deg/s"),
        ("push", "f8", "m/s2"),  # acceleration along the path that the model does not know of, through the lag
        ("wind", "f8", "m/s"),  # airspeed less that over the drifting air, through the lag
        ("slip", "f8", "deg"),  # alpha_hat less alpha_ground, through the lag
        ("ahead", "f8", "m/s"),  # steady wind against the heading, from left to right of it, their variances
        ("across", "f8", "m/s"),
        ("pull", "f8", "m/s2"),  # of speed, that the estimate of x.ahead makes and no force
        ("ahead_var", "f8", "m2/s2"),
        ("across_var", "f8", "m2/s2"),
        ("speed", "f8", "m/s"),  # over the air that drifts with that wind, and the angle of attack over it
        ("over", "f8", "rad"),
        ("lean", "f8", "m/s"),  # what the air's lateral velocity makes of slip, and a unit of that wind, lagged
        ("tilt", "f8", "-"),
        ("blown", "f8", "m/s"),  # what gusts from the side have added to the wind across
        ("lateral", "f8", "m/s"),  # the air's lateral velocity at the last tick, and 1 if the vane told it
        ("vane", "f8", "-"),
        ("side", "f8", "rad"),  # sideslip over the ground
        ("spin", "f8", "rad/s"),  # rate about the path, through the lag
        ("doubt", "f8", "rad"),  # what the wind's deviation may be worth as an angle of a gust
        ("learned", "f8", "-"),  # 1 when the offset holds
        ("n_learn", "f8", "-"),
        ("offset", "f8", (3,), "deg, g, deg"),  # of the estimates, their mean while it is learned
        ("path", "f8", "rad"),  # alpha_hat through a lag of tau_f
        ("alpha_0", "f8", "rad"),  # its mean while offsets were learned, which hold there
        ("trim", "f8", "rad"),  # alpha_eq through a lag, and its mean while offsets were learned
        ("trim_0", "f8", "rad"),
        ("away", "f8", "rad"),  # path less alpha_eq
        ("apart", "f8", "rad"),  # how far the flight is from where offsets were learned, or from trim
        ("calm", "f8", "s"),  # time since it was beyond away_max
        ("gust", "f8", "rad2"),  # mean square of gusts
        ("rms", "f8", "rad"),  # its root, with the doubt about the wind: what limits grow with
        ("rho", "f8", (R,)),  # t, %, kt, -
        ("line", "f8", (DELAY, M), "deg"),  # commands of the last ticks
        ("head", "f8", "-"),
        ("u_0", "f8", "deg"),  # healthy elevator at the start and the end of the tick that ends now
        ("u_e", "f8", "deg"),
        ("u_r", "f8", "deg"),  # the command as far as the rate limit lets it be followed
        ("u_s", "f8", "deg"),  # stabiliser
        ("v_s", "f8", "m/s"),  # smoothed V
        ("age", "f8", "s"),  # time since the (re)start; 0: not started
        ("timer", "f8", (3,), "s"),  # confirmation: elevator, n_z, alpha
        ("held", "f8", (3,), "s"),  # for how long each has been declared
        *gyro.STATE,
        *bank.state(2),
        ("hit", "f8", (bank.K,), "-"),  # fits in a row that passed
        ("swing", "f8", "s"),  # time for which an oscillation is still held to be there
        ("A", "f8", (N, N)),  # scratch: A(rho), B(rho), trim maps, powers of rho, right side of the implicit step
        ("B", "f8", (N, M)),
        ("eq", "f8", (N + M,)),
        ("power", "f8", (R, 4)),
        ("b", "f8", (P,)),
    ]
)
OUTPUTS = (
    "r", "alarm", "verdict", "isolated_part", "alarm_elevator", "alarm_n_z", "alarm_alpha", "valid", "why", "box",
    "f_hat_elevator", "f_hat_n_z", "f_hat_n_z_raw", "f_hat_alpha", "f_sigma", "alpha_hat", "gust_hat", "e_norm",
    "nu_norm",
)  # fmt: skip
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
    sizes={"n_box": 1.0, **bank.SIZES},
    places={"head": ("line", 0), **bank.PLACES},
    design="lpv_smo_boxes",
    range={  # around all boxes, with the margin of `core`; which box holds a point is decided there
        "mass": (176e3, 428e3), "cg": (0.184, 0.436), "cas": (104.4 * M_S_PER_KT, 408.0 * M_S_PER_KT),
        "mach": (0.12, 0.9),
    },
    fit=lambda site: fitted(site),
)  # fmt: skip


def params(
    which: str = "flight", *, model: LpvModel | None = None, made: Design | None = None,
    designs: list[tuple[LpvModel, Design]] | None = None, dt: float = TICK, own: Any = None, **values: Any,
) -> np.ndarray:  # fmt: skip
    """Return PARAMS of an `LpvModel` and its `Design`, by default the paper's box, stored for this aircraft.

    `designs` gives several boxes instead: the one that holds rho is used. States, inputs and outputs must be those of
    [Alwi14] (33), (37): alpha, Z, theta, V, q; elevator, stabiliser; Z, theta, V, q, n_z, alpha, in deg, m, m/s, g.
    Fewer than four scheduling parameters leave the last ones unused. `values` are other fields. Raises ValueError for
    another shape, too many boxes, or an unknown field.
    """
    designs = designs or [(model, made) if model and made else load()]
    if len(designs) > NB:
        raise ValueError(f"{len(designs)} boxes; at most {NB} fit")
    usual = {"K": 30.0, "delta": 1e-4, "tau_f": 0.2, "tau_g": 0.1, "tau_v": 0.2, "tau_rho": 0.5, "t_settle": 2.0,
             "mach_max": 1.0, "n_box": len(designs)}  # fmt: skip
    p = record(PARAMS, **usual | bank.design(dt) | thresholds("lpv_smo", which, own) | values)
    for k, (one, its) in enumerate(designs):
        for name, value in _box(one, its).items():
            p[name][0, k] = value
    exponents = powers(len(designs[0][0].box))
    p["powers"][0, : len(exponents), : exponents.shape[1]] = exponents
    return p


def _box(model, made):
    """Return the fields of one box."""
    nr = len(model.A) - 1
    if made.A.shape[1:] != (N, N) or made.B.shape[1:] != (N, M) or made.W.shape != (3, P) or nr > R:
        raise ValueError(f"the block observes 5 states, 6 outputs, 2 inputs, 1 + 2 faults; got A {made.A.shape}")
    x_eq, u_eq, y_eq = np.split(model.trim, np.cumsum(model.B.shape[1:]))
    unused = ((0, R - nr), (0, 0), (0, 0))  # scheduling parameters
    eq = np.vstack([made.x_from @ np.vstack([x_eq, y_eq[-2:]]), u_eq])
    return {
        "A": np.pad(made.A, unused), "B": np.pad(made.B, unused), "mix": made.y_from, "L": made.L[0], "W": made.W,
        "a22": made.A22s, "a_f": made.A_f, "low": np.r_[model.box[:, 0], np.zeros(R - nr)],
        "high": np.r_[model.box[:, 1], np.ones(R - nr)],
        "eq": np.hstack([eq, np.zeros((N + M, T - eq.shape[1]))]), "to_x": made.x_from[:, :5],
    }  # fmt: skip


def fitted(site: Site, paper: bool = False) -> np.ndarray:
    """Return PARAMS for a loop: commands as late as q is, through a lag as slow as its servos; all boxes, none of them
    believed beyond the Mach number of the fastest, gusts taken out. With `paper` the paper's own box and observer.
    """
    about = site.aircraft()
    model = about.model
    xx, yy, zz, xz = model.gyration2
    (tx, _, tz), (rx, _, rz) = model.thrust_axis, np.mean(model.engine, axis=0)
    common = {"t_learn": LEARN_S, "delay": site.ticks("q"), "omega_a": 1.0 / about.delays[0],
              "inertia": ((zz - xx) / yy, xz / yy)}  # fmt: skip
    if paper:
        return params(dt=site.dt, own=site.own, **common)
    designs = load_boxes(site.own)
    return params(
        designs=designs, dt=site.dt, own=site.own, gust=1.0, rate_a=about.rates[0] / RAD_PER_DEG, gradient=GRADIENT,
        thrust=(rz * tx - rx * tz) / tx / yy / RAD_PER_DEG, mach_max=max(m.box[R - 1, 1] for m, _ in designs), **common,
    )  # fmt: skip


init = zero_state(STATE)  # not yet started: the observer starts at the first complete set of measurements


@kernel
def _oscillates(x, p, dt):
    """Return whether the elevator's estimate oscillates and keeps its phase over two periods, as the last fits of HELD
    have it. What is left of a gust oscillates as it does: the limit grows with its amplitude at each frequency."""
    bank.push(x, p, (x.f_hat_elevator, x.gust_hat))
    x.swing = max(x.swing - dt, 0.0)
    for k in range(bank.K):
        if x.bank_new[k] < 0.5:
            continue
        limit = p.swing_limit + p.swing_away * x.apart + p.swing_gust * x.rms
        limit += LEFT * bank.amplitude(x, k, 1)
        fits = bank.amplitude(x, k, 0) >= limit and bank.shaped(x, p, k, 0, 0.0)
        x.hit[k] = x.hit[k] + 1.0 if fits else 0.0
        if x.hit[k] >= p.hits:
            x.swing = HELD
    return x.swing > 0.0


@kernel
def _decide(x, p, dt):
    """Declare each fault by its own estimate; of those declared the summary names the one that has been so longest."""
    oscillates = _oscillates(x, p, dt)
    estimates = (x.f_hat_elevator, x.f_hat_n_z, x.f_hat_alpha)
    known = 1.0 if x.gyro_off <= 0.0 else 0.0  # which of them it is: all three estimates take q for true
    x.r, x.alarm, x.isolated_part, longest = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        score = math.fabs(estimates[i]) / (p.limit[i] + p.limit_away[i] * x.apart + p.limit_gust[i] * x.rms)
        # an oscillation is beyond its threshold for less than the confirmation time at once
        beyond = score >= (RELEASED_AT if x.held[i] > 0.0 else 1.0) or (i == 0 and oscillates)
        x.timer[i], on = confirm(x.timer[i], 1.0 if x.held[i] > 0.0 else 0.0, beyond, dt, p.t_confirm, p.t_release)
        x.held[i] = x.held[i] + dt if on > 0.5 else 0.0
        x.r, x.alarm = max(x.r, score), max(x.alarm, on)
        if x.held[i] > longest:
            longest, x.isolated_part = x.held[i], known * (i + 1.0)
    x.alarm_elevator = known if x.held[0] > 0.0 else 0.0
    x.alarm_n_z = known if x.held[1] > 0.0 else 0.0
    x.alarm_alpha = known if x.held[2] > 0.0 else 0.0
    of_elevator = OFC_LIQUID if oscillates and known > 0.5 else AMBIGUOUS
    x.verdict = NONE if x.alarm < 0.5 else SENSOR if x.isolated_part > 1.5 else of_elevator


@kernel
def _withhold(x, why):
    """Judge nothing, for the reason `why`."""
    x.valid, x.why = 0.0, why
    x.r, x.alarm, x.verdict, x.isolated_part, x.swing = 0.0, 0.0, NONE, 0.0, 0.0
    x.alarm_elevator, x.alarm_n_z, x.alarm_alpha = 0.0, 0.0, 0.0
    x.held[:] = x.timer[:] = x.bank_seen[:] = x.hit[:] = 0.0


@kernel
def _from_trim(x, p, dt):
    """Lag the angle of attack and that of trim, which follows airspeed."""
    trim = x.eq[0] * RAD_PER_DEG
    if x.age == 0.0:
        x.gust, x.path, x.calm, x.trim = max(x.gust, p.gust_0 * p.gust_0), x.alpha_hat, 0.0, trim
    x.age += dt
    x.path += (1.0 - math.exp(-dt / p.tau_f)) * (x.alpha_hat - x.path)
    x.away = x.path - trim
    x.trim += (1.0 - math.exp(-dt / TREND)) * (trim - x.trim)


@kernel
def _weigh(x, p, dt):
    """Advance what limits grow with (the distance from where offsets were learned, the rms of gusts), and the time for
    which the model has held."""
    # in a dive the angle of attack may be that of slower level flight: it does not tell how far the model is off
    since = math.fabs(x.trim - x.trim_0) + math.fabs(x.path - x.trim - (x.alpha_0 - x.trim_0))
    x.apart = since if x.learned > 0.5 else math.fabs(x.away)
    if x.age > p.t_settle:  # also while nothing is judged: what comes after is judged by it
        # gust_hat is not one of the three estimates, so that no fault of a sensor passes for weather
        more = min(math.fabs(x.gust_hat), p.gust_max)
        x.gust += (1.0 - math.exp(-dt / p.tau_gust)) * (more * more - x.gust)
    x.rms = math.sqrt(x.gust + x.doubt * x.doubt)
    # without the vane, whose fault is no stall; beyond a stall alpha_hat is wrong, but not the angle over the ground
    flown = max(x.path, x.path - x.slip * RAD_PER_DEG)
    # where lift has bent, gust_hat is what is missing of it: level flight in the gusts that blow must not get there
    most = max(flown + max(x.gust_hat, 0.0), x.eq[0] * RAD_PER_DEG + math.sqrt(x.gust))
    blown = math.fabs(x.gust_hat) > p.gust_max or x.gust > GUST_SHARE * GUST_SHARE * p.gust_max * p.gust_max
    x.calm = x.calm + dt if math.fabs(x.away) <= p.away_max and most <= p.alpha_max and not blown else 0.0


@kernel
def _reason(x, u, p, dt, why):
    """Return VALID where the estimates may be judged, else why not; `why` is that of the box."""
    if why != VALID:
        return why
    if usable(u.n_z, u.n_z_valid) * usable(u.alpha, u.alpha_valid) < 0.5:
        return LOST_SENSOR
    if x.age <= p.t_settle:
        return NOT_READY
    if x.rho[R - 1] > p.mach_max:
        return BOX_MACH
    if x.learned < 0.5 and p.t_learn > 0.0:
        return NOT_READY
    return VALID if x.calm >= min(x.age, p.t_recover) - 0.5 * dt else BOX_ALPHA


@kernel
def step(x, u, p, dt):
    """Advance the observer, reconstruct the three faults, decide."""
    good = usable(u.h, u.h_valid) * usable(u.theta, u.theta_valid) * usable(u.V, u.V_valid) * usable(u.q, u.q_valid)
    if p.gust > 0.5:
        good *= usable(u.alpha_ground, u.alpha_ground_valid)
    gyro.compare(x, u, dt)
    if x.age == 0.0:  # the first tick needs all of them; later n_z and alpha may drop out
        good *= usable(u.n_z, u.n_z_valid) * usable(u.alpha, u.alpha_valid)
    why = inputs(x, u, p, dt) if good > 0.5 else LOST_SENSOR
    # without a fault-free output there is no e_y; what is learned at the start is learned within a box
    if good < 0.5 or (why != VALID and p.t_learn > 0.0 and x.learned < 0.5):
        x.age = 0.0
        _withhold(x, why)
        return
    x.speed = x.v_s
    if p.gust > 0.5:
        drift(x, u, p, dt)
    outputs(x, u, p, dt)
    lateral(x, u, p)
    observe(x, p, dt)
    if p.gust > 0.5:
        gust(x, u, p, dt)
    _from_trim(x, p, dt)
    reconstruct(x, u, p, dt)
    _weigh(x, p, dt)
    why = _reason(x, u, p, dt, why)
    if why == VALID:
        x.valid, x.why = 1.0, VALID
        _decide(x, p, dt)
    else:
        _withhold(x, why)


rollout = entry(step, STATE, INPUTS, PARAMS)
