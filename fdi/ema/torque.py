"""What torques that the filter does not know make of its innovations, and the friction that these show.

A torque is carried through the filter's own gain: e+ = (1 - K4) e + kick + share of the load. Friction is least squares
of the innovations on the signature of -tanh(w / CREEP).
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm

CREEP = 3.0  # rate within which friction changes its sign: three deviations of the velocity sensor [rad/s]
TAU_FRICTION = 0.7  # memory of friction, of motion [s]
Z_FRICTION = 3.0  # deviations of friction that are taken off before its test
T_FRICTION = 0.5  # confirmation, after that of the sensors, which can look like friction [s]
TAU_FELT, TAU_ONSET = 0.03, 0.1  # lag of what the motor feels; what came so shortly before an alarm is of its onset [s]
RUBS = 0.08  # of the stall torque: friction of a fault, four times that of a healthy drive (actuators.ema.actuator)
STANDS, RELEASE = 0.7, 0.5  # of the threshold: keeps the alarm; and by how long that outlives it [s]

PARAMS = [
    ("th_friction", "f8", "N m"),  # at the motor
]
STATE = [
    ("twin", "f8", (3, 2)),  # errors of rate [rad/s] and load [N m] by f, friction, the velocity sensor
    ("felt_lag", "f8", (3,), "rad/s"),  # lagged signatures of f as a torque, as a misread velocity, and innovation
    ("felt", "f8", (6,)),  # sums of products of the three, in units of the innovation's noise
    ("rub_sum", "f8", (2,)),  # of friction: square of its signature, product with the innovation
    ("r_friction", "f8", "-"),  # what opposes the motion over its threshold
    ("friction_timer", "f8", "s"),
    ("hot_friction", "f8", "-"),  # confirmed
]


@kernel
def carry(x, j, kick, error, p):
    """Carry signature `j` through the filter, of a torque that adds `kick` [rad/s] to the rate over this tick or of a
    velocity reading that is off by `error` [rad/s]; return what that makes of the innovation [rad/s].
    """
    gamma = x.twin[j, 0] + kick + error
    load = x.twin[j, 1] - p.K[5] * gamma
    x.twin[j, 0] += kick + p.phi_load * load - p.K[3] * gamma
    x.twin[j, 1] = p.leak * load
    return gamma


@kernel
def feel(x, f, gamma, current, p, dt):
    """Add up which shares of the excess current `f` [A] the innovation `gamma` shows as a torque and as a velocity that
    is misread by f / b_motor, since it began; slow parts tell, as f shares the velocity sensor's noise."""
    lag, share, i = x.felt_lag, min(dt / TAU_FELT, 1.0), 0
    new = (carry(x, 0, p.impulse * f, 0.0, p), carry(x, 2, 0.0, f / p.b_motor, p), gamma)
    for k in range(3):
        lag[k] += share * (new[k] - lag[k])
    keep = 1.0 - min(dt / TAU_ONSET, 1.0) if x.f_timer <= 0.0 else 1.0
    over = 1.0 / (p.S_root * p.S_root) if current else 0.0
    for k in range(3):
        for j in range(k + 1):
            x.felt[i] = keep * x.felt[i] + over * lag[k] * lag[j]
            i += 1


@kernel
def rub(x, w, gamma, told, p, dt):
    """Estimate what opposes the motion at rate `w` [rad/s] from the innovation `gamma`, where it is `told`; at rest
    nothing is learned and nothing forgotten, while another test says what is wrong all is.
    """
    sign, sums = math.tanh(w / CREEP), x.rub_sum
    opposed = carry(x, 1, -sign * p.phi_load / p.ratio, 0.0, p)
    elsewhere = x.hot_f > 0.5 or x.hot_gain > 0.5 or x.hot_load > 0.5 or x.hot_speed > 0.5
    if elsewhere or x.sensor > 0.5 or x.isolated_part > 0.5:
        sums[:] = 0.0
    elif told:
        keep = 1.0 - min(dt / TAU_FRICTION, 1.0) * sign * sign
        sums[0] = keep * sums[0] + opposed * opposed
        sums[1] = keep * sums[1] + opposed * gamma
    known = max(sums[0], 1e-9)
    x.r_friction = (sums[1] / known - Z_FRICTION * p.S_root / math.sqrt(known)) / p.th_friction
    beyond = x.r_friction >= (STANDS if x.hot_friction > 0.5 else 1.0) and x.age >= p.t_start
    x.friction_timer, x.hot_friction = confirm(x.friction_timer, x.hot_friction, beyond, dt, T_FRICTION, RELEASE)
