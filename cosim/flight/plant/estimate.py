"""Estimate an aircraft's aerodynamics from its dimensions by handbook formulas, and write its JSBSim files.

`cosim new aircraft NAME --numbers FILE` does it: numbers.toml, whose every number has its provenance, and aircraft.toml
beside it; `templates/aircraft` has the files' form, which `aero_functions` reads again.
Rigid body, coefficients about the CG reference, per rad; x_q = q c / 2V and so on.

    a          lift slope: 2 pi A / (2 + sqrt(A^2 (beta^2 + tan^2 Lambda_c/2) / k^2 + 4)), k = 0.95 [DATCOM]
    epsilon'   downwash slope 4.44 (K_A K_lambda K_h sqrt(cos Lambda_c/4))^1.19 [DATCOM]
    tail       C_L_ih = a_h eta S_h / S, C_m_ih = -C_L_ih l_h / c
    C_m_alpha  K_f w^2 L / (S c) - C_L_ih (1 - epsilon') l_h / c, the wing's own at its quarter chord [P&H]
    rates      C_L_q = 2.2 C_L_ih l_h / c, C_m_q = -2.2 C_L_ih (l_h / c)^2, C_m_alphadot = epsilon' C_m_q / 1.1 [Nelson]
    surfaces   thin-aerofoil effectiveness times 0.8 for viscosity [DATCOM]
    C_D        C_D_0 + C_L^2 / (pi A e) + 20 (M - M_cr)^4, M_cr from Korn's drag divergence [Raymer]
    lateral    strip theory of the wing (roll damping times A / (A + 4)), fin as a surface with sidewash, body of
               revolution [DATCOM, Nelson]
"""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, Literal

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from pydantic import create_model

from actuators.constants import M_PER_FT
from cosim.errors import ScenarioError
from cosim.scenario.aircraft import Aircraft
from cosim.scenario.problem import Origin, Table, checked, within
from cosim.texts import read, toml

ALPHA = np.radians(
    np.concatenate([np.arange(-10.0, -4.0, 2.0), np.arange(-4.0, 12.0, 0.5), np.arange(12.0, 30.1, 1.5)])
)
ALPHA_COARSE = np.radians(np.arange(-6.0, 18.1, 2.0))
MACH_COARSE = np.array([0.2, 0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95])
MACH = np.arange(0.2, 0.9501, 0.025)
QBAR = np.array([50.0, 800.0])  # psf: rigid, nothing changes between them
MIDDLE = 0.6  # Mach of what has one number


POSITIVE, SHARE = (0.0, 1e6), (0.0, 1.0)  # above the first, up to the second
LENGTH, AREA, SWEEP, SLOPE = (0.0, 200.0), (0.0, 3000.0), (-45.0, 60.0), (-1.0, 0.0)
BOUNDS = {  # group -> number -> bounds within which the formulas are those of a subsonic transport
    "wing": {"area_m2": AREA, "span_m": LENGTH, "chord_m": LENGTH, "taper": SHARE, "sweep_deg": SWEEP,
             "thickness": (0.0, 0.3), "dihedral_deg": (-20.0, 20.0), "CL_0": (-1.0, 1.0), "Cm_0": (-1.0, 1.0),
             "CL_max": (0.0, 4.0), "CL_max_transonic": (0.0, 4.0)},
    "fuselage": {"length_m": LENGTH, "width_m": LENGTH, "position_factor": (0.0, 5.0), "volume_m3": (0.0, 1e4)},
    "tail": {"area_m2": AREA, "span_m": LENGTH, "sweep_deg": SWEEP, "taper": SHARE, "arm_m": LENGTH,
             "height_m": (-20.0, 20.0), "efficiency": (0.0, 1.5), "elevator_chord": SHARE, "elevator_area_m2": AREA,
             "elevator_span_m": LENGTH, "Ch_alpha": SLOPE, "Ch_delta": SLOPE},
    "fin": {"area_m2": AREA, "height_m": LENGTH, "sweep_deg": SWEEP, "taper": SHARE, "arm_m": LENGTH,
            "centre_m": (-20.0, 20.0), "endplate": (0.0, 3.0), "rudder_chord": SHARE},
    "aileron": {"chord": SHARE, "inner": SHARE, "outer": SHARE, "Cn_da": (-1.0, 1.0), "flexible": SHARE},
    "drag": {"friction": SHARE, "wetted": (0.0, 20.0), "oswald": SHARE, "korn": SHARE, "CD_beta": (-1.0, 10.0)},
    "engine": {"thrust_N": POSITIVE, "bypass": (-1.0, 30.0), "station_m": (-1.0, 100.0), "below_m": (-20.0, 20.0),
               "pitch_deg": (-20.0, 20.0)},
}  # fmt: skip


def _number(low, high):
    fields: dict[str, Any] = {"from": (Literal["published", "handbook", "assumption"], ...)}
    value = Annotated[float, within(low, high, open_low=True)]
    return create_model("Number", __base__=Table, value=(value, ...), source=(str, ...), **fields), ...


def _group(name, rows):
    fields: dict[str, Any] = {number: _number(*bounds) for number, bounds in rows.items()}
    return create_model(name, __base__=Table, **fields), ...


def numbers(path: Path) -> SimpleNamespace:
    """Return a numbers.toml as names: numbers(path).wing.span_m. Raises ScenarioError with every number that is
    missing, unknown, out of BOUNDS or without its provenance."""
    text = read(path, error=ScenarioError)
    table = toml(text, place=str(path), error=ScenarioError)
    groups: dict[str, Any] = {name: _group(name, rows) for name, rows in BOUNDS.items()}
    checked(create_model("Numbers", __base__=Table, **groups), table, Origin(str(path), text))
    values = {g: {name: number["value"] for name, number in rows.items()} for g, rows in table.items()}
    return SimpleNamespace(**{group: SimpleNamespace(**own) for group, own in values.items()})


def stalled(lift: Any, top: Any) -> Any:
    """Bend lift over smoothly from 0.80 to 1 of `top`, flat top, then 10 % down: C_L(x) = j + r tanh(x), x = (C_L -
    j) / r."""
    join = 0.80 * top
    x = np.maximum(lift - join, 0.0) / (top - join)
    return np.where(
        lift > join, join + (top - join) * (np.tanh(x) - 0.4 * np.tanh(0.5 * np.maximum(x - 2.0, 0.0))), lift
    )


def lift_slope(aspect: float, sweep_deg: float, taper: float, mach: float) -> Any:
    """Return the lift slope of a straight-tapered surface of `aspect` ratio and quarter-chord sweep [per rad]."""
    tan_half = math.tan(math.radians(sweep_deg)) - (1.0 - taper) / (1.0 + taper) / aspect
    beta2 = 1.0 - np.asarray(mach) ** 2
    return 2.0 * np.pi * aspect / (2.0 + np.sqrt((aspect / 0.95) ** 2 * (beta2 + tan_half**2) + 4.0))


def downwash(n: Any) -> float:
    """Return d epsilon / d alpha at the tail, at low speed."""
    w, aspect = n.wing, n.wing.span_m**2 / n.wing.area_m2
    K_A = 1.0 / aspect - 1.0 / (1.0 + aspect**1.7)
    K_taper = (10.0 - 3.0 * w.taper) / 7.0
    K_h = (1.0 - n.tail.height_m / w.span_m) / (2.0 * n.tail.arm_m / w.span_m) ** (1.0 / 3.0)
    return 4.44 * math.pow(K_A * K_taper * K_h * math.sqrt(math.cos(math.radians(w.sweep_deg))), 1.19)


def effectiveness(chord: float) -> float:
    """Return the effectiveness of a flap with this share of the chord."""
    theta = math.acos(2.0 * chord - 1.0)
    return 0.8 * (1.0 - (theta - math.sin(theta)) / math.pi)


def coefficients(n: Any, mach: Any) -> dict:
    """Return the coefficients at `mach` by the names of the XML's functions; a pair is the value at zero lift and its
    slope over lift."""
    w, f = n.wing, n.fuselage
    S, b, c = w.area_m2, w.span_m, w.chord_m
    aspect, slope = b**2 / S, math.tan(math.radians(w.sweep_deg))
    a_w = lift_slope(aspect, w.sweep_deg, w.taper, mach)
    a_h = lift_slope(n.tail.span_m**2 / n.tail.area_m2, n.tail.sweep_deg, n.tail.taper, mach)
    a_f = lift_slope(n.fin.endplate * n.fin.height_m**2 / n.fin.area_m2, n.fin.sweep_deg, n.fin.taper, mach)
    eps, arm = downwash(n), n.tail.arm_m / c
    CL_ih = a_h * n.tail.efficiency * n.tail.area_m2 / S
    body = f.position_factor * f.width_m**2 * f.length_m / (S * c)
    CL_de = CL_ih * effectiveness(n.tail.elevator_chord)
    out = {
        "CL_alpha": a_w + CL_ih * (1.0 - eps), "Cm_alpha": body - CL_ih * (1.0 - eps) * arm,
        "CL_ih": CL_ih, "Cm_ih": -CL_ih * arm, "CL_de": CL_de, "Cm_de": -CL_de * arm,
        "CL_q": 2.2 * CL_ih * arm, "Cm_q": -2.2 * CL_ih * arm**2, "Cm_alphadot": -2.0 * CL_ih * eps * arm**2,
    }  # fmt: skip
    # the fin: sidewash and dynamic pressure [DATCOM], z_w / d of a low wing 0.4
    sidewash = 0.724 + 3.06 * n.fin.area_m2 / S / (1.0 + math.cos(math.radians(w.sweep_deg))) + 0.16 + 0.009 * aspect
    fin = a_f * sidewash * n.fin.area_m2 / S  # -C_Y_beta of the fin
    l_v, z_v = n.fin.arm_m / b, n.fin.centre_m / b
    CY_dr = a_f * effectiveness(n.fin.rudder_chord) * n.fin.area_m2 / S
    strip = (1.0 + 2.0 * w.taper) / (6.0 * (1.0 + w.taper))
    roll = aspect / (aspect + 4.0)
    out |= {
        "CY_beta": -fin - 0.2, "Cn_beta": fin * l_v - 1.3 * f.volume_m3 / (S * b),
        "Cl_beta": (-a_w * math.radians(w.dihedral_deg) * strip * roll - fin * z_v, -strip * slope),
        "Cl_p": -a_w * (1.0 + 3.0 * w.taper) / (12.0 * (1.0 + w.taper)) * roll,
        "Cl_r": (2.0 * z_v * l_v * fin, 0.25), "Cn_p": (0.0 * a_w, -0.125 * roll),
        "Cn_r": -2.0 * fin * l_v**2 - 0.02, "CY_dr": CY_dr, "Cn_dr": -CY_dr * l_v, "Cl_dr": CY_dr * z_v,
        "Cl_da": a_w * effectiveness(n.aileron.chord) * n.aileron.flexible * _roll_arm(n),
    }  # fmt: skip
    return out


def _roll_arm(n):
    """Return 2 integral of c(y) y dy over one aileron pair's span / (S b), one degree on each side."""
    y = np.linspace(n.aileron.inner, n.aileron.outer, 101) * n.wing.span_m / 2.0
    root = 2.0 * n.wing.area_m2 / n.wing.span_m / (1.0 + n.wing.taper)
    chord = root * (1.0 - (1.0 - n.wing.taper) * 2.0 * y / n.wing.span_m)
    return 2.0 * float(np.trapezoid(chord * y, y)) / (n.wing.area_m2 * n.wing.span_m)


def drag(n: Any, lift: Any, mach: Any) -> Any:
    """Return the drag coefficient of a lift coefficient at `mach`."""
    d, cos = n.drag, math.cos(math.radians(n.wing.sweep_deg))
    aspect = n.wing.span_m**2 / n.wing.area_m2
    divergence = d.korn / cos - n.wing.thickness / cos**2 - np.clip(lift, 0.0, 1.2) / (10.0 * cos**3)
    critical = divergence - (0.1 / 80.0) ** (1.0 / 3.0)
    wave = 20.0 * np.maximum(mach - critical, 0.0) ** 4
    return d.friction * d.wetted + lift**2 / (np.pi * aspect * d.oswald) + wave


def tables(n: Any) -> dict:
    """Return {CL, CD, Cm: (grid (alpha, Mach), flexibility)}, stall built in, of a rigid aircraft."""
    a, m = ALPHA[:, None], MACH[None, :]
    at = coefficients(n, MACH)
    top = np.interp(MACH, [0.4, 0.85], [n.wing.CL_max, n.wing.CL_max_transonic])[None, :]
    line = n.wing.CL_0 + at["CL_alpha"][None, :] * a
    lift = stalled(line, top)
    lost = np.maximum(line - lift, 0.0)
    moment = n.wing.Cm_0 + at["Cm_alpha"][None, :] * a - 0.15 * lost
    return {"CL": (lift, (0.0, 0.0)), "CD": (drag(n, line, m), (0.0, 0.0)), "Cm": (moment, (0.0, 0.0))}


def derivative_tables(n: Any) -> dict:
    """Return {name: (second variable, its grid, table (Mach, second))}."""
    at, out = coefficients(n, MACH_COARSE), {}
    for name in ("CL_q", "Cm_q", "Cm_alphadot", "CL_de", "Cm_de", "Cl_da", "CY_dr", "Cn_dr", "CY_beta", "Cn_beta",
                 "Cl_p", "Cn_r"):  # fmt: skip
        out[name] = ("qbar", QBAR, np.repeat(np.broadcast_to(at[name], MACH_COARSE.shape)[:, None], len(QBAR), 1))
    lift = n.wing.CL_0 + at["CL_alpha"][:, None] * ALPHA_COARSE[None, :]
    for name in ("Cl_beta", "Cn_p", "Cl_r"):
        base, per_lift = at[name]
        out[name] = ("alpha", ALPHA_COARSE, np.broadcast_to(base, MACH_COARSE.shape)[:, None] + per_lift * lift)
    return out


def constants(n: Any, aircraft: Aircraft) -> dict[str, Any]:
    """Return what stands in aerodynamics.xml as a number, not as a table; derivatives per rad, stability axes."""
    tail, at = n.tail, coefficients(n, MIDDLE)
    area, chord = tail.elevator_area_m2 / M_PER_FT**2, tail.elevator_chord * tail.area_m2 / tail.span_m / M_PER_FT
    sides = {s: (-1.0 if name.startswith("left") else 1.0) for name, s in aircraft.short.items()}
    return {
        "chord_ft": n.wing.chord_m / M_PER_FT, "span_ft": n.wing.span_m / M_PER_FT, "downwash": downwash(n),
        "tail_arm_ft": tail.arm_m / M_PER_FT, "elevator_ft3": area * chord, "Ch_alpha": tail.Ch_alpha,
        "Ch_delta": tail.Ch_delta, "segments": {s: y * tail.elevator_span_m / M_PER_FT for s, y in sides.items()},
        "CL_ds": at["CL_ih"], "Cm_ds": at["Cm_ih"], "CD_beta": n.drag.CD_beta, "Cl_dr": at["Cl_dr"],
        "Cn_da": n.aileron.Cn_da,
    }  # fmt: skip


def build(aircraft: Aircraft, path: Path) -> dict[str, str]:
    """Return {file in the aircraft's folder: text} of its JSBSim files, from the numbers.toml at `path`; raises
    ScenarioError for numbers that are wrong."""
    n, made_by = numbers(path), f"cosim new aircraft {aircraft.name}"
    try:
        with np.errstate(divide="raise", invalid="raise", over="raise"):
            aero = aerodynamics(made_by, MACH, 200.0, tables(n), derivative_tables(n), constants(n, aircraft))
    except (ArithmeticError, ValueError) as error:  # a tail that is higher than the wing's span has no downwash
        said = f"the formulas have no value for these dimensions together: {error}"
        raise ScenarioError(said, place=str(path)) from None
    _same_geometry(aircraft, n, path)
    empty, fuel, lightest = aircraft.mass.empty_t * 1e3, aircraft.mass.fuel_t * 1e3, aircraft.mass.mass_t[0] * 1e3
    model = render("model.xml", made_by=made_by, aircraft=aircraft, engine=n.engine, empty_kg=empty, fuel_kg=fuel,
                   load_kg=lightest - empty - fuel, engine_sides=np.linspace(-1.0, 1.0, aircraft.engines))  # fmt: skip
    return {
        f"{aircraft.name}.xml": model,
        "aerodynamics.xml": aero,
        "Engines/turbofan.xml": turbofan(made_by, n.engine.thrust_N, n.engine.bypass),
        "Engines/direct.xml": '<?xml version="1.0"?>\n<direct name="direct"/>\n',
        "Systems/multipliers.xml": render("multipliers.xml", made_by=made_by),
        "Systems/surfaces.xml": render("surfaces.xml", segments=aircraft.short.values(), travels=aircraft.travels),
    }


def _same_geometry(aircraft, n, path):
    """Raise ScenarioError where the geometry of aircraft.toml is not that of the numbers, which makes coefficients."""
    made = {
        "wing_area_ft2": n.wing.area_m2 / M_PER_FT**2, "span_ft": n.wing.span_m / M_PER_FT,
        "chord_ft": n.wing.chord_m / M_PER_FT, "tail_arm_ft": n.tail.arm_m / M_PER_FT, "downwash": downwash(n),
    }  # fmt: skip
    far = {key: 0.02 if key == "downwash" else 1e-3 * value for key, value in made.items()}
    wrong = [f"geometry.{key} = {getattr(aircraft.geometry, key):g}, {path.name} makes it {value:.6g}"
             for key, value in made.items() if abs(getattr(aircraft.geometry, key) - value) > far[key]]  # fmt: skip
    if wrong:
        place, remedy = str(path.with_name("aircraft.toml")), "Change what is wrong"
        raise ScenarioError("; ".join(wrong), place=place, remedy=remedy)


def aerodynamics(made_by: str, mach: Any, q_ref: float, tables: dict, derivatives: dict, constants: dict) -> str:
    """Return aerodynamics.xml from {CL, CD, Cm: (grid over ALPHA and `mach`, its change per psf of dynamic pressure
    beyond `q_ref` at zero alpha and of its slope)}, the tables of `derivative_tables` and `constants`."""
    zero, split = int(np.argmin(abs(ALPHA))), {}
    for name, (grid, flexible) in tables.items():
        grid = np.round(grid, 6)
        split[name] = lines(mach, None, grid[zero]), lines(ALPHA, mach, grid - grid[zero]), flexible
    column = {"alpha": "aero/alpha-rad", "qbar": "aero/qbar-psf"}
    rates = {name: (column[second], lines(MACH_COARSE, grid, values))
             for name, (second, grid, values) in derivatives.items()}  # fmt: skip
    return render("aerodynamics.xml", made_by=made_by, q_ref=q_ref, coefficients=split, derivatives=rates, **constants)


def turbofan(made_by: str, thrust: float, bypass: float) -> str:
    """Return the engine of static `thrust` [N] and its `bypass` ratio, over Mach and static pressure."""
    mach = np.arange(0.0, 1.01, 0.1)
    x = np.array([0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.0, 1.1])
    M = mach[:, None]
    ratios = {"IdleThrust": 0.05 * x * np.maximum(1.0 - 1.5 * M, 0.0), "MilThrust": thrust_ratio(M, x, bypass)}
    values = {name: lines(mach, x * 2116.22, ratio) for name, ratio in ratios.items()}  # psf at sea level
    return render("turbofan.xml", made_by=made_by, thrust_lbs=thrust / 4.4482216, bypass=bypass, thrust=values)


def thrust_ratio(mach: Any, pressure_ratio: Any, b: float) -> Any:
    """Return thrust over static sea-level thrust: take-off rating of Bartel and Young (2008) at bypass ratio `b`.

    T/T0 = A - 0.377 (1 + b) / sqrt((1 + 0.82 b) G0) Z x M + (0.23 + 0.19 sqrt(b)) X x M^2, x = p/p0, A, Z, X
    polynomials of x, G0 = 0.0606 b + 0.6337.
    """
    x = pressure_ratio
    A = -0.4327 * x**2 + 1.3855 * x + 0.0472
    Z = 0.9106 * x**3 - 1.7736 * x**2 + 1.8697 * x
    X = 0.1377 * x**3 - 0.4374 * x**2 + 1.3003 * x
    slope = 0.377 * (1 + b) / math.sqrt((1 + 0.82 * b) * (0.0606 * b + 0.6337))
    return A - slope * Z * x * mach + (0.23 + 0.19 * math.sqrt(b)) * X * x * mach**2


def lines(rows: Any, columns: Any, values: Any) -> str:
    """Return the lines of a JSBSim table, one-dimensional where `columns` is None."""
    if columns is None:
        return "\n".join(f"{r:10.6f}{v:14.6f}" for r, v in zip(rows, values))
    head = " " * 10 + "".join(f"{c:12.5f}" for c in columns)
    return "\n".join([head, *(f"{r:10.6f}" + "".join(f"{v:12.6f}" for v in row) for r, row in zip(rows, values))])


def render(file: str, **values: Any) -> str:
    """Return a JSBSim file made from its template in `templates/aircraft`."""
    made = Environment(loader=PackageLoader("cosim", "templates/aircraft"), undefined=StrictUndefined,
                       trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)  # fmt: skip
    made.filters["digits"] = "{:.8g}".format
    return made.get_template(file).render(values)
