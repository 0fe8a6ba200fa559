"""Curves of a comparison as frames, with bounds, and as figures for a paper (matplotlib, the extra `plot`)."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from cosim.compare import metrics, pod, stats
from cosim.errors import CosimError, did_you_mean

WIDTH_IN = 3.5  # of a column of the usual journals
POINTS = 60  # of a fitted curve
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

    Raises CosimError for another kind, without matplotlib, and as `roc`.
    """
    if kind not in KINDS:
        raise CosimError(f"unknown figure {kind!r}", allowed=", ".join(KINDS), remedy=did_you_mean(kind, KINDS))
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise CosimError("figures need matplotlib", remedy="pip install 'cosim-fdi[plot]'") from None
    made = Figure(figsize=(WIDTH_IN, 0.8 * WIDTH_IN), layout="constrained")
    axes = made.subplots()
    (_roc if kind == "roc" else _pod)(axes, rows, each, detectors)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3, linewidth=0.4)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=6, frameon=False)
    return made


def _roc(axes, rows, each, detectors):
    for name, own in roc(rows, detectors).groupby("detector", sort=False):
        (line,) = axes.step(own["false_alarm"], own["detection"], where="post", linewidth=1.0, label=name)
        axes.fill_between(own["false_alarm"], own["detection_low"], own["detection_high"], step="post", alpha=0.12,
                          color=line.get_color(), linewidth=0)  # fmt: skip
        shipped = own[own["threshold"] == 1.0].iloc[0]
        p = shipped["false_alarm"]
        ends = [[p - shipped["false_alarm_low"]], [shipped["false_alarm_high"] - p]]
        axes.errorbar([p], [shipped["detection"]], xerr=ends, fmt="o", markersize=3, linewidth=0.7,
                      color=line.get_color())  # fmt: skip
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
    axes.set_xlabel("share of fault-free flights that reach the threshold", fontsize=7)
    axes.set_ylabel("share of faults that reach it", fontsize=7)


def _pod(axes, rows, each, detectors):
    found = curves(rows, each, detectors).dropna(subset=["pod"])
    if found.empty:
        remedy = "More flights, over a range of amplitudes at each frequency; `pod()` says what is missing where"
        raise CosimError("too few flights for a curve of detection over size", remedy=remedy)
    for (family, of, hz), own in found.groupby(["family", "of", "frequency_hz"], sort=False):
        (line,) = axes.plot(own["amplitude_mm"], own["pod"], linewidth=1.0, label=f"{of}, {family}, {hz:g} Hz")
        axes.fill_between(own["amplitude_mm"], own["low"], own["high"], alpha=0.12, color=line.get_color(), linewidth=0)
    axes.axhline(0.9, color="0.5", linewidth=0.6, linestyle="--")
    axes.set(xscale="log", ylim=(-0.02, 1.02))
    axes.set_xlabel("achieved amplitude, mm of rod", fontsize=7)
    axes.set_ylabel("probability of detection", fontsize=7)


def _known(rows, detectors: Iterable[str]) -> list[str]:
    there = list(dict.fromkeys(rows["id"]))
    for name in detectors:
        if name not in there:
            raise CosimError("is no detector of these flights", place=name, allowed=", ".join(there),
                             remedy=did_you_mean(name, there))  # fmt: skip
    return list(detectors) or there
