"""Curves of a comparison as frames, with bounds, and as figures for a paper (matplotlib, the extra `plot`)."""

import textwrap
from collections.abc import Iterable, Sequence
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
KINDS = ("roc", "pod")
ROC = ("detector", "threshold", "false_alarm", "false_alarm_low", "false_alarm_high", "detection", "detection_low",
       "detection_high", "fault_free_flights", "faults")  # fmt: skip
POD = ("family", "of", "frequency_hz", "amplitude_mm", "pod", "low", "high", "flights", "seen", "a90", "a90_95", "note")


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


def fits(rows: pd.DataFrame, each: list[dict], detectors: Sequence[str] = ()) -> list[dict]:
    """Return {family, of, frequency_hz, flights, seen, sizes, fit} of each kind of oscillation and frequency, with the
    Pod `fit`; of each level, or of `detectors`: there a flight in which it was not valid counts as missed."""
    own = rows[rows["frequency_hz"].notna() & (rows["amplitude_mm"] > 0.0)]
    if detectors:
        own = own[own["id"].isin(_known(rows, detectors)) & own["concerned"]].assign(of=own["id"], seen=own["detected"])
    else:
        grouped = stats.by_group(rows, each)
        own = grouped[grouped["frequency_hz"].notna() & (grouped["amplitude_mm"] > 0.0) & grouped["able"]]
        own = own.assign(of=own["group"])
    hz = stats.bands(own["frequency_hz"].astype(float))
    return [
        {"family": family, "of": of, "frequency_hz": float(band), "sizes": part["amplitude_mm"].to_numpy(float),
         "fit": pod.fit(part["amplitude_mm"], part["seen"])}
        for (family, of, band), part in own.groupby([own["family"], own["of"], hz], sort=True)
    ]  # fmt: skip


def curves(rows: pd.DataFrame, each: list[dict], detectors: Sequence[str] = ()) -> pd.DataFrame:
    """Return the fitted curves as a frame, columns POD: probability of detection over the achieved amplitude [mm of
    rod], `low` and `high` each with 95 % confidence. A cell without a curve has one row, whose `note` says why."""
    out = []
    for one in fits(rows, each, detectors):
        f = one["fit"]
        about = {"family": one["family"], "of": one["of"], "frequency_hz": one["frequency_hz"], "flights": f.n,
                 "seen": f.seen, "a90": f.a90, "a90_95": f.a90_95, "note": f.note}  # fmt: skip
        if f.coefficients is None:
            out.append(about)
            continue
        at = np.geomspace(one["sizes"].min(), one["sizes"].max(), POINTS)
        out += [about | dict(zip(("amplitude_mm", "pod", "low", "high"), row)) for row in zip(at, *f.at(at))]
    return pd.DataFrame(out, columns=list(POD))


def figure(kind: str, rows: pd.DataFrame, each: list[dict], detectors: Sequence[str] = ()) -> Any:
    """Return the matplotlib Figure of "roc" or "pod", one column wide, with bounds; `savefig("x.pdf")` writes vectors.
    Raises CosimError for another kind, without matplotlib, and as `roc`."""
    if kind not in KINDS:
        raise CosimError(f"unknown figure {kind!r}", allowed=", ".join(KINDS), remedy=did_you_mean(kind, KINDS))
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise CosimError("figures need matplotlib", remedy="pip install 'cosim-fdi[plot]'") from None
    made = Figure(figsize=(WIDTH_IN, 0.8 * WIDTH_IN), layout="constrained")
    axes = made.subplots()
    told = (_roc if kind == "roc" else _pod)(axes, rows, each, detectors)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3, linewidth=0.4)
    title = "\n".join(line for part in told for line in textwrap.wrap(part, COLUMNS))
    names = made.legend(loc="outside lower center", ncols=2, fontsize=6, frameon=False, title=title, title_fontsize=6,
                        alignment="left")  # fmt: skip
    lines = -(-len(names.get_texts()) // 2) + title.count("\n") + 1
    made.set_size_inches(WIDTH_IN, 0.8 * WIDTH_IN + LINE_IN * lines)
    return made


def _roc(axes, rows, each, detectors):
    """Draw the ROC; return what its legend says, a paragraph each."""
    shipped, found = {d["id"]: d for d in each}, roc(rows, detectors)
    each_of = found.groupby("detector", sort=False)
    for width, (name, own) in zip(_widths(len(each_of)), each_of):
        d = shipped[name]
        x, y = d["false_alarm_probability"], d["detection_probability"]
        (line,) = axes.step(own["false_alarm"], own["detection"], where="post", linewidth=width, clip_on=False,
                            label=name)  # fmt: skip
        axes.fill_between(own["false_alarm"], own["detection_low"], own["detection_high"], step="post", alpha=0.12,
                          color=line.get_color(), linewidth=0)  # fmt: skip
        axes.errorbar([x], [y], xerr=[[x - d["false_alarm_low"]], [d["false_alarm_high"] - x]],
                      yerr=[[y - d["detection_low"]], [d["detection_high"] - y]], fmt="o", markersize=3, linewidth=0.7,
                      color=line.get_color())  # fmt: skip
    axes.set(xlim=(-0.05, 1.05), ylim=(-0.05, 1.05))
    axes.set_xlabel("share of fault-free flights with an alarm", fontsize=7)
    axes.set_ylabel("share of designed-for faults seen", fontsize=7)
    return [ROC_TOLD]


def _pod(axes, rows, each, detectors):
    """Draw the fitted curves; return what the legend says, a paragraph each: also who has no curve, and why."""
    every = curves(rows, each, detectors)
    found, without = every.dropna(subset=["pod"]), every[every["pod"].isna()]
    if found.empty:
        remedy = "More flights, over a range of amplitudes at each frequency; `pod()` says what is missing where"
        raise CosimError("too few flights for a curve of detection over size", remedy=remedy)
    same = every["family"].nunique() == 1
    each_of = found.groupby(["family", "of", "frequency_hz"], sort=False)
    for width, ((family, of, hz), own) in zip(_widths(len(each_of)), each_of):
        label = f"{of}, {hz:g} Hz" if same else f"{of}, {family}, {hz:g} Hz"
        (line,) = axes.plot(own["amplitude_mm"], own["pod"], linewidth=width, label=label)
        axes.fill_between(own["amplitude_mm"], own["low"], own["high"], alpha=0.12, color=line.get_color(), linewidth=0)
    axes.axhline(0.9, color="0.5", linewidth=0.6, linestyle="--")
    axes.set(xscale="log", ylim=(-0.05, 1.05))
    low, high = found["amplitude_mm"].min(), found["amplitude_mm"].max()
    ticks = [m * 10.0**k for k in range(-4, 4) for m in (1, 2, 5) if low <= m * 10.0**k <= high]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("achieved amplitude, mm of rod", fontsize=7)
    axes.set_ylabel("probability of detection", fontsize=7)
    why = [f"{r['of']}{'' if same else ', ' + r['family']}, {r['frequency_hz']:g} Hz: {r['note']} mm"
           if r["note"].startswith(("all", "none", "between")) else f"{r['of']}, {r['frequency_hz']:g} Hz: {r['note']}"
           for r in without.to_dict("records")]  # fmt: skip
    told = [every["family"].iloc[0] + ". " + POD_TOLD if same else POD_TOLD]
    return told + ["No curve: " + "; ".join(why)] * bool(why)


def _widths(n):
    """Return the line width of each of n curves, falling: of some that are the same all are seen."""
    return np.linspace(min(1.0 + 0.5 * (n - 1), 4.0), 1.0, n)


def _known(rows, detectors: Iterable[str]) -> list[str]:
    there = list(dict.fromkeys(rows["id"]))
    for name in detectors:
        if name not in there:
            raise CosimError("is no detector of these flights", place=name, allowed=", ".join(there),
                             remedy=did_you_mean(name, there))  # fmt: skip
    return list(detectors) or there
