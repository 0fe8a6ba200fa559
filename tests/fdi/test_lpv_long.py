"""lpv_smo in long flights without a fault that once raised an alarm: after a protection manoeuvre, from one box of its
models to the next, in a swing of its estimate."""

import math

import numpy as np
import pytest

from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.scenario.aircraft import load_aircraft
from cosim.training.flights import POINT, TURBULENCE, draw, scenario, trimming
from fdi.common import why
from fdi.lpv_smo import lpv_smo

WIRES = sources("lpv_smo")
KINDS = (
    "aoa_protection", "pitch_protection", "nose_up", "cruise", "nz_doublet", "coordinated_turn", "aoa_protection",
    "pitch_protection",
)  # fmt: skip
FIRST_SEED = 68_000_000
FIELDS = ("alarm", "valid", "why", "apart", "path", "alpha_0", "over", "alpha_hat", "learned")


def watched(index, duration):
    """Return what lpv_smo held in drawn flight `index`, and the time [s]."""
    own, seed, air = load_aircraft(), FIRST_SEED + index, TURBULENCE[index // 8 % 3]
    rng, manoeuvre = np.random.default_rng([seed, 7]), {"kind": KINDS[index % 8]}
    manoeuvre["start_s"] = float(rng.uniform(10.0, 36.0))
    if manoeuvre["kind"] == "pitch_protection":
        manoeuvre["amplitude_g"] = float(rng.choice([0.15, 0.3]))
    technology = tuple(own.technology.values())
    flight = draw(seed, point=POINT, manoeuvre=manoeuvre, turbulence=air, duration=duration, technology=technology,
                  sensors={"noise_scale": float(rng.choice([1.0, 1.2]))})  # fmt: skip
    flight = trimming(np.random.default_rng([seed, 2]), flight, {"turbulence": air})
    frame = fly(scenario(**flight), WIRES.values())
    p = lpv_smo.fitted(site(frame.attrs["dt"], "", dict(zip(own.segments, technology, strict=True)), own))
    return detect(frame, lpv_smo, WIRES, p, FIELDS), frame.index.to_numpy()


@pytest.mark.parametrize(("index", "duration"), ((1225, 80), (1289, 77), (1684, 24)))
def test_a_long_flight_without_a_fault_raises_no_alarm(index, duration):
    log, t = watched(index, duration)
    assert not log["alarm"].any()
    assert (log["valid"] > 0.5)[t > duration - 10.0].any()


def test_a_stall_in_a_steep_bank_is_not_valid_though_the_observer_has_lost_the_angle_of_attack():
    log, t = watched(281, 180)
    stalled = (t > 160.0) & (log["over"] > math.radians(15.0))
    assert stalled.sum() > 1000 and (log["alpha_hat"][stalled] < math.radians(8.0)).any()
    assert (log["why"][stalled] == why.BOX_ALPHA).all() and not log["alarm"].any()


def test_a_dive_at_the_angle_of_attack_of_slower_level_flight_is_far_from_where_offsets_were_learned():
    log, t = watched(649, 130)
    dive = t > 122.0
    assert (log["valid"][dive] > 0.5).all() and not log["alarm"].any()
    assert np.abs(log["path"] - log["alpha_0"])[dive].max() < math.radians(1.0)
    assert log["apart"][dive].min() > math.radians(3.0)
