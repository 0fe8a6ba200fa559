"""The page of one flight: summary, time line, table, figures, provenance."""

from pathlib import Path

from cosim.judge import lanes, narrator
from cosim.replay import log_schema
from cosim.replay.recording import LoggedFlight
from cosim.report import flight
from cosim.report.page import page, write
from cosim.table import Cell, Row, Table

OPENS_S = 3.0  # after the first onset: most detectors have alarmed, the cursor shows what they said
DETECTORS = (
    "Left: the largest test statistic of each lane within intervals of a 600th of the flight, on a logarithmic scale; "
    "thick: the lane of the faulty part. The dashed line is the threshold, an alarm needs it to be crossed for the "
    "detector's confirmation time. Right: the fault estimate with its two-sigma band where the detector gives one, and "
    "the injected truth where both have the same unit; pale: not valid by its own flag."
)
DRAWN = (
    "Curves of more than 2,000 samples are drawn as the smallest and the largest value of each of 1,000 intervals: no "
    "peak is lost. Angles in degrees, heights in feet, speeds in knots; the log is in SI."
)


def flight_report(log: str | Path, output: str | Path) -> Path:
    """Write the report of the log at `log` to the file `output`; returns its Path. Raises LogError, OutputError."""
    return write(output, render(LoggedFlight(log)))


def render(flown: LoggedFlight) -> str:
    """Return the page of a logged flight as HTML text."""
    line, alarms, faults = flight.timeline(flown)
    elevators, others = flight.surfaces(flown)
    own, chips = flight.detectors(flown)
    loud, quiet = ([n.entry for n in flown.lanes if flight.is_quiet(flown, n) == q] for q in (False, True))
    lost = ["{bytes} bytes at {offset}: {reason}".format(**d) for d in flown.log.damage]
    provenance = Table("", "", "", rows=[Row((k, Cell(v, "code"))) for k, v in flown.provenance.items()], kind="",
                       heads=False)  # fmt: skip
    folded = {"title": f"{len(quiet)} lanes of healthy parts stayed quiet", "content": lanes.table(quiet, flown.cases)}
    sections: list[tuple[str, list]] = [
        ("Who noticed, and when", [line, lanes.KEY, lanes.table(loud, flown.cases), folded if quiet else None]),
        ("The fault, as injected", [flight.injected(flown)]),
        ("Detectors", [DETECTORS, *own]),
        ("Elevators: command, true and measured surface", [elevators]),
        ("Other surfaces", [others]),
        ("The flight", [flight.motion(flown), flight.track(flown)]),
        ("Provenance", [f"Parts of the log are lost: {'; '.join(lost)}" if lost else None, provenance, DRAWN,
                        {"title": "scenario.toml, ready to fly again", "source": flown.toml}]),
    ]  # fmt: skip
    onset = flown.intervals[0][0] if flown.intervals else (flown.t0 + flown.end) / 2
    return page(
        title=flown.scenario.title or "Flight", subtitle=narrator.point(flown.scenario), summary=summary(flown),
        sections=sections, chips=chips, span=[flown.t0, flown.end], start=min(onset + OPENS_S, flown.end),
        faults=faults, alarms=alarms,
    )  # fmt: skip


def summary(flown: LoggedFlight) -> list[tuple[str, list]]:
    """Return the summary: [(heading, [sentences])]; the first sentence is that of `cosim run`."""
    lost = log_schema.of_result(flown.log, "not_run") or {}
    found = {"detectors": [lane.entry for lane in flown.lanes], "sim_time_s": flown.end, "achieved": flown.achieved,
             "not_run": lost}  # fmt: skip
    s, ended = flown.scenario, flown.log.result if flown.log.complete else {}
    status = ended.get("status", "incomplete: the log ends early")
    broken = [". ".join(filter(None, line)) for line in narrator.faults(s, flown.achieved)]
    return [
        ("In short", narrator.sentences(found, s)),
        ("Flown", [f"{flown.end - flown.t0 + flown.dt:.1f} s: {narrator.point(s)}; {status}"]),
        ("Broken", broken or ["nothing: every alarm below is a false one"]),
        ("Missed", narrator.silent(found, s) if broken else []),
        ("Not run", [f"{name}: {why}" for name, why in lost.items()]),
        ("False alarms", narrator.false(found)),
    ]
