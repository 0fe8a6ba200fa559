"""Tests of the pressure sensor of a hydraulic actuator, and how the filter goes on without it.

| test | statistic | it is the sensor's because |
|---|---|---|
| step | the reading leaves its prediction between two samples and stays there | oil takes time: a valve makes a ramp |
| frozen | FROZEN equal readings of a sensor that had changed with every sample | noise does not repeat itself |
| plausible | load F beyond the hinge-moment model, with the flow that should carry it missing | below |

The pressure x3 and the flow through the valve are tied by (4): gain (u + f) opening - q' = L x3 + x3' / k. An excess e
of pressure beyond what the hinge-moment model needs takes the flow L e + e' / k. In a jam, or under a load that no
model foresees, the valve delivers that flow and f stays zero. Where only the reading is wrong the valve delivers none,
and the filter invents it: f = L e + e' / k. The ratio of f to that flow, both lagged by `share_tau`, is 0 for a load
and 1 for a sensor. [Lu17] (4)

A step is taken as the sensor's offset and the reading goes on being used. The offset ends with a step back, or when the
load beyond the model shows that it was none. A sensor that is frozen or not plausible
is left out: the load then follows the hinge-moment model, and what rests on the pressure is not tested.
"""

import math

from actuators.block import kernel
from actuators.hydraulic.lu17 import stiffness
from fdi.common.decision import usable

# A jump of the pressure: against the prediction, over the noise of the reading and of the prediction, of supply (the
# healthy bias is up to 1 %); samples until it is judged, each within STEP_STAYS of the first. A mean over the five
# instead finds 5 % three times in four and not two, and takes one runaway in twelve for a sensor: not worth it
# The crest of an oscillation is as flat, but begins before: by more than STEP_BEFORE of it in the sample before. A
# pulse of the valve of one tick that is not obeyed is as sudden and stays: up to STEP_VALVE of it is the valve's
STEP_SIGMA, STEP_LEAST, STEP_WAIT, STEP_STAYS, STEP_BEFORE, STEP_VALVE = 6.0, 0.045, 5, 0.3, 0.5, 1.5
# An offset is dropped when the load beyond the model has for DROP_TIME moved by it, to the shares DROP, from its mean
# over about USUAL_TAU before it was taken: a false offset moves the load by itself, a real one does not. The servo
# answers the estimate that has moved, faster than a filter of slow ticks foresees: no jump within SETTLES [s]
DROP_TIME, USUAL_TAU, DROP_LEAST, DROP_MOST, SETTLES = 1.0, 20.0, 0.5, 1.5, 0.1
# The noise is that of the last MEMORY samples where it is more than the filter's; one of them counts for NIS_MOST at
# most. At the start, before it is known, it may be twice the filter's
MEMORY, NIS_MOST, NIS_FIRST = 200.0, 25.0, 4.0
# A sensor that changes in CHANGES of its samples repeats one FROZEN times with probability (1 - CHANGES)^FROZEN =
# 1e-12; from SAME repetitions on a sample is not used; ROUGH: squared change over 2 r_dp that counts as noise at all
FROZEN, CHANGES, SAME, ROUGH = 20, 0.75, 2.0, 0.01
# Without the pressure: F is known to 5 % of the stall force or 20 % of itself, about 0.06, for about a second, which is
# 200 samples: as white noise its variance is 200 * 0.06^2
R_MODEL = 0.7

PARAMS = [
    ("share_tau", "f8", "s"),  # lag of the flow balance
    ("share_least", "f8", "-"),  # from this share on the excess is the sensor's
    ("share_confirm", "f8", "s"),
]
STATE = [
    ("dp_offset", "f8", "-"),  # bias that the pressure sensor was found to have
    ("step_age", "f8", "s"),  # since then
    ("step_count", "f8", "-"),  # samples since a jump of the pressure
    ("dp_nis", "f8", "-"),  # squared innovation over its variance, lagged: noise beside what the filter assumes
    ("step_dp", "f8", "-"),  # the jump
    ("step_moves", "f8", "-"),  # 1 when it did not stay, or something else explains it
    ("dp_before", "f8", "-"),  # innovation of the sample before
    ("dp_last", "f8", "-"),  # last reading
    ("dp_same", "f8", "-"),  # times that it has repeated itself
    ("dp_changes", "f8", "-"),  # share of readings that differ from the one before, lagged
    ("dp_rough", "f8", "-"),  # their squared difference, lagged
    ("dp_out", "f8", "-"),  # 1 while the sensor is left out
    ("dp_excess", "f8", "-"),  # while it is left out, what its reading lacks of the estimate without it, lagged
    ("dp_timer", "f8", "s"),  # time for which it has not been plausible, or back in its place
    ("excess_usual", "f8", "-"),  # load beyond the model, lagged, before an offset was taken
    ("drop_timer", "f8", "s"),  # time for which the load has moved by the offset
    ("excess_lag", "f8", "-"),  # load beyond the model, lagged
    ("f_lag", "f8", "-"),  # input fault, gain error removed, lagged
]
FIXED = {"share_tau": 0.1, "share_least": 0.5, "share_confirm": 0.1}


@kernel
def watch(x, y, p):
    """Count how often the reading `y` repeats itself; leave a frozen sensor out."""
    d = y - x.dp_last
    x.dp_last = y
    a = 1.0 / MEMORY
    if d == 0.0:
        x.dp_same += 1.0
        if x.dp_same >= FROZEN and x.dp_changes > CHANGES and x.dp_rough > ROUGH * 2.0 * p.r_dp:
            x.dp_out = 1.0
            x.dp_timer = 0.0
        if x.dp_same < FROZEN:
            x.dp_changes -= a * x.dp_changes
            x.dp_rough -= a * x.dp_rough
        return
    x.dp_same = 0.0
    x.dp_changes += a * (1.0 - x.dp_changes)
    x.dp_rough += a * (min(d * d, 10.0 * p.r_dp) - x.dp_rough)


@kernel
def judge(x, y, p):
    """Return (pressure to use, whether to use it): a jump is held back for STEP_WAIT samples to see what it is.

    A bad sensor jumps from one sample to the next and stays there: that is taken as its offset. A single sample
    is a spike. A valve that is not obeyed makes a ramp, 0.9 of the missing opening with each sample: that is
    used. While an input fault is declared nothing is held back: where it ends, or drives the rod off a stop, which
    the filter does not know, the pressure leaves its prediction by all of the supply within three samples.
    """
    watch(x, y, p)
    if x.dp_out > 0.5 or (x.dp_same >= SAME and x.dp_changes > CHANGES):
        return y, False
    y -= x.dp_offset
    e = y - x.x_bar[2] - x.V[2] * x.f_hat
    if x.run > 0.5 or (x.dp_offset == 0.0 and x.step_age < SETTLES):
        x.step_count, x.dp_before = 0.0, e
        return y, True
    if x.step_count < 0.5:
        s = x.P_bar[2, 2] + x.V[2] * x.P_f * x.V[2] + p.r_dp
        nis = e * e / s
        if math.fabs(e) < STEP_LEAST or nis < STEP_SIGMA * STEP_SIGMA * max(x.dp_nis, 1.0):
            x.dp_nis += (min(nis, NIS_MOST) - x.dp_nis) / MEMORY
            x.dp_before = e
            return y, True
        x.step_count, x.step_dp = 1.0, e
        missing = -x.G[2] * x.u_old[int(p.delay)]  # what is lacking if the valve did not do what it was told
        valve = 0.0 < e * missing < STEP_VALVE * missing * missing
        x.step_moves = 1.0 if valve or e * x.dp_before > STEP_BEFORE * e * e else 0.0
        return y, False
    x.step_count += 1.0
    if math.fabs(e - x.step_dp) > STEP_STAYS * math.fabs(x.step_dp):
        x.step_moves = 1.0
    if x.step_count < STEP_WAIT:
        return y, False
    x.step_count = 0.0
    if x.step_moves < 0.5:
        before = x.dp_offset
        after = before + 0.5 * (e + x.step_dp)
        # a step back to less than a step that could be seen is a sensor that is right again
        x.dp_offset = 0.0 if before != 0.0 and math.fabs(after) < STEP_LEAST else after
        x.step_age = 0.0
        return y - (x.dp_offset - before), True
    return y, True


@kernel
def keep(x, other, dt):
    """Drop an offset that the load shows to be none, and move the estimate with it; `other` faults hide the load."""
    if x.dp_offset == 0.0:
        x.drop_timer = 0.0
        if not other and x.speaks < 0.5:
            x.excess_usual += dt / USUAL_TAU * (x.excess - x.excess_usual)
        return
    moved = (x.excess - x.excess_usual) / x.dp_offset  # the load is of the opposite sign of the pressure
    shown = DROP_LEAST < moved < DROP_MOST and not other and x.dp_out < 0.5
    x.drop_timer = x.drop_timer + dt if shown else max(x.drop_timer - dt, 0.0)
    if x.drop_timer >= DROP_TIME - 0.5 * dt:
        x.x_bar[2] += x.dp_offset
        x.x_bar[3] -= x.dp_offset
        x.excess -= x.dp_offset
        x.dp_offset = x.drop_timer = x.step_age = 0.0


@kernel
def plausible(x, u, model, beyond, other, p, dt):
    """Return the share of the flow of an excess of load over `model` [1] that is missing: 0 a load's, 1 the sensor's.

    Leaves the sensor out when the excess is `beyond` its threshold and the sensor's for `share_confirm`, unless an
    `other` fault is declared or disturbs the estimate; takes it back when its reading has agreed for `t_release`.
    """
    a = 1.0 - math.exp(-dt / p.share_tau)
    x.excess_lag += a * (x.excess - x.excess_lag)
    x.f_lag += a * (x.f_slow - x.f_lag)
    k = stiffness(x.x_hat[0], p)
    flow = p.L * x.excess_lag + (x.excess - x.excess_lag) / (p.share_tau * k)  # of a pressure of the opposite sign
    share = -x.f_lag * flow / max(flow * flow, 1e-12)
    if x.dp_out < 0.5:
        suspect = beyond and share > p.share_least and not other
        x.dp_timer = x.dp_timer + dt if suspect else max(x.dp_timer - dt, 0.0)
        if x.dp_timer >= p.share_confirm - 0.5 * dt:
            x.dp_out, x.dp_timer, x.dp_excess = 1.0, 0.0, x.excess
            x.dp_offset = 0.0  # what was taken for the offset is not it: the reading itself has to come back
        return share
    if usable(u.y_dp, u.y_dp_valid) > 0.5:
        x.dp_excess += a * (x.x_hat[2] + x.dp_offset - u.y_dp - x.dp_excess)
        back = x.dp_same < SAME and math.fabs(x.dp_excess) < 0.75 * (p.jam_threshold + p.jam_share * math.fabs(model))
        x.dp_timer = x.dp_timer + dt if back else 0.0
        if x.dp_timer >= p.t_release:
            x.dp_out = 0.0
            x.dp_timer = 0.0
    return share
