"""What `cosim run`, `info` and `linearize` show."""

import json
import math
from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.text import Text

from cosim.cli.app import whole, word
from cosim.table import Cell, Table

if TYPE_CHECKING:  # `--help` needs no scenario
    from cosim.scenario import Scenario

STATUS = {"completed": "green", "departed": "yellow", "interrupted": "yellow"}
ARRAYS = (".npy", ".npz")


def shown(found: dict[str, Any], scenario: "Scenario", details: bool = False) -> Group:
    """Return the outcome of a run: a sentence per fault, the detectors that were made for it or alarmed, where the log
    is; with `details` every detector, what was injected and what the aircraft did."""
    from cosim.judge import lanes, narrator  # `--help` needs no scenario
    from cosim.judge.coverage import DESIGNED, cases, expected

    of = cases(scenario)
    made = lambda d: any(e["case"] and expected(d["id"], e["case"]) == DESIGNED for e in lanes.entries([d], of))  # noqa: E731
    told = found["detectors"]
    rows = [d for d in told if details or d["alarm"] or made(d)]
    parts: list[Any] = [Text(text, style="bold") for text in narrator.sentences(found, scenario)]
    parts += [lanes.table(rows, of).upto(lanes.ALL if details else 0)] if rows else []
    beside = narrator.false(found) if told else ["no detector ran"]
    dropped = sum(" is dropped on " in note for note in found.get("notes", ()))
    quiet = f"{len(told) - len(rows)} other lanes: no alarm{f', {dropped} dropped' if dropped else ''}; "
    beside[0] = quiet * (len(told) > len(rows)) + beside[0]
    beside += narrator.silent(found, scenario) if details else []
    parts += [Text(text, style="dim") for text in beside]
    return Group(*parts, Text(narrator.point(scenario)), *_injected(found, scenario, details), _footer(found))


def _injected(found, scenario, details):
    """Yield what was injected, where the elevator moved otherwise than asked, and what the aircraft did."""
    from cosim.judge import narrator

    for i, (line, note) in enumerate(narrator.faults(scenario, found.get("achieved"))):
        if details or scenario.faults[i].when is not None:  # that of a condition may never have begun
            yield Text.assemble((f"fault {i}  ", "red"), line)  # as in --set faults.1.kind
        if note:
            yield Text(f"note   {note}", style="yellow")
    moved = narrator.consequences(found.get("consequences"))
    if details and moved:
        onset = min((f.start_s for f in scenario.faults), default=0.0)
        calm = scenario.flight.weather == "still air" and scenario.manoeuvre.kind == "cruise"
        yield Text(f"flown  from {onset:g} s on{'' if calm else ', gusts and manoeuvres included'}: {moved}")


def _footer(found):
    speed = found.get("realtime_factor")
    line = Text.assemble((found["status"], STATUS.get(found["status"], "red")), f" after {found['sim_time_s']:.2f} s",
                         f", {speed:.0f} x real time" if speed else "",
                         f": {found['reason']}" if found.get("reason") else "")  # fmt: skip
    if not found.get("log"):
        return line
    log = str(found["log"])
    last = f"report {found['report']}" if found.get("report") else f"next   cosim report {word(log)}"
    return Group(line, whole(f"log    {log}{before(found)}"), whole(last))


def before(found: dict[str, Any]) -> str:
    """Return what is to be said behind the name of a log that took the place of another."""
    return " (what the file held is overwritten)" if found.get("overwritten") else ""


def contents(found: dict[str, Any]) -> Group:
    """Return the tables of `cosim info`."""
    head = Table(found["log"], "", "", heads=False)
    for name in ("title", "status", "duration_s", "rate_hz", "ticks", "size_mb"):
        if found.get(name) not in (None, ""):
            head.add(name, str(found[name]))
    whole_ = Cell("complete", "good") if found["complete"] else Cell("incomplete: the run did not end itself", "warn")
    head.add("log", whole_)
    lost = {"gaps": found["gaps"] and f"{found['gaps']} ticks are missing", "problem": found.get("problem")}
    for name, value in lost.items():
        if value:
            head.add(name, value)
    head.add("written by", ", ".join(f"{name} {version}".replace("software ", "") for name, version in
                                     found["versions"].items()))  # fmt: skip
    for name, why in json.loads(found["result"].get("not_run", "{}")).items():
        head.add(f"{name} not run", why)
    topics: dict[str, list[str]] = {}
    for r in found["topics"]:
        root, _, rest = r["name"].removeprefix("/").partition("/")
        topics.setdefault(root, []).append(rest or "itself")
    t = Table("", "topics", "", caption="rows and fields of each: --json")
    for root, names in topics.items():
        t.add(f"/{root}", ", ".join(names) if root != "state" else f"of {len(names)} lanes, once a second")
    kept = [name for name in found["attachments"] if not name.endswith(ARRAYS)]
    t.add("attached", f"{', '.join(kept)}; {len(found['attachments']) - len(kept)} arrays")
    return Group(head, t)


def trim_and_modes(found: dict[str, Any], scenario: "Scenario") -> Group:
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
