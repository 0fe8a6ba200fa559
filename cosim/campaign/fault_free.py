"""Fault-free flights, of which only the largest of every detector's statistic is kept.

    told = fly("fault-free", 17)        # plain data of flight 17; FaultFreeFlight.read(told) gives it back

A flight becomes, per detector, the largest |r| over its lanes, where it judges. Where |r| has to stay beyond 1 for a
time, and that is the whole decision, the least of that time counts; else every crossing does, which bounds the alarms.
"""

import functools
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass
from scipy.ndimage import minimum_filter1d

from cosim.campaign.spec import Space, load_campaign
from cosim.errors import TrimError
from cosim.judge.alarms import exposure_s, onsets
from cosim.judge.detection import valid

FIRST_SEED = 6_000_000  # of the flights: none of training, nor of another campaign
# detectors whose whole decision is |r| >= 1 for a time: the parameter that holds it [s]
CONFIRMED = {"position_monitor": "t_confirm", "rtsekf": "t_confirm", "rtsekf_flight": "pair_confirm"}


Count = Annotated[int, Field(strict=True, ge=0)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, ge=0.0)]
CONFIG = ConfigDict(extra="forbid", allow_inf_nan=False)


class Moments(NamedTuple):
    """What one flight of a residual comes to: sums over its samples, none of which is kept."""

    n: Annotated[int, Field(strict=True, ge=1)]
    s1: Number  # sum of r
    s2: Number
    s3: Number
    s4: Number
    lag1: Number  # sum of r_k r_k+1
    memory: Number  # samples that stand for one independent sample, of the mean
    memory2: Number  # of the variance

    @classmethod
    def of(cls, r: ArrayLike) -> "Moments":
        """Return the Moments of a flight's residual (ticks,)."""
        r = np.asarray(r, float)
        s1, s2, s3, s4 = (float((r**j).sum()) for j in (1, 2, 3, 4))
        return cls(len(r), s1, s2, s3, s4, float(r[1:] @ r[:-1]), *_memory(r))


def _memory(r):
    """Return 1 + 2 sum rho_j and 1 + 2 sum rho_j^2 over lags up to a tenth of r (Bartlett 1946)."""
    n = len(r)
    d = r - r.mean()
    c = np.fft.irfft(np.abs(np.fft.rfft(d, 2 * n)) ** 2)[: max(n // 10, 2)]
    if not c[0] > 0.0:
        return float(n), float(n)
    rho = c[1:] / c[0]
    return max(1.0, float(1.0 + 2.0 * rho.sum())), float(1.0 + 2.0 * (rho @ rho))


@dataclass(frozen=True, config=CONFIG)
class Lane:
    """What a flight keeps of one detector."""

    peak: Positive  # largest of its lanes, 0 where none judges
    valid_s: Positive  # time in which an alarm would count, mean over its lanes (cosim.judge.alarms.exposure_s)
    alarms: Count  # that rose
    silent: Annotated[Count, Field(le=1)]  # of these flights, 1: it alarmed though the statistic stayed below 1
    moments: tuple[Moments, ...]  # of each lane with a signed residual


@dataclass(frozen=True, config=CONFIG)
class FaultFreeFlight:
    """A flown flight."""

    seconds: Positive
    dt: Positive
    status: str
    lanes: dict[str, Lane]

    @classmethod
    def read(cls, told: Any) -> "FaultFreeFlight":
        """Return the FaultFreeFlight of what `fly` returned; raises ValueError for what it never returns."""
        return TOLD.validate_python(told)


TOLD = TypeAdapter(FaultFreeFlight)


@functools.cache
def space(campaign: str) -> Space:
    """Return the space that a campaign's flights are taken from."""
    return Space(load_campaign(campaign), first_seed=FIRST_SEED)


def fly(campaign: str, number: int, digest: str = "", files: Sequence[str] = (), also: Sequence[str] = ()) -> dict:
    """Fly one flight, also past the user's detectors in `files` and the shipped ones `also`, and return what is kept of
    it, as plain data; `digest` tells files of one name apart."""
    from cosim.flight.build import build
    from cosim.flight.faults.conditions import resolved
    from cosim.flight.fly import fly as flown
    from cosim.flight.plugins import with_detectors
    from cosim.scenario.user_parts import identified

    flight = space(campaign).number(number)
    enabled = tuple(dict.fromkeys((*flight.detectors.enabled, *also)))
    flight = flight.model_copy(update={"detectors": flight.detectors.model_copy(update={"enabled": enabled})})
    try:
        setup = build(resolved(identified(with_detectors(flight, files))))
    except TrimError:
        return {"seconds": 0.0, "dt": 0.0, "status": "infeasible", "lanes": {}}
    trace, status, _ = flown(setup)
    if status == "interrupted":
        raise KeyboardInterrupt
    dt, watches = setup.loop.dt, setup.watches()
    p = {b.name: b.p for b in setup.loop.detectors}
    lanes = {}
    for name in dict.fromkeys(w.id for w in watches):
        own = [w for w in watches if w.id == name and w.r is not None]
        if own:
            lanes[name] = _kept(trace, own, p.get(name), dt)
    return {"seconds": len(trace) * dt, "dt": dt, "status": status, "lanes": lanes}


def _kept(trace, own, p, dt):
    """Return what is kept of one detector's lanes."""
    peak, exposed, alarms, moments = 0.0, 0.0, 0, []
    parameter = CONFIRMED.get(own[0].id)
    for i, watch in enumerate(own):
        able = valid(watch, trace)
        r = np.where(able & np.isfinite(trace[:, watch.r]), trace[:, watch.r].astype(float), 0.0)
        if r.min() < 0.0 < r.max():
            moments.append([*Moments.of(r[able])])
        size = np.abs(r)
        if parameter:
            n = max(1, round(float(p[i][parameter]) / dt))
            size = minimum_filter1d(size, n, mode="constant", origin=(n - 1) // 2)
        peak = max(peak, float(size.max()))
        exposed += exposure_s(able, (), dt) / len(own)
        alarms += len(onsets(trace[:, watch.alarm]))
    silent = int(alarms > 0 and peak < 1.0)
    return {"peak": peak, "valid_s": exposed, "alarms": alarms, "silent": silent, "moments": moments}
