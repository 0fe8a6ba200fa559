"""The aircraft's force model for static residuals, read from the XML that flies: coefficients, thrust map, geometry.

Nothing is retyped. Each coefficient is a slope of the file's own functions, evaluated at the file's own breakpoints;
multipliers are at 1. What does not split into t_a(alpha, Mach, qbar) + t_m(Mach, qbar) with t_a linear in qbar, or is
not linear in its variable, raises ValueError instead of being approximated.
"""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from actuators.constants import G0, KG_PER_SLUG, M_PER_FT, M_PER_IN, N_PER_LBF, PA_PER_PSF
from cosim.flight.plant.aero_functions import AeroFunctions, _lookup, _table, find, number
from cosim.scenario.aircraft import RECORD, load_aircraft, of_folder
from fdi.control_redundancy.force_model import VARIABLES, ForceModel

AXES = {"lift": "LIFT", "drag": "DRAG", "side": "SIDE"}
PROPERTY = {
    "alphadot": ("aero/alphadot-from-forces", "aero/alphadot-rad_sec"), "p": ("aero/p-rad_sec",),
    "q": ("aero/q-rad_sec",), "r": ("aero/r-rad_sec",), "beta": ("aero/beta-rad",),
    "da_l": ("fcs/aileron-left-pos-rad",), "da_r": ("fcs/aileron-right-pos-rad",),
    "dr": ("fcs/rudder-applied-rad",), "stab": ("fcs/stabilizer-pos-rad",),
}  # fmt: skip
STABILITY = {"p": ("aero/p-stability-rad_sec",), "r": ("aero/r-stability-rad_sec",)}  # where an aircraft defines them
PLACES = 4  # of engines in `ForceModel`
SPEED = 500.0  # any speed [ft/s]: only makes rates of the dimensionless ones
MULTIPLIER = "aero/mult/"
TOLERANCE = 1e-9  # of splitting and of linearity, relative to the largest coefficient of the axis


@of_folder
def force_model(folder: Path) -> ForceModel:
    """Return the `ForceModel` of an aircraft folder; ValueError when its functions have another form."""
    folder = Path(folder)
    aero = AeroFunctions(folder)
    alpha = _breaks(aero, "aero/alpha-rad", [-0.2, 0.4])
    mach = _breaks(aero, "velocities/mach", [0.2, 0.95])
    qbar = _breaks(aero, "aero/qbar-psf", [10.0, 1000.0])
    elevators = _elevators(folder)
    found = []
    for axis in AXES:
        found += _quantities(aero, axis, alpha, mach, qbar, elevators)
    found.sort(key=lambda item: item[2] is None)  # those with alpha first
    return ForceModel(
        area=aero.defaults["metrics/Sw-sqft"] * M_PER_FT**2, span=aero.defaults["metrics/bw-ft"] * M_PER_FT,
        chord=aero.defaults["metrics/cbarw-ft"] * M_PER_FT, alpha=alpha, mach=mach, qbar=qbar * PA_PER_PSF,
        quantities=tuple((axis, variable) for axis, variable, _, _ in found),
        t_a=np.array([t for _, _, t, _ in found if t is not None]), t_m=np.array([t for *_, t in found]),
        stability_rates=STABILITY["p"][0] in aero.functions,
        **_mass(aero.root), **_propulsion(aero.root, folder),
    )  # fmt: skip


def _breaks(aero, name, ends):
    own = aero.breakpoints.get(name)
    return np.array(ends) if own is None else own


def _elevators(folder):
    """Return {variable: properties} of the elevator: the first and the last segment, and beside each the rest of its
    side."""
    if not (folder / RECORD).is_file():
        return {f"de_{s}": (f"fcs/elevator-{s}-pos-rad",) for s in ("lo", "li", "ri", "ro")}
    own = load_aircraft(str(folder))
    left, right = ([f"fcs/elevator-{own.short[s]}-pos-rad" for s in own.groups[side]] for side in ("left", "right"))
    return {"de_lo": tuple(left[:1]), "de_li": tuple(left[1:]), "de_ri": tuple(right[:-1]), "de_ro": tuple(right[-1:])}


def _quantities(aero, axis, alpha, mach, qbar, elevators):
    """Return [(axis, variable, t_a or None, t_m)] of the entries that exist."""
    chord, span = aero.defaults["metrics/cbarw-ft"], aero.defaults["metrics/bw-ft"]
    base = {"aero/alpha-rad": alpha[:, None, None], "velocities/mach": mach[None, :, None], "aero/qbar-psf": qbar}
    properties = PROPERTY | elevators | {k: v for k, v in STABILITY.items() if v[0] in aero.functions}
    base |= {"velocities/vt-fps": SPEED, **{name: 0.0 for names in properties.values() for name in names}}
    shape = (len(alpha), len(mach), len(qbar))

    def coefficient(without=None, **moved):
        given = dict(base) if without is None else {**base, without: 0.0}
        for variable, value in moved.items():
            given |= {name: value for name in properties[variable]}
        force = aero.evaluate(AXES[axis], given) / (base["aero/qbar-psf"] * aero.defaults["metrics/Sw-sqft"])
        return np.broadcast_to(force, shape)

    zero = coefficient()
    tables = {}
    for variable in properties:
        unit = 1.0
        if variable in ("alphadot", "p", "q", "r"):  # rate that makes the dimensionless rate one
            unit = 2 * SPEED / (span if variable in "pr" else chord)
        plus, minus = coefficient(**{variable: 0.1 * unit}) - zero, coefficient(**{variable: -0.1 * unit}) - zero
        tables[variable] = (plus - minus) / 0.2
        curve = (plus + minus) / 2 / 0.01
        if variable == "beta":
            tables["beta2"] = curve
        elif np.abs(curve).max() > TOLERANCE * np.abs(zero).max() + 1e-12:
            raise ValueError(f"{axis} is not linear in {variable}")
    # what needs no input, one quantity per coefficient that the file can scale: their errors are independent
    scales = [name for name in aero.defaults if name.startswith(MULTIPLIER)]
    base_parts = [zero - coefficient(without=name) for name in scales]
    base_parts.append(zero - sum(base_parts))
    all_tables = [("one", t) for t in base_parts] + [(v, tables[v]) for v in VARIABLES if v in tables]
    largest = max(np.abs(t).max() for _, t in all_tables)
    kept = [(v, t) for v, t in all_tables if np.abs(t).max() > TOLERANCE * max(largest, 1e-12)]
    return [_split(axis, v, t, qbar) for v, t in kept]


def _split(axis, variable, table, qbar):
    """Split a table into t_a(alpha, Mach, qbar), linear in qbar and zero at the middle alpha, and t_m(Mach, qbar)."""
    t_m = table[table.shape[0] // 2]
    t_a = (table - t_m)[:, :, [0, -1]]
    d = (qbar - qbar[0]) / (qbar[-1] - qbar[0])
    error = np.abs(table - t_m - (t_a[:, :, :1] * (1 - d) + t_a[:, :, 1:] * d)).max()
    if error > TOLERANCE * np.abs(table).max():
        raise ValueError(f"{axis} over {variable} is no t_a(alpha, Mach, qbar) + t_m(Mach, qbar): {error:.1e} is left")
    flat = np.abs(t_a).max() <= TOLERANCE * np.abs(table).max()
    return axis, variable, None if flat else t_a, t_m


def _mass(root):
    """Return the radii of gyration squared [m2], from the empty aircraft: the loading keeps them."""
    balance = find(root, "mass_balance")
    unit = {"KG*M2": 1.0, "SLUG*FT2": KG_PER_SLUG * M_PER_FT**2}
    empty = {"KG": 1.0, "LBS": N_PER_LBF / G0}[find(balance, "emptywt").get("unit", "LBS")] * number(balance, "emptywt")
    terms = ("ixx", "iyy", "izz", "ixz")
    radii = (number(balance, k) * unit[find(balance, k).get("unit", "SLUG*FT2")] / empty for k in terms)
    return {"gyration2": tuple(radii)}


def _propulsion(root, folder):
    """Return thrust tables [N], N1 range, engine positions about the reference point and the thrust's direction."""
    engines = root.findall("propulsion/engine")
    name = engines[0].get("file")
    tree = ElementTree.parse(folder / "Engines" / f"{name}.xml").getroot()
    most = number(tree, "milthrust") * N_PER_LBF
    tables = {f.get("name"): _table(find(f, "table")) for f in tree.iter("function")}
    mach, pressure = tables["MilThrust"][1]
    grid = np.meshgrid(mach, pressure, indexing="ij")
    mil, idle = (most * _lookup(tables[k][1], tables[k][2], grid) for k in ("MilThrust", "IdleThrust"))
    reference = {axis.tag: float(axis.text or "nan") for axis in find(root, "metrics/location[@name='AERORP']")}
    positions = []
    for engine in engines:
        location = find(engine, "thruster/location")
        unit = {"FT": M_PER_FT, "IN": M_PER_IN, "M": 1.0}[location.get("unit", "IN")]
        x, y, z = (unit * number(location, k) for k in "xyz")
        positions.append([reference["x"] * M_PER_IN - x, y - reference["y"] * M_PER_IN, reference["z"] * M_PER_IN - z])
    pitch = math.radians(number(engines[0], "thruster/orient/pitch"))
    if PLACES % len(engines):
        raise ValueError(f"{len(engines)} engines: 1, 2 or 4 are expected")
    parts = PLACES // len(engines)  # a twin's engine stands for two of half the thrust
    places, mil, idle = np.repeat(positions, parts, axis=0), mil / parts, idle / parts
    return {
        "thrust_mach": mach, "thrust_p": pressure * PA_PER_PSF, "idle": idle, "mil": mil, "engine": places,
        "n1_idle": number(tree, "idlen1"), "n1_max": number(tree, "maxn1"),
        "thrust_axis": (math.cos(pitch), 0.0, -math.sin(pitch)),
    }  # fmt: skip
