"""The closed servo loops as linear sampled models, differentiated from the code that flies.

One tick of sensors (`delay` ticks old), servo and actuator is a map z+ = f(z, command), delta = g(z); its Jacobian at
load equilibrium is taken by central differences, with friction, backlash and the integrator's dead zone set to zero
and the stops out of reach: what remains is smooth there.
"""

from typing import NamedTuple

import numpy as np

from actuators.ema import actuator as ema
from actuators.ema import jay
from actuators.ema import servo as ema_servo
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import servo


class Sampled(NamedTuple):
    """z(k+1) = A z(k) + B command(k), delta(k) = C z(k) + D command(k), all angles in rad; `names` of z; `dt` [s]."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float
    names: tuple


# state of actuator and servo, and the size of a small step in each
_HYDRAULIC = {"q_rod": 1e-6, "qd_rod": 1e-5, "x3": 1e-5}
_COMMAND = {"r": 1e-6, "rd": 1e-5, "rdd": 1e-4, "rddd": 1e-3}
_SERVO = {**_COMMAND, "u": 1e-5, "q_hat": 1e-6, "qd_hat": 1e-5, "x3_hat": 1e-5, "load_hat": 1.0}
_EMA = {"delta": 1e-6, "delta_d": 1e-5, "motor": 1e-4, "motor_d": 1e-3, "i": 1e-3, "comp": 1e-5}
_EMA_SERVO = {**_COMMAND, "i_d": 1e-3, "z": 1e-3}
# what the servo measures: name -> (its inputs: value and flag, step, signal of the actuator's state x and PARAMS p)
_ROD = {
    "rod": ("q_meas", "q_valid", 1e-6, lambda x, p: x["q_rod"]),
    "pressure": ("x3_meas", "x3_valid", 1e-5, lambda x, p: x["x3"]),
}
_SCREW = {
    "position": ("pos_meas", "pos_valid", 1e-7, lambda x, p: p["lead"] * x["motor"]),
    "velocity": ("vel_meas", "vel_valid", 1e-3, lambda x, p: x["motor_d"]),
}


def _jacobian(tick, z0, steps, dt, names):
    """Return the Sampled model of z+ , delta = tick(z, command), columns z: (states, lanes), by central differences."""
    n = len(z0)
    h = np.append(steps, 1e-6)
    z = np.append(z0, 0.0)[:, None] + np.hstack([np.diag(h), -np.diag(h)])
    after, delta = tick(z[:n], z[n])
    J = (after[:, : n + 1] - after[:, n + 1 :]) / (2 * h)
    g = (delta[: n + 1] - delta[n + 1 :]) / (2 * h)
    return Sampled(J[:, :n], J[:, n:], g[None, :n], g[None, n:], dt, names)


def _loop(blocks, kept, sensed, lanes, start, load, dt):
    """Return the Sampled model of a pair of `blocks`, actuator and servo, with states `kept` of each; `lanes` are
    (state, PARAMS) of the actuator and of the servo in equilibrium at command `start` under `load` (hm0, hmd).
    """
    (actuator, servo_), (own, held), ((x, p), (s, c)) = blocks, kept, lanes
    late = c["delay"][0] > 0.5
    signals = [signal for *_, signal in sensed.values()]
    names = (*own, *(f"servo.{n}" for n in held), *(f"{n}.late" for n in sensed))
    z0 = np.array([*(x[n][0] for n in own), *(s[n][0] for n in held), *(signal(x, p)[0] for signal in signals)])

    def tick(z, command):
        m = z.shape[1]
        X, S, P, K = (np.repeat(record, m) for record in (x, s, p, c))
        rows = iter(z)
        for record, names in ((X, own), (S, held)):
            for name in names:
                record[name] = next(rows)
        if "delta" not in own:
            X["delta"] = X["q_rod"] / P["arm"]
        here = X["delta"].copy()
        now = np.array([signal(X, P) for signal in signals])
        seen = np.array([next(rows) for _ in signals]) if late else now
        u, w = np.zeros((m, 1), servo_.INPUTS), np.zeros((m, 1), actuator.INPUTS)
        u["command"][:, 0] = start + command
        for (value, flag, *_), y in zip(sensed.values(), seen):
            u[value][:, 0], u[flag] = y, 1.0
        servo_.rollout(S, u, K, dt, np.zeros((m, 1), servo_.STATE))
        w["u"][:, 0], (w["hm0"], w["hmd"]) = S["u"], load
        actuator.rollout(X, w, P, dt, np.zeros((m, 1), actuator.STATE))
        return np.array([*(X[n] for n in own), *(S[n] for n in held), *now]), here

    steps = [*own.values(), *held.values(), *(step for _, _, step, _ in sensed.values())]
    return _jacobian(tick, z0, steps, dt, names)


def hydraulic_loop(
    *, hmd: float = 0.0, hm0: float = 0.0, delta: float = 0.0, dt: float = 0.005, actuator: np.ndarray | None = None,
    control: np.ndarray | None = None,
) -> Sampled:  # fmt: skip
    """Return the Sampled model of servo and hydraulic actuator, command -> surface angle, at `delta` [rad].

    `hm0` [N m], `hmd` [N m/rad] is the hinge load; `actuator`, `control` are PARAMS of one lane (default: nominal). The
    servo flies on its own observer.
    """
    p = (hydraulic.params() if actuator is None else actuator).copy()
    p["F_c"] = p["F_s"] = p["backlash"] = 0.0
    p["q_lo"], p["q_hi"] = -0.5, 0.5
    c = servo.params(dt=dt) if control is None else control
    x = hydraulic.init_at(p, delta, hm0, hmd)
    lanes = (x, p), (servo.init_at(c, delta, x["F_d"]), c)
    return _loop((hydraulic, servo), (_HYDRAULIC, _SERVO), _ROD, lanes, delta, (hm0, hmd), dt)


def ema_loop(
    *, hmd: float = 0.0, hm0: float = 0.0, delta: float = 0.0, dt: float = 0.005, actuator: np.ndarray | None = None,
    control: np.ndarray | None = None,
) -> Sampled:  # fmt: skip
    """Return the Sampled model of servo and electromechanical actuator; arguments as in `hydraulic_loop`."""
    p = (ema.params() if actuator is None else actuator).copy()
    p["T_c"] = p["T_s"] = p["backlash"] = 0.0
    p["x3_lo"], p["x3_hi"] = -jay.UNLIMITED, jay.UNLIMITED
    c = (ema_servo.params(dt=dt) if control is None else control).copy()
    c["dead"] = 0.0
    x = ema.init_at(p, delta, hm0, hmd)
    s = ema_servo.init_at(c, p["lead"] * x["motor"], x["i"])
    return _loop((ema, ema_servo), (_EMA, _EMA_SERVO), _SCREW, ((x, p), (s, c)), s["delta_c"][0], (hm0, hmd), dt)


def response(model: Sampled, frequency: float | np.ndarray) -> np.ndarray:
    """Return the complex response of a Sampled model at `frequency` [rad/s], shape of `frequency`."""
    w = np.atleast_1d(frequency)
    n = len(model.A)
    z = np.exp(1j * w * model.dt)[:, None, None] * np.eye(n)
    return (model.C @ np.linalg.solve(z - model.A, model.B) + model.D)[:, 0, 0].reshape(np.shape(frequency))
