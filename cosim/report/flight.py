"""Figures of one flight: path, motion, surfaces, and what was injected."""

from typing import Any

import numpy as np

from actuators.constants import DEG_PER_RAD, FT_PER_M, KT_PER_M_S
from cosim.flight.loop import wiring
from cosim.replay.recording import LoggedFlight, words
from cosim.report.figure import (
    COLOURS,
    DASHES,
    Figure,
    axis,
    bands,
    base,
    curve,
    envelope,
    grid,
    label,
    least,
    packed,
    place,
    points,
)

RATES = (("yaw", "r"), ("roll", "p"), ("pitch", "q"))  # in the order of drawing, and their fields
EARTH = 6_371_000.0  # mean radius [m]: the track is drawn on a local plane


def panels(
    flown: LoggedFlight, figure: Figure, titles: list[str], units: list[str], columns: int, legend: bool = True
) -> Figure:
    """Lay out time panels over the whole flight with its faults shaded; returns the figure."""
    figure.layout = base(figure.height, legend)
    grid(figure.layout, titles, units, columns, span=(flown.t0, flown.end))
    bands(figure.layout, flown.intervals, len(titles))
    return figure


def drawn(flown: LoggedFlight, topic: str, field: str, factor: float = 1.0, add: float = 0.0) -> tuple[Any, float]:
    """Return (samples of a logged signal, seconds between two) as its curve needs them: the signal itself is let go."""
    y, every = envelope(flown.values(topic, field))
    return factor * y + add, flown.dt * every


def motion(flown: LoggedFlight) -> Figure:
    """Return altitude, airspeed, load factor, angle of attack, attitude and rates."""
    truth, deg = "/truth/aircraft", DEG_PER_RAD  # each curve: name, topic, field, factor, what is added
    shown: list[tuple[str, str, float, list[tuple[str, str, str, float, float]]]] = [
        ("Altitude", "ft", 100.0, [("", truth, "h", FT_PER_M, 0.0)]),
        ("Airspeed, calibrated", "kt", 2.0, [("", truth, "cas", KT_PER_M_S, 0.0)]),
        ("Load factor", "g", 0.1, [("demanded", "/pilot", "nz_dem", 1.0, 1.0), ("flown", truth, "nz", 1.0, 0.0)]),
        ("Angle of attack", "deg", 0.5, [("measured", "/sensors/aircraft", "alpha", deg, 0.0),
                                         ("true", truth, "alpha", deg, 0.0)]),
        ("Attitude", "deg", 1.0, [("pitch", truth, "theta", deg, 0.0), ("bank", truth, "phi", deg, 0.0)]),
        ("Rates", "deg/s", 0.5, [(name, truth, field, deg, 0.0) for name, field in RATES]),
    ]  # fmt: skip
    figure = Figure("motion", "Shaded: a fault is active.", 560)
    figure.hint = "Drag to zoom in time, double-click to see all; every figure follows."
    panels(flown, figure, [p[0] for p in shown], [p[1] for p in shown], 2, legend=False)
    for i, (_, _, half, curves) in enumerate(shown, 1):
        made = [(name, *drawn(flown, topic, field, factor, add)) for name, topic, field, factor, add in curves]
        for j, (name, y, step) in enumerate(reversed(made)):
            look: dict = {"colour": COLOURS[(0, 4, 2)[j]], "dash": DASHES[(0, 0, 2)[j]], "width": (1.6, 1.1, 1.4)[j]}
            figure.data.insert(0, curve(flown.t0, step, y, name=name, panel=i, legend=False, **look))
        least(figure.layout, i, [y for _, y, _ in made], half)
        _inline_legend(figure, i)
    return figure


def _inline_legend(figure, panel):
    """Write the names of a panel's curves above it, in their colours."""
    named = [(t["line"], n) for t in figure.data if t["xaxis"] == place(panel)["xaxis"] for n in [t["name"]] if n]
    at = {"x": figure.layout[axis("xaxis", panel)]["domain"][1], "y": figure.layout[axis("yaxis", panel)]["domain"][1]}
    for k, (line, name) in enumerate(reversed(named)):
        mark = "─" if line["dash"] == "solid" else "┄"
        look: dict = {"xanchor": "right", "xshift": -84 * k, "font": {"size": 11, "color": line["color"]}}
        label(figure.layout, f"{mark} {name}", **at, **look)


def track(flown: LoggedFlight) -> Figure:
    """Return the path over ground and in height; the part flown with a fault is drawn in its colour."""
    pick = np.unique(np.linspace(0, len(flown.ticks) - 1, 400).astype(int))
    lat, lon, h = (flown.values("/truth/aircraft", n)[pick] for n in ("lat", "lon", "h"))
    north, east = EARTH * (lat - lat[0]) / 1e3, EARTH * np.cos(lat[0]) * (lon - lon[0]) / 1e3
    along, height = np.hypot(north, east), FT_PER_M * h
    t = flown.t0 + flown.dt * pick
    broken = np.zeros(len(t), bool)
    for a, b in flown.intervals:
        broken |= (t >= a) & (t <= b)
    figure = Figure("track", "Thick: flown with a fault.", 250, time=False)
    figure.hint = "The dot is where the aircraft is at the time cursor."
    figure.layout = base(figure.height, legend=False) | {"hovermode": "closest"}
    titles = ["Path over ground, seen from above", "Height along the path"]
    grid(figure.layout, titles, ["north, km", "ft"], 2, time=False)
    figure.layout["xaxis"]["title"]["text"] = "east, km"
    figure.layout["xaxis2"]["title"]["text"] = "distance from the start, km"
    for i, (x, y) in enumerate(((east, north), (along, height)), 1):
        for mask, colour, width in ((np.ones(len(t), bool), "--blue", 2.0), (broken, "--fault", 3.0)):
            line, xs, ys = {"color": colour, "width": width}, packed(x), packed(np.where(mask, y, np.nan))
            figure.data.append(points(i, mode="lines", x=xs, y=ys, line=line, hoverinfo="x+y"))
    figure.layout["yaxis"] |= {"scaleanchor": "x", "constrain": "domain"}
    least(figure.layout, 2, [height], 200.0)
    figure.track = [
        {"x": np.round(x, 4).tolist(), "y": np.round(y, 4).tolist()}
        for x, y in ((east, north), (along, height))
    ]
    return figure


def surfaces(flown: LoggedFlight) -> tuple[Figure, Figure]:
    """Return commands against measured and true surfaces: the elevator segments, and the others."""
    command = drawn(flown, "/law", "de_cmd", DEG_PER_RAD)
    titles = [f"{words(seg)}, {tech}" for seg, tech in flown.scenario.elevator.technology.items()]
    figure = Figure(
        "elevators",
        "Elevator segments, trailing edge down positive. The measured surface is what the monitors read; command and "
        "measurement are drawn thin, below the truth.",
        470,
    )
    panels(flown, figure, titles, ["deg"] * len(titles), 2)
    figure.layout["margin"] |= {"t": 50}
    figure.layout["legend"]["y"] = 1.05
    for i, (seg, short) in enumerate(flown.scenario.aircraft.short.items(), 1):
        measured, true = (drawn(flown, topic, field, DEG_PER_RAD) for topic, field in (
            (f"/sensors/{seg}", "surface"), ("/truth/aircraft", f"de_{short}")))  # fmt: skip
        _surface(flown, figure, i, (("measured", *measured), ("command", *command), ("true", *true)), i == 2)
    others = Figure("others", "Thin: command; blue: true surface.", 230)
    pairs = [(words(n), wiring.COMMAND_OF[n], wiring.SURFACE_OF[n]) for n in wiring.OTHERS]
    panels(flown, others, [p[0] for p in pairs], ["deg"] * 4, 4, legend=False)
    for i, (_, demanded, short) in enumerate(pairs, 1):
        asked, true = (drawn(flown, topic, field, DEG_PER_RAD) for topic, field in (
            ("/law", demanded), ("/truth/aircraft", short)))  # fmt: skip
        _surface(flown, others, i, (("command", *asked), ("true", *true)), False)
    return figure, others


def _surface(flown, figure, panel, curves, legend):
    look = {"measured": ("--orange", 0.9), "command": ("--muted", 0.9), "true": ("--blue", 1.8)}
    for name, y, step in curves:
        colour, width = look[name]
        shown: dict = {"colour": colour, "width": width, "panel": panel, "showlegend": legend}
        figure.data.append(curve(flown.t0, step, y, name=name, **shown))
    least(figure.layout, panel, [y for _, y, _ in curves], 0.5)


def injected(flown: LoggedFlight) -> Figure | None:
    """Return the injected signal of each fault lane, or None without a fault."""
    lanes = flown.injected
    if not lanes:
        return None
    columns = min(2, len(lanes))
    figure = Figure(
        "faults",
        "What was injected, in the unit of the place where it enters: the truth that the detectors do not know.",
        66 + 150 * -(-len(lanes) // columns),
    )
    panels(flown, figure, [n for n, _, _ in lanes], [u for _, u, _ in lanes], columns, legend=False)
    for i, (name, _, signal) in enumerate(lanes, 1):
        figure.data.append(curve(flown.t0, flown.dt, signal(), name=name, colour="--fault", panel=i, legend=False))
    return figure
