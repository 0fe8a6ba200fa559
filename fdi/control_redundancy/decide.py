"""Decision of control redundancy: the effector that explains the residuals, and the class."""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.common.verdict import AMBIGUOUS, JAM_SOLID, NONE, THRUST
from fdi.control_redundancy.core import COMMAND, NH, fit_hypothesis, row_threshold

HEALED_S = 5.0  # so long what a declared fault would do now, were it still there, is not there [s]
SUSPECTED_S = 2.0  # for so long a sensor may be wrong after kinematics have found it so: an oscillation has zeros [s]
SHARES = (0.5, 0.75, 1.0)  # of a threshold: a fault that no longer shows, one that would, one that does
SURFACES = 3  # hypotheses of surfaces; the last is thrust, of which a fault is a share
HOME = 0.02  # of what was commanded before the alarm: the error of the position that forces tell, 1 deg [rad]
ASKED_S = 20.0  # for so long a command is remembered [s]
FAR = 1e3  # beyond every position [rad]; a state is finite
FIRING = 0.8  # of a row's threshold: with less it says nothing of its sensor
MAYBE = 0.25  # of the error that a row asks of its sensor: with so much by kinematics no effector is declared


@kernel
def _in_use(x, p, but):
    """Mark the families that no declared effector moves, `but` one of them; return the largest residual in use over its
    threshold."""
    largest = 0.0
    for f in range(int(p.n_families)):
        x.used[f] = 1.0
        for h in range(NH):
            if h != but and x.declared[h] > 0.5 and math.fabs(x.S[f, h]) * p.limit[h] >= 0.5 * x.tau[f]:
                x.used[f] = 0.0
        if x.used[f] > 0.5:
            largest = max(largest, math.fabs(x.res[f]) / x.tau[f])
    return largest


@kernel
def _explain(x, p):
    """Return (number of hypotheses that explain the residuals, the best of them + 1)."""
    count, best, least = 0, 0, math.inf
    for h in range(NH):
        if x.declared[h] < 0.5:
            value, worst = fit_hypothesis(x, p, h)
            if worst < 1.0 and math.fabs(value) <= p.limit[h]:
                count += 1
                if worst < least:
                    least, best = worst, h + 1
    return count, best


@kernel
def _estimate(x, p, h):
    """Return the fault of hypothesis h from the families that no other declared effector moves."""
    _in_use(x, p, h)
    return fit_hypothesis(x, p, h)[0]


@kernel
def _sensor(x, p):
    """Return whether kinematics find an error of n_x, n_z or the vane that may explain its row."""
    for i in range(2):
        e = x.avg[0] if i == 0 else -x.avg[2]  # a reading that is too large raises X and lowers Z
        firing = math.fabs(e) >= FIRING * row_threshold(x, p, 2 * i)
        if firing and math.fabs(x.bias[i]) > p.t_bias and x.bias[i] * e >= MAYBE * e * e:
            return True
    if x.lift >= 0.0 or math.fabs(x.avg[2]) < FIRING * row_threshold(x, p, 2):
        return False
    error = -x.avg[2] / x.lift
    sign = math.copysign(1.0, error)
    seen = max(max(sign * (x.vane[0] - x.vane[2]), sign * x.vane[0]), max(sign * x.vane[1], sign * x.vane[2]))
    return math.fabs(error) >= p.t_vane and seen >= MAYBE * math.fabs(error)


@kernel
def decide(x, p, dt):
    """Declare the single explanation that lasts, release what has been quiet, name the class."""
    x.r = _in_use(x, p, NH)
    count, best = _explain(x, p) if x.r >= 1.0 else (0, 0)
    x.suspicion = SUSPECTED_S if count == 1 and _sensor(x, p) else max(x.suspicion - dt, 0.0)
    if count == 1 and x.suspicion > 0.0:
        count = 2  # it may be the sensor
    _confirm(x, p, count, best, dt)
    if x.on < 0.5 and x.r < 1.0:
        for h in range(SURFACES):
            command = x.avg[COMMAND + h]
            x.asked_low[h] = min(command, x.asked_low[h] + (command - x.asked_low[h]) * dt / ASKED_S)
            x.asked_high[h] = max(command, x.asked_high[h] + (command - x.asked_high[h]) * dt / ASKED_S)
    x.f_hat_elevator, x.f_hat_aileron = _estimate(x, p, 0), _estimate(x, p, 1)
    x.f_hat_rudder, x.f_hat_thrust = _estimate(x, p, 2), _estimate(x, p, 3)
    x.alarm = x.on
    for h in range(NH):
        if x.declared[h] > 0.5:
            _follow(x, p, h, dt)
    _name(x)


@kernel
def _confirm(x, p, count, best, dt):
    """Declare hypothesis `best` once it has been the only explanation for t_confirm; without one for t_ambiguous the
    alarm has no name."""
    if count != 1 or best != x.last:
        x.timer = 0.0
    x.last = best if count == 1 else 0.0
    if count == 1:
        x.timer += dt
        if x.timer >= p.t_confirm - 0.5 * dt:
            h = best - 1
            x.declared[h], x.quiet[h], x.held[h], x.refuted[h] = 1.0, 0.0, 0.0, 0.0
            x.isolated_part, x.timer = best, 0.0
            x.low[:] = FAR
            x.high[:] = -FAR
    x.timer_any, x.on = confirm(x.timer_any, x.on, x.r >= 1.0 and count != 1, dt, p.t_ambiguous, p.t_release)


@kernel
def _follow(x, p, h, dt):
    """Keep the alarm of declared effector h, or release it: quiet for long, or absent where it would show."""
    f = _estimate(x, p, h)
    command = x.avg[COMMAND + h] if h < SURFACES else 0.0
    moved, asked = 0.0, 0.0
    for i in range(int(p.n_families)):
        if x.used[i] > 0.5:
            moved = max(moved, math.fabs(x.S[i, h] * f) / x.tau[i])
            asked = max(asked, math.fabs(x.S[i, h] * (x.held[h] - command)) / x.tau[i])
    x.quiet[h] = 0.0 if moved >= SHARES[0] else x.quiet[h] + dt
    if moved >= SHARES[2] or x.held[h] == 0.0:
        x.held[h] = command + f
    # a surface that stands where the command is shows nothing; elsewhere it would
    x.refuted[h] = x.refuted[h] + dt if moved < SHARES[0] and asked >= SHARES[1] else 0.0
    if x.quiet[h] > p.t_release or x.refuted[h] > HEALED_S:
        x.declared[h] = 0.0
        x.isolated_part = 0.0 if x.isolated_part == h + 1.0 else x.isolated_part
    else:
        x.alarm = 1.0
        x.f_hat = f if x.isolated_part == h + 1.0 else x.f_hat


@kernel
def _name(x):
    """Set the verdict: THRUST for engines; a surface that stands while its command moves is JAM_SOLID."""
    x.verdict = AMBIGUOUS
    if x.alarm < 0.5:
        x.verdict, x.isolated_part, x.f_hat = NONE, 0.0, 0.0
    elif x.isolated_part > 3.5:
        x.verdict = THRUST
    elif x.isolated_part > 0.5:
        h = int(x.isolated_part) - 1
        command = x.avg[COMMAND + h]
        x.low[0], x.high[0] = min(x.low[0], command), max(x.high[0], command)
        x.low[1], x.high[1] = min(x.low[1], command + x.f_hat), max(x.high[1], command + x.f_hat)
        moved, stood, mean = x.high[0] - x.low[0], x.high[1] - x.low[1], 0.5 * (x.low[1] + x.high[1])
        # a jam stands where it was commanded
        if moved > 0.03 and stood < 0.5 * moved and x.asked_low[h] - HOME <= mean <= x.asked_high[h] + HOME:
            x.verdict = JAM_SOLID


@kernel
def withdraw(x):
    """Take back what was declared: nothing has been measured for long."""
    x.declared[:] = 0.0
    x.on, x.timer, x.timer_any, x.last, x.suspicion = 0.0, 0.0, 0.0, 0.0, 0.0
    x.r, x.alarm, x.verdict, x.isolated_part, x.f_hat = 0.0, 0.0, NONE, 0.0, 0.0
    x.f_hat_elevator, x.f_hat_aileron, x.f_hat_rudder, x.f_hat_thrust = 0.0, 0.0, 0.0, 0.0
