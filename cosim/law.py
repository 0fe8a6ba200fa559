"""Flight-control law on measurements: load-factor demand with pitch damping, bank-angle demand with yaw damping.

Pitch:  delta_e = -s (k_ff n_c + k_nz (n_c - n_m) + k_i int(n_c - n_m) dt) + s k_q q_m,   s = (V_0 / V)^2
with n_c the demanded and n_m the measured load-factor increment over that of level flight at the present bank, positive nose up, so the
elevator (trailing edge down +) gets the minus sign. Lateral: bank angle and roll rate to the ailerons, washed-out yaw rate to the rudder.

A signal whose flag falls is held for 0.2 s; after that its feedback fades out in 0.5 s, and no command is ever NaN.
"""

import math

import numpy as np
from scipy.linalg import solve_continuous_are

from actuators.block import dtype, kernel, record

SENSORS = ("alpha", "q", "theta", "phi", "p", "r", "psi", "n_z", "cas", "h_inertial", "hdot")
ALPHA, Q, THETA, PHI, P, R, PSI, NZ, CAS, H, HDOT = range(11)
HOLD_S = 0.2  # a lost signal is held that long [s]
FADE_S = 0.5  # and its feedback then fades out in that time [s]

PARAMS = dtype([
    ("k_ff", "f8"), ("k_nz", "f8"), ("k_i", "f8"),  # elevator per load factor [rad/g], integral [rad/g/s]
    ("k_q", "f8"),                                  # elevator per pitch rate [s]
    ("k_phi", "f8"), ("k_p", "f8"),                 # aileron per bank error [-] and roll rate [s]
    ("k_r", "f8"), ("tau_r", "f8"),                 # rudder per washed-out yaw rate [s], wash-out [s]
    ("k_psi", "f8"),                                # bank demand per heading error [-]
    ("nz_0", "f8"), ("cas_0", "f8"), ("theta_0", "f8"),  # level flight at the trim point [g, m/s, rad]
    ("stab_0", "f8"), ("throttle_0", "f8"), ("de_0", "f8"),  # trim [rad, -, rad]
    ("psi_0", "f8"),
    ("nz_max", "f8"), ("nz_min", "f8"),             # total load factor [g]
    ("de_max", "f8"), ("de_min", "f8"),             # [rad]
    ("da_max", "f8"), ("dr_max", "f8"),             # [rad]
])
INPUTS = dtype([
    ("y", "f8", (11,)),      # measurements in the order of SENSORS [SI]
    ("valid", "f8", (11,)),  # their flags
    ("nz_dem", "f8"), ("phi_dem", "f8"), ("psi_dem", "f8"), ("de_add", "f8"), ("hold", "f8"),  # from the manoeuvre
])
STATE = dtype([
    ("de_cmd", "f8"),        # elevator command, trailing edge down + [rad]
    ("da_cmd", "f8"),        # aileron command, + rolls right [rad]
    ("dr_cmd", "f8"),        # rudder command, + yaws left [rad]
    ("stab_cmd", "f8"),      # stabiliser command, trailing edge down + [rad]
    ("throttle_cmd", "f8"),  # 0..1
    ("n_c", "f8"),           # load-factor increment demanded after limits [g]
    ("xi", "f8"),            # integral of the load-factor error [g s]
    ("r_lag", "f8"),         # yaw rate, low-passed, for the wash-out [rad/s]
    ("held", "f8", (11,)),   # last valid measurement
    ("age", "f8", (11,)),    # seconds since it was valid
    ("fresh", "f8"),         # 0 before the first tick
])
OUTPUTS = ("de_cmd", "da_cmd", "dr_cmd", "stab_cmd", "throttle_cmd", "n_c", "xi")


def pitch_gains(A, B, nz_alpha, V):
    """Design (k_q, k_nz, k_i, k_ff) by LQ on the short period with an integrator on load factor.

    A (2, 2) and B (2,) are the rows and columns of (alpha [rad], q [rad/s]) and of all elevators together [rad]; nz_alpha [g/rad]. The
    design state (alpha, q, xi) is turned into output feedback by alpha = n/nz_alpha. Weights are set by Bryson's rule: 0.3 g of held error
    per second and 2 deg/s of pitch rate are worth 2.5 deg of elevator.
    """
    Az = np.zeros((3, 3))
    Az[:2, :2] = A
    Az[2, 0] = nz_alpha
    Bz = np.array([[B[0]], [B[1]], [0.0]])
    weights = np.diag([0.0, 1 / math.radians(2.0) ** 2, 1 / 0.3**2])
    R = np.array([[1 / math.radians(2.5) ** 2]])
    K = (np.linalg.inv(R) @ Bz.T @ solve_continuous_are(Az, Bz, weights, R)).ravel()
    return -K[1], -K[0] / nz_alpha, -K[2], 0.0


def init(p):
    """Return the law at rest at the trim point."""
    x = np.zeros(p.shape, STATE)
    x["de_cmd"], x["stab_cmd"], x["throttle_cmd"] = p["de_0"], p["stab_0"], p["throttle_0"]
    return x


@kernel
def _trust(age):
    """Return the share of a feedback left, 1 while its signal is held, then fading to 0."""
    return min(1.0, max(0.0, 1.0 - (age - HOLD_S) / FADE_S))


@kernel
def _clip(v, low, high):
    return min(max(v, low), high)


@kernel
def step(x, u, p, dt):
    """Advance the law by one tick."""
    for i in range(11):
        if u.valid[i] > 0.0 and math.isfinite(u.y[i]):
            x.held[i] = u.y[i]
            x.age[i] = 0.0
        elif x.fresh == 0.0:
            x.age[i] = HOLD_S + FADE_S
        else:
            x.age[i] = x.age[i] + dt
    x.fresh = 1.0
    y, age = x.held, x.age

    # pitch
    cas = y[CAS] if y[CAS] > 20.0 else p.cas_0
    s = _clip((p.cas_0 / cas) * (p.cas_0 / cas), 0.4, 2.5)
    bank = _clip(y[PHI], -1.05, 1.05)
    level = p.nz_0 * (1.0 / math.cos(bank))
    x.n_c = _clip(level + u.nz_dem, p.nz_min, p.nz_max) - level
    error = (x.n_c - (y[NZ] - level)) * _trust(age[NZ])
    q_turn = 9.80665 / (1.2 * cas) * math.sin(bank) * math.tan(bank)
    de = s * (-p.k_ff * x.n_c - p.k_nz * error - p.k_i * x.xi) + s * p.k_q * (y[Q] - q_turn) * _trust(age[Q])
    de = de + p.de_0 + u.de_add
    x.de_cmd = _clip(de, p.de_min, p.de_max)
    if x.de_cmd == de or (de - x.de_cmd) * error > 0.0:  # integrate unless that drives further into the limit
        x.xi = x.xi + error * dt

    # lateral
    phi_dem = u.phi_dem
    if u.hold > 0.0:
        e = p.psi_0 + u.psi_dem - y[PSI]
        e = math.atan2(math.sin(e), math.cos(e))
        phi_dem = _clip(p.k_psi * e * _trust(age[PSI]), -0.44, 0.44)
    da = p.k_phi * (phi_dem - y[PHI]) * _trust(age[PHI]) - p.k_p * y[P] * _trust(age[P])
    x.da_cmd = _clip(da, -p.da_max, p.da_max)
    x.r_lag = x.r_lag + dt / p.tau_r * (y[R] - x.r_lag)
    x.dr_cmd = _clip(p.k_r * (y[R] - x.r_lag) * _trust(age[R]), -p.dr_max, p.dr_max)
    x.stab_cmd = p.stab_0
    x.throttle_cmd = p.throttle_0


@kernel
def rollout(x, u, p, dt, log):
    """Advance every lane through every tick."""
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            step(x[i], u[i, k], p[i], dt)
            log[i, k] = x[i]


def params(*, trim, pitch, nz_alpha, V, lateral=(1.2, 1.2, 1.0), limits=(-0.4014, 0.2967)):
    """Return the law's parameters at a trim point.

    `trim` has nz, cas [m/s], theta, stabilizer, elevator, psi [rad] and throttle; `pitch` is (A, B) of `pitch_gains`; `lateral` is
    (k_phi, k_p, k_r). Elevator limits are the travel of DESIGN section 3, -23 and +17 deg.
    """
    k_q, k_nz, k_i, k_ff = pitch_gains(*pitch, nz_alpha, V)
    k_phi, k_p, k_r = lateral
    return record(
        PARAMS, k_q=k_q, k_nz=k_nz, k_i=k_i, k_ff=k_ff, k_phi=k_phi, k_p=k_p, k_r=k_r, tau_r=4.0, k_psi=1.2,
        nz_0=trim["nz"], cas_0=trim["cas"], theta_0=trim["theta"], stab_0=trim["stabilizer"], throttle_0=trim["throttle"],
        de_0=trim["elevator"], psi_0=trim["psi"], nz_max=2.5, nz_min=-1.0, de_min=limits[0], de_max=limits[1],
        da_max=math.radians(20.0), dr_max=math.radians(20.0),
    )


def short_period(plant, trim):
    """Return (A (2, 2), B (2,), nz_alpha [g/rad]) of (alpha [rad], q [rad/s]) and all elevators [rad], by central differences about `trim`.

    `plant` is one of its own: it is moved about. alpha' = (w' cos alpha - u' sin alpha) / V.
    """

    def at(d_alpha=0.0, d_q=0.0, d_e=0.0):
        surfaces = trim.surfaces.copy()
        surfaces[:4] += d_e
        plant.place(tas=trim.tas, alpha=trim.alpha + d_alpha, theta=trim.theta, altitude=trim.altitude, q=trim.q + d_q, surfaces=surfaces)
        t = plant.truth()[0]
        return np.array([(t.wdot * math.cos(t.alpha) - t.udot * math.sin(t.alpha)) / t.tas, t.qdot, t.nz])

    h = 1e-4
    alpha, q, e = ((at(**{k: h}) - at(**{k: -h})) / (2 * h) for k in ("d_alpha", "d_q", "d_e"))
    return np.array([[alpha[0], q[0]], [alpha[1], q[1]]]), np.array([e[0], e[1]]), float(alpha[2])


def design(plant, trim, truth):
    """Return PARAMS for the flight point `trim` (a Trim) with the truth there; `plant` is moved about."""
    A, B, nz_alpha = short_period(plant, trim)
    at = {"nz": trim.nz, "cas": truth.cas, "theta": trim.theta, "stabilizer": trim.stabilizer, "elevator": trim.elevator,
          "psi": truth.psi, "throttle": trim.throttle}
    return params(trim=at, pitch=(A, B), nz_alpha=nz_alpha, V=trim.tas)
