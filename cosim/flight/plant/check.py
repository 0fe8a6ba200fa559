"""Contract check of an aircraft's folder (aircraft/README.md): one line per point, what is missing first."""

import math
from collections.abc import Iterator

import numpy as np

from cosim.errors import ScenarioError, TrimError
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import FlightPoint
from cosim.scenario.aircraft import load_aircraft, multipliers
from cosim.scenario.catalog import TECHNOLOGIES

SIGNS = (  # input, what it moves, which way, in words
    ("elevator", "qdot", -1, "trailing edge down pitches down"),
    ("stab", "qdot", -1, "trailing edge down pitches down"),
    ("da_l", "pdot", 1, "a positive left aileron rolls right"),
    ("da_r", "pdot", 1, "a positive right aileron rolls right"),
    ("dr", "rdot", -1, "a positive rudder yaws left"),
    ("throttle", "udot", 1, "throttle accelerates"),
)


def rows(name: str) -> Iterator[tuple[str, str, str]]:
    """Yield (point of the contract, "good" or "bad", what was found) about a bundled aircraft or a folder, up to where
    nothing further can be looked at."""
    stage = "record"
    try:
        aircraft = load_aircraft(name)
        yield _row(stage, True, f"{aircraft.title}: {len(aircraft.segments)} segments, {aircraft.engines} engines")
        if unknown := sorted({*aircraft.technology.values(), *aircraft.actuators} - {*TECHNOLOGIES}):
            yield _row("actuators", False, f"unknown {', '.join(unknown)}; allowed: {', '.join(TECHNOLOGIES)}")
            return
        point, stage = _middle(name, aircraft), "JSBSim model"
        plant = Plant(point)
        yield _row(stage, True, "loads; every property of the contract is there")
        yield _geometry(plant, aircraft)
        stage = "trim"
        trim = plant.trim()
    except (ScenarioError, TrimError) as error:
        yield _row(stage, False, str(error))
        return
    said = f"alpha {math.degrees(trim.alpha):.1f} deg, stabiliser {math.degrees(trim.stabilizer):.1f} deg"
    yield _row("trim", True, f"{point.words}: {said}, throttle {trim.throttle:.2f}")
    t = plant.truth()[0]
    said = f"CG {t.cg * 100:.1f} % for {point.cg * 100:.1f} %, n_z {t.nz:.3f} in level flight"
    yield _row("loading", abs(t.cg - point.cg) < 1e-3 and abs(t.nz - 1.0) < 0.02, said)
    yield from _signs(plant, trim)
    yield from _hinges(plant, trim, aircraft)
    yield _multipliers(plant, trim, multipliers(aircraft.folder))
    yield from _points(name, aircraft)


def _row(point, good, said):
    return point, "good" if good else "bad", said


def _middle(name, aircraft):
    """Return a point in the middle of what may be flown: the first of its own points, or one at 15,000 ft."""
    if aircraft.points:
        return FlightPoint.at(**next(iter(aircraft.points.values())), aircraft=name)
    low, high = aircraft.limits.cas_kt
    speed = low + 0.65 * (high - low)
    return FlightPoint.at(
        sum(aircraft.mass.mass_t) / 2, sum(aircraft.mass.cg_pct) / 2, 15000.0, cas_kt=speed, aircraft=name
    )


def _geometry(plant, aircraft):
    g, get = aircraft.geometry, plant.port.get
    of_model = {"wing_area_ft2": "metrics/Sw-sqft", "span_ft": "metrics/bw-ft", "chord_ft": "metrics/cbarw-ft",
                "station_in": "metrics/aero-rp-x-in"}  # fmt: skip
    values = {key: (getattr(g, key), get(name)) for key, name in of_model.items()}
    wrong = [f"{key} = {own:g}, the model has {value:g}" for key, (own, value) in values.items()
             if abs(value - own) > 1e-3 * abs(value)]  # fmt: skip
    said = "; ".join(wrong) or "record and model agree on area, span, chord and reference"
    return _row("geometry", not wrong, said)


def _truth(plant, trim, moved=(), by=0.0, **state):
    """Return the truth of the trim with inputs `moved` `by` a step, and what else of its `state` is another."""
    surfaces = trim.surfaces.copy()
    surfaces[plant.border.column(moved)] += by
    at = {"tas": trim.tas, "alpha": trim.alpha, "theta": trim.theta, "altitude": trim.altitude, "q": trim.q, **state}
    plant.place(**at, surfaces=surfaces)
    return plant.truth()[0]


def _signs(plant, trim) -> Iterator[tuple[str, str, str]]:
    groups = {"elevator": plant.border.elevators, "throttle": plant.border.throttles}
    base = _truth(plant, trim)
    for name, field, sign, words in SIGNS:
        for one in groups.get(name, (name,)):
            change = float(_truth(plant, trim, (one,), 0.02)[field] - base[field])
            unit = "m/s2" if field == "udot" else "rad/s2"
            effect = f"{change / 0.02:+.3g} {unit} per {'1' if name == 'throttle' else 'rad'}"
            yield _row(f"effector {one}", change * sign > 1e-7, f"{words}: {effect}")


def _hinges(plant, trim, aircraft) -> Iterator[tuple[str, str, str]]:
    t, (low, high) = _truth(plant, trim), aircraft.travels["elevator"]
    for name, short in aircraft.short.items():
        hm0, hmd = float(t[f"hm0_{short}"]), float(t[f"hmd_{short}"])
        technology = TECHNOLOGIES[aircraft.technology[name]]
        most = max(abs(hm0 + hmd * low), abs(hm0 + hmd * high))
        stall = technology.design(aircraft.own(technology.name)).stall_moment
        said = f"{most:.0f} N m at full travel here, its {technology.name} actuator stalls at {stall:.0f} N m"
        yield _row(f"hinge moment {name}", hmd < 0.0 and math.isfinite(hm0), f"{said}, slope {hmd:.0f} N m/rad")


def _points(name, aircraft) -> Iterator[tuple[str, str, str]]:
    for label, keys in aircraft.points.items():
        try:
            trim = Plant(FlightPoint.at(**keys, aircraft=name)).trim()
        except (TrimError, ValueError) as error:
            yield _row(f"point {label}", False, str(error))
            continue
        said = f"alpha {math.degrees(trim.alpha):.1f} deg, throttle {trim.throttle:.2f}"
        yield _row(f"point {label}", trim.throttle < 0.95, said)


def _multipliers(plant, trim, names):
    """Return whether each multiplier of a coefficient changes an acceleration or a hinge moment in some odd state."""
    felt = [name for name in plant.border.truth.names if name.endswith("dot") or name.startswith("hm")]
    inputs = tuple(name for name in plant.border.inputs if not name.startswith("thrust_loss"))
    steps = np.linspace(0.03, 0.06, len(inputs))  # no two alike

    def state(name, factor):
        plant.port.set(f"aero/mult/{name}", factor)
        return np.array(_truth(plant, trim, inputs, steps, beta=0.02, p=0.02, r=0.02)[felt].tolist())

    dead = [name for name in names if not np.abs(state(name, 2.0) - state(name, 1.0)).max() > 1e-9]
    said = f"{', '.join(dead)} change nothing" if dead else f"{len(names)} coefficients can be scaled"
    return _row("multipliers", bool(names) and not dead, said if names else "the model has none (aero/mult/...)")
