"""Figures of a comparison: delays, faults against false alarms, shares seen over amplitude and frequency."""

import numpy as np
import pandas as pd

from cosim.compare import stats
from cosim.judge.coverage import DESIGNED
from cosim.report.figure import (
    COLOURS,
    DASHES,
    Figure,
    axis,
    log_axis,
    packed,
    still,
    style_axis,
)

LEAST = -3  # octaves of a mm: what achieves less hardly moves the rod, and is in that row


def _beside(name, caption, height):
    """Return a figure of curves with its legend to the right of the panels."""
    figure = still(name, caption, height, True)
    at = {"orientation": "v", "x": 1.02, "xanchor": "left", "y": 1.0, "yanchor": "top", "tracegroupgap": 0}
    figure.layout["legend"] |= at
    figure.layout["margin"]["r"] = 175
    return figure


def _curve(j, name, showlegend=True, **line):
    """Return name and look of the curve of detector number `j`."""
    line |= {"width": 2, "color": COLOURS[j % 8], "dash": DASHES[j // 8]}
    return {"name": name, "legendgroup": name, "line": line, "showlegend": showlegend}


def delays(rows: pd.DataFrame) -> Figure | None:
    """Return the share of designed-for faults that each detector had noticed so long after the onset, or None without
    such a fault."""
    own = rows[(rows["word"] == DESIGNED) & rows["concerned"] & ~rows["not_valid"]]
    if own.empty:
        return None
    swings = own["frequency_hz"].notna().any()
    figure = _beside("delays", "A curve ends at the share that was seen at all: missed faults stay in the count.", 330)
    titles = ["All faults it was designed for", "Oscillations, in periods of the fault"][: 1 + swings]
    figure.grid(titles, "share noticed", 1 + swings, x_title="")
    for i, unit in ((1, "seconds after the onset"), (2, "periods after the onset"))[: 1 + swings]:
        figure.layout[axis("yaxis", i)] |= {"range": [0.0, 1.03], "tickformat": ".0%"}
        figure.layout[axis("xaxis", i)] |= log_axis(0.01, 100.0)
        figure.layout[axis("xaxis", i)]["title"]["text"] = unit
    for j, name in enumerate(rows["id"].unique()):
        for i, column in ((1, "delay_s"), (2, "delay_periods")):
            part = own[own["id"] == name]
            part = part if i == 1 else part[part["frequency_hz"].notna()]
            if len(part):
                d = np.sort(part[column].dropna().to_numpy())
                x = np.concatenate([[0.01], np.maximum(d, 0.01), [100.0]])
                y = np.concatenate([[0.0], np.arange(1, len(d) + 1), [len(d)]]) / len(part)
                figure.points(
                    i, mode="lines", x=packed(x), y=packed(y), detector=name,
                    hover=f"{name}: %{{y:.0%}} by %{{x:.2g}}<extra></extra>", **_curve(j, name, i == 1, shape="hv"),
                )  # fmt: skip
    return figure


def roc(rows: pd.DataFrame, each: list[dict]) -> Figure | None:
    """Return the operating curves of all detectors: faults seen against false alarms, by run-level maxima, and what
    `each` came to with its alarms as shipped; None where no detector has both."""
    figure = _beside(
        "roc",
        "Dots: alarms as shipped. Curves: the largest |r| of each flight at every threshold, before confirmation and "
        "in flights in which the detector was valid: a dot need not be on its curve. With n fault-free flights nothing "
        "left of 1/n can be told apart.",
        360,
    )
    shown = {"range": [-0.03, 1.03], "tickformat": ".0%"}
    figure.layout["xaxis"] = style_axis("share of fault-free flights with an alarm", **shown)
    figure.layout["yaxis"] = style_axis("share of designed-for faults seen", **shown)
    shipped = {d["id"]: (d["false_alarm_probability"], d["detection_probability"]) for d in each}
    for j, (name, curve) in enumerate(stats.operating_points(rows).groupby("detector", sort=False)):
        figure.points(
            1, mode="lines", x=packed(curve["false_alarm"].to_numpy()), y=packed(curve["detection"].to_numpy()),
            detector=name, hover=f"{name}<br>%{{y:.0%}} of faults at %{{x:.0%}}<extra></extra>", **_curve(j, name),
        )  # fmt: skip
        figure.points(
            1, x=[shipped[name][0]], y=[shipped[name][1]], detector=name,
            marker={"size": 9, "color": COLOURS[j % 8]}, hover=f"{name} as shipped<extra></extra>",
        )  # fmt: skip
    return figure if figure.data else None


def maps(rows: pd.DataFrame) -> Figure | None:
    """Return the flights seen of those flown over achieved amplitude, in octaves, and frequency, a panel per detector;
    None without an oscillation."""
    ofc = rows[rows["frequency_hz"].notna() & (rows["amplitude_mm"] > 0.0) & rows["concerned"]]
    names = [n for n in rows["id"].unique() if (ofc["id"] == n).any()]
    if not names:
        return None
    octave = np.round(np.log2(ofc["amplitude_mm"])).astype(int).clip(lower=LEAST)
    hz, sizes = stats.bands(ofc["frequency_hz"]), range(octave.min(), octave.max() + 1)
    columns, shown = min(3, len(names)), sorted(hz.unique())
    x, y = [f"{f:g}" for f in shown], [f"{'≤ ' * (k == LEAST)}{2.0**k:.2g}" for k in sizes]
    told = ("Flights seen of flights flown, alarms as shipped, over frequency and amplitude achieved at the rod (in "
            "octaves; against the same flight without the fault).")  # fmt: skip
    height = 60 + (24 * len(sizes) + 52) * -(-len(names) // columns)
    figure = still("maps", told, height, width=220 * columns)
    figure.grid(names, "achieved, mm of rod", columns, x_title="Hz")
    for i, name in enumerate(names, 1):
        seen = ofc.loc[ofc["id"] == name, "detected"].astype(int)
        cells = seen.groupby([octave[seen.index], hz[seen.index]])
        n, k = (v.unstack().reindex(index=sizes, columns=shown).fillna(0).to_numpy(int)
                for v in (cells.size(), cells.sum()))  # fmt: skip
        for key, marks in (("xaxis", x), ("yaxis", y)):
            about = {"type": "category", "categoryarray": marks, "range": [-0.5, len(marks) - 0.5]}
            figure.layout[axis(key, i)] |= about
        text = [[f"{a}/{b}" if b else "" for a, b in zip(*row)] for row in zip(k, n)]
        share = [[a / b if b else None for a, b in zip(*row)] for row in zip(k.tolist(), n.tolist())]
        figure.points(
            i, type="heatmap", x=x, y=y, z=share, text=text, texttemplate="%{text}", textfont={"size": 9}, zmin=0,
            zmax=1, colorscale="Cividis", showscale=False, hover="%{x} Hz, %{y} mm: %{text} flights<extra></extra>",
        )  # fmt: skip
    return figure
