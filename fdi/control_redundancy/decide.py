"""Decision of control redundancy: the effector, or sensor in its place, that explains the residuals, and the class."""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.common.verdict import AMBIGUOUS, JAM_SOLID, NONE, SENSOR, THRUST
from fdi.control_redundancy.core import NH, NR, PITCH, fit_hypothesis

HEALED_S = 5.0  # so long what a declared fault would do now, were it still there, is not there [s]
SHOWS = (0.5, 0.75, 1.0)  # of a threshold: a fault that no longer shows, one that would, one that does
SURFACES = 3  # hypotheses of surfaces, those of engines follow: a fault of these is a share of the thrust
HOME = 0.02  # of what was commanded before the alarm: the error of the position that forces tell, 1 deg [rad]
ASKED_S = 20.0  # for so long a command is remembered [s]
UNNAMED_S = 10.0  # an alarm without a name outlives its residuals by this [s]
FAR = 1e3  # beyond every position [rad]; a state is finite
FIRING = 0.8  # of a row's threshold: with less it says nothing of its accelerometer
DOUBT = 0.5  # of bias_share: with so much no effector is declared
MAYBE = 0.35  # of the error that lift asks for: with so much in the vane, slowly or of late, no effector is declared
TURN, TURN_0 = 0.6, 0.02  # how far, in share and in [rad/s2], the pitching may be from what an elevator would do
NEAR = 0.35  # so far the vane's error by kinematics is from the one that lift asks for, when it is named


@kernel
def _in_use(x, p):
    """Mark the families that no declared effector moves; return the largest residual in use over its threshold."""
    largest = 0.0
    for f in range(int(p.n_families)):
        x.used[f] = 1.0 if x.S[f, 0] == x.S[f, 0] else 0.0
        for h in range(int(p.n_hypotheses)):
            if x.declared[h] > 0.5 and math.fabs(x.S[f, h]) * p.limit[h] >= 0.5 * x.tau[f]:
                x.used[f] = 0.0
        if x.used[f] > 0.5:
            largest = max(largest, math.fabs(x.res[f]) / x.tau[f])
    return largest


@kernel
def _turns(x, p, value):
    """Return 1.0 when the aircraft turns as an elevator off by `value` turns it; moment rows ask that themselves."""
    asked = x.avg[PITCH + 1] * value
    return 1.0 if p.n_rows > 3.0 or math.fabs(x.avg[PITCH] - asked) <= TURN * math.fabs(asked) + TURN_0 else 0.0


@kernel
def _explain(x, p):
    """Return (number of hypotheses that explain the residuals, the best of them + 1); set their bits."""
    x.candidates, count, best, least, bit = 0.0, 0, 0, math.inf, 1.0
    for h in range(int(p.n_hypotheses)):
        if x.declared[h] < 0.5:
            value, worst = fit_hypothesis(x, p, h)
            fits = worst < 1.0 and math.fabs(value) <= p.limit[h]
            if fits and (h > 0 or _turns(x, p, value) > 0.5):
                x.candidates += bit
                count += 1
                if worst < least:
                    least, best = worst, h + 1
        bit *= 2.0
    return count, best


@kernel
def _estimate(x, p, h):
    """Return the fault of hypothesis h from the families that no other declared effector moves."""
    was = x.declared[h]
    x.declared[h] = 0.0
    _in_use(x, p)
    value, _ = fit_hypothesis(x, p, h)
    x.declared[h] = was
    return value


@kernel
def _accelerometer(x, p, share, doubt):
    """Return 1.0 or 2.0 when kinematics find `share` of a row's residual in n_x or n_z, else 0.0.

    `doubt` 1 asks that they do without what gusts from the side may have made of it; 0: they may.
    """
    found, most = 0.0, 0.0
    for i in range(2):
        e = x.avg[0] if i == 0 else -x.avg[2]  # a reading that is too large raises X and lowers Z
        b, row = math.copysign(max(math.fabs(x.bias[i]) - doubt * x.doubt[i], 0.0), x.bias[i]), 2 * i
        if math.fabs(e) < FIRING * (p.threshold[row] + p.rel * x.avg[NR + row]):
            continue
        if math.fabs(b) > p.t_bias and b * e > 0.0 and math.fabs(b) >= share * math.fabs(e):
            if math.fabs(b) > most:
                found, most = i + 1.0, math.fabs(b)
    return found


@kernel
def _vane(x, p):
    """Return how the vane explains the Z row: 2.0 kinematics find that error, 1.0 they may, 0.0 it is another's."""
    e, tau = x.avg[2], p.threshold[2] + p.rel * x.avg[NR + 2]
    if math.fabs(e) < FIRING * tau or x.lift >= 0.0:
        return 0.0
    error = -e / x.lift
    if math.fabs(error) < p.t_vane:
        return 0.0
    slow = x.vane[2]
    if math.fabs(slow - error) <= NEAR * math.fabs(error) and slow * slow > max(p.t_vane * p.t_vane, x.rough):
        return 2.0
    sign = math.copysign(1.0, error)
    most = max(x.vane[0] - slow, max(x.vane[1], slow)) if error > 0.0 else min(x.vane[0] - slow, min(x.vane[1], slow))
    most = max(sign * most, sign * x.vane[0])
    return 1.0 if most >= MAYBE * math.fabs(error) else 0.0


@kernel
def decide(x, p, dt):
    """Declare the single explanation that lasts, release what has been quiet, name the class."""
    x.r = _in_use(x, p)
    if x.suspect > 0.5:
        x.alarm, x.verdict = 1.0, AMBIGUOUS
        return
    turning = x.gyro_off > 0.0  # q is wrong: kinematics take that for an error of n_x or n_z
    wrong = _accelerometer(x, p, p.bias_share, 1.0) if x.r >= 1.0 and not turning else 0.0
    maybe = _accelerometer(x, p, p.bias_share, 0.0) if x.r >= 1.0 and not turning else 0.0
    wind = _vane(x, p) if x.r >= 1.0 else 0.0
    off = x.vane[2] * x.vane[2] > max(p.t_vane * p.t_vane, x.rough)
    if wind > 1.5 and maybe < 1.5:  # a vane that lift finds wrong as well moves the X row, too
        wrong = 3.0
    elif wrong > 0.5 and off and x.blamed > 2.5:
        wrong = 3.0  # it was named, and still reads as wrong: near the stall lift no longer says by how much
    elif wrong == 1.0 and off:
        wrong = 0.0  # gusts or the vane
    x.timer_bias, x.on_bias = confirm(x.timer_bias, x.on_bias, wrong > 0.5, dt, p.t_confirm, p.t_release)
    row = 0 if x.blamed == 1.0 else 2
    absent = x.on_bias > 0.5 and math.fabs(x.avg[row]) < 0.5 * (p.threshold[row] + p.rel * x.avg[NR + row])
    x.absent = x.absent + dt if absent else 0.0
    if x.absent > HEALED_S:  # an error of a sensor shows in its row in every flight
        x.timer_bias, x.on_bias, x.absent = 0.0, 0.0, 0.0
    x.blamed = wrong if wrong > 0.5 else (x.blamed if x.on_bias > 0.5 else 0.0)
    if wrong > 0.5 or x.on_bias > 0.5:  # its rows say nothing about effectors
        x.timer, x.last, x.timer_any = 0.0, 0.0, 0.0
        if x.on_bias > 0.5:
            x.alarm, x.verdict, x.culprit = 1.0, SENSOR, NH + x.blamed
        return
    if x.culprit > NH:
        x.culprit = 0.0
    count, best = _explain(x, p) if x.r >= 1.0 else (0, 0)
    if count == 1 and (turning or wind > 0.5 or _accelerometer(x, p, DOUBT * p.bias_share, 0.0) > 0.5):
        count = 2  # it may still turn out to be the sensor
    if count != 1 or best != x.last:
        x.timer = 0.0
    x.last = best if count == 1 else 0.0
    if count == 1:
        x.timer += dt
        if x.timer >= p.t_confirm - 0.5 * dt:
            h = best - 1
            x.declared[h], x.quiet[h], x.culprit, x.timer = 1.0, 0.0, best, 0.0
            x.held[h] = x.refuted[h] = 0.0
            for i in range(2):
                x.low[i], x.high[i] = FAR, -FAR
    x.timer_any, x.on = confirm(x.timer_any, x.on, x.r >= 1.0 and count != 1, dt, p.t_ambiguous, UNNAMED_S)
    if x.on < 0.5 and x.r < 1.0:
        for h in range(SURFACES):
            command = x.avg[2 * NR + h]
            x.asked_low[h] = min(command, x.asked_low[h] + (command - x.asked_low[h]) * dt / ASKED_S)
            x.asked_high[h] = max(command, x.asked_high[h] + (command - x.asked_high[h]) * dt / ASKED_S)
    x.f_hat_elevator, x.f_hat_aileron = _estimate(x, p, 0), _estimate(x, p, 1)
    x.f_hat_rudder, x.f_hat_thrust = _estimate(x, p, 2), _estimate(x, p, 3)
    x.alarm = x.on
    for h in range(int(p.n_hypotheses)):
        if x.declared[h] > 0.5:
            f = _estimate(x, p, h)
            command = x.avg[2 * NR + h] if h < SURFACES else 0.0
            moved, asked = 0.0, 0.0
            for i in range(int(p.n_families)):
                if x.used[i] > 0.5:
                    moved = max(moved, math.fabs(x.S[i, h] * f) / x.tau[i])
                    asked = max(asked, math.fabs(x.S[i, h] * (x.held[h] - command)) / x.tau[i])
            x.quiet[h] = 0.0 if moved >= SHOWS[0] else x.quiet[h] + dt
            if moved >= SHOWS[2] or x.held[h] == 0.0:
                x.held[h] = command + f
            # a surface that stands where the command is shows nothing; elsewhere it would
            x.refuted[h] = x.refuted[h] + dt if moved < SHOWS[0] and asked >= SHOWS[1] else 0.0
            if x.quiet[h] > p.t_release or x.refuted[h] > HEALED_S:
                x.declared[h] = 0.0
                x.culprit = 0.0 if x.culprit == h + 1.0 else x.culprit
            else:
                x.alarm = 1.0
                x.f_hat = f if x.culprit == h + 1.0 else x.f_hat
    _name(x, p)


@kernel
def _name(x, p):
    """Set the verdict: THRUST for engines; a surface that stands while its command moves is JAM_SOLID."""
    if x.alarm < 0.5:
        x.verdict, x.culprit, x.f_hat = NONE, 0.0, 0.0
    elif x.culprit > 3.5:
        x.verdict = THRUST
    elif x.culprit > 0.5:
        command = x.avg[2 * NR + int(x.culprit) - 1]
        x.low[0], x.high[0] = min(x.low[0], command), max(x.high[0], command)
        x.low[1], x.high[1] = min(x.low[1], command + x.f_hat), max(x.high[1], command + x.f_hat)
        moved, stood = x.high[0] - x.low[0], x.high[1] - x.low[1]
        h, mean = int(x.culprit) - 1, 0.5 * (x.low[1] + x.high[1])
        home = x.asked_low[h] - HOME <= mean <= x.asked_high[h] + HOME  # a jam stands where it was commanded
        x.verdict = JAM_SOLID if moved > 0.03 and stood < 0.5 * moved and home else AMBIGUOUS
    else:
        x.verdict = AMBIGUOUS


@kernel
def withdraw(x, p):
    """Take back what was declared: nothing has been measured for long."""
    for h in range(int(p.n_hypotheses)):
        x.declared[h] = 0.0
    x.on, x.timer, x.timer_any, x.last = 0.0, 0.0, 0.0, 0.0
    x.on_bias, x.timer_bias, x.blamed, x.absent = 0.0, 0.0, 0.0, 0.0
    x.r, x.alarm, x.verdict, x.culprit, x.f_hat = 0.0, 0.0, NONE, 0.0, 0.0
    x.f_hat_elevator, x.f_hat_aileron, x.f_hat_rudder, x.f_hat_thrust = 0.0, 0.0, 0.0, 0.0
