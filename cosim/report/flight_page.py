"""The page of one flight: summary, time line, table, figures, provenance."""

from pathlib import Path

from cosim.judge import lanes, narrator
from cosim.replay import log_schema
from cosim.replay.recording import LoggedFlight
from cosim.report import flight
from cosim.report.page import page, write
from cosim.table import Cell, Row, Table
from fdi import registry


def flight_report(log: str | Path, output: str | Path) -> Path:
    """Write the report of the log at `log` to the file `output`; returns its Path. Raises LogError, OutputError."""
    return write(output, render(LoggedFlight(log)))


def render(flown: LoggedFlight) -> str:
    """Return the page of a logged flight as HTML text."""
    line, alarms, faults = flight.timeline(flown)
    elevators, others = flight.surfaces(flown)
    injected, motion, track = flight.injected(flown), flight.motion(flown), flight.track(flown)
    own, chips = flight.detectors(flown)
    start = flown.intervals[0][0] if flown.intervals else (flown.t0 + flown.end) / 2
    title = flown.scenario.title or "Flight"
    provenance = [Row((k, Cell(v, "code"))) for k, v in flown.provenance.items()]
    return page(
        "flight.html", title=title, subtitle=narrator.point(flown.scenario), summary=summary(flown), line=line,
        names_key=lanes.KEY, lanes=lanes.table([lane.entry for lane in flown.lanes], flown.cases), injected=injected,
        detectors=[(own[i], f"{i}: {getattr(registry.find(i), 'summary', '')}") for i in own], elevators=elevators,
        others=others, motion=motion, track=track,
        damage=[f"{d.length} bytes at {d.offset}: {d.reason}" for d in flown.log.damage],
        provenance=Table("", "", "", rows=provenance, kind="", heads=False), toml=flown.toml,
        figures=[line, injected, *own.values(), elevators, others, motion, track], chips=chips,
        span=[flown.t0, flown.end], start=start, faults=faults, alarms=alarms,
    )  # fmt: skip


def summary(flown: LoggedFlight) -> list[tuple[str, list]]:
    """Return the summary: [(heading, [sentences])]; the first sentence is that of `cosim run`."""
    lost = log_schema.not_run(flown.log)
    found = {"detectors": [lane.entry for lane in flown.lanes], "sim_time_s": flown.end, "achieved": flown.achieved,
             "not_run": lost}  # fmt: skip
    s, status = flown.scenario, (flown.log.result or {}).get("status", "incomplete: the log ends early")
    broken = [". ".join(filter(None, line)) for line in narrator.faults(s, flown.achieved)]
    rows = [
        ("In short", narrator.sentences(found, s)),
        ("Flown", [f"{flown.end - flown.t0 + flown.dt:.1f} s: {narrator.point(s)}; {status}"]),
        ("Broken", broken or ["nothing: every alarm below is a false one"]),
    ]
    if broken:
        rows += [("Noticed", narrator.noticed(found, s) or ["by nobody"]), ("Missed", narrator.silent(found, s))]
    if lost:
        rows.append(("Not run", [f"{name}: {why}" for name, why in lost.items()]))
    return [*rows, ("False alarms", [*narrator.false(found), *narrator.apart(found)])]
