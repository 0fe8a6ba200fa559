"""The actuator technologies as the loop sees them: which blocks, with which parameters, in which equilibrium."""

import functools
import math

import numpy as np

from actuators.ema import actuator as ema
from actuators.ema import jay
from actuators.ema import servo as ema_servo
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import servo
from actuators.simple import actuator as simple
from cosim.errors import ScenarioError, did_you_mean
from cosim.flight.inject import Nominal

LEAD = jay.values("elevator")["lead"]  # screw travel per radian of motor [m/rad]
SENSOR_DELAY = 0.005  # of an actuator's sensors [s]
DRIVE_LIMIT = jay.LIMITS["elevator"][0]  # demand that 1 of u stands for [A]


def _scaled(nominal, multipliers, where):
    """Return {name: nominal times multiplier}; raises ScenarioError for a name that is no parameter."""
    for name in multipliers:
        if name not in nominal:
            raise ScenarioError(
                "no such parameter",
                place=f"tolerances.{where}.{name}",
                allowed=", ".join(nominal),
                remedy=did_you_mean(name, nominal),
            )
    return {k: nominal[k] * v for k, v in multipliers.items()}


def sensor_age(dt):
    """Return the whole ticks by which an actuator's sensors lag: 0 below 100 Hz and at it, 1 at 200 Hz."""
    return float(round(SENSOR_DELAY / dt))


def hydraulic_blocks(n, scenario, trim, dt):
    """Return [(section, module, p, x0)] of servo and actuator for `n` hydraulic lanes at `trim` = (delta, hm0, hmd),
    each (n,).

    What flies is multiplied by scenario.tolerances.hydraulic; the servo's model stays nominal, as a real servo's does.
    It predicts over one tick at most: above 200 Hz its measurements are older than it thinks, at 2 kHz by 4.5 ms.
    """
    p = np.repeat(hydraulic.params(**_scaled(hydraulic.NOMINAL, scenario.tolerances.hydraulic, "hydraulic")), n)
    ps = np.repeat(servo.params(dt=dt, delay=min(sensor_age(dt), 1.0)), n)
    x = hydraulic.init_at(p, *trim)
    return [("servo", servo, ps, servo.init_at(ps, trim[0], x["F_d"])), ("hydraulic", hydraulic, p, x)]


def ema_blocks(n, scenario, trim, dt):
    """Return [(section, module, p, x0)] for `n` electromechanical lanes; see `hydraulic_blocks`."""
    p = np.repeat(ema.params(**_scaled(jay.values("elevator"), scenario.tolerances.ema, "ema")), n)
    ps = np.repeat(ema_servo.params(dt=dt, delay=sensor_age(dt)), n)
    x = ema.init_at(p, *trim)
    return [("ema_servo", ema_servo, ps, ema_servo.init_at(ps, LEAD * x["motor"], x["i"])), ("ema", ema, p, x)]


def plain(aircraft, kind):
    """Return the parameters of the plain actuator of a `kind` of surface: the travel that trim and law count on, so
    that it holds whatever trims, rate [rad/s], natural frequency [rad/s].
    """
    bounds = dict(zip(("lo", "hi"), aircraft.travels[kind]))
    if kind == "elevator":
        return bounds
    surface = getattr(aircraft.surfaces, kind)
    return {**bounds, "rate": surface.rate, "omega": surface.omega_rad_s}


def blocks(scenario, loads, others, dt):
    """Return [(section, module, p, x0, lanes)] of all actuators, a servo before its actuator.

    `loads` maps segment -> (delta, hm0, hmd) at trim, `others` the remaining surfaces -> their angle [rad].
    """
    technology, aircraft, out = scenario.elevator.technology, scenario.aircraft, []
    for name, make in {"hydraulic": hydraulic_blocks, "ema": ema_blocks}.items():
        lanes = tuple(s for s in technology if technology[s] == name)
        if lanes:
            trim = np.array([loads[s] for s in lanes]).T
            out += [(*b, lanes) for b in make(len(lanes), scenario, trim, dt)]
    left = tuple(s for s in technology if technology[s] == "simple")
    kinds = ["elevator"] * len(left) + [name.split("_")[0] for name in others]
    p = np.concatenate([simple.params(**plain(aircraft, k)) for k in kinds])
    x = simple.init_at(p, np.array([loads[s][0] for s in left] + list(others.values())))
    return [*out, ("simple", simple, p, x, left + tuple(others))]


# -- what a fault amplitude in millimetres means at the valve or the drive
# -------------------------------------------------------------

_PAIRS = {  # technology -> servo, actuator, what makes actuator and servo linear, servo inputs from the state, flags
    "hydraulic": (
        servo,
        hydraulic,
        {"F_c": 0.0, "F_s": 0.0},
        {},
        {"q_meas": ("q_rod", 1.0), "x3_meas": ("x3", 1.0)},
        ("q_valid", "x3_valid"),
    ),
    "ema": (
        ema_servo,
        ema,
        {"T_c": 0.0, "T_s": 0.0},
        {"dead": 0.0},  # the integrator's dead band is wider than the small motion that this is flown with
        {"pos_meas": ("motor", LEAD), "vel_meas": ("motor_d", 1.0)},
        ("pos_valid", "vel_valid"),
    ),
}


@functools.cache
def liquid_gain(technology, omega, dt):
    """Return position amplitude [m] per unit added at the valve [1] or drive [A], servo closed, no load, no friction:
    by flying it.
    """
    outer, inner, smooth, live, measured, flags = _PAIRS[technology]
    age = int(sensor_age(dt))
    believed = min(age, 1) if technology == "hydraulic" else age
    p, ps = inner.params(**smooth), outer.params(dt=dt, delay=float(believed), **live)
    x, xs = inner.init(p), outer.init(ps)
    u, us = np.zeros((1, 1), inner.INPUTS), np.zeros((1, 1), outer.INPUTS)
    log, logs = np.zeros((1, 1), inner.STATE), np.zeros((1, 1), outer.STATE)
    amplitude = 0.01 * (0.2 if technology == "hydraulic" else DRIVE_LIMIT)  # far inside the limits
    settle = 2.0
    n = round((max(6, math.ceil(omega / math.pi)) * 2 * math.pi / omega + settle) / dt)
    t, position = np.arange(n) * dt, np.zeros(n)
    for name in flags:
        us[name] = 1.0
    first, past = next(iter(measured)), []
    for k in range(n):
        now = {name: factor * x[state][0] for name, (state, factor) in measured.items()}
        position[k] = now[first]
        past.append(now)
        for name, value in past[max(k - age, 0)].items():
            us[name] = value
        outer.rollout(xs, us, ps, dt, logs)
        u["u"], u["f_u"] = xs["u"][0], amplitude * math.sin(omega * t[k])
        inner.rollout(x, u, p, dt, log)
    late = t > settle
    basis = np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones(n)])[late]
    c, s, _ = np.linalg.lstsq(basis, position[late], rcond=None)[0]
    return math.hypot(c, s) / amplitude


def solid_gain(technology, omega):
    """Return position amplitude [m] per unit that replaces the valve command [1] or drive demand [A], linearised, no
    load, no friction.
    """
    if technology == "hydraulic":
        A, B, C, _ = hydraulic.linearised(hydraulic.params())
        return abs(complex((C @ np.linalg.solve(1j * omega * np.eye(3) - A, B))[0, 0])) * hydraulic.NOMINAL["arm"]
    A, B, _, _ = ema.linearised(ema.params())
    return abs(complex(np.linalg.solve(1j * omega * np.eye(6) - A, B)[2, 0])) * LEAD


def nominal(dt, aircraft):
    """Return the values that relative units of a fault refer to."""
    v = jay.values("elevator")
    return Nominal(
        supply=hydraulic.NOMINAL["P_s"],
        motor_speed=math.radians(45.0) * v["arm"] / v["lead"],  # no-load rate of the surface, DESIGN section 3
        stall_current=DRIVE_LIMIT,
        stall_torque=v["K_T"] * DRIVE_LIMIT,
        arm={"hydraulic": hydraulic.NOMINAL["arm"], "ema": v["arm"], "simple": hydraulic.NOMINAL["arm"]},
        unit={"hydraulic": 1.0, "ema": DRIVE_LIMIT},
        speed=hydraulic.NOMINAL["phi_n"] / hydraulic.NOMINAL["A_p"],
        rate={k: surface.rate for k, surface in aircraft.surfaces},
        brake=hydraulic.NOMINAL["F_brake"] / (hydraulic.NOMINAL["A_p"] * hydraulic.NOMINAL["P_s"]),
        gain=lambda technology, solid, omega: (
            solid_gain(technology, omega) if solid else liquid_gain(technology, omega, dt)
        ),
    )
