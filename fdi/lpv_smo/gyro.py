"""Consistency of pitch rate and attitude: kinematics of one angle, without forces.

    theta' = q cos phi - r sin phi

A first-order observer of theta has, for an error b of q, the innovation -TAU_GYRO b cos phi. Who takes q for true takes
b for an error of n_z, V b / g of it, or of the angle of attack: while it stands none of these is blamed.
"""

import math

from actuators.block import kernel
from actuators.constants import RAD_PER_DEG
from fdi.common.decision import usable

TAU_GYRO, TAU_LAG = 0.5, 0.15  # time constant of the observer of theta, lag of the error of q that it finds [s]
# twelve sigma of that error: 0.02 deg of theta and 0.02 deg/s of q and r in samples of 5 ms make 0.008 deg/s
OFF = 0.1 * RAD_PER_DEG
T_GYRO = 2.0  # an error is held to be there for so long after it was last found: what it disturbed rings on [s]

STATE = [
    ("gyro_theta", "f8", "rad"),  # model of theta
    ("gyro_rate", "f8", "rad/s"),  # its rate by the gyros at the last tick
    ("gyro_live", "f8", "-"),  # 1 once it has started
    ("gyro_error", "f8", "rad/s"),  # of q by theta
    ("gyro_off", "f8", "s"),  # for so long still q is held to be wrong, or theta
]


@kernel
def compare(x, u, dt):
    """Advance x.gyro_error and x.gyro_off by the readings theta, phi, q, r of `u`; without one of them start anew."""
    x.gyro_off = max(x.gyro_off - dt, 0.0)
    if (usable(u.theta, u.theta_valid) * usable(u.phi, u.phi_valid)
            * usable(u.q, u.q_valid) * usable(u.r, u.r_valid)) < 0.5:  # fmt: skip
        x.gyro_live = 0.0
        return
    rate = u.q * math.cos(u.phi) - u.r * math.sin(u.phi)
    if x.gyro_live < 0.5:
        x.gyro_live, x.gyro_theta, x.gyro_error = 1.0, u.theta, 0.0
    else:
        ahead = x.gyro_theta + 0.5 * dt * (rate + x.gyro_rate)
        e = u.theta - ahead
        x.gyro_theta = ahead + dt / TAU_GYRO * e
        x.gyro_error += (1.0 - math.exp(-dt / TAU_LAG)) * (-e / TAU_GYRO - x.gyro_error)
    x.gyro_rate = rate
    if math.fabs(x.gyro_error) > OFF:
        x.gyro_off = T_GYRO
