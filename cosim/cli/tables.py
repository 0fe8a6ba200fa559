"""What the commands show: tables and lines from the same plain data that `--json` prints."""

import json
import math
from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.text import Text

from cosim.cli.app import whole, word
from cosim.table import DASH, Cell, Column, Row, Table, number, of

if TYPE_CHECKING:  # `--help` needs no scenario
    from cosim.scenario import Scenario

STATUS = {"completed": "green", "departed": "yellow", "interrupted": "yellow"}
ARRAYS = (".npy", ".npz")
SHOWN = 12  # differences of a replay, or places lost of a log; all of them are in --json
TEXTS, ROWS = 5, 15  # most frequent errors of a campaign, and rows of papers that differ, that are printed


def files(found: dict[str, Any], *names: str, more: str = "") -> list[Text]:
    """Return a line for each of `names` (log, report, table, ...) that was written; `more` stands behind it."""
    overwritten = " (what the file held is overwritten)" if found.get("overwritten") else ""
    return [whole(f"{name:<7}{found[name]}{overwritten}{more}") for name in names if found.get(name)]


# -- run, info, linearize


def run(found: dict[str, Any], scenario: "Scenario", details: bool = False) -> Group:
    """Return the outcome of a run: a sentence per fault, the detectors that were made for it or alarmed, where the log
    is; with `details` every detector, what was injected and what the aircraft did."""
    from cosim.judge import lanes, narrator
    from cosim.judge.coverage import DESIGNED, cases, expected

    told, case = found["detectors"], cases(scenario)
    made = lambda d: any(e["case"] and expected(d["id"], e["case"]) == DESIGNED for e in lanes.entries([d], case))  # noqa: E731
    rows = [d for d in told if details or d["alarm"] or made(d)]
    parts: list[Any] = [Text(text, style="bold") for text in narrator.sentences(found, scenario)]
    parts += [lanes.table(rows, case).upto(lanes.ALL if details else 0)] if rows else []
    beside = narrator.false(found) if told else ["no detector ran"]
    dropped = sum(" is dropped on " in note for note in found.get("notes", ()))
    quiet = f"{len(told) - len(rows)} other lanes: no alarm{f', {dropped} dropped' if dropped else ''}; "
    beside[0] = quiet * (len(told) > len(rows)) + beside[0]
    beside += narrator.silent(found, scenario) if details else []
    parts += [Text(text, style="dim") for text in (*beside, narrator.point(scenario))]
    for i, (line, note) in enumerate(narrator.faults(scenario, found.get("achieved"))):
        if details or scenario.faults[i].when is not None:  # that of a condition may never have begun
            parts.append(Text.assemble((f"fault {i}  ", "red"), line))  # as in --set faults.1.kind
        parts += [Text(f"note   {note}", style="yellow")] if note else []
    if details and (moved := narrator.consequences(found.get("consequences"))):
        onset = min((f.start_s for f in scenario.faults), default=0.0)
        calm = scenario.flight.weather == "still air" and scenario.manoeuvre.kind == "cruise"
        parts.append(Text(f"flown  from {onset:g} s on{'' if calm else ', gusts and manoeuvres included'}: {moved}"))
    speed = f", {found['realtime_factor']:.0f} x real time" if found.get("realtime_factor") else ""
    why = f": {found['reason']}" if found.get("reason") else ""
    status = (found["status"], STATUS.get(found["status"], "red"))
    parts.append(Text.assemble(status, f" after {found['sim_time_s']:.2f} s{speed}{why}"))
    if found.get("log"):
        last = f"report {found['report']}" if found.get("report") else f"next   cosim report {word(found['log'])}"
        parts += [*files(found, "log"), whole(last)]
    return Group(*parts)


def log(found: dict[str, Any]) -> Group:
    """Return the tables of `cosim info`."""
    names = ("title", "status", "duration_s", "rate_hz", "ticks", "size_mb")
    about = {name: found[name] for name in names if found.get(name) not in (None, "")}
    whole_ = Cell("complete", "good") if found["complete"] else Cell("incomplete: the run did not end itself", "warn")
    lost = {"gaps": found["gaps"] and f"{found['gaps']} ticks are missing", "problem": found.get("problem")}
    versions = ", ".join(f"{name} {version}".replace("software ", "") for name, version in found["versions"].items())
    about |= {"log": whole_, **{k: v for k, v in lost.items() if v}, "written by": versions}
    about |= {f"{name} not run": why for name, why in json.loads(found["result"].get("not_run", "{}")).items()}
    kept = [name for name in found["attachments"] if not name.endswith(ARRAYS)]
    topics: dict[str, list[str]] = {}
    for r in found["topics"]:
        root, _, rest = r["name"].removeprefix("/").partition("/")
        topics.setdefault(root, []).append(rest or "itself")
    t = Table("", "topics", "", caption="rows and fields of each: --json")
    for root, below in topics.items():
        t.add(f"/{root}", ", ".join(below) if root != "state" else f"of {len(below)} lanes, once a second")
    t.add("attached", f"{', '.join(kept)}; {len(found['attachments']) - len(kept)} arrays")
    return Group(Table(found["log"], "", "", heads=False, rows=map(Row, about.items())), t)


def model(found: dict[str, Any], scenario: "Scenario") -> Group:
    """Return trim and modes of `cosim linearize`."""
    from cosim.judge.narrator import point

    trim = found["trim"]
    t = Table("Trim", "", ">", "", heads=False)
    for name, unit in (("alpha_deg", "deg"), ("stabilizer_deg", "deg"), ("throttle", ""), ("residual", "m/s², rad/s²")):
        t.add(name.removesuffix("_deg"), f"{trim[name]:.3g}" if name == "residual" else f"{trim[name]:.4f}", unit)
    heads = ("wn, rad/s>", "damping>", "period or tau, s>", "eigenvalue, 1/s>")
    m = Table("Modes of the bare airframe, height and heading held; height free: the phugoid of A", "mode", *heads)
    for r in (*found["modes"], found["phugoid_height_free"]):
        real, imag = r["eigenvalue"]
        swings = abs(imag) > 1e-9
        time = 2 * math.pi / abs(imag) if swings else 1 / abs(real)
        value = f"{real:.4f}" + (f" ± {abs(imag):.4f}i" if swings else "")
        m.add(r["name"].replace("_", " "), f"{r['wn_rad_s']:.4f}", f"{r['zeta']:.3f}", f"{time:.2f}", value)
    size = f"{len(found['states'])} states, {len(found['inputs'])} inputs, {len(found['outputs'])} outputs"
    where = f"\nA, B, C, D in {found['file']}" if "file" in found else "; write A, B, C, D with -o model.npz or .mat"
    return Group(Text(point(scenario)), t, m, Text(size + where))


# -- list

TOPICS = {
    "scenarios": "flights that are built in: cosim run NAME",
    "campaigns": "many flights that are built in: cosim campaign NAME",
    "manoeuvres": "what the pilot does: manoeuvre.kind",
    "faults": "kinds of fault, with their numbers",
    "targets": "segments, sensors, surfaces and engines that a fault can be on, with units",
    "detectors": "who watches: detectors.enabled",
    "classes": "words of a verdict: what a detector says is wrong",
    "signals": "what a detector may read",
    "law": "what a control law of yours may read and command: law.file",
    "tolerances": "numbers of the aircraft and its actuators that a scenario may multiply",
    "keys": "tables and keys of a scenario",
    "examples": "programs to start from: cosim new example NAME",
}
# topic -> title, columns of its table as "head:key", the key by whose values there is a table each
LISTS: dict[str, tuple[str, tuple[str, ...], str]] = {
    "scenarios": ("Scenarios: cosim run NAME", ("name", "what happens:title"), ""),
    "campaigns": ("Campaigns: cosim campaign NAME", ("name", "what is flown:title"), ""),
    "manoeuvres": ("Manoeuvres: --set manoeuvre.kind=KIND", ("kind", "what it does:summary", "keys"), ""),
    "faults": ("Faults on {}", ("kind", "what it does:summary", "keys"), "target"),
    "detectors": (
        "Detectors: --set 'detectors.enabled=[...]'",
        ("id", "level", "what it is:summary", "judges in:range"),
        "",
    ),
    "classes": ("Classes that a verdict may name", ("class:name", "what is wrong:summary"), ""),
    "signals": ("Signals that a detector may read", ("signal:name", "unit", "what it is:summary"), ""),
    "law": (
        "A class Law: __init__(dt, start), update(t, y, ask) returns {{command: value}}",
        ("name", "unit", "what it is:summary"),
        "",
    ),
    "tolerances": ("[tolerances.{}], a factor from 0.2 to 5 on", ("name", "unit", "what it is:summary"), "group"),
    "keys": ("{}", ("key", "what it means:summary"), "table"),
    "examples": ("Examples: cosim new example NAME copies one here", ("name", "what it does:summary"), ""),
}


def inventory(found: dict[str, Any], topic: str | None = None) -> Group | Table:
    """Return the entries of a `topic` of `cosim list`, of every one for "all"; which topics there are for None."""
    if topic is None:
        rows = (Row((name, str(len(found[name])), about)) for name, about in TOPICS.items())
        return Table("cosim list TOPIC, or cosim list all", "topic", "how many>", "what it is", rows=rows)
    parts: list[Any] = []
    for name in TOPICS if topic == "all" else (topic,):
        parts += _listed(found, name) if name in LISTS else []
        parts += _targets(found) if name in ("faults", "targets") else []
    return Group(*parts)


def _listed(found, topic):
    """Return the tables of a topic."""
    title, heads, by = LISTS[topic]
    records = found[topic]
    if topic == "faults":
        records = [_fault(r) for r in records]
    elif topic == "keys":
        records = [{"table": t, "key": k, "summary": s} for t, keys in records.items() for k, s in keys.items()]
    columns = [Column(head, key or head, right=False) for head, _, key in (h.partition(":") for h in heads)]
    tables: dict[str, list] = {}
    for r in records:
        flat = {k: ", ".join(v) if isinstance(v, list | tuple) else v for k, v in r.items()}
        tables.setdefault(r.get(by, ""), []).append(flat)
    first = lambda r: "bold" if topic == "scenarios" and r["name"] == found["default"] else ""  # noqa: E731
    return [of(columns, own, first, title=title.format(name)) for name, own in tables.items()]


def _fault(r):
    """Return a kind of fault with its keys in words."""
    keys = " | ".join(r["one_of"]) + "".join(f", {k}" for k in r["keys"])
    own = [f"{key} = {' | '.join(r[key])}" for key in ("at", "shape") if r[key]]
    only = f" ({' and '.join(r['only'])} only)" if r["only"] else ""
    return {**r, "summary": r["summary"] + only, "keys": "; ".join(filter(None, (keys, *own)))}


def _targets(found):
    names = found["targets"]
    alike: dict[str, list[str]] = {}  # units -> the sensors that have them
    for name, units in found["units"].items():
        alike.setdefault(" | ".join(units), []).append(name)
    written = "; ".join(f"{units}: {', '.join(own)}" for units, own in alike.items())
    return [
        Text(f"<segment>  {', '.join(names['segments'])}; groups {', '.join(names['groups'])}"),
        *(Text(f"<sensor>   of {t}: {', '.join(s)}") for t, s in names["actuator_sensors"].items() if s),
        Text(f"<name>     {', '.join(names['sensors'])}"),
        Text(f"<unit>     {written}"),
    ]


# -- replay, recover


def replay(found: dict[str, Any], detection: bool) -> Group:
    """Return the outcome of a replay: what differs, how much was compared; with `detection`, who alarmed when."""
    parts: list[Any] = [_differences(found)] if found["differences"] else []
    said = ("exact", "green") if found["exact"] else ("different", "yellow" if found["changed"] else "red")
    compared = f": {found['values']:,} values of {found['rows']:,} steps compared"
    gaps = f"; {found['skipped']:,} steps after gaps of the log could not be replayed" if found["skipped"] else ""
    parts.append(Text.assemble(said, compared, gaps) if found["values"] else "no detector of the log was run again")
    if detection:
        parts.append(_detection(found["detectors"], found["changed"]))
    return Group(*parts, *files({**found, "log": found["output"]}, "log", more=": the new outputs stand under /replay"))


def _differences(found):
    more = len(found["differences"]) - SHOWN
    t = Table("Differences, bit for bit", "field", "differ>", "first tick>", "at s>", "largest>",
              caption=f"and {more} fields more (--json has all)" if more > 0 else "")  # fmt: skip
    for d in found["differences"][:SHOWN]:
        at = f"{d['first_tick'] * found['dt_s']:.3f}"
        t.add(d["field"], d["count"], d["first_tick"], at, d["max_abs"])
    return t


def _detection(rows, changed):
    from cosim.judge.lanes import part, seconds

    t = Table("Detection, as logged and as replayed", "detector", "watches", "at, s>", "now, s>", "isolated", "now",
              "false alarms>", "now>", keys=2,
              caption="left of each `now` what the log holds, under `now` what this build finds")  # fmt: skip
    none: dict[str, Any] = {"detected_at_s": None, "isolated": {"class": "was not there"}, "false_alarms": DASH,
                            "alarm": False}  # fmt: skip
    for r in (r for r in rows if not changed or r["id"] in changed):
        old, new = r["logged"] or none, r["replayed"]
        at, said, false = zip(*((seconds(e["detected_at_s"]), e["isolated"]["class"] if e["isolated"] else DASH,
                                 e["false_alarms"]) for e in (old, new)))  # fmt: skip
        t.add(r["id"], part(r), *at, *said, *false, tone="" if old["alarm"] or new["alarm"] else "muted")
    return t


def recording(found: dict[str, Any]) -> Group:
    """Return what the detectors say about foreign data, and what the others lack."""
    from cosim.judge.lanes import verdicts
    from cosim.replay.map_signals import in_map

    end = found["start_s"] + found["duration_s"]
    head = f"{found['start_s']:.12g} to {end:.12g} s of {found['recording']} at {found['rate_hz']} Hz"
    parts: list[Any] = [*map(Text, (found["clock"], head)), *(Text(c, style="yellow") for c in found["caveats"])]
    lack = Table("Not run", "detector", "watches", "signals that the map lacks",
                 caption="of the aircraft and of the segments of which the map names a signal")  # fmt: skip
    named = {"aircraft", *(s["name"].partition(".")[0] for s in found["signals"])}
    for r in found["not_run"]:
        lane = r["target"].removeprefix("elevator.")
        if lane in named:
            lack.add(r["id"], lane.replace("_", " "), ", ".join(in_map(r["missing"])))
    parts += [verdicts(found["detectors"]), *([lack] if lack.rows else [])]
    written = files({**found, "log": found["output"]}, "log", more=": inputs under /input, outputs under /replay")
    return Group(*parts, *written)


def recovered(found: dict[str, Any]) -> Group:
    """Return what came back of a damaged log, and what is lost."""
    whole_ = ("nothing of the run is lost", "green")
    cut = ("the run is incomplete: it holds no result", "yellow")
    parts = [Text(f"{found['ticks']:,} ticks ({found['duration_s']:g} s) in {found['chunks']} whole chunks", "bold"),
             Text(*(whole_ if found["complete"] else cut))]  # fmt: skip
    parts += [Text(f"lost   {d['bytes']} bytes at {d['offset']}: {d['reason']}") for d in found["lost"][:SHOWN]]
    more = len(found["lost"]) - SHOWN
    parts += [Text(f"and {more} places more (--json has all)")] if more > 0 else []
    return Group(*parts, *files({"log": found["out"]}, "log"))


# -- campaign, compare, reproduce


def campaign(result: Any, failed: list[dict]) -> Group:
    """Return what a campaign came to: the table of its detectors, how its runs ended, where the rows are."""
    from cosim.compare import compare
    from cosim.compare.tables import detectors

    status = result.frame.drop_duplicates("run")["status"].value_counts()
    text = f"{result.done} runs: {', '.join(f'{n} {name}' for name, n in status.items())}"
    text += f"; {result.resumed} were there already" if result.resumed else ""
    at = result.parquet if result.frame["id"].notna().any() else None
    shown = [detectors(compare([at.parent]).detectors)] if at else []
    told = [Text(f"{r['runs']} x {r['status']}: {r['error']}", style="red") for r in failed[:TEXTS]]
    if more := sum(r["runs"] for r in failed[TEXTS:]):
        told.append(Text(f"{more} more with {len(failed) - TEXTS} other texts: column error of the rows", style="red"))
    follows = [whole(f"next   cosim compare {word(at.parent)}")] if at else []
    return Group(*shown, Text(text), *told, Text(f"rows   {result.parquet}"), *follows)


def compared(found: dict) -> Group:
    """Return what a comparison says: `found` is the JSON of `cosim compare`."""
    from cosim.compare.tables import detectors, pairs, predictive

    lost = f"; {found['failed']} could not be flown" if found["failed"] else ""
    return Group(
        Text(f"{found['runs']} flights, {found['source']}{lost}"), *([pairs(found["pairs"])] if found["pairs"] else ()),
        detectors(found["detectors"]), Text(found["headline"]),
        *([predictive(found["predictive"])] if found["predictive"] else ()), *files(found, "report", "table"),
    )  # fmt: skip


def reproduced(rows: list[Any], found: dict[str, Any]) -> Group:
    """Return the counts of the verdicts, a line per row that differs, explained or not, and where all rows are."""
    from cosim.papers.tables import VERDICTS

    total = "   ".join(f"{n} {VERDICTS[v][0]}" for v, n in found["counts"].items())
    off = [r for r in rows if r.verdict != "agrees"]
    lines = [f"{r.paper}, {r.item}: we get {number(r.got)}, {VERDICTS[r.verdict][0]}" for r in off[:ROWS]]
    lines += [f"and {len(off) - ROWS} more"] * (len(off) > ROWS)
    return Group(*map(Text, (total, *lines)), *files(found, "report", "table", more=", every row"))
