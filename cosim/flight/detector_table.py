"""The one list of all detectors: where each is, which actuators it watches, what it reads, with which parameters."""

import functools
import importlib
from collections.abc import Callable
from dataclasses import dataclass

from cosim.flight import airframe_wires, rfafe_wires


@dataclass(frozen=True)
class Spec:
    """How a detector is built: module, technologies of its lanes (none for an aircraft-level one), wires and
    parameters.

    `wires(lane, technology)` returns {input field: bus name}; `params(module, scenario, lane, dt, **options)` one
    record. `options` are what the scenario may choose by a word: (name, allowed words), the first being the default.
    """

    module: str
    technologies: tuple
    wires: Callable
    params: Callable
    every: int = 1
    options: tuple = ()


def _obs(lane, sensor, field, flag=None):
    return {field: f"sensors.{lane}_{sensor}.y_obs", flag or f"{field}_valid": f"sensors.{lane}_{sensor}.valid_obs"}


def _position_monitor(lane, technology):
    return {"command": "law.law.de_cmd", **_obs(lane, "surface", "surface")}


def _hinge(lane):
    return {"hm0_model": f"hinge_model.{lane}.hm0", "hmd_model": f"hinge_model.{lane}.hmd"}


def _hydraulic(lane, technology):
    return {**_rod(lane, _ROD, _SURFACE, _PRESSURE), **_hinge(lane)}


def _ema(lane, technology):
    out = {"u": f"ema_in.{lane}.u"}
    for name in ("velocity", "position", "current"):
        out |= _obs(lane, name, f"y_{name}", f"{name}_valid")
    return out


def _rod(lane, *sensors):
    out = {"u": f"hydraulic_in.{lane}.u"}  # the valve command that acted from the last tick to this one
    for sensor, field in sensors:
        out |= _obs(lane, sensor, field)
    return out


def _plain(m, s, lane, dt):
    return m.params(dt=dt)


def _position_monitor_params(m, s, lane, dt):
    return m.params("flight_ema" if s.elevator.technology[lane] == "ema" else "flight")


def _rfafe(m, s, lane, dt):
    return m.params(technology=rfafe_wires.technology(s.elevator.technology), dt=dt)


_ROD, _PRESSURE, _SURFACE = ("rod", "y_rod"), ("pressure", "y_dp"), ("surface", "y_surface")
HYDRAULIC, EMA = ("hydraulic",), ("ema",)
TABLE = {
    "rfafe": Spec("fdi.rfafe.rfafe", (), lambda lane, t: rfafe_wires.WIRES["rfafe"], _rfafe),
    "rfafe_airframe": Spec("fdi.rfafe.rfafe_airframe", (), lambda lane, t: rfafe_wires.WIRES["rfafe_airframe"], _rfafe),
    "lpv_smo": Spec("fdi.lpv_smo.lpv_smo", (), lambda lane, t: airframe_wires.lpv_smo(), airframe_wires.lpv_smo_params),
    "control_redundancy": Spec(
        "fdi.control_redundancy.control_redundancy",
        (),
        lambda lane, t: airframe_wires.control_redundancy(),
        airframe_wires.control_redundancy_params,
        options=(("rows", airframe_wires.ROWS),),
    ),
    "iotsekf": Spec("fdi.hydraulic.iotsekf", HYDRAULIC, _hydraulic, _plain),
    "rtsekf": Spec("fdi.hydraulic.rtsekf", HYDRAULIC, lambda lane, t: {**_rod(lane, _ROD), **_hinge(lane)}, _plain),
    "rtsekf_flight": Spec(
        "fdi.hydraulic.rtsekf_flight", HYDRAULIC, lambda lane, t: _rod(lane, _ROD, _SURFACE, _PRESSURE), _plain
    ),
    "ema_kalman": Spec("fdi.ema.ema_kalman", EMA, _ema, lambda m, s, lane, dt: m.params("elevator", dt=dt)),
    "ema_kalman_flight": Spec("fdi.ema.ema_kalman_flight", EMA, lambda lane, t: {**_ema(lane, t), **_hinge(lane)},
    _plain), "position_monitor": Spec(
        "fdi.monitors.position_monitor", (*HYDRAULIC, *EMA), _position_monitor, _position_monitor_params
    ),
    "ofc_monitor": Spec(
        "fdi.monitors.ofc_monitor",
        HYDRAULIC,
        lambda lane, t: {"command": "law.law.de_cmd", **_obs(lane, *_ROD), **_obs(lane, *_PRESSURE)},
        _plain,
    ),
}


@functools.cache
def module(name):
    """Return the module of detector `name`."""
    return importlib.import_module(TABLE[name].module)
