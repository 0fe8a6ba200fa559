"""Stages of `fdi.control_redundancy.control_redundancy` as kernels on its records: commands, force rows, kinematics of
accelerometers and vane, averages, residual families.
"""

import math

from actuators.block import kernel
from actuators.common.limits import within
from actuators.constants import G0
from fdi.common.decision import delayed, usable
from fdi.control_redundancy.force_model import air_data, contributions, thrust_pair

NR, NF, NH = 3, 16, 4  # force rows X Y Z; most families; fault hypotheses (elevator, aileron, rudder, engines)
NC, DELAY = 8, 48  # commands (4 elevators, 2 ailerons, rudder, stabiliser); those kept of each, `stride` ticks apart
TAU_BIAS = 0.15  # lag of what accelerometers have wrong [s]
TAU_VANE = (0.3, 1.0, 3.0)  # and of what the vane reads beyond the angle over the ground: gusts and its error [s]
TAU_ROUGH = 8.0  # memory of the gusts in it [s]
# thrust leads N1 by some 0.3 s: where N1's share moves faster than 0.007 per second, 0.005 between two lags of it, that
# is worth a threshold of the X row
TAU_SPOOL, TURNING = (0.25, 1.0), 0.005
CALM_S = 1.0  # of learning with engines that hardly turn up or down, each sample by its weight [s]
LIFT_SLOPE = 5.0  # of a transport: what an error of its vane asks of the Z row, roughly [1/rad]
BLOCKS = 10  # pieces of the sliding mean
ACT, COMMAND, SPOOL = NR, 2 * NR, 2 * NR + 3  # where activities, commanded surfaces and spool speed begin in the mean
NX = 2 * NR + 4


@kernel
def delayed_commands(x, u, p, dt):
    """Keep every `stride`-th tick's commands; x.cmd follows those of `late` strides ago as fast as a healthy actuator.

    One that is not finite is held. A law that fights gusts near the stall asks more of the rudder than it can follow.
    """
    if x.phase < 0.5 or x.started < 0.5:
        head = int(x.head)
        commands = (u.de_lo, u.de_li, u.de_ri, u.de_ro, u.da_l, u.da_r, u.dr, u.stab)
        for j in range(NC):
            x.asked[j] = delayed(x.line, head, j, commands[j], p.late[j], x.started < 0.5)
        x.head = (head + 1) % DELAY
        x.phase = p.stride
    x.phase -= 1.0
    for j in range(NC):
        most = p.rate[j] * dt if p.rate[j] > 0.0 and x.started > 0.5 else math.inf
        x.cmd[j] += within(x.asked[j] - x.cmd[j], most)
    x.started = 1.0


@kernel
def complete(u):
    """Return whether every measurement that the rows need is usable."""
    for value, valid in (
        (u.n_x, u.n_x_valid), (u.n_y, u.n_y_valid), (u.n_z, u.n_z_valid), (u.p, u.p_valid), (u.q, u.q_valid),
        (u.r, u.r_valid), (u.theta, u.theta_valid), (u.phi, u.phi_valid), (u.alpha, u.alpha_valid),
        (u.beta, u.beta_valid), (u.cas, u.cas_valid), (u.mach, u.mach_valid), (u.tas, u.tas_valid),
        (u.n1_1, u.n1_1_valid), (u.n1_2, u.n1_2_valid), (u.n1_3, u.n1_3_valid), (u.n1_4, u.n1_4_valid),
        (u.mass, u.mass_valid),
    ):  # fmt: skip
        if usable(value, valid) < 0.5:
            return False
    return True


@kernel
def _variables(x, u, p, ca, sa):
    """Fill x.variable with what the coefficients multiply, in the order of `force_model.VARIABLES`."""
    v, speed = x.variable, max(u.tas, 10.0)
    half_c, half_b = 0.5 * p.chord / speed, 0.5 * p.span / speed
    v[0] = 1.0
    # lift over weight, turned from measured accelerations, stands for the lift in alpha' = q + (g cos cos - L/m) / V
    v[1] = half_c * (u.q + G0 * (math.cos(u.theta) * math.cos(u.phi) - u.n_z * ca + u.n_x * sa) / speed)
    roll, yaw = u.p, u.r
    if p.stability_rates > 0.5:
        roll, yaw = u.p * ca + u.r * sa, u.r * ca - u.p * sa
    v[2], v[3], v[4] = half_b * roll, half_c * u.q, half_b * yaw
    v[5], v[6] = u.beta, u.beta * u.beta
    for j in range(NC):
        v[7 + j] = x.cmd[j]


@kernel
def _body(lift, drag, side, ca, sa, cb, sb):
    """Turn a force in wind axes into body axes, forward right down."""
    return (
        -drag * ca * cb - side * ca * sb + lift * sa,
        -drag * sb + side * cb,
        -drag * sa * cb - side * sa * sb - lift * ca,
    )


@kernel
def row_errors(x, u, p):
    """Fill x.e, measured less computed forces [g], x.G and the activities x.act of the rows.

    The activity of a row is the sum over its coefficients of |contribution now - learned contribution|: `rel` of it is
    how far coefficients wrong by `rel` each can move the row after the offset is learned.
    """
    ca, sa, cb, sb = math.cos(u.alpha), math.sin(u.alpha), math.cos(u.beta), math.sin(u.beta)
    pressure, qbar = air_data(u.cas, u.mach)
    force, weight = qbar * p.area, u.mass * G0
    _variables(x, u, p, ca, sa)
    contributions(p, u.alpha, u.mach, qbar, x.variable, x.part, x.slope)
    x.c[:] = x.act[:] = 0.0
    for k in range(int(p.n_k)):
        x.part[k] *= force
        axis = int(p.axis[k])
        x.c[axis] += x.part[k]
        x.act[axis] += math.fabs(x.part[k] - x.part_0[k]) if x.learned > 0.5 else math.fabs(x.part[k])
    x.rows[0], x.rows[1], x.rows[2] = _body(x.c[0], x.c[1], x.c[2], ca, sa, cb, sb)
    lift, drag, side = x.act[0], x.act[1], x.act[2]
    x.act[0] = drag * math.fabs(ca) + lift * math.fabs(sa)
    x.act[1], x.act[2] = side, lift * math.fabs(ca) + drag * math.fabs(sa)
    for e in range(3):  # columns of G: sensitivities to elevator, aileron, rudder
        lift, drag, side = x.slope[0, e] * force, x.slope[1, e] * force, x.slope[2, e] * force
        x.G[0, e], x.G[1, e], x.G[2, e] = _body(lift, drag, side, ca, sa, cb, sb)
    doubt = _thrust(x, u, p, pressure)
    for i in range(NR):
        x.rows[i] += x.G[i, 3]
        x.act[i] += doubt / max(p.rel, 1e-9) * math.fabs(x.G[i, 3])
        x.rows[i] /= weight
        x.act[i] /= weight
        for h in range(NH):
            x.G[i, h] /= weight
    x.e[0], x.e[1], x.e[2] = u.n_x - x.rows[0], u.n_y - x.rows[1], -u.n_z - x.rows[2]


@kernel
def _thrust(x, u, p, pressure):
    """Fill the thrust column of x.G [N] and x.spool; return how uncertain thrust is, as a fraction."""
    idle, mil = thrust_pair(p, u.mach, pressure)
    x.spool = 0.0
    x.G[:, 3] = 0.0
    n1, total = (u.n1_1, u.n1_2, u.n1_3, u.n1_4), 0.0
    for m in range(4):
        n = min(max((n1[m] - p.n1_idle) / (p.n1_max - p.n1_idle), 0.0), 1.0)
        T = idle + (mil - idle) * n * n
        x.spool += 0.25 * n
        total += T
        for i in range(NR):
            x.G[i, 3] += T * p.thrust_axis[i]
    # while spools turn up or down thrust follows the core, which leads N1: by `rel_spool` times N1's own change
    lead = p.rel_spool * math.fabs(x.spool - x.avg[SPOOL]) if x.avg[SPOOL] > 0.0 else 0.0
    return p.rel_thrust + 4.0 * (mil - idle) * lead * (2.0 * x.spool + lead) / max(total, 1.0)


@kernel
def learn(x, p, dt):
    """Average row errors and contributions over the first `t_learn`; the offset is subtracted ever after.

    That of the X row is averaged with the less weight the faster engines turn up or down, and for longer where they do
    so all the time: else what thrust leads N1 by would stay in it.
    """
    if x.learned > 0.5 or p.t_learn <= 0.0:
        x.learned = 1.0
        return
    x.n_learn += 1.0
    for i in range(2):
        x.turning[i] += (1.0 - math.exp(-dt / TAU_SPOOL[i]) if x.n_learn > 1.5 else 1.0) * (x.spool - x.turning[i])
    turning = (x.turning[0] - x.turning[1]) / TURNING
    weight = 1.0 / (1.0 + turning * turning)
    x.calm += weight
    for i in range(NR):
        x.offset[i] += (weight / x.calm if i == 0 else 1.0 / x.n_learn) * (x.e[i] - x.offset[i])
    for k in range(int(p.n_k)):
        x.part_0[k] += (x.part[k] - x.part_0[k]) / x.n_learn
    if x.n_learn * dt >= p.t_learn - 0.5 * dt and x.calm * dt >= min(CALM_S, 0.5 * p.t_learn):
        x.learned = 1.0


@kernel
def accelerometers(x, u, p, dt):
    """Estimate the errors of n_x and n_z [g], x.bias, from the velocity over the ground, whatever the forces are.

    u' = g (n_x - sin theta) + r v - q w and w' = g (cos theta cos phi - n_z) + q u - p v hold without any coefficient.
    A first-order observer of u and w with time constant t_kin has the innovation -g t_kin b for an error b of n_x.
    """
    if usable(u.alpha_ground, u.alpha_ground_valid) * usable(u.v_ground, u.v_ground_valid) < 0.5:
        x.moving = 0.0
        x.bias[:] = 0.0
        return
    along, down = u.v_ground * math.cos(u.alpha_ground), u.v_ground * math.sin(u.alpha_ground)
    side = u.v_ground * math.sin(u.beta)
    if x.moving < 0.5:
        x.moving, x.velocity[0], x.velocity[1] = 1.0, along, down
        return
    measured = (along, down)
    rate = (
        G0 * (u.n_x - math.sin(u.theta)) + u.r * side - u.q * down,
        G0 * (math.cos(u.theta) * math.cos(u.phi) - u.n_z) + u.q * along - u.p * side,
    )
    for i in range(2):
        ahead = x.velocity[i] + dt * rate[i]
        e = measured[i] - ahead
        x.velocity[i] = ahead + dt / p.t_kin * e
        raw = (-e if i == 0 else e) / (G0 * p.t_kin)
        if x.learned < 0.5:
            x.bias_0[i] += (raw - x.bias_0[i]) / (x.n_learn + 1.0)
        x.bias[i] += (1.0 - math.exp(-dt / TAU_BIAS)) * (raw - x.bias_0[i] - x.bias[i])


@kernel
def vane(x, u, p, dt):
    """Keep x.vane, angle of attack less that over the ground, through lags [rad], and x.lift, the Z row per rad [g]."""
    if usable(u.alpha_ground, u.alpha_ground_valid) < 0.5:
        return
    d = u.alpha - u.alpha_ground
    if x.learned < 0.5:
        x.vane_mean += (d - x.vane_mean) / (x.n_learn + 1.0)
    d -= x.vane_mean
    for i in range(3):
        x.vane[i] += (1.0 - math.exp(-dt / TAU_VANE[i])) * (d - x.vane[i])
    rough = x.vane[0] - x.vane[2]
    x.rough += (1.0 - math.exp(-dt / TAU_ROUGH)) * (rough * rough - x.rough)
    _, qbar = air_data(u.cas, u.mach)
    x.lift = -LIFT_SLOPE * qbar * p.area / (u.mass * G0)


@kernel
def average(x, p, dt):
    """Add this tick to the block being filled; where that is full, fill x.avg and return whether it may be judged.

    The window moves by whole blocks of t_mean / BLOCKS, 50 ms for half a second: decisions come that often. x.avg is
    the mean of the last BLOCKS, or of one without a mean.
    """
    per, keep = max(math.ceil(p.t_mean / BLOCKS / dt - 1e-6), 1), BLOCKS if p.t_mean > 0.0 else 1
    b = int(x.block)
    if x.in_block < 0.5:
        x.total[b, :] = 0.0
    x.in_block += 1.0
    for j in range(NR):
        x.total[b, j] += x.e[j] - x.offset[j]
        x.total[b, ACT + j] += x.act[j]
    x.total[b, COMMAND] += 0.25 * (x.cmd[0] + x.cmd[1] + x.cmd[2] + x.cmd[3])
    x.total[b, COMMAND + 1] += 0.5 * (x.cmd[4] + x.cmd[5])
    x.total[b, COMMAND + 2] += x.cmd[6]
    x.total[b, SPOOL] += x.spool
    if x.in_block < per:
        return False
    x.in_block, x.block, x.blocks = 0.0, (b + 1) % BLOCKS, min(x.blocks + 1.0, BLOCKS)
    x.avg[:] = 0.0
    for k in range(min(keep, int(x.blocks))):
        for j in range(NX):
            x.avg[j] += x.total[(b + BLOCKS - k) % BLOCKS, j] / per / keep
    return x.blocks >= keep


@kernel
def row_threshold(x, p, row):
    """Return what the mean error of a row may be [g]."""
    return p.threshold[row] + p.rel * x.avg[ACT + row]


@kernel
def evaluate_families(x, p):
    """Fill residuals x.res (row units), their thresholds x.tau and sensitivities x.S [Mar10] slides 8 to 10."""
    for f in range(int(p.n_families)):
        base = int(p.base_row[f])
        r, tau = x.avg[base], row_threshold(x, p, base)
        for h in range(NH):
            x.S[f, h] = x.G[base, h]
        for m in range(int(p.n_pivots[f])):
            k, j = int(p.pivot_row[f, m]), int(p.pivot_input[f, m])
            # a row that hardly knows the input it serves for leaves a family that says what this row says
            ratio = x.G[base, j] / math.copysign(max(math.fabs(x.G[k, j]), 1e-12), x.G[k, j])
            r -= ratio * x.avg[k]
            tau += math.fabs(ratio) * row_threshold(x, p, k)
            for h in range(NH):
                x.S[f, h] -= ratio * x.G[k, h]
            x.S[f, j] = 0.0
        x.res[f], x.tau[f] = r, tau
        x.fired[f] = 1.0 if math.fabs(r) >= tau else 0.0


@kernel
def fit_hypothesis(x, p, h):
    """Return (u_a - u_c of effector h by weighted least squares, worst |r - S f| / tau) over the families in use.

    In use are the families that no declared effector moves: this is how a later fault is found behind an earlier one.
    """
    top, bottom = 0.0, 0.0
    for f in range(int(p.n_families)):
        if x.used[f] > 0.5:
            w = x.S[f, h] / (x.tau[f] * x.tau[f])
            top += w * x.res[f]
            bottom += w * x.S[f, h]
    if bottom <= 0.0:
        return 0.0, math.inf
    value, worst = top / bottom, 0.0
    for f in range(int(p.n_families)):
        if x.used[f] > 0.5:
            worst = max(worst, math.fabs(x.res[f] - x.S[f, h] * value) / x.tau[f])
    return value, worst
