"""The three fault scenarios of [Mar10] slide 11, flown with uncertain coefficients and an imperfect IMU, and judged.

Each draw multiplies every aerodynamic coefficient by 0.95 or 1.05, gives each accelerometer a scale factor of +-0.5 %
and a bias of +-2 mg, each gyro a scale factor of +-0.5 %, all a delay of two steps, and a seed for the noise of sensor
set `transport`. The talk does not print its IMU errors: these are assumed. Excitation: load factor +-0.3 g and pedals
of +-3 deg of rudder. Slide 11 has no wind: the air is still.
"""

import dataclasses
import math
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
from cosim.scenario.catalog import toleranced
from cosim.scenario.load import load_scenario
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
DOUBLET = ("duration_s=50", "manoeuvre.start_s=22", "manoeuvre.width_s=4", "manoeuvre.amplitude_g=0.3")


def pedals(start: float, width: float = 2.5, angle: float = 3 * RAD_PER_DEG) -> list[Any]:
    """Return a pedal doublet as (time [s], rudder [rad]) corners, ramps of half a second."""
    w = (0.0, 0.5, width, width + 1.0, 2 * width, 2 * width + 0.5)
    return [(start + t, angle * a) for t, a in zip(w, (0, 1, 1, -1, -1, 0))]


PEDALS = (*pedals(24.0), *pedals(34.0))


def scenario(number: int, draw: int | None = None) -> Any:
    """Return scenario 1, 2 or 3 with nominal aircraft and sensors (`draw` None) or those of a draw, in still air."""
    changes = ["detectors.enabled=[]", "flight.turbulence=none", *DOUBLET]
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


def fly(number: int, draw: int | None = None) -> Any:
    """Fly a scenario with the pedals; return what the detector reads."""

    def prepare(setup):
        setup.loop.law = _Pedals(setup.loop)

    return fly_signals(scenario(number, draw), WIRES.values(), prepare=prepare)


class _Pedals:
    """Advance the law, then add the pedals' share to its rudder command; the law itself does not feed that back."""

    rollout = None  # not the law's compiled one, which knows no pedals: the tape calls `advance`

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


def detector(**values: Any) -> Any:
    """Return PARAMS with commands two steps late, as the measurements are, and the actuators' own delay."""
    own = aircraft(load_aircraft())
    return control_redundancy.params(model=force_model(), delay=2, lag=own.delays, rate=own.rates, **values)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a run declared: `order` of first declarations (time [s], name), whether it is right."""

    order: tuple
    right: bool
    noise: float  # standard deviation of one sample of row X over what the loss of thrust does to it


def judge(number: int, flown: Any, log: Any) -> tuple[tuple, bool]:
    """Return (first declarations in order, whether they are the true effectors, each after its fault)."""
    rises = np.diff(log["declared"] > 0.5, axis=0, prepend=False)
    found = sorted(
        (float(flown.index[np.argmax(rise)]), name)
        for rise, name in zip(rises.T, control_redundancy.EFFECTORS)
        if rise.any()
    )
    truth = TRUTH[number]
    right = [n for _, n in found[: len(truth)]] == [n for n, _ in truth]
    return tuple(found), right and all(t >= at for (t, _), (_, at) in zip(found, truth))


def raw(number: int, draw: int) -> Outcome:
    """Fly a draw of a scenario and judge it by raw samples: no mean, no learned offset."""
    flown = fly(number, draw)
    log = detector_log(flown, detector(t_mean=0.0, t_learn=0.0))
    start, engine = dict(TRUTH[number])["engine"], control_redundancy.ISOLABLE_PARTS.index("engine")
    onset = round(start / flown.attrs["dt"])
    first = np.flatnonzero(log["used"].max(axis=1) > 0.5)[0]  # the loss of scenario 3 comes while averages fill
    lost = LOSS[number] * abs(log["S"][max(onset - 1, int(first)), 0, engine - 1])
    sample = np.diff(log["e"][onset - round(3.0 / flown.attrs["dt"]) : onset, 0]).std() / math.sqrt(2.0)
    return Outcome(*judge(number, flown, log), sample / lost)
