"""The pressure sensor of a hydraulic actuator: what is its fault is not the actuator's, and the reverse."""

import numpy as np
import pytest
from lu17_bench import DT, doublets, fly, inputs, roll

import cosim
from fdi.common import verdict
from fdi.hydraulic import iotsekf, pressure_test

T_FAULT, LANES = 12.0, 6
K = round(T_FAULT / DT)
PRESSURE = iotsekf.CULPRITS.index("pressure")


@pytest.fixture(scope="module")
def flights():
    return [fly(doublets(22.0), seed=s) for s in range(LANES)]


def watched(flights, change):
    """Return the log of `iotsekf` with `change(y_dp, flag)` applied to the pressure from the fault on."""
    u = inputs(iotsekf, flights)
    change(u["y_dp"][:, K:], u["y_dp_valid"][:, K:])
    log = roll(iotsekf, np.repeat(iotsekf.params(), len(flights)), u)
    assert not log["alarm"][:, :K].any()
    return log


def named(log):
    """Return {(class, culprit)} of every alarm in the log that has a name."""
    on = (log["alarm"] > 0.5) & (log["verdict"] != verdict.AMBIGUOUS)
    return {(verdict.class_name(v), iotsekf.CULPRITS[int(c)]) for v, c in zip(log["verdict"][on], log["culprit"][on])}


@pytest.mark.parametrize("rate", [0.05, 0.2, -0.1])
def test_a_pressure_that_drifts_is_no_jam(flights, rate):
    def drift(y, flag):
        y += rate * DT * np.arange(y.shape[1])

    log = watched(flights, drift)
    assert log["alarm"][:, -1].all() and (log["verdict"][:, -1] == verdict.SENSOR).all()
    assert named(log) == {("sensor", "pressure")}


def test_a_pressure_that_freezes_is_no_oscillation_and_is_used_again_when_it_moves(flights):
    thawed = round(4.0 / DT)

    def freeze(y, flag):
        y[:, :thawed] = y[:, :1]

    log = watched(flights, freeze)
    alarm = log["alarm"][:, K:] > 0.5
    assert (alarm.argmax(axis=1) * DT <= 0.105).all()
    assert alarm[:, round(0.2 / DT) : thawed].all()
    assert named(log) == {("sensor", "pressure")}
    assert not alarm[:, thawed + round(2.0 / DT) :].any()


def test_a_pressure_that_is_flagged_invalid_for_long_is_nobodys_fault(flights):
    def lose(y, flag):
        y[:, : round(6.0 / DT)] = np.nan
        flag[:, : round(6.0 / DT)] = 0.0

    log = watched(flights, lose)
    assert not log["alarm"].any()
    assert log["valid"][:, 1:].all()
    assert np.isfinite(log["f_hat"]).all()
    truth = np.stack([f["truth"]["q_rod"] for f in flights])
    assert np.abs(log["q_now"] - truth)[:, K:].max() < 1.5e-3


def test_twice_the_noise_raises_no_alarm(flights):
    """The jump test takes the sensor's noise from its own innovations: five sigma of the nominal are two of these."""
    rng = np.random.default_rng(3)
    u = inputs(iotsekf, flights)
    u["y_dp"] += np.sqrt(3.0) * 0.005 * rng.standard_normal(u["y_dp"].shape)
    assert not roll(iotsekf, np.repeat(iotsekf.params(), LANES), u)["alarm"].any()


def test_a_coarse_or_silent_sensor_is_not_frozen(flights):
    u = inputs(iotsekf, flights)
    u["y_dp"] = 0.02 * np.round(u["y_dp"] / 0.02)
    coarse = roll(iotsekf, np.repeat(iotsekf.params(), LANES), u)
    assert not coarse["dp_out"].any()
    u["y_dp"][:] = np.cos(1e-9 * np.arange(u["y_dp"].shape[1]))  # changes by rounding, then not at all
    u["y_dp"][:, K:] = u["y_dp"][:, K - 1 : K]
    assert not (roll(iotsekf, np.repeat(iotsekf.params(), LANES), u)["dp_same"] < 19)[:, -1].any()


@pytest.mark.parametrize("step", [0.5, 3.0])
def test_the_flow_that_a_jam_takes_is_there_and_that_of_a_bad_reading_is_missing(flights, step):
    def jam(k, x, w):
        x["jam"] = 1.0 if k * DT >= T_FAULT - 1 else 0.0

    command = np.where(np.arange(K + 200) * DT >= T_FAULT, np.radians(step), 0.0)
    jammed = [fly(command, seed=s, faults=jam) for s in range(4)]
    log = roll(iotsekf, np.repeat(iotsekf.params(), 4), inputs(iotsekf, jammed))
    assert not (log["dp_out"] > 0.5).any()
    at = (log["jam"] > 0.5).argmax(axis=1)
    assert (at > K).all()
    assert (share(log, at) < 0.4).all()
    drifted = watched(flights, lambda y, flag: np.add(y, 0.05 * DT * np.arange(y.shape[1]), out=y))
    at = (drifted["dp_out"] > 0.5).argmax(axis=1) - 1
    assert (share(drifted, at) > 0.5).all()


def share(log, at):
    """Return f over the flow of the excess at tick `at` of each lane, as the test sees it."""
    p, x = iotsekf.params()[0], log[np.arange(len(log)), at]
    k = 2 * p.E * p.A_p / (p.P_s * p.V_m)  # at the rod's middle
    flow = p.L * x["excess_lag"] + (x["excess"] - x["excess_lag"]) / (p.share_tau * k)
    return -x["f_lag"] / flow


def test_the_probability_that_a_healthy_sensor_looks_frozen():
    assert (1.0 - pressure_test.CHANGES) ** pressure_test.FROZEN <= 1e-12


def test_a_pulse_of_the_valve_that_is_not_obeyed_is_no_jump_of_the_pressure():
    """It lasts one tick, and what it should have pressed in stays missing: as sudden and as steady as a jump."""
    rng, ticks = np.random.default_rng(5), 1600
    u = np.zeros((8, ticks), iotsekf.INPUTS)
    for name in ("y_rod_valid", "y_surface_valid", "y_dp_valid"):
        u[name] = 1.0
    u["y_rod"] = 1e-4 * rng.standard_normal(u.shape)
    u["y_dp"] = 0.005 * rng.standard_normal(u.shape)
    jumped = u.copy()
    u["u"][:, 1200] = np.linspace(0.07, 0.1, 8) * np.tile([1, -1], 4)
    jumped["y_dp"][:, 1201:] += 0.2
    p = np.repeat(iotsekf.params(), 8)
    assert not roll(iotsekf, p, u)["dp_offset"].any()
    assert roll(iotsekf, p, jumped)["dp_offset"][:, -1] == pytest.approx(0.2, abs=0.03)


def jumps(run, size=0.4):
    """Return the state after ten readings `size` above the prediction, an input fault declared (`run` 1) or not."""
    p, x = iotsekf.params()[0], iotsekf.init(iotsekf.params())[0]
    x["run"] = run
    used = [pressure_test.judge(x, size, p)[1] for _ in range(10)]
    return x, used


def test_a_jump_is_the_sensors_unless_an_input_fault_is_declared():
    x, used = jumps(0.0)
    assert x["dp_offset"] == pytest.approx(0.4) and not all(used)
    x, used = jumps(1.0)
    assert x["dp_offset"] == 0.0 and all(used)


def test_a_jump_back_ends_the_offset_also_where_the_two_jumps_are_not_the_same():
    for back, left in ((-0.43, 0.0), (-0.2, 0.2)):
        x, _ = jumps(0.0)
        p = iotsekf.params()[0]
        used = [pressure_test.judge(x, 0.4 + back, p)[1] for _ in range(10)]
        assert x["dp_offset"] == pytest.approx(left, abs=1e-12)
        assert used[-1]


def test_what_an_alarm_of_the_evidence_says_of_the_load_is_not_the_usual():
    x = iotsekf.init(iotsekf.params())[0]
    x["excess"] = 0.05
    for speaks, usual in ((1.0, 0.0), (0.0, pytest.approx(0.05 / pressure_test.USUAL_TAU, rel=0.05))):
        x["speaks"] = speaks
        for _ in range(round(1.0 / DT)):
            pressure_test.keep(x, False, DT)
        assert x["excess_usual"] == usual


@pytest.mark.parametrize(("seed", "bias", "start"), [(79, -1.138, 10.5), (88, -1.01, 10.5), (98, 1.35, 12.0)])
def test_a_servo_on_the_filter_comes_back_when_the_bias_heals(seed, bias, start):
    """The jump back alone was taken, as an offset: the surface stood 1 deg off for the rest of the flight."""
    fault = f"{{target='elevator.left_inner.pressure',kind='bias',bias_mpa={bias},start_s=12,end_s=22}}"
    told = ["rate_hz=100", f"seed={seed}", "duration_s=27", "flight.turbulence=none", "flight.mass_t=250"]
    told += ["manoeuvre.kind=three_two_one_one", f"manoeuvre.start_s={start}", f"faults=[{fault}]"]
    found = cosim.simulate(cosim.load_scenario("cruise", [*told, "detectors.enabled=['iotsekf']"])).to_dict()
    lane = next(d for d in found["detectors"] if d["target"] == "elevator.left_inner")
    assert lane["false_alarms"] == 0 and lane["standing_s"] < 1.0


@pytest.mark.parametrize(
    ("moved", "other", "dropped"),
    [(0.05, False, True), (0.05, True, False), (0.02, False, False), (-0.05, False, False)],
)
def test_an_offset_that_moves_the_load_by_itself_is_dropped_and_the_estimate_goes_with_it(moved, other, dropped):
    x = iotsekf.init(iotsekf.params())[0]
    x["dp_offset"], x["excess"], x["x_bar"][:] = 0.05, moved, (0.0, 0.0, 0.1, 0.2)
    for _ in range(round(0.9 * pressure_test.DROP_TIME / DT)):
        pressure_test.keep(x, other, DT)
    assert x["dp_offset"] == 0.05
    for _ in range(round(0.2 * pressure_test.DROP_TIME / DT)):
        pressure_test.keep(x, other, DT)
    assert (x["dp_offset"] == 0.0) == dropped
    assert x["x_bar"][2:] == pytest.approx((0.15, 0.15) if dropped else (0.1, 0.2))


def test_a_bias_that_heals_ends_its_alarm(flights):
    """Also where only the second of its jumps was taken, as on one lane with 8 %, which has no alarm in between."""
    healed = round(5.0 / DT)
    size = np.linspace(-0.4, 0.4, LANES)

    def bias(y, flag):
        y[:, :healed] += size[:, None]

    log = watched(flights, bias)
    alarm = log["alarm"][:, K:] > 0.5
    assert alarm[np.abs(size) > 0.1, round(0.2 / DT) : healed].all()
    assert not alarm[:, healed + round(3.0 / DT) :].any()
