"""Fly the golden flights: `python tests/helpers/golden.py` writes logs/golden/*.mcap anew, with a text fingerprint
beside each.

The tests replay them bit for bit, so a change of any detector's numbers shows. A change that is meant is a commit of
its own: run the command, look at the difference of the fingerprints, commit both. Each log is short, has one fault,
and holds only what a replay reads: the detectors' inputs, outputs, whole states and parameters.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from fingerprint import fingerprint

from cosim.log import open_log

FOLDER = Path(__file__).resolve().parents[2] / "logs" / "golden"
HYDRAULIC = ("iotsekf", "rtsekf", "rtsekf_flight", "position_monitor", "ofc_monitor")
EMA = ("ema_kalman", "ema_kalman_flight", "position_monitor")
AIRCRAFT = ("rfafe", "rfafe_airframe", "lpv_smo")


@dataclass(frozen=True)
class Golden:
    """One golden flight: a built-in scenario, what is changed of it, and the detectors that must have alarmed."""

    scenario: str
    changes: tuple
    detectors: tuple
    alarmed: tuple


def _only(segment, technology):
    segments = ("left_outer", "left_inner", "right_inner", "right_outer")
    return tuple(f"elevator.{s}={technology if s == segment else 'simple'}" for s in segments)


_SHORT = ("duration_s=5", "faults.0.start_s=2")

FLIGHTS = {
    "hydraulic-ofc": Golden("liquid-ofc", (*_only("left_inner", "hydraulic"), *_SHORT), HYDRAULIC, ("iotsekf",)),
    "ema-position-bias": Golden(
        "ema-position-bias", (*_only("right_inner", "ema"), *_SHORT), EMA, ("ema_kalman_flight",)
    ),
    "aircraft-bias": Golden("alwi14-simultaneous", _SHORT, AIRCRAFT, ("rfafe",)),
}


def fly(name: str, folder: Path = FOLDER) -> Path:
    """Fly golden flight `name`; write <name>.mcap and its fingerprint <name>.txt, and return the log's path."""
    from cosim.flight.simulate import simulate
    from cosim.scenario import load_scenario

    golden, folder = FLIGHTS[name], Path(folder)
    enabled = ",".join(f'"{d}"' for d in golden.detectors)
    scenario = load_scenario(
        golden.scenario,
        [*golden.changes, f"detectors.enabled=[{enabled}]", "elevator.feedback=measured", "elevator.reconfigure=false",
         "log_profile=replay"],
    )  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / f"{name}.mcap"
    simulate(scenario, log=out, timed=False)
    out.with_suffix(".txt").write_text(fingerprint(open_log(out)))
    return out


if __name__ == "__main__":
    for flight in sys.argv[1:] or FLIGHTS:
        fly(flight)
