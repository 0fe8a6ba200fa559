"""Maps of seen oscillations over achieved amplitude and frequency, one panel per detector."""

import math

import numpy as np
import pandas as pd

from cosim.report.figure import Figure, axis, base, grid, note, points

MANY = 150  # oscillations per detector from which on a map shows shares of cells instead of single flights
CELLS = 6


def maps(rows: pd.DataFrame, thresholds: dict | None = None) -> Figure | None:
    """Return the maps of seen oscillations over achieved amplitude and frequency, one panel per detector.

    As shipped, or with `thresholds` {detector: (multiplier, ...)} for the same false-alarm probability.
    """
    ofc = rows[rows["frequency_hz"].notna() & rows["amplitude_mm"].notna() & rows["concerned"]]
    names = [n for n in rows["id"].unique() if (ofc["id"] == n).any()]
    if not names:
        return None
    equal = thresholds is not None
    columns = min(4, len(names))
    figure = Figure("maps-equal" if equal else "maps", "", 74 + 210 * -(-len(names) // columns), time=False)
    figure.layout = base(figure.height, legend=not equal) | {"hovermode": "closest"}
    grid(figure.layout, names, ["mm" if i % columns == 0 else "" for i in range(len(names))], columns, time=False)
    low, high = ofc["amplitude_mm"].min() / 1.5, ofc["amplitude_mm"].max() * 1.5
    for i, name in enumerate(names, 1):
        own = ofc[ofc["id"] == name]
        seen = own["detected"] if not equal else _crossed(own, (thresholds or {}).get(name))
        figure.layout[axis("xaxis", i)] |= {"type": "log", **_ticks(sorted(own["frequency_hz"].unique()))}
        figure.layout[axis("yaxis", i)] |= {
            "type": "log",
            "range": [math.log10(low), math.log10(high)],
            **_decades(low, high),
        }
        if i + columns > len(names):
            figure.layout[axis("xaxis", i)]["title"]["text"] = "Hz"
        if own["not_valid"].all():
            note(figure.layout, i, "not valid in any of these")
        (_cells if len(own) >= MANY else _points)(figure, i, own, seen.astype(bool))
    figure.layout["legend"]["y"] = 1.04
    return figure


def _crossed(own, threshold):
    if threshold is None or threshold[0] is None:
        return own["detected"] & False
    return own["r_fault"] >= threshold[0]


def _ticks(values):
    shown = values if len(values) <= 8 else [0.5, 1.0, 2.0, 5.0, 10.0]
    pad = 1.25
    return {
        "tickvals": shown,
        "ticktext": [f"{v:g}" for v in shown],
        "range": [math.log10(values[0] / pad), math.log10(values[-1] * pad)],
    }


def _decades(low, high):
    shown = [v * 10.0**e for e in range(-3, 4) for v in (1, 2, 5) if low <= v * 10.0**e <= high]
    shown = shown if len(shown) <= 6 else [v for v in shown if abs(math.log10(v) % 1.0) < 1e-6]
    return {"tickvals": shown, "ticktext": [f"{v:g}" for v in shown]}


def _points(figure, panel, own, seen):
    """Draw every flight: filled where it was seen, a cross where not; faults of several segments beside."""
    side = own["target"].str.endswith(("left", "right", "all"))
    named = {trace.get("name") for trace in figure.data}
    for mask, symbol, colour, name in (
        (seen, "circle", "--blue", "seen"),
        (~seen, "x-thin-open", "--fault", "not seen"),
    ):
        part, wide = own[mask], side[mask]
        if not len(part):
            continue
        marks = ["diamond" if w and symbol == "circle" else symbol for w in wide]
        told = [
            [f"{r['frequency_hz']:g} Hz, {r['target']}",
             "not seen" if not r["detected"] else f"{r['delay_s']:.2f} s, {r['isolated_class']}"]
            for _, r in part.iterrows()
        ]  # fmt: skip
        figure.data.append(
            points(
                panel, x=(part["frequency_hz"] * np.where(wide, 1.13, 1.0)).tolist(), y=part["amplitude_mm"].tolist(),
                name=name, legendgroup=name, showlegend=name not in named, customdata=told,
                marker={"symbol": marks or symbol, "size": 9, "color": colour, "line": {"width": 2, "color": colour}},
                hover="%{y:.2f} mm achieved<br>%{customdata[0]}<br>%{customdata[1]}<extra></extra>",
            )
        )  # fmt: skip


def _cells(figure, panel, own, seen):
    """Draw the share of flights seen per cell of frequency and amplitude, with their number."""
    f, a = np.log10(own["frequency_hz"].to_numpy()), np.log10(own["amplitude_mm"].to_numpy())
    fe, ae = (np.linspace(v.min(), v.max() + 1e-9, CELLS + 1) for v in (f, a))
    n, *_ = np.histogram2d(a, f, bins=(ae, fe))
    k, *_ = np.histogram2d(a[seen], f[seen], bins=(ae, fe))
    share = np.where(n > 0, k / np.maximum(n, 1), np.nan)
    text = [[f"{int(k[i, j])}/{int(n[i, j])}" if n[i, j] else "" for j in range(CELLS)] for i in range(CELLS)]
    centre = lambda e: (10.0 ** ((e[1:] + e[:-1]) / 2)).tolist()  # noqa: E731
    shown = [[None if math.isnan(v) else float(v) for v in row] for row in share]
    figure.data.append(
        points(
            panel, type="heatmap", x=centre(fe), y=centre(ae), z=shown, text=text, texttemplate="%{text}",
            textfont={"size": 9}, zmin=0, zmax=1, colorscale="Cividis", showscale=False,
            hover="%{x:.2g} Hz, %{y:.2g} mm: seen in %{text} flights<extra></extra>",
        )
    )  # fmt: skip
