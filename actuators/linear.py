"""The closed servo loops as linear sampled models, differentiated from the code that flies.

One tick of sensors (`delay` ticks old), servo and actuator is a map z+ = f(z, command), delta = g(z); its Jacobian at
load equilibrium is taken by central differences, with friction, backlash and the integrator's dead zone set to zero
and the stops out of reach: what remains is smooth there.
"""

from typing import Any, NamedTuple

import numpy as np

from actuators.ema import actuator as ema
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


# state of actuator and servo, delayed measurements, and the size of a small step in each
_HYDRAULIC = {"q_rod": 1e-6, "qd_rod": 1e-5, "x3": 1e-5}
_SERVO = {
    "r": 1e-6,
    "rd": 1e-5,
    "rdd": 1e-4,
    "rddd": 1e-3,
    "u": 1e-5,
    "q_hat": 1e-6,
    "qd_hat": 1e-5,
    "x3_hat": 1e-5,
    "load_hat": 1.0,
}
_EMA = {"delta": 1e-6, "delta_d": 1e-5, "motor": 1e-4, "motor_d": 1e-3, "i": 1e-3, "comp": 1e-5}
_EMA_SERVO = {"r": 1e-6, "rd": 1e-5, "rdd": 1e-4, "rddd": 1e-3, "i_d": 1e-3, "z": 1e-3}


def _lanes(record, n):
    """Return n copies of the one lane of `record`."""
    return np.repeat(record, n)


def _jacobian(tick, z0, steps, dt, names):
    """Return the Sampled model of z+ , delta = tick(z, command), columns z: (states, lanes), by central differences."""
    n = len(z0)
    h = np.append(steps, 1e-6)
    z = np.append(z0, 0.0)[:, None] + np.hstack([np.diag(h), -np.diag(h)])
    after, delta = tick(z[:n], z[n])
    J = (after[:, : n + 1] - after[:, n + 1 :]) / (2 * h)
    g = (delta[: n + 1] - delta[n + 1 :]) / (2 * h)
    return Sampled(J[:, :n], J[:, n:], g[None, :n], g[None, n:], dt, names)


def hydraulic_loop(
    *, hmd: Any = 0.0, hm0: Any = 0.0, delta: Any = 0.0, dt: float = 0.005, actuator: Any = None, control: Any = None
) -> Any:
    """Return the Sampled model of servo and hydraulic actuator, command -> surface angle, at `delta` [rad].

    `hm0` [N m], `hmd` [N m/rad] is the hinge load; `actuator`, `control` are PARAMS of one lane (default: nominal). The
    servo flies on its own observer.
    """
    p = (hydraulic.params() if actuator is None else actuator).copy()
    p["F_c"] = p["F_s"] = p["backlash"] = 0.0
    p["q_lo"], p["q_hi"] = -0.5, 0.5
    c = servo.params(dt=dt) if control is None else control
    late = c["delay"][0] > 0.5
    x = hydraulic.init_at(p, delta, hm0, hmd)
    s = servo.init_at(c, delta, x["F_d"])
    names = (*_HYDRAULIC, *(f"servo.{n}" for n in _SERVO), "rod.late", "pressure.late")
    z0 = np.array(
        [*(x[n][0] for n in _HYDRAULIC), *(s[n][0] for n in _SERVO), x["q_rod"][0], x["x3"][0]], dtype=np.float64
    )

    def tick(z, command):
        m = z.shape[1]
        X, S, P, K = _lanes(x, m), _lanes(s, m), _lanes(p, m), _lanes(c, m)
        rows = iter(z)
        for name in _HYDRAULIC:
            X[name] = next(rows)
        for name in _SERVO:
            S[name] = next(rows)
        X["delta"] = X["q_rod"] / P["arm"]
        here = X["delta"].copy()
        now = np.array([X["q_rod"], X["x3"]])
        seen = np.array([next(rows), next(rows)]) if late else now
        u, w = np.zeros((m, 1), servo.INPUTS), np.zeros((m, 1), hydraulic.INPUTS)
        u["command"][:, 0] = delta + command
        u["q_meas"][:, 0], u["x3_meas"][:, 0] = seen
        u["q_valid"] = u["x3_valid"] = 1.0
        servo.rollout(S, u, K, dt, np.zeros((m, 1), servo.STATE))
        w["u"][:, 0], w["hm0"], w["hmd"] = S["u"], hm0, hmd
        hydraulic.rollout(X, w, P, dt, np.zeros((m, 1), hydraulic.STATE))
        return np.array([*(X[n] for n in _HYDRAULIC), *(S[n] for n in _SERVO), *now]), here

    return _jacobian(tick, z0, [*_HYDRAULIC.values(), *_SERVO.values(), 1e-6, 1e-5], dt, names)


def ema_loop(
    *, hmd: Any = 0.0, hm0: Any = 0.0, delta: Any = 0.0, dt: float = 0.005, actuator: Any = None, control: Any = None
) -> Sampled:
    """Return the Sampled model of servo and electromechanical actuator; arguments as in `hydraulic_loop`."""
    p = (ema.params() if actuator is None else actuator).copy()
    p["T_c"] = p["T_s"] = p["backlash"] = 0.0
    p["x3_lo"], p["x3_hi"] = -ema.UNLIMITED, ema.UNLIMITED
    c = (ema_servo.params(dt=dt) if control is None else control).copy()
    c["dead"] = 0.0
    late = c["delay"][0] > 0.5
    x = ema.init_at(p, delta, hm0, hmd)
    s = ema_servo.init_at(c, p["lead"] * x["motor"], x["i"])
    start = s["delta_c"][0]
    names = (*_EMA, *(f"servo.{n}" for n in _EMA_SERVO), "position.late", "velocity.late")
    z0 = np.array(
        [*(x[n][0] for n in _EMA), *(s[n][0] for n in _EMA_SERVO), p["lead"][0] * x["motor"][0], 0.0], dtype=np.float64
    )

    def tick(z, command):
        m = z.shape[1]
        X, S, P, K = _lanes(x, m), _lanes(s, m), _lanes(p, m), _lanes(c, m)
        rows = iter(z)
        for name in _EMA:
            X[name] = next(rows)
        for name in _EMA_SERVO:
            S[name] = next(rows)
        here = X["delta"].copy()
        now = np.array([P["lead"] * X["motor"], X["motor_d"]])
        seen = np.array([next(rows), next(rows)]) if late else now
        u, w = np.zeros((m, 1), ema_servo.INPUTS), np.zeros((m, 1), ema.INPUTS)
        u["command"][:, 0] = start + command
        u["pos_meas"][:, 0], u["vel_meas"][:, 0] = seen
        u["pos_valid"] = u["vel_valid"] = 1.0
        ema_servo.rollout(S, u, K, dt, np.zeros((m, 1), ema_servo.STATE))
        w["u"][:, 0], w["hm0"], w["hmd"] = S["u"], hm0, hmd
        ema.rollout(X, w, P, dt, np.zeros((m, 1), ema.STATE))
        return np.array([*(X[n] for n in _EMA), *(S[n] for n in _EMA_SERVO), *now]), here

    return _jacobian(tick, z0, [*_EMA.values(), *_EMA_SERVO.values(), 1e-7, 1e-3], dt, names)


def response(model: Any, frequency: float) -> Any:
    """Return the complex response of a Sampled model at `frequency` [rad/s], shape of `frequency`."""
    w = np.atleast_1d(frequency)
    n = len(model.A)
    z = np.exp(1j * w * model.dt)[:, None, None] * np.eye(n)
    return (model.C @ np.linalg.solve(z - model.A, model.B) + model.D)[:, 0, 0].reshape(np.shape(frequency))
