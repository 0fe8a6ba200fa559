"""The same faults at the design point of each aircraft-level detector and at other corners of the envelope.

The Sun13 estimators and the thresholds of [Mar10] are at home at the point of Sun13 (200 t, 290 kt), the LPV observer
anywhere in the box of Alwi14, whose points A to E are its corners and its middle; Sun13's point lies outside that box.
Per detector and fault: whether it alarms in time, and the estimate over the fault.
"""

import math
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.flight.plant.point import SIX
from cosim.flight.signals import fly
from cosim.judge.achieved import sine
from cosim.judge.alarms import detection
from cosim.papers.studies import Options, Table
from cosim.scenario.load import load_scenario

DETECTORS = ("rfafe", "rfafe_airframe", "lpv_smo", "control_redundancy")
ONSET, END, HZ = 24.0, 36.0, 1.0
FIRST_SEED = 1_000_700
TURBULENCE = ("none", "light")
DOUBLET = ("manoeuvre.kind=nz_doublet", "manoeuvre.start_s=26", "manoeuvre.width_s=3", "manoeuvre.amplitude_g=0.15")
AMPLITUDE, BIAS, NZ, ALPHA, LOSS = 4.0, 3.0, 0.3, 3.0, 25.0  # [deg], [deg], [g], [deg], [%]


def _fault(**given):
    return tuple(f"faults.0.{k}={v}" for k, v in {"start_s": ONSET, **given}.items())


CASES = {
    f"OFC {HZ:g} Hz, {AMPLITUDE:g} deg, left": _fault(
        target="elevator.left", kind="ofc_liquid", at="command", amplitude_deg=AMPLITUDE, frequency_hz=HZ
    ),
    f"elevators +{BIAS:g} deg": (*_fault(target="elevator.all", kind="bias", bias_deg=BIAS), *DOUBLET),
    f"n_z +{NZ:g} g": (*_fault(target="sensor.n_z", kind="bias", path="observers", bias_g=NZ), *DOUBLET),
    f"alpha +{ALPHA:g} deg": (*_fault(target="sensor.alpha", kind="bias", path="observers", bias_deg=ALPHA), *DOUBLET),
    f"thrust -{LOSS:g} %": (*_fault(target="engine.all", kind="thrust_loss", loss_pct=LOSS), *DOUBLET),
    "none": DOUBLET,
}
OFC, BIASED, N_Z, ANGLE, THRUST, NONE = CASES
# which estimate of which detector is set beside which fault: field, size of the fault
ESTIMATES = {
    (BIASED, "lpv_smo"): ("f_hat_elevator", BIAS * RAD_PER_DEG),
    (BIASED, "control_redundancy"): ("f_hat_elevator", BIAS * RAD_PER_DEG),
    (N_Z, "lpv_smo"): ("f_hat_n_z", NZ),
    (ANGLE, "lpv_smo"): ("f_hat_alpha", ALPHA * RAD_PER_DEG),
    (THRUST, "control_redundancy"): ("f_hat_thrust", -LOSS / 100.0),
}
OSCILLATES = {"rfafe": "f_hat_left", "rfafe_airframe": "f_hat", "lpv_smo": "f_hat_elevator"}
SHOWN = (
    (OFC, DETECTORS), (BIASED, ("lpv_smo", "control_redundancy")), (N_Z, ("lpv_smo",)), (ANGLE, ("lpv_smo",)),
    (THRUST, ("control_redundancy",)), (NONE, DETECTORS),
)  # fmt: skip


def measure(point: str, case: Any, turbulence: Any, seed: int) -> dict[str, list[float | None]]:
    """Fly one case; return {detector: [delay s or None, estimate over fault or None, largest r, share believed]}.

    The estimate of the oscillation is the ratio of sines over 8 s from 2 s after the onset, the fault that of the left
    side (rfafe: of its command; the others: of the mean elevator, half the difference of the sides); that of a step is
    the mean of the last 4 s. r and the share of ticks on which the detector believes itself are those after the onset.
    """
    changes = [*(f"flight.{k}={v}" for k, v in SIX[point].items()), f"flight.turbulence={turbulence}",
               f"seed={seed}", f"duration_s={END}",
               "detectors.enabled=" + str(list(DETECTORS)), *CASES[case]]  # fmt: skip
    fields = {name: {"alarm", "r", "valid"} for name in DETECTORS}
    for (c, name), (field, _) in ESTIMATES.items():
        fields[name] |= {field} if c == case else set()
    for name, field in OSCILLATES.items():
        fields[name].add(field)
    surfaces = [f"truth.aircraft.de_{s}" for s in ("lo", "li", "ri", "ro")]
    names = [f"{name}.aircraft.{field}" for name, own in fields.items() for field in sorted(own)]
    flown = fly(load_scenario("cruise", changes), [*names, *surfaces])
    late = flown.index >= ONSET
    return {name: _one(flown, name, case, late, surfaces) for name in DETECTORS}


def _one(flown, name, case, late, surfaces):
    flown, t_all = {n: flown[n].to_numpy() for n in flown}, flown.index.to_numpy()
    alarm = flown[f"{name}.aircraft.alarm"]
    at = detection(alarm, int(np.argmax(late)))
    delay = None if at is None else float(t_all[at] - ONSET)
    estimate = None
    if (case, name) in ESTIMATES:
        field, size = ESTIMATES[case, name]
        estimate = float(flown[f"{name}.aircraft.{field}"][t_all >= END - 4.0].mean() / size)
    elif case == OFC and name in OSCILLATES:
        field = OSCILLATES[name]
        on = (t_all >= ONSET + 2.0) & (t_all < ONSET + 10.0)
        t, w = t_all[on], 2.0 * math.pi * HZ
        left, right = (0.5 * (flown[a][on] + flown[b][on]) for a, b in (surfaces[:2], surfaces[2:]))
        true = AMPLITUDE * RAD_PER_DEG if name == "rfafe" else abs(sine(t, 0.5 * (left - right), w))
        estimate = float(abs(sine(t, flown[f"{name}.aircraft.{field}"][on], w)) / true)
    r = float(np.abs(flown[f"{name}.aircraft.r"][late]).max())
    return [delay, estimate, r, float(flown[f"{name}.aircraft.valid"][late].mean())]


def _cases(seeds):
    return [(p, c, turbulence, FIRST_SEED + s) for c in CASES for p in SIX for turbulence in TURBULENCE
            for s in range(seeds)]  # fmt: skip


def jobs(options: Options) -> list[Any]:
    """Return the flights."""
    return [(measure, dict(zip(("point", "case", "turbulence", "seed"), key))) for key in _cases(options.seeds)]


def tables(options: Options, values: Any) -> list[Table]:
    """Return a table per fault: detectors over points."""
    seeds = options.seeds
    got = dict(zip(_cases(seeds), values))
    out = []
    for case, detectors in SHOWN:
        rows = []
        for name in detectors:
            for turbulence in TURBULENCE:
                cells = {p: [got[p, case, turbulence, FIRST_SEED + s][name] for s in range(seeds)] for p in SIX}
                rows += _rows(name, turbulence, case, cells, seeds)
        title = f"{case}; {seeds} seeds per point and turbulence" if case != NONE else f"fault-free, {seeds} seeds"
        out.append(Table(title, ("detector", "turbulence", "figure", *(f"{p}>" for p in SIX)), rows))
    return out


def _rows(name, turbulence, case, cells, seeds):
    """Return the rows of one detector: alarms, delay, estimate, largest r, share of time that it believes itself."""
    out = [("flights with an alarm", [sum(c[0] is not None for c in cells[p]) for p in SIX])]
    if case != NONE:
        out.append(("mean delay [s]", [_mean([c[0] for c in cells[p]]) for p in SIX]))
    if any(c[1] is not None for p in SIX for c in cells[p]):
        out.append(("estimate over fault", [_mean([c[1] for c in cells[p]]) for p in SIX]))
    out.append(("largest r", [max(c[2] for c in cells[p]) for p in SIX]))
    out.append(("believes itself [% of time]", [100.0 * _mean([c[3] for c in cells[p]]) for p in SIX]))
    return [(name, turbulence, label, *values) for label, values in out]


def _mean(values):
    given = [v for v in values if v is not None]
    return sum(given) / len(given) if given else math.nan
