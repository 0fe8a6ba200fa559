"""What `cosim run` shows: a sentence, every alarm, the flight and its faults, where the log is."""

from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.text import Text

from cosim.cli.tables import NOTHING, number, table, whole, word

if TYPE_CHECKING:  # `--help` needs no scenario
    from cosim.scenario import Scenario

STATUS = {"completed": "green", "departed": "yellow", "diverged": "red", "interrupted": "yellow"}


def shown(found: dict[str, Any], scenario: "Scenario") -> Group:
    """Return the outcome of a run: its first sentence, every alarm, the flight and its faults, where the log is."""
    from cosim.cli import faults, headline  # `--help` needs no scenario

    told = [d for d in found["detectors"] if d["id"] not in headline.APART]
    beside = [*headline.silent(found, scenario), *(headline.apart(found) if told else [])]
    return Group(
        *(Text(text, style="bold") for text in headline.sentences(found, scenario)),
        _detectors(told or found["detectors"]),
        *(Text(text, style="dim") for text in beside),
        Text(f"\n{scenario.title or 'flight'}\n{point(scenario)}"),
        *faults.lines(scenario, found.get("achieved")),
        *faults.consequences(found.get("consequences")),
        _footer(found),
    )


def point(scenario: "Scenario") -> str:
    """Return where a flight begins, through which air, with which manoeuvre, in words."""
    f, m = scenario.flight, scenario.manoeuvre
    speed = next(
        f"{getattr(f, k):g} {unit}"
        for k, unit in (("cas_kt", "kt CAS"), ("mach", "Mach"), ("tas_kt", "kt TAS"))
        if getattr(f, k)
    )
    where = f"{f.mass_t:g} t, CG {f.cg_pct:g} %, {f.altitude_ft:,.0f} ft, {speed}"
    return ", ".join(filter(None, (where, f.path, f.weather, m.kind.replace("_", " "))))


def _detectors(rows):
    from cosim.judge.coverage import remark

    shown = [r for r in rows if r["alarm"] or r.get("concerned", True)]
    quiet = len(rows) - len(shown)
    if not shown and rows:
        shown, quiet = rows, 0
    if not shown:
        return Text("no detector ran", style="dim")
    several = any(len(r.get("by_fault", ())) > 1 for r in shown)  # a row for each that a lane could notice
    own = ["fault>"] if several else []
    columns = ("detector", "watches", *own, "at s>", "delay s>", "periods>", "right s>", "isolated", "false>", "µs>")
    t = table("", *columns, spare=("µs", "periods", "at s"), keys=2)
    for r in [lane | part for lane in shown for part in lane.get("by_fault") or [{}]]:
        late = None if r["detection_delay_s"] is None else r["detection_delay_periods"]
        false = Text(str(r["false_alarms"]), style="red" if r["false_alarms"] else "dim")
        delays = (number(r["detection_delay_s"]), number(late, 1), number(r.get("time_to_right_s")))
        times = (number(r["detected_at_s"]), *delays)
        style = "" if r["alarm"] else "dim"
        which = [NOTHING if r["fault"] is None else str(r["fault"])] if several else []
        t.add_row(r["id"], _short(r["target"]), *which, *times, _isolated(r), false, number(r["step_us"]), style=style)
    t.caption = "right: until the first right name; false: false alarms; µs: time per step and lane"
    t.caption_justify = "left"
    below = [Text(f"{quiet} lane{'s' * (quiet != 1)} of healthy parts stayed quiet", style="dim")] if quiet else []
    for r in shown:
        if r.get("standing_s"):
            below.append(Text(f"{r['id']} {_short(r['target'])}: {r['standing_s']:.1f} s of alarm without a fault"))
    for name in dict.fromkeys(r["id"] for r in shown if r["false_alarms"]):
        if said := remark(name):
            below.append(Text(f"{name}: {said}", style="dim"))
    return Group(t, *below)


def _short(target):
    return target.removeprefix("elevator.").replace("_", " ")


def _isolated(row):
    """Return the verdict; its target only where that says more than the lane that gave it."""
    found = row["isolated"]
    if not found:
        return _silence(row)
    more = found["target"].removeprefix(row["target"]).strip(".")
    return f"{found['class']} {_short(more)}".strip()


def _silence(row):
    """Return what stands where no verdict does: that it could not judge and why, or that the fault never showed."""
    if not row.get("able", True):
        why = row.get("why_not_valid")
        return f"not valid{f': {why}' if why else ''}"
    return "not excited" if row.get("not_excited") else NOTHING


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
