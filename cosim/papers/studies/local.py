"""What the hydraulic filters say of a fault: first name, right name, last name, and when the alarm ends.

Every flight (`local_flights`) has a fault of its own on each segment; each segment is a run of the tables, with exact
(Clopper-Pearson) 95 % intervals. `ambiguous` never counts as a right name. Flights of other seeds, DEVELOPMENT on, were
used to make the decisions; those of the tables begin at FIRST.
"""

from collections import Counter, defaultdict
from dataclasses import asdict
from typing import Any

import numpy as np

from cosim.papers.studies import Options, Question, Table, naming
from cosim.papers.studies.local_flights import DEGRADATIONS, NOISES, flown
from cosim.papers.studies.local_outcome import Outcome, outcome, right
from cosim.papers.studies.naming import share
from cosim.training.flights import watch
from fdi.common import verdict
from fdi.hydraulic import iotsekf, rtsekf_flight
from fdi.monitors import ofc_monitor, position_monitor

ABOUT = "How the hydraulic filters name faults, and when their alarms end; times are for one free core."
DEVELOPMENT, FIRST = 5_000_000, 21_000_000  # first seeds
FIELDS = ("alarm", "verdict", "culprit")
WATCHED = {"iotsekf": iotsekf, "rtsekf_flight": rtsekf_flight, "position_monitor": position_monitor,
           "ofc_monitor": ofc_monitor}  # fmt: skip
SHARES = {"mixed": 1.0, "moved": 0.5, "slow": 0.34, "lost": 0.34, "second": 0.34,
          "large": 0.5}  # of the flights asked for  # fmt: skip
CASES = ("liquid", "solid", "sensor_ofc", "runaway", "jam", "slow_liquid", "slow_solid", "large_liquid",
         "large_solid", "liquid_0.3", "liquid_0.2", "rod", "surface")  # fmt: skip


def fly_one(family: str, k: int, seed: int, feedback: Any) -> list[Any]:
    """Fly flight `k` of a family; return [[segment's draw, air, Outcome of iotsekf as a dict]] of its segments."""
    frame, lanes, air = flown(family, k, seed, feedback)
    log = watch(frame, iotsekf, iotsekf.params(), FIELDS)
    return [[lane, air, asdict(outcome(lane, log, frame, i, iotsekf.CULPRITS))] for i, lane in enumerate(lanes)]


def fly_free(k: int, seed: int, feedback: Any) -> list[Any]:
    """Fly flight `k` without a fault; return [air, {detector: [names that it gave, seconds of alarm]}]."""
    frame, _, air = flown("free", k, seed, feedback)
    return [air, naming.cried({name: watch(frame, m, m.params(), FIELDS) for name, m in WATCHED.items()})]


def _runs(values):
    return [(lane, air, Outcome(**o)) for flight in values for lane, air, o in flight]


def _limit(o):
    return 3.0 if np.isnan(o.period) else 2.0 * o.period + 2.0


def _withdrawn(runs):
    found = defaultdict(list)
    for lane, air, o in runs:
        if lane["healed"] and np.isfinite(o.delay):
            found[lane["name"], air].append(o)
            found["all", ""].append(o)
    rows = []
    for (name, air), own in sorted(found.items()):
        rows.append([name, air, share(sum(o.withdrawn <= _limit(o) for o in own), len(own)),
                     float(np.median([o.withdrawn for o in own])), sum(np.isinf(o.withdrawn) for o in own),
                     sum(o.realarms > 0 for o in own)])  # fmt: skip
    return Table("alarm withdrawn after the fault heals: within 3 s, an oscillation's within two periods and 2 s",
                 ("fault", "air", "in time", "median [s]>", "never>", "again>"), rows)


def _names(runs):
    rows, times = [], []
    for name in CASES:
        own = [o for lane, _, o in runs if lane["name"] == name and "lost" not in lane and "first" not in lane]
        seen = [o for o in own if np.isfinite(o.delay)]
        if not own:
            continue
        code, culprit = right(name)
        good = f"{verdict.name(code)} {culprit}".strip()
        n = len(seen)
        unit = [1.0 / o.period if o.period > 0 else 1.0 for o in own]
        alarm = np.array([(o.delay - o.excited) * u for o, u in zip(own, unit)])
        at = np.array([(o.right_after - o.excited) * u for o, u in zip(own, unit)])
        middle = float(np.median(at))
        last = Counter(o.last for o in seen)
        rows.append([name, share(n, len(own)), share(sum(o.first in (good, "ambiguous") for o in seen), n),
                     share(sum(o.sure in (good, "ambiguous") for o in seen), n), share(last[good], n),
                     share(last[good], n - last["ambiguous"]), share(sum(o.changes <= 1 for o in seen), n),
                     share(sum(o.standing >= 0.95 for o in seen), sum(o.standing == o.standing for o in seen))])
        times.append([name, "periods" if own[0].period > 0 else "s", float(np.median(alarm)), _high(alarm), middle,
                      _high(at), share(int((at <= 2.0 * middle).sum()), len(own)),
                      share(int((alarm <= 3.0).sum()), len(own)) if own[0].period > 0 else None,
                      float(np.mean([o.ambiguous for o in seen])) if seen else None])  # fmt: skip
    return [Table("names of what was seen", ("fault", "seen", "first right or ambiguous", "sure name right or none",
                                             "last right", "of those named", "one change at most",
                                             "alarm stands >= 95 %"), rows),
            Table("times, of a runaway and a jam from when the healthy rod is 1 mm away", (
                "fault", "unit", "alarm: median>", "95 %>", "right name: median>", "95 %>", "in twice the median",
                "alarm within 3 periods", "ambiguous share>"), times)]  # fmt: skip


def _high(values):
    return float(np.quantile(values, 0.95, method="higher"))


def _others(runs):
    rows = []
    for name in (*DEGRADATIONS, *NOISES):
        own = [o for lane, _, o in runs if lane["name"] == name]
        seen = [o for o in own if np.isfinite(o.delay)]
        wrong = sum(any(w in said for w in ("ofc", "runaway", "jam") + (("sensor",) if name in DEGRADATIONS else
                    ("effectiveness",))) for o in seen for said in [f"{o.first} {o.sure} {o.last}"])  # fmt: skip
        rows.append([name, share(len(seen), len(own)), share(len(seen) - wrong, len(seen)),
                     ", ".join(f"{k} {v}" for k, v in Counter(o.last for o in seen).items())])
    return Table("degradations and noise: never another fault's name", ("fault", "seen", "no wrong name", "last name"),
                 rows)


def _reduced(runs, key, title):
    found = defaultdict(list)
    for lane, _, o in runs:
        if key in lane:
            found[lane[key], lane["name"]].append(o)
    rows = [[f"{first}, then {name}", share(sum(np.isfinite(o.delay) for o in own), len(own)),
             float(np.median([o.delay - o.excited for o in own])),
             ", ".join(f"{k} {v}" for k, v in Counter(o.last for o in own).items())]
            for (first, name), own in sorted(found.items())]  # fmt: skip
    return Table(title, ("", "seen", "median delay [s]>", "last name"), rows)


def _faults(options, values):
    runs = _runs(values)
    return [_withdrawn(runs), *_names(runs), _others(runs),
            _reduced(runs, "lost", "a sensor is lost at 5 s, a fault comes later"),
            _reduced(runs, "first", "a sensor is wrong from 5 s on, a second fault comes later")]  # fmt: skip


def _free(options, values):
    return [naming.free_table(values)]


def _jobs(feedback):
    def jobs(o: Options):
        return [(fly_one, {"family": f, "k": k, "seed": FIRST, "feedback": feedback})
                for f, part in SHARES.items() for k in range(max(round(part * o.seeds), 1))]  # fmt: skip

    return jobs


def questions() -> list[Question]:
    """Return the Questions of the study."""
    return [
        Question("names", "every fault, servos on their measurement (2 min)", _jobs("measured"), _faults, seeds=120),
        Question("estimate", "the same flights, servos on the filter's estimate (1 min)", _jobs("iotsekf"), _faults,
                 seeds=48),
        Question("free", "flights without a fault (2 min)", lambda o: [
            (fly_free, {"k": k, "seed": FIRST, "feedback": "measured"}) for k in range(o.seeds)], _free, seeds=120),
    ]  # fmt: skip
