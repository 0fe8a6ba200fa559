"""Figures of one flight: path, motion, surfaces, faults, the time line of alarms, and each detector's statistic and estimate."""

import math

import numpy as np

from cosim import wiring
from cosim.report.figure import COLOURS, DASHES, Figure, axis, bands, base, curve, envelope, grid, level, packed, place, style_axis
from cosim.report.flown import spans, words
from fdi.verdict import NAMES

DEG, FT, KT = 180.0 / math.pi, 1.0 / 0.3048, 3600.0 / 1852.0
EARTH = 6_371_000.0  # mean radius [m]: the track is drawn on a local plane
FLOOR = 1e-3  # |r| below this is drawn here: a logarithm has no zero
SHOWN = {"u": ("u, share of the valve", 1.0), "rad": ("deg", DEG), "m": ("mm", 1e3), "g": ("g", 1.0), "rad/s": ("rad/s", 1.0), "A": ("A", 1.0),
         "fraction": ("%", 100.0)}  # fmt: skip


def _panels(flown, figure, titles, units, columns, legend=True):
    figure.layout = base(figure.height, legend)
    grid(figure.layout, titles, units, columns, span=(flown.t0, flown.end))
    bands(figure.layout, flown.intervals, len(titles))
    return figure


def motion(flown):
    """Return altitude, airspeed, load factor, angle of attack, attitude and rates."""
    get = lambda name, factor=1.0: factor * flown.values("/truth/aircraft", name)  # noqa: E731
    panels = [
        ("Altitude", "ft", [("", get("h", FT))]), ("Airspeed, calibrated", "kt", [("", get("cas", KT))]),
        ("Load factor", "g", [("flown", get("nz")), ("demanded", flown.values("/pilot", "nz_dem"))]),
        ("Angle of attack", "deg", [("true", get("alpha", DEG)), ("measured", DEG * flown.values("/sensors/aircraft", "alpha"))]),
        ("Attitude", "deg", [("pitch", get("theta", DEG)), ("bank", get("phi", DEG))]),
        ("Rates", "deg/s", [("pitch", get("q", DEG)), ("roll", get("p", DEG)), ("yaw", get("r", DEG))]),
    ]  # fmt: skip
    figure = Figure("motion", "Shaded: a fault is active. Drag to zoom in time, double-click to see all; every figure follows.", 560)
    _panels(flown, figure, [p[0] for p in panels], [p[1] for p in panels], 2, legend=False)
    for i, (_, _, curves) in enumerate(panels, 1):
        for j, (name, y) in enumerate(curves):
            figure.data.append(curve(flown.t0, flown.dt, y, name=name, colour=COLOURS[j], dash=DASHES[j], panel=i, legend=False))
        _inline_legend(figure, i)
    return figure


def _inline_legend(figure, panel):
    """Write the names of a panel's curves above it, in their colours."""
    named = [(t["line"], n) for t in figure.data if t["xaxis"] == place(panel)["xaxis"] for n in [t["name"]] if n]
    at = {"x": figure.layout[axis("xaxis", panel)]["domain"][1], "y": figure.layout[axis("yaxis", panel)]["domain"][1]}
    for k, (line, name) in enumerate(reversed(named)):
        mark = "─" if line["dash"] == "solid" else "┄"
        figure.layout["annotations"].append({
            "text": f"{mark} {name}", "xref": "paper", "yref": "paper", **at, "xanchor": "right", "yanchor": "bottom", "xshift": -84 * k,
            "yshift": 3, "showarrow": False, "font": {"size": 11, "color": line["color"]}})  # fmt: skip


def track(flown):
    """Return the path over ground and in height; the part flown with a fault is drawn in its colour."""
    lat, lon = (flown.values("/truth/aircraft", n) for n in ("lat", "lon"))
    north, east = EARTH * (lat - lat[0]) / 1e3, EARTH * np.cos(lat[0]) * (lon - lon[0]) / 1e3
    along, height = np.hypot(north, east), FT * flown.values("/truth/aircraft", "h")
    t = flown.t0 + flown.dt * np.arange(len(lat))
    broken = np.zeros(len(t), bool)
    for a, b in flown.intervals:
        broken |= (t >= a) & (t <= b)
    figure = Figure("track", "The dot is where the aircraft is at the time cursor.", 250, time=False)
    figure.layout = base(figure.height, legend=False) | {"hovermode": "closest"}
    grid(figure.layout, ["Path over ground, seen from above", "Height along the path"], ["north, km", "ft"], 2, time=False)
    figure.layout["xaxis"]["title"]["text"], figure.layout["xaxis2"]["title"]["text"] = "east, km", "distance from the start, km"
    pick = np.unique(np.linspace(0, len(t) - 1, 400).astype(int))
    for i, (x, y) in enumerate(((east, north), (along, height)), 1):
        for mask, colour, width in ((np.ones(len(t), bool), "--blue", 2.0), (broken, "--fault", 3.0)):
            part = np.where(mask, y, np.nan)[pick]
            figure.data.append({"type": "scatter", "mode": "lines", "x": packed(x[pick]), "y": packed(part), "line": {"color": colour, "width": width},
                                "showlegend": False, "hoverinfo": "x+y", **place(i)})  # fmt: skip
    for i, (x, y, least) in enumerate(((east, north, 0.5), (along, height, 60.0)), 1):
        middle, half = (np.nanmax(y) + np.nanmin(y)) / 2, max((np.nanmax(y) - np.nanmin(y)) / 2 * 1.15, least)
        figure.layout["yaxis" if i == 1 else "yaxis2"]["range"] = [middle - half, middle + half]
    figure.track = [{"x": np.round(x[pick], 4).tolist(), "y": np.round(y[pick], 4).tolist()} for x, y in ((east, north), (along, height))]
    return figure


def surfaces(flown):
    """Return commands against measured and true surfaces: the four elevator segments, and the others."""
    command = DEG * flown.values("/law", "de_cmd")
    titles = [f"{words(seg)}, {tech}" for seg, tech in flown.scenario.elevator.technology.items()]
    figure = Figure("elevators", "Elevator segments, trailing edge down positive. The measured surface is what the monitors read.", 470)
    _panels(flown, figure, titles, ["deg"] * 4, 2)
    for i, (seg, short) in enumerate(wiring.SHORT.items(), 1):
        curves = (("measured", flown.values(f"/sensors/{seg}", "surface"), "--orange", "solid", 1.0),
                  ("true", flown.values("/truth/aircraft", f"de_{short}"), "--blue", "solid", 1.5),
                  ("command", command / DEG, "--ink", "dot", 1.4))  # fmt: skip
        for name, y, colour, dash, width in curves:
            figure.data.append(curve(flown.t0, flown.dt, DEG * y, name=name, colour=colour, dash=dash, width=width, panel=i, showlegend=i == 1))
    others = Figure("others", "", 250)
    pairs = [(words(n), wiring.COMMAND_OF[n], wiring.SURFACE_OF[n]) for n in wiring.OTHERS]
    _panels(flown, others, [p[0] for p in pairs], ["deg"] * 4, 4)
    for i, (_, demanded, short) in enumerate(pairs, 1):
        for name, y, colour, dash in (("true", flown.values("/truth/aircraft", short), "--blue", "solid"), ("command", flown.values("/law", demanded), "--ink", "dot")):
            others.data.append(curve(flown.t0, flown.dt, DEG * y, name=name, colour=colour, dash=dash, panel=i, showlegend=i == 1))
    return figure, others


def injected(flown):
    """Return the injected signal of each fault lane, or None without a fault."""
    lanes = flown.injected
    if not lanes:
        return None
    columns = min(2, len(lanes))
    figure = Figure("faults", "What was injected, in the unit of the place where it enters: the truth that the detectors do not know.", 66 + 150 * -(-len(lanes) // columns))
    _panels(flown, figure, [n for n, _, _ in lanes], [u for _, u, _ in lanes], columns, legend=False)
    for i, (name, _, y) in enumerate(lanes, 1):
        figure.data.append(curve(flown.t0, flown.dt, y, name=name, colour="--fault", panel=i, legend=False))
    return figure


def timeline(flown):
    """Return all alarms on one time line: a row per lane, thick where it alarms, pale where it cannot judge."""
    figure = Figure("timeline", "Thick bars: alarms, with the verdict; hollow bars: false alarms. Thin lines: the detector watches and is quiet; gaps: "
                    "its estimate is not valid. Dark bars at the top: the faults. Click a detector in the bar above to hide it.")  # fmt: skip
    figure.layout = base(300, legend=False) | {"margin": {"l": 190, "r": 14, "t": 8, "b": 40}, "hovermode": "closest"}
    figure.layout["xaxis"] = style_axis("time, s", range=[flown.t0, flown.end])
    figure.layout["yaxis"] = style_axis("", type="category", ticklabelstandoff=4) | {"gridcolor": "rgba(0,0,0,0)", "tickfont": {"size": 11.5, "color": "--ink"}}
    bands(figure.layout, flown.intervals, 1)
    figure.rows, alarms, faults = [], [], []
    for f, told in zip(flown.scenario.faults, flown.faults):
        row, end = f"fault: {words(f.kind)}", min(told["end_s"], flown.end)
        if row not in [r["name"] for r in figure.rows]:
            figure.rows.append({"name": row, "detector": ""})
        _bar(figure, row, f.start_s, end, "--ink", 9, f"{words(f.kind)} on {words(f.target)}")
        faults.append({"from": f.start_s, "to": end, "text": f"{words(f.kind)} on {words(f.target)}"})
    for lane in flown.lanes:
        figure.rows.append({"name": lane.name, "detector": lane.id})
        alarms += _row(figure, flown, lane)
    figure.height = 22 * len(figure.rows) + 70
    figure.layout["height"] = figure.height
    return figure, alarms, faults


def _bar(figure, row, a, b, colour, width, told, meta=None):
    trace = {"type": "scatter", "mode": "lines", "x": [a, b], "y": [row, row], "line": {"color": colour, "width": width}, "name": told, "showlegend": False,
             "hovertemplate": f"{told}<br>%{{x:.3f}} s<extra></extra>", **place(1)}  # fmt: skip
    figure.data.append(trace | ({"meta": meta} if meta else {}))


def _row(figure, flown, lane):
    """Draw one lane; return its alarms for the cursor's line."""
    step, meta, out = flown.dt * lane.every, {"detector": lane.id}, []
    on, verdict, culprit = (lane.fields[n] for n in ("alarm", "verdict", "culprit"))
    for a, b in spans(lane.fields["valid"] > 0.5, flown.t0, step):
        _bar(figure, lane.name, a, b, "--line", 1.5, f"{lane.name}: watching", meta)
    real, labels = _real(flown, lane, step), []
    found = spans(on > 0.5, flown.t0, step)
    for a, b in found:
        k = slice(round((a - flown.t0) / step), round((b - flown.t0) / step))
        given = np.flatnonzero(verdict[k] > 0.5)
        said = NAMES[int(verdict[k][given[-1]])] if len(given) else "alarm"
        blamed = int(culprit[k][given[-1]]) if len(given) else 0
        part = lane.culprits[blamed] if 0 <= blamed < len(lane.culprits) else ""
        said = f"{words(said)} {words(part)}".strip()
        true = real[k.start] if k.start < len(real) else False
        out.append({"from": a, "to": b, "text": f"{lane.name} ({said}{'' if true else ', false'})", "detector": lane.id})
        told = f"{lane.name}: {said}, {a:.3f} to {b:.3f} s{'' if true else ', false alarm'}"
        _bar(figure, lane.name, a, b, "--fault" if true else "--gold", 11, told, meta)
        if not true:  # hollow: also without colour it is another thing
            _bar(figure, lane.name, a, b, "--page", 5, told, meta)
        labels.append((a, b, said))
    _labels(figure, flown, lane, labels)
    return out


def _labels(figure, flown, lane, alarms):
    """Write the verdict beside its bar, where there is room; at the left edge on the bar itself."""
    last, room = None, (flown.end - flown.t0) / 8
    for a, _, said in alarms:
        if last is not None and a - last < room:
            continue
        inside = a - flown.t0 < room
        figure.layout["annotations"].append({
            "text": said, "x": a, "y": lane.name, "xanchor": "left" if inside else "right", "xshift": 12 if inside else -3, "showarrow": False,
            "font": {"size": 11, "color": "--ink"}, "bgcolor": "--page" if inside else "rgba(0,0,0,0)", "borderpad": 1, "detector": lane.id})  # fmt: skip
        last = a


def _real(flown, lane, step):
    """Return the rows (bool) at which an alarm of the lane would be a true one: as `cosim.result.judge` counts."""
    from cosim.result import concerns

    out = np.zeros(len(lane.fields["alarm"]), bool)
    for f in flown.faults:
        if concerns(lane, f["targets"]):
            end = len(out) if math.isinf(f["end_s"]) else math.ceil((f["end_s"] + 2.0 - flown.t0) / step)
            out[max(0, round((f["start_s"] - flown.t0) / step)) : max(0, end)] = True
    return out


def detector(flown, lanes):
    """Return the figure of one detector: statistic of every lane over its threshold; estimate with band and truth."""
    estimates = [n for n in lanes[0].fields if n.startswith("f_hat")]
    figure = Figure(f"d-{lanes[0].id}", "", 264, detector=lanes[0].id)
    main = next((lane.truth[0] for lane in lanes if lane.truth), estimates[0] if estimates else None)
    unit, factor = _unit(lanes, main)
    titles = ["Statistic |r|, threshold at 1"] + ([f"Estimate {main}"] if main else [])
    _panels(flown, figure, titles, ["|r|", unit][: len(titles)], len(titles))
    figure.layout["margin"] |= {"t": 50}
    figure.layout["legend"]["y"] = 1.1
    _statistic(figure, flown, lanes)
    if main:
        _estimate(figure, flown, lanes, main, factor)
    return figure


def _unit(lanes, main):
    """Return (unit to show, factor) of an estimate: that of the truth, else none."""
    known = next((lane.truth[2] for lane in lanes if lane.truth), None)
    return SHOWN.get(known, (known or "SI unit of the estimate", 1.0)) if main else ("", 1.0)


def _statistic(figure, flown, lanes):
    level(figure.layout, 1, 1.0)
    top = max([2.0, *(float(np.nanmax(np.abs(x.fields["r"]))) for x in lanes if np.isfinite(x.fields["r"]).any())])
    figure.layout["yaxis"] |= {"type": "log", "range": [math.log10(FLOOR * 8), math.log10(top * 1.5)], "dtick": 1, "tickformat": "~g"}
    for i, lane in enumerate(lanes):
        r = np.maximum(np.abs(lane.fields["r"]), FLOOR)
        figure.data.append(curve(flown.t0, flown.dt * lane.every, r, name=words(lane.lane), colour=COLOURS[i % 8], width=1.2, panel=1,
                                 dash=DASHES[i % 4] if i else "solid"))  # fmt: skip


def _estimate(figure, flown, lanes, main, factor):
    """Draw the estimate of the lanes that estimate a fault of this flight, of all when none does."""
    mine = [lane for lane in lanes if lane.truth] or lanes
    for i, lane in enumerate(lanes):
        if lane not in mine:
            continue
        step, f = flown.dt * lane.every, lane.fields[main] * factor
        sigma = lane.fields.get(f"f_sigma{main.removeprefix('f_hat')}")
        if sigma is None and main in ("f_hat", next(n for n in lane.fields if n.startswith("f_hat"))):
            sigma = lane.fields.get("f_sigma")
        if sigma is not None:
            _band(figure, flown.t0, step, f, 2.0 * factor * sigma, COLOURS[i % 8])
        figure.data.append(curve(flown.t0, step, f, name=f"estimate {words(lane.lane)}", colour=COLOURS[i % 8], panel=2, showlegend=False))
    for lane in mine:
        if lane.truth:
            figure.data.append(curve(flown.t0, flown.dt, lane.truth[1] * factor, name="injected truth", colour="--ink", dash="dot", width=1.6, panel=2))
            break
    _view(figure, lanes, mine, main, factor)


def _view(figure, lanes, mine, main, factor):
    """Choose a vertical range by the valid part of the estimates, with all of the truth."""
    seen = [lane.fields[main][lane.fields["valid"] > 0.5] for lane in mine] + [lane.truth[1] for lane in mine if lane.truth]
    seen = np.concatenate([np.asarray(x, float)[np.isfinite(x)] for x in seen] or [np.zeros(1)])
    if len(seen):
        low, high = factor * float(seen.min()), factor * float(seen.max())
        half = max(0.6 * (high - low), 1e-9)
        figure.layout["yaxis2"]["range"] = [(low + high) / 2 - half, (low + high) / 2 + half]


def _band(figure, t0, step, f, half, colour):
    """Shade f +- half: the band must not be narrower than its samples, so its edges are the envelopes' extremes."""
    for y, fill in ((f - half, None), (f + half, "tonexty")):
        values, every = envelope(y)
        figure.data.append({"type": "scatter", "mode": "lines", "x0": t0, "dx": step * every, "y": packed(values), "line": {"width": 0, "color": colour},
                            "showlegend": False, "hoverinfo": "skip", **({"fill": fill, "fillcolor": f"{colour}/0.22"} if fill else {}), **place(2)})  # fmt: skip
