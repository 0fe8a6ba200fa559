"""What the command line shows: tables built from the same plain data that `--json` prints. Nothing here prints."""

import math
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich import box
from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

STATUS = {"completed": "green", "departed": "yellow", "diverged": "red", "interrupted": "yellow"}
NOTHING = Text("-", style="dim")


def table(title: str, *columns: Any, **options: Any) -> Any:
    """Return an empty table in the house style; a column named with a trailing > is right-aligned."""
    heading = Text(f"\n{title}", style="bold") if title else None
    made = Table(
        title=heading,
        title_justify="left",
        title_style="",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
        **options,
    )
    for i, name in enumerate(columns):
        right = name.endswith(">")
        made.add_column(name.removesuffix(">"), justify="right" if right else "left", no_wrap=right or i == 0)
    return made


@contextmanager
def progress(console: Any, text: str, unit: str = "s", waiting: str = "") -> Iterator[Any]:
    """Show a bar on a terminal, `waiting` until its callback (done, total) is first called with something done."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[state]}"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(waiting or text, total=None, state="")

        def move(done, total):
            if done > 0:
                bar.update(task, description=text, completed=done, total=total, state=f"{done:.0f}/{total:.0f} {unit}")

        yield move


@contextmanager
def compiling(console: Any) -> Iterator[Any]:
    """Give a callback (i, n) that says "compiling 7 of 30" on a terminal; one line elsewhere."""
    said = False

    def tell(i, n):
        nonlocal said
        if console.is_terminal:
            status.update(f"compiling {i} of {n}, once on a machine")
            status.start()
        elif not said:
            console.print(f"compiling {n} kernels, once on a machine", highlight=False)
        said = True

    status = console.status("")
    try:
        yield tell
    finally:
        status.stop()


def number(value: Any, digits: int = 2) -> Any:
    """Return a number as text, or a dash when there is none."""
    return NOTHING if value is None else f"{value:.{digits}f}"


def cell(value: Any) -> Any:
    """Return a table cell: short numbers, a dash for nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))


def bare(value: Any) -> Any:
    """Return a NumPy number as JSON can hold it."""
    return value.item()


def plain(made: Any) -> Any:
    """Return a study's Table with its notes."""
    shown = table(made.title, *map(escape, made.columns))
    for row in made.rows:
        shown.add_row(*map(cell, row))
    return Group(shown, *(Text(note, style="dim") for note in made.notes))


def run(found: Any, scenario: Any) -> Any:
    """Return the outcome of a run: who noticed in a sentence, the flight, its faults, every alarm, where the log is."""
    from cosim.cli import faults, headline  # `--help` needs no scenario

    said = [Text(text, style="bold") for text in headline.sentences(found, scenario)]
    head = Text.assemble(*(["\n"] if said else []), scenario.title or "flight", "\n", _point(scenario))
    shown = [d for d in found["detectors"] if d["id"] not in headline.APART]
    apart = [Text(text, style="dim") for text in headline.apart(found)] if shown else []
    parts = [
        *said,
        head,
        *faults.lines(scenario, found.get("achieved")),
        *faults.consequences(found.get("consequences")),
        _detectors(shown or found["detectors"]),
        *apart,
    ]
    return Group(*parts, _footer(found))


def _point(scenario):
    f, m = scenario.flight, scenario.manoeuvre
    speed = next(
        f"{getattr(f, k):g} {unit}"
        for k, unit in (("cas_kt", "kt CAS"), ("mach", "Mach"), ("tas_kt", "kt TAS"))
        if getattr(f, k)
    )
    air = "still air" if f.turbulence == "none" else f"{f.turbulence} turbulence"
    where = f"{f.mass_t:g} t, CG {f.cg_pct:g} %, {f.altitude_ft:,.0f} ft, {speed}"
    return ", ".join(filter(None, (where, f.path, air, m.kind.replace("_", " "))))


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
    t = table("", "detector", "watches", *own, "at s>", "delay s>", "periods>", "right s>", "isolated", "false>", "µs>")
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
    before = " (what the file held is overwritten)" if found.get("overwritten") else ""
    last = Text(f"report {found['report']}") if found.get("report") else Text(f"next   cosim report {shlex.quote(log)}")
    return Group(line, whole(f"log    {log}{before}"), whole(last))


def whole(text: Any) -> Any:
    """Return a line that is not folded: a path or a command that is copied."""
    made = Text(text) if isinstance(text, str) else text
    made.no_wrap, made.overflow = True, "ignore"
    return made


def linear(found: Any, scenario: Any) -> Any:
    """Return trim and modes of `cosim linearize`."""
    trim = found["trim"]
    t = table("Trim", "", ">", "", show_header=False)
    for name, unit in (("alpha_deg", "deg"), ("stabilizer_deg", "deg"), ("throttle", ""), ("residual", "m/s², rad/s²")):
        t.add_row(name.removesuffix("_deg"), f"{trim[name]:.3g}" if name == "residual" else f"{trim[name]:.4f}", unit)
    m = table(
        "Modes of the bare airframe",
        "mode",
        "wn, rad/s>",
        "damping>",
        "period or tau, s>",
        "eigenvalue 1/s>",
    )
    for r in found["modes"]:
        real, imag = r["eigenvalue"]
        swings = abs(imag) > 1e-9
        time = 2 * math.pi / abs(imag) if swings else 1 / abs(real)
        value = f"{real:.4f}" + (f" ± {abs(imag):.4f}i" if swings else "")
        m.add_row(r["name"].replace("_", " "), f"{r['wn_rad_s']:.4f}", f"{r['zeta']:.3f}", f"{time:.2f}", value)
    size = f"{len(found['states'])} states, {len(found['inputs'])} inputs, {len(found['outputs'])} outputs"
    where = f"\nA, B, C, D in {found['file']}" if "file" in found else "; write A, B, C, D with -o model.npz or .mat"
    return Group(Text(_point(scenario)), t, m, Text(size + where))


def bench(found: Any) -> Any:
    """Return the tables of `cosim bench`."""
    t = table("Cost per tick", "case", "µs/tick>", "ratio>", "spread>", "to")
    for r in found["cases"]:
        spread = NOTHING if r["spread"] is None else f"{100 * r['spread']:.0f} %"
        t.add_row(r["name"], number(r["us_per_tick"]), number(r["ratio"]), spread, r["against"] or "")
    recorded = found.get("recorded")
    again = recorded["replay_us"] if recorded else {}
    d = table("Detectors, per step and lane", "detector", "lanes>", "live µs>", "batch µs>", "replay µs>")
    for r in found["detectors"]:
        costs = (r["live_us"], r["batch_us"], again.get(r["id"]))
        d.add_row(r["id"], str(r["lanes"]), *map(number, costs))
    rate, start = found["realtime_factor"], found["startup"]
    all_, minutes = f"{rate['with_detectors']:.0f} x", found["memory_flight_s"] / 60
    lines = [
        f"real time      {rate['lockstep']:.0f} x, with all eleven detectors {all_}, on one of {found['cores']} cores",
        f"warm start     {start['run_s']:.2f} s for a run of 1 s; help {start['help_s']:.2f} s",
        f"peak memory    {number(found['peak_mb'], 0)} MB in a flight of {minutes:.0f} minutes; a campaign's "
        f"worker {number(found['worker_mb'], 0)} MB",
    ]
    if recorded:
        r = recorded
        lines += [
            f"reading        {r['open_s'] + r['frames_s']:.2f} s for {r['minutes']:.0f} minutes of every signal "
            f"({r['values_mb']:.0f} MB of numbers) into pandas, one topic {r['topic_s']:.2f} s",
            f"replay         {r['detectors_realtime']:.0f} x real time for every detector, "
            f"{r['replay_realtime']:.0f} x with reading and comparing",
        ]
    g = table("Growth", "over", "cost in", "fixed>", "each>", "off the line>", "measured")
    for line in found["growth"]:
        points = ", ".join(f"{x:g}: {y:.3g}" for x, y in line["points"])
        off = f"{100 * line['off']:.0f} %"
        g.add_row(line["over"], line["unit"], number(line["offset"], 3), number(line["slope"], 4), off, points)
    return Group(t, d, g, Text("\n".join(lines)))


def inventory(found: Any, topic: Any = None) -> Any:
    """Return the entries of a `topic` of `cosim list`, of every one for "all"; which topics there are for None."""
    if topic is None:
        t = table("cosim list TOPIC, or cosim list all", "topic", "how many>", "what it is")
        for name, about in TOPICS.items():
            t.add_row(name, str(len(found[name])), about)
        return t
    shown = {
        "scenarios": _scenarios,
        "campaigns": _campaigns,
        "manoeuvres": _manoeuvres,
        "faults": _faults,
        "targets": _targets,
        "detectors": _detector_list,
        "signals": _signals,
        "tolerances": _tolerances,
        "keys": lambda found: [_keys(name, about) for name, about in found["keys"].items()],
        "examples": _examples,
    }
    return Group(*(part for name in (shown if topic == "all" else (topic,)) for part in shown[name](found)))


TOPICS = {
    "scenarios": "flights that are built in: cosim run NAME",
    "campaigns": "many flights that are built in: cosim campaign NAME",
    "manoeuvres": "what the pilot does: manoeuvre.kind",
    "faults": "kinds of fault, with their numbers",
    "targets": "segments, sensors, surfaces and engines that a fault can be on, with units",
    "detectors": "who watches: detectors.enabled",
    "signals": "what a detector may read",
    "tolerances": "numbers of the aircraft and its actuators that a scenario may multiply",
    "keys": "tables and keys of a scenario",
    "examples": "programs to start from: cosim example NAME",
}


def _scenarios(found):
    s = table("Scenarios: cosim run NAME", "name", "what happens")
    for r in found["scenarios"]:
        s.add_row(r["name"], escape(r["title"]), style="bold" if r["name"] == found["default"] else "")
    return [s]


def _campaigns(found):
    many = table("Campaigns: cosim campaign NAME", "name", "what is flown")
    for r in found["campaigns"]:
        many.add_row(r["name"], escape(r["title"]))
    return [many]


def _manoeuvres(found):
    m = table("Manoeuvres: --set manoeuvre.kind=KIND", "kind", "what it does", "keys")
    for r in found["manoeuvres"]:
        m.add_row(r["kind"], r["summary"], ", ".join(r["keys"]))
    return [m]


def _faults(found):
    places = dict.fromkeys(r["target"] for r in found["faults"])
    return [*(_faults_on(t, [r for r in found["faults"] if r["target"] == t]) for t in places), *_targets(found)]


def _targets(found):
    names = found["targets"]
    return [
        Text(f"<segment>  {', '.join(names['segments'])}; groups {', '.join(names['groups'])}"),
        *(Text(f"<sensor>   of {t}: {', '.join(s)}") for t, s in names["actuator_sensors"].items() if s),
        Text(f"<name>     {', '.join(names['sensors'])}"),
        Text(f"<unit>     {_units(found['units'])}"),
    ]


def _detector_list(found):
    d = table("Detectors: --set 'detectors.enabled=[...]'", "id", "level", "what it is")
    for r in found["detectors"]:
        d.add_row(r["id"], r["level"], escape(r["summary"]))
    return [d]


def _signals(found):
    t = table("Signals that a detector may read", "signal", "unit", "what it is")
    for r in found["signals"]:
        t.add_row(r["name"], escape(r["unit"]), escape(r["summary"]))
    return [t]


def _tolerances(found):
    out = []
    for group in dict.fromkeys(r["group"] for r in found["tolerances"]):
        t = table(f"[tolerances.{group}], a factor from 0.2 to 5 on", "name", "unit", "what it is")
        for r in found["tolerances"]:
            if r["group"] == group:
                t.add_row(r["name"], escape(r["unit"]), escape(r["summary"]))
        out.append(t)
    return out


def _examples(found):
    t = table("Examples: cosim example NAME copies one here", "name", "what it does")
    for r in found["examples"]:
        t.add_row(r["name"], escape(r["summary"]))
    return [t]


def _units(units):
    """Return which sensors have which units, those of one kind together."""
    by: dict = {}
    for name, own in units.items():
        by.setdefault(" | ".join(own), []).append(name)
    return "; ".join(f"{own}: {', '.join(names)}" for own, names in by.items())


def _keys(name, about):
    t = table(name, "key", "what it means")
    t.columns[0].min_width = 21
    for key, text in about.items():
        t.add_row(escape(key), escape(text))
    return t


def _faults_on(target, rows):
    f = table(f"Faults on {target}", "kind", "what it does", "keys")
    f.columns[0].min_width, f.columns[1].ratio, f.columns[2].ratio, f.expand = 21, 1, 1, True
    for r in rows:
        keys = " | ".join(r["one_of"]) + "".join(f", {k}" for k in r["keys"])
        at = f"at = {' | '.join(r['at'])}" if r["at"] else ""
        only = f" ({' and '.join(r['only'])} only)" if r["only"] else ""
        f.add_row(r["kind"], r["summary"] + only, "; ".join(x for x in (keys, at) if x))
    return f


def info(found: Any) -> Any:
    """Return the tables of `cosim info`."""
    state = (
        Text("complete", style="green")
        if found["complete"]
        else Text("incomplete: the run did not end by itself", style="yellow")
    )
    head = table(found["log"], "", "", show_header=False)
    for name in ("title", "status", "duration_s", "rate_hz", "ticks", "size_mb"):
        if found.get(name) not in (None, ""):
            head.add_row(name, escape(str(found[name])))
    head.add_row("log", state)
    for name in ("gaps", "problem"):
        if found.get(name):
            head.add_row(name, escape(f"{found[name]} ticks are missing" if name == "gaps" else found[name]))
    for name, value in found["versions"].items():
        head.add_row(name, escape(value))
    t = table("Topics", "topic", "rows>", "fields>", "every>", "first fields")
    for r in found["topics"]:
        more = ", ..." if len(r["fields"]) > 6 else ""
        t.add_row(
            r["name"], str(r["rows"]), str(len(r["fields"])), str(r["every"]), escape(", ".join(r["fields"][:6]) + more)
        )
    return Group(head, t, Text(f"attachments: {', '.join(found['attachments']) or 'none'}"))


def reproduced(found: Any) -> Any:
    """Return the rows of the papers' experiments, the counts of the verdicts first."""
    colours = {"agrees": "green", "differs_explained": "yellow", "differs": "red", "ours": "dim", "beyond": "cyan"}
    words = {v: v.replace("_", ", ") for v in colours}
    words |= {"ours": "ours (the paper gives no number)", "beyond": "beyond the paper"}
    total = "   ".join(f"[{colours[v]}]{n} {words[v]}[/]" for v, n in found["counts"].items())
    t = table("Paper says, we get", "paper", "item", "paper says", "we get>", "band", "verdict")
    for r in found["rows"]:
        verdict = f"[{colours[r['verdict']]}]{r['verdict'].replace('_', ', ')}[/]"
        item = f"{r['item']} ({r['note']})" if r["note"] else r["item"]
        t.add_row(r["paper"], escape(item), escape(r["says"]), f"{r['got']:.4g}", r["tolerance"], verdict)
    why = [
        f"{escape(r['item'])}: {escape(r['reason'])} ({escape(r['evidence'])})" for r in found["rows"] if r["reason"]
    ]
    return Group(total, t, *why)


def proof(found: Any) -> Any:
    """Return what rows show with the method broken."""
    t = table("The method broken in one place", "paper", "row", "what is broken", "value then>", "band", "seen")
    for b in found:
        t.add_row(b["paper"], escape(b["item"]), escape(b["what"]), f"{b['got']:.4g}", b["band"],
                  "[green]yes[/]" if b["seen"] else "[red]no[/]")  # fmt: skip
    return t


def designs(found: Any) -> Any:
    """Return a table of {design: (what it is, problem or "")}."""
    t = table("Stored designs", "design", "what", "state")
    for name, (what, problem) in found.items():
        t.add_row(name, what, f"[red]{escape(problem)}[/]" if problem else "[green]belongs to this aircraft[/]")
    return t


def campaign_speed(found: Any) -> Any:
    """Return what `cosim bench --campaign` measured."""
    shown = table(found["campaign"], "processes", "flights>", "wall s>", "flights/min>", "x real time>", "outcomes")
    for case in found["cases"]:
        wall, times = f"{case['wall_s']:.1f}", f"{case['flown_s'] / case['wall_s']:.0f}"
        outcomes = ", ".join(f"{n} {name}" for name, n in case["outcomes"].items())
        rate = f"{60 * case['flights'] / case['wall_s']:.0f}"
        shown.add_row(str(case["workers"]), str(case["flights"]), wall, rate, times, outcomes)
    rows = "rows equal" if found["equal"] else "rows differ"
    return Group(shown, f"{found['ratio']:.2f} times as fast as one process; {rows}; {found['crashed']} crashed")
