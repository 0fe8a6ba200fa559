"""Flight-control law on measurements: load-factor demand with protections, automatic trim, bank demand, and the holds.

Pitch (normal law, C* in form: load factor by an integrator, pitch rate about that of the demanded turn of the flight path):

    e       = min(n_c - n_m, e_alpha)                              n: load-factor increment over level flight at this bank [g]
    delta_e = s [ -k_nz e - k_i int(e) dt + k_q (q - q_level - g n_c / V) ]         s = (V_0 / V)^2, trailing edge down +
    e_alpha = k_alpha (alpha_max - alpha) - k_rate alpha',    alpha' = q - g (n_z - cos(theta) cos(phi)) / V

so the angle-of-attack protection takes over where it demands less than the pilot, on the same integrator. n_c is the pilot's demand or,
with the stick free, what holds the flight path (vertical speed) or the altitude; it is limited to the load factors of the structure and
by the pitch-attitude protection, n_c <= V/g k_theta (theta_max - theta), likewise below. Automatic trim moves the stabiliser slowly until the
elevator is free. Lateral: roll rate demanded from the bank error, feed-forward for the roll damping, yaw rate about that of the turn.

Gains follow from the linear model of the flight point (`design`); s carries them to another speed. A signal whose flag falls is held for
0.2 s; then its feedback fades out in 0.5 s and what depends on it degrades: without n_z the pilot moves the elevator through k_direct, without
q its damping comes from theta, without alpha its protection is off, without h or its rate the path is not held, without attitude the wings are
damped only. No command is ever NaN.
"""

import math

import numpy as np
from scipy.linalg import solve_continuous_are

from actuators.block import dtype, kernel, record

SENSORS = ("alpha", "q", "theta", "phi", "p", "r", "psi", "n_z", "cas", "tas", "h_inertial", "hdot")
ALPHA, Q, THETA, PHI, P, R, PSI, NZ, CAS, TAS, H, HDOT = range(12)
HOLD_S = 0.2  # a lost signal is held that long [s] (DESIGN section 2)
FADE_S = 0.5  # and its feedback then fades out in that time [s]
G0 = 9.80665

PARAMS = dtype([
    ("k_nz", "f8"), ("k_i", "f8"), ("k_q", "f8"),         # [rad/g], [rad/g/s], [s]
    ("k_direct", "f8"),                                   # elevator per demanded g when n_z is lost [rad/g]
    ("k_alpha", "f8"), ("k_rate", "f8"), ("alpha_max", "f8"),  # [g/rad], [g s/rad], [rad]
    ("k_theta", "f8"), ("theta_max", "f8"), ("theta_min", "f8"),  # [1/s], [rad]
    ("n_max", "f8"), ("n_min", "f8"),                     # load-factor limits [g]
    ("k_path", "f8"),                                     # vertical-speed hold [1/s]
    ("w_h", "f8"), ("zeta_h", "f8"),                      # altitude hold [rad/s], [-]
    ("n_hold", "f8"),                                     # most that the holds demand [g]
    ("k_trim", "f8"), ("trim_rate", "f8"), ("trim_dead", "f8"),  # stabiliser per elevator [1/s], limit [rad/s], left alone [rad]
    ("stab_min", "f8"), ("stab_max", "f8"),               # [rad]
    ("w_phi", "f8"), ("p_max", "f8"),                     # bank loop [1/s], demanded roll rate [rad/s]
    ("k_p", "f8"), ("k_pff", "f8"),                       # aileron per roll-rate error and demand [s]
    ("k_r", "f8"), ("tau_r", "f8"),                       # rudder per yaw rate [s], wash-out [s]
    ("k_psi", "f8"), ("phi_hold", "f8"),                  # heading hold: bank per heading error [-], limit [rad]
    ("k_v", "f8"), ("k_vi", "f8"),                        # throttle per speed error [s/m], integral [1/m]
    ("nz_0", "f8"), ("cas_0", "f8"), ("alpha_0", "f8"), ("theta_0", "f8"),  # level flight at the trim point [g, m/s, rad]
    ("h_0", "f8"), ("psi_0", "f8"), ("tas_0", "f8"),      # [m, rad, m/s]
    ("stab_0", "f8"), ("throttle_0", "f8"), ("de_0", "f8"),  # trim [rad, -, rad]
    ("de_max", "f8"), ("de_min", "f8"), ("da_max", "f8"), ("dr_max", "f8"),  # [rad]
])
INPUTS = dtype([
    ("y", "f8", (12,)),      # measurements in the order of SENSORS [SI]
    ("valid", "f8", (12,)),  # their flags
    ("nz_dem", "f8"),        # demanded load-factor increment [g]
    ("phi_dem", "f8"),       # demanded bank [rad]
    ("psi_dem", "f8"),       # demanded change of heading [rad]
    ("de_add", "f8"),        # added to the elevator command [rad]
    ("hold_psi", "f8"),      # 1: the heading hold steers
    ("hold_h", "f8"),        # 1: the altitude hold steers while the stick is free
    ("hold_v", "f8"),        # 1: the speed hold moves the throttles
])
STATE = dtype([
    ("de_cmd", "f8"),        # elevator command, trailing edge down + [rad]
    ("da_cmd", "f8"),        # aileron command, + rolls right [rad]
    ("dr_cmd", "f8"),        # rudder command, + yaws left [rad]
    ("stab_cmd", "f8"),      # stabiliser command, trailing edge down + [rad]
    ("throttle_cmd", "f8"),  # 0..1
    ("n_c", "f8"),           # load-factor increment demanded after limits [g]
    ("e", "f8"),             # error that is integrated [g]
    ("protection", "f8"),    # 0 none, 1 angle of attack, 2 pitch attitude, 3 load factor
    ("xi", "f8"),            # its integral [g s]
    ("de_slow", "f8"),       # low-passed elevator command, for the trim [rad]
    ("hdot_ref", "f8"),      # vertical speed held [m/s]
    ("h_ref", "f8"),         # altitude held [m]
    ("r_lag", "f8"),         # yaw-rate error, low-passed, for the wash-out [rad/s]
    ("theta_lag", "f8"),     # attitude, low-passed, for a substitute of q [rad]
    ("xi_v", "f8"),          # integral of the speed error [m]
    ("held", "f8", (12,)),   # last valid measurement
    ("age", "f8", (12,)),    # seconds since it was valid
    ("fresh", "f8"),         # 0 before the first tick
])
OUTPUTS = ("de_cmd", "da_cmd", "dr_cmd", "stab_cmd", "throttle_cmd", "n_c", "e", "protection", "xi", "hdot_ref", "h_ref")

TAU_THETA = 0.1  # of the substitute pitch rate [s]
TAU_TRIM = 2.0   # of the elevator seen by the automatic trim [s]


def init(p):
    """Return the law at rest at the trim point."""
    x = np.zeros(p.shape, STATE)
    for name, start in {"de_cmd": "de_0", "de_slow": "de_0", "stab_cmd": "stab_0", "throttle_cmd": "throttle_0", "h_ref": "h_0",
                        "theta_lag": "theta_0"}.items():
        x[name] = p[start]
    for i, name in ((ALPHA, "alpha_0"), (THETA, "theta_0"), (PSI, "psi_0"), (NZ, "nz_0"), (CAS, "cas_0"), (TAS, "tas_0"), (H, "h_0")):
        x["held"][:, i] = p[name]
    return x


@kernel
def _clip(v, low, high):
    return min(max(v, low), high)


@kernel
def _trust(age):
    """Return the share of a feedback left, 1 while its signal is held, then fading to 0."""
    return min(1.0, max(0.0, 1.0 - (age - HOLD_S) / FADE_S))


@kernel
def _receive(x, u, dt):
    """Take what is valid, keep the last value of the rest and its age."""
    for i in range(12):
        if u.valid[i] > 0.0 and math.isfinite(u.y[i]):
            x.held[i] = u.y[i]
            x.age[i] = 0.0
        else:
            x.age[i] = x.age[i] + dt


@kernel
def _demand(x, u, p, level):
    """Return (n_c, protection): the load-factor increment demanded, by the pilot or a hold, within the limits [g]."""
    y, age = x.held, x.age
    path = _trust(age[HDOT])
    if abs(u.nz_dem) > 0.005:
        n_c = u.nz_dem
        x.hdot_ref, x.h_ref = y[HDOT], y[H]
    elif u.hold_h > 0.0 and age[H] < HOLD_S:
        n_c = _clip((p.w_h * p.w_h * (x.h_ref - y[H]) - 2.0 * p.zeta_h * p.w_h * y[HDOT]) / G0, -p.n_hold, p.n_hold) * path
        x.hdot_ref = 0.0
    else:
        n_c = _clip(p.k_path * (x.hdot_ref - y[HDOT]) / G0, -p.n_hold, p.n_hold) * path
    protection = 0.0
    seen = _trust(age[THETA])
    up = y[TAS] / G0 * p.k_theta * (p.theta_max - y[THETA])
    down = y[TAS] / G0 * p.k_theta * (p.theta_min - y[THETA])
    if seen > 0.0 and not down <= n_c <= up:
        n_c, protection = _clip(n_c, down, up), 2.0
    if not p.n_min - level <= n_c <= p.n_max - level:
        n_c, protection = _clip(n_c, p.n_min - level, p.n_max - level), 3.0
    return n_c, protection


@kernel
def _pitch(x, u, p, dt):
    y, age = x.held, x.age
    s = _clip((p.cas_0 / max(y[CAS], 20.0)) * (p.cas_0 / max(y[CAS], 20.0)), 0.4, 4.0) if age[CAS] < HOLD_S + FADE_S else 1.0
    bank = _clip(y[PHI], -1.05, 1.05)
    tas = max(y[TAS], 50.0)
    level = p.nz_0 / math.cos(bank)
    x.n_c, x.protection = _demand(x, u, p, level)

    q = y[Q] * _trust(age[Q])
    x.theta_lag = x.theta_lag + dt / TAU_THETA * (y[THETA] - x.theta_lag)
    if age[Q] > HOLD_S:
        q = q + (1.0 - _trust(age[Q])) * (y[THETA] - x.theta_lag) / TAU_THETA
    q_level = G0 / tas * math.sin(bank) * math.tan(bank)
    seen = _trust(age[NZ])
    x.e = (x.n_c - (y[NZ] - level)) * seen
    if age[ALPHA] < HOLD_S:
        rate = q - G0 / tas * (y[NZ] - math.cos(y[THETA]) * math.cos(bank)) * seen
        e_alpha = p.k_alpha * (p.alpha_max - y[ALPHA]) - p.k_rate * rate
        if e_alpha < x.e:
            x.e, x.protection = e_alpha, 1.0
    de = s * (-p.k_nz * x.e - p.k_i * x.xi + p.k_q * (q - q_level - G0 * x.n_c / tas)) - (1.0 - seen) * s * p.k_direct * x.n_c
    de = de + p.de_0 + u.de_add
    x.de_cmd = _clip(de, p.de_min, p.de_max)
    # integrate unless that drives further into the stop, and not on a load factor that is not there
    if (x.de_cmd == de or (de - x.de_cmd) * x.e > 0.0) and (seen >= 1.0 or x.protection == 1.0):
        x.xi = x.xi + x.e * dt
    # automatic trim: off in protections, in steep turns and while the surface is driven directly
    x.de_slow = x.de_slow + dt / TAU_TRIM * (x.de_cmd - u.de_add - p.de_0 - x.de_slow)
    if x.protection == 0.0 and abs(bank) < 0.58 and abs(u.nz_dem) < 0.5 and seen >= 1.0:
        off = x.de_slow - _clip(x.de_slow, -p.trim_dead, p.trim_dead)
        x.stab_cmd = _clip(x.stab_cmd + dt * _clip(p.k_trim * off, -p.trim_rate, p.trim_rate), p.stab_min, p.stab_max)


@kernel
def _lateral(x, u, p, dt):
    y, age = x.held, x.age
    tas = max(y[TAS], 50.0)
    phi_dem = u.phi_dem
    if u.hold_psi > 0.0:
        e = p.psi_0 + u.psi_dem - y[PSI]
        e = math.atan2(math.sin(e), math.cos(e))
        phi_dem = _clip(p.k_psi * e * _trust(age[PSI]), -p.phi_hold, p.phi_hold)
    p_c = _clip(p.w_phi * (phi_dem - y[PHI]), -p.p_max, p.p_max) * _trust(age[PHI])
    x.da_cmd = _clip(p.k_pff * p_c + p.k_p * (p_c - y[P]) * _trust(age[P]), -p.da_max, p.da_max)
    turn = G0 / tas * math.sin(_clip(y[PHI], -1.05, 1.05)) * math.cos(y[THETA])
    e_r = (y[R] - turn) * _trust(age[R]) * _trust(age[PHI])
    x.r_lag = x.r_lag + dt / p.tau_r * (e_r - x.r_lag)
    x.dr_cmd = _clip(p.k_r * (e_r - x.r_lag), -p.dr_max, p.dr_max)


@kernel
def step(x, u, p, dt):
    """Advance the law by one tick."""
    _receive(x, u, dt)
    if x.fresh == 0.0:
        x.fresh = 1.0
        x.h_ref, x.hdot_ref = x.held[H], 0.0
    _pitch(x, u, p, dt)
    _lateral(x, u, p, dt)
    if u.hold_v > 0.0 and x.age[CAS] < HOLD_S:
        e = p.cas_0 - x.held[CAS]
        x.throttle_cmd = _clip(p.throttle_0 + p.k_v * e + p.k_vi * x.xi_v, 0.0, 1.0)
        if 0.0 < x.throttle_cmd < 1.0:
            x.xi_v = x.xi_v + e * dt


@kernel
def rollout(x, u, p, dt, log):
    """Advance every lane through every tick."""
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            step(x[i], u[i, k], p[i], dt)
            log[i, k] = x[i]


# -- design ----------------------------------------------------------------------------------------------------------------------------

LAG_S = 0.07  # what stands for actuator, sensor delay and hold in the design: a first-order lag [s]; `cosim.margins` has the real ones
# one standard step of each by Bryson's rule: g s of held error, deg/s of pitch rate, deg of elevator
WEIGHTS = (0.22, 1.4, 2.5)


def pitch_gains(A, B, nz_alpha, nz_de):
    """Design (k_q, k_nz, k_i) by LQ on short period, actuator lag and an integrator on load factor.

    A (2, 2), B (2,) belong to (alpha [rad], q [rad/s]) and all elevators together [rad]; nz_alpha, nz_de [g/rad]. Design state
    (alpha, q, delta, xi); alpha becomes n/nz_alpha, the feedback of delta is dropped (`cosim.margins` shows what is left).
    """
    Az = np.zeros((4, 4))
    Az[:2, :2], Az[:2, 2], Az[2, 2] = A, B, -1.0 / LAG_S
    Az[3, 0], Az[3, 2] = nz_alpha, nz_de
    Bz = np.array([[0.0], [0.0], [1.0 / LAG_S], [0.0]])
    g_s, deg_s, deg = WEIGHTS
    K = (solve_continuous_are(Az, Bz, np.diag([0.0, 1 / math.radians(deg_s) ** 2, 0.0, 1 / g_s**2]), np.array([[1 / math.radians(deg) ** 2]])))
    K = (math.radians(deg) ** 2 * Bz.T @ K).ravel()
    return -K[1], -K[0] / nz_alpha, -K[3]


def alpha_limit(plant, trim, share=0.96):
    """Return the angle of attack [rad] where lift is `share` of the largest at this Mach number and dynamic pressure; `plant` is moved about.

    4 % of lift are 2 % of speed in hand to the stall, as in the angle-of-attack protection of a fly-by-wire transport.
    """
    angles = np.radians(np.arange(0.0, 25.01, 0.5))
    lift = []
    for alpha in angles:
        plant.place(tas=trim.tas, alpha=alpha, theta=alpha, altitude=trim.altitude, q=trim.q, surfaces=trim.surfaces)
        t = plant.truth()[0]
        lift.append(t.nz * math.cos(alpha) - t.nx * math.sin(alpha))
    top = int(np.argmax(lift))
    return float(np.interp(share * lift[top], lift[: top + 1], angles[: top + 1]))


def design(model, alpha_max):
    """Return PARAMS at the flight point of `model` (a linearize.LinearModel); the protection holds `alpha_max` [rad]."""
    t = model.trim
    elevators = ("de_lo", "de_li", "de_ri", "de_ro")
    A, B, C, D = model.block(("alpha", "q"), elevators, ("nz",))
    k_q, k_nz, k_i = pitch_gains(A, B.sum(1), C[0, 0], D.sum())
    steady = -np.linalg.solve(A, B.sum(1))  # alpha, q per elevator
    per_g = 1.0 / (C[0] @ steady + D.sum())
    LA, LB, _, _ = model.block(("p", "r"), ("da_l", "da_r", "dr"))
    L_p, L_da, N_r, N_dr = LA[0, 0], LB[0, 0] + LB[0, 1], LA[1, 1], LB[1, 2]
    dutch = next(m for m in model.modes if m.name == "dutch_roll")
    roll = max(1.3, 1.2 * -L_p)  # closed roll mode [rad/s]
    T_V = model.block(("tas",), ("throttle_1", "throttle_2", "throttle_3", "throttle_4"))[1].sum()  # [m/s2]
    p_max = min(math.radians(5.0), 0.8 * math.radians(20.0) * L_da / -L_p)
    return record(
        PARAMS, k_nz=k_nz, k_i=k_i, k_q=k_q, k_direct=-per_g, k_alpha=1.0 * C[0, 0], k_rate=0.6 * C[0, 0], alpha_max=alpha_max,
        k_theta=0.6, theta_max=math.radians(25.0), theta_min=math.radians(-12.0), n_max=2.5, n_min=-1.0,
        k_path=0.35, w_h=0.22, zeta_h=0.9, n_hold=0.25, k_trim=0.05, trim_rate=math.radians(0.25), trim_dead=math.radians(0.15),
        stab_min=math.radians(-12.5), stab_max=math.radians(3.5), w_phi=0.5, p_max=p_max, k_p=max(roll + L_p, 0.0) / L_da, k_pff=-L_p / L_da,
        k_r=max(1.2 * dutch.wn + N_r, 0.0) / -N_dr, tau_r=8.0, k_psi=0.9, phi_hold=math.radians(25.0),
        k_v=0.15 / T_V, k_vi=0.15 * 0.05 / T_V, nz_0=t.nz, cas_0=_cas(model), alpha_0=t.alpha, theta_0=t.theta, h_0=t.altitude, psi_0=0.0,
        tas_0=t.tas, stab_0=t.stabilizer, throttle_0=t.throttle, de_0=t.elevator, de_min=math.radians(-23.0), de_max=math.radians(17.0),
        da_max=math.radians(20.0), dr_max=math.radians(20.0),
    )


def _cas(model):
    return float(model.y0[list(model.outputs).index("cas")])
