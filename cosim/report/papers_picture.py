"""Still pictures of the papers' experiments, as SVG: what the page of the papers shows of our figures."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import escape

from cosim.files import replace_text
from cosim.papers.drawing import Curve, Drawing, Panel
from cosim.report.figure import envelope
from cosim.report.page import PICTURE

WIDE, HIGH, LEFT, TOP, GAP_X, GAP_Y = 250, 120, 46, 62, 56, 48  # panel, margins, between panels [px]
POINTS, ALL = 240, 6000  # most of a curve, of all curves of a picture
INK, MUTED = "#1c2128", "#59636e"
ROLES = {"ours": "#2563c9", "true": INK, "quiet": "#8a939e", "second": "#c2570c", "third": "#1f883d"}
DASHES = {"solid": "", "dash": "6 3", "dot": "2 3", "dashdot": "7 3 2 3"}


def write(folder: str | Path, drawings: list[Drawing]) -> list[Path]:
    """Write those of `drawings` that have a name to folder/<paper>/<name>.svg and return the paths."""
    out = []
    for d in drawings:
        if d.picture:
            path = Path(folder) / d.paper / f"{d.picture}.svg"
            replace_text(path, render(d), PICTURE)
            out.append(path)
    return out


def render(d: Drawing) -> str:
    """Return the SVG text of a Drawing that has panels: axes in the order of the paper's figure, our curves in them."""
    columns = min(d.columns, len(d.panels))
    lines = -(-len(d.panels) // columns)
    names = {c.name: c for p in d.panels for c in p.curves}
    width = LEFT + columns * (WIDE + GAP_X) - GAP_X + 14
    height = TOP + lines * (HIGH + GAP_Y) - GAP_Y + 34
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        f'font-family="system-ui,Segoe UI,Roboto,Liberation Sans,sans-serif" font-size="10" fill="{INK}">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        f'<text x="{LEFT}" y="16" font-size="12" font-weight="600">{escape(d.title)}</text>',
        *_key(names.values()),
    ]
    most = max(40, min(POINTS, ALL // sum(len(p.curves) for p in d.panels)))
    for i, panel in enumerate(d.panels):
        x, y = LEFT + i % columns * (WIDE + GAP_X), TOP + i // columns * (HIGH + GAP_Y)
        out += _panel(panel, d, x, y, most)
    return "\n".join([*out, "</svg>"]) + "\n"


def _key(curves):
    """Draw the names of the curves, and how each looks."""
    x, out = float(LEFT), []
    for c in curves:
        out.append(f'<line x1="{x:.0f}" x2="{x + 18:.0f}" y1="30" y2="30" {_look(c)}/>')
        out.append(f'<text x="{x + 22:.0f}" y="33" fill="{MUTED}">{escape(c.name)}</text>')
        x += 40 + 5.4 * len(c.name)
    return out


def _look(c: Curve) -> str:
    dash = f' stroke-dasharray="{DASHES[c.dash]}"' if DASHES[c.dash] else ""
    return f'fill="none" stroke="{ROLES[c.role]}" stroke-width="1.2"{dash}'


def _panel(p: Panel, d: Drawing, x0: int, y0: int, most: int) -> list[str]:
    """Draw a panel: frame, ticks, the onset of the fault, levels, curves."""
    shown = [_shown(c, d.span, most) for c in p.curves]
    start = min(t[0] for t, _ in shown) if d.span is None else d.span[0]
    end = max(t[-1] for t, _ in shown) if d.span is None else d.span[1]
    low, high = _limits(p, [y for _, y in shown])

    def at(t: Any, y: Any) -> tuple[Any, Any]:
        return x0 + (t - start) / (end - start) * WIDE, y0 + HIGH - (np.clip(y, low, high) - low) / (high - low) * HIGH

    unit = f", {p.unit}" if p.unit else ""
    out = [
        f'<text x="{x0}" y="{y0 - 5}" font-weight="600">{escape(p.title)}{escape(unit)}</text>',
        f'<rect x="{x0}" y="{y0}" width="{WIDE}" height="{HIGH}" fill="none" stroke="#d0d7de"/>',
    ]
    for y in _ticks(low, high):
        _, py = at(start, y)
        out.append(f'<line x1="{x0}" x2="{x0 + WIDE}" y1="{py:.1f}" y2="{py:.1f}" stroke="#eef0f3"/>')
        out.append(f'<text x="{x0 - 4}" y="{py + 3:.1f}" text-anchor="end" fill="{MUTED}">{y:g}</text>')
    for t in _ticks(start, end):
        px, _ = at(t, low)
        out.append(f'<text x="{px:.1f}" y="{y0 + HIGH + 12}" text-anchor="middle" fill="{MUTED}">{t:g}</text>')
    out.append(f'<text x="{x0 + WIDE}" y="{y0 + HIGH + 24}" text-anchor="end" fill="{MUTED}">time, s</text>')
    for y in p.levels:
        _, py = at(start, y)
        out.append(f'<line x1="{x0}" x2="{x0 + WIDE}" y1="{py:.1f}" y2="{py:.1f}" stroke="{MUTED}" {_DASHED}/>')
    if d.onset is not None:
        px, _ = at(d.onset, low)
        out.append(f'<line x1="{px:.1f}" x2="{px:.1f}" y1="{y0}" y2="{y0 + HIGH}" stroke="{MUTED}" {_DASHED}/>')
    for c, (when, values) in zip(p.curves, shown, strict=True):
        place, known = at(when, values), np.isfinite(values)
        out += [f'<polyline points="{line}" {_look(c)}/>' for line in _lines(place[0], place[1], known)]
    return out


_DASHED = 'stroke-dasharray="3 3"'


def _shown(c: Curve, span: tuple | None, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (t, y) of a curve within `span`, lows and highs of intervals where there are more samples than `most`."""
    t = c.t0 + c.dt * np.arange(len(c.y))
    y = np.asarray(c.y, float)
    if span is not None:
        on = (t >= span[0]) & (t <= span[1])
        t, y = t[on], y[on]
    kept, step = envelope(y, most)
    return t[0] + c.dt * step * np.arange(len(kept)), kept


def _limits(p: Panel, values: list[np.ndarray]) -> tuple[float, float]:
    if p.limits:
        return p.limits
    y = np.concatenate([*(v[np.isfinite(v)] for v in values), np.array(p.levels, float)])
    low, high = (float(y.min()), float(y.max())) if len(y) else (-1.0, 1.0)
    if p.least:
        low, high = min(low, -p.least), max(high, p.least)
    room = 0.05 * (high - low) or 1.0
    return low - room, high + room


def _ticks(low: float, high: float) -> list[float]:
    """Return three to six round values between `low` and `high`."""
    step = 10.0 ** math.floor(math.log10((high - low) / 3.0))
    step *= next(k for k in (5.0, 2.0, 1.0) if (high - low) / (k * step) >= 2.5)
    first = math.ceil(low / step - 1e-9)
    return [round(step * k, 12) for k in range(first, math.floor(high / step + 1e-9) + 1)]


def _lines(x: Any, y: Any, known: np.ndarray) -> list[str]:
    """Return the points of a polyline, one for each stretch without a gap."""
    out, part = [], []
    for px, py, good in zip(x, y, known, strict=True):
        if good:
            part.append(f"{px:.1f},{py:.1f}")
        elif part:
            out.append(" ".join(part))
            part = []
    return [*out, " ".join(part)] if part else out
