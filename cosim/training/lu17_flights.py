"""Flights of the Lu17 study: fly once, keep what the detectors of four segments read, run them as often as needed."""

import numpy as np

from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.tolerance import toleranced
from cosim.training.rfafe import DT, fly
from cosim.training.train_rfafe import FLIGHT_S, MANOEUVRES, POINTS, TOLERANCE, TURBULENCE
from fdi.hydraulic import iotsekf

MODULES = ("iotsekf", "rtsekf_flight", "ofc_monitor", "position_monitor")
SIGNALS = {
    **{name: f"iotsekf_in.{{lane}}.{name}" for name in iotsekf.INPUTS.names},
    "f_u": "hydraulic_in.{lane}.f_u",  # injected at the valve [1]
    "rod": "hydraulic.{lane}.q_rod",  # true [m]
    "delta": "hydraulic.{lane}.delta",  # true [rad]
}
COMMAND = "law.law.de_cmd"
MODEL = ("A_p", "B", "M", "P_s", "phi_n", "V_m", "E", "L", "F_c", "F_s")  # what is off by up to 5 %


def draw(seed, *, point, manoeuvre, turbulence, duration=FLIGHT_S, **more):
    """Return the arguments of `record` for a flight with all coefficients of aircraft and actuator off by up to 5 %."""
    rng = np.random.default_rng(seed)
    kind = {"kind": manoeuvre} if isinstance(manoeuvre, str) else dict(manoeuvre)
    if point["mass_t"] == 375.0 and kind["kind"] in ("nose_up", "pitch_protection"):
        kind["amplitude_g"] = 0.15  # the point with 1.23 g left
    off = {g: {n: float(1 + TOLERANCE * rng.uniform(-1, 1)) for n in names}
           for g, names in (("aero", toleranced("aero")), ("hydraulic", MODEL))}
    return {"duration": duration, "manoeuvre": kind, "seed": seed, "tolerances": off,
            "flight": {**point, "turbulence": turbulence}, **more}


def flights(first_seed, draws=1, points=POINTS):
    """Yield the arguments of `record` for every point, manoeuvre and turbulence, `draws` times each."""
    seed = first_seed
    for _ in range(draws):
        for point in points:
            for manoeuvre in MANOEUVRES:
                for turbulence in TURBULENCE:
                    yield draw(seed, point=point, manoeuvre=manoeuvre, turbulence=turbulence)
                    seed += 1


def record(**flight):
    """Fly and return {signal: (4 lanes, ticks)} of what the detectors read on four segments, and the true positions."""
    names = [path.format(lane=lane) for lane in SEGMENTS for path in SIGNALS.values()]
    v = fly([*names, COMMAND], **flight)
    out = {name: np.stack([v[:, i * len(SIGNALS) + j] for i in range(4)]) for j, name in enumerate(SIGNALS)}
    return out | {"command": np.repeat(v[None, :, -1], 4, axis=0)}


def record_ema(**flight):
    """Fly four electromechanical segments and return what `position_monitor` reads on them, (4 lanes, ticks)."""
    fields = {"y_surface": "sensors.{lane}_surface.y_obs", "y_surface_valid": "sensors.{lane}_surface.valid_obs"}
    names = [path.format(lane=lane) for lane in SEGMENTS for path in fields.values()]
    aero = flight.pop("tolerances")["aero"]
    v = fly([*names, COMMAND], technology=("ema",) * 4, **flight, tolerances={"aero": aero})
    out = {name: np.stack([v[:, 2 * i + j] for i in range(4)]) for j, name in enumerate(fields)}
    return out | {"command": np.repeat(v[None, :, -1], 4, axis=0)}


def inputs(module, recorded):
    """Return INPUTS of `module`, shape (lanes, ticks)."""
    u = np.zeros(next(iter(recorded.values())).shape, module.INPUTS)
    for name in module.INPUTS.names:
        u[name] = recorded[name.replace("surface", "y_surface", 1) if name.startswith("surface") else name]
    return u


def estimate(module, recorded, p, fields=None, chunk=400):
    """Return the OUTPUTS (or `fields`) of `module` at every tick, shape (lanes, ticks); `p` one record."""
    u = inputs(module, recorded)
    lanes, ticks = u.shape
    names = module.OUTPUTS if fields is None else fields
    out = np.zeros((lanes, ticks), [(n, "f8", module.STATE[n].shape) for n in names])
    p = np.repeat(p, lanes)
    x, log = module.init(p), np.zeros((lanes, chunk), module.STATE)
    for a in range(0, ticks, chunk):
        b = min(a + chunk, ticks)
        module.rollout(x, np.ascontiguousarray(u[:, a:b]), p, DT, log[:, : b - a])
        for n in names:
            out[n][:, a:b] = log[n][:, : b - a]
    return out
