"""What a detector made of one segment's fault: alarm, first, right and last name, withdrawal; read from its log.

A *right* name is the class, and for a sensor the culprit, of the fault; `ambiguous` is never one. A jam or a runaway
counts from when the healthy rod, the servo's reference, is EXCITED away from the real one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.papers.studies.local_flights import REFERENCE, ROD
from cosim.papers.studies.naming import named
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import DT
from fdi.common import verdict as v

EXCITED = 1e-3  # [m]
RIGHT = {  # first word of a case's name -> (class, culprit)
    "liquid": (v.OFC_LIQUID, ""), "slow_liquid": (v.OFC_LIQUID, ""),
    "solid": (v.OFC_SOLID, ""), "slow_solid": (v.OFC_SOLID, ""),
    "large_liquid": (v.OFC_LIQUID, ""), "large_solid": (v.OFC_SOLID, ""),
    "sensor_ofc": (v.SENSOR, "rod"), "runaway": (v.RUNAWAY, ""), "jam": (v.JAM_SOLID, ""),
    "rod": (v.SENSOR, "rod"), "surface": (v.SENSOR, "surface"),
    "rod_noise": (v.SENSOR, "rod"), "pressure_noise": (v.SENSOR, "pressure"),
}  # anything else: EFFECTIVENESS


@dataclass(frozen=True)
class Outcome:
    """Times in s from the onset, inf for never; names are class names, a sensor's with its culprit."""

    early: bool  # an alarm before the onset (but for a first fault of a sensor)
    excited: float  # from when it shows
    delay: float  # to the first alarm
    first: str  # name at that moment
    sure: str  # first name that is not `ambiguous`
    sure_after: float
    right_after: float
    changes: int  # of name while the alarm stands
    last: str  # last name before the fault ends
    standing: float  # share of time with the alarm, from the first alarm to the end of the fault, while excited
    ambiguous: float  # share of the time that the alarm stands
    withdrawn: float  # from the end of the fault [s]; nan: not healed
    realarms: int  # alarms that rise after the fault has ended
    period: float  # of an oscillation [s]


def right(name: str) -> Any:
    """Return (class, culprit) of the right name of a case."""
    return RIGHT.get(name.split("_0")[0], (v.EFFECTIVENESS, ""))


def outcome(lane: Any, log: Any, frame: Any, i: Any, culprits: Any) -> Any:
    """Return the Outcome of segment `i`, whose `lane` entry of the draw tells the fault; log: (4, ticks) of STATE."""
    fault = lane["faults"][-1]
    n = log.shape[1]
    a = min(int(np.ceil(fault["start_s"] / DT - 1e-6)), n - 1)
    b = min(int(np.ceil(fault.get("end_s", n * DT) / DT - 1e-6)), n)
    alarm, said, who = (log[f][i] for f in ("alarm", "verdict", "culprit"))
    alarm = alarm > 0.5
    away = np.abs(np.asarray(frame[REFERENCE.format(SEGMENTS[i])] - frame[ROD.format(SEGMENTS[i])])) > EXCITED
    moved = lane["name"] in ("runaway", "jam")
    shows = a + int(np.argmax(away[a:b])) if away[a:b].any() else n * 1000
    wanted, culprit = right(lane["name"])
    settled = round(2.0 / DT)
    if "first" in lane:  # a verdict on the first fault stands already: only other names count from here
        old = (said == v.SENSOR) & (who == culprits.index(lane["first"]))
        alarm = alarm & ~old
    early = bool(alarm[settled:a].any()) and "lost" not in lane and "first" not in lane
    on = np.flatnonzero(alarm[a:b])
    none = dict(early=early, excited=(shows - a) * DT if moved else 0.0, delay=np.inf, first="none", sure="none",
                sure_after=np.inf, right_after=np.inf, changes=0, last="none", standing=np.nan, ambiguous=np.nan,
                withdrawn=np.nan, realarms=0, period=1.0 / fault.get("frequency_hz", np.nan))
    if not len(on):
        return Outcome(**none)
    k = a + on[0]
    hit = np.flatnonzero((said[a:b] == wanted) & alarm[a:b] &
                         (who[a:b] == culprits.index(culprit) if culprit in culprits else False))
    sure = np.flatnonzero(alarm[a:b] & (said[a:b] != v.AMBIGUOUS))
    names = said[a:b] * 10 + who[a:b]
    names = names[alarm[a:b]]
    excited = away[k:b] if moved else np.ones(b - k, bool)
    last = a + on[-1]
    after = np.flatnonzero(alarm[b:])
    return Outcome(**{
        **none,
        "delay": (k - a) * DT,
        "first": named(said[k], who[k], culprits),
        "sure": named(said[a + sure[0]], who[a + sure[0]], culprits) if len(sure) else "ambiguous",
        "sure_after": sure[0] * DT if len(sure) else np.inf,
        "right_after": hit[0] * DT if len(hit) else np.inf,
        "changes": int((np.diff(names) != 0).sum()),
        "last": named(said[last], who[last], culprits),
        "standing": float(alarm[k:b][excited].mean()) if excited.any() else np.nan,
        "ambiguous": float((said[a:b][alarm[a:b]] == v.AMBIGUOUS).mean()),
        "withdrawn": ((after[-1] + 1) * DT if after[-1] < n - b - 1 else np.inf) if len(after) else 0.0 if b < n
        else np.nan,
        "realarms": int((np.diff(alarm[b - 1 :].astype(int)) > 0).sum()) if b < n else 0,
    })
