"""The page of the envelope: where the aircraft trims, at which values, why not elsewhere, where its actuators stall."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from cosim.campaign.envelope import REASONS, masses
from cosim.report.figure import axis, still
from cosim.report.page import page, write

COLUMNS_PX = 175  # of a row of panels
TILED = {"hoverongaps": False, "xgap": 1, "ygap": 1}
NAMES = {"hydraulic": "hydraulic", "ema": "electromechanical"}
REASON = {  # reason -> (colour, letter, word)
    "stall": ("#d55e00", "S", "stall"),
    "thrust": ("#cc79a7", "T", "thrust"),
    "speed": ("#aab2bb", "M", "Mach 0.95"),
    "stabiliser": ("#56b4e9", "B", "stabiliser"),
    "none found": ("#ffffff", "?", "no trim found"),
}


@dataclass(frozen=True)
class Quantity:
    """One quantity of the trim map: column, heading, unit, digits, range of the colours, factor, what it tells."""

    column: str
    heading: str
    unit: str
    digits: int
    low: float
    high: float
    factor: float = 1.0
    told: str = ""


QUANTITIES = (
    Quantity("alpha_deg", "Trim angle of attack", "deg", 1, -2.0, 18.0),
    Quantity("stabilizer_deg", "Stabiliser in trim, trailing edge down +", "deg", 1, -5.0, 4.0,
             told="Its travel is −13 to +4 deg. A forward CG needs more of it nose up."),
    Quantity("throttle", "Throttle in trim", "%", 0, 25.0, 100.0, 100.0),
    Quantity("hydraulic_up_deg", "How far a hydraulic segment goes up", "deg", 1, 11.0, 23.0, -1.0,
             "Full travel is 23 deg; where it is less, the actuator stalls on the way."),
    Quantity("hydraulic_down_deg", "How far a hydraulic segment goes down", "deg", 1, 8.0, 17.0, 1.0,
             "Full travel is 17 deg."),
    Quantity("ema_up_deg", "How far an electromechanical segment goes up", "deg", 1, 11.0, 23.0, -1.0,
             "Full travel is 23 deg."),
    Quantity("ema_down_deg", "How far an electromechanical segment goes down", "deg", 1, 8.0, 17.0, 1.0,
             "Full travel is 17 deg."),
)  # fmt: skip


def envelope_report(trims: pd.DataFrame, found: dict, output: str | Path) -> Path:
    """Write the page of a trim map and its `envelope.summary` to the file `output`; returns its Path. Raises
    OutputError."""
    return write(output, render(trims, found))


def render(trims: pd.DataFrame, found: dict) -> str:
    """Return the page as HTML text."""
    good = trims[trims["reason"] == ""]
    shown = [q for q in QUANTITIES if len(good) and good[q.column].nunique() > 1]  # no map of one value
    figures = [_figure(trims, q) for q in shown]
    return page(
        "envelope.html", title="Envelope of the transport",
        subtitle=f"{found['points']} points over mass, CG, altitude and speed; {found['trimmed']} trim in level flight",
        figures=figures, found=found, why=[f"{n} for {REASON[name][2]}" for name, n in found["reasons"].items()],
        stalls=[(NAMES[technology], _stalls(ways)) for technology, ways in found["stalls"].items()],
        key=[(*REASON[name][:2], REASONS.get(name, name)) for name in found["reasons"]],
        maps=[(q.heading, _told(q, trims), figure) for q, figure in zip(shown, figures)], masses=masses(found),
    )  # fmt: skip


def _told(q, trims):
    good = trims.loc[trims["reason"] == "", q.column] * q.factor
    span = f"{good.min():.{q.digits}f} to {good.max():.{q.digits}f} {q.unit} in these points."
    return f"{q.told} {span}".strip()


def _stalls(ways):
    """Return in words where full deflection up and down is not reached."""
    said = []
    for way, full in (("up", 23), ("down", 17)):
        at = ways[way]
        worst = f"{abs(at['reach_deg']):.1f} of {full} deg at worst"
        said.append(f"{way} never short of its travel" if at["from_kt"] is None
                    else f"{way} from {at['from_kt']:.0f} kt CAS on ({worst})")  # fmt: skip
    return said


def _figure(trims, q):
    """Return the panels of one quantity: mass from left to right, CG from top to bottom."""
    masses, cgs = sorted(trims["mass_t"].unique()), sorted(trims["cg_pct"].unique())
    n = len(masses)
    figure = still(q.column, "", 80 + COLUMNS_PX * len(cgs))
    figure.layout["margin"] |= {"r": 78, "l": 52}
    titles = [f"{m:.0f} t, CG {c:.0f} %" for c in cgs for m in masses]
    figure.grid(titles, "1000 ft", n, x_title="kt CAS", gap=0.022)
    for i, (cg, mass) in enumerate(((c, m) for c in cgs for m in masses), 1):
        if (i - 1) % n:
            figure.layout[axis("yaxis", i)]["showticklabels"] = False
        part = trims[(trims["mass_t"] == mass) & (trims["cg_pct"] == cg)]
        _values(figure, part, q, i)
        _reasons(figure, part, i)
    return figure


def _grid(part, column):
    """Return (speeds, altitudes in 1000 ft, rows of `column`): one row per altitude."""
    cells = part.pivot(index="altitude_ft", columns="cas_kt", values=column)
    return cells.columns.tolist(), (cells.index / 1000.0).tolist(), cells.to_numpy(object)


def _values(figure, part, q, panel):
    x, y, z = _grid(part.assign(value=part[q.column] * q.factor), "value")
    bar = {"title": {"text": q.unit, "font": {"size": 11}}, "thickness": 12, "tickfont": {"size": 10.5}, "len": 0.9}
    figure.points(
        panel, type="heatmap", x=x, y=y, z=[[None if v != v else round(float(v), 3) for v in row] for row in z],
        zmin=q.low, zmax=q.high, colorscale="Cividis", showscale=panel == 1, colorbar=bar, **TILED,
        hover=f"%{{x:.0f}} kt, %{{y:.0f}}000 ft: %{{z:.{q.digits}f}} {q.unit}<extra></extra>",
    )  # fmt: skip


def _reasons(figure, part, panel):
    """Draw what has no trim: one colour and one letter per reason."""
    names = list(REASON)
    x, y, reason = _grid(part, "reason")
    _, _, why = _grid(part, "why")
    step = [[k / len(names), c] for i, n in enumerate(names) for k, c in ((i, REASON[n][0]), (i + 1, REASON[n][0]))]
    figure.points(
        panel, type="heatmap", x=x, y=y, z=[[names.index(r) if r else None for r in row] for row in reason],
        text=[[REASON[r][1] if r else "" for r in row] for row in reason], texttemplate="%{text}",
        textfont={"size": 9, "color": "#1c2128"}, customdata=why.tolist(), zmin=-0.5, zmax=len(names) - 0.5,
        colorscale=step, showscale=False, **TILED, hover="%{x:.0f} kt, %{y:.0f}000 ft<br>%{customdata}<extra></extra>",
    )  # fmt: skip
