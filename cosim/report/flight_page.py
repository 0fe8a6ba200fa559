"""The page of one flight: summary, time line, table, figures, provenance."""

from cosim.judge import coverage
from cosim.replay.recording import Flown, finite, words
from cosim.report import flight
from cosim.report.detector import SHOWN, detector
from cosim.report.page import drawing, page, table, text, write
from cosim.report.timeline import timeline
from cosim.report.words import JUDGED, MARKS, came_of_it, case_of, entries, point, summary, verdict
from cosim.scenario.catalog import DETECTORS


def flight_report(log, output):
    """Write the report of the log at `log` to the file `output`; returns its Path. Raises LogError, OutputError."""
    flown = Flown(log)
    return write(output, render(flown))


def render(flown):
    """Return the page of a Flown as HTML text."""
    line, alarms, faults = timeline(flown)
    elevators, others = flight.surfaces(flown)
    injected, motion, track = flight.injected(flown), flight.motion(flown), flight.track(flown)
    ids = list(dict.fromkeys(lane.id for lane in flown.lanes))
    own = {i: detector(flown, [lane for lane in flown.lanes if lane.id == i]) for i in ids}
    body = [
        "<h2>Who noticed, and when</h2>",
        drawing(line),
        metrics(flown),
        "<h2>The fault, as injected</h2>" + drawing(injected) if injected else "",
        "<h2>Detectors</h2><p class=muted>Left: the largest test statistic of each lane within intervals of a "
        "600th of the flight, on a logarithmic scale; thick: the lane of the faulty part. The dashed line is "
        "the threshold, an alarm "
        "needs it to be crossed for the detector's confirmation time. Right: the fault estimate with its "
        "two-sigma band where the detector gives one, "
        "and the injected truth where both have the same unit; pale: not valid by its own flag.</p>",
        *(drawing(own[i], f"{i}: {DETECTORS[i][1] if i in DETECTORS else ''}") for i in ids),
        "<h2>Elevators: command, true and measured surface</h2>",
        drawing(elevators),
        "<h2>Other surfaces</h2>",
        drawing(others),
        "<h2>The flight</h2>",
        drawing(motion),
        drawing(track),
        provenance(flown),
    ]
    figures = [f for f in (line, injected, *own.values(), elevators, others, motion, track) if f]
    loud = {lane.id for lane in flown.lanes if lane.entry["alarm"]}
    chips = [(i, next(lane.level for lane in flown.lanes if lane.id == i), i in loud) for i in ids]
    start = flown.intervals[0][0] if flown.intervals else (flown.t0 + flown.end) / 2
    title = flown.scenario.title or "Flight"
    return page(
        title=title,
        subtitle=point(flown.scenario),
        summary=summary(flown),
        body="".join(body),
        figures=figures,
        chips=chips,
        span=[flown.t0, flown.end],
        start=start,
        faults=faults,
        alarms=alarms,
    )


def metrics(flown):
    """Return the table of all lanes, with several faults a row for each that a lane could notice."""
    several = len(flown.faults) > 1
    columns = (
        "detector",
        "watches",
        *(["fault"] if several else []),
        "to this fault",
        "delay, s>",
        "periods>",
        "said",
        "judged",
        "false>",
        "|r| before>",
        "after>",
        "RMSE>",
        "bias>",
    )
    rows = []
    for lane, e in [(own, e) for own in flown.lanes for e in entries(own)]:
        case, how = case_of(flown, e), came_of_it(flown, lane, e)
        word = coverage.WORDS[coverage.expected(lane.id, case).word] if case else "–"
        wrong = f'<span class="bad">{e["false_alarms"]}</span>' if e["false_alarms"] else "0"
        said = text(verdict(e)) if e["isolated"] else "–"
        judged = f'<span class="{MARKS.get(how, "")}">{JUDGED[how]}</span>' if how else "healthy part"
        cells = (
            f"<b>{text(lane.id)}</b>",
            text("aircraft" if lane.level == "aircraft" else words(lane.lane)),
            *([f"{e['fault']}" if case else "–"] if several else []),
            word,
            number(e["detection_delay_s"]),
            number(e["detection_delay_periods"], 2),
            said,
            judged,
            wrong,
            number(e["r_max_before"]),
            number(e["r_max_after"]),
            *estimate(e),
        )
        quiet = "" if e["alarm"] else ' class="quiet"'
        rows.append((cells, f'{quiet} data-detector="{text(lane.id)}"'))
    note = (
        "Delays count from the onset of the fault; an alarm counts for the latest one that the lane could notice. |r|: "
        "largest statistic before and after the first fault; 1 is the threshold, "
        "before confirmation. RMSE and bias: of the estimate against what was injected, after settling. What a "
        "detector is designed for stands in "
        "fdi/expected.toml; “cannot judge” means that its own validity flag was down when the fault began."
    )
    return table(columns, rows, caption=note, classes="wide")


def number(x, digits=3):
    """Return a few digits, or a dash."""
    return f"{x:.{digits}g}" if finite(x) else "–"


def estimate(e):
    """Return RMSE and bias of an estimate with its unit."""
    if e["estimate_rmse"] is None:
        return "–", "–"
    unit, factor = SHOWN.get(e["estimate_unit"], (e["estimate_unit"], 1.0))
    return tuple(f"{e[k] * factor:.3g} {text(unit.split(',')[0])}" for k in ("estimate_rmse", "estimate_bias"))


def provenance(flown):
    """Return versions, hashes and the scenario."""
    rows = [((f"{text(k)}", f"<code>{text(v)}</code>"), "") for k, v in flown.provenance.items()]
    damage = [f"{d.length} bytes at {d.offset}: {d.reason}" for d in flown.log.damage]
    lost = f'<p class="bad">Parts of the log are lost: {text("; ".join(damage))}</p>' if damage else ""
    return (
        f"<h2>Provenance</h2>{lost}{table(('', ''), rows)}<p class=muted>Curves of more than 2,000 samples are "
        f"drawn as the smallest and the largest "
        "value of each of 1,000 intervals: no peak is lost. Angles in degrees, heights in feet, speeds in "
        "knots; the log is in SI.</p>"
        f'<details class="source"><summary>scenario.toml, ready to fly '
        f"again</summary><pre>{text(flown.toml)}</pre></details>"
    )
