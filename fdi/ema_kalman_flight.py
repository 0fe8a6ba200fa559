"""Sensor faults of an electromechanical elevator actuator from one Kalman filter on the motor velocity, fit for flight.

[Jay]'s filter with what an elevator adds to the bench: the hinge moment HM0 + HM_delta x1 of a model enters the
prediction, its stiffness stands inside A, and what that model misses is a bounded load d (first-order Gauss-Markov).

    x = [x1 surface, x2 rate, x3 motor angle, x4 rate, x5 current, d],   x+ = Phi(HM_delta) x + G u + G_h HM0 + K gamma

Three relations, and the table that they make; each sensor fault breaks its own set:

    velocity-torque   mean of the last N innovations, against a share of the motor's impulse: loads do not jump so
    position-velocity jump of R1 = y_position - pos_hat over LAG ticks: kinematics alone, no load enters
    current-demand    R2 = y_current - x5: the current loop is stiff, no load enters

    torque  kinematics  current  verdict
      x         x                velocity sensor
      -         x                position sensor: `reconf`, close the loop on pos_hat
      -         -          x     current sensor
      -         ramp             AMBIGUOUS: a small velocity bias or a drifting position; the loop stays where it is
      x         -                no sensor: the load estimate decides (JAM_SOLID at rest, EFFECTIVENESS in motion)

While all is well, pos_hat is tied to the position sensor by a slow second Kalman filter on (offset c, rate b): it
learns the velocity sensor's small bias. From the first suspicion on it runs free, and its covariance is pos_sigma.
"""

import math

import numpy as np

from actuators import jay
from actuators.block import dtype, kernel, record
from fdi.decision import confirm, usable
from fdi.ema_design import gain, model
from fdi.ema_kalman import CULPRITS, CURRENT, POSITION, VELOCITY
from fdi.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, SENSOR

__all__ = ["CULPRITS", "INPUTS", "OUTPUTS", "PARAMS", "STATE", "init", "params", "rollout", "step"]

N = 10  # samples of the innovation mean; [Jay] section 4.1
LAG, MEAN = 20, 5  # R1's jump: mean of the last 5 ticks against that of the 5 ticks 0.1 s ago

PARAMS = dtype([
    ("Phi", "f8", (6, 6)),    # transition over one tick without hinge stiffness, SI
    ("Phi_h", "f8", (6, 6)),  # its derivative by the hinge stiffness [per N m/rad]
    ("G", "f8", (6,)),        # of the demanded current
    ("G_h", "f8", (6,)),      # of the hinge moment
    ("K", "f8", (6,)),        # steady Kalman gain on the velocity [per rad/s]
    ("S_root", "f8"),         # standard deviation of the innovation [rad/s]
    ("lead", "f8"),           # ball screw [m/rad]
    ("ratio", "f8"),          # surface per motor angle, spring at rest [-]
    ("spring", "f8"),         # l^2 K_s [N m/rad]
    ("impulse", "f8"),        # velocity change per ampere and tick [rad/s/A]
    ("K_gi", "f8"),           # drive: volts per ampere demanded [V/A]
    ("R_loop", "f8"),         # K_i K_c + R [Ohm]
    ("R", "f8"),              # winding [Ohm]
    ("K_B", "f8"),            # [V s/rad]
    ("I_max", "f8"),          # limits of the amplifier [A], [V]
    ("V_max", "f8"),
    ("delay", "f8"),          # ticks by which the sensors lag, 0 or 1
    ("sigma_pos", "f8"),      # position sensor noise [m]
    ("sigma_rig", "f8"),      # its rigging bias, which nothing here can see [m]
    ("sigma_vel", "f8"),      # velocity sensor noise [rad/s]
    ("sigma_b", "f8"),        # its bias at engage [rad/s]
    ("walk_b", "f8"),         # and that bias's random walk per tick [rad/s]
    ("b_max", "f8"),          # largest velocity bias that is learned [rad/s]
    ("sigma_tie", "f8"),      # position noise that the anchor assumes: large, so that it ties slowly [m]
    ("th_vel", "f8"),         # innovation mean: fixed part [rad/s]
    ("rho_vel", "f8"),        # and share of the motor's impulse [-]
    ("rho_rate", "f8"),       # and of the motor rate: back electromotive force, friction, load per tick [-]
    ("th_cur", "f8"),         # R2: fixed part [A]
    ("rho_cur", "f8"),        # and per motor rate [A s/rad]
    ("th_jump", "f8"),        # jump of R1 [m]
    ("th_both", "f8"),        # smaller jump that confirms a velocity fault [m]
    ("th_R1", "f8"),          # ramp of R1 [m]
    ("th_load", "f8"),        # load that no hinge explains [N m]
    ("gate", "f8"),           # innovation beyond which a sample is no sample [rad/s]
    ("share_hi", "f8"),       # a jump of which the innovations explain more is the velocity's [-]
    ("share_lo", "f8"),       # less: the position's; between: ambiguous
    ("th_need", "f8"),        # a velocity error that would have grown more slowly might have passed unseen [rad/s]
    ("sigma_max", "f8"),      # pos_sigma above which the estimate is not valid [m]
    ("t_vel", "f8"),          # confirmation times [s]
    ("t_cur", "f8"),
    ("t_jump", "f8"),
    ("t_ramp", "f8"),
    ("t_load", "f8"),
    ("t_hold", "f8"),         # the innovations are remembered for [s]
    ("t_bad", "f8"),          # velocity samples missing or rejected for longer: start again, or a fault [s]
    ("t_start", "f8"),        # after engage: the load estimate settles, no test counts [s]
    ("t_heal", "f8"),         # agreement that ends an alarm [s]
    ("heal_travel", "f8"),    # and the rod travel that it must have seen [m]
])
INPUTS = dtype([
    ("u", "f8"),              # demanded current held over the tick that ends at this sample [A]
    ("y_velocity", "f8"),     # motor rate [rad/s]
    ("y_position", "f8"),     # rod position, + extends [m]
    ("y_current", "f8"),      # motor current, the monitor's copy [A]
    ("velocity_valid", "f8"),
    ("position_valid", "f8"),
    ("current_valid", "f8"),
    ("hm0_model", "f8"),      # hinge moment at zero deflection, + trailing edge down, by the model [N m]
    ("hmd_model", "f8"),      # its slope, negative where it centres [N m/rad]
])
STATE = dtype([
    ("r", "f8"),              # largest test over its threshold
    ("alarm", "f8"),          # 1 while a fault is declared
    ("verdict", "f8"),        # NONE, SENSOR or AMBIGUOUS
    ("culprit", "f8"),        # index into CULPRITS
    ("valid", "f8"),          # 1 while pos_hat can be trusted
    ("reconf", "f8"),         # 1: close the loop on pos_hat
    ("pos_hat", "f8"),        # estimated rod position, as the healthy sensor would read it [m]
    ("pos_sigma", "f8"),      # its standard deviation [m]
    ("f_hat", "f8"),          # size of the declared fault [m], [rad/s] or [A]
    ("f_sigma", "f8"),        # its standard deviation, same unit
    ("eta", "f8"),            # normalised innovation (6)
    ("eta_bar", "f8"),        # mean of the last N (7)
    ("R1", "f8"),             # (9) [m]
    ("R2", "f8"),             # (9) [A]
    ("jump", "f8"),           # change of R1 over LAG ticks [m]
    ("load_hat", "f8"),       # hinge moment that the model misses [N m]
    ("r_velocity", "f8"),     # the tests over their thresholds
    ("r_current", "f8"),
    ("r_jump", "f8"),
    ("x_hat", "f8", (6,)),    # [rad, rad/s, rad, rad/s, A, N m]
    ("started", "f8"),        # 1 once engaged
    ("age", "f8"),            # since engage [s]
    ("age_vel", "f8"),        # since the last velocity sample that was used [s]
    ("age_gate", "f8"),       # for how long samples have been rejected as impossible [s]
    ("age_hot", "f8"),        # since the velocity test was last beyond its threshold [s]
    ("hi", "f8"),             # what the filter took from the velocity sensor within N ticks: fading peaks [rad/s]
    ("lo", "f8"),
    ("need_hi", "f8"),        # velocity error that R1's motion would need, its change within N ticks: fading peaks
    ("need_lo", "f8"),
    ("need", "f8"),           # that of the jump's sign [rad/s]
    ("share", "f8"),          # part of it that was taken [-]
    ("u_last", "f8"),         # [A]
    ("at_limit", "f8"),       # 1: the amplifier is at its voltage limit
    ("hm0", "f8"),            # last finite values [N m], [N m/rad]
    ("hmd", "f8"),
    ("drift", "f8"),          # y_position - N x3 [m]
    ("c", "f8"),              # anchor: its line at this tick [m]
    ("b", "f8"),              # and slope [m/s]
    ("P_cc", "f8"),           # covariance of both [m^2], [m^2/s], [m^2/s^2]
    ("P_cb", "f8"),
    ("P_bb", "f8"),
    ("timer_vel", "f8"),      # confirmation [s]
    ("timer_cur", "f8"),
    ("timer_jump", "f8"),
    ("timer_ramp", "f8"),
    ("timer_load", "f8"),
    ("hot_vel", "f8"),        # confirmed
    ("hot_cur", "f8"),
    ("hot_jump", "f8"),
    ("hot_ramp", "f8"),
    ("hot_load", "f8"),
    ("agree", "f8"),          # time without any test beyond its threshold [s]
    ("low", "f8"),            # and the span of pos_hat in that time [m]
    ("high", "f8"),
    ("head", "f8"),           # write positions
    ("tail", "f8"),
    ("window", "f8", (N,)),   # innovations [rad/s]
    ("effort", "f8", (N,)),   # size of the motor's impulse per tick [rad/s]
    ("drifts", "f8", (LAG,)), # past values of `drift` [m]
    ("jumps", "f8", (N,)),    # and of `jump` [m]
    ("work", "f8", (6,)),     # scratch
])
OUTPUTS = (
    "r", "alarm", "verdict", "culprit", "valid", "reconf", "pos_hat", "pos_sigma", "f_hat", "f_sigma", "eta", "eta_bar",
    "R1", "R2", "jump", "load_hat", "r_velocity", "r_current", "r_jump",
)  # fmt: skip

DEG = math.pi / 180.0


def params(*, dt=0.005, delay=1, sigma_velocity=1.0, sigma_position=1e-4, sigma_load=200.0, tau_load=2.0, q_vel=1.0, **overrides):
    v = jay.values("elevator", **overrides)
    Phi, Phi_h, G, G_h = model(v, dt, tau_load)
    K, S_root = gain(Phi - 2.0e4 * Phi_h, sigma_load, tau_load, q_vel, sigma_velocity, dt)
    arm, no_load = v["arm"], jay.LIMITS["elevator"][1] / v["K_B"]
    return record(
        PARAMS, Phi=Phi, Phi_h=Phi_h, G=G, G_h=G_h, K=K, S_root=S_root, lead=v["lead"], ratio=v["lead"] / arm,
        spring=arm * arm * v["K_s"], impulse=v["K_T"] / (v["J_M"] + v["J_N"] * (v["lead"] / arm) ** 2) * dt,
        K_gi=v["K_gi"], R_loop=v["K_ic"] + v["R"], R=v["R"], K_B=v["K_B"], I_max=jay.LIMITS["elevator"][0],
        V_max=jay.LIMITS["elevator"][1], delay=float(delay), sigma_pos=sigma_position, sigma_rig=0.08 * DEG * arm, sigma_vel=sigma_velocity,
        sigma_b=2e-4 * no_load, walk_b=1e-4 * no_load * math.sqrt(dt / 100.0), b_max=1e-3 * no_load,
        sigma_tie=1.0 * DEG * arm, th_vel=6.0, rho_vel=0.12, rho_rate=0.005, share_hi=0.65, share_lo=0.45, th_need=20.0, th_cur=1.2, rho_cur=0.012, th_jump=0.3 * DEG * arm,
        th_both=0.15 * DEG * arm, th_R1=0.4 * DEG * arm, th_load=0.6 * 15.75e3, gate=0.3 * no_load,
        sigma_max=0.5 * DEG * arm, t_vel=0.06, t_cur=0.04, t_jump=0.03, t_ramp=0.3, t_load=0.3, t_hold=0.25, t_bad=0.05,
        t_start=0.5, t_heal=5.0, heal_travel=2.0 * DEG * arm,
    )  # fmt: skip


def init(p):
    """Return STATE of p's shape, not engaged: the first usable position sample engages it."""
    return np.zeros(p.shape, STATE)


@kernel
def _engage(x, u, p):
    x.x_hat[2] = u.y_position / p.lead
    x.x_hat[0] = (p.ratio * p.spring * x.x_hat[2] + x.hm0) / (p.spring - x.hmd)
    x.x_hat[3] = u.y_velocity if usable(u.y_velocity, u.velocity_valid) > 0.5 else 0.0
    x.x_hat[1] = p.ratio * x.x_hat[3]
    x.x_hat[4] = u.y_current if usable(u.y_current, u.current_valid) > 0.5 else 0.0
    x.pos_hat = u.y_position
    x.P_cc = p.sigma_pos * p.sigma_pos
    x.P_bb = (p.lead * p.sigma_b) * (p.lead * p.sigma_b)
    x.started = 1.0
    x.age_hot = p.t_hold


@kernel
def _limited(demand, omega, p):
    """Return (demand, at V_max): the demand that without limits gives the limited current, quasi-steady as in `ema`."""
    back = p.K_B * omega
    i = (p.K_gi * demand - back) / p.R_loop
    g = min(max(i, -p.I_max), p.I_max)
    volts = p.R * g + back
    if math.fabs(volts) > p.V_max:
        g = (math.copysign(p.V_max, volts) - back) / p.R
        return (g * p.R_loop + back) / p.K_gi, 1.0
    return demand if g == i else (g * p.R_loop + back) / p.K_gi, 0.0


@kernel
def _predict(x, demand, p):
    demand, x.at_limit = _limited(demand, x.x_hat[3], p)
    for i in range(6):
        s = p.G[i] * demand + p.G_h[i] * x.hm0
        for j in range(6):
            s += (p.Phi[i, j] + x.hmd * p.Phi_h[i, j]) * x.x_hat[j]
        x.work[i] = s
    for i in range(6):
        x.x_hat[i] = x.work[i]


@kernel
def _velocity(x, u, p, dt):
    """Correct by the velocity sample, unless it is missing or impossible, and form its test."""
    gamma = 0.0
    seen = usable(u.y_velocity, u.velocity_valid) > 0.5
    if seen:
        gamma = u.y_velocity - x.x_hat[3]
    possible = math.fabs(gamma) < p.gate
    x.age_gate = x.age_gate + dt if seen and not possible else 0.0
    if seen and (possible or x.age_gate > p.t_bad):
        x.age_vel = 0.0
        for i in range(6):
            x.x_hat[i] += p.K[i] * gamma
    else:
        x.age_vel += dt
        gamma = 0.0
    x.eta = gamma / p.S_root
    head = int(x.head)
    # at the voltage limit 5 % of K_B is worth more than the stall current: such a tick says nothing
    x.window[head] = 0.0 if x.at_limit > 0.5 else gamma
    x.effort[head] = p.impulse * math.fabs(x.x_hat[4])
    x.head = float((head + 1) % N)
    mean = 0.0
    effort = 0.0
    for i in range(N):
        mean += x.window[i] / N
        effort += x.effort[i] / N
    x.eta_bar = mean / p.S_root
    x.r_velocity = math.fabs(mean) / (p.th_vel + p.rho_vel * effort + p.rho_rate * math.fabs(x.x_hat[3]))
    fade = 1.0 - dt / p.t_hold
    taken = N * mean * p.K[3]
    x.hi = max(x.hi * fade, taken)
    x.lo = min(x.lo * fade, taken)


@kernel
def _jump(x, p, dt):
    """Form the jump of R1 and the share of it that a velocity error of the size taken in would have made."""
    tail = int(x.tail)
    x.drifts[tail] = x.drift
    x.tail = float((tail + 1) % LAG)
    x.jump = 0.0
    for i in range(MEAN):
        x.jump += (x.drifts[(tail + LAG - i) % LAG] - x.drifts[(tail + 1 + i) % LAG]) / MEAN
    x.r_jump = math.fabs(x.jump) / p.th_jump
    head = int(x.head)  # of the innovations' window, already moved on
    change = (x.jumps[head] - x.jump) / (p.lead * (LAG - MEAN) * dt)
    x.jumps[head] = x.jump
    fade = 1.0 - dt / p.t_hold
    x.need_hi = max(x.need_hi * fade, change)
    x.need_lo = min(x.need_lo * fade, change)
    # a velocity that reads high moves pos_hat up and R1 down
    x.need = x.need_hi if x.jump < 0.0 else -x.need_lo
    taken = x.hi if x.jump < 0.0 else -x.lo
    x.share = min(taken / max(x.need, 1e-3), 9.9)


@kernel
def _tie(x, p):
    """Correct (c, b) by R1: a scalar Kalman update of two states."""
    S = x.P_cc + p.sigma_tie * p.sigma_tie
    k_c, k_b = x.P_cc / S, x.P_cb / S
    x.c += k_c * x.R1
    x.b = min(max(x.b + k_b * x.R1, -p.b_max * p.lead), p.b_max * p.lead)
    x.P_bb -= k_b * x.P_cb
    x.P_cb -= k_b * x.P_cc
    x.P_cc -= k_c * x.P_cc


@kernel
def _position(x, u, p, dt, back):
    """Form R1 and its jump; tie the anchor while nothing is suspected; `back`: velocity returns after a gap."""
    walk, wander = p.lead * p.sigma_vel * dt, p.lead * p.walk_b
    x.c += x.b * dt
    x.P_cc += 2.0 * dt * x.P_cb + dt * dt * x.P_bb + walk * walk
    x.P_cb += dt * x.P_bb
    x.P_bb += wander * wander
    seen = usable(u.y_position, u.position_valid) > 0.5
    if seen:
        x.drift = u.y_position - p.lead * x.x_hat[2]
        if back or x.age == dt:
            x.c = x.drift
            for i in range(LAG):
                x.drifts[i] = x.drift
        x.R1 = x.drift - x.c
    _jump(x, p, dt)
    if seen and x.culprit == VELOCITY:
        x.c += dt * x.R1  # follow the position, a second late: what is left in R1 says whether the velocity has healed
    elif seen and x.age_vel == 0.0 and x.alarm < 0.5:
        if max(x.r_velocity, x.r_jump) < 1.0 and math.fabs(x.R1) < p.th_R1:
            _tie(x, p)
    x.pos_hat = p.lead * x.x_hat[2] + x.c
    x.pos_sigma = math.sqrt(p.sigma_rig * p.sigma_rig + x.P_cc)


@kernel
def _decide(x, p, dt):
    """Confirm the tests and read the table; a sensor once named stays named until it heals."""
    counts = x.age >= p.t_start
    ramp = math.fabs(x.R1) / p.th_R1
    hot = x.age_hot < p.t_hold and x.share >= p.share_hi
    both = math.fabs(x.jump) >= p.th_both and (hot or x.age_gate > p.t_bad)
    x.age_hot = 0.0 if x.r_velocity >= 1.0 else x.age_hot + dt
    clear = counts and x.age_hot > p.t_hold and math.fabs(x.jump) < p.th_both  # a velocity fault reaches R2 through the back electromotive force
    x.timer_vel, x.hot_vel = confirm(x.timer_vel, x.hot_vel, counts and both, dt, p.t_vel, 0.0)
    x.timer_jump, x.hot_jump = confirm(x.timer_jump, x.hot_jump, counts and x.r_jump >= 1.0, dt, p.t_jump, 0.0)
    x.timer_cur, x.hot_cur = confirm(x.timer_cur, x.hot_cur, clear and x.r_current >= 1.0, dt, p.t_cur, 0.0)
    x.timer_ramp, x.hot_ramp = confirm(x.timer_ramp, x.hot_ramp, counts and ramp >= 1.0, dt, p.t_ramp, 0.0)
    heavy = counts and math.fabs(x.x_hat[5]) >= p.th_load
    x.timer_load, x.hot_load = confirm(x.timer_load, x.hot_load, heavy, dt, p.t_load, 0.0)
    x.r = max(max(x.r_velocity, x.r_current), max(x.r_jump, ramp))
    if x.culprit == VELOCITY or x.culprit == POSITION:
        return
    sharp = x.hot_jump > 0.5 and x.need >= p.th_need
    if x.hot_vel > 0.5 or (sharp and x.share >= p.share_hi):
        x.culprit, x.verdict, x.alarm = VELOCITY, SENSOR, 1.0
    elif sharp and x.share <= p.share_lo:
        x.culprit, x.verdict, x.alarm, x.reconf = POSITION, SENSOR, 1.0, 1.0
    elif x.alarm < 0.5:
        if x.hot_cur > 0.5:
            x.culprit, x.verdict, x.alarm = CURRENT, SENSOR, 1.0
        elif x.hot_load > 0.5:
            x.verdict, x.alarm = JAM_SOLID if math.fabs(x.x_hat[3]) < p.gate * 0.1 else EFFECTIVENESS, 1.0
        elif x.hot_ramp > 0.5:
            x.verdict, x.alarm = AMBIGUOUS, 1.0


@kernel
def _heal(x, p, dt):
    """End an alarm after agreement over both time and travel: a frozen sensor agrees as long as nothing moves."""
    apart = max(x.r_velocity, x.r_current) >= 1.0 or math.fabs(x.R1) >= 0.5 * p.th_R1 or x.hot_load > 0.5
    if x.alarm < 0.5 or apart:
        x.agree = 0.0
        x.low = x.high = x.pos_hat
        return
    x.agree += dt
    x.low = min(x.low, x.pos_hat)
    x.high = max(x.high, x.pos_hat)
    if x.agree >= p.t_heal and x.high - x.low >= p.heal_travel:
        x.alarm = x.reconf = x.culprit = x.agree = 0.0
        x.verdict = NONE


@kernel
def _size(x, p, dt):
    """State the declared fault's size in its sensor's unit."""
    x.f_hat = x.f_sigma = 0.0
    if x.culprit == POSITION:
        x.f_hat = x.R1
        x.f_sigma = math.sqrt(x.P_cc + p.sigma_pos * p.sigma_pos)
    elif x.culprit == CURRENT:
        x.f_hat = x.R2
        x.f_sigma = p.th_cur / 3.0  # the model's error, not the noise, limits it
    elif x.culprit == VELOCITY:
        x.f_hat = -x.jump / (p.lead * (LAG - MEAN) * dt)


@kernel
def step(x, u, p, dt):
    """Predict to this sample, correct, test, name, and say how well the position is known."""
    if math.isfinite(u.hm0_model) and math.isfinite(u.hmd_model):
        x.hm0, x.hmd = u.hm0_model, u.hmd_model
    demand = x.u_last
    if math.isfinite(u.u):
        x.u_last = u.u
        if p.delay < 0.5:
            demand = u.u
    if x.started < 0.5:
        if usable(u.y_position, u.position_valid) > 0.5:
            _engage(x, u, p)
        return
    x.age += dt
    gap = x.age_vel > p.t_bad
    _predict(x, demand, p)
    _velocity(x, u, p, dt)
    if usable(u.y_current, u.current_valid) > 0.5:
        x.R2 = u.y_current - x.x_hat[4]
    x.r_current = math.fabs(x.R2) / (p.th_cur + p.rho_cur * math.fabs(x.x_hat[3]))
    _position(x, u, p, dt, gap and x.age_vel == 0.0 and x.alarm < 0.5)
    _decide(x, p, dt)
    _heal(x, p, dt)
    _size(x, p, dt)
    x.load_hat = x.x_hat[5]
    fresh = x.age_vel < 0.2 and x.culprit != VELOCITY
    x.valid = 1.0 if fresh and x.pos_sigma < p.sigma_max else 0.0


@kernel
def rollout(x, u, p, dt, log):
    """Step every lane through every tick; x, p: (lane,), u, log: (lane, tick)."""
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            step(x[i], u[i, k], p[i], dt)
            log[i, k] = x[i]
