"""A small still picture of the envelope, as SVG: what a README can show."""

from pathlib import Path

import pandas as pd
from markupsafe import escape

from cosim.files import replace_text
from cosim.report.envelope_maps import BY_COLUMN, REASON, STOPS, colour
from cosim.report.page import PICTURE

WIDE, HIGH, GAP_X, GAP_Y, LEFT, TOP = 262, 106, 16, 60, 46, 64  # of a panel, between panels, to the first one [px]
BAR = 66  # right of the panels, for the colours [px]
ROWS = (  # column, panels: how (mass, CG) of each follow from the table's values
    ("alpha_deg", "masses"),
    ("throttle", "masses"),
    ("stabilizer_deg", "cgs"),
    ("hydraulic_up_deg", "masses"),
    ("ema_up_deg", "masses"),
)


def envelope_picture(trims: pd.DataFrame, output: str | Path) -> Path:
    """Write the picture of a trim map to `output`; returns its Path. Raises OutputError."""
    replace_text(output, render(trims), PICTURE)
    return Path(output)


def render(trims: pd.DataFrame) -> str:
    """Return the SVG text: a row per quantity, masses (or centres of gravity) from left to right."""
    masses, cgs = (sorted(trims[name].unique()) for name in ("mass_t", "cg_pct"))
    some = [masses[0], masses[len(masses) // 2], masses[-1]]
    middle = cgs[len(cgs) // 2]
    cases = {"masses": [(m, middle) for m in some], "cgs": [(some[1], c) for c in (cgs[0], middle, cgs[-1])]}
    width = LEFT + 3 * WIDE + 2 * GAP_X + BAR
    height = TOP + len(ROWS) * (HIGH + GAP_Y) - GAP_Y + 40
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        'font-family="system-ui,Segoe UI,Roboto,Liberation Sans,sans-serif" font-size="11" fill="#1c2128">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        _key([name for name in REASON if (trims["reason"] == name).any()]),
    ]
    for r, (column, kind) in enumerate(ROWS):
        y = TOP + r * (HIGH + GAP_Y)
        for c, (mass, cg) in enumerate(cases[kind]):
            part = trims[(trims["mass_t"] == mass) & (trims["cg_pct"] == cg)]
            out += _panel(part, BY_COLUMN[column], LEFT + c * (WIDE + GAP_X), y, f"{mass:.0f} t, CG {cg:.0f} %", c == 0)
        out += _bar(BY_COLUMN[column], width - BAR + 12, y)
    middle_x = LEFT + (3 * WIDE + 2 * GAP_X) / 2
    out.append(f'<text x="{middle_x}" y="{height - 6}" text-anchor="middle" fill="#59636e">calibrated airspeed, kt'
               "</text></svg>\n")  # fmt: skip
    return "\n".join(out)


def _key(names):
    x, out = LEFT, []
    for name in names:
        fill, letter, word = REASON[name]
        out.append(f'<rect x="{x}" y="8" width="14" height="14" fill="{fill}"/>')
        out.append(f'<text x="{x + 7}" y="18.5" text-anchor="middle" font-size="9">{letter}</text>')
        out.append(f'<text x="{x + 19}" y="19">{escape(word)}</text>')
        x += 110
    out.append(f'<text x="{x}" y="19" fill="#59636e">no steady level flight, and why</text>')
    return "".join(out)


def _panel(part, q, x0, y0, title, first):
    """Draw one quantity over speed and altitude: cells of one colour are one path."""
    speeds, heights = sorted(part["cas_kt"].unique()), sorted(part["altitude_ft"].unique())
    w, h = WIDE / len(speeds), HIGH / len(heights)
    shapes: dict[str, list] = {}
    letters = []
    for cell in part.to_dict("records"):
        x = x0 + speeds.index(cell["cas_kt"]) * w
        y = y0 + HIGH - (heights.index(cell["altitude_ft"]) + 1) * h
        if cell["reason"]:
            fill, letter, _ = REASON[cell["reason"]]
            letters.append(f'<text x="{x + w / 2:.1f}" y="{y + h / 2 + 3:.1f}">{letter}</text>')
        else:
            fill = colour((cell[q.column] * q.factor - q.low) / (q.high - q.low))
        shapes.setdefault(fill, []).append(f"M{x:.1f} {y:.1f}h{w - 0.8:.1f}v{h - 0.8:.1f}h-{w - 0.8:.1f}z")
    out = [f'<path fill="{fill}" d="{"".join(paths)}"/>' for fill, paths in shapes.items()]
    if letters:
        out.append(f'<g font-size="8" text-anchor="middle">{"".join(letters)}</g>')
    out.append(f'<text x="{x0}" y="{y0 - 6}" fill="#59636e">{title}</text>')
    if first:
        out.append(f'<text x="{x0}" y="{y0 - 21}" font-weight="600">{escape(q.heading)}</text>')
    for v in (200, 300):
        if v in speeds or speeds[0] < v < speeds[-1]:
            x = x0 + (v - speeds[0]) / (speeds[-1] - speeds[0]) * (WIDE - w) + w / 2
            out.append(f'<text x="{x:.1f}" y="{y0 + HIGH + 13}" text-anchor="middle" fill="#59636e">{v}</text>')
    if first:
        for k in range(0, len(heights), 4):
            y = y0 + HIGH - (k + 0.5) * h + 4
            out.append(f'<text x="{x0 - 6}" y="{y:.1f}" text-anchor="end" fill="#59636e">{heights[k] / 1e3:.0f}</text>')
        out.append(f'<text transform="translate({x0 - 32} {y0 + HIGH / 2}) rotate(-90)" text-anchor="middle" '
                   'fill="#59636e">1000 ft</text>')  # fmt: skip
    return out


def _bar(q, x, y):
    """Draw the colours of one row with their ends."""
    n, each = len(STOPS) * 2, HIGH / (len(STOPS) * 2)
    out = [
        f'<rect x="{x}" y="{y + HIGH - (i + 1) * each:.1f}" width="10" height="{each + 0.3:.1f}" '
        f'fill="{colour((i + 0.5) / n)}"/>'
        for i in range(n)
    ]
    for value, at in ((q.high, y + 9), (q.low, y + HIGH)):
        out.append(f'<text x="{x + 14}" y="{at}" fill="#59636e">{value:.0f} {escape(q.unit)}</text>')
    return out
