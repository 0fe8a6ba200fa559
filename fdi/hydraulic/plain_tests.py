"""Plain tests of a hydraulic actuator, for what a filter that is linear over a tick does not hold.

| test | statistic | because |
|---|---|---|
| pair | rod - arm surface - rigging, each against the valve's own motion | a linkage is rigid (`fdi.common.decision`) |
| jam | load beyond the hinge-moment model, the rod at rest | a stop takes any load |
| runaway | w = f_hat + u: the valve has opened with the input fault, stays, the servo closes it | a sine turns |
| frozen | FROZEN equal samples in a row of a sensor with noise | noise does not repeat itself |
| gap | rod less surface has two levels, +-h, and nothing between | a loose surface leans on one flank or on the other |

A sensor with a bias keeps to one side of a gap. One that swings has no level: of a sine (|d| - h)^2 has 1 - 8 / pi^2 =
0.19 of d^2, of noise more. The gap may be of any size, and it needs no onset; while the load keeps its side a gap and a
bias are the same.
"""

import math

from actuators.block import kernel
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import opening, stiffness
from fdi.common import decision
from fdi.common.decision import confirm, usable
from fdi.hydraulic import two_stage_ekf as two_stage
from fdi.isolation import filter

# equal samples in a row, which a sensor has not that changes at such a share of its samples: a coarse quantum does not
FROZEN, CHANGES, OF_LATE = 20.0, 0.7, 0.01  # the share is lagged by 100 samples
WITHOUT_ROD, WITHOUT_PRESSURE = 1.6, 4.0  # noise of f_hat on the surface sensor; on the hinge-moment model
FLAT, FLAT_S, FLAT_TAU = 0.12, 0.2, 0.1  # a valve that stands open keeps this near its lagged opening [-], for [s]
NOISE = 0.4  # ... and this of the threshold of an input fault, which noise seldom passes
LEFT = 0.45  # share of its opening below which it stands open no more
FIRST = 0.15  # share of its opening by which it may have changed since it had begun: a slow sine turns
FIRST_S = 0.1  # after which an opening has begun, and after the onset of the input fault: crests come later
MISREAD_S = 0.1  # flow that an excess of pressure takes is missing for [s]
UNLEARNED = 4.0  # standard deviations of the valve's gain and of the positions' age as the flight has taught them
# an input fault beyond its threshold counts in proportion up to this: against the servo a runaway comes and goes
RUN_WEIGHT = 1.25
SWINGS = 0.5 * (1.0 - 8.0 / (math.pi * math.pi))  # share of d^2 that two levels may leave: half of what a sine has left
NO_LEVELS = 1.5  # times SWINGS, from which on d has no two levels
SIDE_S = 0.1  # on either side, three lags of d [s]

PARAMS = [
    *decision.PAIR_PARAMS,
    ("lag_omega", "f8", "rad/s"),  # f_hat follows f as a second-order lag: corner
    ("lag_zeta", "f8", "-"),  # damping
    ("lag_ticks", "f8", "-"),  # dead time beyond the first tick
    ("run_tau", "f8", "s"),  # lag of the estimates that the runaway and jam tests use
    ("run_threshold", "f8", "-"),  # input fault
    ("run_share", "f8"),  # ... plus this share of the valve command
    ("run_confirm", "f8", "s"),
    ("jam_threshold", "f8", "-"),  # load beyond the model, over the stall force
    ("jam_share", "f8"),  # ... plus this share of the model's load
    ("jam_still", "f8", "m/s"),  # rod velocity below which the surface is still
    ("jam_confirm", "f8", "s"),
    ("t_release", "f8", "s"),  # an alarm outlives its cause by this
]
STATE = [
    *decision.PAIR_STATE,
    ("gap_s", "f8", (2,), "s"),  # time since the alarm that d was below and above zero
    ("gap_d", "f8", (2,), "m s"),  # sums of its size over these
    ("gap_dd", "f8", "m^2 s"),  # of its square
    ("loose", "f8", "-"),  # 1 while they show two levels and nothing between
    ("noise_scale", "f8", "-"),  # noise of f_hat over that with all sensors
    ("drive", "f8", "-"),  # valve command behind the filter's own lag, so that f_hat + drive is what the valve did
    ("drive_d", "f8", "1/s"),  # its derivative
    ("load_lag", "f8", "-"),  # pressure behind the same lag
    ("load_d", "f8", "1/s"),  # its derivative
    ("f_slow", "f8", "-"),  # lagged input fault, less what learned errors leave in it
    ("u_slow", "f8", "-"),  # lagged valve command
    ("w_flat", "f8", "-"),  # valve opening that w keeps to
    ("w_first", "f8", "-"),  # the same FIRST_S after it began: before, the lags of f_slow let it still grow
    ("w_flat_s", "f8", "s"),  # for which it has
    ("run_timer", "f8", "s"),
    ("run", "f8", "-"),  # 1 while an input fault is declared
    ("run_s", "f8", "s"),  # for which it has been
    ("stands_open", "f8", "-"),  # opening of a valve that has run away, 0: it has not
    ("q_fast", "f8", "m"),  # rod, lagged once
    ("q_slow", "f8", "m"),  # rod, lagged more
    ("excess", "f8", "-"),  # lagged load beyond the model
    ("excess_lag", "f8", "-"),  # lagged more
    ("f_lag", "f8", "-"),  # lagged f_slow
    ("jam_timer", "f8", "s"),
    ("jam", "f8", "-"),  # 1 while a jam is declared
    ("jam_most", "f8", "-"),  # largest load beyond the model since
    ("jam_s", "f8", "s"),  # time since
    ("misread_timer", "f8", "s"),
    ("misread", "f8", "-"),  # 1 while the load beyond the model is the pressure sensor's
    ("same", "f8", (3,)),  # equal samples in a row, of rod, surface and pressure
    ("changes", "f8", (3,)),  # lagged share of samples that differ from the one before
    ("last_y", "f8", (3,)),
    ("frozen", "f8", "-"),  # 1 rod, 2 surface, 3 pressure sensor repeats its last value
    ("r_run", "f8", "-"),  # input fault over its threshold
    ("r_jam", "f8", "-"),  # load excess over its threshold
]


@kernel
def pair(x, u, rod, surface, p, dt):
    """Compare rod and surface, and each with the rod velocity that valve and pressure alone imply. [Lu17] (4)"""
    bulk = x.x_hat[2] / stiffness(x.x_hat[0], p)  # rod motion that only compresses oil
    known, slack = x.lever_P[2] > 0.0, 0.0  # by the filter without a fault state, where it runs
    if known:
        step = x.h_step + dt * (x.x_hat[1] - x.h_hat[1])
        x.rigging = decision.lever_at(x, x.h_hat[0], step)
        slack = decision.lever_slack(x, x.h_hat[0], step)
    v, x3 = x.u_old[int(p.delay)], x.x_hat[2]
    motion = (1.0 + x.fed[filter.GAIN]) * p.phi_n / p.A_p * opening(v, x3) * v - p.L * x3
    y_surface = p.arm * u.y_surface + bulk
    decision.pair_test(x, u.y_rod + bulk, rod, y_surface, surface, motion, x.x_hat[3], slack, known, p, dt)


@kernel
def gap(x, dt):
    """While rod and surface are apart, tell whether by a gap; what takes both sides without two levels is none."""
    if x.sensor < 0.5:
        x.gap_dd = x.loose = 0.0
        x.gap_s[:] = x.gap_d[:] = 0.0
    if x.sensor < 0.5 or x.pair_age < SIDE_S:
        return
    i = 1 if x.pair_d > 0.0 else 0
    x.gap_s[i] += dt
    x.gap_d[i] += dt * math.fabs(x.pair_d)
    x.gap_dd += dt * x.pair_d * x.pair_d
    if min(x.gap_s[0], x.gap_s[1]) <= SIDE_S:
        return
    total, time = x.gap_d[0] + x.gap_d[1], x.gap_s[0] + x.gap_s[1]
    left = x.gap_dd - total * total / time
    held = min(x.gap_d[0] / x.gap_s[0], x.gap_d[1] / x.gap_s[1]) > 0.5 * total / time  # each side has the level
    x.loose = 1.0 if held and left < SWINGS * x.gap_dd else 0.0
    if left > NO_LEVELS * SWINGS * x.gap_dd:
        x.backlash_suspected = 0.0


@kernel
def by_model(x, p):
    """Return what learned errors of gain, oil and supply leave in the input fault of [Lu17] (4), behind its lag."""
    root, k = max(opening(x.drive, x.load_lag), lu17.ROOT_FLOOR), stiffness(x.x_hat[0], p)
    stiff = x.fed[filter.SOFT] - p.prior_mean[filter.SOFT]
    soft = stiff / (1.0 + stiff) * x.load_d / k
    supply = 0.5 * x.fed[filter.SUPPLY] * x.drive / (root * root)
    return soft * p.A_p / (p.phi_n * root) - supply + x.fed[filter.GAIN] * x.drive


@kernel
def input_fault(x, noise, disturbed, p, dt):
    """Declare a lagged input fault beyond what noise, times `noise`, and the valve's gain leave."""
    x.drive_d += dt * p.lag_omega * (p.lag_omega * (x.u_old[int(p.lag_ticks)] - x.drive) - 2.0 * p.lag_zeta * x.drive_d)
    x.drive += dt * x.drive_d
    x.load_d += dt * p.lag_omega * (p.lag_omega * (x.x_hat[2] - x.load_lag) - 2.0 * p.lag_zeta * x.load_d)
    x.load_lag += dt * x.load_d
    a = 1.0 - math.exp(-dt / p.run_tau)
    x.f_slow += a * (x.f_hat - by_model(x, p) - x.f_slow)
    x.u_slow += a * (x.drive - x.u_slow)
    late = dt / p.run_tau * x.sd[filter.AGE] * math.fabs(x.drive - x.u_slow)  # by an old position the valve is late
    unlearned = UNLEARNED * (x.sd[filter.GAIN] * math.fabs(x.u_slow) + late)
    x.r_run = math.fabs(x.f_slow) / (noise * p.run_threshold + p.run_share * math.fabs(x.u_slow) + unlearned)
    beyond = x.r_run >= 1.0 and not disturbed
    weighed = dt * min(x.r_run, RUN_WEIGHT) if beyond else dt
    x.run_timer, x.run = confirm(x.run_timer, x.run, beyond, weighed, p.run_confirm, p.t_release)
    x.run_s = x.run_s + dt if x.run > 0.5 else 0.0


@kernel
def runaway(x, noise, p, dt):
    """Tell whether the valve of an input fault stands open: it has opened with it, keeps, and the servo closes it."""
    w, least = x.f_slow + x.u_slow, noise * p.run_threshold
    x.w_flat_s += dt
    if math.fabs(w - x.w_flat) > FLAT * math.fabs(x.w_flat) + NOISE * least:
        x.w_flat, x.w_flat_s = w, 0.0
    x.w_flat += dt / FLAT_TAU * (w - x.w_flat)
    if x.w_flat_s < FIRST_S:
        x.w_first = x.w_flat
    sudden = x.run_s < x.w_flat_s + FIRST_S and math.fabs(x.w_first - x.w_flat) < FIRST * math.fabs(x.w_flat)
    stays = x.w_flat_s >= FLAT_S and math.fabs(x.w_flat) > least
    if x.run < 0.5 or (x.r_run >= 1.0 and w * x.stands_open < LEFT * x.stands_open * x.stands_open):
        x.stands_open = 0.0
    elif sudden and stays and x.r_run >= 1.0 and w * x.u_slow < 0.0:
        x.stands_open = x.w_flat


@kernel
def jammed(x, u, disturbed, p, dt):
    """Declare a jam, load beyond the hinge-moment model while the rod is at rest, or a wrong reading of the pressure.

    The valve delivers the flow L e + e' / k that an excess e of pressure takes; where only the reading is wrong the
    filter invents it, f = L e + e' / k, and there is no jam. While the sensor is left out the load is that of its
    reading. [Lu17] (4)
    """
    model, a, out = two_stage.load_model(x.x_hat[0], u, p), 1.0 - math.exp(-dt / p.run_tau), x.dp_out > 0.5
    x.excess += a * ((-u.y_dp if out and usable(u.y_dp, u.y_dp_valid) > 0.5 else x.x_hat[3]) - model - x.excess)
    x.r_jam = math.fabs(x.excess) / (p.jam_threshold + p.jam_share * math.fabs(model))
    tau = 5.0 * p.run_tau
    b = 1.0 - math.exp(-dt / tau)
    x.excess_lag += b * (x.excess - x.excess_lag)
    x.f_lag += b * (x.f_slow - x.f_lag)
    flow = p.L * x.excess_lag + (x.excess - x.excess_lag) / (tau * stiffness(x.x_hat[0], p))
    x.q_fast += a * (x.x_hat[0] - x.q_fast)
    x.q_slow += dt / (2.0 * p.run_tau) * (x.q_fast - x.q_slow)
    still = math.fabs(x.q_fast - x.q_slow) < 2.0 * p.run_tau * p.jam_still
    delivered = -x.f_lag * flow < 0.5 * flow * flow
    high = x.r_jam >= 1.0 and not disturbed
    beyond = high and still and not out and (delivered or x.jam > 0.5)
    x.jam_timer, x.jam = confirm(x.jam_timer, x.jam, beyond, dt, p.jam_confirm, p.t_release)
    wrong = high and (out or not (delivered or x.run > 0.5 or x.jam > 0.5))
    x.misread_timer, x.misread = confirm(x.misread_timer, x.misread, wrong, dt, MISREAD_S, p.t_release)
    x.jam_s = x.jam_s + dt if x.jam > 0.5 else 0.0
    x.jam_most = max(x.jam_most, math.fabs(x.excess)) if x.jam > 0.5 else 0.0
    x.r_jam *= 1.0 if still else 0.0


@kernel
def freezes(x, u):
    """Tell which sensor, one that had noise, repeats its last value."""
    x.frozen = 0.0
    y, valid = (u.y_rod, u.y_surface, u.y_dp), (u.y_rod_valid, u.y_surface_valid, u.y_dp_valid)
    for j in range(3):
        if usable(y[j], valid[j]) < 0.5:
            x.same[j] = 0.0
            continue
        x.same[j] = min(x.same[j] + 1.0, 1e6) if y[j] == x.last_y[j] else 0.0
        x.last_y[j] = y[j]
        if x.same[j] < FROZEN:
            x.changes[j] += OF_LATE * ((1.0 if x.same[j] == 0.0 else 0.0) - x.changes[j])
        elif x.changes[j] > CHANGES:
            x.frozen = j + 1.0


@kernel
def update(x, u, p, dt):
    """Run all tests for one tick."""
    rod, surface = usable(u.y_rod, u.y_rod_valid), usable(u.y_surface, u.y_surface_valid)
    pair(x, u, rod, surface, p, dt)
    gap(x, dt)
    lost = p.load == 2.0 and x.age_dp > p.t_invalid
    noise = WITHOUT_PRESSURE if lost else (WITHOUT_ROD if x.blame == 1.0 or x.age_rod > p.t_invalid else 1.0)
    if noise != x.noise_scale:
        x.t_settling = max(x.t_settling, decision.T_DISTURBED)
        x.noise_scale = noise
    disturbed = x.t_settling > 0.0 or x.valid < 0.5
    input_fault(x, noise, disturbed, p, dt)
    runaway(x, noise, p, dt)
    if p.load == 2.0:
        jammed(x, u, (disturbed or lost) and x.dp_out < 0.5, p, dt)
    freezes(x, u)
