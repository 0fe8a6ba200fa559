"""Numbers of a detector tuned on a stated criterion: `cosim train DETECTOR --tune FIELD=LOW:HIGH`.

[Mar10] slide 17: "Automatic tuning of FDI approaches for systematic comparison". The flights of a campaign that have no
fault, or one that the detector is designed for, are flown once; the search replays them with other thresholds, windows
and times of confirmation. Criterion: least mean detection delay, where a missed fault counts until its end or that of
the flight, at no more false alarms per valid hour than stated. What is found stands beside the numbers in use, on the
campaign's flights and on as many that are drawn and flown with other seeds. Nothing is stored.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from cosim.campaign.spec import load_campaign
from cosim.errors import DesignError, TrimError
from cosim.flight.detection.detectors import Installed, chosen
from cosim.flight.detection.parameters import assign
from cosim.flight.faults.conditions import resolved
from cosim.flight.loop.signals import detect, fly
from cosim.judge.alarms import detection, exposure_s, faulty, onsets
from cosim.judge.coverage import DESIGNED, cases, expected
from cosim.scenario import Scenario

FIRST_SEED, OTHER_SEED = 700_000, 27_000_000  # of the flights that teach, and of those that only compare
ROUNDS, EACH = 8, 5  # of the search: populations, and members for each number


class Score(NamedTuple):
    """What a detector does in some flights; false alarms and exposure are sums over lanes."""

    faults: int
    seen: int
    delay_s: float  # mean, a missed fault counted until its end [s]
    false: int
    exposed_s: float

    @property
    def cells(self) -> tuple[str, ...]:
        """Return (seen, mean delay, false alarms) in words."""
        hours = self.exposed_s / 3600.0
        return f"{self.seen} of {self.faults}", f"{self.delay_s:.2f} s", f"{self.false} in {hours:.2f} h"


@dataclasses.dataclass(frozen=True)
class Watched:
    """A flown scenario as one detector reads it."""

    scenario: Scenario
    detector: Installed

    @cached_property
    def frame(self) -> Any:
        """Return what was flown, a row per tick."""
        return fly(self.scenario, [source for _, source in self.detector.wires()])

    def replay(self, values: Mapping[str, float]) -> Score:
        """Return the Score of the flight with `values` for numbers of the detector."""
        d, frame = self.detector, self.frame
        dt = frame.attrs["dt"]
        p = d.params(self.scenario, dt)
        for name, value in values.items():
            assign(d.record, d.module, p, name, value, dt, error=DesignError, place=f"--tune {name}")
        wires = [{w.field: w.source for w in d.inputs(lane)} for lane in d.lanes]
        log = detect(frame, d.module, wires, p, ("alarm", "valid"))
        faults = [{"start_s": f.start_s, "end_s": f.end_s or math.inf} for f in self.scenario.faults]
        caused = faulty(faults, len(frame), dt)
        false = sum(int((~caused[onsets(lane["alarm"])]).sum()) for lane in log)
        exposed = sum(exposure_s(lane["valid"], faults, dt) for lane in log)
        if not faults:
            return Score(0, 0, 0.0, false, exposed)
        first, end = round(faults[0]["start_s"] / dt), math.floor(min(faults[0]["end_s"] / dt, len(frame)))
        at = [k for lane in log if (k := detection(lane["alarm"], first, end)) is not None]
        return Score(1, bool(at), (min(at, default=end) - first) * dt, false, exposed)


def flights(campaign: str, name: str, first_seed: int, most: int) -> list[Watched]:
    """Return about `most` flights of a campaign without a fault and as many with one that detector `name` is designed
    for, drawn with `first_seed`. Raises DesignError where it has none of either."""
    spec = load_campaign(campaign)
    spec = dataclasses.replace(spec, first_seed=first_seed, seed=spec.seed + first_seed)
    kinds: tuple[list, list] = [], []
    for scenario in spec.scenarios()[0]:
        met = [expected(name, case) for case in cases(scenario)]
        if not met or DESIGNED in met:
            kinds[bool(met)].append(scenario)
    if not all(kinds):
        lacks = "without a fault" if not kinds[0] else f"with a fault that {name} is designed for"
        raise DesignError(f"has no flight {lacks}", place=campaign, remedy="Choose another --campaign")
    out = []
    for scenario in (s for kind in kinds for s in kind[:: max(1, len(kind) // most)][:most]):
        detectors = scenario.detectors.model_copy(update={"enabled": [name]})
        own = resolved(scenario.model_copy(update={"detectors": detectors}))
        out += [Watched(own, d) for d in chosen(own) if d.id == name]
    return out


def score(watched: Sequence[Watched], values: Mapping[str, float]) -> Score:
    """Return the Score of a detector over flights, perhaps none, with `values` for its numbers."""
    total = Score(*map(sum, zip(Score(0, 0, 0.0, 0, 0.0), *(w.replay(values) for w in watched))))
    return total._replace(delay_s=total.delay_s / max(total.faults, 1))


def tune(
    name: str, spans: Mapping[str, tuple[float, float]], *, campaign: str, false_per_hour: float, most: int,
    first_seed: int = FIRST_SEED, progress: Callable[[int, int], None] | None = None,
) -> tuple[dict[str, float], list[tuple[str, Score]]]:  # fmt: skip
    """Return ({field: number found in its span}, [(flights and numbers, Score)]) of detector `name`.

    The search is differential evolution (SciPy) over the logarithms; sets with too many false alarms rank behind all
    others, by how many they have. Raises DesignError for a span or field that cannot be.
    """
    for field, (low, high) in spans.items():
        if not 0.0 < low < high:
            raise DesignError(f"{low:g}:{high:g}", place=f"--tune {field}", allowed="LOW:HIGH, 0 < LOW < HIGH")
    taught = [w for w in flights(campaign, name, first_seed, most) if _trims(w)]
    total, done = EACH * len(spans) * (ROUNDS + 1), 0
    free = [w for w in taught if not w.scenario.faults]

    def cost(logs):
        nonlocal done
        done += 1
        if progress:
            progress(min(done, total), total)
        values = dict(zip(spans, np.exp(logs).tolist(), strict=True))
        for group in (free, taught):  # the fault-free ones first: most sets fail there
            found = score(group, values)
            if (more := found.false - false_per_hour * found.exposed_s / 3600.0) > 0.0:
                return 1e6 + more
        return found.delay_s

    best = differential_evolution(cost, np.log(list(spans.values())), popsize=EACH, maxiter=ROUNDS, seed=first_seed,
                                  init="sobol", polish=False, tol=0.0)  # fmt: skip
    values = dict(zip(spans, [float(f"{v:.4g}") for v in np.exp(best.x)], strict=True))
    others = [w for w in flights(campaign, name, OTHER_SEED, most) if _trims(w)]
    told = [(f"{flown}, {numbers}", score(group, set_)) for flown, group in (("training", taught), ("other", others))
            for numbers, set_ in (("in use", {}), ("tuned", values))]  # fmt: skip
    return values, told


def _trims(watched):
    """Fly; tell whether the point could be flown."""
    try:
        return len(watched.frame) > 0
    except TrimError:
        return False
