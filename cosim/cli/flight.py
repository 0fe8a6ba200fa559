"""What `cosim run` shows: a sentence, every alarm, the flight and its faults, where the log is."""

from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.text import Text

from cosim.cli.tables import whole, word

if TYPE_CHECKING:  # `--help` needs no scenario
    from cosim.scenario import Scenario

STATUS = {"completed": "green", "departed": "yellow", "diverged": "red", "interrupted": "yellow"}


def shown(found: dict[str, Any], scenario: "Scenario") -> Group:
    """Return the outcome of a run: its first sentence, every alarm, the flight and its faults, where the log is."""
    from cosim.judge import narrator  # `--help` needs no scenario

    told = [d for d in found["detectors"] if d["id"] not in narrator.APART]
    beside = [*narrator.silent(found, scenario), *(narrator.apart(found) if told else [])]
    moved = narrator.consequences(found.get("consequences"))
    onset = min((f.start_s for f in scenario.faults), default=0.0)
    calm = scenario.flight.weather == "still air" and scenario.manoeuvre.kind == "cruise"
    besides = "" if calm else ", gusts and manoeuvres included"
    return Group(
        *(Text(text, style="bold") for text in narrator.sentences(found, scenario)),
        _detectors(told or found["detectors"], scenario),
        *(Text(text, style="dim") for text in beside),
        Text(f"\n{scenario.title or 'flight'}\n{narrator.point(scenario)}"),
        *_faults(narrator.faults(scenario, found.get("achieved"))),
        *([Text.assemble(("flown  ", "red"), f"from {onset:g} s on{besides}: {moved}")] if moved else []),
        _footer(found),
    )


def _faults(found):
    for i, (line, note) in enumerate(found):
        name = f"fault {i}  " if len(found) > 1 else "fault  "  # as in --set faults.1.kind
        yield Text.assemble((name, "red"), line)
        if note:
            yield Text(f"note   {note}", style="yellow")
    if not found:
        yield Text("no fault", style="dim")


def _detectors(rows, scenario):
    from cosim.judge.coverage import cases, remark
    from cosim.judge.lanes import part, table

    shown = [r for r in rows if r["alarm"] or r.get("concerned", True)] or rows
    quiet = len(rows) - len(shown)
    if not shown:
        return Text("no detector ran", style="dim")
    below = [Text(f"{quiet} lane{'s' * (quiet != 1)} of healthy parts stayed quiet", style="dim")] if quiet else []
    for r in shown:
        if r.get("standing_s"):
            below.append(Text(f"{r['id']} {part(r)}: {r['standing_s']:.1f} s of alarm without a fault"))
    for name in dict.fromkeys(r["id"] for r in shown if r["false_alarms"]):
        if said := remark(name):
            below.append(Text(f"{name}: {said}", style="dim"))
    return Group(table(shown, cases(scenario)).upto(4), *below)


def _footer(found):
    style = STATUS.get(found["status"], "red")
    speed = found.get("realtime_factor")
    line = Text.assemble(
        (found["status"], style), f" after {found['sim_time_s']:.2f} s", f", {speed:.0f} x real time" if speed else ""
    )
    if found.get("reason"):
        line.append(f": {found['reason']}")
    if not found.get("log"):
        return line
    log = str(found["log"])
    last = Text(f"report {found['report']}") if found.get("report") else Text(f"next   cosim report {word(log)}")
    return Group(line, whole(f"log    {log}{before(found)}"), whole(last))


def before(found: dict[str, Any]) -> str:
    """Return what is to be said behind the name of a log that took the place of another."""
    return " (what the file held is overwritten)" if found.get("overwritten") else ""
