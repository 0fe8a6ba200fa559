"""Designs and thresholds of the aircraft-level detectors: `python -m cosim.training all --aircraft DIR`.

What the trainings `designs`, `aircraft` and `rfafe` do for the transport, by the same code, on another aircraft:
LPV boxes over its envelope, the Sun13 estimators at the first point of its record, thresholds from fault-free
flights over its envelope. All of it goes into the aircraft's folder, `designs/` and `thresholds/`.
"""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from actuators.constants import M_PER_FT
from cosim.campaign.pool import work
from cosim.errors import DesignError
from cosim.files import replace_text
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.detection import stored_designs
from cosim.flight.detection.detectors import unfit
from cosim.scenario.aircraft import load_aircraft
from cosim.training import lpv, rfafe, train_aircraft, train_rfafe
from cosim.training.flights import FLIGHT_S, TURBULENCE, reach
from cosim.training.train_aircraft import ALL_HYDRAULIC, elevators, fits, fitted, flown
from cosim.training.trainer import significant
from fdi import registry
from fdi.common import bank, compact
from fdi.lpv_smo.core import NB

FLIGHTS, FIRST_SEED = 128, 41_000  # fault-free flights of 60 s, and the first seed
ENGINES = (1, 2, 4)  # that the four places of the detectors' force model can stand for
LEAST = 32  # flights: eight manoeuvres in four airs
DRAWS, CHUNKS = 1024, 16  # points tried for the LPV model, and jobs that they are shared among
MACH_EDGES = lpv.EDGES[3]
FLOOR = 0.5  # of an accelerometer's noise: five sigma of its mean over half a second, no threshold is lower
DIGITS = 10  # of the numbers in the files
WIDEST = {"mass": 1.75, "cas": 1.35, "cg": 25.0}  # of a box: ratio, ratio, per cent of the chord


def make(
    aircraft: str, *, flights: int = FLIGHTS, first_seed: int = FIRST_SEED, workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> list[Path]:  # fmt: skip
    """Make and store designs and thresholds for `aircraft`, a name or a folder; return the files.

    Takes 3 minutes of processor time at 128 `flights`. `tell` hears each stage, `progress(done, total)` its jobs.
    Raises DesignError for the default aircraft, and where no flight point of the envelope has a steady flight.
    """
    own = load_aircraft(aircraft)
    if own.own_designs is None:
        raise DesignError("its designs are those of fdi/", place=f"--aircraft {aircraft}",
                          remedy="`python -m cosim.training all` makes them")  # fmt: skip
    if own.engines not in ENGINES:
        allowed = "1, 2 or 4: the places of the force model"
        raise DesignError(f"{own.engines} engines", place=f"--aircraft {aircraft}", allowed=allowed)
    if flights < LEAST:
        raise DesignError(
            f"{flights} flights", place="--flights", allowed=f"at least {LEAST}: each air, each manoeuvre"
        )
    name, digest = str(own.folder), stored_designs.digest(own)
    given = {"aircraft": name, "digest": digest}
    run: Any = partial(work, workers=workers, progress=progress)
    for detector in train_aircraft.DETECTORS:
        if why := unfit(registry.record(detector), own):
            tell(f"nothing for {detector}: {why}")
    tell("linear models over the envelope, actuators in flight, LMIs")
    jobs: list[Any] = [(_estimators, {**given, "form": form}) for form in ("published", "airframe")]
    published, airframe, *chunks = run([*jobs, *((_steady, {**given, "chunk": k}) for k in range(CHUNKS))])
    held = {"rfafe": published, "rfafe_airframe": airframe}
    written = [_write(own, "designs", one, {"source": digest, **design}) for one, design in held.items()]
    kept = [tuple(map(np.array, row)) for rows in chunks for row in rows]
    if not kept:
        raise DesignError("no flight point of its envelope has a steady flight", place=name,
                          remedy=f"`cosim check {aircraft}` says why")  # fmt: skip
    written.append(_boxes(own, lpv.samples(kept, [])))

    tell(f"{flights} fault-free flights")
    for old in (own.folder / "thresholds").glob("*.json"):
        old.unlink()  # no flight of the training knows what the last one found
    answers = run([(_answered, {**given, "index": k}) for k in range(bank.K)])
    values = train_aircraft.collect(first_seed, flights, run, fits(own), **given)
    written += _thresholds(own, values, answers, flights, first_seed)
    about = {"aircraft_sha256": digest, "flights": flights, "first_seed": first_seed}
    return [*written, _write(own, "designs", Path(stored_designs.FILE).stem, about)]


def check(aircraft: str) -> dict[str, str]:
    """Return {detector: "" or what is wrong} of the designs stored in an aircraft's folder."""
    own = load_aircraft(aircraft)
    level = [r for n in registry.SHIPPED if (r := registry.record(n)).level == "aircraft" and not r.any_aircraft]
    return {record.id: stored_designs.lacking(own, record) for record in level if not unfit(record, own)}


def _write(own, kind, name, content):
    path = own.folder / kind / f"{name}.json"
    path.parent.mkdir(exist_ok=True)
    replace_text(path, compact.text(significant(content, DIGITS)))
    return path


def _estimators(aircraft: str, digest: str, form: str) -> dict[str, Any]:
    return getattr(rfafe, form)(lambda text: None, aircraft)


def _steady(aircraft: str, digest: str, chunk: int) -> list[Any]:
    """Return rows of `lpv.linearised` for every CHUNKS-th point, plain data."""
    own = load_aircraft(aircraft)
    height = [feet * M_PER_FT for feet in own.limits.altitude_ft]
    span, (alpha, mach) = np.array([own.mass.mass_t, own.mass.cg_pct, height, own.limits.cas_kt]), reach(own)
    steady = partial(lpv.short_of_stall, alpha_max=alpha, mach_max=mach, aircraft=aircraft)
    kept, _ = lpv.linearised(lpv.points(span, DRAWS)[chunk::CHUNKS], steady)
    return [[part.tolist() for part in row] for row in kept]


def _boxes(own, samples):
    """Design the boxes of an envelope's linear models and store them."""
    low, high = samples.rho.min(axis=0), samples.rho.max(axis=0)
    mach = [m for m in MACH_EDGES if low[3] < m < high[3]]
    cas_ratio = WIDEST["cas"]
    while True:  # wider boxes until the block holds them
        edges = (_geometric(low[0], high[0], WIDEST["mass"]), _even(low[1], high[1], WIDEST["cg"]),
                 _geometric(low[2], high[2], cas_ratio), (max(low[3] - 1e-6, 0.0), *mach, high[3]))  # fmt: skip
        pairs = lpv.boxed(samples, edges)
        if len(pairs) <= NB:
            break
        cas_ratio *= 1.15
    path = own.folder / "designs" / "lpv_smo_boxes.json"
    replace_text(path, compact.text({"aircraft_sha256": stored_designs.digest(own), **lpv.stacked(pairs, DRAWS)}))
    return path


def _geometric(low, high, ratio):
    n = max(math.ceil(math.log(high / low) / math.log(ratio)), 1)
    return tuple(np.round(np.geomspace(math.floor(low), math.ceil(high), n + 1)).tolist())


def _even(low, high, width):
    n = max(math.ceil((high - low) / width), 1)
    return tuple(np.linspace(math.floor(low), math.ceil(high), n + 1).tolist())


def _answered(aircraft: str, digest: str, index: int) -> dict[str, float]:
    """Return {estimator: what `train_rfafe.answered` finds at one frequency of the bank}."""
    own = load_aircraft(aircraft)
    flight = {"aircraft": aircraft, "flight": own.points[rfafe.point_of(own)],
              "technology": elevators(ALL_HYDRAULIC, own)}  # fmt: skip
    frame = flown(flight | train_rfafe.oscillating(own.segments[0], index, 2.0))
    return {name: train_rfafe.answered(frame, name, index, fitted(name, ALL_HYDRAULIC, aircraft))
            for name in train_rfafe.MODULES}  # fmt: skip


def _thresholds(own, values, answers, flights, first_seed):
    """Store the thresholds that the surveys ask for; return the files."""
    how = {"command": f"python -m cosim.training all --aircraft {own.name}", "flights": flights,
           "first_seed": first_seed, "flight_s": FLIGHT_S}  # fmt: skip
    written = []
    for t in train_aircraft.limits(values):
        fields = dict(t.fields)
        if "alpha_max" in registry.module(t.detector).PARAMS.names:
            fields["alpha_max"] = math.radians(reach(own)[0])
        if t.detector == "control_redundancy":
            noise = [TRANSPORT[f"n_{axis}"][1] for axis in "xyz"]
            fields["threshold"] = np.maximum(fields["threshold"], FLOOR * np.array(noise)).tolist()
        about = {**how, **{k: t.found[k] for k in ("probability_per_flight", "air")}}
        written.append(_write(own, "thresholds", t.detector, {"flight": fields, "training": about}))
    about = {**how, "margin": train_rfafe.MARGIN, "air": list(TURBULENCE)}
    for name in train_rfafe.MODULES:
        fields, _ = train_rfafe.fields([v[name] for v in values if name in v], np.array([a[name] for a in answers]))
        written.append(_write(own, "thresholds", name, {"flight": fields, "training": about}))
    return written
