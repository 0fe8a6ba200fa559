"""Which oscillations of one elevator segment the aircraft-level detectors see within three periods.

A grid of frequencies and amplitudes on the left inner segment, at the valve, hands off, in still air and in light
turbulence, at the point of Sun13 and at E of Alwi14 (the LPV observer does not believe 200 t). Amplitudes are those
achieved, against the same flight without the fault. Beside them stands the physics bound: the amplitude whose motion is
three sigma of a sine fitted to three periods of the pitch rate alone, known aircraft, still air
(fdi/common/physics_bound.py). The folder that is written is a campaign: `cosim compare FOLDER` draws its maps.
"""

import functools
import math

import numpy as np

from cosim.campaign import EVALUATION_SEED, run_many
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import SIX, FlightPoint
from cosim.papers.studies.aircraft_level.table import Table
from cosim.scenario import parse
from fdi.common import physics_bound

DETECTORS = ("rfafe", "rfafe_airframe", "lpv_smo", "control_redundancy")
POINTS = {name: SIX[name] for name in ("sun13", "E")}
TURBULENCE = ("none", "light")
HZ = (0.5, 1.0, 2.0, 5.0)
ALL_HZ = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
DEGREES = (0.15, 0.3, 0.6, 1.2, 2.4, 4.8, 9.6)
MM_PER_DEG = 300.0 * math.pi / 180.0  # of rod, arm 0.30 m
RATE = 40.0  # what the servos follow [deg/s]: larger amplitudes are not flown
ONSET = 22.0  # the slowest detector has learned by then [s]
SEGMENT = ("de_li",)
PERIODS = 3.0
SEEDS = 3
STATES, DT = ("tas", "alpha", "q", "theta"), 0.005


def scenarios(hz=HZ, seeds=SEEDS):
    """Return ([Scenario], [label]) of the grid."""
    flights, labels = [], []
    for point, flight in POINTS.items():
        for turbulence in TURBULENCE:
            for f in hz:
                for amplitude in DEGREES:
                    if 2 * math.pi * f * amplitude > RATE:
                        continue
                    for seed in range(seeds):
                        flights.append(parse(_table(flight, turbulence, f, amplitude, EVALUATION_SEED + 500 + seed)))
                        labels.append({"point": point, "nominal_deg": amplitude})
    return flights, labels


def _table(flight, turbulence, hz, amplitude, seed):
    fault = {"target": "elevator.left_inner", "kind": "ofc_liquid", "at": "valve", "start_s": ONSET,
             "frequency_hz": hz, "amplitude_mm": amplitude * MM_PER_DEG}  # fmt: skip
    return {"duration_s": math.ceil(ONSET + 2 * PERIODS / hz + 1.0), "seed": seed, "manoeuvre": {"kind": "cruise"},
            "flight": {**flight, "turbulence": turbulence}, "faults": [fault],
            "detectors": {"enabled": list(DETECTORS)}}  # fmt: skip


@functools.cache
def bound(point, hz):
    """Return the physics bound [deg] of one segment's oscillation at `hz`, from the aircraft's own linear model."""
    model = linearize(FlightPoint.at(**POINTS[point]))
    A, B, C, D = model.block(STATES, SEGMENT, ("q",))
    q = physics_bound.motion_per_degree(A, B, C, D, [hz])[:, 0, 0]
    sigma = math.degrees(TRANSPORT["q"][1])
    return float(physics_bound.detectable_amplitude(q, sigma, frequencies_hz=[hz], sample_s=DT)[0])


def seen(frame):
    """Return a bool per row: an alarm that rose after the onset, within three periods of the fault."""
    limit = PERIODS + DT * frame["faults.0.frequency_hz"]
    return (frame["delay_periods"] <= limit).fillna(False).to_numpy(bool)


def summary(frame):
    """Return rows (point, turbulence, Hz, bound, then per detector the least amplitude seen in every seed from there
    on up, None where there is none), amplitudes [deg] achieved (the mean over the seeds)."""
    frame = frame.assign(seen=seen(frame))
    keys = ["label.point", "flight.turbulence", "faults.0.frequency_hz"]
    out = []
    for (point, turbulence, hz), part in frame.groupby(keys, sort=False):
        least = []
        for name in DETECTORS:
            cells = part[part["id"] == name].groupby("label.nominal_deg").agg({"seen": "mean", "amplitude_deg": "mean"})
            best = None
            for _, cell in cells.sort_index(ascending=False).iterrows():
                if cell["seen"] < 1.0:
                    break
                best = float(cell["amplitude_deg"])
            least.append(best)
        most = float(part["amplitude_deg"].max())
        out.append((point, turbulence, float(hz), bound(point, float(hz)), *least, most))
    return out


def run(*, out=None, workers=2, progress=None, hz=HZ, seeds=SEEDS, flights=None):
    """Fly the grid and return its tables; `out` is the campaign's folder, what it holds is not flown again."""
    flights, labels = flights or scenarios(hz, seeds)
    found = run_many(flights, workers=workers, out=out, labels=labels, progress=progress)
    frame = found.frame[found.frame["id"].notna()].reset_index(drop=True)
    head = ("point", "turbulence", "Hz", "bound", *DETECTORS, "largest flown")
    notes = (
        f"seen: an alarm within {PERIODS:g} periods in each of {seeds} seeds, at this and at every larger amplitude",
        "- : not even at the largest that was flown",
        f"bound: pitch rate alone, 3 sigma over {PERIODS:g} periods, known aircraft, still air",
    )
    title = (f"smallest oscillation of the left inner elevator seen [deg achieved], {found.done} flights, "
             f"{found.failed} of them failed")  # fmt: skip
    cells = frame.assign(seen=seen(frame)).pivot_table(
        index=["label.point", "flight.turbulence", "faults.0.frequency_hz", "label.nominal_deg"], columns="id",
        values="seen", aggfunc="mean", sort=True)  # fmt: skip
    rows = [(*map(_plain, key), *(float(row[d]) for d in DETECTORS)) for key, row in cells.iterrows()]
    second = Table("share of the flights in which it is seen within 3 periods",
                   ("point", "turbulence", "Hz", "nominal deg", *DETECTORS), rows)  # fmt: skip
    false = frame.groupby("id")["false_alarms"].sum()
    early = Table("alarms before the fault and outside it, in all of these flights", ("detector", "alarms"),
                  [(d, int(false[d])) for d in DETECTORS])  # fmt: skip
    return [Table(title, head, summary(frame), notes), second, early]


def _plain(x):
    return x if isinstance(x, str) else float(np.float64(x))
