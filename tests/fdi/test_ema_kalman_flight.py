"""`ema_kalman_flight` on the bench of `ema_bench`: what it names, what it leaves alone, its estimate of the position.

Thresholds were chosen on seeds below 1000.
"""

import json
from importlib import resources

import numpy as np
import pytest
from ema_bench import ARM, DT, NO_LOAD, STALL, fly_bench, script, three_two_one_one
from ema_draws import END, ON, START, T, drawn, said, sine

import cosim
from actuators.constants import RAD_PER_DEG
from actuators.ema import jay
from cosim.flight.loop.signals import detect, fly
from cosim.training import flights, train_ema
from fdi.common import verdict as v
from fdi.ema import ema_kalman_flight as flight
from fdi.ema import gains, positions, shapes, torque, vote
from fdi.ema import model as ema_design
from fdi.ema.ema_kalman import POSITION
from fdi.monitors import position_monitor

DEGREE = RAD_PER_DEG * ARM
SEEDS = range(2000, 2004)


def ticks(seconds):
    return slice(round(seconds / DT), None)


def noise(size):
    return lambda t: size * np.random.default_rng(6).standard_normal(len(t))


# --- design


def test_model_has_the_hinge_stiffness_inside_a():
    """First order in HM_delta equals the exponential of the whole model; the load state acts as a hinge moment."""
    values = jay.values("elevator")
    Phi, Phi_h, G, G_h = ema_design.model(values, DT, 20.0)
    for hmd, most in ((0.0, 1e-9), (-40e3, 1e-4)):
        m = jay.continuous("elevator", hinge_stiffness=hmd)
        exact, gamma = jay.discretise(m.A[:5, :5], np.column_stack([m.B[:5], m.E[:5]]), DT)
        assert (np.abs((Phi + hmd * Phi_h)[:5, :5] - exact) / np.abs(exact).max(axis=1, keepdims=True)).max() < most
        if hmd == 0.0:
            np.testing.assert_allclose(np.column_stack([G, G_h])[:5], gamma, rtol=1e-6)
    np.testing.assert_allclose(Phi[:5, 5], G_h[:5], rtol=1e-3)  # a load that leaks with 20 s acts as one that is held
    with pytest.raises(ValueError, match="a = b"):
        ema_design.model({**values, "a": 45.0}, DT, 20.0)


def test_thresholds_are_those_of_the_training_and_faults_lie_beyond_what_healthy_drives_pass():
    stored = json.loads(resources.files("fdi").joinpath("thresholds", "ema_kalman_flight.json").read_text())
    how, p = stored["training"], flight.params()
    assert all(found["largest"] <= 1.0 for test, found in how["found"].items() if test != train_ema.GAIN)
    assert how["found"]["load"]["limit"] * 0.5 * p["load_max"][0] < 0.65 * p["th_load"][0]
    assert how["found"]["z_gain"]["largest"] < 0.5 * p["z_gain"][0]


# --- names

FAULTS = [
    ("ofc_liquid", {"f_u": sine(6.0, 1.0)}), ("ofc_liquid", {"f_u": sine(6.0, 4.0)}),
    ("ofc_solid", {"f_u": sine(10.0, 1.5), "s_u": 1.0}), ("ofc_solid", {"f_u": sine(3.0, 0.7), "s_u": 1.0}),
    ("runaway", {"f_u": 0.8 * STALL, "s_u": 1.0}), ("runaway", {"f_u": -0.7 * STALL, "s_u": 1.0}),
    ("effectiveness", {"loss": 0.6}), ("effectiveness", {"magnet_loss": 0.4}),
    ("effectiveness", {"friction_add": 0.15 * STALL * 0.6}), ("jam_solid", {"jam": 1.0}),
    ("sensor current", {"f_c": sine(6.0, 1.0)}), ("sensor current", {"f_c": 0.1 * STALL}),
    ("sensor current", {"s_c": 0.25}), ("sensor current", {"z_c": 1.0}), ("sensor current", {"n_c": noise(4.0)}),
    ("sensor velocity", {"f_v": 0.02 * NO_LOAD}), ("sensor velocity", {"s_v": 0.25}), ("sensor velocity", {"z_v": 1.0}),
    ("sensor velocity", {"n_v": noise(20.0)}),
    ("sensor position", {"f_p": 0.5 * DEGREE}), ("sensor position", {"f_p": lambda t: 0.5 * DEGREE * t}),
    ("sensor position", {"z_p": 1.0}), ("sensor position", {"n_p": noise(2e-3)}),
    ("sensor surface", {"f_s": 1.2 * RAD_PER_DEG}), ("sensor surface", {"f_s": sine(0.6 * RAD_PER_DEG, 1.5)}),
    ("sensor surface", {"s_s": 0.4}), ("sensor surface", {"z_s": 1.0}), ("sensor surface", {"n_s": noise(5e-3)}),
]  # fmt: skip


@pytest.mark.parametrize("name, fault", FAULTS, ids=[f"{k} {name}" for k, (name, _) in enumerate(FAULTS)])
def test_a_fault_is_ambiguous_until_its_one_name_and_withdrawn_when_it_heals(name, fault):
    right = 0
    for seed in SEEDS:
        log = drawn(seed, **fault).log
        assert not log["alarm"][round(1.0 / DT) : round(START / DT)].any()
        names = said(log)
        assert names and names[-1] in ("ambiguous", name), (seed, names)
        right += names[-1] == name
        assert not log["alarm"][ticks(END + 3.0)].any(), seed
        assert "position" in name or not log["reconf"].any()
    assert right >= len(SEEDS) - 1


@pytest.mark.parametrize("ampere, hz", [(1.0, 1.5), (1.3, 0.7), (2.0, 0.7)])
def test_an_oscillation_of_the_drive_that_friction_keeps_from_the_motor_is_never_the_current_sensors(ampere, hz):
    assert not any("sensor" in name for seed in SEEDS for name in said(drawn(seed, f_u=sine(ampere, hz)).log))


def test_an_oscillation_that_answers_itself_is_no_hardover():
    for hz in (3.0, 4.0, 5.0):
        assert all("runaway" not in said(drawn(seed, f_u=sine(17.0, hz)).log) for seed in SEEDS)


def test_play_of_the_screw_is_no_sensor():
    assert all(said(drawn(seed, backlash_add=2e-3).log) == ["ambiguous"] for seed in range(2000, 2006))


@pytest.mark.parametrize("share", [0.002, 0.005, 0.03, 0.1])
def test_a_velocity_bias_never_reconfigures(share):
    """In a 3-2-1-1, in a slow sine and at rest; from 0.5 % on it is named, and no other sensor ever is."""
    for command in (None, sine(10 * RAD_PER_DEG, 0.3), lambda t: 0.0 * t):
        log = drawn(2000, command=command, f_v=share * NO_LOAD).log
        assert not log["reconf"].any()
        assert set(said(log)) - {"ambiguous"} <= {"sensor velocity"}
        assert share < 0.005 or "sensor velocity" in said(log)


def test_a_fault_inside_the_loop_of_the_current_names_no_other_sensor():
    for seed in SEEDS:
        for monitor in (0.0, 0.1 * STALL):
            log = drawn(seed, f_i=0.1 * STALL, f_c=monitor).log
            assert not log["reconf"].any() and not np.isin(log["isolated_part"], (1.0, 2.0)).any()


# --- healthy drives

LARGER = {"K_gi": 1.05, "a": 1.05, "K_ic": 0.95, "b": 0.95}  # 22 % more current than nominal
SMALLER = {name: 2.0 - x for name, x in LARGER.items()}
CORNERS = {}, {**LARGER, "J_M": 0.95, "K_T": 1.05, "K_B": 1.05, "R": 1.05}, SMALLER, {"arm": 0.99}, {"arm": 1.01}


@pytest.mark.parametrize("off", CORNERS)
def test_what_a_drive_is_off_from_the_start_is_its_own(off):
    command = three_two_one_one(T, start=3.0) + three_two_one_one(T, start=10.0)
    log = fly_bench(script(16.0, command=command, hm0=1500.0, hmd=-20e3), reconfigure=False, tolerance=off).log
    assert not log["alarm"].any() and log["r_f"][ticks(4.0)].max() < 0.85
    assert log["lever"][-1] == pytest.approx(off.get("arm", 1.0) - 1.0, abs=0.003)


@pytest.fixture(scope="module")
def flown():
    pulses = {"kind": "three_two_one_one", "start_s": 6.0, "amplitude_deg": 4.0}
    where = flights.scenario(duration=20.0, manoeuvre=pulses, flight={"turbulence": "light"}, seed=3,
                             technology=("ema",) * 4, detectors={"enabled": ["ema_kalman_flight"]})  # fmt: skip
    lanes = train_ema.WIRES
    return fly(where, [path for wires in lanes for path in wires.values()]), lanes


@pytest.mark.parametrize("ticks_older", [-1.0, 1.0])
@pytest.mark.parametrize("field", ["y_current", "y_velocity", "y_position", "y_surface", "jitter"])
def test_a_reading_of_another_age_by_a_tick_or_that_jitters_by_half_a_millisecond_is_none_of_a_fault(
    flown, field, ticks_older
):
    frame, lanes = flown
    frame, rng = frame.copy(), np.random.default_rng(4)
    for wires in lanes:
        for name in ("y_current", "y_velocity", "y_position", "y_surface") if field == "jitter" else (field,):
            y = frame[wires[name]].to_numpy()
            age = rng.uniform(-0.1, 0.1, len(y)) if field == "jitter" else ticks_older * np.ones(len(y))
            frame[wires[name]] = np.interp(np.arange(len(y)) - age, np.arange(len(y)), y)
    log = detect(frame, flight, lanes, fields=("alarm", "own"))
    assert not log["alarm"].any()
    age = log["own"][:, -1, gains.OLDER] - log["own"][:, -1, gains.YOUNGER]
    assert age == pytest.approx(ticks_older if field == "y_current" else 0.0, abs=0.25)


@pytest.mark.parametrize("age", [-1, 0, 1])
def test_gain_magnets_and_age_are_learned_although_the_demand_answers_the_noise_of_the_rate(age):
    """Least squares on the measured rate takes its noise, which stands in f, for weaker magnets."""
    p, rng, n = flight.params(), np.random.default_rng(5), 4000
    x, b, (d, w, predicted, read) = flight.init(p), p["b_motor"][0], np.zeros((4, n))
    for k in range(2, n):
        d[k] = 0.5 * rng.normal() - 0.8 * (read[k - 2] - w[k - 2]) - 0.1 * w[k - 2]
        predicted[k] = 0.98 * w[k - 1] + 0.3 * d[k] + np.sin(0.01 * k)  # a load that turns
        w[k] = predicted[k] + 0.5 * rng.normal()
        read[k] = w[k] + rng.normal()
    f = 0.1 * d + np.roll(d, age) - d - 0.05 * b * w + b * (read - w) + 0.1 * rng.normal(size=n)
    rows = np.stack([d, np.roll(d, 1) - d, np.roll(d, -1) - d, b * (predicted - np.roll(w, 1)), b * read], 1)
    for k in range(1, n - 1):
        x["column"] = rows[k]
        gains.accumulate(x[0], f[k], predicted[k], p[0], DT)
    gains.solve(x[0])
    learned = [0.1, float(age == 1), float(age == -1), 0.0, -0.05]
    assert (np.abs(x["change"][0] - learned) < 4.0 * x["change_sd"][0]).all()
    assert np.linalg.lstsq(rows, f)[0][gains.MAGNETS] > -0.02


def test_a_drive_that_rests_at_first_is_healthy_once_it_moves_and_is_learned_then():
    """At rest the predicted rate is the noise of its sensor: no current answers it, as if the magnets were lost."""
    p, rng, n = flight.params(), np.random.default_rng(1), round(27.0 / DT)
    t, x, u = np.arange(n) * DT, np.zeros((n, 6)), np.zeros((1, n), flight.INPUTS)
    u["u"] = np.where(t > 12.0, 4.0 * np.sin(2 * np.pi * 0.7 * t), 0.0)
    late = np.roll(u["u"][0], int(p["delay"][0]))
    for k in range(1, n):
        x[k] = p["Phi"][0] @ x[k - 1] + p["G"][0] * late[k]
    current = (p["K_gi"] * np.where(t > 24.0, 0.6, 1.0) * late - p["K_B"] * x[:, 3]) / p["R_loop"]
    read = {"position": x[:, 2] * p["lead"], "velocity": x[:, 3], "current": current, "surface": x[:, 0]}
    for (name, y), sigma in zip(read.items(), (1e-5, 1.0, 0.1, 1e-5)):
        u[f"y_{name}"], u[f"{name}_valid"] = y + sigma * rng.standard_normal(n), 1.0
    log = np.zeros(u.shape, flight.STATE)
    flight.rollout(flight.init(p), u, p, DT, log)
    assert not log["alarm"][0, t < 24.0].any() and log["alarm"][0, -1] and log["w_power"].max() > 100.0


@pytest.mark.parametrize("off", ["tolerances.ema.K_ic=0.95", "tolerances.ema.b=1.05", "rate_hz=2000", "rate_hz=100"])
def test_a_healthy_flight_has_no_alarm_at_any_rate(off):
    own = [f"elevator.{side}_{place}=ema" for side in ("left", "right") for place in ("inner", "outer")]
    own += [off, "duration_s=8", "flight.turbulence=light", "detectors.enabled=['ema_kalman_flight']"]
    lanes = cosim.simulate(cosim.load_scenario("cruise", own), timed=False).to_dict()["detectors"]
    assert len(lanes) == 4 and not any(lane["alarm"] for lane in lanes)


# --- parts


@pytest.mark.parametrize("felt, misread", [(1.0, 0.0), (0.2, 0.0), (1.2, 0.8)])
def test_a_misread_velocity_is_told_from_a_torque_by_both_shares_at_once(felt, misread):
    p, rng = flight.params(), np.random.default_rng(8)
    x, twin = flight.init(p), flight.init(p)  # what the same f makes of the innovations
    x["f_timer"] = 1.0
    for k in range(2000):
        f = 3.0 * np.sin(2.0 * np.pi * 2.0 * k * DT)
        gamma = felt * torque.carry(twin[0], 0, p["impulse"][0] * f, 0.0, p[0])
        gamma += misread * torque.carry(twin[0], 2, 0.0, f / p["b_motor"][0], p[0])
        torque.feel(x[0], f, gamma + rng.normal(), True, p[0], DT)
    J, cross, K, *b, _ = x["felt"][0]
    assert np.linalg.solve([[J, cross], [cross, K]], b) == pytest.approx([felt, misread], abs=0.1)


@pytest.mark.parametrize("ampere", [1.0, 2.0, 4.0])
def test_of_a_sine_the_motor_feels_what_is_left_beyond_friction(ampere):
    p = flight.params()
    x, n = flight.init(p), shapes.RING
    x["even_ring"][0, shapes.F] = ampere * np.sin(2.0 * np.pi * 2.0 * shapes.EVEN_S * np.arange(n))
    x["f_age"] = n
    shapes.weigh(x[0], p[0], 0.01, 0.05)
    a = min(shapes.HEALTHY * p["I_max"][0] / ampere, 1.0)
    gain = 1.0 - 2.0 / np.pi * (np.arcsin(a) + a * np.sqrt(1.0 - a * a))  # of a dead zone
    assert x["must"][0] == pytest.approx(gain, abs=0.01)
    assert x["sine_hz"][0, 0] == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize("mm, load, wrong", [(1, 300.0, True), (1, -300.0, False), (1, 0.0, False), (3, 0.0, True)])
def test_what_stands_against_the_hinge_moment_or_is_beyond_all_play_is_a_sensor_that_is_wrong(mm, load, wrong):
    p = flight.params()
    x = flight.init(p)
    x["sensor"], x["pair_d"], x["pair_limit"] = 1.0, 1e-3 * mm, 3e-4
    for _ in range(200):
        positions.play(x[0], load, DT)
    assert (x["against"][0] >= positions.T_AGAINST) == wrong


def test_under_a_load_that_nothing_explains_the_position_is_not_named():
    p = flight.params()
    x = flight.init(p)
    for blame, load, against, who in (
        (1.0, 0.0, 0.0, POSITION), (1.0, 1.1, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (2.0, 0.0, 1.0, vote.SURFACE),
    ):  # fmt: skip
        x["sensor"], x["blame"], x["against"], x["x_hat"][0, 5] = 1.0, blame, against, load * p["th_load"][0]
        assert vote._blame(x[0], p[0]) == who


# --- lost sensors and bad samples

LOST = [("ok_s", {"f_u": sine(6.0, 1.0)}, "ofc_liquid"), ("ok_p", {"f_u": sine(6.0, 1.0)}, "ofc_liquid"),
        ("ok_c", {"f_p": DEGREE}, "sensor position"), ("ok_v", {"f_u": sine(10.0, 1.0)}, "ambiguous")]  # fmt: skip


@pytest.mark.parametrize("flag, fault, name", LOST)
def test_without_a_sensor_the_rest_goes_on(flag, fault, name):
    """Lost from 3 s on: no alarm of that, and a fault is found; without the velocity it has no name."""
    for fields in ({}, fault):
        tick = script(16.0, command=three_two_one_one(T, start=START - 0.4), hmd=-20e3, rng=np.random.default_rng(3))
        tick[flag][T >= 3.0] = 0.0
        for field, value in fields.items():
            tick[field][ON] = value(T[ON] - START) if callable(value) else value
        log = fly_bench(tick, reconfigure=False).log
        assert (said(log) or [None])[-1] == (name if fields else None)


GAPS = [*((flag, 0.0, s) for flag in ("ok_v", "ok_p", "ok_c") for s in (DT, 0.1, 1.0)), ("f_v", 2 * NO_LOAD, DT),
        ("f_v", -1e6, DT), ("f_p", 20 * DEGREE, DT), ("f_c", 100.0, DT)]  # fmt: skip


@pytest.mark.parametrize("field, value, seconds", GAPS)
def test_gaps_and_single_spikes_are_survived(field, value, seconds):
    """In the middle of the motion: nothing not finite, no sensor blamed, valid again at the end."""
    healthy = 1.0 if field.startswith("ok") else 0.0
    flown = drawn(2000, **{field: lambda t: np.where(t < seconds - 0.5 * DT, value, healthy)})
    assert all(np.isfinite(flown.log[name]).all() for name in flight.STATE.names)
    assert not flown.log["alarm"].any() and flown.log["valid"][-1] == 1.0
    assert abs(flown.estimate_error[-1]) < 0.3 * RAD_PER_DEG


# --- the estimate of the position


@pytest.mark.parametrize("fault", [{"f_p": 5 * DEGREE}, {"f_p": 15 * DEGREE}, {"z_p": 1.0}])
@pytest.mark.parametrize("bias", [1e-4, 1e-3])
def test_surface_stays_below_half_a_degree_for_60_s_after_reconfiguration(fault, bias):
    """With a velocity bias [of no-load] that the anchor has learned before the fault."""
    t = np.arange(round(85.0 / DT)) * DT
    tick = script(85.0, command=three_two_one_one(t, start=19.7) + three_two_one_one(t, start=40.0), factor=(1.3, 0.7),
                  rng=np.random.default_rng(5), bias=bias * NO_LOAD)  # fmt: skip
    for field, size in fault.items():
        tick[field][t >= 20.0] = size
    flown = fly_bench(tick)
    begin = t[np.argmax(flown.log["reconf"] > 0)]
    assert 20.0 < begin < 21.5  # frozen on a plateau shows at the pulse's end, 21.2 s
    late = (t > begin + 2.0) & (t < begin + 62.0)
    settled = late & (np.abs(np.gradient(flown.reference, t)) < 1e-3)
    assert np.abs(flown.surface - flown.reference)[settled].max() < 0.5 * RAD_PER_DEG
    assert np.abs(flown.estimate_error)[late[1:]].max() < 0.5 * RAD_PER_DEG
    assert np.all(flown.log["valid"][late] == 1.0)
    assert abs(flown.estimate_error[-1]) * ARM < 3.0 * flown.log["pos_sigma"][-1]


def test_validity_is_withdrawn_with_neither_position_for_long():
    tick = script(400.0)
    tick["f_p"][ticks(5.0)] = 5 * DEGREE
    tick["ok_s"] = 0.0
    log = fly_bench(tick).log
    gone = log["pos_sigma"] > 0.5 * DEGREE
    assert gone.any() and not gone[: round(60.0 / DT)].any()
    np.testing.assert_array_equal(log["valid"][1:], np.where(gone, 0.0, 1.0)[1:])


def test_quiet_minutes_with_a_velocity_bias():
    t = np.arange(round(180.0 / DT)) * DT
    command = sum(three_two_one_one(t, start=s) for s in range(30, 180, 60))
    log = fly_bench(script(180.0, command=command, factor=(1.3, 0.7), bias=5e-4 * NO_LOAD)).log
    assert not log["alarm"].any() and np.all(log["valid"][1:] == 1.0) and log["r"][200:].max() < 0.95


def test_an_alarm_that_comes_back_is_held_for_longer():
    """A position that reads 25 % too much shows only away from zero: the loop does not change hands at every pulse."""
    tick = script(60.0, command=sine(4 * RAD_PER_DEG, 0.15)(np.arange(round(60.0 / DT)) * DT))
    tick["s_p"][ticks(START)] = 0.25
    log = fly_bench(tick, reconfigure=False).log
    assert 1 <= (np.diff(log["alarm"]) > 0).sum() <= 4
    assert (log["alarm"][ticks(25.0)] > 0.5).mean() > 0.95


def test_position_monitor_of_an_ema_sees_a_loss_of_command_and_says_jam_only_at_rest():
    def watched(command, surface):
        u = np.zeros((1, len(T)), position_monitor.INPUTS)
        u["command"], u["surface"], u["surface_valid"] = command, surface, 1.0
        p = position_monitor.params("flight_ema")
        log = np.zeros((1, len(T)), position_monitor.STATE)
        position_monitor.rollout(position_monitor.init(p), u, p, DT, log)
        return log[0]

    command = three_two_one_one(T, start=2.0, unit=1.0)
    healthy = watched(command, command * 0.0)["model"]
    lossy, drifting = watched(command, 0.4 * healthy), watched(0.0 * T, np.clip(T - 2.0, 0.0, None) * RAD_PER_DEG)
    assert not watched(command, healthy)["alarm"].any()
    assert lossy["alarm"].any() and set(np.unique(lossy["verdict"])) <= {v.NONE, v.AMBIGUOUS}
    assert v.JAM_SOLID in watched(command, np.zeros_like(T))["verdict"]
    assert drifting["alarm"].any() and v.JAM_SOLID not in drifting["verdict"]
