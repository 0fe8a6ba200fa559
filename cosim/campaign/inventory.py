"""Everything a scenario can name, as plain data for `cosim list` and for programs."""

import ast
from importlib import resources
from typing import Any

from cosim.errors import CosimError, among
from cosim.flight import user_law as law
from cosim.scenario import catalog as c
from cosim.scenario import vocabulary
from cosim.scenario.aircraft import load_aircraft
from cosim.scenario.load import DEFAULT, builtin_names, load_scenario, text_of
from cosim.scenario.manoeuvre import KINDS, keys_of
from cosim.texts import toml
from fdi.common.verdict import MEANINGS
from fdi.registry import records

EXAMPLES = resources.files("cosim").joinpath("examples")
PLACES = (  # heading, targets, kinds
    ("elevator", "elevator.<segment>", c.ELEVATOR_KINDS),
    ("actuator sensor", "elevator.<segment>.<sensor>", c.sensor_kinds(c.ACTUATOR_SENSORS["rod"])),
    ("other surface", ", ".join(c.SURFACES), c.SURFACE_KINDS),
    ("engine", "engine.1 to engine.4, engine.all", c.ENGINE_KINDS),
    ("aircraft sensor", "sensor.<name>", c.sensor_kinds(c.SENSORS["alpha"])),
)


def inventory() -> dict[str, Any]:
    """Return {default, and every topic of `cosim list`: its entries} as plain data."""
    own_law = {key: said for key, said in c.KEYS["[law]"].items() if key != "<gain>"}
    return {
        "default": DEFAULT,
        "scenarios": [{"name": n, "title": load_scenario(n).title} for n in builtin_names()],
        "campaigns": [
            {"name": n, "title": toml(text_of(n, "campaign", CosimError)[0], place=n)["title"]}
            for n in builtin_names("campaign")
        ],
        "manoeuvres": [
            {"kind": name, "summary": kind.summary, "keys": [key for key in keys_of(name) if key != "kind"]}
            for name, kind in KINDS.items()
        ],
        "faults": [
            _fault(place, target, name, kind) for place, target, kinds in PLACES for name, kind in kinds.items()
        ],
        "keys": {**c.KEYS, "[law]": {", ".join(law.gains()): "gains of the shipped law", **own_law}},
        "units": {name: [u.suffix for u in units] for name, units in {**c.SENSORS, **c.ACTUATOR_SENSORS}.items()},
        "targets": {
            "segments": list(c.SEGMENTS), "groups": list(load_aircraft().groups), "surfaces": list(c.SURFACES),
            "engines": [*load_aircraft().engine_names, "all"],
            "actuator_sensors": {name: list(t.own_sensors) for name, t in c.TECHNOLOGIES.items()},
            "sensors": list(c.SENSORS),
        },
        "classes": [{"name": name, "summary": text} for name, text in MEANINGS.items()],
        "signals": vocabulary.inventory(),
        "law": law.inventory(),
        "tolerances": [
            {"group": group, "name": name, "unit": unit, "summary": text}
            for group in c.MULTIPLIED
            for name, (text, unit) in c.meanings(group).items()
        ],
        "examples": [{"name": name, "summary": text} for name, text in examples().items()],
        "detectors": [
            {"id": r.id, "level": r.level, "summary": r.summary, "range": _range(r)} for r in records().values()
        ],
    }  # fmt: skip


def examples() -> dict[str, str]:
    """Return {name: first sentence of its docstring} of the programs in cosim/examples."""
    found = {p.name[:-3]: p for p in sorted(EXAMPLES.iterdir(), key=str) if p.name.endswith(".py")}
    return {name: _line(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))) for name, path in found.items()}


def example(name: str) -> str:
    """Return the source of example `name`. Raises CosimError for a name that there is not."""
    known = examples()
    among(name, known, "no example of this name", error=CosimError, place=name)
    return EXAMPLES.joinpath(f"{name}.py").read_text(encoding="utf-8")


def _line(text):
    return (text or "").strip().partition("\n")[0].rstrip(".")  # python -OO keeps no docstring


def _fault(place, target, name, kind):
    keys = [k.name for k in kind.keys]
    one_of = [k.name for k in kind.one_of]
    if place.endswith("sensor"):  # the unit follows the sensor
        one_of = list(
            dict.fromkeys(k if k == "scale" else k.split("_")[0] + "_<unit>" + "_s" * (name == "drift") for k in one_of)
        )
    only = list(kind.technologies) if set(kind.technologies) != set(c.TECHNOLOGIES) else []
    return {
        "place": place, "target": target, "kind": name, "summary": kind.summary, "one_of": one_of, "keys": keys,
        "at": list(kind.at), "shape": list(c.SHAPES) if name in c.OSCILLATIONS else [], "only": only,
    }  # fmt: skip


def _range(record: Any) -> str:
    """Return where a detector may judge, in SI, "" for everywhere."""
    unit = {word: signal.unit.replace("-", "") for word, signal in vocabulary.words().items()}
    return "; ".join(f"{w} {low:.4g} to {high:.4g} {unit[w]}".strip() for w, (low, high) in record.range.items())
