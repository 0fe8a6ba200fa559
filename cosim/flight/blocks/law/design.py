"""Gains of the control law from the linear model of the flight point, and its angle-of-attack limit."""

import math
from typing import Any

import numpy as np

from actuators.block import record
from actuators.constants import G0
from actuators.deterministic_linalg import rounded
from cosim.errors import TrimError
from cosim.flight.blocks.law import PARAMS
from cosim.flight.blocks.law.lateral import bank_limit
from cosim.scenario.aircraft import Aircraft

# actuator, sensor delay and hold in the design: first-order [s]; tests/helpers/law_margins.py has the real ones
LAG_S = 0.07
# one standard step of each by Bryson's rule: g s of held error, deg/s of pitch rate, deg of elevator
WEIGHTS = (0.22, 1.4, 2.5)
# share of the demand in the proportional term: the step's overshoot falls from 7..21 % to 2..11 % at the six points
SETPOINT = 0.7


def pitch_gains(A: np.ndarray, B: np.ndarray, nz_alpha: Any, nz_de: Any) -> tuple[Any, ...]:
    """Design (k_q, k_nz, k_i) by LQ on short period, actuator lag and an integrator on load factor.

    A (2, 2), B (2,) belong to (alpha [rad], q [rad/s]) and all elevators together [rad]; nz_alpha, nz_de [g/rad].
    Design state (alpha, q, delta, xi); alpha becomes n/nz_alpha, the feedback of delta is dropped
    (tests/helpers/law_margins.py shows what is left).
    """
    from scipy.linalg import solve_continuous_are  # a tenth of a second that a start need not wait for

    Az = np.zeros((4, 4))
    Az[:2, :2], Az[:2, 2], Az[2, 2] = A, B, -1.0 / LAG_S
    Az[3, 0], Az[3, 2] = nz_alpha, nz_de
    Bz = np.array([[0.0], [0.0], [1.0 / LAG_S], [0.0]])
    g_s, deg_s, deg = WEIGHTS
    weight = np.diag([0.0, 1 / math.radians(deg_s) ** 2, 0.0, 1 / g_s**2])
    K = solve_continuous_are(Az, Bz, weight, np.array([[1 / math.radians(deg) ** 2]]))
    K = (math.radians(deg) ** 2 * Bz.T @ K).ravel()
    return -K[1], -K[0] / nz_alpha, -K[3]


def alpha_limit(plant: Any, trim: Any, share: float = 0.96) -> tuple[float, float]:
    """Return (alpha [rad], n_z there [g]) where lift is `share` of the largest at this Mach and dynamic pressure.

    4 % of lift are 2 % of speed in hand to the stall, as in the angle-of-attack protection of a fly-by-wire transport.
    `plant` is moved about.
    """
    angles = np.radians(np.arange(0.0, 25.01, 0.5))
    lift, n_z = [], []
    for alpha in angles:
        plant.place(tas=trim.tas, alpha=alpha, theta=alpha, altitude=trim.altitude, q=trim.q, surfaces=trim.surfaces)
        t = plant.truth()[0]
        lift.append(t.nz * math.cos(alpha) - t.nx * math.sin(alpha))
        n_z.append(t.nz)
    top = int(np.argmax(lift))
    limit = np.interp(share * lift[top], lift[: top + 1], angles[: top + 1])
    return float(limit), float(np.interp(limit, angles, n_z))


def design(model: Any, stall: Any, aircraft: Aircraft, start: Any = None) -> np.ndarray:
    """Return PARAMS at the flight point of `model` (a linearize.LinearModel); `stall` is what `alpha_limit` gives.

    Gains are those of level flight at this speed and altitude, `start` is the Trim that the flight begins in: a climb,
    a turn; None: level.
    """
    t = start or model.trim
    alpha_max, n_stall = stall
    stops = aircraft.travels
    elevator, rudder, stabiliser = stops["elevator"], stops["rudder"], stops["stabiliser"]
    limits = {
        "alpha_max": alpha_max, "n_stall": n_stall,
        # [CS-25] 25.337: manoeuvring load factors of a large aeroplane, slats in
        "n_max": 2.5, "n_min": -1.0,
        # what the fly-by-wire transports in service publish: 30 deg up, 15 deg down
        "theta_max": math.radians(30.0), "theta_min": math.radians(-15.0),
        "stab_min": stabiliser[0], "stab_max": stabiliser[1],
        "de_min": elevator[0], "de_max": elevator[1], "da_max": stops["aileron"][1], "dr_max": rudder[1],
    }  # fmt: skip
    trim = {
        "nz_0": t.nz * math.cos(t.phi), "alpha_0": t.alpha, "theta_0": t.theta, "h_0": t.altitude, "tas_0": t.tas,
        "cas_0": model.y0[list(model.outputs).index("cas")], "stab_0": t.stabilizer, "throttle_0": t.throttle,
        "de_0": t.elevator, "phi_0": t.phi, "hdot_0": t.climb, "da_0": t.aileron, "dr_0": t.rudder,
    }  # fmt: skip
    T_V = model.block(("tas",), model.named("throttle_"))[1].sum()  # [m/s2] per throttle
    speed = {"k_v": 0.2 / T_V, "k_vi": 0.2 * 0.07 / T_V}
    gains = {**_pitch(model), **_lateral(model, stops["aileron"][1]), **speed}
    p = record(PARAMS, **limits, **trim, **{name: rounded(k, 7) for name, k in gains.items()})
    if start is not None:
        _holds(p[0], start)
    return p


def _holds(p, trim):
    most, remedy = math.degrees(bank_limit(p, trim.tas, 1.0)), "Bank less, or fly faster"
    if abs(math.degrees(trim.phi)) > most:
        said = f"bank: {math.degrees(trim.phi):.1f} deg, beyond what the control law holds here"
        raise TrimError(said, place="flight", allowed=f"{-most:.0f} to {most:.0f} deg", remedy=remedy)
    if not p.theta_min < trim.theta < p.theta_max:
        said = f"attitude: {math.degrees(trim.theta):.1f} deg, beyond the control law's protection"
        low, high = math.degrees(p.theta_min), math.degrees(p.theta_max)
        raise TrimError(said, place="flight", allowed=f"{low:.0f} to {high:.0f} deg", remedy="Climb or descend less")


def _pitch(model):
    A, B, C, D = model.block(("alpha", "q"), model.named("de_"), ("nz",))
    n_alpha, n_de = C[0, 0], D.sum()
    k_q, k_nz, k_i = pitch_gains(A, B.sum(1), n_alpha, n_de)
    per_elevator = C[0] @ -np.linalg.solve(A, B.sum(1)) + n_de  # steady load factor [g/rad]
    return {
        "k_q": k_q, "k_nz": k_nz, "k_i": k_i, "b_n": SETPOINT, "k_direct": -1.0 / per_elevator, "n_alpha": n_alpha,
        # e_alpha is the load factor of the missing angle, led by the rate that the load-factor loop lags behind
        "k_alpha": n_alpha, "k_rate": 0.6 * n_alpha,
        "k_theta": 0.5, "lead": 0.8,
        "k_path": 0.35, "w_h": 0.22, "zeta_h": 0.9, "n_hold": 0.25,
        "k_trim": 0.05, "trim_rate": math.radians(0.25), "trim_dead": math.radians(0.15),
    }  # fmt: skip


def _lateral(model, most_aileron):
    """Return gains: feed-forward by inversion of the roll and yaw equations without sideslip, feedback axis by axis.

    Along the reference (phi, p, p') the yaw rate is r = tan(alpha) p + turn with turn' = g/V p, and
    M (da, dr) = (p', r') - F (p, r) with M, F the surfaces' and rates' derivatives.
    """
    A, B, _, _ = model.block(("p", "r"), ("da_l", "da_r", "dr"))
    M = np.column_stack([B[:, 0] + B[:, 1], B[:, 2]])
    steep, per_g = math.tan(model.trim.alpha), G0 / model.trim.tas
    demands = np.array([[1.0, 0.0, 0.0], [steep, per_g, 0.0]])  # (p', r') per (p', p, turn)
    rates = np.array([[0.0, 1.0, 0.0], [0.0, steep, 1.0]])  # (p, r)
    (da_a, da_p, da_t), (dr_a, dr_p, dr_t) = np.linalg.solve(M, demands - A @ rates)
    L_p, L_da, N_r, N_dr = A[0, 0], M[0, 0], A[1, 1], M[1, 1]
    dutch = next(m for m in model.modes if m.name == "dutch_roll")
    roll = max(1.3, 1.2 * -L_p)  # closed roll mode [rad/s]
    w_phi = roll / 4.0  # bank and roll mode critically damped
    L_beta, N_beta = model.block(("beta",), None, ("pdot", "rdot"))[2][:, 0]
    k_beta = N_beta / -N_dr  # the rudder doubles the fin's stiffness ...
    k_r = max(1.2 * math.sqrt(2.0) * dutch.wn + N_r, 0.0) / -N_dr  # ... and damps that with a ratio of 0.6
    return {
        "w_phi": w_phi, "w_p": roll, "p_max": min(math.radians(5.0), 0.8 * most_aileron * L_da / -L_p),
        "k_p": max(roll + L_p, 0.0) / L_da, "k_phi": roll * w_phi / L_da, "k_phii": 0.15 * roll * w_phi / L_da,
        "da_a": da_a, "da_p": da_p, "da_t": da_t, "dr_a": dr_a, "dr_p": dr_p, "dr_t": dr_t,
        "k_r": k_r, "tau_r": 8.0, "k_beta": k_beta, "k_betai": 0.3 * k_beta,
        "k_cross": L_da / L_beta, "beta_max": math.radians(4.0),
        "w_psi": 0.12, "phi_hold": math.radians(25.0), "psi_0": 0.0,
    }  # fmt: skip
