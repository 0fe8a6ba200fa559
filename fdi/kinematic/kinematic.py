"""Wrong sensors of the aircraft, by kinematics alone: inertial sensors against each other and air data.

Sources: [Eykeren14] L. Van Eykeren, Q. P. Chu, Sensor fault detection and isolation for aircraft control systems by
kinematic relations, Control Engineering Practice 31 (2014); [Lu15] P. Lu, L. Van Eykeren, E. van Kampen, Q. P. Chu,
Selective-reinitialization multiple-model adaptive estimation for fault detection and diagnosis, JGCD 38 (2015). No
aerodynamic coefficient enters, so that neither a gust nor a wrong coefficient nor an actuator fault moves the inertial
rows.

| row | residual | holds between |
|---|---|---|
| phi, theta, psi | attitude less integrated body rates | p, q, r and the three attitudes |
| climb | hdot less V_g (cos a sin theta - sin a cos theta cos phi), a over the ground | hdot, theta, alpha_g |
| turn | (g cos theta cos phi - g n_z + q u - p v)' integrated against w = V_g sin a | n_z, q, alpha_g |
| speed | g (n_x u + n_y v - n_z w - climb) / V_g integrated against V_g | n_x, theta, V_g |
| height | inertial altitude against integrated hdot | h, hdot |
| sound | V / M, the speed of sound, against what it was | V (true airspeed), M |
| impact | CAS, M and the pressure at the baroscope's altitude | CAS, M, h_baro |
| baro | barometric against inertial altitude | h_baro, h |

A row that integrates is a first-order observer, x_hat' = f + (x - x_hat) / tau, and the innovation x - x_hat its
residual: a step of x gives a jump that dies in tau, a constant error b of f gives -b tau for good. Offsets (rotation of
the earth, gravity) are learned in the first `t_learn`. Rows that fire within `t_collect` of the first one belong to one
fault, and name the sensor: the only one whose rows contain all that fired, of which every row that must fire did, and
whose first row jumped or did not; one that gusts would hide need not fire. More than one, or none, is AMBIGUOUS.

Climb, turn and speed take the lateral velocity from the vane and the wind (fdi/kinematic/wind.py). The vane has the
gusts in it: their thresholds grow with the rms of those, as the vane has it about its mean, and with the lateral motion
through which they act.

Noise and frozen readings show in the second difference of the reading alone, y_k - 2 y_k-1 + y_k-2 of variance 6
sigma^2, in which motion at the sampling rate is nothing. Gusts are not nothing in it: their part goes with a power of
the speed (`GUSTY`), and with it what the noise that was learned may be.

A constant error of a rate and a slow one of what it is the rate of leave the same in their row: "p or phi", "q or
theta", "r or psi", "n_x or v_ground" is named until something tells. Of q and theta the turn and the climb do; of the
others the velocity through the air, integrated from the first row that fires, which a steady wind and a roll rate do
not move:

    v' = g (n_y cos phi + n_z sin phi) - psi' u,  level and across the heading        V' = g (n_x u + ...) / V

An error b of r makes it stray by u b t, one of n_x by g b t, of roll by g times its integral; one of heading, of speed
over the ground or of p by nothing. The sensor is named when one of the two is 100 times as likely as the other, gusts
being the noise. When a drift that nothing told stops, and stays off, the alarm ends as if the rate were right again.

Beside a sensor that is named another one is, by rows that do not read the first: the name is that of the last.

Thresholds are those of the noise that is specified. A row whose readings, over the time of learning, have larger second
differences than specified noise makes has its threshold and its jump larger by as much.
"""

import math

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from fdi.common.decision import usable
from fdi.common.record import LEARN_S, TICK, Detector
from fdi.common.tuning import Folder, thresholds
from fdi.common.verdict import AMBIGUOUS, NONE, SENSOR
from fdi.common.why import BOX_SPEED, FLYING, LOST_SENSOR, NOT_READY, VALID, box
from fdi.kinematic import signatures as table
from fdi.kinematic import wind
from fdi.kinematic.rows import compare, read, weigh
from fdi.kinematic.signatures import CLIMB, EITHER, NR, NS, SENSORS

ISOLABLE_PARTS = table.ISOLABLE_PARTS
SPEEDS = ("tas", "cas", "v_ground")
# a gust changes by sigma sqrt(2 V dt / L) from tick to tick [Dryden]: the variance of airspeed goes with V, that of a
# vane's angle with 1 / V, that of a load factor, V times that angle, with V^3
GUSTY = {**dict.fromkeys(("tas", "cas", "mach"), 1), **dict.fromkeys(("alpha", "beta"), 2),
         **dict.fromkeys(("n_x", "n_y", "n_z"), 3)}  # fmt: skip
POWER = np.array([GUSTY.get(name, 0) for name in SENSORS])
# A named error is over when what it did last would be SEEN of a threshold and is not there, for SHOWN_S [s]. One of an
# integrated reading fades from its row: it stands until the reading jumps back, for OFF_S at most [s] if it came with
# a jump
SHOWN_S, SEEN, OFF_S = 5.0, 0.75, 120.0
LEFT = 4.0  # thresholds: from there a row is quiet within 1.4 of its time constants
FADING, STAYING, NOISY, JUMPED_BACK = 0.0, 1.0, 2.0, 3.0
# what else than a sensor moves the velocity through the air from its integral: noise, of which 0.03 deg of the vane at
# 200 m/s is half [m/s]; rotation of the earth, twice its rate times 200 m/s [m/s2]; gusts, times the rms that the vane
# has: one that is here, and three quarters of one that the observer had
STRAY_SD, STRAY_RATE, GUSTS_SD = 0.2, 0.03, 1.25
TOLD = 4.6  # ln 100: of the likelihoods of the sensors of a pair
HIDDEN = 1.25  # of a threshold: an error that shows larger should have fired

PARAMS = dtype(
    [
        ("threshold", "f8", (NR,)),  # of the rows: rad (3), m/s (3), m, m/s, relative, m
        ("jump", "f8", (NR,)),  # a change from tick to tick beyond it is one; the same units
        ("gust", "f8", (NR,)),  # growth of the thresholds with the rms of lateral gusts; their units per m/s
        ("side", "f8", (NR,), "rad"),  # of climb, turn and speed with lateral motion: the error of sideslip
        ("side_gust", "f8", (NR,), "-"),  # of which gusts make so many times their rms
        ("tau_gust", "f8", "s"),  # memory of that rms
        ("noise_ratio", "f8", "-"),  # second differences so many times their learned mean square are noise
        ("frozen_ratio", "f8", "-"),  # and so few times are a reading that repeats
        ("tau", "f8", "s"),  # of the rows that integrate
        ("tau_r", "f8", "s"),  # lag of the residuals
        ("tau_noise", "f8", "s"),  # memory of the second differences
        ("t_learn", "f8", "s"),  # offsets and noise are learned up to this time
        ("t_settle", "f8", "s"),  # from this time on
        ("t_collect", "f8", "s"),  # rows that fire so soon after the first one belong to it
        ("t_ambiguous", "f8", "s"),  # without a single name for so long it is ambiguous
        ("t_hold", "f8", "s"),  # a row that fired counts as fired for so long
        ("t_release", "f8", "s"),
    ]
)
UNITS = {
    **dict.fromkeys(("p", "q", "r"), "rad/s"), **dict.fromkeys(("n_x", "n_y", "n_z"), "g"), "mach": "-",
    **dict.fromkeys(("hdot", "tas", "cas", "v_ground"), "m/s"), **dict.fromkeys(("h_inertial", "h_baro"), "m"),
}  # fmt: skip
INPUTS = dtype([(n + tail, "f8", "-" if tail else UNITS.get(n, "rad")) for n in SENSORS for tail in ("", "_valid")])
STATE = dtype(
    [
        ("r", "f8", "-"),  # largest row, or noise, over its threshold
        ("alarm", "f8", "-"),
        ("verdict", "f8", "-"),  # SENSOR, AMBIGUOUS
        ("isolated_part", "f8", "-"),  # index into ISOLABLE_PARTS
        ("valid", "f8", "-"),
        ("why", "f8", "-"),  # code of fdi.common.why, 0 while valid
        ("res", "f8", (NR,), "rad, m/s, m, -"),  # residuals through the lag, less what was learned
        ("fired", "f8", (NR,), "s"),  # time for which a row still counts as fired
        ("jumped", "f8", (NR,), "s"),  # time for which it still counts as jumped
        ("raw", "f8", (NR,)),  # residuals
        ("last", "f8", (NR,)),  # at the tick before
        ("seen", "f8", (NR,)),  # 1 where the tick before had one
        ("model", "f8", (NR,)),  # states of the rows that integrate
        ("rate", "f8", (NR,)),  # what they integrated last
        ("live", "f8", (NR,)),  # 1 where all sensors of a row are usable
        ("lateral", "f8", (NR,), "-"),  # share of an error of the lateral velocity that a row may show
        ("sideslip", "f8", "rad"),  # its mean and mean square, as the vane has it
        ("square", "f8", "rad2"),
        ("rough", "f8", "m/s"),  # rms of lateral gusts
        *wind.STATE,
        ("offset", "f8", (NR,)),
        ("limit", "f8", (NR,)),  # thresholds now
        ("grown", "f8", (NR,), "-"),  # what threshold and jump grow by where readings have more noise than specified
        ("y", "f8", (NS,)),  # readings
        ("ok", "f8", (NS,)),
        ("y_1", "f8", (NS,)),  # and those of the two ticks before
        ("y_2", "f8", (NS,)),
        ("ticks", "f8", (NS,)),  # usable in a row, at most 3
        ("level", "f8", (NS,)),  # learned mean square of the second difference
        ("power", "f8", (NS,)),  # the same now
        ("ratio", "f8", (NS,), "-"),  # over what it may be at this speed
        ("speed", "f8", "m/s"),  # over the ground, where it was learned
        ("age", "f8", "s"),
        ("n_learn", "f8", "-"),
        ("known", "f8", (NR,)),  # 1 where a sensor that is named is read
        ("since", "f8", "s"),  # time since the first of the others fired, 0 while none has
        ("integral", "f8", (5,)),  # over that time: roll, heading, speed over the ground, across the heading, airspeed
        ("strayed", "f8", (5,), "rad, m/s"),  # the readings less those
        ("expected", "f8", (4,), "m/s"),  # by an error of the sensor NEEDED of each pair: of the last or the one before
        ("rolled", "f8", "rad s"),  # integral of what roll has strayed
        ("noisy", "f8", "-"),  # 1 + sensor whose noise is wrong, 0 for none
        ("quiet", "f8", "s"),  # time since anything fired
        ("held", "f8", (NR,)),  # residuals that were beyond their thresholds, the last of each row
        ("refuted", "f8", "s"),  # time for which those of the named error would be there and are not
        ("leapt", "f8", "-"),  # 1 where the reading that is named jumped at first
        ("shows", "f8", "-"),  # how that error shows: FADING, STAYING, NOISY, JUMPED_BACK
    ]
)
OUTPUTS = ("r", "alarm", "verdict", "isolated_part", "valid", "why", "res")
DETECTOR = Detector(
    id="kinematic",
    level="aircraft",
    summary="sensors of the aircraft against each other by kinematic relations [Eykeren14]",
    inputs={name: name for name in SENSORS},
    group="airframe motion",
    designed_for={f"sensor.{name}": ("sensor",) for name in dict.fromkeys(c[0] for c in table.SIGNATURES)}
    | {"sensor.alpha": ("sensor", "ambiguous"), "sensor.beta": ("sensor", "ambiguous"), "sensor.n_y": ("sensor",)},
    blind="no force enters: neither effectors nor actuators; of alpha, beta and n_y it sees noise and a frozen reading",
    any_aircraft=True,
    shares=tuple((*pair, " or ".join(pair)) for pair in table.PAIRS),
    # by two of three speeds: a fault of one, of Mach number or altitude is to be named, however large
    range=dict.fromkeys(SPEEDS, FLYING),
    fit=lambda site: params(dt=site.dt, own=site.own),
)


def params(which: str = "flight", *, dt: float = TICK, t_learn: float = LEARN_S, own: Folder = None) -> np.ndarray:
    """Return PARAMS with the threshold set `which`, trained at ticks of TICK, for those of `dt` seconds; offsets and
    noise are learned over the first `t_learn` seconds.

    With longer ticks the lag of the residuals averages fewer samples, and gusts change more from one to the next; with
    shorter ones each sample is noisier, and so is what it may differ by from the one before.
    """
    limits, longer = thresholds("kinematic", which, own), max(dt / TICK, 1.0)
    limits["jump"] = [math.sqrt(max(TICK / dt, 1.0)) * v for v in limits["jump"]]
    limits["threshold"] = [math.sqrt(longer) * v for v in limits["threshold"]]
    limits["noise_ratio"] = 1.0 + longer * (limits["noise_ratio"] - 1.0)
    return record(PARAMS, t_learn=t_learn, **limits)


init = zero_state(STATE)  # nothing learned


@kernel
def _jumps(x, p, i, dt):
    """Note whether row i jumped; return whether it did."""
    leap = x.raw[i] - x.last[i] if x.live[i] * x.seen[i] > 0.5 else 0.0
    jumps = math.fabs(leap) > p.jump[i] * x.grown[i]
    x.jumped[i] = p.t_hold if jumps else max(x.jumped[i] - dt, 0.0)
    x.last[i], x.seen[i] = x.raw[i], x.live[i]
    return jumps


@kernel
def _residuals(x, p, dt):
    """Learn offsets, lag the residuals, note what fires and what jumps; return the largest over its threshold."""
    c, largest, fades, back = 1.0 - math.exp(-dt / p.tau_r), 0.0, -1, False
    if x.alarm > 0.5 and x.verdict == SENSOR:
        fades = table.FADES[int(x.isolated_part) - 1]
    for i in range(NR):
        x.fired[i] = max(x.fired[i] - dt, 0.0)
        jumps = _jumps(x, p, i, dt)
        back = back or (jumps and i == fades)
        if x.live[i] < 0.5:
            x.res[i] = 0.0
        elif x.age > p.t_learn:
            x.res[i] += c * (x.raw[i] - x.offset[i] - x.res[i])
            r = math.fabs(x.res[i]) / x.limit[i]
            largest = max(largest, r)
            if r >= 1.0:
                x.fired[i], x.held[i] = p.t_hold, x.res[i]
        elif x.age > p.t_settle and i != CLIMB:  # its own in fdi/kinematic/wind.py
            x.offset[i] += (x.raw[i] - x.offset[i]) / max(x.n_learn, 1.0)
    if back:
        _restart(x)
    elif x.shows == STAYING:
        _saturate(x)
    return largest


@kernel
def _restart(x):
    """Start what integrates anew from the reading that is right again [Lu15]."""
    x.shows = JUMPED_BACK
    for i in range(NR):
        if table.KNOWN[int(x.isolated_part), i] > 0.5:
            x.seen[i], x.res[i], x.fired[i] = 0.0, 0.0, 0.0


@kernel
def _saturate(x):
    """Keep what a named error has left in the rows that integrate it within LEFT thresholds, so that it fades in
    seconds once the error has ended, however large that was [Lu15]."""
    for i in range(NR):
        e = x.raw[i] - x.offset[i]
        excess = math.fabs(e) - LEFT * x.limit[i]
        if table.KNOWN[int(x.isolated_part), i] * table.INTEGRATES[i] > 0.5 and excess > 0.0:
            x.model[i] += math.copysign(excess, e)
            x.raw[i] -= math.copysign(excess, e)
            x.last[i] = x.raw[i]


@kernel
def _noise(x, p, dt):
    """Judge each reading by its second difference; set x.noisy, return the largest ratio over its threshold."""
    c, largest, x.noisy = 1.0 - math.exp(-dt / p.tau_noise), 0.0, 0.0
    if x.ok[15] > 0.5 and p.t_settle < x.age <= p.t_learn:
        x.speed += (x.y[15] - x.speed) / max(x.n_learn, 1.0)
    f = min(max(x.y[15] / x.speed, 0.25), 4.0) if x.ok[15] > 0.5 and x.speed > 0.0 else 1.0
    grown = (1.0, max(1.0, f), max(1.0, 1.0 / f), max(1.0, f * f * f))
    for i in range(NS):
        if x.ticks[i] < 2.5:
            continue
        d = x.y[i] - 2.0 * x.y_1[i] + x.y_2[i]
        if i == 5 and math.fabs(d) > 1.0:  # the heading passes 2 pi
            continue
        if x.age <= p.t_learn:
            if x.age > p.t_settle:
                x.level[i] += (d * d - x.level[i]) / max(x.n_learn, 1.0)
            x.power[i] = x.level[i]
            continue
        if x.level[i] <= 0.0:
            continue
        # a single jump is no noise: it counts as what three sigma of noise at the threshold would be
        level = x.level[i] * grown[POWER[i]]
        x.power[i] += c * (min(d * d, 9.0 * p.noise_ratio * level) - x.power[i])
        x.ratio[i] = x.power[i] / level
        loud = max(x.ratio[i] / p.noise_ratio, p.frozen_ratio * x.level[i] / max(x.power[i], 1e-12 * x.level[i]))
        if loud > largest:
            largest = loud
            if loud >= 1.0:
                x.noisy = i + 1.0
    return largest


@kernel
def _hidden(x, s, i):
    """Return whether the threshold of row i may hide what signature s, which shows in its first row, does there."""
    first, power = table.FIRST_ROW[s], table.SPEED_POWERS[s, i]
    fast = x.y[15] if power > 0.0 else 1.0 / max(x.y[15], 1.0) if power < 0.0 else 1.0
    size = math.fabs(x.res[first]) * table.SIZES[s, i] * fast
    return x.fired[first] > 0.0 and table.SIZES[s, i] > 0.0 and size <= HIDDEN * x.limit[i]


@kernel
def _explains(x, s):
    """Return whether signature s explains what fired and jumped in the rows that are not x.known: of the rows of one
    unit its first shows it most."""
    first = table.FIRST_ROW[s]
    if x.known[first] > 0.5 or (table.JUMPS[s] > 0.5 and x.jumped[first] <= 0.0):
        return False
    for i in range(NR):
        if x.known[i] > 0.5:
            continue
        if table.JUMPS[s] < -0.5 and table.INTEGRATES[i] * x.jumped[i] > 0.0:
            return False
        larger = table.UNIT[i] == table.UNIT[first] and math.fabs(x.held[i]) > math.fabs(x.held[first])
        if x.fired[i] > 0.0 and (larger or table.MAY[s, i] < 0.5):
            return False
        if x.fired[i] <= 0.0 and table.MUST[s, i] > 0.5 and not _hidden(x, s, i):
            return False
    return True


@kernel
def _named(x):
    """Return (number of sensors that explain what fired, the last of them + 1); the two of a pair are one."""
    count, best, pair, both = 0, 0, 0, False
    for s in range(table.NC):
        if best != table.OF[s] + 1 and _explains(x, s):
            count += 1
            best = table.OF[s] + 1
            both, pair = count == 2 and pair > 0 and pair == table.PAIR_OF[s], table.PAIR_OF[s]
    return (1, _of_pair(x, pair)) if count == 2 and both else (count, float(best))


@kernel
def _of_pair(x, pair):
    """Return the sensor of a pair that the velocity through the air tells to be wrong, or the pair: the logarithm of
    the ratio of the likelihoods that it has strayed as expected of the one and not at all, which gusts may make it."""
    k = pair - EITHER
    sd = STRAY_SD + STRAY_RATE * x.since + GUSTS_SD * x.rough
    strayed = x.strayed[4 if k == 3 else 3]
    told = x.expected[k] * (2.0 * strayed - x.expected[k]) / (2.0 * sd * sd)
    return float(pair if math.fabs(told) < TOLD else table.NEEDED[k] if told > 0.0 else table.OTHER[k])


@kernel
def _blame(x, part, shows):
    """Name a part; of the rows that read its sensor the search for another one makes nothing."""
    x.alarm, x.verdict, x.isolated_part, x.shows = 1.0, SENSOR, part, shows
    if part < EITHER:
        for i in range(NR):
            x.known[i] = max(x.known[i], table.KNOWN[int(part), i])


@kernel
def _seek(x, p):
    """Name the sensor when the rows that belong together are in, or say that there is none; beside one that is named
    another one by rows that do not read it."""
    if x.noisy > 0.5:  # a reading tells of itself, rows of all that they read
        _blame(x, x.noisy, NOISY)
    elif x.since >= p.t_collect:
        count, best = _named(x)
        if count == 1 and (x.isolated_part < EITHER or table.HOLDS[int(x.isolated_part), int(best)] > 0.5):
            row = table.FADES[int(best) - 1]
            _blame(x, best, FADING if row >= 0 and best < EITHER else STAYING)
            x.leapt = 1.0 if row >= 0 and x.jumped[row] > 0.0 else 0.0
        elif x.alarm < 0.5 and x.since >= p.t_ambiguous:
            x.alarm, x.verdict = 1.0, AMBIGUOUS


@kernel
def _decide(x, p, dt):
    """Name what is wrong; hold the alarm for t_release, or as the error ends."""
    unknown = False
    for i in range(NR):
        unknown = unknown or x.fired[i] * (1.0 - x.known[i]) > 0.0
    x.quiet = 0.0 if x.fired.any() or x.noisy > 0.5 else x.quiet + dt
    x.since = x.since + dt if unknown else 0.0
    _seek(x, p)
    if x.alarm < 0.5:
        x.refuted = 0.0
        return
    x.refuted = 0.0 if x.r >= 1.0 else x.refuted + dt if _would_show(x) else x.refuted
    longest = OFF_S if x.shows == FADING and x.leapt > 0.5 else p.t_release
    if x.quiet > longest or x.refuted > SHOWN_S:
        _clear(x)


@kernel
def _would_show(x):
    """Return whether the named error would be at a threshold now if it were as it was, and is not."""
    if x.shows != STAYING:
        return x.shows > STAYING
    for i in range(NR):
        held = math.fabs(x.held[i])
        if (
            table.CONSTANT_IN[int(x.isolated_part) - 1, i] > 0.5
            and held >= SEEN * x.limit[i]
            and math.fabs(x.res[i]) < 0.5 * held
        ):
            return True
    return False


@kernel
def _clear(x):
    x.alarm, x.verdict, x.isolated_part = 0.0, NONE, 0.0
    x.shows = x.refuted = x.leapt = x.since = x.quiet = 0.0
    x.fired[:] = x.held[:] = x.known[:] = 0.0


@kernel
def _flies(u):
    """Return whether fewer than two of the three speeds, or than all that are left, lie outside of what flies."""
    left, out = 0.0, 0.0
    for value, valid in ((u.tas, u.tas_valid), (u.cas, u.cas_valid), (u.v_ground, u.v_ground_valid)):
        left += usable(value, valid)
        out += box(value, valid, FLYING, 1.0, 0.0)
    return out < 1.0 or out < min(left, 2.0)


@kernel
def step(x, u, p, dt):
    """Read, compare, decide. Out of range nothing is read: what integrates starts anew afterwards, and learning does
    where it was not done."""
    flies = _flies(u)
    read(x, u, flies)
    compare(x, p, dt)
    x.age += dt
    if not flies and x.age <= p.t_learn:
        x.age, x.n_learn = 0.0, 0.0
        x.offset[:] = x.level[:] = 0.0
    if p.t_settle < x.age <= p.t_learn:
        x.n_learn += 1.0
    r = max(_residuals(x, p, dt), _noise(x, p, dt))
    if x.age <= p.t_learn:
        weigh(x)
    ready = VALID if x.live.any() else LOST_SENSOR
    x.why = BOX_SPEED if not flies else NOT_READY if x.age <= p.t_learn else ready
    x.valid = 1.0 if x.why == VALID else 0.0
    x.r = r if x.valid > 0.5 else 0.0
    if x.valid > 0.5:
        _decide(x, p, dt)
    else:
        _clear(x)


rollout = entry(step, STATE, INPUTS, PARAMS)
