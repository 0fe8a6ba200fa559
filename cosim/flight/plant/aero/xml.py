"""JSBSim's files of an aircraft from tables and constants: the form that `force_model` reads again."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

MULTIPLIERS = (
    "CL_0", "CL_alpha", "CL_q", "CL_de", "CL_ds", "CD_0", "CD_alpha", "CD_beta",
    "Cm_0", "Cm_alpha", "Cm_q", "Cm_alphadot", "Cm_de", "Cm_ds",
    "CY_beta", "CY_dr", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cl_dr", "Cl_de",
    "Cn_beta", "Cn_p", "Cn_r", "Cn_da", "Cn_dr",
    "Ch_alpha", "Ch_delta",
)  # fmt: skip
RHO_SL_P = 2116.22  # psf


@dataclass(frozen=True)
class Shape:
    """What of an aircraft stands in its functions as a number, not as a table; derivatives per rad, stability axes."""

    made_by: str  # command that writes the files
    chord_ft: float
    span_ft: float
    tail_arm_ft: float  # from the CG
    downwash: float  # d epsilon / d alpha at the tail
    segment_area_ft2: float  # of one elevator segment, behind its hinge
    segment_chord_ft: float
    segment_span_ft: dict[str, float]  # short name -> spanwise middle, right +
    Ch_alpha: float  # hinge moment of an elevator without camber
    Ch_delta: float
    CL_ds: float  # stabiliser
    Cm_ds: float
    CD_beta: float  # per rad2
    Cl_dr: float
    Cn_da: float


def multipliers_xml(shape: Shape) -> str:
    """Return the declarations of one multiplier per coefficient."""
    lines = "\n".join(f'  <property value="1"> aero/mult/{name} </property>' for name in MULTIPLIERS)
    note = f"<!-- Written by {shape.made_by}. One multiplier per coefficient: 1 is the fitted value. -->"
    return f'<?xml version="1.0"?>\n{note}\n<system name="multipliers">\n\n{lines}\n\n</system>\n'


def engine_xml(thrust: float, bypass: float, shape: Shape) -> str:
    """Return the turbofan of static `thrust` [N]: take-off rating of Bartel and Young (2008) at its `bypass` ratio,
    over Mach and static pressure."""
    mach = np.arange(0.0, 1.01, 0.1)
    ratio = np.array([0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.0, 1.1])
    x, M = ratio[None, :], mach[:, None]
    root = Element("turbine_engine", name="turbofan")
    SubElement(root, "milthrust", unit="LBS").text = f" {thrust / 4.4482216:.1f} "
    for name, value in (("bypassratio", f"{bypass:.1f}"), ("tsfc", "0.60"), ("bleed", "0.0"), ("idlen1", "25.0"),
                        ("idlen2", "60.0"), ("maxn1", "100.0"), ("maxn2", "100.0"), ("augmented", "0"),
                        ("injected", "0")):  # fmt: skip
        SubElement(root, name).text = f" {value} "
    idle = 0.05 * x * np.maximum(1.0 - 1.5 * M, 0.0)
    for name, values in (("IdleThrust", idle), ("MilThrust", thrust_ratio(M, x, bypass))):
        lookups = ("velocities/mach", "atmosphere/P-psf")
        root.append(function(name, table(lookups, mach, ratio * RHO_SL_P, values)))
    return _text(root, f"Written by {shape.made_by}. Sources: README.md in this aircraft's folder")


def aerodynamics_xml(
    alpha: float, mach: Any, q_ref: Any, tables: Any, mach_coarse: Any, derivatives: Any, shape: Shape
) -> str:
    """Return the aerodynamics from the (alpha, Mach) tables with their flexibility constants and the tables of
    derivatives."""
    zero, root = int(np.argmin(abs(alpha))), Element("aerodynamics")
    limits = SubElement(root, "alphalimits", unit="DEG")
    SubElement(limits, "min").text, SubElement(limits, "max").text = " -6.0 ", " 16.0 "
    root.extend(_common(shape))
    for name, (grid, (t0, t1)) in tables.items():
        grid = np.round(grid, 6)
        base = total(table(("velocities/mach",), mach, None, grid[zero]), product(t0, _flex(q_ref)))
        slope = total(
            table(("aero/alpha-rad", "velocities/mach"), alpha, mach, grid - grid[zero][None, :]),
            product(t1, _flex(q_ref), "aero/alpha-rad"),
        )
        for part, body in (("0", base), ("alpha", slope)):
            root.append(function(f"aero/{name}_{part}", product(f"aero/mult/{name}_{part}", body)))
    for name, (second, grid, values) in derivatives.items():
        column = {"alpha": "aero/alpha-rad", "qbar": "aero/qbar-psf"}[second]
        body = table(("velocities/mach", column), mach_coarse, grid, values)
        root.append(function(f"aero/{name}", product(f"aero/mult/{name}", body)))
    root.extend([*_sums(shape), *_hinges(shape), *_axes(shape)])
    return _text(root, f"Written by {shape.made_by}. Sources, assumptions and the fit: README.md")


def _text(root, note):
    indent(root)
    return f'<?xml version="1.0"?>\n<!-- {note} -->\n{tostring(root, encoding="unicode")}\n'


def operation(kind: str, *parts: Any) -> Element:
    """Return an operation on properties (names), numbers (in eight digits, or as a text has them) and elements."""
    out = Element(kind)
    for part in parts:
        if not isinstance(part, Element):
            text = part if isinstance(part, str) else f"{part:.8g}"
            part = Element("v" if text.lstrip("-")[0].isdigit() else "p")
            part.text = f" {text} "
        out.append(part)
    return out


product, total, difference, quotient = (partial(operation, k) for k in ("product", "sum", "difference", "quotient"))
sine, cosine = partial(operation, "sin"), partial(operation, "cos")


def function(name: str, body: Element, comment: str = "") -> Element:
    """Return a named function element around `body`."""
    out = Element("function", name=name)
    if comment:
        SubElement(out, "description").text = f" {comment} "
    out.append(body)
    return out


def table(lookups: Any, rows: Any, columns: Any, values: Any) -> Element:
    """Return a JSBSim table element; one-dimensional when columns is None."""
    out = Element("table")
    for role, name in zip(("row", "column"), lookups):
        SubElement(out, "independentVar", lookup=role).text = f" {name} "
    if columns is None:
        lines = [f"{r:10.6f}{v:14.6f}" for r, v in zip(rows, values)]
    else:
        lines = [" " * 10 + "".join(f"{c:12.5f}" for c in columns)]
        lines += [f"{r:10.6f}" + "".join(f"{v:12.6f}" for v in row) for r, row in zip(rows, values)]
    SubElement(out, "tableData").text = "\n" + "\n".join(lines) + "\n"
    return out


def _flex(q_ref):
    return difference("aero/qbar-psf", f"{q_ref:.6g}")


def _speed():
    return operation("max", "velocities/vt-fps", "10.0")


def _common(shape):
    def turned(join, one, other):
        """Return the sum or difference of two body rates, turned by the angle of attack."""
        return join(product(f"aero/{one}-rad_sec", cosine("aero/alpha-rad")),
                    product(f"aero/{other}-rad_sec", sine("aero/alpha-rad")))  # fmt: skip

    segments = shape.segment_span_ft
    mean = product(str(1.0 / len(segments)), total(*(f"fcs/elevator-{s}-pos-rad" for s in segments)))
    yield function("aero/elevator-mean-rad", mean)
    yield function("aero/qS-lbs", product("aero/qbar-psf", "metrics/Sw-sqft"))
    yield function("aero/chord-time-sec", quotient(str(shape.chord_ft / 2), _speed()), "c / 2V")
    yield function("aero/span-time-sec", quotient(str(shape.span_ft / 2), _speed()), "b / 2V")
    for x in "pqr":
        rate = total(f"velocities/{x}-aero-rad_sec", f"ext/gust-{x}-rad_sec")
        yield function(f"aero/{x}-rad_sec", rate, "against the air")
    yield function("aero/p-stability-rad_sec", turned(total, "p", "r"))
    yield function("aero/r-stability-rad_sec", turned(difference, "r", "p"))


def _sums(shape):
    lift = total(
        "aero/CL_0", "aero/CL_alpha", product("aero/CL_q", "aero/chord-time-sec", "aero/q-rad_sec"),
        product("aero/CL_de", "aero/elevator-mean-rad"),
        product("aero/mult/CL_ds", shape.CL_ds, "fcs/stabilizer-pos-rad"),
    )  # fmt: skip
    yield function("aero/CL", lift)
    # alphadot from the forces of this frame (no lag): q + (g cos(theta) cos(phi) - q̄S CL / m) / V
    weight = product("32.174", cosine("attitude/theta-rad"), cosine("attitude/phi-rad"))
    path = difference(weight, quotient(product("aero/qS-lbs", "aero/CL"), "inertia/mass-slugs"))
    yield function("aero/alphadot-from-forces", total("velocities/q-aero-rad_sec", quotient(path, _speed())))


def _over_speed(arm, rate):
    """Return the local angle that a body rate makes at an arm [ft]: arm rate / V."""
    return quotient(product(str(arm), f"aero/{rate}-rad_sec"), _speed())


def _hinges(shape):
    """Yield HM0 (per segment) and HM_delta (common), lbf ft: q̄ S_e c_e Ch_alpha alpha_t and q̄ S_e c_e Ch_delta."""
    size = shape.segment_area_ft2 * shape.segment_chord_ft
    slope = product("aero/mult/Ch_delta", shape.Ch_delta * size, "aero/qbar-psf")
    yield function("aero/hinge-delta-lbsft_rad", slope, "hinge moment per elevator angle, trailing edge down +")
    local = total(product(1.0 - shape.downwash, "aero/alpha-rad"), "fcs/stabilizer-pos-rad",
                  _over_speed(shape.tail_arm_ft, "q"))  # fmt: skip
    yield function("aero/tail-alpha-rad", local, "local angle of attack of the tail: downwash, stabiliser, pitch rate")
    for segment, span in shape.segment_span_ft.items():
        angle = total("aero/tail-alpha-rad", _over_speed(span, "p"))
        moment = product(size, "aero/qbar-psf", "aero/mult/Ch_alpha", shape.Ch_alpha, angle)
        yield function(f"aero/hinge-0-{segment}-lbsft", moment)


def _axes(shape):
    p, r, n = "aero/p-stability-rad_sec", "aero/r-stability-rad_sec", len(shape.segment_span_ft)

    def aileron():
        return product(0.5, total("fcs/aileron-left-pos-rad", "fcs/aileron-right-pos-rad"))

    def of_rates(axis):
        rates = total(product(f"aero/{axis}_p", p), product(f"aero/{axis}_r", r))
        return product("aero/span-time-sec", rates)

    side = total(product("aero/CY_beta", "aero/beta-rad"), product("aero/CY_dr", "fcs/rudder-applied-rad"))
    sideslip = product("aero/mult/CD_beta", shape.CD_beta, "aero/beta-rad", "aero/beta-rad")
    damping = total(product("aero/Cm_q", "aero/q-rad_sec"), product("aero/Cm_alphadot", "aero/alphadot-from-forces"))
    pitch = total(
        "aero/Cm_0", "aero/Cm_alpha", product("aero/Cm_de", "aero/elevator-mean-rad"),
        product("aero/mult/Cm_ds", shape.Cm_ds, "fcs/stabilizer-pos-rad"), product("aero/chord-time-sec", damping),
    )  # fmt: skip
    # a left segment down lifts the left tail: rolls right; each segment carries its share of CL_de
    tail = total(*(product(f"{-y / n / shape.span_ft:.6g}", f"fcs/elevator-{s}-pos-rad")
                   for s, y in shape.segment_span_ft.items()))  # fmt: skip
    roll = total(
        product("aero/Cl_beta", "aero/beta-rad"), of_rates("Cl"), product("aero/Cl_da", aileron()),
        product("aero/mult/Cl_dr", shape.Cl_dr, "fcs/rudder-applied-rad"),
        product("aero/mult/Cl_de", "aero/CL_de", tail),
    )  # fmt: skip
    yaw = total(
        product("aero/Cn_beta", "aero/beta-rad"), of_rates("Cn"),
        product("aero/mult/Cn_da", shape.Cn_da, aileron()), product("aero/Cn_dr", "fcs/rudder-applied-rad"),
    )  # fmt: skip
    for name, label, *factors in (
        ("LIFT", "force/lift", "aero/CL"), ("DRAG", "force/drag", total("aero/CD_0", "aero/CD_alpha", sideslip)),
        ("SIDE", "force/side", side), ("ROLL", "moment/roll", "metrics/bw-ft", roll),
        ("PITCH", "moment/pitch", "metrics/cbarw-ft", pitch), ("YAW", "moment/yaw", "metrics/bw-ft", yaw),
    ):  # fmt: skip
        axis = Element("axis", {"name": name, **({"frame": "STABILITY"} if "moment" in label else {})})
        axis.append(function(f"aero/{label}", product("aero/qS-lbs", *factors)))
        yield axis


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
