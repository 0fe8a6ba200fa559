"""Write an aircraft's JSBSim files from tables and constants: the form that `force_model` reads again."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

MULTIPLIERS = (
    "CL_0", "CL_alpha", "CL_q", "CL_de", "CL_ds", "CD_0", "CD_alpha", "CD_beta",
    "Cm_0", "Cm_alpha", "Cm_q", "Cm_alphadot", "Cm_de", "Cm_ds",
    "CY_beta", "CY_dr", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cl_dr", "Cl_de",
    "Cn_beta", "Cn_p", "Cn_r", "Cn_da", "Cn_dr",
    "Ch_alpha", "Ch_delta",
)  # fmt: skip


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


RHO_SL_P = 2116.22  # psf


def multipliers_xml(shape: Shape) -> str:
    """Return the declarations of one multiplier per coefficient."""
    lines = "\n".join(f'  <property value="1"> aero/mult/{name} </property>' for name in MULTIPLIERS)
    note = f"<!-- Written by {shape.made_by}. One multiplier per coefficient: 1 is the fitted value. -->"
    return f'<?xml version="1.0"?>\n{note}\n<system name="multipliers">\n\n{lines}\n\n</system>\n'


def engine_xml(thrust: float, bypass: float, shape: Shape) -> str:
    """Return the turbofan of static `thrust` [N]: take-off rating of Bartel and Young (2008) at its `bypass` ratio,
    over Mach and static pressure.
    """
    mach = np.arange(0.0, 1.01, 0.1)
    ratio = np.array([0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.0, 1.1])
    x, M = ratio[None, :], mach[:, None]
    mil = thrust_ratio(M, x, bypass)
    idle = 0.05 * x * np.maximum(1.0 - 1.5 * M, 0.0)
    lookups = ("velocities/mach", "atmosphere/P-psf")
    return f"""<?xml version="1.0"?>
<!-- Written by {shape.made_by}. Sources: README.md in this aircraft's folder -->
<turbine_engine name="turbofan">
  <milthrust unit="LBS"> {thrust / 4.4482216:.1f} </milthrust>
  <bypassratio> {bypass:.1f} </bypassratio>
  <tsfc> 0.60 </tsfc>
  <bleed> 0.0 </bleed>
  <idlen1> 25.0 </idlen1>
  <idlen2> 60.0 </idlen2>
  <maxn1> 100.0 </maxn1>
  <maxn2> 100.0 </maxn2>
  <augmented> 0 </augmented>
  <injected> 0 </injected>
  <function name="IdleThrust">
{table(lookups, mach, ratio * RHO_SL_P, idle, 4)}
  </function>
  <function name="MilThrust">
{table(lookups, mach, ratio * RHO_SL_P, mil, 4)}
  </function>
</turbine_engine>
"""


def aerodynamics_xml(
    alpha: float, mach: Any, q_ref: Any, tables: Any, mach_coarse: Any, derivatives: Any, shape: Shape
) -> str:
    """Return the aerodynamics from the (alpha, Mach) tables with their flexibility constants and the tables of
    derivatives.
    """
    zero = int(np.argmin(abs(alpha)))
    parts = [_common(shape)]
    for name, (grid, (t0, t1)) in tables.items():
        grid = np.round(grid, 6)
        base = total(table(("velocities/mach",), mach, None, grid[zero]), product(t0, _flex(q_ref), indent=8))
        slope = total(
            table(("aero/alpha-rad", "velocities/mach"), alpha, mach, grid - grid[zero][None, :]),
            product(t1, _flex(q_ref), "aero/alpha-rad", indent=8),
        )
        for part, body in (("0", base), ("alpha", slope)):
            parts.append(function(f"aero/{name}_{part}", product(f"aero/mult/{name}_{part}", body)))
    for name, (second, grid, values) in derivatives.items():
        column = {"alpha": "aero/alpha-rad", "qbar": "aero/qbar-psf"}[second]
        body = table(("velocities/mach", column), mach_coarse, grid, values)
        parts.append(function(f"aero/{name}", product(f"aero/mult/{name}", body)))
    return "\n".join(
        [_HEAD.format(shape.made_by), *parts, *_sums(shape), *_hinges(shape), *_axes(shape), "</aerodynamics>\n"]
    )


def _flex(q_ref):
    return f"        <difference> <p> aero/qbar-psf </p> <v> {q_ref:.6g} </v> </difference>"


_HEAD = """<?xml version="1.0"?>
<!-- Written by {}. Sources, assumptions and the fit: README.md -->
<aerodynamics>

    <alphalimits unit="DEG"> <min> -6.0 </min> <max> 16.0 </max> </alphalimits>
"""


def _half_time(length):
    """Return length / 2V."""
    speed = "<max> <p> velocities/vt-fps </p> <v> 10.0 </v> </max>"
    return f"      <quotient> <v> {length / 2} </v> {speed} </quotient>"


def _common(shape):
    mean = (
        f"      <product> <v> {1.0 / len(shape.segment_span_ft)} </v> <sum> "
        + " ".join(f"<p> fcs/elevator-{s}-pos-rad </p>" for s in shape.segment_span_ft)
        + " </sum> </product>"
    )
    elevator = function("aero/elevator-mean-rad", mean)
    qS = function("aero/qS-lbs", product("aero/qbar-psf", "metrics/Sw-sqft"))
    chord = function("aero/chord-time-sec", _half_time(shape.chord_ft), "c / 2V")
    span = function("aero/span-time-sec", _half_time(shape.span_ft), "b / 2V")
    cosine, sine = "<cos> <p> aero/alpha-rad </p> </cos>", "<sin> <p> aero/alpha-rad </p> </sin>"
    p, r = "<p> aero/p-rad_sec </p>", "<p> aero/r-rad_sec </p>"
    roll = function(
        "aero/p-stability-rad_sec",
        f"      <sum> <product> {p} {cosine} </product> <product> {r} {sine} </product> </sum>",
    )
    yaw = function(
        "aero/r-stability-rad_sec",
        f"      <difference> <product> {r} {cosine} </product> <product> {p} {sine} </product> </difference>",
    )
    rates = [
        function(f"aero/{x}-rad_sec", total(f"velocities/{x}-aero-rad_sec", f"ext/gust-{x}-rad_sec"), "against the air")
        for x in "pqr"
    ]
    return "\n".join([elevator, qS, chord, span, *rates, roll, yaw])


def _sums(shape):
    lift = total(
        "aero/CL_0",
        "aero/CL_alpha",
        product("aero/CL_q", "aero/chord-time-sec", "aero/q-rad_sec"),
        product("aero/CL_de", "aero/elevator-mean-rad"),
        product("aero/mult/CL_ds", shape.CL_ds, "fcs/stabilizer-pos-rad"),
    )
    # alphadot from the forces of this frame (no lag): q + (g cos(theta) cos(phi) - q̄S CL / m) / V
    alphadot = """      <sum>
        <p> velocities/q-aero-rad_sec </p>
        <quotient>
          <difference>
            <product>
              <v> 32.174 </v> <cos> <p> attitude/theta-rad </p> </cos> <cos> <p> attitude/phi-rad </p> </cos>
            </product>
            <quotient>
              <product> <p> aero/qS-lbs </p> <p> aero/CL </p> </product>
              <p> inertia/mass-slugs </p>
            </quotient>
          </difference>
          <max> <p> velocities/vt-fps </p> <v> 10.0 </v> </max>
        </quotient>
      </sum>"""
    return [function("aero/CL", lift), function("aero/alphadot-from-forces", alphadot)]


def _over_speed(arm, rate):
    """Return the local angle that a body rate makes at an arm [ft]: arm rate / V."""
    turn = f"<product> <v> {arm} </v> <p> aero/{rate}-rad_sec </p> </product>"
    return f"        <quotient> {turn} <max> <p> velocities/vt-fps </p> <v> 10.0 </v> </max> </quotient>"


def _hinges(shape):
    """Return HM0 (per segment) and HM_delta (common), lbf ft: q̄ S_e c_e Ch_alpha alpha_t and q̄ S_e c_e
    Ch_delta.
    """
    size = shape.segment_area_ft2 * shape.segment_chord_ft
    out = [
        function(
            "aero/hinge-delta-lbsft_rad",
            product("aero/mult/Ch_delta", shape.Ch_delta * size, "aero/qbar-psf"),
            "hinge moment per elevator angle, trailing edge down +",
        ),
        function(
            "aero/tail-alpha-rad",
            total(
                product(1.0 - shape.downwash, "aero/alpha-rad"),
                "fcs/stabilizer-pos-rad",
                _over_speed(shape.tail_arm_ft, "q"),
            ),
            "local angle of attack of the tail: downwash, stabiliser, pitch rate",
        ),
    ]
    for segment, span in shape.segment_span_ft.items():
        angle = total("aero/tail-alpha-rad", _over_speed(span, "p"), indent=8)
        moment = product(size, "aero/qbar-psf", "aero/mult/Ch_alpha", shape.Ch_alpha, angle)
        out.append(function(f"aero/hinge-0-{segment}-lbsft", moment))
    return out


def _axes(shape):
    qS = "aero/qS-lbs"
    sideforce = total(product("aero/CY_beta", "aero/beta-rad"), product("aero/CY_dr", "fcs/rudder-applied-rad"))
    sideslip = product("aero/mult/CD_beta", shape.CD_beta, "aero/beta-rad", "aero/beta-rad")
    drag = total("aero/CD_0", "aero/CD_alpha", sideslip)
    pitch = total(
        "aero/Cm_0",
        "aero/Cm_alpha",
        product("aero/Cm_de", "aero/elevator-mean-rad"),
        product("aero/mult/Cm_ds", shape.Cm_ds, "fcs/stabilizer-pos-rad"),
        product(
            "aero/chord-time-sec",
            total(
                product("aero/Cm_q", "aero/q-rad_sec"),
                product("aero/Cm_alphadot", "aero/alphadot-from-forces"),
            ),
        ),
    )
    aileron = total("fcs/aileron-left-pos-rad", "fcs/aileron-right-pos-rad", indent=8)
    aileron = product(0.5, aileron, indent=6)
    # a left segment down lifts the left tail: rolls right; each segment carries its share of CL_de
    n = len(shape.segment_span_ft)
    tail = (
        "        <sum> "
        + " ".join(
            f"<product> <v> {-y / n / shape.span_ft:.6g} </v> <p> fcs/elevator-{s}-pos-rad </p> </product>"
            for s, y in shape.segment_span_ft.items()
        )
        + " </sum>"
    )
    p, r = "aero/p-stability-rad_sec", "aero/r-stability-rad_sec"
    roll = total(
        product("aero/Cl_beta", "aero/beta-rad"),
        product("aero/span-time-sec", total(product("aero/Cl_p", p), product("aero/Cl_r", r))),
        product("aero/Cl_da", aileron),
        product("aero/mult/Cl_dr", shape.Cl_dr, "fcs/rudder-applied-rad"),
        product("aero/mult/Cl_de", "aero/CL_de", tail),
    )
    yaw = total(
        product("aero/Cn_beta", "aero/beta-rad"),
        product("aero/span-time-sec", total(product("aero/Cn_p", p), product("aero/Cn_r", r))),
        product("aero/mult/Cn_da", shape.Cn_da, aileron),
        product("aero/Cn_dr", "fcs/rudder-applied-rad"),
    )
    axes = (
        ("LIFT", "", "force/lift", product(qS, "aero/CL")),
        ("DRAG", "", "force/drag", product(qS, drag)),
        ("SIDE", "", "force/side", product(qS, sideforce)),
        ("ROLL", ' frame="STABILITY"', "moment/roll", product(qS, "metrics/bw-ft", roll)),
        ("PITCH", ' frame="STABILITY"', "moment/pitch", product(qS, "metrics/cbarw-ft", pitch)),
        ("YAW", ' frame="STABILITY"', "moment/yaw", product(qS, "metrics/bw-ft", yaw)),
    )
    return [
        f'\n    <axis name="{name}"{frame}>\n{function("aero/" + label, body)}\n    </axis>'
        for name, frame, label, body in axes
    ]


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


def table(lookups: Any, rows: Any, columns: Any, values: Any, indent: int = 8) -> Any:
    """Return a JSBSim table element; one-dimensional when columns is None."""
    pad = " " * indent
    lines = [f"{pad}<table>"]
    for role, name in zip(("row", "column"), lookups):
        lines.append(f'{pad}  <independentVar lookup="{role}"> {name} </independentVar>')
    lines.append(f"{pad}  <tableData>")
    if columns is not None:
        lines.append(pad + " " * 14 + "".join(f"{c:12.5f}" for c in columns))
        lines += [f"{pad}    {r:10.6f}" + "".join(f"{v:12.6f}" for v in row) for r, row in zip(rows, values)]
    else:
        lines += [f"{pad}    {r:10.6f}{v:14.6f}" for r, v in zip(rows, values)]
    return "\n".join([*lines, f"{pad}  </tableData>", f"{pad}</table>"])


def function(name: str, body: Any, comment: str | None = None) -> str:
    """Return a named function element around `body`."""
    note = f"\n      <description> {comment} </description>" if comment else ""
    return f'    <function name="{name}">{note}\n{body}\n    </function>'


def product(*parts: Any, indent: int = 6) -> str:
    """Return a product of properties (str), numbers and ready elements."""
    return _operation("product", parts, indent)


def total(*parts: Any, indent: int = 6) -> str:
    """Return a sum of properties (str), numbers and ready elements."""
    return _operation("sum", parts, indent)


def _operation(kind, parts, indent):
    pad = " " * indent
    lines = []
    for part in parts:
        if isinstance(part, str) and "<" in part:
            lines.append(part)
        elif isinstance(part, str):
            lines.append(f"{pad}  <p> {part} </p>")
        else:
            lines.append(f"{pad}  <v> {part:.8g} </v>")
    return "\n".join([f"{pad}<{kind}>", *lines, f"{pad}</{kind}>"])
