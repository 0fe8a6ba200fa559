"""[Lu17] in the aircraft: figures 2 to 5 on the left inner segment, with the filter's three ways of knowing the load.

The scenarios are `lu17-fault-free`, `lu17-liquid-ofc`, `lu17-solid-ofc`, and `lu17-liquid-jam`: a 3-2-1-1
of 4 deg from 10 s in light turbulence, faults from 12 s. The filters run on what they read there: "published" leaves
the load out, "hinge model" has the detectors' own model, which is up to 20 % wrong, "pressure" measures the pressure
difference and lets the load walk.
"""

import functools
from typing import Any

import numpy as np

from cosim.flight.signals import detect, fly
from cosim.judge.achieved import sine
from cosim.papers.row import Of
from cosim.scenario import load_scenario
from fdi.hydraulic import iotsekf, rtsekf

ONSET, LANE, HZ, BIAS = 12.0, "left_inner", 1.0, 5e-3
FORMS = {"published": 0, "hinge model": 1, "pressure": 2}
TRUE = ("q_rod", "qd_rod", "x3")
INPUTS = {n: f"iotsekf_in.{LANE}.{n}" for n in iotsekf.INPUTS.names}
SIGNALS = (
    *INPUTS.values(),
    *(f"hydraulic.{LANE}.{n}" for n in TRUE),
    f"hydraulic_in.{LANE}.f_u",
    f"hydraulic_in.{LANE}.s_u",
    f"hydraulic.{LANE}.delta",
)


@functools.cache
def flight(name: str, *changes: Any) -> Any:
    """Return the flown table of a scenario."""
    return fly(load_scenario(name, list(changes)), SIGNALS)


@functools.cache
def filtered(name: str, form: Any) -> tuple[Any, ...]:
    """Return (table, log) of the IOTSEKF in one of FORMS."""
    frame = flight(name)
    fields = ("f_hat", "q_now", "v_now", "x3_now")
    return frame, detect(frame, iotsekf, INPUTS, iotsekf.params(load=FORMS[form]), fields)


def true_fault(frame: Any) -> Any:
    """Return what the valve did beyond its command [1], (ticks,)."""
    u = frame[f"iotsekf_in.{LANE}.u"].shift(-1, fill_value=0.0)  # the filter reads the command of the last tick
    return (frame[f"hydraulic_in.{LANE}.f_u"] - frame[f"hydraulic_in.{LANE}.s_u"] * u).to_numpy()


def _states(frame, log, late):
    """Return the rms errors of q [mm], q' [mm/s] and x3 in words."""
    pairs = zip(("q_now", "v_now", "x3_now"), TRUE, (1e3, 1e3, 1.0), ("mm", "mm/s", "of P_s"), strict=True)
    errors = (
        (s * np.sqrt(np.mean((log[e][1:] - frame[f"hydraulic.{LANE}.{n}"].to_numpy()[:-1])[late[1:]] ** 2)), u)
        for e, n, s, u in pairs
    )
    return "states: " + ", ".join(f"{v:.2g} {u}" for v, u in errors)


def _input(name, form, what):
    """Return (number, rms errors of the states) after the onset (of a fault-free flight: from 3 s on)."""
    frame, log = filtered(name, form)
    t, f = frame.index.to_numpy(), true_fault(frame)
    late = t >= (3.0 if what == "quiet" else ONSET + 1.0)
    note = _states(frame, log, late)
    if what == "gain":
        on = late & (t < ONSET + 9.0)
        w = 2 * np.pi * HZ
        return abs(sine(t[on], log["f_hat"][on], w) / sine(t[on], f[on], w)), note
    error = (log["f_hat"][1:] - f[:-1])[late[1:]]
    if what == "quiet":
        return float(np.sqrt(np.mean(log["f_hat"][late] ** 2))), note
    return float(np.sqrt(np.mean(error**2) / np.mean(f[late] ** 2))), note


def _output(name, form):
    """Return the mean of f_hat of the RTS-EKF over the fault of the rod sensor, from 2 s after it on."""
    frame = flight(name)
    load = FORMS[form]
    wires = {n: INPUTS[n] for n in rtsekf.INPUTS.names}
    log = detect(frame, rtsekf, wires, rtsekf.params(load=load), ("f_hat", "q_now", "alarm"))
    late = frame.index.to_numpy() >= ONSET + 2.0
    before = (frame.index.to_numpy() > 3.0) & (frame.index.to_numpy() < ONSET)
    return log["f_hat"][late].mean() / BIAS, f"before the fault {1e3 * np.abs(log['f_hat'][before]).max():.0f} mm"


@functools.cache
def _compensated(hz):
    """Return the rod's oscillation with f_hat taken off the valve over that without, from 4 s after the onset."""
    rod, late = f"hydraulic.{LANE}.q_rod", slice(round((ONSET + 4.0) / 0.005), round((ONSET + 12.0) / 0.005))
    asked = f"faults.0.frequency_hz={hz:g}"
    twin = flight("lu17-compensated-ofc", "faults=[]")[rod].to_numpy()[late]
    swing = []
    for word in ("true", "false"):
        f = flight("lu17-compensated-ofc", asked, f"elevator.compensate={word}")
        t = f.index.to_numpy()[late]
        swing.append(1e3 * abs(sine(t, f[rod].to_numpy()[late] - twin, 2 * np.pi * hz)))
    return swing[0] / swing[1], f"{swing[0]:.2f} of {swing[1]:.2f} mm"


ASKED = (
    ("figure 2(e)", "lu17-fault-free", "quiet", "rms of f_hat, without a fault", (0.0, 0.004)),
    ("figure 3(e)", "lu17-liquid-ofc", "gain", "|f_hat / f| at 1 Hz", (0.95, 1.05)),
    ("figure 4(f)", "lu17-solid-ofc", "error", "rms of the fault's error over that of the fault", (0.0, 0.42)),
)


def plan(of: Of) -> Any:
    """Return the Planned rows of the flights."""
    out = []
    for figure, name, what, words, band in ASKED:
        for form in FORMS:
            measure = functools.partial(_input, name, form, what)
            item = f"{figure} in flight, {form} form: {words}"
            if form == "pressure":
                out.append(of.beyond(item, 'VI: "can be incorporated into the actuator system"', measure, *band))
            else:
                out.append(of.ours(item, measure, says="not in the paper: a hinge load in gusts"))
    for form in ("published", "hinge model"):
        out.append(
            of.ours(
                f"figure 5(e) in flight, {form} form of the RTS-EKF: mean f_hat over the 5 mm of bias",
                functools.partial(_output, "lu17-liquid-jam", form),
                says="not in the paper: the model drifts under what it does not know",
            )
        )
    says = (
        'VI: the systems "can be incorporated into the actuator system"; III.B feeds back the state only: our extension'
    )
    for hz in (0.5, 1.0):
        measure = functools.partial(_compensated, hz)
        out.append(
            of.beyond(
                f"in flight, f_hat taken off the valve: what is left of a liquid OFC of 3 mm at {hz:g} Hz",
                says,
                measure,
                0.0,
                0.2,
            )
        )
    return out
