"""Flights of training and of the studies: points, manoeuvres, scenarios, and the detectors of a flown table.

A flight is flown once without detectors (`cosim.fly`); what they read is in its table, and each runs on it as often as
needed (`detect`).
"""

import math
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd

from cosim.errors import TrimError
from cosim.flight.build import build
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources, unfit
from cosim.flight.loop.signals import detect, fly
from cosim.flight.plant.point import SIX
from cosim.scenario import Scenario, parse
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft
from cosim.scenario.catalog import SEGMENTS, toleranced
from fdi import registry
from fdi.hydraulic import iotsekf
from fdi.rfafe import rfafe, rfafe_airframe

DT = 0.005
POINT = SIX["sun13"]
POINTS = tuple(SIX.values())
TURBULENCE = ("none", "light", "moderate")
AIR = (*TURBULENCE, "severe")
# the six fault-free flights of [Sun13] section IV
MANOEUVRES = ("cruise", "aoa_protection", "nose_up", "pitch_protection", "coordinated_turn", "yaw_angle")
LIVELY: tuple[dict, ...] = (
    *({"kind": kind} for kind in MANOEUVRES), {"kind": "three_two_one_one", "amplitude_deg": 2.0, "unit_s": 0.5},
    {"kind": "nz_doublet"},
)  # fmt: skip
KINDS: tuple[dict, ...] = (
    {"kind": "cruise"}, {"kind": "coordinated_turn", "duration_s": 35.0}, {"kind": "yaw_angle"}, {"kind": "nz_doublet"},
    {"kind": "three_two_one_one"}, {"kind": "nose_up", "amplitude_g": 0.3}, {"kind": "aoa_protection"},
    {"kind": "pitch_protection"},
)  # fmt: skip
WIDE = ((200.0, 405.0), (25.0, 36.0), (5000.0, 39000.0), (180.0, 330.0))  # of the default aircraft: t, %, ft, kt
ALPHA_MAX, MACH_MAX = 12.5, 0.895  # deg, beyond it lift stalls; Mach, beyond it coefficients turn too fast
ALPHA_MARGIN = 0.97  # of the angle that surely flies: no design beyond
FLIGHT_S = 60.0
TOLERANCE = 0.05  # of every coefficient
NOISE_SCALE = 1.2  # of the sensors
START_S = 2.0  # filters settle
MODEL = ("A_p", "B", "M", "P_s", "phi_n", "V_m", "E", "L", "F_c", "F_s")  # of the hydraulic actuator, off by up to 5 %
COMMAND = "law.law.de_cmd"
LEVEL = ("lpv_smo", "control_redundancy", "kinematic", "rfafe", "rfafe_airframe")  # detectors of the aircraft level
MODULES = {"rfafe": rfafe, "rfafe_airframe": rfafe_airframe}
SURFACES = tuple(f"truth.aircraft.{s}" for s in ("de_lo", "de_li", "de_ri", "de_ro"))
AIRCRAFT = tuple(dict.fromkeys([*(path for name in MODULES for path in sources(name).values()), COMMAND, *SURFACES]))
# of each segment: what the hydraulic detectors read, the fault at the valve [1], true rod [m] and surface [rad]
HYDRAULIC = (*(f"iotsekf_in.{{}}.{name}" for name in iotsekf.INPUTS.names), "hydraulic_in.{}.f_u", "hydraulic.{}.q_rod",
             "hydraulic.{}.delta")  # fmt: skip


def drawn_manoeuvre(index: int, first_seed: int) -> dict:
    """Return the manoeuvre of training flight `index` [manoeuvre table]: KINDS by turns, begun at 5 to 35 s, half of
    them with the speed held, so that aircraft-level detectors, which judge from 8 to 9.5 s on, meet it while they learn
    and while they judge."""
    rng = np.random.default_rng([first_seed, index, 1])
    start, held = float(rng.uniform(5.0, 35.0)), bool(rng.random() < 0.5)
    kind = KINDS[index % len(KINDS)]
    return {**kind, "hold_speed": held, **({} if kind["kind"] == "cruise" else {"start_s": start})}


def scenario(
    *, duration: float, manoeuvre: str | dict = "cruise", technology: Sequence[str] = ("hydraulic",) * 4,
    flight: dict | None = None, aircraft: str = DEFAULT, **more: Any,
) -> Scenario:  # fmt: skip
    """Return a flight of `duration` [s] at POINT without detectors; `flight` changes entries of the point.

    `technology` is that of the segments; `more` are further tables of the scenario. Of another `aircraft` `flight` is
    the whole point.
    """
    own = load_aircraft(aircraft)
    point = {"aircraft": aircraft} if own.own_designs else POINT
    manoeuvre = manoeuvre if isinstance(manoeuvre, dict) else {"kind": manoeuvre}
    return parse({"title": "design flight", "duration_s": duration, "flight": {**point, **(flight or {})},
                  "manoeuvre": manoeuvre, "elevator": dict(zip(own.segments, technology)), "detectors": {"enabled": []},
                  **more})  # fmt: skip


def draw(
    seed: int, *, point: dict, manoeuvre: str | dict, turbulence: str, duration: float = FLIGHT_S, **more: Any
) -> dict:
    """Return the arguments of `scenario` for a flight with all coefficients of aircraft and actuator off by up to
    5 %."""
    rng = np.random.default_rng(seed)
    kind = {"kind": manoeuvre} if isinstance(manoeuvre, str) else dict(manoeuvre)
    if point["mass_t"] == 375.0 and kind["kind"] in ("nose_up", "pitch_protection"):
        kind["amplitude_g"] = 0.15  # the point with 1.23 g left
    off = {g: {n: float(1 + TOLERANCE * rng.uniform(-1, 1)) for n in names}
           for g, names in (("aero", toleranced("aero")), ("hydraulic", MODEL))}  # fmt: skip
    return {"duration": duration, "manoeuvre": kind, "seed": seed, "tolerances": off,
            "flight": {**point, "turbulence": turbulence}, **more}  # fmt: skip


def envelope(rng: np.random.Generator) -> dict:
    """Return a flight point drawn over the envelope, 200 to 405 t; not every one trims."""
    mass, height = rng.uniform(200.0, 405.0), rng.uniform(5000.0, 31000.0)
    least = 155.0 * math.sqrt(mass / 200.0)
    most = max(min(310.0, 330.0 - 2.2e-3 * max(height - 12000.0, 0.0)), least + 5.0)
    cg, speed = rng.uniform(25.0, 36.0), rng.uniform(least, most)
    return {"mass_t": mass, "cg_pct": cg, "altitude_ft": height, "cas_kt": speed}


def wide(rng: np.random.Generator, own: Aircraft) -> dict[str, float]:
    """Return a flight point drawn over mass, CG, altitude and speed of an aircraft; not every one trims."""
    spans = WIDE
    if own.own_designs:
        spans = (own.mass.mass_t, own.mass.cg_pct, own.limits.altitude_ft, own.limits.cas_kt)
    mass, cg, height, speed = (rng.uniform(*span) for span in spans)
    return {"mass_t": mass, "cg_pct": cg, "altitude_ft": max(height, 3000.0), "cas_kt": speed}


def reach(own: Aircraft) -> tuple[float, float]:
    """Return the largest angle of attack [deg] and Mach number that designs of another aircraft are for."""
    return min(ALPHA_MARGIN * own.limits.alpha_surely_flies_deg, ALPHA_MAX), min(own.limits.mach[1], MACH_MAX)


def trimming(
    rng: np.random.Generator, fixed: dict[str, Any], where: dict[str, Any], alpha: float = 10.5
) -> dict[str, Any]:
    """Return the arguments of `scenario` with a point of `wide` that trims with throttle below 95 % and angle of
    attack below `alpha` [deg], another aircraft within its `reach`; `where` are further entries of its flight."""
    own, throttle, mach = load_aircraft(fixed.get("aircraft", DEFAULT)), 0.95, math.inf
    if own.own_designs:
        most, fastest = reach(own)
        throttle, alpha, mach = 0.9, 0.8 * most, fastest - 0.03
    while True:
        flight: dict[str, Any] = fixed | {"flight": wide(rng, own) | where}
        try:
            setup = build(scenario(**flight))
        except TrimError:
            continue
        if (setup.trim.throttle < throttle and math.degrees(setup.trim.alpha) < alpha
                and setup.loop.truth["mach"] < mach):  # fmt: skip
            return flight


def somewhere(flight: dict[str, Any], speeds: tuple[float, float] | None = None) -> dict[str, Any]:
    """Return a flight at a point of `wide` that trims, drawn by its seed; between `speeds` [kt] if given."""
    rng = np.random.default_rng([flight["seed"], 2])
    where = {"turbulence": flight["flight"]["turbulence"]}
    return trimming(rng, flight, where | ({"cas_kt": rng.uniform(*speeds)} if speeds else {}))


def over_envelope(first_seed: int, number: int) -> list[dict[str, Any]]:
    """Return the arguments of `scenario` of fault-free flights at points of `envelope` in three airs: the manoeuvres of
    [Sun13] section IV, and two that drive the elevators fastest."""
    out = []
    for k in range(number):
        where = envelope(np.random.default_rng([first_seed, k]))
        kind = LIVELY[k % len(LIVELY)]
        if kind["kind"] in ("nose_up", "pitch_protection") and where["mass_t"] > 300.0:
            kind = kind | {"amplitude_g": 0.15}  # what a heavy aircraft has left
        out.append(draw(first_seed + k, point=where, manoeuvre=kind, turbulence=TURBULENCE[k // 8 % 3],
                        sensors={"noise_scale": NOISE_SCALE}))  # fmt: skip
    return out


def manoeuvring(first_seed: int, number: int) -> list[dict[str, Any]]:
    """Return the arguments of `scenario` of fault-free flights but for their points, which `somewhere` draws."""
    return [draw(first_seed + k, point=POINT, manoeuvre=drawn_manoeuvre(k, first_seed),
                 turbulence=TURBULENCE[k // 8 % 3], sensors={"noise_scale": NOISE_SCALE})
            for k in range(number)]  # fmt: skip


def fly_aircraft(signals: Sequence[str] = (), prepare: Any = None, **arguments: Any) -> pd.DataFrame:
    """Fly `scenario(**arguments)` and return what the estimators of the aircraft read, and `signals` beside it."""
    return fly(scenario(**arguments), [*AIRCRAFT, *signals], prepare=prepare)


def fits(own: Aircraft) -> tuple[str, ...]:
    """Return the detectors of the aircraft level that have all their inputs on an aircraft."""
    return tuple(name for name in LEVEL if not unfit(registry.record(name), own))


def fly_level(**flight: Any) -> pd.DataFrame:
    """Fly `scenario(**flight)` and return what the detectors of the aircraft level read, under its names on the default
    aircraft."""
    own = load_aircraft(flight.get("aircraft", DEFAULT))
    wires = [(sources(d), sources(d, aircraft=own)) for d in fits(own)]
    frame = fly(scenario(**flight), dict.fromkeys([COMMAND, *(s for _, its in wires for s in its.values())]))
    said = {there[field]: frame[its[field]] for there, its in wires for field in its}
    out = pd.DataFrame({**{c: frame[c] for c in frame}, **said}, copy=False)
    out.attrs = frame.attrs
    return out


def fitted(name: str, technology: Sequence[str], aircraft: str = DEFAULT) -> np.ndarray:
    """Return the parameters with which a detector of the aircraft level flies with elevators of `technology`."""
    own = load_aircraft(aircraft)
    p = registry.record(name).fit(site(DT, "", dict(zip(own.segments, technology, strict=True)), own))
    if own.own_designs and "alpha_max" in p.dtype.names:
        p["alpha_max"] = math.radians(reach(own)[0])
    return p


def fly_hydraulic(**arguments: Any) -> pd.DataFrame:
    """Fly `scenario(**arguments)` and return what the hydraulic detectors of the four segments read."""
    return fly(scenario(**arguments), [*(path.format(s) for s in SEGMENTS for path in HYDRAULIC), COMMAND])


def wires(module: ModuleType, segment: str) -> dict[str, str]:
    """Return {input field: signal} of a detector of a hydraulic segment."""
    out = {n: f"iotsekf_in.{segment}.{'y_' if n.startswith('surface') else ''}{n}" for n in module.INPUTS.names}
    return {n: COMMAND if n == "command" else path for n, path in out.items()}


def watch(
    frame: pd.DataFrame, module: ModuleType, p: np.ndarray, fields: Any = None, segments: Any = SEGMENTS
) -> np.ndarray:
    """Return the OUTPUTS (or `fields`) of a hydraulic segment's detector at every tick, shape (segments, ticks)."""
    lanes = [wires(module, s) for s in segments]
    return detect(frame, module, lanes, p, module.OUTPUTS if fields is None else fields)


def estimate(frame: pd.DataFrame, name: str, p: np.ndarray | None = None) -> np.ndarray:
    """Return the STATE log (ticks,) of the Sun13 estimator `name`; `p` PARAMS, by default those of the stored
    design."""
    return detect(frame, MODULES[name], sources(name), p)


def side(frame: pd.DataFrame, which: str) -> np.ndarray:
    """Return the mean elevator of the "left" or "right" side [rad], (ticks,)."""
    return np.asarray(frame[list(SURFACES[:2] if which == "left" else SURFACES[2:])]).mean(1)
