"""Compensation of estimated faults: of the input at the valve, of sensors before the law.

`elevator.compensate`: the valve of a hydraulic segment gets u - f_hat of its own `iotsekf`, which reads what the valve
was told, so that f_hat stays the fault's; while that detector alarms. `sensors.reconstructed`: the law flies on
y - f_hat of `lpv_smo` for load factor and angle of attack, from half a second after the observer's start on: it cannot
wait for an alarm, three steps at once look like a gust for seconds. `law.reallocate`: see `reallocation`.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from actuators.deterministic_linalg import rounded
from cosim.flight.blocks.law import SENSORS
from cosim.flight.loop.bus import Bus
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import FlightPoint
from cosim.scenario import Scenario

RECONSTRUCTED = {"n_z": "f_hat_n_z", "alpha": "f_hat_alpha"}


def corrections(scenario: Scenario, bus: Bus) -> dict[str, list[Callable[[int], None]]]:
    """Return {stage of the tick: calls that follow its wires}, stages "law", "commands" and "actuators"."""
    out: dict[str, list] = {"law": [], "commands": [], "actuators": []}
    if scenario.sensors.reconstructed:
        pairs = [(f"law_in.law.y[{SENSORS.index(name)}]", f"lpv_smo.aircraft.{f}") for name, f in RECONSTRUCTED.items()]
        out["law"] = [_less(bus, *pair, "lpv_smo.aircraft.age") for pair in pairs]
    if scenario.elevator.compensate:
        hydraulic = [name for name, technology in scenario.elevator.technology.items() if technology == "hydraulic"]
        filters = [(f"hydraulic_in.{s}.u", f"iotsekf.{s}.f_hat", f"iotsekf.{s}.alarm") for s in hydraulic]
        out["actuators"] = [_less(bus, *names, limit=1.0) for names in filters]
    if scenario.law.reallocate:
        out["commands"] = [reallocation(scenario, bus)]
    return out


def _less(bus, to, source, flag, limit=math.inf):
    """Return a call that subtracts a source from its destination, within +-limit, while `flag` is above a half."""
    v, (i, j, gate) = bus.v, map(bus.index, (to, source, flag))

    def subtract(k):
        if v[gate] > 0.5:
            v[i] = min(max(v[i] - v[j], -limit), limit)

    return subtract


# Control reallocation, `law.reallocate`: the remaining effectors replace the one that control_redundancy isolates.
#
# While it declares the elevators, the stabiliser flies the pitch axis: a linear-quadratic regulator of the bare
# airframe at the flight point whose control is the stabiliser's rate, so that the design knows that it creeps; it holds
# the altitude that the law holds, and integrates its error. While it declares an engine, what is asked of the throttles
# is divided by the share of thrust that is left. The law itself goes on: bank, heading, sideslip and speed stay its.
#
#     z = [alpha, q, theta, h - h_ref, its integral, stab],  stab' = -K z      deviations from the trim, SI and radians
#
# Weights are Bryson's: one over the square of what is thought large (`LARGE`), of the rate a third of what it can.

STATES = ("alpha", "q", "theta", "h")
READ = ("alpha", "q", "theta", "h_inertial")  # the same as the law's sensors have them
LARGE = (0.1, 0.1, 0.1, 5.0, 50.0, 0.1)  # [rad, rad/s, rad, m, m s, rad]
FARTHEST = 30.0  # error of the altitude beyond this is not acted upon [m]
SMOOTH = 2.0  # of the share of thrust that is lost [s]
LEAST = 0.2  # share of the thrust that is taken to be left at least
ELEVATOR, ENGINE = 0, 3  # places in `declared`


def gains(point: FlightPoint, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (K (6,), trim of STATES (4,)) at a flight point for a stabiliser of `rate` [rad/s]."""
    from scipy.linalg import solve_continuous_are  # a quarter of the start of a flight that needs none

    model = linearize(point)
    A, B = np.zeros((6, 6)), np.eye(6)[:, 5:]
    A[:4, :4], A[:4, 5:], *_ = model.block(STATES, ("stab",))
    A[4, 3] = 1.0
    Q, R = np.diag(1.0 / np.square(LARGE)), np.array([[(3.0 / rate) ** 2]])
    P = solve_continuous_are(A, B, Q, R)
    return rounded((B.T @ P / R)[0], 7), model.x0[[list(model.states).index(name) for name in STATES]]


def reallocation(scenario: Scenario, bus: Bus) -> Callable[[int], None]:
    """Return the call that follows the law's step."""
    surface: Any = scenario.aircraft.surfaces.stabiliser
    low, high = scenario.aircraft.travels["stabiliser"]
    K, trim = gains(FlightPoint.of(scenario), surface.rate)
    v, dt, at = bus.v, scenario.dt, bus.index
    y = [at(f"law_in.law.y[{SENSORS.index(name)}]") for name in READ]
    stab, throttle, h_ref = (at(f"law.law.{name}") for name in ("stab_cmd", "throttle_cmd", "h_ref"))
    elevators, engine = (at(f"control_redundancy.aircraft.declared[{h}]") for h in (ELEVATOR, ENGINE))
    lost = at("control_redundancy.aircraft.f_hat_thrust")
    z, stab_0 = np.zeros(6), v[stab]
    held, share, asked, told = math.nan, 0.0, 0.0, math.nan

    def fly(k):
        nonlocal held, share, asked, told
        if v[elevators] <= 0.5:
            held = math.nan
        else:
            if math.isnan(held):
                held, z[4] = v[stab], 0.0
            z[:3] = v[y[:3]] - trim[:3]
            z[3] = min(max(v[y[3]] - v[h_ref], -FARTHEST), FARTHEST)
            z[4] += dt * z[3]
            z[5] = held - stab_0
            creep = min(max(-sum(a * b for a, b in zip(K, z, strict=True)), -surface.rate), surface.rate)
            v[stab] = held = min(max(held + dt * creep, low), high)
        if v[throttle] != told:
            asked = v[throttle]
        gone = min(max(-v[lost], 0.0), 1.0 - LEAST) if v[engine] > 0.5 else 0.0
        share += dt / SMOOTH * (gone - share)
        if share > 1e-3:
            v[throttle] = told = min(asked / (1.0 - share), 1.0)

    return fly
