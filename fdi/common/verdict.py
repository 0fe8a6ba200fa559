"""Class codes of a verdict: what a detector says is wrong. They are floats because a tick is one float64 vector.

A detector that can hold several faults at once has, beside the summary `alarm`, `verdict` and `culprit`, one output
`alarm_<culprit>` for each of its CULPRITS (`alarm_elevator`, `alarm_n_z`, ...): 1 while that part is declared, whatever
else is. The summary is then: `alarm` is 1 while any of them is; `culprit` is the one declared first of those that
still stand, and `verdict` is its class. Names of a detector without such outputs come from `culprit` alone.
"""

from typing import Any

NONE = 0.0
OFC_LIQUID = 1.0  # oscillation added to the servo's signal
OFC_SOLID = 2.0  # oscillation in place of the servo's signal
JAM_LIQUID = 3.0  # bias of a position sensor that closes a loop
JAM_SOLID = 4.0  # the surface does not move
RUNAWAY = 5.0  # the surface moves uncommanded, to its stop
SENSOR = 6.0  # a sensor, named by `culprit`
EFFECTIVENESS = 7.0  # the actuator obeys, but too little
THRUST = 8.0  # an engine
AMBIGUOUS = 9.0  # something is wrong; the detector cannot tell what

NAMES = (
    "none",
    "ofc_liquid",
    "ofc_solid",
    "jam_liquid",
    "jam_solid",
    "runaway",
    "sensor",
    "effectiveness",
    "thrust",
    "ambiguous",
)


def name(code: Any) -> Any:
    """Return the name of class `code`; a value that is no code raises ValueError."""
    k = int(code)
    if k != code or not 0 <= k < len(NAMES):
        raise ValueError(f"{code!r} is no verdict code")
    return NAMES[k]


def code(name: str) -> float:
    """Return the float code of class `name`; an unknown name raises ValueError."""
    return float(NAMES.index(name))


def alarm_fields(culprits: tuple, outputs: tuple) -> dict:
    """Return {culprit: output that holds its own alarm}, empty for a detector that names one part at a time.

    `culprits` and `outputs` are a detector's CULPRITS and OUTPUTS.
    """
    return {name: f"alarm_{name}" for name in culprits if name and f"alarm_{name}" in outputs}


def class_name(code: float) -> str:
    """Return the class of a verdict code; "unknown" for a number that is no code, as a log of others may hold."""
    return NAMES[int(code)] if 0 <= code < len(NAMES) else "unknown"
