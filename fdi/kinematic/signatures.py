"""Signatures of the sensors in the kinematic rows: which rows an error moves, and whether the first of them jumps."""

from typing import Any

import numpy as np

SENSORS = (
    "p", "q", "r", "phi", "theta", "psi", "n_x", "n_z", "hdot", "h_inertial", "h_baro", "tas", "cas", "mach",
    "alpha_ground", "v_ground", "alpha", "beta", "n_y",
)  # fmt: skip
ROWS = ("phi", "theta", "psi", "climb", "turn", "speed", "height", "sound", "impact", "baro")
NS, NR = len(SENSORS), len(ROWS)
PHI, THETA, PSI, CLIMB, TURN, SPEED, HEIGHT, SOUND, IMPACT, BARO = range(NR)
# what an error of a sensor does: sensor, rows that it must move, rows that it may move too, whether the first one jumps
# (None: either)
SIGNATURES: tuple[Any, ...] = (
    ("p", ("phi",), ("turn",), False),
    ("phi", ("phi",), ("climb", "turn"), True),
    ("phi", ("phi",), ("climb", "turn"), False),  # slow: an error of its rate, as one of p is; so of theta, psi
    ("q", ("theta", "turn"), ("psi", "phi"), False),
    ("theta", ("climb",), ("theta", "speed"), None),
    ("theta", ("theta",), ("climb", "speed"), True),
    ("theta", ("theta",), ("climb", "speed"), False),
    ("r", ("psi",), ("theta", "phi"), False),
    ("psi", ("psi",), (), True),
    ("psi", ("psi",), (), False),
    ("n_x", ("speed",), (), False),
    ("n_z", ("turn",), ("speed",), False),
    ("hdot", ("height", "climb"), ("baro",), False),
    ("h_inertial", ("height",), ("baro",), True),
    ("h_inertial", ("height",), ("baro",), False),
    ("h_inertial", ("height", "baro"), (), None),
    ("h_baro", ("baro",), ("impact",), None),
    ("tas", ("sound",), (), None),
    ("cas", ("impact",), (), None),
    ("mach", ("sound", "impact"), (), None),
    ("alpha_ground", ("turn", "climb"), (), None),
    ("alpha_ground", ("climb", "turn"), (), None),
    ("alpha_ground", ("climb",), ("turn",), False),
    ("v_ground", ("speed",), ("climb", "turn"), True),
    ("v_ground", ("speed",), ("climb", "turn"), False),  # slow: as an error of n_x
)
NC = len(SIGNATURES)
# sensors that share every row: an error of the rate, and a slow one of what it is the rate of
PAIRS = (("q", "theta"), ("p", "phi"), ("r", "psi"), ("n_x", "v_ground"))


def _table(*columns):
    return np.array([[float(any(row in c[k] for k in columns)) for row in ROWS] for c in SIGNATURES])


MUST, MAY = _table(1), _table(1, 2)
JUMPS = np.array([{None: 0.0, True: 1.0, False: -1.0}[c[3]] for c in SIGNATURES])
FIRST_ROW = np.array([ROWS.index(c[1][0]) for c in SIGNATURES])
UNIT = np.array([0, 0, 0, 1, 1, 1, 2, 3, 4, 5])  # rows of one unit have one number
OF = np.array([SENSORS.index(c[0]) for c in SIGNATURES])
ISOLABLE_PARTS = ("", *SENSORS, *(" or ".join(pair) for pair in PAIRS))
EITHER = len(SENSORS) + 1  # the first of the pairs
# of each but the first, which the turn tells apart: the sensor that the velocity through the air needs, and the other
NEEDED, OTHER = (
    np.array([ISOLABLE_PARTS.index(name) for name in names])
    for names in (("", "phi", "r", "n_x"), ("", "p", "psi", "v_ground"))
)
# [a, b]: b is one of a
HOLDS = np.array([[float(b != "" and b in a.split(" or ")) for b in ISOLABLE_PARTS] for a in ISOLABLE_PARTS])
PAIR_OF = np.array([next((k + EITHER for k, pair in enumerate(PAIRS) if c[0] in pair), 0) for c in SIGNATURES])
# of every isolated_part the row that integrates it, from which its error fades; -1 where an error stays
FADES = np.array([
    next((ROWS.index(c[1][0]) for c in SIGNATURES if c[0] in name.split(" or ") and c[3]), -1)
    for name in ISOLABLE_PARTS[1:]
])
INTEGRATES = np.array([float(row in ("phi", "theta", "psi", "turn", "speed", "height")) for row in ROWS])
_RATES = [name.split(" or ")[0] for name in ISOLABLE_PARTS[1:]]  # a pair's rate
# rows in which a constant error of a part stays: those that integrate nothing, and its rate's
CONSTANT_IN = np.array([
    [float(any(c[0] == name and row in (*c[1], *c[2]) and (plain or (c[3] is False and row == c[1][0]))
               for c in SIGNATURES)) for row, plain in zip(ROWS, INTEGRATES == 0.0)] for name in _RATES
])  # fmt: skip
# how large an error of this size in the first row is in a row whose threshold may hide it: so many times, and times so
# many powers of the speed; a relative error of Mach number is twice that, or more, in the impact pressure
_SHOWN = {("q", "turn"): (1.0, 1.0), ("alpha_ground", "climb"): (1.0, 0.0), ("alpha_ground", "turn"): (1.0, 0.0),
          ("hdot", "climb"): (0.5, 0.0), ("mach", "impact"): (2.0, -1.0)}  # fmt: skip
SIZES, SPEED_POWERS = (
    np.array([[_SHOWN.get((c[0], row), (0.0, 0.0))[k] for row in ROWS] for c in SIGNATURES]) for k in (0, 1)
)
# the sensors that each row reads, in its order of ROWS: what it shows while one of them is wrong tells of no other
READS = (
    ("p", "q", "r", "phi", "theta"), ("q", "r", "phi", "theta"), ("q", "r", "phi", "theta", "psi"),
    ("hdot", "phi", "theta", "alpha_ground", "v_ground"),
    ("p", "q", "r", "phi", "theta", "n_z", "alpha_ground", "v_ground"),
    ("phi", "theta", "n_x", "n_y", "n_z", "alpha_ground", "v_ground"), ("hdot", "h_inertial"),
    ("tas", "mach", "h_inertial"), ("cas", "mach", "h_baro"), ("hdot", "h_inertial", "h_baro"),
)  # fmt: skip
KNOWN = np.array([[float(bool(set(c.split(" or ")) & set(row))) for row in READS] for c in ISOLABLE_PARTS])
# specified noise per sample of the inertial and barometric readings, sensor set `transport` [rad, rad/s, m, m/s]; gusts
# are in the second differences of the others, which learn no noise of their rows
_SPECIFIED = {
    **dict.fromkeys(("p", "q", "r", "phi", "theta", "psi"), 3.5e-4), "alpha_ground": 4.4e-4, "v_ground": 0.05,
    "hdot": 0.05, "h_inertial": 0.02, "h_baro": 0.7,
}  # fmt: skip
SIGMA = np.array([_SPECIFIED.get(name, 1.0) for name in SENSORS])
READ_BY = np.array([[float(name in row and name in _SPECIFIED) for name in SENSORS] for row in READS])
