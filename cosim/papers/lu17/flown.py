"""[Lu17] in the aircraft: figures 2 to 7 on the left inner segment, with three ways of knowing the load.

The scenarios are `lu17-fault-free`, `lu17-liquid-ofc`, `lu17-solid-ofc`, `lu17-liquid-jam`, `lu17-solid-jam` and
`lu17-runaway`: a 3-2-1-1 of 4 deg from 10 s in light turbulence, faults from 12 s. "published" leaves the load out,
"hinge model" has the detectors' own model, which is up to 20 % wrong, "pressure" measures the pressure difference and
lets the load walk. The servo closes on the filter of the figure, as III.B has it: on the IOTSEKF in 2 to 4, on the
RTS-EKF in 5 to 7. F_d of its inversion (9) is not the paper's, which is known: it is what the servo's own observer
makes of rod and pressure. The RTS-EKF with a pressure is `rtsekf_flight`, which has the surface sensor, too. The true f
of a jam or a runaway is where the rod is, less where it is in the flight without them.
"""

import functools
from typing import Any

import numpy as np

from actuators.common import linkage
from cosim.flight.loop.signals import fly
from cosim.judge.fault_effect import sine
from cosim.scenario import load_scenario

ONSET, LANE, HZ, BIAS = 12.0, "left_inner", 1.0, 5e-3
FORMS = ("published", "hinge model", "pressure")
FIGURES = {  # scenario -> figure, detector
    "fault-free": (2, "iotsekf"),
    "liquid-ofc": (3, "iotsekf"),
    "solid-ofc": (4, "iotsekf"),
    "liquid-jam": (5, "rtsekf"),
    "solid-jam": (6, "rtsekf"),
    "runaway": (7, "rtsekf"),
}
TRUE = {"rod": f"hydraulic.{LANE}.q_rod", "f_u": f"hydraulic_in.{LANE}.f_u", "s_u": f"hydraulic_in.{LANE}.s_u",
        "u": f"iotsekf_in.{LANE}.u"}  # fmt: skip


@functools.cache
def flown(scenario: str, form: str, detector: str = "", turbulence: str = "light") -> Any:
    """Return the table of a scenario of FIGURES in a form: f_hat of its filter, and TRUE."""
    own = watch = detector or FIGURES[scenario][1]
    changes = [f'detectors.iotsekf.form="{form}"', f"flight.turbulence={turbulence}"]
    if watch == "rtsekf" and form == "pressure":
        own = "rtsekf_flight"
    elif watch == "rtsekf":
        changes.append(f'detectors.rtsekf.form="{form}"')
    changes.append(f"elevator.feedback.{LANE}={own}")
    names = {**TRUE, "f_hat": f"{own}.{LANE}.f_hat"}
    return fly(load_scenario(f"lu17-{scenario}", changes), names.values()).set_axis(list(names), axis=1)


def true_fault(scenario: str, frame: Any, twin: Any) -> Any:
    """Return the true fault: what the valve did beyond its command [1], or the rod sensor's or rod's [m], (ticks,).

    `twin` is the flight without the fault.
    """
    if FIGURES[scenario][1] == "iotsekf":
        u = frame.u.shift(-1, fill_value=0.0)  # the filter reads the command of the last tick
        return (frame.f_u - frame.s_u * u).to_numpy()
    late = frame.index.to_numpy() >= ONSET
    return BIAS * late if scenario == "liquid-jam" else np.where(late, (frame.rod - twin.rod).to_numpy(), 0.0)


def fault(scenario: str, form: str, turbulence: str = "light") -> tuple[float, str]:
    """Return (number, note) of a figure (e), (f): rms of f_hat without a fault, |f_hat/f| of a liquid OFC, else the rms
    of the fault's error over that of the fault; from 1 s after the onset on, without a fault from 3 s on."""
    watch = FIGURES[scenario][1]
    frame = flown(scenario, form, turbulence=turbulence)
    f = true_fault(scenario, frame, flown("fault-free", form, watch, turbulence))
    t, f_hat = frame.index.to_numpy(), frame.f_hat.to_numpy()
    late = t >= (3.0 if scenario == "fault-free" else ONSET + 1.0)
    scale, unit = (1.0, "of u") if watch == "iotsekf" else (1e3, "mm")
    rms = scale * float(np.sqrt(np.mean((f_hat[1:] - f[:-1])[late[1:]] ** 2)))
    size = scale * float(np.sqrt(np.mean(f[late] ** 2)))
    if scenario == "fault-free":
        return rms, ""
    note = f"{rms:.2g} of {size:.2g} {unit}"
    if scenario == "liquid-ofc":
        on = late & (t < ONSET + 9.0)
        estimate, true = (sine(t[on], y[on], 2 * np.pi * HZ) for y in (f_hat, f))
        return abs(estimate / true), note
    return rms / size, note


def stuck(scenario: str) -> tuple[float, str]:
    """Return how far the rod is from where figure 6's fault found it, or from figure 7's stop at the end [mm].

    Of the flight's own actuator, which the jam holds and whose valve the runaway opens.
    """
    frame = flown(scenario, "pressure", "iotsekf")
    rod = 1e3 * frame.rod.to_numpy()[frame.index.to_numpy() >= ONSET]
    if scenario == "solid-jam":
        return float(np.abs(rod - rod[0]).max()), f"stuck at {rod[0]:.1f} mm"
    limit = 1e3 * linkage.rod(linkage.TRAVEL[1])
    return float(abs(rod[-1] - np.sign(rod[-1]) * limit)), f"at {rod[-1]:.1f} mm in the end"
