"""Every kind of sensor fault flown: it enters the copies of its path, of aircraft and actuator sensors, and heals."""

import math

import numpy as np
import pytest
from flown import TRUTH, deg, fault, fly, scenario

from cosim.flight.blocks import sensors
from cosim.scenario import catalog as c

SMALL = {"rad": 1e-3, "rad/s": 2e-4, "rad/s2": 1e-3, "m/s": 0.3, "-": 1e-3, "m": 0.5, "g": 2e-3, "%": 0.5, "kg": 100.0}
# [unit] of bias, amplitude and sigma, per second of drift: large against rounding, small for the aircraft
KIND_KEY = {"bias": "bias_", "drift": "drift_", "noise": "sigma_", "oscillation": "amplitude_"}


def small(name, kind):
    unit = c.SENSORS[name][0]
    value = SMALL[sensors.TRANSPORT[name][3]] / unit.factor
    if kind == "scale":
        return {"scale": 1.002}, 0.002
    if kind in ("freeze", "dropout"):
        return {}, 0.0
    numbers = {KIND_KEY[kind] + unit.suffix + ("_s" if kind == "drift" else ""): value}
    return numbers | ({"frequency_hz": 1.0} if kind == "oscillation" else {}), value * unit.factor


@pytest.mark.parametrize("path", c.PATHS["sensor"])
@pytest.mark.parametrize("kind", c.SENSOR_KINDS)
def test_sensor_fault_enters_the_copies_of_its_path_and_heals(kind, path):
    start, end = 2.0, 3.0
    keys, size = {}, {}
    for i, name in enumerate(sensors.TRANSPORT):
        numbers, size[name] = small(name, kind)
        keys |= fault(i, f"sensor.{name}", kind, start, end, path=path, **numbers)
    fields = ("y", "y_obs", "valid", "valid_obs")
    more = [f"sensors.{n}.{x}" for n in sensors.TRANSPORT for x in fields]
    truth = [f"truth.aircraft.{s[0]}" for s in sensors.TRANSPORT.values() if s[0] not in TRUTH]
    f = fly(scenario("E", "nz_doublet", duration_s=6.0, manoeuvre__start_s=1.0, manoeuvre__width_s=1.5,
                     sensors__noise_scale=0.0, **keys), *more, *dict.fromkeys(truth))  # fmt: skip
    assert f.status == "completed"
    on, t = (f.t > start - 1e-6) & (f.t < end - 1e-6), f.t
    for name, (field, _, delay, _) in sensors.TRANSPORT.items():
        late = round(delay / 0.005)
        true = getattr(f, field) if field in TRUTH else getattr(f, f"aircraft_{field}")
        true = np.concatenate([np.full(late, true[0]), true[:-late]])
        copies = {x: getattr(f, f"{name}_{x}") for x in fields}
        for copy in ("y", "y_obs"):
            y, valid = copies[copy], copies["valid" + copy[1:]]
            if copy == "y" and path == "observers":
                np.testing.assert_array_equal(y, true, err_msg=name)
                continue
            np.testing.assert_array_equal(y[~on], true[~on], err_msg=name)
            expected = {"bias": true + size[name], "drift": true + size[name] * (t - start),
                        "scale": true * (1 + size[name]), "freeze": np.full(len(t), true[on][0]),
                        "oscillation": true + size[name] * np.sin(2 * math.pi * (t - start))}  # fmt: skip
            if kind == "noise":
                assert np.std((y - true)[on]) == pytest.approx(size[name], rel=0.25)
            elif kind == "dropout":
                assert np.isnan(y[on]).all() and (valid[on] == 0).all()
            else:
                np.testing.assert_allclose(y[on], expected[kind][on], rtol=1e-9, atol=1e-9, err_msg=name)
            assert (valid[on] == (0.0 if kind == "dropout" else 1.0)).all() and (valid[~on] == 1).all()


PART_SIZE = {"rod": ("mm", 0.3), "surface": ("deg", 0.1), "pressure": ("pct", 1.0), "velocity": ("rad_s", 3.0),
             "position": ("mm", 0.1), "current": ("a", 0.3)}  # fmt: skip


@pytest.mark.parametrize("path", c.PATHS["actuator_sensor"])
@pytest.mark.parametrize("kind", c.SENSOR_KINDS)
def test_fault_of_an_actuators_sensor_enters_the_copies_of_its_path_and_heals(kind, path):
    start, end = 2.0, 3.0
    own = {"left_inner": "hydraulic", "right_inner": "ema"}
    lanes = [(segment, sensor) for segment, tech in own.items() for sensor in c.TECHNOLOGIES[tech].own_sensors]
    keys = {}
    for i, (segment, sensor) in enumerate(lanes):
        suffix, value = PART_SIZE[sensor]
        key = {"bias": f"bias_{suffix}", "drift": f"drift_{suffix}_s", "noise": f"sigma_{suffix}",
               "oscillation": f"amplitude_{suffix}"}  # fmt: skip
        numbers = {key[kind]: value} if kind in key else {"scale": 1.02} if kind == "scale" else {}
        numbers |= {"frequency_hz": 1.0} if kind == "oscillation" else {}
        keys |= fault(i, f"elevator.{segment}.{sensor}", kind, start, end, path=path, **numbers)
    more = [f"sensors.{seg}_{s}.{x}" for seg, s in lanes for x in ("y", "y_obs", "valid", "valid_obs")]
    twins = ("truth.aircraft.de_lo", "truth.aircraft.de_ri", "truth.aircraft.de_ro")
    f = fly(scenario("E", "nz_doublet", duration_s=7.0, manoeuvre__start_s=1.0, manoeuvre__width_s=1.5,
                     sensors__noise_scale=0.0, elevator__feedback="measured", **keys), *more, *twins)  # fmt: skip
    assert f.status == "completed"
    on = (f.t > start - 1e-6) & (f.t < end - 1e-6)
    for segment, sensor in lanes:
        lane = [getattr(f, f"{segment}_{sensor}_{x}") for x in ("y", "y_obs", "valid", "valid_obs")]
        y, y_obs, valid, valid_obs = lane
        np.testing.assert_array_equal(y[~on], y_obs[~on])
        if path == "loop":
            np.testing.assert_array_equal(y, y_obs)  # the observers read the same, faulty, sensor
        elif kind == "dropout":
            assert np.isnan(y_obs[on]).all() and np.isfinite(y).all()
        else:
            assert np.abs(y - y_obs)[on].max() > 0.0, (segment, sensor)
        assert (valid_obs[on] == (0.0 if kind == "dropout" else 1.0)).all()
        assert (valid[on] == (0.0 if kind == "dropout" and path == "loop" else 1.0)).all()
    apart = {"left": deg(f.de_li - f.aircraft_de_lo), "right": deg(f.aircraft_de_ri - f.aircraft_de_ro)}
    for off in apart.values():
        assert (np.abs(off[on]).max() > 0.01) if path == "loop" else (np.abs(off).max() < 0.01)
        assert np.abs(off[f.t > 6.0]).max() < 0.05
