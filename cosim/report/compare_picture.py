"""A small still picture of who sees an oscillation, as SVG: what a README can show."""

import numpy as np
import pandas as pd
from markupsafe import escape

from cosim.compare import stats

# cividis (Nunez, Anderton, Renslow 2018) at eighths: read alike with and without colour vision
STOPS = ("#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#fee838")
COLUMNS = 4
WIDE, HIGH, GAP_X, GAP_Y, LEFT, TOP = 196, 150, 14, 46, 46, 58  # panel, between panels, to the first one [px]
MUTED = "#59636e"
LEAST = -3  # octaves of a mm: what achieves less, a signal in place of a drive that hardly moves, is in that row


def render(rows: pd.DataFrame, thresholds: dict) -> str:
    """Return the SVG text: share of oscillations seen over achieved amplitude and frequency, a panel per detector.

    `rows` as of cosim/compare/rows.py; `thresholds` of compare_stats.equal_thresholds set all detectors to the same
    run-level false-alarm probability; one that never judged there sees nothing.
    """
    ofc = rows[rows["frequency_hz"].notna() & (rows["amplitude_mm"] > 0.0) & rows["concerned"]]
    names = [n for n in rows["id"].unique() if (ofc["id"] == n).any()]
    hz = sorted(ofc["frequency_hz"].unique())
    bins = np.round(np.log2(ofc["amplitude_mm"])).astype(int).clip(lower=LEAST)
    low, high = (int(bins.min()), int(bins.max())) if len(bins) else (LEAST, LEAST)
    lines = -(-len(names) // COLUMNS)
    width = LEFT + COLUMNS * WIDE + (COLUMNS - 1) * GAP_X + 10
    height = TOP + lines * (HIGH + GAP_Y) - GAP_Y + 38
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        'font-family="system-ui,Segoe UI,Roboto,Liberation Sans,sans-serif" font-size="11" fill="#1c2128">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        *_key(),
    ]
    for i, name in enumerate(names):
        own = ofc[ofc["id"] == name]
        limit = thresholds.get(name, (None,))[0]
        seen = (own["r_fault"] >= limit).to_numpy(bool) if limit is not None else np.zeros(len(own), bool)
        x, y = LEFT + i % COLUMNS * (WIDE + GAP_X), TOP + i // COLUMNS * (HIGH + GAP_Y)
        draws_on = stats.draws_on(name, own["level"].iloc[0])
        out += [
            f'<text x="{x}" y="{y - 16}" font-weight="600">{escape(name)}</text>',
            f'<text x="{x}" y="{y - 4}" fill="{MUTED}" font-size="10">{escape(draws_on)}</text>',
            *_panel(own["frequency_hz"].to_numpy(), bins[own.index].to_numpy(), seen, hz, (low, high), x, y),
        ]
        if i % COLUMNS == 0:
            out += _amplitudes(low, high, x, y)
    out.append(f'<text x="{width / 2}" y="{height - 6}" text-anchor="middle" fill="{MUTED}">frequency, Hz</text></svg>')
    return "\n".join(out) + "\n"


def _panel(f, a, seen, hz, ends, x0, y0):
    """Draw the cells of one detector with how many of how many flights were seen."""
    low, high = ends
    w, h = WIDE / len(hz), HIGH / (high - low + 1)
    out = [f'<rect x="{x0}" y="{y0}" width="{WIDE}" height="{HIGH}" fill="#eef0f3"/>']
    for i, v in enumerate(hz):
        x = x0 + i * w
        out.append(f'<text x="{x + w / 2:.1f}" y="{y0 + HIGH + 13}" text-anchor="middle" fill="{MUTED}">{v:g}</text>')
        for k in range(low, high + 1):
            here = (f == v) & (a == k)
            n, hit = int(here.sum()), int((here & seen).sum())
            if not n:
                continue
            y = y0 + (high - k) * h
            dark, box = hit / n < 0.5, f'width="{w - 0.7:.1f}" height="{h - 0.7:.1f}"'
            out.append(
                f'<rect x="{x:.1f}" y="{y:.1f}" {box} fill="{_colour(hit / n)}"/>'
                f'<text x="{x + w / 2:.1f}" y="{y + h / 2 + 3:.1f}" text-anchor="middle" font-size="8" '
                f'fill="{"#fff" if dark else "#1c2128"}">{hit}/{n}</text>'
            )
    return out


def _amplitudes(low, high, x0, y0):
    h = HIGH / (high - low + 1)
    out = [
        f'<text x="{x0 - 5}" y="{y0 + (high - k + 0.5) * h + 4:.1f}" text-anchor="end" fill="{MUTED}">'
        f"{'≤ ' * (k == LEAST)}{2.0**k:.2g}</text>"
        for k in range(low, high + 1)
    ]
    out.append(
        f'<text transform="translate({x0 - 35} {y0 + HIGH / 2}) rotate(-90)" text-anchor="middle" fill="{MUTED}">'
        "achieved, mm of rod</text>"
    )
    return out


def _key():
    """Draw what the colours mean."""
    out = [f'<text x="{LEFT}" y="18" fill="{MUTED}">share of flights seen: 0</text>']
    x, each = LEFT + 128, 8
    for i in range(2 * len(STOPS)):
        at = (i + 0.5) / (2 * len(STOPS))
        out.append(f'<rect x="{x + i * each}" y="8" width="{each + 0.3}" height="12" fill="{_colour(at)}"/>')
    x += 2 * len(STOPS) * each + 6
    words = f"1, every detector at the threshold that {stats.ALPHA:.0%} of fault-free flights cross"
    out.append(f'<text x="{x}" y="18" fill="{MUTED}">{words}</text>')
    return out


def _colour(share):
    """Return the colour at `share` 0..1 of STOPS, in 32 steps."""
    at = min(max(round(share * 32) / 32, 0.0), 1.0) * (len(STOPS) - 1)
    i = min(int(at), len(STOPS) - 2)
    low, high = ([int(STOPS[k][j : j + 2], 16) for j in (1, 3, 5)] for k in (i, i + 1))
    return "#" + "".join(f"{round(a + (at - i) * (b - a)):02x}" for a, b in zip(low, high))
