"""The three fault scenarios of [Mar10] slide 11, flown with uncertain coefficients and an imperfect IMU, and judged.

Each draw multiplies every aerodynamic coefficient by 0.95 or 1.05, gives each accelerometer a scale factor of +-0.5 %
and a bias of +-2 mg, each gyro a scale factor of +-0.5 %, all a delay of two steps, and a seed for the noise of sensor
set `transport`. The talk does not print its IMU errors: these are assumed. Excitation: load factor +-0.3 g and pedals
of +-3 deg of rudder. Slide 11 has no wind: the air is still. The rows of moments have a second set of flights in
light turbulence, whose gusts make moments that no sensor of slide 6 measures.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.campaign.spec import EVALUATION_SEED
from cosim.flight.detection.detector_context import aircraft
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect
from cosim.flight.loop.signals import fly as fly_signals
from cosim.flight.plant.force_model import force_model
from cosim.scenario.aircraft import load_aircraft
from cosim.scenario.load import load_scenario
from cosim.scenario.tolerance import toleranced
from fdi.control_redundancy import control_redundancy

WIRES = sources("control_redundancy")
NAMES = {1: "thrust-loss", 2: "elevator-lock-then-thrust-loss", 3: "thrust-loss-then-locks"}
# effectors in the order of their faults, with the times of these [s]
TRUTH = {
    1: (("engine", 24.0),),
    2: (("elevator", 24.0), ("engine", 36.0)),
    3: (("engine", 20.5), ("elevator", 24.0), ("rudder", 36.0)),
}
LOSS = {1: 0.25, 2: 0.25, 3: 0.5}  # share of the thrust
GUSTS = 3.0  # on the thresholds of moments: six fault-free flights in light turbulence go to 2.55, a fifth of margin
DOUBLET = ("duration_s=50", "manoeuvre.start_s=22", "manoeuvre.width_s=4", "manoeuvre.amplitude_g=0.3")


def pedals(start: float, width: float = 2.5, angle: float = 3 * RAD_PER_DEG) -> list[Any]:
    """Return a pedal doublet as (time [s], rudder [rad]) corners, ramps of half a second."""
    w = (0.0, 0.5, width, width + 1.0, 2 * width, 2 * width + 0.5)
    return [(start + t, angle * a) for t, a in zip(w, (0, 1, 1, -1, -1, 0))]


PEDALS = (*pedals(24.0), *pedals(34.0))


def scenario(number: int, draw: Any = None, extra: Sequence[Any] = ()) -> Any:
    """Return scenario 1, 2 or 3 with nominal aircraft and sensors (`draw` None) or those of a draw, in still air."""
    changes = ["detectors.enabled=[]", "flight.turbulence=none", *DOUBLET, *extra]
    if number == 1:
        changes.append("faults.0.start_s=24")
    if draw is not None:
        rng = np.random.default_rng([number, draw])
        changes += [
            f"tolerances.aero.{name}={1 + 0.05 * rng.choice((-1, 1))}"
            for name in toleranced("aero")
            if not name.startswith("Ch")
        ]
        for axis in ("n_x", "n_y", "n_z"):
            changes.append(f"sensors.{axis}.scale={1 + 0.005 * rng.choice((-1, 1))}")
            changes.append(f"sensors.{axis}.bias_g={0.002 * rng.choice((-1, 1))}")
        changes += [f"sensors.{axis}.scale={1 + 0.005 * rng.choice((-1, 1))}" for axis in "pqr"]
        changes += [f"sensors.{axis}.delay_s=0.01" for axis in ("n_x", "n_y", "n_z", "p", "q", "r")]
        changes.append(f"seed={EVALUATION_SEED + draw}")
    return load_scenario(NAMES[number], changes)


def fly(number: int, draw: Any = None, extra: Sequence[Any] = ()) -> Any:
    """Fly a scenario with the pedals; return what the detector reads."""

    def prepare(setup):
        setup.loop.law = _Pedals(setup.loop)

    return fly_signals(scenario(number, draw, extra), WIRES.values(), prepare=prepare)


class _Pedals:
    """Advance the law, then add the pedals' share to its rudder command; the law itself does not feed that back."""

    def __init__(self, loop):
        self._law, self._clock, self._x = loop.law, loop.bus["clock"], loop.law.x
        self._time, self._angle = np.array(PEDALS).T

    def __getattr__(self, name):
        return getattr(self._law, name)

    def advance(self):
        """Advance by one step, in place."""
        self._law.advance()
        self._x["dr_cmd"] += np.interp(self._clock["t"][0], self._time, self._angle)


def detector_log(flown: Any, p: Any) -> Any:
    """Return the detector's log on a flown table, (ticks,)."""
    return detect(flown, control_redundancy, WIRES, p)


def detector(gusts: Any = False, **kw: Any) -> Any:
    """Return PARAMS with commands two steps late, as the measurements are, and the actuators' own delay.

    `gusts`: the thresholds of the rows of moments are those for light turbulence.
    """
    own = aircraft(load_aircraft())
    late, rate = own.delays, own.rates
    p = control_redundancy.params(model=force_model(), delay=2, lag=late, rate=rate, **kw)
    p["threshold"][:, 3:] *= GUSTS if gusts else 1.0
    return p


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Hold what a run declared: `order` of first declarations (time [s], name), `right`, `extra`, `early`."""

    order: tuple
    right: bool
    extra: int
    early: int
    reach: float = math.nan  # what the loss of thrust does to the residual that sees it best, over its threshold
    before: float = math.nan  # that residual before the loss over its threshold, positive where it hides the loss
    noise: float = math.nan  # standard deviation of one sample of row X over what the loss does to it
    held: float = math.nan  # longest time that the engine alone explained the residuals over t_confirm, 1: declared
    shared: float = math.nan  # of the time beyond the thresholds after the loss: engine and single engines explain it


def judge(number: int, flown: Any, log: Any) -> Any:
    """Return the `Outcome`: right when the true effectors are the first declared, in order, each after its fault."""
    found = []
    for h, name in enumerate(control_redundancy.EFFECTORS):
        rise = np.flatnonzero(np.diff(np.r_[0.0, log["declared"][:, h]]) > 0)
        found += [(float(flown.index[i]), name) for i in rise]
    found.sort()
    first = [pair for i, pair in enumerate(found) if pair[1] not in [n for _, n in found[:i]]]
    truth = TRUTH[number]
    right = [n for _, n in first[: len(truth)]] == [n for n, _ in truth]
    right = right and all(t >= at for (t, _), (_, at) in zip(first, truth))
    early = sum(t < dict(truth).get(n, math.inf) for t, n in found)
    return Outcome(tuple(first), right, len(found) - len(truth), early)


def margins(number: int, flown: Any, log: Any, p: Any) -> dict[str, Any]:
    """Return {field of `Outcome`: value} of what stands between the loss of thrust and its declaration."""
    start, share = dict(TRUTH[number])["engine"], LOSS[number]
    onset, engine = round(start / flown.attrs["dt"]), control_redundancy.CULPRITS.index("engine")
    first = np.flatnonzero(log["used"].max(axis=1) > 0.5)[0]  # the loss of scenario 3 comes while averages fill
    k = max(onset - 1, int(first))
    on = np.flatnonzero(log["used"][k] > 0.5)
    S, tau = log["S"][k, on, engine - 1], log["tau"][k, on]
    f = np.abs(S / tau).argmax()
    quiet = slice(onset - round(3.0 / flown.attrs["dt"]), onset)
    known = log["valid"][quiet] > 0.5
    hides = log["res"][quiet, on[f]][known] * np.sign(S[f]) / tau[f]  # the loss is a negative fault
    noise = np.diff(log["e"][quiet, 0]).std() / math.sqrt(2.0)
    late = log[onset:]
    declared = np.flatnonzero(late["declared"][:, engine - 1] > 0.5)
    late = late[: declared[0] if len(declared) else None]
    held = np.where(late["last"] == engine, late["timer"], 0.0).max(initial=0.0) / p["t_confirm"][0]
    bits = late["candidates"][late["r"] >= 1.0].astype(int)
    both = (bits >> engine - 1 & 1 > 0) & (bits >> engine > 0)
    return {
        "reach": share * abs(S[f]) / tau[f],
        "before": float(np.median(hides)) if len(hides) else math.nan,
        "noise": noise / (share * abs(log["S"][k, 0, engine - 1])),
        "held": 1.0 if len(declared) else held,
        "shared": both.mean() if len(bits) else 0.0,
    }


def campaign(number: int, draws: Any, *, options: Sequence[Any] = ({},), extra: Sequence[Any] = ()) -> Any:
    """Fly scenario `number` `draws` times, judge with each set of detector `options`: {set: [Outcome]}.

    `extra`: overrides of the scenario.
    """
    sets = [detector(**kw) for kw in options]
    out: dict = {i: [] for i in range(len(sets))}
    for draw in range(draws):
        flown = fly(number, draw, extra)
        for i, p in enumerate(sets):
            log = detector_log(flown, p)
            out[i].append(dataclasses.replace(judge(number, flown, log), **margins(number, flown, log, p)))
    return out
