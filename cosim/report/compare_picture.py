"""A small still picture of who sees an oscillation, as SVG: what a README can show."""

import numpy as np
import pandas as pd

from cosim.compare import stats
from cosim.report import svg
from cosim.report.figure import axis, still

COLUMNS = 4
LEAST = -3  # octaves of a mm: what achieves less, a signal in place of a drive that hardly moves, is in that row
TITLE = f"share of flights seen, every detector at the threshold that {stats.ALPHA:.0%} of fault-free flights cross"


def render(rows: pd.DataFrame, thresholds: dict) -> str:
    """Return the SVG text: share of oscillations seen over achieved amplitude and frequency, a panel per detector.

    `rows` as of cosim/compare/rows.py; `thresholds` of compare_stats.equal_thresholds set all detectors to the same
    run-level false-alarm probability; one that never judged there sees nothing.
    """
    ofc = rows[rows["frequency_hz"].notna() & (rows["amplitude_mm"] > 0.0) & rows["concerned"]]
    names = {n: ofc[ofc["id"] == n] for n in rows["id"].unique() if (ofc["id"] == n).any()}
    octave = np.round(np.log2(ofc["amplitude_mm"])).astype(int).clip(lower=LEAST)
    sizes = range(octave.min(), octave.max() + 1) if len(ofc) else ()
    told = [f"{'≤ ' * (k == LEAST)}{2.0**k:.2g}" for k in sizes]
    hz = sorted(ofc["frequency_hz"].unique())
    figure = still("seen", TITLE, 60 + 200 * -(-len(names) // COLUMNS))
    draws_on = [f"{name}: {stats.draws_on(name, own['level'].iloc[0])}" for name, own in names.items()]
    figure.grid(draws_on, "achieved, mm of rod", COLUMNS, x_title="frequency, Hz", gap=0.055)
    for panel, (name, own) in enumerate(names.items(), 1):
        limit = thresholds.get(name, (None,))[0]
        seen = own["r_fault"] >= limit if limit is not None else own["detected"] & False
        each = seen.astype(int).groupby([octave[own.index], own["frequency_hz"]])
        counts = (x.unstack().reindex(index=sizes, columns=hz) for x in (each.size(), each.sum()))
        n, hit = (x.fillna(0).to_numpy(int) for x in counts)
        text = [[f"{k}/{of}" if of else "" for k, of in zip(*row)] for row in zip(hit, n)]
        for key, marks in (("xaxis", [f"{v:g}" for v in hz]), ("yaxis", told)):
            about = {"type": "category", "categoryarray": marks, "range": [-0.5, len(marks) - 0.5]}
            figure.layout[axis(key, panel)] |= about
        figure.points(panel, type="heatmap", x=[f"{v:g}" for v in hz], y=told, z=hit / np.maximum(n, 1), text=text)
    return svg.still(figure, TITLE)
