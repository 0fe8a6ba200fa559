"""The servos' model of `rfafe`: what a servo does with a command is no fault, however fast and from when on; what an
oscillation takes out of the command is a regression."""

import numpy as np
import pytest

from actuators.constants import RAD_PER_DEG
from cosim.flight.loop.signals import fly
from cosim.scenario import parse
from cosim.training.flights import COMMAND, POINT, SURFACES
from fdi.common import bank, verdict
from fdi.rfafe import rfafe, segments, servo
from fdi.rfafe.store import read

DT, ROLL_S = 0.005, 12.0


def judged(command, surface, technology="hydraulic"):
    """Return the STATE log of rfafe under a command (ticks,) and the surface, of all or (ticks, 4) [rad]."""
    u = np.zeros((1, len(command)), rfafe.INPUTS)
    for name in ("tas", "alpha", "q", "theta", "surface"):
        u[f"{name}_valid"] = 1.0
    u["tas"], u["command"][0], u["surface"][0] = 200.0, command[:, None], surface.reshape(len(surface), -1)
    p, log = rfafe.params(technology=technology), np.zeros(u.shape, rfafe.STATE)
    rfafe.rollout(rfafe.init(p), u, p, DT, log)
    return log[0]


@pytest.mark.parametrize("kind", ["hydraulic", "ema", "simple"])
@pytest.mark.parametrize("share", [0.05, 1.0])  # of what reaches the rate limit many times over
def test_a_servo_that_obeys_is_no_fault_whatever_it_is_asked(kind, share):
    """The trim is learned in the first 0.2 s, in which this command moves by several degrees."""
    t = np.arange(round(ROLL_S / DT)) * DT
    command = share * (6.0 * np.sin(2.0 * np.pi * 1.1 * t + 0.3) + 5.0 * np.sign(np.sin(2.3 * t)))  # [deg]
    m = np.zeros(len(t))
    servo.run(command, np.array(servo.row(read("rfafe")["servos"][kind], DT)), m, DT)
    log = judged(command * RAD_PER_DEG, np.concatenate([m[:1], m[:-1]]) * RAD_PER_DEG, kind)  # a sensor's tick late
    assert log["valid"][400:].all() and not log["alarm"].any()
    assert np.abs(log["f"][400:]).max() < 0.02 * RAD_PER_DEG + 1e-3 * share


@pytest.mark.parametrize("kind", ["hydraulic", "ema"])
def test_the_model_follows_the_servo_that_flies_beyond_its_limits(kind):
    told = {"title": "t", "duration_s": 20.0, "seed": 77, "flight": {**POINT, "turbulence": "moderate"},
            "manoeuvre": {"kind": "aoa_protection", "start_s": 5.0}, "detectors": {"enabled": []},
            "elevator": dict.fromkeys(("left_outer", "left_inner", "right_inner", "right_outer"), kind)}  # fmt: skip
    v = fly(parse(told), [COMMAND, *SURFACES])
    command, surface = v[COMMAND].to_numpy() / RAD_PER_DEG, v[list(SURFACES)].to_numpy().mean(axis=1) / RAD_PER_DEG
    m = np.zeros(len(command))
    servo.run(command, np.array(servo.row(read("rfafe")["servos"][kind], DT)), m, DT)
    left = surface - m
    assert np.std(surface) > 1.5 and np.std(left) < 0.05 * np.std(surface)


def test_at_another_rate_the_model_has_the_same_response():
    model = read("rfafe")["servos"]["hydraulic"]
    out = {}
    for dt in (0.0025, 0.005, 0.02):
        u = np.full(round(1.0 / dt), 1.0)
        u[: round(0.1 / dt)] = 0.0
        m = np.zeros(len(u))
        servo.run(u, np.array(servo.row(model, dt)), m, dt)
        out[dt] = np.interp(np.arange(0.15, 0.9, 0.05), np.arange(len(u)) * dt, m)
    assert np.abs(out[0.0025] - out[0.005]).max() < 0.02 and np.abs(out[0.02] - out[0.005]).max() < 0.06


@pytest.mark.parametrize(("who", "kind"), [((0,), "ofc_liquid"), ((1,), "ofc_solid"), ((2,), "bias"),
                                            ((0, 1), "ofc_liquid"), ((2, 3), "bias")])  # fmt: skip
def test_the_segment_that_alone_does_not_follow_is_named(who, kind):
    """Of two kinds of servo, each with its own response to a command that moves by degrees."""
    t = np.arange(round(24.0 / DT)) * DT
    command = 1.5 * np.sin(2.0 * np.pi * 0.3 * t) + np.sin(2.0 * np.pi * 0.9 * t + 0.4)
    wrong = command * (kind != "ofc_solid") + (2.0 if kind == "bias" else 1.5 * np.sin(2.0 * np.pi * 1.3 * t))
    wrong = np.where(t > 12.0, wrong, command)
    m = np.zeros((len(t), 4))
    for i, own in enumerate(("hydraulic", "ema", "hydraulic", "ema")):
        servo.run(wrong if i in who else command, np.array(servo.row(read("rfafe")["servos"][own], DT)), m[:, i], DT)
    m += 1e-2 * np.random.default_rng(5).standard_normal(m.shape)
    log = judged(command * RAD_PER_DEG, np.concatenate([m[:1], m[:-1]]) * RAD_PER_DEG, "mixed")
    late = log[(t > 16.0) & (log["alarm"] > 0.5)]
    assert not log["alarm"][t < 12.0].any() and len(late) > 4.0 / DT
    assert set(late["segment"]) == {1.0 + who[0] if len(who) == 1 else 0.0}
    assert not log["segment"][log["alarm"] < 0.5].any()
    if len(who) == 1:
        assert segments.NAMES[1 + who[0]].startswith(rfafe.ISOLABLE_PARTS[int(late["isolated_part"][-1])])


@pytest.mark.parametrize("hz", [1.1, 3.1, 8.9])
@pytest.mark.parametrize(("share", "kind"), [(0.0, "ofc_liquid"), (1.0, "ofc_solid"), (0.5, "none")])
def test_the_share_and_its_deviation_are_those_of_least_squares(hz, share, kind):
    """e = -share m + noise + a sine and a constant, of the second segment: slope of e over m beside them, its
    standard error by the number of samples that are independent."""
    x, n, head = np.zeros(1, rfafe.STATE)[0], segments.RING, 5  # of a ring: the samples run over its end
    rng, t = np.random.default_rng(7), segments.SAMPLE * (np.arange(n) - 0.5 * (n - 1))
    columns = np.stack([rng.standard_normal(n), np.cos(2 * np.pi * hz * t), np.sin(2 * np.pi * hz * t), np.ones(n)], 1)
    e = columns @ [-share, 1.0, 2.0, 0.3] + 0.5 * rng.standard_normal(n)
    at = np.arange(head - n, head)
    x["part_ring"][1, at], x["part_ring"][4, at], x["part_head"] = e, columns[:, 0], head
    x["part_size"][1], x["part_since"], x["isolated_part"] = 1.0, n, 1.0
    x["ofc_hz"][0] = bank.frequencies()[np.argmin(np.abs(bank.frequencies() - hz))]
    segments._fit(x)
    (slope, *_), (left,), *_ = np.linalg.lstsq(columns, e)
    independent = n * segments.SAMPLE / segments.CORRELATED
    sigma = np.sqrt(left / (independent - 1.0) * np.linalg.inv(columns.T @ columns)[0, 0])
    assert x["share"] == pytest.approx(-slope, abs=0.2 * sigma) and x["share_sigma"] == pytest.approx(sigma, rel=0.1)
    assert verdict.class_name(x["ofc_class"]) == kind
    assert np.sqrt(2.0 * x["swing"][:2]) == pytest.approx([0.0, np.sqrt(5.0)], abs=0.2)
