"""[Lu17] in the aircraft: figures 2 to 7 and table 1 on the left inner segment, with three ways of knowing the load.

The scenarios are `lu17-fault-free`, `lu17-liquid-ofc`, `lu17-solid-ofc`, `lu17-liquid-jam`, `lu17-solid-jam` and
`lu17-runaway`: a 3-2-1-1 of 4 deg from 10 s in light turbulence, faults from 12 s. `detectors.iotsekf.form` and
`detectors.rtsekf.form` are the words: "published" leaves the load out, "hinge model" has the detectors' own model,
which is up to 20 % wrong, "pressure" measures the pressure difference and lets the load walk; each has thresholds of
its own. The servo closes on the IOTSEKF of that form, as III.B has it. The RTS-EKF with a pressure is `rtsekf_flight`,
which has the surface sensor, too. The true f of a jam or a runaway is where the rod is, less where it is in the flight
without them.
"""

import functools
from typing import Any

import numpy as np

from actuators.common import linkage
from cosim.flight.loop.signals import fly
from cosim.judge.fault_effect import sine
from cosim.scenario import load_scenario
from cosim.scenario.catalog import SEGMENTS

ONSET, LANE, HZ, BIAS, DT = 12.0, "left_inner", 1.0, 5e-3, 0.005
FORMS = ("published", "hinge model", "pressure")
TRUE = ("q_rod", "qd_rod", "x3")
STATES = ("q_now", "v_now", "x3_now")
FIGURES = {  # scenario -> figure, detector
    "fault-free": (2, "iotsekf"),
    "liquid-ofc": (3, "iotsekf"),
    "solid-ofc": (4, "iotsekf"),
    "liquid-jam": (5, "rtsekf"),
    "solid-jam": (6, "rtsekf"),
    "runaway": (7, "rtsekf"),
}


def signals(detector: str) -> dict[str, str]:
    """Return {short name: signal} of what the rows ask of a detector."""
    out = {n: f"hydraulic.{LANE}.{n}" for n in TRUE}
    out |= {"f_u": f"hydraulic_in.{LANE}.f_u", "s_u": f"hydraulic_in.{LANE}.s_u", "u": f"iotsekf_in.{LANE}.u"}
    return out | {n: f"{detector}.{LANE}.{n}" for n in ("f_hat", "alarm", "verdict", *STATES)}


def watching(detector: str, form: str) -> tuple[str, list[str]]:
    """Return (detector that flies, overrides) for a detector of the paper in one of FORMS."""
    words = [f'detectors.iotsekf.form="{form}"']
    if detector == "rtsekf" and form == "pressure":
        return "rtsekf_flight", words
    if detector == "rtsekf":
        words.append(f'detectors.rtsekf.form="{form}"')
    return detector, words


@functools.cache
def flight(name: str, *changes: Any) -> Any:
    """Return the table of rods and faults of a scenario, with the signals of all three filters."""
    asked = {f"{d}:{short}": path for d in ("iotsekf", "rtsekf", "rtsekf_flight") for short, path in signals(d).items()}
    return fly(load_scenario(name, list(changes)), list(dict.fromkeys(asked.values())))


def flown(scenario: str, form: str, detector: str = "", *changes: str) -> Any:
    """Return the table of a scenario of FIGURES in a form, columns named shortly."""
    detector, words = watching(detector or FIGURES[scenario][1], form)
    frame = flight(f"lu17-{scenario}", *words, *changes)
    return frame[list(signals(detector).values())].set_axis(list(signals(detector)), axis=1)


def true_fault(scenario: str, form: str, frame: Any) -> Any:
    """Return the true fault: what the valve did beyond its command [1], or the rod sensor's or rod's [m], (ticks,)."""
    if FIGURES[scenario][1] == "iotsekf":
        u = frame.u.shift(-1, fill_value=0.0)  # the filter reads the command of the last tick
        return (frame.f_u - frame.s_u * u).to_numpy()
    late = frame.index.to_numpy() >= ONSET
    if scenario == "liquid-jam":
        return BIAS * late
    twin = flown("fault-free", form, "rtsekf")
    return np.where(late, (frame.q_rod - twin.q_rod).to_numpy(), 0.0)


def late_of(scenario: str, frame: Any) -> Any:
    """Return where a flight is judged: from 1 s after the onset on, of the one without a fault from 3 s on."""
    return frame.index.to_numpy() >= (3.0 if scenario == "fault-free" else ONSET + 1.0)


def fault(scenario: str, form: str) -> tuple[float, str]:
    """Return (number, note) of a figure (e), (f): rms of f_hat without a fault, |f_hat/f| of a liquid OFC, else the rms
    of the fault's error over that of the fault."""
    frame = flown(scenario, form)
    t, f, late, f_hat = frame.index.to_numpy(), true_fault(scenario, form, frame), late_of(scenario, frame), frame.f_hat
    scale, unit = (1.0, "of u") if FIGURES[scenario][1] == "iotsekf" else (1e3, "mm")
    rms = scale * float(np.sqrt(np.mean((f_hat[1:].to_numpy() - f[:-1])[late[1:]] ** 2)))
    size = scale * float(np.sqrt(np.mean(f[late] ** 2)))
    if scenario == "fault-free":
        return rms, ""
    if scenario == "liquid-ofc":
        on = late & (t < ONSET + 9.0)
        found, true = (sine(t[on], y[on], 2 * np.pi * HZ) for y in (f_hat.to_numpy(), f))
        return abs(found / true), f"error {rms:.2g} of {size:.2g} {unit}"
    return rms / size, f"{rms:.2g} of {size:.2g} {unit}"


def quiet(detector: str, form: str) -> float:
    """Return the alarms of four segments in a minute of cruise in light turbulence."""
    own, words = watching(detector, form)
    lanes = [f"{own}.{lane}.alarm" for lane in SEGMENTS]
    all_hydraulic = [f'elevator.{lane}="hydraulic"' for lane in SEGMENTS]
    asked = ["duration_s=60", 'flight.turbulence="light"', *all_hydraulic, *words]
    frame = fly(load_scenario("cruise", asked), lanes)
    return float(sum((np.diff(frame[lane].to_numpy(), prepend=0.0) > 0.5).sum() for lane in lanes))


def stuck(scenario: str) -> tuple[float, str]:
    """Return how far the rod is from where figure 6's fault found it, or from figure 7's stop at the end [mm].

    Of the flight's own actuator, which the jam holds and whose valve the runaway opens.
    """
    frame = flown(scenario, "pressure")
    rod = 1e3 * frame.q_rod.to_numpy()[frame.index.to_numpy() >= ONSET]
    if scenario == "solid-jam":
        return float(np.abs(rod - rod[0]).max()), f"stuck at {rod[0]:.1f} mm"
    limit = 1e3 * linkage.rod(linkage.TRAVEL[1])
    return float(abs(rod[-1] - np.sign(rod[-1]) * limit)), f"at {rod[-1]:.1f} mm in the end"
