"""Curves of a comparison as frames, with bounds, and as figures for a paper (matplotlib, the extra `plot`)."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from cosim.compare import metrics, pod, stats
from cosim.errors import CosimError, did_you_mean

WIDTH_IN = 3.5  # of a column of the usual journals
LINE_IN = 0.13  # of the legend, below the axes
COLUMNS = 75  # characters of such a line
POINTS = 60  # of a fitted curve
ROC_TOLD = (
    "Dot: alarms as shipped, bars its exact 95 % interval. Curve: largest |r| of each flight at every threshold, "
    "before confirmation and in flights in which the detector was valid: the dot need not be on it. Band: exact 95 %."
)
POD_TOLD = "Band: each bound with 95 % confidence. Dashed: 90 %."
ROC = ("detector", "threshold", "false_alarm", "false_alarm_low", "false_alarm_high", "detection", "detection_low",
       "detection_high", "fault_free_flights", "faults")  # fmt: skip
POD = ("family", "of", "frequency_hz", "amplitude_mm", "pod", "low", "high", "flights", "seen", "a90", "a90_95", "note")
LOOKS = {  # figure -> x, y, its bounds, labels of the axes
    "roc": ("false_alarm", "detection", ("detection_low", "detection_high"),
            "share of fault-free flights with an alarm", "share of designed-for faults seen"),
    "pod": ("amplitude_mm", "pod", ("low", "high"), "achieved amplitude, mm of rod", "probability of detection"),
}  # fmt: skip


def roc(rows: pd.DataFrame, detectors: Sequence[str] = ()) -> pd.DataFrame:
    """Return the operating points of `detectors` (default: all) as a frame, columns ROC: a row per threshold.

    By the largest |r| of each flight, before confirmation; threshold 1 is as shipped. false_alarm: share of fault-free
    flights that reach it, detection: of the faults it was designed for; each with its exact 95 % interval (Clopper and
    Pearson). Raises CosimError where no fault-free or no faulty flight was flown: a ROC needs both.
    """
    out: list[dict] = []
    for name, (healthy, faulty) in stats.maxima(rows[rows["id"].isin(_known(rows, detectors))]).items():
        if not len(healthy) or not len(faulty):
            continue
        for c in np.unique([*metrics.roc(healthy, faulty).threshold, 1.0])[::-1]:
            ends = [metrics.proportion(int(np.sum(x >= c)), len(x)) for x in (healthy, faulty)]
            out.append(dict(zip(ROC, (name, c, *ends[0], *ends[1], len(healthy), len(faulty)))))
    if not out:
        told = "has no detector with both fault-free flights and faults that it was designed for"
        raise CosimError(told, place="roc", remedy="Fly both: [[part]] in a campaign (cosim/campaign/README.md)")
    return pd.DataFrame(out, columns=list(ROC))


def curves(rows: pd.DataFrame, each: list[dict], detectors: Sequence[str] = ()) -> pd.DataFrame:
    """Return the fitted curves as a frame, columns POD: probability of detection over the achieved amplitude [mm of
    rod], `low` and `high` each with 95 % confidence, of each level or of `detectors`: there a flight in which it was
    not valid counts as missed. A cell without a curve has one row, whose `note` says why."""
    if detectors:
        own = rows[rows["id"].isin(_known(rows, detectors)) & rows["concerned"]]
        own = own.assign(group=own["id"], seen=own["detected"], able=True)
    else:
        own = stats.by_group(rows, each)
    out = []
    for (family, of, hz), part in stats.cells(own[own["able"]]):
        f = pod.fit(part["amplitude_mm"], part["seen"])
        about = {"family": family, "of": of, "frequency_hz": float(hz), "flights": f.n,
                 "seen": f.seen, "a90": f.a90, "a90_95": f.a90_95, "note": f.note}  # fmt: skip
        at = np.geomspace(part["amplitude_mm"].min(), part["amplitude_mm"].max(), POINTS)
        points = zip(at, *f.at(at)) if f.coefficients else [()]
        out += [about | dict(zip(("amplitude_mm", "pod", "low", "high"), row)) for row in points]
    return pd.DataFrame(out, columns=list(POD))


def figure(kind: str, rows: pd.DataFrame, each: list[dict], detectors: Sequence[str] = ()) -> Any:
    """Return the matplotlib Figure of "roc" or "pod", one column wide, with bounds; `savefig("x.pdf")` writes vectors.
    Raises CosimError for another kind, without matplotlib, where there is no curve, and as `roc`."""
    if kind not in LOOKS:
        raise CosimError(f"unknown figure {kind!r}", allowed=", ".join(LOOKS), remedy=did_you_mean(kind, LOOKS))
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise CosimError("figures need matplotlib", remedy="pip install 'cosim-fdi[plot]'") from None
    found, told = _roc(rows, detectors) if kind == "roc" else _pod(curves(rows, each, detectors))
    made = Figure(figsize=(WIDTH_IN, 0.8 * WIDTH_IN), layout="constrained")
    axes, (x, y, bounds, x_label, y_label) = made.subplots(), LOOKS[kind]
    drawn = found.groupby("label", sort=False)
    step: Any = "post" if kind == "roc" else None
    for width, (label, own) in zip(np.linspace(min(1.0 + 0.5 * (len(drawn) - 1), 4.0), 1.0, len(drawn)), drawn):
        low, high = (own[name] for name in bounds)  # a falling width: of curves that are the same all are seen
        (line,) = axes.plot(own[x], own[y], drawstyle=f"steps-{step}" if step else "default", linewidth=width,
                            label=label, clip_on=False)  # fmt: skip
        axes.fill_between(own[x], low, high, step=step, alpha=0.12, color=line.get_color(), linewidth=0)
        for d in (d for d in each if kind == "roc" and d["id"] == label):
            _dot(axes, d, line.get_color())
    axes.set(ylim=(-0.05, 1.05), **({"xlim": (-0.05, 1.05)} if kind == "roc" else {"xscale": "log"}))
    if kind == "pod":
        axes.axhline(0.9, color="0.5", linewidth=0.6, linestyle="--")
        low, high = found[x].min(), found[x].max()
        ticks = [m * 10.0**k for k in range(-4, 4) for m in (1, 2, 5) if low <= m * 10.0**k <= high]
        axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
        axes.set_xticks([], minor=True)
    axes.set_xlabel(x_label, fontsize=7)
    axes.set_ylabel(y_label, fontsize=7)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3, linewidth=0.4)
    title = textwrap.fill(told, COLUMNS)
    made.legend(loc="outside lower center", ncols=2, fontsize=6, frameon=False, title=title, title_fontsize=6,
                alignment="left")  # fmt: skip
    made.set_size_inches(WIDTH_IN, 0.8 * WIDTH_IN + LINE_IN * (-(-len(drawn) // 2) + title.count("\n") + 1))
    return made


def _roc(rows, detectors):
    return roc(rows, detectors).assign(label=lambda frame: frame["detector"]), ROC_TOLD


def _pod(every):
    """Return (curves with a label, what the legend says): also who has no curve, and why."""
    kinds = every["family"].unique()
    label = every["of"] + ", " + ("" if len(kinds) == 1 else every["family"] + ", ")
    every = every.assign(label=label + every["frequency_hz"].map("{:g} Hz".format))
    found, without = every.dropna(subset=["pod"]), every[every["pod"].isna()]
    if found.empty:
        remedy = "More flights, over a range of amplitudes at each frequency; `pod()` says what is missing where"
        raise CosimError("too few flights for a curve of detection over size", remedy=remedy)
    why = "; ".join(without["label"] + ": " + without["note"])
    return found, f"{f'{kinds[0]}. ' if len(kinds) == 1 else ''}{POD_TOLD}{f' No curve (mm): {why}' if why else ''}"


def _dot(axes, d, colour):
    """Draw where the alarms of a detector are as shipped."""
    x, y = d["false_alarm_probability"], d["detection_probability"]
    x_span = [x - d["false_alarm_low"]], [d["false_alarm_high"] - x]
    y_span = [y - d["detection_low"]], [d["detection_high"] - y]
    axes.errorbar([x], [y], xerr=x_span, yerr=y_span, fmt="o", markersize=3, linewidth=0.7, color=colour)


def _known(rows, detectors: Sequence[str]) -> list[str]:
    there = list(dict.fromkeys(rows["id"]))
    for name in (name for name in detectors if name not in there):
        raise CosimError("is no detector of these flights", place=name, allowed=", ".join(there),
                         remedy=did_you_mean(name, there))  # fmt: skip
    return list(detectors) or there
