"""Compensation of estimated faults: of the input at the valve, of sensors before the law.

`elevator.compensate`: the valve of a hydraulic segment gets u - f_hat of its own `iotsekf`, which reads what the valve
was told, so that f_hat stays the fault's; while that detector alarms. `sensors.reconstructed`: the law flies on
y - f_hat of `lpv_smo` for load factor and angle of attack, always from half a second after the observer's start: it
cannot wait for an alarm, three steps at once look like a gust for seconds. `law.reallocate`: see `reallocation`.
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
    law, valves = [], []
    if scenario.sensors.reconstructed:
        pairs = [(f"law_in.law.y[{SENSORS.index(name)}]", f"lpv_smo.aircraft.{f}") for name, f in RECONSTRUCTED.items()]
        law.append(_less(bus, pairs, "lpv_smo.aircraft.age", latched=True))
    if scenario.elevator.compensate:
        for segment, technology in scenario.elevator.technology.items():
            if technology == "hydraulic":
                pair = (f"hydraulic_in.{segment}.u", f"iotsekf.{segment}.f_hat")
                valves.append(_less(bus, [pair], f"iotsekf.{segment}.alarm", limit=1.0))
    return {"law": law, "commands": reallocation(scenario, bus, scenario.dt), "actuators": valves}


def _less(bus, pairs, flag, *, latched=False, limit=math.inf):
    """Return a call that subtracts each source from its destination while `flag` is up, or since; within +-limit."""
    v, gate, (to, source) = bus.v, bus.index(flag), bus.wires(pairs)
    places, since = list(zip(to.tolist(), source.tolist())), False

    def subtract(k):
        nonlocal since
        since = v[gate] > 0.5 or (since and latched)
        if since:
            for i, j in places:
                value = v[i] - v[j]
                v[i] = min(max(value, -limit), limit)

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
    on, inputs = [list(model.states).index(n) for n in STATES], list(model.inputs)
    A = np.zeros((6, 6))
    A[:4, :4] = model.A[np.ix_(on, on)]
    A[:4, 5] = model.B[on, inputs.index("stab")]
    A[4, 3] = 1.0
    B = np.eye(6)[:, 5:]
    Q, R = np.diag(1.0 / np.square(LARGE)), np.array([[(3.0 / rate) ** 2]])
    P = solve_continuous_are(A, B, Q, R)
    return rounded((B.T @ P / R)[0], 7), np.asarray(model.x0)[on]


def reallocation(scenario: Scenario, bus: Bus, dt: float) -> list[Callable[[int], None]]:
    """Return the calls that follow the law's step: none unless the scenario asks for them."""
    if not scenario.law.reallocate:
        return []
    surface: Any = scenario.aircraft.surfaces.stabiliser
    low, high = scenario.aircraft.travels["stabiliser"]
    K, trim = gains(FlightPoint.of(scenario), surface.rate)
    v, at = bus.v, bus.index
    y = [at(f"law_in.law.y[{SENSORS.index(name)}]") for name in READ]
    stab, throttle, h_ref = (at(f"law.law.{name}") for name in ("stab_cmd", "throttle_cmd", "h_ref"))
    declared = [at(f"control_redundancy.aircraft.declared[{h}]") for h in (ELEVATOR, ENGINE)]
    lost = at("control_redundancy.aircraft.f_hat_thrust")
    z, stab_0 = np.zeros(6), v[stab]
    held, share, asked, told = math.nan, 0.0, 0.0, math.nan

    def fly(k):
        nonlocal held, share, asked, told
        if v[declared[0]] > 0.5:
            if math.isnan(held):
                held, z[4] = v[stab], 0.0
            z[:3] = v[y[:3]] - trim[:3]
            z[3] = min(max(v[y[3]] - v[h_ref], -FARTHEST), FARTHEST)
            z[4] += dt * z[3]
            z[5] = held - stab_0
            creep = min(max(-sum(a * b for a, b in zip(K, z, strict=True)), -surface.rate), surface.rate)
            held = min(max(held + dt * creep, low), high)
            v[stab] = held
        else:
            held = math.nan
        if v[throttle] != told:
            asked = v[throttle]
        gone = min(max(-v[lost], 0.0), 1.0 - LEAST) if v[declared[1]] > 0.5 else 0.0
        share += dt / SMOOTH * (gone - share)
        if share > 1e-3:
            told = min(asked / (1.0 - share), 1.0)
            v[throttle] = told

    return [fly]
