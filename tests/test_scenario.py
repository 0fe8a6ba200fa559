"""Scenarios: what is accepted, what is refused and how, and that an expanded one is the same one."""

import math
import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim.errors import CosimError, ScenarioError
from cosim.replay.map_file import load_map
from cosim.scenario import builtin_names, load_scenario, parse
from cosim.scenario import catalog as c
from cosim.scenario.inventory import inventory

POINT = {"mass_t": 200.0, "cg_pct": 30.0, "altitude_ft": 20000.0, "cas_kt": 290.0}
OFC = {"target": "elevator.left_inner", "kind": "ofc_liquid", "start_s": 12.0, "amplitude_mm": 5.0, "frequency_hz": 1.0}


def flight(*faults, **tables):
    return parse({"flight": POINT, "faults": list(faults), **tables})


def fault(target, kind, **own):
    return {"target": target, "kind": kind, "start_s": 10.0, **own}


JAM = fault("elevator.left", "jam_solid")
THRUST = fault("engine.all", "thrust_loss", loss_pct=60.0)


def refused(*overrides, name="liquid-ofc"):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(name, overrides)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_default_scenario_is_the_one_of_the_design():
    s = load_scenario()
    assert (s.flight.mass_t, s.flight.cg_pct, s.flight.altitude_ft, s.flight.cas_kt) == (200, 30, 20000, 290)
    assert s.elevator.technology == dict(zip(c.SEGMENTS, ("hydraulic", "hydraulic", "ema", "ema")))
    (f,) = s.faults
    assert (f.target, f.kind, f.start_s) == ("elevator.left_inner", "ofc_liquid", 12.0)
    assert set(s.detectors.enabled) == set(c.DETECTORS)


@pytest.mark.parametrize("name", builtin_names())
def test_builtin_loads_has_a_title_and_expands_to_itself(name):
    s = load_scenario(name)
    assert s.title
    assert s.warnings() == []
    text = s.expanded_toml()
    assert parse(tomllib.loads(text)) == s
    assert parse(tomllib.loads(text)).expanded_toml() == text


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("duration_s=0.001", ("duration_s = 0.001", "less than a tick at 200 Hz", "0.005 to 36000")),
        ("flight=3", ("flight = 3: must be a table",)),
        ("faults=3", ("faults = 3: must be a list",)),
        ("detectors.enabled=iotsekf", ("detectors.enabled = iotsekf: must be a list",)),
        ("faults.0.target=3", ("faults.0.target = 3: must be text",)),
    ],
)
def test_message_speaks_of_the_file_not_of_python(override, words):
    text = refused(override)
    assert all(w in text for w in words)


def test_one_tick_is_a_flight():
    assert load_scenario("cruise", ["duration_s=0.005"]).ticks == 1


def test_a_limit_on_the_other_side_is_noted():
    away = fault("elevator.left_outer", "runaway", rate_deg_s=10.0, limit_deg=-8.0)
    (line,) = flight(away).warnings()
    assert "drives away from limit_deg = -8" in line
    assert flight({**away, "limit_deg": 8.0}).warnings() == []


def test_no_name_is_no_folder():
    with pytest.raises(ScenarioError, match="no scenario is named"):
        load_scenario("")


def test_a_scale_that_changes_nothing_is_refused():
    with pytest.raises(ScenarioError, match=r"faults.0.scale = 1.0: is out of range; allowed: -10 to 10, not 1"):
        flight(fault("sensor.alpha", "scale", scale=1.0))


def test_every_kind_of_fault_and_manoeuvre_is_flown_by_a_builtin():
    flown = [load_scenario(n) for n in builtin_names()]
    assert {f.kind for s in flown for f in s.faults} == set(c.ALL_KINDS)
    listed = {(f["place"], f["kind"]) for f in inventory()["faults"]}
    assert len(listed) == len(inventory()["faults"])


def test_the_scenario_and_the_map_of_the_readme_load(tmp_path):
    text = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
    example, recording = re.findall(r"```toml\n(.*?)```", text, re.S)
    assert parse(tomllib.loads(example)).warnings() == []
    path = tmp_path / "map.toml"
    path.write_text(recording, encoding="utf-8")
    assert {"de_cmd", "alpha", "left_inner.rod"} <= set(load_map(path)[0].signals)


def test_issue_names_of_builtins_exist():
    asked = """cruise liquid-ofc solid-ofc liquid-jam solid-jam runaway ema-velocity-bias ema-position-scale
        ema-current-bias alpha-bias alwi14-simultaneous alwi14-simultaneous-literal thrust-loss
        elevator-lock-then-thrust-loss"""
    assert set(asked.split()) <= set(builtin_names())


def test_numbers_come_out_in_si():
    s = flight(
        fault("elevator.left_inner", "ofc_liquid", at="command", amplitude_deg=2.0, frequency_hz=2.0, phase_deg=90.0),
        fault("elevator.right.position", "scale", scale=1.25),
        fault("sensor.cas", "drift", drift_kt_s=1.0, end_s=20.0),
        fault("engine.all", "thrust_loss", loss_pct=25.0),
        fault("elevator.left_outer", "runaway", rate_deg_s=-20.0, limit_deg=-5.0),
    )
    ofc, scale_i, scale_o, drift, *thrust, runaway = s.injections()
    assert ofc.magnitude == pytest.approx(math.radians(2)) and ofc.unit == "rad"
    assert ofc.omega == pytest.approx(4 * math.pi) and ofc.phase == pytest.approx(math.pi / 2)
    assert ofc.end == math.inf
    assert (scale_i.name, scale_o.name, scale_i.sensor) == ("right_inner", "right_outer", "position")
    assert scale_i.magnitude == 0.25 and scale_i.path == "loop"
    assert (
        drift.magnitude == pytest.approx(1852 / 3600)
        and drift.unit == "m/s/s"
        and drift.path == "all"
        and drift.end == 20
    )
    assert [t.name for t in thrust] == ["1", "2", "3", "4"] and {t.magnitude for t in thrust} == {0.25}
    assert runaway.magnitude == pytest.approx(math.radians(-20)) and runaway.limit == pytest.approx(math.radians(-5))
    assert s.flight.speed == ("cas", pytest.approx(149.189, abs=1e-3)) and s.flight.altitude == pytest.approx(6096)


def test_fraction_of_travel_means_40_degrees():
    s = flight(fault("elevator.left", "ofc_solid", at="command", amplitude_travel=0.033, frequency_hz=1.0))
    assert [math.degrees(j.magnitude) for j in s.injections()] == pytest.approx(
        [1.32, 1.32]
    )  # [Sun13], 0.033 of travel


def test_liquid_jam_acts_on_the_sensor_that_closes_the_loop():
    s = flight(fault("elevator.all", "jam_liquid", bias_deg=1.0))
    assert [j.sensor for j in s.injections()] == ["rod", "rod", "position", "position"]


def test_sensor_settings_in_si():
    s = flight(sensors={"alpha": {"sigma_deg": 0.1, "scale": 1.02, "delay_s": 0.02}, "pressure": {"bias_pct": 1.0}})
    alpha = s.sensors.setting("alpha")
    assert (
        alpha.sigma == pytest.approx(math.radians(0.1)) and alpha.scale == pytest.approx(0.02) and alpha.delay == 0.02
    )
    assert alpha.bias is None and s.sensors.setting("pressure").bias == pytest.approx(0.01)
    assert s.sensors.setting("q").sigma is None


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["flight.mas_t=3"], ["flight.mas_t = 3", "unknown key", "mass_t"]),
        (["flight.mass_t=3"], ["flight.mass_t = 3", "180 to 405"]),
        (["flight.mass_t=nan"], ["flight.mass_t", "finite"]),
        (["flight.cg_pct=heavy"], ["flight.cg_pct = heavy", "number", "20 to 40"]),
        (["flight.mach=0.99"], ["flight.mach = 0.99", "0.15 to 0.95"]),
        (["flight.turbulence=lite"], ["flight.turbulence = lite", "light"]),
        (["duration_s=0"], ["duration_s = 0", "above 0"]),
        (["duration_s=true"], ["duration_s"]),
        (["seed=-1"], ["seed = -1"]),
        (["seed=1.5"], ["seed = 1.5", "integer"]),
        (["durations=3"], ["durations", "Did you mean 'duration_s'?"]),
        (["manoeuvre.kind=cruis"], ["manoeuvre.kind = cruis", "Did you mean 'cruise'?"]),
        (["manoeuvre.kind=nz_doublet", "manoeuvre.amplitude_g=9"], ["manoeuvre.amplitude_g = 9", "-1.5 to 1.5"]),
        (["manoeuvre.kind=nz_doublet", "manoeuvre.bank_deg=9"], ["manoeuvre.bank_deg", "unknown key", "width_s"]),
        (["elevator.left_inner=emma"], ["elevator.left_inner = emma", "hydraulic, ema, simple"]),
        (["elevator.feedback=iotsek"], ["elevator.feedback = iotsek", "Did you mean 'iotsekf'?"]),
        (["sensors.alfa.sigma_deg=1"], ["sensors.alfa", "Did you mean 'alpha'?"]),
        (["sensors.alpha.sigma_rad=1"], ["sensors.alpha.sigma_rad", "sigma_deg"]),
        (["tolerances.aero.Cm_alpha=9"], ["tolerances.aero.Cm_alpha = 9", "out of range"]),
        (["tolerances.aero.Cm_alfa=1.1"], ["tolerances.aero.Cm_alfa", "Did you mean 'Cm_alpha'?"]),
        (["tolerances.hydraulic.nope=1.1"], ["tolerances.hydraulic.nope", "P_s"]),
        (["tolerances.ema.nope=1.1"], ["tolerances.ema.nope", "R"]),
        (['detectors.enabled=["iotsek"]'], ["detectors.enabled.0", "Did you mean 'iotsekf'?"]),
        (['detectors.enabled=["rfafe", "rfafe"]'], ["detectors.enabled.1", "twice"]),
        (["detectors.rfafee.x=2"], ["detectors.rfafee", "Did you mean 'rfafe'?"]),
        (["faults.0.frequency_hz=300"], ["faults.0.frequency_hz = 300", "0.01 to 25"]),
        (["faults.0.freqency_hz=3"], ["faults.0.freqency_hz", "Did you mean 'frequency_hz'?"]),
        (["faults.0.amplitude_deg=2"], ["faults.0.amplitude_deg", "at 'valve'", "amplitude_mm"]),
        (["faults.0.at=sensor", "faults.0.kind=ofc_solid"], ["faults.0"]),
        (["faults.0.target=elevator.left_iner"], ["faults.0.target", "Did you mean 'elevator.left_inner'?"]),
        (["faults.0.target=elevator.left_inner.rodd"], ["faults.0.target", "Did you mean 'elevator.left_inner.rod'?"]),
        (["faults.0.target=engine.5"], ["faults.0.target", "engine.4"]),
        (["faults.0.target=sensor.alhpa"], ["faults.0.target", "Did you mean 'sensor.alpha'?"]),
        (["faults.0.target=rudr"], ["faults.0.target", "Did you mean 'rudder'?"]),
        (["faults.0.kind=ofc_gas"], ["faults.0.kind", "is no kind of fault"]),
        (["faults.0.kind=dropout"], ["faults.0.kind", "no fault of an elevator"]),
        (["faults.0.kind=air_in_oil"], ["faults.0.loss_pct", "needs loss_pct", "above 0 to 100"]),
        (["faults.0.kind=magnet_loss", "faults.0.loss_pct=5"], ["faults.0.kind", "hydraulic actuator", "EMA"]),
        (["faults.0.end_s=5"], ["faults.0.end_s = 5", "above start_s = 12"]),
        (["faults.0.end_s=13", "faults.0.ramp_s=3"], ["faults.0.ramp_s", "longer"]),
        (["faults.0.start_s=-1"], ["faults.0.start_s = -1", "0 to 36000"]),
        (["faults.0.path=observers"], ["faults.0.path", "no path"]),
        (["faults.2.kind=bias"], ["faults.2", "index 0 to 1"]),
        (["faults.x.kind=bias"], ["faults.x", "index 0 to 1"]),
        (["flight.mass_t.x=1"], ["--set flight.mass_t.x=1", "is a value"]),
        (["flight"], ["--set flight", "key=value"]),
        (["faults=3"], ["faults = 3"]),
    ],
)
def test_mistake_is_named_with_place_and_remedy(overrides, says):
    text = refused(*overrides)
    for part in says:
        assert part in text


@pytest.mark.parametrize(
    ("faults", "key", "says"),
    [
        ([{**OFC, "kind": "ofc_solid", "at": "sensor"}], "faults.0.at", "cannot replace"),
        ([fault("elevator.all", "supply_pressure_drop", loss_pct=50.0)], "faults.0.kind", "right_inner is an EMA"),
        ([fault("elevator.right_inner.rod", "bias", bias_mm=1.0)], "faults.0.target", "no sensor 'rod'"),
        ([fault("elevator.left_inner.current", "bias", bias_a=1.0)], "faults.0.target", "no sensor 'current'"),
        ([fault("elevator.left_inner.rod", "bias", bias_mm=1.0, path="observers")], "faults.0.path", "loop, monitor"),
        ([fault("sensor.alpha", "bias", bias_deg=1.0, path="loop")], "faults.0.path", "all, observers"),
        ([fault("sensor.alpha", "bias", bias_kt=1.0)], "faults.0.bias_kt", "bias_deg"),
        ([fault("sensor.alpha", "bias", bias_deg=0.0)], "faults.0.bias_deg", "not 0"),
        ([fault("sensor.alpha", "bias", bias_deg="1")], "faults.0.bias_deg", "no number"),
        ([fault("sensor.alpha", "freeze", ramp_s=1.0)], "faults.0.ramp_s", "at once"),
        ([fault("rudder", "jam_solid")], "faults.0.kind", "other than the elevator"),
        ([fault("engine.1", "runaway", rate_deg_s=1.0)], "faults.0.kind", "thrust_loss"),
        ([{**OFC, "amplitude": 0.1}], "faults.0.amplitude_mm", "twice"),
        ([JAM, fault("elevator.left_inner", "free_float")], "faults.1.start_s", "take over"),
        ([fault("sensor.q", "freeze"), fault("sensor.q", "dropout")], "faults.1.start_s", "take over"),
        ([THRUST, {**THRUST, "target": "engine.2"}], "faults.1", "take over"),
        (["ofc"], "faults.0", "a table"),
        ([{"kind": "bias"}], "faults.0.target", "missing"),
    ],
)  # fmt: skip
def test_impossible_combination_is_refused(faults, key, says):
    with pytest.raises(ScenarioError) as caught:
        flight(*faults)
    assert key in str(caught.value) and says in str(caught.value)


def test_faults_on_a_simple_actuator_enter_at_the_command_only():
    simple = {"left_inner": "simple"}
    with pytest.raises(ScenarioError, match="has no valve"):
        flight(OFC, elevator=simple)
    flight({**OFC, "at": "command"}, elevator=simple)
    with pytest.raises(ScenarioError, match="free_float"):
        flight(fault("elevator.left_inner", "free_float"), elevator=simple)


def test_faults_may_follow_each_other_and_act_together():
    first = fault("elevator.left_inner", "jam_solid", end_s=12.0)
    flight(first, {**first, "start_s": 12.0, "end_s": 14.0})
    flight(OFC, {**OFC, "frequency_hz": 2.0}, fault("sensor.alpha", "bias", bias_deg=1.0))


def test_override_replaces_what_it_excludes():
    s = load_scenario(
        "liquid-ofc", ["flight.mach=0.6", "faults.0.amplitude=0.01", "elevator.feedback.left_inner=rtsekf"]
    )
    assert (s.flight.mach, s.flight.cas_kt) == (0.6, None)
    assert s.faults[0].model_extra["amplitude"] == 0.01 and "amplitude_mm" not in s.faults[0].model_extra
    assert (s.elevator.feedback.left_inner, s.elevator.feedback.left_outer) == ("rtsekf", "iotsekf")
    s = load_scenario(
        "solid-ofc", ["manoeuvre.kind=coordinated_turn", "manoeuvre.bank_deg=20", "faults.0.kind=jam_solid"]
    )
    assert (s.manoeuvre.bank_deg, s.manoeuvre.start_s) == (20, 14) and s.faults[0].model_extra == {}


def test_override_appends_a_fault_at_the_next_index():
    keys = ["target=sensor.alpha", "kind=bias", "start_s=3", "bias_deg=1"]
    s = load_scenario("liquid-ofc", [f"faults.1.{k}" for k in keys])
    assert [f.kind for f in s.faults] == ["ofc_liquid", "bias"]
    assert load_scenario("cruise", [f"faults.0.{k}" for k in keys]).faults[0].target == "sensor.alpha"


def test_overrides_leave_the_source_alone_and_apply_in_order():
    assert load_scenario("cruise", ["seed=2", "seed=3"]).seed == 3
    assert load_scenario("cruise").seed == 1


def test_feedback_is_for_hydraulic_segments_and_brings_its_filter_along():
    s = load_scenario(
        "cruise", ["elevator.feedback=rtsekf_flight", "detectors.enabled=[]", "elevator.reconfigure=true"]
    )
    assert list(vars(s.elevator.feedback).values()) == ["rtsekf_flight", "rtsekf_flight", "measured", "measured"]
    assert s.running == ("rtsekf_flight", "ema_kalman_flight")
    switched = ["elevator.feedback=measured", "detectors.enabled=[]", "elevator.reconfigure=true"]
    assert load_scenario("cruise", switched).running == ("ema_kalman_flight", "rtsekf_flight")
    word_then_one = ["elevator.feedback=measured", "elevator.feedback.left_inner=iotsekf"]
    assert load_scenario("cruise", word_then_one).elevator.feedback.left_outer == "measured"
    assert load_scenario("cruise", ["elevator.left_inner=ema"]).elevator.feedback.left_inner == "measured"
    assert load_scenario("cruise", ["elevator.right_inner=hydraulic"]).elevator.feedback.right_inner == "iotsekf"
    with pytest.raises(ScenarioError, match=r"elevator\.feedback\.right_inner.*right_inner is ema"):
        load_scenario("cruise", ["elevator.feedback.right_inner=iotsekf"])


def test_override_of_technology_takes_its_default_feedback(tmp_path):
    path = tmp_path / "expanded.toml"
    path.write_text(load_scenario("cruise").expanded_toml())
    assert load_scenario(path, ["elevator.left_inner=simple"]).elevator.feedback.left_inner == "measured"


def test_speed_is_needed_once():
    point = {k: v for k, v in POINT.items() if k != "cas_kt"}
    with pytest.raises(ScenarioError, match="exactly one of cas_kt, mach, tas_kt"):
        parse({"flight": point})
    with pytest.raises(ScenarioError, match="both given"):
        parse({"flight": {**POINT, "mach": 0.5}})


def test_fault_after_the_end_is_legal_and_pointed_out():
    (line,) = load_scenario("liquid-ofc", ["duration_s=5"]).warnings()
    assert "12 s" in line and "5 s" in line


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "flight"),
        (b"[flight\n", "line 1"),
        (b"title = \"a\"\nseed = = 3\n", "line 2"),
        (b"\xff\xfe\x00", "UTF-8"),
        (b"seed = 1\nseed = 2\n", "line 2"),
    ],
)  # fmt: skip
def test_bad_file_is_named(tmp_path, content, says):
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert str(path) in str(caught.value) and says in str(caught.value)


def test_bad_path_is_named(tmp_path):
    for path, says in (
        (tmp_path, "folder"),
        (tmp_path / "no.toml", "no file"),
        ("liquid-ofcc", "Did you mean 'liquid-ofc'?"),
    ):
        with pytest.raises(ScenarioError, match=says):
            load_scenario(path)
    big = tmp_path / "big.toml"
    big.write_bytes(b"#" * 2_000_000)
    with pytest.raises(ScenarioError, match="too large"):
        load_scenario(big)
    with pytest.raises(ScenarioError):
        load_scenario("nul\0byte.toml")


def test_public_names_stay_functions_after_their_modules_are_imported():
    import cosim.scenario

    assert callable(cosim.load_scenario)
    cosim.simulate_probe = 1  # ordinary attributes still bind
    assert cosim.simulate_probe == 1
    del cosim.simulate_probe
    with pytest.raises(AttributeError):
        cosim.no_such_name  # noqa: B018


def test_error_survives_pickling():
    import pickle

    error = pickle.loads(pickle.dumps(ScenarioError("wrong", place="a.toml", allowed="1 to 2", remedy="Mend it")))
    assert isinstance(error, CosimError) and str(error) == "a.toml: wrong; allowed: 1 to 2. Mend it"


def _magnitude(key):
    low = max(key.low, -1e6) if not key.open_low else key.low + 1e-3
    numbers = st.floats(low, key.high, allow_nan=False)
    return numbers.filter(key.accepts)


@st.composite
def faults(draw, index):
    """Any fault that the catalog knows, on a part of its own so that no two conflict."""
    place, target, kinds = draw(
        st.sampled_from(
            [
                ("sensor", f"sensor.{list(c.SENSORS)[index]}", c.sensor_kinds(c.SENSORS[list(c.SENSORS)[index]])),
                ("surface", c.SURFACES[index], c.SURFACE_KINDS),
                ("engine", f"engine.{index + 1}", c.ENGINE_KINDS),
                ("elevator", f"elevator.{c.SEGMENTS[index]}", c.ELEVATOR_KINDS),
            ]
        )
    )
    technology = "hydraulic" if index < 2 else "ema"
    name = draw(st.sampled_from([k for k, v in kinds.items() if technology in v.technologies or place != "elevator"]))
    kind = kinds[name]
    out = {"target": target, "kind": name, "start_s": draw(st.floats(0, 100))}
    one_of = kind.one_of
    if kind.at:
        out["at"] = draw(st.sampled_from(kind.at))
        one_of = [k for k in one_of if not name.startswith("ofc") or k.name in c.AMPLITUDES_AT[out["at"]]]
    if one_of:
        key = draw(st.sampled_from(list(one_of)))
        out[key.name] = draw(_magnitude(key))
    for key in kind.keys:
        out[key.name] = draw(_magnitude(key))
    if draw(st.booleans()):
        out["end_s"] = out["start_s"] + draw(st.floats(1.0, 100))
    return out


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_any_scenario_expands_to_an_equal_one(data):
    draw = data.draw
    table = {
        "title": draw(st.text(st.characters(codec="utf-8"), max_size=20)),
        "seed": draw(st.integers(0, 2**31 - 1)),
        "duration_s": draw(st.floats(0.01, 36000)),
        "flight": {**POINT, "mass_t": draw(st.floats(180, 405)), "altitude_ft": draw(st.floats(0, 45000))},
        "faults": [draw(faults(i)) for i in range(draw(st.integers(0, 4)))],
        "elevator": {"feedback": draw(st.sampled_from(c.FEEDBACKS))},
        "detectors": {
            "enabled": draw(st.lists(st.sampled_from(list(c.DETECTORS)), unique=True)),
            "iotsekf": {"q_fault": 0.5},
        },
        "tolerances": {"aero": {"Cm_alpha": draw(st.floats(0.2, 5.0))}},
    }
    s = parse(table)
    again = parse(tomllib.loads(s.expanded_toml()))
    assert again == s and again.expanded_toml() == s.expanded_toml()
    assert len(again.injections()) >= len(s.faults)
