"""The project's judge against a second one (tests/helpers/second_judge.py) that reads nothing but a log's frames."""

import pytest
from second_judge import judged

from cosim.flight.simulate import simulate
from cosim.scenario import load_scenario

HYDRAULIC = {"detectors": ("iotsekf", "ofc_monitor", "position_monitor", "rfafe", "control_redundancy")}
EMA = {"detectors": ("ema_kalman_flight", "position_monitor", "rfafe", "control_redundancy")}
AIR = {"detectors": ("lpv_smo", "rfafe", "control_redundancy", "kinematic")}
FLIGHTS = {
    "oscillation that heals": ("elevator.left_inner", "ofc_liquid", HYDRAULIC,
                               {"at": "valve", "amplitude_mm": 4.0, "frequency_hz": 1.0, "end_s": 15.0}),
    "rod sensor": ("elevator.left_inner.rod", "bias", HYDRAULIC, {"bias_mm": 5.0}),
    "loss": ("elevator.left_inner", "loss_of_effectiveness", HYDRAULIC, {"at": "valve", "loss_pct": 70.0}),
    "velocity sensor": ("elevator.right_inner.velocity", "bias", EMA, {"bias_pct": 4.0, "end_s": 14.0}),
    "jam": ("elevator.right_inner", "jam_solid", EMA, {}),
    "angle of attack": ("sensor.alpha", "bias", AIR, {"bias_deg": 3.0, "end_s": 15.0}),
    "engine": ("engine.1", "thrust_loss", AIR, {"loss_pct": 60.0}),
}  # fmt: skip


def disagreements(scenario, path):
    """Return [(lane, first judge, second judge)] of a flight with one fault where they differ, and how many agree."""
    result = simulate(scenario, log=path)
    second, out, same = judged(path), [], 0
    for entry in result.detectors:
        lane = entry["target"].removeprefix("elevator.")
        for own in entry["by_fault"]:
            seen, wrong = own["detected_at_s"] is not None, "wrong" in (own["class_given"], own["place_given"])
            first = {"seen": seen, "delay": own["detection_delay_s"], "word": None}
            if seen:
                first["word"] = "right" if own["right"] else "wrong" if wrong else "ambiguous"
            theirs = dict(second[entry["id"], lane])
            theirs["word"] = (theirs["word"] or "ambiguous") if theirs["seen"] else None
            standing = theirs.pop("standing")
            if own["withdrawn"] is not None:
                first["standing"], theirs["standing"] = not own["withdrawn"], standing
            for one in (first, theirs):
                one["delay"] = None if one["delay"] is None else round(one["delay"], 4)
            same += first == theirs
            out += [] if first == theirs else [((entry["id"], lane), first, theirs)]
    return out, same


@pytest.mark.parametrize("name", FLIGHTS)
def test_both_judges_say_the_same_of_a_flight(name, tmp_path):
    target, kind, own, keys = FLIGHTS[name]
    fault = {"target": target, "kind": kind, "start_s": 10.0, **keys}
    values = {f"faults.0.{k}": v for k, v in fault.items()} | {"duration_s": 20.0}
    texts = [f"{k}={v}" for k, v in values.items()] + [f"detectors.enabled={list(own['detectors'])}"]
    differ, same = disagreements(load_scenario("cruise", texts), tmp_path / "flight.mcap")
    assert not differ and same >= 3
