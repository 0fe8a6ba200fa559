"""What `cosim list` shows: tables of everything there is, a topic each."""

from typing import Any

from rich.console import Group
from rich.text import Text

from cosim.table import Column, Row, Table, of


def shown(found: dict[str, Any], topic: str | None = None) -> Group | Table:
    """Return the entries of a `topic` of `cosim list`, of every one for "all"; which topics there are for None."""
    if topic is None:
        t = Table("cosim list TOPIC, or cosim list all", "topic", "how many>", "what it is")
        for name, about in TOPICS.items():
            t.add(name, str(len(found[name])), about)
        return t
    names = TOPICS if topic == "all" else (topic,)
    return Group(*(part for name in names for part in OWN.get(name, _plain)(found, name)))


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


LISTS = {  # topic -> title, columns of its table
    "scenarios": ("Scenarios: cosim run NAME", ("name", "what happens:title")),
    "campaigns": ("Campaigns: cosim campaign NAME", ("name", "what is flown:title")),
    "manoeuvres": ("Manoeuvres: --set manoeuvre.kind=KIND", ("kind", "what it does:summary", "keys")),
    "detectors": (
        "Detectors: --set 'detectors.enabled=[...]'",
        ("id", "level", "what it is:summary", "judges in:range"),
    ),
    "classes": ("Classes that a verdict may name", ("class:name", "what is wrong:summary")),
    "signals": ("Signals that a detector may read", ("signal:name", "unit", "what it is:summary")),
    "law": (
        "A class Law: __init__(dt, start), update(t, y, ask) returns {command: value}",
        ("name", "unit", "what it is:summary"),
    ),
    "examples": ("Examples: cosim new example NAME copies one here", ("name", "what it does:summary")),
}


def _plain(found, topic):
    """Return the table of a topic whose entries are records."""
    title, heads = LISTS[topic]
    columns = [Column(head, key or head, right=False) for head, _, key in (h.partition(":") for h in heads)]
    records = [{k: ", ".join(v) if isinstance(v, list | tuple) else v for k, v in r.items()} for r in found[topic]]
    first = lambda r: "bold" if topic == "scenarios" and r["name"] == found["default"] else ""  # noqa: E731
    return [of(columns, records, first, title=title)]


def _faults(found, _):
    places = dict.fromkeys(r["target"] for r in found["faults"])
    return [*(_faults_on(t, [r for r in found["faults"] if r["target"] == t]) for t in places), *_targets(found, _)]


def _targets(found, _):
    names = found["targets"]
    return [
        Text(f"<segment>  {', '.join(names['segments'])}; groups {', '.join(names['groups'])}"),
        *(Text(f"<sensor>   of {t}: {', '.join(s)}") for t, s in names["actuator_sensors"].items() if s),
        Text(f"<name>     {', '.join(names['sensors'])}"),
        Text(f"<unit>     {_units(found['units'])}"),
    ]


def _tolerances(found, _):
    groups = dict.fromkeys(r["group"] for r in found["tolerances"])
    columns = [Column("name", right=False), Column("unit", right=False), Column("what it is", "summary", right=False)]
    own = {g: [r for r in found["tolerances"] if r["group"] == g] for g in groups}
    return [of(columns, rows, title=f"[tolerances.{g}], a factor from 0.2 to 5 on") for g, rows in own.items()]


def _keys(found, _):
    return [Table(name, "key", "what it means", rows=map(Row, about.items())) for name, about in found["keys"].items()]


def _units(units):
    """Return which sensors have which units, those of one kind together."""
    by: dict = {}
    for name, own in units.items():
        by.setdefault(" | ".join(own), []).append(name)
    return "; ".join(f"{own}: {', '.join(names)}" for own, names in by.items())


def _faults_on(target, rows):
    f = Table(f"Faults on {target}", "kind", "what it does", "keys")
    for r in rows:
        keys = " | ".join(r["one_of"]) + "".join(f", {k}" for k in r["keys"])
        own = [f"{key} = {' | '.join(r[key])}" for key in ("at", "shape") if r[key]]
        only = f" ({' and '.join(r['only'])} only)" if r["only"] else ""
        f.add(r["kind"], r["summary"] + only, "; ".join(x for x in (keys, *own) if x))
    return f


OWN = {"faults": _faults, "targets": _targets, "tolerances": _tolerances, "keys": _keys}
