"""Servo and actuator in a loop with noisy, one tick old sensors, for the tests of both technologies."""

import math

import numpy as np

from actuators.ema import actuator as ema
from actuators.ema import servo as ema_servo
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import servo

DT = 0.005
ROD, PRESSURE, VELOCITY = 1e-4, 0.005, 0.33  # 1 sigma: set `transport`, and the paper's 1 rad/s read as a peak
COMMAND = math.radians(2.0) * np.where(np.arange(2000) // 100 % 2, 1.0, -1.0)  # 1 Hz square, 10 s [rad]
LOAD = {"hm0": -500.0, "hmd": -15e3}


def fly_hydraulic(command, *, hm0=0.0, hmd=0.0, noise=1.0, seed=0, faults=None, actuator=None, control=None, start=0.0):
    """Return (truth, servo) logs over the ticks of `command` [rad].

    `faults(k, u, w)` may write the inputs of actuator and servo before tick k; both persist from tick to tick.
    """
    p = hydraulic.params() if actuator is None else actuator
    c = servo.params() if control is None else control
    x = hydraulic.init_at(p, start, hm0, hmd)
    s = servo.init_at(c, start, x["F_d"])
    sensors = {"q": (lambda x: x["q_rod"][0], noise * ROD), "x3": (lambda x: x["x3"][0], noise * PRESSURE)}
    return _fly((hydraulic, x, p), (servo, s, c), command, sensors, (hm0, hmd), seed, faults)


def fly_ema(command, *, hm0=0.0, hmd=0.0, noise=1.0, seed=0, faults=None, actuator=None, control=None, start=0.0):
    """Return (truth, servo) logs of the electromechanical loop; arguments as in `fly_hydraulic`."""
    p = ema.params() if actuator is None else actuator
    c = ema_servo.params() if control is None else control
    lead = p["lead"][0]
    x = ema.init_at(p, start, hm0, hmd)
    s = ema_servo.init_at(c, lead * x["motor"], x["i"])
    sensors = {
        "pos": (lambda x: lead * x["motor"][0], noise * ROD),
        "vel": (lambda x: x["motor_d"][0], noise * VELOCITY),
    }
    return _fly((ema, x, p), (ema_servo, s, c), command, sensors, (hm0, hmd), seed, faults)


def _fly(actuator, control, command, sensors, load, seed, faults):
    """Return (truth, servo) logs of a loop of two (module, state, params); sensors by name: reading of x, 1 sigma."""
    (plant, x, p), (law, s, c) = actuator, control
    rng = np.random.default_rng(seed)
    u, w = np.zeros((1, 1), plant.INPUTS), np.zeros((1, 1), law.INPUTS)
    row, srow = np.zeros((1, 1), plant.STATE), np.zeros((1, 1), law.STATE)
    log, slog = np.zeros(len(command), plant.STATE), np.zeros(len(command), law.STATE)
    u["hm0"], u["hmd"] = load
    for name in sensors:
        w[f"{name}_valid"] = 1.0
    old = [read(x) for read, _ in sensors.values()]
    for k, angle in enumerate(command):
        log[k] = x[0]
        w["command"] = angle
        for (name, (_, sigma)), value in zip(sensors.items(), old):
            w[f"{name}_meas"] = value + sigma * rng.standard_normal()
        if faults:
            faults(k, u, w)
        old = [read(x) for read, _ in sensors.values()]
        law.rollout(s, w, c, DT, srow)
        slog[k] = s[0]
        u["u"] = s["u"]
        plant.rollout(x, u, p, DT, row)
    return log, slog


def step(degrees, seconds=4.0, at=1.0):
    """Return a step command [rad] over the ticks."""
    t = np.arange(round(seconds / DT)) * DT
    return math.radians(degrees) * (t >= at)


def there_and_back():
    """Return 10 s of command [rad] far beyond the travel: 4 s to -30 degrees, then to +30."""
    t = np.arange(2000) * DT
    return np.where((t > 1) & (t < 5), math.radians(-30), np.where(t >= 5, math.radians(30), 0.0))


def between(start=3.0, end=6.0, **values):
    """Return a fault writer: `values` of the actuator's inputs from `start` to `end` [s]."""

    def write(k, u, w):
        for name, v in values.items():
            u[name] = v if round(start / DT) <= k < round(end / DT) else 0.0

    return write


def liquid(k, u, w):
    """Add 1 degree to the command: a fault writer."""
    w["f_cmd"] = math.radians(1.0)


def solid(k, u, w):
    """Replace the command by -2 degrees: a fault writer."""
    w["s_cmd"], w["f_cmd"] = 1.0, math.radians(-2.0)


def predicted(model, command):
    """Return the surface [rad] over the ticks of `command` by a sampled linear loop, from rest."""
    z, out = np.zeros(len(model.A)), np.zeros(len(command))
    for k, c in enumerate(command):
        out[k] = (model.C @ z + model.D[:, 0] * c)[0]
        z = model.A @ z + model.B[:, 0] * c
    return out


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
