"""What `cosim list` shows: tables of everything there is, a topic each."""

from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cosim.cli.tables import table


def shown(found: dict[str, Any], topic: str | None = None) -> Group | Table:
    """Return the entries of a `topic` of `cosim list`, of every one for "all"; which topics there are for None."""
    if topic is None:
        t = table("cosim list TOPIC, or cosim list all", "topic", "how many>", "what it is")
        for name, about in TOPICS.items():
            t.add_row(name, str(len(found[name])), about)
        return t
    tables = {
        "scenarios": _scenarios,
        "campaigns": _campaigns,
        "manoeuvres": _manoeuvres,
        "faults": _faults,
        "targets": _targets,
        "detectors": _detector_list,
        "classes": _classes,
        "signals": _signals,
        "tolerances": _tolerances,
        "keys": lambda found: [_keys(name, about) for name, about in found["keys"].items()],
        "examples": _examples,
    }
    return Group(*(part for name in (tables if topic == "all" else (topic,)) for part in tables[name](found)))


TOPICS = {
    "scenarios": "flights that are built in: cosim run NAME",
    "campaigns": "many flights that are built in: cosim campaign NAME",
    "manoeuvres": "what the pilot does: manoeuvre.kind",
    "faults": "kinds of fault, with their numbers",
    "targets": "segments, sensors, surfaces and engines that a fault can be on, with units",
    "detectors": "who watches: detectors.enabled",
    "classes": "words of a verdict: what a detector says is wrong",
    "signals": "what a detector may read",
    "tolerances": "numbers of the aircraft and its actuators that a scenario may multiply",
    "keys": "tables and keys of a scenario",
    "examples": "programs to start from: cosim example NAME",
}


def _scenarios(found):
    s = table("Scenarios: cosim run NAME", "name", "what happens")
    for r in found["scenarios"]:
        s.add_row(r["name"], r["title"], style="bold" if r["name"] == found["default"] else "")
    return [s]


def _campaigns(found):
    many = table("Campaigns: cosim campaign NAME", "name", "what is flown")
    for r in found["campaigns"]:
        many.add_row(r["name"], r["title"])
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
        d.add_row(r["id"], r["level"], r["summary"])
    return [d]


def _signals(found):
    t = table("Signals that a detector may read", "signal", "unit", "what it is")
    for r in found["signals"]:
        t.add_row(r["name"], r["unit"], r["summary"])
    return [t]


def _classes(found):
    t = table("Classes that a verdict may name", "class", "what is wrong")
    for r in found["classes"]:
        t.add_row(r["name"], r["summary"])
    return [t]


def _tolerances(found):
    out = []
    for group in dict.fromkeys(r["group"] for r in found["tolerances"]):
        t = table(f"[tolerances.{group}], a factor from 0.2 to 5 on", "name", "unit", "what it is")
        for r in found["tolerances"]:
            if r["group"] == group:
                t.add_row(r["name"], r["unit"], r["summary"])
        out.append(t)
    return out


def _examples(found):
    t = table("Examples: cosim example NAME copies one here", "name", "what it does")
    for r in found["examples"]:
        t.add_row(r["name"], r["summary"])
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
        t.add_row(key, text)
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
