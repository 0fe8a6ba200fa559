"""Class codes of a verdict: what a detector says is wrong. They are floats because a tick is one float64 vector.

A detector that can hold several faults at once has, beside the summary `alarm`, `verdict` and `isolated_part`, one
output `alarm_<part>` for each of its ISOLABLE_PARTS (`alarm_elevator`, `alarm_n_z`, ...): 1 while that part is
declared, whatever else is. The summary is then: `alarm` is 1 while any of them is; `isolated_part` is the one declared
first of those that still stand, and `verdict` is its class. Names of a detector without such outputs come from
`isolated_part` alone.
"""

NONE = 0.0
OFC_LIQUID = 1.0
OFC_SOLID = 2.0
JAM_LIQUID = 3.0
JAM_SOLID = 4.0
RUNAWAY = 5.0
SENSOR = 6.0
EFFECTIVENESS = 7.0
THRUST = 8.0
AMBIGUOUS = 9.0

MEANINGS = {  # of every class, in the order of the codes above
    "none": "no fault is named",
    "ofc_liquid": "an oscillation is added to the servo's signal",
    "ofc_solid": "an oscillation stands in place of the servo's signal",
    "jam_liquid": "the position that closes a loop has a bias: the surface stands off by it",
    "jam_solid": "the surface does not move",
    "runaway": "the surface moves uncommanded, to its stop",
    "sensor": "a sensor, which the isolated_part names",
    "effectiveness": "the actuator obeys, but too little",
    "thrust": "an engine",
    "ambiguous": "something is wrong; the detector cannot tell what",
}
NAMES = tuple(MEANINGS)


def code(name: str) -> float:
    """Return the float code of class `name`; an unknown name raises ValueError."""
    return float(NAMES.index(name))


def alarm_fields(isolable_parts: tuple, outputs: tuple) -> dict:
    """Return {isolated_part: output that holds its own alarm}, empty for a detector that names one part at a time.

    `isolable_parts` and `outputs` are a detector's ISOLABLE_PARTS and OUTPUTS.
    """
    return {name: f"alarm_{name}" for name in isolable_parts if name and f"alarm_{name}" in outputs}


def class_name(code: float) -> str:
    """Return the class of a verdict code; "unknown" for a number that is no code, as a log of others may hold."""
    return NAMES[int(code)] if 0 <= code < len(NAMES) else "unknown"
