"""The rows of `fdi.kinematic.kinematic` as kernels on its records: readings in, residuals and their thresholds out."""

import math

from actuators.block import kernel
from actuators.constants import G0
from fdi.common.decision import usable
from fdi.kinematic import signatures as table
from fdi.kinematic.signatures import CLIMB, NR, NS, SPEED, TURN
from fdi.kinematic.wind import blow, plane

SPREAD = 3.0  # half of what lateral velocity may be off by, over the rms of lateral gusts: half of `side_gust`
EARTH = 6.356766e6  # radius that makes a geometric altitude one of the standard atmosphere [m]

WORN = 1.25  # times it thresholds hold: they are trained at 1.2, and what is learned of it in 6 s is within 4 %


@kernel
def read(x, u, flies):
    """Copy the readings and their flags, in the order of SENSORS; one that is out repeats its last value, as all do
    unless the aircraft `flies`."""
    for i, (value, valid) in enumerate((
        (u.p, u.p_valid), (u.q, u.q_valid), (u.r, u.r_valid), (u.phi, u.phi_valid), (u.theta, u.theta_valid),
        (u.psi, u.psi_valid), (u.n_x, u.n_x_valid), (u.n_z, u.n_z_valid), (u.hdot, u.hdot_valid),
        (u.h_inertial, u.h_inertial_valid), (u.h_baro, u.h_baro_valid), (u.tas, u.tas_valid), (u.cas, u.cas_valid),
        (u.mach, u.mach_valid), (u.alpha_ground, u.alpha_ground_valid), (u.v_ground, u.v_ground_valid),
        (u.alpha, u.alpha_valid), (u.beta, u.beta_valid), (u.n_y, u.n_y_valid),
    )):  # fmt: skip
        x.ok[i] = usable(value, valid) if flies else 0.0
        x.ticks[i] = min(x.ticks[i] + 1.0, 3.0) if x.ok[i] > 0.5 else 0.0
        if x.ok[i] > 0.5:
            x.y_2[i], x.y_1[i], x.y[i] = x.y_1[i], x.y[i], value


@kernel
def _integrated(x, p, row, value, rate, live, dt, turn):
    """Advance a row that integrates: raw = value - model, x_hat' = rate + (x - x_hat) / tau; `turn` wraps at pi."""
    x.live[row] = live
    if live < 0.5 or x.seen[row] < 0.5:
        x.model[row], x.raw[row], x.rate[row] = value, 0.0, rate
        return
    ahead = x.model[row] + dt * 0.5 * (x.rate[row] + rate)
    x.rate[row] = rate
    e = value - ahead
    if turn > 0.5:
        e = math.atan2(math.sin(e), math.cos(e))
    x.raw[row] = e
    x.model[row] = ahead + dt / p.tau * e


@kernel
def compare(x, p, dt):
    """Fill x.raw, x.live and x.limit from the readings."""
    y, ok = x.y, x.ok
    roll, pitch, yaw, phi, theta = y[0], y[1], y[2], y[3], y[4]
    sp, cp, st, ct = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
    body = ok[0] * ok[1] * ok[2]
    rates = body * ok[3] * ok[4]
    turning = pitch * sp + yaw * cp
    _integrated(x, p, table.PHI, phi, roll + st / ct * turning, rates, dt, 1.0)
    _integrated(x, p, table.THETA, theta, pitch * cp - yaw * sp, rates, dt, 0.0)
    _integrated(x, p, table.PSI, y[5], turning / ct, rates * ok[5], dt, 1.0)
    blow(x, p, dt)
    u, w = plane(x)
    v = x.lateral_ground  # gusts are in it, and `side` allows for them
    path = ok[14] * ok[15] * ok[3] * ok[4]
    x.live[CLIMB] = path * ok[8]
    steep = u * st - w * cp * ct
    rise = steep - v * sp * ct
    x.raw[CLIMB] = y[8] - rise
    _integrated(x, p, TURN, w, pitch * u - roll * v + G0 * (ct * cp - y[7]), path * body * ok[7], dt, 0.0)
    _integrated(x, p, SPEED, y[15], _along(y, u, v, w, rise), path * ok[6] * ok[7], dt, 0.0)
    _integrated(x, p, table.HEIGHT, y[9], y[8], ok[8] * ok[9], dt, 0.0)
    _air_data(x)
    _lateral(x, p, dt, steep)
    _through_air(x, p, dt, turning / ct)


@kernel
def _along(y, u, v, w, rise):
    """Return the acceleration along a velocity of which `rise` climbs [m/s2]: no rate of rotation is in it."""
    return G0 * (y[6] * u + y[18] * v - y[7] * w - rise) / max(math.sqrt(u * u + v * v + w * w), 1.0)


@kernel
def _through_air(x, p, dt, heading_rate):
    """Fill x.strayed: how far roll, heading, speed over the ground, and of the velocity through the air what is level
    and across the heading, and its size, are from their integrals since the first row fired; and x.expected, how far
    the last two would be if the sensor of a pair that they need were the wrong one. A steady wind and a roll rate are
    in neither of them."""
    y, ok = x.y, x.ok
    sp, cp, st, ct = math.sin(y[3]), math.cos(y[3]), math.sin(y[4]), math.cos(y[4])
    plane = y[11] * math.cos(y[17])
    u, v, w = plane * math.cos(y[16]), y[11] * math.sin(y[17]), plane * math.sin(y[16])
    down = sp * v + cp * w
    ahead = ct * u + st * down
    across = G0 * (cp * y[18] + sp * y[7]) - heading_rate * ahead
    values = (y[3], y[5], y[15], cp * v - sp * w, y[11])
    rates = (x.rate[table.PHI], x.rate[table.PSI], x.rate[SPEED], across, _along(y, u, v, w, st * u - ct * down))
    live = ok[11] * ok[16] * ok[17] * ok[18] * x.live[table.PSI] * x.live[TURN] * x.live[SPEED]
    follow = 0.0 if x.since > 0.0 else dt / p.tau
    for k in range(5):
        ahead_of = x.integral[k] + dt * rates[k] if live > 0.5 else values[k]
        e = values[k] - ahead_of
        x.strayed[k] = math.atan2(math.sin(e), math.cos(e)) if k == 1 else e
        x.integral[k] = ahead_of + follow * x.strayed[k]
    x.rolled = x.rolled + dt * x.strayed[0] if live * x.since > 0.0 else 0.0
    x.expected[1], x.expected[2], x.expected[3] = -G0 * x.rolled, -ahead * x.strayed[1], x.strayed[2]


@kernel
def _air_data(x):
    """Fill the rows that integrate nothing: speed of sound, impact pressure, barometric altitude."""
    y, ok = x.y, x.ok
    x.live[table.SOUND] = ok[11] * ok[13] * ok[9]
    kelvin = kelvin_at(y[9] / (1.0 + y[9] / EARTH))
    x.raw[table.SOUND] = y[11] - y[13] * math.sqrt(1.4 * 287.05287 * kelvin)
    x.live[table.IMPACT] = ok[12] * ok[13] * ok[10]
    cas, mach = 0.2 * (y[12] / 340.294) * (y[12] / 340.294), 0.2 * y[13] * y[13]
    impact = math.exp(3.5 * math.log(1.0 + cas)) - 1.0
    static = math.exp(5.2558797 * math.log(kelvin_at(y[10]) / 288.15))
    if y[10] > 11000.0:
        static *= math.exp((11000.0 - y[10]) / 6341.62)
    of_mach = max(static * (math.exp(3.5 * math.log(1.0 + mach)) - 1.0), 1e-12)  # 0 until Mach is read
    x.raw[table.IMPACT] = impact / of_mach - 1.0
    x.live[table.BARO] = ok[9] * ok[10]
    x.raw[table.BARO] = y[10] - y[9]


@kernel
def _lateral(x, p, dt, steep):
    """Set x.limit, which grows with gusts from the side, and x.rough, their rms as the vane of sideslip has it.

    The rows take the lateral velocity from sideslip and wind: in a bank, rolling and yawing gusts show in them. `steep`
    is the rate of climb per speed along the plane of symmetry [m/s].
    """
    y = x.y
    if x.ok[17] > 0.5:
        c = 1.0 - math.exp(-dt / p.tau_gust) if x.age > 0.0 else 1.0
        x.sideslip += c * (y[17] - x.sideslip)
        x.square += c * (y[17] * y[17] - x.square)
        x.rough = y[15] * math.sqrt(max(x.square - x.sideslip * x.sideslip, 0.0))
    fade, bank = dt / p.tau, math.fabs(math.sin(y[3]))
    # in a climb what of the speed over the ground is lateral does not climb: v^2 / (2 V), v and an error of it alike
    side = math.fabs(x.lateral_ground) + SPREAD * x.rough
    visible = bank + math.fabs(steep) * side / max(y[15] * y[15], 1.0)
    x.lateral[CLIMB] += (1.0 - math.exp(-dt / p.tau_r)) * (visible - x.lateral[CLIMB])  # as its residual comes
    x.lateral[TURN] += fade * (p.tau * math.fabs(y[0]) - x.lateral[TURN])
    x.lateral[SPEED] += fade * (p.tau * G0 * bank / max(y[15], 1.0) - x.lateral[SPEED])
    for i in range(NR):
        x.limit[i] = x.grown[i] * p.threshold[i] + p.gust[i] * x.rough
        x.limit[i] += x.lateral[i] * (p.side[i] * y[15] + p.side_gust[i] * x.rough)
    for i in range(3):
        x.limit[CLIMB + i] += x.doubt[i]


@kernel
def weigh(x):
    """Set by how much more noise than specified the readings of each row have, as learned: x.grown."""
    for i in range(NR):
        most = 1.0
        for s in range(NS):
            if table.READ_BY[i, s] > 0.5:
                sigma = WORN * table.SIGMA[s]
                most = max(most, x.level[s] / (6.0 * sigma * sigma))
        x.grown[i] = math.sqrt(most)


@kernel
def kelvin_at(h):
    """Return the temperature of the standard atmosphere at `h` [m], up to 20 km [K]."""
    return max(288.15 - 0.0065 * h, 216.65)
