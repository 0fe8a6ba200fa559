"""How often the intervals of `cosim identify` hold the truth: recordings of the testbed whose parameters are drawn.

    COSIM_CASES=100 pytest -m slow -n 0 -s tests/training/test_identify_coverage.py

Responses come from flights with an actuator of drawn parameters under the law's commands, flows from the hydraulic
bench on the commands of simulated flights. Thresholds are learned on the first part of a healthy recording and checked
on the rest.
"""

import os

import numpy as np
import pandas as pd
import pytest
from flight_point import POINT
from real_windows import SEGMENT, loads
from recorded_bench import DRAWN, TOLERANCE, Ride, move
from scipy.stats import binom, poisson

import cosim
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.replay.map import prepare
from cosim.training.identify import BLOCK
from cosim.training.identify.flow import flow
from cosim.training.identify.response import respond
from cosim.training.identify.thresholds import fit
from cosim.training.threshold_fit import PROBABILITY

CASES, LEVEL, DT = int(os.environ.get("COSIM_CASES", "100")), 0.95, 0.005
FIRST = int(os.environ.get("COSIM_SEED", "2000"))  # seed of the first recording; development used 0 to 1099
LATE = TRANSPORT["q"][2]  # of the reading [s]
MANOEUVRES = ("nz_doublet", "three_two_one_one", "nose_up", "pitch_protection")


def least(n):
    """Return the count of n intervals at LEVEL below which a thousandth of fair ones fall."""
    return int(binom.ppf(1e-3, n, LEVEL))


def told(what, inside):
    print(f"\n{what}: " + ", ".join(f"{name} {sum(ok)} of {len(ok)}" for name, ok in inside.items()))
    for name, ok in inside.items():
        assert sum(ok) >= least(len(ok)), (name, sum(ok), len(ok))


def flight(k):
    """Return the changes that make flight k of the cruise scenario: four manoeuvres, three airs."""
    return ["duration_s=40", f"seed={k}", f"manoeuvre.kind={MANOEUVRES[k % 4]}", "manoeuvre.start_s=8",
            f"flight.turbulence={('none', 'light', 'moderate')[k % 3]}", "detectors.enabled=[]"]  # fmt: skip


def ride(k):
    """Return the Ride of an actuator of the bench on flight k."""
    seen = ["law.law.de_cmd", *(f"truth.aircraft.{n}" for n in ("alpha", "cas", "q"))]
    flown = cosim.fly(cosim.load_scenario("cruise", flight(k)), seen)
    return Ride(*(flown[n].to_numpy() for n in seen))


def drawn_flight(k, folder, changes=()):
    """Return (truth, command, reading) of flight k, whose left inner actuator has drawn parameters."""
    rng = np.random.default_rng([71, k])
    truth = {"omega": rng.uniform(12.0, 35.0), "zeta": rng.uniform(0.6, 1.1), "rate": rng.uniform(0.1, 0.4),
             "dead_band": rng.uniform(0.0, 2e-3), "delay": rng.uniform(0.0, 0.05)}  # fmt: skip
    name = f"own_{k}"
    text = BLOCK.format(segment=SEGMENT, recording="", lines="", name=name, file=f"{name}.py", fit=0.0, values=truth)
    (folder / f"{name}.py").write_text(text)
    keys = [*flight(k), *changes, f"actuators.{name}.file={folder}/{name}.py", f"elevator.{SEGMENT}={name}"]
    seen = ["law.law.de_cmd", f"sensors.{SEGMENT}_surface.y"]
    flown = cosim.fly(cosim.load_scenario("cruise", keys), seen)
    return truth, *(flown[n].to_numpy() for n in seen)


def test_a_dead_time_just_short_of_a_whole_tick_is_found(tmp_path):
    truth, command, reading = drawn_flight(7, tmp_path)  # its 3.93 ticks: the sum of squares bends at 4
    found = respond(command, reading, DT, 0.999).parameters
    truth["delay"] += LATE
    assert all(found[name].low <= value <= found[name].high for name, value in truth.items())


@pytest.mark.slow
def test_intervals_of_a_response_hold_the_truth_at_their_level(tmp_path):
    inside: dict[str, list] = {}
    for k in range(FIRST, FIRST + CASES):
        truth, command, reading = drawn_flight(k, tmp_path)
        found = respond(command, reading, DT, LEVEL)
        for name, value in truth.items():
            p = found.parameters.get(name)
            if p is not None:
                value += LATE if name == "delay" else 0.0
                inside.setdefault(name, []).append(p.low <= value <= p.high)
    told("response", inside)


@pytest.mark.slow
def test_intervals_of_a_flow_hold_the_truth_at_their_level():
    rides, rng = [ride(k) for k in range(FIRST, FIRST + CASES)], np.random.default_rng(FIRST + 73)
    scenario = cosim.load_scenario("cruise", ["detectors.enabled=[]"])
    seen = move(rides, [scenario] * CASES, loads(rides, rng)[0], SEGMENT, FIRST + 79)
    own = np.random.default_rng(FIRST + 79)
    truth = [{s: own.uniform(1.0 - TOLERANCE, 1.0 + TOLERANCE) for s in DRAWN} for _ in range(CASES)]
    inside: dict[str, list] = {"flow_gain": []}
    for i, t in enumerate(truth):
        u, rod, x3 = (seen[f"{SEGMENT}.{w}"][i] for w in ("valve_command", "rod", "pressure"))
        p = flow(u[1:], rod[:-1], x3[:-1], DT, LEVEL).parameters.get("flow_gain")
        inside["flow_gain"].append(p is not None and p.low <= t["phi_n"] / t["A_p"] <= p.high)
    told("flow", inside)


MAP = (
    POINT
    + """[detectors]
enabled = ["position_monitor"]
[signals]
de_cmd = { channel = "cmd" }
"left_inner.surface" = { channel = "pos" }
"""
)


@pytest.mark.slow
def test_thresholds_keep_their_probability_of_a_false_alarm_on_what_was_held_back(tmp_path):
    """Recordings of 100 s in the same air all along, with actuators slower than the monitor's model."""
    alarms = seconds = fitted = raised = 0
    (tmp_path / "map.toml").write_text(MAP)
    for k in range(FIRST, FIRST + CASES):
        air = ("light", "moderate", "severe")[k % 3]
        keys = ["duration_s=100", "manoeuvre.kind=cruise", f"flight.turbulence={air}"]
        _, command, reading = drawn_flight(k, tmp_path, keys)
        path = tmp_path / "flight.csv"
        pd.DataFrame({"t_s": np.arange(len(command)) * DT, "cmd": command, "pos": reading}).to_csv(path, index=False)
        for found in fit(prepare(path, tmp_path / "map.toml")):
            fitted, raised = fitted + 1, raised + (found.factor > 1.0)
            alarms, seconds = alarms + found.alarms, seconds + found.held_back_s
    expected = PROBABILITY * seconds / 60.0
    print(f"\nthresholds: {alarms} alarms in {seconds:.0f} s held back, {fitted} recordings, {expected:.2g} expected, "
          f"{raised} with thresholds above the shipped ones")  # fmt: skip
    assert fitted == CASES and poisson.sf(alarms - 1, expected) > 1e-3
