"""Fault estimates beside what they estimate: which detector, which fault, which unit, which injected signal.

| detector | fault | estimate | truth |
|---|---|---|---|
| iotsekf | at the valve of its actuator | f_hat [u] | f_u - s_u u: what acted less what the servo sent |
| rtsekf, rtsekf_flight, ema_kalman_flight | a sensor of its actuator | f_hat [m, rad/s, A] | the fault in the reading |
| rfafe, rfafe_airframe, lpv_smo, control_redundancy | an elevator segment | f_hat... [rad] | surface less healthy |
| lpv_smo | sensor.n_z, sensor.alpha | f_hat_n_z [g], f_hat_alpha [rad] | the fault in the reading |
| control_redundancy | engines | f_hat_thrust [fraction] | minus the mean loss of the four |

A healthy elevator is the simple actuator (actuators/simple/actuator.py) on the law's command: inside the loop an
oscillation is filtered, so the injected signal is not what the aircraft feels. A filter's estimate at t_k concerns the
tick that ends there: signals at the valve are taken one tick back.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from actuators.common.linkage import ARM
from actuators.ema import jay
from actuators.simple import actuator as simple
from cosim.scenario.catalog import SHORT

ADDED = ("bias", "drift", "scale", "oscillation", "jam_liquid", "ofc_liquid")  # they add a signal
PART_OF = {
    "rtsekf": ("rod",),
    "rtsekf_flight": ("rod", "surface"),
    "ema_kalman_flight": ("velocity", "position", "current"),
}
UNIT = {"rod": "m", "surface": "m", "velocity": "rad/s", "position": "m", "current": "A", "n_z": "g", "alpha": "rad"}
ELEVATOR = {"lpv_smo": "f_hat_elevator", "rfafe_airframe": "f_hat", "control_redundancy": "f_hat_elevator"}
LEAD = jay.values("elevator")["lead"]  # screw travel per radian of motor [m/rad]
GAIN = {"position": (LEAD, 1.0), "surface": (1.0, ARM)}  # reading per truth, estimate per reading
SETTLE_S, SETTLE_PERIODS = 2.0, 3.0  # after the onset and its ramp; the longer one counts


@dataclass(frozen=True)
class Estimate:
    """Estimate one fault: its column in the history, those of the truth, how they combine, when it should hold."""

    column: int
    columns: tuple
    truth: Callable  # (history columns as (n, ticks) float64, dt) -> (ticks,)
    unit: str
    start: float  # [s], after settling
    end: float  # [s]

    def error(self, history, dt):
        """Return f_hat - f on the settled ticks, empty when there are none."""
        f = self.truth(history[:, list(self.columns)].T.astype(float), dt)
        late = slice(round(self.start / dt), round(min(self.end / dt, len(history))))
        return (history[:, self.column].astype(float) - f)[late]


def plan(scenario, detector, lane, columns):
    """Return the Estimate of the earliest fault that `detector` estimates on `lane`, or None.

    `columns(bus name)` gives a column of the history.
    """
    for j in sorted(scenario.injections(), key=lambda j: j.start):
        found = _found(detector, lane, j, scenario.elevator.technology, columns)
        if found:
            column, names, truth, unit = found
            period = scenario.faults[j.fault].period_s or 0.0
            start = j.start + j.ramp + max(SETTLE_S, SETTLE_PERIODS * period)
            return Estimate(columns(column), tuple(map(columns, names)), truth, unit, start, j.end)
    return None


def _found(detector, lane, j, technology, columns):
    here = f"{detector}.{lane}"
    at_valve = (j.place, j.name, j.at) == ("elevator", lane, "valve") and technology[lane] == "hydraulic"
    if detector == "iotsekf" and at_valve:
        return f"{here}.f_hat", [f"hydraulic_in.{lane}.{n}" for n in ("f_u", "s_u", "u")], _at_valve, "u"
    if j.sensor in PART_OF.get(detector, ()) and j.name == lane and j.kind in ADDED:
        return f"{here}.f_hat", _reading(f"{lane}_{j.sensor}"), _added(*GAIN.get(j.sensor, (1.0, 1.0))), UNIT[j.sensor]
    if j.place == "elevator" and not j.sensor and detector == "rfafe":
        side = j.name.split("_")[0]
        parts = [s for name, s in SHORT.items() if name.startswith(side)]
        return f"{here}.f_hat_{side}", _surfaces(parts), _beyond_healthy, "rad"
    if j.place == "elevator" and not j.sensor and detector in ELEVATOR:
        return f"{here}.{ELEVATOR[detector]}", _surfaces(SHORT.values()), _beyond_healthy, "rad"
    if j.place == "sensor" and detector == "lpv_smo" and j.name in ("n_z", "alpha") and j.kind in ADDED:
        return f"{here}.f_hat_{j.name}", _reading(j.name), _added(1.0, 1.0), UNIT[j.name]
    if j.place == "engine" and detector == "control_redundancy":
        return f"{here}.f_hat_thrust", [f"surfaces.aircraft.thrust_loss_{i}" for i in range(1, 5)], _thrust, "fraction"
    return None


def _reading(lane):
    return [f"sensors_in.{lane}.{n}" for n in ("f_add", "g_add", "f_scale", "g_scale", "truth")]


def _surfaces(parts):
    return ["law.law.de_cmd", *(f"truth.aircraft.de_{s}" for s in parts)]


def _at_valve(v, dt):
    f_u, s_u, u = v
    f = -np.roll(s_u, 1) * u + np.roll(f_u, 1)  # u is still the one held over the last tick, f_u already the next one
    f[0] = 0.0
    return f


def _added(per_truth, per_reading):
    def truth(v, dt):
        f_add, g_add, f_scale, g_scale, s = v
        return per_reading * (f_add + g_add + (f_scale + g_scale) * per_truth * s)

    return truth


def _beyond_healthy(v, dt):
    command, actual = v[0], v[1:].mean(axis=0)
    p = simple.params()
    u, log = np.zeros((1, len(command)), simple.INPUTS), np.zeros((1, len(command)), simple.STATE)
    u["command"] = command
    simple.rollout(simple.init_at(p, actual[0]), u, p, dt, log)
    return actual - np.concatenate([actual[:1], log["delta"][0, :-1]])


def _thrust(v, dt):
    return -v.mean(axis=0)
