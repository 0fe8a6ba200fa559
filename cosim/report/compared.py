"""Figures of a comparison: maps over amplitude and frequency, delays, false alarms, threshold sweeps, cost."""

import math

import numpy as np
import pandas as pd

from cosim.compare import metrics, stats
from cosim.judge.coverage import DESIGNED
from cosim.replay.recording import finite
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


def _named(names):
    """Return what makes an axis one of names, the first at the top."""
    return {"type": "category", "categoryarray": names[::-1], "tickfont": {"size": 11, "color": "--ink"}}


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


def false_alarms(found: list[dict]) -> Figure:
    """Return false alarms per fault-free flight and per hour of all flights, with exact bounds."""
    names = [d["id"] for d in found]
    figure = still(
        "false-alarms",
        "Bars: exact 95 % bounds (Clopper and Pearson; Poisson for the rate). Left: share of fault-free "
        "flights with an alarm. Right: "
        "false alarms per hour in which one would count: valid, without a fault that concerns it.",
        70 + 22 * len(names),
    )
    figure.layout["margin"]["l"] = 150
    figure.grid(["Fault-free flights with an alarm", "False alarms per valid hour"], "", 2, x_title="")
    for i in (1, 2):
        figure.layout[axis("yaxis", i)] |= _named(names) | {"showticklabels": i == 1}
    figure.layout["xaxis"] |= {"range": [-0.02, 1.02], "tickformat": ".0%"}
    rates = [d["false_alarms_per_hour_high"] for d in found if finite(d["false_alarms_per_hour_high"])]
    floor = min([0.5, *(d["false_alarms_per_hour"] / 2 for d in found if d["false_alarms_per_hour"] > 0.0)])
    figure.layout["xaxis2"] |= log_axis(floor, max([10.0, *rates]) * 1.3)
    for d in found:
        for i, key, told in (
            (1, "false_alarm", f"{d['fault_free_alarmed']} of {d['fault_free_runs']}"),
            (2, "false_alarms_per_hour", f"{d['false_alarms']} alarms"),
        ):
            p, low, high = d["false_alarm_probability" if i == 1 else key], d[f"{key}_low"], d[f"{key}_high"]
            if math.isnan(p) or math.isinf(high):
                continue
            none = i == 2 and not p  # a logarithm has no zero: an open triangle at the edge
            at = floor if none else p
            bar = {"type": "data", "symmetric": False, "color": "--muted", "thickness": 1.4, "width": 4}
            bar |= {"array": [high - at], "arrayminus": [max(0.0, at - max(low, floor if i == 2 else 0.0))]}
            symbol = "triangle-left-open" if none else "circle"
            figure.points(
                i, x=[at], y=[d["id"]], cliponaxis=False, error_x=bar,
                marker={"size": 8, "color": "--fault" if p else "--blue", "symbol": symbol},
                hover=f"{d['id']}: {told}, {p:.3g} ({low:.3g} to {high:.3g})<extra></extra>",
            )  # fmt: skip
    return figure


def sweeps(rows: pd.DataFrame) -> Figure:
    """Return, per detector, the shares of faulty and fault-free flights whose largest |r| reaches each threshold."""
    found, c = stats.maxima(rows), np.geomspace(0.03, 100.0, 61)
    names, columns = list(found), min(4, len(found))
    figure = still(
        "sweeps",
        "Blue: share of the faults it was designed for whose largest |r| reaches this multiple of the shipped "
        "threshold; dotted: the same of "
        "fault-free flights. The further apart, the better it separates; the vertical line is the threshold as "
        "shipped. Before confirmation.",
        74 + 180 * -(-len(names) // columns),
        hovermode="x unified",
    )
    figure.grid(names, "share", columns, x_title="threshold × ")
    for i, name in enumerate(names, 1):
        free, hit = (metrics.beyond(x, c) for x in found[name])
        figure.layout[axis("xaxis", i)] |= log_axis(c[0], c[-1])
        figure.layout[axis("yaxis", i)] |= {"range": [-0.04, 1.04], "tickformat": ".0%", "tickvals": [0, 0.5, 1]}
        figure.upright(i, 1, color="--muted", width=1)
        for y, colour, dash, told in ((hit, "--blue", "solid", "faults"), (free, "--fault", "dot", "fault-free")):
            if not np.isnan(y).all():
                line = {"color": colour, "dash": dash, "width": 2, "shape": "hv"}
                hover = "%{y:.0%}"
                figure.points(i, mode="lines", x=packed(c), y=packed(y), name=told, line=line, hover=hover)
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
    for j, (name, (healthy, faulty)) in enumerate(stats.maxima(rows).items()):
        if not len(healthy) or not len(faulty):
            continue
        curve = metrics.roc(healthy, faulty)
        figure.points(
            1, mode="lines", x=packed(curve.false_alarm), y=packed(curve.detection), detector=name,
            hover=f"{name}<br>%{{y:.0%}} of faults at %{{x:.0%}}<extra></extra>", **_curve(j, name),
        )  # fmt: skip
        figure.points(
            1, x=[shipped[name][0]], y=[shipped[name][1]], detector=name,
            marker={"size": 9, "color": COLOURS[j % 8]}, hover=f"{name} as shipped<extra></extra>",
        )  # fmt: skip
    return figure if figure.data else None


def cost(found: list[dict]) -> Figure | None:
    """Return microseconds per step and lane of each detector, or None when nobody measured them."""
    timed = [d for d in found if d["step_us"] is not None and not math.isnan(d["step_us"])]
    if not timed:
        return None
    told = "Per step and lane, one core, live calls: 200 steps per second are flown."
    figure = still("cost", told, 60 + 22 * len(timed))
    figure.layout["margin"] |= {"l": 150, "t": 8}
    figure.layout["xaxis"] = style_axis("µs", rangemode="tozero")
    figure.layout["yaxis"] = style_axis() | _named([d["id"] for d in timed])
    for d in timed:
        figure.points(
            1, type="bar", orientation="h", x=[d["step_us"]], y=[d["id"]], marker={"color": "--blue"},
            text=[f"{d['step_us']:.2f}"], textposition="outside", cliponaxis=False, detector=d["id"],
            hover="%{x:.2f} µs<extra></extra>",
        )  # fmt: skip
    return figure


MANY = 150  # oscillations per detector from which on a map shows shares of cells instead of single flights
CELLS = 6


def maps(rows: pd.DataFrame, thresholds: dict | None = None) -> Figure | None:
    """Return the maps of seen oscillations over achieved amplitude and frequency, one panel per detector. As shipped,
    or with `thresholds` {detector: (multiplier, ...)} for the same false-alarm probability."""
    ofc = rows[rows["frequency_hz"].notna() & rows["amplitude_mm"].notna() & rows["concerned"]]
    names = [n for n in rows["id"].unique() if (ofc["id"] == n).any()]
    if not names:
        return None
    equal = thresholds is not None
    columns = min(4, len(names))
    figure = still("maps-equal" if equal else "maps", "", 74 + 210 * -(-len(names) // columns), not equal)
    figure.grid(names, "mm", columns, x_title="Hz")
    low, high = ofc["amplitude_mm"].min() / 1.5, ofc["amplitude_mm"].max() * 1.5
    for i, name in enumerate(names, 1):
        own = ofc[ofc["id"] == name]
        seen = own["detected"]
        if equal:
            limit = (thresholds or {}).get(name, (None,))[0]
            seen = own["detected"] & False if limit is None else own["r_fault"] >= limit
        figure.layout[axis("xaxis", i)] |= {"type": "log", **_ticks(sorted(own["frequency_hz"].unique()))}
        figure.layout[axis("yaxis", i)] |= _fine(low, high)
        if own["not_valid"].all():
            figure.note(i, "not valid in any of these")
        (_cells if len(own) >= MANY else _points)(figure, i, own, seen.astype(bool))
    figure.layout["legend"]["y"] = 1.04
    return figure


def _ticks(values):
    shown = values if len(values) <= 8 else [0.5, 1.0, 2.0, 5.0, 10.0]
    pad = 1.25
    return {
        "tickvals": shown,
        "ticktext": [f"{v:g}" for v in shown],
        "range": [math.log10(values[0] / pad), math.log10(values[-1] * pad)],
    }


def _fine(low, high):
    made = log_axis(low, high, (1, 2, 5))
    return made if len(made["tickvals"]) <= 6 else log_axis(low, high)


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
        figure.points(
            panel, x=(part["frequency_hz"] * np.where(wide, 1.13, 1.0)).tolist(), y=part["amplitude_mm"].tolist(),
            name=name, legendgroup=name, showlegend=name not in named, customdata=told,
            marker={"symbol": marks or symbol, "size": 9, "color": colour, "line": {"width": 2, "color": colour}},
            hover="%{y:.2f} mm achieved<br>%{customdata[0]}<br>%{customdata[1]}<extra></extra>",
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
    figure.points(
        panel, type="heatmap", x=centre(fe), y=centre(ae), z=shown, text=text, texttemplate="%{text}",
        textfont={"size": 9}, zmin=0, zmax=1, colorscale="Cividis", showscale=False,
        hover="%{x:.2g} Hz, %{y:.2g} mm: seen in %{text} flights<extra></extra>",
    )  # fmt: skip
