"""Servo and actuator in a loop with noisy, one tick old sensors, for the tests of both technologies."""

import numpy as np

from actuators import ema, ema_servo, hydraulic, servo

DT = 0.005
ROD, PRESSURE, VELOCITY = 1e-4, 0.005, 0.33  # 1 sigma: set `transport`, and the paper's 1 rad/s read as a peak


def fly_hydraulic(command, *, hm0=0.0, hmd=0.0, noise=1.0, seed=0, faults=None, actuator=None, control=None, start=0.0):
    """Return (truth, servo) logs over the ticks of `command` [rad].

    `faults(k, u, w)` may write the inputs of actuator and servo before tick k; both persist from tick to tick.
    """
    p = hydraulic.params() if actuator is None else actuator
    c = servo.params() if control is None else control
    rng = np.random.default_rng(seed)
    x = hydraulic.init_at(p, start, hm0, hmd)
    s = servo.init_at(c, start, x["F_d"])
    u, w = np.zeros((1, 1), hydraulic.INPUTS), np.zeros((1, 1), servo.INPUTS)
    row, srow = np.zeros((1, 1), hydraulic.STATE), np.zeros((1, 1), servo.STATE)
    log, slog = np.zeros(len(command), hydraulic.STATE), np.zeros(len(command), servo.STATE)
    u["hm0"], u["hmd"] = hm0, hmd
    w["q_valid"] = w["x3_valid"] = 1.0
    old = x["q_rod"][0], x["x3"][0]
    for k, angle in enumerate(command):
        log[k] = x[0]
        w["command"] = angle
        w["q_meas"] = old[0] + noise * ROD * rng.standard_normal()
        w["x3_meas"] = old[1] + noise * PRESSURE * rng.standard_normal()
        if faults:
            faults(k, u, w)
        old = x["q_rod"][0], x["x3"][0]
        servo.rollout(s, w, c, DT, srow)
        slog[k] = s[0]
        u["u"] = s["u"]
        hydraulic.rollout(x, u, p, DT, row)
    return log, slog


def fly_ema(command, *, hm0=0.0, hmd=0.0, noise=1.0, seed=0, faults=None, actuator=None, control=None, start=0.0):
    """Return (truth, servo) logs of the electromechanical loop; arguments as in `fly_hydraulic`."""
    p = ema.params() if actuator is None else actuator
    c = ema_servo.params() if control is None else control
    lead = p["lead"][0]
    rng = np.random.default_rng(seed)
    x = ema.init_at(p, start, hm0, hmd)
    s = ema_servo.init_at(c, lead * x["motor"], x["i"])
    u, w = np.zeros((1, 1), ema.INPUTS), np.zeros((1, 1), ema_servo.INPUTS)
    row, srow = np.zeros((1, 1), ema.STATE), np.zeros((1, 1), ema_servo.STATE)
    log, slog = np.zeros(len(command), ema.STATE), np.zeros(len(command), ema_servo.STATE)
    u["hm0"], u["hmd"] = hm0, hmd
    w["pos_valid"] = w["vel_valid"] = 1.0
    old = lead * x["motor"][0], x["motor_d"][0]
    for k, angle in enumerate(command):
        log[k] = x[0]
        w["command"] = angle
        w["pos_meas"] = old[0] + noise * ROD * rng.standard_normal()
        w["vel_meas"] = old[1] + noise * VELOCITY * rng.standard_normal()
        if faults:
            faults(k, u, w)
        old = lead * x["motor"][0], x["motor_d"][0]
        ema_servo.rollout(s, w, c, DT, srow)
        slog[k] = s[0]
        u["u"] = s["u"]
        ema.rollout(x, u, p, DT, row)
    return log, slog


def alone(module, seconds, *, p=None, start=(0.0, 0.0, 0.0), **signals):
    """Return the log of an actuator alone; `signals` are constants or arrays over the ticks for its INPUTS."""
    p = module.params() if p is None else p
    n = round(seconds / DT)
    u = np.zeros((1, n), module.INPUTS)
    for name, value in signals.items():
        u[name] = value
    x = module.init_at(p, *start)
    log = np.zeros((1, n), module.STATE)
    module.rollout(x, u, p, DT, log)
    return log[0]
