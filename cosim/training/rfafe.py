"""Models and designs of the Sun13 estimators from the aircraft that flies: linear model, actuators, E of six flights.

The point is that of [Sun13, table I]: 200 t, CG 30 %, 20,000 ft, 290 kt CAS; of another aircraft it is the first of its
record. Units inside: m/s, deg, deg/s, as the paper.
"""

import functools
import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from actuators.registry import HYDRAULIC
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.loop.signals import fly
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import FlightPoint
from cosim.judge.fault_effect import sine
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft
from cosim.training.flights import COMMAND, DT, MANOEUVRES, scenario
from fdi import rfafe
from fdi.common import tuning
from fdi.rfafe import servo
from fdi.rfafe.discrete import noise
from fdi.rfafe.rfafe import side

STATES = ("tas", "alpha", "q", "theta")
UNIT = np.array([1.0, 1 / RAD_PER_DEG, 1 / RAD_PER_DEG, 1 / RAD_PER_DEG])  # SI to the paper's units
FLIGHT_S = 40.0
RANK_E = 2
FIT_HZ = (0.2, 0.35, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0)  # where the actuator is measured
# with the amplitude of the paper's liquid fault, 0.016 of 40 deg: friction makes the response depend on it
FIT_DEG = 0.64
SENSOR_DELAY = TRANSPORT["q"][2]  # of gyro and positions; air data comes one tick later [s]
# [rad/s] within the useful 27-60; the noise of the airframe form grows with it
BANDWIDTH = {"rfafe": 40.0, "rfafe_airframe": 27.0}
TECHNOLOGIES: dict[str, tuple[str, ...]] = {
    "hydraulic": ("hydraulic",) * 4, "ema": ("ema",) * 4, "simple": ("simple",) * 4,
    "mixed": ("hydraulic", "ema", "ema", "hydraulic"),
}  # fmt: skip
START, LATEST = np.log([0.1, 5.0, 0.1]), 6  # of a servo's fit: lag [deg], v_lag [deg/s], t_lag [s]; ticks of delay
RATE_DEG_S = 40.0  # of the servos' reference: 40 of the no-load 45 deg/s (actuators/hydraulic/servo.py)


def point_of(own: Aircraft) -> str:
    """Return the name of the flight point that the designs of an aircraft are for."""
    return next(iter(own.points)) if own.own_designs else "sun13"


def layouts(own: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return {kind: technology of each segment}; "mixed" has two kinds on a side, or sides that differ if a side has
    one segment."""
    if not own.own_designs:
        return TECHNOLOGIES
    n = len(own.segments)
    mixed = [("hydraulic", "ema")[(i if n < 3 or i < n // 2 else n - 1 - i) % 2] for i in range(n)]
    return {**{kind: (kind,) * n for kind in ("hydraulic", "ema", "simple")}, "mixed": tuple(mixed)}


def surfaces(own: Aircraft) -> tuple[str, ...]:
    """Return the bus names of the elevator's segments from left to right [rad]."""
    return tuple(f"truth.aircraft.de_{short}" for short in own.short.values())


@functools.cache
def linear(aircraft: str = DEFAULT) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (A, B (4, segments), x0) of V, alpha, q, theta at the point of the designs, in the paper's units."""
    model = linearize(FlightPoint.at(**_flight(load_aircraft(aircraft)), aircraft=aircraft))
    A, B, _, _ = model.block(STATES, model.named("de_"))
    x0 = np.array([model.x0[list(model.states).index(s)] for s in STATES])
    return UNIT[:, None] * A / UNIT, UNIT[:, None] * B * RAD_PER_DEG, UNIT * x0


@functools.cache
def unknown_inputs(aircraft: str = DEFAULT) -> np.ndarray:
    """Return E (4, 6): the airframe's unknown input in six fault-free flights in still air. [Sun13] section II.B

    The observer is driven by the true elevator angle, so E holds the airframe's error only; the actuators' rows are
    zero.
    """
    own = load_aircraft(aircraft)
    A, B, x0 = linear(aircraft)
    states = [f"truth.aircraft.{n}" for n in STATES]
    flights = []
    for kind in MANOEUVRES:
        flown = scenario(duration=FLIGHT_S, manoeuvre=kind, flight={**_flight(own), "turbulence": "none"},
                         aircraft=aircraft, technology=layouts(own)["hydraulic"])
        v = fly(flown, [*states, *surfaces(own)])
        flights.append((UNIT * np.asarray(v[states]) - x0, np.asarray(v[list(surfaces(own))]) / RAD_PER_DEG))
    return rfafe.estimate_E(A, B, np.eye(4), flights, dt=DT)


def _flight(own):
    return own.points[point_of(own)]


@functools.cache
def actuator(technology: str, aircraft: str = DEFAULT) -> tuple[float, float, float]:
    """Return (a [rad/s], gain, tau [s]) of the mean elevator of this mix, measured in flight."""
    own, response = load_aircraft(aircraft), []
    for hz in FIT_HZ:
        fault = {"target": "elevator.all", "kind": "ofc_liquid", "at": "command", "start_s": 1.0,
                 "amplitude_deg": FIT_DEG, "frequency_hz": hz}
        flown = scenario(duration=4.0 + max(4.0, 4.0 / hz), faults=[fault], technology=layouts(own)[technology],
                         flight=_flight(own), aircraft=aircraft)
        v = fly(flown, [*surfaces(own), COMMAND])
        t, w = v.index.to_numpy(), 2 * math.pi * hz
        late = t > 4.0
        asked = v[COMMAND].to_numpy() + FIT_DEG * RAD_PER_DEG * np.sin(w * (t - 1.0))
        elevator = np.asarray(v[list(surfaces(own))]).mean(1)
        response.append(sine(t[late], elevator[late], w) / sine(t[late], asked[late], w))
    return rfafe.fit_first_order(FIT_HZ, response)


@functools.cache
def servo_model(kind: str, aircraft: str = DEFAULT) -> dict[str, float]:
    """Return the model of one kind of servo (fdi/rfafe/servo.py): its reference's frequency [rad/s], damping and limits
    as its own parameters say; friction and the delay of the surface behind the model [s] fitted to flights in moderate
    air, a cruise and a protection, the error of each over its largest slope."""
    from scipy.optimize import least_squares  # a quarter of a second that a flight need not wait for

    own, flown = load_aircraft(aircraft), []
    p: list[np.ndarray] = []
    for manoeuvre in ("cruise", "aoa_protection"):
        flight = scenario(duration=FLIGHT_S, manoeuvre=manoeuvre, flight={**_flight(own), "turbulence": "moderate"},
                          technology=layouts(own)[kind], aircraft=aircraft)
        v = fly(flight, [*surfaces(own), COMMAND],
                prepare=lambda setup: p.append((*setup.loop.servos, *setup.loop.actuators)[0].p[0]))
        u, y = v[COMMAND].to_numpy() / RAD_PER_DEG, np.asarray(v[list(surfaces(own))]).mean(1) / RAD_PER_DEG
        flown.append((u, y, np.std(y)))
    model = reference_of(p[0], kind)

    def error(z, late):
        c = np.array(servo.row(model | _friction(z), DT))
        parts = []
        for u, y, size in flown:
            m = np.zeros(len(u))
            servo.run(u, c, m, DT)
            e = y[late:] - m[: len(m) - late]
            parts.append((e - e.mean()) / size)
        return np.concatenate(parts)

    tried = [(fit.cost, late, fit.x) for late in range(LATEST + 1)
             for fit in [least_squares(error, START, args=(late,), x_scale=0.1)]]  # fmt: skip
    _, late, z = min(tried, key=lambda t: t[:2])
    return model | _friction(z) | {"delay_s": late * DT}


def _friction(z):
    """Return lag, v_lag and t_lag of a servo's model from their logarithms."""
    return dict(zip(("lag_deg", "v_lag_deg_s", "t_lag_s"), (float(x) for x in np.exp(z))))


def reference_of(p: Any, kind: str) -> dict[str, float]:
    """Return frequency, damping and limits of the reference in a servo's parameters: third order, or second of a plain
    actuator."""
    unit = RAD_PER_DEG * (float(p["arm"]) if kind == "hydraulic" else 1.0)
    model = {"v_max_deg_s": float(p["v_max"]) / unit, "a_max_deg_s2": float(p["a_max"]) / unit}
    if "k3" not in p.dtype.names:
        return model | {"omega_rad_s": math.sqrt(p["k1"] * p["k2"]), "zeta": 0.5 * math.sqrt(p["k2"] / p["k1"])}
    Phi = np.array([[1.0, DT, DT**2 / 2.0], [0.0, 1.0, DT], [0.0, 0.0, 1.0]])
    K = p["k3"] * np.array([p["k2"] * p["k1"], p["k2"], 1.0])
    poles = np.log(np.linalg.eigvals(Phi - np.outer([DT**3 / 6.0, DT**2 / 2.0, DT], K)).astype(complex)) / DT
    pair = poles[np.argmax(poles.imag)]
    return model | {"j_max_deg_s3": float(p["j_max"]) / unit, "omega_rad_s": round(float(abs(pair)), 6),
                    "zeta": round(float(-pair.real / abs(pair)), 6)}


def sigmas(own: Aircraft | None = None) -> tuple[np.ndarray, float]:
    """Return the noise of V, alpha, q, theta per sample in the paper's units, and of a side's mean position [deg]."""
    surface = HYDRAULIC.sensors["surface"].sigma / RAD_PER_DEG
    side = (own or load_aircraft()).groups["left"]
    return UNIT * np.array([TRANSPORT[n][1] for n in STATES]), surface / math.sqrt(len(side))


def published(progress: Any, aircraft: str = DEFAULT) -> dict[str, Any]:
    """Return the designs of the published form, both sides, y = [V, alpha, q, theta, left, right], by technology."""
    own = load_aircraft(aircraft)
    progress("six fault-free flights")
    E = np.vstack([rfafe.reduce_E(unknown_inputs(aircraft), RANK_E), np.zeros((2, RANK_E))])
    kinds = [kind for kind in layouts(own) if len(own.groups["left"]) > 1 or kind != "mixed"]
    pairs = [f"{a}/{b}" for a, b in itertools.permutations(kinds, 2)]  # sides that differ
    designs = {t: entry("rfafe", t, E, progress, aircraft=aircraft) for t in (*kinds, *pairs)}
    servos = {kind: servo_model(kind, aircraft) for kind in layouts(own) if kind != "mixed"}
    return {"designs": designs, "servos": servos}


def airframe(progress: Any, aircraft: str = DEFAULT) -> dict[str, Any]:
    """Return the designs of the airframe form, y = [V, alpha, q, theta], E freed of its part along F, by technology."""
    progress("six fault-free flights")
    F = linear(aircraft)[1].sum(1, keepdims=True)
    E = rfafe.separate(unknown_inputs(aircraft), F, np.eye(4))[:, :RANK_E]
    E = np.vstack([E, np.zeros((1, E.shape[1]))])
    designs = {t: entry("rfafe_airframe", t, E, progress, aircraft=aircraft) for t in layouts(load_aircraft(aircraft))}
    return {"designs": designs}


def entry(
    name: str, technology: str, E: Any, progress: Callable[[str], None] = lambda text: None, *,
    aircraft: str = DEFAULT, bandwidth: float | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Return the stored entry of form `name` for one technology, or "left/right": design, input delays and what its
    figures are."""
    own = load_aircraft(aircraft)
    A, B, _ = linear(aircraft)
    air, position = sigmas(own)
    left = len(own.groups["left"])
    sigma: Any
    if name == "rfafe":
        Bu, C, sigma = np.stack([B[:, :left].sum(1), B[:, left:].sum(1)], 1), np.eye(6), [*air, position, position]
    else:
        Bu, C, sigma = B.sum(1, keepdims=True), np.eye(5)[:4], [*air]
    progress(f"actuator and LMIs, {technology}")
    sides = Bu.shape[1]
    kinds = technology.split("/") * (sides // len(technology.split("/")))
    a, gain, tau = (list(column) for column in zip(*(actuator(kind, aircraft) for kind in kinds)))
    if name == "rfafe":  # its command has gone through the model of the servos
        tau = [float(np.mean([servo_model(k, aircraft)["delay_s"] for k in side(kind)])) for kind in kinds]
    late = [round((t + SENSOR_DELAY) / DT) * DT for t in tau]
    if len(set(kinds)) == 1:
        a, gain, tau, late = a[0], gain[0], tau[0], late[0]
    g = rfafe.global_model(A, Bu, np.eye(4), np.zeros((4, sides)), *rfafe.first_order(a, gain, sides))
    F = g[1] if name == "rfafe" else np.vstack([Bu, [[0.0]]])
    made = rfafe.design(*g[:2], C, None, E, F, dt=DT, bandwidth=bandwidth or BANDWIDTH[name], sigma=sigma)
    return {
        "design": tuning.plain(made), "u_delay_s": late,
        "actuator": {"a_rad_s": a, "gain": gain, "tau_s": tau, "rate_deg_s": RATE_DEG_S},
        "noise_deg": noise(made.discrete, sigma).tolist(),
    }
