"""Flight-control law on measurements: load-factor demand with protections, automatic trim, bank demand, and the holds.

Pitch (normal law, C* in form: load factor by an integrator, pitch rate about that of the demanded turn of the flight
path), with n the load-factor increment over unaccelerated flight at this attitude, cos(theta) / cos(phi):

    e       = min(n_c - n_m, e_alpha)                                                   [g]
    delta_e = s [ k_nz (n_m - b_n (n_m + e)) + k_q (q - q_turn - g (n_m + e) / V) ] + xi,   xi' = -s k_i e
    s       = (V_0 / V)^2,   delta_e trailing edge down +
    e_alpha = [k_alpha (alpha_max - alpha) - k_rate alpha'] / sqrt(s),    alpha' = q - g (n_z - cos(theta) cos(phi)) / V

n_m + e is the increment asked for by whoever leads: n_c, or the angle-of-attack protection where it asks for less,
through the same integrator. n_c is the pilot's demand or, with the stick free, what holds the flight path (vertical
speed) or the altitude. It stays within the load factors of the structure and of the pitch-attitude protection,
n_c <= V/g k_theta (theta_max - theta - lead q_path), likewise below. `alpha_lim` is the angle of attack of the limit
that binds: alpha_max, or the angle that belongs at this speed to the largest n_c which the other two allow. Automatic
trim moves the stabiliser slowly until the elevator is free.

Lateral: a reference bank approaches the demand, as far as ailerons and wing can hold it; its rate feeds forward, bank
error and its integral feed back; rudder damps yaw rate about that of the turn and removes sideslip (an engine out),
unless the ailerons are at their stops: then sideslip is asked for that rolls in their place.

A signal whose flag falls is held for 0.2 s; then its feedback fades out in 0.5 s, and in again when it returns:
without n_z the pilot and the holds move the elevator through k_direct; q is replaced by the slope of theta; without
alpha its protection gives way to a cap on load factor by speed, n_stall (V/V_0)^2; without hdot or h the path is not
held; without theta its protection is off; phi is carried on by p, drawn to the bank that the yaw rate belongs to;
without p, r or beta that feedback is off; without CAS or TAS gains stay as they are, and the throttles. No command is
ever NaN.
"""

import numpy as np

from actuators.block import dtype, entry, kernel
from actuators.constants import G0
from cosim.flight.blocks.law.lateral import lateral
from cosim.flight.blocks.law.pitch import pitch
from cosim.flight.blocks.law.signals import ALPHA, CAS, HDOT, HOLD_S, NZ, PHI, PSI, TAS, THETA, H, N, clip, receive
from cosim.flight.blocks.law.signals import SENSORS as SENSORS

PARAMS = dtype([
    ("k_nz", "f8"), ("k_i", "f8"), ("k_q", "f8"),         # [rad/g], [rad/g/s], [s]
    ("b_n", "f8", "-"),                                   # share of the demand that acts at once
    ("k_direct", "f8", "rad/g"),                          # elevator per demanded g when n_z is lost
    ("k_alpha", "f8"), ("k_rate", "f8"), ("alpha_max", "f8"),  # [g/rad], [g s/rad], [rad]
    ("n_alpha", "f8"), ("n_stall", "f8"),                 # at the trim speed: [g/rad], n_z at alpha_max [g]
    ("k_theta", "f8"), ("lead", "f8"),                    # [1/s], lag of the load-factor loop that is made up for [s]
    ("theta_max", "f8"), ("theta_min", "f8"),             # [rad]
    ("n_max", "f8"), ("n_min", "f8"),                     # load-factor limits [g]
    ("k_path", "f8", "1/s"),                              # vertical-speed hold
    ("w_h", "f8"), ("zeta_h", "f8"),                      # altitude hold [rad/s], [-]
    ("n_hold", "f8", "g"),                                # most that the holds demand
    ("k_trim", "f8"), ("trim_rate", "f8"), ("trim_dead", "f8"),  # stabiliser per elevator [1/s], [rad/s], left [rad]
    ("stab_min", "f8"), ("stab_max", "f8"),               # [rad]
    ("w_phi", "f8"), ("w_p", "f8"), ("p_max", "f8"),      # reference bank: approach, lag [1/s], limit [rad/s]
    ("k_phi", "f8"), ("k_phii", "f8"), ("k_p", "f8"),     # aileron per bank error, its integral, rate [-, 1/s, s]
    ("da_a", "f8"), ("da_p", "f8"), ("da_t", "f8"),       # aileron per reference p', p and turn rate [s2, s, s]
    ("dr_a", "f8"), ("dr_p", "f8"), ("dr_t", "f8"),       # rudder per the same three
    ("k_r", "f8"), ("tau_r", "f8"),                       # rudder per yaw rate [s], wash-out [s]
    ("k_beta", "f8"), ("k_betai", "f8"),                  # rudder per sideslip [-], its rate [1/s]
    ("k_cross", "f8"), ("beta_max", "f8"),                # sideslip that rolls as one rad of aileron, most [rad]
    ("w_psi", "f8"), ("phi_hold", "f8"),                  # heading hold [rad/s], its largest bank [rad]
    ("k_v", "f8"), ("k_vi", "f8"),                        # throttle per speed error [s/m], integral [1/m]
    ("nz_0", "f8"), ("cas_0", "f8"), ("alpha_0", "f8"), ("theta_0", "f8"),  # at the trim [g, m/s, rad, rad]
    ("h_0", "f8"), ("psi_0", "f8"), ("tas_0", "f8"),      # [m, rad, m/s]
    ("stab_0", "f8"), ("throttle_0", "f8"), ("de_0", "f8"),  # trim [rad, -, rad]
    ("phi_0", "f8"), ("hdot_0", "f8"), ("da_0", "f8"), ("dr_0", "f8"),  # of a turn or climb [rad, m/s, rad, rad]
    ("de_max", "f8"), ("de_min", "f8"), ("da_max", "f8"), ("dr_max", "f8"),  # [rad]
])
INPUTS = dtype([
    ("y", "f8", (N,)),       # measurements in the order of SENSORS [SI]
    ("valid", "f8", (N,), "-"),  # their flags
    ("nz_dem", "f8", "g"),   # demanded load-factor increment
    ("phi_dem", "f8", "rad"),  # demanded bank
    ("psi_dem", "f8", "rad"),  # demanded change of heading
    ("de_add", "f8", "rad"),  # added to the elevator command
    ("hold_psi", "f8"),      # 1: the heading hold steers
    ("hold_h", "f8"),        # 1: the altitude hold steers while the stick is free
    ("hold_v", "f8"),        # 1: the speed hold moves the throttles
])
STATE = dtype([
    ("de_cmd", "f8", "rad"),  # elevator command, trailing edge down +
    ("da_cmd", "f8", "rad"),  # aileron command, + rolls right
    ("dr_cmd", "f8", "rad"),  # rudder command, + yaws left
    ("stab_cmd", "f8", "rad"),  # stabiliser command, trailing edge down +
    ("throttle_cmd", "f8", "-"),  # 0..1
    ("n_c", "f8", "g"),      # load-factor increment demanded after limits
    ("e", "f8", "g"),        # error that is integrated
    ("protection", "f8", "-"),    # 0 none, 1 angle of attack, 2 pitch attitude, 3 load factor
    ("alpha_lim", "f8", "rad"),  # angle of attack of the limit that binds
    ("xi", "f8", "rad"),     # elevator from the integral of e
    ("phi_ref", "f8", "rad"),  # reference bank
    ("p_ref", "f8", "rad/s"),  # its rate
    ("hdot_ref", "f8", "m/s"),  # vertical speed held
    ("h_ref", "f8", "m"),    # altitude held
    ("de_slow", "f8", "rad"),  # low-passed elevator command, for the trim
    ("room", "f8", "rad"),   # angle of attack left to the limits of load factor and attitude, low-passed
    ("r_lag", "f8", "rad/s"),  # yaw-rate error, low-passed, for the wash-out
    ("theta_lag", "f8", "rad"),  # attitude, low-passed, for a substitute of q
    ("phi_hat", "f8", "rad"),  # bank, measured or carried on
    ("xi_phi", "f8", "rad"),  # aileron from the integral of the bank error
    ("xi_dr", "f8", "rad"),  # rudder trim
    ("cas_lag", "f8", "m/s"),  # speed, low-passed, for the throttles
    ("xi_v", "f8", "m"),     # integral of the speed error
    ("held", "f8", (N,)),    # last valid measurement
    ("age", "f8", (N,)),     # seconds since it was valid; runs back when it returns
    ("fresh", "f8"),         # 0 before the first tick
])
OUTPUTS = ("de_cmd", "da_cmd", "dr_cmd", "stab_cmd", "throttle_cmd", "n_c", "e", "protection", "alpha_lim", "xi",
           "phi_ref", "hdot_ref", "h_ref")
TAU_CAS = 2.0  # of the speed that moves the throttles: neither noise nor gusts are theirs to follow [s]


def init(p: np.ndarray) -> np.ndarray:
    """Return the law at rest at the trim point."""
    x = np.zeros(p.shape, STATE)
    start = {"de_cmd": "de_0", "de_slow": "de_0", "stab_cmd": "stab_0", "throttle_cmd": "throttle_0", "h_ref": "h_0"}
    start |= {"cas_lag": "cas_0", "phi_ref": "phi_0", "phi_hat": "phi_0", "hdot_ref": "hdot_0"}
    for name, value in (start | {"theta_lag": "theta_0", "alpha_lim": "alpha_max"}).items():
        x[name] = p[value]
    held = {ALPHA: "alpha_0", THETA: "theta_0", PSI: "psi_0", NZ: "nz_0", CAS: "cas_0", TAS: "tas_0", H: "h_0",
            PHI: "phi_0", HDOT: "hdot_0"}  # fmt: skip
    for i, name in held.items():
        x["held"][:, i] = p[name]
    turn = G0 / p["tas_0"] * np.tan(p["phi_0"])  # its feed-forward and the integrals together are the trim
    x["xi_phi"], x["xi_dr"] = p["da_0"] - p["da_t"] * turn, p["dr_0"] - p["dr_t"] * turn
    return x


@kernel
def step(x, u, p, dt):
    """Advance the law by one tick."""
    receive(x, u, dt)
    pitch(x, u, p, dt)
    lateral(x, u, p, dt)
    x.cas_lag = x.cas_lag + dt / TAU_CAS * (x.held[CAS] - x.cas_lag)
    if u.hold_v > 0.0 and x.age[CAS] < HOLD_S:
        e = p.cas_0 - x.cas_lag
        throttle = p.throttle_0 + p.k_v * e + p.k_vi * x.xi_v
        x.throttle_cmd = clip(throttle, 0.0, 1.0)
        if x.throttle_cmd == throttle or (throttle - x.throttle_cmd) * e < 0.0:
            x.xi_v = x.xi_v + e * dt


rollout = entry(step, STATE, INPUTS, PARAMS)
