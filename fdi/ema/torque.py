"""What torques that the filter does not know make of its innovations, and the friction that these show.

A torque is carried through the filter's own gain: e+ = (1 - K4) e + kick + share of the load. Friction, and a drag that
grows with the rate, are least squares of the innovations on the signatures of -tanh(w / CREEP) and -w.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm

CREEP = 3.0  # rate within which friction changes its sign: three deviations of the velocity sensor [rad/s]
TAU_FRICTION = 0.7  # memory of friction, of motion [s]
VISCOUS = 0.003  # deviation of a drag that grows with the rate: 5 % of K_B at the largest current [N m s/rad]
Z_FRICTION = 3.0  # deviations of friction that are taken off before its test
T_FRICTION = 0.5  # confirmation, after that of the sensors, which can look like friction [s]
TAU_FELT, TAU_ONSET = 0.03, 0.1  # lag of what the motor feels; what came so shortly before an alarm is of its onset [s]
RUBS = 0.08  # of the stall torque: friction of a fault, four times that of a healthy drive (actuators.ema.actuator)
STANDS, RELEASE = 0.7, 0.5  # of the threshold: keeps the alarm; and by how long that outlives it [s]

PARAMS = [
    ("th_friction", "f8", "N m"),  # at the motor
]
STATE = [
    ("twin", "f8", (4, 2)),  # errors of rate [rad/s] and load [N m] by f, friction, drag, the velocity sensor
    ("felt_lag", "f8", (3,), "rad/s"),  # lagged signatures of f as a torque, as a misread velocity, and innovation
    ("felt_J", "f8", (3,)),  # sums of the two signatures' products, in units of the innovation's noise
    ("felt_b", "f8", (2,)),  # and with the innovation
    ("rub_sum", "f8", (5,)),  # of friction and drag: squares and product of their signatures, products with gamma
    ("friction", "f8", "N m"),  # torque that opposes the motion, at the motor
    ("r_friction", "f8", "-"),  # over its threshold
    ("friction_timer", "f8", "s"),
    ("hot_friction", "f8", "-"),  # confirmed
]


@kernel
def push(x, j, kick, p):
    """Carry signature `j` through the filter, which adds `kick` [rad/s] to the rate over this tick; return what that
    makes of the innovation [rad/s].
    """
    load = x.twin[j, 1] - p.K[5] * x.twin[j, 0]
    x.twin[j, 0] = (1.0 - p.K[3]) * x.twin[j, 0] + kick + p.phi_load * load
    x.twin[j, 1] = p.leak * load
    return x.twin[j, 0]


@kernel
def read(x, j, error, p):
    """Carry signature `j` of a velocity reading that is off by `error` [rad/s] through the filter; return what that
    makes of the innovation [rad/s]."""
    gamma = x.twin[j, 0] + error
    load = x.twin[j, 1] - p.K[5] * gamma
    x.twin[j, 0] += p.phi_load * load - p.K[3] * gamma
    x.twin[j, 1] = p.leak * load
    return gamma


@kernel
def feel(x, f, gamma, current, p, dt):
    """Add up which shares of the excess current `f` [A] the innovation `gamma` shows as a torque and as a velocity that
    is misread by f / b_motor, since it began; slow parts tell, as f shares the velocity sensor's noise."""
    J, b, lag, share = x.felt_J, x.felt_b, x.felt_lag, min(dt / TAU_FELT, 1.0)
    new = (push(x, 0, p.impulse * f, p), read(x, 3, f / p.b_motor, p), gamma)
    for k in range(3):
        lag[k] += share * (new[k] - lag[k])
    keep = 1.0 - min(dt / TAU_ONSET, 1.0) if x.f_timer <= 0.0 and x.hot_gain < 0.5 else 1.0
    over = 1.0 / (p.S_root * p.S_root) if current else 0.0
    for k in range(3):
        J[k] = keep * J[k] + over * lag[min(k, 1)] * lag[max(k - 1, 0)]
    for k in range(2):
        b[k] = keep * b[k] + over * lag[2] * lag[k]


@kernel
def rub(x, w, gamma, told, p, dt):
    """Estimate what opposes the motion at rate `w` [rad/s] from the innovation `gamma`, where it is `told`; at rest
    nothing is learned and nothing forgotten, while another test says what is wrong all is.
    """
    per_torque = p.phi_load / p.ratio  # rate per tick of 1 N m at the motor
    sign = math.tanh(w / CREEP)
    a, b = push(x, 1, -sign * per_torque, p), push(x, 2, -w * per_torque, p)
    s = x.rub_sum
    elsewhere = x.hot_f > 0.5 or x.hot_gain > 0.5 or x.hot_load > 0.5 or x.hot_speed > 0.5
    if elsewhere or x.sensor > 0.5 or x.isolated_part > 0.5:
        s[:] = 0.0
        x.friction = x.r_friction = x.friction_timer = x.hot_friction = 0.0
    elif told:
        keep = 1.0 - min(dt / TAU_FRICTION, 1.0) * sign * sign
        s[0] = keep * s[0] + a * a
        s[1] = keep * s[1] + a * b
        s[2] = keep * s[2] + b * b
        s[3] = keep * s[3] + gamma * a
        s[4] = keep * s[4] + gamma * b
    drag = s[2] + (p.S_root / VISCOUS) * (p.S_root / VISCOUS)
    det = s[0] * drag - s[1] * s[1]
    if det <= 1e-9 * s[0] * drag:
        return
    x.friction = (s[3] * drag - s[4] * s[1]) / det
    x.r_friction = (x.friction - Z_FRICTION * p.S_root * math.sqrt(drag / det)) / p.th_friction
    beyond = x.r_friction >= (STANDS if x.hot_friction > 0.5 else 1.0) and x.age >= p.t_start
    x.friction_timer, x.hot_friction = confirm(x.friction_timer, x.hot_friction, beyond, dt, T_FRICTION, RELEASE)
