"""Figures of one flight: path, motion, surfaces, what was injected, every detector, all alarms on one time line."""

import math
from typing import Any

import numpy as np

from actuators.constants import DEG_PER_RAD, FT_PER_M, KT_PER_M_S
from cosim.flight.loop import wiring
from cosim.judge.alarms import during
from cosim.judge.detection import NO_FAULT, Heard, Runs, name_at_end
from cosim.judge.lanes import SHOWN
from cosim.judge.result import concerns
from cosim.replay.recording import Lane, LoggedFlight, joined, words
from cosim.replay.thinned import POINTS
from cosim.report.figure import COLOURS, Figure, axis, base, packed, place, still, style_axis
from fdi import registry
from fdi.common.verdict import class_name

RATES = (("yaw", "r"), ("roll", "p"), ("pitch", "q"))  # in the order of drawing, and their fields
LOOKS: tuple[dict, ...] = (  # of curves in a panel of motion, the last one on top
    {"colour": "--green", "dash": "dot", "width": 1.4}, {"colour": "--orange", "width": 1.1},
    {"colour": "--blue", "width": 1.6},
)  # fmt: skip
LETTER = 0.014  # width of a letter of the time line as a share of its axis on a page of 700 px
EARTH = 6_371_000.0  # mean radius [m]: the track is drawn on a local plane


def panels(
    flown: LoggedFlight, name: str, caption: str, height: int, titles: list[str], units: list[str], columns: int,
    legend: bool = False, **more: Any
) -> Figure:  # fmt: skip
    """Return a figure of time panels over the whole flight with its faults shaded."""
    figure = Figure(name, caption, height, layout=base(height, legend), **more)
    figure.grid(titles, units, columns, span=(flown.t0, flown.end))
    figure.bands(flown.intervals, len(titles))
    return figure


def drawn(flown: LoggedFlight, topic: str, field: str, factor: float = 1.0, add: float = 0.0) -> tuple[Any, float]:
    """Return (values, seconds between two) of a logged signal as it is drawn."""
    y, every = flown.curve(topic, field)
    return factor * y + add, flown.dt * every


def motion(flown: LoggedFlight) -> Figure:
    """Return altitude, airspeed, load factor, angle of attack, attitude and rates."""
    truth, deg = "/truth/aircraft", DEG_PER_RAD  # each curve: name, topic, field, factor, what is added
    shown: list[tuple[str, str, float, list[tuple[str, str, str, float, float]]]] = [
        ("Altitude", "ft", 100.0, [("", truth, "h", FT_PER_M, 0.0)]),
        ("Airspeed, calibrated", "kt", 2.0, [("", truth, "cas", KT_PER_M_S, 0.0)]),
        ("Load factor", "g", 0.1, [("demanded", "/law/pilot", "nz_dem", 1.0, 1.0), ("flown", truth, "nz", 1.0, 0.0)]),
        ("Angle of attack", "deg", 0.5, [("measured", "/sensors/aircraft", "alpha", deg, 0.0),
                                         ("true", truth, "alpha", deg, 0.0)]),
        ("Attitude", "deg", 1.0, [("pitch", truth, "theta", deg, 0.0), ("bank", truth, "phi", deg, 0.0)]),
        ("Rates", "deg/s", 0.5, [(name, truth, field, deg, 0.0) for name, field in RATES]),
    ]  # fmt: skip
    names, units = [p[0] for p in shown], [p[1] for p in shown]
    told = "Shaded: a fault is active. Drag to zoom in time, double-click to see all; every figure follows."
    figure = panels(flown, "motion", told, 560, names, units, 2)
    for i, (_, _, half, curves) in enumerate(shown, 1):
        made = [(name, *drawn(flown, topic, field, factor, add)) for name, topic, field, factor, add in curves]
        for (name, y, step), look in zip(made, LOOKS[-len(made) :]):
            figure.curve(flown.t0, step, y, name=name, panel=i, legend=False, **look)
        figure.least(i, [y for _, y, _ in made], half)
        _inline_legend(figure, i)
    return figure


def _inline_legend(figure, panel):
    named = [(t["line"], n) for t in figure.data if t["xaxis"] == place(panel)["xaxis"] for n in [t["name"]] if n]
    at = {"x": figure.layout[axis("xaxis", panel)]["domain"][1], "y": figure.layout[axis("yaxis", panel)]["domain"][1]}
    for k, (line, name) in enumerate(reversed(named)):
        mark = "─" if line["dash"] == "solid" else "┄"
        look: dict = {"xanchor": "right", "xshift": -84 * k, "font": {"size": 11, "color": line["color"]}}
        figure.label(f"{mark} {name}", **at, **look)


def track(flown: LoggedFlight) -> Figure:
    """Return the path over ground and in height; the part flown with a fault is drawn in its colour."""
    t, lat, lon, h = flown.path.T
    north, east = EARTH * (lat - lat[0]) / 1e3, EARTH * np.cos(lat[0]) * (lon - lon[0]) / 1e3
    along, height = np.hypot(north, east), FT_PER_M * h
    broken = np.zeros(len(t), bool)
    for a, b in flown.intervals:
        broken |= (t >= a) & (t <= b)
    told = "Thick: flown with a fault. The dot is where the aircraft is at the time cursor."
    figure = still("track", told, 250)
    titles = ["Path over ground, seen from above", "Height along the path"]
    figure.grid(titles, ["north, km", "ft"], 2, x_title="")
    figure.layout["xaxis"]["title"]["text"] = "east, km"
    figure.layout["xaxis2"]["title"]["text"] = "distance from the start, km"
    for i, (x, y) in enumerate(((east, north), (along, height)), 1):
        for mask, colour, width in ((np.ones(len(t), bool), "--blue", 2.0), (broken, "--fault", 3.0)):
            line, xs, ys = {"color": colour, "width": width}, packed(x), packed(np.where(mask, y, np.nan))
            figure.points(i, mode="lines", x=xs, y=ys, line=line, hoverinfo="x+y")
    figure.layout["yaxis"] |= {"scaleanchor": "x", "constrain": "domain"}
    figure.least(2, [height], 200.0)
    figure.track = [
        {"x": np.round(x, 4).tolist(), "y": np.round(y, 4).tolist()} for x, y in ((east, north), (along, height))
    ]
    return figure


def surfaces(flown: LoggedFlight) -> tuple[Figure, Figure]:
    """Return commands against measured and true surfaces: the elevator segments, and the others."""
    command = drawn(flown, "/law", "de_cmd", DEG_PER_RAD)
    titles = [f"{words(seg)}, {tech}" for seg, tech in flown.scenario.elevator.technology.items()]
    told = ("Elevator segments, trailing edge down positive. The measured surface is what the monitors read; command "
            "and measurement are drawn thin, below the truth.")  # fmt: skip
    figure = panels(flown, "elevators", told, 470, titles, ["deg"] * len(titles), 2, legend=True)
    figure.layout["margin"] |= {"t": 50}
    figure.layout["legend"]["y"] = 1.05
    for i, (seg, short) in enumerate(flown.scenario.aircraft.short.items(), 1):
        measured, true = (drawn(flown, topic, field, DEG_PER_RAD) for topic, field in (
            (f"/sensors/{seg}", "surface"), ("/truth/aircraft", f"de_{short}")))  # fmt: skip
        _surface(flown, figure, i, (("measured", *measured), ("command", *command), ("true", *true)), i == 2)
    names, told = [words(n) for n in wiring.OTHERS], "Thin: command; blue: true surface."
    others = panels(flown, "others", told, 230, names, ["deg"] * 4, 4)
    for i, name in enumerate(wiring.OTHERS, 1):
        asked, true = (drawn(flown, topic, field, DEG_PER_RAD) for topic, field in (
            ("/law", wiring.COMMAND_OF[name]), ("/truth/aircraft", wiring.SURFACE_OF[name])))  # fmt: skip
        _surface(flown, others, i, (("command", *asked), ("true", *true)), False)
    return figure, others


def _surface(flown, figure, panel, curves, legend):
    look = {"measured": ("--orange", 0.9), "command": ("--muted", 0.9), "true": ("--blue", 1.8)}
    for name, y, step in curves:
        colour, width = look[name]
        shown: dict = {"colour": colour, "width": width, "panel": panel, "showlegend": legend}
        figure.curve(flown.t0, step, y, name=name, **shown)
    figure.least(panel, [y for _, y, _ in curves], 0.5)


def injected(flown: LoggedFlight) -> Figure | None:
    """Return the injected signal of each fault lane, or None without a fault."""
    lanes = flown.injected
    if not lanes:
        return None
    columns = min(2, len(lanes))
    told = "What was injected, in the unit of the place where it enters: the truth that the detectors do not know."
    height, names, units = 66 + 150 * -(-len(lanes) // columns), [n for n, _, _ in lanes], [u for _, u, _ in lanes]
    figure = panels(flown, "faults", told, height, names, units, columns)
    for i, (name, _, (y, every)) in enumerate(lanes, 1):
        figure.curve(flown.t0, flown.dt * every, y, name=name, colour="--fault", panel=i, legend=False)
    return figure


FLOOR = 1e-3  # |r| below this is drawn here: a logarithm has no zero


def detector(flown: LoggedFlight, lanes: list[Lane]) -> Figure:
    """Return the figure of one detector: statistic of every lane over its threshold; estimate with band and truth. It
    has no curve where the detector never judged."""
    heading = f"{lanes[0].id}: {getattr(registry.find(lanes[0].id), 'summary', '')}"
    if not any((lane.r[0] > 0.0).any() for lane in lanes):
        told = "It never judged: its validity flag stayed down throughout."
        return Figure(f"d-{lanes[0].id}", told, heading=heading, detector=lanes[0].id)
    name, main = lanes[0].id, lanes[0].main
    untold = "It gives no fault estimate." if not main else "Its estimate declared no fault in this flight."
    if not any(np.nan_to_num(n.estimate("valid")[0]).any() for n in _estimating(lanes)):
        main = ""  # an estimate that is zero throughout has no panel
    unit, factor = _unit(lanes, main)
    caption = _of_what(name, main) if main else untold
    titles = ["Statistic |r|"] + ([f"Estimate {main}"] if main else [])
    units = ["|r|, threshold 1", unit][: len(titles)]
    figure = panels(flown, f"d-{name}", caption, 272, titles, units, len(titles), legend=True, detector=name,
                    heading=heading)  # fmt: skip
    figure.layout["margin"] |= {"t": 58}
    figure.layout["legend"]["y"] = 1.12  # above the titles: on paper they are as long as it is
    _statistic(figure, flown, lanes)
    if main:
        _estimate(figure, flown, lanes, factor)
    return figure


def _estimating(lanes):
    """Return those that estimate a fault of this flight, all when none does."""
    return [lane for lane in lanes if lane.truth] or (lanes if lanes[0].main else [])


def detectors(flown: LoggedFlight) -> tuple[list[Figure], list[tuple[str, str, bool]]]:
    """Return a figure of every detector that flew, and the page's chips (id, level, whether it alarmed)."""
    lanes: dict[str, list[Lane]] = {}
    for lane in flown.lanes:
        lanes.setdefault(lane.id, []).append(lane)
    chips = [(i, own[0].level, any(lane.entry["alarm"] for lane in own)) for i, own in lanes.items()]
    return [detector(flown, own) for own in lanes.values()], chips


def is_quiet(flown: LoggedFlight, lane: Lane) -> bool:
    """Tell whether the lane watches a part that stayed healthy in a flight with faults, and never alarmed."""
    return bool(flown.faults) and not lane.entry["concerned"] and not lane.entry["alarm"]


def _of_what(detector, field):
    """Return what an estimate and its truth are where that is not what was injected into one part, else ""."""
    own = getattr(registry.find(detector), "estimates", ())
    said = next((e.of for e in own if e.output == field and e.of.startswith("elevator")), "")
    side = f"{said.partition('.')[2]} side" if "." in said else "elevator"
    return f"Estimate and injected truth: mean of the segments of the {side}, not the deflection of one." * bool(said)


def _unit(lanes, main):
    """Return (unit to show, factor) of an estimate: that of the truth, else the one that the log has."""
    if not main:
        return "", 1.0
    known = next((lane.truth[1] for lane in lanes if lane.truth), lanes[0].units.get(main, ""))
    return SHOWN.get(known, ("share" if known == "-" else known, 1.0))


def _statistic(figure, flown, lanes):
    figure.level(1, 1.0)
    sizes = [lane.r for lane in lanes]
    top = max([2.0, *(float(np.nanmax(r)) for r, _ in sizes if np.isfinite(r).any())])
    figure.layout["yaxis"] |= {
        "type": "log",
        "range": [math.log10(FLOOR * 8), math.log10(top * 1.6)],
        "tickvals": [0.01, 0.1, 1, 10, 100, 1000],
        "ticktext": ["0.01", "0.1", "1", "10", "100", "1000"],
    }
    for i, (lane, (r, every)) in enumerate(zip(lanes, sizes)):
        figure.curve(
            flown.t0, flown.dt * lane.every * every, np.maximum(r, FLOOR), name=words(lane.lane),
            colour=COLOURS[i % 8], width=2.0 if lane.entry["concerned"] else 1.1, panel=1,
        )  # fmt: skip


def _estimate(figure, flown, lanes, factor):
    """Draw the estimates, their bands, and the truth."""
    mine = _estimating(lanes)
    for lane in mine:
        (valid, every), colour = lane.estimate("valid"), COLOURS[lanes.index(lane) % 8]
        step = flown.dt * lane.every * every
        low, high = (factor * lane.estimate(end)[0] for end in ("low", "high"))
        if np.isfinite(low).any():
            _band(figure, flown.t0, step, low, high, colour)
        for y, shade, width in ((lane.estimate("not_valid")[0], "--line", 1.0), (valid, colour, 1.4)):
            if np.isfinite(y).any():
                figure.curve(
                    flown.t0, step, factor * y, name=f"estimate {words(lane.lane)}", colour=shade, width=width, panel=2,
                    showlegend=False,
                )  # fmt: skip
    seen = [factor * lane.estimate("all")[0] for lane in [n for n in mine if n.able] or mine]
    truth = next((lane.truth[0] for lane in mine if lane.truth), None)
    if truth is not None:
        seen.append(factor * truth[0])
        look: dict = {"colour": "--ink", "dash": "dot", "width": 1.6}
        figure.curve(flown.t0, flown.dt * truth[1], seen[-1], name="injected truth", panel=2, **look)
    figure.least(2, seen, 1e-6)


def _band(figure, t0, step, low, high, colour):
    """Shade from `low` to `high`: the band must not be narrower than its samples, so its edges are extremes."""
    for y, fill in ((low, None), (high, "tonexty")):
        shade = {"fill": fill, "fillcolor": f"{colour}/0.22"} if fill else {}
        line, of = {"width": 0, "color": colour}, {"x0": t0, "dx": step, "y": packed(y)}
        figure.points(2, mode="lines", line=line, hoverinfo="skip", **of, **shade)


def timeline(flown: LoggedFlight) -> tuple[Figure, list[dict], list[dict]]:
    """Return all alarms on one time line: a row per lane, thick where it alarms, pale where it cannot judge."""
    hollow, top = "; hollow bars: false alarms", (" The topmost bars: the faults. Lanes of healthy parts that never "
                                                  "alarmed are not drawn.")  # fmt: skip
    if not flown.knows_faults:
        hollow = top = ""
    figure = Figure(
        "timeline",
        f"Thick bars: alarms, with the last name and when it first came, if later; of close ones the "
        f"longest is named{hollow}. Thin lines: the detector "
        f"watches and is quiet; gaps: its estimate is not valid.{top} Click a detector in the bar above to hide it.",
    )
    figure.layout = base(300, legend=False) | {"margin": {"l": 190, "r": 14, "t": 8, "b": 40}, "hovermode": "closest"}
    figure.layout["xaxis"] = style_axis("time, s", range=[flown.t0, flown.end])
    figure.layout["yaxis"] = style_axis("", type="category", ticklabelstandoff=4) | {
        "gridcolor": "rgba(0,0,0,0)",
        "tickfont": {"size": 11.5, "color": "--ink"},
    }
    figure.bands(flown.intervals, 1)
    figure.rows, alarms, faults = [], [], []
    met = {(f.kind, f.target) for f in flown.scenario.faults}
    for f, told in zip(flown.scenario.faults, flown.faults):
        where = f", {words(f.target.removeprefix('elevator.'))}" * (sum(f.kind == kind for kind, _ in met) > 1)
        row, end = f"fault: {words(f.kind)}{where}", min(told["end_s"], flown.end)
        if row not in [r["name"] for r in figure.rows]:
            figure.rows.append({"name": row, "detector": ""})
        _bar(figure, row, f.start_s, end, "--ink", 9, f"{words(f.kind)} on {words(f.target)}")
        faults.append({"from": f.start_s, "to": end, "text": f"{words(f.kind)} on {words(f.target)}"})
    for lane in (n for n in flown.lanes if not is_quiet(flown, n)):
        figure.rows.append({"name": lane.name, "detector": lane.id})
        alarms += _row(figure, flown, lane)
    figure.layout["margin"]["l"] = max([190, *(round(6.5 * len(row["name"])) for row in figure.rows)])
    figure.height = 22 * len(figure.rows) + 70
    figure.layout["height"] = figure.height
    return figure, alarms, faults


def _bar(figure, row, a, b, colour, width, told, who=None):
    line, hover = {"color": colour, "width": width}, f"{told}<br>%{{x:.3f}} s<extra></extra>"
    figure.points(1, mode="lines", x=[a, b], y=[row] * 2, line=line, name=told, detector=who, hover=hover)


def _row(figure, flown, lane):
    """Draw one lane; return its alarms for the cursor's line."""
    step, out = flown.dt * lane.every, []
    for a, b in joined(lane.spans("valid", flown.t0), (flown.end - flown.t0) / POINTS):
        _bar(figure, lane.name, a, b, "--line", 1.5, f"{lane.name}: watching", lane.id)
    labels, alarms = [], list(lane.said.spans("alarm"))
    for (first, stop), true in zip(alarms, _real(flown, lane, step, [first for first, _ in alarms])):
        a, b = flown.t0 + first * step, flown.t0 + stop * step
        said = _said(lane, first, stop, a, step)
        out.append(
            {"from": a, "to": b, "text": f"{lane.name} ({said}{'' if true else ', false'})", "detector": lane.id}
        )
        told = f"{lane.name}: alarm {a:.3f} to {b:.3f} s, {said}{'' if true else ', false alarm'}"
        _bar(figure, lane.name, a, b, "--fault" if true else "--gold", 11, told, lane.id)
        if not true:  # hollow: also without colour it is another thing
            _bar(figure, lane.name, a, b, "--page", 5, told, lane.id)
        labels.append((a, b, said))
    _labels(figure, flown, lane, labels)
    return out


def _said(lane, first, stop, start, step):
    """Return the name at the end of an alarm of the ticks first <= k < stop, which begins at `start` [s], and, where it
    came later, since when."""
    named = Heard(Runs(lane.said, (), step), NO_FAULT, (), step).given(first, stop)
    if not named:
        return "alarm, no name"
    if (last := name_at_end(named, step)) is None:
        return "alarm, names in turn"
    since = next(w.first - first for w in named if w.said == last.said)
    told = f" from {start + since * step:.2f} s" if since else ""
    verdict, part = last.said
    return f"{words(class_name(verdict))} {words(part)}".strip() + told


def _labels(figure, flown, lane, alarms):
    """Write the verdict on its bar, right of the bar's beginning; of bars without room between them that of the
    longest. A text that would pass the right edge of a narrow page ends before the bar, or with the axis."""
    near: list[list] = []
    span = flown.end - flown.t0
    for alarm in alarms:
        if near and alarm[0] - near[-1][0][0] < span / 8:
            near[-1].append(alarm)
        else:
            near.append([alarm])
    for a, _, said in (max(own, key=lambda alarm: alarm[1] - alarm[0]) for own in near):
        room = span * LETTER * len(said)
        side = {"xanchor": "left", "xshift": 12} if a + room < flown.end else {"xanchor": "right", "xshift": -3}
        a = flown.end if a + room >= flown.end and a - room < flown.t0 else a  # on its bar, not on its lane's name
        look = {"font": {"size": 11, "color": "--ink"}, "bgcolor": "--page", "borderpad": 1}  # watching runs behind it
        told = {"text": said, "x": a, "y": lane.name, "showarrow": False, "detector": lane.id}
        figure.layout["annotations"].append({**told, **side, **look})


def _real(flown, lane, step, rises):
    """Return, for each of the ticks `rises` (n,), whether an alarm of the lane that rises there is a true one."""
    own = [f for f in flown.faults if concerns(lane, f["targets"])]
    return during(own, rises, step, flown.t0).tolist() if flown.knows_faults else [True] * len(rises)
