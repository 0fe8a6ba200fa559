"""Figures of one flight: path, motion, surfaces, faults, the time line of alarms, and each detector's statistic and estimate."""

import math

import numpy as np

from cosim import wiring
from cosim.report.figure import COLOURS, DASHES, Figure, axis, bands, base, curve, envelope, grid, least, level, note, packed, peaks, place, style_axis
from cosim.flown import spans, words
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
        ("Altitude", "ft", 100.0, [("", get("h", FT))]), ("Airspeed, calibrated", "kt", 2.0, [("", get("cas", KT))]),
        ("Load factor", "g", 0.1, [("demanded", 1.0 + flown.values("/pilot", "nz_dem")), ("flown", get("nz"))]),
        ("Angle of attack", "deg", 0.5, [("measured", DEG * flown.values("/sensors/aircraft", "alpha")), ("true", get("alpha", DEG))]),
        ("Attitude", "deg", 1.0, [("pitch", get("theta", DEG)), ("bank", get("phi", DEG))]),
        ("Rates", "deg/s", 0.5, [("yaw", get("r", DEG)), ("roll", get("p", DEG)), ("pitch", get("q", DEG))]),
    ]  # fmt: skip
    figure = Figure("motion", "Shaded: a fault is active. Drag to zoom in time, double-click to see all; every figure follows.", 560)
    _panels(flown, figure, [p[0] for p in panels], [p[1] for p in panels], 2, legend=False)
    for i, (_, _, half, curves) in enumerate(panels, 1):
        for j, (name, y) in enumerate(reversed(curves)):
            figure.data.insert(0, curve(flown.t0, flown.dt, y, name=name, colour=COLOURS[(0, 4, 2)[j]], dash=DASHES[(0, 0, 2)[j]],
                                        width=(1.6, 1.1, 1.4)[j], panel=i, legend=False))  # fmt: skip
        least(figure.layout, i, [y for _, y in curves], half)
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
    figure.layout["yaxis"] |= {"scaleanchor": "x", "constrain": "domain"}
    least(figure.layout, 2, [height], 200.0)
    figure.track = [{"x": np.round(x[pick], 4).tolist(), "y": np.round(y[pick], 4).tolist()} for x, y in ((east, north), (along, height))]
    return figure


def surfaces(flown):
    """Return commands against measured and true surfaces: the four elevator segments, and the others."""
    command = flown.values("/law", "de_cmd")
    titles = [f"{words(seg)}, {tech}" for seg, tech in flown.scenario.elevator.technology.items()]
    figure = Figure("elevators", "Elevator segments, trailing edge down positive. The measured surface is what the monitors read; command and "
                    "measurement are drawn thin, below the truth.", 470)  # fmt: skip
    _panels(flown, figure, titles, ["deg"] * 4, 2)
    for i, (seg, short) in enumerate(wiring.SHORT.items(), 1):
        _surface(flown, figure, i, (("measured", flown.values(f"/sensors/{seg}", "surface")), ("command", command),
                                    ("true", flown.values("/truth/aircraft", f"de_{short}"))), i == 2)  # fmt: skip
    others = Figure("others", "Thin: command; blue: true surface.", 230)
    pairs = [(words(n), wiring.COMMAND_OF[n], wiring.SURFACE_OF[n]) for n in wiring.OTHERS]
    _panels(flown, others, [p[0] for p in pairs], ["deg"] * 4, 4, legend=False)
    for i, (_, demanded, short) in enumerate(pairs, 1):
        _surface(flown, others, i, (("command", flown.values("/law", demanded)), ("true", flown.values("/truth/aircraft", short))), False)
    return figure, others


def _surface(flown, figure, panel, curves, legend):
    look = {"measured": ("--orange", 0.9), "command": ("--muted", 0.9), "true": ("--blue", 1.8)}
    for name, y in curves:
        colour, width = look[name]
        figure.data.append(curve(flown.t0, flown.dt, DEG * y, name=name, colour=colour, width=width, panel=panel, showlegend=legend))
    least(figure.layout, panel, [DEG * y for _, y in curves], 0.5)


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
    figure = Figure(f"d-{lanes[0].id}", "", 258, detector=lanes[0].id)
    main = next((lane.truth[0] for lane in lanes if lane.truth), estimates[0] if estimates else None)
    unit, factor = _unit(lanes, main)
    titles = ["Statistic |r|"] + ([f"Estimate {main}"] if main else [])
    _panels(flown, figure, titles, ["|r|, threshold 1", unit][: len(titles)], len(titles))
    figure.layout["margin"] |= {"t": 44}
    figure.layout["legend"]["y"] = 1.06
    _statistic(figure, flown, lanes)
    if main:
        _estimate(figure, flown, lanes, main, factor)
    return figure


def _unit(lanes, main):
    """Return (unit to show, factor) of an estimate: that of the truth, else none."""
    known = next((lane.truth[2] for lane in lanes if lane.truth), None)
    return SHOWN.get(known, (known or "SI unit", 1.0)) if main else ("", 1.0)


def _statistic(figure, flown, lanes):
    level(figure.layout, 1, 1.0)
    sizes = [np.abs(lane.fields["r"]) for lane in lanes]
    top = max([2.0, *(float(np.nanmax(r)) for r in sizes if np.isfinite(r).any())])
    figure.layout["yaxis"] |= {"type": "log", "range": [math.log10(FLOOR * 8), math.log10(top * 1.6)], "tickvals": [0.01, 0.1, 1, 10, 100, 1000], "ticktext": ["0.01", "0.1", "1", "10", "100", "1000"]}
    for i, (lane, r) in enumerate(zip(lanes, sizes)):
        figure.data.append(curve(flown.t0, flown.dt * lane.every, np.maximum(r, FLOOR), name=words(lane.lane), colour=COLOURS[i % 8],
                                 width=2.0 if lane.entry["concerned"] else 1.1, panel=1, reduce=peaks))  # fmt: skip
    if not any((r > 0.0).any() for r in sizes):
        note(figure.layout, 1, "never judged in this flight: its validity flag stayed down")


def _estimate(figure, flown, lanes, main, factor):
    """Draw the estimate of the lanes that estimate a fault of this flight, of all when none does; pale where not valid."""
    mine = [lane for lane in lanes if lane.truth] or lanes
    sigma_name = f"f_sigma{main.removeprefix('f_hat')}"
    first = next(n for n in lanes[0].fields if n.startswith("f_hat"))
    for i, lane in enumerate(lanes):
        if lane not in mine:
            continue
        step, f, ok = flown.dt * lane.every, lane.fields[main] * factor, lane.fields["valid"] > 0.5
        sigma = lane.fields.get(sigma_name, lane.fields.get("f_sigma") if main in ("f_hat", first) else None)
        if sigma is not None and ok.any():
            _band(figure, flown.t0, step, np.where(ok, f, np.nan), 2.0 * factor * sigma, COLOURS[i % 8])
        for part, colour, width in ((~ok, "--line", 1.0), (ok, COLOURS[i % 8], 1.4)):
            if part.any():
                figure.data.append(curve(flown.t0, step, np.where(part, f, np.nan), name=f"estimate {words(lane.lane)}", colour=colour, width=width,
                                         panel=2, showlegend=False))  # fmt: skip
    truth = next((lane.truth[1] * factor for lane in mine if lane.truth), None)
    if truth is not None:
        figure.data.append(curve(flown.t0, flown.dt, truth, name="injected truth", colour="--ink", dash="dot", width=1.6, panel=2))
    seen = [lane.fields[main] * factor for lane in mine if lane.able] or [lane.fields[main] * factor for lane in mine]
    least(figure.layout, 2, seen + ([truth] if truth is not None else []), 1e-6)
    if not any(np.any(y != 0.0) for y in seen):
        figure.layout["yaxis2"]["range"] = [-1.0, 1.0]
        note(figure.layout, 2, "zero throughout: it declared no fault")
    elif not any((lane.fields["valid"] > 0.5).any() for lane in mine):
        note(figure.layout, 2, "not valid in this flight, by its own flag")


def _band(figure, t0, step, f, half, colour):
    """Shade f +- half: the band must not be narrower than its samples, so its edges are the envelopes' extremes."""
    for y, fill in ((f - half, None), (f + half, "tonexty")):
        values, every = envelope(y)
        figure.data.append({"type": "scatter", "mode": "lines", "x0": t0, "dx": step * every, "y": packed(values), "line": {"width": 0, "color": colour},
                            "showlegend": False, "hoverinfo": "skip", **({"fill": fill, "fillcolor": f"{colour}/0.22"} if fill else {}), **place(2)})  # fmt: skip
