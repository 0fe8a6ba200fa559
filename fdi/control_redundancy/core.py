"""Stages of `fdi.control_redundancy.control_redundancy` as kernels on its records: air data, row errors, averages,
families, decision.
"""

import math

from actuators.block import kernel
from actuators.constants import G0
from fdi.common.decision import usable
from fdi.control_redundancy.force_model import air_data, contributions, thrust_pair

NR, NF, NH = 6, 16, 8  # most rows, families, fault hypotheses (elevator aileron rudder engines engine_1 ... engine_4)
NC, DELAY = 8, 48  # commands (4 elevators, 2 ailerons, rudder, stabiliser); those kept of each, `stride` ticks apart
TAU_BIAS = 0.15  # lag of what accelerometers have wrong [s]
TAU_VANE = (0.3, 1.0, 3.0)  # and of what the vane reads beyond the angle over the ground: gusts and its error [s]
TAU_ROUGH = 8.0  # memory of the gusts in it [s]
SIDE = 2.0  # times the rms of gusts is how far the lateral velocity may be from that of the vane of sideslip
# thrust leads N1 by some 0.3 s: where N1's share moves faster than 0.007 per second, 0.005 between two lags of it, that
# is worth a threshold of the X row
TAU_SPOOL, TURNING = (0.25, 1.0), 0.005
CALM_S = 1.0  # of learning with engines that hardly turn up or down, each sample by its weight [s]
STEP = 0.01  # of the angle of attack, for the slope of the lift [rad]
BLOCKS = 10  # pieces of the sliding mean
NX = 3 * NR  # averaged: row errors, activities, three commanded effectors, spool speed, pitching
PITCH = 2 * NR + 4  # where the last begins


@kernel
def delayed_commands(x, u, p, dt):
    """Keep every `stride`-th tick's commands; x.cmd follows those of `late` strides ago as fast as a healthy actuator.

    One that is not finite is held. A law that fights gusts near the stall asks more of the rudder than it can follow.
    """
    new = x.phase < 0.5
    head = int(x.head) if new else (int(x.head) + DELAY - 1) % DELAY  # where the newest stands
    given = (u.de_lo, u.de_li, u.de_ri, u.de_ro, u.da_l, u.da_r, u.dr, u.stab)
    for j in range(NC):
        value = given[j]
        if not math.isfinite(value):
            value = x.line[(head + DELAY - 1) % DELAY, j]
        if x.started < 0.5:
            for i in range(DELAY):
                x.line[i, j] = value
        if new:
            x.line[head, j] = value
        move = x.line[(head + DELAY - int(p.late[j])) % DELAY, j] - x.cmd[j]
        if p.rate[j] > 0.0 and x.started > 0.5:
            move = min(max(move, -p.rate[j] * dt), p.rate[j] * dt)
        x.cmd[j] += move
    x.head = (head + 1) % DELAY
    x.phase = (p.stride if new else x.phase) - 1.0


@kernel
def complete(u, p):
    """Return 1.0 when every measurement that the rows need is usable."""
    good = usable(u.n_x, u.n_x_valid) * usable(u.n_y, u.n_y_valid) * usable(u.n_z, u.n_z_valid)
    good *= usable(u.alpha, u.alpha_valid) * usable(u.beta, u.beta_valid)
    good *= usable(u.p, u.p_valid) * usable(u.q, u.q_valid) * usable(u.r, u.r_valid)
    good *= usable(u.cas, u.cas_valid) * usable(u.mach, u.mach_valid) * usable(u.tas, u.tas_valid)
    good *= usable(u.theta, u.theta_valid) * usable(u.phi, u.phi_valid)
    good *= usable(u.mass, u.mass_valid) * usable(u.cg, u.cg_valid)
    good *= usable(u.n1_1, u.n1_1_valid) * usable(u.n1_2, u.n1_2_valid)
    good *= usable(u.n1_3, u.n1_3_valid) * usable(u.n1_4, u.n1_4_valid)
    if p.n_rows > 3.0:
        good *= usable(u.pdot, u.pdot_valid) * usable(u.qdot, u.qdot_valid) * usable(u.rdot, u.rdot_valid)
    return good


@kernel
def _turn(x, p, ca, sa, sb, cb, c, rows, dx):
    """Turn coefficients times qS in wind axes, c (6,), into body forces and moments about the CG, rows (6,)."""
    lift, drag, side = c[0], c[1], c[2]
    rows[0] = -drag * ca * cb - side * ca * sb + lift * sa
    rows[1] = -drag * sb + side * cb
    rows[2] = -drag * sa * cb - side * sa * sb - lift * ca
    roll, pitch, yaw = c[3] * p.span, c[4] * p.chord, c[5] * p.span
    if p.stability_moments > 0.5:
        roll, yaw = roll * ca - yaw * sa, roll * sa + yaw * ca
    rows[3] = roll
    rows[4] = pitch - dx * rows[2]  # the reference point lies dx ahead of the CG
    rows[5] = yaw + dx * rows[1]


@kernel
def row_errors(x, u, p):
    """Fill x.e, measured less computed, forces in g and angular accelerations in rad/s2, x.G and the activities.

    The activity of a row is the sum over its coefficients of |contribution now - learned contribution|: `rel` of it is
    how far coefficients wrong by `rel` each can move the row after the offset is learned.
    """
    ca, sa, cb, sb = math.cos(u.alpha), math.sin(u.alpha), math.cos(u.beta), math.sin(u.beta)
    pressure, qbar = air_data(u.cas, u.mach)
    speed = max(u.tas, 10.0)
    half_c, half_b = 0.5 * p.chord / speed, 0.5 * p.span / speed
    v = x.variable
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
    contributions(p, u.alpha, u.mach, qbar, v, x.part, x.slope)

    force, weight = qbar * p.area, u.mass * G0
    dx = (u.cg - p.cg_ref) * p.chord
    for i in range(6):
        x.c[i] = 0.0
        x.act[i] = 0.0
    for k in range(int(p.n_k)):
        x.part[k] *= force
        axis = int(p.axis[k])
        x.c[axis] += x.part[k]
        x.act[axis] += math.fabs(x.part[k] - x.part_0[k]) if x.learned > 0.5 else math.fabs(x.part[k])
    _turn(x, p, ca, sa, sb, cb, x.c, x.rows, dx)
    al, ad, ay = x.act[0], x.act[1], x.act[2]
    x.act[0], x.act[1], x.act[2] = ad * math.fabs(ca) + al * math.fabs(sa), ay, al * math.fabs(ca) + ad * math.fabs(sa)
    x.act[3], x.act[5] = (x.act[3] + math.fabs(sa) * x.act[5]) * p.span, (x.act[5] + math.fabs(sa) * x.act[3]) * p.span
    x.act[4] = x.act[4] * p.chord + math.fabs(dx) * x.act[2]
    x.act[5] += math.fabs(dx) * x.act[1]

    for e in range(3):  # columns of G: sensitivities to elevator, aileron, rudder
        for i in range(6):
            x.c[i] = x.slope[i, e] * force
        _turn(x, p, ca, sa, sb, cb, x.c, x.column, dx)
        for i in range(6):
            x.G[i, e] = x.column[i]
    idle, mil = thrust_pair(p, u.mach, pressure)
    tx, ty, tz = p.thrust_axis[0], p.thrust_axis[1], p.thrust_axis[2]
    for i in range(6):
        x.G[i, 3] = 0.0
    x.spool, total = 0.0, 0.0
    n1 = (u.n1_1, u.n1_2, u.n1_3, u.n1_4)
    for m in range(4):
        n = min(max((n1[m] - p.n1_idle) / (p.n1_max - p.n1_idle), 0.0), 1.0)
        T = idle + (mil - idle) * n * n
        x.spool += 0.25 * n
        total += T
        rx, ry, rz = p.engine[m, 0] + dx, p.engine[m, 1], p.engine[m, 2]
        x.G[0, 4 + m], x.G[1, 4 + m], x.G[2, 4 + m] = T * tx, T * ty, T * tz
        x.G[3, 4 + m] = T * (ry * tz - rz * ty)
        x.G[4, 4 + m] = T * (rz * tx - rx * tz)
        x.G[5, 4 + m] = T * (rx * ty - ry * tx)
        for i in range(6):
            x.G[i, 3] += x.G[i, 4 + m]
    # while spools turn up or down thrust follows the core, which leads N1: by `rel_spool` times N1's own change
    lead = p.rel_spool * math.fabs(x.spool - x.avg[2 * NR + 3]) if x.avg[2 * NR + 3] > 0.0 else 0.0
    doubt = p.rel_thrust + 4.0 * (mil - idle) * lead * (2.0 * x.spool + lead) / max(total, 1.0)
    for i in range(6):
        x.rows[i] += x.G[i, 3]
        x.act[i] += doubt / max(p.rel, 1e-9) * math.fabs(x.G[i, 3])
    for i in range(3):
        x.rows[i] /= weight
        x.act[i] /= weight
        for h in range(NH):
            x.G[i, h] /= weight
    x.e[0], x.e[1], x.e[2] = u.n_x - x.rows[0], u.n_y - x.rows[1], -u.n_z - x.rows[2]
    if p.n_rows > 3.0:
        _angular(x, u, p)
    else:
        _pitching(x, u, p)


@kernel
def _pitching(x, u, p):
    """Set x.pitch, by how much the pitch rate grew in this tick beyond the computed moment [rad/s2 once averaged], and
    x.pitch_e, the same per elevator: an elevator that is off by so much turns the aircraft."""
    ixx, iyy, izz, ixz = p.gyration2[0], p.gyration2[1], p.gyration2[2], p.gyration2[3]
    gyro = (izz - ixx) * u.p * u.r - ixz * (u.p * u.p - u.r * u.r)
    x.grown = u.q - x.q_last if x.n_learn > 0.5 or x.learned > 0.5 else 0.0
    x.q_last = u.q
    x.pitch = (-x.rows[4] / u.mass - gyro) / iyy
    x.pitch_e = x.G[4, 0] / (u.mass * iyy)


@kernel
def _angular(x, u, p):
    """Turn moments into angular accelerations, I w' = M - w x I w, and compare with the measured ones."""
    g = p.gyration2
    ixx, iyy, izz, ixz = u.mass * g[0], u.mass * g[1], u.mass * g[2], u.mass * g[3]
    det = ixx * izz - ixz * ixz
    L = x.rows[3] + ixz * u.p * u.q + (iyy - izz) * u.q * u.r
    M = x.rows[4] + (izz - ixx) * u.p * u.r - ixz * (u.p * u.p - u.r * u.r)
    N = x.rows[5] - ixz * u.q * u.r + (ixx - iyy) * u.p * u.q
    x.e[3] = u.pdot - (izz * L + ixz * N) / det
    x.e[4] = u.qdot - M / iyy
    x.e[5] = u.rdot - (ixz * L + ixx * N) / det
    for h in range(NH):
        a, b = x.G[3, h], x.G[5, h]
        x.G[3, h], x.G[5, h] = (izz * a + ixz * b) / det, (ixz * a + ixx * b) / det
        x.G[4, h] /= iyy
    x.act[3], x.act[5] = (izz * x.act[3] + ixz * x.act[5]) / det, (ixz * x.act[3] + ixx * x.act[5]) / det
    x.act[4] /= iyy


@kernel
def learn(x, p, dt):
    """Average row errors and contributions over the first `t_learn`; subtract the offset ever after.

    That of the X row is averaged with the less weight the faster engines turn up or down, and for longer where they do
    so all the time: else what thrust leads N1 by would stay in it. An offset larger than coefficients wrong by `rel`
    can make is no model error: it says so in x.suspect.
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
    x.pitch_0 += (x.pitch + x.grown / dt - x.pitch_0) / x.n_learn
    for i in range(NR):
        share = weight / x.calm if i == 0 else 1.0 / x.n_learn
        x.offset[i] += share * (x.e[i] - x.offset[i])
        x.full[i] += (x.act[i] - x.full[i]) / x.n_learn
    for k in range(int(p.n_k)):
        x.part_0[k] += (x.part[k] - x.part_0[k]) / x.n_learn
    if x.n_learn * dt >= p.t_learn - 0.5 * dt and x.calm * dt >= min(CALM_S, 0.5 * p.t_learn):
        x.learned = 1.0
        for i in range(int(p.n_rows)):
            if math.fabs(x.offset[i]) > p.threshold[i] + p.rel * x.full[i]:
                x.suspect = 1.0


@kernel
def accelerometers(x, u, p, dt):
    """Estimate the errors of n_x and n_z [g], x.bias, from the velocity over the ground, whatever the forces are.

    u' = g (n_x - sin theta) + r v - q w and w' = g (cos theta cos phi - n_z) + q u - p v hold without any coefficient.
    A first-order observer of u and w with time constant t_kin has the innovation -g t_kin b for an error b of n_x.
    v is read from the vane of sideslip, which reads gusts as well: x.doubt is what they may make of r v and p v [g].
    """
    if usable(u.alpha_ground, u.alpha_ground_valid) * usable(u.v_ground, u.v_ground_valid) < 0.5:
        x.moving = 0.0
        x.bias[0], x.bias[1] = 0.0, 0.0
        return
    along, down = u.v_ground * math.cos(u.alpha_ground), u.v_ground * math.sin(u.alpha_ground)
    side = u.v_ground * math.sin(u.beta)
    if x.moving < 0.5:
        x.moving, x.velocity[0], x.velocity[1] = 1.0, along, down
        return
    a = G0 * (u.n_x - math.sin(u.theta)) + u.r * side - u.q * down
    b = G0 * (math.cos(u.theta) * math.cos(u.phi) - u.n_z) + u.q * along - u.p * side
    for i in range(2):
        ahead = x.velocity[i] + dt * (a if i == 0 else b)
        e = (along if i == 0 else down) - ahead
        x.velocity[i] = ahead + dt / p.t_kin * e
        raw = -e / (G0 * p.t_kin) if i == 0 else e / (G0 * p.t_kin)
        if x.learned < 0.5:
            x.bias_0[i] += (raw - x.bias_0[i]) / (x.n_learn + 1.0)
        x.bias[i] += (1.0 - math.exp(-dt / TAU_BIAS)) * (raw - x.bias_0[i] - x.bias[i])
        turned = SIDE * math.sqrt(x.rough) * u.v_ground / G0 * math.fabs(u.r if i == 0 else u.p)
        x.doubt[i] += dt / p.t_kin * (turned - x.doubt[i])


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
    if x.learned < 0.5 or x.n_block[int(x.block)] > 1.5:  # once in a block
        return
    _, qbar = air_data(u.cas, u.mach)
    contributions(p, u.alpha + STEP, u.mach, qbar, x.variable, x.part_a, x.slope_a)
    more = 0.0
    for k in range(int(p.n_k)):
        if p.axis[k] < 0.5:
            more += x.part_a[k] * qbar * p.area - x.part[k]
    x.lift = -more / STEP * math.cos(u.alpha) / (u.mass * G0)


@kernel
def accumulate(x, p, dt):
    """Add this tick to the block being filled; return 1.0 when that block is full and BLOCKS of them make the window.

    The window moves by whole blocks of t_mean / BLOCKS, 50 ms for half a second: decisions come that often.
    """
    per = max(p.t_mean / BLOCKS / dt, 1.0)
    b = int(x.block)
    if x.n_block[b] >= per - 1e-6:
        b = (b + 1) % BLOCKS
        x.block = b
        x.n_block[b] = 0.0
        for j in range(NX):
            x.total[b, j] = 0.0
    x.n_block[b] += 1.0
    for j in range(NR):
        x.total[b, j] += x.e[j] - x.offset[j]
        x.total[b, NR + j] += x.act[j]
    x.total[b, 2 * NR] += 0.25 * (x.cmd[0] + x.cmd[1] + x.cmd[2] + x.cmd[3])
    x.total[b, 2 * NR + 1] += 0.5 * (x.cmd[4] + x.cmd[5])
    x.total[b, 2 * NR + 2] += x.cmd[6]
    x.total[b, 2 * NR + 3] += x.spool
    x.total[b, PITCH] += x.pitch + x.grown / dt - x.pitch_0
    x.total[b, PITCH + 1] += x.pitch_e
    return 1.0 if x.n_block[b] >= per - 1e-6 else 0.0


@kernel
def sliding_mean(x, p):
    """Fill x.avg with the mean of the last BLOCKS blocks, or of one without a mean; return 1.0 when all are full."""
    now, keep = int(x.block), BLOCKS if p.t_mean > 0.0 else 1
    full = 1.0
    for j in range(NX):
        x.avg[j] = 0.0
    for k in range(keep):
        b = (now + BLOCKS - k) % BLOCKS
        if x.n_block[b] < 0.5:
            full = 0.0
            continue
        for j in range(NX):
            x.avg[j] += x.total[b, j] / x.n_block[b] / keep
    return full


@kernel
def evaluate_families(x, p):
    """Fill residuals x.res (row units), their thresholds x.tau and sensitivities x.S [Mar10] slides 8 to 10."""
    for f in range(int(p.n_families)):
        base = int(p.base_row[f])
        r, tau = x.avg[base], _row_threshold(x, p, base)
        for h in range(NH):
            x.S[f, h] = x.G[base, h]
        for m in range(int(p.n_pivots[f])):
            k, j = int(p.pivot_row[f, m]), int(p.pivot_input[f, m])
            if math.fabs(x.G[k, j]) < 1e-12:
                x.S[f, 0] = math.nan  # not defined here: it takes no part in the decision
                continue
            ratio = x.G[base, j] / x.G[k, j]
            r -= ratio * x.avg[k]
            tau += math.fabs(ratio) * _row_threshold(x, p, k)
            for h in range(NH):
                x.S[f, h] -= ratio * x.G[k, h]
            x.S[f, j] = 0.0
        x.res[f], x.tau[f] = r, tau
        x.fired[f] = 1.0 if math.fabs(r) >= tau and x.S[f, 0] == x.S[f, 0] else 0.0


@kernel
def _row_threshold(x, p, row):
    return p.threshold[row] + p.rel * x.avg[NR + row]


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
