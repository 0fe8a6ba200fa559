"""What of f_hat is the airframe's and no fault: learned, since an estimator of one flight point flies at all of them.

Away from the point of its design the coefficients of the pitching moment are others: with the model's 0

    M_de0 f_hat = M_de f + (M_a - M_a0) alpha + (M_q - M_q0) q + (M_de - M_de0) de,

each through the lag of f_hat, so that f_hat = (M_de / M_de0) f + theta' phi with phi = [alpha, q, de], deviations from
trim, de the healthy elevator. theta has mean `prior` and deviations `spread` over training flights. From the first
`t_learn` of motion beyond its slow part it becomes the regularised least squares of f_hat on phi, with covariance P:

    P = (diag(spread)^-2 + sum phi phi' dt / noise)^-1,  theta = prior + P sum phi (f_hat - prior' phi) dt / noise

and f_hat - theta' phi is judged. phi' P phi says what it may be wrong by: much in a manoeuvre after a start in still
air, little in gusts, which teach. Then theta stays: a fault that comes later is not learned, one that is there before
is, in part. An extension: [Sun13] knows one point, and takes E for what its model has wrong.
"""

import math

from actuators.block import kernel
from actuators.constants import G0

M = 4  # terms: angle of attack, pitch rate, elevator, rate of the angle of attack
# of a turn, V / g (q - theta') = sin(phi) tan(phi): that of 40 deg of bank. At 60 deg what is left in f_hat at 0.5 to
# 1 Hz is twice that of level flight in the same air
TURN = 0.54
TAU_TURN = 2.0  # of its slow part [s]

PARAMS = [
    ("t_learn", "f8", "s"),  # for so long the correction is learned, 0 for none
    ("omega_f", "f8", "rad/s"),  # lag of f_hat
    ("tau_tail", "f8", "s"),  # and beside it that of the rate: until air that the wing met has reached the tail
    ("own", "f8", (M,)),  # terms of the model over M_de0: -, s, -, s
    ("prior", "f8", (M,)),  # mean of theta: -, s, -, s
    ("spread", "f8", (M,)),  # and standard deviations
    ("noise", "f8", "rad2 s"),  # variance of f_hat in health times the time for which it is alike
    ("tau_stir", "f8", "s"),  # memory of the rms of the angle of attack
    ("alpha_max", "f8", "rad"),  # angle of attack beyond which moments are not linear
    ("t_recover", "f8", "s"),  # nothing is said for so long after it was beyond
]
STATE = [
    ("lagged", "f8", (M + 1,)),  # phi; last the elevator before the lag of f_hat [rad, rad/s]
    ("low", "f8", (M + 1,)),  # slow part of phi and of f_hat
    ("gain", "f8", (M,)),  # of a sample
    ("taught", "f8", "s"),  # time of learning
    ("theta", "f8", (M,)),  # at the speed where it was learned
    ("speed", "f8", "m/s"),  # which was this
    ("P", "f8", (M, M)),
    ("doubt", "f8", "rad2"),  # twice the mean of phi' P phi: a squared amplitude
    ("stir", "f8", "rad2"),  # mean square of the angle of attack less its slow part
    ("alpha_0", "f8", "rad"),  # slow part of the angle of attack where theta was learned
    ("away", "f8", "rad"),  # distance from it
    ("steep", "f8", "s"),  # time for which the angle of attack still counts as beyond alpha_max
    ("pitch", "f8", "rad"),  # slow parts of attitude and pitch rate
    ("rate", "f8", "rad/s"),
    ("banked", "f8", "s"),  # time for which a turn still counts as beyond TURN
]


@kernel
def correct(x, p, dt):
    """Learn, and take theta' phi out of x.free[0]; x.y, x.u_late of this sample."""
    _follow(x, p, dt)
    f, s = x.f[0], 1.0 - math.exp(-dt / p.tau_slow)
    tas = x.y[0] + x.y0[0] + p.y_trim[0]
    x.steep = max(x.steep - dt, 0.0)
    if p.unit * (x.y0[1] + p.y_trim[1]) + max(x.lagged[0], x.low[0]) > p.alpha_max:
        x.steep = p.t_recover
    _turn(x, p, tas, dt)
    x.low[M] = x.low[M] + s * (f - x.low[M]) if x.age > 0.0 else f
    if x.taught == 0.0:
        for i in range(M):
            x.theta[i] = p.prior[i]
            for j in range(M):
                x.P[i, j] = p.spread[i] * p.spread[i] if i == j else 0.0
    if x.age >= p.t_settle and x.taught < p.t_learn and x.steep == 0.0 and x.banked == 0.0:
        x.taught += dt
        x.speed += (tas - x.speed) * dt / x.taught
        _learn(x, p, f - x.low[M], dt)
    if x.taught < p.t_learn:
        x.alpha_0 = x.low[0]
    x.away = math.fabs(x.low[0] - x.alpha_0)
    size, e, faster = 0.0, 1.0 - math.exp(-dt / p.tau_energy), tas / x.speed if x.taught > 0.0 else 1.0
    for i in range(M):
        grown = faster * faster if i % 2 == 0 else faster  # stiffness and control go with V^2, damping with V
        x.free[0] -= ((p.own[i] + x.theta[i]) * grown - p.own[i]) * x.lagged[i]
        for j in range(M):
            size += (x.lagged[i] - x.low[i]) * x.P[i, j] * (x.lagged[j] - x.low[j])
    x.doubt += e * (2.0 * max(size, 0.0) - x.doubt)
    x.stir += (1.0 - math.exp(-dt / p.tau_stir)) * ((x.lagged[0] - x.low[0]) * (x.lagged[0] - x.low[0]) - x.stir)


@kernel
def _follow(x, p, dt):
    """Advance phi and its slow part; a (re)start begins at the sample."""
    new = (p.unit * x.y[1], p.unit * x.y[2], p.unit * x.u_late[0], 0.0)
    if x.age == 0.0:
        for i in range(M):
            x.lagged[i] = x.low[i] = new[i]
        x.lagged[M] = new[2]
        return
    x.lagged[M] += (1.0 - math.exp(-p.act_a[0] * dt)) * (new[2] - x.lagged[M])
    c, s = 1.0 - math.exp(-p.omega_f * dt), 1.0 - math.exp(-dt / p.tau_slow)
    before = x.lagged[0]
    for i in range(M - 1):
        to = x.lagged[M] if i == 2 else new[i]
        x.lagged[i] += c * (to - x.lagged[i])
    x.lagged[3] += (1.0 - math.exp(-dt / p.tau_tail)) * ((x.lagged[0] - before) / dt - x.lagged[3])
    for i in range(M):
        x.low[i] += s * (x.lagged[i] - x.low[i])


@kernel
def _turn(x, p, tas, dt):
    """Set x.banked in a steep turn: there pitch rate is not the rate of attitude, whatever the elevators do."""
    q, theta = p.unit * (x.y[2] + x.y0[2] + p.y_trim[2]), p.unit * x.y[3]
    if x.age == 0.0:
        x.pitch, x.rate = theta, q
    s = 1.0 - math.exp(-dt / TAU_TURN)
    x.pitch += s * (theta - x.pitch)
    x.rate += s * (q - x.rate)
    turning = (x.rate - (theta - x.pitch) / TAU_TURN) * tas / G0
    x.banked = p.t_recover if turning > TURN else max(x.banked - dt, 0.0)


@kernel
def _learn(x, p, e, dt):
    """Take a sample into theta and P, recursively; e is f_hat less its slow part."""
    size = p.noise / dt
    for i in range(M):
        x.gain[i] = 0.0
        for j in range(M):
            x.gain[i] += x.P[i, j] * (x.lagged[j] - x.low[j])
    for i in range(M):
        size += x.gain[i] * (x.lagged[i] - x.low[i])
        e -= x.theta[i] * (x.lagged[i] - x.low[i])
    for i in range(M):
        x.theta[i] += x.gain[i] * e / size
        for j in range(M):
            x.P[i, j] -= x.gain[i] * x.gain[j] / size
