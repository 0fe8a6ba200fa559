"""Statistic and estimate of one detector."""

import math

import numpy as np

from cosim.judge.lanes import SHOWN
from cosim.replay.recording import Lane, LoggedFlight, words
from cosim.report.figure import COLOURS, Figure, curve, envelope, least, level, packed, peaks, points
from cosim.report.flight import panels
from fdi import registry

FLOOR = 1e-3  # |r| below this is drawn here: a logarithm has no zero


def detector(flown: LoggedFlight, lanes: list[Lane]) -> Figure | None:
    """Return the figure of one detector: statistic of every lane over its threshold; estimate with band and truth.

    None where it never judged: there is nothing to draw.
    """
    if not any((np.abs(lane.fields["r"]) > 0.0).any() for lane in lanes):
        return None
    estimates = [n for n in lanes[0].fields if n.startswith("f_hat")]
    figure = Figure(f"d-{lanes[0].id}", "", 272, detector=lanes[0].id)
    main = next((lane.truth[0] for lane in lanes if lane.truth), estimates[0] if estimates else None)
    mine = [lane for lane in lanes if lane.truth] or lanes
    untold = "It gives no fault estimate." if not estimates else "Its estimate declared no fault in this flight."
    if not any(_estimates(lane, main) for lane in mine):
        main = None
    unit, factor = _unit(lanes, main)
    figure.caption = _of_what(lanes[0].id, main) if main else untold
    titles = ["Statistic |r|"] + ([f"Estimate {main}"] if main else [])
    panels(flown, figure, titles, ["|r|, threshold 1", unit][: len(titles)], len(titles))
    figure.layout["margin"] |= {"t": 58}
    figure.layout["legend"]["y"] = 1.12  # above the titles: on paper they are as long as it is
    _statistic(figure, flown, lanes)
    if main:
        _estimate(figure, flown, lanes, main, factor)
    return figure


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
    known = next((lane.truth[2] for lane in lanes if lane.truth), lanes[0].units.get(main, ""))
    return SHOWN.get(known, ("share" if known == "-" else known, 1.0))


def _estimates(lane, main):
    """Tell whether a lane estimated anything: an estimate that is zero throughout has no panel."""
    return bool(main and np.any((lane.fields[main] != 0.0) & (lane.fields["valid"] > 0.5)))


def _statistic(figure, flown, lanes):
    level(figure.layout, 1, 1.0)
    sizes = [peaks(np.abs(lane.fields["r"])) for lane in lanes]
    top = max([2.0, *(float(np.nanmax(r)) for r, _ in sizes if np.isfinite(r).any())])
    figure.layout["yaxis"] |= {
        "type": "log",
        "range": [math.log10(FLOOR * 8), math.log10(top * 1.6)],
        "tickvals": [0.01, 0.1, 1, 10, 100, 1000],
        "ticktext": ["0.01", "0.1", "1", "10", "100", "1000"],
    }
    for i, (lane, (r, every)) in enumerate(zip(lanes, sizes)):
        figure.data.append(
            curve(
                flown.t0, flown.dt * lane.every * every, np.maximum(r, FLOOR), name=words(lane.lane),
                colour=COLOURS[i % 8], width=2.0 if lane.entry["concerned"] else 1.1, panel=1,
            )
        )  # fmt: skip


def _estimate(figure, flown, lanes, main, factor):
    """Draw the estimate of the lanes that estimate a fault of this flight, of all when none does."""
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
                figure.data.append(
                    curve(
                        flown.t0, step, np.where(part, f, np.nan), name=f"estimate {words(lane.lane)}", colour=colour,
                        width=width, panel=2, showlegend=False,
                    )
                )  # fmt: skip
    seen = [envelope(lane.fields[main])[0] * factor for lane in [n for n in mine if n.able] or mine]
    truth = next((lane.truth[1] for lane in mine if lane.truth), None)
    if truth is not None:
        y, every = envelope(truth())
        seen.append(y * factor)
        look: dict = {"colour": "--ink", "dash": "dot", "width": 1.6}
        figure.data.append(curve(flown.t0, flown.dt * every, seen[-1], name="injected truth", panel=2, **look))
    least(figure.layout, 2, seen, 1e-6)


def _band(figure, t0, step, f, half, colour):
    """Shade f +- half: the band must not be narrower than its samples, so its edges are the envelopes' extremes."""
    for y, fill in ((f - half, None), (f + half, "tonexty")):
        values, every = envelope(y)
        shade = {"fill": fill, "fillcolor": f"{colour}/0.22"} if fill else {}
        line, of = {"width": 0, "color": colour}, {"x0": t0, "dx": step * every, "y": packed(values)}
        figure.data.append(points(2, mode="lines", line=line, hoverinfo="skip", **of, **shade))
