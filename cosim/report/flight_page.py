"""The page of one flight: summary, time line, table, figures, provenance."""

from pathlib import Path

from cosim.judge import coverage
from cosim.replay.recording import LoggedFlight, finite, words
from cosim.report import flight
from cosim.report.detector import SHOWN, detector
from cosim.report.page import Row, Table, bold, code, mark, page, write
from cosim.report.timeline import timeline
from cosim.report.words import JUDGED, MARKS, came_of_it, case_of, entries, point, summary, verdict
from fdi import registry


def flight_report(log: str | Path, output: str | Path) -> Path:
    """Write the report of the log at `log` to the file `output`; returns its Path. Raises LogError, OutputError."""
    flown = LoggedFlight(log)
    return write(output, render(flown))


def render(flown: LoggedFlight) -> str:
    """Return the page of a logged flight as HTML text."""
    line, alarms, faults = timeline(flown)
    elevators, others = flight.surfaces(flown)
    injected, motion, track = flight.injected(flown), flight.motion(flown), flight.track(flown)
    ids = list(dict.fromkeys(lane.id for lane in flown.lanes))
    own = {i: detector(flown, [lane for lane in flown.lanes if lane.id == i]) for i in ids}
    figures = [line, injected, *own.values(), elevators, others, motion, track]
    loud = {lane.id for lane in flown.lanes if lane.entry["alarm"]}
    chips = [(i, next(lane.level for lane in flown.lanes if lane.id == i), i in loud) for i in ids]
    start = flown.intervals[0][0] if flown.intervals else (flown.t0 + flown.end) / 2
    title = flown.scenario.title or "Flight"
    return page(
        "flight.html",
        title=title,
        subtitle=point(flown.scenario),
        summary=summary(flown),
        line=line,
        lanes=metrics(flown),
        injected=injected,
        detectors=[(own[i], f"{i}: {getattr(registry.find(i), 'summary', '')}") for i in ids],
        elevators=elevators,
        others=others,
        motion=motion,
        track=track,
        damage=[f"{d.length} bytes at {d.offset}: {d.reason}" for d in flown.log.damage],
        provenance=Table(("", ""), [Row((k, code(v))) for k, v in flown.provenance.items()]),
        toml=flown.toml,
        figures=figures,
        chips=chips,
        span=[flown.t0, flown.end],
        start=start,
        faults=faults,
        alarms=alarms,
    )


def metrics(flown: LoggedFlight) -> Table:
    """Return the table of all lanes, with several faults a row for each that a lane could notice."""
    several = len(flown.faults) > 1
    columns = (
        "detector",
        "watches",
        *(["fault"] if several else []),
        "to this fault",
        "delay, s>",
        "periods>",
        "right name, s>",
        "first said",
        "last said",
        "judged",
        "valid>",
        "false>",
        "standing, s>",
        "|r| before>",
        "after>",
        "RMSE>",
        "bias>",
    )
    rows = []
    for lane, e in [(own, e) for own in flown.lanes for e in entries(own)]:
        case, how = case_of(flown, e), came_of_it(flown, lane, e)
        word = coverage.WORDS[coverage.expected(lane.id, case).word] if case else "–"
        cells = (
            bold(lane.id),
            "aircraft" if lane.level == "aircraft" else words(lane.lane),
            *([f"{e['fault']}" if case else "–"] if several else []),
            word,
            number(e["detection_delay_s"]),
            number(e["detection_delay_periods"], 2),
            number(e["time_to_right_s"]),
            e["first_verdict"]["class"] if e["first_verdict"] else "–",
            verdict(e) if e["isolated"] else "–",
            _judged(e, how),
            f"{e['valid_share']:.0%}",
            mark(e["false_alarms"], "bad" if e["false_alarms"] else ""),
            number(e["standing_s"]) if e["standing_s"] else "",
            number(e["r_max_before"]),
            number(e["r_max_after"]),
            *estimate(e),
        )
        rows.append(Row(cells, {"class": None if e["alarm"] else "quiet", "data-detector": lane.id}))
    note = (
        "Delays count from the onset of the fault; an alarm counts for the latest one that the lane could notice. |r|: "
        "largest statistic before and after the first fault; 1 is the threshold, "
        "before confirmation. RMSE and bias: of the estimate against what was injected, after settling. What a "
        "detector is designed for stands in the detectors' records in fdi/; “not valid” means that it missed, and that "
        "its own validity flag was down for most of the fault; valid: share of the flight "
        "from 8 s on. Standing: alarm seconds without a fault."
    )
    return Table(columns, rows, note, "wide")


def _judged(e, how):
    """Return what came of an entry, in words: of one that could not judge, why."""
    if how is None:
        return "healthy part"
    why = f": {e['why_not_valid']}" if how == "idle" and e["why_not_valid"] else ""
    excited = "not excited, " if e["not_excited"] else ""
    return mark(f"{excited}{JUDGED[how]}{why}", MARKS.get(how, ""))


def number(x: float | None, digits: int = 3) -> str:
    """Return a few digits, or a dash."""
    return f"{x:.{digits}g}" if finite(x) else "–"


def estimate(e: dict) -> tuple[str, ...]:
    """Return RMSE and bias of an estimate with its unit."""
    if e["estimate_rmse"] is None:
        return "–", "–"
    unit, factor = SHOWN.get(e["estimate_unit"], (e["estimate_unit"], 1.0))
    return tuple(f"{e[k] * factor:.3g} {unit.split(',')[0]}" for k in ("estimate_rmse", "estimate_bias"))
