"""Designs and thresholds of the aircraft-level detectors for another aircraft: `cosim design --aircraft NAME`.

What `cosim design`, `cosim train aircraft` and `cosim train rfafe` do for the transport, by the same code, on another
aircraft: LPV boxes over its envelope, the Sun13 estimators at the first point of its record, thresholds from fault-free
flights over its envelope. All of it goes into the aircraft's folder, `designs/` and `thresholds/`.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from actuators.constants import M_PER_FT
from cosim.campaign.jobs import work
from cosim.errors import DesignError, TrimError
from cosim.files import replace_text
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.build import build
from cosim.flight.detection import stored_designs
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources, unfit
from cosim.flight.loop.signals import fly
from cosim.scenario.aircraft import Aircraft, load_aircraft
from cosim.training import lpv_boxes, rfafe, train_aircraft, train_rfafe
from cosim.training.flights import COMMAND, DT, NOISE_SCALE, TOLERANCE, drawn_manoeuvre, estimate, scenario
from cosim.training.threshold_fit import PROBABILITY
from cosim.training.train_aircraft import GUSTS, air
from fdi import registry
from fdi.common import bank, compact
from fdi.lpv_smo import boxes
from fdi.lpv_smo.core import NB

FLIGHTS, FIRST_SEED = 128, 41_000  # fault-free flights of 60 s, and the first seed
ENGINES = (1, 2, 4)  # that the four places of the detectors' force model can stand for
LEAST = 32  # flights: eight manoeuvres in four airs
DRAWS, CHUNKS = 1024, 16  # points tried for the LPV model, and jobs that they are shared among
ALPHA_MARGIN = 0.97  # of the angle that surely flies: no design beyond
MACH_EDGES = lpv_boxes.EDGES[3]
FLOOR = 0.5  # of an accelerometer's noise: five sigma of its mean over half a second, no threshold is lower
DIGITS = 10  # of the numbers in the files
WIDEST = {"mass": 1.75, "cas": 1.35, "cg": 25.0}  # of a box: ratio, ratio, per cent of the chord


def make(
    aircraft: str, *, flights: int = FLIGHTS, first_seed: int = FIRST_SEED, folder: str | Path | None = None,
    workers: int | None = None, progress: Callable[[int, int], None] | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> list[Path]:  # fmt: skip
    """Make and store designs and thresholds for `aircraft`, a name or a folder; return the files.

    Takes 3 minutes of processor time at 128 `flights`. `folder` keeps what is done, so that a killed run goes on;
    `tell` hears each stage, `progress(done, total)` its jobs. Raises DesignError for the default aircraft, and
    where no flight point of the envelope has a steady flight.
    """
    own = load_aircraft(aircraft)
    if own.own_designs is None:
        raise DesignError("its designs are those of fdi/", place=f"--aircraft {aircraft}",
                          remedy="`cosim design` and `cosim train` make them")  # fmt: skip
    if own.engines not in ENGINES:
        allowed = "1, 2 or 4: the places of the force model"
        raise DesignError(f"{own.engines} engines", place=f"--aircraft {aircraft}", allowed=allowed)
    if flights < LEAST:
        raise DesignError(
            f"{flights} flights", place="--flights", allowed=f"at least {LEAST}: each air, each manoeuvre"
        )
    name, digest = str(own.folder), stored_designs.digest(own)
    how: dict[str, Any] = {"folder": folder, "workers": workers, "progress": progress}

    def several(function, *each):
        return work([(function, {"aircraft": name, "digest": digest, **one}) for one in each], **how)

    for detector in train_aircraft.DETECTORS:
        if why := unfit(registry.record(detector), own):
            tell(f"nothing for {detector}: {why}")
    tell("linear models over the envelope, actuators in flight, LMIs")
    jobs: list[Any] = [(form, {"aircraft": name, "digest": digest}) for form in (_published, _airframe)]
    jobs += [(_steady, {"aircraft": name, "digest": digest, "chunk": k}) for k in range(CHUNKS)]
    published, airframe, *chunks = work(jobs, **how)
    held = {"rfafe": published, "rfafe_airframe": airframe}
    written = [_write(own, "designs", one, {"source": digest, **design}) for one, design in held.items()]
    kept = [tuple(np.array(part) for part in row) for rows in chunks for row in rows]
    if not kept:
        raise DesignError("no flight point of its envelope has a steady flight", place=name,
                          remedy=f"`cosim check {aircraft}` says why")  # fmt: skip
    written.append(_boxes(own, lpv_boxes.samples(kept)))

    tell(f"{flights} fault-free flights")
    for old in (own.folder / "thresholds").glob("*.json"):
        old.unlink()  # no flight of the training knows what the last one found
    seeds = [{"index": k, "first_seed": first_seed} for k in range(flights)]
    answered = several(_answered, *({"index": k} for k in range(bank.K)))
    prior = train_aircraft.known(several(_taught, *(one for one in seeds if air(one["index"]) in GUSTS)))
    values = several(_surveyed, *({**one, "prior": prior} for one in seeds))
    written += _thresholds(own, values, answered, prior, flights, first_seed)
    about = {"aircraft_sha256": digest, "flights": flights, "first_seed": first_seed}
    return [*written, _write(own, "designs", Path(stored_designs.FILE).stem, about)]


def check(aircraft: str) -> dict[str, str]:
    """Return {detector: "" or what is wrong} of the designs stored in an aircraft's folder."""
    own = load_aircraft(aircraft)
    level = [r for n in registry.SHIPPED if (r := registry.record(n)).level == "aircraft" and not r.any_aircraft]
    return {record.id: stored_designs.lacking(own, record) for record in level if not unfit(record, own)}


def fits(own: Aircraft) -> tuple[str, ...]:
    """Return the detectors of the aircraft level that have all their inputs on an aircraft."""
    return tuple(name for name in train_aircraft.DETECTORS if not unfit(registry.record(name), own))


def _write(own, kind, name, content):
    path = own.folder / kind / f"{name}.json"
    path.parent.mkdir(exist_ok=True)
    replace_text(path, compact.text(_short(content)))
    return path


def _short(value):
    """Return plain data with its numbers to DIGITS significant digits."""
    if isinstance(value, dict):
        return {k: _short(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_short(v) for v in value]
    return float(f"{value:.{DIGITS - 1}e}") if isinstance(value, float) else value


def _published(aircraft: str, digest: str) -> dict[str, Any]:
    return rfafe.published(lambda text: None, aircraft)


def _airframe(aircraft: str, digest: str) -> dict[str, Any]:
    return rfafe.airframe(lambda text: None, aircraft)


def _limits(own: Aircraft) -> tuple[np.ndarray, float, float]:
    """Return what is sampled, (4, 2): t, %, m, kt, and the largest angle of attack [deg] and Mach number."""
    limits, mass = own.limits, own.mass
    height = [feet * M_PER_FT for feet in limits.altitude_ft]
    span = np.array([mass.mass_t, mass.cg_pct, height, limits.cas_kt])
    alpha = ALPHA_MARGIN * limits.alpha_surely_flies_deg
    return span, min(alpha, lpv_boxes.ALPHA_MAX), min(limits.mach[1], lpv_boxes.MACH_MAX)


def _steady(aircraft: str, digest: str, chunk: int) -> list[Any]:
    """Return rows of `lpv_boxes.steady` for every CHUNKS-th point, plain data."""
    span, alpha, mach = _limits(load_aircraft(aircraft))
    at = lpv_boxes.points(span, DRAWS)[chunk::CHUNKS]
    kept = lpv_boxes.steady(at, alpha_max=alpha, mach_max=mach, aircraft=aircraft)
    return [[part.tolist() for part in row] for row in kept]


def _boxes(own, samples):
    """Design the boxes of an envelope's linear models and store them."""
    low, high = samples.rho.min(axis=0), samples.rho.max(axis=0)
    mach = [m for m in MACH_EDGES if low[3] < m < high[3]]
    cas_ratio = WIDEST["cas"]
    while True:  # wider boxes until the block holds them
        edges = (_geometric(low[0], high[0], WIDEST["mass"]), _even(low[1], high[1], WIDEST["cg"]),
                 _geometric(low[2], high[2], cas_ratio), (max(low[3] - 1e-6, 0.0), *mach, high[3]))  # fmt: skip
        pairs = lpv_boxes.make(samples, edges)
        if len(pairs) <= NB:
            break
        cas_ratio *= 1.15
    path = own.folder / "designs" / "lpv_smo_boxes.json"
    boxes.save(pairs, path, aircraft_sha256=stored_designs.digest(own), draws=DRAWS, seed=lpv_boxes.SOBOL_SEED)
    return path


def _geometric(low, high, ratio):
    n = max(math.ceil(math.log(high / low) / math.log(ratio)), 1)
    return tuple(np.round(np.geomspace(math.floor(low), math.ceil(high), n + 1)).tolist())


def _even(low, high, width):
    n = max(math.ceil((high - low) / width), 1)
    return tuple(np.linspace(math.floor(low), math.ceil(high), n + 1).tolist())


def point(own: Aircraft, rng: np.random.Generator) -> dict[str, float]:
    """Return a flight point drawn over the aircraft's envelope, in a scenario's keys; not every one trims."""
    mass, cg = rng.uniform(*own.mass.mass_t), rng.uniform(*own.mass.cg_pct)
    height, cas = rng.uniform(*own.limits.altitude_ft), rng.uniform(*own.limits.cas_kt)
    return {"mass_t": mass, "cg_pct": cg, "altitude_ft": max(height, 3000.0), "cas_kt": cas}


def arguments(aircraft: str, index: int, first_seed: int) -> dict[str, Any]:
    """Return the arguments of `flights.scenario` of fault-free flight `index`: air, manoeuvre and layout in turn."""
    own, rng = load_aircraft(aircraft), np.random.default_rng([first_seed, index])
    _, alpha, mach = _limits(own)
    layouts = [tuple(own.technology.values()), ("hydraulic",) * len(own.segments)]
    off = {n: float(1 + TOLERANCE * rng.choice((-1, 1))) for n in own.multipliers}
    fixed: dict[str, Any] = {
        "duration": 60.0, "manoeuvre": drawn_manoeuvre(index, first_seed), "seed": first_seed + index,
        "technology": layouts[index // 32 % 2], "sensors": {"noise_scale": NOISE_SCALE},
        "tolerances": {"aero": off}, "aircraft": aircraft,
    }  # fmt: skip
    while True:
        flight: dict[str, Any] = fixed | {
            "flight": {"aircraft": aircraft, **point(own, rng), "turbulence": air(index)}
        }
        try:
            setup = build(scenario(**flight))
        except TrimError:
            continue
        truth = setup.loop.truth
        if setup.trim.throttle < 0.9 and math.degrees(setup.trim.alpha) < 0.8 * alpha and truth["mach"] < mach - 0.03:
            return flight


def flown(own: Aircraft, flight: dict[str, Any]) -> pd.DataFrame:
    """Fly a flight and return what the aircraft-level detectors read, under its names on the default aircraft."""
    wires = {d: (sources(d), sources(d, aircraft=own)) for d in fits(own)}
    frame = fly(scenario(**flight), dict.fromkeys([COMMAND, *(s for _, its in wires.values() for s in its.values())]))
    said = {there[field]: frame[its[field]] for there, its in wires.values() for field in its}
    out = pd.DataFrame({**{c: frame[c] for c in frame}, **said}, copy=False)
    out.attrs = frame.attrs
    return out


def fitted(own: Aircraft, name: str, technology: dict[str, str]) -> np.ndarray:
    """Return the parameters with which detector `name` flies on an aircraft."""
    p = registry.record(name).fit(site(DT, "", technology, own))
    if "alpha_max" in p.dtype.names:
        p["alpha_max"] = math.radians(_limits(own)[1])
    return p


def _trained(aircraft, index, first_seed):
    """Return (aircraft, what its detectors read in training flight `index`, technology of each segment)."""
    own, flight = load_aircraft(aircraft), arguments(aircraft, index, first_seed)
    return own, flown(own, flight), dict(zip(own.segments, flight["technology"], strict=True))


def _taught(aircraft: str, digest: str, index: int, first_seed: int) -> list[float]:
    """Return what `train_aircraft.learned` finds in one training flight."""
    own, frame, technology = _trained(aircraft, index, first_seed)
    return train_aircraft.learned(frame, fitted(own, "rfafe_airframe", technology))


def _surveyed(aircraft: str, digest: str, index: int, first_seed: int, prior: dict[str, Any]) -> dict[str, Any]:
    """Return what the surveys find in one fault-free flight; of detectors not trained in its air nothing."""
    own, frame, technology = _trained(aircraft, index, first_seed)
    flies = [name for name in train_aircraft.SURVEYS if name in fits(own)]
    with_ = lambda name: fitted(own, name, technology)  # noqa: E731
    out: dict[str, Any] = train_aircraft.surveys(frame, air(index), with_, prior, flies)
    if air(index) in train_rfafe.TURBULENCE:
        runs, whatever, slow = train_rfafe.survey(frame, "rfafe", fitted(own, "rfafe", technology))
        out["rfafe"] = [runs.tolist(), whatever.tolist(), slow]
    return out


def _answered(aircraft: str, digest: str, index: int) -> float:
    """Return how much command the law answers an oscillation with, over the amplitude of rfafe's estimate, at one
    frequency of the bank."""
    own, hz = load_aircraft(aircraft), float(bank.frequencies()[index])
    technology = {s: "hydraulic" for s in own.segments}
    fault = {"target": f"elevator.{own.segments[0]}", "kind": "ofc_liquid", "at": "command", "start_s": 2.0,
             "amplitude_deg": min(4.0, 30.0 / (2.0 * math.pi * hz)), "frequency_hz": hz}  # fmt: skip
    flight = {"duration": 2.0 + max(8.0 / hz, 3.0), "faults": [fault], "aircraft": aircraft,
              "flight": own.points[rfafe.point_of(own)], "technology": tuple(technology.values())}  # fmt: skip
    last = estimate(flown(own, flight), "rfafe", fitted(own, "rfafe", technology))[-1]
    f, u = (math.hypot(last["bank_cos"][i, index], last["bank_sin"][i, index]) for i in (0, 1))
    return u / max(f, 1e-12)


def _thresholds(own, values, answered, prior, flights, first_seed):
    """Store the thresholds that the surveys ask for; return the files."""
    how = {"command": f"cosim design --aircraft {own.name}", "flights": flights, "first_seed": first_seed,
           "flight_s": 60.0}  # fmt: skip
    written = []
    for t in train_aircraft.limits(values, prior):
        fields = dict(t.fields)
        if "alpha_max" in registry.module(t.detector).PARAMS.names:
            fields["alpha_max"] = math.radians(_limits(own)[1])
        if t.detector == "control_redundancy":
            fields |= {f"t_{axis}": max(fields[f"t_{axis}"], FLOOR * TRANSPORT[f"n_{axis}"][1]) for axis in "xyz"}
        about = {**how, "probability_per_flight": PROBABILITY, "air": t.found["air"]}
        written.append(_write(own, "thresholds", t.detector, {"flight": _plain(fields), "training": about}))
    found: list[tuple[dict, dict]] = [({}, {"rfafe": v["rfafe"]}) for v in values if "rfafe" in v]
    fields, _ = train_rfafe.fields("rfafe", found, np.array(answered))
    about = {**how, "margin": train_rfafe.MARGIN, "air": list(train_rfafe.TURBULENCE)}
    return [*written, _write(own, "thresholds", "rfafe", {"flight": _plain(fields), "training": about})]


def _plain(fields):
    return {k: np.asarray(v).tolist() for k, v in fields.items()}
