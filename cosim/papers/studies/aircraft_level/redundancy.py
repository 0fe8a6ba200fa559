"""The three scenarios of [Mar10] slide 11 in many draws: right effectors in the right order, what else is declared.

Flights and judgement are those of `cosim.papers.mar10.flights`: every coefficient 5 % off, IMU errors, two steps of
delay, locks in a manoeuvre of +-0.3 g and +-3 deg of rudder. Each flight is judged with each set of options.
"""

import numpy as np

from cosim.campaign.jobs import many
from cosim.flight import airframe_wires
from cosim.judge.alarms import onsets
from cosim.papers.mar10 import flights
from cosim.papers.studies.aircraft_level.table import Table
from fdi.common.verdict import AMBIGUOUS
from fdi.control_redundancy import control_redundancy

DRAWS = 100
WANTED = 95.0  # [% of the draws], with the learned offset
OPTIONS: dict[str, dict] = {
    "force, learned offset": {},
    "force, no offset": {"t_learn": 0.0},
    "force+moment, learned offset": {"rows": "force+moment"},
    "force+moment, no offset": {"rows": "force+moment", "t_learn": 0.0},
}
NAMES = control_redundancy.CULPRITS[1:]


def declarations(number, draw):
    """Fly scenario `number` with the errors of `draw`; return, per set of OPTIONS, [[time, effector], ...], in order.

    The effector "ambiguous" is an alarm without a single explanation.
    """
    flown, wires = flights.fly(number, draw), airframe_wires.control_redundancy()
    return [found(flown.t, flown.run(control_redundancy, wires, flights.detector(**kw))) for kw in OPTIONS.values()]


def found(t, log):
    """Return [[time, effector], ...] of a detector's log, in order of time."""
    out = []
    for h, name in enumerate(NAMES):
        out += [[float(t[i]), name] for i in onsets(log["declared"][:, h])]
    unclear = (log["alarm"] > 0.5) & (log["verdict"] == AMBIGUOUS) & (log["culprit"] == 0.0)
    out += [[float(t[i]), "ambiguous"] for i in onsets(unclear)]
    return sorted(out)


def judged(number, declared):
    """Return (right, extra, early, {true effector: what was declared first in its time}) of one flight.

    Right: the true effectors are the first to be declared, in their order, each after its fault. Extra: declarations
    beyond the first of each true effector. Early: before the first fault of that effector. An "ambiguous" alarm is no
    declaration.
    """
    truth, named = flights.TRUTH[number], [d for d in declared if d[1] != "ambiguous"]
    first: dict = {}
    for time, name in named:
        first.setdefault(name, time)
    order = sorted(first, key=first.__getitem__)[: len(truth)]
    right = order == [n for n, _ in truth] and all(first[n] >= at for n, at in truth)
    extra = len(named) - sum(n in first for n, _ in truth)
    early = sum(time < dict(truth).get(name, -np.inf) for time, name in named)
    said, ends = {}, [at for _, at in truth[1:]] + [np.inf]
    for (name, at), end in zip(truth, ends):
        window = [d[1] for d in declared if at <= d[0] < end]
        clear = [n for n in window if n != "ambiguous"]
        said[name, at] = clear[0] if clear else "ambiguous" if window else "none"
    return right, extra, early, said


def run(*, draws=DRAWS, out=None, workers=2, progress=None):
    """Return the tables: scenarios by options, and the confusion matrix of each set of options."""
    jobs = [(number, draw) for draw in range(draws) for number in flights.NAMES]
    file = None if out is None else out / "redundancy.jsonl"
    got = many(declarations, jobs, out=file, workers=workers, progress=progress)
    rows, tables = [], []
    for i, label in enumerate(OPTIONS):
        counts: dict = {}
        for number in flights.NAMES:
            results = [judged(number, got[number, draw][i]) for draw in range(draws)]
            share = 100.0 / draws
            rows.append((label, f"{number}: " + ", ".join(n for n, _ in flights.TRUTH[number]),
                         share * sum(r[0] for r in results), share * sum(r[1] > 0 for r in results),
                         sum(r[1] for r in results), share * sum(r[2] > 0 for r in results)))  # fmt: skip
            for result in results:
                for (name, at), said in result[3].items():
                    key = f"{number}: {name} at {at:g} s"
                    counts.setdefault(key, {}).setdefault(said, 0)
                    counts[key][said] += 1
        columns = [n for n in (*NAMES, "ambiguous", "none") if any(n in c for c in counts.values())]
        matrix = [(k, *(c.get(n, 0) for n in columns)) for k, c in counts.items()]
        title = f"{label}: declared first between this fault and the next, {draws} draws"
        tables.append(Table(title, ("fault", *columns), matrix))
    head = ("rows, offset", "scenario", "right, in order [%]", "extra declaration in [%]", "extra in all",
            "before its fault in [%]")  # fmt: skip
    note = f"{WANTED:g} % are wanted of force rows with the learned offset, of no other"
    return [Table(f"[Mar10] in {draws} draws of +-5 %, IMU errors, two steps of delay", head, rows, (note,)), *tables]
